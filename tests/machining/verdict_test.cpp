// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A yes is given only for what was judged: programs that once got one without.
#include <gmock/gmock.h>

#include "machining/examples.hpp"
#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/machining/vibration.hpp"

namespace polypod {
namespace {

using testing::correct;
using testing::Example;
using ::testing::HasSubstr;
using testing::unwrap;
using testing::with_program;
using units::to_um;

std::string trial(const std::string& file) {
  return test::source("tests/trials/" + file);
}

Example load(const std::string& program, const std::string& job) {
  Example e{unwrap(machining::read_job(job)), unwrap(gcode::read(program)), {}};
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  return e;
}

/// The error that both predict and correct end with.
Error refused(const Example& e) {
  const auto p = machining::predict(e.job, e.program, e.interpretation);
  const auto c = machining::correct(e.job, e.program, e.interpretation);
  EXPECT_FALSE(p);
  EXPECT_FALSE(c);
  if (p || c) return {};
  EXPECT_EQ(p.error().id, c.error().id);
  EXPECT_EQ(p.error().place.line, c.error().place.line);
  return c.error();
}

TEST(Verdict, TheTightHelixComesNoWorse) {
  for (const double tolerance : {100e-6, 120e-6, 150e-6}) {
    auto e = load(trial("tight_helix.ngc"), trial("plate.toml"));
    e.job.tolerance = tolerance;
    const auto c = correct(e);
    EXPECT_LE(c.largest_distance, c.before.largest_distance);
    for (const auto& m : c.moves) {
      if (m.rewritten) {
        EXPECT_LE(to_um(m.distance_after), to_um(m.distance_before) + 1) << "line " << m.line;
      }
    }
    EXPECT_EQ(c.within_tolerance, c.largest_after <= tolerance - machining::resolution(e.job));
  }
}

TEST(Verdict, MovesWhoseStartIsUnknownAreRefused) {
  Error error = refused(load(trial("cut_after_g43.ngc"), trial("slot.toml")));
  EXPECT_EQ(error.id, "MC303");
  EXPECT_EQ(error.place.line, 8);
  error = refused(load(trial("no_z_at_all.ngc"), trial("slot.toml")));
  EXPECT_EQ(error.id, "MC303");
  EXPECT_EQ(error.place.line, 5);
}

TEST(Verdict, AWayDownFromAnUnknownHeightComesFromAbove) {
  auto e = load(trial("slot.ngc"), trial("slot.toml"));
  const auto plain = testing::predict(e);
  e.program = unwrap(gcode::parse(
      "G21 G90 G94 G17 G54\nT1 M6\nS12000 M3\nG0 X-45 Y0 Z10\nG43 H1\nG1 Z-2 F600\nG1 X45 F1800\nG0 Z10\nM30\n",
      "test.ngc"));
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  const auto p = testing::predict(e);
  EXPECT_NEAR(to_um(p.largest_distance), to_um(plain.largest_distance), 1e-6);
  EXPECT_THAT(p.notes.back() + p.notes.front() + p.notes[p.notes.size() / 2], HasSubstr("from above"));
}

TEST(Verdict, MovesInAirBeyondTheReachAreRefused) {
  const Error error = refused(load(trial("rapid_out_of_reach.ngc"), trial("slot.toml")));
  EXPECT_EQ(error.id, "MC210");
  EXPECT_EQ(error.place.line, 5);
  EXPECT_THAT(error.message, HasSubstr("likewise lines 6, 10, 11"));
}

TEST(Verdict, ARapidThroughTheStockIsRefused) {
  const auto e = load(trial("rapid_through_stock.ngc"), trial("plate.toml"));
  const auto c = machining::correct(e.job, e.program, e.interpretation);
  ASSERT_FALSE(c);
  EXPECT_EQ(c.error().id, "MC304");
  EXPECT_EQ(c.error().place.line, 5);
  // 50 mm of a slot 5 mm wide and 3 mm deep, less what stands before the edge of the stock.
  EXPECT_THAT(c.error().message, HasSubstr("794 mm3"));
}

TEST(Verdict, ARapidInManyBlocksIsOneRapid) {
  auto e = load(trial("slot.ngc"), trial("slot.toml"));
  const auto program = [&](const std::string& way) {
    e.program = unwrap(gcode::parse("G21 G90 G94 G17\nT1 M6\nS8000 M3\nG0 X-34 Y0 Z5\nG0 Z-0.5\n" + way +
                                        "G0 Z10\nG0 X0 Y10\nG1 Z-1 F400\nG1 X5\nG0 Z10\nM2\n",
                                    "rapids.ngc"));
    e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  };
  const auto error_of = [](const Example& of) {
    const auto p = machining::predict(of.job, of.program, of.interpretation);
    EXPECT_TRUE(p);
    const Status free = machining::no_rapid_cuts(of.job, of.program, p->pass);
    const auto c = machining::correct(of.job, of.program, of.interpretation);
    EXPECT_FALSE(c);
    EXPECT_FALSE(free);
    if (c || free) return Error{};
    EXPECT_EQ(free.error().message, c.error().message);
    return c.error();
  };
  program("G0 X34\n");
  const Error whole = error_of(e);
  EXPECT_EQ(whole.id, "MC304");
  std::string way;
  for (int i = 1; i <= 340; ++i) way += "G0 X" + std::to_string(-34 + 0.2 * i) + "\n";
  program(way);
  const Error divided = error_of(e);
  EXPECT_EQ(divided.id, "MC304");
  EXPECT_THAT(divided.message, HasSubstr("these rapid moves"));
  const auto volume = [](const std::string& text) { return text.substr(text.find("through")); };
  EXPECT_EQ(volume(divided.message), volume(whole.message));
}

TEST(Verdict, ManyTouchesAreACut) {
  auto e = load(trial("slot.ngc"), trial("slot.toml"));
  std::string way = "G21 G90 G94 G17\nT1 M6\nS8000 M3\nG0 X-45 Y0 Z10\nG0 Z-2\nG1 X-33 F1800\nG91\n";
  for (int i = 0; i < 60; ++i) way += "G0 X0.055\nG1 X0.005 F1800\n";
  e.program = unwrap(gcode::parse(way + "G90\nG0 Z10\nM2\n", "touches.ngc"));
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  const auto c = machining::correct(e.job, e.program, e.interpretation);
  ASSERT_FALSE(c);
  EXPECT_EQ(c.error().id, "MC304");
  EXPECT_EQ(c.error().place.line, 8);
  EXPECT_THAT(c.error().message, HasSubstr("60 rapid moves"));
}

TEST(Verdict, AMoveThatIsRewrittenComesCloser) {
  const auto e = load(trial("two_ramps.ngc"), trial("two_ramps.toml"));
  machining::CorrectOptions options;
  options.all = true;
  const auto c = unwrap(machining::correct(e.job, e.program, e.interpretation, options));
  int rewritten = 0;
  for (const auto& m : c.moves) {
    if (!m.rewritten) continue;
    ++rewritten;
    EXPECT_LE(to_um(m.distance_after), to_um(m.distance_before) + 0.05) << "line " << m.line;
  }
  EXPECT_GE(rewritten, 3);
}

TEST(Verdict, AYesThatIsNotForAllStandsInTheFile) {
  auto e = load(trial("ramps.ngc"), trial("plate.toml"));
  e.job.tolerance = 309e-6;
  const auto c = correct(e);
  ASSERT_TRUE(c.within_tolerance);
  ASSERT_FALSE(c.all_judged());
  const machining::Unjudged most = c.after.farthest_not_judged();
  EXPECT_GT(most.distance, e.job.tolerance);
  EXPECT_THAT(c.text(), HasSubstr("NOT all of the cut is judged, line " + std::to_string(most.line)));
}

TEST(Verdict, AWorkOffsetThatTheJobLacksIsRefused) {
  auto e = load(trial("square_in_g55.ngc"), testing::example_path("slavkovic_square", "job.toml"));
  EXPECT_EQ(refused(e).id, "MC307");
  e.job.offset_given[1] = true;
  EXPECT_TRUE(machining::predict(e.job, e.program, e.interpretation));
}

TEST(Verdict, TwoToolsNeedTwoCutters) {
  const auto e = with_program("slavkovic_groove",
                              "G21 G90 T1 M6 S12000 M3\nG0 X-45 Y0 Z10\nG1 Z-2 F600\nG1 X0 F1800\nG0 Z10\n"
                              "T2 M6\nG0 X0 Y0\nG0 Z5\nG1 Z-2 F600\nG1 X45 F1800\nG0 Z10\nM2\n");
  const Error error = refused(e);
  EXPECT_EQ(error.id, "MC308");
  EXPECT_THAT(error.message, HasSubstr("T2"));
}

TEST(Verdict, AMachineWithoutCompliancesIsRefused) {
  auto e = load(trial("slot.ngc"), trial("slot.toml"));
  e.job.machine = unwrap(machine::load("hexapod-strut"));
  EXPECT_EQ(refused(e).id, "AP105");
}

TEST(Verdict, ACorrectedProgramIsNotCorrectedAgain) {
  auto e = load(trial("slot.ngc"), trial("slot.toml"));
  e.program = unwrap(gcode::parse(correct(e).text(), "again.ngc"));
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  EXPECT_EQ(refused(e).id, "MC306");
  machining::CorrectOptions options;
  options.again = true;
  EXPECT_TRUE(machining::correct(e.job, e.program, e.interpretation, options));
  std::string capitals = gcode::to_text(e.program);
  for (char& c : capitals) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  e.program = unwrap(gcode::parse(capitals, "CAPITALS.NGC"));
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  EXPECT_EQ(refused(e).id, "MC306");
}

/// A strut hexapod that the drives do not hold at C = 90 deg (Fichter 1986), 4 mm mill, aluminium.
testing::Example fichter(const std::string& moves) {
  auto e = load(trial("slot.ngc"), trial("slot.toml"));
  e.job.machine = unwrap(machine::from_text(R"(family = "strut-hexapod"
base = { radius_mm = 200, pair_angle_deg = 30 }
platform = { radius_mm = 100, pair_angle_deg = 30 }
leg = { length_min_mm = 100, length_max_mm = 600, compliance_um_per_N = 0.05 }
joint = { limit = "cone", cone_deg = 89 }
tool = { length_mm = 50 }
home = { height_mm = 300 }
)",
                                            "fichter.toml"));
  e.job.X_MW = {Mat3::Identity(), Vec3(0, 0, 0.35)};
  e.program = unwrap(gcode::parse("G21 G90 G94 G17\nS8000 M3\n" + moves, "test.ngc"));
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  return e;
}

// With a pseudo-inverse for the compliance it was a yes, 64 um.
TEST(Verdict, WhereTheDrivesDoNotHoldTheToolThereIsNoYes) {
  const auto judged = [](const testing::Example& e) {
    return unwrap(machining::check(e.job.machine, e.job.X_MW, e.program, e.interpretation));
  };
  const auto lost = fichter("G0 X-20 Y-5 Z10 A0 B0 C90\nG1 Z-1 F300\nG1 X20 F600\nG0 Z10\nM30\n");
  ASSERT_FALSE(judged(lost).ok);
  EXPECT_EQ(judged(lost).problems.front().kind, "singular");
  EXPECT_FALSE(judged(lost).problems.front().held);
  testing::Example set_up = lost;
  ASSERT_TRUE(machining::set_up(set_up.job, set_up.program, set_up.interpretation));
  EXPECT_EQ(refused(set_up).id, "MC210");
  const auto none = machining::predict(set_up.job, set_up.program, set_up.interpretation);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().id, "MC210") << to_string(none.error());

  const auto passed = fichter("G0 X-20 Y-5 Z10 A0 B0 C0\nG1 X20 C150.3 F600\nG0 Z20\nM30\n");
  ASSERT_FALSE(judged(passed).ok);
  EXPECT_EQ(judged(passed).problems.front().line, 4);
  EXPECT_THAT(judged(passed).problems.front().detail, HasSubstr("passes a singular pose"));

  const auto beside = fichter("G0 X-20 Y-5 Z10\nG1 Z-1 F300\nG1 X20 F600\nG0 Z10\nM30\n");
  EXPECT_TRUE(judged(beside).ok);
  const auto p = machining::predict(beside.job, beside.program, beside.interpretation);
  EXPECT_TRUE(p) << (p ? "" : to_string(p.error()));
}

TEST(Verdict, TheDiscKeepsItsSize) {
  const auto e = load(trial("disc.ngc"), trial("disc.toml"));
  const auto c = correct(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_THAT(c.text(), HasSubstr("G2 "));
  EXPECT_LT(std::abs(to_um(c.after.normal.mean)), 5) << "chords cut 42 um into the part on average";
}

TEST(Verdict, RampsFeelTheEndOfTheCutter) {
  for (const char* file : {"ramps.ngc", "steep_plunge.ngc"}) {
    const auto e = load(trial(file), trial("plate.toml"));
    const auto p = testing::predict(e);
    std::string notes;
    for (const std::string& note : p.notes) notes += note;
    EXPECT_THAT(notes, HasSubstr("with the end of the cutter")) << file;
    EXPECT_THAT(notes, HasSubstr("assumption")) << file;
    // The thrust pushes the tool up, or aside on a steep way; with coefficients of its own ten times as large, some
    // times as far: it goes no higher than it stood.
    const auto pushed = [](const machining::Prediction& of) { return std::max(of.vertical.max, -of.normal.min); };
    auto hard = e;
    const double k = 10 * e.job.material.ktc;
    hard.job.material.end = cutting::EndCoefficients{k, 0, k, 0, 0, 0};
    EXPECT_GT(pushed(testing::predict(hard)), 3 * pushed(p)) << file;
    EXPECT_GT(to_um(pushed(p)), 50) << file;
  }
}

/// The groove's machine and block with end edges that push by N_z R K_ae = 400 N: 1.2 mm of deflection.
Example hard_end(const std::string& moves) {
  auto e = with_program("slavkovic_groove", "G21 G90 G94 G17\nT1 M6\nS12000 M3\nG0 X-25 Y0 Z5\nG1 Z-2 F600\nF1200\n" +
                                                moves + "G0 Z5\nM2\n");
  const double per_metre = 400 / (e.job.cutter.teeth * e.job.cutter.radius());
  e.job.material.end = cutting::EndCoefficients{0, 0, 0, 0, 0, per_metre};
  return e;
}

// Whether the end cut once depended on the step: 1286 um at 0.5 mm, 518 um at 0.1 mm, and a yes with the latter.
TEST(Verdict, TheEndOnARampDoesNotDependOnTheStep) {
  const auto e = hard_end("G1 X-20\nG1 X-5 Z-2.75\nG1 X10 Z-3.5\nG1 X20\n");
  const auto at = [&](double step) {
    machining::PredictOptions options;
    options.step = step;
    return testing::predict(e, options);
  };
  const auto fine = at(0.05e-3);
  ASSERT_GT(to_um(fine.largest_distance), 500);
  for (const double step : {0.1e-3, 0.25e-3, 0.5e-3}) {
    EXPECT_NEAR(to_um(at(step).largest_distance), to_um(fine.largest_distance), 0.06 * to_um(fine.largest_distance))
        << step;
  }
}

// Nothing lies above the floor that was left: a tool that the end holds up stands no higher.
TEST(Verdict, AToolIsNotHeldAboveTheFloor) {
  const auto e = hard_end("G1 X0\nG1 X2 Z-2.2\nG1 X20\n");
  machining::PredictOptions options;
  options.step = 0.05e-3;
  options.keep_samples = true;
  const auto p = testing::predict(e, options);
  double floor = -2e-3, highest = 0, lifted = 0;
  for (const machining::Sample& s : p.samples) {
    if (!s.cutting) continue;
    const Vec3 tip = s.command + s.deflection;
    if (tip.x() < -2e-3) floor = std::max(floor, tip.z());
    if (tip.x() < 0.2e-3 || tip.x() > 1.8e-3) continue;
    highest = std::max(highest, tip.z() - floor);
    lifted = std::max(lifted, s.deflection.z());
  }
  EXPECT_LT(to_um(highest), 20);
  // Nor does it go down while the command has sunk by less than 400 N bend the tool.
  EXPECT_GT(to_um(lifted), 100);
}

// Cutters that the program does not use say nothing of its vibration.
TEST(Verdict, AnUnusedBallDoesNotStopTheVibration) {
  const auto e = [](const std::string& tool) {
    auto out = with_program("slavkovic_groove", "G21 G90 G94 G17\n" + tool +
                                                    " M6\nS12000 M3\nG0 X-36 Y0 Z5\nG1 Z-1 F600\nG1 X0\nG0 Z5\nM2\n");
    out.job.cutters[2] = out.job.cutter;
    out.job.cutters[2].corner_radius = out.job.cutter.radius();
    return out;
  };
  const auto flat = e("T1"), ball = e("T2");
  EXPECT_EQ(machining::no_vibration(flat.job, flat.interpretation), "");
  EXPECT_THAT(machining::no_vibration(ball.job, ball.interpretation), HasSubstr("corner radius"));
}

// A slot that ends in the middle of the block, and then G28: the same rapid with its end known is a collision.
TEST(Verdict, AWayToAPlaceOfTheMachineOutOfTheMaterialIsNotJudged) {
  const auto answer = [](const std::string& away) {
    const auto e = with_program(
        "slavkovic_groove", "G21 G90 G94 G17\nT1 M6\nS12000 M3\nG0 X-36 Y0 Z5\nG1 Z-1 F600\nG1 X0\n" + away + "M2\n");
    const auto c = machining::correct(e.job, e.program, e.interpretation);
    EXPECT_TRUE(c) << away << (c ? "" : to_string(c.error()));
    return c && c->within_tolerance;
  };
  EXPECT_TRUE(answer("G0 Z5\n"));
  EXPECT_TRUE(answer("G0 Z5\nG28\n"));
  EXPECT_TRUE(answer("G53 G0 Z0\nG28\n"));
  EXPECT_FALSE(answer("G28\n"));
  EXPECT_FALSE(answer("G53 G0 X0 Y0 Z0\n"));
  // At a feed it may cut, from wherever it comes.
  EXPECT_FALSE(answer("G0 Z5\nG53 G1 X30 Y5 Z-3 F300\n"));
  EXPECT_FALSE(answer("G0 Z5\nG1 X1 F300\nG53 Z-3\n"));
}

TEST(Verdict, ThePathControlModeThatTheToleranceNeedsIsWritten) {
  const auto e = testing::load_example("slavkovic_square");
  const auto c = correct(e);
  EXPECT_TRUE(c.within_tolerance);
  // LinuxCNC rounds the corners of the square by 375 um under plain G64 (recorded).
  EXPECT_NEAR(to_um(c.modes.corner_before), 375, 1);
  ASSERT_THAT(c.modes.written, ::testing::StartsWith("G64 P0.0"));
  EXPECT_THAT(c.text(), HasSubstr("G21 " + c.modes.written + "\n"));
  double written = 0;
  std::sscanf(c.modes.written.c_str(), "G64 P%lf", &written);
  EXPECT_LE(to_um(c.modes.corner_after), 1e3 * written + 0.1);
  EXPECT_LE(to_um(c.largest_after), 100);
}

/// A slot under G64 P0.3, whose corners leave the tube, and then `moves`.
Example wide_corners(const std::string& moves) {
  auto e = load(trial("slot.ngc"), trial("slot.toml"));
  e.program =
      unwrap(gcode::parse("G21 G90 G94 G17 G54 G64 P0.3\nT1 M6\nS12000 M3\nG0 X-25 Y0 Z10\nG0 Z2\nG1 Z-2 F60\n"
                          "G1 X20 F1800\n" +
                              moves + "G0 Z10\nM5\nM30\n",
                          "test.ngc"));
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  return e;
}

TEST(Verdict, AModeThatBreaksTheTubeIsReplaced) {
  const auto c = correct(wide_corners("G1 Y15\n"));
  EXPECT_THAT(c.modes.replaced, ::testing::ElementsAre(1));
  EXPECT_EQ(c.text().find("P0.3"), std::string::npos);
  EXPECT_THAT(c.text(), HasSubstr("G54 " + c.modes.written));
  EXPECT_TRUE(c.within_tolerance) << c.reason;
}

// G61 rounds nothing: it stays where the G64 before it is replaced.
TEST(Verdict, AnExactModeBesideOneThatBreaksTheTubeStays) {
  EXPECT_THAT(correct(wide_corners("G61\nG1 Y15\nG1 X10\n")).modes.replaced, ::testing::ElementsAre(1));
}

TEST(Verdict, NoBlockIsTooShortForTheController) {
  auto e = testing::load_example("slavkovic_square");
  e.job.controller.shortest_length = 0.3e-3;
  const auto c = correct(e);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  for (std::size_t i = 0; i < c.commanded.size(); ++i) {
    if (c.commanded[i].followed == nullptr) continue;  // transitions are as long as the deflection
    EXPECT_GE(c.commanded[i].move.length(), 0.29e-3) << "move " << i;
  }
}

TEST(Verdict, BothPositionsOfBlockDeleteAreJudged) {
  auto e = load(trial("slot.ngc"), trial("slot.toml"));
  e.program =
      unwrap(gcode::parse("G21 G90 G94 G17 G54\nT1 M6\nS12000 M3\nG0 X-45 Y0 Z10\nG0 Z2\n/G1 Z-1 F600\n/G1 X45 F1800\n"
                          "/G0 Z2\n/G0 X-45\nG1 Z-2 F600\nG1 X45 F1800\nG0 Z10\nM5\nM30\n",
                          "test.ngc"));
  e.interpretation = unwrap(gcode::interpret(e.program, e.job.interpret_options()));
  const auto c = correct(e);
  ASSERT_TRUE(c.other_switch);
  EXPECT_TRUE(c.other_switch->block_delete);
  // Corrected for half the depth at each pass, the whole depth at once deflects the tool twice as far.
  EXPECT_GT(to_um(c.other_switch->distance_after), 100);
  EXPECT_FALSE(c.within_tolerance);
  EXPECT_THAT(c.reason, HasSubstr("line 11: with block delete on"));
  EXPECT_EQ(c.other_switch->line, 11);
}

TEST(Verdict, WhatWouldHelpDoes) {
  auto e = testing::load_example("slavkovic_groove");
  e.job.tolerance = 3e-6;
  const auto c = correct(e);
  ASSERT_FALSE(c.within_tolerance);
  ASSERT_FALSE(c.remedies.empty());
  double tube = 0;
  ASSERT_EQ(std::sscanf(c.remedies.front().c_str(), "a tube of %lf um", &tube), 1) << c.remedies.front();
  e.job.tolerance = units::from_um(tube);
  EXPECT_TRUE(correct(e).within_tolerance);
}

TEST(Verdict, MovesInsideTheTubeAreCorrectedWhereItAddsNoLines) {
  auto e = testing::load_example("slavkovic_groove");
  e.job.tolerance = 300e-6;
  EXPECT_EQ(correct(e).rewritten_moves, 0);
  machining::CorrectOptions options;
  options.all = true;
  const auto c = correct(e, options);
  const std::size_t header = 7 + (c.modes.written.empty() ? 0 : 1);
  EXPECT_EQ(c.lines_out, c.lines_in + header);
  EXPECT_LE(c.largest_distance, c.before.largest_distance);
}

/// At x = 25 mm the front of the cutter is at the edge of the stock: the force is still the whole one, which the mean
/// over the way ahead does not see. In closed form the tool is 71.6 um off there, though 44 um are found.
TEST(Verdict, AForceThatFallsWithinTheWayAheadIsNamed) {
  auto e = load(trial("wide_cutter_leaves.ngc"), trial("wide_cutter_leaves.toml"));
  e.job.tolerance = 60e-6;
  const auto c = correct(e);
  ASSERT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_GT(to_um(c.after.steep.distance), 71.6);
  EXPECT_LT(to_um(c.after.steep.distance), 1.2 * 71.6);
  EXPECT_GT(c.after.steep.length, 0);
  EXPECT_NEAR(c.after.steep.window, 0.04 * e.job.cutter.diameter, 1e-9);
  // Where the tube holds what the force may still be, nothing is open.
  e.job.tolerance = 100e-6;
  EXPECT_EQ(correct(e).after.steep.distance, 0);
}

/// Where the bend was taken to change evenly along a transition, these corners were called 50 um off.
TEST(Verdict, ATransitionOnWhichTheToolGoesOnIsNotWithinTheTube) {
  auto e = load(trial("corners.ngc"), trial("corners.toml"));
  e.job.tolerance = 60e-6;
  const auto c = correct(e);
  EXPECT_GT(c.transitions, 20);
  EXPECT_FALSE(c.within_tolerance);
  EXPECT_GT(to_um(c.largest_distance), 65);
  // No tool goes on by more than the bend that its command takes back.
  EXPECT_LT(to_um(c.largest_distance), to_um(c.before.largest_distance));
}

/// A feed down to the surface of the stock cuts nothing, whatever stands below its end.
TEST(Verdict, AFeedDownToTheSurfaceIsNoCut) {
  for (const char* height : {"Z0", "Z0.2"}) {
    const auto e =
        testing::with_program("slavkovic_groove", std::string("G21 G90 G17 G94\nT1 M6\nS12000 M3\nG0 X-20 Y0 Z5\nG1 ") +
                                                      height + " F300\nG1 X0 Z-2 F600\nG1 X20\nG0 Z5\nM2\n");
    machining::PredictOptions fine;
    fine.step = 0.1e-3;
    for (const machining::MovePrediction& m : testing::predict(e, fine).moves) EXPECT_NE(m.line, 5) << height;
    for (const machining::MoveOutcome& m : correct(e).moves) EXPECT_NE(m.line, 5) << height;
  }
}

/// The ramps stay as they were, and the helix is improved all the same: it once lost its correction to them.
TEST(Verdict, WhatCanBeImprovedIsBesideWhatCannot) {
  const auto e = load(trial("ramp_and_helix.ngc"), trial("ramp_and_helix.toml"));
  const auto c = correct(e);
  EXPECT_FALSE(c.within_tolerance);
  for (const machining::MoveOutcome& m : c.moves) {
    EXPECT_LT(to_um(m.distance_after), to_um(m.distance_before) + 1.01) << "line " << m.line;
    if (m.line != 13 && m.line != 14) continue;
    EXPECT_TRUE(m.rewritten);
    EXPECT_EQ(m.within, m.line == 13);
    EXPECT_LT(m.distance_after, 0.8 * m.distance_before);
  }
  // Where no mode brings a corner inside, it is not left to plain G64 either.
  auto rounded = e;
  rounded.program = unwrap(gcode::parse("G64\n" + gcode::to_text(e.program), "rounded.ngc"));
  rounded.interpretation = unwrap(gcode::interpret(rounded.program, rounded.job.interpret_options()));
  machining::CorrectOptions quick;
  quick.rounds = 2;
  const auto r = correct(rounded, quick);
  EXPECT_FALSE(r.within_tolerance);
  EXPECT_LT(to_um(r.modes.corner_after), 80);
}

/// A tube that cannot be kept is no reason for a worse program: tubes of 54 um and more leave 52.6 um.
TEST(Verdict, ATighterTubeLeavesNoMore) {
  auto e = load(trial("soft_slot.ngc"), trial("soft_slot.toml"));
  const double wide = correct(e).largest_distance;
  EXPECT_TRUE(correct(e).within_tolerance);
  for (const double tube : {50.0, 30.0}) {
    e.job.tolerance = units::from_um(tube);
    const auto c = correct(e);
    EXPECT_FALSE(c.within_tolerance);
    EXPECT_LT(to_um(c.largest_distance), 1.05 * to_um(wide)) << tube;
  }
}

/// A yes says how far the bend may be where the force changes quickly, inside the tube, too.
TEST(Verdict, AYesSaysWhereTheForceChangesQuickly) {
  auto e = load(trial("soft_slot.ngc"), trial("soft_slot.toml"));
  e.job.tolerance = 150e-6;
  const auto c = correct(e);
  ASSERT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_EQ(c.after.steep.distance, 0);
  EXPECT_GT(c.after.steep.within, c.largest_distance);
  EXPECT_LE(c.after.steep.within, e.job.tolerance);
  EXPECT_EQ(c.after.steep.within_line, 7);
}

/// What was not looked at with finer cells does not say so.
TEST(Verdict, ANoIsNotCalledVerified) {
  auto e = load(trial("soft_slot.ngc"), trial("soft_slot.toml"));
  machining::CorrectOptions options;
  options.verify = true;
  e.job.tolerance = 30e-6;
  EXPECT_FALSE(correct(e, options).verified);
  e.job.tolerance = 100e-6;
  const auto c = correct(e, options);
  EXPECT_TRUE(c.within_tolerance) << c.reason;
  EXPECT_TRUE(c.verified);
  EXPECT_THAT(c.text(), HasSubstr("cutter 10 mm with 2 teeth"));
}

}  // namespace
}  // namespace polypod
