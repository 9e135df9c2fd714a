// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/turned_block.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/geometry/hull.hpp"

namespace polypod::cutting {
namespace {

using Point = Eigen::Vector2d;
using Polygon = std::vector<Point>;

// A face whose normal is this near to the plane of S is upright in it: it bounds the outline alone.
constexpr double kUpright = 1e-9;

double cross(const Point& a, const Point& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// What of a convex polygon lies to the left of the line from a to b.
Polygon left_of(const Polygon& polygon, const Point& a, const Point& b) {
  Polygon out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &p = polygon[i], &q = polygon[(i + 1) % polygon.size()];
    const double at_p = cross(b - a, p - a), at_q = cross(b - a, q - a);
    if (at_p >= 0) out.push_back(p);
    if (at_p * at_q < 0) out.push_back(p + at_p / (at_p - at_q) * (q - p));
  }
  return out;
}

struct Part {
  double area = 0;
  Point middle = Point::Zero();
};
Part part_of(const Polygon& polygon) {
  Part out;
  if (polygon.size() < 3) return out;
  Point moment = Point::Zero();
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i) {
    const double area = 0.5 * cross(polygon[i] - polygon[0], polygon[i + 1] - polygon[0]);
    out.area += area;
    moment += area / 3 * (polygon[0] + polygon[i] + polygon[i + 1]);
  }
  if (out.area > 0) out.middle = moment / out.area;
  return out;
}

/// n . p <= distance, in S.
struct Face {
  Vec3 normal;
  double distance;
  [[nodiscard]] double z_at(const Point& p) const {
    return (distance - normal.x() * p.x() - normal.y() * p.y()) / normal.z();
  }
};

}  // namespace

bool is_block(const Stock& stock) {
  const auto top = static_cast<float>(stock.top());
  return stock.hollow() == nullptr && !stock.layers().empty() &&
         std::all_of(stock.layers().begin(), stock.layers().end(), [&](float h) { return h == top; });
}

Result<Stock> turned_block(const Vec3& min, const Vec3& max, const Mat3& R_SW, double cell) {
  Polygon corners;
  double bottom = std::numeric_limits<double>::infinity(), top = -bottom;
  for (int i = 0; i < 8; ++i) {
    const Vec3 p = R_SW * Vec3((i & 1 ? max : min).x(), (i & 2 ? max : min).y(), (i & 4 ? max : min).z());
    corners.emplace_back(p.x(), p.y());
    bottom = std::min(bottom, p.z());
    top = std::max(top, p.z());
  }
  const Polygon outline = convex_hull(corners);
  Point low = corners[0], high = corners[0];
  for (const Point& p : corners) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  // Whole cells that hold the outline.
  const Point size = high - low;
  constexpr double kWhole = 1e-6;  // of a cell: what rounding leaves beyond it
  const auto cells = [&](double length) { return std::max(1.0, std::ceil(length / cell - kWhole)) * cell; };
  const Point middle = 0.5 * (low + high), half(0.5 * cells(size.x()), 0.5 * cells(size.y()));
  POLYPOD_ASSIGN(grid, Stock::block({middle.x() - half.x(), middle.y() - half.y(), bottom},
                                    {middle.x() + half.x(), middle.y() + half.y(), top}, cell));

  std::vector<Face> upper, lower;
  for (int k = 0; k < 3; ++k) {
    const Vec3 normal = R_SW.col(k);
    if (std::abs(normal.z()) < kUpright) continue;
    const Face far{normal, max[k]}, near{-normal, -min[k]};
    (normal.z() > 0 ? upper : lower).push_back(far);
    (normal.z() > 0 ? lower : upper).push_back(near);
  }
  const float highest = static_cast<float>(grid.top());
  std::vector<float> heights(grid.layers().size(), Stock::empty()), hollow(heights.size(), Stock::empty());
  bool open = false;
  for (int j = 0; j < grid.rows(); ++j) {
    for (int i = 0; i < grid.columns(); ++i) {
      const Point corner(grid.x_min() + i * cell, grid.y_min() + j * cell);
      Polygon square{corner, corner + Point(cell, 0), corner + Point(cell, cell), corner + Point(0, cell)};
      Part part{cell * cell, corner + Point(0.5 * cell, 0.5 * cell)};
      for (std::size_t e = 0; e < outline.size() && part.area > 0; ++e) {
        const Point &a = outline[e], &b = outline[(e + 1) % outline.size()];
        if (std::all_of(square.begin(), square.end(), [&](const Point& p) { return cross(b - a, p - a) >= 0; }))
          continue;
        square = left_of(square, a, b);
        part = part_of(square);
      }
      const auto kept = static_cast<int>(std::lround(part.area / (cell * cell) * Stock::kLayers));
      if (kept == 0) continue;
      double begin = bottom, end = top;
      for (const Face& face : lower) begin = std::max(begin, face.z_at(part.middle));
      for (const Face& face : upper) end = std::min(end, face.z_at(part.middle));
      if (!(end > begin)) continue;
      const auto height = std::min(highest, static_cast<float>(end)), from = static_cast<float>(begin);
      const bool above = begin > bottom + 1e-9;  // heights are kept in single precision
      open = open || above;
      const std::size_t at = (static_cast<std::size_t>(j) * grid.columns() + i) * Stock::kLayers;
      for (int k = Stock::kLayers - kept; k < Stock::kLayers; ++k) {
        heights[at + k] = height;
        if (above) hollow[at + k] = from;
      }
    }
  }
  if (!open) hollow.clear();
  return Stock::from_layers(grid.x_min(), grid.y_min(), cell, grid.columns(), grid.rows(), bottom, grid.top(),
                            std::move(heights), std::move(hollow));
}

}  // namespace polypod::cutting
