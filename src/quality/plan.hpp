// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Sized elements worked out once for many poses: which columns of the closure, how much.
#pragma once

#include <memory>
#include <optional>

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/closure_slots.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/quality/errors.hpp"
#include "polypod/quality/zonotope.hpp"

namespace polypod::quality {

struct Plan {
  struct Part {
    int element = 0;
    double size = 0;
    std::vector<int> columns;
    std::string key;
    Eigen::VectorXd rate{};  ///< of a figure without columns: dp for a unit of it
  };
  std::vector<Part> parts;
  bool parameters = false, joints = false;  ///< whether any column is one
  machine::Task task = machine::Task::pose;
  std::vector<double> nominal;  ///< p
  std::optional<kinematics::ParameterSlots> slots{};

  Plan(const AnyMachine& machine, const std::vector<Sized>& sizes)
      : task(kinematics::task(machine)),
        nominal(std::visit([](const auto& m) { return kinematics::nominal_parameters(m); }, machine)) {
    const std::vector<Element> all = elements(machine);
    const int parameter_count = static_cast<int>(nominal.size());
    for (const auto& [number, size] : sizes) {
      const Element& e = all[static_cast<std::size_t>(number)];
      parts.push_back({number, size, e.columns, e.key});
      if (e.figure && e.columns.empty()) {
        if (auto rate = figure_rate(machine, e)) parts.back().rate = std::move(*rate);
        parameters = true;
      }
      for (const int c : e.columns) (c < parameter_count ? parameters : joints) = true;
    }
  }

  /// For many poses: parameters that no equation shares are derived by together. Pays from some ten poses on.
  static std::shared_ptr<const Plan> for_many_poses(const AnyMachine& machine, const std::vector<Sized>& sizes);
};

/// One generator of both zonotopes and the element that it belongs to.
struct Generator {
  Vec3 position, orientation;
  int element = 0;
};

using Columns = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// What the tool does for a unit of each column of a part; one move for a figure that changes many parameters.
inline std::vector<Vec6> moves(const Plan::Part& part, const Columns& E) {
  if (part.rate.size() > 0) return {E.leftCols(part.rate.size()) * part.rate};
  std::vector<Vec6> out;
  for (const int c : part.columns) out.push_back(E.col(c));
  return out;
}

/// -A^-1 [F_p, F_q], 6 x (parameters + joints): what the tool does for a unit of each; those that the plan does not
/// name may be 0. Of a machine of Task::axis the pose with the turn about the tool axis that it really has counts.
Columns error_columns(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, const Plan& plan);

/// dX of all parts at once (known_error).
Vec6 linear_error(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, const Plan& plan);

/// The part of a rotation vector that is an error: for Task::axis the turn about the tool axis is none.
Vec3 heeded(machine::Task task, const Pose& X, const Vec3& w);

/// Errors: QU102.
Result<std::vector<Generator>> generators(const Pose& X, const Columns& E, const Plan& plan, Region region);

/// The farthest vertex, or what the search of JEL finds.
Farthest farthest(const std::vector<Generator>& list, const Plan& plan, Vec3 Generator::*part, Method method);

}  // namespace polypod::quality
