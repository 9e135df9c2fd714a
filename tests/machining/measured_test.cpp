// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Jobs whose compliance is interpolated from measured displacements: against the joints' model where readings are made
// from it, and on SLAV's planes.
#include <gmock/gmock.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "machining/examples.hpp"
#include "paths.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using ::testing::HasSubstr;
using testing::load_example;
using units::to_um;

std::string plane(const std::string& name) {
  return test::source("tests/statics/data/displacements_plane_" + name + ".csv");
}

/// Readings under 250 N of the machine itself, 75 mm apart, round the example's work; normal noise in m.
std::vector<statics::MeasuredPoint> readings(const machining::Job& job, double noise, std::uint64_t seed) {
  Random random(seed);
  std::vector<statics::MeasuredPoint> out;
  for (const double z : {-50e-3, 25e-3}) {
    for (int i = -2; i <= 2; ++i) {
      for (int j = -2; j <= 2; ++j) {
        statics::MeasuredPoint p;
        p.X_MT = {Mat3::Identity(), Vec3(75e-3 * i, -1.3 + 75e-3 * j, z)};
        p.force = 250;
        p.displacement = statics::compliance_at(job.machine, p.X_MT).linear() * p.force;
        for (double& d : p.displacement.reshaped()) d += noise * random.normal();
        out.push_back(p);
      }
    }
  }
  return out;
}

std::shared_ptr<const machining::MeasuredCompliance> map_of(const std::vector<statics::MeasuredPoint>& points) {
  return std::make_shared<const machining::MeasuredCompliance>(
      machining::MeasuredCompliance{{}, testing::unwrap(statics::MeasuredMap::of(points))});
}

// 50 readings without noise say what the joints say: 1 % leaves room for the map between its points and for the stock's
// cells. What is corrected by the map stays in the tube of the joints' model.
TEST(Measured, DenseReadingsDoWhatTheJointsDo) {
  const auto joints = load_example("slavkovic_square");
  auto mapped = joints;
  mapped.job.measured = map_of(readings(joints.job, 0, 1));
  const auto a = testing::predict(joints), b = testing::predict(mapped);
  ASSERT_EQ(a.moves.size(), b.moves.size());
  for (std::size_t i = 0; i < a.moves.size(); ++i) {
    EXPECT_NEAR(b.moves[i].normal.mean / a.moves[i].normal.mean, 1, 0.01);
    EXPECT_NEAR(b.moves[i].deflection.max / a.moves[i].deflection.max, 1, 0.01);
    EXPECT_NEAR(b.moves[i].vertical.mean / a.moves[i].vertical.mean, 1, 0.01);
  }
  EXPECT_NE(a.normal.mean, b.normal.mean) << "the map was not asked";
  const auto c = testing::correct(mapped);
  testing::expect_in_tube(mapped, c);
  testing::expect_in_tube(joints, c);
  EXPECT_THAT(c.text(), HasSubstr("interpolated from 50 measured points"));
  EXPECT_THAT(testing::correct(joints).text(), ::testing::Not(HasSubstr("interpolated")));
}

// The work of both examples lies between planes I (z = -400 mm) and V (z = 0).
TEST(Measured, RealPlanesKeepTheTube) {
  for (const char* name : {"slavkovic_square", "slavkovic_turned_square"}) {
    SCOPED_TRACE(name);
    auto e = load_example(name);
    e.job.measured = testing::unwrap(machining::read_measured({plane("I"), plane("V")}));
    EXPECT_EQ(e.job.measured->map.size(), 30u);
    const auto c = testing::correct(e);
    testing::expect_in_tube(e, c);
    const auto band = machining::map_band(e.job, c.before);
    // Readings have a noise of 40 um under 250 N; forces are near 110 N and the map is a mean of many readings.
    EXPECT_GT(to_um(band.normal.mean), 5);
    EXPECT_LT(to_um(band.normal.max), 25);
    // The models differ by what the bands of both leave open.
    EXPECT_GT(to_um(band.joints.mean), 1);
    EXPECT_LT(band.joints.max, 2 * band.normal.max);
  }
}

TEST(Measured, TheMachineNeedsNoCompliances) {
  auto e = load_example("slavkovic_square");
  e.job.measured = map_of(readings(e.job, 0, 1));
  const auto with = testing::predict(e);
  EXPECT_LT(to_um(machining::map_band(e.job, with).joints.max), 1);
  EXPECT_GT(machining::map_band(e.job, with).joints.count, 0u);
  const std::vector<double> none(statics::column_compliances(e.job.machine).size(), 0.0);
  e.job.machine = testing::unwrap(statics::with_compliances(e.job.machine, none));
  ASSERT_FALSE(statics::has_compliance(e.job.machine));
  const auto without = testing::predict(e);
  EXPECT_EQ(without.normal.mean, with.normal.mean);
  EXPECT_EQ(machining::map_band(e.job, without).joints.count, 0u);
  EXPECT_GT(machining::map_band(e.job, without).normal.count, 0u);
}

// Over 60 sets of readings, whose noise is known, the normal deflection's error in units of the band's standard
// deviation has a root mean square near 1, along normals that stand across no axis of M. The bands of a set hang
// together, so 60 sets say no more than about 10 %; the six entries' own noise is estimated from 50 readings each.
TEST(Measured, TheBandComesTrue) {
  constexpr double kNoise = 20e-6;
  auto e = load_example("slavkovic_square");
  e.job.X_MW.R = rotation_z(units::from_deg(30));
  machining::PredictOptions at_rest;
  at_rest.bend = machining::Bend::at_rest;
  const auto p = testing::predict(e, at_rest);
  double square = 0, count = 0, mean = 0;
  constexpr int kSets = 60;
  for (int set = 0; set < kSets; ++set) {
    e.job.measured = map_of(readings(e.job, kNoise, 1 + std::uint64_t(set)));
    for (std::size_t i = 5; i < p.few.size(); i += 12) {
      const machining::Sample& s = p.few[i];
      machining::Prediction one;
      one.few = {s};
      const double half = machining::map_band(e.job, one).normal.mean;
      const Vec3 at = e.job.X_MW * s.command, F = e.job.X_MW.R * s.force, n = e.job.X_MW.R * s.away;
      const Mat3 truth = statics::compliance_at(e.job.machine, {Mat3::Identity(), at}).linear();
      square += std::pow(n.dot((e.job.measured->map.at(at) - truth) * F) / (half / 1.96), 2);
      mean += half;
      ++count;
    }
  }
  EXPECT_NEAR(std::sqrt(square / count), 1, 0.15);
  EXPECT_LT(mean / count, 0.5 * 1.96 * kNoise) << "many readings know more than one";
}

// A workpiece turned by 90 deg: x of W is y of M. Along an axis the band is sqrt(sum_j (sd C_ij F_j)^2).
TEST(Measured, TheBandIsTakenInTheMachine) {
  auto e = load_example("slavkovic_square");
  e.job.measured = testing::unwrap(machining::read_measured({plane("I"), plane("V")}));
  e.job.X_MW.R = rotation_z(units::from_deg(90));
  machining::Sample s;
  s.command = Vec3(0.1, 0.02, -0.01);
  s.force = Vec3(10, 20, 30);
  s.away = Vec3::UnitX();
  machining::Prediction p;
  p.few = {s};
  const machining::MapBand band = machining::map_band(e.job, p);
  ASSERT_EQ(band.normal.count, 1u);
  ASSERT_EQ(band.joints.count, 1u);
  const Vec3 at(-0.02, -1.3 + 0.1, -0.01), F(-20, 10, 30);
  const statics::MeasuredMap& map = e.job.measured->map;
  const Vec3 sd = map.deviation(at).row(1);
  constexpr double kRounding = 1e-9;
  EXPECT_NEAR(band.normal.mean / (1.96 * sd.cwiseProduct(F).norm()), 1, kRounding);
  const Mat3 joints = statics::compliance_at(e.job.machine, {Mat3::Identity(), at}).linear();
  EXPECT_NEAR(band.joints.max / ((map.at(at) - joints) * F).norm(), 1, kRounding);
}

TEST(Measured, NoNoiseNoBand) {
  auto e = load_example("slavkovic_square");
  const auto p = testing::predict(e);
  EXPECT_EQ(machining::map_band(e.job, p).normal.count, 0u) << "without a map there is none";
  e.job.measured = map_of(readings(e.job, 0, 1));
  const double quiet = machining::map_band(e.job, p).normal.max;
  EXPECT_LT(to_um(quiet), 0.5);
  e.job.measured = map_of(readings(e.job, 20e-6, 1));
  EXPECT_GT(machining::map_band(e.job, p).normal.mean, 10 * quiet);
}

// Of any number of points at most 200, from the first on, at equal distances.
TEST(Measured, FewPointsStandForAll) {
  const auto e = load_example("slavkovic_square");
  for (const double step : {0.1e-3, 0.5e-3, 10e-3}) {
    machining::PredictOptions options;
    options.step = step;
    options.keep_samples = true;
    const auto p = testing::predict(e, options);
    std::vector<machining::Sample> cut;
    for (const machining::Sample& s : p.samples)
      if (s.cutting) cut.push_back(s);
    EXPECT_LE(p.few.size(), 200u);
    EXPECT_GE(p.few.size(), std::min<std::size_t>(100, cut.size()));
    const std::size_t stride = (cut.size() + p.few.size() - 1) / p.few.size();
    for (std::size_t i = 0; i < p.few.size(); ++i) {
      ASSERT_LT(i * stride, cut.size());
      EXPECT_EQ(p.few[i].command, cut[i * stride].command);
    }
  }
}

TEST(Measured, OutsideOfTheMapIsNamedWithItsLine) {
  auto e = load_example("slavkovic_square");
  e.job.measured = testing::unwrap(machining::read_measured({plane("I")}));  // z = -400 mm, and half a spacing
  for (const bool corrects : {false, true}) {
    Error error;
    if (corrects) {
      const auto c = machining::correct(e.job, e.program, e.interpretation);
      ASSERT_FALSE(c);
      error = c.error();
    } else {
      const auto p = machining::predict(e.job, e.program, e.interpretation);
      ASSERT_FALSE(p);
      error = p.error();
    }
    EXPECT_EQ(error.id, "MC211");
    EXPECT_EQ(error.place.line, 11);
    EXPECT_THAT(error.message, HasSubstr("z = -2.0 mm lies outside -550.0 .. -250.0 mm"));
    EXPECT_THAT(error.hint, HasSubstr("measure there too, or leave"));
  }
  e.job.X_MW.p.z() = -0.4;
  EXPECT_TRUE(machining::predict(e.job, e.program, e.interpretation));
}

class MeasuredJob : public ::testing::Test {
 protected:
  /// Reads the example's job with `value` for the key, beside copies of plane V upright (good.csv), tilted by 3 deg
  /// (tilted.csv), cut short (short.csv) and with a force of 0 (zero.csv).
  Result<machining::Job> read(const std::string& value) {
    const std::string good = testing::unwrap(files::read(plane("V")));
    std::string tilted, few, zero;
    int rows = 0;
    for (std::size_t at = 0; at < good.size();) {
      const std::size_t end = good.find('\n', at);
      const std::string line = good.substr(at, end - at);
      at = end + 1;
      if (line[0] == '#') continue;
      tilted += line + (rows == 0 ? ",a_deg" : ",3") + "\n";
      if (rows < 4) few += line + "\n";
      zero += (rows == 3 ? "0,0,0,0,1,1,1,1,1,1,1,1,1" : line) + "\n";
      ++rows;
    }
    const std::string job = testing::unwrap(files::read(testing::example_path("slavkovic_square", "job.toml")));
    const std::string key = "tolerance_um = 100\n";
    std::string text = job;
    text.replace(text.find(key), key.size(), key + "measured_compliance = " + value + "\n");
    for (const auto& [name, what] : {std::pair{"good.csv", &good},
                                     {"tilted.csv", &tilted},
                                     {"short.csv", &few},
                                     {"zero.csv", &zero},
                                     {"job.toml", &text}}) {
      EXPECT_TRUE(files::write_whole(scratch_.file(name), *what));
    }
    return machining::read_job(scratch_.file("job.toml"));
  }
  testing::Scratch scratch_;
};

TEST_F(MeasuredJob, FilesLieBesideIt) {
  const auto one = testing::unwrap(read("[\"good.csv\"]"));
  ASSERT_TRUE(one.measured);
  EXPECT_EQ(one.measured->map.size(), 15u);
  EXPECT_EQ(one.measured->files, std::vector<std::string>{scratch_.file("good.csv")});
  const auto two = testing::unwrap(read("[\"good.csv\", \"" + plane("I") + "\"]"));
  EXPECT_EQ(two.measured->map.size(), 30u) << "several files are one map";
  EXPECT_FALSE(testing::unwrap(read("[]")).measured);
  EXPECT_FALSE(testing::unwrap(machining::read_measured({})));
}

TEST_F(MeasuredJob, EveryErrorHasIdAndPlace) {
  struct Bad {
    const char* value;
    const char* id;
    const char* file;
    int line;
    const char* says;
  };
  const Bad cases[] = {
      {"[\"good.csv\", \"nowhere.csv\"]", "FI100", "job.toml", 5, "nowhere.csv: cannot read the file"},
      {"\"good.csv\"", "CF104", "job.toml", 5, "an array of texts"},
      {"[3]", "CF104", "job.toml", 5, "a text"},
      {"[\"tilted.csv\"]", "MC102", "job.toml", 5, "3.0 deg off that of the job"},
      {"[\"good.csv\", \"tilted.csv\"]", "ID131", "good.csv", 3, "differs"},
      {"[\"short.csv\"]", "ID130", "job.toml", 5, "3 points"},
      {"[\"zero.csv\"]", "ID104", "zero.csv", 4, "force"},
  };
  for (const Bad& bad : cases) {
    SCOPED_TRACE(bad.value);
    const auto job = read(bad.value);
    ASSERT_FALSE(job);
    EXPECT_EQ(job.error().id, bad.id) << to_string(job.error());
    EXPECT_THAT(job.error().place.file, ::testing::EndsWith(bad.file));
    EXPECT_EQ(job.error().place.line, bad.line);
    EXPECT_THAT(job.error().message, HasSubstr(bad.says));
  }
  // From the command line there is no such place: the files' own.
  const auto tilted = machining::read_measured({scratch_.file("tilted.csv")});
  ASSERT_FALSE(tilted);
  EXPECT_EQ(tilted.error().place.file, scratch_.file("tilted.csv"));
  EXPECT_EQ(machining::read_measured({"nowhere.csv"}).error().place.file, "nowhere.csv");
}

}  // namespace
}  // namespace polypod
