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
  /// A second choice beside the rung, of values that do not go round; a state is column * rungs + rung.
  int columns = 1;
  int farthest_column = 127;  ///< at most 127
};

struct LadderWay {
  /// The rung at each point, as it goes on and on: by at most `farthest` from one to the next, so beyond 0 .. rungs - 1
  /// where it goes round. Empty where there is no way.
  std::vector<int> rungs;
  std::vector<int> columns;  ///< at each point
  double cost = 0;
  std::size_t blocked = 0;  ///< without a way: the first point that none reaches
};

/// The way of least sum of state(n, j), of each point n in its state j, and step(n, i, j), from state i of point n - 1
/// to state j of point n. Infinite costs are never taken; of equal costs the smaller change of column wins, then that
/// of rung, then the lower ones. `state` is called for all states of a point before `step` is, and only for finite
/// predecessors; `chosen(n, j, i)` tells which predecessor the best way to state j has. Exact (Bellman). Cost: points x
/// states x (2 farthest + 1) x (2 farthest_column + 1) steps; two bytes a point and state.
template <class State, class Step, class Chosen>
LadderWay cheapest_way(const LadderSize& size, State&& state, Step&& step, Chosen&& chosen) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const int m = size.rungs, most = std::min(size.farthest, size.around ? m / 2 : m - 1);
  const int most_columns = std::min(size.farthest_column, size.columns - 1), count = m * size.columns;
  // 0, -1, 1, -2, 2, ...: of equal costs the first stays.
  const auto change = [](int k) { return k % 2 == 0 ? k / 2 : -(k + 1) / 2; };
  struct From {
    std::int8_t rungs = 0, columns = 0;
  };
  LadderWay out;
  if (size.points == 0 || count <= 0) return out;
  const auto states = static_cast<std::size_t>(count);
  std::vector<double> before(states, kNone), now(states, kNone);
  std::vector<From> from(size.points * states);
  /// The rung that is d away; -1: none.
  const auto rung_at = [&](int rung, int d) {
    const int i = rung + d;
    return i >= 0 && i < m ? i : size.around ? (i + m) % m : -1;
  };
  for (std::size_t n = 0; n < size.points; ++n) {
    bool any = false;
    for (int j = 0; j < count; ++j) now[static_cast<std::size_t>(j)] = state(n, j);
    for (int j = 0; j < count; ++j) {
      double& cost = now[static_cast<std::size_t>(j)];
      if (!(cost < kNone)) continue;
      if (n > 0) {
        double best = kNone;
        From best_d;
        int best_i = 0;
        for (int l = 0; l <= 2 * most_columns; ++l) {
          const int column = j / m + change(l);
          if (column < 0 || column >= size.columns) continue;
          for (int k = 0; k <= 2 * most; ++k) {
            const int rung = rung_at(j % m, change(k));
            if (rung < 0) continue;
            const int i = column * m + rung;
            const double b = before[static_cast<std::size_t>(i)];
            if (!(b < best)) continue;
            const double c = b + step(n, i, j);
            if (!(c < best)) continue;
            best = c;
            best_d = {static_cast<std::int8_t>(change(k)), static_cast<std::int8_t>(change(l))};
            best_i = i;
          }
        }
        cost += best;
        if (cost < kNone) {
          from[n * states + static_cast<std::size_t>(j)] = best_d;
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
  const int last = static_cast<int>(end - before.begin());
  int rung = last % m, column = last / m, turned = rung;
  out.rungs.resize(size.points);
  out.columns.resize(size.points);
  for (std::size_t n = size.points; n-- > 0;) {
    out.rungs[n] = turned;
    out.columns[n] = column;
    const From& d = from[n * states + static_cast<std::size_t>(column * m + rung)];
    turned += d.rungs;
    rung = ((rung + d.rungs) % m + m) % m;
    column += d.columns;
  }
  return out;
}

}  // namespace polypod::post
