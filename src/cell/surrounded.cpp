// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Whether guards surround what machines come to.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <deque>
#include <utility>
#include <vector>

#include "common.hpp"
#include "polypod/cell/safety.hpp"
#include "polypod/geometry/hull.hpp"

namespace polypod::cell {
namespace {

using Vec2 = Eigen::Vector2d;

double from_segment(const Vec2& p, const Guard& g) {
  const Vec2 a = g.from.head<2>(), d = g.to.head<2>() - a;
  const double length = d.squaredNorm();
  const double t = length > 0 ? std::clamp((p - a).dot(d) / length, 0.0, 1.0) : 0;
  return (p - a - t * d).norm();
}

/// Whether the ray from p along the axis d (a unit vector) meets the guard.
bool meets(const Vec2& p, const Vec2& d, const Guard& g) {
  const Vec2 n(-d.y(), d.x()), a = g.from.head<2>() - p, b = g.to.head<2>() - p;
  const double u = n.dot(a), v = n.dot(b);
  if ((u > 0) == (v > 0)) return false;
  const double t = u / (u - v);
  return d.dot(a) + t * d.dot(b - a) > 0;
}

bool is_in(const Vec2& p, const std::vector<Vec2>& hull) {
  for (std::size_t k = 0; k < hull.size(); ++k) {
    const Vec2 d = hull[(k + 1) % hull.size()] - hull[k], to = p - hull[k];
    if (d.x() * to.y() - d.y() * to.x() < 0) return false;
  }
  return true;
}

/// Squares of the floor.
struct Floor {
  Vec2 low = Vec2::Zero();
  double step = 0;
  int columns = 0, rows = 0;
  [[nodiscard]] Vec2 middle(int c, int r) const { return low + step * Vec2(c + 0.5, r + 0.5); }
  [[nodiscard]] std::size_t index(int c, int r) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(c);
  }
};

}  // namespace

std::string way_in(const Cell& cell, const std::vector<Swept>& space) {
  constexpr double kReach = 2.7;  // m: ISO 13857, 4.2.1, reaching upwards
  constexpr double kGap = 0.120, kStep = 0.030, kMargin = 0.5;
  constexpr double kMost = 1600;  // squares a side
  // What reaches through a guard is a matter of that guard.
  std::vector<Swept> behind, balls;
  for (const Swept& s : space) {
    balls.push_back({s.at, s.radius, "", {}});
    if (!s.to) continue;
    balls.push_back({(s.at + *s.to) / 2, s.radius, "", {}});
    balls.push_back({*s.to, s.radius, "", {}});
  }
  for (const Swept& s : balls) {
    if (s.at.z() - s.radius > kReach) continue;
    if (std::any_of(cell.guards.begin(), cell.guards.end(),
                    [&](const Guard& g) { return from_segment(s.at.head<2>(), g) <= s.radius + kGap / 2; }))
      continue;
    behind.push_back(s);
  }
  if (behind.empty()) return "";
  Vec2 low = Vec2::Constant(kInfinity), high = -low, sum = Vec2::Zero();
  for (const Swept& s : behind) {
    low = low.cwiseMin(s.at.head<2>() - Vec2::Constant(s.radius));
    high = high.cwiseMax(s.at.head<2>() + Vec2::Constant(s.radius));
    sum += s.at.head<2>();
  }
  for (const Guard& g : cell.guards) {
    for (const Vec3* p : {&g.from, &g.to}) {
      low = low.cwiseMin(p->head<2>());
      high = high.cwiseMax(p->head<2>());
    }
  }
  Floor floor;
  floor.step = std::max(kStep, (high - low).maxCoeff() / kMost);
  // Wide enough to be tight for steps from square to square.
  const double half = std::max(kGap / 2, 0.75 * floor.step);
  floor.low = low - Vec2::Constant(kMargin + floor.step);
  const Vec2 size = high - low + 2 * Vec2::Constant(kMargin + floor.step);
  floor.columns = static_cast<int>(std::ceil(size.x() / floor.step));
  floor.rows = static_cast<int>(std::ceil(size.y() / floor.step));
  enum : std::uint8_t { kFree, kBlocked, kHazard };
  std::vector<std::uint8_t> squares(floor.index(0, floor.rows), kFree);
  for (const Swept& s : behind) {
    const Vec2 at = (s.at.head<2>() - floor.low) / floor.step;
    const int reach = static_cast<int>(std::ceil(s.radius / floor.step));
    for (int r = static_cast<int>(at.y()) - reach; r <= static_cast<int>(at.y()) + reach; ++r)
      for (int c = static_cast<int>(at.x()) - reach; c <= static_cast<int>(at.x()) + reach; ++c)
        if (c >= 0 && c < floor.columns && r >= 0 && r < floor.rows &&
            (floor.middle(c, r) - s.at.head<2>()).norm() <= s.radius + floor.step / 2)
          squares[floor.index(c, r)] = kHazard;
  }
  for (int r = 0; r < floor.rows; ++r)
    for (int c = 0; c < floor.columns; ++c)
      if (std::any_of(cell.guards.begin(), cell.guards.end(),
                      [&](const Guard& g) { return from_segment(floor.middle(c, r), g) <= half; }))
        squares[floor.index(c, r)] = kBlocked;
  // From outside inwards.
  std::vector<int> before(squares.size(), -1);
  std::deque<std::array<int, 2>> next;
  before[0] = 0;
  next.push_back({0, 0});
  while (!next.empty()) {
    const auto [c, r] = next.front();
    next.pop_front();
    if (squares[floor.index(c, r)] == kHazard) {
      const Vec2 middle = sum / static_cast<double>(behind.size());
      std::string sides;
      const std::array<std::pair<const char*, Vec2>, 4> kSides{
          {{"front", {0, -1}}, {"right", {1, 0}}, {"back", {0, 1}}, {"left", {-1, 0}}}};
      for (const auto& side : kSides) {
        if (std::any_of(cell.guards.begin(), cell.guards.end(),
                        [&](const Guard& g) { return meets(middle, side.second, g); }))
          continue;
        sides += sides.empty() ? "from the " : ", the ";
        sides += side.first;
      }
      if (!sides.empty()) return sides;
      // A gap: where the way from inside comes out of the hull of the guards' ends.
      std::vector<Vec2> ends;
      for (const Guard& g : cell.guards)
        for (const Vec3* p : {&g.from, &g.to}) ends.emplace_back(p->head<2>());
      const std::vector<Vec2> hull = convex_hull(std::move(ends));
      Vec2 gap = middle;
      for (std::size_t at = floor.index(c, r); at != 0; at = static_cast<std::size_t>(before[at])) {
        gap = floor.middle(static_cast<int>(at) % floor.columns, static_cast<int>(at) / floor.columns);
        if (!is_in(gap, hull)) break;
      }
      return "near " + place_text({gap.x(), gap.y(), 0});
    }
    for (const auto& [dc, dr] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
      const int nc = c + dc, nr = r + dr;
      if (nc < 0 || nr < 0 || nc >= floor.columns || nr >= floor.rows) continue;
      const std::size_t at = floor.index(nc, nr);
      if (before[at] >= 0 || squares[at] == kBlocked) continue;
      before[at] = static_cast<int>(floor.index(c, r));
      next.push_back({nc, nr});
    }
  }
  return "";
}

}  // namespace polypod::cell
