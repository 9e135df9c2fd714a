// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/excerpt.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "polypod/core/config.hpp"
#include "polypod/core/csv.hpp"

namespace polypod {
namespace {

class Excerpt : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("polypod-excerpt-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string file(const std::string& name, const std::string& text) {
    const std::string path = (folder_ / name).string();
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }
  std::filesystem::path folder_;
};

std::string of(const std::string& path, const std::string& id, int line, int column, const std::string& message = "") {
  return excerpt({id, message, {path, line, column}, {}});
}

TEST(Underlined, TheWordUnderItsLine) {
  EXPECT_EQ(underlined(12, "G1 X10 Y1O F500", 7, 2), "   12 | G1 X10 Y1O F500\n      |        ^~");
  EXPECT_EQ(underlined(1, "a", 0, 1), "    1 | a\n      | ^");
  EXPECT_EQ(underlined(1, "a = 5  ", 0, 0), "    1 | a = 5");
}

TEST(Underlined, BehindTheLastCharacter) {
  EXPECT_EQ(underlined(3, "x = [1, 2", 9, 1), "    3 | x = [1, 2\n      |          ^");
  EXPECT_EQ(underlined(3, "x = 1", 99, 4), "    3 | x = 1\n      |      ^");
}

TEST(Underlined, TabsStayAndControlCharactersDoNot) {
  EXPECT_EQ(underlined(1, "\tX1\tY2", 4, 2), "    1 | \tX1\tY2\n      | \t  \t^~");
  // \x1b is four columns wide then, and so is the underline of a word that holds it.
  EXPECT_EQ(underlined(1, "a\x1b b", 3, 1), "    1 | a\\x1b b\n      |       ^");
  EXPECT_EQ(underlined(1, "a\x1b b", 1, 1), "    1 | a\\x1b b\n      |  ^~~~");
  EXPECT_EQ(underlined(1, "\xff\xfe x", 3, 1), "    1 | \\xff\\xfe x\n      |          ^");
}

TEST(Underlined, CharactersOfUtf8TakeTheirColumns) {
  EXPECT_EQ(underlined(1, "\xc3\xa4\xc3\xb6 x", 5, 1), "    1 | \xc3\xa4\xc3\xb6 x\n      |    ^");  // two umlauts
  EXPECT_EQ(underlined(1, "\xe5\xb7\xa5 x", 4, 1), "    1 | \xe5\xb7\xa5 x\n      |    ^");  // one of two columns
  EXPECT_EQ(underlined(1, "e\xcc\x81 x", 4, 1), "    1 | e\xcc\x81 x\n      |   ^");         // e with an accent
}

TEST(Underlined, LongLinesAreCutRoundTheWord) {
  constexpr std::size_t kHead = 8, kWidest = 100;
  const std::string before(300, 'a'), after(300, 'b');
  for (const std::string& line : {before + " WORD " + after, before + " WORD", "WORD " + after}) {
    const std::size_t at = line.find("WORD");
    const std::string shown = underlined(7, line, at, 4);
    const std::size_t end = shown.find('\n');
    const std::string text = shown.substr(kHead, end - kHead), marks = shown.substr(end + 1 + kHead);
    EXPECT_LE(text.size(), kWidest);
    EXPECT_GE(text.size(), kWidest - 8);
    EXPECT_EQ(text.find("WORD"), marks.find("^~~~")) << shown;
    EXPECT_EQ(text.starts_with("..."), at > 0);
    EXPECT_EQ(text.ends_with("..."), line.back() == 'b');
  }
  const std::string all_word = underlined(7, std::string(500, 'x'), 0, 500);
  EXPECT_LT(all_word.find('\n'), kHead + kWidest);
  EXPECT_NE(all_word.find("..."), std::string::npos);
}

TEST_F(Excerpt, OfValuesAndKeysOfToml) {
  const std::string path =
      file("m.toml",
           "# \xc3\xa4\nname = \"a \\\" b\" # c\nlist = [1, [2, 3], 4] # c\n[limits]\nx_mm = 1e99\n"
           "t = \"\xc3\xa4\xc3\xb6\", y = 5\n");
  EXPECT_EQ(of(path, "CF104", 2, 8), "    2 | name = \"a \\\" b\" # c\n      |        ^~~~~~~~\n");
  EXPECT_EQ(of(path, "CF107", 3, 8), "    3 | list = [1, [2, 3], 4] # c\n      |        ^~~~~~~~~~~~~~\n");
  EXPECT_EQ(of(path, "CF107", 3, 12), "    3 | list = [1, [2, 3], 4] # c\n      |            ^~~~~~\n");
  EXPECT_EQ(of(path, "CF106", 4, 1, "limits.z_mm is missing"), "    4 | [limits]\n      | ^~~~~~~~\n");
  EXPECT_EQ(of(path, "CF105", 5, 8), "    5 | x_mm = 1e99\n      |        ^~~~\n");
  EXPECT_EQ(of(path, "MA100", 6, 15),
            "    6 | t = \"\xc3\xa4\xc3\xb6\", y = 5\n      |               ^\n");        // characters count
  EXPECT_EQ(of(path, "CF106", 1, 1, "tolerance_um is missing"), "    1 | # \xc3\xa4\n");  // the file as a whole
}

TEST_F(Excerpt, UnknownKeysArePlacedAndUnderlinedThemselves) {
  for (const auto& [text, line, column] :
       {std::tuple{"a = 1\ndh = [{ alfa_deg = 90 }]\n", 2, 9}, std::tuple{"[alfa_deg]\nx = 1\n", 1, 2},
        std::tuple{"a = 1\nalfa_deg = 90 # alfa_deg\n", 2, 1}, std::tuple{"b.alfa_deg = 3\n", 1, 3}}) {
    const std::string path = file("k.toml", text);
    const auto table = config::read_file(path);
    ASSERT_TRUE(table);
    config::Table inner = *table;
    static_cast<void>(inner.optional_number("a", 0));
    if (const auto rows = table->tables("dh"); rows && !rows->empty()) inner = rows->front();
    if (table->has("b")) inner = *table->table("b");
    static_cast<void>(inner.optional_number("alpha_deg", 0));
    const Status status = inner.finish();
    ASSERT_FALSE(status) << text;
    EXPECT_EQ(status.error().place.line, line) << text;
    EXPECT_EQ(status.error().place.column, column) << text;
    EXPECT_NE(status.error().hint.find("alpha_deg? known here: "), std::string::npos) << status.error().hint;
    const std::string shown = excerpt(status.error());
    EXPECT_NE(shown.find("^~~~~~~~\n"), std::string::npos) << shown;
    EXPECT_EQ(shown.find("alfa_deg"), shown.find('^') - shown.find('\n') - 1) << shown;
  }
}

TEST_F(Excerpt, AKeyWithoutLettersHasThePlaceOfItsValue) {
  const auto table = config::read_file(file("k.toml", "a = 1\n\"\" = 3\n"));
  ASSERT_TRUE(table);
  static_cast<void>(table->optional_number("a", 0));
  const Status status = table->finish();
  ASSERT_FALSE(status);
  EXPECT_EQ(excerpt(status.error()), "    2 | \"\" = 3\n      |      ^\n");
  EXPECT_EQ(find_word("a = 1", ""), std::nullopt);
}

TEST_F(Excerpt, OfProgramsByLetterAndNumber) {
  const std::string path = file("p.ngc", "G1X10Y- 2.5F100\nN5 G41 (G 40)\r\no<sub> call [1 + 2]\n\n#<_x> = 3 SIN[4]\n");
  EXPECT_EQ(of(path, "GC102", 1, 3), "    1 | G1X10Y- 2.5F100\n      |   ^~~\n");
  EXPECT_EQ(of(path, "GC102", 1, 6), "    1 | G1X10Y- 2.5F100\n      |      ^~~~~~\n");
  EXPECT_EQ(of(path, "GC121", 2, 4), "    2 | N5 G41 (G 40)\n      |    ^~~\n");
  EXPECT_EQ(of(path, "GC103", 2, 8), "    2 | N5 G41 (G 40)\n      |        ^~~~~~\n");
  EXPECT_EQ(of(path, "GC121", 2, 1, "G41: not supported"), "    2 | N5 G41 (G 40)\n      |    ^~~\n");
  EXPECT_EQ(of(path, "MC210", 2, 1, "the machine cannot follow"), "    2 | N5 G41 (G 40)\n");
  EXPECT_EQ(of(path, "GC120", 3, 13), "    3 | o<sub> call [1 + 2]\n      |             ^~~~~~~\n");
  EXPECT_EQ(of(path, "GC120", 4, 1), "");
  EXPECT_EQ(of(path, "GC120", 5, 11), "    5 | #<_x> = 3 SIN[4]\n      |           ^~~\n");
}

TEST_F(Excerpt, OfTablesByCell) {
  const std::string path = file("d.csv", "\xEF\xBB\xBFx_mm,y_mm,sigma_um\n1, 2 mm ,3\n4,5,-6\n7,7,7,8\n");
  const auto table = csv::read(path);
  ASSERT_FALSE(table);
  EXPECT_EQ(excerpt(table.error()), "    4 | 7,7,7,8\n      |       ^\n");
  const auto fewer = csv::read(file("e.csv", "x_mm; y_mm;sigma_um\n1; 2 mm ;3\n 1,5;1,5; 1..5\n"));
  ASSERT_TRUE(fewer);
  const auto y = fewer->number(fewer->rows[0], "y_mm"), s = fewer->number(fewer->rows[1], "sigma_um");
  EXPECT_EQ(excerpt(y.error()), "    2 | 1; 2 mm ;3\n      |    ^~~~\n");
  EXPECT_EQ(excerpt(s.error()), "    3 |  1,5;1,5; 1..5\n      |           ^~~~\n");
  EXPECT_EQ(s.error().place.column, 11);
  EXPECT_EQ(of(path, "CA102", 3, 1, "sigma_um = -6 must be above 0"), "    3 | 4,5,-6\n      |     ^~\n");
  EXPECT_EQ(of(path, "AP149", 3, 1, "away from A = 5, B = 5 deg"), "    3 | 4,5,-6\n");
  EXPECT_EQ(of(path, "ID100", 1, 1, "the column z_mm is missing"), "    1 | x_mm,y_mm,sigma_um\n");
  EXPECT_EQ(of(path, "ID106", 1, 1, "the column \"y_mm\" occurs twice"),
            "    1 | x_mm,y_mm,sigma_um\n      |      ^~~~\n");
}

TEST_F(Excerpt, OfFilesThatWereJoinedOnlyWhatIsKnown) {
  const auto a = csv::read(file("a.csv", "point,q1\nP1,10\n")), b = csv::read(file("b.csv", "point,x_mm\nP1,far\n"));
  std::vector<std::string> left_out;
  const auto both = csv::joined({*a, *b}, "point", left_out);
  ASSERT_TRUE(both);
  const auto x = both->number(both->rows[0], "x_mm");
  ASSERT_FALSE(x);
  EXPECT_EQ(x.error().place.column, 1);
}

TEST_F(Excerpt, NothingWhereTheLineCannotBeReadAgain) {
  EXPECT_EQ(of("-", "CF105", 1, 1), "");
  EXPECT_EQ(of("--set base.radius_mm", "CF105", 0, 0), "");
  EXPECT_EQ(of((folder_ / "none.toml").string(), "CF105", 1, 3), "");
  EXPECT_EQ(of(folder_.string(), "CF105", 1, 3), "");
  EXPECT_EQ(of(file("short.toml", "a = 1\n"), "CF105", 2, 3), "");
  EXPECT_EQ(of(file("short.toml", "a = 1\n"), "FI100", 0, 0), "");
}

}  // namespace
}  // namespace polypod
