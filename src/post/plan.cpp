// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/post/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "choice.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/carried_arm.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/families/serial/six_joint_inverse.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/beginning.hpp"
#include "polypod/kinematics/free_joints.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/kinematics/posture.hpp"
#include "turns.hpp"

namespace polypod::post {
namespace {

using kinematics::InverseResult;
using kinematics::Solution;
using machine::JointVector;

constexpr double kJump = 0.5;       // rad or m, a joint that moves more between two judged poses has changed posture
constexpr double kSame = 1e-9;      // m and rad, no way
constexpr double kRounded = 2e-6;   // m, what the digits of a file leave between the ends of an arc and its plane
constexpr double kOpposite = 1e-6;  // rad, axes that are opposite have no shortest way between them
constexpr int kDeepest = 14;        // halvings of a way
constexpr unsigned kClosedBranches = 8;  // of the closed inverses of arms
constexpr double kFlatArc = 0.1;         // an arc whose sagitta is below this share of the tolerance is a line

Mat3 rotation_of_angles(const Vec3& a) {
  return rotation_abc(a.x(), a.y(), a.z());
}

void add_name(std::vector<std::string>& names, std::string name) {
  if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(std::move(name));
}

/// All branches of an arm with a closed inverse; of another machine none, for they depend on the pose.
std::vector<std::string> branches_of(const machine::AnyMachine& machine) {
  const auto* arm = std::get_if<machine::SerialArm>(&machine);
  return arm != nullptr && machine::names_branches(*arm) ? kinematics::all_postures(machine)
                                                         : std::vector<std::string>{};
}

/// That of the machine, where the options do not leave it to the inverse.
std::optional<machine::CarriedArm> external_axis(const machine::AnyMachine& machine, const PlanOptions& options) {
  if (options.external == External::follows) return std::nullopt;
  return machine::CarriedArm::on_external_axis(machine);
}

bool is_a_branch(const machine::AnyMachine& machine, const std::string& name) {
  const std::vector<std::string> all = branches_of(machine);
  return std::find(all.begin(), all.end(), name) != all.end();
}

/// One step from where the tool stands.
struct Way {
  const Step* step = nullptr;
  int index = 0;
  Vec3 from = Vec3::Zero(), k_from = Vec3::UnitZ();
  Vec3 angles_from = Vec3::Zero();
  bool by_angles = false;  ///< the source gives angles: they turn linearly
  double c_from = 0, c_to = 0;
  double external_from = 0, external_to = 0;
  bool curved = false;

  [[nodiscard]] Vec3 tip(double s) const {
    if (!curved) return from + s * (step->tip - from);
    // A spiral between two radii that differ by rounding, and a helix.
    const Vec3 r_0 = from - step->centre;
    Vec3 end = step->tip - step->centre;
    const double rise = end.dot(step->normal);
    end -= rise * step->normal;
    const double radius = r_0.norm() + s * (end.norm() - r_0.norm());
    if (s >= 1) return step->tip;
    return step->centre + Eigen::AngleAxisd(s * step->sweep, step->normal) * (r_0.normalized() * radius) +
           s * rise * step->normal;
  }
  [[nodiscard]] Vec3 axis(double s) const {
    if (by_angles) return rotation_of_angles(angles(s)).col(2);
    return between_axes(k_from, step->axis, s);
  }
  [[nodiscard]] Vec3 angles(double s) const { return angles_from + s * (*step->angles - angles_from); }
  [[nodiscard]] double c(double s) const { return c_from + s * (c_to - c_from); }
  [[nodiscard]] double external(double s) const { return external_from + s * (external_to - external_from); }
};

/// A pose, and where the external axis stands.
struct Target {
  Pose X;
  double external = 0;
};

class Planner {
 public:
  Planner(const Configuration& configuration, const Path& path, const PlanOptions& options)
      : configuration_(configuration),
        machine_(configuration.machine),
        path_(path),
        options_(options),
        carried_(external_axis(configuration.machine, options)),
        behind_(carried_ ? machine::AnyMachine(carried_->arm()) : machine::AnyMachine()),
        sets_c_(configuration.rotary == Rotary::abc && path.leaves_c() && options.c.value_or(1) != 0) {}

  struct Start {
    int turn = 0;                    // which of the two pairs of rotary angles
    std::optional<unsigned> branch;  // of the first point; empty: the first that is reachable
    std::vector<double> c;           // of each step, if it is chosen
    std::vector<double> external;    // of each step, unless it follows
    int last_turns = 0;              // whole turns that the last joint begins with, where its range has them
  };

  /// `all`: goes on behind the first problem. False where it was cancelled.
  bool run(const Start& start, bool all) {
    out_ = {};
    out_.sets_c = sets_c_;
    placed_ = lost_ = false;
    speed_line_ = passed_line_ = 0;
    chooses_c_ = !start.c.empty();
    q_.resize(0);
    angles_.setZero();
    R_.setIdentity();
    external_ = start.external.empty() ? options_.external_at : start.external.front();
    for (std::size_t i = 0; i < path_.steps.size(); ++i) {
      if (i % 64 == 0 && !options_.progress(double(i) / double(path_.steps.size()))) return false;
      const Step& step = path_.steps[i];
      if (!step.moves()) continue;
      if (!step.placed()) {
        lost_ = true;
        continue;
      }
      if (placed_ && !step.start_known && options_.length_offsets) lost_ = true;
      if (!all && !out_.ok()) return true;
      take(step, static_cast<int>(i), start);
    }
    return true;
  }

  Plan take_plan() {
    if (!out_.moves.empty() && !out_.branch.empty()) name_branch();
    if (passed_line_ > 0) {
      out_.notes.push_back(
          fmt::format("line {}: singular, and the joints follow within their speeds; the robot's own "
                      "controller may stop there, and beside it joints turn fast",
                      passed_line_));
    }
    return std::move(out_);
  }
  [[nodiscard]] const Plan& result() const { return out_; }

  /// The solutions within the limits at the first point.
  [[nodiscard]] std::vector<unsigned> branches(int turn, double c) const {
    std::vector<unsigned> out;
    for (const Solution& s : first_solutions(turn, c))
      if (s.violations == 0) out.push_back(s.branch);
    return out;
  }

  /// "the branches of this machine are ...": of an arm whose inverse names them all, else those of the first point.
  [[nodiscard]] std::string branches_in_words(int turns, double c) const {
    std::vector<std::string> names = branches_of(machine_);
    const bool all = !names.empty();
    for (int turn = 0; turn < turns && !all; ++turn)
      for (const Solution& s : first_solutions(turn, c)) add_name(names, kinematics::branch_name(machine_, s.branch));
    if (names.empty()) return "`polypod ik` lists the branches of a pose";
    return fmt::format("the branches of this machine{} are {}", all ? "" : " at this point, in or beyond its limits,",
                       listed(names));
  }

  /// Where to begin so that these moves go on (kinematics::look_ahead), with arcs by their chords.
  [[nodiscard]] std::optional<kinematics::Beginning> beginning(const std::vector<PlannedMove>& moves) const {
    std::size_t next = 0;
    return kinematics::look_ahead(
        machine_,
        [&]() -> std::optional<kinematics::WayPiece> {
          if (next >= moves.size()) return std::nullopt;
          const PlannedMove& to = moves[next];
          const PlannedMove& from = moves[next == 0 ? 0 : next - 1];
          ++next;
          const Mat3 R_0 = commanded_by(from.angles);
          const Vec3 turn = rotation_vector(R_0.transpose() * commanded_by(to.angles));
          const auto pose = [this, &from, &to, R_0, turn](double s) {
            const Mat3 R = options_.between == Between::angles
                               ? commanded_by(from.angles + s * (to.angles - from.angles))
                               : Mat3(R_0 * rotation_of(s * turn));
            return in_machine(R, from.tip + s * (to.tip - from.tip));
          };
          return kinematics::WayPiece{pose, samples((to.tip - from.tip).norm(), to.turn)};
        },
        options_.branch);
  }

 private:
  /// Those of the machine with its external axis there, if it has one that does not follow.
  [[nodiscard]] InverseResult solutions(const Target& at) const {
    if (!carried_) return kinematics::inverse(machine_, at.X);
    return carried_->whole(kinematics::inverse(behind_, carried_->seen(at.X, at.external)), at.external);
  }
  [[nodiscard]] InverseResult solutions_near(const Target& at, const JointVector& last) const {
    if (!carried_) return kinematics::inverse_near(machine_, at.X, last);
    const Pose seen = carried_->seen(at.X, at.external);
    return carried_->whole(kinematics::inverse_near(behind_, seen, carried_->behind(last)), at.external);
  }
  /// `way` must outlive it.
  template <class Way>
  [[nodiscard]] kinematics::SolutionsOnWay on_way(const Way& way) const {
    return [this, &way](double s, const JointVector& near) { return solutions_near(way(s), near); };
  }

  [[nodiscard]] std::vector<Solution> first_solutions(int turn, double c) const {
    const Step& first = *std::find_if(path_.steps.begin(), path_.steps.end(), [](const Step& s) { return s.placed(); });
    const Vec3 angles = first_angles(first, c, turn);
    return solutions({in_machine(commanded_by(angles), first.tip), options_.external_at}).solutions;
  }

  /// The orientation in M that A, B and C command: the axis of the tool turns with the workpiece, and C counts from M
  /// all the same (machining::tool_orientation).
  [[nodiscard]] Mat3 commanded_by(const Vec3& angles) const {
    return R_MW_ * rotation_of_angles(angles) * R_MW_.transpose();
  }

  /// Where the first pose leaves joints open, such as a straight wrist, the posture is that of the first that does not.
  void name_branch() {
    const auto open = [this](const PlannedMove& m) {
      return kinematics::freedoms_left(machine_, in_machine(commanded_by(m.angles), m.tip), m.joints);
    };
    if (out_.moves.front().joints.size() == 0) return;
    const int at_first = open(out_.moves.front());
    if (at_first <= std::max(0, kinematics::joint_count(machine_) - kinematics::task(machine_).size())) return;
    constexpr std::size_t kMost = 20000;
    for (std::size_t i = 1; i < std::min(kMost, out_.moves.size()); ++i) {
      const PlannedMove& m = out_.moves[i];
      if (m.joints.size() == 0 || open(m) >= at_first) continue;
      if (std::string name = kinematics::posture_of(machine_, m.joints); !name.empty()) out_.branch = std::move(name);
      return;
    }
  }

  /// The tool's orientation is given along the axes of M, its tip in W.
  [[nodiscard]] Pose in_machine(const Mat3& R, const Vec3& tip) const { return {R, options_.origin + R_MW_ * tip}; }

  /// Whether the source gives angles; where C is chosen or given, those of a program without C are none.
  [[nodiscard]] bool says_angles(const Step& step) const {
    return step.angles && !sets_c_ && (step.turned || !chooses_c_);
  }

  /// Whether the source's own angles are words of this configuration.
  [[nodiscard]] bool fits(const Step& step) const {
    if (!says_angles(step)) return false;
    const Vec3 a = step.angles->cwiseAbs();
    switch (configuration_.rotary) {
      case Rotary::none:
        return a.maxCoeff() < kSame;
      case Rotary::ab:
        return a.z() < kSame;
      case Rotary::ac:
        return a.y() < kSame;
      case Rotary::abc:
        return true;
    }
    return false;
  }

  /// The rotary angles of the first point. At the pole of A and C it has the C of the first axis that is off the pole,
  /// so that C need not swing round when the tool leaves it.
  [[nodiscard]] Vec3 first_angles(const Step& first, double c, int turn) const {
    if (fits(first)) return *first.angles;
    const auto which = static_cast<std::size_t>(turn);
    Vec3 lead = Vec3::Zero();
    if (configuration_.rotary == Rotary::ac) {
      const auto off = std::find_if(path_.steps.begin(), path_.steps.end(), [](const Step& s) {
        return s.placed() && std::hypot(s.axis.x(), s.axis.y()) > kSame;
      });
      if (off != path_.steps.end()) lead = both_turns(Rotary::ac, off->axis, c, Vec3::Zero())[which];
    }
    return both_turns(configuration_.rotary, first.axis, c, lead)[which];
  }

  void problem(int line, const char* kind, std::string detail) {
    const auto seen = std::any_of(out_.problems.rbegin(), out_.problems.rend(),
                                  [&](const PlanProblem& p) { return p.line == line && p.kind == kind; });
    if (!seen) out_.problems.push_back({line, kind, std::move(detail)});
  }

  void take(const Step& step, int index, const Start& start) {
    const double c = start.c.empty() ? options_.c.value_or(0) : start.c[static_cast<std::size_t>(index)];
    const double external = start.external.empty() ? external_ : start.external[static_cast<std::size_t>(index)];
    if (configuration_.rotary == Rotary::none && angle_between(step.axis, Vec3::UnitZ()) > options_.axis_tolerance) {
      problem(step.line, "axis",
              fmt::format("the tool axis ({:.4f}, {:.4f}, {:.4f}): this machine does not tilt its tool", step.axis.x(),
                          step.axis.y(), step.axis.z()));
    }
    if (!placed_) {
      const Vec3 angles = first_angles(step, c, start.turn);
      first_branch_ = start.branch;
      first_turns_ = start.last_turns;
      external_ = external;
      arrive(step, index, step.tip, angles, external, step.kind == StepKind::arc ? StepKind::line : step.kind, false);
      out_.turned_min = out_.turned_max = {angles.x(), angles.y(), angles.z()};
    } else if (lost_) {
      const Vec3 angles = fits(step) ? *step.angles : nearest_turn(configuration_.rotary, step.axis, c, angles_);
      arrive(step, index, step.tip, angles, external, step.kind, false);
    } else {
      follow(step, index, c, external);
    }
    lost_ = false;
    c_ = c;
    k_ = step.axis;
    source_angles_ = says_angles(step) ? *step.angles : angles_;
  }

  /// From the place before, which is known.
  void follow(const Step& step, int index, double c, double external) {
    const Way way{&step,
                  index,
                  tip_,
                  k_,
                  source_angles_,
                  says_angles(step),
                  c_,
                  c,
                  external_,
                  external,
                  step.kind == StepKind::arc};
    if (!way.by_angles && angle_between(k_, step.axis) > std::numbers::pi - kOpposite) {
      problem(step.line, "axis", "the tool axis turns over, and nothing says which way: give points between");
    }
    const bool turns = angle_between(k_, step.axis) > kSame || std::abs(way.c_to - way.c_from) > kSame ||
                       (way.by_angles && (*step.angles - source_angles_).cwiseAbs().maxCoeff() > kSame);
    if (!way.curved) {
      advance(way, 0, 1, 0);
    } else if (!turns && is_arc(step)) {
      arc(way);
    } else {
      chords(way);
    }
  }

  [[nodiscard]] double radius(const Step& step) const {
    const Vec3 r = tip_ - step.centre;
    return (r - r.dot(step.normal) * step.normal).norm();
  }

  [[nodiscard]] bool is_arc(const Step& step) const {
    if (options_.arcs_in_any_plane) return out_of_plane(step) < std::min(kRounded, options_.tolerance);
    return step.normal.cwiseAbs().maxCoeff() > 1 - 1e-12;
  }

  /// By how much a helix rises.
  [[nodiscard]] double out_of_plane(const Step& step) const { return std::abs((step.tip - tip_).dot(step.normal)); }

  void arc(const Way& way) {
    const Step& step = *way.step;
    // A robot's circle through start, middle and end leans by what these leave the plane.
    if (options_.arcs_in_any_plane && out_of_plane(step) > kSame)
      out_.chord_error = std::max(out_.chord_error, out_of_plane(step));
    const double r = radius(step);
    if (step.sweep < 1 && r * (1 - std::cos(step.sweep / 2)) < kFlatArc * options_.tolerance) {
      out_.chord_error = std::max(out_.chord_error, r * (1 - std::cos(step.sweep / 2)));
      ++out_.chorded;
      return arrive(step, way.index, step.tip, angles_, way.external_to, StepKind::line, false);
    }
    const int pieces =
        options_.largest_sweep > 0 ? static_cast<int>(std::ceil(step.sweep / options_.largest_sweep - 1e-9)) : 1;
    for (int i = 0; i < pieces; ++i) arrive_by_arc(way, double(i) / pieces, double(i + 1) / pieces);
  }

  void chords(const Way& way) {
    const Step& step = *way.step;
    const double r = std::max(radius(step), 1e-12);
    const double share = std::min(options_.tolerance / r, 1.0);
    const double angle = std::max(2 * std::acos(1 - share), 1e-4);
    const int pieces = std::max(1, static_cast<int>(std::ceil(step.sweep / angle)));
    out_.chord_error = std::max(out_.chord_error, r * (1 - std::cos(step.sweep / pieces / 2)));
    ++out_.chorded;
    for (int i = 0; i < pieces; ++i) advance(way, double(i) / pieces, double(i + 1) / pieces, 0);
  }

  /// Straight to the point at s_1 of the way, over points between where the axis would leave its way.
  void advance(const Way& way, double s_0, double s_1, int depth) {
    const Step& step = *way.step;
    const Vec3 angles =
        fits(step) ? way.angles(s_1) : nearest_turn(configuration_.rotary, way.axis(s_1), way.c(s_1), angles_);
    const Mat3 R_1 = options_.between == Between::turn ? orientation(way.tip(s_1), angles) : commanded_by(angles);
    double off = 0;
    for (const double s : {0.25, 0.5, 0.75}) {
      const Vec3 k = between(R_1, angles, s).col(2);
      off = std::max(off, angle_between(k, R_MW_ * way.axis(s_0 + s * (s_1 - s_0))));
    }
    if (off > options_.axis_tolerance && depth < kDeepest && configuration_.rotary != Rotary::none) {
      const double middle = (s_0 + s_1) / 2;
      advance(way, s_0, middle, depth + 1);
      return advance(way, middle, s_1, depth + 1);
    }
    out_.axis_error = std::max(out_.axis_error, off);
    const StepKind kind = step.kind == StepKind::rapid ? StepKind::rapid : StepKind::line;
    arrive(step, way.index, way.tip(s_1), angles, way.external(s_1), kind, s_1 < 1);
  }

  /// From where the tool stands to R_1, or to these angles.
  [[nodiscard]] Mat3 between(const Mat3& R_1, const Vec3& angles, double s) const {
    if (options_.between == Between::angles) return commanded_by(angles_ + s * (angles - angles_));
    return R_ * rotation_of(s * rotation_vector(R_.transpose() * R_1));
  }

  /// The orientation that the machine takes there.
  [[nodiscard]] Mat3 orientation(const Vec3& tip, const Vec3& angles) const {
    const Pose X = in_machine(commanded_by(angles), tip);
    if (!kinematics::task(machine_).names_axis()) return X.R;
    const InverseResult inverse =
        q_.size() > 0 ? kinematics::inverse_near(machine_, X, q_) : kinematics::inverse(machine_, X);
    const Solution* best = inverse.reachable();
    return best == nullptr ? X.R : kinematics::settled(machine_, X, best->joints).R;
  }

  /// The joints at a pose, after those before it; problems are named. False where there are none. `way` leads there
  /// from the pose before, where the speed of its joints is judged: those that hurry on it then do not count as a jump.
  bool solve(const Step& step, const Target& target, const std::function<Target(double)>& way = {}) {
    const Pose& X = target.X;
    const bool follows = q_.size() > 0;
    // Of what the first pose leaves open, a free joint and whole turns, the nearest to where the joints stand.
    const bool begins = !follows && !placed_ && options_.start_joints.has_value();
    InverseResult inverse = follows  ? solutions_near(target, q_)
                            : begins ? solutions_near(target, *options_.start_joints)
                                     : solutions(target);
    const auto where = [&] {
      return fmt::format("x {:.3f} y {:.3f} z {:.3f} mm in M", units::to_mm(X.p.x()), units::to_mm(X.p.y()),
                         units::to_mm(X.p.z()));
    };
    if (inverse.solutions.empty()) {
      problem(step.line, "reach", fmt::format("{}: {}", where(), inverse.reason));
      q_.resize(0);
      return false;
    }
    const Solution* best = inverse.reachable();
    if (!placed_ && first_branch_) {
      const Solution* named = nullptr;
      for (const Solution& s : inverse.solutions)
        if (s.branch == *first_branch_ && s.violations == 0) named = &s;
      if (named != nullptr) {
        best = begins && !carried_ ? kinematics::first_solution(machine_, X, inverse,
                                                                kinematics::branch_name(machine_, named->branch), true)
                                   : named;
      }
    }
    if (best == nullptr) {
      problem(step.line, "limit", fmt::format("{}: {}", where(), kinematics::reason_of(machine_, inverse)));
      q_.resize(0);
      return false;
    }
    JointVector joints = best->joints;
    bool judged_by_speed = false;
    jumped_ = false;
    if (way && follows && !lost_ && (joints - q_).cwiseAbs().maxCoeff() > kJump) {
      if (const auto closely = kinematics::followed(q_, on_way(way), kJump)) {
        joints = *closely;
        judged_by_speed = true;
      }
    }
    if (placed_ && first_branch_ && options_.keep_branch && step.kind != StepKind::rapid &&
        best->branch != *first_branch_) {
      problem(step.line, "branch",
              fmt::format("{}: a cut in the posture {}, not in {}", where(),
                          kinematics::branch_name(machine_, best->branch), options_.branch));
    }
    if (best->singular) {
      const bool judged = kinematics::free_joints_have_limits(machine_, X, joints, options_.joint_speeds);
      if (!judged) problem(step.line, "singular", where());
      if (judged && passed_line_ == 0) passed_line_ = step.line;
    }
    if (!follows || lost_) held_.leave();
    if (const auto at = held_.next(X, joints); at != kinematics::HoldOnPath::At::held && !best->singular) {
      problem(step.line, "singular", fmt::format("{}: {}", where(), in_words(at)));
    }
    if (follows && !lost_) {
      jumped_ = !judged_by_speed && (joints - q_).cwiseAbs().maxCoeff() > kJump;
      if (!judged_by_speed) name_jump(step, inverse, joints, where());
    } else if (!follows && out_.branch.empty()) {
      out_.branch = kinematics::branch_name(machine_, best->branch);
    }
    q_ = joints;
    if (!placed_ && first_turns_ != 0) {
      const int last = static_cast<int>(q_.size()) - 1;
      const double turned = q_[last] + 2 * std::numbers::pi * first_turns_;
      const machine::JointRange range = kinematics::joint_range(machine_, last);
      if (turned >= range.min && turned <= range.max) q_[last] = turned;
    }
    if (out_.joints.empty()) {
      for (int i = 0; i < static_cast<int>(q_.size()); ++i) out_.joints.push_back({q_[i], q_[i]});
    }
    for (int i = 0; i < static_cast<int>(q_.size()); ++i) {
      machine::JointRange& r = out_.joints[static_cast<std::size_t>(i)];
      r.min = std::min(r.min, q_[i]);
      r.max = std::max(r.max, q_[i]);
    }
    return true;
  }

  [[nodiscard]] double seconds_of(const PlannedMove& m, const Step& step) const {
    const double speed = m.kind == StepKind::rapid ? options_.rapid_speed : step.feed;
    return m.length > kSame ? (speed > 0 ? m.length / speed : 0) : m.turn / options_.turn_speed;
  }

  /// The way, where the speeds of the joints on it are judged.
  [[nodiscard]] std::function<Target(double)> judged_way(double seconds, std::function<Target(double)> way) const {
    return options_.joint_speeds.empty() || !(seconds > 0) ? nullptr : std::move(way);
  }

  /// Whether the joints may go from `from` to where they are in this time; `way(s)` leads there.
  template <class Way>
  void judge_speeds(const Step& step, const JointVector& from, double seconds, const Way& way) {
    if (options_.joint_speeds.empty() || !(seconds > 0) || from.size() == 0 || q_.size() == 0) return;
    if (jumped_) return;  // into another posture: no speed takes it there
    const kinematics::FastestJoint fastest =
        kinematics::fastest_joint(from, q_, seconds, options_.joint_speeds, on_way(way));
    if (!fastest.judged) {
      problem(step.line, "limit", "a pose between two that were judged has no joints within the limits");
    }
    const double share = fastest.share;
    if (share > out_.speed_share) {
      out_.speed_share = share;
      out_.speed_joint = fastest.joint + 1;
      out_.speed_line = step.line;
    }
    if (share <= 1 || (speed_line_ == step.line && share <= speed_share_)) return;
    const bool worse = speed_line_ == step.line;
    speed_line_ = step.line;
    speed_share_ = share;
    const bool turns_alone = !((way(1).X.p - way(0).X.p).norm() > kSame);  // whatever the feed
    std::string detail = fmt::format(
        "{}; {}", kinematics::too_fast(machine_, fastest, options_.joint_speeds),
        turns_alone     ? fmt::format("--turn-speed: {}",
                                      kinematics::slower(60 * units::to_deg(options_.turn_speed / share), "deg/min"))
        : step.feed > 0 ? kinematics::slower(units::to_mm_per_min(step.feed / share), "mm/min")
                        : std::string("a slower --turn-speed would keep it"));
    const auto known = std::find_if(out_.problems.rbegin(), out_.problems.rend(),
                                    [&](const PlanProblem& p) { return p.line == step.line && p.kind == "speed"; });
    if (worse && known != out_.problems.rend()) {
      known->detail = std::move(detail);
    } else {
      problem(step.line, "speed", std::move(detail));
    }
  }

  /// A joint that jumps by whole turns has come to the end of its range; any other jump changes the posture, because of
  /// a limit or past a singular pose.
  void name_jump(const Step& step, const InverseResult& inverse, const JointVector& joints, const std::string& where) {
    const JointVector change = joints - q_;
    int joint = 0;
    const double jump = change.cwiseAbs().maxCoeff(&joint);
    if (jump <= kJump) return;
    JointVector rest = change;
    for (int i = 0; i < static_cast<int>(rest.size()); ++i) {
      if (kinematics::joint_kind(machine_, i) == machine::JointKind::revolute)
        rest[i] = std::remainder(rest[i], 2 * std::numbers::pi);
    }
    if (rest.cwiseAbs().maxCoeff() > kJump) {
      if (const std::string broken = kinematics::broken_in_posture(machine_, inverse, q_, kJump); !broken.empty()) {
        return problem(step.line, "limit",
                       fmt::format("{}: in the posture that it has the machine cannot go on, {}", where, broken));
      }
      return problem(step.line, "branch",
                     fmt::format("{}: a joint would jump by {}", where, kinematics::largest_change(machine_, change)));
    }
    const machine::JointRange range = kinematics::joint_range(machine_, joint);
    problem(step.line, "rewind",
            fmt::format("{}: joint {} comes to the end of its range ({:.0f} to {:.0f} deg) and would have to turn back "
                        "by {:.0f} deg",
                        where, joint + 1, units::to_deg(range.min), units::to_deg(range.max),
                        360 * std::round(std::abs(units::to_deg(jump)) / 360)));
  }

  [[nodiscard]] int samples(double length, double turn) const {
    return std::max({1, static_cast<int>(std::ceil(length / options_.step)),
                     static_cast<int>(std::ceil(turn / options_.turn_step))});
  }

  void arrive(const Step& step, int index, const Vec3& tip, const Vec3& angles, double external, StepKind kind,
              bool inserted) {
    PlannedMove m;
    m.kind = kind;
    m.step = index;
    m.inserted = inserted;
    m.tip = tip;
    m.angles = angles;
    const Mat3 commanded = commanded_by(angles);
    bool solved = false;
    if (!placed_ || lost_) {
      solved = solve(step, {in_machine(commanded, tip), external});
    } else {
      const Mat3 R_1 = options_.between == Between::turn ? orientation(tip, angles) : commanded;
      m.length = (tip - tip_).norm();
      m.turn = std::max((angles - angles_).cwiseAbs().maxCoeff(),
                        angle_between(commanded.col(2), commanded_by(angles_).col(2)));
      const int n = samples(m.length + std::abs(external - external_), m.turn);
      const auto at = [&](double s) {
        return Target{in_machine(s >= 1 ? commanded : between(R_1, angles, s), tip_ + s * (tip - tip_)),
                      external_ + s * (external - external_)};
      };
      const double seconds = kind == StepKind::rapid ? 0 : seconds_of(m, step);
      for (int i = 1; i <= n; ++i) {
        const JointVector from = q_;
        const auto way = [&](double s) { return at((i - 1 + s) / n); };
        solved = solve(step, at(double(i) / n), judged_way(seconds, way));
        judge_speeds(step, from, seconds / n, way);
      }
    }
    finish(step, std::move(m), commanded, external, solved);
  }

  void arrive_by_arc(const Way& way, double s_0, double s_1) {
    const Step& step = *way.step;
    PlannedMove m;
    m.kind = StepKind::arc;
    m.step = way.index;
    m.inserted = s_1 < 1;
    m.tip = way.tip(s_1);
    m.angles = angles_;
    m.via = way.tip((s_0 + s_1) / 2);
    m.centre = step.centre;
    m.normal = step.normal;
    m.sweep = (s_1 - s_0) * step.sweep;
    const double rise = (step.tip - way.from).dot(step.normal) * (s_1 - s_0);
    m.length = std::hypot(m.sweep * radius(step), rise);
    const Mat3 commanded = commanded_by(angles_);
    m.R_via = commanded;
    const int n = 2 * samples(m.length / 2, 0);
    bool solved = false;
    const double seconds = seconds_of(m, step);
    for (int i = 1; i <= n; ++i) {
      const auto at = [&](double s) { return Target{in_machine(commanded, way.tip(s)), way.external(s)}; };
      const auto piece = [&](double s) { return at(s_0 + (s_1 - s_0) * (i - 1 + s) / n); };
      const JointVector from = q_;
      solved = solve(step, piece(1), judged_way(seconds, piece));
      judge_speeds(step, from, seconds / n, piece);
      if (2 * i == n && solved) m.R_via = kinematics::settled(machine_, piece(1).X, q_).R;
    }
    finish(step, std::move(m), commanded, way.external(s_1), solved);
  }

  void finish(const Step& step, PlannedMove m, const Mat3& commanded, double external, bool solved) {
    m.R = commanded;
    m.external = external;
    if (solved) {
      m.joints = q_;
      m.R = kinematics::settled(machine_, in_machine(commanded, m.tip), q_).R;
    }
    m.seconds = seconds_of(m, step);
    out_.time += m.seconds;
    out_.length += m.length;
    out_.inserted += m.inserted;
    for (std::size_t i = 0; i < 3; ++i) {
      out_.turned_min[i] = std::min(out_.turned_min[i], m.angles[static_cast<int>(i)]);
      out_.turned_max[i] = std::max(out_.turned_max[i], m.angles[static_cast<int>(i)]);
    }
    tip_ = m.tip;
    angles_ = m.angles;
    R_ = m.R;
    external_ = m.external;
    placed_ = true;
    out_.moves.push_back(std::move(m));
  }

  const Configuration& configuration_;
  const machine::AnyMachine& machine_;
  const Path& path_;
  const PlanOptions& options_;
  const std::optional<machine::CarriedArm> carried_;
  const machine::AnyMachine behind_;  ///< the arm that is carried
  const bool sets_c_;
  Plan out_;
  bool placed_ = false;
  std::optional<unsigned> first_branch_;
  int first_turns_ = 0;
  Vec3 tip_ = Vec3::Zero(), k_ = Vec3::UnitZ(), angles_ = Vec3::Zero(), source_angles_ = Vec3::Zero();
  Mat3 R_ = Mat3::Identity();
  Mat3 R_MW_ = rotation_z(options_.rotation);
  int speed_line_ = 0;      // of the last problem with a speed
  double speed_share_ = 0;  // the largest of that line
  int passed_line_ = 0;     // the first with a singular pose that the joints follow
  bool chooses_c_ = false;
  bool lost_ = false;    // the last rapid went to a place that is not known whole
  bool jumped_ = false;  // to the last pose, which is named
  double c_ = 0, external_ = 0;
  JointVector q_;
  kinematics::HoldOnPath held_{machine_};
};

tl::unexpected<Error> cancelled() {
  return fail("PO199", "cancelled");
}

/// So many places of the external axis, from the middle of its range outwards.
std::vector<double> places_to_stand(const Configuration& configuration, int count) {
  const machine::JointRange range = machine::CarriedArm::on_external_axis(configuration.machine)->range();
  std::vector<double> out;
  for (int k = 0; k < count; ++k) {
    const int from_middle = (k % 2 == 0 ? 1 : -1) * ((k + 1) / 2);
    out.push_back(range.min + (range.max - range.min) * (0.5 + double(from_middle) / (count - 1)));
  }
  return out;
}

/// What is chosen along the program, in each posture, the one that looks best first; after the first in which the plan
/// has no problem no other is looked at.
Result<std::vector<Planner::Start>> chosen_starts(const Configuration& configuration, const Path& path,
                                                  const PlanOptions& options, Planner& planner) {
  struct Posture {
    ChoiceQuestion question;
    double cost;
  };
  std::vector<Posture> postures;
  for (unsigned branch = 0; branch < kClosedBranches; ++branch) {
    if (!options.branch.empty() && kinematics::branch_name(configuration.machine, branch) != options.branch) continue;
    for (int turn = 0; turn < (options.c ? 2 : 1); ++turn) {
      const ChoiceQuestion question{branch, turn, false};
      postures.push_back({question, first_look(configuration, path, options, question)});
    }
  }
  // With C as it is given first: the other pair of rotary angles turns the tool about its axis by half a turn.
  std::stable_sort(postures.begin(), postures.end(), [](const Posture& a, const Posture& b) {
    return std::pair(a.question.turn, a.cost) < std::pair(b.question.turn, b.cost);
  });
  std::vector<Planner::Start> out;
  std::size_t blocked = 0;
  for (const Posture& posture : postures) {
    if (!std::isfinite(posture.cost)) continue;
    // At first with rungs apart, then at every point, then without the C of steps that had problems, as where a joint
    // hurries between two points.
    constexpr int kMostRounds = 6;
    ChoiceQuestion question = posture.question;
    for (int round = 0; round < kMostRounds; ++round) {
      question.every_point = round > 0;
      Choice chosen = choose(configuration, path, options, question);
      if (!options.progress(0)) return cancelled();
      if (!chosen.found) {
        blocked = std::max(blocked, chosen.blocked);
        break;  // nor at more points
      }
      const std::vector<double> c = chosen.c;
      out.push_back({question.turn, question.branch, std::move(chosen.c), std::move(chosen.external)});
      if (!planner.run(out.back(), false)) return cancelled();
      if (planner.result().ok()) {
        std::swap(out.front(), out.back());
        return out;
      }
      if (round == 0) continue;
      if (c.empty()) break;
      for (const PlanProblem& problem : planner.result().problems) {
        for (std::size_t i = 0; i < path.steps.size(); ++i)
          if (path.steps[i].line == problem.line) question.avoided.push_back({i, c[i]});
      }
    }
  }
  if (options.external == External::chosen) {
    // Where the ladder finds no way, it may stand still.
    const std::vector<double> places = places_to_stand(configuration, options.c ? 33 : 9);
    for (const Posture& posture : postures) {
      for (const double place : places) {
        PlanOptions standing = options;
        standing.external = External::stands;
        standing.external_at = place;
        Planner::Start start{posture.question.turn, posture.question.branch, {}, {}};
        if (!options.c) {
          Choice chosen = choose(configuration, path, standing, posture.question);
          if (!options.progress(0)) return cancelled();
          if (!chosen.found) continue;
          start.c = std::move(chosen.c);
        }
        start.external.assign(path.steps.size(), place);
        if (!planner.run(start, false)) return cancelled();
        if (!planner.result().ok()) continue;
        out.insert(out.begin(), std::move(start));
        return out;
      }
    }
  }
  if (!out.empty()) return out;
  const bool speeds = !options.joint_speeds.empty();
  const bool anywhere =
      std::any_of(postures.begin(), postures.end(), [](const Posture& p) { return std::isfinite(p.cost); });
  const bool place = options.external == External::chosen;
  const char* what = options.c ? "place of the external axis" : place ? "C and no place of the external axis" : "C";
  return fail("PO123",
              fmt::format("no {} {} every point of this program within the limits{} in one posture{}", what,
                          !options.c && place ? "keep" : "keeps", speeds ? " and the joints' speeds" : "",
                          anywhere ? ": at the latest this line stops it" : ""),
              {path.file, anywhere ? path.steps[blocked].line : 0, anywhere ? 1 : 0},
              place ? "see with --external-axis follows which lines are out of reach, or move the workpiece with "
                      "--origin"
                    : "see with --c 0 which lines are out of reach, or move the workpiece with --origin");
}

/// Where the external axis stands at the end of each step of a plan, so that the next one moves it there linearly.
std::vector<double> external_of(const Path& path, const Plan& plan) {
  std::vector<double> out(path.steps.size());
  double last = 0;
  bool known = false;
  std::size_t done = 0;
  for (const PlannedMove& m : plan.moves) {
    if (m.joints.size() == 0) continue;
    if (!known) last = m.joints[0];
    known = true;
    const auto step = static_cast<std::size_t>(m.step);
    for (; done < step; ++done) out[done] = last;
    last = m.joints[0];
  }
  for (; done < out.size(); ++done) out[done] = last;
  return out;
}

}  // namespace

Result<Plan> plan(const Configuration& configuration, const Path& path, const PlanOptions& options) {
  const bool turns_with_work = options.tilts_with_work && configuration.rotary == Rotary::abc &&
                               !kinematics::task(configuration.machine).names_axis();
  if (options.rotation != 0 && !turns_with_work) {
    for (const Step& s : path.steps) {
      const bool turns = s.angles && s.angles->cwiseAbs().maxCoeff() > kSame;
      if (!s.moves() || (!turns && angle_between(s.axis, Vec3::UnitZ()) < kSame)) continue;
      return fail("PO124", "the workpiece is turned about z, and here the tool tilts or turns", {path.file, s.line, 1},
                  "program such a part along the axes of M, without a rotation of the workpiece; in the languages of "
                  "robots arms of six axes follow it");
    }
  }
  const auto joints = static_cast<std::size_t>(kinematics::joint_count(configuration.machine));
  if (!options.joint_speeds.empty() && options.joint_speeds.size() != joints) {
    return fail("PO127", fmt::format("{} joint speeds for {} joints", options.joint_speeds.size(), joints), {},
                "give one a joint that moves, in the order of `polypod info`");
  }
  if (options.start_joints && static_cast<std::size_t>(options.start_joints->size()) != joints) {
    return fail("PO127", fmt::format("{} start joints for {} joints", options.start_joints->size(), joints), {},
                "give one a joint that moves, in the order of `polypod info`");
  }
  if (options.start_joints) {
    if (const std::string fault = kinematics::cannot_start(configuration.machine, *options.start_joints);
        !fault.empty())
      return fail("PO127", fault, {}, "give the joints where the machine stands before the program");
  }
  PlanOptions asked = options;
  const auto* arm = std::get_if<machine::SerialArm>(&configuration.machine);
  const auto axis = machine::CarriedArm::on_external_axis(configuration.machine);
  if (!axis) {
    asked.external = External::follows;
  } else if (!axis->moves()) {
    asked.external = External::stands;
    asked.external_at = *axis->axis().locked;
    const machine::JointRange range = axis->range();
    if (asked.external_at < range.min || asked.external_at > range.max) {
      const bool turns = axis->axis().kind == machine::JointKind::revolute;
      const auto user = [turns](double v) { return turns ? units::to_deg(v) : units::to_mm(v); };
      return fail("PO127",
                  fmt::format("the external axis is locked at {:g} {}, beyond its limits {:g} and {:g}",
                              user(asked.external_at), turns ? "deg" : "mm", user(range.min), user(range.max)),
                  {}, "lock it within its limits, or correct these");
    }
  } else if (asked.external == External::chosen && configuration.rotary != Rotary::abc) {
    asked.external = External::linear;
  }
  const bool linear = asked.external == External::linear;
  if (linear) asked.external = External::follows;
  if (asked.branch.empty() && asked.start_joints) {
    asked.branch = kinematics::posture_of(configuration.machine, *asked.start_joints);
  }
  Planner planner(configuration, path, asked);
  const int turns = configuration.rotary == Rotary::ac || configuration.rotary == Rotary::abc ? 2 : 1;
  const auto not_there = [&](const std::string& reached) {
    return fail("PO122", fmt::format("the first point cannot be reached with the branch `{}`{}", asked.branch, reached),
                {path.file}, planner.branches_in_words(turns, asked.c.value_or(0)));
  };
  const bool choose = (configuration.rotary == Rotary::abc && !asked.c) || asked.external == External::chosen;
  std::vector<Planner::Start> starts;
  if (choose) {
    const bool serves =
        axis ? asked.external != External::follows : arm != nullptr && machine::has_six_joint_branches(*arm);
    if (!serves) {
      return fail("PO123",
                  axis ? "C is chosen together with the place of the external axis, which follows the moves here"
                       : "C cannot be chosen on this machine: it has no closed inverse with six joints",
                  {}, axis ? "leave --external-axis follows out, or give --c DEG" : "give --c DEG");
    }
    if (!asked.branch.empty() && !is_a_branch(configuration.machine, asked.branch)) return not_there("");
    POLYPOD_ASSIGN(chosen, chosen_starts(configuration, path, asked, planner));
    starts = std::move(chosen);
  } else {
    std::vector<std::string> reached;
    for (int turn = 0; turn < turns; ++turn) {
      for (const unsigned branch : planner.branches(turn, asked.c.value_or(0))) {
        add_name(reached, kinematics::branch_name(configuration.machine, branch));
        if (asked.branch.empty() || kinematics::branch_name(configuration.machine, branch) == asked.branch) {
          starts.push_back({turn, branch, {}, {}});
        }
      }
    }
    // Where no posture reaches it, it is out of reach, which is said with its line.
    const bool known = reached.empty() && is_a_branch(configuration.machine, asked.branch);
    if (starts.empty() && !asked.branch.empty() && !known) {
      return not_there(reached.empty() ? "" : fmt::format("; it can with {}", listed(reached)));
    }
    if (starts.empty()) starts.push_back({});
  }
  // The last joint of an arm may begin a turn on or back, which leaves it more of its range; not where it is said where
  // it stands.
  const int last = kinematics::joint_count(configuration.machine) - 1;
  const machine::JointRange range = kinematics::joint_range(configuration.machine, last);
  if (!options.start_joints && kinematics::is_serial(configuration.machine) &&
      range.max - range.min > 2 * std::numbers::pi &&
      kinematics::joint_kind(configuration.machine, last) == machine::JointKind::revolute) {
    const std::size_t count = starts.size();
    for (const int turns_of_last : {-1, 1}) {
      for (std::size_t i = 0; i < count; ++i) {
        starts.push_back(starts[i]);
        starts.back().last_turns = turns_of_last;
      }
    }
  }
  if (!planner.run(starts.front(), true)) return cancelled();
  Plan first = planner.take_plan();
  std::size_t used = 0;
  if (const auto beginning = first.ok() || options.start_joints ? std::nullopt : planner.beginning(first.moves)) {
    asked.start_joints = beginning->joints;
    if (!planner.run(starts.front(), true)) return cancelled();
    if (planner.result().problems.size() < first.problems.size()) {
      first = planner.take_plan();
      first.notes.push_back(kinematics::in_words(configuration.machine, *beginning));
    } else {
      asked.start_joints.reset();
    }
  }
  for (std::size_t i = 1; i < starts.size() && !first.ok(); ++i) {
    if (!planner.run(starts[i], false)) return cancelled();
    if (!planner.result().ok()) continue;
    first = planner.take_plan();
    used = i;
    if (starts[i].last_turns != 0 && !first.moves.empty() && first.moves.front().joints.size() > 0) {
      first.notes.push_back(
          fmt::format("joint {} begins at {:.1f} deg: bring it there before the program starts, or it comes to the end "
                      "of its range",
                      last + 1, units::to_deg(first.moves.front().joints[last])));
    }
  }
  if (configuration.rotary == Rotary::abc && asked.c && starts[used].turn == 1 && path.c_line == 0) {
    first.notes.push_back(fmt::format(
        "the machine takes the moves with the other pair of A and B, in which C {:g} deg is the tool turned "
        "by half a turn about its axis",
        units::to_deg(*asked.c)));
  }
  if (linear && first.ok()) {
    asked.external = External::stands;  // at the end of each step where it came to
    Planner again(configuration, path, asked);
    starts[used].external = external_of(path, first);
    if (!again.run(starts[used], true)) return cancelled();
    std::vector<std::string> notes = std::move(first.notes);
    first = again.take_plan();
    first.notes.insert(first.notes.begin(), notes.begin(), notes.end());
  }
  return first;
}

const Step* turned_cut(const Path& path, const Plan& plan) {
  constexpr double kTurned = 1e-6;  // rad
  if (plan.sets_c) return nullptr;
  for (const PlannedMove& m : plan.moves) {
    const Step& step = path.steps[static_cast<std::size_t>(m.step)];
    if (m.kind == StepKind::rapid || !step.angles) continue;
    const auto x_axis = [](const Vec3& a) -> Vec3 { return rotation_abc(a.x(), a.y(), a.z()).col(0); };
    if (angle_between(x_axis(m.angles), x_axis(*step.angles)) > kTurned) return &step;
  }
  return nullptr;
}

}  // namespace polypod::post
