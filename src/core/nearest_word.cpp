// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/nearest_word.hpp"

#include <algorithm>
#include <cctype>

namespace polypod {
namespace {

std::string plain(std::string_view word) {
  std::string out;
  for (const char c : word) out += c == '_' ? '-' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return out;
}

/// Optimal string alignment, by rows of the table of distances between beginnings.
std::size_t distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> before, last(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) last[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
      const bool exchanged = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (exchanged) row[j] = std::min(row[j], before[j - 2] + 1);
    }
    before = last;
    last = row;
  }
  return last[b.size()];
}

constexpr std::size_t kLongest = 64, kLeastBeginning = 3;

}  // namespace

std::string nearest_word(std::string_view word, const std::vector<std::string>& known) {
  if (word.empty() || word.size() > kLongest) return "";
  const std::string given = plain(word);
  const std::string* best = nullptr;
  std::size_t least = 0;
  bool best_begins = false;
  for (const std::string& candidate : known) {
    if (candidate.empty() || candidate.size() > kLongest) continue;
    const std::string other = plain(candidate);
    const std::size_t away = distance(given, other);
    const bool begins = given.front() == other.front();
    if (away > (std::max(given.size(), other.size()) + 1) / 3) continue;
    if (best != nullptr && (away > least || (away == least && (best_begins || !begins)))) continue;
    best = &candidate;
    least = away;
    best_begins = begins;
  }
  if (best != nullptr) return *best;
  if (given.size() < kLeastBeginning) return "";
  const auto begins = [&](const std::string& candidate) { return plain(candidate).starts_with(given); };
  if (std::count_if(known.begin(), known.end(), begins) != 1) return "";
  return *std::find_if(known.begin(), known.end(), begins);
}

std::string did_you_mean(std::string_view word, const std::vector<std::string>& known) {
  const std::string near = nearest_word(word, known);
  return near.empty() ? "" : "did you mean " + near + "? ";
}

}  // namespace polypod
