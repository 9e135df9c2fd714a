// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "fit.hpp"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dilatation.hpp"
#include "extent.hpp"
#include "losses.hpp"
#include "polypod/core/statistics.hpp"

namespace polypod::calibration {
namespace {

constexpr double kLargestSize = 30;  // t, see Fit::learn_noise_and_priors

// What is thought of t beforehand (Fit::pull_of): sum (change / prior)^2 = 4 / t^2 of four parameters changes by so
// much a u, and the pull is greatest at u = sqrt(kTail / kStiff): sqrt(kTail kStiff) / 2 = 2.8.
constexpr double kStiff = 8, kTail = 4;

/// Looks at all rows, and at rules and priors, where Ceres is going to ask for them.
class Evaluation : public ceres::EvaluationCallback {
 public:
  Evaluation(const Problem& problem, RowsAt& rows, const std::vector<double>& block)
      : problem_(problem), rows_(rows), block_(block) {}

  void PrepareForEvaluation(bool jacobians, bool /*new_point*/) override {
    Eigen::VectorXd x = problem_.start;
    for (std::size_t k = 0; k < problem_.wanted.size(); ++k) x[problem_.wanted[k]] = block_[k];
    rows_.look(x, jacobians);
    problem_.extra(x, extra_.r, extra_.J);
  }
  /// Those of a row, of rules and priors beyond the last; nothing where the machine does not assemble.
  [[nodiscard]] const Equations* of(std::size_t row) const {
    if (row == problem_.rows.size()) return &extra_;
    return rows_.assembles(row) ? &rows_.of(row) : nullptr;
  }

 private:
  const Problem& problem_;
  RowsAt& rows_;
  const std::vector<double>& block_;
  Equations extra_;
};

/// One row, or for `row` beyond the last all rules and priors, as Ceres asks for it.
class RowCost : public ceres::CostFunction {
 public:
  RowCost(const Problem& problem, const Evaluation& at, std::size_t row, int equations)
      : problem_(problem), at_(at), row_(row) {
    set_num_residuals(equations);
    mutable_parameter_block_sizes()->push_back(static_cast<int>(problem.wanted.size()));
  }
  bool Evaluate(double const* const* /*blocks*/, double* residuals, double** jacobians) const override {
    const Equations* e = at_.of(row_);
    if (e == nullptr || !e->r.allFinite()) return false;
    Eigen::Map<Eigen::VectorXd>(residuals, e->r.size()) = e->r;
    if (jacobians == nullptr || jacobians[0] == nullptr) return true;
    const std::vector<int>& wanted = problem_.wanted;
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> J(
        jacobians[0], e->r.size(), static_cast<Eigen::Index>(wanted.size()));
    for (std::size_t k = 0; k < wanted.size(); ++k) J.col(static_cast<Eigen::Index>(k)) = e->J.col(wanted[k]);
    return true;
  }

 private:
  const Problem& problem_;
  const Evaluation& at_;
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

}  // namespace

Fit::Fit(const AnyMachine& machine, const std::vector<Measurement>& rows, const Setting& setting,
         const CalibrationOptions& options, bool noise_as_given)
    : any_(machine),
      rows_(rows),
      options_(options),
      setting_(setting),
      problem_{machine, rows, options},
      noise_as_given_(noise_as_given) {
  problem_.nominal = kinematics::parameters(machine);
  problem_.noise = {options.noise_position, options.noise_angle};
  problem_.seed = setting.seed;
  problem_.share = setting.share;
}

Result<Calibration> Fit::run() {
  place_rows();
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

void Fit::place_rows() {
  out_.X_SM = options_.X_SM;
  out_.X_TR = options_.X_TR;
  if (options_.estimate_frame) out_.X_SM = fitted_frame(rows_, problem_.seed, out_.X_TR).value_or(out_.X_SM);
}

Status Fit::start() {
  POLYPOD_ASSIGN(chosen, chosen_parameters(problem_.nominal, options_));
  problem_.chosen = chosen;
  problem_.layout = layout_of(rows_, problem_.nominal.size());
  problem_.layout.slots = parameter_slots_of(any_, problem_.seed.front(), rows_.front().q);
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
      return fail("CA117", fmt::format("the place \"{}\" is touched only once", name), example->place,
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

void Fit::set_priors() {
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

Status Fit::choose_rows() {
  std::size_t all = 0;
  for (const Measurement& row : rows_) all += static_cast<std::size_t>(equation_count(row.kind));
  const auto without_prior = static_cast<std::size_t>(std::count_if(
      problem_.wanted.begin(), problem_.wanted.end(), [&](int j) { return j < problem_.layout.parameters; }));
  if (all <= without_prior) {
    return fail("CA110",
                fmt::format("{} equations for {} unknowns of frame, target and places of contact", all, without_prior),
                {}, "measure more poses, or give frame and target instead of looking for them");
  }
  std::vector<bool> held_back(rows_.size(), false);
  if (options_.hold_back > 0) {
    // Whole poses: what a repeat says is known from the others of its pose.
    const auto every = static_cast<std::size_t>(std::lround(1 / options_.hold_back));
    std::size_t left = all;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      held_back[i] = setting_.pose[i] % every == every - 1 && rows_[i].kind != Kind::contact;
      if (held_back[i]) left -= static_cast<std::size_t>(equation_count(rows_[i].kind));
    }
    if (2 * left < 3 * problem_.wanted.size()) held_back.assign(rows_.size(), false);
  }
  problem_.not_fitted = held_back;
  seen_.look(problem_.start, true);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    const Equations& e = seen_.of(i);
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

void Fit::see_dilatation() {
  problem_.dilatation = Eigen::VectorXd::Zero(problem_.layout.count);
  std::map<std::string, double> touched;
  for (std::size_t i = 0; i < rows_.size(); ++i)
    if (rows_[i].kind == Kind::contact && !problem_.not_fitted[i]) touched[rows_[i].contact] += problem_.share[i];
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    if (rows_[i].kind != Kind::contact || problem_.not_fitted[i]) continue;
    const double worth = problem_.share[i] * (1 - 1 / std::max(1.0, touched[rows_[i].contact]));
    problem_.dilatation.tail(std::ssize(problem_.nominal)) +=
        worth * dilatation_by_parameters(any_, problem_.seed[i], rows_[i].q, out_.X_TR.p);
  }
}

Status Fit::tell_unknowns() {
  known_ = identifiable(stacked(problem_.start, nullptr), problem_.wanted, problem_.scale);
  out_.condition = known_.condition;
  if (known_.kept.empty()) return fail("CA112", "none of the chosen parameters is identifiable from the measurements");
  return {};
}

Eigen::MatrixXd Fit::stacked(const Eigen::VectorXd& x, const std::vector<double>* weights) const {
  std::vector<Eigen::Index> at;  // of each row its first equation
  Eigen::Index n = 0;
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    at.push_back(n);
    if (!problem_.not_fitted[i]) n += equation_count(rows_[i].kind);
  }
  Equations rules;
  problem_.rules(x, rules.r, rules.J);
  Eigen::MatrixXd J(n + rules.J.rows(), problem_.layout.count);
  seen_.look(x, true);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    if (problem_.not_fitted[i]) continue;
    const Equations& e = seen_.of(i);
    J.middleRows(at[i], e.J.rows()) = (weights == nullptr ? 1.0 : std::sqrt((*weights)[i])) * e.J;
  }
  J.bottomRows(rules.J.rows()) = weights == nullptr ? rules.J : Eigen::MatrixXd(problem_.noise_scale * rules.J);
  return J;
}

void Fit::whiten() {
  whitened_.resize(rows_.size());
  seen_.look(x_, false);
  for (std::size_t i = 0; i < rows_.size(); ++i) whitened_[i] = seen_.of(i).r;
}

Status Fit::search() {
  constexpr int kRounds = 20;
  constexpr int kLookedAt = 6;
  constexpr double kSettled = 0.05, kNoBetter = 0.9;
  x_ = problem_.start;
  problem_.prior = usual_;
  const std::optional<Ended>& from = setting_.from;
  if (from) {
    for (const int j : problem_.wanted) {
      x_[j] = from->x[j];
      if (j >= problem_.layout.parameters) problem_.prior[j] = from->prior[j];
    }
    problem_.noise_scale = from->noise_scale;
  }
  whiten();
  std::vector<double> block;
  for (const int j : problem_.wanted) block.push_back(x_[j]);
  if (!from) {
    problem_.noise_scale =
        noise_as_given_ ? 1.0 : std::max(1.0, robust_scale(whitened_, problem_.not_fitted, problem_.share, 0));
  }
  // Sizes are learnt once the noise has settled: with too much of it all errors look small, which then keeps it
  // large. Where the noise is taken as it was given, it is the other way round.
  bool sizes = from || noise_as_given_, held = !from && noise_as_given_;
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

std::vector<double> Fit::weights() const {
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

Eigen::MatrixXd Fit::triangle(const std::vector<double>& weights, const std::vector<int>& unknowns) const {
  return triangle_of(stacked(x_, &weights)(Eigen::all, unknowns));
}

Eigen::MatrixXd Fit::triangle_of(const Eigen::MatrixXd& rows) {
  const Eigen::Index n = rows.cols();
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(std::max(rows.rows(), n), n);
  J.topRows(rows.rows()) = rows;
  return J.householderQr().matrixQR().topRows(n).triangularView<Eigen::Upper>();
}

Eigen::MatrixXd Fit::root_of_covariance(const Eigen::MatrixXd& R, const Eigen::VectorXd& prior, double noise) const {
  const Eigen::Index n = R.cols();
  Eigen::MatrixXd both(2 * n, n);
  both.topRows(n) = R * (prior / noise).asDiagonal();
  both.bottomRows(n).setIdentity();
  const Eigen::MatrixXd T = both.householderQr().matrixQR().topRows(n).triangularView<Eigen::Upper>();
  return T.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(n, n));
}

void Fit::learn_noise_and_priors(bool sizes) {
  constexpr int kSteps = 100;
  constexpr double kLongestStep = 0.7;  // of ln t
  constexpr double kSettled = 1e-3;
  const Eigen::MatrixXd R = triangle(weights(), problem_.wanted);
  const auto n = static_cast<Eigen::Index>(problem_.wanted.size());
  Eigen::VectorXd prior = of_wanted(problem_.prior), change = of_wanted(x_ - problem_.start);
  const Eigen::VectorXd usual = of_wanted(usual_);
  const double s = problem_.noise_scale;
  // The gradient of what was minimised is 0: R^T R change - J^T W (measured - computed) = -s^2 change / prior^2.
  pull_ = R.transpose() * (R * change) + s * s * change.cwiseQuotient(prior.cwiseAbs2());
  if (sizes) prior = usual;
  const std::array<std::size_t, 2> rules =
      rules_of_ = {rules_among(wanted_of(Learns::lengths)), rules_among(wanted_of(Learns::angles))};
  double told = 0;
  for (int step = 0; step < kSteps; ++step) {
    const Eigen::MatrixXd C = root_of_covariance(R, prior, s);
    const Eigen::VectorXd variance = C.rowwise().squaredNorm();  // over prior^2
    change = prior.asDiagonal() * (C * (C.transpose() * (prior.cwiseProduct(pull_) / (s * s))));
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
      const double by = std::clamp((seen - expected - pull) / (2 * std::max(seen, expected) + stiffness), -kLongestStep,
                                   std::min(kLongestStep, std::log(kLargestSize) - log_t));
      for (Eigen::Index k = 0; k < n; ++k)
        if (learns_[std::size_t(k)] == kind) prior[k] *= std::exp(by);
      moved = std::max(moved, std::abs(by));
    }
    if (moved < kSettled) break;
  }
  for (Eigen::Index k = 0; k < n; ++k) problem_.prior[problem_.wanted[static_cast<std::size_t>(k)]] = prior[k];
  problem_.noise_scale = std::max(kLeastNoise, robust_scale(whitened_, problem_.not_fitted, problem_.share, told));
}

double Fit::likelihood_of_sizes(const Eigen::MatrixXd& squares, const std::array<double, 2>& u) const {
  Eigen::VectorXd prior = of_wanted(problem_.prior);
  std::array<double, 2> log_t{};
  for (std::size_t k = 0; k < learns_.size(); ++k) {
    if (learns_[k] == Learns::nothing) continue;
    const std::size_t kind = learns_[k] == Learns::lengths ? 0 : 1;
    const auto at = static_cast<Eigen::Index>(k);
    prior[at] *= std::exp(u[kind]);
    log_t[kind] = std::log(prior[at] / usual_[problem_.wanted[k]]);
  }
  // -1/2 ln det(1 + P R^T R P / s^2) + 1/2 b^T (1 + P R^T R P / s^2)^-1 b, b = P pull_ / s^2.
  const double s = problem_.noise_scale;
  Eigen::MatrixXd A = prior.asDiagonal() * squares * prior.asDiagonal() / (s * s);
  A.diagonal().array() += 1;
  const Eigen::LLT<Eigen::MatrixXd> root(A);
  const Eigen::VectorXd half = root.matrixL().solve(Eigen::VectorXd(prior.cwiseProduct(pull_) / (s * s)));
  double out = 0.5 * half.squaredNorm() - Eigen::MatrixXd(root.matrixL()).diagonal().array().log().sum();
  for (const Learns kind : {Learns::lengths, Learns::angles}) {
    const double t = log_t[kind == Learns::lengths ? 0 : 1];
    out += static_cast<double>(rules_of_[kind == Learns::lengths ? 0 : 1]) * t + log_thought_of(t);
  }
  return out;
}

std::array<double, 2> Fit::spread_of_sizes(const Eigen::MatrixXd& R) const {
  constexpr double kStep = 0.05, kWidest = 0.5;  // of ln t: of differences, of the grid's unit
  // Units of the grid, and what each node stands for.
  constexpr std::array<double, 13> kNodes{-4, -3, -2, -1.3, -0.7, 0, 0.7, 1.3, 2, 3, 4.5, 6, 8};
  const Eigen::MatrixXd squares = R.transpose() * R;
  const double most = likelihood_of_sizes(squares, {0, 0});
  std::array<std::vector<std::pair<double, double>>, 2> nodes;  // u, share
  for (std::size_t kind = 0; kind < 2; ++kind) {
    const Learns which = kind == 0 ? Learns::lengths : Learns::angles;
    const auto one = std::find(learns_.begin(), learns_.end(), which);
    if (one == learns_.end()) {
      nodes[kind] = {{0, 1}};
      continue;
    }
    std::array<double, 2> up{}, down{};
    up[kind] = kStep;
    down[kind] = -kStep;
    const double bend =
        (likelihood_of_sizes(squares, up) - 2 * most + likelihood_of_sizes(squares, down)) / (kStep * kStep);
    const double unit = bend < 0 ? std::min(kWidest, 1 / std::sqrt(-bend)) : kWidest;
    const int column = problem_.wanted[static_cast<std::size_t>(one - learns_.begin())];
    const double room = std::log(kLargestSize * usual_[column] / problem_.prior[column]);
    for (std::size_t i = 0; i < kNodes.size(); ++i) {
      if (unit * kNodes[i] > room) break;
      const double before = i == 0 ? kNodes[i] : kNodes[i - 1];
      const double after = i + 1 == kNodes.size() || unit * kNodes[i + 1] > room ? kNodes[i] : kNodes[i + 1];
      nodes[kind].emplace_back(unit * kNodes[i], 0.5 * (after - before));
    }
  }
  double sum = 0;
  std::array<double, 2> squared{};
  for (const auto& [u, share_u] : nodes[0]) {
    for (const auto& [v, share_v] : nodes[1]) {
      const double weight = share_u * share_v * std::exp(likelihood_of_sizes(squares, {u, v}) - most);
      sum += weight;
      squared[0] += weight * std::exp(2 * u);
      squared[1] += weight * std::exp(2 * v);
    }
  }
  const auto wide = [&](double x) { return sum > 0 ? std::max(1.0, std::sqrt(x / sum)) : 1.0; };
  return {wide(squared[0]), wide(squared[1])};
}

std::vector<int> Fit::wanted_of(Learns kind) const {
  std::vector<int> out;
  for (std::size_t k = 0; k < learns_.size(); ++k)
    if (learns_[k] == kind) out.push_back(problem_.wanted[k]);
  return out;
}

double Fit::log_thought_of(double u) {
  return -0.5 * kTail * std::log(1 + kStiff * u * u / kTail);
}

std::pair<double, double> Fit::pull_of(double u) {
  return {kStiff * u / (1 + kStiff * u * u / kTail), kStiff};
}

Eigen::VectorXd Fit::of_wanted(const Eigen::VectorXd& all) const {
  return all(problem_.wanted);
}

Status Fit::solve(std::vector<double>& block) {
  Evaluation at(problem_, seen_, block);
  ceres::Problem::Options with;
  with.evaluation_callback = &at;
  ceres::Problem search(with);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    if (problem_.not_fitted[i]) continue;
    const int n = equation_count(rows_[i].kind);
    ceres::LossFunction* loss = loss_of(options_.loss, problem_.noise_scale * bend_of(n));
    if (problem_.share[i] < 1) loss = new ceres::ScaledLoss(loss, problem_.share[i], ceres::TAKE_OWNERSHIP);
    search.AddResidualBlock(new RowCost(problem_, at, i, n), loss, block.data());
  }
  Equations extra;
  problem_.extra(x_, extra.r, extra.J);
  if (extra.r.size() > 0) {
    search.AddResidualBlock(new RowCost(problem_, at, rows_.size(), static_cast<int>(extra.r.size())), nullptr,
                            block.data());
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
  // The priors hold what the readings do not tell, but weakly: damping from the start would slow just these down.
  how.initial_trust_region_radius = 1e12;
  how.function_tolerance = 1e-12;
  how.gradient_tolerance = 1e-14;
  how.parameter_tolerance = 1e-12;
  how.logging_type = ceres::SILENT;
  how.num_threads = 1;  // the rows are taken on all threads before (Evaluation), so that sums have one order
  ceres::Solver::Summary summary;
  ceres::Solve(how, &search, &summary);
  out_.iterations += static_cast<int>(summary.iterations.size());
  if (!summary.IsSolutionUsable()) return fail("CA115", "the search failed: " + summary.message);
  converged_ = summary.termination_type != ceres::NO_CONVERGENCE;
  return {};
}

Status Fit::search_without_lost() {
  do {
    see_dilatation();
    POLYPOD_TRY(tell_unknowns());
    POLYPOD_TRY(search());
  } while (leave_out_lost());
  return {};
}

bool Fit::put_back() {
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

bool Fit::leave_out_lost() {
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

}  // namespace polypod::calibration
