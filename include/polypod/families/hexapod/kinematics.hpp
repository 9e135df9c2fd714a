// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the kinematics of strut and slider hexapods share: limits of joints and legs, and Newton on six legs.
#pragma once

#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "polypod/families/hexapod/machine.hpp"
#include "polypod/geometry/segments.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::machine {

/// The order of the limits of both families; `kBasePlane` only of sliders (struts: always kept).
struct HexapodLimits {
  static constexpr int kMin = 0;  ///< strut too short, slider beyond the outer end
  static constexpr int kMax = 6;  ///< strut too long, slider beyond the inner end
  static constexpr int kBaseJoint = 12;
  static constexpr int kPlatformJoint = 18;
  static constexpr int kLegPair = 24;  ///< (1,2), (1,3), ..., (5,6)
  static constexpr int kBasePlane = 39;
  static constexpr int kLow = 45;   ///< x, y, z of the tool tip below its smallest value
  static constexpr int kHigh = 48;  ///< and above its largest
  static constexpr int kCount = 51;
};
/// "legs 2 and 5 collide" and the others that both families share.
std::string hexapod_limit_name(int limit);
/// Groups length, base-joint, platform-joint, legs, base, coordinates. `leg` is the length that angles of joints count
/// on.
LimitTable hexapod_limit_table(const TipLimits& tip, double leg, bool joints, bool legs, bool base);

namespace hexapod_detail {

template <class T>
T smaller(const T& a, const T& b) {
  return a < b ? a : b;
}
inline Interval smaller(const Interval& a, const Interval& b) {
  return {std::min(a.lo(), b.lo()), std::min(a.hi(), b.hi())};
}

/// The heights (cosines against the joint's platform) between which a leg stays that turns at most by the limit's angle
/// from `home`: cos(e + angle) and cos(e - angle), e the angle of home and normal; beyond +-1 where no leg gets there.
struct Elevations {
  double low = -2, high = 2;
};
inline Elevations elevations(const Vec3& home, double cosine, double sine) {
  const double c = std::clamp(home.z(), -1.0, 1.0), s = std::sqrt(1 - c * c);
  Elevations out;
  if (c < cosine) out.high = c * cosine + s * sine;
  if (c > -cosine) out.low = c * cosine - s * sine;
  return out;
}

/// How far the unit direction w of a leg is inside its joint's limit: >= 0 inside, no unit. `home` is the unit
/// direction at home and `normal` that of the joint's platform, both where the joint stands now; `cosine` and `sine`
/// are those of the limit's angle.
///   cone: w . home - cos(angle);
///   elevation: the lesser of cos(max(0, e - angle)) - w . normal and w . normal - cos(min(pi, e + angle)), e the
///   angle of home and normal;
///   pyramid: the least w . n_k.
template <class T>
T joint_margin(const JointLimit& limit, double cosine, double sine, const Vector3<T>& w, const Vec3& home_direction,
               const Matrix3<T>& R) {
  const Vector3<T> local = R.transpose() * w;
  switch (limit.kind) {
    case JointLimitKind::none:
      break;
    case JointLimitKind::cone:
      return local.dot(home_direction.cast<T>()) - T(cosine);
    case JointLimitKind::elevation: {
      const Elevations height = elevations(home_direction, cosine, sine);
      return smaller(T(T(height.high) - local.z()), T(local.z() - T(height.low)));
    }
    case JointLimitKind::pyramid: {
      const auto n = pyramid_normals(home_direction, limit);
      T least = local.dot(n[0].cast<T>());
      for (std::size_t k = 1; k < 4; ++k) least = smaller(least, T(local.dot(n[k].cast<T>())));
      return least;
    }
  }
  return T(1.0);
}
template <class T>
T joint_margin(const JointLimit& limit, const Vector3<T>& w, const Vec3& home_direction, const Matrix3<T>& R) {
  return joint_margin<T>(limit, std::cos(limit.angle), std::sin(limit.angle), w, home_direction, R);
}

/// Distance of two legs' axes less the diameter of a leg; 1 for thin legs, which are taken as lines that may cross.
template <class T>
T leg_gap(double diameter, const Vector3<T>& a, const Vector3<T>& a_end, const Vector3<T>& b, const Vector3<T>& b_end) {
  if (!(diameter > 0)) return T(1.0);
  return T(segment_distance(a, a_end, b, b_end)) - T(diameter);
}

/// The limit and the axis of joint i of an end: those of its seat where it has one.
inline JointLimit limit_of(const JointLimit& joint, const JointSeats& seats, int i) {
  JointLimit out = joint;
  if (seats.angle) out.angle = (*seats.angle)[i];
  return out;
}
inline const Vec3& axis_of(const JointSeats& seats, const HexapodHome& home, int i) {
  return seats.axis ? (*seats.axis)[i] : home.direction[i];
}

/// Limits kBaseJoint to kLegPair from the six legs, anchor to platform joint.
template <class T, class Hexapod>
void push_leg_limits(std::vector<T>& g, const Hexapod& m, const Matrix3<T>& R,
                     const std::array<Vector3<T>, kLegs>& anchor, const std::array<Vector3<T>, kLegs>& end) {
  std::array<Vector3<T>, kLegs> w;
  for (int i = 0; i < kLegs; ++i) {
    using std::sqrt;
    const Vector3<T> y = end[i] - anchor[i];
    const T length = sqrt(square(y[0]) + square(y[1]) + square(y[2]));
    for (int k = 0; k < 3; ++k) w[i][k] = y[k] / length;
  }
  const Matrix3<T> identity = Mat3::Identity().cast<T>();
  const double cosine = std::cos(m.joint.angle), sine = std::sin(m.joint.angle);
  const auto push_end = [&](const JointSeats& seats, const Matrix3<T>& turned) {
    for (int i = 0; i < kLegs; ++i) {
      const Vec3& axis = axis_of(seats, m.home, i);
      g.push_back(seats.angle ? joint_margin<T>(limit_of(m.joint, seats, i), w[i], axis, turned)
                              : joint_margin<T>(m.joint, cosine, sine, w[i], axis, turned));
    }
  };
  push_end(m.base_seats, identity);
  push_end(m.platform_seats, R);
  for (int i = 0; i < kLegs; ++i)
    for (int j = i + 1; j < kLegs; ++j) g.push_back(leg_gap<T>(m.leg_diameter, anchor[i], end[i], anchor[j], end[j]));
}

/// Limits kLow to kCount: how far the tip is inside its box, m; 1 where no limit is given.
template <class T>
void push_tip_limits(std::vector<T>& g, const TipLimits& tip, const Vector3<T>& X) {
  for (int k = 0; k < 3; ++k) g.push_back(std::isfinite(tip.low[k]) ? T(X[k] - T(tip.low[k])) : T(1.0));
  for (int k = 0; k < 3; ++k) g.push_back(std::isfinite(tip.high[k]) ? T(T(tip.high[k]) - X[k]) : T(1.0));
}

}  // namespace hexapod_detail

/// Six legs of known length between known anchors: what forward kinematics solves in both families.
struct SixLegs {
  SixPoints anchor;                  ///< a_i in M, m
  SixPoints end;                     ///< the platform joints in T (tool tip as origin), m
  std::array<double, kLegs> length;  ///< m
};

struct LegNewtonOptions {
  int max_iterations = 50;
  double tolerance = 1e-13;  ///< of the last step, times the size of the machine: m, and rad times that size
};

/// Newton for |t + R e_i - a_i| = l_i with the update on the rotation group,
///   w_i . v + (R e_i x w_i) . omega = l_i - |y_i|,  t <- t + v,  R <- exp([omega]x) R,
/// w_i the unit direction of y_i. Quadratic convergence to the assembly mode round the seed: 4 to 5 steps from a
/// neighbouring pose. The last step is applied without another evaluation once it is below the square root of the
/// tolerance times the size, because the next one would be below the tolerance. `residual` in m. Cost: 0.35 us a step.
kinematics::NewtonResult newton_on_legs(const SixLegs& legs, const Pose& seed_MT, const LegNewtonOptions& options = {});

/// The rows (w_i, R e_i x w_i) for legs y_i: d|y_i| = row . twist of the tool tip.
Mat6 leg_rows(const Pose& X_MT, const SixPoints& anchor, const SixPoints& end);

}  // namespace polypod::machine
