// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Settings against LinuxCNC's genuine modules (recorded, see data/README.md) and, for Klipper, against closed geometry.
#include "polypod/control/settings.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <numbers>
#include <sstream>

#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::control {
namespace {

using machine::JointVector;

std::string data(const std::string& file) {
  return test::source("tests/control/data/" + file);
}
AnyMachine machine_of(const std::string& name) {
  return *machine::load(name);
}
AnyMachine recorded_machine(const std::string& name) {
  return machine_of(data(name + ".toml"));
}
Settings settings_of(const AnyMachine& machine, Controller controller = Controller::linuxcnc) {
  const auto found = settings_for(machine, controller);
  EXPECT_TRUE(found) << to_string(found.error());
  return *found;
}

std::map<std::string, double> numbers(const Settings& s) {
  std::map<std::string, double> out;
  for (const Setting& setting : s.settings)
    if (setting.text.empty())
      out[setting.section == "HAL" ? setting.key : setting.section + "." + setting.key] = setting.value;
  return out;
}
double of(const std::map<std::string, double>& map, const std::string& key) {
  const auto at = map.find(key);
  EXPECT_NE(at, map.end()) << key;
  return at == map.end() ? 0 : at->second;
}

struct Recorded {
  std::map<std::string, double> pins;
  std::vector<double> home;
  struct Row {
    std::vector<double> joints;  ///< mm, deg
    Pose X_C;
  };
  std::vector<Row> rows;
};
Recorded recorded(const std::string& name, std::size_t joints) {
  Recorded out;
  std::ifstream file(data(name + ".csv"));
  std::string line, word;
  std::getline(file, line);
  std::istringstream pins(line);
  while (pins >> word)
    if (const auto at = word.find('='); at != std::string::npos)
      out.pins[word.substr(0, at)] = std::stod(word.substr(at + 1));
  std::getline(file, line);
  std::istringstream home(line.substr(std::string("# HOME_OFFSET").size()));
  for (double value = 0; home >> value;) out.home.push_back(value);
  std::getline(file, line);
  while (std::getline(file, line)) {
    std::istringstream cells(line);
    std::vector<double> v;
    for (std::string cell; std::getline(cells, cell, ',');) v.push_back(std::stod(cell));
    v.resize(joints + 6, 0);
    const double* p = v.data() + joints;
    out.rows.push_back({{v.begin(), v.begin() + std::ptrdiff_t(joints)},
                        {rotation_abc(units::from_deg(p[3]), units::from_deg(p[4]), units::from_deg(p[5])),
                         units::from_mm(1) * Vec3(p[0], p[1], p[2])}});
  }
  EXPECT_GE(out.rows.size(), 39U);
  return out;
}

/// The settings are still those with which the module was asked.
void expect_recorded(const Settings& s, const Recorded& r, double tolerance) {
  const auto now = numbers(s);
  std::size_t pins = 0;
  for (const Setting& setting : s.settings) pins += setting.section == "HAL" ? 1 : 0;
  EXPECT_EQ(pins, r.pins.size());
  for (const auto& [pin, value] : r.pins) EXPECT_NEAR(of(now, pin), value, tolerance) << pin;
  for (std::size_t i = 0; i < r.home.size(); ++i) {
    EXPECT_NEAR(of(now, "JOINT_" + std::to_string(i) + ".HOME_OFFSET"), r.home[i], tolerance) << i;
  }
}
/// From the controller's frame to that of the programs.
Pose in_program(const Settings& s, const Pose& X_C) {
  const Mat3 back = rotation_z(-s.work_rotation);
  return {back * X_C.R, back * (X_C.p - s.work_offset)};
}
double largest(const std::vector<double>& values) {
  return *std::max_element(values.begin(), values.end());
}

// Settings that are worked out, not fitted, are the same to rounding (mm, rad).
constexpr double kSame = 1e-9;
// genhexkins' forward stops at changes of 1e-9 mm, genserkins computes to rounding of lengths of 2 m.
constexpr double kModule = 1e-11;  // m, rad

TEST(Control, GenhexkinsIsThePerturbedHexapod) {
  const AnyMachine m = recorded_machine("hexapod");
  const Settings s = settings_of(m);
  EXPECT_EQ(s.module, "genhexkins");
  EXPECT_TRUE(s.exact);
  const Recorded r = recorded("hexapod", 6);
  expect_recorded(s, r, kSame);
  for (const Recorded::Row& row : r.rows) {
    JointVector q(6);
    for (int i = 0; i < 6; ++i) q[i] = units::from_mm(row.joints[std::size_t(i)] - r.home[std::size_t(i)]);
    const Pose X = kinematics::forward(m, q).poses.front(), asked = in_program(s, row.X_C);
    EXPECT_LT((X.p - asked.p).norm(), kModule);
    EXPECT_LT((X.R - asked.R).norm(), 10 * kModule);
  }
}

// Joint `i` of genserkins counts against our reading where sense[i] is -1.
void expect_arm(const std::string& name, const std::vector<double>& sense, bool whole_pose) {
  const AnyMachine m = recorded_machine(name);
  const Settings s = settings_of(m);
  EXPECT_EQ(s.module, "genserkins");
  EXPECT_TRUE(s.exact);
  const Recorded r = recorded(name, 6);
  expect_recorded(s, r, kSame);
  const auto now = numbers(s);
  for (const Recorded::Row& row : r.rows) {
    JointVector q(Eigen::Index(sense.size()));
    for (std::size_t i = 0; i < sense.size(); ++i) {
      // The inverse may give a joint a full turn away.
      q[Eigen::Index(i)] = sense[i] * std::remainder(units::from_deg(row.joints[i] - r.home[i]), 2 * std::numbers::pi);
    }
    const Pose X = kinematics::forward(m, q).poses.front(), asked = in_program(s, row.X_C);
    EXPECT_LT((X.p - asked.p).norm(), kModule);
    EXPECT_LT((X.R.col(2) - asked.R.col(2)).norm(), 10 * kModule);
    if (whole_pose) {
      EXPECT_LT((X.R - asked.R).norm(), 10 * kModule);
    }
    for (std::size_t i = 0; i < sense.size(); ++i) {
      const machine::JointRange range = kinematics::joint_range(m, int(i));
      const std::string joint = "JOINT_" + std::to_string(i);
      const double low = units::to_deg(sense[i] > 0 ? range.min : -range.max);
      EXPECT_NEAR(of(now, joint + ".MIN_LIMIT"), r.home[i] + low, 1e-9);
      EXPECT_NEAR(of(now, joint + ".MAX_LIMIT") - of(now, joint + ".MIN_LIMIT"), units::to_deg(range.max - range.min),
                  1e-9);
    }
  }
}

TEST(Control, GenserkinsIsThePerturbedLola) {
  expect_arm("lola50", {1, 1, 1, -1, 1}, false);
}

TEST(Control, GenserkinsIsAnArmOfSixOnATiltedBase) {
  expect_arm("six_joints", {1, 1, -1, 1, 1, -1}, true);
}

/// How far the real tool lies from what LinuxCNC was asked for, m, in each recorded row. `chain`: of joint 0, 1, 2.
std::vector<double> recorded_misses(const AnyMachine& m, const Settings& s, const Recorded& r,
                                    const std::array<int, 3>& chain, double sense, bool turns) {
  std::vector<double> out;
  for (const Recorded::Row& row : r.rows) {
    JointVector q(3);
    for (std::size_t i = 0; i < 3; ++i) {
      const double reading = sense * (row.joints[i] - r.home[i]);
      q[chain[i]] = turns ? units::from_deg(reading) : units::from_mm(reading);
    }
    const Vec3 real = kinematics::forward(m, q).poses.front().p, asked = in_program(s, row.X_C).p;
    out.push_back((Vec3(real.x(), -real.y(), -real.z()) - asked).norm());
  }
  return out;
}
double rms(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / double(values.size()));
}

// Fits agree between compilers and releases of Ceres as far as the least sum is flat, mm or deg.
constexpr double kFitted = 1e-4;
// 40 recorded poses are not the 400 judged ones: their rms differs by as much.
constexpr double kOtherPoses = 1.6;

TEST(Control, RotarydeltakinsMissesAsMuchAsSaid) {
  const AnyMachine m = recorded_machine("rotary_delta");
  const Settings s = settings_of(m);
  EXPECT_EQ(s.module, "rotarydeltakins");
  EXPECT_LT(s.after.rms, s.before.rms);
  const Recorded r = recorded("rotary_delta", 3);
  expect_recorded(s, r, kFitted);
  const std::vector<double> misses = recorded_misses(m, s, r, {0, 2, 1}, 1, true);
  EXPECT_LT(largest(misses), kOtherPoses * s.after.max);
  EXPECT_LT(rms(misses), kOtherPoses * s.after.rms);
  EXPECT_GT(rms(misses), s.after.rms / kOtherPoses / 2);
}

TEST(Control, LineardeltakinsMissesAsMuchAsSaid) {
  const AnyMachine m = recorded_machine("linear_delta");
  const Settings s = settings_of(m);
  EXPECT_EQ(s.module, "lineardeltakins");
  EXPECT_LT(s.after.rms, 0.6 * s.before.rms);
  const Recorded r = recorded("linear_delta", 3);
  expect_recorded(s, r, kFitted);
  const std::vector<double> misses = recorded_misses(m, s, r, {2, 1, 0}, -1, false);
  EXPECT_LT(largest(misses), kOtherPoses * s.after.max);
  EXPECT_LT(rms(misses), kOtherPoses * s.after.rms);
  EXPECT_GT(rms(misses), s.after.rms / kOtherPoses);
}

// The drawings are what the modules are made for.
TEST(Control, SymmetricDeltasFit) {
  for (const char* name : {"delta-brno", "delta-picker", "delta-linear"}) {
    for (const Controller controller : {Controller::linuxcnc, Controller::klipper}) {
      const Settings s = settings_of(machine_of(name), controller);
      EXPECT_TRUE(s.exact) << name;
      EXPECT_LT(s.before.max, 1e-12) << name;
    }
  }
}
// A tool beside the axis is a work offset.
TEST(Control, ToolBesideTheAxisIsAWorkOffset) {
  const auto m = machine::load("delta-picker", {{"tool.x_mm", "12"}, {"tool.y_mm", "-7"}});
  ASSERT_TRUE(m) << to_string(m.error());
  const Settings s = settings_of(*m, Controller::klipper);
  EXPECT_TRUE(s.exact);
  EXPECT_LT(s.before.max, 1e-12);
  EXPECT_NEAR(s.work_offset.x(), -12e-3, 1e-9);
  EXPECT_NEAR(s.work_offset.y(), -7e-3, 1e-9);
}

/// Klipper's settings of a machine that they can stand for, and that is no symmetric one.
Settings exactly_for_klipper(const AnyMachine& m) {
  Settings s = settings_of(m, Controller::klipper);
  EXPECT_TRUE(s.exact) << s.after.max;
  EXPECT_GT(s.before.rms, 1e-4);  // m
  return s;
}

// Klipper's parameters as its configuration reference defines them; no program of it is asked.
struct KlipperChain {
  double angle = 0, endstop = 0, rod = 0, arm = 0;  // deg, mm
};
TEST(Control, KlipperDeltaGivesBackItsOwnParameters) {
  // Upright towers on a circle of 160 mm about the effector's joints at uneven angles, uneven rods and endstops.
  constexpr double kRadius = 160;
  const std::array<KlipperChain, 3> wanted = {{{211, 520, 341, 0}, {329.5, 519.2, 340, 0}, {90.4, 521, 338.8, 0}}};
  constexpr double kTable = 900, kPlatform = 40;
  std::string arms;
  for (const KlipperChain& c : wanted) {
    const double a = units::from_deg(c.angle);
    // In the machine file y and z are turned about x. Carriages begin at the endstop.
    const double height = c.endstop + std::sqrt(c.rod * c.rod - kRadius * kRadius);
    const Vec3 out(std::cos(a), -std::sin(a), 0), start = (kRadius + kPlatform) * out, foot = kPlatform * out;
    std::ostringstream text;
    text.precision(17);
    text << "{ direction_deg = " << -c.angle << ", rod_mm = " << c.rod << ", platform_mm = [" << foot.x() << ", "
         << foot.y() << ", 0], start_mm = [" << start.x() << ", " << start.y() << ", " << kTable - height
         << "], along = [0, 0, 1] },\n";
    arms += text.str();
  }
  const auto m = machine::from_text("name = \"k\"\nfamily = \"linear-delta\"\narms = [\n" + arms +
                                        "]\nrail = { length_mm = 450 }\n" +
                                        "table = { z_mm = 900 }\njoint = { platform_deg = 80 }\n",
                                    "k.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  const Settings s = exactly_for_klipper(*m);
  const auto got = numbers(s);
  EXPECT_NEAR(of(got, "printer.delta_radius"), kRadius, 1e-6);
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string stepper = std::string("stepper_") + "abc"[i] + ".";
    EXPECT_NEAR(of(got, stepper + "angle"), wanted[i].angle, 1e-6);
    EXPECT_NEAR(of(got, stepper + "arm_length"), wanted[i].rod, 1e-6);
    EXPECT_NEAR(of(got, stepper + "position_endstop"), wanted[i].endstop, 1e-6);
  }
  EXPECT_LT(s.work_offset.norm(), 1e-9);
}

// Three upright towers anywhere stand on one circle, whose middle is the work offset.
TEST(Control, UprightTowersAnywhereFitKlipper) {
  const auto m = machine::from_text(R"(name = "k"
family = "linear-delta"
arms = [
{ direction_deg = 31, rod_mm = 341, platform_mm = [33, 22, 1], start_mm = [170, 101, 3], along = [0, 0, 1] },
{ direction_deg = 149, rod_mm = 339, platform_mm = [-36, 21, -2], start_mm = [-174, 97, 0], along = [0, 0, 1] },
{ direction_deg = 270, rod_mm = 340, platform_mm = [1, -41, 0], start_mm = [2, -203, -4], along = [0, 0, 1] },
]
rail = { length_mm = 500 }
joint = { platform_deg = 80 }
)",
                                    "k.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  exactly_for_klipper(*m);
  EXPECT_FALSE(settings_of(*m).exact);
}

TEST(Control, KlipperRotaryDeltaGivesBackItsOwnParameters) {
  constexpr double kShoulder = 160, kHeight = 640, kPlatform = 80, kTable = 700, kEndstop = 42;  // mm, deg
  struct Chain {
    double angle, upper, lower, zero;
  };
  const std::array<Chain, 3> wanted = {{{30.5, 180, 554, 0.4}, {149, 181, 553, -0.3}, {270.3, 179.2, 555, 0.1}}};
  std::string arms;
  for (const Chain& c : wanted) {
    const double a = units::from_deg(c.angle);
    const Vec3 out(std::cos(a), -std::sin(a), 0), base = (kShoulder + kPlatform) * out, foot = kPlatform * out;
    std::ostringstream text;
    text.precision(17);
    text << "{ direction_deg = " << -c.angle << ", rod_mm = " << c.lower << ", platform_mm = [" << foot.x() << ", "
         << foot.y() << ", 0], base_mm = [" << base.x() << ", " << base.y() << ", " << kTable - kHeight
         << "], arm_mm = " << c.upper << ", zero_deg = " << c.zero << " },\n";
    arms += text.str();
  }
  const auto m =
      machine::from_text("name = \"k\"\nfamily = \"rotary-delta\"\narms = [\n" + arms +
                             "]\ndrive = { angle_min_deg = 42, angle_max_deg = 200 }\n" + "table = { z_mm = 700 }\n",
                         "k.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  const Settings s = exactly_for_klipper(*m);
  const auto got = numbers(s);
  EXPECT_NEAR(of(got, "printer.shoulder_radius"), kShoulder, 1e-5);
  EXPECT_NEAR(of(got, "printer.shoulder_height"), kHeight, 1e-5);
  for (std::size_t i = 0; i < 3; ++i) {
    const Chain& c = wanted[i];
    const std::string stepper = std::string("stepper_") + "abc"[i] + ".";
    EXPECT_NEAR(of(got, stepper + "angle"), c.angle, 1e-5);
    EXPECT_NEAR(of(got, stepper + "upper_arm_length"), c.upper, 1e-5);
    EXPECT_NEAR(of(got, stepper + "lower_arm_length"), c.lower, 1e-5);
    // The elbow of the arm at its endstop, and the tool on the axis at the rod's length below it.
    const double theta = units::from_deg(kEndstop + c.zero);
    const double r = kShoulder + c.upper * std::sin(theta), z = kHeight + c.upper * std::cos(theta);
    EXPECT_NEAR(of(got, stepper + "position_endstop"), z - std::sqrt(c.lower * c.lower - r * r), 1e-5);
  }
}

TEST(Control, FitsOfDeltasThatAreOffAreBetterThanMeans) {
  for (const char* name : {"rotary_delta", "linear_delta"}) {
    const Settings s = settings_of(recorded_machine(name), Controller::klipper);
    EXPECT_FALSE(s.exact);
    EXPECT_LT(s.after.rms, 0.5 * s.before.rms) << name;
    EXPECT_LT(s.after.max, 0.5 * s.before.max) << name;
  }
}

// Poses near singular ones count less: the middle gets better, the border worse.
TEST(Control, FitsMayBeWeighedByTheCondition) {
  const AnyMachine m = recorded_machine("rotary_delta");
  SettingsOptions weighed;
  weighed.weight_by_condition = true;
  const auto even = settings_for(m, Controller::klipper), light = settings_for(m, Controller::klipper, weighed);
  ASSERT_TRUE(even && light);
  EXPECT_LT(light->after.median, 0.6 * even->after.median);
  EXPECT_GT(light->after.rms, even->after.rms);
  EXPECT_GE(even->after.rms, even->after.median);
  EXPECT_GE(even->after.max, even->after.rms);
}

// A tool beside axis 6, by a little or by much: what is left is that and nothing else, and a note says so.
TEST(Control, ToolBesideAxisSixIsSaid) {
  for (const double times : {1.0, 20.0, 160.0}) {
    const auto m = machine::load(data("six_joints.toml"), {{"tool.x_mm", std::to_string(0.3 * times)},
                                                           {"tool.y_mm", std::to_string(-0.4 * times)}});
    ASSERT_TRUE(m) << to_string(m.error());
    const Settings s = settings_of(*m);
    EXPECT_FALSE(s.exact);
    EXPECT_NEAR(s.after.rms, 0.5e-3 * times, 1e-9);
    EXPECT_NEAR(s.after.max, 0.5e-3 * times, 1e-9);
    ASSERT_FALSE(s.notes.empty());
    EXPECT_NE(s.notes.back().find("beside axis 6"), std::string::npos) << s.notes.back();
  }
}

std::string refused(const AnyMachine& m, Controller controller) {
  const auto found = settings_for(m, controller);
  return found ? "" : found.error().id;
}

TEST(Control, WhatNoModuleStandsForIsRefused) {
  EXPECT_EQ(refused(machine_of("hexapod-slider"), Controller::linuxcnc), "CN101");
  EXPECT_EQ(refused(machine_of("hexapod-strut"), Controller::klipper), "CN101");
  EXPECT_EQ(refused(machine_of("lola50"), Controller::klipper), "CN101");
  EXPECT_EQ(refused(*machine::load("delta-brno", {{"arm.count", "4"}}), Controller::linuxcnc), "CN101");
  EXPECT_EQ(refused(*machine::load(data("six_joints.toml"), {{"tool.b_deg", "20"}}), Controller::linuxcnc), "CN102");
  const auto lying = settings_for(*machine::load("delta-linear", {{"rail.incline_deg", "40"}}), Controller::klipper);
  ASSERT_FALSE(lying);
  EXPECT_EQ(lying.error().id, "CN103");
  EXPECT_NE(lying.error().message.find("inclined"), std::string::npos) << lying.error().message;
  const auto four = machine::from_text(
      "name = \"a\"\nfamily = \"serial\"\ntask = \"point\"\nconvention = \"standard\"\n"
      "dh = [ { a_mm = 0, alpha_deg = 90, d_mm = 100, theta_offset_deg = 0 },\n"
      "{ a_mm = 200, alpha_deg = 0, d_mm = 0, theta_offset_deg = 0 },\n"
      "{ a_mm = 200, alpha_deg = 0, d_mm = 0, theta_offset_deg = 0 } ]\n"
      "limits = [ { min_deg = -90, max_deg = 90 }, { min_deg = -90, max_deg = 90 }, { min_deg = -90, max_deg = 90 } "
      "]\n",
      "a.toml");
  ASSERT_TRUE(four) << to_string(four.error());
  EXPECT_EQ(refused(*four, Controller::linuxcnc), "CN102");
}

TEST(Control, TextIsWhatTheProgramsRead) {
  const std::string hal = text_of(settings_of(recorded_machine("hexapod")));
  EXPECT_NE(hal.find("\nsetp genhexkins.base.0.x 48.2674732629\n"), std::string::npos) << hal;
  EXPECT_NE(hal.find("\n[JOINT_5]\nTYPE = LINEAR\nHOME_OFFSET = -0.515887202246\n"), std::string::npos) << hal;
  std::istringstream lines(hal);
  for (std::string line; std::getline(lines, line);) {
    EXPECT_TRUE(line.empty() || line[0] == '#' || line[0] == '[' || line.rfind("setp ", 0) == 0 ||
                line.find(" = ") != std::string::npos)
        << line;
    EXPECT_LE(line.size(), 100U) << line;
  }
  const std::string cfg = text_of(settings_of(machine_of("delta-linear"), Controller::klipper));
  EXPECT_NE(cfg.find("\n[printer]\nkinematics: delta\ndelta_radius: 160.000000\n\n[stepper_a]\n"), std::string::npos)
      << cfg;
}

}  // namespace
}  // namespace polypod::control
