// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/text.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "polypod/core/config.hpp"
#include "polypod/core/toml.hpp"

namespace polypod {
namespace {

TEST(OneLine, PlainTextStaysAsItIs) {
  for (const char* text : {"", "lola50", "a \\ b (c) % ; \"d\"", "h\u00fclse \u017dirafa \u6c34 \U0001F600"}) {
    EXPECT_EQ(one_line(text), text);
  }
}

TEST(OneLine, WhatATerminalActsOnIsShown) {
  EXPECT_EQ(one_line("a\nloadusr x\r\t\x1b[2J\x7f"), "a\\x0aloadusr x\\x0d\\x09\\x1b[2J\\x7f");
  EXPECT_EQ(one_line(std::string_view("a\0b", 3)), "a\\x00b");
  EXPECT_EQ(one_line("\u009b31m"), "\\xc2\\x9b31m") << "the control sequence introducer in one character";
  EXPECT_EQ(one_line("\u202egnp.exe\u2028x"), "\\xe2\\x80\\xaegnp.exe\\xe2\\x80\\xa8x");
}

TEST(OneLine, WhatIsNotUtf8IsShown) {
  EXPECT_EQ(one_line("\xff\x80"), "\\xff\\x80");
  EXPECT_EQ(one_line("a\xe2\x80"), "a\\xe2\\x80") << "cut off";
  EXPECT_EQ(one_line("\xc0\xaf"), "\\xc0\\xaf") << "an overlong slash";
  EXPECT_EQ(one_line("\xe0\x80\x8a"), "\\xe0\\x80\\x8a") << "an overlong newline";
  EXPECT_EQ(one_line("\xed\xa0\x80"), "\\xed\\xa0\\x80") << "a surrogate";
  EXPECT_EQ(one_line("\xf4\x90\x80\x80"), "\\xf4\\x90\\x80\\x80") << "above U+10FFFF";
}

TEST(OneLine, TwiceIsOnceAndNoByteBelowASpaceIsLeft) {
  EXPECT_TRUE(rc::check([](const std::string& text) {
    const std::string once = one_line(text);
    RC_ASSERT(one_line(once) == once);
    for (const char c : once) RC_ASSERT(static_cast<unsigned char>(c) >= 0x20 && c != 0x7f);
  }));
}

/// What the reader of TOML files makes of the written text.
std::string back(std::string_view text) {
  const auto table = config::parse("name = " + quoted_toml(text) + "\n", "a.toml");
  if (!table) return to_string(table.error());
  const auto name = table->text("name");
  return name ? *name : to_string(name.error());
}

TEST(QuotedToml, EveryTextIsReadBack) {
  using namespace std::string_view_literals;
  for (const std::string_view text : {""sv, "steel 1/2\" bar"sv, "C:\\new"sv, "a\nKtc_N_per_mm2 = 1"sv,
                                      "\x1b[2J\t\r\x7f"sv, "a\0b"sv, "h\u00fclse"sv}) {
    EXPECT_EQ(back(text), text);
  }
  EXPECT_EQ(back("a\xff\x80z"), "a\uFFFD\uFFFDz") << "what is not UTF-8";
}

TEST(QuotedToml, AnyBytesMakeOneReadableText) {
  EXPECT_TRUE(rc::check([](const std::string& text) {
    const auto table = config::parse("name = " + quoted_toml(text) + "\n", "a.toml");
    RC_ASSERT(static_cast<bool>(table));
    RC_ASSERT(table->keys().size() == 1U);
  }));
}

}  // namespace
}  // namespace polypod
