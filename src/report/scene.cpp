// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/scene.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "polypod/core/units.hpp"
#include "svg.hpp"

namespace polypod::report {
namespace {

using svg::LegendEntry;
using svg::Picture;
using svg::px;

Point3 operator+(const Point3& a, const Point3& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
Point3 operator-(const Point3& a, const Point3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
Point3 operator*(double s, const Point3& a) {
  return {s * a.x, s * a.y, s * a.z};
}
double dot(const Point3& a, const Point3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
Point3 cross(const Point3& a, const Point3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
Point3 unit_of(const Point3& a) {
  const double n = std::sqrt(dot(a, a));
  return n > 0 ? (1 / n) * a : a;
}
double& part(Point3& p, int axis) {
  return axis == 0 ? p.x : axis == 1 ? p.y : p.z;
}
bool finite(const Point3& p) {
  return std::isfinite(p.x + p.y + p.z);
}

/// Step `kind` of `count` of the sequential map, darkened or lightened like kind_colour: as it is at kFull.
std::string step_colour(int kind, std::size_t count, double lightness) {
  constexpr double kFull = 0.8;
  const double t = count > 1 ? std::clamp(kind / static_cast<double>(count - 1), 0.0, 1.0) : 0.5;
  const std::string base = colour_at(ColourMap::sequential, t);
  std::string out = "#";
  for (std::size_t k = 1; k < base.size(); k += 2) {
    const int value = std::stoi(base.substr(k, 2), nullptr, 16);
    out += fmt::format("{:02x}", std::clamp(static_cast<int>(std::lround(value * lightness / kFull)), 0, 255));
  }
  return out;
}

/// A corner of a polygon with a value that is linear over it.
struct Valued {
  Point3 at;
  double value = 0;
};
/// The parts of a convex polygon below and above a level.
std::array<std::vector<Valued>, 2> cut(const std::vector<Valued>& polygon, double level) {
  std::array<std::vector<Valued>, 2> out;
  for (std::size_t k = 0; k < polygon.size(); ++k) {
    const Valued &a = polygon[k], &b = polygon[(k + 1) % polygon.size()];
    out[a.value < level ? 0 : 1].push_back(a);
    if ((a.value < level) == (b.value < level)) continue;
    const double t = (level - a.value) / (b.value - a.value);
    const Valued middle{a.at + t * (b.at - a.at), level};
    out[0].push_back(middle);
    out[1].push_back(middle);
  }
  return out;
}

/// Whether each side of each triangle is the side of one other triangle, the other way round: such a mesh hides what is
/// behind it, its own far side too.
bool is_closed(const Mesh& mesh) {
  std::set<std::array<int, 2>> open;
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const int a = t[k], b = t[(k + 1) % 3];
      if (a < 0 || static_cast<std::size_t>(a) >= mesh.points.size() ||
          !finite(mesh.points[static_cast<std::size_t>(a)]))
        return false;
      if (open.erase({b, a}) == 0 && !open.insert({a, b}).second) return false;
    }
  }
  return open.empty();
}

/// Something to draw, and how near it is.
struct Piece {
  double depth = 0;
  std::string svg;
};

}  // namespace

std::vector<Point3> shown_points(const Scene& scene, const Line3& line) {
  std::vector<Point3> out = line.points;
  if (!scene.shift || line.offset.size() != out.size()) return out;
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = out[k] + scene.shift->at * line.offset[k];
  return out;
}

Box3 box_of(const Scene& scene, bool with_frames) {
  Point3 lo{1e300, 1e300, 1e300}, hi{-1e300, -1e300, -1e300};
  const auto add = [&](const Point3& p) {
    if (!finite(p)) return;
    lo = {std::min(lo.x, p.x), std::min(lo.y, p.y), std::min(lo.z, p.z)};
    hi = {std::max(hi.x, p.x), std::max(hi.y, p.y), std::max(hi.z, p.z)};
  };
  for (const Mesh& m : scene.meshes) std::for_each(m.points.begin(), m.points.end(), add);
  for (const Line3& l : scene.lines) {
    const std::vector<Point3> points = shown_points(scene, l);
    std::for_each(points.begin(), points.end(), add);
  }
  for (const Frames& f : scene.frames)
    for (const auto& points : f.points)
      if (with_frames) std::for_each(points.begin(), points.end(), add);
  if (lo.x > hi.x) lo = hi = Point3{};
  const double longest = std::max({hi.x - lo.x, hi.y - lo.y, hi.z - lo.z, 1e-9});
  for (int axis = 0; axis < 3; ++axis) {  // some air, and no flat box
    const double air = std::max(0.03 * longest, 0.5 * (0.1 * longest - (part(hi, axis) - part(lo, axis))));
    part(lo, axis) -= air;
    part(hi, axis) += air;
  }
  return {lo, hi, longest};
}

SceneKinds kinds_of(const Scene& scene) {
  SceneKinds out;
  const auto& kinds = scene.kinds;
  out.occurs.assign(kinds.size(), 0);
  for (const Mesh& m : scene.meshes) {
    for (const int k : m.kind)
      if (k >= 0 && static_cast<std::size_t>(k) < kinds.size()) out.occurs[static_cast<std::size_t>(k)] = 1;
    for (const double v : m.value) {
      const auto& levels = scene.levels;
      const auto band = static_cast<std::size_t>(std::upper_bound(levels.begin(), levels.end(), v) - levels.begin());
      if (band < kinds.size()) out.occurs[band] = 1;
    }
    if (m.kind.empty() && m.value.empty() && !kinds.empty() && !m.triangles.empty()) out.occurs[0] = 1;
  }
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    const int kind = static_cast<int>(k);
    out.fill.push_back(scene.levels.empty() ? kind_colour(kind, 0.66) : step_colour(kind, kinds.size(), 0.8));
  }
  return out;
}

std::string Scene::operator()(const Canvas& canvas) const {
  Picture picture(canvas, title);
  const auto colour_of = [&](int kind, double lightness) {
    return levels.empty() || kind < 0 ? kind_colour(kind, lightness) : step_colour(kind, kinds.size(), lightness);
  };
  const double az = units::from_deg(azimuth_deg), el = units::from_deg(elevation_deg);
  const Point3 to_eye{std::cos(el) * std::cos(az), std::cos(el) * std::sin(az), std::sin(el)};
  const Point3 right{-std::sin(az), std::cos(az), 0}, up = cross(to_eye, right);
  // Light from the upper left, a little behind the eye.
  const Point3 light = unit_of(0.75 * to_eye + 0.55 * up + -0.45 * right);

  const Box3 box = box_of(*this, false);
  Point3 lo = box.low, hi = box.high;
  const double longest = box.longest;
  std::vector<LegendEntry> entries;
  const SceneKinds known_kinds = kinds_of(*this);
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    if (known_kinds.occurs[k] == 0) continue;
    LegendEntry entry;
    entry.name = kinds[k];
    entry.area = true;
    entry.fill = known_kinds.fill[k];
    entries.push_back(std::move(entry));
  }
  std::set<std::string> named;
  for (const Line3& l : lines) {
    if (!l.name.empty() && named.insert(l.name).second) {
      entries.push_back({l.name, l.colour, l.dots ? LineStyle::points : LineStyle::solid, false, l.stroke, false, {}});
    }
  }
  const double top = picture.legend(entries, 2, 2) + 8;

  // Projection: the box fills the picture, less a margin for numbers.
  double u0 = 1e300, u1 = -1e300, v0 = 1e300, v1 = -1e300;
  const auto corner = [&](int bits) {
    return Point3{(bits & 1) != 0 ? hi.x : lo.x, (bits & 2) != 0 ? hi.y : lo.y, (bits & 4) != 0 ? hi.z : lo.z};
  };
  for (int bits = 0; bits < 8; ++bits) {
    const Point3 c = corner(bits);
    u0 = std::min(u0, dot(c, right));
    u1 = std::max(u1, dot(c, right));
    v0 = std::min(v0, dot(c, up));
    v1 = std::max(v1, dot(c, up));
  }
  const double margin_x = 46, margin_y = 34;
  const bool narrow = picture.width < 500;
  const double room_x = picture.width - 2 * margin_x;
  const double room_y = picture.width * (narrow ? std::max(1.1, max_aspect) : max_aspect);
  const double scale = std::min(room_x / (u1 - u0), room_y / (v1 - v0));
  const double x0 = picture.width / 2 - scale * (u0 + u1) / 2, y0 = top + 6 + scale * v1;
  const auto project = [&](const Point3& p) { return Point{x0 + scale * dot(p, right), y0 - scale * dot(p, up)}; };
  const double height = top + 6 + scale * (v1 - v0) + margin_y + 12;

  // The three faces of the box that look away from the eye carry the grid.
  Point3 back = lo, front = hi;
  for (int axis = 0; axis < 3; ++axis) {
    Point3 eye = to_eye;
    if (part(eye, axis) < 0) std::swap(part(back, axis), part(front, axis));
  }
  const auto ticks_of = [&](int axis) {
    Point3 a = lo, b = hi, e{};
    part(e, axis) = 1;
    const double pixels = scale * (part(b, axis) - part(a, axis)) * std::hypot(dot(e, right), dot(e, up));
    return svg::ticks_in(part(a, axis), part(b, axis), svg::tick_count(pixels, 46));
  };
  std::string grid;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double t : ticks_of(axis)) {
      for (const int across : {(axis + 1) % 3, (axis + 2) % 3}) {  // along `across`, on the face behind the third axis
        Point3 a = back, b = back;
        part(a, axis) = part(b, axis) = t;
        part(b, across) = part(front, across);
        const Point p = project(a), q = project(b);
        grid += fmt::format("M{} {}L{} {}", px(p.x), px(p.y), px(q.x), px(q.y));
      }
    }
  }
  picture.body += fmt::format("<path d=\"{}\" class=\"grid\" fill=\"none\"/>\n", grid);
  std::string frame;
  for (int axis = 0; axis < 3; ++axis) {
    for (const int across : {(axis + 1) % 3, (axis + 2) % 3}) {
      Point3 a = back;
      part(a, across) = part(front, across);
      Point3 b = a;
      part(b, axis) = part(front, axis);
      const Point p = project(a), q = project(b);
      frame += fmt::format("M{} {}L{} {}", px(p.x), px(p.y), px(q.x), px(q.y));
    }
    Point3 b = back;
    part(b, axis) = part(front, axis);
    const Point p = project(back), q = project(b);
    frame += fmt::format("M{} {}L{} {}", px(p.x), px(p.y), px(q.x), px(q.y));
  }
  picture.body += fmt::format("<path d=\"{}\" class=\"grid\" fill=\"none\" style=\"stroke:var(--rule)\"/>\n", frame);
  const Point middle = project(0.5 * (lo + hi));
  const auto numbers = [&](int axis, Point3 edge) {
    // Numbers along an edge of the box, on the side away from its middle.
    part(edge, axis) = 0.5 * (part(lo, axis) + part(hi, axis));
    const Point at = project(edge);
    Point3 e{};
    part(e, axis) = 1;
    const double ex = dot(e, right), ey = -dot(e, up), length = std::max(std::hypot(ex, ey), 1e-9);
    double nx = -ey / length, ny = ex / length;
    if (nx * (at.x - middle.x) + ny * (at.y - middle.y) < 0) {
      nx = -nx;
      ny = -ny;
    }
    const std::vector<double> ticks = ticks_of(axis);
    const int decimals = svg::decimals_of(ticks);
    const char* align = nx > 0.35 ? "n" : nx < -0.35 ? "n e" : "n m";
    double widest = 0;
    for (const double t : ticks) {
      part(edge, axis) = t;
      const Point p = project(edge);
      const std::string text = fixed(t, decimals);
      widest = std::max(widest, svg::text_width(text, svg::kSmallFont));
      picture.line(p.x, p.y, p.x + 4 * nx, p.y + 4 * ny, "axis");
      picture.text(p.x + 8 * nx, p.y + 8 * ny + 4 + 4 * std::max(0.0, ny), text, align, svg::kSmallFont);
    }
    const double away = 17 + widest * std::abs(nx) + 8 * std::abs(ny);
    const bool upright = std::abs(ny) < 0.35;  // beside an upright edge there is no room: its name goes to its end
    Point3 end = edge;
    part(end, axis) = to_eye.z >= 0 ? part(hi, axis) : part(lo, axis);  // where the other axes have no numbers
    const Point tip = project(end);
    if (upright) {
      picture.text(tip.x, to_eye.z >= 0 ? tip.y - 7 : tip.y + 16,
                   svg::with_unit(axes[static_cast<std::size_t>(axis)], unit), "q m");
    } else {
      const double x = std::clamp(at.x + away * nx, 14.0, picture.width - 30);
      picture.text(x, at.y + away * ny + 6, svg::with_unit(axes[static_cast<std::size_t>(axis)], unit), align);
    }
  };
  const bool from_above = to_eye.z >= 0;
  {
    Point3 edge = front;
    edge.z = from_above ? lo.z : hi.z;
    numbers(0, edge);
    numbers(1, edge);
    // Of the two upright edges that are outlines take the left one.
    Point3 a = front, b = front;
    a.x = back.x;
    b.y = back.y;
    numbers(2, dot(a, right) < dot(b, right) ? a : b);
  }

  // What most triangles share stands once, on their group: half of the bytes of a picture.
  const double shared = meshes.empty() ? 1 : meshes.front().opacity;
  const auto look_of = [shared](double opacity, const std::string& fill) {
    const std::string stroke = opacity >= 1 ? fmt::format(" stroke=\"{}\"", fill)
                               : shared < 1 ? ""
                                            : " stroke=\"none\"";
    return stroke + (opacity == shared ? "" : fmt::format(" fill-opacity=\"{:.2g}\"", std::min(opacity, 1.0)));
  };
  std::vector<Piece> pieces;
  for (const Mesh& m : meshes) {
    const auto known = [&](const std::array<int, 3>& t) {
      return std::all_of(t.begin(), t.end(), [&](int v) {
        return v >= 0 && static_cast<std::size_t>(v) < m.points.size() && finite(m.points[static_cast<std::size_t>(v)]);
      });
    };
    std::vector<Point3> normal(m.points.size());
    for (const auto& t : m.triangles) {
      if (!known(t)) continue;
      const Point3 a = m.points[static_cast<std::size_t>(t[0])];
      const Point3 n =
          cross(m.points[static_cast<std::size_t>(t[1])] - a, m.points[static_cast<std::size_t>(t[2])] - a);
      for (const int v : t) normal[static_cast<std::size_t>(v)] = normal[static_cast<std::size_t>(v)] + n;
    }
    for (Point3& n : normal) n = unit_of(n);
    const bool hides_its_back = m.opacity >= 1 && is_closed(m);
    for (const auto& t : m.triangles) {
      if (!known(t)) continue;
      std::array<Point3, 3> p;
      Point3 n{};
      for (std::size_t k = 0; k < 3; ++k) {
        p[k] = m.points[static_cast<std::size_t>(t[k])];
        n = n + normal[static_cast<std::size_t>(t[k])];
      }
      const Point3 flat = cross(p[1] - p[0], p[2] - p[0]);
      const bool behind = dot(flat, to_eye) < 0;
      if (behind && hides_its_back) continue;
      n = unit_of(unit_of(n) + 0.25 * unit_of(flat));
      const double shine = std::max(0.0, (behind ? -1 : 1) * dot(n, light));
      const double lightness = std::round(40 * ((behind ? 0.30 : 0.42) + (behind ? 0.3 : 0.44) * shine)) / 40;
      const auto kind_of = [&](std::size_t k) {
        return m.kind.size() == m.points.size() ? m.kind[static_cast<std::size_t>(t[k % 3])] : 0;
      };
      // The outline closes the gaps between neighbours.
      const auto draw = [&](const std::vector<Point3>& outline, int kind) {
        const std::string fill = colour_of(kind, lightness);
        std::vector<Point> corners;
        for (const Point3& corner_at : outline) corners.push_back(project(corner_at));
        const std::string d = svg::outline(corners);
        if (d.empty()) return;  // less than a tenth of a pixel wide
        pieces.push_back({dot(p[0] + p[1] + p[2], to_eye) / 3,
                          fmt::format("<path d=\"{}\" fill=\"{}\"{}/>\n", d, fill, look_of(m.opacity, fill))});
      };
      if (!levels.empty() && m.value.size() == m.points.size()) {
        std::vector<Valued> rest;
        for (std::size_t k = 0; k < 3; ++k) rest.push_back({p[k], m.value[static_cast<std::size_t>(t[k])]});
        const auto draw_band = [&](const std::vector<Valued>& band, int number) {
          std::vector<Point3> outline;
          for (const Valued& v : band) outline.push_back(v.at);
          if (outline.size() > 2) draw(outline, number);
        };
        for (std::size_t k = 0; k < levels.size(); ++k) {
          auto [below, above] = cut(rest, levels[k]);
          draw_band(below, static_cast<int>(k));
          rest = std::move(above);
        }
        draw_band(rest, static_cast<int>(levels.size()));
        continue;
      }
      // A triangle of two kinds is cut through the middles of its sides, so that the kinds meet along a smooth line.
      std::size_t alone = 3;
      for (std::size_t k = 0; k < 3; ++k)
        if (kind_of(k) != kind_of(k + 1) && kind_of(k) != kind_of(k + 2)) alone = k;
      if (alone == 3) {
        draw({p[0], p[1], p[2]}, kind_of(0));
      } else {
        const Point3 &a = p[alone], &b = p[(alone + 1) % 3], &c = p[(alone + 2) % 3];
        const Point3 ab = 0.5 * (a + b), ac = 0.5 * (a + c);
        draw({a, ab, ac}, kind_of(alone));
        draw({ab, b, c, ac}, kind_of(alone + 1));
      }
    }
  }
  for (const Line3& l : lines) {
    const std::vector<Point3> points = shown_points(*this, l);
    for (std::size_t k = 0; k < points.size(); ++k) {
      if (!finite(points[k])) continue;
      if (l.dots) {
        const Point p = project(points[k]);
        pieces.push_back(
            {dot(points[k], to_eye) + 1e-6 * longest,
             fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\" class=\"{} f\" stroke=\"none\"{}/>\n", px(p.x), px(p.y),
                         px(l.stroke), svg::class_of(l.colour), shared < 1 ? " fill-opacity=\"1\"" : "")});
        continue;
      }
      if (k + 1 == points.size() || !finite(points[k + 1])) continue;
      // Short pieces, so that each is before or behind a triangle as a whole.
      const Point3 way = points[k + 1] - points[k];
      const int count = static_cast<int>(std::clamp(60 * std::sqrt(dot(way, way)) / longest, 1.0, 200.0));
      for (int i = 0; i < count; ++i) {
        const Point3 a = points[k] + (double(i) / count) * way, b = points[k] + (double(i + 1) / count) * way;
        const Point p = project(a), q = project(b);
        pieces.push_back({0.5 * dot(a + b, to_eye),
                          fmt::format("<path d=\"M{} {}L{} {}\" class=\"{} l\" style=\"stroke-width:{}\"/>\n", px(p.x),
                                      px(p.y), px(q.x), px(q.y), svg::class_of(l.colour), px(l.stroke))});
      }
    }
  }
  std::stable_sort(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) { return a.depth < b.depth; });
  picture.body += fmt::format("<g stroke-width=\"0.7\" stroke-linejoin=\"round\"{}>\n",
                              shared < 1 ? fmt::format(" stroke=\"none\" fill-opacity=\"{:.2g}\"", shared) : "");
  for (const Piece& piece : pieces) picture.body += piece.svg;
  picture.body += "</g>\n";
  return picture.finish(height);
}

}  // namespace polypod::report
