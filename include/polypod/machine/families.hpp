// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The one list of the families that machine files know. A family stands here once; the reader, the variant and every
// dispatch follow from it.
#pragma once

#include <variant>

#include "polypod/families/delta/linear_machine.hpp"
#include "polypod/families/delta/rotary_machine.hpp"
#include "polypod/families/hexapod/slider_machine.hpp"
#include "polypod/families/hexapod/strut_machine.hpp"
#include "polypod/families/own/machine.hpp"
#include "polypod/families/parallel/machine.hpp"
#include "polypod/families/serial/machine.hpp"
#include "polypod/families/stages/machine.hpp"

namespace polypod::machine {

template <class... Family>
struct FamilyList {
  using Variant = std::variant<Family...>;
  template <class F>
  static constexpr bool holds = (std::same_as<F, Family> || ...);
};

/// Each has `kFamily`, its name in files, and `from(table)`, its reader; Own reads the families that `add_family`
/// added.
using Families = FamilyList<SerialArm, StrutHexapod, SliderHexapod, RotaryDelta, LinearDelta, Parallel, Stages, Own>;

}  // namespace polypod::machine
