// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Forces of the end of the cutter: plunges, and the downward part of ramps.
#pragma once

#include <array>

#include "polypod/cutting/cutter.hpp"
#include "polypod/cutting/force.hpp"
#include "polypod/cutting/stock.hpp"

namespace polypod::cutting {

/// Coefficients of the end where the material gives none: the tangential K_tc of the sides for the tangential force and
/// for the thrust along the axis, which is the order of magnitude of published coefficients of plunge milling; no
/// radial force, and no edge part, since end edges are ground hollow and a fine feed along the axis meets their corners
/// alone. An assumption, to be named wherever it is used. For an exponent other than 1 the slope at a chip of 0.05 mm
/// is taken.
EndCoefficients end_as_sides(const Material& material);

/// What stands below the end of the cutter: for each of kSectors tooth angles the length of end edge that would cut if
/// the cutter went down. Sector j is round the angle (j + 1/2) 2 pi / kSectors, counted in the frame of the cut as the
/// tooth angle phi: from +y (0) over +x (pi/2) all the way round.
struct EndFootprint {
  static constexpr int kSectors = 32;
  std::array<float, kSectors> length{};  ///< m, 0 .. R
  bool any = false;

  /// m: what a sector has on average, R over solid material. 2 pi times it is the integral of the length over phi.
  [[nodiscard]] double mean_length() const;
};

/// Looks at what the cutter would take if it went down by `down` (m, > 0): the share of the layer from tip.z - down to
/// tip.z that is material, along the rays of the sectors, in steps of at most one cell. Material above the tip's height
/// counts as one full layer. `feed` is the horizontal unit direction that makes x of the frame of the cut; for a plunge
/// any will do. Nothing is removed. Cells without material and places off the grid are empty, and so is what lies below
/// the bottom of the stock.
///
/// `down` is what the move goes down on the way that `look_ahead` looks at, at least 0.1 um (heights are in single
/// precision) and not beyond the end of the move. A tip above the material, a feed of length 0, a radius or `down` that
/// is not above 0 give an empty footprint. Cost: 32 R / cell looks into the stock, 2 to 4 us at R = 20 cells.
/// `inner`: of a ring, its inner radius (m).
void look_down(const Stock& stock, const Vec3& tip, double radius, const Eigen::Vector2d& feed, double down,
               EndFootprint& footprint, double inner = 0);

/// Mean force of the end edges over a revolution.
///
/// N_z straight edges run from the axis to the rim, square to the axis. A length dr of an edge at the tooth angle phi
/// feels tangentially, radially (outwards on the material) and axially
///   dF_t = (K_te + K_tc h) dr,  dF_r = (K_re + K_rc h) dr,  dF_a = (K_ae + K_ac h) dr,   h = axial feed per tooth:
/// the linear edge force model on a chip whose thickness is the axial feed per tooth and whose width is the engaged
/// length of the end edge, with the forces of sides and end added: C. Liu, G. Wang, M. S. Dargusch, "Mechanics and
/// Dynamics of Helical Milling Operations", Strojniski vestnik 60 (2014) 716-724, doi 10.5545/sv-jme.2013.1588 (side
/// and end edges on a helical ramp), and J. H. Ko, Y. Altintas, "Time domain model of plunge milling operation",
/// International Journal of Machine Tools and Manufacture 47 (2007) 1351-1361 (plunges), here for edges square to the
/// axis and with forces resolved as in (5.9). How to identify the coefficients from mean forces of plunges: Advances in
/// Mechanical Engineering 7 (2015), doi 10.1177/1687814015589547. With l(phi) from the footprint:
///   F = N_z / (2 pi) * integral over 0 .. 2 pi of l [ -K_t cos - K_r sin ; K_t sin - K_r cos ; K_a ] dphi,
///   K = K_e + K_c h.
/// A full plunge into solid material leaves the axial thrust alone, F_z = N_z R (K_ae + K_ac h); a half disc in front
/// of the axis also F_x = -N_z R K_r / pi and F_y = N_z R K_t / pi.
///
/// Departures: cutters that do not cut at the centre, corner radii, dish angles and the material that is pressed rather
/// than cut near the axis are not modelled; the coefficients are means over the whole edge. On a ramp of slope alpha
/// the feed f splits: the sides get f cos(alpha) / (n N_z) as their feed per tooth (mean_force, ProfileForce), the end
/// gets h = f sin(alpha) / (n N_z), and the forces add. The edge part K_e acts as soon as h > 0.
class EndForce {
 public:
  /// `coefficients` are those of the material (Material::end), which must be there.
  EndForce(const Cutter& cutter, const EndCoefficients& coefficients);
  /// Mean force on the tool, N, in the frame of the cut; zero for an axial feed per tooth (m) that is not above 0: the
  /// end does not cut on the way up or on the level. Cost: 64 multiply-adds.
  [[nodiscard]] Vec3 mean_force(const EndFootprint& footprint, double axial_feed_per_tooth,
                                Spindle spindle = Spindle::clockwise) const;

 private:
  std::array<Vec3, EndFootprint::kSectors> edge_, cut_;  // per sector and m of edge: N/m; and per m of axial feed
};

/// The steepest ramp, rad, on which the force of the end stays below `share` of that of the sides, in a slot of the
/// given depth (m) with the whole disc below it in material, at a feed per tooth along the path (m): what may be left
/// out where the material has no end coefficients. Then the end's are taken as the sides' tangential K_tc without an
/// edge part, the order of magnitude that published coefficients have; with them, they are used (and 0 is the answer
/// where their edge part alone is above the share).
double side_model_slope(const Cutter& cutter, const Material& material, double depth, double feed_per_tooth,
                        double share = 0.1);

}  // namespace polypod::cutting
