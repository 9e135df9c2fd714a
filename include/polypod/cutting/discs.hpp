// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A cutter as discs on each other: one of a flat end mill, several of the corner of a bull nose and one of its side.
#pragma once

#include <cstddef>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include "polypod/cutting/end_force.hpp"
#include "polypod/cutting/rounded.hpp"
#include "polypod/cutting/stock.hpp"

namespace polypod::cutting {

/// A disc: what lies above its lower face within its radius is removed, and the edge at its rim is one of the corner's
/// (EdgeSlice::kappa) over its height.
struct EdgeDisc {
  double z = 0;                                             ///< m, of the lower face above the tip
  double height = std::numeric_limits<double>::infinity();  ///< m; the side has no end
  double radius = 0;                                        ///< m
  double inner = 0;                                         ///< m, the radius of the disc below, or of the flat end
  double kappa = std::numbers::pi / 2;                      ///< rad
};

/// From the tip on: kCornerDiscs of the corner, of equal kappa and as wide as the corner is at the middle of that, and
/// the side; of a flat cutter the side alone.
inline constexpr int kCornerDiscs = 8;
std::vector<EdgeDisc> discs_of(const Cutter& cutter);

/// Stock::cut_disc, cut_line and cut_step by all discs, the lowest first. What the corner leaves are steps, half of
/// each above it. Cost: that of the disc for each.
double cut_disc(Stock& stock, const Vec3& tip, std::span<const EdgeDisc> discs);
double cut_line(Stock& stock, const Vec3& a, const Vec3& b, std::span<const EdgeDisc> discs, bool a_done = false);
double cut_step(Stock& stock, const Vec3& a, const Vec3& b, std::span<const EdgeDisc> discs, bool a_done = false);

/// What each of the discs would take next, within its own height.
struct DiscsMet {
  std::vector<EngagementProfile> of;
  std::size_t highest = 0;  ///< the highest disc that meets anything
  double ahead = 0;         ///< m, over which it was looked at
  double max_depth = 0;     ///< m, of what is met above the tip
  bool any = false;

  void clear();
};

/// The other look_ahead, disc by disc.
void look_ahead(const Stock& stock, const Vec3& tip, std::span<const EdgeDisc> discs, const Eigen::Vector2d& feed,
                double ahead, DiscsMet& met);

/// The other look_down, under the flat end and those discs of the corner whose kappa is below `descent` (rad, the angle
/// of the way below the horizontal): there the corner cuts all round, as the end does; pi/2 for a plunge.
void look_down(const Stock& stock, const Vec3& tip, std::span<const EdgeDisc> discs, double descent,
               const Eigen::Vector2d& feed, double down, EndFootprint& footprint);

/// Mean force of the edges of all discs, N, in the frame of the cut: the sum over the discs and the strips of their
/// profiles of what along_edge says, with the chip
///   h = max(0, s_level sin(phi) sin(kappa) - s_rise cos(kappa)).
/// On a way down at the angle alpha the second part of the discs with kappa < alpha is that of the end (look_down,
/// EndForce), whose coefficients count there; of the others the rear half cuts, too, where h > 0, and what it meets is
/// taken to be as high as what the same strip meets in front. On a way up the disc above has already taken some of what
/// a disc meets, from where it stood before (taken_above); the smooth corner has not, and it counts. One disc gives
/// ProfileForce. Departure: a strip's chip is that at its middle where the way is not level. Cost: as ProfileForce for
/// each disc.
class DiscsForce {
 public:
  DiscsForce(const Cutter& cutter, const Material& material);
  [[nodiscard]] const std::vector<EdgeDisc>& discs() const { return discs_; }
  /// `level`, `rise`: m a tooth, along the level and upwards.
  [[nodiscard]] Vec3 mean_force(const DiscsMet& met, double level, double rise) const;

 private:
  [[nodiscard]] Vec3 of_sloped(std::size_t disc, const DiscsMet& met, double level, double rise) const;

  struct Strips {
    std::vector<Vec3> edge, cut;            ///< as of ProfileForce
    std::vector<Vec3> rear_edge, rear_cut;  ///< of the same strips behind the axis, for a chip of 1 m^x
  };
  std::vector<EdgeDisc> discs_;
  std::vector<ProfileForce> level_;
  std::vector<Strips> strips_;  ///< of the corner's discs
  double exponent_ = 1;
};

}  // namespace polypod::cutting
