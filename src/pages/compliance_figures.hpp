// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pictures of compliances over a plane that several pages show.
#pragma once

#include <algorithm>
#include <filesystem>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "polypod/pages/compliance_map.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {

using Panels = std::vector<std::pair<std::string, report::Figure>>;

/// "plane_I.csv, plane_V.csv": the files of rows that know their place, each once, without folders.
template <class Rows>
std::string files_of(const Rows& rows) {
  std::vector<std::string> names;
  for (const auto& row : rows) {
    std::string name = std::filesystem::path(row.place.file).filename().string();
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(std::move(name));
  }
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

/// The colours that several maps share.
struct ColourScale {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void add(const std::vector<double>& values);
  [[nodiscard]] double largest() const;
  /// From the least to the greatest of all, or round zero.
  void set(report::HeatMap& map, bool round_zero) const;
};

/// "Cxx": what a person says; no underscores in print.
std::string symbol(const Field& field);
std::string shown_unit(const Field& field);
/// A number as it was given, mm.
std::string given(double value);
/// "z = 0 mm".
std::string shown_place(const ComplianceMap& map);
/// "the plane z = 0 mm".
std::string shown_domain(const ComplianceMap& map);
/// A field over the plane, with the paths.
report::HeatMap heat_of(const ComplianceMap& map, const Field& field);

/// Measured, computed and the difference of an entry, three a row: of the direct or of the cross compliances.
Panels measured_panels(const ComplianceMap& map, Field::Kind kind);
/// Table and panels of a map that has measured compliances; cross compliances only if asked for.
void add_measured(report::Report& page, const ComplianceMap& map, bool with_cross);

}  // namespace polypod::pages
