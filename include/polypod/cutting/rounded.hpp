// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Forces of cutters with a corner radius: bull-nose and ball end mills, by slices along the axis.
#pragma once

#include <vector>

#include "polypod/cutting/force.hpp"

namespace polypod::cutting {

/// Half the width of the cutter at the height z (m, >= 0) above its tip: with the corner radius r,
///   R - r + sqrt(r^2 - (r - z)^2) below r, and R above. Of a flat cutter it is R everywhere.
double radius_at(const Cutter& cutter, double z);
/// Its inverse: how far above the tip the edge is at the distance `radius` (m, >= 0) from the axis, m; infinite beyond
/// R.
double edge_height(const Cutter& cutter, double radius);

/// A slice of the edges: where it is, how its edge lies, and the tooth angles at which it meets material.
struct EdgeSlice {
  double z = 0;      ///< m, of its middle above the tip
  double width = 0;  ///< m, length of the edge in an axial plane (chip width db = dz / sin kappa)
  double kappa = 0;  ///< rad, between the tool axis and the normal of the cutting surface: 0 at the tip of a ball, pi/2
                     ///< on the side
  double entry = 0;  ///< rad
  double exit = 0;   ///< rad; not above entry: the slice meets nothing
};

/// Slices of a straight cut: of the corner `corner_slices` of equal kappa, of the side discs of at most 0.025 D.
///
/// The material is a straight wall: it reaches from the cutter's side at full radius inwards by `ae` (m, 0 < ae <= D),
/// and from the tip up by `ap` (m). A slice of half width r meets it where r cos(phi) >= R - ae in up-milling, mirrored
/// in down-milling, and over the whole front in a slot. What earlier lines left of the material (the cusps between the
/// lines of a ball) is not in it.
std::vector<EdgeSlice> straight_slices(const Cutter& cutter, CutSide side, double ae, double ap,
                                       int corner_slices = 200);

/// The coefficients of a slice in the frame of a flat cutter. A length db of the edge, whose normal n = (sin kappa,
/// -cos kappa) in (outwards, up) and whose other direction a = (cos kappa, sin kappa), feels K_t = K_te + K_tc h
/// against its motion, K_r along -n and K_a along a, with
///   h = s_z sin(phi) sin(kappa)
/// (Y. Altintas, Manufacturing Automation, 2nd ed. 2012, 2.8 and 2.9; S. Engin, Y. Altintas, Int. J. Mach. Tools Manuf.
/// 41 (2001) 2195-2212). On the axes of (5.9) that is a flat edge with
///   K_r' = K_r sin kappa - K_a cos kappa,   K_a' = K_r cos kappa + K_a sin kappa,
/// and its chip parts times sin(kappa)^x. Departure: the edge parts act on the chip width db, not on the length of the
/// edge along the helix, as they do in (5.7): so a corner radius of 0 gives the flat cutter.
Material along_edge(const Material& material, double kappa);

/// Mean force per revolution on the tool, N, in the frame of the cut: the sum over the slices of the closed forms of
/// `mean_force`. The corner is summed by the midpoint rule in kappa: exact to 1e-5 with 200 slices, to 1e-3 where the
/// wall lies inside of the corner (a slice then enters with a square root). Cost: 50 ns a slice.
Vec3 mean_force(const Cutter& cutter, const Material& material, const std::vector<EdgeSlice>& slices,
                double feed_per_tooth);

/// As force_history of engagements; the helix lags by 2 tan(helix) z / D at all heights (constant lead).
ForceHistory force_history(const Cutter& cutter, const Material& material, const std::vector<EdgeSlice>& slices,
                           double feed_per_tooth, int steps = 360);

}  // namespace polypod::cutting
