// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cutting forces from engagement: by discs and rotation angle (SLAV (5.3) to (5.11)), and their means in closed form.
#pragma once

#include <vector>

#include "polypod/cutting/cutter.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::cutting {

/// Frame of the cut: x along the feed, z along the tool axis (up, from the tip to the spindle), y = z cross x: the left
/// side of the feed. The tooth angle phi runs from +y over +x to -y (a clockwise spindle): phi = 0 is the left, pi/2
/// the front, pi the right side. Chip thickness h = s_z sin(phi) (5.3).

/// A span of tooth angles in which the cutter meets material, 0 <= entry < exit <= pi, from the tip up to `depth`.
struct Engagement {
  double entry = 0;  ///< phi_st, rad
  double exit = 0;   ///< phi_ex, rad
  double depth = 0;  ///< m, axial
};

enum class CutSide { up, down, slot };

/// How the spindle turns, seen from above (M3, M4). Everything here is for a clockwise spindle; with the other, left
/// and right change places: the engagement is mirrored, phi becomes pi - phi, and F_y changes its sign.
enum class Spindle { clockwise, counterclockwise };

/// Entry and exit of a straight cut of radial depth `ae` (m, 0 < ae <= D): up-milling 0 .. acos(1 - 2 ae / D),
/// down-milling pi - acos(1 - 2 ae / D) .. pi, slot 0 .. pi.
Engagement straight_engagement(const Cutter& cutter, CutSide side, double ae, double ap);

struct ForceHistory {
  std::vector<double> angle;  ///< rotation of the cutter, rad
  std::vector<Vec3> force;    ///< on the tool, N, in the frame of the cut
  Vec3 mean = Vec3::Zero();
  Vec3 peak = Vec3::Zero();  ///< largest |F| of each component over a revolution
};

/// Forces over one revolution by discs of thickness dz <= 0.025 D and `steps` angles (SLAV (5.4) to (5.10)).
/// Several engagements may hold at once (a step in the stock): their forces add. Cost: steps x discs x teeth.
ForceHistory force_history(const Cutter& cutter, const Material& material, const std::vector<Engagement>& engagements,
                           double feed_per_tooth, int steps = 360);

/// Mean force per revolution on the tool, N, in the frame of the cut:
///   F = N_z a / (2 pi) * integral over the engagement of [ -dFt cos - dFr sin ; dFt sin - dFr cos ; dFa ] dphi.
/// It does not depend on the helix. Closed form for exponent 1, Gauss-Legendre otherwise. Cost: about 50 ns.
Vec3 mean_force(const Cutter& cutter, const Material& material, const Engagement& engagement, double feed_per_tooth);

/// Mean forces of the coefficients 1, N, columns Ktc, Krc, Kac, Kte, Kre, Kae (units m^2, and m for the last three;
/// with another exponent m^(1 + exponent) for the first three), where the axis of the cutter runs `eccentricity` (m,
/// half of the total indicator reading) beside that of the spindle, `phase` (rad) from the first tooth on. Tooth j, at
/// the radius r_j = R + eccentricity cos(phase + j pitch), meets what the teeth before it left:
///   h_j = max(0, min over m = 1 .. N_z of m s_z sin(phi) + r_j - r_(j - m)),
/// and has an edge force only where it cuts (Kline and DeVor 1983). By 360 steps of the angle. Cost: 6 us and 1 us a
/// tooth.
Eigen::Matrix<double, 3, 6> unit_forces_with_runout(const Cutter& cutter, double exponent, const Engagement& engagement,
                                                    double feed_per_tooth, double eccentricity, double phase);

/// mean_force of a cutter that runs out: the unit forces times the coefficients. Cost: as they.
Vec3 mean_force_with_runout(const Cutter& cutter, const Material& material, const Engagement& engagement,
                            double feed_per_tooth, double eccentricity, double phase);

}  // namespace polypod::cutting
