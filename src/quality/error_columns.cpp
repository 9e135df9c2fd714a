// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>

#include "plan.hpp"
#include "polypod/kinematics/hold_constraints.hpp"
#include "polypod/quality/survey.hpp"

namespace polypod::quality {

Vec3 heeded(machine::Task task, const Pose& X, const Vec3& w) {
  if (!task.names_axis()) return w;
  const Vec3 k = X.R.col(2);
  return w - k * k.dot(w);
}

std::shared_ptr<const Plan> Plan::for_many_poses(const AnyMachine& machine, const std::vector<Sized>& sizes) {
  auto plan = std::make_shared<Plan>(machine, sizes);
  const auto home = kinematics::home_pose(machine);
  const auto q = home && plan->parameters ? joints_at(machine, *home) : std::nullopt;
  if (!q) return plan;
  std::vector<bool> wanted(plan->nominal.size(), false);
  for (const Part& part : plan->parts) {
    if (part.rate.size() > 0) wanted.assign(wanted.size(), true);
    for (const int c : part.columns)
      if (static_cast<std::size_t>(c) < wanted.size()) wanted[static_cast<std::size_t>(c)] = true;
  }
  std::visit(
      [&](const auto& m) {
        if constexpr (!requires { parameter_columns(m, *q); }) {
          const std::span<const double> joints(q->data(), static_cast<std::size_t>(q->size()));
          auto held = kinematics::parameter_slots(m, *home, joints, plan->nominal).held;
          for (std::size_t j = 0; j < wanted.size(); ++j)
            if (!wanted[j]) held.col(static_cast<Eigen::Index>(j)) = false;
          plan->slots = kinematics::slots_of(std::move(held));
        }
      },
      machine);
  return plan;
}

Columns error_columns(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, const Plan& plan) {
  const std::vector<double>& p = plan.nominal;
  return std::visit(
      [&](const auto& m) -> Columns {
        if constexpr (requires { parameter_columns(m, q); }) {  // a chain: the tool's pose is a formula of both
          Columns E(6, static_cast<Eigen::Index>(p.size()) + q.size());
          E.leftCols(p.size()) = parameter_columns(m, q);
          E.rightCols(q.size()) = forward_jacobian(m, q).J;
          return E;
        }
        const Pose X = kinematics::settled(machine, X_MT, q);
        const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
        auto A = kinematics::closure_by_pose(m, X, joints, p);
        Eigen::MatrixXd F = Eigen::MatrixXd::Zero(A.rows(), static_cast<Eigen::Index>(p.size()) + q.size());
        if (plan.parameters) {
          F.leftCols(p.size()) = plan.slots ? kinematics::closure_by_parameters(m, X, joints, p, *plan.slots)
                                            : kinematics::closure_by_parameters(m, X, joints, p);
        }
        if (plan.joints) F.rightCols(q.size()) = kinematics::closure_by_joints(m, X, joints, p);
        if (A.rows() == 6) return -(Mat6(A).partialPivLu().solve(F));
        kinematics::hold_constraints(m, A, F);
        return -kinematics::ClosureSolver(A).solve_many(F);
      },
      machine);
}

Vec6 linear_error(const AnyMachine& machine, const Pose& X, const JointVector& q, const Plan& plan) {
  const Columns E = error_columns(machine, X, q, plan);
  Vec6 out = Vec6::Zero();
  for (const Plan::Part& part : plan.parts)
    for (const Vec6& move : moves(part, E)) out += part.size * move;
  return out;
}

Result<std::vector<Generator>> generators(const Pose& X, const Columns& E, const Plan& plan, Region region) {
  std::vector<Generator> out;
  const auto push = [&](const Vec6& twist, int element) {
    out.push_back({twist.head<3>(), heeded(plan.task, X, twist.tail<3>()), element});
  };
  for (const Plan::Part& part : plan.parts) {
    if (region == Region::box || part.columns.size() < 3) {
      for (const Vec6& move : moves(part, E)) push(part.size * move, part.element);
      continue;
    }
    // The ball's image is a segment where the three columns are multiples of one.
    int longest = part.columns[0];
    for (const int c : part.columns)
      if (E.col(c).norm() > E.col(longest).norm()) longest = c;
    const Vec6 along = E.col(longest).normalized();
    double reach = 0;
    for (const int c : part.columns) {
      const double share = along.dot(E.col(c));
      reach += share * share;
      if ((E.col(c) - share * along).norm() > 1e-9 * E.col(longest).norm()) {
        return fail("QU102",
                    fmt::format("{}: its three coordinates act in several directions, so a sphere has no exact worst "
                                "case here",
                                part.key),
                    {}, "take a box");
      }
    }
    push(part.size * std::sqrt(reach) * along, part.element);
  }
  return out;
}

}  // namespace polypod::quality
