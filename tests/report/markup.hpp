// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A look at the tags of a page or a picture, for tests.
#pragma once

#include <bit>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <set>
#include <string>
#include <vector>

#include "polypod/report/plot.hpp"

namespace polypod::report {

/// Walks the tags of a page: every tag that opens is closed in order, ids are unique, references within the page lead
/// somewhere. Empty if so, else what is wrong.
inline std::string what_is_wrong(const std::string& html) {
  static const std::set<std::string> kVoid{"meta", "br", "hr", "link", "input", "wbr", "img", "!DOCTYPE"};
  std::vector<std::string> open;
  std::set<std::string> ids, references;
  std::size_t i = 0;
  while ((i = html.find('<', i)) != std::string::npos) {
    if (html.compare(i, 8, "<script>") == 0 || html.compare(i, 7, "<style>") == 0) {
      const std::string end = html[i + 2] == 'c' ? "</script>" : "</style>";
      const std::size_t at = html.find(end, i);
      if (at == std::string::npos) return "no " + end;
      i = at + end.size();
      continue;
    }
    const std::size_t close = html.find('>', i);
    if (close == std::string::npos) return "a tag does not end";
    std::string tag = html.substr(i + 1, close - i - 1);
    if (tag.find('<') != std::string::npos) return "a < inside a tag: " + tag;
    i = close + 1;
    for (const char* attribute : {" id=\"", " href=\"#", "url(#"}) {
      const std::size_t at = tag.find(attribute);
      if (at == std::string::npos) continue;
      const std::size_t begin = at + std::string(attribute).size();
      const std::string value = tag.substr(begin, tag.find_first_of("\")", begin) - begin);
      if (attribute[1] == 'i') {
        if (!ids.insert(value).second) return "id twice: " + value;
      } else {
        references.insert(value);
      }
    }
    if (tag[0] == '/') {
      if (open.empty() || open.back() != tag.substr(1)) return "closes what is not open: " + tag;
      open.pop_back();
      continue;
    }
    const std::string name = tag.substr(0, tag.find_first_of(" /"));
    if (tag.back() != '/' && !kVoid.contains(name)) open.push_back(name);
  }
  if (!open.empty()) return "not closed: " + open.back();
  for (const std::string& reference : references) {
    if (!ids.contains(reference)) return "leads nowhere: #" + reference;
  }
  return "";
}

inline int count_of(const std::string& text, const std::string& part) {
  int n = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++n;
  return n;
}

/// The corners of an outline: one M, then l, h and v (relative), then z. No corners where it is written otherwise.
inline std::vector<Point> corners_of(const std::string& d) {
  std::vector<Point> out;
  char command = 0;
  const char* at = d.c_str();
  const auto number = [&] {
    while (*at == ' ') ++at;
    std::size_t length = 0;  // "-.4-3" are two numbers
    while (at[length] == '.' || std::isdigit(static_cast<unsigned char>(at[length])) || (length == 0 && *at == '-'))
      ++length;
    const double value = length > 0 ? std::stod(std::string(at, length)) : std::nan("");
    at += length;
    return value;
  };
  while (*at != 0 && *at != 'z') {
    if (std::isalpha(static_cast<unsigned char>(*at))) command = *at++;
    const Point last = out.empty() ? Point{} : out.back();
    if (command == 'h') {
      out.push_back({last.x + number(), last.y});
    } else if (command == 'v') {
      out.push_back({last.x, last.y + number()});
    } else if (command == 'M' || command == 'l') {
      const double x = number(), y = number();
      out.push_back({last.x + x, last.y + y});
    } else {
      return {};
    }
    if (!std::isfinite(out.back().x + out.back().y)) return {};
  }
  return out;
}

/// The bytes that base64 stands for.
inline std::vector<std::uint8_t> bytes_of(const std::string& base64) {
  std::vector<std::uint8_t> out;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : base64) {
    if (c == '=') break;
    const int digit = c >= 'A' && c <= 'Z'   ? c - 'A'
                      : c >= 'a' && c <= 'z' ? c - 'a' + 26
                      : c >= '0' && c <= '9' ? c - '0' + 52
                      : c == '+'             ? 62
                                             : 63;
    bits = bits << 6 | static_cast<std::uint32_t>(digit);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    out.push_back(static_cast<std::uint8_t>(bits >> count & 255U));
  }
  return out;
}

/// Numbers of one type from their bytes, on a little-endian machine.
template <class Number>
std::vector<Number> numbers_of(const std::vector<std::uint8_t>& bytes) {
  static_assert(std::endian::native == std::endian::little);
  std::vector<Number> out(bytes.size() / sizeof(Number));
  if (!out.empty()) std::memcpy(out.data(), bytes.data(), out.size() * sizeof(Number));
  return out;
}

}  // namespace polypod::report
