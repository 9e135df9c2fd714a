// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine of three slides, for which all that yields and vibrates has a closed form an axis.
#pragma once

#include "polypod/motion/dynamics.hpp"

namespace polypod::machining {

/// Three slides: x carries y, which carries z. Stiffnesses in N/m.
inline constexpr const char* kSlides = R"(
name = "slides"
family = "serial"
task = ["x", "y", "z"]
dh = [ { joint = "prismatic", alpha_deg = -90 }, { joint = "prismatic", theta_offset_deg = 90, alpha_deg = -90 }, { joint = "prismatic", theta_offset_deg = 180 } ]
limits = [ { min_mm = -500, max_mm = 500 }, { min_mm = -500, max_mm = 500 }, { min_mm = -500, max_mm = 500 } ]
base = { b_deg = 90 }
compliance_rad_per_Nm = [5e-8, 2.5e-8, 3.3333333333333334e-8]
)";
inline constexpr double kStiffnessX = 2e7, kStiffnessY = 4e7, kStiffnessZ = 3e7;
inline constexpr double kMassX = 10, kMassY = 12, kMassZ = 8;  // each slide's own, kg

inline motion::Dynamics masses_of_slides() {
  motion::Dynamics out;
  for (const double mass : {kMassX, kMassY, kMassZ}) {
    motion::Body b;
    b.mass = mass;
    out.links.emplace_back(b);
  }
  return out;
}

}  // namespace polypod::machining
