// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "common.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "polypod/core/statistics.hpp"

namespace polypod::calibration {
namespace {

constexpr double kHalf = 0.5;
// Evidence a freedom, above which a common error is likely. Without one it is near 1, as of chi-square over its degrees
// of freedom; where errors of one kind differ in size among themselves, some times that.
constexpr double kLikely = 12;
constexpr double kFar = 10;  // priors

bool places_measured(const std::vector<Measurement>& rows) {
  return std::any_of(rows.begin(), rows.end(), [](const Measurement& row) { return row.kind != Kind::contact; });
}

std::vector<int> columns_of(const Layout& layout, const std::string& what, bool turns) {
  std::vector<int> out;
  if (what == "scale") return {layout.scale};
  const bool frame = what == "frame";
  for (int j = 0; j < (frame || turns ? 6 : 3); ++j) out.push_back((frame ? layout.frame : layout.target) + j);
  return out;
}

bool angles_measured(const std::vector<Measurement>& rows) {
  return std::any_of(rows.begin(), rows.end(),
                     [](const Measurement& row) { return row.kind == Kind::axis || row.kind == Kind::pose; });
}

double prior_of(const Estimate& p, const CalibrationOptions& options) {
  const bool length = p.unit == "mm";
  const double stated = length ? options.prior_length : options.prior_angle;
  return stated > 0 ? stated : length ? kUsualLengthError : kUsualAngleError;
}

/// Root mean square of the changes over the priors.
double change_of(const Calibration& c, const CalibrationOptions& options) {
  double squares = 0;
  for (const Estimate& p : c.parameters) squares += std::pow((p.value - p.nominal) / prior_of(p, options), 2);
  return c.parameters.empty() ? 0 : std::sqrt(squares / static_cast<double>(c.parameters.size()));
}

}  // namespace

std::vector<std::string> untried(const AnyMachine& machine, const std::vector<Measurement>& rows,
                                 const CalibrationOptions& options) {
  std::vector<std::string> out;
  if (!places_measured(rows)) return out;
  if (!options.estimate_frame) out.emplace_back("frame");
  // On a tool that does not turn a shift of the target is one of the frame.
  if (!options.estimate_target && kinematics::task(machine).turns()) out.emplace_back("target");
  if (!options.estimate_scale) out.emplace_back("scale");
  return out;
}

CommonChange explained_alone(const AnyMachine& machine, const std::vector<Measurement>& rows,
                             const std::vector<Pose>& seed, const CalibrationOptions& options, const Calibration& found,
                             const std::string& what) {
  constexpr int kSteps = 6;
  CommonChange out;
  out.what = what;
  const Layout layout = layout_of(rows, kinematics::parameters(machine).size());
  Eigen::VectorXd x = start_of(machine, layout, options.X_SM, options.X_TR).x;
  const std::vector<int> columns = columns_of(layout, what, angles_measured(rows));
  const auto n = static_cast<Eigen::Index>(columns.size());
  const Noise noise{options.noise_position, options.noise_angle};
  std::vector<Followed> followed(rows.size());
  double before = 0, after = 0;
  for (int step = 0; step <= kSteps; ++step) {
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
    double squares = 0;
    Equations e;
    e.by_parameters = false;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const RowResidual& r = found.residuals[i];
      if (rows[i].kind == Kind::contact || r.outlier || r.lost) continue;
      e.followed = &followed[i];
      equations_of(machine, rows[i], seed[i], layout, x, noise, true, e, Lost::first_order);
      const Eigen::MatrixXd J = e.J(Eigen::all, columns);
      A.noalias() += J.transpose() * J;
      b.noalias() += J.transpose() * e.r;
      squares += e.r.squaredNorm();
    }
    if (step == 0) before = squares;
    after = squares;
    if (step == kSteps) break;
    x(columns) -= A.completeOrthogonalDecomposition().solve(b);
  }
  out.alone = before > 0 && std::isfinite(after) ? std::max(0.0, 1 - after / before) : 0;
  return out;
}

bool worth_a_fit(const CommonChange& trial, const Calibration& found, const CalibrationOptions& options) {
  constexpr double kLittle = 0.05;
  constexpr double kCoarse = 1.5;  // times the noise
  return trial.alone > kHalf ||
         (trial.alone > kLittle && (found.noise_factor > kCoarse || !far_moved(found, options).empty()));
}

CalibrationOptions with_common(CalibrationOptions options, const std::string& what) {
  if (what == "frame") options.estimate_frame = true;
  if (what == "target") options.estimate_target = true;
  if (what == "scale") options.estimate_scale = true;
  return options;
}

void compare(const AnyMachine& machine, const std::vector<Measurement>& rows, const std::vector<Pose>& seed,
             const CalibrationOptions& options, const Calibration& without, const Calibration& with,
             CommonChange& trial) {
  trial.fitted = true;
  trial.change_before = change_of(without, options);
  trial.change = change_of(with, options);
  // The shift stands in the middle of the measured places: elsewhere a turn would hide in it.
  Vec3 middle = Vec3::Zero();
  for (const Pose& X : seed) middle += (options.X_SM * X * options.X_TR).p / static_cast<double>(seed.size());
  if (trial.what == "frame") {
    const Pose moved = with.X_SM * options.X_SM.inverse();
    trial.shift = moved * middle - middle;
    trial.turn = rotation_vector(moved.R);
  } else if (trial.what == "target") {
    trial.shift = with.X_TR.p - options.X_TR.p;
    trial.turn = angles_measured(rows) ? rotation_vector(with.X_TR.R * options.X_TR.R.transpose()) : Vec3::Zero();
  } else {
    trial.scale = with.scale;
  }
  std::map<std::string, double> prior;
  const std::vector<machine::Parameter> all = kinematics::parameters(machine);
  for (std::size_t i = 0; i < all.size(); ++i) prior[all[i].key] = with.prior[static_cast<Eigen::Index>(i)];
  const auto cost = [&](const Calibration& c) {
    double sum = 0;
    for (const Estimate& p : c.parameters) sum += std::pow((p.value - p.nominal) / prior[p.key], 2);
    return sum;
  };
  const double s = std::max(with.noise_factor, 1.0);
  const double residuals = (without.chi_square - with.chi_square) / (s * s);
  const double freedoms = trial.what == "scale" ? 1 : trial.what == "frame" || angles_measured(rows) ? 6 : 3;
  trial.evidence = (residuals + cost(without) - cost(with)) / freedoms;
  const bool smaller = trial.change < kHalf * trial.change_before;
  const bool closer = with.noise_factor < kHalf * without.noise_factor;
  trial.likely = trial.evidence > kLikely && (smaller || closer);
}

std::vector<Moved> far_moved(const Calibration& c, const CalibrationOptions& options) {
  std::vector<Moved> out;
  for (const Estimate& p : c.parameters) {
    const double priors = std::abs(p.value - p.nominal) / prior_of(p, options);
    if (priors >= kFar) out.push_back({p.key, priors});
  }
  std::stable_sort(out.begin(), out.end(), [](const Moved& a, const Moved& b) { return a.priors > b.priors; });
  return out;
}

std::vector<Moved> moved_farthest(const Calibration& c, const CalibrationOptions& options) {
  constexpr double kCoarsest = 2;
  Eigen::VectorXd priors(static_cast<Eigen::Index>(c.parameters.size()));
  for (std::size_t i = 0; i < c.parameters.size(); ++i) {
    const Estimate& p = c.parameters[i];
    priors[static_cast<Eigen::Index>(i)] = (p.value - p.nominal) / prior_of(p, options);
  }
  const double usual = std::clamp(robust_deviation(priors), 1.0, kCoarsest);
  std::vector<Moved> out = far_moved(c, options);
  std::erase_if(out, [&](const Moved& m) { return m.priors < kFar * usual; });
  return out;
}

}  // namespace polypod::calibration
