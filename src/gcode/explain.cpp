// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The words of a line and what is in force after it, as a person says them.
#include "polypod/gcode/explain.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
#include <utility>

#include "engine.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

struct Code {
  int tenfold;
  std::string_view meaning;
};

constexpr Code kG[] = {
    {0, "rapid move: a straight line as fast as the machine can"},
    {10, "straight move at the feed rate"},
    {20, "arc clockwise at the feed rate"},
    {30, "arc counterclockwise at the feed rate"},
    {40, "dwell"},
    {50, "cubic spline"},
    {51, "quadratic spline"},
    {52, "the first control point of a NURBS curve, which ends with G5.3"},
    {53, "the NURBS curve is run"},
    {100, "sets an offset or a tool of the controller"},
    {170, "plane XY: arcs lie in it, cycles drill along Z"},
    {180, "plane ZX: arcs lie in it, cycles drill along Y"},
    {190, "plane YZ: arcs lie in it, cycles drill along X"},
    {200, "lengths are inches"},
    {210, "lengths are millimetres"},
    {280, "rapid move to the place that G28.1 has stored, through the point given"},
    {281, "stores this place for G28"},
    {300, "rapid move to the place that G30.1 has stored, through the point given"},
    {301, "stores this place for G30"},
    {382, "probe towards the workpiece; an error without contact"},
    {383, "probe towards the workpiece"},
    {384, "probe away from the workpiece; an error without loss of contact"},
    {385, "probe away from the workpiece"},
    {400, "cutter radius compensation is off"},
    {410, "cutter radius compensation: the tool is left of the path"},
    {411, "cutter radius compensation: the tool is left of the path, its diameter is D"},
    {420, "cutter radius compensation: the tool is right of the path"},
    {421, "cutter radius compensation: the tool is right of the path, its diameter is D"},
    {430, "tool length offset of the tool table"},
    {431, "tool length offset given in this line"},
    {432, "a further tool length offset is added"},
    {490, "no tool length offset"},
    {520, "shifts all work coordinate systems"},
    {530, "the coordinates of this line are those of the machine"},
    {540, "work coordinate system 1"},
    {550, "work coordinate system 2"},
    {560, "work coordinate system 3"},
    {570, "work coordinate system 4"},
    {580, "work coordinate system 5"},
    {590, "work coordinate system 6"},
    {591, "work coordinate system 7"},
    {592, "work coordinate system 8"},
    {593, "work coordinate system 9"},
    {610, "exact path: the tool stops where the path has a corner"},
    {611, "exact stop: the tool stops at the end of each move"},
    {640, "path blending: corners are rounded to keep up the speed"},
    {730, "drilling cycle with chip breaking"},
    {800, "no cycle and no motion in force"},
    {810, "drilling cycle"},
    {820, "drilling cycle with a dwell at the bottom"},
    {830, "peck drilling cycle: back to R after each peck"},
    {840, "tapping cycle"},
    {850, "boring cycle: out at the feed rate"},
    {860, "boring cycle: the spindle stops, out at rapid"},
    {870, "back boring cycle"},
    {880, "boring cycle: the spindle stops, out by hand"},
    {890, "boring cycle with a dwell: out at the feed rate"},
    {900, "coordinates are absolute"},
    {901, "arc centres (I, J, K) are absolute"},
    {910, "coordinates are steps from the place before"},
    {911, "arc centres (I, J, K) count from the start of the arc"},
    {920, "gives this place the coordinates of the line, without a move (an offset of all systems)"},
    {921, "the offset of G92 is deleted"},
    {922, "the offset of G92 is suspended"},
    {923, "the offset of G92 is in force again"},
    {930, "F is one over the time of the move in minutes"},
    {940, "F is the feed rate: length per minute"},
    {970, "S is the spindle speed in revolutions per minute"},
    {980, "after a hole the tool goes back to where the cycle began"},
    {990, "after a hole the tool goes back to R"},
};

constexpr Code kM[] = {
    {0, "the program stops until it is continued"},
    {10, "the program stops if the optional stop is on"},
    {20, "the program ends"},
    {30, "the spindle turns clockwise"},
    {40, "the spindle turns counterclockwise"},
    {50, "the spindle stops"},
    {60, "changes the tool"},
    {70, "mist on"},
    {80, "coolant on"},
    {90, "coolant and mist off"},
    {190, "turns the spindle to an angle and stops it there"},
    {300, "the program ends, with a change of pallets"},
    {480, "feed and spindle overrides are on"},
    {490, "feed and spindle overrides are off"},
    {500, "feed override"},
    {510, "spindle override"},
    {520, "adaptive feed"},
    {530, "feed hold"},
    {600, "changes pallets and stops"},
    {610, "sets the number of the tool in the spindle"},
    {620, "digital output on with the next move"},
    {630, "digital output off with the next move"},
    {640, "digital output on at once"},
    {650, "digital output off at once"},
    {660, "waits for an input"},
    {670, "analogue output with the next move"},
    {680, "analogue output at once"},
    {700, "saves the modes in force"},
    {710, "forgets the modes that were saved"},
    {720, "restores the modes that were saved, but not the motion mode"},
    {730, "saves the modes in force, and restores them where this subprogram ends"},
    {980, "calls a subprogram"},
    {990, "the subprogram ends"},
};

constexpr std::pair<std::string_view, std::string_view> kKeywords[] = {
    {"sub", "the beginning of a subprogram; it runs where it is called"},
    {"endsub", "the end of a subprogram"},
    {"return", "returns from the subprogram"},
    {"call", "calls the subprogram"},
    {"if", "what follows runs if the condition is not 0"},
    {"elseif", "what follows runs if no condition before it was met and this one is not 0"},
    {"else", "what follows runs if no condition before it was met"},
    {"endif", "the end of the condition"},
    {"do", "the beginning of a loop whose condition stands at its end"},
    {"while", "a loop that runs as long as the condition is not 0"},
    {"endwhile", "the end of the loop"},
    {"repeat", "a loop that runs a given number of times"},
    {"endrepeat", "the end of the loop"},
    {"break", "leaves the loop"},
    {"continue", "goes on with the next pass of the loop"},
};

template <std::size_t N>
std::string_view meaning_in(const Code (&codes)[N], int tenfold) {
  const auto* const at =
      std::find_if(std::begin(codes), std::end(codes), [&](const Code& c) { return c.tenfold == tenfold; });
  return at != std::end(codes) ? at->meaning : std::string_view();
}

std::string code_name(char letter, int tenfold) {
  return tenfold % 10 == 0 ? fmt::format("{}{}", letter, tenfold / 10)
                           : fmt::format("{}{}.{}", letter, tenfold / 10, tenfold % 10);
}

std::string shown(double value) {
  return number(value, 4);
}

/// "(MSG, ...)" and the like are no remarks.
std::string_view meaning_of_comment(std::string_view comment) {
  const std::size_t begin = comment.find_first_not_of("(; \t"), comma = comment.find(',');
  if (begin == std::string_view::npos || comma == std::string_view::npos || comma < begin) return "a comment";
  std::string head;
  for (const char c : comment.substr(begin, comma - begin))
    if (c != ' ' && c != '\t') head += upper(c);
  if (head == "MSG") return "a message for the operator";
  if (head == "DEBUG" || head == "PRINT") return "a message, with the values of its parameters";
  if (head == "LOG") return "a line of the log file, with the values of its parameters";
  return "a comment";
}

}  // namespace

namespace {
/// Whether a block changes where coordinates count from.
bool has_origin_word(const std::vector<Word>& words) {
  return std::any_of(words.begin(), words.end(), [](const Word& w) {
    if (w.letter != 'G') return false;
    const long code = std::lround(w.value * 10);
    return (code >= 540 && code <= 593) || (code >= 920 && code <= 923) || code == 100 || code == 520 ||
           (code >= 430 && code <= 432) || code == 490;
  });
}
}  // namespace

/// What a letter means beside the codes of its line, and else in the motion that is in force.
std::string Engine::meaning_of(const Word& word, const std::vector<Word>& words) const {
  const auto has = [&](char letter, std::initializer_list<int> codes) {
    return std::any_of(words.begin(), words.end(), [&](const Word& w) {
      return w.letter == letter && std::find(codes.begin(), codes.end(), std::lround(w.value * 10)) != codes.end();
    });
  };
  const std::string_view unit = inches_ ? "inch" : "mm";
  const std::string value = shown(word.value);
  std::string claimed;  // letters of the line that are no numbers of the cycle or the arc in force
  if (has('G', {40})) claimed += "P";
  if (has('G', {100})) claimed += "PLRIJQ";
  if (has('G', {640})) claimed += "PQ";
  if (has('M', {980})) claimed += "PL";
  for (const Word& w : words) {
    if (w.letter == 'M') claimed += arguments_of_m(static_cast<int>(w.value));
  }
  const bool cubic = has('G', {50}), spline = cubic || has('G', {51});
  const bool taken = claimed.find(word.letter) != std::string::npos;
  const bool in_cycle = is_cycle(motion_) && !taken, arc = (motion_ == 20 || motion_ == 30) && !taken;
  switch (word.letter) {
    case 'N':
      return "a line number, which does nothing";
    case 'G': {
      const auto text = meaning_in(kG, static_cast<int>(std::lround(word.value * 10)));
      return text.empty() ? "not described" : std::string(text);
    }
    case 'M': {
      const auto text = meaning_in(kM, static_cast<int>(std::lround(word.value * 10)));
      return text.empty() ? "a command of the machine's builder" : std::string(text);
    }
    case 'F':
      return inverse_ ? fmt::format("the move takes 1/{} min", value) : fmt::format("feed rate {} {}/min", value, unit);
    case 'S':
      return fmt::format("spindle speed {} 1/min", value);
    case 'T':
      return fmt::format("tool {} is next (M6 changes it)", value);
    case 'H':
      return word.value == 0 ? std::string("of the tool in the spindle")
                             : fmt::format("of tool {} of the tool table", value);
    case 'X':
    case 'Y':
    case 'Z':
    case 'A':
    case 'B':
    case 'C': {
      const std::string_view of = word.letter <= 'C' ? std::string_view("deg") : unit;
      if (has('G', {100, 920, 520, 431, 432})) return fmt::format("{} {} of this setting", value, of);
      if (has('G', {530})) return fmt::format("to {} {} of the machine's own coordinate", value, of);
      if (in_cycle && incremental_ && word.letter == kAxisLetters[axes_of(plane_)[2]])
        return fmt::format("the bottom of the hole, {} {} from R", value, of);
      return incremental_ ? fmt::format("by {} {}", value, of) : fmt::format("to {} {}", value, of);
    }
    case 'I':
    case 'J':
    case 'K':
      if (spline && word.letter != 'K')
        return fmt::format("{} control point: {} {} from the start", cubic ? "first" : "the", value, unit);
      if (!arc) break;
      return fmt::format("centre of the arc: {} {} {}", value, unit, arc_absolute_ ? "absolute" : "from its start");
    case 'R':
      if (in_cycle)
        return fmt::format("the height from which the cycle feeds{}: {} {}{}",
                           old_level_ ? "" : ", and to which it returns", value, unit,
                           incremental_ ? " from where the tool is" : "");
      if (arc)
        return fmt::format("radius of the arc: {} {}{}", value, unit,
                           word.value < 0 ? "; negative: more than half a turn" : "");
      if (has('G', {100})) return fmt::format("turn of the coordinate system, {} deg", value);
      if (has('M', {190})) return fmt::format("to {} deg", value);
      break;
    case 'P':
      if (has('M', {190}))
        return word.value == 0 ? "the shorter way" : word.value == 1 ? "clockwise" : "counterclockwise";
      if (has('M', {500, 510, 520, 530})) return word.value == 0 ? "off" : "on";
      if (has('M', {620, 630, 640, 650})) return fmt::format("digital output {}", value);
      if (has('G', {40}) || in_cycle) return fmt::format("dwell {} s", value);
      if (has('G', {640})) return fmt::format("rounded corners leave the path by at most {} {}", value, unit);
      if (has('G', {100})) {
        const bool system = std::any_of(words.begin(), words.end(), [](const Word& w) {
          return w.letter == 'L' && (w.value == 2 || w.value == 20);
        });
        if (!system) return fmt::format("of tool {}", value);
        return word.value == 0 ? std::string("of the coordinate system in force")
                               : fmt::format("of coordinate system {} ({})", value,
                                             word.value <= 6 ? fmt::format("G{:g}", 53 + word.value)
                                                             : fmt::format("G59.{:g}", word.value - 6));
      }
      if (arc)
        return word.value <= 1 ? std::string("no whole turn before the end")
                               : fmt::format("{:g} whole {} before it goes on to the end", word.value - 1,
                                             word.value == 2 ? "turn" : "turns");
      if (has('M', {980})) return fmt::format("subprogram {}", value);
      if (has('M', {660})) return fmt::format("digital input {}", value);
      if (cubic) return fmt::format("second control point: {} {} from the end, in X", value, unit);
      if (motion_ == 52) return fmt::format("weight of the control point {}", value);
      break;
    case 'Q':
      if (has('G', {640})) return fmt::format("lines that stay within {} {} are merged into one", value, unit);
      if (in_cycle) return fmt::format("depth of a peck: {} {}", value, unit);
      if (has('M', {660})) return fmt::format("at most {} s", value);
      if (has('M', {190})) return fmt::format("waits at most {} s for it", value);
      if (has('M', {610})) return fmt::format("tool {}", value);
      if (has('M', {670, 680})) return fmt::format("to the value {}", value);
      if (cubic) return fmt::format("second control point: {} {} from the end, in Y", value, unit);
      break;
    case 'L':
      if (has('G', {100})) {
        if (word.value == 2) return "sets the origin of a coordinate system";
        if (word.value == 20)
          return "sets the origin of a coordinate system so that these are the coordinates of the tool";
        return word.value == 1 ? "sets an entry of the tool table"
                               : "sets an entry of the tool table so that these are the coordinates of the tool";
      }
      if (in_cycle) return fmt::format("{} holes", value);
      if (has('M', {980})) return fmt::format("{} times", value);
      if (has('M', {660})) {
        constexpr std::array kWays{"reads it at once", "waits for it to rise", "waits for it to fall",
                                   "waits until it is on", "waits until it is off"};
        const auto way = static_cast<std::size_t>(std::clamp(word.value, 0.0, 4.0));
        return kWays[way];
      }
      if (motion_ == 52) return fmt::format("order of the curve {}", value);
      break;
    case 'E':
      if (has('M', {660})) return fmt::format("analogue input {}", value);
      if (has('M', {670, 680})) return fmt::format("analogue output {}", value);
      break;
    case 'D':
      if (has('G', {411, 421})) return fmt::format("diameter {} {}", value, unit);
      if (has('G', {410, 420})) return fmt::format("diameter of tool {} of the tool table", value);
      break;
    case '@':
      return fmt::format("distance from the origin {} {}", value, unit);
    case '^':
      return fmt::format("angle {} deg", value);
    default:
      break;
  }
  return "a value of the codes beside it";
}

std::vector<Explanation::Meaning> Engine::in_force() const {
  std::vector<Explanation::Meaning> out;
  const auto code = [&](int tenfold, const std::string& more = {}) {
    out.push_back({code_name('G', tenfold), std::string(meaning_in(kG, tenfold)) + more});
  };
  const auto coordinates = [](const auto& values, std::string_view unit) {
    std::string text;
    for (std::size_t k = 0; k < 6; ++k) {
      if (values[k] != 0) text += fmt::format(" {}{} {}", kAxisLetters[k], shown(values[k]), k < 3 ? unit : "deg");
    }
    return text;
  };
  const std::string_view unit = inches_ ? "inch" : "mm";
  if (motion_ >= 0) code(motion_);
  code(plane_ == Plane::xy ? 170 : plane_ == Plane::zx ? 180 : 190);
  code(inches_ ? 200 : 210);
  code(incremental_ ? 910 : 900);
  code(arc_absolute_ ? 901 : 911);
  code(inverse_ ? 930 : 940);
  const std::string at = coordinates(origin_, unit);
  std::string system = at.empty() ? ", at the machine's zero" : ", origin in the machine:" + at;
  if (rotation_ != 0) system += fmt::format(", turned by {} deg", shown(rotation_));
  code(active_ <= 6 ? 530 + 10 * active_ : 590 + (active_ - 6), system);
  if (const std::string shift = coordinates(g92_, unit); !shift.empty())
    out.push_back({"G92", "offset of all systems:" + shift});
  if (side_ != 0) {
    code(side_ > 0 ? 410 : 420, fmt::format(", cutter radius {} {}", shown(cutter_radius_), unit));
  }
  const std::string length = coordinates(length_offset_, unit);
  if (tool_offset_ && !length.empty()) {
    out.push_back({"G43", "tool length offset:" + length});
  } else {
    code(490);
  }
  code(path_mode_,
       path_mode_ == 640 && tolerance_ > 0 ? fmt::format(", by at most {} {}", shown(tolerance_), unit) : "");
  if (is_cycle(motion_)) code(old_level_ ? 980 : 990);
  if (loaded_.number > 0) out.push_back({fmt::format("T{}", loaded_.number), "the tool in the spindle"});
  if (feed_ > 0 && !inverse_)
    out.push_back({"F" + shown(feed_), fmt::format("feed rate {} {}/min", shown(feed_), unit)});
  if (turning_ != 0) {
    out.push_back(
        {turning_ > 0 ? "M3" : "M4", fmt::format("the spindle turns {} at {} 1/min",
                                                 turning_ > 0 ? "clockwise" : "counterclockwise", shown(speed_))});
  } else {
    out.push_back({"M5", "the spindle is at rest"});
  }
  if (flood_) out.push_back({"M8", "coolant on"});
  if (mist_) out.push_back({"M7", "mist on"});
  return out;
}

Result<Explanation> Engine::explain(int line) {
  Explanation out;
  out.line = line;
  const auto& blocks = source().program->blocks;
  const auto at = std::find_if(blocks.begin(), blocks.end(), [&](const Block& b) { return b.line == line; });
  if (at == blocks.end()) {
    return fail("GC153", fmt::format("the program has no line {}", line), Place{source().program->path, 0, 0},
                blocks.empty() ? "it is empty" : fmt::format("its last line is {}", blocks.back().line));
  }
  out.text = at->text;
  if (at->construct == Construct::o_word) {
    const auto word = o_word(at->text);
    out.divides = word && (word->second == "else" || word->second == "elseif");
  }
  begin();
  until_ = line;
  POLYPOD_TRY(run_lines());
  until_ = 0;
  if (ends_ || frame().source != 0 || frame().at >= blocks.size()) return out;
  if (at->optional && options_.block_delete) return out;
  out.runs = true;
  out.from = left_ && !compensating() ? canon_ : programmed();  // behind G40 the tool still stands beside
  // Where that is on the machine, for a block that changes the coordinates.
  const auto coordinates = [&] { return std::tuple(origin_, g92_, rotation_, length_offset_); };
  const auto coordinates_before = coordinates();
  Axes on_machine = to_machine(out.from);
  for (std::size_t k = 0; k < 6; ++k) on_machine[k] += length_offset_[k];
  const bool beside = compensating();
  const bool inches = inches_;
  const std::size_t before = out_.size();
  const Block block = *at;
  std::vector<Word> words(block.words.begin(), block.words.end());
  if (at->construct != Construct::none || at->after_end) {  // a subprogram of M98 may stand behind M2
    POLYPOD_ASSIGN(read, read_line(at->text, *this, Place{source().program->path, line, 0}));
    words = read.words;
    if (!read.keyword.empty()) {
      const auto* const known = std::find_if(std::begin(kKeywords), std::end(kKeywords),
                                             [&](const auto& k) { return k.first == read.keyword; });
      Explanation::Meaning control{"O" + read.label + " " + read.keyword, std::string(known->second)};
      for (const double argument : read.arguments) control.word += fmt::format(" [{}]", shown(argument));
      out.words.push_back(std::move(control));
    }
    for (const Line::Assignment& set : read.assignments) {
      const std::string name = set.name.empty() ? fmt::format("#{}", set.index) : fmt::format("#<{}>", set.name);
      out.words.push_back({name, fmt::format("becomes {}", shown(set.value))});
    }
  }
  POLYPOD_TRY(step());
  if (inches_ != inches) {
    scale(out.from, inches_ ? 1 / kMmPerInch : kMmPerInch);
    scale(on_machine, inches_ ? 1 / kMmPerInch : kMmPerInch);
  }
  if (inches_ == inches ? coordinates() != coordinates_before : has_origin_word(words)) {
    for (std::size_t k = 0; k < 6; ++k) on_machine[k] -= length_offset_[k];
    out.from = from_machine(on_machine);
  }
  out.to = programmed();
  out.compensated = beside || compensating();
  out.inches = inches_;
  for (const Word& word : words) {
    const bool code = word.letter == 'G' || word.letter == 'M';
    const std::string name =
        code ? code_name(word.letter, static_cast<int>(std::lround(word.value * 10))) : word.letter + shown(word.value);
    out.words.push_back({name, meaning_of(word, words)});
  }
  if (at->optional) out.words.insert(out.words.begin(), {"/", "an optional block: block delete leaves it out"});
  for (const std::string_view comment : comments(block))
    out.words.push_back({std::string(comment), std::string(meaning_of_comment(comment))});
  if (!ends_) out.in_force = in_force();  // the end of a program sets all modes anew
  for (std::size_t i = before; i < out_.size();) {
    const std::size_t end = std::min(out_.find('\n', i), out_.size());
    out.calls.push_back(out_.substr(i, end - i));
    i = end + 1;
  }
  return out;
}

Result<Explanation> explain(const Program& program, int line, const CanonOptions& options) {
  POLYPOD_ASSIGN(engine, engine_options(program, options, line));
  return Engine(program, std::move(engine)).explain(line);
}

}  // namespace polypod::gcode
