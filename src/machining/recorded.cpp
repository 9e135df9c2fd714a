// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/recorded.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/machining/accept.hpp"
#include "way.hpp"

namespace polypod::machining {
namespace {

// How far the pieces may be off the record: across, where it counts, and along, where it is a matter of the feed; m.
// Between speeds that differ by dv a piece is late by dv^2 / (8 a): 0.2 um keeps its mean within 1 mm/s of every speed
// in it at 1 m/s^2, which matters where the controller slows down in a cut.
constexpr double kAcross = 0.2e-6, kAlong = 0.2e-6;
// From these angles on a command turns away from its move: between its ends, and beyond them; rad. The ramps of a
// correction, where the deflection grows or goes within a few millimetres, lean by less than the first (0.12 in the
// square of SLAV 6.1 in a tube of 40 um), and the tool follows its move there; a transition may lie nearly along the
// move to which it leads, but before its start.
constexpr double kTurnsAway = 0.3, kTurnsAwayBeyond = 0.1;
// The way over which the direction of the record is taken, to each side: encoders have noise; m.
constexpr double kDirectionOver = 50e-6;
// A record that is farther from its feed move follows another program; m.
constexpr double kLost = 10e-3;
// At the end of a move, m.
constexpr double kAtEnd = 1e-6;
// Planners round a corner by up to half of a move; and corrections move it, m.
constexpr double kRoundEnd = 1e-3;

/// A place that a record goes to along the moves of a program, in their order.
class Along {
 public:
  explicit Along(const LongVector<gcode::Move>& moves) : moves_(moves), at_(following(0)) {}
  [[nodiscard]] bool any() const { return at_ < moves_.size(); }

  /// The move that the record is on at p, the next place after those before.
  std::size_t go_to(const Vec3& p) {
    const Vec3 way = started_ ? Vec3(p - last_) : Vec3::Zero();
    for (;;) {
      const std::size_t next = following(at_ + 1);
      if (next >= moves_.size()) break;
      const gcode::Move& now = moves_[at_];
      const double left = remaining(p);
      // A way back over the same places, as a peck makes it, is as near from the start on: not before the second half.
      const bool over_itself = now.start_known && moves_[next].start_known &&
                               now.direction(now.length()).dot(moves_[next].direction(0)) < -0.5;
      if (left > (now.start_known ? 0.5 * now.length() + (over_itself ? 0 : kRoundEnd) : kLost)) break;
      const double here = distance(now, p), there = distance(moves_[next], p);
      const bool nearer = there < here * (now.start_known ? 1 : 0.9) - 1e-12;
      const bool back = way.norm() > 0 && there <= here + kAtEnd && now.start_known &&
                        now.direction(place(p)).dot(way) < 0 &&
                        moves_[next].direction(moves_[next].nearest(p)).dot(way) > 0.5 * way.norm();
      const bool round =
          left < -kAtEnd && there <= here + kAtEnd;  // a full circle is done, and what comes begins there
      if (!nearer && !back && !round && !(left < kAtEnd && there < kAtEnd)) break;
      at_ = next;
      s_ = 0;
      if (left < kAtEnd && !nearer && !back && !round)
        break;  // at a corner: one move on, not through all that end there
    }
    last_ = p;
    started_ = true;
    if (moves_[at_].start_known) s_ = std::clamp(place(p), 0.0, moves_[at_].length());
    return at_;
  }
  static double distance(const gcode::Move& move, const Vec3& p) {
    return (p - (move.start_known ? move.point(move.nearest(p)) : move.end)).norm();
  }
  /// Whether the record that stands at p has come to the end of all moves.
  [[nodiscard]] bool ended(const Vec3& p) const {
    return following(at_ + 1) >= moves_.size() && remaining(p) < kRoundEnd;
  }
  /// The next move from i on that goes somewhere.
  [[nodiscard]] std::size_t following(std::size_t i) const {
    while (i < moves_.size()) {
      const gcode::Move& m = moves_[i];
      const bool known = m.known_end[0] && m.known_end[1] && m.known_end[2];
      if (known && (!m.start_known || m.length() > 0)) break;
      ++i;
    }
    return i;
  }

 private:
  /// Where p is on the move, m from its start. A full circle comes back to where it began: its place is the one
  /// next to that before; before its start and beyond its end it goes on.
  [[nodiscard]] double place(const Vec3& p) const {
    const gcode::Move& move = moves_[at_];
    double best = move.nearest(p);
    constexpr double kNearlyRound = 0.9;  // turns
    if (!started_ || move.kind != gcode::MoveKind::arc || move.sweep < kNearlyRound * 2 * std::numbers::pi) return best;
    const double length = move.length(), turn = length * 2 * std::numbers::pi / move.sweep, from = best;
    for (double s = from - turn * std::ceil(from / turn); s < length + turn; s += turn)
      if (std::abs(s - s_) < std::abs(best - s_)) best = s;
    return best;
  }
  [[nodiscard]] double remaining(const Vec3& p) const {
    const gcode::Move& move = moves_[at_];
    return move.start_known ? move.length() - place(p) : (p - move.end).norm();
  }

  const LongVector<gcode::Move>& moves_;
  std::size_t at_ = 0;
  double s_ = 0;  // of the move
  Vec3 last_ = Vec3::Zero();
  bool started_ = false;
};

double segment_distance(const Vec3& p, const Vec3& a, const Vec3& b) {
  const Vec3 d = b - a;
  const double n = d.squaredNorm();
  const double t = n > 0 ? std::clamp((p - a).dot(d) / n, 0.0, 1.0) : 0.0;
  return (p - a - t * d).norm();
}

int line_of(const gcode::Program& program, const gcode::Move& move) {
  return program.blocks[static_cast<std::size_t>(move.block)].line;
}

/// The direction of the record at each step k -> k + 1, over some way to each side.
std::vector<Vec3> directions_of(const std::vector<RecordedTip>& record) {
  const std::size_t n = record.size();
  std::vector<double> way(n, 0);
  for (std::size_t k = 1; k < n; ++k) way[k] = way[k - 1] + (record[k].p_W - record[k - 1].p_W).norm();
  std::vector<Vec3> out(n - 1, Vec3::Zero());
  std::size_t low = 0, high = 0;
  for (std::size_t k = 0; k + 1 < n; ++k) {
    const double middle = 0.5 * (way[k] + way[k + 1]);
    while (low + 1 < n && way[low + 1] < middle - kDirectionOver) ++low;
    while (high + 1 < n && way[high] < middle + kDirectionOver) ++high;
    const std::size_t a = std::min(low, k), b = std::max(high, k + 1);
    const Vec3 d = record[b].p_W - record[a].p_W;
    if (d.norm() > 0) out[k] = d.normalized();
  }
  return out;
}

/// Rows of `record` between first and last at which a straight piece at constant speed has to end.
void fewest(const std::vector<RecordedTip>& record, std::size_t first, std::size_t last, std::vector<char>& kept) {
  std::vector<std::pair<std::size_t, std::size_t>> open{{first, last}};
  while (!open.empty()) {
    const auto [a, b] = open.back();
    open.pop_back();
    if (b <= a + 1) continue;
    const Vec3 chord = record[b].p_W - record[a].p_W;
    const double length = chord.norm(), seconds = record[b].time - record[a].time;
    const Vec3 d = length > 0 ? Vec3(chord / length) : Vec3::Zero();
    double worst = 1;
    std::size_t where = 0;
    for (std::size_t k = a + 1; k < b; ++k) {
      const Vec3 off = record[k].p_W - record[a].p_W;
      const double along = off.dot(d), across = (off - along * d).norm();
      const double late = along - length * (record[k].time - record[a].time) / seconds;
      const double share = std::max(across / kAcross, std::abs(late) / kAlong);
      if (share > worst) {
        worst = share;
        where = k;
      }
    }
    if (where == 0) continue;
    kept[where] = 1;
    open.emplace_back(a, where);
    open.emplace_back(where, b);
  }
}

struct Pieces {
  LongVector<PassMove> moves;
  LongVector<int> source;
  std::vector<std::array<double, 2>> times;
};

Pieces pieces_of(const std::vector<RecordedTip>& record, const LongVector<gcode::Move>& programmed,
                 const std::vector<std::size_t>& on, std::size_t first_known) {
  const std::vector<Vec3> direction = directions_of(record);
  const std::size_t n = record.size();
  std::vector<char> turning(n - 1, 0), kept(n, 0);
  for (std::size_t k = 0; k + 1 < n; ++k) {
    const gcode::Move& move = programmed[on[k + 1]];
    if (move.kind == gcode::MoveKind::rapid || !move.start_known) continue;
    const Vec3 middle = 0.5 * (record[k].p_W + record[k + 1].p_W);
    const double at = move.nearest(middle);
    const double most = at > 0 && at < move.length() ? kTurnsAway : kTurnsAwayBeyond;
    turning[k] = !direction[k].isZero(0) && angle_between(direction[k], move.direction(at)) > most;
  }
  const auto same = [&](std::size_t k, std::size_t j) { return on[k + 1] == on[j + 1] && turning[k] == turning[j]; };
  kept[first_known] = kept[n - 1] = 1;
  for (std::size_t a = first_known; a + 1 < n;) {
    std::size_t b = a;
    while (b + 2 < n && same(a, b + 1)) ++b;
    kept[b + 1] = 1;
    fewest(record, a, b + 1, kept);
    a = b + 1;
  }
  Pieces out;
  for (std::size_t a = first_known; a + 1 < n;) {
    std::size_t b = a + 1;
    while (kept[b] == 0) ++b;
    const std::size_t source = on[a + 1];
    const gcode::Move& meant = programmed[source];
    const double length = (record[b].p_W - record[a].p_W).norm(), seconds = record[b].time - record[a].time;
    if (length > 0) {
      PassMove piece;
      piece.move = meant;
      piece.move.kind = meant.kind == gcode::MoveKind::rapid ? gcode::MoveKind::rapid : gcode::MoveKind::line;
      piece.move.start = record[a].p_W;
      piece.move.end = record[b].p_W;
      piece.move.start_known = true;
      piece.move.known_start = piece.move.known_end = {true, true, true};
      piece.move.path = {gcode::PathMode::exact_path, 0, 0};
      piece.move.feed = meant.kind == gcode::MoveKind::rapid ? 0 : length / seconds;
      piece.transition = turning[a] != 0;
      if (!piece.transition && meant.kind != gcode::MoveKind::rapid && meant.start_known) piece.followed = &meant;
      out.moves.push_back(piece);
      out.source.push_back(static_cast<int>(source));
      out.times.push_back({record[a].time, record[b].time});
    }
    a = b;
  }
  return out;
}

std::vector<RecordedCorner> corners_seen(const gcode::Program& program, const LongVector<gcode::Move>& moves,
                                         const std::vector<RecordedTip>& record, const PlannerLimits& limits) {
  std::vector<RecordedCorner> out;
  Along along(moves);
  if (!along.any()) return out;
  std::vector<std::size_t> first(moves.size(), 0), last(moves.size(), 0);
  for (std::size_t k = 0; k < record.size(); ++k) {
    const std::size_t i = along.go_to(record[k].p_W);
    if (last[i] == 0) first[i] = k;
    last[i] = k + 1;
  }
  constexpr double kLeastTurn = units::from_deg(0.5);
  for (std::size_t i = along.following(0); i < moves.size();) {
    const std::size_t next = along.following(i + 1);
    if (next >= moves.size()) break;
    const gcode::Move &a = moves[i], &b = moves[next];
    if (a.start_known && b.start_known && last[i] > 0 && last[next] > 0 &&
        (a.kind == gcode::MoveKind::rapid) == (b.kind == gcode::MoveKind::rapid)) {
      const Corner corner = machining::corner(a, b, limits);
      if (corner.turn > kLeastTurn) {
        RecordedCorner seen;
        seen.line = line_of(program, a);
        seen.turn = corner.turn;
        seen.predicted = corner.deviation;
        seen.bound = corner.bound;
        seen.cutting = a.kind != gcode::MoveKind::rapid;
        seen.recorded = std::numeric_limits<double>::infinity();
        for (std::size_t k = first[i]; k + 1 < last[next]; ++k) {
          seen.recorded = std::min(seen.recorded, segment_distance(a.end, record[k].p_W, record[k + 1].p_W));
        }
        if (std::isfinite(seen.recorded)) out.push_back(seen);
      }
    }
    i = next;
  }
  return out;
}

}  // namespace

void Gain::add(double weight, double deflection_normal, double deflection_vertical, double normal, double vertical) {
  if (!(weight > 0)) return;
  length += weight;
  const double share = weight / length;
  const auto mean = [&](double& of, double value) { of += share * (value - of); };
  const auto rms = [&](double& of, double square) {
    of = std::sqrt(std::max(0.0, of * of + share * (square - of * of)));
  };
  mean(mean_deflection, deflection_normal);
  mean(mean_left, normal);
  rms(rms_deflection, deflection_normal * deflection_normal + deflection_vertical * deflection_vertical);
  rms(rms_left, normal * normal + vertical * vertical);
}

double Gain::removed_mean() const {
  return mean_deflection != 0 ? 1 - std::abs(mean_left) / std::abs(mean_deflection) : 0;
}
double Gain::removed_rms() const {
  return rms_deflection > 0 ? 1 - rms_left / rms_deflection : 0;
}

Result<RecordedCut> judge_recorded(const Job& job, const gcode::Program& program,
                                   const gcode::Interpretation& interpretation, const gcode::Program& ran_program,
                                   const gcode::Interpretation& ran, const std::vector<RecordedTip>& record,
                                   const RecordedOptions& options) {
  if (record.size() < 2) {
    return fail("MC331", fmt::format("{} places of the record are known; must be two at least", record.size()), {},
                "record the program from its start to its end");
  }
  POLYPOD_ASSIGN(accepted, accept(job, program, interpretation));
  const LongVector<gcode::Move>& programmed = accepted.interpretation().moves;
  RecordedCut out;
  out.notes = accepted.notes;
  Along along(programmed);
  std::vector<std::size_t> on(record.size());
  std::size_t first_known = record.size();
  for (std::size_t k = 0; k < record.size(); ++k) {
    on[k] = along.go_to(record[k].p_W);
    const gcode::Move& move = programmed[on[k]];
    if (move.start_known && first_known == record.size()) first_known = k;
    if (!move.start_known || move.kind == gcode::MoveKind::rapid) continue;
    const double off = Along::distance(move, record[k].p_W);
    if (off > kLost) {
      return fail("MC330",
                  fmt::format("the record does not follow the program: after {:.3f} s it is {:.1f} mm from this move",
                              record[k].time, units::to_mm(off)),
                  {program.path, line_of(program, move), 1},
                  "give the program that ran, or of which it is the correction, and the job whose origin it ran with");
    }
  }
  out.last_line = line_of(program, programmed[on.back()]);
  out.to_the_end = along.ended(record.back().p_W);
  if (first_known + 1 >= record.size()) {
    return fail("MC330",
                fmt::format("the record does not follow the program: it never comes to the place where its first "
                            "move ends, and is {:.1f} mm from it at its end",
                            units::to_mm(Along::distance(programmed[on.back()], record.back().p_W))),
                {program.path, out.last_line, 1},
                "give the program that ran, or of which it is the correction, and the job whose origin it ran with");
  }
  Pieces pieces = pieces_of(record, programmed, on, first_known);
  out.pieces = pieces.moves.size();
  Way way{&program, &programmed, std::move(pieces.moves), std::move(pieces.source)};
  PredictOptions predict_options;
  predict_options.step = options.step;
  predict_options.keep_samples = true;
  predict_options.one_position = predict_options.beside = true;
  predict_options.progress = options.progress;
  // A turn in the air is no transition, whose start would count as a cut: first without them, to see what cuts.
  LongVector<PassMove> with_transitions = way.moves;
  bool any_turn = false;
  for (PassMove& piece : way.moves) {
    any_turn = any_turn || piece.transition;
    piece.transition = false;
  }
  if (any_turn) {
    PredictOptions first = predict_options;
    first.keep_samples = false;
    POLYPOD_ASSIGN(seen, predict_way(job, program, way, first));
    for (std::size_t i = 0; i < with_transitions.size(); ++i) {
      const Prediction::Ends& ends = seen.commanded_ends[i];
      way.moves[i].transition = with_transitions[i].transition && (ends.start || ends.end);
    }
  }
  POLYPOD_ASSIGN(cut, predict_way(job, program, way, predict_options));
  if (cut.moves.empty()) return tl::unexpected(cuts_nothing(job, program, accepted.interpretation()));
  POLYPOD_TRY(no_rapid_cuts(job, program, cut.pass));
  out.cut = std::move(cut);
  out.corners = corners_seen(ran_program, ran.moves, record, options.planner);
  for (const RecordedCorner& c : out.corners)
    if (c.cutting) out.cut.corner = std::max(out.cut.corner, c.recorded);
  out.cut.largest_with_corners = out.cut.largest_distance;  // the record has rounded them
  out.points.reserve(out.cut.samples.size());
  const Sample* before = nullptr;
  for (const Sample& s : out.cut.samples) {
    const auto piece = static_cast<std::size_t>(s.move);
    const double length = way.moves[piece].move.length();
    const std::array<double, 2>& t = pieces.times[piece];
    RecordedPoint p;
    p.time = t[0] + (t[1] - t[0]) * (length > 0 ? s.s / length : 0);
    p.move = way.source[piece];
    p.line = line_of(program, programmed[static_cast<std::size_t>(p.move)]);
    p.cutting = s.cutting;
    p.turning = with_transitions[piece].transition;
    p.deflection = s.deflection;
    p.force = s.force;
    p.deflection_normal = s.deflection.dot(s.away);
    p.normal = s.normal;
    p.vertical = s.vertical;
    p.distance = s.distance;
    if (p.cutting && !p.turning && !s.away.isZero(0) && before != nullptr && before->move == s.move) {
      const double weight = s.s - before->s;
      out.gain.add(weight, p.deflection_normal, s.deflection.z(), p.normal, p.vertical);
      if (out.gain_by_line.empty() || out.gain_by_line.back().first != p.line)
        out.gain_by_line.emplace_back(p.line, Gain{});
      out.gain_by_line.back().second.add(weight, p.deflection_normal, s.deflection.z(), p.normal, p.vertical);
    }
    before = &s;
    out.points.push_back(p);
  }
  return out;
}

}  // namespace polypod::machining
