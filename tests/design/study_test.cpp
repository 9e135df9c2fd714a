// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/study.hpp"

#include <fstream>

#include "paths.hpp"
#include "studies.hpp"

namespace polypod::design {
namespace {

const std::string kHead = "machine = \"hexapod-strut\"\n";
const std::string kVary = "[[vary]]\nkey = \"base.radius_mm\"\nmin = 5\nmax = 60\n";
const std::string kGoal = "[[goal]]\nfigure = \"volume_mm3\"\nsense = \"max\"\n";

TEST(Study, ReadsTheFormOfTheContract) {
  const auto s = study_from_text(R"(machine = "hexapod-strut"
tilt_deg = 20
seed = 7
evaluations = 400
[[vary]]
key = "base.radius_mm"
min = 5
max = 60
[[tie]]
key = "platform.pair_angle_deg"
equals = "base.pair_angle_deg"
factor = 2
offset = 1
[[goal]]
figure = "volume_mm3"
sense = "max"
weight = 0.6
best = 233574
[[hold]]
figure = "condition"
max = 50
)",
                                 "s.toml");
  ASSERT_TRUE(s) << to_string(s.error());
  EXPECT_EQ(s->seed, 7U);
  EXPECT_EQ(s->evaluations, 400);
  EXPECT_NEAR(s->tilt, 20 * 3.14159265358979 / 180, 1e-12);
  EXPECT_FALSE(s->wants_front());
  ASSERT_EQ(s->figures().size(), 2U);
  EXPECT_EQ(s->figures()[1], Figure::condition);
  // The tie follows what the machine has: 30 deg.
  const auto p = s->parameters({40});
  ASSERT_EQ(p.size(), 2U);
  EXPECT_EQ(p[1].first, "platform.pair_angle_deg");
  EXPECT_DOUBLE_EQ(p[1].second, 61);
  const auto m = s->machine_at({40});
  ASSERT_TRUE(m) << to_string(m.error());
  EXPECT_NEAR(s->values_of(*m)[0], 40, 1e-9);
  EXPECT_NE(machine::to_toml(*m).find("pair_angle_deg = 61"), std::string::npos) << machine::to_toml(*m);
}

TEST(Study, HoldsThatLeaveSomethingAreNoContradiction) {
  for (const char* holds :
       {"[[hold]]\nfigure = \"condition\"\nmax = 4\n[[hold]]\nfigure = \"condition_max\"\nmin = 5\n",
        "[[hold]]\nfigure = \"condition\"\nmin = 4\nmax = 4\n",
        "[[hold]]\nbox_mm = [0, 0, 0, 10, 10, 10]\n[[hold]]\nfigure = \"volume_mm3\"\nmax = 1000\n"}) {
    const auto s = study_from_text(kHead + kVary + kGoal + holds, "s.toml");
    EXPECT_TRUE(s) << to_string(s.error());
  }
}

struct Bad {
  const char* what;
  std::string text, id;
  int line;
  std::string says;  ///< a part of message or hint
};

TEST(Study, RefusesWithPlaceAndReason) {
  const std::vector<Bad> cases{
      {"unknown figure", kHead + kVary + "[[goal]]\nfigure = \"volume_mm\"\nsense = \"max\"\n", "OP100", 7,
       "did you mean volume_mm3?"},
      {"empty range", kHead + "[[vary]]\nkey = \"base.radius_mm\"\nmin = 60\nmax = 60\n" + kGoal, "OP101", 5,
       "is empty"},
      {"step of nothing", kHead + "[[vary]]\nkey = \"base.radius_mm\"\nmin = 5\nmax = 60\nstep = 0\n" + kGoal, "OP101",
       6, "step"},
      {"empty list", kHead + "[[vary]]\nkey = \"base.radius_mm\"\nvalues = []\n" + kGoal, "OP101", 4, "empty"},
      {"list and range", kHead + "[[vary]]\nkey = \"base.radius_mm\"\nvalues = [1]\nmin = 2\n" + kGoal, "OP101", 5,
       "at once"},
      {"unknown parameter", kHead + "[[vary]]\nkey = \"base.radus_mm\"\nmin = 5\nmax = 60\n" + kGoal, "OP102", 2,
       "did you mean base.radius_mm?"},
      {"varied twice", kHead + kVary + kVary + kGoal, "OP103", 6, "line 2"},
      {"varied and tied", kHead + kVary + "[[tie]]\nkey = \"base.radius_mm\"\nequals = \"tool.length_mm\"\n" + kGoal,
       "OP103", 6, "tied"},
      {"tie to nothing", kHead + kVary + "[[tie]]\nkey = \"tool.length_mm\"\nequals = \"base.radius\"\n" + kGoal,
       "OP103", 6, "no value"},
      {"tie to itself", kHead + kVary + "[[tie]]\nkey = \"tool.length_mm\"\nequals = \"tool.length_mm\"\n" + kGoal,
       "OP103", 6, "tied itself"},
      {"nothing varies", kHead + kGoal, "OP104", 1, "nothing may change"},
      {"no goal", kHead + kVary, "OP104", 1, "nothing is wanted"},
      {"goal twice", kHead + kVary + kGoal + kGoal, "OP105", 9, "twice"},
      {"half the weights",
       kHead + kVary + kGoal + "[[goal]]\nfigure = \"condition\"\nsense = \"min\"\nweight = 1\nbest = 1\n", "OP105", 9,
       "weight"},
      {"no best",
       kHead + kVary +
           "[[goal]]\nfigure = \"volume_mm3\"\nsense = \"max\"\nweight = 1\n[[goal]]\nfigure = \"condition\"\nsense = "
           "\"min\"\nweight = 1\nbest = 1\n",
       "OP105", 6, "best"},
      {"contradiction",
       kHead + kVary + kGoal + "[[hold]]\nfigure = \"condition\"\nmin = 5\n[[hold]]\nfigure = \"condition\"\nmax = 4\n",
       "OP106", 12, "at least 5 (line 9) and at most 4 (line 12)"},
      {"a mean above its most",
       kHead + kVary + kGoal +
           "[[hold]]\nfigure = \"condition\"\nmin = 5\n[[hold]]\nfigure = \"condition_max\"\nmax = 4\n",
       "OP106", 12, "condition is never above condition_max"},
      {"below what any machine has", kHead + kVary + kGoal + "[[hold]]\nfigure = \"condition\"\nmax = 0.5\n", "OP106",
       9, "no machine has less than 1"},
      {"a box larger than the volume",
       kHead + kVary + kGoal +
           "[[hold]]\nbox_mm = [0, 0, 0, 10, 10, 10]\n[[hold]]\nfigure = \"volume_mm3\"\nmax = 999\n",
       "OP106", 11, "the box of line 9 has 1000 mm3"},
      {"hold of nothing", kHead + kVary + kGoal + "[[hold]]\nfigure = \"condition\"\n", "OP106", 9, "says nothing"},
      {"a box inside out", kHead + kVary + kGoal + "[[hold]]\nbox_mm = [1, 0, 0, 1, 2, 2]\n", "OP106", 10, "corner"},
      {"no compliances", kHead + kVary + "[[goal]]\nfigure = \"compliance_um_per_N\"\nsense = \"min\"\n", "OP107", 6,
       "compliances"},
      {"no errors", kHead + kVary + "[[goal]]\nfigure = \"known_error_mm\"\nsense = \"min\"\n", "OP107", 6, "errors"},
      {"sense", kHead + kVary + "[[goal]]\nfigure = \"volume_mm3\"\nsense = \"most\"\n", "OP108", 8, "max"},
      {"cone and ranges", kHead + "tilt_deg = 10\na_range_deg = [0, 5]\n" + kVary + kGoal, "OP109", 2, "cone"},
      {"unknown key", kHead + "evaluation = 3\n" + kVary + kGoal, "CF103", 2, "evaluations"},
      {"no such machine", "machine = \"hexapod\"\n" + kVary + kGoal, "MA100", 1, "hexapod-strut"},
      {"unknown element", kHead + "tolerances = [\"legs=0.01\"]\n" + kVary + kGoal, "QU100", 2, "leg"},
  };
  for (const Bad& bad : cases) {
    const auto s = study_from_text(bad.text, "s.toml");
    ASSERT_FALSE(s) << bad.what;
    EXPECT_EQ(s.error().id, bad.id) << bad.what << ": " << to_string(s.error());
    EXPECT_EQ(s.error().place.line, bad.line) << bad.what << ": " << to_string(s.error());
    EXPECT_NE((s.error().message + s.error().hint).find(bad.says), std::string::npos)
        << bad.what << ": " << to_string(s.error());
  }
}

TEST(Study, ValuesOfRangesStepsAndLists) {
  Vary range{"a", 10, 20, 0, {}, {}};
  EXPECT_FALSE(range.count());
  EXPECT_DOUBLE_EQ(range.at(0.25), 12.5);
  EXPECT_DOUBLE_EQ(range.at(2), 20);
  EXPECT_DOUBLE_EQ(range.share_of(12.5), 0.25);
  Vary steps{"a", 0, 1, 0.1, {}, {}};  // 0.1 is no binary fraction: 11 values all the same
  EXPECT_EQ(steps.count(), 11);
  EXPECT_DOUBLE_EQ(steps.at(1), 1.0);
  EXPECT_DOUBLE_EQ(steps.at(0.34), 0.3);
  Vary uneven{"a", 0, 10, 4, {}, {}};  // 0, 4, 8
  EXPECT_EQ(uneven.count(), 3);
  EXPECT_DOUBLE_EQ(uneven.at(1), 8);
  EXPECT_DOUBLE_EQ(uneven.at(uneven.share_of(4)), 4);
  Vary list{"a", 1, 9, 0, {9, 1, 4}, {}};
  EXPECT_EQ(list.count(), 3);
  for (const double x : list.values) EXPECT_DOUBLE_EQ(list.at(list.share_of(x)), x);
  EXPECT_DOUBLE_EQ(list.at(0.99), 4);
}

TEST(Study, SetsAreOfTheMachineAndIdentityLeavesTheBudgetOut) {
  const std::string set = "[[set]]\nkey = \"leg.length_max_mm\"\nvalue = 100\n";
  const auto a = study_from_text(kHead + set + kVary + kGoal, "s.toml");
  ASSERT_TRUE(a) << to_string(a.error());
  EXPECT_NE(a->machine_toml.find("length_max_mm = 100"), std::string::npos);
  const auto more = study_from_text(kHead + "evaluations = 900\n" + set + kVary + kGoal, "other.toml");
  ASSERT_TRUE(more);
  EXPECT_EQ(a->identity(), more->identity());
  const auto other =
      study_from_text(kHead + set + kVary + kGoal + "[[hold]]\nfigure = \"condition\"\nmax = 4\n", "s.toml");
  ASSERT_TRUE(other);
  EXPECT_NE(a->identity(), other->identity());
  // As the database keeps it: nothing but the texts.
  const auto again = study_from_text(kHead + set + kVary + kGoal, "gone.toml", a->machine_toml);
  ASSERT_TRUE(again) << to_string(again.error());
  EXPECT_EQ(again->identity(), a->identity());
}

TEST(Study, EveryFigureIsInTheDocumentation) {
  std::ifstream page(test::source("docs/optimize.md"));
  const std::string text{std::istreambuf_iterator<char>(page), std::istreambuf_iterator<char>()};
  ASSERT_FALSE(text.empty());
  for (const FigureInfo& info : figure_infos())
    EXPECT_NE(text.find(fmt::format("`{}`", info.name)), std::string::npos) << info.name;
}

}  // namespace
}  // namespace polypod::design
