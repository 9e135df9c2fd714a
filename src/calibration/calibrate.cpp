// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/calibrate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "common.hpp"
#include "extent.hpp"
#include "fit.hpp"
#include "groups.hpp"
#include "mixed_up.hpp"
#include "model.hpp"

namespace polypod::calibration {
namespace {

/// The residuals of the taken rows, whose numbers are given, and between them those of the others.
std::vector<RowResidual> with_untaken(const std::vector<Measurement>& rows, const std::vector<std::size_t>& number,
                                      std::vector<RowResidual> taken) {
  std::vector<RowResidual> out(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const int n = equation_count(rows[i].kind);
    out[i].before = out[i].after = Eigen::VectorXd::Zero(n);
    out[i].lengths = std::min(n, 3);
    out[i].weight = 0;
    out[i].outlier = out[i].lost = out[i].untaken = true;
  }
  for (RowResidual& r : taken) out[number[r.row]] = std::move(r);
  for (std::size_t i = 0; i < rows.size(); ++i) out[i].row = i;
  return out;
}

/// A calibration, and where its search ended.
struct Fitted {
  Calibration found;
  Ended ended;
};

/// With the loss of the options; of Loss::automatic with the one that leaves less, or with which the search before that
/// one was done.
Result<Fitted> fit_with_loss(const AnyMachine& machine, const std::vector<Measurement>& rows, const Setting& setting,
                             CalibrationOptions options, bool noise_as_given) {
  constexpr double kPulledAside = 3;  // times the noise
  const auto with = [&](Loss loss) -> Result<Fitted> {
    options.loss = loss;
    Fit fit(machine, rows, setting, options, noise_as_given);
    POLYPOD_ASSIGN(out, fit.run());
    Fitted fitted{std::move(out), fit.ended()};
    if (setting.from) fitted.found.pulled_aside = fitted.ended.pulled_aside = setting.from->pulled_aside;
    return fitted;
  };
  if (options.loss != Loss::automatic) return with(options.loss);
  if (setting.from) return with(setting.from->loss);
  Result<Fitted> huber = with(Loss::huber);
  const bool searched = huber || huber.error().id == "CA115" || huber.error().id == "CA118";
  if (!searched || (huber && huber->found.noise_factor <= kPulledAside)) return huber;
  Result<Fitted> cauchy = with(Loss::cauchy);
  if (!cauchy) return huber;
  Calibration& c = cauchy->found;
  if (too_many_lost(c.fitted.outliers + c.held_back.outliers, rows.size())) return huber;
  c.pulled_aside = cauchy->ended.pulled_aside = !huber || c.noise_factor < 0.5 * huber->found.noise_factor;
  return c.pulled_aside ? cauchy : huber;
}

/// Few rows, or errors beyond what is usual, can be explained in two ways: by an instrument coarser than it was said to
/// be, to which a search that begins with the residuals of the drawing comes, or by the machine. Where the first leaves
/// more than the noise that was given, the search begins again with that noise; its answer counts where it leaves less
/// than half as much, with changes that a machine can have. A search that goes on from another keeps to its way.
Result<Fitted> fit(const AnyMachine& machine, const std::vector<Measurement>& rows, const Setting& setting,
                   const CalibrationOptions& options) {
  constexpr double kCoarse = 1.5;     // times the noise
  constexpr double kMostChange = 10;  // times the priors
  Result<Fitted> first = fit_with_loss(machine, rows, setting, options, false);
  const bool searched = first || first.error().id == "CA115" || first.error().id == "CA118";
  if (setting.from || !searched || (first && first->found.noise_factor <= kCoarse)) return first;
  Result<Fitted> second = fit_with_loss(machine, rows, setting, options, true);
  const bool better =
      second && second->found.change < kMostChange &&
      (first ? second->found.noise_factor < 0.5 * first->found.noise_factor : second->found.noise_factor < kCoarse);
  return better ? second : first;
}

/// The same, once more with what repeats have shown of their scatter: they count for as many rows as they are worth.
Result<Fitted> fit_with_repeats(const AnyMachine& machine, const std::vector<Measurement>& rows, Setting& setting,
                                const CalibrationOptions& options) {
  constexpr int kRounds = 3;
  constexpr double kSettled = 0.02;  // of the correlation
  const std::vector<std::size_t> repeats = repeats_of(rows, setting.pose);
  Result<Fitted> out = fit(machine, rows, setting, options);
  for (int round = 0; out; ++round) {
    Calibration& c = out->found;
    const double before = c.repeats.correlation;
    const Repeats now = repeats_in(rows, repeats, c.residuals, options.noise_position, options.noise_angle, c.taken_up);
    c.repeats = now;
    if (round == kRounds || (round > 0 && std::abs(now.correlation - before) < kSettled)) break;
    if (now.correlation == 0) break;
    setting.share = shares_of(repeats, now.correlation);
    Result<Fitted> next = fit(machine, rows, setting, options);
    if (!next) break;
    next->found.repeats = now;
    out = std::move(next);
  }
  return out;
}

/// Common errors that the readings may have in place of the machine.
void try_common(const AnyMachine& machine, const std::vector<Measurement>& rows, const Setting& setting,
                const CalibrationOptions& options, Calibration& found) {
  if (found.parameters.empty()) return;
  for (const std::string& what : untried(machine, rows, options)) {
    CommonChange trial = explained_alone(machine, rows, setting.seed, options, found, what);
    if (worth_a_fit(trial, found, options)) {
      const Result<Fitted> with = fit(machine, rows, setting, with_common(options, what));
      if (with) compare(machine, rows, setting.seed, options, found, with->found, trial);
    }
    found.tried.push_back(std::move(trial));
  }
  std::stable_sort(found.tried.begin(), found.tried.end(), [](const CommonChange& a, const CommonChange& b) {
    return a.likely && (!b.likely || a.change < b.change);
  });
}

/// What the options have to do with the verdict.
std::string remarks(const Calibration& c, const CalibrationOptions& options) {
  std::string out;
  const std::size_t outliers = c.fitted.outliers;
  const bool many = c.verdict.answer == Answer::no || too_many_lost(outliers, c.residuals.size());
  if (many && outliers > 0 && options.loss != Loss::cauchy)
    out += fmt::format(" {} of the rows {}: --loss cauchy lets them count for less.", outliers,
                       outliers == 1 ? "looks like an outlier" : "look like outliers");
  if (c.others_uncertain)
    out += " Parameters that are not estimated count with their priors; --fix says that one is exact.";
  if (c.free_equations < kLeastFree)
    out += " The equations are too few to show the noise: no less counts than was given.";
  return out;
}

/// Of very many rows a search of some is a good place to begin one of all; nothing where there are fewer, or places of
/// contacts among the unknowns.
std::optional<Ended> begun_with_some(const AnyMachine& machine, const std::vector<Measurement>& rows,
                                     const Setting& setting, CalibrationOptions options) {
  constexpr std::size_t kSome = 1000, kMany = 3000;
  const bool contacts =
      std::any_of(rows.begin(), rows.end(), [](const Measurement& row) { return row.kind == Kind::contact; });
  if (rows.size() < kMany || contacts) return {};
  std::vector<Measurement> some;
  Setting of_some;
  for (std::size_t i = 0; i < rows.size(); i += rows.size() / kSome) {
    some.push_back(rows[i]);
    of_some.seed.push_back(setting.seed[i]);
  }
  of_some.pose = poses_of(machine, some);
  of_some.share.assign(some.size(), 1);
  options.hold_back = 0;
  const Result<Fitted> fitted = fit(machine, some, of_some, options);
  return fitted ? std::optional(fitted->ended) : std::nullopt;
}

/// Rows that the machine takes, with the pose of each, and the first that it does not take. A place that was touched
/// several times tells nothing by the one touch that is left of them.
struct TakenRows {
  std::vector<Measurement> rows;
  std::vector<Pose> poses;
  std::vector<std::size_t> number;
  const Measurement* untaken = nullptr;
};
TakenRows taken_by(const AnyMachine& machine, const std::vector<Measurement>& rows) {
  std::map<std::string, int> touched, taken;
  std::vector<std::optional<Pose>> poses;
  for (const Measurement& row : rows) {
    poses.push_back(pose_of_row(machine, row));
    if (row.kind != Kind::contact) continue;
    ++touched[row.contact];
    taken[row.contact] += poses.back() ? 1 : 0;
  }
  TakenRows out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const bool alone = rows[i].kind == Kind::contact && taken[rows[i].contact] == 1 && touched[rows[i].contact] > 1;
    if (!poses[i] && out.untaken == nullptr) out.untaken = &rows[i];
    if (!poses[i] || alone) continue;
    out.rows.push_back(rows[i]);
    out.poses.push_back(*poses[i]);
    out.number.push_back(i);
  }
  return out;
}

/// A fit without the rows that are held back, by which these are judged, and then one of all rows.
Result<Fitted> validated(const AnyMachine& machine, const std::vector<Measurement>& rows, Setting& setting,
                         const CalibrationOptions& options) {
  setting.from = begun_with_some(machine, rows, setting, options);
  POLYPOD_ASSIGN(first, fit_with_repeats(machine, rows, setting, options));
  Calibration& judging = first.found;
  judging.noise_factor_judging = judging.noise_factor;
  if (judging.held_back.rows == 0) return first;
  CalibrationOptions everything = options;
  everything.hold_back = 0;
  if (setting.from) setting.from = first.ended;
  POLYPOD_ASSIGN(all, fit_with_repeats(machine, rows, setting, everything));
  Calibration& out = all.found;
  out.held_back = judging.held_back;
  out.noise_factor_judging = judging.noise_factor;
  for (std::size_t i = 0; i < out.residuals.size(); ++i) {
    RowResidual& r = out.residuals[i];
    r.held_back = judging.residuals[i].held_back;
    if (r.held_back) r.judged = judging.residuals[i].after;
  }
  return all;
}

}  // namespace

Result<Calibration> calibrate(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                              const CalibrationOptions& options) {
  const auto within = [](double value, double least, double most) {
    return value >= least && value <= most;
  };                             // no NaN
  constexpr double kMost = 1e6;  // m, rad: far beyond any machine, and no infinity
  const bool noise = options.noise_position > 0 && within(options.noise_position, 0, kMost) &&
                     options.noise_angle > 0 && within(options.noise_angle, 0, kMost);
  bool sizes = true;
  for (const double size : {options.prior_length, options.prior_angle, options.bound_length, options.bound_angle})
    sizes = sizes && within(size, 0, kMost);
  if (!noise || !sizes || !within(options.hold_back, 0, 0.5)) {
    return fail("CA116", "an option of the calibration is out of range", {},
                "noise must be above 0, priors and bounds not below 0, all of them finite, the validation set 0 to 0.5 "
                "of the poses");
  }
  if (rows.empty()) return fail("CA110", "no measurements");
  for (const Systematic& part : options.systematic)
    if (part.quantity == Quantity::force_gain)
      return fail("CA151", "a calibration of places knows no force_gain", part.place,
                  "it serves `polypod identify compliance`");
  // Rows whose joints the drawing cannot take stand beyond a singular pose of it, or are wrong.
  const TakenRows by_drawing = taken_by(nominal, rows);
  const auto& [taken, poses, number, untaken] = by_drawing;
  Setting setting;
  setting.seed = poses;
  if (too_many_lost(rows.size() - taken.size(), rows.size())) {
    const std::string likely = mixed_up(nominal, rows, options);
    return fail("CA111",
                fmt::format("the machine cannot take the joints of {} of {} rows, of this one for a start",
                            rows.size() - taken.size(), rows.size()),
                untaken->place, likely.empty() ? "check the joints and the machine" : "the likely mistake: " + likely);
  }
  std::optional<Pose> frame;
  if (options.estimate_frame) frame = fitted_frame(taken, poses, options.X_TR);
  POLYPOD_TRY(check_extent(taken, poses, frame.value_or(options.X_SM), options.X_TR));
  // No search is needed where one exchange explains nearly all of what lies between the readings and the drawing.
  constexpr double kNearlyAll = 100;
  if (const std::string likely = mixed_up(nominal, taken, options, kNearlyAll); !likely.empty())
    return fail("CA119", "the readings are far from the machine as drawn", {}, "the likely mistake: " + likely);
  setting.pose = poses_of(nominal, taken);
  setting.share.assign(taken.size(), 1);
  Result<Fitted> result = validated(nominal, taken, setting, options);
  if (!result) {
    Error error = result.error();
    const bool searched = error.id == "CA115" || error.id == "CA118";
    const std::string likely = searched ? mixed_up(nominal, taken, options) : std::string();
    if (!likely.empty()) error.hint = "the likely mistake: " + likely;
    return tl::unexpected(std::move(error));
  }
  Fitted& fitted = *result;
  Calibration& out = fitted.found;
  setting.from = fitted.ended;
  CalibrationOptions everything = options;
  everything.hold_back = 0;
  try_common(nominal, taken, setting, everything, out);
  out.moved = moved_farthest(out, options);
  out.drift = drift_in(taken, setting.pose, out.residuals);
  out.verdict = judged(nominal, taken, out, options);
  out.verdict.text += remarks(out, options);
  if (out.verdict.answer == Answer::no) {
    const std::string likely = mixed_up(nominal, taken, options);
    if (!likely.empty()) out.verdict.text += fmt::format(" The likely mistake: {}.", likely);
  }
  out.orientation_told = std::none_of(out.verdict.left_open.begin(), out.verdict.left_open.end(),
                                      [](const std::string& c) { return c.ends_with("_deg"); });
  if (untaken != nullptr) out.residuals = with_untaken(rows, number, std::move(out.residuals));
  return std::move(out);
}

}  // namespace polypod::calibration
