// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Tables as instruments and spreadsheets write them: the same rows come out of each.
#include "polypod/core/csv.hpp"

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>

namespace polypod::csv {
namespace {

class Csv : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(::testing::TempDir()) /
              ("csv_" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string put(const std::string& name, const std::string& text) {
    const auto path = folder_ / name;
    std::ofstream(path, std::ios::binary) << text;
    return path.string();
  }
  Table table(const std::string& text, const Columns& columns = {}) {
    auto t = read(put("t.csv", text), columns);
    EXPECT_TRUE(t) << (t ? "" : to_string(t.error()));
    return t ? *t : Table{};
  }
  std::string error(const std::string& text, const Columns& columns = {}) {
    const auto t = read(put("t.csv", text), columns);
    return t ? "" : t.error().id;
  }

 private:
  std::filesystem::path folder_;
};

double at(const Table& t, std::size_t row, const char* name) {
  const auto value = t.number(t.rows.at(row), name);
  EXPECT_TRUE(value) << (value ? "" : to_string(value.error()));
  return value.value_or(-1e99);
}

TEST_F(Csv, TheSameRowsHoweverTheyAreWritten) {
  for (const char* text : {
           "name,x_mm,y_mm,note\nP1,1234.5,-2,first\nP2,0.25,3e2,\n",
           "name;x_mm;y_mm;note\nP1;1234,5;-2;first\nP2;0,25;3e2;\n",
           "name;x_mm;y_mm;note\nP1;1234.5;-2;first\nP2;0.25;3e2;\n",
           "name\tx_mm\ty_mm\tnote\nP1\t1234,5\t-2\tfirst\nP2\t0.25\t300\t\n",
           "name   x_mm  y_mm note\n  P1 1234.5  -2   first\nP2 0,25 3e2\n",
           "\"name\",\"x_mm\",\"y_mm\",\"note\"\r\n\"P1\",\"1234.5\",\"-2\",\"first\"\r\n\"P2\",\"0.25\",\"300\","
           "\"\"\r\n",
           "\xEF\xBB\xBFname,x_mm,y_mm,note,\nP1,1234.5,-2,first,\nP2,0.25,300,,\n",
           "// exported by an instrument\n// 2026-11-22\nname,x_mm,y_mm,note\nP1,1234.5,-2,first\nP2,0.25,300,\n",
           "// made by an instrument\n// name, x_mm, y_mm, note\nP1, 1234.5, -2, first\nP2, 0.25, 300,\n",
           "name,x [m],y (in),note\nP1,1.2345,-0.07874015748031496,first\nP2,2.5e-4,11.811023622047244,\n",
           "name,x_um,y_cm,note\nP1,1234500,-0.2,first\nP2,250,30,\n",
       }) {
    SCOPED_TRACE(text);
    const Table t = table(text);
    ASSERT_EQ(t.rows.size(), 2U);
    EXPECT_NEAR(at(t, 0, "x_mm"), 1234.5, 1e-9);
    EXPECT_NEAR(at(t, 0, "y_mm"), -2, 1e-12);
    EXPECT_NEAR(at(t, 1, "x_mm"), 0.25, 1e-12);
    EXPECT_NEAR(at(t, 1, "y_mm"), 300, 1e-9);
    EXPECT_EQ(t.text(t.rows[0], "name"), "P1");
    EXPECT_EQ(t.text(t.rows[0], "note"), "first");
    EXPECT_EQ(t.text(t.rows[1], "note"), "");
    EXPECT_TRUE(t.unused());
  }
}

TEST_F(Csv, UnitsOfJointsAnglesAndForces) {
  const Table t = table("q1 [rad];q2 [m];a_rad;F [kN];T (lbf)\n0,5;0,25;1;2;1\n");
  EXPECT_NEAR(at(t, 0, "q1"), 28.64788975654116, 1e-12);
  EXPECT_NEAR(at(t, 0, "q2"), 250, 1e-12);
  EXPECT_NEAR(at(t, 0, "a_deg"), 57.29577951308232, 1e-12);
  EXPECT_NEAR(at(t, 0, "F_N"), 2000, 1e-9);
  EXPECT_NEAR(at(t, 0, "T_N"), 4.4482216152605, 1e-12);
}

TEST_F(Csv, ColumnsOfTheirOwnNames) {
  const auto columns = columns_of({"x_mm=X [m]", "q1=Joint 1 (rad)", "y_mm=Y"});
  ASSERT_TRUE(columns);
  const Table t = table("Point,X [m],Y,Joint 1 (rad)\nA,1.5,7,0.1\n", *columns);
  EXPECT_DOUBLE_EQ(at(t, 0, "x_mm"), 1500);
  EXPECT_DOUBLE_EQ(at(t, 0, "y_mm"), 7);
  EXPECT_NEAR(at(t, 0, "q1"), 5.729577951308232, 1e-12);
  EXPECT_THAT(*t.unused(), ::testing::ElementsAre("Point"));
  EXPECT_EQ(error("X,Y\n1,2\n", {{"x_mm", "Z"}}), "ID109");
  EXPECT_EQ(error("X [deg],Y\n1,2\n", {{"x_mm", "X [deg]"}}), "ID109");
  EXPECT_EQ(columns_of({"x_mm"}).error().id, "ID109");
  EXPECT_EQ(columns_of({"x_mm=a", "x_mm=b"}).error().id, "ID109");
}

TEST_F(Csv, ANearMissIsRefusedAndTheRestNamed) {
  for (const char* name : {"A_deg", "a_Deg", "a", "a_degree"}) {
    const Table t = table(std::string("x_mm,") + name + ",colour\n1,2,red\n");
    at(t, 0, "x_mm");
    EXPECT_EQ(*t.number(t.rows[0], "a_deg", 0), 0.0);
    const auto unused = t.unused();
    if (std::string(name) == "a_degree") {
      ASSERT_TRUE(unused) << name;  // another word; at least it is named
      EXPECT_THAT(*unused, ::testing::ElementsAre("a_degree", "colour"));
    } else {
      ASSERT_FALSE(unused) << name;
      EXPECT_EQ(unused.error().id, "ID108");
      EXPECT_NE(unused.error().message.find(name), std::string::npos);
    }
  }
  const Table t = table("x_mm,sigma_un\n1,2\n");  // one letter off
  at(t, 0, "x_mm");
  EXPECT_EQ(*t.number(t.rows[0], "sigma_um", 5), 5.0);
  EXPECT_EQ(t.unused().error().id, "ID108");
  // The unit of a name is converted and no near miss.
  const Table u = table("x_mm,sigma_mm\n1,0.02\n");
  at(u, 0, "x_mm");
  EXPECT_NEAR(*u.number(u.rows[0], "sigma_um", 5), 20.0, 1e-12);
  EXPECT_THAT(*u.unused(), ::testing::IsEmpty());
}

TEST_F(Csv, WhatCannotBeReadIsRefused) {
  EXPECT_EQ(error(""), "ID102");
  EXPECT_EQ(error("# x_mm\n"), "ID102");
  EXPECT_EQ(error("1,2,3\n4,5,6\n"), "ID102");
  EXPECT_EQ(error("x_mm,x_mm\n1,2\n"), "ID106");
  EXPECT_EQ(error("x [m],x (in)\n1,2\n"), "ID106");
  EXPECT_EQ(error("x_mm,y_mm\n1,5,2\n"), "ID107");
  const Table t = table("x_mm;y_mm\n1.234,5;2\n1,2,3;4\n");
  EXPECT_EQ(t.number(t.rows[0], "x_mm").error().id, "ID101");  // a point and a comma: which are the decimals?
  EXPECT_EQ(t.number(t.rows[1], "x_mm").error().id, "ID101");
  EXPECT_EQ(t.needs({"x_mm", "z_mm"}).error().id, "ID100");
  const Table named = table("X;Y\n1;2\n");
  EXPECT_THAT(named.needs({"x_mm"}).error().hint, ::testing::HasSubstr("--columns \"x_mm=X\""));
}

TEST_F(Csv, TrackerAndJointLogByPointName) {
  const auto joints = read(put("log.csv", "name,q1,q2\nP1,10,20\nP2,11,21\nP4,12,22\n"));
  const auto points = read(put("tracker.txt", "// name; X [m]; Y [m]\nP2;1,5;2\nP1;0,5;1\nP3;9;9\n"),
                           {{"x_mm", "X [m]"}, {"y_mm", "Y [m]"}});
  ASSERT_TRUE(joints && points);
  std::vector<std::string> left_out;
  const auto both = joined({*joints, *points}, "name", left_out);
  ASSERT_TRUE(both) << to_string(both.error());
  ASSERT_EQ(both->rows.size(), 2U);
  EXPECT_DOUBLE_EQ(at(*both, 0, "q1"), 10);
  EXPECT_DOUBLE_EQ(at(*both, 0, "x_mm"), 500);
  EXPECT_DOUBLE_EQ(at(*both, 1, "q2"), 21);
  EXPECT_DOUBLE_EQ(at(*both, 1, "x_mm"), 1500);
  EXPECT_THAT(left_out, ::testing::ElementsAre("P4", "P3"));
  EXPECT_EQ(joined({*joints, *joints}, "name", left_out).error().id, "ID106");
  EXPECT_EQ(joined({*joints, *points}, "point", left_out).error().id, "ID100");
  const auto twice = read(put("twice.csv", "name,x_mm\nP1,1\nP1,2\n"));
  EXPECT_EQ(joined({*joints, *twice}, "name", left_out).error().id, "ID106");
  const auto other = read(put("other.csv", "name,x_mm\nQ1,1\n"));
  EXPECT_EQ(joined({*joints, *other}, "name", left_out).error().id, "ID102");
}

}  // namespace
}  // namespace polypod::csv
