// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a certificate of a calibration says beside the calibration itself: who, what and when; the uncertainty budget
// (GUM); figures as ISO 9283, ISO 230-2 and ISO 10360-2 define them, where the readings have their form; hashes.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/calibration/calibrate.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/kinematics/by_parameters.hpp"
#include "polypod/statics/covariance.hpp"

namespace polypod::calibration {

using kinematics::kCoverageFactor;

/// What people say of a measurement; empty is not given.
struct Statement {
  std::string number, date, customer, operator_name, place;
  std::string machine_manufacturer, machine_type, machine_serial, controller;
  std::string instrument_name, instrument_serial, traceability;
  std::optional<double> temperature_mean, temperature_min, temperature_max;  ///< deg C
  std::vector<std::string> remarks;
  std::vector<Systematic> systematic;
};
/// Reads a TOML file: number, date ("2026-05-04"), customer, operator, place, remarks; tables [machine] (manufacturer,
/// type, serial, controller), [instrument] (name, serial, traceability), [temperature] (mean_C, min_C, max_C), and
/// [[systematic]] as read_systematic. Errors: those of config::read_file and read_systematic, CF102 to CF104, CA152 (a
/// date that is none, temperatures out of order).
Result<Statement> read_statement(const std::string& path);

/// SHA-256 of these bytes, as 64 hexadecimal digits (FIPS 180-4; OpenSSL).
std::string sha256(std::string_view bytes);

/// One input of the uncertainty budget of the tool's pose at one pose.
struct BudgetRow {
  std::string quantity, distribution, unit;  ///< of b; unit empty for rows that are no single b
  char type = 'B';
  std::string source;
  double size = 0, divisor = 1;    ///< in the unit; 0 for rows that are no single b
  double degrees = 0;              ///< of freedom; 0: no end of them
  Eigen::VectorXd sensitivity{};   ///< change of each coordinate (m, rad) by one unit of b; empty likewise
  Eigen::VectorXd contribution{};  ///< standard deviation of each coordinate, m and rad
};
struct Budget {
  Stand stand;                           ///< where it holds
  std::vector<std::string> coordinates;  ///< pose_coordinates
  std::vector<BudgetRow> rows;           ///< the readings, the drawing, and each systematic unknown
  Eigen::VectorXd combined, degrees;  ///< standard uncertainty of each coordinate, and its effective degrees of freedom
  Eigen::VectorXd k95;                ///< the coverage factor that belongs to these for 95 % (Student's t, GUM G.4)
};
/// GUM 5.1.2 at one pose: contributions add in squares. Degrees of freedom as Welch and Satterthwaite (GUM G.4).
Budget budget_at(const AnyMachine& machine, const Calibration& c, const std::vector<Systematic>& systematic,
                 const Stand& stand);

using kinematics::largest_deviation;
using kinematics::tip_covariance;

/// The parameters of a machine as a covariance names them, "base.joint[1].x_mm".
statics::Keyed keyed_parameters(const AnyMachine& machine);

/// Reads what `polypod calibrate --covariance` wrote for this machine: the covariance of its parameters, SI, in their
/// order. Errors: FI100, CA153 (other parameters than the machine's, cells that are no numbers, no covariance).
Result<Eigen::MatrixXd> read_covariance(const AnyMachine& machine, const std::string& path);

/// The poses that the rows measured: place and orientation as coordinates of the task.
struct Region {
  std::vector<std::string> coordinates;
  Eigen::VectorXd low, high;  ///< m and rad
  /// Whether the place lies in the box of the measured places.
  [[nodiscard]] bool holds(const Vec3& p) const;
  Eigen::AlignedBox3d box;
};
Region region_of(const AnyMachine& machine, const std::vector<Measurement>& rows);

/// Of the stands that the verdict judges the one in the region where the tip's deviation is largest (of all of them,
/// where none is in it); none for a machine without stands.
std::optional<Stand> most_uncertain(const AnyMachine& machine, const Calibration& c, const Region& region);

/// AP and RP of one pose that was attained again and again, as ISO 9283:1998 7.2 defines them; lengths in m.
struct PoseAccuracy {
  std::size_t row = 0, cycles = 0;                     ///< its first row; how often
  Vec3 command{0, 0, 0};                               ///< place of the tip in M as the drawing has it, m
  double accuracy = 0, accuracy_after = 0;             ///< AP: barycentre from the command; with the calibrated machine
  double repeatability = 0;                            ///< RP = mean + 3 S of the distances from the barycentre
  bool angles = false;                                 ///< poses were measured: the two below are known
  double angle_accuracy = 0, angle_repeatability = 0;  ///< rad, the largest of the three
};
/// Poses with this many cycles and more count.
inline constexpr std::size_t kLeastCycles = 5;
inline constexpr std::size_t kCyclesOfIso9283 = 30;
std::vector<PoseAccuracy> pose_accuracy(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                                        const Calibration& c);

/// Deviations of lengths, m: the machine's less the measured one's, the drawing's and the calibrated machine's.
struct LengthErrors {
  std::size_t lengths = 0;
  double shortest = 0, longest = 0;
  double error_before = 0, error_after = 0;  ///< the largest in size, E as in ISO 10360-2
};
/// Of the rows that are distances (ball-bar); none where there are none.
std::optional<LengthErrors> length_errors(const std::vector<Measurement>& rows, const Calibration& c);

/// Points along a straight line: the range of the mean positional deviations along it (E of ISO 230-2:2014 3.16,
/// of one direction of approach).
struct LineErrors {
  std::size_t row = 0, points = 0;
  Vec3 from{0, 0, 0}, to{0, 0, 0};           ///< in M, m
  double error_before = 0, error_after = 0;  ///< m
};
/// Runs of five poses and more that follow one another on a straight line (to 0.05 mm of the drawing), in one sense.
std::vector<LineErrors> line_errors(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                                    const Calibration& c);

}  // namespace polypod::calibration
