// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cutter radius compensation against LinuxCNC's interpreter: random contours, and the unrolled program.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <optional>
#include <random>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "plain.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/canon.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "polypod/gcode/unroll.hpp"
#include "rs274.hpp"

namespace polypod::gcode {
namespace {

constexpr double kPi = std::numbers::pi;

struct Mix {
  bool arcs = true;
  bool rapids = true;
  bool between = true;   // blocks that do not move, and moves along Z and A
  bool modes = true;     // G91, G90.1, G93, G20
  bool grid = false;     // whole millimetres and right angles
  bool spirals = false;  // arcs whose radii at start and end differ, nearly as far as rs274 lets them
};

/// Random contours, each with an entry and an exit. Arcs end on their circle as near as five decimals can say, but for
/// spirals.
class Contours {
 public:
  Contours(unsigned seed, const Mix& mix) : random_(seed), mix_(mix) {}

  std::string program(int contours) {
    text_ = "G21 G17 G90 G94 F100\nG0 X0 Y0 Z0\n";
    if (mix_.modes && pick(0, 4) == 0) {
      text_ += "G20 G0 X0 Y0 Z0\n";
      unit_ = 1 / 25.4;
    }
    for (int i = 0; i < contours; ++i) contour();
    return text_ + "M2\n";
  }

 private:
  int pick(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  static double rounded(double x) { return std::round(x * 1e5) / 1e5; }

  void go(int g, double x, double y, const std::string& rest = "") {
    if (incremental_) {
      text_ += fmt::format("G{} X{:.5f} Y{:.5f}{}", g, x - x_, y - y_, rest);
    } else {
      text_ += fmt::format("G{} X{:.5f} Y{:.5f}{}", g, x, y, rest);
    }
    if (inverse_ && g != 0) text_ += fmt::format(" F{}", pick(1, 9));
    text_ += '\n';
    x_ = rounded(x);
    y_ = rounded(y);
  }

  void contour() {
    const std::array<double, 4> diameters{0.5, 2, 4, 6};
    const double diameter = diameters[static_cast<std::size_t>(pick(0, 3))] * unit_;
    x_ = rounded(mix_.grid ? pick(-9, 9) : between(-5, 5) * unit_);
    y_ = rounded(mix_.grid ? pick(-9, 9) : between(-5, 5) * unit_);
    incremental_ = inverse_ = false;
    text_ += fmt::format("G0 G90 G94 F100 X{:.5f} Y{:.5f}\n", x_, y_);
    const bool left = pick(0, 1) == 0;
    if (pick(0, 5) == 0 && unit_ == 1) {
      // By number: T1 to T3 of rs274's own table have 3.175, 1.5875 and 5.1054 mm.
      text_ += fmt::format("G{} D{}\n", left ? 41 : 42, pick(1, 3));
    } else {
      text_ += fmt::format("G{}.1 D{:.5f}\n", left ? 41 : 42, (pick(0, 19) == 0 ? -1 : 1) * diameter);
    }
    if (mix_.modes) mode();
    heading_ = direction();
    const std::array<double, 3> sizes{6, 15, 40};
    scale_ = sizes[static_cast<std::size_t>(pick(0, 2))] * unit_;
    const int count = pick(1, 7);
    for (int i = 0; i < count; ++i) {
      if (i > 0 && mix_.between && pick(0, 3) == 0) interlude();
      move(i == 0);
    }
    text_ += pick(0, 3) == 0 ? "G40 G49 G80 G54 G64 G99\n" : "G40\n";
    incremental_ = inverse_ = false;
    text_ += fmt::format("G90 G91.1 G94 F100 G1 {}\n", pick(0, 1) == 0 ? "X0" : "Z3");
  }

  double direction() { return mix_.grid ? pick(-1, 2) * kPi / 2 : between(-kPi, kPi); }

  void mode() {
    switch (pick(0, 7)) {
      case 0:
        text_ += "G91\n";
        incremental_ = true;
        break;
      case 1:
        text_ += "G93\n";
        inverse_ = true;
        break;
      default:
        break;
    }
  }

  void interlude() {
    const std::array<const char*, 15> blocks{"M8",      "(a remark)", "S100",   "G4 P0.5", "M3",
                                             "(msg,x)", "T1",         "M9 (b)", "M0",      "G17",
                                             "M5",      "N50 M7",     "G97 S5", "M5 S50",  "(debug,#5420 #<_y>)"};
    switch (pick(0, 5)) {
      case 0:
        text_ += fmt::format("G1 {}{}{}\n", incremental_ ? "Z" : "Z", pick(-3, 3), inverse_ ? " F3" : "");
        break;
      case 1:
        text_ += fmt::format("G1 A{}{}\n", pick(-3, 3), inverse_ ? " F3" : "");
        break;
      default:
        text_ += blocks[static_cast<std::size_t>(pick(0, blocks.size() - 1))];
        text_ += '\n';
    }
  }

  void move(bool first) {
    // A third goes on as the last one ended, some nearly, some nearly back.
    const int joint = pick(0, 11);
    double heading = direction();
    if (!first && joint < 4) heading = heading_;
    if (!first && !mix_.grid && joint == 4) heading = heading_ + between(-0.06, 0.06);
    if (!first && !mix_.grid && joint == 5) heading = heading_ + kPi + between(-0.06, 0.06);
    std::string rest;
    if (mix_.between && pick(0, 4) == 0) rest += fmt::format(" Z{}", pick(-3, 3));
    if (mix_.between && pick(0, 9) == 0) rest += fmt::format(" A{}", pick(-3, 3));
    if (!mix_.arcs || pick(0, 1) == 0) {
      const double length = mix_.grid ? pick(1, 12) : between(0.5 * unit_, scale_);
      const double x = x_;
      const double y = y_;
      go(mix_.rapids && pick(0, 5) == 0 ? 0 : 1, x_ + length * std::cos(heading), y_ + length * std::sin(heading),
         rest);
      heading_ = std::atan2(y_ - y, x_ - x);
      return;
    }
    const int turn = pick(0, 1) == 0 ? 1 : -1;
    const double radius = mix_.grid ? pick(1, 9) : between(0.5 * unit_, scale_ / 2);
    const double sweep = mix_.grid || pick(0, 1) == 0 ? pick(1, 4) * kPi / 2 : between(0.05, 6.2);
    const double i = rounded(-turn * radius * std::sin(heading));
    const double j = rounded(turn * radius * std::cos(heading));
    const double cx = x_ + i;
    const double cy = y_ + j;
    const double from = std::atan2(-j, -i);
    const double r = std::hypot(i, j);
    const double allowed = std::max((unit_ == 1 ? 0.028 : 0.0028), 0.00099 * r);
    const double last = r + (mix_.spirals ? between(-allowed, allowed) : 0);
    const double x = rounded(cx + last * std::cos(from + turn * sweep));
    const double y = rounded(cy + last * std::sin(from + turn * sweep));
    if (mix_.modes && pick(0, 5) == 0) {
      rest = fmt::format(" I{:.5f} J{:.5f} G90.1", cx, cy) + rest;
    } else if (!mix_.spirals && sweep < 3 && pick(0, 5) == 0) {
      rest = fmt::format(" R{:.5f}", r) + rest;
    } else {
      rest = fmt::format(" I{:.5f} J{:.5f}{}", i, j, mix_.modes ? " G91.1" : "") + rest;
    }
    if (pick(0, 9) == 0) rest += " P2";
    go(turn > 0 ? 3 : 2, x, y, rest);
    heading_ = std::atan2(y - cy, x - cx) + turn * kPi / 2;
  }

  std::mt19937 random_;
  Mix mix_;
  std::string text_;
  double unit_ = 1;  // mm to program units
  double scale_ = 10;
  double x_ = 0;
  double y_ = 0;
  double heading_ = 0;
  bool incremental_ = false;
  bool inverse_ = false;
};

/// `text` with every diameter by this factor.
std::string with_diameters(const std::string& text, double factor) {
  static const std::regex diameter("D([0-9.]+)");
  std::string out;
  std::size_t at = 0;
  for (std::sregex_iterator i(text.begin(), text.end(), diameter), end; i != end; ++i) {
    out += text.substr(at, static_cast<std::size_t>(i->position()) - at);
    out += fmt::format("D{:.9f}", std::stod((*i)[1]) * factor);
    at = static_cast<std::size_t>(i->position() + i->length());
  }
  return out + text.substr(at);
}

/// Whether the tool fits into the contours by no more than rounding.
bool fits_by_rounding(const std::string& text, const std::string& path) {
  const auto accepted = [&](double factor) {
    const auto program = parse(with_diameters(text, factor), path);
    return program && canonical_text(*program).has_value();
  };
  return accepted(1 - 1e-6) != accepted(1 + 1e-6);
}

struct Count {
  int same = 0;
  int byte_for_byte = 0;
  int refused = 0;
};

Count compare(const Scratch& scratch, const Mix& mix, const char* what, int contours) {
  Count count;
  const bool good = rc::check(what, [&] {
    const std::string text = Contours(*rc::gen::arbitrary<unsigned>(), mix).program(contours);
    const std::string path = scratch / "contour.ngc";
    std::ofstream(path) << text;
    const auto program = parse(text, path);
    RC_ASSERT(program.has_value());
    const Reference theirs = rs274(scratch, path, {});
    const auto ours = canonical_text(*program);
    const std::string said = ours ? "" : to_string(ours.error());
    if (ours.has_value() != theirs.accepted && fits_by_rounding(text, path)) return;
    keep_failed(ours.has_value() != theirs.accepted, text);
    if (ours.has_value() != theirs.accepted) RC_FAIL("Polypod: " + said + "; rs274: " + theirs.errors);
    if (!ours) {
      ++count.refused;
      return;
    }
    ++count.same;
    count.byte_for_byte += *ours == theirs.text ? 1 : 0;
    const auto found = difference(*ours, theirs.text);
    keep_failed(found.has_value(), text);
    if (found) RC_FAIL(*found);
  });
  EXPECT_TRUE(good);
  std::printf("%s: %d the same (%d byte for byte), %d refused by both\n", what, count.same, count.byte_for_byte,
              count.refused);
  return count;
}

TEST(Compensation, RandomLinesAsLinuxCncPrintsThem) {
  const Scratch scratch;
  Mix mix;
  mix.arcs = mix.between = mix.modes = false;
  const Count count = compare(scratch, mix, "lines", 1);
  EXPECT_GT(count.same, 20);
  EXPECT_GT(count.refused, 5);
}

TEST(Compensation, RandomLinesAndArcsAsLinuxCncPrintsThem) {
  const Scratch scratch;
  Mix mix;
  mix.between = mix.modes = false;
  const Count count = compare(scratch, mix, "lines and arcs", 1);
  EXPECT_GT(count.same, 20);
  EXPECT_GT(count.refused, 5);
}

TEST(Compensation, RandomProgramsAsLinuxCncPrintsThem) {
  const Scratch scratch;
  const Count count = compare(scratch, {}, "contours with blocks between their moves", 1);
  EXPECT_GT(count.same, 20);
  EXPECT_GT(count.refused, 5);
}

TEST(Compensation, SeveralContoursAsLinuxCncPrintsThem) {
  const Scratch scratch;
  const Count count = compare(scratch, {}, "two contours", 2);
  EXPECT_GT(count.same, 5);
}

/// A line, or an arc, that turns back behind an arc which the tool meets from outside, with and without a stop between
/// them: behind the stop LinuxCNC no longer knows of the arc.
TEST(Compensation, TurnsBackBehindAStopAsLinuxCncPrintsThem) {
  const Scratch scratch;
  int same = 0;
  for (const auto& [side, g] : {std::pair{41, 2}, std::pair{42, 3}, std::pair{41, 3}}) {
    for (const double off : {-0.06, -0.04, -0.003, 0.003, 0.04, 0.06}) {
      for (const char* stop : {"", "M0\n", "M60\n"}) {
        const int turns = g == 3 ? 1 : -1;
        const double first = 0.3, last = first + turns * 1.2, along = turns * std::numbers::pi / 2;
        const auto at = [](double angle, double r) { return std::pair{r * std::cos(angle), r * std::sin(angle)}; };
        const auto [x0, y0] = at(first, 5);
        const auto [x1, y1] = at(last, 5);
        const auto [ux, uy] = at(first + along, 3);
        const auto [vx, vy] = at(last + along + std::numbers::pi + off, 8);
        const std::string text = fmt::format(
            "G21 G17 G90 G94 F100\nG0 X{:.6f} Y{:.6f} Z0\nG{}.1 D2\nG1 X{:.6f} Y{:.6f}\nG{} X{:.6f} Y{:.6f} I{:.6f} "
            "J{:.6f}\n{}G1 X{:.6f} Y{:.6f} Z3\nG40\nG1 X30 Y30\nM2\n",
            x0 - ux, y0 - uy, side, x0, y0, g, x1, y1, -x0, -y0, stop, x1 + vx, y1 + vy);
        const std::string path = scratch / "back.ngc";
        std::ofstream(path) << text;
        const auto program = parse(text, path);
        ASSERT_TRUE(program.has_value());
        const Reference theirs = rs274(scratch, path, {});
        const auto ours = canonical_text(*program);
        ASSERT_EQ(ours.has_value(), theirs.accepted) << text;
        if (!ours) continue;
        const auto found = difference(*ours, theirs.text);
        EXPECT_FALSE(found) << *found << "\n" << text;
        ++same;
      }
    }
  }
  EXPECT_GT(same, 20);
}

/// Corners and arcs on a grid, where inside corners are as wide as the tool, and radii as large.
TEST(Compensation, ContoursOnAGridAsLinuxCncPrintsThem) {
  const Scratch scratch;
  Mix mix;
  mix.between = mix.modes = mix.rapids = false;
  mix.grid = true;
  const Count count = compare(scratch, mix, "contours on a grid", 1);
  EXPECT_GT(count.same, 5);
}

/// Arcs whose radii at start and end differ: rs274 moves the corner before one onto the circle through its end.
TEST(Compensation, SpiralsAsLinuxCncPrintsThem) {
  const Scratch scratch;
  Mix mix;
  mix.between = false;
  mix.spirals = true;
  const Count count = compare(scratch, mix, "spirals", 1);
  EXPECT_GT(count.same, 20);
  EXPECT_GT(count.refused, 5);
}

/// The moves of canonical text, with all that they print.
std::vector<Call> moves_of(const std::string& text) {
  std::vector<Call> moves;
  double unit = 1;
  for (const std::string& line : lines(text)) {
    if (line.find("UNITS_INCHES") != std::string::npos) unit = 25.4;
    if (line.find("UNITS_MM") != std::string::npos) unit = 1;
    if (line.find("STRAIGHT_") == std::string::npos && line.find("ARC_FEED") == std::string::npos) continue;
    Call call = call_of(line);
    const bool arc = call.name == "ARC_FEED";
    for (std::size_t k = 0; k < (arc ? 6 : 3); ++k) {
      if (!arc || k != 4) call.numbers[k] *= unit;
    }
    moves.push_back(std::move(call));
  }
  return moves;
}

/// The unrolled program, run by rs274, moves along the compensated path: the same lines and arcs, within two printed
/// digits (inches: 25 times as much). rs274 accepts paths that cut into the contour; they are refused.
TEST(Compensation, UnrolledContoursMoveAsLinuxCncMoves) {
  const Scratch scratch;
  int same = 0;
  int gouging = 0;
  int refused = 0;
  const bool good = rc::check("unrolled contours", [&] {
    const std::string text = Contours(*rc::gen::arbitrary<unsigned>(), {}).program(1);
    const std::string path = scratch / "contour.ngc";
    std::ofstream(path) << text;
    const auto program = parse(text, path);
    RC_ASSERT(program.has_value());
    const Reference theirs = rs274(scratch, path, {});
    UnrollOptions options;
    for (const auto& [tool, inches] : {std::pair{1, 0.125}, std::pair{2, 0.0625}, std::pair{3, 0.201}}) {
      options.diameters[tool] = units::from_inch(inches);
    }
    const auto unrolled = unroll(*program, options);
    const std::string said = unrolled ? "" : to_string(unrolled.error());
    if (!unrolled) {
      const bool beyond = unrolled.error().id == "GC175" || said.find("negative diameter") != std::string::npos;
      keep_failed(theirs.accepted && !beyond, text);
      if (theirs.accepted && !beyond) RC_FAIL(said);
      ++(theirs.accepted ? gouging : refused);
      return;
    }
    keep_failed(!theirs.accepted, text);
    RC_ASSERT(theirs.accepted);
    const auto run = interpret(unrolled->program);
    keep_failed(!run, text);
    if (!run) RC_FAIL(to_string(run.error()));
    const std::string plain = scratch / "plain.ngc";
    std::ofstream(plain) << to_text(unrolled->program);
    const Reference again = rs274(scratch, plain, {});
    keep_failed(!again.accepted, text);
    if (!again.accepted) RC_FAIL(again.errors);
    const auto a = moves_of(again.text);
    const auto b = moves_of(theirs.text);
    keep_failed(a.size() != b.size(), text);
    RC_ASSERT(a.size() == b.size());
    RC_ASSERT(run->moves.size() == b.size());
    const double digits = text.find("G20") != std::string::npos ? 25.4 * 2.01e-4 : 2.01e-4;
    for (std::size_t i = 0; i < a.size(); ++i) {
      bool equal = a[i].name == b[i].name && a[i].numbers.size() == b[i].numbers.size();
      for (std::size_t k = 0; equal && k < a[i].numbers.size(); ++k) {
        const double tolerance = digits + 1e-5 * std::max(0.0, std::abs(b[i].numbers[k]) - 100);
        equal = std::abs(a[i].numbers[k] - b[i].numbers[k]) <= tolerance;
      }
      keep_failed(!equal, text);
      RC_ASSERT(equal);
    }
    ++same;
  });
  EXPECT_TRUE(good);
  std::printf("unrolled contours: %d the same, %d refused for their gouges, %d refused by both\n", same, gouging,
              refused);
  EXPECT_GT(same, 20);
}

TEST(Compensation, UnrolledBlocksStandWhereTheyStood) {
  EXPECT_EQ(plain("G0 X0 Y0 Z0\nG41.1 D4 F100\nN5 G1 X10 Y0 (a)\nX20 M8\n(b)\nM9\nY10\nX40\nG40\nG0 Z5\nX0\nM2\n"),
            "G0 X0 Y0 Z0\nF100\nG1 X10 Y2 (a)\nM8 G1 X18 Y2\n(b)\nM9\nG1 X18 Y10\nG2 X20 Y12 I2 J0\nG1 X40 Y12\nG40\n"
            "G0 X40 Y10 Z5\nX0\nM2\n");
  EXPECT_EQ(plain("G0 X0 Y0 Z0\nG91 G42.1 D4 F100\nG1 X10\nX10\nY10\nG2 X10 Y-10 I10\nG40 G90\nG1 X0\nM2\n"),
            "G0 X0 Y0 Z0\nG91 F100\nG1 X10 Y-2\nG1 X10 Y0\nG3 X2 Y2 I0 J2\nG1 X0 Y10\nG2 X8 Y-8 I8 J0\nG40 G90\nG1 X0 "
            "Y0\nM2\n");
}

TEST(Compensation, AnyCharacterOfACommentStays) {
  EXPECT_EQ(plain("G0 X0 Y0 Z0\nG41.1 D4 F100 (\x01)\nG1 X10 (\x01"
                  "0\x02)\nX20\nG40\nX30\nM2\n"),
            "G0 X0 Y0 Z0\nF100 (\x01)\nG1 X10 Y2 (\x01"
            "0\x02)\nG1 X20 Y2\nG40\nG1 X30 Y0\nM2\n");
}

TEST(Compensation, DiametersAreThoseOfTheJob) {
  UnrollOptions options;
  const std::string contour = "G1 X20 Y0 F100\nX40\nG40\nX60\nM2\n";
  const auto at = [&](const std::string& head) {
    const std::string text = plain("G0 X0 Y0 Z0\n" + head + "\n" + contour, options);
    const std::size_t y = text.find("G1 X40 Y");
    return y == std::string::npos ? text : text.substr(y + 8, text.find('\n', y) - y - 8);
  };
  EXPECT_EQ(at("G41").substr(0, 5), "GC171");
  EXPECT_EQ(at("G41 D1").substr(0, 5), "GC171");
  EXPECT_EQ(at("G41.1 D3"), "1.5");
  options.diameter = 8e-3;
  EXPECT_EQ(at("G41"), "4");
  EXPECT_EQ(at("T7 M6\nG42"), "-4");
  EXPECT_EQ(at("T7 M6\nG42 D7"), "-4");
  EXPECT_EQ(at("T7 M6\nG42 D0"), "-4");
  EXPECT_EQ(at("T7 M6\nG42 D8").substr(0, 5), "GC171");  // another tool than that in the spindle
  options.diameters[8] = 5e-3;
  EXPECT_EQ(at("T7 M6\nG42 D8"), "-2.5");
  EXPECT_EQ(at("T8 M6\nG42"), "-2.5");
  EXPECT_EQ(at("T7 M6\nG42"), "-4");
  EXPECT_EQ(at("T8 M6\nG10 L1 P8 R2\nG42"), "-2");
  // LinuxCNC takes the tool before.
  EXPECT_EQ(at("T8 M6 G42").substr(0, 5), "GC171");
  EXPECT_EQ(at("T8 M6 G42 D8"), "-2.5");
  EXPECT_EQ(at("M61 Q8\nG42").substr(0, 5), "GC171");
  EXPECT_EQ(at("T0 M6\nG42").substr(0, 5), "GC171");
}

/// LinuxCNC moves along these; the tool would cut into the contour.
TEST(Compensation, WhatCutsIntoTheContourIsRefused) {
  const Scratch scratch;
  struct Bad {
    std::string text;
    std::string start;
  };
  const std::string head = "G0 X0 Y0 Z0 F100\nG41.1 D4\nG1 X10 Y0\nX50\n";
  for (const Bad& bad : std::vector<Bad>{
           // A line that runs backward from an inside corner to a tangent joint.
           {head + "Y1.5\nY30\nG40\nG1 X0\nM2\n", "GC175 part.ngc:6:1: line 5:"},
           // A stop in an inside corner.
           {head + "M0\nY30\nG40\nG1 X0\nM2\n", "GC175 part.ngc:6:1:"},
           // A joint of 0.049 rad before an arc that is hardly larger than the tool.
           {head + "G3 X52.15036 Y2.0475 I0.1004 J2.0475\nG1 Y30\nG40\nG1 X0\nM2\n", "GC175 part.ngc:6:1: line 5:"},
           // An entry arc that comes to bend away from the contour.
           {"G0 X0 Y0 Z0 F100\nG42.1 D1\nG2 X-0.7495 Y2.258 I-5.8878 J-0.701\nG40\nG1 X0\nM2\n", "GC175 part.ngc:3:1:"},
           // The closing % leaves the last move out.
           {"%\n" + head + "%\n", "GC176 part.ngc:6:1:"},
           // Where the first move begins is not known.
           {"F100\nG41.1 D4\nG1 X10 Y0\nX50\nG40\nX60\nM2\n", "GC169 part.ngc:2:1:"},
       }) {
    const std::string got = plain(bad.text);
    EXPECT_EQ(got.substr(0, bad.start.size()), bad.start) << bad.text << got;
    const std::string path = scratch / "gouge.ngc";
    std::ofstream(path) << bad.text;
    EXPECT_TRUE(rs274(scratch, path, {}).accepted) << bad.text;
  }
}

}  // namespace
}  // namespace polypod::gcode
