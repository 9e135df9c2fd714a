// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cutting conditions that nobody runs: mostly a number in the wrong unit.
#pragma once

#include <string>
#include <vector>

#include "polypod/cutting/cutter.hpp"

namespace polypod::cutting {

/// Published coefficients of metals lie within these, in N/mm^2 and N/mm, with about a factor of two to spare.
/// - Kienzle's k_c1.1, the tangential coefficient for a chip of 1 mm: 700 N/mm^2 for aluminium and copper alloys, 1350
/// to
///   2500 for steels, 1160 to 2110 for titanium, 2600 to 3300 for heat-resistant alloys, 4700 for hardened steel, with
///   exponents of 0.20 to 0.30 (ISCAR, material groups by ISO 513 and VDI 3323); a chip of 0.02 mm has about 2.7 times
///   as much.
/// - Linear models of milling aluminium alloys (Chinese Journal of Mechanical Engineering 2021, doi
///   10.1186/s10033-021-00536-9, table 5): K_tc 244 to 1319, K_rc 99 to 789, K_ac 7 to 323; K_te 7.5 to 28, K_re 7.8 to
///   35, K_ae 0 to 2.8. SLAV (5.8): 1028, 182, 65; 13.7, 28.0, 2.2. Hard metals have edge forces a few times as large.
struct CoefficientRange {
  double low, high;
};
inline constexpr CoefficientRange kTangentialCut{100, 15'000};  ///< K_tc, N/mm^2
inline constexpr CoefficientRange kOtherCut{3, 10'000};         ///< K_rc, |K_ac| where they are not 0, N/mm^2
inline constexpr CoefficientRange kEdge{1, 200};       ///< K_te, K_re where they are not 0 (7.5 and more), N/mm
inline constexpr CoefficientRange kAxialEdge{0, 200};  ///< |K_ae|, N/mm

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
