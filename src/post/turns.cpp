// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "turns.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace polypod::post {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kPole = 1e-9;  // of a unit vector across the axis about which the tool turns: none

double near(double angle, double last) {
  return angle + kTurn * std::round((last - angle) / kTurn);
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

}  // namespace polypod::post
