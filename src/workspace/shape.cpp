// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/shape.hpp"
#include "polypod/workspace/task_directions.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::workspace {

double Shape::volume() const {
  const double extents = half.prod();
  switch (kind) {
    case ShapeKind::box:
      break;
    case ShapeKind::cylinder:
      return 2 * std::numbers::pi * extents;
    case ShapeKind::ellipsoid:
      return 4.0 / 3 * std::numbers::pi * extents;
  }
  return 8 * extents;
}

bool Shape::holds_box(const Vec3& box_center, const Vec3& box_half) const {
  const Vec3 far = ((box_center - center).cwiseAbs() + box_half).cwiseQuotient(half);  // the farthest corner
  switch (kind) {
    case ShapeKind::box:
      return far.maxCoeff() <= 1;
    case ShapeKind::cylinder:
      return far.z() <= 1 && far.head<2>().squaredNorm() <= 1;
    case ShapeKind::ellipsoid:
      return far.squaredNorm() <= 1;
  }
  return false;
}

bool Shape::meets_box(const Vec3& box_center, const Vec3& box_half) const {
  const Vec3 near = ((box_center - center).cwiseAbs() - box_half).cwiseMax(0).cwiseQuotient(half);  // the nearest point
  switch (kind) {
    case ShapeKind::box:
      return near.maxCoeff() < 1;
    case ShapeKind::cylinder:
      return near.z() < 1 && near.head<2>().squaredNorm() < 1;
    case ShapeKind::ellipsoid:
      return near.squaredNorm() < 1;
  }
  return true;
}

Result<ShapeKind> shape_kind(std::string_view name) {
  for (const ShapeKind kind : {ShapeKind::box, ShapeKind::cylinder, ShapeKind::ellipsoid})
    if (name == name_of(kind)) return kind;
  return fail("WS121", fmt::format("unknown shape \"{}\"", name), {}, "shapes: box, cylinder, ellipsoid");
}

const char* name_of(ShapeKind kind) {
  switch (kind) {
    case ShapeKind::box:
      break;
    case ShapeKind::cylinder:
      return "cylinder";
    case ShapeKind::ellipsoid:
      return "ellipsoid";
  }
  return "box";
}

namespace {

/// Points of the border that leave the workspace first when a shape grows: corners, or what lies towards them, and the
/// middles of the sides.
std::vector<Vec3> border_points(const Shape& shape) {
  std::vector<Vec3> points;
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z) {
        Vec3 p(x, y, z);
        if (p.isZero()) continue;
        if (shape.kind == ShapeKind::ellipsoid) {
          p.normalize();
        } else if (shape.kind == ShapeKind::cylinder && x != 0 && y != 0) {
          p.head<2>() *= std::sqrt(0.5);
        }
        points.push_back(shape.center + p.cwiseProduct(shape.half));
      }
  return points;
}

}  // namespace

std::optional<Missed> missed_in(const AnyMachine& machine, const Options& options, const Shape& box) {
  constexpr int kSteps = 4;
  const LimitBits heeded = checked_limits(machine, options);
  const auto reason = [&](const kinematics::InverseResult& result) {
    if (result.solutions.empty()) return result.reason;
    const auto broken = [&](const kinematics::Solution& s) { return std::popcount(s.violations & heeded); };
    const auto fewest = std::min_element(result.solutions.begin(), result.solutions.end(),
                                         [&](const auto& a, const auto& b) { return broken(a) < broken(b); });
    return fmt::format("{}", fmt::join(kinematics::limit_names(machine, fewest->violations & heeded), ", "));
  };
  std::vector<Vec3> points;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      for (int k = 0; k <= kSteps; ++k) {
        points.push_back(box.center + (Vec3(i, j, k) * (2.0 / kSteps) - Vec3::Ones()).cwiseProduct(box.half));
      }
    }
  }
  const auto from_middle = [&](const Vec3& p) { return (p - box.center).cwiseQuotient(box.half).squaredNorm(); };
  std::stable_sort(points.begin(), points.end(),
                   [&](const Vec3& a, const Vec3& b) { return from_middle(a) > from_middle(b); });
  for (const Mat3& R : sampled_orientations(options.directions)) {
    for (const Vec3& p : points) {
      if (reaches_samples(machine, options, {R}, p)) continue;
      const Pose X = pose_at(kinematics::task(machine), R, p);
      return Missed{X, reason(kinematics::inverse(machine, X))};
    }
  }
  return std::nullopt;
}

Result<Shape> largest_inside(const AnyMachine& machine, const Options& options, ShapeKind kind) {
  Options coarse = options;
  coarse.keep_cells = true;
  coarse.bounds_tolerance = 0;  // its box is only where the search starts
  coarse.relative_tolerance = std::max(options.relative_tolerance, 0.1);
  POLYPOD_ASSIGN(region, volume(machine, coarse));
  const std::vector<Mat3> orientations = sampled_orientations(options.directions);
  // Over many directions each proof takes a tenth of a second: fewer starts and coarser steps then.
  const bool many = orientations.size() > 1;
  const std::size_t most_starts = many ? 3 : 6;
  const double finest = many ? 0.06 : 0.01;
  // Starts: the middle of the certain cells by volume, and the largest certain cells. A workspace that is a box itself
  // has none off its border: there the cells that hold a part for certain.
  Vec3 middle = Vec3::Zero();
  double weight = 0;
  std::vector<Cell> inner;
  const auto take = [&](const Cell& cell) {
    middle += cell.lower * cell.center;
    weight += cell.lower;
    inner.push_back(cell);
  };
  for (const Cell& cell : region.cells)
    if (cell.state == CellState::inside) take(cell);
  if (inner.empty()) {
    for (const Cell& cell : region.cells)
      if (cell.lower > 0) take(cell);
  }
  if (!(weight > 0)) {
    return fail("WS120", "no box at all is certainly inside the workspace, so no shape can be proven to fit");
  }
  middle /= weight;
  std::stable_sort(inner.begin(), inner.end(), [](const Cell& a, const Cell& b) { return a.lower > b.lower; });
  std::vector<Vec3> starts{middle};
  for (std::size_t i = 0; i < std::min(most_starts, inner.size()); ++i) starts.push_back(inner[i].center);

  // Boxes a question; shapes that only just fit are given up. A box costs as many looks as directions matter to it.
  const std::int64_t patience = many ? 150 : 5000;
  // Most shapes that are tried are too large, which some point on their border shows at once.
  const auto holds = [&](const Shape& shape) {
    for (const Vec3& p : border_points(shape))
      if (!reaches_samples(machine, options, orientations, p)) return false;
    const auto answer = certainly_holds(machine, options, shape, patience);
    return answer && *answer;
  };
  const auto shaped = [&](Shape shape) {
    if (kind == ShapeKind::cylinder) shape.half[1] = shape.half[0];
    return shape;
  };
  Shape best{kind, middle, Vec3::Zero()};
  for (const Vec3& start : starts) {
    Shape shape{kind, start, Vec3::Zero()};
    // As large as fits with the proportions of the region, by bisection.
    const Vec3 extents = 0.5 * (region.max - region.min);
    double fits = 0, too_large = 1;
    for (int k = 0; k < 12; ++k) {
      const double scale = 0.5 * (fits + too_large);
      shape.half = scale * extents;
      shape = shaped(shape);
      (holds(shape) ? fits : too_large) = scale;
    }
    if (fits == 0) continue;
    shape.half = fits * extents;
    shape = shaped(shape);
    // Stretch one extent, or move along an axis, or both at once towards one side; shorter steps when none helps.
    for (double step = 0.25; step >= finest;) {
      bool better = false;
      for (int axis = 0; axis < 3; ++axis) {
        if (kind == ShapeKind::cylinder && axis == 1) continue;
        const std::vector<int> moved =
            kind == ShapeKind::cylinder && axis == 0 ? std::vector<int>{0, 1} : std::vector{axis};
        for (const int move_axis : moved)
          for (const double side : {0.0, 1.0, -1.0}) {
            Shape next = shape;
            next.half[axis] *= 1 + step;
            next.center[move_axis] += side * step * shape.half[move_axis];
            next = shaped(next);
            if (next.volume() > shape.volume() && holds(next)) {
              shape = next;
              better = true;
            }
          }
      }
      // Trade one extent for another.
      for (int grow = 0; grow < 3; ++grow)
        for (int shrink = 0; shrink < 3; ++shrink) {
          if (grow == shrink || (kind == ShapeKind::cylinder && (grow == 1 || shrink == 1))) continue;
          for (const int axis : {0, 1, 2})
            for (const double side : {0.0, 1.0, -1.0}) {
              if (side == 0 && axis > 0) continue;
              Shape next = shape;
              next.half[shrink] *= 1 - 0.5 * step;
              next.half[grow] *= 1 + step;
              next.center[axis] += side * 0.5 * step * shape.half[axis];
              next = shaped(next);
              if (next.volume() > shape.volume() * (1 + 1e-9) && holds(next)) {
                shape = next;
                better = true;
              }
            }
        }
      if (!better) step *= 0.5;
    }
    if (shape.volume() > best.volume()) best = shape;
  }
  if (!(best.volume() > 0)) return fail("WS120", "no shape of this kind could be proven to fit");
  return best;
}

}  // namespace polypod::workspace
