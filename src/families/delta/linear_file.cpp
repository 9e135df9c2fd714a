// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/delta/linear_machine.hpp"

#include <fmt/format.h>

#include <cmath>

#include "../../machine/machine_file.hpp"
#include "file.hpp"
#include "polypod/core/units.hpp"
#include "polypod/geometry/trilateration.hpp"

namespace polypod::machine {
namespace {

Status read_rails(const config::Table& table, const std::vector<config::Table>& chains, LinearDelta& m) {
  POLYPOD_ASSIGN(rail, table.table("rail"));
  POLYPOD_ASSIGN(length, rail.number("length_mm", config::kPositive));
  POLYPOD_ASSIGN(diameter, rail.optional_number("diameter_mm", 0, config::kNotNegative));
  if (chains.empty()) {
    POLYPOD_ASSIGN(incline, rail.optional_number("incline_deg", 0, {-90, 90}));
    POLYPOD_TRY(read_directions(rail, m, *m.symmetric));
    m.incline = units::from_deg(incline);
  }
  POLYPOD_ASSIGN(compliance, read_compliances(rail, "um_per_N", units::from_um(1), m));
  POLYPOD_TRY(rail.finish());
  POLYPOD_TRY(read_rods(table, chains.empty(), m));
  m.range = {0, units::from_mm(length)};
  m.bodies.arm_diameter = units::from_mm(diameter);
  m.drive_compliance = compliance;
  for (int i = 0; i < m.arms; ++i) {
    if (chains.empty()) {
      m.rail_start[i] = m.symmetric->base_radius * m.outward[i];
      m.rail_direction[i] = std::cos(m.incline) * Vec3::UnitZ() - std::sin(m.incline) * m.outward[i];
      m.platform_joint[i] = m.symmetric->platform_radius * m.outward[i];
      continue;
    }
    const config::Table& chain = chains[static_cast<std::size_t>(i)];
    POLYPOD_ASSIGN(start, chain.numbers("start_mm", 3));
    POLYPOD_ASSIGN(along, chain.numbers("along", 3));
    POLYPOD_TRY(chain.finish());
    const Vec3 u(along[0], along[1], along[2]);
    if (!(u.norm() > 1e-9)) {
      return fail("MA145", fmt::format("rail {} has no direction", i + 1), chain.place_of("along"));
    }
    m.rail_start[i] = {units::from_mm(start[0]), units::from_mm(start[1]), units::from_mm(start[2])};
    m.rail_direction[i] = u.normalized();
  }
  return {};
}

/// The carriages at one height, each shifted by its platform joint: three points that are one.
bool rods_parallel(const LinearDelta& m) {
  constexpr double kOnePoint = 1e-9;  // m
  const auto shifted = [&](int i) {
    return Vec3(m.rail_start[i] + 0.5 * m.range.max * m.rail_direction[i] - m.platform_joint[i]);
  };
  return (shifted(1) - shifted(0)).norm() < kOnePoint && (shifted(2) - shifted(0)).norm() < kOnePoint;
}

/// Home: all carriages at the share of their rails nearest the middle at which the rods close.
bool find_home(LinearDelta& m) {
  constexpr int kSteps = 64;
  for (int k = 0; k <= 2 * kSteps; ++k) {
    const double q = m.range.max * (0.5 + (k % 2 == 0 ? 0.5 : -0.5) * ((k + 1) / 2) / kSteps);
    std::array<Vec3, 3> center;
    for (int i = 0; i < 3; ++i) {
      center[static_cast<std::size_t>(i)] = m.rail_start[i] + q * m.rail_direction[i] - m.platform_joint[i] + m.tool;
    }
    const TwoPoints points = trilaterate(center, {m.rod_length[0], m.rod_length[1], m.rod_length[2]});
    if (!points.real()) continue;
    m.home_joint = q;
    m.home = m.mode_sign > 0 ? points.above : points.below;
    return true;
  }
  return false;
}

}  // namespace

Result<LinearDelta> LinearDelta::from(const config::Table& table) {
  LinearDelta m;
  POLYPOD_ASSIGN(chains, read_arms(table));
  POLYPOD_TRY(read_delta(table, chains, m, m.symmetric));
  POLYPOD_TRY(read_rails(table, chains, m));
  POLYPOD_TRY(finish_delta(table, m));
  if (!find_home(m)) {
    if (rods_parallel(m)) {
      return fail(
          "MA144",
          "the rods are parallel at equal heights of the carriages, because base and platform have equal radii: "
          "the drives do not constrain the platform",
          table.place_of(chains.empty() ? "platform" : "arms"), "give the platform another radius than the base");
    }
    return fail("MA144", "the rods do not close at any equal heights of the carriages",
                table.place_of(chains.empty() ? "rod" : "arms"), "rods too short for these radii");
  }
  return m;
}

namespace {
template <class Each>
void list_parameters(const LinearDelta& m, Each&& each) {
  for (int i = 0; i < m.arms; ++i) {
    list_point(each, m.rail_start[i], "mm", "rail.start[{}].{}", i);
    list_point(each, m.rail_direction[i], "", "rail.direction[{}].{}", i);
    list_rod(each, m, i);
  }
  list_tool(each, m);
}
}  // namespace

std::vector<Parameter> parameters(const LinearDelta& m) {
  return named_parameters([&](auto&& each) { list_parameters(m, each); });
}
std::vector<double> parameter_values(const LinearDelta& m) {
  return values_of([&](auto&& each) { list_parameters(m, each); });
}

std::vector<Parameter> settings(const LinearDelta& m) {
  std::vector<Parameter> out;
  if (m.symmetric) {
    out.push_back({"base.radius", m.symmetric->base_radius, "mm"});
    out.push_back({"platform.radius", m.symmetric->platform_radius, "mm"});
    out.push_back({"rod.length", m.rod_length[0], "mm"});
    out.push_back({"rail.incline", m.incline, "deg"});
  }
  out.push_back({"rail.length", m.range.max, "mm"});
  push_delta_settings(out, m, "rail");
  return out;
}

std::string to_toml(const LinearDelta& m) {
  const auto mm = [](double value) { return number_toml(units::to_mm(value)); };
  const auto deg = [](double value) { return number_toml(units::to_deg(value)); };
  std::string out = common_toml(m.name, std::string(LinearDelta::kFamily), m.description);
  std::string rail = fmt::format("length_mm = {}, diameter_mm = {}{}", mm(m.range.max), mm(m.bodies.arm_diameter),
                                 compliances_toml(m.drive_compliance, "um_per_N", units::from_um(1), m));
  std::string rod = rod_toml(m);
  std::string base = fmt::format("thickness_mm = {}", mm(m.bodies.base_thickness));
  if (m.symmetric) {
    base += fmt::format(", radius_mm = {}", mm(m.symmetric->base_radius));
    out += fmt::format("platform = {{ radius_mm = {} }}\n", mm(m.symmetric->platform_radius));
    rail +=
        fmt::format(", count = {}, first_deg = {}, incline_deg = {}", m.arms, deg(m.symmetric->first), deg(m.incline));
    rod += fmt::format(", length_mm = {}", mm(m.rod_length[0]));
  } else {
    out += "arms = [\n";
    for (int i = 0; i < m.arms; ++i) {
      const Vec3& u = m.rail_direction[i];
      out += fmt::format(
          "  {{ start_mm = {}, along = [{}, {}, {}], direction_deg = {}, rod_mm = {}, platform_mm = {} }},\n",
          point_toml(m.rail_start[i]), number_toml(u.x()), number_toml(u.y()), number_toml(u.z()), deg(m.direction[i]),
          mm(m.rod_length[i]), point_toml(m.platform_joint[i]));
    }
    out += "]\n";
  }
  out += fmt::format("base = {{ {} }}\nrail = {{ {} }}\nrod = {{ {} }}\n", base, rail, rod);
  return out + delta_toml(m);
}

Result<LinearDelta> with_parameters(const LinearDelta& m, std::span<const double> p) {
  LinearDelta out = m;
  for (int i = 0; i < m.arms; ++i) {
    const double* chain = p.data() + 10 * i;
    out.rail_start[i] = Vec3(chain[0], chain[1], chain[2]);
    out.rail_direction[i] = Vec3(chain[3], chain[4], chain[5]);
    out.rod_length[i] = chain[6];
    out.platform_joint[i] = Vec3(chain[7], chain[8], chain[9]);
  }
  const double* tool = p.data() + 10 * m.arms;
  out.tool = Vec3(tool[0], tool[1], tool[2]);
  if (out.rail_start != m.rail_start || out.rail_direction != m.rail_direction || out.rod_length != m.rod_length ||
      out.platform_joint != m.platform_joint) {
    out.symmetric.reset();
  }
  POLYPOD_ASSIGN(table, config::parse(to_toml(out), m.name));
  return LinearDelta::from(table);
}

}  // namespace polypod::machine
