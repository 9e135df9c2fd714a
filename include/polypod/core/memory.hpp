// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How much memory there is.
#pragma once

#include <cstddef>

namespace polypod {

/// The memory that this process may have, bytes: the machine's, or what its control group (cgroup v2) allows if that is
/// less. 0 where neither is known.
std::size_t machine_memory();

/// The memory that this process has now, bytes; 0 where the system does not say. Cost: some microseconds.
std::size_t resident_memory();

}  // namespace polypod
