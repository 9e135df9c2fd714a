// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Every assembly mode of a hexapod: all poses at which six given legs fit.
#pragma once

#include <string>
#include <vector>

#include "polypod/families/hexapod/kinematics.hpp"

namespace polypod::machine {

/// What is known about the modes that are not listed.
enum class ModesProof {
  none,           ///< further modes may exist
  general,        ///< all 40 zeros of the general platform are proven distinct: there is no further one
  double_joints,  ///< all 16 zeros of a platform with three double joints are
  no_length,      ///< a length below zero: no pose can have it
  subdivision,    ///< all rotations were searched box by box with bounds: there is no further real zero
};

struct AssemblyModes {
  std::vector<Pose> poses;        ///< X_MT, sorted by z, then y, then x of the tool tip, highest first
  std::vector<double> residuals;  ///< largest | |leg i| - l_i | of each, m
  ModesProof proof = ModesProof::none;
  [[nodiscard]] bool complete() const { return proof != ModesProof::none; }
  /// More than 40 poses were found: isolated ones cannot be so many, so the platform moves though its lengths stand.
  [[nodiscard]] bool moves() const;

  // How they were found.
  int zeros = 0;  ///< complex modes (real ones too) whose existence is proven, each distinct from the others
  int zeros_at_infinity = 0;  ///< among them those without a finite pose
  int singular_ends = 0;      ///< paths of the last pass that do not end at a proven zero
  int passes = 0;             ///< how often the 40 paths were followed
  int boxes = 0;              ///< of rotations and places that were looked at
  bool singular_box = false;  ///< the division ended without a proof at a tiny box: a mode is singular or nearly so
  int starts = 0;             ///< Newton's starts where nothing was proven
};

struct ModesOptions {
  int passes = 3;      ///< at most; further ones only where the first proves nothing
  int starts = 2000;   ///< of Newton, only where nothing is proven
  int boxes = 100000;  ///< at most, some 2 us each; 0: without division
};

/// All real solutions X_MT of |t + R e_i - a_i| = l_i, i = 1..6, for any six legs. There are two ways to a proof.
///
/// Division: the rotations are divided into boxes, and a box is thrown away where bounds of the six equations show that
/// no pose is in it, or that none is but one whose existence and uniqueness are proven (interval Newton). Where no box
/// is left, all real modes are known. First for platforms in planes z = const, which it takes 0.5 to 7 ms for.
///
/// Homotopy: the equations in dual quaternions have 40 isolated complex zeros for general legs (Ronga and Vust 1995).
/// Those of one general complex platform are stored; they are followed to the given legs (parameter homotopy; Morgan
/// and Sommese 1989). Each end is then proven to be close to exactly one zero, by interval arithmetic, and real or not
/// real. Where 40 are distinct, no other exists, not even one of a motion of its own: every solution is a limit of
/// those of general platforms near this one, and these are all near the 40. So the list is complete, whatever the paths
/// did. With three double joints at base or platform the same holds with 16 (Innocenti and Parenti-Castelli 1990).
/// First for platforms in space; where it proves less there, the division follows.
///
/// A singular mode (one that is about to vanish, similar hexagons, motions of their own) lets neither be a proof. Then
/// nothing is claimed (`ModesProof::none`), and Newton from a fixed sequence of starts looks for modes that were
/// missed; modes closer than 1e-5 of the machine's size count as one there.
///
/// The result does not depend on the number of threads. No poses where a length is not a number.
/// Cost on one core: 0.5 to 7 ms in planes; 8 to 10 ms in space where the paths suffice, 7 to 19 ms more where not;
/// 60 to 170 ms where nothing is proven.
AssemblyModes assembly_modes(const SixLegs& legs, const ModesOptions& options = {});

/// One sentence for people: how many, and whether these are all.
std::string description_of(const AssemblyModes& modes);
/// How they were found, for JSON.
std::string method_of(const AssemblyModes& modes);

}  // namespace polypod::machine
