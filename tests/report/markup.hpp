// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A look at the tags of a page or a picture, for tests.
#pragma once

#include <set>
#include <string>
#include <vector>

namespace polypod::report {

/// Walks the tags of a page: every tag that opens is closed in order, ids are unique, references within the page lead
/// somewhere. Empty if so, else what is wrong.
inline std::string what_is_wrong(const std::string& html) {
  static const std::set<std::string> kVoid{"meta", "br", "hr", "link", "input", "wbr", "!DOCTYPE"};
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

}  // namespace polypod::report
