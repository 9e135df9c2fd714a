// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "kinematics/invariants.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/delta/kinematics.hpp"
#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/twist.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using machine::JointVector;
using machine::kLegs;
using machine::SliderHexapod;
using machine::StrutHexapod;
using ::testing::HasSubstr;

// Lengths and poses of machines of 0.1 m agree to rounding of some sums.
constexpr double kExact = 1e-12;

template <class M>
M load_as(const std::string& name, const std::vector<machine::Override>& overrides = {}) {
  const auto m = machine::load(name, overrides);
  EXPECT_TRUE(m) << (m ? "" : to_string(m.error()));
  return std::get<M>(*m);
}

std::string error_of(const std::string& name, const std::vector<machine::Override>& overrides) {
  const auto m = machine::load(name, overrides);
  EXPECT_FALSE(m) << "accepted";
  return m ? "" : to_string(m.error());
}

template <class M>
void check(const M& m, double share) {
  testing::InvariantOptions options;
  options.share = share;
  testing::check_invariants(
      m, [&](const JointVector& q) { return machine::forward(m, q); },
      [&](const Pose& X) { return machine::inverse(m, X); },
      [&](const Pose& X, const JointVector& q) { return machine::jacobian(m, X, q); }, options);
}

Pose tilted(const Vec3& p, double tilt, double azimuth) {
  return Pose{rotation_of(tilt * Vec3(-std::sin(azimuth), std::cos(azimuth), 0)), p};
}

// Lengths within a tenth of the range round 70 mm, so that the mode round home exists and keeps all limits.
TEST(StrutHexapod, KeepsTheInvariants) {
  check(load_as<StrutHexapod>("hexapod-strut"), 0.1);
}

constexpr const char* kGeneral = R"(
family = "strut-hexapod"
base = { joints_mm = [[292,75,12],[-80,285,-10],[-210,215,5],[-214,-208,13],[-75,-293,-11],[286,-80,8]] }
platform = { joints_mm = [[108,102,-10],[40,148,8],[-146,36,4],[-140,-42,-6],[35,-142,9],[110,-104,-9]] }
leg = { length_min_mm = 400, length_max_mm = 600, compliance_um_per_N = 0.02 }
tool = { length_mm = 80 }
)";

TEST(StrutHexapod, KeepsTheInvariantsOnSixGeneralPoints) {
  const auto m = machine::from_text(kGeneral, "general.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  check(std::get<StrutHexapod>(*m), 0.2);
}

TEST(StrutHexapod, JointsOfEquations3_1And3_2) {
  const StrutHexapod m = load_as<StrutHexapod>("hexapod-strut");
  // (3.2) with alpha = beta = 30 deg, alpha_0 = 0: base at 15, 105, 135, 225, 255, 345, platform at 45, 75, 165, ...
  const double base[kLegs] = {15, 105, 135, 225, 255, 345}, platform[kLegs] = {45, 75, 165, 195, 285, 315};
  for (int i = 0; i < kLegs; ++i) {
    const double a = units::from_deg(base[i]), b = units::from_deg(platform[i]);
    EXPECT_LT((m.base_joint[i] - 0.05 * Vec3(std::cos(a), std::sin(a), 0)).norm(), kExact) << i;
    EXPECT_LT((m.platform_joint[i] - 0.025 * Vec3(std::cos(b), std::sin(b), 0)).norm(), kExact) << i;
  }
}

TEST(StrutHexapod, InverseIsTheDistanceOfTheJoints) {
  const StrutHexapod m = load_as<StrutHexapod>("hexapod-strut");
  // By hand at home: the tip at 75 mm, horizontal distance of joints 1: |50 e(15) - 25 e(45)| by the law of cosines.
  const double across = std::sqrt(50.0 * 50 + 25 * 25 - 2 * 50 * 25 * std::cos(units::from_deg(30)));
  const auto result = machine::inverse(m, Pose{Mat3::Identity(), Vec3(0, 0, 0.075)});
  ASSERT_EQ(result.solutions.size(), 1u);
  EXPECT_EQ(result.solutions[0].violations, 0u);
  for (int i = 0; i < kLegs; ++i) {
    EXPECT_NEAR(units::to_mm(result.solutions[0].joints[i]), std::hypot(across, 65), 1e-10);
  }
}

TEST(StrutHexapod, EveryViolatedLimitIsNamed) {
  const auto m = *machine::load("hexapod-strut");
  const auto result = kinematics::inverse(m, Pose{Mat3::Identity(), Vec3(0.06, 0, 0.05)});
  ASSERT_EQ(result.solutions.size(), 1u);
  std::string all;
  for (const auto& name : kinematics::limit_names(m, result.solutions[0].violations)) all += name + ";";
  EXPECT_THAT(all, HasSubstr("strut 2 above its maximum length"));
  EXPECT_THAT(all, HasSubstr("strut 6 below its minimum length"));
  EXPECT_THAT(all, HasSubstr("base joint 3 beyond its limit"));
  EXPECT_THAT(all, HasSubstr("platform joint 3 beyond its limit"));
}

TEST(StrutHexapod, TheConeAngleIsExact) {
  // A leg turned by exactly the cone's angle: just inside below it, outside above.
  const StrutHexapod m = load_as<StrutHexapod>("hexapod-strut");
  const Vec3 s = m.home.direction[0];
  for (const double miss : {-1e-6, 1e-6}) {
    const Vec3 w = rotation_of((m.joint.angle + miss) * s.cross(Vec3::UnitX()).normalized()) * s;
    const double margin = machine::hexapod_detail::joint_margin<double>(m.joint, w, s, Mat3::Identity());
    EXPECT_EQ(margin<0, miss> 0);
  }
}

TEST(StrutHexapod, PyramidAllowsItsHalfAngles) {
  const machine::JointLimit limit{machine::JointLimitKind::pyramid, units::from_deg(20), units::from_deg(35)};
  const Vec3 s = Vec3(0.3, 0.1, 0.9).normalized();
  const Vec3 tangential = Vec3::UnitZ().cross(s).normalized(), across = s.cross(tangential);
  for (const double side : {-1.0, 1.0}) {
    for (const auto& [axis, angle] : {std::pair{tangential, limit.angle}, std::pair{across, limit.angle_across}}) {
      const Vec3 in = std::cos(angle - 1e-6) * s + side * std::sin(angle - 1e-6) * axis;
      const Vec3 out = std::cos(angle + 1e-6) * s + side * std::sin(angle + 1e-6) * axis;
      EXPECT_GT(machine::hexapod_detail::joint_margin<double>(limit, in, s, Mat3::Identity()), 0);
      EXPECT_LT(machine::hexapod_detail::joint_margin<double>(limit, out, s, Mat3::Identity()), 0);
    }
  }
}

TEST(StrutHexapod, ElevationCountsFromHomeBothWays) {
  const machine::JointLimit limit{machine::JointLimitKind::elevation, units::from_deg(20), 0};
  const auto leg = [](double elevation_deg, double turn_deg) {
    const double e = units::from_deg(elevation_deg), a = units::from_deg(turn_deg);
    return Vec3(std::sin(e) * std::cos(a), std::sin(e) * std::sin(a), std::cos(e));
  };
  const Vec3 home = leg(40, 10);
  for (const double turn : {10.0, 100.0, 250.0}) {  // a turn about the normal costs nothing
    for (const auto& [e, inside] : {std::pair{20.001, true}, {19.999, false}, {59.999, true}, {60.001, false}}) {
      EXPECT_EQ(machine::hexapod_detail::joint_margin<double>(limit, leg(e, turn), home, Mat3::Identity()) > 0, inside)
          << e;
    }
  }
}

TEST(Segments, DistanceInEveryCase) {
  const Vec3 o(0, 0, 0), x(1, 0, 0);
  EXPECT_NEAR(segment_distance(o, x, Vec3(0.5, -1, 0.3), Vec3(0.5, 1, 0.3)), 0.3, kExact);    // crossing
  EXPECT_NEAR(segment_distance(o, x, Vec3(0.2, 0.4, 0), Vec3(0.9, 0.4, 0)), 0.4, kExact);     // parallel, side by side
  EXPECT_NEAR(segment_distance(o, x, Vec3(2, 0, 0), Vec3(3, 0, 0)), 1.0, kExact);             // in line
  EXPECT_NEAR(segment_distance(o, x, Vec3(2, 1, 0), Vec3(3, 1, 0)), std::sqrt(2.0), kExact);  // parallel, apart
  EXPECT_NEAR(segment_distance(o, x, Vec3(2, 1, 0), Vec3(2, 3, 0)), std::sqrt(2.0), kExact);  // both ends
  EXPECT_NEAR(segment_distance(o, o, Vec3(0, 3, 4), Vec3(0, 3, 4)), 5.0, kExact);             // two points
}

// The distance against a fine sampling of both segments, at random.
TEST(Segments, DistanceAgainstSampling) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto point = [&] { return Vec3(unit(random), unit(random), unit(random)); };
  for (int k = 0; k < 100; ++k) {
    const Vec3 a = point(), b = point(), c = point(), d = point();
    double best = 10;
    for (int i = 0; i <= 100; ++i)
      for (int j = 0; j <= 100; ++j) best = std::min(best, (a + (b - a) * i / 100 - c - (d - c) * j / 100).norm());
    const double exact = segment_distance(a, b, c, d);
    EXPECT_LE(exact, best + kExact);
    EXPECT_GE(exact, best - 0.02 * ((b - a).norm() + (d - c).norm()));  // half a step of each
  }
}

TEST(StrutHexapod, ForwardNeedsAtMostFiveStepsFromANeighbouringPoseAtThirtyDegrees) {
  const StrutHexapod m = load_as<StrutHexapod>("hexapod-strut");
  std::mt19937 random(20260902);
  std::uniform_real_distribution<double> unit(-1, 1);
  int worst = 0;
  for (int k = 0; k < 2000; ++k) {
    const Pose X = tilted(Vec3(0.01 * unit(random), 0.01 * unit(random), 0.075 + 0.01 * unit(random)),
                          units::from_deg(30) * std::abs(unit(random)), 3.2 * unit(random));
    JointVector q(kLegs);
    machine::lengths(m, X, q.data());
    // A neighbouring pose: up to 3 mm and 3 deg away on a machine of 70 mm.
    Pose seed = X;
    seed.p += 0.003 * Vec3(unit(random), unit(random), unit(random));
    seed.R = rotation_of(units::from_deg(3) * Vec3(unit(random), unit(random), unit(random))) * seed.R;
    const auto result = machine::forward_from(m, q, seed);
    ASSERT_TRUE(result.converged);
    worst = std::max(worst, result.iterations);
    ASSERT_LT((result.X_MT.p - X.p).norm(), 1e-10);
    ASSERT_LT((result.X_MT.R - X.R).norm(), 1e-9);
  }
  EXPECT_LE(worst, 5);
}

TEST(StrutHexapod, SingularOfKindTwoIsNotConverged) {
  // Fichter's singularity: a symmetric platform turned by 90 deg about z over its base.
  const StrutHexapod m = load_as<StrutHexapod>("hexapod-strut");
  const Pose X{rotation_z(units::from_deg(90)), Vec3(0, 0, 0.07)};
  JointVector q(kLegs);
  machine::lengths(m, X, q.data());
  const auto any = kinematics::AnyMachine(m);
  EXPECT_GT(kinematics::dexterity(any, X, q).condition, 1e6);
  EXPECT_TRUE(machine::jacobian(m, X, q).allFinite());
}

TEST(StrutHexapod, ForwardOfImpossibleLengthsFindsNoPose) {
  const auto m = *machine::load("hexapod-strut");
  JointVector q(kLegs);
  q << 0.05, 0.09, 0.05, 0.09, 0.05, 0.5;
  const auto result = kinematics::forward(m, q);
  EXPECT_TRUE(result.poses.empty());
  EXPECT_FALSE(result.complete);
}

// Sliders within 1.6 mm of the middle of their rails: a platform of 10 mm radius turns by up to 20 deg then.
TEST(SliderHexapod, KeepsTheInvariants) {
  check(load_as<SliderHexapod>("hexapod-slider"), 0.04);
}

TEST(SliderHexapod, RootsAreOnTheRailAndBranchesAreNamed) {
  const SliderHexapod m = load_as<SliderHexapod>("hexapod-hexaglide");
  // Over the long rails both roots of legs 2 to 5 lie on them; legs 1 and 6 have their other root beyond the end.
  const Pose X{Mat3::Identity(), Vec3(0, 0, 0.74)};
  const auto result = machine::inverse(m, X);
  ASSERT_EQ(result.solutions.size(), 16u) << result.reason;
  EXPECT_EQ(branch_name(m, result.solutions[0].branch), "outer");
  EXPECT_EQ(branch_name(m, result.solutions[1].branch), "inner at 2");
  EXPECT_EQ(branch_name(m, result.solutions[15].branch), "inner at 2, 3, 4, 5");
  for (const auto& s : result.solutions) {
    const auto legs = machine::six_legs(m, s.joints);
    for (int i = 0; i < kLegs; ++i) {
      EXPECT_NEAR((X * legs.end[i] - legs.anchor[i]).norm(), m.leg_length, kExact);
      EXPECT_GE(s.joints[i], 0);
      EXPECT_LE(s.joints[i], m.rail_length[i]);
    }
  }
}

TEST(SliderHexapod, OutOfReachNamesTheLegs) {
  const auto m = *machine::load("hexapod-slider");
  const auto result = kinematics::inverse(m, Pose{Mat3::Identity(), Vec3(0, 0, 0.3)});
  EXPECT_TRUE(result.solutions.empty());
  EXPECT_THAT(result.reason, HasSubstr("leg 1 does not reach its rail"));
}

TEST(SliderHexapod, LegBehindEitherRailPlaneIsBehindTheBase) {
  // (4.17): the planes through rail 1 and the outer ends of rails 6 and 2.
  const SliderHexapod m = load_as<SliderHexapod>("hexapod-slider");
  EXPECT_NEAR(m.guard[0][0].dot(m.rail_direction[0]), 0, kExact);
  EXPECT_NEAR(m.guard[0][0].dot(m.rail_outer[5] - m.rail_outer[0]), 0, kExact);
  EXPECT_NEAR(m.guard[0][1].dot(m.rail_outer[1] - m.rail_outer[0]), 0, kExact);
  EXPECT_GT(m.guard[0][0].z(), 0);
  EXPECT_GT(m.guard[0][1].z(), 0);
  const auto any = kinematics::AnyMachine(m);
  std::string all;
  for (const auto& s : kinematics::inverse(any, Pose{Mat3::Identity(), Vec3(0.05, 0, 0.06)}).solutions)
    for (const auto& name : kinematics::limit_names(any, s.violations)) all += name + ";";
  EXPECT_THAT(all, HasSubstr("behind the base"));
}

TEST(SliderHexapod, FollowsAPathByContinuityWithLookAhead) {
  // Vertical movement of the platform through the height at which legs 1 to 6 stand square to their rails: there both
  // roots meet. Below it only one of them stays on the rail.
  const SliderHexapod m = load_as<SliderHexapod>("hexapod-slider", {{"leg.length_mm", "40"}});
  std::vector<Pose> path;
  for (int k = 0; k <= 200; ++k) path.push_back(Pose{Mat3::Identity(), Vec3(0, 0, 0.075 - 0.0001 * k)});
  const machine::LimitBits rails_only = (machine::LimitBits{1} << 12) - 1;
  const auto followed = machine::follow(m, path, nullptr, rails_only);
  ASSERT_FALSE(followed.joints.empty()) << followed.reason;
  for (std::size_t k = 1; k < followed.joints.size(); ++k) {
    // No slider jumps: a step of 0.1 mm moves a slider less than the roots are apart away from the fold.
    EXPECT_LT((followed.joints[k] - followed.joints[k - 1]).cwiseAbs().maxCoeff(), 0.004) << k;
  }
  // Started on the inner roots, where those end first, the path is shorter: look-ahead takes the better start.
  machine::SliderRoots roots[kLegs];
  machine::slider_roots(m, path[0], roots);
  JointVector inner(kLegs), outer(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    inner[i] = roots[i].inner;
    outer[i] = roots[i].outer;
  }
  const auto from_inner = machine::follow(m, path, &inner, rails_only);
  const auto from_outer = machine::follow(m, path, &outer, rails_only);
  EXPECT_EQ(followed.complete, std::max(from_inner.complete, from_outer.complete));
  EXPECT_NE(from_inner.complete, from_outer.complete);
}

// Each angle by the inverse; poses upright, tilted, beyond every twist, and turned so far that only another twist
// works.
TEST(Twist, RangesHoldTheAnglesThatWork) {
  for (const char* name : {"hexapod-strut", "hexapod-slider", "hexapod-octahedral"}) {
    SCOPED_TRACE(name);
    const machine::AnyMachine m = *machine::load(name);
    const Pose home = std::visit(
        [](const auto& hexapod) -> Pose {
          if constexpr (requires { hexapod.home.height; })
            return {Mat3::Identity(), Vec3(0, 0, hexapod.home.height + hexapod.tool_length)};
          return {};
        },
        m);
    for (int k = 0; k < 8; ++k) {
      Pose X = tilted(home.p + 0.1 * home.p.z() * Vec3(std::sin(k), std::cos(k), 0), 0.05 * k, k);
      X.R = X.R * rotation_z(0.4 * k);
      const auto ranges = kinematics::twist_ranges(m, X);
      for (int i = 0; i < 500; ++i) {
        const double gamma = -std::numbers::pi + 2 * std::numbers::pi * (i + 0.37) / 500;
        bool within = false;
        for (const auto& range : ranges) {
          for (const double turn : {0.0, 2 * std::numbers::pi}) {
            within = within || (range.from <= gamma + turn && gamma + turn <= range.to);
          }
        }
        const bool works = kinematics::inverse(m, kinematics::twisted(X, gamma)).reachable() != nullptr;
        EXPECT_EQ(within, works) << "pose " << k << ", " << gamma;
      }
      const auto nearest = kinematics::nearest_twist(ranges);
      EXPECT_EQ(nearest.has_value(), !ranges.empty());
      if (nearest) {
        EXPECT_NE(kinematics::inverse(m, kinematics::twisted(X, *nearest)).reachable(), nullptr);
      }
      if (k == 0) {
        EXPECT_EQ(nearest, 0.0);
      }
    }
  }
  EXPECT_TRUE(kinematics::twist_ranges(*machine::load("hexapod-strut"), tilted(Vec3(0, 0, 1), 0, 0)).empty());
}

TEST(Hexapods, ComplianceOfAStrutMachineIsSymmetricAndAddsUp) {
  const auto m = *machine::from_text(kGeneral, "general.toml");
  const auto& strut = std::get<StrutHexapod>(m);
  const auto c = statics::compliance_at(m, machine::home_pose(strut));
  ASSERT_TRUE(c.reachable) << c.reason;
  EXPECT_LT((c.C - c.C.transpose()).norm(), 1e-12 * c.C.norm());
  // Forces in the struts by equilibrium, shortening by the strut's compliance: the same displacement by energy.
  JointVector q(kLegs);
  machine::lengths(strut, c.X_MT, q.data());
  const auto legs = machine::six_legs(strut, q);
  const Mat6 K = machine::leg_rows(c.X_MT, legs.anchor, legs.end);
  Vec6 wrench;
  wrench << 10, -20, 30, 1, 2, -1;
  const Vec6 forces = K.transpose().partialPivLu().solve(wrench);
  EXPECT_NEAR(wrench.dot(c.C * wrench), strut.compliance * forces.squaredNorm(), 1e-9 * wrench.dot(c.C * wrench));
}

TEST(Hexapods, FilesReadBack) {
  for (const char* name : {"hexapod-strut", "hexapod-slider"}) {
    const auto m = *machine::load(name);
    const std::string written = machine::to_toml(m);
    const auto again = machine::from_text(written, "again.toml");
    ASSERT_TRUE(again) << to_string(again.error());
    EXPECT_EQ(machine::to_toml(*again), written);
  }
}

TEST(Hexapods, EveryParallelMachineOfTheCatalogueLoadsAndStandsAtHome) {
  int seen = 0;
  for (const auto& entry : machine::catalogue()) {
    const auto m = machine::load(std::string(entry.name));
    ASSERT_TRUE(m) << to_string(m.error());
    const std::optional<Pose> home = kinematics::home_pose(*m);
    if (!home) continue;
    ++seen;
    const auto result = kinematics::inverse(*m, *home);
    ASSERT_FALSE(result.solutions.empty()) << entry.name << ": " << result.reason;
    EXPECT_NE(result.reachable(), nullptr) << entry.name << ": " << kinematics::reason_of(*m, result);
  }
  EXPECT_GE(seen, 10);
}

TEST(Hexapods, ImpossibleGeometryIsRefused) {
  EXPECT_THAT(error_of("hexapod-strut", {{"leg.length_min_mm", "95"}}), HasSubstr("MA123"));
  EXPECT_THAT(error_of("hexapod-strut", {{"joint.cone_deg", "0"}}), HasSubstr("cone_deg"));
  EXPECT_THAT(error_of("hexapod-strut", {{"joint.cone_deg", "180"}}), HasSubstr("cone_deg"));
  EXPECT_THAT(error_of("hexapod-strut", {{"base.radius_mm", "0"}}), HasSubstr("radius_mm"));
  EXPECT_THAT(error_of("hexapod-strut", {{"base.radius_mm", "nan"}}), HasSubstr("MA103"));
  EXPECT_THAT(error_of("hexapod-strut", {{"base.pair_angle_deg", "120"}, {"platform.pair_angle_deg", "0"}}),
              HasSubstr("legs 1 and 2 coincide"));
  EXPECT_THAT(error_of("hexapod-strut", {{"leg.lenght_mm", "95"}}), HasSubstr("lenght_mm"));
  EXPECT_THAT(error_of("hexapod-slider", {{"rail.outer_radius_mm", "10"}, {"rail.inner_height_mm", "0"}}),
              HasSubstr("MA130"));
  EXPECT_THAT(error_of("hexapod-slider", {{"leg.length_mm", "20"}}), HasSubstr("MA131"));
  EXPECT_THAT(error_of("hexapod-slider", {{"leg.length_mm", "-1"}}), HasSubstr("length_mm"));
  const auto line = machine::from_text(R"(
family = "strut-hexapod"
base = { joints_mm = [[0,0,0],[1,0,0],[2,0,0],[3,0,0],[4,0,0],[5,0,0]] }
platform = { radius_mm = 20, pair_angle_deg = 30 }
leg = { length_min_mm = 30, length_max_mm = 70 }
)",
                                       "line.toml");
  ASSERT_FALSE(line);
  EXPECT_EQ(line.error().id, "MA121");
}

}  // namespace
}  // namespace polypod
