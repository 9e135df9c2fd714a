// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/duty.hpp"

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <numbers>

#include "polypod/core/random.hpp"
#include "polypod/design/compared.hpp"
#include "studies.hpp"

namespace polypod::design {
namespace {

constexpr double kRad = std::numbers::pi / 180;
constexpr double kCompliance = 0.02;  // um/N of a strut

/// kStrut with struts that deflect.
std::string compliant() {
  std::string out = kStrut;
  out.replace(out.find("diameter_mm = 3"), 15, "diameter_mm = 3, compliance_um_per_N = 0.02");
  return out;
}

std::string goal(const std::string& figure, const std::string& sense) {
  return "[[goal]]\nfigure = \"" + figure + "\"\nsense = \"" + sense + "\"\n";
}
const std::string kRadius = "[[vary]]\nkey = \"base.radius_mm\"\nmin = 10\nmax = 68\n";

Result<Study> study(const std::string& text, const std::string& machine) {
  return study_from_text("machine = \"strut\"\n" + text, "test.toml", machine);
}

Evaluation evaluated(const Study& s, double radius) {
  const auto e = evaluate(s, {radius}, {}, {});
  EXPECT_TRUE(e) << to_string(e.error());
  return e.value_or(Evaluation{});
}

/// Height of the platform at home, struts of 70 mm between points 30 deg apart on the radii r1 and 25.
double home_height(double r1) {
  return std::sqrt(70 * 70 - (r1 * r1 + 25 * 25 - 2 * r1 * 25 * std::cos(30 * kRad)));
}

std::string at_home(double r1) {
  return fmt::format("poses = [[0, 0, {:.17g}, 0, 0, 0]]\n", home_height(r1));
}

/// A machine is judged again over a finer survey: what the points of its own one flatter shows there.
TEST(Duty, AFinerSurveyJudgesAgain) {
  auto s =
      study("resolution = 8\n" + kRadius + goal("condition", "min") + "[[hold]]\nfigure = \"condition\"\nmax = 1e6\n",
            kStrut);
  ASSERT_TRUE(s) << to_string(s.error());
  const Evaluation coarse = evaluated(*s, 50);
  const Folder folder;
  auto store = Store::open(folder / "a", *s, "", "1.0");
  ASSERT_TRUE(store) << to_string(store.error());
  Outcome found;
  for (const double r1 : {50.0, 44.0}) {
    Row row;
    row.row = static_cast<std::int64_t>(found.rows.size()) + 7;
    row.varied = {r1};
    row.evaluation = evaluated(*s, r1);
    found.rows.push_back(std::move(row));
  }
  found.front = {0, 1};
  const auto judged = judge_finer(*s, *store, found, *thread_crew(*s, 2, {}));
  ASSERT_TRUE(judged && judged->again);
  const JudgedAgain& again = *judged->again;
  EXPECT_EQ(again.resolution, 16);
  ASSERT_EQ(again.rows.size(), 2U);
  EXPECT_EQ(again.rows[1].row, 8);
  EXPECT_TRUE(again.holds_kept());
  const double finer = again.rows[0].evaluation.figures[0].value;
  EXPECT_NE(finer, coarse.figures[0].value);
  // The store keeps it until another search begins.
  const auto kept_now = kept_again(*store);
  ASSERT_TRUE(kept_now && *kept_now);
  EXPECT_EQ((*kept_now)->resolution, 16);
  EXPECT_EQ((*kept_now)->rows[1].evaluation.figures[0].value, again.rows[1].evaluation.figures[0].value);
  ASSERT_TRUE(store->set_judged_again(0, {}));
  EXPECT_FALSE(*kept_again(*store));
  s->resolution = 16;
  EXPECT_EQ(evaluated(*s, 50).figures[0].value, finer);
  EXPECT_EQ(evaluated(*s, 44).figures[0].value, again.rows[1].evaluation.figures[0].value);
  // A hold between the two: kept by the one, broken by the other.
  s->resolution = 8;
  s->holds[0].max = 0.5 * (coarse.figures[0].value + finer);
  const bool kept = evaluated(*s, 50).state == State::done;
  found.best = 0;
  const auto best = judge_finer(*s, *store, found, *thread_crew(*s, 2, {}));
  ASSERT_TRUE(best && best->again);
  EXPECT_EQ(best->again->rows.size(), 1U);
  EXPECT_NE(best->again->holds_kept(), kept);
  EXPECT_FALSE(judge_finer(*s, *store, {}, *thread_crew(*s, 2, {}))->again);
  // Nothing of a survey: nothing to judge again.
  const auto still = study(at_home(44) + kRadius + goal("longest_leg_mm", "min"), kStrut);
  ASSERT_TRUE(still);
  EXPECT_FALSE(judge_finer(*still, *store, found, *thread_crew(*still, 2, {}))->again);
}

/// Six equal struts under a force along the axis of symmetry: each carries F / (6 cos g), cos g = h / 70, and the tip
/// moves by c F / (6 cos^2 g).
TEST(Duty, StiffnessForceDeflectionAndLegOfASymmetricHexapodInClosedForm) {
  const double r1 = 44, cosine = home_height(r1) / 70;
  const auto s = study(at_home(r1) + "load_N = [0, 0, -120]\ndirection = [0, 0, 2]\n" + kRadius +
                           goal("stiffness_N_per_um", "max") + goal("drive_force_N", "min") +
                           goal("deflection_um", "min") + goal("longest_leg_mm", "min"),
                       compliant());
  ASSERT_TRUE(s) << to_string(s.error());
  const Evaluation e = evaluated(*s, r1);
  ASSERT_EQ(e.state, State::done) << e.reason;
  constexpr double kRelative = 1e-9;
  const double stiffness = 6 * cosine * cosine / kCompliance, force = 120 / (6 * cosine);
  EXPECT_NEAR(e.figures[0].value, stiffness, kRelative * stiffness);
  EXPECT_NEAR(e.figures[1].value, force, kRelative * force);
  EXPECT_NEAR(e.figures[2].value, 120 / stiffness, kRelative * 120 / stiffness);
  EXPECT_NEAR(e.figures[3].value, 70, 70 * kRelative);
}

/// A force aside and a moment at a turned pose: the struts' forces along their axes balance both, solved here from the
/// places of their joints alone.
TEST(Duty, ForcesOfTheStrutsBalanceForceAndMoment) {
  const double r1 = 50;
  const Pose X{rotation_abc(8 * kRad, -5 * kRad, 12 * kRad), Vec3(4e-3, -3e-3, 62e-3)};
  const auto s = study("poses = [[4, -3, 62, 8, -5, 12]]\nload_N = [40, 15, -100]\nload_moment_Nm = [1.5, -2, 0.8]\n" +
                           kRadius + goal("drive_force_N", "min"),
                       compliant());
  ASSERT_TRUE(s) << to_string(s.error());
  const Evaluation e = evaluated(*s, r1);
  ASSERT_EQ(e.state, State::done) << e.reason;
  const auto read = machine::from_text(compliant(), "strut.toml");
  ASSERT_TRUE(read) << to_string(read.error());
  const auto& m = std::get<machine::StrutHexapod>(*read);
  Eigen::Matrix<double, 6, 6> wrenches;
  for (int i = 0; i < 6; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Vec3 from_tip = X.R * m.platform_joint[k];  // tool length 0: the tip is the platform's origin
    const Vec3 along = (X.p + from_tip - m.base_joint[k]).normalized();
    wrenches.col(i) << along, from_tip.cross(along);
  }
  Vec6 load;
  load << 40, 15, -100, 1.5, -2, 0.8;
  const double force = wrenches.fullPivLu().solve(load).cwiseAbs().maxCoeff();
  EXPECT_NEAR(e.figures[0].value, force, 1e-9 * force);
}

/// A mass at the tip alone swings on the softest direction: w^2 = k / m; and its weight loads the struts.
TEST(Duty, LowestFrequencyIsThatOfTheMassOnTheSoftestDirection) {
  const double r1 = 44;
  const std::string mass = "[dynamics]\nplatform = { mass_kg = 3 }\n";
  const auto s = study(at_home(r1) + kRadius + goal("natural_frequency_hz", "max") + goal("stiffness_N_per_um", "max") +
                           goal("drive_force_N", "min") + mass,
                       compliant());
  ASSERT_TRUE(s) << to_string(s.error());
  const Evaluation e = evaluated(*s, r1);
  ASSERT_EQ(e.state, State::done) << e.reason;
  const double w = std::sqrt(e.figures[1].value * 1e6 / 3);
  EXPECT_NEAR(e.figures[0].value, w / (2 * std::numbers::pi), 1e-6 * w);
  const double force = 3 * 9.80665 / (6 * home_height(r1) / 70);
  EXPECT_NEAR(e.figures[2].value, force, 1e-6 * force);
}

/// The figures are the worst of the poses, and without poses those of the points of the workspace.
TEST(Duty, TheWorstPoseCounts) {
  const double r1 = 44, h = home_height(r1);
  const std::string rest = kRadius + goal("stiffness_N_per_um", "max") + goal("drive_force_N", "min");
  const std::string load = "load_N = [40, 0, -100]\nresolution = 8\n";
  const auto poses = [&](const std::string& list) {
    return study("poses = [" + list + "]\n" + load + rest, compliant());
  };
  const std::string a = fmt::format("[0, 0, {}, 0, 0, 0]", h), b = fmt::format("[6, -4, {}, 0, 0, 10]", h - 3);
  const auto both = poses(a + ", " + b), one = poses(a), other = poses(b), none = study(load + rest, compliant());
  ASSERT_TRUE(both && one && other && none) << to_string(both.error());
  const Evaluation e = evaluated(*both, r1), e1 = evaluated(*one, r1), e2 = evaluated(*other, r1);
  ASSERT_EQ(e.state, State::done) << e.reason;
  EXPECT_EQ(e.figures[0].value, std::min(e1.figures[0].value, e2.figures[0].value));
  EXPECT_EQ(e.figures[1].value, std::max(e1.figures[1].value, e2.figures[1].value));
  const Evaluation everywhere = evaluated(*none, r1);
  ASSERT_EQ(everywhere.state, State::done) << everywhere.reason;
  EXPECT_LE(everywhere.figures[0].value, e1.figures[0].value);
  EXPECT_GE(everywhere.figures[1].value, e1.figures[1].value);
}

TEST(Duty, APoseThatIsNotReachedBreaksTheStudy) {
  const auto s =
      study("poses = [[0, 0, 60, 0, 0, 0], [0, 0, 300, 0, 0, 0], [0, 0, 400, 0, 0, 0], [0, 0, 62, 0, 0, 0]]\n" +
                kRadius + goal("longest_leg_mm", "min"),
            kStrut);
  ASSERT_TRUE(s) << to_string(s.error());
  const Evaluation e = evaluated(*s, 44);
  EXPECT_EQ(e.state, State::violates);
  EXPECT_NEAR(e.violation, 0.01 + 0.5, 1e-12);
  EXPECT_NE(e.reason.find("every pose of the study is reached (pose 2"), std::string::npos) << e.reason;
}

/// From rest to rest with speed v and acceleration a: L / v + v / a.
TEST(Duty, CycleTimeOfALineIsThatOfATrapezium) {
  const double h = home_height(44);
  const auto text = [&](double to) {
    return kRadius + goal("cycle_time_s", "min") +
           fmt::format(
               "[move]\nstart_mm = [0, 0, {}]\nsegments = [{{ to_mm = [0, 0, {}] }}]\n"
               "tool_speed_mm_per_s = 20\ntool_acceleration_mm_per_s2 = 200\ntool_jerk_mm_per_s3 = 0\n"
               "drive_jerk_mm_per_s3 = 0\n",
               h, to);
  };
  const auto s = study(text(h + 10), kStrut);
  ASSERT_TRUE(s) << to_string(s.error());
  const Evaluation e = evaluated(*s, 44);
  ASSERT_EQ(e.state, State::done) << e.reason;
  constexpr double kGrid = 2e-3;  // the plan goes from node to node of 1 mm
  EXPECT_NEAR(e.figures[0].value, 10.0 / 20 + 20.0 / 200, kGrid);
  const auto far = study(text(h + 100), kStrut);
  ASSERT_TRUE(far);
  const Evaluation broken = evaluated(*far, 44);
  EXPECT_EQ(broken.state, State::violates);
  EXPECT_NE(broken.reason.find("passes the whole motion"), std::string::npos) << broken.reason;
}

TEST(Duty, CycleTimeOfAPickIsThatOfThePlan) {
  const auto s = study_from_text(R"(machine = "delta-brno"
poses = [[0, 0, 500]]
load_N = [0, 0, 30]
[[vary]]
key = "arm.length_mm"
min = 150
max = 220
[pick]
from_mm = [-100, 0, 500]
to_mm = [100, 0, 500]
drive_speed_deg_per_s = 400
)" + goal("cycle_time_s", "min") + goal("longest_leg_mm", "min") +
                                     "[[hold]]\nfigure = \"drive_torque_Nm\"\nmax = 50\n",
                                 "test.toml");
  ASSERT_TRUE(s) << to_string(s.error());
  const Evaluation e = evaluated(*s, 180);
  ASSERT_EQ(e.state, State::done) << e.reason;
  motion::MotionLimits limits;
  limits.drive.speed = 400 * kRad;
  const auto plan = motion::plan(*s->machine_at({180}), {Vec3(-0.1, 0, 0.5), Vec3(0.1, 0, 0.5)}, limits);
  ASSERT_TRUE(plan) << to_string(plan.error());
  EXPECT_NEAR(e.figures[0].value, plan->time, 1e-9);
  EXPECT_NEAR(e.figures[1].value, 180 + 553.9, 1e-6);  // an arm and its rod
  // Under a force along the axis each of three arms carries a third: by the work of a small step along z.
  const auto turned = [&](double z) {
    return kinematics::inverse(*s->machine_at({180}), Pose{Mat3::Identity(), Vec3(0, 0, z)}).reachable()->joints[0];
  };
  const double rate = (turned(0.5 + 1e-6) - turned(0.5 - 1e-6)) / 2e-6;
  EXPECT_NEAR(e.figures[2].value, 10 / std::abs(rate), 1e-4);
}

struct Refused {
  std::string text, id, says;
  std::string machine;
};

TEST(Duty, WhatNoCandidateCanHaveIsRefusedWithTheReason) {
  const std::string arm = "machine = \"lola50\"\n[[vary]]\nkey = \"dh[2].a_mm\"\nmin = 800\nmax = 900\n";
  const std::string strut = "machine = \"hexapod-f100i\"\n";
  for (const Refused& r : std::vector<Refused>{
           {strut + kRadius + goal("natural_frequency_hz", "max"), "OP107", "needs masses", ""},
           {"machine = \"hexapod-strut\"\n" + kRadius + goal("natural_frequency_hz", "max"), "OP107",
            "needs compliances", ""},
           {strut + kRadius + goal("drive_force_N", "min"), "OP107", "needs load_N", ""},
           {strut + "load_N = [0, 0, 1]\n" + kRadius + goal("drive_torque_Nm", "min"), "OP107", "no drive turns", ""},
           {"load_N = [0, 0, 1]\n" + arm + goal("drive_force_N", "min"), "OP107", "no drive slides", ""},
           {"machine = \"hexapod-strut\"\n" + kRadius + goal("stiffness_N_per_um", "max"), "OP107", "needs compliances",
            ""},
           {strut + kRadius + goal("deflection_um", "min"), "OP107", "needs a load", ""},
           {arm + goal("longest_leg_mm", "min"), "OP107", "no legs", ""},
           {strut + kRadius + goal("cycle_time_s", "min"), "OP107", "needs a motion", ""},
           {strut + kRadius + "[pick]\nfrom_mm = [0, 0, 1]\nto_mm = [1, 0, 1]\n" + goal("cycle_time_s", "min"), "OP107",
            "serves deltas", ""},
           {strut + "poses = []\n" + kRadius + goal("height_mm", "min"), "OP140", "0 poses", ""},
           {strut + "load_N = [0, 0, 0]\n" + kRadius + goal("height_mm", "min"), "OP140", "load is 0", ""},
           {strut + "direction = [0, 0, 0]\n" + kRadius + goal("height_mm", "min"), "OP140", "no length", ""},
           {strut + "poses = [[0, 0, 1]]\n" + kRadius + goal("height_mm", "min"), "CF107", "must have 6", ""},
           {strut + kRadius + goal("height_mm", "min") + "[robust]\ntolerances = [\"base.radius=1\"]\n", "OP102",
            "base.radius_mm", ""},
           {strut + kRadius + goal("height_mm", "min") + "[robust]\ntolerances = [\"base.radius_mm=0\"]\n", "OP141",
            "no tolerance", ""},
           {strut + kRadius + goal("height_mm", "min") + "[robust]\ntolerances = []\n", "OP141", "0 parameters", ""},
       }) {
    const auto s = study_from_text(r.text, "s.toml");
    ASSERT_FALSE(s) << r.text;
    EXPECT_EQ(s.error().id, r.id) << to_string(s.error());
    EXPECT_NE((s.error().message + s.error().hint).find(r.says), std::string::npos) << to_string(s.error());
    EXPECT_GT(s.error().place.line, 0);
  }
}

TEST(Duty, WhatIsAskedOfTheMachineIsPartOfTheStudy) {
  const std::string rest = kRadius + goal("longest_leg_mm", "min");
  const auto identity = [&](const std::string& text) { return study(text + rest, kStrut).value().identity(); };
  const std::string a = identity("poses = [[0, 0, 60, 0, 0, 0]]\n");
  EXPECT_EQ(a, identity("# the same\nposes = [ [0, 0, 60.0, 0, 0, 0] ]\n"));
  EXPECT_NE(a, identity("poses = [[0, 0, 61, 0, 0, 0]]\n"));
  EXPECT_NE(a, identity("load_N = [0, 0, 1]\nposes = [[0, 0, 60, 0, 0, 0]]\n"));
  const std::string move = "[move]\nstart_mm = [0, 0, 60]\nsegments = [{ to_mm = [0, 0, 61] }]\n";
  const auto moving = [&](const std::string& text) { return study(rest + text, kStrut).value().identity(); };
  EXPECT_NE(moving(move), moving(move + "blend_mm = 1\n"));
  EXPECT_EQ(moving(move + "blend_mm = 1\nturning = \"turn\"\n"), moving(move + "turning = \"turn\"\nblend_mm = 1\n"));
}

/// Footprint of the strut hexapod of studies.hpp with these radii, mm2.
double footprint(double r1) {
  const double c15 = std::cos(15 * kRad), c45 = std::cos(45 * kRad), r2 = 25;
  return (std::max(r1 * c15, r2 * c45) + std::max(r1 * c45, r2 * c15)) * 2 * c15 * std::max(r1, r2);
}

TEST(Robust, EachFigureIsTheWorstOfTheCornersAndHoldsAreKeptAtAllOfThem) {
  const std::string box = "[robust]\ntolerances = [\"base.radius_mm=2\", \"platform.radius_mm=1\"]\n";
  const std::string wanted = kRadius + goal("footprint_mm2", "min");
  const Study s = study_on_strut(wanted + "[[hold]]\nfigure = \"height_mm\"\nmin = 40\n" + box);
  const Evaluation e = evaluated(s, 40);
  ASSERT_EQ(e.state, State::done) << e.reason;
  EXPECT_NEAR(e.figures[0].value, footprint(42), 1e-6 * footprint(42));
  EXPECT_NEAR(e.objective.value, 1 / footprint(42), 1e-6 / footprint(42));
  // The height falls as the radii part from each other.
  const auto height = [](double r1, double r2) {
    return std::sqrt(4900 - (r1 * r1 + r2 * r2 - 2 * r1 * r2 * std::cos(30 * kRad)));
  };
  double low = 1e9;
  for (const double r1 : {38.0, 40.0, 42.0})
    for (const double r2 : {24.0, 25.0, 26.0}) low = std::min(low, height(r1, r2));
  EXPECT_NEAR(e.figures[1].value, low, 1e-6);
  // Inside of the box nothing is worse, since both change monotonically here.
  Random random(4);
  for (int i = 0; i < 50; ++i) {
    EXPECT_LE(footprint(40 + random.uniform(-2, 2)), e.figures[0].value);
    EXPECT_GE(height(40 + random.uniform(-2, 2), 25 + random.uniform(-1, 1)), e.figures[1].value);
  }
  // A hold that the middle keeps and a corner breaks.
  const std::string held = fmt::format("[[hold]]\nfigure = \"footprint_mm2\"\nmin = {}\n", footprint(39));
  const Study tight = study_on_strut(wanted + held + box);
  EXPECT_EQ(evaluated(study_on_strut(wanted + held), 40).state, State::done);
  const Evaluation broken = evaluated(tight, 40);
  EXPECT_EQ(broken.state, State::violates);
  EXPECT_NE(broken.reason.find("base.radius_mm = 38"), std::string::npos) << broken.reason;
  EXPECT_NEAR(broken.violation, (footprint(39) - footprint(38)) / footprint(39), 1e-9);
  // What a row is dropped for decides it before all corners are judged: no figure of some of them is given.
  Incumbents found;
  found.objective = 1 / footprint(41);
  const auto dropped = evaluate(study_on_strut(wanted + box), {40}, found, {});
  ASSERT_TRUE(dropped);
  ASSERT_EQ(dropped->state, State::dropped) << dropped->reason;
  EXPECT_TRUE(std::isnan(dropped->figures[0].value)) << dropped->figures[0].value;
  EXPECT_LT(dropped->objective.upper, 1 / footprint(41));
  // Of a figure that holds bound on both sides the worst is what is the nearest to a bound.
  const std::string between =
      fmt::format("[[hold]]\nfigure = \"footprint_mm2\"\nmin = {}\nmax = {}\n", 0.5 * footprint(40), footprint(42.5));
  const Study both = study_on_strut(kRadius + goal("height_mm", "min") + between + box);
  const Evaluation near = evaluated(both, 40);
  ASSERT_EQ(near.state, State::done) << near.reason;
  EXPECT_NEAR(near.figures[1].value, footprint(42), 1e-6 * footprint(42));
  // A tolerance that leaves no machine.
  const Study none = study_on_strut("[[vary]]\nkey = \"base.radius_mm\"\nmin = 1\nmax = 68\n" +
                                    goal("footprint_mm2", "min") + "[robust]\ntolerances = [\"base.radius_mm=2\"]\n");
  EXPECT_EQ(evaluated(none, 1).state, State::refused);
}

}  // namespace
}  // namespace polypod::design
