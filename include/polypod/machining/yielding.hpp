// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How a soft tool follows a command that turns away while it cuts.
#pragma once

#include <span>

#include "polypod/cutting/ball_stock.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::machining {

/// The mean force on the tool, N, where it goes in the direction `d` of the plane: edge + chip * (feed per tooth, m).
struct ForceAlong {
  Eigen::Vector2d d = Eigen::Vector2d::UnitX();
  Vec3 edge = Vec3::Zero(), chip = Vec3::Zero();
};

/// Where the tool is at the end of a step, and the force on it.
struct Yielded {
  Vec3 tip = Vec3::Zero();    ///< m
  Vec3 force = Vec3::Zero();  ///< N
  double rest = 0;            ///< m, what the balance of a ball still moves by
};

/// The balance of a soft tool in motion: the step u = x - x_before with x = c + C F(u), where the force follows the way
/// that the tool really goes. u = h (d, .) in the plane, h >= 0 its length, and
///   F = edge(d) + chip(d) h / passes,   passes: how many teeth pass during the step,
/// so that per step (implicit Euler) a tool whose force is in proportion to its speed lags behind its command by the
/// deflection that the force makes. In the direction d, with r = c - x_before, the components of the plane of
///   h (d - C chip / passes) = r + C edge
/// say h and a residual across; d is where that residual is 0, between the given directions by linear interpolation.
/// Where the edges hold the tool against all of r it stands still. Of several balances the shortest step counts; where
/// there is none, because the force jumps from one direction to the next, the direction that comes nearest. Along z the
/// tip follows c + C F, and what the end of the cutter meets is left out. Derived here; with `chip` the same in all
/// directions and no edge it is the lag tau x' = c - x, tau the time in which the command covers the deflection.
///
/// `around`: at least three directions, evenly round the circle, in order. `passes` > 0. Cost: some 10 ns a direction.
Yielded yield_step(const Vec3& before, const Vec3& command, const Mat3& C, std::span<const ForceAlong> around,
                   double passes);

/// The same for a ball, which meets material on all sides: the step u = x - x_before balances in space,
///   u = c - x_before + C sum of edge_k r((n_k . u - gap_k) / w) + chip_k max(0, n_k . u - gap_k) / passes,
/// r rising from 0 to 1 over the way w = 0.5 um, after which an edge presses in full: so a tool that its edges hold
/// creeps by up to w a step. By Newton's method, with steps that are halved until they help, from `guess` and from
/// rest, then with full steps; where none balances to 0.1 um, the best of what was met, and its `rest`. Cost: about 50
/// us.
Yielded yield_step(const Vec3& before, const Vec3& command, const Mat3& C,
                   std::span<const cutting::BallContact> contacts, double passes, const Vec3& guess);

}  // namespace polypod::machining
