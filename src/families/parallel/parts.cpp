// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/parallel/parts.hpp"

#include <fmt/format.h>

#include <array>
#include <limits>

namespace polypod::machine {

std::vector<Element> elements(const Parallel& m) {
  std::vector<Element> out;
  for (const ParallelLeg& leg : m.legs) out.push_back({fmt::format("leg {}", out.size() + 1), leg.compliance, false});
  return out;
}
ElementColumns element_columns(const Parallel& m, const JointVector& q, const Pose* X_MT) {
  const Pose X = X_MT != nullptr ? settled(m, *X_MT).value_or(*X_MT) : forward(m, q);
  return {X, leg_columns(m, X, q)};
}
void set_compliance(Parallel& m, int element, double compliance) {
  m.legs[static_cast<std::size_t>(element)].compliance = compliance;
}

Reach reach(const Parallel& m) {
  Reach box{Vec3::Constant(std::numeric_limits<double>::infinity()),
            Vec3::Constant(-std::numeric_limits<double>::infinity())};
  for (const ParallelLeg& leg : m.legs) {
    const double lever = leg.ring ? (leg.ring->center - m.tool).norm() + leg.ring->radius
                                  : (leg.platform - m.tool).norm() + leg.still.norm();
    const double leg_length = leg.drive == LegDrive::strut ? leg.range.max : leg.rod + leg.arm;
    std::array<Vec3, 2> ends{leg.base, leg.base};
    if (leg.drive == LegDrive::rail) {
      ends = {leg.base + leg.range.min * leg.rail, leg.base + leg.range.max * leg.rail};
    }
    for (const Vec3& end : ends) {
      box.low = box.low.cwiseMin(end - Vec3::Constant(leg_length + lever));
      box.high = box.high.cwiseMax(end + Vec3::Constant(leg_length + lever));
    }
  }
  return box;
}

Vec3 middle_of_work(const Parallel& m) {
  return m.home.p;
}

Outline outline(const Parallel& m, const Vec3&) {
  return called(outline_at(m, m.home, joints_of(m, m.home).value_or(JointVector())), " at home");
}
Outline outline_at(const Parallel& m, const Pose& X_MT, const JointVector& q) {
  using Role = OutlinePart::Role;
  Outline out;
  OutlinePart joints{Role::joints, "", {}}, platform{Role::platform, "platform", {}, true, true};
  Vec3 middle = Vec3::Zero();
  Eigen::Index drive = 0;
  for (const ParallelLeg& leg : m.legs) {
    const double reading = leg.driven() && q.size() > 0 ? q[drive++] : 0.0;
    const Vec3 anchor = leg_anchor(leg, reading), end = leg_end(m, leg, X_MT);
    if (leg.drive == LegDrive::rail) {
      out.push_back({Role::fixed, "rails", {leg_anchor(leg, leg.range.min), leg_anchor(leg, leg.range.max)}});
    }
    if (leg.drive == LegDrive::crank) out.push_back({Role::moving, "arms", {leg.base, anchor}});
    out.push_back({Role::moving, "legs", {anchor, end}, leg.driven()});
    joints.points.push_back(anchor);
    joints.points.push_back(end);
    platform.points.push_back(end);
    middle += end / static_cast<double>(m.legs.size());
  }
  platform.points.push_back(platform.points.front());
  out.push_back(std::move(platform));
  out.push_back({Role::tool, "tool", {middle, X_MT.p}});
  out.push_back(std::move(joints));
  return out;
}

}  // namespace polypod::machine
