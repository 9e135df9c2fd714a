// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Bodies of a URDF file: each stands where a product of the transforms of the file has it, at any joints.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <fstream>
#include <random>

#include "machines.hpp"
#include "polypod/bodies/bodies.hpp"
#include "polypod/bodies/from_urdf.hpp"
#include "polypod/families/serial/frames.hpp"
#include "polypod/machine/urdf.hpp"

namespace polypod {
namespace {

namespace fs = std::filesystem;
using machine::JointVector;

// Two turns and a slide; the flange hangs at the last by a fixed joint, a gripper beside the chain moves.
constexpr const char* kArm = R"(<robot name="made">
  <link name="base"><collision><origin xyz="0.1 0 0.05" rpy="0 0 0.3"/><geometry><box size="0.4 0.3 0.1"/></geometry></collision></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0.1 0.4" rpy="0.2 -0.4 0.7"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <link name="one"><visual><geometry><sphere radius="0.07"/></geometry></visual>
    <collision><origin xyz="0 0 0.2" rpy="0.1 0.2 0"/><geometry><cylinder radius="0.05" length="0.5"/></geometry></collision>
    <collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.06"/></geometry></collision></link>
  <joint name="j2" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.3 0 0.5" rpy="0 0.5 0"/>
    <axis xyz="1 0 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <link name="two"><collision><origin xyz="0 0.1 0" rpy="0 0 1"/><geometry><mesh filename="package://made/meshes/block.stl" scale="0.001 0.001 0.001"/></geometry></collision></link>
  <joint name="j3" type="prismatic"><parent link="two"/><child link="three"/><origin xyz="0 0 0.3" rpy="0.3 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-0.2" upper="0.4" effort="1" velocity="1"/></joint>
  <link name="three"/>
  <joint name="f" type="fixed"><parent link="three"/><child link="flange"/><origin xyz="0 0 0.1" rpy="0 0 0"/></joint>
  <link name="flange"><visual><geometry><box size="0.1 0.1 0.02"/></geometry></visual></link>
  <joint name="g" type="revolute"><parent link="two"/><child link="finger"/><origin xyz="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="finger"><collision><geometry><sphere radius="1"/></geometry></collision></link>
</robot>)";

/// A block of 200 x 100 x 60 mm from the origin, in mm; without its last triangle where it is open.
std::string block(bool open) {
  const auto cube = bodies::box({0, 0, 0}, {200, 100, 60}).points;
  const int triangles[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                                {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  std::string out = "solid block\n";
  for (int t = 0; t < (open ? 11 : 12); ++t) {
    out += "facet normal 0 0 0\nouter loop\n";
    for (const int corner : triangles[t]) {
      const Vec3& p = cube[static_cast<std::size_t>(corner)];
      out += fmt::format("vertex {} {} {}\n", p.x(), p.y(), p.z());
    }
    out += "endloop\nendfacet\n";
  }
  return out + "endsolid block\n";
}

/// The file in a folder `made` with its meshes, as a package is laid out.
class Package {
 public:
  explicit Package(bool open = false)
      : folder_(fs::path(testing::TempDir()) / ("urdf_bodies_" + std::to_string(::getpid())) / "made") {
    fs::create_directories(folder_ / "meshes");
    fs::create_directories(folder_ / "urdf");
    std::ofstream(folder_ / "meshes" / "block.stl") << block(open);
  }
  ~Package() { fs::remove_all(folder_.parent_path()); }
  Package(const Package&) = delete;
  Package& operator=(const Package&) = delete;
  [[nodiscard]] std::string urdf() const { return (folder_ / "urdf" / "arm.urdf").string(); }
  [[nodiscard]] std::string output() const { return (folder_ / "bodies.toml").string(); }

 private:
  fs::path folder_;
};

Eigen::Isometry3d at(const Vec3& xyz, const Vec3& rpy) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.translate(xyz);
  X.rotate(Eigen::AngleAxisd(rpy.z(), Vec3::UnitZ()) * Eigen::AngleAxisd(rpy.y(), Vec3::UnitY()) *
           Eigen::AngleAxisd(rpy.x(), Vec3::UnitX()));
  return X;
}
Eigen::Isometry3d turned(const Vec3& axis, double q) {
  return Eigen::Isometry3d(Eigen::AngleAxisd(q, axis));
}

struct Expected {
  const char* name;
  int link;  // row
  Eigen::Isometry3d X;
  std::vector<Vec3> points;
};

/// By the definitions of the format, at joints q.
std::vector<Expected> expected(const JointVector& q) {
  const Eigen::Isometry3d one = at({0, 0.1, 0.4}, {0.2, -0.4, 0.7}) * turned({0, 0.6, 0.8}, q[0]);
  const Eigen::Isometry3d two = one * at({0.3, 0, 0.5}, {0, 0.5, 0}) * turned(Vec3::UnitX(), q[1]);
  const Eigen::Isometry3d three =
      two * at({0, 0, 0.3}, {0.3, 0, 0}) * Eigen::Translation3d(0, 0, q[2]) * at({0, 0, 0.1}, {0, 0, 0});
  return {{"base", 0, at({0.1, 0, 0.05}, {0, 0, 0.3}), bodies::box({-0.2, -0.15, -0.05}, {0.2, 0.15, 0.05}).points},
          {"one", 1, one * at({0, 0, 0.2}, {0.1, 0.2, 0}), {{0, 0, -0.25}, {0, 0, 0.25}}},
          {"one 2", 1, one * at({0.2, 0, 0}, {0, 0, 0}), {{0, 0, 0}}},
          {"two", 2, two * at({0, 0.1, 0}, {0, 0, 1}), bodies::box({0, 0, 0}, {0.2, 0.1, 0.06}).points},
          {"flange", 3, three, bodies::box({-0.05, -0.05, -0.01}, {0.05, 0.05, 0.01}).points}};
}

TEST(UrdfBodies, StandWhereTheFileHasThem) {
  const Package package;
  const auto file = bodies::file_from_urdf(kArm, package.urdf() + "#flange", package.output());
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->count, 5);
  EXPECT_THAT(file->notes, testing::ElementsAre(testing::HasSubstr("link flange: its visual body")));
  std::ofstream(package.output()) << file->text;
  const machine::SerialArm arm = test::arm_of(kArm, package.urdf() + "#flange");
  const auto read = bodies::read(package.output(), machine::AnyMachine(arm));
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->all.size(), 5u);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  for (int trial = 0; trial < 20; ++trial) {
    JointVector q(3);
    q << 3 * any(random), 3 * any(random), 0.1 + 0.3 * any(random);
    const std::vector<Pose> frames = machine::frames_of_table(arm, q);
    const std::vector<Expected> all = expected(q);
    for (std::size_t i = 0; i < all.size(); ++i) {
      const bodies::Body& body = read->all[i];
      SCOPED_TRACE(all[i].name);
      EXPECT_EQ(body.name, all[i].name);
      EXPECT_EQ(body.frame, bodies::Body::Frame::link);
      const std::vector<Vec3>& points = body.shape.mesh ? body.shape.mesh->points : body.shape.points;
      ASSERT_EQ(points.size(), all[i].points.size());
      for (const Vec3& p : all[i].points) {
        double nearest = 1;
        for (const Vec3& o : points)
          nearest = std::min(nearest, (frames[static_cast<std::size_t>(body.link)] * o - all[i].X * p).norm());
        EXPECT_LT(nearest, 1e-9);
      }
    }
  }
  EXPECT_DOUBLE_EQ(read->all[1].shape.across, 0.05);
  EXPECT_DOUBLE_EQ(read->all[2].shape.radius, 0.06);
  EXPECT_TRUE(read->all[3].shape.mesh);
}

TEST(UrdfBodies, WhatCannotBeWrittenIsNamed) {
  const auto notes_of = [](const std::string& text, bool open = false) {
    const Package package(open);
    const auto file = bodies::file_from_urdf(text, package.urdf() + "#flange", package.output());
    return file ? file->notes : std::vector<std::string>{file.error().id + " " + file.error().message};
  };
  const auto with = [](const std::string& from, const std::string& to) {
    std::string text = kArm;
    const std::size_t i = text.find(from);
    EXPECT_NE(i, std::string::npos);
    return text.replace(i, from.size(), to);
  };
  using testing::Contains;
  using testing::HasSubstr;
  EXPECT_THAT(notes_of(kArm, true), Contains(HasSubstr("link two: a body is left out")));
  EXPECT_THAT(notes_of(with("block.stl", "other.stl")), Contains(HasSubstr("other.stl is not there")));
  EXPECT_THAT(notes_of(with("scale=\"0.001 0.001 0.001\"", "scale=\"0.01 0.01 0.01\"")),
              Contains(HasSubstr("none of m, mm and inch")));
  EXPECT_THAT(notes_of(with("radius=\"0.05\"", "radius=\"-1\"")), Contains(HasSubstr("MA192")));
  EXPECT_THAT(notes_of(with("size=\"0.4 0.3 0.1\"", "size=\"0.4 0.3\"")), Contains(HasSubstr("MA192")));
  EXPECT_THAT(notes_of(with("<box size=\"0.4 0.3 0.1\"/>", "<cone/>")), Contains(HasSubstr("<cone> is no shape")));
}

}  // namespace
}  // namespace polypod
