// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/error.hpp"

#include <gtest/gtest.h>

namespace polypod {
namespace {

TEST(Error, OneLineHoldsIdPlaceMessageAndHint) {
  EXPECT_EQ(to_string(Error{"GC104", "G2 without I, J or R", {"part.ngc", 12, 9}, "give its centre or radius"}),
            "GC104 part.ngc:12:9: G2 without I, J or R; give its centre or radius");
}

TEST(Error, WhatIsNotKnownIsLeftOut) {
  EXPECT_EQ(to_string(Error{"FI100", "cannot be read", {"a.toml", 0, 0}, ""}), "FI100 a.toml: cannot be read");
  EXPECT_EQ(to_string(Error{"MA100", "no such machine", {}, "see `polypod machines`"}),
            "MA100: no such machine; see `polypod machines`");
}

TEST(Error, ALineWithoutColumnPointsToTheFirst) {
  EXPECT_EQ(to_string(Error{"CF106", "x is missing", {"a.toml", 3, 0}, ""}), "CF106 a.toml:3:1: x is missing");
}

Result<int> half(int x) {
  if (x % 2 != 0) return fail("TE100", "odd");
  return x / 2;
}
Status halves_twice(int x, int& out) {
  POLYPOD_ASSIGN(once, half(x));
  POLYPOD_TRY(half(once));
  out = *half(once);
  return {};
}

TEST(Error, TryAndAssignLeaveWithTheFirstError) {
  int out = 0;
  EXPECT_TRUE(halves_twice(12, out));
  EXPECT_EQ(out, 3);
  EXPECT_EQ(halves_twice(7, out).error().id, "TE100");
  EXPECT_EQ(halves_twice(6, out).error().id, "TE100");
  EXPECT_EQ(out, 3) << "nothing is assigned after an error";
}

TEST(Error, IsOneLineWhateverTheInputHolds) {
  EXPECT_EQ(to_string(Error{"CF103", "unknown key a\nb", Place{"x\x1b[31m.toml", 1, 2}, "c\rd"}),
            "CF103 x\\x1b[31m.toml:1:2: unknown key a\\x0ab; c\\x0dd");
}

}  // namespace
}  // namespace polypod
