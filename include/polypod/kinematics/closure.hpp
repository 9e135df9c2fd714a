// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What follows from a machine's closure F(X, q, p) = 0 alone, for every family.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "polypod/kinematics/closure_solver.hpp"
#include "polypod/kinematics/concept.hpp"

namespace polypod::kinematics {

/// The nominal values of the parameters p, SI.
template <Machine M>
std::vector<double> nominal_parameters(const M& m) {
  if constexpr (requires { parameter_values(m); }) return parameter_values(m);
  std::vector<double> p;
  for (const Parameter& parameter : parameters(m)) p.push_back(parameter.value);
  return p;
}

/// The rules that the parameters p keep among themselves (|u| = 1 of a direction), as values that are 0 where they
/// hold: parameter_rules of the family, none where it has no such function. Where p breaks one, with_parameters makes
/// another machine of it than its closure speaks of.
template <class M, class T>
std::vector<T> rules_of(const M& m, std::span<const T> p) {
  if constexpr (requires { parameter_rules(m, p); }) {
    return parameter_rules(m, p);
  } else {
    return {};
  }
}

/// How far the closure is from 0: its largest |F_i| with the nominal parameters, m (or the closure's unit).
template <Machine M>
double closure_residual(const M& m, const Pose& X, const JointVector& q) {
  const std::vector<double> p = nominal_parameters(m);
  const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
  return closure(m, X, joints, std::span<const double>(p)).cwiseAbs().maxCoeff();
}

/// The limits below -kLimitSlack with the nominal parameters.
template <Machine M>
LimitBits violations_of_limits(const M& m, const Pose& X, const JointVector& q) {
  const std::vector<double> p = nominal_parameters(m);
  const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
  std::vector<double> g = limits(m, X, joints, std::span<const double>(p));
  for (double& value : g) value += kLimitSlack;
  return violated(g);
}

/// X moved by a small twist in its first order: p + v, (1 + [w]x) R, on dual numbers (dual parts of v and w: unit).
inline PoseT<Dual> dual_pose(const Pose& X) {
  PoseT<Dual> out = X.cast<Dual>();
  Vector3<Dual> w;
  for (int i = 0; i < 3; ++i) {
    out.p[i].v[i] = 1;
    w[i] = Dual(0.0);
    w[i].v[3 + i] = 1;
  }
  const Matrix3<Dual> turned = skew(w) * out.R;
  out.R += turned;
  return out;
}

/// A = F_X: the closure against [translation; rotation vector] of X, both in M (k x 6).
/// Singular of type 2 (the tool moves with the joints locked) where A loses rank.
template <Machine M>
ClosureMatrix closure_by_pose(const M& m, const Pose& X, std::span<const double> q, std::span<const double> p) {
  const std::vector<Dual> q_dual(q.begin(), q.end()), p_dual(p.begin(), p.end());
  const ClosureVectorT<Dual> F = closure(m, dual_pose(X), std::span<const Dual>(q_dual), std::span<const Dual>(p_dual));
  ClosureMatrix A(F.size(), 6);
  for (int i = 0; i < F.size(); ++i) A.row(i) = F[i].v;
  return A;
}

namespace closure_detail {
/// Derivatives of the closure against one of its arguments, six columns a pass; `write(columns, k)` takes the results.
template <Machine M, class Write>
void by_argument(const M& m, const Pose& X, std::span<const double> q, std::span<const double> p, bool by_parameter,
                 Write&& write) {
  const PoseT<Dual> X_dual = X.cast<Dual>();
  std::vector<Dual> q_dual(q.begin(), q.end()), p_dual(p.begin(), p.end());
  std::vector<Dual>& varied = by_parameter ? p_dual : q_dual;
  for (std::size_t first = 0; first < varied.size(); first += 6) {
    const std::size_t count = std::min<std::size_t>(6, varied.size() - first);
    for (std::size_t j = 0; j < count; ++j) varied[first + j].v[static_cast<int>(j)] = 1;
    write(closure(m, X_dual, std::span<const Dual>(q_dual), std::span<const Dual>(p_dual)), first, count);
    for (std::size_t j = 0; j < count; ++j) varied[first + j].v.setZero();
  }
}
}  // namespace closure_detail

/// B = F_q (k x joints). Singular of type 1 (the joints move while the tool is at rest) where B loses rank.
template <Machine M>
ClosureMatrix closure_by_joints(const M& m, const Pose& X, std::span<const double> q, std::span<const double> p) {
  ClosureMatrix B;
  closure_detail::by_argument(m, X, q, p, false, [&](const auto& F, std::size_t first, std::size_t count) {
    if (first == 0) B.resize(F.size(), static_cast<Eigen::Index>(q.size()));
    for (int i = 0; i < F.size(); ++i)
      for (std::size_t j = 0; j < count; ++j) B(i, first + j) = F[i].v[static_cast<int>(j)];
  });
  return B;
}

/// F_p (k x parameters): the first-order effect of an error of a parameter; dX = -A^-1 F_p dp.
template <Machine M>
Eigen::MatrixXd closure_by_parameters(const M& m, const Pose& X, std::span<const double> q, std::span<const double> p) {
  Eigen::MatrixXd F_p;
  closure_detail::by_argument(m, X, q, p, true, [&](const auto& F, std::size_t first, std::size_t count) {
    if (first == 0) F_p.resize(F.size(), static_cast<Eigen::Index>(p.size()));
    for (int i = 0; i < F.size(); ++i)
      for (std::size_t j = 0; j < count; ++j) F_p(i, first + j) = F[i].v[static_cast<int>(j)];
  });
  return F_p;
}

/// J = -A^-1 B: the twist of the tool in M, [linear; angular], per joint speed (6 x joints), at a solution of the
/// closure. Where A is singular the least-squares solution of least norm is returned (the uncontrolled motion is left
/// out). Cost: three closures on dual numbers and a 6 x 6 factorisation.
template <Machine M>
JacobianMatrix jacobian_by_closure(const M& m, const Pose& X, std::span<const double> q) {
  const std::vector<double> p = nominal_parameters(m);
  const ClosureMatrix A = closure_by_pose(m, X, q, p);
  const ClosureMatrix B = closure_by_joints(m, X, q, p);
  JacobianMatrix J(6, B.cols());
  J = -ClosureSolver(A).solve_columns(B);
  return J;
}

struct NewtonOptions {
  int max_iterations = 100;
  double tolerance = 1e-13;  ///< of the last step: m, and rad times the length below
  double length = 1.0;       ///< m, what an angle of one radian counts for
};

struct NewtonResult {
  Pose X_MT;
  double residual = 0;  ///< largest |F_i|
  int iterations = 0;
  bool converged = false;
};

/// Forward kinematics of any machine with the parameters p: Newton on F(X, q, p) = 0 with the update on the rotation
/// group,
///   [v; w] = -A^-1 F, p <- p + v, R <- exp([w]x) R,
/// from the seed pose. Converges quadratically to the assembly mode round the seed; `converged`
/// is false near a singularity of type 2 or where no mode exists.
template <Machine M>
NewtonResult forward_by_closure(const M& m, std::span<const double> q, std::span<const double> p, const Pose& seed,
                                const NewtonOptions& options = {}) {
  NewtonResult out{seed, 0, 0, false};
  for (; out.iterations < options.max_iterations && !out.converged; ++out.iterations) {
    const ClosureVector F = closure(m, out.X_MT, q, p);
    const ClosureMatrix A = closure_by_pose(m, out.X_MT, q, p);
    Vec6 step = -ClosureSolver(A).solve(F);
    if (!step.allFinite()) break;
    const double turn = step.tail<3>().norm();
    if (turn > 0.5) step *= 0.5 / turn;  // stay where the rotation vector is a good chart
    out.X_MT.p += step.head<3>();
    out.X_MT.R = rotation_of(step.tail<3>()) * out.X_MT.R;
    out.converged = std::max(step.head<3>().norm(), options.length * step.tail<3>().norm()) <= options.tolerance;
  }
  const ClosureVector F = closure(m, out.X_MT, q, p);
  out.residual = F.cwiseAbs().maxCoeff();
  out.converged = out.converged && out.residual < 1e-9 * (1 + out.X_MT.p.norm());
  return out;
}

/// The same with the nominal parameters.
template <Machine M>
NewtonResult forward_by_closure(const M& m, std::span<const double> q, const Pose& seed,
                                const NewtonOptions& options = {}) {
  const std::vector<double> p = nominal_parameters(m);
  return forward_by_closure(m, q, std::span<const double>(p), seed, options);
}

struct DampedOptions {
  int max_iterations = 200;
  int seeds = 24;            ///< starts: the middle of the ranges, then a fixed low-discrepancy sequence inside them
  double tolerance = 1e-11;  ///< m, and rad times `length`
  double length = 1.0;       ///< m, what an angle of one radian counts for
  /// One search from these joints in the place of several starts.
  std::optional<JointVector> start{};
};

namespace closure_detail {
using machine::pose_error;
using machine::task_rows;

inline double halton(int index, int base) {
  double f = 1, r = 0;
  for (int i = index; i > 0; i /= base) {
    f /= base;
    r += f * (i % base);
  }
  return r;
}

/// Joints to begin a search with: the middle of the ranges, then points of a Halton sequence inside them.
template <Machine M>
JointVector start_joints(const M& m, int seed) {
  static constexpr int kPrimes[machine::kMaxJoints] = {2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37};
  JointVector q(joint_count(m));
  for (int i = 0; i < q.size(); ++i) {
    const machine::JointRange range = joint_range(m, i);
    const double share = seed == 0 ? 0.5 : halton(seed, kPrimes[i]);
    q[i] = range.min + share * (range.max - range.min);
  }
  return q;
}

/// The same joints with revolute ones in the turn that lies in their ranges if there is one, else next to zero.
template <Machine M>
JointVector in_their_turn(const M& m, JointVector q) {
  constexpr double kTurn = 2 * std::numbers::pi;
  for (int i = 0; i < q.size(); ++i) {
    if (joint_kind(m, i) != JointKind::revolute) continue;
    const machine::JointRange range = joint_range(m, i);
    q[i] -= kTurn * std::floor((q[i] + std::numbers::pi) / kTurn);
    const double down = std::ceil((q[i] - range.max) / kTurn), up = std::ceil((range.min - q[i]) / kTurn);
    if (down > 0 && q[i] - kTurn * down >= range.min) q[i] -= kTurn * down;
    if (up > 0 && q[i] + kTurn * up <= range.max) q[i] += kTurn * up;
  }
  return q;
}

/// How far each joint lies beyond its range, with the sign of the way back to a point inside it by `inside` of its
/// width; 0 for joints in their range.
template <Machine M>
JointVector way_back(const M& m, const JointVector& q, double inside) {
  JointVector out = JointVector::Zero(q.size());
  for (int i = 0; i < q.size(); ++i) {
    const machine::JointRange range = joint_range(m, i);
    const double margin = inside * (range.max - range.min);
    if (q[i] > range.max) out[i] = range.max - margin - q[i];
    if (q[i] < range.min) out[i] = range.min + margin - q[i];
  }
  return out;
}

/// Moves joints that lie beyond their ranges inside while the tool stays where it is, as far as the joints that it
/// leaves free allow (the kernel of S J): steps along that kernel, each brought back to the target by Gauss-Newton.
/// `error_of(q)` is what is missing of the target (S rows), `jacobian_of(q)` is S J. The first order of the way back
/// falls with each step or the search ends. Returns `q` itself where no joint is beyond its range.
template <Machine M, class ErrorOf, class JacobianOf>
JointVector moved_inside(const M& m, JointVector q, double tolerance, ErrorOf&& error_of, JacobianOf&& jacobian_of) {
  constexpr int kMostSteps = 40, kMostCorrections = 12, kMostHalvings = 4;
  constexpr double kInside = 1e-3, kSmallest = 1e-9;
  JointVector back = way_back(m, q, kInside);
  for (int step = 0; step < kMostSteps && !back.isZero(0); ++step) {
    const auto J = jacobian_of(q);
    const JointVector along = back - J.completeOrthogonalDecomposition().solve((J * back).eval());
    if (!(along.norm() > kSmallest)) break;
    bool better = false;
    for (int halving = 0; halving < kMostHalvings && !better; ++halving) {
      JointVector next = q + along * std::ldexp(1.0, -halving);
      auto e = error_of(next);
      for (int k = 0; k < kMostCorrections && e.norm() > tolerance; ++k) {
        next += jacobian_of(next).completeOrthogonalDecomposition().solve(e);
        e = error_of(next);
      }
      const JointVector left = way_back(m, next, kInside);
      better = e.norm() <= tolerance && left.norm() < back.norm();
      if (better) {
        q = next;
        back = left;
      }
    }
    if (!better) break;
  }
  return q;
}

/// Adds the joints that a search found, in the turn that lies in their ranges if there is one; false if they are known.
template <Machine M>
bool add_solution(const M& m, const Pose& X, JointVector q, std::span<const double> p, InverseResult& out) {
  constexpr double kSame = 1e-6;
  q = in_their_turn(m, std::move(q));
  const bool known = std::any_of(out.solutions.begin(), out.solutions.end(),
                                 [&](const Solution& s) { return (s.joints - q).cwiseAbs().maxCoeff() < kSame; });
  if (known) return false;
  Solution solution;
  solution.joints = q;
  solution.violations = violated(limits(m, X, std::span<const double>(q.data(), q.size()), p));
  out.solutions.push_back(std::move(solution));
  return true;
}

/// Puts the solutions in the order of their distance from the middle of the ranges; says why there is none.
template <Machine M>
void finish(const M& m, double best, int starts, InverseResult& out) {
  const auto from_middle = [&](const Solution& s) {
    double square = 0;
    for (int i = 0; i < s.joints.size(); ++i) {
      const machine::JointRange range = joint_range(m, i);
      const double width = range.max - range.min;
      if (width > 0) square += std::pow((s.joints[i] - 0.5 * (range.min + range.max)) / width, 2);
    }
    return square;
  };
  std::stable_sort(out.solutions.begin(), out.solutions.end(),
                   [&](const Solution& a, const Solution& b) { return from_middle(a) < from_middle(b); });
  for (std::size_t i = 0; i < out.solutions.size(); ++i) out.solutions[i].branch = kNumericBranch + unsigned(i);
  out.converged = !out.solutions.empty();
  if (!out.converged) {
    out.reason = "the numeric search did not converge from " + std::to_string(starts) +
                 " starts; the closest came within " + std::to_string(best * 1e3) + " mm of the target";
  }
}
}  // namespace closure_detail

/// Inverse kinematics of any machine whose forward kinematics `forward_of(q) -> Pose` and Jacobian `jacobian_of(X, q)`
/// are at hand: Levenberg-Marquardt from several starts inside the joint ranges, solutions that agree to 1e-6 are one.
/// They come in the order of their distance from the middle of the ranges, so that neighbouring poses begin with the
/// same posture where they can.
/// The result is not proven complete. `converged` is false if no start reached the target: then the pose is either out
/// of reach or the search failed, and `reason` gives the smallest remaining error.
template <Machine M, class Forward, class JacobianOf>
InverseResult inverse_damped(const M& m, const Pose& target, Forward&& forward_of, JacobianOf&& jacobian_of,
                             const DampedOptions& options = {}) {
  const Task what = task(m);
  const std::vector<double> p = nominal_parameters(m);
  const auto S = closure_detail::task_rows(what, target, options.length);
  InverseResult out;
  double best = std::numeric_limits<double>::infinity();
  for (int seed = 0; seed < (options.start ? 1 : options.seeds); ++seed) {
    JointVector q = options.start.value_or(closure_detail::start_joints(m, seed));
    double damping = 1e-3;
    Pose X = forward_of(q);
    auto error = [&](const Pose& at) { return (S * closure_detail::pose_error(what, target, at)).eval(); };
    auto e = error(X);
    for (int k = 0; k < options.max_iterations && e.norm() > options.tolerance; ++k) {
      const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, machine::kMaxJoints> J = S * jacobian_of(X, q);
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6> H = J * J.transpose();
      H.diagonal().array() += damping * damping;
      const JointVector step = J.transpose() * H.ldlt().solve(e);
      const JointVector q_new = q + step;
      const Pose X_new = forward_of(q_new);
      const auto e_new = error(X_new);
      if (e_new.norm() < e.norm()) {
        q = q_new;
        X = X_new;
        e = e_new;
        damping = std::max(1e-9, 0.3 * damping);
      } else {
        damping *= 4;
        if (damping > 1e6) break;
      }
    }
    best = std::min(best, e.norm());
    if (e.norm() > options.tolerance * 100) continue;
    if (q.size() > S.rows()) {
      using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, machine::kMaxJoints>;
      q = closure_detail::moved_inside(
          m, closure_detail::in_their_turn(m, q), options.tolerance * 100,
          [&](const JointVector& at) { return error(forward_of(at)); },
          [&](const JointVector& at) { return Rows(S * jacobian_of(forward_of(at), at)); });
    }
    closure_detail::add_solution(m, target, q, p, out);
  }
  closure_detail::finish(m, best, options.seeds, out);
  return out;
}

/// Inverse kinematics of any machine from its closure alone: Levenberg-Marquardt on
///   F(X, q, p) = 0 and what the task prescribes of X = that of the target,
/// in the twist of X (6) and the joints together, so that coordinates that no pose prescribes follow. Starts: the
/// target with the joints in the middle of their ranges, then points of a Halton sequence inside them, until eight
/// starts one after the other find nothing new. Solutions that agree to 1e-6 are one; they come in the order of their
/// distance from the middle of the ranges. Not proven complete; `converged` is false if no start closes.
/// Cost: some 20 us a start.
template <Machine M>
InverseResult inverse_by_closure(const M& m, const Pose& target, const DampedOptions& options = {}) {
  constexpr int kNothingNew = 8;
  constexpr double kGoodEnough = 100, kMostDamping = 1e6;
  const int n = joint_count(m);
  const Task what = task(m);
  const std::vector<double> p = nominal_parameters(m);
  const auto S = closure_detail::task_rows(what, target, options.length);
  constexpr int kMost = machine::kMaxEquations + 6;
  using Unknowns = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost, 1>;
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMost, kMost>;
  InverseResult out;
  double best = std::numeric_limits<double>::infinity();
  int nothing_new = 0;
  for (int seed = 0; seed < (options.start ? 1 : options.seeds) && nothing_new < kNothingNew; ++seed) {
    JointVector q = options.start.value_or(closure_detail::start_joints(m, seed));
    Pose X = target;
    const auto residual = [&](const Pose& at, const JointVector& joints) {
      const ClosureVector F =
          closure(m, at, std::span<const double>(joints.data(), joints.size()), std::span<const double>(p));
      Unknowns r(F.size() + S.rows());
      r << F, -(S * closure_detail::pose_error(what, target, at));
      return r;
    };
    double damping = 1e-3;
    Unknowns r = residual(X, q);
    for (int k = 0; k < options.max_iterations && r.norm() > options.tolerance; ++k) {
      const std::span<const double> joints(q.data(), q.size());
      Square J = Square::Zero(r.size(), 6 + n);
      const Eigen::Index equations = r.size() - S.rows();
      J.topLeftCorner(equations, 6) = closure_by_pose(m, X, joints, std::span<const double>(p));
      J.topRightCorner(equations, n) = closure_by_joints(m, X, joints, std::span<const double>(p));
      J.bottomLeftCorner(S.rows(), 6) = S;
      Square H = J.transpose() * J;
      H.diagonal().array() += damping * damping;
      const Unknowns step = -H.ldlt().solve(J.transpose() * r);
      Pose X_new = X;
      X_new.p += step.head<3>();
      X_new.R = rotation_of(step.segment<3>(3)) * X.R;
      const JointVector q_new = q + step.tail(n);
      const Unknowns r_new = residual(X_new, q_new);
      if (r_new.norm() < r.norm()) {
        q = q_new;
        X = X_new;
        r = r_new;
        damping = std::max(1e-9, 0.1 * damping);
      } else {
        damping *= 4;
        if (!(damping < kMostDamping)) break;
      }
    }
    best = std::min(best, r.norm());
    ++nothing_new;
    if (!(r.norm() <= options.tolerance * kGoodEnough)) continue;
    if (closure_detail::add_solution(m, X, q, p, out)) nothing_new = 0;
  }
  closure_detail::finish(m, best, options.seeds, out);
  return out;
}

}  // namespace polypod::kinematics
