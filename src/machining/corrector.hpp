// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "aside.hpp"
#include "fit.hpp"
#include "modes.hpp"
#include "polypod/gcode/writer.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/correct.hpp"
#include "polypod/machining/weights.hpp"
#include "way.hpp"

namespace polypod::machining {

/// Two distances that differ by less than this are taken as equal, m: the stock's cells move them by as much.
inline constexpr double kSameDistance = 1e-6;

/// A rewritten move that comes farther by more than this, m, is not written: no figure shows less.
inline constexpr double kNotCloser = 0.05e-6;

/// The blocks that stand for one rewritten move.
using Plan = std::vector<Piece>;

[[nodiscard]] bool has_balls(const Job& job);

/// How long a pass of a correction takes, in points of flat cutters.
[[nodiscard]] std::size_t cost_of(const Job& job, const Correction& c);

/// One correction of a program: chooses and fits what is rewritten (corrector.cpp), writes and reads it back
/// (corrector_text.cpp), leaves to the controller what it may round (corrector_corners.cpp), and judges the whole
/// (corrector_verdict.cpp).
class Corrector {
 public:
  Corrector(const Job& job, const gcode::Program& program, const Accepted& accepted, const CorrectOptions& options)
      : job_(job),
        program_(program),
        interpretation_(accepted.interpretation()),
        options_(options),
        moves_(interpretation_.moves) {}

  /// For what-if: the feeds of some moves are taken smaller than they are written.
  void scale_feeds(const std::vector<bool>& which, double factor);

  /// What was found of the program unrolled for the other position of block delete.
  void take_other(const std::optional<OtherSwitch>& other) { fixed_other_ = other ? &*other : nullptr; }

  /// The check of the reach that is under way, and what it will have found; none where it is done.
  void take_reach(Aside* reach, const FollowedAnyway* as_programmed) {
    reach_ = reach;
    as_programmed_ = as_programmed;
  }

  /// What the program does as it is, where that is known.
  void take_before(const Prediction& before) { known_before_ = &before; }

  /// The correction, judged.
  Result<Correction> run();

 private:
  std::function<bool(double)> progress(const char* what) const;

  /// The step of the passes that judge, m.
  [[nodiscard]] double check_step() const;

  /// The program as it is, with the feeds that are tried.
  [[nodiscard]] Way as_programmed() const;

  /// What the program does as it is and what would correct it, side by side: neither needs the other.
  Status predict_and_find();

  /// That the machine can follow the program: what a pass says of that says less.
  [[nodiscard]] Status reached() const;

  Status predict_as_it_is();

  Status keep_before(Prediction before);

  /// The new program once more, for what it leaves; unlike anybody who reads it, this knows its transitions.
  Status leave_stock();

  /// Whether what is said is looked at again with finer cells.
  [[nodiscard]] bool verifies() const { return options_.method == CorrectMethod::tube && options_.verify; }

  const Job& fine_job();

  class FineLook;

  /// The deflections with the tool on the programmed path; in the finer cells once the coarse ones have misled.
  Status find_deflections();
  Status find_deflections(cutting::Stock& scratch, const std::function<bool(double)>& report);

  /// Whether moves i and i + 1 both cut and meet: nothing lies between them.
  [[nodiscard]] bool meet(std::size_t i) const;

  void choose_moves();

  /// How near to the wall of the tube a move may come, m: what the cells of the stock leave open is kept free.
  [[nodiscard]] double inside() const { return job_.tolerance - resolution(job_); }
  [[nodiscard]] std::string kept_free(double distance) const;

  /// Corners of move i are shared if they jump by less than this, m.
  [[nodiscard]] double jump(std::size_t i) const;

  /// A move that may stay is still rewritten if it meets a rewritten one in a corner where it deflects by more than the
  /// corner may jump: a step back to the programmed path would leave a mark.
  void spread_choice();
  void take(std::size_t i) { rewritten_[i] = rewritten_[i] || !frozen_[i]; }

  [[nodiscard]] bool merges(std::size_t corner) const { return !merged_.empty() && merged_[corner]; }

  /// Up to which jump move `of` shares the corner before the move of number `corner`, m. To save a short block it goes
  /// beyond `jump`, as far as the tube may hold it: so much a side of it, in shares of the tolerance.
  [[nodiscard]] double shared(std::size_t corner, std::size_t of, double sides) const;

  /// What the weight of the machine does to a tool that is commanded there, m, in W; 0 where it does not count.
  [[nodiscard]] Vec3 weight_at(const Vec3& p_W) const;

  [[nodiscard]] Plan pieces_of(std::size_t i, const Deflections& d, const Vec3& first, const Vec3& last) const;

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
  void plan(std::size_t i, Vec3& stands, Deflections& d, Plan& plan) const;

  /// Writes the text, reads it back, and judges what was read.
  Status write_and_check();

  /// The text, and what is read back of it.
  Status write();

  /// The points of the blocks that stand for a move; false where it keeps its text. `stands`: where the written program
  /// stands.
  bool replace(std::size_t i, const Plan& plan, const gcode::Decimals& decimals, Vec3& stands, gcode::Replacement& r);

  /// Header and path control modes, and reading back: from here on only what was written counts.
  Status finish_text();

  /// What was written, with the path control modes that replace those of the program; their words are not read.
  [[nodiscard]] gcode::Program with_modes() const;

  [[nodiscard]] std::vector<std::string> header_lines() const;

  /// The posture of the first cut and the rotation about the tool axis, for which the compliances were taken: "posture
  /// front elbow-up, tool held at C 0 deg" or what of it the machine has; nothing where a measured compliance
  /// takes their place.
  [[nodiscard]] std::string hold_in_words() const;
  /// C of all cuts, that of the job or of the program, rad; none where a program turns C.
  [[nodiscard]] std::optional<double> held_c() const;

  /// The block of the original that a block of the written program stands for.
  [[nodiscard]] int source_block(int written) const;

  /// Finds for every move that was read back the programmed move it stands for, and whether it is a transition.
  Status match(const gcode::Interpretation& run);

  [[nodiscard]] LongVector<int> moves_by_block(const LongVector<gcode::Move>& moves) const;

  /// Adds a commanded move; what starts at a height that the program has not said starts where the original does.
  void add(Way& way, const gcode::Move& commanded, std::size_t source, bool transition,
           const LongVector<gcode::Move>& programmed, bool rewritten) const;

  Status mismatch(const gcode::Move& move) const;

  /// Whether what was written commands what the program did: then it does what was predicted of that.
  [[nodiscard]] bool commands_the_same() const;

  Status check();

  void take_after(Prediction after);

  [[nodiscard]] bool outside(std::size_t i) const { return after_[i] > inside(); }
  /// A rewritten move that came no closer, or one that its neighbours have pushed out of the tube.
  [[nodiscard]] bool worse(std::size_t i) const;
  [[nodiscard]] std::size_t count(bool (Corrector::*what)(std::size_t) const) const;

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
  [[nodiscard]] Choice choice() const;

  /// Fits to narrower tubes until every move is inside; the best round stays.
  Status refine();

  Status restore(const Choice& best);

  /// Narrower tubes for the moves that the check found outside; false if there is nothing left to try.
  bool narrow();

  /// What a move meets depends on what those before it left: they are corrected too. False if they are already.
  bool take_neighbours(std::size_t i);

  /// Moves inside the tube are corrected where one block does it.
  Status correct_the_rest();

  /// A move that came no closer to the programmed path gets its text back; where one that has its text came farther,
  /// the rewritten ones next to it do, which left it other material. If that does not help, all of its contour do, then
  /// all.
  Status give_back_what_got_worse();

  /// The moves that cut one after the other with nothing between them, of which i is one: from the first to before the
  /// last of the pair.
  [[nodiscard]] std::pair<std::size_t, std::size_t> contour_of(std::size_t i) const;

  /// Whether some move, or the whole, has come farther from the programmed path.
  [[nodiscard]] bool is_worse() const;

  /// Moves that came farther; where only the whole did, the farthest.
  [[nodiscard]] std::vector<std::size_t> what_came_farther() const;

  /// Whether a written block is shorter than the controller takes, though what it stands for is not.
  [[nodiscard]] bool is_short(std::size_t c) const;

  /// Transitions that the controller would find too short are left out and their corners shared, where the tube holds
  /// that with room to spare for the controller's corners; else they stay, and are counted.
  Status share_corners_of_short_blocks();

  [[nodiscard]] bool any_merged() const { return std::find(merged_.begin(), merged_.end(), true) != merged_.end(); }

  /// The joint for which the tube asks for exact stops; -1 where it does not.
  int stops_at();

  /// Gives back the transitions of moves that come farther than they were, and into what is left to the controller.
  Status share_what_fits(const LongVector<double>& kept);

  // --- The controller --------------------------------------------------------------------------------------------

  /// The corners of what is written, in the modes that it has so far.
  Corners corners_now();

  /// Arcs at whose ends only exact stops would keep the tube are written as chords, whose corners a blend tolerance
  /// keeps: where that spares the stops, and brings no move farther.
  Status chords_in_place_of_stops();

  /// The rewritten arcs at these joints of the written program; false if all are chords already, or there are none.
  bool take_chords(const std::vector<int>& joints);

  /// Whether a move has left the tube, or the programmed path by more than before and its own distance without
  /// correction.
  [[nodiscard]] bool comes_farther_than(const LongVector<double>& kept) const;

  Status choose_modes();

  // --- The verdict -----------------------------------------------------------------------------------------------

  /// Everything that the answer rests on.
  Status judge();

  void outcomes(const Corners& before, const Corners& after);

  /// The corrected program with the block delete switch in its other position.
  Status judge_other_switch();

  void decide();

  /// Blocks that stand for rewritten moves and are shorter than the controller takes.
  void count_short_blocks();

  [[nodiscard]] int line_of(std::size_t i) const;

  const Job& job_;
  const gcode::Program& program_;
  const gcode::Interpretation& interpretation_;
  const CorrectOptions& options_;
  const LongVector<gcode::Move>& moves_;
  std::vector<double> feed_scale_;  // empty: all 1
  const OtherSwitch* fixed_other_ = nullptr;
  Aside* reach_ = nullptr;
  const FollowedAnyway* as_programmed_ = nullptr;
  FollowedAnyway as_written_;
  std::string too_fast_at_other_switch_;  ///< once corrected, and not as programmed; empty: none
  const Prediction* known_before_ = nullptr;
  mutable std::optional<WeightDeflection> weight_;  // keeps what it has computed
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

}  // namespace polypod::machining
