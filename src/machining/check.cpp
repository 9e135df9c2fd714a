// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "one_tip.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/free_joints.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/kinematics/posture.hpp"
#include "polypod/machine/assumed.hpp"
#include "polypod/machining/beginning.hpp"
#include "polypod/machining/job.hpp"
#include "polypod/machining/tilted.hpp"
#include "side.hpp"

namespace polypod::machining {
namespace {

// A joint that moves by more than this between two points a millimetre or a degree apart has changed branch, rad.
constexpr double kJump = 0.5;
// One that moves by more than this from a pose that left it free may jump, too, rad.
constexpr double kSuspect = 0.02;
// A turn of A, B or C below this is none, rad.
constexpr double kNoTurn = 1e-9;

/// Whether some joint may begin in more than one turn.
bool several_turns(const machine::AnyMachine& machine) {
  for (int i = 0; i < kinematics::joint_count(machine); ++i) {
    const machine::JointRange range = kinematics::joint_range(machine, i);
    if (kinematics::joint_kind(machine, i) == machine::JointKind::revolute &&
        range.max - range.min > 2 * std::numbers::pi)
      return true;
  }
  return false;
}

/// "x, y, z".
std::string pose_of(machine::Task task) {
  std::string out;
  for (int i = 0; i < task.size(); ++i) out += fmt::format("{}{}", i > 0 ? ", " : "", machine::name_of(task[i]));
  return out;
}

/// "X is", "X and Y are", "X, Y and Z are"; empty where all are known.
std::string unknown_axes(const std::array<bool, 3>& known) {
  std::vector<std::string> names;
  for (std::size_t k = 0; k < 3; ++k) {
    if (!known[k]) names.emplace_back(1, "XYZ"[k]);
  }
  if (names.empty()) return "";
  return listed(names) + (names.size() == 1 ? " is" : " are");
}

/// Of a feed move that only turns the tool: its turn as LinuxCNC takes F of such moves, degrees a minute along the root
/// of the sum of the squares of A, B and C; 0 where no time is known (G93) or it is another move.
double seconds_of_turn(const gcode::Move& move, double length) {
  if (length > 0 || move.kind == gcode::MoveKind::rapid || !move.start_known || !(move.feed > 0) ||
      move.feed_mode != gcode::FeedMode::per_minute) {
    return 0;
  }
  // The F of the program: what was taken as a length a minute in its unit.
  const double deg_per_min = move.inches ? 60 * units::to_inch(move.feed) : units::to_mm_per_min(move.feed);
  return 60 * units::to_deg((move.axes_end - move.axes_start).norm()) / deg_per_min;
}

/// Collects what the cuts ask of the joints. Of each move, the worst of either kind becomes a problem.
class Demands {
 public:
  Demands(const machine::AnyMachine& machine, const MotionLimits& limits, CheckResult& out)
      : machine_(machine), limits_(limits), out_(out) {}
  [[nodiscard]] bool judges(const gcode::Move& move, double length) const {
    return (!limits_.joint_speeds.empty() || !limits_.joint_accelerations.empty()) &&
           ((move.kind != gcode::MoveKind::rapid && move.feed > 0 && length > 0 && move.start_known) ||
            seconds_of_turn(move, length) > 0);
  }
  /// Whether quick joints are judged by their speed.
  [[nodiscard]] bool speeds() const { return !limits_.joint_speeds.empty(); }
  /// The stretch of a move on `line`, run with `feed` (m/s; rad/s where it only turns the tool), that ends at `where`.
  /// Accelerations count with the speed that the controller's own acceleration across the path leaves on an arc of this
  /// radius (0: a line).
  void look(const machine::JointVector& from, const machine::JointVector& to, kinematics::Stretch stretch, int line,
            double feed, double radius, const std::string& where) {
    if (!limits_.joint_speeds.empty()) {
      const kinematics::FastestJoint fastest =
          kinematics::fastest_joint(machine_, from, to, stretch.seconds, limits_.joint_speeds, stretch.pose);
      if (!fastest.judged) lost(line, where);
      if (out_.fastest_line == 0 || fastest.share > out_.fastest.share) {
        out_.fastest = fastest;
        out_.fastest_line = line;
      }
      if (fastest.share > std::max(1.0, speed_.share)) {
        worst(speed_, "speed", fastest.share, line,
              fmt::format("{}: {}", where, kinematics::too_fast(machine_, fastest, limits_.joint_speeds)),
              "; " + (stretch.length > 0 ? kinematics::slower(units::to_mm_per_min(feed) / fastest.share, "mm/min")
                                         : kinematics::slower(60 * units::to_deg(feed) / fastest.share, "deg/min")));
      }
    }
    if (!limits_.joint_accelerations.empty() && stretch.length > 0) {
      if (stretch.tip_acceleration > 0 && radius > 0 && feed * feed > stretch.tip_acceleration * radius) {
        feed = std::sqrt(stretch.tip_acceleration * radius);
        stretch.seconds = stretch.length / feed;
      }
      const kinematics::HardestJoint hardest =
          kinematics::hardest_joint(machine_, from, to, stretch, limits_.joint_accelerations);
      if (!hardest.judged) lost(line, where);
      if (out_.hardest_line == 0 || hardest.share > out_.hardest.share) {
        out_.hardest = hardest;
        out_.hardest_line = line;
      }
      if (hardest.share > std::max(1.0, acceleration_.share)) {
        worst(
            acceleration_, "acceleration", hardest.share, line,
            fmt::format("{}: {}", where,
                        kinematics::too_hard(machine_, hardest, stretch.tip_acceleration, limits_.joint_accelerations)),
            remedy(hardest, feed, stretch.tip_acceleration));
      }
    }
  }
  void next_move() { speed_ = acceleration_ = between_ = {}; }
  /// Where a joint jumps, or the machine is singular, no feed helps.
  void no_remedies() {
    for (Worst* of : {&speed_, &acceleration_}) {
      of->hopeless = true;
      if (of->share > 0) out_.problems[of->problem].detail = of->detail;
    }
  }

 private:
  struct Worst {
    double share = 0;
    std::size_t problem = 0;
    std::string detail;
    bool hopeless = false;
  };

  void worst(Worst& of, const char* kind, double share, int line, std::string detail, const std::string& remedy = "") {
    if (of.share == 0) {
      of.problem = out_.problems.size();
      out_.problems.push_back({line, kind, ""});
    }
    of.detail = std::move(detail);
    out_.problems[of.problem].detail = of.detail + (of.hopeless ? "" : remedy);
    of.share = share;
  }
  void lost(int line, const std::string& where) {
    if (between_.share > 0) return;
    worst(between_, "limit", 1, line,
          fmt::format("{}: a pose between here and the point before has no joints within the limits", where));
  }
  /// The feed's part goes with its square, the controller's with its acceleration.
  static std::string remedy(const kinematics::HardestJoint& hardest, double feed, double tip_acceleration) {
    const double of_tip = hardest.share - hardest.of_speed;
    if (of_tip < 1) {
      return "; " +
             kinematics::slower(units::to_mm_per_min(feed * std::sqrt((1 - of_tip) / hardest.of_speed)), "mm/min");
    }
    constexpr double kLeast = 10e-3;   // m/s^2, below which nobody sets a controller
    constexpr double kOfSpeed = 0.01;  // beyond which the feed is to fall, too
    const double most = tip_acceleration * (1 - std::min(hardest.of_speed, kOfSpeed)) / of_tip;
    if (most < kLeast) return "";
    return fmt::format("; it would keep it with `max_acceleration_mm_per_s2` up to {:.0f}{}",
                       std::floor(0.999 * units::to_mm(most)),
                       hardest.of_speed > kOfSpeed ? " and a smaller feed" : "");
  }

  const machine::AnyMachine& machine_;
  const MotionLimits& limits_;
  CheckResult& out_;
  Worst speed_, acceleration_, between_;  // of this move
};

}  // namespace

std::vector<std::string> starting_branches(const machine::AnyMachine& machine, const Pose& X_MW,
                                           const gcode::Interpretation& interpretation) {
  for (const gcode::Move& move : interpretation.moves) {
    if (!unknown_axes(move.known_end).empty()) continue;
    const Pose X{tool_orientation(machine, X_MW, move.start_known ? move.axes_start : move.axes_end),
                 X_MW * (move.start_known ? move.start : move.end)};
    return kinematics::postures_of(machine, kinematics::inverse(machine, X));
  }
  return {};
}

std::string without_speed(const std::vector<double>& limits) {
  if (limits.empty()) return "the speeds of the joints are not judged: neither the job nor the machine gives any";
  std::vector<std::string> none;
  for (std::size_t i = 0; i < limits.size(); ++i)
    if (!std::isfinite(limits[i])) none.push_back(fmt::format("{}", i + 1));
  if (none.empty()) return {};
  return fmt::format("the speed{0} of joint{0} {1} {2} not judged: no limits are given", none.size() == 1 ? "" : "s",
                     listed(none), none.size() == 1 ? "is" : "are");
}

MotionLimits motion_limits(const Job& job) {
  return {job.joint_speeds, job.joint_accelerations, job.controller.planner.acceleration};
}

Result<CheckResult> check(const machine::AnyMachine& machine, const Pose& X_MW, const gcode::Program& program,
                          const gcode::Interpretation& interpretation, const CheckOptions& options) {
  POLYPOD_TRY(follows_programs(machine));
  CheckResult out;
  out.notes = interpretation.notes;
  const machine::Task task = kinematics::task(machine);
  const int n = kinematics::joint_count(machine);
  machine::JointVector last;
  machine::JointVector start = Eigen::Map<const Eigen::VectorXd>(options.start.data(), std::ssize(options.start));
  if (start.size() == 0) {
    if (const auto beginning = look_ahead(machine, X_MW, interpretation, options.branch)) {
      start = beginning->joints;
      out.notes.push_back(kinematics::in_words(machine, *beginning));
    }
  }
  kinematics::HoldOnPath held(machine);
  Demands demands(machine, options.limits, out);
  // Of turning joints whose speed nobody judges the one that moves most from pose to pose, from where that is near a
  // singular pose: a degree or a millimetre of the tool asks for six degrees of a joint.
  struct {
    double most = 0.1;
    int line = 0;
    std::string what;
  } hurries;
  bool untimed = false;  // a turn, which is named
  std::size_t index = 0;
  double lean = 0;  // of the tool against the direction that the program means, where the machine cannot choose it
  for (const gcode::Move& move : interpretation.moves) {
    if (options.stop_at_first && !out.problems.empty()) return out;
    if (options.progress && index % 256 == 0 &&
        !options.progress(double(index) / double(interpretation.moves.size()))) {
      return fail("MC299", "cancelled");
    }
    ++index;
    const int line = program.blocks[static_cast<std::size_t>(move.block)].line;
    bool reach = false, limit = false, singular = false, passes = false, branch = false, axis = false, touching = false;
    const auto problem = [&](bool& seen, const char* kind, std::string detail) {
      if (!seen) out.problems.push_back({line, kind, std::move(detail)});
      seen = true;
    };
    for (int k = 0; k < 3; ++k) {
      if (task.holds(static_cast<machine::Coordinate>(3 + k)) || std::abs(move.axes_end[k]) < kNoTurn) continue;
      problem(axis, "axis",
              fmt::format("{} {:g} deg: this machine has no {} (its pose is {})", "ABC"[k],
                          units::to_deg(move.axes_end[k]), "ABC"[k], pose_of(task)));
    }
    if (const std::string unknown = unknown_axes(move.known_end); !unknown.empty()) {
      out.not_judged.push_back({line, "end", fmt::format("{} not known where it ends", unknown)});
      last.resize(0);
      continue;
    }
    if (!move.start_known) {
      out.not_judged.push_back(
          {line, "way", fmt::format("{} not known where it starts", unknown_axes(move.known_start))});
    }
    const double length = move.length();
    const double turn = (move.axes_end - move.axes_start).cwiseAbs().maxCoeff();
    const double speed = move.kind == gcode::MoveKind::rapid ? options.rapid_speed : move.feed;
    if (move.start_known) out.length += length;
    if (move.start_known && speed > 0) out.time += length / speed;
    const double turn_time = seconds_of_turn(move, length);
    out.time += turn_time;
    if (move.start_known && move.kind != gcode::MoveKind::rapid && !(length > 0) && turn > kNoTurn &&
        !(turn_time > 0) && !untimed) {
      untimed = true;
      out.not_judged.push_back(
          {line, "time", "a move that only turns the tool with inverse time (G93), and its joints' speeds"});
    }
    const int steps = std::max(
        {1, static_cast<int>(std::ceil(length / options.step)), static_cast<int>(std::ceil(turn / options.turn_step))});
    const auto pose_at = [&](double share) {
      const Vec3 axes = move.axes_start + share * (move.axes_end - move.axes_start);
      return Pose{tool_orientation(machine, X_MW, axes), X_MW * move.point(length * share)};
    };
    const bool demands_joints = demands.judges(move, length);
    demands.next_move();
    for (int k = move.start_known ? 0 : steps; k <= steps; ++k) {
      if (options.stop_at_first && !out.problems.empty()) return out;
      const Pose X = pose_at(double(k) / steps);
      const machine::JointVector& near = last.size() > 0 ? last : start;
      const kinematics::InverseResult inverse =
          near.size() > 0 ? kinematics::inverse_near(machine, X, near) : kinematics::inverse(machine, X);
      const auto where = [&] {
        return fmt::format("x {:.3f} y {:.3f} z {:.3f} mm in M", units::to_mm(X.p.x()), units::to_mm(X.p.y()),
                           units::to_mm(X.p.z()));
      };
      if (inverse.solutions.empty()) {
        problem(reach, "reach", fmt::format("{}: {}", where(), inverse.reason));
        last.resize(0);
        continue;
      }
      const kinematics::Solution* best = inverse.reachable();
      if (last.size() == 0 && !options.branch.empty()) {
        best = kinematics::first_solution(machine, X, inverse, options.branch, start.size() > 0);
        if (best == nullptr && inverse.reachable() != nullptr) {
          problem(branch, "branch",
                  fmt::format("{}: {}", where(), kinematics::reason_of(machine, inverse, options.branch)));
          continue;
        }
      }
      if (best == nullptr) {
        problem(limit, "limit", fmt::format("{}: {}", where(), kinematics::reason_of(machine, inverse)));
        last.resize(0);
        continue;
      }
      lean = std::max(lean, angle_between(kinematics::settled(machine, X).value_or(X).R.col(2), X.R.col(2)));
      const bool follows = last.size() > 0;
      const auto way = [&](double share) { return pose_at((k - 1 + share) / steps); };
      machine::JointVector joints = best->joints;
      const double nearest = follows ? (joints - last).cwiseAbs().maxCoeff() : 0.0;
      bool jumps = false;
      const bool far = nearest > kJump;
      const auto left_open = [&] { return kinematics::free_joints(machine, pose_at(double(k - 1) / steps), last); };
      if (k > 0 && (far || (nearest > kSuspect && !left_open().empty()))) {
        // A joint that hurries and does not jump is judged by its speed, where that is known.
        const auto closely = kinematics::followed(machine, last, way, far ? kJump : kSuspect);
        jumps = !closely.has_value();
        if (closely) joints = *closely;
        if (const std::string broken = jumps ? kinematics::broken_in_posture(machine, inverse, last, kJump) : "";
            !broken.empty()) {
          const bool begins_anywhere = options.start.empty() && several_turns(machine);
          problem(limit, "limit",
                  fmt::format("{}: in the posture that it has the machine cannot go on, {}{}", where(), broken,
                              begins_anywhere ? "; `start_joints` of the job say in which turn the joints begin" : ""));
        } else if (jumps) {
          const std::vector<int> open = left_open();
          problem(
              branch, "branch",
              fmt::format("{}: a joint would jump by {}{}", where(), kinematics::largest_change(machine, joints - last),
                          open.empty() ? ""
                                       : fmt::format("; before it {}: {}", kinematics::in_words_free(open),
                                                     start.size() == 0
                                                         ? "`start_joints` of the job say where to begin"
                                                         : "a program of its own from here on could begin otherwise")));
        } else if (far && (!demands_joints || !demands.speeds())) {
          problem(branch, "branch",
                  fmt::format("{}: a joint would move by {} on the last {}; its speed is judged in cuts where the "
                              "job gives joint_speeds",
                              where(), kinematics::largest_change(machine, joints - last),
                              length > 0 ? fmt::format("{:.3g} mm", units::to_mm(length / steps))
                                         : fmt::format("{:.3g} deg of A, B, C", units::to_deg(turn / steps))));
        }
      }
      if (follows && k > 0 && !jumps && !demands.speeds() && nearest > hurries.most) {
        hurries = {nearest, line,
                   fmt::format("{}: near singular: a joint moves by {} on the last {}; no limits say whether it can",
                               where(), kinematics::largest_change(machine, joints - last),
                               length > 0 ? fmt::format("{:.3g} mm", units::to_mm(length / steps))
                                          : fmt::format("{:.3g} deg of A, B, C", units::to_deg(turn / steps)))};
      }
      if (best->singular) {
        const std::string open = kinematics::in_words_free(kinematics::free_joints(machine, X, joints));
        const std::string what = where() + (open.empty() ? "" : ": " + open);
        const bool judged = kinematics::free_joints_have_limits(machine, X, joints, options.limits.joint_speeds);
        if (!judged) problem(singular, "singular", what);
        if (judged && !passes) out.passed.push_back({line, "singular", what});
        passes = true;
      }
      using At = kinematics::HoldOnPath::At;
      if (!follows) held.leave();
      if (const At at = held.next(X, joints); at != At::held && !singular) {
        problem(singular, "singular", fmt::format("{}: {}", where(), in_words(at)));
        out.problems.back().held = at == At::hardly;
      }
      if (jumps || singular) demands.no_remedies();
      if (demands_joints && follows && k > 0 && !jumps) {
        const double stretch = length / steps;
        const double feed = length > 0 ? move.feed : (move.axes_end - move.axes_start).norm() / turn_time;
        const double seconds = length > 0 ? stretch / feed : turn_time / steps;
        const bool arc = move.kind == gcode::MoveKind::arc;
        demands.look(last, joints, {seconds, stretch, way, options.limits.tip_acceleration}, line, feed,
                     arc ? (move.start - move.centre).norm() : 0.0, where());
      }
      last = joints;
      if (options.touches) {
        const std::string what = options.touches(kinematics::settled(machine, X, last), last, follows, move.tool);
        if (!what.empty()) problem(touching, "collision", fmt::format("{}: {}", where(), what));
      }
      if (out.joints.empty()) {
        for (int i = 0; i < n; ++i) out.joints.push_back({last[i], last[i]});
      }
      for (int i = 0; i < n; ++i) {
        machine::JointRange& r = out.joints[static_cast<std::size_t>(i)];
        r.min = std::min(r.min, last[i]);
        r.max = std::max(r.max, last[i]);
      }
    }
  }
  if (hurries.line > 0) out.not_judged.push_back({hurries.line, "near singular", hurries.what});
  if (!out.passed.empty() && out.problems.empty()) {
    const CheckProblem& first = out.passed.front();
    out.notes.push_back(
        fmt::format("line {}{}: singular, and the joints follow within their speeds ({}); a robot's own "
                    "controller may stop there, and beside it joints turn fast",
                    first.line, out.passed.size() > 1 ? " and others" : "", first.detail));
  }
  const bool speeds = !options.limits.joint_speeds.empty(), hard = !options.limits.joint_accelerations.empty();
  const char* what = speeds && hard ? "speeds and accelerations" : hard ? "accelerations" : "speeds";
  if ((speeds || hard) && out.fastest_line == 0 && out.hardest_line == 0 && !out.joints.empty())
    out.notes.push_back(fmt::format("no cut was there in which the {} of the joints could be judged", what));
  if (auto side = note_on_side(machine)) out.notes.push_back(std::move(*side));
  if (auto tools = note_on_one_tip(interpretation.moves)) out.notes.push_back(std::move(*tools));
  if (std::string joints = without_speed(options.limits.joint_speeds);
      !joints.empty() && !interpretation.moves.empty()) {
    out.notes.push_back(std::move(joints));
  }
  constexpr double kUpright = units::from_deg(0.1);
  if (lean > kUpright) {
    out.notes.push_back(fmt::format(
        "this machine cannot choose the tilt of its tool: on this path it is up to {:.1f} deg", units::to_deg(lean)));
  }
  if (interpretation.moves.empty()) {
    out.problems.push_back({1, "empty", "the program makes no move, so there is nothing to judge"});
  } else if (out.problems.empty() && out.joints.empty()) {
    out.problems.push_back(
        {out.not_judged.front().line, "empty",
         "no move ends where X, Y and Z are known, so there is nothing to judge: give all three with G0"});
  }
  if (machine::limits_are_assumed(machine)) {
    out.not_judged.push_back({0, "limits", fmt::format("of the joints: {}", machine::kAssumedLimits)});
  }
  out.ok = out.problems.empty();
  return out;
}

}  // namespace polypod::machining
