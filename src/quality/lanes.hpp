// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Four numbers at once.
#pragma once

namespace polypod::quality {

inline constexpr int kLanes = 4;
/// Four numbers. GCC's and clang's vectors: plain operators, one instruction where the processor has it.
using Lanes = double __attribute__((vector_size(kLanes * sizeof(double))));
using Mask = long long __attribute__((vector_size(kLanes * sizeof(long long))));

}  // namespace polypod::quality
