// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The inverse of an ortho-parallel basis with a spherical wrist as it was published: Brandstoetter, Angerer, Hofbaur,
// An Analytical Solution of the Inverse Kinematics Problem of Industrial Serial Manipulators with an Ortho-parallel
// Basis and a Spherical Wrist (2014). The peer of SphericalWristInverse.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "polypod/geometry/pose.hpp"

namespace polypod::bench {

struct Opw {
  double a1, a2, b, c1, c2, c3, c4;  ///< m, as in the paper's figure

  using Joints = std::array<double, 6>;

  /// u_x0, u_y0, u_z0 and R_ee0 of the paper.
  [[nodiscard]] Pose forward(const Joints& q) const {
    const double psi = std::atan2(a2, c3), k = std::hypot(a2, c3);
    const double s1 = std::sin(q[0]), o1 = std::cos(q[0]), s23 = std::sin(q[1] + q[2]), o23 = std::cos(q[1] + q[2]);
    const double x1 = c2 * std::sin(q[1]) + k * std::sin(q[1] + q[2] + psi) + a1;
    const double z1 = c2 * std::cos(q[1]) + k * std::cos(q[1] + q[2] + psi);
    const double s4 = std::sin(q[3]), o4 = std::cos(q[3]), s5 = std::sin(q[4]), o5 = std::cos(q[4]),
                 s6 = std::sin(q[5]), o6 = std::cos(q[5]);
    Mat3 R_0c, R_ce;
    R_0c << o1 * o23, -s1, o1 * s23, s1 * o23, o1, s1 * s23, -s23, 0, o23;
    R_ce << o4 * o5 * o6 - s4 * s6, -o4 * o5 * s6 - s4 * o6, o4 * s5, s4 * o5 * o6 + o4 * s6, -s4 * o5 * s6 + o4 * o6,
        s4 * s5, -s5 * o6, s5 * s6, o5;
    const Mat3 R = R_0c * R_ce;
    return {R, Vec3(x1 * o1 - b * s1, x1 * s1 + b * o1, z1 + c1) + c4 * R.col(2)};
  }

  /// All eight solutions; what does not exist is nan.
  void inverse(const Pose& X, std::array<Joints, 8>& out) const {
    const Mat3& e = X.R;
    const Vec3 c = X.p - c4 * e.col(2);
    const double in_plane = std::sqrt(c.x() * c.x() + c.y() * c.y() - b * b), nx1 = in_plane - a1;
    const double to_c = std::atan2(c.y(), c.x()), to_b = std::atan2(b, nx1 + a1), z = c.z() - c1;
    const double t1_i = to_c - to_b, t1_ii = to_c + to_b - std::numbers::pi;
    const double s1_2 = nx1 * nx1 + z * z, s1 = std::sqrt(s1_2);
    const double far = nx1 + 2 * a1, s2_2 = far * far + z * z, s2 = std::sqrt(s2_2);
    const double k_2 = a2 * a2 + c3 * c3, k = std::sqrt(k_2), bend = std::atan2(a2, c3);
    const double near_angle = std::acos((s1_2 + c2 * c2 - k_2) / (2 * s1 * c2)), near_to = std::atan2(nx1, z);
    const double far_angle = std::acos((s2_2 + c2 * c2 - k_2) / (2 * s2 * c2)), far_to = std::atan2(far, z);
    const double near_elbow = std::acos((s1_2 - c2 * c2 - k_2) / (2 * c2 * k));
    const double far_elbow = std::acos((s2_2 - c2 * c2 - k_2) / (2 * c2 * k));
    const std::array<double, 4> t1{t1_i, t1_i, t1_ii, t1_ii};
    const std::array<double, 4> t2{-near_angle + near_to, near_angle + near_to, -far_angle - far_to,
                                   far_angle - far_to};
    const std::array<double, 4> t3{near_elbow - bend, -near_elbow - bend, far_elbow - bend, -far_elbow - bend};
    const double sin_i = std::sin(t1_i), cos_i = std::cos(t1_i), sin_ii = std::sin(t1_ii), cos_ii = std::cos(t1_ii);
    const std::array<double, 4> sin1{sin_i, sin_i, sin_ii, sin_ii}, cos1{cos_i, cos_i, cos_ii, cos_ii};
    for (std::size_t p = 0; p < 4; ++p) {
      const double s23 = std::sin(t2[p] + t3[p]), c23 = std::cos(t2[p] + t3[p]);
      const double m = e(0, 2) * s23 * cos1[p] + e(1, 2) * s23 * sin1[p] + e(2, 2) * c23;
      const double t4 = std::atan2(e(1, 2) * cos1[p] - e(0, 2) * sin1[p],
                                   e(0, 2) * c23 * cos1[p] + e(1, 2) * c23 * sin1[p] - e(2, 2) * s23);
      const double t5 = std::atan2(std::sqrt(1 - m * m), m);
      const double t6 = std::atan2(e(0, 1) * s23 * cos1[p] + e(1, 1) * s23 * sin1[p] + e(2, 1) * c23,
                                   -e(0, 0) * s23 * cos1[p] - e(1, 0) * s23 * sin1[p] - e(2, 0) * c23);
      out[p] = {t1[p], t2[p], t3[p], t4, t5, t6};
      out[p + 4] = {t1[p], t2[p], t3[p], t4 + std::numbers::pi, -t5, t6 - std::numbers::pi};
    }
  }
};

}  // namespace polypod::bench
