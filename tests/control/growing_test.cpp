// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A record that a program appends to, replaces, cuts and damages while it is read.
#include "polypod/control/growing.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "polypod/kinematics/any_machine.hpp"

namespace polypod::control {
namespace {

using ::testing::HasSubstr;

constexpr const char* kHeader = "time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,q2,q3,q4,q5,q6\n";

std::string row(int k) {
  return std::to_string(0.01 * k) + ",3,0,0,75,0,0,0,70,70,70,70,70," + std::to_string(70 + 1e-3 * k) + "\n";
}

class Growing : public ::testing::Test {
 protected:
  Growing() { std::filesystem::remove(path_); }
  void append(const std::string& text) { std::ofstream(path_, std::ios::app | std::ios::binary) << text; }
  void write(const std::string& text) { std::ofstream(path_, std::ios::trunc | std::ios::binary) << text; }
  RecordNews look(std::size_t most = std::size_t{1} << 20U) {
    const auto news = news_of(machine_, path_, place_, most);
    EXPECT_TRUE(news) << to_string(news.error());
    if (!news) return {};
    place_ = news->next;
    return *news;
  }
  machine::AnyMachine machine_ = *machine::load("hexapod-strut");
  // Tests run side by side.
  std::string path_ =
      ::testing::TempDir() + "/growing_" + ::testing::UnitTest::GetInstance()->current_test_info()->name() + ".csv";
  RecordPlace place_;
};

TEST_F(Growing, GivesEachRowOnce) {
  EXPECT_FALSE(look().there) << "no file";
  append("time_s,line");
  EXPECT_FALSE(look().there) << "a header without an end";
  write(kHeader);
  RecordNews news = look();
  EXPECT_TRUE(news.there);
  EXPECT_TRUE(news.rows.empty());
  append(row(1) + row(2) + row(3).substr(0, 20));
  news = look();
  ASSERT_EQ(news.rows.size(), 2U);
  EXPECT_EQ(news.rows[1].line, 3);
  EXPECT_NEAR(news.rows[1].time, 0.02, 1e-9);
  EXPECT_EQ(news.unfinished, 20U);
  EXPECT_TRUE(look().rows.empty()) << "the unfinished row waits";
  append(row(3).substr(20));
  news = look();
  ASSERT_EQ(news.rows.size(), 1U);
  EXPECT_NEAR(news.rows[0].joints[5], 70.003e-3, 1e-12);
  EXPECT_FALSE(news.anew);
}

TEST_F(Growing, BeginsAnewWithAnotherFile) {
  write(kHeader + row(1) + row(2) + row(3));
  EXPECT_EQ(look().rows.size(), 3U);
  write(kHeader + row(1));  // shorter
  RecordNews news = look();
  EXPECT_TRUE(news.anew);
  EXPECT_EQ(news.rows.size(), 1U);
  write(kHeader + row(0) + row(1) + row(2) + row(3));  // beyond where it was read to, and a row ends there, too
  news = look();
  EXPECT_TRUE(news.anew);
  EXPECT_EQ(news.rows.size(), 4U);
  const std::string other = path_ + ".new";
  std::ofstream(other) << kHeader << row(5) << row(6) << row(7) << row(8) << row(9);
  std::filesystem::rename(other, path_);
  news = look();
  EXPECT_TRUE(news.anew) << "replaced";
  EXPECT_EQ(news.rows.size(), 5U);
  std::filesystem::remove(path_);
  news = look();
  EXPECT_FALSE(news.there);
  EXPECT_TRUE(news.anew);
}

TEST_F(Growing, ReadsTheNewestOfMuch) {
  std::string text = kHeader;
  for (int k = 0; k < 1000; ++k) text += row(k);
  write(text);
  const RecordNews news = look(2000);
  ASSERT_FALSE(news.rows.empty());
  EXPECT_LT(news.rows.size(), 60U);
  EXPECT_NEAR(news.rows.back().time, 9.99, 1e-9);
  EXPECT_GT(news.skipped, text.size() - 2100);
  EXPECT_EQ(news.refused, 0U) << news.why << ": the row into which the end falls is left out";
  EXPECT_EQ(place_.from, text.size());
}

TEST_F(Growing, LeavesOutWhatIsNoRow) {
  write(kHeader + row(1) + "nonsense\n\n" + row(2) + row(2) + "0.05,3,0,0,75,0,0,0,nan,70,70,70,70,70\n" + row(6));
  const RecordNews news = look();
  EXPECT_EQ(news.rows.size(), 3U);
  EXPECT_EQ(news.refused, 3U);
  EXPECT_THAT(news.why, HasSubstr("LC121 a row of 1 cells"));
}

TEST_F(Growing, NamesWhatIsNoRecord) {
  write("time_s,x_mm\n0,1\n");
  EXPECT_EQ(news_of(machine_, path_, {}).error().id, "LC120");
  write(std::string(100'000, 'x'));
  EXPECT_EQ(news_of(machine_, path_, {}).error().id, "LC120");
  EXPECT_EQ(news_of(machine_, ::testing::TempDir(), {}).error().id, "FI100");
  const std::string pipe = ::testing::TempDir() + "/growing.pipe";
  std::filesystem::remove(pipe);
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(news_of(machine_, pipe, {}).error().id, "FI100") << "and does not wait";
  std::filesystem::remove(pipe);
}

TEST_F(Growing, BearsAnyPlace) {
  write(kHeader + row(1) + row(2) + row(3));
  const RecordNews right = look();
  std::mt19937_64 random(1);
  for (int n = 0; n < 2000; ++n) {
    RecordPlace place = right.next;
    place.from = n % 3 == 0 ? random() : random() % 300;
    place.time = n % 2 == 0 ? 0.015 : std::numeric_limits<double>::quiet_NaN();
    if (n % 5 == 0) place.file = "another";
    const auto news = news_of(machine_, path_, place);
    ASSERT_TRUE(news);
    EXPECT_EQ(news->next.from, right.next.from);
    EXPECT_LE(news->rows.size(), 3U);
    EXPECT_EQ(news->refused, 0U) << place.from;
  }
}

}  // namespace
}  // namespace polypod::control
