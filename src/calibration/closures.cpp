// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The one place where calibration looks at a machine's family.
#include <algorithm>

#include "model.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::calibration {
namespace {

std::span<const double> span_of(const JointVector& q) {
  return {q.data(), static_cast<std::size_t>(q.size())};
}

/// Dual numbers carry six derivatives at a time.
template <class M>
void rules_at(const M& m, const Layout& layout, const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd& J) {
  constexpr int kAtATime = 6;
  const int count = layout.count - layout.parameters;
  std::vector<kinematics::Dual> p(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) p[static_cast<std::size_t>(i)] = kinematics::Dual(x[layout.parameters + i]);
  const auto rules = static_cast<Eigen::Index>(kinematics::rules_of(m, std::span<const kinematics::Dual>(p)).size());
  r.setZero(rules);
  J.setZero(rules, layout.count);
  for (int first = 0; rules > 0 && first < count; first += kAtATime) {
    const int some = std::min(kAtATime, count - first);
    for (int j = 0; j < some; ++j) p[static_cast<std::size_t>(first + j)].v[j] = 1;
    const auto values = kinematics::rules_of(m, std::span<const kinematics::Dual>(p));
    for (Eigen::Index i = 0; i < rules; ++i) {
      r[i] = values[static_cast<std::size_t>(i)].a;
      J.row(i).segment(layout.parameters + first, some) = values[static_cast<std::size_t>(i)].v.head(some).transpose();
    }
    for (int j = 0; j < some; ++j) p[static_cast<std::size_t>(first + j)].v.setZero();
  }
}

}  // namespace

kinematics::ClosureVector closure_of(const AnyMachine& machine, const Pose& X_MT, Numbers q, Numbers p) {
  return std::visit([&](const auto& m) -> kinematics::ClosureVector { return closure(m, X_MT, q, p); }, machine);
}

kinematics::ClosureMatrix closure_by_pose_of(const AnyMachine& machine, const Pose& X_MT, Numbers q, Numbers p) {
  return std::visit([&](const auto& m) { return kinematics::closure_by_pose(m, X_MT, q, p); }, machine);
}

kinematics::NewtonResult forward_of(const AnyMachine& machine, Numbers q, Numbers p, const Pose& seed_MT) {
  return std::visit([&](const auto& m) { return kinematics::forward_by_closure(m, q, p, seed_MT); }, machine);
}

Eigen::MatrixXd closure_by_parameters_of(const AnyMachine& machine, const Pose& X_MT, Numbers q, Numbers p,
                                         const std::optional<kinematics::ParameterSlots>& slots) {
  return std::visit(
      [&](const auto& m) -> Eigen::MatrixXd {
        return slots ? kinematics::closure_by_parameters(m, X_MT, q, p, *slots)
                     : kinematics::closure_by_parameters(m, X_MT, q, p);
      },
      machine);
}

void rules_at(const AnyMachine& machine, const Layout& layout, const Eigen::VectorXd& x, Eigen::VectorXd& r,
              Eigen::MatrixXd& J) {
  std::visit([&](const auto& m) { rules_at(m, layout, x, r, J); }, machine);
}

std::optional<Pose> pose_of_row(const AnyMachine& machine, const Measurement& row) {
  if (joint_far_outside(machine, row.q)) return {};
  return std::visit(
      [&](const auto& m) -> std::optional<Pose> {
        const auto at = kinematics::forward_by_closure(m, span_of(row.q), forward(m, row.q));
        return at.converged ? std::optional(at.X_MT) : std::nullopt;
      },
      machine);
}

kinematics::ParameterSlots parameter_slots_of(const AnyMachine& machine, const Pose& X_MT, const JointVector& q) {
  return std::visit(
      [&](const auto& m) {
        const std::vector<double> p = kinematics::nominal_parameters(m);
        return kinematics::parameter_slots(m, X_MT, span_of(q), std::span<const double>(p));
      },
      machine);
}

}  // namespace polypod::calibration
