// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/csv.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>

namespace polypod::report {
namespace {

TEST(Csv, RowsUnderAHeader) {
  Csv csv({"x_mm", "name"});
  csv.add({1.5, std::string("a")});
  csv.add({-0.25, std::string("b")});
  EXPECT_EQ(csv.text(), "x_mm,name\n1.5,a\n-0.25,b\n");
}

TEST(Csv, QuotesWhatNeedsThem) {
  Csv csv({"a,b", "c"});
  csv.add({std::string("say \"no\""), std::string("two\nlines")});
  EXPECT_EQ(csv.text(), "\"a,b\",c\n\"say \"\"no\"\"\",\"two\nlines\"\n");
}

TEST(Csv, NumbersReadBackAndWhatIsNotFiniteIsEmpty) {
  Csv csv({"x"});
  csv.add({0.1 + 0.2});
  EXPECT_EQ(std::strtod(csv.text().c_str() + 2, nullptr), 0.1 + 0.2);
  Csv empty({"x", "y"});
  empty.add({std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()});
  EXPECT_EQ(empty.text(), "x,y\n,\n");
}

TEST(Csv, EveryRowHasTheColumnsOfTheHeader) {
  Csv csv({"a", "b"});
  csv.add({1.0});
  csv.add({1.0, 2.0, 3.0});
  EXPECT_EQ(csv.text(), "a,b\n1,\n1,2\n");
}

}  // namespace
}  // namespace polypod::report
