// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/delta/parts.hpp"

#include <fmt/format.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace polypod::machine {
namespace {

using Role = OutlinePart::Role;

std::vector<Element> elements_of(const Delta& m, bool drives_turn) {
  std::vector<Element> out;
  for (int i = 0; i < m.arms; ++i) {
    out.push_back({fmt::format("drive {}", i + 1), m.drive_compliance[std::size_t(i)], drives_turn});
  }
  for (int i = 0; i < m.arms; ++i) {
    out.push_back({fmt::format("rod {}", i + 1), m.rod_compliance[std::size_t(i)], false});
  }
  return out;
}

template <class M>
ElementColumns columns_of(const M& m, const JointVector& q, const Pose* X_MT) {
  const Pose X = X_MT != nullptr ? *X_MT : forward(m, q);
  const DeltaJacobians pair = jacobians(m, X.p, q);
  Eigen::VectorXd gives(m.arms);
  for (int i = 0; i < m.arms; ++i) {
    gives[i] = pair.B[i] * pair.B[i] * m.drive_compliance[std::size_t(i)] + m.rod_compliance[std::size_t(i)];
  }
  // A chain that gives way by a millionth of the softest one stands for a rigid one.
  const double least = 1e-6 * gives.maxCoeff();
  Eigen::VectorXd K = Eigen::VectorXd::Ones(m.arms);
  if (least > 0) K = gives.cwiseMax(least).cwiseInverse();
  const Eigen::VectorXd root = K.cwiseSqrt();
  const Eigen::MatrixXd held =
      (root.asDiagonal() * pair.A).completeOrthogonalDecomposition().pseudoInverse() * root.asDiagonal();
  ElementColumns out{X, JacobianMatrix::Zero(6, 2 * m.arms)};
  out.J.topRightCorner(3, m.arms) = held;
  out.J.topLeftCorner(3, m.arms) = held * pair.B.asDiagonal();
  return out;
}

double arm_reach(const RotaryDelta& m, int i) {
  return 2 * m.arm_length[i];
}
double arm_reach(const LinearDelta& m, int) {
  return m.range.max;
}
template <class M>
Reach reach_of(const M& m) {
  double reach = 0;
  for (int i = 0; i < m.arms; ++i) reach = std::max(reach, 2 * m.rod_length[i] + arm_reach(m, i));
  return {m.home - Vec3::Constant(reach), m.home + Vec3::Constant(reach)};
}

/// What the drive moves: the arm up to its elbow, or the whole rail.
OutlinePart drive_of(const RotaryDelta& m, int i, const Vec3& elbow) {
  return {Role::moving, "arms", {m.base_joint[i], elbow}};
}
OutlinePart drive_of(const LinearDelta& m, int i, const Vec3&) {
  return {Role::moving, "rails", {m.rail_start[i], m.rail_start[i] + m.range.max * m.rail_direction[i]}};
}

template <class M>
Outline outline_of(const M& m, const Vec3& tip, const JointVector& q) {
  Outline out{{Role::fixed, "base", {}, false, true}};
  OutlinePart platform{Role::platform, "platform", {}, true, true}, joints{Role::joints, "", {}};
  for (int i = 0; i < m.arms; ++i) {
    const Vec3 elbow = driven_end(m, i, q[i]), end = tip + m.platform_joint[i] - m.tool;
    OutlinePart drive = drive_of(m, i, elbow);
    out.front().points.push_back(drive.points.front());
    platform.points.push_back(end);
    out.push_back(std::move(drive));
    const int rods = delta_detail::rods_of(m);
    for (int rod = 0; rod < rods; ++rod) {
      const double offset = rods < 2 ? 0.0 : delta_detail::rod_offsets(m)[static_cast<std::size_t>(rod)];
      const Vec3 aside = offset * m.axis[i];
      out.push_back({Role::moving, "rods", {elbow + aside, end + aside}, false});
    }
    joints.points.push_back(elbow);
    joints.points.push_back(end);
  }
  out.front().points.push_back(out.front().points.front());
  platform.points.push_back(platform.points.front());
  out.push_back(std::move(platform));
  out.push_back({Role::tool, "tool", {tip - m.tool, tip}});
  out.push_back(std::move(joints));
  return out;
}

}  // namespace

std::vector<Element> elements(const RotaryDelta& m) {
  return elements_of(m, true);
}
std::vector<Element> elements(const LinearDelta& m) {
  return elements_of(m, false);
}
ElementColumns element_columns(const RotaryDelta& m, const JointVector& q, const Pose* X_MT) {
  return columns_of(m, q, X_MT);
}
ElementColumns element_columns(const LinearDelta& m, const JointVector& q, const Pose* X_MT) {
  return columns_of(m, q, X_MT);
}
void set_compliance(Delta& m, int element, double compliance) {
  (element < m.arms ? m.drive_compliance[std::size_t(element)] : m.rod_compliance[std::size_t(element - m.arms)]) =
      compliance;
}

Reach reach(const RotaryDelta& m) {
  return reach_of(m);
}
Reach reach(const LinearDelta& m) {
  return reach_of(m);
}
Vec3 middle_of_work(const Delta& m) {
  return m.home;
}

Outline outline_at(const RotaryDelta& m, const Pose& X_MT, const JointVector& q) {
  return outline_of(m, X_MT.p, q);
}
Outline outline_at(const LinearDelta& m, const Pose& X_MT, const JointVector& q) {
  return outline_of(m, X_MT.p, q);
}
Outline outline(const RotaryDelta& m, const Vec3&) {
  return called(outline_of(m, m.home, JointVector::Constant(m.arms, m.home_joint)), " at home");
}
Outline outline(const LinearDelta& m, const Vec3&) {
  return called(outline_of(m, m.home, JointVector::Constant(m.arms, m.home_joint)), " at home");
}

}  // namespace polypod::machine
