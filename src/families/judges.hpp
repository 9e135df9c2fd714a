// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits of the families at one pose: pose_judge(m, options) of each that does not leave it to a search.
#pragma once

#include "delta/judge.hpp"
#include "hexapod/judge.hpp"
#include "parallel/judge.hpp"
#include "serial/judge.hpp"
