// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The elements of an XML text with their places. Nothing is expanded and nothing recurses: a hostile text costs no more
// than its length.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::machine::xml {

struct Attribute {
  std::string_view name, value;  ///< as written: entities such as &amp; stay
  int line = 0, column = 0;
};

struct Element {
  std::string_view name;
  std::vector<Attribute> attributes;
  int line = 0, column = 0;
  int parent = -1;                 ///< its index; -1 of the root
  int depth = 0;                   ///< 1: the root
  std::size_t begin = 0, end = 0;  ///< its text, tags included

  [[nodiscard]] const Attribute* attribute(std::string_view wanted) const;
};

/// What a reader keeps, and the most that it takes.
struct Limits {
  int kept_depth = 3;              ///< elements deeper than this are checked and not kept
  int depth = 64;                  ///< MA181 beyond
  std::size_t bytes = 16U << 20U;  ///< MA181 beyond
  std::size_t elements = 200'000;  ///< of those kept; MA181 beyond
};

/// The elements in the order of their start tags. Checks what makes a text well-formed as far as elements go: tags that
/// match, one root, quoted attributes, each once. Errors: MA180 (not well-formed), MA181 (too large, too deep, or with
/// a document type, whose entities could make it any size).
Result<std::vector<Element>> scan(std::string_view text, const std::string& file, const Limits& limits = {});

}  // namespace polypod::machine::xml
