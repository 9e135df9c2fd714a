// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "polypod/core/config.hpp"
#include "polypod/families/serial/machine.hpp"

namespace polypod::machine {

/// The keys of a serial arm as a file would have them, every number with all its digits; `place` stands in errors.
config::Table table_of(const SerialArm& arm, const Place& place);

}  // namespace polypod::machine
