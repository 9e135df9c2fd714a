// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The cheapest way along a row of points, each of which may be taken in one of several ways: dynamic programming.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <vector>

namespace polypod::post {

struct LadderSize {
  std::size_t points = 0;
  int rungs = 0;       ///< of each point, at most 1000
  int farthest = 127;  ///< by how many rungs a way may go from a point to the next, at most 127
  bool around = true;  ///< the last rung is next to the first: rungs are turns
};

struct LadderWay {
  /// The rung at each point, as it goes on and on: by at most `farthest` from one to the next, so beyond 0 .. rungs - 1
  /// where it goes round. Empty where there is no way.
  std::vector<int> rungs;
  double cost = 0;
  std::size_t blocked = 0;  ///< without a way: the first point that none reaches
};

/// The way of least sum of state(n, j), of each point n on its rung j, and step(n, i, j), from rung i of point n - 1 to
/// rung j of point n. Infinite costs are never taken; of equal costs the smaller change of rung wins, then the lower
/// rung. `state` is called for all rungs of a point before `step` is, and only for finite predecessors; `chosen(n, j,
/// i)` tells which predecessor the best way to rung j has. Exact (Bellman). Cost: points x rungs x (2 farthest + 1)
/// steps; a byte a point and rung.
template <class State, class Step, class Chosen>
LadderWay cheapest_way(const LadderSize& size, State&& state, Step&& step, Chosen&& chosen) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const int m = size.rungs, most = std::min(size.farthest, size.around ? m / 2 : m - 1);
  LadderWay out;
  if (size.points == 0 || m <= 0) return out;
  const auto rungs = static_cast<std::size_t>(m);
  std::vector<double> before(rungs, kNone), now(rungs, kNone);
  std::vector<std::int8_t> from(size.points * rungs, 0);
  for (std::size_t n = 0; n < size.points; ++n) {
    bool any = false;
    for (int j = 0; j < m; ++j) now[static_cast<std::size_t>(j)] = state(n, j);
    for (int j = 0; j < m; ++j) {
      double& cost = now[static_cast<std::size_t>(j)];
      if (!(cost < kNone)) continue;
      if (n > 0) {
        double best = kNone;
        int best_d = 0, best_i = 0;
        // 0, -1, 1, -2, 2, ...: of equal costs the first stays.
        for (int k = 0; k <= 2 * most; ++k) {
          const int d = k % 2 == 0 ? k / 2 : -(k + 1) / 2;
          int i = j + d;
          if (i < 0 || i >= m) {
            if (!size.around) continue;
            i = (i + m) % m;
          }
          const double b = before[static_cast<std::size_t>(i)];
          if (!(b < best)) continue;
          const double c = b + step(n, i, j);
          if (!(c < best)) continue;
          best = c;
          best_d = d;
          best_i = i;
        }
        cost += best;
        if (cost < kNone) {
          from[n * rungs + static_cast<std::size_t>(j)] = static_cast<std::int8_t>(best_d);
          chosen(n, j, best_i);
        }
      }
      any = any || cost < kNone;
    }
    if (!any) {
      out.blocked = n;
      return out;
    }
    std::swap(before, now);
  }
  const auto end = std::min_element(before.begin(), before.end());
  out.cost = *end;
  int j = static_cast<int>(end - before.begin()), turned = j;
  out.rungs.resize(size.points);
  for (std::size_t n = size.points; n-- > 0;) {
    out.rungs[n] = turned;
    const int d = from[n * rungs + static_cast<std::size_t>(j)];
    turned += d;
    j = ((j + d) % m + m) % m;
  }
  return out;
}

}  // namespace polypod::post
