// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "fit.hpp"
#include "losses.hpp"
#include "polypod/core/distributions.hpp"
#include "polypod/core/units.hpp"
#include "systematic_columns.hpp"

namespace polypod::calibration {
namespace {

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

}  // namespace

Status Fit::judge() {
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

void Fit::set_covariance(const std::vector<double>& weight, double sum, double count) {
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
  const Eigen::MatrixXd own = prior.asDiagonal() * root_of_covariance(R, prior, s);
  Eigen::MatrixXd root = Eigen::MatrixXd::Zero(all, all + n);
  if (all > n) {
    const Eigen::VectorXd unfitted = problem_.prior(problem_.unfitted);
    root.block(0, n, n, all - n) =
        own * (own.transpose() * (R.transpose() * (R_all.topRightCorner(n, all - n) * unfitted.asDiagonal()))) /
        (s * s);
    root.block(n, n, all - n, all - n) = -unfitted.asDiagonal().toDenseMatrix();
  }
  // Its covariance in parts: K R^T R K^T / s^2 is of the readings' scatter, and what is left of the machine's own
  // errors is C P^-2 times these. Of their size only so much is known, so that they are as wide as wide_ on the whole;
  // with P in its place both parts are C together.
  const Eigen::MatrixXd scatter = own * (own.transpose() * R.transpose()) / s;
  const std::array<double, 2> spread = spread_of_sizes(R);
  wide_ = problem_.prior;
  for (std::size_t k = 0; k < learns_.size(); ++k)
    if (learns_[k] != Learns::nothing) wide_[problem_.wanted[k]] *= spread[learns_[k] == Learns::lengths ? 0 : 1];
  root.topLeftCorner(n, n) = own * (own.transpose() * of_wanted(wide_).cwiseQuotient(prior.cwiseAbs2()).asDiagonal());
  root.block(0, all, n, n) = scatter;
  set_systematic(weight, own, s);
  const Eigen::Index parts = std::ssize(out_.systematic);
  Eigen::MatrixXd of_all = Eigen::MatrixXd::Zero(problem_.layout.count, all + n + parts);
  for (Eigen::Index k = 0; k < all; ++k) {
    auto row = of_all.row(both[static_cast<std::size_t>(k)]);
    row.head(all + n) = root.row(k);
    if (k < n && parts > 0) row.tail(parts) = shift_.row(k);
  }
  error_ = of_all.rowwise().norm();
  error_of_readings_ = of_all.leftCols(all + n).rowwise().norm();
  const auto parameters = static_cast<Eigen::Index>(problem_.nominal.size());
  const auto square = [&](const auto& columns) -> Eigen::MatrixXd {
    return columns.bottomRows(parameters) * columns.bottomRows(parameters).transpose();
  };
  out_.covariance_systematic = square(of_all.rightCols(parts));
  out_.covariance_readings = square(of_all.middleCols(all, n));
  const Eigen::MatrixXd without = square(of_all.leftCols(all + n));
  out_.covariance_drawing = without - out_.covariance_readings;
  out_.covariance = without + out_.covariance_systematic;
  set_covariance_before(both);
}

void Fit::set_systematic(const std::vector<double>& weight, const Eigen::MatrixXd& own, double s) {
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

double Fit::gain_in_deviations(const std::vector<double>& weight) const {
  const double s = noise_that_counts();
  const Eigen::MatrixXd C = root_of_covariance(triangle(weight, problem_.wanted), of_wanted(problem_.prior), s);
  const Eigen::ArrayXd left = kinematics::singular_values(C).array().square();
  const Eigen::ArrayXd taken = 1 - left.square();  // 2 h - h^2
  return (gain_ / (s * s) - taken.sum()) / std::sqrt(std::max(2 * taken.square().sum(), 1e-300));
}

double Fit::change_over_priors() const {
  double squares = 0, count = 0;
  for (const int j : problem_.wanted) {
    if (j < problem_.layout.parameters) continue;
    squares += std::pow((x_[j] - problem_.start[j]) / usual_[j], 2);
    ++count;
  }
  return count > 0 ? std::sqrt(squares / count) : 0;
}

double Fit::noise_that_counts() const {
  const double s = std::max(out_.noise_factor, kLeastNoise);
  return out_.free_equations < kLeastFree ? std::max(1.0, s) : s;
}

void Fit::set_covariance_before(const std::vector<int>& uncertain) {
  std::vector<int> columns;
  for (const int j : uncertain)
    if (j >= problem_.layout.parameters) columns.push_back(j);
  Eigen::VectorXd r;
  Eigen::MatrixXd J;
  problem_.rules(problem_.start, r, J);
  const Eigen::VectorXd prior = wide_(columns);
  const Eigen::MatrixXd root = prior.asDiagonal() * root_of_covariance(triangle_of(J(Eigen::all, columns)), prior, 1);
  Eigen::MatrixXd of_all = Eigen::MatrixXd::Zero(problem_.layout.count, root.cols());
  for (std::size_t k = 0; k < columns.size(); ++k) of_all.row(columns[k]) = root.row(Eigen::Index(k));
  const auto parameters = static_cast<Eigen::Index>(problem_.nominal.size());
  out_.covariance_before = of_all.bottomRows(parameters) * of_all.bottomRows(parameters).transpose();
  out_.prior = Eigen::VectorXd::Zero(parameters);
  for (const int j : columns) out_.prior[j - problem_.layout.parameters] = problem_.prior[j];
}

void Fit::say_unknowns() {
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
      // Factors that are the same up to rounding stay in the order of the parameters.
      const auto size = [](const auto& parameter) { return std::round(std::log(std::abs(parameter.factor)) * 1e6); };
      std::stable_sort(one.like.begin(), one.like.end(),
                       [&](const auto& a, const auto& b) { return size(a) > size(b); });
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

double Fit::student_of(int column) const {
  if (!(error_[column] > error_of_readings_[column])) return out_.student;
  const double ratio = error_[column] / std::max(error_of_readings_[column], 1e-3 * error_[column]);
  return student_quantile(0.05, std::max(1.0, out_.free_equations) * std::pow(ratio, 4));
}

std::size_t Fit::rules_among(const std::vector<int>& columns) const {
  Eigen::VectorXd r;
  Eigen::MatrixXd J;
  problem_.rules(problem_.start, r, J);
  std::size_t out = 0;
  for (Eigen::Index i = 0; i < J.rows(); ++i) out += J(i, columns).isZero(0) ? 0 : 1;
  return out;
}

Status Fit::make_machine() {
  const Eigen::VectorXd p = x_.tail(static_cast<Eigen::Index>(problem_.nominal.size()));
  POLYPOD_ASSIGN(calibrated, machine::with_parameters(any_, std::vector<double>(p.begin(), p.end())));
  std::set<std::string> kinds;
  for (const Measurement& row : rows_) kinds.insert(name_of(row.kind));
  std::string what;
  for (const std::string& kind : kinds) what += (what.empty() ? "" : " and ") + kind;
  machine::note(calibrated, "calibration",
                fmt::format("{} of {} parameters from {} measured {}; rms {:.1f} um before, {:.1f} um after", out_.rank,
                            out_.parameters.size(), rows_.size(), what, units::to_um(out_.fitted.rms_before),
                            units::to_um(out_.fitted.rms_after)));
  out_.machine = std::move(calibrated);
  return {};
}

}  // namespace polypod::calibration
