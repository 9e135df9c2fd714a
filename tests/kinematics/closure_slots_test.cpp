// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Derivatives of closures by parameters that share slots are those of each parameter by itself.
#include "polypod/kinematics/closure_slots.hpp"

#include <gtest/gtest.h>

#include "polypod/core/random.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::kinematics {
namespace {

TEST(ParameterSlots, GiveTheDerivativesOfEachParameter) {
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    SCOPED_TRACE(entry.name);
    const machine::AnyMachine any = *machine::load(std::string(entry.name));
    std::visit(
        [](const auto& m) {
          Random random(3);
          const std::vector<double> nominal = nominal_parameters(m);
          const Pose home = kinematics::home_pose(machine::AnyMachine(m)).value_or(Pose{});
          std::vector<double> q;
          for (int i = 0; i < joint_count(m); ++i) {
            const machine::JointRange range = joint_range(m, i);
            q.push_back(0.5 * (range.min + range.max));
          }
          const ParameterSlots slots = parameter_slots(m, home, q, nominal);
          EXPECT_LE(slots.count, nominal.size());
          for (int k = 0; k < 20; ++k) {
            Pose X = home;
            X.p += 0.1 * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
            X.R = rotation_of(Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1))) * X.R;
            std::vector<double> p = nominal, at = q;
            for (double& x : p) x += 1e-3 * random.uniform(-1, 1);
            for (double& x : at) x += 0.1 * random.uniform(-1, 1);
            EXPECT_EQ(closure_by_parameters(m, X, at, p, slots), closure_by_parameters(m, X, at, p)) << k;
          }
        },
        any);
  }
}

// Struts share: 7 figures a leg and the tool's.
TEST(ParameterSlots, AStrutHexapodTakesTwoPassesForEight) {
  const auto m = *machine::load("hexapod-strut");
  const auto& hexapod = std::get<machine::StrutHexapod>(m);
  const std::vector<double> q(6, 0.07);
  const auto slots = parameter_slots(hexapod, *kinematics::home_pose(m), q, nominal_parameters(hexapod));
  EXPECT_GT(nominal_parameters(hexapod).size(), 42U);
  EXPECT_LE(slots.count, 12U);
}

}  // namespace
}  // namespace polypod::kinematics
