// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The elements of an XML text with their places. Nothing is expanded and nothing recurses: a hostile text costs no more
// than its length.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::xml {

struct Attribute {
  std::string_view name, value;  ///< as written: entities such as &amp; stay
  int line = 0, column = 0;
};

struct Element {
  std::string_view name;
  std::vector<Attribute> attributes;
  int line = 0, column = 0;
  int parent = -1;           ///< its index; -1 of the root
  int depth = 0;             ///< 1: the root
  std::string_view content;  ///< from the start tag to the next tag, as written

  [[nodiscard]] const Attribute* attribute(std::string_view wanted) const;
};

/// What a message may show of a name or a value: its first 60 bytes, on one line.
std::string shown(std::string_view text);

/// How much of a text is read.
struct Bounds {
  std::size_t bytes = std::size_t{16} << 20U;
  int depth = 3;  ///< what lies deeper is checked and not kept
};

/// The elements in the order of their start tags. Checks what makes a text well-formed as far as elements go: tags that
/// match, one root, quoted attributes, each once. Errors: MA180 (not well-formed), MA181 (beyond the bounds, 64 deep,
/// 200 000 elements kept or 100 attributes of one; or with a document type, whose entities could make it any size).
Result<std::vector<Element>> scan(std::string_view text, const std::string& file, const Bounds& bounds = {});

}  // namespace polypod::xml
