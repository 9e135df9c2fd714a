// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Rows that were measured at one pose of the machine hang together.
#pragma once

#include <vector>

#include "polypod/calibration/calibrate.hpp"

namespace polypod::calibration {

/// The number of the pose of each row, 0 on, in the order in which they come: rows whose joints agree to 0.001 mm and
/// 0.001 deg stand at one.
std::vector<std::size_t> poses_of(const AnyMachine& machine, const std::vector<Measurement>& rows);
/// The same for repeats: rows at one pose that also are of one kind, from one ball, over one plane, of one place.
std::vector<std::size_t> repeats_of(const std::vector<Measurement>& rows, const std::vector<std::size_t>& poses);

/// The scatter within repeats and between them, by the analysis of variance of one way, from the residuals of a fit
/// that takes up `taken_up` equations; whitened by `noise`. Outliers and lost rows aside.
Repeats repeats_in(const std::vector<Measurement>& rows, const std::vector<std::size_t>& repeats,
                   const std::vector<RowResidual>& residuals, double noise_position, double noise_angle,
                   double taken_up);
/// For how many independent rows each one counts: 1 / (1 + (m - 1) rho) of m repeats that correlate by rho (Kish 1965).
std::vector<double> shares_of(const std::vector<std::size_t>& repeats, double correlation);

}  // namespace polypod::calibration
