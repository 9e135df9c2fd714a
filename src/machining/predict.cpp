// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/predict.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <tuple>
#include <utility>

#include "aside.hpp"
#include "few.hpp"
#include "in_order.hpp"
#include "modes.hpp"
#include "one_tip.hpp"
#include "plunges.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/ball_stock.hpp"
#include "polypod/cutting/plausibility.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/kinematics/surplus.hpp"
#include "polypod/machine/assumed.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/confidence.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"
#include "polypod/statics/rigid.hpp"
#include "polypod/statics/under_load.hpp"
#include "side.hpp"
#include "way.hpp"

namespace polypod::machining {
namespace {

// Half of a 95 % interval in standard deviations.
constexpr double kHalf95 = 1.96;
// A cut as near as this to the end of a move feels that the controller rounds the corner there, m.
constexpr double kNearCorner = 1e-3;

/// The length of an error; on a plunge without what is held back.
double distance_that_counts(const gcode::Move& programmed, const Vec3& off, const Vec3& axis) {
  if (!is_plunge(programmed, axis)) return off.norm();
  const Vec3 d = programmed.direction(0);
  return (off - d * std::min(0.0, d.dot(off))).norm();
}

/// Whether b goes on from a at the same feed without a corner.
bool goes_on(const gcode::Move& a, const gcode::Move& b) {
  constexpr double kCorner = 0.966;  // cosine of 15 deg
  const auto cuts = [](const gcode::Move& m) {
    return m.kind != gcode::MoveKind::rapid && m.start_known && m.length() > 0;
  };
  return cuts(a) && cuts(b) && a.feed == b.feed && a.end == b.start &&
         a.direction(a.length()).dot(b.direction(0)) > kCorner;
}

/// How near the deflected tip comes to the ends of the programmed moves at which it cuts and beyond which the path does
/// not go on: their spheres.
class Ends {
 public:
  Ends(const LongVector<gcode::Move>& moves, const Vec3& axis)
      : moves_(moves), axis_(axis), start_(moves.size()), end_(moves.size()) {}

  /// The tip on its way along move i, which may pass an end of a neighbour.
  void pass(std::size_t i, const Vec3& bent) {
    near(start_, i, bent);
    near(end_, i, bent);
    if (i > 0) near(end_, i - 1, bent);
    if (i + 1 < moves_.size()) near(start_, i + 1, bent);
  }
  void cuts_at_start(std::size_t i, std::size_t commanded) {
    start_[i].commanded = static_cast<std::int32_t>(commanded);
  }
  void cuts_at_end(std::size_t i, std::size_t commanded) { end_[i].commanded = static_cast<std::int32_t>(commanded); }

  template <class F>
  void each_miss(F&& report) const {
    for (const LongVector<Miss>* ends : {&start_, &end_}) {
      for (std::size_t i = 0; i < ends->size(); ++i) {
        const std::size_t other = ends == &start_ ? i - 1 : i + 1;
        if (other < moves_.size() && goes_on(moves_[std::min(i, other)], moves_[std::max(i, other)])) continue;
        const Miss& miss = (*ends)[i];
        if (miss.commanded >= 0) report(i, static_cast<std::size_t>(miss.commanded), miss.distance);
      }
    }
  }

 private:
  struct Miss {
    double distance = std::numeric_limits<double>::infinity();  ///< m, smallest
    std::int32_t commanded = -1;                                ///< the commanded move that cuts there; -1: none
  };
  void near(LongVector<Miss>& ends, std::size_t i, const Vec3& bent) {
    const Vec3& end = &ends == &start_ ? moves_[i].start : moves_[i].end;
    ends[i].distance = std::min(ends[i].distance, distance_that_counts(moves_[i], bent - end, axis_));
  }

  const LongVector<gcode::Move>& moves_;
  const Vec3 axis_;
  LongVector<Miss> start_, end_;
};

/// On which side of each programmed move the wall stands that most of its points cut. One side a move: where a slot
/// begins and ends the cutter meets one of its walls first.
class Sides {
 public:
  explicit Sides(std::size_t moves) : left_(moves, 0) {}
  void add(std::size_t move, const Sample& sample) { left_[move] += sample.wall_left ? 1 : -1; }
  [[nodiscard]] bool wall_left(std::size_t move) const { return left_[move] > 0; }

 private:
  LongVector<std::int64_t> left_;  ///< points with the wall on the left, less the others
};

/// How far a tool without chips is from the move it stands for, or from one of those beside it: at a corner it may be
/// over either.
double distance_without_chips(const Job& job, const LongVector<gcode::Move>& moves, std::size_t i, const Sample& sample,
                              const Vec3& axis) {
  const Vec3 tip = sample.command + sample.without_chips;
  const auto distance_from = [&](const gcode::Move& move) {
    return path_error(move, tip + middle_beside_tip(job, move, tip, sample.axes), sample.away, axis).distance;
  };
  double least = distance_from(moves[i]);
  for (const std::size_t k : {i - 1, i + 1}) {
    if (k >= moves.size() || moves[k].kind == gcode::MoveKind::rapid || !moves[k].start_known) continue;
    least = std::min(least, distance_from(moves[k]));
  }
  return least;
}

/// The least value on [0, 1] of a convex function, by golden section.
template <class Convex>
double least_on_unit_interval(const Convex& f) {
  constexpr int kSteps = 30;
  constexpr double kShort = 0.3819660112501051;  // (3 - sqrt 5) / 2
  double a = 0, b = 1;
  for (int i = 0; i < kSteps; ++i) {
    const double left = a + kShort * (b - a), right = b - kShort * (b - a);
    (f(left) < f(right) ? b : a) = f(left) < f(right) ? right : left;
  }
  return std::min({f(0), f(1), f(0.5 * (a + b))});
}

/// The smallest distance of a tip that is beyond an end of move i from the moves that go on there at the same feed
/// without a corner: the path of a program in short blocks is that of one long one.
template <class DistanceFrom>
double distance_going_on(const LongVector<gcode::Move>& moves, std::size_t i, const Vec3& tip,
                         const DistanceFrom& distance_from) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = i; k + 1 < moves.size() && moves[k].nearest(tip) >= moves[k].length(); ++k) {
    if (!goes_on(moves[k], moves[k + 1])) break;
    least = std::min(least, distance_from(moves[k + 1]));
  }
  for (std::size_t k = i; k > 0 && moves[k].nearest(tip) <= 0; --k) {
    if (!goes_on(moves[k - 1], moves[k])) break;
    least = std::min(least, distance_from(moves[k - 1]));
  }
  return least;
}

Spread negative(const Spread& s) {
  return {-s.max, -s.mean, -s.min, s.count};
}

Spread together(const Spread& a, const Spread& b) {
  if (a.count == 0 || b.count == 0) return a.count == 0 ? b : a;
  const std::size_t count = a.count + b.count;
  const double mean = a.mean + (b.mean - a.mean) * static_cast<double>(b.count) / static_cast<double>(count);
  return {std::min(a.min, b.min), mean, std::max(a.max, b.max), count};
}

}  // namespace

namespace {

/// Material and forces are taken with the tool along z. A machine whose orientation follows from its position leans its
/// tool: what that does is not judged. Seen at the points that are kept of the way.
std::optional<NotJudged> leaning_tool(const Job& job, const gcode::Program& program, const Way& way,
                                      const std::vector<Sample>& samples) {
  constexpr double kUpright = units::from_deg(0.1);
  double most = 0;
  int move = -1;
  for (const Sample& sample : samples) {
    const Mat3 R_MT = cutting_orientation(job, sample.axes);
    const Pose target{R_MT, job.X_MW * sample.command};
    const double lean = angle_between(kinematics::settled(job.machine, target).value_or(target).R.col(2), R_MT.col(2));
    if (lean > most) {
      most = lean;
      move = sample.move;
    }
  }
  if (most <= kUpright) return {};
  const gcode::Block block =
      program.blocks[static_cast<std::size_t>(way.commanded()[static_cast<std::size_t>(move)].block)];
  return NotJudged{block.line,
                   fmt::format("the machine tilts its tool by up to {:.1f} deg, and material and forces are computed "
                               "with the tool along z",
                               units::to_deg(most)),
                   fmt::format("a machine that keeps its tool at zero tilt, or a place of the part where this one "
                               "tilts it by less than {:g} deg (origin_mm of the job)",
                               units::to_deg(kUpright))};
}

/// Rapids of which the way is not known and which end, or begin, below the top of the stock: whether they go through it
/// is not judged. Where Z alone is not known before a rapid straight down, its end is enough.
std::vector<NotJudged> unknown_rapids(const Job& job, const gcode::Program& program, const PassMoves& moves) {
  std::vector<NotJudged> out;
  for (std::size_t i = 0; i < moves.size(); ++i) {
    const gcode::Move& move = moves[i];
    if (move.kind != gcode::MoveKind::rapid) continue;
    if (job.tool_frame.tilted || job.tool_frame.turns || !stands_as_set_up(job, move)) {
      if ((move.start_known && stands_as_set_up(job, move)) || stays_clear(job, move)) continue;
      out.push_back({program.blocks[static_cast<std::size_t>(move.block)].line,
                     move.start_known
                         ? "this rapid has another orientation of the tool than the cuts, or turns it, beside the "
                           "stock: whether it goes through material is not known"
                         : "this rapid comes from an unknown place to beside the stock: whether it goes through "
                           "material is not known",
                     "retract above the stock, give X, Y and Z, and turn the tool there"});
      continue;
    }
    if (move.start_known) continue;
    const bool low = (move.known_end[2] && move.end.z() < job.stock.top()) ||
                     (move.known_start[2] && move.start.z() < job.stock.top());
    const bool straight_down = move.known_start[0] && move.known_start[1] && move.known_end[0] && move.known_end[1] &&
                               move.start.head<2>() == move.end.head<2>();
    if (!low || (straight_down && !meets_stock(job, move))) continue;
    out.push_back({program.blocks[static_cast<std::size_t>(move.block)].line,
                   "this rapid comes from an unknown place to below the top of the stock: whether it goes through "
                   "material is not known",
                   "retract above the stock and give X, Y and Z before, as in G0 Z... and then G0 X... Y..."});
  }
  return out;
}

/// Ways to places of the machine (G28, G30, G53), which no program tells: at a feed all, for they may cut; rapids that
/// begin in the material, where they lead aside. Z alone of a rapid is taken to go up.
std::vector<NotJudged> departures(const Job& job, const gcode::Program& program, const LongVector<gcode::Move>& moves) {
  std::vector<NotJudged> out;
  std::size_t next = 0, left = 0;  // the first move behind the block, and behind the last such way
  for (std::size_t b = 0; b < program.blocks.size() && !moves.empty(); ++b) {
    while (next < moves.size() && static_cast<std::size_t>(moves[next].block) < b) ++next;
    const gcode::Block block = program.blocks[b];
    if (next == 0 || block.words.empty() || block.after_end || (block.optional && job.block_delete)) continue;
    const auto is = [&](char letter, double value) {
      return std::any_of(block.words.begin(), block.words.end(),
                         [&](const gcode::Word& w) { return w.letter == letter && w.value == value; });
    };
    const auto names = [&](char letter) {
      return std::any_of(block.words.begin(), block.words.end(),
                         [&](const gcode::Word& w) { return w.letter == letter; });
    };
    if (!is('G', 28) && !is('G', 30) && !is('G', 53)) continue;
    const bool cuts_before = moves[next - 1].kind != gcode::MoveKind::rapid;  // the mode, where the block names none
    if (is('G', 53) && (is('G', 1) || (cuts_before && !is('G', 0)))) {
      out.push_back({block.line,
                     "this move at a feed goes to a place of the machine that the program does not tell: what it cuts "
                     "is not known",
                     "go there with G0, or say the place in coordinates of the workpiece"});
      continue;
    }
    if (std::exchange(left, next) == next) continue;  // behind another of these
    if (names('Z') && !names('X') && !names('Y')) continue;
    gcode::Move here = moves[next - 1];
    if (!here.known_end[2]) continue;
    here.kind = gcode::MoveKind::rapid;
    here.start = here.end;
    here.axes_start = here.axes_end;
    if (!meets_stock(job, here)) continue;
    out.push_back({block.line,
                   "this rapid goes from within the stock to a place of the machine that the program does not tell: "
                   "whether it goes through material is not known",
                   "retract above the stock before, as in G0 Z..."});
  }
  return out;
}

/// Whether an end of the move lies over the stock.
bool meets_plan(const Job& job, const gcode::Move& move) {
  const Vec3 low = job.stock.min(), high = job.stock.max();
  const auto over = [&](const Vec3& p) {
    return p.x() > low.x() && p.x() < high.x() && p.y() > low.y() && p.y() < high.y();
  };
  const Vec3 start = job.tool_frame.to_S(move.start), end = job.tool_frame.to_S(move.end);
  return over(start) || over(end) || over(0.5 * (start + end));
}

/// Where most of the way over the stock passes above its top, and later levels of the same paths cut, the stock of the
/// job stands lower than the one that the program was made for, and what is really cut is not known. Feed moves that
/// only go from one cut to the next have no level below them.
std::optional<NotJudged> stock_too_low(const Job& job, const Way& way) {
  constexpr double kMost = 0.5;  // of the way over the stock
  constexpr double kSame = 1e-6;
  const double top = job.stock.top();
  const auto counts = [&](const gcode::Move& move) {
    return move.kind != gcode::MoveKind::rapid && move.start_known && meets_plan(job, move) &&
           !job.tool_frame.to_S(move.end - move.start)
                .head<2>()
                .isZero(job.tool_frame.tilted ? kSame : 0);  // an approach
  };
  const auto lowest = [&](const gcode::Move& move) {
    return std::min(job.tool_frame.to_S(move.start).z(), job.tool_frame.to_S(move.end).z());
  };
  double over = 0, most_above = 0;
  for (const gcode::Move& move : *way.programmed) {
    if (!counts(move)) continue;
    over += move.length();
    if (!(lowest(move) < top)) most_above += move.length();
  }
  constexpr double kRounding = 1e-9;                              // of sums in another order
  if (!(most_above * (1 + kRounding) > kMost * over)) return {};  // whatever lies below them
  struct Level {
    std::array<long long, 4> path;  // its ends in the plane, whatever the direction
    std::size_t move;
    double length, lowest;
  };
  LongVector<Level> levels;
  for (std::size_t i = 0; i < way.programmed->size(); ++i) {
    const gcode::Move& move = (*way.programmed)[i];
    if (!counts(move)) continue;
    const Vec3 start = job.tool_frame.to_S(move.start), end = job.tool_frame.to_S(move.end);
    std::array<long long, 4> path{std::llround(start.x() / kSame), std::llround(start.y() / kSame),
                                  std::llround(end.x() / kSame), std::llround(end.y() / kSame)};
    if (std::pair(path[2], path[3]) < std::pair(path[0], path[1])) {
      std::swap(path[0], path[2]);
      std::swap(path[1], path[3]);
    }
    levels.push_back({path, i, move.length(), lowest(move)});
  }
  std::sort(levels.begin(), levels.end(),
            [](const Level& a, const Level& b) { return std::tie(a.path, a.move) < std::tie(b.path, b.move); });
  double above = 0, highest = 0;
  std::size_t first = way.programmed->size();
  for (std::size_t i = 0, end = 0; i < levels.size(); i = end) {
    const std::array<long long, 4> path = levels[i].path;
    bool cuts = false;
    for (end = i; end < levels.size() && levels[end].path == path; ++end) cuts = cuts || levels[end].lowest < top;
    for (std::size_t k = i; cuts && k < end; ++k) {
      const Level level = levels[k];
      if (level.lowest < top) continue;
      above += level.length;
      highest = std::max(highest, level.lowest - top);
      first = std::min(first, level.move);
    }
  }
  if (!(above > kMost * over)) return {};
  return NotJudged{way.lines->blocks[static_cast<std::size_t>((*way.programmed)[first].block)].line,
                   fmt::format("{:.0f} % of the feed path over the stock pass above its top, by up to {:.3f} mm, on "
                               "paths that cut at a lower level: if the part stands higher than the stock of the job, "
                               "the tool cuts there",
                               100 * above / over, units::to_mm(highest)),
                   "give the height of the stock as it lies on the table, or leave out the levels that cut air"};
}

}  // namespace

bool is_plunge(const gcode::Move& move, const Vec3& axis) {
  constexpr double kSteep = 0.866;  // sine of 60 deg
  return move.kind == gcode::MoveKind::line && move.length() > 0 && move.direction(0).dot(axis) < -kSteep;
}

Vec3 to_correct(const gcode::Move& move, const Vec3& deflection, const Vec3& axis) {
  if (!is_plunge(move, axis)) return deflection;
  const Vec3 d = move.direction(0);
  return deflection - d * d.dot(deflection);
}

PathError path_error(const gcode::Move& programmed, const Vec3& bent, const Vec3& away, const Vec3& axis) {
  const Vec3 off = bent - programmed.point(programmed.nearest(bent));
  return {off.dot(away), off.dot(axis), distance_that_counts(programmed, off, axis)};
}

Sample judged(const Sample& sample, const PathError& error) {
  Sample out = sample;
  out.normal = static_cast<float>(error.normal);
  out.vertical = static_cast<float>(error.vertical);
  out.distance = static_cast<float>(error.distance);
  return out;
}

namespace {
/// mm3, to two digits or whole.
std::string volume_in_words(double volume) {
  const double mm3 = units::to_mm3(volume);
  return mm3 < 10 ? fmt::format("{:.2g}", mm3) : fmt::format("{:.0f}", mm3);
}
}  // namespace

std::vector<std::string> pass_notes(const Job& job, const gcode::Program& program, const PassResult& pass) {
  std::vector<std::string> notes;
  const auto line_of = [&](const Incident& i) { return program.blocks[static_cast<std::size_t>(i.block)].line; };
  int touches = 0, first_touch = 0, ends = 0, first_end = 0;
  double touched = 0;
  for (const Incident& incident : pass.incidents) {
    if (incident.kind == Incident::Kind::end_cut) {
      if (ends++ == 0) first_end = line_of(incident);
      continue;
    }
    if (touches++ == 0) first_touch = line_of(incident);
    touched += incident.volume;
  }
  if (touches > 0) {
    notes.push_back(fmt::format("{} rapid {} (G0; first in line {}) {} {} mm3 of material in all", touches,
                                touches == 1 ? "move" : "moves", first_touch, touches == 1 ? "takes" : "take",
                                volume_in_words(touched)));
  }
  if (ends > 0 && !job.material.end) {
    notes.push_back(
        fmt::format("{} (first in line {}) with the end of the cutter; the material has no coefficients for it (its "
                    "table `end`), so "
                    "the tangential Ktc of the sides is taken for the thrust along the axis: an assumption",
                    ends == 1 ? std::string("one move cuts") : fmt::format("{} moves cut", ends), first_end));
  }
  if (pass.not_converged > 0) {
    notes.push_back(fmt::format("the equilibrium of {} of {} points still moved by up to {:.2f} um", pass.not_converged,
                                pass.points, units::to_um(pass.largest_rest)));
  }
  return notes;
}

namespace {

// From this share of the feed path without a cut, a stock that is not the one on the table is likelier than a program
// with long ways through air.
constexpr double kMostlyIdle = 0.5;

/// Where most of the feed path cuts nothing: the stock of the job may not be the one on the table.
std::optional<std::string> note_on_air(const LongVector<gcode::Move>& programmed, const Prediction& prediction) {
  std::vector<bool> cuts(programmed.size(), false);
  for (const MovePrediction& m : prediction.moves) cuts[static_cast<std::size_t>(m.move)] = m.points > 0;
  double length = 0, idle = 0;
  int moves = 0, idle_moves = 0;
  for (std::size_t i = 0; i < programmed.size(); ++i) {
    const gcode::Move& move = programmed[i];
    // Approaches and retracts along the tool go through air in every program.
    if (move.kind == gcode::MoveKind::rapid) continue;
    if (move.kind == gcode::MoveKind::line && (move.end - move.start).head<2>().isZero(0)) continue;
    ++moves;
    length += move.length();
    if (cuts[i]) continue;
    ++idle_moves;
    idle += move.length();
  }
  if (!(idle > kMostlyIdle * length)) return {};
  return fmt::format(
      "{} of {} feed moves, {:.0f} % of their length, cut no material: check the stock of the job, its "
      "height first",
      idle_moves, moves, 100 * idle / length);
}

}  // namespace

std::vector<std::string> condition_notes(const Job& job, const LongVector<gcode::Move>& programmed,
                                         const Prediction& prediction) {
  std::vector<std::string> notes;
  if (auto note = note_on_air(programmed, prediction)) notes.push_back(std::move(*note));
  if (kinematics::leaves_a_joint_free(job.machine)) notes.emplace_back(kOneChoice);
  if (auto side = note_on_side(job.machine)) notes.push_back(std::move(*side));
  if (auto tools = note_on_one_tip(programmed)) notes.push_back(std::move(*tools));
  if (machine::limits_are_assumed(job.machine))
    notes.push_back(fmt::format("limits of the joints are not judged: {}", machine::kAssumedLimits));
  if (std::string rigid = statics::rigid_parts_in_words(job.machine); !job.measured && !rigid.empty())
    notes.push_back(std::move(rigid));
  if (job.factors.force != 1 || job.factors.compliance != 1) {
    notes.push_back(
        fmt::format("forces are {:.3g} times those of the material, compliances {:.3g} times those of the "
                    "machine: [factors] of the job",
                    job.factors.force, job.factors.compliance));
  }
  if (job.weights) {
    notes.emplace_back(
        "the deflection by the machine's own weight is counted, against that at the origin of the workpiece; where an "
        "uncertainty is said, that of this part is not in it");
  }
  if (!job.cutters.empty()) {
    std::set<int> without;
    for (const MovePrediction& m : prediction.moves) {
      const int tool = programmed[static_cast<std::size_t>(m.move)].tool;
      if (m.points > 0 && !job.cutters.contains(tool)) without.insert(tool);
    }
    for (const int tool : without) {
      notes.push_back(fmt::format("T{} has no [[tool]] in the job; [cutter] is taken, {:g} mm in diameter", tool,
                                  units::to_mm(job.cutter.diameter)));
    }
  }
  bool ball = false, bull_nose = false;
  for (const MovePrediction& m : prediction.moves) {
    if (m.points == 0) continue;
    const cutting::Cutter& cutter = job.cutter_of(programmed[static_cast<std::size_t>(m.move)].tool);
    (cutting::is_ball(cutter) ? ball : bull_nose) |= cutter.corner_radius > 0;
  }
  if (bull_nose) {
    notes.push_back(
        "the corner of a bull nose cuts with the coefficients of its side; on ways down its end cuts with those of an "
        "end");
  }
  if (ball) {
    notes.push_back(
        "a ball cuts with the coefficients of its side down to its tip, where the teeth hardly move: near the tip they "
        "are an assumption");
  }
  const double rotation = rotation_of(job.X_MW);
  constexpr double kTurned = 1e-6;  // rad
  if ((job.tool_frame.tilted || job.tool_frame.turns) && std::abs(rotation) > kTurned &&
      kinematics::task(job.machine).names_axis()) {
    notes.push_back(fmt::format(
        "the part is turned by {:g} deg, and A and B, which are axes of the machine, do not turn with it: the "
        "program must be posted for the part as it lies",
        units::to_deg(rotation)));
  }
  if (job.tool_frame.turns) {
    notes.push_back(
        "undercuts of the tilted ball are not known: what stands above a place that is cut counts as cut away");
  }
  std::set<std::string> known;
  bool too_fast = false;
  for (const MovePrediction& m : prediction.moves) {
    const gcode::Move& move = programmed[static_cast<std::size_t>(m.move)];
    const cutting::Cutter& cutter = job.cutter_of(move.tool);
    if (!(move.spindle_speed > 0)) continue;
    const double per_tooth = move.feed / (move.spindle_speed * cutter.teeth);
    if (const double most = job.controller.planner.velocity; move.feed > most && !std::exchange(too_fast, true)) {
      notes.push_back(
          fmt::format("line {}: the controller goes at {:.0f} mm/min at most, [controller] max_velocity_mm_per_s, and "
                      "not at {:.0f}: "
                      "chips are thinner and the tool deflects less than is said, which is for the programmed feed",
                      m.line, units::to_mm_per_min(most), units::to_mm_per_min(move.feed)));
    }
    for (std::string& note : cutting::plausibility(cutter, job.material, per_tooth, move.spindle_speed)) {
      if (known.size() < 8 && known.insert(note).second) notes.push_back(fmt::format("line {}: {}", m.line, note));
    }
  }
  return notes;
}

double resolution(const Job& job) {
  return 0.02 * job.tolerance;
}

bool Prediction::within(const Job& job) const {
  return not_judged.empty() && largest_with_corners <= job.tolerance - resolution(job) &&
         (!other_switch || other_switch->within_tolerance);
}

bool Prediction::all_judged() const {
  return not_judged.empty() && !(steep.distance > 0) && slow.count == 0 && plunges.empty() &&
         !(other_switch && other_switch->not_all_judged());
}

Unjudged Prediction::farthest_not_judged() const {
  Unjudged out{steep.distance, steep.line, "the force rises or falls quickly", 0};
  if (slow.count > 0 && slow.distance > out.distance)
    out = {slow.distance, slow.line, "the controller slows down in the cut", 0};
  for (const Plunge& p : plunges)
    if (p.distance > out.distance) out = {p.distance, p.line, "a plunge ends", 0};
  out.places = (steep.distance > 0 ? 1 : 0) + slow.count + plunges.size();
  return out;
}

void SlowCorners::add(double there, double of_feed, int at_line, double tolerance) {
  if (there <= tolerance) {
    if (there > within) {
      within = there;
      within_line = at_line;
    }
    return;
  }
  ++count;
  if (there <= distance) return;
  distance = there;
  share = of_feed;
  line = at_line;
}

std::string SlowCorners::in_words(const char* um) const {
  return fmt::format(
      "{} in a cut, where the controller slows down, to {:.0f} % of the feed or less at the worst: chips are thinner "
      "there, and the tool deflects less than at the feed, as far as the machine springs back within a few teeth; it "
      "may be up to {:.0f} {} from the programmed path there (line {})",
      count == 1 ? "a corner or stop" : fmt::format("{} corners and stops", count), 100 * share, units::to_um(distance),
      um, line);
}

Status no_rapid_cuts(const Job& job, const gcode::Program& program, const PassResult& pass) {
  const Incident* worst = nullptr;
  const Incident* first = nullptr;
  std::size_t ways = 0, touches = 0;
  int last = -1;
  double in_all = 0;
  for (const Incident& incident : pass.incidents) {
    if (incident.kind != Incident::Kind::rapid_through_stock) continue;
    if (first == nullptr) first = &incident;
    ++touches;
    in_all += incident.volume;
    if (incident.volume_so_far <= job.rapid_volume) continue;
    if (incident.first_block != last) ++ways;
    last = incident.first_block;
    if (worst == nullptr || incident.volume_so_far > worst->volume_so_far) worst = &incident;
  }
  const auto line = [&](int block) { return program.blocks[static_cast<std::size_t>(block)].line; };
  // Many touches are a cut, too.
  constexpr double kTouches = 10, kShare = 0.01;
  if (worst == nullptr && in_all > std::max(kTouches * job.rapid_volume, kShare * pass.removed)) {
    return fail(
        "MC304",
        fmt::format("{} rapid moves (G0) go through {} mm3 of material in all, each through little; the program "
                    "removes {} mm3",
                    touches, volume_in_words(in_all), volume_in_words(pass.removed)),
        Place{program.path, line(first->block), 1},
        fmt::format("cut at a feed, or check the stock of the job; up to {:g} times rapid_volume_mm3 = {:g}, or "
                    "{:g} % of what is removed, are touches",
                    kTouches, units::to_mm3(job.rapid_volume), 100 * kShare));
  }
  if (worst == nullptr) return {};
  const bool many = worst->first_block != worst->block;
  return fail(
      "MC304",
      fmt::format("{} through {} mm3 of material{}",
                  many ? fmt::format("these rapid moves (G0, to line {}) go", line(worst->block))
                       : std::string("this rapid move (G0) goes"),
                  volume_in_words(worst->volume_so_far),
                  ways > 1 ? fmt::format(", and {} others through some", ways - 1) : ""),
      Place{program.path, line(worst->first_block), 1},
      fmt::format("{}, or check the stock of the job; up to rapid_volume_mm3 = {:g} a move is a touch",
                  job.weights ? "retract first, farther than the weight of the machine deflects it" : "retract first",
                  units::to_mm3(job.rapid_volume)));
}

namespace {

/// Where force and bend change too quickly for what was found: see Steep.
class SteepPlaces {
 public:
  SteepPlaces(const Job& job, const Way& way) : job_(job), moves_(way.commanded()), axis_(job.tool_frame.axis()) {}

  /// A point that cuts, of the programmed move `source`, whose bend found is `distance` from it.
  void see(const Sample& sample, double distance, const gcode::Move& programmed, int source, int line) {
    const gcode::Move& move = moves_[static_cast<std::size_t>(sample.move)];
    const double window = look_ahead_length(job_.stock, job_.cutter_of(move.tool).radius());
    if (source != source_) lag_ = sample.deflection;
    if (source != source_ || sample.move != move_) {
      before_.clear();
      first_ = 0;
    }
    const double step = source == source_ ? (sample.command - last_).norm() : 0;
    source_ = source;
    move_ = sample.move;
    last_ = sample.command;
    before_.push_back({sample.s, sample.deflection});
    while (sample.s - before_[first_].s > window) ++first_;
    const double length = std::max(lag_.norm(), kLeastLag);
    lag_ += (1 - std::exp(-step / length)) * (sample.deflection - lag_);

    const double tube = job_.tolerance - resolution(job_);
    if (distance > tube) return;
    double most = 0;
    for (const Vec3& other : {before_[first_].deflection, lag_}) {
      if ((other - sample.deflection).norm() < resolution(job_)) continue;
      const Vec3 tip = sample.command + other, middle = middle_beside_tip(job_, programmed, tip, sample.axes);
      most = std::max(most, path_error(programmed, tip + middle, sample.away, axis_).distance);
    }
    if (most <= job_.tolerance) {
      if (most > out_.within) {
        out_.within = most;
        out_.within_line = line;
      }
      return;
    }
    out_.length += step;
    if (most <= out_.distance) return;
    out_.distance = most;
    out_.window = window;
    out_.line = line;
  }

  [[nodiscard]] const Steep& found() const { return out_; }

 private:
  static constexpr double kLeastLag = 1e-6;  // m
  struct Bend {
    double s = 0;
    Vec3 deflection;
  };
  const Job& job_;
  const PassMoves moves_;
  const Vec3 axis_;
  std::vector<Bend> before_;  ///< of the commanded move at hand
  std::size_t first_ = 0;     ///< the first of them within the window
  Vec3 lag_ = Vec3::Zero(), last_ = Vec3::Zero();
  int move_ = -1, source_ = -1;
  Steep out_;
};

}  // namespace

Result<Prediction> predict_way(const Job& job, const gcode::Program& program, const Way& way,
                               const PredictOptions& options) {
  cutting::Stock scratch;
  return predict_way(job, program, way, options, scratch);
}

Result<Prediction> predict_way(const Job& job, const gcode::Program& program, const Way& way,
                               const PredictOptions& options, cutting::Stock& scratch,
                               const std::function<Vec3(const Sample&)>& besides) {
  const LongVector<gcode::Move>& programmed = *way.programmed;
  const PassMoves commanded = way.commanded();
  Prediction out;
  out.commanded_distance.assign(commanded.size(), 0);
  out.commanded_ends.assign(commanded.size(), {});
  out.commanded_without_chips.assign(commanded.size(), {});
  Few few;
  const Vec3 axis = job.tool_frame.axis();
  LongVector<int> index(programmed.size(), -1);  // of the programmed move in out.moves
  const auto entry = [&](std::size_t i) -> MovePrediction& {
    if (index[i] < 0) {
      index[i] = static_cast<int>(out.moves.size());
      MovePrediction m;
      m.move = static_cast<int>(i);
      m.block = programmed[i].block;
      m.line = way.lines->blocks[static_cast<std::size_t>(m.block)].line;
      m.length = programmed[i].length();
      out.moves.push_back(m);
    }
    return out.moves[static_cast<std::size_t>(index[i])];
  };
  const auto source = [&](std::size_t c) { return way.source.empty() ? static_cast<int>(c) : way.source[c]; };
  Ends ends(programmed, axis);
  Sides sides(programmed.size());
  SteepPlaces steep(job, way);
  HeldBack held_back(job, way, options.step > 0 ? options.step : job.step);
  const auto off_by = [&](std::size_t i, std::size_t c, double distance) {
    entry(i).largest_distance = std::max(entry(i).largest_distance, distance);
    out.commanded_distance[c] = std::max(out.commanded_distance[c], distance);
    out.largest_distance = std::max(out.largest_distance, distance);
  };
  // Where the tool stands in the end: after the move that takes the load off, and where it does not go on cutting.
  const auto ends_plunge = [&](std::size_t c, std::size_t i, const Sample& sample) {
    return is_plunge(programmed[i], axis) && sample.s >= commanded[c].length() &&
           (c + 1 == commanded.size() || commanded[c + 1].kind == gcode::MoveKind::rapid);
  };
  const double grain = resolution(job);
  // What the edges alone do to the tool where the last commanded move cuts at its end; nothing where it does not.
  std::optional<Vec3> edges;
  // In a dwell the chips go, and the tool comes to rest between its command and where the edges hold it: surely as far
  // off as the nearest of these places, perhaps as far as the farthest of them, which is one of both.
  const auto comes_to_rest = [&](std::size_t c, std::size_t i, const Sample& sample) {
    if (!commanded.transition(c)) edges = sample.cutting ? std::optional(sample.without_chips) : std::nullopt;
    if (!edges || (c + 1 < commanded.size() && static_cast<std::size_t>(source(c + 1)) == i)) return;
    const Dwell dwell = dwell_after(programmed, *way.lines, i);
    if (!(dwell.possible > 0)) return;
    const auto distance_by = [&](double share) {
      Sample at_rest = sample;
      at_rest.without_chips = sample.weight + share * (*edges - sample.weight);
      return distance_without_chips(job, programmed, i, at_rest, axis);
    };
    out.commanded_without_chips[c].at_rest = static_cast<float>(std::max(distance_by(0), distance_by(1)));
    out.commanded_ends[c].end = true;
    if (!(dwell.certain * programmed[i].spindle_speed >= 1)) return;  // a revolution
    off_by(i, c, least_on_unit_interval(distance_by));
    held_back.rest(i, sample.command + sample.weight, sample.command + *edges);
  };
  const auto visit = [&](const Sample& sample) {
    const auto c = static_cast<std::size_t>(sample.move);
    const auto i = static_cast<std::size_t>(source(c));
    const Vec3 bent = sample.bent();
    ends.pass(i, bent);
    if (sample.s >= commanded[c].length()) comes_to_rest(c, i, sample);
    if (job.weights && index[i] >= 0 && ends_plunge(c, i, sample)) {
      // The thrust goes in the dwell, the weight of the machine stays.
      off_by(i, c, (sample.command + sample.weight - programmed[i].end).norm());
    }
    if (!sample.cutting) {
      if (options.keep_samples) out.samples.push_back(sample);
      return;
    }
    const bool transition = commanded.transition(c);
    const double length = commanded[c].length();
    if (!transition) {
      const bool first = c == 0 || source(c - 1) != source(c) || commanded.transition(c - 1);
      const bool last = c + 1 == commanded.size() || source(c + 1) != source(c) || commanded.transition(c + 1);
      if (first && sample.s == 0) ends.cuts_at_start(i, c);
      if (last && sample.s >= length) ends.cuts_at_end(i, c);
    }
    const auto error_against = [&](const gcode::Move& move) {
      return path_error(move, bent + middle_beside_tip(job, move, bent, sample.axes), sample.away, axis);
    };
    PathError e = error_against(programmed[i]);
    MovePrediction& m = entry(i);
    if (transition || options.beside) {
      // A transition belongs to the moves that it joins.
      if (i > 0 && programmed[i - 1].kind != gcode::MoveKind::rapid) {
        e.distance = std::min(e.distance, error_against(programmed[i - 1]).distance);
      }
      if (i + 1 < programmed.size() && programmed[i + 1].kind != gcode::MoveKind::rapid) {
        e.distance = std::min(e.distance, error_against(programmed[i + 1]).distance);
      }
    }
    if (e.distance > grain) {
      e.distance = std::min(e.distance, distance_going_on(programmed, i, bent, [&](const gcode::Move& move) {
                              return error_against(move).distance;
                            }));
    }
    m.largest_distance = std::max(m.largest_distance, e.distance);
    out.commanded_distance[c] = std::max(out.commanded_distance[c], e.distance);
    if (!transition && (sample.s == 0 || sample.s >= length)) {
      Prediction::WithoutChips& ends_of_c = out.commanded_without_chips[c];
      float& there = sample.s == 0 ? ends_of_c.start : ends_of_c.end;
      there = static_cast<float>(distance_without_chips(job, programmed, i, sample, axis));
    }
    const double near = std::min(kNearCorner, 0.5 * length);
    out.commanded_ends[c].start = out.commanded_ends[c].start || sample.s <= near;
    out.commanded_ends[c].end = out.commanded_ends[c].end || sample.s >= length - near;
    out.largest_distance = std::max(out.largest_distance, e.distance);
    if (options.keep_samples) out.samples.push_back(judged(sample, e));
    if (!transition) steep.see(sample, e.distance, programmed[i], static_cast<int>(i), m.line);
    if (!transition) held_back.see(i, sample);
    if (transition) return;  // taken to change evenly, not computed: no part of the means
    few.add(sample);
    ++m.points;
    m.deflection.add(sample.deflection.norm());
    if (!sample.away.isZero(0)) m.normal.add(e.normal);  // a plunge has no normal in the plane
    m.vertical.add(e.vertical);
    m.mean_force += (sample.force - m.mean_force) / static_cast<double>(m.points);
    m.mean_force_size += (sample.force.norm() - m.mean_force_size) / static_cast<double>(m.points);
    m.largest_depth = std::max<double>(m.largest_depth, sample.depth);
    sides.add(i, sample);
    out.deflection.add(sample.deflection.norm());
    out.vertical.add(e.vertical);
  };
  scratch = job.stock;
  PassOptions pass_options;
  pass_options.bend = options.bend;
  pass_options.step = options.step > 0 ? options.step : job.step;
  pass_options.progress = options.progress;
  InOrder<Sample> judge([&](const Sample& sample) {
    if (!besides) return visit(sample);
    Sample moved = sample;
    const Vec3 by = besides(sample);
    moved.deflection += by;
    moved.without_chips += by;
    visit(moved);
  });
  auto passed = run_pass(job, program, commanded, scratch, pass_options, [&](const Sample& s) { judge.take(s); });
  judge.finish();
  POLYPOD_ASSIGN(pass, std::move(passed));
  out.pass = std::move(pass);
  out.few = few.take();
  out.steep = steep.found();
  for (MovePrediction& m : out.moves) {
    if (sides.wall_left(static_cast<std::size_t>(m.move))) m.normal = negative(m.normal);
    out.normal = together(out.normal, m.normal);
  }
  const auto turn = [&](Sample& sample) {
    if (!sides.wall_left(static_cast<std::size_t>(source(static_cast<std::size_t>(sample.move))))) return;
    sample.away = -sample.away;
    sample.normal = -sample.normal;
  };
  std::for_each(out.samples.begin(), out.samples.end(), turn);
  std::for_each(out.few.begin(), out.few.end(), turn);
  ends.each_miss(off_by);
  for (const Unsettled& u : out.pass.unsettled) {
    if (u.rest <= resolution(job)) continue;
    out.not_judged.push_back(
        {program.blocks[static_cast<std::size_t>(u.block)].line,
         fmt::format("force and deflection do not settle: they still move by {:.1f} um", units::to_um(u.rest))});
  }
  const auto earlier = [](const MovePrediction& a, const MovePrediction& b) { return a.move < b.move; };
  if (!std::is_sorted(out.moves.begin(), out.moves.end(), earlier)) {
    std::sort(out.moves.begin(), out.moves.end(), earlier);
  }
  for (const MovePrediction& m : out.moves) {
    if (m.line == out.steep.line) out.steep.elsewhere = std::max(out.steep.elsewhere, m.largest_distance);
  }
  out.plunges = held_back.take(out.plunge_within);
  if (auto leaning = leaning_tool(job, program, way, out.few)) out.not_judged.push_back(std::move(*leaning));
  if (auto higher = stock_too_low(job, way)) out.not_judged.push_back(std::move(*higher));
  for (NotJudged& rapid : unknown_rapids(job, program, commanded)) out.not_judged.push_back(std::move(rapid));
  for (NotJudged& rapid : departures(job, program, *way.programmed)) out.not_judged.push_back(std::move(rapid));
  return out;
}

Way way_as_programmed(const gcode::Program& program, const LongVector<gcode::Move>& moves) {
  return {&program, &moves, {}, {}};
}

Result<Prediction> predict_accepted(const Job& job, const gcode::Program& program,
                                    const gcode::Interpretation& interpretation, const PredictOptions& options,
                                    cutting::Stock& scratch) {
  POLYPOD_ASSIGN(out, predict_way(job, program, way_as_programmed(program, interpretation.moves), options, scratch));
  if (out.moves.empty()) return tl::unexpected(cuts_nothing(job, program, interpretation));
  return out;
}

cutting::Material varied(const cutting::Material& material, const std::array<double, 6>& by) {
  cutting::Material m = material;
  m.ktc += by[0];
  m.krc += by[1];
  m.kac += by[2];
  m.kte += by[3];
  m.kre += by[4];
  m.kae += by[5];
  return m;
}

bool says_that_nothing_is_cut(const Error& error) {
  return error.id == "MC301" || error.id == "MC302";
}

Result<OtherPosition> OtherPosition::of(const Job& job, const gcode::Program& program,
                                        const gcode::Interpretation& interpretation,
                                        const std::function<bool(double)>& progress) {
  OtherPosition out;
  out.given_ = &interpretation;
  const auto here = [&](Error error) { return tl::unexpected(at_switch(std::move(error), !job.block_delete)); };
  Result<Accepted> accepted = accept(job, program, interpretation, {true, progress});
  if (accepted) {
    out.accepted_ = std::move(*accepted);
    return out;
  }
  if (!says_that_nothing_is_cut(accepted.error())) return here(std::move(accepted.error()));
  if (Status reach = accept_reach(job, program, interpretation, progress); !reach) return here(reach.error());
  return out;
}

namespace {

Result<OtherSwitch> other_switch_of(const Job& job, const gcode::Program& program,
                                    const gcode::Interpretation& interpretation, const PredictOptions& options) {
  OtherSwitch other;
  other.block_delete = !job.block_delete;
  POLYPOD_ASSIGN(position, OtherPosition::of(job, program, interpretation, options.progress));
  PredictOptions quiet = options;
  quiet.keep_samples = quiet.keep_stock = false;
  const Way way = way_as_programmed(program, position.moves());
  POLYPOD_ASSIGN(p, predict_way(job, program, way, quiet));
  other.cuts = !p.moves.empty();
  const Corners corners = corners_of(job, program, way, p, job.tolerance - resolution(job));
  other.distance_before = other.distance_after = corners.largest_with;
  other.line = corners.line;
  other.slow = corners.slow;
  if (Status free = no_rapid_cuts(job, program, p.pass); !free)
    other.collision = at_switch(free.error(), other.block_delete);
  if (!p.not_judged.empty())
    other.reason = fmt::format("line {}: {}", p.not_judged.front().line, p.not_judged.front().why);
  other.within_tolerance =
      other.distance_after <= job.tolerance - resolution(job) && p.not_judged.empty() && !other.collision;
  other.steep = p.steep;
  other.plunges = p.plunges;
  return other;
}

/// With the program's own blocks, or, where these were unrolled for one position, with those for the other.
Result<std::optional<OtherSwitch>> other_switch_of(const Job& job, const gcode::Program& program,
                                                   const PredictOptions& options) {
  if (options.one_position) return std::nullopt;
  if (options.other != nullptr) {
    POLYPOD_ASSIGN(out, other_switch_of(job, options.other->program, options.other->interpretation, options));
    out.fixed = true;
    return out;
  }
  if (!has_optional_blocks(program)) return std::nullopt;
  gcode::InterpretOptions interpret_options = job.interpret_options();
  interpret_options.block_delete = !job.block_delete;
  Result<gcode::Interpretation> run = gcode::interpret(program, interpret_options);
  if (!run) return tl::unexpected(at_switch(std::move(run.error()), interpret_options.block_delete));
  POLYPOD_ASSIGN(out, other_switch_of(job, program, *run, options));
  return out;
}

}  // namespace

Result<Prediction> predict(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                           const PredictOptions& options) {
  cutting::Stock scratch;
  POLYPOD_ASSIGN(out, predict_in(job, program, interpretation, options, scratch));
  if (options.keep_stock) out.stock_left = std::move(scratch);
  return out;
}

Result<Prediction> predict_in(const Job& job, const gcode::Program& program,
                              const gcode::Interpretation& interpretation, const PredictOptions& options,
                              cutting::Stock& scratch) {
  POLYPOD_ASSIGN(accepted, accept_but_reach(job, program, interpretation, options.again));
  FollowedAnyway of_reach;
  Aside reach(
      [&](const Aside::Progress& report) {
        return accept_reach(job, program, accepted.interpretation(), report, &of_reach);
      },
      options.progress);
  PredictOptions of_pass = options;
  of_pass.progress = reach.unless_failed(options.progress);
  Result<Prediction> predicted = predict_accepted(job, program, accepted.interpretation(), of_pass, scratch);
  POLYPOD_TRY(reach.result(options.progress));  // it says more than what stops a pass
  POLYPOD_ASSIGN(out, std::move(predicted));
  const Way way = way_as_programmed(program, accepted.interpretation().moves);
  const Corners corners = corners_of(job, program, way, out, job.tolerance - resolution(job));
  out.corner = corners.largest;
  out.largest_with_corners = corners.largest_with;
  out.time = corners.time;
  out.slow = corners.slow;
  POLYPOD_ASSIGN(other, other_switch_of(job, program, options));
  out.other_switch = other;
  out.notes = std::move(accepted.notes);
  out.notes.insert(out.notes.end(), of_reach.notes.begin(), of_reach.notes.end());
  if (other) gcode::drop_block_delete_note(out.notes);
  for (std::string& note : condition_notes(job, accepted.interpretation().moves, out)) {
    out.notes.push_back(std::move(note));
  }
  for (std::string& note : pass_notes(job, program, out.pass)) out.notes.push_back(std::move(note));
  return out;
}

Result<ForceBand> force_band(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                             const Prediction& prediction, const PredictOptions& options) {
  ForceBand out;
  out.normal_by_move.assign(prediction.moves.size(), 0);
  PredictOptions quiet = options;
  quiet.keep_samples = false;
  if (job.material.spread.empty()) return out;
  POLYPOD_TRY(force_is_known(job));
  POLYPOD_ASSIGN(accepted, accept(job, program, interpretation, {options.again, options.progress}));
  cutting::Stock scratch;
  Job changed = job;
  for (const std::array<double, 6>& variation : job.material.spread) {
    changed.material = varied(job.material, variation);
    POLYPOD_ASSIGN(p, predict_accepted(changed, program, accepted.interpretation(), quiet, scratch));
    const auto add = [](double& sum, double change) { sum = std::hypot(sum, change); };
    add(out.deflection_mean, p.deflection.mean - prediction.deflection.mean);
    add(out.deflection_max, p.deflection.max - prediction.deflection.max);
    add(out.normal_mean, p.normal.mean - prediction.normal.mean);
    for (std::size_t i = 0; i < std::min(p.moves.size(), out.normal_by_move.size()); ++i) {
      add(out.normal_by_move[i], p.moves[i].normal.mean - prediction.moves[i].normal.mean);
    }
  }
  return out;
}

MapBand map_band(const Job& job, const Prediction& prediction) {
  MapBand out;
  if (!job.measured) return out;
  const statics::MeasuredMap& map = job.measured->map;
  const bool joints = statics::has_compliance(job.machine);
  statics::Probe probe(job.machine, cutting_orientation(job), job.posture, job.start_joints);
  for (const Sample& sample : prediction.few) {
    const Vec3 p = job.X_MW * sample.command, F = job.X_MW.R * sample.force, n = job.X_MW.R * sample.away;
    const Mat3 sd = map.deviation(p);
    double square = 0;
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) {
        const double lever = i == j ? n[i] * F[i] : n[i] * F[j] + n[j] * F[i];
        square += lever * lever * sd(i, j) * sd(i, j);
      }
    }
    out.normal.add(kHalf95 * std::sqrt(square));
    if (sample.joint_count > 0) probe.stand_at(sample.came_with());
    Mat3 C;
    if (joints && probe.at(p, C)) out.joints.add(((map.at(p) - C) * F).norm());
  }
  return out;
}

LeverChange lever_change(const Job& job, const Prediction& prediction) {
  LeverChange out;
  if (job.measured || !kinematics::is_serial(job.machine) || !statics::has_compliance(job.machine)) return out;
  statics::Probe probe(job.machine, cutting_orientation(job), job.posture, job.start_joints);
  for (const Sample& sample : prediction.few) {
    if (job.tool_frame.turns) probe.turn_to(cutting_orientation(job, sample.axes));
    if (sample.joint_count > 0) probe.stand_at(sample.came_with());
    Mat3 C;
    if (!probe.at(job.X_MW * sample.command, C)) continue;
    const auto loaded = statics::under_load(job.machine, probe.joints(), job.X_MW.R * sample.force);
    ++out.points;
    out.settles = out.settles && loaded.has_value();
    if (!loaded) continue;
    const double change = (loaded->exact - loaded->linear).norm();
    if (out.move >= 0 && change <= out.most) continue;
    out.most = change;
    out.deflection = loaded->linear.norm();
    out.move = sample.move;
  }
  return out;
}

}  // namespace polypod::machining
