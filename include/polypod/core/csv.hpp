// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Reading tables of measurements: comma-separated text whose first line names the columns.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::csv {

/// A table as it stands in a file: cells are texts until somebody asks for numbers. Lines that are empty or begin with
/// # are remarks. Blanks round a cell do not count.
struct Table {
  std::string path;
  int header_line = 1;
  std::map<std::string, std::size_t, std::less<>> column;
  struct Row {
    std::vector<std::string> cells;
    int line = 0;
  };
  std::vector<Row> rows;

  [[nodiscard]] bool has(std::string_view name) const { return column.contains(name); }
  [[nodiscard]] Place place_of(const Row& row) const { return {path, row.line, 1}; }
  /// Errors: ID100 for the first name that no column has.
  [[nodiscard]] Status needs(const std::vector<std::string>& names) const;
  /// The text of a cell; empty where the row is short or there is no such column.
  [[nodiscard]] std::string text(const Row& row, std::string_view name) const;
  /// Errors: ID101 where the cell is not a finite number.
  [[nodiscard]] Result<double> number(const Row& row, std::string_view name) const;
  /// The same, or `otherwise` where there is no such column or the cell is empty.
  [[nodiscard]] Result<double> number(const Row& row, std::string_view name, double otherwise) const;
};

/// Errors: FI100, ID102 (no rows), ID106 (a column is named twice), ID107 (a row with more cells than columns).
Result<Table> read(const std::string& path);

/// Fails with ID103 where two rows of the file hold the same cells: they would count twice.
Status no_row_twice(const Table& table);

}  // namespace polypod::csv
