// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/bodies/shape.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "polypod/geometry/segments.hpp"

namespace polypod::bodies {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Rounding of a distance, as a share of the coordinates' size.
constexpr double kRounding = 1e-13;
// A direction this near to the axis of a cylinder, rad, counts as parallel: its support is then low by this times the
// radius at most.
constexpr double kParallel = 1e-9;
constexpr int kIterations = 60;
// Brackets narrower than this are narrow enough, m.
constexpr double kNarrow = 1e-8;

/// A convex core in M: a hull of points or a cylinder.
struct Core {
  const Vec3* points = nullptr;
  int count = 0;
  double across = 0;
  double size = 0;  ///< of its coordinates

  [[nodiscard]] Vec3 support(const Vec3& d) const {
    int best = 0;
    double most = points[0].dot(d);
    for (int i = 1; i < count; ++i) {
      const double x = points[i].dot(d);
      if (x > most) most = x, best = i;
    }
    Vec3 p = points[best];
    if (across > 0) {
      const Vec3 axis = (points[1] - points[0]).normalized();
      Vec3 aside = d - axis * axis.dot(d);
      aside -= axis * axis.dot(aside);  // what cancelled in the first difference is large beside a short one
      const double n = aside.norm();
      if (n > kParallel * d.norm()) p += aside * (across / n);
    }
    return p;
  }
};

/// The point of the hull of up to four points that is nearest to the origin; keeps only those that it needs.
Vec3 nearest_of(Vec3* s, int& count) {
  Vec3 best = s[0];
  double least = kInfinity;
  int used = 1;
  for (int mask = 1; mask < (1 << count); ++mask) {
    int index[4];
    int n = 0;
    for (int i = 0; i < count; ++i) {
      if ((mask >> i & 1) != 0) index[n++] = i;
    }
    Vec3 v = s[index[0]];
    if (n > 1) {
      Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 3> E(3, n - 1);
      for (int i = 1; i < n; ++i) E.col(i - 1) = s[index[i]] - s[index[0]];
      const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 3, 3> G = E.transpose() * E;
      const Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 3, 1> t = G.ldlt().solve(-(E.transpose() * s[index[0]]));
      // Outside of this face: another one is nearer. A share that rounding makes negative belongs to a smaller face.
      if (!t.allFinite() || t.minCoeff() < 0 || t.sum() > 1) continue;
      v += E * t;
    }
    const double d = v.squaredNorm();
    if (d < least) least = d, best = v, used = mask;
  }
  int n = 0;
  for (int i = 0; i < count; ++i) {
    if ((used >> i & 1) != 0) s[n++] = s[i];
  }
  count = n;
  return best;
}

Bracket core_distance(const Core& a, const Core& b, double enough) {
  const double rounding = kRounding * (a.size + b.size) + kParallel * (a.across + b.across);
  Vec3 simplex[4];
  Vec3 v = a.points[0] - b.points[0];
  simplex[0] = v;
  int count = 1;
  Bracket out{0, v.norm()};
  for (int k = 0; k < kIterations; ++k) {
    const double norm = v.norm();
    out.high = std::min(out.high, norm);
    if (norm <= rounding) return {0, 0};
    const Vec3 w = a.support(-v) - b.support(v);
    out.low = std::max(out.low, v.dot(w) / norm - rounding);
    if (out.low >= enough || out.high - out.low < kNarrow) break;
    if (count == 4) break;  // four points round the origin: inside, but for rounding
    simplex[count++] = w;
    const Vec3 next = nearest_of(simplex, count);
    if (!(next.squaredNorm() < v.squaredNorm())) break;
    v = next;
  }
  out.low = std::min(out.low, out.high);  // equal but for rounding
  return out;
}

/// Points of a shape in M.
struct Placed {
  std::array<Vec3, 8> points;
  Core core;

  Placed(const Shape& s, const Pose& X) {
    core.count = static_cast<int>(s.points.size());
    core.across = s.across;
    for (int i = 0; i < core.count; ++i) {
      points[static_cast<std::size_t>(i)] = X * s.points[static_cast<std::size_t>(i)];
      core.size = std::max(core.size, points[static_cast<std::size_t>(i)].cwiseAbs().maxCoeff() + s.across);
    }
    core.points = points.data();
  }
};

Bracket less(Bracket d, double radius) {
  return {std::max(0.0, d.low - radius), std::max(0.0, d.high - radius)};
}

/// A convex core against a mesh, in the frame of the mesh.
Bracket to_mesh(const Core& core, const Mesh& mesh, double enough) {
  double least = enough, high = kInfinity;
  std::vector<int> open{0};
  while (!open.empty()) {
    const Mesh::Node& node = mesh.nodes[static_cast<std::size_t>(open.back())];
    open.pop_back();
    const Core ball{&node.centre, 1, 0, node.centre.cwiseAbs().maxCoeff()};
    if (core_distance(core, ball, least + node.radius).low - node.radius >= least) continue;
    if (node.left >= 0) {
      open.push_back(node.left);
      open.push_back(node.right);
      continue;
    }
    for (int i = node.first; i < node.first + node.count; ++i) {
      const auto& t = mesh.triangles[static_cast<std::size_t>(mesh.order[static_cast<std::size_t>(i)])];
      const std::array<Vec3, 3> corners{mesh.points[static_cast<std::size_t>(t[0])],
                                        mesh.points[static_cast<std::size_t>(t[1])],
                                        mesh.points[static_cast<std::size_t>(t[2])]};
      double size = 0;
      for (const Vec3& c : corners) size = std::max(size, c.cwiseAbs().maxCoeff());
      const Bracket d = core_distance(core, Core{corners.data(), 3, 0, size}, least);
      least = std::min(least, d.low);
      high = std::min(high, d.high);
      if (high <= 0) return {0, 0};
    }
  }
  return {least, std::max(high, least)};
}

Pose relative(const Pose& X_A, const Pose& X_B) {
  return X_A.inverse() * X_B;
}

}  // namespace

bool Mesh::holds(const Vec3& p) const {
  double angle = 0;
  for (const auto& t : triangles) {
    const Vec3 a = points[static_cast<std::size_t>(t[0])] - p, b = points[static_cast<std::size_t>(t[1])] - p,
               c = points[static_cast<std::size_t>(t[2])] - p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    // Van Oosterom and Strackee (1983).
    angle += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return std::abs(angle) > 2 * std::numbers::pi;
}

double Shape::extent(const Vec3& p) const {
  double most = 0;
  for (const Vec3& q : mesh ? mesh->points : points) most = std::max(most, (q - p).norm());
  return most + across + radius;
}

Shape capsule(const Vec3& from, const Vec3& to, double radius) {
  return {{from, to}, radius, 0, nullptr};
}
Shape cylinder(const Vec3& from, const Vec3& to, double radius) {
  return {{from, to}, 0, radius, nullptr};
}
Shape box(const Vec3& min, const Vec3& max) {
  Shape s;
  for (int i = 0; i < 8; ++i) {
    s.points.emplace_back((i & 1) != 0 ? max.x() : min.x(), (i & 2) != 0 ? max.y() : min.y(),
                          (i & 4) != 0 ? max.z() : min.z());
  }
  return s;
}

Shape placed(Shape shape, const Pose& X) {
  for (Vec3& p : shape.points) p = X * p;
  if (shape.mesh) {
    auto moved = std::make_shared<Mesh>(*shape.mesh);
    for (Vec3& p : moved->points) p = X * p;
    for (Mesh::Node& node : moved->nodes) {
      node.centre = X * node.centre;
      node.radius *= 1 + 1e-12;  // rounding of the motion
    }
    shape.mesh = std::move(moved);
  }
  return shape;
}

Bracket distance(const Shape& a, const Pose& X_A, const Shape& b, const Pose& X_B, double enough) {
  if (a.mesh && !b.mesh) return distance(b, X_B, a, X_A, enough);
  if (a.mesh) {
    // Two meshes: each triangle of the first against the second.
    const Pose X_BA = relative(X_B, X_A);
    Bracket out{enough, kInfinity};
    for (const auto& t : a.mesh->triangles) {
      Shape one;
      for (const int i : t) one.points.push_back(X_BA * a.mesh->points[static_cast<std::size_t>(i)]);
      const Placed placed(one, Pose{});
      const Bracket d = to_mesh(placed.core, *b.mesh, out.low);
      out = {std::min(out.low, d.low), std::min(out.high, d.high)};
      if (out.high <= 0) return {0, 0};
    }
    return {out.low, std::max(out.high, out.low)};
  }
  const double radius = a.radius + b.radius;
  if (b.mesh) {
    const Placed placed(a, relative(X_B, X_A));
    return less(to_mesh(placed.core, *b.mesh, enough + radius), radius);
  }
  const Placed p(a, X_A), q(b, X_B);
  if (p.core.count == 2 && q.core.count == 2 && a.across == 0 && b.across == 0) {
    const double d = segment_distance(p.points[0], p.points[1], q.points[0], q.points[1]);
    return less({d - kRounding * (p.core.size + q.core.size), d}, radius);
  }
  return less(core_distance(p.core, q.core, enough + radius), radius);
}

}  // namespace polypod::bodies
