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

/// Removes what the straight part of a ball end mill above its ball takes where the tool leans: a cylinder along `axis`
/// (a unit vector whose z is above 0) from the middle of the ball on, `length` long (m). Over the middle of a cell its
/// lower surface is the lower root z of |w|^2 - (w . axis)^2 = R^2, w from the middle of the ball, where
/// 0 <= w . axis <= length; the lowest of its places every half cell on the way counts. `a`, `b`: the lowest points of
/// the ball, m. Returns the removed volume, m^3. Nothing for an upright tool, whose ball takes all that is above it.
double cut_shaft(Stock& stock, const Vec3& a, const Vec3& b, const Vec3& axis, double radius, double length);

/// What a ball meets: which share of the edges that pass over each of kRings rings of equal kappa and kSectors tooth
/// angles cuts, and the length of the side above the ball. Tooth angles are those of the frame of the tool, which is
/// that of the stock unless the tool is turned: from +y (0) over +x (90 deg) all the way round.
struct BallEngagement {
  static constexpr int kRings = 32, kSectors = 64;
  std::array<std::array<float, kSectors>, kRings> share{};
  std::array<float, kSectors> side{};  ///< m
  double ring = 0;                     ///< rad, of kappa: a ring is as wide; together they reach to the stock's top
  double max_depth = 0;                ///< m, of what is met above the tip
  double side_reach = 0;               ///< m, along a tilted tool from the middle of the ball to what its side meets
  bool any = false;
};

/// Looks at what a ball with its tip at `tip` would take on the next `ahead` (m, > 0) along the unit vector
/// `direction`: of the layer between its surface here and there the share that is material, whose height is taken
/// between the middles of four cells. Nothing is removed; what was cut on the same way is not met again. Cost: 30 us.
void look_ahead(const Stock& stock, const Vec3& tip, double radius, const Vec3& direction, double ahead,
                BallEngagement& engagement);

/// The same with the tool turned by `R` (its z axis from the tip to the spindle, in the frame of the stock) about the
/// middle of the ball: `lowest` is the ball's lowest point, `direction` that of its middle. What a ball takes does not
/// depend on how it is turned (cut_ball with its lowest points), as long as its lowest point lies on it: R's z axis
/// points up. `side` is what the straight part of the tool above the ball cuts (cut_shaft).
/// Above the middle of the ball, where a stock of heights knows no more than that there is material, all of a ring cuts
/// that lies before it. Cost: 60 us.
void look_ahead(const Stock& stock, const Vec3& lowest, const Mat3& R, double radius, const Vec3& direction,
                double ahead, BallEngagement& engagement);

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
  /// The same two with the tool turned by `R`, as in look_ahead; without a side above the ball.
  [[nodiscard]] Vec3 mean_force(const BallEngagement& engagement, const Mat3& R, const Vec3& direction,
                                double feed_per_tooth) const {
    return R * mean_force(engagement, R.transpose() * direction, feed_per_tooth);
  }
  void contacts(const Stock& stock, const Vec3& lowest, const Mat3& R, double reach,
                std::vector<BallContact>& out) const;

 private:
  /// `R`: null for a tool that is not turned.
  void find_contacts(const Stock& stock, const Vec3& tip, const Mat3* R, double reach,
                     std::vector<BallContact>& out) const;

  Cutter cutter_;
  Material material_;
};

}  // namespace polypod::cutting
