// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Patches of tool orientations: a binary tree over a cone of tilts or ranges of A and B.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>

#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {

/// A set of orientations R(s, t), (s, t) in a sector of a disc or a rectangle, about the one at its reference point.
/// For any fixed vector b of length 1
///   R(s, t) b = R b + (omega1 x R b) (s - s0) + (omega2 x R b) (t - t0) + rest, |rest| <= bend,
/// and |R(s, t) b - R b| <= turn.
struct Patch {
  Mat3 R = Mat3::Identity();  ///< at the reference point
  Vec3 omega1 = Vec3::Zero();
  Vec3 omega2 = Vec3::Zero();
  double turn = 0;
  double bend = 0;
  bool sector = false;  ///< low, high: radius and azimuth of a sector; else of the rectangle's parameters
  std::array<double, 2> low{}, high{};
  /// Corners relative to the reference point, and for sectors the unit normals of the two straight edges (inwards) and
  /// the reference point itself.
  std::array<Eigen::Vector2d, 4> corner{};
  std::array<Eigen::Vector2d, 2> edge{};
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();
  bool whole_turn = false;

  /// Whether the patch certainly holds all (s - s0, t - t0) within `half` of `middle`.
  [[nodiscard]] bool holds(const Eigen::Vector2d& middle, const Eigen::Vector2d& half) const {
    if (!sector) {
      return std::abs(middle[0]) + half[0] <= std::abs(corner[3][0]) &&
             std::abs(middle[1]) + half[1] <= std::abs(corner[3][1]);
    }
    const Eigen::Vector2d at = reference + middle;
    const double radius = at.norm(), spread = half.norm();
    if (radius + spread > high[0] || (low[0] > 0 && radius - spread < low[0])) return false;
    if (whole_turn) return true;
    if (high[1] - low[1] > std::numbers::pi) return false;
    return edge[0].dot(at) >= spread && edge[1].dot(at) >= spread;
  }

  /// A point of the patch that is about the nearest to p, all relative to the reference point.
  [[nodiscard]] Eigen::Vector2d nearest(const Eigen::Vector2d& p) const {
    if (!sector) {
      return {std::clamp(p[0], -std::abs(corner[3][0]), std::abs(corner[3][0])),
              std::clamp(p[1], -std::abs(corner[3][1]), std::abs(corner[3][1]))};
    }
    const Eigen::Vector2d at = reference + p;
    const double radius = std::clamp(at.norm(), low[0], high[0]);
    double azimuth = std::atan2(at[1], at[0]);
    if (!whole_turn) {
      const double middle = 0.5 * (low[1] + high[1]), half = 0.5 * (high[1] - low[1]);
      azimuth = middle + std::clamp(std::remainder(azimuth - middle, 2 * std::numbers::pi), -half, half);
    }
    return Eigen::Vector2d(radius * std::cos(azimuth), radius * std::sin(azimuth)) - reference;
  }

  /// Shortens first..last to where p + x along, |along| = 1, lies in the convex hull of the patch. False where nothing
  /// is left, or the hull is not known.
  [[nodiscard]] bool clip(const Eigen::Vector2d& p, const Eigen::Vector2d& along, double& first, double& last) const {
    const auto keep = [&](double distance, double rate) {  // distance + x rate >= 0
      if (rate > 0) {
        first = std::max(first, -distance / rate);
      } else if (rate < 0) {
        last = std::min(last, -distance / rate);
      } else if (distance < 0) {
        last = -std::numeric_limits<double>::infinity();
      }
    };
    if (!sector) {
      for (int k = 0; k < 2; ++k) {
        const double half = std::abs(corner[3][k]);
        keep(half + p[k], along[k]);
        keep(half - p[k], -along[k]);
      }
      return first <= last;
    }
    const double half_azimuth = 0.5 * (high[1] - low[1]);
    if (!whole_turn && half_azimuth > 0.5 * std::numbers::pi + 1e-9) return false;
    const Eigen::Vector2d at = reference + p;
    const double middle = -at.dot(along), room = high[0] * high[0] - (at + middle * along).squaredNorm();
    if (room < 0) return false;
    first = std::max(first, middle - std::sqrt(room));
    last = std::min(last, middle + std::sqrt(room));
    if (!whole_turn) {
      for (const Eigen::Vector2d& normal : edge) keep(normal.dot(at), normal.dot(along));
      const double azimuth = 0.5 * (low[1] + high[1]);
      const Eigen::Vector2d bisector(std::cos(azimuth), std::sin(azimuth));
      keep(bisector.dot(at) - low[0] * std::cos(half_azimuth), bisector.dot(along));
    }
    return first <= last;
  }

  /// The least value of s1 (s - s0) + s2 (t - t0) over the patch. A sector's is at a corner, or where its outer arc
  /// meets the direction of steepest descent.
  [[nodiscard]] double least(double s1, double s2) const {
    double value = std::min(std::min(s1 * corner[0][0] + s2 * corner[0][1], s1 * corner[1][0] + s2 * corner[1][1]),
                            std::min(s1 * corner[2][0] + s2 * corner[2][1], s1 * corner[3][0] + s2 * corner[3][1]));
    if (sector) {
      const bool on_arc =
          whole_turn || (-(edge[0][0] * s1 + edge[0][1] * s2) >= 0 && -(edge[1][0] * s1 + edge[1][1] * s2) >= 0);
      if (on_arc) {
        value = std::min(value, -std::sqrt(s1 * s1 + s2 * s2) * high[0] - s1 * reference[0] - s2 * reference[1]);
      }
    }
    return value;
  }
};

/// ranges: (s, t) = (A, B), R = R_y(B) R_x(A): omega_A = R_y(B) x, omega_B = y; second derivatives at most 1.
inline Patch make_rectangle(const std::array<double, 2>& low, const std::array<double, 2>& high) {
  Patch p;
  p.low = low;
  p.high = high;
  const double s = 0.5 * (low[0] + high[0]), t = 0.5 * (low[1] + high[1]);
  const double h1 = 0.5 * (high[0] - low[0]), h2 = 0.5 * (high[1] - low[1]);
  p.R = rotation_y(t) * rotation_x(s);
  p.omega1 = rotation_y(t) * Vec3::UnitX();
  p.omega2 = Vec3::UnitY();
  p.bend = 0.5 * (h1 + h2) * (h1 + h2);
  p.turn = std::min(h1 + h2, 2.0);
  for (std::size_t k = 0; k < 4; ++k) p.corner[k] = {(k & 1U) != 0 ? h1 : -h1, (k & 2U) != 0 ? h2 : -h2};
  return p;
}

/// cone: (s, t) = tilt (cos azimuth, sin azimuth), R = exp([w]x) with w = (-t, s, 0), the smallest rotation that tilts
/// z; a sector of the disc of tilts. omega = J dw with the left Jacobian
///   J = 1 + (1 - cos a) / a^2 [w]x + (a - sin a) / a^3 [w]x^2, a = |w|, |J| <= 1,
/// and along a straight line |R'' b| <= (1 + a / 6 + a^2 / 12 + a^3 / 60) |dw|^2, from |J' dw| with [dw]x dw = 0.
inline Patch make_sector(const std::array<double, 2>& low, const std::array<double, 2>& high) {
  Patch p;
  p.sector = true;
  p.low = low;
  p.high = high;
  const double half_azimuth = 0.5 * (high[1] - low[1]), azimuth = 0.5 * (low[1] + high[1]);
  p.whole_turn = half_azimuth > 3;
  const auto point = [](double radius, double angle) {
    return Eigen::Vector2d(radius * std::cos(angle), radius * std::sin(angle));
  };
  // The middle of the bounding box of the sector turned to its bisector keeps the farthest point near.
  const double inner = half_azimuth < 0.5 * std::numbers::pi ? low[0] * std::cos(half_azimuth) : -high[0];
  p.reference = p.whole_turn ? Eigen::Vector2d(0, 0) : point(0.5 * (inner + high[0]), azimuth);
  if (half_azimuth >= 0.5 * std::numbers::pi) p.reference.setZero();
  const double a = p.reference.norm();
  const Vec3 w(-p.reference[1], p.reference[0], 0);
  p.R = rotation_of(w);
  const double c1 = a > 1e-4 ? (1 - std::cos(a)) / (a * a) : 0.5 - a * a / 24;
  const double c2 = a > 1e-2 ? (a - std::sin(a)) / (a * a * a) : 1.0 / 6 - a * a / 120;
  const Mat3 W = skew(w);
  const Mat3 J = Mat3::Identity() + c1 * W + c2 * W * W;
  p.omega1 = J.col(1);   // dw = (0, ds, 0)
  p.omega2 = -J.col(0);  // dw = (-dt, 0, 0)
  double distance = (point(high[0], azimuth) - p.reference).norm();
  for (std::size_t k = 0; k < 4; ++k) {
    p.corner[k] = point((k & 1U) != 0 ? high[0] : low[0], (k & 2U) != 0 ? high[1] : low[1]) - p.reference;
    distance = std::max(distance, p.corner[k].norm());
  }
  if (p.reference.isZero(0)) distance = high[0];
  p.edge[0] = {-std::sin(low[1]), std::cos(low[1])};
  p.edge[1] = {std::sin(high[1]), -std::cos(high[1])};
  const double top = high[0];
  p.bend = 0.5 * (1 + top / 6 + top * top / 12 + top * top * top / 60) * distance * distance;
  p.turn = std::min(distance, 2.0);
  return p;
}

/// A patch with what a machine's limits need of it, and its two halves, made when first asked for. Halves depend on
/// nothing but the patch, so it does not matter which thread makes them. `prepare` gives the data of a patch, and may
/// count the patches that are kept.
template <class Data>
class PatchNode {
 public:
  template <class Prepare>
  PatchNode(const Patch& patch, const Prepare& prepare) : patch_(patch), data_(prepare(patch)) {}
  ~PatchNode() { delete halves_.load(); }
  PatchNode(const PatchNode&) = delete;
  PatchNode& operator=(const PatchNode&) = delete;

  [[nodiscard]] const Patch& patch() const { return patch_; }
  [[nodiscard]] const Data& data() const { return data_; }

  template <class Prepare>
  const PatchNode& half(int which, const Prepare& prepare) const {
    Halves* halves = halves_.load(std::memory_order_acquire);
    if (halves == nullptr) {
      const Patch& p = patch_;
      const double first = p.high[0] - p.low[0];
      const double second = (p.high[1] - p.low[1]) * (p.sector ? p.high[0] : 1.0);
      const std::size_t axis = first >= second ? 0 : 1;
      std::array<double, 2> middle_high = p.high, middle_low = p.low;
      middle_high[axis] = middle_low[axis] = 0.5 * (p.low[axis] + p.high[axis]);
      const auto make = p.sector ? make_sector : make_rectangle;
      auto made = std::make_unique<Halves>(PatchNode(make(p.low, middle_high), prepare),
                                           PatchNode(make(middle_low, p.high), prepare));
      if (halves_.compare_exchange_strong(halves, made.get(), std::memory_order_acq_rel)) {
        halves = made.release();
        if constexpr (requires { prepare.kept(2); }) prepare.kept(2);
      }
    }
    return which == 0 ? halves->low : halves->high;
  }

 private:
  struct Halves {
    Halves(PatchNode&& a, PatchNode&& b) : low(std::move(a)), high(std::move(b)) {}
    PatchNode low, high;
  };
  PatchNode(PatchNode&& other) noexcept : patch_(other.patch_), data_(std::move(other.data_)) {}

  Patch patch_;
  Data data_;
  mutable std::atomic<Halves*> halves_{nullptr};
};

/// The whole set of directions as one patch.
inline Patch whole_patch(const Directions& directions) {
  if (directions.is_ranges()) {
    const std::array<double, 2> none{0, 0};
    const auto a = directions.a_range.value_or(none), b = directions.b_range.value_or(none);
    return make_rectangle({a[0], b[0]}, {a[1], b[1]});
  }
  if (directions.tilt == 0) return make_rectangle({0, 0}, {0, 0});
  return make_sector({0, 0}, {directions.tilt, 2 * std::numbers::pi});
}

}  // namespace polypod::workspace
