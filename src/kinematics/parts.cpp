// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/parts.hpp"

#include "polypod/kinematics/families.hpp"

namespace polypod::kinematics {

std::vector<machine::Element> elements(const machine::AnyMachine& machine) {
  return std::visit([](const auto& m) { return elements(m); }, machine);
}
machine::ElementColumns element_columns(const machine::AnyMachine& machine, const machine::JointVector& q,
                                        const Pose* X_MT) {
  return std::visit([&](const auto& m) { return element_columns(m, q, X_MT); }, machine);
}
void set_compliance(machine::AnyMachine& machine, int element, double compliance) {
  std::visit([&](auto& m) { set_compliance(m, element, compliance); }, machine);
}
machine::Reach reach(const machine::AnyMachine& machine) {
  return std::visit([](const auto& m) { return reach(m); }, machine);
}
Vec3 middle_of_work(const machine::AnyMachine& machine) {
  return std::visit([](const auto& m) { return middle_of_work(m); }, machine);
}
machine::Outline outline(const machine::AnyMachine& machine, const Vec3& tip) {
  return std::visit([&](const auto& m) { return outline(m, tip); }, machine);
}
machine::Outline outline_at(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q) {
  return std::visit([&](const auto& m) { return outline_at(m, X_MT, q); }, machine);
}

bool hangs_down(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        if constexpr (requires { hangs_down(m); }) return hangs_down(m);
        return false;
      },
      machine);
}

}  // namespace polypod::kinematics
