// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/parts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "polypod/families/serial/frames.hpp"

namespace polypod::machine {

using Role = OutlinePart::Role;

std::vector<Element> elements(const SerialArm& arm) {
  std::vector<Element> out;
  for (const DhRow& row : arm.dh) {
    out.push_back({fmt::format("joint {}", out.size() + 1), row.compliance, row.kind == JointKind::revolute});
  }
  return out;
}
ElementColumns element_columns(const SerialArm& arm, const JointVector& q, const Pose*) {
  ForwardJacobian fj = forward_jacobian(arm, q, true);
  return {fj.X_MT, std::move(fj.J)};
}
void set_compliance(SerialArm& arm, int element, double compliance) {
  arm.dh[static_cast<std::size_t>(element)].compliance = compliance;
}

Reach reach(const SerialArm& arm) {
  double reach = arm.X_FT.p.norm();
  for (const DhRow& row : arm.dh) {
    reach += std::abs(row.a) + std::abs(row.d);
    if (row.kind != JointKind::prismatic) continue;
    const auto [low, high] = row.locked ? JointRange{*row.locked, *row.locked} : row.range;
    reach += std::max(std::abs(low), std::abs(high));
  }
  return {arm.X_MB.p - Vec3::Constant(reach), arm.X_MB.p + Vec3::Constant(reach)};
}
Vec3 middle_of_work(const SerialArm&) {
  return Vec3::Zero();
}

Outline outline_at(const SerialArm& arm, const Pose& X_MT, const JointVector& q) {
  Outline out;
  OutlinePart links{Role::moving, "links", {arm.X_MB.p}}, joints{Role::joints, "", {arm.X_MB.p}};
  const std::vector<Pose> frames = frames_of_table(arm, q);
  for (auto frame = frames.begin() + 1; frame != frames.end(); ++frame) {
    links.points.push_back(frame->p);
    joints.points.push_back(frame->p);
  }
  const Vec3 last = links.points.back();
  out.push_back(std::move(links));
  out.push_back({Role::tool, "tool", {last, X_MT.p}});
  out.push_back(std::move(joints));
  return out;
}

Outline outline(const SerialArm& arm, const Vec3& tip) {
  constexpr double kSize = 0.15;  // m, the cross of the base
  Outline out;
  for (int axis = 0; axis < 2; ++axis) {
    const Vec3 e = kSize * arm.X_MB.R.col(axis);
    out.push_back({Role::fixed, "base", {arm.X_MB.p - e, arm.X_MB.p + e}});
  }
  const auto solved = inverse(arm, Pose{Mat3::Identity(), tip});
  const kinematics::Solution* solution = solved.reachable();
  if (solution == nullptr) return out;
  const Pose X = forward(arm, solution->joints);
  for (OutlinePart& part : called(outline_at(arm, X, solution->joints), ", zero tilt in the middle")) {
    out.push_back(std::move(part));
  }
  return out;
}

}  // namespace polypod::machine
