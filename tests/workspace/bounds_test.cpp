// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The parts of the proof one by one, against sampling: what is stated for a whole box or patch holds at random points.
#include <gtest/gtest.h>

#include <random>

#include "../families/hexapod/bounds.hpp"
#include "half_space.hpp"
#include "patches.hpp"

namespace polypod::workspace {
namespace {

// Rounding of unit vectors and of sums of a few of them.
constexpr double kRound = 1e-13;

struct Random {
  std::mt19937 engine{20260903};
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
  Vec3 vector(double size) { return {(*this)(-size, size), (*this)(-size, size), (*this)(-size, size)}; }
};

TEST(HalfSpace, ClosedForms) {
  const Vec3 half(1, 2, 3);
  for (const bool below : {true, false}) {
    EXPECT_NEAR(share_in_half_space(0, Vec3(1, 1, 1), half, below), 0.5, 1e-6);
    EXPECT_NEAR(share_in_half_space(0.5, Vec3(1, 0, 0), half, below), 0.75, 1e-6);  // a slab
    // A corner: x + y + z >= 2 of the unit cube leaves a simplex of volume 1/6 of 8.
    EXPECT_NEAR(share_in_half_space(-2, Vec3(1, 1, 1), Vec3::Ones(), below), 1.0 / 48, 1e-6);
    EXPECT_NEAR(share_in_half_space(-0.5, Vec3(1, 0.5, 0), Vec3::Ones(), below), 0.25, 1e-6);  // a wedge
    EXPECT_EQ(share_in_half_space(10, Vec3(1, 1, 1), half, below), 1.0);
    EXPECT_EQ(share_in_half_space(-10, Vec3(1, 1, 1), half, below), 0.0);
  }
}

TEST(HalfSpace, BoundsEncloseTheShare) {
  Random random;
  for (int k = 0; k < 200; ++k) {
    Vec3 G = random.vector(1);
    if (k % 3 == 0) G[k % 9 / 3] *= 1e-5;  // a direction that hardly counts
    const Vec3 half(random(0.1, 2), random(0.1, 2), random(0.1, 2));
    const double m = random(-1, 1) * G.cwiseAbs().dot(half);
    // Integrate over z exactly, over x and y by the middle rule.
    double inside = 0;
    constexpr int kSteps = 200;
    for (int i = 0; i < kSteps; ++i)
      for (int j = 0; j < kSteps; ++j) {
        const double x = (2 * (i + 0.5) / kSteps - 1) * half[0], y = (2 * (j + 0.5) / kSteps - 1) * half[1];
        const double rest = m + G[0] * x + G[1] * y;
        const double z = -rest / G[2];
        const double share = G[2] > 0 ? (half[2] - z) / (2 * half[2]) : (z + half[2]) / (2 * half[2]);
        inside += std::clamp(share, 0.0, 1.0);
      }
    inside /= kSteps * kSteps;
    constexpr double kMiddleRule = 2e-4;
    const double low = share_in_half_space(m, G, half, true), high = share_in_half_space(m, G, half, false);
    EXPECT_LE(low, inside + kMiddleRule);
    EXPECT_GE(high, inside - kMiddleRule);
    EXPECT_LE(low, high);
    EXPECT_LT(high - low, 1e-3);
  }
}

TEST(Clip, AgreesWithSharesAndSampling) {
  Random random;
  Polyhedron body;
  for (int k = 0; k < 100; ++k) {
    const Vec3 half(random(0.1, 2), random(0.1, 2), random(0.1, 2));
    const double whole = 8 * half.prod();
    std::vector<std::pair<double, Vec3>> planes;
    for (int i = 0; i < 4; ++i) {
      const Vec3 G = random.vector(1);
      planes.emplace_back(random(-0.1, 0.8) * G.cwiseAbs().dot(half), G);
    }
    body.start(half);
    EXPECT_NEAR(body.volume(), whole, 1e-12 * whole);
    body.cut(planes[0].first, planes[0].second);
    const double one = share_in_half_space(planes[0].first, planes[0].second, half, true);
    EXPECT_NEAR(body.volume() / whole, one, 1e-3);
    body.cut(planes[0].first, planes[0].second);  // again: nothing changes
    EXPECT_NEAR(body.volume() / whole, one, 1e-3);
    for (int i = 1; i < 4; ++i)
      body.cut(planes[static_cast<std::size_t>(i)].first, planes[static_cast<std::size_t>(i)].second);
    int inside = 0;
    constexpr int kSamples = 20000;
    for (int i = 0; i < kSamples; ++i) {
      const Vec3 x = Vec3(random(-1, 1), random(-1, 1), random(-1, 1)).cwiseProduct(half);
      inside += std::all_of(planes.begin(), planes.end(), [&](const auto& p) { return p.first + p.second.dot(x) >= 0; })
                    ? 1
                    : 0;
    }
    // Four standard errors of a share near one half.
    EXPECT_NEAR(body.volume() / whole, inside / double(kSamples), 4 * 0.5 / std::sqrt(double(kSamples)));
  }
}

/// A point of a patch, as an orientation and as parameters from the reference point.
struct PatchPoint {
  Mat3 R;
  Eigen::Vector2d at;
};
PatchPoint point_of(const Patch& p, double s, double t) {
  const double a = p.low[0] + s * (p.high[0] - p.low[0]), b = p.low[1] + t * (p.high[1] - p.low[1]);
  if (p.sector) {
    const Eigen::Vector2d at(a * std::cos(b), a * std::sin(b));
    return {rotation_of(Vec3(-at[1], at[0], 0)), at - p.reference};
  }
  const Eigen::Vector2d middle(0.5 * (p.low[0] + p.high[0]), 0.5 * (p.low[1] + p.high[1]));
  return {rotation_y(b) * rotation_x(a), Eigen::Vector2d(a, b) - middle};
}

void check_patch(const Patch& p, Random& random) {
  for (int k = 0; k < 100; ++k) {
    const PatchPoint x = point_of(p, k == 0 ? 0.0 : random(0, 1), k == 1 ? 1.0 : random(0, 1));
    const Vec3 b = random.vector(1).normalized();
    const Vec3 v = p.R * b;
    const Vec3 linear = v + p.omega1.cross(v) * x.at[0] + p.omega2.cross(v) * x.at[1];
    EXPECT_LE((x.R * b - linear).norm(), p.bend + kRound);
    EXPECT_LE((x.R * b - v).norm(), p.turn + kRound);
    const double s1 = random(-1, 1), s2 = random(-1, 1);
    EXPECT_GE(s1 * x.at[0] + s2 * x.at[1], p.least(s1, s2) - kRound);
  }
  // The least value is taken on: some point of a fine rim comes close to it.
  const double s1 = random(-1, 1), s2 = random(-1, 1);
  double least = 10;
  for (int i = 0; i <= 400; ++i)
    for (const double r : {0.0, 1.0}) {
      for (const PatchPoint& x : {point_of(p, r, i / 400.0), point_of(p, i / 400.0, r)}) {
        least = std::min(least, s1 * x.at[0] + s2 * x.at[1]);
      }
    }
  EXPECT_NEAR(least, p.least(s1, s2), 1e-4);
}

TEST(Patches, FirstOrderAndRestHoldOverSectors) {
  Random random;
  check_patch(make_sector({0, 0}, {0.35, 2 * std::numbers::pi}), random);
  for (int k = 0; k < 100; ++k) {
    const double top = random(0.05, 1.2), low = random(0, 1) * top, start = random(0, 6), width = random(0.02, 3.1);
    check_patch(make_sector({low, start}, {top, start + width}), random);
  }
}

TEST(Patches, FirstOrderAndRestHoldOverRanges) {
  Random random;
  for (int k = 0; k < 100; ++k) {
    const double a = random(-1.5, 1.5), b = random(-1.5, 1.5);
    check_patch(make_rectangle({a, b}, {a + random(0, 0.8), b + random(0, 0.8)}), random);
  }
}

TEST(Patches, HalvesCoverThePatch) {
  const auto prepare = [](const Patch&) { return 0; };
  const PatchNode<int> root(make_sector({0, 0}, {0.35, 2 * std::numbers::pi}), prepare);
  const PatchNode<int>* node = &root;
  for (int k = 0; k < 12; ++k) {
    const Patch &a = node->half(0, prepare).patch(), &b = node->half(1, prepare).patch(), &p = node->patch();
    const int axis = a.high[0] < p.high[0] ? 0 : 1;
    EXPECT_EQ(a.high[axis], b.low[axis]);
    EXPECT_EQ(a.low[axis], p.low[axis]);
    EXPECT_EQ(b.high[axis], p.high[axis]);
    EXPECT_EQ(a.low[1 - axis], p.low[1 - axis]);
    EXPECT_EQ(b.high[1 - axis], p.high[1 - axis]);
    node = &node->half(k % 2, prepare);
  }
  EXPECT_LT(node->patch().turn, 0.05);
}

/// Verdicts about a leg over a random cell and patch against the limits at random points of both.
template <class Limits, class Hexapod>
void check_verdicts(const Hexapod& m, LimitBits (*broken)(const Hexapod&, const Pose&, int leg), Vec3 middle) {
  Options options;
  const Limits limits(m, options);
  Random random;
  int inside = 0, dead = 0, undecided = 0;
  for (int k = 0; k < 4000; ++k) {
    const double size = std::pow(10.0, random(-3.5, -1.8));
    const Vec3 half(size, size * random(0.3, 1), size * random(0.3, 1));
    const Vec3 center = middle + random.vector(0.05);
    const double top = random(0, 0.4), start = random(0, 6);
    const Patch patch = make_sector({std::max(0.0, top - size * 30), start}, {top, start + random(0, 0.5)});
    const auto data = limits.prepare(patch);
    for (int leg = 0; leg < kLegs; ++leg) {
      BoundList bounds;
      const Verdict verdict = limits.judge(leg, center, half, half.norm(), patch, data, bounds);
      bool all_broken = true, none_broken = true;
      std::vector<bool> holds(static_cast<std::size_t>(bounds.size()), false);
      for (int sample = 0; sample < 12; ++sample) {
        Vec3 x(random(-1, 1), random(-1, 1), random(-1, 1));
        if (sample < 8) x = Vec3(sample & 1 ? 1 : -1, sample & 2 ? 1 : -1, sample & 4 ? 1 : -1);  // the corners
        x = x.cwiseProduct(half);
        Pose X{point_of(patch, sample == 0 ? 1.0 : random(0, 1), random(0, 1)).R, center + x};
        const bool is_broken = broken(m, X, leg) != 0;
        all_broken = all_broken && is_broken;
        none_broken = none_broken && !is_broken;
        // A broken limit must be foreseen by one of the lower planes.
        if (is_broken && verdict == Verdict::undecided) {
          bool foreseen = false;
          for (const Bound& b : bounds) foreseen = foreseen || b.m + b.G.dot(x) < 0;
          EXPECT_TRUE(foreseen) << "leg " << leg + 1;
        }
      }
      if (verdict == Verdict::inside) {
        ++inside;
        EXPECT_TRUE(none_broken) << "leg " << leg + 1 << " cell " << k;
      } else if (verdict == Verdict::dead) {
        ++dead;
        EXPECT_TRUE(all_broken) << "leg " << leg + 1 << " cell " << k;
      } else {
        ++undecided;
      }
    }
  }
  // The test says nothing unless all answers occur.
  EXPECT_GT(inside, 500);
  EXPECT_GT(dead, 500);
  EXPECT_GT(undecided, 500);
}

LimitBits leg_bits(int leg) {
  LimitBits bits = 0;
  for (const int first : {0, 6, 12, 18, 39}) bits |= LimitBits{1} << (first + leg);
  return bits;
}

TEST(HexapodBounds, VerdictsAboutStrutsHoldAtEveryPoint) {
  const auto any = *machine::load("hexapod-strut");
  const auto& m = std::get<StrutHexapod>(any);
  check_verdicts<StrutLimits, StrutHexapod>(
      m,
      [](const StrutHexapod& h, const Pose& X, int leg) {
        return inverse(h, X).solutions[0].violations & leg_bits(leg);
      },
      Vec3(0, 0, 0.07));
}

LimitBits broken_slider(const SliderHexapod& h, const Pose& X, int leg) {
  machine::SliderRoots roots[kLegs];
  machine::slider_roots(h, X, roots);
  if (!roots[leg].real) return 1;
  machine::JointVector q(kLegs);
  for (int i = 0; i < kLegs; ++i) {
    const bool outer_off = roots[i].outer < 0 || roots[i].outer > h.rail_length[i];
    const bool inner_on = roots[i].inner >= 0 && roots[i].inner <= h.rail_length[i];
    q[i] = outer_off && inner_on ? roots[i].inner : roots[i].outer;
  }
  const auto p = kinematics::nominal_parameters(h);
  return kinematics::violated(limits(h, X, std::span<const double>(q.data(), 6), std::span<const double>(p))) &
         leg_bits(leg);
}

TEST(HexapodBounds, VerdictsAboutSlidersHoldAtEveryPoint) {
  const auto any = *machine::load("hexapod-slider");
  check_verdicts<SliderLimits, SliderHexapod>(std::get<SliderHexapod>(any), broken_slider, Vec3(0, 0, 0.095));
}

// Rails that fall inwards use both roots within one workspace.
TEST(HexapodBounds, VerdictsHoldWhereBothRootsAreInUse) {
  const auto any = *machine::load("hexapod-slider", {{"rail.inner_height_mm", "-45"}, {"joint.cone_deg", "80"}});
  check_verdicts<SliderLimits, SliderHexapod>(std::get<SliderHexapod>(any), broken_slider, Vec3(0, 0, 0.03));
}

}  // namespace
}  // namespace polypod::workspace
