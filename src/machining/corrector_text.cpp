// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>
#include <set>

#include "corrector.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/ball_stock.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/surplus.hpp"
#include "polypod/machining/compliance_mark.hpp"
#include "polypod/machining/tilted.hpp"

namespace polypod::machining {
namespace {

/// Where a block ends along a move, m: beside its nearest point, and not before `from`, where the block begins. On a
/// way that closes the end of a line near its begin is not taken for one near its end.
double end_along(const gcode::Move& move, const Piece& piece, double from) {
  constexpr double kRoundabout = 2;  // lines beside an arc: half its circumference over its diameter is less
  const double s = move.nearest(piece.end), way = (piece.end - move.point(from)).norm();
  if (s < from || (!piece.centre && s - from > kRoundabout * way)) return from;
  return s;
}

}  // namespace

Status Corrector::write_and_check() {
  POLYPOD_TRY(write());
  return check();
}

Status Corrector::write() {
  gcode::RewriteOptions options;
  options.interpret = job_.interpret_options();
  const gcode::Decimals decimals = gcode::decimals_of(program_, options);
  // A point that rounds onto the one before it gets no block: drop it here, so that blocks and points stay in step.
  transitions_.clear();
  first_transition_.clear();
  changed_ = rewritten_;
  Vec3 stands = Vec3::Zero();
  Planner planner(*this);
  std::size_t i = 0;
  const auto next = [&](gcode::Replacement& r) {
    for (; i < moves_.size(); ++i) {
      first_transition_.push_back(transitions_.size());
      if (replace(i, planner.next(), decimals, stands, r)) {
        ++i;
        return true;
      }
    }
    return false;
  };
  POLYPOD_ASSIGN(rewritten, gcode::rewrite_each(program_, interpretation_, next, options));
  first_transition_.push_back(transitions_.size());
  rewritten_text_ = std::move(rewritten);
  return finish_text();
}

bool Corrector::replace(std::size_t i, const Plan& plan, const gcode::Decimals& decimals, Vec3& stands,
                        gcode::Replacement& r) {
  if (!rewritten_[i]) {
    stands = moves_[i].end;
    return false;
  }
  r.points.clear();
  r.move = static_cast<int>(i);
  const double grain = moves_[i].inches ? units::from_inch(std::pow(10.0, -decimals.inch))
                                        : units::from_mm(std::pow(10.0, -decimals.mm));
  const auto rounded = [&](const Vec3& p) { return Vec3((p / grain).array().round() * grain); };
  const auto same = [&](const Vec3& a, const Vec3& b) {
    return (rounded(a) - rounded(b)).cwiseAbs().maxCoeff() < 0.5 * grain;
  };
  if (plan.size() == 1 && moves_[i].kind == gcode::MoveKind::line && same(stands, moves_[i].start) &&
      same(plan.front().end, moves_[i].end)) {
    changed_[i] = false;  // to the written digits it is the programmed move, whose text stays
    stands = moves_[i].end;
    return false;
  }
  const bool turns = moves_[i].axes_start != moves_[i].axes_end;
  double s = 0;  // along the move, where a block ends
  for (std::size_t j = 0; j < plan.size(); ++j) {
    const Piece& piece = plan[j];
    const bool needed = j + 1 == plan.size() && r.points.empty();
    if (same(piece.end, stands) && !needed) continue;
    if (turns) s = j + 1 == plan.size() ? moves_[i].length() : end_along(moves_[i], piece, s);
    r.points.push_back({piece.end, turns ? axes_at(moves_[i], s) : moves_[i].axes_end, piece.centre});
    transitions_.push_back(piece.transition);
    stands = piece.end;
  }
  return true;
}

Status Corrector::finish_text() {
  const gcode::Program changed = mode_blocks_.empty() ? gcode::Program{} : with_modes();
  const gcode::Program& program = mode_blocks_.empty() ? rewritten_text_.program : changed;
  const std::vector<std::string> header = header_lines();
  const std::string code = mode_ ? "G21 " + path_mode_words(*mode_) : "";
  const gcode::Program whole = gcode::with_header(program, header, code);
  POLYPOD_ASSIGN(back, gcode::read_back(whole, program_.path + " (corrected)"));
  out_.program = std::move(back);
  out_.lines_out = out_.program.blocks.size();
  header_at_ = 0;
  while (header_at_ < program.blocks.size() &&
         program.blocks[header_at_].text == out_.program.blocks[header_at_].text) {
    ++header_at_;
  }
  header_size_ = whole.blocks.size() - program.blocks.size();
  named_.path = program_.path;
  named_.blocks.clear();
  for (std::size_t b = 0; b < out_.program.blocks.size(); ++b) {
    const bool header_block = b >= header_at_ && b < header_at_ + header_size_;
    const int source = header_block ? 0 : source_block(static_cast<int>(b));
    gcode::Block named;
    named.line = source < 0 ? 0 : program_.blocks[static_cast<std::size_t>(source)].line;
    named_.blocks.push_back(named);
  }
  POLYPOD_ASSIGN(run, gcode::interpret(out_.program, job_.interpret_options()));
  way_ = Way{&program_, &moves_, {}, {}};
  transition_blocks_.assign(out_.program.blocks.size(), false);
  return match(run);
}

gcode::Program Corrector::with_modes() const {
  gcode::Program changed;
  changed.path = rewritten_text_.program.path;
  for (std::size_t b = 0; b < rewritten_text_.program.blocks.size(); ++b) {
    gcode::Block block = rewritten_text_.program.blocks[b];
    const int source = rewritten_text_.source[b];
    std::string text;
    if (std::find(mode_blocks_.begin(), mode_blocks_.end(), source) != mode_blocks_.end()) {
      const bool inches = interpretation_.states[static_cast<std::size_t>(source)].inches;
      text = gcode::with_path_control(block, path_mode_words(*mode_, inches));
      block.text = text;
    }
    changed.blocks.push_back(block);
  }
  return changed;
}

std::vector<std::string> Corrector::header_lines() const {
  std::set<int> tools;
  for (const MovePrediction& m : out_.before.moves) tools.insert(moves_[static_cast<std::size_t>(m.move)].tool);
  std::string cutters;
  for (const int tool : tools) {
    const std::string number = tools.size() > 1 ? fmt::format("T{} ", tool) : "";
    cutters += fmt::format("{}{}, ", number, cutter_in_words(job_.cutter_of(tool)));
  }
  const auto changed = std::count(changed_.begin(), changed_.end(), true);
  std::vector<std::string> header{fmt::format("{} {}", changed > 0 ? std::string_view(kCorrectedMark) : kLookedAtMark,
                                              machine::name_of(job_.machine)),
                                  fmt::format("Polypod: tube radius {:g} um, {}origin {}", units::to_um(job_.tolerance),
                                              cutters, place_in_words(job_.X_MW))};
  header.push_back(changed > 0
                       ? fmt::format("Polypod: {} of {} moves rewritten, do not correct again", changed, moves_.size())
                       : fmt::format("Polypod: nothing was corrected, {} moves are as they were", moves_.size()));
  header.push_back(fmt::format("Polypod: {}{}", gcode::kMaterialText, material_in_words(job_.material)));
  // Of a tilted tool the stock lies in a frame of its own: the volume alone.
  std::string stock = stock_in_words(job_.stock);
  if (job_.tool_frame.tilted) stock.erase(0, stock.rfind(", ") + 2);
  header.push_back(fmt::format("Polypod: {}{}", gcode::kStockText, stock));
  if (const std::string hold = hold_in_words(); !hold.empty()) header.push_back("Polypod: " + hold);
  if (!out_.before.moves.empty()) {
    const gcode::Move& first = moves_[static_cast<std::size_t>(out_.before.moves.front().move)];
    const auto& few = out_.before.few;
    const bool open = !few.empty() && few.front().joint_count > 0;
    if (const auto mark = open ? compliance_mark(job_, few.front()) : compliance_mark(job_, first)) {
      header.push_back("Polypod: " + mark->in_words());
      if (open) header.push_back("Polypod: " + mark->joints_in_words(job_.machine));
    }
  }
  if (fixed_other_ != nullptr) {
    header.push_back(fmt::format("Polypod: written with block delete {}; the switch does not act on this program",
                                 fixed_other_->block_delete ? "off" : "on"));
  }
  if (!warning_.empty()) header.push_back("Polypod: " + warning_);
  if (kinematics::leaves_a_joint_free(job_.machine)) header.push_back(fmt::format("Polypod: {}", kOneChoice));
  if (job_.weights) header.push_back("Polypod: the weight of the machine counts, against that at the origin");
  if (job_.measured) {
    header.push_back(fmt::format("Polypod: {}{} measured points", gcode::kMeasuredText, job_.measured->map.size()));
    if (!job_.measured->doubts.empty()) header.push_back("Polypod: these are doubtful, NOT judged against the tube");
  }
  return header;
}

std::string Corrector::hold_in_words() const {
  if (job_.measured) return {};
  std::string out;
  if (!out_.before.moves.empty()) {
    const gcode::Move& first = moves_[static_cast<std::size_t>(out_.before.moves.front().move)];
    if (const std::string name = posture_at_start(job_, first); !name.empty())
      out = std::string(gcode::kPostureText) + name;
  }
  if (kinematics::task(job_.machine).holds(machine::Coordinate::c)) {
    if (const auto c = held_c()) {
      constexpr int kDecimals = 4;
      out += fmt::format("{}{}{} deg", out.empty() ? "" : ", ", gcode::kHeldText,
                         gcode::number(units::to_deg(*c), kDecimals));
    }
  }
  return out;
}

std::optional<double> Corrector::held_c() const {
  if (!job_.tool_frame.turns) return job_.tool_frame.axes.z();
  std::optional<double> c;
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    const gcode::Move& move = moves_[i];
    if (move.kind == gcode::MoveKind::rapid) continue;
    if (!c) c = move.axes_start.z();
    if (move.axes_start.z() != *c || move.axes_end.z() != *c) return {};
  }
  return c;
}

int Corrector::source_block(int written) const {
  auto block = static_cast<std::size_t>(written);
  if (block >= header_at_) block -= header_size_;
  return rewritten_text_.source[block];
}

Status Corrector::match(const gcode::Interpretation& run) {
  way_.moves.clear();
  way_.source.clear();
  const LongVector<int> move_of_block = moves_by_block(moves_);
  LongVector<std::uint32_t> next_point(moves_.size(), 0);
  out_.pieces = out_.transitions = 0;
  for (const gcode::Move& move : run.moves) {
    const int source = move_of_block[static_cast<std::size_t>(source_block(move.block))];
    if (source < 0) return mismatch(move);
    bool transition = false;
    const auto i = static_cast<std::size_t>(source);
    if (changed_[i]) {
      const std::size_t point = first_transition_[i] + next_point[i]++;
      if (point >= first_transition_[i + 1]) return mismatch(move);
      transition = transitions_[point];
      transition_blocks_[static_cast<std::size_t>(move.block)] = transition;
      ++(transition ? out_.transitions : out_.pieces);
    }
    add(way_, move, i, transition, out_.programmed, changed_[i]);
  }
  return {};
}

LongVector<int> Corrector::moves_by_block(const LongVector<gcode::Move>& moves) const {
  LongVector<int> out(program_.blocks.size(), -1);
  for (std::size_t i = 0; i < moves.size(); ++i) out[static_cast<std::size_t>(moves[i].block)] = static_cast<int>(i);
  return out;
}

void Corrector::add(Way& way, const gcode::Move& commanded, std::size_t source, bool transition,
                    const LongVector<gcode::Move>& programmed, bool rewritten) const {
  PassMove move{commanded, transition, rewritten && !transition ? &programmed[source] : nullptr};
  if (!commanded.start_known && programmed[source].start_known) {
    move.move.start = programmed[source].start;
    move.move.start_known = true;
  }
  if (source < feed_scale_.size()) move.move.feed *= feed_scale_[source];
  way.moves.push_back(move);
  way.source.push_back(static_cast<int>(source));
}

Status Corrector::mismatch(const gcode::Move& move) const {
  return fail("MC220", "a block that was written does not read back as the move that was planned",
              Place{out_.program.path, out_.program.blocks[static_cast<std::size_t>(move.block)].line, 1},
              "please report this program");
}

bool Corrector::commands_the_same() const {
  if (way_.moves.size() != moves_.size() || !feed_scale_.empty()) return false;
  const auto same = [](const gcode::Move& a, const gcode::Move& b) {
    return a.kind == b.kind && a.plane == b.plane && a.clockwise == b.clockwise && a.start == b.start &&
           a.end == b.end && a.centre == b.centre && a.sweep == b.sweep && a.axes_start == b.axes_start &&
           a.axes_end == b.axes_end && a.feed == b.feed && a.spindle_speed == b.spindle_speed &&
           a.spindle == b.spindle && a.tool == b.tool && a.start_known == b.start_known &&
           a.known_start == b.known_start && a.known_end == b.known_end;
  };
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    if (changed_[i] || way_.source[i] != static_cast<int>(i) || !same(way_.moves[i].move, moves_[i])) return false;
  }
  return true;
}

}  // namespace polypod::machining
