// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Any bytes as a program: what is read is printed again byte for byte; what is understood moves along finite,
// continuous paths; and what is rewritten is understood again and goes where it was told.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/gcode/canon.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/program.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/gcode/writer.hpp"
#include "require.hpp"

namespace {

using namespace polypod;

using fuzz::require;

void require_error(const Error& error) {
  fuzz::require_error(error);
  require(!error.hint.empty(), "an error about a program has a hint");
  require(error.place.line >= 0 && error.place.column >= 0, "an error has a place");
}

/// By how much the radius of an arc differs at its ends, m.
double spiral(const gcode::Move& move) {
  if (move.kind != gcode::MoveKind::arc) return 0;
  Vec3 from = move.start - move.centre;
  Vec3 to = move.end - move.centre;
  const int normal = move.plane == gcode::Plane::xy ? 2 : move.plane == gcode::Plane::zx ? 1 : 0;
  from[normal] = to[normal] = 0;
  return std::abs(from.norm() - to.norm());
}

bool finite(const gcode::Move& move) {
  return move.start.allFinite() && move.end.allFinite() && move.centre.allFinite() && move.axes_start.allFinite() &&
         move.axes_end.allFinite() && std::isfinite(move.feed) && std::isfinite(move.sweep) &&
         std::isfinite(move.spindle_speed);
}

void check_moves(const gcode::Interpretation& run) {
  Vec3 at = Vec3::Zero();
  for (const gcode::Move& move : run.moves) {
    require(finite(move), "moves are finite");
    require(move.start == at, "a move starts where the one before it ended");
    at = move.end;
    const double length = move.length();
    require(std::isfinite(length) && length >= 0, "lengths are finite");
    require(move.feed >= 0 && (move.kind == gcode::MoveKind::rapid || move.feed > 0 || length == 0),
            "feeds are positive");
    require(move.point(0) == move.start && move.point(length) == move.end, "a path runs from start to end");
    const Vec3 middle = move.point(length / 2);
    require(middle.allFinite() && move.direction(length / 2).allFinite(), "points and directions are finite");
    const Vec3 p = middle + Vec3(1e-3, -2e-3, 5e-4);
    const double s = move.nearest(p);
    require(s >= 0 && s <= length, "the nearest point is on the path");
    // A spiral is searched with its mean radius; 1e-9 of the coordinates is for rounding.
    const double slack = 1e-9 * (1 + move.centre.norm() + length) + spiral(move);
    require((p - move.point(s)).norm() <= (p - middle).norm() + slack, "no point is nearer than the nearest");
  }
}

/// Replacements beyond 10 km are refused (GC140), but a large circle may reach that far between legal ends.
bool within_reach(const gcode::Move& move) {
  const double radius = move.kind == gcode::MoveKind::arc
                            ? std::max((move.start - move.centre).norm(), (move.end - move.centre).norm())
                            : 0;
  return move.kind != gcode::MoveKind::arc || move.centre.cwiseAbs().maxCoeff() + radius < 9e3;
}

std::vector<gcode::Replacement> replacements_of(const gcode::Interpretation& run, std::size_t seed) {
  std::vector<gcode::Replacement> replacements;
  for (std::size_t i = 0; i < run.moves.size(); ++i) {
    const gcode::Move& move = run.moves[i];
    const std::size_t mix = (seed + i * 2654435761u) >> 7;
    // Arcs after a moved end must be replaced, so all or only lines and arcs with an untouched start are.
    if (seed % 3 != 0 && mix % 3 == 0) continue;
    if (!within_reach(move)) continue;
    gcode::Replacement replacement;
    replacement.move = static_cast<int>(i);
    const std::size_t count = 1 + mix % 4;
    for (std::size_t k = 1; k <= count; ++k) {
      const double f = static_cast<double>(k) / static_cast<double>(count);
      gcode::PathPoint point;
      point.p = move.point(f * move.length());
      if (point.p.cwiseAbs().maxCoeff() < 9e3)
        point.p += 1e-4 * Vec3(std::sin(double(mix + k)), std::cos(double(mix)), 0.3);
      point.axes = move.axes_start + f * (move.axes_end - move.axes_start);
      replacement.points.push_back(point);
    }
    replacements.push_back(std::move(replacement));
  }
  return replacements;
}

void check_rewriting(const gcode::Program& program, const gcode::Interpretation& run, const std::string& text) {
  const auto same = gcode::rewrite(program, run, {});
  require(same.has_value() && gcode::to_text(same->program) == text, "rewriting nothing changes nothing");

  const auto replacements = replacements_of(run, text.size());
  const auto rewritten = gcode::rewrite(program, run, replacements);
  if (!rewritten) {
    require(rewritten.error().id == "GC141", "only an arc whose start was moved is not written");
    return;
  }
  require(rewritten->source.size() == rewritten->program.blocks.size(), "every block has its source");
  const auto again = gcode::interpret(rewritten->program);
  if (!again)
    std::fprintf(stderr, "%s\n%s\n", to_string(again.error()).c_str(), gcode::to_text(rewritten->program).c_str());
  require(again.has_value(), "a rewritten program is understood");
  check_moves(*again);
  require(again->ended == run.ended, "a rewritten program ends as before");

  // The last point of each replacement is reached, within half of the last digit (0.05 um, or 0.13 um in inches).
  std::vector<const gcode::Move*> last(program.blocks.size(), nullptr);
  for (const gcode::Move& move : again->moves) {
    last[static_cast<std::size_t>(rewritten->source[static_cast<std::size_t>(move.block)])] = &move;
  }
  std::size_t next = 0;
  for (std::size_t i = 0; i < run.moves.size(); ++i) {
    const gcode::Move& move = run.moves[i];
    const gcode::Move* written = last[static_cast<std::size_t>(move.block)];
    const bool replaced = next < replacements.size() && replacements[next].move == static_cast<int>(i);
    if (replaced) {
      const Vec3& target = replacements[next].points.back().p;
      ++next;
      if (written == nullptr) continue;  // a full circle that shrank to nothing
      require((written->end - target).cwiseAbs().maxCoeff() <= 0.14e-6 + 1e-11 * target.norm(),
              "a replaced move ends as told");
      require(written->kind == (move.kind == gcode::MoveKind::rapid ? gcode::MoveKind::rapid : gcode::MoveKind::line),
              "a replaced move is straight");
    } else {
      require(written != nullptr && written->kind == move.kind && written->plane == move.plane &&
                  written->clockwise == move.clockwise,
              "a kept move stays what it was");
    }
  }
  gcode::to_text(gcode::with_header(rewritten->program, std::vector<std::string>{"a (b)\n"}));
}

/// Parameters, subprograms, loops and cycles: they end, and what they come to is a plain program.
void check_unrolling(const gcode::Program& program) {
  constexpr long kLines = 3000;
  gcode::CanonOptions canon_options;
  canon_options.files = false;
  canon_options.most_lines = kLines;
  if (const auto canon = gcode::canonical_text(program, canon_options); !canon) require_error(canon.error());

  gcode::UnrollOptions options;
  options.files = false;
  options.diameter = 4e-3;
  options.diameters[2] = 10e-3;
  options.most_lines = kLines;
  const auto unrolled = gcode::unroll(program, options);
  if (!unrolled) {
    require_error(unrolled.error());
    return;
  }
  const auto run = gcode::interpret(unrolled->program);
  if (!run) {
    require_error(run.error());
    return;
  }
  require(run->states.size() == unrolled->program.blocks.size(), "every block has a state");
  check_moves(*run);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  const auto program = gcode::parse(text, "fuzz.ngc");
  if (!program) {
    require_error(program.error());
    return 0;
  }
  require(gcode::to_text(*program) == text, "a program is printed byte for byte");
  for (const gcode::Block& block : program->blocks) {
    for (const gcode::Word& word : block.words) require(std::isfinite(word.value), "words are finite");
  }
  if (gcode::needs_unrolling(*program)) {
    check_unrolling(*program);
    return 0;
  }
  const auto run = gcode::interpret(*program);
  if (!run) {
    require_error(run.error());
    return 0;
  }
  require(run->states.size() == program->blocks.size(), "every block has a state");
  check_moves(*run);
  check_rewriting(*program, *run, text);
  const auto canon = gcode::canonical_text(*program);
  if (!canon) {
    require_error(canon.error());
  } else {
    require(canon->find("nan") == std::string::npos || text.find("nan") != std::string::npos,
            "canonical moves are numbers");
  }
  return 0;
}
