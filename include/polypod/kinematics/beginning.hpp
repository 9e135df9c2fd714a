// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where the joints begin a way whose first pose leaves some of them free: looked ahead for, where they cannot be.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// A piece of a way: its poses for 0 <= s <= 1, and in how many steps they are looked at.
struct WayPiece {
  std::function<Pose(double)> pose;
  int steps = 1;
};

struct Beginning {
  JointVector joints;  ///< at the first pose
  std::string
      posture;  ///< branch_name of those that it leads to, behind the free poses; empty where there are no names
};

/// The joints at the first pose of a way, where that leaves more open (free_joints) than poses behind it: from the
/// first pose that leaves less open, each solution is followed back, and the one whose joints at the start are the
/// nearest to what the inverse gives there is chosen, so that the way goes on without a jump. `next` gives the pieces
/// in order, each from where the one before ends. `posture`: only solutions with that name; empty: any. Nothing where
/// the first pose leaves nothing open that others do not, has no joints, or no pose settles it (within the first 20
/// 000). Cost: some 50 us where nothing is open; else 40 us a pose up to the one that settles it.
std::optional<Beginning> look_ahead(const AnyMachine& machine, const std::function<std::optional<WayPiece>()>& next,
                                    const std::string& posture = {});
/// The posture that the way comes to from the joints `start` (rad or m), where its first pose leaves that open; empty
/// where it does not, or no pose settles it.
std::string posture_behind(const AnyMachine& machine, const std::function<std::optional<WayPiece>()>& next,
                           const JointVector& start);

/// "begins with joint 4 at 90.0 deg, from where the program goes on: the first pose leaves that free; ...".
std::string in_words(const AnyMachine& machine, const Beginning& beginning);

/// The solution to begin with at the pose X_MT: without `start` that of reachable_in; with the joints `start` that the
/// machine has before (rad or m), of those in the posture the nearest to them, `inverse` being inverse_near(start).
/// Where postures differ in nothing but joints that the pose leaves free, such as a straight wrist, the nearest at all.
const Solution* first_solution(const AnyMachine& machine, const Pose& X_MT, const InverseResult& inverse,
                               const std::string& posture, bool has_start);

}  // namespace polypod::kinematics
