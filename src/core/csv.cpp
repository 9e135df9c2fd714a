// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "polypod/core/files.hpp"

namespace polypod::csv {
namespace {

std::vector<std::string> cells_of(std::string_view line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',') {
      cells.emplace_back();
    } else if (c != '\r' && c != ' ' && c != '\t') {
      cells.back() += c;
    }
  }
  return cells;
}

}  // namespace

Result<Table> read(const std::string& path) {
  POLYPOD_ASSIGN(text, files::read(path));
  Table table;
  table.path = path;
  int line_number = 0;
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";  // as spreadsheets put it before everything
  for (std::size_t at = text.starts_with(kByteOrderMark) ? kByteOrderMark.size() : 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view line = std::string_view(text).substr(at, end - at);
    at = end + 1;
    ++line_number;
    if (line.empty() || line[0] == '#' || line == "\r") continue;
    std::vector<std::string> cells = cells_of(line);
    if (table.column.empty()) {
      table.header_line = line_number;
      for (std::size_t i = 0; i < cells.size(); ++i) {
        if (!table.column.try_emplace(cells[i], i).second) {
          return fail("ID106", fmt::format("the column \"{}\" stands twice", cells[i]), Place{path, line_number, 1});
        }
      }
      continue;
    }
    if (cells.size() > table.column.size()) {
      return fail("ID107", fmt::format("{} cells for {} columns", cells.size(), table.column.size()),
                  Place{path, line_number, 1}, "decimals are written with a point, cells apart with a comma");
    }
    table.rows.push_back({std::move(cells), line_number});
  }
  if (table.column.empty()) {
    return fail("ID102", "the file has no rows", Place{path, 0, 0}, "the first line names the columns");
  }
  return table;
}

Status Table::needs(const std::vector<std::string>& names) const {
  for (const std::string& name : names) {
    if (has(name)) continue;
    return fail("ID100", fmt::format("the column {} is missing", name), Place{path, header_line, 1},
                "the first line names the columns");
  }
  if (rows.empty()) return fail("ID102", "the file has no rows", Place{path, 0, 0});
  return {};
}

std::string Table::text(const Row& row, std::string_view name) const {
  const auto it = column.find(name);
  return it == column.end() || it->second >= row.cells.size() ? std::string() : row.cells[it->second];
}

Result<double> Table::number(const Row& row, std::string_view name) const {
  const std::string cell = text(row, name);
  const char* begin = cell.data();
  const char* end = begin + cell.size();
  if (begin != end && *begin == '+') ++begin;
  double value = 0;
  const auto [rest, code] = std::from_chars(begin, end, value);
  if (code != std::errc{} || rest != end || !std::isfinite(value)) {
    return fail("ID101", fmt::format("{} = \"{}\" is not a finite number", name, cell), place_of(row));
  }
  return value;
}

Result<double> Table::number(const Row& row, std::string_view name, double otherwise) const {
  return text(row, name).empty() ? Result<double>(otherwise) : number(row, name);
}

Status no_row_twice(const Table& table) {
  std::map<std::vector<std::string>, int> seen;
  for (const Table::Row& row : table.rows) {
    const auto [it, fresh] = seen.try_emplace(row.cells, row.line);
    if (!fresh) {
      return fail("ID103", fmt::format("the row stands already in line {}", it->second), table.place_of(row),
                  "a row that stands twice would count twice");
    }
  }
  return {};
}

}  // namespace polypod::csv
