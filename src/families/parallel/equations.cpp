// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/parallel/equations.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "settle.hpp"

namespace polypod::machine {
namespace {

using Row = Eigen::Matrix<double, 1, 6>;
constexpr double kTurn = 2 * std::numbers::pi;

/// Collects equations.
class Rows {
 public:
  explicit Rows(EquationRows& out) : out_(out) {
    out_.F.resize(kMaxEquations);
    out_.A.resize(kMaxEquations, 6);
  }
  ~Rows() {
    out_.F.conservativeResize(count_);
    out_.A.conservativeResize(count_, 6);
  }
  Rows(const Rows&) = delete;
  Rows& operator=(const Rows&) = delete;
  void add(double F, const Vec3& linear, const Vec3& angular) {
    if (count_ == kMaxEquations) return;
    out_.F[count_] = F;
    out_.A.row(count_++) << linear.transpose(), angular.transpose();
  }
  [[nodiscard]] int count() const { return count_; }

 private:
  EquationRows& out_;
  int count_ = 0;
};

/// The base joint from a ring in P: along its axis, out of it.
struct OnRing {
  double h = 0, rho = 0;
  Vec3 across = Vec3::Zero();
};
OnRing on_ring(const Parallel& m, const LegRing& ring, const Vec3& base, const Pose& X) {
  const Vec3 d = X.R.transpose() * (base - X.p) - (ring.center - m.tool);
  OnRing out;
  out.h = ring.axis.dot(d);
  out.across = d - out.h * ring.axis;
  out.rho = out.across.norm();
  return out;
}

/// (length^2 - l^2) / (2 reference) of a leg from `anchor`; returns y, the vector along the leg at its anchor.
Vec3 add_leg(Rows& rows, const Parallel& m, const ParallelLeg& leg, const Vec3& anchor, double l, const Pose& X) {
  const double scale = 1 / leg.reference;
  if (leg.ring) {
    const OnRing on = on_ring(m, *leg.ring, anchor, X);
    const double off = on.rho - leg.ring->radius;
    const Vec3 g = (on.rho > 0 ? Vec3(off / on.rho * on.across) : Vec3(Vec3::Zero())) + on.h * leg.ring->axis;
    const Vec3 G = -scale * (X.R * g), u = anchor - X.p;
    rows.add(0.5 * scale * (off * off + on.h * on.h - l * l), G, u.cross(G));
    return -(X.R * g);
  }
  const Vec3 arm = X.R * (leg.platform - m.tool), y = X.p + arm + leg.still - anchor;
  rows.add(0.5 * scale * (y.squaredNorm() - l * l), scale * y, scale * arm.cross(y));
  return y;
}

void add_constraint(Rows& rows, const Parallel& m, const PlatformConstraint& c, const Pose& X) {
  switch (c.kind) {
    case ConstraintKind::plane: {
      const Vec3 arm = X.R * (c.platform - m.tool);
      rows.add(c.base_axis.dot(X.p + arm - c.base), c.base_axis, arm.cross(c.base_axis));
      return;
    }
    case ConstraintKind::platform_plane: {
      const Vec3 u = c.base - X.p, normal = X.R * c.platform_axis;
      rows.add(normal.dot(u) - c.platform_axis.dot(c.platform - m.tool), -normal, normal.cross(u));
      return;
    }
    case ConstraintKind::line: {
      const Vec3 u = c.base - X.p, d = X.R.transpose() * u - (c.platform - m.tool);
      for (const Vec3& e : across(c.platform_axis)) {
        const Vec3 E = -(X.R * e);
        rows.add(e.dot(d), E, u.cross(E));
      }
      return;
    }
    case ConstraintKind::square: {
      const Vec3 b = X.R * c.platform_axis;
      rows.add(m.size * c.base_axis.dot(b), Vec3::Zero(), m.size * b.cross(c.base_axis));
      return;
    }
    case ConstraintKind::orientation: {
      const Mat3 M = X.R * m.home.R.transpose();
      const Mat3 D = 0.5 * m.size * (M.trace() * Mat3::Identity() - M);
      for (int k = 0; k < 3; ++k) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        rows.add(0.5 * m.size * (M(j, i) - M(i, j)), Vec3::Zero(), D.row(k).transpose());
      }
      return;
    }
  }
}

void add_idle_turn(Rows& rows, const Parallel& m, const Pose& X) {
  const double c = std::cos(m.home_angles.z()), s = std::sin(m.home_angles.z());
  rows.add(m.size * (X.R(1, 0) * c - X.R(0, 0) * s), Vec3::Zero(),
           m.size * Vec3(-X.R(2, 0) * c, -X.R(2, 0) * s, X.R(0, 0) * c + X.R(1, 0) * s));
}

/// The derivative of the anchor by q.
Vec3 anchor_rate(const ParallelLeg& leg, double q) {
  if (leg.drive == LegDrive::rail) return leg.rail;
  const double t = q + leg.zero_offset;
  return leg.arm * (std::cos(t) * leg.axis.cross(leg.zero) - std::sin(t) * leg.zero);
}

struct Settling {
  Pose X;
  bool converged = false;
  double turned = 0, moved = 0;  ///< from the start
};

/// Farther than this from its start a pose is taken for another assembly mode: rad, and shares of the machine's size.
constexpr double kNear = 0.35;

using Tall = Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMaxEquations + 6, 6>;

/// The x of A x = b, by least squares where there are more than six rows or those are nearly dependent.
Vec6 solved(const Tall& A, const Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxEquations + 6, 1>& b) {
  constexpr double kDependent = 1e-8;
  if (A.rows() == 6) {
    const Eigen::PartialPivLU<Eigen::Matrix<double, 6, 6>> lu(A);
    const Vec6 pivots = lu.matrixLU().diagonal().cwiseAbs();
    if (pivots.minCoeff() > kDependent * pivots.maxCoeff()) return lu.solve(Vec6(b));
  }
  return A.colPivHouseholderQr().solve(b);
}

/// Newton's method on what the task prescribes and the passive equations. It gives up where a step ends so far from
/// `start` (`farthest`, a share of the machine's size) that it does not come back. A step far shorter than the one
/// before and shorter than `enough` is the last: what remains is about its square.
Settling settle_from(const Parallel& m, const Pose& target, const Pose& start, double enough = 1e-8,
                     double farthest = 3 * kNear) {
  constexpr int kSteps = 30;
  constexpr double kLongest = 0.5, kDone = 1e-14, kSquares = 0.05;
  const double least_trace = 1 + 2 * std::cos(3 * kNear);
  double before = 0;
  Settling out{prescribed(m.task, target, start)};
  const Pose first = out.X;
  const auto T = task_rows(m.task, target, m.size);
  for (int k = 0; k < kSteps; ++k) {
    const EquationRows rows = passive_rows(m, out.X);
    const int n = static_cast<int>(rows.F.size());
    Tall A(n + m.task.size(), 6);
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxEquations + 6, 1> F(n + m.task.size());
    A << rows.A, T;
    F << rows.F, -(T * pose_error(m.task, target, out.X));
    A.rightCols<3>() /= m.size;
    Vec6 step = -solved(A, F);
    step.tail<3>() /= m.size;
    if (!step.allFinite()) return out;
    const double turn = step.tail<3>().norm(), length = step.head<3>().norm();
    const double way = length / (m.size * (farthest > 3 * kNear ? farthest : 1));
    const double share = std::min(1.0, kLongest / std::max({turn, way, 1e-300}));
    out.X.p += share * step.head<3>();
    out.X.R = rotation_of(share * step.tail<3>()) * out.X.R;
    const double size = std::max(length / m.size, turn);
    if (share == 1 && size < kDone * (1 + target.p.norm() / m.size)) break;
    if (share == 1 && k > 3 && size < 1e-11) break;
    if (share == 1 && size < enough && size < kSquares * before) break;
    before = size;
    if ((out.X.p - first.p).norm() > farthest * m.size || (out.X.R.array() * first.R.array()).sum() < least_trace) {
      return out;
    }
  }
  out.X = prescribed(m.task, target, out.X);
  out.turned = rotation_vector(out.X.R * first.R.transpose()).norm();
  out.moved = (out.X.p - first.p).norm();
  out.converged = passive_rows(m, out.X).F.cwiseAbs().maxCoeff() < 0.01 * enough * (m.size + target.p.norm());
  return out;
}

/// Not another assembly mode.
bool is_near(const Parallel& m, const Settling& s) {
  return s.converged && s.turned < kNear && s.moved < kNear * m.size;
}

/// The determinant of the passive equations and of what the task prescribes, by the motions of the platform: 0 where
/// the constraints are singular, so that its sign stays that of home as long as the assembly mode does. 0 as well where
/// there are more equations than freedoms. (The rates of the angles have 1 / cos B, which angles_abc keeps above 0.)
double side_of_constraints(const Parallel& m, const Pose& X) {
  const EquationRows rows = passive_rows(m, X);
  if (rows.F.size() + m.task.size() != 6) return 0;
  Eigen::Matrix<double, 6, 6> A;
  A << rows.A, task_rows(m.task, X, m.size);
  A.rightCols<3>() /= m.size;
  return A.determinant();
}

/// Between two poses, `share` of the way in each coordinate of the task (of angles along the shortest way).
Pose between(const Parallel& m, const Pose& target, double share) {
  Pose out = target;
  out.p = m.home.p + share * (target.p - m.home.p);
  Vec3 to = m.task.names_axis() ? Vec3(angles_ab(target.R.col(2))[0], angles_ab(target.R.col(2))[1], 0)
                                : angles_abc(target.R);
  // The same orientation has two triples of angles: that which is nearer in the coordinates of the task.
  const auto far = [&](const Vec3& angles) {
    double farthest = 0;
    for (int k = 0; k < 3; ++k)
      if (m.task.holds(static_cast<Coordinate>(3 + k)))
        farthest = std::max(farthest, std::abs(std::remainder(angles[k] - m.home_angles[k], kTurn)));
    return farthest;
  };
  const Vec3 half(kTurn / 2 + to.x(), kTurn / 2 - to.y(), kTurn / 2 + to.z());
  if (!m.task.names_axis() && far(half) < far(to)) to = half;
  Vec3 abc = m.home_angles;
  for (int k = 0; k < 3; ++k) abc[k] += share * std::remainder(to[k] - m.home_angles[k], kTurn);
  out.R = rotation_abc(abc[0], abc[1], abc[2]);
  return out;
}

}  // namespace

std::array<Vec3, 2> across(const Vec3& axis) {
  const Vec3 first = axis.cross(std::abs(axis.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY()).normalized();
  return {first, axis.cross(first)};
}

EquationRows passive_rows(const Parallel& m, const Pose& X) {
  EquationRows out;
  {
    Rows rows(out);
    for (const ParallelLeg& leg : m.legs)
      if (!leg.driven()) add_leg(rows, m, leg, leg.base, leg.rod, X);
    for (const PlatformConstraint& c : m.constraints) add_constraint(rows, m, c, X);
    if (m.idle_turn) add_idle_turn(rows, m, X);
  }
  return out;
}

EquationRows closure_rows(const Parallel& m, const Pose& X, const JointVector& q,
                          Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxEquations, kMaxJoints>* B) {
  EquationRows out;
  {
    Rows rows(out);
    if (B != nullptr) B->setZero(kMaxEquations, static_cast<Eigen::Index>(m.driven.size()));
    int drive = 0;
    for (const ParallelLeg& leg : m.legs) {
      const bool strut = leg.drive == LegDrive::strut;
      const double reading = leg.driven() ? q[drive] : 0.0, l = strut ? reading + leg.rod : leg.rod;
      const int row = rows.count();
      const Vec3 y = add_leg(rows, m, leg, leg_anchor(leg, reading), l, X);
      if (leg.driven() && B != nullptr) {
        (*B)(row, drive) = -(strut ? l : y.dot(anchor_rate(leg, reading))) / leg.reference;
      }
      drive += leg.driven() ? 1 : 0;
    }
    for (const PlatformConstraint& c : m.constraints) add_constraint(rows, m, c, X);
    if (m.idle_turn) add_idle_turn(rows, m, X);
    if (B != nullptr) B->conservativeResize(rows.count(), Eigen::NoChange);
  }
  return out;
}

Vec3 leg_anchor(const ParallelLeg& leg, double q) {
  const double t = q + leg.zero_offset;
  if (leg.drive == LegDrive::rail) return leg.base + t * leg.rail;
  if (leg.drive != LegDrive::crank) return leg.base;
  return leg.base + leg.arm * (std::cos(t) * leg.zero + std::sin(t) * leg.axis.cross(leg.zero));
}

Vec3 leg_end(const Parallel& m, const ParallelLeg& leg, const Pose& X) {
  if (!leg.ring) return X * Vec3(leg.platform - m.tool) + leg.still;
  const OnRing on = on_ring(m, *leg.ring, leg.base, X);
  const Vec3 out = on.rho > 0 ? Vec3(on.across / on.rho) : across(leg.ring->axis)[0];
  return X * Vec3(leg.ring->center - m.tool + leg.ring->radius * out);
}

LegRoots leg_roots(const Parallel& m, const ParallelLeg& leg, const Pose& X) {
  const Vec3 y = leg_end(m, leg, X) - leg.base;
  if (!leg.two_roots()) {
    const double q = y.norm() - (leg.drive == LegDrive::strut ? leg.rod : 0.0);
    return {q, q, 0};
  }
  if (leg.drive == LegDrive::rail) {
    const double along = leg.rail.dot(y), under = leg.rod * leg.rod - (y - along * leg.rail).squaredNorm();
    const double half = std::sqrt(std::max(0.0, under));
    return {along - half - leg.zero_offset, along + half - leg.zero_offset, under};
  }
  // |y - arm u|^2 = rod^2: u . (r, s) = alpha / arm, (r, s) the part of y in the plane of the arm.
  const double r = y.dot(leg.zero), s = y.dot(leg.axis.cross(leg.zero)), D2 = r * r + s * s;
  const double alpha = 0.5 * (y.squaredNorm() + leg.arm * leg.arm - leg.rod * leg.rod);
  const double under = leg.arm * leg.arm * D2 - alpha * alpha, beta = std::sqrt(std::max(0.0, under));
  const double middle = 0.5 * (leg.range.min + leg.range.max);
  const auto angle = [&](double side) {
    const double q = std::atan2(alpha * s - side * r, alpha * r + side * s) - leg.zero_offset;
    return q - kTurn * std::round((q - middle) / kTurn);
  };
  return {angle(beta), angle(-beta), D2 > 0 ? under / D2 : -1.0};
}

std::optional<Pose> settled(const Parallel& m, const Pose& target) {
  const double small = 1e-11 * (m.size + target.p.norm());
  if (m.task.size() == 6) return target;
  if (const ClosureVector F = passive_rows(m, target).F; F.size() == 0 || F.cwiseAbs().maxCoeff() < small)
    return target;
  const double side = side_of_constraints(m, m.home);
  // On the other side lies what is beyond a singular pose of the constraints.
  const auto near = [&](const Settling& s) { return is_near(m, s) && side_of_constraints(m, s.X) * side >= 0; };
  const Settling direct = settle_from(m, target, m.home);
  if (near(direct)) return direct.X;
  // Along the way from home, in steps that halve where Newton's method leaves the assembly mode and grow behind it.
  constexpr double kFirstStep = 0.25, kLeastStep = 1.0 / 64, kOnTheWay = 1e-3;
  Pose at = m.home;
  double gone = 0, step = kFirstStep;
  while (step >= kLeastStep) {
    const double share = std::min(1.0, gone + step);
    const Settling next =
        share == 1 ? settle_from(m, target, at) : settle_from(m, between(m, target, share), at, kOnTheWay);
    if (!near(next)) {
      step /= 2;
      continue;
    }
    if (share == 1) return next.X;
    at = next.X;
    gone = share;
    step = std::min(2 * step, kFirstStep);
  }
  return std::nullopt;
}

std::optional<Pose> closed_home(const Parallel& m) {
  if (const auto X = settled(m, m.home)) return X;
  // Coordinates that follow may be off by a tool that is longer than the platform is wide.
  double far = m.size;
  for (const ParallelLeg& leg : m.legs) far = std::max(far, (leg_end(m, leg, m.home) - leg.base).norm());
  const Settling found = settle_from(m, m.home, m.home, 1e-8, far / m.size);
  return found.converged && found.turned < kNear && found.moved < far ? std::optional<Pose>(found.X) : std::nullopt;
}

Parallel with_tip_at(const Parallel& m, const Vec3& v) {
  Parallel out = m;
  static_cast<TipLimits&>(out) = {};
  out.tool += v;
  out.home.p = m.home * v;
  out.home_given.head<3>() = out.home.p;
  return out;
}

std::optional<Pose> settled_near(const Parallel& m, const Pose& target, const Pose& start) {
  if (m.task.size() == 6) return target;
  const Settling found = settle_from(m, target, start);
  return is_near(m, found) ? std::optional(found.X) : std::nullopt;
}

}  // namespace polypod::machine
