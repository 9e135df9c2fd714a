// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Condition, least singular value and determinant of four poses at once.
#pragma once

#include <array>
#include <span>

#include "lanes.hpp"
#include "polypod/kinematics/rates.hpp"

namespace polypod::quality {

/// kinematics::dexterity of each: condition, sigma_min, |determinant|. Square matrices of the same size are worked out
/// four at a time by the eigenvalues of S S^T; those that its squares blur (condition above 1e4) one by one.
/// @param rates  1 to kLanes of one machine
void dexterities(std::span<const kinematics::RateMatrix> rates, std::array<double, 3>* out);

}  // namespace polypod::quality
