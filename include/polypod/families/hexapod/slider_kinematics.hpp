// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Slider hexapods (hexaglides): closure, limits, closed inverse with branches, forward kinematics, Jacobian (JEL 3).
#pragma once

#include "polypod/families/hexapod/kinematics.hpp"
#include "polypod/families/hexapod/slider_machine.hpp"
#include "polypod/geometry/fixed_point.hpp"
#include "polypod/kinematics/concept.hpp"

namespace polypod::machine {

using kinematics::InverseResult;
using kinematics::LimitBits;

inline int joint_count(const SliderHexapod&) {
  return kLegs;
}
inline JointKind joint_kind(const SliderHexapod&, int) {
  return JointKind::prismatic;
}
inline JointRange joint_range(const SliderHexapod& m, int i) {
  return {0, m.rail_length[i]};
}
inline Task task(const SliderHexapod&) {
  return Task::pose;
}

namespace hexapod_detail {
template <class T, class P>
struct SliderLeg {
  P length;
  Vector3<T> anchor, end;  ///< slider and platform joint in M
};
template <class T, class P>
SliderLeg<T, P> slider_leg(const PoseT<T>& X, std::span<const T> q, std::span<const P> p, int i) {
  const std::size_t k = 10 * static_cast<std::size_t>(i);
  SliderLeg<T, P> leg;
  leg.length = p[k];
  for (int j = 0; j < 3; ++j) {
    leg.anchor[j] = p[k + 1 + static_cast<std::size_t>(j)] + q[i] * p[k + 4 + static_cast<std::size_t>(j)];
  }
  const Vector3<P> in_tool(p[k + 7], p[k + 8], P(p[k + 9] - p[60]));
  leg.end = fixed_point(X, in_tool);
  return leg;
}
}  // namespace hexapod_detail

/// F_i = |t + R (b_i - tool z) - a_i - q_i u_i|^2 - l_i^2, m^2 (JEL (3.12), (3.13)).
template <class T, class P>
ClosureVectorT<T> closure(const SliderHexapod&, const PoseT<T>& X_MT, std::span<const T> q, std::span<const P> p) {
  ClosureVectorT<T> F(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    const auto leg = hexapod_detail::slider_leg(X_MT, q, p, i);
    const Vector3<T> y = leg.end - leg.anchor;
    F[i] = square(y[0]) + square(y[1]) + square(y[2]) - T(square(leg.length));
  }
  return F;
}

/// Rules among the parameters: |u_i|^2 - 1 = 0 of every rail.
template <class T>
std::vector<T> parameter_rules(const SliderHexapod&, std::span<const T> p) {
  std::vector<T> out;
  for (std::size_t k = 4; k < 60; k += 10) out.push_back(square(p[k]) + square(p[k + 1]) + square(p[k + 2]) - T(1.0));
  return out;
}

/// The limits in the order of HexapodLimits: q_i and rail length - q_i in m, the joints' margins, the gaps between
/// legs in m, the lesser of leg . n over the two planes of neighbouring rails in m (JEL (4.17): inside where leg is in
/// front of both; the printed AND is an error), and how far the tool tip is inside its box in m.
template <class T>
std::vector<T> limits(const SliderHexapod& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  std::vector<T> g;
  g.reserve(HexapodLimits::kCount);
  for (int i = 0; i < kLegs; ++i) g.push_back(q[i]);
  for (int i = 0; i < kLegs; ++i) g.push_back(T(m.rail_length[i]) - q[i]);
  std::array<Vector3<T>, kLegs> anchor, end;
  for (int i = 0; i < kLegs; ++i) {
    const auto leg = hexapod_detail::slider_leg(X_MT, q, p, i);
    anchor[i] = leg.anchor;
    end[i] = leg.end;
  }
  hexapod_detail::push_leg_limits(g, m, X_MT.R, anchor, end);
  for (int i = 0; i < kLegs; ++i) {
    const Vector3<T> y = end[i] - anchor[i];
    T least(1.0);
    if (m.base_check) {
      least = hexapod_detail::smaller(T(y.dot(m.guard[i][0].cast<T>())), T(y.dot(m.guard[i][1].cast<T>())));
    }
    g.push_back(least);
  }
  hexapod_detail::push_tip_limits(g, m, X_MT.p);
  return g;
}

/// "slider 2 beyond the outer end of its rail", ...
std::string limit_name(const SliderHexapod& m, int limit);
LimitTable limit_table(const SliderHexapod& m);

Pose home_pose(const SliderHexapod& m);

/// The two roots of one slider: outer <= inner, m along the rail; `real` false where the leg does not reach its rail.
struct SliderRoots {
  double outer = 0;
  double inner = 0;
  bool real = false;
};
/// With y = t + R b_i - a_i and m its part across the rail: q = u . y -+ sqrt(l^2 - |m|^2) (JEL 3.2.2).
void slider_roots(const SliderHexapod& m, const Pose& X_MT, SliderRoots* out);

/// Up to 64 solutions: every choice of roots that lie on their rails; a leg with none there gives the root that is
/// nearer its rail. First the solution with all legs on the root nearer the outer end (smaller q), as the source takes
/// it. Empty where a leg does not reach its rail's line.
InverseResult inverse(const SliderHexapod& m, const Pose& X_MT);
/// "outer", or "inner at 2, 5" naming the legs on their other root: the bits of the branch.
std::string branch_name(const SliderHexapod& m, unsigned branch);

/// Joints along a path of poses, each slider by continuity (JEL 3.2.2, 7.2): the solution that starts on `start` (or,
/// if empty, tries all choices) and takes at each pose, slider by slider, the root nearer to the last, but where both
/// are possible (the two roots meet, or both are as near) the one on which the slider can finish the path within its
/// rail. `complete` is how many poses could be reached before a limit in `mask` is broken or a leg loses its rail.
struct SliderPath {
  std::vector<JointVector> joints;
  std::size_t complete = 0;
  std::string reason;  ///< why the path stops, if it does
};
SliderPath follow(const SliderHexapod& m, std::span<const Pose> path, const JointVector* start = nullptr,
                  LimitBits mask = ~LimitBits{0});

kinematics::NewtonResult forward_from(const SliderHexapod& m, const JointVector& q, const Pose& seed_MT,
                                      const LegNewtonOptions& options = {});
Pose forward(const SliderHexapod& m, const JointVector& q);

/// Rows (w_i, R e_i x w_i) / (w_i . u_i) inverted (JEL (6.8)); where w_i . u_i = 0 the slider moves though the tool
/// stands (type 1): its column is 0.
JacobianMatrix jacobian(const SliderHexapod& m, const Pose& X_MT, const JointVector& q);

SixLegs six_legs(const SliderHexapod& m, const JointVector& q);

static_assert(kinematics::Machine<SliderHexapod>);

}  // namespace polypod::machine
