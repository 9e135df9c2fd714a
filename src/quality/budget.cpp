// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/budget.hpp"

#include <fmt/format.h>

#include <cmath>

#include "plan.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/by_parameters.hpp"

namespace polypod::quality {

namespace {

/// U (k = 2) of the tool for parameters of this covariance; G: what the tool does for a unit of each.
BudgetRow calibration_row(const AnyMachine& machine, const Pose& X_MT, const Columns& G,
                          const Eigen::MatrixXd& covariance) {
  using kinematics::kCoverageFactor;
  using kinematics::largest_deviation;
  BudgetRow row{"calibration", "geometric", 0, 0,
                "U (k = 2) of the calibrated parameters, in the direction in which it is largest"};
  if (covariance.size() == 0) return row;
  Eigen::Matrix<double, 3, Eigen::Dynamic> turn(3, G.cols());  // as far as it is an error
  for (Eigen::Index k = 0; k < G.cols(); ++k) turn.col(k) = heeded(kinematics::task(machine), X_MT, G.col(k).tail<3>());
  row.position = kCoverageFactor * largest_deviation(G.topRows<3>() * covariance * G.topRows<3>().transpose());
  row.orientation = kCoverageFactor * largest_deviation(turn * covariance * turn.transpose());
  return row;
}

}  // namespace

Result<Budget> budget(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, const Imperfections& known) {
  const std::vector<Element> all = elements(machine);
  const auto joints = [&](const JointError& size, double share = 1) {
    std::vector<Sized> out;
    for (std::size_t e = 0; e < all.size(); ++e)
      if (all[e].group == "joint")
        out.push_back({static_cast<int>(e), share * (all[e].unit == "deg" ? size.turning : size.sliding)});
    return out;
  };
  Budget out;
  const auto worst_row = [&](const char* source, const char* kind, const std::vector<Sized>& sizes,
                             std::string how) -> Status {
    POLYPOD_ASSIGN(worst, worst_case(machine, X_MT, q, sizes));
    out.rows.push_back({source, kind, worst.position, worst.orientation, std::move(how)});
    return {};
  };
  POLYPOD_TRY(
      worst_row("resolution", "system", joints(known.resolution, 0.5), "half a unit of every joint, worst case"));

  SpreadOptions few;
  few.samples = 100;  // the root sum square alone is wanted
  POLYPOD_ASSIGN(scatter, spread(machine, X_MT, q, joints(known.repeatability), few));
  out.rows.push_back({"repeatability", "statistical", scatter.rss_position, scatter.rss_orientation,
                      "three standard deviations of every joint, root sum square"});

  POLYPOD_TRY(worst_row("tolerances", "geometric", known.tolerances, "exact worst case"));
  const std::vector<machine::Parameter> parameters = kinematics::parameters(machine);
  const Plan whole(machine, *sized(machine, {{"all", 0.0}, {"joint", 0.0}}, true));
  const Columns E = error_columns(machine, X_MT, q, whole);
  out.rows.push_back(calibration_row(machine, X_MT, E.leftCols(std::ssize(parameters)), known.covariance));
  POLYPOD_TRY(
      worst_row("backlash", "non-geometric", joints(known.backlash, 0.5), "half of it at every joint, worst case"));

  // Lengths grow by expansion * warming: each parameter in mm by that share of itself, and so do struts and scales.
  Vec6 warm = Vec6::Zero();
  for (std::size_t k = 0; k < parameters.size(); ++k)
    if (parameters[k].unit == "mm") warm += E.col(static_cast<Eigen::Index>(k)) * parameters[k].value;
  for (int i = 0; i < q.size(); ++i)
    if (kinematics::joint_kind(machine, i) == machine::JointKind::prismatic)
      warm += E.col(static_cast<Eigen::Index>(parameters.size()) + i) * q[i];
  warm *= known.expansion * known.warming;
  out.rows.push_back(
      {"temperature rise", "non-geometric", warm.head<3>().norm(), orientation_error(machine, X_MT, warm),
       fmt::format("{:g} K, {:g} um per m and K, all lengths alike", known.warming, units::to_um(known.expansion))});
  out.rows.push_back({"compliance", "non-geometric", known.deflection.head<3>().norm(),
                      orientation_error(machine, X_MT, known.deflection), "the joints under the given force"});

  double squares = 0, angle_squares = 0;
  for (const BudgetRow& row : out.rows) {
    if (row.kind == "statistical") {
      out.repeatability = row.position;
      out.repeatability_orientation = row.orientation;
      continue;
    }
    out.accuracy += row.position;
    out.accuracy_orientation += row.orientation;
    squares += row.position * row.position;
    angle_squares += row.orientation * row.orientation;
  }
  out.accuracy_rss = std::sqrt(squares);
  out.accuracy_rss_orientation = std::sqrt(angle_squares);
  return out;
}

}  // namespace polypod::quality
