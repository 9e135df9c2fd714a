// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The cutter and the material: what the mechanistic force model of SLAV 5.2 needs to know.
#pragma once

#include <array>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/core/error.hpp"

namespace polypod::cutting {

/// A cylindrical end mill, flat below unless it has a corner radius (bull nose; R: a ball).
struct Cutter {
  std::string name;
  double diameter = 0;  ///< m
  int teeth = 0;
  double helix = 0;          ///< rad, 0 <= helix < pi/2
  double length = 0;         ///< m, of the edges; no cut may be deeper
  double corner_radius = 0;  ///< m, 0 .. R; only the functions of rounded.hpp know it

  [[nodiscard]] double radius() const { return 0.5 * diameter; }
  [[nodiscard]] double pitch_angle() const { return 2 * std::numbers::pi / teeth; }  ///< (5.5)
};

/// Cutting coefficients of the edges at the end of the cutter: dF = (K_e + K_c h) dr for the tangential, radial and
/// axial direction, h being the axial feed per tooth (end_force.hpp).
struct EndCoefficients {
  double ktc = 0, krc = 0, kac = 0;  ///< N/m^2
  double kte = 0, kre = 0, kae = 0;  ///< N/m
};

/// Cutting coefficients of (5.7): dF = (K_e + K_c h^x) dz for the tangential, radial and axial direction.
struct Material {
  std::string name;
  double ktc = 0, krc = 0, kac = 0;  ///< N/m^2 (for x = 1; N/m^(1+x) otherwise)
  double kte = 0, kre = 0, kae = 0;  ///< N/m
  double exponent = 1;               ///< x_1, 0 < x <= 1
  /// How uncertain they are: variations of all six together (ktc, krc, kac, kte, kre, kae), independent of each other,
  /// each as far as its 95 % interval; effects add as squares. Empty where nothing is known.
  std::vector<std::array<double, 6>> spread;
  std::optional<EndCoefficients> end;  ///< without them nothing can be said of plunges and ramps
};

/// The diameters and lengths of edges that are taken, mm. Mills of the trade are 0.03 to 500 mm wide; a size far beyond
/// has the wrong unit.
inline constexpr config::Range kCutterSize_mm{0.01, 1000};

/// Reads `diameter_mm`, `length_mm` (0.01 to 1000), `teeth` (1 to 100), `helix_deg` (0 <= helix < 90) and, if given,
/// `corner_radius_mm` (0 to half of the diameter) and `name` from a table and finishes it. Errors: those of
/// config::Table, with the place of the value or of the table.
Result<Cutter> cutter_from(const config::Table& table);
/// Error: CT130 for a cutter with a corner radius; `place` is that of its table.
Status is_flat(const Cutter& cutter, const Place& place, const std::string& hint);
/// Reads `Ktc_N_per_mm2, Krc_N_per_mm2, Kac_N_per_mm2, Kte_N_per_mm, Kre_N_per_mm, Kae_N_per_mm` and, if given,
/// `exponent` (0 < x <= 1, otherwise 1), `spread_95` (rows of six, in the units of the coefficients), `end` (a table
/// of the six coefficients of the end of the cutter, its K_c always in N/mm^2) and `name` from a table and finishes it.
/// For an exponent other than 1 the first three are in N/mm^(1+x): the chip thickness of (5.7) is in mm. The axial ones
/// may be negative (a cutter that pushes down). Errors: those of config::Table.
Result<Material> material_from(const config::Table& table);

/// The same from a file whose top level is the table.
Result<Cutter> read_cutter(const std::string& path);
Result<Material> read_material(const std::string& path);

}  // namespace polypod::cutting
