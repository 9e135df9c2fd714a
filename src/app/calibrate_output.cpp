// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "calibrate_output.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "covariance_files.hpp"
#include "polypod/calibration/certificate.hpp"
#include "polypod/calibration/verdict.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::app {
namespace {

using calibration::Calibration;

std::string with_unit(const std::string& key, const std::string& unit) {
  return unit.empty() ? key : key + "_" + unit;
}
/// mm or deg of `other` a mm or deg of `held`.
double factor_for_user(const calibration::Estimate& held, const calibration::Like& other) {
  return other.factor * units::to_user(1, other.unit) / units::to_user(1, held.unit);
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
      one["linearly_dependent_on"] = like;
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
                   {"validation", r.held_back},
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
               shown(after.mean[k]), shown(after.max[k]), open ? "  undetermined" : "");
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

}  // namespace

std::string residuals_csv(const Calibration& c, const std::vector<calibration::Measurement>& rows) {
  std::string out = "file,line,kind,validation,outlier,weight,before_um,after_um";
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

Json calibration_json(const machine::AnyMachine& nominal, const Calibration& c,
                      const std::vector<calibration::Measurement>& rows, bool stated) {
  Json moved = Json::array();
  for (const auto& one : c.moved) moved.push_back({{"key", one.key}, {"priors", one.priors}});
  Json out{
      {"better", c.verdict.answer == calibration::Answer::better},
      {"verdict", c.verdict.text},
      {"undetermined", c.verdict.left_open},
      {"pose_standard_deviation", pose_json(c)},
      {"parameters", parameters_json(c)},
      {"rms_before_mm", units::to_mm(c.fitted.rms_before)},
      {"rms_after_mm", units::to_mm(c.fitted.rms_after)},
      {"rank", c.rank},
      {"parameters_total", c.parameters.size()},
      {"fitted", score_json(c.fitted)},
      {"validation", score_json(c.held_back)},
      {"frame", frame_json(c.X_SM, c.frame_error)},
      {"target", frame_json(c.X_TR, c.target_error)},
      {"fixed_as_given", c.held_beside},
      {"orientation_identifiable", c.orientation_told},
      {"rows", rows.size()},
      {"equations", c.equations},
      {"condition", c.condition},
      {"noise_factor", c.noise_factor},
      {"unknowns_identifiable", c.told},
      {"unknowns_total", c.unknowns},
      {"degrees_of_freedom", c.free_equations},
      {"student_95", c.student},
      {"chi_square", chi_square_json(c, stated)},
      {"common_errors", common_json(c)},
      {"moved_far", moved},
      {"repeats", repeats_json(c.repeats)},
      {"drift", drift_json(c.drift)},
      {"covariance", covariance_json(calibration::keyed_parameters(nominal), c.covariance)},
      {"scale", {{"value", c.scale}, {"standard_error", c.scale_error}}},
      {"few_rows_pulled_aside", c.pulled_aside},
      {"outliers", outliers_json(c, rows)},
      {"iterations", c.iterations},
  };
  return out;
}

void print_calibration(const Calibration& c, const std::vector<calibration::Measurement>& rows, bool stated,
                       const std::vector<calibration::Systematic>& systematic) {
  fmt::print("{} rows, {} equations fitted; {} of {} unknowns identifiable, condition {:.3g}\n", rows.size(),
             c.equations, c.told, c.unknowns, c.condition);
  print_score("fitted", c.fitted);
  print_score("validation", c.held_back);
  if (c.held_back.rows > 0)
    fmt::print("(validation set: judged by a fit of the other rows; then all {} rows were fitted)\n", rows.size());
  fmt::print("the residuals show {:.2f} times the noise that {}\n", c.noise_factor,
             stated ? "was given" : "is assumed");
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
    fmt::print("{:<22} {:14.5f} {:14.5f} {:10.5f} {}  not identifiable", p.key, nominal, value,
               units::to_user(p.standard_error, p.unit), p.unit);
    for (std::size_t i = 0; i < p.like.size() && i < 3; ++i)
      fmt::print("{} {:.3g} {}", i == 0 ? ": linearly dependent on" : ",", factor_for_user(p, p.like[i]),
                 p.like[i].key);
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
  for (const std::string& name : c.held_beside) fmt::print("fixed as given: {}\n", name);
  for (const Json& x : outliers_json(c, rows)) {
    if (x["lost"].get<bool>()) {
      fmt::print("left out: {}:{}: {}\n", x["file"].get<std::string>(), x["line"].get<int>(),
                 x["untaken"].get<bool>()
                     ? "the nominal machine cannot take these joints"
                     : "near a singular pose, where the machine does not assemble with what was found");
      continue;
    }
    fmt::print("outlier{}: {}:{} is off by {:.3f} mm, weight {:.2g}\n",
               x["validation"].get<bool>() ? ", validation" : "", x["file"].get<std::string>(), x["line"].get<int>(),
               x["residual_mm"].get<double>(), x["weight"].get<double>());
  }
  print_pose(c);
  print_systematic(c, systematic);
  fmt::print("{}\n", c.verdict.text);
}

}  // namespace polypod::app
