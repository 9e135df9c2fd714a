// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Colour maps and filled contours.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <utility>

#include "packed.hpp"
#include "polypod/core/units.hpp"
#include "polypod/report/plot.hpp"
#include "svg.hpp"

namespace polypod::report {
namespace {

using svg::Picture;
using svg::px;
using svg::Scale;

/// Linear sRGB of a colour of OKLab (B. Ottosson, 2020), a space in which equal steps look equal.
std::array<double, 3> linear_rgb(double L, double a, double b) {
  const auto cube = [](double v) { return v * v * v; };
  const double l = cube(L + 0.3963377774 * a + 0.2158037573 * b);
  const double m = cube(L - 0.1055613458 * a - 0.0638541728 * b);
  const double s = cube(L - 0.0894841775 * a - 1.2914855480 * b);
  return {4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
          -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
          -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s};
}

bool on_screen(const std::array<double, 3>& rgb) {
  return std::all_of(rgb.begin(), rgb.end(), [](double v) { return v >= 0 && v <= 1; });
}

/// `#rrggbb` of lightness, chroma and hue (deg); the chroma is lowered as far as a screen needs.
std::string hex_of(double L, double chroma, double hue_deg) {
  const double hue = units::from_deg(hue_deg);
  const auto at = [&](double c) { return linear_rgb(L, c * std::cos(hue), c * std::sin(hue)); };
  if (!on_screen(at(chroma))) {
    double inside = 0, outside = chroma;
    for (int i = 0; i < 20; ++i) {
      const double middle = (inside + outside) / 2;
      (on_screen(at(middle)) ? inside : outside) = middle;
    }
    chroma = inside;
  }
  std::string out = "#";
  for (const double v : at(chroma)) {
    const double clamped = std::clamp(v, 0.0, 1.0);
    const double gamma = clamped <= 0.0031308 ? 12.92 * clamped : 1.055 * std::pow(clamped, 1 / 2.4) - 0.055;
    out += fmt::format("{:02x}", static_cast<int>(std::lround(255 * gamma)));
  }
  return out;
}

/// One cell of the grid: its corners in pixels and their values, in order round it. A cell with one corner of no value
/// is a triangle: its last corner stands twice.
struct Quad {
  std::array<Point, 4> corner;
  std::array<double, 4> value;
  bool triangle = false;
  int kind = -1;
};

struct Rectangle {
  double left, right, top, bottom;  // px
};
/// Rectangles that meet at a whole side as one: first those of a row, then rows of the same width. They cover the same.
std::vector<Rectangle> joined(std::vector<Rectangle> cells) {
  constexpr double kSame = 1e-6;  // px: the corners of neighbours are the same numbers but for rounding
  const auto same = [](double a, double b) { return std::abs(a - b) < kSame; };
  std::sort(cells.begin(), cells.end(), [&](const Rectangle& a, const Rectangle& b) {
    const auto row_a = std::llround(a.top / kSame), row_b = std::llround(b.top / kSame);
    return row_a != row_b ? row_a < row_b : a.left < b.left;
  });
  std::vector<Rectangle> rows;
  for (const Rectangle& c : cells) {
    if (!rows.empty() && same(rows.back().top, c.top) && same(rows.back().bottom, c.bottom) &&
        same(rows.back().right, c.left)) {
      rows.back().right = c.right;
    } else {
      rows.push_back(c);
    }
  }
  std::vector<Rectangle> out;
  std::map<std::pair<std::int64_t, std::int64_t>, std::size_t> above;  // by its sides: the one that ends lowest
  for (const Rectangle& r : rows) {
    const auto sides = std::pair{std::llround(r.left / kSame), std::llround(r.right / kSame)};
    const auto at = above.find(sides);
    if (at != above.end() && same(out[at->second].bottom, r.top)) {
      out[at->second].bottom = r.bottom;
    } else {
      above[sides] = out.size();
      out.push_back(r);
    }
  }
  return out;
}

/// The part of the cell where the value, linear along each side, is at least `level`; `cut` receives the sides of that
/// part that run through the cell (pieces of the contour line).
std::vector<Point> at_least(const Quad& quad, double level, std::vector<std::pair<Point, Point>>* cut) {
  std::vector<Point> part;
  std::vector<char> crossing;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t j = (i + 1) % 4;
    const double a = quad.value[i], b = quad.value[j];
    if (a >= level) {
      part.push_back(quad.corner[i]);
      crossing.push_back(0);
    }
    if ((a >= level) != (b >= level)) {
      const double t = (level - a) / (b - a);
      part.push_back({quad.corner[i].x + t * (quad.corner[j].x - quad.corner[i].x),
                      quad.corner[i].y + t * (quad.corner[j].y - quad.corner[i].y)});
      crossing.push_back(a >= level ? 1 : 2);  // 1: the contour leaves the side here, 2: it comes back
    }
  }
  if (cut != nullptr) {
    for (std::size_t i = 0; i < part.size(); ++i) {
      const std::size_t j = (i + 1) % part.size();
      if (crossing[i] == 1 && crossing[j] == 2) cut->emplace_back(part[i], part[j]);
    }
  }
  return part;
}

/// Opens a group that is drawn only inside the outlines.
std::string open_clip(const std::string& id, const std::vector<std::vector<Point>>& outlines) {
  std::string d;
  for (const std::vector<Point>& outline : outlines) d += svg::path(outline, true);
  return fmt::format(
      "<clipPath id=\"{0}-area\"><path d=\"{1}\" clip-rule=\"evenodd\"/></clipPath>\n<g "
      "clip-path=\"url(#{0}-area)\">\n",
      id, d);
}

/// By the even-odd rule.
bool encloses(const std::vector<std::vector<Point>>& outlines, const Point& p) {
  bool inside = false;
  for (const std::vector<Point>& outline : outlines) {
    for (std::size_t i = 0; i < outline.size(); ++i) {
      const Point &a = outline[i], &b = outline[(i + 1) % outline.size()];
      if ((a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)) inside = !inside;
    }
  }
  return inside;
}

std::string label_of(double level, int decimals) {
  return std::abs(level) >= 1e6 || (level != 0 && std::abs(level) < 1e-3) ? number(level, 3) : fixed(level, decimals);
}

}  // namespace

std::string colour_at(ColourMap map, double t) {
  t = std::isfinite(t) ? std::clamp(t, 0.0, 1.0) : 0;
  if (map == ColourMap::sequential) return hex_of(0.30 + 0.62 * t, 0.15, 295 - 195 * t);
  const double side = 2 * t - 1;
  return hex_of(0.95 - 0.45 * std::abs(side), 0.16 * std::abs(side), side < 0 ? 250 : 40);
}

std::string kind_colour(int kind, double lightness) {
  // Neighbours in this order are far apart in hue; the chroma is what a screen has at middle lightness.
  constexpr std::array<double, kKindColours> kHues{250, 62, 158, 345, 108, 205, 25, 300};
  const double L = std::clamp(lightness, 0.0, 1.0);
  if (kind < 0) return hex_of(L, 0, 0);
  return hex_of(L, 0.135, kHues[static_cast<std::size_t>(kind) % kHues.size()]);
}

namespace {

/// Cuts the quads whose corners are of several kinds into small ones of one kind each: the kind that weighs most there.
/// Corners that `counts` rejects have no say.
template <class Counts>
std::vector<Quad> by_kind(const std::vector<Quad>& quads, const std::vector<std::array<int, 4>>& kinds,
                          const Counts& counts) {
  constexpr int kPieces = 5;
  std::vector<Quad> out;
  for (std::size_t q = 0; q < quads.size(); ++q) {
    const Quad& quad = quads[q];
    int first = -2;
    bool mixed = false;
    for (std::size_t c = 0; c < 4; ++c) {
      if (!counts(quad.value[c])) continue;
      if (first == -2) first = kinds[q][c];
      mixed = mixed || kinds[q][c] != first;
    }
    if (!mixed) {
      out.push_back(quad);
      out.back().kind = first;
      continue;
    }
    const auto weights = [](double s, double t) {
      return std::array<double, 4>{(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t};
    };
    const auto at = [&](double s, double t, Point& corner, double& value) {
      const std::array<double, 4> w = weights(s, t);
      corner = {};
      value = 0;
      for (std::size_t c = 0; c < 4; ++c) {
        corner.x += w[c] * quad.corner[c].x;
        corner.y += w[c] * quad.corner[c].y;
        value += w[c] * quad.value[c];
      }
    };
    for (int j = 0; j < kPieces; ++j) {
      for (int i = 0; i < kPieces; ++i) {
        const double s0 = double(i) / kPieces, s1 = double(i + 1) / kPieces;
        const double t0 = double(j) / kPieces, t1 = double(j + 1) / kPieces;
        Quad piece;
        piece.triangle = quad.triangle;
        at(s0, t0, piece.corner[0], piece.value[0]);
        at(s1, t0, piece.corner[1], piece.value[1]);
        at(s1, t1, piece.corner[2], piece.value[2]);
        at(s0, t1, piece.corner[3], piece.value[3]);
        const std::array<double, 4> w = weights((s0 + s1) / 2, (t0 + t1) / 2);
        double most = -1;
        for (std::size_t c = 0; c < 4; ++c) {
          double sum = 0;
          for (std::size_t d = 0; d < 4; ++d) {
            if (counts(quad.value[d]) && kinds[q][d] == kinds[q][c]) sum += w[d];
          }
          if (counts(quad.value[c]) && sum > most) {
            most = sum;
            piece.kind = kinds[q][c];
          }
        }
        out.push_back(piece);
      }
    }
  }
  return out;
}

}  // namespace

std::string HeatMap::operator()(const Canvas& canvas) const {
  Picture picture(canvas, title);
  const auto value_at = [&](int i, int j) {
    const std::size_t index =
        static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(i);
    return index < values.size() ? values[index] : std::numeric_limits<double>::quiet_NaN();
  };
  double lo = std::numeric_limits<double>::infinity(), hi = -lo;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const double v = value_at(i, j);
      if (!std::isfinite(v)) continue;
      lo = std::min(lo, v);
      hi = std::max(hi, v);
    }
  }
  if (min && std::isfinite(*min)) lo = *min;
  if (max && std::isfinite(*max)) hi = *max;
  svg::widen(lo, hi);
  if (map == ColourMap::diverging) {
    hi = std::max(std::abs(lo), std::abs(hi));
    lo = -hi;
  }
  const std::vector<double> edges = svg::ticks_in(lo, hi, std::clamp(levels, 2, 40));
  const int decimals = svg::decimals_of(edges);
  const bool with_kinds = !kind.empty();
  const auto colour = [&](double v, int of) {
    const double t = (v - lo) / (hi - lo);
    return with_kinds ? kind_colour(of, 0.94 - 0.48 * std::clamp(t, 0.0, 1.0)) : colour_at(map, t);
  };
  const auto shown = [&](double v) { return !blank_below || v >= lo; };

  double x0 = x.min.value_or(0), x1 = x.max.value_or(std::max(1, columns - 1));
  double y0 = y.min.value_or(0), y1 = y.max.value_or(std::max(1, rows - 1));
  if (!(x0 < x1)) svg::widen(x0, x1);
  if (!(y0 < y1)) svg::widen(y0, y1);

  double widest_label = 30;  // so that maps side by side have one size
  for (const double e : edges) {
    widest_label = std::max(widest_label, svg::text_width(label_of(e, decimals), svg::kSmallFont));
  }
  double widest_tick = 0;
  const std::vector<double> y_ticks = svg::ticks_in(y0, y1, 5);
  for (const double t : y_ticks) {
    widest_tick = std::max(widest_tick, svg::text_width(fixed(t, svg::decimals_of(y_ticks)), svg::kSmallFont));
  }
  const double left = std::clamp(widest_tick, 16.0, 90.0) + 12;
  const double bar_width = 14, bar_gap = 14;
  double top = 30;
  if (with_kinds) {
    std::vector<char> occurs(kinds.size(), 0);
    for (std::size_t i = 0; i < std::min(kind.size(), values.size()); ++i) {
      if (kind[i] >= 0 && static_cast<std::size_t>(kind[i]) < kinds.size() && std::isfinite(values[i]) &&
          shown(values[i])) {
        occurs[static_cast<std::size_t>(kind[i])] = 1;
      }
    }
    std::vector<svg::LegendEntry> entries;
    for (std::size_t k = 0; k < kinds.size(); ++k) {
      if (occurs[k] == 0) continue;
      svg::LegendEntry entry;
      entry.name = kinds[k];
      entry.area = true;
      entry.fill = kind_colour(static_cast<int>(k), 0.66);
      entries.push_back(std::move(entry));
    }
    top += picture.legend(entries, 2, 2);
  }
  const double room_x = std::max(60.0, picture.width - left - bar_gap - bar_width - widest_label - 14);
  double plot_width = room_x, plot_height = room_x * 0.7;
  if (equal_scales) {
    plot_height = plot_width * (y1 - y0) / (x1 - x0);
    const double most = std::max(80.0, 0.85 * picture.width);
    if (plot_height > most) {
      plot_width *= most / plot_height;
      plot_height = most;
    }
    plot_height = std::max(plot_height, 40.0);
  }
  const double right = left + plot_width, bottom = top + plot_height;
  const Scale X{x0, x1, left, right}, Y{y0, y1, y.downwards ? top : bottom, y.downwards ? bottom : top};
  picture.text(2, top - 16, svg::with_unit(y.label, y.unit), "q");
  const std::string value_label = svg::with_unit(label, unit);
  picture.text(right + bar_gap + bar_width + widest_label + 7, top - 16, value_label, "q e");

  // Painter's algorithm: the lowest band under everything, then the part above each level over it.
  std::vector<Quad> quads;
  std::vector<std::array<int, 4>> quad_kinds;
  const auto kind_at = [&](int i, int j) {
    const std::size_t index =
        static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(i);
    return index < kind.size() ? kind[index] : -1;
  };
  for (int j = 0; j + 1 < rows; ++j) {
    for (int i = 0; i + 1 < columns; ++i) {
      const double dx = (x1 - x0) / (columns - 1), dy = (y1 - y0) / (rows - 1);
      const double a = X(x0 + i * dx), b = X(x0 + (i + 1) * dx), c = Y(y0 + j * dy), d = Y(y0 + (j + 1) * dy);
      Quad quad{{{{a, c}, {b, c}, {b, d}, {a, d}}},
                {value_at(i, j), value_at(i + 1, j), value_at(i + 1, j + 1), value_at(i, j + 1)}};
      std::array of_corner{kind_at(i, j), kind_at(i + 1, j), kind_at(i + 1, j + 1), kind_at(i, j + 1)};
      const auto missing =
          std::count_if(quad.value.begin(), quad.value.end(), [](double v) { return !std::isfinite(v); });
      if (missing > 1) continue;
      if (missing == 1) {
        const auto at = std::find_if(quad.value.begin(), quad.value.end(), [](double v) { return !std::isfinite(v); }) -
                        quad.value.begin();
        std::rotate(quad.value.begin(), quad.value.begin() + at + 1, quad.value.end());
        std::rotate(quad.corner.begin(), quad.corner.begin() + at + 1, quad.corner.end());
        std::rotate(of_corner.begin(), of_corner.begin() + at + 1, of_corner.end());
        quad.value[3] = quad.value[2];
        quad.corner[3] = quad.corner[2];
        of_corner[3] = of_corner[2];
        quad.triangle = true;
      }
      quads.push_back(quad);
      quad_kinds.push_back(of_corner);
    }
  }
  const std::vector<Quad> tiles = with_kinds ? by_kind(quads, quad_kinds, shown) : quads;
  const auto fill = [&](double level, double mid, int of) {
    std::string d;
    std::vector<Rectangle> whole;
    for (const Quad& tile : tiles) {
      if (tile.kind != of) continue;
      if (!tile.triangle && std::all_of(tile.value.begin(), tile.value.end(), [&](double v) { return v >= level; })) {
        const auto [left_x, right_x] = std::minmax(tile.corner[0].x, tile.corner[1].x);
        const auto [top_y, bottom_y] = std::minmax(tile.corner[0].y, tile.corner[2].y);
        whole.push_back({left_x, right_x, top_y, bottom_y});
        continue;
      }
      const std::vector<Point> part = at_least(tile, level, nullptr);
      d += svg::outline(part);
    }
    for (const Rectangle& r : joined(std::move(whole))) {
      d += fmt::format("M{} {}H{}V{}H{}z", px(r.left), px(r.top), px(r.right), px(r.bottom), px(r.left));
    }
    if (!d.empty()) picture.body += fmt::format("<path d=\"{}\" fill=\"{}\"/>\n", d, colour(mid, of));
  };
  std::vector<std::vector<Point>> outlines;  // in pixels
  for (const std::vector<Point>& line : clip) {
    std::vector<Point>& outline = outlines.emplace_back();
    for (const Point& p : line) outline.push_back({X(p.x), Y(p.y)});
  }
  if (!outlines.empty()) picture.body += open_clip(picture.id(), outlines);
  std::vector<int> of_tiles;
  for (const Quad& tile : tiles) {
    if (std::find(of_tiles.begin(), of_tiles.end(), tile.kind) == of_tiles.end()) of_tiles.push_back(tile.kind);
  }
  std::erase(of_tiles, -2);  // tiles on which nothing counts
  struct BandOf {
    double from, to;
  };
  std::vector<BandOf> bands;
  double from = lo;
  for (const double e : edges) {
    if (e > from) bands.push_back({from, e});
    from = e;
  }
  if (hi > from) bands.push_back({from, hi});
  for (std::size_t k = 0; k < bands.size(); ++k) {
    const double level = k == 0 && !blank_below ? -std::numeric_limits<double>::infinity() : bands[k].from;
    for (const int of : of_tiles) fill(level, (bands[k].from + bands[k].to) / 2, of);
  }

  // Contour lines and their numbers: each number where it is farthest from those before it.
  std::string contours, pen;  // pen: where the last piece ended
  std::vector<Point> placed;
  struct LabelAt {
    Point at;
    double level;
  };
  std::vector<LabelAt> labels;
  for (const double level : edges) {
    std::vector<std::pair<Point, Point>> cut;
    for (const Quad& quad : quads) at_least(quad, level, &cut);
    double best = 40;  // px: closer together they would be in each other's way
    Point best_at{};
    bool found = false;
    for (const auto& [a, b] : cut) {
      const std::string start = fmt::format("{} {}", px(a.x), px(a.y)), end = fmt::format("{} {}", px(b.x), px(b.y));
      contours += (start == pen ? "" : "M" + start) + "L" + end;
      pen = end;
      const Point middle{(a.x + b.x) / 2, (a.y + b.y) / 2};
      if (!outlines.empty() && !encloses(outlines, middle)) continue;
      double distance = std::min({middle.x - left, right - middle.x}) * 2;
      distance = std::min(distance, std::min(middle.y - top, bottom - middle.y) * 4);
      for (const Point& p : placed) distance = std::min(distance, std::hypot(p.x - middle.x, 2 * (p.y - middle.y)));
      if (distance > best) {
        best = distance;
        best_at = middle;
        found = true;
      }
    }
    if (found) {
      placed.push_back(best_at);
      labels.push_back({best_at, level});
    }
  }
  if (!contours.empty()) picture.body += fmt::format("<path d=\"{}\" class=\"contour\"/>\n", contours);
  if (!outlines.empty()) picture.body += "</g>\n";
  picture.body += fmt::format("<g clip-path=\"{}\">\n", picture.clip("box", left, top, plot_width, plot_height));
  for (const Polyline& l : lines) {
    std::vector<Point> points;
    points.reserve(l.points.size());
    for (const Point& p : l.points) points.push_back({X(p.x), Y(p.y)});
    picture.body +=
        fmt::format("<path d=\"{}\" class=\"{} l{}\" style=\"stroke-width:{}\" data-name=\"{}\"/>\n", svg::path(points),
                    svg::class_of(l.colour), svg::class_of(l.style), px(l.stroke), escape(l.name));
  }
  picture.body += "</g>\n";
  if (contour_labels) {
    for (const LabelAt& l : labels) {
      picture.text(l.at.x, l.at.y + 4, label_of(l.level, decimals), "on", svg::kSmallFont);
    }
  }
  const double radius = std::clamp(picture.width / 80, 3.3, 4.2);
  for (const Dot& dot : dots) {
    const std::string told = std::isfinite(dot.value) ? number(dot.value, 5) + " " + unit : "no value";
    const std::string place =
        fmt::format("<circle cx=\"{}\" cy=\"{}\" data-tip=\"at {}, {} {}: {}\"", px(X(dot.at.x)), px(Y(dot.at.y)),
                    number(dot.at.x, 5), number(dot.at.y, 5), escape(x.unit), escape(told));
    const auto band = std::find_if(bands.begin(), bands.end(), [&](const BandOf& b) { return dot.value <= b.to; });
    if (!std::isfinite(dot.value) || bands.empty()) {
      picture.body += place + " r=\"2\" fill=\"#fff\" stroke=\"#000\" stroke-width=\".8\"/>\n";
      continue;
    }
    const BandOf& in = band == bands.end() ? bands.back() : *band;
    // A light ring and a dark one: seen on every colour of the map.
    picture.body += place + fmt::format(" r=\"{}\" fill=\"{}\" stroke=\"#fff\" stroke-width=\".9\"/>\n", px(radius),
                                        colour((in.from + in.to) / 2, -1));
    picture.body +=
        place + fmt::format(" r=\"{}\" fill=\"none\" stroke=\"#000\" stroke-width=\".6\"/>\n", px(radius + 0.7));
  }
  for (const Marker& m : markers) {
    picture.body += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"3.5\" class=\"{} f\"/>\n", px(X(m.at.x)),
                                px(Y(m.at.y)), svg::class_of(m.colour));
    picture.text(X(m.at.x) + 7, Y(m.at.y) - 6, m.label, "t h");
  }

  picture.x_axis(X, top, bottom, svg::with_unit(x.label, x.unit), false);
  picture.y_axis(Y, left, right, false);
  picture.body += fmt::format("<path d=\"M{} {}H{}V{}H{}Z\" fill=\"none\" class=\"axis\"/>\n", px(left), px(top),
                              px(right), px(bottom), px(left));

  // Kinds without a value, as what stops a motion, have their colours in the legend alone.
  if (!with_kinds || !label.empty()) {
    const Scale V{lo, hi, bottom, top};
    const double bar = right + bar_gap;
    for (const BandOf& band : bands) {
      picture.body +=
          fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\"/>\n", px(bar), px(V(band.to)),
                      px(bar_width), px(V(band.from) - V(band.to)), colour((band.from + band.to) / 2, -1));
    }
    double last_y = std::numeric_limits<double>::infinity();
    for (const double e : edges) {
      const double at = V(e);
      picture.line(bar, at, bar + bar_width + 3, at, "axis");
      if (last_y - at < 13) continue;
      picture.text(bar + bar_width + 6, at + 4, label_of(e, decimals), "n", svg::kSmallFont);
      last_y = at;
    }
  }
  const bool has_label = !(x.label.empty() && x.unit.empty());
  const auto is_drawn = [&](int i, int j) {
    const double v = value_at(i, j);
    if (!std::isfinite(v) || !shown(v)) return false;
    const double dx = (x1 - x0) / std::max(1, columns - 1), dy = (y1 - y0) / std::max(1, rows - 1);
    return outlines.empty() || encloses(outlines, {X(x0 + i * dx), Y(y0 + j * dy)});
  };
  std::string data;
  constexpr int kMostRead = 40000;  // values; what has more is read off its colours
  if (!canvas.again && columns > 0 && rows > 0 && columns <= kMostRead / rows) {
    Packed read, of;
    for (int j = 0; j < rows; ++j) {
      for (int i = 0; i < columns; ++i) {
        const bool drawn = is_drawn(i, j);
        read.add(static_cast<float>(drawn ? value_at(i, j) : std::numeric_limits<double>::quiet_NaN()));
        if (with_kinds) of.add(static_cast<std::uint8_t>(drawn && kind_at(i, j) >= 0 ? kind_at(i, j) : 255));
      }
    }
    data = fmt::format(" data-grid=\"{} {} {} {} {} {}\" data-value=\"{}\" data-f=\"{}\"", columns, rows, x0, x1, y0,
                       y1, escape(label), read.text());
    if (with_kinds) {
      std::string names;
      for (std::size_t k = 0; k < kinds.size(); ++k) {  // those that occur, at their places
        const bool occurs = std::find(kind.begin(), kind.end(), static_cast<int>(k)) != kind.end();
        names += (k == 0 ? "" : ";") + (occurs ? escape(kinds[k]) : std::string());
      }
      data += fmt::format(" data-kinds=\"{}\" data-k=\"{}\"", names, of.text());
    }
  }
  return picture.finish(
      bottom + (has_label ? 42 : 24),
      svg::scales_of("map", X, Y, svg::with_unit(x.label, x.unit), svg::with_unit(y.label, y.unit), unit) + data);
}

}  // namespace polypod::report
