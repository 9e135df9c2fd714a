// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Readings in which something is mixed up: what it was is named, and nothing is named where nothing was.
#include "mixed_up.hpp"

#include <gmock/gmock.h>

#include <functional>

#include "polypod/calibration/simulate.hpp"

namespace polypod::calibration {
namespace {

using testing::HasSubstr;

std::vector<Measurement> readings(const AnyMachine& nominal, Kind kind = Kind::point) {
  SimulationOptions how;
  how.kind = kind;
  how.count = 40;
  how.seed = 3;
  const auto truth = perturbed(nominal, 0.1e-3, 1e-3, 7);
  EXPECT_TRUE(truth);
  auto rows = simulate(nominal, *truth, how);
  EXPECT_TRUE(rows);
  return *rows;
}

struct Mistake {
  const char* named;
  std::function<void(std::vector<Measurement>&)> make;
};
std::function<void(std::vector<Measurement>&)> each(const std::function<void(Measurement&)>& change) {
  return [change](std::vector<Measurement>& rows) {
    for (Measurement& row : rows) change(row);
  };
}

class MixedUp : public testing::TestWithParam<const char*> {};

TEST_P(MixedUp, IsNamed) {
  const AnyMachine machine = *machine::load(GetParam());
  const std::vector<Mistake> mistakes{
      {"x_mm and y_mm exchanged", each([](Measurement& m) { std::swap(m.X_SR.p.x(), m.X_SR.p.y()); })},
      {"z_mm with the other sign", each([](Measurement& m) { m.X_SR.p.z() *= -1; })},
      {"given in m", each([](Measurement& m) { m.X_SR.p *= 1e-3; })},
      {"given in inches", each([](Measurement& m) { m.X_SR.p /= 25.4; })},
      {"q1 and q2 exchanged", each([](Measurement& m) { std::swap(m.q[0], m.q[1]); })},
      {"joints of the row before",
       [](std::vector<Measurement>& rows) {
         for (std::size_t i = 0; i + 1 < rows.size(); ++i) rows[i].X_SR = rows[i + 1].X_SR;
       }},
  };
  for (const Mistake& mistake : mistakes) {
    std::vector<Measurement> rows = readings(machine);
    mistake.make(rows);
    EXPECT_THAT(mixed_up(machine, rows, {}), HasSubstr(mistake.named)) << mistake.named;
  }
  EXPECT_EQ(mixed_up(machine, readings(machine), {}), "");
}

INSTANTIATE_TEST_SUITE_P(Catalogue, MixedUp, testing::Values("lola50", "hexapod-strut", "delta-brno", "tricept"));

TEST(MixedUp, JointsAreSeenWhereTheFrameIsUnknown) {
  const AnyMachine machine = *machine::load("lola50");
  std::vector<Measurement> rows = readings(machine);
  for (Measurement& row : rows) {
    row.q[2] *= -1;
    row.X_SR.p += Vec3(1, 2, 3);
  }
  CalibrationOptions options;
  EXPECT_EQ(mixed_up(machine, rows, options), "");
  options.estimate_frame = true;
  EXPECT_THAT(mixed_up(machine, rows, options), HasSubstr("q3 with the other sign"));
}

TEST(MixedUp, CalibrationSaysIt) {
  const AnyMachine machine = *machine::load("hexapod-strut");
  std::vector<Measurement> rows = readings(machine);
  for (Measurement& row : rows) std::swap(row.X_SR.p.x(), row.X_SR.p.y());
  const auto c = calibrate(machine, rows);
  ASSERT_FALSE(c);
  EXPECT_THAT(c.error().hint, HasSubstr("x_mm and y_mm exchanged")) << to_string(c.error());
}

TEST(MixedUp, LengthsAloneTellNothing) {
  const AnyMachine machine = *machine::load("hexapod-strut");
  EXPECT_EQ(mixed_up(machine, readings(machine, Kind::distance), {}), "");
}

}  // namespace
}  // namespace polypod::calibration
