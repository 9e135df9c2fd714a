// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Distances between straight segments, the axes of legs.
#pragma once

#include <algorithm>

#include "polypod/core/box_number.hpp"
#include "polypod/core/interval.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod {

/// Closest points of the segments p + s a and q + t b, 0 <= s, t <= 1: the parameters s and t.
struct ClosestParameters {
  double s = 0;
  double t = 0;
};

/// Minimises |p + s a - q - t b| over the unit square (JEL (4.10) to (4.16), with the cases that the source leaves out:
/// parallel segments, both parameters outside, segments of no length). Where segments are parallel, one of the many
/// closest pairs. Exact up to rounding. Cost: about 10 ns.
inline ClosestParameters closest_parameters(const Vec3& p, const Vec3& a, const Vec3& q, const Vec3& b) {
  const Vec3 r = p - q;
  const double aa = a.squaredNorm(), bb = b.squaredNorm(), ab = a.dot(b), ar = a.dot(r), br = b.dot(r);
  const auto unit = [](double x) { return std::clamp(x, 0.0, 1.0); };
  if (!(aa > 0) && !(bb > 0)) return {0, 0};
  if (!(aa > 0)) return {0, unit(br / bb)};
  if (!(bb > 0)) return {unit(-ar / aa), 0};
  const double determinant = aa * bb - ab * ab;
  // Nearly parallel (sine below 1e-7): the optimum over s is flat to rounding, any start does.
  double s = determinant > 1e-14 * aa * bb ? unit((ab * br - ar * bb) / determinant) : 0.0;
  double t = (ab * s + br) / bb;
  if (t < 0 || t > 1) {
    t = unit(t);
    s = unit((ab * t - ar) / aa);
  }
  return {s, t};
}

/// Distance of the segments p p' and q q'.
inline double segment_distance(const Vec3& p, const Vec3& p_end, const Vec3& q, const Vec3& q_end) {
  const Vec3 a = p_end - p, b = q_end - q;
  const ClosestParameters c = closest_parameters(p, a, q, b);
  return (p + c.s * a - q - c.t * b).norm();
}

/// Whether two segments are nearer to each other than `distance`, m: false at once where their shadows on the line
/// through their middles are farther apart. Cost: 4 ns there.
inline bool nearer_than(const Vec3& p, const Vec3& p_end, const Vec3& q, const Vec3& q_end, double distance) {
  const Vec3 u = p + p_end - q - q_end;
  const double gap = std::min(u.dot(p), u.dot(p_end)) - std::max(u.dot(q), u.dot(q_end));
  if (gap > 0 && gap * gap > distance * distance * u.squaredNorm()) return false;
  return segment_distance(p, p_end, q, q_end) < distance;
}

/// The same for boxes of end points: distance of the middles, and as much either way as an end point may move (the
/// distance changes at most as fast as the faster end of each segment).
inline Interval segment_distance(const Vector3<Interval>& p, const Vector3<Interval>& p_end, const Vector3<Interval>& q,
                                 const Vector3<Interval>& q_end) {
  const auto middle = [](const Vector3<Interval>& v) { return Vec3(v[0].mid(), v[1].mid(), v[2].mid()); };
  const auto radius = [](const Vector3<Interval>& v) {
    return 0.5 * Vec3(v[0].width(), v[1].width(), v[2].width()).norm();
  };
  const double way = std::max(radius(p), radius(p_end)) + std::max(radius(q), radius(q_end));
  const double d = segment_distance(middle(p), middle(p_end), middle(q), middle(q_end));
  if (!(way < std::numeric_limits<double>::infinity())) return {0, std::numeric_limits<double>::infinity()};
  const Interval outer = Interval::outward(d - way, d + way);
  // Rounding of the closest points: some units in the last place of the coordinates.
  const double rounding = 1e-14 * (middle(p).norm() + middle(p_end).norm() + middle(q).norm() + middle(q_end).norm());
  return {std::max(0.0, outer.lo() - rounding), outer.hi() + rounding};
}
/// The same for first-order numbers: a range without a gradient.
inline BoxNumber segment_distance(const Vector3<BoxNumber>& p, const Vector3<BoxNumber>& p_end,
                                  const Vector3<BoxNumber>& q, const Vector3<BoxNumber>& q_end) {
  const auto box = [](const Vector3<BoxNumber>& v) {
    return Vector3<Interval>({v[0].lo(), v[0].hi()}, {v[1].lo(), v[1].hi()}, {v[2].lo(), v[2].hi()});
  };
  return BoxNumber::of(segment_distance(box(p), box(p_end), box(q), box(q_end)));
}

}  // namespace polypod
