// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A second, independent run through the program, in its own units: `interpret` has checked it, this prints it.
#include "polypod/gcode/canon.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <iterator>
#include <numbers>
#include <string_view>
#include <utility>
#include <vector>

#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/interpreter.hpp"

namespace polypod::gcode {
namespace {

constexpr double kMmPerInch = 25.4;
/// rs274's smallest feed under G93, units per minute.
constexpr double kLeastInverseFeed = 0.1;
constexpr std::string_view kAxisLetters = "XYZABC";
using Axes = std::array<double, 6>;    // X, Y, Z in program units; A, B, C in deg
using Offset = std::array<double, 9>;  // and U, V, W

char upper(char c) {
  return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
}
bool is_space(char c) {
  return c == ' ' || c == '\t' || c == '\r';
}

struct Tool {
  int number = 0;
  Offset offset{};  // inches and deg
};

/// The table that rs274 falls back to (LinuxCNC's sample configuration).
std::vector<Tool> sample_tools() {
  const auto tool = [](int number, double length) {
    Tool t;
    t.number = number;
    t.offset[2] = length;
    return t;
  };
  return {tool(1, 0.511), tool(2, 0.1), tool(3, 1.273), tool(99999, 0.1)};
}

struct Parameters {
  std::array<std::array<double, 6>, 9> systems{};  // G54 ... G59.3, inches and deg
  std::array<double, 6> g92{};
  int active = 1;
};

/// Calls `line(number, text, first column)` for every line that holds more than blanks, without its remark.
template <class F>
Status each_line(std::string_view text, std::string_view remarks, F&& line) {
  int number = 0;
  while (!text.empty()) {
    const std::size_t newline = text.find('\n');
    std::string_view part = text.substr(0, newline);
    text = newline == std::string_view::npos ? std::string_view{} : text.substr(newline + 1);
    ++number;
    part = part.substr(0, part.find_first_of(remarks));
    while (!part.empty() && is_space(part.back())) part.remove_suffix(1);
    if (!part.empty()) POLYPOD_TRY(line(number, part));
  }
  return {};
}

/// The words of a line between blanks, with their columns (from 1).
std::vector<std::pair<std::string_view, int>> split(std::string_view line) {
  std::vector<std::pair<std::string_view, int>> words;
  for (std::size_t i = 0; i < line.size();) {
    if (is_space(line[i])) {
      ++i;
      continue;
    }
    std::size_t end = i;
    while (end < line.size() && !is_space(line[end])) ++end;
    words.emplace_back(line.substr(i, end - i), static_cast<int>(i) + 1);
    i = end;
  }
  return words;
}

/// The whole of `text` as a finite number.
bool to_number(std::string_view text, double& value) {
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  return code == std::errc() && end == text.data() + text.size() && std::isfinite(value);
}

Result<std::vector<Tool>> read_tools(const std::string& path) {
  if (path.empty()) return sample_tools();
  POLYPOD_ASSIGN(text, files::read(path));
  std::vector<Tool> tools;
  POLYPOD_TRY(each_line(text, ";", [&](int number, std::string_view line) -> Status {
    Tool tool;
    bool has_number = false;
    bool has_pocket = false;
    for (const auto& part : split(line)) {
      const std::string_view word = part.first;
      const auto bad = [&](std::string_view why) {
        const Place place{path, number, part.second};
        return fail("GC152", fmt::format("{} {}", word, why), place, "a tool is a line like T1 P1 Z0.511 D0.125");
      };
      double value = 0;
      if (!to_number(word.substr(1), value)) return bad("is no word of a tool table");
      const char letter = upper(word.front());
      if (letter == 'T' || letter == 'P') {
        if (value < 0 || value > 99999 || value != std::floor(value)) return bad("is no number from 0 to 99999");
        (letter == 'T' ? has_number : has_pocket) = true;
        if (letter == 'T') tool.number = static_cast<int>(value);
      } else if (const std::size_t axis = std::string_view("XYZABCUVW").find(letter); axis != std::string_view::npos) {
        tool.offset[axis] = value;
      } else if (std::string_view("DIJQ").find(letter) == std::string_view::npos) {
        return bad("is no word of a tool table");
      }
    }
    if (!has_number || !has_pocket) {
      return fail("GC152", "a tool without T or P", Place{path, number, 1},
                  "a tool is a line like T1 P1 Z0.511 D0.125");
    }
    tools.push_back(tool);
    return {};
  }));
  return tools;
}

Result<Parameters> read_parameters(const std::string& path) {
  Parameters parameters;
  if (path.empty()) return parameters;
  POLYPOD_ASSIGN(text, files::read(path));
  bool g92 = false;
  POLYPOD_TRY(each_line(text, ";#", [&](int number, std::string_view line) -> Status {
    const auto words = split(line);
    double index = 0;
    double value = 0;
    if (words.size() != 2 || !to_number(words[0].first, index) || !to_number(words[1].first, value) ||
        index != std::floor(index)) {
      return fail("GC152", fmt::format("'{}' is no parameter", line), Place{path, number, 1},
                  "a parameter is a line like 5221 10.0");
    }
    const int i = index >= 0 && index < 1e6 ? static_cast<int>(index) : 0;
    if (i == 5210) g92 = value != 0;
    if (i >= 5211 && i <= 5216) parameters.g92[static_cast<std::size_t>(i - 5211)] = value;
    if (i == 5220) {
      if (value < 1 || value > 9 || value != std::floor(value)) {
        return fail("GC152", fmt::format("{} is no coordinate system; 5220 is an integer from 1 to 9", value),
                    Place{path, number, words[1].second}, "1 is G54, 6 is G59");
      }
      parameters.active = static_cast<int>(value);
    }
    if (i >= 5221 && i <= 5390) {
      const int system = (i - 5221) / 20;
      const int entry = (i - 5221) % 20;
      if (entry < 6) parameters.systems[static_cast<std::size_t>(system)][static_cast<std::size_t>(entry)] = value;
      if (entry == 9 && value != 0) {
        return fail("GC152",
                    fmt::format("parameter {} turns the coordinates by {} deg, which is not supported", i, value),
                    Place{path, number, words[1].second}, "set it to 0");
      }
    }
    return {};
  }));
  if (!g92) parameters.g92.fill(0);
  return parameters;
}

class Printer {
 public:
  Printer(const Program& program, const CanonOptions& options, std::vector<Tool> tools, const Parameters& parameters)
      : program_(program),
        options_(options),
        tools_(std::move(tools)),
        systems_(parameters.systems),
        g92_(parameters.g92),
        active_(parameters.active) {
    // rs274 counts in mm from the start; its files are in inches.
    for (auto& system : systems_) scale(system, kMmPerInch);
    scale(g92_, kMmPerInch);
    for (std::size_t k = 0; k < 6; ++k) current_[k] = canon_[k] = 0 - system(active_)[k] - g92_[k];
  }

  Result<std::string> run() {
    number_ = kNoNumber;
    call("USE_LENGTH_UNITS(CANON_UNITS_MM)");
    print_system(active_, true);
    call("SET_FEED_REFERENCE(CANON_XYZ)");
    call("ON_RESET()");
    bool percent = false;
    bool ended = false;
    for (const Block& block : program_.blocks) {
      if (ended || block.after_end) break;
      if (block.percent) {
        if (percent) {
          number_ = kNoNumber;
          call("FINISH()");
          ended = true;
        }
        percent = true;
        continue;
      }
      if (block.optional && options_.block_delete) continue;
      POLYPOD_TRY(print(block));
      ended = ends_;
    }
    if (!ended) {
      return fail("GC150", "no M2, M30 or closing %: LinuxCNC refuses a program without an end",
                  Place{program_.path, program_.blocks.empty() ? 0 : program_.blocks.back().line, 1}, "end it with M2");
    }
    number_ = kNoNumber;
    call("ON_RESET()");
    call("ON_RESET()");
    return std::move(out_);
  }

 private:
  static constexpr std::string_view kNoNumber = "N..... ";

  template <std::size_t N>
  static void scale(std::array<double, N>& values, double factor) {
    for (std::size_t k = 0; k < 3; ++k) values[k] *= factor;
  }
  [[nodiscard]] const Axes& system(int index) const { return systems_[static_cast<std::size_t>(index - 1)]; }

  void call(std::string_view text) { fmt::format_to(std::back_inserter(out_), "{:5} {}{}\n", ++calls_, number_, text); }
  template <class... T>
  void call(fmt::format_string<T...> format, T&&... values) {
    call(std::string_view(fmt::format(format, std::forward<T>(values)...)));
  }
  static std::string list(const Axes& p) {
    return fmt::format("{:.4f}, {:.4f}, {:.4f}, {:.4f}, {:.4f}, {:.4f}", p[0], p[1], p[2], p[3], p[4], p[5]);
  }
  void print_system(int index, bool with_g92) {
    call("SET_G5X_OFFSET({}, {})", index, list(system(index)));
    if (with_g92) call("SET_G92_OFFSET({})", list(g92_));
    call("SET_XY_ROTATION(0.0000)");
  }

  [[nodiscard]] const Word* find(char letter) const {
    for (const Word& word : block_->words) {
      if (word.letter == letter) return &word;
    }
    return nullptr;
  }
  [[nodiscard]] double value(char letter, double otherwise = 0) const {
    const Word* word = find(letter);
    return word != nullptr ? word->value : otherwise;
  }
  /// An index, as rs274 cuts it off.
  [[nodiscard]] int integer(char letter) const { return static_cast<int>(std::clamp(value(letter), -1e9, 1e9)); }
  /// The G (or M) word of the block among `codes`, times ten; -1 for none.
  template <class... T>
  [[nodiscard]] int one_of(char letter, T... codes) const {
    for (const Word& word : block_->words) {
      if (word.letter != letter) continue;
      const int tenfold = static_cast<int>(std::lround(word.value * 10));
      if (((tenfold == codes) || ...)) return tenfold;
    }
    return -1;
  }

  /// rs274 shows the digits that directly follow an N at the front of the line.
  void read_number() {
    const std::string& text = block_->text;
    std::size_t i = 0;
    while (i < text.size() && (is_space(text[i]) || text[i] == '/')) ++i;
    if (i >= text.size() || upper(text[i]) != 'N') {
      number_ = kNoNumber;
      return;
    }
    number_ = "N";
    for (++i; i < text.size() && text[i] >= '0' && text[i] <= '9'; ++i) number_ += text[i];
    if (number_.size() < kNoNumber.size()) number_.resize(kNoNumber.size(), ' ');
  }

  Status print(const Block& block) {
    block_ = &block;
    read_number();
    if (resync_) {
      current_ = canon_;
      resync_ = false;
    }
    comment();
    if (block.words.empty()) return {};
    feed_and_speed();
    POLYPOD_TRY(tools());
    spindle();
    switches();
    POLYPOD_TRY(settings());
    POLYPOD_TRY(motion());
    stop();
    return {};
  }

  /// Of several comments in brackets the last one counts; `;` comments do not.
  void comment() {
    std::string_view text;
    bool found = false;
    for (const std::string_view candidate : comments(*block_)) {
      if (candidate.front() != '(') continue;
      text = candidate.substr(1, candidate.size() - 2);
      found = !text.empty();
    }
    if (!found) return;
    while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
    const auto begins = [&](std::string_view word) {
      return text.size() >= word.size() &&
             std::ranges::equal(text.substr(0, word.size()), word, [](char a, char b) { return upper(a) == b; });
    };
    if (begins("MSG,")) return call("MESSAGE(\"{}\")", text.substr(4));
    if (begins("DEBUG,")) return call("MESSAGE(\"{}\")", text.substr(6));
    if (begins("PRINT,")) {
      out_ += text.substr(6);
      out_ += '\n';
      return;
    }
    if (begins("LOG,")) return call("LOG(\"{}\")", text.substr(4));
    if (begins("LOGOPEN,")) return call("LOGOPEN(\"{}\")", text.substr(8));
    if (begins("LOGAPPEND,")) return call("LOGAPPEND(\"{}\")", text.substr(10));
    if (begins("LOGCLOSE") && text.size() == 8) return call("LOGCLOSE()");
    call("COMMENT(\"{}\")", text);
  }

  void feed_and_speed() {
    if (one_of('G', 970) >= 0) call("SET_SPINDLE_MODE(0 0.0000)");
    if (const int mode = one_of('G', 930, 940); mode >= 0) {
      inverse_ = mode == 930;
      call("COMMENT(\"interpreter: feed mode set to {}\")", inverse_ ? "inverse time" : "units per minute");
      call("SET_FEED_MODE(0, 0)");
      if (!inverse_) call("SET_FEED_RATE(0.0000)");
    }
    if (const Word* f = find('F'); f != nullptr && !inverse_) call("SET_FEED_RATE({:.4f})", f->value);
    if (const Word* s = find('S'); s != nullptr) call("SET_SPINDLE_SPEED(0, {:.4f})", s->value);
  }

  /// The place of a tool in the table, from 1; 0 for tool 0.
  Result<std::size_t> index_of(const Word& word) const {
    if (word.value == 0) return std::size_t{0};
    for (std::size_t i = 0; i < tools_.size(); ++i) {
      if (tools_[i].number == static_cast<int>(word.value)) return i + 1;
    }
    return fail("GC151", fmt::format("tool {} is not in the tool table", word.value),
                Place{program_.path, block_->line, word.column}, "add it to the table; --tool-table names the file");
  }

  Status tools() {
    if (const Word* t = find('T'); t != nullptr) {
      POLYPOD_ASSIGN(index, index_of(*t));
      selected_ = index;
      call("SELECT_TOOL({})", static_cast<int>(t->value));
    }
    const int p = integer('P');
    const int e = integer('E');
    switch (one_of('M', 620, 630, 640, 650, 670, 680)) {
      case 620:
        call("SET_MOTION_OUTPUT_BIT({})", p);
        break;
      case 630:
        call("CLEAR_MOTION_OUTPUT_BIT({})", p);
        break;
      case 640:
        call("SET_AUX_OUTPUT_BIT({})", p);
        break;
      case 650:
        call("CLEAR_AUX_OUTPUT_BIT({})", p);
        break;
      case 670:
        call("SET_MOTION_OUTPUT_VALUE({},{:.6f})", e, value('Q'));
        break;
      case 680:
        call("SET_AUX_OUTPUT_VALUE({},{:.6f})", e, value('Q'));
        break;
      default:
        break;
    }
    switch (one_of('M', 60, 610)) {
      case 60:
        call("START_CHANGE()");
        call("STOP_SPINDLE_TURNING(0)");
        call("CHANGE_TOOL({})", selected_);
        if (selected_ > 0) loaded_ = tools_[selected_ - 1].offset;
        resync_ = true;
        break;
      case 610: {
        POLYPOD_ASSIGN(index, index_of(*find('Q')));
        call("CHANGE_TOOL_NUMBER({})", index);
        resync_ = true;
        break;
      }
      default:
        break;
    }
    return {};
  }

  void spindle() {
    switch (one_of('M', 30, 40, 50, 190)) {
      case 30:
        call("START_SPINDLE_CLOCKWISE(0)");
        break;
      case 40:
        call("START_SPINDLE_COUNTERCLOCKWISE(0)");
        break;
      case 50:
        call("STOP_SPINDLE_TURNING(0)");
        break;
      case 190:
        call("ORIENT_SPINDLE(0, {:.4f}, {})", value('R'), integer('P'));
        if (const Word* q = find('Q'); q != nullptr) call("SPINDLE.0.WAIT_ORIENT_COMPLETE({:.4f})", q->value);
        break;
      default:
        break;
    }
  }

  void switches() {
    switch (one_of('M', 70, 80, 90)) {
      case 70:
        mist_ = true;
        call("MIST_ON()");
        break;
      case 80:
        flood_ = true;
        call("FLOOD_ON()");
        break;
      case 90:
        mist_ = flood_ = false;
        call("MIST_OFF()");
        call("FLOOD_OFF()");
        break;
      default:
        break;
    }
    const bool on = value('P', 1) != 0;
    const std::string_view verb = on ? "ENABLE" : "DISABLE";
    switch (one_of('M', 480, 490, 500, 510, 520, 530)) {
      case 480:
        feed_override_ = true;
        call("ENABLE_FEED_OVERRIDE()");
        call("ENABLE_SPEED_OVERRIDE(0)");
        break;
      case 490:
        feed_override_ = false;
        call("DISABLE_FEED_OVERRIDE()");
        call("DISABLE_SPEED_OVERRIDE(0)");
        break;
      case 500:
        feed_override_ = on;
        call("{}_FEED_OVERRIDE()", verb);
        break;
      case 510:
        call("{}_SPEED_OVERRIDE(0)", verb);
        break;
      case 520:
        call("{}_ADAPTIVE_FEED()", verb);
        break;
      case 530:
        call("{}_FEED_HOLD()", verb);
        break;
      default:
        break;
    }
  }

  Status settings() {
    if (one_of('G', 40) >= 0) call("DWELL({:.4f})", value('P'));
    if (const int g = one_of('G', 170, 180, 190); g >= 0) {
      plane_ = g == 170 ? Plane::xy : g == 180 ? Plane::zx : Plane::yz;
      call("SELECT_PLANE(CANON_PLANE_{})", g == 170 ? "XY" : g == 180 ? "XZ" : "YZ");
    }
    if (const int g = one_of('G', 200, 210); g >= 0) {
      if (inches_ != (g == 200)) {
        inches_ = g == 200;
        const double factor = inches_ ? 1 / kMmPerInch : kMmPerInch;
        scale(current_, factor);
        scale(canon_, factor);
        scale(g92_, factor);
        for (auto& system : systems_) scale(system, factor);
      }
      call("USE_LENGTH_UNITS(CANON_UNITS_{})", inches_ ? "INCHES" : "MM");
    }
    if (one_of('G', 400) >= 0) call("COMMENT(\"interpreter: cutter radius compensation off\")");
    if (const int g = one_of('G', 430, 431, 490); g >= 0) POLYPOD_TRY(length_offset(g));
    if (const int g = one_of('G', 540, 550, 560, 570, 580, 590); g >= 0) {
      const int next = g / 10 - 53;
      if (next == active_) {
        call("COMMENT(\"interpreter: continuing to use same coordinate system\")");
      } else {
        for (std::size_t k = 0; k < 6; ++k) {
          const double shift = system(active_)[k] - system(next)[k];
          current_[k] += shift;
          canon_[k] += shift;
        }
        active_ = next;
        print_system(active_, true);
      }
    }
    switch (one_of('G', 610, 611, 640)) {
      case 610:
        call("SET_MOTION_CONTROL_MODE(CANON_EXACT_PATH)");
        break;
      case 611:
        call("SET_MOTION_CONTROL_MODE(CANON_EXACT_STOP)");
        break;
      case 640:
        // Below 0 neither is heeded.
        call("SET_MOTION_CONTROL_MODE(CANON_CONTINUOUS, {:.6f})", std::max(0.0, value('P')));
        call("SET_NAIVECAM_TOLERANCE({:.4f})", value('Q', -1) < 0 ? std::max(0.0, value('P')) : value('Q'));
        break;
      default:
        break;
    }
    if (const int g = one_of('G', 900, 910); g >= 0 && incremental_ != (g == 910)) {
      incremental_ = g == 910;
      call("COMMENT(\"interpreter: distance mode changed to {}\")", incremental_ ? "incremental" : "absolute");
    }
    if (const int g = one_of('G', 901, 911); g >= 0 && arc_absolute_ != (g == 901)) {
      arc_absolute_ = g == 901;
      call("COMMENT(\"interpreter: IJK distance mode changed to {}\")", arc_absolute_ ? "absolute" : "incremental");
    }
    if (const int g = one_of('G', 980, 990); g >= 0) {
      call("COMMENT(\"interpreter: retract mode set to {}\")", g == 980 ? "old_z" : "r_plane");
    }
    return {};
  }

  Status length_offset(int g) {
    Offset next{};
    if (g == 430) {
      const Word* h = find('H');
      if (h == nullptr) {
        next = loaded_;
      } else {
        POLYPOD_ASSIGN(index, index_of(*h));
        next = index > 0 ? tools_[index - 1].offset : loaded_;  // rs274 takes H0 as the tool in the spindle
      }
      if (!inches_) {
        scale(next, kMmPerInch);
        for (std::size_t k = 6; k < 9; ++k) next[k] *= kMmPerInch;
      }
    } else if (g == 431) {
      next = length_offset_;
      for (std::size_t k = 0; k < 6; ++k) next[k] = value(kAxisLetters[k], next[k]);
    }
    for (std::size_t k = 0; k < 6; ++k) current_[k] += length_offset_[k] - next[k];
    length_offset_ = next;
    call("USE_TOOL_LENGTH_OFFSET({:.4f} {:.4f} {:.4f}, {:.4f} {:.4f} {:.4f}, {:.4f} {:.4f} {:.4f})", next[0], next[1],
         next[2], next[3], next[4], next[5], next[6], next[7], next[8]);
    return {};
  }

  Status motion() {
    const int named = one_of('G', 0, 10, 20, 30, 800);
    if (named == 800) {
      motion_ = -1;
      call("COMMENT(\"interpreter: motion mode set to none\")");
      return {};
    }
    if (named >= 0) motion_ = named / 10;
    const bool offsets = one_of('G', 431) >= 0;  // whose axis words are no motion
    const bool axes = !offsets && std::ranges::any_of(kAxisLetters, [&](char c) { return find(c) != nullptr; });
    const bool centre =
        motion_ >= 2 && std::ranges::any_of(std::string_view("IJKR"), [&](char c) { return find(c) != nullptr; });
    if (motion_ < 0 || (named < 0 && !axes && !centre)) return {};

    Axes end = current_;
    for (std::size_t k = 0; k < 6; ++k) {
      const Word* word = axes ? find(kAxisLetters[k]) : nullptr;
      // No 0 is added: X-0.000 is printed with its sign.
      if (word != nullptr) end[k] = incremental_ ? current_[k] + word->value : word->value;
    }
    if (motion_ == 0) {
      call("STRAIGHT_TRAVERSE({})", list(end));
    } else if (motion_ == 1) {
      if (inverse_) print_inverse_feed(straight_length(end));
      call("STRAIGHT_FEED({})", list(end));
    } else {
      POLYPOD_TRY(arc(end));
    }
    current_ = canon_ = end;
    return {};
  }

  [[nodiscard]] double straight_length(const Axes& end) const {
    const double linear = std::hypot(end[0] - current_[0], end[1] - current_[1], end[2] - current_[2]);
    return linear > 0 ? linear : std::hypot(end[3] - current_[3], end[4] - current_[4], end[5] - current_[5]);
  }

  void print_inverse_feed(double length) {
    call("SET_FEED_RATE({:.4f})", std::max(kLeastInverseFeed, length * value('F')));
  }

  Status arc(const Axes& end) {
    const std::array<std::size_t, 3> order = plane_ == Plane::xy   ? std::array<std::size_t, 3>{0, 1, 2}
                                             : plane_ == Plane::zx ? std::array<std::size_t, 3>{2, 0, 1}
                                                                   : std::array<std::size_t, 3>{1, 2, 0};
    const auto [first, second, normal] = order;
    double c1 = 0;
    double c2 = 0;
    const double turn = motion_ == 2 ? -1 : 1;
    if (const Word* r = find('R'); r != nullptr) {
      const double dx = end[first] - current_[first];
      const double dy = end[second] - current_[second];
      const double half = std::hypot(dx, dy) / 2;
      const double radius = std::abs(r->value);
      // The signs of zeros come from these very functions, so they are used here instead of a square root.
      const double along = radius * std::cos(half >= radius ? std::numbers::pi / 2 : std::asin(half / radius));
      const double side = std::atan2(dy, dx) + (turn * r->value > 0 ? 1 : -1) * std::numbers::pi / 2;
      c1 = (current_[first] + end[first]) / 2 + along * std::cos(side);
      c2 = (current_[second] + end[second]) / 2 + along * std::sin(side);
    } else {
      constexpr std::string_view kOffsets = "IJK";
      c1 = arc_absolute_ ? value(kOffsets[first]) : current_[first] + value(kOffsets[first]);
      c2 = arc_absolute_ ? value(kOffsets[second]) : current_[second] + value(kOffsets[second]);
    }
    const double turns = value('P', 1);
    if (inverse_) {
      const double from = std::atan2(current_[second] - c2, current_[first] - c1);
      const double to = std::atan2(end[second] - c2, end[first] - c1);
      double sweep = turn * (to - from);
      if (sweep <= 0) sweep += 2 * std::numbers::pi;
      sweep += 2 * std::numbers::pi * (turns - 1);
      const double radius = std::hypot(current_[first] - c1, current_[second] - c2);
      print_inverse_feed(std::hypot(radius * sweep, end[normal] - current_[normal]));
    }
    call("ARC_FEED({:.4f}, {:.4f}, {:.4f}, {:.4f}, {}, {:.4f}, {:.4f}, {:.4f}, {:.4f})", end[first], end[second], c1,
         c2, static_cast<int>(turn * turns), end[normal], end[3], end[4], end[5]);
    return {};
  }

  void stop() {
    switch (one_of('M', 0, 10, 20, 300, 600)) {
      case 0:
        call("PROGRAM_STOP()");
        break;
      case 10:
        call("OPTIONAL_PROGRAM_STOP()");
        break;
      case 600:
        call("PALLET_SHUTTLE()");
        call("PROGRAM_STOP()");
        break;
      case 20:
      case 300:
        print_system(1, false);
        if (plane_ != Plane::xy) call("SELECT_PLANE(CANON_PLANE_XY)");
        call("SET_FEED_MODE(0, 0)");
        call("SET_FEED_RATE(0.0000)");
        if (!feed_override_) call("ENABLE_FEED_OVERRIDE()");
        call("STOP_SPINDLE_TURNING(0)");
        call("SET_SPINDLE_MODE(0 0.0000)");
        if (mist_) call("MIST_OFF()");
        if (flood_) call("FLOOD_OFF()");
        if (one_of('M', 300) >= 0) call("PALLET_SHUTTLE()");
        call("PROGRAM_END()");
        ends_ = true;
        break;
      default:
        break;
    }
  }

  const Program& program_;
  const CanonOptions& options_;
  std::vector<Tool> tools_;
  std::array<Axes, 9> systems_;  // program units
  Axes g92_;
  int active_ = 1;
  std::string out_;
  std::string number_;
  int calls_ = 0;

  const Block* block_ = nullptr;
  Axes current_{};       // where the interpreter is
  Axes canon_{};         // where the last move ended; a new tool length shows only in `current_`
  bool resync_ = false;  // after a tool change rs274 asks where it is, and forgets a new tool length
  Offset length_offset_{};
  Offset loaded_{};  // of the tool in the spindle, inches
  std::size_t selected_ = 0;
  int motion_ = -1;
  Plane plane_ = Plane::xy;
  bool inches_ = false;
  bool inverse_ = false;
  bool incremental_ = false;
  bool arc_absolute_ = false;
  bool mist_ = false;
  bool flood_ = false;
  bool feed_override_ = true;
  bool ends_ = false;
};

}  // namespace

Result<std::string> canonical_text(const Program& program, const CanonOptions& options) {
  InterpretOptions checks;
  checks.block_delete = options.block_delete;
  POLYPOD_ASSIGN(tools, read_tools(options.tool_table));
  POLYPOD_ASSIGN(parameters, read_parameters(options.parameters));
  for (std::size_t i = 0; i < checks.work_offsets.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      checks.work_offsets[i][static_cast<Eigen::Index>(k)] =
          units::from_inch(parameters.systems[i][k] + parameters.g92[k]);
    }
  }
  POLYPOD_TRY(interpret(program, checks));
  return Printer(program, options, std::move(tools), parameters).run();
}

}  // namespace polypod::gcode
