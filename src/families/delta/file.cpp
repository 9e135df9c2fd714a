// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/delta/machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "../../machine/machine_file.hpp"
#include "file.hpp"
#include "polypod/core/units.hpp"

namespace polypod::machine {
namespace {

Result<Vec3> point_of(const config::Table& table, const std::string& key) {
  POLYPOD_ASSIGN(values, table.numbers(key, 3));
  return Vec3(units::from_mm(values[0]), units::from_mm(values[1]), units::from_mm(values[2]));
}

Status read_joint(const config::Table& table, RodJoint& joint) {
  POLYPOD_ASSIGN(part, table.optional_table("joint"));
  if (!part) return {};
  const RodJoint free;
  POLYPOD_ASSIGN(side, part->optional_number("side_deg", units::to_deg(free.side), {0, 90, true, false}));
  POLYPOD_ASSIGN(elbow_min, part->optional_number("elbow_min_deg", 0, {0, 180, false, true}));
  POLYPOD_ASSIGN(elbow_max, part->optional_number("elbow_max_deg", 180, {0, 180, true, false}));
  POLYPOD_ASSIGN(platform, part->optional_number("platform_deg", units::to_deg(free.platform), {0, 180, true, false}));
  POLYPOD_TRY(part->finish());
  if (!(elbow_min < elbow_max)) {
    return fail("MA142",
                fmt::format("joint: elbow_min_deg = {:g} is not below elbow_max_deg = {:g}", elbow_min, elbow_max),
                part->place_of("elbow_min_deg"));
  }
  joint = {units::from_deg(side), units::from_deg(elbow_min), units::from_deg(elbow_max), units::from_deg(platform)};
  return {};
}

}  // namespace

Mobility mobility(const Delta& m) {
  const int n = m.arms;
  Mobility out;
  out.members = 2 + 3 * n;
  out.joints = 5 * n;
  out.freedoms = n + 12 * n;
  out.idle = 2 * n;
  out.passive = n - 3;
  out.degrees = 6 * (out.members - out.joints - 1) + out.freedoms - out.idle + out.passive;
  return out;
}

Result<std::vector<config::Table>> read_arms(const config::Table& table) {
  POLYPOD_ASSIGN(chains, table.tables("arms"));
  if (!chains.empty() && (chains.size() < 3 || chains.size() > static_cast<std::size_t>(kMaxArms))) {
    return fail("MA140", fmt::format("a delta has 3 or 4 arms, not {}", chains.size()), table.place_of("arms"));
  }
  return chains;
}

void point_chain(Delta& m, int i, double azimuth) {
  const auto clean = [](double x) { return std::abs(x) < 1e-15 ? 0.0 : x; };  // the cosine of 90 deg is 0
  const double c = clean(std::cos(azimuth)), s = clean(std::sin(azimuth));
  m.direction[i] = azimuth;
  m.outward[i] = Vec3(c, s, 0);
  m.axis[i] = Vec3(-s, c, 0);
}

Status read_directions(const config::Table& part, Delta& m, SymmetricDelta& symmetric) {
  POLYPOD_ASSIGN(count, part.optional_integer("count", 3, 3, kMaxArms));
  POLYPOD_ASSIGN(first, part.optional_number("first_deg", 90));
  m.arms = count;
  symmetric.first = units::from_deg(first);
  for (int i = 0; i < count; ++i) point_chain(m, i, units::from_deg(first + 360.0 * i / count));
  return {};
}

Status read_delta(const config::Table& table, const std::vector<config::Table>& chains, Delta& m,
                  std::optional<SymmetricDelta>& symmetric) {
  POLYPOD_TRY(read_common(table, m.name, m.description, m.provenance));
  if (chains.empty()) {
    POLYPOD_ASSIGN(base, table.table("base"));
    POLYPOD_ASSIGN(platform, table.table("platform"));
    POLYPOD_ASSIGN(base_radius, base.number("radius_mm", config::kNotNegative));
    POLYPOD_ASSIGN(platform_radius, platform.number("radius_mm", config::kNotNegative));
    POLYPOD_ASSIGN(thickness, base.optional_number("thickness_mm", 0, config::kNotNegative));
    POLYPOD_TRY(base.finish());
    POLYPOD_TRY(platform.finish());
    m.bodies.base_thickness = units::from_mm(thickness);
    symmetric = SymmetricDelta{units::from_mm(base_radius), units::from_mm(platform_radius), 0};
  } else {
    POLYPOD_ASSIGN(base, table.optional_table("base"));
    if (base) {
      POLYPOD_ASSIGN(thickness, base->optional_number("thickness_mm", 0, config::kNotNegative));
      POLYPOD_TRY(base->finish());
      m.bodies.base_thickness = units::from_mm(thickness);
    }
    m.arms = static_cast<int>(chains.size());
    for (int i = 0; i < m.arms; ++i) {
      const config::Table& chain = chains[static_cast<std::size_t>(i)];
      POLYPOD_ASSIGN(azimuth, chain.number("direction_deg"));
      POLYPOD_ASSIGN(rod, chain.number("rod_mm", config::kPositive));
      POLYPOD_ASSIGN(platform, point_of(chain, "platform_mm"));
      point_chain(m, i, units::from_deg(azimuth));
      m.rod_length[i] = units::from_mm(rod);
      m.platform_joint[i] = platform;
    }
  }
  POLYPOD_ASSIGN(tool, table.optional_table("tool"));
  if (tool) {
    POLYPOD_ASSIGN(x, tool->optional_number("x_mm", 0));
    POLYPOD_ASSIGN(y, tool->optional_number("y_mm", 0));
    POLYPOD_ASSIGN(along, tool->optional_number("length_mm", 0));
    POLYPOD_TRY(tool->finish());
    m.tool = {units::from_mm(x), units::from_mm(y), units::from_mm(along)};
  }
  POLYPOD_ASSIGN(on_table, table.optional_table("table"));
  if (on_table) {
    POLYPOD_ASSIGN(z, on_table->number("z_mm"));
    POLYPOD_TRY(on_table->finish());
    m.bodies.table_z = units::from_mm(z);
  }
  POLYPOD_TRY(read_joint(table, m.joint));
  return read_tip_limits(table, m);
}

Status read_rods(const config::Table& table, bool symmetric, Delta& m) {
  POLYPOD_ASSIGN(rod, table.optional_table("rod"));
  if (symmetric) POLYPOD_TRY(table.table("rod"));  // must be there
  if (!rod) return {};
  if (symmetric) {
    POLYPOD_ASSIGN(length, rod->number("length_mm", config::kPositive));
    m.rod_length.fill(units::from_mm(length));
  }
  POLYPOD_ASSIGN(diameter, rod->optional_number("diameter_mm", 0, config::kNotNegative));
  POLYPOD_ASSIGN(spacing, rod->optional_number("spacing_mm", 0, config::kNotNegative));
  POLYPOD_ASSIGN(compliance, read_compliances(*rod, "um_per_N", units::from_um(1), m));
  m.bodies.rod_diameter = units::from_mm(diameter);
  m.bodies.rod_spacing = units::from_mm(spacing);
  m.rod_compliance = compliance;
  return rod->finish();
}

Result<PerArm<double>> read_compliances(const config::Table& part, const std::string& unit, double si_per_unit,
                                        const Delta& m) {
  PerArm<double> out{};
  POLYPOD_ASSIGN(all, part.optional_number("compliance_" + unit, 0, config::kNotNegative));
  const std::string key = "compliance_each_" + unit;
  std::vector<double> each(static_cast<std::size_t>(m.arms), all);
  if (part.has(key)) {
    POLYPOD_ASSIGN(given, part.numbers(key, each.size(), config::kNotNegative));
    each = given;
  }
  for (std::size_t i = 0; i < each.size(); ++i) out[i] = si_per_unit * each[i];
  return out;
}

std::string compliances_toml(const PerArm<double>& compliances, const std::string& unit, double si_per_unit,
                             const Delta& m) {
  const auto end = compliances.begin() + m.arms;
  if (std::all_of(compliances.begin(), end, [&](double c) { return c == compliances[0]; })) {
    return fmt::format(", compliance_{} = {}", unit, number_toml(compliances[0] / si_per_unit));
  }
  std::string list;
  for (auto c = compliances.begin(); c != end; ++c) list += (list.empty() ? "" : ", ") + number_toml(*c / si_per_unit);
  return fmt::format(", compliance_each_{} = [{}]", unit, list);
}

std::string rod_toml(const Delta& m) {
  return fmt::format("diameter_mm = {}, spacing_mm = {}", number_toml(units::to_mm(m.bodies.rod_diameter)),
                     number_toml(units::to_mm(m.bodies.rod_spacing))) +
         (m.rod_compliance == PerArm<double>{} ? std::string()
                                               : compliances_toml(m.rod_compliance, "um_per_N", units::from_um(1), m));
}

Status finish_delta(const config::Table& table, Delta& m) {
  POLYPOD_TRY(table.finish());
  if (m.range.min >= m.range.max) {
    return fail("MA141", "the range of the drives is empty: its minimum is not below its maximum", table.place(),
                "give a minimum below the maximum");
  }
  const double turn = (m.outward[1] - m.outward[0]).cross(m.outward[2] - m.outward[0]).z();
  if (!(std::abs(turn) > 1e-6)) {
    return fail("MA143", "the first three chains do not point in three different directions", table.place(),
                "the drives cannot constrain the tool point; spread the arms round the axis");
  }
  m.mode_sign = turn > 0 ? 1 : -1;
  return {};
}

void push_delta_settings(std::vector<Parameter>& out, const Delta& m, const std::string& driven) {
  out.push_back({"tool.length", m.tool.z(), "mm"});
  out.push_back({"joint.side", m.joint.side, "deg"});
  out.push_back({"joint.elbow_min", m.joint.elbow_min, "deg"});
  out.push_back({"joint.elbow_max", m.joint.elbow_max, "deg"});
  out.push_back({"joint.platform", m.joint.platform, "deg"});
  out.push_back({"rod.diameter", m.bodies.rod_diameter, "mm"});
  out.push_back({"rod.spacing", m.bodies.rod_spacing, "mm"});
  out.push_back({driven + ".diameter", m.bodies.arm_diameter, "mm"});
  out.push_back({"base.thickness", m.bodies.base_thickness, "mm"});
  if (m.bodies.table_z) out.push_back({"table.z", *m.bodies.table_z, "mm"});
  push_tip_limits(out, m);
}

std::string point_toml(const Vec3& p) {
  return fmt::format("[{}, {}, {}]", number_toml(units::to_mm(p.x())), number_toml(units::to_mm(p.y())),
                     number_toml(units::to_mm(p.z())));
}

std::string delta_toml(const Delta& m) {
  std::string out;
  if (!m.tool.isZero(0)) {
    out += fmt::format("tool = {{ x_mm = {}, y_mm = {}, length_mm = {} }}\n", number_toml(units::to_mm(m.tool.x())),
                       number_toml(units::to_mm(m.tool.y())), number_toml(units::to_mm(m.tool.z())));
  }
  out += fmt::format("joint = {{ side_deg = {}, elbow_min_deg = {}, elbow_max_deg = {}, platform_deg = {} }}\n",
                     number_toml(units::to_deg(m.joint.side)), number_toml(units::to_deg(m.joint.elbow_min)),
                     number_toml(units::to_deg(m.joint.elbow_max)), number_toml(units::to_deg(m.joint.platform)));
  if (m.bodies.table_z) out += fmt::format("table = {{ z_mm = {} }}\n", number_toml(units::to_mm(*m.bodies.table_z)));
  out += tip_limits_toml(m);
  return out + provenance_toml(m.provenance);
}

}  // namespace polypod::machine
