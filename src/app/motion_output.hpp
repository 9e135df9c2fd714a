// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the commands of motion print alike.
#pragma once

#include <fmt/format.h>

#include "polypod/pages/motion.hpp"

namespace polypod::app {

inline void print_limit(const pages::MotionLimit& l) {
  fmt::print("limit    {:<36} {:>12.6g} {:<6} {:<7} reached {:.6g}\n", l.name, l.limit, l.unit,
             l.given ? "given" : "assumed", l.met);
}

}  // namespace polypod::app
