// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/accept.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "aside.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {
namespace {

using Box = Eigen::AlignedBox3d;
using units::to_mm;

// Two heights that differ by less than this are the same, m.
constexpr double kSame = 1e-9;
// How many further lines an error names.
constexpr std::size_t kNamedLines = 8;

Place place_of(const gcode::Program& program, const gcode::Move& move) {
  return {program.path, program.blocks[static_cast<std::size_t>(move.block)].line, 1};
}

/// "; likewise lines 7, 9 and 31 more", or nothing.
std::string others(const std::vector<int>& lines) {
  if (lines.empty()) return {};
  std::string out;
  for (std::size_t i = 0; i < std::min(lines.size(), kNamedLines); ++i) {
    out += fmt::format("{}{}", i == 0 ? "" : ", ", lines[i]);
  }
  if (lines.size() > kNamedLines) out += fmt::format(" and {} more", lines.size() - kNamedLines);
  return fmt::format("; likewise {} {}", lines.size() == 1 ? "line" : "lines", out);
}

Box box_of(const cutting::Stock& stock) {
  return {stock.min(), stock.max()};
}

/// The box of what a cutter of this radius sweeps on a move; arcs are taken with their whole circle.
Box swept_box(const gcode::Move& move, double radius) {
  Box box(move.end);
  if (move.start_known) box.extend(move.start);
  if (move.kind == gcode::MoveKind::arc) {
    const double r = (move.start - move.centre).norm();
    Vec3 low = move.centre.array() - r, high = move.centre.array() + r;
    const int normal = move.plane == gcode::Plane::xy ? 2 : move.plane == gcode::Plane::zx ? 1 : 0;
    low[normal] = std::min(move.start[normal], move.end[normal]);
    high[normal] = std::max(move.start[normal], move.end[normal]);
    box.extend(low);
    box.extend(high);
  }
  return {box.min() - Vec3(radius, radius, 0), box.max() + Vec3(radius, radius, 0)};
}

/// The same in the frame of the stock.
Box swept_box_in_S(const Job& job, const gcode::Move& move, double radius) {
  if (job.tool_frame.turns) {  // the middle of a ball may be beside its tip by as much, and its flutes are over more
    const Box box = swept_box(move, 2 * radius + job.cutter_of(move.tool).length);
    return {box.min() - radius * Vec3::UnitZ(), box.max()};
  }
  if (!job.tool_frame.tilted) return swept_box(move, radius);
  Box box;
  const Box in_W = swept_box(move, 0);
  if (move.kind == gcode::MoveKind::arc) {
    for (int i = 0; i < 8; ++i) box.extend(job.tool_frame.to_S(in_W.corner(static_cast<Box::CornerType>(i))));
  } else {
    box.extend(job.tool_frame.to_S(move.end));
    if (move.start_known) box.extend(job.tool_frame.to_S(move.start));
  }
  return {box.min() - Vec3(radius, radius, 0), box.max() + Vec3(radius, radius, 0)};
}

/// Whether the cutter may meet the stock: it is as long as the stock is high above its tip.
bool may_touch(const Box& swept, const Box& stock) {
  return swept.min().z() < stock.max().z() && swept.min().x() < stock.max().x() && swept.max().x() > stock.min().x() &&
         swept.min().y() < stock.max().y() && swept.max().y() > stock.min().y();
}

bool feeds(const gcode::Move& move) {
  return move.kind != gcode::MoveKind::rapid;
}

/// Where the feed moves would be of the stock's size in the other unit, and are not in theirs: what to look at, or
/// nothing. Two sizes are taken as one where they differ by less than the square root of 25.4: so no program is of the
/// stock's size in both units.
std::string other_unit(const Job& job, const gcode::Interpretation& interpretation) {
  const Vec3 origin = Vec3::Zero();  // counted in, as a short program may be far from it
  const Box stock_alone = job.tool_frame.tilted ? Box(job.tool_frame.stock_in_W) : box_of(job.stock);
  Box path(origin), stock = stock_alone, path_alone;
  stock.extend(origin);
  bool inches = false, millimetres = false;
  for (const gcode::Move& move : interpretation.moves) {
    if (!feeds(move) || !move.start_known) continue;
    path.extend(swept_box(move, 0));
    path_alone.extend(swept_box(move, 0));
    (move.inches ? inches : millimetres) = true;
  }
  if (inches == millimetres) return {};
  const double larger = path.diagonal().head<2>().norm() / stock.diagonal().head<2>().norm();
  const double inch = units::from_inch(1) / units::from_mm(1);
  const double in_other_unit = inches ? larger / inch : larger * inch;
  const double same_size = std::sqrt(inch);
  if (!(in_other_unit > 1 / same_size && in_other_unit < same_size)) return {};
  // A program that lies beside the stock in the other unit, too, is not helped by it.
  const double factor = inches ? 1 / inch : inch;
  const Vec3 beside(job.cutter.radius(), job.cutter.radius(), std::numeric_limits<double>::infinity());
  if (!may_touch({factor * path_alone.min() - beside, factor * path_alone.max() + beside}, stock_alone)) return {};
  return fmt::format(
      "the program is in {}; in {} it would be of the size of the stock: check G20 and G21, and the unit of the CAM "
      "system",
      inches ? "inches (G20)" : "millimetres (G21)", inches ? "millimetres" : "inches");
}

Status not_corrected_before(const gcode::Program& program) {
  const int line = corrected_line(program);
  if (line == 0) return {};
  return fail("MC306", "this program was corrected by Polypod before; a second correction would be added to the first",
              Place{program.path, line, 1},
              "give the program of the CAM system, or --again if its path is really the one to be followed");
}

Status known_tools(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation) {
  const Box stock = box_of(job.stock);
  std::optional<int> number;  // the one that takes [cutter]
  for (const gcode::Move& move : interpretation.moves) {
    if (!feeds(move) || job.cutters.contains(move.tool)) continue;
    if (number == move.tool || !may_touch(swept_box_in_S(job, move, job.cutter.radius()), stock)) continue;
    if (number) {
      return fail("MC308",
                  fmt::format("T{} cuts here and T{} before, but the job has one cutter for both", move.tool, *number),
                  place_of(program, move),
                  fmt::format("add [[tool]] with number = {} and its cutter to {}", move.tool, job.path));
    }
    number = move.tool;
  }
  return {};
}

/// Moves that come straight down from an unknown height get the top of the stock as their start.
Status known_starts(const Job& job, const gcode::Program& program, Accepted& out) {
  const double top = job.stock.top();
  std::vector<int> from_above;
  std::optional<Place> first;
  std::vector<int> further;
  for (std::size_t i = 0; i < out.given->moves.size(); ++i) {
    const gcode::Move& move = out.given->moves[i];
    const bool tilted = job.tool_frame.tilted || job.tool_frame.turns;
    if (move.start_known || !feeds(move) || (tilted && stays_clear(job, move))) continue;
    const auto& [x, y, z] = move.known_start;
    const Place place = place_of(program, move);
    const bool vertical = !tilted && move.kind == gcode::MoveKind::line && x && y &&
                          std::abs(move.start.x() - move.end.x()) < kSame &&
                          std::abs(move.start.y() - move.end.y()) < kSame;
    if (vertical && move.known_end[2]) {
      if (move.end.z() < top) from_above.push_back(place.line);
      if (!out.changed) out.changed = *out.given;
      out.changed->moves[i].start.z() = std::max(top, move.end.z());
      out.changed->moves[i].start_known = true;
    } else if (!tilted && z && std::min(move.start.z(), move.end.z()) >= top) {
      continue;  // an approach above the stock, from wherever it comes
    } else if (!first) {
      first = place;
    } else {
      further.push_back(place.line);
    }
  }
  if (first) {
    return fail("MC303",
                "where this move starts is not known: X, Y or Z have not been commanded since the program began, or "
                "since a tool length offset (G43, G49) changed" +
                    others(further),
                *first, "command X, Y and Z with G0 before the first cut, and Z after G43");
  }
  if (!from_above.empty()) {
    const std::vector<int> rest(from_above.begin() + 1, from_above.end());
    out.notes.push_back(fmt::format(
        "line {}: the height from which this move comes is not given; it is taken to come from above the stock{}",
        from_above.front(), others(rest)));
  }
  return {};
}

/// Lines that the machine follows and `check` does not accept.
class LinesFollowed {
 public:
  void add(const CheckProblem& problem) {
    if (first_.empty()) {
      first_ = problem.detail;
      line_ = problem.line;
    } else if (problem.line != line_) {
      lines_.insert(problem.line);
    }
  }
  /// "line 12: ...", the first of them.
  [[nodiscard]] std::string first() const { return first_.empty() ? "" : fmt::format("line {}: {}", line_, first_); }
  void note(const char* what, std::vector<std::string>& notes, bool refused = true) const {
    if (first_.empty()) return;
    notes.push_back(fmt::format("line {}: {}{}: {}{}", line_, what, refused ? ", and `polypod check` answers no" : "",
                                first_, others({lines_.begin(), lines_.end()})));
  }

 private:
  std::string first_;
  int line_ = 0;
  std::set<int> lines_;  // the others
};

}  // namespace

Status known_offsets(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation) {
  for (const gcode::Move& move : interpretation.moves) {
    const auto i = static_cast<std::size_t>(move.work_offset);
    if (job.offset_given[i] || !job.work_offsets[i].isZero(0)) continue;
    const std::string offset = fmt::format("work_offsets_mm = {{ G{} = [x, y, z] }} under [workpiece]", 54 + i);
    if (job.path.empty()) {
      return fail("MC307", fmt::format("G{} is in force, but nothing says its origin", 54 + i), place_of(program, move),
                  "give a job with " + offset);
    }
    return fail("MC307", fmt::format("G{} is in force, but the job says nothing of its origin", 54 + i),
                place_of(program, move), fmt::format("add {} of {}", offset, job.path));
  }
  return {};
}

Status accept_reach(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                    const std::function<bool(double)>& progress, FollowedAnyway* anyway) {
  CheckOptions options;
  options.progress = progress;
  options.branch = job.posture;
  options.start = job.start_joints;
  options.limits = motion_limits(job);  // with them a joint that hurries is none that jumps
  POLYPOD_ASSIGN(checked, check(job.machine, job.X_MW, program, interpretation, options));
  std::optional<CheckProblem> first;
  std::set<int> lines;
  LinesFollowed singular, fast, hard;
  LinesFollowed passed;
  for (const CheckProblem& pose : checked.passed) passed.add(pose);
  for (const CheckProblem& problem : checked.problems) {
    if (problem.kind == "singular" && problem.held) {
      singular.add(problem);
    } else if (problem.kind == "speed") {
      fast.add(problem);
    } else if (problem.kind == "acceleration") {
      hard.add(problem);
    } else {
      if (!first) first = problem;
      lines.insert(problem.line);
    }
  }
  if (!first) {
    if (anyway != nullptr) {
      passed.note(
          "a singular pose, which the joints follow within their speeds; a robot's own controller may stop there",
          anyway->notes, false);
      singular.note("a singular pose, which the machine reaches; what its joints must do there is not judged here",
                    anyway->notes);
      fast.note("too fast for a joint, which is not judged here", anyway->notes);
      hard.note("more acceleration than a joint has, which is not judged here", anyway->notes);
      anyway->too_fast = fast.first();
      anyway->too_hard = hard.first();
    }
    return {};
  }
  lines.erase(first->line);
  const std::string unit = other_unit(job, interpretation);
  return fail(
      "MC210",
      fmt::format("the machine cannot follow this move: {}{}", first->detail, others({lines.begin(), lines.end()})),
      Place{program.path, first->line, 1}, unit.empty() ? "move the workpiece origin, or change these lines" : unit);
}

Result<Accepted> accept_but_reach(const Job& job, const gcode::Program& program,
                                  const gcode::Interpretation& interpretation, bool again) {
  if (!job.measured) POLYPOD_TRY(statics::needs_compliance(job.machine));
  if (!again) POLYPOD_TRY(not_corrected_before(program));
  if (std::none_of(interpretation.moves.begin(), interpretation.moves.end(), feeds)) {
    return tl::unexpected(cuts_nothing(job, program, interpretation));
  }
  POLYPOD_TRY(known_offsets(job, program, interpretation));
  // A wrong unit or origin misses the stock and often the reach as well; the stock says more.
  if (!may_cut(job, interpretation)) return tl::unexpected(cuts_nothing(job, program, interpretation));
  POLYPOD_TRY(stands_as_set_up(job, program, interpretation));
  POLYPOD_TRY(known_tools(job, program, interpretation));
  Accepted out{&interpretation, {}, interpretation.notes};
  POLYPOD_TRY(known_starts(job, program, out));
  return out;
}

Result<Accepted> accept(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                        const AcceptOptions& options) {
  POLYPOD_ASSIGN(out, accept_but_reach(job, program, interpretation, options.again));
  FollowedAnyway anyway;
  POLYPOD_TRY(accept_reach(job, program, out.interpretation(), options.progress, &anyway));
  out.notes.insert(out.notes.end(), anyway.notes.begin(), anyway.notes.end());
  return out;
}

bool has_optional_blocks(const gcode::Program& program) {
  return std::any_of(program.blocks.begin(), program.blocks.end(), [](const gcode::Block& b) { return b.optional; });
}

Error at_switch(Error error, bool block_delete) {
  error.message += fmt::format(" (with block delete {})", block_delete ? "on" : "off");
  return error;
}

int corrected_line(const gcode::Program& program) {
  for (const gcode::Block& block : program.blocks) {
    for (const std::string_view comment : gcode::comments(block)) {
      // Editors and posts write programs in capitals.
      const std::string_view mark = kCorrectedMark;
      const auto at = std::search(comment.begin(), comment.end(), mark.begin(), mark.end(), [](char a, char b) {
        return std::toupper(static_cast<unsigned char>(a)) == std::toupper(static_cast<unsigned char>(b));
      });
      if (at != comment.end()) return block.line;
    }
  }
  return 0;
}

bool meets_stock(const Job& job, const gcode::Move& move) {
  return may_touch(swept_box_in_S(job, move, job.cutter_of(move.tool).radius()), box_of(job.stock));
}

bool may_cut(const Job& job, const gcode::Interpretation& interpretation) {
  return std::any_of(interpretation.moves.begin(), interpretation.moves.end(), [&](const gcode::Move& move) {
    return feeds(move) && (!move.start_known || meets_stock(job, move));
  });
}

Error cuts_nothing(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation) {
  const Box stock = box_of(job.stock);
  Box path;
  bool rounded = false;  // a cutter
  const gcode::Move* first = nullptr;
  for (const gcode::Move& move : interpretation.moves) {
    if (!feeds(move)) continue;
    if (first == nullptr) first = &move;
    path.extend(swept_box_in_S(job, move, job.cutter_of(move.tool).radius()));
    rounded = rounded || job.cutter_of(move.tool).corner_radius > 0;
  }
  if (first == nullptr) {
    return {"MC301",
            interpretation.moves.empty() ? "the program has no moves" : "the program has only rapid moves (G0)",
            Place{program.path, 0, 0}, "check that this is the file that was meant"};
  }
  std::string misses;
  bool touches = true;  // it comes as far as the stock's faces
  constexpr double kTouch = 0.5e-6;
  for (int k = 0; k < 3; ++k) {
    const double over = path.min()[k] - stock.max()[k], under = stock.min()[k] - path.max()[k];
    // A tip below the stock still cuts with the edges above it.
    const double gap = k == 2 ? over : std::max(over, under);
    if (gap < 0) continue;
    touches = touches && gap < kTouch;
    misses += fmt::format("{}{} mm in {}", misses.empty() ? "" : ", ", fmt::format("{:.3f}", to_mm(gap)), "XYZ"[k]);
  }
  std::string hint = other_unit(job, interpretation);
  if (misses.empty()) {
    hint = "its box overlaps the stock's, but no point meets material: has it been cut away before?";
    if (rounded) hint += " A corner radius makes the cutter narrower near its tip";
  } else if (hint.empty()) {
    hint = "check the origin of the workpiece, the stock and the depth of the program";
  }
  return {"MC302",
          fmt::format(
              "no move of the program cuts{}: its feed moves cover X {:.1f} .. {:.1f}, Y {:.1f} .. {:.1f}, Z {:.1f} "
              ".. {:.1f} mm with the cutter, the stock X {:.1f} .. {:.1f}, Y {:.1f} .. {:.1f}, Z {:.1f} .. {:.1f} mm",
              misses.empty() ? ""
              : touches      ? "; it only touches the stock"
                             : "; it misses the stock by " + misses,
              to_mm(path.min().x()), to_mm(path.max().x()), to_mm(path.min().y()), to_mm(path.max().y()),
              to_mm(path.min().z()), to_mm(path.max().z()), to_mm(stock.min().x()), to_mm(stock.max().x()),
              to_mm(stock.min().y()), to_mm(stock.max().y()), to_mm(stock.min().z()), to_mm(stock.max().z())) +
              (job.tool_frame.tilted ? ", all in the frame of the tilted tool" : ""),
          place_of(program, *first), hint};
}

}  // namespace polypod::machining
