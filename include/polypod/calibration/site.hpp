// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What stands round a machine while it is measured, and the way from one pose to the next.
#pragma once

#include <array>
#include <numbers>
#include <optional>
#include <vector>

#include "polypod/calibration/simulate.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::calibration {

/// A box in M, m.
struct Box {
  Vec3 low = Vec3::Zero(), high = Vec3::Zero();
};

/// All lengths in m, all places in M.
struct Site {
  std::vector<Box>
      keep_out;  ///< fences, fixtures, people: the machine stays out, and the instrument cannot see through
  std::optional<double> floor;     ///< z: nothing that moves comes below
  std::optional<Vec3> instrument;  ///< its eye
  /// The target is seen within this angle (rad) from its z axis.
  double acceptance = std::numbers::pi;
  double clearance = 0;  ///< that the lines of the machine keep from boxes, floor and line of sight

  [[nodiscard]] bool obstructs() const { return !keep_out.empty() || floor; }
  [[nodiscard]] bool any() const { return obstructs() || instrument; }
};
/// The box that holds the instrument, if one does: from there nothing is seen.
std::optional<std::size_t> box_round_instrument(const Site& site);

/// Why a pose cannot be measured, in the order in which it is looked at.
enum class Hindrance { none, floor, box, turned_away, hidden };
constexpr std::size_t kHindrances = 5;

/// The machine as the lines of its pictures (kinematics::outline_at). What stands still in all poses does not count for
/// floor and boxes, nor does what is within two clearances of a point that stands still, as the foot of a leg; what is
/// within two clearances of the target does not hide it, nor does the tool that carries it.
class SiteCheck {
 public:
  /// `stands`: some poses of the machine, which show what stands still. `X_TR`: the target in the tool's frame.
  SiteCheck(const AnyMachine& machine, const Site& site, const Pose& X_TR, const std::vector<Stand>& stands);

  /// Whether what never moves of the machine reaches into a box: that is not looked at, pose by pose, and mostly a box
  /// in another frame or unit.
  [[nodiscard]] bool foundation_in_a_box() const { return foundation_in_a_box_; }

  /// Cost: an outline and some hundred operations for each of its lines and boxes; 5 to 20 us.
  [[nodiscard]] Hindrance of(const Stand& stand) const;

  /// Whether the machine keeps clear of floor and boxes while all drives go from one pose to the other in the same
  /// time, looked at in steps of 2 % of the busiest drive's range: a sample. Nothing where a pose between is not found.
  [[nodiscard]] std::optional<bool> free_between(const Stand& from, const Stand& to) const;

 private:
  struct Line {
    Vec3 from, to;
    bool moves, tool;
  };
  [[nodiscard]] std::vector<Line> lines(const Stand& stand) const;
  [[nodiscard]] Hindrance of_body(const std::vector<Line>& lines) const;
  [[nodiscard]] bool hidden(const std::vector<Line>& lines, const Vec3& target) const;

  const AnyMachine* machine_;
  Site site_;
  Pose X_TR_;
  std::vector<std::vector<bool>> still_;  ///< of each part of the outline each point
  bool foundation_in_a_box_ = false;
};

/// What the busiest drive does between two poses, as a share of its range: the time, where all drives need the same for
/// their ranges.
double way_between(const AnyMachine& machine, const JointVector& from, const JointVector& to);

/// An order of the stands with a short way: from each of up to 16 of them to the nearest that is left, then turning
/// stretches round and moving single ones while that shortens the way (2-opt, Or-opt); the shortest of these. A local
/// optimum, the same for every run. Where `check` is given, moves that are not free count as twenty ranges more.
struct Way {
  std::vector<std::size_t> order;
  double length = 0;                    ///< sum of way_between
  std::vector<std::size_t> not_free;    ///< k: the move from order[k] to order[k + 1]
  std::vector<std::size_t> not_judged;  ///< the same where no pose between was found
};
Way shortest_way(const AnyMachine& machine, const std::vector<Stand>& stands, const SiteCheck* check);

}  // namespace polypod::calibration
