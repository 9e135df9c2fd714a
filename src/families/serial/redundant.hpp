// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The inverse of arms whose task leaves one freedom open, over a closed one.
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "closed_inverse.hpp"
#include "polypod/families/serial/carried_arm.hpp"

namespace polypod::machine {

/// For an arm with one joint more than its task needs there is a number u, so that with u the rest has a closed
/// inverse:
/// - the first joint that moves carries such an arm (a rail, a turntable below it): u is that joint, and the arm behind
///   it sees the pose X_k(0) X_k(u)^-1 X_MT, X_k the frame that the joint carries;
/// - six joints whose task holds no turn about the tool axis: u is that turn, and the pose X_MT Rz(u).
/// In each branch of the closed inverse the u is taken whose joints are the nearest to the middle of their ranges and
/// far from singular poses, with the least
///   sum_i ((q_i - middle_i) / width_i)^2 + (0.02 / (|det S| + 0.02))^2
/// (S: J with its lengths over half the sum of the links) among those within the limits: from 65 values of u the best,
/// then between
///   its
/// neighbours by the golden section. Where none of them keeps the limits, from the five that miss them least. So every
/// interval of u within the limits that is wider than 1/64 of its range is found, and others where their neighbours
/// lead there.
class RedundantInverse {
 public:
  /// Nothing if the arm is no such arm.
  static std::optional<RedundantInverse> of(const SerialArm& arm);

  /// One solution a branch, with its number in the closed inverse; those within the limits first, the nearest to the
  /// middle of the ranges before others. Cost: some 0.2 ms.
  [[nodiscard]] kinematics::InverseResult solve(const Pose& X_MT) const;
  /// Whether a solution keeps the limits `heeded`, which hold those of u. Cost: some us where there is one.
  [[nodiscard]] bool reaches(const Pose& X_MT, kinematics::LimitBits heeded) const;
  /// The joints whose least room to a limit is largest, over u and all branches: rooms times `scales`, two a joint,
  /// those of scale 0 left out. Nothing where no solution was found. By 17 values of u and a few about the best of
  /// them, which do where a room is left; else by 65 and the golden section about the best two. Cost: 15 or 50 us.
  [[nodiscard]] std::optional<kinematics::JointVector> roomiest(const Pose& X_MT, std::span<const double> scales) const;
  /// The branch in which the joints q stand, which take the pose X_MT; nothing where none has them.
  [[nodiscard]] std::optional<unsigned> branch_of(const Pose& X_MT, const kinematics::JointVector& q) const;
  /// The limits of u, two bits; none where u is no joint.
  [[nodiscard]] kinematics::LimitBits own_limits() const { return carried_ ? 3 : 0; }
  /// That whose branches these are.
  [[nodiscard]] const ClosedInverse& closed() const { return closed_; }

 private:
  static constexpr int kBranches = 8;
  struct One {
    bool exists = false;
    kinematics::JointVector joints;  ///< all of them
    double cost = 0;                 ///< above kMisses where a limit is missed, by how much
    kinematics::LimitBits violations = 0;
    bool singular = false;
  };
  using All = std::array<One, kBranches>;

  [[nodiscard]] Pose target(const Pose& X_MT, double u) const;
  /// 0 far from singular poses of the arm behind u, 1 at them.
  [[nodiscard]] double near_singular(const kinematics::JointVector& q) const;
  /// What is looked for.
  struct Ask {
    kinematics::LimitBits heeded;
    std::optional<unsigned> branch;  ///< this one alone
    bool any;                        ///< the first within the limits will do
  };
  void look(const Pose& X_MT, double u, const Ask& ask, All& out) const;
  void take(unsigned branch, double u, const double* q, bool singular, const Ask& ask, All& out) const;
  [[nodiscard]] double at_grid(int k) const;
  /// So many pieces of the grid to either side of a value of it, within the range.
  [[nodiscard]] std::pair<double, double> beside(int k, int pieces) const;
  /// The best of a branch between the neighbours of a value of the grid.
  [[nodiscard]] One refined(const Pose& X_MT, const Ask& ask, int k) const;
  struct Roomiest {
    double room = -std::numeric_limits<double>::infinity();
    kinematics::JointVector joints;
  };
  /// The largest over the branches at u of the least room; `best` becomes what has more room than it.
  double room_at(const Pose& X_MT, double u, std::span<const double> scales, Roomiest& best) const;

  SerialArm inner_;
  ClosedInverse closed_;
  std::optional<CarriedArm> carried_;  ///< where u is a joint
  std::vector<JointRange> range_;
  double length_ = 0;          ///< m, of links
  double low_ = 0, high_ = 0;  ///< of u
};

}  // namespace polypod::machine
