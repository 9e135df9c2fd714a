// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a person may have meant by a word that is not known.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace polypod {

/// The word of `known` that is nearest to `word`; empty where none is near.
///
/// Distance: the least number of letters that are put in, left out, replaced or exchanged with their neighbour (optimal
/// string alignment); capitals count as small letters, `_` as `-`. Near is a distance of at most (n + 1) / 3, n the
/// length of the longer word, rounded down. Of several as near, one with the same first letter, then the first of the
/// list. Where none is near, the only one that begins with `word`, if that has three letters at least. Words of more
/// than 64 letters are near to none. Cost: the product of the lengths, a known word.
std::string nearest_word(std::string_view word, const std::vector<std::string>& known);

/// "did you mean X? " with nearest_word, or nothing: to be put before a hint.
std::string did_you_mean(std::string_view word, const std::vector<std::string>& known);

}  // namespace polypod
