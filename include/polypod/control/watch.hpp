// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Feedback from the joints (JEL 7.4): where the tip really is beside its command, and what explains the difference.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::control {

using machine::AnyMachine;
using machine::JointVector;

/// A row of a record: command and joints of the same instant.
struct RecordRow {
  double time = 0;       ///< s
  int line = 0;          ///< of the program; 0: none is known
  Pose command;          ///< X_MT as the record has it: x_mm .. c_deg
  bool oriented = true;  ///< it has the angles that the machine is commanded
  JointVector joints;    ///< rad or m
};

/// Reads rows of a record one by one, as they come: `time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,...` in any order;
/// `line` and angles may be left out (0).
class RecordReader {
 public:
  /// `header`: the first line. Errors: LC120 a column that is missing, is there twice, or a joint that the machine has
  /// and the record has not (or the other way round).
  static Result<RecordReader> of(const AnyMachine& machine, const std::string& header, const std::string& path);
  /// Errors: LC121 a cell that is no finite number, a row that is too short, a time that does not rise.
  Result<RecordRow> row(const std::string& text);
  /// Columns that nobody asked for.
  [[nodiscard]] const std::vector<std::string>& unused() const { return unused_; }

 private:
  std::string path_;
  std::vector<int> column_;  ///< of time, line, six coordinates and the joints; -1: not there
  std::vector<bool> turns_;
  std::size_t width_ = 0;
  machine::Task task_;
  int line_ = 1;
  std::optional<double> last_;
  std::vector<std::string> unused_;
};

/// All rows of a file. Errors: FI100, LC120, LC121; LC120 also where it has no rows.
Result<std::vector<RecordRow>> read_record(const AnyMachine& machine, const std::string& path,
                                           std::vector<std::string>* unused = nullptr);

/// A place of the tip in M that an instrument measured.
struct MeasuredTip {
  double time = 0;  ///< s, of its own clock
  Vec3 p_M = Vec3::Zero();
};
/// time_s,x_mm,y_mm,z_mm. Errors: FI100, ID100 and others of csv::Table, LC122 a time that does not rise, LC123 fewer
/// than three rows.
Result<std::vector<MeasuredTip>> read_measured_tips(const std::string& path,
                                                    std::vector<std::string>* unused = nullptr);

/// The deflection of the tip that is expected at an instant of the record.
struct ExpectedBend {
  double time = 0;  ///< s, rising
  Vec3 delta_M = Vec3::Zero();
};

/// What stands in the folder of an exported configuration.
struct ExportedMachine {
  AnyMachine machine;
  double acceleration = 0;  ///< m/s^2, least of the axes X, Y and Z; 0: not said
  double velocity = 0;      ///< m/s, largest along the path; 0: not said
};
/// Errors: LC110, and those of machine::load.
Result<ExportedMachine> exported_machine(const std::string& folder);

/// One instant. All in M, m.
struct WatchPoint {
  double time = 0;
  int line = 0;
  bool known = false;  ///< the joints are a pose of the machine, within their ranges, and can have come there
  Vec3 command = Vec3::Zero();
  Vec3 drives = Vec3::Zero();    ///< forward(q) - command: joints that do not follow, and the controller's own figures
  Vec3 geometry = Vec3::Zero();  ///< forward of the calibrated machine less that of the nominal one
  Vec3 compliance = Vec3::Zero();  ///< the expected deflection
  std::optional<Vec3> measured;    ///< measured tip - command
  double turn = 0;                 ///< rad, by which the tool is turned from its command (about axes that the task has)
  Vec3 along = Vec3::Zero();       ///< unit direction of the commanded motion; 0 where it stands

  /// The sum of what is modelled.
  [[nodiscard]] Vec3 modelled() const { return drives + geometry + compliance; }
  /// What is judged: the measured deviation where there is one, else the modelled.
  [[nodiscard]] Vec3 deviation() const { return measured.value_or(modelled()); }
};

struct WatchOptions {
  const AnyMachine* calibrated = nullptr;  ///< the machine as it really is; null: not known
  /// The expected deflection over time, from the points as far as they are known then (drives and geometry); not set:
  /// not known. Its errors end `watch`.
  std::function<Result<std::vector<ExpectedBend>>(const std::vector<WatchPoint>&)> bends;
  std::vector<MeasuredTip> measured;  ///< empty: none
  std::optional<double> shift;        ///< s, record time less time of the instrument; empty: estimated
  double shift_range = 5;             ///< s, to each side of 0, where it is estimated
  double warn = 0;                    ///< m; 0: no limit
  std::function<bool(double)> progress = [](double) { return true; };
};

/// One cause, over the points that were measured (all points without a measurement).
struct WatchPart {
  std::string name;                ///< "drives", "geometry", "compliance"
  bool given = false;              ///< what it needs was given
  double rms = 0, largest = 0;     ///< m
  std::optional<double> rms_left;  ///< m, of the measured deviation less this part and those before it
};

struct WatchLine {
  int line = 0;
  double from = 0, seconds = 0;
  std::size_t points = 0, not_judged = 0;
  double largest = 0, rms = 0;   ///< m, of the deviation
  double across = 0, along = 0;  ///< m, largest part of it across and along the motion
  double at = 0;                 ///< s, of the largest
};

/// A stretch of time in which the deviation is beyond the limit.
struct WatchWarning {
  double from = 0, to = 0;  ///< s
  int line = 0;             ///< where it begins
  double first = 0;         ///< m, where it begins
  double largest = 0;       ///< m
  int largest_line = 0;
};

struct Watch {
  std::vector<WatchPoint> points;
  std::vector<WatchPart> parts;  ///< drives, geometry, compliance
  std::vector<WatchLine> lines;  ///< in order of their first instant; a line that comes again counts on
  std::vector<WatchWarning> warnings;
  double largest = 0, rms = 0;  ///< m, of the deviation
  double largest_time = 0;
  int largest_line = 0;
  std::size_t judged = 0;   ///< points of which the deviation is known
  std::size_t no_pose = 0;  ///< points whose joints are no pose of the machine
  double no_pose_time = 0;  ///< s, of the first
  std::string no_pose_why;
  std::size_t not_measured = 0;           ///< points outside of the measurement
  double measured_rms = 0;                ///< m, of the measured deviation
  double left_rms = 0, left_largest = 0;  ///< m, of the measured deviation less the modelled one
  Vec3 left_mean = Vec3::Zero();          ///< m: another origin of the instrument, or an offset
  double shift = 0;                       ///< s
  bool shift_estimated = false;
  double shift_uncertainty = 0;  ///< s, standard, of white noise
  JointVector follow;            ///< rad or m, joints less those of the command, where `drives` is largest; empty: none
  double follow_time = 0;
  double turn_largest = 0, turn_time = 0;  ///< rad, and when
  int turn_line = 0;
};

/// The deviation of the tip from its command at every row, its parts, and where it is beyond the limit.
///
/// deviation = measured - command = (forward(q) - command) [drives] + (forward_calibrated(q) - forward(q)) [geometry]
/// + C F [compliance] + what remains. A part whose input is not given is 0 and named as such. The measurement is
/// interpolated linearly at the rows; gaps of more than five of its usual steps are not covered.
///
/// The shift between the clocks is that of the least variance of measured - modelled (any constant offset of the
/// instrument does not count), in steps of 10 ms over the range, then to a microsecond. A constant lag of the machine
/// behind the joints cannot be separated from it. Its standard uncertainty is that of white noise,
/// s / sqrt(sum |v|^2).
///
/// Errors: LC124 the shift cannot be estimated (the tip hardly moves, the best one lies at the end of the range, or the
/// two have less than half of the measurement in common), LC125 no row within the measurement, LC119 interrupted.
/// Cost: a forward kinematics a row (two with a calibrated machine).
Result<Watch> watch(const AnyMachine& machine, const std::vector<RecordRow>& rows, const WatchOptions& options);

/// The deviation forward(q) - command of rows as they come; begins and ends of stretches beyond the limit.
class LiveWatch {
 public:
  /// `warn`: m; `warn_turn`: rad, of the orientation.
  LiveWatch(const AnyMachine& machine, const AnyMachine* calibrated, double warn, double warn_turn)
      : machine_(machine), calibrated_(calibrated), warn_(warn), warn_turn_(warn_turn) {}
  struct Seen {
    WatchPoint point;
    bool begins = false, ends = false;  ///< a stretch beyond the limit; a row whose joints are no pose counts as beyond
    double largest = 0;                 ///< m, of the stretch
    std::string why;                    ///< why the joints are no pose, where they are none
  };
  Seen see(const RecordRow& row);
  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t no_pose() const { return no_pose_; }
  [[nodiscard]] std::size_t stretches() const { return stretches_; }
  [[nodiscard]] double largest() const { return largest_; }
  [[nodiscard]] double turn_largest() const { return turn_largest_; }

 private:
  const AnyMachine& machine_;
  const AnyMachine* calibrated_;
  double warn_, warn_turn_;
  double turn_largest_ = 0;
  std::optional<RecordRow> before_;
  bool beyond_ = false;
  double stretch_largest_ = 0, largest_ = 0, inside_since_ = 0;
  std::size_t rows_ = 0, no_pose_ = 0, stretches_ = 0;
};

}  // namespace polypod::control
