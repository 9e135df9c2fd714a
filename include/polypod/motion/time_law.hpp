// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How a path is passed in time: given times, constant speed, and the least time within limits.
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/core/series.hpp"
#include "polypod/geometry/pose.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::motion {

/// s(t) of a path's parameter s: blocks, at whose ends the tool stands still or changes its direction, of polynomials.
class TimeLaw {
 public:
  /// c_0 + c_1 x + ... + c_5 x^5, x the time since the piece began. Where the third derivative is `bend` times the
  /// first (y = (dw/dt)^2 a polynomial of second degree of w), c_0 + c_1 sinh(k x) / k + 2 c_2 (cosh(k x) - 1) / k^2
  /// with k^2 = bend, which may be negative.
  struct Piece {
    double duration = 0;
    std::array<double, 6> c{};
    double bend = 0;
  };
  struct Block {
    double from = 0, size = 0;  ///< of s
    /// The polynomials give w in 0 .. 1 and s = from + size (10 w^3 - 15 w^4 + 6 w^5); else they give s - from.
    bool eased = false;
    std::vector<Piece> pieces;
    double duration = 0;                     ///< s, kept by `add` and `stretch`
    double rest_before = 0, rest_after = 0;  ///< s of `duration`, set by `rest`
    /// Stands still for so long at its start and at its end, s, beside all that it does.
    void rest(double before, double after);
    [[nodiscard]] double moving() const { return duration - rest_before - rest_after; }
  };

  void add(Block block);
  /// Another block in the place of this one.
  void replace(std::size_t block, Block by);
  /// All of a block by this factor slower, but where it stands still.
  void stretch(std::size_t block, double factor);

  [[nodiscard]] double duration() const { return begins_.empty() ? 0 : begins_.back(); }
  [[nodiscard]] std::size_t blocks() const { return blocks_.size(); }
  [[nodiscard]] const Block& block(std::size_t k) const { return blocks_[k]; }
  [[nodiscard]] double begin(std::size_t block) const { return block == 0 ? 0 : begins_[block - 1]; }
  /// s and its derivatives against time at t, cut to 0 .. duration(). Where two pieces meet, of the later one.
  [[nodiscard]] Series at(double t) const;
  /// The same in a block, at the time x since it began.
  [[nodiscard]] Series in_block(std::size_t block, double x) const;
  /// The first time at which s is reached.
  [[nodiscard]] double time_of(double s) const;

 private:
  std::vector<Block> blocks_;
  std::vector<double> begins_;               ///< the end of each block, s
  std::vector<std::vector<double>> pieces_;  ///< the end of each piece within its block
};

/// At the same constant rate: s goes by `size` in `duration`; or from rest to rest by a polynomial of fifth degree.
TimeLaw::Block uniform_block(double from, double size, double duration);
TimeLaw::Block smooth_block(double from, double size, double duration);

inline constexpr double kNoLimit = std::numeric_limits<double>::infinity();

/// Derivatives against s at one place of a path.
struct PlanNode {
  double s = 0;
  Vec3 tip_1 = Vec3::Zero(), tip_2 = Vec3::Zero(), tip_3 = Vec3::Zero();  ///< of the tool tip
  Vec3 turn = Vec3::Zero();                                               ///< of its orientation, rad, in M
  machine::JointVector drive_1, drive_2, drive_3;  ///< empty where the machine does not reach the place
  double speed = kNoLimit;                         ///< m/s, of the tip here
};

struct PlanLimits {
  double tool_speed = kNoLimit, tool_acceleration = kNoLimit, tool_jerk = kNoLimit;
  double turn_speed = kNoLimit;                                      ///< rad/s, of the tool's orientation
  machine::JointVector drive_speed, drive_acceleration, drive_jerk;  ///< one each a drive
  [[nodiscard]] bool limits_jerk() const;
};

/// The least time from rest to rest through nodes in rising order (two at one place where the curvature jumps) within
/// limits of speed and acceleration: with x = (ds/dt)^2 and the acceleration u = dx/ds / 2 constant between nodes, all
/// limits are convex in (x, u). Backwards the largest x at each node from which the end can be reached, forwards the
/// largest acceleration that stays below it (Pham and Pham 2018, TOPP-RA). Limits hold at both ends of each interval;
/// between nodes they may be exceeded by what the path changes there. Errors: MO115 (a limit is 0, or nothing limits
/// the speed). Cost: linear, 10 us a node.
Result<TimeLaw::Block> fastest(const std::vector<PlanNode>& nodes, const PlanLimits& limits);

/// The S profile of seven phases (constant jerk, constant acceleration, ...) over `size` from rest to rest, with speed,
/// acceleration and jerk up to these: the least time where the limits are those of s itself (double S velocity,
/// Biagiotti and Melchiorri 2008, 3.4). Limits may be infinite, but not that of the jerk.
TimeLaw::Block s_profile(double from, double size, double speed, double acceleration, double jerk);

/// The S profile that keeps all limits at all nodes of a block, where it takes no more than 1 + `gap` times the least
/// time that any law can take. With the largest |x'|, |x''|, |x'''| of each drive and of the tool at the nodes,
///   |x'| V <= v,  |x'| A + |x''| V^2 <= a,  |x'| J + 3 |x''| V A + |x'''| V^3 <= j
/// keep the limits, V and A the speed and acceleration that the profile reaches; and no law can have more than
///   V = v / |x'|,  A = (a + |x''| V^2) / |x'|,  J = (j + 3 |x''| V A + |x'''| V^3) / |x'|
/// with the least |x'|, of which the profile is the least time. None where these are farther apart: long ways, or a
/// drive that turns back. Cost: linear.
std::optional<TimeLaw::Block> nearly_fastest_s_profile(const std::vector<PlanNode>& nodes, const PlanLimits& limits,
                                                       double gap);

/// The same with limits of jerk, on a stretch of path without jumps of direction and curvature. In w of
/// s = size (10 w^3 - 15 w^4 + 6 w^5), so that the path itself is at rest at both ends, y = (dw/dt)^2 is a quadratic
/// B-spline; limits are asked at both ends of each of its intervals. Speeds and accelerations are convex in y, jerks
/// |a y + b y' + c y''| <= J / sqrt(y) are not. The time is minimised by an interior-point method whose Hessian leaves
/// out what is not convex in the jerks, so that each step stays within all limits: a local optimum.
/// `parts`: where the path consists of several stretches, their ends between `from` and from + size, in rising order;
/// the third derivative may jump there, and each part has 24 intervals at least. `node` gives the derivatives at s on
/// the part of this number. `count` intervals at least, in all; more where the places `dense` (rising) stand close to
/// each other, since the path changes fast there. Errors: MO115. Cost: some 70 Newton steps of 0.3 us an interval and
/// drive.
Result<TimeLaw::Block> fastest_within_jerk(const std::function<PlanNode(double s, std::size_t part)>& node, double from,
                                           double size, const std::vector<double>& parts, int count,
                                           const PlanLimits& limits, const std::vector<double>& dense = {});

}  // namespace polypod::motion
