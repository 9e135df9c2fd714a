// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "machine_lines.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::pages {
namespace {

using machine::kLegs;
using report::Colour;
using report::Line3;
using report::Point3;

Point3 mm(const Vec3& p) {
  return {units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z())};
}

constexpr double kThick = 2.6, kThin = 1.5, kDot = 2.8;  // px

/// The six points in the order of their angle round their middle, closed.
Line3 ring(const machine::SixPoints& points, const char* name, Colour colour) {
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : points) middle += p / kLegs;
  std::array<std::size_t, kLegs> order{};
  std::iota(order.begin(), order.end(), 0U);
  const auto angle = [&](std::size_t i) { return std::atan2(points[i].y() - middle.y(), points[i].x() - middle.x()); };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return angle(a) < angle(b); });
  Line3 line{name, {}, colour, kThin, false};
  for (const std::size_t i : order) line.points.push_back(mm(points[i]));
  line.points.push_back(line.points.front());
  return line;
}

void add_legs(std::vector<Line3>& out, const machine::SixPoints& anchor, const machine::SixPoints& platform,
              const Pose& X_MT) {
  out.push_back(ring(platform, "platform at home", Colour::blue));
  out.back().stroke = kThick;
  Line3 joints{"", {}, Colour::ink, kDot, true};
  for (int i = 0; i < kLegs; ++i) {
    out.push_back({"legs at home", {mm(anchor[i]), mm(platform[i])}, Colour::ink, kThick, false});
    joints.points.push_back(mm(anchor[i]));
    joints.points.push_back(mm(platform[i]));
  }
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : platform) middle += p / kLegs;
  out.push_back({"tool", {mm(middle), mm(X_MT.p)}, Colour::vermillion, kThick, false});
  out.push_back(std::move(joints));
}

std::vector<Line3> lines_of(const machine::StrutHexapod& m, const Vec3&) {
  const Pose X = machine::home_pose(m);
  machine::SixPoints platform;
  for (int i = 0; i < kLegs; ++i) platform[i] = X * (m.platform_joint[i] - Vec3(0, 0, m.tool_length));
  std::vector<Line3> out{ring(m.base_joint, "base", Colour::muted)};
  add_legs(out, m.base_joint, platform, X);
  return out;
}

std::vector<Line3> lines_of(const machine::SliderHexapod& m, const Vec3&) {
  const Pose X = machine::home_pose(m);
  std::array<machine::SliderRoots, kLegs> roots;
  machine::slider_roots(m, X, roots.data());
  machine::SixPoints anchor, platform;
  std::vector<Line3> out;
  for (int i = 0; i < kLegs; ++i) {
    const bool outer_on = roots[i].outer >= 0 && roots[i].outer <= m.rail_length[i];
    anchor[i] = m.rail_outer[i] + (outer_on ? roots[i].outer : roots[i].inner) * m.rail_direction[i];
    platform[i] = X * (m.platform_joint[i] - Vec3(0, 0, m.tool_length));
    out.push_back({"rails", {mm(m.rail_outer[i]), mm(m.rail_inner[i])}, Colour::muted, kThick, false});
  }
  add_legs(out, anchor, platform, X);
  return out;
}

/// At home: base, arms or rails, the two rods of each parallelogram, platform and tool.
template <machine::DeltaFamily M>
std::vector<Line3> lines_of(const M& m, const Vec3&) {
  std::vector<Line3> out{{"base", {}, Colour::muted, kThin, false}};
  Line3 platform{"platform at home", {}, Colour::blue, kThick, false}, joints{"", {}, Colour::ink, kDot, true};
  for (int i = 0; i < m.arms; ++i) {
    const Vec3 elbow = driven_end(m, i, m.home_joint), end = m.home + m.platform_joint[i] - m.tool;
    Vec3 start = elbow, arm_end = elbow;
    if constexpr (std::is_same_v<M, machine::RotaryDelta>) {
      start = m.base_joint[i];
    } else {
      start = m.rail_start[i];
      arm_end = start + m.range.max * m.rail_direction[i];
    }
    out.front().points.push_back(mm(start));
    platform.points.push_back(mm(end));
    out.push_back({std::is_same_v<M, machine::RotaryDelta> ? "arms at home" : "rails",
                   {mm(start), mm(arm_end)},
                   Colour::ink,
                   kThick,
                   false});
    const int rods = machine::delta_detail::rods_of(m);
    for (int rod = 0; rod < rods; ++rod) {
      const double offset = rods < 2 ? 0.0 : machine::delta_detail::rod_offsets(m)[static_cast<std::size_t>(rod)];
      const Vec3 aside = offset * m.axis[i];
      out.push_back({"rods at home", {mm(elbow + aside), mm(end + aside)}, Colour::ink, kThin, false});
    }
    joints.points.push_back(mm(elbow));
    joints.points.push_back(mm(end));
  }
  out.front().points.push_back(out.front().points.front());
  platform.points.push_back(platform.points.front());
  out.push_back(std::move(platform));
  out.push_back({"tool", {mm(m.home - m.tool), mm(m.home)}, Colour::vermillion, kThick, false});
  out.push_back(std::move(joints));
  return out;
}

/// At home: what drives the legs, the legs, the platform joints to the tool tip.
std::vector<Line3> lines_of(const machine::Parallel& m, const Vec3&) {
  const Pose X = m.home;
  const auto q = joints_of(m, X);
  std::vector<Line3> out;
  Line3 joints{"", {}, Colour::ink, kDot, true}, platform{"platform at home", {}, Colour::blue, kThick, false};
  Vec3 middle = Vec3::Zero();
  Eigen::Index drive = 0;
  for (const machine::ParallelLeg& leg : m.legs) {
    const double reading = leg.driven() && q ? (*q)[drive++] : 0.0;
    const Vec3 anchor = leg_anchor(leg, reading), end = leg_end(m, leg, X);
    if (leg.drive == machine::LegDrive::rail) {
      out.push_back({"rails",
                     {mm(leg_anchor(leg, leg.range.min)), mm(leg_anchor(leg, leg.range.max))},
                     Colour::muted,
                     kThick,
                     false});
    }
    if (leg.drive == machine::LegDrive::crank) {
      out.push_back({"arms at home", {mm(leg.base), mm(anchor)}, Colour::ink, kThick, false});
    }
    out.push_back({"legs at home", {mm(anchor), mm(end)}, Colour::ink, leg.driven() ? kThick : kThin, false});
    joints.points.push_back(mm(anchor));
    joints.points.push_back(mm(end));
    platform.points.push_back(mm(end));
    middle += end / static_cast<double>(m.legs.size());
  }
  platform.points.push_back(platform.points.front());
  out.push_back(std::move(platform));
  out.push_back({"tool", {mm(middle), mm(X.p)}, Colour::vermillion, kThick, false});
  out.push_back(std::move(joints));
  return out;
}

/// The origins of the frames of the table, then the tool tip.
std::vector<Line3> links_of(const machine::SerialArm& arm, const machine::JointVector& q, const char* name) {
  std::vector<Line3> out;
  Line3 links{name, {mm(arm.X_MB.p)}, Colour::ink, kThick, false};
  Line3 joints{"", {mm(arm.X_MB.p)}, Colour::ink, kDot, true};
  machine::SerialArm partial = arm;
  partial.X_FT = Pose{};
  for (std::size_t rows = 1; rows <= arm.dh.size(); ++rows) {
    partial.dh.assign(arm.dh.begin(), arm.dh.begin() + static_cast<std::ptrdiff_t>(rows));
    const Vec3 p = machine::forward(partial, machine::JointVector(q.head(partial.free_joints()))).p;
    links.points.push_back(mm(p));
    joints.points.push_back(mm(p));
  }
  const Point3 last = links.points.back();
  const Vec3 end = machine::forward(arm, q).p;
  out.push_back(std::move(links));
  out.push_back({"tool", {last, mm(end)}, Colour::vermillion, kThick, false});
  out.push_back(std::move(joints));
  return out;
}

std::vector<Line3> lines_of(const machine::SerialArm& arm, const Vec3& tip) {
  const auto solved = machine::inverse(arm, Pose{Mat3::Identity(), tip});
  const kinematics::Solution* solution = solved.reachable();
  std::vector<Line3> out;
  const double size = 0.15;  // m, the cross of the base
  for (int axis = 0; axis < 2; ++axis) {
    const Vec3 e = size * arm.X_MB.R.col(axis);
    out.push_back({"base", {mm(arm.X_MB.p - e), mm(arm.X_MB.p + e)}, Colour::muted, kThick, false});
  }
  if (solution == nullptr) return out;
  for (Line3& line : links_of(arm, solution->joints, "links, tool upright in the middle"))
    out.push_back(std::move(line));
  return out;
}

/// Every stage at home, where the stages before it put it.
std::vector<Line3> lines_of(const machine::Stages& m, const Vec3&) {
  std::vector<Line3> out;
  Pose X;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    X = X * m.data[k].mount;
    const Pose home = kinematics::home_pose(m.machines[k]).value_or(Pose{});
    const auto* chain = std::get_if<machine::SerialArm>(&m.machines[k]);
    for (Line3& line :
         chain != nullptr ? links_of(*chain, m.data[k].home, "links at home") : machine_lines(m.machines[k], home.p)) {
      for (Point3& p : line.points) p = mm(X * Vec3(units::from_mm(p.x), units::from_mm(p.y), units::from_mm(p.z)));
      out.push_back(std::move(line));
    }
    X = X * (chain != nullptr ? machine::forward(*chain, m.data[k].home) : home);
  }
  return out;
}

}  // namespace

std::vector<Line3> machine_lines(const machine::AnyMachine& machine, const Vec3& tip) {
  return std::visit([&](const auto& m) { return lines_of(m, tip); }, machine);
}

void hang(report::Scene& scene) {
  const auto turn = [](Point3& p) { p = {p.x, -p.y, -p.z}; };
  for (Line3& line : scene.lines)
    for (Point3& p : line.points) turn(p);
  for (report::Mesh& mesh : scene.meshes)
    for (Point3& p : mesh.points) turn(p);
  scene.axes = {"x", "−y", "−z"};
}

}  // namespace polypod::pages
