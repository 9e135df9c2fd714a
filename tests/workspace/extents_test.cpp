// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The six sides of a workspace: what is certainly reached and what is certainly not exceeded, against a search by the
// inverse kinematics and against closed forms; the bound on memory.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "machines.hpp"

#include "paths.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {
namespace {

using test::load;

Options at_tilt(double deg, double tolerance) {
  Options options;
  options.directions.tilt = units::from_deg(deg);
  options.relative_tolerance = tolerance;
  return options;
}

/// Farthest points by the inverse kinematics alone, in 72 azimuths on the rim of the cone, half way in and at its axis.
class Search {
 public:
  Search(const AnyMachine& m, const Options& options)
      : m_(m), heeded_(options.interference ? options.limits : options.limits & ~interference_bits(m)) {
    const double tilt = options.directions.tilt;
    directions_.push_back(Mat3::Identity());
    for (const double share : {1.0, 0.5})
      for (int k = 0; k < 72 && tilt > 0; ++k) {
        const double azimuth = 2 * std::numbers::pi * k / 72;
        directions_.push_back(rotation_of(share * tilt * Vec3(-std::sin(azimuth), std::cos(azimuth), 0)));
      }
  }

  /// Every sampled direction, the one that failed last time first.
  bool reaches(const Vec3& p) {
    for (std::size_t k = 0; k < directions_.size(); ++k) {
      const auto result = kinematics::inverse(m_, Pose{directions_[k], p});
      const auto kept = [&](const kinematics::Solution& s) { return (s.violations & heeded_) == 0; };
      const bool any = std::holds_alternative<machine::SerialArm>(m_);
      const bool reached = any ? std::any_of(result.solutions.begin(), result.solutions.end(), kept)
                               : !result.solutions.empty() && kept(result.solutions.front());
      if (reached) continue;
      std::rotate(directions_.begin(), directions_.begin() + static_cast<std::ptrdiff_t>(k),
                  directions_.begin() + static_cast<std::ptrdiff_t>(k) + 1);
      return false;
    }
    return true;
  }

  /// Looks over a grid in `low`..`high` for points to start from.
  void scan(const Vec3& low, const Vec3& high) {
    constexpr int kSteps = 24;
    size_ = (high - low).maxCoeff();
    for (int i = 0; i < kSteps * kSteps * kSteps; ++i) {
      const Vec3 share((i % kSteps + 0.5) / kSteps, (i / kSteps % kSteps + 0.5) / kSteps,
                       (i / kSteps / kSteps + 0.5) / kSteps);
      const Vec3 p = low + share.cwiseProduct(high - low);
      if (reaches(p)) inside_.push_back(p);
    }
  }

  /// The largest value of sign * p[axis] that random steps from the best points of the scan climb to. A climb stalls in
  /// corners: while it ends below `target`, it goes on from a point half way up, if there is one near its end.
  double farthest(int axis, double sign, double target) {
    constexpr std::size_t kStarts = 2;
    constexpr int kMoreClimbs = 12;
    std::vector<Vec3> starts = inside_;
    std::stable_sort(starts.begin(), starts.end(),
                     [&](const Vec3& a, const Vec3& b) { return sign * a[axis] > sign * b[axis]; });
    if (starts.size() > kStarts) starts.resize(kStarts);
    Vec3 best = climb(starts.front(), axis, sign);
    for (const Vec3& start : starts) {
      const Vec3 p = climb(start, axis, sign);
      if (sign * p[axis] > sign * best[axis]) best = p;
    }
    for (int k = 0; k < kMoreClimbs && sign * best[axis] < target; ++k) {
      if (!rise(best, axis, 0.5 * (best[axis] + sign * target))) break;
      best = climb(best, axis, sign);
    }
    return sign * best[axis];
  }

 private:
  Vec3 climb(Vec3 p, int axis, double sign) {
    constexpr int kPatience = 200;
    std::normal_distribution<double> normal;
    for (double step = 0.05 * size_; step > 1e-6 * size_; step *= 0.5) {
      for (int failed = 0; failed < kPatience; ++failed) {
        const Vec3 next = p + step * Vec3(normal(random_), normal(random_), normal(random_));
        if (!(sign * next[axis] > sign * p[axis]) || !reaches(next)) continue;
        p = next;
        failed = 0;
      }
    }
    return p;
  }
  /// Moves p to a point near by with this coordinate; false where a fine grid finds none.
  bool rise(Vec3& p, int axis, double value) {
    constexpr int kSteps = 400;
    for (const double around : {0.005, 0.02, 0.08})
      for (int i = 0; i < kSteps * kSteps; ++i) {
        Vec3 next = p;
        next[axis] = value;
        next[(axis + 1) % 3] += around * size_ * (2.0 * (i % kSteps) / kSteps - 1);
        next[(axis + 2) % 3] += around * size_ * (2.0 * (i / kSteps) / kSteps - 1);
        if (!reaches(next)) continue;
        p = next;
        return true;
      }
    return false;
  }

  const AnyMachine& m_;
  LimitBits heeded_;
  std::vector<Mat3> directions_;
  std::vector<Vec3> inside_;
  double size_ = 0;
  std::mt19937 random_{20260911};
};

struct Case {
  std::string machine;
  double tilt_deg;
};

// Where two limits meet in an edge the climb stalls before its end, and between sampled directions the machine may
// fail: so much of the largest extent the search may be short, or beyond.
constexpr double kSearch = 2e-4;

class Sides : public testing::TestWithParam<Case> {};

TEST_P(Sides, AreWhereASearchFindsThem) {
  const AnyMachine m = load(GetParam().machine);
  Options options = at_tilt(GetParam().tilt_deg, 0.05);
  const Volume v = *volume(m, options);
  ASSERT_TRUE(v.reached);
  const double size = (v.max - v.min).maxCoeff();
  Search search(m, options);
  search.scan(v.min, v.max);
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {-1.0, 1.0}) {
      const double outer = sign > 0 ? v.max[axis] : -v.min[axis];
      const double reached = sign > 0 ? v.reached->max[axis] : -v.reached->min[axis];
      EXPECT_LE(reached, outer);
      EXPECT_LE(outer - reached, options.bounds_tolerance * size * (1 + 1e-9)) << "xyz"[axis] << " " << sign;
      const double found = search.farthest(axis, sign, reached - kSearch * size);
      EXPECT_LE(found, outer + kSearch * size) << "xyz"[axis] << " " << sign;
      EXPECT_GE(found, reached - kSearch * size) << "xyz"[axis] << " " << sign;
    }
}

INSTANTIATE_TEST_SUITE_P(Machines, Sides,
                         testing::Values(Case{"hexapod-strut", 20}, Case{"hexapod-strut", 0},
                                         Case{"hexapod-slider", 10}, Case{"lola50", 0},
                                         Case{test::source("tests/trials/irb360.toml"), 0},
                                         Case{test::source("tests/trials/pi850.toml"), 5}));

// Congruent platforms reach the shell 50 mm <= |p - c| <= 90 mm about c = (0, 0, 10 mm), so that all sides are known.
TEST(Extents, OfAShell) {
  const AnyMachine m = test::congruent();
  Options options = at_tilt(0, 0.1);
  options.limits &= ~*limit_bits(m, "joint");
  const Volume v = *volume(m, options);
  ASSERT_TRUE(v.reached);
  for (int axis = 0; axis < 3; ++axis) {
    const double middle = axis == 2 ? 0.01 : 0;
    EXPECT_LE(v.reached->max[axis], middle + 0.09 + 1e-12);
    EXPECT_GE(v.max[axis], middle + 0.09 - 1e-12);
    EXPECT_LE(v.max[axis] - v.reached->max[axis], 1e-5 * 0.181);
    EXPECT_GE(v.reached->min[axis], middle - 0.09 - 1e-12);
    EXPECT_LE(v.min[axis], middle - 0.09 + 1e-12);
    EXPECT_LE(v.reached->min[axis] - v.min[axis], 1e-5 * 0.181);
  }
}

// Without the refinement the sides lie where large boxes that hold next to nothing end.
TEST(Extents, AreLooseWithoutRefinement) {
  Options options = at_tilt(20, 0.01);
  options.bounds_tolerance = 0;
  const Volume loose = *volume(load("hexapod-strut"), options);
  options.bounds_tolerance = 1e-5;
  const Volume tight = *volume(load("hexapod-strut"), options);
  EXPECT_GT(loose.max.y(), 1.2 * tight.max.y());
  EXPECT_EQ(loose.lower, tight.lower);
  EXPECT_EQ(loose.upper, tight.upper);
  EXPECT_EQ(loose.points, tight.points);
}

// A machine that reaches nothing has no extents, and says so.
TEST(Extents, OfNothing) {
  const Volume v = *volume(load("hexapod-strut", {{"joint.cone_deg", "15"}}), at_tilt(20, 0.01));
  EXPECT_TRUE(v.empty);
  EXPECT_FALSE(v.reached);
}

TEST(Memory, EndsARunWithWhatIsProven) {
  const AnyMachine m = load("hexapod-strut");
  const Volume known = *volume(m, at_tilt(20, 0.01));
  for (const std::size_t megabytes : {1, 4}) {
    Options options = at_tilt(20, 1e-5);
    options.max_memory = megabytes * 1'000'000;
    double most = 0;
    options.progress = [&](const Progress& p) { most = std::max(most, p.bytes); };
    const Volume v = *volume(m, options);
    EXPECT_FALSE(v.converged);
    EXPECT_EQ(v.stopped, Stopped::memory);
    EXPECT_LE(most, static_cast<double>(options.max_memory));
    EXPECT_GT(most, 0.2 * static_cast<double>(options.max_memory));
    EXPECT_GT(v.memory_estimate, 10 * most);
    EXPECT_GT(v.lower, 0);
    EXPECT_LE(v.lower, known.upper);
    EXPECT_GE(v.upper, known.lower);
    // The boxes within leave room for the sides; 1 MB is little more than the patches of directions.
    ASSERT_TRUE(v.reached);
    if (megabytes > 1) {
      EXPECT_LE(std::max((v.max - v.reached->max).maxCoeff(), (v.reached->min - v.min).maxCoeff()),
                options.bounds_tolerance * (v.max - v.min).maxCoeff() * (1 + 1e-9));
    }
    options.threads = 2;
    const Volume again = *volume(m, options);
    EXPECT_EQ(again.lower, v.lower);
    EXPECT_EQ(again.upper, v.upper);
    EXPECT_EQ(again.max, v.max);
  }
}

TEST(Memory, EnoughOfItChangesNothing) {
  const AnyMachine m = load("hexapod-slider");
  const Volume free = *volume(m, at_tilt(20, 0.05));
  Options options = at_tilt(20, 0.05);
  options.max_memory = 1'000'000'000;
  const Volume bounded = *volume(m, options);
  EXPECT_EQ(free.lower, bounded.lower);
  EXPECT_EQ(free.upper, bounded.upper);
  EXPECT_TRUE(bounded.converged);
  EXPECT_EQ(bounded.stopped, Stopped::no);
}

}  // namespace
}  // namespace polypod::workspace
