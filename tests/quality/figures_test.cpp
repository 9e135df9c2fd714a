// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Every figure that `polypod info` lists, of every machine of the catalogue: it can be set, and as a known error it
// moves the tool as the forward kinematics of the changed machine says.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <set>

#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/delta/kinematics.hpp"
#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/quality/elements.hpp"
#include "polypod/quality/errors.hpp"
#include "polypod/quality/singularity.hpp"

namespace polypod::quality {
namespace {

using kinematics::AnyMachine;
using machine::JointVector;
using machine::Parameter;

std::vector<Parameter> figures_of(const AnyMachine& m) {
  std::vector<Parameter> out = machine::settings(m);
  std::set<std::string> known;
  for (const Parameter& p : out) known.insert(p.key);
  for (const Parameter& p : kinematics::parameters(m))
    if (known.insert(p.key).second) out.push_back(p);
  return out;
}

std::optional<double> figure_in(const AnyMachine& m, const std::string& key) {
  for (const Parameter& p : figures_of(m))
    if (p.key == key) return units::to_user(p.value, p.unit);
  return {};
}

std::string text_of(double value) {
  return fmt::format("{:.17g}", value);
}

/// Limits, bodies and home: the closure does not know them.
bool is_limit(const std::string& family, const std::string& key) {
  for (const char* part : {"leg.length_m", ".diameter", "joint.cone", "joint.pyramid", "joint.base.", "joint.platform",
                           "joint.side", "joint.elbow", "].min", "].max", "home.", "drive.angle_", "limits.", "table.",
                           "rod.spacing", "base.thickness", "compliance"})
    if (key.find(part) != std::string::npos && key.find("platform.joint") == std::string::npos) return true;
  return family == "linear-delta" && key == "rail.length";
}

/// A pose near home that is neither symmetric nor upright (deltas: upright); of an arm one in the middle of its reach,
/// or near the middle of its joint ranges.
Pose pose_for(const AnyMachine& m) {
  if (kinematics::is_serial(m)) {
    if (kinematics::task(m) == machine::Task::axis)
      return kinematics::pose_of(machine::Task::axis, {0.1, -1.25, 0.05, 0.2, -0.1});
    JointVector q(kinematics::joint_count(m));
    for (int i = 0; i < q.size(); ++i) {
      const auto range = kinematics::joint_range(m, i);
      q[i] = (range.min + range.max) / 2 + 0.1 * (i + 1);
    }
    return kinematics::forward(m, q).poses.at(0);
  }
  Pose X = kinematics::home_pose(m).value();
  X.p += 0.02 * X.p.norm() * Vec3(1, -0.7, 0.5);
  if (kinematics::task(m).turns()) X.R = rotation_of(Vec3(0.03, -0.02, 0.01));
  return kinematics::settled(m, X).value_or(X);
}

struct Pair {
  Pose X;
  JointVector q;
};
Pair joints_of(const AnyMachine& m) {
  const auto solved = kinematics::inverse(m, pose_for(m));
  if (solved.solutions.empty()) throw std::runtime_error(solved.reason);
  const JointVector q = solved.solutions.front().joints;
  return {kinematics::forward(m, q).poses.at(0), q};
}

class Figures : public ::testing::TestWithParam<std::string> {};

TEST_P(Figures, CanBeSetAndChangeTheMachine) {
  const AnyMachine m = test::load(GetParam());
  const Pair at = joints_of(m);
  for (const Parameter& figure : figures_of(m)) {
    SCOPED_TRACE(figure.key);
    const std::string key = machine::key_of(figure);
    const double value = units::to_user(figure.value, figure.unit);
    const double step = figure.unit.empty() ? 1e-3 : 0.01;  // mm, deg
    double set = value + step;
    auto changed = machine::load(GetParam(), {{key, text_of(set)}});
    if (!changed) {  // at the upper end of its range
      set = value - step;
      changed = machine::load(GetParam(), {{key, text_of(set)}});
    }
    ASSERT_TRUE(changed) << to_string(changed.error());
    const auto listed = figure_in(*changed, figure.key);
    ASSERT_TRUE(listed);
    // A coordinate of a direction is scaled to a unit vector, which is of second order or turns it back in part.
    const bool direction = figure.unit.empty() && figure.key.find("direction") != std::string::npos;
    if (direction) {
      const double expected = set / std::sqrt(1 - value * value + set * set);
      EXPECT_NEAR(*listed, expected, 1e-12);
    } else {
      EXPECT_NEAR(*listed, set, 1e-9);
    }
    if (is_limit(machine::family_of(m), figure.key)) continue;
    const double before = std::abs(value), lost = std::abs(1 - before);
    if (direction && lost < 1e-12) continue;  // along the direction itself: still the same unit vector
    const auto moved = kinematics::forward(*changed, at.q);
    ASSERT_FALSE(moved.poses.empty()) << moved.reason;
    const double way =
        (moved.poses[0].p - at.X.p).norm() + rotation_vector(moved.poses[0].R * at.X.R.transpose()).norm();
    // The height of the inner ends of vertical rails is their length: it moves nothing, but it is a range.
    const bool longer = kinematics::joint_range(*changed, 0).max != kinematics::joint_range(m, 0).max;
    EXPECT_TRUE(way > 1e-9 || (figure.key == "rail.inner_height" && longer)) << "the tool stays where it is";
  }
}

TEST_P(Figures, AsKnownErrorsAgreeWithForwardKinematics) {
  const AnyMachine m = test::load(GetParam());
  const Pair at = joints_of(m);
  for (const Parameter& figure : figures_of(m)) {
    SCOPED_TRACE(figure.key);
    const std::string key = machine::key_of(figure);
    const double size = figure.unit.empty() ? 1e-5 : 1e-3;  // mm, deg
    const auto sizes = sized(m, {{key, size}}, false);
    ASSERT_TRUE(sizes) << to_string(sizes.error());
    const Vec6 linear = known_error(m, at.X, at.q, *sizes);
    const double value = units::to_user(figure.value, figure.unit);
    auto changed = machine::load(GetParam(), {{key, text_of(value + size)}});
    double sense = 1;
    if (!changed) {
      changed = machine::load(GetParam(), {{key, text_of(value - size)}});
      sense = -1;
    }
    ASSERT_TRUE(changed) << to_string(changed.error());
    const auto moved = kinematics::forward(*changed, at.q);
    ASSERT_FALSE(moved.poses.empty());
    Vec6 exact;
    exact << moved.poses[0].p - at.X.p, rotation_vector(moved.poses[0].R * at.X.R.transpose());
    // `leg.length` of a machine on rails names all six legs, each of which grows: so does the setting. Second order:
    // 1e-3 of 100 mm is 1e-5 of the size, and some tens of it near these poses.
    EXPECT_LT((sense * linear - exact).norm(), 3e-3 * exact.norm() + 1e-12) << linear.transpose() << "\n"
                                                                            << exact.transpose();
  }
}

INSTANTIATE_TEST_SUITE_P(Catalogue, Figures, ::testing::ValuesIn([] {
                           std::vector<std::string> names;
                           // Directions in machines of legs are made unit vectors again when one of their coordinates
                           // is set, and keep the value only in part; parallel_test and stages_test look at these
                           // machines.
                           for (const auto& entry : machine::catalogue()) {
                             const std::string name(entry.name);
                             const std::string family = machine::family_of(machine::load(name).value());
                             if (family != "parallel" && family != "stages") names.push_back(name);
                           }
                           return names;
                         }()),
                         [](const auto& entry) {
                           std::string name = entry.param;
                           for (char& c : name) c = c == '-' ? '_' : c;
                           return name;
                         });

TEST(Figures, SingleCoordinatesAndSettingsInOneGrammar) {
  const AnyMachine m = test::load("hexapod-strut");
  const auto both = [&](const char* a, const char* b) {
    const auto x = sized(m, {{a, 1.0}}, false), y = sized(m, {{b, 1.0}}, false);
    ASSERT_TRUE(x && y);
    ASSERT_EQ(x->size(), y->size());
    for (std::size_t k = 0; k < x->size(); ++k) EXPECT_EQ((*x)[k].element, (*y)[k].element);
  };
  both("base.joint[3].x", "base.joint[3].x_mm");
  both("base.joint[3]", "base.joint[3]_mm");
  both("base.radius", "base.radius_mm");
  both("base.pair_angle", "base.pair_angle_deg");
  EXPECT_FALSE(sized(m, {{"base.joint[7].x", 1.0}}, false));
  EXPECT_FALSE(sized(m, {{"base.radius_deg", 1.0}}, false));
  // Three coordinates together are the point.
  const Pair at = joints_of(m);
  const Vec6 point = known_error(m, at.X, at.q, *sized(m, {{"base.joint[3]", 0.01}}, false));
  const Vec6 coordinates =
      known_error(m, at.X, at.q,
                  *sized(m, {{"base.joint[3].x", 0.01}, {"base.joint[3].y", 0.01}, {"base.joint[3].z", 0.01}}, false));
  EXPECT_LT((point - coordinates).norm(), 1e-15);
}

TEST(Figures, NumbersOfListsAreSetAsListedAndAsInTheFile) {
  const auto with = [](const std::string& joint, const std::vector<machine::Override>& sets) {
    const auto m = machine::from_text(R"(
family = "strut-hexapod"
base = { radius_mm = 50, pair_angle_deg = 30 }
platform = { radius_mm = 25, pair_angle_deg = 30 }
leg = { length_min_mm = 50, length_max_mm = 90 }
)" + joint,
                                      "lists.toml", sets);
    if (!m) throw std::runtime_error(to_string(m.error()));
    return *m;
  };
  const std::string pyramid = "joint = { pyramid_deg = [30, 40] }\n";
  const std::string seats =
      "joint = { base = { cone_deg = [30, 31, 32, 33, 34, 35] }, platform = { cone_deg = 44 } }\n";
  for (const auto& [joint, listed, in_file] :
       {std::tuple{pyramid, "joint.pyramid[2]_deg", "joint.pyramid_deg[2]"},
        std::tuple{seats, "joint.base.cone[3]_deg", "joint.base.cone_deg[3]"},
        std::tuple{seats, "joint.platform.cone_deg", "joint.platform.cone_deg"}}) {
    for (const char* key : {listed, in_file}) {
      const AnyMachine m = with(joint, {{key, "41.5"}});
      std::optional<double> found;
      for (const Parameter& p : machine::settings(m))
        if (machine::key_of(p) == listed) found = units::to_user(p.value, p.unit);
      ASSERT_TRUE(found) << listed;
      EXPECT_NEAR(*found, 41.5, 1e-12);
    }
  }
}

TEST(Figures, SingleParametersAreSetInTheMachineThatTheOtherKeysGive) {
  const AnyMachine m =
      test::load("hexapod-strut", {{"base.joint[3].x_mm", "-20"}, {"base.radius_mm", "44"}, {"tool.length_mm", "12"}});
  EXPECT_NEAR(*figure_in(m, "base.joint[3].x"), -20, 1e-12);
  EXPECT_NEAR(*figure_in(m, "tool.length"), 12, 1e-12);
  const double y = *figure_in(m, "base.joint[1].x"), z = *figure_in(m, "base.joint[1].y");
  EXPECT_NEAR(std::hypot(y, z), 44, 1e-9);
  for (const char* key : {"base.joint[7].x_mm", "base.joint[3].x", "base.joint[3].w_mm", "home.hight_mm", "nothing"}) {
    const auto refused = machine::load("hexapod-strut", {{key, "1"}});
    ASSERT_FALSE(refused) << key;
  }
}

/// Elements of stages keep the number of their stage in front.
TEST(StageElements, ElementsOfStagesAreNamedByTheirStage) {
  const AnyMachine m = test::load("tricept-wrist");
  std::set<std::string> keys;
  for (const Element& e : elements(m)) EXPECT_TRUE(keys.insert(e.key).second) << e.key;
  for (const char* key :
       {"stage[1].machine.leg.length[2]", "stage[1].machine.base.joint[3]", "stage[2].machine.dh.alpha[1]",
        "stage[2].mount", "stage[2].mount.a", "stage[1].machine.tool", "joint[4]"}) {
    EXPECT_TRUE(keys.contains(key)) << key;
  }
}

/// The wrist of the five-axis Tricept with its tool along joint 4: joint 4 turns the tool about itself, and the task,
/// which leaves that turn free, has lost a motion. Its turns are those across the tool, tilted or not.
TEST(Stages, AWristInLineHasLostAMotion) {
  const AnyMachine m = test::load("tricept-wrist");
  const machine::Stages* stages = std::get_if<machine::Stages>(&m);
  for (const Vec3& p : {Vec3(0, 0, 0), Vec3(0.05, 0.1, 0)}) {
    machine::JointVector q = kinematics::inverse(m, machine::home_pose(*stages)).solutions.at(0).joints;
    // Moved drives lean the Tricept; joint 5 at 0 puts the tool in line with joint 4.
    q.head<3>() += p;
    q[4] = 0;
    const Pose X = kinematics::forward(m, q).poses.at(0);
    machine::JointVector turned = q;
    turned[3] += 0.5;
    const Pose same = kinematics::forward(m, turned).poses.at(0);
    ASSERT_LT((same.p - X.p).norm(), 1e-9);
    ASSERT_LT((same.R.col(2) - X.R.col(2)).norm(), 1e-9);
    const Singularity s = singularity(m, X, q);
    EXPECT_LT(s.mobility, 1e-6);
    EXPECT_EQ(s.kind, 1);
    EXPECT_NEAR(std::abs(s.idle_joints[3]), 1, 1e-6);
    EXPECT_GT(kinematics::dexterity(m, X, q).condition, 1e6);
  }
}

}  // namespace
}  // namespace polypod::quality
