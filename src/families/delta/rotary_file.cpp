// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/delta/rotary_machine.hpp"

#include <fmt/format.h>

#include <cmath>

#include "../../machine/machine_file.hpp"
#include "file.hpp"
#include "polypod/core/units.hpp"
#include "polypod/geometry/trilateration.hpp"

namespace polypod::machine {
namespace {

Status read_arm(const config::Table& table, bool symmetric, RotaryDelta& m) {
  if (!symmetric) {
    POLYPOD_ASSIGN(arm, table.optional_table("arm"));
    if (!arm) return {};
    POLYPOD_ASSIGN(diameter, arm->optional_number("diameter_mm", 0, config::kNotNegative));
    m.bodies.arm_diameter = units::from_mm(diameter);
    return arm->finish();
  }
  POLYPOD_ASSIGN(arm, table.table("arm"));
  POLYPOD_ASSIGN(length, arm.number("length_mm", config::kPositive));
  POLYPOD_ASSIGN(diameter, arm.optional_number("diameter_mm", 0, config::kNotNegative));
  POLYPOD_TRY(read_directions(arm, m, *m.symmetric));
  POLYPOD_TRY(arm.finish());
  m.bodies.arm_diameter = units::from_mm(diameter);
  m.arm_length.fill(units::from_mm(length));
  for (int i = 0; i < m.arms; ++i) {
    m.base_joint[i] = m.symmetric->base_radius * m.outward[i];
    m.platform_joint[i] = m.symmetric->platform_radius * m.outward[i];
  }
  return {};
}

Status read_chains(const std::vector<config::Table>& chains, RotaryDelta& m) {
  for (int i = 0; i < m.arms && !chains.empty(); ++i) {
    const config::Table& chain = chains[static_cast<std::size_t>(i)];
    POLYPOD_ASSIGN(base, chain.numbers("base_mm", 3));
    POLYPOD_ASSIGN(length, chain.number("arm_mm", config::kPositive));
    POLYPOD_ASSIGN(zero, chain.optional_number("zero_deg", 0));
    POLYPOD_TRY(chain.finish());
    m.base_joint[i] = {units::from_mm(base[0]), units::from_mm(base[1]), units::from_mm(base[2])};
    m.arm_length[i] = units::from_mm(length);
    m.zero[i] = units::from_deg(zero);
  }
  return {};
}

/// Home: all drives at the angle nearest the middle of their range at which the rods close with every elbow outside.
bool find_home(RotaryDelta& m) {
  const double middle = 0.5 * (m.range.min + m.range.max), half = 0.5 * (m.range.max - m.range.min);
  constexpr int kSteps = 64;
  for (int k = 0; k <= 2 * kSteps; ++k) {
    const double angle = middle + (k % 2 == 0 ? 0.5 : -0.5) * ((k + 1) / 2) / kSteps * 2 * half;
    std::array<Vec3, 3> center;
    PerArm<Vec3> elbow;
    for (int i = 0; i < m.arms; ++i) {
      const double theta = angle + m.zero[i];
      elbow[i] = m.base_joint[i] + m.arm_length[i] * (std::sin(theta) * m.outward[i] - std::cos(theta) * Vec3::UnitZ());
      if (i < 3) center[static_cast<std::size_t>(i)] = elbow[i] - m.platform_joint[i] + m.tool;
    }
    const TwoPoints points = trilaterate(center, {m.rod_length[0], m.rod_length[1], m.rod_length[2]});
    if (!points.real()) continue;
    const Vec3 X = m.mode_sign > 0 ? points.above : points.below;
    bool outside = true;
    for (int i = 0; i < m.arms; ++i) {
      const Vec3 y = X + m.platform_joint[i] - m.tool - m.base_joint[i], s = elbow[i] - m.base_joint[i];
      outside = outside && s.dot(m.outward[i]) * y.z() - s.z() * y.dot(m.outward[i]) > 0;
    }
    if (!outside) continue;
    m.home_joint = angle;
    m.home = X;
    return true;
  }
  return false;
}

}  // namespace

Result<RotaryDelta> RotaryDelta::from(const config::Table& table) {
  RotaryDelta m;
  POLYPOD_ASSIGN(chains, read_arms(table));
  POLYPOD_TRY(read_delta(table, chains, m, m.symmetric));
  POLYPOD_TRY(read_arm(table, chains.empty(), m));
  POLYPOD_TRY(read_chains(chains, m));
  POLYPOD_TRY(read_rods(table, chains.empty(), m));
  POLYPOD_ASSIGN(drive, table.table("drive"));
  POLYPOD_ASSIGN(low, drive.number("angle_min_deg", {-360, 360}));
  POLYPOD_ASSIGN(high, drive.number("angle_max_deg", {-360, 360}));
  POLYPOD_ASSIGN(compliance, read_compliances(drive, "rad_per_Nm", 1, m));
  if (chains.empty()) {
    POLYPOD_ASSIGN(zero, drive.optional_number("zero_deg", 0));
    m.zero.fill(units::from_deg(zero));
  }
  POLYPOD_TRY(drive.finish());
  if (!(low < high && high - low <= 360)) {
    return fail("MA141", fmt::format("drive: the range {:g} .. {:g} deg is empty or more than a turn", low, high),
                drive.place_of("angle_min_deg"), "give a minimum below the maximum");
  }
  m.range = {units::from_deg(low), units::from_deg(high)};
  m.drive_compliance = compliance;
  POLYPOD_TRY(finish_delta(table, m));
  if (!find_home(m)) {
    return fail("MA144", "the rods do not close at any equal angles of the drives with the elbows outside",
                table.place_of(chains.empty() ? "rod" : "arms"),
                "rods too short or too long for these radii and arms, or a range of the drives without a pose");
  }
  return m;
}

namespace {
template <class Each>
void list_parameters(const RotaryDelta& m, Each&& each) {
  for (int i = 0; i < m.arms; ++i) {
    list_point(each, m.base_joint[i], "mm", "base.joint[{}].{}", i);
    each(m.direction[i], "deg", "arm.direction[{}]", i + 1);
    each(m.arm_length[i], "mm", "arm.length[{}]", i + 1);
    each(m.zero[i], "deg", "drive.zero[{}]", i + 1);
    list_rod(each, m, i);
  }
  list_tool(each, m);
}
}  // namespace

std::vector<Parameter> parameters(const RotaryDelta& m) {
  return named_parameters([&](auto&& each) { list_parameters(m, each); });
}
std::vector<double> parameter_values(const RotaryDelta& m) {
  return values_of([&](auto&& each) { list_parameters(m, each); });
}

std::vector<Parameter> settings(const RotaryDelta& m) {
  std::vector<Parameter> out;
  if (m.symmetric) {
    out.push_back({"base.radius", m.symmetric->base_radius, "mm"});
    out.push_back({"platform.radius", m.symmetric->platform_radius, "mm"});
    out.push_back({"arm.length", m.arm_length[0], "mm"});
    out.push_back({"rod.length", m.rod_length[0], "mm"});
  }
  out.push_back({"drive.angle_min", m.range.min, "deg"});
  out.push_back({"drive.angle_max", m.range.max, "deg"});
  push_delta_settings(out, m, "arm");
  return out;
}

std::string to_toml(const RotaryDelta& m) {
  const auto mm = [](double value) { return number_toml(units::to_mm(value)); };
  const auto deg = [](double value) { return number_toml(units::to_deg(value)); };
  std::string out = common_toml(m.name, std::string(RotaryDelta::kFamily), m.description);
  if (m.symmetric) {
    out += fmt::format("base = {{ radius_mm = {}, thickness_mm = {} }}\nplatform = {{ radius_mm = {} }}\n",
                       mm(m.symmetric->base_radius), mm(m.bodies.base_thickness), mm(m.symmetric->platform_radius));
    out += fmt::format("arm = {{ length_mm = {}, count = {}, first_deg = {}, diameter_mm = {} }}\n",
                       mm(m.arm_length[0]), m.arms, deg(m.symmetric->first), mm(m.bodies.arm_diameter));
    out += fmt::format("rod = {{ length_mm = {}, {} }}\n", mm(m.rod_length[0]), rod_toml(m));
  } else {
    out += "arms = [\n";
    for (int i = 0; i < m.arms; ++i) {
      out += fmt::format(
          "  {{ base_mm = {}, direction_deg = {}, arm_mm = {}, rod_mm = {}, platform_mm = {}, zero_deg = {} }},\n",
          point_toml(m.base_joint[i]), deg(m.direction[i]), mm(m.arm_length[i]), mm(m.rod_length[i]),
          point_toml(m.platform_joint[i]), deg(m.zero[i]));
    }
    out += fmt::format("]\nbase = {{ thickness_mm = {} }}\narm = {{ diameter_mm = {} }}\n", mm(m.bodies.base_thickness),
                       mm(m.bodies.arm_diameter));
    out += fmt::format("rod = {{ {} }}\n", rod_toml(m));
  }
  out += fmt::format("drive = {{ angle_min_deg = {}, angle_max_deg = {}{}{} }}\n", deg(m.range.min), deg(m.range.max),
                     compliances_toml(m.drive_compliance, "rad_per_Nm", 1, m),
                     m.symmetric && m.zero[0] != 0 ? ", zero_deg = " + deg(m.zero[0]) : std::string());
  return out + delta_toml(m);
}

Result<RotaryDelta> with_parameters(const RotaryDelta& m, std::span<const double> p) {
  RotaryDelta out = m;
  for (int i = 0; i < m.arms; ++i) {
    const double* arm = p.data() + 10 * i;
    out.base_joint[i] = Vec3(arm[0], arm[1], arm[2]);
    out.direction[i] = arm[3];
    out.arm_length[i] = arm[4];
    out.zero[i] = arm[5];
    out.rod_length[i] = arm[6];
    out.platform_joint[i] = Vec3(arm[7], arm[8], arm[9]);
  }
  const double* tool = p.data() + 10 * m.arms;
  out.tool = Vec3(tool[0], tool[1], tool[2]);
  if (out.base_joint != m.base_joint || out.direction != m.direction || out.arm_length != m.arm_length ||
      out.zero != m.zero || out.rod_length != m.rod_length || out.platform_joint != m.platform_joint) {
    out.symmetric.reset();
  }
  POLYPOD_ASSIGN(table, config::parse(to_toml(out), m.name));
  return RotaryDelta::from(table);
}

}  // namespace polypod::machine
