// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Canonical moves against LinuxCNC's own interpreter: every line of every good program, and thousands of random moves.
#include "polypod/gcode/canon.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "paths.hpp"
#include "polypod/core/files.hpp"
#include "polypod/gcode/interpreter.hpp"
#include "rs274.hpp"

namespace polypod::gcode {
namespace {

void expect_same_lines(const std::string& ours, const std::string& theirs) {
  if (ours == theirs) return;
  const auto a = lines(ours);
  const auto b = lines(theirs);
  for (std::size_t i = 0; i < std::max(a.size(), b.size()); ++i) {
    const std::string x = i < a.size() ? a[i] : "(nothing)";
    const std::string y = i < b.size() ? b[i] : "(nothing)";
    ASSERT_EQ(x, y) << "line " << i + 1;
  }
}

std::vector<std::string> programs_in(const fs::path& folder) {
  std::vector<std::string> found;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".ngc") found.push_back(entry.path().string());
  }
  std::ranges::sort(found);
  return found;
}

CanonOptions options_beside(const std::string& program) {
  CanonOptions options;
  if (const auto table = fs::path(program).replace_extension(".tbl"); fs::exists(table)) options.tool_table = table;
  if (const auto parameters = fs::path(program).replace_extension(".var"); fs::exists(parameters)) {
    options.parameters = parameters;
  }
  return options;
}

TEST(Canon, EveryGoodProgramAsLinuxCncPrintsIt) {
  const Scratch scratch;
  auto programs = programs_in(test::source("tests/gcode/good"));
  ASSERT_GE(programs.size(), 25u);
  for (const char* name : {"freecad_profile", "freecad_pocket"}) {
    programs.push_back(test::source(std::string("examples/") + name + "/program.ngc"));
  }
  for (const std::string& path : programs) {
    for (const bool block_delete : {false, true}) {
      SCOPED_TRACE(path + (block_delete ? " with block delete" : ""));
      auto program = read(path);
      ASSERT_TRUE(program.has_value()) << to_string(program.error());
      CanonOptions options = options_beside(path);
      options.block_delete = block_delete;
      const auto ours = canonical_text(*program, options);
      ASSERT_TRUE(ours.has_value()) << to_string(ours.error());
      const Reference theirs = rs274(scratch, path, options);
      ASSERT_TRUE(theirs.accepted) << theirs.errors;
      expect_same_lines(*ours, theirs.text);
    }
  }
}

/// What `bad/NAME.ngc` must be refused with stands in `bad/NAME.expected`: id, line, column, and whether rs274 refuses
/// it too (`both`) or understands what Polypod does not (`polypod`).
TEST(Canon, EveryBadProgramIsRefusedAtItsPlace) {
  const Scratch scratch;
  const auto programs = programs_in(test::source("tests/gcode/bad"));
  ASSERT_GE(programs.size(), 25u);
  for (const std::string& path : programs) {
    SCOPED_TRACE(path);
    std::istringstream expected(slurp(fs::path(path).replace_extension(".expected")));
    std::string id;
    std::string who;
    int line = 0;
    int column = 0;
    ASSERT_TRUE(expected >> id >> line >> column >> who);
    auto program = read(path);
    const auto ours = program ? canonical_text(*program) : tl::unexpected(program.error());
    ASSERT_FALSE(ours.has_value());
    EXPECT_EQ(ours.error().id, id) << to_string(ours.error());
    EXPECT_EQ(ours.error().place.line, line) << to_string(ours.error());
    EXPECT_EQ(ours.error().place.column, column) << to_string(ours.error());
    EXPECT_EQ(rs274(scratch, path, {}).accepted, who == "polypod");
  }
}

/// Blocks of every kind of motion, with numbers of three decimals so that sums are short too, from a state that the
/// generator follows; arcs are built to be valid.
std::string random_program(unsigned seed, std::size_t blocks) {
  std::mt19937 random(seed);
  std::string text = "G21 G90 G17 G94 F100\nG0 X0 Y0 Z0\n";
  std::array<double, 3> p{};
  double unit = 1;  // program units to mm
  bool incremental = false;
  int plane = 0;
  const auto pick = [&](int low, int high) { return std::uniform_int_distribution<int>(low, high)(random); };
  const auto milli = [&](int most) { return pick(-most * 1000, most * 1000) / 1000.0; };
  const std::array<std::array<int, 3>, 3> planes{{{0, 1, 2}, {2, 0, 1}, {1, 2, 0}}};
  for (std::size_t i = 0; i < blocks; ++i) {
    const int kind = pick(0, 19);
    if (kind == 0) {
      incremental = !incremental;
      text += incremental ? "G91\n" : "G90\n";
    } else if (kind == 1) {
      plane = pick(0, 2);
      text += fmt::format("G{}\n", 17 + plane);
    } else if (kind == 2) {
      unit = unit == 1 ? 25.4 : 1;
      text += unit == 1 ? "G21\n" : "G20\n";
      // Given again, so that both count from numbers that the program holds.
      for (double& x : p) x = 0;
      text += "G90 G0 X0 Y0 Z0\n";
      incremental = false;
    } else if (kind < 12) {
      text += pick(0, 1) == 0 ? "G0" : "G1";
      bool any = false;
      for (std::size_t k = 0; k < 3; ++k) {
        if (k < 2 || any ? pick(0, 1) == 0 : false) continue;
        any = true;
        const double to = milli(200);
        text += fmt::format(" {}{:.3f}", "XYZ"[k], to);
        p[k] = incremental ? p[k] + to : to;
      }
      text += '\n';
    } else {
      const auto [a, b, n] = planes[static_cast<std::size_t>(plane)];
      const auto ua = static_cast<std::size_t>(a);
      const auto ub = static_cast<std::size_t>(b);
      const auto un = static_cast<std::size_t>(n);
      const int g = pick(2, 3);
      // The end is the start turned about the centre by a right angle times 0 to 3: exact in decimals.
      const double i1 = milli(50);
      const double i2 = pick(1, 50000) / 1000.0;
      const int quarter = pick(0, 3);
      const double c = quarter == 0 ? 1 : quarter == 2 ? -1 : 0;
      const double s = quarter == 1 ? 1 : quarter == 3 ? -1 : 0;
      const double da = i1 - (c * i1 - s * i2);
      const double db = i2 - (s * i1 + c * i2);
      const double dn = pick(0, 2) == 0 ? milli(20) : 0;
      const double fa = incremental ? 0 : p[ua];
      const double fb = incremental ? 0 : p[ub];
      text += fmt::format("G{} {}{:.3f} {}{:.3f}", g, "XYZ"[ua], fa + da, "XYZ"[ub], fb + db);
      if (dn != 0) text += fmt::format(" {}{:.3f}", "XYZ"[un], incremental ? dn : p[un] + dn);
      if (pick(0, 3) == 0 && quarter != 0) {
        const double radius = std::hypot(da, db) * (0.501 + pick(0, 100) / 50.0);
        text += fmt::format(" R{:.3f}", pick(0, 1) == 0 ? radius : -radius);
      } else {
        text += fmt::format(" {}{:.3f} {}{:.3f}", "IJK"[ua], i1, "IJK"[ub], i2);
      }
      if (pick(0, 5) == 0) text += fmt::format(" P{}", pick(1, 4));
      text += '\n';
      p[ua] += da;
      p[ub] += db;
      p[un] += dn;
    }
  }
  return text + "M2\n";
}

/// One program a trial, long, because starting rs274 costs more than running it.
TEST(Canon, RandomProgramsAsLinuxCncPrintsThem) {
  const Scratch scratch;
  const bool good = rc::check("canonical text and end points agree with rs274", [&] {
    const std::string text = random_program(*rc::gen::arbitrary<unsigned>(), 200);
    const std::string path = scratch / "random.ngc";
    std::ofstream(path) << text;
    auto program = parse(text, path);
    RC_ASSERT(program.has_value());
    const Reference theirs = rs274(scratch, path, {});
    const auto ours = canonical_text(*program);
    RC_ASSERT(ours.has_value() == theirs.accepted);
    if (!ours) return;
    RC_ASSERT(*ours == theirs.text);

    // The interpreter's own end points, in mm, against the numbers that rs274 printed with four decimals.
    const auto run = interpret(*program);
    RC_ASSERT(run.has_value());
    std::size_t at = 0;
    double unit = 1e-3;
    for (const std::string& line : lines(theirs.text)) {
      if (line.find("UNITS_INCHES") != std::string::npos) unit = 25.4e-3;
      if (line.find("UNITS_MM") != std::string::npos) unit = 1e-3;
      const bool straight = line.find("STRAIGHT_") != std::string::npos;
      const bool arc = line.find("ARC_FEED") != std::string::npos;
      if (!straight && !arc) continue;
      RC_ASSERT(at < run->moves.size());
      const Move& move = run->moves[at++];
      double n[6] = {};
      RC_ASSERT(std::sscanf(line.c_str() + line.find('('), "(%lf, %lf, %lf, %lf, %lf, %lf", n, n + 1, n + 2, n + 3,
                            n + 4, n + 5) >= 4);
      Vec3 end(n[0], n[1], n[2]);
      if (arc) {
        const std::array<int, 3> order = move.plane == Plane::xy   ? std::array<int, 3>{0, 1, 2}
                                         : move.plane == Plane::zx ? std::array<int, 3>{2, 0, 1}
                                                                   : std::array<int, 3>{1, 2, 0};
        end[order[0]] = n[0];
        end[order[1]] = n[1];
        end[order[2]] = n[5];
        Vec3 centre = move.start;
        centre[order[0]] = n[2] * unit;
        centre[order[1]] = n[3] * unit;
        // Half of the fourth decimal, twice for the two coordinates.
        RC_ASSERT((centre - move.centre).norm() <= 1.0e-4 * unit);
        RC_ASSERT(move.clockwise == (n[4] < 0));
      }
      RC_ASSERT((end * unit - move.end).cwiseAbs().maxCoeff() <= 0.51e-4 * unit);
    }
    RC_ASSERT(at == run->moves.size());
  });
  EXPECT_TRUE(good);
}

TEST(Canon, RefusesMissingTablesAndTools) {
  const Scratch scratch;
  const auto program = *parse("T9 M6\nG43\nG0 X1\nM2\n", "part.ngc");
  const auto expect = [&](const CanonOptions& options, const std::string& id, const std::string& file, int line,
                          int column) {
    const auto text = canonical_text(program, options);
    ASSERT_FALSE(text.has_value());
    EXPECT_EQ(text.error().id, id) << to_string(text.error());
    EXPECT_EQ(text.error().place.file, file);
    EXPECT_EQ(text.error().place.line, line);
    EXPECT_EQ(text.error().place.column, column);
  };
  const auto with_table = [](const std::string& path) {
    CanonOptions options;
    options.tool_table = path;
    return options;
  };
  const auto with_parameters = [](const std::string& path) {
    CanonOptions options;
    options.parameters = path;
    return options;
  };
  const auto file = [&](const std::string& name, const std::string& text) {
    std::ofstream(scratch / name) << text;
    return scratch / name;
  };
  expect({}, "GC151", "part.ngc", 1, 1);
  const std::string table = file("a.tbl", "T1 P1 Z1\n\n; remark\nT9 P2 Zx\n");
  expect(with_table(table), "GC152", table, 4, 7);
  const std::string no_pocket = file("b.tbl", "T9 Z1\n");
  expect(with_table(no_pocket), "GC152", no_pocket, 1, 1);
  const std::string parameters = file("a.var", "5220 1\n5221 ten\n");
  expect(with_parameters(parameters), "GC152", parameters, 2, 1);
  const std::string system = file("c.var", "5220 12\n");
  expect(with_parameters(system), "GC152", system, 1, 6);
  // As rs274 has them.
  const std::string falling = file("d.var", "5241 1.5\n5221 2\n"), twice = file("e.var", "5241 1.5\n5241 2\n");
  expect(with_parameters(falling), "GC152", falling, 2, 1);
  expect(with_parameters(twice), "GC152", twice, 2, 1);
  for (const char* number : {"0", "5602", "9999"}) {
    const std::string beyond = file("f.var", std::string(number) + " 1\n");
    expect(with_parameters(beyond), "GC152", beyond, 1, 1);
  }
  EXPECT_EQ(canonical_text(program, with_parameters(file("g.var", "1 1\n5601 2\n"))).error().id, "GC151");
  expect(with_table(scratch / "none.tbl"), "FI100", scratch / "none.tbl", 0, 0);
  EXPECT_TRUE(canonical_text(program, with_table(file("c.tbl", "T9 P2 Z+1.5\n"))).has_value());
}

TEST(Canon, NeedsAnEnd) {
  const auto program = *parse("G0 X1\n", "part.ngc");
  const auto text = canonical_text(program);
  ASSERT_FALSE(text.has_value());
  EXPECT_EQ(text.error().id, "GC150");
}

}  // namespace
}  // namespace polypod::gcode
