// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/force.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::aluminium;
using samples::between;
using samples::end_mill;
using samples::kPi;

constexpr double kPrinted = 0.5;      // N; the facts give whole newtons, or tenths
constexpr double kTenth = 0.05;       // N
constexpr double kAgreement = 1e-3;   // between discs and closed form, as the requirement says
constexpr double kQuadrature = 1e-6;  // of the test's own quadrature, 20 000 points

// The definition, point by point: N_z a / (2 pi) times the sum over the engagement, in a grid that is finer where the
// power of a small chip bends (phi = pi w^2 (3 - 2 w)).
Vec3 mean_by_points(const Cutter& cutter, const Material& m, const Engagement& e, double feed) {
  constexpr int kPoints = 20'000;
  Vec3 sum = Vec3::Zero();
  double used = 0;
  for (int i = 0; i < kPoints; ++i) {
    const double w = (i + 0.5) / kPoints;
    const double phi = e.entry + (e.exit - e.entry) * w * w * (3 - 2 * w);
    const double weight = (e.exit - e.entry) * 6 * w * (1 - w) / kPoints;
    const double h = std::pow(feed * std::sin(phi), m.exponent);
    const double ft = m.kte + m.ktc * h, fr = m.kre + m.krc * h, fa = m.kae + m.kac * h;
    sum += weight * Vec3(-ft * std::cos(phi) - fr * std::sin(phi), ft * std::sin(phi) - fr * std::cos(phi), fa);
    used += weight;
  }
  EXPECT_NEAR(used, e.exit - e.entry, 1e-7);
  return cutter.teeth * e.depth / (2 * kPi) * sum;
}

TEST(MeanForce, ReproducesTheContourTests) {
  const Cutter cutter = end_mill();
  const Vec3 f = mean_force(cutter, aluminium(), straight_engagement(cutter, CutSide::down, 4e-3, 2e-3), 5e-5);
  EXPECT_NEAR(f.x(), 5.4, kTenth);
  EXPECT_NEAR(f.y(), 110, kPrinted);
  EXPECT_NEAR(f.z(), 8.5, kTenth);
}

TEST(MeanForce, ReproducesTheGrooveTest) {
  const Cutter cutter = end_mill(3);
  const Vec3 f = mean_force(cutter, aluminium(), straight_engagement(cutter, CutSide::slot, 8e-3, 2e-3), 5e-5);
  EXPECT_NEAR(f.y(), 103, kPrinted);
}

TEST(MeanForce, IsTheIntegralOfItsDefinition) {
  EXPECT_TRUE(rc::check("mean force against points", [] {
    Material m = aluminium();
    const double exponents[] = {1, 0.999, 0.8, 0.5, 0.25, 0.05};
    m.exponent = *rc::gen::elementOf(std::vector<double>(exponents, exponents + 6));
    const double scale = std::pow(5e-5, 1 - m.exponent);  // keeps the size of the forces
    m.ktc *= scale, m.krc *= scale, m.kac *= scale;
    const double entry = between(0, kPi), exit = between(entry, kPi), feed = between(1e-6, 2e-4);
    const Engagement e{entry, exit, 2e-3};
    const Vec3 closed = mean_force(end_mill(), m, e, feed), points = mean_by_points(end_mill(), m, e, feed);
    RC_ASSERT((closed - points).norm() <= kQuadrature * (1 + points.norm()));
  }));
}

TEST(MeanForce, ZeroWithoutEngagement) {
  EXPECT_EQ(mean_force(end_mill(), aluminium(), {1, 1, 2e-3}, 5e-5), Vec3::Zero());
  EXPECT_EQ(mean_force(end_mill(), aluminium(), {1, 2, 0}, 5e-5), Vec3::Zero());
  EXPECT_EQ(mean_force(end_mill(), aluminium(), {2, 1, 2e-3}, 5e-5), Vec3::Zero());
}

TEST(MeanForce, UpAndDownMillingMirrorEachOther) {
  // Reversed in phi -> pi - phi: the sine parts stay, the cosine parts change sign.
  const Cutter cutter = end_mill();
  Material tangential = aluminium();
  tangential.krc = tangential.kre = 0;
  const Vec3 up = mean_force(cutter, tangential, straight_engagement(cutter, CutSide::up, 3e-3, 2e-3), 5e-5);
  const Vec3 down = mean_force(cutter, tangential, straight_engagement(cutter, CutSide::down, 3e-3, 2e-3), 5e-5);
  EXPECT_NEAR(up.x(), -down.x(), 1e-9);
  EXPECT_LT(up.x(), -1);  // up-milling pushes the tool against its feed
  EXPECT_NEAR(up.y(), down.y(), 1e-9);
  EXPECT_NEAR(up.z(), down.z(), 1e-9);
}

TEST(StraightEngagement, ClosedForms) {
  const Cutter cutter = end_mill();
  const Engagement down = straight_engagement(cutter, CutSide::down, 4e-3, 2e-3);
  EXPECT_NEAR(down.entry, kPi / 2, 1e-12);
  EXPECT_EQ(down.exit, kPi);
  const Engagement up = straight_engagement(cutter, CutSide::up, 2e-3, 2e-3);
  EXPECT_EQ(up.entry, 0);
  EXPECT_NEAR(up.exit, kPi / 3, 1e-12);
  const Engagement slot = straight_engagement(cutter, CutSide::slot, 1, 3e-3);
  EXPECT_EQ(slot.entry, 0);
  EXPECT_EQ(slot.exit, kPi);
  EXPECT_EQ(slot.depth, 3e-3);
  const Engagement wide = straight_engagement(cutter, CutSide::up, 9e-3, 2e-3);
  EXPECT_NEAR(wide.exit, kPi, 1e-7);
}

TEST(ForceHistory, MeanIsTheClosedForm) {
  EXPECT_TRUE(rc::check("history against closed form", [] {
    Cutter cutter = end_mill(*samples::whole(1, 9));
    cutter.helix = units::from_deg(between(0, 60));
    Material m = aluminium();
    const double entry = between(0, kPi - 0.01), exit = entry + between(0.005, 1) * (kPi - entry);
    const Engagement e{entry, exit, between(1e-4, 6e-3)};
    const double feed = between(5e-6, 2e-4);
    const int steps = *samples::whole(120, 721);
    const Vec3 mean = force_history(cutter, m, {e}, feed, steps).mean, closed = mean_force(cutter, m, e, feed);
    RC_ASSERT((mean - closed).norm() <= kAgreement * closed.norm());
  }));
}

TEST(ForceHistory, MeanOfATinyEngagementBetweenTheSteps) {
  const Cutter cutter = end_mill();
  const Engagement e{1.0, 1.0 + units::from_deg(0.2), 1e-3};  // a fifth of a step
  const Vec3 mean = force_history(cutter, aluminium(), {e}, 5e-5, 360).mean;
  const Vec3 closed = mean_force(cutter, aluminium(), e, 5e-5);
  EXPECT_LE((mean - closed).norm(), kAgreement * closed.norm());
}

TEST(ForceHistory, MeanWithAnotherExponent) {
  Material m = aluminium();
  m.exponent = 0.7;
  const Engagement e{0.3, kPi, 2e-3};
  const Vec3 mean = force_history(end_mill(), m, {e}, 5e-5).mean, closed = mean_force(end_mill(), m, e, 5e-5);
  EXPECT_LE((mean - closed).norm(), kAgreement * closed.norm());
}

TEST(ForceHistory, OneStraightToothIsTheForceAtItsAngle) {
  Cutter cutter = end_mill(1);
  cutter.helix = 0;
  const Material m = aluminium();
  const Engagement e{0, kPi, 1e-3};
  const ForceHistory history = force_history(cutter, m, {e}, 5e-5);
  ASSERT_EQ(history.force.size(), 360u);
  for (int k = 1; k < 360; ++k) {
    if (k == 180) continue;  // half a step there
    const double phi = history.angle[k], s = std::sin(phi), c = std::cos(phi);
    Vec3 expected = Vec3::Zero();
    if (phi < kPi) {
      const double ft = (m.kte + m.ktc * 5e-5 * s) * 1e-3, fr = (m.kre + m.krc * 5e-5 * s) * 1e-3;
      expected = {-ft * c - fr * s, ft * s - fr * c, (m.kae + m.kac * 5e-5 * s) * 1e-3};
    }
    EXPECT_LE((history.force[k] - expected).norm(), 1e-9) << "step " << k;
  }
  // The largest F_z is at phi = pi/2, the largest F_y near it.
  EXPECT_NEAR(history.peak.z(), (m.kae + m.kac * 5e-5) * 1e-3, 1e-9);
  EXPECT_GT(history.peak.y(), history.mean.y());
}

TEST(ForceHistory, RepeatsWithEveryTooth) {
  const Cutter cutter = end_mill(4);
  const ForceHistory history =
      force_history(cutter, aluminium(), {straight_engagement(cutter, CutSide::down, 3e-3, 3e-3)}, 5e-5);
  for (int k = 0; k < 270; ++k) EXPECT_LE((history.force[k] - history.force[k + 90]).norm(), 1e-9);
}

TEST(ForceHistory, HelixDelaysTheUpperDiscs) {
  // A thin disc at height z is a straight tooth turned back by 2 tan(helix) z / D: seen in a step of the stock whose
  // upper half alone is met, the first force comes later.
  Cutter cutter = end_mill(1);
  const Engagement e{0, kPi / 2, 2e-3};
  Cutter straight = cutter;
  straight.helix = 0;
  const auto last_angle = [&](const Cutter& c) {
    const ForceHistory h = force_history(c, aluminium(), {e}, 5e-5, 720);
    double last = 0;
    for (std::size_t k = 0; k < h.force.size(); ++k) {
      if (h.force[k].norm() > 0 && h.angle[k] < kPi) last = h.angle[k];
    }
    return last;
  };
  const double lag = 2 * std::tan(cutter.helix) * 2e-3 / cutter.diameter;
  constexpr double kStepAndDisc = 2 * kPi / 720 + 0.015;  // rad; one step and half a disc's lag
  EXPECT_NEAR(last_angle(cutter) - last_angle(straight), lag, kStepAndDisc);
}

TEST(ForceHistory, EngagementsAdd) {
  const Cutter cutter = end_mill();
  const Engagement a{0.2, 0.9, 2e-3}, b{1.5, 2.9, 1e-3};
  const ForceHistory both = force_history(cutter, aluminium(), {a, b}, 5e-5);
  const ForceHistory first = force_history(cutter, aluminium(), {a}, 5e-5);
  const ForceHistory second = force_history(cutter, aluminium(), {b}, 5e-5);
  for (std::size_t k = 0; k < both.force.size(); ++k) {
    EXPECT_LE((both.force[k] - first.force[k] - second.force[k]).norm(), 1e-9);
  }
}

TEST(ForceHistory, FewStepsAreRaisedToTheLeast) {
  const ForceHistory h = force_history(end_mill(), aluminium(), {{0, kPi, 1e-3}}, 5e-5, 0);
  EXPECT_EQ(h.force.size(), 8u);
  EXPECT_TRUE(h.mean.allFinite());
}

}  // namespace
}  // namespace polypod::cutting
