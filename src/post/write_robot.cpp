// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The languages of robots: KUKA KRL, ABB RAPID, URScript.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <numbers>
#include <set>
#include <sstream>

#include "polypod/core/units.hpp"
#include "polypod/families/serial/carried_arm.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machine/urdf.hpp"
#include "writing.hpp"

namespace polypod::post {
namespace {

constexpr std::size_t kLongestComment = 120;
constexpr double kSmallestZone = 1e-7;  // m, of RAPID: the last of its four decimals of mm
constexpr double kBlendOfWay = 0.45;    // of the shorter way beside a corner, in URScript: two blends must not meet
constexpr double kZero = 1e-6;  // rad, a joint this near to 0 or a quarter turn is there: rounding of the inverse

/// A text as comments that a controller takes, broken at blanks.
std::vector<std::string> comment_lines(const std::string& text) {
  std::string rest = plain_text(text, 100 * kLongestComment);
  std::vector<std::string> out;
  while (rest.size() > kLongestComment) {
    const std::size_t blank = rest.rfind(' ', kLongestComment);
    const std::size_t end = blank == std::string::npos || blank == 0 ? kLongestComment : blank;
    out.push_back(rest.substr(0, end));
    rest.erase(0, rest[end] == ' ' ? end + 1 : end);
  }
  out.push_back(std::move(rest));
  return out;
}

/// What one of the languages keeps for itself (KRL, RAPID, URScript), in lower case.
bool is_reserved(std::string name) {
  static const std::set<std::string> kWords = [] {
    std::istringstream words(
        "alias and anin anout axis backward bool brake break case cast_from cast_to char circ circ_rel confirm connect "
        "const continue decl def defdat default deffct delay digin distance div do e3axis e3pos e6axis e6pos elif else "
        "elseif end enddat endfct endfor endfunc endif endloop endmodule endproc endrecord endswitch endtest endtrap "
        "endwhile enum error exit ext extfct extp false for frame from func global goto halt if import in inout int "
        "interrupt is join kill lin lin_rel local loop maximum minimum mod module none nostepin not noview num off on "
        "or pass perl pers pos proc ptp ptp_rel public raise readonly real record repeat resume retry return run sec "
        "signal spline step stepin string struc struct switch swrite sysmodule test then thread to trap trigger true "
        "trynext undo until var viewonly wait when while with xor b_and b_exor b_not b_or");
    return std::set<std::string>(std::istream_iterator<std::string>(words), {});
  }();
  for (char& c : name) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return kWords.count(name) > 0;
}

/// Letters, digits and `_`, a letter first; no word of a language.
std::string identifier(const std::string& name, std::size_t longest) {
  std::string out;
  for (const char c : name) {
    const bool good = (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
    out += good ? c : '_';
  }
  if (out.empty() || !((out[0] >= 'A' && out[0] <= 'Z') || (out[0] >= 'a' && out[0] <= 'z')) || is_reserved(out))
    out = "P_" + out;
  if (out.size() > longest) out.resize(longest);
  return out;
}

/// One statement and whether it moves the robot.
struct Line {
  std::string text;
  bool moves = false;
};

/// What a language prints; the order of statements is that of write_robot.
class Language {
 public:
  /// `external`: the axis that carries the arm, of which languages write where it stands; nullptr where there is none.
  Language(const WriteOptions& options, const machine::DhRow* external) : options_(options), external_(external) {}
  virtual ~Language() = default;
  Language(const Language&) = delete;
  Language& operator=(const Language&) = delete;

  virtual void begin(const Pose& X_BW, const Pose& X_FT) = 0;
  virtual void first(const PlannedMove& m, const Posture& posture) = 0;
  virtual void line(const PlannedMove& m, const Posture& posture, double speed, double blend) = 0;
  virtual void arc(const PlannedMove& m, const Posture& posture, double speed, double blend) = 0;
  virtual void comment(const std::string& text) = 0;
  virtual void stop(bool optional) = 0;
  virtual void dwell(double seconds) = 0;
  [[nodiscard]] virtual std::string text(const std::string& name) const = 0;
  /// The data list of the program; empty where the language has none.
  [[nodiscard]] virtual std::string data(const std::string&) const { return ""; }

 protected:
  void add(std::string text, bool moves = false) { body_.push_back({std::move(text), moves}); }

  /// The body in subprograms of so many moves: begin and end of each, and how it is called.
  [[nodiscard]] std::vector<std::vector<std::string>> parts() const {
    std::vector<std::vector<std::string>> out(1);
    int moves = 0;
    for (const Line& l : body_) {
      if (options_.moves_per_part > 0 && l.moves && moves == options_.moves_per_part) {
        out.emplace_back();
        moves = 0;
      }
      moves += l.moves;
      out.back().push_back(l.text);
    }
    return out;
  }

  /// Where the external axis stands, in mm or deg; empty where there is none.
  [[nodiscard]] std::string external(double at) const {
    if (external_ == nullptr) return "";
    const bool turns = external_->kind == machine::JointKind::revolute;
    return number(turns ? units::to_deg(at) : units::to_mm(at), turns ? 6 : 4);
  }

  const WriteOptions& options_;
  const machine::DhRow* external_;
  std::vector<std::string> head_;
  std::vector<Line> body_;
};

std::string joined(const Vec3& v, double scale, int decimals) {
  return fmt::format("{},{},{}", number(v.x() * scale, decimals), number(v.y() * scale, decimals),
                     number(v.z() * scale, decimals));
}

// KUKA KRL ------------------------------------------------------------------------------------------------------------

class Krl final : public Language {
 public:
  using Language::Language;

  void begin(const Pose& X_BW, const Pose& X_FT) override {
    head_.push_back("BAS(#INITMOV,0)");
    head_.push_back("$BASE=" + datum("FRAME", kBase, frame(X_BW) + "}"));
    head_.push_back("$TOOL=" + datum("FRAME", kTool, frame(X_FT) + "}"));
    if (options_.blend > 0) {
      blend_ = fmt::format("$APO.CDIS={}", number(units::to_mm(options_.blend), 4));
      head_.push_back(blend_);
    }
  }
  void first(const PlannedMove& m, const Posture& posture) override {
    const char* type = external_ == nullptr ? "POS" : "E6POS";
    add("PTP " + datum(type, kStart, frame({m.R, m.tip}) + bits(posture) + e1(m.external) + "}"), true);
  }
  void line(const PlannedMove& m, const Posture& posture, double speed, double blend) override {
    const bool turns_only = !(m.length > 0);
    turning(turns_only);
    if (!turns_only) velocity(speed);
    distance(blend);
    add("LIN " + frame({m.R, m.tip}) + bits(posture) + e1(m.external) + "}" + (blend > 0 ? " C_DIS" : ""), true);
  }
  void arc(const PlannedMove& m, const Posture& posture, double speed, double blend) override {
    turning(false);
    velocity(speed);
    distance(blend);
    add("CIRC " + frame({m.R_via, m.via}) + "}," + frame({m.R, m.tip}) + bits(posture) + e1(m.external) + "}" +
            (blend > 0 ? " C_DIS" : ""),
        true);
  }
  void comment(const std::string& text) override { add("; " + text); }
  void stop(bool optional) override { add(optional ? "; optional stop" : "HALT"); }
  void dwell(double seconds) override { add("WAIT SEC " + number(seconds, 4)); }

  [[nodiscard]] std::string text(const std::string& name) const override {
    const auto all = parts();
    std::string out = "&ACCESS RVP\n" + fmt::format("DEF {}( )\n", name);
    for (const std::string& h : options_.header)
      for (const std::string& line : comment_lines(h)) out += "; " + line + "\n";
    for (const std::string& h : head_) out += h + "\n";
    if (all.size() == 1) {
      for (const std::string& l : all[0]) out += l + "\n";
      return out + "END\n";
    }
    for (std::size_t i = 0; i < all.size(); ++i) out += fmt::format("{}_{}( )\n", name, i + 1);
    out += "END\n";
    for (std::size_t i = 0; i < all.size(); ++i) {
      out += fmt::format("\nDEF {}_{}( )\n", name, i + 1);
      for (const std::string& l : all[i]) out += l + "\n";
      out += "END\n";
    }
    return out;
  }
  [[nodiscard]] std::string data(const std::string& name) const override {
    if (!options_.data_list) return "";
    std::string out = "&ACCESS RVP\n" + fmt::format("DEFDAT {} PUBLIC\n", name);
    for (const std::string& d : data_) out += d + "\n";
    return out + "ENDDAT\n";
  }

 private:
  static constexpr const char *kBase = "WORK_BASE", *kTool = "WORK_TOOL", *kStart = "WORK_START";

  /// A value where it is used, or its name where it stands in the data list.
  std::string datum(const char* type, const char* name, std::string value) {
    if (!options_.data_list) return value;
    data_.push_back(fmt::format("DECL {} {}={}", type, name, value));
    return name;
  }
  /// {X, Y, Z, A, B, C without its closing bracket: A turns about z, B about y, C about x.
  static std::string frame(const Pose& X) {
    const Vec3 a = angles_abc(X.R);
    return fmt::format("{{X {},Y {},Z {},A {},B {},C {}", number(units::to_mm(X.p.x()), 4),
                       number(units::to_mm(X.p.y()), 4), number(units::to_mm(X.p.z()), 4),
                       number(units::to_deg(a.z()), 6), number(units::to_deg(a.y()), 6),
                       number(units::to_deg(a.x()), 6));
  }
  static std::string bits(const Posture& posture) {
    return fmt::format(",S {},T {}", posture.status(), posture.turns());
  }
  [[nodiscard]] std::string e1(double at) const { return external_ == nullptr ? "" : ",E1 " + external(at); }
  void velocity(double speed) {
    const std::string text = fmt::format("$VEL.CP={}", number(speed, 6));
    if (text != velocity_) add(text);
    velocity_ = text;
  }
  /// A move that turns the tool alone goes at a speed of its own; others are led by the speed of the tip.
  void turning(bool only) {
    const std::string speed = only ? number(units::to_deg(options_.turn_speed), 3) : "";
    if (speed == turning_) return;
    turning_ = speed;
    for (const char* which : {"ORI1", "ORI2"})
      add(fmt::format("$VEL.{}={}", which, only ? speed : fmt::format("$VEL_MA.{}", which)));
  }
  void distance(double blend) {
    if (blend <= 0) return;
    const std::string text = fmt::format("$APO.CDIS={}", number(units::to_mm(blend), 4));
    if (text != blend_) add(text);
    blend_ = text;
  }
  std::string velocity_, blend_, turning_;
  std::vector<std::string> data_;
};

// ABB RAPID -----------------------------------------------------------------------------------------------------------

class Rapid final : public Language {
 public:
  using Language::Language;

  void begin(const Pose& X_BW, const Pose& X_FT) override {
    head_.push_back(fmt::format("PERS tooldata tPart:=[TRUE,{},[1,[0,0,1],[1,0,0,0],0,0,0]];", pose(X_FT)));
    head_.push_back(fmt::format("PERS wobjdata wPart:=[FALSE,TRUE,\"\",[[0,0,0],[1,0,0,0]],{}];", pose(X_BW)));
    zone(std::max(options_.blend, kSmallestZone));
    add("ConfL\\Off;");
  }
  void first(const PlannedMove& m, const Posture& posture) override {
    add(fmt::format("MoveJ {},{},fine,tPart\\WObj:=wPart;", target({m.R, m.tip}, posture, m.external),
                    speed(options_.rapid_speed, false)),
        true);
    before_ = m.external;
  }
  void line(const PlannedMove& m, const Posture& posture, double v, double blend) override {
    add(fmt::format("MoveL {},{},{},tPart\\WObj:=wPart;", target({m.R, m.tip}, posture, m.external),
                    speed(v, m.length < kNoWay), zone(blend)),
        true);
    before_ = m.external;
  }
  void arc(const PlannedMove& m, const Posture& posture, double v, double blend) override {
    add(fmt::format("MoveC {},{},{},{},tPart\\WObj:=wPart;",
                    target({m.R_via, m.via}, posture, (before_ + m.external) / 2),
                    target({m.R, m.tip}, posture, m.external), speed(v, false), zone(blend)),
        true);
    before_ = m.external;
  }
  void comment(const std::string& text) override { add("! " + text); }
  void stop(bool optional) override { add(optional ? "! optional stop" : "Stop;"); }
  void dwell(double seconds) override { add(fmt::format("WaitTime {};", number(seconds, 3))); }

  [[nodiscard]] std::string text(const std::string& name) const override {
    const auto all = parts();
    std::string out = fmt::format("MODULE {}\n", name);
    for (const std::string& h : options_.header)
      for (const std::string& line : comment_lines(h)) out += "  ! " + line + "\n";
    for (const std::string& h : head_) out += "  " + h + "\n";
    out += "  PROC main()\n";
    if (all.size() == 1) {
      for (const std::string& l : all[0]) out += "    " + l + "\n";
      return out + "  ENDPROC\nENDMODULE\n";
    }
    for (std::size_t i = 0; i < all.size(); ++i) out += fmt::format("    part_{};\n", i + 1);
    out += "  ENDPROC\n";
    for (std::size_t i = 0; i < all.size(); ++i) {
      out += fmt::format("  PROC part_{}()\n", i + 1);
      for (const std::string& l : all[i]) out += "    " + l + "\n";
      out += "  ENDPROC\n";
    }
    return out + "ENDMODULE\n";
  }

 private:
  static std::string pose(const Pose& X) {
    Eigen::Quaterniond q(X.R);
    q.normalize();
    if (q.w() < 0) q.coeffs() = -q.coeffs();
    return fmt::format("[[{}],[{},{}]]", joined(X.p, units::kMmPerMetre, 4), number(q.w(), 9),
                       joined(Vec3(q.vec()), 1, 9));
  }
  [[nodiscard]] std::string target(const Pose& X, const Posture& posture, double at) const {
    const std::array<int, 4> cf = posture.conf();
    const std::string p = pose(X);
    return fmt::format("{},[{},{},{},{}],[{},9E9,9E9,9E9,9E9,9E9]]", p.substr(0, p.size() - 1), cf[0], cf[1], cf[2],
                       cf[3], external_ == nullptr ? "9E9" : external(at));
  }
  /// Its name; each distance has zone data of its own.
  std::string zone(double blend) {
    if (blend <= 0) return "fine";
    const auto data_mm = [](double m) { return number(units::to_mm(std::max(m, kSmallestZone)), 4); };
    const std::string data = fmt::format("[FALSE,{0},{0},{0},{1},{0},{1}]", data_mm(blend), data_mm(blend / 10));
    const auto known = zones_.find(data);
    if (known != zones_.end()) return known->second;
    const std::string name = zones_.empty() ? "zPart" : fmt::format("zPart{}", zones_.size() + 1);
    zones_[data] = name;
    head_.push_back(fmt::format("CONST zonedata {}:={};", name, data));
    return name;
  }
  std::map<std::string, std::string> zones_;
  double before_ = 0;  // where the external axis was

  /// [mm/s, deg/s, of external axes]
  std::string speed(double v, bool turn) const {
    return fmt::format("[{},{},5000,1000]", number(std::max(units::to_mm(v), 0.001), 3),
                       turn ? number(units::to_deg(options_.turn_speed), 3) : "500");
  }
};

// URScript ------------------------------------------------------------------------------------------------------------

class UrScript final : public Language {
 public:
  using Language::Language;

  void begin(const Pose& X_BW, const Pose& X_FT) override {
    head_.push_back("global work=" + pose(X_BW));
    head_.push_back("set_tcp(" + pose(X_FT) + ")");
  }
  void first(const PlannedMove& m, const Posture& posture) override {
    std::string near;
    for (const double q : posture.joints) near += (near.empty() ? "" : ",") + number(q, 5);
    add(fmt::format("movej(get_inverse_kin(pose_trans(work,{}),qnear=[{}]),a=1,v=0.5)", pose({m.R, m.tip}), near),
        true);
  }
  void line(const PlannedMove& m, const Posture&, double speed, double blend) override {
    // A turn without a way has a time instead of a speed.
    const std::string time = m.length < kNoWay ? fmt::format(",t={}", number(std::max(m.seconds, 0.01), 4)) : "";
    add(fmt::format("movel(pose_trans(work,{}),a={},v={}{},r={})", pose({m.R, m.tip}), number(options_.acceleration, 3),
                    number(speed, 6), time, number(time.empty() ? blend : 0, 6)),
        true);
  }
  void arc(const PlannedMove& m, const Posture&, double speed, double blend) override {
    add(fmt::format("movec(pose_trans(work,{}),pose_trans(work,{}),a={},v={},r={},mode=0)", pose({m.R_via, m.via}),
                    pose({m.R, m.tip}), number(options_.acceleration, 3), number(speed, 6), number(blend, 6)),
        true);
  }
  void comment(const std::string& text) override { add("# " + text); }
  void stop(bool optional) override {
    add(optional ? "# optional stop"
                 : "popup(\"program stop\",title=\"stop\",warning=False,error=False,blocking=True)");
  }
  void dwell(double seconds) override { add(fmt::format("sleep({})", number(seconds, 4))); }

  [[nodiscard]] std::string text(const std::string& name) const override {
    const auto all = parts();
    std::string out;
    for (const std::string& h : options_.header)
      for (const std::string& line : comment_lines(h)) out += "# " + line + "\n";
    out += fmt::format("def {}():\n", name);
    for (const std::string& h : head_) out += "  " + h + "\n";
    if (all.size() == 1) {
      for (const std::string& l : all[0]) out += "  " + l + "\n";
    } else {
      for (std::size_t i = 0; i < all.size(); ++i) {
        out += fmt::format("  def part_{}():\n", i + 1);
        for (const std::string& l : all[i]) out += "    " + l + "\n";
        out += "  end\n";
      }
      for (std::size_t i = 0; i < all.size(); ++i) out += fmt::format("  part_{}()\n", i + 1);
    }
    return out + "end\n" + name + "()\n";
  }

 private:
  static std::string pose(const Pose& X) {
    return fmt::format("p[{},{}]", joined(X.p, 1, 7), joined(rotation_vector(X.R), 1, 8));
  }
};

std::unique_ptr<Language> language_of(Dialect dialect, const WriteOptions& options, const machine::DhRow* external) {
  if (dialect == Dialect::krl) return std::make_unique<Krl>(options, external);
  if (dialect == Dialect::rapid) return std::make_unique<Rapid>(options, external);
  return std::make_unique<UrScript>(options, external);
}

/// "X 0 Y 0 Z 675 mm, A 0 B 0 C 90 deg".
std::string frame_in_words(const Pose& X) {
  const Vec3 a = angles_abc(X.R);
  return fmt::format("X {} Y {} Z {} mm, A {} B {} C {} deg", number(units::to_mm(X.p.x()), 3),
                     number(units::to_mm(X.p.y()), 3), number(units::to_mm(X.p.z()), 3),
                     number(units::to_deg(a.x()), 3), number(units::to_deg(a.y()), 3), number(units::to_deg(a.z()), 3));
}

std::string state_of(const Step& step) {
  const char* coolant = step.coolant == Coolant::off ? "coolant off" : step.coolant == Coolant::mist ? "mist" : "flood";
  const std::string spindle =
      step.spindle == gcode::Spindle::off
          ? "spindle off"
          : fmt::format("spindle {} rev/min {}", number(units::to_per_min(step.spindle_speed), 3),
                        step.spindle == gcode::Spindle::clockwise ? "clockwise" : "counterclockwise");
  return fmt::format("tool {}, {}, {}", step.tool, spindle, coolant);
}

}  // namespace

int Posture::status() const {
  return (overhead ? 1 : 0) + (bent ? 2 : 0) + (joints[4] < -kZero ? 4 : 0);
}

int Posture::turns() const {
  int bits = 0;
  for (std::size_t i = 0; i < joints.size(); ++i) bits |= (joints[i] < -kZero ? 1 : 0) << i;
  return bits;
}

std::array<int, 4> Posture::conf() const {
  const auto quadrant = [&](std::size_t i) {
    return static_cast<int>(std::floor((joints[i] + kZero) / (std::numbers::pi / 2)));
  };
  return {quadrant(0), quadrant(3), quadrant(5), (overhead ? 4 : 0) + (bent ? 0 : 2) + (joints[4] < -kZero ? 1 : 0)};
}

Posture posture_of(const Configuration& configuration, const machine::JointVector& joints) {
  Posture out;
  const auto* arm = std::get_if<machine::SerialArm>(&configuration.machine);
  if (arm == nullptr || joints.size() == 0) return out;
  // An external axis has no part in it.
  const auto carried = machine::CarriedArm::on_external_axis(*arm);
  machine::SerialArm whole = carried ? carried->arm() : *arm;
  machine::JointVector q(static_cast<Eigen::Index>(whole.dh.size()));
  int next = carried && carried->moves() ? 1 : 0;
  for (std::size_t i = 0; i < whole.dh.size(); ++i) {
    const double value = whole.dh[i].locked ? *whole.dh[i].locked : joints[next++];
    q[static_cast<int>(i)] = value;
    if (i < out.joints.size()) out.joints[i] = value;
    whole.dh[i].locked.reset();
  }
  if (whole.dh.size() == 6) whole.task = machine::Task::pose;
  if (!machine::has_closed_inverse(whole)) {
    // A calibrated arm is in the posture of the drawing's: its wrist meets in a point, its axes are square or parallel.
    constexpr double kSmall = 5e-3;  // m, rad
    for (std::size_t i = 0; i < whole.dh.size(); ++i) {
      machine::DhRow& row = whole.dh[i];
      const double square = std::round(row.alpha / (std::numbers::pi / 2)) * (std::numbers::pi / 2);
      if (std::abs(row.alpha - square) < kSmall) row.alpha = square;
      for (double* length : {&row.a, &row.d})
        if (std::abs(*length) < kSmall) *length = 0;
    }
    if (!machine::has_closed_inverse(whole)) return out;
  }
  // The branch whose joints these are.
  double best = 1e-3;
  for (const kinematics::Solution& s : machine::inverse(whole, machine::forward(whole, q)).solutions) {
    double off = 0;
    for (int i = 0; i < 3; ++i) off = std::max(off, std::abs(std::remainder(s.joints[i] - q[i], 2 * std::numbers::pi)));
    if (off >= best) continue;
    best = off;
    const std::string name = machine::branch_name(whole, s.branch);
    out.known = name.rfind("arm-", 0) != 0;  // numbered postures say nothing to a controller
    out.overhead = name.rfind("back", 0) == 0;
    const bool up = name.find("elbow-up") != std::string::npos;
    out.bent = up != out.overhead;
  }
  return out;
}

namespace {

/// How far the path mode of a move lets its corners be rounded, m.
double allowed(const Step& step, const WriteOptions& options) {
  if (options.blend_overrides || !step.path) return options.blend;
  if (step.path->mode != gcode::PathMode::continuous) return 0;
  return step.path->blend_tolerance > 0 ? double(step.path->blend_tolerance) : options.blend;
}

/// A corner is rounded where the tool goes on cutting behind it; in URScript by at most 0.45 of the shorter way beside
/// it.
double blend_behind(Dialect dialect, const Path& path, const Plan& plan, const WriteOptions& options, std::size_t i) {
  if (i + 1 >= plan.moves.size()) return 0;
  const PlannedMove &m = plan.moves[i], &after = plan.moves[i + 1];
  if (m.kind == StepKind::rapid || after.kind == StepKind::rapid) return 0;
  for (int k = m.step + 1; k < after.step; ++k) {
    const Step& between = path.steps[static_cast<std::size_t>(k)];
    const bool silent = between.kind == StepKind::words && between.meaning.empty();
    if (between.kind != StepKind::comment && !silent) return 0;
  }
  const double blend = std::min(allowed(path.steps[static_cast<std::size_t>(m.step)], options),
                                allowed(path.steps[static_cast<std::size_t>(after.step)], options));
  const double shorter = std::min(m.length, after.length);
  if (blend <= 0 || shorter < kNoWay) return 0;
  return dialect == Dialect::urscript ? std::min(blend, kBlendOfWay * shorter) : blend;
}

/// Words, places and tools that a robot's language cannot have.
Status fits_a_robot(const Path& path) {
  bool placed = false;
  int tool = 0, tool_line = 0;
  for (const Step& s : path.steps) {
    const Place place{path.file, s.line, 1};
    if (s.kind == StepKind::words && !s.robots) {
      return fail("PO118", fmt::format("{} has no counterpart in a robot's language", s.text), place,
                  "remove it, and switch what it switches in the program of the cell; --to ngc keeps it");
    }
    if (!s.moves()) continue;
    if (!s.placed() && placed) {
      return fail("PO117", "X, Y or Z are not known here, and a robot's language needs all of them", place,
                  "command X, Y and Z with G0, and Z after G43");
    }
    if (!s.placed()) continue;
    placed = true;
    if (s.tool != 0 && tool != 0 && s.tool != tool) {
      return fail(
          "PO119",
          fmt::format("tool {} here and tool {} in line {}: the TCP is that of the one tool of the machine file",
                      s.tool, tool, tool_line),
          place, "post the part of each tool by itself, with a machine file of this tool");
    }
    if (s.tool != 0 && tool == 0) tool_line = s.line;
    if (s.tool != 0) tool = s.tool;
  }
  return {};
}

/// What the source has and the robot's program has otherwise.
std::vector<std::string> robot_notes(const Path& path, const WriteOptions& options) {
  std::vector<std::string> out;
  int length = 0, optional_stop = 0, incomplete = 0, without_mode = 0, pallet = 0;
  const auto first = [](int& line, const Step& s) { line = line == 0 ? s.line : line; };
  for (const Step& s : path.steps) {
    if (s.length_offset) first(length, s);
    if (s.kind == StepKind::optional_stop) first(optional_stop, s);
    if (s.kind == StepKind::stop && s.text == "M60") first(pallet, s);
    if (s.moves() && !s.placed()) first(incomplete, s);
    const bool distance = s.path && (s.path->mode != gcode::PathMode::continuous || s.path->blend_tolerance > 0);
    if (s.placed() && s.kind != StepKind::rapid && !distance) first(without_mode, s);
  }
  if (length > 0) {
    out.push_back(
        fmt::format("line {}: tool length offsets are not written: the TCP is the tool of the machine file", length));
  }
  if (optional_stop > 0) out.push_back(fmt::format("line {}: M1 stands as a comment: it does not stop", optional_stop));
  if (pallet > 0) out.push_back(fmt::format("line {}: of M60 the stop is written, not the change of pallets", pallet));
  if (incomplete > 0) {
    out.push_back(fmt::format(
        "line {}: rapids before the first place that is known whole are left out: the robot begins there", incomplete));
  }
  if (path.program && without_mode > 0 && !options.blend_overrides) {
    out.push_back(fmt::format("line {}: no path mode says how far corners may be rounded: {:g} mm (--corner-blend)",
                              without_mode, units::to_mm(options.blend)));
  }
  return out;
}

}  // namespace

Result<Written> write_robot(Dialect dialect, const Configuration& configuration, const Path& path, const Plan& plan,
                            const WriteOptions& options) {
  const auto* arm = std::get_if<machine::SerialArm>(&configuration.machine);
  if (arm == nullptr) {
    return fail("PO121",
                fmt::format("{} is no arm, so no robot's controller moves it", machine::name_of(configuration.machine)),
                {}, "use --to ngc");
  }
  const auto carried = machine::CarriedArm::on_external_axis(*arm);
  if (arm->dh.size() > 6 && (!carried || dialect == Dialect::urscript)) {
    return fail(
        "PO121",
        fmt::format("{} has {} joints, locked ones counted{}", machine::name_of(configuration.machine), arm->dh.size(),
                    carried ? "; URScript knows no external axis that carries the robot"
                            : ", and its first does not carry an arm of six joints with a closed inverse, as a "
                              "rail does"),
        {}, "give the six joints of the robot as a machine of their own, its base where it stands");
  }
  if (const auto flange = arm->provenance.find(machine::kFlange);
      flange != arm->provenance.end() && flange->second.starts_with(machine::kNotKnown)) {
    return fail(
        "PO131",
        fmt::format("{}: its file does not say where the flange is, and a robot's controller counts the tool "
                    "from there",
                    machine::name_of(configuration.machine)),
        {},
        "name the link of the flange tool0 (z out of the flange, along the last axis); or write the machine with "
        "`polypod info ... -o arm.toml`, make its last row end at the flange, and take `flange` out of its "
        "[provenance]");
  }
  POLYPOD_TRY(fits_a_robot(path));
  Written out;
  const machine::DhRow* const external = carried ? &carried->axis() : nullptr;
  const auto language = language_of(dialect, options, external);
  const Pose root = carried ? carried->root() : arm->X_MB;
  language->begin(root.inverse() * Pose{rotation_z(options.rotation), options.origin}, arm->X_FT);
  // The plan has orientations along the axes of M; the language wants those in the frame of the workpiece.
  const Mat3 R_WM = rotation_z(-options.rotation);
  std::string state;
  bool known = true, placed = false;
  std::size_t next = 0;
  for (std::size_t i = 0; i < path.steps.size(); ++i) {
    const Step& step = path.steps[i];
    if (step.kind == StepKind::comment) {
      for (const std::string& line : comment_lines(step.text)) language->comment(line);
      continue;
    }
    if (path.program) {
      if (!step.meaning.empty()) language->comment(step.meaning);
    } else if (const std::string now = state_of(step); now != state) {
      language->comment(now);
      state = now;
    }
    if (step.kind == StepKind::stop || step.kind == StepKind::optional_stop)
      language->stop(step.kind == StepKind::optional_stop);
    if (step.kind == StepKind::dwell) language->dwell(step.seconds);
    for (; next < plan.moves.size() && plan.moves[next].step == static_cast<int>(i); ++next) {
      PlannedMove m = plan.moves[next];
      const Posture posture = posture_of(configuration, m.joints);
      known = known && (posture.known || m.joints.size() == 0);  // out of reach there is none
      m.R = R_WM * m.R;
      m.R_via = R_WM * m.R_via;
      const double speed = m.kind == StepKind::rapid ? options.rapid_speed : step.feed;
      const double blend = blend_behind(dialect, path, plan, options, next);
      if (!placed) {
        language->first(m, posture);
      } else if (m.kind == StepKind::arc) {
        language->arc(m, posture, speed, blend);
      } else {
        language->line(m, posture, speed, blend);
      }
      placed = true;
      ++out.moves;
    }
  }
  if (path.program) language->comment("end of the program: spindle and coolant off");
  const std::string name = identifier(options.name, 24);
  out.text = language->text(name);
  out.data = language->data(name);
  out.lines = static_cast<int>(std::count(out.text.begin(), out.text.end(), '\n'));
  out.notes.push_back(
      "spindle, coolant and tool changes stand as comments: wire them to the outputs of the cell, or they do not "
      "happen");
  out.notes.push_back(
      "workpiece and tool frame are those of the machine file; its joints must count as the controller's do");
  constexpr double kNoTool = 1e-9;  // m
  if (arm->X_FT.p.norm() < kNoTool)
    out.notes.push_back("the tool tip is the flange: the machine file gives no tool length (`--set tool.z_mm=...`)");
  for (std::string& note : robot_notes(path, options)) out.notes.push_back(std::move(note));
  if (external != nullptr) {
    out.notes.push_back(
        fmt::format("joint 1 of the machine file is written as {}, in {}; the workpiece frame counts from the robot's "
                    "base where it is "
                    "at 0 (in M {}), so there the world frame of the controller must be, with the axis configured as "
                    "one that carries "
                    "the robot",
                    dialect == Dialect::krl ? "the external axis E1" : "the external axis eax_a",
                    external->kind == machine::JointKind::revolute ? "deg" : "mm", frame_in_words(root)));
  } else if (arm->dh.size() != 6)
    out.notes.push_back(
        fmt::format("the tool frame is given in the last frame of the {} joints of the machine file", arm->dh.size()));
  if (!known && dialect != Dialect::urscript)
    out.notes.push_back(
        "the postures of this arm have no names: S, T and confdata follow from the signs of its joints alone");
  return out;
}

}  // namespace polypod::post
