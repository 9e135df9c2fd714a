// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A line in words: what it says must be what it does.
#include "polypod/gcode/explain.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

namespace polypod::gcode {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::string_view kProgram = R"(G21 G17 G90 G94 G54 (start)
T1 M6
G43 H1
S8000 M3
#1 = 5
o1 if [#1 GT 3]
G0 X[#1*2] Y5 Z5
G20 G1 Z-1 F10
o1 endif
o2 if [#1 LT 3]
G1 X4
o2 endif
o3 repeat [4]
#1 = [#1 + 1]
G91 X[#1]
o3 endrepeat
G3 I1 P2
G64 P0.01 Q0.02
M2
)";

Explanation explained(int line, std::string_view text = kProgram) {
  const auto program = parse(text, "p.ngc");
  EXPECT_TRUE(program);
  const auto e = explain(*program, line);
  EXPECT_TRUE(e) << (e ? "" : to_string(e.error()));
  return e ? *e : Explanation{};
}
std::string meaning(const std::vector<Explanation::Meaning>& list, std::string_view word) {
  for (const auto& one : list)
    if (one.word == word) return one.meaning;
  return "-";
}

TEST(Explain, WordsHaveTheValuesOfTheirExpressions) {
  const Explanation e = explained(7);
  EXPECT_EQ(e.text, "G0 X[#1*2] Y5 Z5");
  EXPECT_EQ(meaning(e.words, "X10"), "to 10 mm");
  EXPECT_THAT(meaning(e.words, "G0"), HasSubstr("rapid"));
  EXPECT_EQ(e.to[0], 10);
  EXPECT_EQ(e.to[2], 5);
  EXPECT_THAT(e.calls, testing::ElementsAre(HasSubstr("STRAIGHT_TRAVERSE(10.0000, 5.0000, 5.0000")));
  EXPECT_EQ(meaning(e.in_force, "G43"), "tool length offset: Z12.9794 mm");
  EXPECT_EQ(meaning(e.in_force, "M3"), "the spindle turns clockwise at 8000 1/min");
  EXPECT_EQ(meaning(explained(5).words, "#1"), "becomes 5");
}

TEST(Explain, AUnitThatChangesInTheLineIsThatOfItsPlaces) {
  const Explanation e = explained(8);
  EXPECT_TRUE(e.inches);
  EXPECT_NEAR(e.from[2], 5 / 25.4, 1e-12);
  EXPECT_EQ(e.to[2], -1);
  EXPECT_EQ(meaning(e.words, "F10"), "feed rate 10 inch/min");
  EXPECT_EQ(meaning(e.in_force, "G20"), "lengths are inches");
}

TEST(Explain, ALineThatNeverRunsIsSaidSo) {
  const Explanation e = explained(11);
  EXPECT_FALSE(e.runs);
  EXPECT_THAT(e.words, IsEmpty());
  EXPECT_THAT(e.in_force, IsEmpty());
}

TEST(Explain, ControlAndLoopsAreThoseOfTheFirstRun) {
  EXPECT_THAT(meaning(explained(6).words, "O1 if [1]"), HasSubstr("if the condition is not 0"));
  EXPECT_EQ(meaning(explained(15).words, "X6"), "by 6 inch");
}

TEST(Explain, ArcsAndPathModes) {
  const Explanation arc = explained(17);
  EXPECT_EQ(meaning(arc.words, "I1"), "centre of the arc: 1 inch from its start");
  EXPECT_EQ(meaning(arc.words, "P2"), "1 whole turn before it goes on to the end");
  EXPECT_EQ(arc.from, arc.to);
  EXPECT_EQ(arc.calls.size(), 1U);
  EXPECT_THAT(meaning(explained(18).in_force, "G64"), HasSubstr("by at most 0.01 inch"));
  EXPECT_THAT(explained(19).in_force, IsEmpty());
}

TEST(Explain, CompensatedPlacesAreThoseOfTheProgram) {
  constexpr std::string_view text = "G21 F300\nT1 M6\nG0 X0 Y0\nG41 D1 G1 X5\nG1 X30\nY20\nG40 G1 X40 Y30\nM2\n";
  const Explanation e = explained(5, text);
  EXPECT_TRUE(e.compensated);
  EXPECT_EQ(e.from[0], 5);
  EXPECT_EQ(e.to[0], 30);
  EXPECT_THAT(meaning(e.in_force, "G41"), HasSubstr("cutter radius 1.5875 mm"));
  EXPECT_FALSE(explained(3, text).compensated);
  EXPECT_TRUE(explained(7, text).compensated);  // it begins beside the contour
}

TEST(Explain, ErrorsBeforeTheLineAndLinesThatAreNot) {
  const auto program = parse(kProgram, "p.ngc");
  EXPECT_EQ(explain(*program, 20).error().id, "GC153");
  EXPECT_EQ(explain(*parse("", "p.ngc"), 1).error().id, "GC153");
  // An error behind the line does not matter, one before it does.
  const auto bad = parse("G1 X1 F10\nG2 X3\nG1 X2\nM2\n", "p.ngc");
  EXPECT_TRUE(explain(*bad, 1));
  EXPECT_FALSE(explain(*bad, 2));
  EXPECT_FALSE(explain(*bad, 3));
  EXPECT_TRUE(explain(*parse("%\nG0 X1\nG0 X2\n%\n", "p.ngc"), 2));
}

// The calls of all lines of a program that runs straight down are those of the whole program.
TEST(Explain, TheCallsOfAllLinesAreThoseOfTheProgram) {
  constexpr std::string_view text =
      "G21 G90 F200\nT1 M6\nG43 H1\nG0 X1 Y2 Z3\nG81 X4 Y5 Z-1 R2\nX6\nG80\nG92 X0\nG1 X3\nG10 L2 P1 X5\nG3 X1 Y2 "
      "R5\nM2\n";
  const auto program = parse(text, "p.ngc");
  const auto whole = canonical_text(*program);
  ASSERT_TRUE(whole) << to_string(whole.error());
  std::string all;
  for (int line = 1; line <= 12; ++line)
    for (const std::string& call : explained(line, text).calls) all += call + "\n";
  EXPECT_THAT(*whole, HasSubstr(all));
  EXPECT_THAT(all, HasSubstr("ARC_FEED"));
}

// Every code that the reader carries out has its meaning.
TEST(Explain, EveryCodeThatRunsHasAMeaning) {
  int described = 0;
  for (int tenfold = 0; tenfold < 1000; ++tenfold) {
    const std::string code = fmt::format("G{:g}", tenfold / 10.0);
    for (const std::string_view beside :
         {"", " X1 Y1", " X1 Y1 Z-1 R1 F100", " P1", " P1 L2 X1", " X1 Y1 R5 F100", " Z0 F100"}) {
      const auto program = parse("G17\n" + code + std::string(beside) + "\nM2\n", "p.ngc");
      if (!program || !canonical_text(*program)) continue;
      const auto e = explain(*program, 2);
      ASSERT_TRUE(e) << code;
      EXPECT_NE(meaning(e->words, code), "not described") << code;
      ++described;
      break;
    }
  }
  EXPECT_GT(described, 50);
  for (const char* const written :
       {"M0",      "M1",     "M2",     "M3",     "M4",        "M5",        "M6",        "M7",  "M8",  "M9",
        "M19 R90", "M30",    "M48",    "M49",    "M50",       "M51",       "M52",       "M53", "M60", "M61 Q1",
        "M62 P1",  "M63 P1", "M64 P1", "M65 P1", "M66 P0 L0", "M67 E0 Q1", "M68 E0 Q1", "M70", "M71", "M73"}) {
    const std::string block = written;
    const Explanation e = explained(2, "S100\n" + block + "\nM2\n");
    EXPECT_TRUE(e.runs) << block;
    const std::string said = meaning(e.words, block.substr(0, block.find(' ')));
    EXPECT_NE(said, "-") << block;
    EXPECT_NE(said, "a command of the machine's builder") << block;
  }
}

// What is in force does not claim the numbers of other words.
TEST(Explain, NumbersBelongToTheCodesOfTheirLine) {
  constexpr std::string_view text =
      "G21 F100\nG0 X0 Y0 Z5\nG98 G81 X1 Y1 Z-1 R2\nM62 P3\nG64 P0.01\nG99 G81 X2 R3\nG0 X0 Y0\nG2 X10 I5\nG10 L2 P1 "
      "R30\nM19 R90\nM2\n";
  EXPECT_EQ(meaning(explained(3, text).words, "R2"), "the height from which the cycle feeds: 2 mm");
  EXPECT_EQ(meaning(explained(4, text).words, "P3"), "digital output 3");
  EXPECT_EQ(meaning(explained(5, text).words, "P0.01"), "rounded corners leave the path by at most 0.01 mm");
  EXPECT_THAT(meaning(explained(6, text).words, "R3"), HasSubstr("and to which it returns: 3 mm"));
  EXPECT_EQ(meaning(explained(9, text).words, "R30"), "turn of the coordinate system, 30 deg");
  EXPECT_EQ(meaning(explained(10, text).words, "R90"), "to 90 deg");
}

TEST(Explain, SplinesMoveTheToolAndMessagesAreNoRemarks) {
  constexpr std::string_view text =
      "G21 G90 F100\nG0 X0 Y0 Z0\nG5 I0 J3 P0 Q-3 X1 Y1\nG5.1 X2 Y2 I1 J0\n(MSG, hello)\n( debug, #1)\n(a remark, or "
      "two)\nM66 P2 L3 Q5\nM2\n";
  const Explanation cubic = explained(3, text);
  EXPECT_EQ(meaning(cubic.words, "J3"), "first control point: 3 mm from the start");
  EXPECT_EQ(meaning(cubic.words, "Q-3"), "second control point: -3 mm from the end, in Y");
  EXPECT_EQ(cubic.to[0], 1);
  ASSERT_FALSE(cubic.calls.empty());
  EXPECT_THAT(cubic.calls.front(), HasSubstr("NURBS"));
  EXPECT_EQ(meaning(explained(4, text).words, "I1"), "the control point: 1 mm from the start");
  EXPECT_EQ(explained(5, text).words.back().meaning, "a message for the operator");
  EXPECT_THAT(explained(6, text).words.back().meaning, HasSubstr("values of its parameters"));
  EXPECT_EQ(explained(7, text).words.back().meaning, "a comment");
  EXPECT_EQ(meaning(explained(8, text).words, "Q5"), "at most 5 s");
}

// A block that changes the coordinates begins where the tool is in those behind it.
TEST(Explain, TheStartIsToldInTheCoordinatesOfTheEnd) {
  constexpr std::string_view kText =
      "G21 G90 F100\nG10 L2 P2 X100 Y0 Z0\nG54 G0 X10 Y0 Z5\nG55 G0 X10\nG92 X0\nG92.1 G1 X50\nG54 G20 X1\nM2\n"
      "O100\nG1 X5 F100\nM99\n";
  const auto from = [&](int line) { return explained(line, kText).from[0]; };
  EXPECT_NEAR(from(4), -90, 1e-9);
  EXPECT_NEAR(from(6), 10, 1e-9);
  EXPECT_NEAR(from(7), 150 / 25.4, 1e-9);
  const Explanation g10 = explained(2, kText);
  EXPECT_EQ(meaning(g10.words, "P2"), "of coordinate system 2 (G55)");
  constexpr std::string_view kCalls = "G21 G90 F100\nM98 P100\nM2\nO100\nG1 X5\nM99\n";
  EXPECT_EQ(meaning(explained(5, kCalls).words, "X5"), "to 5 mm");
}

}  // namespace
}  // namespace polypod::gcode
