// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/parallel/kinematics.hpp"

#include <fmt/format.h>

#include <Eigen/QR>
#include <algorithm>
#include <numbers>

#include "polypod/core/random.hpp"
#include "polypod/kinematics/hold_constraints.hpp"

namespace polypod::machine {
namespace {

using kinematics::kLimitSlack;
constexpr unsigned kMostSolutions = 64;

using ByJoints = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxEquations, kMaxJoints>;

LimitBits violations_of(const Parallel& m, const Pose& X, const JointVector& q) {
  LimitBits bits = 0;
  const auto note = [&](int limit, double g) {
    if (g < -kLimitSlack) bits |= LimitBits{1} << limit;
  };
  const int n = joint_count(m);
  for (int j = 0; j < n; ++j) {
    const JointRange range = joint_range(m, j);
    note(2 * j, q[j] - range.min);
    note(2 * j + 1, range.max - q[j]);
  }
  for (int k = 0; k < 3; ++k) {
    note(2 * n + k, X.p[k] - m.low[k]);
    note(2 * n + 3 + k, m.high[k] - X.p[k]);
  }
  return bits;
}

struct Roots {
  std::vector<LegRoots> of;     ///< of each drive
  unsigned two = 0, first = 0;  ///< drives with two different roots; whether the machine takes the higher
  std::string reason;           ///< legs that do not reach
};

Roots roots_of(const Parallel& m, const Pose& X) {
  Roots out;
  for (int j = 0; j < joint_count(m); ++j) {
    const ParallelLeg& leg = driven_leg(m, j);
    const LegRoots roots = leg_roots(m, leg, X);
    out.of.push_back(roots);
    if (!roots.real()) {
      out.reason +=
          fmt::format("{}leg {} does not reach its {}", out.reason.empty() ? "" : ", ",
                      m.driven[static_cast<std::size_t>(j)] + 1, leg.drive == LegDrive::rail ? "rail" : "arm");
    }
    if (!leg.two_roots()) continue;
    const auto in = [&](double q) { return q >= leg.range.min - kLimitSlack && q <= leg.range.max + kLimitSlack; };
    const bool preferred = m.takes_high[static_cast<std::size_t>(m.driven[static_cast<std::size_t>(j)])];
    const bool high = in(roots.low) == in(roots.high) ? preferred : in(roots.high);
    if (roots.low != roots.high) out.two |= 1U << j;
    if (high) out.first |= 1U << j;
  }
  return out;
}

JointVector chosen(const Roots& roots, unsigned high) {
  JointVector q(static_cast<Eigen::Index>(roots.of.size()));
  for (std::size_t j = 0; j < roots.of.size(); ++j) {
    q[static_cast<Eigen::Index>(j)] = (high >> j & 1U) != 0 ? roots.of[j].high : roots.of[j].low;
  }
  return q;
}

/// A kept orientation is that of home; the equations hold for half turns against it, too.
bool keeps_orientation(const Parallel& m, const Pose& X) {
  const bool kept = std::any_of(m.constraints.begin(), m.constraints.end(),
                                [](const PlatformConstraint& c) { return c.kind == ConstraintKind::orientation; });
  return !kept || (X.R * m.home.R.transpose()).trace() > 1;
}

}  // namespace

LimitTable limit_table(const Parallel& m) {
  LimitTable out;
  for (int j = 0; j < joint_count(m); ++j) {
    const ParallelLeg& leg = driven_leg(m, j);
    const bool turns = leg.drive == LegDrive::crank;
    out.insert(out.end(), 2, {"drive", turns ? leg.arm : 1.0, true, false, !turns});
  }
  push_tip_limits(out, m);
  return out;
}

std::string limit_name(const Parallel& m, int limit) {
  const int n = joint_count(m);
  if (limit >= 2 * n) return hexapod_limit_name(HexapodLimits::kLow + limit - 2 * n);
  return fmt::format("leg {} {}", m.driven[static_cast<std::size_t>(limit / 2)] + 1,
                     limit % 2 == 0 ? "below its minimum" : "above its maximum");
}

std::optional<JointVector> joints_of(const Parallel& m, const Pose& X) {
  const Roots roots = roots_of(m, X);
  if (!roots.reason.empty()) return std::nullopt;
  return chosen(roots, roots.first);
}

InverseResult inverse(const Parallel& m, const Pose& target) {
  InverseResult out;
  const std::optional<Pose> X = settled(m, target);
  if (!X) {
    out.converged = false;
    out.reason =
        "the coordinates that follow were not found: the constraints cannot be met, or are singular on the way "
        "from home";
    return out;
  }
  const Roots roots = roots_of(m, *X);
  if (!roots.reason.empty()) {
    out.reason = roots.reason;
    return out;
  }
  // Subsets of the legs with two roots, in the order of binary numbers, so that the machine's own choice is first.
  for (unsigned subset = 0;; subset = (subset - roots.two) & roots.two) {
    kinematics::Solution s;
    const unsigned high = roots.first ^ subset;
    s.joints = chosen(roots, high);
    s.branch = high;
    s.violations = violations_of(m, *X, s.joints);
    for (std::size_t j = 0; j < roots.of.size(); ++j) {
      const ParallelLeg& leg = driven_leg(m, static_cast<int>(j));
      s.singular = s.singular || (leg.two_roots() && std::sqrt(roots.of[j].under) < 1e-6 * leg.rod);
    }
    out.solutions.push_back(std::move(s));
    if (subset == roots.two || out.solutions.size() == kMostSolutions) break;
  }
  return out;
}

std::string branch_name(const Parallel& m, unsigned high) {
  std::string out;
  for (int j = 0; j < joint_count(m); ++j) {
    if (!driven_leg(m, j).two_roots()) continue;
    out += fmt::format("{}{} {}", out.empty() ? "" : ", ", m.driven[static_cast<std::size_t>(j)] + 1,
                       (high >> j & 1U) != 0 ? "high" : "low");
  }
  return out.empty() ? "only" : out;
}

namespace {

kinematics::NewtonResult newton(const Parallel& m, const JointVector& q, const Pose& seed) {
  constexpr int kSteps = 60;
  // More legs than freedoms close only as far as their readings have digits.
  constexpr double kLongest = 0.5, kDone = 1e-14, kCloses = 1e-9, kAgrees = 1e-6;
  kinematics::NewtonResult out{seed, 0, 0, false};
  bool settled = false;
  for (; out.iterations < kSteps && !settled; ++out.iterations) {
    EquationRows rows = closure_rows(m, out.X_MT, q);
    kinematics::hold_constraints(m, rows.A, rows.F);
    rows.A.rightCols<3>() /= m.size;
    Vec6 step = -kinematics::ClosureSolver(rows.A).solve(rows.F);
    step.tail<3>() /= m.size;
    if (!step.allFinite()) break;
    const double turn = step.tail<3>().norm(), way = step.head<3>().norm() / m.size;
    const double share = std::min(1.0, kLongest / std::max({turn, way, 1e-300}));
    out.X_MT.p += share * step.head<3>();
    out.X_MT.R = rotation_of(share * step.tail<3>()) * out.X_MT.R;
    const double small = kDone * (1 + out.X_MT.p.norm() / m.size);
    settled = share == 1 && std::max(turn, way) < (out.iterations > 5 ? 100 * small : small);
  }
  const ClosureVector F = closure_rows(m, out.X_MT, q).F;
  out.residual = F.cwiseAbs().maxCoeff();
  out.converged = out.residual < (F.size() > 6 ? kAgrees : kCloses) * (m.size + out.X_MT.p.norm()) &&
                  keeps_orientation(m, out.X_MT);
  return out;
}

/// The sign of det F_X, which changes at singular poses alone: 0 where there are more than six equations, which have
/// none.
int side_of(const Parallel& m, const Pose& X, const JointVector& q) {
  const EquationRows rows = closure_rows(m, X, q);
  if (rows.A.rows() != 6) return 0;
  const double det = Mat6(rows.A).determinant();
  return (det > 0) - (det < 0);
}

}  // namespace

kinematics::NewtonResult forward_from(const Parallel& m, const JointVector& q, const Pose& seed) {
  kinematics::NewtonResult out = newton(m, q, seed);
  if (!m.idle_turn || !out.converged) return out;
  // The equation of the idle turn, sin(C - C_home) = 0, is met half a turn off, too: the same tool, turned back.
  Mat3& R = out.X_MT.R;
  if (R(0, 0) * std::cos(m.home_angles.z()) + R(1, 0) * std::sin(m.home_angles.z()) >= 0) return out;
  R.leftCols<2>() *= -1;
  return newton(m, q, out.X_MT);
}

namespace {

/// Whether the straight way of the tool from home leads to the pose X without a singular pose: at 20 poses of it,
/// settled where coordinates follow, det F_X has the sign `side`.
bool leads_there(const Parallel& m, const Pose& X, int side) {
  constexpr int kPoses = 20;
  constexpr double kSame = 1e-6;  // of the size, and rad
  const Vec3 turn = rotation_vector(m.home.R.transpose() * X.R);
  std::optional<Pose> at;
  for (int k = 1; k <= kPoses; ++k) {
    const double share = double(k) / kPoses;
    at = settled(m, Pose{m.home.R * rotation_of(share * turn), m.home.p + share * (X.p - m.home.p)});
    const std::optional<JointVector> q = at ? joints_of(m, *at) : std::nullopt;
    if (!q || side_of(m, *at, *q) != side) return false;
  }
  return (at->p - X.p).norm() < kSame * m.size && (at->R - X.R).norm() < kSame;
}

/// Of what Newton's method finds from starts all round home, the first to which the straight way of the tool leads.
std::optional<kinematics::NewtonResult> straight_from_home(const Parallel& m, const JointVector& q, int side) {
  constexpr int kStarts = 60;
  Random random(1);
  for (int k = 0; k < kStarts; ++k) {
    const double wide = (k % 4 + 1) / 4.0;
    Pose X = m.home;
    for (double& x : X.p) x += 0.5 * wide * random.uniform(-1, 1) * m.size;
    X.R = rotation_of(wide * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1))) * X.R;
    kinematics::NewtonResult found = forward_from(m, q, X);
    if (found.converged && side_of(m, found.X_MT, q) == side && leads_there(m, found.X_MT, side)) return found;
  }
  return std::nullopt;
}

}  // namespace

kinematics::NewtonResult forward_from_home(const Parallel& m, const JointVector& q) {
  const kinematics::NewtonResult direct = forward_from(m, q, m.home);
  const std::optional<JointVector> home = joints_of(m, m.home);
  if (!home) return direct;
  // Newton's method may step over singular poses into another assembly mode: det F_X then has the other sign.
  const int side = side_of(m, m.home, *home);
  const auto in_mode = [&](const kinematics::NewtonResult& found, const JointVector& joints) {
    return found.converged && (side == 0 || side_of(m, found.X_MT, joints) == side);
  };
  if (in_mode(direct, q)) return direct;
  kinematics::NewtonResult beyond = direct;  // a pose in another mode is better than none
  for (const int steps : {4, 16, 64}) {
    Pose at = m.home;
    for (int k = 1; k <= steps; ++k) {
      const JointVector joints = *home + (q - *home) * (double(k) / steps);
      const kinematics::NewtonResult next = forward_from(m, joints, at);
      if (k == steps && in_mode(next, q)) return next;
      if (k == steps && !beyond.converged) beyond = next;
      if (!in_mode(next, joints)) break;
      at = next.X_MT;
    }
  }
  // The straight way of the joints may lead over a singular pose where another way does not.
  return side == 0 ? beyond : straight_from_home(m, q, side).value_or(beyond);
}

Pose forward(const Parallel& m, const JointVector& q) {
  return forward_from_home(m, q).X_MT;
}

std::vector<Pose> poses_by_search(const Parallel& m, const JointVector& q, int starts) {
  constexpr double kSame = 1e-6;
  std::vector<Pose> out;
  const auto add = [&](const kinematics::NewtonResult& found) {
    if (!found.converged) return;
    const bool known = std::any_of(out.begin(), out.end(), [&](const Pose& X) {
      return (X.p - found.X_MT.p).norm() < kSame * m.size && (X.R - found.X_MT.R).norm() < kSame;
    });
    if (!known) out.push_back(found.X_MT);
  };
  add(forward_from_home(m, q));
  double reach = m.size;
  for (int j = 0; j < joint_count(m); ++j) {
    const ParallelLeg& leg = driven_leg(m, j);
    reach = std::max(reach, leg.reference + leg.arm);
  }
  Random random(1);
  for (int k = 0; k < starts; ++k) {
    Pose X = m.home;
    for (double& x : X.p) x += random.uniform(-1, 1) * 2 * reach;
    X.R = rotation_abc(random.uniform(-1, 1) * std::numbers::pi, random.uniform(-0.5, 0.5) * std::numbers::pi,
                       random.uniform(-1, 1) * std::numbers::pi);
    add(forward_from(m, q, X));
  }
  if (out.size() > 1) {
    std::stable_sort(out.begin() + 1, out.end(), [](const Pose& a, const Pose& b) { return a.p.z() > b.p.z(); });
  }
  return out;
}

std::optional<SixLegs> plain_six_legs(const Parallel& m, const JointVector& q) {
  if (m.legs.size() != kLegs || !m.constraints.empty() || m.idle_turn) return std::nullopt;
  SixLegs out;
  int drive = 0;
  for (std::size_t i = 0; i < m.legs.size(); ++i) {
    const ParallelLeg& leg = m.legs[i];
    if (leg.ring || !leg.still.isZero(0)) return std::nullopt;
    const double reading = leg.driven() ? q[drive++] : 0.0;
    out.anchor[i] = leg_anchor(leg, reading);
    out.end[i] = leg.platform - m.tool;
    out.length[i] = leg.rod + (leg.drive == LegDrive::strut ? reading : 0.0);
  }
  return out;
}

JacobianMatrix jacobian(const Parallel& m, const Pose& X, const JointVector& q) {
  ByJoints B;
  EquationRows rows = closure_rows(m, X, q, &B);
  kinematics::hold_constraints(m, rows.A, B);
  JacobianMatrix J(6, B.cols());
  J = -kinematics::ClosureSolver(rows.A).solve_columns(B);
  return J;
}

Eigen::Matrix<double, 6, Eigen::Dynamic> leg_columns(const Parallel& m, const Pose& X, const JointVector& q) {
  const EquationRows rows = closure_rows(m, X, q);
  const auto n = static_cast<int>(rows.F.size());
  const auto legs = static_cast<int>(m.legs.size());
  // A leg that becomes longer by dl changes its equation by -l dl / reference.
  Eigen::VectorXd by_length(legs), gives = Eigen::VectorXd::Zero(n);
  for (int i = 0, drive = 0; i < legs; ++i) {
    const ParallelLeg& leg = m.legs[static_cast<std::size_t>(i)];
    const double reading = leg.driven() ? q[drive++] : 0.0;
    by_length[i] = (leg.rod + (leg.drive == LegDrive::strut ? reading : 0.0)) / leg.reference;
    gives[i] = by_length[i] * by_length[i] * leg.compliance;
  }
  Eigen::VectorXd root = Eigen::VectorXd::Ones(n);
  const double least = 1e-6 * gives.maxCoeff();
  if (n > 6 && least > 0) root = gives.cwiseMax(least).cwiseInverse().cwiseSqrt();
  const Eigen::MatrixXd held =
      (root.asDiagonal() * Eigen::MatrixXd(rows.A)).completeOrthogonalDecomposition().pseudoInverse() *
      root.asDiagonal();
  return held.leftCols(legs) * by_length.asDiagonal();
}

}  // namespace polypod::machine
