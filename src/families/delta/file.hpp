// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the machine files of both delta families have in common.
#pragma once

#include "../../machine/parameter_list.hpp"
#include "polypod/core/config.hpp"
#include "polypod/families/delta/machine.hpp"

namespace polypod::machine {

/// The table of the chains of a machine whose chains are given one by one, or none.
Result<std::vector<config::Table>> read_arms(const config::Table& table);

/// Joints, bodies, coordinate limits and tool: every table but base, platform, arm or rail, drive and rod. With
/// `chains` the rods' lengths and platform joints are read from them; otherwise `symmetric` gets the circles of `base`
/// and `platform`.
Status read_delta(const config::Table& table, const std::vector<config::Table>& chains, Delta& m,
                  std::optional<SymmetricDelta>& symmetric);

/// The table `rod`; its lengths are there where the chains are not given one by one. After the number of chains is
/// known.
Status read_rods(const config::Table& table, bool symmetric, Delta& m);
/// `compliance_UNIT`, one number for all chains, or `compliance_each_UNIT`, one a chain; 0 if neither is there.
Result<PerArm<double>> read_compliances(const config::Table& part, const std::string& unit, double si_per_unit,
                                        const Delta& m);
/// ", compliance_UNIT = ..." or, where they differ, ", compliance_each_UNIT = [...]".
std::string compliances_toml(const PerArm<double>& compliances, const std::string& unit, double si_per_unit,
                             const Delta& m);
/// The inside of the table `rod` but for its length.
std::string rod_toml(const Delta& m);

/// `count` and `first_deg` of the table of arms or rails (symmetric machines): fills directions.
Status read_directions(const config::Table& part, Delta& m, SymmetricDelta& symmetric);
/// Sets direction, outward and axis of chain i.
void point_chain(Delta& m, int i, double azimuth);

/// MA143 where no two chains' directions differ, and the sign of the assembly mode.
Status finish_delta(const config::Table& table, Delta& m);

/// The parameters of the rods of chain i, and of the tool.
template <class Each>
void list_rod(Each&& each, const Delta& m, int i) {
  each(m.rod_length[i], "mm", "rod.length[{}]", i + 1);
  list_point(each, m.platform_joint[i], "mm", "platform.joint[{}].{}", i);
}
template <class Each>
void list_tool(Each&& each, const Delta& m) {
  for (int k = 0; k < 3; ++k) each(m.tool[k], "mm", "tool.{}", "xyz"[k]);
}
/// Settings that both families share; `driven` is the key of what is driven, "arm" or "rail", for its diameter.
void push_delta_settings(std::vector<Parameter>& out, const Delta& m, const std::string& driven);
/// Everything but the family's own tables.
std::string delta_toml(const Delta& m);
std::string point_toml(const Vec3& p);

}  // namespace polypod::machine
