// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What every fuzzer asks of what it gets; a breach ends the run, so that the input is kept.
#pragma once

#include <cstdio>
#include <cstdlib>

#include "polypod/core/error.hpp"

namespace polypod::fuzz {

inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", what);
  std::abort();
}

/// An error names itself and says what is wrong.
inline void require_error(const Error& error) {
  require(!error.id.empty() && !error.message.empty(), "an error has an id and a message");
}

}  // namespace polypod::fuzz
