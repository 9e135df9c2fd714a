// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/under_load.hpp"

#include <variant>

#include "polypod/families/serial/kinematics.hpp"

namespace polypod::statics {

std::optional<UnderLoad> under_load(const machine::AnyMachine& machine, const machine::JointVector& q, const Vec3& F) {
  const auto* arm = std::get_if<machine::SerialArm>(&machine);
  if (arm == nullptr || q.size() != arm->free_joints() || !F.allFinite()) return std::nullopt;
  machine::SerialArm whole = *arm;  // all joints move, those with a brake, too
  const auto rows = static_cast<Eigen::Index>(whole.dh.size());
  machine::JointVector at_rest(rows);
  Eigen::VectorXd compliance(rows);
  int next = 0;
  for (Eigen::Index i = 0; i < rows; ++i) {
    machine::DhRow& row = whole.dh[static_cast<std::size_t>(i)];
    at_rest[i] = row.locked ? *row.locked : q[next++];
    compliance[i] = row.compliance;
    row.locked.reset();
  }
  constexpr int kMostRounds = 100;
  constexpr double kSettled = 1e-13;  // rad or m
  const machine::ForwardJacobian unloaded = machine::forward_jacobian(whole, at_rest);
  const auto turned = [&](const machine::JacobianMatrix& J) -> machine::JointVector {
    return compliance.cwiseProduct(J.topRows<3>().transpose() * F);
  };
  machine::JointVector by_load = turned(unloaded.J);
  UnderLoad out;
  out.linear = unloaded.J.topRows<3>() * by_load;
  for (int round = 0; round < kMostRounds; ++round) {
    const machine::ForwardJacobian now = machine::forward_jacobian(whole, at_rest + by_load);
    const machine::JointVector next_turn = turned(now.J);
    const double change = (next_turn - by_load).cwiseAbs().maxCoeff();
    by_load = next_turn;
    if (change > kSettled) continue;
    out.exact = machine::forward(whole, at_rest + by_load).p - unloaded.X_MT.p;
    return out;
  }
  return std::nullopt;
}

}  // namespace polypod::statics
