// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Covariances that `calibrate` and `identify compliance` wrote beside a machine file, for the commands that use them.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "command.hpp"
#include "polypod/core/error.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/statics/covariance.hpp"

namespace polypod::app {

/// What they know of one machine, SI; empty where no file says it.
struct Covariances {
  std::optional<Eigen::MatrixXd> parameters;   ///< in the order of kinematics::parameters
  std::optional<Eigen::MatrixXd> compliances;  ///< in the order of statics::column_names
};

/// The key under [provenance] that names the covariance of the compliances; that of the parameters stands under
/// "uncertainty", so that neither command takes the other's away.
inline constexpr const char* kComplianceUncertainty = "uncertainty of the compliances";

/// The covariance of the calibrated parameters, of the machine file that was written together with it. Errors: FI100,
/// CA153, CA154 the machine file does not name the file's SHA-256, or --set made another machine.
Result<Eigen::MatrixXd> parameter_covariance(const machine::AnyMachine& machine, const std::vector<std::string>& sets,
                                             const std::string& file);
/// The same of files of either kind. Errors: also AP124 two of one kind.
Result<Covariances> covariances_of(const machine::AnyMachine& machine, const std::vector<std::string>& files);

/// {keys, matrix}, in the units of the keys.
Json covariance_json(const statics::Keyed& of, const Eigen::MatrixXd& covariance);

}  // namespace polypod::app
