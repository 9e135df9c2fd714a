// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Solid shapes and the distance between two of them, with a bound that proves it.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::bodies {

/// A closed surface of triangles, with the tree of spheres that finds the near ones.
struct Mesh {
  struct Node {
    Vec3 centre = Vec3::Zero();
    double radius = 0;
    int first = 0, count = 0;  ///< triangles of `order`, of a leaf
    int left = -1, right = -1;
  };
  std::vector<Vec3> points;                   ///< m, in the frame of the body
  std::vector<std::array<int, 3>> triangles;  ///< corners counterclockwise seen from outside, or all the other way
  std::vector<Node> nodes;                    ///< the first is the root
  std::vector<int> order;
  std::vector<int> parts;  ///< a point of each connected part of the surface: what is wholly inside shows by these

  /// Whether the point p (m, frame of the body) is inside: the solid angle of the surface seen from it, 4 pi inside and
  /// 0 outside. Cost: 30 ns a triangle.
  [[nodiscard]] bool holds(const Vec3& p) const;
};

/// Builds the tree. Errors: BO110 (no triangles), BO111 (not closed: an edge that does not have exactly two triangles
/// which pass it in opposite directions).
Result<std::shared_ptr<const Mesh>> mesh_of(std::vector<Vec3> points, std::vector<std::array<int, 3>> triangles,
                                            const std::string& name);
/// Reads an STL file, binary or text; equal corners are joined. `unit` is in m. Errors: FI100, BO112 (no STL file, or
/// cut short), BO110, BO111.
Result<std::shared_ptr<const Mesh>> read_stl(const std::string& path, double unit);

/// All points within `radius` of the hull of `points`, of a cylinder about a segment, or a mesh. In the body's frame.
struct Shape {
  std::vector<Vec3> points;  ///< m: 1 a sphere, 2 a capsule (or the axis of a cylinder), 8 a box
  double radius = 0;         ///< m, round the hull
  double across = 0;         ///< m: above 0, a cylinder of this radius about the segment of the two points
  std::shared_ptr<const Mesh> mesh;

  /// The largest distance of its points from p, m, rounded up by the corner of a cylinder.
  [[nodiscard]] double extent(const Vec3& p) const;
};
Shape capsule(const Vec3& from, const Vec3& to, double radius);
Shape cylinder(const Vec3& from, const Vec3& to, double radius);
Shape box(const Vec3& min, const Vec3& max);
/// A shape in the frame in which its own stands at X. Cost: linear in its points.
Shape placed(Shape shape, const Pose& X);

/// low <= distance <= high, m. `low` follows from a plane between the shapes, so it holds whether or not the iteration
/// came to its end; 0 where none was found.
struct Bracket {
  double low = 0, high = 0;
};
/// The distance of two shapes in the frames X_A and X_B. Gilbert, Johnson and Keerthi (1988) on the support of hulls
/// and cylinders, each pair of a mesh on its triangles; capsules by the closest points of their axes. Ends as soon as
/// `low` reaches `enough` (of meshes: the distance is then at least that). Bodies of which one lies in a mesh without
/// touching its surface are apart here: ask Mesh::holds. Cost: 30 ns (capsules), about 1 us (hulls).
Bracket distance(const Shape& a, const Pose& X_A, const Shape& b, const Pose& X_B, double enough);

}  // namespace polypod::bodies
