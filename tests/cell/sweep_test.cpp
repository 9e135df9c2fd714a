// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Sweeps over several numbers against single runs.
#include "polypod/cell/sweep.hpp"

#include <gtest/gtest.h>

#include "paths.hpp"

namespace polypod::cell {
namespace {

CellQuestion for_seconds(double seconds) {
  CellQuestion q;
  q.settings.seconds = seconds;
  return q;
}
/// The same of every cell.
auto each_for(double seconds) {
  return [seconds](const Cell&) { return for_seconds(seconds); };
}

TEST(CellSweep, EveryCombinationIsRunAsByItself) {
  const std::string file = test::source("examples/picking_line/cell.toml");
  const std::vector<SweepAxis> axes{{"conveyor.belt.speed_mm_per_s", {100, 200}},
                                    {"task.pick.window_mm[2]", {1000, 1100, 1150}}};
  const auto s = sweep(file, {{"task.pick.window_mm[1]", "450"}}, axes, each_for(120));
  ASSERT_TRUE(s) << to_string(s.error());
  ASSERT_EQ(s->rows.size(), 6U);
  std::size_t k = 0;
  for (const double speed : axes[0].values) {
    for (const double window : axes[1].values) {
      const SweepRow& row = s->rows[k++];
      ASSERT_EQ(row.values, (std::vector{speed, window})) << "the last axis fastest";
      auto cell = read(file, {{"task.pick.window_mm[1]", "450"},
                              {"conveyor.belt.speed_mm_per_s", std::to_string(speed)},
                              {"task.pick.window_mm[2]", std::to_string(window)}});
      ASSERT_TRUE(cell);
      const CellResult alone = judge_cell(std::move(*cell), for_seconds(120));
      EXPECT_EQ(row.throughput.mean, alone.study.throughput.mean);
      EXPECT_EQ(row.missed, alone.outcome().missed);
      EXPECT_EQ(row.problems.size(), alone.problems.size());
    }
  }
  ASSERT_TRUE(s->best);
  for (const SweepRow& row : s->rows)
    EXPECT_TRUE(!row.problems.empty() || row.throughput.mean <= s->rows[*s->best].throughput.mean);
  EXPECT_TRUE(s->rows[*s->best].problems.empty());
}

TEST(CellSweep, EndsWhereItIsAskedTo) {
  const auto s =
      sweep(test::source("examples/picking_line/cell.toml"), {}, {{"conveyor.belt.speed_mm_per_s", {100, 200}}},
            each_for(10), [](const SweepRow&) { return false; });
  ASSERT_TRUE(s);
  EXPECT_EQ(s->rows.size(), 1U);
  EXPECT_FALSE(s->complete);
}

// The time and the seed are numbers of the cell, too.
TEST(CellSweep, OfTheTimeAndTheSeed) {
  const std::string file = test::source("examples/picking_line/cell.toml");
  const auto s = sweep(file, {}, {{"minutes", {1, 2}}, {"seed", {1, 2}}}, question_of);
  ASSERT_TRUE(s) << to_string(s.error());
  ASSERT_EQ(s->rows.size(), 4U);
  EXPECT_EQ(s->seconds, 0) << "not the same of all";
  for (const SweepRow& row : s->rows) {
    auto cell = read(file, {{"minutes", std::to_string(row.values[0])}, {"seed", std::to_string(int(row.values[1]))}});
    ASSERT_TRUE(cell);
    const CellQuestion q = question_of(*cell);
    EXPECT_EQ(q.settings.seconds, 60 * row.values[0]);
    EXPECT_EQ(row.throughput.mean, judge_cell(std::move(*cell), q).study.throughput.mean);
  }
  EXPECT_NE(s->rows[0].throughput.mean, s->rows[2].throughput.mean);
}

// The mean of two runs, and what the answer does not answer for.
TEST(CellSweep, MissedIsTheMeanOfTheRuns) {
  const std::string file = test::source("examples/picking_line/cell.toml");
  const auto ask = [](const Cell&) {
    CellQuestion q = for_seconds(60);
    q.seeds = 2;
    return q;
  };
  const auto s = sweep(file, {}, {{"conveyor.belt.speed_mm_per_s", {400}}}, ask);
  ASSERT_TRUE(s) << to_string(s.error());
  auto cell = read(file, {{"conveyor.belt.speed_mm_per_s", "400"}});
  const CellResult alone = judge_cell(std::move(*cell), ask(*cell));
  ASSERT_EQ(alone.study.outcomes.size(), 2U);
  EXPECT_EQ(s->rows[0].missed, 0.5 * (alone.study.outcomes[0].missed + alone.study.outcomes[1].missed));
  EXPECT_GT(s->rows[0].missed, 0) << "so fast a belt leaves some";
  EXPECT_EQ(s->rows[0].not_judged, alone.not_judged);
}

// 30 an hour at 40 items a minute: 30 / 2400.
TEST(CellSweep, CostOfAnItem) {
  Cost cost;
  EXPECT_FALSE(cost_per_item(cost, 40));
  cost.running_price = 30;
  EXPECT_DOUBLE_EQ(*cost_per_item(cost, 40), 0.0125);
  EXPECT_FALSE(cost_per_item(cost, 0));
}

}  // namespace
}  // namespace polypod::cell
