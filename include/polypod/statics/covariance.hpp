// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How identified compliances hang together, and files of covariances.
#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::statics {

/// Numbers that a covariance is of: their keys with unit, what one of that unit is in SI, and the numbers (SI).
struct Keyed {
  std::vector<std::string> keys;
  Eigen::VectorXd unit, value;
};

/// "joint[2].compliance_rad_per_Nm" or "leg[1].compliance_um_per_N", in the order of column_names: "stage 1 leg 2" is
/// "stage[1].leg[2]".
Keyed keyed_compliances(const machine::AnyMachine& machine);

/// A file "parameter,KEY1,KEY2,...,value" with a line for each key; a cell holds the covariance in the product of both
/// units, with six digits, the last one the number itself, so that a machine with other figures is told from this one.
std::string covariance_csv(const Keyed& of, const Eigen::MatrixXd& covariance);

/// Reads such a file: the covariance in SI. Errors: FI100, CA153 (other keys than these, cells that are no numbers, no
/// covariance), CA154 (another value of a number) with `hint`.
Result<Eigen::MatrixXd> read_covariance(const Keyed& of, const std::string& path, const std::string& hint);
/// What `polypod identify compliance --covariance` wrote for this machine.
Result<Eigen::MatrixXd> read_covariance(const machine::AnyMachine& machine, const std::string& path);

/// Whether the text of such a file begins with the key of a compliance.
bool names_compliances(std::string_view text);

}  // namespace polypod::statics
