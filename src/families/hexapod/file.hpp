// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The parts of a machine file that both families of hexapods have.
#pragma once

#include <string>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/families/hexapod/machine.hpp"

namespace polypod::machine {

/// `key = { radius_mm, pair_angle_deg }` or `key = { joints_mm = [[x, y, z], ...] }`.
struct JointsOfFile {
  SixPoints points{};
  std::optional<PairedCircle> circle;
};
Result<JointsOfFile> read_joints(const config::Table& table, const std::string& key, bool base);
std::string joints_toml(const std::string& key, const SixPoints& points, const std::optional<PairedCircle>& circle);

/// Six points, `key = [[x, y, z], ...]` in mm.
Result<SixPoints> read_six(const config::Table& table, const std::string& key);
std::string six_toml(const SixPoints& points);

/// `joint = { limit = "cone" | "elevation" | "pyramid" | "none", cone_deg, pyramid_deg = [u, v], base, platform }` with
/// `base` and `platform = { axis = [x, y, z] or six of them, cone_deg = one number or six }` for cones only: axes point
/// from the joint along its leg. An end without any angle has no limit. Errors: MA122, MA126 (seats without cones, an
/// axis without a direction).
struct JointsOfLegs {
  JointLimit limit;
  JointSeats base, platform;
};
Result<JointsOfLegs> read_joint_limits(const config::Table& table);
std::string joint_limits_toml(const JointsOfLegs& joints);

/// `key = [six numbers]`, or six times `otherwise` where the key is absent.
Result<SixNumbers> read_six_numbers(const config::Table& table, const std::string& key, double otherwise,
                                    config::Range range = config::kAnyFinite);
/// What a calibration adds to the keys of `leg`, with a comma before it; empty where it is the same for all legs (0).
std::string leg_offset_toml(const SixNumbers& offset);
std::string leg_compliance_toml(const SixNumbers& compliance);
double mean_of(const SixNumbers& numbers);

/// The settings of a circle and of the joints' limits.
void push_circle(std::vector<Parameter>& out, const std::string& key, const std::optional<PairedCircle>& circle);
void push_joint_limits(std::vector<Parameter>& out, const JointsOfLegs& joints);

/// `tool = { length_mm }`.
Result<double> read_tool_length(const config::Table& table);

/// MA121 if the points of one end span no plane or two legs are one and the same.
Status check_legs(const config::Table& table, const SixPoints& base, const SixPoints& platform);

}  // namespace polypod::machine
