// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Balls in predict.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "machining/examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/rounded.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using ::testing::Contains;
using testing::Example;
using ::testing::HasSubstr;
using testing::with_program;

Example groove(const std::string& program) {
  Example e = with_program("slavkovic_groove", program);
  e.job.cutter.corner_radius = e.job.cutter.radius();
  return e;
}

// A groove: the closed form of a ball in a slot, and the compliance of the machine.
TEST(Ball, AGrooveIsTheClosedForm) {
  const Example e = groove("G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-1.5\nG1 X45 F1800\nG0 Z10\nM2\n");
  machining::PredictOptions options;
  options.bend = machining::Bend::at_rest;
  options.keep_samples = true;
  const machining::Prediction p = testing::predict(e, options);
  const Vec3 force = cutting::mean_force(
      e.job.cutter, e.job.material, cutting::straight_slices(e.job.cutter, cutting::CutSide::slot, 0, 1.5e-3), 0.05e-3);
  int compared = 0;
  for (const machining::Sample& s : p.samples) {
    if (!s.cutting || std::abs(s.command.x()) > 20e-3) continue;
    EXPECT_LT((s.force - force).norm(), 0.02 * force.norm());
    const auto c = statics::compliance_at(e.job.machine, Pose{Mat3::Identity(), e.job.X_MW * s.command});
    EXPECT_LT((s.deflection - c.displacement(s.force)).norm(), 1e-9);
    ++compared;
  }
  EXPECT_GT(compared, 60);
  EXPECT_THAT(p.notes, Contains(HasSubstr("a ball cuts")));
}

// No correction is known to hold for a ball yet.
TEST(Ball, CorrectTakesFlatCutters) {
  const Example e = groove("G21 G90 S12000 M3\nG0 X-45 Y0 Z10\nG0 Z-1.5\nG1 X45 F1800\nG0 Z10\nM2\n");
  const auto c = machining::correct(e.job, e.program, e.interpretation);
  ASSERT_FALSE(c);
  EXPECT_EQ(c.error().id, "CT130");
}

// The thrust lifts a ball out of its plunge as it does a flat cutter; what a dwell does is not judged.
TEST(Ball, EndsOfPlungesAreNotJudged) {
  const Example e = groove("G21 G90 S12000 M3\nG0 X0 Y0 Z10\nG0 Z1\nG1 Z-3 F1200\nG4 P2\nG0 Z10\nM2\n");
  const machining::Prediction p = testing::predict(e);
  ASSERT_EQ(p.plunges.size(), 1u);
  EXPECT_EQ(p.plunges[0].needed, 0);
  EXPECT_EQ(p.plunges[0].remaining, p.plunges[0].held_back);
  EXPECT_THAT(p.plunges[0].why(), HasSubstr("tip of a ball"));
}

// The same groove with the tool tilted and all turned with it.
TEST(Ball, ATiltedBallIsTheSame) {
  const Example flat = groove("G21 G90 S12000 M3\nG0 X-45 Y-3 Z10\nG0 Z-2\nG1 X45 Y4 F1800\nG0 Z10\nM2\n");
  Example tilted = groove("G21 G90 S12000 M3\nG0 X-45 Y-10 Z-3 A90\nG0 Y2\nG1 X45 Z4 F1800\nG0 Y-10\nM2\n");
  const Mat3 Q = rotation_x(units::from_deg(90));
  tilted.job.stock =
      testing::unwrap(cutting::Stock::block({-30e-3, 0, -20e-3}, {30e-3, 20e-3, 20e-3}, tilted.job.stock.cell()));
  auto arm = std::get<machine::SerialArm>(tilted.job.machine);
  const Vec3 o = tilted.job.X_MW.p;
  arm.X_MB = Pose{Q, o - Q * o} * arm.X_MB;
  tilted.job.machine = machine::AnyMachine(arm);
  ASSERT_TRUE(machining::set_up(tilted.job, tilted.program, tilted.interpretation));
  const machining::Prediction a = testing::predict(flat), b = testing::predict(tilted);
  ASSERT_EQ(a.moves.size(), 1u);
  ASSERT_EQ(b.moves.size(), 1u);
  EXPECT_GT(a.moves[0].points, 100u);
  constexpr double kSame = 1e-8;
  EXPECT_NEAR(a.moves[0].normal.mean, b.moves[0].normal.mean, kSame);
  EXPECT_NEAR(a.moves[0].vertical.max, b.moves[0].vertical.max, kSame);
  EXPECT_NEAR(a.largest_distance, b.largest_distance, kSame);
}

TEST(Ball, ABullNoseInAJobIsRefused) {
  testing::Scratch scratch;
  std::string text = *files::read(testing::example_path("slavkovic_groove", "job.toml"));
  const std::string length = "length_mm = 20";
  text.replace(text.find(length), length.size(), length + "\ncorner_radius_mm = 1");
  ASSERT_TRUE(files::write_whole(scratch.file("job.toml"), text));
  const auto job = machining::read_job(scratch.file("job.toml"));
  ASSERT_FALSE(job);
  EXPECT_EQ(job.error().id, "CT130");
}

}  // namespace
}  // namespace polypod
