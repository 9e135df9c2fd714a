// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Records that are made here: the program's path in steps of a millisecond, with corners rounded by a circle.
#include "polypod/machining/recorded.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"

namespace polypod {
namespace {

using machining::RecordedCut;
using machining::RecordedTip;
using testing::load_example;

/// The moves in steps of 1 ms at their feed (rapids at 200 mm/s), from where the first one ends.
std::vector<RecordedTip> record_of(const LongVector<gcode::Move>& moves, const Vec3& off = Vec3::Zero()) {
  std::vector<RecordedTip> out;
  double t = 0;
  for (const gcode::Move& move : moves) {
    if (!move.start_known) {
      out.push_back({t += 1e-3, 0, move.end + off});
      continue;
    }
    const double speed = move.kind == gcode::MoveKind::rapid ? 0.2 : move.feed, length = move.length();
    const int steps = std::max(1, static_cast<int>(std::ceil(length / (speed * 1e-3))));
    for (int k = 1; k <= steps && length > 0; ++k) out.push_back({t += 1e-3, 0, move.point(length * k / steps) + off});
  }
  return out;
}

RecordedCut judged(const testing::Example& e, const std::vector<RecordedTip>& record, const gcode::Program& ran_program,
                   const gcode::Interpretation& ran) {
  const auto out = machining::judge_recorded(e.job, e.program, e.interpretation, ran_program, ran, record, {});
  EXPECT_TRUE(out) << to_string(out.error());
  return out ? *out : RecordedCut{};
}

RecordedCut judged(const testing::Example& e, const std::vector<RecordedTip>& record) {
  return judged(e, record, e.program, e.interpretation);
}

// A controller that follows the program exactly makes what `predict` says.
TEST(Recorded, TheExactPathIsThePrediction) {
  const auto e = load_example("slavkovic_square");
  machining::PredictOptions options;
  options.step = 1e-4;
  const auto p = machining::predict(e.job, e.program, e.interpretation, options);
  ASSERT_TRUE(p);
  const RecordedCut r = judged(e, record_of(e.interpretation.moves));
  EXPECT_TRUE(r.to_the_end);
  EXPECT_LT(r.pieces, 40U);  // not one a millisecond
  ASSERT_EQ(r.cut.moves.size(), p->moves.size());
  for (std::size_t i = 0; i < p->moves.size(); ++i) {
    EXPECT_EQ(r.cut.moves[i].line, p->moves[i].line);
    EXPECT_NEAR(r.cut.moves[i].normal.mean, p->moves[i].normal.mean, 0.5e-6);
    EXPECT_NEAR(r.cut.moves[i].normal.max, p->moves[i].normal.max, 1e-6);
  }
  // Nothing is taken back: the normal error is the deflection.
  EXPECT_NEAR(r.gain.removed_mean(), 0, 1e-3);
  EXPECT_NEAR(r.gain.removed_rms(), 0, 1e-3);
  for (const auto& c : r.corners) EXPECT_LT(c.recorded, 1e-9);
}

// One that follows a correction exactly leaves what `correct` says, also on the ramps at the corners, whose commands
// lean.
TEST(Recorded, TheExactCorrectionLeavesWhatCorrectSays) {
  auto e = load_example("slavkovic_square");
  e.job.tolerance = 40e-6;
  const auto c = testing::correct(e);
  ASSERT_TRUE(c.within_tolerance) << c.reason;
  double lean = 0;
  gcode::Interpretation ran;
  for (std::size_t k = 0; k < c.commanded.size(); ++k) {
    const gcode::Move& written = c.commanded[k].move;
    ran.moves.push_back(written);
    if (c.commanded[k].transition || written.kind == gcode::MoveKind::rapid || !written.start_known) continue;
    const gcode::Move& meant = e.interpretation.moves[static_cast<std::size_t>(c.source[k])];
    lean = std::max(lean, angle_between(written.direction(0), meant.direction(0)));
  }
  ASSERT_GT(lean, 0.11);
  const RecordedCut r = judged(e, record_of(ran.moves), c.program, ran);
  EXPECT_TRUE(r.to_the_end);
  // Where a transition begins the record says only to the way over which its direction is taken (0.05 mm to each side).
  EXPECT_NEAR(r.cut.largest_distance, c.largest_distance, 3e-6);
}

// A controller that slows down in a cut to a tenth of the feed, over a tenth of a millimetre: there the tool deflects
// as at a tenth of the feed.
TEST(Recorded, WhereItSlowsDownTheChipsAreThinner) {
  const std::string path = "G0 X-20 Y0\nG0 Z-2\nG1 X20\nG0 Z5\nM2\n",
                    begin = "G21 G90 G17 G94\nT1 M6\nS12000 M3\nG0 Z5\n";
  const auto e = testing::with_program("slavkovic_groove", begin + "F1600\n" + path);
  const auto slowly = testing::with_program("slavkovic_groove", begin + "F160\n" + path);
  const double feed = 1600e-3 / 60, slow = 0.1 * feed, a = 1, middle = 0.02,
               ramp = (feed * feed - slow * slow) / (2 * a);
  std::vector<RecordedTip> record;
  double t = 0;
  for (const gcode::Move& move : e.interpretation.moves) {
    if (!move.start_known || move.kind == gcode::MoveKind::rapid) {
      record.push_back({t += 1e-3, 0, move.end});
      continue;
    }
    for (double s = 0, v = feed; s < move.length();) {
      const double way = std::max(0.0, std::abs(s - middle) - 1e-3);
      v = way < ramp ? std::sqrt(slow * slow + 2 * a * way) : feed;
      s = std::min(move.length(), s + v * 1e-3);
      record.push_back({t += 1e-3, 0, move.point(s)});
    }
  }
  const RecordedCut r = judged(e, record);
  const auto at_middle = [&](const LongVector<machining::Sample>& samples) {
    const machining::Sample* nearest = nullptr;
    for (const machining::Sample& s : samples) {
      if (!s.cutting) continue;
      const auto off = [&](const machining::Sample& of) { return (of.command - Vec3(0, 0, -2e-3)).norm(); };
      if (nearest == nullptr || off(s) < off(*nearest)) nearest = &s;
    }
    return nearest->deflection;
  };
  machining::PredictOptions options;
  options.step = 1e-4;
  options.keep_samples = true;
  const Vec3 expected = at_middle(testing::predict(slowly, options).samples);
  const Vec3 at_feed = at_middle(testing::predict(e, options).samples);
  ASSERT_GT((at_feed - expected).norm(), 50e-6);
  EXPECT_LT((at_middle(r.cut.samples) - expected).norm(), 0.01 * (at_feed - expected).norm());
}

// Shifted as a whole across two of the four sides by the mean deflection there: it takes away as much.
TEST(Recorded, AShiftedPathRemovesItsShift) {
  const auto e = load_example("slavkovic_square");
  const RecordedCut plain = judged(e, record_of(e.interpretation.moves));
  const Vec3 off(0, -100e-6, 0);  // into the wall of the first side, off that of the third
  const RecordedCut r = judged(e, record_of(e.interpretation.moves, off));
  ASSERT_EQ(r.gain_by_line.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    const machining::Gain& g = r.gain_by_line[i].second;
    const double expected = i == 0 ? -100e-6 : i == 2 ? 100e-6 : 0;
    // More or less material there changes the force by some per cent.
    EXPECT_NEAR(g.mean_left - g.mean_deflection, expected, 0.5e-6) << i;
    EXPECT_NEAR(g.mean_deflection, plain.gain_by_line[i].second.mean_deflection, 0.04 * g.mean_deflection) << i;
  }
  EXPECT_NEAR(r.gain_by_line[0].second.removed_mean(), 100e-6 / r.gain_by_line[0].second.mean_deflection, 0.01);
}

// A circle of radius R in a corner of 90 deg leaves it by R (sqrt 2 - 1).
TEST(Recorded, ARoundedCornerInClosedForm) {
  const auto e = load_example("slavkovic_square");
  std::vector<RecordedTip> record = record_of(e.interpretation.moves);
  constexpr double kRadius = 0.9e-3;
  const Vec3 corner(0.125, 0.125, -2e-3), centre = corner + Vec3(-kRadius, -kRadius, 0);
  for (RecordedTip& tip : record) {
    const Vec3 d = tip.p_W - centre;
    if (std::abs(tip.p_W.z() - corner.z()) > 1e-9 || d.x() < 0 || d.y() < 0) continue;
    // The same share of the quarter turn as of the two legs.
    const double way = d.y() > kRadius - 1e-12 ? d.x() : 2 * kRadius - d.y();
    const double angle = std::numbers::pi / 2 * (1 - way / (2 * kRadius));
    tip.p_W = centre + kRadius * Vec3(std::cos(angle), std::sin(angle), 0);
  }
  const RecordedCut r = judged(e, record);
  ASSERT_FALSE(r.corners.empty());
  int seen = 0;
  for (const auto& c : r.corners) {
    if (!c.cutting || std::abs(units::to_deg(c.turn) - 90) > 1e-6) continue;
    ++seen;
    // Chords of a millisecond are 24 um long: their middle lies 0.08 um inside.
    EXPECT_NEAR(c.recorded, c.line == 11 ? kRadius * (std::sqrt(2.0) - 1) : 0, 0.2e-6) << c.line;
  }
  EXPECT_GE(seen, 3);
  // The bent tool keeps to a curve round the corner and does not jump.
  EXPECT_LT(r.cut.largest_distance, 500e-6);
}

// Pecks go over the same places again and again: a record that is a hair above the start of a feed move, or beside it,
// is not yet on the way back.
TEST(Recorded, PecksAreFollowedInTheirOrder) {
  const auto e = testing::with_program(
      "slavkovic_groove",
      "G21 G90 G17 G94\nT1 M6\nS12000 M3\nG0 X0 Y0 Z5\nG0 Z1.27\nG1 Z-0.254 F200\nG0 Z1.27\nG0 Z0\n"
      "G1 Z-1.778\nG0 Z1.27\nG0 Z-1.524\nG1 Z-3.302\nG0 Z5\nM2\n");
  std::vector<RecordedTip> record;
  double t = 0;
  for (const gcode::Move& move : e.interpretation.moves) {
    LongVector<gcode::Move> one;
    one.push_back(move);
    for (RecordedTip tip : record_of(one)) {
      tip.time = t += 1e-3;
      record.push_back(tip);
    }
    if (move.kind == gcode::MoveKind::rapid) record.push_back({t += 1e-3, 0, move.end + Vec3(0, 0.1e-6, 0.03e-6)});
  }
  const RecordedCut r = judged(e, record);
  EXPECT_TRUE(r.to_the_end);
  const auto p = testing::predict(e);
  ASSERT_EQ(r.cut.moves.size(), p.moves.size());
  for (std::size_t i = 0; i < p.moves.size(); ++i) EXPECT_EQ(r.cut.moves[i].line, p.moves[i].line);
  EXPECT_NEAR(r.cut.pass.removed, p.pass.removed, 0.01 * p.pass.removed);
}

// Full circles come back to where they began: after a tangential way in, one after the other, and helices before a flat
// one, with the tip off by the deflection.
TEST(Recorded, FullCirclesAreFollowedRound) {
  const auto e = testing::with_program(
      "slavkovic_groove",
      "G21 G90 G17 G94\nT1 M6\nS12000 M3\nG0 X-2 Y0 Z5\nG1 Z0.2 F400\nG3 X2 Y0 I2 J0 F700\nG3 X2 Y0 Z-0.5 I-4 J0\n"
      "G3 X2 Y0 I-4 J0\nG3 I-4\nG3 X-2 Y0 I-2 J0\nG1 X-6\nG0 Z5\nM2\n");
  const auto p = testing::predict(e);
  for (const Vec3& off : {Vec3(0, 0, 0), Vec3(20e-6, 10e-6, 0), Vec3(-15e-6, -25e-6, 5e-6)}) {
    const RecordedCut r = judged(e, record_of(e.interpretation.moves, off));
    EXPECT_TRUE(r.to_the_end);
    for (const machining::MovePrediction& move : p.moves) {
      const auto of = std::find_if(r.cut.moves.begin(), r.cut.moves.end(),
                                   [&](const machining::MovePrediction& m) { return m.line == move.line; });
      ASSERT_NE(of, r.cut.moves.end()) << "line " << move.line;
      EXPECT_NEAR(of->normal.mean, move.normal.mean, 40e-6) << "line " << move.line;
    }
  }
}

TEST(Recorded, RefusesAnotherProgram) {
  const auto e = load_example("slavkovic_square");
  std::vector<RecordedTip> record = record_of(e.interpretation.moves);
  for (std::size_t k = record.size() / 2; k < record.size(); ++k) record[k].p_W.x() += 20e-3;
  auto out = machining::judge_recorded(e.job, e.program, e.interpretation, e.program, e.interpretation, record, {});
  ASSERT_FALSE(out);
  EXPECT_EQ(out.error().id, "MC330");
  for (RecordedTip& tip : record) tip.p_W = Vec3(1, 1, 1);
  out = machining::judge_recorded(e.job, e.program, e.interpretation, e.program, e.interpretation, record, {});
  ASSERT_FALSE(out);
  EXPECT_EQ(out.error().id, "MC330");
  record.resize(1);
  out = machining::judge_recorded(e.job, e.program, e.interpretation, e.program, e.interpretation, record, {});
  ASSERT_FALSE(out);
  EXPECT_EQ(out.error().id, "MC331");
}

// A record that was broken off is not called good to its end.
TEST(Recorded, SaysWhereItEnds) {
  const auto e = load_example("slavkovic_square");
  std::vector<RecordedTip> record = record_of(e.interpretation.moves);
  record.resize(record.size() / 2);
  const RecordedCut r = judged(e, record);
  EXPECT_FALSE(r.to_the_end);
  EXPECT_EQ(r.last_line, 12);  // both sides of 250 mm take 9.4 s, the whole 38 s
}

}  // namespace
}  // namespace polypod
