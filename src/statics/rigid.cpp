// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/rigid.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "polypod/core/text.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::statics {

std::string rigid_parts_in_words(const machine::AnyMachine& machine) {
  const std::vector<std::string> names = column_names(machine);
  const std::vector<double> compliances = column_compliances(machine);
  const auto any = [&](auto&& of_it) {
    for (std::size_t i = 0; i < names.size(); ++i)
      if (compliances[i] > 0 && of_it(names[i])) return true;
    return false;
  };
  if (!any([](const std::string&) { return true; })) return {};
  // "stage 2 joint 1" is of the kind "stage 2 joint", of the stage "stage 2".
  const auto kind = [](const std::string& name) { return name.substr(0, name.rfind(' ')); };
  const auto stage = [](const std::string& name) {
    return name.starts_with("stage ") ? name.substr(0, name.find(' ', name.find(' ') + 1)) : std::string();
  };
  std::vector<std::string> rigid;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (compliances[i] > 0) continue;
    std::string part;
    const std::string of = stage(names[i]);
    if (!of.empty() && !any([&](const std::string& other) { return stage(other) == of; })) {
      part = of;
    } else if (any([&](const std::string& other) { return kind(other) == kind(names[i]); })) {
      part = names[i];
    }
    if (!part.empty() && std::find(rigid.begin(), rigid.end(), part) == rigid.end()) rigid.push_back(part);
  }
  if (rigid.empty()) return {};
  return "without a compliance in the machine file, so counted as rigid: " + listed(rigid);
}

std::string held_directions_in_words(const Mat6& C, double noise) {
  std::vector<std::string> held;
  for (int k = 0; k < 3; ++k)
    if (C(k, k) <= noise) held.emplace_back(1, "xyz"[k]);
  if (held.empty() || held.size() == 3) return {};
  return "the tool tip does not move along " + listed(held) +
         " whatever the load: what holds it there (constraints, guides, bearings) counts as rigid";
}

}  // namespace polypod::statics
