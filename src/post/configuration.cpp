// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The machine tools that an arm can be programmed as (SLAV 2.2.1).
#include <fmt/format.h>

#include <algorithm>

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/post/plan.hpp"

namespace polypod::post {
namespace {

using machine::SerialArm;
using machine::Task;

constexpr std::size_t kAxes = 6;

tl::unexpected<Error> refuse(const machine::AnyMachine& machine, const std::string& name, const std::string& why,
                             const std::string& hint) {
  return fail("PO120", fmt::format("{} cannot be programmed as {}: {}", machine::name_of(machine), name, why), {},
              hint);
}

/// The arm with one joint locked at 0 that moves the tool's axis and the tip alone.
Result<Configuration> five_axes(const machine::AnyMachine& given, const std::string& name, std::size_t locked) {
  const auto* arm = std::get_if<SerialArm>(&given);
  if (arm == nullptr) return refuse(given, name, "it is no arm", "use --config auto");
  const bool has = locked <= arm->dh.size();
  const bool is_locked = has && arm->dh[locked - 1].locked.has_value();
  if (arm->free_joints() == 5 && arm->task.names_axis()) {
    // Five rows are an arm whose sixth joint is not there at all.
    if (is_locked || (locked == kAxes && arm->dh.size() == 5)) return Configuration{name, given, given, Rotary::ab};
    return refuse(given, name, fmt::format("joint {} is not the one that its machine file locks", locked),
                  "give a machine file with six free joints, or use --config auto");
  }
  if (arm->free_joints() != static_cast<int>(kAxes) || arm->dh.size() != kAxes) {
    return refuse(given, name, fmt::format("it has {} free joints", arm->free_joints()),
                  "give a machine file with six joints");
  }
  SerialArm five = *arm;
  machine::DhRow& row = five.dh[locked - 1];
  if (row.range.min > 0 || row.range.max < 0) {
    return refuse(given, name, fmt::format("0 is not within the limits of joint {}", locked),
                  fmt::format("lock it elsewhere: --set locked.{}=...", locked));
  }
  row.locked = 0;
  five.task = Task::axis;
  return Configuration{name, machine::AnyMachine(std::move(five)), given, Rotary::ab};
}

Result<Configuration> six_axes(const machine::AnyMachine& given, const std::string& name, Rotary rotary) {
  const auto* arm = std::get_if<SerialArm>(&given);
  if (arm == nullptr) return refuse(given, name, "it is no arm", "use --config auto");
  if (arm->free_joints() < static_cast<int>(kAxes)) {
    return refuse(given, name, fmt::format("it has {} free joints, and C needs six", arm->free_joints()),
                  "give a machine file with six free joints, or use --config auto");
  }
  SerialArm six = *arm;
  six.task = Task::pose;
  return Configuration{name, machine::AnyMachine(std::move(six)), given, rotary};
}

Result<Configuration> by_task(const machine::AnyMachine& given) {
  const Task task = kinematics::task(given);
  if (!task.places()) {
    return fail("PO121", fmt::format("{} does not prescribe x, y and z", machine::name_of(given)), {},
                "a part program needs a machine whose task holds them");
  }
  using machine::Coordinate;
  const auto* arm = std::get_if<SerialArm>(&given);
  if (task.names_axis()) {
    const bool fourth = arm != nullptr && arm->dh.size() >= 4 && arm->dh[3].locked;
    return Configuration{arm == nullptr ? "ab" : fourth ? "horizontal-ab" : "vertical-ab", given, given, Rotary::ab};
  }
  if (task.holds(Coordinate::a) && task.holds(Coordinate::b) && task.holds(Coordinate::c)) {
    return Configuration{arm != nullptr ? "six" : "abc", given, given, Rotary::abc};
  }
  if (task.holds(Coordinate::a) && task.holds(Coordinate::c)) return Configuration{"ac", given, given, Rotary::ac};
  if (!task.turns() || !(task.holds(Coordinate::a) || task.holds(Coordinate::b))) {
    return Configuration{"xyz", given, given, Rotary::none};
  }
  return fail("PO121", fmt::format("{} tilts its tool about one axis alone", machine::name_of(given)), {},
              "use a machine with A and B, with A, B and C, or without them");
}

}  // namespace

Result<Configuration> configure(const machine::AnyMachine& machine, const std::string& name) {
  if (name == "auto") return by_task(machine);
  if (name == "vertical-ab") return five_axes(machine, name, 6);
  if (name == "horizontal-ab") return five_axes(machine, name, 4);
  if (name == "vertical-ac") return six_axes(machine, name, Rotary::ac);
  if (name == "six") return six_axes(machine, name, Rotary::abc);
  return fail("PO120", fmt::format("--config {}: there is no such configuration", name), {},
              "give auto, vertical-ab, horizontal-ab, vertical-ac or six");
}

}  // namespace polypod::post
