// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "compass.hpp"

namespace polypod::quality {
namespace {

/// The two angles of a required direction: tilt and azimuth of a cone, A and B of ranges; and how they may change.
class Turned {
 public:
  explicit Turned(const workspace::Directions& d) : d_(d) {}

  [[nodiscard]] bool fixed() const { return !d_.is_ranges() && d_.tilt == 0; }
  [[nodiscard]] Eigen::Vector2d angles(const Mat3& R) const {
    if (d_.is_ranges()) return {std::atan2(-R(1, 2), R(1, 1)), std::atan2(-R(2, 0), R(0, 0))};
    const Vec3 turn = rotation_vector(R);
    return {turn.norm(), std::atan2(-turn.x(), turn.y())};
  }
  /// The direction with angle `k` changed by `share` of a quarter of its range, or of 30 deg of azimuth.
  [[nodiscard]] Mat3 moved(const Mat3& R, int k, double share) const {
    Eigen::Vector2d a = angles(R);
    if (d_.is_ranges()) {
      const auto& range = k == 0 ? d_.a_range : d_.b_range;
      const std::array<double, 2> ends = range.value_or(std::array<double, 2>{0, 0});
      a[k] = std::clamp(a[k] + share * (ends[1] - ends[0]) / 4, ends[0], ends[1]);
      return rotation_abc(a[0], a[1], 0);
    }
    a[k] += share * (k == 0 ? d_.tilt / 4 : std::numbers::pi / 6);
    a[0] = std::clamp(a[0], 0.0, d_.tilt);
    return rotation_of(a[0] * Vec3(-std::sin(a[1]), std::cos(a[1]), 0));
  }

 private:
  const workspace::Directions& d_;
};

/// The point of the survey's box nearest to p.
Vec3 in_box(const SurveyOptions& options, const Vec3& p) {
  if (!options.box) return p;
  return p.cwiseMax((*options.box)[0]).cwiseMin((*options.box)[1]);
}

/// By more than rounding, so that of mirror images the first counts everywhere.
bool better(double value, double than) {
  constexpr double kGain = 1e-9;
  return value > than + kGain * std::abs(than);
}

/// Points of the grid by how good they are, no two within two spacings of each other, at most `most`; values that are
/// not finite do not count.
std::vector<std::size_t> starts(const Survey& survey, const std::vector<double>& values, double sign,
                                std::size_t most) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (std::isfinite(values[i])) order.push_back(i);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return sign * values[a] > sign * values[b]; });
  const double apart = 2 * survey.grid.step[0].norm();
  std::vector<std::size_t> out;
  for (const std::size_t i : order) {
    if (out.size() == most) break;
    const Vec3 p = survey.grid.at(survey.inside[i]);
    if (std::none_of(out.begin(), out.end(),
                     [&](std::size_t k) { return (survey.grid.at(survey.inside[k]) - p).norm() < apart; }))
      out.push_back(i);
  }
  return out;
}

}  // namespace

Extreme climb(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options, const Extreme& start,
              bool turn, const PoseValue& value) {
  constexpr double kFinest = 0.02;
  constexpr int kMostValues = 400;
  const Turned turned(options.workspace.directions);
  Extreme best = start;
  int asked = 0;
  const auto step = [&](int axis, double by) {
    Extreme next = best;
    if (axis < 3) {
      next.X_MT.p = in_box(options, next.X_MT.p + by * survey.grid.step[static_cast<std::size_t>(axis)]);
      if (!workspace::reaches_samples(machine, options.workspace, survey.orientations, next.X_MT.p)) return false;
    } else {
      next.X_MT.R = turned.moved(best.X_MT.R, axis - 3, by);
    }
    ++asked;
    next.value = value(next.X_MT);
    if (!better(next.value, best.value)) return false;
    best = next;
    return true;
  };
  const int axes = turn && !turned.fixed() ? 5 : 3;
  for (double share = 0.5; share > kFinest && asked < kMostValues;) {
    bool better = false;
    for (int axis = 0; axis < axes && !better; ++axis) better = step(axis, share) || step(axis, -share);
    if (!better) share /= 2;
  }
  return best;
}

Statistics statistics_seen(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                           const Quantity& quantity, const Anywhere& anywhere, std::size_t number) {
  constexpr std::size_t kStarts = 3;
  Statistics out = statistics(survey, quantity.mean);
  for (const double sign : {1.0, -1.0}) {
    double& extreme = sign > 0 ? out.max : out.min;
    Vec3& at = sign > 0 ? out.max_at : out.min_at;
    if (!std::isfinite(extreme)) continue;
    const auto value = [&](const Pose& X) { return sign * anywhere.at_point(X.p).mean[number]; };
    for (const std::size_t i : starts(survey, quantity.mean, sign, kStarts)) {
      const Extreme start{{survey.orientations[0], survey.grid.at(survey.inside[i])}, sign * quantity.mean[i]};
      const Extreme found = climb(machine, survey, options, start, false, value);
      if (!better(found.value, sign * extreme)) continue;
      extreme = sign * found.value;
      at = found.X_MT.p;
    }
  }
  return out;
}

Extreme worst_seen(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                   const Quantity& quantity, const Anywhere& anywhere, std::size_t number, double sign) {
  constexpr std::size_t kStarts = 4;
  const auto beyond =
      std::find_if(quantity.worst.begin(), quantity.worst.end(), [](double v) { return std::isinf(v); });
  if (beyond != quantity.worst.end()) {
    const auto i = static_cast<std::size_t>(beyond - quantity.worst.begin());
    return {pose_at(survey, i, quantity.worst_direction[i]), *beyond};
  }
  const PoseValue value = [&](const Pose& X) {
    const auto q = joints_at(machine, X);
    return q ? sign * anywhere.at_pose(X, *q)[number] : std::numeric_limits<double>::quiet_NaN();
  };
  Extreme best{{}, -std::numeric_limits<double>::infinity()};
  for (const std::size_t i : starts(survey, quantity.worst, sign, kStarts)) {
    const Extreme start{pose_at(survey, i, quantity.worst_direction[i]), sign * quantity.worst[i]};
    const Extreme found = climb(machine, survey, options, start, true, value);
    if (best.value == -std::numeric_limits<double>::infinity() || better(found.value, best.value)) best = found;
  }
  best.value *= sign;
  return best;
}

}  // namespace polypod::quality
