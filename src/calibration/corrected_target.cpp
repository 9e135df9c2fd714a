// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <limits>

#include "model.hpp"

namespace polypod::calibration {

CorrectedTarget corrected_target(const AnyMachine& nominal, const AnyMachine& real, const Pose& X_MT) {
  constexpr int kMost = 50;
  constexpr double kEnough = 1e-10;  // m, and rad: far below a controller's resolution
  CorrectedTarget out;
  out.command = X_MT;
  const machine::Task task = kinematics::task(nominal);
  const auto rows = kinematics::closure_detail::task_rows(task, X_MT, 1.0);
  double last = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kMost; ++k) {
    const kinematics::InverseResult inverse = kinematics::inverse(nominal, out.command);
    const kinematics::Solution* s = inverse.reachable();
    if (s == nullptr) {
      out.reason = inverse.solutions.empty() ? inverse.reason : "a limit of the nominal machine";
      return out;
    }
    out.joints = s->joints;
    const kinematics::ForwardResult at = kinematics::forward(real, s->joints);
    if (at.poses.empty()) {
      out.reason = "the real machine does not assemble there";
      return out;
    }
    const Vec6 error = kinematics::closure_detail::pose_error(task, X_MT, at.poses.front());
    out.rest = (rows * error).norm();
    out.reached = out.rest < kEnough;
    if (out.reached) return out;
    if (!(out.rest < 2 * last)) break;
    last = out.rest;
    out.command.p += error.head<3>();
    out.command.R = rotation_of(error.tail<3>()) * out.command.R;
  }
  out.reason = "the correction does not converge";
  return out;
}

}  // namespace polypod::calibration
