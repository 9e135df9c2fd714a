// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Both sides of every verdict of an arm's limits over a cell and a patch.
#pragma once

#include <gtest/gtest.h>

#include <array>

#include "subdivide.hpp"

namespace polypod::workspace::test {

struct PlanesSeen {
  std::array<int, 5> verdicts{};
  int kept = 0, lost = 0;

  [[nodiscard]] int undecided() const { return verdicts[static_cast<std::size_t>(Verdict::undecided)]; }
};

/// A position that the planes from below keep is reached in all directions of the patch, one that a plane from above
/// loses is not in some: `least_margin(p)` is the least over the patch, `some_margin(p)` that of one direction of it,
/// both of the inverse and within `near_zero` of 0 where limits are widened by rounding.
template <class Limits, class Random, class Least, class Some>
void expect_planes_hold(const Limits& limits, const Vec3& center, const Vec3& half, const Patch& patch, Random& random,
                        double near_zero, int cell, Least&& least_margin, Some&& some_margin, PlanesSeen& seen) {
  BoundList bounds;
  const Verdict verdict = limits.judge(0, center, half, half.norm(), patch, limits.prepare(patch), bounds);
  ++seen.verdicts[static_cast<std::size_t>(verdict)];
  if (verdict == Verdict::open) return;
  for (int sample = 0; sample < 6; ++sample) {
    Vec3 x(random(-1, 1), random(-1, 1), random(-1, 1));
    if (sample < 3) x = Vec3(random(-1, 1) > 0 ? 1 : -1, random(-1, 1) > 0 ? 1 : -1, random(-1, 1) > 0 ? 1 : -1);
    x = x.cwiseProduct(half);
    bool in = verdict == Verdict::inside, out = verdict == Verdict::outside || verdict == Verdict::dead;
    if (verdict == Verdict::undecided) {
      in = true;
      for (const Bound& bound : bounds) {
        in = in && bound.m + bound.G.dot(x) >= 0;
        out = out || bound.M + bound.G.dot(x) < 0;
      }
    }
    EXPECT_FALSE(in && out) << "cell " << cell;
    if (!in && !out) continue;
    const double margin = least_margin(center + x);
    if (in) {
      ++seen.kept;
      EXPECT_GE(margin, -near_zero) << "cell " << cell;
    } else {
      ++seen.lost;
      EXPECT_LE(margin, near_zero) << "cell " << cell;
    }
    if (verdict == Verdict::dead) {
      EXPECT_LE(some_margin(center + x), near_zero) << "cell " << cell;
    }
  }
}

}  // namespace polypod::workspace::test
