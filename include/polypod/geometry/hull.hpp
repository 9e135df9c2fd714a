// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <vector>

namespace polypod {

/// The convex hull of points in a plane, counterclockwise, without points on its sides (Andrew's monotone chain, 1979).
/// A corner counts where its turn spans more than `least`, the square of the unit of the points (twice the area of its
/// triangle). Cost: n log n.
inline std::vector<Eigen::Vector2d> convex_hull(std::vector<Eigen::Vector2d> points, double least = 0) {
  std::sort(points.begin(), points.end(), [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  const auto turn = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
    const Eigen::Vector2d first = b - a, second = c - b;
    return first.x() * second.y() - first.y() * second.x();
  };
  std::vector<Eigen::Vector2d> out;
  for (int side = 0; side < 2; ++side) {
    const std::size_t start = out.size();
    for (const Eigen::Vector2d& p : points) {
      while (out.size() >= start + 2 && !(turn(out[out.size() - 2], out.back(), p) > least)) out.pop_back();
      out.push_back(p);
    }
    if (!out.empty()) out.pop_back();  // the other side begins with it
    std::reverse(points.begin(), points.end());
  }
  return out;
}

}  // namespace polypod
