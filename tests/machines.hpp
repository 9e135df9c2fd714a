// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines that several tests use.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "polypod/geometry/pose.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::test {

/// A machine of the catalogue, some parameters changed. A name or key that is none ends the test.
inline machine::AnyMachine load(const std::string& name, const std::vector<machine::Override>& sets = {}) {
  const auto m = machine::load(name, sets);
  if (!m) throw std::runtime_error(to_string(m.error()));
  return *m;
}

/// A serial arm by the text of its file. One that is not read ends the test.
inline machine::SerialArm arm_of(const std::string& text, const std::string& file = "test.toml") {
  const auto m = machine::from_text(text, file);
  if (!m) throw std::runtime_error(to_string(m.error()));
  return std::get<machine::SerialArm>(*m);
}

/// The largest difference of two poses, of coordinates in m and of elements of the rotations.
inline double difference(const Pose& a, const Pose& b) {
  return std::max((a.p - b.p).cwiseAbs().maxCoeff(), (a.R - b.R).cwiseAbs().maxCoeff());
}

/// The largest difference of two turning joints, rad, whole turns apart from each other being one.
inline double apart(const machine::JointVector& a, const machine::JointVector& b) {
  double worst = 0;
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    worst = std::max(worst, std::abs(std::remainder(a[i] - b[i], 2 * std::numbers::pi)));
  }
  return worst;
}

/// All struts parallel at R = 1, so singular there: the tip's workspace without the joints' limits is the shell
/// length_min <= |p - (0, 0, 10 mm)| <= 90 mm.
inline machine::AnyMachine congruent(const std::string& length_min_mm = "50") {
  return *machine::from_text(R"(
family = "strut-hexapod"
base = { joints_mm = [[50,0,0],[25,43,0],[-25,43,0],[-50,0,0],[-25,-43,0],[25,-43,0]] }
platform = { joints_mm = [[50,0,0],[25,43,0],[-25,43,0],[-50,0,0],[-25,-43,0],[25,-43,0]] }
leg = { length_min_mm = 50, length_max_mm = 90 }
tool = { length_mm = 10 }
)",
                             "congruent.toml", {{"leg.length_min_mm", length_min_mm}});
}

/// A delta of the proportions of industrial ones, whose rods come close to one plane at the boundary of its workspace.
inline machine::AnyMachine flat_delta() {
  return *machine::from_text(R"(
family = "rotary-delta"
base = { radius_mm = 200 }
platform = { radius_mm = 45 }
arm = { length_mm = 350 }
rod = { length_mm = 800, diameter_mm = 14, spacing_mm = 80 }
drive = { angle_min_deg = 50, angle_max_deg = 180 }
)",
                             "flat_delta.toml", {});
}

}  // namespace polypod::test
