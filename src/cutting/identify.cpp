// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/identify.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

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

/// Least squares of the columns `which` of A, with standard errors from the residuals.
Status solve(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, const std::vector<int>& which,
             CuttingIdentification& out) {
  const Eigen::Index n = static_cast<Eigen::Index>(which.size());
  Eigen::MatrixXd S(A.rows(), n);
  for (Eigen::Index k = 0; k < n; ++k) S.col(k) = A.col(which[static_cast<std::size_t>(k)]);
  const Eigen::VectorXd scale = S.colwise().norm();
  const bool loaded = scale.minCoeff() > 0;
  if (loaded) S = S * scale.cwiseInverse().asDiagonal();
  const Eigen::VectorXd sigma = S.bdcSvd().singularValues();
  const double condition = loaded && sigma[n - 1] > 0 ? sigma[0] / sigma[n - 1] : 2 * kNotApart;
  out.condition = std::max(out.condition, condition);
  if (!(condition < kNotApart)) {
    return fail("ID122", "the coefficients are not identifiable from these cuts", {}, "measure at two feeds at least");
  }
  const Eigen::VectorXd x = S.colPivHouseholderQr().solve(b);
  const double freedom = static_cast<double>(A.rows() - n);
  const double variance = (b - S * x).squaredNorm() / freedom;
  const Eigen::MatrixXd inverse = (S.transpose() * S).inverse();
  for (Eigen::Index k = 0; k < n; ++k) {
    const auto i = static_cast<std::size_t>(which[static_cast<std::size_t>(k)]);
    out.value[i] = x[k] / scale[k];
    out.standard_error[i] = std::sqrt(variance * inverse(k, k)) / scale[k];
    if (!std::isfinite(out.value[i]) || !std::isfinite(out.standard_error[i])) {
      return fail("ID122", fmt::format("{} does not come out as a finite number", kName[i]), {},
                  "are the forces in N and the lengths in mm?");
    }
    out.half_interval[i] = student_95(freedom) * out.standard_error[i];
  }
  // The covariance as independent variations: the columns of its Cholesky factor.
  const Eigen::MatrixXd L = Eigen::MatrixXd(variance * inverse).llt().matrixL();
  for (Eigen::Index j = 0; j < n; ++j) {
    std::array<double, 6> variation{};
    for (Eigen::Index k = j; k < n; ++k) {
      if (std::abs(L(k, j)) < 1e-12 * L.row(k).norm()) continue;  // rounding
      variation[static_cast<std::size_t>(which[static_cast<std::size_t>(k)])] =
          student_95(freedom) * L(k, j) / scale[k];
    }
    out.material.spread.push_back(variation);
  }
  return {};
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
/// one parameter more.
std::optional<LackOfFit> lack_of_fit(const Cutter& cutter, const std::vector<MeasuredForce>& rows,
                                     const Eigen::VectorXd& force) {
  constexpr double kLeast = 0.35, kMost = 1.45, kStep = 0.1;
  constexpr double kSure = 3.29;  // of a normal variable: 99.9 %
  constexpr double kNormal95 = 1.96;
  const double freedom = static_cast<double>(force.size()) - 5;
  if (freedom < 3) return {};
  const auto squares = [&](double exponent) {
    Eigen::MatrixXd S = shapes_across(cutter, rows, exponent);
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

/// What the same forces give with a runout in the model, worst over the place of the high tooth; into the spread where
/// the runout is given. Forces are linear in the coefficients with a runout, too.
RunoutEffect runout_effect(const Cutter& cutter, const std::vector<MeasuredForce>& rows, std::optional<double> given,
                           const std::array<double, 6>& value, Material& found) {
  constexpr double kSupposed = 10e-6;  // m
  constexpr int kPlaces = 8;           // of the high tooth, within a pitch
  RunoutEffect out;
  out.reading = given.value_or(kSupposed);
  out.given = given.has_value();
  const auto n = static_cast<Eigen::Index>(rows.size());
  std::array<double, 6> worst{};
  double most = -1;
  for (int place = 0; place < kPlaces; ++place) {
    const double phase = cutter.pitch_angle() * place / kPlaces;
    Eigen::MatrixXd across(2 * n, 4), along(n, 2);
    Eigen::VectorXd force_across(2 * n), force_along(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const MeasuredForce& row = rows[static_cast<std::size_t>(i)];
      const Engagement e = straight_engagement(cutter, row.side, row.ae, row.ap);
      const auto shape = unit_forces_with_runout(cutter, 1, e, row.feed_per_tooth, 0.5 * out.reading, phase);
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
    const Eigen::VectorXd x = solved(across, force_across), z = solved(along, force_along);
    const std::array<double, 6> with{x[0], x[1], z[0], x[2], x[3], z[1]};
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
  Eigen::MatrixXd across(2 * n, 6), along(n, 6);
  Eigen::VectorXd force_across(2 * n), force_along(n);
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
    across.middleRows<2>(2 * i) = shape.topRows<2>();
    along.row(i) = shape.row(2);
    force_across.segment<2>(2 * i) = row.mean.head<2>();
    force_along[i] = row.mean.z();
    shapes.push_back(shape);
  }
  POLYPOD_TRY(solve(across, force_across, {0, 1, 3, 4}, out));
  POLYPOD_TRY(solve(along, force_along, {2, 5}, out));
  Eigen::Matrix<double, 6, 1> K;
  for (int k = 0; k < 6; ++k) {
    K[k] = out.value[static_cast<std::size_t>(k)];
    out.material.*kCoefficient[k] = K[k];
    if (k % 3 != 2 && K[k] < 0) {
      return fail("ID123", fmt::format("{} comes out below 0", kName[k]), {}, why_below_zero(rows));
    }
  }
  POLYPOD_TRY(of_a_metal(out.material));
  out.lack_of_fit = lack_of_fit(cutter, rows, force_across);
  out.runout = runout_effect(cutter, rows, runout, out.value, out.material);
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
    const double limit = kOutlier * robust_deviation(residuals.row(axis).transpose());
    for (Eigen::Index i = 0; i < n; ++i) {
      if (std::abs(residuals(axis, i)) > limit && limit > 1e-9) {
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
