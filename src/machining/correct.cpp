// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/correct.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <set>
#include <unordered_map>

#include "aside.hpp"
#include "fit.hpp"
#include "modes.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/ball_stock.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/gcode/writer.hpp"
#include "polypod/machining/accept.hpp"
#include "way.hpp"

namespace polypod::machining {
namespace {

// Two distances that differ by less than this are taken as equal, m: the stock's cells move them by as much.
constexpr double kSameDistance = 1e-6;
// A tube is not worth narrowing further for a move below this share of the tolerance.
constexpr double kNarrowest = 0.02;
// A narrower tube that leaves more than this share of the distance did not help: something else is wrong there.
constexpr double kHelps = 0.98;
// How often moves that became worse are given back their text before the whole program is.
constexpr int kGiveBackRounds = 12;
// The step of the check is at most this, m.
constexpr double kCheckStep = 0.1e-3;
// Stocks up to this are cut by two passes at once, bytes.
constexpr std::size_t kLargestSecondStock = 200'000'000;
// Remedies are tried out where a correction takes no longer than this many points, and until all tries together have
// taken this many.
constexpr std::size_t kTryRemediesBelow = 200'000, kMostTried = 4'000'000;
// A point of a ball costs as much as so many of a flat cutter.
constexpr std::size_t kPointsOfABall = 60;

bool has_balls(const Job& job) {
  return cutting::is_ball(job.cutter) ||
         std::any_of(job.cutters.begin(), job.cutters.end(), [](const auto& c) { return cutting::is_ball(c.second); });
}
/// How long the passes of a correction take, in points of flat cutters.
std::size_t cost_of(const Job& job, const Correction& c) {
  return c.after.pass.points * (has_balls(job) ? kPointsOfABall : 1);
}

/// The blocks that stand for one rewritten move.
using Plan = std::vector<Piece>;

/// What is to be corrected of a deflection: on a plunge not what is held back.
Vec3 to_correct(const gcode::Move& move, const Vec3& deflection, const Vec3& axis) {
  if (!is_plunge(move, axis)) return deflection;
  const Vec3 d = move.direction(0);
  return deflection - d * d.dot(deflection);
}

class Corrector {
 public:
  Corrector(const Job& job, const gcode::Program& program, const Accepted& accepted, const CorrectOptions& options)
      : job_(job),
        program_(program),
        interpretation_(accepted.interpretation()),
        options_(options),
        moves_(interpretation_.moves) {}

  /// For what-if: the feeds of some moves are taken smaller than they are written.
  void scale_feeds(const std::vector<bool>& which, double factor) {
    feed_scale_.assign(moves_.size(), 1.0);
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (which[i]) feed_scale_[i] = factor;
    }
  }

  /// What was found of the program unrolled for the other position of block delete.
  void take_other(const std::optional<OtherSwitch>& other) { fixed_other_ = other ? &*other : nullptr; }

  /// The check of the reach that is under way; none where it is done.
  void take_reach(Aside* reach) { reach_ = reach; }

  /// What the program does as it is, where that is known.
  void take_before(const Prediction& before) { known_before_ = &before; }

  Result<Correction> run() {
    out_.tolerance = job_.tolerance;
    out_.lines_in = program_.blocks.size();
    out_.programmed = moves_;
    POLYPOD_TRY(predict_and_find());
    fit_.assign(moves_.size(), options_.fit_share * job_.tolerance);
    choose_moves();
    POLYPOD_TRY(refine());
    if (options_.method == CorrectMethod::tube) {
      if (options_.all) POLYPOD_TRY(correct_the_rest());
      POLYPOD_TRY(give_back_what_got_worse());
      POLYPOD_TRY(share_corners_of_short_blocks());
      POLYPOD_TRY(chords_in_place_of_stops());
      POLYPOD_TRY(choose_modes());
    }
    POLYPOD_TRY(judge());
    if (options_.keep_stock) POLYPOD_TRY(leave_stock());
    return std::move(out_);
  }

 private:
  std::function<bool(double)> progress(const char* what) const {
    if (!options_.progress) return {};
    return [this, what](double share) { return options_.progress(what, share); };
  }

  [[nodiscard]] double check_step() const { return std::min(job_.step, kCheckStep); }

  /// The program as it is, with the feeds that are tried.
  [[nodiscard]] Way as_programmed() const {
    Way way{&program_, &moves_, {}, {}};
    if (feed_scale_.empty()) return way;
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      way.moves.push_back({moves_[i], false, nullptr});
      way.moves.back().move.feed *= feed_scale_[i];
    }
    return way;
  }

  /// What the program does as it is and what would correct it, side by side: neither needs the other.
  Status predict_and_find() {
    const std::size_t bytes = job_.stock.layers().size() * sizeof(float);
    if (bytes > kLargestSecondStock) {
      const Status predicted = predict_as_it_is();
      POLYPOD_TRY(reached());
      POLYPOD_TRY(predicted);
      return find_deflections();
    }
    cutting::Stock scratch;
    const std::function<bool(double)> finding = progress("finding the ideal correction");
    Aside found([&](const Aside::Progress& report) { return find_deflections(scratch, report); }, finding);
    const Status predicted = predict_as_it_is();
    POLYPOD_TRY(reached());
    POLYPOD_TRY(predicted);
    return found.result(finding);
  }

  /// That the machine can follow the program: what a pass says of that says less.
  [[nodiscard]] Status reached() const {
    return reach_ != nullptr ? reach_->result(progress("checking the reach")) : Status{};
  }

  Status predict_as_it_is() {
    if (known_before_ != nullptr) return keep_before(*known_before_);
    const Way way = as_programmed();
    PredictOptions options;
    options.step = check_step();
    options.keep_samples = options_.keep_samples;
    options.progress = progress("predicting the program as it is");
    if (reach_ != nullptr) options.progress = reach_->unless_failed(options.progress);
    POLYPOD_ASSIGN(before, predict_way(job_, program_, way, options, scratch_));
    if (before.moves.empty()) return tl::unexpected(cuts_nothing(job_, program_, interpretation_));
    if (verifies()) POLYPOD_TRY(look_finely(program_, way, before));
    return keep_before(std::move(before));
  }

  Status keep_before(Prediction before) {
    out_.before = std::move(before);
    before_.assign(moves_.size(), 0);
    for (const MovePrediction& m : out_.before.moves) before_[static_cast<std::size_t>(m.move)] = m.largest_distance;
    return {};
  }

  /// The new program once more, for what it leaves; unlike anybody who reads it, this knows its transitions.
  Status leave_stock() {
    PredictOptions options;
    options.step = check_step();
    options.progress = progress("cutting what is left");
    POLYPOD_ASSIGN(last, predict_way(job_, named_, way_, options, scratch_));
    (void)last;
    out_.stock_left = std::move(scratch_);
    return {};
  }

  /// Whether what is said is looked at again with finer cells.
  [[nodiscard]] bool verifies() const { return options_.method == CorrectMethod::tube && options_.verify; }

  const Job& fine_job() {
    if (!fine_) {
      fine_.emplace(job_);
      fine_->stock = job_.stock.in_half_cells();
    }
    return *fine_;
  }

  /// The same pass in cells half as large at steps half as long: distances become the larger of the two.
  Status look_finely(const gcode::Program& program, const Way& way, Prediction& prediction) {
    PredictOptions options;
    options.step = 0.5 * check_step();
    options.progress = progress("looking again with finer cells");
    POLYPOD_ASSIGN(fine, predict_way(fine_job(), program, way, options, fine_scratch_));
    for (std::size_t c = 0; c < fine.commanded_distance.size(); ++c) {
      prediction.commanded_distance[c] = std::max(prediction.commanded_distance[c], fine.commanded_distance[c]);
      prediction.commanded_ends[c].start |= fine.commanded_ends[c].start;
      prediction.commanded_ends[c].end |= fine.commanded_ends[c].end;
      Prediction::WithoutChips& known = prediction.commanded_without_chips[c];
      const Prediction::WithoutChips& seen = fine.commanded_without_chips[c];
      known = {std::max(known.start, seen.start), std::max(known.end, seen.end)};
    }
    const std::size_t known = prediction.moves.size();
    std::size_t at = 0;  // both lists rise with the moves of the program
    for (const MovePrediction& m : fine.moves) {
      while (at < known && prediction.moves[at].move < m.move) ++at;
      if (at < known && prediction.moves[at].move == m.move) {
        MovePrediction& same = prediction.moves[at];
        same.largest_distance = std::max(same.largest_distance, m.largest_distance);
      } else {
        prediction.moves.push_back(m);
      }
    }
    if (prediction.moves.size() > known) {
      std::sort(prediction.moves.begin(), prediction.moves.end(),
                [](const auto& a, const auto& b) { return a.move < b.move; });
    }
    prediction.largest_distance = std::max(prediction.largest_distance, fine.largest_distance);
    prediction.not_judged.insert(prediction.not_judged.end(), fine.not_judged.begin(), fine.not_judged.end());
    return {};
  }

  /// The deflections with the tool on the programmed path; in the finer cells once the coarse ones have misled.
  Status find_deflections() {
    return find_deflections(fit_finely_ ? fine_scratch_ : scratch_, progress("finding the ideal correction"));
  }
  Status find_deflections(cutting::Stock& scratch, const std::function<bool(double)>& report) {
    const Job& job = fit_finely_ ? fine_job() : job_;
    const Way way = as_programmed();
    deflections_.clear(moves_.size());
    scratch = job.stock;
    PassOptions pass;
    pass.bend = options_.method == CorrectMethod::mirror ? Bend::at_rest : Bend::corrected;
    pass.step = sample_step_;
    pass.progress = report;
    const auto visit = [&](const Sample& sample) {
      const auto i = static_cast<std::size_t>(sample.move);
      deflections_.add(i, sample.s, to_correct(moves_[i], sample.deflection, job.tool_frame.axis()), sample.cutting);
    };
    POLYPOD_ASSIGN(result, run_pass(job, program_, way.commanded(), scratch, pass, visit));
    return no_rapid_cuts(job_, program_, result);
  }

  /// Whether moves i and i + 1 both cut and meet: nothing lies between them.
  [[nodiscard]] bool meet(std::size_t i) const {
    return i + 1 < moves_.size() && deflections_.cuts(i) && deflections_.cuts(i + 1);
  }

  void choose_moves() {
    rewritten_.assign(moves_.size(), false);
    frozen_.assign(moves_.size(), false);
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (!deflections_.cuts(i)) continue;
      rewritten_[i] = options_.method == CorrectMethod::mirror || before_[i] > inside();
    }
    spread_choice();
  }

  /// How near to the wall of the tube a move may come, m: what the cells of the stock leave open is kept free.
  [[nodiscard]] double inside() const { return job_.tolerance - resolution(job_); }

  /// Corners of move i are shared if they jump by less than this, m.
  [[nodiscard]] double jump(std::size_t i) const {
    const double share = std::min(1.0, fit_[i] / (options_.fit_share * job_.tolerance));
    const double shortest = std::min(job_.controller.shortest_block(moves_[i].feed), 0.6 * job_.tolerance);
    return std::max(options_.merge_share * job_.tolerance * share, shortest);
  }

  /// A move that may stay is still rewritten if it meets a rewritten one in a corner where it deflects by more than the
  /// corner may jump: a step back to the programmed path would leave a mark.
  void spread_choice() {
    for (std::size_t i = 0; i + 1 < moves_.size(); ++i) {
      if (meet(i) && rewritten_[i] && deflections_.at_start(i + 1).norm() > jump(i)) take(i + 1);
    }
    for (std::size_t i = moves_.size(); i-- > 1;) {
      if (meet(i - 1) && rewritten_[i] && deflections_.at_end(i - 1).norm() > jump(i)) take(i - 1);
    }
  }
  void take(std::size_t i) { rewritten_[i] = rewritten_[i] || !frozen_[i]; }

  [[nodiscard]] bool merges(std::size_t corner) const { return !merged_.empty() && merged_[corner]; }

  /// Up to which jump move `of` shares the corner before the move of number `corner`, m. To save a short block it goes
  /// beyond `jump`, as far as the tube may hold it: so much a side of it, in shares of the tolerance.
  [[nodiscard]] double shared(std::size_t corner, std::size_t of, double sides) const {
    if (!merges(corner)) return jump(of);
    constexpr double kASide = 0.8 * (1 + 1e-9);
    return std::max(jump(of),
                    std::min(job_.controller.shortest_block(moves_[of].feed), sides * kASide * job_.tolerance));
  }

  [[nodiscard]] Plan pieces_of(std::size_t i, const Deflections& d, const Vec3& first, const Vec3& last) const {
    if (options_.method == CorrectMethod::mirror) return equal_pieces(moves_[i], d, last, options_.mirror_points);
    const double chord = options_.chord > 0 ? options_.chord : 0.1 * job_.tolerance;
    const double shortest = job_.controller.shortest_block(moves_[i].feed);
    return fit_pieces(moves_[i], d, first, last, {fit_[i], chord, shortest, !chords_.empty() && chords_[i]});
  }

  /// Plans move after move: where the command is when one begins follows from those before it.
  class Planner {
   public:
    explicit Planner(const Corrector& corrector) : corrector_(corrector) {}
    /// The blocks of the next move, none where it is not rewritten; until the next call.
    const Plan& next() {
      corrector_.plan(i_++, stands_, deflections_, plan_);
      return plan_;
    }

   private:
    const Corrector& corrector_;
    std::size_t i_ = 0;
    Vec3 stands_ = Vec3::Zero();
    Deflections deflections_;
    Plan plan_;
  };

  /// The plan of a move; `stands`: where the command is when it begins, and then when the next one does.
  void plan(std::size_t i, Vec3& stands, Deflections& d, Plan& plan) const {
    plan.clear();
    if (!rewritten_[i]) {
      stands = moves_[i].end;
      return;
    }
    const gcode::Move& move = moves_[i];
    deflections_.get(i, d);
    const double before = shared(i, i, 1);
    const Vec3 ideal = move.start - d.delta.front();
    Vec3 first = d.delta.front().norm() > before ? ideal : move.start;
    if ((first - stands).norm() <= before || (merges(i) && (ideal - stands).norm() <= before)) {
      first = stands;  // a corner that both moves share, or none
    } else {
      plan.push_back({first, true, {}});
    }
    Vec3 last = move.end;
    bool release = false;
    const bool next_too = meet(i) && rewritten_[i + 1];
    if (next_too && (d.delta.back() - deflections_.at_start(i + 1)).norm() <= shared(i + 1, i, 2)) {
      last = move.end - 0.5 * (d.delta.back() + deflections_.at_start(i + 1));
    } else if (d.delta.back().norm() > shared(i + 1, i, 1)) {
      last = move.end - d.delta.back();
      release = !next_too;  // let the load go on the spot before the tool leaves
    }
    stands = release ? move.end : last;
    for (Piece& piece : pieces_of(i, d, first, last)) plan.push_back(std::move(piece));
    if (release) plan.push_back({move.end, true, {}});
  }

  /// Writes the text, reads it back, and judges what was read.
  Status write_and_check() {
    POLYPOD_TRY(write());
    return check();
  }

  Status write() {
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

  /// The points of the blocks that stand for a move; false where it keeps its text. `stands`: where the written program
  /// stands.
  bool replace(std::size_t i, const Plan& plan, const gcode::Decimals& decimals, Vec3& stands, gcode::Replacement& r) {
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
    for (std::size_t j = 0; j < plan.size(); ++j) {
      const Piece& piece = plan[j];
      const bool needed = j + 1 == plan.size() && r.points.empty();
      if (same(piece.end, stands) && !needed) continue;
      r.points.push_back({piece.end, moves_[i].axes_end, piece.centre});
      transitions_.push_back(piece.transition);
      stands = piece.end;
    }
    return true;
  }

  /// Header and path control modes, and reading back: from here on only what was written counts.
  Status finish_text() {
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

  /// What was written, with the path control modes that replace those of the program; their words are not read.
  [[nodiscard]] gcode::Program with_modes() const {
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

  [[nodiscard]] std::vector<std::string> header_lines() const {
    std::set<int> tools;
    for (const MovePrediction& m : out_.before.moves) tools.insert(moves_[static_cast<std::size_t>(m.move)].tool);
    std::string cutters;
    for (const int tool : tools) {
      const cutting::Cutter& c = job_.cutter_of(tool);
      const std::string cutter = fmt::format("{} {:g} mm with {} teeth, ", cutting::is_ball(c) ? "ball" : "cutter",
                                             units::to_mm(c.diameter), c.teeth);
      if (cutters.find(cutter) == std::string::npos) cutters += cutter;
    }
    const auto changed = std::count(changed_.begin(), changed_.end(), true);
    std::vector<std::string> header{
        fmt::format("{} {}", changed > 0 ? kCorrectedMark : kLookedAtMark, machine::name_of(job_.machine)),
        fmt::format("Polypod: tube radius {:g} um, {}origin {}", units::to_um(job_.tolerance), cutters,
                    place_in_words(job_.X_MW))};
    header.push_back(
        changed > 0 ? fmt::format("Polypod: {} of {} moves rewritten, do not correct again", changed, moves_.size())
                    : fmt::format("Polypod: nothing was corrected, {} moves are as they were", moves_.size()));
    if (fixed_other_ != nullptr) {
      header.push_back(fmt::format("Polypod: written with block delete {}; the switch does not act on this program",
                                   fixed_other_->block_delete ? "off" : "on"));
    }
    if (!warning_.empty()) header.push_back("Polypod: " + warning_);
    if (job_.measured) {
      header.push_back(
          fmt::format("Polypod: compliance interpolated from {} measured points", job_.measured->map.size()));
      if (!job_.measured->doubts.empty()) header.push_back("Polypod: these are doubtful, NOT judged against the tube");
    }
    return header;
  }

  /// The block of the original that a block of the written program stands for.
  [[nodiscard]] int source_block(int written) const {
    auto block = static_cast<std::size_t>(written);
    if (block >= header_at_) block -= header_size_;
    return rewritten_text_.source[block];
  }

  /// Finds for every move that was read back the programmed move it stands for, and whether it is a transition.
  Status match(const gcode::Interpretation& run) {
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

  [[nodiscard]] LongVector<int> moves_by_block(const LongVector<gcode::Move>& moves) const {
    LongVector<int> out(program_.blocks.size(), -1);
    for (std::size_t i = 0; i < moves.size(); ++i) out[static_cast<std::size_t>(moves[i].block)] = static_cast<int>(i);
    return out;
  }

  /// Adds a commanded move; what starts at a height that the program has not said starts where the original does.
  void add(Way& way, const gcode::Move& commanded, std::size_t source, bool transition,
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

  Status mismatch(const gcode::Move& move) const {
    return fail("MC220", "a block that was written does not read back as the move that was planned",
                Place{out_.program.path, out_.program.blocks[static_cast<std::size_t>(move.block)].line, 1},
                "please report this program");
  }

  /// Whether what was written commands what the program did: then it does what was predicted of that.
  [[nodiscard]] bool commands_the_same() const {
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

  Status check() {
    if (!verifies() && commands_the_same()) {
      rapids_ = no_rapid_cuts(job_, program_, out_.before.pass);
      after_notes_ = pass_notes(job_, program_, out_.before.pass);
      take_after(out_.before);
      return {};
    }
    PredictOptions options;
    options.step = check_step();
    options.keep_samples = options_.keep_samples;
    options.progress = progress("checking what was written");
    POLYPOD_ASSIGN(after, predict_way(job_, named_, way_, options, scratch_));
    rapids_ = no_rapid_cuts(job_, named_, after.pass);
    after_notes_ = pass_notes(job_, named_, after.pass);
    out_.verified = verifies() && (fit_finely_ || after.largest_distance <= inside());
    if (out_.verified) {
      POLYPOD_TRY(look_finely(named_, way_, after));
      fit_finely_ = fit_finely_ || after.largest_distance > inside();
    }
    take_after(std::move(after));
    return {};
  }

  void take_after(Prediction after) {
    out_.after = std::move(after);
    out_.largest_distance = out_.after.largest_distance;
    after_.assign(moves_.size(), 0);
    for (const MovePrediction& m : out_.after.moves) after_[static_cast<std::size_t>(m.move)] = m.largest_distance;
  }

  [[nodiscard]] bool outside(std::size_t i) const { return after_[i] > inside(); }
  /// A rewritten move that came no closer, or one that its neighbours have pushed out of the tube.
  [[nodiscard]] bool worse(std::size_t i) const {
    return after_[i] > before_[i] + kSameDistance && (rewritten_[i] || outside(i));
  }
  [[nodiscard]] std::size_t count(bool (Corrector::*what)(std::size_t) const) const {
    std::size_t n = 0;
    for (std::size_t i = 0; i < moves_.size(); ++i) n += (this->*what)(i) ? 1 : 0;
    return n;
  }

  /// The choice of a round and how good it is: moves outside, then the largest distance.
  struct Choice {
    std::vector<bool> rewritten;
    LongVector<double> fit;
    double sample_step = 0;
    bool fit_finely = false;
    std::size_t bad = 0;
    double largest = 0;
    [[nodiscard]] bool better_than(const Choice& o) const { return bad != o.bad ? bad < o.bad : largest < o.largest; }
  };
  [[nodiscard]] Choice choice() const {
    std::size_t bad = 0;
    for (std::size_t i = 0; i < moves_.size(); ++i) bad += outside(i) ? 1 : 0;
    return {rewritten_, fit_, sample_step_, fit_finely_, bad, out_.largest_distance};
  }

  /// Fits to narrower tubes until every move is inside; the best round stays.
  Status refine() {
    std::optional<Choice> best;
    for (out_.rounds = 1;; ++out_.rounds) {
      POLYPOD_TRY(write_and_check());
      const Choice now = choice();
      if (!best || now.better_than(*best)) best = now;
      if (now.bad == 0 || options_.method == CorrectMethod::mirror) return {};
      if (out_.rounds >= (fit_finely_ ? 2 : 1) * options_.rounds || !narrow()) break;
      // Knots are samples: a narrower tube in the ramps of corners needs closer ones.
      sample_step_ = std::max(0.5 * sample_step_, finest_);
      POLYPOD_TRY(find_deflections());
    }
    return restore(*best);
  }

  Status restore(const Choice& best) {
    rewritten_ = best.rewritten;
    fit_ = best.fit;
    sample_step_ = best.sample_step;
    fit_finely_ = best.fit_finely;
    POLYPOD_TRY(find_deflections());
    return write_and_check();
  }

  /// Narrower tubes for the moves that the check found outside; false if there is nothing left to try.
  bool narrow() {
    bool changed = false;
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (!outside(i)) continue;
      if (!rewritten_[i]) {
        if (frozen_[i] || !deflections_.cuts(i)) continue;
        rewritten_[i] = true;
        changed = true;
      } else if (fit_[i] > kNarrowest * job_.tolerance && (last_.empty() || after_[i] < kHelps * last_[i])) {
        fit_[i] *= 0.5;
        changed = true;
      } else {
        changed = take_neighbours(i) || changed;
      }
    }
    last_ = after_;
    spread_choice();
    return changed;
  }

  /// What a move meets depends on what those before it left: they are corrected too. False if they are already.
  bool take_neighbours(std::size_t i) {
    bool changed = false;
    for (const std::size_t k : {i - 1, i + 1}) {
      if (k >= moves_.size() || rewritten_[k] || frozen_[k] || !deflections_.cuts(k)) continue;
      rewritten_[k] = changed = true;
    }
    return changed;
  }

  /// Moves inside the tube are corrected where one block does it.
  Status correct_the_rest() {
    std::vector<bool> extra(moves_.size(), false);
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      extra[i] = deflections_.cuts(i) && !rewritten_[i] && !frozen_[i];
      if (extra[i]) rewritten_[i] = true;
    }
    for (bool changed = true; changed;) {
      changed = false;
      Planner planner(*this);
      std::vector<bool> taken_back(moves_.size(), false);  // when all are planned: they count for their neighbours
      for (std::size_t i = 0; i < moves_.size(); ++i) {
        const std::size_t blocks = planner.next().size();
        if (!extra[i] || blocks == 1) continue;
        taken_back[i] = changed = true;
      }
      for (std::size_t i = 0; i < moves_.size(); ++i) {
        if (taken_back[i]) extra[i] = rewritten_[i] = false;
      }
    }
    return write_and_check();
  }

  /// A move that came no closer to the programmed path gets its text back; where one that has its text came farther,
  /// the rewritten ones next to it do, which left it other material. If that does not help, all of its contour do, then
  /// all.
  Status give_back_what_got_worse() {
    const auto give_back = [&](std::size_t i) {
      rewritten_[i] = false;
      frozen_[i] = true;
    };
    for (int round = 0; round < kGiveBackRounds && count(&Corrector::worse) > 0; ++round) {
      std::vector<std::size_t> which;
      for (std::size_t i = 0; i < moves_.size(); ++i) {
        if (!worse(i)) continue;
        if (rewritten_[i]) {
          which.push_back(i);
          continue;
        }
        // Of its own contour first: what lies beyond is given back only where nothing of it is left.
        const auto [first, end] = contour_of(i);
        std::size_t before = i, after = i + 1;
        while (before > first && !rewritten_[before]) --before;
        if (!rewritten_[before])
          while (before > 0 && !rewritten_[before]) --before;
        if (rewritten_[before]) which.push_back(before);
        if (after < end && rewritten_[after]) which.push_back(after);
      }
      std::for_each(which.begin(), which.end(), give_back);
      spread_choice();
      POLYPOD_TRY(write_and_check());
    }
    // What cannot be held takes its own contour with it before it takes the others.
    for (int round = 0; round < kGiveBackRounds && is_worse(); ++round) {
      for (const std::size_t i : what_came_farther()) {
        const auto [first, end] = contour_of(i);
        for (std::size_t k = first; k < end; ++k)
          if (rewritten_[k]) give_back(k);
      }
      POLYPOD_TRY(write_and_check());
    }
    if (!is_worse()) return {};
    for (std::size_t i = 0; i < moves_.size(); ++i)
      if (rewritten_[i]) give_back(i);
    return write_and_check();
  }

  /// The moves that cut one after the other with nothing between them, of which i is one: from the first to before the
  /// last of the pair.
  [[nodiscard]] std::pair<std::size_t, std::size_t> contour_of(std::size_t i) const {
    std::size_t first = i, end = i + 1;
    while (first > 0 && meet(first - 1)) --first;
    while (end < moves_.size() && meet(end - 1)) ++end;
    return {first, end};
  }

  /// Whether some move, or the whole, has come farther from the programmed path.
  [[nodiscard]] bool is_worse() const {
    return count(&Corrector::worse) > 0 || out_.largest_distance > out_.before.largest_distance + kSameDistance;
  }

  /// Moves that came farther; where only the whole did, the farthest.
  [[nodiscard]] std::vector<std::size_t> what_came_farther() const {
    std::vector<std::size_t> out;
    for (std::size_t i = 0; i < moves_.size(); ++i)
      if (worse(i)) out.push_back(i);
    if (out.empty())
      out.push_back(static_cast<std::size_t>(std::max_element(after_.begin(), after_.end()) - after_.begin()));
    return out;
  }

  /// Whether a written block is shorter than the controller takes, though what it stands for is not.
  [[nodiscard]] bool is_short(std::size_t c) const {
    const PassMove& m = way_.moves[c];
    const auto i = static_cast<std::size_t>(way_.source[c]);
    if (!changed_[i] || m.move.kind == gcode::MoveKind::rapid) return false;
    constexpr double kGrain = 1e-6;  // m, more than what rounding takes
    const double shortest = job_.controller.shortest_block(moves_[i].feed) - kGrain;
    if (!(m.move.length() < shortest)) return false;
    const auto other = [&](std::size_t k) { return k < way_.source.size() && way_.source[k] == way_.source[c]; };
    const bool alone = !m.transition && !other(c + 1) && !(c > 0 && other(c - 1));
    return !(alone && moves_[i].length() < shortest);
  }

  /// Transitions that the controller would find too short are left out and their corners shared, where the tube holds
  /// that with room to spare for the controller's corners; else they stay, and are counted.
  Status share_corners_of_short_blocks() {
    merged_.assign(moves_.size() + 1, false);
    for (std::size_t c = 0; c < way_.moves.size(); ++c) {
      if (!way_.moves[c].transition || !is_short(c)) continue;
      const auto i = static_cast<std::size_t>(way_.source[c]);
      const bool first = c == 0 || way_.source[c - 1] != way_.source[c];
      merged_[first ? i : i + 1] = true;
    }
    if (!any_merged()) return {};
    const LongVector<double> kept = after_;
    const bool stopped = stops_at() >= 0;
    constexpr int kTries = 20;
    for (int tried = 0; tried < kTries; ++tried) {
      POLYPOD_TRY(share_what_fits(kept));
      // Stops at every corner are no price for a longer block.
      const int joint = stopped ? -1 : stops_at();
      if (!any_merged() || joint < 0) return {};
      bool fewer = false;
      for (const int c : {joint, std::min(joint + 1, static_cast<int>(way_.source.size()) - 1)}) {
        const auto i = static_cast<std::size_t>(way_.source[static_cast<std::size_t>(c)]);
        for (const std::size_t corner : {i, i + 1}) {
          fewer = fewer || merged_[corner];
          merged_[corner] = false;
        }
      }
      if (!fewer) break;
    }
    std::fill(merged_.begin(), merged_.end(), false);
    return write_and_check();
  }

  [[nodiscard]] bool any_merged() const { return std::find(merged_.begin(), merged_.end(), true) != merged_.end(); }

  /// The joint for which the tube asks for exact stops; -1 where it does not.
  int stops_at() {
    const Corners now = corners_now();
    if (now.kept) return -1;
    const PathModeChoice choice = mode_for(job_, way_, now);
    return choice.control.mode == gcode::PathMode::exact_stop ? choice.limiting : -1;
  }

  /// Gives back the transitions of moves that come farther than they were, and into what is left to the controller.
  Status share_what_fits(const LongVector<double>& kept) {
    constexpr double kSpare = 0.9;
    constexpr int kTries = 6;
    for (int tried = 0;; ++tried) {
      POLYPOD_TRY(write_and_check());
      bool bad = false, fewer = false;
      for (std::size_t i = 0; i < moves_.size(); ++i) {
        if (after_[i] <= std::max(kept[i] + kSameDistance, kSpare * inside())) continue;
        bad = true;
        for (const std::size_t corner : {i, i + 1}) {
          fewer = fewer || merged_[corner];
          merged_[corner] = false;
        }
      }
      if (!bad) return {};
      if (!fewer || tried == kTries) std::fill(merged_.begin(), merged_.end(), false);
      if (!any_merged()) return write_and_check();
    }
  }

  // --- The controller --------------------------------------------------------------------------------------------

  /// The corners of what is written, in the modes that it has so far.
  Corners corners_now() {
    if (before_with_.empty()) {
      before_with_ = corners_of(job_, program_, as_programmed(), out_.before, inside()).with;
    }
    return corners_of(job_, out_.program, way_, out_.after, inside(), &before_with_);
  }

  /// Arcs at whose ends only exact stops would keep the tube are written as chords, whose corners a blend tolerance
  /// keeps: where that spares the stops, and brings no move farther.
  Status chords_in_place_of_stops() {
    const LongVector<double> kept = after_;
    constexpr int kTries = 6;
    for (int tried = 0; tried < kTries; ++tried) {
      const Corners now = corners_now();
      if (now.kept) return {};
      const PathModeChoice choice = mode_for(job_, way_, now);
      if (choice.control.mode != gcode::PathMode::exact_stop) return {};
      if (!take_chords(choice.not_kept)) break;
      POLYPOD_TRY(write_and_check());
      if (comes_farther_than(kept)) break;
    }
    if (chords_.empty()) return {};
    chords_.clear();
    return write_and_check();
  }

  /// The rewritten arcs at these joints of the written program; false if all are chords already, or there are none.
  bool take_chords(const std::vector<int>& joints) {
    bool more = false;
    for (const int joint : joints) {
      std::size_t next = static_cast<std::size_t>(joint) + 1;
      while (next + 1 < way_.moves.size() && !(way_.moves[next].move.length() > 0)) ++next;
      for (const std::size_t c : {static_cast<std::size_t>(joint), next}) {
        const auto i = static_cast<std::size_t>(way_.source[c]);
        if (!changed_[i] || moves_[i].kind != gcode::MoveKind::arc || (!chords_.empty() && chords_[i])) continue;
        chords_.resize(moves_.size(), false);
        chords_[i] = more = true;
      }
    }
    return more;
  }

  /// Whether a move has left the tube, or the programmed path by more than before and its own distance without
  /// correction.
  [[nodiscard]] bool comes_farther_than(const LongVector<double>& kept) const {
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (outside(i) && after_[i] > kept[i] + kSameDistance) return true;
    }
    return is_worse();
  }

  Status choose_modes() {
    const Corners now = corners_now();
    out_.modes.time_without = now.time;
    if (now.kept) return {};
    const gcode::PathControl control = mode_for(job_, way_, now).control;
    if (control == gcode::PathControl{} && now.breaking.empty()) return {};  // no mode would help
    mode_ = control;
    for (const int block : now.breaking) {
      mode_blocks_.push_back(source_block(block));
      out_.modes.replaced.push_back(program_.blocks[static_cast<std::size_t>(mode_blocks_.back())].line);
    }
    out_.modes.written = path_mode_words(*mode_);
    return finish_text();
  }

  // --- The verdict -----------------------------------------------------------------------------------------------

  Status judge() {
    out_.commanded = way_.moves;
    out_.source = way_.source;
    POLYPOD_TRY(rapids_);
    gcode::Interpretation written;
    for (const PassMove& move : way_.moves) written.moves.push_back(move.move);
    POLYPOD_TRY(accept_reach(job_, named_, written));
    const Way as_it_was = as_programmed();
    const Corners before = corners_of(job_, program_, as_it_was, out_.before, inside());
    const Corners after = corners_of(job_, out_.program, way_, out_.after, inside());
    out_.modes.chords = static_cast<int>(std::count(chords_.begin(), chords_.end(), true));
    out_.modes.corner_before = before.largest;
    out_.modes.corner_after = after.largest;
    out_.modes.time_before = before.time;
    out_.modes.time_after = after.time;
    out_.largest_before = before.largest_with;
    out_.largest_after = after.largest_with;
    out_.before.slow = before.slow;
    out_.after.slow = after.slow;
    outcomes(before, after);
    POLYPOD_TRY(judge_other_switch());
    decide();
    out_.after.notes = after_notes_;
    if (!out_.within_tolerance) {  // whoever finds the file without its report must see it
      POLYPOD_TRY(finish_text());
      out_.commanded = way_.moves;
    }
    count_short_blocks();
    return {};
  }

  void outcomes(const Corners& before, const Corners& after) {
    LongVector<MoveOutcome> of(moves_.size());
    farthest_.assign(moves_.size(), 0);
    std::vector<bool> cuts(moves_.size(), false);
    for (const MovePrediction& m : out_.before.moves) {
      const auto i = static_cast<std::size_t>(m.move);
      cuts[i] = true;
      of[i].normal_before = m.normal;
      of[i].distance_before = m.largest_distance;
    }
    for (const MovePrediction& m : out_.after.moves) {
      const auto i = static_cast<std::size_t>(m.move);
      cuts[i] = true;
      of[i].normal_after = m.normal;
      of[i].distance_after = m.largest_distance;
    }
    for (std::size_t c = 0; c < way_.moves.size(); ++c) {
      const auto i = static_cast<std::size_t>(way_.source[c]);
      if (changed_[i]) ++(way_.moves[c].transition ? of[i].transitions : of[i].pieces);
      of[i].corner_after = std::max(of[i].corner_after, after.deviation[c]);
      farthest_[i] = std::max(farthest_[i], after.with[c]);
      of[i].within = (c == 0 || way_.source[c - 1] != way_.source[c] || of[i].within) && after.with[c] <= inside();
    }
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (changed_[i]) ++out_.rewritten_moves;
      if (frozen_[i]) ++out_.left_as_they_were;
      if (!cuts[i]) continue;
      of[i].move = static_cast<int>(i);
      of[i].line = line_of(i);
      of[i].rewritten = changed_[i];
      of[i].length = moves_[i].length();
      of[i].corner_before = before.deviation[i];
      out_.moves.push_back(of[i]);
    }
  }

  /// The corrected program with the block delete switch in its other position.
  Status judge_other_switch() {
    if (fixed_other_ != nullptr) {
      out_.other_switch = *fixed_other_;
      return {};
    }
    if (!has_optional_blocks(program_)) return {};
    OtherSwitch& other = out_.other_switch.emplace();
    other.block_delete = !job_.block_delete;
    const auto here = [&](Error error) { return tl::unexpected(at_switch(std::move(error), other.block_delete)); };
    gcode::InterpretOptions options = job_.interpret_options();
    options.block_delete = other.block_delete;
    const Result<gcode::Interpretation> programmed = gcode::interpret(program_, options);
    if (!programmed) return here(programmed.error());
    POLYPOD_ASSIGN(position, OtherPosition::of(job_, program_, *programmed, {}));
    POLYPOD_ASSIGN(written, gcode::interpret(out_.program, options));
    const LongVector<gcode::Move>& moves = position.moves();
    const LongVector<int> move_of_block = moves_by_block(moves);
    const Way as_it_was = way_as_programmed(program_, moves);
    Way way{&program_, &moves, {}, {}};
    const LongVector<int> first_of_block = moves_by_block(moves_);
    for (const gcode::Move& move : written.moves) {
      const int block = source_block(move.block);
      const int source = move_of_block[static_cast<std::size_t>(block)];
      if (source < 0) return mismatch(move);
      const int first = first_of_block[static_cast<std::size_t>(block)];
      const bool rewritten = first >= 0 && changed_[static_cast<std::size_t>(first)];
      add(way, move, static_cast<std::size_t>(source), transition_blocks_[static_cast<std::size_t>(move.block)], moves,
          rewritten);
    }
    PredictOptions predict_options;
    predict_options.step = check_step();
    predict_options.progress = progress("checking with the other position of block delete");
    POLYPOD_ASSIGN(before, predict_way(job_, program_, as_it_was, predict_options));
    if (const Status free = no_rapid_cuts(job_, program_, before.pass); !free) return here(free.error());
    POLYPOD_ASSIGN(after, predict_way(job_, named_, way, predict_options));
    if (const Status free = no_rapid_cuts(job_, named_, after.pass); !free) return here(free.error());
    other.cuts = !before.moves.empty();
    other.distance_before = corners_of(job_, program_, as_it_was, before, inside()).largest_with;
    const Corners corners_after = corners_of(job_, out_.program, way, after, inside());
    other.distance_after = corners_after.largest_with;
    other.line = corners_after.line;
    other.slow = corners_after.slow;
    const std::vector<NotJudged>& open = after.not_judged.empty() ? before.not_judged : after.not_judged;
    if (!open.empty()) other.reason = fmt::format("line {}: {}", open.front().line, open.front().why);
    other.within_tolerance = other.distance_after <= inside() && open.empty();
    other.steep = after.steep;
    other.plunges = after.plunges;
    return {};
  }

  void decide() {
    const MoveOutcome* worst = nullptr;
    const auto reach = [&](const MoveOutcome& o) { return farthest_[static_cast<std::size_t>(o.move)]; };
    for (const MoveOutcome& m : out_.moves) {
      if (!m.within && (worst == nullptr || reach(m) > reach(*worst))) worst = &m;
    }
    const bool judged = out_.after.not_judged.empty() && out_.before.not_judged.empty();
    const bool other = !out_.other_switch || out_.other_switch->within_tolerance;
    out_.within_tolerance = worst == nullptr && judged && other;
    if (worst != nullptr) {
      warning_ = fmt::format("NOT within the tube, up to {:.1f} um from the path of line {} of the original",
                             units::to_um(reach(*worst)), worst->line);
      out_.reason = fmt::format("line {}: the deflected tool is up to {:.1f} um from the programmed move", worst->line,
                                units::to_um(worst->distance_after));
      if (worst->corner_after > 0) {
        out_.reason +=
            fmt::format(", and the controller rounds its corner by up to {:.1f} um", units::to_um(worst->corner_after));
      }
      out_.reason += fmt::format("; the tolerance is {:g} um", units::to_um(job_.tolerance));
      if (worst->distance_after <= job_.tolerance && worst->distance_after > inside()) {
        out_.reason += fmt::format(", of which {:.1f} um are kept free for what the cells of the stock leave open",
                                   units::to_um(resolution(job_)));
      }
    } else if (!judged) {
      const NotJudged& first =
          out_.after.not_judged.empty() ? out_.before.not_judged.front() : out_.after.not_judged.front();
      out_.only_not_judged = true;
      out_.reason = fmt::format("line {}: {}{}", first.line, first.why,
                                other ? ". Every distance that was computed is inside the tube" : "");
      warning_ = "NOT judged to be within the tube, see line " + std::to_string(first.line) + " of the original";
    } else if (!other) {
      const OtherSwitch& at = *out_.other_switch;
      const char* position = at.block_delete ? "on" : "off";
      const double distance = units::to_um(at.distance_after);
      if (at.distance_after <= inside() && !at.reason.empty()) {
        warning_ = fmt::format("NOT judged to be within the tube with block delete {}", position);
        out_.reason = fmt::format("with block delete {}, {}", position, at.reason);
      } else {
        warning_ = fmt::format("NOT within the tube with block delete {}, up to {:.1f} um from the path of line {}",
                               position, distance, at.line);
        out_.reason = fmt::format(
            "line {}: with block delete {} the deflected tool is up to {:.1f} um from the programmed move; the "
            "tolerance is {:g} um",
            at.line, position, distance, units::to_um(job_.tolerance));
      }
    }
  }

  /// Blocks that stand for rewritten moves and are shorter than the controller takes.
  void count_short_blocks() {
    ShortBlocks& out = out_.short_blocks;
    for (std::size_t c = 0; c < way_.moves.size(); ++c) {
      const auto i = static_cast<std::size_t>(way_.source[c]);
      if (!changed_[i]) continue;
      ++out.written;
      if (!is_short(c)) continue;
      const gcode::Move& move = way_.moves[c].move;
      const double length = move.length(), time = length / (move.feed * job_.controller.planner.feed_override);
      if (out.count++ == 0) {
        out.line = line_of(i);
        out.written_line = out_.program.blocks[static_cast<std::size_t>(move.block)].line;
        out.length = length;
        out.time = time;
      }
      out.length = std::min(out.length, length);
      out.time = std::min(out.time, time);
    }
  }

  [[nodiscard]] int line_of(std::size_t i) const {
    return program_.blocks[static_cast<std::size_t>(moves_[i].block)].line;
  }

  const Job& job_;
  const gcode::Program& program_;
  const gcode::Interpretation& interpretation_;
  const CorrectOptions& options_;
  const LongVector<gcode::Move>& moves_;
  std::vector<double> feed_scale_;  // empty: all 1
  const OtherSwitch* fixed_other_ = nullptr;
  Aside* reach_ = nullptr;
  const Prediction* known_before_ = nullptr;
  DeflectionsOfMoves deflections_;
  double sample_step_ = job_.step;
  // Pieces of a ball that are shorter than the way ahead which is looked at end in corners of their own.
  double finest_ =
      has_balls(job_) ? std::min(job_.step, look_ahead_length(job_.stock, job_.cutter.radius())) : job_.stock.cell();
  LongVector<double> fit_;
  std::vector<bool> rewritten_;
  std::vector<bool> changed_;  // rewritten, and not to the same digits
  std::vector<bool> chords_;   // arcs that are written as lines; empty: none
  std::vector<bool> merged_;   // by corner, that before the move of this number: shared to save a short block
  std::vector<bool> frozen_;   // their correction was worse than none
  LongVector<double> before_, after_, last_;
  LongVector<double> farthest_;            // of each move the largest distance with the corner of the same piece
  LongVector<double> before_with_;         // corners counted; found where it is asked for
  std::optional<Job> fine_;                // the job with cells half as large
  cutting::Stock scratch_, fine_scratch_;  // what the passes cut, of either
  bool fit_finely_ = false;                // deflections are found in those
  gcode::Rewritten rewritten_text_;
  // Which written points end a transition, and where those of each rewritten move begin among them.
  LongVector<bool> transitions_;
  LongVector<std::size_t> first_transition_;
  std::vector<bool> transition_blocks_;  // by block of the written program
  std::size_t header_at_ = 0, header_size_ = 0;
  // The blocks that were written, without their text, with the path and the lines of the original: of those alone
  // errors speak.
  gcode::Program named_;
  Status rapids_;                         // of what was checked
  std::vector<std::string> after_notes_;  // likewise
  std::string warning_;                   // of the header
  std::optional<gcode::PathControl> mode_;
  std::vector<int> mode_blocks_;  // of the original
  Way way_;
  Correction out_;
};

/// The program unrolled for the other position of block delete: as it is, and with a correction of its own.
Result<std::optional<OtherSwitch>> other_unrolled(const Job& job, const CorrectOptions& options) {
  if (options.other == nullptr) return std::nullopt;
  OtherSwitch other;
  other.block_delete = !job.block_delete;
  other.fixed = true;
  const gcode::Understood& at = *options.other;
  const auto here = [&](Error error) { return tl::unexpected(at_switch(std::move(error), other.block_delete)); };
  CorrectOptions its = options;
  its.other = nullptr;
  its.again = true;
  its.keep_samples = its.keep_stock = false;
  if (options.progress) {
    its.progress = [&](const char*, double share) {
      return options.progress("correcting with the other position of block delete", share);
    };
  }
  Result<Correction> c = correct(job, at.program, at.interpretation, its);
  if (!c && !says_that_nothing_is_cut(c.error())) return here(std::move(c.error()));
  if (!c) {
    POLYPOD_ASSIGN(position, OtherPosition::of(job, at.program, at.interpretation, {}));
    POLYPOD_ASSIGN(p, predict_way(job, at.program, way_as_programmed(at.program, position.moves()), {}));
    if (const Status free = no_rapid_cuts(job, at.program, p.pass); !free) return here(free.error());
    other.cuts = false;
    other.within_tolerance = true;
    return other;
  }
  other.distance_before = c->largest_before;
  other.distance_after = c->largest_after;
  other.within_tolerance = c->within_tolerance;
  other.reason = c->reason;
  other.steep = c->after.steep;
  other.slow = c->after.slow;
  other.plunges = c->after.plunges;
  return other;
}

/// What would help, tried out.
std::vector<std::string> remedies_for(const Job& job, const gcode::Program& program, const Accepted& accepted,
                                      const CorrectOptions& options, const Correction& result) {
  std::vector<std::string> out;
  for (const std::vector<NotJudged>* moves : {&result.before.not_judged, &result.after.not_judged}) {
    for (const NotJudged& m : *moves) {
      if (!m.remedy.empty() && std::find(out.begin(), out.end(), m.remedy) == out.end()) out.push_back(m.remedy);
    }
  }
  if (cost_of(job, result) > kTryRemediesBelow) return out;
  CorrectOptions quiet = options;
  quiet.keep_samples = quiet.verify = false;  // a first look; whoever follows the advice is told the whole
  // What holds after a few rounds is advice; a program on which many do not help is answered before long.
  constexpr int kRounds = 3;
  quiet.rounds = std::min(quiet.rounds, kRounds);
  std::size_t tried = 0;
  const auto holds = [&](const Result<Correction>& c) {
    if (c) tried += static_cast<std::size_t>(c->rounds + 1) * cost_of(job, *c);
    return c && c->within_tolerance;
  };
  const bool fixed = result.other_switch && result.other_switch->fixed;
  Job wider = job;
  // The smallest of these that does: how far the failed try was off says little of what would do.
  constexpr double kWidest = 10, kWide = 500;  // times the tolerance, or um: nobody asked for more
  const double asked = units::to_um(job.tolerance);
  const double most =
      std::min(std::max(kWidest * asked, kWide), 2 * std::max(asked, units::to_um(result.largest_after)));
  const bool judged = result.before.not_judged.empty();  // else no tube is wide enough
  for (double um = asked; judged && um < most && tried < kMostTried;) {
    um = std::ceil(um * 1.25);
    wider.tolerance = units::from_um(um);
    if (!holds(Corrector(wider, program, accepted, quiet).run())) continue;
    if (fixed) {
      const Result<std::optional<OtherSwitch>> other = other_unrolled(wider, quiet);
      if (!other || !(*other)->within_tolerance) continue;
    }
    out.push_back(fmt::format("a tube of {:g} um: --tolerance {:g}", units::to_um(wider.tolerance),
                              units::to_um(wider.tolerance)));
    break;
  }
  std::unordered_map<int, bool> within;  // by line: of its first move
  for (const MoveOutcome& m : result.moves) within.emplace(m.line, m.within);
  std::vector<bool> which(result.programmed.size(), false);
  std::string lines;
  std::size_t named = 0;
  for (std::size_t i = 0; i < result.programmed.size(); ++i) {
    const int line = program.blocks[static_cast<std::size_t>(result.programmed[i].block)].line;
    const auto at = within.find(line);
    if (at == within.end() || at->second) continue;
    which[i] = true;
    if (named++ < 8) lines += fmt::format("{}{}", lines.empty() ? "" : ", ", line);
  }
  if (named == 0) return out;
  if (fixed && !result.other_switch->within_tolerance) {
    out.push_back(
        fmt::format("`polypod correct` with block_delete = {} in the job says what would help in that position",
                    result.other_switch->block_delete));
    return out;
  }
  if (named > 8) lines += fmt::format(" and {} more", named - 8);
  lines = (named == 1 ? "line " : "lines ") + lines;
  // What bends in a corner comes from the move before it, too.
  std::vector<bool> before = which, all(which.size(), true);
  for (std::size_t i = 0; i + 1 < which.size(); ++i) before[i] = which[i] || which[i + 1];
  struct Slower {
    const std::vector<bool>& moves;
    std::string where;
    std::vector<double> factors;
  };
  for (const Slower& slower :
       {Slower{which, lines, {0.75, 0.5, 0.25, 0.1}}, Slower{before, lines + " and the moves before them", {0.5, 0.2}},
        Slower{all, "the whole program", {0.2}}}) {
    for (const double factor : slower.factors) {
      if (tried >= kMostTried) {
        out.push_back("further remedies were not tried out: each try of this program takes long");
        return out;
      }
      Corrector corrector(job, program, accepted, quiet);
      corrector.scale_feeds(slower.moves, factor);
      if (!holds(corrector.run())) continue;
      double feed = 0;
      for (std::size_t i = 0; i < which.size(); ++i) {
        if (slower.moves[i]) feed = std::max(feed, result.programmed[i].feed);
      }
      out.push_back(fmt::format("a smaller feed in {}: {:.0f} % of it, F{:.0f} where it is largest", slower.where,
                                100 * factor, units::to_mm_per_min(feed * factor)));
      return out;
    }
  }
  out.push_back(
      fmt::format("less depth or width, or a stiffer place: no smaller feed of those that were tried would do, in {} "
                  "or in the whole "
                  "program (down to a tenth and a fifth)",
                  lines));
  return out;
}

/// Whether one correction is better than another of the same program: inside the tube, else with fewer moves outside,
/// else with the smaller distance.
bool closer(const Correction& a, const Correction& b) {
  if (a.within_tolerance != b.within_tolerance) return a.within_tolerance;
  const auto outside = [](const Correction& c) {
    return std::count_if(c.moves.begin(), c.moves.end(), [](const MoveOutcome& m) { return !m.within; });
  };
  const auto of_a = outside(a), of_b = outside(b);
  return of_a != of_b ? of_a < of_b : a.largest_after < b.largest_after - kSameDistance;
}

Status is_flat_or_ball(const Job& job, const cutting::Cutter& cutter) {
  if (cutting::is_ball(cutter)) return {};
  return cutting::is_flat(cutter, {job.path}, "correct takes flat cutters and balls");
}

}  // namespace

std::string Correction::answer(const std::string& proviso) const {
  if (!within_tolerance)
    return (only_not_judged ? "no, not all of the cut is judged: " : "not within the tolerance: ") + reason;
  return fmt::format(
      "yes{}{}: the deflected tool stays within {:.1f} um of the programmed path{} (tube {:g} um)", proviso,
      all_judged() ? "" : ", apart from what was not judged",
      units::to_um(std::max({largest_after, after.plunge_within.distance,
                             other_switch && !other_switch->fixed ? other_switch->distance_after : 0.0})),
      modes.corner_after > 0 ? ", the corners that the controller rounds counted" : "", units::to_um(tolerance));
}

Result<Correction> correct(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                           const CorrectOptions& options) {
  POLYPOD_TRY(is_flat_or_ball(job, job.cutter));
  for (const auto& [number, cutter] : job.cutters) POLYPOD_TRY(is_flat_or_ball(job, cutter));
  std::function<bool(double)> progress;
  if (options.progress) progress = [&](double share) { return options.progress("checking the reach", share); };
  POLYPOD_ASSIGN(accepted, accept_but_reach(job, program, interpretation, options.again));
  Aside reach(
      [&](const Aside::Progress& report) { return accept_reach(job, program, accepted.interpretation(), report); },
      progress);
  const Result<std::optional<OtherSwitch>> other_found = other_unrolled(job, options);
  if (!other_found) POLYPOD_TRY(reach.result(progress));
  POLYPOD_ASSIGN(fixed_other, other_found);
  const auto corrected = [&](const CorrectOptions& how, const Prediction* before) {
    Corrector corrector(job, program, accepted, how);
    if (before != nullptr) corrector.take_before(*before);
    corrector.take_other(fixed_other);
    corrector.take_reach(&reach);
    return corrector.run();
  };
  POLYPOD_ASSIGN(out, corrected(options, nullptr));
  // Where the pieces end decides what the cells make of a corner: other pieces may do. The best of them stays.
  // What is not judged of the program as it is no correction answers.
  const bool small =
      cost_of(job, out) <= kTryRemediesBelow && options.method == CorrectMethod::tube && out.before.not_judged.empty();
  for (const double share : {0.9, 0.65, 1.4, 2.0}) {
    if (out.within_tolerance || !small) break;
    CorrectOptions other = options;
    other.fit_share = share;
    POLYPOD_ASSIGN(again, corrected(other, &out.before));
    if (closer(again, out)) out = std::move(again);
  }
  if (!out.within_tolerance && options.method == CorrectMethod::tube) {
    out.remedies = remedies_for(job, program, accepted, options, out);
  }
  std::vector<std::string> notes = std::move(accepted.notes);
  if (out.other_switch) gcode::drop_block_delete_note(notes);
  if (fixed_other) {
    notes.push_back(
        fmt::format("blocks that begin with / are {} in what is written, whatever the switch says; a program for the "
                    "other position "
                    "comes from a job with block_delete = {}",
                    job.block_delete ? "left out" : "carried out like all others", !job.block_delete));
  }
  for (std::string& note : condition_notes(job, out.programmed, out.before)) notes.push_back(std::move(note));
  for (std::string& note : pass_notes(job, program, out.before.pass)) notes.push_back(std::move(note));
  out.before.notes = std::move(notes);
  return out;
}

}  // namespace polypod::machining
