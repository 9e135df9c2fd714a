// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Rigid motions on any of the three number types (double, dual numbers, intervals).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace polypod {

template <class T>
using Vector3 = Eigen::Matrix<T, 3, 1>;
template <class T>
using Matrix3 = Eigen::Matrix<T, 3, 3>;
using Vec3 = Vector3<double>;
using Mat3 = Matrix3<double>;
/// Twists, wrenches and pose errors are [linear; angular].
using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

/// a b of a 3 x 3 matrix and one or three columns. Dual numbers (`a` the value, `v` the derivatives) are summed in
/// place: Eigen makes a number of each product first, and its loops are inlined or not as a file is large.
template <class T, int Columns>
Eigen::Matrix<T, 3, Columns> product(const Matrix3<T>& a, const Eigen::Matrix<T, 3, Columns>& b) {
  Eigen::Matrix<T, 3, Columns> c;
  if constexpr (requires(T t) { t.a, t.v; }) {
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < Columns; ++j) {
        T& sum = c(i, j);
        sum.a = a(i, 0).a * b(0, j).a;
        sum.v = a(i, 0).a * b(0, j).v + b(0, j).a * a(i, 0).v;
        for (int k = 1; k < 3; ++k) {
          sum.a += a(i, k).a * b(k, j).a;
          sum.v += a(i, k).a * b(k, j).v + b(k, j).a * a(i, k).v;
        }
      }
    }
  } else {
    c.noalias() = a * b;
  }
  return c;
}

/// X_AB: the pose of frame B in frame A; p_A = R p_B + p.
template <class T>
struct PoseT {
  Matrix3<T> R = Matrix3<T>::Identity();  ///< R_AB, columns are B's axes in A
  Vector3<T> p = Vector3<T>::Zero();      ///< p_AB, m

  friend PoseT operator*(const PoseT& a, const PoseT& b) {
    PoseT c{product<T, 3>(a.R, b.R), product<T, 1>(a.R, b.p)};
    c.p += a.p;
    return c;
  }
  friend Vector3<T> operator*(const PoseT& a, const Vector3<T>& v) {
    Vector3<T> c = product<T, 1>(a.R, v);
    c += a.p;
    return c;
  }
  [[nodiscard]] PoseT inverse() const {
    PoseT c;
    c.R = R.transpose();
    c.p = -(c.R * p);
    return c;
  }
  template <class U>
  [[nodiscard]] PoseT<U> cast() const {
    return {R.template cast<U>(), p.template cast<U>()};
  }
};
using Pose = PoseT<double>;

inline Mat3 rotation_x(double angle) {
  return Eigen::AngleAxisd(angle, Vec3::UnitX()).toRotationMatrix();
}
inline Mat3 rotation_y(double angle) {
  return Eigen::AngleAxisd(angle, Vec3::UnitY()).toRotationMatrix();
}
inline Mat3 rotation_z(double angle) {
  return Eigen::AngleAxisd(angle, Vec3::UnitZ()).toRotationMatrix();
}

/// R = R_z(C) R_y(B) R_x(A): the orientation of a machine with axes A, B, C (SLAV (2.8) for C = 0).
inline Mat3 rotation_abc(double a, double b, double c) {
  return rotation_z(c) * rotation_y(b) * rotation_x(a);
}

/// The same on any number type.
template <class T>
Matrix3<T> rotation_by_angles(const T& a, const T& b, const T& c) {
  using std::cos, std::sin;
  const T ca = cos(a), sa = sin(a), cb = cos(b), sb = sin(b), cc = cos(c), sc = sin(c);
  Matrix3<T> R;
  R << cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa, sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa,
      -sb, cb * sa, cb * ca;
  return R;
}

/// The angles A, B, C of R = R_z(C) R_y(B) R_x(A), with -pi/2 <= B <= pi/2. Where cos B = 0 (gimbal lock) A is set to
/// 0. Near gimbal lock A and C are each ill-conditioned; A is therefore taken from R_z(C)^T R, so that the three angles
/// together give R back to rounding everywhere.
inline Vec3 angles_abc(const Mat3& R) {
  const double cb = std::hypot(R(0, 0), R(1, 0));
  const double b = std::atan2(-R(2, 0), cb);
  if (cb < 1e-14) return {0.0, b, std::atan2(-R(0, 1), R(1, 1))};
  const double c = std::atan2(R(1, 0), R(0, 0));
  const double sc = std::sin(c), cc = std::cos(c);
  return {std::atan2(sc * R(0, 2) - cc * R(1, 2), cc * R(1, 1) - sc * R(0, 1)), b, c};
}

/// The tool axis k_T of a 5-axis machine: k = R_y(B) R_x(A) z (SLAV (2.8), third column).
inline Vec3 tool_axis_ab(double a, double b) {
  return {std::cos(a) * std::sin(b), -std::sin(a), std::cos(a) * std::cos(b)};
}

/// A and B of a unit tool axis, -pi/2 <= A <= pi/2 (SLAV (2.10), (2.11)); B is 0 where the axis is along y (any B
/// fits).
inline Eigen::Vector2d angles_ab(const Vec3& k) {
  const double horizontal = std::hypot(k.x(), k.z());
  return {std::atan2(-k.y(), horizontal), horizontal < 1e-12 ? 0.0 : std::atan2(k.x(), k.z())};
}

/// The angle between two vectors, 0 to pi, rad: exact to rounding for all angles, unlike the arc cosine.
inline double angle_between(const Vec3& a, const Vec3& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// The rotation vector (axis times angle, 0 <= angle <= pi) of a rotation matrix.
inline Vec3 rotation_vector(const Mat3& R) {
  const Eigen::AngleAxisd aa(R);
  return aa.angle() * aa.axis();
}

/// The rotation matrix of a rotation vector.
inline Mat3 rotation_of(const Vec3& w) {
  const double angle = w.norm();
  if (angle < 1e-300) return Mat3::Identity();
  return Eigen::AngleAxisd(angle, w / angle).toRotationMatrix();
}

/// [w]x with [w]x v = w x v.
template <class T>
Matrix3<T> skew(const Vector3<T>& w) {
  Matrix3<T> S;
  S << T(0.0), -w.z(), w.y(), w.z(), T(0.0), -w.x(), -w.y(), w.x(), T(0.0);
  return S;
}

}  // namespace polypod
