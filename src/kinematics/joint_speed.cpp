// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/joint_speed.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::kinematics {
namespace {

constexpr double kCloserFrom = 0.2;  // of a joint's limit, from which its speed is judged at closer poses
constexpr int kCloser = 10;          // pieces of the way then, at least
constexpr int kClosest = 200;
constexpr double kOfAPiece = 0.05;  // rad or m, about what a joint may change in one of them
constexpr int kMostHalvings = 20;
constexpr double kAtOnce = 1e4;  // times its limit: beside a singular pose, where the figure is that of the halving

/// Pieces of a way in which the joints change by so much.
int closer_pieces(const JointVector& change) {
  return std::clamp(static_cast<int>(std::ceil(change.cwiseAbs().maxCoeff() / kOfAPiece)), kCloser, kClosest);
}

FastestJoint between(const JointVector& from, const JointVector& to, double seconds,
                     const std::vector<double>& limits) {
  FastestJoint out;
  for (int i = 0; i < static_cast<int>(to.size()); ++i) {
    const double share = std::abs(to[i] - from[i]) / (seconds * limits[static_cast<std::size_t>(i)]);
    if (share > out.share) out = {i, share, true};
  }
  return out;
}

/// A way with the joints at its ends, as shares of the whole way.
struct Piece {
  double begin = 0, end = 1;
  JointVector from, to;
};

/// Halves a piece until no joint changes by more than kOfAPiece in one: near a singular pose all of a large change may
/// lie in a small part of it, whatever its speed is on the whole.
void look_closer(const SolutionsOnWay& way, const Piece& piece, double seconds, const std::vector<double>& limits,
                 int halvings, FastestJoint& out) {
  if (halvings == 0 || (piece.to - piece.from).cwiseAbs().maxCoeff() <= kOfAPiece) {
    const FastestJoint here = between(piece.from, piece.to, seconds * (piece.end - piece.begin), limits);
    if (here.share > out.share) out = {here.joint, here.share, out.judged};
    return;
  }
  const double middle = (piece.begin + piece.end) / 2;
  const InverseResult inverse = way(middle, piece.from);
  const Solution* best = inverse.reachable();
  if (best == nullptr) {
    out.judged = false;
    return;
  }
  const JointVector q = best->joints;
  look_closer(way, {piece.begin, middle, piece.from, q}, seconds, limits, halvings - 1, out);
  look_closer(way, {middle, piece.end, q, piece.to}, seconds, limits, halvings - 1, out);
}

/// The joints at the ends of `pieces` equal pieces of a way, after those of its start; empty where there are none.
std::vector<JointVector> joints_along(const SolutionsOnWay& way, const JointVector& from, const JointVector& to,
                                      int pieces) {
  std::vector<JointVector> out{from};
  for (int k = 1; k < pieces; ++k) {
    const InverseResult inverse = way(double(k) / pieces, out.back());
    const Solution* best = inverse.reachable();
    if (best == nullptr) return {};
    out.push_back(best->joints);
  }
  out.push_back(to);
  return out;
}

/// |q_x| + |q_y| + |q_z| of each joint, against the position of the tip in M, the orientation kept: the most that it
/// takes where each of the three goes by up to 1.
Eigen::VectorXd by_position(const AnyMachine& machine, const Pose& X_MT, const JointVector& q) {
  const machine::Task task = kinematics::task(machine);
  const Pose X = settled(machine, X_MT, q);
  const Eigen::MatrixXd inverse =
      task_jacobian(task, jacobian(machine, X, q), X).completeOrthogonalDecomposition().pseudoInverse();
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(q.size());
  for (int i = 0; i < task.size(); ++i)
    if (!task.is_angle(i)) sum += inverse.col(i).cwiseAbs();
  return sum;
}

/// From s_0 with the joints `from` to s_1.
std::optional<JointVector> follow(const JointVector& from, const SolutionsOnWay& way, double jump, double s_0,
                                  double s_1) {
  constexpr double kFinest = 1.0 / 256;
  const InverseResult inverse = way(s_1, from);
  const Solution* best = inverse.reachable();
  if (best == nullptr) return {};
  if ((best->joints - from).cwiseAbs().maxCoeff() <= jump) return best->joints;
  if (s_1 - s_0 <= kFinest) return {};
  const double middle = (s_0 + s_1) / 2;
  const auto half = follow(from, way, jump, s_0, middle);
  return half ? follow(*half, way, jump, middle, s_1) : half;
}

}  // namespace

SolutionsOnWay solutions_on(const AnyMachine& machine, const std::function<Pose(double)>& pose) {
  return [&machine, &pose](double s, const JointVector& near) { return inverse_near(machine, pose(s), near); };
}

std::optional<JointVector> followed(const JointVector& from, const SolutionsOnWay& way, double jump) {
  return follow(from, way, jump, 0, 1);
}

FastestJoint fastest_joint(const JointVector& from, const JointVector& to, double seconds,
                           const std::vector<double>& limits, const SolutionsOnWay& way) {
  FastestJoint out = between(from, to, seconds, limits);
  const bool turns_far = (to - from).cwiseAbs().maxCoeff() > kOfAPiece;
  if (out.share <= kCloserFrom && !turns_far) return out;
  const std::vector<JointVector> q = joints_along(way, from, to, kCloser);
  out.judged = !q.empty();
  for (std::size_t k = 1; k < q.size(); ++k) {
    const Piece piece{double(k - 1) / kCloser, double(k) / kCloser, q[k - 1], q[k]};
    look_closer(way, piece, seconds, limits, kMostHalvings, out);
  }
  return out;
}

HardestJoint hardest_joint(const AnyMachine& machine, const JointVector& from, const JointVector& to,
                           const Stretch& stretch, const std::vector<double>& limits) {
  constexpr double kShortestPiece = 1e-5;  // m, below which rounding shows in second differences
  const auto n = static_cast<std::size_t>(to.size());
  // Along the way a controller takes as much as its axes allow: more where the way lies between them.
  const Vec3 way = stretch.pose(1).p - stretch.pose(0).p;
  const double most_of_an_axis = way.norm() > 0 ? way.cwiseAbs().maxCoeff() / way.norm() : 1;
  const Eigen::VectorXd along = (to - from).cwiseAbs() / (stretch.length * most_of_an_axis);
  const Eigen::VectorXd by_tip = stretch.tip_acceleration * along.cwiseMax(by_position(machine, stretch.pose(1), to));
  const SolutionsOnWay on_way = solutions_on(machine, stretch.pose);
  const auto hardest = [&](int pieces) {
    HardestJoint out;
    const std::vector<JointVector> q = joints_along(on_way, from, to, pieces);
    out.judged = !q.empty();
    const double time = stretch.seconds / pieces;
    for (std::size_t i = 0; i < n; ++i) {
      const auto at = static_cast<int>(i);
      double bent = 0;
      for (std::size_t k = 1; k + 1 < q.size(); ++k)
        bent = std::max(bent, std::abs(q[k - 1][at] - 2 * q[k][at] + q[k + 1][at]) / (time * time));
      const double share = (bent + by_tip[at]) / limits[i];
      if (share > out.share) out = {at, share, bent / limits[i], out.judged};
    }
    return out;
  };
  const int most = std::clamp(static_cast<int>(stretch.length / kShortestPiece), 2, closer_pieces(to - from));
  const HardestJoint coarse = hardest(2);
  if (most == 2 || (coarse.share <= kCloserFrom && (to - from).cwiseAbs().maxCoeff() <= kOfAPiece)) return coarse;
  const HardestJoint fine = hardest(most);
  HardestJoint out = fine.share > coarse.share ? fine : coarse;
  out.judged = coarse.judged && fine.judged;
  return out;
}

std::string largest_change(const AnyMachine& machine, const JointVector& change) {
  int joint = 0;
  const double most = change.cwiseAbs().maxCoeff(&joint);
  return joint_kind(machine, joint) == JointKind::revolute ? fmt::format("{:.1f} deg", units::to_deg(most))
                                                           : fmt::format("{:.1f} mm", units::to_mm(most));
}

std::string broken_in_posture(const AnyMachine& machine, const InverseResult& inverse, const JointVector& from,
                              double jump) {
  if (inverse.solutions.empty()) return {};
  // Solutions hold each joint in the turn that its limits allow: here the one next to `from` counts.
  const auto next_to = [&](const Solution& s) {
    JointVector q = s.joints;
    constexpr double kTurn = 2 * std::numbers::pi;
    for (int i = 0; is_serial(machine) && i < static_cast<int>(q.size()); ++i) {
      if (joint_kind(machine, i) == JointKind::revolute) q[i] -= kTurn * std::round((q[i] - from[i]) / kTurn);
    }
    return q;
  };
  const Solution* near = nullptr;
  JointVector joints;
  for (const Solution& s : inverse.solutions) {
    const JointVector q = next_to(s);
    if (near != nullptr && (q - from).cwiseAbs().maxCoeff() >= (joints - from).cwiseAbs().maxCoeff()) continue;
    near = &s;
    joints = q;
  }
  if ((joints - from).cwiseAbs().maxCoeff() > jump) return {};
  std::vector<std::string> broken;
  for (int i = 0; i < static_cast<int>(joints.size()); ++i) {
    if (joints[i] == near->joints[i]) continue;
    const machine::JointRange range = joint_range(machine, i);
    if (joints[i] > range.max) broken.push_back(fmt::format("joint {} above its maximum", i + 1));
    if (joints[i] < range.min) broken.push_back(fmt::format("joint {} below its minimum", i + 1));
  }
  for (std::string& name : limit_names(machine, near->violations)) broken.push_back(std::move(name));
  return fmt::format("{}", fmt::join(broken, ", "));
}

std::string cannot_start(const AnyMachine& machine, const JointVector& joints) {
  for (int i = 0; i < static_cast<int>(joints.size()); ++i) {
    constexpr double kRounded = 1e-9;
    const machine::JointRange range = joint_range(machine, i);
    if (joints[i] >= range.min - kRounded && joints[i] <= range.max + kRounded) continue;
    const bool turns = joint_kind(machine, i) == machine::JointKind::revolute;
    const auto shown = [&](double value) { return turns ? units::to_deg(value) : units::to_mm(value); };
    return fmt::format("joint {} cannot start at {:.7g} {}: its limits are {:.7g} and {:.7g}", i + 1, shown(joints[i]),
                       turns ? "deg" : "mm", shown(range.min), shown(range.max));
  }
  return {};
}

std::string too_fast(const AnyMachine& machine, const FastestJoint& fastest, const std::vector<double>& limits) {
  const bool turns = joint_kind(machine, fastest.joint) == JointKind::revolute;
  const double limit = limits[static_cast<std::size_t>(fastest.joint)];
  const auto user = [&](double v) { return turns ? units::to_deg(v) : units::to_mm(v); };
  if (fastest.share > kAtOnce)
    return fmt::format("joint {} would have to {} at once", fastest.joint + 1, turns ? "turn" : "move");
  return fmt::format("joint {} would go at {:.1f} {} where its limit is {:.1f}", fastest.joint + 1,
                     user(fastest.share * limit), turns ? "deg/s" : "mm/s", user(limit));
}

std::string slower(double rate, const char* unit) {
  const double kept = std::floor(rate);
  return kept < 1 ? "no feed would keep it" : fmt::format("up to {:.0f} {} it would keep it", kept, unit);
}

std::string too_hard(const AnyMachine& machine, const HardestJoint& hardest, double tip_acceleration,
                     const std::vector<double>& limits) {
  const bool turns = joint_kind(machine, hardest.joint) == JointKind::revolute;
  const double limit = limits[static_cast<std::size_t>(hardest.joint)];
  const auto user = [&](double v) { return turns ? units::to_deg(v) : units::to_mm(v); };
  return fmt::format(
      "joint {} would accelerate with up to {:.0f} {} where its limit is {:.0f}, {:.0f} of them at the feed and the "
      "rest as the controller accelerates with {:.0f} mm/s2",
      hardest.joint + 1, user(hardest.share * limit), turns ? "deg/s2" : "mm/s2", user(limit),
      user(hardest.of_speed * limit), units::to_mm(tip_acceleration));
}

double speed_limit(const AnyMachine& machine, int joint) {
  const double said = std::visit(
      [joint]<class M>(const M& m) {
        if constexpr (requires { joint_speed_limit(m, joint); }) return joint_speed_limit(m, joint);
        return 0.0;
      },
      machine);
  return said > 0 ? said : std::numeric_limits<double>::infinity();
}

std::vector<double> speed_limits(const AnyMachine& machine) {
  std::vector<double> out;
  for (int i = 0; i < joint_count(machine); ++i) out.push_back(speed_limit(machine, i));
  if (std::none_of(out.begin(), out.end(), [](double limit) { return std::isfinite(limit); })) out.clear();
  return out;
}

}  // namespace polypod::kinematics
