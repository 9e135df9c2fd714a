// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/config.hpp"
#include "polypod/core/table_text.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <unistd.h>

#include <filesystem>

#include "polypod/core/files.hpp"
#include "polypod/core/named_files.hpp"

namespace polypod::config {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Table table_of(const std::string& text) {
  auto table = parse(text, "t.toml");
  EXPECT_TRUE(table) << to_string(table.error());
  return table ? *table : Table{};
}

/// The id and the place of the error that a Result carries: `CF105 3:7`.
template <class R>
std::string where(const R& result) {
  if (result) return "no error";
  const Error& e = result.error();
  return e.id + " " + std::to_string(e.place.line) + ":" + std::to_string(e.place.column);
}

TEST(Config, ValuesOfEveryKind) {
  const Table t = table_of(R"(
length_mm = 12.5
teeth = 4
name = "end mill"
dry = true
axis = [0, 0, 1]
joints_mm = [[1, 2], [3, 4]]
notes = ["a", "b"]
[tool]
x = 1
[[leg]]
l = 1
[[leg]]
l = 2
)");
  EXPECT_EQ(*t.number("length_mm"), 12.5);
  EXPECT_EQ(*t.number("teeth"), 4) << "a whole number is a number";
  EXPECT_EQ(*t.integer("teeth", 1, 99), 4);
  EXPECT_EQ(*t.text("name"), "end mill");
  EXPECT_EQ(*t.optional_boolean("dry", false), true);
  EXPECT_THAT(*t.numbers("axis", 3), ElementsAre(0, 0, 1));
  EXPECT_THAT(*t.points("joints_mm", 2), ElementsAre(ElementsAre(1, 2), ElementsAre(3, 4)));
  EXPECT_THAT(*t.optional_texts("notes"), ElementsAre("a", "b"));
  EXPECT_EQ(*t.table("tool")->number("x"), 1);
  const auto legs = t.tables("leg");
  ASSERT_EQ(legs->size(), 2u);
  EXPECT_EQ(*(*legs)[1].number("l"), 2);
  EXPECT_TRUE(t.finish());
}

TEST(Config, OptionalValuesThatAreAbsent) {
  const Table t = table_of("");
  EXPECT_EQ(*t.optional_number("a", 3.5), 3.5);
  EXPECT_EQ(*t.optional_integer("b", 7, 0, 9), 7);
  EXPECT_EQ(*t.optional_text("c", "z"), "z");
  EXPECT_EQ(*t.optional_boolean("d", true), true);
  EXPECT_FALSE(t.optional_table("e")->has_value());
  EXPECT_TRUE(t.tables("f")->empty());
  EXPECT_TRUE(t.optional_texts("g")->empty());
  EXPECT_TRUE(t.finish());
}

TEST(Config, CF101NotToml) {
  const auto t = parse("a = 1\nb = = 2\n", "t.toml");
  ASSERT_FALSE(t);
  EXPECT_EQ(t.error().id, "CF101");
  EXPECT_EQ(t.error().place.line, 2);
  EXPECT_EQ(t.error().place.file, "t.toml");
  EXPECT_EQ(parse("[a", "t").error().id, "CF101") << "a truncated file";
  EXPECT_EQ(parse("a = 1\na = 2\n", "t").error().id, "CF101") << "a key given twice";
  EXPECT_EQ(parse("a = \"\xff\"", "t").error().id, "CF101") << "not UTF-8";
}

TEST(Config, CF101CharactersBeyondAsciiStandInQuotesAndCommentsOnly) {
  EXPECT_EQ(where(parse("a = 1\nž = 2\n", "t")), "CF101 2:1");
  EXPECT_EQ(where(parse("s = \"žž\" ž\n", "t")), "CF101 1:10") << "columns count characters";
  EXPECT_EQ(where(parse("a = 1 \u00a9\n", "t")), "CF101 1:7");
  const Table t = table_of("# šđž\ns = \"ž\" # ž\n\"ž\" = 1\n");
  EXPECT_EQ(*t.text("s"), "ž");
  EXPECT_EQ(*t.number("ž"), 1);
}

TEST(Config, CF102Dates) {
  EXPECT_EQ(where(parse("a = 1\nd = 2026-01-12\n", "t")), "CF102 2:5");
  EXPECT_EQ(where(parse("a = [1, [07:30:00]]\n", "t")), "CF102 1:10") << "inside arrays too";
}

TEST(Config, CF103UnknownKeys) {
  const Table t = table_of("known = 1\n\nunknwon = 2\n");
  EXPECT_TRUE(t.number("known"));
  const auto status = t.finish();
  EXPECT_EQ(where(status), "CF103 3:11");
  EXPECT_THAT(status.error().message, HasSubstr("unknwon"));
  EXPECT_THAT(status.error().hint, HasSubstr("known"));
}

/// What was only looked for is known as well: the list is whole, and a near miss of it is found.
TEST(Config, CF103ListsKeysThatWereOnlyLookedFor) {
  const Table t = table_of("tolerance = 1\njoint_acceleration = [1, 2]\n");
  EXPECT_TRUE(t.number("tolerance"));
  EXPECT_FALSE(t.has("joint_accelerations"));
  EXPECT_FALSE(t.holds_text("cutter"));
  EXPECT_THAT(t.finish().error().hint,
              "did you mean joint_accelerations? known here: cutter, joint_accelerations, tolerance");
  // It does not count as read: a value that nobody takes is refused.
  EXPECT_TRUE(t.has("joint_acceleration"));
  EXPECT_EQ(where(t.finish()), "CF103 2:22");
}

TEST(Config, CF103NamesTheTableOfTheKey) {
  const Table t = table_of("[tool]\nlength_mm = 1\nlenth_mm = 2\n");
  const auto tool = t.table("tool");
  EXPECT_TRUE(tool->number("length_mm"));
  EXPECT_THAT(tool->finish().error().message, HasSubstr("tool.lenth_mm"));
  EXPECT_TRUE(t.finish()) << "the outer table was asked for `tool`";
}

TEST(Config, CF103SeesWhatACopyWasAskedFor) {
  const Table t = table_of("a = 1\n");
  const Table copy = t;
  EXPECT_TRUE(copy.number("a"));
  EXPECT_TRUE(t.finish());
}

TEST(Config, CF104WrongKinds) {
  const Table t = table_of("n = 1.5\ns = \"x\"\nb = true\na = [1, \"x\"]\nt = {}\np = [1]\nq = [[1, \"x\"]]\n");
  EXPECT_EQ(where(t.number("s")), "CF104 2:5");
  EXPECT_EQ(where(t.optional_number("b", 0)), "CF104 3:5");
  EXPECT_EQ(where(t.integer("n", 0, 9)), "CF104 1:5") << "1.5 is not whole";
  EXPECT_EQ(where(t.text("n")), "CF104 1:5");
  EXPECT_EQ(where(t.optional_text("n", "")), "CF104 1:5");
  EXPECT_EQ(where(t.optional_boolean("n", true)), "CF104 1:5");
  EXPECT_EQ(where(t.numbers("n")), "CF104 1:5");
  EXPECT_EQ(where(t.numbers("a")), "CF104 4:9");
  EXPECT_THAT(t.numbers("a").error().message, HasSubstr("a[2]")) << "elements count from 1";
  EXPECT_EQ(where(t.points("p", 2)), "CF104 6:6");
  EXPECT_EQ(where(t.points("n", 2)), "CF104 1:5");
  EXPECT_EQ(where(t.points("q", 2)), "CF104 7:10");
  EXPECT_EQ(where(t.table("n")), "CF104 1:5");
  EXPECT_EQ(where(t.optional_table("s")), "CF104 2:5");
  EXPECT_EQ(where(t.tables("a")), "CF104 4:6");
  EXPECT_EQ(where(t.tables("s")), "CF104 2:5");
  EXPECT_EQ(where(t.optional_texts("a")), "CF104 4:6");
  EXPECT_EQ(where(t.optional_texts("n")), "CF104 1:5");
}

TEST(Config, CF105OutOfRange) {
  const Table t = table_of("zero = 0\nminus = -1\ninf = inf\nnan = nan\nten = 10\nv = [1, nan]\n");
  EXPECT_EQ(where(t.number("zero", kPositive)), "CF105 1:8");
  EXPECT_TRUE(t.number("zero", kNotNegative));
  EXPECT_EQ(where(t.number("minus", kNotNegative)), "CF105 2:9");
  EXPECT_EQ(where(t.number("inf")), "CF105 3:7") << "no key takes a number that is not finite";
  EXPECT_EQ(where(t.number("nan")), "CF105 4:7");
  EXPECT_EQ(where(t.integer("ten", 1, 9)), "CF105 5:7");
  EXPECT_EQ(where(t.numbers("v")), "CF105 6:9");
  EXPECT_EQ(where(t.number("ten", Range{0, 10, false, true})), "CF105 5:7") << "10 is not below 10";
  EXPECT_TRUE(t.number("ten", Range{0, 10}));
  EXPECT_THAT(t.integer("ten", 1, 9).error().message, HasSubstr("ten = 10 must be at least 1 and at most 9"));
  EXPECT_THAT(t.number("zero", kPositive).error().message, HasSubstr("greater than 0"));
}

TEST(Config, CF105LengthsOfMoreThanAThousandKilometres) {
  const Table t = table_of(R"(
a_mm = 1e12
b_mm = -1e9
c_mm = [1, -1.1e9]
d_mm = [[1, 2], [1e10, 4]]
force_N = 1e12
stiffness_N_per_mm2 = 1e12
)");
  EXPECT_EQ(where(t.number("a_mm")), "CF105 2:8");
  EXPECT_EQ(where(t.optional_number("a_mm", 0)), "CF105 2:8");
  EXPECT_TRUE(t.number("b_mm"));
  EXPECT_EQ(where(t.numbers("c_mm")), "CF105 4:12");
  EXPECT_EQ(where(t.points("d_mm", 2)), "CF105 5:18");
  EXPECT_TRUE(t.number("force_N") && t.number("stiffness_N_per_mm2"));
  EXPECT_THAT(to_string(t.number("a_mm").error()), HasSubstr("a_mm = 1e+12"));
}

TEST(Config, CF105AnglesOfMoreTurnsThanAnyJointMakes) {
  const Table t = table_of("a_deg = 1e308\nb_deg = -1e6\nc_deg = [1, -1.1e6]\n");
  EXPECT_EQ(where(t.number("a_deg")), "CF105 1:9");
  EXPECT_TRUE(t.number("b_deg"));
  EXPECT_EQ(where(t.numbers("c_deg")), "CF105 3:13");
}

TEST(Config, CF106MissingKeys) {
  const Table t = table_of("a = 1\n[tool]\nx = 1\n");
  const auto missing = t.number("b");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().id, "CF106");
  EXPECT_EQ(missing.error().place.file, "t.toml");
  EXPECT_EQ(where(t.table("tool")->number("y")).substr(0, 7), "CF106 2") << "the place of the table";
  EXPECT_THAT(t.table("tool")->number("y").error().message, HasSubstr("tool.y"));
  for (const auto& id : {where(t.text("b")), where(t.integer("b", 0, 1)), where(t.numbers("b")),
                         where(t.points("b", 2)), where(t.table("b"))}) {
    EXPECT_EQ(id.substr(0, 5), "CF106");
  }
}

TEST(Config, CF107WrongLengths) {
  const Table t = table_of("a = [1, 2]\np = [[1, 2], [3]]\n");
  EXPECT_EQ(where(t.numbers("a", 3)), "CF107 1:5");
  EXPECT_EQ(where(t.points("p", 2)), "CF107 2:14");
  EXPECT_THAT(t.points("p", 2).error().message, HasSubstr("p[2] has 1 numbers, but must have 2"));
}

TEST(Config, ReplaceReachesIntoTablesAndArrays) {
  Table t = table_of("a = 1\nl = [1, 2]\nd = [{ x = 1 }, { x = 2 }]\n[tool]\nlength_mm = 10\n");
  EXPECT_TRUE(t.replace("a", 5));
  EXPECT_TRUE(t.replace("tool.length_mm", 20));
  EXPECT_TRUE(t.replace("l[2]", 7));
  EXPECT_TRUE(t.replace("d[1].x", 8));
  EXPECT_TRUE(t.replace("tool.radius_mm", 3)) << "a new key, which finish() judges";
  EXPECT_EQ(*t.number("a"), 5);
  EXPECT_EQ(*t.integer("a", 0, 9), 5) << "5 is a whole number";
  EXPECT_THAT(*t.numbers("l"), ElementsAre(1, 7));
  EXPECT_EQ(*(*t.tables("d"))[0].number("x"), 8);
  const auto tool = t.table("tool");
  EXPECT_EQ(*tool->number("length_mm"), 20);
  EXPECT_EQ(tool->finish().error().id, "CF103");

  for (const char* path : {"no.x", "l[0]", "l[3]", "l[x]", "l[2", "a[1]", "a.b", "d[1]", "l", "", "tool", ".a"}) {
    Table same = table_of("a = 1\nl = [1, 2]\nd = [{ x = 1 }]\n[tool]\nlength_mm = 10\n");
    const bool replaced = same.replace(path, 1);
    // A whole table or array must not silently become a number.
    EXPECT_FALSE(replaced) << path;
  }
}

TEST(Config, Beside) {
  EXPECT_EQ(beside("jobs/a.toml", "b.ngc"), "jobs/b.ngc");
  EXPECT_EQ(beside("jobs/a.toml", "../b.ngc"), "b.ngc");
  EXPECT_EQ(beside("a.toml", "b.ngc"), "b.ngc");
  EXPECT_EQ(beside("jobs/a.toml", "/b.ngc"), "/b.ngc");
}

TEST(Config, FI100WhereTheFileIsMissing) {
  const auto t = read_file("no/such/file.toml");
  ASSERT_FALSE(t);
  EXPECT_EQ(t.error().id, "FI100");
  EXPECT_EQ(t.error().place.file, "no/such/file.toml");
}

TEST(Config, EveryFiniteNumberReadsBack) {
  EXPECT_TRUE(rc::check("a number written with 17 digits is read exactly", [](double x) {
    if (!std::isfinite(x)) return;
    char text[64];
    std::snprintf(text, sizeof text, "x = %.17e\n", x);
    const auto table = parse(text, "t");
    RC_ASSERT(table.has_value());
    RC_ASSERT(*table->number("x") == x);
  }));
}

TEST(Config, AnyTextIsReadOrRefusedWithAnId) {
  EXPECT_TRUE(rc::check("parse never fails without an id", [](const std::string& text) {
    const auto table = parse(text, "t");
    if (!table) RC_ASSERT(table.error().id == "CF101" || table.error().id == "CF102");
  }));
}

std::string repeated(const std::string& what, int times) {
  std::string out;
  for (int i = 0; i < times; ++i) out += what;
  return out;
}

TEST(Config, CF106NamesWhatStandsInThePlaceOfAMissingKey) {
  const auto message = [](const std::string& text, const char* key) {
    const Table t = table_of(text);
    const auto value = t.number(key, kAnyFinite);
    return value ? "" : fmt::format("{}, {}:{}", value.error().message, value.error().place.line, value.error().hint);
  };
  EXPECT_EQ(message("a = 1\ntolerance_mm = 0.1\n", "tolerance_um"),
            "tolerance_um is missing; tolerance_mm stands here, 2:write tolerance_um if that is meant; else add it");
  EXPECT_EQ(message("a = 1\ndiameter_mn = 8\ndiamatar_mm = 8\ndiamater_mm = 8\n", "diameter_mm"),
            "diameter_mm is missing; diamater_mm stands here, 4:write diameter_mm if that is meant; else add it");
  EXPECT_EQ(message("Kac_N_per_mm2 = 1\n", "Krc_N_per_mm2"), "Krc_N_per_mm2 is missing, 1:add this key");
  EXPECT_EQ(message("x_mm = 1\n", "y_mm"), "y_mm is missing, 1:add this key");
  for (const char* near : {"diametre_mm", "diamter_mm", "diammeter_mm", "diameter_um"})
    EXPECT_THAT(message(fmt::format("{} = 1\n", near), "diameter_mm"), ::testing::HasSubstr(near));
  for (const char* other : {"Kac_N_per_mm2", "Kte_N_per_mm", "Krc"})
    EXPECT_EQ(message(fmt::format("{} = 1\n", other), "Krc_N_per_mm2").find("stands"), std::string::npos) << other;
}

TEST(Config, CF108WhatNestsTooDeepIsNotParsed) {
  EXPECT_EQ(where(parse("b = 1\n" + repeated("a.", 6000) + "a = 1\n", "t")), "CF108 2:32");
  EXPECT_EQ(where(parse("[" + repeated("a.", 100'000) + "a]\n", "t")), "CF108 1:33");
  EXPECT_EQ(where(parse("[[" + repeated("'\u00e4' . ", 6000) + "a]]\n", "t")), "CF108 1:97");
  EXPECT_EQ(where(parse("x = " + repeated("[", 200'000), "t")), "CF108 1:21");
  EXPECT_EQ(where(parse("x = " + repeated("{a=", 6000), "t")), "CF108 1:53");
  EXPECT_EQ(where(parse("x = { " + repeated("a.", 17) + "a = 1 }", "t")), "CF108 1:38");
}

TEST(Config, CF108ReadsOnlyKeysAndBrackets) {
  const std::string dots = repeated(".", 50), brackets = repeated("[", 50), three = R"(""")";
  const Table t =
      table_of("a = \"" + dots + "\\\"" + brackets + "\" # " + dots + brackets + "\nb = '" + brackets +
               "'\nc = " + three + "\n" + brackets + "\"\n\\\"" + three + "\nd = '''" + dots + "'\n" + brackets +
               "'''\ne = [" + repeated("1.5, ", 50) + "]\nh = " + repeated("[", 14) + repeated("]", 14) + "\n");
  EXPECT_EQ(*t.text("a"), dots + "\"" + brackets);
  EXPECT_EQ(*t.text("c"), brackets + "\"\n\"");
  EXPECT_EQ(t.numbers("e")->size(), 50u);
  EXPECT_EQ(where(parse("a = '" + brackets + "\nb = 1\n", "t")), "CF101 1:56") << "left to the parser";
  EXPECT_TRUE(parse(repeated("a.", 14) + "a = 1\n", "t"));
}

TEST(Config, CF105LengthsBeyondAnyMachine) {
  const Table t = table_of("a_mm = 1e9\nb_mm = -1.1e9\nc_mm = [1, 2e9]\nd_mm = [[1, 2e9]]\ne_N = 1e12\n");
  EXPECT_EQ(*t.number("a_mm"), 1e9);
  EXPECT_EQ(where(t.number("b_mm")), "CF105 2:8");
  EXPECT_EQ(where(t.numbers("c_mm")), "CF105 3:12");
  EXPECT_EQ(where(t.points("d_mm", 2)), "CF105 4:13");
  EXPECT_EQ(*t.number("e_N"), 1e12);
}

TEST(Config, NumbersBelowTheSmallestNormalOne) {
  EXPECT_EQ(*table_of("a = 4e-320\n").number("a"), 4e-320);
}

TEST(Config, FilesThatAFileNames) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::temp_directory_path() / ("polypod-named-" + std::to_string(::getpid()));
  fs::create_directories(folder / "sub");
  const auto put = [&](const char* name, const std::string& text) {
    ASSERT_TRUE(files::write_whole((folder / name).string(), text));
  };
  put("job.toml",
      "machine = 'm.toml'\nname = 'no such file'\nfiles = ['a.csv', 'sub/../a.csv', 'sub']\n"
      "[[tool]]\ncutter = 'sub/cutter.toml'\n");
  put("m.toml", "name = 'job.toml'\n");  // a circle
  put("a.csv", "x = 'm.toml'\n");
  put("sub/cutter.toml", "material = 'steel.toml'\n");
  put("sub/steel.toml", "x = 1\n");
  std::vector<std::string> found;
  for (const std::string& file : files_named_by((folder / "job.toml").string()))
    found.push_back(fs::relative(file, folder).string());
  EXPECT_THAT(found,
              ::testing::UnorderedElementsAre("job.toml", "m.toml", "a.csv", "sub/cutter.toml", "sub/steel.toml"));
  EXPECT_TRUE(files_named_by((folder / "none.toml").string()).empty());
  fs::remove_all(folder);
}

TEST(Config, ATableAsTextHasTheSameValues) {
  const std::string file =
      (std::filesystem::temp_directory_path() / ("polypod-table-" + std::to_string(::getpid()))).string();
  ASSERT_TRUE(
      files::write_whole(file,
                         "a = 1\n[masses] # of parts\nx = 0.1\nlist = [1, 2.5e-9, { y = true }]\n'odd \"key' = "
                         "'a\\b\"'\n[masses.inner]\nz = 30.0\n[[masses.row]]\nday = 2024-02-03\n[next]\nx = 3\n"));
  const std::string text = table_text(file, "masses");
  EXPECT_THAT(text, ::testing::HasSubstr("\nx = 0.1\n"));
  EXPECT_THAT(text, ::testing::Not(::testing::HasSubstr("next")));
  // Written once more it is the same text: nothing was lost.
  ASSERT_TRUE(files::write_whole(file, text));
  EXPECT_EQ(table_text(file, "masses"), text);
  EXPECT_THAT(text, ::testing::HasSubstr("list = [1, 2.5e-09, { y = true }]\n"));
  EXPECT_THAT(text, ::testing::HasSubstr(R"(inner = { z = 30 })"));
  EXPECT_THAT(text, ::testing::HasSubstr("row = [{ day = 2024-02-03 }]"));
  EXPECT_EQ(table_text(file, "none"), "");
  ASSERT_TRUE(files::write_whole(file, "[masses\n"));
  EXPECT_EQ(table_text(file, "masses"), "");
  std::filesystem::remove(file);
  EXPECT_EQ(table_text(file, "masses"), "");
}

}  // namespace
}  // namespace polypod::config
