// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines of legs: closure and limits on any number type, inverse with its branches, forward, Jacobian.
#pragma once

#include <cmath>
#include <optional>

#include "polypod/families/hexapod/kinematics.hpp"
#include "polypod/families/parallel/equations.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::machine {

using kinematics::InverseResult;
using kinematics::LimitBits;

inline int joint_count(const Parallel& m) {
  return static_cast<int>(m.driven.size());
}
inline const ParallelLeg& driven_leg(const Parallel& m, int joint) {
  return m.legs[static_cast<std::size_t>(m.driven[static_cast<std::size_t>(joint)])];
}
inline JointKind joint_kind(const Parallel& m, int joint) {
  return driven_leg(m, joint).drive == LegDrive::crank ? JointKind::revolute : JointKind::prismatic;
}
/// The fastest that a drive goes, rad/s or m/s; 0: not said (kinematics::speed_limits).
inline double joint_speed_limit(const Parallel& m, int joint) {
  return driven_leg(m, joint).speed;
}
inline JointRange joint_range(const Parallel& m, int joint) {
  const ParallelLeg& leg = driven_leg(m, joint);
  const double offset = leg.drive == LegDrive::strut ? leg.rod : 0.0;
  return {leg.range.min - offset, leg.range.max - offset};
}
inline Task task(const Parallel& m) {
  return m.task;
}
inline Pose home_pose(const Parallel& m) {
  return m.home;
}

namespace parallel_detail {

/// Takes the parameters one after the other, in the order of `parameters`.
template <class T>
class Cursor {
 public:
  explicit Cursor(std::span<const T> p, std::size_t at = 0) : p_(p), at_(at) {}
  T number() { return p_[at_++]; }
  Vector3<T> vector() {
    at_ += 3;
    return {p_[at_ - 3], p_[at_ - 2], p_[at_ - 1]};
  }

 private:
  std::span<const T> p_;
  std::size_t at_;
};

template <class T>
Vector3<T> cross(const Vector3<T>& a, const Vector3<T>& b) {
  return {T(a[1] * b[2] - a[2] * b[1]), T(a[2] * b[0] - a[0] * b[2]), T(a[0] * b[1] - a[1] * b[0])};
}
template <class T>
T dot(const Vector3<T>& a, const Vector3<T>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// (length^2 - l^2) / (2 reference) of one leg whose drive reads q, m.
template <class T>
T leg_equation(const ParallelLeg& leg, const PoseT<T>& X, const T& q, const Vector3<T>& tool, Cursor<T>& p) {
  using std::cos, std::sin, std::sqrt;
  const T length = p.number();
  Vector3<T> anchor = p.vector();
  const Vector3<T> end = Vector3<T>(p.vector() - tool);
  const T l = leg.drive == LegDrive::strut ? T(q + length) : length;
  const T half = T(0.5 / leg.reference);
  if (leg.ring) {
    const Vector3<T> axis = p.vector();
    const T radius = p.number();
    const Vector3<T> u = anchor - X.p;
    const Vector3<T> d = Vector3<T>(X.R.transpose() * u) - end;
    const T h = dot(axis, d);
    Vector3<T> across;
    for (int k = 0; k < 3; ++k) across[k] = d[k] - h * axis[k];
    const T rho = sqrt(T(square(across[0]) + square(across[1]) + square(across[2])));
    return half * (square(T(rho - radius)) + square(h) - square(l));
  }
  if (leg.drive == LegDrive::rail) {
    const Vector3<T> rail = p.vector();
    const T t = q + p.number();
    for (int k = 0; k < 3; ++k) anchor[k] = anchor[k] + t * rail[k];
  } else if (leg.drive == LegDrive::crank) {
    const Vector3<T> axis = p.vector(), zero = p.vector(), side = cross(axis, zero);
    const T arm = p.number(), t = q + p.number();
    const T c = arm * cos(t), s = arm * sin(t);
    for (int k = 0; k < 3; ++k) anchor[k] = anchor[k] + c * zero[k] + s * side[k];
  }
  const Vector3<T> y = Vector3<T>(X * end) + leg.still.cast<T>() - anchor;
  return half * (square(y[0]) + square(y[1]) + square(y[2]) - square(l));
}

/// The equations of one constraint.
template <class T, class Push>
void constraint_equations(const Parallel& m, const PlatformConstraint& c, const PoseT<T>& X, const Vector3<T>& tool,
                          Cursor<T>& p, Push&& push) {
  switch (c.kind) {
    case ConstraintKind::plane: {
      const Vector3<T> at = Vector3<T>(p.vector() - tool), base = p.vector(), normal = p.vector();
      push(dot(normal, Vector3<T>(Vector3<T>(X * at) - base)));
      return;
    }
    case ConstraintKind::platform_plane: {
      const Vector3<T> at = Vector3<T>(p.vector() - tool), base = p.vector(), axis = p.vector();
      const Vector3<T> u = base - X.p;
      push(dot(axis, Vector3<T>(Vector3<T>(X.R.transpose() * u) - at)));
      return;
    }
    case ConstraintKind::line: {
      const Vector3<T> at = Vector3<T>(p.vector() - tool), base = p.vector(), axis = p.vector();
      const Vector3<T> u = base - X.p;
      const Vector3<T> d = Vector3<T>(X.R.transpose() * u) - at;
      const T along = dot(axis, d);
      Vector3<T> off;
      for (int k = 0; k < 3; ++k) off[k] = d[k] - along * axis[k];
      for (const Vec3& e : across(c.platform_axis)) push(dot(Vector3<T>(e.cast<T>()), off));
      return;
    }
    case ConstraintKind::square: {
      const Vector3<T> a = p.vector(), b = p.vector();
      push(T(m.size) * dot(a, Vector3<T>(X.R * b)));
      return;
    }
    case ConstraintKind::orientation: {
      const Matrix3<T> M = X.R * Mat3(m.home.R.transpose()).cast<T>();
      for (int k = 0; k < 3; ++k) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        push(T(0.5 * m.size) * (M(j, i) - M(i, j)));
      }
      return;
    }
  }
}

/// Parameters of a leg.
inline std::size_t stride(const ParallelLeg& leg) {
  return leg.ring ? 11 : leg.drive == LegDrive::rail ? 11 : leg.drive == LegDrive::crank ? 15 : 7;
}

/// The equations of all legs, or of the passive ones alone, then those of the constraints.
template <class T>
ClosureVectorT<T> equations(const Parallel& m, const PoseT<T>& X, std::span<const T> q, std::span<const T> p,
                            bool passive_alone) {
  ClosureVectorT<T> F(kMaxEquations);
  int count = 0;
  const auto push = [&](const T& value) { F[count++] = value; };
  const std::size_t n = p.size();
  const Vector3<T> tool(p[n - 3], p[n - 2], p[n - 1]);
  std::size_t at = 0, drive = 0;
  for (const ParallelLeg& leg : m.legs) {
    if (!leg.driven() || !passive_alone) {
      Cursor<T> cursor(p, at);
      push(leg_equation<T>(leg, X, leg.driven() ? q[drive] : T(0.0), tool, cursor));
    }
    drive += leg.driven() ? 1 : 0;
    at += stride(leg);
  }
  Cursor<T> cursor(p, at);
  for (const PlatformConstraint& c : m.constraints) constraint_equations<T>(m, c, X, tool, cursor, push);
  if (m.idle_turn) {
    push(T(m.size) * (X.R(1, 0) * T(std::cos(m.home_angles.z())) - X.R(0, 0) * T(std::sin(m.home_angles.z()))));
  }
  F.conservativeResize(count);
  return F;
}

}  // namespace parallel_detail

/// The values of parameters(m), without their names.
std::vector<double> parameter_values(const Parallel& m);

/// The closure, all in metres: of each leg (length^2 - l^2) / (2 length at home), then the equations of the constraints
/// (directions times Parallel::size), and C - C_home = 0 where the platform turns idly in its rings.
template <class T>
ClosureVectorT<T> closure(const Parallel& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  return parallel_detail::equations(m, X_MT, q, p, false);
}

/// Of each drive q - min and max - q (of struts their lengths), rad or m; then how far the tool tip is above the least
/// x, y, z, m, and below the largest; 1 where no limit is given.
template <class T>
std::vector<T> limits(const Parallel& m, const PoseT<T>& X_MT, std::span<const T> q, std::span<const T> p) {
  std::vector<T> g;
  g.reserve(2 * m.driven.size() + 6);
  std::size_t at = 0, drive = 0;
  for (const ParallelLeg& leg : m.legs) {
    if (leg.driven()) {
      const T value = leg.drive == LegDrive::strut ? T(q[drive] + p[at]) : q[drive];
      g.push_back(value - T(leg.range.min));
      g.push_back(T(leg.range.max) - value);
      ++drive;
    }
    at += parallel_detail::stride(leg);
  }
  hexapod_detail::push_tip_limits(g, m, X_MT.p);
  return g;
}

/// "leg 2 below its minimum", ...
std::string limit_name(const Parallel& m, int limit);
/// Groups drive (of struts also length) and coordinates. Angles of cranks count on the arm.
LimitTable limit_table(const Parallel& m);

/// Rules among the parameters: |v|^2 - 1 = 0 of every direction, and zero square to the axis of a crank.
template <class T>
std::vector<T> parameter_rules(const Parallel& m, std::span<const T> p) {
  std::vector<T> out;
  parallel_detail::Cursor<T> c(p);
  const auto unit = [&] {
    const Vector3<T> v = c.vector();
    out.push_back(square(v[0]) + square(v[1]) + square(v[2]) - T(1.0));
    return v;
  };
  for (const ParallelLeg& leg : m.legs) {
    c.number();
    c.vector();
    c.vector();
    if (leg.ring) {
      unit();
      c.number();
    }
    if (leg.drive == LegDrive::rail) unit();
    if (leg.drive == LegDrive::crank) {
      const Vector3<T> axis = unit(), zero = unit();
      out.push_back(parallel_detail::dot(axis, zero));
      c.number();
    }
    if (leg.two_roots()) c.number();
  }
  for (const PlatformConstraint& k : m.constraints) {
    if (k.has_points()) {
      c.vector();
      c.vector();
    }
    if (k.has_base_axis()) unit();
    if (k.has_platform_axis()) unit();
  }
  return out;
}

/// The drives at a whole pose: of legs with two roots the one that the machine takes where it is in the range or
/// neither is, else the other. Empty where a leg does not reach.
std::optional<JointVector> joints_of(const Parallel& m, const Pose& X_MT);

/// All combinations of the roots of the legs, the machine's first; at most 64, further ones are left out. A pose whose
/// following coordinates cannot be met has no solution.
InverseResult inverse(const Parallel& m, const Pose& X_MT);
/// The legs with two roots by number, "1 low, 2 high, ..."; "only" where there is none. A branch has a bit for each
/// drive on its higher root.
std::string branch_name(const Parallel& m, unsigned branch);

/// Newton's method from a seed on all equations, in least squares where they are more than six: converged only where
/// they close.
kinematics::NewtonResult forward_from(const Parallel& m, const JointVector& q, const Pose& seed_MT);
/// The same from home, by joints between those of home and q where that ends nowhere or beyond singular poses.
kinematics::NewtonResult forward_from_home(const Parallel& m, const JointVector& q);
Pose forward(const Parallel& m, const JointVector& q);

/// Poses that a search finds: Newton from home and from `starts` fixed places and orientations round it. Not proven to
/// be all.
std::vector<Pose> poses_by_search(const Parallel& m, const JointVector& q, int starts = 2000);

/// The legs as the search for all modes takes them, of a machine of exactly six legs without rings and constraints.
std::optional<SixLegs> plain_six_legs(const Parallel& m, const JointVector& q);

/// J = -A^-1 B, least squares where A is singular or has more than six rows.
JacobianMatrix jacobian(const Parallel& m, const Pose& X_MT, const JointVector& q);

/// What the tool does for a unit (m) by which each leg becomes longer, 6 x legs. Where equations are more than six,
/// loads share out as the stiffnesses are: a leg or constraint without compliance counts as a millionth of the softest.
Eigen::Matrix<double, 6, Eigen::Dynamic> leg_columns(const Parallel& m, const Pose& X_MT, const JointVector& q);

static_assert(kinematics::Machine<Parallel>);

}  // namespace polypod::machine
