// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "json_rows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>
#include <utility>

#include "messages.hpp"

namespace polypod::app {
namespace {

constexpr int kIndent = 2;

void round_numbers(Json& value) {
  if (value.is_structured()) {
    for (Json& part : value) round_numbers(part);
  } else if (value.is_number_float()) {
    const double x = value.get<double>();
    if (std::isfinite(x) && x != std::round(x)) value = std::strtod(fmt::format("{:.15g}", x).c_str(), nullptr);
  }
}

void print(std::string_view text) {
  std::fwrite(text.data(), 1, text.size(), stdout);
}

/// The rows with what stands between them, two levels deep.
void print_rows(const JsonRows& list) {
  const std::string begin(std::size_t{2} * kIndent, ' ');
  bool any = false;
  std::string text;
  for (std::size_t i = 0; i < list.count; ++i) {
    const std::optional<Json> row = list.row(i);
    if (!row) continue;
    text = any ? ",\n" : "\n";
    text += begin;
    for (const char c : json_text(*row)) {
      text += c;
      if (c == '\n') text += begin;
    }
    print(text);
    any = true;
  }
  if (any) print(fmt::format("\n{:{}}", "", kIndent));
}

}  // namespace

std::string json_text(Json document) {
  round_numbers(document);
  return document.dump(kIndent, ' ', false, Json::error_handler_t::replace);  // names may hold bytes that are not UTF-8
}

void print_json(const Json& document, const std::vector<JsonRows>& lists) {
  const std::string text = json_text(document);
  // Where each list begins: a line break stands in no string, so a line of this indentation is the document's own key.
  std::vector<std::pair<std::size_t, const JsonRows*>> places;
  for (const JsonRows& list : lists) {
    const std::string line = fmt::format("\n  \"{}\": [", list.key);
    if (const std::size_t at = text.find(line); at != std::string::npos) places.emplace_back(at + line.size(), &list);
  }
  std::sort(places.begin(), places.end());
  std::size_t from = 0;
  for (const auto& [at, list] : places) {
    print(std::string_view(text).substr(from, at - from));
    print_rows(*list);
    from = at;
  }
  print(std::string_view(text).substr(from));
  print("\n");
}

}  // namespace polypod::app
