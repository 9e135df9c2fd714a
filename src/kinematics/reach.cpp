// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/reach.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <limits>

#include "polypod/kinematics/families.hpp"

namespace polypod::kinematics {
namespace {

Reach span_of(const machine::SerialArm& arm) {
  double reach = arm.X_FT.p.norm();
  for (const machine::DhRow& row : arm.dh) {
    reach += std::abs(row.a) + std::abs(row.d);
    if (row.kind != machine::JointKind::prismatic) continue;
    const auto [low, high] = row.locked ? machine::JointRange{*row.locked, *row.locked} : row.range;
    reach += std::max(std::abs(low), std::abs(high));
  }
  return {arm.X_MB.p - Vec3::Constant(reach), arm.X_MB.p + Vec3::Constant(reach)};
}

/// Round the feet of the legs: a leg, then the way from its joint on the platform to the tip.
Reach span_of(const machine::SixPoints& feet, const machine::SixPoints& platform, double tool, double leg) {
  double lever = 0;
  Reach box{feet[0], feet[0]};
  for (int i = 0; i < machine::kLegs; ++i) {
    lever = std::max(lever, platform[i].norm() + std::abs(tool));
    box.low = box.low.cwiseMin(feet[i]);
    box.high = box.high.cwiseMax(feet[i]);
  }
  return {box.low - Vec3::Constant(leg + lever), box.high + Vec3::Constant(leg + lever)};
}
Reach span_of(const machine::StrutHexapod& m) {
  return span_of(m.base_joint, m.platform_joint, m.tool_length, m.length_max);
}
Reach span_of(const machine::SliderHexapod& m) {
  const Reach a = span_of(m.rail_outer, m.platform_joint, m.tool_length, m.longest_leg());
  const Reach b = span_of(m.rail_inner, m.platform_joint, m.tool_length, m.longest_leg());
  return {a.low.cwiseMin(b.low), a.high.cwiseMax(b.high)};
}

/// Round home: no chain reaches farther than arm (or rail) and rod.
template <class M>
requires std::derived_from<M, machine::Delta> Reach span_of(const M& m) {
  double reach = 0;
  for (int i = 0; i < m.arms; ++i) {
    double chain = 2 * m.rod_length[i];
    if constexpr (std::is_same_v<M, machine::RotaryDelta>) {
      chain += 2 * m.arm_length[i];
    } else {
      chain += m.range.max;
    }
    reach = std::max(reach, chain);
  }
  return {m.home - Vec3::Constant(reach), m.home + Vec3::Constant(reach)};
}

/// Round what the legs are fixed to: the way of the drive, the leg, and from its end to the tip.
Reach span_of(const machine::Parallel& m) {
  Reach box{Vec3::Constant(std::numeric_limits<double>::infinity()),
            Vec3::Constant(-std::numeric_limits<double>::infinity())};
  for (const machine::ParallelLeg& leg : m.legs) {
    const double lever = leg.ring ? (leg.ring->center - m.tool).norm() + leg.ring->radius
                                  : (leg.platform - m.tool).norm() + leg.still.norm();
    const double leg_length = leg.drive == machine::LegDrive::strut ? leg.range.max : leg.rod + leg.arm;
    std::array<Vec3, 2> ends{leg.base, leg.base};
    if (leg.drive == machine::LegDrive::rail) {
      ends = {leg.base + leg.range.min * leg.rail, leg.base + leg.range.max * leg.rail};
    }
    for (const Vec3& end : ends) {
      box.low = box.low.cwiseMin(end - Vec3::Constant(leg_length + lever));
      box.high = box.high.cwiseMax(end + Vec3::Constant(leg_length + lever));
    }
  }
  return box;
}

Vec3 middle_of(const machine::Parallel& m) {
  return m.home.p;
}
Vec3 middle_of(const machine::SerialArm&) {
  return Vec3::Zero();
}
Vec3 middle_of(const machine::Delta& m) {
  return m.home;
}
template <class Hexapod>
requires(!std::derived_from<Hexapod, machine::Delta>) Vec3 middle_of(const Hexapod& m) {
  return {0, 0, m.home.height + m.tool_length};
}

/// Round the base of the first stage: no stage's tool is farther from its own base than the farthest corner.
Reach span_of(const machine::Stages& m) {
  double farthest = 0;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    const Reach own = reach(m.machines[k]);
    farthest += m.data[k].mount.p.norm() + own.low.cwiseAbs().cwiseMax(own.high.cwiseAbs()).norm();
  }
  return {Vec3::Constant(-farthest), Vec3::Constant(farthest)};
}
Vec3 middle_of(const machine::Stages& m) {
  return machine::home_pose(m).p;
}

}  // namespace

Reach reach(const machine::AnyMachine& machine) {
  return std::visit([](const auto& m) { return span_of(m); }, machine);
}

Vec3 middle_of_work(const machine::AnyMachine& machine) {
  return std::visit([](const auto& m) { return middle_of(m); }, machine);
}

}  // namespace polypod::kinematics
