// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/identify.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <cmath>

#include "polypod/core/csv.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/toml.hpp"
#include "polypod/core/units.hpp"

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
    return fail("ID122", "these cuts cannot tell the coefficients apart", {}, "measure at two feeds at least");
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

}  // namespace

Result<std::vector<MeasuredForce>> read_forces(const Cutter& cutter, const std::string& path) {
  POLYPOD_ASSIGN(table, csv::read(path));
  POLYPOD_TRY(table.needs({"feed_per_tooth_mm", "ap_mm", "Fx_N", "Fy_N", "Fz_N"}));
  std::vector<MeasuredForce> out;
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
    for (const double force : {x, y, z}) {
      if (std::abs(force) <= kLargestForce_N) continue;
      return fail("ID120", fmt::format("a mean force of {:g} N: at most {:g}", force, kLargestForce_N), m.place);
    }
    m.feed_per_tooth = units::from_mm(feed);
    m.ap = units::from_mm(ap);
    m.ae = units::from_mm(ae);
    m.mean = Vec3(x, y, z);
    out.push_back(std::move(m));
  }
  POLYPOD_TRY(csv::no_row_twice(table));
  return out;
}

Result<CuttingIdentification> identify_cutting(const Cutter& cutter, const std::vector<MeasuredForce>& rows) {
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
      return fail("ID123", fmt::format("{} comes out below 0", kName[k]), {},
                  "forces act on the tool, x along the feed, y to its left; is a sign or the direction wrong?");
    }
  }
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
