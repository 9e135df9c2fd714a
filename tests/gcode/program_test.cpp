// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The reader: what it keeps, what it understands, what it refuses.
#include "polypod/gcode/program.hpp"

#include <gtest/gtest.h>

#include <string>
#include <tuple>
#include <vector>

namespace polypod::gcode {
namespace {

Program good(const std::string& text) {
  auto program = parse(text, "part.ngc");
  EXPECT_TRUE(program.has_value()) << text << "\n" << to_string(program.error());
  if (!program) return {};
  EXPECT_EQ(to_text(*program), text);
  return std::move(*program);
}

struct Bad {
  std::string text, id;
  int line, column;
};

TEST(Parse, KeepsEveryByte) {
  for (const std::string text : {
           "",
           "\n",
           "\r\n",
           "\n\n\n",
           "G0 X1",
           "G0 X1\n",
           "G0 X1\r\nG1Y2F3\r\n",
           "%\nG0X1\n%\n",
           "\t G 0 X 1 . 5 \t\n",
           "g1x-.5y+2.f100(a comment)z1;and (more\n",
           "/N10 G0 X1\n",
           "O1000 (NAME)\nG0 X1\r\r\nM30\n#$!\"any text at all\n",
           "%\nG0\n%\nafter the end: \xff\x00(((\n",
           "(\xc3\xa4 \xff)\nN5 T1\n",
           "#1=5\no100 sub\nG0 X[1+2] Y#3\n",
       }) {
    good(text);
  }
}

TEST(Parse, FindsWordsWithTheirPlaces) {
  const Program program = good("/ n 10 g1 X 1 0.5y-.5 (x9) F+200.\r\nM2");
  ASSERT_EQ(program.blocks.size(), 2u);
  const Block& block = program.blocks[0];
  EXPECT_TRUE(block.optional);
  EXPECT_EQ(block.ending, "\r\n");
  EXPECT_EQ(program.blocks[1].ending, "");
  EXPECT_EQ(program.blocks[1].line, 2);
  struct Expected {
    char letter;
    double value;
    int column, length;
  };
  const std::vector<Expected> expected{
      {'N', 10, 3, 4}, {'G', 1, 8, 2}, {'X', 10.5, 11, 7}, {'Y', -0.5, 18, 4}, {'F', 200, 28, 6}};
  ASSERT_EQ(block.words.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(block.words[i].letter, expected[i].letter) << i;
    EXPECT_EQ(block.words[i].value, expected[i].value) << i;
    EXPECT_EQ(block.words[i].column, expected[i].column) << i;
    EXPECT_EQ(block.words[i].length, expected[i].length) << i;
  }
}

TEST(Parse, MarksConstructsAndTheEnd) {
  const Program program = good("#1=5\nG0 X[1]\no100 sub\nO<name> call [1]\nO1000\nM30\nG0 X\n");
  EXPECT_EQ(program.blocks[0].construct, Construct::parameter);
  EXPECT_EQ(program.blocks[1].construct, Construct::expression);
  EXPECT_EQ(program.blocks[1].construct_column, 5);
  EXPECT_EQ(program.blocks[2].construct, Construct::o_word);
  EXPECT_EQ(program.blocks[3].construct, Construct::o_word);
  EXPECT_EQ(program.blocks[4].construct, Construct::none);
  EXPECT_FALSE(program.blocks[5].after_end);
  EXPECT_TRUE(program.blocks[6].after_end);
}

TEST(Parse, MarksValuesThatAreNoNumbers) {
  for (const auto& [text, construct, column] :
       std::vector<std::tuple<std::string, Construct, int>>{{"G0 X-#1", Construct::parameter, 5},
                                                            {"G0 X - [1]", Construct::expression, 6},
                                                            {"G0 X sin [30]", Construct::expression, 6},
                                                            {"G0 X1 Y#<name>", Construct::parameter, 8}}) {
    const Program program = good(text);
    EXPECT_EQ(program.blocks[0].construct, construct) << text;
    EXPECT_EQ(program.blocks[0].construct_column, column) << text;
  }
}

TEST(Parse, RefusesWithPlaceAndId) {
  const std::vector<Bad> cases{
      {"G0 X1\nG1 Y2&\n", "GC100", 2, 6},
      {"G0 X1 \xc3\xa4\n", "GC100", 1, 7},
      {"G0 X1\rG0 Y1\n", "GC100", 1, 6},
      {"; a\rG0 Y1\n", "GC100", 1, 4},
      {"\xef\xbb\xbfG0 X1\n", "GC100", 1, 1},
      {"G0 X1 Y", "GC101", 1, 7},
      {"G0 X (a) 1\n", "GC101", 1, 4},
      {"G1 X1.5.2\n", "GC102", 1, 8},
      {"G1 X--\n", "GC102", 1, 6},
      {"G1 X.\n", "GC102", 1, 5},
      {"G1 X-\n", "GC102", 1, 5},
      {"G1 X1-2\n", "GC102", 1, 6},
      {"G1 X" + std::string(310, '9') + "\n", "GC102", 1, 4},
      {"G0 (open\n", "GC103", 1, 4},
      {"G0 (a (b) c)\n", "GC103", 1, 7},
      {"G0 X1\n%\n", "GC105", 2, 1},
      {"%\nG0 X1 %\n", "GC105", 2, 7},
      {"% G0\n", "GC105", 1, 3},
      {"G0 / X1\n", "GC106", 1, 4},
      {"G0 X1*62\n", "GC107", 1, 6},
      {"\n\nG0 X1 )\n", "GC100", 3, 7},
      {"G0 X Y[1]\n", "GC101", 1, 4},
  };
  for (const Bad& bad : cases) {
    const auto program = parse(bad.text, "part.ngc");
    ASSERT_FALSE(program.has_value()) << bad.text;
    EXPECT_EQ(program.error().id, bad.id) << bad.text << to_string(program.error());
    EXPECT_EQ(program.error().place.line, bad.line) << bad.text;
    EXPECT_EQ(program.error().place.column, bad.column) << bad.text;
    EXPECT_EQ(program.error().place.file, "part.ngc");
  }
}

}  // namespace
}  // namespace polypod::gcode
