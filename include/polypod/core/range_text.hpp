// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Ranges and units in words, for messages.
#pragma once

#include <string>
#include <string_view>

#include "polypod/core/config.hpp"

namespace polypod::config {

/// Which numbers lie in a range, and whether its ends do: "greater than 0 and at most 100000 um", "at least 1",
/// "less than 90 deg"; "finite" of a range without ends. The unit stands behind the last number; empty: none.
std::string in_words(const Range& range, std::string_view unit = {});

/// The unit that a key says: "um" of tolerance_um, "N/mm2" of material.Ktc_N_per_mm2, "um/(m K)" of
/// expansion_um_per_m_K, "deg C" of mean_C, "mm" of joints_mm[2][1] and joint[3].x_mm; empty where it says none.
std::string unit_of(std::string_view key);

}  // namespace polypod::config
