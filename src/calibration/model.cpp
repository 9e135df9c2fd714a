// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "model.hpp"

namespace polypod::calibration {
namespace {

std::span<const double> span_of(const JointVector& q) {
  return {q.data(), static_cast<std::size_t>(q.size())};
}

}  // namespace

bool equations_of(const AnyMachine& machine, const Measurement& row, const Pose& seed_MT, const Layout& layout,
                  const Eigen::VectorXd& x, const Noise& noise, bool by_unknowns, Equations& out, Lost lost) {
  return std::visit(
      [&](const auto& m) { return equations_of(m, row, seed_MT, layout, x, noise, by_unknowns, out, lost); }, machine);
}

void rules_at(const AnyMachine& machine, const Layout& layout, const Eigen::VectorXd& x, Eigen::VectorXd& r,
              Eigen::MatrixXd& J) {
  std::visit([&](const auto& m) { rules_at(m, layout, x, r, J); }, machine);
}

std::optional<Pose> pose_of_row(const AnyMachine& machine, const Measurement& row) {
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
