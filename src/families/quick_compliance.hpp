// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A question that a family may answer where a closed form is faster than inverse and element_columns:
//   QuickCompliance quick_compliance(m, posture)  the compliance at many tool tips; empty without
#pragma once

#include "serial/quick_compliance.hpp"
