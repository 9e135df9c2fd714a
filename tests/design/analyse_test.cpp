// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/analyse.hpp"

#include "polypod/core/random.hpp"
#include "polypod/design/optimize.hpp"
#include "studies.hpp"

namespace polypod::design {
namespace {

Row row_with(std::int64_t number, const std::vector<double>& varied, const std::vector<double>& figures) {
  Row row;
  row.row = number;
  row.varied = varied;
  row.evaluation.state = State::done;
  row.evaluation.violation = 0;
  for (const double x : figures) {
    Value v;
    v.value = v.lower = v.upper = x;
    row.evaluation.figures.push_back(v);
  }
  return row;
}

Study three_goals() {
  return study_on_strut(
      "[[vary]]\nkey = \"base.radius_mm\"\nmin = 5\nmax = 60\n[[vary]]\nkey = \"tool.length_mm\"\nmin = 0\nmax = 30\n"
      "[[goal]]\nfigure = \"volume_mm3\"\nsense = \"max\"\n[[goal]]\nfigure = \"condition\"\nsense = \"min\"\n"
      "[[goal]]\nfigure = \"sigma_min\"\nsense = \"max\"\n");
}

TEST(Front, HoldsExactlyWhatNothingDominates) {
  const Study s = three_goals();
  Random random(5);
  std::vector<Row> rows;
  for (int i = 0; i < 400; ++i) {
    // Coarse numbers, so that there are ties and equal rows.
    const auto coarse = [&] { return std::floor(random.uniform(1, 9)); };
    rows.push_back(row_with(i + 1, {random.uniform(5, 60), 0}, {coarse(), coarse(), coarse()}));
  }
  const std::vector<std::size_t> front = front_of(s, rows);
  const auto better = [&](std::size_t a, std::size_t b) {
    const auto f = [&](std::size_t r, std::size_t k) { return rows[r].evaluation.figures[k].value; };
    const bool no_worse = f(a, 0) >= f(b, 0) && f(a, 1) <= f(b, 1) && f(a, 2) >= f(b, 2);
    return no_worse && (f(a, 0) > f(b, 0) || f(a, 1) < f(b, 1) || f(a, 2) > f(b, 2));
  };
  std::set<std::vector<double>> kept, wanted;
  const auto goals = [&](std::size_t i) {
    std::vector<double> out;
    for (const Value& v : rows[i].evaluation.figures) out.push_back(v.value);
    return out;
  };
  for (std::size_t i = 0; i < rows.size(); ++i) {
    bool beaten = false;
    for (std::size_t k = 0; k < rows.size(); ++k) beaten = beaten || better(k, i);
    if (!beaten) wanted.insert(goals(i));
  }
  for (const std::size_t i : front) EXPECT_TRUE(kept.insert(goals(i)).second) << "equal points count once";
  EXPECT_EQ(kept, wanted);
}

TEST(Sensitivities, OfAMonotonicFigureAreTheRanksOfIts) {
  const Study s = three_goals();
  Random random(9);
  std::vector<Row> rows;
  for (int i = 0; i < 300; ++i) {
    const double a = random.uniform(5, 60), b = random.uniform(0, 30);
    // Rises steeply with the first, falls with the second; knows neither; depends on the second alone.
    rows.push_back(row_with(i + 1, {a, b}, {std::exp(a / 5), random.uniform(), 1 / (1 + b)}));
  }
  const auto found = sensitivities(s, rows);
  ASSERT_EQ(found.size(), 3U);
  EXPECT_EQ(found[0].of, "volume_mm3");
  EXPECT_NEAR(found[0].coefficients[0], 1, 1e-9);
  EXPECT_NEAR(found[0].coefficients[1], 0, 1e-9);
  EXPECT_NEAR(found[0].share_explained, 1, 1e-9);
  EXPECT_LT(found[1].share_explained, 0.1);
  EXPECT_NEAR(found[2].coefficients[1], -1, 1e-9);
  EXPECT_EQ(found[0].rows, 300);
}

TEST(Sensitivities, NeedRowsAndMovement) {
  const Study s = three_goals();
  std::vector<Row> rows;
  for (int i = 0; i < 5; ++i) rows.push_back(row_with(i + 1, {10.0 + i, 3}, {1.0 + i, 2, 3}));
  EXPECT_TRUE(sensitivities(s, rows).empty());
  for (int i = 5; i < 20; ++i) rows.push_back(row_with(i + 1, {10.0 + i, 3}, {1.0 + i, 2, 3}));
  const auto found = sensitivities(s, rows);
  ASSERT_EQ(found.size(), 1U);  // of the figure that changes at all
  EXPECT_NEAR(found[0].coefficients[0], 1, 1e-9);
  EXPECT_TRUE(std::isnan(found[0].coefficients[1]));
}

TEST(Holds, SayWhatBindsAndWhatNothingKeeps) {
  const Study s = study_on_strut(
      "[[vary]]\nkey = \"base.radius_mm\"\nmin = 5\nmax = 60\n[[vary]]\nkey = \"tool.length_mm\"\nvalues = [0, 5, 30]\n"
      "[[goal]]\nfigure = \"volume_mm3\"\nsense = \"max\"\n[[hold]]\nfigure = \"condition\"\nmax = 4\n"
      "[[hold]]\nfigure = \"sigma_min\"\nmin = 0.5\n");
  const auto texts = [&](const std::vector<double>& at, const std::vector<double>& figures) {
    return binding(s, row_with(1, at, figures));
  };
  using Texts = std::vector<std::string>;
  EXPECT_EQ(texts({30, 5}, {100, 3, 0.7}), Texts{});
  EXPECT_EQ(texts({30, 5}, {100, 3.97, 0.7}), Texts{"condition at most 4"});
  EXPECT_EQ(texts({30, 5}, {100, 3.95, 0.504}), Texts{"sigma_min at least 0.5"});
  EXPECT_EQ(texts({60, 5}, {100, 3, 0.7}), Texts{"base.radius_mm at an end of its range"});
  EXPECT_EQ(texts({5, 30}, {100, 3, 0.7}),
            (Texts{"base.radius_mm at an end of its range", "tool.length_mm at an end of its list"}));
  const double none = std::numeric_limits<double>::quiet_NaN();
  std::vector<Row> rows{row_with(1, {10, 0}, {none, 6, none}), row_with(2, {20, 0}, {none, 4.5, 0.4}),
                        row_with(3, {30, 0}, {none, none, none})};
  for (Row& row : rows) row.evaluation.state = State::violates;
  rows[2].evaluation.state = State::refused;
  rows[2].evaluation.reason = "no workspace";
  const auto found = hold_summaries(s, rows);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].judged, 2);
  EXPECT_EQ(found[0].broken, 2);
  EXPECT_EQ(found[0].nearest, 4.5);
  EXPECT_EQ(found[1].judged, 1);
  EXPECT_EQ(found[1].nearest, 0.4);
  EXPECT_EQ(found[1].in_words(),
            "1 of the 1 whose figure is known do not keep: sigma_min at least 0.5; the nearest has 0.4");
  EXPECT_EQ(refusals(rows), (std::vector<std::pair<std::string, int>>{{"no workspace", 1}}));
  for (Row& row : rows) {
    row.evaluation.state = State::violates;
    row.evaluation.reason = fmt::format("not kept: {} (pose {}: leg 2 is too short)", kAllPoses, row.row);
    row.evaluation.violation = row.row == 2 ? 1 : 2;
  }
  const auto poses = hold_summaries(s, rows).back();
  EXPECT_EQ(
      poses.in_words(),
      "3 of the 3 whose figure is known do not keep: every pose of the study is reached; the nearest: row 2 (pose 2: "
      "leg 2 is too short)");
}

TEST(Conditions, AreReadAndMet) {
  const Study s = three_goals();
  const Row row = row_with(7, {12.5, 3}, {100, 2, 0.5});
  for (const auto& [text, met] : std::vector<std::pair<std::string, bool>>{{"volume_mm3>=100", true},
                                                                           {"volume_mm3>100", false},
                                                                           {"condition<=2", true},
                                                                           {"condition<2", false},
                                                                           {"base.radius_mm=12.5", true},
                                                                           {"row=7", true},
                                                                           {"row<7", false}}) {
    const auto c = condition_of(s, text);
    ASSERT_TRUE(c) << text << ": " << to_string(c.error());
    EXPECT_EQ(test_of(s, *c)(row), met) << text;
  }
  for (const char* text : {"volume_mm3", ">3", "volume_mm3>", "volume_mm3>x", "volume_mm3>=1e999", "volume>3"}) {
    const auto c = condition_of(s, text);
    ASSERT_FALSE(c) << text;
    EXPECT_EQ(c.error().id, "OP120") << text;
  }
  EXPECT_NE(condition_of(s, "volume_mm>3").error().hint.find("did you mean volume_mm3"), std::string::npos);
}

TEST(RowsCsv, HasAColumnForEverythingAndQuotesReasons) {
  const Study s = three_goals();
  Row row = row_with(1, {12.5, 3}, {100, 2, 0.5});
  row.evaluation.reason = "a, \"b\"";
  const std::string csv = rows_csv(s, {row_with(2, {1, 1}, {1, 1, 1}), row}, {1});
  EXPECT_EQ(
      csv.substr(0, csv.find('\n')),
      "row,state,phase,objective,objective_lower,objective_upper,violation,base.radius_mm,tool.length_mm,volume_mm3,"
      "volume_mm3_lower,volume_mm3_upper,condition,sigma_min,seconds,version,at,reason");
  EXPECT_NE(csv.find("\n1,done,search,,,,0,12.5,3,100,100,100,2,0.5,0,,,\"a, \"\"b\"\"\"\n"), std::string::npos) << csv;
}

TEST(MachineOfRow, ReadsBackAndSaysWhereItIsFrom) {
  const Study s = three_goals();
  const auto m = machine_of_row(s, row_with(4, {33.125, 3}, {100, 2, 0.5}));
  ASSERT_TRUE(m);
  const std::string toml = machine::to_toml(*m);
  const auto again = machine::from_text(toml, "m.toml");
  ASSERT_TRUE(again) << to_string(again.error());
  EXPECT_EQ(s.values_of(*again)[0], 33.125);
  EXPECT_NE(toml.find("row 4 of the study"), std::string::npos);
  EXPECT_NE(toml.find("base.radius_mm = 33.125"), std::string::npos);
  const auto none = machine_of_row(s, row_with(5, {-3, 3}, {100, 2, 0.5}));
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().id, "OP121");
}

}  // namespace
}  // namespace polypod::design
