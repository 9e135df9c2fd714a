// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A program of somebody else that uses Polypod as a library: where is the robot, what does a program do, what does a
// cut push with.
#include <cmath>
#include <cstdio>

#include "polypod/core/units.hpp"
#include "polypod/cutting/force.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/program.hpp"
#include "polypod/kinematics/any_machine.hpp"

int main() {
  using namespace polypod;
  namespace u = units;

  const auto machine = machine::load("lola50");
  if (!machine) {
    std::fprintf(stderr, "%s\n", to_string(machine.error()).c_str());
    return 1;
  }
  const Pose target = kinematics::pose_of(kinematics::task(*machine), {0, u::from_mm(-1300), 0, 0, 0});
  const auto inverse = kinematics::inverse(*machine, target);
  const auto* solution = inverse.reachable();
  if (solution == nullptr) return 1;
  const auto forward = kinematics::forward(*machine, solution->joints);
  const double error = (forward.poses.front().p - target.p).norm();
  constexpr double kRounding = 1e-9;  // m: nine digits of a reach of about a metre
  if (!(error < kRounding)) return 1;

  const auto program = gcode::parse("G21 G90 G94\nG1 X10 F600\nM2\n", "consumer.ngc");
  if (!program) return 1;
  const auto moves = gcode::interpret(*program);
  if (!moves || moves->moves.size() != 1 || std::abs(moves->moves[0].end.x() - u::from_mm(10)) > kRounding) return 1;

  cutting::Cutter cutter;
  cutter.diameter = u::from_mm(8);
  cutter.teeth = 3;
  cutter.length = u::from_mm(20);
  cutting::Material material;
  material.ktc = u::from_N_per_mm2(700);
  const auto slot = cutting::straight_engagement(cutter, cutting::CutSide::slot, cutter.diameter, u::from_mm(2));
  const Vec3 force = cutting::mean_force(cutter, material, slot, u::from_mm(0.05));
  // With K_tc alone the mean of a slot is normal to the feed: N_z a K_tc s_z / 4.
  constexpr double kClosedForm = 3 * 2e-3 * 700e6 * 0.05e-3 / 4;
  constexpr double kForceTolerance = 1e-6;  // N
  if (std::abs(std::abs(force.y()) - kClosedForm) > kForceTolerance || std::abs(force.x()) > kForceTolerance) return 1;

  std::printf("consumer: joints of lola50 found, %d move, %.1f N\n", static_cast<int>(moves->moves.size()),
              force.norm());
  return 0;
}
