// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a program and a job must be before anything can be said about them: nothing is assumed in silence.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/gcode/header.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::machining {

struct AcceptOptions {
  bool again = false;  ///< a program that Polypod has corrected already is taken as any other
  std::function<bool(double)> progress;
};

/// A program that can be judged from its first cut to its last.
struct Accepted {
  /// As it was given, but for moves that come straight down from a height that the program has not said (after G43, or
  /// at the start): these start at the top of the stock.
  [[nodiscard]] const gcode::Interpretation& interpretation() const { return changed ? *changed : *given; }
  const gcode::Interpretation* given = nullptr;  ///< must outlive this
  std::optional<gcode::Interpretation> changed;  ///< where there are such moves
  std::vector<std::string> notes;                ///< what was taken for granted, e.g. that such a move comes from above
};

/// Refuses what cannot be judged, or what the machine cannot do. Errors (all of them the answer "no"):
/// MC301 the program has no feed move; MC303 a feed move whose start is not known: X, Y or Z have never been
/// commanded, or Z not since a tool length offset (G43, G49) changed, as in LinuxCNC, which then stands at another Z
/// without having moved; MC210 a pose that the machine cannot reach, that breaks a limit or where a joint would have to
/// jump, in air included; MC306 a program that Polypod has corrected; MC307 G55 to G59 without an offset in the job;
/// MC308 two tool numbers that cut with the one cutter of the job. Besides AP105, a machine without compliances.
/// Cost: about 1 us a millimetre of path, for the reach.
Result<Accepted> accept(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                        const AcceptOptions& options = {});

/// What the machine follows and `check` answers with no all the same.
struct FollowedAnyway {
  std::vector<std::string> notes;  ///< singular poses that can be reached, joints that are too fast
  std::string too_fast, too_hard;  ///< the first place where a joint is, and where it would accelerate so; empty: none

  /// Where this asks of a joint what it may not, and `before` did not; empty: nowhere.
  [[nodiscard]] std::string beyond(const FollowedAnyway& before) const {
    if (!too_fast.empty() && before.too_fast.empty()) return too_fast;
    return before.too_hard.empty() ? too_hard : "";
  }
};

/// Whether the machine can follow every move; MC210 with the first line where it cannot and how many others there are.
Status accept_reach(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                    const std::function<bool(double)>& progress = {}, FollowedAnyway* anyway = nullptr);

/// Whether the cutter of a feed move may meet the stock: boxes overlap, or where the move starts is not known.
bool may_cut(const Job& job, const gcode::Interpretation& interpretation);

/// Whether the cutter may meet the stock at the end of a move, or on its way if its start is known: boxes overlap.
bool meets_stock(const Job& job, const gcode::Move& move);

/// Why no point of a program that was predicted cuts: by how much its feed moves miss the stock, and what the likely
/// reason is (inches and millimetres, the origin, the height). MC302; MC301 where there are no feed moves.
Error cuts_nothing(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation);

/// MC307 where G55 to G59 is in force and the job says nothing of its origin.
Status known_offsets(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation);

/// Whether the program has blocks that begin with /.
bool has_optional_blocks(const gcode::Program& program);
/// An error that holds in this position of block delete.
Error at_switch(Error error, bool block_delete);

/// The comment by which a corrected program is known.
using gcode::kCorrectedMark;
/// The line that says that Polypod corrected this program; 0: none does.
int corrected_line(const gcode::Program& program);
/// And the one of a program in which nothing was corrected: it is taken again.
using gcode::kLookedAtMark;

}  // namespace polypod::machining
