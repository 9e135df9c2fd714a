// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/zonotope.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace polypod::quality {
namespace {

/// A generator seen along another one: its shadow in the plane across, turned into the upper half plane.
struct Shadow {
  double u = 0, v = 0;
  double sign = 1;  ///< of the generator in the half plane
  std::size_t index = 0;
};

/// Up to this many generators the work needs no memory of its own.
constexpr std::size_t kFew = 96;

/// farthest_vertex of generators of which no two are parallel; its signs alone.
std::vector<signed char> signs_of_farthest(std::span<const Vec3> g) {
  std::vector<signed char> signs(g.size(), 1);
  const std::size_t n = g.size();
  double squared = -1;
  std::size_t best_axis = 0;
  int best_step = 0;
  std::array<Shadow, kFew> few;
  std::vector<Shadow> many(n > kFew ? n : 0);
  Shadow* const shadows = n > kFew ? many.data() : few.data();

  // The walk round generator `axis`; `visit(sum, step)` at every vertex, one per half turn (the other is its mirror).
  const auto shadows_along = [&](std::size_t axis, Vec3& along) {
    const Vec3& a = g[axis];
    const double length = a.norm();
    const Vec3 n_a = a / length;
    // Any plane across: the coordinate axis that is least along a, made square to it.
    Eigen::Index least = 0;
    n_a.cwiseAbs().minCoeff(&least);
    const Vec3 e_u = n_a.cross(Vec3::Unit(least)).normalized(), e_v = n_a.cross(e_u);
    std::size_t count = 0;
    along = a;
    for (std::size_t i = 0; i < n; ++i) {
      if (i == axis) continue;
      const double u = e_u.dot(g[i]), v = e_v.dot(g[i]);
      if (std::max(std::abs(u), std::abs(v)) <= 1e-12 * g[i].norm()) {
        along += g[i].dot(a) >= 0 ? g[i] : Vec3(-g[i]);  // parallel to the axis
        continue;
      }
      const double sign = v > 0 || (v == 0 && u > 0) ? 1.0 : -1.0;
      shadows[count++] = {sign * u, sign * v, sign, i};
    }
    std::sort(shadows, shadows + count, [](const Shadow& x, const Shadow& y) { return x.u * y.v - x.v * y.u > 0; });
    return count;
  };

  for (std::size_t axis = 0; axis < n; ++axis) {
    if (g[axis].isZero(0)) continue;
    Vec3 along;
    const std::size_t count = shadows_along(axis, along);
    // The directions in which the sum is taken turn from -90 deg of the first shadow on: all signs of the half plane +.
    Vec3 sum = Vec3::Zero();
    for (std::size_t k = 0; k < count; ++k) sum += shadows[k].sign * g[shadows[k].index];
    for (std::size_t step = 0; step == 0 || step < count; ++step) {
      if (step > 0) sum -= 2 * shadows[step - 1].sign * g[shadows[step - 1].index];
      // With the axis + or -; the mirror images need no visit.
      const double square = sum.squaredNorm() + along.squaredNorm(), cross = 2 * sum.dot(along);
      if (square + std::abs(cross) > squared) {
        squared = square + std::abs(cross);
        best_axis = axis;
        best_step = static_cast<int>(cross >= 0 ? step + 1 : -static_cast<std::ptrdiff_t>(step) - 1);
      }
    }
  }
  if (best_step == 0) return signs;  // all generators are zero
  Vec3 along;
  const std::size_t count = shadows_along(best_axis, along);
  const auto flipped = static_cast<std::size_t>(std::abs(best_step) - 1);
  const double side = best_step > 0 ? 1 : -1;
  for (std::size_t i = 0; i < n; ++i)  // the axis and what is parallel to it; the others follow
    signs[i] = static_cast<signed char>(side * g[i].dot(g[best_axis]) >= 0 ? 1 : -1);
  for (std::size_t k = 0; k < count; ++k) {
    const double sign = (k < flipped ? -1 : 1) * shadows[k].sign;
    signs[shadows[k].index] = static_cast<signed char>(sign);
  }
  return signs;
}

}  // namespace

Farthest farthest_vertex(std::span<const Vec3> g) {
  // Parallel generators act as one, their sum with all turned to the same side: of a machine of legs those of one leg.
  struct Part {
    std::size_t group = 0;
    bool opposite = false;
  };
  std::vector<Vec3> groups;
  std::vector<Part> parts(g.size());
  for (std::size_t i = 0; i < g.size(); ++i) {
    Part& part = parts[i];
    const double least = 1e-12 * g[i].norm();
    const auto parallel = [&](const Vec3& sum) { return sum.cross(g[i]).norm() <= least * sum.norm(); };
    while (part.group < groups.size() && !parallel(groups[part.group])) ++part.group;
    if (part.group == groups.size()) groups.emplace_back(Vec3::Zero());
    Vec3& sum = groups[part.group];
    part.opposite = sum.dot(g[i]) < 0;
    sum += part.opposite ? Vec3(-g[i]) : g[i];
  }
  const std::vector<signed char> signs = signs_of_farthest(groups);
  Farthest best;
  for (std::size_t i = 0; i < g.size(); ++i) {
    const signed char sign = signs[parts[i].group];
    best.signs.push_back(static_cast<signed char>(parts[i].opposite ? -sign : sign));
    best.point += static_cast<double>(best.signs.back()) * g[i];
  }
  best.distance = best.point.norm();
  return best;
}

Farthest flip_search(std::span<const Vec3> g) {
  Farthest out;
  out.signs.assign(g.size(), 1);
  for (const Vec3& v : g) out.point += v;
  double squared = out.point.squaredNorm();
  // A flip must gain more than rounding, or a sum could go round in circles.
  constexpr double kGain = 1 + 1e-12;
  for (bool changed = true; changed;) {
    changed = false;
    for (std::size_t i = 0; i < g.size(); ++i) {
      const Vec3 flipped = out.point - 2.0 * static_cast<double>(out.signs[i]) * g[i];
      if (!(flipped.squaredNorm() > squared * kGain)) continue;
      out.point = flipped;
      squared = flipped.squaredNorm();
      out.signs[i] = static_cast<signed char>(-out.signs[i]);
      changed = true;
    }
  }
  out.distance = out.point.norm();
  return out;
}

}  // namespace polypod::quality
