// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/nearest_word.hpp"

#include <gtest/gtest.h>

namespace polypod {
namespace {

const std::vector<std::string> kCommands{"ik",         "fk",      "workspace", "section", "errors",
                                         "tolerances", "correct", "check",     "canon"};

TEST(NearestWord, LettersPutInLeftOutReplacedOrExchanged) {
  EXPECT_EQ(nearest_word("workspac", kCommands), "workspace");
  EXPECT_EQ(nearest_word("workkspace", kCommands), "workspace");
  EXPECT_EQ(nearest_word("worKspaze", kCommands), "workspace");
  EXPECT_EQ(nearest_word("wrokspace", kCommands), "workspace");
  EXPECT_EQ(nearest_word("corect", kCommands), "correct");
  EXPECT_EQ(nearest_word("error", kCommands), "errors");
  EXPECT_EQ(nearest_word("--toleranse", {"--tilt", "--tolerance", "--threads"}), "--tolerance");
  EXPECT_EQ(nearest_word("--rel_tol", {"--rel-tol", "--real"}), "--rel-tol");
}

TEST(NearestWord, ExchangedNeighboursAreOneStep) {
  // Without exchanges "ki" is two letters from "ik", which is too far for words of two.
  EXPECT_EQ(nearest_word("ki", kCommands), "ik");
  EXPECT_EQ(nearest_word("abcd", {"dcba"}), "");
}

TEST(NearestWord, TheFirstLetterDecidesBetweenWordsAsNear) {
  EXPECT_EQ(nearest_word("fit", {"bit", "fin"}), "fin");
  EXPECT_EQ(nearest_word("fit", {"fin", "bit"}), "fin");
  EXPECT_EQ(nearest_word("fit", {"fix", "fin"}), "fix");
}

TEST(NearestWord, TheBeginningOfOneWordAlone) {
  EXPECT_EQ(nearest_word("work", kCommands), "workspace");
  EXPECT_EQ(nearest_word("tol", {"tolerances", "tolerance-report"}), "");
  EXPECT_EQ(nearest_word("wo", kCommands), "");
}

TEST(NearestWord, NothingIsNear) {
  EXPECT_EQ(nearest_word("", kCommands), "");
  EXPECT_EQ(nearest_word("banana", kCommands), "");
  EXPECT_EQ(nearest_word("xy", kCommands), "");
  EXPECT_EQ(nearest_word("correct", {}), "");
  EXPECT_EQ(nearest_word(std::string(3000, 'x'), {std::string(3000, 'x')}), "");
}

TEST(NearestWord, AsAQuestion) {
  EXPECT_EQ(did_you_mean("corect", kCommands), "did you mean correct? ");
  EXPECT_EQ(did_you_mean("banana", kCommands), "");
}

}  // namespace
}  // namespace polypod
