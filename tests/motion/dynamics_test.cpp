// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Forces of the drives against Lagrange's equations by differences, energies, and closed forms of small machines.
#include "polypod/motion/dynamics.hpp"
#include "polypod/motion/vibration.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>
#include <numbers>

#include "machines.hpp"
#include "motion/masses.hpp"

#include "polypod/motion/machine_motion.hpp"

namespace polypod::motion {
namespace {

using test::load;

Body brick(double mass, const Vec3& center, const Vec3& size) {
  Body out;
  out.mass = mass;
  out.center = center;
  for (int i = 0; i < 3; ++i) out.inertia(i, i) = mass / 12 * (size.squaredNorm() - size[i] * size[i]);
  out.inertia(0, 1) = out.inertia(1, 0) = 0.05 * out.inertia.trace();
  return out;
}

Dynamics masses_of(const AnyMachine& m) {
  Dynamics out = legs_with_masses();
  out.platform = brick(2.5, Vec3(0.01, -0.02, 0.03), Vec3(0.2, 0.1, 0.05));
  out.payload = brick(0.7, Vec3(0, 0.01, -0.02), Vec3(0.05, 0.06, 0.07));
  out.drive = {0.05};
  if (const auto* arm = std::get_if<machine::SerialArm>(&m)) {
    for (std::size_t k = 0; k < arm->dh.size(); ++k) {
      out.links.emplace_back(brick(5.0 - 0.5 * static_cast<double>(k), Vec3(-0.1, 0.02, 0.03), Vec3(0.3, 0.1, 0.1)));
    }
  }
  if (const auto* series = std::get_if<machine::Stages>(&m)) {
    for (const AnyMachine& stage : series->machines) out.stages.push_back(masses_of(stage));
  }
  return out;
}

/// A pose of the machine, away from singular ones.
std::pair<Pose, JointVector> pose_of(const AnyMachine& m) {
  if (const auto home = kinematics::home_pose(m)) {
    Pose X = *home;
    X.p += Vec3(0.002, -0.003, 0.001);
    const JointVector q = kinematics::inverse(m, X).solutions.front().joints;
    return {kinematics::settled(m, X, q), q};
  }
  JointVector q(kinematics::joint_count(m));
  for (int i = 0; i < q.size(); ++i) {
    const machine::JointRange r = kinematics::joint_range(m, i);
    q[i] = r.min + (kinematics::is_serial(m) ? 0.42 + 0.05 * i : 0.4 + 0.02 * i) * (r.max - r.min);
  }
  return {kinematics::forward(m, q).poses.front(), q};
}

/// The machine as it moves with given speeds and accelerations of its joints: X by Newton's method at joints on the
/// way, its derivatives by differences of the Jacobian's twist.
struct Moving {
  JointVector q, v, a;
};
JointSeries series_of(const AnyMachine& m, const Pose& X, const Moving& s) {
  // The target moves as the joints say to the second order: X(t) = X exp(t^2/2 ...) from J v and its rate.
  const double h = 1e-4;
  const auto twist_at = [&](double t) {
    const JointVector q = s.q + t * s.v + 0.5 * t * t * s.a, v = s.v + t * s.a;
    const Pose at = pose_near(m, q, X);
    return Vec6(kinematics::jacobian(m, at, q) * v);
  };
  const Vec6 V = twist_at(0);
  const Vec6 A = (8 * (twist_at(h) - twist_at(-h)) - (twist_at(2 * h) - twist_at(-2 * h))) / (12 * h);
  JointSeries out;
  out.q = s.q;
  out.first = s.v;
  out.second = s.a;
  out.third = JointVector::Zero(s.q.size());
  out.regular = true;
  // w(t) with R = exp(w(t)) R_0: w' = omega, w'' = omega' at t = 0.
  Vector3<polypod::Series> w;
  for (int k = 0; k < 3; ++k) {
    out.X.p[k] = polypod::Series(X.p[k], V[k], A[k], 0);
    w[k] = polypod::Series(0, V[3 + k], A[3 + k], 0);
  }
  const Matrix3<polypod::Series> T = rotation_series(w);
  for (int i = 0; i < 3; ++i) {
    for (int c = 0; c < 3; ++c) {
      out.X.R(i, c) = polypod::Series(0.0);
      for (int k = 0; k < 3; ++k) out.X.R(i, c) += T(i, k) * polypod::Series(X.R(k, c));
    }
  }
  return out;
}

class Massive : public ::testing::TestWithParam<std::string> {};
const auto named = [](const auto& which) {
  std::string name = which.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
};
INSTANTIATE_TEST_SUITE_P(Machines, Massive,
                         ::testing::Values("lola50", "ur10e", "puma560", "hexapod-strut", "hexapod-slider",
                                           "delta-brno", "delta-linear", "hexa", "pentapod", "tripod-z3", "tricept",
                                           "tricept-wrist", "dynapod", "scissors"),
                         named);

/// d/dt (dT/dq') - dT/dq + dV/dq with T = q'^T M(q) q' / 2, by differences of fourth order: their error is some 1e-7 of
/// the parts.
TEST_P(Massive, ForcesAreThoseOfLagrangesEquations) {
  const AnyMachine m = load(GetParam());
  const Dynamics d = masses_of(m);
  const auto [X, q] = pose_of(m);
  const auto n = static_cast<int>(q.size());
  Moving s{q, JointVector(n), JointVector(n)};
  for (int i = 0; i < n; ++i) {
    s.v[i] = 0.3 * std::sin(1.0 + 2.0 * i);
    s.a[i] = 1.5 * std::cos(0.5 + 1.7 * i);
  }
  const JointVector got = drive_forces(m, d, series_of(m, X, s));
  const auto M_at = [&](const JointVector& at) { return mass_matrix(m, d, pose_near(m, at, X), at); };
  const auto V_at = [&](const JointVector& at) {
    JointSeries still;
    still.q = at;
    still.first = still.second = still.third = JointVector::Zero(n);
    const Pose P = pose_near(m, at, X);
    still.X = P.cast<polypod::Series>();
    return energy_of(m, d, still).potential;
  };
  const double h = 1e-4;
  const auto slope = [&](const auto& f) {
    using T = decltype(f(h));
    return T((8.0 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h));
  };
  const Eigen::MatrixXd M = M_at(q);
  const Eigen::MatrixXd dM = slope([&](double t) { return Eigen::MatrixXd(M_at(q + t * s.v)); });
  JointVector want = M * s.a + dM * s.v;
  for (int j = 0; j < n; ++j) {
    const auto moved = [&](double t) {
      JointVector at = q;
      at[j] += t;
      return at;
    };
    const Eigen::MatrixXd by_j = slope([&](double t) { return Eigen::MatrixXd(M_at(moved(t))); });
    want[j] += -0.5 * s.v.dot(by_j * s.v) + slope([&](double t) { return V_at(moved(t)); });
  }
  EXPECT_LT((got - want).norm(), 2e-6 * (1 + want.norm())) << got.transpose() << "\n" << want.transpose();
  // And the kinetic energy, from the speeds of the mass points alone.
  EXPECT_NEAR(energy_of(m, d, series_of(m, X, s)).kinetic, 0.5 * s.v.dot(M * s.v), 1e-9 * (1 + M.norm()));
}

/// Along a path: the power of the drives is what the energies gain.
TEST(Dynamics, PowerIsTheRateOfEnergy) {
  for (const char* name : {"hexapod-strut", "hexapod-slider", "delta-brno", "lola50", "tricept-wrist", "scissors"}) {
    const AnyMachine m = load(name);
    const Dynamics d = masses_of(m);
    const auto [X, q0] = pose_of(m);
    const Vec3 p = X.p;
    const auto at = [&, q0 = q0, X = X](double t) {
      PoseSeries target = X.cast<polypod::Series>();
      const polypod::Series w(2 * t, 2, 0, 0);
      target.p[0] = polypod::Series(p[0]) + polypod::Series(0.003) * sin(w);
      target.p[1] = polypod::Series(p[1]) + polypod::Series(0.002) * cos(w);
      target.p[2] = polypod::Series(p[2]) + polypod::Series(0.004) * sin(w * w);
      Pose now;
      now.R = X.R;
      for (int k = 0; k < 3; ++k) now.p[k] = target.p[k].value();
      const JointVector q = kinematics::inverse_near(m, now, q0).solutions.front().joints;
      return joint_series(m, target, kinematics::settled(m, now, q), q);
    };
    const double h = 1e-3, t = 0.3;
    const auto energy = [&](double x) {
      const Energy e = energy_of(m, d, at(x));
      return e.kinetic + e.potential;
    };
    const double rate = (8 * (energy(t + h) - energy(t - h)) - (energy(t + 2 * h) - energy(t - 2 * h))) / (12 * h);
    const JointSeries now = at(t);
    const double power = drive_forces(m, d, now).dot(now.first);
    EXPECT_NEAR(power, rate, 1e-7 * (1 + std::abs(rate))) << name;
    EXPECT_GT(std::abs(power), 1e-4) << name;
  }
}

/// An arm of six joints, and the same arm as three joints that carry three: forces, energies, and natural frequencies.
TEST(Dynamics, AnArmOfTwoStagesHasTheForcesOfTheWholeArm) {
  const std::string first = R"(
  { d_mm = 400, a_mm = 60, alpha_deg = -90 },
  { a_mm = 450 },
  { a_mm = 40, alpha_deg = -90 },
)",
                    second = R"(
  { d_mm = 420, alpha_deg = 90 },
  { alpha_deg = -90 },
  { d_mm = 80 },
)";
  const AnyMachine whole(test::arm_of(fmt::format(R"(
family = "serial"
task = "pose"
dh = [{}{}]
compliance_rad_per_Nm = [1e-6, 2e-6, 3e-6, 4e-6, 5e-6, 6e-6]
)",
                                                  first, second)));
  const AnyMachine split = *machine::from_text(fmt::format(R"(
family = "stages"
task = "pose"
[[stage]]
[stage.machine]
family = "serial"
dh = [{}]
compliance_rad_per_Nm = [1e-6, 2e-6, 3e-6]
[[stage]]
[stage.machine]
family = "serial"
dh = [{}]
compliance_rad_per_Nm = [4e-6, 5e-6, 6e-6]
)",
                                                           first, second),
                                               "stages.toml");
  const Dynamics one = masses_of(whole);
  Dynamics two = one;
  two.links.clear();
  two.stages.resize(2);
  for (std::size_t k = 0; k < 6; ++k) two.stages[k / 3].links.push_back(one.links[k]);
  JointVector q(6), v(6), a(6);
  q << 0.3, -0.7, 0.4, 0.9, -1.1, 0.2;
  v << 0.5, -0.3, 0.8, 1.2, -0.7, 0.4;
  a << 2, 1, -3, 4, 0.5, -1;
  const Pose X = pose_near(whole, q, Pose{});
  const Moving moving{q, v, a};
  const JointVector want = drive_forces(whole, one, series_of(whole, X, moving)),
                    got = drive_forces(split, two, series_of(split, X, moving));
  EXPECT_LT((got - want).norm(), 1e-9 * want.norm()) << got.transpose() << "\n" << want.transpose();
  const Energy e = energy_of(whole, one, series_of(whole, X, moving)),
               f = energy_of(split, two, series_of(split, X, moving));
  EXPECT_NEAR(e.kinetic, f.kinetic, 1e-9 * e.kinetic);
  EXPECT_NEAR(e.potential, f.potential, 1e-9 * std::abs(e.potential));
  const std::vector<double> f_whole = natural_frequencies(whole, one, X, q),
                            f_split = natural_frequencies(split, two, X, q);
  ASSERT_EQ(f_whole.size(), 6U);
  ASSERT_EQ(f_split.size(), 6U);
  for (std::size_t k = 0; k < 6; ++k) EXPECT_NEAR(f_split[k], f_whole[k], 1e-9 * f_whole[k]);
  EXPECT_LT((weight_twist(whole, one, X, q) - weight_twist(split, two, X, q)).norm(),
            1e-9 * weight_twist(whole, one, X, q).norm());
}

/// Two links in a plane: the formulas of the textbooks (Craig, Introduction to Robotics, 6.7), with centers and
/// inertias.
TEST(Dynamics, TwoLinksInAPlane) {
  const auto arm = test::arm_of(R"(
family = "serial"
task = ["x", "y"]
dh = [{ a_mm = 500 }, { a_mm = 400 }]
)");
  const AnyMachine m(arm);
  const double l1 = 0.5, c1 = 0.2, c2 = 0.15, m1 = 3, m2 = 2, I1 = 0.07, I2 = 0.03, g = 9.81;
  Dynamics d;
  d.gravity = Vec3(0, -g, 0);
  for (const auto& [mass, inertia, center] : {std::tuple{m1, I1, c1 - 0.5}, std::tuple{m2, I2, c2 - 0.4}}) {
    Body b;
    b.mass = mass;
    b.center = Vec3(center, 0, 0);  // from the end of the link, where the frame of its row is
    b.inertia = Vec3(inertia, inertia, inertia).asDiagonal();
    d.links.emplace_back(b);
  }
  Moving s;
  s.q = JointVector(2);
  s.v = s.a = s.q;
  s.q << 0.4, 0.9;
  s.v << 1.3, -0.7;
  s.a << 2.0, 3.0;
  const JointVector got = drive_forces(m, d, series_of(m, kinematics::forward(m, s.q).poses.front(), s));
  const double k = m2 * l1 * c2, cos2 = std::cos(s.q[1]), sin2 = std::sin(s.q[1]);
  const double M11 = m1 * c1 * c1 + I1 + m2 * (l1 * l1 + c2 * c2) + I2 + 2 * k * cos2,
               M12 = m2 * c2 * c2 + I2 + k * cos2, M22 = m2 * c2 * c2 + I2;
  const double G2 = m2 * c2 * g * std::cos(s.q[0] + s.q[1]), G1 = (m1 * c1 + m2 * l1) * g * std::cos(s.q[0]) + G2;
  const double t1 = M11 * s.a[0] + M12 * s.a[1] - k * sin2 * (2 * s.v[0] * s.v[1] + s.v[1] * s.v[1]) + G1;
  const double t2 = M12 * s.a[0] + M22 * s.a[1] + k * sin2 * s.v[0] * s.v[0] + G2;
  EXPECT_NEAR(got[0], t1, 1e-8 * std::abs(t1));
  EXPECT_NEAR(got[1], t2, 1e-8 * std::abs(t2));
  // Friction is added against the motion: what the drive gives rises with its sense, and nothing where it stands.
  d.friction = {5, 6};
  d.viscous = {0.5, 0.7};
  const JointVector rubbed = drive_forces(m, d, series_of(m, kinematics::forward(m, s.q).poses.front(), s));
  EXPECT_NEAR(rubbed[0] - got[0], 5 + 0.5 * 1.3, 1e-12);
  EXPECT_NEAR(rubbed[1] - got[1], -6 - 0.7 * 0.7, 1e-12);
  s.v.setZero();
  const JointVector standing = drive_forces(m, d, series_of(m, kinematics::forward(m, s.q).poses.front(), s));
  d.friction.clear();
  const JointVector smooth = drive_forces(m, d, series_of(m, kinematics::forward(m, s.q).poses.front(), s));
  EXPECT_EQ(standing, smooth);
}

/// A mass on two slides, each with its compliance: the closed frequencies of two masses in a row.
TEST(Dynamics, TwoMassesInARow) {
  auto arm = test::arm_of(R"(
family = "serial"
task = ["z"]
dh = [{ joint = "prismatic" }, { joint = "prismatic" }]
limits = [{ min_mm = -100, max_mm = 100 }, { min_mm = -100, max_mm = 100 }]
compliance_rad_per_Nm = [1e-5, 2e-5]
)");
  const AnyMachine m(arm);
  Dynamics d;
  const double m1 = 4, m2 = 3, k1 = 1e5, k2 = 0.5e5;
  for (const double mass : {m1, m2}) {
    Body b;
    b.mass = mass;
    d.links.emplace_back(b);
  }
  const JointVector q = JointVector::Zero(2);
  const auto f = natural_frequencies(m, d, kinematics::forward(m, q).poses.front(), q);
  ASSERT_EQ(f.size(), 2U);
  // m1 m2 w^4 - (m1 k2 + m2 (k1 + k2)) w^2 + k1 k2 = 0
  const double b = m1 * k2 + m2 * (k1 + k2), root = std::sqrt(b * b - 4 * m1 * m2 * k1 * k2);
  EXPECT_NEAR(f[0], std::sqrt((b - root) / (2 * m1 * m2)) / (2 * std::numbers::pi), 1e-9 * f[0]);
  EXPECT_NEAR(f[1], std::sqrt((b + root) / (2 * m1 * m2)) / (2 * std::numbers::pi), 1e-9 * f[1]);
}

/// Still in the air: the forces of the struts carry the weight of the platform (statics, without the formula above).
TEST(Dynamics, StandingStillTheStrutsCarryThePlatform) {
  const AnyMachine any = load("hexapod-strut");
  const auto& m = std::get<machine::StrutHexapod>(any);
  Dynamics d;
  Body b;
  b.mass = 3;
  b.center = Vec3(0.004, -0.002, -0.03);
  d.platform = b;
  const auto [X, q] = pose_of(any);
  JointSeries s;
  s.q = q;
  s.first = s.second = s.third = JointVector::Zero(6);
  s.X = X.cast<polypod::Series>();
  const JointVector f = drive_forces(any, d, s);
  Vec3 force = 3 * d.gravity, moment = (X.R * b.center).cross(force);
  for (int i = 0; i < 6; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Vec3 arm = X.R * (m.platform_joint[k] - Vec3(0, 0, m.tool_length));
    const Vec3 push = f[i] * (X.p + arm - m.base_joint[k]).normalized();
    force += push;
    moment += arm.cross(push);
  }
  EXPECT_LT(force.norm(), 1e-9);
  EXPECT_LT(moment.norm(), 1e-10);
}

/// A pose and joints that stand still.
JointSeries still_at(const Pose& X, const JointVector& q) {
  JointSeries s;
  s.q = q;
  s.first = s.second = s.third = JointVector::Zero(q.size());
  s.X = X.cast<polypod::Series>();
  return s;
}
/// Speeds of the joints that differ, without accelerations.
Moving moving_at(const JointVector& q) {
  Moving s{q, JointVector(q.size()), JointVector::Zero(q.size())};
  for (int i = 0; i < q.size(); ++i) s.v[i] = 0.2 * std::sin(1.0 + 2.0 * i);
  return s;
}
constexpr double kRounding = 1e-9;  // of the energies, which are some J

// Lagrange's equations hold for masses that lie anywhere; the tests below say where they lie.

/// A uniform rod whose ends move with a and b has m (a.a + a.b + b.b) / 6; an arm has I q'^2 / 2.
TEST(Dynamics, RodsAndArmsOfADeltaLieWhereTheyShould) {
  const AnyMachine any = load("delta-brno");
  const auto& m = std::get<machine::RotaryDelta>(any);
  const auto [X, q] = pose_of(any);
  const JointSeries s = series_of(any, X, moving_at(q));
  const Vec3 v(s.X.p[0].derivative(1), s.X.p[1].derivative(1), s.X.p[2].derivative(1));
  Dynamics rods, arms;
  rods.gravity = arms.gravity = Vec3(0.3, -0.8, 9.7);
  rods.rod = 0.4;
  arms.arm = 0.8;
  arms.arm_center = 0.07;
  arms.arm_inertia = 0.008;
  double rods_T = 0, rods_V = 0, arms_T = 0, arms_V = 0;
  for (int i = 0; i < m.arms; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const double angle = q[i] + m.zero[k];
    const Vec3 along = std::sin(angle) * m.outward[k] - std::cos(angle) * Vec3::UnitZ();
    const Vec3 across = std::cos(angle) * m.outward[k] + std::sin(angle) * Vec3::UnitZ();
    const Vec3 elbow = m.base_joint[k] + m.arm_length[k] * along, wrist = X.p + m.platform_joint[k] - m.tool;
    ASSERT_NEAR((wrist - elbow).norm(), m.rod_length[k], 1e-9);
    const Vec3 a = m.arm_length[k] * s.first[i] * across;
    rods_T += 0.4 / 6 * (a.dot(a) + a.dot(v) + v.dot(v));
    rods_V -= 0.4 * rods.gravity.dot(0.5 * (elbow + wrist));
    arms_T += 0.5 * 0.008 * s.first[i] * s.first[i];
    arms_V -= 0.8 * arms.gravity.dot(m.base_joint[k] + 0.07 * along);
  }
  const Energy of_rods = energy_of(any, rods, s), of_arms = energy_of(any, arms, s);
  EXPECT_NEAR(of_rods.kinetic, rods_T, kRounding);
  EXPECT_NEAR(of_rods.potential, rods_V, kRounding);
  EXPECT_NEAR(of_arms.kinetic, arms_T, kRounding);
  EXPECT_NEAR(of_arms.potential, arms_V, kRounding);
}

/// The two halves of a strut: a body that moves with its center and turns with the strut's direction.
TEST(Dynamics, HalvesOfStrutsLieWhereTheyShould) {
  const AnyMachine any = load("hexapod-strut");
  const auto& m = std::get<machine::StrutHexapod>(any);
  const auto [X, q] = pose_of(any);
  const Moving moving = moving_at(q);
  const JointSeries s = series_of(any, X, moving);
  const Vec6 twist = kinematics::jacobian(any, X, q) * moving.v;
  Dynamics fixed, driven;
  fixed.strut_fixed = 1.2;
  fixed.strut_fixed_center = 0.02;
  fixed.strut_fixed_inertia = 0.01;
  driven.strut_moving = 0.6;
  driven.strut_moving_center = 0.03;
  driven.strut_moving_inertia = 0.002;
  double fixed_T = 0, fixed_V = 0, driven_T = 0, driven_V = 0;
  for (int i = 0; i < 6; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Vec3 arm = X.R * (m.platform_joint[k] - Vec3(0, 0, m.tool_length)), end = X.p + arm;
    const Vec3 speed = twist.head<3>() + twist.tail<3>().cross(arm), leg = end - m.base_joint[k];
    const Vec3 u = leg.normalized(), turns = (speed - u * u.dot(speed)) / leg.norm();
    fixed_T += 0.5 * (0.01 + 1.2 * 0.02 * 0.02) * turns.squaredNorm();
    fixed_V -= 1.2 * fixed.gravity.dot(m.base_joint[k] + 0.02 * u);
    driven_T += 0.5 * (0.6 * (speed - 0.03 * turns).squaredNorm() + 0.002 * turns.squaredNorm());
    driven_V -= 0.6 * driven.gravity.dot(end - 0.03 * u);
  }
  const Energy of_fixed = energy_of(any, fixed, s), of_driven = energy_of(any, driven, s);
  EXPECT_NEAR(of_fixed.kinetic, fixed_T, kRounding);
  EXPECT_NEAR(of_fixed.potential, fixed_V, kRounding);
  EXPECT_NEAR(of_driven.kinetic, driven_T, kRounding);
  EXPECT_NEAR(of_driven.potential, driven_V, kRounding);
}

/// Struts that end on a ring: its point on the side of the base joint, at which the strut has its length.
TEST(Dynamics, StrutsEndOnTheirRings) {
  AnyMachine any = load("pentapod");
  auto& m = std::get<machine::Parallel>(any);
  m.tool += Vec3(0.02, -0.01, 0.05);
  const auto [X, q] = pose_of(any);
  Dynamics d;
  d.gravity = Vec3(0.3, -0.8, -9.7);
  d.strut_moving = 0.6;
  double want = 0;
  int drive = 0;
  for (const machine::ParallelLeg& leg : m.legs) {
    ASSERT_TRUE(leg.ring);
    const Vec3 center = X * (leg.ring->center - m.tool), axis = X.R * leg.ring->axis, to = leg.base - center;
    const Vec3 end = center + leg.ring->radius * (to - to.dot(axis) * axis).normalized();
    ASSERT_NEAR((end - leg.base).norm(), q[drive++], 1e-9);
    want -= 0.6 * d.gravity.dot(end);
  }
  EXPECT_NEAR(energy_of(any, d, still_at(X, q)).potential, want, kRounding);
}

/// Cranks count from their zero and its error; rods end at the bars, which do not turn with the platform.
TEST(Dynamics, CranksAndRodsOfLegsLieWhereTheyShould) {
  AnyMachine any = load("delta-par4");
  auto& m = std::get<machine::Parallel>(any);
  for (machine::ParallelLeg& leg : m.legs) leg.zero_offset = 0.02;
  m.legs[0].still += Vec3(0.01, 0.02, 0.005);  // the bars of the catalogue add up to nothing
  const auto [X, q] = pose_of(any);
  Dynamics rods, arms;
  rods.rod = 0.4;
  arms.arm = 0.8;
  arms.arm_center = 0.07;
  arms.arm_inertia = 0.008;
  double rods_V = 0, arms_V = 0;
  int drive = 0;
  for (const machine::ParallelLeg& leg : m.legs) {
    ASSERT_EQ(leg.drive, machine::LegDrive::crank);
    const double angle = q[drive++] + 0.02;
    const Vec3 along = std::cos(angle) * leg.zero + std::sin(angle) * leg.axis.cross(leg.zero);
    const Vec3 elbow = leg.base + leg.arm * along, end = X * (leg.platform - m.tool) + leg.still;
    ASSERT_NEAR((end - elbow).norm(), leg.rod, 1e-9);
    rods_V -= 0.4 * rods.gravity.dot(0.5 * (elbow + end));
    arms_V -= 0.8 * arms.gravity.dot(leg.base + 0.07 * along);
  }
  EXPECT_NEAR(energy_of(any, rods, still_at(X, q)).potential, rods_V, kRounding);
  EXPECT_NEAR(energy_of(any, arms, still_at(X, q)).potential, arms_V, kRounding);
}

std::string written(const std::string& name, const std::string& text) {
  const std::string path = ::testing::TempDir() + name;
  std::ofstream(path) << text;
  return path;
}

TEST(Dynamics, Files) {
  const AnyMachine strut = load("hexapod-strut");
  const auto read = [&](const AnyMachine& m, const std::string& text) {
    return read_dynamics(written("masses.toml", "[dynamics]\n" + text), m);
  };
  const auto good = read(strut, R"(
gravity_m_per_s2 = [0, 0, -9.81]
platform = { mass_kg = 2, center_mm = [0, 0, -10], inertia_kg_m2 = [0.01, 0.01, 0.015] }
strut = { fixed_mass_kg = 1, fixed_center_mm = 20, moving_mass_kg = 0.5, moving_center_mm = 30 }
drive_inertia = 0.1
)");
  ASSERT_TRUE(good) << good.error().message;
  ASSERT_TRUE(*good);
  EXPECT_DOUBLE_EQ((*good)->platform->center.z(), -0.01);
  EXPECT_DOUBLE_EQ((*good)->strut_moving_center, 0.03);
  const auto id = [&](const AnyMachine& m, const std::string& text) {
    const auto r = read(m, text);
    return r ? std::string("read") : r.error().id;
  };
  EXPECT_EQ(id(strut, "platform = { mass_kg = 2, inertia_kg_m2 = [0.01, 0.01, 0.05] }\n"), "MO120");
  EXPECT_EQ(id(strut, "platform = { mass_kg = 2, inertia_kg_m2 = [0.01, 0.01, 0.015, 0.02, 0, 0] }\n"), "MO120");
  // Link 3 of a Puma 560 as Armstrong, Khatib and Burdick (1986) measured it: no rigid body, but what is known.
  const auto measured = read(strut, "platform = { mass_kg = 4.8, inertia_kg_m2 = [0.066, 0.0125, 0.086] }\n");
  ASSERT_TRUE(measured) << measured.error().message;
  EXPECT_EQ((*measured)->not_rigid(), std::vector<std::string>{"platform"});
  EXPECT_TRUE((*good)->not_rigid().empty());
  EXPECT_EQ(id(strut, "platform = { mass_kg = -2 }\n"), "CF105");
  EXPECT_EQ(id(strut, "rod_kg = 1\n"), "MO121");
  EXPECT_EQ(id(strut, "drive_inertia = [1, 2]\n"), "MO122");
  EXPECT_EQ(id(strut, "masses = 3\n"), "CF103");
  EXPECT_EQ(id(load("lola50"), "link = [{ mass_kg = 3 }]\n"), "MO122");
  EXPECT_EQ(id(load("delta-brno"), "arm = { mass_kg = 1, center_mm = 100, inertia_kg_m2 = 0.001 }\n"), "MO120");
  EXPECT_FALSE(*read_dynamics(written("none.toml", "family = \"x\"\n"), strut));
}

// Without a word of the file gravity points as the machine stands: machines that hang weigh along +z.
TEST(Dynamics, GravityFollowsHowTheMachineStands) {
  for (const auto& [name, down] : {std::pair{"hexapod-strut", -1},
                                   {"lola50", -1},
                                   {"delta-brno", 1},
                                   {"delta-linear", 1},
                                   {"delta-par4", 1},
                                   {"hexa", 1},
                                   {"tricept", 1},
                                   {"pentapod", 1},
                                   {"planar-3rrr", -1}}) {
    SCOPED_TRACE(name);
    const std::string path = written("weight.toml", "[dynamics]\nplatform = { mass_kg = 3 }\n");
    const auto d = read_dynamics(path, load(name));
    ASSERT_TRUE(d && *d);
    EXPECT_GT(down * (*d)->gravity.z(), 9.8);
    EXPECT_FALSE((*d)->gravity_given);
    EXPECT_EQ((*d)->parts_with_mass(), std::vector<std::string>{"platform"});
  }
  // Drives that stand still carry the platform against a weight along +z.
  for (const auto& [name, at] :
       {std::pair{"delta-par4", std::vector<double>{0, 0, 0.8, 0}}, {"delta-picker", {0, 0, 0.8}}}) {
    SCOPED_TRACE(name);
    const AnyMachine m = load(name);
    const auto d = read_dynamics(written("weight.toml", "[dynamics]\nplatform = { mass_kg = 3 }\n"), m);
    const Pose X = kinematics::pose_of(kinematics::task(m), at);
    const JointVector q = kinematics::inverse(m, X).solutions.at(0).joints;
    const Vec6 weight = (Vec6() << 0, 0, 3 * 9.80665, 0, 0, 0).finished();
    const JointVector held = drive_forces(m, **d, still_at(kinematics::settled(m, X, q), q));
    const JointVector expected = -kinematics::jacobian(m, X, q).transpose() * weight;
    EXPECT_LT((held - expected).norm(), 1e-9 * expected.norm());
  }
}

// Where the table of the whole has no stages, the files of the stages say what moves.
TEST(Dynamics, StagesBringTheirOwnMasses) {
  const std::string head = "name = \"gantry\"\nfamily = \"stages\"\ntask = [\"x\", \"y\", \"z\"]\n";
  const auto stages = [](const std::string& first, const std::string& second) {
    return "[[stage]]\nhome = [0, 0]\n[stage.machine]\nfamily = \"serial\"\n"
           "dh = [ { joint = \"prismatic\", alpha_deg = -90 }, { joint = \"prismatic\" } ]\n"
           "base = { b_deg = 90 }\ntool = { a_deg = 90, c_deg = -90 }\n"
           "limits = [ { min_mm = -500, max_mm = 500 }, { min_mm = -400, max_mm = 400 } ]\n" +
           first +
           "[[stage]]\n[stage.machine]\nfamily = \"serial\"\ndh = [ { joint = \"prismatic\" } ]\n"
           "limits = [ { min_mm = 0, max_mm = 300 } ]\n" +
           second;
  };
  const std::string own_first =
      "[stage.machine.dynamics]\nlink = [ { mass_kg = 90 }, { mass_kg = 30 } ]\npayload = { mass_kg = 77 }\n"
      "friction = [5, 6]\ngravity_m_per_s2 = [1, 2, 3]\n";
  const std::string own_second =
      "[stage.machine.dynamics]\nlink = [ { mass_kg = 20 } ]\nplatform = { mass_kg = 4 }\ndrive_inertia = 0.2\n";
  const std::string of_whole =
      "[dynamics]\nfriction = [5, 6, 0]\ndrive_inertia = [0, 0, 0.2]\n"
      "[[dynamics.stage]]\nlink = [ { mass_kg = 90 }, { mass_kg = 30 } ]\n"
      "[[dynamics.stage]]\nlink = [ { mass_kg = 20 } ]\nplatform = { mass_kg = 4 }\n";
  const auto forces = [](const std::string& path) {
    const AnyMachine m = *machine::load(path, {});
    const auto d = read_dynamics(path, m);
    EXPECT_TRUE(d && *d) << path;
    const Pose X{Mat3::Identity(), Vec3(0.1, -0.05, 0.12)};
    JointSeries at = still_at(X, kinematics::inverse(m, X).solutions.at(0).joints);
    at.first = Vec3(0.1, -0.2, 0.3);
    at.second = Vec3(1, 2, -3);
    return drive_forces(m, **d, at);
  };
  const std::string own = written("stages-own.toml", head + stages(own_first, own_second)),
                    whole = written("stages-whole.toml", head + stages("", "") + of_whole),
                    both = written("stages-both.toml", head + stages(own_first, own_second) + of_whole);
  const JointVector expected = forces(whole);
  EXPECT_GT(expected.norm(), 100);
  EXPECT_LT((forces(own) - expected).norm(), 1e-9 * expected.norm());
  EXPECT_LT((forces(both) - expected).norm(), 1e-9 * expected.norm());
  EXPECT_EQ((*read_dynamics(both, *machine::load(both, {})))->not_read, (std::vector<int>{1, 2}));
  EXPECT_TRUE((*read_dynamics(own, *machine::load(own, {})))->not_read.empty());
  // The tool of the whole stands for what the last stage carries.
  const std::string tool =
      written("stages-tool.toml", head + stages(own_first, own_second) + "[dynamics]\nplatform = { mass_kg = 4 }\n");
  EXPECT_LT((forces(tool) - expected).norm(), 1e-12 * expected.norm());
  EXPECT_EQ((*read_dynamics(tool, *machine::load(tool, {})))->left_out,
            (std::vector<std::string>{"stage 1 gravity", "stage 1 payload", "stage 2 platform"}));
  // As a table of the whole, which info -o writes.
  const Dynamics of_stages = **read_dynamics(own, *machine::load(own, {}));
  EXPECT_TRUE(of_stages.of_stages);
  const std::string again = written("stages-again.toml", head + stages("", "") + to_toml(of_stages));
  EXPECT_LT((forces(again) - expected).norm(), 1e-12 * expected.norm());
  EXPECT_FALSE(*read_dynamics(written("stages-none.toml", head + stages("", "")), *machine::load(own, {})));
}

// What is written reads back as it was.
TEST(Dynamics, TheTableAsText) {
  const std::string text =
      "[dynamics]\nplatform = { mass_kg = 3, center_mm = [1, 2, 3], inertia_kg_m2 = [1, 2, 2.5, 0.1, 0.2, 0.3] }\n"
      "payload = { mass_kg = 0.5 }\n"
      "strut = { fixed_mass_kg = 2, fixed_center_mm = 20, fixed_inertia_kg_m2 = 0.1, moving_mass_kg = 1, "
      "moving_center_mm = "
      "-7, moving_inertia_kg_m2 = 0.02 }\ngravity_m_per_s2 = [0, 1, -9]\ndrive_inertia = [1, 2, 3, 4, 5, 6]\n"
      "friction = 4\nviscous = 0.5\ndamping_ratio = 0.07\n";
  const AnyMachine strut = load("hexapod-strut");
  const std::string path = written("as-text.toml", text);
  const Dynamics first = **read_dynamics(path, strut);
  const std::string written_text = to_toml(first, *read_damping(path));
  const std::string again = written("as-text-again.toml", written_text);
  EXPECT_EQ(to_toml(**read_dynamics(again, strut), *read_damping(again)), written_text);
  const Dynamics second = **read_dynamics(again, strut);
  EXPECT_LT((second.platform->inertia - first.platform->inertia).norm(), 1e-15);
  EXPECT_NEAR(second.strut_moving_center, -0.007, 1e-15);
  EXPECT_EQ(second.gravity, first.gravity);
  EXPECT_EQ(second.drive, first.drive);
  EXPECT_EQ(second.friction, first.friction);
  // Of an arm one body a row, those without mass too.
  const AnyMachine arm = load("lola50");
  const std::string links = written("links.toml",
                                    "[dynamics]\nlink = [ { mass_kg = 1 }, { mass_kg = 0 }, { mass_kg = 2, "
                                    "center_mm = [0, 5, 0] }, { mass_kg = 0 }, { mass_kg = 0 } ]\n");
  const auto of_arm = read_dynamics(links, arm);
  ASSERT_TRUE(of_arm) << to_string(of_arm.error());
  const Dynamics back = **read_dynamics(written("links-again.toml", to_toml(**of_arm)), arm);
  ASSERT_EQ(back.links.size(), 5U);
  EXPECT_EQ(back.links[2]->mass, 2);
  EXPECT_NEAR(back.links[2]->center.y(), 0.005, 1e-15);
}

}  // namespace
}  // namespace polypod::motion
