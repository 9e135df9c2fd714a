// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The parameters of a family listed once, and read with their names or, ten times as fast, without.
#pragma once

#include <fmt/format.h>

#include <vector>

#include "polypod/machine/common.hpp"

namespace polypod::machine {

/// What `list(each)` passes to `each(value, unit, key, parts of the key...)`.
template <class List>
std::vector<Parameter> named_parameters(List&& list) {
  std::vector<Parameter> out;
  list([&](double value, const char* unit, const char* key, auto... parts) {
    out.push_back({fmt::format(fmt::runtime(key), parts...), value, unit});
  });
  return out;
}
/// The values alone.
template <class List>
std::vector<double> values_of(List&& list) {
  std::vector<double> out;
  out.reserve(64);
  list([&](double value, const auto&...) { out.push_back(value); });
  return out;
}

/// Three parameters "key.x", "key.y", "key.z"; `key` with the number of a leg or chain in it, from 1.
template <class Each>
void list_point(Each&& each, const Vec3& p, const char* unit, const char* key, int i) {
  for (int k = 0; k < 3; ++k) each(p[k], unit, key, i + 1, "xyz"[k]);
}

}  // namespace polypod::machine
