// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/csv.hpp"

#include <fmt/format.h>

#include <cmath>

namespace polypod::report {
namespace {

std::string field_text(const Csv::Field& field) {
  if (const double* x = std::get_if<double>(&field)) return std::isfinite(*x) ? fmt::format("{}", *x) : "";
  const std::string& text = std::get<std::string>(field);
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) {
    quoted += c;
    if (c == '"') quoted += c;
  }
  return quoted + '"';
}

}  // namespace

Csv::Csv(std::vector<std::string> columns) : columns_(columns.size()) {
  add(std::vector<Field>(columns.begin(), columns.end()));
}

void Csv::add(const std::vector<Field>& row) {
  for (std::size_t i = 0; i < columns_; ++i) {
    if (i > 0) text_ += ',';
    if (i < row.size()) text_ += field_text(row[i]);
  }
  text_ += '\n';
}

}  // namespace polypod::report
