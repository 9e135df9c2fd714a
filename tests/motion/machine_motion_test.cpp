// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Motion of every machine: derivatives of the drives against differences of the inverse, given and planned motions
// against closed forms, limits looked at between the nodes.
#include "polypod/motion/machine_motion.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <numbers>

#include "machines.hpp"

#include "polypod/core/units.hpp"
#include "polypod/families/delta/drives.hpp"
#include "polypod/families/delta/kinematics.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/motion/cycles.hpp"

namespace polypod::motion {
namespace {

using machine::Coordinate;
using machine::Task;
using test::load;

std::string written(const std::string& name, const std::string& text) {
  const std::string path = ::testing::TempDir() + name;
  std::ofstream(path) << text;
  return path;
}

TargetPose target_of(const AnyMachine& m, const Pose& X) {
  const Task task = kinematics::task(m);
  const std::vector<double> c = kinematics::coordinates_of(task, X);
  TargetPose out;
  for (int i = 0; i < task.size(); ++i) {
    const int k = static_cast<int>(task[i]);
    (k < 3 ? out.p[k] : out.angles[k - 3]) = c[static_cast<std::size_t>(i)];
  }
  return out;
}

/// A short way from a pose in every coordinate of the task.
Stretch way_from(const AnyMachine& m, const Pose& X, double share) {
  const auto reach = kinematics::reach(m);
  const double size = share * (reach.high - reach.low).minCoeff();
  const Task task = kinematics::task(m);
  const TargetPose from = target_of(m, X);
  TargetPose to = from;
  for (int i = 0; i < task.size(); ++i) {
    const int k = static_cast<int>(task[i]);
    const double by = (i % 2 == 0 ? 1 : -0.7);
    if (k < 3) {
      to.p[k] += size * by;
    } else {
      to.angles[k - 3] += 0.03 * by;
    }
  }
  return *straight(from, to);
}
/// From home; of machines without one from joints in their ranges such that the whole way is well conditioned.
Stretch short_way(const AnyMachine& m, double share = 0.01) {
  if (const auto home = kinematics::home_pose(m)) return way_from(m, *home, share);
  for (const double middle : {0.5, 0.4, 0.45, 0.55, 0.6, 0.35, 0.3, 0.65}) {
    JointVector q(kinematics::joint_count(m));
    for (int i = 0; i < q.size(); ++i) {
      const machine::JointRange r = kinematics::joint_range(m, i);
      q[i] = r.min + (middle + (kinematics::is_serial(m) ? 0.04 : 0.005) * i) * (r.max - r.min);
    }
    const auto poses = kinematics::forward(m, q).poses;
    if (poses.empty()) continue;
    const Stretch out = way_from(m, poses.front(), share);
    bool good = true;
    for (int k = 0; k <= 10 && good; ++k) {
      const Pose X = out.pose(out.size * k / 10);
      const auto found = kinematics::inverse(m, X);
      good = found.reachable() != nullptr && kinematics::dexterity(m, X, found.reachable()->joints).condition < 30;
    }
    if (good) return out;
  }
  throw std::runtime_error("no way was found");
}

std::vector<std::string> catalogue_names() {
  std::vector<std::string> out;
  for (const auto& entry : machine::catalogue()) out.emplace_back(entry.name);
  return out;
}

class EveryMachine : public ::testing::TestWithParam<std::string> {};
const auto named = [](const auto& which) {
  std::string name = which.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
};
INSTANTIATE_TEST_SUITE_P(Catalogue, EveryMachine, ::testing::ValuesIn(catalogue_names()), named);

/// Against differences of eighth order of the inverse along the way: their own error is some 1e-12 / h^k of rounding
/// and h^8.
TEST_P(EveryMachine, DerivativesOfTheDrivesAreThoseOfTheInverse) {
  const AnyMachine m = load(GetParam());
  const Stretch s = short_way(m);
  const double u = 0.4 * s.size, h = 0.05 * s.size;
  const auto first = kinematics::inverse(m, s.pose(u));
  ASSERT_FALSE(first.solutions.empty()) << first.reason;
  JointVector q0 = first.solutions.front().joints;
  const auto joints_at = [&](double at) {
    const auto r = kinematics::inverse_near(m, s.pose(at), q0);
    if (r.solutions.empty()) throw std::runtime_error(r.reason);
    return r.solutions.front().joints;
  };
  q0 = joints_at(u);
  std::vector<JointVector> q;
  for (int k = -4; k <= 4; ++k) q.push_back(joints_at(u + k * h));
  const auto at = [&](int k) -> const JointVector& { return q[static_cast<std::size_t>(k + 4)]; };
  const JointVector d1 =
      (0.8 * (at(1) - at(-1)) - 0.2 * (at(2) - at(-2)) + 4.0 / 105 * (at(3) - at(-3)) - 1.0 / 280 * (at(4) - at(-4))) /
      h;
  const JointVector d2 = (-205.0 / 72 * at(0) + 1.6 * (at(1) + at(-1)) - 0.2 * (at(2) + at(-2)) +
                          8.0 / 315 * (at(3) + at(-3)) - 1.0 / 560 * (at(4) + at(-4))) /
                         (h * h);
  const JointVector d3 = (-61.0 / 30 * (at(1) - at(-1)) + 169.0 / 120 * (at(2) - at(-2)) - 0.3 * (at(3) - at(-3)) +
                          7.0 / 240 * (at(4) - at(-4))) /
                         (h * h * h);
  const PoseSeries target = s.at(Series(u, 1, 0, 0));
  const Pose X = kinematics::settled(m, s.pose(u), q0);
  const JointSeries got = joint_series(m, target, X, q0);
  ASSERT_TRUE(got.regular);
  const double size = d1.norm();
  constexpr double kRounding = 1e-10;  // of positions that a search finds
  EXPECT_LT((got.first - d1).norm(), 1e-7 * size + kRounding / h);
  EXPECT_LT((got.second - d2).norm(), 1e-6 * (size / s.size + d2.norm()) + kRounding / (h * h));
  EXPECT_LT((got.third - d3).norm(), 1e-4 * (size / (s.size * s.size) + d3.norm()) + 10 * kRounding / (h * h * h));
  // And the way without series: differences of exact first derivatives.
  const JointSeries other = joint_series_by_differences(m, target, X, q0);
  EXPECT_LT((got.first - other.first).norm(), 1e-12 * (1 + size));
  EXPECT_LT((got.second - other.second).norm(), 1e-8 * (size / s.size + d2.norm()));
  EXPECT_LT((got.third - other.third).norm(), 1e-7 * (size / (s.size * s.size) + d3.norm()));
}

/// A fork head that tilts its tool through the axis of its other joint: that one is free where the tool is upright and
/// stands still, the tilt goes on. Nothing is infinite there, and the least time is that of the tilting joint.
TEST(SingularPoses, AHeadSwingsItsToolThroughTheAxisOfItsOtherJoint) {
  const AnyMachine m = load("gantry-fork");
  const double tilt = 0.35;
  const TargetPose from = target_of(m, {rotation_abc(tilt, 0, 0), Vec3::Zero()}),
                   to = target_of(m, {rotation_abc(-tilt, 0, 0), Vec3::Zero()});
  const PosePath path = *pose_path_of({*straight(from, to)});
  MoveOptions options;
  options.law = Law::fastest;
  options.condition = 0;
  options.limits = {};
  constexpr double kSpeed = 0.5;
  options.limits.drive_speed = JointVector::Constant(5, kSpeed);
  options.limits.drive_acceleration = JointVector::Constant(5, 1e3);
  options.limits.drive_jerk = JointVector::Constant(5, kNoLimit);
  options.limits.tool_speed = options.limits.tool_acceleration = options.limits.tool_jerk = kNoLimit;
  const auto r = move(m, path, options);
  ASSERT_TRUE(r) << r.error().message;
  EXPECT_TRUE(r->violations.empty());
  EXPECT_NEAR(r->time, 2 * tilt / kSpeed, 0.01);
  for (const MoveSample& s : r->samples) {
    ASSERT_TRUE(s.regular);
    EXPECT_LT(std::abs(s.speed[3]), 1e-6);
    EXPECT_LT(std::abs(s.speed[4]), kSpeed * 1.001);
  }
  // Along any direction with the tool at rest, the rows of its axis that are nothing but rounding are no equations.
  for (const Vec3& to_p : {Vec3(0.1, 0, 0), Vec3(0, 0.1, 0), Vec3(0.03, -0.1, 0.05)}) {
    const TargetPose here = target_of(m, {Mat3::Identity(), Vec3::Zero()}),
                     there = target_of(m, {Mat3::Identity(), to_p});
    const auto along = move(m, *pose_path_of({*straight(here, there)}), options);
    ASSERT_TRUE(along) << along.error().message;
    EXPECT_TRUE(along->violations.empty()) << to_p.transpose() << ": " << along->violations.front().detail;
    EXPECT_NEAR(along->time, to_p.cwiseAbs().maxCoeff() / kSpeed, 0.01);
  }
  // A path that bends there turns the free joint too, at a rate that its first order does not say.
  const auto bent = [&](double second) {
    const Pose X{Mat3::Identity(), Vec3::Zero()};
    const Vector3<Series> w(Series(0, 1, 0, 0), Series(0, 0, second, 0), Series(0.0));
    PoseSeries target = X.cast<Series>();
    target.R = rotation_series(w) * target.R;
    const JointVector q = kinematics::inverse_near(m, X, JointVector::Zero(5)).solutions.front().joints;
    return joint_series(m, target, kinematics::settled(m, X, q), q);
  };
  EXPECT_TRUE(bent(0).regular);
  EXPECT_NEAR(std::abs(bent(0).first[4]), 1, 1e-12);
  EXPECT_FALSE(bent(0.3).regular);
}

/// In the least time: nothing is exceeded at ten thousand instants that are not those of the planner's own check, some
/// limit is met, the drives' derivatives are those of their positions, and it ends where it should.
TEST_P(EveryMachine, TheLeastTimeKeepsAllLimitsAndMeetsSome) {
  const AnyMachine m = load(GetParam());
  const PosePath path = *pose_path_of({short_way(m)});
  const int n = kinematics::joint_count(m);
  for (const double jerk : {1e3, kNoLimit}) {
    MoveOptions options;
    options.law = Law::fastest;
    options.samples = 1237;
    options.singular_distance = 0;
    options.condition = 0;
    options.limits.tool_speed = 0.5;
    options.limits.tool_acceleration = 5;
    options.limits.tool_jerk = jerk;
    options.limits.drive_speed = JointVector::Constant(n, 0.3);
    options.limits.drive_acceleration = JointVector::Constant(n, 4);
    options.limits.drive_jerk = JointVector::Constant(n, jerk);
    const auto r = move(m, path, options);
    ASSERT_TRUE(r) << r.error().message;
    EXPECT_GE(r->checked, 10000);
    ASSERT_GT(r->time, 0);
    double share = 0;
    constexpr double kBetween = 1e-3;  // between the instants that were checked
    for (const MoveSample& s : r->samples) {
      ASSERT_TRUE(s.reached && s.regular);
      EXPECT_LE(s.v.norm(), 0.5 * (1 + kBetween));
      EXPECT_LE(s.a.norm(), 5 * (1 + kBetween));
      EXPECT_LE(s.j.norm(), jerk * (1 + 10 * kBetween));
      EXPECT_LE(s.speed.cwiseAbs().maxCoeff(), 0.3 * (1 + kBetween));
      EXPECT_LE(s.acceleration.cwiseAbs().maxCoeff(), 4 * (1 + kBetween));
      if (std::isfinite(jerk)) {
        EXPECT_LE(s.jerk.cwiseAbs().maxCoeff(), jerk * (1 + 10 * kBetween));
      }
      share += s.share >= 0.98 ? 1.0 : 0.0;
    }
    EXPECT_GT(share / static_cast<double>(r->samples.size()), 0.8);
    EXPECT_LT(r->samples.front().v.norm() + r->samples.back().v.norm(), 1e-6);
    // Trapezoidal sums of the speeds are the ways.
    JointVector way = JointVector::Zero(n);
    for (std::size_t k = 0; k + 1 < r->samples.size(); ++k) {
      const MoveSample &a = r->samples[k], &b = r->samples[k + 1];
      way += 0.5 * (b.t - a.t) * (a.speed + b.speed);
    }
    EXPECT_LT((way - (r->samples.back().q - r->samples.front().q)).norm(), 1e-3 * (1e-3 + way.norm()));
  }
}

/// The least time with limits of jerk is never below that without, nor that below a motion without limits of
/// acceleration.
TEST(Fastest, MoreLimitsTakeMoreTime) {
  const AnyMachine m = load("hexapod-strut");
  const PosePath path = *pose_path_of({short_way(m, 0.05)});
  MoveOptions options;
  options.law = Law::fastest;
  options.limits.drive_speed = JointVector::Constant(6, 0.2);
  double last = 0;
  for (const double factor : {1.0, 0.3, 0.1}) {
    options.limits.drive_acceleration = JointVector::Constant(6, 3 * factor);
    options.limits.drive_jerk = JointVector::Constant(6, kNoLimit);
    const double without = move(m, path, options)->time;
    options.limits.drive_jerk = JointVector::Constant(6, 200);
    const double with = move(m, path, options)->time;
    EXPECT_GT(without, last);
    EXPECT_GT(with, without);
    last = without;
  }
}

/// On a straight line within a speed and an acceleration of the tool: V / A at each end is bound by the acceleration,
/// and the rest by the speed.
TEST(Fastest, SaysWhichLimitBindsForHowLong) {
  const AnyMachine m = load("hexapod-strut");
  const Vec3 p = kinematics::home_pose(m)->p;
  const double L = 0.01, V = 0.1, A = 2;
  const PosePath path = *pose_path_of({*straight({p, Vec3::Zero()}, {p + Vec3(0, 0, L), Vec3::Zero()})});
  MoveOptions options;
  options.law = Law::fastest;
  options.limits.tool_speed = V;
  options.limits.tool_acceleration = A;
  const auto r = move(m, path, options);
  ASSERT_TRUE(r) << r.error().message;
  const double time = L / V + V / A;
  EXPECT_NEAR(r->time, time, 1e-3 * time);
  std::map<std::string, double> share(r->binding.begin(), r->binding.end());
  constexpr double kChanges = 0.02;  // between the nodes of the plan where one limit gives way to the other
  EXPECT_NEAR(share["tool acceleration"], 2 * V / A / time, kChanges);
  EXPECT_NEAR(share["tool speed"], (L / V - V / A) / time, kChanges);
  EXPECT_EQ(share.size(), 2U);
}

PlanNode on_a_line(double s) {
  PlanNode out;
  out.s = s;
  out.tip_1 = Vec3::UnitX();
  return out;
}

/// Rest to rest over L within speed V and acceleration A: the trapezoid; with jerk J the S profile of seven phases.
double trapezoid(double L, double V, double A) {
  return V * V / A < L ? L / V + V / A : 2 * std::sqrt(L / A);
}
double s_profile(double L, double V, double A, double J) {
  const auto ramp = [&](double v) { return v * J < A * A ? 2 * std::sqrt(v / J) : v / A + A / J; };
  if (V * ramp(V) <= L) return 2 * ramp(V) + (L - V * ramp(V)) / V;
  double low = 0, high = V;
  for (int k = 0; k < 100; ++k) {
    const double middle = 0.5 * (low + high);
    (middle * ramp(middle) < L ? low : high) = middle;
  }
  return 2 * ramp(low);
}

TEST(TimeLaw, OneAxisHasItsClosedForms) {
  for (const auto& [L, V, A, J] : {std::array{1.0, 0.5, 2.0, 20.0}, std::array{1.0, 5.0, 2.0, 20.0},
                                   std::array{0.01, 5.0, 2.0, 20.0}, std::array{1.0, 100.0, 100.0, 20.0}}) {
    PlanLimits limits;
    limits.tool_speed = V;
    limits.tool_acceleration = A;
    std::vector<PlanNode> nodes;
    for (int k = 0; k <= 400; ++k) nodes.push_back(on_a_line(L * k / 400));
    TimeLaw plain;
    plain.add(*fastest(nodes, limits));
    EXPECT_NEAR(plain.duration() / trapezoid(L, V, A), 1, 1e-3);
    EXPECT_GE(plain.duration(), trapezoid(L, V, A) * (1 - 1e-9));
    limits.tool_jerk = J;
    TimeLaw law;
    law.add(*fastest_within_jerk([](double s, std::size_t) { return on_a_line(s); }, 0, L, {}, 400, limits));
    // The gap of the interior-point method is 2e-4, that of 400 intervals a little more.
    EXPECT_NEAR(law.duration() / s_profile(L, V, A, J), 1, 1e-3);
    EXPECT_NEAR(law.at(law.duration()).value(), L, 1e-12);
    double v = 0, a = 0, j = 0;
    for (int k = 0; k <= 10000; ++k) {
      const polypod::Series s = law.at(law.duration() * k / 10000);
      v = std::max(v, std::abs(s.derivative(1)));
      a = std::max(a, std::abs(s.derivative(2)));
      j = std::max(j, std::abs(s.derivative(3)));
    }
    EXPECT_LT(v, V * 1.002);
    EXPECT_LT(a, A * 1.01);
    EXPECT_LT(j, J * 1.01);
    EXPECT_NEAR(law.time_of(law.at(0.3 * law.duration()).value()), 0.3 * law.duration(), 1e-9);
    const double before = law.duration();
    law.stretch(0, 1.5);
    EXPECT_NEAR(law.duration(), 1.5 * before, 1e-12);
    EXPECT_NEAR(law.at(law.duration()).value(), L, 1e-12);
  }
}

/// Largest speed, acceleration and jerk of s at 10 000 instants.
std::array<double, 3> peaks_of(const TimeLaw& law) {
  std::array<double, 3> out{};
  for (int k = 0; k <= 10000; ++k) {
    const polypod::Series s = law.at(law.duration() * k / 10000);
    for (int i = 0; i < 3; ++i) {
      out[static_cast<std::size_t>(i)] = std::max(out[static_cast<std::size_t>(i)], std::abs(s.derivative(i + 1)));
    }
  }
  return out;
}

TEST(TimeLaw, TheSProfileIsItsClosedForm) {
  // Seven phases, no constant speed, no constant acceleration, neither.
  for (const auto& [L, V, A, J] :
       {std::array{1.0, 0.5, 2.0, 20.0}, std::array{1.0, 5.0, 2.0, 20.0}, std::array{1.0, 0.5, 200.0, 20.0},
        std::array{1.0, 100.0, 100.0, 20.0}, std::array{1.0, kNoLimit, kNoLimit, 20.0}}) {
    TimeLaw law;
    law.add(motion::s_profile(0.3, L, V, A, J));
    if (std::isfinite(V)) {
      EXPECT_NEAR(law.duration() / s_profile(L, V, A, J), 1, 1e-12);
    }
    EXPECT_NEAR(law.at(law.duration()).value(), 0.3 + L, 1e-12);
    const auto [v, a, j] = peaks_of(law);
    EXPECT_LT(v, V * (1 + 1e-9));
    EXPECT_LT(a, A * (1 + 1e-9));
    EXPECT_NEAR(j, J, 1e-9);
    EXPECT_NEAR(law.at(law.duration()).derivative(1), 0, 1e-12);
    EXPECT_NEAR(law.at(law.duration()).derivative(2), 0, 1e-9);
    // Symmetric in time.
    for (const double share : {0.1, 0.3, 0.45}) {
      EXPECT_NEAR(law.at(share * law.duration()).value() - 0.3, 0.3 + L - law.at((1 - share) * law.duration()).value(),
                  1e-12);
    }
  }
}

/// A drive that goes along s + s^2 b / 2: on a short way the profile is nearly the least time, and keeps its limits; on
/// a long way there is none.
TEST(TimeLaw, TheSProfileIsTakenWhereNoLawIsMuchFaster) {
  PlanLimits limits;
  limits.drive_speed = JointVector::Constant(1, 0.5);
  limits.drive_acceleration = JointVector::Constant(1, 2);
  limits.drive_jerk = JointVector::Constant(1, 20);
  constexpr double kBend = 2;
  const auto node = [&](double s, std::size_t = 0) {
    PlanNode out;
    out.s = s;
    out.drive_1 = JointVector::Constant(1, 1 + kBend * s);
    out.drive_2 = JointVector::Constant(1, kBend);
    out.drive_3 = JointVector::Zero(1);
    return out;
  };
  for (const double L : {1e-5, 1e-3, 0.5}) {
    std::vector<PlanNode> nodes;
    for (int k = 0; k <= 8; ++k) nodes.push_back(node(L * k / 8));
    constexpr double kGap = 5e-3;
    const auto profile = nearly_fastest_s_profile(nodes, limits, kGap);
    ASSERT_EQ(profile.has_value(), L < 0.1) << L;
    if (!profile) continue;
    TimeLaw law, best;
    law.add(*profile);
    best.add(*fastest_within_jerk(node, 0, L, {}, 400, limits));
    EXPECT_LT(law.duration(), best.duration() * (1 + kGap));
    EXPECT_GT(law.duration(), best.duration() * (1 - 1e-3));  // the gap of the other
    for (int k = 0; k <= 10000; ++k) {
      const polypod::Series s = law.at(law.duration() * k / 10000);
      const polypod::Series q = s + polypod::Series(kBend / 2) * s * s;
      EXPECT_LE(std::abs(q.derivative(1)), 0.5);
      EXPECT_LE(std::abs(q.derivative(2)), 2.0);
      EXPECT_LE(std::abs(q.derivative(3)), 20.0);
    }
  }
}

/// Where the limit of the speed changes on the way, the whole way must not be as slow as its slowest part.
TEST(TimeLaw, NoSProfileWhereTheSpeedChanges) {
  PlanLimits limits;
  limits.tool_speed = 0.1;
  limits.tool_acceleration = 10;
  limits.tool_jerk = 1000;
  std::vector<PlanNode> nodes;
  for (int k = 0; k <= 8; ++k) {
    nodes.push_back(on_a_line(0.001 * k));
    if (k > 4) nodes.back().speed = 0.001;
  }
  EXPECT_FALSE(nearly_fastest_s_profile(nodes, limits, 1e-3));
  for (PlanNode& n : nodes) n.speed = 0.001;
  EXPECT_TRUE(nearly_fastest_s_profile(nodes, limits, 1e-3));
  const AnyMachine m = load("hexapod-strut");
  const Vec3 p = kinematics::home_pose(m)->p, middle = p - Vec3(0, 0, 0.004), end = p - Vec3(0, 0, 0.007);
  std::vector<Stretch> lines{*straight({p, Vec3::Zero()}, {middle, Vec3::Zero()}),
                             *straight({middle, Vec3::Zero()}, {end, Vec3::Zero()})};
  lines[0].speed = 0.1;
  lines[1].speed = 0.001;
  MoveOptions options;
  options.law = Law::fastest;
  options.limits = limits;
  const double through = move(m, *pose_path_of(lines), options)->time;
  lines[0].stop = true;
  constexpr double kGrid = 1.01;  // the finite steps of the plan without a stop
  EXPECT_LT(through, kGrid * move(m, *pose_path_of(lines), options)->time);
}

TEST(TimeLaw, RestsStayWhereABlockIsSlowedDown) {
  TimeLaw law;
  TimeLaw::Block block = smooth_block(1, 2, 0.5);
  block.rest(0.25, 3);
  law.add(block);
  law.stretch(0, 2);
  EXPECT_DOUBLE_EQ(law.duration(), 0.25 + 1 + 3);
  EXPECT_DOUBLE_EQ(law.block(0).moving(), 1);
  for (const double t : {0.0, 0.2, 1.25, 2.0, 4.25}) {
    EXPECT_DOUBLE_EQ(law.at(t).value(), t < 1 ? 1 : 3);
    EXPECT_NEAR(law.at(t).derivative(1), 0, 1e-12);
  }
  EXPECT_NEAR(law.at(0.75).value(), 2, 1e-12);
}

TEST(TimeLaw, ACircleWithinAnAcceleration) {
  // Round and round on a circle of radius r the speed is sqrt(a r): so long that ramps do not count.
  const double r = 0.05, A = 2, L = 40 * 2 * std::numbers::pi * r;
  PlanLimits limits;
  limits.tool_acceleration = A;
  std::vector<PlanNode> nodes;
  for (int k = 0; k <= 4000; ++k) {
    PlanNode n;
    n.s = L * k / 4000;
    const double c = std::cos(n.s / r), s = std::sin(n.s / r);
    n.tip_1 = Vec3(-s, c, 0);
    n.tip_2 = Vec3(-c, -s, 0) / r;
    nodes.push_back(n);
  }
  TimeLaw law;
  law.add(*fastest(nodes, limits));
  EXPECT_NEAR(law.at(0.5 * law.duration()).derivative(1), std::sqrt(A * r), 1e-3);
  EXPECT_NEAR(law.duration(), L / std::sqrt(A * r), 0.01 * law.duration());
  EXPECT_GT(law.duration(), L / std::sqrt(A * r));
}

/// A strut's length l = |p + b - a| of a tip that moves with p: l' = y.v / l, l'' = (v.v + y.a - l'^2) / l,
/// l''' = (3 v.a + y.j - 3 l' l'') / l.
TEST(Move, ACircleAtConstantSpeedOnStruts) {
  const AnyMachine any = load("hexapod-strut");
  const auto& m = std::get<machine::StrutHexapod>(any);
  const Pose home = *kinematics::home_pose(any);
  const double r = 0.006, speed = 0.05;
  TargetPose from{home.p + Vec3(r, 0, 0), Vec3::Zero()}, to{home.p + Vec3(0, -r, 0), Vec3::Zero()};
  const PosePath path = *pose_path_of({*curved(from, home.p + Vec3(-r, 0, 0), to)});
  MoveOptions options;
  options.speed = speed;
  options.samples = 101;
  const auto result = move(any, path, options);
  ASSERT_TRUE(result);
  EXPECT_TRUE(result->ok());
  EXPECT_NEAR(result->time, 1.5 * std::numbers::pi * r / speed, 1e-12);
  const double w = speed / r;
  for (const MoveSample& s : result->samples) {
    const double c = std::cos(w * s.t), n = std::sin(w * s.t);
    const Vec3 p = home.p + r * Vec3(c, n, 0), v = speed * Vec3(-n, c, 0), a = -speed * w * Vec3(c, n, 0),
               j = speed * w * w * Vec3(n, -c, 0);
    EXPECT_LT((s.X.p - p).norm(), 1e-12);
    EXPECT_LT((s.a - a).norm(), 1e-10);
    EXPECT_LT((s.j - j).norm(), 1e-8);
    for (int i = 0; i < 6; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const Vec3 y = p + m.platform_joint[k] - Vec3(0, 0, m.tool_length) - m.base_joint[k];
      const double l = y.norm(), l1 = y.dot(v) / l, l2 = (v.dot(v) + y.dot(a) - l1 * l1) / l,
                   l3 = (3 * v.dot(a) + y.dot(j) - 3 * l1 * l2) / l;
      EXPECT_NEAR(s.q[i] + 0, l, 1e-12);
      EXPECT_NEAR(s.speed[i], l1, 1e-12);
      EXPECT_NEAR(s.acceleration[i], l2, 1e-10);
      EXPECT_NEAR(s.jerk[i], l3, 1e-8);
    }
  }
}

/// The closed forms of deltas, which know nothing of the closure's series.
TEST(Move, TheSampleMoveOfTheSourceAsTheFormulasOfDeltasHaveIt) {
  for (const char* name : {"delta-brno", "delta-linear", "delta-picker"}) {
    const AnyMachine any = load(name);
    const Vec3 middle = std::visit([](const auto& m) { return kinematics::middle_of_work(AnyMachine(m)); }, any);
    const bool brno = std::string(name) == "delta-brno";
    const Vec3 from = brno ? Vec3(0.2, -0.2, 0.45) : Vec3(middle + Vec3(0.02, -0.02, 0)),
               to = brno ? Vec3(-0.2, 0.2, 0.55) : Vec3(middle + Vec3(-0.02, 0.02, 0.01));
    MoveOptions options;
    options.speed = 0.5;
    options.samples = 57;
    const auto got = move(any, *pose_path_of({*straight({from, Vec3::Zero()}, {to, Vec3::Zero()})}), options);
    ASSERT_TRUE(got) << got.error().message;
    const Path path = *path_through({from, to});
    const auto peaks = run(any, path, 0.5);
    ASSERT_TRUE(peaks);
    EXPECT_NEAR(got->length, peaks->length, 1e-12);
    EXPECT_NEAR(got->time, peaks->time, 1e-12);
    if (brno) {
      EXPECT_NEAR(got->length, 0.5745, 5e-5);
    }
    for (const MoveSample& s : got->samples) {
      Motion tool = path.at(0.5 * s.t);
      tool.v *= 0.5;
      const Sample want = std::visit(
          [&](const auto& m) -> Sample {
            if constexpr (requires { drives_of(m, s.t, tool); }) return drives_of(m, s.t, tool);
            return {};
          },
          any);
      for (int i = 0; i < static_cast<int>(got->drives.size()); ++i) {
        EXPECT_NEAR(s.q[i], want.drive[i].q, 1e-10);
        EXPECT_NEAR(s.speed[i], want.drive[i].speed, 1e-9 * (1 + std::abs(want.drive[i].speed)));
        EXPECT_NEAR(s.acceleration[i], want.drive[i].acceleration, 1e-8 * (1 + std::abs(want.drive[i].acceleration)));
        EXPECT_NEAR(s.jerk[i], want.drive[i].jerk, 1e-7 * (1 + std::abs(want.drive[i].jerk)));
      }
    }
  }
}

TEST(Move, GivenTimesAreKept) {
  const AnyMachine m = load("hexapod-strut");
  const Vec3 p = kinematics::home_pose(m)->p;
  std::vector<Stretch> stretches{
      *straight({p, Vec3::Zero()}, {p + Vec3(0.005, 0, 0), Vec3(0.05, 0, 0)}),
      *straight({p + Vec3(0.005, 0, 0), Vec3(0.05, 0, 0)}, {p + Vec3(0.005, 0, 0), Vec3(0, 0, 0.1)})};
  stretches[0].duration = 2;
  stretches[1].duration = 0.5;
  const PosePath path = *pose_path_of(stretches);
  MoveOptions options;
  options.law = Law::timed;
  options.samples = 6;  // every half second
  auto r = move(m, path, options);
  ASSERT_TRUE(r);
  EXPECT_DOUBLE_EQ(r->time, 2.5);
  EXPECT_NEAR(r->length, 0.005, 1e-15);
  EXPECT_LT((r->samples[1].X.p - p - Vec3(0.00125, 0, 0)).norm(), 1e-12);
  EXPECT_LT((r->samples[2].X.R - rotation_abc(0.025, 0, 0)).norm(), 1e-12);
  EXPECT_NEAR(r->samples[1].v.x(), 0.0025, 1e-12);
  EXPECT_NEAR(r->samples[1].turn.x(), 0.025, 1e-12);
  ASSERT_EQ(r->violations.size(), 1U);  // the speed jumps where the first stretch ends
  EXPECT_EQ(r->violations[0].kind, "corner");
  EXPECT_NEAR(r->violations[0].t, 2, 1e-9);
  options.profile = Profile::smooth;
  r = move(m, path, options);
  ASSERT_TRUE(r);
  EXPECT_TRUE(r->ok());
  EXPECT_NEAR(r->tool_speed, 15.0 / 8 * 0.005 / 2, 1e-8);  // of 10 x^3 - 15 x^4 + 6 x^5 in the middle
  options.limits.tool_speed = 0.004;
  r = move(m, path, options);
  ASSERT_EQ(r->violations.size(), 1U);
  EXPECT_EQ(r->violations[0].limit, "tool speed");
  // 15/8 (1 - x^2)^2, x from -1 to 1 over the stretch, passes 0.004 / 0.0025 at x = -sqrt(1 - sqrt(1.6 / 1.875)).
  const double x = std::sqrt(1 - std::sqrt(0.004 / 0.0025 / 1.875));
  EXPECT_NEAR(r->violations[0].t, 1 - x, 2.5 / 10000 * 2);
}

/// Waits of a file: the tool stands still, and a linear profile jumps there.
TEST(Move, WaitsAreKept) {
  const AnyMachine m = load("delta-linear");
  const auto read = read_pose_path(written("waits.csv",
                                           "time_s,x_mm,y_mm,z_mm\n0,0,0,450\n0.5,0,0,450\n1.5,10,0,450\n"
                                           "3.5,10,0,450\n4,10,0,450\n5,20,0,450\n6,20,0,450\n"));
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->path.stretches.size(), 2U);
  EXPECT_DOUBLE_EQ(read->path.stretches[0].wait_before, 0.5);
  EXPECT_DOUBLE_EQ(read->path.stretches[0].wait, 2.5);
  EXPECT_DOUBLE_EQ(read->path.stretches[1].wait, 1);
  MoveOptions options;
  options.law = Law::timed;
  options.samples = 13;  // every half second
  const auto places = [&](const MoveResult& r) {
    std::vector<double> out;
    for (const MoveSample& s : r.samples) out.push_back(std::round(1e6 * s.X.p.x()) / 1e3);  // mm
    return out;
  };
  auto r = move(m, read->path, options);
  ASSERT_TRUE(r);
  EXPECT_TRUE(r->ok());
  EXPECT_DOUBLE_EQ(r->time, 6);
  EXPECT_EQ(places(*r), (std::vector<double>{0, 0, 5, 10, 10, 10, 10, 10, 10, 15, 20, 20, 20}));
  EXPECT_EQ(r->jumps.count, 4U);
  EXPECT_NEAR(r->jumps.speed, 0.01, 1e-9);
  options.limits.tool_acceleration = 100;
  EXPECT_EQ(move(m, read->path, options)->violations.size(), 1U);
  for (const Profile profile : {Profile::smooth, Profile::spline}) {
    options.profile = profile;
    const PosePath path = profile == Profile::spline ? *splined(read->path) : read->path;
    r = move(m, path, options);
    ASSERT_TRUE(r);
    EXPECT_TRUE(r->ok());
    EXPECT_EQ(places(*r), (std::vector<double>{0, 0, 5, 10, 10, 10, 10, 10, 10, 15, 20, 20, 20}));
    EXPECT_NEAR(r->tool_speed, 15.0 / 8 * 0.01, 1e-7);
  }
  options = {};
  options.law = Law::fastest;
  options.limits.tool_speed = 0.05;
  options.limits.tool_acceleration = 1;
  options.limits.tool_jerk = 50;
  PosePath without = read->path;
  for (Stretch& s : without.stretches) s.wait = s.wait_before = 0;
  EXPECT_EQ(move(m, without, options)->stops, 0U);  // one straight way
  without.stretches[0].stop = true;
  EXPECT_NEAR(move(m, read->path, options)->time, move(m, without, options)->time + 4, 1e-9);
}

/// A blend's parameter is no length, and the speed of the tip is constant all the same. Where the tool waits no corner
/// is blended.
TEST(Move, BlendsArePassedAtConstantSpeed) {
  const AnyMachine m = load("delta-linear");
  const Vec3 a(0, 0, 0.45), b(0.02, 0, 0.45), c(0.02, 0.03, 0.46);
  std::vector<Stretch> lines{*straight({a, Vec3::Zero()}, {b, Vec3::Zero()}),
                             *straight({b, Vec3::Zero()}, {c, Vec3::Zero()})};
  const PosePath path = blended(*pose_path_of(lines), 1e-3, true);
  ASSERT_EQ(path.stretches.size(), 3U);
  MoveOptions options;
  options.speed = 0.05;
  options.samples = 2001;
  const auto moved = move(m, path, options);
  ASSERT_TRUE(moved);
  EXPECT_TRUE(moved->ok());
  for (const MoveSample& s : moved->samples) EXPECT_NEAR(s.v.norm(), 0.05, 1e-6 * 0.05);
  double way = 0;  // of chords of 25 um, each shorter than its arc by some 1e-6 of it
  for (std::size_t k = 1; k < moved->samples.size(); ++k)
    way += (moved->samples[k].X.p - moved->samples[k - 1].X.p).norm();
  EXPECT_NEAR(moved->time, way / 0.05, 1e-5 * moved->time);
  EXPECT_NEAR(moved->length, way, 1e-3 * way);
  lines[0].wait = 1;
  EXPECT_EQ(blended(*pose_path_of(lines), 1e-3, true).stretches.size(), 2U);
  // All segments have their speed: no other is needed.
  lines[0].speed = lines[1].speed = 0.04;
  options.speed = 0;
  EXPECT_TRUE(move(m, *pose_path_of(lines), options));
}

/// What holds the weight before the motion begins is a force, too.
TEST(Move, ForcesAreJudgedInWaits) {
  const AnyMachine m = load("hexapod-strut");
  const Vec3 p = kinematics::home_pose(m)->p;
  std::vector<Stretch> lines{*straight({p, Vec3::Zero()}, {p - Vec3(0, 0, 0.004), Vec3::Zero()})};
  lines[0].duration = 1;
  MoveOptions options;
  options.law = Law::timed;
  options.profile = Profile::linear;
  options.dynamics = Dynamics{};
  options.dynamics->platform = Body{2, Vec3::Zero(), Mat3::Zero()};
  options.dynamics->viscous = {100};  // helps on the way down
  const double moving = *move(m, *pose_path_of(lines), options)->drives[0].force;
  lines[0].wait_before = 1;
  const double waiting = *move(m, *pose_path_of(lines), options)->drives[0].force;
  EXPECT_GT(waiting, 1.02 * moving);
  options.force = JointVector::Constant(6, 0.5 * (waiting + moving));
  const auto judged = move(m, *pose_path_of(lines), options);
  ASSERT_FALSE(judged->ok());
  EXPECT_DOUBLE_EQ(judged->violations[0].t, 0);
}

/// Commands at all times of drives without steps leave nothing, jumps of the speed or not.
TEST(Move, NoResolutionLeavesNoError) {
  const AnyMachine m = load("hexapod-strut");
  const Vec3 p = kinematics::home_pose(m)->p;
  const PosePath path =
      *pose_path_of({*straight({p, Vec3::Zero()}, {p + Vec3(0.005, 0, 0), Vec3::Zero()}),
                     *straight({p + Vec3(0.005, 0, 0), Vec3::Zero()}, {p + Vec3(0.005, 0.005, 0), Vec3::Zero()})});
  MoveOptions options;
  options.speed = 0.0047;
  options.actuators = Actuators{JointVector::Zero(6), 5e-3, JointVector::Zero(6), false};
  const auto moved = move(m, path, options);
  ASSERT_TRUE(moved && moved->contour);
  EXPECT_LT(moved->contour->coarse.largest_lag, 1e-9);
  EXPECT_GT(moved->contour->compensated.largest_lag, 1e-6);  // the corner lies between two commands
}

/// A polynomial of fifth degree is its own spline; others go on with four derivatives at the points.
TEST(PosePath, SplinesGoThroughTheirPoints) {
  std::vector<Stretch> lines;
  const auto at = [](double t) {
    return TargetPose{
        Vec3(0.002 * std::sin(3 * t), 0.004 * t * t * t * (10 + t * (-15 + 6 * t)), 0.07 + 0.002 * std::cos(2 * t)),
        Vec3(0, 0, 0.1 * t * t)};
  };
  const std::vector<double> times{0, 0.1, 0.25, 0.3, 0.5, 0.7, 0.85, 1};
  for (std::size_t k = 0; k + 1 < times.size(); ++k) {
    lines.push_back(*straight(at(times[k]), at(times[k + 1])));
    lines.back().duration = times[k + 1] - times[k];
  }
  const auto path = splined(*pose_path_of(lines));
  ASSERT_TRUE(path);
  const auto& all = path->stretches;
  /// Derivative `order` by time of row i.
  const auto derivative = [&](std::size_t k, int i, double t, int order) {
    const double rate = all[k].size / all[k].duration;
    double out = 0;
    for (int n = order; n < 6; ++n) {
      double c = all[k].polynomial(i, n) * std::pow(rate, n);
      for (int j = 0; j < order; ++j) c *= n - j;
      out += c * std::pow(t, n - order);
    }
    return out;
  };
  for (std::size_t k = 0; k < all.size(); ++k) {
    EXPECT_LT((all[k].pose(0).p - at(times[k]).p).norm(), 1e-12);
    EXPECT_LT((all[k].pose(all[k].size).p - at(times[k + 1]).p).norm(), 1e-12);
    // y is from rest to rest with fifth degree in t: the spline has no other choice.
    const double middle = 0.5 * (times[k] + times[k + 1]);
    EXPECT_NEAR(all[k].pose(0.5 * all[k].size).p.y(), at(middle).p.y(), 1e-12);
    if (k + 1 == all.size()) break;
    EXPECT_TRUE(path->junction(k).smooth);
    for (const int i : {0, 1, 2, 5}) {
      for (int order = 0; order <= 4; ++order) {
        const double before = derivative(k, i, all[k].duration, order), behind = derivative(k + 1, i, 0, order);
        EXPECT_NEAR(before, behind, 1e-9 * (1 + std::abs(before))) << k << " " << i << " " << order;
      }
    }
  }
  for (int order = 1; order <= 2; ++order) {
    EXPECT_NEAR(derivative(0, 0, 0, order), 0, 1e-12);
    EXPECT_NEAR(derivative(all.size() - 1, 0, all.back().duration, order), 0, 1e-9);
  }
  const AnyMachine m = load("hexapod-strut");
  MoveOptions options;
  options.law = Law::timed;
  options.profile = Profile::spline;
  options.limits.tool_jerk = 100;
  const auto moved = move(m, *path, options);
  ASSERT_TRUE(moved);
  EXPECT_TRUE(moved->ok()) << moved->violations.front().detail;
  EXPECT_EQ(moved->jumps.count, 0U);
  // The word alone makes no spline: corners of lines stay corners.
  const auto lines_alone = move(m, *pose_path_of(lines), options);
  ASSERT_TRUE(lines_alone);
  EXPECT_FALSE(lines_alone->ok());
  // The departure from the chords, against 1000 places on each.
  ChordError dense;
  for (const Stretch& s : all) {
    const Vec3 way = (s.to - s.from).normalized();
    for (int k = 0; k <= 1000; ++k) {
      const Vec3 off = s.pose(s.size * k / 1000).p - s.from;
      dense.length = std::max(dense.length, (off - off.dot(way) * way).norm());
    }
  }
  EXPECT_NEAR(farthest_from_chords(*path).length, dense.length, 1e-5 * dense.length);
  EXPECT_GT(farthest_from_chords(*path).angle, 0);
  EXPECT_EQ(splined(*pose_path_of({*curved(at(0), Vec3(0.004, 0.001, 0.07), at(1))})).error().id, "MO112");
}

/// Steps that are ten times finer change nothing that counts.
TEST_P(EveryMachine, FinerStepsPlanTheSame) {
  const AnyMachine m = load(GetParam());
  for (const double share : {0.001, 0.01}) {
    const PosePath path = *pose_path_of({short_way(m, share)});
    MoveOptions options;
    options.law = Law::fastest;
    const int n = kinematics::joint_count(m);
    options.limits.drive_speed = JointVector::Constant(n, 0.3);
    options.limits.drive_acceleration = JointVector::Constant(n, 3);
    options.limits.drive_jerk = JointVector::Constant(n, 100);
    options.limits.turn_speed = 0.5;
    const auto coarse = move(m, path, options);
    options.step /= 10;
    options.turn_step /= 10;
    const auto fine = move(m, path, options);
    ASSERT_TRUE(coarse && fine);
    EXPECT_LE(coarse->turn_speed, 0.5 * (1 + 1e-9));
    constexpr double kOfTheTime = 5e-3;  // the gap of the S profile, and that of its finer nodes
    EXPECT_NEAR(coarse->time / fine->time, 1, kOfTheTime) << share;
  }
}

// Between two points in one line the rate jumps: no acceleration allows that, though none is seen within a stretch.
TEST(Move, ASpeedThatJumpsBreaksEveryLimitOfAcceleration) {
  const AnyMachine m = load("delta-brno");
  const auto at = [](double x) { return TargetPose{Vec3(x, 0, 0.55), Vec3::Zero()}; };
  std::vector<Stretch> stretches{*straight(at(0), at(0.05)), *straight(at(0.05), at(0.1))};
  stretches[0].duration = 1;
  stretches[1].duration = 0.1;
  const PosePath path = *pose_path_of(stretches);
  MoveOptions options;
  options.law = Law::timed;
  auto r = move(m, path, options);
  ASSERT_TRUE(r);
  EXPECT_TRUE(r->ok());  // no acceleration is limited, and the result says that it jumps
  EXPECT_EQ(r->jumps.count, 1U);
  EXPECT_NEAR(r->jumps.speed, 0.45, 1e-12);
  EXPECT_TRUE(r->moves_at_once);
  options.limits.tool_acceleration = 1e6;
  options.limits.drive_acceleration = machine::JointVector::Constant(3, 1e9);
  r = move(m, path, options);
  ASSERT_TRUE(r);
  std::vector<std::string> broken;
  for (const MoveViolation& v : r->violations) {
    broken.push_back(v.limit);
    EXPECT_NEAR(v.t, 1, 1e-9);
    EXPECT_NEAR(v.length, 0.05, 1e-12);
  }
  EXPECT_EQ(broken, (std::vector<std::string>{"tool acceleration", "drive 1 acceleration", "drive 2 acceleration",
                                              "drive 3 acceleration"}));
  // At one speed nothing jumps; where the path is at rest at its points neither.
  options.law = Law::constant;
  options.speed = 0.1;
  r = move(m, path, options);
  EXPECT_TRUE(r->ok());
  EXPECT_EQ(r->jumps.count, 0U);
  options.law = Law::timed;
  options.profile = Profile::smooth;
  r = move(m, path, options);
  EXPECT_TRUE(r->ok());
  EXPECT_FALSE(r->moves_at_once);
}

// A line that runs into an arc: the acceleration jumps by v^2 / r.
TEST(Move, AnAccelerationThatJumpsBreaksEveryLimitOfJerk) {
  const AnyMachine m = load("delta-brno");
  const double r = 0.03;
  const TargetPose a{Vec3(-0.05, 0, 0.55), Vec3::Zero()}, b{Vec3(0, 0, 0.55), Vec3::Zero()},
      c{Vec3(r, r, 0.55), Vec3::Zero()};
  const Vec3 via(r * std::sin(0.5), r * (1 - std::cos(0.5)), 0.55);
  MoveOptions options;
  options.speed = 0.2;
  options.limits.tool_acceleration = 2;  // v^2 / r = 1.333
  const PosePath path = *pose_path_of({*straight(a, b), *curved(b, via, c)});
  EXPECT_TRUE(move(m, path, options)->ok());
  options.limits.tool_jerk = 1e6;
  const auto found = move(m, path, options);
  ASSERT_TRUE(found);
  ASSERT_EQ(found->violations.size(), 1U);
  EXPECT_EQ(found->violations[0].limit, "tool jerk");
  EXPECT_NE(found->violations[0].detail.find("jumps by 1333 mm/s2"), std::string::npos) << found->violations[0].detail;
  EXPECT_NEAR(found->violations[0].t, 0.25, 1e-9);
}

// A profile of given times does not hold where the path is passed at one speed.
TEST(Move, CornersAtConstantSpeedAreFoundWhateverTheProfileOfTheFile) {
  const AnyMachine m = load("delta-brno");
  const auto at = [](double x) { return TargetPose{Vec3(x, 0, 0.55), Vec3::Zero()}; };
  MoveOptions options;
  options.speed = 0.1;
  options.profile = Profile::smooth;
  const auto r = move(m, *pose_path_of({*straight(at(0), at(0.05)), *straight(at(0.05), at(0))}), options);
  ASSERT_TRUE(r);
  ASSERT_EQ(r->violations.size(), 1U);
  EXPECT_EQ(r->violations[0].kind, "corner");
}

// A straight wrist at the start of the path, where axes 4 and 6 are one: no speeds of the drives give the motion.
TEST(Move, ASingularPoseIsNamedEvenWhereClosenessIsNotJudged) {
  const AnyMachine m = load("kuka-kr210");
  JointVector q(6);
  q << 0, -1.4, 1.75, 0, 0, 0;
  const TargetPose from = target_of(m, kinematics::forward(m, q).poses.front());
  TargetPose to = from;
  to.p.y() += 0.05;
  MoveOptions options;
  options.condition = 0;
  options.speed = 0.1;
  options.start = 0;
  const auto r = move(m, *pose_path_of({*straight(from, to)}), options);
  ASSERT_TRUE(r);
  const auto found = std::count_if(r->violations.begin(), r->violations.end(),
                                   [](const MoveViolation& v) { return v.kind == "singular" && v.t == 0; });
  EXPECT_EQ(found, 1);
}

// A wrist that is passed at the distance d from its singular pose keeps its posture: drive 4 turns by nearly half a
// turn, as the triangle of the tool axis with joint 4 says, however near it is, and the condition number is that there.
TEST(Move, ANearlySingularWristIsPassedInItsPosture) {
  const AnyMachine m = load("puma560");
  constexpr double kAside = 0.1;  // rad, to both sides
  for (const double d : {1e-2, 1e-3, 1e-4, 1e-5}) {
    JointVector q(6);
    q << 0.2, 0.7, -1.0, 0, d, 0;
    const Pose middle = kinematics::forward(m, q).poses.front();
    Vec3 across = middle.R.col(2);  // about which the tool axis turns past joint 4: in the plane of both
    q[4] = -1.5;
    across = kinematics::forward(m, q).poses.front().R.col(2).cross(across).cross(across).normalized();
    const auto target = [&](double turn) {
      return TargetPose{middle.p, angles_abc(Eigen::AngleAxisd(turn, across).toRotationMatrix() * middle.R)};
    };
    const PosePath path = *pose_path_of({*straight(target(-kAside), target(kAside), Turning::turn)});
    MoveOptions options;
    options.law = Law::fastest;
    options.limits.turn_speed = 1;
    const auto starts = kinematics::inverse(m, path.stretches.front().pose(0)).solutions;
    double sharpest = 0;
    for (std::size_t start = 0; start < starts.size(); ++start) {
      if (std::abs(starts[start].joints[1] - q[1]) > 1e-6) continue;  // the arm's other postures
      options.start = start;
      const auto r = move(m, path, options);
      ASSERT_TRUE(r);
      const MoveDrive& drive = r->drives[3];
      EXPECT_NEAR(drive.high - drive.low, 2 * std::atan2(std::tan(kAside), std::sin(d)), 1e-3) << d << ' ' << start;
      for (const MoveViolation& v : r->violations) EXPECT_NE(v.kind, "branch") << d << ' ' << start << ": " << v.detail;
      const bool said = std::any_of(r->violations.begin(), r->violations.end(),
                                    [](const MoveViolation& v) { return v.kind == "singular"; });
      EXPECT_EQ(said, r->worst_condition > options.condition) << d << ' ' << start;
      sharpest = std::max(sharpest, r->worst_condition);
    }
    double there = 0;
    for (int k = -5000; k <= 5000; ++k) {
      const double turn = 1e-3 * k * d;
      q[3] = std::atan2(std::tan(turn), std::sin(d));
      q[4] = std::acos(std::cos(d) * std::cos(turn));
      there = std::max(there, kinematics::dexterity(m, middle, q).condition);
    }
    EXPECT_NEAR(sharpest / there, 1, 1e-3) << d;
  }
}

// Past a nearly singular wrist joint 4 turns by half a turn, which takes its time, but hardly more the nearer it is;
// and a limit less takes no more time. Bounds: half a turn at the speed limit, and plans of twice as many nodes (within
// 3 %).
TEST(Move, TheLeastTimePastANearlySingularWrist) {
  const AnyMachine m = load("kuka-kr210");
  const auto path_at = [](double aside) {
    const Vec3 p(1.7, aside, 1.676);
    const double half = std::numbers::pi;
    return *pose_path_of({*straight({p, Vec3(0, half / 3, half)}, {p, Vec3(0, 2 * half / 3, half)})});
  };
  double farther = 0;
  for (const double aside : {1e-3, 1e-5, 1e-6}) {
    MoveOptions options;
    options.law = Law::fastest;
    options.condition = 0;
    options.limits.drive_speed = JointVector::Constant(6, 12);
    options.limits.drive_acceleration = JointVector::Constant(6, 250);
    const auto free = move(m, path_at(aside), options);
    options.limits.drive_jerk = JointVector::Constant(6, 2e4);
    const auto smooth = move(m, path_at(aside), options);
    ASSERT_TRUE(free && smooth);
    ASSERT_TRUE(free->ok() && smooth->ok());
    EXPECT_GT(free->drives[3].high - free->drives[3].low, 3.1) << aside;
    EXPECT_GT(free->time, std::numbers::pi / 12) << aside;
    EXPECT_LT(free->time, 1.01 * smooth->time) << aside;
    EXPECT_LT(smooth->time, 1.3 * free->time) << aside;
    EXPECT_LT(free->time, farther > 0 ? 1.1 * farther : 10) << aside;
    farther = free->time;
    EXPECT_TRUE(std::none_of(free->notes.begin(), free->notes.end(), [](const std::string& note) {
      return note.find("slowed down") != std::string::npos;
    })) << aside;
  }
}

// The planar machine is singular at C = 29.72 deg, less than a step behind where a stretch begins.
TEST(Move, ASingularPoseInTheFirstStepOfAStretchIsFound) {
  const AnyMachine m = load("planar-3rrr");
  const auto at = [](double c) {
    const double x = 2e-3 + (c - 17) * 4.0 / 34 * 1e-3;
    return TargetPose{Vec3(x, 0, 0), Vec3(0, 0, units::from_deg(c))};
  };
  for (const double between : {29.2, 29.4, 29.6, 29.8, 30.0}) {
    MoveOptions options;
    options.speed = 0.01;
    const auto r = move(m, *pose_path_of({*straight(at(20), at(between)), *straight(at(between), at(60))}), options);
    ASSERT_TRUE(r);
    EXPECT_GT(r->worst_condition, 1e6) << between;
    EXPECT_FALSE(r->ok()) << between;
  }
}

// Joint 6 may turn from -266 to 266 deg: the turn of 200 deg about the tool fits from one of its places alone.
TEST(Move, AJointBeginsInTheTurnFromWhichThePathPasses) {
  const AnyMachine m = load("puma560");
  for (const double sense : {-1.0, 1.0}) {
    JointVector q(6);
    q << 0.2, 0.7, -1.0, 0.3, 0.6, sense * units::from_deg(170);
    const Pose X = kinematics::forward(m, q).poses.front();
    std::vector<Stretch> stretches;
    TargetPose last{X.p, angles_abc(X.R)};
    for (int k = 1; k <= 2; ++k) {
      const double turn = units::from_deg(-100 * sense * k);  // the tool's z points against that of joint 6
      const TargetPose next{X.p, angles_abc(X.R * rotation_abc(0, 0, turn))};
      stretches.push_back(*straight(last, next, Turning::turn));
      last = next;
    }
    MoveOptions options;
    options.law = Law::fastest;
    options.limits.turn_speed = 1;
    const auto starts = kinematics::inverse(m, X).solutions;
    for (std::size_t k = 0; k < starts.size(); ++k)
      if ((starts[k].joints - q).head(5).norm() < 1e-6) options.start = k;
    const auto r = move(m, *pose_path_of(stretches), options);
    ASSERT_TRUE(r);
    ASSERT_TRUE(r->ok()) << r->violations.front().detail;
    EXPECT_NE(r->branch.find("joint 6 begins at"), std::string::npos) << r->branch;
    EXPECT_NEAR(r->drives[5].first, sense * units::from_deg(-190), 1e-9);
    EXPECT_NEAR(r->drives[5].last, sense * units::from_deg(10), 1e-9);
    EXPECT_TRUE(r->starts.back().chosen);
  }
}

TEST(Move, LimitsAreFoundWhereTheyAreBroken) {
  const AnyMachine any = load("hexapod-strut");
  const auto& m = std::get<machine::StrutHexapod>(any);
  const Vec3 p = kinematics::home_pose(any)->p;
  MoveOptions options;
  options.speed = 0.01;
  const auto r =
      move(any, *pose_path_of({*straight({p, Vec3::Zero()}, {p + Vec3(0, 0, 0.05), Vec3::Zero()})}), options);
  ASSERT_TRUE(r);
  ASSERT_FALSE(r->ok());
  // Straight up all struts are the longest at once: l^2 = d^2 + z^2.
  const double d = (m.platform_joint[0] - m.base_joint[0]).head<2>().norm();
  const double z = std::sqrt(m.length_max * m.length_max - d * d);
  bool found = false;
  for (const MoveViolation& v : r->violations) {
    if (v.limit.find("maximum") == std::string::npos) continue;
    found = true;
    EXPECT_NEAR(v.p.z(), z + m.tool_length, 1e-6);
    EXPECT_NEAR(v.t, (z + m.tool_length - p.z()) / 0.01, 1e-4);
    EXPECT_NEAR(v.length, v.p.z() - p.z(), 1e-9);
  }
  EXPECT_TRUE(found);
  const auto out =
      move(load("lola50"), *pose_path_of({*straight({Vec3(0, -5, 0), Vec3::Zero()}, {Vec3(0, -6, 0), Vec3::Zero()})}),
           options);
  EXPECT_EQ(out.error().id, "MO116");
  // A way that begins within reach and leaves it: no plan, and the reason.
  options.law = Law::fastest;
  options.limits.tool_speed = 1;
  options.limits.tool_acceleration = 1;
  const auto leaves =
      move(load("lola50"), *pose_path_of({*straight({Vec3(0, -1.3, 0), Vec3::Zero()}, {Vec3(0, -3, 0), Vec3::Zero()})}),
           options);
  ASSERT_TRUE(leaves);
  EXPECT_FALSE(leaves->ok());
  EXPECT_TRUE(std::isnan(leaves->time));
}

TEST(PosePath, BlendsGoOnSmoothlyAndStayNear) {
  const auto a = *straight({Vec3(0, 0, 0), Vec3::Zero()}, {Vec3(0.1, 0, 0), Vec3(0.1, 0, 0)});
  const auto b = *straight({Vec3(0.1, 0, 0), Vec3(0.1, 0, 0)}, {Vec3(0.1, 0.1, 0), Vec3(0.1, 0.2, 0)});
  const auto c = *curved({Vec3(0.1, 0.1, 0), Vec3(0.1, 0.2, 0)}, Vec3(0.1 - 0.02, 0.12, 0),
                         {Vec3(0.06, 0.1, 0), Vec3(0.1, 0.2, 0)});
  const PosePath path = *pose_path_of({a, b, c});
  EXPECT_NEAR(path.junction(0).corner, std::numbers::pi / 2, 1e-12);
  EXPECT_FALSE(path.junction(0).tangent);
  EXPECT_TRUE(path.junction(1).corner < 1e-9 && !path.junction(1).smooth);  // the arc's curvature begins at once
  const double deviation = 0.001;
  const PosePath round = blended(path, deviation, true);
  ASSERT_EQ(round.stretches.size(), 5U);
  for (std::size_t k = 0; k + 1 < round.stretches.size(); ++k) {
    const Junction j = round.junction(k);
    EXPECT_TRUE(j.tangent && j.smooth) << k;
    const Stretch &in = round.stretches[k], &onward = round.stretches[k + 1];
    EXPECT_LT((in.pose(in.size).p - onward.pose(0).p).norm(), 1e-12);
    EXPECT_LT((in.pose(in.size).R - onward.pose(0).R).norm(), 1e-12);
  }
  // The way in the corner is the nearer to the corner the smaller the deviation: it is met to some per cent.
  double nearest = 1;
  const Stretch& corner = round.stretches[1];
  for (int k = 0; k <= 1000; ++k) {
    const Vec3 p = corner.pose(corner.size * k / 1000).p;
    const double off = std::min(std::abs(p.y()), std::abs(p.x() - 0.1));
    nearest = std::min(nearest, (p - Vec3(0.1, 0, 0)).norm());
    EXPECT_LE(off, deviation * 1.001);
  }
  EXPECT_GT(nearest, 0.5 * deviation);
  EXPECT_EQ(blended(path, 0, true).stretches.size(), 3U);
}

TEST(PosePath, TurningAboutOneAxisIsTheShortestWay) {
  const Vec3 from(0.3, -0.2, 0.5), to(-0.4, 0.6, -0.1);
  const Stretch s = *straight({Vec3::Zero(), from}, {Vec3::Zero(), to}, Turning::turn);
  const Mat3 A = rotation_abc(from.x(), from.y(), from.z()), B = rotation_abc(to.x(), to.y(), to.z());
  const double angle = rotation_vector(B * A.transpose()).norm();
  EXPECT_NEAR(s.size, angle, 1e-12);
  EXPECT_LT((s.pose(0).R - A).norm() + (s.pose(s.size).R - B).norm(), 1e-12);
  EXPECT_NEAR(rotation_vector(s.pose(0.5 * s.size).R * A.transpose()).norm(), 0.5 * angle, 1e-12);
  const PoseSeries X = s.at(polypod::Series(0.3 * s.size, 1, 0, 0));
  const double h = 1e-4;
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) {
      const auto R = [&](double x) { return s.pose(0.3 * s.size + x).R(i, k); };
      EXPECT_NEAR(X.R(i, k).derivative(1), (R(h) - R(-h)) / (2 * h), 1e-7);
      EXPECT_NEAR(X.R(i, k).derivative(2), (R(h) - 2 * R(0) + R(-h)) / (h * h), 1e-6);
    }
  }
}

TEST(PosePath, Files) {
  const auto good = read_pose_path(written("poses.toml", R"(
start_mm = [0, 0, 70]
start_deg = [0, 0, 0]
segments = [
  { to_mm = [5, 0, 70], to_deg = [2, 0, 0], time_s = 1 },
  { to_deg = [0, 0, 4], time_s = 0.5 },
  { via_mm = [0, 5, 70], to_mm = [-5, 0, 70], time_s = 2 },
]
)"));
  ASSERT_TRUE(good) << good.error().message;
  EXPECT_TRUE(good->timed && good->angles);
  ASSERT_EQ(good->path.stretches.size(), 3U);
  EXPECT_NEAR(good->path.length, 0.005 + std::numbers::pi * 0.005, 1e-12);
  EXPECT_NEAR(good->path.stretches[1].size, std::hypot(2, 4) * std::numbers::pi / 180, 1e-12);
  const auto table =
      read_pose_path(written("poses.csv", "time_s,x_mm,y_mm,z_mm,a_deg\n0,0,0,70,0\n1,5,0,70,2\n1.5,5,5,70,0\n"));
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_TRUE(table->timed);
  EXPECT_NEAR(table->path.stretches[1].duration, 0.5, 1e-12);
  EXPECT_NEAR(table->path.stretches[0].angles_to.x(), 2 * std::numbers::pi / 180, 1e-15);
  const auto id = [](const std::string& name, const std::string& text) {
    const auto r = read_pose_path(written(name, text));
    return r ? std::string("read") : r.error().id;
  };
  // Columns that a machine's poses do not prescribe may be left out.
  const std::string upwards = written("upwards.csv", "time_s,z_mm,a_deg\n0,900,0\n1,910,2\n");
  EXPECT_EQ(read_pose_path(upwards).error().id, "ID100");
  const auto z = read_pose_path(upwards, {"z_mm"});
  ASSERT_TRUE(z) << z.error().message;
  EXPECT_NEAR(z->path.stretches[0].to.z(), 0.91, 1e-15);
  EXPECT_EQ(z->path.stretches[0].to.x(), 0);
  EXPECT_NE(id("empty.csv", "x_mm,y_mm,z_mm\n0,0,70\n5,,70\n"), "read");
  EXPECT_EQ(id("back.csv", "time_s,x_mm,y_mm,z_mm\n0,0,0,70\n1,5,0,70\n0.5,5,5,70\n"), "MO113");
  EXPECT_EQ(id("still.csv", "x_mm,y_mm,z_mm\n0,0,70\n0,0,70\n"), "MO100");
  EXPECT_EQ(id("one.csv", "x_mm,y_mm,z_mm\n0,0,70\n"), "MO100");
  EXPECT_EQ(id("some.toml", "start_mm = [0,0,70]\nsegments = [{to_mm=[5,0,70], time_s=1},{to_mm=[5,5,70]}]\n"),
            "MO111");
  EXPECT_EQ(id("word.toml", "start_mm = [0,0,70]\nturning = \"about\"\nsegments = [{to_mm=[5,0,70]}]\n"), "MO112");
  EXPECT_EQ(id("line.toml", "start_mm = [0,0,70]\nsegments = [{to_mm=[5,0,70], via_mm=[2,0,70]}]\n"), "MO102");
  // A path of angles alone needs no place; one that goes to a place needs where it begins.
  EXPECT_EQ(id("turns.toml", "start_deg = [0,0,0]\nsegments = [{to_deg=[5,0,0], time_s=1}]\n"), "read");
  EXPECT_EQ(id("from.toml", "start_deg = [0,0,0]\nsegments = [{to_mm=[5,0,0], time_s=1}]\n"), "CF106");
  EXPECT_EQ(id("none.toml", "segments = [{to_deg=[5,0,0], time_s=1}]\n"), "CF106");
  EXPECT_EQ(id("key.toml", "start_mm = [0,0,70]\nsegments = [{to_mm=[5,0,70], tme_s=1}]\n"), "CF103");
}

}  // namespace
}  // namespace polypod::motion
