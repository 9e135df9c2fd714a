// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/csv.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <optional>

#include "polypod/core/excerpt.hpp"
#include "polypod/core/files.hpp"

namespace polypod::csv {
namespace {

constexpr std::string_view kBlanks = " \t\r";

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

/// What parts the columns of a line of names.
char separator_of(std::string_view line) {
  for (const char c : {';', '\t', ','})
    if (line.find(c) != std::string_view::npos) return c;
  return trimmed(line).find(' ') == std::string_view::npos ? ',' : ' ';
}

/// The cells of a line; quotation marks hold what they enclose together, and two of them stand for one. `begins`: the
/// first byte of each, from 0.
std::vector<std::string> cells_of(std::string_view line, char separator, std::vector<std::size_t>* begins = nullptr) {
  std::vector<std::string> cells;
  std::string cell;
  bool quoted = false, was_quoted = false;
  std::size_t next = 0;  // the first byte after the last separator
  const auto end_cell = [&](std::size_t end) {
    const std::size_t begin = std::min(line.find_first_not_of(kBlanks, next), end);
    next = end + 1;
    if (separator == ' ' && cell.empty() && !was_quoted) return;  // blanks in a row part once
    cells.push_back(was_quoted ? cell : std::string(trimmed(cell)));
    if (begins != nullptr) begins->push_back(begin);
    cell.clear();
    was_quoted = false;
  };
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quoted) {
      if (c != '"') {
        cell += c;
      } else if (i + 1 < line.size() && line[i + 1] == '"') {
        cell += line[++i];
      } else {
        quoted = false;
      }
    } else if (c == '"' && trimmed(cell).empty()) {
      cell.clear();
      quoted = was_quoted = true;
    } else if (c == separator || (separator == ' ' && kBlanks.find(c) != std::string_view::npos)) {
      end_cell(i);
    } else if (!was_quoted) {
      cell += c;
    }
  }
  end_cell(line.size());
  return cells;
}

std::optional<double> number_in(std::string text, bool decimal_comma) {
  if (decimal_comma && text.find('.') == std::string::npos && std::count(text.begin(), text.end(), ',') == 1) {
    std::replace(text.begin(), text.end(), ',', '.');
  }
  const char* begin = text.data();
  const char* end = begin + text.size();
  if (begin != end && *begin == '+') ++begin;
  double value = 0;
  const auto [rest, code] = std::from_chars(begin, end, value);
  if (code != std::errc{} || rest != end || !std::isfinite(value)) return {};
  return value;
}

/// A unit of a column and how many of the unit that programs ask for it is.
struct Unit {
  std::string_view name;
  char quantity;  ///< l(ength), a(ngle), f(orce)
  double size;    ///< in m, deg, N
};
constexpr double kDegrees = 57.295779513082320876798154814105;
constexpr std::array<Unit, 11> kUnits{{{"m", 'l', 1},
                                       {"cm", 'l', 1e-2},
                                       {"mm", 'l', 1e-3},
                                       {"um", 'l', 1e-6},
                                       {"in", 'l', 25.4e-3},
                                       {"deg", 'a', 1},
                                       {"rad", 'a', kDegrees},
                                       {"mrad", 'a', 1e-3 * kDegrees},
                                       {"N", 'f', 1},
                                       {"kN", 'f', 1e3},
                                       {"lbf", 'f', 4.4482216152605}}};
const Unit* unit_called(std::string_view name) {
  if (name == "\xC2\xB5m" || name == "\xCE\xBCm") name = "um";  // micro sign, Greek mu
  if (name == "\xC2\xB0") name = "deg";
  const auto it = std::find_if(kUnits.begin(), kUnits.end(), [&](const Unit& u) { return u.name == name; });
  return it == kUnits.end() ? nullptr : &*it;
}

/// mm, deg or N: of names without a unit.
double usual_size(const Unit& unit) {
  return unit.quantity == 'l' ? 1e-3 : 1.0;
}

/// "x [m]", "x (m)" or "x_m" in parts.
struct Name {
  std::string base;
  const Unit* unit = nullptr;
};
Name parts_of(std::string_view name) {
  for (const auto& [open, close] : {std::pair{'[', ']'}, std::pair{'(', ')'}}) {
    const std::size_t at = name.rfind(open);
    if (at == std::string_view::npos || name.back() != close) continue;
    if (const Unit* unit = unit_called(trimmed(name.substr(at + 1, name.size() - at - 2)))) {
      return {std::string(trimmed(name.substr(0, at))), unit};
    }
  }
  const std::size_t at = name.rfind('_');
  if (at != std::string_view::npos && at > 0) {
    if (const Unit* unit = unit_called(name.substr(at + 1))) return {std::string(name.substr(0, at)), unit};
  }
  return {std::string(name), nullptr};
}

/// Small letters and digits alone: what two names have in common that a person takes for one.
std::string bare(std::string_view name) {
  std::string out;
  for (const char c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) != 0)
      out += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return out;
}

/// Whether one letter more, less or other makes one text of the other.
bool one_off(std::string_view a, std::string_view b) {
  if (a.size() < b.size()) std::swap(a, b);
  if (a.size() > b.size() + 1) return false;
  const std::size_t same = static_cast<std::size_t>(std::mismatch(b.begin(), b.end(), a.begin()).first - b.begin());
  const std::size_t next_b = same + (a.size() == b.size() ? 1 : 0);
  return a.substr(std::min(same + 1, a.size())) == b.substr(std::min(next_b, b.size()));
}

/// Names of at least this many letters are looked at for one that is wrong: x_mm and y_mm are two.
constexpr std::size_t kLongName = 6;

/// Whether this is a row of a table and no line of names.
bool holds_number(const std::vector<std::string>& cells, bool decimal_comma) {
  return cells.size() > 1 && std::any_of(cells.begin(), cells.end(),
                                         [&](const std::string& c) { return number_in(c, decimal_comma).has_value(); });
}

struct Line {
  std::string_view text;
  int number = 0;
};

}  // namespace

Status Table::name_columns(std::vector<std::string> names, int line, const Columns& map, Absent absent) {
  header_line = line;
  names_ = std::move(names);
  if (!names_.empty() && names_.back().empty()) names_.pop_back();  // a separator at the end of the line
  const Place here{path, line, 1};
  const auto twice = [&](const std::string& name) {
    return fail("ID106", fmt::format("the column \"{}\" occurs twice", name), here);
  };
  for (std::size_t i = 0; i < names_.size(); ++i) {
    if (!columns_.try_emplace(names_[i], Column{i, 1}).second) return twice(names_[i]);
  }
  // In another unit, under the names of all units that it may be asked for; what the file itself calls so comes first.
  const std::map<std::string, Column, std::less<>> of_file = columns_;
  for (std::size_t i = 0; i < names_.size(); ++i) {
    const Name given = parts_of(names_[i]);
    if (given.unit == nullptr || given.base.empty()) continue;
    const auto stands_for = [&](const std::string& name, double factor) {
      const auto [it, fresh] = columns_.try_emplace(name, Column{i, factor});
      return fresh || it->second.cell == i || of_file.contains(name);
    };
    for (const Unit& unit : kUnits) {
      if (unit.quantity != given.unit->quantity) continue;
      const std::string name = fmt::format("{}_{}", given.base, unit.name);
      if (!stands_for(name, given.unit->size / unit.size)) return twice(name);
    }
    if (!stands_for(given.base, given.unit->size / usual_size(*given.unit))) return twice(given.base);
  }
  for (const auto& [name, column] : map) {
    const auto it = of_file.find(column);
    if (it == of_file.end() && absent == Absent::left) continue;
    if (it == of_file.end()) {
      return fail("ID109", fmt::format("there is no column \"{}\" to be read as {}", column, name), here,
                  fmt::format("the columns are: {}", fmt::join(names_, ", ")));
    }
    const Unit *given = parts_of(column).unit, *wanted = parts_of(name).unit;
    if (given != nullptr && wanted != nullptr && given->quantity != wanted->quantity) {
      return fail("ID109",
                  fmt::format("the column \"{}\" cannot be read as {}: the units differ in kind", column, name), here);
    }
    const double size = wanted != nullptr ? wanted->size : given != nullptr ? usual_size(*given) : 1.0;
    columns_[name] = {it->second.cell, given != nullptr ? given->size / size : 1.0};
  }
  return {};
}

Result<Table> read(const std::string& path, const Columns& columns, Absent absent) {
  POLYPOD_ASSIGN(text, files::read(path));
  Table table;
  table.path = path;
  char separator = ',';
  int line_number = 0;
  Line remark;                                                 // the last one
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";  // as spreadsheets put it before everything
  for (std::size_t at = text.starts_with(kByteOrderMark) ? kByteOrderMark.size() : 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view whole = std::string_view(text).substr(at, end - at), line = trimmed(whole);
    at = end + 1;
    ++line_number;
    if (line.empty()) continue;
    if (line[0] == '#' || line.starts_with("//")) {
      remark = {trimmed(line.substr(std::min(line.find_first_not_of("#/"), line.size()))), line_number};
      continue;
    }
    if (table.names_.empty()) {
      separator = separator_of(line);
      const bool is_row = holds_number(cells_of(line, separator), separator != ',');
      const std::vector<std::string> in_remark = cells_of(remark.text, separator_of(remark.text));
      if (is_row && in_remark.size() != cells_of(line, separator).size()) {
        return fail("ID102", "no line names the columns", Place{path, line_number, 1},
                    "write one before the first row, as x_mm,y_mm,z_mm");
      }
      POLYPOD_TRY(is_row ? table.name_columns(in_remark, remark.number, columns, absent)
                         : table.name_columns(cells_of(line, separator), line_number, columns, absent));
      if (!is_row) continue;
    }
    std::vector<std::string> cells = cells_of(line, separator);
    if (separator != ',') {
      for (std::string& cell : cells)
        if (number_in(cell, true)) std::replace(cell.begin(), cell.end(), ',', '.');
    }
    if (cells.size() == table.names_.size() + 1 && cells.back().empty()) cells.pop_back();
    if (cells.size() > table.names_.size()) {
      std::vector<std::size_t> begins;
      cells_of(whole, separator, &begins);
      return fail("ID107", fmt::format("{} cells for {} columns", cells.size(), table.names_.size()),
                  Place{path, line_number, static_cast<int>(begins[table.names_.size()]) + 1},
                  separator == ',' ? "decimals are written with a point where commas part the cells; or part them with "
                                     "semicolons"
                                   : "every row has the columns of the line of names");
    }
    table.rows.push_back({std::move(cells), path, line_number});
  }
  if (table.names_.empty()) {
    return fail("ID102", "the file has no rows", Place{path, 0, 0}, "the first line names the columns");
  }
  return table;
}

Result<Columns> columns_of(const std::vector<std::string>& texts) {
  Columns out;
  for (const std::string& text : texts) {
    const std::size_t at = text.find('=');
    const std::string name(trimmed(std::string_view(text).substr(0, std::min(at, text.size()))));
    const std::string column(at == std::string::npos ? "" : trimmed(std::string_view(text).substr(at + 1)));
    if (name.empty() || column.empty() || !out.try_emplace(name, column).second) {
      return fail("ID109", fmt::format("--columns {}: not NAME=COLUMN, or a name twice", text), {},
                  "write for instance --columns \"x_mm=X [m]\"");
    }
  }
  return out;
}

const Table::Column* Table::find(std::string_view name) const {
  asked_->emplace(name);
  const auto it = columns_.find(name);
  return it == columns_.end() ? nullptr : &it->second;
}

bool Table::has(std::string_view name) const {
  return find(name) != nullptr;
}

Status Table::needs(const std::vector<std::string>& names) const {
  for (const std::string& name : names) {
    if (has(name)) continue;
    const auto like = std::find_if(names_.begin(), names_.end(), [&](const std::string& n) {
      return bare(n) == bare(name) || bare(parts_of(n).base) == bare(parts_of(name).base);
    });
    const std::string found = like == names_.end() ? std::string() : *like;
    return fail("ID100", fmt::format("the column {} is missing", name), Place{path, header_line, 1},
                found.empty() ? fmt::format("the columns are: {}", fmt::join(names_, ", "))
                              : fmt::format("is it the column \"{0}\"? Say so by --columns \"{1}={0}\"", found, name));
  }
  if (rows.empty()) return fail("ID102", "the file has no rows", Place{path, 0, 0});
  return {};
}

std::string Table::text(const Row& row, std::string_view name) const {
  const Column* column = find(name);
  return column == nullptr || column->cell >= row.cells.size() ? std::string() : row.cells[column->cell];
}

namespace {

/// The place of a cell, as far as its file can be read again; else that of its row. Columns count bytes.
Place place_of_cell(const Table& table, const Table::Row& row, std::size_t cell) {
  Place place = table.place_of(row);
  const auto line = line_of(row.file, row.line), header = line_of(table.path, table.header_line);
  for (const auto& by : {header, line}) {  // the row itself where a remark names the columns
    if (!line || !by) continue;
    std::vector<std::size_t> begins;
    const std::vector<std::string> cells = cells_of(*line, separator_of(trimmed(*by)), &begins);
    const auto same = [](char a, char b) { return a == b || (a == '.' && b == ','); };
    if (cell >= cells.size() || cell >= row.cells.size() ||
        !std::equal(row.cells[cell].begin(), row.cells[cell].end(), cells[cell].begin(), cells[cell].end(), same)) {
      continue;  // files that were joined: the cell is in another one
    }
    place.column = static_cast<int>(begins[cell]) + 1;
    return place;
  }
  return place;
}

}  // namespace

Result<double> Table::number(const Row& row, std::string_view name) const {
  const std::string cell = text(row, name);
  const std::optional<double> value = number_in(cell, false);
  const Column* column = find(name);
  if (!value) {
    return fail("ID101", fmt::format("{} = \"{}\" is not a finite number", name, cell),
                column == nullptr ? place_of(row) : place_of_cell(*this, row, column->cell));
  }
  const double out = column->factor == 1 ? *value : *value * column->factor;
  // Lengths as those of machines (1e6 m); of everything else no instrument shows more, and sums and squares stay
  // finite.
  const double most = name.ends_with("_mm") ? 1e9 : 1e15;
  if (std::abs(out) > most) {
    return fail("ID101", fmt::format("{} = \"{}\": beyond {:g}, more than can be measured", name, cell, most),
                place_of_cell(*this, row, column->cell), "check the unit and the decimal point");
  }
  return out;
}

Result<double> Table::number(const Row& row, std::string_view name, double otherwise) const {
  return text(row, name).empty() ? Result<double>(otherwise) : number(row, name);
}

Result<std::vector<std::string>> Table::unused() const {
  std::set<std::size_t> used;
  std::vector<std::string> missing;
  for (const std::string& name : *asked_) {
    const auto it = columns_.find(name);
    if (it != columns_.end()) used.insert(it->second.cell);
    if (it == columns_.end()) missing.push_back(name);
  }
  std::vector<std::string> out;
  for (std::size_t i = 0; i < names_.size(); ++i) {
    if (used.contains(i) || names_[i].empty()) continue;
    const std::string own = bare(names_[i]), own_base = bare(parts_of(names_[i]).base);
    for (const std::string& name : missing) {
      const std::string wanted = bare(name);
      const bool alike = own == wanted || own_base == bare(parts_of(name).base) ||
                         (wanted.size() >= kLongName && one_off(own, wanted));
      if (!alike) continue;
      return fail(
          "ID108", fmt::format("the column \"{}\" is not known; {} is", names_[i], name), Place{path, header_line, 1},
          fmt::format("name it {1}, or say --columns \"{1}={0}\"; or take it out of the file", names_[i], name));
    }
    out.push_back(names_[i]);
  }
  return out;
}

Result<Table> joined(const std::vector<Table>& tables, const std::string& key, std::vector<std::string>& left_out) {
  const auto twice = [](const Table& t, const Place& place, const std::string& what) {
    return fail("ID106", fmt::format("{} occurs twice", what), place,
                t.rows.empty() ? "" : "each point has one name, and each column is in one file");
  };
  Table out = tables.front();
  for (std::size_t k = 1; k < tables.size(); ++k) {
    const Table& more = tables[k];
    for (const Table* t : {static_cast<const Table*>(&out), &more}) {
      if (t->has(key)) continue;
      return fail("ID100", fmt::format("the column {}, by which files are joined, is missing", key),
                  Place{t->path, t->header_line, 1});
    }
    std::map<std::string, const Table::Row*, std::less<>> others;
    for (const Table::Row& row : more.rows) {
      const std::string name = more.text(row, key);
      if (!others.try_emplace(name, &row).second) return twice(more, more.place_of(row), key + " = " + name);
    }
    const std::size_t width = out.names_.size(), key_cell = more.columns_.find(key)->second.cell;
    for (const auto& [name, column] : more.columns_) {
      if (column.cell == key_cell) continue;
      if (!out.columns_.try_emplace(name, Table::Column{column.cell + width, column.factor}).second) {
        return twice(more, {more.path, more.header_line, 1}, fmt::format("the column \"{}\"", name));
      }
    }
    out.names_.insert(out.names_.end(), more.names_.begin(), more.names_.end());
    out.names_[out.columns_.find(key)->second.cell] = out.names_[width + key_cell] = "";  // used, by this
    std::vector<Table::Row> rows;
    std::set<std::string, std::less<>> seen;
    for (Table::Row& row : out.rows) {
      const std::string name = out.text(row, key);
      if (!seen.insert(name).second) return twice(out, out.place_of(row), key + " = " + name);
      const auto it = others.find(name);
      if (it == others.end()) {
        left_out.push_back(name);
        continue;
      }
      row.cells.resize(width);
      row.cells.insert(row.cells.end(), it->second->cells.begin(), it->second->cells.end());
      rows.push_back(std::move(row));
      others.erase(it);
    }
    for (const auto& [name, row] : others) left_out.push_back(name);
    if (rows.empty()) {
      return fail("ID102", fmt::format("no {} of {} is in {}", key, out.path, more.path),
                  Place{more.path, more.header_line, 1});
    }
    out.rows = std::move(rows);
  }
  return out;
}

Status no_row_twice(const Table& table) {
  std::map<std::vector<std::string>, int> seen;
  for (const Table::Row& row : table.rows) {
    const auto [it, fresh] = seen.try_emplace(row.cells, row.line);
    if (!fresh) {
      return fail("ID103", fmt::format("the row is already in line {}", it->second), table.place_of(row),
                  "a row that occurs twice would count twice");
    }
  }
  return {};
}

}  // namespace polypod::csv
