// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Rotary and linear deltas: closure, limits, closed inverse with its elbow branches, forward by trilateration,
// Jacobians (KOZ 4.3 to 4.5).
#pragma once

#include <algorithm>

#include "polypod/families/delta/linear_machine.hpp"
#include "polypod/families/delta/rotary_machine.hpp"
#include "polypod/families/hexapod/kinematics.hpp"
#include "polypod/geometry/fixed_point.hpp"
#include "polypod/geometry/trigonometry.hpp"
#include "polypod/kinematics/concept.hpp"

namespace polypod::machine {

using kinematics::InverseResult;
using kinematics::LimitBits;

template <class M>
concept DeltaFamily = std::same_as<M, RotaryDelta> || std::same_as<M, LinearDelta>;

inline int joint_count(const Delta& m) {
  return m.arms;
}
inline JointKind joint_kind(const RotaryDelta&, int) {
  return JointKind::revolute;
}
inline JointKind joint_kind(const LinearDelta&, int) {
  return JointKind::prismatic;
}
inline JointRange joint_range(const Delta& m, int) {
  return m.range;
}
inline Task task(const Delta&) {
  return Task::point;
}

/// The order of the limits of both families, the same for three and four arms; limits of an arm that is not there are
/// kept.
struct DeltaLimits {
  static constexpr int kMin = 0;        ///< q_i - min, rad or m
  static constexpr int kMax = 4;        ///< max - q_i
  static constexpr int kSide = 8;       ///< c sin(side) - |y . e|, m: the rod out of its arm's plane, the parallelogram
  static constexpr int kElbow = 12;     ///< the lesser of c cos(min) - y . a and y . a - c cos(max), a the unit arm
  static constexpr int kPlatform = 16;  ///< y . z - c cos(platform): the rod against the platform's normal
  static constexpr int kLow = 20;       ///< X - low, three
  static constexpr int kHigh = 23;      ///< high - X, three
  /// n . (X - C_1) / c^2, n = (C_2 - C_1) x (C_3 - C_1), C_i = S_i - P_i + tool, times mode_sign, m: above 0 in the
  /// assembly mode of home, 0 where the three rods lie in one plane (singular of type 2).
  static constexpr int kMode = 26;
  static constexpr int kTable = 27;   ///< elbow and platform joint above the table, m
  static constexpr int kRods = 31;    ///< rods (1,2), (1,3), (1,4), (2,3), (2,4), (3,4) apart, m
  static constexpr int kRodArm = 37;  ///< rods of i against the arm (or rail) of j: (1,2), (1,3), (1,4), (2,1), ...
  static constexpr int kBase = 49;    ///< rods of i against the edges of the base
  static constexpr int kCount = 53;
  static constexpr int kFirstBody = kRods;  ///< from here on bodies that touch
  static constexpr int rods(int i, int j) { return kRods + i * (7 - i) / 2 + j - i - 1; }  ///< i < j
  static constexpr int rod_arm(int i, int j) { return kRodArm + 3 * i + (j < i ? j : j - 1); }
};

namespace delta_detail {

using kinematics::kLimitSlack;
/// Parameters of a chain; those of the rod begin at kRod.
inline constexpr std::size_t kStride = 10, kRod = 6;

/// A chain at a pose: base joint (or start of the rail), unit direction of arm (or rail), driven end S, platform joint.
/// On the number type T, and P that of the parameters.
template <class T, class P = T>
struct Chain {
  Vector3<P> base;
  Vector3<T> arm, end, platform;
  Vector3<P> axis;  ///< of the parallelogram's short sides
  P rod;
};

template <class T>
Vector3<T> vector_at(std::span<const T> p, std::size_t k) {
  return {p[k], p[k + 1], p[k + 2]};
}
template <class T>
Vector3<T> from_tool(const Delta& m, std::span<const T> p, int i) {
  const std::size_t k = kStride * static_cast<std::size_t>(i) + kRod;
  return vector_at(p, k + 1) - vector_at(p, kStride * static_cast<std::size_t>(m.arms));
}

template <class T, class P>
Chain<T, P> chain(const RotaryDelta& m, const PoseT<T>& X, std::span<const T> q, std::span<const P> p, int i) {
  using std::cos, std::sin;
  const std::size_t k = kStride * static_cast<std::size_t>(i);
  const P c = cos(p[k + 3]), s = sin(p[k + 3]);
  const T theta = q[static_cast<std::size_t>(i)] + p[k + 5];
  const T out = sin(theta);
  Chain<T, P> chain;
  chain.base = vector_at(p, k);
  chain.arm = Vector3<T>(out * c, out * s, T(-cos(theta)));
  for (int j = 0; j < 3; ++j) chain.end[j] = chain.base[j] + p[k + 4] * chain.arm[j];
  chain.axis = Vector3<P>(P(-s), c, P(0.0));
  chain.platform = fixed_point(X, from_tool(m, p, i));
  chain.rod = p[k + kRod];
  return chain;
}
template <class T, class P>
Chain<T, P> chain(const LinearDelta& m, const PoseT<T>& X, std::span<const T> q, std::span<const P> p, int i) {
  const std::size_t k = kStride * static_cast<std::size_t>(i);
  Chain<T, P> chain;
  chain.base = vector_at(p, k);
  const Vector3<P> rail = vector_at(p, k + 3);
  chain.arm = rail.template cast<T>();
  for (int j = 0; j < 3; ++j) chain.end[j] = chain.base[j] + q[static_cast<std::size_t>(i)] * rail[j];
  chain.axis = m.axis[i].template cast<P>();
  chain.platform = fixed_point(X, from_tool(m, p, i));
  chain.rod = p[k + kRod];
  return chain;
}
/// Where the arm ends as a body: the elbow, or the far end of the rail.
template <class T>
Vector3<T> arm_end(const RotaryDelta&, const Chain<T>& chain) {
  return chain.end;
}
template <class T>
Vector3<T> arm_end(const LinearDelta& m, const Chain<T>& chain) {
  Vector3<T> out;
  for (int j = 0; j < 3; ++j) out[j] = chain.base[j] + T(m.range.max) * chain.arm[j];
  return out;
}

/// The offsets of a parallelogram's rods along its axis: one rod in the middle, or two.
inline std::array<double, 2> rod_offsets(const Delta& m) {
  return {-0.5 * m.bodies.rod_spacing, 0.5 * m.bodies.rod_spacing};
}
inline int rods_of(const Delta& m) {
  return m.bodies.rod_spacing > 0 ? 2 : 1;
}

}  // namespace delta_detail

/// F_i = |X + R (P_i - tool) - S_i(q_i)|^2 - c_i^2, m^2 (KOZ (4.38)), for each chain, and three that hold the platform
/// parallel to the base as its parallelograms do: the vector of (R - R^T) / 2 = sin(angle) axis = 0.
template <class M, class T, class P>
requires DeltaFamily<M> ClosureVectorT<T> closure(const M& m, const PoseT<T>& X_MT, std::span<const T> q,
                                                  std::span<const P> p) {
  ClosureVectorT<T> F(m.arms + 3);
  for (int i = 0; i < m.arms; ++i) {
    const auto chain = delta_detail::chain(m, X_MT, q, p, i);
    const Vector3<T> y = chain.platform - chain.end;
    F[i] = square(y[0]) + square(y[1]) + square(y[2]) - T(square(chain.rod));
  }
  for (int k = 0; k < 3; ++k)
    F[m.arms + k] = T(0.5) * (X_MT.R((k + 2) % 3, (k + 1) % 3) - X_MT.R((k + 1) % 3, (k + 2) % 3));
  return F;
}

/// Rules among the parameters: |u_i|^2 - 1 = 0 of every rail.
template <class T>
std::vector<T> parameter_rules(const LinearDelta& m, std::span<const T> p) {
  std::vector<T> out;
  for (int i = 0; i < m.arms; ++i) {
    const Vector3<T> u = delta_detail::vector_at(p, delta_detail::kStride * static_cast<std::size_t>(i) + 3);
    out.push_back(square(u[0]) + square(u[1]) + square(u[2]) - T(1.0));
  }
  return out;
}

namespace delta_detail {

/// Sine and cosines of the limits of rods.
struct RodLimits {
  double side, elbow_min, elbow_max, platform;
  explicit RodLimits(const RodJoint& joint) {
    const double angles[4] = {joint.side, joint.elbow_min, joint.elbow_max, joint.platform};
    double c[4], s[4];
    cosines_and_sines(angles, 4, c, s);
    side = s[0];
    elbow_min = c[1];
    elbow_max = c[2];
    platform = c[3];
  }
};

/// The limits that concern chain i alone, but for the base; `put(limit, value)` takes those that are given.
template <class T, class Put>
void chain_limits(const Delta& m, const RodLimits& rod, const PoseT<T>& X_MT, const Chain<T>& chain, const T& q, int i,
                  Put&& put) {
  using hexapod_detail::smaller;
  using L = DeltaLimits;
  constexpr double kRight = std::numbers::pi / 2;
  const Vector3<T> y = chain.platform - chain.end;
  const T& c = chain.rod;
  put(L::kMin + i, T(q - T(m.range.min)));
  put(L::kMax + i, T(T(m.range.max) - q));
  if (m.joint.side < kRight) {
    const T most = c * T(rod.side), aside = y.dot(chain.axis);
    put(L::kSide + i, smaller(T(most - aside), T(most + aside)));
  }
  if (m.joint.elbow_min > 0 || m.joint.elbow_max < std::numbers::pi) {
    const T along = y.dot(chain.arm);
    put(L::kElbow + i, smaller(T(c * T(rod.elbow_min) - along), T(along - c * T(rod.elbow_max))));
  }
  if (m.joint.platform < std::numbers::pi) {
    put(L::kPlatform + i, T(y.dot(Vector3<T>(X_MT.R.col(2))) - c * T(rod.platform)));
  }
  if (m.bodies.table_z) {
    const T table(*m.bodies.table_z - 0.5 * m.bodies.rod_diameter);
    put(L::kTable + i, smaller(T(table - chain.end[2]), T(table - chain.platform[2])));
  }
}

/// The limits of the tool tip that are given.
template <class T, class Put>
void tip_limits(const Delta& m, const PoseT<T>& X_MT, Put&& put) {
  for (int k = 0; k < 3; ++k) {
    if (std::isfinite(m.low[k])) put(DeltaLimits::kLow + k, T(X_MT.p[k] - T(m.low[k])));
    if (std::isfinite(m.high[k])) put(DeltaLimits::kHigh + k, T(T(m.high[k]) - X_MT.p[k]));
  }
}

/// The limit kMode from y_i = X - C_i of the first three chains.
template <class T>
T mode_limit(const Delta& m, const Vector3<T>& y_1, const Vector3<T>& y_2, const Vector3<T>& y_3) {
  const Vector3<T> n = Vector3<T>(y_1 - y_2).cross(Vector3<T>(y_1 - y_3));
  return n.dot(y_1) * T(m.mode_sign / square(m.rod_length[0]));
}

/// Passes the axes of each rod of the chain, both ends, to `each`.
template <class T, class Each>
void each_rod(const Delta& m, const Chain<T>& chain, Each&& each) {
  const auto offsets = rod_offsets(m);
  for (int k = 0; k < rods_of(m); ++k) {
    const Vector3<T> aside = chain.axis * T(offsets[static_cast<std::size_t>(k)]);
    each(Vector3<T>(chain.end + aside), Vector3<T>(chain.platform + aside));
  }
}
/// Passes each pair of axes of which one is of chain a's rods, and the other of b's rods, of b's arm, or an edge of the
/// base, to `each`.
template <class T, class Each>
void rods_and_rods(const Delta& m, const Chain<T>& a, const Chain<T>& b, Each&& each) {
  each_rod(m, a, [&](const Vector3<T>& p, const Vector3<T>& p_end) {
    each_rod(m, b, [&](const Vector3<T>& q, const Vector3<T>& q_end) { each(p, p_end, q, q_end); });
  });
}
template <class M, class T, class Each>
void rods_and_arm(const M& m, const Chain<T>& a, const Chain<T>& b, Each&& each) {
  const Vector3<T> end = arm_end(m, b);
  each_rod(m, a, [&](const Vector3<T>& p, const Vector3<T>& p_end) { each(p, p_end, b.base, end); });
}
template <class T, class Each>
void rods_and_base(const Delta& m, const Chain<T>& a, const PerArm<Vector3<T>>& base, Each&& each) {
  each_rod(m, a, [&](const Vector3<T>& p, const Vector3<T>& p_end) {
    for (int j = 0; j < m.arms; ++j) each(p, p_end, base[j], base[(j + 1) % m.arms]);
  });
}
/// The distances at which their axes touch.
inline double rods_touch(const Delta& m) {
  return m.bodies.rod_diameter;
}
inline double arm_touches(const Delta& m) {
  return 0.5 * (m.bodies.rod_diameter + m.bodies.arm_diameter);
}
inline double base_touches(const Delta& m) {
  return 0.5 * (m.bodies.rod_diameter + m.bodies.base_thickness);
}

/// The least distance of the pairs of axes that `pairs(each)` passes on.
template <class T, class Pairs>
T least_distance(Pairs&& pairs) {
  T least = T(std::numeric_limits<double>::max());
  pairs([&](const Vector3<T>& p, const Vector3<T>& p_end, const Vector3<T>& q, const Vector3<T>& q_end) {
    least = hexapod_detail::smaller(least, T(segment_distance(p, p_end, q, q_end)));
  });
  return least;
}

}  // namespace delta_detail

/// The limits in the order of DeltaLimits; 1 where a limit is not given.
template <class M, class T>
requires DeltaFamily<M> std::vector<T> limits(const M& m, const PoseT<T>& X_MT, std::span<const T> q,
                                              std::span<const T> p) {
  using namespace delta_detail;
  using L = DeltaLimits;
  std::vector<T> g(static_cast<std::size_t>(L::kCount), T(1.0));
  const auto put = [&](int limit, const T& value) { g[static_cast<std::size_t>(limit)] = value; };
  const RodLimits rod(m.joint);
  PerArm<Chain<T>> chain;
  PerArm<Vector3<T>> y, base;
  for (int i = 0; i < m.arms; ++i) {
    chain[i] = delta_detail::chain(m, X_MT, q, p, i);
    y[i] = chain[i].platform - chain[i].end;
    base[i] = chain[i].base;
    chain_limits(m, rod, X_MT, chain[i], q[static_cast<std::size_t>(i)], i, put);
  }
  tip_limits(m, X_MT, put);
  put(L::kMode, mode_limit(m, y[0], y[1], y[2]));
  if (!(m.bodies.rod_diameter > 0)) return g;
  for (int i = 0; i < m.arms; ++i) {
    for (int j = 0; j < m.arms; ++j) {
      if (i < j) {
        const T d = least_distance<T>([&](auto&& each) { rods_and_rods(m, chain[i], chain[j], each); });
        put(L::rods(i, j), d - T(rods_touch(m)));
      }
      if (i != j && m.bodies.arm_diameter > 0) {
        const T d = least_distance<T>([&](auto&& each) { rods_and_arm(m, chain[i], chain[j], each); });
        put(L::rod_arm(i, j), d - T(arm_touches(m)));
      }
    }
    if (m.bodies.base_thickness > 0) {
      const T d = least_distance<T>([&](auto&& each) { rods_and_base(m, chain[i], base, each); });
      put(L::kBase + i, d - T(base_touches(m)));
    }
  }
  return g;
}

/// "arm 2 below its smallest angle", "carriage 1 beyond the end of its rail", "rods 1 and 2 collide", ...
std::string limit_name(const RotaryDelta& m, int limit);
std::string limit_name(const LinearDelta& m, int limit);
/// Groups drive, joint, coordinates, mode, table, rods, base. A fourth arm that is not there has no limits.
LimitTable limit_table(const RotaryDelta& m);
LimitTable limit_table(const LinearDelta& m);

Pose home_pose(const Delta& m);

/// S_i(q) and dS_i/dq.
Vec3 driven_end(const RotaryDelta& m, int i, double q);
inline Vec3 driven_end(const LinearDelta& m, int i, double q) {
  return m.rail_start[i] + q * m.rail_direction[i];
}
Vec3 driven_end_rate(const RotaryDelta& m, int i, double q);
Vec3 driven_end_rate(const LinearDelta& m, int i, double q);

/// The two positions of one drive that reach a tool point.
///
/// Arms: with y = X + P - tool - Q, r = y . outward, h = y_z, D^2 = r^2 + h^2, rho^2 = c^2 - (y . axis)^2 the elbow
/// lies on two circles of the arm's plane (KOZ (4.10) to (4.20)), at
///   (alpha (r, h) +- beta (h, -r)) / D^2,  alpha = (D^2 + d^2 - rho^2) / 2,  beta^2 = d^2 D^2 - alpha^2.
/// `first` is the + one: the elbow farther from the axis, as the source takes it, wherever the platform joint lies
/// below the base joint (h > 0). Angles lie within half a turn of the middle of the range.
/// Rails: q = u . y -+ sqrt(c^2 - |across|^2); `first` is the -, the carriage on the base's side.
struct DriveRoots {
  double first = 0, second = 0;
  /// beta^2 / D^2 or the value under the root, m^2: the square of half the distance of the two ends; negative where the
  /// rod does not reach. Then both roots are the nearest position.
  double under = 0;
  [[nodiscard]] bool real() const { return under >= 0; }
};
DriveRoots drive_roots(const RotaryDelta& m, int i, const Vec3& X);
DriveRoots drive_roots(const LinearDelta& m, int i, const Vec3& X);

/// How far the rod of chain i reaches beyond what X needs, m: the lesser of d + rho - D and D - |d - rho| (arms) or
/// c - |across| (rails); negative out of reach.
double reach_of(const RotaryDelta& m, int i, const Vec3& X);
double reach_of(const LinearDelta& m, int i, const Vec3& X);

/// The first root alone, in `q`; false where the rod does not reach.
bool drive_position(const RotaryDelta& m, int i, const Vec3& X, double& q);
bool drive_position(const LinearDelta& m, int i, const Vec3& X, double& q);

/// The first roots of all drives, in q[0 .. arms - 1]; false where one does not reach. Cost: 0.08 us for three arms,
/// 0.03 us for rails (bench/delta_bench).
bool drive_positions(const RotaryDelta& m, const Vec3& X, double* q);
bool drive_positions(const LinearDelta& m, const Vec3& X, double* q);

/// Up to 2^arms solutions: every choice of the two roots, first all first roots. Empty where a rod does not reach, or
/// where X_MT is turned (R = 1 is all that a delta can do). `singular` where two roots meet (type 1). Cost: 0.5 us for
/// three chains.
InverseResult inverse(const RotaryDelta& m, const Pose& X_MT);
InverseResult inverse(const LinearDelta& m, const Pose& X_MT);
/// The first solution of inverse() within the limits, nothing where there is none. Where all drives are on their first
/// roots the others are not looked at.
std::optional<JointVector> reachable_joints(const RotaryDelta& m, const Pose& X_MT);
std::optional<JointVector> reachable_joints(const LinearDelta& m, const Pose& X_MT);
/// "outer", of linear deltas "upper", or the chains on their second root, "inner at 1, 3", "lower at 2": the bits of
/// the branch.
std::string branch_name(const RotaryDelta& m, unsigned branch);
std::string branch_name(const LinearDelta& m, unsigned branch);

/// Both tool points of given drives by trilateration (KOZ 4.4.2); four arms: of the first three, and how far the fourth
/// rod's length is off.
struct DeltaPoses {
  Vec3 machine = Vec3::Zero();  ///< the one with larger z, as the source takes it
  Vec3 other = Vec3::Zero();
  bool real = false;
  double mismatch = 0;  ///< m, of the fourth rod at `machine`
};
DeltaPoses both_poses(const RotaryDelta& m, const JointVector& q);
DeltaPoses both_poses(const LinearDelta& m, const JointVector& q);

/// The tool point of larger z; where the rods do not meet, the point of equal power to their spheres.
Pose forward(const RotaryDelta& m, const JointVector& q);
Pose forward(const LinearDelta& m, const JointVector& q);

/// The second method: Newton on the squared distances |X - C_i|^2 = c_i^2 from a seed; four arms in least squares.
/// `residual` in m.
kinematics::NewtonResult forward_from(const RotaryDelta& m, const JointVector& q, const Pose& seed_MT);
kinematics::NewtonResult forward_from(const LinearDelta& m, const JointVector& q, const Pose& seed_MT);

/// A v = B dq/dt: A has the unit vectors w_i from elbow to platform joint as rows, B = diag(w_i . dS_i/dq_i) (the
/// general form of KOZ (4.39) to (4.44), signs moved to the right).
struct DeltaJacobians {
  Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMaxArms, 3> A;
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxArms, 1> B;
  /// Of A, or for four arms sqrt(det(A^T A)); 0 at type 2.
  [[nodiscard]] double determinant_A() const;
  [[nodiscard]] double determinant_B() const { return B.prod(); }
};
DeltaJacobians jacobians(const RotaryDelta& m, const Vec3& X, const JointVector& q);
DeltaJacobians jacobians(const LinearDelta& m, const Vec3& X, const JointVector& q);

/// How near a tool point is to being singular, with all drives on their first roots: by geometry (KOZ 4.5.2.2) and by
/// determinants (4.5.2.3).
struct Closeness {
  bool reached = false;  ///< every rod reaches; otherwise the rest is 0
  double elbow_gap = 0;  ///< m, least distance of the two positions of a driven end (0: type 1)
  bool folded = false;   ///< that chain is nearer to being folded than stretched (rails: never)
  double pose_gap = 0;   ///< m, distance of the two poses of these drives (0: type 2)
  double drop = 0;       ///< m, least height of a platform joint below its driven end (0: rod level, type 2)
  double det_A = 0;      ///< of (4.42), no unit
  double det_B = 0;      ///< of (4.44), m^3 for arms, no unit for rails
  /// The least of the three distances, m.
  [[nodiscard]] double least() const { return std::min({elbow_gap, pose_gap, drop}); }
};
Closeness closeness(const RotaryDelta& m, const Vec3& X);
Closeness closeness(const LinearDelta& m, const Vec3& X);

/// The angles of KOZ Figure 4-30: theta_1 of the arm from outward towards z (q + zero - 90 deg), theta_2 from the
/// prolonged arm to the rod's projection, theta_3 between rod and the drive's axis, phi with outward = (cos phi,
/// -sin phi). Then w = (J_x, J_y, J_z) of (4.43) and B_i = d sin(theta_2) sin(theta_3) of (4.44).
struct ChainAngles {
  double theta_1 = 0, theta_2 = 0, theta_3 = 0, phi = 0;
};
ChainAngles chain_angles(const RotaryDelta& m, int i, const Vec3& X, double q);

/// 6 x arms, angular rows 0. Four arms: the least-squares answer to drive speeds that need not fit together.
JacobianMatrix jacobian(const RotaryDelta& m, const Pose& X_MT, const JointVector& q);
JacobianMatrix jacobian(const LinearDelta& m, const Pose& X_MT, const JointVector& q);

static_assert(kinematics::Machine<RotaryDelta>);
static_assert(kinematics::Machine<LinearDelta>);

}  // namespace polypod::machine
