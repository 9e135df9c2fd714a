// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Runs a program as LinuxCNC's interpreter does: canonical calls as text, and the same motion as plain blocks.
#pragma once

#include <fmt/format.h>

#include <array>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "expression.hpp"
#include "fixed.hpp"
#include "polypod/gcode/explain.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "text.hpp"

namespace polypod::gcode {

using Axes = std::array<double, 6>;        // X, Y, Z in program units; A, B, C in deg
using ToolOffset = std::array<double, 9>;  // and U, V, W

struct Tool {
  int number = 0;
  int pocket = 0;
  ToolOffset offset{};  // inches and deg
  double diameter = 0;  // inches
  double front_angle = 0;
  double back_angle = 0;
  int orientation = 0;
};

struct EngineOptions {
  std::vector<Tool> tools;
  bool any_tool = false;  ///< tools that the table does not hold are taken, with an unknown length
  /// With `any_tool`: diameters by tool number, m, and that of a tool in the spindle without one (0: not known).
  std::map<int, double> diameters;
  double diameter = 0;
  /// A parameter file: number and value, lengths in inches.
  std::map<int, double> parameters;
  /// Whether the machine's zero and the start are known, as rs274 takes them to be.
  bool machine_known = true;
  bool block_delete = false;
  std::map<int, MCode> m_codes = {};  ///< InterpretOptions::m_codes
  bool text = true;                   ///< write canonical calls
  bool plain = false;                 ///< write plain blocks
  bool files = true;                  ///< whether files beside the program are read
  bool checks = false;                ///< judge words: only for programs that `interpret` has not judged
  long most_lines = 5'000'000;
};

/// Of a NURBS curve, program units.
struct ControlPoint {
  double x = 0;
  double y = 0;
  double weight = 1;
};

class Engine final : private Parameters {
 public:
  Engine(const Program& program, EngineOptions options);
  Status run();
  std::string take_text();
  /// The same, where it may be long.
  LongVector<char> take_long_text() {
    spill();
    return std::move(long_out_);
  }
  Program take_plain();
  /// The file of each plain block; empty for the program itself.
  [[nodiscard]] std::string file_of(std::size_t plain_block) const {
    const std::size_t source = plain_sources_[plain_block];
    return source == 0 ? std::string() : sources_[source]->program->path;
  }
  std::vector<std::string> take_notes() { return std::move(notes_); }
  /// Where the program ended without M2, M30 or a closing %.
  [[nodiscard]] bool ended() const { return ends_; }
  /// Runs up to a line, then that line alone (explain.cpp).
  Result<Explanation> explain(int line);

 private:
  static constexpr std::string_view kNoNumber = "N..... ";
  static constexpr std::string_view kAxisLetters = "XYZABC";

  // --- control.cpp: lines, subprograms, loops -------------------------------------------------------------------
  struct Source {
    Program own;  // of a file beside the program
    const Program* program = nullptr;
  };
  struct LabelUse {
    std::string keyword;  // if, while, do, repeat
    std::size_t line = 0;
  };
  /// The modes that M70 and M73 save, for M72 and the end of a subprogram.
  struct Modes {
    bool inches = false;
    bool inverse = false;
    double feed = 0;
    double speed = 0;
    int turning = 0;
    Plane plane = Plane::xy;
    int side = 0;
    bool tool_offset = false;
    int system = 1;
    int path_mode = 640;
    double tolerance = 0;
    double cam_tolerance = 0;
    bool incremental = false;
    bool arc_absolute = false;
    bool old_level = false;
    bool mist = false;
    bool flood = false;
    bool feed_override = true;
    bool adaptive_feed = false;
    bool feed_hold = true;
    bool g92 = false;  // whether its offset is in force
  };
  struct Frame {
    std::size_t source = 0;
    std::size_t at = 0;              // the next line
    std::string name;                // of the subprogram
    bool by_number = false;          // called by M98: numbered parameters are those of the caller
    long repeats = 0;                // of M98 L
    std::size_t begin = 0;           // the line after its head
    std::array<double, 30> saved{};  // #1 to #30 of the caller
    std::array<bool, 30> saved_told{};
    std::map<std::string, double> locals;
    std::map<std::string, LabelUse> labels;
    std::optional<Modes> modes;  // saved by M70 or M73
    bool restores = false;       // by M73: they come back where the subprogram ends
  };
  void begin();  // the canonical calls before the first line
  void spill() {
    long_out_.append(out_.data(), out_.size());
    out_.clear();
  }
  Status run_lines();
  Status step();
  Status percent(const Block& block);
  Status execute(const Block& block);
  Status control(const Line& line, const Block& block);
  Status call(const std::string& label, const std::vector<double>& arguments, const Block& block, int column);
  Status call_by_number(const Block& block);
  [[nodiscard]] bool in_or_before_o_words() const;
  Status return_from(const Block& block);
  Status leave();
  Status skip_to(const std::string& label, std::initializer_list<std::string_view> keywords, const Block& block);
  void note_once(std::string note);
  Status leave_loop(const std::string& label, std::string_view end, std::size_t head, const Block& block);
  void pass_break(const std::string& label, bool runs);
  Result<std::pair<std::size_t, std::size_t>> find_sub(const std::string& label, const Block& block, int column,
                                                       bool by_number);
  /// The label and the keyword of a line with an O word, a computed label with the parameters as they are now.
  [[nodiscard]] std::optional<std::pair<std::string, std::string>> o_word(std::string_view text) const;
  Result<std::optional<Line>> read_passed(const Block& block);
  /// Where `sub` of a label, or the label alone, stands first from a line on, as far as the file is read.
  [[nodiscard]] std::optional<std::size_t> first_of(const std::string& label, const Source& source,
                                                    std::size_t from) const;
  /// Whether LinuxCNC stops reading at a line that it does not run: a '%' where the program began with one.
  [[nodiscard]] bool ends_file(std::string_view text) const { return percent_ && is_percent(text); }
  Status assign(const Line& line, const Block& block);
  Frame& frame() { return frames_.back(); }
  Source& source() { return *sources_[frame().source]; }

  // --- modes.cpp: M70 to M73 ------------------------------------------------------------------------------------
  [[nodiscard]] Modes modes() const;
  Status save_or_restore(int m);
  Status restore(const Modes& saved, int column);
  Status run_words(const std::vector<Word>& words);

  // --- parameters.cpp -------------------------------------------------------------------------------------------
  [[nodiscard]] tl::expected<double, std::string> numbered(int index) const override;
  [[nodiscard]] bool compensates() const override { return side_ != 0; }
  [[nodiscard]] tl::expected<std::optional<double>, std::string> named(const std::string& name) const override;
  [[nodiscard]] std::optional<double> predefined(std::string_view name) const;
  [[nodiscard]] double inches(double length) const { return inches_ ? length : length / 25.4; }
  [[nodiscard]] double lengths(double inches) const { return inches_ ? inches : inches * 25.4; }
  /// Whether the program itself has given #1 to #5000 its value; else the controller holds what a run before has left.
  [[nodiscard]] bool told(int index) const { return told_[static_cast<std::size_t>(index)]; }
  double& parameter(int index) { return parameters_[static_cast<std::size_t>(index)]; }
  [[nodiscard]] double parameter(int index) const { return parameters_[static_cast<std::size_t>(index)]; }

  // --- engine.cpp, settings.cpp, tools.cpp, motion.cpp, judge.cpp, messages.cpp: blocks
  // ---------------------------------------------------------------------------------------
  /// A canonical call that does not wait for the end of a compensated move before it, as some of rs274's do not.
  void put_now(std::string_view text) {
    if (!options_.text) return;
    constexpr std::size_t kWidth = 5;
    const std::size_t before = out_.size();
    append_whole(out_, static_cast<std::uint64_t>(++calls_));
    if (out_.size() < before + kWidth) out_.insert(before, before + kWidth - out_.size(), ' ');
    out_ += ' ';
    out_ += number_;
    out_ += text;
    out_ += '\n';
  }
  void put(std::string_view text) {
    if (waiting_.empty()) return put_now(text);
    if (!options_.text) return;
    Waiting call;
    call.text = text;
    waiting_.push_back(std::move(call));
  }
  template <class... T>
  void put(fmt::format_string<T...> format, T&&... values) {
    if (options_.text) put(std::string_view(fmt::format(format, std::forward<T>(values)...)));
  }
  static std::string list(const Axes& p) { return with_list("", p); }
  /// `begin` and the coordinates behind it.
  static std::string with_list(std::string_view begin, const Axes& p) {
    std::string text(begin);
    for (std::size_t k = 0; k < p.size(); ++k) {
      if (k > 0) text += ", ";
      append_fixed(text, p[k]);
    }
    return text;
  }
  [[nodiscard]] tl::unexpected<Error> error(int column, std::string_view id, std::string message,
                                            std::string_view hint) const;
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
  [[nodiscard]] int integer(char letter) const;
  [[nodiscard]] static std::optional<int> whole(const Word& word);
  [[nodiscard]] const Word* g_word(int tenfold) const;
  template <class... T>
  [[nodiscard]] int one_of(char letter, T... codes) const {
    for (const Word& word : block_->words) {
      if (word.letter != letter) continue;
      const int tenfold = static_cast<int>(word.value * 10 + 0.5);
      if (((tenfold == codes) || ...)) return tenfold;
    }
    return -1;
  }
  [[nodiscard]] bool axis_words() const;

  void read_number(std::string_view text);
  Status block(const Block& block);
  Status check();
  Status comment();
  void feed_and_speed();
  void switch_kinematics();
  [[nodiscard]] Result<std::size_t> index_of(const Word& word) const;
  Status tools();
  Status spindle();
  void switches();
  Status settings();
  Status length_offset(int g);
  Status origin();
  Status shift();
  /// What G92.3 takes up again.
  void store_shift();
  Status set_system(bool from_here);
  Status set_tool(int l);
  Status go_home(int g);
  Status motion();
  Status arc(const Axes& end);
  Status spline(int motion);
  Status control_point(bool first);
  Status end_nurbs();
  void curve_to(const Axes& p);
  Status judge_within_nurbs() const;
  Status probe(const Axes& end);
  Status stop();
  Status end_program(bool pallet);
  void set_path_mode();
  [[nodiscard]] Axes target() const;
  [[nodiscard]] bool polar() const { return find('@') != nullptr || find('^') != nullptr; }
  void polar_from(Axes& p) const;
  /// A length in mm, in program units.
  [[nodiscard]] double inches_tolerance(double mm) const { return inches_ ? mm / 25.4 : mm; }

  // --- compensation.cpp: cutter radius compensation ------------------------------------------------------------
  using Point = std::array<double, 2>;  // X and Y, program units
  /// A canonical call that waits: where a compensated move ends is known when the next one is.
  struct Waiting {
    enum class Kind { text, straight, arc } kind = Kind::text;
    std::string text;
    Axes end{};
    Point step{};       // straight: from its programmed start to its programmed end
    Point centre{};     // arcs
    double radius = 0;  // arcs: that of the compensated path
    double sweep = 0;   // arcs: as programmed, rad, without whole turns
    int turns = 0;      // arcs: above 0 counterclockwise
    bool rapid = false;
    bool entry = false;
    // For the plain program.
    int line = 0;
    std::size_t late = 0;  // its place in `late_`
    std::array<bool, 6> named{};
    bool incremental = false;
    bool arc_absolute = false;
    double rate = 0;  // under G93: program units per minute
  };
  [[nodiscard]] bool compensating() const { return side_ != 0 && cutter_radius_ > 0; }
  /// Where programmed distances count from.
  [[nodiscard]] const Axes& programmed() const { return compensating() ? programmed_ : current_; }
  /// `begins`: of the block that turns it on, after which LinuxCNC takes offsets, modes and motion.
  [[nodiscard]] Status judge_compensated(bool begins = false) const;
  Status compensation(int g);
  Result<double> cutter_diameter(int g);
  Status compensated_line(const Axes& end, bool rapid);
  Status compensated_arc(const Axes& end, const Point& centre, int turns);
  Status corner(double turn, const Point& start, const Axes& end, bool rapid);
  Status enter(Waiting move, double heading, const Point& tool);
  [[nodiscard]] bool is_inside(double turn, bool around) const;
  [[nodiscard]] Point beside(const Point& p, double heading) const;
  [[nodiscard]] Point tool_place() const { return {current_[0], current_[1]}; }
  Status end_waiting_at(const Point& p);
  Status settle();
  Status release();
  Status judge_path(const Waiting& move) const;
  [[nodiscard]] std::string compensated_words(const Waiting& move) const;
  void wait_for(Waiting move);

  // --- explain.cpp ---------------------------------------------------------------------------------------------
  [[nodiscard]] std::string meaning_of(const Word& word, const std::vector<Word>& words) const;
  [[nodiscard]] std::vector<Explanation::Meaning> in_force() const;

  // --- cycles.cpp -----------------------------------------------------------------------------------------------
  Status cycle(int before);

  // --- coordinates.cpp ----------------
  /// Whether the program itself has said where a work coordinate system lies, in X, Y and Z: then the plain program
  /// stays in one that the job gives.
  [[nodiscard]] bool is_own(int system) const {
    return !options_.machine_known && system != plain_system_ &&
           (own_axes_[static_cast<std::size_t>(system - 1)] & 7U) == 7U;
  }
  void note_own_offset();
  void select(int index);                   // takes origin and rotation of a work coordinate system
  [[nodiscard]] Axes stored_shift() const;  // of G92, as the parameters have it
  void print_system(int index, bool with_g92);
  [[nodiscard]] Axes to_machine(const Axes& p) const;
  [[nodiscard]] Axes from_machine(const Axes& p) const;
  void forget(std::size_t axis);
  void keep_place(const std::function<void()>& change);  // changes the frame; the machine stays where it is

  // Primitive motions: canonical call, plain block, new position.
  void traverse(const Axes& end);
  void feed(const Axes& end, bool by_inverse_time);
  void dwell(double seconds);
  void move_to(const Axes& end);

  // --- plain.cpp ---------------
  static constexpr std::size_t kNow = std::numeric_limits<std::size_t>::max();
  struct Motion {
    std::string text;
    std::size_t late = kNow;  // the place in `late_` of a compensated motion, whose text is known later
  };
  struct Late {
    std::size_t block = 0, offset = 0;  // where it belongs in `plain_`
    std::string words;                  // empty until they are known
  };
  void begin_plain();
  void end_plain();
  void plain(std::string text) { motions_.push_back({std::move(text)}); }
  [[nodiscard]] std::string plain_words(const Axes& end, bool all) const;
  [[nodiscard]] Axes to_plain(const Axes& p) const;
  [[nodiscard]] std::string plain_number(double value, bool step) const;
  void add_plain(std::string_view text, bool as_it_is = false);
  [[nodiscard]] bool shifted() const;

  EngineOptions options_;
  std::string out_;            // the newest of the text
  LongVector<char> long_out_;  // what came before it
  std::string number_;
  int calls_ = 0;
  std::vector<std::string> notes_;
  Program plain_;
  LongVector<std::uint32_t> plain_sources_;

  // Control.
  std::vector<std::unique_ptr<Source>> sources_;
  /// Where subprograms stand, by source and line, that the program has come to, and those that it called before.
  std::map<std::string, std::pair<std::size_t, std::size_t>> subs_;  // source and line of those passed or called
  std::vector<Frame> frames_;
  std::vector<double> parameters_;
  std::vector<bool> told_;
  /// What is left of `repeat` loops, by subprogram and label: LinuxCNC 2.9 keeps it where one is left early.
  std::map<std::pair<std::string, std::string>, long> repeats_left_;
  std::unordered_map<std::string, double> globals_;
  double returned_value_ = 0;
  bool returned_ = false;
  bool returned_is_told_ = true;  // not: it depends on what the controller holds
  bool percent_ = false;
  bool closes_ = false;  // a percent sign stands behind M2
  bool ends_ = false;
  bool finished_ = false;  // by the closing %
  long lines_ = 0;
  int until_ = 0;  // the line of the program before which to stop; 0: none
  bool break_passed_ = false;
  bool continued_ = false;  // by the `continue` of a `do` loop

  // The block at hand.
  Block here_;     // the line that runs
  Block other_;    // one that is looked at
  Block scratch_;  // the line with its expressions evaluated
  std::vector<Word> scratch_words_;
  const Block* block_ = nullptr;
  const Block* written_block_ = nullptr;  // its line in the file
  bool rewritten_ = false;
  bool name_axes_ = true;  // whether a plain motion holds the axes that the block names, else those that change
  std::vector<Motion> motions_;

  // What carries over.
  Axes origin_{};        // of the active system, program units
  double rotation_ = 0;  // deg
  Axes g92_{};
  int active_ = 1;
  std::array<Axes, 6> plain_origins_{};  // of G54 ... G59 as the plain program has them, mm
  int plain_system_ = 1;
  Axes current_{};  // where the interpreter is
  Axes canon_{};    // where the last move ended; a new tool length shows only in `current_`
  std::array<bool, 6> known_{};
  std::array<bool, 6> known_as_tip_{};  ///< before an M code made the controller take words for joints
  bool in_joints_ = false;
  bool resync_ = false;      // after a tool change rs274 asks where it is, and forgets a new tool length
  bool drawn_back_ = false;  // by hand (G88): `current_` is above the hole, `canon_` at its bottom
  ToolOffset length_offset_{};
  Tool loaded_;
  std::size_t loaded_pocket_ = 1;
  double told_pocket_ = 1, told_selected_ = -1;  // #<_current_pocket> and #<_selected_pocket>, which know no tool 0
  bool in_message_ = false;                      // a message tells what a line may not
  std::size_t selected_ = 0;
  int selected_number_ = -1;
  int motion_ = -1;  // times ten
  Plane plane_ = Plane::xy;
  int path_mode_ = 640;
  double tolerance_ = 0;
  double cam_tolerance_ = 0;
  bool inches_ = false;
  bool inverse_ = false;
  bool incremental_ = false;
  bool arc_absolute_ = false;
  bool old_level_ = false;  // G98
  bool mist_ = false;
  bool flood_ = false;
  bool feed_override_ = true;
  bool speed_override_ = true;
  bool adaptive_feed_ = false;
  bool feed_hold_ = true;
  int turning_ = 0;  // 1 clockwise, -1 counterclockwise
  double feed_ = 0;
  double speed_ = 0;
  bool tool_offset_ = false;

  int plain_motion_ = -1;               // the motion word in force in the plain program
  int motion_before_ = -1;              // the same before the block at hand
  bool g92_told_ = false;               // whether the program itself has set the offset of G92
  std::array<bool, 9> set_{};           // work coordinate systems that the program has set itself
  std::array<unsigned, 9> own_axes_{};  // a bit for each of their axes that it has set
  bool own_offsets_noted_ = false;
  std::array<double, 2> spline_tangent_{};
  bool after_spline_ = false;
  bool spline_now_ = false;
  // NURBS, between G5.2 and G5.3.
  static constexpr int kNurbsEnded = -10;     // the motion mode after G5.3: none, which rs274 tells as -1
  std::vector<ControlPoint> control_points_;  // the first is where the tool is
  std::size_t nurbs_order_ = 3;

  // Cutter radius compensation.
  double rate_ = 0;               // under G93: program units per minute of the last feed move
  int side_ = 0;                  // of the path, where the tool is: 1 left, -1 right, 0 off
  double cutter_radius_ = 0;      // program units
  bool entering_ = false;         // no move yet
  bool left_ = false;             // compensation has ended, and no move has followed: the tool is beside `current_`
  bool line_is_next_ = false;     // after G40
  bool stopped_ = false;          // M0, M1 or M60 has let the last move end beside its programmed end
  Axes programmed_{};             // `current_` is where the tool is, if nothing follows
  double heading_ = 0;            // at the end of the last move, rad
  std::optional<Waiting> last_;   // the last move with a length
  std::optional<Point> reached_;  // where the tool is, once two moves have been made
  std::vector<Waiting> waiting_;
  std::vector<Late> late_;
  Tool loaded_before_;       // the block at hand
  bool stale_tool_ = false;  // M61 or T0: rs274 keeps the diameter of the tool before
  int spindle_tool_ = 0;

  // The cycle in force.
  double cycle_bottom_ = 0;
  double cycle_r_ = 0;
  double cycle_p_ = 0;
  double cycle_q_ = 0;
  std::array<double, 3> cycle_offsets_{};  // I, J and K of G87
  double cycle_level_ = 0;                 // where the series of cycles began
  bool new_series_ = false;                // a spline has ended the one before
};

/// What a run begins with: tools and parameters read, a program of plain blocks judged, behind the line `until` not (0:
/// all of it). Errors: those of `interpret`, GC152, FI100.
Result<EngineOptions> engine_options(const Program& program, const CanonOptions& options, int until = 0);

}  // namespace polypod::gcode
