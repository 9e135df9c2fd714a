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
  std::vector<Pose> seed;  ///< the nominal pose of every row
  std::vector<bool> held_back;
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
double robust_scale(const std::vector<Eigen::VectorXd>& residuals, const std::vector<bool>& held_back,
                    std::size_t unknowns) {
  std::vector<double> all;
  for (std::size_t i = 0; i < residuals.size(); ++i)
    if (!held_back[i]) all.insert(all.end(), residuals[i].begin(), residuals[i].end());
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
    if (ratio < 30 && ratio > 1 / 30.0) return {};
    return fail("CA113", fmt::format("measured lengths are {:.3g} times those of the machine", ratio), example->place,
                "lengths are in mm; are these um, or m?");
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

template <kinematics::Machine M>
Result<Calibration> run(const AnyMachine& any, const M& m, const std::vector<Measurement>& rows,
                        const CalibrationOptions& options) {
  Problem<M> problem{m,  rows, options, parameters(m), {}, {options.noise_position, options.noise_angle}, {}, {}, {},
                     {}, {},   {}};
  const std::vector<machine::Parameter>& nominal = problem.nominal;
  const Layout& layout = problem.layout = layout_of(rows, nominal.size());

  POLYPOD_ASSIGN(wished, chosen_parameters(nominal, options));
  problem.chosen = wished;
  const auto chosen = std::count(problem.chosen.begin(), problem.chosen.end(), true);

  // Where the nominal machine stands in every row: the seeds of Newton.
  for (const Measurement& row : rows) {
    const Pose guess = forward(m, row.q);
    const std::vector<double> p = kinematics::nominal_parameters(m);
    const auto at =
        kinematics::forward_by_closure(m, std::span<const double>(row.q.data(), static_cast<std::size_t>(row.q.size())),
                                       std::span<const double>(p), guess);
    if (!at.converged) {
      return fail("CA111", "the machine cannot take these joints", row.place, "check the joints and the machine");
    }
    problem.seed.push_back(at.X_MT);
  }
  Pose X_SM = options.X_SM;
  if (options.estimate_frame) X_SM = fitted_frame(rows, problem.seed, options.X_TR).value_or(X_SM);
  POLYPOD_TRY(check_extent(rows, problem.seed, X_SM, options.X_TR));

  // Start and scale of every unknown.
  const Start from = start_of(any, layout, X_SM, options.X_TR);
  problem.start = from.x;
  problem.scale = from.scale;
  for (const auto& [name, first] : layout.contact) {
    Vec3 sum = Vec3::Zero();
    int touched = 0;
    const Measurement* example = nullptr;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (rows[i].kind != Kind::contact || rows[i].contact != name) continue;
      sum += (X_SM * problem.seed[i] * options.X_TR).p;
      ++touched;
      example = &rows[i];
    }
    if (touched < 2) {
      return fail("CA117", fmt::format("the place \"{}\" is touched once only", name), example->place,
                  "touch it at least twice, with other joints");
    }
    problem.start.template segment<3>(first) = sum / touched;
  }

  // Which unknowns to look for, and rows to hold back where enough are left.
  bool turns = false;
  for (const Measurement& row : rows) turns = turns || row.kind == Kind::pose || row.kind == Kind::axis;
  const std::vector<int> wanted = wanted_unknowns(layout, problem.chosen, options, turns);
  std::size_t all_equations = 0;
  for (const Measurement& row : rows) all_equations += static_cast<std::size_t>(equation_count(row.kind));
  const bool priors = options.prior_length > 0 && options.prior_angle > 0;
  if (!priors && all_equations <= wanted.size()) {
    return fail("CA110", fmt::format("{} equations for {} unknowns", all_equations, wanted.size()), {},
                "measure more poses, choose parameters, or give priors");
  }
  problem.held_back.assign(rows.size(), false);
  if (options.hold_back > 0) {
    const auto every = static_cast<std::size_t>(std::lround(1 / options.hold_back));
    std::size_t left = all_equations;
    for (std::size_t i = every - 1; i < rows.size(); i += every) {
      problem.held_back[i] = rows[i].kind != Kind::contact;
      if (problem.held_back[i]) left -= static_cast<std::size_t>(equation_count(rows[i].kind));
    }
    if (2 * left < 3 * wanted.size()) problem.held_back.assign(rows.size(), false);
  }

  Calibration out;
  out.X_SM = X_SM;
  out.X_TR = options.X_TR;
  // All equations of the fitted rows at x, one under another, rows weighted by `weights` if given.
  const auto stacked = [&](const Eigen::VectorXd& x, const std::vector<double>* weights) {
    Eigen::MatrixXd J(0, layout.count);
    std::vector<Eigen::MatrixXd> parts;
    Eigen::Index n = 0;
    Equations e;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (problem.held_back[i]) continue;
      problem.equations(i, x, true, e);
      parts.push_back(weights == nullptr ? e.J : Eigen::MatrixXd(std::sqrt((*weights)[i]) * e.J));
      n += e.r.size();
    }
    problem.extra(x, e.r, e.J);
    parts.push_back(e.J);
    J.resize(n + e.J.rows(), layout.count);
    n = 0;
    for (const Eigen::MatrixXd& part : parts) {
      J.middleRows(n, part.rows()) = part;
      n += part.rows();
    }
    return J;
  };
  const Identifiability known = identifiable(stacked(problem.start, nullptr), wanted, problem.scale);
  problem.free = known.kept;
  out.condition = known.condition;
  if (problem.free.empty()) return fail("CA112", "the measurements tell nothing of the chosen parameters");

  std::vector<Eigen::VectorXd> whitened(rows.size());
  const auto whiten = [&](const Eigen::VectorXd& x) {
    Equations e;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      problem.equations(i, x, false, e);
      whitened[i] = e.r;
    }
  };
  whiten(problem.start);
  out.residuals.resize(rows.size());
  Equations e;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    problem.equations(i, problem.start, false, e);
    out.residuals[i].row = i;
    out.residuals[i].before = e.r.cwiseProduct(e.sigma);
    out.residuals[i].lengths = e.lengths;
    out.residuals[i].held_back = problem.held_back[i];
    if (!problem.held_back[i]) out.equations += static_cast<std::size_t>(e.r.size());
  }

  std::vector<double> block;
  for (const int j : problem.free) block.push_back(problem.start[j]);
  Eigen::VectorXd x = problem.start;
  // The loss bends at what the residuals themselves show of the noise: first those of the nominal machine, where nearly
  // everything is within the bend, then those that were found.
  double noise_scale = std::max(1.0, robust_scale(whitened, problem.held_back, problem.free.size()));
  constexpr int kRounds = 10;
  for (int round = 0; round < kRounds; ++round) {
    ceres::Problem search;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (problem.held_back[i]) continue;
      const int n = equation_count(rows[i].kind);
      search.AddResidualBlock(new RowCost<M>(problem, i, n), loss_of(options.loss, noise_scale * bend_of(n)),
                              block.data());
    }
    problem.extra(x, e.r, e.J);
    if (e.r.size() > 0)
      search.AddResidualBlock(new RowCost<M>(problem, rows.size(), static_cast<int>(e.r.size())), nullptr,
                              block.data());
    for (std::size_t k = 0; k < problem.free.size(); ++k) {
      if (problem.free[k] < layout.parameters) continue;
      const auto i = static_cast<std::size_t>(problem.free[k] - layout.parameters);
      const double bound = problem.is_length(i) ? options.bound_length : options.bound_angle;
      if (!(bound > 0)) continue;
      search.SetParameterLowerBound(block.data(), static_cast<int>(k), nominal[i].value - bound);
      search.SetParameterUpperBound(block.data(), static_cast<int>(k), nominal[i].value + bound);
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
    out.iterations += static_cast<int>(summary.iterations.size());
    if (!summary.IsSolutionUsable()) return fail("CA115", "the search failed: " + summary.message);
    for (std::size_t k = 0; k < problem.free.size(); ++k) x[problem.free[k]] = block[k];
    if (summary.termination_type == ceres::NO_CONVERGENCE) {
      return fail("CA115", fmt::format("no convergence in {} steps", summary.iterations.size()), {},
                  "give priors or bounds, choose fewer parameters, or check the first guess of frame and target");
    }
    whiten(x);
    const double found = std::max(1e-12, robust_scale(whitened, problem.held_back, problem.free.size()));
    const bool settled = std::abs(found / noise_scale - 1) < 0.05;
    noise_scale = found;
    if (options.loss == Loss::none || settled) break;
  }

  // Weights, outliers, and the standard errors that the residuals show: s^2 (J^T W J)^-1 with
  // s^2 = sum w^2 |r|^2 / (sum w n - unknowns) (Huber 1973 in its simplest form).
  std::vector<double> weights(rows.size(), 1);
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const int n = static_cast<int>(whitened[i].size());
    const double square = whitened[i].squaredNorm();
    weights[i] = weight_of(options.loss, noise_scale * bend_of(n), square);
    if (!problem.equations(i, x, false, e, Lost::fail)) {
      return fail("CA115", "with the parameters that were found the machine does not assemble here", rows[i].place,
                  "is the row near a singular pose? leave it out, or give priors");
    }
    RowResidual& r = out.residuals[i];
    r.after = e.r.cwiseProduct(e.sigma);
    r.weight = weights[i];
    r.outlier = std::sqrt(square) > noise_scale * outlier_of(n) && r.after.cwiseAbs().maxCoeff() > 1e-9;
    if (problem.held_back[i]) continue;
    sum += weights[i] * weights[i] * square;
    count += weights[i] * n;
  }
  const double unknowns = static_cast<double>(problem.free.size());
  out.noise_factor = std::sqrt(sum / std::max(1.0, count - unknowns));
  const Eigen::MatrixXd all = stacked(x, &weights);
  Eigen::MatrixXd J(all.rows(), static_cast<Eigen::Index>(problem.free.size()));
  for (std::size_t k = 0; k < problem.free.size(); ++k) J.col(static_cast<Eigen::Index>(k)) = all.col(problem.free[k]);
  const Eigen::VectorXd lengths = J.colwise().norm().cwiseMax(1e-300);
  J = J * lengths.cwiseInverse().asDiagonal();
  const Eigen::MatrixXd R = J.householderQr().matrixQR().topRows(J.cols()).triangularView<Eigen::Upper>();
  const Eigen::MatrixXd inverse = R.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(J.cols(), J.cols()));
  Eigen::VectorXd error = Eigen::VectorXd::Zero(layout.count);
  for (std::size_t k = 0; k < problem.free.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    error[problem.free[k]] = out.noise_factor * inverse.row(row).norm() / lengths[row];
  }

  const auto unknown = [&](int j) { return unknown_of(any, layout, j); };
  std::vector<double> p;
  for (std::size_t i = 0; i < nominal.size(); ++i) {
    p.push_back(x[problem.column(i)]);
    if (!problem.chosen[i]) continue;
    Estimate one{nominal[i].key, nominal[i].unit, nominal[i].value, p.back(), error[problem.column(i)], true, {}};
    const auto tie = known.ties.find(problem.column(i));
    if (tie != known.ties.end()) {
      one.identifiable = false;
      for (int j = 0; j < layout.count; ++j) {
        // A factor by which a change of 1 % here shows as less than 0.01 % there is none.
        const double share = tie->second[j] * problem.scale[problem.column(i)] / problem.scale[j];
        if (std::abs(share) > 0.01) one.like.push_back({unknown(j).key, unknown(j).unit, tie->second[j]});
      }
      std::stable_sort(one.like.begin(), one.like.end(),
                       [](const auto& a, const auto& b) { return std::abs(a.factor) > std::abs(b.factor); });
    } else {
      ++out.rank;
    }
    out.parameters.push_back(std::move(one));
  }
  for (const int j : wanted)
    if (j < layout.parameters && known.ties.contains(j)) out.held_beside.push_back(unknown(j).key);
  out.X_SM = pose_from(x.data() + layout.frame);
  out.X_TR = pose_from(x.data() + layout.target);
  out.frame_error = error.segment<6>(layout.frame);
  out.target_error = error.segment<6>(layout.target);
  out.fitted = score_of(out.residuals, false);
  out.held_back = score_of(out.residuals, true);

  POLYPOD_ASSIGN(calibrated, machine::with_parameters(any, p));
  std::set<std::string> kinds;
  for (const Measurement& row : rows) kinds.insert(name_of(row.kind));
  std::string what;
  for (const std::string& kind : kinds) what += (what.empty() ? "" : " and ") + kind;
  machine::note(
      calibrated, "calibration",
      fmt::format("{} of {} parameters from {} measured {}; rms {:.1f} um before, {:.1f} um after", out.rank, chosen,
                  rows.size(), what, units::to_um(out.fitted.rms_before), units::to_um(out.fitted.rms_after)));
  out.machine = std::move(calibrated);
  return out;
}

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
  return std::visit([&](const auto& m) { return run(nominal, m, rows, options); }, nominal);
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
