// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Programs with parameters, loops, subprograms, offsets and cycles against LinuxCNC's interpreter: the canonical text,
// and where the moves of the unrolled program end.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <random>

#include "plain.hpp"
#include "polypod/gcode/canon.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/unroll.hpp"
#include "rs274.hpp"

namespace polypod::gcode {
namespace {

/// Writes random programs that LinuxCNC accepts, nearly always.
class Author {
 public:
  explicit Author(unsigned seed, bool machine) : random_(seed), machine_(machine) {}

  std::string program(int blocks) {
    text_ = "G21 G90 G17 G94 F100 S100 M3\nG0 X0 Y0 Z20\n#31=1 #32=2.5 #33=-3 #34=0 #<loc>=1.25 #<_glob>=7\n";
    const int subs = pick(0, 2);
    numbered_ = pick(0, 2) == 0;
    for (int i = 0; i < subs; ++i) {
      in_sub_ = true;
      text_ += fmt::format("o{} sub\n", 100 + i);
      const bool saves = pick(0, 1) == 0;
      if (saves) text_ += pick(0, 3) > 0 ? "M73\n" : "M70\n";
      if (pick(0, 1) == 0) mode();
      for (int k = pick(1, 4); k > 0; --k) line(1);
      if (saves && pick(0, 3) == 0) text_ += pick(0, 1) == 0 ? "M72\n" : "M71\n";
      text_ += pick(0, 1) == 0 ? fmt::format("o{} endsub [{}]\n", 100 + i, expression(1))
                               : fmt::format("o{} endsub\n", 100 + i);
      in_sub_ = false;
      subs_ = i + 1;
    }
    for (int i = 0; i < blocks; ++i) line(0);
    text_ += "M2\n";
    if (numbered_) {
      in_numbered_ = true;
      text_ += "o300\n";
      if (pick(0, 1) == 0) text_ += "M73\n";
      for (int k = pick(1, 4); k > 0; --k) line(2);
      text_ += "M99\n";
    }
    return text_;
  }

 private:
  int pick(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  std::string literal(int most = 20) { return fmt::format("{:.3f}", pick(-most * 1000, most * 1000) / 1000.0); }

  std::string expression(int depth) {
    switch (depth > 3 ? pick(0, 3) : pick(0, 15)) {
      case 0:
      case 1:
        return literal();
      case 2:
        return fmt::format("#{}", pick(31, 34));
      case 3:
        return in_sub_ ? (pick(0, 3) == 0 ? "#<_value>" : "#1") : pick(0, 1) == 0 ? "#<loc>" : "#<_glob>";
      case 4:
        return fmt::format("abs[{}]", expression(depth + 1));
      case 5:
        return fmt::format("sin[{}]", expression(depth + 1));
      case 6:
        return fmt::format("[round[{}] mod 7]", expression(depth + 1));
      case 7:
        return fmt::format("[fix[{}]/[1+abs[{}]]]", expression(depth + 1), expression(depth + 1));
      case 8: {
        const std::array<const char*, 9> operators{"eq", "ne", "gt", "ge", "lt", "le", "and", "or", "xor"};
        return fmt::format("[{} {} {}]", expression(depth + 1), operators[static_cast<std::size_t>(pick(0, 8))],
                           expression(depth + 1));
      }
      case 9:
        return fmt::format("atan[{}]/[2]", "[" + expression(depth + 1) + "]");
      case 12:
        return fmt::format("[sqrt[abs[{}]]**{}]", expression(depth + 1), pick(0, 2));
      case 13:
        return fmt::format("fup[{}]", expression(depth + 1));
      case 14:
        return fmt::format("[cos[{}]+exists[#<{}>]]", expression(depth + 1), pick(0, 1) == 0 ? "loc" : "none");
      case 15: {
        const std::array<const char*, 6> told{"#<_feed>",     "#<_rpm>",   "#<_metric>",
                                              "#<_absolute>", "#<_plane>", "#5220"};
        return told[static_cast<std::size_t>(pick(0, machine_ ? 5 : 4))];
      }
      default: {
        const std::array<const char*, 3> operators{"+", "-", "*"};
        return fmt::format("[{} {} {}]", expression(depth + 1), operators[static_cast<std::size_t>(pick(0, 2))],
                           expression(depth + 1));
      }
    }
  }
  /// A value that stays within some hundred mm.
  std::string bounded() { return pick(0, 2) > 0 ? literal() : fmt::format("[[{}] mod 50]", expression(0)); }

  std::string axes(bool z) {
    std::string words;
    for (const char* axis : {"X", "Y"}) {
      if (pick(0, 2) > 0) words += fmt::format(" {}{}", axis, bounded());
    }
    if (z && pick(0, 2) == 0) words += " Z" + bounded();
    return words.empty() ? " X" + bounded() : words;
  }

  /// A block of one of the words that M72 restores.
  void mode() {
    const std::array<const char*, 31> modes{"G20",
                                            "G21",
                                            "G17",
                                            "G18",
                                            "G19",
                                            "G90",
                                            "G91",
                                            "G90.1",
                                            "G91.1",
                                            "G98",
                                            "G99",
                                            "G61",
                                            "G61.1",
                                            "G64",
                                            "G64 P1",
                                            "F77.25",
                                            "S200.4",
                                            "F50 S7",
                                            "M3",
                                            "M4",
                                            "M5",
                                            "M7",
                                            "M8",
                                            "M9",
                                            "M48",
                                            "M49",
                                            "M50 P0",
                                            "M51 P0",
                                            "M52 P1",
                                            "M53 P0",
                                            "G64 P0.01 Q0.3"};
    text_ += modes[static_cast<std::size_t>(pick(0, 30))];
    text_ += '\n';
  }

  void save() {
    if (in_sub_ || in_numbered_) return mode();
    switch (pick(0, 6)) {
      case 0:
      case 1:
        text_ += pick(0, 4) == 0 ? "M73\n" : "M70\n";
        break;
      case 2:
        text_ += "M70\n";
        mode();
        mode();
        text_ += "M72\n";
        break;
      case 3:
        if (pick(0, 9) == 0) text_ += "M71\n";
        break;
      case 4:
        text_ += "M70\nG90 G93\n";
        text_ += fmt::format("G1 F{}{}\n", pick(1, 50) * 0.1, axes(true));
        text_ += pick(0, 1) == 0 ? "M72\nG1 F100\n" : "G94 F100\n";
        break;
      default:
        text_ += "M70\n";
        for (int k = pick(1, 3); k > 0; --k) line(3);
        text_ += "M72\nG94 F99.5\n";
    }
  }

  /// Cutter radius compensation round a polygon; now and then its corners are too tight, for LinuxCNC as well.
  void contour() {
    const int corners = pick(3, 6);
    const int turn = pick(0, 1) == 0 ? 1 : -1;
    text_ += "G21\nG40 G90 G17 G94 G1 F100\nG0 X0 Y0\n";
    text_ += fmt::format("G4{}.1 D{} F80\n", pick(1, 2), pick(5, 40) / 10.0);
    for (int i = 0; i < corners; ++i) {
      const double angle = turn * (i + 0.5) * 2 * M_PI / corners;
      const double radius = pick(18, 30);
      text_ += fmt::format("{}G1 X[{:.3f}] Y[{:.3f}+#31*0]\n", pick(0, 5) == 0 ? "G4 P0.5 " : "",
                           40 + radius * std::cos(angle), radius * std::sin(angle));
      if (pick(0, 4) == 0) text_ += "(print,#<_x> #<_y>)\n";
    }
    text_ += "G40\nG0 X0 Y0\nG1 F100\n";
  }

  void curve() {
    text_ += "G17 G90 G94 F100\n";
    switch (pick(0, 2)) {
      case 0:
        text_ += fmt::format("G5 X{} Y{} I{} J{} P{} Q{}\n", literal(), literal(), literal(9), literal(9), literal(9),
                             literal(9));
        if (pick(0, 1) == 0) text_ += fmt::format("X{} Y{} P{} Q{}\n", literal(), literal(), literal(9), literal(9));
        break;
      case 1:
        text_ += fmt::format("G5.1 X{} Y{} I{} J1\n", literal(), literal(), literal(9));
        break;
      default: {
        const int order = pick(3, 5);
        text_ += fmt::format("G5.2 X{} Y{} P1 L{}\n", literal(), literal(), order);
        for (int k = pick(order - 2, 7); k > 0; --k) {
          text_ += fmt::format("X{} Y[{}] P{}{}\n", literal(), literal(), pick(1, 30) / 10.0,
                               pick(0, 5) == 0 ? " (a remark)" : "");
        }
        text_ += "G5.3\n";
      }
    }
    text_ += "G1 F100\n";
  }

  void line(int depth) {
    switch (pick(0, depth > 2 ? 14 : 21)) {
      case 0:
      case 1:
      case 2:
        text_ += fmt::format("G{}{}\n", pick(0, 1), axes(true));
        break;
      case 3:
        if (machine_ && pick(0, 5) == 0) {  // the shift of G92, beside the one that is in force
          text_ += fmt::format("#{}={}\n", pick(5211, 5216), pick(-3, 3));
          if (pick(0, 1) == 0) text_ += fmt::format("#5210={}\n", pick(0, 1));
          break;
        }
        text_ += fmt::format("#{}={}\n", pick(31, 34), bounded());
        break;
      case 4:
        text_ += fmt::format("#{}={} G1{} #31={}\n", pick(32, 34), bounded(), axes(false), bounded());
        break;
      case 5:
        text_ += pick(0, 1) == 0 ? "G91\n" : "G90\n";
        break;
      case 6: {
        const std::array<const char*, 8> cycles{"G81",      "G82 P0.5", "G83 Q3", "G73 Q2.5",
                                                "G86 P0.2", "G85",      "G89 P1", "G84"};
        if (pick(0, 5) == 0) {
          text_ += fmt::format("G94 F100 S50 M{}\nG17 G90 G{} G0 Z{}\n", pick(3, 4), pick(98, 99), pick(5, 25));
          text_ += fmt::format("G87 X{} Y{} Z{} R{} I{} J{} K{}\n", bounded(), bounded(), -pick(5, 9), pick(0, 12),
                               pick(-3, 3), pick(-3, 3), pick(-5, 0));
          if (pick(0, 1) == 0) text_ += fmt::format("Y{}{}\n", bounded(), pick(0, 1) == 0 ? " I2 K-1" : " L2");
          text_ += "G80 G17 G90\nG1 F100\n";
          break;
        }
        text_ += "G94 F100 M3\n";
        // Under G90, with R above the bottom; a plane of its own now and then.
        const int plane = pick(0, 5);
        const int kind =
            plane == 1 || plane == 2 ? pick(0, 6) : pick(0, 7);  // LinuxCNC exchanges the axes of G84 there
        const char n = plane == 1 ? 'Y' : plane == 2 ? 'X' : 'Z';
        text_ += fmt::format("G90 G{} G{} G0 {}{}\n",
                             plane == 1   ? 18
                             : plane == 2 ? 19
                                          : 17,
                             pick(98, 99), n, pick(-5, 25));
        if (pick(0, 2) == 0)
          text_ += fmt::format("G91 {} {}{} R{}", cycles[static_cast<std::size_t>(kind)], n, -pick(1, 9), pick(-3, 5));
        else
          text_ += fmt::format("{} {}{} R{}", cycles[static_cast<std::size_t>(kind)], n, pick(-9, 0), pick(1, 12));
        for (const char a : {'X', 'Y', 'Z'}) {
          if (a != n && pick(0, 1) == 0) text_ += fmt::format(" {}{}", a, bounded());
        }
        if (pick(0, 3) == 0) text_ += fmt::format(" L{}", pick(1, 3));
        text_ += '\n';
        const char other = n == 'X' ? 'Y' : 'X';
        for (int k = pick(0, 3); k > 0; --k) {
          text_ += fmt::format("{}{}{}{}\n", pick(0, 4) == 0 ? (pick(0, 1) == 0 ? "G98 " : "G99 ") : "", other,
                               bounded(), pick(0, 3) == 0 ? fmt::format(" R{}", pick(1, 9)) : "");
        }
        text_ += pick(0, 1) == 0 ? "G80 G17 G90\n" : "G0 X0 G17 G90\n";
        text_ += "G1 F100\n";
        break;
      }
      case 7: {
        const std::string some = axes(true);
        switch (pick(0, 6)) {
          case 0:
            text_ += "G92" + some + "\n";
            break;
          case 1:
            text_ += "G52" + some + "\n";
            break;
          case 2:
            text_ += fmt::format("G92.{}\n", pick(1, 2));
            break;
          case 3:
            text_ += machine_ ? "G92.3\n" : "G92.1\n";
            break;
          case 4:
            text_ += fmt::format("G10 L20 P{}{}\n", machine_ ? pick(0, 9) : pick(1, 2), some);
            break;
          case 5:
            if (machine_) {
              text_ += fmt::format("G10 L2 P{}{}{}\n", pick(0, 9), some, pick(0, 2) == 0 ? " R" + literal(90) : "");
            }
            break;
          default:
            text_ += fmt::format("G{}\n", machine_ && pick(0, 3) == 0 ? "59.1" : std::to_string(pick(54, 55)));
        }
        break;
      }
      case 8:
        if (machine_) {
          switch (pick(0, 9)) {
            case 5:
              text_ += "G49\n";
              break;
            case 6:
              text_ += fmt::format("G43 H{}\n", pick(1, 3));
              break;
            case 7:
              text_ += fmt::format("G43.1 Z{}\n", literal());
              break;
            case 8:
              text_ += fmt::format("G94 F100 G38.{}{}\n", pick(0, 1) == 0 ? 3 : 5, axes(true));
              break;
            case 9:
              text_ += fmt::format("M70\nG49\nG5{}\nM72\n", pick(4, 6));
              break;
            case 0:
              text_ += "G90 G53 G0" + axes(true) + "\n";
              break;
            case 1:
              text_ += "G28" + axes(true) + "\n";
              break;
            case 2:
              text_ += "G30\n";
              break;
            case 3:
              text_ += pick(0, 1) == 0 ? "G28.1\n" : "G30.1\n";
              break;
            default:
              text_ += fmt::format("T{} M6 G43\n", pick(1, 3));
          }
          text_ += "G1 F100\n";
        }
        break;
      case 9:
        text_ += fmt::format("G17\nG{} @{} ^{}\n", pick(0, 1), pick(1, 30), literal(180));
        break;
      case 10:
        text_ += pick(0, 2) > 0 ? "(print,#31 #32 %.3f#33 #<_x> #<_y> #5420 #5422)\n"
                                : "(print,#<_motion_mode> #<_feed> #<_rpm> #<_plane> #<_metric> #<_inverse_time>)\n";
        break;
      case 11:
        // A half circle by its centre, from wherever the tool stands.
        text_ += "G17 G91\n";
        text_ += fmt::format("G{} X{} Y0 I{} J0\n", pick(2, 3), 2 * (pick(1, 9) * 0.5), "[1*1]");
        text_.erase(text_.rfind("G", text_.size() - 2));
        {
          const int radius = pick(1, 9);
          text_ += fmt::format("G{} X{} Y0 I[{}] J0\n", pick(2, 3), 2 * radius, radius);
        }
        text_ += "G90 G1\n";
        break;
      case 12:
        text_ += fmt::format("G4 P{} G{}{}\n", pick(0, 20) / 10.0, pick(0, 1), axes(true));
        break;
      case 13:
        if (pick(0, 2) == 0) {
          text_ += "G10 L2 P0 R" + literal(90) + '\n';
        } else {
          save();
        }
        break;
      case 14:
        mode();
        break;
      case 15:
        save();
        break;
      case 16: {
        const int label = ++label_;
        text_ += fmt::format("o{} if [{}]\n", label, expression(0));
        line(depth + 1);
        if (pick(0, 1) == 0) {
          text_ += fmt::format("o{} elseif [{}]\n", label, expression(0));
          line(depth + 1);
        }
        if (pick(0, 1) == 0) {
          text_ += fmt::format("o{} else\n", label);
          line(depth + 1);
        }
        text_ += fmt::format("o{} endif\n", label);
        break;
      }
      case 17: {
        const int label = ++label_;
        text_ += fmt::format("o{} repeat [{}{}]\n", label, pick(0, 3), pick(0, 3) == 0 ? ".5" : "");
        line(depth + 1);
        line(depth + 1);
        text_ += fmt::format("o{} endrepeat\n", label);
        break;
      }
      case 18: {
        const int label = ++label_;
        const int counter = 40 + label;
        text_ += fmt::format("#{}=0\no{} while [#{} lt {}]\n#{}=[#{}+1]\n", counter, label, counter, pick(1, 3),
                             counter, counter);
        line(depth + 1);
        leave(label, counter);
        line(depth + 1);
        leave(label, counter);
        text_ += fmt::format("o{} endwhile\n", label);
        break;
      }
      case 19: {
        const int label = ++label_;
        const int counter = 40 + label;
        text_ += fmt::format("#{}=0\no{} do\n#{}=[#{}+1]\n", counter, label, counter, counter);
        line(depth + 1);
        leave(label, counter);
        leave(label, counter);
        text_ += fmt::format("o{} while [#{} lt {}]\n", label, counter, pick(1, 3));
        break;
      }
      case 20:
        if (pick(0, 3) > 0 || in_sub_ || in_numbered_) {
          text_ += fmt::format("G1{}\n", axes(true));
        } else if (machine_ && pick(0, 1) == 0) {  // where a curve goes, rs274 does not print
          curve();
        } else {
          contour();
        }
        break;
      default:
        if (numbered_ && !in_sub_ && !in_numbered_ && pick(0, 1) == 0) {
          text_ += fmt::format("M98 P300 L{}\n", pick(1, 3));
        } else if (subs_ > 0 && !in_sub_) {
          text_ += fmt::format("o{} call [{}] [{}]\n(print,#<_value> #<_value_returned>)\n", 100 + pick(0, subs_ - 1),
                               expression(0), expression(0));
        } else {
          text_ += fmt::format("G1{}\n", axes(true));
        }
    }
  }

  /// Now and then a way out of a loop, or to its next pass.
  void leave(int label, int counter) {
    if (pick(0, 2) != 0) return;
    const int inner = ++label_;
    text_ += fmt::format("o{} if [#{} eq {}]\no{} {}\no{} endif\n", inner, counter, pick(1, 2), label,
                         pick(0, 1) == 0 ? "break" : "continue", inner);
  }

  std::mt19937 random_;
  bool machine_;
  std::string text_;
  int label_ = 0;
  int subs_ = 0;
  bool in_sub_ = false;
  bool numbered_ = false;     // whether a program with a number follows, for M98
  bool in_numbered_ = false;  // while it is written
};

/// The moves of canonical text, in machine coordinates, mm.
std::vector<Vec3> ends_of(const std::string& text) {
  std::vector<Vec3> ends;
  Vec3 origin = Vec3::Zero();
  Vec3 g92 = Vec3::Zero();
  double rotation = 0;
  double unit = 1;
  int plane = 17;
  for (const std::string& line : lines(text)) {
    const auto numbers = [&](const char* name, const char* format, auto*... out) {
      const std::size_t at = line.find(name);
      return at != std::string::npos && std::sscanf(line.c_str() + at + std::string(name).size(), format, out...) > 0;
    };
    double a[6] = {};
    int n = 0;
    if (line.find("LENGTH_UNITS") != std::string::npos) {
      const double next = line.find("UNITS_INCHES") != std::string::npos ? 25.4 : 1;
      origin *= unit / next;
      g92 *= unit / next;
      unit = next;
    }
    if (line.find("PLANE_XY") != std::string::npos) plane = 17;
    if (line.find("PLANE_XZ") != std::string::npos) plane = 18;
    if (line.find("PLANE_YZ") != std::string::npos) plane = 19;
    if (numbers("SET_G5X_OFFSET(", "%d, %lf, %lf, %lf", &n, a, a + 1, a + 2)) origin = Vec3(a[0], a[1], a[2]);
    if (numbers("SET_G92_OFFSET(", "%lf, %lf, %lf", a, a + 1, a + 2)) g92 = Vec3(a[0], a[1], a[2]);
    numbers("SET_XY_ROTATION(", "%lf", &rotation);
    const bool arc = numbers("ARC_FEED(", "%lf, %lf, %lf, %lf, %d, %lf", a, a + 1, a + 2, a + 3, &n, a + 4);
    if (!arc && !numbers("STRAIGHT_TRAVERSE(", "%lf, %lf, %lf", a, a + 1, a + 2) &&
        !numbers("STRAIGHT_FEED(", "%lf, %lf, %lf", a, a + 1, a + 2)) {
      continue;
    }
    Vec3 p(a[0], a[1], a[2]);
    if (arc) p = plane == 17 ? Vec3(a[0], a[1], a[4]) : plane == 18 ? Vec3(a[1], a[4], a[0]) : Vec3(a[4], a[0], a[1]);
    p += g92;
    const double c = std::cos(rotation * M_PI / 180);
    const double s = std::sin(rotation * M_PI / 180);
    p = Vec3(c * p.x() - s * p.y(), s * p.x() + c * p.y(), p.z()) + origin;
    ends.push_back(p * unit);
  }
  return ends;
}

/// Whether two sequences of ends are the same way; moves of no length may be missing in one of them.
bool same_way(const std::vector<Vec3>& a, const std::vector<Vec3>& b, bool inches = false) {
  const double kRounded = inches ? 6e-3 : 1e-3;  // mm: rs274 prints four decimals, of sums of offsets
  const double kNoMove = inches ? 3e-2 : 5e-3;
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() || j < b.size()) {
    if (i < a.size() && j < b.size() && (a[i] - b[j]).norm() < kRounded) {
      ++i;
      ++j;
    } else if (i > 0 && i < a.size() && (a[i] - a[i - 1]).norm() < kNoMove) {
      ++i;
    } else if (j > 0 && j < b.size() && (b[j] - b[j - 1]).norm() < kNoMove) {
      ++j;
    } else {
      return false;
    }
  }
  return true;
}

/// Rounding decides the sign of a coordinate that is 0: it is printed, but it means nothing.
std::string without_signs_of_zeros(std::string text) {
  for (std::size_t at = 0; (at = text.find("-0.0", at)) != std::string::npos; ++at) {
    const std::size_t end = text.find_first_not_of('0', at + 3);
    if (end == std::string::npos || text[end] < '0' || text[end] > '9') text.erase(at, 1);
  }
  return text;
}

TEST(Unroll, PlainProgramsStayAsTheyAre) {
  const std::string text = "%\r\n N10 g0 X1.50 (a)\nG1 Z-1 F100\r\n/G80\nM2\n%\nrest # [";
  const auto program = parse(text, "part.ngc");
  ASSERT_TRUE(program.has_value()) << to_string(program.error());
  EXPECT_FALSE(needs_unrolling(*program));
  const auto unrolled = unroll(*program);
  ASSERT_TRUE(unrolled.has_value());
  EXPECT_FALSE(unrolled->unrolled);
  EXPECT_EQ(to_text(unrolled->program), text);
}

TEST(Unroll, WritesWhatRunsWithItsLine) {
  UnrollOptions options;
  options.source_lines = true;
  EXPECT_EQ(plain("#1=2\no1 repeat [2]\nG0 X#1 Z5 (at #1)\n#1=[#1+0.5]\no1 endrepeat\nG1 F100 X[#1*2]\nM2\n", options),
            "G0 X2 Z5 (line 3) (at #1)\nG0 X2.5 Z5 (line 3) (at #1)\nG1 F100 X6 (line 6)\nM2 (line 7)\n");
}

TEST(Unroll, TheClosingPercentSignStays) {
  const std::string curve = plain("G0 X0 Y0 Z5\nG5 I1 J1 P1 Q1 X9 Y9 F100\nZ38\nM2\n");
  EXPECT_EQ(curve.substr(curve.rfind('\n', curve.size() - 5) + 1), "G0 Z38\nM2\n") << curve;
  EXPECT_EQ(plain("%\n#1=2\nG0 X#1\nM2\n%\nrest\n"), "%\nG0 X2\nM2\n%\n");
  EXPECT_EQ(plain("%\n#1=2\nG0 X#1\n%\nrest\n"), "%\nG0 X2\n%\n");
  EXPECT_EQ(plain("%\n#1=2\nG0 X#1\nM2\n"), "%\nG0 X2\nM2\n");
  EXPECT_EQ(plain("#1=2\nG0 X#1\nM2\n%\n"), "G0 X2\nM2\n");
}

// The controller takes the length that stands in its table: left out, it was another one. Tapping locks the overrides.
TEST(Unroll, WhatWouldBeLeftOutIsRefusedOrWritten) {
  for (const char* l : {"L1", "L10", "L11"}) {
    const std::string said = plain(std::string("G10 ") + l + " P1 Z100\nT1 M6\nG43 H1\nG0 X1 Y1 Z1\nM2\n");
    EXPECT_NE(said.find("GC125"), std::string::npos) << said;
  }
  EXPECT_EQ(plain("G10 L1 P1 R4\nT1 M6\nG0 X1 Y1 Z1\nM2\n").find("GC125"), std::string::npos);
  const std::string tapped = plain("G21 S100 M3\nG0 X0 Y0 Z10\nG84 X1 Y0 Z-3 R2 F100\nG80\nM2\n");
  const std::size_t locked = tapped.find("M49"), down = tapped.find("Z-3"), free = tapped.find("M48");
  ASSERT_NE(locked, std::string::npos) << tapped;
  EXPECT_LT(locked, down);
  ASSERT_NE(free, std::string::npos) << tapped;
  EXPECT_LT(down, free);
}

TEST(Unroll, ShiftsAreCarriedOut) {
  EXPECT_EQ(plain("G0 X1 Y1 Z1\nG92 X0 Y0\nG0 X5\nG1 F10 Y2\nG2 X7 Y2 I1 J0\nG91 G1 X1\nG90 G92.1\nX3\nM2\n"),
            "G0 X1 Y1 Z1\nG0 X6\nF10 G1 Y3\nG2 X8 Y3 I1 J0\nG91 G1 X1\nG90 G92.1\nX3\nM2\n");
}

TEST(Unroll, CyclesBecomeMoves) {
  EXPECT_EQ(plain("G0 X0 Y0 Z9\nG99 G82 X1 Y2 Z-1 R2 P0.5 F100\nG80\nM2\n"),
            "G0 X0 Y0 Z9\nG99 F100\nG61\nG0 X1 Y2 Z9\nG0 Z2\nG1 Z-1\nG4 P0.5\nG0 Z2\nG64\nG80\nM2\n");
}

TEST(Unroll, AModalMotionBehindACycleKeepsItsWord) {
  EXPECT_EQ(plain("G0 X1 Y2 Z3\nG1 F100 X2\nG28 Z5\nX3\nM2\n"),
            "G0 X1 Y2 Z3\nG1 F100 X2\nG0 Z5\nG91 G28 Z0\nG90\nG1 X3\nM2\n");
}

TEST(Unroll, SavedModesComeBackAsBlocks) {
  EXPECT_EQ(plain("G90 G94 F100\nG0 X1 Y1 Z1\nM70 (save)\nG91 F50\nM8\nX2\nM72\nX5\nM2\n"),
            "G90 G94 F100\nG0 X1 Y1 Z1\n(save)\nG91 F50\nM8\nX2\nF100 G90 M9\nX5\nM2\n");
  EXPECT_EQ(plain("o1 sub\nM73\nG91 G0 X1\no1 endsub\nG90 G0 X1 Y1 Z1\no1 call\nX5\nM2\n"),
            "G90 G0 X1 Y1 Z1\nG91 G0 X1\nG90\nX5\nM2\n");
}

/// M60 and M52 alone take no number: R of the cycle or of the arc beside them does not stay with them.
TEST(Unroll, NumbersStayWithTheWordsThatTakeThem) {
  const std::string cycle = plain("F100\nG0 X0 Y0 Z5\nG81 X1 Y1 Z-1 R2 M60\nG80\nM2\n");
  EXPECT_NE(cycle.find("M60"), std::string::npos) << cycle;
  EXPECT_EQ(cycle.find('R'), std::string::npos) << cycle;
  const std::string arc = plain("F100\nG0 X0 Y0 Z5\nG92 X1\nG3 X1 Y20 R10 M52\nM2\n");
  EXPECT_NE(arc.find("M52"), std::string::npos) << arc;
  EXPECT_EQ(arc.find('R'), std::string::npos) << arc;
  EXPECT_NE(plain("F100\nG0 X0 Y0 Z5\nG92 X1\nG1 X20 M62 P3\nM2\n").find(" P3"), std::string::npos);
}

TEST(Unroll, ADwellBesideAMotionGetsABlock) {
  EXPECT_EQ(plain("G0 X1 Y1 Z1\nG4 P2 X5\nN3 G4 P1 G1 X7 F100 (a)\nM2\n"),
            "G0 X1 Y1 Z1\nG4 P2\nG0 X5\nG4 P1 F100 (a)\nG1 X7\nM2\n");
}

TEST(Unroll, TurnedCoordinatesAreCarriedOut) {
  EXPECT_EQ(plain("G0 X1 Y0 Z1\nG10 L2 P1 R90\nG0 X5 Y0\nG1 F10 X7 Y-1\nG2 X9 I1 J0\nG91 X-2 I-1 J0\nM2\n"),
            "G0 X1 Y0 Z1\nG0 X0 Y5\nF10 G1 X1 Y7\nG2 X1 Y9 I0 J1\nG91 G2 X0 Y-2 I0 J-1\nM2\n");
}

/// A quarter of a circle as a rational curve of order 3: its middle point weighs cos 45 deg.
TEST(Unroll, NurbsBecomeLinesOnTheCurve) {
  for (const char* unit : {"G21", "G20"}) {
    const auto program = parse(fmt::format("{}\nF100\nG0 X10 Y0 Z1\nG5.2 X10 Y10 P0.70710678118654752 L3\nX0 Y10 "
                                           "P1\nG5.3\nM2\n",
                                           unit),
                               "part.ngc");
    ASSERT_TRUE(program.has_value());
    const auto unrolled = unroll(*program);
    ASSERT_TRUE(unrolled.has_value()) << to_string(unrolled.error());
    const auto run = interpret(unrolled->program);
    ASSERT_TRUE(run.has_value()) << to_string(run.error());
    ASSERT_GT(run->moves.size(), 20u);
    ASSERT_LT(run->moves.size(), 2000u);
    const double radius = unit == std::string("G21") ? 0.01 : 0.254;
    for (std::size_t i = 1; i < run->moves.size(); ++i) {
      const Move& move = run->moves[i];
      const Vec3 middle = (move.start + move.end) / 2;
      EXPECT_NEAR(std::hypot(move.end.x(), move.end.y()), radius, 2e-9);  // numbers of 6 decimals
      EXPECT_GT(std::hypot(middle.x(), middle.y()), radius - 0.5e-6);
    }
    EXPECT_NEAR(run->moves.back().end.y(), radius, 1e-12);
    EXPECT_NEAR(run->moves.back().end.x(), 0, 1e-12);
  }
}

TEST(Unroll, RefusesWhatTheJobDoesNotTell) {
  struct Bad {
    std::string text;
    std::string start;
  };
  for (const Bad& bad : std::vector<Bad>{
           {"G10 L2 P1 X5\nM2\n", "GC125 part.ngc:1:1:"},
           {"G10 L2 P7 R5\nM2\n", "GC125 part.ngc:1:1:"},
           {"G0 X1 Y1\nG92 X5\nG10 L2 P1 R5\nM2\n", "GC125 part.ngc:3:1:"},
           {"G0 X1\nG10 L2 P1 R30\nG0 X5\nM2\n", "GC169 part.ngc:3:4:"},
           {"G0 X1 Y1\nG10 L2 P1 R30\nG28 X5\nM2\n", "GC125 part.ngc:3:1:"},
           {"G0 X1 Y1\nG10 L2 P1 R30\nG53 G0 X5\nG0 Y3\nM2\n", "GC169 part.ngc:4:4:"},
           {"F1 G0 X1\nG5.2 X3 Y3 P1\nX4 Y4 P1\nG5.3\nM2\n", "GC169 part.ngc:2:1:"},
           {"F1 G0 X1\nG5.1 X3 Y3 I1 J1\nM2\n", "GC169 part.ngc:2:1:"},
           // Lines would leave these curves by more than is promised: a parabola and a quarter of 1 km.
           {"F1 G0 X0 Y0\nG5.1 X1000000 Y0 I500000 J1000000\nM2\n", "GC127 part.ngc:2:1:"},
           {"F1 G0 X1000000 Y0\nG5.2 X1000000 Y1000000 P1\nX0 Y1000000 P1\nG5.3\nM2\n", "GC127 part.ngc:4:1:"},
           {"G59.1\nG0 X1\nM2\n", "GC125 part.ngc:1:1:"},
           {"#5221=3\nM2\n", "GC125 part.ngc:1:1:"},
           {"G92.3\nM2\n", "GC125 part.ngc:1:1:"},
           {"G0 X#5422\nM2\n", "GC169 part.ngc:1:5:"},
           {"G0 X1 Y1 Z1\nG43 H1\nG0 Z[#<_z>+1]\nM2\n", "GC169 part.ngc:3:6:"},
           {"G0 X#5161\nM2\n", "GC169 part.ngc:1:5:"},
           {"G92 X0\nM2\n", "GC169 part.ngc:1:5:"},
           {"F100 G81 X1 Y1 Z-1 R1\nM2\n", "GC166 part.ngc:1:6:"},
           {"G0 X1 Y1 Z1\nG28\nG10 L20 P1 X0\nM2\n", "GC169 part.ngc:3:12:"},
           {"F1 G38.2 Z-1\nM2\n", "GC128 part.ngc:1:4:"},
           {"o1 while [1]\no1 endwhile\nM2\n", "GC165 part.ngc:"},
           {"G0 Z1 F1\nG73 X1 Z-900 R1 Q0.0001 L1000\nM2\n", "GC1"},
           {"o<../x> call\nM2\n", "GC164 part.ngc:1:1:"},
       }) {
    const std::string got = plain(bad.text);
    EXPECT_EQ(got.substr(0, bad.start.size()), bad.start) << bad.text << got;
  }
}

// What the program reads without having set it stands at the controller: a value of M66, or what a run before has left.
TEST(Unroll, RefusesToGuessWhatTheControllerHolds) {
  for (const std::string text :
       {"M66 P0 L3 Q5\n#1=#5399\nM2\n", "o1 if [#4000 EQ 1]\no1 endif\nM2\n", "G0 Z#500\nM2\n", "G0 Z#1\nM2\n"}) {
    EXPECT_EQ(plain(text).substr(0, 5), "GC162") << text << plain(text);
  }
  EXPECT_EQ(plain("#500=3\nG0 Z#500\nM2\n"), "G0 Z3\nM2\n");
  // The arguments of a call are 0 where they are not given; behind it #1 is again not set.
  const std::string sub = "o<s> sub\nG0 X#1 Y#2\no<s> endsub\no<s> call [4]\n";
  EXPECT_EQ(plain(sub + "M2\n"), "G0 X4 Y0\nM2\n");
  EXPECT_EQ(plain(sub + "G0 Z#1\nM2\n").substr(0, 5), "GC162");
}

/// LinuxCNC acts on the last comment of a line alone.
TEST(Unroll, MessagesStayTheLastCommentOfTheirLine) {
  UnrollOptions options;
  options.source_lines = true;
  EXPECT_EQ(
      plain("#1=2.5\n(MSG, clamp)\nN7 M0 (a) (DEBUG, at #1)\n(LOG, #1 done)\nG0 X#1 ; out\nM2\n", options),
      "(line 2) (MSG, clamp)\nN7 M0 (line 3) (a) (DEBUG, at 2.500000)\n(line 4) (LOG, 2.500000 done)\nG0 X2.5 ; out\n"
      "M2 (line 6)\n");
  EXPECT_EQ(plain("G0 X1\no1 if [1]\n(print, #<_x>)\no1 endif\nM2\n", options).find("#"), std::string::npos);
}

/// The blocks stand in a work coordinate system that the job gives; one that the program sets itself is not written.
TEST(Unroll, OffsetsOfTheProgramItselfAreNotInThePlainOne) {
  EXPECT_EQ(plain("G0 X0 Y0 Z10\nG10 L20 P2 X20 Y0 Z9\nG55 G0 X21\nG54 G0 X5\nM2\n"),
            "G0 X0 Y0 Z10\nG0 X1\nG54 G0 X5\nM2\n");
  // Z of G55 is that of the job here.
  EXPECT_EQ(plain("G0 X0 Y0 Z10\nG10 L20 P2 X20 Y0\nG55 G0 X21\nM2\n").find("G55") == std::string::npos, false);
  const auto program = parse("G0 X0 Y0 Z10\nG10 L20 P2 X20 Y0\nM2\n", "part.ngc");
  const auto unrolled = unroll(*program, {});
  ASSERT_TRUE(unrolled.has_value());
  EXPECT_THAT(unrolled->notes, testing::Contains(testing::HasSubstr("offsets of its own (line 2")));
}

TEST(Program, PythonInACommentIsRefused) {
  for (const std::string text : {"(py, 1+1)\nM2\n", "G0 X1 ( PY,x)\nM2\n", "#1=2 (py,1)\nM2\n"})
    EXPECT_EQ(plain(text).substr(0, 5), "GC122") << text;
  EXPECT_EQ(plain("(pylon)\nM2\n"), "(pylon)\nM2\n");
}

TEST(Unroll, BlockDeleteIsSettled) {
  UnrollOptions options;
  const std::string text = "#1=1\n/#1=2\n/G0 Y1\nG0 X#1\nM2\n";
  EXPECT_EQ(plain(text, options), "G0 Y1\nG0 X2\nM2\n");
  options.interpret.block_delete = true;
  EXPECT_EQ(plain(text, options), "G0 X1\nM2\n");
}

TEST(Unroll, SubprogramsMayStandInFilesBesideTheProgram) {
  const Scratch scratch;
  std::ofstream(scratch / "slot.ngc") << "o<slot> sub\nG1 X#1 F100\no<slot> endsub\nM2\n";
  std::ofstream(scratch / "main.ngc") << "G0 X0 Y0 Z1\no<slot> call [3]\no<Slot> call [4]\nM2\n";
  UnrollOptions options;
  options.source_lines = true;
  const auto understood = understand(scratch / "main.ngc", options);
  ASSERT_TRUE(understood.has_value()) << to_string(understood.error());
  EXPECT_EQ(to_text(understood->program),
            "G0 X0 Y0 Z1 (line 1)\nG1 X3 F100 (slot.ngc line 2)\nG1 X4 F100 (slot.ngc line 2)\nM2 (line 4)\n");
  options.files = false;
  const auto without = understand(scratch / "main.ngc", options);
  ASSERT_FALSE(without.has_value());
  EXPECT_EQ(without.error().id, "GC164");
}

/// Every program that ships with LinuxCNC and that rs274 runs as it is: the same text, or a refusal; docs/gcode.md
/// lists the refusals.
TEST(Language, ProgramsOfLinuxCncAreTheSameOrRefused) {
  const Scratch scratch;
  std::vector<std::string> programs;
  for (const char* folder : {"/usr/share/linuxcnc/ncfiles", "/usr/share/doc/linuxcnc/examples"}) {
    if (!fs::exists(folder)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.path().extension() == ".ngc") programs.push_back(entry.path().string());
    }
  }
  ASSERT_FALSE(programs.empty()) << "LinuxCNC's programs are not installed; scripts/packages.txt names linuxcnc-uspace";
  int same = 0;
  int not_run = 0;
  std::map<std::string, int> refused;
  std::string names;
  for (const std::string& path : programs) {
    const Reference theirs = rs274(scratch, path, {}, fs::path(path).parent_path().string());
    const auto program = read(path);
    const auto ours = program ? canonical_text(*program) : tl::unexpected(program.error());
    if (!theirs.accepted) {
      ++not_run;
      // M codes of a machine's builder: Polypod passes them through.
      const bool builder = theirs.errors.find("Unknown m code") != std::string::npos ||
                           theirs.errors.find("M-code greater") != std::string::npos;
      EXPECT_TRUE(!ours.has_value() || builder) << path << " is refused by rs274: " << theirs.errors;
      continue;
    }
    if (!ours) {
      ++refused[ours.error().id];
      names += ' ' + fs::path(path).filename().string();
    } else {
      // 400 polar steps of spiral.ngc end at 1e-15 mm, whose sign rounding decides.
      const bool zeros = path.ends_with("/spiral.ngc");
      const bool equal =
          zeros ? without_signs_of_zeros(*ours) == without_signs_of_zeros(theirs.text) : *ours == theirs.text;
      EXPECT_TRUE(equal) << path;
      same += equal ? 1 : 0;
    }
  }
  std::string list;
  int refusals = 0;
  for (const auto& [id, count] : refused) {
    list += fmt::format(" {} {}", id, count);
    refusals += count;
  }
  std::printf("%d the same, %d refused (%s:%s ), %d not run by rs274\n", same, refusals, list.c_str(), names.c_str(),
              not_run);
  EXPECT_GE(same, 183);
  EXPECT_LE(refusals, 5);
}

/// The same text as rs274 prints, or a refusal where it refuses.
void expect_as_linuxcnc(const Scratch& scratch, const std::string& text) {
  const std::string path = scratch / "program.ngc";
  std::ofstream(path) << text;
  const Reference theirs = rs274(scratch, path, {}, fs::path(path).parent_path().string());
  const auto program = read(path);
  const auto ours = program ? canonical_text(*program) : tl::unexpected(program.error());
  EXPECT_EQ(ours.has_value(), theirs.accepted) << text << (ours ? theirs.errors : to_string(ours.error()));
  if (ours && theirs.accepted) {
    EXPECT_EQ(*ours, theirs.text) << text;
  }
}

/// Passed or called before; else in the file of its name; else behind the call. Nothing else finds it.
TEST(Language, SubprogramsAreFoundWhereLinuxCncFindsThem) {
  const Scratch scratch;
  std::ofstream(scratch / "cut.ngc") << "o<cut> sub\nG1 Z-3 F200\no<cut> endsub\nM2\n";
  std::ofstream(scratch / "other.ngc") << "G0 X1\nM2\n";
  std::ofstream(scratch / "framed.ngc") << "%\no<framed> sub\nG0 X1\no<framed> endsub\n%\n";
  std::ofstream(scratch / "ends.ngc") << "%\no<ends> sub\nG0 X1\n%\no<ends> endsub\n";
  std::ofstream(scratch / "5.ngc") << "o5 sub\nG0 X5\no5 endsub\n";
  const auto defines = [](const std::string& label, int x) {
    return "o" + label + " sub\nG0 X" + std::to_string(x) + "\no" + label + " endsub\n";
  };
  const std::string if_not = "o1 if [0]\n", end_if = "o1 endif\n", call = "o2 call\n";
  const std::vector<std::string> programs{
      "o<cut> call\nM2\no<cut> sub\nG1 Z-1 F200\no<cut> endsub\n",
      "o<cut> sub\nG1 Z-1 F200\no<cut> endsub\no<cut> call\nM2\n",
      "o<other> call\nM2\n" + defines("<other>", 7),
      "M98 P5\nM2\nO5\nG0 X1\nM99\n",
      call + call + "M2\n" + defines("2", 9) + defines("2", 1),
      if_not + defines("2", 9) + end_if + call + "M2\n" + defines("2", 1),
      if_not + defines("2", 9) + end_if + call + "M2\n",
      call + if_not + defines("2", 9) + end_if + "M2\n",
      defines("2", 9) + defines("2", 1) + call + "M2\n",
      "o5 repeat [2]\n" + defines("2", 9) + "o5 endrepeat\n" + call + "M2\n",
      "o<b> call\nM2\n" + defines("<a>", 1) + "o<b> sub\no<a> call\no<b> endsub\n",
      "o<a> call\no<b> call\nM2\n" + defines("<a>", 1) + "o<b> sub\no<a> call\no<b> endsub\n",
      "M98 P8\nM2\nO7\nG0 X1\nM99\nO8\nM98 P7\nM99\n",
      // A '%' that is passed over ends the file, if the first line was one.
      "%\no<framed> call\nM2\n%\n",
      "o<framed> call\nM2\n",
      "o<ends> call\nM2\n",
      "%\no2 call\nM2\n%\n" + defines("2", 1),
      "o2 call\nM2\n%\n" + defines("2", 1),
      "%\no1 if [0]\nG0 X3\n%\no1 endif\nG0 X4\nM2\n",
      "%\no1 sub\nG0 X3\n%\no1 endsub\nG0 X4\nM2\n",
      "%\no1 while [0]\nG0 X3\n  %  \no1 endwhile\nG0 X4\nM2\n",
      "%\no1 if [0]\nM2\no1 endif\nG0 X1\n%\nG0 X5\n",
      "% (c)\nG0 X3\nM2\n",
      "%;c\nG0 X3\nM2\n",
      "(c)%\nG0 X3\nM2\n",
      "% \nG0 X3\n\t%\t\nG0 X4\nM2\n",
  };
  for (const std::string& text : programs) expect_as_linuxcnc(scratch, text);
}

TEST(Language, WhatStandsBehindAnOWord) {
  const Scratch scratch;
  const std::string sub_q = "o<q> sub\nG0 X#1 Y#2\no<q> endsub\n";
  const std::vector<std::string> programs{
      sub_q + "o<q> call [1] (c) [2]\nM2\n",
      sub_q + "o<q> call (c) [1] [2] (debug,#1) [3] ; end\nM2\n",
      sub_q + "o<q> call [1] G0 [2]\nM2\n",
      sub_q + "(c) M98 P5\nM2\nO5\nG0 X1\nM99\n",
      "M98 P5 (c)\nM2\nO5\nG0 X1\nM99 (c)\n",
      "o<q> sub\nG0 X#1\no<q> endsub [4] (c)\no<q> call [1]\nG0 Y#<_value>\nM2\n",
      "o<q> sub\nG0 X#1\no<q> endsub [4] [3]\no<q> call [1]\nM2\n",
      "o<q> sub\nG0 X#1\no<q> endsub (c) [3]\no<q> call [1]\nM2\n",
      "o<q> sub\nG0 X#1\no<q> return [4] [3]\no<q> endsub\no<q> call [1]\nM2\n",
      "o<q> sub [3]\nG0 X#1\no<q> endsub\no<q> call [1]\nM2\n",
      "o1 do [3]\nG0 X1\no1 while [0]\nM2\n",
      "o1 do (c)\nG0 X1\no1 while [0] (c)\nM2\n",
      "o1 if (c) [1]\nG0 X1\no1 endif\nM2\n",
      "o1 if [1] [2]\nG0 X1\no1 endif\nM2\n",
      "o1 if [1]\nG0 X1\no1 endif [3]\nM2\n",
      "o1 if [1] (c)\nG0 X1\no1 else (d)\no1 endif (e)\nM2\n",
      "#1=2\no1 while [#1 gt 0]\n#1=[#1-1]\no1 continue [3]\no1 endwhile\nM2\n",
  };
  for (const std::string& text : programs) expect_as_linuxcnc(scratch, text);
}

/// What a block of G41 does after it has turned compensation on, and what one of M6 does before the tool is there.
TEST(Language, OrderWithinABlockIsThatOfLinuxCnc) {
  const Scratch scratch;
  const std::string start = "F100 G0 X0 Y0 Z0\n", on = start + "G41.1 D4 ", end = "\nX30\nG40 X40\nM2\n";
  const std::vector<std::string> programs{
      on + "G55 G1 X10 Y10" + end,
      on + "G61 G1 X10 Y10" + end,
      on + "G49 G1 X10 Y10" + end,
      on + "G53 G1 X10 Y10" + end,
      on + "G99 G1 X10 Y10" + end,
      on + "G28" + end,
      on + "G92 X1" + end,
      on + "G52 X1" + end,
      on + "G81 X1 Z-1 R1" + end,
      on + "G5 X1 Y3 I1 J1 P1 Q1" + end,
      on + "G38.2 X10 Y10" + end,
      start + "G81 X1 Z-1 R1\nG41.1 D4 X5 Y10" + end,
      on + "G90 G1 X10 Y10" + end,
      on + "G91 G20 G17 G1 X10 Y10\nX3\nG40 X2\nM2\n",
      on + "M48 M62 P1 G1 X10 Y10" + end,
      start + "T2 M6 G41.1 D4\nG1 X10 Y10" + end,
      "T1 M6 G43 H0\nM2\n",
      "T2 M6\nT3 G43 H0 M6\nG43 H0\nM2\n",
      "T99999 M6\n(debug,#<_current_pocket> #<_selected_pocket>)\nM2\n",
      "T3\nM61 Q2\n(debug,#<_current_pocket> #<_selected_pocket>)\nM2\n",
  };
  for (const std::string& text : programs) expect_as_linuxcnc(scratch, text);
  // LinuxCNC loses the entry move: refused, though rs274 runs it.
  const auto lost = canonical_text(*parse(start + "T2 M6 G41.1 D4 G1 X10 Y10" + end, "lost.ngc"));
  ASSERT_FALSE(lost.has_value());
  EXPECT_EQ(lost.error().id, "GC121");
  EXPECT_EQ(plain("T1 M6\n#1=#<_current_pocket>\nM2\n").substr(0, 5), "GC169");
}

/// LinuxCNC 2.9 remembers what it passes on the way out of a loop; nothing of that is in its reference.
TEST(Language, LoopsThatAreLeftEarlyAreAsInLinuxCnc) {
  const std::string head = "G21 G90 F100\n#1=0 #2=0\n";
  const std::string continued = "o1 do\n#1=[#1+1]\no1 continue\no1 while [#1 lt 2]\n";
  const std::string loop = "o9 while [#2 lt 5]\n#2=[#2+1]\nG1 X#2\no8 if [#2 eq 2]\no9 break\no8 endif\no9 endwhile\n";
  const std::string twice = "o7 repeat [2]\nG1 X9\no7 endrepeat\n";
  const std::string first_free =
      "o<f> sub\no4 repeat [3]\nG1 X#1\no5 if [#1 gt 0]\no<f> return [#1]\no5 endif\no4 endrepeat\no<f> endsub [-1]\n";
  const std::vector<std::string> programs{
      "o1 do\n#1=[#1+1]\no2 if [#1 MOD 2 eq 0]\no1 continue\no2 endif\no3 if [#1 gt 6]\no1 break\no3 endif\nG1 X#1\n"
      "o1 while [#1 lt 10]\n" +
          loop,
      continued + loop,
      continued + twice + "o3 repeat [2]\nG1 X8\no3 endrepeat\n",
      continued + "o6 while [#2 lt 2]\n#2=[#2+1]\nG1 X#2\no6 endwhile\n" + twice,
      continued + "o6 do\n#2=[#2+1]\nG1 X#2\no6 break\no6 while [#2 lt 4]\n" + twice,
      "o6 do\no6 break\no6 break\no6 while [#1 lt 2]\no5 do\n#1=[#1+1]\nG1 X#1\no5 while [#1 lt 2]\n",
      "o6 while [#1 lt 4]\n#1=[#1+1]\no5 do\n#2=[#2+1]\nG1 X#2\no5 while [#2 lt 2]\no6 continue\no6 break\no6 "
      "endwhile\n",
      "o6 while [#1 lt 3]\n#1=[#1+1]\no5 repeat [2]\nG1 X#1\no6 continue\no5 endrepeat\no6 endwhile\n",
      first_free + "o<f> call [1]\no<f> call [2]\no<f> call [3]\no<f> call [4]\no<f> call [5]\n",
      // The level that cycles go back to keeps its number where the unit changes among them.
      "G98 G0 X0 Y0 Z25.4\nG81 X10 Y10 Z-3 R2\nG20\nG81 X.8 Y.4 Z-.12 R.1 F4\nX1.2\nG80\n",
      "S100 M3\nM19\nM19 R20\nM67 E0\nM68 E1\nG1 X1\n",
      // Each further sign turns the number over once more.
      "G1 X--1.5 Y+-3 Z---.4 F--120\nG1 X- -6 Y-+5\n#1=--8\nG1 X#1 Y[3--2]\n",
      // A shift that the program writes counts where another system is selected and in G10 L20.
      "G92 X1\nG1 X3\n#5211=2\nG55\n(DEBUG, #5420)\nG1 Y4\nG54\nT1 M6\nG1 Y5\n",
      "#5210=1\n#5212=2\nG10 L2 P2 R30\nG55\nG1 X4\nG10 L20 P1 Y3\nG54\nG1 X5\n",
  };
  const Scratch scratch;
  for (const std::string& body : programs) {
    const std::string text = head + body + "M2\n", path = scratch / "loops.ngc";
    std::ofstream(path) << text;
    const Reference theirs = rs274(scratch, path, {});
    ASSERT_TRUE(theirs.accepted) << text << theirs.errors;
    const auto ours = canonical_text(*parse(text, path));
    ASSERT_TRUE(ours.has_value()) << text << to_string(ours.error());
    EXPECT_EQ(*ours, theirs.text) << text;
  }
  for (const std::string word : {"M19 R400", "M66", "M66 P0 E0", "M62", "M67", "M68 Q1"}) {
    const std::string text = head + "S100 M3\n" + word + "\nM2\n", path = scratch / "words.ngc";
    std::ofstream(path) << text;
    EXPECT_FALSE(rs274(scratch, path, {}).accepted) << word;
    EXPECT_FALSE(canonical_text(*parse(text, path)).has_value()) << word;
    const auto as_it_is = interpret(*parse(text.substr(text.find("S100")), path));
    ASSERT_FALSE(as_it_is.has_value()) << word;
    EXPECT_EQ(as_it_is.error().id, "GC132") << word;
    EXPECT_EQ(plain("#1=1\n" + word + "\nM2\n").substr(0, 5), "GC132") << word;
  }
}

TEST(Language, RandomProgramsAsLinuxCncPrintsThem) {
  const Scratch scratch;
  int accepted = 0;
  int byte_for_byte = 0;
  int refused = 0;
  const bool good = rc::check("canonical text agrees with rs274", [&] {
    const unsigned seed = *rc::gen::arbitrary<unsigned>();
    const std::string text = Author(seed, true).program(40);
    const std::string path = scratch / "random.ngc";
    std::ofstream(path) << text;
    auto program = parse(text, path);
    RC_ASSERT(program.has_value());
    const Reference theirs = rs274(scratch, path, {});
    const auto ours = canonical_text(*program);
    const std::string said = ours ? "" : to_string(ours.error());
    keep_failed(ours.has_value() != theirs.accepted, text);
    if (ours.has_value() != theirs.accepted) RC_FAIL("Polypod: " + said + "; rs274: " + theirs.errors);
    ++(ours ? accepted : refused);
    if (!ours) return;
    const std::string a = without_signs_of_zeros(*ours);
    const std::string b = without_signs_of_zeros(theirs.text);
    byte_for_byte += a == b ? 1 : 0;
    if (a == b) return;
    // Compensated corners and lengths in another unit end at numbers whose last printed digit rounding decides.
    const bool rounds = text.find("G41.1") != std::string::npos || text.find("G42.1") != std::string::npos ||
                        text.find("G20") != std::string::npos;
    const auto found = rounds ? difference(a, b) : std::optional<std::string>("the texts differ");
    keep_failed(found.has_value(), text);
    if (found) RC_FAIL(*found);
  });
  EXPECT_TRUE(good);
  EXPECT_GT(accepted, refused) << "most programs are to be compared, not refused";
  std::printf("random programs: %d the same (%d byte for byte), %d refused by both\n", accepted, byte_for_byte,
              refused);
}

/// LinuxCNC reads the value of an `endsub` that it passes by; without the machine it may not be known.
TEST(Language, AValuePassedByMayNotBeKnown) {
  const auto unrolled = [](const std::string& value) {
    const auto program =
        parse("G21 G90 G0 X0 Y0 Z20\no100 sub\nG1 X[#<_value>] F100\no100 endsub [" + value + "]\no100 call\nM2\n",
              "value.ngc");
    return unroll(*program);
  };
  const auto known = unrolled("2 + 3");
  ASSERT_TRUE(known) << to_string(known.error());
  EXPECT_THAT(to_text(known->program), ::testing::HasSubstr("X5"));
  const auto unknown = unrolled("#1 GE 2");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().id, "GC169");
}

/// The unrolled program, without the machine: its moves end where those of rs274 do.
TEST(Language, UnrolledProgramsMoveAsLinuxCncMoves) {
  const Scratch scratch;
  int accepted = 0;
  int gouging = 0;
  int refused = 0;
  const bool good = rc::check("moves of the unrolled program agree with rs274", [&] {
    const std::string text = Author(*rc::gen::arbitrary<unsigned>(), false).program(40);
    const std::string path = scratch / "random.ngc";
    std::ofstream(path) << text;
    auto program = parse(text, path);
    RC_ASSERT(program.has_value());
    const Reference theirs = rs274(scratch, path, {});
    const auto unrolled = unroll(*program);
    const std::string said = unrolled ? "" : to_string(unrolled.error());
    // Compensated paths that cut into the contour are refused, and so is where LinuxCNC loses its place, and what
    // depends on parameters that the program has not set.
    const bool gouges =
        theirs.accepted && (said.starts_with("GC175") || said.find("loses its place") != std::string::npos ||
                            said.find("'endsub' that was passed by") != std::string::npos);
    keep_failed(unrolled.has_value() != theirs.accepted && !gouges, text);
    if (unrolled.has_value() != theirs.accepted && !gouges) RC_FAIL("Polypod: " + said + "; rs274: " + theirs.errors);
    ++(unrolled ? accepted : gouges ? gouging : refused);
    if (!unrolled) return;
    RC_ASSERT(!needs_unrolling(unrolled->program));
    const auto run = interpret(unrolled->program);
    keep_failed(!run, text);
    if (!run) RC_FAIL(to_string(run.error()));
    std::vector<Vec3> ends;
    for (const Move& move : run->moves) ends.push_back(move.end * 1e3);
    const std::vector<Vec3> theirs_ends = ends_of(theirs.text);
    const bool inches = text.find("G20") != std::string::npos;
    const bool same = same_way(ends, theirs_ends, inches);
    keep_failed(!same, text);
    RC_ASSERT(same);
    // The plain program is one for LinuxCNC, too, and there it moves alike.
    const std::string plain = scratch / "plain.ngc";
    std::ofstream(plain) << to_text(unrolled->program);
    const Reference again = rs274(scratch, plain, {});
    RC_ASSERT(again.accepted);
    const bool alike = same_way(ends_of(again.text), theirs_ends, inches);
    keep_failed(!alike, text);
    RC_ASSERT(alike);
  });
  EXPECT_TRUE(good);
  EXPECT_GT(accepted, refused) << "most programs are to be compared, not refused";
  std::printf("unrolled programs: %d move alike, %d refused for their gouges, %d refused by both\n", accepted, gouging,
              refused);
}

}  // namespace
}  // namespace polypod::gcode
