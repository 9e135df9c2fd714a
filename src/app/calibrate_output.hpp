// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `polypod calibrate` says: files, JSON and text.
#pragma once

#include <string>
#include <vector>

#include "command.hpp"
#include "polypod/calibration/calibrate.hpp"

namespace polypod::app {

/// Every row before and after. Lengths of the residuals' vectors, and each component with its sign, computed less
/// measured: of a row with x, y, z in um and with angles in deg (axes: across the measured one), of another its reading
/// in um.
std::string residuals_csv(const calibration::Calibration& c, const std::vector<calibration::Measurement>& rows);

/// What a calibration found. `stated`: the noise was given, so that chi-square says something of it.
Json calibration_json(const machine::AnyMachine& nominal, const calibration::Calibration& c,
                      const std::vector<calibration::Measurement>& rows, bool stated);
void print_calibration(const calibration::Calibration& c, const std::vector<calibration::Measurement>& rows,
                       bool stated, const std::vector<calibration::Systematic>& systematic);

}  // namespace polypod::app
