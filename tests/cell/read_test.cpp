// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Cell files: what is read, and that each fault is found where it stands.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "cells.hpp"
#include "paths.hpp"
#include "polypod/cell/cell.hpp"
#include "polypod/cell/rewrite.hpp"
#include "polypod/cell/sequence.hpp"

namespace polypod::cell {
namespace {

TEST(CellFile, TheSeedsCellHasItsCosts) {
  const auto cell = read(test::source("cells/kozubik/cell.toml"));
  ASSERT_TRUE(cell) << to_string(cell.error());
  // KOZ Table 5-3: 3 x 400, 5 x 1200, 1000, 250, 18 x 20, 18 x 10.
  EXPECT_DOUBLE_EQ(cell->cost.total(), 8990);
  EXPECT_DOUBLE_EQ(cell->cost.total() + cell->cost.reserve(), 10000);
  EXPECT_EQ(cell->cost.currency, "CZK");
  EXPECT_DOUBLE_EQ(cell->cost.hours, 100);
  EXPECT_EQ(cell->spots[0].slots.size(), 18U);
  // Tables 5-1 and 5-2.
  EXPECT_DOUBLE_EQ(cell->conveyors[0].length, 2.1);
  EXPECT_DOUBLE_EQ(cell->conveyors[1].frame_width, 0.18);
  EXPECT_DOUBLE_EQ(cell->conveyors[0].power, 200);
}

TEST(CellFile, APitchBesideOneSlotIsTaken) {
  std::string text = test::kPicking;
  text.replace(text.find("columns = 2"), 11, "columns = 1");
  text.replace(text.find("containers = 2"), 14, "containers = 1");
  const auto cell = from_text(text, "cell.toml");
  ASSERT_TRUE(cell) << to_string(cell.error());
  EXPECT_EQ(cell->spots[0].slots.size(), 1U);
}

/// The error of a cell in which one text takes the place of another.
Error error_of(const std::string& from, const std::string& to) {
  std::string text = test::kPicking;
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
  const auto cell = from_text(text, "cell.toml");
  if (cell) {
    ADD_FAILURE() << to << " was read";
    return {};
  }
  return cell.error();
}

TEST(CellFile, TheSmallCellIsRead) {
  const auto cell = from_text(test::kPicking, "cell.toml");
  ASSERT_TRUE(cell) << to_string(cell.error());
}

TEST(CellFile, FaultsAreFoundWhereTheyStand) {
  const struct {
    const char *from, *to, *id;
  } kFaults[] = {
      {"speed_mm_per_s = 100", "speed_mm_per_s = -100", "CE104"},
      {"speed_mm_per_s = 100", "speed_mm_per_s = 0", "CE104"},
      {"diameter_mm = 40\nheight_mm = 10", "diameter_mm = 500\nheight_mm = 10", "CE103"},
      {"across_mm = [-50, 50]", "across_mm = [-50, 190]", "CE103"},
      {"window_mm = [700, 900]", "window_mm = [900, 700]", "CE105"},
      {"window_mm = [700, 900]", "window_mm = [700, 9000]", "CE105"},
      {"at_mm = 0 #source", "at_mm = 950", "CE105"},
      {"to = \"holder\"", "to = \"hodler\"", "CE102"},
      {"machine = \"delta\"", "machine = \"dleta\"", "CE102"},
      {"kind = \"holder\"", "kind = \"folder\"", "CE102"},
      {"order = \"START\"", "order = \"GO\"", "CE102"},
      {"price = 10", "price = -10", "CF105"},
      {"name = \"holder\"", "name = \"A\"", "CE101"},
      {"diameter_mm = 100", "diameter_mm = 20", "CE103"},
      {"pitch_mm = 120", "pitch_mm = 90", "CE103"},
      {"file = \"delta-picker\"", "file = \"delta-pikcer\"", "MA100"},
      {"policy = \"first\"", "policy = \"last\"", "CE102"},
      {"minutes = 5", "minutes = 0", "CF105"},
      {"lift_mm = 40", "lift_mm = 40\ncolour = 3", "CF103"},
      {"lift_mm = 40", "lift_mm = 40\nmounted_on = [\"beam\"]", "CE102"},
      {"speed_mm_per_s = 100", "speed_mm_per_s = 100\nchute = \"slide\"", "CE102"},
  };
  for (const auto& fault : kFaults) {
    const Error error = error_of(fault.from, fault.to);
    EXPECT_EQ(error.id, fault.id) << fault.to << ": " << to_string(error);
    EXPECT_GT(error.place.line, 0) << to_string(error);
  }
  EXPECT_NE(error_of("to = \"holder\"", "to = \"hodler\"").hint.find("holder"), std::string::npos);
}

TEST(CellFile, AConveyorMustEndOverTheNext) {
  std::string text = test::kPicking;
  text +=
      "[[conveyor]]\nname = \"B\"\nat_mm = [0, 1000, 900]\nlength_mm = 500\nwidth_mm = 200\nspeed_mm_per_s = 50\nonto "
      "= \"A\"\n";
  const auto cell = from_text(text, "cell.toml");
  ASSERT_FALSE(cell);
  EXPECT_EQ(cell.error().id, "CE107");
  // Onto itself: items would go round for ever at one instant.
  const std::string itself =
      test::kPicking + std::string(
                           "[[conveyor]]\nname = \"C\"\nat_mm = [0, 2000, 900]\nlength_mm = 500\n"
                           "width_mm = 200\nspeed_mm_per_s = 50\nonto = \"C\"\n");
  const auto round = from_text(itself, "cell.toml");
  ASSERT_FALSE(round);
  EXPECT_EQ(round.error().id, "CE107");
}

TEST(CellFile, NumbersCanBeSetByName) {
  const auto cell =
      from_text(test::kPicking, "cell.toml", {{"conveyor.A.speed_mm_per_s", "250"}, {"source[1].per_minute", "20"}});
  ASSERT_TRUE(cell) << to_string(cell.error());
  EXPECT_DOUBLE_EQ(cell->conveyors[0].speed, 0.25);
  EXPECT_DOUBLE_EQ(cell->sources[0].rate, 20.0 / 60);
  EXPECT_EQ(from_text(test::kPicking, "cell.toml", {{"conveyor.Z.speed_mm_per_s", "250"}}).error().id, "CE108");
  EXPECT_EQ(from_text(test::kPicking, "cell.toml", {{"conveyor.A.speed_mm_per_s", "nan"}}).error().id, "CE108");
  EXPECT_EQ(from_text(test::kPicking, "cell.toml", {{"conveyor.A.sped_mm_per_s", "2"}}).error().id, "CF103");
}

std::string seeds_text() {
  std::ifstream in(test::source("cells/kozubik/cell.toml"));
  return {std::istreambuf_iterator<char>(in), {}};
}

// A kept cell needs no other file, and is the same cell: machines, times, costs.
TEST(KeptCell, IsTheSameCellWithoutOtherFiles) {
  const std::string file = test::source("cells/kozubik/cell.toml");
  const auto kept = self_contained(seeds_text(), file);
  ASSERT_TRUE(kept) << to_string(kept.error());
  EXPECT_EQ(kept->find("kuka-kr3.toml"), std::string::npos);
  const auto cell = from_text(*kept, "nowhere.toml");
  ASSERT_TRUE(cell) << to_string(cell.error());
  const auto original = read(file);
  ASSERT_TRUE(original);
  EXPECT_DOUBLE_EQ(cell->cost.total(), original->cost.total());
  ASSERT_EQ(cell->machines.size(), 2U);
  for (std::size_t m = 0; m < 2; ++m)
    EXPECT_EQ(machine::to_toml(cell->machines[m].model), machine::to_toml(original->machines[m].model));
  EXPECT_EQ(cell->assumptions, original->assumptions);
  EXPECT_EQ(cell->spots[0].slots, original->spots[0].slots);
  const auto twice = self_contained(*kept, "elsewhere.toml");
  ASSERT_TRUE(twice);
  EXPECT_EQ(*twice, *kept);
}

TEST(KeptCell, NumbersAreReplacedAndFoundByName) {
  const auto kept = self_contained(test::kPicking, "cell.toml",
                                   {{"conveyor.A.speed_mm_per_s", "120.5"}, {"task.fill.window_mm[2]", "950"}});
  ASSERT_TRUE(kept) << to_string(kept.error());
  const auto cell = from_text(*kept, "cell.toml");
  ASSERT_TRUE(cell) << to_string(cell.error());
  EXPECT_DOUBLE_EQ(cell->conveyors[0].speed, 0.1205);
  EXPECT_DOUBLE_EQ(cell->tasks[0].window_high, 0.95);
  double speed = 0, window = 0, price = 0, minutes = 0;
  for (const auto& [key, counted, value] : numbers_of(*kept)) {
    if (key == "conveyor.A.speed_mm_per_s") speed = value;
    if (key == "task.fill.window_mm[2]") window = value;
    if (key == "cost.part[1].price") price = value;
    if (key == "minutes") minutes = value;
    EXPECT_TRUE(from_text(*kept, "cell.toml", {{key, fmt::format("{}", value)}})) << key;
    EXPECT_EQ(number_at(*kept, key), value) << key;
    EXPECT_EQ(number_at(*kept, counted), value) << counted;
  }
  EXPECT_EQ(speed, 120.5);
  EXPECT_EQ(window, 950);
  EXPECT_EQ(price, 10);
  EXPECT_EQ(minutes, 5);
  EXPECT_EQ(counted_key(*kept, "task.fill.window_mm[2]"), "task[1].window_mm[2]");
  EXPECT_EQ(self_contained(test::kPicking, "cell.toml", {{"conveyor.Z.speed_mm_per_s", "1"}}).error().id, "CE108");
}

TEST(KeptCell, AMachineIsAFileOrItsText) {
  const auto kept = self_contained(test::kPicking, "cell.toml");
  ASSERT_TRUE(kept);
  std::string both = *kept;
  both.replace(both.find("grip_s"), 0, "file = \"delta-picker\"\n");
  EXPECT_EQ(from_text(both, "cell.toml").error().id, "CE106");
  std::string broken = *kept;
  broken.replace(broken.find("rotary-delta"), 12, "rotary-alpha");
  const auto cell = from_text(broken, "cell.toml");
  ASSERT_FALSE(cell);
  EXPECT_GT(cell.error().place.line, 0);
  EXPECT_NE(cell.error().message.find("`model`"), std::string::npos);
}

// Names that differ in signs or capitals alone, or are words of the language, become identifiers of their own.
TEST(PlcProgram, EachNameIsAnIdentifierOfItsOwn) {
  std::string text = test::kPicking;
  text.replace(text.find("name = \"small\""), 14, "name = \"Program\"");
  text += "[[conveyor]]\nname = \"a\"\nat_mm = [0, 3000, 900]\nlength_mm = 600\nwidth_mm = 400\nspeed_mm_per_s = 1\n";
  text += "[[conveyor]]\nname = \"-a-\"\nat_mm = [0, 4000, 900]\nlength_mm = 600\nwidth_mm = 400\nspeed_mm_per_s = 1\n";
  const auto cell = from_text(text, "cell.toml");
  ASSERT_TRUE(cell) << to_string(cell.error());
  const std::string program = structured_text(*cell);
  for (const char* line : {"PROGRAM Program_2\n", "  RunA : BOOL;", "  RunA_2 : BOOL;", "  RunA_3 : BOOL;"})
    EXPECT_NE(program.find(line), std::string::npos) << line << program;
}

TEST(CellFile, AContainerIsTakenNotAboveItsTop) {
  EXPECT_EQ(error_of("height_mm = 50", "height_mm = 50\ngrip_mm = 51").id, "CE103");
}

}  // namespace
}  // namespace polypod::cell
