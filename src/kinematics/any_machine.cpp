// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/any_machine.hpp"
#include "../families/turns.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/rates.hpp"

namespace polypod::kinematics {

int joint_count(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return joint_count(m); }, machine);
}
JointKind joint_kind(const AnyMachine& machine, int joint) {
  return std::visit([&](const auto& m) { return joint_kind(m, joint); }, machine);
}
machine::JointRange joint_range(const AnyMachine& machine, int joint) {
  return std::visit([&](const auto& m) { return joint_range(m, joint); }, machine);
}
Task task(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return task(m); }, machine);
}
bool takes_any_posture(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        return requires {
          m.kAnyPosture;
        };
      },
      machine);
}
int degrees_of_freedom(const AnyMachine& machine) {
  return std::min(joint_count(machine), coordinate_count(task(machine)));
}
std::vector<Parameter> parameters(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return parameters(m); }, machine);
}
std::string limit_name(const AnyMachine& machine, int limit) {
  return std::visit([&](const auto& m) { return limit_name(m, limit); }, machine);
}
machine::LimitTable limit_table(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return limit_table(m); }, machine);
}
std::vector<std::string> limit_names(const AnyMachine& machine, LimitBits bits) {
  std::vector<std::string> names;
  for (int i = 0; i < 64; ++i)
    if ((bits >> i & 1) != 0) names.push_back(limit_name(machine, i));
  return names;
}

namespace {
/// A fourth drive fits the first three to about this, m; else the four hold no pose.
constexpr double kFits = 1e-6;

template <class M>
ForwardResult delta_poses(const M& m, const JointVector& q) {
  ForwardResult out;
  const machine::DeltaPoses both = both_poses(m, q);
  if (!both.real) {
    out.reason = "no real assembly: the rods of the first three chains do not meet in one point";
    return out;
  }
  for (const Vec3& X : {both.machine, both.other}) {
    const Pose pose{Mat3::Identity(), X};
    const double residual = closure_residual(m, pose, q);
    if (m.arms > 3 && residual > 2 * kFits * m.rod_length[3]) continue;
    out.poses.push_back(pose);
    out.residuals.push_back(residual);
  }
  if (out.poses.empty()) {
    out.reason = fmt::format(
        "the joints cannot close: with the first three chains where they meet, rod 4 is {:.3g} mm {} for its drive",
        units::to_mm(std::abs(both.mismatch)), both.mismatch > 0 ? "too short" : "too long");
  }
  return out;
}

/// Of a machine whose modes are searched.
template <class M>
ForwardResult searched_poses(const M& m, const JointVector& q) {
  ForwardResult out;
  out.complete = false;
  out.poses = poses_by_search(m, q);
  for (const Pose& X : out.poses) out.residuals.push_back(closure_residual(m, X, q));
  if (out.poses.empty()) {
    out.reason =
        "the joints do not close: Newton's method found no pose from home nor from 2000 further starts; that "
        "there is none is not proven";
  }
  return out;
}

/// Why Newton's way from home ends at no pose: what is known about the poses that these six legs have.
std::string why_no_mode(const machine::SixLegs& legs) {
  const machine::AssemblyModes modes = machine::assembly_modes(legs);
  if (modes.proof == machine::ModesProof::no_length) return "no real assembly: a leg has no length";
  if (!modes.poses.empty()) {
    return fmt::format(
        "Newton's method did not converge from home, though {} poses exist (`polypod fk --all` lists them)",
        modes.poses.size());
  }
  return modes.complete() ? "no real assembly: it is proven that the legs meet at no pose"
                          : "Newton's method did not converge from home or from further starts; that there is no pose "
                            "is not proven";
}
}  // namespace

ForwardResult forward_all(const AnyMachine& machine, const JointVector& q) {
  return std::visit(
      [&](const auto& m) {
        if constexpr (requires { both_poses(m, q); }) return delta_poses(m, q);
        if constexpr (requires { poses_by_search(m, q); }) return searched_poses(m, q);
        return forward(machine, q);
      },
      machine);
}

std::optional<machine::Mobility> mobility(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) -> std::optional<machine::Mobility> {
        if constexpr (std::is_base_of_v<machine::Delta, std::decay_t<decltype(m)>>) return mobility(m);
        return {};
      },
      machine);
}

namespace {
/// Why these are no joints of the machine; empty if they are.
std::string no_joints(const AnyMachine& machine, const JointVector& q) {
  if (q.size() != joint_count(machine)) {
    return fmt::format("{} joints are given, the machine has {}", q.size(), joint_count(machine));
  }
  return q.allFinite() ? "" : "a joint is not a finite number";
}
}  // namespace

ForwardResult forward(const AnyMachine& machine, const JointVector& q) {
  if (std::string reason = no_joints(machine, q); !reason.empty()) {
    ForwardResult out;
    out.reason = std::move(reason);
    return out;
  }
  return std::visit(
      [&](const auto& m) {
        ForwardResult out;
        if constexpr (requires { forward_from_home(m, q); }) {
          const NewtonResult mode = forward_from_home(m, q);
          out.complete = false;
          if (mode.converged) {
            out.poses.push_back(mode.X_MT);
            out.residuals.push_back(mode.residual);
          } else {
            out.reason = fmt::format("the joints do not close from home: the equations stay off by {:.3g} mm",
                                     units::to_mm(mode.residual));
          }
          return out;
        }
        if constexpr (requires { six_legs(m, q); }) {
          // A parallel machine may have further assembly modes, or none that is real.
          const NewtonResult mode = newton_on_legs(six_legs(m, q), forward(m, q));
          out.complete = false;
          if (mode.converged) {
            out.poses.push_back(mode.X_MT);
            out.residuals.push_back(mode.residual);
          } else {
            out.reason = "Newton's method did not converge from home";
          }
          return out;
        }
        if constexpr (requires { both_poses(m, q); }) {
          out = delta_poses(m, q);
          out.complete = out.poses.size() < 2;
          out.poses.resize(std::min<std::size_t>(1, out.poses.size()));
          out.residuals.resize(out.poses.size());
          return out;
        }
        out.poses.push_back(forward(m, q));
        out.residuals.push_back(closure_residual(m, out.poses.back(), q));
        return out;
      },
      machine);
}

std::string why_no_pose(const AnyMachine& machine, const JointVector& q, const ForwardResult& result) {
  return std::visit(
      [&](const auto& m) -> std::string {
        if constexpr (requires { six_legs(m, q); }) return why_no_mode(six_legs(m, q));
        return result.reason;
      },
      machine);
}

std::optional<machine::AssemblyModes> assembly_modes(const AnyMachine& machine, const JointVector& q) {
  return std::visit(
      [&](const auto& m) -> std::optional<machine::AssemblyModes> {
        if constexpr (requires { six_legs(m, q); }) return machine::assembly_modes(six_legs(m, q));
        if constexpr (requires { plain_six_legs(m, q); }) {
          if (const auto legs = plain_six_legs(m, q)) return machine::assembly_modes(*legs);
        }
        return {};
      },
      machine);
}

LimitBits violations(const AnyMachine& machine, const Pose& X_MT, const JointVector& q) {
  return std::visit([&](const auto& m) { return violations_of_limits(m, X_MT, q); }, machine);
}

namespace {
/// No solution, for this reason.
InverseResult no_solution(std::string reason) {
  InverseResult out;
  out.reason = std::move(reason);
  return out;
}
bool is_finite(const Pose& X) {
  return X.p.allFinite() && X.R.allFinite();
}
}  // namespace

InverseResult inverse(const AnyMachine& machine, const Pose& X_MT) {
  if (!is_finite(X_MT)) return no_solution("the pose does not consist of finite numbers");
  return std::visit([&](const auto& m) { return inverse(m, X_MT); }, machine);
}

InverseResult inverse_near(const AnyMachine& machine, const Pose& X_MT, const JointVector& last) {
  if (!is_finite(X_MT)) return inverse(machine, X_MT);
  if (std::string reason = no_joints(machine, last); !reason.empty()) return no_solution(std::move(reason));
  InverseResult out = std::visit(
      [&](const auto& m) -> InverseResult {
        if constexpr (requires { inverse_near(m, X_MT, last); }) {
          return inverse_near(m, X_MT, last);
        } else if constexpr (requires { inverse_from(m, X_MT, last); }) {
          if (!has_closed_inverse(m)) return inverse_from(m, X_MT, last);
        }
        return {};
      },
      machine);
  if (out.reachable() == nullptr) out = inverse(machine, X_MT);
  if (out.solutions.empty()) return out;
  constexpr double kTurn = 2 * std::numbers::pi;
  const auto alone = [&](int joint) {
    return std::visit(
        [&](const auto& m) {
          if constexpr (requires { turns_alone(m, joint); }) return turns_alone(m, joint);
          return true;
        },
        machine);
  };
  for (int i = 0; i < static_cast<int>(last.size()); ++i) {
    if (joint_kind(machine, i) != JointKind::revolute || !alone(i)) continue;
    const machine::JointRange range = joint_range(machine, i);
    for (Solution& s : out.solutions) {
      const double away = last[i] - s.joints[i];
      if (std::abs(away) <= 0.5 * kTurn) continue;
      const double near = s.joints[i] + kTurn * std::round(away / kTurn);
      if (near >= range.min && near <= range.max) s.joints[i] = near;
    }
  }
  // By insertion: there are few, and often in order already.
  const auto change = [&](const Solution& s) { return (s.joints - last).cwiseAbs().maxCoeff(); };
  std::vector<double> changes;
  changes.reserve(out.solutions.size());
  for (std::size_t i = 0; i < out.solutions.size(); ++i) {
    const double mine = change(out.solutions[i]);
    const auto place = std::upper_bound(changes.begin(), changes.end(), mine) - changes.begin();
    changes.insert(changes.begin() + place, mine);
    if (const auto at = static_cast<std::ptrdiff_t>(i); place < at) {
      const auto first = out.solutions.begin();
      std::rotate(first + place, first + at, first + at + 1);
    }
  }
  return out;
}

Pose settled(const AnyMachine& machine, const Pose& X_MT, const JointVector& q) {
  return std::visit(
      [&]<class M>(const M& m) -> Pose {
        if constexpr (requires { settled(m, X_MT, q); }) {
          return settled(m, X_MT, q);
        } else if constexpr (requires { settled(m, X_MT); }) {
          return settled(m, X_MT).value_or(X_MT);
        } else if constexpr (std::is_same_v<M, machine::SerialArm>) {
          return forward(m, q);
        } else if constexpr (machine::DeltaFamily<M>) {
          return Pose{Mat3::Identity(), X_MT.p};
        } else {
          return X_MT;
        }
      },
      machine);
}

std::optional<Pose> settled(const AnyMachine& machine, const Pose& X_MT) {
  return std::visit(
      [&](const auto& m) -> std::optional<Pose> {
        if constexpr (requires { settled(m, X_MT); }) return settled(m, X_MT);
        return X_MT;
      },
      machine);
}

std::optional<Pose> home_pose(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) -> std::optional<Pose> {
        if constexpr (requires { home_pose(m); }) return home_pose(m);
        return {};
      },
      machine);
}

std::string branch_name(const AnyMachine& machine, unsigned branch) {
  return std::visit(
      [&](const auto& m) -> std::string {
        if constexpr (requires { branch_name(m, branch); }) return branch_name(m, branch);
        return "only";
      },
      machine);
}

std::string reason_of(const AnyMachine& machine, const InverseResult& result) {
  if (result.solutions.empty()) return result.reason;
  const auto best = std::min_element(
      result.solutions.begin(), result.solutions.end(),
      [](const Solution& a, const Solution& b) { return std::popcount(a.violations) < std::popcount(b.violations); });
  return fmt::format("{}", fmt::join(limit_names(machine, best->violations), ", "));
}

JacobianMatrix jacobian(const AnyMachine& machine, const Pose& X_MT, const JointVector& q) {
  return std::visit(
      [&](const auto& m) {
        if constexpr (requires { settled(m, X_MT, q); })
          return jacobian(m, X_MT, q);  // which settles it
        else if constexpr (requires { settled(m, X_MT); })
          return jacobian(m, settled(m, X_MT).value_or(X_MT), q);
        else
          return jacobian(m, X_MT, q);
      },
      machine);
}

Pose pose_of(Task task, const std::vector<double>& c) {
  Vec6 all = Vec6::Zero();
  for (int i = 0; i < task.size() && i < static_cast<int>(c.size()); ++i) {
    all[static_cast<int>(task[i])] = c[static_cast<std::size_t>(i)];
  }
  return {rotation_abc(all[3], all[4], all[5]), all.head<3>()};
}

std::vector<double> coordinates_of(Task task, const Pose& X) {
  Vec6 all = Vec6::Zero();
  all.head<3>() = X.p;
  if (task.names_axis()) {
    all.segment<2>(3) = angles_ab(X.R.col(2));
  } else if (task.turns()) {
    all.tail<3>() = angles_abc(X.R);
  }
  std::vector<double> c;
  for (int i = 0; i < task.size(); ++i) c.push_back(all[static_cast<int>(task[i])]);
  return c;
}

bool orientation_follows(const AnyMachine& machine) {
  constexpr double kTurns = 1e-6;  // rad per m
  const auto home = home_pose(machine);
  if (task(machine).turns() || !home) return false;
  const InverseResult result = inverse(machine, *home);
  if (result.solutions.empty()) return false;
  const JacobianMatrix J =
      jacobian(machine, settled(machine, *home, result.solutions[0].joints), result.solutions[0].joints);
  return J.allFinite() && J.bottomRows(3).norm() > kTurns * J.topRows(3).norm();
}

namespace {

/// A matrix of a machine's size, on the stack.
using Small = ClosureMatrix;

Small rows_of_task(Task task, const JacobianMatrix& J, const Pose& X_MT) {
  JacobianMatrix seen = J;
  if (task.names_axis()) seen.bottomRows(3) = X_MT.R.transpose() * J.bottomRows(3);
  Small out(task.size(), J.cols());
  for (int i = 0; i < task.size(); ++i) out.row(i) = seen.row(static_cast<int>(task[i]));
  return out;
}

/// The least and the largest singular value by Jacobi's rotations of the columns against each other until all are
/// square (Hestenes 1958): for small matrices as exact as Eigen's and some times as fast.
std::pair<double, double> singular_range(Small A) {
  if (A.cols() > A.rows()) A = A.transpose().eval();
  constexpr double kSquare = 1e-15;
  constexpr int kSweeps = 30;  // five are enough as a rule
  bool turned = true;
  for (int sweep = 0; turned && sweep < kSweeps; ++sweep) {
    turned = false;
    for (Eigen::Index i = 0; i < A.cols(); ++i) {
      for (Eigen::Index j = i + 1; j < A.cols(); ++j) {
        const double a = A.col(i).squaredNorm(), b = A.col(j).squaredNorm(), ab = A.col(i).dot(A.col(j));
        if (!(std::abs(ab) > kSquare * std::sqrt(a * b))) continue;
        turned = true;
        const double zeta = 0.5 * (b - a) / ab;
        const double t = (zeta < 0 ? -1 : 1) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
        const double c = 1 / std::sqrt(1 + t * t), s = c * t;
        for (Eigen::Index k = 0; k < A.rows(); ++k) {
          const double x = A(k, i), y = A(k, j);
          A(k, i) = c * x - s * y;
          A(k, j) = s * x + c * y;
        }
      }
    }
  }
  const auto norms = A.colwise().norm();
  return {norms.minCoeff(), norms.maxCoeff()};
}

/// S of a parallel machine and its L.
template <class M>
Small rates_by_twist(const M& m, const Pose& X, const JointVector& q, double& length) {
  if constexpr (requires { six_legs(m, q); }) {
    const machine::SixLegs legs = six_legs(m, q);
    Small S = machine::leg_rows(X, legs.anchor, legs.end);
    if constexpr (requires { m.rail_direction; }) {
      for (int i = 0; i < S.rows(); ++i) S.row(i) /= S.row(i).template head<3>().dot(m.rail_direction[i]);
    }
    if (length <= 0) {
      for (const Vec3& end : legs.end) length += end.norm() / machine::kLegs;
      if (length <= 0) length = 1;
    }
    S.rightCols(3) /= length;
    return S;
  }
  if constexpr (requires { m.size; }) {
    if (length <= 0) length = m.size;
  }
  if (length <= 0) length = 1;
  if constexpr (requires { jacobians(m, X.p, q); }) {
    // Of three chains A v = B dq/dt at once, unless one of the two is singular.
    constexpr double kSingular = 1e-9;
    const machine::DeltaJacobians pair = jacobians(m, X.p, q);
    const double least = pair.B.cwiseAbs().minCoeff();
    if (m.arms == 3 && least > kSingular * pair.B.cwiseAbs().maxCoeff() && std::abs(pair.determinant_A()) > kSingular) {
      return pair.B.cwiseInverse().asDiagonal() * pair.A;
    }
  }
  Small J = rows_of_task(task(m), jacobian(m, X, q), X);
  for (int i = 0; i < J.rows(); ++i)
    if (task(m).is_angle(i)) J.row(i) *= length;
  return J.completeOrthogonalDecomposition().pseudoInverse();
}

/// S of a serial arm and its L. Distance of a joint's axis from the tip: |v| / |w| of its column.
Small twist_by_rates(const machine::SerialArm& arm, const Pose& X_MT, const JacobianMatrix& J, double& length) {
  if (length <= 0) {
    int turning = 0;
    for (int i = 0; i < J.cols(); ++i) {
      const double w = J.col(i).tail<3>().norm();
      if (w < 1e-12) continue;
      length += J.col(i).head<3>().norm() / w;
      ++turning;
    }
    length = turning > 0 && length > 0 ? length / turning : 1.0;
  }
  Small S = rows_of_task(task(arm), J, X_MT);
  for (int i = 0; i < S.rows(); ++i)
    if (task(arm).is_angle(i)) S.row(i) *= length;
  return S;
}

}  // namespace

Eigen::MatrixXd task_jacobian(Task task, const JacobianMatrix& J, const Pose& X_MT) {
  return rows_of_task(task, J, X_MT);
}

RateMatrix rate_matrix(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, double length) {
  RateMatrix out;
  out.characteristic_length = std::max(length, 0.0);
  if (const auto* arm = std::get_if<machine::SerialArm>(&machine)) {
    out.serial = true;
    out.S = twist_by_rates(*arm, X_MT, machine::jacobian(*arm, X_MT, q), out.characteristic_length);
    for (int i = 0; i < out.S.rows(); ++i)
      if (task(*arm).is_angle(i)) out.scale *= out.characteristic_length;
    return out;
  }
  const Pose X = settled(machine, X_MT, q);
  out.S = std::visit([&](const auto& m) { return rates_by_twist(m, X, q, out.characteristic_length); }, machine);
  return out;
}

namespace {
/// The product of the singular values of a matrix with more rows than columns, sqrt(det(A^T A)).
double volume_of(const Small& A) {
  return std::abs(A.householderQr().matrixQR().diagonal().prod());
}
}  // namespace

Dexterity dexterity(const RateMatrix& rates) {
  const Small& S = rates.S;
  Dexterity out;
  out.characteristic_length = rates.characteristic_length;
  if (S.rows() == S.cols()) {
    out.determinant = S.determinant() / rates.scale;
    if (!rates.serial) out.determinant = std::abs(out.determinant);
  } else if (rates.serial && S.cols() > S.rows()) {
    out.determinant = volume_of(S.transpose()) / rates.scale;
  } else if (!rates.serial && S.rows() > S.cols()) {
    out.determinant = volume_of(S);
  }
  out.condition = std::numeric_limits<double>::infinity();
  if (!S.allFinite()) return out;
  const auto [least, largest] = singular_range(S);
  if (S.rows() <= S.cols() || !rates.serial) out.sigma_min = least;
  if (out.sigma_min > 0) out.condition = largest / out.sigma_min;
  return out;
}
Dexterity dexterity(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, double length) {
  return dexterity(rate_matrix(machine, X_MT, q, length));
}

}  // namespace polypod::kinematics
