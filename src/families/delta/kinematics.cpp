// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/delta/kinematics.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>

#include "polypod/geometry/trilateration.hpp"

namespace polypod::machine {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kTurned = 1e-9;  // a platform that is turned farther is no delta's

/// The platform joint less the base joint (or the rail's start).
Vec3 from_base(const RotaryDelta& m, int i, const Vec3& X) {
  return X + m.platform_joint[i] - m.tool - m.base_joint[i];
}
Vec3 from_base(const LinearDelta& m, int i, const Vec3& X) {
  return X + m.platform_joint[i] - m.tool - m.rail_start[i];
}

const PerArm<Vec3>& base_joints(const RotaryDelta& m) {
  return m.base_joint;
}
const PerArm<Vec3>& base_joints(const LinearDelta& m) {
  return m.rail_start;
}

std::string common_limit_name(int limit, const char* arm) {
  using L = DeltaLimits;
  const int i = limit % 4 + 1;
  if (limit < L::kElbow) return fmt::format("rod {} too far aside for its ball joints", i);
  if (limit < L::kPlatform) return fmt::format("elbow {} beyond its limit", i);
  if (limit < L::kLow) return fmt::format("rod {} too flat against the platform", i);
  if (limit < L::kHigh) return fmt::format("{} below its smallest value", "xyz"[limit - L::kLow]);
  if (limit < L::kMode) return fmt::format("{} above its largest value", "xyz"[limit - L::kHigh]);
  if (limit == L::kMode) return "in another assembly mode";
  if (limit < L::kRods) return fmt::format("rod {} reaches the table", limit - L::kTable + 1);
  for (int a = 0; a < kMaxArms; ++a)
    for (int b = 0; b < kMaxArms; ++b) {
      if (a < b && L::rods(a, b) == limit) return fmt::format("rods {} and {} collide", a + 1, b + 1);
      if (a != b && L::rod_arm(a, b) == limit) return fmt::format("rod {} hits {} {}", a + 1, arm, b + 1);
    }
  return fmt::format("rod {} hits the base", (limit - L::kBase) % kMaxArms + 1);
}

/// `drive` is what the range of a drive counts for in m.
LimitTable common_limit_table(const Delta& m, double drive) {
  using L = DeltaLimits;
  LimitTable out(L::kSide, {"drive", drive});
  out.insert(out.end(), L::kLow - L::kSide, {"joint"});
  push_tip_limits(out, m);
  out.push_back({"mode"});
  const bool rods = m.bodies.rod_diameter > 0;
  out.insert(out.end(), L::kRods - L::kTable, {"table", 1, m.bodies.table_z.has_value()});
  out.insert(out.end(), L::kBase - L::kRods, {"rods", 1, rods, true});
  out.insert(out.end(), L::kCount - L::kBase, {"base", 1, rods && m.bodies.base_thickness > 0, true});
  for (const int of_first : {L::kMin, L::kMax, L::kSide, L::kElbow, L::kPlatform, L::kTable, L::kBase})
    for (int i = m.arms; i < kMaxArms; ++i) out[static_cast<std::size_t>(of_first + i)].given = false;
  return out;
}

template <class M>
std::array<Vec3, 3> centers(const M& m, const double* q) {
  std::array<Vec3, 3> out;
  for (int i = 0; i < 3; ++i) out[static_cast<std::size_t>(i)] = driven_end(m, i, q[i]) - m.platform_joint[i] + m.tool;
  return out;
}

template <class M>
DeltaPoses poses_of(const M& m, const double* q) {
  const TwoPoints points = trilaterate(centers(m, q), {m.rod_length[0], m.rod_length[1], m.rod_length[2]});
  DeltaPoses out;
  out.real = points.real();
  out.machine = points.above;
  out.other = points.below;
  if (out.machine.z() < out.other.z()) std::swap(out.machine, out.other);
  for (int i = 3; i < m.arms; ++i) {
    out.mismatch = (out.machine + m.platform_joint[i] - m.tool - driven_end(m, i, q[i])).norm() - m.rod_length[i];
  }
  return out;
}

template <class M>
kinematics::NewtonResult newton(const M& m, const JointVector& q, const Pose& seed) {
  kinematics::NewtonResult out{Pose{Mat3::Identity(), seed.p}, 0, 0, false};
  Vec3& X = out.X_MT.p;
  constexpr int kMost = 50;
  const auto ways = [&](auto& Y, auto& F) {
    for (int i = 0; i < m.arms; ++i) {
      const Vec3 y = X + m.platform_joint[i] - m.tool - driven_end(m, i, q[i]);
      Y.row(i) = y.transpose();
      F[i] = 0.5 * (square(m.rod_length[i]) - y.squaredNorm());
    }
  };
  Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMaxArms, 3> Y(m.arms, 3);
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxArms, 1> F(m.arms);
  for (; out.iterations < kMost && !out.converged; ++out.iterations) {
    ways(Y, F);
    Vec3 step = Y.colPivHouseholderQr().solve(F);
    if (!step.allFinite()) break;
    const double size = step.norm(), most = 0.7 * m.rod_length[0];
    if (size > most) step *= most / size;
    X += step;
    out.converged = size <= 1e-13 * m.rod_length[0];
  }
  ways(Y, F);
  for (int i = 0; i < m.arms; ++i) {
    out.residual = std::max(out.residual, std::abs(Y.row(i).norm() - m.rod_length[i]));
  }
  out.converged = out.converged && out.residual <= 1e-10 * m.rod_length[0];
  return out;
}

template <class M>
DeltaJacobians jacobians_of(const M& m, const Vec3& X, const JointVector& q) {
  DeltaJacobians out;
  out.A.resize(m.arms, 3);
  out.B.resize(m.arms);
  for (int i = 0; i < m.arms; ++i) {
    const Vec3 w = (X + m.platform_joint[i] - m.tool - driven_end(m, i, q[i])) / m.rod_length[i];
    out.A.row(i) = w.transpose();
    out.B[i] = w.dot(driven_end_rate(m, i, q[i]));
  }
  return out;
}

template <class M>
JacobianMatrix jacobian_of(const M& m, const Pose& X, const JointVector& q) {
  DeltaJacobians pair = jacobians_of(m, X.p, q);
  JacobianMatrix J = JacobianMatrix::Zero(6, m.arms);
  // Rows of unit length: their determinant is the volume that they span.
  constexpr double kFarFromSingular = 1e-3;
  if (m.arms == 3 && std::abs(pair.determinant_A()) > kFarFromSingular) {
    J.topRows<3>() = Mat3(pair.A).inverse() * pair.B.asDiagonal();
    return J;
  }
  for (int i = 0; i < m.arms; ++i) {  // rows of the closure: lengths times w
    pair.A.row(i) *= m.rod_length[i];
    pair.B[i] *= m.rod_length[i];
  }
  const Eigen::MatrixXd B = pair.B.asDiagonal();
  J.topRows<3>() = Eigen::MatrixXd(pair.A).completeOrthogonalDecomposition().solve(B);
  return J;
}

template <class M>
Closeness closeness_of(const M& m, const Vec3& X) {
  Closeness out;
  JointVector q(m.arms);
  out.elbow_gap = out.drop = std::numeric_limits<double>::infinity();
  for (int i = 0; i < m.arms; ++i) {
    const DriveRoots roots = drive_roots(m, i, X);
    if (!roots.real()) return {};
    q[i] = roots.first;
    const Vec3 end = driven_end(m, i, q[i]), joint = X + m.platform_joint[i] - m.tool;
    out.drop = std::min(out.drop, joint.z() - end.z());
    const double gap = 2 * std::sqrt(roots.under);
    if (gap >= out.elbow_gap) continue;
    out.elbow_gap = gap;
    if constexpr (std::is_same_v<M, RotaryDelta>) out.folded = (end - m.base_joint[i]).dot(joint - end) < 0;
  }
  out.reached = true;
  const DeltaPoses both = poses_of(m, q.data());
  out.pose_gap = both.real ? (both.machine - both.other).norm() : 0.0;
  const DeltaJacobians pair = jacobians_of(m, X, q);
  out.det_A = pair.determinant_A();
  out.det_B = pair.determinant_B();
  return out;
}

/// The elbow of an arm on its two circles, see drive_roots: side = beta or -beta.
struct Elbow {
  double r, h, D2, alpha, beta2;
  Elbow(const RotaryDelta& m, int i, const Vec3& y) : r(y.dot(m.outward[i])), h(y.z()), D2(r * r + h * h) {
    const double d2 = square(m.arm_length[i]);
    alpha = 0.5 * (D2 + d2 - square(m.rod_length[i]) + square(y.dot(m.axis[i])));
    beta2 = d2 * D2 - alpha * alpha;
  }
  [[nodiscard]] double beta() const { return std::sqrt(std::max(0.0, beta2)); }
  [[nodiscard]] double under() const { return D2 > 0 ? beta2 / D2 : -1.0; }
  /// Sine and cosine of the arm's angle from straight up, times d D^2.
  [[nodiscard]] double sine(double side) const { return alpha * r + side * h; }
  [[nodiscard]] double cosine(double side) const { return side * r - alpha * h; }
};

/// The drive's angle within half a turn of the middle of its range, from the arm's angle.
double drive_of(const RotaryDelta& m, int i, double angle) {
  const double q = angle - m.zero[i];
  const double off = q - 0.5 * (m.range.min + m.range.max);
  return std::abs(off) < 0.5 * kTurn ? q : q - kTurn * std::round(off / kTurn);
}
double drive_angle(const RotaryDelta& m, int i, const Elbow& elbow, double side) {
  return drive_of(m, i, std::atan2(elbow.sine(side), elbow.cosine(side)));
}

/// The angles of all arms at once.
class ArmAngles {
 public:
  void set(int i, const Elbow& elbow, double side) {
    sine_[i] = elbow.sine(side);
    cosine_[i] = elbow.cosine(side);
  }
  /// Passes the number and the angle of each drive to `each`.
  template <class Each>
  void drives(const RotaryDelta& m, Each&& each) const {
    double angle[kMaxArms];
    angles_of(sine_, cosine_, angle);
    for (int i = 0; i < m.arms; ++i) each(i, drive_of(m, i, angle[i]));
  }

 private:
  double sine_[kMaxArms] = {}, cosine_[kMaxArms] = {1, 1, 1, 1};
};

/// The foot of a platform joint on its rail, and how far off the carriage may be.
struct Foot {
  double along, under;
  Foot(const LinearDelta& m, int i, const Vec3& y) : along(m.rail_direction[i].dot(y)) {
    under = square(m.rod_length[i]) - (y - along * m.rail_direction[i]).squaredNorm();
  }
  [[nodiscard]] double half() const { return std::sqrt(std::max(0.0, under)); }
};

using Chain = delta_detail::Chain<double>;
/// Both solutions of one chain.
struct TwoChains {
  DriveRoots roots;
  Chain chain[2];
};
PerArm<TwoChains> two_chains(const RotaryDelta& m, const Pose& X) {
  PerArm<TwoChains> out;
  ArmAngles first, second;
  for (int i = 0; i < m.arms; ++i) {
    const Elbow elbow(m, i, from_base(m, i, X.p));
    const double beta = elbow.beta(), unit = 1 / (m.arm_length[i] * elbow.D2);
    out[i].roots.under = elbow.under();
    first.set(i, elbow, beta);
    second.set(i, elbow, -beta);
    const Vec3 platform = X * Vec3(m.platform_joint[i] - m.tool);
    for (int k = 0; k < 2; ++k) {
      const double side = k == 0 ? beta : -beta, out_part = unit * elbow.sine(side);
      const Vec3 arm(out_part * m.outward[i].x(), out_part * m.outward[i].y(), -unit * elbow.cosine(side));
      out[i].chain[k] = {m.base_joint[i], arm,       m.base_joint[i] + m.arm_length[i] * arm,
                         platform,        m.axis[i], m.rod_length[i]};
    }
  }
  first.drives(m, [&](int i, double q) { out[i].roots.first = q; });
  second.drives(m, [&](int i, double q) { out[i].roots.second = q; });
  return out;
}
PerArm<TwoChains> two_chains(const LinearDelta& m, const Pose& X) {
  PerArm<TwoChains> out;
  for (int i = 0; i < m.arms; ++i) {
    out[i].roots = drive_roots(m, i, X.p);
    const Vec3 platform = X * Vec3(m.platform_joint[i] - m.tool);
    for (int k = 0; k < 2; ++k) {
      const double q = k == 0 ? out[i].roots.first : out[i].roots.second;
      out[i].chain[k] = {m.rail_start[i], m.rail_direction[i], driven_end(m, i, q),
                         platform,        m.axis[i],           m.rod_length[i]};
    }
  }
  return out;
}

/// Whether any two axes of those that `pairs(each)` passes on are nearer than `touch`, with the slack of limits.
template <class Pairs>
bool touching(double touch, Pairs&& pairs) {
  bool out = false;
  pairs([&](const Vec3& p, const Vec3& p_end, const Vec3& q, const Vec3& q_end) {
    out = out || nearer_than(p, p_end, q, q_end, touch - delta_detail::kLimitSlack);
  });
  return out;
}

/// The limits that chain i breaks alone.
template <class M>
LimitBits own_violations(const M& m, const delta_detail::RodLimits& rod, const Pose& X, const Chain& chain, double q,
                         int i) {
  LimitBits bits = 0;
  delta_detail::chain_limits(m, rod, X, chain, q, i, [&](int limit, double value) {
    if (value < -delta_detail::kLimitSlack) bits |= LimitBits{1} << limit;
  });
  if (m.bodies.rod_diameter > 0 && m.bodies.base_thickness > 0) {
    const auto pairs = [&](auto&& each) { delta_detail::rods_and_base(m, chain, base_joints(m), each); };
    if (touching(delta_detail::base_touches(m), pairs)) bits |= LimitBits{1} << (DeltaLimits::kBase + i);
  }
  return bits;
}

/// Those that the tool tip breaks.
LimitBits tip_violations(const Delta& m, const Pose& X) {
  LimitBits bits = 0;
  delta_detail::tip_limits(m, X, [&](int limit, double value) {
    if (value < -delta_detail::kLimitSlack) bits |= LimitBits{1} << limit;
  });
  return bits;
}
LimitBits mode_violation(const Delta& m, const Vec3& y_1, const Vec3& y_2, const Vec3& y_3) {
  const bool other = delta_detail::mode_limit(m, y_1, y_2, y_3) < -delta_detail::kLimitSlack;
  return other ? LimitBits{1} << DeltaLimits::kMode : 0;
}

/// Those that chains i < j break together.
template <class M>
LimitBits common_violations(const M& m, const Chain& a, const Chain& b, int i, int j) {
  using namespace delta_detail;
  using L = DeltaLimits;
  LimitBits bits = 0;
  if (!(m.bodies.rod_diameter > 0)) return bits;
  // Pairs of rods whose middles are far apart need not be looked at one by one.
  const double wide = rods_touch(m) + m.bodies.rod_spacing;
  if (nearer_than(a.end, a.platform, b.end, b.platform, wide) &&
      touching(rods_touch(m), [&](auto&& each) { rods_and_rods(m, a, b, each); }))
    bits |= LimitBits{1} << L::rods(i, j);
  if (!(m.bodies.arm_diameter > 0)) return bits;
  if (touching(arm_touches(m), [&](auto&& each) { rods_and_arm(m, a, b, each); })) {
    bits |= LimitBits{1} << L::rod_arm(i, j);
  }
  if (touching(arm_touches(m), [&](auto&& each) { rods_and_arm(m, b, a, each); })) {
    bits |= LimitBits{1} << L::rod_arm(j, i);
  }
  return bits;
}

template <class M>
InverseResult inverse_of(const M& m, const Pose& X) {
  InverseResult out;
  if (!(X.R - Mat3::Identity()).isZero(kTurned)) {
    out.reason = "a delta holds its platform parallel to the base: R must be 1";
    return out;
  }
  const PerArm<TwoChains> two = two_chains(m, X);
  bool singular = false;
  for (int i = 0; i < m.arms; ++i) {
    if (!two[i].roots.real()) {
      out.reason += fmt::format("{}rod {} does not reach", out.reason.empty() ? "" : ", ", i + 1);
    }
    singular = singular || two[i].roots.under < 1e-12 * square(m.rod_length[i]);
  }
  if (!out.reason.empty()) return out;
  // What each root breaks alone and each two together is worked out once, not for every choice.
  const delta_detail::RodLimits rod(m.joint);
  LimitBits own[kMaxArms][2], common[kMaxArms][2][kMaxArms][2];
  const LimitBits tip = tip_violations(m, X);
  Vec3 y[kMaxArms][2];
  for (int i = 0; i < m.arms; ++i) {
    for (int a = 0; a < 2; ++a) {
      const Chain& chain = two[i].chain[a];
      y[i][a] = chain.platform - chain.end;
      own[i][a] = own_violations(m, rod, X, chain, a == 0 ? two[i].roots.first : two[i].roots.second, i);
      for (int j = 0; j < i; ++j)
        for (int b = 0; b < 2; ++b) common[j][b][i][a] = common_violations(m, two[j].chain[b], chain, j, i);
    }
  }
  out.solutions.reserve(std::size_t{1} << m.arms);
  for (unsigned choice = 0; choice < 1U << m.arms; ++choice) {
    kinematics::Solution s;
    const auto of = [&](int i) { return choice >> i & 1U; };
    s.joints.resize(m.arms);
    s.branch = choice;
    s.singular = singular;
    s.violations = tip;
    for (int i = 0; i < m.arms; ++i) {
      s.joints[i] = of(i) == 0 ? two[i].roots.first : two[i].roots.second;
      s.violations |= own[i][of(i)];
      for (int j = 0; j < i; ++j) s.violations |= common[j][of(j)][i][of(i)];
    }
    s.violations |= mode_violation(m, y[0][of(0)], y[1][of(1)], y[2][of(2)]);
    out.solutions.push_back(s);
  }
  return out;
}

template <class M>
std::optional<JointVector> reachable_of(const M& m, const Pose& X) {
  if (!(X.R - Mat3::Identity()).isZero(kTurned)) return {};
  const PerArm<TwoChains> two = two_chains(m, X);
  for (int i = 0; i < m.arms; ++i)
    if (!two[i].roots.real()) return {};
  // All first roots, as a rule; and only where they break a limit, every choice.
  const delta_detail::RodLimits rod(m.joint);
  LimitBits broken = tip_violations(m, X);
  JointVector q(m.arms);
  Vec3 y[kMaxArms];
  for (int i = 0; i < m.arms; ++i) {
    const Chain& chain = two[i].chain[0];
    q[i] = two[i].roots.first;
    y[i] = chain.platform - chain.end;
    broken |= own_violations(m, rod, X, chain, q[i], i);
    for (int j = 0; j < i; ++j) broken |= common_violations(m, two[j].chain[0], chain, j, i);
  }
  broken |= mode_violation(m, y[0], y[1], y[2]);
  if (broken == 0) return q;
  const InverseResult result = inverse_of(m, X);
  const kinematics::Solution* s = result.reachable();
  return s != nullptr ? s->joints : std::optional<JointVector>();
}

std::string branch_of(const Delta& m, unsigned branch, const char* first, const char* second) {
  std::string chains;
  for (int i = 0; i < m.arms; ++i)
    if ((branch >> i & 1U) != 0) chains += fmt::format("{}{}", chains.empty() ? "" : ", ", i + 1);
  return chains.empty() ? first : fmt::format("{} at {}", second, chains);
}

}  // namespace

LimitTable limit_table(const RotaryDelta& m) {
  return common_limit_table(m, m.rod_length[0]);
}
LimitTable limit_table(const LinearDelta& m) {
  return common_limit_table(m, 1);
}
std::string limit_name(const RotaryDelta&, int limit) {
  if (limit < DeltaLimits::kMax) return fmt::format("arm {} below its smallest angle", limit + 1);
  if (limit < DeltaLimits::kSide) return fmt::format("arm {} above its largest angle", limit - DeltaLimits::kMax + 1);
  return common_limit_name(limit, "arm");
}
std::string limit_name(const LinearDelta&, int limit) {
  if (limit < DeltaLimits::kMax) return fmt::format("carriage {} before the start of its rail", limit + 1);
  if (limit < DeltaLimits::kSide) {
    return fmt::format("carriage {} beyond the end of its rail", limit - DeltaLimits::kMax + 1);
  }
  return common_limit_name(limit, "rail");
}

Pose home_pose(const Delta& m) {
  return Pose{Mat3::Identity(), m.home};
}

Vec3 driven_end(const RotaryDelta& m, int i, double q) {
  const double theta = q + m.zero[i], s = m.arm_length[i] * std::sin(theta);
  return m.base_joint[i] + Vec3(s * m.outward[i].x(), s * m.outward[i].y(), -m.arm_length[i] * std::cos(theta));
}
Vec3 driven_end_rate(const RotaryDelta& m, int i, double q) {
  const double theta = q + m.zero[i], c = m.arm_length[i] * std::cos(theta);
  return {c * m.outward[i].x(), c * m.outward[i].y(), m.arm_length[i] * std::sin(theta)};
}
Vec3 driven_end_rate(const LinearDelta& m, int i, double) {
  return m.rail_direction[i];
}

DriveRoots drive_roots(const RotaryDelta& m, int i, const Vec3& X) {
  const Elbow elbow(m, i, from_base(m, i, X));
  const double beta = elbow.beta();
  return {drive_angle(m, i, elbow, beta), drive_angle(m, i, elbow, -beta), elbow.under()};
}
DriveRoots drive_roots(const LinearDelta& m, int i, const Vec3& X) {
  const Foot foot(m, i, from_base(m, i, X));
  return {foot.along - foot.half(), foot.along + foot.half(), foot.under};
}
bool drive_position(const RotaryDelta& m, int i, const Vec3& X, double& q) {
  const Elbow elbow(m, i, from_base(m, i, X));
  q = drive_angle(m, i, elbow, elbow.beta());
  return elbow.under() >= 0;
}
bool drive_position(const LinearDelta& m, int i, const Vec3& X, double& q) {
  const Foot foot(m, i, from_base(m, i, X));
  q = foot.along - foot.half();
  return foot.under >= 0;
}
bool drive_positions(const RotaryDelta& m, const Vec3& X, double* q) {
  ArmAngles angles;
  bool real = true;
  for (int i = 0; i < m.arms; ++i) {
    const Elbow elbow(m, i, from_base(m, i, X));
    angles.set(i, elbow, elbow.beta());
    real = real && elbow.under() >= 0;
  }
  angles.drives(m, [&](int i, double angle) { q[i] = angle; });
  return real;
}
bool drive_positions(const LinearDelta& m, const Vec3& X, double* q) {
  bool real = true;
  for (int i = 0; i < m.arms; ++i) real = drive_position(m, i, X, q[i]) && real;
  return real;
}

double reach_of(const RotaryDelta& m, int i, const Vec3& X) {
  const Vec3 y = from_base(m, i, X);
  const double aside = std::abs(y.dot(m.axis[i])), c = m.rod_length[i];
  if (aside > c) return c - aside;
  const double rho = std::sqrt(square(c) - square(aside)), D = std::hypot(y.dot(m.outward[i]), y.z());
  return std::min(m.arm_length[i] + rho - D, D - std::abs(m.arm_length[i] - rho));
}
double reach_of(const LinearDelta& m, int i, const Vec3& X) {
  const Vec3 y = from_base(m, i, X);
  return m.rod_length[i] - (y - m.rail_direction[i].dot(y) * m.rail_direction[i]).norm();
}

InverseResult inverse(const RotaryDelta& m, const Pose& X) {
  return inverse_of(m, X);
}
InverseResult inverse(const LinearDelta& m, const Pose& X) {
  return inverse_of(m, X);
}
std::optional<JointVector> reachable_joints(const RotaryDelta& m, const Pose& X) {
  return reachable_of(m, X);
}
std::optional<JointVector> reachable_joints(const LinearDelta& m, const Pose& X) {
  return reachable_of(m, X);
}
std::string branch_name(const RotaryDelta& m, unsigned branch) {
  return branch_of(m, branch, "outer", "inner");
}
std::string branch_name(const LinearDelta& m, unsigned branch) {
  return branch_of(m, branch, "upper", "lower");
}

DeltaPoses both_poses(const RotaryDelta& m, const JointVector& q) {
  return poses_of(m, q.data());
}
DeltaPoses both_poses(const LinearDelta& m, const JointVector& q) {
  return poses_of(m, q.data());
}
Pose forward(const RotaryDelta& m, const JointVector& q) {
  return Pose{Mat3::Identity(), poses_of(m, q.data()).machine};
}
Pose forward(const LinearDelta& m, const JointVector& q) {
  return Pose{Mat3::Identity(), poses_of(m, q.data()).machine};
}
kinematics::NewtonResult forward_from(const RotaryDelta& m, const JointVector& q, const Pose& seed) {
  return newton(m, q, seed);
}
kinematics::NewtonResult forward_from(const LinearDelta& m, const JointVector& q, const Pose& seed) {
  return newton(m, q, seed);
}

double DeltaJacobians::determinant_A() const {
  if (A.rows() == 3) return Mat3(A).determinant();
  return std::sqrt(std::max(0.0, Mat3(A.transpose() * A).determinant()));
}
DeltaJacobians jacobians(const RotaryDelta& m, const Vec3& X, const JointVector& q) {
  return jacobians_of(m, X, q);
}
DeltaJacobians jacobians(const LinearDelta& m, const Vec3& X, const JointVector& q) {
  return jacobians_of(m, X, q);
}

Closeness closeness(const RotaryDelta& m, const Vec3& X) {
  return closeness_of(m, X);
}
Closeness closeness(const LinearDelta& m, const Vec3& X) {
  return closeness_of(m, X);
}

ChainAngles chain_angles(const RotaryDelta& m, int i, const Vec3& X, double q) {
  const Vec3 w = (X + m.platform_joint[i] - m.tool - driven_end(m, i, q)) / m.rod_length[i];
  ChainAngles out;
  out.phi = -m.direction[i];
  out.theta_1 = q + m.zero[i] - kTurn / 4;
  out.theta_3 = std::acos(std::clamp(w.dot(m.axis[i]), -1.0, 1.0));
  out.theta_2 = std::atan2(w.z(), w.dot(m.outward[i])) - out.theta_1;
  return out;
}

JacobianMatrix jacobian(const RotaryDelta& m, const Pose& X, const JointVector& q) {
  return jacobian_of(m, X, q);
}
JacobianMatrix jacobian(const LinearDelta& m, const Pose& X, const JointVector& q) {
  return jacobian_of(m, X, q);
}

}  // namespace polypod::machine
