// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/simulate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>

#include "polypod/core/units.hpp"
#include "polypod/cutting/ball_stock.hpp"
#include "polypod/cutting/discs.hpp"
#include "polypod/cutting/end_force.hpp"
#include "polypod/kinematics/free_joints.hpp"
#include "polypod/kinematics/surplus.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/machining/vibration.hpp"
#include "polypod/machining/weights.hpp"
#include "polypod/machining/yielding.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {
namespace {

// A way counts as vertical if its horizontal part is below this share of its length: no side of the cutter cuts.
constexpr double kVertical = 1e-6;
// A bend that differs by less than this from the last one changes the compliance by less than 1e-4, m.
constexpr double kNearBend = 50e-6;
// Steps of the equilibrium before it is bracketed; a wide cut needs three or four.
constexpr int kPlainIterations = 6;
// What an unsettled equilibrium may still move without being reported, m.
constexpr double kSettled = 1e-6;
// A layer thinner than this is no cut, m: cells hold heights in single precision, and no robot is that good.
constexpr double kNoCut = 1e-6;
// The longest step along an arc, rad: chords between neighbouring points are off it by less than half a hundredth of R.
constexpr double kArcStep = 0.2;
// More points than this are refused: hours of work.
constexpr double kMostPoints = 2e8;
// Progress is reported, and a wish to stop heeded, at least this often within a move, and of short moves.
constexpr std::int64_t kReportPoints = 4096;
constexpr std::size_t kReportMoves = 512;
// How far ahead of the cutter its engagement is looked at, in diameters, but never less than two cells. A length of its
// own, so that finer cells look at the same way: where a cut begins the force grows along it.
constexpr double kLookAhead = 0.04;
// Less than this on the way that is looked at is no way down, m: heights are kept in single precision.
constexpr double kLeastFall = 0.1e-6;
// Strips shallower than this share of the deepest do not make a wall.
constexpr double kWallShare = 0.1;
// Steps of a transition: one a tooth within these.
constexpr double kFewestYields = 12, kMostYields = 60;
// Teeth that pass on a transition, for what has no time or no end.
constexpr double kFewestTeeth = 1e-6, kMostTeeth = 1e6;
// Directions in which a transition may yield; fewer of a cutter of several discs, each of which is looked at.
constexpr int kDirections = 32, kDirectionsOfDiscs = 16;
// A tip within this of the last one meets the same, m.
constexpr double kNearTip = 5e-6;
// The cosine of the lean of an upright tool is 1 but for this.
constexpr double kUpright = 1e-12;
// Over which way the heading of a ball that turns is taken, m, and below which share of its tip's way it has none.
constexpr double kHeadingStep = 0.05e-3, kNoHeading = 1e-6;
// A shank of the cutter's diameter beyond its flutes, for what a rapid move meets, m.
constexpr double kShank = 1;
// The chip for which forces are taken to grow in proportion, m.
constexpr double kThinChip = 20e-6;

/// The cutter on its way: stock, machine and the state between two points. Vectors are in the frame S of the stock,
/// which is W unless the tool is tilted. Of a ball that turns in cuts, what it removes and meets is that of its lowest
/// point, which lies off its tip by lowest_.
class Pass {
 public:
  Pass(const Job& job, const gcode::Program& program, const PassMoves& moves, cutting::Stock& stock,
       const PassOptions& options, const std::function<void(const Sample&)>& visit,
       const std::function<void(const Sample&, const TeethView&)>& teeth = {})
      : job_(job),
        program_(program),
        moves_(moves),
        stock_(stock),
        options_(options),
        visit_(visit),
        teeth_(teeth),
        frame_(job.tool_frame),
        X_MS_(job.tool_frame.to_S(job.X_MW)),
        probe_(job.machine, cutting_orientation(job), job.posture, job.start_joints) {}

  Result<PassResult> run() {
    POLYPOD_TRY(affordable());
    if (job_.weights && frame_.turns) {
      return fail("MC214", "the weight of the machine is not known for a tool that turns in cuts", {program_.path},
                  "leave --gravity out");
    }
    if (job_.weights) {
      POLYPOD_ASSIGN(weight, WeightDeflection::of(job_, job_.weights));
      weight_.emplace(std::move(weight));
    }
    const std::size_t report_every = std::clamp<std::size_t>(moves_.size() / 200, 1, kReportMoves);
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (i % report_every == 0) POLYPOD_TRY(report(i));
      POLYPOD_TRY(step_to(i));
    }
    result_.removed += stock_.settle();
    return result_;
  }

 private:
  Status report(std::size_t move) {
    if (!options_.progress || options_.progress(double(move) / double(moves_.size()))) return {};
    return fail("MC299", "cancelled");
  }

  /// Steps of at most the option's length and, on arcs, of at most kArcStep.
  [[nodiscard]] std::int64_t steps_of(const gcode::Move& move, double length) const {
    double steps = std::ceil(length / options_.step - 1e-9);
    if (move.kind == gcode::MoveKind::arc) steps = std::max(steps, std::ceil(move.sweep / kArcStep - 1e-9));
    return static_cast<std::int64_t>(std::clamp(steps, 1.0, kMostPoints));
  }

  /// Refuses what would run for days before it begins.
  Status affordable() const {
    double points = 0;
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      const gcode::Move& move = moves_[i];
      if (move.kind == gcode::MoveKind::rapid || !move.start_known) continue;
      points += static_cast<double>(steps_of(move, move.length()));
      if (points < kMostPoints) continue;
      return fail("MC205",
                  fmt::format("with steps of {:g} mm the program has more than {:.0e} points to evaluate",
                              units::to_mm(options_.step), kMostPoints),
                  place(move), "use a larger step_mm, or check the length and the turns (P) of this move");
    }
    return {};
  }

  struct ToolModel {
    const cutting::Cutter* cutter;
    cutting::DiscsForce force;
    cutting::EndForce end;
    std::optional<cutting::BallForce> ball;  ///< in the place of both, if it is a ball

    [[nodiscard]] const std::vector<cutting::EdgeDisc>& discs() const { return force.discs(); }
  };

  ToolModel& tool_model(int number) {
    const auto it = models_.find(number);
    if (it != models_.end()) return it->second;
    const cutting::Cutter& cutter = job_.cutter_of(number);
    const cutting::EndCoefficients end = job_.material.end.value_or(cutting::end_as_sides(job_.material));
    ToolModel model{&cutter, cutting::DiscsForce(cutter, job_.material), cutting::EndForce(cutter, end), {}};
    if (cutting::is_ball(cutter)) model.ball.emplace(cutter, job_.material);
    return models_.emplace(number, model).first->second;
  }

  [[nodiscard]] Place place(const gcode::Move& move) const {
    return {program_.path, program_.blocks[static_cast<std::size_t>(move.block)].line, 1};
  }

  Status step_to(std::size_t index) {
    probed_ = false;
    POLYPOD_TRY(take(index));
    if (!probed_ && probe_.follows()) follow(moves_[index]);
    return {};
  }

  /// A move of which no point was asked for its compliance, a rapid or through air: the joints follow it.
  void follow(const gcode::Move& move) {
    // A safe height before X and Y are given is no place.
    if (!std::all_of(move.known_end.begin(), move.known_end.end(), [](bool known) { return known; })) return;
    constexpr double kStep = 5e-3, kTurnStep = 0.0175;  // m, rad
    const double length = move.start_known ? move.length() : 0;
    const double turn = move.start_known ? (move.axes_end - move.axes_start).cwiseAbs().maxCoeff() : 0;
    const int steps = static_cast<int>(std::clamp(std::ceil(std::max(length / kStep, turn / kTurnStep)), 1.0, 1e5));
    for (int k = 1; k <= steps; ++k) {
      const double share = double(k) / steps;
      const Vec3 axes =
          move.start_known ? Vec3(move.axes_start + share * (move.axes_end - move.axes_start)) : move.axes_end;
      const Vec3 p = move.start_known ? move.point(share * length) : move.end;
      probe_.follow({tool_orientation(job_, axes), job_.X_MW * p});
    }
  }

  Status take(std::size_t index) {
    const gcode::Move& move = moves_[index];
    ToolModel& tool = tool_model(move.tool);
    if (!move.start_known) {  // where it comes from is not known: nothing can be said of the way
      turn_to(move, move.length());
      last_bent_ = unloaded(move.end) + lowest_;
      deflection_.setZero();
      return {};
    }
    if (!stands_as_set_up(job_, move)) return other_orientation(move);
    if (move.kind == gcode::MoveKind::rapid) return rapid(move, tool);
    if (move.length() > 0) rapids_ = {};
    if (moves_.transition(index)) return transition(index, tool);
    return feed_move(static_cast<int>(index), tool);
  }

  Status rapid(const gcode::Move& move, const ToolModel& tool) {
    // When the cut ends the deflected tool springs back to where it is commanded, before it moves: no collision.
    result_.removed += stock_.settle();
    const Vec3 from = unloaded(move.start), to = unloaded(move.end);
    double volume = 0;
    if (tool.ball) {
      turn_to(move, move.axes_start);
      const Vec3 first = from + lowest_;
      result_.removed += cut_ball(first, first, tool);
      // The ball goes straight where the tool does not turn.
      constexpr double kTurnStep = units::from_deg(1);
      const double turn = frame_.turns ? (move.axes_end - move.axes_start).cwiseAbs().maxCoeff() : 0;
      const int steps = std::max(1, static_cast<int>(std::ceil(turn / kTurnStep)));
      Vec3 at = first;
      for (int k = 1; k <= steps; ++k) {
        const double share = double(k) / steps;
        turn_to(move, Vec3(move.axes_start + share * (move.axes_end - move.axes_start)));
        const Vec3 next = from + share * (to - from) + lowest_;
        volume += cut_ball(at, next, tool, kShank);
        at = next;
      }
    } else {
      result_.removed += cutting::cut_disc(stock_, from, tool.discs());
      volume = cutting::cut_line(stock_, from, to, tool.discs(), true);
    }
    if (volume > 0) {
      if (rapids_.volume_so_far == 0) rapids_.first_block = move.block;
      rapids_.block = move.block;
      rapids_.volume = volume;
      rapids_.volume_so_far += volume;
      result_.incidents.push_back(rapids_);
    }
    result_.removed += volume;
    free_at(to);
    return {};
  }

  /// A move with the tool in another orientation than in the cuts: it passes through air, or is not judged (accept,
  /// predict).
  Status other_orientation(const gcode::Move& move) {
    if (move.kind != gcode::MoveKind::rapid && !stays_clear(job_, move)) POLYPOD_TRY(may_cut(move));
    result_.removed += stock_.settle();
    turn_to(move, move.length());
    free_at(unloaded(move.end));
    return {};
  }

  /// The tool stands as at the arc length s of a move.
  void turn_to(const gcode::Move& move, double s) {
    if (frame_.turns) turn_to(move, axes_at(move, s));
  }
  void turn_to(const gcode::Move& move, const Vec3& axes) {
    if (!frame_.turns || (axes == axes_now_ && move.tool == tool_now_)) return;
    axes_now_ = axes;
    tool_now_ = move.tool;
    const Mat3 R_MT = tool_orientation(job_, axes);
    probe_.turn_to(R_MT);
    R_ST_ = job_.X_MW.R.transpose() * R_MT;
    lowest_ = lowest_of(move, R_ST_.col(2));
  }
  /// From the tip to the lowest point of a ball whose axis is `axis`, in S.
  [[nodiscard]] Vec3 lowest_of(const gcode::Move& move, const Vec3& axis) const {
    const cutting::Cutter& cutter = job_.cutter_of(move.tool);
    if (!cutting::is_ball(cutter)) return Vec3::Zero();
    return cutter.radius() * (axis - Vec3::UnitZ());
  }
  [[nodiscard]] bool stands_upright() const { return !frame_.turns || R_ST_(2, 2) >= 1 - kUpright; }

  /// Where a move goes at s, as a unit vector in S, and how much farther the middle of the cutter comes than its tip:
  /// of a ball that turns, the middle's way.
  struct Heading {
    Vec3 d = Vec3::Zero();
    double rate = 1;
  };
  [[nodiscard]] Heading heading(const gcode::Move& move, double s) const {
    if (!frame_.turns || move.axes_start == move.axes_end) return {frame_.to_S(move.direction(s)), 1};
    const double length = move.length(), h = std::min(kHeadingStep, 0.25 * length);
    const auto middle = [&](double at) {
      const Vec3 axis = job_.X_MW.R.transpose() * tool_orientation(job_, axes_at(move, at)).col(2);
      return Vec3(move.point(at) + lowest_of(move, axis));
    };
    const double from = std::max(0.0, s - h), to = std::min(length, s + h);
    if (!(to > from)) return {frame_.to_S(move.direction(s)), 1};
    const Vec3 way = (middle(to) - middle(from)) / (to - from);
    const double rate = way.norm();
    if (!(rate > kNoHeading)) return {frame_.to_S(move.direction(s)), rate};
    return {way / rate, rate};
  }

  /// The tool is free of forces, with its tip at `tip`.
  void free_at(const Vec3& tip) {
    last_bent_ = tip + lowest_;
    deflection_.setZero();
    last_way_.setZero();
    last_ = Sample{};
    last_.move = -1;
  }

  /// What the weight of the machine does to a tool that is commanded to a point of W, in S.
  Vec3 by_weight(const Vec3& p_W) {
    if (!weight_) return Vec3::Zero();
    return frame_.to_S(weight_->at(p_W).value_or(Vec3::Zero()));  // where it is out of reach, that is refused elsewhere
  }
  /// Where the tool stands without forces, in S, for a command in W. A correction that holds stands where it should.
  Vec3 unloaded(const Vec3& p_W) {
    if (!weight_ || options_.bend == Bend::corrected) return frame_.to_S(p_W);
    return frame_.to_S(p_W) + by_weight(p_W);
  }
  /// The command of a sample, whose tool stands at Sample::command until then; all in S.
  Vec3 command_of(const Sample& sample) {
    if (options_.bend != Bend::corrected)
      return frame_.to_S(moves_[static_cast<std::size_t>(sample.move)].point(sample.s));
    Vec3 out =
        sample.command;  // c + w(c) is where it stands; w changes by some thousandths of a millimetre a millimetre
    for (int round = 0; round < 3; ++round) out = sample.command - by_weight(frame_.to_W(out));
    return out;
  }

  /// Hands a sample over, whose vectors are in S until then, and whose command is where the unloaded tool stands.
  void tell(const Sample& sample) {
    if (!frame_.tilted && !weight_ && !open_) return visit_(sample);
    Sample out = sample;
    const machine::JointVector& q = probe_.joints();
    if (open_ && sample.cutting && q.size() <= std::ssize(out.joints)) {
      out.joint_count = static_cast<std::uint8_t>(q.size());
      for (Eigen::Index i = 0; i < q.size(); ++i) out.joints[static_cast<std::size_t>(i)] = static_cast<float>(q[i]);
    }
    if (weight_) {
      out.command = command_of(sample);
      out.weight = sample.command - out.command;
      out.deflection += out.weight;
      out.without_chips += out.weight;
    }
    out.command = frame_.to_W(out.command);
    out.deflection = frame_.to_W(out.deflection);
    out.weight = frame_.to_W(out.weight);
    out.without_chips = frame_.to_W(out.without_chips);
    out.force = frame_.to_W(sample.force);
    out.away = frame_.to_W(sample.away);
    visit_(out);
  }

  Status feed_move(int index, ToolModel& tool) {
    const gcode::Move& move = moves_[static_cast<std::size_t>(index)];
    const double length = move.length();
    if (!(length > 0)) return {};
    const double radius = tool.cutter->radius();
    const std::int64_t steps = steps_of(move, length);
    double volume = 0;
    end_cuts_ = false;
    for (std::int64_t k = 0; k <= steps; ++k) {
      if (k % kReportPoints == kReportPoints - 1) POLYPOD_TRY(report(static_cast<std::size_t>(index)));
      const double s = length * static_cast<double>(k) / static_cast<double>(steps);
      Sample sample;
      if (k == 0 && goes_on(index)) {
        sample = last_;
        sample.move = index;
        sample.s = 0;
        tell(sample);
        continue;
      }
      sample.move = index;
      sample.s = s;
      turn_to(move, s);
      if (frame_.turns) sample.axes = axes_now_;
      at_end_ = k == 0 || k == steps;
      POLYPOD_TRY(evaluate(static_cast<std::size_t>(index), s, length, tool, sample));
      // The bent cutter sweeps from where it was last; a jog at the start of a move is swept as well. What the window
      // at the end looks at is cut last.
      if (k == 0 || k == steps || s <= length - look_ahead_length(radius)) {
        const Vec3 at = sweeps_bent() ? sample.bent() : unloaded(move.point(s));
        volume += sweep(at, tool, k > 0);
      }
      deflection_ = sample.deflection;
      ++result_.points;
      tell(sample);
      if (k == steps) last_ = sample;
    }
    const gcode::Move& followed = moves_.followed(static_cast<std::size_t>(index));
    last_way_ = heading(followed, &followed != &move ? followed.nearest(move.end) : length).d;
    if (!descends_on(static_cast<std::size_t>(index))) volume += stock_.settle();
    result_.removed += volume;
    if (end_cuts_) result_.incidents.push_back({Incident::Kind::end_cut, move.block, volume});
    return {};
  }

  /// The bent cutter goes straight on with its tip to `tip`; the removed volume. A step that is level but for less than
  /// what counts as a cut is swept level, which costs a fifth.
  double sweep(const Vec3& tip, const ToolModel& tool, bool start_done) {
    const Vec3 to = tip + lowest_;
    Vec3 from = last_bent_, at = to;
    last_bent_ = to;
    if (tool.ball) return cut_ball(from, at, tool);
    if (std::abs(to.z() - from.z()) < kNoCut) from.z() = at.z() = 0.5 * (to.z() + from.z());
    return cutting::cut_step(stock_, from, at, tool.discs(), start_done);
  }

  /// A ball with its lowest point on the way from a to b, and, where it leans, the straight part above it.
  /// `shank`: how much of it counts beyond the flutes, m.
  double cut_ball(const Vec3& a, const Vec3& b, const ToolModel& tool, double shank = 0) {
    const double radius = tool.cutter->radius(), straight = tool.cutter->length - radius + shank;
    double removed = cutting::cut_ball(stock_, a, b, radius);
    if (!stands_upright()) removed += cutting::cut_shaft(stock_, a, b, R_ST_.col(2), radius, straight);
    return removed;
  }

  /// Whether this move goes on smoothly from the one before, under the same conditions: then its first point is the
  /// last one of that.
  [[nodiscard]] bool goes_on(int index) const {
    if (index == 0 || last_.move != index - 1 || !last_.cutting) return false;
    const auto i = static_cast<std::size_t>(index);
    const gcode::Move &before = moves_[i - 1], &now = moves_[i];
    if (moves_.transition(i - 1) || before.kind == gcode::MoveKind::rapid || before.feed != now.feed ||
        before.tool != now.tool || before.spindle_speed != now.spindle_speed || before.spindle != now.spindle) {
      return false;
    }
    const gcode::Move &a = moves_.followed(i - 1), &b = moves_.followed(i);
    if (&a == &b) return true;
    return heading(a, a.length()).d.dot(heading(b, 0).d) > std::cos(options_.smooth_angle);
  }

  /// A joint of the correction, in steps: the command goes from one place to the other at its feed, and the tool
  /// follows as it yields to the force of its own way (yield_step).
  Status transition(std::size_t index, ToolModel& tool) {
    const gcode::Move& move = moves_[index];
    const double length = move.length();
    // How many teeth pass. Where none do, or the feed is 0, may_cut refuses what cuts.
    const double teeth =
        std::clamp(length / move.feed * move.spindle_speed * tool.cutter->teeth, kFewestTeeth, kMostTeeth);
    const auto steps = static_cast<std::int64_t>(std::clamp(std::ceil(teeth), kFewestYields, kMostYields));
    const double passes = teeth / static_cast<double>(steps);
    const bool in_cut = !deflection_.isZero(0);
    turn_to(move, 0);
    // Of a ball that turns, the lowest point.
    Vec3 tip = unloaded(move.start) + lowest_ + deflection_, looked_at = Vec3::Constant(1e3);
    // What a plunge has held back before is let go (see Plunge).
    const bool sinks = !tool.ball && frame_.to_S(move.end).z() < frame_.to_S(move.start).z();
    // The tool goes on as it went: of several balances that counts which follows from this.
    Vec3 stepped = last_way_ * (length / static_cast<double>(steps));
    double thickest = 0;
    for (std::int64_t k = 0; k <= steps; ++k) {
      Sample sample;
      sample.move = static_cast<int>(index);
      sample.s = length * static_cast<double>(k) / static_cast<double>(steps);
      turn_to(move, sample.s);
      if (frame_.turns) sample.axes = axes_now_;
      sample.command = unloaded(move.point(sample.s));
      const Vec3 command = sample.command + lowest_;
      if (k > 0) {
        if (tool.ball || (tip - looked_at).norm() > kNearTip) {
          thickest = tool.ball ? look_around_ball(tip, tool) : look_around(tip, tool);
          looked_at = tip;
          if (thickest > kNoCut) POLYPOD_TRY(may_cut(move));
        }
        Mat3 C;
        POLYPOD_TRY(compliance(move, sample.command, C));
        const Yielded yielded = tool.ball ? yield_step(tip, command, C, contacts_, passes, stepped)
                                          : yield_step(tip, command, C, around_, passes);
        if (yielded.rest > kSettled) add_unsettled(move, yielded.rest);
        Vec3 to = yielded.tip;
        sample.force = yielded.force;
        if (sinks) sample.force += held_by_floor(tip, to, C, passes, tool);
        stepped = to - tip;
        tip = to;
        result_.removed += sweep(tip - lowest_, tool, true);
      }
      // By its weight alone a tool may be off the path, in the air.
      sample.cutting = thickest > kNoCut || (k == 0 && (!weight_ || in_cut));
      sample.depth = static_cast<float>(thickest);
      deflection_ = sample.deflection = tip - command;
      ++result_.points;
      tell(sample);
    }
    return {};
  }

  /// The force of the end of a flat cutter that would go down from one tip to another while `passes` teeth pass, and
  /// how far it comes: a chip a tooth thicker gives more thrust, and that lifts it,
  ///   fall - down = [C (edge + chip down / passes)]_z,
  /// or it rests where it is, on less than what the edges push with.
  Vec3 held_by_floor(const Vec3& from, Vec3& to, const Mat3& C, double passes, const ToolModel& tool) {
    const double fall = from.z() - to.z();
    if (!(fall > kLeastFall)) return Vec3::Zero();
    cutting::look_down(stock_, {to.x(), to.y(), from.z()}, tool.discs(), std::atan2(fall, (to - from).head<2>().norm()),
                       Eigen::Vector2d::UnitX(), fall, footprint_);
    if (!footprint_.any) return Vec3::Zero();
    constexpr double kNoChip = 1e-12;  // m
    const Vec3 edge = tool.end.mean_force(footprint_, kNoChip);
    const Vec3 chip = (tool.end.mean_force(footprint_, kThinChip) - edge) / kThinChip;
    const double by_edge = (C * edge).z(), by_chip = (C * chip).z() / passes;
    const double down = (fall - by_edge) / (1 + by_chip);
    if (down > 0) {
      to.z() = from.z() - down;
      return edge + chip * (down / passes);
    }
    to.z() = from.z();
    return edge * (fall / by_edge);
  }

  /// What a ball meets at its lowest point on any way, into `contacts_`; the deepest cut of it, m.
  double look_around_ball(const Vec3& lowest, const ToolModel& tool) {
    const double reach = look_ahead_length(tool.cutter->radius());
    if (stands_upright()) {
      tool.ball->contacts(stock_, lowest, reach, contacts_);
    } else {
      tool.ball->contacts(stock_, lowest, R_ST_, reach, contacts_);
    }
    double deepest = 0;
    for (const cutting::BallContact& contact : contacts_) deepest = std::max(deepest, contact.depth);
    return deepest;
  }

  /// The force of every direction of the plane at a tip, into `around_`; the deepest cut of them, m.
  double look_around(const Vec3& tip, ToolModel& tool) {
    const double ahead = look_ahead_length(tool.cutter->radius());
    double deepest = 0;
    const int directions = tool.discs().size() == 1 ? kDirections : kDirectionsOfDiscs;
    around_.resize(static_cast<std::size_t>(directions));
    for (int j = 0; j < directions; ++j) {
      const double angle = 2 * std::numbers::pi * j / directions;
      const Eigen::Vector2d d(std::cos(angle), std::sin(angle));
      ForceAlong& out = around_[static_cast<std::size_t>(j)];
      out = {d, Vec3::Zero(), Vec3::Zero()};
      const Vec3 level(d.x(), d.y(), 0);
      meet(tip, tool, level, d, ahead, false);
      if (!(met_.max_depth > kNoCut)) continue;
      deepest = std::max(deepest, met_.max_depth);
      const auto force = [&](double feed_per_tooth) {
        const Vec3 f = tool.force.mean_force(met_, feed_per_tooth, 0);
        return Vec3(f.x() * d.x() - f.y() * d.y(), f.x() * d.y() + f.y() * d.x(), f.z());
      };
      out.edge = force(0);
      out.chip = (force(kThinChip) - out.edge) / kThinChip;
    }
    return deepest;
  }

  [[nodiscard]] double look_ahead_length(double radius) const { return machining::look_ahead_length(stock_, radius); }

  /// What a ball meets, or the sides of a flat cutter: these nothing on a plunge.
  void meet(const Vec3& tip, const ToolModel& tool, const Vec3& d, const Eigen::Vector2d& feed, double ahead,
            bool vertical) {
    const double radius = tool.cutter->radius();
    if (tool.ball && stands_upright()) cutting::look_ahead(stock_, tip + lowest_, radius, d, ahead, ball_);
    if (tool.ball && !stands_upright()) cutting::look_ahead(stock_, tip + lowest_, R_ST_, radius, d, ahead, ball_);
    if (vertical || tool.ball) {
      if (!tool.ball) met_.of.resize(tool.discs().size());
      met_.clear();
      met_.any = tool.ball && ball_.any;
      met_.max_depth = met_.any ? ball_.max_depth : 0;
      return;
    }
    cutting::look_ahead(stock_, tip, tool.discs(), feed, ahead, met_);
  }

  /// Whether the next move goes on downwards in the direction of this one, as turns of a helix do.
  [[nodiscard]] bool descends_on(std::size_t index) const {
    if (index + 1 >= moves_.size()) return false;
    if (moves_.transition(index + 1)) return true;  // which takes the load off
    const gcode::Move &now = moves_[index], &next = moves_[index + 1];
    if (next.kind == gcode::MoveKind::rapid || !(next.length() > 0)) return false;
    const Vec3 d = frame_.to_S(next.direction(0));
    return d.z() < 0 && d.dot(frame_.to_S(now.direction(now.length()))) > std::cos(options_.smooth_angle);
  }

  /// How far the next move goes down in its first `way`, m.
  [[nodiscard]] double next_fall(std::size_t index, double way) const {
    if (index + 1 >= moves_.size() || !(way > 0)) return 0;
    const gcode::Move& next = moves_[index + 1];
    if (next.kind == gcode::MoveKind::rapid || !(next.length() > 0)) return 0;
    return std::max(0.0, -frame_.to_S(next.direction(0)).z()) * std::min(way, next.length());
  }

  /// How far a way goes down, rad below the horizontal.
  static double descent_of(const Vec3& d) { return std::atan2(std::max(0.0, -d.z()), std::hypot(d.x(), d.y())); }

  /// What the end of the cutter meets at `tip`, into `footprint_`. It cuts as long as the tip goes down, and stops
  /// doing so at the end of the way down.
  ///
  /// A bent tool meets the floor that it left itself: where the command has gone down by less than the thrust bends the
  /// tool, its end rests on the floor and cuts nothing.
  void meet_below(std::size_t index, double s, double length, const Vec3& tip, const Vec3& d,
                  const Eigen::Vector2d& feed, const ToolModel& tool) {
    footprint_.any = false;
    const double ahead = look_ahead_length(tool.cutter->radius()), descent = descent_of(d), fall = -d.z() * ahead,
                 left = -d.z() * (length - s);
    const bool ideal = options_.bend == Bend::corrected;  // for a correction that holds up to the end
    if (!(fall > kLeastFall) || !(s < length || ideal || descends_on(index))) return;
    // Nor does it meet what stands below the end of the way down; where it cuts up to there and the next move goes on
    // down, what that comes to.
    const double beyond_end = std::max(0.0, fall - left), next = next_fall(index, ahead - (length - s));
    const bool bends = options_.bend == Bend::equilibrium;
    if (!bends || beyond_end > 0) {
      cutting::look_down(stock_, tip + beyond_end * Vec3::UnitZ(), tool.discs(), descent, feed, fall, footprint_);
      if (!footprint_.any) return;
    }
    if (bends) {
      cutting::look_down(stock_, tip, tool.discs(), descent, feed, std::max(std::min(fall, left + next), kLeastFall),
                         footprint_);
    } else if (const double more = std::min(beyond_end, next); more > 0) {
      cutting::look_down(stock_, tip + (beyond_end - more) * Vec3::UnitZ(), tool.discs(), descent, feed, fall,
                         footprint_);
    }
  }

  /// Whether something stands higher than the end of the cutter at `tip`; else it only rests there.
  [[nodiscard]] bool end_takes(const Vec3& tip, const Vec3& d, const Eigen::Vector2d& feed,
                               const ToolModel& tool) const {
    const double fall = -d.z() * look_ahead_length(tool.cutter->radius());
    cutting::EndFootprint above;
    cutting::look_down(stock_, tip + fall * Vec3::UnitZ(), tool.discs(), descent_of(d), feed, fall, above);
    return above.any;
  }

  [[nodiscard]] bool sweeps_bent() const { return options_.bend == Bend::equilibrium; }

  /// Horizontally to the left of a way; none where it is vertical.
  static Vec3 beside(const Vec3& d) {
    const double horizontal = std::hypot(d.x(), d.y());
    return horizontal < kVertical ? Vec3(Vec3::Zero()) : Vec3(-d.y() / horizontal, d.x() / horizontal, 0);
  }

  /// Fills deflection, force and engagement of the point at s.
  Status evaluate(std::size_t index, double s, double length, ToolModel& tool, Sample& sample) {
    const gcode::Move &move = moves_[index], &followed = moves_.followed(index);
    const Vec3 p_W = move.point(s), p = unloaded(p_W);
    const double along_followed = &followed != &move ? followed.nearest(p_W) : s;
    const Heading heads = heading(followed, along_followed);
    const Vec3& d = heads.d;
    sample.command = p;
    const double horizontal = std::hypot(d.x(), d.y());
    const bool vertical = horizontal < kVertical;
    const Eigen::Vector2d feed =
        vertical ? Eigen::Vector2d(1, 0) : Eigen::Vector2d(d.x() / horizontal, d.y() / horizontal);
    const Vec3 along(feed.x(), feed.y(), 0), left(-feed.y(), feed.x(), 0);
    const double radius = tool.cutter->radius(), ahead = look_ahead_length(radius);
    if (!vertical) sample.away = left;
    if (frame_.turns) sample.away = beside(followed.direction(along_followed));
    // What counts is what the cutter takes on its way, never what stands beyond the end: near the end the window that
    // is looked at stays behind it.
    const double beyond = std::clamp(s + ahead - length, 0.0, s);
    const Vec3 window = p - d * (heads.rate * beyond);
    const bool bends = options_.bend == Bend::equilibrium;

    const auto look = [&](const Vec3& bend) {
      meet(bends ? Vec3(window + bend) : window, tool, d, feed, ahead, vertical);
      if (!tool.ball) meet_below(index, s, length, bends ? Vec3(p + bend) : p, d, feed, tool);
    };
    footprint_.any = false;
    look(deflection_);
    if (!met_.any && !footprint_.any && bends && !deflection_.isZero(0)) {
      look(Vec3::Zero());  // the last bend may have lifted it out altogether
      if (met_.any || footprint_.any) deflection_.setZero();
    }
    if (!(met_.max_depth > kNoCut) && !footprint_.any) {
      deflection_.setZero();
      if (weight_ && options_.bend != Bend::corrected) {
        const Vec3 meant = frame_.to_S(&followed != &move ? followed.point(followed.nearest(p_W)) : p_W);
        meet(meant - d * beyond, tool, d, feed, ahead, vertical);
        if (!tool.ball) meet_below(index, s, length, meant, d, feed, tool);
        sample.cutting = met_.max_depth > kNoCut || footprint_.any;
        if (sample.cutting) describe(sample);
      }
      return {};
    }
    POLYPOD_TRY(may_cut(move));
    POLYPOD_TRY(only_flutes_meet(move, tool));
    const double per_tooth = heads.rate * move.feed / (move.spindle_speed * tool.cutter->teeth);
    const auto in_S = [&](const Vec3& f) { return Vec3(along * f.x() + left * f.y() + Vec3::UnitZ() * f.z()); };
    const auto force_of_end = [&](double each) {
      return footprint_.any ? in_S(tool.end.mean_force(footprint_, -d.z() * each)) : Vec3(Vec3::Zero());
    };
    const auto force_of = [&](double each, const Vec3& of_end) {
      if (tool.ball && stands_upright()) return tool.ball->mean_force(ball_, d, each);
      if (tool.ball) return tool.ball->mean_force(ball_, R_ST_, d, each);
      return Vec3(of_end + in_S(tool.force.mean_force(met_, each * horizontal, each * d.z())));
    };
    const auto force_here = [&] { return force_of(per_tooth, force_of_end(per_tooth)); };
    end_cuts_ = end_cuts_ || footprint_.any;
    // The ideal command stands off the path by about the last bend.
    Mat3 C;
    POLYPOD_TRY(compliance(move, options_.bend == Bend::corrected ? Vec3(p - deflection_) : p, C));
    sample.cutting = true;
    if (options_.bend == Bend::at_rest) {
      sample.force = force_here();
      sample.deflection = C * sample.force;
    } else if (options_.bend == Bend::corrected) {
      sample.force = force_here();
      // x = p - C(x) F: the compliance changes by less than a thousandth over a bend, so one step from the last bend,
      // or two from afar, reach a tenth of a micrometre.
      sample.deflection = C * sample.force;
      if ((sample.deflection - deflection_).norm() > kNearBend) {
        POLYPOD_TRY(compliance(move, p - sample.deflection, C));
        sample.deflection = C * sample.force;
      }
      sample.command = p - sample.deflection;
    } else {
      sample.deflection = equilibrium(move, look, C, force_here, sample.force);
      sample.cutting = met_.max_depth > kNoCut || (footprint_.any && end_takes(p + sample.deflection, d, feed, tool));
    }
    if (at_end_) sample.without_chips = C * force_of(0, force_of_end(0));
    POLYPOD_TRY(flutes_reach(move, p.z() + lowest_.z(), *tool.cutter));
    describe(sample);
    if (tool.ball) {
      describe_ball(along, left, sample);
    } else if (teeth_ && sample.cutting) {
      teeth_(sample, {move, met_.of[0], feed, per_tooth * horizontal, footprint_.any});
    }
    return {};
  }

  /// The deflection with delta = C F(p + delta), from the last one on.
  ///
  /// Plain iteration contracts where the cut is wide, since a millimetre of width changes the force by much less than a
  /// millimetre of bend. Where a thin layer is left, one row of cells more or less changes the force by a step and no
  /// cell-wise engagement balances it: then the balance is bracketed on the line between two iterates and bisected; the
  /// tool stands where it takes part of that row. So it does where the end of the cutter rests on the floor: with the
  /// thrust of a cut it would stand above the floor, without any below.
  template <class Look, class Force>
  Vec3 equilibrium(const gcode::Move& move, Look&& look, const Mat3& C, Force&& force_here, Vec3& force) {
    const auto bend_at = [&](const Vec3& delta) {
      look(delta);
      force = force_here();
      return Vec3(C * force);
    };
    Vec3 bend = deflection_, next = bend;
    for (int i = 0; i < kPlainIterations; ++i) {
      if (i == 0) {
        force = force_here();  // the profile at the last bend is at hand
        next = C * force;
      } else {
        next = bend_at(bend);
      }
      if ((next - bend).norm() < options_.tolerance) return next;
      std::swap(bend, next);
    }
    // Between the last two iterates the residual changes its sense, if the cut pushes the tool out of itself.
    Vec3 low = next, high = bend;
    const Vec3 along = high - low;
    for (int i = 0; i < options_.max_iterations; ++i) {
      const Vec3 middle = 0.5 * (low + high);
      next = bend_at(middle);
      if ((next - middle).norm() < options_.tolerance) return next;
      ((next - middle).dot(along) > 0 ? low : high) = middle;
    }
    const double rest = (high - low).norm();
    if (rest > kSettled) add_unsettled(move, rest);
    return 0.5 * (low + high);
  }

  void add_unsettled(const gcode::Move& move, double rest) {
    ++result_.not_converged;
    result_.largest_rest = std::max(result_.largest_rest, rest);
    if (result_.unsettled.empty() || result_.unsettled.back().block != move.block) {
      result_.unsettled.push_back({move.block, rest});
    }
    result_.unsettled.back().rest = std::max(result_.unsettled.back().rest, rest);
  }

  /// Depth, angles and on which side the wall stands, from the highest disc that meets anything.
  void describe(Sample& sample) const {
    constexpr int kBins = cutting::EngagementProfile::kBins;
    constexpr int kRim = 3;  // strips at each rim that say whether there is a wall
    if (!met_.any || met_.of.empty()) return;
    const cutting::EngagementProfile& profile = met_.of[met_.highest];
    int first = kBins, last = -1;
    for (int j = 0; j < kBins; ++j) {
      if (profile.depth[j] <= kWallShare * profile.max_depth) continue;
      first = std::min(first, j);
      last = j;
    }
    if (last < 0) return;
    const auto angle = [](int strip) { return std::acos(1.0 - 2.0 * strip / kBins); };
    sample.depth = static_cast<float>(met_.max_depth);
    sample.entry = static_cast<float>(angle(first));
    sample.exit = static_cast<float>(angle(last + 1));
    const bool wall_left = first < kRim, wall_right = last >= kBins - kRim;
    sample.wall_left = wall_left && !wall_right;
  }

  /// Depth, angles and the side of the wall of a ball, which meets most of the material there.
  void describe_ball(const Vec3& along, const Vec3& left, Sample& sample) const {
    double most = -1, least = 1, of_left = 0, of_right = 0;  // cosines of the angles from the left
    for (int j = 0; j < cutting::BallEngagement::kSectors; ++j) {
      const double phi = 2 * std::numbers::pi * (j + 0.5) / cutting::BallEngagement::kSectors;
      Vec3 out(std::sin(phi), std::cos(phi), 0);
      if (!stands_upright()) out = R_ST_ * out;
      double met = ball_.side[static_cast<std::size_t>(j)];
      for (const auto& ring : ball_.share) met += ring[static_cast<std::size_t>(j)];
      if (!(met > 0) || out.dot(along) < 0) continue;
      const double u = std::clamp(out.dot(left), -1.0, 1.0);
      most = std::max(most, u);
      least = std::min(least, u);
      (u > 0 ? of_left : of_right) += met * std::abs(u);
    }
    sample.depth = static_cast<float>(ball_.max_depth);
    if (most < least) return;
    sample.entry = static_cast<float>(std::acos(most));
    sample.exit = static_cast<float>(std::acos(least));
    constexpr double kOneSided = 2;
    sample.wall_left = of_left > kOneSided * of_right;
  }

  /// Whether the flutes reach up to the top of what is cut: depths count from the stock's bottom where the tip is
  /// below.
  [[nodiscard]] Status flutes_reach(const gcode::Move& move, double tip, const cutting::Cutter& cutter) const {
    const double under = std::max(0.0, stock_.bottom() - tip), above = met_.max_depth + under;
    if (!(met_.max_depth > kNoCut) || above <= cutter.length * (1 + 1e-9)) return {};
    const double depth = units::to_mm(above), flutes = units::to_mm(cutter.length);
    return fail(
        "MC202",
        under > 0
            ? fmt::format("material that is cut reaches {:.3f} mm above the tip, which is {:.3f} mm under the "
                          "stock, but the flute length of the cutter is {:.3f} mm",
                          depth, units::to_mm(under), flutes)
            : fmt::format("the cut is {:.3f} mm deep, but the flute length of the cutter is {:.3f} mm", depth, flutes),
        place(move),
        weight_ ? "the weight of the machine counts: check the masses, the heights of the stock, the depth of the "
                  "program and the cutter's length_mm"
                : "check the heights of the stock, the depth of the program and the cutter's length_mm");
  }

  /// Of a tool that leans, what lies beside its straight part is within the flutes.
  [[nodiscard]] Status only_flutes_meet(const gcode::Move& move, const ToolModel& tool) const {
    if (!tool.ball || stands_upright()) return {};
    const double side = ball_.side_reach, flutes = tool.cutter->length - tool.cutter->radius();
    if (side <= flutes) return {};
    return fail("MC215",
                fmt::format("the tool is tilted, at {}, and meets material {:.1f} mm above the middle of its ball; its "
                            "flutes end {:.1f} mm above it",
                            orientation_in_words(axes_now_), units::to_mm(side), units::to_mm(flutes)),
                place(move), "tilt it away from the wall, or take less depth at once");
  }

  Status may_cut(const gcode::Move& move) const {
    if (move.spindle == gcode::Spindle::off || !(move.spindle_speed > 0)) {
      return fail("MC200", "the spindle does not turn in a cut", place(move),
                  "start it with S and M3 before; a tool change (M6) stops it");
    }
    if (move.spindle == gcode::Spindle::counterclockwise) {
      return fail("MC203", "the spindle turns backwards (M4) in a cut", place(move), "use M3");
    }
    if (!(move.feed > 0)) return fail("MC201", "the feed is 0 in a cut", place(move), "give an F word before");
    if (!stands_as_set_up(job_, move)) {
      return fail("MC204",
                  fmt::format("the tool is at {} in a cut, for which the job is not set up: it is a height map and "
                              "knows only {}",
                              orientation_in_words(move.axes_end), orientation_in_words(job_.tool_frame.axes)),
                  place(move), "predict programs whose cuts all have one orientation of the tool");
    }
    return {};
  }

  /// Compliance of the tip in S at the command point x_S.
  Status compliance(const gcode::Move& move, const Vec3& x_S, Mat3& C) {
    Mat3 C_M;
    const Vec3 p = X_MS_ * x_S;
    probed_ = true;
    if (!probe_.at(p, C_M)) {
      return fail("MC210",
                  fmt::format("the machine cannot reach x {:.3f} y {:.3f} z {:.3f} mm in M: {}", units::to_mm(p.x()),
                              units::to_mm(p.y()), units::to_mm(p.z()), probe_.why()),
                  place(move), "move the workpiece origin");
    }
    if (job_.measured) {
      const statics::MeasuredMap& map = job_.measured->map;
      if (!map.covers(p)) {
        return fail("MC211", "no compliance is known there: in M " + map.why_not(p), place(move),
                    statics::has_compliance(job_.machine)
                        ? "measure there too, or leave the measured compliance out and take that of the joints"
                        : "measure there too");
      }
      C_M = map.at(p);
    }
    C.noalias() = X_MS_.R.transpose() * C_M * X_MS_.R;
    return {};
  }

  const Job& job_;
  const gcode::Program& program_;
  const PassMoves moves_;
  cutting::Stock& stock_;
  const PassOptions& options_;
  const std::function<void(const Sample&)>& visit_;
  const std::function<void(const Sample&, const TeethView&)> teeth_;
  const ToolFrame& frame_;
  const Pose X_MS_;
  statics::Probe probe_;
  bool probed_ = false;  // for a point of this move
  const bool open_ = kinematics::leaves_a_joint_free(job_.machine) || kinematics::is_head_on_linear_axes(job_.machine);
  std::optional<WeightDeflection> weight_;
  std::map<int, ToolModel> models_;
  cutting::DiscsMet met_;
  cutting::BallEngagement ball_;
  std::vector<ForceAlong> around_;
  std::vector<cutting::BallContact> contacts_;
  PassResult result_;
  Incident rapids_;  ///< of the rapid moves since the last cut at a feed
  Sample last_;      ///< the end of the last feed move
  Vec3 last_bent_ = Vec3::Zero();
  Vec3 deflection_ = Vec3::Zero();
  Vec3 last_way_ = Vec3::Zero();  ///< direction at the end of the last feed move
  cutting::EndFootprint footprint_;
  bool end_cuts_ = false;  // on the move at hand
  bool at_end_ = false;    // of it
  // Where the tool turns in cuts: how it stands in S, and from its tip to the lowest point of a ball.
  Mat3 R_ST_ = Mat3::Identity();
  Vec3 lowest_ = Vec3::Zero();
  Vec3 axes_now_ = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
  int tool_now_ = 0;
};

}  // namespace

double look_ahead_length(const cutting::Stock& stock, double radius) {
  return std::max(2 * stock.cell(), 2 * kLookAhead * radius);
}

Result<PassResult> run_pass(const Job& job, const gcode::Program& program, const PassMoves& moves,
                            cutting::Stock& stock, const PassOptions& options,
                            const std::function<void(const Sample&)>& visit) {
  return Pass(job, program, moves, stock, options, visit).run();
}

Result<PassResult> run_pass_of_teeth(const Job& job, const gcode::Program& program, const PassMoves& moves,
                                     cutting::Stock& stock, const PassOptions& options,
                                     const std::function<void(const Sample&, const TeethView&)>& teeth) {
  const std::function<void(const Sample&)> nothing = [](const Sample&) {};
  return Pass(job, program, moves, stock, options, nothing, teeth).run();
}

}  // namespace polypod::machining
