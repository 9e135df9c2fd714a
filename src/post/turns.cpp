// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "turns.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "polypod/core/units.hpp"

namespace polypod::post {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kPole = 1e-9;  // of a unit vector across the axis about which the tool turns: none

double near(double angle, double last) {
  return angle + kTurn * std::round((last - angle) / kTurn);
}

constexpr int kChoices = 72;                         // values of C
constexpr double kChoice = kTurn / kChoices;         // 5 deg
constexpr int kFarthest = 6;                         // by which C changes in a step, in values
constexpr double kNearLimit = 0.05, kWeight = 0.02;  // a joint this share of its range from a limit costs `weight`
constexpr double kJump = 1.0;                        // rad, a joint that moves more than this in a step

struct Choice {
  double cost = std::numeric_limits<double>::infinity();
  machine::JointVector q;
};

double cost_of_limits(const machine::AnyMachine& machine, const machine::JointVector& q) {
  double cost = 0;
  for (int i = 0; i < static_cast<int>(q.size()); ++i) {
    const machine::JointRange r = kinematics::joint_range(machine, i);
    const double share = std::min(q[i] - r.min, r.max - q[i]) / (r.max - r.min);
    cost += kWeight * std::pow(kNearLimit / (std::max(share, 0.0) + kNearLimit), 2);
  }
  return cost;
}

}  // namespace

std::array<Vec3, 2> both_turns(Rotary rotary, const Vec3& k, double c, const Vec3& last) {
  constexpr double pi = std::numbers::pi;
  const auto nearest = [&](double a, double b, double w) {
    return Vec3(near(a, last.x()), near(b, last.y()), near(w, last.z()));
  };
  if (rotary == Rotary::none) return {Vec3::Zero(), Vec3::Zero()};
  if (rotary == Rotary::ac) {
    const double across = std::hypot(k.x(), k.y()), a = std::atan2(across, k.z());
    if (across < kPole) return {nearest(a, 0, last.z()), nearest(-a, 0, last.z())};
    const double w = std::atan2(k.x(), -k.y());
    return {nearest(a, 0, w), nearest(-a, 0, w + pi)};
  }
  const Vec3 turned = rotary == Rotary::abc ? Vec3(rotation_z(-c) * k) : k;
  const double across = std::hypot(turned.x(), turned.z()), a = std::atan2(-turned.y(), across);
  const double w = rotary == Rotary::abc ? c : 0;
  std::array<Vec3, 2> out;
  if (across < kPole) {
    out = {nearest(a, last.y(), 0), nearest(pi - a, last.y(), 0)};
  } else {
    const double b = std::atan2(turned.x(), turned.z());
    out = {nearest(a, b, 0), nearest(pi - a, b + pi, 0)};
  }
  for (Vec3& angles : out) angles.z() = w;
  return out;
}

Vec3 nearest_turn(Rotary rotary, const Vec3& k, double c, const Vec3& last) {
  const std::array<Vec3, 2> both = both_turns(rotary, k, c, last);
  const auto change = [&](const Vec3& a) { return (a - last).cwiseAbs().maxCoeff(); };
  return change(both[1]) < change(both[0]) - 1e-12 ? both[1] : both[0];
}

Vec3 between_axes(const Vec3& k_0, const Vec3& k_1, double s) {
  const Vec3 n = k_0.cross(k_1);
  const double sine = n.norm(), angle = std::atan2(sine, k_0.dot(k_1));
  if (sine < 1e-12) return s < 1 ? k_0 : k_1;
  return Vec3(Eigen::AngleAxisd(s * angle, Vec3(n / sine)) * k_0).normalized();
}

std::vector<double> choose_c(const Configuration& configuration, const Path& path, const PlanOptions& options,
                             unsigned branch, double first_c) {
  const std::function<bool(double)>& progress = options.progress;
  const Mat3 R_MW = rotation_z(options.rotation);
  const machine::AnyMachine& machine = configuration.machine;
  std::vector<std::size_t> moving;
  for (std::size_t i = 0; i < path.steps.size(); ++i)
    if (path.steps[i].placed()) moving.push_back(i);
  const auto value_of = [&](int j) { return first_c + kChoice * (j - kChoices / 2); };
  std::vector<Choice> row(kChoices), next(kChoices);
  std::vector<std::int8_t> from(moving.size() * kChoices, 0);
  for (std::size_t n = 0; n < moving.size(); ++n) {
    if (n % 256 == 0 && !progress(double(n) / double(moving.size()))) return {};
    const Step& step = path.steps[moving[n]];
    bool any = false;
    for (int j = 0; j < kChoices; ++j) {
      Choice& choice = next[static_cast<std::size_t>(j)];
      choice.cost = std::numeric_limits<double>::infinity();
      const double c = step.angles ? step.angles->z() : value_of(j);
      const Vec3 angles = step.angles ? *step.angles : both_turns(Rotary::abc, step.axis, c, Vec3::Zero())[0];
      const kinematics::InverseResult inverse = kinematics::inverse(
          machine, {rotation_abc(angles.x(), angles.y(), angles.z()), options.origin + R_MW * step.tip});
      for (const kinematics::Solution& s : inverse.solutions) {
        if (s.branch != branch || s.violations != 0 || s.singular) continue;
        const double limits = cost_of_limits(machine, s.joints);
        if (n == 0) {
          choice = {limits + 1e-6 * (j - kChoices / 2) * (j - kChoices / 2), s.joints};
          continue;
        }
        for (int d = -kFarthest; d <= kFarthest; ++d) {
          const int before = (j + d + kChoices) % kChoices;
          const Choice& b = row[static_cast<std::size_t>(before)];
          if (!std::isfinite(b.cost)) continue;
          const double jump = (s.joints - b.q).cwiseAbs().maxCoeff();
          const bool far = jump > kJump && step.kind != StepKind::rapid;
          const double cost = b.cost + jump * jump + (far ? 100 : 0) + 1e-3 * limits + 1e-4 * std::abs(d) + limits;
          if (cost < choice.cost) {
            choice = {cost, s.joints};
            from[n * kChoices + static_cast<std::size_t>(j)] = static_cast<std::int8_t>(d);
          }
        }
      }
      any = any || std::isfinite(choice.cost);
    }
    if (!any) return {};
    std::swap(row, next);
  }
  int j = static_cast<int>(
      std::min_element(row.begin(), row.end(), [](const Choice& a, const Choice& b) { return a.cost < b.cost; }) -
      row.begin());
  // Backwards, by steps of -d, so that C turns on and on instead of jumping by a turn.
  std::vector<double> at(moving.size());
  int turned = j;
  for (std::size_t n = moving.size(); n-- > 0;) {
    at[n] = value_of(turned);
    const int d = from[n * kChoices + static_cast<std::size_t>(j)];
    turned += d;
    j = (j + d + kChoices) % kChoices;
  }
  std::vector<double> out(path.steps.size(), at.empty() ? first_c : at.front());
  for (std::size_t n = 0; n < moving.size(); ++n) {
    const std::size_t end = n + 1 < moving.size() ? moving[n + 1] : path.steps.size();
    for (std::size_t i = moving[n]; i < end; ++i) out[i] = at[n];
  }
  return out;
}

}  // namespace polypod::post
