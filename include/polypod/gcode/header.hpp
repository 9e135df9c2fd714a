// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `polypod correct` writes over a program: the words, and how they are read again.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/gcode/program.hpp"

namespace polypod::gcode {

/// The comment of a program that was looked at and left as it was; the name of the machine follows, as behind
/// kCorrectedMark.
inline constexpr std::string_view kLookedAtMark = "Polypod: looked at, not corrected, for the static compliance of";
/// Before the place of the workpiece.
inline constexpr std::string_view kOriginText = "origin X";
/// Between the place of a mark of the compliance and its figures.
inline constexpr std::string_view kDeflectText = " 100 N along X, Y, Z deflect the tool by ";
/// Of a compliance that is interpolated.
inline constexpr std::string_view kMeasuredText = "compliance interpolated from ";
/// Before the joints at that place.
inline constexpr std::string_view kJointsText = "the joints there are ";
/// What is cut.
inline constexpr std::string_view kMaterialText = "material ", kStockText = "stock ";
/// How the tool is held.
inline constexpr std::string_view kPostureText = "posture ", kHeldText = "tool held at C ";

/// For which machine and origin, and how the machine held the tool.
struct CorrectionHeader {
  int line = 0;
  bool corrected = true;  ///< false: looked at and left as it was
  std::string machine;
  std::string origin;       ///< "X-50 Y-1335 Z0 mm", ", turned by 30 deg about z"; empty where the header has none
  std::string cutters;      ///< "cutter 8 mm with 3 teeth, ", one after the other; empty where the header has none
  std::string material;     ///< "Ktc 1027.78 Krc ..."; empty where the header has none
  std::string stock;        ///< "X-5 Y-5 Z-20 to X105 Y65 Z0 mm, 154 cm3"; empty where the header has none
  std::string posture;      ///< the name of the branch; empty where the header has none
  std::optional<double> c;  ///< rad, the rotation about the tool axis; empty where the header has none
  std::string compliance;   ///< its line with what 100 N do to the tool; empty where the header has none
  bool measured = false;    ///< corrected with a compliance interpolated from measurements
  std::string joints;       ///< the line behind that, of a machine whose poses leave a joint free; else empty

  /// "corrected" or "found within its tube".
  [[nodiscard]] const char* was() const { return corrected ? "corrected" : "found within its tube"; }
  /// Whether it was written for this machine: a comment of a program keeps no brackets of its own, and of a long line
  /// the beginning.
  [[nodiscard]] bool names(const std::string& name) const;
};

/// A comment of a program.
struct Remark {
  int line = 0;
  std::string text;
};

/// The first header among these, for programs that were corrected again have several. Cost: linear.
std::optional<CorrectionHeader> correction_header(const std::vector<Remark>& remarks);
std::optional<CorrectionHeader> correction_header(const Program& program);

}  // namespace polypod::gcode
