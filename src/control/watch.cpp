// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/control/watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <numbers>

#include "polypod/core/csv.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/golden_section.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/forward_near.hpp"
#include "polypod/machine/assumed.hpp"

namespace polypod::control {
namespace {

namespace fs = std::filesystem;
using machine::JointKind;
using machine::Task;
using units::from_deg;
using units::from_mm;

constexpr std::array<const char*, 8> kNames{"time_s", "line", "x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"};
constexpr std::size_t kCoordinates = kNames.size();
constexpr double kLineMost = 2147483647.0;
constexpr const char* kRecordHint = "`polypod record` writes time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,...";
/// Two stretches beyond the limit with less time between them are one, s.
constexpr double kOneStretch = 0.1;
/// A gap of the measurement of more than so many of its usual steps is not bridged.
constexpr double kGap = 5;
/// The first search for a shift, s, and how exactly it is found then.
constexpr double kShiftStep = 0.01, kShiftWithin = 1e-6;
/// A shift that is less certain than this says nothing, s.
constexpr double kShiftCertain = 0.01;
constexpr std::size_t kShiftPoints = 400;

std::vector<std::string> cells_of(const std::string& text) {
  std::vector<std::string> out;
  std::size_t begin = 0;
  for (;;) {
    const std::size_t comma = text.find(',', begin);
    std::string cell = text.substr(begin, comma == std::string::npos ? comma : comma - begin);
    while (!cell.empty() && (cell.back() == ' ' || cell.back() == '\r' || cell.back() == '\t')) cell.pop_back();
    cell.erase(0, std::min(cell.find_first_not_of(" \t"), cell.size()));
    out.push_back(std::move(cell));
    if (comma == std::string::npos) return out;
    begin = comma + 1;
  }
}

std::optional<double> number_in(const std::string& cell) {
  double value = 0;
  const char* end = cell.data() + cell.size();
  const auto [at, error] = std::from_chars(cell.data(), end, value);
  if (error != std::errc() || at != end || !std::isfinite(value)) return {};
  return value;
}

/// By how much the tool is turned from its command, about axes that the machine prescribes.
double turn_between(const Task& task, const Mat3& command, const Mat3& is) {
  using machine::Coordinate;
  const bool a = task.holds(Coordinate::a), b = task.holds(Coordinate::b), c = task.holds(Coordinate::c);
  if (a && b && c) return rotation_vector(command.transpose() * is).norm();
  if (a && b) return angle_between(command.col(2), is.col(2));
  // What follows is not commanded: each angle that is by itself.
  constexpr double kTurn = 2 * std::numbers::pi;
  const Vec3 off = angles_abc(is) - angles_abc(command);
  double out = 0;
  for (int k = 0; k < 3; ++k)
    if (std::array{a, b, c}[static_cast<std::size_t>(k)]) out = std::max(out, std::abs(std::remainder(off[k], kTurn)));
  return out;
}

/// Why no machine has these joints: one is outside of its range, or cannot have come there since a row before.
std::string impossible(const AnyMachine& machine, const RecordRow& row, const RecordRow* before) {
  constexpr double kBeyond = 1e-4;                           // rad or m: drives overshoot the ends of their ranges
  constexpr double kFar = 0.5, kShare = 0.1, kFastest = 50;  // rad; of the range; rad/s or m/s, above every drive
  const bool assumed = machine::limits_are_assumed(machine);
  for (int i = 0; i < static_cast<int>(row.joints.size()); ++i) {
    const bool turns = kinematics::joint_kind(machine, i) == JointKind::revolute;
    const auto shown = [&](double x) { return turns ? units::to_deg(x) : units::to_mm(x); };
    const machine::JointRange range = kinematics::joint_range(machine, i);
    const double q = row.joints[i];
    if (!assumed && !(q >= range.min - kBeyond && q <= range.max + kBeyond)) {
      return fmt::format("joint {} at {:.9g} {} is outside of its range of {:.6g} to {:.6g}", i + 1, shown(q),
                         turns ? "deg" : "mm", shown(range.min), shown(range.max));
    }
    if (before == nullptr) continue;
    const double change = std::abs(q - before->joints[i]);
    const double far = turns ? kFar : kShare * (range.max - range.min);
    if (change > far && change > kFastest * (row.time - before->time)) {
      return fmt::format("joint {} jumps by {:.3g} {} within {:.2g} s", i + 1, shown(change), turns ? "deg" : "mm",
                         row.time - before->time);
    }
  }
  return {};
}

/// What the joints say of one row.
WatchPoint point_of(const AnyMachine& machine, const AnyMachine* calibrated, const RecordRow& row,
                    const RecordRow* before, std::string* why) {
  WatchPoint out;
  out.time = row.time;
  out.line = row.line;
  out.command = row.command.p;
  if (std::string reason = impossible(machine, row, before); !reason.empty()) {
    if (why != nullptr) *why = std::move(reason);
    return out;
  }
  const kinematics::ForwardResult found = kinematics::forward_near(machine, row.joints, row.command);
  if (found.poses.empty()) {
    if (why != nullptr) *why = found.reason;
    return out;
  }
  const Pose& X = found.poses.front();
  out.drives = X.p - row.command.p;
  if (row.oriented) out.turn = turn_between(kinematics::task(machine), row.command.R, X.R);
  if (calibrated != nullptr) {
    const kinematics::ForwardResult really = kinematics::forward_near(*calibrated, row.joints, X);
    if (really.poses.empty()) {
      if (why != nullptr) *why = "of the calibrated machine: " + really.reason;
      return out;
    }
    out.geometry = really.poses.front().p - X.p;
  }
  out.known = true;
  return out;
}

/// A series of places over time, by linear interpolation.
template <class Item, class Place>
std::optional<Vec3> at_time(const std::vector<Item>& series, double t, double longest_gap, Place place) {
  const auto after =
      std::lower_bound(series.begin(), series.end(), t, [](const Item& item, double time) { return item.time < time; });
  if (after == series.end()) return {};
  if (after->time == t) return place(*after);
  if (after == series.begin()) return {};
  const Item& b = *after;
  const Item& a = *(after - 1);
  if (b.time - a.time > longest_gap) return {};
  const double s = (t - a.time) / (b.time - a.time);
  return Vec3((1 - s) * place(a) + s * place(b));
}

double usual_step(const std::vector<MeasuredTip>& measured) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < measured.size(); ++i) steps.push_back(measured[i].time - measured[i - 1].time);
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

struct Shift {
  double value = 0, uncertainty = 0;
};

/// The time shift of the least variance of measured - modelled.
Result<Shift> shift_of(const std::vector<WatchPoint>& points, const WatchOptions& options) {
  std::vector<WatchPoint> known;
  for (const WatchPoint& p : points)
    if (p.known) known.push_back(p);
  const auto tip = [](const WatchPoint& p) { return Vec3(p.command + p.modelled()); };
  const std::size_t stride = std::max<std::size_t>(1, options.measured.size() / kShiftPoints);
  struct Fit {
    double variance = std::numeric_limits<double>::infinity();
    std::size_t count = 0;
  };
  const std::size_t wanted = (options.measured.size() + stride - 1) / stride;
  const auto fit = [&](double shift) {
    Fit out;
    Vec3 mean = Vec3::Zero();
    double squares = 0;
    for (std::size_t i = 0; i < options.measured.size(); i += stride) {
      const MeasuredTip& m = options.measured[i];
      const auto model = at_time(known, m.time + shift, std::numeric_limits<double>::infinity(), tip);
      if (!model) continue;
      const Vec3 d = m.p_M - *model;
      ++out.count;
      const Vec3 step = d - mean;
      mean += step / static_cast<double>(out.count);
      squares += step.dot(d - mean);
    }
    if (2 * out.count >= wanted && out.count >= 3) out.variance = squares / static_cast<double>(out.count);
    return out;
  };
  const auto steps = static_cast<int>(std::ceil(options.shift_range / kShiftStep));
  Fit best;
  int where = 0;
  for (int k = 0; k <= 2 * steps; ++k) {
    const int at = (k % 2 == 0 ? 1 : -1) * ((k + 1) / 2);  // from 0 outwards: of equal fits the smallest shift
    if (!options.progress(0.5 * k / (2.0 * steps + 1))) return fail("LC119", "interrupted");
    const Fit here = fit(kShiftStep * at);
    if (here.variance < best.variance) {
      best = here;
      where = at;
    }
  }
  const std::string hint = "give --shift-ms, or another --shift-range-s; both must hold the same motion";
  if (!std::isfinite(best.variance)) {
    return fail(
        "LC124",
        fmt::format("with no time shift within {:g} s do record and measurement have half of the measurement in "
                    "common",
                    options.shift_range),
        {}, hint);
  }
  if (std::abs(where) == steps) {
    return fail("LC124", fmt::format("the best time shift lies at the end of the range of {:g} s", options.shift_range),
                {}, hint);
  }
  Shift out;
  out.value = golden_section([&](double s) { return fit(s).variance; }, kShiftStep * (where - 1),
                             kShiftStep * (where + 1), kShiftWithin);
  // White noise: sum over the points of |v|^2, with the mean velocity left out as the mean offset is.
  constexpr double kAround = 0.005;  // s
  Vec3 mean = Vec3::Zero();
  double squares = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < options.measured.size(); i += stride) {
    const double t = options.measured[i].time + out.value;
    const auto a = at_time(known, t - kAround, std::numeric_limits<double>::infinity(), tip);
    const auto b = at_time(known, t + kAround, std::numeric_limits<double>::infinity(), tip);
    if (!a || !b) continue;
    const Vec3 v = (*b - *a) / (2 * kAround);
    ++count;
    const Vec3 step = v - mean;
    mean += step / static_cast<double>(count);
    squares += step.dot(v - mean);
  }
  const double sigma = std::sqrt(fit(out.value).variance / 3);
  out.uncertainty = squares > 0 ? sigma / std::sqrt(squares) : std::numeric_limits<double>::infinity();
  // The steps of the search are no knowledge.
  out.uncertainty = std::max(out.uncertainty, kShiftWithin);
  if (!(out.uncertainty < kShiftCertain)) {
    return fail("LC124", "the tip hardly changes its motion: no time shift follows from it", {}, hint);
  }
  return out;
}

/// The sums of one line.
struct Sums {
  WatchLine line;
  double squares = 0;
};

/// `measured`: there is a measurement; what it does not cover is not judged, but warned of where the model is beyond.
void judge(Watch& w, bool measured, double warn) {
  std::vector<Sums> lines;
  std::map<int, std::size_t> index;
  double squares = 0;
  std::optional<double> inside_since;
  bool beyond = false;
  for (std::size_t k = 0; k < w.points.size(); ++k) {
    const WatchPoint& p = w.points[k];
    const auto [at, fresh] = index.try_emplace(p.line, lines.size());
    if (fresh) {
      lines.emplace_back();
      lines.back().line.line = p.line;
      lines.back().line.from = p.time;
    }
    Sums& of = lines[at->second];
    if (k + 1 < w.points.size()) of.line.seconds += w.points[k + 1].time - p.time;
    if (!p.known) {
      ++of.line.not_judged;
      continue;
    }
    const Vec3 d = p.deviation();
    const double size = d.norm(), along = std::abs(d.dot(p.along));
    if (measured && !p.measured) {
      ++of.line.not_judged;
    } else {
      ++w.judged;
      ++of.line.points;
      squares += d.squaredNorm();
      of.squares += d.squaredNorm();
      of.line.across = std::max(of.line.across, std::sqrt(std::max(0.0, d.squaredNorm() - along * along)));
      of.line.along = std::max(of.line.along, along);
      if (size > of.line.largest) {
        of.line.largest = size;
        of.line.at = p.time;
      }
      if (size > w.largest) {
        w.largest = size;
        w.largest_time = p.time;
        w.largest_line = p.line;
      }
    }
    if (!(warn > 0)) continue;
    if (size > warn) {
      const bool goes_on = beyond || (inside_since && p.time - *inside_since < kOneStretch);
      if (!goes_on) w.warnings.push_back({p.time, p.time, p.line, size, size, p.line});
      WatchWarning& now = w.warnings.back();
      now.to = p.time;
      if (size > now.largest) {
        now.largest = size;
        now.largest_line = p.line;
      }
      beyond = true;
    } else if (beyond) {
      beyond = false;
      inside_since = p.time;
    }
  }
  if (w.judged > 0) w.rms = std::sqrt(squares / static_cast<double>(w.judged));
  for (Sums& of : lines) {
    if (of.line.points > 0) of.line.rms = std::sqrt(of.squares / static_cast<double>(of.line.points));
    w.lines.push_back(of.line);
  }
}

void explain(Watch& w, const WatchOptions& options) {
  w.parts = {{"drives", true, 0, 0, {}},
             {"geometry", options.calibrated != nullptr, 0, 0, {}},
             {"compliance", static_cast<bool>(options.bends), 0, 0, {}}};
  const bool measured = !options.measured.empty();
  std::array<double, 3> squares{}, left_squares{};
  double measured_squares = 0;
  std::size_t count = 0;
  for (const WatchPoint& p : w.points) {
    if (!p.known || (measured && !p.measured)) continue;
    ++count;
    const std::array<const Vec3*, 3> parts{&p.drives, &p.geometry, &p.compliance};
    Vec3 left = p.measured.value_or(Vec3::Zero());
    if (measured) measured_squares += left.squaredNorm();
    for (std::size_t i = 0; i < parts.size(); ++i) {
      squares[i] += parts[i]->squaredNorm();
      w.parts[i].largest = std::max(w.parts[i].largest, parts[i]->norm());
      left -= *parts[i];
      left_squares[i] += left.squaredNorm();
    }
    if (measured) {
      w.left_largest = std::max(w.left_largest, left.norm());
      w.left_mean += (left - w.left_mean) / static_cast<double>(count);
    }
  }
  if (count == 0) return;
  const auto n = static_cast<double>(count);
  for (std::size_t i = 0; i < 3; ++i) {
    w.parts[i].rms = std::sqrt(squares[i] / n);
    if (measured) w.parts[i].rms_left = std::sqrt(left_squares[i] / n);
  }
  if (measured) {
    w.measured_rms = std::sqrt(measured_squares / n);
    w.left_rms = std::sqrt(left_squares[2] / n);
  }
}

/// The joints less those of the command, at the row where the drives leave it the farthest.
void follow(Watch& w, const AnyMachine& machine, const std::vector<RecordRow>& rows) {
  std::size_t worst = rows.size();
  double most = 1e-9;  // m: less is rounding of the record
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (!w.points[k].known || !(w.points[k].drives.norm() > most)) continue;
    most = w.points[k].drives.norm();
    worst = k;
  }
  if (worst == rows.size()) return;
  const auto found = kinematics::inverse_near(machine, rows[worst].command, rows[worst].joints);
  if (found.solutions.empty()) return;
  w.follow = rows[worst].joints - found.solutions.front().joints;
  w.follow_time = rows[worst].time;
}

}  // namespace

Result<RecordReader> RecordReader::of(const AnyMachine& machine, const std::string& header, const std::string& path) {
  RecordReader out;
  out.path_ = path;
  out.task_ = kinematics::task(machine);
  const int joints = kinematics::joint_count(machine);
  std::vector<std::string> wanted(kNames.begin(), kNames.end());
  for (int i = 0; i < joints; ++i) {
    wanted.push_back(fmt::format("q{}", i + 1));
    out.turns_.push_back(kinematics::joint_kind(machine, i) == JointKind::revolute);
  }
  out.column_.assign(wanted.size(), -1);
  const std::vector<std::string> cells = cells_of(header);
  out.width_ = cells.size();
  const Place place{path, 1, 1};
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const auto it = std::find(wanted.begin(), wanted.end(), cells[c]);
    if (it == wanted.end()) {
      const bool joint =
          cells[c].size() > 1 && cells[c][0] == 'q' && cells[c].find_first_not_of("0123456789", 1) == std::string::npos;
      if (joint) {
        return fail(
            "LC120",
            fmt::format("the record has a joint {}, but this machine has {} joints", one_line(cells[c]), joints), place,
            "give the machine that made the record");
      }
      out.unused_.push_back(cells[c]);
      continue;
    }
    int& column = out.column_[static_cast<std::size_t>(it - wanted.begin())];
    if (column >= 0) return fail("LC120", fmt::format("the column {} is there twice", *it), place, kRecordHint);
    column = static_cast<int>(c);
  }
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (out.column_[i] >= 0 || i == 1 || (i >= 5 && i < kCoordinates)) continue;
    return fail("LC120", fmt::format("no column {}", wanted[i]), place, kRecordHint);
  }
  return out;
}

Result<RecordRow> RecordReader::row(const std::string& text) {
  ++line_;
  const Place place{path_, line_, 1};
  const std::vector<std::string> cells = cells_of(text);
  if (cells.size() != width_) {
    return fail("LC121", fmt::format("a row of {} cells where {} columns are named", cells.size(), width_), place,
                kRecordHint);
  }
  std::vector<double> values(column_.size(), 0);
  for (std::size_t i = 0; i < column_.size(); ++i) {
    if (column_[i] < 0) continue;
    const std::string& cell = cells[static_cast<std::size_t>(column_[i])];
    const auto value = number_in(cell);
    if (!value) return fail("LC121", fmt::format("{}: not a finite number", one_line(cell)), place, kRecordHint);
    values[i] = *value;
  }
  RecordRow out;
  out.time = values[0];
  if (last_ && !(out.time > *last_)) {
    return fail("LC121", fmt::format("the time {:g} s follows {:g} s; it must rise", out.time, *last_), place,
                "each instant once, in order");
  }
  last_ = out.time;
  if (std::abs(values[1]) > kLineMost) return fail("LC121", "a line of a program that is none", place, kRecordHint);
  out.line = static_cast<int>(values[1]);
  std::vector<double> coordinates;
  for (int i = 0; i < task_.size(); ++i) {
    const double value = values[2 + static_cast<std::size_t>(task_[i])];
    coordinates.push_back(task_.is_angle(i) ? from_deg(value) : from_mm(value));
  }
  out.command = kinematics::pose_of(task_, coordinates);
  // What no pose prescribes stands in the record as it follows; the place of the tip is what is compared, and so are
  // the angles that the machine is commanded.
  for (int k = 0; k < 3; ++k) out.command.p[k] = from_mm(values[2 + static_cast<std::size_t>(k)]);
  out.oriented = task_.turns();
  for (int i = 0; i < task_.size(); ++i)
    if (task_.is_angle(i) && column_[2 + static_cast<std::size_t>(task_[i])] < 0) out.oriented = false;
  if (out.oriented) out.command.R = rotation_abc(from_deg(values[5]), from_deg(values[6]), from_deg(values[7]));
  out.joints.resize(static_cast<Eigen::Index>(turns_.size()));
  for (std::size_t i = 0; i < turns_.size(); ++i) {
    const double value = values[kCoordinates + i];
    out.joints[static_cast<Eigen::Index>(i)] = turns_[i] ? from_deg(value) : from_mm(value);
  }
  return out;
}

Result<std::vector<RecordRow>> read_record(const AnyMachine& machine, const std::string& path,
                                           std::vector<std::string>* unused) {
  POLYPOD_ASSIGN(text, files::read(path));
  std::vector<RecordRow> out;
  std::optional<RecordReader> reader;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string line = text.substr(begin, end - begin);
    begin = end + 1;
    if (!reader) {
      POLYPOD_ASSIGN(made, RecordReader::of(machine, line, path));
      reader = std::move(made);
      continue;
    }
    if (line.find_first_not_of(" \t\r") == std::string::npos && begin >= text.size()) break;
    POLYPOD_ASSIGN(row, reader->row(line));
    out.push_back(std::move(row));
  }
  if (out.empty()) return fail("LC120", "the record has no rows", {path, 1, 1}, kRecordHint);
  if (unused != nullptr) *unused = reader->unused();
  return out;
}

Result<std::vector<MeasuredTip>> read_measured_tips(const std::string& path, std::vector<std::string>* unused) {
  POLYPOD_ASSIGN(table, csv::read(path));
  POLYPOD_TRY(table.needs({"time_s", "x_mm", "y_mm", "z_mm"}));
  std::vector<MeasuredTip> out;
  for (const csv::Table::Row& row : table.rows) {
    MeasuredTip tip;
    POLYPOD_ASSIGN(time, table.number(row, "time_s"));
    tip.time = time;
    int k = 0;
    for (const char* name : {"x_mm", "y_mm", "z_mm"}) {
      POLYPOD_ASSIGN(value, table.number(row, name));
      tip.p_M[k++] = from_mm(value);
    }
    if (!out.empty() && !(tip.time > out.back().time)) {
      return fail("LC122", fmt::format("the time {:g} s follows {:g} s; it must rise", tip.time, out.back().time),
                  table.place_of(row), "each instant once, in order");
    }
    out.push_back(tip);
  }
  if (out.size() < 3) {
    return fail("LC123", fmt::format("{} measured places; must be three at least", out.size()), {path, 0, 0},
                "time_s,x_mm,y_mm,z_mm of the tip, in M");
  }
  POLYPOD_ASSIGN(others, table.unused());
  if (unused != nullptr) *unused = std::move(others);
  return out;
}

Result<ExportedMachine> exported_machine(const std::string& folder) {
  std::error_code error;
  std::vector<std::string> found;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".ini") found.push_back(entry.path().string());
  if (error || found.size() != 1) {
    return fail("LC110",
                error ? fmt::format("{} is no folder that can be read: {}", one_line(folder), error.message())
                      : fmt::format("{} holds {} INI files; must be one", one_line(folder), found.size()),
                {}, "give a folder that `polypod export linuxcnc MACHINE -o DIR` wrote");
  }
  ExportedMachine out;
  POLYPOD_ASSIGN(machine, machine::load((fs::path(folder) / "machine.toml").string()));
  out.machine = std::move(machine);
  POLYPOD_ASSIGN(text, files::read(found.front()));
  std::string section;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string line = text.substr(begin, end - begin);
    begin = end + 1;
    if (line.starts_with('[')) section = line.substr(1, line.find(']') - 1);
    const auto equals = line.find('=');
    if (equals == std::string::npos) continue;
    const std::string key = cells_of(line.substr(0, equals)).front();
    const auto value = number_in(cells_of(line.substr(equals + 1)).front());
    if (!value) continue;
    const bool axis = section == "AXIS_X" || section == "AXIS_Y" || section == "AXIS_Z";
    if ((axis && key == "MAX_ACCELERATION") || (section == "TRAJ" && key == "MAX_LINEAR_ACCELERATION")) {
      const double a = from_mm(*value);
      out.acceleration = out.acceleration > 0 ? std::min(out.acceleration, a) : a;
    }
    if (section == "TRAJ" && key == "MAX_LINEAR_VELOCITY") out.velocity = from_mm(*value);
  }
  return out;
}

Result<Watch> watch(const AnyMachine& machine, const std::vector<RecordRow>& rows, const WatchOptions& options) {
  Watch w;
  w.points.reserve(rows.size());
  const RecordRow* last = nullptr;  // the last one that can be
  constexpr double kBend = 0.1;     // s, between two points of the expected deflection; beyond the tool is in the air
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (k % 256 == 0 && !options.progress(0.5 * static_cast<double>(k) / static_cast<double>(rows.size())))
      return fail("LC119", "interrupted");
    std::string why;
    WatchPoint p = point_of(machine, options.calibrated, rows[k], last, &why);
    if (p.known) last = &rows[k];
    if (!p.known) {
      if (w.no_pose++ == 0) {
        w.no_pose_time = p.time;
        w.no_pose_why = why;
      }
    }
    const Vec3 way = rows[std::min(k + 1, rows.size() - 1)].command.p - rows[k > 0 ? k - 1 : 0].command.p;
    constexpr double kStands = 1e-9;  // m
    if (way.norm() > kStands) p.along = way.normalized();
    if (p.known && p.turn > w.turn_largest) {
      w.turn_largest = p.turn;
      w.turn_time = p.time;
      w.turn_line = p.line;
    }
    w.points.push_back(p);
  }
  if (options.bends) {
    POLYPOD_ASSIGN(bends, options.bends(w.points));
    for (WatchPoint& p : w.points) {
      p.compliance =
          at_time(bends, p.time, kBend, [](const ExpectedBend& b) { return b.delta_M; }).value_or(Vec3::Zero());
    }
  }
  if (!options.measured.empty()) {
    if (options.shift) {
      w.shift = *options.shift;
    } else {
      POLYPOD_ASSIGN(shift, shift_of(w.points, options));
      w.shift = shift.value;
      w.shift_uncertainty = shift.uncertainty;
      w.shift_estimated = true;
    }
    const double gap = kGap * usual_step(options.measured);
    std::size_t covered = 0;
    for (WatchPoint& p : w.points) {
      const auto tip = at_time(options.measured, p.time - w.shift, gap, [](const MeasuredTip& m) { return m.p_M; });
      if (tip) {
        p.measured = *tip - p.command;
        ++covered;
      } else {
        ++w.not_measured;
      }
    }
    if (covered == 0) {
      return fail("LC125",
                  fmt::format("with a time shift of {:.1f} ms no row of the record lies within the measurement",
                              w.shift / units::from_ms(1)),
                  {}, "the shift is the record's time less the instrument's; without it, it is estimated");
    }
  }
  explain(w, options);
  judge(w, !options.measured.empty(), options.warn);
  follow(w, machine, rows);
  return w;
}

LiveWatch::Seen LiveWatch::see(const RecordRow& row) {
  Seen out;
  out.point = point_of(machine_, calibrated_, row, before_ ? &*before_ : nullptr, &out.why);
  if (out.point.known) before_ = row;
  ++rows_;
  if (!out.point.known) ++no_pose_;
  const double size = out.point.deviation().norm();
  if (out.point.known) {
    largest_ = std::max(largest_, size);
    turn_largest_ = std::max(turn_largest_, out.point.turn);
  }
  if (!(warn_ > 0)) return out;
  if (!out.point.known || size > warn_ || out.point.turn > warn_turn_) {
    if (!beyond_) {
      ++stretches_;
      out.begins = true;
      stretch_largest_ = 0;
    }
    beyond_ = true;
    inside_since_ = row.time;
    if (out.point.known) stretch_largest_ = std::max(stretch_largest_, size);
  } else if (beyond_ && row.time - inside_since_ >= kOneStretch) {
    beyond_ = false;
    out.ends = true;
  }
  out.largest = stretch_largest_;
  return out;
}

}  // namespace polypod::control
