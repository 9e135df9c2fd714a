// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What systematic parts do to the residuals of single rows.
#pragma once

#include <vector>

#include "model.hpp"

namespace polypod::calibration {

/// The unknowns of these parts that rows of these kinds can show.
struct SystematicUnknown {
  std::size_t part = 0;
  int axis = -1;  ///< 0 to 2, or -1 for an unknown without a coordinate
};
std::vector<SystematicUnknown> unknowns_of(const std::vector<Systematic>& parts, const std::vector<Measurement>& rows);

/// The derivatives of the equations of one row (as they stand in `e`, with J) by these unknowns: equations x unknowns.
Eigen::MatrixXd systematic_columns(const std::vector<Systematic>& parts, const std::vector<SystematicUnknown>& unknowns,
                                   const Measurement& row, const Pose& X_MT, const Layout& layout,
                                   const Eigen::VectorXd& x, const Equations& e);

}  // namespace polypod::calibration
