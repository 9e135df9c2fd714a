// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The geometry of one move.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "polypod/gcode/interpreter.hpp"

namespace polypod::gcode {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

/// The first and second axis of a plane and its normal, a right-handed triple.
std::array<int, 3> axes_of(Plane plane) {
  switch (plane) {
    case Plane::zx:
      return {2, 0, 1};
    case Plane::yz:
      return {1, 2, 0};
    case Plane::xy:
      break;
  }
  return {0, 1, 2};
}

/// An arc in the coordinates of its plane, turned so that it always runs counterclockwise.
struct Arc {
  explicit Arc(const Move& move) : axes(axes_of(move.plane)), turn(move.clockwise ? -1 : 1), sweep(move.sweep) {
    const Vec3 from = move.start - move.centre;
    const Vec3 to = move.end - move.centre;
    start_angle = std::atan2(turn * from[axes[1]], from[axes[0]]);
    start_radius = std::hypot(from[axes[0]], from[axes[1]]);
    end_radius = std::hypot(to[axes[0]], to[axes[1]]);
    rise = move.end[axes[2]] - move.start[axes[2]];
  }
  [[nodiscard]] double radius(double angle) const {
    return sweep > 0 ? start_radius + (end_radius - start_radius) * (angle / sweep) : start_radius;
  }
  [[nodiscard]] double length() const { return std::hypot(sweep * (start_radius + end_radius) / 2, rise); }

  std::array<int, 3> axes;
  double turn;
  double sweep;
  double start_angle = 0;
  double start_radius = 0;
  double end_radius = 0;
  double rise = 0;
};

/// The angle 0 <= t <= sweep at which the helix is closest to a point with polar coordinates rho, phi (from the start,
/// in the sense of the turn) and the height z above the start.
///
/// The squared distance is r^2 + rho^2 - 2 r rho cos(t - phi) + (z - h t)^2 with h = rise / sweep; half its derivative
/// is f(t) = r rho sin(t - phi) - h (z - h t). A t farther than one turn from z / h (cut to the range) is beaten by the
/// t one turn nearer, so only two turns have to be searched; between the zeros of f', known in closed form, f is
/// monotone and has one zero at most.
double nearest_on_helix(const Arc& arc, double rho, double phi, double z) {
  const double r = (arc.start_radius + arc.end_radius) / 2;
  const double h = arc.sweep > 0 ? arc.rise / arc.sweep : 0;
  const auto distance = [&](double t) {
    const double height = z - h * t;
    return -2 * r * rho * std::cos(t - phi) + height * height;
  };
  const auto slope = [&](double t) { return r * rho * std::sin(t - phi) - h * (z - h * t); };
  const double level = h != 0 ? std::clamp(z / h, 0.0, arc.sweep) : 0;
  const double low = std::max(0.0, level - kTurn);
  const double high = std::min(arc.sweep, level + kTurn);

  // The ends of the monotone pieces of f: cos(t - phi) = -h^2 / (r rho).
  std::array<double, 16> knots{};
  std::size_t count = 0;
  knots[count++] = low;
  if (r * rho > h * h) {
    const double offset = std::acos(-(h * h) / (r * rho));
    for (const double base : {phi - offset, phi + offset}) {
      for (double t = base + kTurn * std::ceil((low - base) / kTurn); t < high && count < knots.size() - 1;
           t += kTurn) {
        if (t > low) knots[count++] = t;
      }
    }
  }
  knots[count++] = high;
  std::sort(knots.begin(), knots.begin() + static_cast<std::ptrdiff_t>(count));

  double best = 0;
  double best_distance = distance(0);
  const auto offer = [&](double t) {
    const double d = distance(t);
    if (d < best_distance) {
      best = t;
      best_distance = d;
    }
  };
  offer(arc.sweep);
  for (std::size_t k = 0; k + 1 < count; ++k) {
    double a = knots[k];
    double b = knots[k + 1];
    if (!(slope(a) <= 0 && slope(b) >= 0)) continue;  // no minimum inside
    double t = (a + b) / 2;
    for (int step = 0; step < 80 && b - a > 1e-15 * (1 + std::abs(t)); ++step) {
      const double f = slope(t);
      if (f > 0) {
        b = t;
      } else {
        a = t;
      }
      const double df = r * rho * std::cos(t - phi) + h * h;
      const double newton = df > 0 ? t - f / df : a;
      const double next = newton > a && newton < b ? newton : (a + b) / 2;
      if (std::abs(next - t) <= 1e-16 * (1 + std::abs(t))) break;
      t = next;
    }
    offer(t);
  }
  return best;
}

}  // namespace

double Move::length() const {
  return kind == MoveKind::arc ? Arc(*this).length() : (end - start).norm();
}

Vec3 Move::point(double s) const {
  if (s <= 0) return start;
  const double total = length();
  if (s >= total) return end;
  const double f = s / total;
  if (kind != MoveKind::arc) return start + f * (end - start);
  const Arc arc(*this);
  const double t = f * arc.sweep;
  const double angle = arc.start_angle + t;
  Vec3 p;
  p[arc.axes[0]] = centre[arc.axes[0]] + arc.radius(t) * std::cos(angle);
  p[arc.axes[1]] = centre[arc.axes[1]] + arc.turn * arc.radius(t) * std::sin(angle);
  p[arc.axes[2]] = start[arc.axes[2]] + f * arc.rise;
  return p;
}

Vec3 Move::direction(double s) const {
  const double total = length();
  if (!(total > 0)) return Vec3::Zero();
  if (kind != MoveKind::arc) return (end - start) / total;
  const Arc arc(*this);
  const double t = std::clamp(s / total, 0.0, 1.0) * arc.sweep;
  const double angle = arc.start_angle + t;
  const double outward = (arc.end_radius - arc.start_radius) / arc.sweep;
  const double along = arc.radius(t);
  Vec3 d;
  d[arc.axes[0]] = outward * std::cos(angle) - along * std::sin(angle);
  d[arc.axes[1]] = arc.turn * (outward * std::sin(angle) + along * std::cos(angle));
  d[arc.axes[2]] = arc.rise / arc.sweep;
  return d.normalized();
}

double Move::nearest(const Vec3& p) const {
  const double total = length();
  if (!(total > 0)) return 0;
  if (kind != MoveKind::arc) return std::clamp((p - start).dot(end - start) / total, 0.0, total);
  const Arc arc(*this);
  const double u = p[arc.axes[0]] - centre[arc.axes[0]];
  const double v = arc.turn * (p[arc.axes[1]] - centre[arc.axes[1]]);
  double phi = std::atan2(v, u) - arc.start_angle;
  if (phi < 0) phi += kTurn;
  if (phi >= kTurn) phi -= kTurn;
  const double t = nearest_on_helix(arc, std::hypot(u, v), phi, p[arc.axes[2]] - start[arc.axes[2]]);
  return std::clamp(total * (t / arc.sweep), 0.0, total);
}

}  // namespace polypod::gcode
