// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/verdict.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "model.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"

namespace polypod::calibration {
namespace {

// A coordinate whose standard deviation stays above this share of what it was is not told: what remains then comes from
// the drawing more than from the readings.
constexpr double kOpen = 0.2;

// Residuals over the noise that was given: no instrument is stated that badly.
constexpr double kMisfit = 5;

// Standard deviations by which the squares of the residuals must become smaller than noise alone lets them.
constexpr double kGain = 3;

// Residuals over the noise that was given from which on errors of another kind are likely, and how many equations must
// be free to tell; rows within less than this share of the box of the workspace show little of it.
constexpr double kOtherErrors = 1.5;
constexpr double kEnoughFree = 20;
constexpr double kFewPlaces = 0.05;

/// "x_mm" -> "x", "a_deg" -> "A", as a person says them.
std::string spoken(const std::string& coordinate) {
  const char c = coordinate.front();
  return std::string(1, c < 'x' ? static_cast<char>(c - 'a' + 'A') : c);
}
bool is_angle(const std::string& coordinate) {
  return coordinate.front() < 'x';
}
std::vector<std::string> spoken(const std::vector<std::string>& coordinates) {
  std::vector<std::string> out;
  for (const std::string& c : coordinates) out.push_back(spoken(c));
  return out;
}

/// The systematic part that puts most into the pose over these stands, and what it is: "scale (5.8 um/m)".
std::string largest_systematic(const AnyMachine& machine, const std::vector<Stand>& stands, const Calibration& c,
                               const std::vector<Systematic>& parts) {
  std::vector<double> squares(parts.size(), 0);
  for (const SystematicEffect& effect : c.systematic) {
    const Eigen::VectorXd shift = effect.standard_uncertainty * effect.by_parameter;
    for (const Stand& stand : stands)
      squares[effect.part] += (twist_by_parameters(machine, stand.X_MT, stand.q).topRows(3) * shift).squaredNorm();
  }
  const auto most = std::max_element(squares.begin(), squares.end());
  if (most == squares.end()) return "";
  const Systematic& part = parts[static_cast<std::size_t>(most - squares.begin())];
  return fmt::format("{} (standard uncertainty {:.2g} {})", name_of(part.quantity),
                     for_user(part.quantity, part.standard_uncertainty()), unit_of(part.quantity));
}

/// What to measure, so that the coordinates that are open are told too.
std::string what_would_tell(const AnyMachine& machine, const std::vector<Measurement>& rows,
                            const std::vector<std::string>& open) {
  bool angles_measured = false, places_measured = false, gauges_only = true, distances_only = true;
  for (const Measurement& row : rows) {
    angles_measured = angles_measured || row.kind == Kind::axis || row.kind == Kind::pose;
    places_measured = places_measured || row.kind == Kind::point || row.kind == Kind::axis || row.kind == Kind::pose;
    gauges_only = gauges_only && row.kind == Kind::gauge;
    distances_only = distances_only && row.kind == Kind::distance;
  }
  const bool angles_open = std::any_of(open.begin(), open.end(), is_angle);
  const bool places_open = !std::all_of(open.begin(), open.end(), is_angle);
  if (angles_open && !angles_measured)
    return kinematics::task(machine).names_axis() ? "axes (x_mm, y_mm, z_mm, a_deg, b_deg)"
                                                  : "poses (x_mm, y_mm, z_mm, a_deg, b_deg, c_deg)";
  if (places_open && gauges_only) return "points, or gauge readings against planes that face the other ways";
  if (places_open && distances_only) return "points, or distances from three balls or more";
  if (places_open && !places_measured) return "points, or distances";
  return "more rows, or poses that `polypod poses` chooses";
}

PoseSpread spread_over(const AnyMachine& machine, const std::vector<Stand>& stands, const Eigen::MatrixXd& covariance) {
  const auto n = static_cast<Eigen::Index>(pose_coordinates(machine).size());
  PoseSpread out{Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n)};
  for (const Stand& stand : stands) {
    const Eigen::VectorXd one = pose_deviation(machine, stand.X_MT, stand.q, covariance);
    out.mean += one / static_cast<double>(stands.size());
    out.max = out.max.cwiseMax(one);
  }
  return out;
}

/// Where the calibrated machine stands with the joints of these; what it cannot take stays as it is.
std::vector<Stand> taken_by(const AnyMachine& calibrated, std::vector<Stand> stands) {
  for (Stand& stand : stands) {
    const auto found = kinematics::forward(calibrated, stand.q);
    if (!found.poses.empty()) stand.X_MT = found.poses.front();
  }
  return stands;
}

/// How likely the drawing is nearer than the calibrated machine in a coordinate at one pose, where its standard
/// deviation falls from `before` to `after`. What is left, e, and the change, m, are independent and normal with the
/// variances after^2 and before^2 - after^2; the drawing is off by e + m, so that it is nearer where m lies between
/// -2 e and 0.
double chance_of_worse(double before, double after) {
  constexpr double kEven = 0.5;
  if (!(after < before)) return kEven;
  return std::atan2(2 * after, std::sqrt(before * before - after * after)) / std::numbers::pi;
}

/// "the rows of the validation set are missed by 0.0172 mm rms, by the drawing by 0.0181 mm".
std::string misses(const Score& s, bool held) {
  return fmt::format("the residuals of the {} are {:.4f} mm rms, with the drawing {:.4f} mm",
                     held ? "rows of the validation set" : "fitted rows", units::to_mm(s.rms_after),
                     units::to_mm(s.rms_before));
}

/// "20.0 mm along z", "(5.00, -4.99, 5.00) mm"; of an angle "0.500 deg about y".
std::string vector_in_words(const Vec3& user, const char* unit, const char* along) {
  constexpr double kAlmostAll = 0.98;
  const double size = user.norm();
  for (int k = 0; k < 3; ++k)
    if (std::abs(user[k]) > kAlmostAll * size)
      return fmt::format("{:.3g} {} {} {}{}", std::abs(user[k]), unit, along, user[k] < 0 ? "-" : "", "xyz"[k]);
  return fmt::format("({:.3g}, {:.3g}, {:.3g}) {}", user.x(), user.y(), user.z(), unit);
}

/// "one scale of the instrument, which shows 1.00300 times the lengths".
std::string in_words(const CommonChange& c, const AnyMachine& machine) {
  constexpr double kShown = 0.1;  // a turn whose effect is less than this share of the shift's is not named
  if (c.what == "scale")
    return fmt::format("one scale of the instrument, which shows {:.5f} times the lengths", c.scale);
  const std::string of = c.what == "frame" ? "the instrument's frame" : "the target on the tool";
  const double reach = size_of(machine), turned = c.turn.norm() * reach;
  std::string out = fmt::format("one shift of {}", of);
  const bool turns = turned > kShown * c.shift.norm(), shifts = c.shift.norm() > kShown * turned;
  if (!shifts) out = fmt::format("one turn of {}", of);
  if (shifts) out += " by " + vector_in_words(c.shift * units::kMmPerMetre, "mm", "along");
  if (shifts && turns) out += " and a turn";
  if (turns) out += " by " + vector_in_words(c.turn / units::kRadPerDeg, "deg", "about");
  return out;
}

/// Why the answer is no whatever the pose, or nothing.
std::string refusal(const AnyMachine& machine, const Calibration& c) {
  if (!c.tried.empty() && c.tried.front().likely) {
    const CommonChange& common = c.tried.front();
    return fmt::format(
        "Not judged: all changes look like {}. With it the parameters change by {:.2g} times their priors, without it "
        "by {:.2g} times (root mean square). {}.",
        in_words(common, machine), common.change, common.change_before,
        common.what == "scale"
            ? std::string("Check the instrument (temperature, constants) and measure again with its "
                          "scale right; --estimate scale says how large it is, but then only the drawing determines "
                          "the size of the machine")
            : fmt::format("Measure it on the machine and give it with --{0}, or find it with --estimate {0}; "
                          "parameters that are linearly dependent on it then stay as drawn",
                          common.what));
  }
  const bool held = c.held_back.rows > c.held_back.outliers;
  const Score& s = held ? c.held_back : c.fitted;
  const double noise = std::max(c.noise_factor, c.noise_factor_judging);
  if (noise > kMisfit) {
    return fmt::format(
        "Not judged: the residuals are {:.1f} times the noise that was given, so the readings are coarser than that "
        "(then give --noise-um), or the parameters do not explain them (check frame, target and units). As it is, {}.",
        noise, misses(s, held));
  }
  if (c.gain < kGain) {
    return fmt::format(
        "No: the drawing already explains the readings within the noise, so that there is nothing to gain: {}.",
        misses(s, held));
  }
  constexpr const char* kNotBetter = "No, the calibrated machine is not better than the drawing: ";
  if (s.rms_before > 0 && !(s.rms_after < s.rms_before)) return kNotBetter + misses(s, held) + ".";
  // By chance alone the rms of n angles spreads by 1 / sqrt(2 n) of itself; two of them are allowed.
  const double chance = 1 + 2 / std::sqrt(2.0 * 3.0 * static_cast<double>(std::max<std::size_t>(s.rows, 1)));
  if (s.angle_after > s.angle_before * chance) {
    return kNotBetter +
           fmt::format("the residuals of the angles of the {} are {:.5f} deg rms, with the drawing {:.5f} deg.",
                       held ? "rows of the validation set" : "fitted rows", units::to_deg(s.angle_after),
                       units::to_deg(s.angle_before));
  }
  return "";
}

/// What the standard deviations rest on and the readings do not show: that the parameters are all that is wrong with
/// the machine. Errors of another kind show as residuals above the noise, and act where nothing was measured.
std::string what_is_open(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                         const std::vector<Stand>& stands, const Calibration& c) {
  std::string out;
  if (c.noise_factor > kOtherErrors && c.free_equations >= kEnoughFree) {
    out += fmt::format(
        " But the residuals are {:.1f} times the noise that was given: either the instrument is that coarse, or the "
        "machine has errors that no parameter describes, which the predicted deviations do not contain.",
        c.noise_factor);
    if (c.fitted.outliers > 0) {
      out += fmt::format(
          " {} of the rows {}, which adds to it: measure {} again, or let {} count for less with --loss "
          "cauchy.",
          c.fitted.outliers, c.fitted.outliers == 1 ? "looks like an outlier" : "look like outliers",
          c.fitted.outliers == 1 ? "it" : "them", c.fitted.outliers == 1 ? "it" : "them");
    }
  }
  if (!c.moved.empty()) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < std::min<std::size_t>(c.moved.size(), 3); ++i)
      names.push_back(fmt::format("{} ({:.2g})", c.moved[i].key, c.moved[i].priors));
    if (c.moved.size() > names.size()) names.push_back(fmt::format("{} more", c.moved.size() - names.size()));
    out += fmt::format(
        " But {} moved by ten times the prior and more (in brackets: how many times): either the machine is so far "
        "off, "
        "then say so with --prior-mm and --prior-deg, or something else was taken for its error.",
        listed(names));
  }
  if (c.drift.found) {
    std::vector<std::string> found;
    for (const ComponentDrift& d : c.drift.components) {
      if (d.trend_found)
        found.push_back(fmt::format("{} changes by {:.{}f} {} from the first to the last by {} (t = {:.1f})",
                                    d.component, d.is_angle ? units::to_deg(d.trend) : units::to_um(d.trend),
                                    d.is_angle ? 4 : 0, d.is_angle ? "deg" : "um", d.over, d.t));
      if (d.lag1_found)
        found.push_back(fmt::format("neighbours of {} are alike (correlation {:.2f})", d.component, d.lag1));
    }
    out += fmt::format(
        " But the residuals drift: {}. Instrument or machine changed while it was measured, or neighbouring rows share "
        "an error that no parameter describes; the predicted deviations do not contain it.",
        listed(found));
  }
  const auto box_of = [](const auto& poses) {
    Eigen::AlignedBox3d box;
    for (const Vec3& p : poses) box.extend(p);
    return box;
  };
  std::vector<Vec3> reached, measured;
  for (const Stand& stand : stands) reached.push_back(stand.X_MT.p);
  for (const Measurement& row : rows)
    if (const auto X = pose_of_row(nominal, row)) measured.push_back(X->p);
  const Vec3 whole = box_of(reached).sizes(), seen = box_of(measured).sizes();
  double share = 1;
  for (int k = 0; k < 3; ++k)
    if (whole[k] > 1e-3 * whole.maxCoeff()) share *= std::min(1.0, seen[k] / whole[k]);
  if (share < kFewPlaces) {
    out += fmt::format(
        " But the rows lie in {} of the box of the workspace: beyond them the answer rests on the parameters being "
        "all that is wrong with the machine. Measure over the whole workspace where it shall be used.",
        share < 1e-4 ? std::string("next to nothing") : fmt::format("{:.1g} %", 100 * share));
  }
  return out;
}

}  // namespace

std::vector<std::string> pose_coordinates(const AnyMachine& machine) {
  static constexpr std::array<const char*, 6> kAll{"x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"};
  const machine::Task task = kinematics::task(machine);
  std::vector<std::string> out;
  for (int i = 0; i < task.size(); ++i) out.emplace_back(kAll[static_cast<std::size_t>(task[i])]);
  return out;
}

Eigen::VectorXd pose_deviation(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                               const Eigen::MatrixXd& covariance) {
  const auto S = kinematics::closure_detail::task_rows(kinematics::task(machine), X_MT, 1.0);
  const Eigen::MatrixXd G = S * twist_by_parameters(machine, X_MT, q);
  return (G * covariance).cwiseProduct(G).rowwise().sum().cwiseMax(0).cwiseSqrt();
}

namespace {

/// " U (k = 2) of x, y and z: 0.018, 0.019 and 0.017 mm, the mean over the workspace."
std::string expanded(const std::vector<std::string>& coordinates, const PoseSpread& after, bool systematic) {
  constexpr double kCoverage = 2;
  std::vector<std::string> names, values;
  for (std::size_t i = 0; i < coordinates.size(); ++i) {
    if (is_angle(coordinates[i])) continue;
    names.push_back(spoken(coordinates[i]));
    values.push_back(fmt::format("{:.2g}", kCoverage * units::to_mm(after.mean[static_cast<Eigen::Index>(i)])));
  }
  if (names.empty()) return "";
  return fmt::format(" U (k = 2) of {} is {} mm, the mean over the workspace{}.", listed(names), listed(values),
                     systematic ? ", the stated systematic parts included" : "");
}

/// "--fix 'dh[1].d_mm' --fix 'dh[6].a_mm'", as a shell takes it: the parameters that are linearly dependent on frame or
/// target, so that one of both can be chosen freely.
std::string fixes(const Calibration& c) {
  std::string out;
  for (const Estimate& p : c.parameters) {
    const bool like_place = std::any_of(p.like.begin(), p.like.end(), [](const Like& l) {
      return l.key.rfind("frame.", 0) == 0 || l.key.rfind("target.", 0) == 0;
    });
    if (!p.identifiable && like_place)
      out += fmt::format("{}--fix '{}{}{}'", out.empty() ? "" : " ", p.key, p.unit.empty() ? "" : "_", p.unit);
  }
  return out;
}

}  // namespace

Verdict judged(const AnyMachine& nominal, const std::vector<Measurement>& rows, const Calibration& c,
               const CalibrationOptions& options) {
  const std::vector<Systematic>& systematic = options.systematic;
  Verdict out;
  const std::vector<Stand> stands = random_stands(nominal, kJudgedPoses, kJudgedSeed);
  out.poses = stands.size();
  // First order at the machine that the covariance is of: a drawing that is degrees off says little of it.
  const std::vector<Stand> found = taken_by(c.machine, stands);
  out.before = spread_over(nominal, stands, c.covariance_before);
  out.after = spread_over(c.machine, found, c.covariance);
  out.after_readings =
      c.systematic.empty() ? out.after : spread_over(c.machine, found, c.covariance_readings + c.covariance_drawing);
  std::vector<std::string> told, shares, by_systematic;
  double chance = 0;
  const std::vector<std::string> all = pose_coordinates(nominal);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const double before = out.before.mean[k], after = out.after.mean[k];
    const bool open = !(after < kOpen * before);
    (open ? out.left_open : told).push_back(all[i]);
    if (!open) continue;
    if (out.after_readings.mean[k] < kOpen * before) by_systematic.push_back(spoken(all[i]));
    if (before > 0) chance = std::max(chance, chance_of_worse(before, after));
    shares.push_back(before > 0 ? fmt::format("{} ({:.0f} %)", spoken(all[i]), 100 * after / before)
                                : fmt::format("{} (fixed)", spoken(all[i])));
  }
  const std::string refused = refusal(nominal, c);
  const std::string doubts = what_is_open(nominal, rows, stands, c);
  std::string remedy = "also measure " + what_would_tell(nominal, rows, out.left_open);
  if (options.estimate_frame || options.estimate_target) {
    const char* what = !options.estimate_target ? "frame" : !options.estimate_frame ? "target" : "frame and target";
    const bool both = options.estimate_frame && options.estimate_target;
    remedy = fmt::format(
        "measure the {0} on the machine and give {1} with --{2}: what the machine's own parts act on "
        "like the {0} stays open with any number of rows",
        what, both ? "them" : "it", both ? "frame and --target" : what);
    if (const std::string fix = fixes(c); !fix.empty())
      remedy += fmt::format(
          ". Where nobody knows the {0}, fix the parameters that are linearly dependent on {1}: {2}. The {0} found "
          "then {3} the errors of these, and "
          "the machine file is right together with {1}",
          what, both ? "them" : "it", fix, both ? "hold" : "holds");
  }
  if (!by_systematic.empty()) {
    remedy = fmt::format(
        "measure with smaller systematic parts: without them the readings would determine {}; most comes from {}",
        listed(by_systematic), largest_systematic(nominal, stands, c, systematic));
    if (by_systematic.size() < out.left_open.size())
      remedy += "; also measure " + what_would_tell(nominal, rows, out.left_open);
  }
  if (c.parameters.empty() && c.noise_factor <= kMisfit) {
    out.answer = Answer::partly;
    out.text = "No parameter of the machine was estimated: it stays as drawn.";
  } else if (!refused.empty()) {
    out.text = refused;
  } else if (told.empty()) {
    out.text = fmt::format(
        "No: these measurements determine no coordinate of the pose well enough: more than {:.0f} % of its standard "
        "deviation is left of {}. To determine {}, {}.",
        100 * kOpen, listed(shares), shares.size() == 1 ? "it" : "them", remedy);
  } else if (out.left_open.empty()) {
    out.answer = doubts.empty() ? Answer::better : Answer::partly;
    out.text =
        doubts.empty()
            ? "Yes, the calibrated machine is better than the drawing in every coordinate of the pose."
            : "In part: where the rows are, the calibrated machine is better than the drawing in every coordinate "
              "of the pose." +
                  doubts;
  } else {
    out.answer = Answer::partly;
    out.text = fmt::format(
        "In part: {} of the pose {} better than in the drawing. The measurements do not determine {} (in brackets: the "
        "fraction of its standard deviation that is left). The same parameters move {} too: over many machines that is "
        "an "
        "improvement, but at a pose of this one the drawing may be nearer, with a chance of up to {:.0f} %. To "
        "determine {}, {}.",
        listed(spoken(told)), told.size() == 1 ? "is" : "are", listed(shares), shares.size() == 1 ? "it" : "them",
        100 * chance, shares.size() == 1 ? "it" : "them", remedy);
    out.text += doubts;
  }
  if (out.answer != Answer::no && !c.parameters.empty()) out.text += expanded(all, out.after, !c.systematic.empty());
  return out;
}

}  // namespace polypod::calibration
