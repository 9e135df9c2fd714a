// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// G-code for LinuxCNC.
#include "polypod/post/write.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/writer.hpp"
#include "writing.hpp"

namespace polypod::post {

std::string plain_text(std::string_view text, std::size_t longest) {
  std::string out;
  for (const char c : one_line(text)) out += c >= ' ' && c <= '~' ? c : '?';
  if (out.size() > longest) out.resize(longest);
  return out;
}

void set_for(Dialect dialect, PlanOptions& options) {
  constexpr double kRobotArc = 2 * std::numbers::pi / 3;  // three points make a circle well up to there
  const bool robot = dialect != Dialect::ngc;
  options.between = robot ? Between::turn : Between::angles;
  options.length_offsets = !robot;
  options.arcs_in_any_plane = robot;
  options.largest_sweep = robot ? kRobotArc : 0;
  options.tilts_with_work = robot;
}

namespace {

constexpr int kDecimals = 6;
constexpr int kFeedDecimals = 4;
constexpr double kMostInverse = 1e8;  // 1/min, for ways of no length
constexpr std::size_t kLongestComment = 200;

std::string comment_of(std::string_view text) {
  std::string out = plain_text(text, kLongestComment);
  for (char& c : out) {
    if (c == '(') c = '[';
    if (c == ')') c = ']';
    if (c == '%') c = '_';
    if (c == ';') c = ',';
  }
  return "(" + out + ")";
}

class NgcWriter {
 public:
  NgcWriter(const Configuration& configuration, const Path& path, const Plan& plan, const WriteOptions& options)
      : rotary_(configuration.rotary), path_(path), plan_(plan), options_(options) {}

  Written write() {
    for (const std::string& text : options_.header) line(comment_of(text));
    // What a program does not say stays as it is on the controller: its tool length and its path mode.
    line(path_.program ? "G21 G17 G90 G91.1 G94 G40 G80 G54" : "G21 G17 G90 G91.1 G94 G40 G49 G80 G54");
    if (!path_.program || options_.blend_overrides)
      line(options_.blend > 0 ? fmt::format("G64 P{}", number(units::to_mm(options_.blend), kDecimals)) : "G61");
    if (options_.inverse_time) line("G93");
    std::size_t next = 0;
    for (std::size_t i = 0; i < path_.steps.size(); ++i) {
      const Step& step = path_.steps[i];
      if (step.kind == StepKind::comment) {
        line(comment_of(path_.program ? step.text : "note: " + step.text));
        continue;
      }
      if (!path_.program) state(step);
      if (step.kind == StepKind::words) words(step);
      if (step.kind == StepKind::stop) line(step.text.empty() ? "M0" : step.text);
      if (step.kind == StepKind::optional_stop) line("M1");
      if (step.kind == StepKind::dwell) line("G4 P" + number(step.seconds, 4));
      if (step.moves() && !step.placed()) rapid(step);
      for (; next < plan_.moves.size() && plan_.moves[next].step == static_cast<int>(i); ++next)
        move(plan_.moves[next], step);
    }
    if (spindle_ != gcode::Spindle::off) line("M5");
    if (coolant_ != Coolant::off) line("M9");
    line(path_.end);
    return std::move(out_);
  }

 private:
  void line(const std::string& text) {
    out_.text += text + "\n";
    ++out_.lines;
  }

  void state(const Step& step) {
    if (step.tool != tool_) {
      line(fmt::format("T{} M6", step.tool));
      tool_ = step.tool;
      spindle_ = gcode::Spindle::off;  // LinuxCNC stops it for the change
    }
    const bool turns = step.spindle != gcode::Spindle::off;
    if (step.spindle != spindle_ || (turns && step.spindle_speed != speed_)) {
      if (!turns) {
        line("M5");
      } else {
        line(fmt::format("S{} {}", number(units::to_per_min(step.spindle_speed), 3),
                         step.spindle == gcode::Spindle::clockwise ? "M3" : "M4"));
        speed_ = step.spindle_speed;
      }
      spindle_ = step.spindle;
    }
    if (step.coolant != coolant_) {
      if (step.coolant != Coolant::off && coolant_ != Coolant::off) line("M9");
      line(step.coolant == Coolant::off ? "M9" : step.coolant == Coolant::mist ? "M7" : "M8");
      coolant_ = step.coolant;
    }
  }

  void words(const Step& step) {
    if (step.path_mode && options_.blend_overrides) return;
    line(step.text);
    if (step.length_offset)
      for (const char letter : {'X', 'Y', 'Z'}) last_[static_cast<std::size_t>(letter - 'A')].clear();
  }

  /// A rapid to a place that is not known whole: the axes that are.
  void rapid(const Step& step) {
    std::string block;
    for (int i = 0; i < 3; ++i)
      if (step.known[static_cast<std::size_t>(i)]) word(block, "XYZ"[i], units::to_mm(step.tip[i]));
    if (block.empty()) return;
    if (motion_ != "G0") block = " G0" + block;
    motion_ = "G0";
    line(block.substr(1));
    ++out_.moves;
  }

  /// The word of an axis if its text is new.
  void word(std::string& block, char letter, double value, bool always = false) {
    const std::string text = number(value, kDecimals);
    std::string& last = last_[static_cast<std::size_t>(letter - 'A')];
    if (text == last && !always) return;
    last = text;
    block += fmt::format(" {}{}", letter, text);
  }

  void move(const PlannedMove& m, const Step& step) {
    std::string block;
    const Vec3 start = tip_;
    for (int i = 0; i < 3; ++i) word(block, "XYZ"[i], units::to_mm(m.tip[i]));
    if (rotary_ != Rotary::none && (step.turned || plan_.sets_c)) {
      word(block, 'A', units::to_deg(m.angles.x()));
      if (rotary_ != Rotary::ac) word(block, 'B', units::to_deg(m.angles.y()));
      if (rotary_ != Rotary::ab) word(block, 'C', units::to_deg(m.angles.z()));
    }
    tip_ = m.tip;
    if (block.empty() && m.kind != StepKind::arc) return;  // nothing that the digits show
    std::string motion = m.kind == StepKind::rapid ? "G0" : "G1";
    if (m.kind == StepKind::arc) {
      const int axis = std::abs(m.normal.z()) > 0.5 ? 2 : std::abs(m.normal.y()) > 0.5 ? 1 : 0;
      constexpr const char* kPlanes[] = {"G19", "G18", "G17"};
      if (axis != plane_) line(kPlanes[axis]);
      plane_ = axis;
      motion = m.normal[axis] > 0 ? "G3" : "G2";
      for (int i = 0; i < 3; ++i) {
        if (i != axis) block += fmt::format(" {}{}", "IJK"[i], number(units::to_mm(m.centre[i] - start[i]), kDecimals));
      }
      const int turns = static_cast<int>(std::ceil(m.sweep / (2 * std::numbers::pi) - 1e-9));
      if (turns > 1) block += fmt::format(" P{}", turns);
    }
    if (motion != motion_) block = " " + motion + block;
    motion_ = motion;
    if (m.kind != StepKind::rapid) {
      // Nothing says how far the first cut goes: it has its own feed, and no time.
      const bool first = &m == plan_.moves.data(), turn = m.length < kNoWay && !first;
      if (first && options_.inverse_time) block = " G94" + block;
      const double feed = options_.inverse_time && !first
                              ? std::min(m.seconds > 0 ? 60 / m.seconds : kMostInverse, kMostInverse)
                          : turn ? units::to_deg(options_.turn_speed) * 60
                                 : units::to_mm_per_min(step.feed);
      const std::string f = number(feed, kFeedDecimals);
      if (options_.inverse_time || f != feed_) block += " F" + (f == "0" ? std::string("0.0001") : f);
      feed_ = f;
    }
    line(block.substr(1));
    if (&m == plan_.moves.data() && options_.inverse_time && m.kind != StepKind::rapid) line("G93");
    ++out_.moves;
  }

  Rotary rotary_;
  const Path& path_;
  const Plan& plan_;
  const WriteOptions& options_;
  Written out_;
  std::array<std::string, 26> last_;
  std::string motion_, feed_;
  Vec3 tip_ = Vec3::Zero();
  int plane_ = 2, tool_ = 0;
  gcode::Spindle spindle_ = gcode::Spindle::off;
  double speed_ = 0;
  Coolant coolant_ = Coolant::off;
};

}  // namespace

Result<Written> write(Dialect dialect, const Configuration& configuration, const Path& path, const Plan& plan,
                      const WriteOptions& options) {
  if (dialect == Dialect::ngc) return NgcWriter(configuration, path, plan, options).write();
  return write_robot(dialect, configuration, path, plan, options);
}

}  // namespace polypod::post
