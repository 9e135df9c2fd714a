// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "side.hpp"

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::machining {
namespace {

/// How far the parts of this kind are above z, in the mean; nothing where there are none.
std::optional<double> height_above(const machine::Outline& outline, machine::OutlinePart::Role role, double z) {
  double sum = 0, count = 0;
  for (const machine::OutlinePart& part : outline) {
    if (part.role != role) continue;
    for (const Vec3& p : part.points) {
      sum += p.z() - z;
      ++count;
    }
  }
  if (count == 0) return {};
  return sum / count;
}

}  // namespace

std::optional<std::string> note_on_side(const machine::AnyMachine& machine) {
  if (kinematics::is_serial(machine)) return {};
  using Role = machine::OutlinePart::Role;
  constexpr double kNone = 1e-6;  // m
  const Vec3 tip = kinematics::middle_of_work(machine);
  const machine::Outline outline = kinematics::outline(machine, tip);
  std::optional<double> height = height_above(outline, Role::platform, tip.z());
  if (!height || std::abs(*height) < kNone) height = height_above(outline, Role::fixed, tip.z());
  if (!height || *height > -kNone) return {};
  return "z of M points from the platform of this machine to the tool tip: Z+ of the program leads away from the "
         "platform, and Z- back to it; where Z+ shall lead to the spindle, write z of M the other way";
}

}  // namespace polypod::machining
