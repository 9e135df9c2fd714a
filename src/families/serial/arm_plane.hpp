// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The vertical plane of an arm's links in first order: what the limits of joints 2, 3 and 5 are functions of.
#pragma once

#include <array>
#include <cmath>

#include "limit_terms.hpp"
#include "polypod/families/serial/kinematics.hpp"

namespace polypod::workspace {

/// The wrist centre c and the tool axis k in the base, seen from joint 1: what does not depend on the branch.
struct ArmFrame {
  FirstOrder r2, r, height, k_out, k_across, radial, k_height;
  FirstOrder k_up;

  ArmFrame(const machine::WristInverse::Form& f, const std::array<FirstOrder, 3>& c, const std::array<FirstOrder, 3>& k,
           const Domain& d) {
    r2 = square(c[0], d) + square(c[1], d);
    r = root(r2, d);
    height = c[2] - f.d1;
    // Parts of the axis along and across the way out from joint 1: no more than its horizontal part, also where the
    // wrist centre stands above joint 1 and that way is any.
    const FirstOrder over_r = inverse_of_positive(r, d), level2 = square(k[0], d) + square(k[1], d);
    const double level = std::sqrt(std::max(0.0, level2.value + level2.radius(d)));
    radial = times(c[0], k[0], d) + times(c[1], k[1], d);
    k_out = arm::at_most(times(radial, over_r, d), level, d);
    k_across = arm::at_most(times(times(c[1], k[0], d) - times(c[0], k[1], d), over_r, d), level, d);
    k_up = k[2];
    k_height = times(k_up, height, d);
  }
};

/// The plane of one shoulder branch, W = (rho, height) from joint 2 to the wrist centre.
struct ArmPlane {
  FirstOrder rho, height, s3;
  FirstOrder distance2;                   ///< |W|^2, (2.20)
  FirstOrder along_upper, along_forearm;  ///< W . u of the two links' directions u, both of |W|^2 alone
  FirstOrder k_out, k_up, k_across;       ///< the tool axis: (k_out, k_up) in the plane
  FirstOrder k_plane2;                    ///< k_out^2 + k_up^2
  FirstOrder k_dot, k_cross;              ///< (k_out, k_up) . W and its cross product with W

  ArmPlane(const machine::WristInverse::Form& f, const ArmFrame& frame, double side, const Domain& d) {
    rho = side * frame.r - f.a1;
    height = frame.height;
    distance2 = frame.r2 - 2 * side * f.a1 * frame.r + square(height, d) + f.a1 * f.a1;
    s3 = (0.5 / (f.a2 * f.d4)) * (distance2 - (f.a2 * f.a2 + f.d4 * f.d4));
    along_upper = (0.5 / f.a2) * (distance2 + (f.a2 * f.a2 - f.d4 * f.d4));
    along_forearm = (0.5 / f.d4) * (distance2 + (f.d4 * f.d4 - f.a2 * f.a2));
    k_out = side * frame.k_out;
    k_up = frame.k_up;
    k_across = side * frame.k_across;
    k_plane2 = FirstOrder(1) - square(k_across, d);
    // k_out rho = (c_x k_x + c_y k_y) - side a1 k_out_front; a1 is often 0.
    k_dot = frame.radial + frame.k_height;
    if (f.a1 != 0) k_dot = k_dot - f.a1 * k_out;
    k_cross = times(k_out, height, d) - times(k_up, rho, d);
  }
};

/// The forearm's direction and the parts of the tool axis along it and square to it, with roots that are steep where
/// the elbow is stretched: for what has no better form.
struct Forearm {
  FirstOrder k3x, k3z;

  Forearm(const machine::WristInverse::Form& f, const ArmPlane& plane, double bend, const Domain& d) {
    // Seen from the upper arm the wrist centre lies at (x, -y), so that t2 = angle(rho, height) + angle(x, y); the
    // vector below has the direction of t2 and the length distance2.
    const FirstOrder c3 = bend * root(FirstOrder(1) - square(plane.s3, d), d);
    const FirstOrder x = f.d4 * plane.s3 + f.a2, y = f.d4 * c3;
    const FirstOrder along = times(plane.rho, x, d) - times(plane.height, y, d);
    const FirstOrder up = times(plane.height, x, d) + times(plane.rho, y, d);
    const FirstOrder over = inverse_of_positive(plane.distance2, d);
    const FirstOrder c2 = times(along, over, d), s2 = times(up, over, d);
    // (wrist centre - elbow) / d4; k . forearm = -sin t5 (2.25).
    const FirstOrder s23 = (1 / f.d4) * (plane.rho - f.a2 * c2), c23 = (1 / f.d4) * (f.a2 * s2 - plane.height);
    k3z = times(s23, plane.k_out, d) - times(c23, plane.k_up, d);
    k3x = times(c23, plane.k_out, d) + times(s23, plane.k_up, d);
  }
};

}  // namespace polypod::workspace
