// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a machine file leaves out and its reader assumes: named under [provenance], so that answers can say so.
#pragma once

#include "polypod/machine/any_machine.hpp"

namespace polypod::machine {

/// What [provenance] says of `limits` where an arm's file gives none.
inline constexpr const char* kAssumedLimits = "none given; one turn each way, or 10 m, is assumed";

/// Whether the ranges of the joints are assumed, so that nothing is known of the real ones.
inline bool limits_are_assumed(const AnyMachine& machine) {
  const Provenance& provenance = provenance_of(machine);
  const auto limits = provenance.find("limits");
  return limits != provenance.end() && limits->second == kAssumedLimits;
}

}  // namespace polypod::machine
