// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Whether the drives hold the tool where it is (singular poses of type 2, JEL 6.3).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::kinematics {

/// With A dX + B dq = 0 of the closure: the smallest singular value of A and its determinant, angles as lengths on the
/// characteristic length of `dexterity`, each equation divided by the length of its translational part.
struct Hold {
  double control = 1;      ///< 0: the tool moves though the drives are locked, and holds no load; of the order of 1 far
                           ///< from such poses; 1 of serial arms
  double determinant = 1;  ///< changes its sign where a motion passes such a pose; 0 where A is not square; 1 of arms
};

/// Below this `control` is 0 but for rounding.
inline constexpr double kNoHold = 1e-9;
/// Below this a pose is close to singular: figures to first order say little.
inline constexpr double kLittleHold = 1e-3;

/// At the pose X_MT with the joints q, which belong together. Cost: some 10 us; of serial arms nothing.
Hold hold(const machine::AnyMachine& machine, const Pose& X_MT, const machine::JointVector& q);

/// The same at many poses of one machine, with the characteristic length at its home pose throughout.
class HoldAnywhere {
 public:
  explicit HoldAnywhere(const machine::AnyMachine& machine);
  /// At a pose that is `settled` (any_machine.hpp) with the joints q. `control` is exact below `enough`; above, it may
  /// be the bound that the determinant gives: with the singular values s_1 >= ... >= s_n of A, s_n >= |det A| /
  /// (|A|_F^2 / (n - 1))^((n - 1) / 2). Cost: 1 to 2 us where the bound does.
  [[nodiscard]] Hold at(const Pose& X, const machine::JointVector& q, double enough = kLittleHold) const;

 private:
  const machine::AnyMachine& machine_;
  std::vector<double> parameters_;
  double length_ = 1;
};

/// Follows a path pose by pose and says where the drives do not hold the tool.
class HoldOnPath {
 public:
  enum class At : std::uint8_t {
    held,
    hardly,  ///< `control` below kLittleHold
    passed,  ///< between this pose and the one before, the determinant has changed its sign
    lost,    ///< `control` below kNoHold
  };
  explicit HoldOnPath(const machine::AnyMachine& machine) : machine_(machine), serial_(is_serial(machine)) {}
  /// At the next pose, with its joints. One that is less than a millimetre and half a degree from the last that was
  /// looked at, and far from singular, is not looked at again.
  At next(const Pose& X_MT, const machine::JointVector& q);
  /// The path is interrupted: nothing is known of the way to the next pose.
  void leave() { known_ = false; }

 private:
  const machine::AnyMachine& machine_;
  bool serial_;
  bool known_ = false;
  Pose X_MT_;
  Hold last_;
};
/// "the drives do not hold the tool (singular, type 2)", ...; empty for `held`.
std::string in_words(HoldOnPath::At at);

/// Each row of A divided by the length of its translational part (by its own if it has no other), that of B alike.
void divide_rows(Eigen::Ref<Eigen::MatrixXd> A, Eigen::MatrixXd* B = nullptr);

}  // namespace polypod::kinematics
