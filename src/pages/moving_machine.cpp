// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "moving_machine.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "machine_lines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::pages {

using machine::AnyMachine;
using machine::JointVector;
using report::Frames;
using report::Point3;

MovingMachine::MovingMachine(const AnyMachine& machine, const Pose& X, const JointVector& q)
    : machine_(machine), X_(X), q_(q) {
  const machine::Outline outline = kinematics::outline_at(machine, X, q);
  lines_ = lines_of(outline);
  for (std::size_t k = 0; k < outline.size(); ++k)
    lines_[k].moves = outline[k].role != machine::OutlinePart::Role::fixed;
}

bool MovingMachine::add(Frames& frames, double at, const Pose& X, const JointVector& q, const std::string& note) const {
  const std::vector<report::Line3> now = lines_of(kinematics::outline_at(machine_, X, q));
  if (now.size() != lines_.size()) return false;
  std::vector<Point3> points;
  for (std::size_t k = 0; k < now.size(); ++k) {
    if (now[k].points.size() != lines_[k].points.size()) return false;
    if (lines_[k].moves) points.insert(points.end(), now[k].points.begin(), now[k].points.end());
  }
  const machine::Task task = kinematics::task(machine_);
  const std::vector<double> pose = kinematics::coordinates_of(task, X);
  if (frames.columns.empty()) {
    for (int i = 0; i < task.size(); ++i)
      frames.columns.push_back({std::string(machine::name_of(task[i])), task.is_angle(i) ? "deg" : "mm", {}});
    for (int i = 0; i < q.size(); ++i) {
      const bool turns = kinematics::joint_kind(machine_, i) == machine::JointKind::revolute;
      frames.columns.push_back({fmt::format("q{}", i + 1), turns ? "deg" : "mm", {}});
    }
  }
  std::size_t column = 0;
  for (std::size_t i = 0; i < pose.size(); ++i)
    frames.columns[column++].values.push_back(task.is_angle(static_cast<int>(i)) ? units::to_deg(pose[i])
                                                                                 : units::to_mm(pose[i]));
  for (int i = 0; i < q.size(); ++i)
    frames.columns[column++].values.push_back(
        kinematics::joint_kind(machine_, i) == machine::JointKind::revolute ? units::to_deg(q[i]) : units::to_mm(q[i]));
  frames.at.push_back(at);
  frames.points.push_back(std::move(points));
  std::vector<std::string> broken = kinematics::limit_names(machine_, kinematics::violations(machine_, X, q));
  if (!note.empty()) broken.insert(broken.begin(), note);
  frames.notes.push_back(fmt::format("{}", fmt::join(broken, ", ")));
  return true;
}

std::vector<Frames> MovingMachine::sweeps(const Point3& low, const Point3& high, double tilt, int count) const {
  std::vector<Frames> out;
  const auto keep = [&](Frames& frames, double start) {
    if (frames.at.size() < 3) return;
    const auto nearest = std::min_element(frames.at.begin(), frames.at.end(), [&](double a, double b) {
      return std::abs(a - start) < std::abs(b - start);
    });
    frames.start = static_cast<int>(nearest - frames.at.begin());
    out.push_back(std::move(frames));
  };
  // From the first pose outwards to both sides, so that each solution is the one next to the last; `start` itself is
  // one of the values.
  const auto values = [&](double from, double start, double to) {
    std::vector<double> at{start};
    for (int k = 0; k < count; ++k) at.push_back(from + (to - from) * k / (count - 1));
    std::sort(at.begin(), at.end());
    at.erase(std::unique(at.begin(), at.end(), [](double a, double b) { return std::abs(a - b) < 1e-9; }), at.end());
    return at;
  };
  const machine::Task task = kinematics::task(machine_);
  const std::vector<double> home = kinematics::coordinates_of(task, X_);
  const auto walk = [&](const std::vector<double>& at, double start, const auto& place) {
    // place(value, last joints) gives pose and joints, or nothing.
    struct Found {
      double at = 0;
      Pose X;
      JointVector q;
    };
    std::vector<Found> found;
    for (const bool upwards : {false, true}) {
      JointVector last = q_;
      std::vector<Found> side;
      for (std::size_t i = 0; i < at.size(); ++i) {
        const double v = at[upwards ? i : at.size() - 1 - i];
        if (upwards ? v < start : v >= start) continue;
        Found f{v, {}, last};
        if (!place(v, f.X, f.q)) break;
        last = f.q;
        side.push_back(std::move(f));
      }
      if (!upwards) std::reverse(side.begin(), side.end());
      found.insert(found.end(), side.begin(), side.end());
    }
    return found;
  };
  for (int i = 0; i < task.size(); ++i) {
    const bool angle = task.is_angle(i);
    const std::string name(machine::name_of(task[i]));
    const auto user = [&](double v) { return angle ? units::to_deg(v) : units::to_mm(v); };
    const double start = user(home[static_cast<std::size_t>(i)]);
    double from = start - units::to_deg(tilt), to = start + units::to_deg(tilt);
    if (!angle) {
      from = std::min(start, name == "x" ? low.x : name == "y" ? low.y : low.z);
      to = std::max(start, name == "x" ? high.x : name == "y" ? high.y : high.z);
    }
    if (!(to > from)) continue;
    Frames frames{name, angle ? "deg" : "mm", false, {}, {}, {}, {}, 0};
    const auto place = [&](double v, Pose& X, JointVector& q) {
      std::vector<double> c = home;
      c[static_cast<std::size_t>(i)] = angle ? units::from_deg(v) : units::from_mm(v);
      const auto result = kinematics::inverse_near(machine_, kinematics::pose_of(task, c), q);
      if (result.solutions.empty()) return false;
      // Nearest first; a limit is broken only where every solution breaks one.
      const kinematics::Solution* within = result.reachable();
      q = within != nullptr ? within->joints : result.solutions.front().joints;
      X = kinematics::settled(machine_, kinematics::pose_of(task, c), q);
      return true;
    };
    for (const auto& f : walk(values(from, start, to), start, place)) add(frames, f.at, f.X, f.q);
    keep(frames, start);
  }
  for (int i = 0; i < q_.size(); ++i) {
    const machine::JointRange range = kinematics::joint_range(machine_, i);
    const bool turns = kinematics::joint_kind(machine_, i) == machine::JointKind::revolute;
    const auto user = [&](double v) { return turns ? units::to_deg(v) : units::to_mm(v); };
    const double start = user(q_[i]);
    if (!std::isfinite(range.min) || !std::isfinite(range.max) || !(range.max > range.min)) continue;
    Frames frames{fmt::format("q{}", i + 1), turns ? "deg" : "mm", false, {}, {}, {}, {}, 0};
    const auto place = [&](double v, Pose& X, JointVector& q) {
      q = q_;
      q[i] = turns ? units::from_deg(v) : units::from_mm(v);
      const auto result = kinematics::forward(machine_, q);
      if (result.poses.empty()) return false;
      X = result.poses.front();
      return true;
    };
    const double from = std::min(start, user(range.min)), to = std::max(start, user(range.max));
    for (const auto& f : walk(values(from, start, to), start, place)) add(frames, f.at, f.X, f.q);
    keep(frames, start);
  }
  return out;
}

void add_poses(report::Scene& scene, std::size_t lines, const AnyMachine& machine, const MachineAt& start,
               double tilt) {
  if (start.lines.empty()) return;
  const MovingMachine moving(machine, start.X, start.q);
  report::Scene meshes;
  meshes.meshes = scene.meshes;
  const report::Box3 box = report::box_of(meshes, false);
  constexpr int kPictures = 41;
  scene.frames = moving.sweeps(box.low, box.high, tilt, kPictures);
  scene.lines.erase(scene.lines.begin(), scene.lines.begin() + static_cast<std::ptrdiff_t>(lines));
  scene.lines.insert(scene.lines.begin(), moving.lines().begin(), moving.lines().end());
}

}  // namespace polypod::pages
