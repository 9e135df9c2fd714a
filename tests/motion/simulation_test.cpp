// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Forward dynamics: a pendulum's period in closed form, energy that is kept, and forces that come back by the inverse.
#include "polypod/motion/simulation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "machines.hpp"
#include "motion/masses.hpp"
#include "polypod/motion/driven_series.hpp"
#include "runge_kutta.hpp"

namespace polypod::motion {
namespace {

using test::load;

Dynamics masses_of(const AnyMachine& m) {
  Dynamics out = legs_with_masses();
  out.platform = Body{2.5, Vec3(0.01, -0.02, 0.03), Vec3(0.02, 0.03, 0.04).asDiagonal()};
  out.drive = {0.05};
  if (const auto* arm = std::get_if<machine::SerialArm>(&m)) {
    for (std::size_t k = 0; k < arm->dh.size(); ++k) {
      out.links.emplace_back(
          Body{5.0 - 0.5 * static_cast<double>(k), Vec3(-0.1, 0.02, 0.03), Vec3(0.05, 0.06, 0.04).asDiagonal()});
    }
  }
  return out;
}

/// A pose of the machine, away from singular ones, and speeds that all differ.
struct Start {
  Pose X;
  JointVector q, v;
};
Start start_of(const AnyMachine& m, double speed) {
  Start out;
  if (const auto home = kinematics::home_pose(m)) {
    Pose X = *home;
    X.p += Vec3(0.002, -0.003, 0.001);
    out.q = kinematics::inverse(m, X).solutions.front().joints;
    out.X = kinematics::settled(m, X, out.q);
  } else {
    out.q = JointVector(kinematics::joint_count(m));
    for (int i = 0; i < out.q.size(); ++i) {
      const machine::JointRange r = kinematics::joint_range(m, i);
      out.q[i] = r.min + (0.42 + 0.05 * i) * (r.max - r.min);
    }
    out.X = kinematics::forward(m, out.q).poses.front();
  }
  out.v = JointVector(out.q.size());
  for (int i = 0; i < out.v.size(); ++i) out.v[i] = speed * std::sin(1.0 + 2.0 * i);
  return out;
}

Simulation run(const AnyMachine& m, const Dynamics& d, const Start& s, const SimulationOptions& o) {
  Result<Simulation> out = simulate(m, d, s.X, s.q, s.v, o);
  if (!out) throw std::runtime_error(to_string(out.error()));
  return *out;
}

/// y'' = -y: the error of one period falls by 2^5 where the step is halved.
TEST(Simulation, TheMethodIsOfFifthOrder) {
  const auto f = [](double, const Eigen::VectorXd& y) {
    Eigen::VectorXd out(2);
    out << y[1], -y[0];
    return std::optional<Eigen::VectorXd>(out);
  };
  const auto error_with = [&](int steps) {
    Eigen::VectorXd y(2);
    y << 1, 0;
    const double h = 2 * std::numbers::pi / steps;
    for (int k = 0; k < steps; ++k) {
      const auto next = dormand_prince(f, k * h, y, *f(0, y), h);
      EXPECT_LT(next->error.norm(), 0.02 * std::pow(h, 5));  // the difference to fourth order is a power of h^5
      y = next->y;
    }
    return (y - Eigen::Vector2d(1, 0)).norm();
  };
  const double order = std::log2(error_with(50) / error_with(100));
  EXPECT_NEAR(order, 5, 0.15);
}

/// A body on a pin, released at 100 deg: its period is 4 K(sin(50 deg)) sqrt(I / (m g r)), K the complete elliptic
/// integral.
TEST(Simulation, APendulumHasItsPeriod) {
  const AnyMachine m(test::arm_of(R"(
family = "serial"
task = ["x"]
dh = [{ a_mm = 500 }]
limits = [{ min_deg = -400, max_deg = 400 }]
)"));
  const double mass = 3, r = 0.2, inertia = 0.07, g = 9.81;
  Dynamics d;
  d.gravity = Vec3(g, 0, 0);  // q = 0 hangs
  Body b;
  b.mass = mass;
  b.center = Vec3(r - 0.5, 0, 0);
  b.inertia = Vec3(inertia, inertia, inertia).asDiagonal();
  d.links.emplace_back(b);
  Start s;
  const double released = 100 * std::numbers::pi / 180;
  s.q = JointVector::Constant(1, released);
  s.v = JointVector::Zero(1);
  s.X = kinematics::forward(m, s.q).poses.front();
  const double period =
      4 * std::comp_ellint_1(std::sin(released / 2)) * std::sqrt((inertia + mass * r * r) / (mass * g * r));
  SimulationOptions o;
  o.time = 3 * period;
  o.interval = period / 100;
  o.tolerance = 1e-11;
  const Simulation got = run(m, d, s, o);
  ASSERT_EQ(got.samples.size(), 301U);
  EXPECT_NEAR(got.samples[300].q[0], released, 1e-8);
  EXPECT_NEAR(got.samples[150].q[0], -released, 1e-8);
  EXPECT_NEAR(got.samples[75].q[0], 0, 1e-8);
  EXPECT_TRUE(got.passed.empty());
}

class Free : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Machines, Free, ::testing::Values("puma560", "hexapod-strut", "hexapod-slider", "delta-brno"),
                         [](const auto& which) {
                           std::string name = which.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

/// No drive pushes and nothing rubs: the energy is that of the start. Stated: the drift is below 1e-8 of the energy
/// that goes back and forth between height and speed, and it falls with the tolerance.
TEST_P(Free, EnergyIsKept) {
  const AnyMachine m = load(GetParam());
  const bool arm = kinematics::is_serial(m);
  const Start s = start_of(m, arm ? 1.0 : GetParam() == "delta-brno" ? 1.0 : 0.02);
  const Dynamics d = masses_of(m);
  SimulationOptions o;
  o.time = arm ? 1.0 : GetParam() == "delta-brno" ? 0.15 : 0.02;
  o.interval = o.time / 4;
  o.tolerance = 1e-11;
  const Simulation got = run(m, d, s, o);
  ASSERT_TRUE(got.stopped.empty()) << got.stopped;
  double low = got.samples[0].energy.kinetic, high = low;
  for (const SimulationSample& x : got.samples) {
    low = std::min(low, x.energy.kinetic);
    high = std::max(high, x.energy.kinetic);
    EXPECT_EQ(x.work, 0);
  }
  RecordProperty("drift_J", fmt::format("{:.3g}", got.drift));
  RecordProperty("exchanged_J", fmt::format("{:.3g}", high - low));
  RecordProperty("steps", static_cast<int>(got.steps));
  fmt::print("drift {:.3g} J of {:.3g} J exchanged, {} steps\n", got.drift, high - low, got.steps);
  EXPECT_GT(high - low, 1e-3);
  EXPECT_LT(got.drift, 1e-8 * (high - low));
  o.tolerance = 1e-5;
  const Simulation loose = run(m, d, s, o);
  EXPECT_LT(loose.steps, got.steps);
  EXPECT_GT(loose.drift, got.drift);
}

/// Forces that change with time push it; speeds and accelerations by differences of eighth order of the joints alone,
/// and the inverse dynamics of these, give the forces back.
TEST_P(Free, InverseDynamicsOfTheMotionGivesTheForcesBack) {
  const AnyMachine m = load(GetParam());
  const bool arm = kinematics::is_serial(m);
  const bool large = arm || GetParam() == "delta-brno";
  const Start s = start_of(m, large ? 0.3 : 0.01);
  Dynamics d = masses_of(m);
  d.viscous = {0.4};
  JointSeries still;
  still = driven_series(m, s.X, s.q, JointVector::Zero(s.q.size()), JointVector::Zero(s.q.size()));
  const JointVector hold = drive_forces(m, d, still);
  SimulationOptions o;
  o.forces = [&](double t, const JointVector&, const JointVector&) {
    JointVector out = hold;
    for (int i = 0; i < out.size(); ++i) out[i] += 2 * std::sin(20.0 * t + i);
    return out;
  };
  const double h = 1e-3;
  o.time = 0.04;
  o.interval = h;
  o.tolerance = 1e-12;
  const Simulation got = run(m, d, s, o);
  ASSERT_TRUE(got.stopped.empty()) << got.stopped;
  const auto q = [&](std::size_t k) { return got.samples[k].q; };
  double worst = 0, largest = 0;
  for (std::size_t k = 4; k + 4 < got.samples.size(); k += 5) {
    const JointVector v = (4.0 / 5 * (q(k + 1) - q(k - 1)) - 1.0 / 5 * (q(k + 2) - q(k - 2)) +
                           4.0 / 105 * (q(k + 3) - q(k - 3)) - 1.0 / 280 * (q(k + 4) - q(k - 4))) /
                          h;
    const JointVector a = (-205.0 / 72 * q(k) + 8.0 / 5 * (q(k + 1) + q(k - 1)) - 1.0 / 5 * (q(k + 2) + q(k - 2)) +
                           8.0 / 315 * (q(k + 3) + q(k - 3)) - 1.0 / 560 * (q(k + 4) + q(k - 4))) /
                          (h * h);
    const Pose X = pose_near(m, q(k), got.samples[k].X);
    const JointVector back = drive_forces(m, d, driven_series(m, X, q(k), v, a));
    const JointVector want = o.forces(got.samples[k].t, q(k), v);
    worst = std::max(worst, (back - want).cwiseAbs().maxCoeff());
    largest = std::max(largest, want.cwiseAbs().maxCoeff());
  }
  fmt::print("forces come back within {:.3g} of {:.3g}\n", worst, largest);
  EXPECT_LT(worst, 1e-5 * largest);  // rounding of q over h^2: 1e-16 / 1e-6 times the masses
  // What the drives and friction brought in is what the energy gained.
  EXPECT_LT(got.drift, 1e-9 * (1 + std::abs(got.samples.back().work)));
  EXPECT_GT(std::abs(got.samples.back().work), 1e-6);
}

/// Steps that are all alike come to the same place, with an error of fifth order.
TEST(Simulation, FixedStepsComeToTheSamePlace) {
  const AnyMachine m = load("puma560");
  const Start s = start_of(m, 1.0);
  const Dynamics d = masses_of(m);
  SimulationOptions o;
  o.time = 0.3;
  o.interval = 0.1;
  o.tolerance = 1e-12;
  const JointVector want = run(m, d, s, o).samples.back().q;
  o.step = 0.02;
  const double coarse = (run(m, d, s, o).samples.back().q - want).norm();
  o.step = 0.01;
  const double fine = (run(m, d, s, o).samples.back().q - want).norm();
  EXPECT_EQ(run(m, d, s, o).steps, 30U);
  EXPECT_GT(coarse / fine, 20);
  EXPECT_LT(fine, 1e-5);
}

TEST(Simulation, RefusesWhatItDoesNotSimulate) {
  const AnyMachine m = load("puma560");
  const Start s = start_of(m, 0);
  const auto id = [&](const Dynamics& d, const SimulationOptions& o, const AnyMachine& which, const Start& at) {
    const auto r = simulate(which, d, at.X, at.q, at.v, o);
    return r ? std::string("none") : r.error().id;
  };
  Dynamics d = masses_of(m);
  SimulationOptions o;
  o.time = 1e-3;
  EXPECT_EQ(id(d, o, m, s), "none");
  o.time = 0;
  EXPECT_EQ(id(d, o, m, s), "MO133");
  o.time = std::nan("");
  EXPECT_EQ(id(d, o, m, s), "MO133");
  o.time = 1;
  o.interval = 1e-8;
  EXPECT_EQ(id(d, o, m, s), "MO133");
  o.interval = 1e-3;
  o.most_steps = 10;
  EXPECT_EQ(id(d, o, m, s), "MO134");
  o = SimulationOptions{};
  o.progress = [](double) { return false; };
  EXPECT_EQ(id(d, o, m, s), "MO199");
  d.friction = {1.0};
  EXPECT_EQ(id(d, SimulationOptions{}, m, s), "MO131");
  EXPECT_EQ(id(Dynamics{}, SimulationOptions{}, m, s), "MO132");
  const AnyMachine more(test::arm_of(R"(
family = "serial"
task = ["x", "y"]
dh = [{ a_mm = 500 }, { a_mm = 400 }, { a_mm = 300 }]
)"));  // more drives than coordinates
  EXPECT_EQ(id(Dynamics{}, SimulationOptions{}, more, s), "MO130");
}

/// A delta that falls comes to where its rods no longer hold the platform, or past its limits, and that is said.
TEST(Simulation, SaysWhichLimitsArePassed) {
  const AnyMachine m = load("delta-brno");
  const Start s = start_of(m, 0);
  Dynamics d = masses_of(m);
  d.gravity = Vec3(0, 0, 9.81);
  SimulationOptions o;
  o.time = 2;
  o.interval = 0.01;
  const Simulation got = run(m, d, s, o);
  EXPECT_FALSE(got.passed.empty());
  for (const LimitPassed& limit : got.passed) EXPECT_GT(limit.t, 0);
  if (got.stopped.empty()) {
    EXPECT_EQ(got.samples.size(), 201U);
  } else {
    EXPECT_LT(got.samples.back().t, 2);
  }
  // Whatever the samples: the same limits at the same times, and the same extent of the drives.
  o.interval = 2;
  const Simulation coarse = run(m, d, s, o);
  ASSERT_EQ(coarse.passed.size(), got.passed.size());
  for (std::size_t k = 0; k < got.passed.size(); ++k) {
    EXPECT_EQ(coarse.passed[k].limit, got.passed[k].limit);
    EXPECT_NEAR(coarse.passed[k].t, got.passed[k].t, 2e-3 * got.passed[k].t);
  }
  for (std::size_t i = 0; i < got.drives.size(); ++i) {
    const double all = got.drives[i].high - got.drives[i].low;
    EXPECT_NEAR(coarse.drives[i].high - coarse.drives[i].low, all, 0.02 * all) << i;
  }
}

}  // namespace
}  // namespace polypod::motion
