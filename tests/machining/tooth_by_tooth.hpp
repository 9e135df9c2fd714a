// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A soft tool that cuts tooth by tooth, in time and in the plane: an oracle for predict and correct that shares neither
// their stock nor their force model nor their balance.
//
// The material is kept as intervals along rows of the plane. A tooth is the outer part of a radius that turns with the
// spindle; in each step it takes the quadrilateral between its last angle and the new one out of the rows, and what it
// takes over the length of its way is its chip, whichever tooth left the surface before (regeneration). In every step
// the tip is where command + C F of these chips is, found by Newton's method.
//
// The cutter is a stack of layers, each with material of its own, whose teeth lag evenly behind those of the layer
// below, as those of a helix that is one pitch deep: the force is steady, as for a robot, which is far too slow for the
// single tooth (10 to 20 Hz against some hundreds).
//
// Its own error: rows, steps and layers, which the test makes finer.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace polypod::testing {

using Point = Eigen::Vector2d;

/// A part of the plane as rows of intervals, m.
class Rows {
 public:
  Rows(const Point& low, const Point& high, double pitch) : low_(low), pitch_(pitch) {
    const auto count = static_cast<std::size_t>(std::ceil((high.y() - low.y()) / pitch));
    rows_.assign(count, {{low.x(), high.x()}});
  }

  /// Takes out what lies within `radius` of the way from a to b.
  void take_stadium(const Point& a, const Point& b, double radius) {
    const Point d = b - a;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const double y = y_of(i);
      double from = std::numeric_limits<double>::infinity(), to = -from;
      const auto add = [&](double x) {
        from = std::min(from, x);
        to = std::max(to, x);
      };
      for (const Point& end : {a, b}) {
        const double square = radius * radius - (y - end.y()) * (y - end.y());
        if (square < 0) continue;
        add(end.x() - std::sqrt(square));
        add(end.x() + std::sqrt(square));
      }
      if (d.norm() > 0) {
        const Point across = Point(-d.y(), d.x()).normalized() * radius;
        const std::array<Point, 4> corners{a + across, b + across, b - across, a - across};
        if (const auto [x0, x1] = section(corners, y); x0 < x1) {
          add(x0);
          add(x1);
        }
      }
      if (from < to) take(rows_[i], from, to);
    }
  }

  /// The area of what is left within a quadrilateral.
  [[nodiscard]] double within(const std::array<Point, 4>& corners) const {
    double area = 0;
    each_section(corners, [&](std::size_t i, double from, double to) {
      for (const auto& [a, b] : rows_[i]) area += std::max(0.0, std::min(b, to) - std::max(a, from)) * pitch_;
    });
    return area;
  }
  void take_quadrilateral(const std::array<Point, 4>& corners) {
    each_section(corners, [&](std::size_t i, double from, double to) { take(rows_[i], from, to); });
  }

  [[nodiscard]] double y_of(std::size_t row) const { return low_.y() + (static_cast<double>(row) + 0.5) * pitch_; }
  using Row = std::vector<std::pair<double, double>>;
  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }

 private:
  template <class Visit>
  void each_section(const std::array<Point, 4>& corners, const Visit& visit) const {
    const auto [lowest, highest] = std::minmax({corners[0].y(), corners[1].y(), corners[2].y(), corners[3].y()});
    const double first = std::max(0.0, std::ceil((lowest - low_.y()) / pitch_ - 0.5));
    for (auto i = static_cast<std::size_t>(first); i < rows_.size() && y_of(i) <= highest; ++i) {
      const auto [from, to] = section(corners, y_of(i));
      if (from < to) visit(i, from, to);
    }
  }

  /// Where a line of constant y crosses the hull of four corners.
  static std::pair<double, double> section(const std::array<Point, 4>& corners, double y) {
    double from = std::numeric_limits<double>::infinity(), to = -from;
    for (std::size_t i = 0; i < 4; ++i) {
      const Point &a = corners[i], &b = corners[(i + 1) % 4];
      if ((a.y() > y) == (b.y() > y)) continue;
      const double x = a.x() + (b.x() - a.x()) * (y - a.y()) / (b.y() - a.y());
      from = std::min(from, x);
      to = std::max(to, x);
    }
    return {from, to};
  }

  static void take(Row& row, double from, double to) {
    for (std::size_t k = 0; k < row.size();) {
      auto& [a, b] = row[k];
      if (b <= from || a >= to) {
        ++k;
        continue;
      }
      const double low = std::max(a, from), high = std::min(b, to);
      if (low > a && high < b) {
        const double end = b;
        b = low;
        row.insert(row.begin() + static_cast<std::ptrdiff_t>(k) + 1, {high, end});
        k += 2;
      } else if (low > a) {
        b = low;
        ++k;
      } else if (high < b) {
        a = high;
        ++k;
      } else {
        row.erase(row.begin() + static_cast<std::ptrdiff_t>(k));
      }
    }
  }

  Point low_;
  double pitch_;
  std::vector<Row> rows_;
};

struct ToothCutter {
  double radius = 0;
  int teeth = 1;
  double speed = 0;                                ///< revolutions a second, clockwise from above
  Eigen::Vector3d chip = Eigen::Vector3d::Zero();  ///< tangential, radial, axial, N/m^2
  Eigen::Vector3d edge = Eigen::Vector3d::Zero();  ///< the same, N/m
  double thinnest = 0.5e-6;                        ///< m, of a chip from which on the edge forces are whole
};

/// The command goes to `to` at `feed`, m/s.
struct Command {
  Eigen::Vector3d to;
  double feed = 0;
};

struct Tip {
  Eigen::Vector3d command, tip, force;
  std::size_t piece = 0;
  double rest = 0;  ///< m, by which the balance is missed
};

/// The way of a soft tip along the commands, from `start` on. `compliance(command)` is C there; z of the material's top
/// is 0. `layers`: the material, all alike at first. `passing`: steps while one tooth follows the other.
template <class Compliance>
std::vector<Tip> cut_tooth_by_tooth(std::vector<Rows>& layers, const ToothCutter& cutter, const Compliance& compliance,
                                    const Tip& start, const std::vector<Command>& commands, int passing) {
  using Vector = Eigen::Vector3d;
  using Matrix = Eigen::Matrix3d;
  constexpr double kThickest = 1.2e-3;        // m, of a chip: what lies deeper inside was cut before
  constexpr double kSameCompliance = 0.1e-3;  // m: it changes by less than 1e-4 on this way
  constexpr double kBalanced = 0.02e-6;
  constexpr int kMostSteps = 30;
  const double pitch = 2 * std::numbers::pi / cutter.teeth, turn = pitch / passing;
  const double inner = cutter.radius - kThickest, dt = 1 / (cutter.speed * cutter.teeth * passing);
  const auto edge_at = [&](const Point& x, double a0, double a1) -> std::array<Point, 4> {
    const Point e0(std::cos(a0), std::sin(a0)), e1(std::cos(a1), std::sin(a1));
    return {x + inner * e0, x + cutter.radius * e0, x + cutter.radius * e1, x + inner * e1};
  };
  double angle = 0;
  const auto each_edge = [&](const auto& visit) {
    for (std::size_t k = 0; k < layers.size(); ++k) {
      for (int tooth = 0; tooth < cutter.teeth; ++tooth) {
        visit(layers[k], angle + pitch * (tooth + static_cast<double>(k) / static_cast<double>(layers.size())));
      }
    }
  };
  // The force at a tip, and its derivative.
  const auto force_at = [&](const Vector& tip, Matrix& by_tip) {
    const double slice = std::max(0.0, -tip.z()) / static_cast<double>(layers.size());
    Vector out = Vector::Zero();
    by_tip.setZero();
    each_edge([&](Rows& material, double a) {
      const double chip = material.within(edge_at(tip.head<2>(), a, a - turn)) / (cutter.radius * turn);
      if (chip == 0) return;
      const double middle = a - turn / 2;
      const Vector e(std::cos(middle), std::sin(middle), 0), along(e.y(), -e.x(), 0);  // the tooth's way
      const auto on_tool = [&](const Vector& k) {
        return Vector(slice * (-k[0] * along - k[1] * e + k[2] * Vector::UnitZ()));
      };
      out += on_tool(cutter.chip * chip + cutter.edge * std::min(1.0, chip / cutter.thinnest));
      by_tip += on_tool(cutter.chip +
                        (chip < cutter.thinnest ? Vector(cutter.edge / cutter.thinnest) : Vector(Vector::Zero()))) *
                e.transpose();
    });
    return out;
  };
  Tip now = start;
  Vector seen = start.command;
  Matrix C = compliance(seen), by_tip;
  std::vector<Tip> out;
  for (std::size_t piece = 0; piece < commands.size(); ++piece) {
    now.piece = piece;
    const Vector from = now.command, way = commands[piece].to - from;
    const auto count = static_cast<std::size_t>(std::ceil(way.norm() / commands[piece].feed / dt));
    for (std::size_t k = 1; k <= count; ++k) {
      now.command = from + way * (static_cast<double>(k) / static_cast<double>(count));
      if ((now.command - seen).norm() > kSameCompliance) C = compliance(seen = now.command);
      const auto off = [&](const Vector& tip, Vector& force) {
        force = force_at(tip, by_tip);
        return Vector(tip - now.command - C * force);
      };
      // The edges come and go: what is sought has kinks, at which a step may have to go uphill for a while.
      Vector tip = now.tip, force, r = off(tip, force);
      now.force = force;
      double least = r.norm();
      std::array<double, 5> before;
      before.fill(least);
      for (int i = 0; i < kMostSteps && least > kBalanced; ++i) {
        const Vector step = -(Matrix::Identity() - C * by_tip).partialPivLu().solve(r);
        const Vector from_here = tip;
        for (double share = 1; share > 0.05; share /= 2) {
          tip = from_here + share * step;
          r = off(tip, force);
          if (r.norm() < *std::max_element(before.begin(), before.end())) break;
        }
        before[static_cast<std::size_t>(i) % before.size()] = r.norm();
        if (r.norm() >= least) continue;
        least = r.norm();
        now.tip = tip;
        now.force = force;
      }
      now.rest = least;
      each_edge(
          [&](Rows& material, double a) { material.take_quadrilateral(edge_at(now.tip.head<2>(), a, a - turn)); });
      angle -= turn;
      out.push_back(now);
    }
  }
  return out;
}

}  // namespace polypod::testing
