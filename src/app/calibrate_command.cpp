// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <tuple>

#include "calibration_options.hpp"
#include "certificate_output.hpp"
#include "commands.hpp"
#include "polypod/calibration/calibrate.hpp"
#include "polypod/core/csv.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/pages/calibration.hpp"
#include "quality_files.hpp"

namespace polypod::app {

Result<Pose> frame_argument(const std::string& text, const char* option) {
  if (text.empty()) return Pose{};
  POLYPOD_ASSIGN(n, numbers_of(text, option));
  if (n.size() != 3 && n.size() != 6) {
    return fail("AP180", fmt::format("{} {}: not three or six numbers", option, text), {}, "x,y,z or x,y,z,A,B,C");
  }
  n.resize(6, 0);
  return Pose{rotation_abc(units::from_deg(n[3]), units::from_deg(n[4]), units::from_deg(n[5])),
              units::from_mm(1) * Vec3(n[0], n[1], n[2])};
}

Result<std::vector<Vec3>> points_of(const std::vector<std::string>& texts, const char* option) {
  std::vector<Vec3> out;
  for (const std::string& text : texts) {
    POLYPOD_ASSIGN(n, numbers_of(text, option));
    if (n.size() != 3) return fail("AP180", fmt::format("{} {}: not three numbers", option, text));
    out.push_back(units::from_mm(1) * Vec3(n[0], n[1], n[2]));
  }
  return out;
}

namespace {

using calibration::Calibration;

constexpr std::array<std::pair<std::string_view, calibration::Loss>, 4> kLosses{{{"auto", calibration::Loss::automatic},
                                                                                 {"huber", calibration::Loss::huber},
                                                                                 {"cauchy", calibration::Loss::cauchy},
                                                                                 {"none", calibration::Loss::none}}};

struct Options {
  std::string machine, out, frame, target, residuals, covariance, targets, corrected, report, join, certificate,
      certificate_report, loss = "auto";
  std::vector<std::string> sets, files, estimate, only, hold, columns;
  double noise_um = 20, noise_deg = 0.002, prior_mm = 0, prior_deg = 0, bound_mm = 0, bound_deg = 0, hold_back = 20;
};

std::string with_unit(const std::string& key, const std::string& unit) {
  return unit.empty() ? key : key + "_" + unit;
}
/// mm or deg of `other` a mm or deg of `held`.
double factor_for_user(const calibration::Estimate& held, const calibration::Like& other) {
  return other.factor * units::to_user(1, other.unit) / units::to_user(1, held.unit);
}

Result<calibration::CalibrationOptions> options_of(const Options& o) {
  calibration::CalibrationOptions out;
  out.only = o.only;
  out.hold = o.hold;
  for (const std::string& what : o.estimate) {
    if (what != "frame" && what != "target" && what != "scale") {
      return fail("AP183", fmt::format("--estimate {}: not frame, target or scale", what));
    }
    (what == "frame" ? out.estimate_frame : what == "target" ? out.estimate_target : out.estimate_scale) = true;
  }
  const auto* loss = std::find_if(kLosses.begin(), kLosses.end(), [&](const auto& l) { return l.first == o.loss; });
  if (loss == kLosses.end()) return fail("AP183", fmt::format("--loss {}: not auto, huber, cauchy or none", o.loss));
  out.loss = loss->second;
  POLYPOD_ASSIGN(X_SM, frame_argument(o.frame, "--frame"));
  POLYPOD_ASSIGN(X_TR, frame_argument(o.target, "--target"));
  out.X_SM = X_SM;
  out.X_TR = X_TR;
  out.noise_position = units::from_um(o.noise_um);
  out.noise_angle = units::from_deg(o.noise_deg);
  out.prior_length = units::from_mm(o.prior_mm);
  out.prior_angle = units::from_deg(o.prior_deg);
  out.bound_length = units::from_mm(o.bound_mm);
  out.bound_angle = units::from_deg(o.bound_deg);
  out.hold_back = o.hold_back / 100;
  return out;
}

/// Errors: AP107 where an option about angles stands with rows or a machine that have none.
Status check_angles(const Context& context, const machine::AnyMachine& m,
                    const std::vector<calibration::Measurement>& rows) {
  using calibration::Kind;
  if (std::none_of(rows.begin(), rows.end(),
                   [](const auto& r) { return r.kind == Kind::axis || r.kind == Kind::pose; }))
    POLYPOD_TRY(refuse(context, {"--noise-deg"}, "it serves axes and poses; these rows hold no angle"));
  const std::vector<machine::Parameter> parameters = kinematics::parameters(m);
  if (std::all_of(parameters.begin(), parameters.end(), [](const auto& p) { return p.unit == "mm"; }))
    POLYPOD_TRY(refuse(context, {"--prior-deg", "--bound-deg"},
                       "it serves machines with angles or directions; all parameters of this one are lengths"));
  return {};
}

std::string command_line(const Options& o) {
  const Options usual;
  std::string out = "polypod calibrate " + for_shell(o.machine);
  for (const std::string& file : o.files) out += " " + for_shell(file);
  const auto texts = [&](const char* name, const std::vector<std::string>& values) {
    for (const std::string& value : values) out += option_in_words(name, value);
  };
  const auto value = [&](const char* name, double Options::*what) {
    if (o.*what != usual.*what) out += fmt::format(" {} {}", name, o.*what);
  };
  texts("--set", o.sets);
  texts("--columns", o.columns);
  out += option_in_words("--join", o.join);
  texts("--estimate", o.estimate);
  out += option_in_words("--frame", o.frame) + option_in_words("--target", o.target);
  texts("--parameter", o.only);
  texts("--hold", o.hold);
  value("--noise-um", &Options::noise_um);
  value("--noise-deg", &Options::noise_deg);
  value("--prior-mm", &Options::prior_mm);
  value("--prior-deg", &Options::prior_deg);
  value("--bound-mm", &Options::bound_mm);
  value("--bound-deg", &Options::bound_deg);
  if (o.loss != usual.loss) out += option_in_words("--loss", o.loss);
  value("--hold-back", &Options::hold_back);
  return out + option_in_words("-o", o.out) + option_in_words("--residuals", o.residuals) +
         option_in_words("--covariance", o.covariance) + option_in_words("--targets", o.targets) +
         option_in_words("--corrected", o.corrected) + option_in_words("--report", o.report) +
         option_in_words("--certificate", o.certificate) +
         option_in_words("--certificate-report", o.certificate_report);
}

/// What the files hold.
struct ReadRows {
  std::vector<calibration::Measurement> rows;
  std::vector<std::string> unused_columns, not_joined;
};

Result<ReadRows> rows_of(const Options& o, const machine::AnyMachine& m) {
  ReadRows out;
  POLYPOD_ASSIGN(columns, csv::columns_of(o.columns));
  std::vector<csv::Table> tables;
  for (const std::string& file : o.files) {
    POLYPOD_ASSIGN(table, csv::read(file, columns, o.join.empty() ? csv::Absent::refused : csv::Absent::left));
    tables.push_back(std::move(table));
  }
  if (!o.join.empty()) {
    POLYPOD_ASSIGN(one, csv::joined(tables, o.join, out.not_joined));
    tables = {std::move(one)};
  }
  for (const csv::Table& table : tables) {
    POLYPOD_ASSIGN(more, calibration::read_measurements(m, table));
    out.rows.insert(out.rows.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
    POLYPOD_ASSIGN(unused, table.unused());
    for (std::string& name : unused) {
      const bool known =
          std::find(out.unused_columns.begin(), out.unused_columns.end(), name) != out.unused_columns.end();
      if (!known && name != o.join) out.unused_columns.push_back(std::move(name));
    }
  }
  return out;
}

/// What went into the calibration.
Result<std::vector<pages::HashedFile>> hashes_of(const Options& o, const machine::AnyMachine& nominal) {
  std::vector<pages::HashedFile> out;
  std::vector<std::pair<std::string, std::string>> inputs{{"machine, drawing", o.machine}};
  for (const std::string& file : o.files) inputs.emplace_back("readings", file);
  if (!o.certificate.empty()) inputs.emplace_back("statement", o.certificate);
  for (const auto& [role, path] : inputs) {
    POLYPOD_ASSIGN(one, hashed_file(role, path));
    out.push_back(std::move(one));
  }
  if (!o.sets.empty()) out.push_back(hashed_bytes("drawing with --set", o.machine, machine::to_toml(nominal)));
  return out;
}

std::vector<std::string> notes_of(const ReadRows& read, const std::string& join) {
  constexpr std::size_t kMost = 8;
  std::vector<std::string> notes;
  if (!read.unused_columns.empty()) {
    notes.push_back(fmt::format("not read: the columns {}", fmt::join(read.unused_columns, ", ")));
  }
  if (const std::size_t n = read.not_joined.size(); n > 0) {
    const std::vector<std::string> first(read.not_joined.begin(), read.not_joined.begin() + long(std::min(n, kMost)));
    notes.push_back(fmt::format("left out, as not all files have this {}: {}{}", join, fmt::join(first, ", "),
                                n > kMost ? fmt::format(" and {} more", n - kMost) : ""));
  }
  return notes;
}

/// Poses of a file (x_mm, y_mm, z_mm and the angles of the task) as commands for the nominal machine.
Result<std::string> corrected_targets(const machine::AnyMachine& nominal, const machine::AnyMachine& real,
                                      const std::string& path, std::size_t& missed) {
  POLYPOD_ASSIGN(table, csv::read(path));
  POLYPOD_TRY(table.needs({"x_mm", "y_mm", "z_mm"}));
  std::string out = "x_mm,y_mm,z_mm,a_deg,b_deg,c_deg";
  for (int i = 0; i < kinematics::joint_count(nominal); ++i) out += fmt::format(",q{}", i + 1);
  out += ",reached\n";
  for (const csv::Table::Row& row : table.rows) {
    std::vector<double> c;
    for (const char* name : {"x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"}) {
      POLYPOD_ASSIGN(value, table.number(row, name, 0));
      c.push_back(c.size() < 3 ? units::from_mm(value) : units::from_deg(value));
    }
    const Pose wanted = kinematics::pose_of(kinematics::task(nominal), c);
    const calibration::CorrectedTarget found = calibration::corrected_target(nominal, real, wanted);
    std::vector<double> numbers = pose_for_user(nominal, found.reached ? found.command : wanted);
    numbers.resize(6, 0);
    for (std::size_t i = 0; i < numbers.size(); ++i) out += fmt::format("{}{:.6f}", i == 0 ? "" : ",", numbers[i]);
    for (int i = 0; i < kinematics::joint_count(nominal); ++i) {
      out += found.reached ? fmt::format(",{:.6f}", joints_for_user(nominal, found.joints)[std::size_t(i)]) : ",";
    }
    out += found.reached ? ",1\n" : ",0\n";
    missed += found.reached ? 0 : 1;
  }
  return out;
}

/// Lengths of the residuals' vectors, and each component with its sign, computed less measured: of a row with x, y, z
/// in um and with angles in deg (axes: across the measured one), of another its reading in um.
std::string residuals_csv(const Calibration& c, const std::vector<calibration::Measurement>& rows) {
  std::string out = "file,line,kind,held_back,outlier,weight,before_um,after_um";
  for (const char* when : {"before", "after"})
    for (const char* what : {"x_um", "y_um", "z_um", "a_deg", "b_deg", "c_deg", "reading_um"})
      out += fmt::format(",{}_{}", when, what);
  out += '\n';
  for (const calibration::RowResidual& r : c.residuals) {
    const calibration::Measurement& row = rows[r.row];
    out += fmt::format("{},{},{},{:d},{:d},{:.4g},{:.4g},{:.4g}", row.place.file, row.place.line,
                       calibration::name_of(row.kind), r.held_back, r.outlier, r.weight,
                       units::to_um(r.before.head(r.lengths).norm()), units::to_um(r.after.head(r.lengths).norm()));
    for (const Eigen::VectorXd* part : {&r.before, &r.after}) {
      const bool reading = r.lengths == 1;
      for (Eigen::Index k = 0; k < 6; ++k) {
        const bool there = !reading && k < part->size();
        out += there ? fmt::format(",{:.4g}", k < 3 ? units::to_um((*part)[k]) : units::to_deg((*part)[k])) : ",";
      }
      out += reading ? fmt::format(",{:.4g}", units::to_um((*part)[0])) : ",";
    }
    out += '\n';
  }
  return out;
}

/// The covariance of all parameters of the machine, in their units (a square for lengths: mm^2).
struct Covariance {
  std::vector<std::string> keys;
  Eigen::MatrixXd values;
};
Covariance covariance_of(const machine::AnyMachine& nominal, const Calibration& c) {
  Covariance out;
  const std::vector<machine::Parameter> all = kinematics::parameters(nominal);
  Eigen::VectorXd scale(std::ssize(all));
  for (std::size_t i = 0; i < all.size(); ++i) {
    out.keys.push_back(with_unit(all[i].key, all[i].unit));
    scale[static_cast<Eigen::Index>(i)] = units::to_user(1, all[i].unit);
  }
  out.values = scale.asDiagonal() * c.covariance * scale.asDiagonal();
  return out;
}
std::string covariance_csv(const Covariance& c) {
  std::string out = "parameter";
  for (const std::string& key : c.keys) out += "," + key;
  out += '\n';
  for (std::size_t i = 0; i < c.keys.size(); ++i) {
    out += c.keys[i];
    for (const double value : c.values.row(static_cast<Eigen::Index>(i))) out += fmt::format(",{:.6g}", value);
    out += '\n';
  }
  return out;
}
Json covariance_json(const Covariance& c) {
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < c.values.rows(); ++i)
    rows.push_back(std::vector<double>(c.values.row(i).begin(), c.values.row(i).end()));
  return {{"keys", c.keys}, {"matrix", rows}};
}

/// A chance, to no more digits than hold.
std::string shown_chance(double p) {
  return p < 1e-3 ? std::string("below 0.001") : fmt::format("{:.3f}", p);
}
constexpr double kUnlikely = 0.01;

/// Of chi-square against the noise that was stated: whether chance explains it.
std::string chi_square_verdict(const Calibration& c) {
  if (c.chi_square_p < kUnlikely) return "above";
  return c.chi_square_p > 1 - kUnlikely ? "below" : "agrees";
}
Json chi_square_json(const Calibration& c, bool stated) {
  Json out{{"value", c.chi_square},
           {"degrees_of_freedom", c.free_equations},
           {"p_value", c.chi_square_p},
           {"noise_stated", stated}};
  out["verdict"] = stated ? Json(chi_square_verdict(c)) : Json();
  return out;
}

Json common_json(const Calibration& c) {
  Json out = Json::array();
  for (const calibration::CommonChange& one : c.tried) {
    Json trial{{"what", one.what}, {"explains", one.alone}, {"fitted", one.fitted}, {"likely", one.likely}};
    if (one.fitted) {
      trial["change_over_priors"] = one.change;
      trial["change_over_priors_without"] = one.change_before;
      if (one.what == "scale") {
        trial["scale"] = one.scale;
      } else {
        trial["shift_mm"] = vector_json(one.shift * units::kMmPerMetre);
        trial["turn_deg"] = vector_json(one.turn / units::kRadPerDeg);
      }
    }
    out.push_back(std::move(trial));
  }
  return out;
}

Json drift_json(const calibration::Drift& d) {
  Json list = Json::array();
  for (const calibration::ComponentDrift& one : d.components) {
    Json item{{"component", one.component}, {"over", one.over},
              {"points", one.points},       {"t", one.t},
              {"p_value", one.trend_p},     {"trend_found", one.trend_found}};
    item[one.is_angle ? "trend_deg" : "trend_um"] = one.is_angle ? units::to_deg(one.trend) : units::to_um(one.trend);
    if (one.over != "temperature") {
      item["lag1"] = one.lag1;
      item["lag1_p_value"] = one.lag1_p;
      item["lag1_found"] = one.lag1_found;
    }
    list.push_back(std::move(item));
  }
  return {{"looked_for", d.looked}, {"found", d.found}, {"level_of_each", d.level}, {"components", list}};
}

Json repeats_json(const calibration::Repeats& r) {
  return {{"rows", r.rows},
          {"poses", r.poses},
          {"within_over_noise", r.within},
          {"between_over_noise", r.between},
          {"F", r.F},
          {"degrees_of_freedom", Json::array({r.between_degrees, r.within_degrees})},
          {"p_value", r.p_value},
          {"correlation", r.correlation}};
}

Json parameters_json(const Calibration& c) {
  Json out = Json::array();
  for (const calibration::Estimate& p : c.parameters) {
    Json one{{"key", with_unit(p.key, p.unit)},
             {"nominal", units::to_user(p.nominal, p.unit)},
             {"value", units::to_user(p.value, p.unit)},
             {"standard_error", units::to_user(p.standard_error, p.unit)},
             {"standard_error_readings", units::to_user(p.standard_error_readings, p.unit)},
             {"half_interval_95", p.student * units::to_user(p.standard_error, p.unit)},
             {"identifiable", p.identifiable},
             {"at_bound", p.at_bound}};
    if (!p.identifiable) {
      Json like = Json::array();
      for (const calibration::Like& other : p.like)
        like.push_back({{"key", with_unit(other.key, other.unit)}, {"factor", factor_for_user(p, other)}});
      one["like"] = like;
    }
    out.push_back(one);
  }
  return out;
}

Json score_json(const calibration::Score& s) {
  return {{"rows", s.rows},
          {"outliers", s.outliers},
          {"rms_before_mm", units::to_mm(s.rms_before)},
          {"rms_after_mm", units::to_mm(s.rms_after)},
          {"rms_before_all_mm", units::to_mm(s.all_before)},
          {"rms_after_all_mm", units::to_mm(s.all_after)},
          {"max_after_mm", units::to_mm(s.max_after)},
          {"angle_before_deg", units::to_deg(s.angle_before)},
          {"angle_after_deg", units::to_deg(s.angle_after)}};
}

Json frame_json(const Pose& X, const Vec6& error) {
  const Vec3 p = X.p * units::kMmPerMetre, abc = angles_abc(X.R) / units::kRadPerDeg;
  return {{"pose", Json::array({p.x(), p.y(), p.z(), abc.x(), abc.y(), abc.z()})},
          {"standard_error_mm", vector_json(error.head<3>() * units::kMmPerMetre)},
          {"standard_error_deg", vector_json(error.tail<3>() / units::kRadPerDeg)}};
}

Json outliers_json(const Calibration& c, const std::vector<calibration::Measurement>& rows) {
  Json out = Json::array();
  for (const calibration::RowResidual& r : c.residuals) {
    if (!r.outlier) continue;
    out.push_back({{"file", rows[r.row].place.file},
                   {"line", rows[r.row].place.line},
                   {"residual_mm", units::to_mm(r.after.head(r.lengths).norm())},
                   {"weight", r.weight},
                   {"held_back", r.held_back},
                   {"lost", r.lost},
                   {"untaken", r.untaken}});
  }
  return out;
}

/// "x_mm" in mm or "a_deg" in deg of what is stored in m or rad.
double for_user(const std::string& coordinate, double value) {
  return coordinate.ends_with("_mm") ? units::to_mm(value) : units::to_deg(value);
}

Json spread_json(const std::vector<std::string>& coordinates, const calibration::PoseSpread& spread) {
  Json mean = Json::object(), max = Json::object();
  for (std::size_t i = 0; i < coordinates.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    mean[coordinates[i]] = for_user(coordinates[i], spread.mean[k]);
    max[coordinates[i]] = for_user(coordinates[i], spread.max[k]);
  }
  return {{"mean", mean}, {"max", max}};
}

/// What is known of the tool's pose after the calibration and, under `before`, without it.
Json pose_json(const Calibration& c) {
  const std::vector<std::string> coordinates = calibration::pose_coordinates(c.machine);
  Json out = spread_json(coordinates, c.verdict.after);
  out["before"] = spread_json(coordinates, c.verdict.before);
  out["without_systematic"] = spread_json(coordinates, c.verdict.after_readings);
  out["poses"] = c.verdict.poses;
  return out;
}

void print_pose(const Calibration& c) {
  const std::vector<std::string> coordinates = calibration::pose_coordinates(c.machine);
  fmt::print("\npredicted standard deviation of the tool's pose, over {} poses of the workspace\n", c.verdict.poses);
  fmt::print("{:<10} {:>12} {:>12} {:>12} {:>12}\n", "coordinate", "before, mean", "max", "after, mean", "max");
  const auto& [before, after] = std::tie(c.verdict.before, c.verdict.after);
  for (std::size_t i = 0; i < coordinates.size(); ++i) {
    const std::string& name = coordinates[i];
    const auto k = static_cast<Eigen::Index>(i);
    const auto shown = [&](double value) { return for_user(name, value); };
    const bool open =
        std::find(c.verdict.left_open.begin(), c.verdict.left_open.end(), name) != c.verdict.left_open.end();
    fmt::print("{:<10} {:12.5f} {:12.5f} {:12.5f} {:12.5f}{}\n", name, shown(before.mean[k]), shown(before.max[k]),
               shown(after.mean[k]), shown(after.max[k]), open ? "  left open" : "");
  }
}

void print_score(const char* what, const calibration::Score& s) {
  if (s.rows == 0) return;
  fmt::print("{:<10} {:4} rows, rms {:.4f} mm before, {:.4f} mm after, at most {:.4f} mm", what, s.rows,
             units::to_mm(s.rms_before), units::to_mm(s.rms_after), units::to_mm(s.max_after));
  if (s.angle_before > 0)
    fmt::print("; angles {:.4f} and {:.4f} deg", units::to_deg(s.angle_before), units::to_deg(s.angle_after));
  if (s.outliers > 0)
    fmt::print(" ({} outlier{} aside; with {} {:.4f} mm after)", s.outliers, s.outliers == 1 ? "" : "s",
               s.outliers == 1 ? "it" : "them", units::to_mm(s.all_after));
  fmt::print("\n");
}

/// What the stated systematic parts add to the mean standard deviations.
void print_systematic(const Calibration& c, const std::vector<calibration::Systematic>& parts) {
  if (c.systematic.empty()) return;
  std::vector<std::string> stated;
  for (const calibration::Systematic& part : parts)
    stated.push_back(fmt::format("{} {:.3g} {}", calibration::name_of(part.quantity),
                                 calibration::for_user(part.quantity, part.standard_uncertainty()),
                                 calibration::unit_of(part.quantity)));
  std::vector<std::string> without;
  const std::vector<std::string> coordinates = calibration::pose_coordinates(c.machine);
  for (std::size_t i = 0; i < coordinates.size(); ++i)
    without.push_back(
        fmt::format("{} {:.5f}", coordinates[i],
                    for_user(coordinates[i], c.verdict.after_readings.mean[static_cast<Eigen::Index>(i)])));
  fmt::print("systematic parts, standard uncertainties: {}; included above, without them the means after are {}\n",
             fmt::join(stated, ", "), fmt::join(without, ", "));
}

void print_repeats(const calibration::Repeats& r) {
  if (r.poses == 0) return;
  fmt::print(
      "{} rows are repeats at {} poses: {:.3g} times the noise within a pose, {:.3g} times between poses (F = {:.3g}, "
      "chance {}); they count as what they are worth\n",
      r.rows, r.poses, r.within, r.between, r.F, shown_chance(r.p_value));
}

void print_drift(const calibration::Drift& d) {
  if (!d.looked) return;
  if (!d.found) fmt::print("no drift: neither a trend over the rows nor neighbours that are alike\n");
  for (const calibration::ComponentDrift& one : d.components) {
    if (!one.trend_found && !one.lag1_found) continue;
    fmt::print("drift of {} over the {}: {:.3g} {} (t = {:.1f}), neighbours correlate by {:.2f}\n", one.component,
               one.over, one.is_angle ? units::to_deg(one.trend) : units::to_um(one.trend), one.is_angle ? "deg" : "um",
               one.t, one.lag1);
  }
}

void print_text(const Calibration& c, const Json& outliers, std::size_t rows, bool stated,
                const std::vector<calibration::Systematic>& systematic) {
  fmt::print("{} rows, {} equations fitted; {} of {} unknowns told, condition {:.3g}\n", rows, c.equations, c.told,
             c.unknowns, c.condition);
  print_score("fitted", c.fitted);
  print_score("held back", c.held_back);
  if (c.held_back.rows > 0)
    fmt::print("(held back: judged by a fit of the other rows; then all {} rows were fitted)\n", rows);
  fmt::print("the residuals show {:.2f} times the noise that was given\n", c.noise_factor);
  fmt::print("chi-square {:.1f} with {:.1f} degrees of freedom", c.chi_square, c.free_equations);
  if (stated) {
    const std::string verdict = chi_square_verdict(c);
    fmt::print(", chance {}: {}", shown_chance(c.chi_square_p),
               verdict == "agrees"  ? "as the noise that was stated lets it"
               : verdict == "above" ? "more than the noise that was stated explains"
                                    : "less than the noise that was stated, which is smaller in truth");
  }
  fmt::print("; 95 % intervals are {:.3f} standard errors to each side\n", c.student);
  print_repeats(c.repeats);
  print_drift(c.drift);
  if (c.pulled_aside) {
    fmt::print("a few rows pulled the fit aside, so the loss is cauchy's, which lets them count for next to nothing\n");
  }
  fmt::print("\n");
  fmt::print("{:<22} {:>14} {:>14} {:>10}\n", "parameter", "nominal", "value", "+- 1 sd");
  for (const calibration::Estimate& p : c.parameters) {
    const double nominal = units::to_user(p.nominal, p.unit), value = units::to_user(p.value, p.unit);
    if (p.identifiable) {
      fmt::print("{:<22} {:14.5f} {:14.5f} {:10.5f} {}{}\n", p.key, nominal, value,
                 units::to_user(p.standard_error, p.unit), p.unit, p.at_bound ? "  at its bound" : "");
      continue;
    }
    fmt::print("{:<22} {:14.5f} {:14.5f} {:10.5f} {}  not told apart", p.key, nominal, value,
               units::to_user(p.standard_error, p.unit), p.unit);
    for (std::size_t i = 0; i < p.like.size() && i < 3; ++i)
      fmt::print("{} {:.3g} {}", i == 0 ? ": acts like" : ",", factor_for_user(p, p.like[i]), p.like[i].key);
    fmt::print("{}\n", p.like.empty() ? ": no effect on these measurements" : p.like.size() > 3 ? ", ..." : "");
  }
  const auto frame = [](const char* what, const Pose& X, const Vec6& error) {
    if (error.isZero(0)) return;
    const Vec3 p = X.p * units::kMmPerMetre, abc = angles_abc(X.R) / units::kRadPerDeg;
    const Vec3 sd = error.head<3>() * units::kMmPerMetre;
    fmt::print("{:<8} {:.4f}, {:.4f}, {:.4f} mm (+- {:.4f}, {:.4f}, {:.4f}), {:.5f}, {:.5f}, {:.5f} deg\n", what, p.x(),
               p.y(), p.z(), sd.x(), sd.y(), sd.z(), abc.x(), abc.y(), abc.z());
  };
  frame("frame", c.X_SM, c.frame_error);
  frame("target", c.X_TR, c.target_error);
  if (c.scale_error > 0) fmt::print("{:<8} {:.6f} (+- {:.6f})\n", "scale", c.scale, c.scale_error);
  for (const std::string& name : c.held_beside) fmt::print("held as given: {}\n", name);
  for (const Json& x : outliers) {
    if (x["lost"].get<bool>()) {
      fmt::print("left out: {}:{}: {}\n", x["file"].get<std::string>(), x["line"].get<int>(),
                 x["untaken"].get<bool>()
                     ? "the nominal machine cannot take these joints"
                     : "near a singular pose, where the machine does not assemble with what was found");
      continue;
    }
    fmt::print("outlier{}: {}:{} is off by {:.3f} mm, weight {:.2g}\n", x["held_back"].get<bool>() ? ", held back" : "",
               x["file"].get<std::string>(), x["line"].get<int>(), x["residual_mm"].get<double>(),
               x["weight"].get<double>());
  }
  print_pose(c);
  print_systematic(c, systematic);
  fmt::print("{}\n", c.verdict.text);
}

}  // namespace

Command calibrate_command() {
  auto o = std::make_shared<Options>();
  return {
      "calibrate", "The parameters of a machine from measured poses, points, distances, gauge readings or contacts",
      "polypod calibrate hexapod-strut data.csv -o measured.toml",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.positional("DATA", o->files,
                     "CSV files: q1,...,qn and x_mm,y_mm,z_mm[,a_deg,b_deg[,c_deg]], "
                     "distance_mm,anchor_x_mm,..., gauge_mm,plane_x_mm,...,normal_x,... or contact");
        a.option("-o,--output", o->out, "The calibrated machine, as a machine file", true);
        a.option("--estimate", o->estimate,
                 "frame, target, scale: find where the machine stands in the instrument's "
                 "frame, where the target sits on the tool, the instrument's scale (repeatable)");
        a.option("--frame", o->frame, kFrameHelp);
        a.option("--target", o->target, kTargetHelp);
        a.option("--parameter", o->only,
                 "Beginning of a key: look for these only, the others are as uncertain as before (repeatable)");
        a.option("--hold", o->hold, "Beginning of a key: keep these, they are exact (repeatable)");
        a.option("--noise-um", o->noise_um, "Of the instrument, each coordinate (default 20)");
        a.option("--noise-deg", o->noise_deg, "Of the instrument, each angle (default 0.002)");
        a.option("--prior-mm", o->prior_mm,
                 "Lengths are off by about this much (default: 0.1, corrected by what the data show)");
        a.option("--prior-deg", o->prior_deg, "... angles and directions (default: 0.05, likewise)");
        a.option("--bound-mm", o->bound_mm, "Lengths are off by no more than this (default: no bound)");
        a.option("--bound-deg", o->bound_deg, "... angles and directions");
        a.option(
            "--loss", o->loss,
            "What outliers count for: huber, cauchy, none, or auto (default: huber, and cauchy where that leaves less "
            "than half)");
        a.option(
            "--hold-back", o->hold_back,
            "Percent of the poses that a fit of the others is judged by, where enough are left (default 20, 0 to 50)");
        declare_columns(a, o->columns);
        a.option("--join", o->join,
                 "A column by which the files are joined, as a name of points: one has the joints, the others what was "
                 "measured");
        a.option("--residuals", o->residuals, "Every row before and after, with signs, CSV");
        a.option("--covariance", o->covariance, "Covariance of the parameters, with their names, CSV");
        a.option("--report", o->report, "An HTML page: residuals, parameters and how sure they are");
        a.option("--certificate", o->certificate,
                 "Who measured what, when and with which instrument, and its systematic parts, TOML");
        a.option(
            "--certificate-report", o->certificate_report,
            "A certificate, HTML to print: results, uncertainty budget, validity; open lines for what is not given");
        a.option("--targets", o->targets, "Poses that the real machine shall take, CSV: x_mm,y_mm,z_mm,a_deg,...");
        a.option("--corrected", o->corrected, "What to ask the nominal controller for, CSV");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_ASSIGN(options, options_of(*o));
        if (o->targets.empty() != o->corrected.empty()) {
          return fail("AP183", "--targets and --corrected go together");
        }
        std::vector<std::string> inputs = o->files;
        inputs.insert(inputs.end(), {o->machine, o->targets, o->certificate});
        POLYPOD_TRY(check_files(inputs,
                                {o->out, o->residuals, o->covariance, o->corrected, o->report, o->certificate_report},
                                context.json));
        calibration::Statement statement;
        if (!o->certificate.empty()) {
          POLYPOD_ASSIGN(stated, calibration::read_statement(o->certificate));
          statement = std::move(stated);
          options.systematic = statement.systematic;
        }
        POLYPOD_ASSIGN(read, rows_of(*o, m));
        const std::vector<calibration::Measurement>& rows = read.rows;
        POLYPOD_TRY(calibration::no_row_twice(rows));
        POLYPOD_TRY(check_angles(context, m, rows));
        const bool stated = context.given("--noise-um") ||
                            std::all_of(rows.begin(), rows.end(), [](const auto& r) { return r.noise > 0; });
        if (const auto no = refused_as_singular(m, context, {"parameters", "rank"})) return *no;
        POLYPOD_ASSIGN(c, calibration::calibrate(m, rows, options));
        const bool good = c.verdict.answer != calibration::Answer::no;
        std::size_t missed = 0;
        std::string corrected;
        if (good && !o->targets.empty()) {
          POLYPOD_ASSIGN(text, corrected_targets(m, c.machine, o->targets, missed));
          corrected = text;
        }
        const std::string covariance = o->covariance.empty() ? "" : covariance_csv(covariance_of(m, c));
        const pages::HashedFile covariance_hash = hashed_bytes("covariance", o->covariance, covariance);
        machine::note(c.machine, "uncertainty",
                      uncertainty_note(c, o->covariance.empty() ? nullptr : &covariance_hash));
        const std::string calibrated = machine::to_toml(c.machine);
        std::optional<pages::Certificate> certificate;
        if (!o->certificate.empty() || !o->certificate_report.empty()) {
          POLYPOD_ASSIGN(hashes, hashes_of(*o, m));
          if (good) hashes.push_back(hashed_bytes("machine, calibrated", o->out, calibrated));
          if (good && !o->covariance.empty()) hashes.push_back(covariance_hash);
          certificate = certificate_of(m, rows, c, options, statement, stated);
          certificate->files = std::move(hashes);
          certificate->version = POLYPOD_VERSION;
          certificate->command = command_line(*o);
        }
        // A machine that is no better than its drawing is not written; what shows why it is not, is.
        files::Outputs together;
        std::vector<std::string> written;
        const auto write = [&](const std::string& path, const auto& text) -> Status {
          if (path.empty()) return {};
          written.push_back(path);
          return together.add(path, text());
        };
        if (good) {
          POLYPOD_TRY(write(o->out, [&] { return calibrated; }));
          POLYPOD_TRY(write(o->corrected, [&] { return corrected; }));
          POLYPOD_TRY(write(o->covariance, [&] { return covariance; }));
        }
        POLYPOD_TRY(write(o->residuals, [&] { return residuals_csv(c, rows); }));
        POLYPOD_TRY(write(o->report, [&] {
          return pages::calibration_page(m, rows, c, {POLYPOD_VERSION, command_line(*o)});
        }));
        POLYPOD_TRY(write(o->certificate_report, [&] { return pages::certificate_page(m, rows, c, *certificate); }));
        POLYPOD_TRY(together.commit());
        const Json outliers = outliers_json(c, rows);
        if (context.json) {
          Json moved = Json::array();
          for (const auto& one : c.moved) moved.push_back({{"key", one.key}, {"priors", one.priors}});
          Json document{{"better", c.verdict.answer == calibration::Answer::better},
                        {"verdict", c.verdict.text},
                        {"left_open", c.verdict.left_open},
                        {"pose_standard_deviation", pose_json(c)},
                        {"parameters", parameters_json(c)},
                        {"rms_before_mm", units::to_mm(c.fitted.rms_before)},
                        {"rms_after_mm", units::to_mm(c.fitted.rms_after)},
                        {"rank", c.rank},
                        {"unused_columns", read.unused_columns},
                        {"not_joined", read.not_joined},
                        {"parameters_total", c.parameters.size()},
                        {"fitted", score_json(c.fitted)},
                        {"held_back", score_json(c.held_back)},
                        {"frame", frame_json(c.X_SM, c.frame_error)},
                        {"target", frame_json(c.X_TR, c.target_error)},
                        {"held_beside", c.held_beside},
                        {"orientation_told", c.orientation_told},
                        {"rows", rows.size()},
                        {"equations", c.equations},
                        {"condition", c.condition},
                        {"noise_factor", c.noise_factor},
                        {"unknowns_told", c.told},
                        {"unknowns_total", c.unknowns},
                        {"degrees_of_freedom", c.free_equations},
                        {"student_95", c.student},
                        {"chi_square", chi_square_json(c, stated)},
                        {"common_errors", common_json(c)},
                        {"moved_far", moved},
                        {"repeats", repeats_json(c.repeats)},
                        {"drift", drift_json(c.drift)},
                        {"covariance", covariance_json(covariance_of(m, c))},
                        {"systematic", systematic_json(c, options.systematic)},
                        {"certificate", certificate ? certificate_json(*certificate) : Json()},
                        {"scale", {{"value", c.scale}, {"standard_error", c.scale_error}}},
                        {"few_rows_pulled_aside", c.pulled_aside},
                        {"outliers", outliers},
                        {"iterations", c.iterations},
                        {"file", good ? o->out : ""}};
          if (!o->corrected.empty()) document["targets_missed"] = missed;
          print_json(document);
        } else {
          print_text(c, outliers, rows.size(), stated, options.systematic);
          for (const std::string& note : notes_of(read, o->join)) fmt::print("note: {}\n", note);
          for (const std::string& path : written) fmt::print("wrote {}\n", path);
          if (!good) fmt::print("not written: {}\n", o->out);
          if (missed > 0) fmt::print("{} of the targets are out of the nominal machine's reach\n", missed);
        }
        return missed > 0 || !good ? kAnswerIsNo : kDone;
      }};
}

}  // namespace polypod::app
