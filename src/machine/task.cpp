// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machine/task.hpp"

#include <Eigen/QR>
#include <numbers>

namespace polypod::machine {
namespace {

/// The angular velocity for unit rates of A, B and C of R = R_z(C) R_y(B) R_x(A), as columns; singular at B = 90 deg.
Mat3 angular_by_angles(const Mat3& R) {
  const Vec3 abc = angles_abc(R);
  Mat3 out;
  out << (rotation_z(abc.z()) * rotation_y(abc.y())).col(0), rotation_z(abc.z()).col(1), Vec3::UnitZ();
  return out;
}

}  // namespace

Pose prescribed(Task task, const Pose& target, const Pose& other) {
  Pose out = other;
  for (int k = 0; k < 3; ++k)
    if (task.holds(static_cast<Coordinate>(k))) out.p[k] = target.p[k];
  if (!task.turns()) return out;
  if (task.names_axis()) {
    const Vec3 from = other.R.col(2), to = target.R.col(2);
    const Vec3 cross = from.cross(to);
    const double sine = cross.norm(), angle = std::atan2(sine, from.dot(to));
    out.R = rotation_of(sine > 1e-15 ? Vec3(cross * (angle / sine)) : Vec3(angle * target.R.col(0))) * other.R;
    return out;
  }
  if (task.holds(Coordinate::a) && task.holds(Coordinate::b) && task.holds(Coordinate::c)) {
    out.R = target.R;
    return out;
  }
  const Vec3 wanted = angles_abc(target.R);
  Vec3 abc = angles_abc(other.R);
  if (task.holds(Coordinate::a) && task.holds(Coordinate::b)) {
    // Of the two triples of angles of an orientation that which is nearer: where B passes 90 deg they change places.
    const Mat3 same = rotation_z(abc.z() - wanted.z()) * target.R;
    const Mat3 half = rotation_z(std::numbers::pi) * same;
    out.R = (same * other.R.transpose()).trace() >= (half * other.R.transpose()).trace() ? same : half;
    return out;
  }
  for (int k = 0; k < 3; ++k)
    if (task.holds(static_cast<Coordinate>(3 + k))) abc[k] = wanted[k];
  out.R = rotation_abc(abc[0], abc[1], abc[2]);
  return out;
}

Eigen::Matrix<double, Eigen::Dynamic, 6, 0, 6, 6> task_rows(Task task, const Pose& target, double length) {
  Eigen::Matrix<double, Eigen::Dynamic, 6, 0, 6, 6> S;
  S.setZero(task.size(), 6);
  int row = 0;
  for (int k = 0; k < 3; ++k)
    if (task.holds(static_cast<Coordinate>(k))) S(row++, k) = 1;
  if (row == task.size()) return S;
  if (task.names_axis()) {
    S.block<1, 3>(3, 3) = length * target.R.col(0).transpose();
    S.block<1, 3>(4, 3) = length * target.R.col(1).transpose();
    return S;
  }
  if (task.size() - row == 3) {
    S.block<3, 3>(row, 3) = length * Mat3::Identity();
    return S;
  }
  const Mat3 rates = angular_by_angles(target.R).completeOrthogonalDecomposition().pseudoInverse();
  for (int k = 0; k < 3; ++k)
    if (task.holds(static_cast<Coordinate>(3 + k))) S.block<1, 3>(row++, 3) = length * rates.row(k);
  return S;
}

Vec6 pose_error(Task task, const Pose& target, const Pose& actual) {
  const Pose aim = prescribed(task, target, actual);
  Vec6 e;
  e << aim.p - actual.p, rotation_vector(aim.R * actual.R.transpose());
  return e;
}

}  // namespace polypod::machine
