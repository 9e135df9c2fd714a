// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/gcode/interpreter.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numbers>
#include <string_view>

#include "m_codes.hpp"
#include "polypod/core/units.hpp"
#include "refusals.hpp"
#include "text.hpp"

namespace polypod::gcode {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
/// Coordinates beyond this are refused, m: no machine is 10 km long, and sums of squares stay finite.
constexpr double kLargestCoordinate = 1e4;
/// LinuxCNC's tolerances of arcs, found by bisection with rs274: an arc is refused when its radii at start and end
/// differ by more than an absolute tolerance (which depends on the unit) and by more than kSpiralShare of the larger
/// one.
constexpr double kSpiralMm = 0.02 * std::numbers::sqrt2 * units::kMetrePerMm;
constexpr double kSpiralInch = 0.002 * std::numbers::sqrt2 * units::kMetrePerInch;
constexpr double kSpiralShare = 1e-3;
/// Circles of a smaller radius are no circles, m.
constexpr double kLeastRadius = 1.27e-6;
/// By how much half the chord of an R arc may exceed R, m (rounded numbers of half circles).
constexpr double kRadiusTolerance = 1.27e-6;
/// Directions to start and end that are closer than this, rad, make a full turn.
constexpr double kFullTurnAngle = 1e-6;
constexpr double kMostTurns = 1e6;
/// The range of F, in its own unit: what lies outside is no feed but a slip.
constexpr double kLeastFeed = 1e-9;
constexpr double kLargestFeed = 1e9;

std::array<int, 3> axes_of(Plane plane) {
  switch (plane) {
    case Plane::zx:
      return {2, 0, 1};
    case Plane::yz:
      return {1, 2, 0};
    case Plane::xy:
      break;
  }
  return {0, 1, 2};
}

std::string_view name_of(Plane plane) {
  switch (plane) {
    case Plane::zx:
      return "G18 (ZX)";
    case Plane::yz:
      return "G19 (YZ)";
    case Plane::xy:
      break;
  }
  return "G17 (XY)";
}

/// The code of a G or M word, times ten: 21 for G2.1; -1 where the number is no code.
int code_of(const Word& word) {
  const double rounded = std::round(word.value * 10);
  if (rounded / 10 != word.value || rounded < 0 || rounded > 99999) return -1;
  return static_cast<int>(rounded);
}

/// Modal groups of G words: at most one word of each may stand in a block.
enum class Group : std::uint8_t {
  once,
  motion,
  plane,
  distance,
  arc_distance,
  feed_mode,
  units,
  cutter,
  length_offset,
  retract,
  work_offset,
  path,
  spindle_mode,
  cancel,
  machine,
  unknown
};

constexpr Refusal kCutter{"GC121", "cutter radius compensation is not supported",
                          "post the program with the path of the cutter's centre"};
constexpr Refusal kCycle{"GC122", "canned cycles are not supported",
                         "post the program with cycles expanded into G0 and G1"};
constexpr Refusal kFlow{"GC123", "subprograms and flow control are not supported", "post the program as plain blocks"};
constexpr Refusal kFrame{"GC125", "it moves, scales, turns or mirrors the coordinate system, which is not supported",
                         "use G54 to G59 with the offsets of the job"};
constexpr Refusal kMachine{"GC126", "it goes to a position of the machine that the program does not hold",
                           "use G0 in workpiece coordinates"};
constexpr Refusal kSpline{"GC127", "splines are not supported", "post the program with lines and arcs"};
constexpr Refusal kPolar{"GC125", "polar coordinates are not supported", "post the program with X, Y and Z"};

Group group_of(int g) {
  switch (g) {
    case 40:
      return Group::once;  // G4
    case 0:
    case 10:
    case 20:
    case 30:
    case 800:
      return Group::motion;
    case 170:
    case 180:
    case 190:
      return Group::plane;
    case 200:
    case 210:
      return Group::units;
    case 400:
      return Group::cutter;
    case 430:
    case 431:
    case 490:
      return Group::length_offset;
    case 540:
    case 550:
    case 560:
    case 570:
    case 580:
    case 590:
      return Group::work_offset;
    case 610:
    case 611:
    case 640:
      return Group::path;
    case 900:
    case 910:
      return Group::distance;
    case 901:
    case 911:
      return Group::arc_distance;
    case 930:
    case 940:
      return Group::feed_mode;
    case 970:
      return Group::spindle_mode;
    case 980:
    case 990:
      return Group::retract;
    case 921:
    case 922:
      return Group::cancel;
    case 280:
    case 300:
    case 530:
      return Group::machine;
    default:
      return Group::unknown;
  }
}

/// Why a G word that unrolling takes, or that changes motion on other controllers, is refused; an empty id for others.
Refusal refusal_of_plain(int g) {
  switch (g) {
    case 410:
    case 411:
    case 420:
    case 421:
      return kCutter;
    case 730:
    case 740:
    case 810:
    case 820:
    case 830:
    case 840:
    case 850:
    case 860:
    case 870:
    case 880:
    case 890:
    case 831:
    case 841:
    case 842:
    case 843:
      return kCycle;
    case 100:
    case 520:
    case 920:
    case 923:
    case 591:
    case 592:
    case 593:
      return kFrame;
    case 270:
    case 281:
    case 290:
    case 301:
    case 531:
      return kMachine;
    case 50:
    case 51:
    case 52:
    case 53:
      return kSpline;
    default:
      return {};
  }
}

constexpr std::uint32_t bit(char letter) {
  return 1u << (letter - 'A');
}
constexpr std::uint32_t bits(std::string_view letters) {
  std::uint32_t mask = 0;
  for (const char c : letters) mask |= bit(c);
  return mask;
}

class Interpreter {
 public:
  /// `keep`: whether moves, states and what is passed through are kept.
  Interpreter(const Program& program, const InterpretOptions& options, bool keep)
      : program_(program), options_(options), keep_(keep) {}

  Result<Interpretation> run() {
    for (const Vec3& offset : options_.work_offsets) {
      if (!offset.allFinite() || offset.cwiseAbs().maxCoeff() > kLargestCoordinate) {
        return fail("GC135", "a work offset is not finite, or beyond 10 km", Place{program_.path, 0, 0},
                    "check the job's offsets");
      }
    }
    for (std::size_t i = 0; i < program_.blocks.size(); ++i) {
      here_ = program_.blocks[i];
      index_ = static_cast<int>(i);
      bool executed = false;
      if (!out_.ended && !block_->after_end) {
        if (block_->percent) {
          if (percent_) out_.ended = true;
          percent_ = true;
        } else if (!(block_->optional && options_.block_delete)) {
          POLYPOD_TRY(block());
          executed = true;
        }
      }
      ModalState state = modal_;
      state.executed = executed;
      if (keep_) out_.states.push_back(state);
    }
    if (!out_.ended && percent_) {
      const int last = program_.blocks.back().line;
      return fail("GC133", "the program begins with '%' but has no closing '%', M2 or M30; it may be cut off",
                  Place{program_.path, last, 1}, "restore the end of the file, or remove the first '%'");
    }
    if (!out_.ended) out_.notes.emplace_back("no M2, M30 or closing %: the program may be cut off");
    return std::move(out_);
  }

 private:
  using Words = std::array<const Word*, 26>;

  [[nodiscard]] tl::unexpected<Error> error(const Word& word, std::string_view id, std::string message,
                                            std::string_view hint) const {
    return fail(std::string(id), std::move(message), Place{program_.path, block_->line, word.column},
                std::string(hint));
  }
  [[nodiscard]] std::string text_of(const Word& word) const {
    return std::string(
        block_->text.substr(static_cast<std::size_t>(word.column) - 1, static_cast<std::size_t>(word.length)));
  }
  [[nodiscard]] const Word* find(char letter) const { return words_[static_cast<std::size_t>(letter - 'A')]; }
  [[nodiscard]] bool has(char letter) const { return find(letter) != nullptr; }
  [[nodiscard]] bool has_g(int code) const {
    return std::any_of(g_.begin(), g_.begin() + g_count_, [&](const Code& c) { return c.tenfold == code; });
  }
  [[nodiscard]] const Word* g_word(Group group) const { return g_groups_[static_cast<std::size_t>(group)].word; }
  [[nodiscard]] int g_code(Group group) const { return g_groups_[static_cast<std::size_t>(group)].tenfold; }
  void pass(const Word& word) {
    if (keep_) out_.passed_through.push_back({index_, word.column, word.length});
  }

  Status block() {
    if (block_->text.size() > kLongestLine) {
      return fail("GC108", "a line of more than 252 characters, which LinuxCNC refuses",
                  {program_.path, block_->line, static_cast<int>(kLongestLine) + 1}, "split the block");
    }
    if (keep_ && block_->text.find_first_of("(;") != std::string_view::npos) {
      for (const std::string_view comment : comments(*block_)) {
        const auto column = static_cast<int>(comment.data() - block_->text.data()) + 1;
        out_.passed_through.push_back({index_, column, static_cast<int>(comment.size())});
        waits_ = waits_ || is_message(comment);
      }
    }
    if (block_->construct != Construct::none) return refuse_construct();
    if (block_->words.empty()) return {};
    POLYPOD_TRY(sort_words());
    POLYPOD_TRY(check_words());
    POLYPOD_TRY(feed_and_spindle());
    POLYPOD_TRY(tool_and_switches());
    POLYPOD_TRY(settings());
    waits_ = waits_ || has('S') || has_g(40) || g_word(Group::length_offset) != nullptr || any_m(waits_for_m);
    POLYPOD_TRY(motion());
    waits_ = waits_ || any_m([](int m) { return m == 0 || m == 1 || m == 60; });
    out_.ended = out_.ended || any_m([](int m) { return m == 2 || m == 30; });
    return {};
  }

  template <class F>
  [[nodiscard]] bool any_m(F&& is) const {
    return std::any_of(m_.begin(), m_.begin() + m_count_, [&](const Code& code) { return is(code.tenfold / 10); });
  }
  /// Before the motion of its block.
  static bool waits_for_m(int m) {
    return (m >= 3 && m <= 9) || m == 19 || m == 61 || (m >= 64 && m <= 66) || m == 68 || (m >= 100 && m <= 199);
  }
  static bool is_message(std::string_view comment) {
    if (comment.empty() || comment.front() != '(') return false;
    const std::string_view text = from_first_word(comment.substr(1));
    return begins_with(text, "MSG,") || begins_with(text, "DEBUG,");
  }

  tl::unexpected<Error> refuse_construct() const {
    const Place place{program_.path, block_->line, block_->construct_column};
    switch (block_->construct) {
      case Construct::o_word:
        return fail("GC123", "O-words (subprograms, loops, conditions) are no plain blocks", place,
                    "unroll the program first, or post it as plain blocks");
      case Construct::parameter:
        return fail("GC124", "a parameter (#) is no plain number", place,
                    "unroll the program first, or post it with plain numbers");
      default:
        return fail("GC124", "an expression ([...]) is no plain number", place,
                    "unroll the program first, or post it with plain numbers");
    }
  }

  struct Code {
    int tenfold = -1;
    const Word* word = nullptr;
  };

  /// Sorts the words by letter and by modal group; refuses what is unknown, repeated or in conflict.
  Status sort_words() {
    words_.fill(nullptr);
    g_groups_.fill({});
    std::array<const Word*, 12> m_groups{};
    g_count_ = 0;
    m_count_ = 0;
    for (const Word& word : block_->words) {
      switch (word.letter) {
        case 'G':
          POLYPOD_TRY(sort_g(word));
          break;
        case 'M': {
          const int m = code_of(word);
          if (m < 0 || m % 10 != 0 || m > 9990) {
            return error(word, "GC132",
                         fmt::format("{} is no M code; M codes are integers from 0 to 999", text_of(word)),
                         "check the word");
          }
          if (m == 980 || m == 990 || m == 970) return refuse(word, kFlow);
          if (m == 720) {
            return error(word, "GC123", "M72 restores modes that were saved", "unroll the program first");
          }
          if (const auto r = refusal_of_m(m / 10, options_.m_codes)) return error(word, r->id, r->why, r->hint);
          const int group = m_group_of(m / 10);
          const Word*& slot = m_groups[static_cast<std::size_t>(group)];
          if (group != 0 && slot != nullptr) {
            return error(word, "GC109", excluding(text_of(*slot), text_of(word)), "use two blocks");
          }
          slot = &word;
          if (m_count_ == kMostMWords) {
            return error(word, "GC108", "more than four M words in one block", "use two blocks");
          }
          m_[static_cast<std::size_t>(m_count_++)] = {m, &word};
          break;
        }
        case '@':
        case '^':
          return refuse(word, kPolar);
        default: {
          const Word*& slot = words_[static_cast<std::size_t>(word.letter - 'A')];
          if (slot != nullptr) {
            return error(word, "GC108", fmt::format("a second {} word in one block", word.letter),
                         "remove one of them");
          }
          slot = &word;
        }
      }
    }
    return {};
  }

  Status sort_g(const Word& word) {
    const int g = code_of(word);
    if (g < 0) {
      return error(word, "GC132", fmt::format("{} is no G code; a G code has at most one decimal", text_of(word)),
                   "check the word");
    }
    const Group group = group_of(g);
    if (group == Group::unknown) {
      const Refusal unrolled = refusal_of_plain(g);
      return refuse(word, unrolled.id.empty() ? refusal_of(g) : unrolled);
    }
    Code& slot = g_groups_[static_cast<std::size_t>(group)];
    // As in LinuxCNC, a G80 beside one other motion word does nothing: `G0 G17 G40 G49 G80 G90` begins half of all
    // posts.
    const bool idle = group == Group::motion && slot.word != nullptr && (g == 800) != (slot.tenfold == 800);
    if (slot.word != nullptr && !idle) {
      return error(word, "GC109", excluding(text_of(*slot.word), text_of(word)), "use two blocks");
    }
    if (!idle || g != 800) slot = {g, &word};
    if (g_count_ == static_cast<int>(g_.size()))
      return error(word, "GC108", "too many G words in one block", "use two blocks");
    g_[static_cast<std::size_t>(g_count_++)] = {g, &word};
    return {};
  }

  tl::unexpected<Error> refuse(const Word& word, const Refusal& refusal) const {
    return error(word, refusal.id, fmt::format("{}: {}", text_of(word), refusal.why), refusal.hint);
  }

  /// Every word must have a use in its block, and a value in its range.
  Status check_words() {
    if (const auto wrong = wrong_argument(*block_))
      return error(*wrong->word, "GC132", wrong->what, "see the M word in LinuxCNC's reference");
    const Word* motion_word = g_word(Group::motion);
    motion_code_ = motion_word != nullptr ? g_code(Group::motion) : -1;
    axis_words_ = has('X') || has('Y') || has('Z') || has('A') || has('B') || has('C');
    // What this block does: the motion it names or, with axis words, the one in force.
    int acting = motion_word != nullptr ? motion_code_ / 10 : -1;
    const bool centre_words = has('I') || has('J') || has('K');  // R alone is none, as in LinuxCNC
    if (motion_word == nullptr && (axis_words_ || (centre_words && modal_.motion >= 2))) {
      acting = modal_.motion;
    }
    if (const Word* offset = g_word(Group::length_offset); offset != nullptr && has_g(431)) {
      if (motion_word != nullptr && motion_code_ != 800) {
        return error(*offset, "GC134", fmt::format("{} beside a motion word", text_of(*offset)), "use two blocks");
      }
      axis_words_ = false;  // they are the offset
      acting = -1;
    }
    acting_ = acting == 80 ? -1 : acting;
    to_machine_ = false;
    if (const Word* word = g_word(Group::machine); word != nullptr) POLYPOD_TRY(machine_place(*word));

    std::uint32_t used = bits("XYZABCFSTNO");
    std::uint32_t shared = 0;  // letters that two words of this block could claim
    const auto use = [&](std::string_view letters) {
      shared |= used & bits(letters);
      used |= bits(letters);
    };
    if (acting_ >= 2) use("IJKRP");
    if (has_g(40)) use("P");
    if (has_g(640)) use("PQ");
    if (has_g(430)) use("H");
    for (int i = 0; i < m_count_; ++i) {
      use(arguments_of_m(m_[static_cast<std::size_t>(i)].tenfold / 10));
    }
    for (char letter = 'A'; letter <= 'Z'; ++letter) {
      const Word* word = find(letter);
      if (word == nullptr) continue;
      if ((shared & bit(letter)) != 0) {
        return error(*word, "GC119", fmt::format("{} could belong to several words of this block", text_of(*word)),
                     "use two blocks");
      }
      if ((used & bit(letter)) != 0) continue;
      if (letter == 'U' || letter == 'V' || letter == 'W') {
        return error(*word, "GC130", fmt::format("{}: the axes U, V and W are not supported", text_of(*word)),
                     "post the program for X, Y, Z and A, B, C");
      }
      return error(*word, "GC119", fmt::format("{} has no use in this block", text_of(*word)),
                   "remove it, or add the G or M word that it belongs to");
    }
    if (const Word* dwell = g_word(Group::once); has_g(40) && axis_words_) {
      return error(*dwell, "GC134", fmt::format("{} with axis words: some controls wait, others move", text_of(*dwell)),
                   "give the time with P, and the motion in a block of its own");
    }
    if (has_g(40)) {
      const Word* p = find('P');
      if (p == nullptr) {
        return error(*g_word(Group::once), "GC134", "G4 without a P of its own; a dwell needs its time",
                     "write G4 P...");
      }
      if (p->value < 0)
        return error(*p, "GC134", fmt::format("G4 with the negative time {}", text_of(*p)), "use P >= 0");
    }
    if (axis_words_ && acting_ < 0 && !to_machine_) {
      const char letter = has('X') ? 'X' : has('Y') ? 'Y' : has('Z') ? 'Z' : has('A') ? 'A' : has('B') ? 'B' : 'C';
      const Word& word = *find(letter);
      return error(word, "GC110", fmt::format("{} without a motion mode in force", text_of(word)),
                   "add G0, G1, G2 or G3");
    }
    for (const char letter : {'X', 'Y', 'Z', 'I', 'J', 'K', 'R', 'A', 'B', 'C'}) {
      const Word* word = find(letter);
      if (word != nullptr && std::abs(word->value) > 1e7) {
        return error(*word, "GC135", fmt::format("{} is beyond every machine (10 km)", text_of(*word)),
                     "check the number");
      }
    }
    return {};
  }

  /// G53, G28 and G30 lead to places of the machine, which no program tells: the axes are not known after them.
  /// `unroll` has written the way to the point in between as a move of its own.
  Status machine_place(const Word& word) {
    to_machine_ = true;
    if (has_g(530)) {
      if (acting_ == 0 || acting_ == 1) return {};
      return error(word, "GC168", "G53 without G0 or G1", "write G53 G0 X...");
    }
    bool steps = modal_.incremental || has_g(910);
    for (const char c : std::string_view("XYZABC")) steps = steps && (!has(c) || find(c)->value == 0);
    if (axis_words_ && (!steps || g_word(Group::motion) != nullptr)) return refuse(word, kMachine);
    if (g_word(Group::motion) != nullptr) return refuse(word, kMachine);
    acting_ = -1;
    return {};
  }

  void forget_places() {
    for (std::size_t k = 0; k < 3; ++k) {
      if (!axis_words_ || has("XYZ"[k])) known_[k] = false;
    }
    if (noted_machine_) return;
    noted_machine_ = true;
    note(
        fmt::format("line {}: {} goes to a place of the machine that the program does not tell: it is not judged, and "
                    "the axes are not known until they are commanded",
                    block_->line, text_of(*g_word(Group::machine))));
  }

  Status feed_and_spindle() {
    if (const int mode = g_code(Group::feed_mode); mode >= 0) {
      const FeedMode next = mode == 930 ? FeedMode::inverse : FeedMode::per_minute;
      feed_ = 0;  // as in LinuxCNC, also where G94 was in force before
      modal_.feed_mode = next;
    }
    const Word* f = find('F');
    if (f != nullptr) {
      if (f->value < 0)
        return error(*f, "GC111", fmt::format("{} is negative; a feed is positive", text_of(*f)), "use F > 0");
      if (f->value != 0 && !(f->value >= kLeastFeed && f->value <= kLargestFeed)) {
        return error(*f, "GC111", fmt::format("{} is beyond every machine", text_of(*f)), "check the number");
      }
      const int units = g_code(Group::units);
      const bool inches = units >= 0 ? units == 200 : modal_.inches;
      if (inches != modal_.inches && units_known_) {
        return error(
            *f, "GC131",
            fmt::format(
                "{} in the block that changes the unit: some controls read it in the old unit, others in the new one",
                text_of(*f)),
            "put F into the next block");
      }
      if (inches != modal_.inches) {
        note(fmt::format("line {}: {} is read in inches, the unit that its block sets", block_->line, text_of(*f)));
      }
      if (modal_.feed_mode == FeedMode::per_minute) {
        feed_ = inches ? units::from_inch(f->value) / 60 : units::from_mm_per_min(f->value);
      }
    }
    if (const Word* s = find('S'); s != nullptr) {
      if (s->value < 0 || s->value > 1e9) {
        return error(*s, "GC132", fmt::format("{} is no spindle speed; S >= 0 in rev/min", text_of(*s)),
                     "check the number");
      }
      spindle_speed_ = units::from_per_min(s->value);
    }
    return {};
  }

  Status tool_and_switches() {
    if (const Word* t = find('T'); t != nullptr) {
      if (t->value < 0 || t->value > 1e9 || t->value != std::floor(t->value)) {
        return error(*t, "GC132", fmt::format("{} is no tool; tool numbers are integers from 0", text_of(*t)),
                     "check the number");
      }
      selected_tool_ = static_cast<int>(t->value);
    }
    // The tool is changed before the spindle is started, and the change stops it.
    if (std::any_of(m_.begin(), m_.begin() + m_count_, [](const Code& c) { return c.tenfold == 60; }))
      spindle_ = Spindle::off;
    for (int i = 0; i < m_count_; ++i) {
      const Code& code = m_[static_cast<std::size_t>(i)];
      const int m = code.tenfold / 10;
      pass(*code.word);
      switch (m) {
        case 6:
          if (selected_tool_ >= 0) tool_ = selected_tool_;
          break;
        case 61: {
          const Word* q = find('Q');
          if (q == nullptr || q->value < 0 || q->value > 1e9 || q->value != std::floor(q->value)) {
            return error(q != nullptr ? *q : *code.word, "GC132", "M61 needs Q with a tool number", "write M61 Q...");
          }
          tool_ = static_cast<int>(q->value);
          break;
        }
        case 3:
          spindle_ = Spindle::clockwise;
          break;
        case 4:
          spindle_ = Spindle::counterclockwise;
          break;
        case 5:
        case 19:
          spindle_ = Spindle::off;
          break;
        default:
          if (is_own_m(m)) break;
          if (const auto meaning = options_.m_codes.find(m); meaning != options_.m_codes.end()) {
            if (meaning->second == MCode::tip) joints_ = {};
            if (meaning->second == MCode::joints) joints_ = {m, block_->line};
            break;
          }
          if (std::find(noted_m_.begin(), noted_m_.end(), m) == noted_m_.end()) {
            noted_m_.push_back(m);
            note(fmt::format("line {}: M{} belongs to the machine's builder; Polypod takes it to move nothing",
                             block_->line, m));
          }
      }
    }
    return {};
  }

  Status settings() {
    for (int i = 0; i < g_count_; ++i) {
      const Code& code = g_[static_cast<std::size_t>(i)];
      switch (group_of(code.tenfold)) {
        case Group::once:
        case Group::cutter:
        case Group::retract:
        case Group::path:
        case Group::spindle_mode:
        case Group::cancel:
        case Group::length_offset:
          pass(*code.word);
          break;
        default:
          if (code.tenfold == 800) pass(*code.word);
      }
    }
    if (has('O')) pass(*find('O'));
    if (const int g = g_code(Group::plane); g >= 0) {
      modal_.plane = g == 170 ? Plane::xy : g == 180 ? Plane::zx : Plane::yz;
    }
    if (const int g = g_code(Group::units); g >= 0) {
      modal_.inches = g == 200;
      units_known_ = true;
    }
    if (const int g = g_code(Group::path); g >= 0) path_ = path_control(g);
    if (const int g = g_code(Group::length_offset); g >= 0) POLYPOD_TRY(length_offset(g));
    if (const int g = g_code(Group::work_offset); g >= 0) modal_.work_offset = static_cast<std::uint8_t>(g / 10 - 54);
    if (const int g = g_code(Group::distance); g >= 0) {
      modal_.incremental = g == 910;
      distance_known_ = true;
    }
    if (const int g = g_code(Group::arc_distance); g >= 0) modal_.arc_absolute = g == 901;
    return {};
  }

  /// G61, G61.1, G64 [P] [Q]. Called after the unit of the block is set: P and Q are lengths in it.
  [[nodiscard]] PathControl path_control(int g) const {
    if (g == 610) return {PathMode::exact_path, 0, 0};
    if (g == 611) return {PathMode::exact_stop, 0, 0};
    const auto tolerance = [&](char letter, float otherwise) {
      const Word* word = find(letter);
      return word == nullptr || word->value < 0 ? otherwise : static_cast<float>(metres(word->value));
    };
    const float p = tolerance('P', 0);
    return {PathMode::continuous, p, tolerance('Q', p)};
  }

  Status length_offset(int g) {
    int next = 0;  // which offset is in force: 0 none, else 1 + H, or -1 where it cannot be told
    if (g == 430) {
      const Word* h = find('H');
      if (h != nullptr && (h->value < 0 || h->value > 1e9 || h->value != std::floor(h->value))) {
        return error(*h, "GC132", fmt::format("{} is no offset; H is an integer from 0", text_of(*h)),
                     "check the number");
      }
      next = h != nullptr ? 1 + static_cast<int>(h->value) : 1 + tool_;
    } else if (g == 431) {
      next = -1;
    }
    if (next == -1 || length_offset_ == -1) {
      known_.fill(false);
    } else if (next != length_offset_) {
      known_[2] = false;
    }
    length_offset_ = next;
    if (g != 490 && !noted_length_) {
      noted_length_ = true;
      note(fmt::format("line {}: {} {}", block_->line, text_of(*g_word(Group::length_offset)), kLengthNote));
    }
    return {};
  }

  void note(std::string text) { out_.notes.push_back(std::move(text)); }

  [[nodiscard]] double metres(double value) const {
    return modal_.inches ? units::from_inch(value) : units::from_mm(value);
  }

  Status motion() {
    if (motion_code_ >= 0) modal_.motion = static_cast<std::int16_t>(motion_code_ == 800 ? -1 : motion_code_ / 10);
    if (to_machine_ && acting_ <= 0) {
      pass(*g_word(Group::machine));
      forget_places();
      return {};
    }
    if (acting_ < 0) return {};
    const Word* named = g_word(Group::motion);
    const Word& culprit = named != nullptr ? *named : *std::ranges::find_if(block_->words, [](const Word& word) {
      return std::string_view("XYZABCIJKR").find(word.letter) != std::string_view::npos;
    });

    if (acting_ > 0) {
      if (modal_.feed_mode == FeedMode::inverse) {
        const Word* f = find('F');
        if (f == nullptr) {
          return error(culprit, "GC112", fmt::format("G{} in inverse time mode (G93) without F", acting_),
                       "every feed block needs its own F under G93");
        }
        if (!(f->value > 0)) return error(*f, "GC111", "F0 under G93; a feed is positive", "use F > 0");
      } else if (!(feed_ > 0)) {
        if (const Word* f = find('F'); f != nullptr) {
          return error(*f, "GC111", fmt::format("{} for a feed move; a feed is positive", text_of(*f)), "use F > 0");
        }
        return error(culprit, "GC111", fmt::format("G{} without a feed; a feed move needs F > 0", acting_),
                     "add F; a G94 forgets the feed before it");
      }
    }
    if (to_machine_) {
      pass(*g_word(Group::machine));
      forget_places();
      return {};
    }
    if (!axis_words_ && acting_ < 2) return {};  // only the mode changes
    if (joints_.m != 0) {
      return error(
          culprit, "GC120",
          fmt::format("a move in joints: M{} in line {} switched the controller's kinematics", joints_.m, joints_.line),
          "switch back before it, with an M code that the job gives as \"tip\"; G53, G28 and G30 may stand "
          "between");
    }

    Move move;
    move.kind = acting_ == 0 ? MoveKind::rapid : acting_ == 1 ? MoveKind::line : MoveKind::arc;
    move.plane = modal_.plane;
    move.feed_mode = modal_.feed_mode;
    move.spindle = spindle_;
    move.inches = modal_.inches;
    move.incremental = modal_.incremental;
    move.block = index_;
    move.tool = tool_;
    move.path = path_;
    move.work_offset = modal_.work_offset;
    move.start = position_;
    move.start_known = known_[0] && known_[1] && known_[2];
    move.known_start = known_;
    move.axes_start = axes_;
    move.spindle_speed = spindle_speed_;
    if (!units_known_) {
      units_known_ = true;
      note(fmt::format("line {}: motion before G20 or G21: mm are taken", block_->line));
    }
    if (!distance_known_) {
      distance_known_ = true;
      note(fmt::format("line {}: motion before G90 or G91: absolute coordinates (G90) are taken", block_->line));
    }

    const Vec3& offset = options_.work_offsets[modal_.work_offset];
    move.end = position_;
    move.axes_end = axes_;
    for (int k = 0; k < 3; ++k) {
      if (const Word* word = find("XYZ"[k]); word != nullptr) {
        move.end[k] = metres(word->value) + (modal_.incremental ? position_[k] : offset[k]);
        if (!modal_.incremental) known_[static_cast<std::size_t>(k)] = true;
        if (!(std::abs(move.end[k]) <= kLargestCoordinate)) {
          return error(*word, "GC135", fmt::format("{} leads beyond 10 km", text_of(*word)), "check the number");
        }
      }
      if (const Word* word = find("ABC"[k]); word != nullptr) {
        move.axes_end[k] = units::from_deg(word->value) + (modal_.incremental ? axes_[k] : 0);
        if (!(std::abs(move.axes_end[k]) <= 1e7)) {
          return error(*word, "GC135", fmt::format("{} leads beyond every range", text_of(*word)), "check the number");
        }
      }
    }
    if (acting_ >= 2) POLYPOD_TRY(arc(move, culprit));
    if (acting_ > 0) {
      move.feed = modal_.feed_mode == FeedMode::inverse ? move.length() * find('F')->value / 60 : feed_;
    }
    move.known_end = known_;
    move.stops_before = waits_;
    if (!move.start_known || move.length() > 0 || move.axes_end != move.axes_start) waits_ = false;
    position_ = move.end;
    axes_ = move.axes_end;
    if (keep_) out_.moves.push_back(move);
    return {};
  }

  Status arc(Move& move, const Word& culprit) {
    move.clockwise = acting_ == 2;
    const auto [first, second, normal] = axes_of(modal_.plane);
    const std::array<char, 3> offset_letters{'I', 'J', 'K'};
    const Word* radius = find('R');
    const Word* i1 = find(offset_letters[static_cast<std::size_t>(first)]);
    const Word* i2 = find(offset_letters[static_cast<std::size_t>(second)]);
    const Word* i3 = find(offset_letters[static_cast<std::size_t>(normal)]);
    if (radius == nullptr && i1 == nullptr && i2 == nullptr && i3 == nullptr) {
      return error(culprit, "GC104",
                   fmt::format("G{} without I, J{} or R; an arc needs its centre or radius", acting_,
                               modal_.plane == Plane::xy ? "" : ", K"),
                   "add the centre or the radius");
    }
    if (i3 != nullptr) {
      return error(*i3, "GC116", fmt::format("{} does not lie in the plane {}", text_of(*i3), name_of(modal_.plane)),
                   "select the plane of the arc before it");
    }
    if (radius != nullptr && (i1 != nullptr || i2 != nullptr)) {
      return error(*radius, "GC116",
                   fmt::format("{} beside {}; an arc takes its centre or its radius", text_of(*radius),
                               text_of(i1 != nullptr ? *i1 : *i2)),
                   "remove one of them");
    }
    double turns = 1;
    if (const Word* p = find('P'); p != nullptr) {
      if (!(p->value >= 1) || p->value > kMostTurns || p->value != std::floor(p->value)) {
        return error(*p, "GC118", fmt::format("{} is no number of turns; P is an integer from 1", text_of(*p)),
                     "check P");
      }
      turns = p->value;
    }
    move.centre = move.start;
    if (radius != nullptr) {
      POLYPOD_TRY(centre_from_radius(move, *radius, first, second));
    } else {
      if (modal_.arc_absolute) {
        if (i1 == nullptr || i2 == nullptr) {
          return error(culprit, "GC117", "an arc under G90.1 with one centre coordinate; both are needed",
                       "add the other one");
        }
        const Vec3& offset = options_.work_offsets[modal_.work_offset];
        move.centre[first] = metres(i1->value) + offset[first];
        move.centre[second] = metres(i2->value) + offset[second];
      } else {
        if (i1 != nullptr) move.centre[first] += metres(i1->value);
        if (i2 != nullptr) move.centre[second] += metres(i2->value);
      }
    }
    const double x0 = move.start[first] - move.centre[first];
    const double y0 = move.start[second] - move.centre[second];
    const double x1 = move.end[first] - move.centre[first];
    const double y1 = move.end[second] - move.centre[second];
    const double r0 = std::hypot(x0, y0);
    const double r1 = std::hypot(x1, y1);
    const double difference = std::abs(r0 - r1);
    if (radius == nullptr) {
      if (r0 < kLeastRadius || r1 < kLeastRadius) {
        return error(culprit, "GC115", "an arc of radius 0", "check the centre");
      }
      if (difference > (modal_.inches ? kSpiralInch : kSpiralMm) && difference > kSpiralShare * std::max(r0, r1)) {
        return error(culprit, "GC114",
                     fmt::format("the arc's radius is {:.4f} mm at its start and {:.4f} mm at its end",
                                 units::to_mm(r0), units::to_mm(r1)),
                     "check the end and the centre; was the block before it removed?");
      }
    }
    const double from = std::atan2(y0, x0);
    const double to = std::atan2(y1, x1);
    double sweep = move.clockwise ? from - to : to - from;
    if (sweep < 0) sweep += kTurn;
    if (sweep < kFullTurnAngle) sweep += kTurn;
    move.sweep = sweep + (turns - 1) * kTurn;
    return {};
  }

  /// The centre of an arc with radius r through both ends: at the distance sqrt(r^2 - h^2) from the middle of the chord
  /// of half length h, to the left of its direction for G3 with r > 0, to the right for G2; r < 0 takes the other side,
  /// which gives the arc of more than half a turn.
  Status centre_from_radius(Move& move, const Word& radius, int first, int second) const {
    const double r = metres(radius.value);
    const double dx = move.end[first] - move.start[first];
    const double dy = move.end[second] - move.start[second];
    const double half = std::hypot(dx, dy) / 2;
    if (half == 0) {
      return error(radius, "GC136",
                   fmt::format("{} with the end at the start; infinitely many circles fit", text_of(radius)),
                   "give a full circle by its centre, with I, J, K");
    }
    if (half > std::abs(r) + kRadiusTolerance) {
      return error(radius, "GC113",
                   fmt::format("{} is too small: the ends are {:.4f} mm apart, R must be at least {:.4f} mm",
                               text_of(radius), units::to_mm(2 * half), units::to_mm(half)),
                   "check R and the end");
    }
    const double ratio = half >= std::abs(r) ? 0 : std::sqrt((r - half) * (r + half)) / (2 * half);
    const double side = (move.clockwise ? -1.0 : 1.0) * (r < 0 ? -1.0 : 1.0);
    move.centre[first] = move.start[first] + dx / 2 - side * ratio * dy;
    move.centre[second] = move.start[second] + dy / 2 + side * ratio * dx;
    return {};
  }

  const Program& program_;
  const InterpretOptions& options_;
  const bool keep_;
  Interpretation out_;

  // The block at hand.
  Block here_;
  const Block* const block_ = &here_;
  int index_ = 0;
  Words words_{};
  std::array<Code, static_cast<std::size_t>(Group::unknown) + 1> g_groups_{};
  std::array<Code, 32> g_{};
  std::array<Code, 16> m_{};
  int g_count_ = 0;
  int m_count_ = 0;
  int motion_code_ = -1;  // of the G word of the motion group, times ten
  int acting_ = -1;       // 0 to 3: what this block does
  bool axis_words_ = false;
  bool to_machine_ = false;  // G53, G28, G30

  // What carries over.
  ModalState modal_;
  PathControl path_;
  bool percent_ = false;
  Vec3 position_ = Vec3::Zero();  // p_W, m
  Vec3 axes_ = Vec3::Zero();      // A, B, C, rad
  std::array<bool, 3> known_{};
  double feed_ = 0;  // m/s, 0 for not given
  double spindle_speed_ = 0;
  bool waits_ = false;  ///< the controller has to be at rest before the next way
  Spindle spindle_ = Spindle::off;
  int selected_tool_ = -1;
  int tool_ = 0;
  int length_offset_ = 0;
  bool units_known_ = false;
  bool distance_known_ = false;
  bool noted_length_ = false;
  bool noted_machine_ = false;
  std::vector<int> noted_m_;
  struct JointsBy {
    int m = 0, line = 0;
  };
  JointsBy joints_;  ///< which M code made the controller take words for joints; 0: none
};

}  // namespace

Result<Interpretation> interpret(const Program& program, const InterpretOptions& options) {
  return Interpreter(program, options, true).run();
}

Status judge(const Program& program, const InterpretOptions& options) {
  POLYPOD_TRY(Interpreter(program, options, false).run());
  return {};
}

}  // namespace polypod::gcode
