// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Vibration from modes: against closed forms of one and two masses, and against an integration over time of an arm
// whose matrices are written out here.
#include "polypod/motion/vibration.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <complex>
#include <numbers>

#include "machines.hpp"
#include "motion/masses.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::motion {
namespace {

using test::load;
using Complex = std::complex<double>;
constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kRounding = 1e-10;  // relative: an eigenvalue problem of two or five unknowns

/// Masses on slides along z, one on the other, each with its compliance.
AnyMachine slides(const std::vector<double>& compliances) {
  std::string rows, limits, values;
  for (const double c : compliances) {
    rows += "{ joint = \"prismatic\" }, ";
    limits += "{ min_mm = -100, max_mm = 100 }, ";
    values += fmt::format("{}, ", c);
  }
  return AnyMachine(test::arm_of(
      fmt::format("family = \"serial\"\ntask = [\"z\"]\ndh = [{}]\nlimits = [{}]\ncompliance_rad_per_Nm = [{}]\n", rows,
                  limits, values)));
}
Dynamics of_masses(const std::vector<double>& masses) {
  Dynamics out;
  for (const double mass : masses) {
    Body b;
    b.mass = mass;
    out.links.emplace_back(b);
  }
  return out;
}
ModalModel model_of(const AnyMachine& m, const Dynamics& d, const JointVector& q) {
  return modal_model(m, d, kinematics::forward(m, q).poses.front(), q);
}

/// F cos(w t) on m u'' + 2 zeta w_0 m u' + k u: amplitude F / k / sqrt((1 - r^2)^2 + (2 zeta r)^2), r = w / w_0.
TEST(Vibration, OneMassHasTheAmplitudeOfTheClosedForm) {
  const double mass = 5, k = 2e5, zeta = 0.04, F = 80, f0 = std::sqrt(k / mass) / kTurn;
  const ModalModel model = model_of(slides({1 / k}), of_masses({mass}), JointVector::Zero(1));
  ASSERT_EQ(model.modes.size(), 1U);
  EXPECT_NEAR(model.modes[0].frequency, f0, kRounding * f0);
  EXPECT_NEAR(model.modes[0].shape[2], model.modes[0].shape[2] > 0 ? 1 / std::sqrt(mass) : -1 / std::sqrt(mass), 1e-12);
  PeriodicForce force;
  force.harmonics = {Phasor(0, 0, F)};
  for (const double r : {0.1, 0.7, 0.99, 1.0, 1.3, 6.0}) {
    const double want = F / k / std::hypot(1 - r * r, 2 * zeta * r);
    const Vibration got = steady_state(model, zeta, force, r * f0, Mat3::Identity(), 4096);
    EXPECT_FALSE(got.unbounded);
    EXPECT_NEAR(got.amplitude, want, 2e-6 * want) << r;  // the largest of 4096 instants: cos(pi / 4096) = 1 - 3e-7
    EXPECT_NEAR(got.peak.z(), want, 2e-6 * want);
    EXPECT_EQ(got.peak.x(), 0);
    const Complex H = (*receptance(model, zeta, r * f0))(2, 2);
    EXPECT_NEAR(std::abs(H), want / F, kRounding * want / F);
    EXPECT_NEAR(std::arg(H), -std::atan2(2 * zeta * r, 1 - r * r), 1e-9);
  }
}

/// Two undamped masses in a row, pushed at the outer one: u_2 / F = (k_1 + k_2 - m_1 w^2) / det(K - w^2 M).
TEST(Vibration, TwoMassesInARow) {
  const double m1 = 4, m2 = 3, k1 = 1e5, k2 = 0.5e5;
  const ModalModel model = model_of(slides({1 / k1, 1 / k2}), of_masses({m1, m2}), JointVector::Zero(2));
  for (const double f : {0.0, 3.0, 12.0, 19.0, 24.0, 31.0, 200.0}) {
    const double w2 = std::pow(kTurn * f, 2);
    const double det = (k1 + k2 - m1 * w2) * (k2 - m2 * w2) - k2 * k2;
    const double want = (k1 + k2 - m1 * w2) / det;
    const Complex got = (*receptance(model, 0, f))(2, 2);
    EXPECT_NEAR(got.real(), want, 1e-9 * std::abs(want)) << f;
    EXPECT_EQ(got.imag(), 0);
  }
}

/// Undamped, with a harmonic at a mode's own frequency, there is no steady state: it is named, and no figure is given.
TEST(Vibration, AnUndampedResonanceIsNamed) {
  const double m1 = 4, m2 = 3, k1 = 1e5, k2 = 0.5e5;
  const ModalModel model = model_of(slides({1 / k1, 1 / k2}), of_masses({m1, m2}), JointVector::Zero(2));
  const double f1 = model.modes[1].frequency;
  PeriodicForce force;
  force.harmonics = {Phasor(0, 0, 10), Phasor(0, 0, 5), Phasor(0, 0, 2)};
  const Vibration got = steady_state(model, 0, force, f1 / 3);
  ASSERT_TRUE(got.unbounded);
  EXPECT_EQ(got.unbounded->mode, 1);
  EXPECT_EQ(got.unbounded->harmonic, 3);
  EXPECT_EQ(got.amplitude, 0);
  EXPECT_TRUE(got.path.empty());
  EXPECT_FALSE(receptance(model, 0, f1));
  // A harmonic that pushes across the mode does not excite it; nor is there anything with damping, or beside it.
  force.harmonics[2] = Phasor(2, 0, 0);
  EXPECT_FALSE(steady_state(model, 0, force, f1 / 3).unbounded);
  force.harmonics[2] = Phasor(0, 0, 2);
  EXPECT_FALSE(steady_state(model, 1e-4, force, f1 / 3).unbounded);
  const Vibration beside = steady_state(model, 0, force, f1 / 3 * (1 + 1e-5));
  EXPECT_FALSE(beside.unbounded);
  EXPECT_TRUE(std::isfinite(beside.amplitude));
}

/// At frequency 0 the receptance is the static compliance, of machines of every kind; the natural frequencies are those
/// that `move` states.
TEST(Vibration, AtRestItIsTheStaticCompliance) {
  for (const char* name : {"lola50", "hexapod-strut", "delta-brno", "tricept"}) {
    AnyMachine m = load(name);
    std::vector<double> c = statics::column_compliances(m);
    for (std::size_t k = 0; k < c.size(); ++k) c[k] = (1.0 + 0.3 * static_cast<double>(k)) * 1e-7;
    m = *statics::with_compliances(m, c);
    Dynamics d = legs_with_masses();
    d.platform = Body{3.0, Vec3(0.01, 0.02, 0.03), Vec3(0.02, 0.03, 0.04).asDiagonal()};
    if (const auto* arm = std::get_if<machine::SerialArm>(&m))
      d.links.assign(arm->dh.size(), Body{4.0, Vec3(0.1, 0, 0), Vec3(0.1, 0.1, 0.1).asDiagonal()});
    const Pose X = kinematics::home_pose(m).value_or(Pose{Mat3::Identity(), Vec3(0, -1.3, 0)});
    const JointVector q = kinematics::inverse(m, X).solutions.front().joints;
    const Pose at = kinematics::settled(m, X, q);
    const ModalModel model = modal_model(m, d, at, q);
    ASSERT_GE(model.modes.size(), 3U) << name;
    const Mat6 want = statics::compliance_at(m, at).C;
    EXPECT_LT((model.compliance() - want).norm(), 1e-9 * want.norm()) << name;
    EXPECT_LT(((*receptance(model, 0.03, 0)) - want.topLeftCorner<3, 3>()).norm(), 1e-9 * want.norm()) << name;
    const std::vector<double> f = natural_frequencies(m, d, at, q);
    ASSERT_EQ(f.size(), model.modes.size());
    for (std::size_t k = 0; k < f.size(); ++k) EXPECT_NEAR(model.modes[k].frequency, f[k], 1e-12 * f[k]);
  }
}

TEST(Vibration, HarmonicsAddUpToTheForce) {
  std::vector<Vec3> samples;
  const int n = 90;
  for (int j = 0; j < n; ++j) {
    const double t = kTurn * j / n;
    samples.emplace_back(3 + 2 * std::cos(t - 0.4), std::sin(3 * t), 0.5 * std::cos(7 * t) - 1);
  }
  const PeriodicForce f = harmonics_of(samples, 10);
  ASSERT_EQ(f.harmonics.size(), 10U);
  EXPECT_LT((f.mean - Vec3(3, 0, -1)).norm(), 1e-13);
  EXPECT_LT(std::abs(f.harmonics[0].x() - std::polar(2.0, -0.4)), 1e-13);
  EXPECT_LT(std::abs(f.harmonics[2].y() - Complex(0, -1)), 1e-13);
  EXPECT_LT(std::abs(f.harmonics[6].z() - Complex(0.5, 0)), 1e-13);
  EXPECT_LT(f.harmonics[4].norm(), 1e-13);
  EXPECT_EQ(harmonics_of(samples, 100).harmonics.size(), 44U);  // 2 k < 90
}

/// Two links in a plane, turning against springs, and teeth that pass: M by the textbooks (Craig, Introduction to
/// Robotics, 6.7), D with the ratio zeta in both modes, the force by Altintas's formulas for one disc, all written out
/// here and integrated over time until nothing of the start is left.
TEST(Vibration, AnIntegrationOverTimeSettlesAtTheSameMotion) {
  const double l1 = 0.5, l2 = 0.4, c1 = 0.2, c2 = 0.15, m1 = 3, m2 = 2, I1 = 0.07, I2 = 0.03;
  const std::array<double, 2> compliance{4e-6, 9e-6};
  const AnyMachine m(test::arm_of(R"(
family = "serial"
task = ["x", "y"]
dh = [{ a_mm = 500 }, { a_mm = 400 }]
compliance_rad_per_Nm = [4e-6, 9e-6]
)"));
  Dynamics d;
  for (const auto& [mass, inertia, center] : {std::tuple{m1, I1, c1 - l1}, std::tuple{m2, I2, c2 - l2}}) {
    Body b;
    b.mass = mass;
    b.center = Vec3(center, 0, 0);
    b.inertia = Vec3(inertia, inertia, inertia).asDiagonal();
    d.links.emplace_back(b);
  }
  JointVector q(2);
  q << 0.4, 0.9;
  const double zeta = 0.05;
  const ModalModel model = model_of(m, d, q);

  // The same by hand.
  using M2 = Eigen::Matrix2d;
  using V2 = Eigen::Vector2d;
  const double k = m2 * l1 * c2, cos2 = std::cos(q[1]);
  M2 M;
  M(0, 0) = m1 * c1 * c1 + I1 + m2 * (l1 * l1 + c2 * c2) + I2 + 2 * k * cos2;
  M(0, 1) = M(1, 0) = m2 * c2 * c2 + I2 + k * cos2;
  M(1, 1) = m2 * c2 * c2 + I2;
  const M2 K = V2(1 / compliance[0], 1 / compliance[1]).asDiagonal();
  const Eigen::GeneralizedSelfAdjointEigenSolver<M2> modes(K, M);  // phi^T M phi = 1
  const V2 own = modes.eigenvalues().cwiseSqrt();
  const M2 D = M * modes.eigenvectors() * (2 * zeta * own).asDiagonal() * modes.eigenvectors().transpose() * M;
  M2 J;
  const double a = q[0], b = q[0] + q[1];
  J << -l1 * std::sin(a) - l2 * std::sin(b), -l2 * std::sin(b), l1 * std::cos(a) + l2 * std::cos(b), l2 * std::cos(b);
  for (int r = 0; r < 2; ++r) EXPECT_NEAR(model.modes[static_cast<std::size_t>(r)].frequency, own[r] / kTurn, 1e-8);

  // A straight edge, four teeth, engaged from 0.5 to 2.2 rad, chip and edge forces of one disc.
  const int teeth = 4;
  const auto force_at = [&](double turned) {
    V2 out = V2::Zero();
    for (int i = 0; i < teeth; ++i) {
      const double phi = std::remainder(turned + kTurn * i / teeth, kTurn);
      if (phi < 0.5 || phi > 2.2) continue;
      const double h = 0.05 * std::sin(phi), ft = 2 * (1000 * h + 14), fr = 2 * (180 * h + 28);
      out += V2(-ft * std::cos(phi) - fr * std::sin(phi), ft * std::sin(phi) - fr * std::cos(phi));
    }
    return out;
  };
  const int per_period = 3600;
  std::vector<Vec3> samples;
  for (int j = 0; j < per_period; ++j) {
    const V2 f = force_at(kTurn / teeth * (j + 0.5) / per_period);
    samples.emplace_back(f.x(), f.y(), 0);
  }
  const PeriodicForce force = harmonics_of(samples, 200);
  // Tooth passing near the first mode, between both, and its second harmonic on the second mode.
  for (const double f : {0.9 * own[0] / kTurn, 2.0 * own[0] / kTurn, 0.5 * own[1] / kTurn}) {
    const Vibration got = steady_state(model, zeta, force, f, Mat3::Identity(), 360);
    // RK4 with steps on the samples' bounds (the force jumps there, so each step has one force: that of its middle).
    const double h = 1 / (f * per_period);
    const M2 inverse = M.inverse();
    V2 x = V2::Zero(), v = V2::Zero();
    const int periods = static_cast<int>(std::ceil(20 / (zeta * own[0]) * f));  // exp(-20): 2e-9 of the start is left
    std::vector<V2> last;
    V2 mean = V2::Zero();
    for (int p = 0; p < periods + 1; ++p) {
      for (int j = 0; j < per_period; ++j) {
        if (p == periods) {
          last.emplace_back(J * x);
          mean += J * x / per_period;
        }
        const V2 F = J.transpose() * samples[static_cast<std::size_t>(j)].head<2>();
        const auto rate = [&](const V2& at, const V2& speed) { return V2(inverse * (F - D * speed - K * at)); };
        const V2 v1 = v, a1 = rate(x, v1);
        const V2 v2 = v + h / 2 * a1, a2 = rate(x + h / 2 * v1, v2);
        const V2 v3 = v + h / 2 * a2, a3 = rate(x + h / 2 * v2, v3);
        const V2 v4 = v + h * a3, a4 = rate(x + h * v3, v4);
        x += h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
      }
    }
    double amplitude = 0, off = 0;
    for (const V2& u : last) amplitude = std::max(amplitude, (u - mean).norm());
    EXPECT_LT((mean - (model.compliance().topLeftCorner<3, 3>() * force.mean).head<2>()).norm(), 1e-6 * mean.norm());
    EXPECT_GT(amplitude, 1e-7);
    // 200 harmonics of a force with jumps, each held for a step: the rest is some 1e-5 of the motion.
    constexpr double kRest = 1e-4;
    EXPECT_NEAR(got.amplitude, amplitude, kRest * amplitude) << f;
    // The first sample of the force stands in the middle of the first step.
    for (std::size_t j = 0; j < 360; ++j) {
      const V2 middle = 0.5 * (last[10 * j] + last[10 * j + 1]) - mean;
      off = std::max(off, (middle - got.path[j].head<2>()).norm());
    }
    EXPECT_LT(off, kRest * amplitude) << f;
  }
}

/// A mass at the tool tip hangs on the static compliance there, whatever the machine is made of.
TEST(Weight, OfAMassAtTheTipIsItsForceTimesTheStaticCompliance) {
  struct Case {
    const char* name;
    std::vector<machine::Override> sets;
  };
  for (const Case& c : {Case{"lola50", {}}, Case{"hexapod-tornado", {}}, Case{"tricept", {}}, Case{"tripod-z3", {}},
                        Case{"hexapod-slider", {{"leg.compliance_um_per_N", "0.05"}}}}) {
    const AnyMachine m = test::load(c.name, c.sets);
    Dynamics d;
    d.gravity = Vec3(1.5, -0.7, -9.4);
    d.payload.emplace();
    d.payload->mass = 12;
    JointVector q = JointVector::Zero(kinematics::joint_count(m));
    Pose X;
    if (const auto home = kinematics::home_pose(m)) {
      q = kinematics::inverse(m, *home).solutions.front().joints;
      X = kinematics::settled(m, *home, q);
    } else {
      q << 0.3, -0.4, 0.6, 0.2, 0.7;
      X = kinematics::forward(m, q).poses.front();
    }
    const statics::Compliance compliance = statics::compliance_at(m, X);
    ASSERT_TRUE(compliance.reachable) << c.name;
    Vec6 load;
    load << 12 * d.gravity, Vec3::Zero();
    const Vec6 want = compliance.C * load, got = weight_twist(m, d, X, compliance.joints);
    EXPECT_GT(want.norm(), 1e-9) << c.name;
    EXPECT_LT((got - want).norm(), 1e-9 * want.norm()) << c.name;
  }
}

/// Two links stretched out: the moment at each joint is the sum of weights times levers, its turn times its lever the
/// drop of the tip.
TEST(Weight, OfTwoLinksByTheirMoments) {
  const double a1 = 0.7, a2 = 0.4, m1 = 30, m2 = 11, g = 9.81, c1 = 2e-6, c2 = 5e-6, in_front = 0.1;
  const AnyMachine m(
      test::arm_of("family = \"serial\"\ntask = [\"x\", \"y\"]\ndh = [{ a_mm = 700 }, { a_mm = 400 }]\n"
                   "limits = [{ min_deg = -90, max_deg = 90 }, { min_deg = -90, max_deg = 90 }]\n"
                   "compliance_rad_per_Nm = [2e-6, 5e-6]\n"));
  Dynamics d;
  d.gravity = Vec3(0, -g, 0);
  for (const double mass : {m1, m2}) {
    Body b;
    b.mass = mass;
    b.center = Vec3(-in_front, 0, 0);  // from the end of the link
    d.links.emplace_back(b);
  }
  for (const double bent : {0.0, 0.5}) {
    JointVector q(2);
    q << 0, bent;
    const double lever1 = a1 - in_front, reach2 = (a2 - in_front) * std::cos(bent);
    const double moment1 = -g * (m1 * lever1 + m2 * (a1 + reach2)), moment2 = -g * m2 * reach2;
    const Vec6 got = weight_twist(m, d, kinematics::forward(m, q).poses.front(), q);
    const double tip_x = a1 + a2 * std::cos(bent), tip_y = a2 * std::sin(bent);
    const double turn1 = c1 * moment1, turn2 = c2 * moment2;
    EXPECT_NEAR(got[0], -tip_y * (turn1 + turn2), 1e-15);
    EXPECT_NEAR(got[1], tip_x * turn1 + (tip_x - a1) * turn2, 1e-15);
    EXPECT_NEAR(got[5], turn1 + turn2, 1e-15);
    EXPECT_NEAR(got[2], 0, 1e-18);
  }
}

TEST(Weight, NothingWithoutMassesOrCompliances) {
  const AnyMachine m = load("hexapod-tornado");
  const Pose home = *kinematics::home_pose(m);
  const JointVector q = kinematics::inverse(m, home).solutions.front().joints;
  EXPECT_EQ(weight_twist(m, Dynamics{}, home, q).norm(), 0);
  const AnyMachine stiff = load("hexapod-strut");
  const Pose at = *kinematics::home_pose(stiff);
  EXPECT_EQ(weight_twist(stiff, legs_with_masses(), at, kinematics::inverse(stiff, at).solutions.front().joints).norm(),
            0);
}

}  // namespace
}  // namespace polypod::motion
