// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Reading tables of measurements as instruments and spreadsheets write them: a line that names the columns, then rows.
#pragma once

#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::csv {

/// Which column of the file stands for a name: `x_mm` -> "X [m]".
using Columns = std::map<std::string, std::string, std::less<>>;
/// What happens to a name of Columns whose column is not in the file, as in one of several that are joined.
enum class Absent { refused, left };

/// A table as it stands in a file: cells are texts until somebody asks for numbers.
///
/// Columns are apart with commas, semicolons, tabs or blanks, whichever the line of names has; texts may stand in
/// quotation marks. Where no comma parts the columns, decimals may be written with one. Lines that are empty or begin
/// with # or // are remarks; where the first line that is none holds numbers alone, the last remark of as many words
/// names the columns.
///
/// A column may have another unit than the one that is asked for, as `x [m]`, `x (in)` or `x_um` for x_mm: m, cm, mm,
/// um, in; deg, rad, mrad; N, kN, lbf. `q1 [rad]` gives q1 in deg, lengths without a unit in their name in mm.
class Table {
 public:
  std::string path;
  int header_line = 1;
  struct Row {
    std::vector<std::string> cells;
    std::string file;  ///< where files were joined, that of the first
    int line = 0;
  };
  std::vector<Row> rows;

  [[nodiscard]] bool has(std::string_view name) const;
  /// The number of columns of the file.
  [[nodiscard]] std::size_t width() const { return names_.size(); }
  [[nodiscard]] Place place_of(const Row& row) const { return {row.file, row.line, 1}; }
  /// Errors: ID100 for the first name that no column has.
  [[nodiscard]] Status needs(const std::vector<std::string>& names) const;
  /// The text of a cell; empty where the row is short or there is no such column.
  [[nodiscard]] std::string text(const Row& row, std::string_view name) const;
  /// Errors: ID101 where the cell is not a finite number, or beyond 1e9 of a name in mm, 1e15 of others.
  [[nodiscard]] Result<double> number(const Row& row, std::string_view name) const;
  /// The same, or `otherwise` where there is no such column or the cell is empty.
  [[nodiscard]] Result<double> number(const Row& row, std::string_view name, double otherwise) const;

  /// The columns that nobody asked for, by their names in the file; to be called when all rows are read. Errors: ID108
  /// where one looks like a name that was asked for and is not there: another case, or one letter off.
  [[nodiscard]] Result<std::vector<std::string>> unused() const;

 private:
  friend Result<Table> read(const std::string& path, const Columns& columns, Absent absent);
  friend Result<Table> joined(const std::vector<Table>& tables, const std::string& key,
                              std::vector<std::string>& left_out);

  struct Column {
    std::size_t cell = 0;
    double factor = 1;  ///< of its numbers, to the unit that is asked for
  };
  [[nodiscard]] const Column* find(std::string_view name) const;
  Status name_columns(std::vector<std::string> names, int line, const Columns& map, Absent absent);

  std::vector<std::string> names_;  ///< as the file has them
  std::map<std::string, Column, std::less<>> columns_;
  /// What was asked for, shared by copies: a reader hands its table on.
  std::shared_ptr<std::set<std::string, std::less<>>> asked_ = std::make_shared<std::set<std::string, std::less<>>>();
};

/// `columns` come before the names in the file. Errors: FI100, ID102 (no rows), ID106 (two columns for one name), ID107
/// (a row with more cells than columns), ID109 (`columns` names a column that is not there).
Result<Table> read(const std::string& path, const Columns& columns = {}, Absent absent = Absent::refused);

/// "x_mm=X [m]" and the like, as options give them. Errors: ID109.
Result<Columns> columns_of(const std::vector<std::string>& texts);

/// Rows of several tables with the same text in the column `key`, side by side: a tracker's points and a log of joints.
/// Points that one of the tables lacks go into `left_out`. Errors: ID100 (no such column), ID106 (a column in two
/// tables, a text twice in one), ID102 (none in common).
Result<Table> joined(const std::vector<Table>& tables, const std::string& key, std::vector<std::string>& left_out);

/// Fails with ID103 where two rows of the file hold the same cells: they would count twice.
Status no_row_twice(const Table& table);

}  // namespace polypod::csv
