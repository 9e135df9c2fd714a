// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Rewriting programs: what changes, what stays, and that the written program goes where it was told.
#include "polypod/gcode/writer.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace polypod::gcode {
namespace {

PathPoint mm(double x, double y, double z) {
  return {Vec3(x, y, z) / 1000, Vec3::Zero()};
}

struct Case {
  Program program;
  Interpretation run;
};

Case load(const std::string& text) {
  auto program = parse(text, "part.ngc");
  EXPECT_TRUE(program.has_value()) << (program ? "" : to_string(program.error()));
  auto run = interpret(*program);
  EXPECT_TRUE(run.has_value()) << text << (run ? "" : to_string(run.error()));
  if (!program || !run) return {};
  return {std::move(*program), std::move(*run)};
}

std::string rewritten(const std::string& text, const std::vector<Replacement>& replacements) {
  const Case c = load(text);
  auto result = rewrite(c.program, c.run, replacements);
  EXPECT_TRUE(result.has_value()) << (result ? "" : to_string(result.error()));
  if (!result) return "";
  EXPECT_EQ(result->source.size(), result->program.blocks.size());
  return to_text(result->program);
}

TEST(Rewrite, NothingReplacedIsByteForByte) {
  const std::string text = "%\r\nN1 G0X1\r\n(a)\r\nN2 G91 G1 Y.1 F5\r\nN3 G2 X0.1 I.05\r\n/N4 X 1 I.5\r\nM2\r\nrest";
  EXPECT_EQ(rewritten(text, {}), text);
}

TEST(Rewrite, OneMotionBlockBecomesSeveral) {
  EXPECT_EQ(rewritten("G0 X0 Y0 Z5\nG1 X10 F100 S500 (cut) M8\nG0 Z5\nM2\n", {{1, {mm(3, 0.1, 5), mm(10, 0.2, 5)}}}),
            "G0 X0 Y0 Z5\nG1 X3.0000 Y0.1000 F100 S500 (cut) M8\nG1 X10.0000 Y0.2000\nG0 Z5\nM2\n");
}

// rs274 takes 252 characters and refuses 256 ("Command too long").
TEST(Rewrite, ACommentThatWouldMakeALineTooLongGoesBeforeIt) {
  const std::string comment = "(" + std::string(230, 'a') + ")";
  EXPECT_EQ(rewritten("G0 X0 Y0 Z5\n/G1 X10 F100 " + comment + "\nM2\n", {{1, {mm(3, 0.1, 5), mm(10, 0.2, 5)}}}),
            "G0 X0 Y0 Z5\n/" + comment + "\n/G1 X3.0000 Y0.1000 F100\n/G1 X10.0000 Y0.2000\nM2\n");
}

TEST(Rewrite, ArcsLoseTheirWordsAndLaterBlocksGetThemBack) {
  EXPECT_EQ(rewritten("F100\nG0X0Y0\nG2 X10 Y0 I5 J0 P1\nX20 I5\nG1 X30\nX40\nM2\n",
                      {{1, {mm(5, 5.1, 0), mm(10, 0, 0)}}, {3, {mm(30, 0, 0)}}}),
            "F100\nG0X0Y0\nG1 X5.0000 Y5.1000\nG1 X10.0000 Y0.0000\nG2 X20 I5\nG1 X30.0000\nX40\nM2\n");
  EXPECT_EQ(rewritten("F100\nG0 X0 Y0\nG3 I-5\nM2\n", {{1, {mm(-10, 0, 0), mm(0, 0.5, 0)}}}),
            "F100\nG0 X0 Y0\nG1 X-10.0000\nG1 X0.0000 Y0.5000\nM2\n");
  EXPECT_EQ(rewritten("f100\ng0 x0 y0\ng2x10i5\nx0i-5\nm2\n", {{2, {mm(5, -5, 0), mm(0, 0, 0)}}}),
            "f100\ng0 x0 y0\ng2x10i5\ng1x5.0000y-5.0000\nx0.0000y0.0000\nm2\n");
}

TEST(Rewrite, CirclesByTheirCentreAlone) {
  const std::string text = "F100\nG0 X0 Y0\nG2 X4 I2\nI3 (around)\nI-3\nM2\n";
  EXPECT_EQ(rewritten(text, {{2, {mm(7, 3, 0), mm(4, 0.1, 0)}}, {3, {mm(4, 0, 0)}}}),
            "F100\nG0 X0 Y0\nG2 X4 I2\nG1 X7.0000 Y3.0000 (around)\nX4.0000 Y0.1000\nY0.0000\nM2\n");
  EXPECT_EQ(rewritten(text, {{1, {mm(4, 0, 0)}}}), "F100\nG0 X0 Y0\nG1 X4.0000\nG2 I3 (around)\nI-3\nM2\n");
  EXPECT_EQ(rewritten(text, {{2, {mm(4, 0, 0)}}}), "F100\nG0 X0 Y0\nG2 X4 I2\nG1 X4.0000 (around)\nG2 I-3\nM2\n");
}

TEST(Rewrite, StopsAndExactStopActAtTheEnd) {
  EXPECT_EQ(rewritten("F100\nG0 X0\nG1 X10 M3 M0\nM2\n", {{1, {mm(5, 0, 0), mm(10, 1, 0)}}}),
            "F100\nG0 X0\nG1 X5.0000 M3\nG1 X10.0000 Y1.0000 M0\nM2\n");
}

TEST(Rewrite, NumbersFillTheGapOrStayAway) {
  const std::vector<PathPoint> three{mm(1, 1, 0), mm(2, 2, 0), mm(3, 3, 0)};
  EXPECT_EQ(
      rewritten("N0010 F100 G0 X0\nN0020 G1 X3\nN0030 M2\n", {{1, three}}),
      "N0010 F100 G0 X0\nN0020 G1 X1.0000 Y1.0000\nN0023 G1 X2.0000 Y2.0000\nN0026 G1 X3.0000 Y3.0000\nN0030 M2\n");
  EXPECT_EQ(rewritten("N1F100G0X0\nN2G1X3\nN3M2\n", {{1, three}}),
            "N1F100G0X0\nN2G1X1.0000Y1.0000\nG1X2.0000Y2.0000\nG1X3.0000Y3.0000\nN3M2\n");
}

TEST(Rewrite, SlashAndEndingAreKept) {
  const std::string out = rewritten("F100 G0 X0\r\n/N5 G1 X3\r\nN9 M2\r\nM2", {{1, {mm(1, 1, 0), mm(3, 0, 0)}}});
  const Case again = load(out);
  EXPECT_TRUE(out.starts_with("F100 G0 X0\r\n/N5 G1 X1.0000 Y1.0000\r\n")) << out;
  EXPECT_TRUE(again.program.blocks[2].optional);
  EXPECT_EQ(again.program.blocks[2].ending, "\r\n");
  EXPECT_EQ(again.run.moves.size(), 3u);
  EXPECT_EQ(rewritten("F100 G0 X0\nG1 X3", {{1, {mm(1, 1, 0), mm(3, 0, 0)}}}),
            "F100 G0 X0\nG1 X1.0000 Y1.0000\nG1 X3.0000 Y0.0000");
  // A last line that ends in a carriage return alone.
  EXPECT_EQ(rewritten("F100 G0 X0\nG1 X3\r", {{1, {mm(1, 1, 0), mm(3, 0, 0)}}}),
            "F100 G0 X0\nG1 X1.0000 Y1.0000\nG1 X3.0000 Y0.0000\r");
}

TEST(Rewrite, InverseTimeKeepsTheTimeOfTheMove) {
  const std::string out = rewritten("G93 G0 X0 Y0\nG1 X10 F2\nM2\n", {{1, {mm(2.5, 0, 0), mm(10, 0, 0)}}});
  EXPECT_EQ(out, "G93 G0 X0 Y0\nG1 X2.5000 F8.000000\nG1 X10.0000 F2.666667\nM2\n");
}

TEST(Rewrite, ExactStringsOfNumbers) {
  EXPECT_EQ(format_number(-0.00001, 4), "0.0000");
  EXPECT_EQ(format_number(-0.00006, 4), "-0.0001");
  EXPECT_EQ(format_number(1e15, 1), "1000000000000000.0");
  EXPECT_EQ(format_number(-3, 0), "-3");
  // The program's own decimals are kept when it has more, inches get five.
  EXPECT_EQ(rewritten("F100 G0 X0.123456 Y0\nG1 X3\nM2\n", {{1, {mm(3, 0, 0)}}}),
            "F100 G0 X0.123456 Y0\nG1 X3.000000\nM2\n");
  EXPECT_EQ(rewritten("G20\nF100 G0 X0 Y0\nG1 X3\nM2\n", {{1, {mm(25.4, 0, 0)}}}),
            "G20\nF100 G0 X0 Y0\nG1 X1.00000\nM2\n");
}

TEST(Rewrite, RefusesAnArcWhoseStartMoved) {
  const Case c = load("F100 G0 X0 Y0\nG1 X10\nG2 X20 I5\nM2\n");
  auto result = rewrite(c.program, c.run, std::vector<Replacement>{{1, {mm(10, 0.1, 0)}}});
  ASSERT_FALSE(result.has_value());
  EXPECT_EQ(result.error().id, "GC141");
  EXPECT_EQ(result.error().place.line, 3);
  EXPECT_TRUE(rewrite(c.program, c.run, std::vector<Replacement>{{1, {mm(10, 0, 0)}}}).has_value());
}

TEST(Rewrite, RefusesWhatCannotBe) {
  const Case c = load("F100 G0 X0 Y0\nG1 X10\nM2\n");
  const std::vector<std::vector<Replacement>> cases{{{2, {mm(0, 0, 0)}}},
                                                    {{-1, {mm(0, 0, 0)}}},
                                                    {{1, {}}},
                                                    {{1, {mm(0, 0, 0)}}, {0, {mm(0, 0, 0)}}},
                                                    {{1, {mm(NAN, 0, 0)}}}};
  for (const auto& replacements : cases) {
    const auto result = rewrite(c.program, c.run, replacements);
    ASSERT_FALSE(result.has_value());
    EXPECT_EQ(result.error().id, "GC140");
  }
}

TEST(Rewrite, RotaryWordsAreSplitToo) {
  const double deg = std::acos(-1.0) / 180;
  EXPECT_EQ(rewritten("F100 G0 X0 Y0 A0\nG1 X10 A30\nM2\n",
                      {{1, {{Vec3(0.005, 0, 0), {15 * deg, 0, 0}}, {Vec3(0.01, 0, 0), {30 * deg, 0, 0}}}}}),
            "F100 G0 X0 Y0 A0\nG1 X5.0000 A15.00000\nG1 X10.0000 A30.00000\nM2\n");
}

/// Under G91 the sum of the written numbers never drifts from the path that was asked for.
TEST(Rewrite, IncrementalRoundingDoesNotAccumulate) {
  std::string text = "G91 G0 X0 Y0 Z0\nG1 F100\n";
  const int count = 500;
  for (int i = 0; i < count; ++i) text += i % 2 == 0 ? "X0.3333 Y0.1\n" : "X-.1 Z0.01\n";
  text += "G0 X1\nM2\n";
  const Case c = load(text);
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform(-1e-4, 1e-4);
  std::vector<Replacement> replacements;
  for (int i = 1; i <= count; ++i) {
    if (i % 5 == 0) continue;
    const Move& move = c.run.moves[static_cast<std::size_t>(i)];
    const auto shake = [&] { return Vec3(uniform(random), uniform(random), uniform(random)); };
    replacements.push_back({i, {{(move.start + move.end) / 2 + shake()}, {move.end + shake()}}});
  }
  const auto result = rewrite(c.program, c.run, replacements);
  ASSERT_TRUE(result.has_value());
  const auto again = interpret(result->program);
  ASSERT_TRUE(again.has_value()) << to_string(again.error());
  // Half of the last digit, 0.05 um, an axis, and rounding errors of sums.
  constexpr double kHalfDigit = 0.0501e-6;
  std::size_t at = 0;
  for (const Replacement& replacement : replacements) {
    const int block = c.run.moves[static_cast<std::size_t>(replacement.move)].block;
    while (result->source[static_cast<std::size_t>(again->moves[at].block)] != block) ++at;
    for (const PathPoint& point : replacement.points) {
      ASSERT_LE((again->moves[at].end - point.p).cwiseAbs().maxCoeff(), kHalfDigit) << replacement.move;
      ++at;
    }
  }
  // The rapid after them names X only: X comes to the programmed place, Y and Z stay where the correction left them.
  EXPECT_NEAR(again->moves.back().end.x(), c.run.moves.back().end.x(), kHalfDigit);
}

TEST(EnsureMotionWord, AddsItOnlyWhereNeeded) {
  const Case c = load("N5 G1 X1 F5\nN6 X2\nN7 M8\nN8 Y2\nM2\n");
  EXPECT_EQ(ensure_motion_word(c.program.blocks[0], 2), "N5 G1 X1 F5");
  EXPECT_EQ(ensure_motion_word(c.program.blocks[1], 2), "N6 G2 X2");
  EXPECT_EQ(ensure_motion_word(c.program.blocks[2], 2), "N7 M8");
}

TEST(Header, StandsAfterPercentAndProgramNumber) {
  const std::vector<std::string> lines{"corrected (by 3 um)", "tube 100 um"};
  const Case c = load("%\r\nO1000\r\n(PART)\r\nG0 X1\r\n%\r\n");
  EXPECT_EQ(to_text(with_header(c.program, lines)),
            "%\r\nO1000\r\n(corrected [by 3 um])\r\n(tube 100 um)\r\n(PART)\r\nG0 X1\r\n%\r\n");
  const Case d = load("; a part\nG0 X1\nM2");
  EXPECT_EQ(to_text(with_header(d.program, lines)), "; corrected (by 3 um)\n; tube 100 um\n; a part\nG0 X1\nM2");
}

TEST(Header, WhateverANameHoldsStaysInItsComment) {
  const std::vector<std::string> lines{"a)\nG0 Z-99\r(b; % \x1b[2J\xff", std::string(239, 'x') + "\u00e4" + "tail"};
  const Case round = load("(PART)\nG0 X1\nM2\n");
  EXPECT_EQ(to_text(with_header(round.program, lines)),
            "(a]\\x0aG0 Z-99\\x0d[b, _ \\x1b[2J\\xff)\n(" + std::string(239, 'x') + " ...)\n(PART)\nG0 X1\nM2\n");
  const Case semicolon = load("; a part\nG0 X1\nM2\n");
  const std::string text = to_text(with_header(semicolon.program, lines));
  const auto again = parse(text, "again.ngc");
  ASSERT_TRUE(again);
  EXPECT_EQ(interpret(*again)->moves.size(), 1u) << text;
}

}  // namespace
}  // namespace polypod::gcode
