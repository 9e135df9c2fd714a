// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/machine_motion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/machine/assumed.hpp"

namespace polypod::motion {
namespace {

using kinematics::InverseResult;
using kinematics::LimitBits;
using kinematics::Solution;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// What the machine does at one place of the path.
struct State {
  bool reached = false;
  std::string reason;  ///< why not
  Pose X;
  JointVector q;
  unsigned branch = 0;
  LimitBits violations = 0;
  double condition = 0;
  double clearance = kNoLimit;  ///< m, of deltas
};

struct Node {
  std::size_t stretch = 0;
  double u = 0, s = 0;
  State state;
  bool dense = false;  ///< put in because a drive turns far within a step
};

/// m, of a delta its least distance from a singular pose.
std::optional<double> clearance_of(const AnyMachine& machine, const Vec3& X) {
  return std::visit(
      [&]<class M>(const M& m) -> std::optional<double> {
        if constexpr (requires { closeness(m, X); }) return closeness(m, X).least();
        return {};
      },
      machine);
}

class Follower {
 public:
  Follower(const AnyMachine& machine, const PosePath& path, const MoveOptions& options)
      : machine_(machine), path_(path), options_(options), joints_(kinematics::joint_count(machine)) {
    double s = 0;
    for (const Stretch& stretch : path.stretches) {
      begins_.push_back(s);
      s += stretch.size;
    }
    has_clearance_ = motion::has_clearance(machine);
    assumed_ = machine::limits_are_assumed(machine);
  }

  [[nodiscard]] const AnyMachine& machine() const { return machine_; }
  [[nodiscard]] int joints() const { return joints_; }
  [[nodiscard]] bool has_clearance() const { return has_clearance_; }
  [[nodiscard]] double begin(std::size_t stretch) const { return begins_[stretch]; }
  /// Whether a track was broken off because the progress said so.
  [[nodiscard]] bool cancelled() const { return cancelled_; }
  [[nodiscard]] std::size_t stretch_at(double s) const {
    const auto it = std::upper_bound(begins_.begin(), begins_.end(), s);
    return static_cast<std::size_t>(it - begins_.begin()) - 1;
  }

  /// With the joints that are the nearest to `near`, within their ranges or not, or any; limits and condition where
  /// they are asked for.
  [[nodiscard]] State state(std::size_t stretch, double u, const JointVector& near, bool judged = true) const {
    State out;
    const Pose target = path_.stretches[stretch].pose(u);
    out.X = target;
    std::optional<InverseResult> beside;
    if (near.size() > 0) beside = found_beside(target, near);
    InverseResult result = beside            ? std::move(*beside)
                           : near.size() > 0 ? kinematics::inverse_near(machine_, target, near)
                                             : kinematics::inverse(machine_, target);
    if (near.size() > 0 && !beside) nearest_first(result, near);
    if (result.solutions.empty()) {
      out.reason = result.reason;
      out.clearance = 0;
      return out;
    }
    const Solution* chosen = &result.solutions.front();
    if (near.size() == 0 && result.reachable() != nullptr) chosen = result.reachable();
    out.reached = true;
    out.q = chosen->joints;
    out.branch = chosen->branch;
    out.X = kinematics::settled(machine_, target, out.q);
    if (!judged) return out;
    if (!assumed_) out.violations = kinematics::violations(machine_, out.X, out.q);
    out.condition = kinematics::dexterity(machine_, out.X, out.q).condition;
    if (has_clearance_) out.clearance = clearance_of(machine_, out.X.p).value_or(0);
    return out;
  }

  /// Points of the whole path in rising order, from these joints at the first (none: any); stops at the first thing
  /// that is broken where `all` is not asked for. Where a drive turns far from one to the next, points stand between
  /// them, and at the poses that are the nearest to singular ones.
  [[nodiscard]] std::vector<Node> track(const JointVector& start, bool all) const {
    std::vector<Node> out = walk(start, all);
    thin_out(out);
    add_peaks(out);
    return out;
  }
  [[nodiscard]] int pieces_of(std::size_t stretch) const {
    const Stretch& s = path_.stretches[stretch];
    const double turned =
        s.turning == Turning::turn ? s.axis.norm() : (s.angles_to - s.angles_from).cwiseAbs().maxCoeff();
    return std::max({2, static_cast<int>(std::ceil(s.length / options_.step)),
                     static_cast<int>(std::ceil(turned / options_.turn_step))});
  }

  [[nodiscard]] bool singular(const State& s) const {
    if (has_clearance_) return options_.singular_distance > 0 && s.clearance < options_.singular_distance;
    return s.reached && options_.condition > 0 && !(s.condition <= options_.condition);
  }
  /// How near to singular a pose is, the larger the nearer.
  [[nodiscard]] double closeness_of(const State& s) const { return has_clearance_ ? -s.clearance : s.condition; }

  /// Of machines whose inverse is a search the solution beside `near`, where there is one that keeps its branch: within
  /// its limits or not, so that no search from elsewhere is needed.
  [[nodiscard]] std::optional<InverseResult> found_beside(const Pose& target, const JointVector& near) const {
    return std::visit(
        [&](const auto& m) -> std::optional<InverseResult> {
          if constexpr (requires { inverse_from(m, target, near); }) {
            if (has_closed_inverse(m)) return {};
            InverseResult found = inverse_from(m, target, near);
            for (Solution& s : found.solutions) s.joints = turned_to(s.joints, near);
            const auto best = std::min_element(
                found.solutions.begin(), found.solutions.end(),
                [&](const Solution& a, const Solution& b) { return moved(near, a.joints) < moved(near, b.joints); });
            if (best == found.solutions.end() || jumps(near, best->joints)) return {};
            found.solutions = {*best};
            return found;
          }
          return {};
        },
        machine_);
  }
  /// The same joints in the turns that are the nearest to `near`, whatever their ranges.
  [[nodiscard]] JointVector turned_to(JointVector q, const JointVector& near) const {
    constexpr double kTurn = 2 * std::numbers::pi;
    for (int i = 0; i < joints_; ++i) {
      if (kinematics::joint_kind(machine_, i) != machine::JointKind::revolute) continue;
      q[i] += kTurn * std::round((near[i] - q[i]) / kTurn);
    }
    return q;
  }
  static double moved(const JointVector& from, const JointVector& to) { return (to - from).cwiseAbs().maxCoeff(); }
  /// Ranges do not choose the solution on a way: a posture is kept until a joint meets its range, which is said then.
  void nearest_first(InverseResult& result, const JointVector& near) const {
    std::size_t best = 0;
    JointVector joints;
    double least = kNoLimit;
    for (std::size_t k = 0; k < result.solutions.size(); ++k) {
      JointVector turned = turned_to(result.solutions[k].joints, near);
      const double by = moved(near, turned);
      if (!(by < least)) continue;
      least = by;
      best = k;
      joints = std::move(turned);
    }
    if (!std::isfinite(least)) return;
    std::swap(result.solutions.front(), result.solutions[best]);
    result.solutions.front().joints = std::move(joints);
  }
  /// Whether a drive goes so far that it may have changed its branch.
  [[nodiscard]] bool jumps(const JointVector& from, const JointVector& to) const {
    constexpr double kTurn = 0.5, kShare = 0.1;  // rad; of the range
    for (int i = 0; i < joints_; ++i) {
      const double change = std::abs(to[i] - from[i]);
      if (kinematics::joint_kind(machine_, i) == machine::JointKind::revolute) {
        if (change > kTurn) return true;
        continue;
      }
      const machine::JointRange range = kinematics::joint_range(machine_, i);
      if (std::isfinite(range.max - range.min) && change > kShare * (range.max - range.min) &&
          change > 3 * options_.step) {
        return true;
      }
    }
    return false;
  }

 private:
  [[nodiscard]] std::vector<Node> walk(const JointVector& start, bool all) const {
    std::vector<Node> out;
    JointVector near = start;
    for (std::size_t k = 0; k < path_.stretches.size(); ++k) {
      const int pieces = pieces_of(k);
      const double size = path_.stretches[k].size;
      for (int i = 0; i <= pieces; ++i) {
        constexpr std::size_t kNowAndThen = 16;
        if (options_.progress && out.size() % kNowAndThen == 0 && !options_.progress(0.1 * begins_[k] / path_.size)) {
          cancelled_ = true;
          return out;
        }
        for (std::vector<double> ahead{size * i / pieces}; !ahead.empty();) {
          Node node{k, ahead.back(), 0, {}};
          node.s = begins_[k] + node.u;
          node.state = state(k, node.u, near);
          node.dense = ahead.size() > 1;
          constexpr double kLeast = 1e-9;  // of the stretch: what turns far over less jumps
          const bool far = i > 0 && !out.empty() && node.state.reached && out.back().state.reached &&
                           (node.state.branch != out.back().state.branch || goes_far(near, node.state.q));
          if (far && node.u - out.back().u > kLeast * size) {
            ahead.push_back(0.5 * (out.back().u + node.u));
            continue;
          }
          ahead.pop_back();
          const bool broken = !node.state.reached || node.state.violations != 0 || singular(node.state) ||
                              (near.size() > 0 && jumps(near, node.state.q));
          if (node.state.reached) near = node.state.q;
          out.push_back(std::move(node));
          if (broken && !all) return out;
        }
      }
    }
    return out;
  }
  /// So far that another solution may be the nearer one: two postures of a wrist are half a turn apart.
  [[nodiscard]] bool goes_far(const JointVector& from, const JointVector& to) const {
    constexpr double kFar = 0.25;  // rad
    for (int i = 0; i < joints_; ++i) {
      const bool turns = kinematics::joint_kind(machine_, i) == machine::JointKind::revolute;
      if (turns && std::abs(to[i] - from[i]) > kFar) return true;
    }
    return jumps(from, to);
  }

  /// What was put in only to find whether a branch really changes is not dense: no drive turns there.
  void thin_out(std::vector<Node>& track) const {
    constexpr double kTurns = 0.02;  // rad
    std::vector<bool> turning(track.size(), false);
    for (std::size_t i = 1; i < track.size(); ++i) {
      const Node &a = track[i - 1], &b = track[i];
      if (a.stretch != b.stretch || !a.state.reached || !b.state.reached) continue;
      if (moved(a.state.q, b.state.q) > kTurns) turning[i - 1] = turning[i] = true;
    }
    for (std::size_t i = 0; i < track.size(); ++i) track[i].dense = track[i].dense && turning[i];
  }

  /// Between points of which the middle one is the nearest to a singular pose stands a nearer one: it is added, where
  /// it matters.
  void add_peaks(std::vector<Node>& track) const {
    double nearest = -kNoLimit;
    for (const Node& n : track)
      if (n.state.reached) nearest = std::max(nearest, closeness_of(n.state));
    constexpr double kShare = 0.05, kTimes = 3;  // of the condition number, of the distance
    const double matters =
        std::min(nearest, has_clearance_ ? -kTimes * options_.singular_distance : kShare * options_.condition);
    std::vector<Node> peaks;
    for (std::size_t i = 0; i < track.size(); ++i) {
      const Node& b = track[i];
      // The neighbours on its stretch; at an end of it the point itself.
      const Node& a = i > 0 && track[i - 1].stretch == b.stretch ? track[i - 1] : b;
      const Node& c = i + 1 < track.size() && track[i + 1].stretch == b.stretch ? track[i + 1] : b;
      if (a.u == c.u || !a.state.reached || !b.state.reached || !c.state.reached) continue;
      const double here = closeness_of(b.state), before = closeness_of(a.state), after = closeness_of(c.state);
      if (!(here >= matters && here >= before && here >= after)) continue;
      if (here == before && here == after && a.u != b.u && b.u != c.u) continue;
      peaks.push_back(peak_between(a.u, c.u, b));
    }
    track.insert(track.end(), peaks.begin(), peaks.end());
    std::stable_sort(track.begin(), track.end(), [](const Node& a, const Node& b) { return a.s < b.s; });
  }
  /// By golden sections of [low, high], with the joints beside those of `beside`.
  [[nodiscard]] Node peak_between(double low, double high, const Node& beside) const {
    constexpr double kGolden = 0.6180339887498949;
    constexpr int kSections = 40;
    const auto at = [&](double u) {
      Node out{beside.stretch, u, begins_[beside.stretch] + u, {}};
      out.state = state(beside.stretch, u, beside.state.q);
      return out;
    };
    Node left = at(high - kGolden * (high - low)), right = at(low + kGolden * (high - low));
    Node best = beside;
    for (int k = 0; k < kSections && left.state.reached && right.state.reached; ++k) {
      for (const Node* n : {&left, &right})
        if (closeness_of(n->state) > closeness_of(best.state)) best = *n;
      if (closeness_of(left.state) > closeness_of(right.state)) {
        high = right.u;
        right = std::move(left);
        left = at(high - kGolden * (high - low));
      } else {
        low = left.u;
        left = std::move(right);
        right = at(low + kGolden * (high - low));
      }
    }
    return best;
  }

  const AnyMachine& machine_;
  const PosePath& path_;
  const MoveOptions& options_;
  int joints_;
  bool has_clearance_ = false;
  bool assumed_ = false;  ///< ranges of joints that nobody gave are not judged
  mutable bool cancelled_ = false;
  std::vector<double> begins_;
};

/// Finds what the track breaks, each thing once and where it begins.
class Judge {
 public:
  Judge(const Follower& follower, const PosePath& path, const MoveOptions& options)
      : follower_(follower), path_(path), options_(options) {}

  std::vector<MoveViolation> of(const std::vector<Node>& track) {
    std::vector<MoveViolation> out;
    const Node* last = nullptr;
    for (const Node& node : track) {
      const LimitBits fresh = bits(node.state) & ~seen_;
      for (LimitBits rest = fresh; rest != 0; rest &= rest - 1) {
        const LimitBits bit = rest & ~(rest - 1);
        Node bad = node;
        if (last != nullptr && last->stretch == node.stretch) {
          double good = last->u;
          constexpr int kHalvings = 20;
          for (int k = 0; k < kHalvings; ++k) {
            Node middle{node.stretch, 0.5 * (good + bad.u), 0, {}};
            middle.state = follower_.state(middle.stretch, middle.u, last->state.q);
            if ((bits(middle.state) & bit) != 0) {
              bad = std::move(middle);
            } else {
              good = middle.u;
            }
          }
          bad.s = follower_.begin(bad.stretch) + bad.u;
        }
        out.push_back(violation(std::countr_zero(bit), bad));
      }
      seen_ |= fresh;
      if (last != nullptr && last->state.reached && node.state.reached &&
          follower_.jumps(last->state.q, node.state.q) && really_jumps(*last, node)) {
        if (!jumped_) out.push_back(jump(*last, node));
        jumped_ = true;
      }
      last = &node;
    }
    return out;
  }

 private:
  static constexpr int kReach = 62, kSingular = 63;  // beside the limits' bits

  [[nodiscard]] LimitBits bits(const State& s) const {
    LimitBits out = s.reached ? s.violations : LimitBits{1} << kReach;
    if (follower_.singular(s)) out |= LimitBits{1} << kSingular;
    return out;
  }
  /// A drive that merely goes fast does so by less over a shorter way.
  [[nodiscard]] bool really_jumps(const Node& from, const Node& to) const {
    if (from.stretch != to.stretch) return true;
    JointVector a = from.state.q, b = to.state.q;
    double low = from.u, high = to.u;
    constexpr int kHalvings = 12;
    for (int k = 0; k < kHalvings; ++k) {
      const double middle = 0.5 * (low + high);
      const State s = follower_.state(from.stretch, middle, a);
      if (!s.reached) return true;
      const double first = (s.q - a).cwiseAbs().maxCoeff(), second = (b - s.q).cwiseAbs().maxCoeff();
      if (first > second) {
        high = middle;
        b = s.q;
      } else {
        low = middle;
        a = s.q;
      }
      if (!follower_.jumps(a, b)) return false;
    }
    return true;
  }
  [[nodiscard]] MoveViolation jump(const Node& from, const Node& to) const {
    MoveViolation out = base(to, "branch");
    int joint = 0;
    const double change = (to.state.q - from.state.q).cwiseAbs().maxCoeff(&joint);
    const bool turns = kinematics::joint_kind(follower_.machine(), joint) == machine::JointKind::revolute;
    out.limit = fmt::format("drive {} changes its branch", joint + 1);
    out.detail = fmt::format("drive {} would jump by {:.3g} {}", joint + 1,
                             turns ? units::to_deg(change) : units::to_mm(change), turns ? "deg" : "mm");
    return out;
  }
  [[nodiscard]] MoveViolation base(const Node& at, const char* kind) const {
    MoveViolation out;
    out.s = at.s;
    out.p = path_.stretches[at.stretch].pose(at.u).p;
    out.line = path_.stretches[at.stretch].line;
    out.kind = kind;
    return out;
  }
  [[nodiscard]] MoveViolation violation(int bit, const Node& at) const {
    MoveViolation out = base(at, bit == kReach ? "reach" : bit == kSingular ? "singular" : "limit");
    if (bit == kReach) {
      out.limit = at.state.reason.empty() ? "out of reach" : at.state.reason;
    } else if (bit == kSingular) {
      out.limit = "near-singular";
      out.detail = follower_.has_clearance()
                       ? fmt::format("nearer to a singular pose than {:g} mm: {:.1f} mm",
                                     units::to_mm(options_.singular_distance), units::to_mm(at.state.clearance))
                       : fmt::format("near-singular: the condition number is above {:g}", options_.condition);
    } else {
      out.limit = kinematics::limit_name(follower_.machine(), bit);
    }
    if (out.detail.empty()) out.detail = out.limit;
    return out;
  }

  const Follower& follower_;
  const PosePath& path_;
  const MoveOptions& options_;
  LimitBits seen_ = 0;
  bool jumped_ = false;
};

/// The same solution with one or more of these joints a turn on or back, as their ranges allow.
std::vector<JointVector> other_turns(const AnyMachine& machine, const JointVector& q, const std::set<int>& joints) {
  constexpr double kTurn = 2 * std::numbers::pi;
  constexpr std::size_t kMost = 32;
  std::vector<JointVector> out{q};
  for (const int i : joints) {
    if (kinematics::joint_kind(machine, i) != machine::JointKind::revolute) continue;
    const machine::JointRange range = kinematics::joint_range(machine, i);
    if (!std::isfinite(range.min) || !std::isfinite(range.max)) continue;  // it turns on as it likes
    const std::size_t before = out.size();
    for (double x = q[i] + kTurn * std::ceil((range.min - q[i]) / kTurn); x <= range.max; x += kTurn) {
      if (std::abs(x - q[i]) < 0.5 * kTurn) continue;
      for (std::size_t k = 0; k < before && out.size() < kMost; ++k) {
        out.push_back(out[k]);
        out.back()[i] = x;
      }
    }
  }
  out.erase(out.begin());
  return out;
}

/// Chooses the solution of the first pose with which the path can be passed.
class StartChooser {
 public:
  StartChooser(const Follower& follower, const PosePath& path, const MoveOptions& options, MoveResult& out)
      : follower_(follower), path_(path), options_(options), out_(out) {}

  /// Its joints; none where the first pose is out of reach.
  JointVector choose() {
    const Pose at_start = path_.stretches.front().pose(0);
    const InverseResult first = options_.before.size() > 0
                                    ? kinematics::inverse_near(follower_.machine(), at_start, options_.before)
                                    : kinematics::inverse(follower_.machine(), at_start);
    const std::size_t known = first.solutions.size();
    for (const Solution& s : first.solutions) {
      add(s.joints, kinematics::branch_name(follower_.machine(), s.branch));
      if (follower_.cancelled()) return {};
    }
    if (known == 0) return {};
    std::size_t chosen = best(0, known);
    if (options_.start && *options_.start < known) chosen = *options_.start;
    // Where none passes, joints that leave their range may begin in another turn of it.
    const std::size_t from = options_.start ? chosen : 0, to = options_.start ? chosen + 1 : known;
    for (std::size_t k = from; k < to && !out_.starts[chosen].completes; ++k) {
      if (turn(k, first.solutions[k].joints)) chosen = out_.starts.size() - 1;
      if (follower_.cancelled()) return {};
    }
    out_.starts[chosen].chosen = true;
    out_.branch = out_.starts[chosen].branch;
    return joints_[chosen];
  }

 private:
  /// Whether the path passes from the start k with joints in other turns, which is then the last of the starts: those
  /// that leave their range, and those that do when these are turned.
  bool turn(std::size_t k, const JointVector& q) {
    std::set<int> joints = beyond_[k];
    for (std::size_t before = 0; joints.size() > before;) {
      before = joints.size();
      std::set<int> more;
      for (const JointVector& turned : other_turns(follower_.machine(), q, joints)) {
        add(turned, fmt::format("{}, {}", out_.starts[k].branch, turned_in_words(q, turned)));
        if (follower_.cancelled()) return false;
        if (out_.starts.back().completes) return true;
        more.merge(beyond_.back());
        out_.starts.pop_back();
        joints_.pop_back();
        beyond_.pop_back();
      }
      joints.merge(more);
    }
    return false;
  }
  void add(const JointVector& q, std::string branch) {
    MoveStart start;
    start.branch = std::move(branch);
    const std::vector<Node> track = follower_.track(q, false);
    if (follower_.cancelled() || track.empty()) return;
    const std::vector<MoveViolation> broken = Judge(follower_, path_, options_).of(track);
    start.completes = broken.empty();
    start.reaches = start.completes ? 1 : track.back().s / path_.size;
    start.stretch = track.back().stretch;
    if (!broken.empty()) start.stopped_by = broken.front().limit;
    for (const Node& node : track) start.condition = std::max(start.condition, node.state.condition);
    out_.starts.push_back(std::move(start));
    joints_.push_back(q);
    std::set<int> beyond;  // where the track ends
    for (int i = 0; i < q.size() && track.back().state.reached; ++i) {
      const machine::JointRange range = kinematics::joint_range(follower_.machine(), i);
      const double there = track.back().state.q[i];
      if (there < range.min || there > range.max) beyond.insert(i);
    }
    beyond_.push_back(std::move(beyond));
  }
  [[nodiscard]] std::size_t best(std::size_t from, std::size_t to) const {
    std::size_t out = from;
    for (std::size_t k = from + 1; k < to; ++k) {
      const MoveStart &a = out_.starts[k], &b = out_.starts[out];
      const bool better = a.completes != b.completes ? a.completes
                          : a.completes              ? options_.best_start && a.condition < b.condition
                                                     : a.reaches > b.reaches + 1e-12;
      if (better) out = k;
    }
    return out;
  }
  /// "joint 6 begins at -180 deg".
  static std::string turned_in_words(const JointVector& from, const JointVector& to) {
    std::string out;
    for (Eigen::Index i = 0; i < to.size(); ++i) {
      if (to[i] == from[i]) continue;
      out += fmt::format("{}joint {} begins at {:.4g} deg", out.empty() ? "" : ", ", i + 1, units::to_deg(to[i]));
    }
    return out;
  }

  const Follower& follower_;
  const PosePath& path_;
  const MoveOptions& options_;
  MoveResult& out_;
  std::vector<JointVector> joints_;    ///< of each start
  std::vector<std::set<int>> beyond_;  ///< joints that leave their range
};

/// Largest absolute values.
struct Peaks3 {
  double speed = 0, acceleration = 0, jerk = 0;
  void raise(double v, double a, double j) {
    speed = std::max(speed, std::abs(v));
    acceleration = std::max(acceleration, std::abs(a));
    jerk = std::max(jerk, std::abs(j));
  }
  void slower(double by) {
    speed /= by;
    acceleration /= by * by;
    jerk /= by * by * by;
  }
  void raise(const Peaks3& other) { raise(other.speed, other.acceleration, other.jerk); }
};

/// Of each order the limit that is met the nearest.
struct Nearest {
  double ratio = 0;
  int who = -2;  ///< a drive, -1 the tool, -3 the speed of the program, -4 the orientation of the tool
  void take(double value, double limit, int by) {
    const double r = std::abs(value) / limit;
    if (std::isfinite(limit) && r > ratio) *this = {r, by};
  }
};

class Mover {
 public:
  Mover(const AnyMachine& machine, const PosePath& path, const MoveOptions& options)
      : path_(path), options_(options), limits_(options.limits), follower_(machine, path, options) {
    for (machine::JointVector* v : {&limits_.drive_speed, &limits_.drive_acceleration, &limits_.drive_jerk})
      if (v->size() == 0) *v = machine::JointVector::Constant(follower_.joints(), kNoLimit);
  }

  Result<MoveResult> run() {
    MoveResult out;
    out.length = path_.length;
    const JointVector start = StartChooser(follower_, path_, options_, out).choose();
    if (!follower_.cancelled()) track_ = follower_.track(start, true);
    if (follower_.cancelled()) return fail("MO199", "cancelled");
    POLYPOD_TRY(go_on(0.1));
    out.violations = Judge(follower_, path_, options_).of(track_);
    const bool reached = std::any_of(track_.begin(), track_.end(), [](const Node& n) { return n.state.reached; });
    if (!reached) {
      return fail("MO116", fmt::format("no point of the path is within reach: {}", track_.front().state.reason), {},
                  "move the path into the workspace; `polypod ik` says what a pose breaks");
    }
    summarise_track(out);
    const bool everywhere = std::all_of(track_.begin(), track_.end(), [](const Node& n) { return n.state.reached; });
    if (options_.law == Law::fastest && !everywhere) {
      out.time = kNan;
      for (MoveViolation& v : out.violations) {
        v.t = kNan;
        v.length = length_at(v.s);
      }
      out.notes.emplace_back("the path is not planned, because a part of it is out of reach");
      return out;
    }
    POLYPOD_TRY(make_law(out));
    judge_jumps(out);
    if (options_.law == Law::fastest && !limits_.limits_jerk()) {
      out.notes.emplace_back("accelerations jump, because no jerk is limited: jerks are those between the jumps");
    }
    const bool waits = path_.stretches.front().wait_before > 0 && path_.stretches.back().wait > 0;
    const bool spline = options_.law == Law::timed && options_.profile == Profile::spline;  // at rest at its ends
    out.moves_at_once = options_.law != Law::fastest && !comes_to_rest() && !spline && !waits;
    for (MoveViolation& v : out.violations) v.t = v.s > 0 ? law_.time_of(v.s) : 0;
    POLYPOD_TRY(check(out));
    out.time = law_.duration();
    sample(out);
    frequencies(out);
    if (options_.actuators && everywhere) {
      POLYPOD_ASSIGN(contour, commanded(*options_.actuators));
      out.contour = contour;
    }
    std::stable_sort(out.violations.begin(), out.violations.end(),
                     [](const MoveViolation& a, const MoveViolation& b) { return a.s < b.s; });
    for (MoveViolation& v : out.violations) v.length = length_at(v.s);
    return out;
  }

 private:
  [[nodiscard]] double length_at(double s) const {
    double length = 0;
    for (const Stretch& stretch : path_.stretches) {
      if (s <= stretch.size) return length + stretch.length * s / stretch.size;
      s -= stretch.size;
      length += stretch.length;
    }
    return length;
  }
  Status go_on(double share) const {
    if (options_.progress && !options_.progress(share)) return fail("MO199", "cancelled");
    return {};
  }

  void summarise_track(MoveResult& out) const {
    out.drives.resize(static_cast<std::size_t>(follower_.joints()));
    double clearance = kNoLimit;
    bool first = true;
    for (const Node& node : track_) {
      clearance = std::min(clearance, node.state.clearance);
      out.worst_condition = std::max(out.worst_condition, node.state.condition);
      if (!node.state.reached) continue;
      for (int i = 0; i < follower_.joints(); ++i) {
        MoveDrive& d = out.drives[static_cast<std::size_t>(i)];
        const double q = node.state.q[i];
        d.turns = kinematics::joint_kind(follower_.machine(), i) == machine::JointKind::revolute;
        if (first) d.first = q;
        d.last = q;
        d.low = std::min(d.low, q);
        d.high = std::max(d.high, q);
      }
      first = false;
    }
    if (follower_.has_clearance()) out.clearance = clearance;
  }

  /// Joints of the track at a place, between those of its points.
  [[nodiscard]] JointVector near(std::size_t stretch, double u) const {
    const double s = follower_.begin(stretch) + u;
    auto it = std::upper_bound(track_.begin(), track_.end(), s, [](double x, const Node& n) { return x < n.s; });
    if (it != track_.begin() && it != track_.end()) {
      const Node &a = *(it - 1), &b = *it;
      if (a.stretch == b.stretch && a.state.reached && b.state.reached && !follower_.jumps(a.state.q, b.state.q))
        return a.state.q + (s - a.s) / (b.s - a.s) * (b.state.q - a.state.q);
    }
    while (it != track_.begin()) {
      --it;
      if (it->state.reached) return it->state.q;
    }
    for (const Node& n : track_)
      if (n.state.reached) return n.state.q;
    return {};
  }

  [[nodiscard]] PlanNode plan_node(std::size_t stretch, double u) const {
    PlanNode out;
    const Stretch& s = path_.stretches[stretch];
    out.s = follower_.begin(stretch) + u;
    if (s.speed > 0) out.speed = s.speed;
    const PoseSeries target = s.at(Series(u, 1, 0, 0));
    PoseSeries X = target;
    const State state = follower_.state(stretch, u, near(stretch, u), false);
    if (state.reached) {
      const JointSeries joints = joint_series(follower_.machine(), target, state.X, state.q);
      if (joints.regular) {
        X = joints.X;
        out.drive_1 = joints.first;
        out.drive_2 = joints.second;
        out.drive_3 = joints.third;
      }
    }
    for (int k = 0; k < 3; ++k) {
      out.tip_1[k] = X.p[k].derivative(1);
      out.tip_2[k] = X.p[k].derivative(2);
      out.tip_3[k] = X.p[k].derivative(3);
    }
    out.turn = rate_of_turning(X);
    return out;
  }
  /// The axis of dR/dt R^T, rad a unit of the series' parameter, in M.
  static Vec3 rate_of_turning(const PoseSeries& X) {
    Mat3 R, dR;
    for (int i = 0; i < 3; ++i) {
      for (int k = 0; k < 3; ++k) {
        R(i, k) = X.R(i, k).value();
        dR(i, k) = X.R(i, k).derivative(1);
      }
    }
    const Mat3 W = dR * R.transpose();
    return 0.5 * Vec3(W(2, 1) - W(1, 2), W(0, 2) - W(2, 0), W(1, 0) - W(0, 1));
  }

  Status make_law(MoveResult& out) {
    const std::vector<Stretch>& stretches = path_.stretches;
    if (options_.law == Law::fastest) return plan(out);
    const bool needed =
        std::any_of(stretches.begin(), stretches.end(), [](const Stretch& s) { return !(s.speed > 0); });
    if (options_.law == Law::constant && needed && (!(options_.speed > 0) || !std::isfinite(options_.speed))) {
      return fail("MO101",
                  options_.speed == 0
                      ? std::string("no speed is given")
                      : fmt::format("a speed of {:g} mm/s must be above 0", units::to_mm(options_.speed)),
                  {}, "give the speed of the tool, times of the points, or plan with --time-optimal");
    }
    for (std::size_t k = 0; k < stretches.size(); ++k) {
      const Stretch& s = stretches[k];
      TimeLaw::Block block;
      if (options_.law == Law::timed) {
        block = options_.profile == Profile::smooth ? smooth_block(follower_.begin(k), s.size, s.duration)
                                                    : uniform_block(follower_.begin(k), s.size, s.duration);
      } else {
        if (!(s.length > 0)) {
          return fail("MO114",
                      "the path turns the tool on the spot, which takes no time at a constant speed of its tip", {},
                      "give time_s to every stretch, or plan with --time-optimal");
        }
        const double speed = s.speed > 0 ? s.speed : options_.speed;
        block = s.curve == Stretch::Curve::blend ? constant_speed(k, speed)
                                                 : uniform_block(follower_.begin(k), s.size, s.length / speed);
      }
      block.rest(k == 0 ? s.wait_before : 0, s.wait);
      law_.add(std::move(block));
      if (k + 1 == stretches.size() || comes_to_rest() || s.wait > 0) continue;
      const Junction j = path_.junction(k);
      if (j.tangent) continue;
      MoveViolation v;
      v.s = follower_.begin(k) + s.size;
      v.p = s.to;
      v.line = stretches[k + 1].line;
      v.kind = "corner";
      v.limit = "corner";
      constexpr double kCorner = 1e-3;
      v.detail = j.corner > kCorner
                     ? fmt::format("a corner of {:.1f} deg: the tool would have to stop", units::to_deg(j.corner))
                     : "the rate of turning jumps: the tool would have to stop";
      v.limit = v.detail;
      out.violations.push_back(v);
    }
    return {};
  }

  /// Along a polynomial, whose parameter is no length: polynomials of fifth degree of the time that have the speed and
  /// no acceleration along the path at their ends, so near to each other that the speed between them is the same to
  /// 1e-6.
  [[nodiscard]] TimeLaw::Block constant_speed(std::size_t stretch, double speed) const {
    constexpr int kPieces = 64;
    const Stretch& s = path_.stretches[stretch];
    struct Rates {
      double way = 0, first = 0, second = 0;  ///< |p'|, and u' and u'' by the time
    };
    const auto at = [&](double u) {
      const PoseSeries X = s.at(Series(u, 1, 0, 0));
      Vec3 p1, p2;
      for (int i = 0; i < 3; ++i) {
        p1[i] = X.p[i].derivative(1);
        p2[i] = X.p[i].derivative(2);
      }
      const double way = p1.norm();
      return Rates{way, speed / way, -speed * speed * p1.dot(p2) / square(square(way))};
    };
    TimeLaw::Block out{follower_.begin(stretch), s.size, false, {}, 0};
    Rates from = at(0);
    for (int k = 0; k < kPieces; ++k) {
      const double u = s.size * k / kPieces, d = s.size / kPieces;
      const Rates middle = at(u + 0.5 * d), to = at(u + d);
      const double h = d / 6 * (from.way + 4 * middle.way + to.way) / speed;
      const double a0 = from.second, a1 = to.second, v0 = from.first, v1 = to.first;
      out.pieces.push_back({h,
                            {u, v0, 0.5 * a0, ((10 * d / h - 6 * v0 - 4 * v1) / h - 1.5 * a0 + 0.5 * a1) / h,
                             ((-15 * d / h + 8 * v0 + 7 * v1) / h + 1.5 * a0 - a1) / (h * h),
                             ((6 * d / h - 3 * v0 - 3 * v1) / h - 0.5 * (a0 - a1)) / (h * h * h)}});
      from = to;
    }
    return out;
  }

  /// In given times with a profile that is at rest at each point.
  [[nodiscard]] bool comes_to_rest() const { return options_.law == Law::timed && options_.profile == Profile::smooth; }

  /// Where two stretches that go on in one direction meet, their rates may differ (and where a line meets an arc, their
  /// accelerations): no instant within a stretch shows it. Breaks every limit of acceleration (jerk) of what jumps.
  void judge_jumps(MoveResult& out) const {
    if (options_.law == Law::fastest || comes_to_rest()) return;
    std::set<std::string> seen;
    RateJumps& jumps = out.jumps;
    const auto count = [&](std::size_t next, const MoveSample& a, const MoveSample& b) {
      if (!a.reached || !b.reached) return;
      const double speed = differs(a.v, b.v), turn = differs(a.turn, b.turn);
      if (speed > 0 || turn > 0) ++jumps.count;
      jumps.speed = std::max(jumps.speed, speed);
      jumps.turn = std::max(jumps.turn, turn);
      const auto report = [&](int who, int order, double by) {
        const std::string name = name_of({0, who}, order);
        if (!seen.insert(name + " jump").second) return;
        const bool turns = who >= 0 && out.drives[static_cast<std::size_t>(who)].turns;
        MoveViolation v;
        v.s = b.s;
        v.p = b.X.p;
        v.line = path_.stretches[next].line;
        v.kind = who < 0 ? "tool" : "drive";
        v.limit = name;
        v.detail =
            fmt::format("the {} of {} jumps by {:.4g} {}/{}: no {} allows it", order == 1 ? "speed" : "acceleration",
                        who < 0 ? std::string("the tool") : fmt::format("drive {}", who + 1),
                        turns ? units::to_deg(by) : units::to_mm(by), turns ? "deg" : "mm", order == 1 ? "s" : "s2",
                        order == 1 ? "acceleration" : "jerk");
        out.violations.push_back(v);
      };
      const auto limited = [](double limit) { return std::isfinite(limit); };
      if (speed > 0 && limited(limits_.tool_acceleration)) report(-1, 1, speed);
      const double bend = differs(a.a, b.a);
      if (bend > 0 && limited(limits_.tool_jerk)) report(-1, 2, bend);
      if (!a.regular || !b.regular) return;
      for (int i = 0; i < follower_.joints(); ++i) {
        const double rate = differs_in(a.speed, b.speed, i), rate_2 = differs_in(a.acceleration, b.acceleration, i);
        if (rate > 0 && limited(limits_.drive_acceleration[i])) report(i, 1, rate);
        if (rate_2 > 0 && limited(limits_.drive_jerk[i])) report(i, 2, rate_2);
      }
    };
    for (std::size_t k = 0; k < law_.blocks(); ++k) {
      const TimeLaw::Block& block = law_.block(k);
      const Stretch& stretch = path_.stretches[k];
      constexpr double kJust = 1e-9;  // of the block, beside a wait
      const double just = kJust * block.duration, waits = k == 0 ? stretch.wait_before : 0;
      if (waits > 0) count(k, sample_at(k, 0), sample_at(k, waits + just));
      if (stretch.wait > 0) {
        count(k, sample_at(k, block.duration - stretch.wait - just), sample_at(k, block.duration));
        if (k + 1 < law_.blocks()) count(k + 1, sample_at(k, block.duration), sample_at(k + 1, 0));
      } else if (k + 1 < law_.blocks() && path_.junction(k).tangent) {  // a corner is a violation already
        count(k + 1, sample_at(k, block.duration), sample_at(k + 1, 0));
      }
    }
  }
  static constexpr double kSameRate = 1e-3;  ///< of the larger, as Junction's corners
  /// By how much, 0 where that is rounding (of times in a file, as of directions in corners).
  static double differs(const Vec3& a, const Vec3& b) {
    const double by = (a - b).norm();
    return by > kSameRate * std::max(a.norm(), b.norm()) + 1e-12 ? by : 0;
  }
  static double differs_in(const JointVector& a, const JointVector& b, int i) {
    const double by = std::abs(a[i] - b[i]);
    return by > kSameRate * std::max(a.cwiseAbs().maxCoeff(), b.cwiseAbs().maxCoeff()) + 1e-12 ? by : 0;
  }

  Status plan(MoveResult& out) {
    const std::vector<Stretch>& stretches = path_.stretches;
    const bool jerk = limits_.limits_jerk();
    std::size_t first = 0;
    for (std::size_t k = 0; k < stretches.size(); ++k) {
      bool stops = k + 1 == stretches.size() || stretches[k].stop || stretches[k].wait > 0;
      if (!stops) {
        const Junction j = path_.junction(k);
        stops = !j.tangent || (jerk && !j.smooth);
      }
      if (!stops) continue;
      planned_.emplace_back(first, k);
      POLYPOD_ASSIGN(block, planned(planned_.size() - 1, 1));
      law_.add(std::move(block));
      if (k + 1 < stretches.size()) ++out.stops;
      first = k + 1;
      POLYPOD_TRY(go_on(0.1 + 0.5 * static_cast<double>(k) / static_cast<double>(stretches.size())));
    }
    return {};
  }

  /// A block of stretches without a stop between them, on `finer` times as many nodes as usual.
  [[nodiscard]] Result<TimeLaw::Block> planned(std::size_t block, int finer) const {
    const auto [first, last] = planned_[block];
    POLYPOD_ASSIGN(out, limits_.limits_jerk() ? plan_within_jerk(first, last, finer) : plan_block(first, last, finer));
    out.rest(first == 0 ? path_.stretches.front().wait_before : 0, path_.stretches[last].wait);
    return out;
  }

  [[nodiscard]] Result<TimeLaw::Block> plan_block(std::size_t first, std::size_t last, int finer) const {
    std::vector<PlanNode> nodes;
    constexpr int kLeast = 60, kLeastOfMany = 16, kMost = 2000;
    for (std::size_t k = first; k <= last; ++k) {
      const int pieces = std::clamp(follower_.pieces_of(k), first == last ? kLeast : kLeastOfMany, kMost);
      std::vector<double> places;
      for (int i = 0; i <= pieces; ++i) {
        const double w = static_cast<double>(i) / pieces;
        // Where the tool starts or stops, nodes stand closer.
        const double share = first == last ? w * w * (3 - 2 * w)
                             : k == first  ? 0.5 * w * w * (3 - w)
                             : k == last   ? 1 - 0.5 * (1 - w) * (1 - w) * (2 + w)
                                           : w;
        places.push_back(path_.stretches[k].size * share);
      }
      add_between(k, places);
      for (std::size_t i = 0; i < places.size(); ++i) {
        nodes.push_back(plan_node(k, places[i]));
        for (int part = 1; part < finer && i + 1 < places.size(); ++part)
          nodes.push_back(plan_node(k, places[i] + (places[i + 1] - places[i]) * part / finer));
      }
    }
    return fastest(nodes, limits_);
  }

  /// Where a drive turns far within a step there are points of the track between: the plan has nodes there, too.
  void add_between(std::size_t stretch, std::vector<double>& places) const {
    const std::size_t regular = places.size();
    for (const Node& n : track_)
      if (n.stretch == stretch && n.dense) places.push_back(n.u);
    if (places.size() == regular) return;
    std::sort(places.begin(), places.end());
    const double least = 1e-12 * path_.stretches[stretch].size;
    places.erase(std::unique(places.begin(), places.end(), [&](double a, double b) { return b - a < least; }),
                 places.end());
    // What changes fast there changes by powers of the distance from there: no step is much longer than the next.
    constexpr double kRatio = 2.1;
    for (bool split = true; split;) {
      split = false;
      std::vector<double> graded{places.front()};
      for (std::size_t i = 1; i < places.size(); ++i) {
        const double length = places[i] - places[i - 1];
        const double before = i > 1 ? places[i - 1] - places[i - 2] : length,
                     behind = i + 1 < places.size() ? places[i + 1] - places[i] : length;
        if (length > kRatio * std::min(before, behind)) {
          graded.push_back(0.5 * (places[i - 1] + places[i]));
          split = true;
        }
        graded.push_back(places[i]);
      }
      places = std::move(graded);
    }
  }

  /// The S profile, where no law is much faster.
  [[nodiscard]] std::optional<TimeLaw::Block> s_profile_of(std::size_t first, std::size_t last, int finer) const {
    constexpr int kPieces = 4;
    constexpr double kGap = 1e-3;  // of the time
    std::vector<PlanNode> nodes;
    for (std::size_t k = first; k <= last; ++k) {
      for (int i = 0; i <= finer * kPieces; ++i) {
        nodes.push_back(plan_node(k, path_.stretches[k].size * i / (finer * kPieces)));
      }
    }
    return nearly_fastest_s_profile(nodes, limits_, kGap);
  }

  [[nodiscard]] Result<TimeLaw::Block> plan_within_jerk(std::size_t first, std::size_t last, int finer) const {
    const double from = follower_.begin(first);
    const double to = follower_.begin(last) + path_.stretches[last].size;
    if (const auto profile = s_profile_of(first, last, finer)) return *profile;
    constexpr int kLeast = 100, kMost = 1500;
    int pieces = 0;
    std::vector<double> parts;
    for (std::size_t k = first; k <= last; ++k) {
      pieces += follower_.pieces_of(k);
      if (k > first) parts.push_back(follower_.begin(k));
    }
    const auto node = [&](double s, std::size_t part) {
      const std::size_t k = first + part;
      return plan_node(k, std::clamp(s - follower_.begin(k), 0.0, path_.stretches[k].size));
    };
    std::vector<double> dense;
    for (const Node& n : track_)
      if (n.dense && n.stretch >= first && n.stretch <= last) dense.push_back(n.s);
    return fastest_within_jerk(node, from, to - from, parts, finer * std::clamp(pieces, kLeast, kMost), limits_, dense);
  }

  /// Tool and drives at the time x of a block; limits of poses and condition where they are asked for.
  [[nodiscard]] MoveSample sample_at(std::size_t block, double x, bool judged = false) const {
    MoveSample out;
    out.t = law_.begin(block) + x;
    const Series s = law_.in_block(block, x);
    const TimeLaw::Block& b = law_.block(block);
    out.s = s.value();
    // At the end of a block its own last stretch counts.
    std::size_t k = follower_.stretch_at(std::min(s.value(), b.from + b.size * (1 - 1e-12)));
    k = std::max(k, follower_.stretch_at(b.from + b.size * 1e-12));
    out.stretch = k;
    const Stretch& stretch = path_.stretches[k];
    out.line = stretch.line;
    Series u = s - Series(follower_.begin(k));
    u[0] = std::clamp(u[0], 0.0, stretch.size);
    const PoseSeries target = stretch.at(u);
    const State state = follower_.state(k, u[0], near(k, u[0]), judged);
    out.X = state.X;
    out.reached = state.reached;
    out.condition = state.condition;
    out.violations = state.violations;
    PoseSeries X = target;
    if (state.reached) {
      const JointSeries joints = joint_series(follower_.machine(), target, state.X, state.q);
      out.q = state.q;
      out.regular = joints.regular;
      out.speed = joints.first;
      out.acceleration = joints.second;
      out.jerk = joints.third;
      if (joints.regular) X = joints.X;
      if (joints.regular && options_.dynamics) {
        out.force = drive_forces(follower_.machine(), *options_.dynamics, joints);
      }
    }
    for (int i = 0; i < 3; ++i) {
      out.v[i] = X.p[i].derivative(1);
      out.a[i] = X.p[i].derivative(2);
      out.j[i] = X.p[i].derivative(3);
    }
    out.turn = rate_of_turning(X);
    return out;
  }

  [[nodiscard]] std::array<Nearest, 3> nearest_of(const MoveSample& s) const {
    std::array<Nearest, 3> out;
    out[0].take(s.v.norm(), limits_.tool_speed, -1);
    out[0].take(s.turn.norm(), limits_.turn_speed, -4);
    const double own = path_.stretches[s.stretch].speed;
    if (options_.law == Law::fastest && own > 0) out[0].take(s.v.norm(), own, -3);
    out[1].take(s.a.norm(), limits_.tool_acceleration, -1);
    out[2].take(s.j.norm(), limits_.tool_jerk, -1);
    for (int i = 0; s.regular && i < follower_.joints(); ++i) {
      out[0].take(s.speed[i], limits_.drive_speed[i], i);
      out[1].take(s.acceleration[i], limits_.drive_acceleration[i], i);
      out[2].take(s.jerk[i], limits_.drive_jerk[i], i);
    }
    return out;
  }
  static std::string name_of(const Nearest& n, int order) {
    const char* what[] = {"speed", "acceleration", "jerk"};
    if (n.who == -2) return "";
    if (n.who == -3) return "programmed speed";
    if (n.who == -4) return "tool turning speed";
    return n.who < 0 ? fmt::format("tool {}", what[order]) : fmt::format("drive {} {}", n.who + 1, what[order]);
  }
  static std::pair<std::string, double> nearest_in_words(const std::array<Nearest, 3>& n) {
    int best = 0;
    for (int k = 1; k < 3; ++k)
      if (n[static_cast<std::size_t>(k)].ratio > n[static_cast<std::size_t>(best)].ratio) best = k;
    return {name_of(n[static_cast<std::size_t>(best)], best), n[static_cast<std::size_t>(best)].ratio};
  }

  /// Largest values of one block, and by which factor it must be slower so that all limits are kept.
  struct Look {
    Peaks3 tool;
    double turn = 0;
    std::vector<Peaks3> drives;
    std::vector<double> force;
    std::vector<std::array<Nearest, 3>> all;  ///< at each instant
    double factor = 1;
    std::optional<MoveViolation> jump;  ///< the first
  };
  /// Of one block, where all take `total` s.
  [[nodiscard]] int instants(std::size_t block, double total) const {
    constexpr int kInstants = 10500, kLeast = 24;
    return std::max(kLeast, static_cast<int>(std::ceil(kInstants * law_.block(block).moving() / total)));
  }
  Look look_at(std::size_t block, int count, bool report, std::set<std::string>& exceeded, MoveResult& out) const {
    const double begin = law_.block(block).rest_before, duration = law_.block(block).moving();
    Look look;
    look.drives.resize(out.drives.size());
    look.force.resize(out.drives.size());
    MoveSample last;
    for (int i = 0; i <= count; ++i) {
      const MoveSample s = sample_at(block, begin + duration * i / count);
      if (i > 0 && !look.jump) look.jump = jump_between(last, s, duration / count);
      last = s;
      look.tool.raise(s.v.norm(), s.a.norm(), s.j.norm());
      look.turn = std::max(look.turn, s.turn.norm());
      for (std::size_t k = 0; s.reached && k < out.drives.size(); ++k) {
        const double q = s.q[static_cast<Eigen::Index>(k)];
        out.drives[k].low = std::min(out.drives[k].low, q);
        out.drives[k].high = std::max(out.drives[k].high, q);
      }
      for (std::size_t k = 0; s.regular && k < look.drives.size(); ++k) {
        const auto joint = static_cast<Eigen::Index>(k);
        look.drives[k].raise(s.speed[joint], s.acceleration[joint], s.jerk[joint]);
        if (s.force.size() > 0) look.force[k] = std::max(look.force[k], std::abs(s.force[joint]));
      }
      look.all.push_back(nearest_of(s));
      const std::array<Nearest, 3>& n = look.all.back();
      if (options_.law == Law::fastest) {
        look.factor = std::max({look.factor, n[0].ratio, std::sqrt(n[1].ratio), std::cbrt(n[2].ratio)});
      } else {
        report_exceeded(s, exceeded, out);
      }
      if (s.reached && !s.regular) report_unknown(s, exceeded, out);
      if (report) report_force(s, exceeded, out);
    }
    // Where it waits, the forces are those of rest.
    const TimeLaw::Block& b = law_.block(block);
    for (const auto& [waits, x] : {std::pair{b.rest_before, 0.0}, {b.rest_after, b.duration}}) {
      if (!(waits > 0)) continue;
      const MoveSample s = sample_at(block, x);
      for (std::size_t k = 0; k < look.force.size() && s.force.size() > 0; ++k)
        look.force[k] = std::max(look.force[k], std::abs(s.force[static_cast<Eigen::Index>(k)]));
      if (report) report_force(s, exceeded, out);
    }
    return look;
  }

  /// Looks at many instants of every block; slows a block down until all its limits are kept where they are to be.
  Status check(MoveResult& out) {
    double total = 0;
    for (std::size_t b = 0; b < law_.blocks(); ++b) total += law_.block(b).moving();
    std::map<std::string, double> binding;
    std::set<std::string> exceeded;
    Peaks3 tool;
    double turn = 0;
    std::vector<Peaks3> drives(static_cast<std::size_t>(follower_.joints()));
    std::vector<double> force(drives.size(), 0);
    double slowed = 1;
    for (std::size_t b = 0; b < law_.blocks(); ++b) {
      const bool at_once = options_.law != Law::fastest;
      // Where the limits are exceeded between nodes, finer nodes are better than a slower block.
      constexpr double kEnough = 1.001;
      constexpr int kFinest = 8, kGlances = 500;
      // First at a few instants: what is exceeded there need not be looked at closer.
      const auto looked = [&] {
        const int all = instants(b, total);
        // What is exceeded is reported where it begins: of a plan that is as it is at once.
        if (at_once || all <= kGlances) return look_at(b, all, at_once, exceeded, out);
        std::set<std::string> said{"singular"};  // a glance reports nothing: the closer look says where it begins
        Look few = look_at(b, kGlances, at_once, said, out);
        if (few.factor > kEnough) return few;
        return look_at(b, all, at_once, exceeded, out);
      };
      Look look = looked();
      for (int finer = 2; look.factor > kEnough && finer <= kFinest && !planned_.empty(); finer *= 2) {
        POLYPOD_ASSIGN(block, planned(b, finer));
        law_.replace(b, std::move(block));
        look = looked();
      }
      // The last and finest may have been glanced at alone.
      if (!at_once && look.factor > kEnough) look = look_at(b, instants(b, total), at_once, exceeded, out);
      if (look.jump && exceeded.insert("jump").second) out.violations.push_back(*look.jump);
      const double factor = look.factor, duration = law_.block(b).moving();
      const int count = static_cast<int>(look.all.size()) - 1;
      out.checked += count + 1;
      if (factor > 1) law_.stretch(b, factor);
      slowed = std::max(slowed, factor);
      // Forces have parts that do not go with the speed.
      if (options_.dynamics && !at_once) look.force = look_at(b, count, true, exceeded, out).force;
      for (std::size_t k = 0; k < force.size(); ++k) force[k] = std::max(force[k], look.force[k]);
      look.tool.slower(factor);
      tool.raise(look.tool);
      turn = std::max(turn, look.turn / factor);
      for (std::size_t k = 0; k < drives.size(); ++k) {
        look.drives[k].slower(factor);
        drives[k].raise(look.drives[k]);
      }
      for (std::array<Nearest, 3>& n : look.all) {
        n[0].ratio /= factor;
        n[1].ratio /= factor * factor;
        n[2].ratio /= factor * factor * factor;
        const auto [name, ratio] = nearest_in_words(n);
        constexpr double kMet = 0.99;
        if (ratio >= kMet) binding[name] += duration * factor / (count + 1);
      }
      if (b % 64 == 0) POLYPOD_TRY(go_on(0.6 + 0.3 * static_cast<double>(b) / static_cast<double>(law_.blocks())));
    }
    constexpr double kWorthANote = 1.02;
    if (slowed > kWorthANote) {
      out.notes.push_back(
          fmt::format("a part of the plan was slowed down to {:.2g} of its speed, because limits were "
                      "exceeded between its nodes: a faster motion may exist",
                      1 / slowed));
    }
    out.tool_speed = tool.speed;
    out.tool_acceleration = tool.acceleration;
    out.tool_jerk = tool.jerk;
    out.turn_speed = turn;
    for (std::size_t k = 0; k < drives.size(); ++k) {
      out.drives[k].speed = drives[k].speed;
      out.drives[k].acceleration = drives[k].acceleration;
      out.drives[k].jerk = drives[k].jerk;
      if (options_.dynamics) out.drives[k].force = force[k];
    }
    total = 0;  // of the motion without its waits
    for (std::size_t b = 0; b < law_.blocks(); ++b) total += law_.block(b).moving();
    for (const auto& [name, time] : binding) out.binding.emplace_back(name, time / total);
    std::stable_sort(out.binding.begin(), out.binding.end(),
                     [](const auto& a, const auto& b) { return a.second > b.second; });
    return {};
  }

  static MoveViolation violation_at(const MoveSample& s, const char* kind, const std::string& limit) {
    MoveViolation out;
    out.t = s.t;
    out.s = s.s;
    out.p = s.X.p;
    out.line = s.line;
    out.kind = kind;
    out.limit = limit;
    return out;
  }

  /// A limit that was given and is not kept, once, where it is first found.
  void report_exceeded(const MoveSample& s, std::set<std::string>& seen, MoveResult& out) const {
    const auto look = [&](double value, double limit, int who, int order) {
      constexpr double kRounding = 1e-9;
      if (!(std::abs(value) > limit * (1 + kRounding))) return;
      const std::string name = name_of({0, who}, order);
      if (!seen.insert(name).second) return;
      const bool turns = who == -4 || (who >= 0 && out.drives[static_cast<std::size_t>(who)].turns);
      const auto shown = [&](double x) { return turns ? units::to_deg(x) : units::to_mm(x); };
      const char* per[] = {"/s", "/s2", "/s3"};
      MoveViolation v = violation_at(s, who < 0 ? "tool" : "drive", name);
      v.detail = fmt::format("{} {:.6g} {}{} is above {:.6g}", name, shown(std::abs(value)), turns ? "deg" : "mm",
                             per[order], shown(limit));
      out.violations.push_back(v);
    };
    look(s.v.norm(), limits_.tool_speed, -1, 0);
    look(s.turn.norm(), limits_.turn_speed, -4, 0);
    look(s.a.norm(), limits_.tool_acceleration, -1, 1);
    look(s.j.norm(), limits_.tool_jerk, -1, 2);
    for (int i = 0; s.regular && i < follower_.joints(); ++i) {
      look(s.speed[i], limits_.drive_speed[i], i, 0);
      look(s.acceleration[i], limits_.drive_acceleration[i], i, 1);
      look(s.jerk[i], limits_.drive_jerk[i], i, 2);
    }
  }

  /// A pose at which no speeds of the drives give the motion of the tool: nothing that they do can be judged.
  void report_unknown(const MoveSample& s, std::set<std::string>& seen, MoveResult& out) const {
    if (!seen.insert("singular").second) return;
    MoveViolation v = violation_at(s, "singular", "singular");
    v.detail = "a singular pose: speeds and forces of the drives do not exist here";
    out.violations.push_back(v);
  }

  /// Whether a drive goes from one instant to the next where its speeds at both do not take it: past a nearly singular
  /// pose that lies between, or into another posture. No drive does that, and what lies between is not judged.
  [[nodiscard]] std::optional<MoveViolation> jump_between(const MoveSample& from, const MoveSample& to,
                                                          double time) const {
    if (!from.reached || !to.reached || !from.regular || !to.regular) return {};
    for (int i = 0; i < follower_.joints(); ++i) {
      const bool turns = kinematics::joint_kind(follower_.machine(), i) == machine::JointKind::revolute;
      constexpr double kFewRad = 0.02, kFewMetres = 0.002;  // far above what speeds change by between two instants
      const double change = to.q[i] - from.q[i], expected = 0.5 * time * (from.speed[i] + to.speed[i]),
                   unsure = time * (std::abs(from.speed[i]) + std::abs(to.speed[i]));
      if (!(std::abs(change - expected) > (turns ? kFewRad : kFewMetres) + unsure)) continue;
      MoveViolation v = violation_at(to, "branch", fmt::format("drive {} jumps", i + 1));
      v.detail = fmt::format(
          "drive {} jumps by {:.3g} {} within {:.2g} s: past a nearly singular pose or into another posture", i + 1,
          std::abs(turns ? units::to_deg(change) : units::to_mm(change)), turns ? "deg" : "mm", time);
      return v;
    }
    return {};
  }

  /// Tool and drives at any time of the whole motion.
  [[nodiscard]] MoveSample sample_at_time(double t) const {
    t = std::clamp(t, 0.0, law_.duration());
    std::size_t low = 0, high = law_.blocks() - 1;
    while (low < high) {
      const std::size_t middle = (low + high + 1) / 2;
      if (law_.begin(middle) <= t) {
        low = middle;
      } else {
        high = middle - 1;
      }
    }
    return sample_at(low, std::min(t - law_.begin(low), law_.block(low).duration));
  }

  /// The point of the path next to p, from the parameter s on.
  [[nodiscard]] double distance_from_path(const Vec3& p, double s) const {
    double best = kNoLimit;
    constexpr int kSteps = 12;
    for (int k = 0; k < kSteps; ++k) {
      const std::size_t i = follower_.stretch_at(std::clamp(s, 0.0, path_.size));
      const Stretch& stretch = path_.stretches[i];
      const double u = std::clamp(s - follower_.begin(i), 0.0, stretch.size);
      const PoseSeries X = stretch.at(Series(u, 1, 0, 0));
      Vec3 off, d1, d2;
      for (int c = 0; c < 3; ++c) {
        off[c] = X.p[c].value() - p[c];
        d1[c] = X.p[c].derivative(1);
        d2[c] = X.p[c].derivative(2);
      }
      best = std::min(best, off.norm());
      const double slope = off.dot(d1), bend = d1.squaredNorm() + std::max(0.0, off.dot(d2));
      if (!(bend > 0)) break;
      const double step = -slope / bend;
      s = std::clamp(s + step, 0.0, path_.size);
      constexpr double kNear = 1e-12;  // m
      if (std::abs(step) * std::sqrt(bend) < kNear) break;
    }
    return best;
  }

  /// What the tool does with quantised commands at intervals.
  [[nodiscard]] Result<ContourError> commanded(const Actuators& a) const {
    const double total = law_.duration();
    const int n = follower_.joints();
    constexpr double kMostCommands = 2e5;
    const double steps = std::ceil(total / a.interval);
    if (!(a.interval > 0) || !(steps < kMostCommands)) {
      return fail("MO118", fmt::format("{:g} commands to a drive are more than 2e5", steps), {},
                  "take a longer interval");
    }
    const auto count = static_cast<std::size_t>(steps);
    // The motion at the commands' instants; between them cubic polynomials.
    std::vector<MoveSample> at;
    for (std::size_t k = 0; k <= count; ++k) at.push_back(sample_at_time(a.interval * static_cast<double>(k)));
    const auto wanted = [&](int i, double t) {
      t = std::clamp(t, 0.0, total);
      const std::size_t k = std::min(static_cast<std::size_t>(t / a.interval), count - 1);
      const double h = std::min(a.interval, total - a.interval * static_cast<double>(k));
      const double x = std::clamp((t - a.interval * static_cast<double>(k)) / h, 0.0, 1.0);
      const double q0 = at[k].q[i], q1 = at[k + 1].q[i], v0 = h * at[k].speed[i], v1 = h * at[k + 1].speed[i];
      const double c2 = 3 * (q1 - q0) - 2 * v0 - v1, c3 = v0 + v1 - 2 * (q1 - q0);
      return q0 + x * (v0 + x * (c2 + x * c3));
    };
    const auto rounded = [&](int i, double q) {
      return a.resolution[i] > 0 ? a.resolution[i] * std::round(q / a.resolution[i]) : q;
    };
    /// Where drive i is at the time t, with commands carried out late by `late`.
    const auto actual = [&](int i, double t, double late) {
      t -= late;
      const double offset = a.staggered ? a.interval * i / n : 0;
      const double k = std::floor((t - offset) / a.interval), begin = offset + k * a.interval;
      const double from = rounded(i, wanted(i, begin)), to = rounded(i, wanted(i, begin + a.interval));
      return from + (t - begin) / a.interval * (to - from);
    };
    ContourError out;
    out.commands = count + 1;
    constexpr std::size_t kEach = 4;
    const std::size_t instants = kEach * count;
    for (std::size_t k = 0; k <= instants; ++k) {
      const double t = total * static_cast<double>(k) / static_cast<double>(instants);
      const MoveSample want = sample_at_time(t);
      const auto judge = [&](PathError& e, bool compensated, bool at_intervals) {
        JointVector q(n);
        for (int i = 0; i < n; ++i)
          q[i] = at_intervals ? actual(i, t, compensated ? 0 : a.delay[i]) : rounded(i, want.q[i]);
        const Pose X = pose_near(follower_.machine(), q, want.X);
        const double off = distance_from_path(X.p, want.s);
        e.largest = std::max(e.largest, off);
        e.mean += off / static_cast<double>(instants + 1);
        e.largest_lag = std::max(e.largest_lag, (X.p - want.X.p).norm());
        e.largest_turn = std::max(e.largest_turn, rotation_vector(X.R * want.X.R.transpose()).norm());
      };
      judge(out.compensated, true, true);
      judge(out.coarse, true, false);
      if (a.delay.maxCoeff() > 0) judge(out.uncompensated, false, true);
      constexpr std::size_t kSometimes = 256;
      if (k % kSometimes == 0) POLYPOD_TRY(go_on(0.9 + 0.1 * static_cast<double>(k) / static_cast<double>(instants)));
    }
    if (!(a.delay.maxCoeff() > 0)) out.uncompensated = out.compensated;
    return out;
  }

  /// A drive that is too weak, likewise. A plan is judged as it is, not slowed down.
  void report_force(const MoveSample& s, std::set<std::string>& seen, MoveResult& out) const {
    for (int i = 0; i < s.force.size() && i < options_.force.size(); ++i) {
      if (!(std::abs(s.force[i]) > options_.force[i])) continue;
      const std::string name = fmt::format("drive {} force", i + 1);
      if (!seen.insert(name).second) continue;
      MoveViolation v = violation_at(s, "drive", name);
      const char* unit = out.drives[static_cast<std::size_t>(i)].turns ? "Nm" : "N";
      v.detail = fmt::format("{} {:.6g} {} is above {:.6g}", name, std::abs(s.force[i]), unit, options_.force[i]);
      out.violations.push_back(v);
    }
  }

  void frequencies(MoveResult& out) const {
    if (!options_.dynamics) return;
    double lowest = kNoLimit;
    constexpr int kPlaces = 200;
    for (int k = 0; k < kPlaces; ++k) {
      const MoveSample s = sample_at_time(law_.duration() * k / (kPlaces - 1));
      if (!s.reached) continue;
      const std::vector<double> f = natural_frequencies(follower_.machine(), *options_.dynamics, s.X, s.q);
      if (f.empty()) return;
      if (out.frequencies.empty()) out.frequencies = f;
      lowest = std::min(lowest, f.front());
    }
    if (std::isfinite(lowest)) out.lowest_frequency = lowest;
  }

  void sample(MoveResult& out) const {
    std::vector<std::pair<std::size_t, double>> at;
    const double total = law_.duration();
    std::size_t b = 0;
    for (int i = 0; i < options_.samples; ++i) {
      const double t = total * i / (options_.samples - 1);
      while (b + 1 < law_.blocks() && law_.begin(b + 1) <= t) ++b;
      at.emplace_back(b, std::min(t - law_.begin(b), law_.block(b).duration));
    }
    for (const auto& [block, x] : at) {
      MoveSample s = sample_at(block, x, true);
      std::tie(s.nearest, s.share) = nearest_in_words(nearest_of(s));
      out.samples.push_back(std::move(s));
    }
  }

  const PosePath& path_;
  const MoveOptions& options_;
  PlanLimits limits_;
  Follower follower_;
  std::vector<Node> track_;
  TimeLaw law_;
  std::vector<std::pair<std::size_t, std::size_t>> planned_;  ///< first and last stretch of each block of a plan
};

}  // namespace

bool has_clearance(const AnyMachine& machine) {
  return clearance_of(machine, Vec3::Zero()).has_value();
}

Result<MoveResult> move(const AnyMachine& machine, const PosePath& path, const MoveOptions& options) {
  constexpr double kMostPoints = 1e6;
  double points = 0;
  for (const Stretch& s : path.stretches) points += std::ceil(s.length / options.step) + 2;
  if (!(options.step > 0) || !(points < kMostPoints)) {
    return fail("MO104", fmt::format("{:g} points of the path are more than 1e6", points), {}, "take a longer step");
  }
  if (options.samples < 2) return fail("MO104", fmt::format("{} samples must be 2 or more", options.samples));
  if (options.start && !path.stretches.empty()) {
    const std::size_t known = kinematics::inverse(machine, path.stretches.front().pose(0)).solutions.size();
    if (known > 0 && *options.start >= known) {
      return fail(
          "MO119",
          fmt::format("start {}: the first pose has {} solution{}", *options.start + 1, known, known == 1 ? "" : "s"),
          {}, "take one of these; `polypod ik` lists them");
    }
  }
  return Mover(machine, path, options).run();
}

PathVerdict follow(const AnyMachine& machine, const PosePath& path, const MoveOptions& options) {
  const Follower follower(machine, path, options);
  MoveResult found;
  StartChooser(follower, path, options, found).choose();
  PathVerdict out;
  for (const MoveStart& start : found.starts) {
    if (!start.chosen) continue;
    out = {start.completes, start.reaches, start.condition, start.stretch, start.stopped_by};
  }
  return out;
}

}  // namespace polypod::motion
