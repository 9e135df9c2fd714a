// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/path_choice.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "polypod/core/units.hpp"

namespace polypod::motion {
namespace {

PosePath path_of_one(const Stretch& s) {
  PosePath out;
  out.stretches = {s};
  out.length = s.length;
  out.size = s.size;
  return out;
}

PosePath spun(PosePath path, const std::vector<double>& angles) {
  for (std::size_t k = 0; k < path.stretches.size(); ++k) {
    path.stretches[k].spin_from = angles[k];
    path.stretches[k].spin_to = angles[k + 1];
  }
  return path;
}

}  // namespace

RotationChoice choose_rotation(const AnyMachine& machine, const PosePath& path, const MoveOptions& options) {
  constexpr double kStep = units::from_deg(5), kCoarse = units::from_deg(15);
  constexpr int kMostSteps = 4;  // of the coarse ones a stretch: 60 deg
  constexpr std::size_t kMostStretches = 60;
  const std::size_t n = path.stretches.size();
  RotationChoice out;
  out.path = path;
  out.angles.assign(n + 1, 0);
  double best = kNoLimit, farthest = -1;
  const int turns = static_cast<int>(std::lround(2 * std::numbers::pi / kStep));
  for (int k = 0; k < turns; ++k) {
    // 0, 5, -5, 10, ...: of equally good ones the smallest.
    const double angle = kStep * (k % 2 == 0 ? -k / 2 : (k + 1) / 2);
    const PosePath tried = spun(path, std::vector<double>(n + 1, angle));
    const PathVerdict v = follow(machine, tried, options);
    ++out.tried;
    constexpr double kBetter = 1 - 1e-9;
    const bool better = v.passes ? !out.passes || v.condition < best * kBetter : !out.passes && v.reaches > farthest;
    if (!better) continue;
    out.passes = out.passes || v.passes;
    out.path = tried;
    out.angles.assign(n + 1, angle);
    out.condition = v.condition;
    if (v.passes) best = v.condition;
    farthest = v.reaches;
  }
  if (out.passes || n > kMostStretches) return out;
  // Least largest condition number up to each angle at each point.
  const int count = static_cast<int>(std::lround(2 * std::numbers::pi / kCoarse));
  const auto angle_of = [&](int k) { return kCoarse * (k - count / 2); };
  std::vector<std::vector<double>> worst(n + 1, std::vector<double>(static_cast<std::size_t>(count), kNoLimit));
  std::vector<std::vector<int>> from(n + 1, std::vector<int>(static_cast<std::size_t>(count), -1));
  std::fill(worst[0].begin(), worst[0].end(), 0.0);
  for (std::size_t s = 0; s < n; ++s) {
    if (options.progress && !options.progress(0.1 * static_cast<double>(s) / static_cast<double>(n))) return out;
    for (int a = 0; a < count; ++a) {
      const double so_far = worst[s][static_cast<std::size_t>(a)];
      if (!std::isfinite(so_far)) continue;
      for (int b = std::max(0, a - kMostSteps); b <= std::min(count - 1, a + kMostSteps); ++b) {
        const auto to = static_cast<std::size_t>(b);
        if (so_far >= worst[s + 1][to]) continue;
        Stretch tried = path.stretches[s];
        tried.spin_from = angle_of(a);
        tried.spin_to = angle_of(b);
        ++out.tried;
        const PathVerdict v = follow(machine, path_of_one(tried), options);
        if (!v.passes) continue;
        const double value = std::max(so_far, v.condition);
        if (value >= worst[s + 1][to]) continue;
        worst[s + 1][to] = value;
        from[s + 1][to] = a;
      }
    }
  }
  const auto end = std::min_element(worst[n].begin(), worst[n].end());
  if (!std::isfinite(*end)) return out;
  std::vector<double> angles(n + 1);
  int at = static_cast<int>(end - worst[n].begin());
  for (std::size_t s = n + 1; s-- > 0;) {
    angles[s] = angle_of(at);
    at = from[s][static_cast<std::size_t>(at)];
  }
  // The stretches were looked at one by one: now with one branch.
  const PosePath chosen = spun(path, angles);
  const PathVerdict v = follow(machine, chosen, options);
  if (!v.passes) return out;
  out.path = chosen;
  out.passes = true;
  out.constant = false;
  out.angles = angles;
  out.condition = v.condition;
  return out;
}

Insertion insert_points(const AnyMachine& machine, const PosePath& path, const MoveOptions& options) {
  Insertion out;
  const auto home = kinematics::home_pose(machine);
  const Vec3 at_home = home ? angles_abc(home->R) : Vec3::Zero();
  std::vector<Stretch> stretches;
  for (std::size_t k = 0; k < path.stretches.size(); ++k) {
    const Stretch& s = path.stretches[k];
    const bool can_turn = s.length > 0 && s.curve != Stretch::Curve::blend && s.turning == Turning::angles;
    if (!can_turn || follow(machine, path_of_one(s), options).passes) {
      stretches.push_back(s);
      continue;
    }
    bool found = false;
    for (const Vec3& held : {s.angles_to, s.angles_from, at_home}) {
      std::vector<Stretch> parts;
      const auto turn = [&](const Vec3& p, const Vec3& from, const Vec3& to) {
        const auto t = straight({p, from}, {p, to});
        if (!t) return;
        Stretch piece = *t;
        piece.before = s.before;
        piece.line = s.line;
        piece.inserted = true;
        if (s.duration > 0) piece.duration = 0.25 * s.duration;
        parts.push_back(piece);
      };
      turn(s.from, s.angles_from, held);
      Stretch way = s;
      way.angles_from = way.angles_to = held;
      way.wait = way.wait_before = 0;
      if (s.duration > 0) {
        const int turns = int((held - s.angles_from).norm() > 0) + int((held - s.angles_to).norm() > 0);
        way.duration = s.duration * (1 - 0.25 * turns);
      }
      parts.push_back(way);
      turn(s.to, held, s.angles_to);
      if (parts.size() == 1) continue;
      parts.front().wait_before = s.wait_before;
      parts.back().wait = s.wait;
      PosePath tried;
      tried.stretches = parts;
      for (const Stretch& p : parts) {
        tried.length += p.length;
        tried.size += p.size;
      }
      if (!follow(machine, tried, options).passes) continue;
      for (const Stretch& p : parts)
        if (p.inserted) out.points.push_back({k, s.line, p.from, p.angles_to});
      stretches.insert(stretches.end(), parts.begin(), parts.end());
      found = true;
      break;
    }
    if (!found) stretches.push_back(s);
  }
  out.path = *pose_path_of(std::move(stretches));
  out.passes = follow(machine, out.path, options).passes;
  return out;
}

std::optional<PathQuality> quality_of(const AnyMachine& machine, const PosePath& path, const MoveOptions& options,
                                      Goal goal, double weight) {
  PathQuality out;
  out.least = kNoLimit;
  JointVector near;
  for (const Stretch& s : path.stretches) {
    const int pieces = std::max(2, static_cast<int>(std::ceil(s.length / options.step)));
    double last = 0;
    for (int i = 0; i <= pieces; ++i) {
      const Pose target = s.pose(s.size * i / pieces);
      const kinematics::InverseResult r =
          near.size() > 0 ? kinematics::inverse_near(machine, target, near) : kinematics::inverse(machine, target);
      if (r.solutions.empty()) return {};
      near = r.reachable() != nullptr && near.size() == 0 ? r.reachable()->joints : r.solutions.front().joints;
      const kinematics::Dexterity d = kinematics::dexterity(machine, kinematics::settled(machine, target, near), near);
      const double value = goal == Goal::sigma_min     ? d.sigma_min
                           : goal == Goal::determinant ? std::abs(d.determinant)
                                                       : 1 / d.condition;
      out.least = std::min(out.least, value);
      if (i > 0) out.integral += 0.5 * (last + value) * units::to_mm(s.length) / pieces;
      last = value;
    }
    out.length += units::to_mm(s.length);
  }
  if (!(out.length > 0)) return {};
  out.f = (weight + (1 - weight) * out.integral) / out.length;
  return out;
}

}  // namespace polypod::motion
