// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Maps against closed forms of a small arm, and against what SLAV prints and measured.
#include <gmock/gmock.h>

#include <Eigen/LU>
#include <cmath>

#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/statics/identify.hpp"
#include "polypod/statics/plane.hpp"

namespace polypod::statics {
namespace {

using units::from_deg;
using units::from_mm;

// A lift and two links in a plane. With the elbow on one side everything is known in closed form.
constexpr double kA1 = 0.4, kA2 = 0.3;                         // m
constexpr double kLift = 2e-7, kFirst = 1e-6, kSecond = 3e-6;  // m/N, rad/Nm
constexpr double kStraight_deg = 5, kBent_deg = 170;           // range of the elbow

const machine::AnyMachine& scara() {
  static const machine::AnyMachine m = *machine::from_text(R"(
family = "serial"
task = "point"
dh = [ {joint = "prismatic"}, {a_mm = 400}, {a_mm = 300} ]
limits = [ {min_mm = -100, max_mm = 100}, {min_deg = -175, max_deg = 175}, {min_deg = 5, max_deg = 170} ]
compliance_rad_per_Nm = [2e-7, 1e-6, 3e-6]
)",
                                                           "scara.toml");
  return m;
}

/// The cosine of the elbow's angle, by the law of cosines.
double cos_elbow(double x, double y) {
  return (x * x + y * y - kA1 * kA1 - kA2 * kA2) / (2 * kA1 * kA2);
}
double shoulder(double x, double y) {
  const double elbow = std::acos(cos_elbow(x, y));
  return std::atan2(y, x) - std::atan2(kA2 * std::sin(elbow), kA1 + kA2 * std::cos(elbow));
}
/// Turning by dq about a vertical axis through `pivot` moves the tip across the lever; sum of c (z x r)(z x r)^T.
Mat3 by_hand(double x, double y) {
  const double q = shoulder(x, y);
  const auto turned = [&](double px, double py) { return Vec3(-(y - py), x - px, 0); };
  const Vec3 first = turned(0, 0), second = turned(kA1 * std::cos(q), kA1 * std::sin(q));
  Mat3 C = kFirst * first * first.transpose() + kSecond * second * second.transpose();
  C(2, 2) += kLift;
  return C;
}

// The inverse of this arm is numeric: joints to 1e-10 rad, and so C to 1e-9 of itself.
constexpr double kNumericInverse = 1e-8;

TEST(Map, TwoLinksAgreeWithTheirClosedForm) {
  const PlaneGrid grid =
      plane_grid(Plane::xy, from_mm(20), {{from_mm(-720), from_mm(720)}, {from_mm(-700), from_mm(690)}}, 13, 11);
  const Map map = compliance_map(scara(), grid, Mat3::Identity());
  ASSERT_EQ(map.points.size(), 13u * 11u);
  int in_reach = 0, out_of_reach = 0;
  for (int row = 0; row < 11; ++row) {
    for (int column = 0; column < 13; ++column) {
      const MapPoint& point = map.points[static_cast<std::size_t>(row * 13 + column)];
      const double x = from_mm(-720 + 120.0 * column), y = from_mm(-700 + 139.0 * row);
      ASSERT_LT((point.p_M - Vec3(x, y, from_mm(20))).norm(), 1e-15) << "columns fastest";
      const double c = cos_elbow(x, y);
      const bool elbow = c < std::cos(from_deg(kStraight_deg)) && c > std::cos(from_deg(kBent_deg));
      if (!elbow || std::abs(std::remainder(shoulder(x, y), 2 * M_PI)) > from_deg(175)) {
        EXPECT_FALSE(point.compliance.reachable) << x << ", " << y;
        ++out_of_reach;
        continue;
      }
      ASSERT_TRUE(point.compliance.reachable) << x << ", " << y << ": " << point.compliance.reason;
      ++in_reach;
      const Mat3 C = by_hand(x, y);
      EXPECT_LT((point.compliance.linear() - C).norm(), kNumericInverse * C.norm()) << x << ", " << y;
      // Each joint alone, too.
      EXPECT_NEAR(point.compliance.by_joint[0](2, 2), kLift, kNumericInverse * kLift);
      EXPECT_NEAR(point.compliance.by_joint[1](1, 1), kFirst * x * x, kNumericInverse * C.norm());
      EXPECT_NEAR(point.compliance.by_joint[2](0, 0), C(0, 0) - kFirst * y * y, kNumericInverse * C.norm());
      // det of (lift, turn, turn) in (x, y, z): a1 a2 sin of the elbow.
      const double det = kA1 * kA2 * std::sqrt(1 - c * c);
      EXPECT_NEAR(std::abs(point.determinant), det, kNumericInverse * det);
    }
  }
  EXPECT_GT(in_reach, 60);
  EXPECT_GT(out_of_reach, 10);
}

TEST(Map, PathErrorIsTheClosedFormTimesTheForce) {
  const Vec3 force(30, -50, 20), from(0.2, 0.3, 0), to(0.45, -0.2, 0.05);
  const auto path = path_error(scara(), from, to, 11, Mat3::Identity(), force);
  ASSERT_EQ(path.size(), 11u);
  for (int i = 0; i <= 10; ++i) {
    const Vec3 p = from + (to - from) * (i / 10.0), d = by_hand(p.x(), p.y()) * force;
    ASSERT_TRUE(path[static_cast<std::size_t>(i)].reachable) << i;
    EXPECT_LT((path[static_cast<std::size_t>(i)].total - d).norm(), kNumericInverse * d.norm()) << i;
  }
}

// SLAV (4.44) prints J at x_M = (0, -1300, 0) mm to three digits; its determinant is what Figure 2.18 draws.
TEST(Map, DeterminantOfThePrintedJacobian) {
  Eigen::Matrix<double, 5, 5> J;
  J << 1.3, 0, 0, -0.38, 0,  //
      0, 0, -0.805, 0, -0.407, 0, 1.3, 1.026, 0, 0, 0, -1, -1, 0, -1, 0, 0, 0, 0.932, 0;
  const auto m = *machine::load("lola50");
  const PlaneGrid grid = plane_grid(Plane::xy, 0, {{-0.6, 0.6}, {-1.6, -1}}, 5, 3);
  const Map map = compliance_map(m, grid, Mat3::Identity());
  constexpr double kPrinted = 3e-3;  // of 1.13: half a digit in the third place of five factors
  EXPECT_NEAR(map.points[7].determinant, J.determinant(), kPrinted);
}

// The 30 points at which SLAV measured (planes I and V), as a map of 5 x 3 points each: what it predicts under 250 N
// against the dial gauges. Residuals of the identification are 33 um (rms); a wrong sign or axis would give hundreds.
TEST(Map, AgreesWithTheMeasuredDisplacements) {
  const auto m = *machine::load("lola50");
  for (const auto& [file, z_mm] :
       {std::pair{"displacements_plane_I.csv", -400.0}, std::pair{"displacements_plane_V.csv", 0.0}}) {
    const auto measured = read_displacements(test::source(std::string("tests/statics/data/") + file));
    ASSERT_TRUE(measured) << to_string(measured.error());
    const PlaneGrid grid = plane_grid(Plane::xy, from_mm(z_mm), {{-0.6, 0.6}, {-1.6, -1}}, 5, 3);
    const Map map = compliance_map(m, grid, Mat3::Identity());
    ASSERT_EQ(map.points.size(), measured->size());
    double sum = 0;
    int count = 0;
    for (std::size_t i = 0; i < map.points.size(); ++i) {
      const MeasuredPoint& point = (*measured)[i];
      ASSERT_LT((map.points[i].p_M - point.X_MT.p).norm(), 1e-12) << "x fastest, then y from -1600 to -1000";
      const Mat3 residual = map.points[i].compliance.linear() * point.force - point.displacement;
      sum += residual.squaredNorm();
      count += 9;
    }
    EXPECT_LT(units::to_um(std::sqrt(sum / count)), 40) << file;
  }
}

TEST(Plane, GridsLieInTheirPlane) {
  EXPECT_EQ(plane_named("xz"), Plane::xz);
  EXPECT_FALSE(plane_named("zx").has_value());
  EXPECT_EQ(plane_named("ab"), (Plane{machine::Coordinate::a, machine::Coordinate::b}));
  EXPECT_EQ(plane_named("ZA"), (Plane{machine::Coordinate::z, machine::Coordinate::a}));
  for (const char* bad : {"", "x", "xx", "BA", "xyz", "x\0", "uv"}) EXPECT_FALSE(plane_named(bad).has_value()) << bad;
  const PlaneGrid grid = plane_grid(Plane::yz, 0.25, {{-1, 1}, {2, 3}}, 3, 2);
  EXPECT_LT((grid.point(0, 0) - Vec3(0.25, -1, 2)).norm(), 1e-15);
  EXPECT_LT((grid.point(1, 1) - Vec3(0.25, 0, 3)).norm(), 1e-15);
}

TEST(Plane, TheMiddleOfAHexapodIsItsToolAtHome) {
  // JEL Table 8.2: home height 65, tool 10.
  EXPECT_LT((kinematics::middle_of_work(*machine::load("hexapod-strut")) - Vec3(0, 0, from_mm(75))).norm(), 1e-12);
  EXPECT_EQ(kinematics::middle_of_work(*machine::load("lola50")), Vec3::Zero());
}

TEST(Plane, TheReachedRectangleHoldsTheAnnulusAndLittleMore) {
  // All directions but 10 deg at the back; the radius at the straightest elbow, by the law of cosines.
  const double radius = std::sqrt(kA1 * kA1 + kA2 * kA2 + 2 * kA1 * kA2 * std::cos(from_deg(kStraight_deg)));
  const auto found = reached_rectangle(scara(), Plane::xy, 0, Mat3::Identity());
  ASSERT_TRUE(found);
  constexpr double kStep = 0.1;  // two steps of the fine scan and the rounding
  for (const auto& [low, high] : {found->u, found->v}) {
    EXPECT_LE(low, -0.98 * radius);
    EXPECT_GE(low, -radius - kStep);
    EXPECT_GE(high, 0.98 * radius);
    EXPECT_LE(high, radius + kStep);
  }
  EXPECT_FALSE(reached_rectangle(scara(), Plane::xy, 0.2, Mat3::Identity())) << "above the lift";
  EXPECT_FALSE(reached_rectangle(scara(), Plane::xy, 50, Mat3::Identity())) << "beyond any link";
}

// z, A and B are prescribed, x, y and C follow.
TEST(TaskPlane, ATripodHasAMapOverItsTilts) {
  const auto m = machine::load("tripod-z3");
  ASSERT_TRUE(m);
  const machine::Task task = kinematics::task(*m);
  const std::vector<Plane> planes = planes_of(task);
  ASSERT_THAT(planes, testing::SizeIs(3));
  EXPECT_EQ(name_of(planes[0]), "AB");
  EXPECT_EQ(name_of(planes[1]), "zA");
  const TaskPlane over{planes[0], middle_coordinates(*m)};
  const auto all = reached_rectangle(*m, over);
  ASSERT_TRUE(all);
  for (const auto& [low, high] : {all->u, all->v}) {  // +-45 deg, a step of the scan and the rounding
    EXPECT_NEAR(units::to_deg(low), -45, 10);
    EXPECT_NEAR(units::to_deg(high), 45, 10);
  }
  const double a = from_deg(20), b = from_deg(-10);
  const Map map = compliance_map(*m, over, {{-a, a}, {2 * b, -2 * b}}, 3, 5);
  ASSERT_THAT(map.points, testing::SizeIs(15));
  double farthest = 0;
  for (int i = 0; i < 15; ++i) {
    const MapPoint& point = map.points[static_cast<std::size_t>(i)];
    ASSERT_TRUE(point.compliance.reachable);
    const std::vector<double> stands = kinematics::coordinates_of(task, point.compliance.X_MT);
    EXPECT_NEAR(stands[0], over.coordinates[0], 1e-12);
    EXPECT_NEAR(stands[1], (i % 3 - 1) * a, 1e-12);
    EXPECT_NEAR(stands[2], (2 - i / 3) * b, 1e-12);
    farthest = std::max(farthest, point.p_M.head<2>().norm());
    const Compliance alone = compliance_at(*m, kinematics::pose_of(task, stands));
    EXPECT_LT((alone.C - point.compliance.C).norm(), 1e-12 * alone.C.norm());
    EXPECT_NE(point.determinant, 0);
  }
  EXPECT_GT(farthest, from_mm(1)) << "the parasitic motions";
  EXPECT_FALSE(reached_rectangle(*m, {planes[0], {50, 0, 0}})) << "beyond any leg";
}

TEST(TaskPlane, OfAHexapodTheTiltsAtAnyPlace) {
  const auto m = machine::load("hexapod-strut");
  ASSERT_TRUE(m);
  const auto planes = planes_of(kinematics::task(*m));
  EXPECT_THAT(planes, testing::SizeIs(15));
  EXPECT_EQ(planes[0], Plane::xy);
  EXPECT_EQ(name_of(planes[3]), "AB");
  const TaskPlane over{planes[3], {0.005, 0, from_mm(75), 0, 0, from_deg(5)}};
  const Map map = compliance_map(*m, over, {{0, from_deg(10)}, {0, from_deg(6)}}, 2, 2);
  const Pose& last = map.points.back().compliance.X_MT;
  EXPECT_LT((last.p - Vec3(0.005, 0, from_mm(75))).norm(), 1e-15);
  const Mat3 R = (Eigen::AngleAxisd(from_deg(5), Vec3::UnitZ()) * Eigen::AngleAxisd(from_deg(6), Vec3::UnitY()) *
                  Eigen::AngleAxisd(from_deg(10), Vec3::UnitX()))
                     .toRotationMatrix();
  EXPECT_LT((last.R - R).norm(), 1e-14);
}

// Every machine of the catalogue has a map without a word about its size.
TEST(Plane, EveryMachineOfTheCatalogueHasADefault) {
  for (const machine::CatalogueEntry& entry : machine::catalogue()) {
    const auto m = machine::load(std::string(entry.name));
    ASSERT_TRUE(m);
    for (const Plane plane : {Plane::xy, Plane::xz, Plane::yz}) {
      // Each of the thousands of points that are looked at is a search there.
      if (machine::family_of(*m) == "stages" && plane != Plane::xy) continue;
      const double at = kinematics::middle_of_work(*m)[axes_of(plane).normal];
      const auto rectangle = reached_rectangle(*m, plane, at, Mat3::Identity());
      ASSERT_TRUE(rectangle) << entry.name << " " << name_of(plane);
      const Map map = compliance_map(*m, plane_grid(plane, at, *rectangle, 11, 11), Mat3::Identity());
      const auto reached =
          std::count_if(map.points.begin(), map.points.end(), [](const MapPoint& p) { return p.compliance.reachable; });
      EXPECT_GT(reached, 11 * 11 / 10) << entry.name << " " << name_of(plane);
    }
  }
}

}  // namespace
}  // namespace polypod::statics
