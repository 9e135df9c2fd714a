// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The part of a box that lies in several half spaces at once.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "polypod/geometry/pose.hpp"

namespace polypod::workspace {

/// A convex polyhedron as a set of polygons, cut from a box plane by plane. Volumes are exact to rounding, some 1e-14
/// of the box. Keeps its memory between uses. Cost: about a microsecond a plane.
class Polyhedron {
 public:
  /// The box |x_k| <= half_k.
  void start(const Vec3& half) {
    faces_.clear();
    vertices_.clear();
    for (int axis = 0; axis < 3; ++axis)
      for (const double side : {-1.0, 1.0}) {
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        Face face{static_cast<int>(vertices_.size()), 4};
        for (const auto& [a, b] : {std::pair{-1, -1}, std::pair{1, -1}, std::pair{1, 1}, std::pair{-1, 1}}) {
          Vec3 p;
          p[axis] = side * half[axis];
          p[u] = side * a * half[u];  // mirrored with the side, so that all faces turn the same way seen from outside
          p[v] = b * half[v];
          vertices_.push_back(p);
        }
        faces_.push_back(face);
      }
    size_ = half.norm();
  }

  /// Keeps m + G . x >= 0.
  void cut(double m, const Vec3& G) {
    const double on_plane = 1e-12 * G.norm() * size_;  // vertices this close to the plane are on it and stay
    new_faces_.clear();
    new_vertices_.clear();
    rim_.clear();
    for (const Face& face : faces_) {
      Face kept{static_cast<int>(new_vertices_.size()), 0};
      for (int k = 0; k < face.count; ++k) {
        const Vec3& a = vertices_[static_cast<std::size_t>(face.first + k)];
        const Vec3& b = vertices_[static_cast<std::size_t>(face.first + (k + 1) % face.count)];
        const double fa = m + G.dot(a), fb = m + G.dot(b);
        const bool keep_a = fa >= -on_plane, keep_b = fb >= -on_plane;
        if (keep_a) new_vertices_.push_back(a);
        if (keep_a != keep_b) {
          const Vec3 p = a + (b - a) * std::clamp(fa / (fa - fb), 0.0, 1.0);
          new_vertices_.push_back(p);
          rim_.push_back(p);
        }
      }
      kept.count = static_cast<int>(new_vertices_.size()) - kept.first;
      if (kept.count >= 3) {
        new_faces_.push_back(kept);
      } else {
        new_vertices_.resize(static_cast<std::size_t>(kept.first));
      }
    }
    faces_.swap(new_faces_);
    vertices_.swap(new_vertices_);
    if (rim_.size() >= 3) close();
  }

  /// Nothing is left but what lies on the planes to rounding.
  [[nodiscard]] bool empty() const { return faces_.empty(); }

  /// The axis-parallel box about what is left. Not for an empty body.
  void hull(Vec3& low, Vec3& high) const {
    low = high = vertices_.front();
    for (const Vec3& p : vertices_) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  }

  /// Sum of the pyramids from one vertex over the faces.
  [[nodiscard]] double volume() const {
    if (faces_.size() < 4) return 0;
    const Vec3& apex = vertices_.front();
    double six = 0;
    for (const Face& face : faces_) {
      const Vec3 a = vertices_[static_cast<std::size_t>(face.first)] - apex;
      for (int k = 1; k + 1 < face.count; ++k) {
        const Vec3 b = vertices_[static_cast<std::size_t>(face.first + k)] - apex;
        const Vec3 c = vertices_[static_cast<std::size_t>(face.first + k + 1)] - apex;
        six += a.dot(b.cross(c));
      }
    }
    return std::abs(six) / 6;
  }

 private:
  struct Face {
    int first, count;
  };

  /// Adds the cut face: the rim's points sorted round their middle.
  void close() {
    Vec3 middle = Vec3::Zero();
    for (const Vec3& p : rim_) middle += p / static_cast<double>(rim_.size());
    Vec3 u = Vec3::Zero(), n = Vec3::Zero();
    for (const Vec3& p : rim_)
      if ((p - middle).squaredNorm() > u.squaredNorm()) u = p - middle;
    for (const Vec3& p : rim_) {
      const Vec3 c = u.cross(p - middle);
      if (c.squaredNorm() > n.squaredNorm()) n = c;
    }
    if (!(n.norm() > 0)) return;
    const Vec3 v = n.cross(u).normalized() * u.norm();
    // Grows as atan2(y, x) does, from -2 to 2.
    const auto turn = [&](const Vec3& p) {
      const double x = u.dot(p - middle), y = v.dot(p - middle), size = std::abs(x) + std::abs(y);
      if (size == 0) return 0.0;
      return x >= 0 ? y / size : y >= 0 ? 2 - y / size : -2 - y / size;
    };
    std::sort(rim_.begin(), rim_.end(), [&](const Vec3& a, const Vec3& b) { return turn(a) < turn(b); });
    // Turn it like the other faces: seen from outside, against the clock. The middle of the body is inside.
    Vec3 inside = Vec3::Zero();
    for (const Vec3& p : vertices_) inside += p / static_cast<double>(vertices_.size());
    if (n.dot(middle - inside) < 0) std::reverse(rim_.begin(), rim_.end());
    faces_.push_back({static_cast<int>(vertices_.size()), static_cast<int>(rim_.size())});
    vertices_.insert(vertices_.end(), rim_.begin(), rim_.end());
  }

  std::vector<Face> faces_, new_faces_;
  std::vector<Vec3> vertices_, new_vertices_, rim_;
  double size_ = 0;
};

}  // namespace polypod::workspace
