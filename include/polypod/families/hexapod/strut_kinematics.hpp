// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Strut hexapods (Stewart-Gough): closure, limits, closed inverse, Newton forward kinematics, Jacobian (JEL 3.1, 4).
#pragma once

#include "polypod/families/hexapod/kinematics.hpp"
#include "polypod/families/hexapod/strut_machine.hpp"
#include "polypod/geometry/fixed_point.hpp"
#include "polypod/kinematics/concept.hpp"

namespace polypod::machine {

using kinematics::InverseResult;
using kinematics::LimitBits;

inline int joint_count(const StrutHexapod&) {
  return kLegs;
}
inline JointKind joint_kind(const StrutHexapod&, int) {
  return JointKind::prismatic;
}
inline JointRange joint_range(const StrutHexapod& m, int i) {
  return {m.length_min - m.leg_offset[i], m.length_max - m.leg_offset[i]};
}
inline Task task(const StrutHexapod&) {
  return Task::pose;
}

namespace hexapod_detail {
/// Leg i of the parameters p of a strut hexapod: zero offset, base joint, platform joint.
template <class T, class P>
struct StrutLeg {
  P offset;
  Vector3<P> base;
  Vector3<T> end;  ///< the platform joint in M
};
template <class T, class P>
StrutLeg<T, P> strut_leg(const PoseT<T>& X, std::span<const P> p, int i) {
  const std::size_t k = 7 * static_cast<std::size_t>(i);
  StrutLeg<T, P> leg;
  leg.offset = p[k];
  leg.base = Vector3<P>(p[k + 1], p[k + 2], p[k + 3]);
  const Vector3<P> in_tool(p[k + 4], p[k + 5], P(p[k + 6] - p[42]));
  leg.end = fixed_point(X, in_tool);
  return leg;
}
}  // namespace hexapod_detail

/// F_i = |t + R (b_i - tool z) - a_i|^2 - (q_i + offset_i)^2, m^2 (JEL (3.6) to (3.10)).
template <class T, class P>
ClosureVectorT<T> closure(const StrutHexapod&, const PoseT<T>& X_MT, std::span<const T> q, std::span<const P> p) {
  ClosureVectorT<T> F(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    const auto leg = hexapod_detail::strut_leg(X_MT, p, i);
    Vector3<T> y;
    for (int k = 0; k < 3; ++k) y[k] = leg.end[k] - leg.base[k];
    F[i] = square(y[0]) + square(y[1]) + square(y[2]) - square(T(q[i] + leg.offset));
  }
  return F;
}

/// The limits in the order of HexapodLimits: l_i - length_min and length_max - l_i in m (l_i = q_i + offset_i), the
/// joints' margins (no unit), the gaps between legs in m, six that rails have and struts keep always (1), and how far
/// the tool tip is inside its box in m.
template <class T>
std::vector<T> limits(const StrutHexapod& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  std::vector<T> g;
  g.reserve(HexapodLimits::kCount);
  const auto length = [&](int i) -> T { return q[i] + p[7 * static_cast<std::size_t>(i)]; };
  for (int i = 0; i < kLegs; ++i) g.push_back(length(i) - T(m.length_min));
  for (int i = 0; i < kLegs; ++i) g.push_back(T(m.length_max) - length(i));
  std::array<Vector3<T>, kLegs> anchor, end;
  for (int i = 0; i < kLegs; ++i) {
    const auto leg = hexapod_detail::strut_leg(X_MT, p, i);
    anchor[i] = leg.base;
    end[i] = leg.end;
  }
  hexapod_detail::push_leg_limits(g, m, X_MT.R, anchor, end);
  g.resize(HexapodLimits::kLow, T(1.0));  // no rails
  hexapod_detail::push_tip_limits(g, m, X_MT.p);
  return g;
}

/// "strut 2 below its minimum length", "base joint 3 beyond its limit", "legs 1 and 2 collide", ...
std::string limit_name(const StrutHexapod& m, int limit);
LimitTable limit_table(const StrutHexapod& m);

/// X_MT at home: platform parallel to the base over its origin.
Pose home_pose(const StrutHexapod& m);

/// The joint coordinates (the six strut lengths less their offsets), m: always one solution. Cost: 0.03 us.
void lengths(const StrutHexapod& m, const Pose& X_MT, double* out);

/// One solution. Cost: 0.45 us with its violations.
InverseResult inverse(const StrutHexapod& m, const Pose& X_MT);

/// The assembly mode that Newton reaches from the seed; see newton_on_legs.
kinematics::NewtonResult forward_from(const StrutHexapod& m, const JointVector& q, const Pose& seed_MT,
                                      const LegNewtonOptions& options = {});
/// The same from home, by way of lengths between those at home and q where Newton does not converge at once; the last
/// iterate where no real mode is found (its residual tells).
Pose forward(const StrutHexapod& m, const JointVector& q);

/// The inverse of the rows of leg_rows (the least-squares inverse at a singular pose).
JacobianMatrix jacobian(const StrutHexapod& m, const Pose& X_MT, const JointVector& q);

/// The legs as forward kinematics sees them.
SixLegs six_legs(const StrutHexapod& m, const JointVector& q);

static_assert(kinematics::Machine<StrutHexapod>);

}  // namespace polypod::machine
