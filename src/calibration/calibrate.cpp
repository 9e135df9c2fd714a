// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/calibrate.hpp"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <set>

#include "model.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/units.hpp"

namespace polypod::calibration {

Layout layout_of(const std::vector<Measurement>& rows, std::size_t parameter_count) {
  Layout out;
  for (const Measurement& row : rows) {
    if (row.kind == Kind::contact && out.contact.try_emplace(row.contact, out.count).second) out.count += 3;
  }
  out.frame = out.count;
  out.target = out.frame + 6;
  out.parameters = out.target + 6;
  out.count = out.parameters + static_cast<int>(parameter_count);
  return out;
}

double size_of(const AnyMachine& machine) {
  double size = 0;
  for (const machine::Parameter& p : kinematics::parameters(machine)) {
    if (p.unit == "mm") size = std::max(size, std::abs(p.value));
  }
  return size > 0 ? size : 1.0;
}

Start start_of(const AnyMachine& machine, const Layout& layout, const Pose& X_SM, const Pose& X_TR) {
  constexpr double kOnePercent = 0.01;
  const double length = kOnePercent * size_of(machine);
  Start out{Eigen::VectorXd::Zero(layout.count), Eigen::VectorXd::Constant(layout.count, kOnePercent)};
  for (const auto& [first, X] : {std::pair{layout.frame, &X_SM}, std::pair{layout.target, &X_TR}}) {
    out.x.segment<3>(first) = X->p;
    out.x.segment<3>(first + 3) = rotation_vector(X->R);
    out.scale.segment<3>(first).setConstant(length);
  }
  for (const auto& [name, first] : layout.contact) out.scale.segment<3>(first).setConstant(length);
  int column = layout.parameters;
  for (const machine::Parameter& p : kinematics::parameters(machine)) {
    out.x[column] = p.value;
    if (p.unit == "mm") out.scale[column] = length;
    ++column;
  }
  return out;
}

Identifiability identifiable(const Eigen::MatrixXd& J, const std::vector<int>& order, const Eigen::VectorXd& scale) {
  constexpr double kSame = 1e-8;  // of a column's own length: far above rounding, far below what noise leaves
  Identifiability out;
  const Eigen::Index n = static_cast<Eigen::Index>(order.size());
  Eigen::MatrixXd Q(J.rows(), n), R = Eigen::MatrixXd::Zero(n, n);
  Eigen::Index rank = 0;
  for (const int j : order) {
    Eigen::VectorXd column = scale[j] * J.col(j);
    const double own = column.norm();
    Eigen::VectorXd parts = Eigen::VectorXd::Zero(rank);
    for (int pass = 0; pass < 2; ++pass) {  // once more, for rounding
      const Eigen::VectorXd part = Q.leftCols(rank).transpose() * column;
      column -= Q.leftCols(rank) * part;
      parts += part;
    }
    const double left = column.norm();
    if (left > 1 && left > kSame * own) {
      R.col(rank).head(rank) = parts;
      R(rank, rank) = left;
      Q.col(rank++) = column / left;
      out.kept.push_back(j);
    } else {
      const Eigen::VectorXd y = R.topLeftCorner(rank, rank).triangularView<Eigen::Upper>().solve(parts);
      Eigen::VectorXd tie = Eigen::VectorXd::Zero(J.cols());
      for (Eigen::Index k = 0; k < rank; ++k) {
        const int kept = out.kept[static_cast<std::size_t>(k)];
        tie[kept] = y[k] * scale[kept] / scale[j];
      }
      out.ties[j] = std::move(tie);
    }
  }
  if (rank > 0) {
    Eigen::MatrixXd unit = R.topLeftCorner(rank, rank);
    unit = unit * unit.colwise().norm().cwiseInverse().asDiagonal();
    const Eigen::VectorXd sigma = unit.bdcSvd().singularValues();
    out.condition = sigma[0] / sigma[rank - 1];
  }
  return out;
}

namespace {

bool begins_with_any(const std::string& key, const std::vector<std::string>& beginnings) {
  return std::any_of(beginnings.begin(), beginnings.end(), [&](const std::string& b) { return key.rfind(b, 0) == 0; });
}

/// As `polypod info` shows it.
std::string full_key(const machine::Parameter& p) {
  return p.unit.empty() ? p.key : p.key + "_" + p.unit;
}

}  // namespace

Result<std::vector<bool>> chosen_parameters(const std::vector<machine::Parameter>& all,
                                            const CalibrationOptions& options) {
  for (const auto* list : {&options.only, &options.hold}) {
    for (const std::string& beginning : *list) {
      const bool known =
          std::any_of(all.begin(), all.end(), [&](const auto& p) { return begins_with_any(full_key(p), {beginning}); });
      if (!known) {
        return fail("CA114", fmt::format("no parameter begins with {}", beginning), {},
                    "`polypod info MACHINE` lists the parameters");
      }
    }
  }
  std::vector<bool> out;
  for (const machine::Parameter& p : all) {
    out.push_back((options.only.empty() || begins_with_any(full_key(p), options.only)) &&
                  !begins_with_any(full_key(p), options.hold));
  }
  return out;
}

std::vector<int> wanted_unknowns(const Layout& layout, const std::vector<bool>& chosen,
                                 const CalibrationOptions& options, bool turns) {
  std::vector<int> out;
  for (int j = 0; j < layout.frame; ++j) out.push_back(j);
  if (options.estimate_frame)
    for (int j = 0; j < 6; ++j) out.push_back(layout.frame + j);
  if (options.estimate_target)
    for (int j = 0; j < (turns ? 6 : 3); ++j) out.push_back(layout.target + j);
  for (std::size_t i = 0; i < chosen.size(); ++i)
    if (chosen[i]) out.push_back(layout.parameters + static_cast<int>(i));
  return out;
}

machine::Parameter unknown_of(const AnyMachine& machine, const Layout& layout, int j) {
  static constexpr const char* kParts[] = {"x", "y", "z", "a", "b", "c"};
  if (j >= layout.parameters) return kinematics::parameters(machine)[static_cast<std::size_t>(j - layout.parameters)];
  if (j >= layout.frame) {
    const bool target = j >= layout.target;
    const int part = j - (target ? layout.target : layout.frame);
    return {fmt::format("{}.{}", target ? "target" : "frame", kParts[part]), 0, part < 3 ? "mm" : "deg"};
  }
  return {"contact", 0, "mm"};
}

namespace {

/// Where a robust loss begins to bend for rows of n equations, in standard deviations: beyond what normal noise does.
double bend_of(int n) {
  return std::sqrt(double(n)) + 2;
}
double outlier_of(int n) {
  return std::sqrt(double(n)) + 3;
}

/// The whole problem for one family; `x` is every unknown, `free` says which of them are searched for.
template <kinematics::Machine M>
struct Problem {
  const M& m;
  const std::vector<Measurement>& rows;
  const CalibrationOptions& options;
  std::vector<machine::Parameter> nominal;
  Layout layout;
  Noise noise;
  std::vector<Pose> seed;        ///< the nominal pose of every row
  std::vector<bool> not_fitted;  ///< held back, or lost
  Eigen::VectorXd start, scale;
  std::vector<bool> chosen;  ///< of the parameters
  std::vector<int> free;

  [[nodiscard]] int column(std::size_t parameter) const { return layout.parameters + static_cast<int>(parameter); }
  [[nodiscard]] bool is_length(std::size_t parameter) const { return nominal[parameter].unit == "mm"; }
  bool equations(std::size_t row, const Eigen::VectorXd& x, bool by_unknowns, Equations& out,
                 Lost lost = Lost::first_order) const {
    return equations_of(m, rows[row], seed[row], layout, x, noise, by_unknowns, out, lost);
  }

  /// Rules and priors as further equations: r(x) and J (over all unknowns).
  void extra(const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd& J) const {
    constexpr double kRuleNoise = 1e-7;  // rules hold to this: a length error of 0.1 um on a metre
    Eigen::VectorXd rule;
    Eigen::MatrixXd by_unknowns;
    rules_at(m, layout, x, rule, by_unknowns);
    std::vector<std::pair<std::size_t, double>> priors;
    for (std::size_t i = 0; i < nominal.size(); ++i) {
      const double prior = is_length(i) ? options.prior_length : options.prior_angle;
      if (chosen[i] && prior > 0) priors.emplace_back(i, prior);
    }
    const Eigen::Index rules = rule.size(), n = rules + static_cast<Eigen::Index>(priors.size());
    r.setZero(n);
    J.setZero(n, layout.count);
    r.head(rules) = rule / kRuleNoise;
    J.topRows(rules) = by_unknowns / kRuleNoise;
    for (std::size_t k = 0; k < priors.size(); ++k) {
      const auto [i, sigma] = priors[k];
      const Eigen::Index row = rules + static_cast<Eigen::Index>(k);
      r[row] = (x[column(i)] - start[column(i)]) / sigma;
      J(row, column(i)) = 1 / sigma;
    }
  }
};

/// One row (or, for `row` beyond the last, all rules and priors) as Ceres asks for it.
template <kinematics::Machine M>
class RowCost : public ceres::CostFunction {
 public:
  RowCost(const Problem<M>& problem, std::size_t row, int equations) : problem_(problem), row_(row) {
    set_num_residuals(equations);
    mutable_parameter_block_sizes()->push_back(static_cast<int>(problem.free.size()));
  }
  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const std::vector<int>& free = problem_.free;
    Eigen::VectorXd x = problem_.start;
    for (std::size_t k = 0; k < free.size(); ++k) x[free[k]] = blocks[0][k];
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
          jacobians[0], e.r.size(), static_cast<Eigen::Index>(free.size()));
      for (std::size_t k = 0; k < free.size(); ++k) J.col(static_cast<Eigen::Index>(k)) = e.J.col(free[k]);
    }
    return true;
  }

 private:
  const Problem<M>& problem_;
  std::size_t row_;
};

ceres::LossFunction* loss_of(Loss loss, double bend) {
  switch (loss) {
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
  if (loss == Loss::huber) return std::min(1.0, bend / std::sqrt(std::max(squared_norm, 1e-300)));
  if (loss == Loss::cauchy) return 1 / (1 + squared_norm / (bend * bend));
  return 1;
}

/// Robust standard deviation of whitened residuals of the fitted rows: 1 where the noise was guessed right.
double robust_scale(const std::vector<Eigen::VectorXd>& residuals, const std::vector<bool>& not_fitted,
                    std::size_t unknowns) {
  std::vector<double> all;
  for (std::size_t i = 0; i < residuals.size(); ++i)
    if (!not_fitted[i]) all.insert(all.end(), residuals[i].begin(), residuals[i].end());
  if (all.size() <= unknowns) return 1;
  const auto n = double(all.size());
  return robust_deviation(Eigen::Map<const Eigen::VectorXd>(all.data(), std::ssize(all))) *
         std::sqrt(n / (n - double(unknowns)));
}

/// Instrument against nominal machine, before anything is fitted: line, unit.
Status check_extent(const std::vector<Measurement>& rows, const std::vector<Pose>& seed, const Pose& X_SM,
                    const Pose& X_TR) {
  Eigen::Matrix3Xd measured(3, 0), model(3, 0);
  double read = 0, computed = 0;
  const Measurement* example = nullptr;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Vec3 at = (X_SM * seed[i] * X_TR).p;
    if (rows[i].kind == Kind::distance) {
      read += rows[i].reading;
      computed += (at - rows[i].anchor_S).norm();
      if (example == nullptr) example = &rows[i];
    }
    model.conservativeResize(3, model.cols() + 1);
    model.rightCols<1>() = at;
    if (rows[i].kind == Kind::distance || rows[i].kind == Kind::gauge || rows[i].kind == Kind::contact) continue;
    measured.conservativeResize(3, measured.cols() + 1);
    measured.rightCols<1>() = rows[i].X_SR.p;
    if (example == nullptr) example = &rows[i];
  }
  const auto spread = [](const Eigen::Matrix3Xd& points) -> Eigen::Vector3d {
    const Eigen::Matrix3Xd centred = points.colwise() - points.rowwise().mean();
    return centred.jacobiSvd().singularValues();
  };
  const auto off = [&](double ratio) -> Status {
    constexpr double kUnit = 3;  // less than an inch for a centimetre; a machine is not that far off
    if (ratio < kUnit && ratio > 1 / kUnit) return {};
    return fail("CA113", fmt::format("measured lengths are {:.3g} times those of the machine", ratio), example->place,
                "lengths are in mm and angles in deg; are these others, or of another machine?");
  };
  if (read > 0) POLYPOD_TRY(off(read / std::max(computed, 1e-12)));
  const Eigen::Vector3d of_model = spread(model);
  if (measured.cols() == model.cols()) POLYPOD_TRY(off(spread(measured)[0] / std::max(of_model[0], 1e-12)));
  bool turned = false;  // full poses tell more than their places
  for (const Measurement& row : rows) turned = turned || row.kind == Kind::pose || row.kind == Kind::axis;
  constexpr double kLine = 1e-6;
  const bool contacts = std::all_of(rows.begin(), rows.end(), [](const auto& r) { return r.kind == Kind::contact; });
  if (!turned && !contacts && !(of_model[1] > kLine * of_model[0])) {
    return fail("CA112", "the measured places lie on a line or in one point", rows.front().place,
                "spread the poses over the workspace");
  }
  return {};
}

/// X_SM that brings the nominal machine's targets nearest to the measured ones (Kabsch), where places were measured.
std::optional<Pose> fitted_frame(const std::vector<Measurement>& rows, const std::vector<Pose>& seed,
                                 const Pose& X_TR) {
  std::vector<std::pair<Vec3, Vec3>> pairs;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].kind == Kind::point || rows[i].kind == Kind::axis || rows[i].kind == Kind::pose)
      pairs.emplace_back((seed[i] * X_TR).p, rows[i].X_SR.p);
  }
  if (pairs.size() < 3) return std::nullopt;
  Eigen::Matrix3Xd from(3, pairs.size()), to(3, pairs.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = pairs[i].first;
    to.col(static_cast<Eigen::Index>(i)) = pairs[i].second;
  }
  const Eigen::Matrix4d T = Eigen::umeyama(from, to, false);
  return Pose{T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>()};
}

Score score_of(const std::vector<RowResidual>& residuals, bool held_back) {
  Score s;
  double lengths = 0, angles = 0;
  for (const RowResidual& r : residuals) {
    if (r.held_back != held_back) continue;
    ++s.rows;
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
  for (double* x : {&s.angle_before, &s.angle_after}) *x = angles > 0 ? std::sqrt(*x / angles) : 0;
  return s;
}

/// One calibration: prepare, then search and judge until every fitted row assembles, then what was found.
template <kinematics::Machine M>
class Fit {
 public:
  Fit(const AnyMachine& any, const M& m, const std::vector<Measurement>& rows, const CalibrationOptions& options)
      : any_(any), rows_(rows), options_(options), problem_{m,       rows,
                                                            options, parameters(m),
                                                            {},      {options.noise_position, options.noise_angle},
                                                            {},      {},
                                                            {},      {},
                                                            {},      {}} {}

  Result<Calibration> run() {
    POLYPOD_TRY(place_rows());
    POLYPOD_TRY(start());
    POLYPOD_TRY(choose_rows());
    POLYPOD_TRY(search_without_lost());
    if (put_back()) POLYPOD_TRY(search_without_lost());
    if (!converged_) {
      return fail("CA115", fmt::format("no convergence in {} steps", out_.iterations), {},
                  "give priors or bounds, choose fewer parameters, or check the first guess of frame and target");
    }
    POLYPOD_TRY(judge());
    say_unknowns();
    POLYPOD_TRY(make_machine());
    return std::move(out_);
  }

 private:
  /// Where the nominal machine stands in every row: the seeds of Newton.
  Status place_rows() {
    const std::vector<double> p = kinematics::nominal_parameters(problem_.m);
    for (const Measurement& row : rows_) {
      const std::span<const double> q(row.q.data(), static_cast<std::size_t>(row.q.size()));
      const auto at =
          kinematics::forward_by_closure(problem_.m, q, std::span<const double>(p), forward(problem_.m, row.q));
      if (!at.converged) {
        return fail("CA111", "the machine cannot take these joints", row.place, "check the joints and the machine");
      }
      problem_.seed.push_back(at.X_MT);
    }
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
      problem_.start.template segment<3>(first) = sum / touched;
    }
    bool turns = false;
    for (const Measurement& row : rows_) turns = turns || row.kind == Kind::pose || row.kind == Kind::axis;
    wanted_ = wanted_unknowns(problem_.layout, problem_.chosen, options_, turns);
    out_.orientation_told = turns || kinematics::task(any_) == machine::Task::point;
    return {};
  }

  /// Rows to hold back where enough are left, and the residuals before.
  Status choose_rows() {
    std::size_t all = 0;
    for (const Measurement& row : rows_) all += static_cast<std::size_t>(equation_count(row.kind));
    const bool priors = options_.prior_length > 0 && options_.prior_angle > 0;
    if (!priors && all <= wanted_.size()) {
      return fail("CA110", fmt::format("{} equations for {} unknowns", all, wanted_.size()), {},
                  "measure more poses, choose parameters, or give priors");
    }
    std::vector<bool> held_back(rows_.size(), false);
    if (options_.hold_back > 0) {
      const auto every = static_cast<std::size_t>(std::lround(1 / options_.hold_back));
      std::size_t left = all;
      for (std::size_t i = every - 1; i < rows_.size(); i += every) {
        held_back[i] = rows_[i].kind != Kind::contact;
        if (held_back[i]) left -= static_cast<std::size_t>(equation_count(rows_[i].kind));
      }
      if (2 * left < 3 * wanted_.size()) held_back.assign(rows_.size(), false);
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
      out_.residuals.push_back(std::move(r));
    }
    return {};
  }

  /// Which unknowns the fitted rows tell.
  Status tell_unknowns() {
    known_ = identifiable(stacked(problem_.start, nullptr), wanted_, problem_.scale);
    problem_.free = known_.kept;
    out_.condition = known_.condition;
    if (problem_.free.empty()) return fail("CA112", "the measurements tell nothing of the chosen parameters");
    return {};
  }

  /// All equations of the fitted rows at x, one under another, rows weighted by `weights` if given.
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
    problem_.extra(x, e.r, e.J);
    parts.push_back(e.J);
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

  /// Levenberg-Marquardt. The loss bends at what the residuals themselves show of the noise: first those of the nominal
  /// machine, where nearly everything is within the bend, then those that were found.
  Status search() {
    constexpr int kRounds = 10;
    constexpr double kSettled = 0.05, kLeastNoise = 1e-12;
    x_ = problem_.start;
    whiten();
    std::vector<double> block;
    for (const int j : problem_.free) block.push_back(x_[j]);
    noise_scale_ = std::max(1.0, robust_scale(whitened_, problem_.not_fitted, problem_.free.size()));
    for (int round = 0; round < kRounds; ++round) {
      POLYPOD_TRY(solve(block));
      for (std::size_t k = 0; k < problem_.free.size(); ++k) x_[problem_.free[k]] = block[k];
      whiten();
      const double found = std::max(kLeastNoise, robust_scale(whitened_, problem_.not_fitted, problem_.free.size()));
      const bool settled = std::abs(found / noise_scale_ - 1) < kSettled;
      noise_scale_ = found;
      if (options_.loss == Loss::none || settled || !converged_) break;
    }
    return {};
  }

  /// One search from `block` with the bend where it is now.
  Status solve(std::vector<double>& block) {
    ceres::Problem search;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (problem_.not_fitted[i]) continue;
      const int n = equation_count(rows_[i].kind);
      search.AddResidualBlock(new RowCost<M>(problem_, i, n), loss_of(options_.loss, noise_scale_ * bend_of(n)),
                              block.data());
    }
    Equations e;
    problem_.extra(x_, e.r, e.J);
    if (e.r.size() > 0) {
      search.AddResidualBlock(new RowCost<M>(problem_, rows_.size(), static_cast<int>(e.r.size())), nullptr,
                              block.data());
    }
    for (std::size_t k = 0; k < problem_.free.size(); ++k) {
      if (problem_.free[k] < problem_.layout.parameters) continue;
      const auto i = static_cast<std::size_t>(problem_.free[k] - problem_.layout.parameters);
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

  /// Weights, outliers, and the standard errors that the residuals show: s^2 (J^T W J)^-1 with
  /// s^2 = sum w^2 |r|^2 / (sum w n - unknowns) (Huber 1973 in its simplest form).
  Status judge() {
    std::vector<double> weights(rows_.size(), 1);
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
      weights[i] = r.lost ? 0 : weight_of(options_.loss, noise_scale_ * bend_of(n), square);
      r.weight = weights[i];
      r.outlier = r.lost || (std::sqrt(square) > noise_scale_ * outlier_of(n) && r.after.cwiseAbs().maxCoeff() > 1e-9);
      if (r.lost) {
        ++lost;
        example = &rows_[i];
      }
      if (problem_.not_fitted[i]) continue;
      out_.equations += static_cast<std::size_t>(n);
      sum += weights[i] * weights[i] * square;
      count += weights[i] * n;
    }
    constexpr double kMostLost = 0.1;  // of the rows: more is no row near a singular pose, but a wrong machine
    if (double(lost) > std::max(1.0, kMostLost * double(rows_.size()))) {
      return fail("CA115",
                  fmt::format("with the parameters that were found the machine does not assemble in {} of {} rows",
                              lost, rows_.size()),
                  example->place, "are they near singular poses? leave them out, or give priors");
    }
    out_.noise_factor = std::sqrt(sum / std::max(1.0, count - static_cast<double>(problem_.free.size())));
    constexpr double kHopeless = 100;
    if (out_.noise_factor > kHopeless) {
      return fail(
          "CA118",
          fmt::format("the residuals that are left are {:.0f} times the noise that was given", out_.noise_factor), {},
          "coordinates mixed up, or a frame or target that is not the given one (--estimate)? If the instrument "
          "is that coarse, give --noise-um");
    }
    const Eigen::MatrixXd all = stacked(x_, &weights);
    const auto unknowns = static_cast<Eigen::Index>(problem_.free.size());
    Eigen::MatrixXd J(all.rows(), unknowns);
    for (Eigen::Index k = 0; k < unknowns; ++k) J.col(k) = all.col(problem_.free[static_cast<std::size_t>(k)]);
    const Eigen::VectorXd lengths = J.colwise().norm().cwiseMax(1e-300);
    J = J * lengths.cwiseInverse().asDiagonal();
    const Eigen::MatrixXd R = J.householderQr().matrixQR().topRows(unknowns).template triangularView<Eigen::Upper>();
    const Eigen::MatrixXd inverse =
        R.template triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(unknowns, unknowns));
    error_ = Eigen::VectorXd::Zero(problem_.layout.count);
    for (Eigen::Index k = 0; k < unknowns; ++k) {
      error_[problem_.free[static_cast<std::size_t>(k)]] = out_.noise_factor * inverse.row(k).norm() / lengths[k];
    }
    out_.fitted = score_of(out_.residuals, false);
    out_.held_back = score_of(out_.residuals, true);
    return {};
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
    out_.orientation_told = out_.orientation_told || out_.rank == out_.parameters.size();
    for (const int j : wanted_)
      if (j < layout.parameters && known_.ties.contains(j)) out_.held_beside.push_back(unknown(j).key);
    out_.X_SM = pose_from(x_.data() + layout.frame);
    out_.X_TR = pose_from(x_.data() + layout.target);
    out_.frame_error = error_.template segment<6>(layout.frame);
    out_.target_error = error_.template segment<6>(layout.target);
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
  Problem<M> problem_;
  std::vector<int> wanted_;
  Identifiability known_;
  Eigen::VectorXd x_;                      ///< what was found so far
  std::vector<Eigen::VectorXd> whitened_;  ///< residuals there, over their noise
  double noise_scale_ = 1;
  bool converged_ = false;
  Eigen::VectorXd error_;  ///< standard errors of all unknowns
  Calibration out_;
};

}  // namespace

Result<Calibration> calibrate(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                              const CalibrationOptions& options) {
  if (!(options.noise_position > 0) || !(options.noise_angle > 0) || options.prior_length < 0 ||
      options.prior_angle < 0 || options.bound_length < 0 || options.bound_angle < 0 || options.hold_back < 0 ||
      options.hold_back > 0.5) {
    return fail("CA116", "an option of the calibration is out of range", {},
                "noise must be above 0, priors and bounds not below 0, the share held back 0 to 0.5");
  }
  if (rows.empty()) return fail("CA110", "no measurements");
  return std::visit([&](const auto& m) { return Fit(nominal, m, rows, options).run(); }, nominal);
}

CorrectedTarget corrected_target(const AnyMachine& nominal, const AnyMachine& real, const Pose& X_MT) {
  constexpr int kMost = 50;
  constexpr double kEnough = 1e-10;  // m, and rad: far below a controller's resolution
  CorrectedTarget out;
  out.command = X_MT;
  const machine::Task task = kinematics::task(nominal);
  const auto rows = kinematics::closure_detail::task_rows(task, X_MT, 1.0);
  double last = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kMost; ++k) {
    const kinematics::InverseResult inverse = kinematics::inverse(nominal, out.command);
    const kinematics::Solution* s = inverse.reachable();
    if (s == nullptr) {
      out.reason = inverse.solutions.empty() ? inverse.reason : "a limit of the nominal machine";
      return out;
    }
    out.joints = s->joints;
    const kinematics::ForwardResult at = kinematics::forward(real, s->joints);
    if (at.poses.empty()) {
      out.reason = "the real machine does not assemble there";
      return out;
    }
    const Vec6 error = kinematics::closure_detail::pose_error(task, X_MT, at.poses.front());
    out.rest = (rows * error).norm();
    out.reached = out.rest < kEnough;
    if (out.reached) return out;
    if (!(out.rest < 2 * last)) break;
    last = out.rest;
    out.command.p += error.head<3>();
    out.command.R = rotation_of(error.tail<3>()) * out.command.R;
  }
  out.reason = "the correction does not converge";
  return out;
}

}  // namespace polypod::calibration
