// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "outline.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "polypod/core/units.hpp"

namespace polypod::pages {
namespace {

using report::Point;

/// The share of material in squares of cells, with an empty square on every side.
struct Coverage {
  int columns = 0, rows = 0;
  std::vector<double> share;

  [[nodiscard]] double at(int i, int j) const { return share[static_cast<std::size_t>(j) * columns + i]; }
};

Coverage coverage_of(const cutting::Stock& stock, int step) {
  Coverage out;
  out.columns = (stock.columns() + step - 1) / step + 2;
  out.rows = (stock.rows() + step - 1) / step + 2;
  out.share.assign(static_cast<std::size_t>(out.columns) * out.rows, 0.0);
  const double part = 1.0 / (double(step) * step * cutting::Stock::kLayers);
  for (int j = 0; j < stock.rows(); ++j) {
    for (int i = 0; i < stock.columns(); ++i) {
      const float* layers = stock.cell_layers(i, j);
      int filled = 0;
      for (int k = 0; k < cutting::Stock::kLayers; ++k) filled += layers[k] > cutting::Stock::empty() ? 1 : 0;
      out.share[static_cast<std::size_t>(j / step + 1) * out.columns + (i / step + 1)] += filled * part;
    }
  }
  return out;
}

}  // namespace

std::vector<std::vector<Point>> stock_outline(const cutting::Stock& stock) {
  constexpr int kSquares = 400;
  constexpr double kBorder = 0.5;
  if (stock.columns() == 0 || stock.rows() == 0) return {};
  const int step = (std::max(stock.columns(), stock.rows()) + kSquares - 1) / kSquares;
  const Coverage c = coverage_of(stock, step);

  // Marching squares: pieces of border between the sides of the square of four neighbours. A side is named by its lower
  // left square and whether it runs along x (0) or y (1).
  using Side = int;
  const auto side = [&](int i, int j, int along) -> Side { return (j * c.columns + i) * 2 + along; };
  const auto point = [&](int i, int j, int along) {
    const double a = c.at(i, j), b = along == 0 ? c.at(i + 1, j) : c.at(i, j + 1);
    const double t = (kBorder - a) / (b - a);
    const double size = units::to_mm(stock.cell() * step);
    return Point{units::to_mm(stock.x_min()) + (i - 0.5 + (along == 0 ? t : 0)) * size,
                 units::to_mm(stock.y_min()) + (j - 0.5 + (along == 1 ? t : 0)) * size};
  };
  std::map<Side, std::pair<Side, Point>>
      next;  // where the border that enters at a side goes on, and where that side is
  for (int j = 0; j + 1 < c.rows; ++j) {
    for (int i = 0; i + 1 < c.columns; ++i) {
      const bool in[4] = {c.at(i, j) >= kBorder, c.at(i + 1, j) >= kBorder, c.at(i + 1, j + 1) >= kBorder,
                          c.at(i, j + 1) >= kBorder};
      if (in[0] == in[1] && in[1] == in[2] && in[2] == in[3]) continue;
      // The sides in order round the square: below, right, above, left. The border comes in through a side along which,
      // going round counterclockwise, material ends, and leaves where that material began: it has it on its left.
      const Side sides[4] = {side(i, j, 0), side(i + 1, j, 1), side(i, j + 1, 0), side(i, j, 1)};
      const Point points[4] = {in[0] != in[1] ? point(i, j, 0) : Point{}, in[1] != in[2] ? point(i + 1, j, 1) : Point{},
                               in[2] != in[3] ? point(i, j + 1, 0) : Point{},
                               in[3] != in[0] ? point(i, j, 1) : Point{}};
      for (int k = 0; k < 4; ++k) {
        if (!in[k] || in[(k + 1) % 4]) continue;  // material ends along side k
        int to = (k + 3) % 4;                     // back to where this run of material began
        while (!(!in[to] && in[(to + 1) % 4])) to = (to + 3) % 4;
        next[sides[k]] = {sides[to], points[k]};
      }
    }
  }
  std::vector<std::vector<Point>> out;
  while (!next.empty()) {
    std::vector<Point> loop;
    Side at = next.begin()->first;
    for (auto it = next.find(at); it != next.end(); it = next.find(at)) {
      loop.push_back(it->second.second);
      at = it->second.first;
      next.erase(it);
    }
    if (loop.size() > 2) out.push_back(std::move(loop));
  }
  return out;
}

std::vector<std::vector<Point>> clip(const std::vector<Point>& line, const Point& lo, const Point& hi) {
  std::vector<std::vector<Point>> out;
  bool open = false;
  for (std::size_t k = 1; k < line.size(); ++k) {
    const Point a = line[k - 1], b = line[k];
    if (!std::isfinite(a.x + a.y) || !std::isfinite(b.x + b.y)) {
      open = false;
      continue;
    }
    double from = 0, to = 1;
    bool inside = true;
    const auto half_plane = [&](double p, double d, double least, double most) {  // Liang and Barsky
      if (d == 0) {
        inside = inside && p >= least && p <= most;
        return;
      }
      const double t0 = (least - p) / d, t1 = (most - p) / d;
      from = std::max(from, std::min(t0, t1));
      to = std::min(to, std::max(t0, t1));
    };
    half_plane(a.x, b.x - a.x, lo.x, hi.x);
    half_plane(a.y, b.y - a.y, lo.y, hi.y);
    if (!inside || from > to) {
      open = false;
      continue;
    }
    const auto at = [&](double t) { return Point{a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)}; };
    if (!open || from > 0) out.push_back({at(from)});
    out.back().push_back(at(to));
    open = to >= 1;
  }
  return out;
}

std::vector<Point> tube(const std::vector<Point>& line, double radius) {
  constexpr int kSteps = 24;  // of a half circle
  std::vector<Point> out;
  const std::size_t n = line.size();
  const auto heading = [&](std::size_t k) {  // over the pieces on both sides
    const Point &a = line[k > 0 ? k - 1 : 0], &b = line[std::min(k + 1, n - 1)];
    return std::atan2(b.y - a.y, b.x - a.x);
  };
  const auto add = [&](const Point& p, double angle) {
    out.push_back({p.x + radius * std::cos(angle), p.y + radius * std::sin(angle)});
  };
  constexpr double kRight = -std::numbers::pi / 2;
  for (std::size_t k = 0; k < n; ++k) add(line[k], heading(k) + kRight);
  for (int j = 1; j < kSteps; ++j) add(line[n - 1], heading(n - 1) + kRight + std::numbers::pi * j / kSteps);
  for (std::size_t k = n; k-- > 0;) add(line[k], heading(k) - kRight);
  for (int j = 1; j < kSteps; ++j) add(line[0], heading(0) - kRight + std::numbers::pi * j / kSteps);
  return out;
}

}  // namespace polypod::pages
