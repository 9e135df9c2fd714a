// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A ball end mill and a stock of heights: what it removes, what it meets, and the force of that.
#pragma once

#include <array>
#include <vector>

#include "polypod/cutting/rounded.hpp"
#include "polypod/cutting/stock.hpp"

namespace polypod::cutting {

/// Whether the corner radius is half of the diameter (to 1e-9 of it).
bool is_ball(const Cutter& cutter);

/// Removes what a ball of `radius` with its tip on the straight way from a to b (m, in the frame of the stock) takes:
/// every cell whose middle it covers is lowered, all layers alike, to the lowest place of its surface over that middle.
/// Over a cell at s along and n across a way of slope m, with q^2 = R^2 - n^2, that is where the tip is at
/// t = s - m q / sqrt(1 + m^2), kept within the way. One long step and many short ones remove the same, and a way that
/// is run again removes nothing. Walls that are higher than R are known to half a cell. Returns the removed volume,
/// m^3. Cost: 10 ns a cell under the way.
double cut_ball(Stock& stock, const Vec3& a, const Vec3& b, double radius);

/// What a ball meets: which share of the edges that pass over each of kRings rings of equal kappa and kSectors tooth
/// angles cuts, and the length of the side above the ball. Tooth angles are those of the frame of the stock: from +y
/// (0) over +x (90 deg) all the way round.
struct BallEngagement {
  static constexpr int kRings = 32, kSectors = 64;
  std::array<std::array<float, kSectors>, kRings> share{};
  std::array<float, kSectors> side{};  ///< m
  double ring = 0;                     ///< rad, of kappa: a ring is as wide; together they reach to the stock's top
  double max_depth = 0;                ///< m, of what is met above the tip
  bool any = false;
};

/// Looks at what a ball with its tip at `tip` would take on the next `ahead` (m, > 0) along the unit vector
/// `direction`: of the layer between its surface here and there the share that is material, whose height is taken
/// between the middles of four cells. Nothing is removed; what was cut on the same way is not met again. Cost: 30 us.
void look_ahead(const Stock& stock, const Vec3& tip, double radius, const Vec3& direction, double ahead,
                BallEngagement& engagement);

/// A part of a ball's surface with material before it, and the mean force of what the teeth take there, which is
/// edge + chip * h, h being the chip (m) that the motion of the ball leaves them along n.
struct BallContact {
  Vec3 n = Vec3::Zero();                          ///< the normal of the surface, outwards
  double gap = 0;                                 ///< m, from the surface along n to the material
  double depth = 0;                               ///< m, of that material above the tip
  Vec3 edge = Vec3::Zero(), chip = Vec3::Zero();  ///< N and N/m, in the frame of the stock
};

/// Mean force of a ball over a revolution: the sum over the rings and sectors of what along_edge says, with the chip
///   h = s max(0, n . d),   n = (sin kappa sin phi, sin kappa cos phi, -cos kappa),
/// d being the direction of the feed in space and s the feed per tooth along it: on level ways s sin(phi) sin(kappa),
/// on ramps and plunges with what the ball takes below itself.
class BallForce {
 public:
  BallForce(const Cutter& cutter, const Material& material);
  /// N, in the frame of the stock. Zero where nothing is met.
  [[nodiscard]] Vec3 mean_force(const BallEngagement& engagement, const Vec3& direction, double feed_per_tooth) const;
  /// What a ball with its tip at `tip` has before it within `reach` (m, > 0) along the normals of its surface, whatever
  /// way it goes: 16 rings by 32 tooth angles, and the side above the ball. For an exponent other than 1 chips count in
  /// proportion to those of 20 um. Summed over what lies before a way it is mean_force, to the width of a ring.
  /// Cost: 20 us.
  void contacts(const Stock& stock, const Vec3& tip, double reach, std::vector<BallContact>& out) const;

 private:
  Cutter cutter_;
  Material material_;
};

}  // namespace polypod::cutting
