// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/predict.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using testing::load_example;
using ::testing::Not;
using testing::with_program;
using units::to_um;

machining::PredictOptions at_rest() {
  machining::PredictOptions options;
  options.bend = machining::Bend::at_rest;
  return options;
}

// FACTS: down-milling at ae = 4, ap = 2 mm, 0.05 mm a tooth gives about (5.4, 110, 8.5) N, hence near (0, -1300, 0) mm
// a normal deflection of about 273 um on sides parallel to x and 190 to 240 um on sides parallel to y. In the middle of
// a side the point lies 125 mm off, where C_nn is up to 4 % larger; the height map's cells give 1 % in the force.
TEST(Predict, SquareAtRestIsClosedFormAlongItsSides) {
  const auto e = load_example("slavkovic_square");
  machining::PredictOptions options = at_rest();
  options.keep_samples = true;
  const auto p = testing::predict(e, options);
  ASSERT_EQ(p.moves.size(), 4u);
  const cutting::Engagement engaged = cutting::straight_engagement(e.job.cutter, cutting::CutSide::down, 4e-3, 2e-3);
  const Vec3 force = cutting::mean_force(e.job.cutter, e.job.material, engaged, 0.05e-3);
  EXPECT_NEAR(force.y(), 110, 2);
  int compared = 0;
  for (const machining::Sample& s : p.samples) {
    const gcode::Move& move = e.interpretation.moves[static_cast<std::size_t>(s.move)];
    // Away from the corners, where the cutter is in full engagement.
    if (move.length() < 0.2 || s.s < 0.02 || s.s > move.length() - 0.02) continue;
    const Vec3 t = move.direction(s.s), left(-t.y(), t.x(), 0);
    const Vec3 expected_force = t * force.x() + left * force.y() + Vec3(0, 0, force.z());
    const auto c = statics::compliance_at(e.job.machine, Pose{Mat3::Identity(), e.job.X_MW * s.command});
    ASSERT_TRUE(c.reachable);
    EXPECT_LT((s.deflection - c.displacement(expected_force)).norm(), 0.02 * s.deflection.norm());
    EXPECT_LT((s.away - left).norm(), 1e-12);  // down-milling round the outside: the wall is on the right
    ++compared;
  }
  EXPECT_GT(compared, 1500);
}

// SLAV 6.3: the measured error falls by 255 um on average on the side of the 242 mm square, 180 um on that of the
// turned one. Their axis u runs along the side: along x_M for the square, at 75 deg to it for the turned one, the first
// side of each of our programs. Origin of W assumed at (0, -1300, 0) mm in M.
TEST(Predict, MeasuredSidesOfTheContourTests) {
  const auto square = testing::predict(load_example("slavkovic_square"));
  ASSERT_EQ(square.moves.size(), 4u);
  EXPECT_NEAR(to_um(square.moves[0].normal.mean), 255, 0.15 * 255);
  const auto turned = testing::predict(load_example("slavkovic_turned_square"));
  ASSERT_EQ(turned.moves.size(), 4u);
  EXPECT_NEAR(to_um(turned.moves[0].normal.mean), 180, 0.20 * 180);
}

// SLAV 4.4 and FACTS: 103 N across the feed, 0.257 mm for 100 N.
TEST(Predict, GrooveTest) {
  const auto e = load_example("slavkovic_groove");
  machining::PredictOptions options = at_rest();
  options.keep_samples = true;
  const auto p = testing::predict(e, options);
  int compared = 0;
  for (const machining::Sample& s : p.samples) {
    if (std::abs(s.command.x()) > 20e-3 || !s.cutting) continue;
    EXPECT_NEAR(s.force.y(), 103, 1.0);
    ++compared;
  }
  EXPECT_GT(compared, 60);
  const auto c = statics::compliance_at(e.job.machine, Pose{Mat3::Identity(), Vec3(0, -1.3, 0)});
  EXPECT_NEAR(units::to_mm(c.displacement(Vec3(0, 100, 0)).y()), 0.257, 5e-4);
}

/// The groove in one line and in blocks of 0.2 mm is the same path: the lag of the tip along it is no distance from it,
/// at the ends of blocks either. A corner between them keeps its end.
TEST(Predict, ALineInShortBlocksIsALine) {
  const std::string head = "G21 G90 G17 G94\nG54\nT1 M6\nS12000 M3\nG0 X-45 Y0 Z10\nG0 Z2\nG1 Z-2 F600\n";
  std::string blocks = head;
  for (int k = 1; k <= 450; ++k) blocks += fmt::format("G1 X{:.1f} F1800\n", -45 + 0.2 * k);
  const auto one = testing::predict(testing::with_program("slavkovic_groove", head + "G1 X45 F1800\nG0 Z10\nM30\n"));
  const auto many = testing::predict(testing::with_program("slavkovic_groove", blocks + "G0 Z10\nM30\n"));
  EXPECT_NEAR(many.largest_distance, one.largest_distance, 0.5e-6);
  EXPECT_GT(one.largest_distance, 10e-6);
}

TEST(Predict, EquilibriumIsABalance) {
  const auto e = load_example("slavkovic_square");
  machining::PredictOptions options;
  options.keep_samples = true;
  const auto p = testing::predict(e, options);
  std::size_t compared = 0;
  for (const machining::Sample& s : p.samples) {
    if (!s.cutting) continue;
    const auto c = statics::compliance_at(e.job.machine, Pose{Mat3::Identity(), e.job.X_MW * s.command});
    // delta = C F up to the step of a cell at the rim: one strip's share of the bend.
    EXPECT_LT((s.deflection - c.displacement(s.force)).norm(), 8e-6);
    ++compared;
  }
  EXPECT_EQ(compared, p.deflection.count);
  // The bent cutter takes less than the rigid one on the outside of a contour.
  const auto rest = testing::predict(e, at_rest());
  EXPECT_LT(p.normal.mean, rest.normal.mean);
  EXPECT_GT(p.normal.mean, 0.85 * rest.normal.mean);
}

TEST(Predict, BandOfTheCoefficients) {
  // At rest the deflection is linear in the coefficients: all of them 10 % up is 10 % more of it.
  testing::Example e = testing::load_example("slavkovic_square");
  machining::PredictOptions at_rest;
  at_rest.bend = machining::Bend::at_rest;
  const cutting::Material& m = e.job.material;
  const auto all = [&](double share) {
    return std::array<double, 6>{share * m.ktc, share * m.krc, share * m.kac,
                                 share * m.kte, share * m.kre, share * m.kae};
  };
  e.job.material.spread = {all(0.1)};
  const machining::Prediction p = testing::predict(e, at_rest);
  const auto one = machining::force_band(e.job, e.program, e.interpretation, p, at_rest);
  ASSERT_TRUE(one);
  constexpr double kRounding = 1e-9;
  EXPECT_NEAR(one->deflection_mean / (0.1 * p.deflection.mean), 1, kRounding);
  EXPECT_NEAR(one->deflection_max / (0.1 * p.deflection.max), 1, kRounding);
  EXPECT_NEAR(one->normal_mean / (0.1 * std::abs(p.normal.mean)), 1, 1e-3);  // normal is taken at the nearest point
  ASSERT_EQ(one->normal_by_move.size(), p.moves.size());
  EXPECT_NEAR(one->normal_by_move[0] / (0.1 * std::abs(p.moves[0].normal.mean)), 1, 1e-3);
  // Independent variations add as squares.
  e.job.material.spread = {all(0.06), all(-0.08)};
  const auto two = machining::force_band(e.job, e.program, e.interpretation, p, at_rest);
  EXPECT_NEAR(two->deflection_mean / one->deflection_mean, 1, kRounding);
  e.job.material.spread.clear();
  EXPECT_EQ(machining::force_band(e.job, e.program, e.interpretation, p, at_rest)->deflection_mean, 0);
}

TEST(Predict, AProgramThatCutsNothingIsNamedWithTheReason) {
  const auto refused = [](const std::string& text) {
    const auto e = with_program("slavkovic_square", text);
    const auto p = machining::predict(e.job, e.program, e.interpretation);
    EXPECT_FALSE(p);
    EXPECT_EQ(p.error().id, "MC302");
    return to_string(p.error());
  };
  EXPECT_THAT(refused("G21 G90 S8000 M3\nG0 X0 Y0 Z20\nG1 X50 Y50 F1000\nG2 X0 Y0 R60\nM2\n"),
              HasSubstr("misses the stock by 20.000 mm in Z"));
  // 250 inches beside the part: meant in millimetres.
  EXPECT_THAT(refused("G20 G90 S8000 M3\nG0 X-130 Y125 Z1\nG1 Z-0.1 F10\nG1 X-125 Y124 F60\nG0 Z1\nM2\n"),
              HasSubstr("in millimetres it would be of the size of the stock"));
  // The square of 242 mm, 9.5 mm wide in a program that counts inches as millimetres, above the stock.
  EXPECT_THAT(refused("G21 G90 S8000 M3\nG0 X-4.76 Y-4.76 Z20\nG1 X4.76 Y4.76 F1000\nM2\n"),
              HasSubstr("in inches it would be of the size of the stock"));
  // Far too small in either unit.
  EXPECT_THAT(refused("G21 G90 S8000 M3\nG0 X0 Y0 Z20\nG1 X0.1 Y0.1 F1000\nM2\n"), Not(HasSubstr("in inches")));
}

TEST(Predict, AProgramThatMostlyCutsAirIsNoted) {
  const std::string side = "G21 G90\nT1 M6\nS8000 M3\nG0 X-125 Y-135 Z10\nG0 Z2\nG1 Z-2 F400\nG1 Y135 F1600\n";
  const auto notes = [](const std::string& text) {
    return testing::predict(with_program("slavkovic_square", text)).notes;
  };
  EXPECT_THAT(notes(side + "M2\n"), Not(Contains(HasSubstr("cut no material"))));
  // 270 mm along the side, 375 mm away from it; the way down counts for nothing.
  EXPECT_THAT(notes(side + "G1 X-500\nM2\n"),
              Contains(HasSubstr("1 of 2 feed moves, 58 % of their length, cut no material")));
}

TEST(Predict, AStockThatStandsLowerThanItsProgramIsNoYes) {
  // Three levels of a slot; the stock of the groove lies at Z -20 to 0.
  const auto levels = [](double top) {
    std::string text = "G21 G90 S8000 M3\nG0 X-25 Y0 Z20\n";
    for (int k = 1; k <= 3; ++k)
      text += fmt::format("G1 Z{:.1f} F400\nG1 X{} F1200\n", top - 0.5 * k, k % 2 == 1 ? 25 : -25);
    return with_program("slavkovic_groove", text + "G0 Z20\nM2\n");
  };
  const auto right = levels(0), low = levels(1.2);  // two of three levels in air
  EXPECT_TRUE(testing::predict(right).not_judged.empty());
  const auto p = testing::predict(low);
  ASSERT_EQ(p.not_judged.size(), 1u);
  EXPECT_THAT(p.not_judged[0].why, HasSubstr("pass above its top, by up to 0.700 mm"));
  EXPECT_FALSE(p.within(low.job));
  // Links as feed moves, as some CAM systems write them, have nothing below them.
  const auto links = with_program("slavkovic_groove",
                                  "G21 G90 S8000 M3\nG0 X-20 Y0 Z2\nG1 Z-1 F400\nG1 X-15 F1200\nG1 Z2\nG1 X20\nG1 Z-1 "
                                  "F400\nG1 X15 F1200\nG1 Z2\nG1 X-20\nM2\n");
  EXPECT_TRUE(testing::predict(links).not_judged.empty());
}

TEST(Predict, TheCutterThatStandsInForAToolIsNamed) {
  auto e = load_example("slavkovic_square");  // T1
  e.job.cutters[2] = e.job.cutter;
  EXPECT_THAT(testing::predict(e).notes,
              Contains("T1 has no [[tool]] in the job; [cutter] is taken, 8 mm in diameter"));
  e.job.cutters[1] = e.job.cutter;
  EXPECT_THAT(testing::predict(e).notes, Not(Contains(HasSubstr("has no [[tool]]"))));
}

TEST(Predict, ProgramsWithoutAFeedMoveAreRefused) {
  for (const char* text : {"M2\n", "G21 G90\nG0 X0 Y0 Z5\nM2\n"}) {
    const auto e = with_program("slavkovic_square", text);
    const auto p = machining::predict(e.job, e.program, e.interpretation);
    ASSERT_FALSE(p);
    EXPECT_EQ(p.error().id, "MC301");
  }
}

TEST(Predict, SecondLapOfARigidToolMeetsNothing) {
  const std::string lap = "G1 X-125 Y125\nX125\nY-125\nX-125\n";
  const auto e =
      with_program("slavkovic_square", "G21 G90 S8000 M3\nG0 X-125 Y-125 Z5\nG1 Z-2 F1600\n" + lap + lap + "M2\n");
  const auto p = testing::predict(e, at_rest());
  ASSERT_EQ(p.moves.size(), 5u) << "only the plunge and the first lap cut";
  // The bent tool leaves a quarter of a millimetre to the second lap.
  EXPECT_EQ(testing::predict(e).moves.size(), 9u);
}

// Two slots in one program, or in two with the stock that the first leaves: the second meets the same material.
TEST(Predict, StockThatIsLeftIsTheStockOfTheNextProgram) {
  const std::string begin = "G21 G90 G54 S12000 M3 F1800\n";
  const std::string first = "G0 X-45 Y0 Z10\nG1 Z-2\nG1 X45\nG0 Z10\n";
  const std::string second = "G0 X-45 Y5 Z10\nG1 Z-3\nG1 X45\nG0 Z10\n";
  const auto together = testing::predict(with_program("slavkovic_groove", begin + first + second + "M2\n"));
  machining::PredictOptions options;
  options.keep_stock = true;
  const auto one = testing::predict(with_program("slavkovic_groove", begin + first + "M2\n"), options);
  auto next = with_program("slavkovic_groove", begin + second + "M2\n");
  EXPECT_NEAR(one.stock_left.volume(), next.job.stock.volume() - one.pass.removed, 1e-5 * one.pass.removed);
  const auto fresh = testing::predict(next);
  next.job.stock = one.stock_left;
  const auto two = testing::predict(next);
  ASSERT_EQ(together.moves.size(), 2u);
  ASSERT_EQ(two.moves.size(), 1u);
  EXPECT_EQ(two.moves[0].deflection.max, together.moves[1].deflection.max);
  EXPECT_EQ(two.moves[0].normal.mean, together.moves[1].normal.mean);
  EXPECT_GT(fresh.moves[0].mean_force_size, 1.1 * two.moves[0].mean_force_size);
  EXPECT_EQ(fresh.stock_left.columns(), 0) << "not asked for";
}

// A rapid at the depth of the cut from wherever the tool stands may go through the part: no yes for that.
TEST(Predict, ARapidFromAnUnknownPlaceBelowTheTopIsNotJudged) {
  const std::string cut = "G1 X45 F1800\nG0 Z10\nM2\n", begin = "G21 G90 G54 S12000 M3\n";
  const auto low = testing::predict(with_program("slavkovic_groove", begin + "G0 Z-2\nG0 X-45 Y0\n" + cut));
  ASSERT_EQ(low.not_judged.size(), 2u);
  EXPECT_EQ(low.not_judged[0].line, 2);
  EXPECT_EQ(low.not_judged[1].line, 3);
  EXPECT_FALSE(low.within(with_program("slavkovic_groove", begin + cut).job));
  for (const char* start : {"G0 Z10\nG0 X-45 Y0\nG0 Z-2\n", "G0 X-45 Y0 Z10\nG0 Z-2\n", "G0 X-45 Y0\nG0 Z-2\n"}) {
    const auto high = testing::predict(with_program("slavkovic_groove", begin + start + cut));
    EXPECT_TRUE(high.not_judged.empty()) << start;
  }
  const auto into =
      testing::predict(with_program("slavkovic_groove", begin + "G0 X0 Y15\nG0 Z-1\nG0 X-45 Y0 Z-2\n" + cut));
  EXPECT_EQ(into.not_judged.size(), 1u) << "straight down into the stock";
}

// The other side of a block of which 18 of 20 mm are milled off: a slot of 5 mm meets 2 mm, a hollow below them.
TEST(Predict, ATurnedPartIsHollowWhereTheFirstSideWasCut) {
  auto thick = with_program("slavkovic_groove", "G21 G90 G54 S12000 M3 F1800\nG0 X-45 Y0 Z10\nG1 Z-5\nG1 X45\nM2\n");
  auto plate = thick, turned = thick;
  thick.job.stock.cut_line({-0.1, 0, -18e-3}, {0.1, 0, -18e-3}, 0.05);
  turned.job.stock = thick.job.stock.turned(cutting::Stock::Axis::x).shifted({0, 0, -20e-3});
  plate.job.stock =
      testing::unwrap(cutting::Stock::block({-30e-3, -20e-3, -2e-3}, {30e-3, 20e-3, 0}, plate.job.stock.cell()));
  const auto a = testing::predict(turned), b = testing::predict(plate);
  ASSERT_EQ(a.moves.size(), 1u);
  ASSERT_EQ(b.moves.size(), 1u);
  EXPECT_GT(b.moves[0].mean_force_size, 10);
  EXPECT_NEAR(a.moves[0].mean_force_size, b.moves[0].mean_force_size, 1e-3 * b.moves[0].mean_force_size);
  EXPECT_NEAR(a.moves[0].deflection.mean, b.moves[0].deflection.mean, 1e-3 * b.moves[0].deflection.mean);
  EXPECT_NEAR(a.pass.removed, b.pass.removed, 1e-3 * b.pass.removed);
}

// A part that is turned in M bends as its program turned in W does.
TEST(Predict, WorkpieceTurnedInTheMachine) {
  auto turned = load_example("slavkovic_square");
  turned.job.X_MW.R = rotation_z(units::from_deg(75));
  const auto a = testing::predict(turned, at_rest());
  auto straight = load_example("slavkovic_square");
  const Mat3 R = rotation_z(units::from_deg(75));
  for (std::size_t i = 0; i < 4; ++i) {
    const gcode::Move& side = straight.interpretation.moves[i + 3];
    const Vec3 t = R * side.direction(0), n(-t.y(), t.x(), 0);
    const Vec3 force = t * 5.4 + n * 110 + Vec3(0, 0, 8.5);  // FACTS
    double expected = 0;
    for (int k = 0; k <= 50; ++k) {
      const Vec3 p = turned.job.X_MW * side.point(side.length() * k / 50);
      const auto c = statics::compliance_at(turned.job.machine, Pose{Mat3::Identity(), p});
      expected = std::max(expected, c.displacement(force).dot(n));
    }
    EXPECT_NEAR(a.moves[i].normal.max, expected, 0.02 * expected) << "side " << i;
  }
}

struct BadCase {
  const char* what;
  const char* program;
  const char* id;
  int line;
};

TEST(Predict, BadInputIsNamedWithItsLine) {
  const BadCase cases[] = {
      {"spindle off", "G21 G90\nG0 X-125 Y-135 Z-2\nG1 Y125 F1600\nM2\n", "MC200", 3},
      {"spindle 0", "G21 G90 S0 M3\nG0 X-125 Y-135 Z-2\nG1 Y125 F1600\nM2\n", "MC200", 3},
      {"spindle backwards", "G21 G90 S8000 M4\nG0 X-125 Y-135 Z-2\nG1 Y125 F1600\nM2\n", "MC203", 3},
      {"tilted tool", "G21 G90 S8000 M3\nG0 X-125 Y-135 Z-2 A10\nG1 Y125 F1600\nM2\n", "MC204", 3},
  };
  for (const BadCase& c : cases) {
    SCOPED_TRACE(c.what);
    const auto e = with_program("slavkovic_square", c.program);
    const auto p = machining::predict(e.job, e.program, e.interpretation);
    ASSERT_FALSE(p);
    EXPECT_EQ(p.error().id, c.id);
    EXPECT_EQ(p.error().place.line, c.line);
    EXPECT_EQ(p.error().place.file, "test.ngc");
    EXPECT_FALSE(machining::correct(e.job, e.program, e.interpretation));
  }
}

TEST(Predict, CutDeeperThanTheEdges) {
  auto e = load_example("slavkovic_square");
  e.job.cutter.length = 1.5e-3;
  const auto p = machining::predict(e.job, e.program, e.interpretation);
  ASSERT_FALSE(p);
  EXPECT_EQ(p.error().id, "MC202");
  EXPECT_EQ(p.error().place.line, 11);
  EXPECT_THAT(p.error().message, HasSubstr("mm deep, but the flute length of the cutter is 1.500 mm"));
}

// Flutes reach up from the tip, wherever the material that they would cut begins: under a plate that floats above the
// tip, and with the tip below the stock.
TEST(Predict, FlutesReachFromTheTipNotFromTheMaterial) {
  auto e = with_program("slavkovic_groove", "G21 G90 G54 S12000 M3 F1800\nG0 X-45 Y0 Z10\nG1 Z-12\nG1 X45\nM2\n");
  e.job.cutter.length = 8e-3;
  const double cell = e.job.stock.cell();
  e.job.stock = testing::unwrap(cutting::Stock::block({-30e-3, -20e-3, -2e-3}, {30e-3, 20e-3, 0}, cell));
  const auto below = machining::predict(e.job, e.program, e.interpretation);
  ASSERT_FALSE(below);
  EXPECT_EQ(below.error().id, "MC202");
  EXPECT_EQ(below.error().place.line, 4);
  EXPECT_THAT(below.error().message, HasSubstr("12.000 mm above the tip, which is 10.000 mm under the stock"));

  auto thick = testing::unwrap(cutting::Stock::block({-30e-3, -20e-3, -20e-3}, {30e-3, 20e-3, 0}, cell));
  thick.cut_line({-0.1, 0, -18e-3}, {0.1, 0, -18e-3}, 0.05);
  e.job.stock = thick.turned(cutting::Stock::Axis::x).shifted({0, 0, -20e-3});
  const auto hollow = machining::predict(e.job, e.program, e.interpretation);
  ASSERT_FALSE(hollow);
  EXPECT_EQ(hollow.error().id, "MC202");
  EXPECT_THAT(hollow.error().message, HasSubstr("mm deep, but the flute length of the cutter is 8.000 mm"));

  e.job.cutter.length = 12.1e-3;  // the helix pulls the tool down by some 30 um
  EXPECT_TRUE(machining::predict(e.job, e.program, e.interpretation));
}

TEST(Predict, OutOfReachNamesLineAndReason) {
  auto e = load_example("slavkovic_square");
  e.job.X_MW.p = Vec3(0, -2.2, 0);
  const auto p = machining::predict(e.job, e.program, e.interpretation);
  ASSERT_FALSE(p);
  EXPECT_EQ(p.error().id, "MC210");
  EXPECT_EQ(p.error().place.line, 8) << "in air already";
  EXPECT_THAT(p.error().message, HasSubstr("out of reach"));
}

TEST(Predict, RapidThroughTheStockIsCalledOut) {
  const auto e = with_program("slavkovic_square", "G21 G90 S8000 M3\nG0 X-160 Y0 Z-2\nG0 X0\nG1 X5 F800\nM2\n");
  const auto p = testing::predict(e);
  ASSERT_EQ(p.pass.incidents.size(), 1u);
  const Status collision = machining::no_rapid_cuts(e.job, e.program, p.pass);
  ASSERT_FALSE(collision);
  EXPECT_EQ(collision.error().id, "MC304");
  EXPECT_EQ(collision.error().place.line, 3);
  const auto c = machining::correct(e.job, e.program, e.interpretation);
  ASSERT_FALSE(c);
  EXPECT_EQ(c.error().id, "MC304");
}

TEST(Predict, CancelStopsIt) {
  const auto e = load_example("freecad_pocket");
  machining::PredictOptions options;
  options.progress = [](double) { return false; };
  const auto p = machining::predict(e.job, e.program, e.interpretation, options);
  ASSERT_FALSE(p);
  EXPECT_EQ(p.error().id, "MC299");
}

// Where a slot begins and ends the cutter meets one of its walls first: that is no change of side.
TEST(Predict, TheNormalOfASlotDoesNotTurnRoundAtItsEnds) {
  auto e = testing::load_example("slavkovic_groove");
  const auto usual = testing::predict(e);
  for (const double step : {0.3e-3, 0.1e-3, 0.05e-3}) {
    machining::PredictOptions options;
    options.step = step;
    const auto p = testing::predict(e, options);
    EXPECT_GT(units::to_um(p.normal.min), -30) << step;
    EXPECT_NEAR(units::to_um(p.normal.max), units::to_um(usual.normal.max), 3) << step;
  }
}

}  // namespace
}  // namespace polypod
