// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The views of a cell as a DXF drawing. The format is that of AutoCAD release 12 (AC1009) in ASCII, which every CAD
// program reads: pairs of a group code and a value; here lines, polylines, circles and texts on layers, 1 unit = 1 mm.
#include <fmt/format.h>

#include <cmath>
#include <map>
#include <set>

#include "cell_views.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/cell.hpp"

namespace polypod::pages {
namespace {

using report::Point;
using units::to_mm;

/// Text as release 12 takes it: no control characters, `\U+XXXX` for what is beyond ASCII.
std::string dxf_text(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size();) {
    const auto c = static_cast<unsigned char>(text[i]);
    if (c < 0x80) {
      out += c < 0x20 || c == 0x7f ? ' ' : static_cast<char>(c);
      ++i;
      continue;
    }
    const std::size_t length = c >= 0xf0 ? 4 : c >= 0xe0 ? 3 : 2;
    unsigned code = c & (0xffU >> (length + 1));
    std::size_t k = 1;
    for (; k < length && i + k < text.size() && (static_cast<unsigned char>(text[i + k]) & 0xc0U) == 0x80; ++k)
      code = code << 6U | (static_cast<unsigned char>(text[i + k]) & 0x3fU);
    out += k == length && c >= 0xc2 && code <= 0xffff ? fmt::format("\\U+{:04X}", code) : "?";
    i += k;
  }
  return out;
}

/// A name of a layer: up to 31 capitals, digits, - and _.
std::string layer_of(const std::string& kind) {
  constexpr std::size_t kLongest = 31;
  std::string out;
  for (const char c : kind.substr(0, kLongest)) {
    if (c >= 'a' && c <= 'z')
      out += static_cast<char>(c - 'a' + 'A');
    else
      out += (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ? c : '_';
  }
  return out.empty() ? "OTHER" : out;
}

constexpr const char *kDimensions = "DIMENSIONS", *kMachines = "MACHINES", *kGuards = "GUARDS", *kBelts = "BELTS",
                     *kContainers = "CONTAINERS", *kTexts = "TEXTS";

class Drawing {
 public:
  Point origin;  ///< of what is drawn next

  void line(const std::string& layer, const Point& a, const Point& b) {
    begin("LINE", layer);
    at(10, a);
    at(11, b);
  }
  void polyline(const std::string& layer, const std::vector<Point>& points, bool closed) {
    begin("POLYLINE", layer);
    body_ += fmt::format("66\n1\n70\n{}\n10\n0.0\n20\n0.0\n30\n0.0\n", closed ? 1 : 0);
    for (const Point& p : points) {
      begin("VERTEX", layer);
      at(10, p);
    }
    begin("SEQEND", layer);
  }
  void circle(const std::string& layer, const Point& middle, double radius) {
    begin("CIRCLE", layer);
    at(10, middle);
    body_ += fmt::format("40\n{:.4f}\n", radius);
  }
  /// Centred on the point; `upright` turns it by 90 deg.
  void text(const std::string& layer, const Point& middle, double height, const std::string& what,
            bool upright = false) {
    begin("TEXT", layer);
    at(10, middle);
    body_ += fmt::format("40\n{:.4f}\n1\n{}\n50\n{}\n72\n1\n", height, dxf_text(what), upright ? "90.0" : "0.0");
    at(11, middle);
  }
  /// Extension lines from a and b to the dimension line at the distance `off` below (or, where upright, to the left
  /// of) the first, oblique strokes at its ends (ISO 129-1), and the length as text.
  void dimension(const Point& a, const Point& b, double off, bool upright, const std::string& prefix) {
    const double size = 40;
    Point p = a, q = b;
    if (upright)
      p.x = q.x = a.x - off;
    else
      p.y = q.y = a.y - off;
    line(kDimensions, a, p);
    line(kDimensions, b, q);
    line(kDimensions, p, q);
    for (const Point& end : {p, q})
      line(kDimensions, {end.x - size / 2, end.y - size / 2}, {end.x + size / 2, end.y + size / 2});
    const double length = upright ? std::abs(b.y - a.y) : std::abs(b.x - a.x);
    const Point middle{(p.x + q.x) / 2 - (upright ? size / 2 : 0), (p.y + q.y) / 2 + (upright ? 0 : size / 2)};
    text(kDimensions, middle, 1.5 * size, fmt::format("{}{:.0f}", prefix, length), upright);
  }

  [[nodiscard]] std::string whole() const {
    const std::map<std::string, int> colours{{kDimensions, 8}, {kMachines, 5}, {kGuards, 3},
                                             {kContainers, 1}, {kBelts, 7},    {kTexts, 7}};
    std::string out = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n9\n$LUNITS\n70\n2\n";
    out += fmt::format("9\n$EXTMIN\n10\n{:.4f}\n20\n{:.4f}\n30\n0.0\n9\n$EXTMAX\n10\n{:.4f}\n20\n{:.4f}\n30\n0.0\n",
                       low_.x, low_.y, high_.x, high_.y);
    out +=
        "0\nENDSEC\n0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nLTYPE\n70\n1\n0\nLTYPE\n2\nCONTINUOUS\n70\n0\n3\nSolid "
        "line\n72\n65\n73\n0\n40\n0.0\n0\nENDTAB\n";
    out += fmt::format("0\nTABLE\n2\nLAYER\n70\n{}\n", layers_.size() + 1);
    out += "0\nLAYER\n2\n0\n70\n0\n62\n7\n6\nCONTINUOUS\n";
    for (const std::string& layer : layers_) {
      const auto colour = colours.find(layer);
      out += fmt::format("0\nLAYER\n2\n{}\n70\n0\n62\n{}\n6\nCONTINUOUS\n", layer,
                         colour == colours.end() ? 9 : colour->second);
    }
    out +=
        "0\nENDTAB\n0\nTABLE\n2\nSTYLE\n70\n1\n0\nSTYLE\n2\nSTANDARD\n70\n0\n40\n0.0\n41\n1.0\n50\n0.0\n71\n0\n42\n"
        "60.0\n3\ntxt\n4\n\n0\nENDTAB\n0\nENDSEC\n";
    out += "0\nSECTION\n2\nENTITIES\n" + body_ + "0\nENDSEC\n0\nEOF\n";
    return out;
  }

 private:
  void begin(const char* entity, const std::string& layer) {
    layers_.insert(layer);
    body_ += fmt::format("0\n{}\n8\n{}\n", entity, layer);
  }
  void at(int code, const Point& p) {
    const Point q{origin.x + p.x, origin.y + p.y};
    low_ = {std::min(low_.x, q.x), std::min(low_.y, q.y)};
    high_ = {std::max(high_.x, q.x), std::max(high_.y, q.y)};
    body_ += fmt::format("{}\n{:.4f}\n{}\n{:.4f}\n{}\n0.0\n", code, q.x, code + 10, q.y, code + 20);
  }

  std::set<std::string> layers_;
  std::string body_;
  Point low_{1e20, 1e20}, high_{-1e20, -1e20};
};

/// Solids, guards, machines at home, belts, containers; dimensions and names but in the isometric view.
void draw(Drawing& out, const CellResult& r, const View& view, bool plane) {
  const auto see = [&](const Vec3& p) { return seen(view, p); };
  for (const cell::Solid& s : cell::solids(r.cell)) {
    std::vector<Point> outline;
    for (const Vec3& p : s.corners()) outline.push_back(see(p));
    out.polyline(layer_of(s.kind), hull(outline), true);
  }
  for (const cell::Guard& g : r.cell.guards) {
    const Vec3 a(g.from.x(), g.from.y(), 0), b(g.to.x(), g.to.y(), 0), up(0, 0, g.height);
    std::vector<Point> line;
    for (const Vec3& p : {a, b, Vec3(b + up), Vec3(a + up)}) line.push_back(see(p));
    out.polyline(kGuards, line, true);
  }
  const bool from_above = plane && view.eye.z() > 0.5;
  for (std::size_t m = 0; m < r.cell.machines.size(); ++m) {
    const cell::Machine& machine = r.cell.machines[m];
    const kinematics::ForwardResult f = kinematics::forward(machine.model, r.motions.home[m]);
    if (f.poses.empty()) continue;
    for (const machine::OutlinePart& part : kinematics::outline_at(machine.model, f.poses[0], r.motions.home[m])) {
      if (part.role == machine::OutlinePart::Role::joints || part.points.size() < 2) continue;
      std::vector<Point> line;
      for (const Vec3& p : part.points) line.push_back(see(machine.X_CM * p));
      out.polyline(kMachines, line, false);
    }
    for (const cell::BaseBody& base : cell::bases(machine, r.motions.home[m])) {
      const Vec3 axis = base.to - base.from;
      if (from_above && axis.head<2>().norm() < 1e-9 * axis.norm()) {
        out.circle(kMachines, see(base.from), to_mm(base.radius));
      } else {
        out.polyline(kMachines, cylinder(view, base.from, base.to, base.radius), true);
      }
    }
  }
  constexpr double kArrow = 80, kHeight = 60;  // mm
  for (const cell::Conveyor& c : r.cell.conveyors) {
    const Vec3 from = c.point(0.1 * c.length, 0), to = c.point(0.9 * c.length, 0);
    out.line(kBelts, see(from), see(to));
    for (const double side : {-1.0, 1.0})
      out.line(kBelts, see(c.point(0.9 * c.length - units::from_mm(kArrow), side * units::from_mm(0.4 * kArrow))),
               see(to));
  }
  for (const cell::StandingContainer& c : cell::standing_containers(r.cell)) {
    const cell::Container& kind = r.cell.containers[0];
    if (from_above) {
      out.circle(kContainers, see(c.bottom), to_mm(kind.diameter) / 2);
    } else {
      out.polyline(kContainers, upright(view, c.bottom, kind.diameter, kind.height), true);
    }
  }
  const double radius = r.cell.containers.empty() ? 0 : to_mm(r.cell.containers[0].diameter) / 2;
  for (const cell::Spot& s : r.cell.spots) {  // where one is turned over, none stands
    if (s.kind != cell::Spot::Kind::pour) continue;
    for (const Vec3& p : s.slots) {
      if (from_above) {
        out.circle(kContainers, see(p), radius);
        continue;
      }
      const Point at = see(p);
      out.line(kContainers, {at.x - radius / 2, at.y}, {at.x + radius / 2, at.y});
      out.line(kContainers, {at.x, at.y - radius / 2}, {at.x, at.y + radius / 2});
    }
  }
  if (!plane) return;
  for (const cell::Conveyor& c : r.cell.conveyors) out.text(kTexts, see(c.point(c.length / 2, 0)), kHeight, c.name);
  for (const cell::Machine& m : r.cell.machines) out.text(kTexts, see(m.X_CM.p), kHeight, m.name);
  if (from_above) {
    const std::vector<Standing> all = all_standing(r.cell);
    for (std::size_t k = 0; k < all.size(); ++k) {
      Point at = see(all[k].at);
      at.y -= 1.6 * kHeight;  // below the name
      out.circle(kTexts, at, kHeight);
      out.text(kTexts, {at.x, at.y - kHeight / 2}, kHeight, std::to_string(k + 1));
    }
  }
  const Point low = see(r.layout.low), high = see(r.layout.high);
  const double x0 = std::min(low.x, high.x), x1 = std::max(low.x, high.x), y0 = std::min(low.y, high.y),
               y1 = std::max(low.y, high.y);
  constexpr double kStep = 150;  // mm between dimension lines
  double level = kStep;
  for (const cell::Machine& m : r.cell.machines) {
    const Point at = see(m.X_CM.p);
    out.dimension({x0, y0}, {at.x, y0}, level, false, m.name + " ");
    out.dimension({x0, y0}, {x0, at.y}, level, true, m.name + " ");
    level += kStep;
  }
  out.dimension({x0, y0}, {x1, y0}, level, false, "");
  out.dimension({x0, y0}, {x0, y1}, level, true, "");
}

}  // namespace

std::string cell_dxf(const CellResult& result) {
  Drawing out;
  const Vec3 size = (result.layout.high - result.layout.low) * units::kMmPerMetre;
  // First-angle projection (ISO 5456-2): the view from above below that from the front, that from the left at its
  // right, that from the right at its left.
  const double gap = 1000 + 150 * static_cast<double>(result.cell.machines.size());
  const std::array<Point, 5> middles{{{0, 0},
                                      {0, -(size.z() + size.y()) / 2 - gap},
                                      {(size.x() + size.y()) / 2 + gap, 0},
                                      {-(size.x() + size.y()) / 2 - gap, 0},
                                      {(size.x() + size.y()) / 2 + gap, -(size.z() + size.y()) / 2 - gap}}};
  std::vector<View> views(plane_views().begin(), plane_views().end());
  views.push_back(isometric());
  const Vec3 middle = (result.layout.low + result.layout.high) / 2;
  for (std::size_t k = 0; k < views.size(); ++k) {
    const Point at = seen(views[k], middle);
    out.origin = {middles[k].x - at.x, middles[k].y - at.y};
    draw(out, result, views[k], k < plane_views().size());
    const double half = k == 1 ? size.y() / 2 : k == 4 ? (size.x() + size.y() + size.z()) / 3 : size.z() / 2;
    out.text(kTexts, {at.x, at.y + half + 150}, 90,
             k == 4 ? "isometric" : fmt::format("seen from the {}", views[k].name));
  }
  out.origin = {middles[3].x, middles[4].y};
  out.text(kTexts, {0, 0}, 90, result.cell.name);
  out.text(kTexts, {0, -150}, 60, "dimensions in mm, first-angle projection");
  // The table of coordinates, below all views.
  const std::vector<std::vector<std::string>> table = coordinate_table(result.cell);
  constexpr std::array<double, 10> kAt{0, 700, 1900, 2700, 3050, 3400, 3800, 4150, 4500, 4900};  // mm, of the columns
  constexpr double kRow = 90, kSize = 50;
  out.origin = {middles[3].x, middles[1].y - size.y() / 2 - gap};
  for (std::size_t i = 0; i < table.size(); ++i)
    for (std::size_t k = 0; k < table[i].size(); ++k)
      if (!table[i][k].empty()) out.text(kTexts, {kAt[k], -kRow * static_cast<double>(i)}, kSize, table[i][k]);
  return out.whole();
}

}  // namespace polypod::pages
