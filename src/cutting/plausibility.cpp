// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/plausibility.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <string_view>

#include "polypod/core/units.hpp"

namespace polypod::cutting {
namespace {

/// A unit that may have been meant: what was read, divided by `factor`, is then the right number.
struct Slip {
  double factor;
  std::string_view question;  ///< "F in mm/s instead of mm/min"
};

/// The slips that bring `value` into the range, as the end of a sentence.
std::string likely(double value, CoefficientRange range, std::span<const Slip> slips) {
  std::string found;
  for (const Slip& slip : slips) {
    const double meant = value / slip.factor;
    if (meant >= range.low && meant <= range.high)
      found += (found.empty() ? "; is " : ", or is ") + std::string(slip.question);
  }
  return found.empty() ? "; is it in the right unit?" : found + "?";
}

constexpr double kRadPerRev = 2 * std::numbers::pi;
constexpr double kSecondsPerMinute = 60;
/// Chips that are usual, in parts of the diameter: what a slip must lead back to.
constexpr CoefficientRange kUsualFeed{2e-4, 0.05};
constexpr CoefficientRange kUsualSpeed{0.1, 30};  // m/s
constexpr double kNominalChip = 0.05e-3;          // m

void judge_feed(const Cutter& cutter, double feed_per_tooth, std::vector<std::string>& notes) {
  if (!(feed_per_tooth > 0)) return;
  const double share = feed_per_tooth / cutter.diameter;
  // A feed per tooth that is too large: S too small or F too large; the most frequent first.
  static constexpr std::array<Slip, 3> kTooLarge{{
      {units::kMetrePerInch / units::kMetrePerMm, "F in mm/min while G20 (inches) is in force"},
      {kSecondsPerMinute / kRadPerRev, "S in rad/s instead of rev/min"},
      {kSecondsPerMinute, "S in rev/s instead of rev/min"},
  }};
  static constexpr std::array<Slip, 3> kTooSmall{{
      {units::kMetrePerMm / units::kMetrePerInch, "F in inch/min while G21 (mm) is in force"},
      {1 / kSecondsPerMinute, "F in mm/s instead of mm/min"},
      {units::kMetrePerMm, "F in m/min instead of mm/min"},
  }};
  if (share > kLargestFeedShare) {
    notes.push_back(fmt::format(
        "The feed per tooth of {:.3g} mm is {:.2g} of the cutter's diameter of {:.3g} mm, more "
        "than a fifth{}",
        units::to_mm(feed_per_tooth), share, units::to_mm(cutter.diameter), likely(share, kUsualFeed, kTooLarge)));
  } else if (feed_per_tooth < kLeastFeed) {
    notes.push_back(fmt::format("The feed per tooth of {:.2g} um is thinner than a cutting edge is sharp{}",
                                units::to_um(feed_per_tooth), likely(share, kUsualFeed, kTooSmall)));
  }
}

void judge_speed(const Cutter& cutter, double spindle_speed, std::vector<std::string>& notes) {
  const double speed = std::numbers::pi * cutter.diameter * spindle_speed;
  if (!(speed > kLargestCuttingSpeed)) return;
  static constexpr std::array<Slip, 2> kSlips{{
      {units::kMetrePerInch / units::kMetrePerMm, "the diameter converted from inches twice"},
      {1e3, "diameter_mm in um"},
  }};
  // The diameter is the likelier slip only where it is no end mill's.
  constexpr double kLargestEndMill = 0.1;  // m
  notes.push_back(
      fmt::format("The cutting speed of {:.0f} m/min ({:.3g} mm at {:.0f} rev/min) is above 3000 m/min{}",
                  speed * kSecondsPerMinute, units::to_mm(cutter.diameter), units::to_per_min(spindle_speed),
                  cutter.diameter > kLargestEndMill ? likely(speed, kUsualSpeed, kSlips)
                                                    : std::string("; is S in rev/min, and is it this tool's?")));
}

/// A coefficient in N/mm^2 or N/mm, and what it may be.
struct Judged {
  std::string_view name;
  double value = 0;
  CoefficientRange range;
  bool edge = false;
  bool may_be_none = true;       ///< 0: the model goes without it
  bool may_be_negative = false;  ///< the axial ones of a left-hand helix
};

void judge_coefficient(std::string_view where, const Judged& c, std::vector<std::string>& notes) {
  const double value = c.value, size = std::abs(value);
  const CoefficientRange& range = c.range;
  const bool edge = c.edge;
  if (value == 0 && c.may_be_none) return;
  if (value < 0 && !c.may_be_negative) {
    notes.push_back(
        fmt::format("{}{} of {:.4g} {} is negative: the force would draw the edge along or into the material; "
                    "is its sign right?",
                    where, c.name, value, edge ? "N/mm" : "N/mm^2"));
    return;
  }
  if (size >= range.low && size <= range.high) return;
  static constexpr std::array<Slip, 4> kCut{{
      {1e6, "it in N/m^2 (Pa) instead of N/mm^2 (MPa)"},
      {145.038, "it in psi instead of N/mm^2 (MPa)"},
      {1e3, "it in kPa instead of N/mm^2 (MPa)"},
      {1e-3, "it in GPa (kN/mm^2) instead of N/mm^2 (MPa)"},
  }};
  static constexpr std::array<Slip, 2> kEdgeSlips{
      {{1e3, "it in N/m instead of N/mm"}, {1e-3, "it in kN/mm instead of N/mm"}}};
  const CoefficientRange usual = edge ? CoefficientRange{0.1, range.high} : CoefficientRange{100, range.high};
  notes.push_back(fmt::format("{}{} of {:.4g} {} is outside of what is published for metals, {:g} to {:g}{}", where,
                              c.name, value, edge ? "N/mm" : "N/mm^2", range.low, range.high,
                              edge ? likely(size, usual, kEdgeSlips) : likely(size, usual, kCut)));
}

/// Coefficients of the sides or of the end; `chip` takes K_c of an exponent other than 1 to N/m^2.
template <class Coefficients>
void judge_coefficients(std::string_view where, const Coefficients& c, double chip, std::vector<std::string>& notes) {
  for (const Judged& judged :
       {Judged{"Ktc", units::to_N_per_mm2(c.ktc * chip), kTangentialCut, false, false},
        Judged{"Krc", units::to_N_per_mm2(c.krc * chip), kOtherCut},
        Judged{"Kac", units::to_N_per_mm2(c.kac * chip), kOtherCut, false, true, true},
        Judged{"Kte", units::to_N_per_mm(c.kte), kEdge, true}, Judged{"Kre", units::to_N_per_mm(c.kre), kEdge, true},
        Judged{"Kae", units::to_N_per_mm(c.kae), kAxialEdge, true, true, true}})
    judge_coefficient(where, judged, notes);
}

}  // namespace

std::vector<std::string> plausibility(const Cutter& cutter, const Material& material, double feed_per_tooth,
                                      double spindle_speed) {
  std::vector<std::string> notes;
  judge_feed(cutter, feed_per_tooth, notes);
  judge_speed(cutter, spindle_speed, notes);
  const double chip = feed_per_tooth > 0 ? feed_per_tooth : kNominalChip;
  judge_coefficients("", material, material.exponent == 1 ? 1 : std::pow(chip, material.exponent - 1), notes);
  if (material.end) judge_coefficients("end: ", *material.end, 1, notes);
  return notes;
}

}  // namespace polypod::cutting
