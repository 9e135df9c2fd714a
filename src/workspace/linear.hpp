// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One limit over a cell and a patch in first order, and what it says of the cell.
#pragma once

#include "subdivide.hpp"

namespace polypod::workspace {

/// First order and rest of a scalar over cell and patch: value + G . x + s1 s + s2 t + [-below, above].
struct Linear {
  double value = 0;
  Vec3 G = Vec3::Zero();
  double s1 = 0, s2 = 0;
  double below = 0, above = 0;
};

// Rounding of one limit's evaluation relative to its terms, with much to spare.
constexpr double kRounding = 1e-12;

/// Adds a term to the answer unless it is decided.
inline Verdict weigh(const Linear& f, int limit, double scale, const Vec3& half, const Patch& patch, BoundList& out) {
  const double slack = kRounding * scale;
  const double by_direction = patch.least(f.s1, f.s2);
  const double by_position = f.G.cwiseAbs().dot(half);
  Bound b;  // filled in as far as it is needed
  b.limit = limit;
  b.m = f.value + by_direction - f.below - slack;
  if (b.m - by_position >= 0) return Verdict::inside;
  b.M = f.value + by_direction + f.above + slack;  // at the worst point of the patch
  if (b.M + by_position < 0) {
    const double best = f.value - patch.least(-f.s1, -f.s2) + f.above + slack;
    return best + by_position < 0 ? Verdict::dead : Verdict::outside;
  }
  b.G = f.G;
  return out.push_back(b) ? Verdict::undecided : Verdict::open;
}

/// All of several limits: the worse of two verdicts.
inline Verdict both(Verdict a, Verdict b) {
  for (const Verdict v : {Verdict::dead, Verdict::outside, Verdict::open, Verdict::undecided})
    if (a == v || b == v) return v;
  return Verdict::inside;
}

}  // namespace polypod::workspace
