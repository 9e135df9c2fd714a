// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Off-line correction of a program: the bent tool stays in a tube round the programmed path.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "polypod/machining/predict.hpp"

namespace polypod::machining {

enum class CorrectMethod {
  tube,    ///< as few pieces as keep the bent tool in the tube, command found as a fixed point
  mirror,  ///< one step, p - delta(p), at equally spaced points of every cutting move (SLAV (5.2)); for comparison
};

struct CorrectOptions {
  CorrectMethod method = CorrectMethod::tube;
  int mirror_points = 10;  ///< pieces a move for `mirror`
  double fit_share = 0.8;  ///< of the tolerance that the fit of pieces may use; the rest is for what the fit leaves out
  double merge_share = 0.25;  ///< two moves share their corner if their corrections differ by less than this share of
                              ///< the tolerance, else a transition goes from one to the other
  int rounds = 6;             ///< fits with a narrower tube where the check finds a point outside
  bool keep_samples = false;
  std::function<bool(const char* what, double share)> progress;
};

/// What became of one move that cuts.
struct MoveOutcome {
  int line = 0;  ///< in the original program
  bool rewritten = false;
  int pieces = 0;  ///< straight pieces that stand for it, transitions not counted
  int transitions = 0;
  double length = 0;                               ///< m
  Spread normal_before, normal_after;              ///< m
  double distance_before = 0, distance_after = 0;  ///< m, largest from the programmed move
};

struct Correction {
  std::string text;        ///< the corrected program
  gcode::Program program;  ///< the same, read back
  Prediction before;       ///< of the original, in equilibrium
  Prediction after;        ///< of what was read back, against the original's moves
  std::vector<MoveOutcome> moves;
  std::vector<gcode::Move> programmed;  ///< the original's moves
  std::vector<PassMove> commanded;      ///< those read back; their `followed` points into the interpretation given
  std::vector<int> source;              ///< for each commanded move the programmed move it stands for
  double tolerance = 0;                 ///< m
  double largest_distance = 0;  ///< m, of a bent point from its programmed move, ends as spheres, over the dense check
  bool within_tolerance = false;
  std::string reason;  ///< where and why not
  std::size_t lines_in = 0, lines_out = 0;
  int pieces = 0, transitions = 0, rewritten_moves = 0, rounds = 0;
};

/// Corrects a program so that every point of every cutting move ends within `job.tolerance` of the programmed move and
/// its ends within spheres of the same radius (SLAV 5.5, 5.6).
///
/// Where the bent tool stands exactly on the programmed path, the cutter meets what it was programmed to meet; so the
/// ideal command x(s) = p(s) - delta(s), delta = C(x) F(p(s)), follows from one pass along the programmed path (the
/// fixed point is in the compliance alone). Each move is then replaced by the fewest straight pieces between points of
/// x(s) that keep the error |lerp(x) + delta - p| below a share of the tolerance, found greedily, farthest first; with
/// their number fixed the largest error is made as small as it goes. This meets the halving rule of SLAV 5.6 or needs
/// fewer. The text is written, read back, and checked densely in equilibrium; where a point is outside, the move is
/// fitted to a narrower tube and all is checked again.
///
/// Moves whose bend stays within the tube keep their text, unless their neighbour's correction would make a step.
/// Errors: those of run_pass and gcode::rewrite. A tolerance that cannot be met is no error but `within_tolerance`
/// false. Cost: three passes of about 5 us a point, and the fit.
Result<Correction> correct(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                           const CorrectOptions& options = {});

}  // namespace polypod::machining
