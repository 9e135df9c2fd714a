// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Records that are made here from known deviations: joints by the inverse at a tip that is off by a known vector, a
// calibrated machine whose tool is longer by a known length, an instrument with a known clock and offset.
#include "polypod/control/watch.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>

#include "machines.hpp"
#include "module_host.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::control {
namespace {

using ::testing::HasSubstr;

// m: Newton's method of the forward kinematics ends below.
constexpr double kExact = 1e-9;

/// A circle of 8 mm at 10 mm/s and 75 mm above the base, line 5 in its first half and line 6 in its second.
Vec3 circle(double t) {
  const double angle = t * 10.0 / 8.0;
  return {0.008 * std::cos(angle), 0.008 * std::sin(angle), 0.075 + 0.002 * std::sin(2.3 * angle)};
}

/// A record of the strut hexapod whose tip is off its command by `off`, every 2 ms for 5 s.
std::vector<RecordRow> record_of(const AnyMachine& m, const std::function<Vec3(double)>& off) {
  std::vector<RecordRow> out;
  for (int k = 0; k <= 2500; ++k) {
    RecordRow row;
    row.time = 0.002 * k;
    row.line = k < 1250 ? 5 : 6;
    row.command = Pose{Mat3::Identity(), circle(row.time)};
    row.joints = kinematics::inverse(m, Pose{Mat3::Identity(), row.command.p + off(row.time)}).solutions.front().joints;
    out.push_back(row);
  }
  return out;
}

TEST(Watch, DrivesAreWhatTheJointsAreOff) {
  const AnyMachine m = test::load("hexapod-strut");
  const auto off = [](double t) { return Vec3(3e-6 * std::sin(t), t > 3 && t < 3.5 ? 40e-6 : 5e-6, -2e-6); };
  WatchOptions options;
  options.warn = 30e-6;
  const auto w = watch(m, record_of(m, off), options);
  ASSERT_TRUE(w) << to_string(w.error());
  ASSERT_EQ(w->points.size(), 2501U);
  EXPECT_EQ(w->judged, 2501U);
  for (const WatchPoint& p : w->points) EXPECT_LT((p.drives - off(p.time)).norm(), kExact);
  ASSERT_EQ(w->warnings.size(), 1U);
  EXPECT_NEAR(w->warnings[0].from, 3.002, 1e-9);
  EXPECT_NEAR(w->warnings[0].to, 3.498, 1e-9);
  EXPECT_EQ(w->warnings[0].line, 6);
  EXPECT_NEAR(w->warnings[0].largest, off(3.1).norm(), 0.1e-6);
  EXPECT_EQ(w->largest_line, 6);
  ASSERT_EQ(w->lines.size(), 2U);
  EXPECT_EQ(w->lines[0].line, 5);
  EXPECT_LT(w->lines[0].largest, 7e-6);
  EXPECT_EQ(w->lines[0].points + w->lines[1].points, 2501U);
  // The joints at the worst place are off by J^-1 d, here the difference of two inverses.
  ASSERT_EQ(w->follow.size(), 6);
  const Pose there{Mat3::Identity(), circle(w->follow_time)};
  const auto meant = kinematics::inverse(m, there).solutions.front().joints;
  const auto is = kinematics::inverse(m, Pose{there.R, there.p + off(w->follow_time)}).solutions.front().joints;
  EXPECT_LT((w->follow - (is - meant)).cwiseAbs().maxCoeff(), kExact);
  EXPECT_FALSE(w->parts[1].given);
  EXPECT_FALSE(w->parts[2].given);
}

// The tool stays upright on the circle, so that a longer tool is off along z by what it is longer, at every row.
TEST(Watch, GeometryIsTheCalibratedMachinesTip) {
  const AnyMachine m = test::load("hexapod-strut");
  const AnyMachine real = test::load("hexapod-strut", {{"tool.length_mm", "10.25"}});
  WatchOptions options;
  options.calibrated = &real;
  const auto w = watch(m, record_of(m, [](double) { return Vec3::Zero(); }), options);
  ASSERT_TRUE(w) << to_string(w.error());
  for (const WatchPoint& p : w->points) {
    EXPECT_LT((p.geometry - Vec3(0, 0, 0.25e-3)).norm(), kExact);
    EXPECT_LT(p.drives.norm(), kExact);
  }
  EXPECT_NEAR(w->parts[1].rms, 0.25e-3, kExact);
  EXPECT_TRUE(w->warnings.empty());  // no limit
}

// What is measured = command + drives + geometry + C F + what nobody knows; each part takes away its own.
TEST(Watch, AMeasurementIsExplainedPartByPart) {
  const AnyMachine m = test::load("hexapod-strut");
  const AnyMachine real = test::load("hexapod-strut", {{"tool.length_mm", "10.1"}});
  const auto off = [](double t) { return Vec3(20e-6 * std::sin(2 * t), 0, 0); };
  const auto bend = [](double t) { return Vec3(0, 50e-6 * (t > 1 ? 1 - std::exp(1 - t) : 0), 0); };
  const Vec3 unknown(7e-6, -4e-6, 2e-6);
  constexpr double kClock = -0.3214;  // record = instrument + this
  WatchOptions options;
  options.calibrated = &real;
  options.bends = [&](const std::vector<WatchPoint>& points) -> Result<std::vector<ExpectedBend>> {
    std::vector<ExpectedBend> out;
    for (const WatchPoint& p : points) out.push_back({p.time, bend(p.time)});
    return out;
  };
  Random random(3);
  constexpr double kNoise = 1e-6;  // m, of each coordinate
  for (int k = 0; k < 1200; ++k) {
    const double t = 0.2 + 0.004 * k;  // of the record; 0.2 .. 4.996
    const Vec3 noise(kNoise * random.normal(), kNoise * random.normal(), kNoise * random.normal());
    options.measured.push_back({t - kClock, circle(t) + off(t) + Vec3(0, 0, 0.1e-3) + bend(t) + unknown + noise});
  }
  const auto w = watch(m, record_of(m, off), options);
  ASSERT_TRUE(w) << to_string(w.error());
  EXPECT_TRUE(w->shift_estimated);
  // Noise of 1 um over 400 points at 10 mm/s: 1e-6 / (0.01 sqrt 400) = 5 us and a little more where z moves.
  EXPECT_NEAR(w->shift_uncertainty, 5e-6, 1e-6);
  EXPECT_NEAR(w->shift, kClock, 4 * w->shift_uncertainty);
  // 0 .. 0.198 and 4.998, 5 s; by the shift's last digits one of the two next to these.
  EXPECT_NEAR(static_cast<double>(w->not_measured), 102.5, 0.6);
  EXPECT_EQ(w->judged, 2501U - w->not_measured);
  const double noise = kNoise * std::sqrt(3.0);
  EXPECT_NEAR(w->parts[0].rms, 20e-6 / std::sqrt(2.0), 1e-6);
  EXPECT_NEAR(w->parts[1].rms, 0.1e-3, kExact);
  EXPECT_LT(*w->parts[0].rms_left, w->measured_rms);
  EXPECT_LT(*w->parts[1].rms_left, 0.5 * *w->parts[0].rms_left);
  EXPECT_LT(*w->parts[2].rms_left, 0.4 * *w->parts[1].rms_left);
  // Interpolated between two noisy points: at most their noise, and at the points all of it.
  EXPECT_NEAR(w->left_rms, std::hypot(unknown.norm(), 0.9 * noise), 0.1 * noise);
  EXPECT_LT((w->left_mean - unknown).norm(), 0.3e-6);
  // A given shift is taken as it is, and a wrong one shows.
  options.shift = kClock + 0.01;
  const auto late = watch(m, record_of(m, off), options);
  ASSERT_TRUE(late);
  EXPECT_FALSE(late->shift_estimated);
  EXPECT_GT(late->left_rms, 60e-6);  // 0.01 s at 10 mm/s
}

TEST(Watch, SaysWhatItCannotKnow) {
  const AnyMachine m = test::load("hexapod-strut");
  const auto none = [](double) { return Vec3::Zero(); };
  std::vector<RecordRow> rows = record_of(m, none);
  WatchOptions options;
  // An instrument that saw the tip stand.
  for (int k = 0; k < 50; ++k) options.measured.push_back({0.01 * k, Vec3(0, 0, 0.075)});
  std::vector<RecordRow> standing = rows;
  for (RecordRow& row : standing) {
    row.command = rows.front().command;
    row.joints = rows.front().joints;
  }
  auto w = watch(m, standing, options);
  ASSERT_FALSE(w);
  EXPECT_EQ(w.error().id, "LC124");
  // One whose clock is far off.
  options.measured.clear();
  for (int k = 0; k < 50; ++k) options.measured.push_back({100 + 0.01 * k, circle(0.01 * k)});
  w = watch(m, rows, options);
  ASSERT_FALSE(w);
  EXPECT_EQ(w.error().id, "LC124");
  options.shift = 0;
  w = watch(m, rows, options);
  ASSERT_FALSE(w);
  EXPECT_EQ(w.error().id, "LC125");
  // Joints that are no pose are named and are not judged.
  options = {};
  options.warn = 1e-3;
  rows[7].joints.setConstant(0.001);
  w = watch(m, rows, options);
  ASSERT_TRUE(w) << to_string(w.error());
  EXPECT_EQ(w->no_pose, 1U);
  EXPECT_NEAR(w->no_pose_time, 0.014, 1e-12);
  EXPECT_EQ(w->judged, rows.size() - 1);
  EXPECT_EQ(w->lines.front().not_judged, 1U);
}

// A joint beyond its range, one that jumps, and a tool that is turned while its tip stays.
TEST(Watch, JointsThatCannotBeAndTurnsOfTheToolAreSeen) {
  const AnyMachine m = test::load("ur10e");
  JointVector q(6);
  q << 0.3, -1.2, 1.5, -0.4, 1.1, 0.2;
  std::vector<RecordRow> rows;
  for (int k = 0; k < 60; ++k) {
    q[0] += 1e-3;
    rows.push_back({0.001 * k, 3, kinematics::forward(m, q).poses.front(), true, q});
  }
  WatchOptions options;
  options.warn = 20e-6;
  auto changed = rows;
  changed[20].joints[5] = 1e300;
  changed[30].joints[5] += 1.5;
  auto w = watch(m, changed, options);
  ASSERT_TRUE(w) << to_string(w.error());
  EXPECT_EQ(w->no_pose, 2U);
  EXPECT_EQ(w->no_pose_why.substr(0, 10), "joint 6 at");
  EXPECT_EQ(w->judged, rows.size() - 2);
  EXPECT_LT(w->turn_largest, 1e-9);
  changed = rows;
  for (RecordRow& row : changed) row.joints[5] += 0.05;
  w = watch(m, changed, options);
  ASSERT_TRUE(w);
  EXPECT_EQ(w->no_pose, 0U);
  EXPECT_NEAR(w->turn_largest, 0.05, 1e-9);
  EXPECT_LT(w->largest, 0.05 * 0.2);
  // Without angles in the record nothing is said of them, and seldom rows of a fast drive are no jump.
  for (RecordRow& row : changed) row.oriented = false;
  EXPECT_EQ(watch(m, changed, options)->turn_largest, 0);
  changed = rows;
  for (std::size_t k = 0; k < changed.size(); ++k) {
    changed[k].time = 0.07 * static_cast<double>(k);
    changed[k].joints[0] = std::sin(static_cast<double>(k));
  }
  EXPECT_EQ(watch(m, changed, options)->no_pose, 0U);
  changed = rows;
  for (RecordRow& row : changed) row.joints[5] += 0.05;
  LiveWatch live(m, nullptr, 1, 1e-3);
  for (const RecordRow& row : changed) live.see(row);
  EXPECT_EQ(live.stretches(), 1U);
  EXPECT_NEAR(live.turn_largest(), 0.05, 1e-9);
}

// The planar machine has two modes for the same joints, and the one that is reached from home need not be that of a
// record; its turn is judged, and so are the tilts of a tripod.
TEST(Watch, TheModeIsThatOfTheRecord) {
  for (const auto& [name, first, turned] : {std::tuple{"planar-3rrr", Vec3(0, 0, 45), Vec3(0, 0, 1)},
                                            std::tuple{"tripod-z3", Vec3(2, 1, 0), Vec3(0, 1, 0)}}) {
    const AnyMachine m = test::load(name);
    Pose X = kinematics::home_pose(m).value_or(Pose{});
    if (std::string(name) == "planar-3rrr") X.p.setZero();
    std::vector<RecordRow> rows;
    for (int k = 0; k < 30; ++k) {
      const Vec3 angles = units::from_deg(1) * (first + 0.1 * k * turned);
      X.R = rotation_abc(angles.x(), angles.y(), angles.z());
      const auto found = kinematics::inverse(m, X);
      ASSERT_NE(found.reachable(), nullptr) << name;
      const JointVector q = found.reachable()->joints;
      rows.push_back({0.01 * k, 1, kinematics::settled(m, X, q), true, q});
    }
    WatchOptions options;
    options.warn = 20e-6;
    auto w = watch(m, rows, options);
    ASSERT_TRUE(w) << to_string(w.error());
    EXPECT_EQ(w->no_pose, 0U) << name;
    EXPECT_LT(w->largest, 1e-7) << name;
    EXPECT_LT(w->turn_largest, 1e-7) << name;
    for (RecordRow& row : rows) {
      const Vec3 more = units::from_deg(2) * turned;
      row.command.R = rotation_abc(more.x(), more.y(), more.z()) * row.command.R;
    }
    w = watch(m, rows, options);
    ASSERT_TRUE(w);
    EXPECT_NEAR(w->turn_largest, units::from_deg(2), 1e-3) << name;
  }
}

TEST(Watch, LiveSaysBeginAndEnd) {
  const AnyMachine m = test::load("hexapod-strut");
  LiveWatch live(m, nullptr, 30e-6, 1e-3);
  std::vector<double> begins, ends;
  for (const RecordRow& row : record_of(m, [](double t) { return Vec3(0, t > 3 && t < 3.5 ? 40e-6 : 5e-6, 0); })) {
    const LiveWatch::Seen seen = live.see(row);
    if (seen.begins) begins.push_back(row.time);
    if (seen.ends) {
      ends.push_back(row.time);
      EXPECT_NEAR(seen.largest, 40e-6, kExact);
    }
  }
  ASSERT_EQ(begins.size(), 1U);
  EXPECT_NEAR(begins[0], 3.002, 1e-9);
  ASSERT_EQ(ends.size(), 1U);
  EXPECT_NEAR(ends[0], 3.599, 1.1e-3);  // a tenth of a second inside: this row or, by rounding, the next
  EXPECT_EQ(live.stretches(), 1U);
  EXPECT_NEAR(live.largest(), 40e-6, kExact);
}

TEST(Watch, ReadsRowsAndRefusesWhatIsNone) {
  const AnyMachine m = test::load("hexapod-strut");
  const std::string header = "time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,q2,q3,q4,q5,q6";
  auto reader = RecordReader::of(m, header + ",load_percent", "r.csv");
  ASSERT_TRUE(reader) << to_string(reader.error());
  EXPECT_EQ(reader->unused(), std::vector<std::string>{"load_percent"});
  const auto row = reader->row("0.001,12,1,2,75,0,0,0,70,71,72,73,74,75,3");
  ASSERT_TRUE(row) << to_string(row.error());
  EXPECT_EQ(row->line, 12);
  EXPECT_NEAR(row->command.p.z(), 0.075, 1e-15);
  EXPECT_NEAR(row->joints[5], 0.075, 1e-15);
  const auto id = [&](const std::string& text) {
    const auto got = reader->row(text);
    return got ? std::string() : got.error().id;
  };
  EXPECT_EQ(id("0.001,12,1,2,75,0,0,0,70,71,72,73,74,75,3"), "LC121");  // the same time
  EXPECT_EQ(id("0.002,12,1,2,75,0,0,0,70,71,72,73,74"), "LC121");
  EXPECT_EQ(id("0.002,12,1,nan,75,0,0,0,70,71,72,73,74,75,3"), "LC121");
  EXPECT_EQ(id("0.002,12,1,x,75,0,0,0,70,71,72,73,74,75,3"), "LC121");
  EXPECT_EQ(id("0.002,1e30,1,2,75,0,0,0,70,71,72,73,74,75,3"), "LC121");
  const auto of = [&](const std::string& text) {
    const auto got = RecordReader::of(m, text, "r.csv");
    return got ? std::string() : got.error().message;
  };
  EXPECT_THAT(of(header + ",q7"), HasSubstr("q7"));
  EXPECT_THAT(of(header + ",q1"), HasSubstr("twice"));
  EXPECT_THAT(of("time_s,x_mm,y_mm,z_mm,q1,q2,q3,q4,q5"), HasSubstr("no column q6"));
  EXPECT_EQ(of("time_s,x_mm,y_mm,z_mm,q1,q2,q3,q4,q5,q6"), "");
  const test::Folder folder;
  const std::string file = (folder.path() / "r.csv").string();
  std::ofstream(file) << header << "\n";
  const auto empty = read_record(m, file);
  ASSERT_FALSE(empty);
  EXPECT_EQ(empty.error().id, "LC120");
}

}  // namespace
}  // namespace polypod::control
