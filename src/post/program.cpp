// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The moves of a G-code program as steps, and which of the two languages a file is in.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <initializer_list>

#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/unroll.hpp"
#include "polypod/post/path.hpp"
#include "writing.hpp"

namespace polypod::post {
namespace {

Vec3 normal_of(gcode::Plane plane) {
  return plane == gcode::Plane::xy ? Vec3::UnitZ() : plane == gcode::Plane::zx ? Vec3::UnitY() : Vec3::UnitX();
}

int code_of(const gcode::Word& w) {
  return static_cast<int>(std::lround(w.value * 10));
}

constexpr int kLeastBuilders = 100, kMostBuilders = 199;  // M words of the machine's builder

bool moves_by_machine(int g) {
  return g == 280 || g == 300 || g == 530;
}

/// G words that the moves have already (planes, units, distances, offsets, compensation, cycles), or that cancel what
/// the program has not.
bool in_the_moves(int g) {
  constexpr std::array kTaken{0,   10,  20,  30,  170, 180, 190, 200, 210, 400, 540, 550, 560, 570,
                              580, 590, 800, 900, 901, 910, 911, 930, 940, 970, 980, 990, 921, 922};
  return std::find(kTaken.begin(), kTaken.end(), g) != kTaken.end();
}

/// The block as a program in mm has it, in the order in which RS-274 takes its words.
class BlockReader {
 public:
  /// `codes`: M codes of the controller, of which nothing but the tip's coordinates is known to follow.
  BlockReader(const std::string& file, const gcode::Block& block, const gcode::ModalState& state,
              const std::map<int, gcode::MCode>& codes, Path& out)
      : file_(file), block_(block), inches_(state.inches), codes_(codes), out_(out) {}

  /// What comes before the move of the block.
  Status before(bool arc, std::optional<gcode::PathControl>& path) {
    POLYPOD_TRY(all_known(arc));
    for (const std::string_view comment : gcode::comments(block_)) {
      Step s = step(StepKind::comment);
      const bool bracket = comment.front() == '(';
      s.text = comment.substr(1, comment.size() - (bracket ? 2 : 1));
      // `;MSG,` is a remark, `(MSG,` speaks to the operator.
      if (!bracket && s.text.find(',') != std::string::npos) s.text = "; " + s.text;
      out_.steps.push_back(std::move(s));
    }
    if (const gcode::Word* w = find('S')) {
      const std::string speed = number(w->value, 3);
      add("S" + speed, m({3, 4}) ? "" : fmt::format("spindle speed {} rev/min", speed));
      speed_ = speed;
    }
    if (const gcode::Word* w = find('T')) {
      add("T" + number(w->value, 0), m({6}) ? "" : fmt::format("tool {} is the next", number(w->value, 0)));
    }
    alone(62, 68, false);
    if (m({6})) {
      const gcode::Word* t = find('T');
      add("M6", t ? fmt::format("change to tool {}", number(t->value, 0)) : "change to the selected tool");
    }
    alone(61, 61, true);
    if (m({3})) add("M3", spindle("clockwise"));
    if (m({4})) add("M4", spindle("counterclockwise"));
    if (m({5})) add("M5", "spindle off");
    alone(19, 19, false);
    if (m({7})) add("M7", "mist on");
    if (m({8})) add("M8", "flood on");
    if (m({9})) add("M9", "coolant off");
    alone(48, 53, true);
    alone(kLeastBuilders, kMostBuilders, false);
    for (const auto& [code, meaning] : codes_)
      if (code < kLeastBuilders || code > kMostBuilders) alone(code, code, false);
    flush();
    if (g(40)) {
      Step s = step(StepKind::dwell);
      if (const gcode::Word* p = find('P')) s.seconds = p->value;
      out_.steps.push_back(std::move(s));
    }
    length_offset();
    path_mode(path);
    return {};
  }

  /// And what comes after it.
  void after() {
    for (const gcode::Word& w : block_.words) {
      if (w.letter != 'M' || (w.value != 0 && w.value != 1 && w.value != 60)) continue;
      Step s = step(w.value == 1 ? StepKind::optional_stop : StepKind::stop);
      s.text = fmt::format("M{}", number(w.value, 0));
      out_.steps.push_back(std::move(s));
    }
    if (m({30})) out_.end = "M30";
    if (m({2})) out_.end = "M2";
  }

  /// Moves in machine coordinates are left out, as long as no other move comes behind them.
  Status leave_out(bool cuts, bool moving) {
    if (const gcode::Word* w = by_machine()) {
      if (cuts && code_of(*w) == 530) {
        return fail("PO116", "a cut in machine coordinates (G53): where the machine's zero lies is not known",
                    Place{file_, block_.line, w->column}, "write this cut in workpiece coordinates");
      }
      const std::size_t first = block_.text.find_first_not_of(" \t"), last = block_.text.find_last_not_of(" \t\r");
      out_.left_out.push_back({block_.line, std::string(block_.text.substr(first, last + 1 - first))});
    }
    if (!moving || out_.left_out.empty()) return {};
    const LeftOut& retract = out_.left_out.front();
    return fail("PO116",
                fmt::format("`{}` with moves behind it (line {}): where the machine's zero lies is not known",
                            retract.text, block_.line),
                Place{file_, retract.line, 1},
                "write it in workpiece coordinates (G0 Z...); as the last move of a program it is left out and named");
  }

  [[nodiscard]] bool turns() const { return find('A') || find('B') || find('C'); }
  [[nodiscard]] bool says_c() const { return find('C') != nullptr; }

 private:
  [[nodiscard]] const gcode::Word* by_machine() const {
    for (const gcode::Word& w : block_.words)
      if (w.letter == 'G' && moves_by_machine(code_of(w))) return &w;
    return nullptr;
  }
  [[nodiscard]] Step step(StepKind kind) const {
    Step s;
    s.kind = kind;
    s.line = block_.line;
    return s;
  }
  [[nodiscard]] const gcode::Word* find(char letter) const {
    for (const gcode::Word& w : block_.words)
      if (w.letter == letter) return &w;
    return nullptr;
  }
  [[nodiscard]] bool g(int code) const {
    return std::any_of(block_.words.begin(), block_.words.end(),
                       [&](const gcode::Word& w) { return w.letter == 'G' && code_of(w) == code; });
  }
  [[nodiscard]] bool m(std::initializer_list<int> values) const {
    return std::any_of(block_.words.begin(), block_.words.end(), [&](const gcode::Word& w) {
      return w.letter == 'M' && std::any_of(values.begin(), values.end(), [&](int v) { return w.value == v; });
    });
  }

  Status all_known(bool arc) const {
    const bool p_elsewhere = arc || g(40) || g(640);
    for (const gcode::Word& w : block_.words) {
      const Place place{file_, block_.line, w.column};
      if (w.letter == 'G') {
        const int code = code_of(w);
        if (in_the_moves(code) || moves_by_machine(code)) continue;
        if (code == 40 || code == 430 || code == 431 || code == 490 || code == 610 || code == 611 || code == 640)
          continue;
        return fail("PO118", fmt::format("G{} is not carried over", number(w.value, 1)), place,
                    "remove it, or write with the words of docs/post.md what it does");
      }
      if (w.letter != 'M') continue;
      const auto v = static_cast<int>(w.value);
      const bool taken = (v >= 0 && v <= 9) || v == 19 || v == 30 || (v >= 48 && v <= 53) || (v >= 60 && v <= 68) ||
                         (v >= kLeastBuilders && v <= kMostBuilders) || codes_.contains(v);
      if (!taken || double(v) != w.value) {
        return fail("PO118", fmt::format("M{} is not carried over", number(w.value, 1)), place,
                    "remove it, or do in the program what it does");
      }
      if (p_elsewhere && !gcode::arguments_of_m(v).empty() && (find('P') || find('Q'))) {
        return fail("PO118", fmt::format("M{} beside a word that takes P or Q as well", v), place,
                    "give it a block of its own");
      }
    }
    return {};
  }

  [[nodiscard]] std::string spindle(const char* sense) const {
    return speed_.empty() ? fmt::format("spindle {}", sense) : fmt::format("spindle {} rev/min {}", speed_, sense);
  }

  void add(const std::string& text, const std::string& meaning) {
    line_ += (line_.empty() ? "" : " ") + text;
    if (!meaning.empty()) meaning_ += (meaning_.empty() ? "" : ", ") + meaning;
  }
  void flush(bool robots = true) {
    if (line_.empty()) return;
    Step s = step(StepKind::words);
    s.text = std::move(line_);
    s.meaning = std::move(meaning_);
    s.robots = robots;
    out_.steps.push_back(std::move(s));
    line_.clear();
    meaning_.clear();
  }
  /// M words of this range, each in a line of its own with its numbers.
  void alone(int least, int most, bool robots) {
    for (const gcode::Word& w : block_.words) {
      const auto v = static_cast<int>(w.value);
      if (w.letter != 'M' || v < least || v > most) continue;
      flush();
      std::string text = fmt::format("M{}", v);
      for (const gcode::Word& argument : block_.words)
        if (gcode::arguments_of_m(v).find(argument.letter) != std::string_view::npos)
          text += fmt::format(" {}{}", argument.letter, number(argument.value, 6));
      add(text, text);
      flush(robots);
    }
  }

  [[nodiscard]] std::string length(double value) const {
    return number(units::to_mm(inches_ ? units::from_inch(value) : units::from_mm(value)), 6);
  }

  void length_offset() {
    const int code = g(430) ? 430 : g(431) ? 431 : g(490) ? 490 : 0;
    if (code == 0) return;
    Step s = step(StepKind::words);
    s.text = code == 430 ? "G43" : code == 431 ? "G43.1" : "G49";
    if (const gcode::Word* h = find('H'); h && code == 430) s.text += " H" + number(h->value, 0);
    if (code == 431) {
      for (const gcode::Word& w : block_.words) {
        if (std::string_view("XYZ").find(w.letter) != std::string_view::npos)
          s.text += fmt::format(" {}{}", w.letter, length(w.value));
        if (std::string_view("ABC").find(w.letter) != std::string_view::npos)
          s.text += fmt::format(" {}{}", w.letter, number(w.value, 6));
      }
    }
    s.length_offset = true;
    out_.steps.push_back(std::move(s));
  }

  void path_mode(std::optional<gcode::PathControl>& path) {
    if (!g(610) && !g(611) && !g(640)) return;
    Step s = step(StepKind::words);
    s.path_mode = true;
    gcode::PathControl control;
    if (g(610) || g(611)) {
      s.text = g(610) ? "G61" : "G61.1";
      control.mode = g(610) ? gcode::PathMode::exact_path : gcode::PathMode::exact_stop;
    } else {
      s.text = "G64";
      for (const char letter : {'P', 'Q'}) {
        const gcode::Word* w = find(letter);
        if (w == nullptr) continue;
        s.text += fmt::format(" {}{}", letter, length(w->value));
        if (letter == 'P')
          control.blend_tolerance = static_cast<float>(inches_ ? units::from_inch(w->value) : units::from_mm(w->value));
      }
    }
    path = control;
    out_.steps.push_back(std::move(s));
  }

  const std::string& file_;
  const gcode::Block& block_;
  bool inches_;
  const std::map<int, gcode::MCode>& codes_;
  Path& out_;
  std::string line_, meaning_, speed_;
};

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

/// The move, where it can be judged: a cut from a known place, a turn at one.
Result<Step> judged_step(const gcode::Move& move, const Place& place) {
  if (move.kind != gcode::MoveKind::rapid && !move.start_known) {
    return fail("PO117",
                "where this cut starts is not known: X, Y or Z have not been commanded since the program began, or "
                "since a tool length offset (G43, G49) changed",
                place, "command X, Y and Z with G0 before the first cut, and Z after G43");
  }
  Step s = step_of(move, place.line);
  s.known = move.known_end;
  s.start_known = move.start_known;
  if (s.placed()) return s;
  if ((move.axes_end - move.axes_start).cwiseAbs().maxCoeff() > 0) {
    return fail("PO117", "A, B or C turn where X, Y or Z are not known: this cannot be judged", place,
                "command X, Y and Z with G0 before");
  }
  for (int k = 0; k < 3; ++k)
    if (!s.known[static_cast<std::size_t>(k)]) s.tip[k] = 0;
  return s;
}

/// The first line, if any, of what a note tells.
struct Firsts {
  int incomplete = 0, length_change = 0, other_offset = 0, plain_turn = 0;

  void say(std::vector<std::string>& notes) const {
    if (incomplete > 0) {
      notes.push_back(
          fmt::format("line {}: X, Y or Z are not known yet, so this rapid, and the way of the next to a known place, "
                      "cannot be judged: the place to which it comes is",
                      incomplete));
    }
    if (length_change > 0 && length_change != incomplete) {
      notes.push_back(
          fmt::format("line {}: the tool length offset changes before it; where the tip then stands is not known, and "
                      "of such rapids the end is judged, not the way",
                      length_change));
    }
    if (other_offset > 0)
      notes.push_back(fmt::format("line {}: G55 to G59 are written in the coordinates of G54", other_offset));
    if (plain_turn > 0) {
      notes.push_back(fmt::format(
          "line {}: a cut that only turns the tool is written with --turn-speed, not with its F", plain_turn));
    }
  }
};

}  // namespace

Result<Path> read_program(const std::string& file, const ProgramOptions& options) {
  POLYPOD_ASSIGN(source, gcode::read(file));
  const auto slash = std::find_if(source.blocks.begin(), source.blocks.end(),
                                  [](const gcode::Block& block) { return block.optional && !block.after_end; });
  if (slash != source.blocks.end() && !options.block_delete_said) {
    return fail("PO126", "a block that begins with /: the machine's switch says whether it is carried out",
                Place{file, slash->line, 1}, "give a job with block_delete = true or false, or remove the /");
  }
  POLYPOD_ASSIGN(understood, gcode::understand(file, options.unroll));
  if (options.accept) POLYPOD_TRY(options.accept(understood));
  Path out;
  out.file = file;
  out.program = true;
  // A tool length is passed on in its place, and whether / is carried out is the job's word: post says it itself.
  for (const std::string& note : understood.interpretation.notes)
    if (note.find(gcode::kLengthNote) == std::string::npos && note.find(gcode::kBlockDeleteNote) == std::string::npos)
      out.notes.push_back(note);
  if (slash != source.blocks.end()) {
    out.notes.push_back(fmt::format("line {}: {} are {}, as the job says", slash->line, gcode::kBlockDeleteNote,
                                    options.unroll.interpret.block_delete ? "left out" : "carried out"));
  }
  const LongVector<gcode::Move>& moves = understood.interpretation.moves;
  std::size_t next = 0;
  std::optional<gcode::PathControl> path;
  bool turned = false, placed = false;
  Firsts first;
  const auto name = [](int& line, const gcode::Block& block) { line = line == 0 ? block.line : line; };
  for (std::size_t b = 0; b < understood.program.blocks.size(); ++b) {
    const gcode::Block& block = understood.program.blocks[b];
    const gcode::ModalState& state = understood.interpretation.states[b];
    if (!state.executed) continue;
    BlockReader reader(file, block, state, options.unroll.interpret.m_codes, out);
    const bool moving = next < moves.size() && moves[next].block == static_cast<int>(b);
    POLYPOD_TRY(reader.before(moving && moves[next].kind == gcode::MoveKind::arc, path));
    POLYPOD_TRY(reader.leave_out(state.motion > 0, moving));
    turned = turned || (moving && reader.turns());
    if (moving && reader.says_c()) name(out.c_line, block);
    for (; next < moves.size() && moves[next].block == static_cast<int>(b); ++next) {
      const gcode::Move& move = moves[next];
      POLYPOD_ASSIGN(s, judged_step(move, Place{file, block.line, 1}));
      if (!move.start_known && placed) name(first.length_change, block);
      placed = placed || s.placed();
      s.turned = turned;
      s.path = path;
      if (!s.placed()) name(first.incomplete, block);
      if (move.work_offset != 0) name(first.other_offset, block);
      if (s.kind != StepKind::rapid && move.length() < kNoWay) name(first.plain_turn, block);
      out.steps.push_back(std::move(s));
    }
    reader.after();
  }
  if (moves.empty()) return fail("PO112", "the program makes no move", {file}, "there is nothing to post");
  if (std::none_of(out.steps.begin(), out.steps.end(), [](const Step& s) { return s.placed(); })) {
    return fail("PO117", "no move of the program ends at a place that is known whole", {file},
                "command X, Y and Z with G0");
  }
  first.say(out.notes);
  for (const LeftOut& l : out.left_out) {
    out.notes.push_back(
        fmt::format("line {}: `{}` at the end is left out, for the machine's zero is not known: the tool stays where "
                    "the move before it ends; retract it by hand or add the block on the controller",
                    l.line, l.text));
  }
  return out;
}

std::optional<gcode::CorrectionHeader> correction_header(const Path& path) {
  std::vector<gcode::Remark> remarks;
  for (const Step& s : path.steps)
    if (s.kind == StepKind::comment) remarks.push_back({s.line, s.text});
  return gcode::correction_header(remarks);
}

Result<Path> read_path(const std::string& file, const ProgramOptions& options) {
  POLYPOD_ASSIGN(text, files::read(file));
  if (looks_like_cl(text)) return parse_cl(text, file);
  std::error_code ec;
  const bool pipe = std::filesystem::is_fifo(file, ec);
  if (pipe || files::is_standard_input(file)) {  // it is read more than once
    return fail("PO115", fmt::format("a G-code program from {}", pipe ? "a pipe" : "standard input"), {file},
                "give the program as a file");
  }
  return read_program(file, options);
}

}  // namespace polypod::post
