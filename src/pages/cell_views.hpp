// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The sides from which a cell is drawn.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "polypod/cell/layout.hpp"
#include "polypod/core/units.hpp"
#include "polypod/geometry/hull.hpp"
#include "polypod/geometry/pose.hpp"
#include "polypod/report/plot.hpp"

namespace polypod::pages {

/// A direction from which the cell is seen: what of C goes to the right, up, and towards the eye.
struct View {
  const char* name;
  const char *right_label, *up_label;
  Vec3 right, up, eye;
};

inline const std::array<View, 4>& plane_views() {
  static const std::array<View, 4> kViews{{{"front", "x", "z", {1, 0, 0}, {0, 0, 1}, {0, -1, 0}},
                                           {"top", "x", "y", {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                                           {"left", "−y", "z", {0, -1, 0}, {0, 0, 1}, {-1, 0, 0}},
                                           {"right", "y", "z", {0, 1, 0}, {0, 0, 1}, {1, 0, 0}}}};
  return kViews;
}
inline View isometric() {
  // The eye stands to the front, to the left and above.
  const Vec3 eye = Vec3(-1, -1.4, 0.9).normalized(), right = Vec3(0, 0, 1).cross(eye).normalized();
  return {"isometric", "", "", right, eye.cross(right), eye};
}

/// mm, in the plane of the view.
inline report::Point seen(const View& v, const Vec3& p) {
  return {units::to_mm(v.right.dot(p)), units::to_mm(v.up.dot(p))};
}

/// The outline of a convex body: the hull of its corners, mm.
inline std::vector<report::Point> hull(const std::vector<report::Point>& points) {
  constexpr double kStraight = 1e-9;  // mm2
  std::vector<Eigen::Vector2d> corners;
  for (const report::Point& p : points) corners.emplace_back(p.x, p.y);
  std::vector<report::Point> out;
  for (const Eigen::Vector2d& p : convex_hull(std::move(corners), kStraight)) out.push_back({p.x(), p.y()});
  return out;
}

/// A cylinder as it is seen: the hull of its two rims.
inline std::vector<report::Point> cylinder(const View& view, const Vec3& from, const Vec3& to, double radius) {
  constexpr int kCorners = 24;
  const Vec3 axis = (to - from).normalized();
  const Vec3 u = axis.unitOrthogonal(), v = axis.cross(u);
  std::vector<report::Point> points;
  for (int k = 0; k < kCorners; ++k) {
    const double angle = 2 * std::numbers::pi * k / kCorners;
    const Vec3 rim = radius * (std::cos(angle) * u + std::sin(angle) * v);
    points.push_back(seen(view, from + rim));
    points.push_back(seen(view, to + rim));
  }
  return hull(points);
}
/// An upright one.
inline std::vector<report::Point> upright(const View& view, const Vec3& bottom, double diameter, double height) {
  return cylinder(view, bottom, bottom + Vec3(0, 0, height), diameter / 2);
}

/// What stands in a cell, for the table of coordinates beside its views (ISO 129-1): numbered as in the view from the
/// top.
struct Standing {
  std::string name, kind;
  Vec3 at = Vec3::Zero();    ///< m in C: the middle of a body, where the base of a machine is, the foot of a guard
  Vec3 size = Vec3::Zero();  ///< m; 0: none is given
  double turn = 0;           ///< rad about z
};
inline std::vector<Standing> all_standing(const cell::Cell& cell) {
  std::vector<Standing> out;
  for (const cell::Machine& m : cell.machines)
    out.push_back({m.name, "machine", m.X_CM.p, Vec3::Zero(), std::atan2(m.X_CM.R(1, 0), m.X_CM.R(0, 0))});
  for (const cell::Solid& s : cell::solids(cell)) out.push_back({s.name, s.kind, s.middle, s.size, s.turn});
  for (const cell::Guard& g : cell.guards) {
    const Vec3 along = g.to - g.from;
    out.push_back({g.name, std::string(name_of(g.kind)), (g.from + g.to) / 2, Vec3(along.norm(), 0, g.height),
                   std::atan2(along.y(), along.x())});
  }
  return out;
}
/// Number, name, kind, then x, y, z, length, width and height in mm and the turn in deg, as texts; the first row is the
/// head.
std::vector<std::vector<std::string>> coordinate_table(const cell::Cell& cell);

}  // namespace polypod::pages
