// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Shows: a machine of the catalogue, all branches of its inverse kinematics at a pose, and how far the tool tip gives
// way there under a force. The commands `polypod ik` and `polypod compliance` say the same.
// Build, with Polypod installed under PREFIX:
//   cmake -S examples/cpp -B build/examples -DCMAKE_PREFIX_PATH=PREFIX && cmake --build build/examples
#include <cstdio>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/statics/compliance.hpp"

int main() {
  using namespace polypod;
  namespace u = units;

  // What may fail returns a Result: the value, or an error with an id, a place and a hint.
  const auto machine = machine::load("lola50");
  if (!machine) {
    std::fprintf(stderr, "%s\n", to_string(machine.error()).c_str());
    return 1;
  }

  // The library works in m and rad. The task says which coordinates a pose prescribes: here x, y, z, A, B.
  const Pose X_MT = kinematics::pose_of(kinematics::task(*machine),
                                        {u::from_mm(0), u::from_mm(-1300), u::from_mm(0), u::from_deg(10), 0});

  // An unreachable pose is no error: the list of solutions is then empty, and `reason` says why.
  const kinematics::InverseResult inverse = kinematics::inverse(*machine, X_MT);
  for (const kinematics::Solution& s : inverse.solutions) {
    std::printf("%-30s", kinematics::branch_name(*machine, s.branch).c_str());
    for (const double q : s.joints) std::printf(" %9.4f", u::to_deg(q));
    std::printf(" deg  %s\n", s.violations == 0 ? "within all limits" : "breaks a limit");
  }

  // The compliance of the joints, carried to the tool tip in the first solution within all limits.
  const statics::Compliance compliance = statics::compliance_at(*machine, X_MT);
  if (!compliance.reachable) {
    std::fprintf(stderr, "the machine cannot take this pose: %s\n", compliance.reason.c_str());
    return 1;
  }
  const Mat3 C = compliance.linear() * u::kUmPerMetre;
  for (int i = 0; i < 3; ++i) std::printf("compliance %8.4f %8.4f %8.4f um/N\n", C(i, 0), C(i, 1), C(i, 2));
  const Vec3 force(0, 0, 100);  // N, along z of the machine
  const Vec3 d = compliance.displacement(force);
  std::printf("100 N along z move the tool tip by %.1f, %.1f, %.1f um\n", u::to_um(d.x()), u::to_um(d.y()),
              u::to_um(d.z()));
  return 0;
}
