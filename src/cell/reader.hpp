// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Reads a cell file, table by table: belts with what lies on them in read_belts.cpp, places, machines and tasks in
// read_work.cpp, bodies, guards, costs and planning in read_rest.cpp, the whole in read.cpp.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "polypod/cell/cell.hpp"
#include "polypod/core/config.hpp"
#include "polypod/core/nearest_word.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"

namespace polypod::cell {

using config::Range;
using config::Table;

inline constexpr Range kSize_mm{0, 1e5, true, false};  // up to 100 m
inline constexpr Range kMaybeSize_mm{0, 1e5};
inline constexpr Range kPlace_mm{-1e5, 1e5};
inline constexpr Range kAngle_deg{-3600, 3600};
inline constexpr Range kSpeed{0, 1e7, true, false};  // mm/s or deg/s and their derivatives are far below
inline constexpr Range kDerivative{0, 1e12, true, false};
inline constexpr Range kSeconds{0, 1e6};
inline constexpr Range kMilliseconds{0, 1e6};
inline constexpr Range kMoney{0, 1e12};
inline constexpr int kMostItems = 1'000'000, kMostSlots = 1000, kMostParts = 1000;

inline Result<Vec3> point(const Table& table, std::string_view key, double third = 0) {
  POLYPOD_ASSIGN(v, table.numbers(key, 0, kPlace_mm));
  if (v.size() == 2) v.push_back(units::to_mm(third));
  if (v.size() != 3) {
    return fail("CF105", fmt::format("{} has {} numbers; a point has 3: x, y, z", key, v.size()), table.place_of(key));
  }
  return Vec3(units::from_mm(v[0]), units::from_mm(v[1]), units::from_mm(v[2]));
}
inline Result<Vec3> optional_point(const Table& table, std::string_view key, const Vec3& otherwise) {
  if (!table.has(key)) return otherwise;
  return point(table, key);
}
inline Result<std::array<double, 2>> span(const Table& table, std::string_view key, double factor, Range range) {
  POLYPOD_ASSIGN(v, table.numbers(key, 2, range));
  return std::array{v[0] * factor, v[1] * factor};
}
inline Status ordered(const Table& table, std::string_view key, double low, double high) {
  if (low <= high) return {};
  return fail("CE105", fmt::format("{}: the first number is above the second", key), table.place_of(key),
              "give the lower end first");
}

/// A number of the table in mm, as m.
inline Result<double> length(const Table& table, std::string_view key, Range range = kSize_mm) {
  POLYPOD_ASSIGN(v, table.number(key, range));
  return units::from_mm(v);
}
inline Result<double> optional_length(const Table& table, std::string_view key, double otherwise,
                                      Range range = kMaybeSize_mm) {
  POLYPOD_ASSIGN(v, table.optional_number(key, units::to_mm(otherwise), range));
  return units::from_mm(v);
}
inline Result<double> optional_angle(const Table& table, std::string_view key, double otherwise) {
  POLYPOD_ASSIGN(v, table.optional_number(key, units::to_deg(otherwise), kAngle_deg));
  return units::from_deg(v);
}
inline Result<double> optional_ms(const Table& table, std::string_view key, double otherwise) {
  POLYPOD_ASSIGN(v, table.optional_number(key, otherwise / units::from_ms(1), kMilliseconds));
  return units::from_ms(v);
}

/// The index of a name in a list of things with names.
template <class T>
Result<int> index_of(const std::vector<T>& things, const Table& table, std::string_view key, const char* what) {
  POLYPOD_ASSIGN(name, table.text(key));
  std::vector<std::string> known;
  for (std::size_t i = 0; i < things.size(); ++i) {
    if (things[i].name == name) return static_cast<int>(i);
    known.push_back(things[i].name);
  }
  return fail("CE102", fmt::format("{} \"{}\": there is no {} of that name", key, one_line(name), what),
              table.place_of(key),
              known.empty() ? fmt::format("the cell has no {}", what)
                            : did_you_mean(name, known) + fmt::format("known here: {}", fmt::join(known, ", ")));
}

/// `conveyor.A.speed_mm_per_s` with the name replaced by its number in brackets: `conveyor[1].speed_mm_per_s`.
std::string by_number(const Table& top, const std::string& key);
/// Puts the numbers in. Error: CE108.
Status override_numbers(Table& top, const std::vector<Override>& overrides);
/// The machine of a [[machine]]: `file` beside the cell or of the catalogue, or `model`, the text of such a file; with
/// what `set` changes.
Result<machine::AnyMachine> machine_of(const Table& table, const std::string& file);

class Reader {
 public:
  explicit Reader(Table& top) : top_(top) {}

  Result<Cell> read(const std::string& file);

 private:
  Status head();

  /// The tables of a kind, not more than a cell can sensibly have.
  Result<std::vector<Table>> some(std::string_view key);

  Status fresh_name(const Table& table, std::string& out);

  Status item();

  Status container();

  Status conveyors();

  static std::pair<double, double> on_belt(const Conveyor& c, const Vec3& p);

  Status cameras();

  Status sources();

  Status needs_item(const Table& table);
  /// Whether items between these distances from the middle lie on the belt.
  Status on(const Conveyor& c, const Table& table, std::string_view key, double low, double high);

  Status spots();

  Status machines(const std::string& file);

  Status tasks();

  Status commands();

  Status bodies();

  Status guards();

  Status cost();

  Status planning();

  /// What only the whole tells.
  Status together();
  [[nodiscard]] bool reaches(int conveyor, double along, const Task& task) const;

  Table& top_;
  Cell cell_;
  std::set<std::string> names_;
  Table item_, container_;
};

}  // namespace polypod::cell
