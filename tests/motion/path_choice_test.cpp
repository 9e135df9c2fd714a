// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a path leaves open (JEL 7.2), its quality (7.1), and what resolution, delay and interval of commands leave
// (7.1).
#include "polypod/motion/path_choice.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "machines.hpp"

#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::motion {
namespace {

using test::load;

PosePath line(const TargetPose& from, const TargetPose& to) {
  return *pose_path_of({*straight(from, to)});
}
const Vec3 kLevel = Vec3::Zero();

/// Three slides, one for each axis: what they do is what the tool does.
AnyMachine gantry() {
  return AnyMachine(test::arm_of(R"(
family = "serial"
task = ["x", "y", "z"]
dh = [
  { joint = "prismatic", theta_offset_deg = 90, alpha_deg = 90 },
  { joint = "prismatic", theta_offset_deg = 90, alpha_deg = 90 },
  { joint = "prismatic" },
]
limits = [{ min_mm = -500, max_mm = 500 }, { min_mm = -500, max_mm = 500 }, { min_mm = -500, max_mm = 500 }]
)"));
}

TEST(Quality, OfAPathOnWhichEveryPoseIsIsotropic) {
  const PosePath path = line({Vec3(0.1, 0, 0), kLevel}, {Vec3(-0.1, 0.05, 0.02), kLevel});
  const double L = 1e3 * path.length;
  for (const double p : {0.0, 0.3, 1.0}) {
    const auto q = quality_of(gantry(), path, {}, Goal::inverse_condition, p);
    ASSERT_TRUE(q);
    EXPECT_NEAR(q->integral, L, 1e-9 * L);
    EXPECT_NEAR(q->f, (p + (1 - p) * L) / L, 1e-12);
  }
  // The longer of two ways between the same points is the worse one where the length counts alone.
  const PosePath detour = *pose_path_of({*straight({Vec3(0.1, 0, 0), kLevel}, {Vec3(0, 0.2, 0), kLevel}),
                                         *straight({Vec3(0, 0.2, 0), kLevel}, {Vec3(-0.1, 0.05, 0.02), kLevel})});
  EXPECT_LT(quality_of(gantry(), detour, {}, Goal::sigma_min, 1)->f,
            quality_of(gantry(), path, {}, Goal::sigma_min, 1)->f);
  EXPECT_FALSE(
      quality_of(load("lola50"), line({Vec3(0, -5, 0), kLevel}, {Vec3(0, -6, 0), kLevel}), {}, Goal::sigma_min, 1));
}

/// A planar arm of two links along a radius: det J = l1 l2 sin q2, whose integral is that of Simpson's rule here.
/// Points lie 1 mm apart, so that the trapezoids of quality_of are off by less than 1e-5; sums without halves by 1e-3.
TEST(Quality, IntegralOfADeterminantThatChanges) {
  const AnyMachine arm(test::arm_of(R"(
family = "serial"
task = ["x", "y"]
dh = [{ a_mm = 500 }, { a_mm = 400 }]
)"));
  const double from = 0.4, to = 0.7;
  const auto q = quality_of(arm, line({Vec3(from, 0, 0), kLevel}, {Vec3(to, 0, 0), kLevel}), {}, Goal::determinant, 0);
  ASSERT_TRUE(q);
  const auto determinant = [](double r) {
    const double cosine = (r * r - 0.25 - 0.16) / (2 * 0.5 * 0.4);
    return 0.5 * 0.4 * std::sqrt(1 - cosine * cosine);
  };
  constexpr int kPieces = 1000;
  double sum = 0;
  for (int i = 0; i <= kPieces; ++i) {
    const int weight = i == 0 || i == kPieces ? 1 : i % 2 == 1 ? 4 : 2;
    sum += weight * determinant(from + (to - from) * i / kPieces);
  }
  const double want = sum * (to - from) / kPieces / 3 * 1e3;  // mm
  EXPECT_NEAR(q->integral, want, 1e-5 * want);
  EXPECT_NEAR(q->least, std::min(determinant(from), determinant(to)), 1e-12);
}

/// On a gantry the tool's error is that of the drives: half a step of each at most, and what it is behind by the delay.
TEST(Actuators, ResolutionDelayAndIntervalOfAGantry) {
  const PosePath path = line({Vec3(0.1, 0, 0), kLevel}, {Vec3(-0.1, 0.05, 0.023), kLevel});
  MoveOptions options;
  const double speed = path.length / 2;  // 2 s: 500 commands
  options.speed = speed;
  options.samples = 11;
  options.condition = 0;
  Actuators a;
  const double step = 20e-6;
  a.resolution = JointVector::Constant(3, step);
  a.interval = 4e-3;
  a.delay = JointVector::Constant(3, 30e-3);
  options.actuators = a;
  const auto r = move(gantry(), path, options);
  ASSERT_TRUE(r) << r.error().message;
  ASSERT_TRUE(r->contour);
  const ContourError& e = *r->contour;
  const double most = std::sqrt(3.0) * step / 2;
  EXPECT_LE(e.compensated.largest, most);
  EXPECT_GT(e.compensated.largest, 0.2 * most);
  EXPECT_LE(e.coarse.largest, most);
  EXPECT_LE(e.compensated.largest_lag, most);
  EXPECT_NEAR(e.uncompensated.largest_lag, speed * 30e-3, 2 * most);  // speed times delay
  EXPECT_LE(e.uncompensated.largest, most);                           // a straight line stays one
  // One drive later than the others: the path is left by its part of the way, across the direction.
  options.actuators->resolution.setZero();
  options.actuators->delay << 30e-3, 0, 0;
  const auto late = move(gantry(), path, options);
  ASSERT_TRUE(late && late->contour);
  const Vec3 t = (path.stretches[0].to - path.stretches[0].from).normalized();
  // Joint 1 of the gantry moves along one axis of M: its way in 30 ms less what lies along the path.
  Vec3 axis;
  const machine::JacobianMatrix J = kinematics::jacobian(gantry(), late->samples[5].X, late->samples[5].q);
  axis = J.col(0).head<3>();
  const Vec3 off = speed * 30e-3 * t.dot(axis) * axis;
  EXPECT_NEAR(late->contour->uncompensated.largest, (off - off.dot(t) * t).norm(), 1e-9);
  EXPECT_LT(late->contour->compensated.largest, 1e-12);
}

/// Between two commands a drive goes straight: a chord leaves an arc by q'' T^2 / 8.
TEST(Actuators, ChordsBetweenCommands) {
  MoveOptions options;
  options.speed = 0.2;
  options.samples = 11;
  options.condition = 0;
  const double T = 20e-3, r = 0.05;
  options.actuators = Actuators{JointVector::Zero(3), T, JointVector::Zero(3), false};
  const auto circle = *pose_path_of({*curved({Vec3(r, 0, 0), kLevel}, Vec3(0, r, 0), {Vec3(-r, 0, 0), kLevel})});
  const auto result = move(gantry(), circle, options);
  ASSERT_TRUE(result && result->contour);
  const double w = 0.2 / r;
  EXPECT_NEAR(result->contour->compensated.largest, r * (1 - std::cos(w * T / 2)),
              0.02 * r * (1 - std::cos(w * T / 2)));
  options.actuators->interval = 1e-9;
  EXPECT_EQ(move(gantry(), circle, options).error().id, "MO118");
}

TEST(Rotation, IsChosenSoThatThePathCanBePassed) {
  const AnyMachine m = load("hexapod-strut");
  const Vec3 p = kinematics::home_pose(m)->p;
  const Vec3 turned(0, 0, units::from_deg(100));  // more than the struts allow
  const PosePath path = line({p, turned}, {p + Vec3(0.006, 0.004, 0), turned});
  MoveOptions options;
  ASSERT_FALSE(follow(m, path, options).passes);
  const RotationChoice chosen = choose_rotation(m, path, options);
  ASSERT_TRUE(chosen.passes && chosen.constant);
  // Another angle is not better conditioned, and the tool's position and axis are what they were.
  for (const double by : {-0.2, -0.05, 0.05, 0.2}) {
    PosePath other = path;
    other.stretches[0].spin_from = other.stretches[0].spin_to = chosen.angles[0] + by;
    const PathVerdict v = follow(m, other, options);
    EXPECT_TRUE(!v.passes || v.condition > chosen.condition * 0.98);
  }
  const Stretch &before = path.stretches[0], &after = chosen.path.stretches[0];
  EXPECT_LT((before.pose(0.003).p - after.pose(0.003).p).norm(), 1e-15);
  EXPECT_LT((before.pose(0.003).R.col(2) - after.pose(0.003).R.col(2)).norm(), 1e-15);
  EXPECT_NEAR(rotation_vector(before.pose(0.003).R.transpose() * after.pose(0.003).R).norm(),
              std::abs(chosen.angles[0]), 1e-9);
}

/// Of random lines whose ends can be reached: where the way cannot be passed as it turns and points are put in, all of
/// the new way can be reached, it begins, ends and leads where it did, and what was put in turns on the spot.
TEST(Insertion, TurnsOnTheSpotWhereTheWayCannotBePassed) {
  const AnyMachine m = load("hexapod-strut");
  const Vec3 p = kinematics::home_pose(m)->p;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> sign(-1, 1);
  MoveOptions options;
  options.step = 2e-3;
  int found = 0;
  for (int k = 0; k < 20000 && found < 3; ++k) {
    const auto pose = [&] {
      return TargetPose{p + Vec3(0.03 * sign(random), 0.03 * sign(random), 0.012 * sign(random)),
                        Vec3(0.6 * sign(random), 0.6 * sign(random), 0.5 * sign(random))};
    };
    const TargetPose a = pose(), b = pose();
    const auto reached = [&](const TargetPose& t) {
      return kinematics::inverse(m, {rotation_abc(t.angles.x(), t.angles.y(), t.angles.z()), t.p}).reachable() !=
             nullptr;
    };
    if (!reached(a) || !reached(b)) continue;
    const PosePath path = line(a, b);
    if (follow(m, path, options).passes) continue;
    const Insertion put_in = insert_points(m, path, options);
    if (!put_in.passes) continue;
    ++found;
    EXPECT_FALSE(put_in.points.empty());
    EXPECT_NEAR(put_in.path.length, path.length, 1e-12);
    const Stretch &first = put_in.path.stretches.front(), &last = put_in.path.stretches.back();
    EXPECT_LT(test::difference(first.pose(0), path.stretches[0].pose(0)), 1e-12);
    EXPECT_LT(test::difference(last.pose(last.size), path.stretches[0].pose(path.size)), 1e-12);
    for (const Stretch& s : put_in.path.stretches) {
      EXPECT_EQ(s.inserted, !(s.length > 0));
      for (int i = 0; i <= 40; ++i) {
        EXPECT_NE(kinematics::inverse(m, s.pose(s.size * i / 40)).reachable(), nullptr);
      }
    }
    // In a given time: turns and way together take it.
    PosePath timed = path;
    timed.stretches[0].duration = 2;
    double all = 0;
    for (const Stretch& s : insert_points(m, timed, options).path.stretches) {
      EXPECT_GT(s.duration, 0);
      all += s.duration;
    }
    EXPECT_NEAR(all, 2, 1e-12);
    // Waits stay where the whole begins and ends.
    timed.stretches[0].wait_before = 1;
    timed.stretches[0].wait = 3;
    const std::vector<Stretch> waiting = insert_points(m, timed, options).path.stretches;
    double waits = 0;
    for (const Stretch& s : waiting) waits += s.wait_before + s.wait;
    EXPECT_DOUBLE_EQ(waits, 4);
    EXPECT_DOUBLE_EQ(waiting.front().wait_before, 1);
    EXPECT_DOUBLE_EQ(waiting.back().wait, 3);
    for (const InsertedPoint& point : put_in.points) {
      EXPECT_TRUE((point.p - a.p).norm() < 1e-12 || (point.p - b.p).norm() < 1e-12);
    }
  }
  EXPECT_EQ(found, 3);
}

/// JEL 7.2: of a slider with two positions on its rail the one is taken with which the whole path can be passed.
TEST(Starts, TheRootIsTakenWithWhichThePathCanBePassed) {
  bool several = false;
  for (const char* name : {"hexapod-slider", "hexapod-hexaglide", "hexapod-hexam", "hexapod-vertical"}) {
    const AnyMachine m = load(name);
    const auto reach = kinematics::reach(m);
    const Vec3 p = kinematics::home_pose(m)->p, size = reach.high - reach.low;
    for (int k = 0; k < 8; ++k) {
      const double share = 0.01 * (k / 4), turn = 0.5 * std::numbers::pi * (k % 4);
      const PosePath path =
          line({p, kLevel},
               {p + share * (Vec3(std::cos(turn), std::sin(turn), 0.5).cwiseProduct(size) + 1e-3 * size), kLevel});
      const auto first = kinematics::inverse(m, path.stretches[0].pose(0));
      if (first.solutions.size() < 2) continue;
      MoveOptions options;
      options.speed = 0.1 * path.length;
      options.samples = 3;
      options.step = path.length / 20;
      const auto r = move(m, path, options);
      ASSERT_TRUE(r) << r.error().message;
      several = true;
      EXPECT_EQ(r->starts.size(), first.solutions.size());
      const auto passing =
          std::count_if(r->starts.begin(), r->starts.end(), [](const MoveStart& s) { return s.completes; });
      EXPECT_EQ(r->ok(), passing > 0);
      for (const MoveStart& s : r->starts) {
        if (s.chosen) {
          EXPECT_EQ(s.completes, passing > 0);
        }
      }
    }
  }
  EXPECT_TRUE(several);
}

}  // namespace
}  // namespace polypod::motion
