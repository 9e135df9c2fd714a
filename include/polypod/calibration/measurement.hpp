// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What instruments say about a machine: poses, points, distances, readings of gauges, contacts.
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/csv.hpp"
#include "polypod/core/error.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::calibration {

using machine::AnyMachine;
using machine::JointVector;

/// What one row of a measurement holds beside the joints. R is the target on the tool (a reflector, a ball), X_TR its
/// place there; S is the frame of the instrument.
enum class Kind {
  point,     ///< x_mm, y_mm, z_mm: the target in S (laser tracker): 3 equations
  axis,      ///< and a_deg, b_deg: the direction of the tool axis: 5 equations
  pose,      ///< and a_deg, b_deg, c_deg: the whole pose: 6 equations
  distance,  ///< distance_mm of the target from anchor_x_mm, anchor_y_mm, anchor_z_mm in S (ball-bar): 1 equation
  gauge,     ///< gauge_mm: height of the target over a plane of S, given by a point plane_x_mm, ... and its normal
             ///< normal_x, ... (dial gauge, touch probe on a plane): 1 equation
  contact,   ///< the target touched the same unknown place as all rows with the same text in `contact` (a cone, a
             ///< socket: joint readings only): 3 equations a row less 3 a place
};
/// "points", "poses", "distances", ...
std::string name_of(Kind kind);

struct Measurement {
  Kind kind = Kind::point;
  JointVector q;           ///< what the controller reads, rad or m
  Pose X_SR;               ///< measured: its position for point, its position and R (axis: only R's z) for the others
  Vec3 anchor_S{0, 0, 0};  ///< distance: the fixed ball; gauge: a point of the plane; m
  Vec3 normal_S{0, 0, 1};  ///< gauge: unit normal
  double reading = 0;      ///< distance, gauge: m
  std::string contact;     ///< which place was touched
  double noise = 0;        ///< standard deviation of each coordinate, m (column sigma_um); 0: the instrument's
  double time = std::numeric_limits<double>::quiet_NaN();         ///< s; column time_s or time; NaN: not given
  double temperature = std::numeric_limits<double>::quiet_NaN();  ///< deg C; column temperature_C; NaN: not given
  Place place;                                                    ///< the row of the file
};

/// Reads a file of measurements: columns q1 to qn (mm or deg, the machine's joints that move) and those of one kind
/// (see Kind); sigma_um, time_s or time (s, hh:mm:ss, or ISO 8601) and temperature_C if
/// there are such columns. Errors: ID100 to ID103, ID106 of tables, CA101 (no kind of measurement
/// among the columns), CA102 (a normal without length, a distance or noise not above 0), CA103 (joints far outside
/// their ranges in more than a tenth of the rows: another unit?).
Result<std::vector<Measurement>> read_measurements(const AnyMachine& machine, const std::string& path);
/// The same of a table that was read; what nothing asks for `table.unused()` then names.
Result<std::vector<Measurement>> read_measurements(const AnyMachine& machine, const csv::Table& table);

/// The first joint that is outside of its range by more than the range itself: no machine was there.
std::optional<int> joint_far_outside(const AnyMachine& machine, const JointVector& q);

/// Errors: ID103 where two rows say the same, in one file or in two: they would count twice.
Status no_row_twice(const std::vector<Measurement>& rows);

/// The same rows as a file, with columns as read_measurements takes them; all of one kind.
std::string measurements_csv(const AnyMachine& machine, const std::vector<Measurement>& rows);

}  // namespace polypod::calibration
