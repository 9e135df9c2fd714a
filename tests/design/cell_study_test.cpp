// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Studies of cells against the cells themselves, judged one by one.
#include "polypod/design/cell_study.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "paths.hpp"
#include "polypod/cell/judge.hpp"
#include "polypod/cell/sweep.hpp"
#include "polypod/core/units.hpp"
#include "polypod/design/analyse.hpp"
#include "polypod/design/optimize.hpp"
#include "studies.hpp"

namespace polypod::design {
namespace {

std::string head() {
  return "cell = \"" + test::source("examples/picking_line/cell.toml") +
         "\"\nevaluations = 20\n[[set]]\nkey = \"minutes\"\nvalue = 2\n[[set]]\nkey = "
         "\"task.pick.window_mm[1]\"\nvalue = "
         "450\n";
}
constexpr const char* kVary =
    "[[vary]]\nkey = \"conveyor.belt.speed_mm_per_s\"\nmin = 100\nmax = 200\nstep = 50\n"
    "[[vary]]\nkey = \"task.pick.window_mm[2]\"\nvalues = [1000, 1150]\n";
constexpr const char* kGoal = "[[goal]]\nfigure = \"throughput_per_min\"\nsense = \"max\"\n";

Study study_of(const std::string& text) {
  auto s = study_from_text(text, "study.toml");
  if (!s) ADD_FAILURE() << to_string(s.error());
  return std::move(*s);
}
std::string error_of(const std::string& text) {
  const auto s = study_from_text(text, "study.toml");
  return s ? "none" : s.error().id;
}

TEST(CellStudy, CandidatesAreWorthWhatTheCellIs) {
  const Study s = study_of("runs = 2\n" + head() + kVary + kGoal +
                           "[[hold]]\nfigure = \"missed\"\nmax = 3\n[[hold]]\nfigure = \"footprint_mm2\"\nmax = 6e6\n"
                           "[[hold]]\nfigure = \"cost_per_item\"\nmax = 1\n");
  const auto e = evaluate(s, {150, 1000}, {}, {});
  ASSERT_TRUE(e) << to_string(e.error());
  auto cell = cell::read(
      test::source("examples/picking_line/cell.toml"),
      {{"conveyor.belt.speed_mm_per_s", "150"}, {"task.pick.window_mm[1]", "450"}, {"task.pick.window_mm[2]", "1000"}});
  ASSERT_TRUE(cell);
  cell::CellQuestion q;
  q.settings.seconds = 120;
  q.settings.seed = static_cast<std::uint64_t>(cell->seed);
  q.seeds = 2;
  const cell::CellResult r = cell::judge_cell(std::move(*cell), q);
  EXPECT_EQ(e->figures[0].value, r.study.throughput.mean);
  EXPECT_EQ(e->figures[1].value, (r.study.outcomes[0].missed + r.study.outcomes[1].missed) / 2.0);
  EXPECT_NEAR(e->figures[2].value, 2000.0 * 2800, 1e-3);
  EXPECT_DOUBLE_EQ(e->figures[3].value, 30.0 / 60 / r.study.throughput.mean);
  EXPECT_EQ(e->objective.value, r.study.throughput.mean);
}

TEST(CellStudy, AllCombinationsGiveTheBestOfASweep) {
  const Study s = study_of(head() + kVary + kGoal);
  const auto swept =
      cell::sweep(test::source("examples/picking_line/cell.toml"), {{"task.pick.window_mm[1]", "450"}},
                  {{"conveyor.belt.speed_mm_per_s", {100, 150, 200}}, {"task.pick.window_mm[2]", {1000, 1150}}},
                  [](const cell::Cell&) {
                    cell::CellQuestion q;
                    q.settings.seconds = 120;
                    return q;
                  });
  ASSERT_TRUE(swept);
  ASSERT_TRUE(swept->best);
  std::vector<Row> first;
  for (const int threads : {1, 2}) {
    const Folder folder;
    auto store = Store::open(folder / "kept", s, head() + kVary + kGoal, "test");
    ASSERT_TRUE(store) << to_string(store.error());
    OptimizeOptions options;
    options.threads = threads;
    const auto found = optimize(s, *store, options);
    ASSERT_TRUE(found) << to_string(found.error());
    EXPECT_EQ(found->asked, 6U) << "the start is one of the six combinations";
    ASSERT_TRUE(found->best);
    const Row& best = found->rows[*found->best];
    EXPECT_EQ(best.evaluation.objective.value, swept->rows[*swept->best].throughput.mean);
    EXPECT_EQ(best.varied, swept->rows[*swept->best].values);
    for (const Row& row : found->rows) {
      if (row.phase == Phase::start) continue;
      const auto same = std::find_if(swept->rows.begin(), swept->rows.end(),
                                     [&](const cell::SweepRow& r) { return r.values == row.varied; });
      ASSERT_NE(same, swept->rows.end());
      EXPECT_EQ(row.evaluation.figures[0].value, same->throughput.mean);
      EXPECT_EQ(row.evaluation.state == State::done, same->problems.empty()) << row.evaluation.reason;
    }
    if (first.empty()) {
      first = found->rows;
      // The winner as a file is a cell that needs no other, and as good as the row says.
      const auto text = file_of_row(s, best);
      ASSERT_TRUE(text) << to_string(text.error());
      auto winner = cell::from_text(*text, "winner.toml");
      ASSERT_TRUE(winner) << to_string(winner.error());
      cell::CellQuestion q;
      q.settings.seconds = units::to_per_min(winner->minutes);
      EXPECT_EQ(cell::judge_cell(std::move(*winner), q).study.throughput.mean, best.evaluation.objective.value);
    } else {
      ASSERT_EQ(found->rows.size(), first.size());
      for (std::size_t i = 0; i < first.size(); ++i) {
        EXPECT_EQ(found->rows[i].varied, first[i].varied);
        EXPECT_EQ(found->rows[i].evaluation.objective.value, first[i].evaluation.objective.value);
      }
    }
  }
}

TEST(CellStudy, ABadCellBreaksTheStudyLikeAHold) {
  const Study s = study_of(head() +
                           "[[vary]]\nkey = \"machine.picker.at_mm[3]\"\nmin = 1700\nmax = 3000\n"
                           "[[vary]]\nkey = \"guard.front.height_mm\"\nmin = 100\nmax = 2000\n" +
                           kGoal);
  const auto far = evaluate(s, {3000, 2000}, {}, {});
  ASSERT_TRUE(far);
  EXPECT_EQ(far->state, State::violates);
  EXPECT_NE(far->reason.find("reach"), std::string::npos) << far->reason;
  const auto low = evaluate(s, {1800, 100}, {}, {});
  ASSERT_TRUE(low);
  EXPECT_EQ(low->state, State::violates);
  EXPECT_NE(low->reason.find("guard"), std::string::npos) << low->reason;
  EXPECT_LT(low->violation, far->violation);
  const auto good = evaluate(s, {1800, 2000}, {}, {});
  ASSERT_TRUE(good);
  EXPECT_NE(good->reason.find("missed"), std::string::npos) << "at 200 mm/s: " << good->reason;
}

TEST(CellStudy, IsKeptWholeAndKnownAgain) {
  const std::string text = head() + kVary + kGoal;
  const Study s = study_of(text);
  EXPECT_TRUE(s.of_cell);
  EXPECT_EQ(s.machine_toml.find("delta-picker\"\nangles"), std::string::npos);
  const auto again = study_from_text(text, "gone.toml", s.machine_toml);
  ASSERT_TRUE(again) << to_string(again.error());
  EXPECT_EQ(again->identity(), s.identity());
  const auto more = study_from_text(
      text.substr(0, text.find("[[set]]")) + "runs = 3\n" + text.substr(text.find("[[set]]")), "study.toml");
  ASSERT_TRUE(more);
  EXPECT_NE(more->identity(), s.identity());
  EXPECT_EQ(s.values_of(s.start), (std::vector<double>{200, 1000}));
}

TEST(CellStudy, TiesFollowNumbersOfTheCell) {
  const Study s =
      study_of(head() + kVary + kGoal +
               "[[tie]]\nkey = \"camera.camera.delay_ms\"\nequals = \"conveyor[1].speed_mm_per_s\"\nfactor = 0.5\n"
               "[[tie]]\nkey = \"task.pick.release_mm\"\nequals = \"spot.boxes.at_mm[3]\"\noffset = 25\n");
  const auto p = s.parameters({150, 1000});
  ASSERT_EQ(p.size(), 4U);
  EXPECT_EQ(p[3].second, 925);
  const auto cell = cell_at(s, {150, 1000});
  ASSERT_TRUE(cell) << to_string(cell.error());
  const auto made = cell::from_text(*cell, "cell.toml");
  ASSERT_TRUE(made) << to_string(made.error());
  EXPECT_DOUBLE_EQ(made->tasks[0].release, 0.925);
}

TEST(CellStudy, FaultsOfStudies) {
  EXPECT_EQ(error_of(head() + "[[vary]]\nkey = \"conveyor.belt.sped_mm_per_s\"\nmin = 1\nmax = 2\n" + kGoal), "OP102");
  EXPECT_EQ(error_of(head() + kVary + "[[vary]]\nkey = \"conveyor[1].speed_mm_per_s\"\nmin = 1\nmax = 2\n" + kGoal),
            "OP103")
      << "the same number by another name";
  EXPECT_EQ(error_of(head() + kVary + "[[goal]]\nfigure = \"volume_mm3\"\nsense = \"max\"\n"), "OP107");
  EXPECT_EQ(error_of("machine = \"hexapod-strut\"\n[[vary]]\nkey = \"base.radius_mm\"\nmin = 40\nmax = 60\n" +
                     std::string(kGoal)),
            "OP107");
  EXPECT_EQ(error_of(head() + kVary + "[[goal]]\nfigure = \"missed\"\nsense = \"min\"\n"), "OP145");
  EXPECT_EQ(error_of("tilt_deg = 20\n" + head() + kVary + kGoal), "OP145");
  EXPECT_EQ(error_of("cell = \"nowhere.toml\"\n" + std::string(kVary) + kGoal), "FI100");
  EXPECT_EQ(error_of("cell = \"" + test::source("cells/kozubik/cell.toml") +
                     "\"\n[[vary]]\nkey = \"conveyor.A.speed_mm_per_s\"\nmin = 60\nmax = 180\n[[goal]]\nfigure = "
                     "\"cost_per_item\"\nsense = \"min\"\n"),
            "OP107")
      << "the seed's cell has no price of an hour";
  EXPECT_EQ(error_of(head() + kVary + kGoal + "[[goal]]\nfigure = \"missed\"\nsense = \"min\"\n"), "none")
      << "of a front missed may be a goal";
}

}  // namespace
}  // namespace polypod::design
