// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/own/kinematics.hpp"

#include <fmt/format.h>

namespace polypod::machine {
namespace {

using kinematics::InverseResult;
using kinematics::NewtonResult;

std::span<const double> span_of(const JointVector& q) {
  return {q.data(), static_cast<std::size_t>(q.size())};
}

JointVector middle_of_ranges(const Own& m) {
  return kinematics::closure_detail::start_joints(m, 0);
}

}  // namespace

LimitTable limit_table(const Own& m) {
  if (auto own = m.questions->table_of_limits()) return *own;
  const Pose X = home_pose(m);
  const JointVector q = middle_of_ranges(m);
  const std::vector<double> p = kinematics::nominal_parameters(m);
  const std::size_t count = limits(m, X, span_of(q), std::span<const double>(p)).size();
  return LimitTable(count, LimitInfo{"limit"});
}

Pose home_pose(const Own& m) {
  if (const auto own = m.questions->home()) return *own;
  const JointVector q = middle_of_ranges(m);
  if (const auto closed = m.questions->pose_of_joints(q)) return *closed;
  const NewtonResult found = kinematics::forward_by_closure(m, span_of(q), Pose{});
  return found.converged ? found.X_MT : Pose{};
}

NewtonResult forward_from_home(const Own& m, const JointVector& q) {
  if (const auto closed = m.questions->pose_of_joints(q)) {
    return {*closed, kinematics::closure_residual(m, *closed, q), 0, true};
  }
  constexpr int kStages = 16;
  const Pose home = home_pose(m);
  NewtonResult out = kinematics::forward_by_closure(m, span_of(q), home);
  if (out.converged) return out;
  const auto own = m.questions->joints_of_pose(home);
  const JointVector begin = own && !own->solutions.empty() ? own->solutions.front().joints : middle_of_ranges(m);
  Pose X = home;
  for (int k = 1; k <= kStages; ++k) {
    const JointVector between = begin + (double(k) / kStages) * (q - begin);
    out = kinematics::forward_by_closure(m, span_of(between), X);
    if (!out.converged) return out;
    X = out.X_MT;
  }
  return out;
}
Pose forward(const Own& m, const JointVector& q) {
  return forward_from_home(m, q).X_MT;
}

InverseResult inverse(const Own& m, const Pose& X_MT) {
  if (auto closed = m.questions->joints_of_pose(X_MT)) return *std::move(closed);
  return kinematics::inverse_by_closure(m, X_MT);
}
bool has_closed_inverse(const Own& m) {
  return m.questions->joints_of_pose(home_pose(m)).has_value();
}
InverseResult inverse_from(const Own& m, const Pose& X_MT, const JointVector& start) {
  kinematics::DampedOptions options;
  options.start = start;
  return kinematics::inverse_by_closure(m, X_MT, options);
}

std::string branch_name(const Own& m, unsigned branch) {
  if (branch >= kinematics::kNumericBranch) return fmt::format("posture {}", branch - kinematics::kNumericBranch + 1);
  return m.questions->branch_called(branch).value_or("only");
}

Pose settled(const Own& m, const Pose& X_MT, const JointVector& q) {
  const NewtonResult found = kinematics::forward_by_closure(m, span_of(q), X_MT);
  return found.converged ? found.X_MT : X_MT;
}
std::optional<Pose> settled(const Own& m, const Pose& X_MT) {
  const InverseResult found = inverse(m, X_MT);
  if (found.solutions.empty()) return {};
  return settled(m, X_MT, found.solutions.front().joints);
}

JacobianMatrix jacobian(const Own& m, const Pose& X_MT, const JointVector& q) {
  const Pose X = settled(m, X_MT, q);
  if (auto closed = m.questions->speeds(X, q)) return *std::move(closed);
  return kinematics::jacobian_by_closure(m, X, span_of(q));
}

}  // namespace polypod::machine
