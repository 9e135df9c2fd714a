// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/correct.hpp"

#include <gmock/gmock.h>

#include <array>
#include <cstdio>
#include <sstream>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"

namespace polypod {
namespace {

using testing::expect_in_tube;
using ::testing::HasSubstr;
using testing::load_example;
using testing::with_program;
using units::to_um;

class Examples : public ::testing::TestWithParam<const char*> {};

TEST_P(Examples, EndInTheTube) {
  const auto e = load_example(GetParam());
  const auto c = testing::correct(e);
  expect_in_tube(e, c);
  EXPECT_GT(c.before.largest_distance, e.job.tolerance) << "there was something to correct";
  EXPECT_LT(std::abs(to_um(c.after.normal.mean)), 20);
  EXPECT_EQ(c.lines_out, c.program.blocks.size());
}

INSTANTIATE_TEST_SUITE_P(All, Examples,
                         ::testing::Values("slavkovic_square", "slavkovic_turned_square", "slavkovic_groove",
                                           "freecad_profile", "freecad_pocket"),
                         [](const auto& param) { return std::string(param.param); });

// The source's corrected programs have 10 points for the four sides; the corners, which it leaves out of account, need
// more.
TEST(Correct, SquareNeedsFewSegments) {
  for (const char* name : {"slavkovic_square", "slavkovic_turned_square"}) {
    const auto c = testing::correct(load_example(name));
    EXPECT_EQ(c.rewritten_moves, 4) << name;
    EXPECT_LE(c.pieces + c.transitions, 32) << name;
  }
}

TEST(Correct, StockThatTheNewProgramLeaves) {
  const auto e = testing::load_example("slavkovic_square");
  machining::CorrectOptions options;
  options.keep_stock = true;
  const auto c = testing::correct(e, options);
  const double before = e.job.stock.volume();
  EXPECT_NEAR(before - c.stock_left.volume(), c.after.pass.removed, 1e-5 * c.after.pass.removed);
  EXPECT_GT(c.after.pass.removed, 1.03 * c.before.pass.removed) << "the deflected tool leaves material, corrected less";
  EXPECT_EQ(testing::correct(e).stock_left.columns(), 0) << "not asked for";
}

TEST(Correct, WideTubeLeavesTheProgramAlone) {
  auto e = load_example("slavkovic_square");
  e.job.tolerance = 1e-3;
  const auto c = testing::correct(e);
  EXPECT_TRUE(c.within_tolerance);
  EXPECT_EQ(c.rewritten_moves, 0);
  // Only the header is new; plain G64 rounds the corners by less than the tube leaves.
  EXPECT_EQ(c.modes.written, "");
  const std::string before = gcode::to_text(e.program);
  std::string without_header;
  std::istringstream lines(c.text());
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("(Polypod:", 0) != 0) without_header += line + "\n";
  }
  EXPECT_EQ(without_header, before);
}

/// The header says the posture for which it holds, and of a machine with C how the tool was turned.
TEST(Correct, TheHeaderSaysThePosture) {
  auto e = load_example("slavkovic_square");
  EXPECT_THAT(testing::correct(e).text(), ::testing::HasSubstr("\n(Polypod: posture front elbow-up)\n"));
}

TEST(Correct, NarrowTubeNeedsMorePieces) {
  auto e = load_example("slavkovic_square");
  const auto wide = testing::correct(e);
  e.job.tolerance = 40e-6;
  const auto narrow = testing::correct(e);
  expect_in_tube(e, narrow);
  EXPECT_GT(narrow.pieces, wide.pieces);
}

TEST(Correct, ImpossibleTubeIsSaidWithItsLine) {
  auto e = load_example("slavkovic_groove");
  e.job.tolerance = 0.3e-6;
  const auto c = testing::correct(e);
  EXPECT_FALSE(c.within_tolerance);
  EXPECT_THAT(c.reason, HasSubstr("line "));
  EXPECT_THAT(c.reason, HasSubstr("tolerance is 0.3 um"));
}

TEST(Correct, ArcsStayArcs) {
  // A full circle round the outside of a boss, down-milling (clockwise).
  const std::string text = "G21 G90 G17 S8000 M3\nG0 X-40 Y0 Z5\nG1 Z-2 F100\nG2 X-40 Y0 I40 J0 F1600\nG0 Z5\nM2\n";
  auto e = with_program("slavkovic_groove", text);  // a block
  e.job.stock = testing::unwrap(cutting::Stock::block(Vec3(-0.04, -0.04, -0.02), Vec3(0.04, 0.04, 0), 0.16e-3));
  e.job.stock.keep([](double x, double y) { return std::hypot(x, y) < 0.04; });
  const auto coarse = testing::correct(e);
  expect_in_tube(e, coarse);
  EXPECT_THAT(coarse.text(), HasSubstr("G2 "));
  // A chord tolerance ten times smaller needs arcs of about 10^(1/3) times less length.
  machining::CorrectOptions options;
  options.chord = 1e-6;
  const auto fine = testing::correct(e, options);
  expect_in_tube(e, fine);
  EXPECT_GT(fine.pieces, 1.3 * coarse.pieces);
  // Chords of the same tolerance would be 140, and would all lie on one side.
  EXPECT_LT(coarse.pieces, std::numbers::pi / std::acos(1 - 10e-6 / 0.04));
  EXPECT_LT(std::abs(to_um(coarse.after.normal.mean)), 5);
}

TEST(Correct, InchAndIncrementalProgramsStayWhatTheyAre) {
  const auto metric = testing::correct(load_example("slavkovic_groove"));
  const auto inch =
      with_program("slavkovic_groove",
                   "G20 G90 S12000 M3\nG0 X-1.771653543 Y0 Z0.4\nG1 Z-0.07874015748 F24\nG91 G1 X3.543307087 "
                   "F70.866141732\nG90 G0 Z0.4\nM2\n");
  const auto c = testing::correct(inch);
  expect_in_tube(inch, c);
  EXPECT_EQ(c.pieces, metric.pieces);
  EXPECT_THAT(c.text(), HasSubstr("G20"));
  EXPECT_THAT(c.text(), HasSubstr("G91"));
  EXPECT_LT(std::abs(to_um(c.after.normal.mean)), 20);
}

TEST(Correct, MirrorAtManyPointsIsTheOneStepOfTheSource) {
  const auto e = load_example("slavkovic_square");
  machining::CorrectOptions options;
  options.method = machining::CorrectMethod::mirror;
  options.mirror_points = 20;
  const auto c = testing::correct(e, options);
  EXPECT_EQ(c.pieces, 4 * 20);
  EXPECT_LT(std::abs(to_um(c.after.normal.mean)), 20);
  // Equal steps do not see the corners: the tube needs fewer pieces and keeps it there.
  const auto tube = testing::correct(e);
  EXPECT_LT(tube.largest_distance, c.largest_distance);
  EXPECT_LT(tube.pieces, c.pieces);
}

// At the kink of the arc of line 27 a controller that goes on may be off by more than the tube leaves, whatever P: it
// was G61.1 for the whole program. A controller that is fast enough takes the arcs as they are.
TEST(Correct, ArcsThatWouldAskForStopsBecomeChordsOnBothSides) {
  auto e = load_example("freecad_profile");
  const auto chords = testing::correct(e);
  EXPECT_TRUE(chords.within_tolerance) << chords.reason;
  EXPECT_TRUE(chords.modes.written.starts_with("G64 P")) << chords.modes.written;
  EXPECT_LT(chords.modes.time_after, chords.modes.time_before);
  e.job.controller.planner.acceleration = 1000;
  const auto arcs = testing::correct(e);
  ASSERT_EQ(arcs.modes.chords, 0);
  ASSERT_EQ(arcs.moves.size(), chords.moves.size());
  const double chord = 0.1 * e.job.tolerance;
  int count = 0;
  for (std::size_t i = 0; i < arcs.moves.size(); ++i) {
    if (chords.moves[i].pieces <= arcs.moves[i].pieces) continue;
    ++count;
    const machining::Spread &now = chords.moves[i].normal_after, &before = arcs.moves[i].normal_after;
    EXPECT_NEAR(now.mean, before.mean, 0.1 * chord) << "of the right size on average";
    EXPECT_GT(now.min, before.min - 0.55 * chord);
    EXPECT_LT(now.max, before.max + 0.55 * chord);
    const double sweep = std::abs(chords.programmed[static_cast<std::size_t>(chords.moves[i].move)].sweep);
    const double fewest = sweep / (2 * std::acos(1 - chord / 2.5e-3));  // radius of the programmed arc 2.5 mm
    EXPECT_LT(chords.moves[i].pieces, 1.5 * fewest + 2);
  }
  EXPECT_EQ(count, chords.modes.chords);
  EXPECT_GT(count, 0);
  for (std::size_t c = 0; c < chords.commanded.size(); ++c) {
    const auto& m = chords.commanded[c];
    if (m.followed != nullptr && m.move.kind == gcode::MoveKind::arc) --count;  // not all became lines
  }
  EXPECT_LT(count, 0);
}

TEST(Correct, SameBytesTwice) {
  const auto e = load_example("freecad_profile");
  EXPECT_EQ(testing::correct(e).text(), testing::correct(e).text());
}

/// Canonical end points of LinuxCNC's own interpreter: x, y, z of STRAIGHT_FEED, STRAIGHT_TRAVERSE and ARC_FEED lines.
std::vector<std::array<double, 3>> rs274_ends(const std::string& text) {
  testing::Scratch scratch;
  EXPECT_TRUE(files::write_whole(scratch.file("p.ngc"), text));
  EXPECT_TRUE(files::write_whole(scratch.file("p.var"), ""));
  EXPECT_TRUE(files::write_whole(scratch.file("p.tbl"), "T1 P1 Z0.0 D0.0\nT2 P2 Z0.0 D0.0\n"));
  const std::string command = std::string(RS274) + " -t " + scratch.file("p.tbl") + " -v " + scratch.file("p.var") +
                              " -g " + scratch.file("p.ngc") + " 2>&1";
  std::FILE* pipe = ::popen(command.c_str(), "r");
  std::string output;
  char buffer[4096];
  for (std::size_t n = 0; (n = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) output.append(buffer, n);
  EXPECT_EQ(::pclose(pipe), 0) << output;
  std::vector<std::array<double, 3>> ends;
  std::istringstream lines(output);
  for (std::string line; std::getline(lines, line);) {
    std::array<double, 3> p{};
    if (const auto at = line.find("STRAIGHT_FEED("); at != std::string::npos) {
      std::sscanf(line.c_str() + at, "STRAIGHT_FEED(%lf, %lf, %lf", &p[0], &p[1], &p[2]);
    } else if (const auto rapid = line.find("STRAIGHT_TRAVERSE("); rapid != std::string::npos) {
      std::sscanf(line.c_str() + rapid, "STRAIGHT_TRAVERSE(%lf, %lf, %lf", &p[0], &p[1], &p[2]);
    } else if (const auto arc = line.find("ARC_FEED("); arc != std::string::npos) {
      double axis1 = 0, axis2 = 0;
      int turn = 0;
      std::sscanf(line.c_str() + arc, "ARC_FEED(%lf, %lf, %lf, %lf, %d, %lf", &p[0], &p[1], &axis1, &axis2, &turn,
                  &p[2]);
    } else {
      continue;
    }
    ends.push_back(p);
  }
  return ends;
}

// LinuxCNC's interpreter sees the moves that we see, in the original and in what we wrote (rs274 prints 4 decimals; all
// five examples are in the plane G17).
TEST_P(Examples, LinuxCncReadsTheSameEndPoints) {
  const auto e = load_example(GetParam());
  const auto c = testing::correct(e);
  const auto compare = [](const LongVector<gcode::Move>& moves, const std::string& text) {
    const auto ends = rs274_ends(text);
    ASSERT_EQ(ends.size(), moves.size());
    constexpr double kPrinted = 0.51e-4;  // mm: half of rs274's last digit
    for (std::size_t i = 0; i < ends.size(); ++i) {
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(ends[i][static_cast<std::size_t>(k)], units::to_mm(moves[i].end[k]), kPrinted) << "move " << i;
      }
    }
  };
  compare(e.interpretation.moves, gcode::to_text(e.program));
  LongVector<gcode::Move> commanded;
  for (const auto& m : c.commanded) commanded.push_back(m.move);
  compare(commanded, c.text());
}

}  // namespace
}  // namespace polypod
