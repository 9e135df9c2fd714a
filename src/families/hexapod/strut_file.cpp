// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/strut_machine.hpp"

#include <fmt/format.h>

#include <cmath>

#include "../../machine/machine_file.hpp"
#include "../../machine/parameter_list.hpp"
#include "file.hpp"
#include "polypod/core/units.hpp"

namespace polypod::machine {
namespace {

double mean_length(const StrutHexapod& m, double height) {
  double sum = 0;
  for (int i = 0; i < kLegs; ++i) {
    sum += (m.platform_joint[i] + Vec3(0, 0, height) - m.base_joint[i]).norm();
  }
  return sum / kLegs;
}

/// The height over the base at which the mean length of the struts is `wanted`: the mean is a convex function of the
/// height, so it is bisected above its lowest point.
std::optional<double> height_of_mean_length(const StrutHexapod& m, double wanted) {
  double low = 0, high = 0;
  for (int i = 0; i < kLegs; ++i) {
    low += (m.base_joint[i].z() - m.platform_joint[i].z()) / kLegs;  // close to the lowest mean
    high = std::max(high, m.base_joint[i].z() - m.platform_joint[i].z() + wanted);
  }
  if (!(mean_length(m, low) < wanted)) return std::nullopt;
  while (mean_length(m, high) < wanted) high += wanted;
  for (int k = 0; k < 200 && high - low > 0; ++k) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    (mean_length(m, middle) < wanted ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

Result<StrutHexapod> StrutHexapod::from(const config::Table& table) {
  StrutHexapod m;
  POLYPOD_TRY(read_common(table, m.name, m.description, m.provenance));
  POLYPOD_ASSIGN(base, read_joints(table, "base", true));
  POLYPOD_ASSIGN(platform, read_joints(table, "platform", false));
  m.base_joint = base.points;
  m.base_circle = base.circle;
  m.platform_joint = platform.points;
  m.platform_circle = platform.circle;
  POLYPOD_TRY(check_legs(table, m.base_joint, m.platform_joint));

  POLYPOD_ASSIGN(leg, table.table("leg"));
  POLYPOD_ASSIGN(length_min, leg.number("length_min_mm", config::kNotNegative));
  POLYPOD_ASSIGN(length_max, leg.number("length_max_mm", config::kPositive));
  POLYPOD_ASSIGN(diameter, leg.optional_number("diameter_mm", 0, config::kNotNegative));
  POLYPOD_ASSIGN(compliance, leg.optional_number("compliance_um_per_N", 0, config::kNotNegative));
  POLYPOD_ASSIGN(each, read_six_numbers(leg, "compliance_each_um_per_N", compliance, config::kNotNegative));
  POLYPOD_ASSIGN(offset, read_six_numbers(leg, "offset_mm", 0));
  POLYPOD_TRY(leg.finish());
  if (length_min > length_max) {
    return fail("MA123", fmt::format("leg: length_min_mm = {:g} is above length_max_mm = {:g}", length_min, length_max),
                leg.place_of("length_min_mm"));
  }
  m.length_min = units::from_mm(length_min);
  m.length_max = units::from_mm(length_max);
  m.leg_diameter = units::from_mm(diameter);
  for (int i = 0; i < kLegs; ++i) {
    m.leg_compliance[i] = units::from_um(each[i]);
    m.leg_offset[i] = units::from_mm(offset[i]);
  }
  m.compliance = mean_of(m.leg_compliance);
  POLYPOD_ASSIGN(tool_length, read_tool_length(table));
  m.tool_length = tool_length;
  POLYPOD_ASSIGN(joints, read_joint_limits(table));
  m.joint = joints.limit;
  m.base_seats = joints.base;
  m.platform_seats = joints.platform;
  POLYPOD_TRY(read_tip_limits(table, m));

  POLYPOD_ASSIGN(home, table.optional_table("home"));
  if (home && home->has("height_mm")) {
    POLYPOD_ASSIGN(height, home->number("height_mm"));
    m.home.height_given = units::from_mm(height);
  }
  if (home) POLYPOD_TRY(home->finish());
  POLYPOD_TRY(table.finish());

  if (m.home.height_given) {
    m.home.height = *m.home.height_given;
  } else if (const auto height = height_of_mean_length(m, 0.5 * (m.length_min + m.length_max))) {
    m.home.height = *height;
  } else {
    return fail("MA124", "at no height over the base do the struts have their mean length", table.place(),
                "the struts are too short for these joints; change them or give home.height_mm");
  }
  for (int i = 0; i < kLegs; ++i) {
    const Vec3 leg_at_home = m.platform_joint[i] + Vec3(0, 0, m.home.height) - m.base_joint[i];
    if (!(leg_at_home.norm() > 1e-9 * m.length_max)) {
      return fail("MA125",
                  fmt::format("leg {} has no length at the home height of {:g} mm", i + 1, units::to_mm(m.home.height)),
                  home ? home->place() : table.place(), "change home.height_mm");
    }
    m.home.direction[i] = leg_at_home.normalized();
  }
  return m;
}

namespace {
template <class Each>
void list_parameters(const StrutHexapod& m, Each&& each) {
  for (int i = 0; i < kLegs; ++i) {
    each(m.leg_offset[i], "mm", "leg.length[{}]", i + 1);
    list_point(each, m.base_joint[i], "mm", "base.joint[{}].{}", i);
    list_point(each, m.platform_joint[i], "mm", "platform.joint[{}].{}", i);
  }
  each(m.tool_length, "mm", "tool.length");
}
}  // namespace

std::vector<Parameter> parameters(const StrutHexapod& m) {
  return named_parameters([&](auto&& each) { list_parameters(m, each); });
}
std::vector<double> parameter_values(const StrutHexapod& m) {
  return values_of([&](auto&& each) { list_parameters(m, each); });
}

std::vector<Parameter> settings(const StrutHexapod& m) {
  std::vector<Parameter> out;
  push_circle(out, "base", m.base_circle);
  push_circle(out, "platform", m.platform_circle);
  out.push_back({"leg.length_min", m.length_min, "mm"});
  out.push_back({"leg.length_max", m.length_max, "mm"});
  out.push_back({"leg.diameter", m.leg_diameter, "mm"});
  out.push_back({"tool.length", m.tool_length, "mm"});
  push_joint_limits(out, {m.joint, m.base_seats, m.platform_seats});
  out.push_back({"home.height", m.home.height, "mm"});
  push_tip_limits(out, m);
  return out;
}

std::string to_toml(const StrutHexapod& m) {
  std::string out = common_toml(m.name, std::string(StrutHexapod::kFamily), m.description);
  out += joints_toml("base", m.base_joint, m.base_circle);
  out += joints_toml("platform", m.platform_joint, m.platform_circle);
  out += fmt::format("leg = {{ length_min_mm = {}, length_max_mm = {}, diameter_mm = {}{}{} }}\n",
                     number_toml(units::to_mm(m.length_min)), number_toml(units::to_mm(m.length_max)),
                     number_toml(units::to_mm(m.leg_diameter)), leg_compliance_toml(m.leg_compliance),
                     leg_offset_toml(m.leg_offset));
  out += fmt::format("tool = {{ length_mm = {} }}\n", number_toml(units::to_mm(m.tool_length)));
  out += joint_limits_toml({m.joint, m.base_seats, m.platform_seats}) + tip_limits_toml(m);
  if (m.home.height_given) {
    out += fmt::format("home = {{ height_mm = {} }}\n", number_toml(units::to_mm(*m.home.height_given)));
  }
  return out + provenance_toml(m.provenance);
}

Result<StrutHexapod> with_parameters(const StrutHexapod& m, std::span<const double> p) {
  StrutHexapod out = m;
  for (int i = 0; i < kLegs; ++i) {
    const double* leg = p.data() + 7 * i;
    out.leg_offset[i] = leg[0];
    out.base_joint[i] = Vec3(leg[1], leg[2], leg[3]);
    out.platform_joint[i] = Vec3(leg[4], leg[5], leg[6]);
  }
  out.tool_length = p[42];
  if (out.base_joint != m.base_joint) out.base_circle.reset();
  if (out.platform_joint != m.platform_joint) out.platform_circle.reset();
  POLYPOD_ASSIGN(table, config::parse(to_toml(out), m.name));
  return StrutHexapod::from(table);
}

}  // namespace polypod::machine
