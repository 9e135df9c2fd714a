// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "../../machine/machine_file.hpp"
#include "../../machine/parameter_list.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machine/assumed.hpp"

namespace polypod::machine {
namespace {

constexpr double kFullTurnDeg = 360;

Result<DhRow> row_from(const config::Table& table, const std::vector<DhRow>& before) {
  DhRow row;
  POLYPOD_ASSIGN(a, table.optional_number("a_mm", 0));
  POLYPOD_ASSIGN(alpha, table.optional_number("alpha_deg", 0, {-kFullTurnDeg, kFullTurnDeg}));
  POLYPOD_ASSIGN(d, table.optional_number("d_mm", 0));
  POLYPOD_ASSIGN(theta, table.optional_number("theta_offset_deg", 0, {-kFullTurnDeg, kFullTurnDeg}));
  POLYPOD_ASSIGN(sign, table.optional_number("sign", 1));
  POLYPOD_ASSIGN(kind, table.optional_text("joint", "revolute"));
  POLYPOD_ASSIGN(coupled_to, table.optional_number("coupled_to", 0));
  POLYPOD_ASSIGN(coupling, table.optional_number("coupling", 0));
  POLYPOD_TRY(table.finish());
  const auto row_number = static_cast<double>(before.size() + 1);
  if (table.has("coupled_to") || table.has("coupling")) {
    const bool known = table.has("coupled_to") && coupled_to == std::floor(coupled_to) && coupled_to >= 1 &&
                       coupled_to < row_number && table.has("coupling");
    if (!known || kind != "revolute" || before[static_cast<std::size_t>(coupled_to) - 1].kind != JointKind::revolute) {
      return fail(
          "MA148",
          fmt::format("{}: a coupled joint is revolute, `coupled_to` the number of an earlier revolute row, and "
                      "`coupling` the angle that it turns for a unit of that joint",
                      table.name()),
          table.place(), "for example coupled_to = 2, coupling = -1 in the third row");
    }
    row.coupled_back = static_cast<int>(row_number - coupled_to);
    row.coupling = coupling;
  }
  if (sign != 1 && sign != -1) {
    return fail("MA110", fmt::format("{}.sign = {:g} must be 1 or -1", table.name(), sign), table.place_of("sign"));
  }
  if (kind != "revolute" && kind != "prismatic") {
    return fail("MA111", fmt::format("{}.joint = \"{}\" must be \"revolute\" or \"prismatic\"", table.name(), kind),
                table.place_of("joint"));
  }
  row.a = units::from_mm(a);
  row.alpha = units::from_deg(alpha);
  row.d = units::from_mm(d);
  row.theta_offset = units::from_deg(theta);
  row.sign = sign;
  row.kind = kind == "revolute" ? JointKind::revolute : JointKind::prismatic;
  // Without limits: one turn each way, or 10 m.
  row.range =
      row.kind == JointKind::revolute ? JointRange{-units::from_deg(360), units::from_deg(360)} : JointRange{-10, 10};
  return row;
}

Status read_limits(const config::Table& table, SerialArm& arm) {
  POLYPOD_ASSIGN(limits, table.tables("limits"));
  if (limits.empty()) {
    arm.provenance["limits"] = kAssumedLimits;
    return {};
  }
  const bool for_all = limits.size() == arm.dh.size();
  if (!for_all && static_cast<int>(limits.size()) != arm.free_joints()) {
    return fail("MA112",
                fmt::format("limits has {} entries, but the arm has {} joints ({} of them free)", limits.size(),
                            arm.dh.size(), arm.free_joints()),
                table.place_of("limits"));
  }
  std::size_t next = 0;
  for (DhRow& row : arm.dh) {
    if (row.locked && !for_all) continue;
    const config::Table& entry = limits[next++];
    const bool turns = row.kind == JointKind::revolute;
    POLYPOD_ASSIGN(min, entry.number(turns ? "min_deg" : "min_mm"));
    POLYPOD_ASSIGN(max, entry.number(turns ? "max_deg" : "max_mm"));
    POLYPOD_ASSIGN(speed, speed_of(entry, turns));
    POLYPOD_TRY(entry.finish());
    row.speed = speed;
    if (min > max) {
      return fail("MA113", fmt::format("{}: the minimum {:g} is above the maximum {:g}", entry.name(), min, max),
                  entry.place());
    }
    row.range = turns ? JointRange{units::from_deg(min), units::from_deg(max)}
                      : JointRange{units::from_mm(min), units::from_mm(max)};
    constexpr double kSlack = 1e-9;  // rad or m
    if (row.locked && (*row.locked < row.range.min - kSlack || *row.locked > row.range.max + kSlack)) {
      return fail(
          "MA193",
          fmt::format("joint {} is locked at {:g} {}, beyond its limits {:g} and {:g}", &row - arm.dh.data() + 1,
                      turns ? units::to_deg(*row.locked) : units::to_mm(*row.locked), turns ? "deg" : "mm", min, max),
          table.place_of("locked"), "lock it within its limits, or correct these");
    }
  }
  return {};
}

Status read_compliance(const config::Table& table, SerialArm& arm) {
  if (!table.has("compliance_rad_per_Nm")) return {};
  POLYPOD_ASSIGN(values, table.numbers("compliance_rad_per_Nm", 0, {0, 1}));
  const bool for_all = values.size() == arm.dh.size();
  if (!for_all && static_cast<int>(values.size()) != arm.free_joints()) {
    return fail("MA114",
                fmt::format("compliance_rad_per_Nm has {} values, but the arm has {} joints ({} of them free)",
                            values.size(), arm.dh.size(), arm.free_joints()),
                table.place_of("compliance_rad_per_Nm"));
  }
  std::size_t next = 0;
  for (DhRow& row : arm.dh) {
    if (row.locked && !for_all) continue;
    row.compliance = values[next++];
  }
  return {};
}

Status read_locked(const config::Table& table, SerialArm& arm) {
  POLYPOD_ASSIGN(locked, table.optional_table("locked"));
  if (!locked) return {};
  for (const std::string& key : locked->keys()) {
    POLYPOD_ASSIGN(value, locked->number(key));
    const bool digits = !key.empty() && key.size() <= 2 &&
                        std::all_of(key.begin(), key.end(), [](char c) { return c >= '0' && c <= '9'; });
    const int joint = digits ? std::stoi(key) : 0;
    if (joint < 1 || joint > static_cast<int>(arm.dh.size())) {
      return fail("MA115", fmt::format("locked.{}: there is no such joint; joints are 1 to {}", key, arm.dh.size()),
                  locked->place_of(key));
    }
    DhRow& row = arm.dh[static_cast<std::size_t>(joint - 1)];
    row.locked = row.kind == JointKind::revolute ? units::from_deg(value) : units::from_mm(value);
  }
  return locked->finish();
}

}  // namespace

Task SerialArm::usual_task() const {
  const int free = free_joints();
  return free >= 6 ? Task::pose : free == 5 ? Task::axis : Task::point;
}

bool SerialArm::is_coupled() const {
  return std::any_of(dh.begin(), dh.end(), [](const DhRow& row) { return row.coupled_back > 0; });
}

int SerialArm::free_joints() const {
  return static_cast<int>(std::count_if(dh.begin(), dh.end(), [](const DhRow& row) { return !row.locked; }));
}

Result<SerialArm> SerialArm::from(const config::Table& table) {
  SerialArm arm;
  POLYPOD_TRY(read_common(table, arm.name, arm.description, arm.provenance));
  POLYPOD_ASSIGN(convention, table.optional_text("convention", "standard"));
  if (convention != "standard" && convention != "modified") {
    return fail("MA116", fmt::format("convention = \"{}\" must be \"standard\" or \"modified\"", convention),
                table.place_of("convention"));
  }
  arm.convention = convention == "standard" ? DhConvention::standard : DhConvention::modified;
  POLYPOD_ASSIGN(rows, table.tables("dh"));
  if (rows.empty() || rows.size() > static_cast<std::size_t>(kMaxJoints)) {
    return fail("MA117", fmt::format("dh has {} rows, but must have 1 to {}", rows.size(), kMaxJoints),
                table.place_of("dh"));
  }
  for (const config::Table& entry : rows) {
    POLYPOD_ASSIGN(row, row_from(entry, arm.dh));
    arm.dh.push_back(row);
  }
  POLYPOD_TRY(read_locked(table, arm));
  if (arm.free_joints() == 0) {
    return fail("MA118", "every joint is locked: the arm cannot move", table.place_of("locked"));
  }
  POLYPOD_TRY(read_limits(table, arm));
  POLYPOD_TRY(read_compliance(table, arm));
  POLYPOD_ASSIGN(base, read_frame(table, "base"));
  POLYPOD_ASSIGN(tool, read_frame(table, "tool"));
  arm.X_MB = base;
  arm.X_FT = tool;
  POLYPOD_ASSIGN(task, read_task(table, arm.usual_task()));
  arm.task = task;
  POLYPOD_TRY(table.finish());
  return arm;
}

namespace {
template <class Each>
void list_parameters(const SerialArm& arm, Each&& each) {
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    each(row.a, "mm", "dh[{}].a", i + 1);
    each(row.alpha, "deg", "dh[{}].alpha", i + 1);
    each(row.d, "mm", "dh[{}].d", i + 1);
    each(row.theta_offset, "deg", "dh[{}].theta_offset", i + 1);
  }
}
}  // namespace

std::vector<Parameter> parameters(const SerialArm& arm) {
  return named_parameters([&](auto&& each) { list_parameters(arm, each); });
}
std::vector<double> parameter_values(const SerialArm& arm) {
  return values_of([&](auto&& each) { list_parameters(arm, each); });
}

Result<SerialArm> with_parameters(const SerialArm& arm, std::span<const double> p) {
  SerialArm out = arm;
  for (std::size_t i = 0; i < out.dh.size(); ++i) {
    out.dh[i].a = p[4 * i];
    out.dh[i].alpha = p[4 * i + 1];
    out.dh[i].d = p[4 * i + 2];
    out.dh[i].theta_offset = p[4 * i + 3];
  }
  return out;
}

std::string to_toml(const SerialArm& arm) {
  std::string out = common_toml(arm.name, "serial", arm.description);
  const char* name = arm.task == Task::pose    ? "pose"
                     : arm.task == Task::axis  ? "axis"
                     : arm.task == Task::point ? "point"
                                               : nullptr;
  out += name != nullptr ? fmt::format("task = \"{}\"\n", name) : task_toml(arm.task);
  out += fmt::format("convention = \"{}\"\n\ndh = [\n",
                     arm.convention == DhConvention::standard ? "standard" : "modified");
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    out += fmt::format("  {{ a_mm = {}, alpha_deg = {}, d_mm = {}, theta_offset_deg = {}",
                       number_toml(units::to_mm(row.a)), number_toml(units::to_deg(row.alpha)),
                       number_toml(units::to_mm(row.d)), number_toml(units::to_deg(row.theta_offset)));
    if (row.sign < 0) out += ", sign = -1";
    if (row.kind == JointKind::prismatic) out += ", joint = \"prismatic\"";
    if (row.coupled_back > 0)
      out += fmt::format(", coupled_to = {}, coupling = {}", i + 1 - static_cast<std::size_t>(row.coupled_back),
                         number_toml(row.coupling));
    out += " },\n";
  }
  out += "]\n\n";
  std::string locked, limits, compliance;
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    const bool turns = row.kind == JointKind::revolute;
    const auto user = [&](double x) { return number_toml(turns ? units::to_deg(x) : units::to_mm(x)); };
    if (row.locked) locked += fmt::format("{}{} = {}", locked.empty() ? "" : ", ", i + 1, user(*row.locked));
    const char* unit = turns ? "deg" : "mm";
    const std::string speed =
        row.speed > 0 ? fmt::format(", speed_{}_per_s = {}", unit, user(row.speed)) : std::string();
    limits += fmt::format("  {{ min_{0} = {1}, max_{0} = {2}{3} }},\n", unit, user(row.range.min), user(row.range.max),
                          speed);
    compliance += fmt::format("{}{}", i == 0 ? "" : ", ", number_toml(row.compliance));
  }
  if (!locked.empty()) out += fmt::format("locked = {{ {} }}\n", locked);
  out += frame_toml("base", arm.X_MB) + frame_toml("tool", arm.X_FT);
  out += fmt::format("\nlimits = [\n{}]\n\ncompliance_rad_per_Nm = [{}]\n", limits, compliance);
  return out + provenance_toml(arm.provenance);
}

}  // namespace polypod::machine
