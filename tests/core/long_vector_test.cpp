// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Against std::vector, below and beyond what is kept in memory.
#include "polypod/core/long_vector.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <random>
#include <thread>
#include <vector>

namespace polypod {
namespace {

/// 40 bytes, which do not divide a part.
struct Element {
  std::uint64_t a = 0, b = 0, c = 0, d = 0, e = 0;
  friend bool operator==(const Element&, const Element&) = default;
};

Element element(std::uint64_t i) {
  return {i, i * i, i ^ 0x5555, ~i, i + 1};
}

/// Bytes that the process holds in memory.
struct Resident {
  std::size_t all = 0, of_files = 0;  ///< bytes
};
Resident resident() {
  std::ifstream statm("/proc/self/statm");
  std::size_t total = 0, held = 0, shared = 0;
  statm >> total >> held >> shared;
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  return {held * page, shared * page};
}
// The address sanitizer keeps a byte of its own for every eight that are looked at: up to the kernel, they stay.
#if defined(__SANITIZE_ADDRESS__)
constexpr bool kSanitized = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif
#else
constexpr bool kSanitized = false;
#endif
/// Whether little more is held than before: what all rows may hold together.
void expect_little_more(const Resident& before) {
  constexpr std::size_t kMost = LongBytes::kHeld + 4'000'000;
  const Resident now = resident();
  EXPECT_LT(now.of_files, before.of_files + kMost);
  if (!kSanitized) {
    EXPECT_LT(now.all, before.all + kMost);
  }
}

constexpr std::size_t kFew = 100, kMany = 2'000'000;

TEST(LongVector, HoldsWhatAVectorHolds) {
  for (const std::size_t count : {kFew, kMany / 10}) {
    std::vector<Element> expected;
    LongVector<Element> found;
    std::mt19937_64 random(count);
    for (std::size_t i = 0; i < count; ++i) {
      expected.push_back(element(random()));
      found.push_back(expected.back());
      if (i % 100 != 0) continue;
      const std::size_t k = random() % expected.size();
      expected[k] = element(i);
      found[k] = element(i);
      found.push_back(found[k]);  // one of its own, which may move meanwhile
      expected.push_back(element(i));
    }
    ASSERT_EQ(found.size(), expected.size());
    EXPECT_TRUE(std::equal(found.begin(), found.end(), expected.begin()));
    EXPECT_EQ(found.front(), expected.front());
    EXPECT_EQ(found.back(), expected.back());
    const auto by_a = [](const Element& x, const Element& y) { return x.a < y.a; };
    std::stable_sort(found.begin(), found.end(), by_a);
    std::stable_sort(expected.begin(), expected.end(), by_a);
    EXPECT_TRUE(std::equal(found.begin(), found.end(), expected.begin()));
  }
}

TEST(LongVector, CopiesAndMoves) {
  LongVector<Element> one;
  for (std::size_t i = 0; i < kMany / 10; ++i) one.push_back(element(i));
  LongVector<Element> two = one;
  two[5] = element(99);
  EXPECT_EQ(one[5], element(5));
  const Element* place = &two[7];
  const LongVector<Element> three = std::move(two);
  EXPECT_EQ(&three[7], place) << "pointers stay valid";
  EXPECT_EQ(three[5], element(99));
  LongVector<Element> four{element(1), element(2)};
  four = three;
  EXPECT_EQ(four.size(), one.size());
  EXPECT_EQ(four[kMany / 20], element(kMany / 20));
  four.assign(3, element(4));
  EXPECT_EQ(four.size(), 3u);
  EXPECT_EQ(four[2], element(4));
}

// Three rows of 80 MB: vectors would hold them all.
TEST(LongVector, HoldsLittleOfItInMemory) {
  std::array<LongVector<Element>, 3> rows;
  const Resident before = resident();
  for (std::size_t i = 0; i < kMany; ++i)
    for (LongVector<Element>& v : rows) v.push_back(element(i));
  expect_little_more(before);
  std::uint64_t wrong = 0;
  for (const LongVector<Element>& v : rows) {
    for (std::size_t i = 0; i < kMany; ++i) wrong += v[i] == element(i) ? 0 : 1;
    for (std::size_t i = kMany; i-- > 0;) wrong += v[i].a == i ? 0 : 1;
  }
  EXPECT_EQ(wrong, 0u);
  expect_little_more(before);
}

// What a row held is free for others when it is gone.
TEST(LongVector, GivesBackWhatItHeld) {
  const Resident before = resident();
  for (int k = 0; k < 10; ++k) {
    LongVector<Element> v;
    for (std::size_t i = 0; i < kMany / 2; ++i) v.push_back(element(i));
    LongVector<Element> other = std::move(v);
    EXPECT_EQ(other[kMany / 4], element(kMany / 4));
    expect_little_more(before);
  }
}

TEST(LongVector, ThreadsReadAtDifferentPlaces) {
  LongVector<Element> v;
  for (std::size_t i = 0; i < kMany / 4; ++i) v.push_back(element(i));
  const auto wrong_from = [&](std::size_t first) {
    std::size_t wrong = 0;
    for (std::size_t k = 0; k < v.size(); ++k) {
      const std::size_t i = (first + k) % v.size();
      wrong += v[i] == element(i) ? 0 : 1;
    }
    return wrong;
  };
  std::size_t other = 1;
  std::thread thread([&] { other = wrong_from(v.size() / 2); });
  EXPECT_EQ(wrong_from(0), 0u);
  thread.join();
  EXPECT_EQ(other, 0u);
}

TEST(LongVector, StaysInMemoryWhereNoFileCanBe) {
  const char* before = std::getenv("TMPDIR");
  const std::string kept = before != nullptr ? before : "";
  ::setenv("TMPDIR", "/nowhere/at/all", 1);
  LongVector<Element> v;
  for (std::size_t i = 0; i < kMany / 10; ++i) v.push_back(element(i));
  before != nullptr ? ::setenv("TMPDIR", kept.c_str(), 1) : ::unsetenv("TMPDIR");
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < v.size(); ++i) wrong += v[i] == element(i) ? 0 : 1;
  EXPECT_EQ(wrong, 0u);
}

}  // namespace
}  // namespace polypod
