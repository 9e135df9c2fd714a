// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/gcode/writer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <limits>
#include <numbers>
#include <string_view>

#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "reader.hpp"
#include "text.hpp"

namespace polypod::gcode {
namespace {

constexpr int kMostDecimals = 12;
/// How far the start of an arc that keeps its text may be moved, m: far below any tolerance of arcs.
constexpr double kArcStartTolerance = 1e-9;
/// The largest F that `interpret` takes.
constexpr double kLargestFeed = 1e9;
/// LinuxCNC's largest line number.
constexpr double kLargestLineNumber = 99999;

bool is_blank(char c) {
  return c == ' ' || c == '\t';
}

std::string_view text_of(const Block& block, const Word& word) {
  return std::string_view(block.text)
      .substr(static_cast<std::size_t>(word.column) - 1, static_cast<std::size_t>(word.length));
}

bool is_motion_word(const Word& word) {
  return word.letter == 'G' && (word.value == 0 || word.value == 1 || word.value == 2 || word.value == 3);
}

/// The word before which a missing motion word goes: the first axis word, else (a full circle) the first centre word.
const Word* anchor_of(const Block& block) {
  const auto first = [&](std::string_view letters) -> const Word* {
    for (const Word& word : block.words) {
      if (letters.find(word.letter) != std::string_view::npos) return &word;
    }
    return nullptr;
  };
  const Word* axis = first("XYZABC");
  return axis != nullptr ? axis : first("IJKR");
}

bool is_axis(char letter) {
  return letter >= 'X' && letter <= 'Z';
}
bool is_rotary(char letter) {
  return letter >= 'A' && letter <= 'C';
}

/// Words that act when the move is done.
bool acts_at_end(const Word& word) {
  return word.letter == 'M' &&
         (word.value == 0 || word.value == 1 || word.value == 2 || word.value == 30 || word.value == 60);
}

int decimals_in(std::string_view text) {
  const std::size_t point = text.find('.');
  if (point == std::string_view::npos) return 0;
  return static_cast<int>(std::ranges::count_if(text.substr(point), [](char c) { return c >= '0' && c <= '9'; }));
}

double parsed(const std::string& number) {
  double value = 0;
  std::from_chars(number.data(), number.data() + number.size(), value);
  return value;
}

const Word* find(const Block& block, char letter) {
  const auto at = std::ranges::find(block.words, letter, &Word::letter);
  return at == block.words.end() ? nullptr : &*at;
}

/// How a block writes: blanks between words, lower case.
struct Style {
  explicit Style(const Block& block) {
    for (std::size_t i = 1; i < block.words.size(); ++i) {
      const auto before = static_cast<std::size_t>(block.words[i].column) - 2;
      if (is_blank(block.text[before])) blanks = true;
    }
    if (block.words.size() < 2) blanks = true;
    if (!block.words.empty()) {
      const char first = block.text[static_cast<std::size_t>(block.words.front().column) - 1];
      lower = first >= 'a' && first <= 'z';
    }
  }
  [[nodiscard]] char letter(char upper) const { return lower ? static_cast<char>(upper - 'A' + 'a') : upper; }
  void add(std::string& line, std::string_view word) const {
    if (blanks && !line.empty() && !is_blank(line.back()) && line.back() != '/') line += ' ';
    line += word;
  }

  bool blanks = false;
  bool lower = false;
};

/// Copies a block word by word; words can be replaced, dropped, or followed and preceded by others.
class Edit {
 public:
  explicit Edit(const Block& block) : block_(block), style_(block), at_(block.words.size()) {
    for (std::size_t i = 0; i < block.words.size(); ++i) at_[i] = std::string(text_of(block, block.words[i]));
  }
  void replace(const Word& word, std::string text) { at_[index(word)] = std::move(text); }
  void drop(const Word& word) { at_[index(word)].clear(); }
  void before(const Word& word, const std::string& text) {
    at_[index(word)] = text + (style_.blanks ? " " : "") + at_[index(word)];
  }
  void after(const Word& word, const std::string& text) { at_[index(word)] += (style_.blanks ? " " : "") + text; }

  /// The new line.
  [[nodiscard]] std::string line() const {
    std::string out;
    std::size_t from = 0;
    for (std::size_t i = 0; i < at_.size(); ++i) {
      const Word& word = block_.words[i];
      const auto column = static_cast<std::size_t>(word.column) - 1;
      out.append(block_.text, from, column - from);
      from = column + static_cast<std::size_t>(word.length);
      if (!at_[i].empty()) {
        out += at_[i];
      } else {
        while (!out.empty() && is_blank(out.back())) out.pop_back();
        if (out.empty()) {
          while (from < block_.text.size() && is_blank(block_.text[from])) ++from;
        }
      }
    }
    out.append(block_.text, from, std::string::npos);
    return out;
  }

 private:
  [[nodiscard]] std::size_t index(const Word& word) const {
    return static_cast<std::size_t>(&word - block_.words.data());
  }

  const Block& block_;
  Style style_;
  std::vector<std::string> at_;
};

class Rewriter {
 public:
  Rewriter(const Program& program, const Interpretation& interpretation,
           const std::function<bool(Replacement&)>& replacements, const RewriteOptions& options)
      : program_(program),
        interpretation_(interpretation),
        replacements_(replacements),
        options_(options),
        decimals_(decimals_of(program, options)),
        reader_(program.path) {}

  Result<Rewritten> run() {
    POLYPOD_TRY(check());
    POLYPOD_TRY(next_replacement());
    for (const Block& block : program_.blocks) {
      if (block.ending.ends_with('\n')) {
        ending_ = block.ending;
        break;
      }
    }
    next_number_.assign(program_.blocks.size(), -1);
    double following = -1;
    for (std::size_t i = program_.blocks.size(); i-- > 0;) {
      next_number_[i] = following;
      const Block block = program_.blocks[i];
      if (const Word* number = find(block, 'N'); number != nullptr) following = number->value;
    }
    std::size_t move = 0;
    for (std::size_t i = 0; i < program_.blocks.size(); ++i) {
      const Block& block = program_.blocks[i];
      index_ = static_cast<int>(i);
      const bool moves = move < interpretation_.moves.size() && interpretation_.moves[move].block == index_;
      if (!moves) {
        POLYPOD_TRY(emit(block, block.text));
        if (interpretation_.states[i].executed && changes_motion(block))
          written_motion_ = interpretation_.states[i].motion;
        continue;
      }
      if (replacement_.move == static_cast<int>(move)) {
        POLYPOD_TRY(replace(block, interpretation_.moves[move], replacement_.points));
        POLYPOD_TRY(next_replacement());
      } else {
        POLYPOD_TRY(keep(block, interpretation_.moves[move]));
      }
      ++move;
    }
    out_.program = reader_.take();
    return std::move(out_);
  }

 private:
  [[nodiscard]] tl::unexpected<Error> bad(std::string message) const {
    return fail("GC140", std::move(message), Place{program_.path, 0, 0}, "give replacements in the order of the moves");
  }
  Status check() const {
    if (interpretation_.states.size() == program_.blocks.size()) return {};
    return bad("the interpretation is not that of this program");
  }
  /// Into `replacement_`; after the last one its move is none.
  Status next_replacement() {
    const int last = replacement_.move;
    if (!replacements_(replacement_)) {
      replacement_.move = kNoMove;
      return {};
    }
    if (replacement_.move <= last || replacement_.move >= static_cast<int>(interpretation_.moves.size())) {
      return bad(fmt::format("a replacement of move {} after that of move {}; there are {} moves", replacement_.move,
                             last, interpretation_.moves.size()));
    }
    if (replacement_.points.empty()) {
      return bad(fmt::format("no point in the replacement of move {}", replacement_.move));
    }
    for (const PathPoint& point : replacement_.points) {
      if (!point.p.allFinite() || !point.axes.allFinite() || point.p.cwiseAbs().maxCoeff() > 1e4) {
        return bad(
            fmt::format("a point of the replacement of move {} is not finite, or beyond 10 km", replacement_.move));
      }
    }
    return {};
  }

  static bool changes_motion(const Block& block) {
    return std::ranges::any_of(block.words,
                               [](const Word& w) { return is_motion_word(w) || (w.letter == 'G' && w.value == 80); });
  }

  /// A line of the new program.
  Status put(std::string_view line, std::string_view ending) {
    line_ = line;
    line_ += ending;
    out_.source.push_back(index_);
    return reader_.add(line_);
  }
  Status emit(const Block& block, std::string_view line) {
    if (line == block.text) return put(line, block.ending);
    ++out_.blocks_changed;
    return put_changed(block, std::string(line), block.ending);
  }
  /// A line that was edited. Where it is longer than LinuxCNC reads, its comments go before it.
  Status put_changed(const Block& block, std::string line, std::string_view ending) {
    if (line.size() > kLongestLine) {
      const std::string_view between = block.ending.ends_with('\n') ? block.ending : std::string_view(ending_);
      for (const std::string_view comment : comments(block)) {
        const std::size_t at = line.rfind(comment);
        if (at == std::string::npos) continue;
        line.erase(at, comment.size());
        POLYPOD_TRY(put((block.optional ? "/" : "") + std::string(comment), between));
        ++out_.blocks_added;
      }
      while (!line.empty() && is_blank(line.back())) line.pop_back();
    }
    return put(line, ending);
  }

  [[nodiscard]] int decimals(const Move& move) const { return move.inches ? decimals_.inch : decimals_.mm; }
  [[nodiscard]] static double unit(const Move& move) { return move.inches ? units::kMetrePerInch : units::kMetrePerMm; }

  /// The number that brings an axis to `target`, and the place where it then is.
  struct Written {
    std::string number;
    double place = 0;
    bool moved = false;
  };
  [[nodiscard]] Written coordinate(const Move& move, int axis, double target) const {
    const double from = move.incremental
                            ? written_[axis]
                            : options_.interpret.work_offsets[static_cast<std::size_t>(move.work_offset)][axis];
    Written w;
    w.number = format_number((target - from) / unit(move), decimals(move));
    w.place = from + parsed(w.number) * unit(move);
    w.moved = std::abs(w.place - written_[axis]) > 0.25 * std::pow(10.0, -decimals(move)) * unit(move);
    return w;
  }

  /// A block that keeps its path.
  Status keep(const Block& block, const Move& move) {
    Edit edit(block);
    bool changed = false;
    if (move.kind == MoveKind::arc) {
      for (int k = 0; k < 3; ++k) {
        const bool normal = move.plane == Plane::xy ? k == 2 : move.plane == Plane::zx ? k == 1 : k == 0;
        if (normal || std::abs(written_[k] - move.start[k]) <= kArcStartTolerance) continue;
        return fail("GC141",
                    fmt::format("the start of this arc was moved by {:.4f} mm in {}, but the arc was not replaced",
                                units::to_mm(std::abs(written_[k] - move.start[k])), "XYZ"[k]),
                    Place{program_.path, block.line, 1}, "replace the arc as well");
      }
    }
    const int motion = interpretation_.states[static_cast<std::size_t>(index_)].motion;
    const Word* anchor = anchor_of(block);
    bool has_motion = false;
    for (const Word& word : block.words) {
      if (is_motion_word(word)) has_motion = true;
      if (is_rotary(word.letter)) {
        const int k = word.letter - 'A';
        written_axes_[k] = move.axes_end[k] + (move.incremental ? written_axes_[k] - move.axes_start[k] : 0);
      }
      if (!is_axis(word.letter)) continue;
      const int k = word.letter - 'X';
      const double step = move.end[k] - move.start[k];
      if (move.incremental &&
          std::abs(move.end[k] - written_[k] - step) > 0.5 * std::pow(10.0, -decimals(move)) * unit(move)) {
        const Written w = coordinate(move, k, move.end[k]);
        edit.replace(word, std::string(1, block.text[static_cast<std::size_t>(word.column) - 1]) + w.number);
        written_[k] = w.place;
        changed = true;
      } else {
        written_[k] = move.incremental ? written_[k] + step : move.end[k];
      }
    }
    if (!has_motion && motion != written_motion_ && anchor != nullptr) {
      edit.before(*anchor, fmt::format("{}{}", Style(block).letter('G'), motion));
      changed = true;
    }
    written_motion_ = motion;
    return changed ? emit(block, edit.line()) : emit(block, block.text);
  }

  /// A block with a new path.
  Status replace(const Block& block, const Move& move, const std::vector<PathPoint>& points) {
    const Style style(block);
    const int arc_motion = move.clockwise ? 2 : 3;
    const bool turns = std::ranges::any_of(block.words, [](const Word& w) { return is_rotary(w.letter); });

    // The axis words of every block that is needed, and the length of its piece.
    struct Piece {
      std::string words;
      double length = 0;
      int motion = 1;
    };
    std::vector<Piece> pieces;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const bool last = i + 1 == points.size();
      const bool only = last && pieces.empty();
      Piece piece;
      bool moved = false;
      Vec3 place = written_;
      for (int k = 0; k < 3; ++k) {
        const Written w = coordinate(move, k, points[i].p[k]);
        const bool named = pieces.empty() && find(block, "XYZ"[k]) != nullptr;
        if (!w.moved && !named) continue;
        moved = moved || w.moved;
        place[k] = w.place;
        style.add(piece.words, std::string(1, style.letter("XYZ"[k])) + w.number);
      }
      for (int k = 0; k < 3; ++k) {
        if (!turns || find(block, "ABC"[k]) == nullptr) continue;
        const double target = points[i].axes[k];
        const std::string number =
            format_number(units::to_deg(move.incremental ? target - written_axes_[k] : target), decimals_.degree);
        const double reached = units::from_deg(parsed(number)) + (move.incremental ? written_axes_[k] : 0);
        moved = moved || reached != written_axes_[k];
        written_axes_[k] = reached;
        style.add(piece.words, std::string(1, style.letter("ABC"[k])) + number);
      }
      if (!moved && !only) continue;
      if (piece.words.empty()) piece.words = style.letter('X') + coordinate(move, 0, points[i].p.x()).number;
      piece.length = (place - written_).norm();
      piece.motion = move.kind == MoveKind::rapid ? 0 : 1;
      if (points[i].centre && !same_in_plane(move, place)) {
        piece.motion = arc_motion;
        for (const int k : axes_in_plane(move.plane)) {
          style.add(piece.words, std::string(1, style.letter("IJK"[k])) + centre_number(move, k, *points[i].centre));
        }
        piece.length = arc_length(move, written_, place, *points[i].centre);
      }
      written_ = place;
      pieces.push_back(std::move(piece));
    }
    double total = 0;
    for (const Piece& piece : pieces) total += piece.length;
    const auto feed_word = [&](const Piece& piece) {
      const double source = find(block, 'F')->value;
      const double share = total > 0 ? std::max(piece.length / total, 1e-9) : 1 / static_cast<double>(pieces.size());
      const double value = std::min(source / share, kLargestFeed);
      const int figures = std::clamp(6 - static_cast<int>(std::floor(std::log10(value))), 1, kMostDecimals);
      return fmt::format("{}{}", style.letter('F'), format_number(value, figures));
    };
    const bool inverse = move.feed_mode == FeedMode::inverse && move.kind != MoveKind::rapid;
    const int motion = pieces.front().motion;

    // The first block: the old one with its words changed.
    Edit edit(block);
    const Word* motion_word = nullptr;
    const Word* anchor = anchor_of(block);
    const Word* number = nullptr;
    std::string at_end;
    const bool axes = anchor != nullptr && (is_axis(anchor->letter) || is_rotary(anchor->letter));
    for (const Word& word : block.words) {
      if (is_motion_word(word)) {
        motion_word = &word;
        if (word.value != motion) edit.replace(word, fmt::format("{}{}", style.letter('G'), motion));
      } else if (is_axis(word.letter) || is_rotary(word.letter) ||
                 (move.kind == MoveKind::arc &&
                  std::string_view("IJKRP").find(word.letter) != std::string_view::npos)) {
        edit.drop(word);
      } else if (acts_at_end(word) && pieces.size() > 1) {
        style.add(at_end, text_of(block, word));
        edit.drop(word);
      } else if (word.letter == 'F' && inverse) {
        edit.replace(word, feed_word(pieces.front()));
      } else if (word.letter == 'N') {
        number = &word;
      }
    }
    std::string words = pieces.front().words;
    if (motion_word == nullptr && written_motion_ != motion) {
      words = fmt::format("{}{}{}{}", style.letter('G'), motion, style.blanks ? " " : "", words);
    }
    if (anchor != nullptr && (axes || motion_word == nullptr)) {
      edit.replace(*anchor, std::move(words));
    } else {  // a full circle by its centre alone
      edit.after(*motion_word, words);
    }
    const std::string_view last_ending = block.ending;
    const bool several = pieces.size() > 1;
    const std::string_view between(last_ending.ends_with('\n') ? last_ending : std::string_view(ending_));
    const std::string first_line = edit.line();
    POLYPOD_TRY(put_changed(block, first_line, several ? between : last_ending));
    if (several || first_line != block.text) ++out_.blocks_changed;

    // The others.
    const double step = number != nullptr ? number_step(*number, pieces.size()) : 0;
    for (std::size_t i = 1; i < pieces.size(); ++i) {
      const bool last = i + 1 == pieces.size();
      std::string line = block.optional ? "/" : "";
      if (step > 0) {
        const std::string_view old = text_of(block, *number);
        const auto width =
            static_cast<std::size_t>(std::ranges::count_if(old, [](char c) { return c >= '0' && c <= '9'; }));
        std::string digits = format_number(number->value + step * static_cast<double>(i), 0);
        if (digits.size() < width) digits.insert(0, width - digits.size(), '0');
        style.add(line, std::string(1, style.letter('N')) + digits);
      }
      if (motion_word != nullptr || pieces[i].motion != pieces[i - 1].motion) {
        style.add(line, fmt::format("{}{}", style.letter('G'), pieces[i].motion));
      }
      style.add(line, pieces[i].words);
      if (inverse) style.add(line, feed_word(pieces[i]));
      if (last && !at_end.empty()) style.add(line, at_end);
      POLYPOD_TRY(put(line, last ? last_ending : between));
      ++out_.blocks_added;
    }
    written_motion_ = pieces.back().motion;
    return {};
  }

  static std::array<int, 2> axes_in_plane(Plane plane) {
    return plane == Plane::xy ? std::array{0, 1} : plane == Plane::zx ? std::array{0, 2} : std::array{1, 2};
  }

  /// Whether a place is that where the written program stands, in the plane of the arc: then G2 would be a full circle.
  [[nodiscard]] bool same_in_plane(const Move& move, const Vec3& place) const {
    const double grain = std::pow(10.0, -decimals(move)) * unit(move);
    const auto [a, b] = axes_in_plane(move.plane);
    return std::abs(place[a] - written_[a]) < 0.5 * grain && std::abs(place[b] - written_[b]) < 0.5 * grain;
  }

  /// The number of I, J or K: from where the written program stands, or under G90.1 from the origin.
  [[nodiscard]] std::string centre_number(const Move& move, int axis, const Vec3& centre) const {
    const double from = interpretation_.states[static_cast<std::size_t>(index_)].arc_absolute
                            ? options_.interpret.work_offsets[static_cast<std::size_t>(move.work_offset)][axis]
                            : written_[axis];
    return format_number((centre[axis] - from) / unit(move), decimals(move));
  }

  static double arc_length(const Move& move, const Vec3& from, const Vec3& to, const Vec3& centre) {
    Move arc = move;
    arc.start = from;
    arc.end = to;
    arc.centre = centre;
    const std::array<int, 2> axes = axes_in_plane(move.plane);
    const auto angle = [&](const Vec3& p) {
      return std::atan2(p[axes[1]] - centre[axes[1]], p[axes[0]] - centre[axes[0]]);
    };
    // (x, z) is the wrong way round for the ZX plane, whose normal is y.
    const bool positive = (move.plane == Plane::zx) == move.clockwise;
    const double turn = positive ? angle(to) - angle(from) : angle(from) - angle(to);
    arc.sweep = turn > 0 ? turn : turn + 2 * std::numbers::pi;
    return arc.length();
  }

  /// The step of the numbers of `count` blocks that begin with `number` and must stay below the next number; 0 for
  /// none.
  [[nodiscard]] double number_step(const Word& number, std::size_t count) const {
    if (number.value != std::floor(number.value) || number.value < 0) return 0;
    const auto wanted = static_cast<double>(count);
    const double next = next_number_[static_cast<std::size_t>(index_)];
    if (next >= 0) return next > number.value ? std::floor((next - number.value) / wanted) : 0;
    return number.value + wanted <= kLargestLineNumber ? 1 : 0;
  }

  const Program& program_;
  const Interpretation& interpretation_;
  const std::function<bool(Replacement&)>& replacements_;
  static constexpr int kNoMove = std::numeric_limits<int>::max();
  Replacement replacement_{-1, {}};  // the next one
  const RewriteOptions& options_;
  Decimals decimals_;
  Rewritten out_;
  LineReader reader_;
  std::string line_;
  std::string ending_ = "\n";
  LongVector<double> next_number_;  // the number of the next numbered block after each block; -1 for none
  int index_ = 0;
  Vec3 written_ = Vec3::Zero();       // where the written program stands, p_W, m
  Vec3 written_axes_ = Vec3::Zero();  // its A, B, C, rad
  int written_motion_ = -1;           // its modal motion word
};

}  // namespace

std::string format_number(double value, int decimals) {
  std::string text = fmt::format("{:.{}f}", value, decimals);
  if (text.front() == '-' && text.find_first_of("123456789") == std::string::npos) text.erase(0, 1);
  return text;
}

std::string number(double value, int decimals) {
  std::string text = format_number(value, decimals);
  if (text.find('.') == std::string::npos) return text;
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

Decimals decimals_of(const Program& program, const RewriteOptions& options) {
  int linear = 0;
  int rotary = 0;
  for (const Block& block : program.blocks) {
    for (const Word& word : block.words) {
      if (is_axis(word.letter)) linear = std::max(linear, decimals_in(text_of(block, word)));
      if (is_rotary(word.letter)) rotary = std::max(rotary, decimals_in(text_of(block, word)));
    }
  }
  linear = std::min(linear, kMostDecimals);
  rotary = std::min(rotary, kMostDecimals);
  return {std::max(linear, options.decimals_mm), std::max(linear, options.decimals_inch),
          std::max(rotary, options.decimals_degree)};
}

Result<Rewritten> rewrite(const Program& program, const Interpretation& interpretation,
                          std::span<const Replacement> replacements, const RewriteOptions& options) {
  std::size_t next = 0;
  const std::function<bool(Replacement&)> one = [&](Replacement& out) {
    if (next == replacements.size()) return false;
    out = replacements[next++];
    return true;
  };
  return Rewriter(program, interpretation, one, options).run();
}

Result<Rewritten> rewrite_each(const Program& program, const Interpretation& interpretation,
                               const std::function<bool(Replacement&)>& replacements, const RewriteOptions& options) {
  return Rewriter(program, interpretation, replacements, options).run();
}

std::string ensure_motion_word(const Block& block, int motion) {
  if (std::ranges::any_of(block.words, is_motion_word)) return std::string(block.text);
  const Word* anchor = anchor_of(block);
  if (anchor == nullptr) return std::string(block.text);
  Edit edit(block);
  edit.before(*anchor, fmt::format("{}{}", Style(block).letter('G'), motion));
  return edit.line();
}

std::string with_path_control(const Block& block, const std::string& words) {
  const auto is_control = [](const Word& w) {
    return w.letter == 'G' && (w.value == 61 || w.value == 61.1 || w.value == 64);
  };
  const auto control = std::ranges::find_if(block.words, is_control);
  if (control == block.words.end()) return std::string(block.text);
  const bool lower = Style(block).lower;
  std::string text = words;
  if (lower)
    std::ranges::transform(text, text.begin(),
                           [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  Edit edit(block);
  edit.replace(*control, text);
  if (control->value == 64) {
    for (const Word& word : block.words) {
      if (word.letter == 'P' || word.letter == 'Q') edit.drop(word);
    }
  }
  return edit.line();
}

std::string comment_text(const std::string& line, bool semicolon) {
  constexpr std::size_t kLongest = 240;
  std::string text = one_line(line);
  for (char& c : text) {
    const std::size_t at = std::string_view(semicolon ? "%" : "%();").find(c);
    if (at != std::string_view::npos) c = "_[],"[at];
  }
  if (text.size() <= kLongest) return text;
  std::size_t end = kLongest;
  while ((static_cast<unsigned char>(text[end]) & 0xc0) == 0x80) --end;  // a whole character of UTF-8
  return text.substr(0, end) + " ...";
}

Program with_header(const Program& program, std::span<const std::string> lines, const std::string& code) {
  Program result;
  result.path = program.path;
  std::size_t at = 0;
  while (at < program.blocks.size()) {
    const Block& block = program.blocks[at];
    const bool leads = (block.percent && at == 0) || (block.construct == Construct::none && !block.words.empty() &&
                                                      block.words.front().letter == 'O' && block.words.size() == 1);
    if (!leads) break;
    ++at;
  }
  std::string ending = "\n";
  bool semicolon = false;
  for (const Block& block : program.blocks) {
    if (block.ending.ends_with('\n')) ending = block.ending;
    const auto found = block.after_end ? std::vector<std::string_view>{} : comments(block);
    if (!found.empty()) {
      semicolon = found.front().front() == ';';
      break;
    }
  }
  const auto put = [&](Block block) {
    block.line = static_cast<int>(result.blocks.size()) + 1;
    result.blocks.push_back(block);
  };
  for (std::size_t i = 0; i < at; ++i) {
    Block block = program.blocks[i];
    if (i + 1 == at && !block.ending.ends_with('\n')) block.ending = ending;
    put(block);
  }
  for (const std::string& line : lines) {
    const std::string text = comment_text(line, semicolon);
    const std::string remark = semicolon ? "; " + text : "(" + text + ")";
    Block comment;
    comment.text = remark;
    comment.ending = ending;
    put(comment);
  }
  if (!code.empty()) {
    if (auto parsed_block = parse(code + ending, ""); parsed_block && !parsed_block->blocks.empty()) {
      put(parsed_block->blocks.front());
    }
  }
  for (std::size_t i = at; i < program.blocks.size(); ++i) put(program.blocks[i]);
  return result;
}

}  // namespace polypod::gcode
