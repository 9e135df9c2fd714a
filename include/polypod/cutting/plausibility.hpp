// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cutting conditions that nobody runs: mostly a number in the wrong unit.
#pragma once

#include <string>
#include <vector>

#include "polypod/cutting/cutter.hpp"

namespace polypod::cutting {

/// Published coefficients lie within these, in N/mm^2 and N/mm. Kienzle's k_c1.1, the tangential coefficient for a chip
/// of 1 mm, is 350 N/mm^2 for soft non-ferrous metals to 4870 for hardened steel (Sandvik Coromant, tables of specific
/// cutting force), and thin chips (0.02 mm, exponent of 0.25) have 2.7 times as much; wood and plastics go down to
/// about 20. Linear models for milling (N/mm^2; N/mm): SLAV (5.8) aluminium 1028, 182, 65; 13.7, 28.0, 2.2. Y.
/// Altintas, Manufacturing Automation (2012), aluminium 7075: 796, 169, 222; 27.7, 30.8, 1.4; titanium alloys and
/// steels about 1700 to 2500, 400 to 1200, 300 to 800; 20 to 60. Each limit leaves about a factor of two beyond these.
struct CoefficientRange {
  double low, high;
};
inline constexpr CoefficientRange kTangentialCut{10, 15'000};  ///< K_tc, N/mm^2
inline constexpr CoefficientRange kOtherCut{0, 10'000};        ///< K_rc, |K_ac|, N/mm^2
inline constexpr CoefficientRange kEdge{0, 200};               ///< K_te, K_re, |K_ae|, N/mm

inline constexpr double kLargestFeedShare = 0.2;    ///< of the diameter, feed per tooth
inline constexpr double kLeastFeed = 0.2e-6;        ///< m, feed per tooth: thinner than any edge is sharp
inline constexpr double kLargestCuttingSpeed = 50;  ///< m/s, 3 000 m/min: beyond high-speed milling of aluminium

/// Notes on what is implausible, in whole sentences, each with the unit that was likely meant; empty where all is
/// usual. `feed_per_tooth` (m) and `spindle_speed` (rev/s) are those of a cut; what is 0 or below is not judged.
/// - feed per tooth above a fifth of the diameter, or below 0.2 um;
/// - cutting speed pi D n above 3 000 m/min;
/// - coefficients of the sides and of the end outside of what is published (an exponent other than 1: K_tc h^(x-1) at
///   the given feed per tooth, or at 0.05 mm).
std::vector<std::string> plausibility(const Cutter& cutter, const Material& material, double feed_per_tooth,
                                      double spindle_speed);

}  // namespace polypod::cutting
