// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Derivatives of a closure by its parameters where most equations hold few of them, as those of machines with legs.
#pragma once

#include <limits>
#include <vector>

#include "polypod/core/random.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::kinematics {

/// Which parameters each equation of a closure holds, and a slot for each parameter, such that no equation holds two
/// parameters of one slot. So one pass of dual numbers carries six slots instead of six parameters (Curtis, Powell and
/// Reid 1974). A strut hexapod's 43 parameters take two passes instead of eight; those of an arm, which all equations
/// hold, as many as without.
struct ParameterSlots {
  Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> held;  ///< equations x parameters
  std::vector<std::size_t> slot;                            ///< of each parameter; kNone: no equation holds it
  std::size_t count = 0;

  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
};

/// A slot for each parameter, for equations that hold these (equations x parameters).
inline ParameterSlots slots_of(Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> held) {
  ParameterSlots out;
  out.held = std::move(held);
  std::vector<std::vector<bool>> taken;  // of each slot each equation
  for (Eigen::Index j = 0; j < out.held.cols(); ++j) {
    if (!out.held.col(j).any()) {
      out.slot.push_back(ParameterSlots::kNone);
      continue;
    }
    std::size_t slot = 0;
    const auto free = [&](const std::vector<bool>& by) {
      for (Eigen::Index i = 0; i < out.held.rows(); ++i)
        if (out.held(i, j) && by[static_cast<std::size_t>(i)]) return false;
      return true;
    };
    while (slot < taken.size() && !free(taken[slot])) ++slot;
    if (slot == taken.size()) taken.emplace_back(static_cast<std::size_t>(out.held.rows()), false);
    for (Eigen::Index i = 0; i < out.held.rows(); ++i)
      if (out.held(i, j)) taken[slot][static_cast<std::size_t>(i)] = true;
    out.slot.push_back(slot);
  }
  out.count = taken.size();
  return out;
}

/// Equations hold what they change with at any of three places near X, q, p that were drawn from a fixed seed, so that
/// no derivative is 0 there by chance. Cost: three times that of closure_by_parameters.
template <Machine M>
ParameterSlots parameter_slots(const M& m, const Pose& X, std::span<const double> q, std::span<const double> p) {
  constexpr int kPlaces = 3;
  constexpr double kShare = 0.1, kLength = 1e-3;  // of each figure; m or rad where it is 0
  Random random(1);
  const auto near = [&](double x) { return x + kShare * random.uniform(0.5, 1) * (std::abs(x) + kLength); };
  Eigen::Array<bool, Eigen::Dynamic, Eigen::Dynamic> held;
  for (int place = 0; place < kPlaces; ++place) {
    const Pose at{rotation_of(Vec3(near(0.1), near(0.2), near(-0.1))) * X.R,
                  Vec3(near(X.p.x()), near(X.p.y()), near(X.p.z()))};
    std::vector<double> q_near, p_near;
    for (const double x : q) q_near.push_back(near(x));
    for (const double x : p) p_near.push_back(near(x));
    const Eigen::MatrixXd F_p = closure_by_parameters(m, at, q_near, p_near);
    if (place == 0) held.setConstant(F_p.rows(), F_p.cols(), false);
    held = held || !(F_p.array() == 0.0);  // nan counts as held
  }
  return slots_of(std::move(held));
}

/// F_p (k x parameters), as closure_by_parameters.
template <Machine M>
Eigen::MatrixXd closure_by_parameters(const M& m, const Pose& X, std::span<const double> q, std::span<const double> p,
                                      const ParameterSlots& slots) {
  constexpr std::size_t kAtATime = 6;
  const PoseT<Dual> X_dual = X.cast<Dual>();
  const std::vector<Dual> q_dual(q.begin(), q.end());
  std::vector<Dual> p_dual(p.begin(), p.end());
  Eigen::MatrixXd F_p = Eigen::MatrixXd::Zero(slots.held.rows(), slots.held.cols());
  for (std::size_t first = 0; first < slots.count; first += kAtATime) {
    const auto carried = [&](std::size_t j) { return slots.slot[j] >= first && slots.slot[j] < first + kAtATime; };
    const auto at = [&](std::size_t j) { return static_cast<int>(slots.slot[j] - first); };
    for (std::size_t j = 0; j < p.size(); ++j)
      if (carried(j)) p_dual[j].v[at(j)] = 1;
    const ClosureVectorT<Dual> F = closure(m, X_dual, std::span<const Dual>(q_dual), std::span<const Dual>(p_dual));
    for (std::size_t j = 0; j < p.size(); ++j) {
      if (!carried(j)) continue;
      const auto column = static_cast<Eigen::Index>(j);
      for (Eigen::Index i = 0; i < F.size(); ++i)
        if (slots.held(i, column)) F_p(i, column) = F[i].v[at(j)];
      p_dual[j].v.setZero();
    }
  }
  return F_p;
}

}  // namespace polypod::kinematics
