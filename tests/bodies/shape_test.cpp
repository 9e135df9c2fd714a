// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Distances of shapes against closed forms and against a dense sampling of one of the two.
#include "polypod/bodies/shape.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <random>

#include "meshes.hpp"
#include "polypod/bodies/stl.hpp"

namespace polypod::bodies {
namespace {

// Brackets are narrow to 1e-8 m; closed forms round at 1e-15.
constexpr double kClose = 1e-7;

Pose random_pose(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> u(-1, 1);
  Pose X;
  X.R = rotation_of(3 * Vec3(u(random), u(random), u(random)));
  X.p = size * Vec3(u(random), u(random), u(random));
  return X;
}

/// The distance of a point from each kind of shape, in closed form, in the frame of the shape.
double to_box(const Vec3& p, const Vec3& min, const Vec3& max) {
  return (p - p.cwiseMax(min).cwiseMin(max)).norm();
}
double to_cylinder(const Vec3& p, double height, double radius) {  // from 0 to `height` on z
  const double aside = std::max(0.0, std::hypot(p.x(), p.y()) - radius);
  const double along = std::max({0.0, -p.z(), p.z() - height});
  return std::hypot(aside, along);
}

TEST(Distance, OfASphereFromABoxACylinderAndAMeshIsThatOfTheClosedForm) {
  std::mt19937 random(1);
  const Vec3 min(-0.1, -0.2, 0), max(0.3, 0.1, 0.15);
  const Shape a = box(min, max), c = cylinder(Vec3::Zero(), Vec3(0, 0, 0.4), 0.06);
  Shape m;
  m.mesh = cube(min, max);
  int touching = 0;
  for (int i = 0; i < 20000; ++i) {
    const Pose X = random_pose(random, 0.6), Y = random_pose(random, 0.6);
    const double r = 0.05;
    const Shape ball{{Vec3::Zero()}, r, 0, nullptr};
    const Vec3 p = X.inverse() * Y.p;
    const double inside = (p.array() > min.array()).all() && (p.array() < max.array()).all() ? 1 : 0;
    const double of_box = std::max(0.0, to_box(p, min, max) - r);
    const double of_cylinder = std::max(0.0, to_cylinder(p, 0.4, 0.06) - r);
    const Bracket b = distance(a, X, ball, Y, 10), d = distance(ball, Y, c, X, 10), s = distance(m, X, ball, Y, 10);
    touching += of_box == 0 ? 1 : 0;
    EXPECT_LE(b.low, of_box + 1e-12);
    EXPECT_NEAR(b.high, of_box, kClose);
    EXPECT_NEAR(b.low, of_box, kClose);
    EXPECT_LE(d.low, of_cylinder + 1e-12);
    EXPECT_NEAR(d.low, of_cylinder, 1e-5);  // curved rims: the iteration may end at its count
    EXPECT_EQ(m.mesh->holds(p), inside == 1);
    if (inside == 0) {
      EXPECT_LE(s.low, of_box + 1e-12);
      EXPECT_NEAR(s.low, of_box, kClose);
    }
  }
  EXPECT_GT(touching, 300);
}

TEST(Distance, IsNeverAboveThatOfAnyTwoPoints) {
  // 10^5 random pairs of capsules, boxes and cylinders. Points of one body are carried by closed forms to the other:
  // no lower bound may be above the least of them, and bodies that share a point are never free.
  std::mt19937 random(2);
  std::uniform_real_distribution<double> u(0, 1);
  constexpr int kCases = 100000;
  int shared = 0;
  for (int i = 0; i < kCases; ++i) {
    const Vec3 half(0.02 + 0.2 * u(random), 0.02 + 0.2 * u(random), 0.02 + 0.2 * u(random));
    const double height = 0.05 + 0.5 * u(random), radius = 0.01 + 0.1 * u(random);
    const bool box_first = i % 2 == 0;
    const Shape a = box_first ? box(-half, half) : cylinder(Vec3::Zero(), Vec3(0, 0, height), radius);
    const Shape b = i % 3 == 0   ? capsule(Vec3::Zero(), Vec3(0, 0, height), radius)
                    : i % 3 == 1 ? box(-half, half)
                                 : cylinder(Vec3::Zero(), Vec3(0, 0, height), radius);
    const Pose X = random_pose(random, 0.3), Y = random_pose(random, 0.3);
    double least = 10;
    for (int k = 0; k < 40; ++k) {
      const double angle = 6.3 * u(random), share = std::sqrt(u(random));
      Vec3 p(share * radius * std::cos(angle), share * radius * std::sin(angle), height * u(random));
      if (i % 3 == 1) p = half.cwiseProduct(Vec3(2 * u(random) - 1, 2 * u(random) - 1, 2 * u(random) - 1));
      const Vec3 in_a = X.inverse() * (Y * p);
      least = std::min(least, box_first ? to_box(in_a, -half, half) : to_cylinder(in_a, height, radius));
    }
    const Bracket d = distance(a, X, b, Y, u(random) < 0.5 ? 10 : 0.01);
    ASSERT_LE(d.low, least + 1e-12) << "case " << i;
    ASSERT_LE(d.low, d.high);
    if (least == 0) {
      ++shared;
      ASSERT_EQ(d.low, 0) << "case " << i;
    }
  }
  EXPECT_GT(shared, kCases / 20);
}

TEST(Distance, OfCapsules) {
  const Shape a = capsule({0, 0, 0}, {1, 0, 0}, 0.1), b = capsule({0.5, -1, 0.5}, {0.5, 1, 0.5}, 0.15);
  EXPECT_NEAR(distance(a, {}, b, {}, 10).low, 0.25, 1e-12);
  EXPECT_EQ(distance(a, {}, b, Pose{Mat3::Identity(), Vec3(0, 0, -0.3)}, 10).high, 0);
}

TEST(Distance, OfTwoMeshes) {
  Shape a, b;
  a.mesh = cube({0, 0, 0}, {1, 1, 1});
  b.mesh = cube({0, 0, 0}, {0.2, 0.2, 0.2});
  EXPECT_NEAR(distance(a, {}, b, Pose{Mat3::Identity(), Vec3(1.3, 0.4, 1.4)}, 10).low, 0.5, kClose);
  EXPECT_EQ(distance(a, {}, b, Pose{Mat3::Identity(), Vec3(0.9, 0.4, 0.4)}, 10).low, 0);
  EXPECT_TRUE(a.mesh->holds({0.5, 0.5, 0.5}));
}

TEST(Mesh, ThatIsNotClosedIsRefused) {
  const std::shared_ptr<const Mesh> whole = cube({0, 0, 0}, {1, 1, 1});
  auto triangles = whole->triangles;
  triangles.pop_back();
  const auto open = mesh_of(whole->points, triangles, "open");
  ASSERT_FALSE(open);
  EXPECT_EQ(open.error().id, "BO111");
  auto turned = whole->triangles;
  std::swap(turned[3][0], turned[3][1]);
  EXPECT_FALSE(mesh_of(whole->points, turned, "one triangle inside out"));
  EXPECT_EQ(mesh_of({}, {}, "none").error().id, "BO110");
}

TEST(Stl, OfBothKindsIsReadAndDamagedOnesAreNot) {
  const std::shared_ptr<const Mesh> whole = cube({0, 0, 0}, {1, 2, 3});
  std::string binary(84, '\0'), text = "solid cube\n";
  const std::uint32_t count = 12;
  std::memcpy(binary.data() + 80, &count, 4);
  for (const auto& t : whole->triangles) {
    binary.append(12, '\0');
    text += "facet normal 0 0 0\nouter loop\n";
    for (const int c : t) {
      const Vec3& p = whole->points[static_cast<std::size_t>(c)];
      for (int k = 0; k < 3; ++k) {
        const float f = static_cast<float>(p[k]);
        binary.append(reinterpret_cast<const char*>(&f), 4);
      }
      text += "vertex " + std::to_string(p.x()) + " " + std::to_string(p.y()) + " " + std::to_string(p.z()) + "\n";
    }
    binary.append(2, '\0');
    text += "endloop\nendfacet\n";
  }
  text += "endsolid cube\n";
  const std::string path = testing::TempDir() + "/bodies_cube.stl";
  const auto read = [&](const std::string& bytes) {
    std::ofstream(path, std::ios::binary) << bytes;
    return read_stl(path, 1e-3);
  };
  for (const std::string& bytes : {binary, text}) {
    const auto mesh = read(bytes);
    ASSERT_TRUE(mesh) << to_string(mesh.error());
    EXPECT_EQ((*mesh)->points.size(), 8U);
    EXPECT_TRUE((*mesh)->holds({0.0005, 0.001, 0.0029}));
    EXPECT_FALSE((*mesh)->holds({0.0005, 0.001, 0.0031}));
  }
  EXPECT_EQ(read(binary.substr(0, binary.size() - 1)).error().id, "BO112");
  EXPECT_EQ(read(text.substr(0, text.size() / 2)).error().id, "BO112");
  EXPECT_EQ(read("no mesh").error().id, "BO112");
  EXPECT_EQ(read("").error().id, "BO112");
}

TEST(Stl, OpenSurfacesAreReadWithWhatTheyLack) {
  const std::string vertex[3] = {"vertex 0 0 0\n", "vertex +1e0 0 -0\n", "vertex 0 1 0\n"};
  const std::string facet =
      "facet normal 0 0 1\nouter loop\n" + vertex[0] + vertex[1] + vertex[2] + "endloop\nendfacet\n";
  const std::string flat =
      "facet normal 0 0 1\nouter loop\n" + vertex[0] + vertex[1] + vertex[0] + "endloop\nendfacet\n";
  const auto one = triangles_of_stl("solid of the vertex\n" + facet + flat + "endsolid\n", "a.stl");
  ASSERT_TRUE(one) << to_string(one.error());
  EXPECT_EQ(one->points.size(), 3U);
  ASSERT_EQ(one->triangles.size(), 1U);
  EXPECT_EQ(one->degenerate, 1U);
  EXPECT_EQ(open_edges(one->triangles), 3U);
  EXPECT_EQ(open_edges({{0, 1, 2}, {0, 2, 1}}), 0U);
  EXPECT_EQ(open_edges({{0, 1, 2}, {0, 1, 2}}), 3U) << "twice in the same direction";
  EXPECT_EQ(triangles_of_stl("solid a\n" + facet.substr(0, 60) + "x y z\nendsolid\n", "a.stl").error().id, "BO112");
}

}  // namespace
}  // namespace polypod::bodies
