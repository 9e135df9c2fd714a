// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Ways of arms and tools: "free" against a dense sampling of the same way.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <random>

#include "meshes.hpp"
#include "polypod/bodies/bodies.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::bodies {
namespace {

machine::AnyMachine arm(const std::string& name) {
  return *machine::load(name);
}

Body on(Body::Frame frame, int link, Shape shape, std::string name) {
  Body b;
  b.frame = frame;
  b.link = link;
  b.shape = std::move(shape);
  b.name = std::move(name);
  return b;
}

/// Whether two bodies of an arm touch at joints q, by the forward kinematics of the part of the arm that carries each.
Pose link_pose(const machine::SerialArm& whole, int rows, const machine::JointVector& q) {
  machine::SerialArm part = whole;
  part.dh.resize(static_cast<std::size_t>(rows));
  part.X_FT = Pose{};
  machine::JointVector head = q.head(rows);
  return kinematics::forward(machine::AnyMachine(part), head).poses.front();
}

TEST(Watch, NeverSaysFreeWhereADenseSamplingTouches) {
  const machine::AnyMachine kuka = arm("kuka-kr210");
  const auto& whole = std::get<machine::SerialArm>(kuka);
  const Shape forearm = capsule({0, 0, 0}, {0, 0, -1.0}, 0.15);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(-1, 1);
  int touched = 0, free_ways = 0;
  double shortest_free = 1;
  for (int i = 0; i < 1500; ++i) {
    const double r = 0.02 + 0.1 * std::abs(u(random));
    const Vec3 post_in_forearm(0.5 * u(random), 0.5 * u(random), -0.5 + 0.7 * u(random));
    machine::JointVector from(6), to(6);
    for (int k = 0; k < 6; ++k) {
      const machine::JointRange range = kinematics::joint_range(kuka, k);
      from[k] = 0.5 * (range.min + range.max) + 0.3 * u(random);
      to[k] = from[k] + 0.4 * u(random);
    }
    const Vec3 post = link_pose(whole, 4, 0.5 * (from + to)) * post_in_forearm;  // where the way passes by
    Bodies bodies;
    bodies.all = {on(Body::Frame::link, 4, forearm, "forearm"),
                  on(Body::Frame::machine, 0, Shape{{post}, r, 0, nullptr}, "ball")};
    Watch watch(kuka, Pose{}, bodies);
    const bool at_start = watch.to({}, from, false, 0).has_value();
    const bool on_way = watch.to({}, to, true, 0).has_value();
    double least = 10;
    for (int k = 0; k <= 200; ++k) {
      const machine::JointVector q = from + double(k) / 200 * (to - from);
      const Pose X = link_pose(whole, 4, q);
      const Vec3 p = X.inverse() * post;
      const double along = std::clamp(p.z(), -1.0, 0.0);
      least = std::min(least, (p - Vec3(0, 0, along)).norm() - 0.15 - r);
      if (k == 0) {
        EXPECT_EQ(at_start, least <= 0);
      }
    }
    if (least <= 0) {
      ++touched;
      EXPECT_TRUE(on_way || at_start) << "case " << i;
    } else if (!at_start && !on_way) {
      ++free_ways;
      shortest_free = std::min(shortest_free, least);
    } else {
      // The sampling misses less than the way between two of its points: 0.4 rad / 200 at 3 m, six joints.
      EXPECT_LT(least, 0.4 / 200 * 3 * 6 / 2) << "case " << i;
    }
  }
  EXPECT_GT(touched, 100);
  EXPECT_GT(free_ways, 500);
  EXPECT_LT(shortest_free, 0.02);  // near misses are free as well
}

TEST(Watch, SeesAThinWallThatBothEndsOfTheWayAreClearOf) {
  // A tool that moves by 100 mm in one step through a wall of 0.1 mm.
  const machine::AnyMachine delta = arm("delta-picker");
  for (const double to : {0.049, 0.051}) {
    Bodies bodies;
    bodies.all = {on(Body::Frame::tool, 0, cylinder({0, 0, 0}, {0, 0, 0.05}, 0.01), "holder"),
                  on(Body::Frame::machine, 0, box({0.06, -0.5, -1}, {0.0601, 0.5, 0}), "wall")};
    Watch watch(delta, Pose{}, bodies);
    EXPECT_EQ(watch.pairs(), 1U);
    const auto at = [](double x) { return Pose{Mat3::Identity(), Vec3(x, 0, -0.3)}; };
    EXPECT_FALSE(watch.to(at(0), {}, false, 0));
    EXPECT_EQ(watch.to(at(to), {}, true, 0).has_value(), to > 0.05);
    EXPECT_FALSE(watch.to(at(0), {}, false, 0));
    EXPECT_TRUE(watch.to(at(0.1), {}, true, 0));
    EXPECT_FALSE(watch.to(at(0.1), {}, false, 0));
  }
}

TEST(Watch, SeesAPartOfAMeshThatBeginsInsideAnother) {
  const machine::AnyMachine delta = arm("delta-picker");
  // Two cubes that are one mesh: the first far away, the second inside of the other body.
  std::vector<Vec3> points = cube({-0.01, -0.01, 0.5}, {0.01, 0.01, 0.52})->points;
  std::vector<std::array<int, 3>> triangles = cube({0, 0, 0}, {1, 1, 1})->triangles;
  const std::vector<Vec3> second = cube({-0.01, -0.01, -0.01}, {0.01, 0.01, 0.01})->points;
  points.insert(points.end(), second.begin(), second.end());
  for (std::size_t k = 0; k < 12; ++k) {
    triangles.push_back({triangles[k][0] + 8, triangles[k][1] + 8, triangles[k][2] + 8});
  }
  Shape two, around;
  two.mesh = *mesh_of(points, triangles, "two");
  EXPECT_EQ(two.mesh->parts.size(), 2U);
  around.mesh = cube({-0.2, -0.2, -0.6}, {0.2, 0.2, -0.1});
  Bodies bodies;
  bodies.all = {on(Body::Frame::tool, 0, two, "two"), on(Body::Frame::machine, 0, around, "cube")};
  Watch watch(delta, Pose{}, bodies);
  EXPECT_TRUE(watch.to(Pose{Mat3::Identity(), Vec3(0, 0, -0.3)}, {}, false, 0));
  EXPECT_FALSE(watch.to(Pose{Mat3::Identity(), Vec3(0, 0, 0.3)}, {}, false, 0));
}

TEST(Watch, SeesABodyThatBeginsInsideAMesh) {
  const machine::AnyMachine delta = arm("delta-picker");
  Shape inside;
  inside.mesh = cube({-0.2, -0.2, -0.6}, {0.2, 0.2, -0.1});
  Bodies bodies;
  bodies.all = {on(Body::Frame::tool, 0, Shape{{Vec3::Zero()}, 0.01, 0, nullptr}, "tip"),
                on(Body::Frame::machine, 0, inside, "cube")};
  Watch watch(delta, Pose{}, bodies);
  EXPECT_TRUE(watch.to(Pose{Mat3::Identity(), Vec3(0, 0, -0.3)}, {}, false, 0));
  EXPECT_TRUE(watch.to(Pose{Mat3::Identity(), Vec3(0.01, 0, -0.3)}, {}, true, 0));
}

TEST(Watch, LeavesOutNeighboursAndWhatTheFileSays) {
  const machine::AnyMachine kuka = arm("kuka-kr210");
  Bodies bodies;
  const Shape ball{{Vec3::Zero()}, 0.1, 0, nullptr};
  for (int link = 0; link <= 3; ++link) bodies.all.push_back(on(Body::Frame::link, link, ball, std::to_string(link)));
  EXPECT_EQ(Watch(kuka, Pose{}, bodies).pairs(), 3U);  // 0-2, 0-3, 1-3
  bodies.ignored = {{"3", "1"}};
  const Watch watch(kuka, Pose{}, bodies);
  EXPECT_EQ(watch.pairs(), 2U);
  EXPECT_NE(watch.notes().back().find("1 and 3"), std::string::npos);
}

TEST(BodiesFile, OfAParallelMachineSaysWhereTheSpindleIs) {
  // z of the tool of a delta points away from its platform: the holder of one that hangs is at -z.
  const machine::AnyMachine delta = arm("delta-picker");
  const std::string path = testing::TempDir() + "/bodies_of_delta.toml";
  const std::string rest =
      "[[holder]]\ndiameter_mm = 60\nfrom_mm = 30\nto_mm = 90\n"
      "[[body]]\nname = \"shelf\"\nframe = \"machine\"\nshape = \"sphere\"\ncenter_mm = [60, 0, 600]\ndiameter_mm = "
      "20\n";
  const auto read_with = [&](const std::string& head) {
    std::ofstream(path) << head << rest;
    return bodies::read(path, delta);
  };
  ASSERT_FALSE(read_with(""));
  EXPECT_EQ(read_with("").error().id, "BO108");
  EXPECT_EQ(read_with("spindle = \"up\"\n").error().id, "BO108");
  for (const bool hits : {true, false}) {
    const auto file = read_with(hits ? "spindle = \"-z\"\n" : "spindle = \"+z\"\n");
    ASSERT_TRUE(file) << to_string(file.error());
    Watch watch(delta, Pose{}, *file);
    EXPECT_FALSE(watch.to(Pose{Mat3::Identity(), Vec3(0, 0, 0.66)}, {}, false, 0));
    EXPECT_EQ(watch.to(Pose{Mat3::Identity(), Vec3(0.06, 0, 0.66)}, {}, true, 0).has_value(), hits);
  }
}

TEST(BodiesFile, IsRefusedWithItsPlace) {
  const machine::AnyMachine kuka = arm("kuka-kr210");
  const std::string path = testing::TempDir() + "/bodies.toml";
  const auto id = [&](const std::string& text) {
    std::ofstream(path) << text;
    const auto read = bodies::read(path, kuka);
    return read ? std::string("read") : read.error().id;
  };
  const std::string holder = "[[holder]]\ndiameter_mm = 40\nfrom_mm = 20\nto_mm = 80\n";
  EXPECT_EQ(id(holder), "read");
  EXPECT_EQ(id(""), "BO100");
  EXPECT_EQ(id("[[holder]]\ndiameter_mm = 40\nfrom_mm = 20\nto_mm = 90000\n"), "BO106");
  EXPECT_EQ(id("[[holder]]\ndiameter_mm = 40\nfrom_mm = 20\nto_mm = 20\n"), "BO102");
  EXPECT_EQ(id("ignore = [\"holder + desk\"]\n" + holder), "BO107");
  const std::string body = "[[body]]\nname = \"a\"\nframe = \"machine\"\n";
  EXPECT_EQ(id(body + "shape = \"sphere\"\ncenter_mm = [0, 0, 0]\ndiameter_mm = 900000\n"), "BO105");
  EXPECT_EQ(id(body + "shape = \"sphere\"\ncenter_mm = [100000, 270, 0]\ndiameter_mm = 400\n"), "BO105");
  EXPECT_EQ(id(body + "shape = \"sphere\"\ncenter_mm = [0, 0, 0]\ndiameter_mm = 0.04\n"), "BO105");
  EXPECT_EQ(id(body + "shape = \"cone\"\n"), "BO103");
  EXPECT_EQ(id(body + "shape = \"box\"\nmin_mm = [0, 0, 0]\nmax_mm = [1, 1, 0]\n"), "BO102");
  EXPECT_EQ(id(body + "shape = \"mesh\"\nfile = \"none.stl\"\nunit = \"mm\"\n"), "FI100");
  EXPECT_EQ(id(body + "shape = \"mesh\"\nfile = \"none.stl\"\nunit = \"um\"\n"), "BO101");
  EXPECT_EQ(id(body + "shape = \"sphere\"\ncenter_mm = [0, 0, 0]\ndiameter_mm = 90\ncolor = 1\n"), "CF103");
}

}  // namespace
}  // namespace polypod::bodies
