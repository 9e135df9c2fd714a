// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Simbody, an independent multibody code, behind plain figures: its headers are C++17.
#pragma once

#include <Eigen/Dense>
#include <memory>

namespace polypod::test {

/// Mass, center of mass and inertia about it, in the frame of the body.
struct Mass {
  double mass = 0;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
};
/// A frame in another.
struct Place {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
};
/// Of a platform in M, at one instant.
struct PlatformMotion {
  Place at;
  Eigen::Vector3d speed, acceleration, turning, turning_rate;  ///< m/s, m/s^2, rad/s, rad/s^2
};

/// Bodies at joints, put together one by one; each has a number, and ground is 0. Drives are the slides and pins, in
/// the order in which they were made.
class Multibody {
 public:
  explicit Multibody(const Eigen::Vector3d& gravity);
  ~Multibody();
  Multibody(const Multibody&) = delete;
  Multibody& operator=(const Multibody&) = delete;

  /// A leg from a point of its parent, which turns about two axes; its z axis points along `way` (in M) at the instant.
  int turning(int parent, const Eigen::Matrix3d& R_MP, const Eigen::Vector3d& point, const Eigen::Vector3d& way,
              const Mass& mass);
  /// Along an axis of its parent, at q.
  int sliding(int parent, const Eigen::Vector3d& axis, const Eigen::Vector3d& from, double q, const Mass& mass);
  /// About the z axis of a frame of its parent, at the angle. `sign`: in which sense the drive counts.
  int pinned(int parent, const Place& X_PF, double angle, double sign, const Mass& mass);
  /// The body whose motion is given; of `turns` false it keeps its orientation.
  void platform(const PlatformMotion& motion, bool turns, const Mass& mass);
  /// A point of a leg is a point of the platform.
  void close(int leg, const Eigen::Vector3d& in_leg, const Eigen::Vector3d& in_platform);
  /// Without a platform: the motion of the drives is given.
  void drives_move(const Eigen::VectorXd& speeds, const Eigen::VectorXd& accelerations);

  /// Forces of the drives: M u' + bias - gravity = S tau + G^T lambda, where speeds and accelerations that are not
  /// given follow from the loops.
  Eigen::VectorXd forces();
  /// After `forces`: how far the loops are from closed, m, m/s, m/s^2.
  double places_open = 0, speeds_open = 0, accelerations_open = 0;

 private:
  struct Inside;
  std::unique_ptr<Inside> in_;
};

}  // namespace polypod::test
