// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the machine files of all families have in common.
#pragma once

#include <string>

#include "polypod/core/config.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::machine {

/// Reads `name`, `description`, `family` (already checked) and the table `provenance`.
Status read_common(const config::Table& table, std::string& name, std::string& description, Provenance& provenance);

class AnyMachine;

/// A machine of any family from its table. Errors: MA101 (unknown family), and those of the family's reader.
Result<AnyMachine> machine_from(const config::Table& table);

/// A frame `{x_mm, y_mm, z_mm, a_deg, b_deg, c_deg}` with R = R_z(C) R_y(B) R_x(A); missing numbers are 0.
Result<Pose> read_frame(const config::Table& table, const std::string& key);

/// The fastest that a joint goes: `speed_deg_per_s`, or `speed_mm_per_s` of one that does not turn, as rad/s or m/s; 0
/// where it does not stand there.
Result<double> speed_of(const config::Table& table, bool turns);

/// `task`: "pose", "axis", "point", or a list of coordinates. Error: MA119.
Result<Task> read_task(const config::Table& table, Task otherwise);
/// The same as a line of a file, a list.
std::string task_toml(Task task);

/// `limits = { x_min_mm, ..., z_max_mm }`, each may be left out. Error: MA142 (a least value not below its largest).
Status read_tip_limits(const config::Table& table, TipLimits& limits);
/// The same as a line of a file; empty where no limit is given.
std::string tip_limits_toml(const TipLimits& limits);
/// Those that are given, as settings.
void push_tip_limits(std::vector<Parameter>& out, const TipLimits& limits);

std::string common_toml(const std::string& name, const std::string& family, const std::string& description);
std::string frame_toml(const std::string& key, const Pose& X);
std::string provenance_toml(const Provenance& provenance);
/// The shortest decimal text that reads back to the same double, after dropping noise below 1e-12 of the value that the
/// conversion of units leaves.
std::string number_toml(double value);

}  // namespace polypod::machine
