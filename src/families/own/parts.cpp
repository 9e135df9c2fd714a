// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/own/parts.hpp"

#include <fmt/format.h>

namespace polypod::machine {

std::vector<Element> elements(const Own& m) {
  std::vector<Element> out;
  for (int i = 0; i < joint_count(m); ++i) {
    out.push_back({fmt::format("joint {}", i + 1), m.compliance[static_cast<std::size_t>(i)],
                   joint_kind(m, i) == JointKind::revolute});
  }
  return out;
}
ElementColumns element_columns(const Own& m, const JointVector& q, const Pose* X_MT) {
  const Pose X = X_MT != nullptr ? settled(m, *X_MT, q) : forward(m, q);
  return {X, jacobian(m, X, q)};
}
void set_compliance(Own& m, int element, double compliance) {
  m.compliance[static_cast<std::size_t>(element)] = compliance;
}

Reach reach(const Own& m) {
  if (const auto own = m.questions->reached()) return *own;
  constexpr int kPlaces = 512;
  constexpr double kWider = 0.25;  // on each side
  const Vec3 home = home_pose(m).p;
  Reach box{home, home};
  for (int k = 0; k < kPlaces; ++k) {
    const kinematics::NewtonResult at = forward_from_home(m, kinematics::closure_detail::start_joints(m, k));
    if (!at.converged) continue;
    box.low = box.low.cwiseMin(at.X_MT.p);
    box.high = box.high.cwiseMax(at.X_MT.p);
  }
  const Vec3 wider = kWider * (box.high - box.low);
  return {box.low - wider, box.high + wider};
}
Vec3 middle_of_work(const Own& m) {
  return home_pose(m).p;
}

Outline outline(const Own& m, const Vec3& tip) {
  if (auto own = m.questions->drawn(tip)) return *std::move(own);
  const Pose home = home_pose(m);
  const kinematics::InverseResult at_home = inverse(m, home);
  return called(outline_at(m, home, at_home.solutions.empty() ? JointVector() : at_home.solutions.front().joints),
                " at home");
}
Outline outline_at(const Own& m, const Pose& X_MT, const JointVector& q) {
  if (auto own = q.size() > 0 ? m.questions->drawn_at(X_MT, q) : std::nullopt) return *std::move(own);
  using Role = OutlinePart::Role;
  return {{Role::moving, m.family, {Vec3::Zero(), X_MT.p}}, {Role::joints, "", {X_MT.p}}};
}

}  // namespace polypod::machine
