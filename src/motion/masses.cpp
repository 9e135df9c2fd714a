// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/masses.hpp"

#include <fmt/format.h>

namespace polypod::motion {

std::vector<PartMass> part_masses(const Dynamics& d) {
  std::vector<PartMass> out;
  const auto add = [&](const std::string& part, double mass) {
    if (mass > 0) out.push_back({part, mass});
  };
  const auto body = [&](const std::string& part, const std::optional<Body>& of) {
    if (of) add(part, of->mass);
  };
  body("platform", d.platform);
  body("payload", d.payload);
  for (std::size_t i = 0; i < d.links.size(); ++i) body(fmt::format("link {}", i + 1), d.links[i]);
  add("strut, half at the base", d.strut_fixed);
  add("strut, half at the platform", d.strut_moving);
  add("rod", d.rod);
  add("slider", d.slider);
  add("arm", d.arm);
  for (std::size_t k = 0; k < d.stages.size(); ++k)
    for (const PartMass& of : part_masses(d.stages[k])) add(fmt::format("stage {} {}", k + 1, of.part), of.mass);
  return out;
}

}  // namespace polypod::motion
