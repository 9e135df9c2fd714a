// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/cutter.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "polypod/core/units.hpp"

namespace polypod::cutting {
namespace {

constexpr int kMaxTeeth = 100;
constexpr config::Range kHelixRange{0, 90, false, true};
constexpr config::Range kExponentRange{0, 1, true, false};
// N/mm^2 and N/mm: a million times what any material has, and far from overflow.
constexpr double kLargestCoefficient = 1e10;
constexpr config::Range kNotNegative{0, kLargestCoefficient, false, false};
constexpr config::Range kEitherSign{-kLargestCoefficient, kLargestCoefficient, false, false};

/// The six coefficients, of the sides or of the end; `chip_unit` takes N/mm^(1+x) beyond N/mm to SI.
template <class Coefficients>
Status read_coefficients(const config::Table& table, double chip_unit, Coefficients& out) {
  POLYPOD_ASSIGN(ktc, table.number("Ktc_N_per_mm2", kNotNegative));
  POLYPOD_ASSIGN(krc, table.number("Krc_N_per_mm2", kNotNegative));
  POLYPOD_ASSIGN(kac, table.number("Kac_N_per_mm2", kEitherSign));
  POLYPOD_ASSIGN(kte, table.number("Kte_N_per_mm", kNotNegative));
  POLYPOD_ASSIGN(kre, table.number("Kre_N_per_mm", kNotNegative));
  POLYPOD_ASSIGN(kae, table.number("Kae_N_per_mm", kEitherSign));
  out.ktc = units::from_N_per_mm(ktc) * chip_unit;
  out.krc = units::from_N_per_mm(krc) * chip_unit;
  out.kac = units::from_N_per_mm(kac) * chip_unit;
  out.kte = units::from_N_per_mm(kte);
  out.kre = units::from_N_per_mm(kre);
  out.kae = units::from_N_per_mm(kae);
  return {};
}

}  // namespace

Result<Cutter> cutter_from(const config::Table& table) {
  POLYPOD_ASSIGN(name, table.optional_text("name", ""));
  POLYPOD_ASSIGN(diameter, table.number("diameter_mm", kCutterSize_mm));
  POLYPOD_ASSIGN(teeth, table.integer("teeth", 1, kMaxTeeth));
  POLYPOD_ASSIGN(helix, table.number("helix_deg", kHelixRange));
  POLYPOD_ASSIGN(length, table.number("length_mm", kCutterSize_mm));
  POLYPOD_ASSIGN(corner, table.optional_number("corner_radius_mm", 0, {0, 0.5 * diameter}));
  POLYPOD_TRY(table.finish());
  return Cutter{std::move(name),        units::from_mm(diameter), teeth,
                units::from_deg(helix), units::from_mm(length),   units::from_mm(corner)};
}

Status is_flat(const Cutter& cutter, const Place& place, const std::string& hint) {
  if (!(cutter.corner_radius > 0)) return {};
  return fail("CT130",
              fmt::format("a cutter with a corner radius of {:g} mm, where only flat ones are known",
                          units::to_mm(cutter.corner_radius)),
              place, hint);
}

Result<Material> material_from(const config::Table& table) {
  Material material;
  POLYPOD_ASSIGN(name, table.optional_text("name", ""));
  POLYPOD_ASSIGN(exponent, table.optional_number("exponent", 1, kExponentRange));
  // K h^x dz: N/mm^(1+x) to N/m^(1+x), which is N/mm^2 to N/m^2 for x = 1.
  const double chip_unit = exponent == 1 ? 1 / units::kMetrePerMm : std::pow(1 / units::kMetrePerMm, exponent);
  POLYPOD_TRY(read_coefficients(table, chip_unit, material));
  POLYPOD_ASSIGN(end_table, table.optional_table("end"));
  if (end_table) {
    material.end.emplace();
    POLYPOD_TRY(read_coefficients(*end_table, 1 / units::kMetrePerMm, *material.end));
    POLYPOD_TRY(end_table->finish());
  }
  if (table.has("spread_95")) {
    POLYPOD_ASSIGN(rows, table.points("spread_95", 6));
    for (const std::vector<double>& row : rows) {
      for (const double change : row) {
        if (change >= kEitherSign.min && change <= kEitherSign.max) continue;
        return fail(
            "CF105",
            fmt::format("spread_95 holds {:g}, but a coefficient changes by at most {:g}", change, kEitherSign.max),
            table.place_of("spread_95"), "give half of 95 % intervals of the six coefficients, N/mm^2 and N/mm");
      }
      material.spread.emplace_back();
      std::copy(row.begin(), row.end(), material.spread.back().begin());
    }
  }
  POLYPOD_TRY(table.finish());
  material.name = std::move(name);
  material.exponent = exponent;
  for (std::array<double, 6>& row : material.spread) {
    for (std::size_t k = 0; k < 6; ++k) row[k] = units::from_N_per_mm(row[k]) * (k < 3 ? chip_unit : 1);
  }
  return material;
}

Result<Cutter> read_cutter(const std::string& path) {
  POLYPOD_ASSIGN(table, config::read_file(path));
  return cutter_from(table);
}

Result<Material> read_material(const std::string& path) {
  POLYPOD_ASSIGN(table, config::read_file(path));
  return material_from(table);
}

}  // namespace polypod::cutting
