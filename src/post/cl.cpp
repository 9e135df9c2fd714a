// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The reader of APT CL files.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/post/path.hpp"

namespace polypod::post {
namespace {

constexpr double kLargest = 1e4;          // m, of a coordinate, as in G-code
constexpr double kAxisOff = 0.01;         // by how much the length of an axis may be off 1
constexpr double kSameAxis = 1e-4;        // rad, an axis that is repeated under MULTAX/OFF
constexpr double kRadiusOff = 1.4e-5;     // m, by how much the ends of an arc may be off its radius ...
constexpr double kRadiusOffShare = 4e-4;  // ... or this share of it: LinuxCNC takes twice that between the ends
constexpr double kFullTurn = 1e-6;        // rad, ends this close make a full turn
constexpr double kNothing = 1e-5;         // m, a radius that is none
constexpr double kLeastFeed = 1e-6 / 60, kMostFeed = 1e3;  // m/s
constexpr double kMostSeconds = 1e6;

/// Where a character of a joined statement stands in the file.
struct Spot {
  int line = 0, column = 0;
};

/// A number or a word between commas.
struct Item {
  std::string text;  // upper case
  std::optional<double> number;
  Spot spot;
};

struct Statement {
  std::string word;  // the major word, upper case
  std::string rest;  // of words that carry text: what follows
  bool slash = false;
  std::vector<Item> items;
  Spot spot;
};

char upper(char c) {
  return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
}
bool blank(char c) {
  return c == ' ' || c == '\t';
}

std::string upper(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = upper(c);
  return out;
}

std::string_view trimmed(std::string_view s) {
  while (!s.empty() && blank(s.front())) s.remove_prefix(1);
  while (!s.empty() && blank(s.back())) s.remove_suffix(1);
  return s;
}

/// Words whose text runs to the end of the line, whatever it holds.
const std::set<std::string_view> kTextWords{"PARTNO", "PPRINT", "REMARK", "INSERT", "TITLES", "LETTER"};

/// Words that tell something and move nothing.
const std::set<std::string_view> kNoted{
    "CUTTER", "MACHIN", "HEAD",   "INTOL",  "OUTTOL", "TOLER",  "CLEARP", "DISPLY",    "SET",    "SELCTL",
    "SELECT", "UNLOAD", "CLAMP",  "MODE",   "TMARK",  "LEADER", "MCHTOL", "LINTOL",    "SAFPOS", "NOPOST",
    "SEQNO",  "AUTOPS", "REWIND", "CLRSRF", "PAINT",  "TLDATA", "TLNAME", "TOOL PATH", "TPRINT", "END-OF-PATH"};

/// Words that change where the tool goes and are not carried out, with what to do.
const std::map<std::string_view, const char*> kRefused{
    {"CUTCOM", "post with the path of the cutter's centre"},
    {"TRANS", "post in the coordinates of the workpiece"},
    {"TRACUT", "post in the coordinates of the workpiece"},
    {"ORIGIN", "post in the coordinates of the workpiece, and give their origin with --origin"},
    {"ROTABL", "an arm has no table: post with the tool's axis in GOTO/x,y,z,i,j,k"},
    {"ROTHED", "post with the tool's axis in GOTO/x,y,z,i,j,k"},
    {"ROTATE", "post with the tool's axis in GOTO/x,y,z,i,j,k"},
    {"COPY", "post with the copies written out"},
    {"INDEX", "post with the copies written out"},
    {"INSERT", "its text would go to the controller unread: remove it"},
    {"AUXFUN", "its M code would be missing: write STOP, OPSTOP, SPINDL or COOLNT, or remove it"},
    {"PREFUN", "its G code would be missing: post in the coordinates of the workpiece, and remove it"},
    {"RETRCT", "write the retract as RAPID and GOTO"},
    {"THREAD", "post without threads"},
    {"PITCH", "post without threads"},
    {"OPSKIP", "post what is to be run"},
    {"SPLINE", "post curves as points"},
    {"NURBS", "post curves as points"},
    {"COUPLE", "post without it"},
    {"DRESS", "post without it"},
    {"SAFETY", "write the retract as RAPID and GOTO"},
};

/// The coordinate systems that CAM systems write into remarks, twelve numbers each: `$$-> CSYS / ...` of Creo, in one
/// remark; `$$*CATIA0` of CATIA, in the remarks that follow, four a line.
class RemarkedSystems {
 public:
  /// A remark without its `$$`.
  void begin(std::string_view remark) {
    constexpr std::string_view kCreo = "-> CSYS", kCatia = "*CATIA0";
    const bool creo = remark.starts_with(kCreo);
    if (creo || remark.starts_with(kCatia)) {
      numbers_.clear();
      open_ = true;
      if (!creo) return;
      remark.remove_prefix(std::min(remark.find('/'), remark.size()));
    }
    read(remark);
  }
  /// A line of such a remark.
  void read(std::string_view line) {
    if (!open_) return;
    std::vector<double> found;
    for (std::size_t at = 0; at < line.size();) {
      if (std::string_view(" \t,/$").find(line[at]) != std::string_view::npos) {
        ++at;
        continue;
      }
      double value = 0;
      const auto [end, code] = std::from_chars(line.data() + at, line.data() + line.size(), value);
      if (code != std::errc{}) return;  // a title
      found.push_back(value);
      at = static_cast<std::size_t>(end - line.data());
    }
    numbers_.insert(numbers_.end(), found.begin(), found.end());
    open_ = numbers_.size() < kNumbers;
  }
  /// Whether one that is complete now differs from the first.
  bool take_second() {
    if (numbers_.size() != kNumbers) return false;
    constexpr double kSame = 1e-6;
    const bool differs = !first_.empty() && !std::equal(first_.begin(), first_.end(), numbers_.begin(),
                                                        [](double a, double b) { return std::abs(a - b) <= kSame; });
    if (first_.empty()) first_ = numbers_;
    numbers_.clear();
    return differs;
  }

 private:
  static constexpr std::size_t kNumbers = 12;
  std::vector<double> first_, numbers_;
  bool open_ = false;
};

class Reader {
 public:
  Reader(std::string_view text, const std::string& file) : text_(text), file_(file) { out_.file = file; }

  Result<Path> read() {
    for (;;) {
      POLYPOD_ASSIGN(statement, next());
      if (!statement) break;
      if (finished_) {
        note_once("what follows FINI is not read");
        break;
      }
      POLYPOD_TRY(carry_out(*statement));
    }
    if (arc_) return error("PO110", "CIRCLE without a GOTO behind it", arc_->spot, "give the end of the arc");
    if (std::none_of(out_.steps.begin(), out_.steps.end(), [](const Step& s) { return s.moves(); })) {
      return fail("PO112", "the file makes no move", {file_}, "is it a CL file with GOTO/...?");
    }
    if (!finished_ && !ended_) note_once("the file does not end with FINI: it may be cut off");
    if (!units_) note_once("no UNITS: lengths are taken as mm");
    for (const auto& [word, line] : passed_) {
      out_.notes.push_back(fmt::format("line {}: {} moves nothing and is left out", line, word));
    }
    return std::move(out_);
  }

 private:
  struct Arc {
    Vec3 centre, normal;
    double radius;
    Spot spot;
  };
  /// As it was given: m/s, or m a revolution of the spindle, whatever speed that comes to have.
  struct Feed {
    double speed = 0, per_turn = 0;
    [[nodiscard]] bool given() const { return speed > 0 || per_turn > 0; }
  };
  struct Cycle {
    double depth = 0, clearance = 0;
    Feed feed;
    std::optional<double> retract;  // above the point, where the tool goes behind the hole; empty: to the clearance
  };
  struct Length {
    double value;
    Spot spot;
  };

  tl::unexpected<Error> error(std::string id, std::string message, Spot spot, std::string hint) const {
    return fail(std::move(id), std::move(message), {file_, spot.line, spot.column}, std::move(hint));
  }

  void note_once(const std::string& note) {
    if (std::find(out_.notes.begin(), out_.notes.end(), note) == out_.notes.end()) out_.notes.push_back(note);
  }

  /// The next line without its ending and its `$$` comment; false at the end.
  bool next_line(std::string_view& line) {
    if (at_ >= text_.size()) return false;
    std::size_t end = text_.find('\n', at_);
    if (end == std::string_view::npos) end = text_.size();
    line = text_.substr(at_, end - at_);
    at_ = end + 1;
    ++line_;
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    return true;
  }

  Result<std::optional<Statement>> next() {
    std::string joined;
    std::vector<Spot> spots;
    bool open = false;  // the line before ends with `$`
    std::string_view line;
    while (next_line(line)) {
      // Creo lays a coordinate system into a remark of several lines, each but the last ending with `$`.
      if (std::exchange(in_remark_, in_remark_ && trimmed(line).ends_with('$'))) {
        remarked_.read(line);
        POLYPOD_TRY(one_system());
        continue;
      }
      const std::size_t first = line.find_first_not_of(" \t");
      if (!open && first != std::string_view::npos && carries_text(line.substr(first)))
        return text_statement(line, first);
      if (const std::size_t comment = line.find("$$"); comment != std::string_view::npos) {
        const std::string_view remark = trimmed(line.substr(comment + 2));
        in_remark_ = remark.starts_with("->") && remark.ends_with('$');
        remarked_.begin(remark);
        POLYPOD_TRY(one_system());
        line = line.substr(0, comment);
      }
      const std::size_t more = line.find('$');
      open = more != std::string_view::npos;
      if (open) line = line.substr(0, more);
      for (std::size_t i = 0; i < line.size(); ++i) {
        const auto byte = static_cast<unsigned char>(line[i]);
        if (byte < 0x20 && line[i] != '\t') {
          return error("PO101", "a control character", {line_, static_cast<int>(i) + 1},
                       "remove it; is this a text file?");
        }
        joined += upper(line[i]);
        spots.push_back({line_, static_cast<int>(i) + 1});
      }
      if (open) continue;
      if (trimmed(joined).empty()) {
        joined.clear();
        spots.clear();
        continue;
      }
      return split(joined, spots);
    }
    if (open) {
      return error("PO101", "the last line is continued with `$`, but nothing follows", {line_, 1},
                   "the file was cut off: write it again");
    }
    return std::optional<Statement>{};
  }

  Status one_system() {
    if (!remarked_.take_second()) return {};
    return error("PO105", "a second coordinate system in a remark, which lies elsewhere than the one before",
                 {line_, 1},
                 "post the operations of each system by themselves; where all coordinates are in one system, remove "
                 "the remarks");
  }

  static bool carries_text(std::string_view line) {
    const std::string word = upper(line.substr(0, 6));
    return kTextWords.count(word) > 0 && (line.size() == 6 || blank(line[6]) || line[6] == '/' || word != "INSERT");
  }

  Result<std::optional<Statement>> text_statement(std::string_view line, std::size_t first) const {
    Statement s;
    s.word = upper(line.substr(first, 6));
    s.spot = {line_, static_cast<int>(first) + 1};
    std::string_view rest = trimmed(line.substr(first + 6));
    if (!rest.empty() && rest.front() == '/') rest = trimmed(rest.substr(1));
    s.rest = one_line(rest);
    return std::optional<Statement>(std::move(s));
  }

  Result<std::optional<Statement>> split(const std::string& joined, const std::vector<Spot>& spots) const {
    Statement s;
    const std::size_t first = joined.find_first_not_of(" \t");
    s.spot = spots[first];
    const std::size_t slash = joined.find('/');
    s.slash = slash != std::string::npos;
    s.word = std::string(trimmed(std::string_view(joined).substr(0, slash)));
    if (s.word.find('=') != std::string::npos) {
      return error("PO101", fmt::format("`{}` defines something: this is an APT source, not a CL file", shown(s.word)),
                   s.spot, "give the CL file that the APT processor or the CAM system writes");
    }
    if (s.word.empty()) return error("PO101", "a statement without its word", s.spot, "write WORD/values");
    if (!s.slash) return std::optional<Statement>(std::move(s));
    // CATIA's TLON,GOFWD/(CIRCLE/...),ON,(LINE/...): as one list.
    std::string list = joined;
    if (s.word.starts_with("TLON") && s.word.find("GOFWD") != std::string::npos) {
      s.word = "TLON";
      std::transform(list.begin() + static_cast<std::ptrdiff_t>(slash) + 1, list.end(),
                     list.begin() + static_cast<std::ptrdiff_t>(slash) + 1, [](char c) {
                       return c == '(' || c == ')' ? ' ' : c == '/' ? ',' : c;
                     });
    }
    std::size_t at = slash + 1;
    for (;;) {
      const std::size_t comma = std::min(list.find(',', at), list.size());
      const std::string_view raw = std::string_view(list).substr(at, comma - at);
      Item item;
      item.text = std::string(trimmed(raw));
      const std::size_t lead = raw.find_first_not_of(" \t");
      item.spot = spots[std::min(lead == std::string_view::npos ? at : at + lead, spots.size() - 1)];
      if (item.text.empty()) {
        return error("PO101", fmt::format("{}: nothing between two commas", shown(s.word)), item.spot,
                     "give the value, or remove the comma");
      }
      POLYPOD_ASSIGN(number, number_in(item, s.word));
      item.number = number;
      s.items.push_back(std::move(item));
      if (comma == list.size()) break;
      at = comma + 1;
    }
    return std::optional<Statement>(std::move(s));
  }

  static std::string shown(const std::string& text) {
    return one_line(text.size() > 40 ? text.substr(0, 40) + "..." : text);
  }

  /// What begins like a number must be one.
  Result<std::optional<double>> number_in(const Item& item, const std::string& word) const {
    const char c = item.text.front();
    if (!(c == '+' || c == '-' || c == '.' || (c >= '0' && c <= '9'))) return std::optional<double>{};
    std::string_view text = item.text;
    if (text.front() == '+') text.remove_prefix(1);
    double value = 0;
    const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (status != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) {
      if (status == std::errc::result_out_of_range && end == text.data() + text.size() &&
          (text.find("E-") != std::string_view::npos)) {
        return std::optional<double>(0.0);
      }
      return error("PO102", fmt::format("{}: `{}` is no number", shown(word), shown(item.text)), item.spot,
                   "write a sign, digits, at most one point, and E with a whole exponent");
    }
    return std::optional<double>(value);
  }

  [[nodiscard]] double unit() const { return units_.value_or(units::kMetrePerMm); }

  Result<double> length_of(const Item& item) const {
    const double metres = *item.number * unit();
    if (std::abs(metres) > kLargest) {
      return error("PO102", fmt::format("{} is beyond 10 km", item.text), item.spot, "check the number and UNITS");
    }
    return metres;
  }

  Result<std::vector<double>> all_numbers(const Statement& s) const {
    std::vector<double> out;
    for (const Item& item : s.items) {
      if (!item.number) {
        return error("PO103", fmt::format("{}: `{}` where a number must stand", s.word, shown(item.text)), item.spot,
                     "give numbers");
      }
      out.push_back(*item.number);
    }
    return out;
  }

  Result<Vec3> point_of(const Statement& s, std::size_t from) const {
    Vec3 p;
    for (std::size_t i = 0; i < 3; ++i) {
      POLYPOD_ASSIGN(x, length_of(s.items[from + i]));
      p[static_cast<int>(i)] = x;
    }
    return p;
  }

  /// A direction; `exact` ones must have the length 1.
  Result<Vec3> direction_of(const Statement& s, std::size_t from, const char* what) const {
    const Vec3 k(*s.items[from].number, *s.items[from + 1].number, *s.items[from + 2].number);
    const double length = k.stableNorm();
    if (!(std::abs(length - 1) <= kAxisOff)) {
      return error("PO106", fmt::format("{}: {} has the length {:.4g}, not 1", s.word, what, length),
                   s.items[from].spot, "an axis is a unit vector; check that these columns are i, j, k");
    }
    return Vec3(k / length);
  }

  /// The feed in force now, m/s.
  Result<double> speed_of(const Feed& feed, Spot spot) const {
    double speed = feed.speed;
    if (feed.per_turn > 0) {
      if (now_.spindle == gcode::Spindle::off || !(now_.spindle_speed > 0)) {
        return error("PO108", "a cut with a feed per revolution while the spindle stands", spot,
                     "give SPINDL/... before it");
      }
      speed = feed.per_turn * now_.spindle_speed;
    }
    if (!(speed >= kLeastFeed && speed <= kMostFeed)) {
      return error("PO108", fmt::format("a feed of {:g} mm/min", units::to_mm_per_min(speed)), spot,
                   "give a feed of 0.001 mm/min to 60000 m/min");
    }
    return speed;
  }

  Result<Feed> feed_of(double value, const std::string& word, Spot spot) {
    const bool inch = word == "IPM" || word == "IPR", mm = word == "MMPM" || word == "MMPR";
    if (inch && !units_) {
      return error("PO107", fmt::format("a feed in {} in a file without UNITS: is it in inches?", word), spot,
                   "write UNITS/MM or UNITS/INCHES before the first length");
    }
    const double length = value * (inch ? units::kMetrePerInch : mm ? units::kMetrePerMm : unit());
    Feed out;
    if (word == "IPR" || word == "MMPR" || word == "PERREV") {
      out.per_turn = length;
    } else {
      out.speed = length / 60;
    }
    if (!(out.per_turn > 0)) POLYPOD_TRY(speed_of(out, spot));  // that of a turn is judged where it cuts
    return out;
  }

  static bool is_feed_word(const std::string& w) {
    return w == "MMPM" || w == "IPM" || w == "MMPR" || w == "IPR" || w == "PERMIN" || w == "PERREV";
  }

  Status carry_out(const Statement& s) {
    if (s.word != "GOTO") done_arc_.reset();
    ended_ = false;
    from_another_system_ = from_another_system_ || s.word == "TOOL PATH" || s.word == "TLON" || s.word == "MSYS";
    using Handler = Status (Reader::*)(const Statement&);
    static const std::map<std::string_view, Handler> handlers{
        {"GOTO", &Reader::go_to},       {"FROM", &Reader::from},      {"GODLTA", &Reader::go_delta},
        {"GOHOME", &Reader::go_home},   {"RAPID", &Reader::rapid},    {"FEDRAT", &Reader::feed},
        {"SPINDL", &Reader::spindle},   {"LOADTL", &Reader::load},    {"TOOLNO", &Reader::load},
        {"LOAD", &Reader::load},        {"CIRCLE", &Reader::circle},  {"MULTAX", &Reader::multax},
        {"TLAXIS", &Reader::tool_axis}, {"COOLNT", &Reader::coolant}, {"UNITS", &Reader::unit_word},
        {"STOP", &Reader::stop},        {"OPSTOP", &Reader::stop},    {"DELAY", &Reader::delay},
        {"PARTNO", &Reader::comment},   {"PPRINT", &Reader::comment}, {"REMARK", &Reader::comment},
        {"TITLES", &Reader::comment},   {"LETTER", &Reader::comment}, {"CYCLE", &Reader::cycle},
        {"FINI", &Reader::end},         {"END", &Reader::last},       {"MSYS", &Reader::system},
        {"INDIRV", &Reader::direction}, {"TLON", &Reader::catia_arc}};
    const auto refuse_here = [&](const char* hint) {
      return error("PO105", fmt::format("{} changes where the tool goes and is not carried out", s.word), s.spot, hint);
    };
    if (const auto it = handlers.find(s.word); it != handlers.end()) return (this->*it->second)(s);
    if (s.word == "CUTCOM" && s.items.size() == 1 && s.items[0].text == "OFF") return {};
    if (s.word == "OPSKIP" && s.items.size() == 1 && s.items[0].text == "OFF") return {};
    if (const auto it = kRefused.find(s.word); it != kRefused.end()) return refuse_here(it->second);
    if (kNoted.count(s.word) > 0) {
      passed_.emplace(s.word, s.spot.line);
      return {};
    }
    return error(
        "PO104", fmt::format("`{}` is no word that Polypod knows", shown(s.word)), s.spot,
        "it may change motion: remove it, or post with GOTO, RAPID, FEDRAT, ... (docs/post.md lists the words)");
  }

  /// Where the coordinates lie in the CAM model: taken as those of the workpiece, one system a file.
  Status system(const Statement& s) {
    POLYPOD_ASSIGN(values, all_numbers(s));
    static const std::vector<double> kIdentity{0, 0, 0, 1, 0, 0, 0, 1, 0};
    const auto same = [](const std::vector<double>& a, const std::vector<double>& b) {
      constexpr double kSame = 1e-6;
      return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                        [](double x, double y) { return std::abs(x - y) <= kSame; });
    };
    if (system_ && !same(*system_, values)) {
      return error("PO105", "a second MSYS, which lies elsewhere than the one before: its coordinates are others",
                   s.spot, "post the operations of each system by themselves, or all in one system");
    }
    system_ = values;
    if (same(values, kIdentity)) {
      passed_.emplace(s.word, s.spot.line);
    } else {
      note_once("MSYS tells where the coordinates lie in the CAM model; they are taken as those of the workpiece");
    }
    return {};
  }

  /// A step of this kind with what is in force.
  Step step(StepKind kind, Spot spot) const {
    Step out = now_;
    out.kind = kind;
    out.line = spot.line;
    return out;
  }

  /// Before a cut: its feed.
  Status take_feed(Spot spot) {
    if (!feed_.given()) return error("PO108", "a cut without a feed", spot, "give FEDRAT/... before it, or RAPID");
    POLYPOD_ASSIGN(speed, speed_of(feed_, spot));
    now_.feed = speed;
    return {};
  }

  /// A rapid along the tool axis and across it: down comes last, up first, as in the cycles of LinuxCNC.
  void approach(const Vec3& tip, const Vec3& axis, Spot spot) {
    constexpr double kSmall = 1e-7;  // m
    const Vec3 way = tip - now_.tip;
    const double along = way.dot(axis);
    if (known_ && angle_between(axis, now_.axis) > kSameAxis) {
      note_once("the way to a hole with another tool axis is a straight line: check that it is free");
    } else if (known_ && std::abs(along) > kSmall && (way - along * axis).norm() > kSmall) {
      push(StepKind::rapid, along < 0 ? Vec3(tip - along * axis) : Vec3(now_.tip + along * axis), axis, spot);
    }
    push(StepKind::rapid, tip, axis, spot);
  }

  /// The tool goes to a point, along the arc or the cycle in force.
  Status move_to(const Vec3& tip, const Vec3& axis, Spot spot) {
    if (cycle_) {
      if (arc_) return error("PO110", "CIRCLE within a cycle", spot, "switch the cycle off with CYCLE/OFF");
      const Vec3 above = tip + cycle_->clearance * axis, below = tip - cycle_->depth * axis;
      POLYPOD_ASSIGN(speed, speed_of(cycle_->feed, spot));
      approach(above, axis, spot);
      push(StepKind::line, below, axis, spot);
      out_.steps.back().feed = speed;
      push(StepKind::rapid, cycle_->retract ? Vec3(tip + *cycle_->retract * axis) : above, axis, spot);
      cl_point_ = tip;  // the hole, not the place above it
      rapid_ = false;
    } else if (arc_) {
      POLYPOD_TRY(arc_to(tip, axis, spot));
    } else if (rapid_) {
      push(StepKind::rapid, tip, axis, spot);
      rapid_ = false;
    } else {
      POLYPOD_TRY(take_feed(spot));
      POLYPOD_TRY(no_further_point(tip, spot));
      push(StepKind::line, tip, axis, spot);
    }
    return {};
  }

  /// Creo writes several points behind one CIRCLE (NUMBER_OF_ARC_PTS), the last the end of the arc; other systems one,
  /// and from there on lines. A point right behind an arc and on its circle may be either, but where the file shows
  /// that it is none of Creo's.
  Status no_further_point(const Vec3& tip, Spot spot) const {
    if (!done_arc_ || from_another_system_) return {};
    const Vec3 a = flat(now_.tip, done_arc_->centre, done_arc_->normal),
               b = flat(tip, done_arc_->centre, done_arc_->normal);
    constexpr double kOn = 2e-6;  // m, what files with five decimals leave
    if (std::abs((tip - now_.tip).dot(done_arc_->normal)) > kOn || std::abs(b.norm() - a.norm()) > kOn ||
        (b - a).norm() < kOn) {
      return {};
    }
    return error(
        "PO110",
        fmt::format("a point that lies on the circle of line {}: a further point of the arc, as Creo writes them, or "
                    "the end of a line",
                    done_arc_->spot.line),
        spot, "post arcs as points (Creo: CIRC_INTERPOLATION POINTS_ONLY), or write a CIRCLE for each GOTO");
  }

  void push(StepKind kind, const Vec3& tip, const Vec3& axis, Spot spot) {
    now_.tip = cl_point_ = tip;
    now_.axis = axis;
    out_.steps.push_back(step(kind, spot));
    if (kind == StepKind::rapid) out_.steps.back().feed = 0;
    known_ = true;
  }

  /// p - centre without its part along the normal.
  static Vec3 flat(const Vec3& p, const Vec3& centre, const Vec3& normal) {
    const Vec3 out = p - centre;
    return out - out.dot(normal) * normal;
  }
  /// The turn about the normal that takes a to b, rad, above 0 to a full one.
  static double sweep_of(const Vec3& a, const Vec3& b, const Vec3& normal) {
    const double sweep = std::atan2(normal.dot(a.cross(b)), a.dot(b));
    return sweep < kFullTurn ? sweep + 2 * std::numbers::pi : sweep;
  }

  Status arc_to(const Vec3& tip, const Vec3& axis, Spot spot) {
    const Arc arc = *arc_;
    arc_.reset();
    if (!known_) return error("PO110", "an arc from an unknown point", spot, "give FROM/... or a GOTO before CIRCLE");
    if (rapid_) return error("PO110", "RAPID before an arc", spot, "arcs are cuts: give a feed, or leave the arc out");
    POLYPOD_TRY(take_feed(spot));
    const Vec3 a = flat(now_.tip, arc.centre, arc.normal), b = flat(tip, arc.centre, arc.normal);
    const double off = std::max(kRadiusOff, kRadiusOffShare * arc.radius);
    for (const auto& [r, what] : {std::pair(a.norm(), "start"), std::pair(b.norm(), "end")}) {
      if (std::abs(r - arc.radius) > off) {
        return error("PO110",
                     fmt::format("the {} of the arc is {:.4f} mm from its axis, the radius is {:.4f} mm", what,
                                 units::to_mm(r), units::to_mm(arc.radius)),
                     spot, "check centre, radius and UNITS; was a GOTO before CIRCLE removed?");
      }
    }
    const double sweep = sweep_of(a, b, arc.normal);
    const Vec3 start = now_.tip;
    done_arc_ = arc;
    push(StepKind::arc, tip, axis, spot);
    Step& s = out_.steps.back();
    s.centre = arc.centre + (start - arc.centre).dot(arc.normal) * arc.normal;
    s.normal = arc.normal;
    s.sweep = sweep;
    return {};
  }

  Result<Vec3> axis_in(const Statement& s) const {
    if (s.items.size() == 3) return now_.axis;
    POLYPOD_ASSIGN(k, direction_of(s, 3, "the tool axis"));
    if (multax_ == 0 && angle_between(k, now_.axis) > kSameAxis) {
      return error("PO111", fmt::format("{} with another tool axis under MULTAX/OFF", s.word), s.items[3].spot,
                   "write MULTAX/ON before it");
    }
    return k;
  }

  Status go_to(const Statement& s) {
    POLYPOD_TRY(all_numbers(s));
    if (s.items.size() != 3 && s.items.size() != 6) {
      return error("PO103", fmt::format("{} with {} numbers", s.word, s.items.size()), s.spot,
                   "give x,y,z or x,y,z,i,j,k");
    }
    POLYPOD_ASSIGN(p, point_of(s, 0));
    POLYPOD_ASSIGN(k, axis_in(s));
    return move_to(p, k, s.spot);
  }

  Status from(const Statement& s) {
    POLYPOD_TRY(all_numbers(s));
    if (s.items.size() != 3 && s.items.size() != 6) {
      return error("PO103", fmt::format("FROM with {} numbers", s.items.size()), s.spot, "give x,y,z or x,y,z,i,j,k");
    }
    if (known_) return error("PO105", "FROM after a move", s.spot, "FROM says where the tool is first; use GOTO");
    POLYPOD_ASSIGN(p, point_of(s, 0));
    POLYPOD_ASSIGN(k, axis_in(s));
    push(StepKind::rapid, p, k, s.spot);
    home_ = p;
    home_axis_ = k;
    return {};
  }

  Status go_home(const Statement& s) {
    if (!home_) return error("PO113", "GOHOME without FROM", s.spot, "tell with FROM/x,y,z where home is");
    if (cycle_) return error("PO105", "GOHOME within a cycle", s.spot, "write CYCLE/OFF before it");
    push(StepKind::rapid, *home_, home_axis_, s.spot);
    rapid_ = false;
    return {};
  }

  Status go_delta(const Statement& s) {
    POLYPOD_ASSIGN(values, all_numbers(s));
    if (values.size() != 1 && values.size() != 3) {
      return error("PO103", fmt::format("GODLTA with {} numbers", values.size()), s.spot,
                   "give dx,dy,dz, or one way along the tool axis");
    }
    if (!known_) return error("PO113", "GODLTA from an unknown point", s.spot, "give FROM/... or GOTO/... before it");
    Vec3 d;
    if (values.size() == 1) {
      POLYPOD_ASSIGN(way, length_of(s.items[0]));
      d = way * now_.axis;
    } else {
      POLYPOD_ASSIGN(p, point_of(s, 0));
      d = p;
    }
    const Vec3 end = cl_point_ + d;
    if (end.cwiseAbs().maxCoeff() > kLargest) {
      return error("PO102", "GODLTA leads beyond 10 km", s.spot, "check the numbers and UNITS");
    }
    return move_to(end, now_.axis, s.spot);
  }

  Status rapid(const Statement&) {
    rapid_ = true;
    return {};
  }

  Status feed(const Statement& s) {
    std::optional<double> value;
    std::string word = "PERMIN";
    for (const Item& item : s.items) {
      if (item.number && !value) {
        value = item.number;
      } else if (is_feed_word(item.text)) {
        word = item.text;
      } else {
        return error("PO108", fmt::format("FEDRAT: `{}` is not understood", shown(item.text)), item.spot,
                     "write FEDRAT/value,MMPM (IPM, MMPR, IPR)");
      }
    }
    if (!value) return error("PO108", "FEDRAT without a number", s.spot, "write FEDRAT/value,MMPM");
    POLYPOD_ASSIGN(given, feed_of(*value, word, s.spot));
    feed_ = given;
    rapid_ = false;
    return {};
  }

  Status spindle(const Statement& s) {
    gcode::Spindle turn = now_.spindle == gcode::Spindle::off ? gcode::Spindle::clockwise : now_.spindle;
    bool off = false, says_way = now_.spindle != gcode::Spindle::off;
    double speed = now_.spindle_speed;
    for (const Item& item : s.items) {
      if (item.number) {
        if (!(*item.number >= 0 && *item.number <= 1e6)) {
          return error("PO109", fmt::format("a spindle speed of {:g}", *item.number), item.spot,
                       "give 0 to 1e6 rev/min");
        }
        speed = units::from_per_min(*item.number);
        if (*item.number == 0) off = true;
      } else if (item.text == "CLW" || item.text == "CCLW") {
        turn = item.text == "CLW" ? gcode::Spindle::clockwise : gcode::Spindle::counterclockwise;
        says_way = true;
      } else if (item.text == "OFF" || item.text == "STOP") {
        off = true;
      } else if (item.text != "RPM" && item.text != "ON") {
        return error("PO109", fmt::format("SPINDL: `{}` is not understood", shown(item.text)), item.spot,
                     "write SPINDL/RPM,speed,CLW (or CCLW), or SPINDL/OFF");
      }
    }
    if (s.items.empty() || (!off && !(speed > 0))) {
      return error("PO109", "SPINDL without a speed", s.spot, "write SPINDL/RPM,speed,CLW, or SPINDL/OFF");
    }
    if (!off && !says_way)
      note_once(fmt::format("line {}: SPINDL without CLW or CCLW turns clockwise (M3)", s.spot.line));
    now_.spindle = off ? gcode::Spindle::off : turn;
    if (speed > 0) now_.spindle_speed = speed;
    return {};
  }

  /// LOADTL/n, TOOLNO/n, LOAD/TOOL,n.
  Status load(const Statement& s) {
    const std::size_t at = s.word == "LOAD" && !s.items.empty() && s.items[0].text == "TOOL" ? 1 : 0;
    if (s.items.size() <= at || (s.word == "LOAD" && at == 0) || !s.items[at].number || *s.items[at].number < 0 ||
        *s.items[at].number > 99999 || *s.items[at].number != std::floor(*s.items[at].number)) {
      return error("PO103", fmt::format("{} without the number of a tool", s.word), s.spot,
                   "write LOADTL/n, n a whole number");
    }
    now_.tool = static_cast<int>(*s.items[at].number);
    if (s.items.size() > at + 1) {
      note_once(
          fmt::format("line {}: of {} the number of the tool is read, {} is not: tool lengths are those of the "
                      "machine file or the controller",
                      s.spot.line, s.word, shown(s.items[at + 1].text)));
    }
    return {};
  }

  Status circle(const Statement& s) {
    POLYPOD_TRY(all_numbers(s));
    if (s.items.size() < 7) {
      return error("PO103", fmt::format("CIRCLE with {} numbers", s.items.size()), s.spot, "give xc,yc,zc,i,j,k,r");
    }
    if (arc_) return error("PO110", "two CIRCLE without a GOTO between them", s.spot, "give the end of the first arc");
    POLYPOD_ASSIGN(centre, point_of(s, 0));
    POLYPOD_ASSIGN(normal, direction_of(s, 3, "the axis of the circle"));
    POLYPOD_ASSIGN(radius, length_of(s.items[6]));
    if (!(radius > kNothing))
      return error("PO110", "a circle without a radius", s.items[6].spot, "give a radius above 0");
    arc_ = Arc{centre, normal, radius, s.spot};
    return {};
  }

  /// The direction in which CATIA's next arc begins.
  Status direction(const Statement& s) {
    POLYPOD_TRY(all_numbers(s));
    if (s.items.size() != 3)
      return error("PO103", fmt::format("INDIRV with {} numbers", s.items.size()), s.spot, "give i,j,k");
    POLYPOD_ASSIGN(k, direction_of(s, 0, "the direction"));
    direction_ = k;
    return {};
  }

  /// CATIA's arc square to the tool: TLON,GOFWD/(CIRCLE/xc,yc,zc,r),ON,(LINE/xc,yc,zc,xe,ye,ze), or
  /// ...,ON,2,INTOF,(LINE/...). It begins where the tool stands, in the direction of INDIRV, and ends at the second
  /// point of the line, which is where this line meets the circle first; with 2,INTOF the second time, for it has
  /// passed the opposite point before.
  Status catia_arc(const Statement& s) {
    const auto form = [&] {
      return error("PO110", "an arc that is not TLON,GOFWD/(CIRCLE/xc,yc,zc,r),ON,(LINE/xc,yc,zc,xe,ye,ze)", s.spot,
                   "post arcs so, with 2,INTOF where they are longer than half a turn, or as points");
    };
    const bool second = s.items.size() == 15;
    if (!second && s.items.size() != 13) return form();
    const std::size_t line = second ? 8 : 6;
    const auto word = [&](std::size_t i, std::string_view text) { return s.items[i].text == text; };
    if (!word(0, "CIRCLE") || !word(5, "ON") || !word(line, "LINE") || (second && (!word(6, "2") || !word(7, "INTOF"))))
      return form();
    for (std::size_t i = 1; i < s.items.size(); ++i) {
      if (i != 5 && i != line && !(second && i == 7) && !s.items[i].number) return form();
    }
    if (arc_) return error("PO110", "CIRCLE before TLON", s.spot, "give the end of the first arc");
    if (cycle_) return error("PO110", "an arc within a cycle", s.spot, "switch the cycle off with CYCLE/OFF");
    if (!known_) return error("PO110", "an arc from an unknown point", s.spot, "give FROM/... or a GOTO before it");
    if (!direction_) return error("PO110", "an arc without its direction", s.spot, "give INDIRV/i,j,k before it");
    const Vec3 along = *std::exchange(direction_, std::nullopt);
    POLYPOD_ASSIGN(centre, point_of(s, 1));
    POLYPOD_ASSIGN(radius, length_of(s.items[4]));
    POLYPOD_ASSIGN(from, point_of(s, line + 1));
    POLYPOD_ASSIGN(end, point_of(s, line + 4));
    if (!(radius > kNothing))
      return error("PO110", "a circle without a radius", s.items[4].spot, "give a radius above 0");
    if ((from - centre).norm() > kRadiusOff)
      return error("PO110", "the line to the end of the arc does not begin in its centre", s.items[line].spot,
                   "post arcs as points");
    constexpr double kSquare = 0.02;  // rad: directions have five digits, radii are short
    const Vec3 out = now_.tip - centre, normal = out.cross(along);
    if (!(std::abs(out.normalized().dot(along)) < kSquare) || !(normal.norm() > 0) ||
        !(normal.normalized().cross(now_.axis).norm() < kSquare)) {
      return error("PO110", "an arc that does not begin along its circle, or is not square to the tool's axis", s.spot,
                   "check INDIRV and the GOTO before it; post other arcs as points");
    }
    const Vec3 axis = (normal.dot(now_.axis) > 0 ? 1 : -1) * now_.axis;
    const double sweep = sweep_of(flat(now_.tip, centre, axis), flat(end, centre, axis), axis);
    constexpr double kHalf = 1e-3;  // rad: half a turn is both
    if (second ? sweep < std::numbers::pi - kHalf : sweep > std::numbers::pi + kHalf) {
      return error("PO110",
                   fmt::format("an arc of {:.1f} deg {}", units::to_deg(sweep),
                               second ? "whose end is the second place where its line meets the circle"
                                      : "whose end is the first place where its line meets the circle"),
                   s.spot, "an arc ends at its line's second point; check INDIRV, and 2,INTOF of long arcs");
    }
    arc_ = Arc{centre, axis, radius, s.spot};
    return move_to(end, now_.axis, s.spot);
  }

  Status multax(const Statement& s) {
    if (s.items.size() > 1 || (s.items.size() == 1 && s.items[0].text != "ON" && s.items[0].text != "OFF")) {
      return error("PO103", "MULTAX: neither ON nor OFF", s.spot, "write MULTAX/ON or MULTAX/OFF");
    }
    multax_ = s.items.empty() || s.items[0].text == "ON" ? 1 : 0;
    return {};
  }

  Status tool_axis(const Statement& s) {
    POLYPOD_TRY(all_numbers(s));
    if (s.items.size() != 3)
      return error("PO103", fmt::format("TLAXIS with {} numbers", s.items.size()), s.spot, "give i,j,k");
    POLYPOD_ASSIGN(k, direction_of(s, 0, "the tool axis"));
    now_.axis = k;
    return {};
  }

  Status coolant(const Statement& s) {
    const std::string what = s.items.empty() ? "" : s.items[0].text;
    if (what == "OFF") {
      now_.coolant = Coolant::off;
    } else if (what == "MIST") {
      now_.coolant = Coolant::mist;
    } else if (what == "ON" || what == "FLOOD" || what == "THRU" || what == "AIR" || what == "TAPKUL") {
      now_.coolant = Coolant::flood;
      if (what != "ON" && what != "FLOOD") {
        out_.notes.push_back(fmt::format("line {}: COOLNT/{} is written as flood", s.spot.line, what));
      }
    } else {
      return error("PO103", fmt::format("COOLNT: `{}` is not understood", shown(what)), s.spot,
                   "write ON, OFF, FLOOD or MIST");
    }
    return {};
  }

  Status unit_word(const Statement& s) {
    const std::string what = s.items.size() == 1 ? s.items[0].text : "";
    double unit = 0;
    if (what == "MM") unit = units::kMetrePerMm;
    if (what == "INCHES" || what == "INCH" || what == "IN") unit = units::kMetrePerInch;
    if (unit == 0) {
      return error("PO107", fmt::format("UNITS: `{}` is no unit of a CL file", shown(what)), s.spot,
                   "write UNITS/MM or UNITS/INCHES");
    }
    if ((known_ || feed_.given() || arc_ || cycle_) && unit != this->unit()) {
      return error("PO107", "UNITS changes the unit after the first length", s.spot,
                   "write it at the start of the file, once");
    }
    units_ = unit;
    return {};
  }

  Status stop(const Statement& s) {
    out_.steps.push_back(step(s.word == "STOP" ? StepKind::stop : StepKind::optional_stop, s.spot));
    return {};
  }

  Status delay(const Statement& s) {
    const bool revolutions = s.items.size() == 2 && s.items[1].text == "REV";
    if (!(s.items.size() == 1 || revolutions) || !s.items[0].number || !(*s.items[0].number >= 0)) {
      return error("PO103", "DELAY without a time", s.spot, "write DELAY/seconds");
    }
    double seconds = *s.items[0].number;
    if (revolutions) {
      if (now_.spindle == gcode::Spindle::off) {
        return error("PO109", "DELAY in revolutions while the spindle stands", s.spot, "give SPINDL/... before it");
      }
      seconds /= now_.spindle_speed;
    }
    if (!(seconds <= kMostSeconds))
      return error("PO102", "DELAY of more than a million seconds", s.spot, "check the number");
    out_.steps.push_back(step(StepKind::dwell, s.spot));
    out_.steps.back().seconds = seconds;
    return {};
  }

  Status comment(const Statement& s) {
    out_.steps.push_back(step(StepKind::comment, s.spot));
    out_.steps.back().text = s.word == "PARTNO" ? "PARTNO " + s.rest : s.rest;
    return {};
  }

  /// CYCLE/DRILL with DEPTH (or FEDTO), a feed, CLEAR (or RAPTO) and perhaps RTRCTO: down and up along the tool axis at
  /// each GOTO.
  Status cycle(const Statement& s) {
    const auto refuse_here = [&](std::string message, Spot spot) {
      return error("PO105", std::move(message), spot,
                   "only CYCLE/DRILL,DEPTH,d,MMPM,f,CLEAR,c is carried out: post with cycles expanded");
    };
    if (s.items.empty()) return refuse_here("CYCLE without a name", s.spot);
    if (s.items[0].text == "OFF") {
      cycle_.reset();
      return {};
    }
    if (s.items[0].text == "ON") return refuse_here("CYCLE/ON", s.spot);
    if (s.items[0].text != "DRILL") return refuse_here(fmt::format("CYCLE/{}", shown(s.items[0].text)), s.spot);
    Cycle c;
    c.feed = feed_;
    std::optional<double> depth, clearance;
    for (std::size_t i = 1; i < s.items.size(); i += 2) {
      const Item& key = s.items[i];
      if (key.number || i + 1 >= s.items.size() || !s.items[i + 1].number) {
        return refuse_here(fmt::format("CYCLE/DRILL: `{}` without its name or its value", shown(key.text)), key.spot);
      }
      const Item& value = s.items[i + 1];
      if (is_feed_word(key.text)) {
        POLYPOD_ASSIGN(given, feed_of(*value.number, key.text, value.spot));
        c.feed = given;
        continue;
      }
      POLYPOD_ASSIGN(length, length_of(value));
      if (key.text == "DEPTH") {
        depth = length;
      } else if (key.text == "FEDTO") {
        if (!(length < 0)) {
          return error("PO105", fmt::format("CYCLE/DRILL with FEDTO,{:g}", *value.number), value.spot,
                       "FEDTO counts from the hole's GOTO along the tool axis: below it, it is negative");
        }
        depth = -length;
      } else if (key.text == "CLEAR" || key.text == "RAPTO") {
        clearance = length;
      } else if (key.text == "RTRCTO") {
        c.retract = length;
      } else {
        return refuse_here(fmt::format("CYCLE/DRILL with {}", shown(key.text)), key.spot);
      }
    }
    if (!depth || !clearance || !(*depth > 0) || !(*clearance >= 0)) {
      return refuse_here("CYCLE/DRILL without a depth above 0 and a clearance", s.spot);
    }
    if (c.retract && !(*c.retract >= *clearance)) {
      return refuse_here("CYCLE/DRILL with an RTRCTO below its clearance", s.spot);
    }
    if (!c.feed.given())
      return error("PO108", "CYCLE/DRILL without a feed", s.spot, "give MMPM,f in it, or FEDRAT before it");
    c.depth = *depth;
    c.clearance = *clearance;
    cycle_ = c;
    return {};
  }

  Status end(const Statement&) {
    finished_ = true;
    return {};
  }
  /// END, with which CATIA closes a file; in others more may follow.
  Status last(const Statement&) {
    ended_ = true;
    return {};
  }

  std::string_view text_;
  std::string file_;
  std::size_t at_ = 0;
  int line_ = 0;
  bool in_remark_ = false;  // the next line goes on with a remark

  Path out_;
  Step now_;
  bool known_ = false, rapid_ = false, finished_ = false, ended_ = false;
  int multax_ = -1;  // not said, off, on
  std::optional<double> units_;
  std::optional<Vec3> home_;
  Vec3 home_axis_ = Vec3::UnitZ();
  Vec3 cl_point_ = Vec3::Zero();  // of the last GOTO, FROM, GODLTA or GOHOME: where GODLTA counts from
  std::optional<Arc> arc_;
  std::optional<Arc> done_arc_;  ///< that the tool has just come along, up to the next word but GOTO
  RemarkedSystems remarked_;
  bool from_another_system_ = false;           ///< than Creo: words that NX or CATIA write
  std::optional<Vec3> direction_;              ///< of INDIRV
  std::optional<std::vector<double>> system_;  ///< of MSYS
  std::optional<Cycle> cycle_;
  Feed feed_;
  std::map<std::string, int> passed_;
};

}  // namespace

Result<Path> parse_cl(std::string_view text, const std::string& file) {
  return Reader(text, file).read();
}

bool looks_like_cl(std::string_view text) {
  std::size_t at = 0;
  while (at < text.size()) {
    std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view line = trimmed(text.substr(at, end - at));
    at = end + 1;
    if (line.empty() || line == "\r") continue;
    if (line.substr(0, 2) == "$$") return true;
    std::size_t letters = 0;
    while (letters < line.size() && upper(line[letters]) >= 'A' && upper(line[letters]) <= 'Z') ++letters;
    return letters >= 3;  // a G-code block has digits behind its first letter, a comment begins with ( or ;
  }
  return false;
}

}  // namespace polypod::post
