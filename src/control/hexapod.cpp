// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "controllers.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"

namespace polypod::control {

// genhexkins: strut N = |t + R platform.N - base.N|, R = R_z(C) R_y(B) R_x(A), mm. It adds its two offsets to the z of
// platform and base alike, so that both stay 0 and the platform's joints are given from the tool tip.
Result<Settings> hexapod_settings(const machine::StrutHexapod& m) {
  Settings s;
  s.machine = m.name;
  s.module = "genhexkins";
  s.exact = true;
  put(s, "KINS", "KINEMATICS", "genhexkins");
  put(s, "KINS", "JOINTS", "6");
  put(s, "TRAJ", "COORDINATES", "XYZABC");
  const Pose home = machine::home_pose(m);
  const Vec3 p = home.p * units::kMmPerMetre, abc = angles_abc(home.R) / units::kRadPerDeg;
  put(s, "TRAJ", "HOME",
      fmt::format("{:.9g} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g}", p.x(), p.y(), p.z(), abc.x() + 0.0, abc.y() + 0.0,
                  abc.z() + 0.0));
  for (const char* pin : {"spindle-offset", "tool-offset", "screw-lead"}) {
    put(s, "HAL", fmt::format("genhexkins.{}", pin), 0.0);
  }
  static constexpr const char* kAxes = "xyz";
  machine::SixNumbers lengths{};
  machine::lengths(m, home, lengths.data());
  for (int i = 0; i < machine::kLegs; ++i) {
    const std::size_t leg = std::size_t(i);
    const Vec3 end = m.platform_joint[leg] - m.tool_length * Vec3::UnitZ();
    for (int k = 0; k < 3; ++k) {
      put(s, "HAL", fmt::format("genhexkins.base.{}.{}", i, kAxes[k]), units::to_mm(m.base_joint[leg][k]));
    }
    for (int k = 0; k < 3; ++k) {
      put(s, "HAL", fmt::format("genhexkins.platform.{}.{}", i, kAxes[k]), units::to_mm(end[k]));
    }
    put_joint(s, i, false, units::to_mm(m.leg_offset[leg]), units::to_mm(lengths[leg] + m.leg_offset[leg]),
              units::to_mm(m.length_min), units::to_mm(m.length_max));
  }
  s.notes.push_back(
      fmt::format("The controller's platform origin is the tip of the tool of {:.6g} mm; for another tool make the "
                  "settings anew (--set tool.length_mm=...), and leave the pin tool-offset at 0.",
                  units::to_mm(m.tool_length)));
  s.notes.emplace_back(
      "Joints are strut lengths between the joints' centres. HOME_OFFSET holds the strut's zero offset and is the "
      "length where the strut reads 0; for a switch at a reading q write this value + q.");
  return s;
}

}  // namespace polypod::control
