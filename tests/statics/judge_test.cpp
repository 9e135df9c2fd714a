// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/judge.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <functional>

#include "paths.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/statics/measured_map.hpp"

namespace polypod::statics {
namespace {

using ::testing::HasSubstr;

std::string data(const std::string& name) {
  return test::source("tests/statics/data/" + name);
}
machine::AnyMachine lola() {
  return *machine::load("lola50");
}
machine::AnyMachine arm6() {
  return *machine::load(data("arm6.toml"));
}
std::vector<MeasuredPoint> plane(const char* name) {
  return *read_displacements(data(std::string("displacements_plane_") + name + ".csv"));
}
std::vector<std::string> ids(const std::vector<Error>& problems) {
  std::vector<std::string> out;
  for (const Error& e : problems) out.push_back(e.id);
  return out;
}

TEST(Judge, GoodReadingsAreGood) {
  for (const char* name : {"I", "V"}) {
    const Judgement j = judge(lola(), plane(name));
    EXPECT_TRUE(j.good()) << name << ": " << (j.errors.empty() ? j.doubts : j.errors).front().message;
  }
  EXPECT_TRUE(judge(lola(), {}).good());
}

// Of 40 sets of readings with SLAV's noise none is called doubtful, with and without compliances of the machine's own.
TEST(Judge, NoiseAloneIsNoDoubt) {
  std::vector<double> none(5, 0.0);
  const machine::AnyMachine bare = *with_compliances(lola(), none);
  Random random(11);
  for (int round = 0; round < 40; ++round) {
    auto points = plane("V");
    for (MeasuredPoint& p : points) {
      p.displacement = p.computed(*computed_compliance(lola(), p));
      for (double& d : p.displacement.reshaped()) d += 30e-6 * random.normal();
    }
    for (const machine::AnyMachine& m : {lola(), bare}) {
      const Judgement j = judge(m, points);
      EXPECT_TRUE(j.good()) << round << ": " << (j.errors.empty() ? j.doubts : j.errors).front().message;
    }
  }
}

// The sign of a small displacement changes little of the whole; it is found where turning it back leaves less than a
// quarter of what is left over.
TEST(Judge, ASmallComponentWithTheWrongSign) {
  auto points = plane("V");
  Random random(3);
  for (MeasuredPoint& p : points) {
    p.displacement = p.computed(*computed_compliance(lola(), p));
    for (double& d : p.displacement.reshaped()) d += 1e-6 * random.normal();
    p.displacement(0, 2) *= -1;
  }
  // Five points where it is small: 20 um of 461 um are left over, a twentieth.
  std::erase_if(points, [](const MeasuredPoint& p) { return std::abs(p.displacement(0, 2)) > 50e-6; });
  ASSERT_EQ(points.size(), 5U);
  const Judgement j = judge(lola(), points);
  ASSERT_EQ(ids(j.errors), std::vector<std::string>{"ID141"});
  EXPECT_THAT(j.errors.front().message, HasSubstr("the sign of dx_Fz"));
}

struct Mistake {
  const char* name;
  std::function<void(std::vector<MeasuredPoint>&)> make;
  const char* id;
  const char* says;  ///< in message or hint
  int line;          ///< of plane V, whose first row stands in line 3
  bool doubt = false;
};

// Each mistake in the readings of SLAV's plane V is named for what it is, whether the machine has compliances or not.
TEST(Judge, MistakesAreNamed) {
  const auto columns = [](int a, int b) {
    return [a, b](auto& points) {
      for (MeasuredPoint& p : points) p.displacement.col(a).swap(p.displacement.col(b));
    };
  };
  const Mistake mistakes[] = {
      {"all signs",
       [](auto& ps) {
         for (auto& p : ps) p.displacement *= -1;
       },
       "ID140", "wrong sign", 3},
      {"all in mm",
       [](auto& ps) {
         for (auto& p : ps) p.displacement *= 1e-3;
       },
       "ID142", "in mm", 3},
      {"all in kN",
       [](auto& ps) {
         for (auto& p : ps) p.force *= 1e-3;
       },
       "ID142", "kN", 3},
      {"half in mm",
       [](auto& ps) {
         for (std::size_t i = 0; i < 8; ++i) ps[i].displacement *= 1e-3;
       },
       "ID142", "in mm", 3},
      {"one in mm", [](auto& ps) { ps[4].displacement *= 1e-3; }, "ID142", "in mm", 7},
      {"one in nm", [](auto& ps) { ps[4].displacement *= 1e3; }, "ID142", "nm", 7},
      {"Fy and Fz", columns(1, 2), "ID141", "Fy and Fz are exchanged", 3},
      {"Fx and Fy", columns(0, 1), "ID141", "Fx and Fy are exchanged", 3},
      {"dx and dy",
       [](auto& ps) {
         for (auto& p : ps) p.displacement.row(0).swap(p.displacement.row(1));
       },
       "ID141", "dx and dy are exchanged", 3},
      {"sign of Fz",
       [](auto& ps) {
         for (auto& p : ps) p.displacement.col(2) *= -1;
       },
       "ID141", "the sign of Fz", 3},
      {"sign of dz",
       [](auto& ps) {
         for (auto& p : ps) p.displacement.row(2) *= -1;
       },
       "ID141", "the sign of dz", 3},
      {"sign of dz_Fz",
       [](auto& ps) {
         for (auto& p : ps) p.displacement(2, 2) *= -1;
       },
       "ID141", "the sign of dz_Fz is wrong", 3},
      {"one row's sign", [](auto& ps) { ps[6].displacement *= -1; }, "ID140", "wrong sign", 9},
      {"one row's columns", [](auto& ps) { ps[6].displacement.col(1).swap(ps[6].displacement.col(2)); }, "ID141",
       "Fy and Fz", 9},
      {"one force x 10", [](auto& ps) { ps[3].force *= 10; }, "ID142", "force 10 times too large", 6},
      {"all forces x 10",
       [](auto& ps) {
         for (auto& p : ps) p.force *= 10;
       },
       "ID143", "0.1", 3, true},
      {"one reading", [](auto& ps) { ps[5].displacement(0, 0) += 2000e-6; }, "ID144", "dx_Fx", 8, true},
  };
  for (const Mistake& mistake : mistakes) {
    SCOPED_TRACE(mistake.name);
    auto points = plane("V");
    mistake.make(points);
    const Judgement j = judge(lola(), points);
    const std::vector<Error>& problems = mistake.doubt ? j.doubts : j.errors;
    ASSERT_FALSE(problems.empty()) << ::testing::PrintToString(ids(j.errors))
                                   << ::testing::PrintToString(ids(j.doubts));
    EXPECT_EQ(problems.front().id, mistake.id) << problems.front().message;
    EXPECT_THAT(problems.front().message + "; " + problems.front().hint, HasSubstr(mistake.says));
    EXPECT_EQ(problems.front().place.line, mistake.line);
  }
}

TEST(Judge, ACrossReadingFarOffIsNotPositive) {
  auto points = plane("V");
  points[5].displacement(0, 1) += 2000e-6;
  const Judgement j = judge(lola(), points);
  EXPECT_FALSE(j.good());
}

TEST(Judge, MistakesShowWithoutCompliancesOfTheMachine) {
  const machine::AnyMachine bare = *with_compliances(lola(), std::vector<double>(5, 0.0));
  auto swapped = plane("V"), half = plane("V"), negative = plane("V");
  for (MeasuredPoint& p : swapped) p.displacement.col(1).swap(p.displacement.col(2));
  for (std::size_t i = 0; i < half.size(); i += 2) half[i].displacement *= 1e-3;
  for (MeasuredPoint& p : negative) p.displacement *= -1;
  EXPECT_THAT(ids(judge(bare, swapped).errors), ::testing::ElementsAre("ID141"));
  EXPECT_THAT(ids(judge(bare, half).errors), ::testing::Contains("ID142"));
  EXPECT_THAT(ids(judge(bare, negative).errors), ::testing::ElementsAre("ID140"));
}

TEST(Judge, RowsShiftedByOne) {
  Random random(3);
  auto points = *read_displacements(data("z04q.csv"));
  for (MeasuredPoint& p : points) p.displacement = p.computed(*computed_compliance(arm6(), p));
  for (std::size_t i = points.size(); --i > 0;) points[i].displacement = points[i - 1].displacement;
  const Judgement j = judge(arm6(), points);
  ASSERT_THAT(ids(j.errors), ::testing::Contains("ID141"));
  EXPECT_THAT(j.errors.front().message, HasSubstr("one row too low"));
}

TEST(Judge, FitsOfNonsenseSayNo) {
  for (const auto& [file, says] :
       {std::pair{"s_swapFyFz.csv", "Fy and Fz are exchanged"}, {"s_mm_half.csv", "in mm"}}) {
    const auto points = *read_displacements(data(file));
    const Verdict v = verdict_of(*identify_compliance(arm6(), points), judge(arm6(), points));
    EXPECT_EQ(v.answer, Verdict::Answer::no) << file;
    EXPECT_THAT(v.why, HasSubstr(says));
  }
  const auto good = *read_displacements(
      std::vector<std::string>{data("displacements_plane_I.csv"), data("displacements_plane_V.csv")});
  const auto fit = identify_compliance(lola(), good.points);
  EXPECT_EQ(verdict_of(*fit, judge(lola(), good.points)).answer, Verdict::Answer::yes);
  EXPECT_NEAR(fit->noise, 32e-6, 2e-6) << "half the difference of cross displacements, 22.5 um, times sqrt 2";
  EXPECT_GT(fit->explained, 0.99);
  EXPECT_EQ(verdict_of(*identify_compliance(lola(), good.points, 5e-6), judge(lola(), good.points)).answer,
            Verdict::Answer::in_part)
      << "7 times a stated noise";
}

// Two points do not tell five joints from each other: what is known of some is a bound, and no yes says otherwise.
TEST(Judge, ABoundOfAComplianceThatMattersIsNoYes) {
  auto points = plane("V");
  points.erase(points.begin() + 2, points.end());
  const auto fit = identify_compliance(lola(), points);
  ASSERT_TRUE(fit);
  bool bound = false;
  for (std::size_t k = 0; k < 5; ++k) bound = bound || fit->compliance[k] < 2 * fit->standard_error[k];
  ASSERT_TRUE(bound);
  const Verdict v = verdict_of(*fit, judge(lola(), points));
  EXPECT_NE(v.answer, Verdict::Answer::yes);
  EXPECT_THAT(v.why, HasSubstr("no more than a bound"));
}

// Independent fits of these files: 15.6 um from the joints, and a truth of 90e-7 rad/Nm for joint 6 of z15.
TEST(Identify, JointsOfTheFileDecideTheBranch) {
  auto points = *read_displacements(data("z04q.csv"));
  const auto with = identify_compliance(arm6(), points);
  ASSERT_TRUE(with) << to_string(with.error());
  EXPECT_NEAR(with->residual_rms, 15.6e-6, 0.1e-6);
  auto without = points;
  for (MeasuredPoint& p : without) p.joints_user.clear();
  EXPECT_GT(identify_compliance(arm6(), without)->residual_rms, 20e-6);
  points[2].joints_user[1] += 3;
  const auto off = identify_compliance(arm6(), points);
  ASSERT_FALSE(off);
  EXPECT_EQ(off.error().id, "ID146");
  EXPECT_EQ(off.error().place.line, points[2].place.line);
  EXPECT_THAT(off.error().message, HasSubstr("3.00 deg"));
  points[2].joints_user.pop_back();
  EXPECT_EQ(identify_compliance(arm6(), points).error().id, "ID147");
}

TEST(Identify, WhatIsHeldAtZeroHasAnUpperBound) {
  const auto r = identify_compliance(arm6(), *read_displacements(data("z15.csv")));
  ASSERT_TRUE(r);
  EXPECT_EQ(r->compliance[5], 0);
  ASSERT_TRUE(r->upper_bound[5].has_value());
  EXPECT_GT(*r->upper_bound[5], 90e-7) << "the truth";
  EXPECT_LT(*r->upper_bound[5], 1e-3);
  for (std::size_t k = 0; k < 5; ++k) EXPECT_FALSE(r->upper_bound[k]) << k;
}

// The bound holds the truth in at least 95 % of 300 sets, of those in which the estimate is held at 0: binomial, 3
// sigma.
TEST(Identify, UpperBoundsHoldTheTruth) {
  std::vector<double> c = column_compliances(lola());
  c[3] = 2e-7;
  const machine::AnyMachine truth = *with_compliances(lola(), c);
  Random random(5);
  int held = 0, kept = 0;
  for (int round = 0; round < 300; ++round) {
    auto points = plane("V");
    for (MeasuredPoint& p : points) {
      p.displacement = p.computed(*computed_compliance(truth, p));
      for (double& d : p.displacement.reshaped()) d += 30e-6 * random.normal();
    }
    const auto r = identify_compliance(lola(), points);
    if (!r->upper_bound[3]) continue;
    ++held;
    kept += *r->upper_bound[3] >= c[3] ? 1 : 0;
  }
  ASSERT_GT(held, 50);
  EXPECT_GT(kept, 0.95 * held - 3 * std::sqrt(0.05 * 0.95 * held));
}

TEST(Identify, SymmetryIsJudgedAgainstNoise) {
  // 100 um between all dx_Fy and dy_Fx: named even where the misfit is far larger.
  auto points = plane("V");
  for (MeasuredPoint& p : points) {
    p.displacement(0, 1) += 100e-6;
    p.displacement.diagonal() *= 1.5;
  }
  EXPECT_FALSE(identify_compliance(lola(), points)->symmetric);
  EXPECT_FALSE(identify_compliance(arm6(), *read_displacements(data("s_swapFyFz.csv")))->symmetric);
  EXPECT_TRUE(identify_compliance(lola(), plane("V"))->symmetric);
  EXPECT_FALSE(identify_compliance(lola(), plane("V"), 3e-6)->symmetric) << "of a stated noise of 3 um";
}

/// A milling arm with compliances that its file does not have, at six poses that differ much.
class MillingArm : public ::testing::Test {
 protected:
  machine::AnyMachine bare_ = *machine::load(data("arm_mill.toml"));
  machine::AnyMachine truth_ = *with_compliances(bare_, {7e-7, 6e-7, 9e-7, 40e-7, 50e-7, 70e-7});
  static constexpr double kForce = 300;  // N

  /// What the machine shows without noise at the first `count` poses.
  std::vector<MeasuredPoint> exact(std::size_t count) const {
    const struct {
      double x, y, z, a, b, c;  // mm, deg
    } places[] = {{0, 0, 0, 0, 0, 0},        {-300, 300, 400, -20, 10, 20}, {100, -400, 300, 15, -10, 0},
                  {300, 350, -100, 0, 0, 0}, {-250, -300, 150, 0, 0, 0},    {450, -100, 100, 10, 25, -30}};
    std::vector<MeasuredPoint> out;
    for (std::size_t i = 0; i < count; ++i) {
      const auto& at = places[i];
      MeasuredPoint p;
      p.place = {"readings.csv", int(i) + 2, 1};
      p.X_MT = Pose{rotation_abc(units::from_deg(at.a), units::from_deg(at.b), units::from_deg(at.c)),
                    units::from_mm(1) * Vec3(at.x, at.y, at.z)};
      p.force = kForce;
      p.displacement = p.computed(*computed_compliance(truth_, p));
      out.push_back(p);
    }
    return out;
  }
  static std::vector<MeasuredPoint> with_noise(std::vector<MeasuredPoint> points, std::uint64_t seed, double noise) {
    Random random(seed);
    for (MeasuredPoint& p : points)
      for (double& d : p.displacement.reshaped()) d += (p.sigma > 0 ? p.sigma : noise) * random.normal();
    return points;
  }
  Verdict verdict(const std::vector<MeasuredPoint>& points, double noise = 0) const {
    const auto fit = identify_compliance(bare_, points, noise);
    EXPECT_TRUE(fit) << (fit ? "" : to_string(fit.error()));
    return verdict_of(*fit, judge(bare_, points));
  }
  static void only_force_y(std::vector<MeasuredPoint>& points) {
    for (MeasuredPoint& p : points) {
      p.given.col(0) = false;
      p.given.col(2) = false;
      p.displacement.col(0).setZero();
      p.displacement.col(2).setZero();
      p.own_forces = Vec3(0, p.force, 0);
    }
  }
};

// Loads along one direction and no stated noise: neither is the residual compared with noise nor a pair of cross
// displacements with each other, so there is no yes.
TEST_F(MillingArm, NoYesWhereNothingTellsTheNoise) {
  auto points = with_noise(exact(6), 3, 5e-6);
  only_force_y(points);
  const auto fit = identify_compliance(bare_, points);
  ASSERT_TRUE(fit);
  EXPECT_EQ(fit->pairs, 0u);
  EXPECT_FALSE(fit->noise_known());
  const Verdict none = verdict(points);
  EXPECT_EQ(none.answer, Verdict::Answer::in_part);
  EXPECT_THAT(none.why, HasSubstr("state the noise (--noise-um), or load in a second direction"));
  const Verdict stated = verdict(points, 5e-6);
  EXPECT_EQ(stated.answer, Verdict::Answer::yes) << stated.why;
  EXPECT_THAT(stated.why, HasSubstr("Symmetry is not judged"));
  EXPECT_EQ(verdict(points, 1e-6).answer, Verdict::Answer::in_part) << "5 times a stated noise";
  // One pose has pairs, but none twice.
  const Verdict one = verdict(with_noise(exact(1), 3, 1e-6));
  EXPECT_EQ(one.answer, Verdict::Answer::in_part);
  EXPECT_THAT(one.why, testing::AnyOf(HasSubstr("measure at more poses"), HasSubstr("Measure at more poses")));
}

// Each of the two tests calls one perfect machine in 200 wrong: of 300 sets 3, and 9 are more than three standard
// deviations of the binomial distribution above that.
TEST_F(MillingArm, FewPosesOfAPerfectMachineAreNoMisfit) {
  for (const std::size_t poses : {2u, 3u, 6u}) {
    const auto points = exact(poses);
    int alarms = 0;
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
      const auto fit = identify_compliance(bare_, with_noise(points, seed, 10e-6));
      ASSERT_TRUE(fit);
      alarms += fit->more_than_noise() || !fit->symmetric ? 1 : 0;
    }
    EXPECT_LE(alarms, 8) << poses << " poses";
    alarms = 0;
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
      const auto fit = identify_compliance(bare_, with_noise(points, seed, 10e-6), 10e-6);
      alarms += fit->more_than_noise() || !fit->symmetric ? 1 : 0;
    }
    EXPECT_LE(alarms, 8) << poses << " poses, stated noise";
  }
  // Two poses test little, and the answer says so.
  const Verdict few = verdict(with_noise(exact(2), 1, 10e-6));
  EXPECT_EQ(few.answer, Verdict::Answer::yes) << few.why;
  EXPECT_THAT(few.why, HasSubstr("So few readings show something else that deflects only from 6.7 times the noise on"));
}

// What the test must find: a foundation that gives way along y as much as the joints do.
TEST_F(MillingArm, AFoundationThatDeflectsIsNamed) {
  for (const std::size_t poses : {3u, 6u}) {
    auto points = exact(poses);
    for (std::size_t i = 0; i < poses; ++i) {
      points[i].displacement(1, 1) += 500e-6;
      points[i].displacement(2, 2) += i % 2 == 0 ? 300e-6 : -100e-6;
    }
    const auto fit = identify_compliance(bare_, with_noise(points, 4, 5e-6));
    ASSERT_TRUE(fit);
    EXPECT_TRUE(fit->more_than_noise()) << poses << " poses: " << fit->misfit / fit->noise << " times the noise";
  }
  auto leaning = with_noise(exact(3), 4, 5e-6);
  for (MeasuredPoint& p : leaning) p.displacement(0, 1) += 60e-6;
  EXPECT_FALSE(identify_compliance(bare_, leaning)->symmetric);
}

// A row with a sigma of its own is judged by that, and not by what other rows scatter.
TEST_F(MillingArm, RowsAreJudgedByTheirOwnSigma) {
  auto points = exact(6);
  for (std::size_t i = 0; i < points.size(); ++i) points[i].sigma = i % 3 == 1 ? 40e-6 : 5e-6;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    const Judgement j = judge(bare_, with_noise(points, seed, 0));
    EXPECT_TRUE(j.good()) << seed << ": " << (j.errors.empty() ? j.doubts : j.errors).front().message;
  }
  auto off = with_noise(points, 1, 0);
  off[2].displacement(1, 1) += 400e-6;
  ASSERT_THAT(ids(judge(bare_, off).doubts), ::testing::ElementsAre("ID144"));
  EXPECT_THAT(judge(bare_, off).doubts.front().message, HasSubstr("dy_Fy"));
  EXPECT_THAT(identify_compliance(bare_, with_noise(points, 1, 0))->outliers.size(), ::testing::Le(3u));
}

// The machine has no compliances to compare with: those that no joint has are doubtful, and no yes.
TEST_F(MillingArm, CompliancesThatNoJointHasAreDoubtful) {
  for (const auto& [factor, says] : {std::pair{1e-3, "so stiff"}, {1e3, "so soft"}}) {
    auto points = with_noise(exact(6), 2, 5e-6);
    for (MeasuredPoint& p : points) p.displacement *= factor;
    const Judgement j = judge(bare_, points);
    EXPECT_TRUE(j.errors.empty());
    ASSERT_EQ(ids(j.doubts), std::vector<std::string>{"ID148"}) << factor;
    EXPECT_THAT(j.doubts.front().message, HasSubstr(says));
    EXPECT_EQ(verdict(points).answer, Verdict::Answer::in_part);
  }
  EXPECT_TRUE(judge(bare_, with_noise(exact(6), 2, 5e-6)).good());
}

class DisplacementFiles : public ::testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& text) {
    const std::string path = directory_ / name;
    EXPECT_TRUE(files::write_whole(path, text));
    return path;
  }
  void SetUp() override { std::filesystem::create_directories(directory_); }
  void TearDown() override { std::filesystem::remove_all(directory_); }
  std::filesystem::path directory_ =
      std::filesystem::temp_directory_path() / ("polypod-displacements-" + std::to_string(::getpid()));
};

const std::string kNine = "dx_Fx_um,dy_Fx_um,dz_Fx_um,dx_Fy_um,dy_Fy_um,dz_Fy_um,dx_Fz_um,dy_Fz_um,dz_Fz_um";
const std::string kRow = "489,6,23,28,637,-284,-45,-322,897";

TEST_F(DisplacementFiles, ColumnsThatNothingReads) {
  const auto read = [&](const std::string& more) {
    return read_displacements(std::vector<std::string>{
        write("a.csv", "x_mm,y_mm,z_mm,force_N," + kNine + "," + more + "\n0,-1300,0,250," + kRow + ",1\n")});
  };
  const struct {
    const char* column;
    const char* nearest;
  } misses[] = {{"A_deg", "a_deg"}, {"sigma_un", "sigma_um"}, {"Q1", "q1"}, {"FX_N", "Fx_N"}};
  for (const auto& miss : misses) {
    const auto r = read(miss.column);
    ASSERT_FALSE(r) << miss.column;
    EXPECT_EQ(r.error().id, "ID108");
    EXPECT_THAT(r.error().message, HasSubstr(miss.nearest)) << miss.column;
    EXPECT_EQ(r.error().place.line, 1);
  }
  const auto good = read("operator");
  ASSERT_TRUE(good) << to_string(good.error());
  EXPECT_THAT(good->unused_columns, ::testing::ElementsAre("operator"));
  EXPECT_THAT(read("sigma_um")->unused_columns, ::testing::IsEmpty());
  EXPECT_DOUBLE_EQ(read("sigma_um")->points[0].sigma, 1e-6);
  // Another unit is converted.
  EXPECT_DOUBLE_EQ(read("sigma_mm")->points[0].sigma, 1e-3);
  EXPECT_NEAR(angles_abc(read("a_rad")->points[0].X_MT.R).x(), 1.0, 1e-12);
}

TEST_F(DisplacementFiles, TheSameRowInTwoFiles) {
  const std::string head = "x_mm,y_mm,z_mm,force_N," + kNine + "\n";
  const std::string a = write("a.csv", head + "0,-1300,0,250," + kRow + "\n");
  const std::string b = write("b.csv", head + "1,-1300,0,250," + kRow + "\n0.0,-1300,0,250.0," + kRow + "\n");
  const auto r = read_displacements(std::vector<std::string>{a, b});
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().id, "ID103");
  EXPECT_EQ(r.error().place.file, b);
  EXPECT_EQ(r.error().place.line, 3);
  EXPECT_THAT(r.error().message, HasSubstr("a.csv, line 2"));
}

TEST_F(DisplacementFiles, ForcesOfTheirOwnPartialTestsPushAndPull) {
  // The machine's own displacements under other forces give its compliances all the same.
  Random random(2);
  std::string own = "x_mm,y_mm,z_mm,Fx_N,Fy_N,Fz_N," + kNine + "\n", partial = "x_mm,y_mm,z_mm,force_N," + kNine + "\n";
  std::string without_z = "x_mm,y_mm,z_mm,force_N," + kNine.substr(0, kNine.find(",dx_Fz")) + "\n";
  int i = 0;
  for (const MeasuredPoint& p : plane("I")) {              // in plane V joint 2 moves the tip along z alone
    const Mat3 C = *computed_compliance(lola(), p) * 1e6;  // um/N
    const Vec3 at = 1e3 * p.X_MT.p, F(100, -200, 300);
    const auto row = [&](const Vec3& forces, int blank) {
      std::string out;
      for (int f = 0; f < 3; ++f)
        for (int d = 0; d < 3; ++d)
          out += "," + (3 * f + d == blank ? std::string() : std::to_string(C(d, f) * forces[f]));
      return out;
    };
    const std::string place = std::to_string(at.x()) + "," + std::to_string(at.y()) + "," + std::to_string(at.z());
    own += place + ",100,-200,300" + row(F, -1) + "\n";
    partial += place + "," + (i % 2 == 0 ? "-250" : "250") + row(Vec3::Constant(i % 2 == 0 ? -250 : 250), i % 9) + "\n";
    std::string six = row(Vec3::Constant(250), -1);
    for (int k = 0; k < 3; ++k) six.resize(six.rfind(','));
    without_z += place + ",250" + six + "\n";
    ++i;
  }
  const std::vector<double> truth = column_compliances(lola());
  const struct {
    const std::string* text;
    std::size_t equations;
  } cases[] = {{&own, 135}, {&partial, 120}, {&without_z, 90}};
  for (const auto& c : cases) {
    const auto points = read_displacements(write("c.csv", *c.text));
    ASSERT_TRUE(points) << to_string(points.error());
    EXPECT_TRUE(judge(lola(), *points).good());
    const auto r = identify_compliance(lola(), *points);
    ASSERT_TRUE(r) << to_string(r.error());
    EXPECT_EQ(r->equations, c.equations);
    for (std::size_t k = 0; k < 5; ++k) EXPECT_NEAR(r->compliance[k] / truth[k], 1, 1e-4) << k;
    EXPECT_EQ(MeasuredMap::of(*points).has_value(), c.equations > 90) << "no map without C_zz";
  }
  const auto both = read_displacements(
      write("d.csv", "x_mm,y_mm,z_mm,force_N,Fx_N,Fy_N,Fz_N," + kNine + "\n0,-1300,0,250,1,1,1," + kRow + "\n"));
  EXPECT_EQ(both.error().id, "ID104");
}

}  // namespace
}  // namespace polypod::statics
