// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/identify.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "polypod/core/csv.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/units.hpp"

namespace polypod::statics {
namespace {

// A robot tip that gives way by more than this under a workshop's force is a unit that was mistaken, m.
constexpr double kUnbelievable = 0.05;
// Columns whose scaled equations are worse conditioned than this cannot be told apart.
constexpr double kNotApart = 1e8;
constexpr double kAlike = 0.9;    // correlation of two estimates from which on the sum is known better than the two
constexpr double kOutlier = 3.5;  // robust standard deviations

/// Least squares with c >= 0 from the normal equations H c = g (H positive definite), by an active set: held at 0 is
/// what would be negative, and let go again what would grow. `free` says which are not held.
Eigen::VectorXd not_negative(const Eigen::MatrixXd& H, const Eigen::VectorXd& g, std::vector<bool>& free) {
  const int n = static_cast<int>(g.size());
  free.assign(static_cast<std::size_t>(n), true);
  Eigen::VectorXd c = Eigen::VectorXd::Zero(n);
  for (int round = 0; round < 10 * n; ++round) {
    Eigen::MatrixXd Hf = H;
    Eigen::VectorXd gf = g;
    for (int i = 0; i < n; ++i) {
      if (free[static_cast<std::size_t>(i)]) continue;
      Hf.row(i).setZero();
      Hf.col(i).setZero();
      Hf(i, i) = 1;
      gf[i] = 0;
    }
    c = Hf.ldlt().solve(gf);
    int worst = 0;
    if (c.minCoeff(&worst) < 0) {
      free[static_cast<std::size_t>(worst)] = false;
      continue;
    }
    const Eigen::VectorXd pull = g - H * c;
    int grows = -1;
    for (int i = 0; i < n; ++i) {
      if (!free[static_cast<std::size_t>(i)] && pull[i] > 1e-12 * g.norm() && (grows < 0 || pull[i] > pull[grows]))
        grows = i;
    }
    if (grows < 0) break;
    free[static_cast<std::size_t>(grows)] = true;
  }
  return c.cwiseMax(0.0);
}

}  // namespace

Result<std::vector<MeasuredPoint>> read_displacements(const std::string& path) {
  POLYPOD_ASSIGN(table, csv::read(path));
  static constexpr const char* kAxes = "xyz";
  std::vector<std::string> needed{"x_mm", "y_mm", "z_mm", "force_N"};
  for (int f = 0; f < 3; ++f)
    for (int d = 0; d < 3; ++d) needed.push_back(fmt::format("d{}_F{}_um", kAxes[d], kAxes[f]));
  POLYPOD_TRY(table.needs(needed));
  std::vector<MeasuredPoint> points;
  for (const csv::Table::Row& row : table.rows) {
    MeasuredPoint p;
    p.place = table.place_of(row);
    POLYPOD_ASSIGN(x, table.number(row, "x_mm"));
    POLYPOD_ASSIGN(y, table.number(row, "y_mm"));
    POLYPOD_ASSIGN(z, table.number(row, "z_mm"));
    POLYPOD_ASSIGN(a, table.number(row, "a_deg", 0));
    POLYPOD_ASSIGN(b, table.number(row, "b_deg", 0));
    POLYPOD_ASSIGN(c, table.number(row, "c_deg", 0));
    p.X_MT = Pose{rotation_abc(units::from_deg(a), units::from_deg(b), units::from_deg(c)),
                  units::from_mm(1) * Vec3(x, y, z)};
    POLYPOD_ASSIGN(force, table.number(row, "force_N"));
    p.force = force;
    for (int f = 0; f < 3; ++f)
      for (int d = 0; d < 3; ++d) {
        POLYPOD_ASSIGN(um, table.number(row, fmt::format("d{}_F{}_um", kAxes[d], kAxes[f])));
        p.displacement(d, f) = units::from_um(um);
      }
    if (!(p.force > 0)) {
      return fail("ID104", fmt::format("force_N = {:g} must be above 0", p.force), p.place);
    }
    if (p.displacement.cwiseAbs().maxCoeff() > kUnbelievable) {
      return fail("ID105",
                  fmt::format("a displacement of {:g} mm: no machine gives way that far",
                              units::to_mm(p.displacement.cwiseAbs().maxCoeff())),
                  p.place, "displacements are in um; are these nm, or the force in another unit?");
    }
    points.push_back(p);
  }
  POLYPOD_TRY(csv::no_row_twice(table));
  return points;
}

Result<Identification> identify_compliance(const AnyMachine& machine, const std::vector<MeasuredPoint>& points) {
  Identification out;
  std::vector<std::vector<Mat3>> shapes;  // per point and joint: J_k J_k^T F, columns by force axis
  for (const MeasuredPoint& point : points) {
    const kinematics::InverseResult inverse = kinematics::inverse(machine, point.X_MT);
    const kinematics::Solution* s = inverse.reachable();
    if (s == nullptr) {
      return fail("ID111", "the machine cannot take this pose", point.place, "check the position and the machine");
    }
    const std::vector<Mat3> unit = unit_compliances(machine, point.X_MT, s->joints);
    shapes.emplace_back();
    for (const Mat3& share : unit) shapes.back().push_back(share * point.force);
  }
  const int n = shapes.empty() ? 0 : static_cast<int>(shapes[0].size());
  out.equations = 9 * points.size();
  if (out.equations <= static_cast<std::size_t>(n)) {
    return fail("ID110", fmt::format("{} equations for {} compliances", out.equations, n), {}, "measure more points");
  }
  Eigen::MatrixXd A(out.equations, n);
  Eigen::VectorXd b(out.equations);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int k = 0; k < n; ++k) A.block<9, 1>(9 * i, k) = shapes[i][k].reshaped();
    b.segment<9>(9 * i) = points[i].displacement.reshaped();
    const Mat3 cross = 0.5 * (points[i].displacement - points[i].displacement.transpose());
    out.asymmetry_rms += cross.squaredNorm();
  }
  out.asymmetry_rms = std::sqrt(out.asymmetry_rms / (6.0 * double(points.size())));
  // Columns scaled to unit length: the condition then says which joints these poses tell apart, whatever their size.
  const Eigen::VectorXd scale = A.colwise().norm();
  if (!(scale.minCoeff() > 0)) {
    return fail("ID112", "these poses do not load every joint", {}, "measure at other poses");
  }
  const Eigen::MatrixXd S = A * scale.cwiseInverse().asDiagonal();
  const std::vector<std::string> names = column_names(machine);
  const auto svd = S.bdcSvd(Eigen::ComputeThinV);
  const Eigen::VectorXd sigma = svd.singularValues();
  out.condition = sigma[0] / sigma[n - 1];
  if (!(out.condition < kNotApart)) {
    std::string who;  // the joints of the direction that shows least
    for (int k = 0; k < n; ++k)
      if (std::abs(svd.matrixV()(k, n - 1)) > 0.1) who += (who.empty() ? "" : ", ") + names[std::size_t(k)];
    return fail("ID112", fmt::format("these poses cannot tell apart: {}", who), {}, "measure at other poses");
  }
  out.turns = column_turns(machine);
  std::vector<bool> free;
  const Eigen::MatrixXd H = S.transpose() * S;
  const Eigen::VectorXd c = not_negative(H, S.transpose() * b, free);
  if (!(c.maxCoeff() > 0)) {
    return fail(
        "ID116", "no joint gives way: the tip moves against the forces", {},
        "displacements are those of the tip in the direction of the axes, under forces on the tip; is a sign wrong?");
  }
  const Eigen::VectorXd r = b - S * c;
  const double variance = r.squaredNorm() / double(out.equations - n);
  const Eigen::MatrixXd inverse = H.inverse();
  const double t = student_95(double(out.equations - n));
  for (int k = 0; k < n; ++k) {
    out.compliance.push_back(c[k] / scale[k]);
    const double error = free[static_cast<std::size_t>(k)] ? std::sqrt(variance * inverse(k, k)) / scale[k] : 0.0;
    out.standard_error.push_back(error);
    out.half_interval.push_back(t * error);
    out.joint.push_back(names[static_cast<std::size_t>(k)]);
    out.correlation.emplace_back();
    for (int j = 0; j < n; ++j) {
      out.correlation.back().push_back(inverse(k, j) / std::sqrt(inverse(k, k) * inverse(j, j)));
    }
  }
  const std::vector<double> given = column_compliances(machine);
  double times = 0, counted = 0;
  for (std::size_t k = 0; k < given.size(); ++k) {
    if (!(given[k] > 0)) continue;
    times += out.compliance[k] / given[k];
    ++counted;
  }
  if (counted > 0) out.times_given = times / counted;
  out.residual_rms = std::sqrt(r.squaredNorm() / double(out.equations));
  // Half the difference of two readings spreads by 1 / sqrt 2 of one reading's noise, and that shows in the direct
  // displacements: what is askew spoils the residuals of the cross ones, but not theirs.
  constexpr double kAskew = 1.5;
  double direct = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (const int k : {0, 4, 8})
      direct += r[9 * static_cast<Eigen::Index>(i) + k] * r[9 * static_cast<Eigen::Index>(i) + k];
  }
  direct = std::sqrt(direct / (3.0 * double(points.size())));
  out.symmetric = out.asymmetry_rms <= kAskew * direct / std::sqrt(2.0) + 1e-12;
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < k; ++j)
      if (std::abs(out.correlation[std::size_t(k)][std::size_t(j)]) > kAlike) out.hardly_apart.push_back({j, k});
  const double limit = kOutlier * robust_deviation(r);
  for (std::size_t i = 0; i < points.size(); ++i) {
    out.residuals.push_back(r.segment<9>(9 * i).reshaped(3, 3));
    for (int f = 0; f < 3; ++f)
      for (int d = 0; d < 3; ++d)
        if (std::abs(out.residuals.back()(d, f)) > limit) out.outliers.push_back({i, d, f, out.residuals.back()(d, f)});
  }
  return out;
}

Result<double> prediction_rms(const AnyMachine& machine, const std::vector<MeasuredPoint>& points) {
  double sum = 0;
  for (const MeasuredPoint& point : points) {
    const Compliance c = compliance_at(machine, point.X_MT);
    if (!c.reachable) {
      return fail("ID111", "the machine cannot take this pose", point.place, "check the position and the machine");
    }
    sum += (point.displacement - c.linear() * point.force).squaredNorm();
  }
  return points.empty() ? 0.0 : std::sqrt(sum / (9.0 * double(points.size())));
}

}  // namespace polypod::statics
