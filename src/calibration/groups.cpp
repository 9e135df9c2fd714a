// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "groups.hpp"

#include <array>
#include <cmath>
#include <map>
#include <tuple>

#include "polypod/core/distributions.hpp"
#include "polypod/core/units.hpp"

namespace polypod::calibration {

std::vector<std::size_t> poses_of(const AnyMachine& machine, const std::vector<Measurement>& rows) {
  constexpr double kSteps = 1000;  // a mm, a deg
  std::map<std::vector<long long>, std::size_t> seen;
  std::vector<std::size_t> out;
  for (const Measurement& row : rows) {
    std::vector<long long> key;
    for (int i = 0; i < static_cast<int>(row.q.size()); ++i) {
      const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
      key.push_back(std::llround(kSteps * (turns ? units::to_deg(row.q[i]) : units::to_mm(row.q[i]))));
    }
    out.push_back(seen.try_emplace(std::move(key), seen.size()).first->second);
  }
  return out;
}

std::vector<std::size_t> repeats_of(const std::vector<Measurement>& rows, const std::vector<std::size_t>& poses) {
  using Key = std::tuple<std::size_t, Kind, std::array<double, 3>, std::array<double, 3>, std::string>;
  std::map<Key, std::size_t> seen;
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Vec3 &a = rows[i].anchor_S, &n = rows[i].normal_S;
    Key key{poses[i], rows[i].kind, {a.x(), a.y(), a.z()}, {n.x(), n.y(), n.z()}, rows[i].contact};
    out.push_back(seen.try_emplace(std::move(key), seen.size()).first->second);
  }
  return out;
}

Repeats repeats_in(const std::vector<Measurement>& rows, const std::vector<std::size_t>& repeats,
                   const std::vector<RowResidual>& residuals, double noise_position, double noise_angle,
                   double taken_up) {
  struct Set {
    std::vector<Eigen::VectorXd> r;
  };
  std::map<std::size_t, Set> sets;
  for (const RowResidual& one : residuals) {
    if (one.outlier || one.lost || one.held_back) continue;
    Eigen::VectorXd r = one.after;
    r.head(one.lengths) /= rows[one.row].noise > 0 ? rows[one.row].noise : noise_position;
    r.tail(r.size() - one.lengths) /= noise_angle;
    sets[repeats[one.row]].r.push_back(std::move(r));
  }
  Repeats out;
  double within = 0, between = 0, all = 0, squares = 0;
  for (const auto& [number, set] : sets) {
    const auto m = static_cast<double>(set.r.size());
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(set.r.front().size());
    for (const Eigen::VectorXd& r : set.r) mean += r / m;
    for (const Eigen::VectorXd& r : set.r) within += (r - mean).squaredNorm();
    out.within_degrees += static_cast<double>(mean.size()) * (m - 1);
    out.between_degrees += static_cast<double>(mean.size());
    between += m * mean.squaredNorm();
    all += m;
    squares += m * m;
    if (set.r.size() < 2) continue;
    out.rows += set.r.size();
    ++out.poses;
  }
  out.between_degrees -= taken_up;
  if (out.poses == 0 || !(out.between_degrees >= 1) || sets.size() < 2 || !(within > 0)) return out;
  const double pure = within / out.within_degrees, lack = between / out.between_degrees;
  const double repeated = (all - squares / all) / (static_cast<double>(sets.size()) - 1);  // rows a pose, on the mean
  out.within = std::sqrt(pure);
  out.between = std::sqrt(std::max(0.0, (lack - pure) / repeated));
  out.F = lack / pure;
  out.p_value = f_above(out.F, out.between_degrees, out.within_degrees);
  out.correlation = out.between * out.between / (out.between * out.between + pure);
  return out;
}

std::vector<double> shares_of(const std::vector<std::size_t>& repeats, double correlation) {
  std::map<std::size_t, double> count;
  for (const std::size_t set : repeats) ++count[set];
  std::vector<double> out;
  for (const std::size_t set : repeats) out.push_back(1 / (1 + (count[set] - 1) * correlation));
  return out;
}

}  // namespace polypod::calibration
