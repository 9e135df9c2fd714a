// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/beginning.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/free_joints.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/kinematics/posture.hpp"
#include "polypod/machine/task.hpp"

namespace polypod::kinematics {
namespace {

constexpr double kJump = 0.5;  // rad or m, that no joint changes by from pose to pose
constexpr int kMostPoses = 20000;

/// How far apart two sets of joints are: a turn of a joint is none.
double apart(const AnyMachine& machine, const JointVector& a, const JointVector& b) {
  double out = 0;
  for (int i = 0; i < static_cast<int>(a.size()); ++i) {
    const double change = a[i] - b[i];
    const bool turns = joint_kind(machine, i) == machine::JointKind::revolute;
    out = std::max(out, std::abs(turns ? std::remainder(change, 2 * std::numbers::pi) : change));
  }
  return out;
}

/// A pose on the way: of which piece, and at which step of it.
struct Step {
  std::size_t piece = 0;
  int step = 0;
};

class Ahead {
 public:
  Ahead(const AnyMachine& machine, const std::function<std::optional<WayPiece>()>& next, std::string posture)
      : machine_(machine), next_(next), posture_(std::move(posture)) {}

  std::optional<Beginning> run() {
    if (!add_piece()) return std::nullopt;
    const Pose first = pieces_.front().pose(0);
    const InverseResult inverse = kinematics::inverse(machine_, first);
    const Solution* best = reachable_in(machine_, inverse, posture_);
    if (best == nullptr) return std::nullopt;
    const JointVector by_itself = best->joints;
    const int open = freedoms_left(machine_, first, by_itself);
    if (open <= std::max(0, joint_count(machine_) - task(machine_).size())) return std::nullopt;
    const std::optional<Step> settles = first_with_less(by_itself, open);
    if (!settles) return std::nullopt;
    std::optional<Beginning> out;
    double nearest = 0;
    for (const Solution& s : kinematics::inverse(machine_, pose_at(*settles)).solutions) {
      std::string name = s.branch < kNumericBranch ? branch_name(machine_, s.branch) : std::string();
      if (s.violations != 0 || (!posture_.empty() && name != posture_)) continue;
      const std::optional<JointVector> back = back_to_start(*settles, s.joints);
      if (!back) continue;
      const double away = apart(machine_, *back, by_itself);
      constexpr double kAlike = 1e-6;  // then the first of the inverse
      if (out && away > nearest - kAlike) continue;
      nearest = away;
      out = Beginning{*back, std::move(name)};
    }
    return out;
  }

  /// The name of the posture that the way comes to from these joints.
  std::string posture_from(const JointVector& start) {
    if (!add_piece()) return {};
    const Pose first = pieces_.front().pose(0);
    const InverseResult inverse = inverse_near(machine_, first, start);
    const Solution* best = inverse.reachable();
    if (best == nullptr) return {};
    const int open = freedoms_left(machine_, first, best->joints);
    if (open <= std::max(0, joint_count(machine_) - task(machine_).size())) return {};
    JointVector q = best->joints;
    const std::optional<Step> settles = first_with_less(q, open, &q);
    return settles ? posture_of(machine_, q) : std::string();
  }

 private:
  bool add_piece() {
    std::optional<WayPiece> piece = next_();
    if (piece) pieces_.push_back(std::move(*piece));
    return piece.has_value();
  }

  [[nodiscard]] Pose pose_at(const Step& at) const {
    const WayPiece& piece = pieces_[at.piece];
    return piece.pose(static_cast<double>(at.step) / piece.steps);
  }

  /// The first pose that leaves less open than `open` joints; where it is out of reach the way ends.
  std::optional<Step> first_with_less(JointVector q, int open, JointVector* there = nullptr) {
    const bool head = is_head_on_linear_axes(machine_);  // what is open follows from the tool's direction
    Vec3 direction = pieces_.front().pose(0).R.col(2);
    int looked_at = 0;
    for (std::size_t i = 0; i < pieces_.size() || add_piece(); ++i) {
      for (int k = 1; k <= pieces_[i].steps; ++k) {
        if (++looked_at > kMostPoses) return std::nullopt;
        const Pose X = pose_at({i, k});
        if (head && X.R.col(2) == direction) continue;
        direction = X.R.col(2);
        const InverseResult inverse = inverse_near(machine_, X, q);
        const Solution* best = inverse.reachable();
        if (best == nullptr) return std::nullopt;
        q = best->joints;
        if (freedoms_left(machine_, X, q) >= open) continue;
        if (there != nullptr) *there = q;
        return Step{i, k};
      }
    }
    return std::nullopt;
  }

  /// From the joints at a pose back to the first one; nothing where a joint would jump or come to a limit.
  [[nodiscard]] std::optional<JointVector> back_to_start(const Step& from, JointVector q) const {
    constexpr int kHalvings = 24;  // the last pose that is not free is so near the free one
    const std::function<Pose(double)>& pose = pieces_[from.piece].pose;
    const double whole = 1.0 / pieces_[from.piece].steps, begins = (from.step - 1) * whole;
    const auto go = [&](const std::function<Pose(double)>& way) {
      std::optional<JointVector> reached = followed(machine_, q, way, kJump);
      if (reached) q = std::move(*reached);
      return reached.has_value();
    };
    double share = whole;
    for (int k = 0; k < kHalvings; ++k, share /= 2) {
      if (!go([&](double s) { return pose(begins + share * (1 - 0.5 * s)); })) return std::nullopt;
    }
    if (!go([&](double s) { return pose(begins + share * (1 - s)); })) return std::nullopt;
    for (std::size_t i = from.piece + 1; i-- > 0;) {
      const int steps = pieces_[i].steps;
      for (int k = i == from.piece ? from.step - 1 : steps; k > 0; --k) {
        if (!go([&](double s) { return pieces_[i].pose((k - s) / steps); })) return std::nullopt;
      }
    }
    return q;
  }

  const AnyMachine& machine_;
  const std::function<std::optional<WayPiece>()>& next_;
  const std::string posture_;
  std::vector<WayPiece> pieces_;
};

}  // namespace

std::optional<Beginning> look_ahead(const AnyMachine& machine, const std::function<std::optional<WayPiece>()>& next,
                                    const std::string& posture) {
  return Ahead(machine, next, posture).run();
}

std::string posture_behind(const AnyMachine& machine, const std::function<std::optional<WayPiece>()>& next,
                           const JointVector& start) {
  return Ahead(machine, next, {}).posture_from(start);
}

std::string in_words(const AnyMachine& machine, const Beginning& beginning) {
  const Pose X_MT = kinematics::forward(machine, beginning.joints).poses.front();
  std::vector<std::string> names;
  for (const int i : free_joints(machine, X_MT, beginning.joints)) {
    const bool turns = joint_kind(machine, i) == machine::JointKind::revolute;
    const double q = beginning.joints[i];
    const auto rounded = [](double x, double grains) { return std::round(x * grains) / grains + 0.0; };  // no -0
    names.push_back(turns ? fmt::format("joint {} at {:.1f} deg", i + 1, rounded(units::to_deg(q), 10))
                          : fmt::format("joint {} at {:.3f} mm", i + 1, rounded(units::to_mm(q), 1000)));
  }
  return fmt::format(
      "begins with {}, from where the program goes on: the first pose leaves that free; bring the "
      "machine there before it starts",
      fmt::join(names, ", "));
}

const Solution* first_solution(const AnyMachine& machine, const Pose& X_MT, const InverseResult& inverse,
                               const std::string& posture, bool has_start) {
  const Solution* named = reachable_in(machine, inverse, posture);
  const Solution* nearest = inverse.reachable();
  if (!has_start || named == nullptr || named == nearest) return named;
  constexpr double kSame = 1e-6;  // rad or m
  JointVector other = named->joints - nearest->joints;
  for (const int i : free_joints(machine, X_MT, nearest->joints)) other[i] = 0;
  return apart(machine, other, JointVector::Zero(other.size())) < kSame ? nearest : named;
}

}  // namespace polypod::kinematics
