// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A question that a family may answer where a closed form is faster than the closure on series:
//   QuickSeries quick_series(m, target, at, q)   how its drives move while the tool keeps what the task prescribes of
//   the
//                                                target, from the whole pose `at` with the joints q
#pragma once

#include "delta/quick_series.hpp"
#include "hexapod/quick_series.hpp"
