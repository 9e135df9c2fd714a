// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Synthetic truth: a machine that is a little off its drawing, and what an instrument reads of it.
#pragma once

#include <cstdint>
#include <vector>

#include "polypod/calibration/measurement.hpp"
#include "polypod/statics/identify.hpp"

namespace polypod::calibration {

/// The machine with every parameter off by a normal random error: lengths by `length` (m), angles by `angle` (rad) and
/// numbers without a unit (directions) by `angle`, as standard deviations. Errors: MA104 and those of the family.
Result<AnyMachine> perturbed(const AnyMachine& machine, double length, double angle, std::uint64_t seed);

/// The machine with the compliance of every joint multiplied by 1 + share * (normal random number), not below 0.1 of
/// it.
Result<AnyMachine> perturbed_compliance(const AnyMachine& machine, double share, std::uint64_t seed);

/// A pose that the machine takes within all its limits.
struct Stand {
  JointVector q;
  Pose X_MT;
};
/// `count` stands within all limits and not nearly singular (condition below 100), with joints drawn evenly from their
/// ranges; where few joints fit together (parallel machines) the first 24 so, and the others with poses drawn evenly
/// from the box of those. Where 20000 draws do not give 24, those that are missing are found with poses from a box that
/// grows round the first. Fewer where a million draws do not give as many.
std::vector<Stand> random_stands(const AnyMachine& machine, std::size_t count, std::uint64_t seed);

struct SimulationOptions {
  Kind kind = Kind::point;
  std::size_t count = 70;
  std::uint64_t seed = 1;
  double noise_position = 20e-6;  ///< m, of each coordinate, distance or reading
  double noise_angle = 35e-6;     ///< rad, of each angle
  double outliers = 0;            ///< share of the rows that are off by `outlier_size` as well
  double outlier_size = 1e-3;     ///< m
  Pose X_SM, X_TR;                ///< the machine in the instrument's frame, the target on the tool
  std::vector<Vec3> anchors;      ///< distance: balls in S, in turn; gauge: points of level planes; m
  std::size_t touches = 4;        ///< contact: rows a place
};
/// What an instrument reads of the real machine at random stands of the nominal one, whose joints the controller knows.
/// For contacts the tool is tilted by up to 20 deg about the
/// place, and the noise lies on the place that is really touched. Errors: CA120 (an option out of range), CA121 (too
/// few stands found).
Result<std::vector<Measurement>> simulate(const AnyMachine& nominal, const AnyMachine& real,
                                          const SimulationOptions& options);

/// Displacements of the tip under `force` (N) along x, y and z at random stands. Errors as `simulate`, and CA122 for a
/// machine without compliances.
Result<std::vector<statics::MeasuredPoint>> simulate_displacements(const AnyMachine& machine, double force,
                                                                   const SimulationOptions& options);
/// The file that statics::read_displacements takes.
std::string displacements_csv(const std::vector<statics::MeasuredPoint>& points);

}  // namespace polypod::calibration
