// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What predict and correct say beside their figures: what was not judged, which blocks are short, what the header
// tells.
#include <gmock/gmock.h>

#include "machining/examples.hpp"
#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/pages/correction.hpp"
#include "polypod/pages/prediction.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using testing::correct;
using testing::Example;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::unwrap;
using units::to_mm;
using units::to_um;

std::string trial(const std::string& file) {
  return test::source("tests/trials/" + file);
}

Example with_text(const std::string& text, const std::string& job = "milling.toml") {
  Example e{unwrap(machining::read_job(trial(job))), unwrap(gcode::parse(text, "test.ngc")), {}};
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  return e;
}

Example load(const std::string& program, const std::string& job = "milling.toml") {
  return with_text(gcode::to_text(unwrap(gcode::read(trial(program)))), job);
}

std::string page_of(const Example& e, const machining::Correction& c) {
  return pages::correction_page(e.job, e.program, c, {});
}

/// Blocks that stand for rewritten moves and are shorter than half a millimetre, counted from the outside.
int shorter(const machining::Correction& c, double length) {
  int count = 0;
  for (std::size_t k = 0; k < c.commanded.size(); ++k) {
    const auto& m = c.commanded[k];
    if (m.transition || m.followed != nullptr) count += m.move.length() < length - 1e-6 ? 1 : 0;
  }
  return count;
}

/// The pocket had 33 such blocks, the contour 5, without a word.
TEST(Answers, ShortBlocksAreAvoidedOrCounted) {
  for (const auto& [file, most] : {std::pair{"milling_pocket.ngc", 27}, std::pair{"milling_contour.ngc", 3}}) {
    auto e = load(file);
    e.job.tolerance = 100e-6;
    e.job.controller.shortest_length = 0.5e-3;
    const auto c = correct(e);
    EXPECT_TRUE(c.within_tolerance) << c.reason;
    EXPECT_NE(c.modes.written, "G61.1") << "stops at every corner are no price for longer blocks";
    EXPECT_LE(c.short_blocks.count, most) << file;
    EXPECT_EQ(c.short_blocks.count, shorter(c, 0.5e-3)) << file;
    ASSERT_GT(c.short_blocks.count, 0) << file;
    EXPECT_LT(c.short_blocks.length, 0.5e-3);
    bool named = false;
    for (const auto& m : c.commanded) {
      const int line = c.program.blocks[static_cast<std::size_t>(m.move.block)].line;
      if (line == c.short_blocks.written_line) named = m.move.length() < 0.5e-3;
      if (line < c.short_blocks.written_line && m.followed != nullptr) {
        EXPECT_GE(m.move.length(), 0.5e-3 - 1e-6) << line;
      }
    }
    EXPECT_TRUE(named);
    EXPECT_THAT(page_of(e, c), HasSubstr("shorter than [controller]"));
  }
}

/// Six of them are left where the bend begins at once and is longer than a side of the tube takes; there were 33.
TEST(Answers, AWiderTubeLeavesFewerShortBlocks) {
  auto e = load("milling_pocket.ngc");
  e.job.tolerance = 180e-6;
  e.job.controller.shortest_length = 0.5e-3;
  const auto c = correct(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_GT(c.rewritten_moves, 30);
  EXPECT_LE(c.short_blocks.count, 6);
  EXPECT_EQ(c.short_blocks.count, shorter(c, 0.5e-3));
  // The same by time: 20 ms are 0.53 mm at F1600.
  e.job.controller.shortest_length = 0;
  e.job.controller.shortest_time = 20e-3;
  EXPECT_EQ(correct(e).short_blocks.count, c.short_blocks.count);
}

std::string hole(const std::string& feed, const std::string& dwell) {
  return "G21 G90 G17 G94\nT1 M6\nS8000 M3\nG0 Z20\nG0 X15 Y15\nG0 Z1\nG1 Z-10 F" + feed + "\n" + dwell +
         "G0 Z5\nG0 Z20\nM30\n";
}

/// Thrust 159 N times C_zz 0.51 um/N: the tool turns back 81 um above the bottom, and the answer was a plain yes.
TEST(Answers, APlungeWithoutADwellIsNotJudged) {
  const auto e = with_text(hole("250", ""));
  const auto c = correct(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_FALSE(c.all_judged());
  EXPECT_THAT(c.answer(), HasSubstr("apart from what was not judged"));
  ASSERT_EQ(c.after.plunges.size(), 1u);
  const machining::Plunge& plunge = c.after.plunges[0];
  EXPECT_EQ(plunge.line, 7);
  EXPECT_NEAR(to_um(plunge.held_back), 81, 3);
  EXPECT_EQ(plunge.remaining, plunge.held_back);
  EXPECT_THAT(page_of(e, c), HasSubstr("Not judged: line 7: the thrust deflects the tool"));
  const auto p = testing::predict(e);  // at steps longer than the way on which the end is looked at
  ASSERT_EQ(p.plunges.size(), 1u);
  EXPECT_NEAR(p.plunges[0].held_back, plunge.held_back, 1e-6);
  EXPECT_FALSE(p.all_judged());
}

/// Tooth by tooth: a bend of 81 um at a chip of 10.4 um leaves 1 / (1 + 10.4 / 81) each time.
TEST(Answers, ADwellCutsWhatIsHeldBack) {
  const auto none = correct(with_text(hole("250", ""))).after.plunges.at(0);
  const double chip = 250e-3 / 8000 / 3, share = none.held_back / (none.held_back + chip);
  // Half a turn is no dwell; eight revolutions leave what the recursion says.
  EXPECT_EQ(correct(with_text(hole("250", "G4 P0.00375\n"))).after.plunges.at(0).remaining, none.held_back);
  const auto e = with_text(hole("250", "G4 P0.06\n"));
  const auto c = correct(e);
  EXPECT_TRUE(c.after.plunges.empty());
  EXPECT_TRUE(c.all_judged());
  EXPECT_NEAR(to_um(c.after.plunge_within.remaining), to_um(none.held_back * std::pow(share, 24)), 0.01);
  // The dwell that is advised leaves less than the cells of the stock leave open.
  char advice[32];
  std::snprintf(advice, sizeof advice, "G4 P%.4f\n", none.needed + 1e-4);
  EXPECT_LE(correct(with_text(hole("250", advice))).after.plunge_within.remaining, 0.02 * e.job.tolerance);
  // A dwell that a switch may skip, or with the spindle at rest, is none.
  EXPECT_EQ(correct(with_text(hole("250", "/G4 P0.5\n"))).after.plunges.size(), 1u);
  EXPECT_EQ(correct(with_text(hole("250", "M5\nG4 P0.5\nM3\n"))).after.plunges.size(), 1u);
}

/// The tool stands at a stop, an input that is waited for and a spindle that starts or stops, for a time that nobody
/// knows: a correction goes back to the programmed end before each, as before a dwell, and no plunge counts as cut out.
TEST(Answers, StopsInACutAreRests) {
  const auto groove = [](const std::string& end, const std::string& between) {
    auto e = with_text("G21 G90 G17 G94 G64 P0.01\nT1 M6\nS8000 M3\nG0 X-10 Y30 Z5\nZ-2\nG1 X40 F1500" + end + "\n" +
                       between + "X70\nG0 Z5\nM30\n");
    e.job.tolerance = 60e-6;
    return e;
  };
  const auto goes_back = [](const Example& e) {
    const auto c = correct(e);
    EXPECT_TRUE(c.rounds > 0);
    return c.text().find("X40.0000 Y30.0000 Z-2.0000") != std::string::npos;
  };
  EXPECT_FALSE(goes_back(groove("", "")));
  for (const char* rest : {"G4 P1\n", "M0\n", "M1\n", "M60\n", "M66 P0 L3 Q5\n", "M5\nM3\n", "S6000 M3\n", "S6000\n",
                           "M101\n", "T1 M6\nM3\n"})
    EXPECT_TRUE(goes_back(groove("", rest))) << rest;
  EXPECT_TRUE(goes_back(groove(" M0", "")));
  EXPECT_FALSE(goes_back(groove("", "M66 P0 L0\n"))) << "no wait";
  EXPECT_FALSE(goes_back(groove("", "M8\n")));
  EXPECT_EQ(correct(with_text(hole("250", "M0\n"))).after.plunges.size(), 1u);
}

/// A dwell is at least one revolution, so that every tooth has passed, however little is held back.
TEST(Answers, TheAdvisedDwellIsARevolutionAtLeast) {
  auto e = with_text(hole("250", ""));
  e.job.tolerance = 30e-6;
  std::vector<double> stiff = statics::column_compliances(e.job.machine);
  for (double& c : stiff) c *= 0.02;  // some um are held back
  e.job.machine = testing::unwrap(statics::with_compliances(e.job.machine, stiff));
  const auto p = testing::predict(e);
  ASSERT_EQ(p.plunges.size() + (p.plunge_within.held_back > 0 ? 1 : 0), 1u);
  const machining::Plunge& plunge = p.plunges.empty() ? p.plunge_within : p.plunges[0];
  EXPECT_GT(plunge.held_back, 0.2e-6);
  EXPECT_NEAR(plunge.needed, 60.0 / 8000, 1e-9);
}

TEST(Answers, EdgesThatPressKeepTheToolUp) {
  auto e = with_text(hole("250", "G4 P5\n"));
  e.job.material.end = cutting::EndCoefficients{850e6, 0, 850e6, 0, 0, 30e3};
  const auto p = testing::predict(e);
  ASSERT_EQ(p.plunges.size(), 1u);
  // Edges 30 N/mm against 850 N/mm2 times 10.4 um.
  EXPECT_NEAR(p.plunges[0].remaining / p.plunges[0].held_back, 30 / (30 + 850 * 0.250 / 24), 1e-3);
  EXPECT_EQ(p.plunges[0].needed, 0);
}

TEST(Answers, OnlyTheLastOfPecksIsABottom) {
  const std::string start = "G21 G90 G17 G94\nT1 M6\nS8000 M3\nG0 Z20\nG0 X15 Y15\nG0 Z1\n";
  const auto p = testing::predict(
      with_text(start + "G1 Z-4 F250\nG0 Z1\nG0 Z-3.8\nG1 Z-8\nG0 Z1\nG0 Z-7.8\nG1 Z-10\nG0 Z20\nM30\n"));
  ASSERT_EQ(p.plunges.size(), 1u);
  EXPECT_EQ(p.plunges[0].line, 13);
}

/// The line was that of a program that had not been written: 11, which is M30 in the one at hand.
TEST(Answers, LinesAreThoseOfTheProgramAtHand) {
  const auto e = load("milling_slot.ngc", "milling_tricept.toml");
  const auto c = correct(e);
  EXPECT_FALSE(c.within_tolerance);
  ASSERT_EQ(c.after.not_judged.size(), 1u);
  EXPECT_EQ(c.after.not_judged[0].line, 8);
  EXPECT_TRUE(c.only_not_judged);
  EXPECT_THAT(c.answer(), ::testing::StartsWith("no, not all of the cut is judged: line 8: the machine tilts"));
  EXPECT_THAT(c.answer(), HasSubstr("Every distance that was computed is inside the tube"));
  EXPECT_THAT(c.remedies, ::testing::Contains(HasSubstr("keeps its tool at zero tilt")));
  const std::string page = page_of(e, c);
  EXPECT_THAT(page, HasSubstr("not judged: line 8:"));
  EXPECT_THAT(page, Not(HasSubstr("line 11")));
  EXPECT_THAT(c.text(), HasSubstr("NOT judged to be within the tube, see line 8 of the original"));
  // Its notes, too, though the header with the path mode is longer than the one that was checked.
  const auto pocket = correct(load("milling_pocket.ngc"));
  EXPECT_THAT(pocket.after.notes, ::testing::Contains(HasSubstr("(first in line 8)")));
}

// It showed the distance alone, in green.
TEST(Answers, ThePageOfAPredictionSaysWhyItIsNoYes) {
  auto e = load("milling_slot.ngc");
  e.job.tolerance = 1e-3;
  std::string text = gcode::to_text(e.program);
  const std::size_t retract = text.rfind("G0 Z20");
  ASSERT_NE(retract, std::string::npos);
  text.insert(retract, "/");
  text.insert(text.find("M5"), "G0 X-10\nG0 Z20\n");
  e = with_text(text);
  e.job.tolerance = 1e-3;
  machining::PredictOptions options;
  options.keep_samples = options.keep_stock = true;
  auto p = unwrap(machining::predict(e.job, e.program, e.interpretation, options));
  ASSERT_TRUE(p.other_switch);
  pages::PredictionPageOptions how;
  how.within = p.within(e.job);
  how.collides = true;
  how.against = {"MC304: a rapid move goes through material, 12 um deep"};
  const std::string page = pages::prediction_page(e.job, e.program, e.interpretation, p, p.samples, how);
  EXPECT_THAT(page, HasSubstr("ith block delete on"));
  EXPECT_THAT(page, HasSubstr("through material, 12 µm deep"));
  EXPECT_THAT(page, Not(HasSubstr("what the deflected tool leaves")));
  how.collides = false;
  EXPECT_THAT(pages::prediction_page(e.job, e.program, e.interpretation, p, p.samples, how),
              HasSubstr("what the deflected tool leaves"));
}

TEST(Answers, TheHeaderSaysThatItIsOutside) {
  auto e = load("milling_slot.ngc");
  e.job.tolerance = 8e-6;
  const auto c = correct(e);
  ASSERT_FALSE(c.within_tolerance);
  char expected[80];
  std::snprintf(expected, sizeof expected, "NOT within the tube, up to %.1f um from the path of line 8",
                to_um(c.largest_after));
  EXPECT_THAT(c.text(), HasSubstr(expected));
  EXPECT_EQ(c.lines_out, c.program.blocks.size());
  machining::CorrectOptions mirror;
  mirror.method = machining::CorrectMethod::mirror;
  EXPECT_THAT(correct(e, mirror).text(), HasSubstr("NOT within the tube"));
  e.job.tolerance = 80e-6;
  EXPECT_THAT(correct(e).text(), Not(HasSubstr("NOT")));
  // What is open at other places of the line is not the whole of it.
  EXPECT_EQ(c.after.steep.line, 8);
  EXPECT_GT(c.after.steep.elsewhere, c.after.steep.distance);
  EXPECT_DOUBLE_EQ(c.after.steep.elsewhere, c.largest_distance);
}

TEST(Answers, WhatWasNotCorrectedIsTakenAgain) {
  auto e = with_text("G21 G90 G17 G94\nT1 M6\nS8000 M3\nG0 Z20\nG0 X-10 Y-3\nG0 Z-6\nG1 X90 F1800\nG0 Z20\nM30\n");
  machining::CorrectOptions all;
  all.all = true;  // at the corner before the cut X90 became X90.0000
  for (const machining::CorrectOptions& options : {machining::CorrectOptions{}, all}) {
    const auto c = correct(e, options);
    EXPECT_EQ(c.rewritten_moves, 0);
    EXPECT_EQ(c.moves.size(), 1u);
    EXPECT_FALSE(c.moves[0].rewritten);
    EXPECT_THAT(c.text(), HasSubstr("looked at, not corrected"));
    EXPECT_THAT(c.text(), HasSubstr("G1 X90 F1800\n"));
    EXPECT_THAT(c.text(), Not(HasSubstr("do not correct again")));
    const auto again = with_text(c.text());
    EXPECT_TRUE(machining::correct(again.job, again.program, again.interpretation));
  }
}

}  // namespace
}  // namespace polypod
