// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The moves of a G-code program as steps, and which of the two languages a file is in.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/post/path.hpp"

namespace polypod::post {
namespace {

Vec3 normal_of(gcode::Plane plane) {
  return plane == gcode::Plane::xy ? Vec3::UnitZ() : plane == gcode::Plane::zx ? Vec3::UnitY() : Vec3::UnitX();
}

/// What the words of a block that move nothing ask for: before its move (dwell, coolant) or after it (stops).
struct Extras {
  std::optional<double> dwell;
  std::optional<Coolant> coolant;
  bool stop = false, optional_stop = false;
};

Extras extras_of(const gcode::Block& block) {
  Extras out;
  double p = 0;
  bool g4 = false;
  for (const gcode::Word& w : block.words) {
    if (w.letter == 'P') p = w.value;
    if (w.letter == 'G' && w.value == 4) g4 = true;
    if (w.letter != 'M') continue;
    if (w.value == 0) out.stop = true;
    if (w.value == 1) out.optional_stop = true;
    if (w.value == 7) out.coolant = Coolant::mist;
    if (w.value == 8) out.coolant = Coolant::flood;
    if (w.value == 9) out.coolant = Coolant::off;
  }
  if (g4) out.dwell = p;
  return out;
}

bool carried(const gcode::Word& w) {
  return w.value == 0 || w.value == 1 || w.value == 2 || (w.value >= 3 && w.value <= 9) || w.value == 30 ||
         w.value == 60 || w.value == 61;
}

Step step_of(const gcode::Move& move, int line) {
  Step s;
  s.kind = move.kind == gcode::MoveKind::rapid ? StepKind::rapid
           : move.kind == gcode::MoveKind::arc ? StepKind::arc
                                               : StepKind::line;
  s.line = line;
  s.tip = move.end;
  s.angles = move.axes_end;
  s.axis = rotation_abc(move.axes_end.x(), move.axes_end.y(), move.axes_end.z()).col(2);
  if (s.kind == StepKind::arc) {
    s.centre = move.centre;
    s.normal = move.clockwise ? Vec3(-normal_of(move.plane)) : normal_of(move.plane);
    s.sweep = move.sweep;
  }
  s.feed = move.kind == gcode::MoveKind::rapid ? 0 : move.feed;
  s.spindle = move.spindle;
  s.spindle_speed = move.spindle_speed;
  s.tool = move.tool;
  return s;
}

}  // namespace

Result<Path> read_program(const std::string& file, const gcode::InterpretOptions& options) {
  gcode::UnrollOptions unrolling;
  unrolling.interpret = options;
  POLYPOD_ASSIGN(understood, gcode::understand(file, unrolling));
  Path out;
  out.file = file;
  out.notes = understood.interpretation.notes;
  const std::vector<gcode::Move>& moves = understood.interpretation.moves;
  std::size_t next = 0;
  Coolant coolant = Coolant::off;
  Step last;  // what is in force, for steps without a move
  int unknown = 0, first_unknown = 0;
  for (std::size_t b = 0; b < understood.program.blocks.size(); ++b) {
    const gcode::Block& block = understood.program.blocks[b];
    if (!understood.interpretation.states[b].executed) continue;
    const Extras extras = extras_of(block);
    if (extras.coolant) coolant = *extras.coolant;
    const auto other = [&](StepKind kind, double seconds = 0) {
      Step s = last;
      s.kind = kind;
      s.line = block.line;
      s.coolant = coolant;
      s.seconds = seconds;
      out.steps.push_back(std::move(s));
    };
    if (extras.dwell) other(StepKind::dwell, *extras.dwell);
    for (; next < moves.size() && moves[next].block == static_cast<int>(b); ++next) {
      if (!moves[next].start_known && moves[next].kind != gcode::MoveKind::rapid) {
        out.notes.push_back(
            fmt::format("line {}: where this cut starts is not known; only its end is judged", block.line));
      }
      last = step_of(moves[next], block.line);
      last.coolant = coolant;
      out.steps.push_back(last);
    }
    if (extras.stop) other(StepKind::stop);
    if (extras.optional_stop) other(StepKind::optional_stop);
    for (const gcode::Word& w : block.words) {
      if (w.letter == 'M' && !carried(w) && unknown++ == 0) first_unknown = block.line;
    }
  }
  if (unknown > 0) {
    out.notes.push_back(fmt::format("line {}: {} M {} of the machine's builder {} not written", first_unknown, unknown,
                                    unknown == 1 ? "word" : "words", unknown == 1 ? "is" : "are"));
  }
  if (moves.empty()) return fail("PO112", "the program makes no move", {file}, "there is nothing to post");
  return out;
}

Result<Path> read_path(const std::string& file) {
  POLYPOD_ASSIGN(text, files::read(file));
  if (looks_like_cl(text)) return parse_cl(text, file);
  if (files::is_standard_input(file)) {
    return fail("PO115", "a G-code program from standard input", {file}, "give the program as a file");
  }
  return read_program(file);
}

}  // namespace polypod::post
