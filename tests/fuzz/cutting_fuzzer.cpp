// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a cutter file, a material file and the stock of a job: refused with an error, or within their ranges.
#include <cmath>
#include <cstdint>
#include <string_view>

#include "polypod/cutting/cutter.hpp"
#include "polypod/cutting/stock.hpp"
#include "require.hpp"

namespace {

using namespace polypod;
using fuzz::require;
using fuzz::require_error;

void check_cutter(const config::Table& table) {
  const auto cutter = cutting::cutter_from(table);
  if (!cutter) return require_error(cutter.error());
  require(cutter->diameter >= 0.999e-5 && cutter->diameter <= 1.001, "a diameter of 0.01 to 1000 mm");
  require(cutter->length >= 0.999e-5 && cutter->length <= 1.001, "a length of 0.01 to 1000 mm");
  require(cutter->teeth >= 1 && cutter->teeth <= 100, "1 to 100 teeth");
}

void check_material(const config::Table& table) {
  const auto material = cutting::material_from(table);
  if (!material) return require_error(material.error());
  for (const double k : {material->ktc, material->krc, material->kac, material->kte, material->kre, material->kae}) {
    require(std::isfinite(k), "coefficients are finite");
  }
  require(material->exponent > 0 && material->exponent <= 1, "the exponent is in (0, 1]");
}

void check_stock(const config::Table& table) {
  const auto stock = cutting::stock_from(table, cutting::Cutter{"", 8e-3, 4, 0.5, 0.02});
  if (!stock) return require_error(stock.error());
  require(std::isfinite(stock->cell()) && stock->cell() > 0 && stock->columns() > 0 && stock->rows() > 0,
          "a stock has cells");
  require(stock->bottom() < stock->top(), "a stock has a height");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto table = config::parse(text, "fuzz.toml");
  if (!table) return require_error(table.error()), 0;
  check_cutter(*table);
  check_material(*table);
  // Grids of more cells than this are legal, but building one takes longer than a fuzzer waits for.
  const auto small = [&](const char* key) {
    const auto values = table->numbers(key);
    if (!values) return true;
    for (const double x : *values) {
      if (std::abs(x) > 200) return false;
    }
    return true;
  };
  if (!table->has("cell_mm") && !table->has("contour_mm") && small("min_mm") && small("max_mm")) check_stock(*table);
  if (table->has("contour_mm") && !table->has("cell_mm")) {
    const auto contour = table->points("contour_mm", 2);
    bool near = contour.has_value();
    if (contour) {
      for (const std::vector<double>& p : *contour) near = near && std::abs(p[0]) < 200 && std::abs(p[1]) < 200;
    }
    const auto allowance = table->optional_number("allowance_mm", 0);
    if (near && allowance && std::abs(*allowance) < 50) check_stock(*table);
  }
  return 0;
}
