// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Tables as comma-separated text (RFC 4180), with the unit in the name of each column.
#pragma once

#include <string>
#include <variant>
#include <vector>

namespace polypod::report {

/// Rows under a header. Numbers are written with the fewest digits that read back to the same double; a number that is
/// not finite is an empty field. Lines end with \n.
class Csv {
 public:
  using Field = std::variant<double, std::string>;

  explicit Csv(std::vector<std::string> columns);
  /// Short rows are filled with empty fields; what is longer than the header is dropped.
  void add(const std::vector<Field>& row);
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::size_t columns_;
  std::string text_;
};

}  // namespace polypod::report
