// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/parts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace polypod::machine {
namespace {

using Role = OutlinePart::Role;

template <class M>
std::vector<Element> legs_of(const M& m) {
  std::vector<Element> out;
  for (int i = 0; i < kLegs; ++i) {
    out.push_back({fmt::format("leg {}", i + 1), m.leg_compliance[static_cast<std::size_t>(i)], false});
  }
  return out;
}

template <class M>
ElementColumns columns_of_legs(const M& m, const JointVector& q, const Pose* X_MT) {
  const Pose X = X_MT != nullptr ? *X_MT : forward(m, q);
  return {X, jacobian(m, X, q)};
}

template <class M>
void set_leg_compliance(M& m, int leg, double compliance) {
  m.leg_compliance[static_cast<std::size_t>(leg)] = compliance;
  m.compliance = 0;
  for (const double each : m.leg_compliance) m.compliance += each / kLegs;
}

Reach reach_of(const SixPoints& feet, const SixPoints& platform, double tool, double leg) {
  double lever = 0;
  Reach box{feet[0], feet[0]};
  for (int i = 0; i < kLegs; ++i) {
    lever = std::max(lever, platform[i].norm() + std::abs(tool));
    box.low = box.low.cwiseMin(feet[i]);
    box.high = box.high.cwiseMax(feet[i]);
  }
  return {box.low - Vec3::Constant(leg + lever), box.high + Vec3::Constant(leg + lever)};
}

/// The six points in the order of their angle round their middle, closed.
OutlinePart ring(const SixPoints& points, Role role, const char* name, bool thick) {
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : points) middle += p / kLegs;
  std::array<std::size_t, kLegs> order{};
  std::iota(order.begin(), order.end(), 0U);
  const auto angle = [&](std::size_t i) { return std::atan2(points[i].y() - middle.y(), points[i].x() - middle.x()); };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return angle(a) < angle(b); });
  OutlinePart part{role, name, {}, thick, true};
  for (const std::size_t i : order) part.points.push_back(points[i]);
  part.points.push_back(part.points.front());
  return part;
}

template <class M>
SixPoints platform_at(const M& m, const Pose& X) {
  SixPoints out;
  for (int i = 0; i < kLegs; ++i) out[i] = X * (m.platform_joint[i] - Vec3(0, 0, m.tool_length));
  return out;
}

void add_legs(Outline& out, const SixPoints& anchor, const SixPoints& platform, const Pose& X_MT) {
  out.push_back(ring(platform, Role::platform, "platform", true));
  OutlinePart joints{Role::joints, "", {}};
  for (int i = 0; i < kLegs; ++i) {
    out.push_back({Role::moving, "legs", {anchor[i], platform[i]}});
    joints.points.push_back(anchor[i]);
    joints.points.push_back(platform[i]);
  }
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : platform) middle += p / kLegs;
  out.push_back({Role::tool, "tool", {middle, X_MT.p}});
  out.push_back(std::move(joints));
}

}  // namespace

std::vector<Element> elements(const StrutHexapod& m) {
  return legs_of(m);
}
std::vector<Element> elements(const SliderHexapod& m) {
  return legs_of(m);
}
ElementColumns element_columns(const StrutHexapod& m, const JointVector& q, const Pose* X_MT) {
  return columns_of_legs(m, q, X_MT);
}
ElementColumns element_columns(const SliderHexapod& m, const JointVector& q, const Pose* X_MT) {
  return columns_of_legs(m, q, X_MT);
}
void set_compliance(StrutHexapod& m, int element, double compliance) {
  set_leg_compliance(m, element, compliance);
}
void set_compliance(SliderHexapod& m, int element, double compliance) {
  set_leg_compliance(m, element, compliance);
}

Reach reach(const StrutHexapod& m) {
  return reach_of(m.base_joint, m.platform_joint, m.tool_length, m.length_max);
}
Reach reach(const SliderHexapod& m) {
  const Reach a = reach_of(m.rail_outer, m.platform_joint, m.tool_length, m.longest_leg());
  const Reach b = reach_of(m.rail_inner, m.platform_joint, m.tool_length, m.longest_leg());
  return {a.low.cwiseMin(b.low), a.high.cwiseMax(b.high)};
}
Vec3 middle_of_work(const StrutHexapod& m) {
  return {0, 0, m.home.height + m.tool_length};
}
Vec3 middle_of_work(const SliderHexapod& m) {
  return {0, 0, m.home.height + m.tool_length};
}

Outline outline_at(const StrutHexapod& m, const Pose& X_MT, const JointVector&) {
  Outline out{ring(m.base_joint, Role::fixed, "base", false)};
  add_legs(out, m.base_joint, platform_at(m, X_MT), X_MT);
  return out;
}
Outline outline_at(const SliderHexapod& m, const Pose& X_MT, const JointVector& q) {
  SixPoints anchor;
  Outline out;
  for (int i = 0; i < kLegs; ++i) {
    anchor[i] = m.rail_outer[i] + q[i] * m.rail_direction[i];
    out.push_back({Role::fixed, "rails", {m.rail_outer[i], m.rail_inner[i]}});
  }
  add_legs(out, anchor, platform_at(m, X_MT), X_MT);
  return out;
}
Outline outline(const StrutHexapod& m, const Vec3&) {
  return called(outline_at(m, home_pose(m), {}), " at home");
}
Outline outline(const SliderHexapod& m, const Vec3&) {
  const Pose X = home_pose(m);
  std::array<SliderRoots, kLegs> roots;
  slider_roots(m, X, roots.data());
  JointVector q(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    const bool outer_on = roots[i].outer >= 0 && roots[i].outer <= m.rail_length[i];
    q[i] = outer_on ? roots[i].outer : roots[i].inner;
  }
  return called(outline_at(m, X, q), " at home");
}

std::optional<JointVector> joints_of_legs(const StrutHexapod& m, const Pose& X_MT) {
  JointVector q(kLegs);
  lengths(m, X_MT, q.data());
  return q;
}
std::optional<JointVector> joints_of_legs(const SliderHexapod& m, const Pose& X_MT) {
  JointVector q(kLegs);
  SliderRoots roots[kLegs];
  slider_roots(m, X_MT, roots);
  for (int i = 0; i < kLegs; ++i) {
    if (!roots[i].real) return {};
    const double length = m.rail_length[static_cast<std::size_t>(i)];
    const auto on_rail = [&](double s) { return s >= 0 && s <= length; };
    q[i] = !on_rail(roots[i].outer) && on_rail(roots[i].inner) ? roots[i].inner : roots[i].outer;
  }
  return q;
}

LegLayout leg_layout(const StrutHexapod& m) {
  LegLayout out;
  out.anchor = m.base_joint;
  out.end = m.platform_joint;
  for (Vec3& e : out.end) e.z() -= m.tool_length;
  return out;
}
LegLayout leg_layout(const SliderHexapod& m) {
  LegLayout out;
  out.rails = true;
  out.anchor = m.rail_outer;
  out.rail = m.rail_direction;
  out.end = m.platform_joint;
  for (std::size_t i = 0; i < kLegs; ++i) {
    out.rail_length[i] = m.rail_length[i];
    out.leg_length[i] = m.length_of_leg(static_cast<int>(i));
  }
  for (Vec3& e : out.end) e.z() -= m.tool_length;
  return out;
}

}  // namespace polypod::machine
