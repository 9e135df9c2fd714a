// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Reading TOML files with a place for every value, ranges, and an error for every unknown key.
#pragma once

#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::config {

class Value;
using Array = std::vector<Value>;

/// The range that a number must lie in, and whether its ends are allowed.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool open_min = false;
  bool open_max = false;
};
inline constexpr Range kAnyFinite{};
inline constexpr Range kPositive{0, std::numeric_limits<double>::infinity(), true, false};
inline constexpr Range kNotNegative{0, std::numeric_limits<double>::infinity(), false, false};

/// A TOML table that remembers which of its keys were asked for.
///
/// Ask for every key that may stand in the table (`number`, `text`, ... for those that must be there, `optional_...`
/// for the others), then call `finish()`: it fails with CF103 on the first key that nobody asked for. Every error
/// carries the file, line and column of the value, or of the table where a value is missing. A number under a key that
/// ends in `_mm` must be at most 1e9 (1000 km) in size, one in `_deg` at most 1e6, whatever the range says.
class Table {
 public:
  Table() = default;
  Table(std::map<std::string, Value> values, Place place, std::string name);

  [[nodiscard]] const Place& place() const { return place_; }
  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] bool has(std::string_view key) const;
  [[nodiscard]] bool holds_text(std::string_view key) const;  ///< the key is there and its value is a text
  [[nodiscard]] std::vector<std::string> keys() const;        ///< in alphabetical order
  [[nodiscard]] Place place_of(std::string_view key) const;

  Result<double> number(std::string_view key, Range range = kAnyFinite) const;
  Result<double> optional_number(std::string_view key, double otherwise, Range range = kAnyFinite) const;
  Result<int> integer(std::string_view key, int min, int max) const;
  Result<int> optional_integer(std::string_view key, int otherwise, int min, int max) const;
  Result<std::string> text(std::string_view key) const;
  Result<std::string> optional_text(std::string_view key, std::string otherwise) const;
  Result<bool> optional_boolean(std::string_view key, bool otherwise) const;
  /// Numbers in an array; `size` 0 means any. In messages elements count from 1, as in `replace`.
  Result<std::vector<double>> numbers(std::string_view key, std::size_t size = 0, Range range = kAnyFinite) const;
  Result<std::vector<std::vector<double>>> points(std::string_view key, std::size_t columns) const;
  Result<std::vector<std::string>> optional_texts(std::string_view key) const;
  /// A table inside this one; call its own `finish()`.
  Result<Table> table(std::string_view key) const;
  Result<std::optional<Table>> optional_table(std::string_view key) const;
  /// An array of tables (`[[key]]` or `key = [{...}, ...]`); empty if the key is absent.
  Result<std::vector<Table>> tables(std::string_view key) const;

  /// Puts a number at a dotted path: `a.b`, `rows[2].x` (arrays count from 1). The table on the way must exist; the
  /// last key may be new, so that an optional one can be given (an unknown one is found by `finish()`). Tables on the
  /// way that are not there are made where `create` says so. False if the way does not exist.
  bool replace(std::string_view path, double value, bool create = false);

  /// Puts a table in the place of the text at a path of the same kind. False if there is none.
  bool put(std::string_view path, const Table& table);

  /// Fails if a key of this table was never asked for (CF103).
  [[nodiscard]] Status finish() const;

 private:
  const Value* find(std::string_view key) const;
  bool replace_value(std::string_view path, const Value& value, bool create);
  tl::unexpected<Error> missing(std::string_view key) const;

  std::map<std::string, Value> values_;
  Place place_;
  std::string name_;
  std::shared_ptr<std::map<std::string, bool>> asked_ = std::make_shared<std::map<std::string, bool>>();
};

/// One TOML value and its place. Dates are not used by any Polypod file and are refused (CF102).
class Value {
 public:
  std::variant<bool, double, std::string, Array, Table> data;
  bool is_integer = false;
  Place place;
};

/// Reads a TOML file. Errors: FI100 (cannot be read), CF101 (not TOML), CF102 (a type that no file uses), CF108 (keys,
/// tables or arrays inside each other more than 16 deep).
Result<Table> read_file(const std::string& path);

/// The same from text; `name` stands for the file in error messages.
Result<Table> parse(std::string_view text, const std::string& name);

/// `part` relative to the folder of the file `of` (unchanged if it is absolute).
std::string beside(const std::string& of, const std::string& part);

}  // namespace polypod::config
