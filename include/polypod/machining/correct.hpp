// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Off-line correction of a program: the deflected tool stays in a tolerance tube round the programmed path.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/gcode/program.hpp"
#include "polypod/machining/path_mode.hpp"
#include "polypod/machining/predict.hpp"

namespace polypod::machining {

enum class CorrectMethod {
  tube,    ///< as few pieces as keep the deflected tool in the tube, command found as a fixed point
  mirror,  ///< one step, p - delta(p), at equally spaced points of every cutting move (SLAV (5.2)); for comparison
};

/// What the controller does with the blocks of a program and of its correction.
struct PathModes {
  std::string written;        ///< the words that the corrected program got, e.g. "G64 P0.045 Q0"; empty: none needed
  std::vector<int> replaced;  ///< lines of the original whose mode would break the tube and was replaced
  int chords = 0;             ///< arcs of the original that became lines, so that the controller need not stop
  double corner_before = 0;   ///< m, by which the controller rounds the worst corner of a cut of the program as it is
  double corner_after = 0;    ///< m, the same of the corrected program
  double time_before = 0;     ///< s, with the planner's acceleration
  double time_after = 0;      ///< s
  double time_without = 0;    ///< s, of the corrected program with the modes that it had; the rest is their cost
};

struct CorrectOptions {
  CorrectMethod method = CorrectMethod::tube;
  int mirror_points = 10;  ///< pieces a move for `mirror`
  double fit_share = 0.8;  ///< of the tolerance that the fit of pieces may use; the rest is for what the fit leaves out
  double merge_share = 0.25;  ///< two moves share their corner if their corrections differ by less than this share of
                              ///< the tolerance, else a transition goes from one to the other
  double chord = 0;     ///< m, how far an arc that is kept as arcs may be off the ideal command; 0: a tenth of the tube
  int rounds = 6;       ///< fits with a narrower tube where the check finds a point outside
  bool all = false;     ///< also moves that are inside the tube, where it adds no lines
  bool again = false;   ///< see AcceptOptions
  bool verify = false;  ///< look again in cells half as large, at half the step, before it is called within the tube
  bool remedies = true;  ///< where the tool stays outside, look for what would help: up to some ten corrections more
  bool keep_samples = false;
  bool keep_stock = false;
  const gcode::Understood* other = nullptr;  ///< see PredictOptions
  std::function<bool(const char* what, double share)> progress;
};

/// Blocks that were written and are shorter than the controller takes (Controller::shortest_block): transitions whose
/// corner cannot be shared inside the tube, and pieces next to them.
struct ShortBlocks {
  int count = 0;         ///< of them; a move that is no longer in the original does not count
  int written = 0;       ///< blocks that stand for rewritten moves
  int line = 0;          ///< of the first one, in the original
  int written_line = 0;  ///< the same in the corrected program
  double length = 0;     ///< m, of the shortest
  double time = 0;       ///< s, of the one that takes the least
};

/// What became of one move that cuts.
struct MoveOutcome {
  int move = 0;  ///< index of the programmed move
  int line = 0;  ///< in the original program
  bool rewritten = false;
  int pieces = 0;  ///< lines and arcs that stand for it, transitions not counted
  int transitions = 0;
  double length = 0;                               ///< m
  Spread normal_before, normal_after;              ///< m
  double distance_before = 0, distance_after = 0;  ///< m, largest of the deflected tool from the programmed move
  double corner_before = 0, corner_after = 0;      ///< m, by which the controller rounds the worse of its ends
  bool within = false;                             ///< inside the tube, corners and resolution counted
  /// False where a plunge that is not judged ends, or the worst of the steep places or slow corners lies: `within` is
  /// then for the rest of the move.
  bool judged = true;
};

struct Correction {
  gcode::Program program;     ///< the corrected program, read back
  Prediction before;          ///< of the original, in equilibrium
  Prediction after;           ///< of what was read back, against the original's moves
  cutting::Stock stock_left;  ///< what the deflected tool leaves of the stock with the new program, in W, if asked for
  LongVector<MoveOutcome> moves;
  LongVector<gcode::Move> programmed;  ///< the original's moves
  LongVector<PassMove> commanded;      ///< those read back; their `followed` points into `programmed`
  LongVector<int> source;              ///< for each commanded move the programmed move it stands for
  double tolerance = 0;                ///< m
  double largest_distance = 0;  ///< m, of a deflected point from its programmed move, ends as spheres, densely checked
  double largest_before = 0, largest_after = 0;  ///< m, the same with the controller's corners
  PathModes modes;                               ///< what the controller does with the blocks
  bool within_tolerance = false;  ///< every move is: judged, inside the tube, at both switch positions; see all_judged
  bool only_not_judged = false;   ///< it is not, but nothing that was judged is outside
  bool joint_too_fast = false;    ///< it is not, though all is inside: once corrected, a joint would be (joint_speeds)
  std::string reason;             ///< where and why not
  std::vector<std::string> remedies;        ///< what would help, if it is not
  std::optional<OtherSwitch> other_switch;  ///< where the program has blocks with /
  std::size_t lines_in = 0, lines_out = 0;
  int pieces = 0, transitions = 0, rewritten_moves = 0, rounds = 0;
  bool verified = false;      ///< what was written was looked at again with finer cells
  int left_as_they_were = 0;  ///< moves that no correction brings closer to the programmed path
  ShortBlocks short_blocks;

  /// The corrected program. A long one takes its length in memory each time.
  [[nodiscard]] std::string text() const { return gcode::to_text(program); }
  /// Whether the answer is for all of the cut: else for all but moves that no model covers, steep places, slow
  /// corners and plunges without a dwell, at either switch position.
  [[nodiscard]] bool all_judged() const {
    return before.not_judged.empty() && after.all_judged() && !(other_switch && other_switch->not_all_judged());
  }
  /// The answer in one sentence: yes, yes apart from what was not judged, or why not. `proviso`: what a yes rests on.
  [[nodiscard]] std::string answer(const std::string& proviso = {}) const;
};

/// Corrects a program so that every point of every cutting move ends within `job.tolerance` of the programmed move and
/// its ends within spheres of the same radius (SLAV 5.5, 5.6), the controller's corners counted.
///
/// Where the deflected tool is exactly on the programmed path, the cutter meets what it was programmed to meet; so the
/// ideal command x(s) = p(s) - delta(s), delta = C(x) F(p(s)), follows from one pass along the programmed path (the
/// fixed point is in the compliance alone). A move that leaves the tube in equilibrium is replaced by the fewest pieces
/// between points of x(s) that keep the error |command + delta - p| below a share of the tolerance (see fit_pieces):
/// lines for a line, arcs for an arc. This meets the halving rule of SLAV 5.6 or needs fewer. The text is written, read
/// back, and checked densely in equilibrium; where a point is outside, the move is fitted to a narrower tube and all is
/// checked again.
///
/// Never worse: a move that is in the tube in equilibrium keeps its text, unless its neighbour's correction would make
/// a step; a move that its correction does not bring closer to the programmed path gets its text back; and where the
/// whole is not closer, the program stays as it is but for its header. The header holds the path control mode (G64 P Q0
/// or G61.1) that the tolerance needs; modes in the program that would break it are replaced. It says, too, where the
/// program is not within the tube, and where nothing was corrected: such a program is taken again.
///
/// No piece of a move is shorter than the controller takes (Controller::shortest_block), nor is a transition where the
/// tube lets the moves share their corner instead; what remains is counted in `short_blocks`.
///
/// Errors: those of accept, run_pass and gcode::rewrite; CT130 a bull nose; MC302 no move cuts; MC304 a rapid goes
/// through more material than `job.rapid_volume`, when the tool is where it was programmed or in the program that was
/// written. A tolerance that cannot be met is no error but `within_tolerance` false. Cost: a pass of about 5 us a point
/// (100 to 400 us with a ball) before, one for the ideal command, one a round, and the fit.
Result<Correction> correct(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                           const CorrectOptions& options = {});

}  // namespace polypod::machining
