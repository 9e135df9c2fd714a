// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <string>

#include "polypod/core/error.hpp"

namespace polypod::workspace {

/// WS102, of a machine that nothing encloses over boxes.
inline tl::unexpected<Error> no_bounds(const std::string& name) {
  return fail("WS102",
              fmt::format("{}: no bounds are known for its inverse, so nothing can be proven of its workspace", name),
              {}, "`polypod workspace` without --contains and --largest takes a sample");
}

}  // namespace polypod::workspace
