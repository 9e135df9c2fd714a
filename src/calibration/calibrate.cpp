// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/calibrate.hpp"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "common.hpp"
#include "distributions.hpp"
#include "extent.hpp"
#include "groups.hpp"
#include "model.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/units.hpp"
#include "systematic_columns.hpp"

namespace polypod::calibration {

namespace {

/// Where a robust loss begins to bend for rows of n equations, in standard deviations: beyond what normal noise does.
double bend_of(int n) {
  return std::sqrt(double(n)) + 2;
}
double outlier_of(int n) {
  return std::sqrt(double(n)) + 3;
}

/// The whole problem; `x` is every unknown, `wanted` says which of them are searched for.
struct Problem {
  const AnyMachine& machine;
  const std::vector<Measurement>& rows;
  const CalibrationOptions& options;
  std::vector<machine::Parameter> nominal{};
  Layout layout{};
  Noise noise{};
  std::vector<Pose> seed{};        ///< the nominal pose of every row
  std::vector<bool> not_fitted{};  ///< held back, or lost
  std::vector<double> share{};     ///< for how many independent rows each counts
  Eigen::VectorXd start{}, scale{};
  std::vector<bool> chosen{};   ///< of the parameters
  std::vector<int> unfitted{};  ///< columns of the parameters that are neither searched for nor held: uncertain still
  std::vector<int> wanted{};    ///< columns of the unknowns that are searched for
  Eigen::VectorXd prior{};      ///< standard deviation of each unknown round its start
  double noise_scale = 1;       ///< what the residuals show of the noise, over the one that was given

  [[nodiscard]] int column(std::size_t parameter) const { return layout.parameters + static_cast<int>(parameter); }
  [[nodiscard]] bool is_length(std::size_t parameter) const { return nominal[parameter].unit == "mm"; }
  bool equations(std::size_t row, const Eigen::VectorXd& x, bool by_unknowns, Equations& out,
                 Lost lost = Lost::first_order) const {
    return equations_of(machine, rows[row], seed[row], layout, x, noise, by_unknowns, out, lost);
  }

  /// The rules that the parameters keep as further equations: r(x) and J (over all unknowns).
  void rules(const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd& J) const {
    constexpr double kRuleNoise = 1e-7;  // rules hold to this: a length error of 0.1 um on a metre
    rules_at(machine, layout, x, r, J);
    r /= kRuleNoise;
    J /= kRuleNoise;
  }

  /// Rules and priors. A prior counts as much as the noise that the residuals show, not the one that was given.
  void extra(const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd& J) const {
    rules(x, r, J);
    Eigen::Index row = r.size();
    const auto priors = static_cast<Eigen::Index>(wanted.size());
    r.conservativeResize(row + priors);
    J.conservativeResize(row + priors, layout.count);
    J.bottomRows(priors).setZero();
    for (const int j : wanted) {
      J(row, j) = noise_scale / prior[j];
      r[row++] = (x[j] - start[j]) * noise_scale / prior[j];
    }
  }
};

/// One row (or, for `row` beyond the last, all rules and priors) as Ceres asks for it.
class RowCost : public ceres::CostFunction {
 public:
  RowCost(const Problem& problem, std::size_t row, int equations) : problem_(problem), row_(row) {
    set_num_residuals(equations);
    mutable_parameter_block_sizes()->push_back(static_cast<int>(problem.wanted.size()));
  }
  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const std::vector<int>& wanted = problem_.wanted;
    Eigen::VectorXd x = problem_.start;
    for (std::size_t k = 0; k < wanted.size(); ++k) x[wanted[k]] = blocks[0][k];
    const bool derivatives = jacobians != nullptr && jacobians[0] != nullptr;
    Equations e;
    if (row_ < problem_.rows.size()) {
      if (!problem_.equations(row_, x, derivatives, e)) return false;
    } else {
      problem_.extra(x, e.r, e.J);
    }
    if (!e.r.allFinite()) return false;
    Eigen::Map<Eigen::VectorXd>(residuals, e.r.size()) = e.r;
    if (derivatives) {
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> J(
          jacobians[0], e.r.size(), static_cast<Eigen::Index>(wanted.size()));
      for (std::size_t k = 0; k < wanted.size(); ++k) J.col(static_cast<Eigen::Index>(k)) = e.J.col(wanted[k]);
    }
    return true;
  }

 private:
  const Problem& problem_;
  std::size_t row_;
};

ceres::LossFunction* loss_of(Loss loss, double bend) {
  switch (loss) {
    case Loss::automatic:  // begins as huber
    case Loss::huber:
      return new ceres::HuberLoss(bend);
    case Loss::cauchy:
      return new ceres::CauchyLoss(bend);
    case Loss::none:
      break;
  }
  return nullptr;
}
double weight_of(Loss loss, double bend, double squared_norm) {
  if (loss == Loss::huber || loss == Loss::automatic)
    return std::min(1.0, bend / std::sqrt(std::max(squared_norm, 1e-300)));
  if (loss == Loss::cauchy) return 1 / (1 + squared_norm / (bend * bend));
  return 1;
}

/// Robust standard deviation of whitened residuals of the fitted rows: 1 where the noise was guessed right.
double robust_scale(const std::vector<Eigen::VectorXd>& residuals, const std::vector<bool>& not_fitted,
                    const std::vector<double>& share, double unknowns) {
  std::vector<double> all;
  double n = 0;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    if (not_fitted[i]) continue;
    all.insert(all.end(), residuals[i].begin(), residuals[i].end());
    n += share[i] * static_cast<double>(residuals[i].size());
  }
  if (!(n > unknowns)) return 1;
  return robust_deviation(Eigen::Map<const Eigen::VectorXd>(all.data(), std::ssize(all))) *
         std::sqrt(n / (n - unknowns));
}

Score score_of(const std::vector<RowResidual>& residuals, bool held_back) {
  Score s;
  double lengths = 0, angles = 0, all_lengths = 0;
  for (const RowResidual& r : residuals) {
    if (r.held_back != held_back) continue;
    ++s.rows;
    if (!r.lost) {
      s.all_before += r.before.head(r.lengths).squaredNorm();
      s.all_after += r.after.head(r.lengths).squaredNorm();
      all_lengths += r.lengths;
    }
    if (r.outlier) {
      ++s.outliers;
      continue;
    }
    const Eigen::Index turns = r.after.size() - r.lengths;
    s.rms_before += r.before.head(r.lengths).squaredNorm();
    s.rms_after += r.after.head(r.lengths).squaredNorm();
    s.max_after = std::max(s.max_after, r.after.head(r.lengths).norm());
    s.angle_before += r.before.tail(turns).squaredNorm();
    s.angle_after += r.after.tail(turns).squaredNorm();
    lengths += r.lengths;
    angles += static_cast<double>(turns);
  }
  for (double* x : {&s.rms_before, &s.rms_after}) *x = lengths > 0 ? std::sqrt(*x / lengths) : 0;
  for (double* x : {&s.all_before, &s.all_after}) *x = all_lengths > 0 ? std::sqrt(*x / all_lengths) : 0;
  for (double* x : {&s.angle_before, &s.angle_after}) *x = angles > 0 ? std::sqrt(*x / angles) : 0;
  return s;
}

/// More than a tenth of the rows is no row near a singular pose, but a wrong machine.
bool too_many_lost(std::size_t lost, std::size_t rows) {
  constexpr double kMostLost = 0.1;
  return double(lost) > std::max(1.0, kMostLost * double(rows));
}

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

constexpr double kLeastNoise = 1e-9;  // of the noise given: below it residuals are rounding
/// With fewer equations beyond what the parameters take up, the residuals' own spread (30 % at 5) says little of the
/// noise.
constexpr double kLeastFree = 5;

/// What the rows are, beside what was read.
struct Setting {
  std::vector<Pose> seed;         ///< the nominal machine's pose of every row, where Newton begins
  std::vector<std::size_t> pose;  ///< which rows stand at one pose
  std::vector<double> share;      ///< for how many independent rows each counts
};

/// One calibration: prepare, then search and judge until every fitted row assembles, then what was found.
class Fit {
 public:
  /// The search begins with the noise as it was given, or with what the drawing leaves of the readings.
  Fit(const AnyMachine& machine, const std::vector<Measurement>& rows, const Setting& setting,
      const CalibrationOptions& options, bool noise_as_given)
      : any_(machine),
        rows_(rows),
        options_(options),
        pose_(setting.pose),
        problem_{machine, rows, options},
        noise_as_given_(noise_as_given) {
    problem_.nominal = kinematics::parameters(machine);
    problem_.noise = {options.noise_position, options.noise_angle};
    problem_.seed = setting.seed;
    problem_.share = setting.share;
  }

  Result<Calibration> run() {
    POLYPOD_TRY(place_rows());
    POLYPOD_TRY(start());
    POLYPOD_TRY(choose_rows());
    POLYPOD_TRY(search_without_lost());
    if (put_back()) POLYPOD_TRY(search_without_lost());
    if (!converged_) {
      return fail(
          "CA115", fmt::format("no convergence in {} steps", out_.iterations), {},
          "check the units of all rows (mm, deg), their signs, and the first guess of frame and target; else give "
          "priors or bounds, or choose fewer parameters");
    }
    POLYPOD_TRY(judge());
    out_.change = change_over_priors();
    say_unknowns();
    POLYPOD_TRY(make_machine());
    return std::move(out_);
  }

 private:
  /// The frames, and whether what was measured can be of this machine.
  Status place_rows() {
    out_.X_SM = options_.X_SM;
    out_.X_TR = options_.X_TR;
    if (options_.estimate_frame) out_.X_SM = fitted_frame(rows_, problem_.seed, out_.X_TR).value_or(out_.X_SM);
    return check_extent(rows_, problem_.seed, out_.X_SM, out_.X_TR);
  }

  /// The unknowns, where they begin, and which of them are asked for.
  Status start() {
    POLYPOD_ASSIGN(chosen, chosen_parameters(problem_.nominal, options_));
    problem_.chosen = chosen;
    problem_.layout = layout_of(rows_, problem_.nominal.size());
    Start from = start_of(any_, problem_.layout, out_.X_SM, out_.X_TR);
    problem_.start = std::move(from.x);
    problem_.scale = std::move(from.scale);
    for (const auto& [name, first] : problem_.layout.contact) {
      Vec3 sum = Vec3::Zero();
      int touched = 0;
      const Measurement* example = nullptr;
      for (std::size_t i = 0; i < rows_.size(); ++i) {
        if (rows_[i].kind != Kind::contact || rows_[i].contact != name) continue;
        sum += (out_.X_SM * problem_.seed[i] * out_.X_TR).p;
        ++touched;
        example = &rows_[i];
      }
      if (touched < 2) {
        return fail("CA117", fmt::format("the place \"{}\" is touched once only", name), example->place,
                    "touch it at least twice, with other joints");
      }
      problem_.start.segment<3>(first) = sum / touched;
    }
    bool turns = false;
    for (const Measurement& row : rows_) turns = turns || row.kind == Kind::pose || row.kind == Kind::axis;
    problem_.wanted = wanted_unknowns(problem_.layout, problem_.chosen, options_, turns);
    CalibrationOptions everything = options_;
    everything.only.clear();
    POLYPOD_ASSIGN(not_held, chosen_parameters(problem_.nominal, everything));
    for (std::size_t i = 0; i < not_held.size(); ++i)
      if (not_held[i] && !problem_.chosen[i]) problem_.unfitted.push_back(problem_.column(i));
    set_priors();
    return {};
  }

  /// What is known before anything is measured: of parameters the priors that were stated, else the default ones, whose
  /// size the measurements may correct; of frame, target and contacts next to nothing.
  void set_priors() {
    constexpr double kNothing = 1000;  // times 1 % of the machine's size and 0.01 rad
    problem_.prior = kNothing * problem_.scale;
    for (std::size_t i = 0; i < problem_.nominal.size(); ++i) {
      const bool length = problem_.is_length(i);
      const double stated = length ? options_.prior_length : options_.prior_angle;
      problem_.prior[problem_.column(i)] = stated > 0 ? stated : length ? kUsualLengthError : kUsualAngleError;
    }
    usual_ = problem_.prior;
    for (const int j : problem_.wanted) {
      const bool parameter = j >= problem_.layout.parameters;
      const bool length = parameter && problem_.is_length(static_cast<std::size_t>(j - problem_.layout.parameters));
      const bool stated = (length ? options_.prior_length : options_.prior_angle) > 0;
      learns_.push_back(!parameter || stated ? Learns::nothing : length ? Learns::lengths : Learns::angles);
    }
  }

  /// Rows to hold back where enough are left, and the residuals before.
  Status choose_rows() {
    std::size_t all = 0;
    for (const Measurement& row : rows_) all += static_cast<std::size_t>(equation_count(row.kind));
    const auto without_prior = static_cast<std::size_t>(std::count_if(
        problem_.wanted.begin(), problem_.wanted.end(), [&](int j) { return j < problem_.layout.parameters; }));
    if (all <= without_prior) {
      return fail(
          "CA110",
          fmt::format("{} equations for {} unknowns of frame, target and places of contact", all, without_prior), {},
          "measure more poses, or give frame and target instead of looking for them");
    }
    std::vector<bool> held_back(rows_.size(), false);
    if (options_.hold_back > 0) {
      // Whole poses: what a repeat says is known from the others of its pose.
      const auto every = static_cast<std::size_t>(std::lround(1 / options_.hold_back));
      std::size_t left = all;
      for (std::size_t i = 0; i < rows_.size(); ++i) {
        held_back[i] = pose_[i] % every == every - 1 && rows_[i].kind != Kind::contact;
        if (held_back[i]) left -= static_cast<std::size_t>(equation_count(rows_[i].kind));
      }
      if (2 * left < 3 * problem_.wanted.size()) held_back.assign(rows_.size(), false);
    }
    problem_.not_fitted = held_back;
    Equations e;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      problem_.equations(i, problem_.start, false, e);
      RowResidual r;
      r.row = i;
      r.before = e.r.cwiseProduct(e.sigma);
      r.lengths = e.lengths;
      r.held_back = held_back[i];
      r.share = problem_.share[i];
      out_.residuals.push_back(std::move(r));
    }
    return {};
  }

  /// Which unknowns the fitted rows tell.
  Status tell_unknowns() {
    known_ = identifiable(stacked(problem_.start, nullptr), problem_.wanted, problem_.scale);
    out_.condition = known_.condition;
    if (known_.kept.empty()) return fail("CA112", "the measurements tell nothing of the chosen parameters");
    return {};
  }

  /// All equations of the fitted rows at x, one under another, rows weighted by `weights` if given; then the rules,
  /// which hold as they do whatever the noise of the rows.
  Eigen::MatrixXd stacked(const Eigen::VectorXd& x, const std::vector<double>* weights) const {
    std::vector<Eigen::MatrixXd> parts;
    Eigen::Index n = 0;
    Equations e;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (problem_.not_fitted[i]) continue;
      problem_.equations(i, x, true, e);
      parts.push_back(weights == nullptr ? e.J : Eigen::MatrixXd(std::sqrt((*weights)[i]) * e.J));
      n += e.r.size();
    }
    problem_.rules(x, e.r, e.J);
    parts.push_back(weights == nullptr ? e.J : Eigen::MatrixXd(problem_.noise_scale * e.J));
    Eigen::MatrixXd J(n + e.J.rows(), problem_.layout.count);
    n = 0;
    for (const Eigen::MatrixXd& part : parts) {
      J.middleRows(n, part.rows()) = part;
      n += part.rows();
    }
    return J;
  }

  void whiten() {
    whitened_.resize(rows_.size());
    Equations e;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      problem_.equations(i, x_, false, e);
      whitened_[i] = e.r;
    }
  }

  static constexpr double kHopeless = 100;  // times the noise

  /// Levenberg-Marquardt. The loss bends at what the residuals themselves show of the noise: first those of the nominal
  /// machine, where nearly everything is within the bend, then those that were found. The priors follow likewise.
  Status search() {
    constexpr int kRounds = 20;
    constexpr int kLookedAt = 6;
    constexpr double kSettled = 0.05, kNoBetter = 0.9;
    x_ = problem_.start;
    problem_.prior = usual_;
    whiten();
    std::vector<double> block;
    for (const int j : problem_.wanted) block.push_back(x_[j]);
    problem_.noise_scale =
        noise_as_given_ ? 1.0 : std::max(1.0, robust_scale(whitened_, problem_.not_fitted, problem_.share, 0));
    // Sizes are learnt once the noise has settled: with too much of it all errors look small, which then keeps it
    // large. Where the noise is taken as it was given, it is the other way round.
    bool sizes = noise_as_given_, held = noise_as_given_;
    for (int round = 0; round < kRounds; ++round) {
      POLYPOD_TRY(solve(block));
      for (std::size_t k = 0; k < problem_.wanted.size(); ++k) x_[problem_.wanted[k]] = block[k];
      whiten();
      const double noise_before = problem_.noise_scale;
      const Eigen::VectorXd prior_before = problem_.prior;
      learn_noise_and_priors(sizes);
      if (held) problem_.noise_scale = 1;
      const double changed = std::max(std::abs(problem_.noise_scale / noise_before - 1),
                                      (problem_.prior.array() / prior_before.array() - 1).abs().maxCoeff());
      if ((sizes && !held && changed < kSettled) || !converged_) break;
      // Data of another machine, or of other columns: with errors of any size no further round will bring it down.
      if (round >= kLookedAt && sizes && !held && problem_.noise_scale > kHopeless &&
          problem_.noise_scale > kNoBetter * noise_before)
        break;
      sizes = sizes || changed < kSettled;
      held = held && changed >= kSettled;
    }
    return {};
  }

  /// The weight that the loss gives each row, and its share.
  std::vector<double> weights() const {
    std::vector<double> out(rows_.size(), 1);
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      out[i] = out_.residuals[i].lost
                   ? 0
                   : weight_of(options_.loss, problem_.noise_scale * bend_of(static_cast<int>(whitened_[i].size())),
                               whitened_[i].squaredNorm());
      out[i] *= problem_.share[i];
    }
    return out;
  }

  /// The fitted rows and rules as a triangle R of these unknowns, R^T R = J^T W J, in units of the noise given.
  Eigen::MatrixXd triangle(const std::vector<double>& weights, const std::vector<int>& unknowns) const {
    return triangle_of(stacked(x_, &weights)(Eigen::all, unknowns));
  }
  static Eigen::MatrixXd triangle_of(const Eigen::MatrixXd& rows) {
    const Eigen::Index n = rows.cols();
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(std::max(rows.rows(), n), n);
    J.topRows(rows.rows()) = rows;
    return J.householderQr().matrixQR().topRows(n).triangularView<Eigen::Upper>();
  }

  /// A root C of the covariance of the wanted unknowns over their priors P: C C^T = (P R^T R P / s^2 + 1)^-1.
  Eigen::MatrixXd root_of_covariance(const Eigen::MatrixXd& R, const Eigen::VectorXd& prior, double noise) const {
    const Eigen::Index n = R.cols();
    Eigen::MatrixXd both(2 * n, n);
    both.topRows(n) = R * (prior / noise).asDiagonal();
    both.bottomRows(n).setIdentity();
    const Eigen::MatrixXd T = both.householderQr().matrixQR().topRows(n).triangularView<Eigen::Upper>();
    return T.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(n, n));
  }

  /// Noise and the size of the machine's errors, as the residuals and the changes found show them. Of each kind of
  /// parameter (lengths, angles) the default prior is scaled by t where the likelihood of the measurements (MacKay,
  /// Bayesian Interpolation, 1992) times what is thought of t beforehand is greatest:
  ///   sum (change / prior)^2 - sum (1 - variance / prior^2) + rules = pull_of(ln t).
  /// What a rule tells (of a unit vector its length) is nothing that was measured.
  /// Changes follow a new prior in first order. Without `sizes` of the noise alone.
  void learn_noise_and_priors(bool sizes) {
    constexpr int kSteps = 100;
    constexpr double kLongestStep = 0.7;  // of ln t
    constexpr double kSettled = 1e-3;
    const Eigen::MatrixXd R = triangle(weights(), problem_.wanted);
    const auto n = static_cast<Eigen::Index>(problem_.wanted.size());
    Eigen::VectorXd prior = of_wanted(problem_.prior), change = of_wanted(x_ - problem_.start);
    const Eigen::VectorXd usual = of_wanted(usual_);
    // The gradient of what was minimised is 0: R^T R change - J^T W (measured - computed) = -s^2 change / prior^2.
    const double s = problem_.noise_scale;
    const Eigen::VectorXd right = R.transpose() * (R * change) + s * s * change.cwiseQuotient(prior.cwiseAbs2());
    if (sizes) prior = usual;
    const std::array<std::size_t, 2> rules{rules_among(wanted_of(Learns::lengths)),
                                           rules_among(wanted_of(Learns::angles))};
    double told = 0;
    for (int step = 0; step < kSteps; ++step) {
      const Eigen::MatrixXd C = root_of_covariance(R, prior, s);
      const Eigen::VectorXd variance = C.rowwise().squaredNorm();  // over prior^2
      change = prior.asDiagonal() * (C * (C.transpose() * (prior.cwiseProduct(right) / (s * s))));
      told = static_cast<double>(n) - variance.sum() - static_cast<double>(rules[0] + rules[1]);
      if (!sizes) break;
      double moved = 0;
      for (const Learns kind : {Learns::lengths, Learns::angles}) {
        double seen = 0, expected = -static_cast<double>(rules[kind == Learns::lengths ? 0 : 1]), log_t = 0;
        for (Eigen::Index k = 0; k < n; ++k) {
          if (learns_[std::size_t(k)] != kind) continue;
          seen += std::pow(change[k] / prior[k], 2);
          expected += 1 - variance[k];
          log_t = std::log(prior[k] / usual[k]);
        }
        const auto [pull, stiffness] = pull_of(log_t);
        expected = std::max(0.0, expected);
        const double by = std::clamp((seen - expected - pull) / (2 * std::max(seen, expected) + stiffness),
                                     -kLongestStep, kLongestStep);
        for (Eigen::Index k = 0; k < n; ++k)
          if (learns_[std::size_t(k)] == kind) prior[k] *= std::exp(by);
        moved = std::max(moved, std::abs(by));
      }
      if (moved < kSettled) break;
    }
    for (Eigen::Index k = 0; k < n; ++k) problem_.prior[problem_.wanted[static_cast<std::size_t>(k)]] = prior[k];
    problem_.noise_scale = std::max(kLeastNoise, robust_scale(whitened_, problem_.not_fitted, problem_.share, told));
  }

  enum class Learns { nothing, lengths, angles };
  /// Columns of the unknowns whose size is learnt with the others of this kind.
  std::vector<int> wanted_of(Learns kind) const {
    std::vector<int> out;
    for (std::size_t k = 0; k < learns_.size(); ++k)
      if (learns_[k] == kind) out.push_back(problem_.wanted[k]);
    return out;
  }

  /// How strongly the default size of the errors draws t, e^u times of it, back: the derivative of -ln p(u), and a
  /// bound of its own derivative. p is Student's t of u: near t = 1 it counts as four parameters that are off as usual,
  /// so that few readings cannot turn it over, and nowhere as more than three, so that machines that agree with their
  /// drawing, a hundred times better than usual, are seen to.
  static std::pair<double, double> pull_of(double u) {
    constexpr double kStiff = 8;  // sum (change / prior)^2 = 4 / t^2 of four parameters changes by so much a u
    constexpr double kTail = 4;   // the pull is greatest at u = sqrt(kTail / kStiff): sqrt(kTail kStiff) / 2 = 2.8
    return {kStiff * u / (1 + kStiff * u * u / kTail), kStiff};
  }

  /// The parts of the searched unknowns.
  Eigen::VectorXd of_wanted(const Eigen::VectorXd& all) const { return all(problem_.wanted); }

  /// One search from `block` with the bend where it is now.
  Status solve(std::vector<double>& block) {
    ceres::Problem search;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (problem_.not_fitted[i]) continue;
      const int n = equation_count(rows_[i].kind);
      ceres::LossFunction* loss = loss_of(options_.loss, problem_.noise_scale * bend_of(n));
      if (problem_.share[i] < 1) loss = new ceres::ScaledLoss(loss, problem_.share[i], ceres::TAKE_OWNERSHIP);
      search.AddResidualBlock(new RowCost(problem_, i, n), loss, block.data());
    }
    Equations e;
    problem_.extra(x_, e.r, e.J);
    if (e.r.size() > 0) {
      search.AddResidualBlock(new RowCost(problem_, rows_.size(), static_cast<int>(e.r.size())), nullptr, block.data());
    }
    for (std::size_t k = 0; k < problem_.wanted.size(); ++k) {
      if (problem_.wanted[k] < problem_.layout.parameters) continue;
      const auto i = static_cast<std::size_t>(problem_.wanted[k] - problem_.layout.parameters);
      const double bound = problem_.is_length(i) ? options_.bound_length : options_.bound_angle;
      if (!(bound > 0)) continue;
      search.SetParameterLowerBound(block.data(), static_cast<int>(k), problem_.nominal[i].value - bound);
      search.SetParameterUpperBound(block.data(), static_cast<int>(k), problem_.nominal[i].value + bound);
    }
    ceres::Solver::Options how;
    how.linear_solver_type = ceres::DENSE_QR;
    how.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
    how.max_num_iterations = 100;
    how.function_tolerance = 1e-12;
    how.gradient_tolerance = 1e-14;
    how.parameter_tolerance = 1e-12;
    how.logging_type = ceres::SILENT;
    how.num_threads = 1;
    ceres::Solver::Summary summary;
    ceres::Solve(how, &search, &summary);
    out_.iterations += static_cast<int>(summary.iterations.size());
    if (!summary.IsSolutionUsable()) return fail("CA115", "the search failed: " + summary.message);
    converged_ = summary.termination_type != ceres::NO_CONVERGENCE;
    return {};
  }

  Status search_without_lost() {
    do {
      POLYPOD_TRY(tell_unknowns());
      POLYPOD_TRY(search());
    } while (leave_out_lost());
    return {};
  }

  /// Rows that were lost only because others had drawn the search aside. True if there are any.
  bool put_back() {
    bool any = false;
    Equations e;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      RowResidual& r = out_.residuals[i];
      if (!r.lost || !problem_.equations(i, x_, false, e, Lost::fail)) continue;
      r.lost = false;
      problem_.not_fitted[i] = r.held_back;
      any = any || !r.held_back;
    }
    return any;
  }

  /// Marks the rows where the machine does not assemble with what was found: near a singular pose an error of a tenth
  /// of a millimetre moves the tool by many, and beyond it there is no pose. True where a fitted row is among them,
  /// which has drawn the search aside; it begins again without.
  bool leave_out_lost() {
    bool again = false;
    Equations e;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      RowResidual& r = out_.residuals[i];
      if (r.lost || problem_.equations(i, x_, false, e, Lost::fail)) continue;
      r.lost = true;
      again = again || !problem_.not_fitted[i];
      problem_.not_fitted[i] = true;
    }
    return again;
  }

  /// Weights, outliers, and the covariance that the residuals and the priors show: (J^T W J / s^2 + P^-2)^-1 with
  /// s^2 = sum w^2 |r|^2 / (sum w n - told unknowns) (Huber 1973 in its simplest form).
  Status judge() {
    const std::vector<double> weight = weights();
    double sum = 0, count = 0;
    std::size_t lost = 0;
    const Measurement* example = nullptr;
    Equations e;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const int n = static_cast<int>(whitened_[i].size());
      const double square = whitened_[i].squaredNorm();
      problem_.equations(i, x_, false, e);
      RowResidual& r = out_.residuals[i];
      r.after = e.r.cwiseProduct(e.sigma);
      r.weight = weight[i] / problem_.share[i];
      r.outlier =
          r.lost || (std::sqrt(square) > problem_.noise_scale * outlier_of(n) && r.after.cwiseAbs().maxCoeff() > 1e-9);
      if (r.lost) {
        ++lost;
        example = &rows_[i];
      }
      if (problem_.not_fitted[i]) continue;
      out_.equations += static_cast<std::size_t>(n);
      sum += weight[i] * r.weight * square;
      count += weight[i] * n;
      gain_ += weight[i] * (r.before.cwiseQuotient(e.sigma).squaredNorm() - square);
    }
    if (too_many_lost(lost, rows_.size())) {
      return fail(
          "CA115",
          fmt::format("with the parameters that were found the machine does not assemble in {} of {} rows", lost,
                      rows_.size()),
          example->place,
          "check the units of all rows (mm, deg) and their signs; are they near singular poses? leave them out, or "
          "give priors");
    }
    set_covariance(weight, sum, count);
    out_.gain = gain_in_deviations(weight);
    if (out_.noise_factor > kHopeless) {
      return fail(
          "CA118",
          fmt::format("the residuals that are left are {:.0f} times the noise that was given", out_.noise_factor), {},
          "coordinates mixed up, or a frame or target that is not the given one (--estimate)? If the instrument "
          "is that coarse, give --noise-um; if the machine may be off by more than usual, --prior-mm and --prior-deg");
    }
    out_.fitted = score_of(out_.residuals, false);
    out_.held_back = score_of(out_.residuals, true);
    return {};
  }

  /// `sum`: of the weighted squares, `count`: of the weighted equations.
  void set_covariance(const std::vector<double>& weight, double sum, double count) {
    std::vector<int> both = problem_.wanted;
    both.insert(both.end(), problem_.unfitted.begin(), problem_.unfitted.end());
    const auto n = static_cast<Eigen::Index>(problem_.wanted.size());
    const auto all = static_cast<Eigen::Index>(both.size());
    const Eigen::MatrixXd R_all = triangle(weight, both), R = R_all.topLeftCorner(n, n);
    const Eigen::VectorXd prior = of_wanted(problem_.prior);
    const Eigen::MatrixXd C = root_of_covariance(R, prior, problem_.noise_scale);
    const double told = static_cast<double>(n) - C.squaredNorm() - static_cast<double>(rules_among(problem_.wanted));
    out_.free_equations = count - told;
    out_.noise_factor = std::sqrt(sum / std::max(1.0, out_.free_equations));
    out_.taken_up = told;
    out_.chi_square = sum;
    out_.chi_square_p = chi_square_above(sum, std::max(1.0, out_.free_equations));
    out_.student = student_quantile(0.05, std::max(1.0, out_.free_equations));
    out_.others_uncertain = !problem_.unfitted.empty();
    // What was searched for is off by its own covariance, and by what the parameters that were not searched for do to
    // it (Schmidt's consider analysis): K J_u P_u with K = C R^T / s^2; those themselves by their priors.
    const double s = noise_that_counts();
    Eigen::MatrixXd root = Eigen::MatrixXd::Zero(all, all);
    root.topLeftCorner(n, n) = prior.asDiagonal() * root_of_covariance(R, prior, s);
    if (all > n) {
      const Eigen::VectorXd unfitted = problem_.prior(problem_.unfitted);
      const auto own = root.topLeftCorner(n, n);
      root.topRightCorner(n, all - n) =
          own * (own.transpose() * (R.transpose() * (R_all.topRightCorner(n, all - n) * unfitted.asDiagonal()))) /
          (s * s);
      root.bottomRightCorner(all - n, all - n) = -unfitted.asDiagonal().toDenseMatrix();
    }
    // Its covariance in parts: K R^T R K^T / s^2 is of the readings' scatter, the rest is left of the priors.
    const auto own = root.topLeftCorner(n, n);
    const Eigen::MatrixXd scatter = own * (own.transpose() * R.transpose()) / s;
    set_systematic(weight, own, s);
    const Eigen::Index parts = std::ssize(out_.systematic);
    Eigen::MatrixXd of_all = Eigen::MatrixXd::Zero(problem_.layout.count, all + parts + scatter.cols());
    for (Eigen::Index k = 0; k < all; ++k) {
      auto row = of_all.row(both[static_cast<std::size_t>(k)]);
      row.head(all) = root.row(k);
      if (k >= n) continue;
      row.segment(all, parts) = shift_.row(k);
      row.tail(scatter.cols()) = scatter.row(k);
    }
    error_ = of_all.leftCols(all + parts).rowwise().norm();
    error_of_readings_ = of_all.leftCols(all).rowwise().norm();
    const auto parameters = static_cast<Eigen::Index>(problem_.nominal.size());
    const auto square = [&](const auto& columns) -> Eigen::MatrixXd {
      return columns.bottomRows(parameters) * columns.bottomRows(parameters).transpose();
    };
    out_.covariance_systematic = square(of_all.middleCols(all, parts));
    out_.covariance_readings = square(of_all.rightCols(scatter.cols()));
    const Eigen::MatrixXd without = square(of_all.leftCols(all));
    out_.covariance_drawing = without - out_.covariance_readings;
    out_.covariance = without + out_.covariance_systematic;
    set_covariance_before(both);
  }

  /// What systematic parts do to the unknowns that were searched for, whose covariance has the root `own`: K J_b, K =
  /// -C J^T W / s^2.
  void set_systematic(const std::vector<double>& weight, const Eigen::MatrixXd& own, double s) {
    const std::vector<SystematicUnknown> unknowns = unknowns_of(options_.systematic, rows_);
    const Eigen::Index count = std::ssize(unknowns);
    Eigen::MatrixXd seen = Eigen::MatrixXd::Zero(own.rows(), count);  // J^T W J_b
    Equations e;
    for (std::size_t i = 0; count > 0 && i < rows_.size(); ++i) {
      if (problem_.not_fitted[i]) continue;
      problem_.equations(i, x_, true, e);
      const Eigen::MatrixXd by_part =
          systematic_columns(options_.systematic, unknowns, rows_[i], problem_.seed[i], problem_.layout, x_, e);
      seen += weight[i] * (e.J(Eigen::all, problem_.wanted).transpose() * by_part);
    }
    shift_ = -own * (own.transpose() * seen) / (s * s);
    out_.systematic.clear();
    for (Eigen::Index k = 0; k < count; ++k) {
      const SystematicUnknown& unknown = unknowns[static_cast<std::size_t>(k)];
      const Systematic& part = options_.systematic[unknown.part];
      const bool of_three = part.quantity == Quantity::offset || part.quantity == Quantity::target;
      SystematicEffect effect{unknown.part,
                              unknown.axis >= 0 ? std::string(1, "xyz"[unknown.axis])
                              : of_three        ? std::string("reading")
                                                : std::string(),
                              part.standard_uncertainty()};
      effect.by_parameter = Eigen::VectorXd::Zero(std::ssize(problem_.nominal));
      for (std::size_t j = 0; j < problem_.wanted.size(); ++j) {
        const int parameter = problem_.wanted[j] - problem_.layout.parameters;
        if (parameter >= 0) effect.by_parameter[parameter] = shift_(static_cast<Eigen::Index>(j), k);
      }
      shift_.col(k) *= effect.standard_uncertainty;
      out_.systematic.push_back(std::move(effect));
    }
  }

  /// By how many standard deviations the squared residuals of the fitted rows have become smaller, beyond what the fit
  /// takes out of mere noise. Where the drawing is exact, r = (1 - H) n with the noise n and H = J (J^T W J + s^2
  /// P^-2)^-1 J^T W, so that the difference has the mean s^2 tr(2 H - H^2) and the variance 2 s^4 tr((2 H - H^2)^2);
  /// the eigenvalues of H are 1 - those of the covariance over the priors.
  double gain_in_deviations(const std::vector<double>& weight) const {
    const double s = noise_that_counts();
    const Eigen::MatrixXd C = root_of_covariance(triangle(weight, problem_.wanted), of_wanted(problem_.prior), s);
    const Eigen::ArrayXd left = Eigen::JacobiSVD<Eigen::MatrixXd>(C).singularValues().array().square();
    const Eigen::ArrayXd taken = 1 - left.square();  // 2 h - h^2
    return (gain_ / (s * s) - taken.sum()) / std::sqrt(std::max(2 * taken.square().sum(), 1e-300));
  }

  /// Root mean square of the parameters' changes over the priors before their size was learnt.
  double change_over_priors() const {
    double squares = 0, count = 0;
    for (const int j : problem_.wanted) {
      if (j < problem_.layout.parameters) continue;
      squares += std::pow((x_[j] - problem_.start[j]) / usual_[j], 2);
      ++count;
    }
    return count > 0 ? std::sqrt(squares / count) : 0;
  }

  /// Too few rows cannot contradict the noise that was given.
  double noise_that_counts() const {
    const double s = std::max(out_.noise_factor, kLeastNoise);
    return out_.free_equations < kLeastFree ? std::max(1.0, s) : s;
  }

  /// What the drawing says of the parameters: the priors, as far as the rules that parameters keep leave them.
  void set_covariance_before(const std::vector<int>& uncertain) {
    std::vector<int> columns;
    for (const int j : uncertain)
      if (j >= problem_.layout.parameters) columns.push_back(j);
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    problem_.rules(problem_.start, r, J);
    const Eigen::VectorXd prior = problem_.prior(columns);
    const Eigen::MatrixXd root = prior.asDiagonal() * root_of_covariance(triangle_of(J(Eigen::all, columns)), prior, 1);
    Eigen::MatrixXd of_all = Eigen::MatrixXd::Zero(problem_.layout.count, root.cols());
    for (std::size_t k = 0; k < columns.size(); ++k) of_all.row(columns[k]) = root.row(Eigen::Index(k));
    const auto parameters = static_cast<Eigen::Index>(problem_.nominal.size());
    out_.covariance_before = of_all.bottomRows(parameters) * of_all.bottomRows(parameters).transpose();
    out_.prior = Eigen::VectorXd::Zero(parameters);
    for (const int j : columns) out_.prior[j - problem_.layout.parameters] = problem_.prior[j];
  }

  /// Every unknown with its standard error, or with what it acts like.
  void say_unknowns() {
    const Layout& layout = problem_.layout;
    const auto unknown = [&](int j) { return unknown_of(any_, layout, j); };
    for (std::size_t i = 0; i < problem_.nominal.size(); ++i) {
      if (!problem_.chosen[i]) continue;
      const machine::Parameter& p = problem_.nominal[i];
      const int column = problem_.column(i);
      Estimate one{p.key, p.unit, p.value, x_[column], error_[column], true, false, {}};
      one.standard_error_readings = error_of_readings_[column];
      one.student = student_of(column);
      const double bound = problem_.is_length(i) ? options_.bound_length : options_.bound_angle;
      one.at_bound = bound > 0 && std::abs(x_[column] - p.value) > bound * (1 - 1e-6);
      const auto tie = known_.ties.find(column);
      if (tie != known_.ties.end()) {
        one.identifiable = false;
        for (int j = 0; j < layout.count; ++j) {
          // A factor by which a change of 1 % here shows as less than 0.01 % there is none.
          const double share = tie->second[j] * problem_.scale[column] / problem_.scale[j];
          if (std::abs(share) > 0.01) one.like.push_back({unknown(j).key, unknown(j).unit, tie->second[j]});
        }
        std::stable_sort(one.like.begin(), one.like.end(),
                         [](const auto& a, const auto& b) { return std::abs(a.factor) > std::abs(b.factor); });
      } else {
        ++out_.rank;
      }
      out_.parameters.push_back(std::move(one));
    }
    for (const int j : problem_.wanted) {
      if (j >= layout.parameters || !known_.ties.contains(j)) continue;
      out_.held_beside.push_back(unknown(j).key);
      error_[j] = 0;
    }
    const std::size_t rules = rules_among(problem_.wanted);
    out_.unknowns = problem_.wanted.size() - rules;
    out_.told = known_.kept.size() - std::min(rules, known_.kept.size());
    out_.scale = 1 + x_[layout.scale];
    out_.scale_error = error_[layout.scale];
    out_.X_SM = pose_from(x_.data() + layout.frame);
    out_.X_TR = pose_from(x_.data() + layout.target);
    out_.frame_error = error_.segment<6>(layout.frame);
    out_.target_error = error_.segment<6>(layout.target);
  }

  /// Of the interval of one unknown: degrees of freedom as Welch and Satterthwaite, systematic parts having no end of
  /// them.
  double student_of(int column) const {
    if (!(error_[column] > error_of_readings_[column])) return out_.student;
    const double ratio = error_[column] / std::max(error_of_readings_[column], 1e-3 * error_[column]);
    return student_quantile(0.05, std::max(1.0, out_.free_equations) * std::pow(ratio, 4));
  }

  /// How many rules hold unknowns among these.
  std::size_t rules_among(const std::vector<int>& columns) const {
    Eigen::VectorXd r;
    Eigen::MatrixXd J;
    problem_.rules(problem_.start, r, J);
    std::size_t out = 0;
    for (Eigen::Index i = 0; i < J.rows(); ++i) out += J(i, columns).isZero(0) ? 0 : 1;
    return out;
  }

  Status make_machine() {
    const Eigen::VectorXd p = x_.tail(static_cast<Eigen::Index>(problem_.nominal.size()));
    POLYPOD_ASSIGN(calibrated, machine::with_parameters(any_, std::vector<double>(p.begin(), p.end())));
    std::set<std::string> kinds;
    for (const Measurement& row : rows_) kinds.insert(name_of(row.kind));
    std::string what;
    for (const std::string& kind : kinds) what += (what.empty() ? "" : " and ") + kind;
    machine::note(calibrated, "calibration",
                  fmt::format("{} of {} parameters from {} measured {}; rms {:.1f} um before, {:.1f} um after",
                              out_.rank, out_.parameters.size(), rows_.size(), what,
                              units::to_um(out_.fitted.rms_before), units::to_um(out_.fitted.rms_after)));
    out_.machine = std::move(calibrated);
    return {};
  }

  const AnyMachine& any_;
  const std::vector<Measurement>& rows_;
  const CalibrationOptions& options_;
  const std::vector<std::size_t>& pose_;
  Problem problem_;
  Identifiability known_;
  Eigen::VectorXd x_;                      ///< what was found so far
  std::vector<Eigen::VectorXd> whitened_;  ///< residuals there, over their noise
  bool converged_ = false;
  bool noise_as_given_;
  std::vector<Learns> learns_;         ///< of each wanted unknown: with which others the size of its prior is learnt
  Eigen::VectorXd usual_;              ///< the priors before that
  Eigen::VectorXd error_;              ///< standard errors of all unknowns
  Eigen::VectorXd error_of_readings_;  ///< without systematic parts
  Eigen::MatrixXd shift_;              ///< of the wanted unknowns by one standard uncertainty of each systematic part
  double gain_ = 0;                    ///< weighted squares of the fitted rows, before less after
  Calibration out_;
};

/// With the loss of the options; of Loss::automatic with the one that leaves less.
Result<Calibration> fit_with_loss(const AnyMachine& machine, const std::vector<Measurement>& rows,
                                  const Setting& setting, CalibrationOptions options, bool noise_as_given) {
  constexpr double kPulledAside = 3;  // times the noise
  const auto with = [&](Loss loss) {
    options.loss = loss;
    return Fit(machine, rows, setting, options, noise_as_given).run();
  };
  if (options.loss != Loss::automatic) return with(options.loss);
  Result<Calibration> huber = with(Loss::huber);
  const bool searched = huber || huber.error().id == "CA115" || huber.error().id == "CA118";
  if (!searched || (huber && huber->noise_factor <= kPulledAside)) return huber;
  Result<Calibration> cauchy = with(Loss::cauchy);
  if (!cauchy || too_many_lost(cauchy->fitted.outliers + cauchy->held_back.outliers, rows.size())) return huber;
  cauchy->pulled_aside = !huber || cauchy->noise_factor < 0.5 * huber->noise_factor;
  return cauchy->pulled_aside ? cauchy : huber;
}

/// Few rows, or errors beyond what is usual, can be explained in two ways: by an instrument coarser than it was said to
/// be, to which a search that begins with the residuals of the drawing comes, or by the machine. Where the first leaves
/// more than the noise that was given, the search begins again with that noise; its answer counts where it leaves less
/// than half as much, with changes that a machine can have.
Result<Calibration> fit(const AnyMachine& machine, const std::vector<Measurement>& rows, const Setting& setting,
                        const CalibrationOptions& options) {
  constexpr double kCoarse = 1.5;     // times the noise
  constexpr double kMostChange = 10;  // times the priors
  Result<Calibration> first = fit_with_loss(machine, rows, setting, options, false);
  const bool searched = first || first.error().id == "CA115" || first.error().id == "CA118";
  if (!searched || (first && first->noise_factor <= kCoarse)) return first;
  Result<Calibration> second = fit_with_loss(machine, rows, setting, options, true);
  const bool better = second && second->change < kMostChange &&
                      (first ? second->noise_factor < 0.5 * first->noise_factor : second->noise_factor < kCoarse);
  return better ? second : first;
}

/// The same, once more with what repeats have shown of their scatter: they count for as many rows as they are worth.
Result<Calibration> fit_with_repeats(const AnyMachine& machine, const std::vector<Measurement>& rows, Setting& setting,
                                     const CalibrationOptions& options) {
  constexpr int kRounds = 3;
  constexpr double kSettled = 0.02;  // of the correlation
  const std::vector<std::size_t> repeats = repeats_of(rows, setting.pose);
  Result<Calibration> out = fit(machine, rows, setting, options);
  for (int round = 0; out; ++round) {
    const double before = out->repeats.correlation;
    const Repeats now =
        repeats_in(rows, repeats, out->residuals, options.noise_position, options.noise_angle, out->taken_up);
    out->repeats = now;
    if (round == kRounds || (round > 0 && std::abs(now.correlation - before) < kSettled)) break;
    if (now.correlation == 0) break;
    setting.share = shares_of(repeats, now.correlation);
    Result<Calibration> next = fit(machine, rows, setting, options);
    if (!next) break;
    next->repeats = now;
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
      const Result<Calibration> with = fit(machine, rows, setting, with_common(options, what));
      if (with) compare(machine, rows, setting.seed, options, found, *with, trial);
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
    out += " Parameters that were not looked for count with their priors; --hold says that one is exact.";
  if (c.free_equations < kLeastFree)
    out += " The equations are too few to show the noise: no less counts than was given.";
  return out;
}

/// A fit without the rows that are held back, by which these are judged, and then one of all rows.
Result<Calibration> validated(const AnyMachine& machine, const std::vector<Measurement>& rows, Setting& setting,
                              const CalibrationOptions& options) {
  POLYPOD_ASSIGN(judging, fit_with_repeats(machine, rows, setting, options));
  judging.noise_factor_judging = judging.noise_factor;
  if (judging.held_back.rows == 0) return judging;
  CalibrationOptions everything = options;
  everything.hold_back = 0;
  POLYPOD_ASSIGN(out, fit_with_repeats(machine, rows, setting, everything));
  out.held_back = judging.held_back;
  out.noise_factor_judging = judging.noise_factor;
  for (std::size_t i = 0; i < out.residuals.size(); ++i) {
    RowResidual& r = out.residuals[i];
    r.held_back = judging.residuals[i].held_back;
    if (r.held_back) r.judged = judging.residuals[i].after;
  }
  return out;
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
    return fail(
        "CA116", "an option of the calibration is out of range", {},
        "noise must be above 0, priors and bounds not below 0, all of them finite, the share held back 0 to 0.5");
  }
  if (rows.empty()) return fail("CA110", "no measurements");
  for (const Systematic& part : options.systematic)
    if (part.quantity == Quantity::force_gain)
      return fail("CA151", "a calibration of places knows no force_gain", part.place,
                  "it serves `polypod identify compliance`");
  // Rows whose joints the drawing cannot take stand beyond a singular pose of it, or are wrong.
  std::vector<Measurement> taken;
  Setting setting;
  std::vector<std::size_t> number;
  const Measurement* untaken = nullptr;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto at = pose_of_row(nominal, rows[i]);
    if (!at && untaken == nullptr) untaken = &rows[i];
    if (!at) continue;
    taken.push_back(rows[i]);
    setting.seed.push_back(*at);
    number.push_back(i);
  }
  if (too_many_lost(rows.size() - taken.size(), rows.size())) {
    return fail("CA111",
                fmt::format("the machine cannot take the joints of {} of {} rows, of this one for a start",
                            rows.size() - taken.size(), rows.size()),
                untaken->place, "check the joints and the machine");
  }
  setting.pose = poses_of(nominal, taken);
  setting.share.assign(taken.size(), 1);
  POLYPOD_ASSIGN(out, validated(nominal, taken, setting, options));
  CalibrationOptions everything = options;
  everything.hold_back = 0;
  try_common(nominal, taken, setting, everything, out);
  out.moved = moved_farthest(out, options);
  out.drift = drift_in(taken, setting.pose, out.residuals);
  out.verdict = judged(nominal, taken, out, options.systematic);
  out.verdict.text += remarks(out, options);
  out.orientation_told = std::none_of(out.verdict.left_open.begin(), out.verdict.left_open.end(),
                                      [](const std::string& c) { return c.ends_with("_deg"); });
  if (untaken != nullptr) out.residuals = with_untaken(rows, number, std::move(out.residuals));
  return out;
}

}  // namespace polypod::calibration
