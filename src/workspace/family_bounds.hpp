// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the families know of their limits over boxes: bounds_of(m, options) of each that knows something.
#pragma once

#include "../families/delta/bounds.hpp"
#include "../families/hexapod/bounds.hpp"
#include "../families/parallel/bounds.hpp"
#include "../families/serial/bounds.hpp"
