// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/identify.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "polypod/core/distributions.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/toml.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/plausibility.hpp"

namespace polypod::cutting {
namespace {

constexpr double kNotApart = 1e6;  // condition beyond which coefficients cannot be told apart
constexpr double kOutlier = 3.5;   // robust standard deviations
// What a measured cut can have; beyond is a wrong unit.
constexpr double kLargestFeed_mm = 100, kLargestDepth_mm = 1000, kLargestForce_N = 1e6;

constexpr double Material::*kCoefficient[6] = {&Material::ktc, &Material::krc, &Material::kac,
                                               &Material::kte, &Material::kre, &Material::kae};
constexpr const char* kName[6] = {"Ktc", "Krc", "Kac", "Kte", "Kre", "Kae"};

/// Equations of some of the coefficients, and whose noise is in each.
struct Equations {
  Eigen::MatrixXd A;      ///< columns of all six coefficients
  Eigen::VectorXd force;  ///< N
  std::vector<int> which;
  std::vector<int> axis;   ///< of the force of each row
  Eigen::VectorXd stated;  ///< N; empty where not each row states its sigma
};

/// How the noise may go: w, the part of the variance that grows with the force, and the ratio of variances of Fy and
/// Fx.
struct NoiseModel {
  double growing = 0, ratio = 1, log_prior = 0;
};
std::vector<NoiseModel> noise_models(bool two_axes) {
  constexpr std::array kGrowing{0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.96, 0.99, 0.997};
  constexpr std::array kRatio{1.0, 0.04, 0.11, 0.25, 0.5, 2.0, 4.0, 9.0, 25.0};
  constexpr double kConstant = 0.3, kEqual = 0.5;  // beforehand
  std::vector<NoiseModel> out;
  for (const double ratio : kRatio) {
    if (!two_axes && ratio != 1) continue;
    const double of_ratio = ratio == 1 ? kEqual : (1 - kEqual) / (kRatio.size() - 1);
    for (const double growing : kGrowing) {
      const double of_growing = growing == 0 ? kConstant : (1 - kConstant) / (kGrowing.size() - 1);
      out.push_back({growing, ratio, std::log(of_growing) + (two_axes ? std::log(of_ratio) : 0.0)});
    }
  }
  return out;
}

/// Coefficients (of columns of unit length) under one model of the noise.
struct WeightedFit {
  Eigen::VectorXd x;
  Eigen::MatrixXd covariance;
  Eigen::VectorXd variance;  ///< N^2, of each row
  double scale = 0;          ///< N^2, the variance that the model's parts share
  double log_likelihood = 0;
  double weight = 1;
  NoiseModel model;
};

/// Weighted least squares, and the restricted likelihood of the residuals: that of all combinations of the forces to
/// which no coefficient adds.
WeightedFit fit_under(const NoiseModel& model, const Eigen::MatrixXd& S, const Equations& e,
                      const Eigen::VectorXd& size) {
  WeightedFit out;
  out.model = model;
  out.variance.resize(e.force.size());
  for (Eigen::Index i = 0; i < e.force.size(); ++i) {
    const double base = e.stated.size() > 0 ? e.stated[i] * e.stated[i] : 1.0;
    out.variance[i] = base * (1 - model.growing + model.growing * size[i] * size[i]) *
                      (e.axis[static_cast<std::size_t>(i)] == 1 ? model.ratio : 1.0);
  }
  const Eigen::VectorXd root = out.variance.cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd W = root.asDiagonal() * S;
  const Eigen::VectorXd b = root.cwiseProduct(e.force);
  out.x = W.colPivHouseholderQr().solve(b);
  const double freedom = static_cast<double>(S.rows() - S.cols());
  // Forces without noise leave rounding.
  const double squares = std::max((b - W * out.x).squaredNorm(), 1e-24 * b.squaredNorm());
  const Eigen::LLT<Eigen::MatrixXd> H(W.transpose() * W);
  out.scale = squares / freedom;
  out.covariance = out.scale * H.solve(Eigen::MatrixXd::Identity(S.cols(), S.cols()));
  out.log_likelihood = model.log_prior - 0.5 * out.variance.array().log().sum() -
                       Eigen::MatrixXd(H.matrixL()).diagonal().array().log().sum() - 0.5 * freedom * std::log(squares);
  out.variance *= out.scale;
  return out;
}

/// Half of the interval about the mean of the mixture that holds 95 % of it: Student's t about `x` of each.
double half_of_mixture(const std::vector<WeightedFit>& fits, Eigen::Index k, double mean, double freedom) {
  const auto below = [&](double t) {
    const double tail = 0.5 * student_both(std::abs(t), freedom);
    return t > 0 ? 1 - tail : tail;
  };
  const auto within = [&](double half) {
    double sum = 0;
    for (const WeightedFit& f : fits) {
      const double off = f.x[k] - mean, deviation = std::sqrt(f.covariance(k, k));
      sum += f.weight * (below((half - off) / deviation) - below((-half - off) / deviation));
    }
    return sum;
  };
  double low = 0, high = 0;
  for (const WeightedFit& f : fits)
    high = std::max(high, student_95(freedom) * std::sqrt(f.covariance(k, k)) + std::abs(f.x[k] - mean));
  for (int i = 0; i < 30; ++i) {
    const double middle = 0.5 * (low + high);
    (within(middle) < 0.95 ? low : high) = middle;
  }
  return high;
}

/// The coefficients `e.which`, averaged over the models of the noise. Gives the variance of each row, N^2.
/// Errors: ID122.
Result<Eigen::VectorXd> solve(const Equations& e, CuttingIdentification& out) {
  const Eigen::Index n = static_cast<Eigen::Index>(e.which.size());
  Eigen::MatrixXd S = e.A(Eigen::all, e.which);
  const Eigen::VectorXd scale = S.colwise().norm();
  const bool loaded = scale.minCoeff() > 0;
  if (loaded) S = S * scale.cwiseInverse().asDiagonal();
  const Eigen::VectorXd sigma = S.bdcSvd().singularValues();
  const double condition = loaded && sigma[n - 1] > 0 ? sigma[0] / sigma[n - 1] : 2 * kNotApart;
  out.condition = std::max(out.condition, condition);
  if (!(condition < kNotApart)) {
    return fail("ID122", "the coefficients are not identifiable from these cuts", {}, "measure at two feeds at least");
  }
  const double freedom = static_cast<double>(S.rows() - n);
  // The size of a force is that of the model, so that its own noise does not weigh it.
  Eigen::VectorXd size = (S * S.colPivHouseholderQr().solve(e.force)).cwiseAbs();
  const double rms = std::sqrt(size.squaredNorm() / static_cast<double>(size.size()));
  if (rms > 0) size /= rms;
  std::vector<WeightedFit> fits;
  const bool two_axes = e.axis.front() != 2;
  for (const NoiseModel& model : out.noise_stated ? std::vector<NoiseModel>{{}} : noise_models(two_axes))
    fits.push_back(fit_under(model, S, e, size));
  double best = fits.front().log_likelihood, sum = 0;
  for (const WeightedFit& f : fits) best = std::max(best, f.log_likelihood);
  constexpr double kNeverMind = 1e-5;
  for (WeightedFit& f : fits) f.weight = std::exp(f.log_likelihood - best);
  std::erase_if(fits, [](const WeightedFit& f) { return !(f.weight > kNeverMind); });
  if (fits.empty()) {
    return fail("ID122", "the coefficients do not come out as finite numbers", {},
                "are the forces in N and the lengths in mm?");
  }
  for (const WeightedFit& f : fits) sum += f.weight;
  Eigen::VectorXd x = Eigen::VectorXd::Zero(n), variance = Eigen::VectorXd::Zero(e.force.size());
  for (WeightedFit& f : fits) {
    f.weight /= sum;
    x += f.weight * f.x;
    variance += f.weight * f.variance;
  }
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
  for (const WeightedFit& f : fits) covariance += f.weight * (f.covariance + (f.x - x) * (f.x - x).transpose());
  std::array<double, 3> constant{}, growing{};
  for (const WeightedFit& f : fits) {
    for (const int axis : two_axes ? std::vector{0, 1} : std::vector{2}) {
      const double own = f.weight * f.scale * (axis == 1 ? f.model.ratio : 1.0);
      constant[static_cast<std::size_t>(axis)] += own * (1 - f.model.growing);
      growing[static_cast<std::size_t>(axis)] += rms > 0 ? own * f.model.growing / (rms * rms) : 0.0;
    }
  }
  for (const int axis : two_axes ? std::vector{0, 1} : std::vector{2}) {
    const auto at = static_cast<std::size_t>(axis);
    if (!out.noise_stated) out.noise[at] = {std::sqrt(constant[at]), std::sqrt(growing[at])};
  }
  if (out.noise_stated) out.times_stated += freedom * fits.front().scale;
  for (Eigen::Index k = 0; k < n; ++k) {
    const auto i = static_cast<std::size_t>(e.which[static_cast<std::size_t>(k)]);
    out.value[i] = x[k] / scale[k];
    out.standard_error[i] = std::sqrt(covariance(k, k)) / scale[k];
    if (!std::isfinite(out.value[i]) || !std::isfinite(out.standard_error[i])) {
      return fail("ID122", fmt::format("{} does not come out as a finite number", kName[i]), {},
                  "are the forces in N and the lengths in mm?");
    }
    out.half_interval[i] = half_of_mixture(fits, k, x[k], freedom) / scale[k];
  }
  // The covariance as independent variations, each coefficient to its interval: the columns of its Cholesky factor.
  const Eigen::MatrixXd L = covariance.llt().matrixL();
  for (Eigen::Index j = 0; j < n; ++j) {
    std::array<double, 6> variation{};
    for (Eigen::Index k = j; k < n; ++k) {
      const auto i = static_cast<std::size_t>(e.which[static_cast<std::size_t>(k)]);
      if (std::abs(L(k, j)) < 1e-12 * L.row(k).norm() || !(out.standard_error[i] > 0)) continue;  // rounding
      variation[i] = out.half_interval[i] / out.standard_error[i] * L(k, j) / scale[k];
    }
    out.material.spread.push_back(variation);
  }
  return variance;
}

/// The forces across the axis of unit coefficients with chips to the power `exponent`: columns Ktc, Krc, Kte, Kre.
Eigen::MatrixXd shapes_across(const Cutter& cutter, const std::vector<MeasuredForce>& rows, double exponent) {
  Eigen::MatrixXd out(2 * static_cast<Eigen::Index>(rows.size()), 4);
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(rows.size()); ++i) {
    const MeasuredForce& row = rows[static_cast<std::size_t>(i)];
    const Engagement e = straight_engagement(cutter, row.side, row.ae, row.ap);
    for (const auto& [column, k] : {std::pair{0, 0}, {1, 1}, {2, 3}, {3, 4}}) {
      Material unit;
      unit.exponent = exponent;
      unit.*kCoefficient[k] = 1;
      out.block<2, 1>(2 * i, column) = mean_force(cutter, unit, e, row.feed_per_tooth).head<2>();
    }
  }
  return out;
}

/// Whether another exponent of the chip explains the forces across the axis better than chance does: Fisher's test of
/// one parameter more, each force by its variance.
std::optional<LackOfFit> lack_of_fit(const Cutter& cutter, const std::vector<MeasuredForce>& rows,
                                     const Eigen::VectorXd& measured, const Eigen::VectorXd& variance) {
  constexpr double kLeast = 0.35, kMost = 1.45, kStep = 0.1;
  constexpr double kSure = 3.29;  // of a normal variable: 99.9 %
  constexpr double kNormal95 = 1.96;
  const double freedom = static_cast<double>(measured.size()) - 5;
  if (freedom < 3) return {};
  // The mean weight is 1, so that the sizes stay those of forces.
  Eigen::VectorXd root = variance.cwiseSqrt().cwiseInverse();
  root /= std::sqrt(root.squaredNorm() / static_cast<double>(root.size()));
  const Eigen::VectorXd force = root.cwiseProduct(measured);
  const auto squares = [&](double exponent) {
    Eigen::MatrixXd S = root.asDiagonal() * shapes_across(cutter, rows, exponent);
    const Eigen::RowVectorXd norms = S.colwise().norm();
    if (!(norms.minCoeff() > 0)) return std::numeric_limits<double>::infinity();
    S = S * norms.cwiseInverse().asDiagonal();
    return (force - S * S.colPivHouseholderQr().solve(force)).squaredNorm();
  };
  const double linear = squares(1);
  double best = linear, exponent = 1;
  for (double m = kLeast; m < kMost + 0.5 * kStep; m += kStep) {
    if (const double s = squares(m); s < best) {
      best = s;
      exponent = m;
    }
  }
  const double rounding = 1e-12 * force.squaredNorm();
  const double t = std::sqrt((linear - best) / ((best + rounding) / freedom));
  if (!(t > kSure * student_95(freedom) / kNormal95)) return {};
  const double count = static_cast<double>(force.size());
  return LackOfFit{exponent, std::sqrt(best / count), std::sqrt(linear / count)};
}

/// One over the noise of each equation, 1/N.
struct Weights {
  Eigen::VectorXd across, along;
};

/// What the same forces give with a runout in the model, worst over the place of the high tooth; into the spread where
/// the runout is given. Forces are linear in the coefficients with a runout, too.
RunoutEffect runout_effect(const Cutter& cutter, const std::vector<MeasuredForce>& rows, std::optional<double> given,
                           const Weights& weights, Material& found) {
  constexpr double kSupposed = 10e-6;  // m
  constexpr int kPlaces = 8;           // of the high tooth, within a pitch
  RunoutEffect out;
  out.reading = given.value_or(kSupposed);
  out.given = given.has_value();
  const auto n = static_cast<Eigen::Index>(rows.size());
  const auto coefficients = [&](double reading, double phase) -> std::array<double, 6> {
    Eigen::MatrixXd across(2 * n, 4), along(n, 2);
    Eigen::VectorXd force_across(2 * n), force_along(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const MeasuredForce& row = rows[static_cast<std::size_t>(i)];
      const Engagement e = straight_engagement(cutter, row.side, row.ae, row.ap);
      const auto shape = unit_forces_with_runout(cutter, 1, e, row.feed_per_tooth, 0.5 * reading, phase);
      across.middleRows<2>(2 * i) = shape(Eigen::seqN(0, 2), {0, 1, 3, 4});
      along.row(i) = shape(2, {2, 5});
      force_across.segment<2>(2 * i) = row.mean.head<2>();
      force_along[i] = row.mean.z();
    }
    const auto solved = [](const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
      const Eigen::VectorXd scale = A.colwise().norm().transpose().cwiseMax(std::numeric_limits<double>::min());
      return Eigen::VectorXd(
          (A * scale.cwiseInverse().asDiagonal()).colPivHouseholderQr().solve(b).cwiseQuotient(scale));
    };
    const Eigen::VectorXd x = solved(weights.across.asDiagonal() * across, weights.across.cwiseProduct(force_across));
    const Eigen::VectorXd z = solved(weights.along.asDiagonal() * along, weights.along.cwiseProduct(force_along));
    return {x[0], x[1], z[0], x[2], x[3], z[1]};
  };
  const std::array<double, 6> value = coefficients(0, 0);
  std::array<double, 6> worst{};
  double most = -1;
  for (int place = 0; place < kPlaces; ++place) {
    const std::array<double, 6> with = coefficients(out.reading, cutter.pitch_angle() * place / kPlaces);
    std::array<double, 6> change{};
    double size = 0;
    for (std::size_t k = 0; k < 6; ++k) {
      change[k] = with[k] - value[k];
      out.change[k] = std::max(out.change[k], std::abs(change[k]));
      if (value[k] != 0) size += std::pow(change[k] / value[k], 2);
    }
    if (size > most) {
      most = size;
      worst = change;
    }
  }
  if (out.given && most > 0) found.spread.push_back(worst);
  return out;
}

/// What to look for where a coefficient comes out below 0.
std::string why_below_zero(const std::vector<MeasuredForce>& rows) {
  constexpr double kNearlyEqual = 1.2;
  const auto [least, largest] = std::minmax_element(
      rows.begin(), rows.end(), [](const auto& a, const auto& b) { return a.feed_per_tooth < b.feed_per_tooth; });
  if (largest->feed_per_tooth < kNearlyEqual * least->feed_per_tooth) {
    return fmt::format(
        "the feeds are nearly equal ({:g} to {:g} mm), so that edge and cutting coefficients are hardly identifiable; "
        "measure at feeds that differ by a factor of two or more",
        units::to_mm(least->feed_per_tooth), units::to_mm(largest->feed_per_tooth));
  }
  return "forces act on the tool, x along the feed, y to its left; is a sign or the direction wrong?";
}

/// Refuses what no metal has: a unit was mistaken.
Status of_a_metal(const Material& material) {
  constexpr double kFar = 10;  // times beyond what is published
  const double ktc = units::to_N_per_mm2(material.ktc);
  if (ktc >= kTangentialCut.low / kFar && ktc <= kTangentialCut.high * kFar) return {};
  const double slip = ktc < kTangentialCut.low ? 1e3 : 1e-3;
  const bool thousand = ktc * slip >= kTangentialCut.low && ktc * slip <= kTangentialCut.high;
  const std::string units_slipped = ktc < kTangentialCut.low ? "forces in kN instead of N, or feeds in um instead of mm"
                                                             : "forces in mN instead of N, or feeds in m instead of mm";
  return fail("ID124",
              fmt::format("Ktc comes out as {:.3g} N/mm^2: metals have {:g} to {:g}", ktc, kTangentialCut.low,
                          kTangentialCut.high),
              {}, thousand ? "a thousand times off: are the " + units_slipped + "?" : "check the units of all columns");
}

}  // namespace

Result<ForceTable> read_forces(const Cutter& cutter, const std::string& path, const csv::Columns& columns) {
  POLYPOD_ASSIGN(table, csv::read(path, columns));
  POLYPOD_TRY(table.needs({"feed_per_tooth_mm", "ap_mm", "Fx_N", "Fy_N", "Fz_N"}));
  ForceTable out;
  for (const csv::Table::Row& row : table.rows) {
    MeasuredForce m;
    m.place = table.place_of(row);
    POLYPOD_ASSIGN(feed, table.number(row, "feed_per_tooth_mm"));
    POLYPOD_ASSIGN(ap, table.number(row, "ap_mm"));
    POLYPOD_ASSIGN(ae, table.number(row, "ae_mm", units::to_mm(cutter.diameter)));
    POLYPOD_ASSIGN(x, table.number(row, "Fx_N"));
    POLYPOD_ASSIGN(y, table.number(row, "Fy_N"));
    POLYPOD_ASSIGN(z, table.number(row, "Fz_N"));
    POLYPOD_ASSIGN(sigma, table.number(row, "sigma_N", 0));
    if (sigma < 0 || sigma > kLargestForce_N)
      return fail("ID120", fmt::format("sigma_N = {:g}: 0 to {:g}", sigma, kLargestForce_N), m.place);
    const std::string direction = table.text(row, "direction");
    if (direction == "up") {
      m.side = CutSide::up;
    } else if (direction == "down") {
      m.side = CutSide::down;
    } else if (!direction.empty() && direction != "slot") {
      return fail("ID120", fmt::format("direction \"{}\" is not up, down or slot", direction), m.place);
    }
    if ((direction == "up" || direction == "down") && table.text(row, "ae_mm").empty()) {
      return fail("ID120", fmt::format("a cut {} without ae_mm", direction), m.place,
                  "give the width of the cut, or direction slot");
    }
    if (!(feed > 0) || !(ap > 0) || !(ae > 0) || ae > units::to_mm(cutter.diameter) * (1 + 1e-12) ||
        feed > kLargestFeed_mm || ap > kLargestDepth_mm) {
      return fail("ID120",
                  fmt::format("feed {:g}, ap {:g}, ae {:g} mm: each above 0, feed at most {:g}, ap at most {:g}, ae at "
                              "most the diameter",
                              feed, ap, ae, kLargestFeed_mm, kLargestDepth_mm),
                  m.place);
    }
    if (ap > units::to_mm(cutter.length) * (1 + 1e-12)) {
      return fail("ID120",
                  fmt::format("a cut of ap {:g} mm, but the flute length of the cutter is {:g} mm", ap,
                              units::to_mm(cutter.length)),
                  m.place, "check ap_mm and the cutter's length_mm");
    }
    for (const double force : {x, y, z}) {
      if (std::abs(force) <= kLargestForce_N) continue;
      return fail("ID120", fmt::format("a mean force of {:g} N: at most {:g}", force, kLargestForce_N), m.place);
    }
    m.feed_per_tooth = units::from_mm(feed);
    m.ap = units::from_mm(ap);
    m.ae = units::from_mm(ae);
    m.mean = Vec3(x, y, z);
    m.sigma = sigma;
    out.cuts.push_back(std::move(m));
  }
  POLYPOD_TRY(csv::no_row_twice(table));
  POLYPOD_ASSIGN(unused, table.unused());
  out.unused_columns = std::move(unused);
  return out;
}

Result<CuttingIdentification> identify_cutting(const Cutter& cutter, const std::vector<MeasuredForce>& rows,
                                               std::optional<double> runout) {
  CuttingIdentification out;
  out.equations = 3 * rows.size();
  constexpr std::size_t kLeast = 3;  // cuts: the two axial coefficients have one equation a cut
  if (rows.size() < kLeast) {
    return fail("ID121", fmt::format("{} cuts for six coefficients", rows.size()), {},
                "measure three cuts at least, at two feeds or more");
  }
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  Equations across{Eigen::MatrixXd(2 * n, 6), Eigen::VectorXd(2 * n), {0, 1, 3, 4}, {}, {}};
  Equations along{Eigen::MatrixXd(n, 6), Eigen::VectorXd(n), {2, 5}, {}, {}};
  out.noise_stated = std::all_of(rows.begin(), rows.end(), [](const MeasuredForce& row) { return row.sigma > 0; });
  if (out.noise_stated) {
    across.stated.resize(2 * n);
    along.stated.resize(n);
  }
  std::vector<Eigen::Matrix<double, 3, 6>> shapes;
  for (Eigen::Index i = 0; i < n; ++i) {
    const MeasuredForce& row = rows[static_cast<std::size_t>(i)];
    const Engagement e = straight_engagement(cutter, row.side, row.ae, row.ap);
    Eigen::Matrix<double, 3, 6> shape;
    for (int k = 0; k < 6; ++k) {
      Material unit;
      unit.*kCoefficient[k] = 1;
      shape.col(k) = mean_force(cutter, unit, e, row.feed_per_tooth);
    }
    across.A.middleRows<2>(2 * i) = shape.topRows<2>();
    along.A.row(i) = shape.row(2);
    across.force.segment<2>(2 * i) = row.mean.head<2>();
    along.force[i] = row.mean.z();
    across.axis.insert(across.axis.end(), {0, 1});
    along.axis.push_back(2);
    if (out.noise_stated) {
      across.stated.segment<2>(2 * i).setConstant(row.sigma);
      along.stated[i] = row.sigma;
    }
    shapes.push_back(shape);
  }
  POLYPOD_ASSIGN(variance_across, solve(across, out));
  POLYPOD_ASSIGN(variance_along, solve(along, out));
  if (out.noise_stated) out.times_stated = std::sqrt(out.times_stated / static_cast<double>(3 * n - 6));
  Eigen::Matrix<double, 6, 1> K;
  for (int k = 0; k < 6; ++k) {
    K[k] = out.value[static_cast<std::size_t>(k)];
    out.material.*kCoefficient[k] = K[k];
    if (k % 3 != 2 && K[k] < 0) {
      return fail("ID123", fmt::format("{} comes out below 0", kName[k]), {}, why_below_zero(rows));
    }
  }
  POLYPOD_TRY(of_a_metal(out.material));
  out.lack_of_fit = lack_of_fit(cutter, rows, across.force, variance_across);
  const Weights weights{variance_across.cwiseSqrt().cwiseInverse(), variance_along.cwiseSqrt().cwiseInverse()};
  out.runout = runout_effect(cutter, rows, runout, weights, out.material);
  for (std::size_t k = 0; k < 6 && out.runout.given; ++k)
    out.half_interval[k] = std::hypot(out.half_interval[k], out.runout.change[k]);
  double sum = 0;
  Eigen::Matrix3Xd residuals(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto at = static_cast<std::size_t>(i);
    out.residuals.push_back(rows[at].mean - shapes[at] * K);
    residuals.col(i) = out.residuals.back();
    sum += out.residuals.back().squaredNorm();
  }
  out.residual_rms = std::sqrt(sum / double(out.equations));
  constexpr Eigen::Index kEnough = 10;  // cuts: of fewer the median says nothing
  for (int axis = 0; axis < 3 && n >= kEnough; ++axis) {
    Eigen::VectorXd over(n);  // the noise of each
    for (Eigen::Index i = 0; i < n; ++i)
      over[i] = residuals(axis, i) * (axis == 2 ? weights.along[i] : weights.across[2 * i + axis]);
    const double limit = kOutlier * robust_deviation(over);
    for (Eigen::Index i = 0; i < n; ++i) {
      if (std::abs(over[i]) > limit && std::abs(residuals(axis, i)) > 1e-9) {
        out.outliers.push_back({static_cast<std::size_t>(i), axis, residuals(axis, i)});
      }
    }
  }
  return out;
}

std::string to_toml(const Material& m) {
  std::string out;
  if (!m.name.empty()) out += fmt::format("name = {}\n", quoted_toml(m.name));
  for (int k = 0; k < 6; ++k) {
    const double value = m.*kCoefficient[k];
    out += k < 3 ? fmt::format("{}_N_per_mm2 = {:.10g}\n", kName[k], units::to_N_per_mm2(value))
                 : fmt::format("{}_N_per_mm = {:.10g}\n", kName[k], units::to_N_per_mm(value));
  }
  out += fmt::format("exponent = {:g}\n", m.exponent);
  if (m.spread.empty()) return out;
  out += "# Variations of the six together, each to its 95 % interval; their effects add as squares.\nspread_95 = [\n";
  for (const std::array<double, 6>& row : m.spread) {
    out += "  [";
    for (std::size_t k = 0; k < 6; ++k) {
      out +=
          fmt::format("{}{:.6g}", k > 0 ? ", " : "", k < 3 ? units::to_N_per_mm2(row[k]) : units::to_N_per_mm(row[k]));
    }
    out += "],\n";
  }
  return out + "]\n";
}

}  // namespace polypod::cutting
