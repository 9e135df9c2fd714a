// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines that are known already beside what a search found.
#include "polypod/design/compared.hpp"

#include "polypod/design/optimize.hpp"
#include "studies.hpp"

namespace polypod::design {
namespace {

constexpr const char* kVary =
    "[[vary]]\nkey = \"base.radius_mm\"\nmin = 20\nmax = 60\n"
    "[[vary]]\nkey = \"platform.radius_mm\"\nmin = 10\nmax = 40\n";
constexpr const char* kFootprint = "[[goal]]\nfigure = \"footprint_mm2\"\nsense = \"min\"\n";
std::string known(const std::string& name, const std::string& values) {
  return "[[compare]]\nname = \"" + name + "\"\nvalues = [" + values + "]\n";
}

TEST(Compared, TakesWhatItDoesNotSayFromTheMachine) {
  const Study s =
      study_on_strut(std::string(kVary) + kFootprint + known("small", "\"base.radius_mm=10\"") + known("as it is", ""));
  ASSERT_EQ(s.compared.size(), 2U);
  EXPECT_EQ(s.compared[0].name, "small");
  EXPECT_EQ(s.compared[0].varied, (std::vector<double>{10, 25}));  // 10 lies outside of the range
  EXPECT_EQ(s.compared[1].varied, (std::vector<double>{50, 25}));
  EXPECT_EQ(s.identity(), study_on_strut(std::string(kVary) + kFootprint).identity());
}

TEST(Compared, RefusesWhatIsNotVaried) {
  const std::string head = std::string(kVary) + kFootprint;
  for (const auto& [text, says] : {std::pair{known("a", "\"base.radius=3\""), "base.radius is not varied"},
                                   {known("a", "\"tool.length_mm=3\""), "tool.length_mm is not varied"},
                                   {known("a", "\"base.radius_mm\""), "no KEY=number"},
                                   {known("a", "") + known("a", ""), "the name of two"},
                                   {std::string("[[compare]]\nvalues = []\n"), "name"},
                                   {known("a", "\"base.radius_mm=30\", \"base.radius_mm=40\""), "given twice"},
                                   {known(" ", ""), "a name of 1"},
                                   {known(std::string(200, 'a'), ""), "a name of 200"},
                                   {known("a", "") + "more = 1\n", "more"}}) {
    const auto s = study_from_text("machine = \"strut\"\n" + head + text, "test.toml", kStrut);
    ASSERT_FALSE(s) << text;
    EXPECT_NE(to_string(s.error()).find(says), std::string::npos) << to_string(s.error());
  }
}

TEST(Compared, StandsBesideTheBest) {
  // The footprint falls with the radius: the best of these four is that of 40.
  const Study s =
      study_on_strut("[[vary]]\nkey = \"base.radius_mm\"\nvalues = [40, 45, 50, 55]\n" + std::string(kFootprint) +
                     known("smaller", "\"base.radius_mm=30\"") + known("larger", "\"base.radius_mm=52\"") +
                     known("the same", "\"base.radius_mm=40\"") + known("none", "\"base.radius_mm=-3\""));
  const Folder folder;
  auto store = Store::open(folder / "a", s, "", "1.0");
  ASSERT_TRUE(store) << to_string(store.error());
  const auto found = optimize(s, *store, {});
  ASSERT_TRUE(found) << to_string(found.error());
  const auto judged = judge_finer(s, *store, {}, *thread_crew(s, 2, {}));
  ASSERT_TRUE(judged) << to_string(judged.error());
  const Known* rows = &judged->known;
  ASSERT_EQ(rows->rows.size(), 4U);
  const std::optional<JudgedAgain> none;
  const Answer answer{s, found->rows, none};
  const auto standing = [&](std::size_t k) { return standing_of(answer, rows->rows[k]).is; };
  EXPECT_EQ(standing(0), Standing::Is::better);
  EXPECT_EQ(standing(1), Standing::Is::worse);
  EXPECT_EQ(standing(2), Standing::Is::alike);
  EXPECT_EQ(standing(3), Standing::Is::no_solution);
  EXPECT_TRUE(standing_of(answer, rows->rows[0]).outside);
  EXPECT_FALSE(standing_of(answer, rows->rows[2]).outside);
  EXPECT_NE(advice(answer, rows->rows).find("widen its ranges"), std::string::npos);
  EXPECT_EQ(advice(answer, {rows->rows[1], rows->rows[2], rows->rows[3]}), "");
  EXPECT_EQ(standing_of({s, {}, none}, rows->rows[0]).is, Standing::Is::alone);
  // They are no candidates, and the store keeps them for this list alone.
  EXPECT_EQ(store->rows()->size(), found->rows.size());
  EXPECT_EQ(kept_compared(*store)->rows.size(), 4U);
  const auto again = judge_finer(s, *store, {}, *thread_crew(s, 2, {}));
  ASSERT_TRUE(again);
  EXPECT_EQ(again->known.rows[0].evaluation.seconds, rows->rows[0].evaluation.seconds);  // not computed again
  Study other = s;
  other.compared.resize(1);
  EXPECT_EQ(judge_finer(other, *store, {}, *thread_crew(other, 2, {}))->known.rows.size(), 1U);
  EXPECT_EQ(kept_compared(*store)->rows.size(), 4U);  // of the longer list, which is that of the store
}

// Certainly better, or worse, is only what is beyond the bounds of both, whatever lies in their middle.
TEST(Compared, TheBoundsDecide) {
  const Study s = study_on_strut("[[vary]]\nkey = \"base.radius_mm\"\nvalues = [40, 45]\n" + std::string(kFootprint) +
                                 known("the other", "\"base.radius_mm=45\""));
  std::vector<Row> rows(1);
  rows[0].varied = {40};
  rows[0].evaluation.state = State::done;
  rows[0].evaluation.violation = 0;
  rows[0].evaluation.objective = {1, 0.9, 1.1};
  rows[0].evaluation.figures = {{1, 0.9, 1.1}};
  Row other = rows[0];
  other.varied = {45};
  const std::optional<JudgedAgain> none;
  using Is = Standing::Is;
  for (const auto& [value, lower, upper, is] :
       {std::tuple{1.2, 1.05, 1.35, Is::alike}, std::tuple{1.2, 1.11, 1.3, Is::better},
        std::tuple{0.8, 0.65, 0.95, Is::alike}, std::tuple{0.8, 0.7, 0.89, Is::worse}}) {
    other.evaluation.objective = {value, lower, upper};
    EXPECT_EQ(standing_of({s, rows, none}, other).is, is) << value << ' ' << lower << ' ' << upper;
  }
}

TEST(Compared, StandsBesideAFront) {
  const Study s =
      study_on_strut("poses = [[0, 0, 60, 0, 0, 0]]\n[[vary]]\nkey = \"base.radius_mm\"\nvalues = [40, 50]\n" +
                     std::string(kFootprint) + "[[goal]]\nfigure = \"height_mm\"\nsense = \"min\"\n" +
                     known("between", "\"base.radius_mm=45\"") + known("as one", "\"base.radius_mm=50\""));
  // Rows with figures that are given: (footprint, height).
  const auto row = [](std::int64_t number, double footprint, double height) {
    Row out;
    out.row = number;
    out.varied = {40};
    out.evaluation.state = State::done;
    out.evaluation.figures = {{footprint, footprint, footprint}, {height, height, height}};
    return out;
  };
  const std::vector<Row> rows{row(1, 10, 30), row(2, 20, 20), row(3, 30, 10)};
  std::optional<JudgedAgain> again;
  const Answer answer{s, rows, again};
  const Standing dominated = standing_of(answer, row(1, 21, 21));
  EXPECT_EQ(dominated.dominated_by, 1);
  EXPECT_EQ(dominated.is, Standing::Is::dominated);
  EXPECT_EQ(dominated.by, 2);
  EXPECT_EQ(dominated.dominates, 0);
  const Standing beside = standing_of(answer, row(1, 15, 25));
  EXPECT_EQ(beside.is, Standing::Is::not_dominated);
  EXPECT_EQ(beside.dominates, 0);
  const Standing before = standing_of(answer, row(1, 15, 9));
  EXPECT_EQ(before.is, Standing::Is::not_dominated);
  EXPECT_EQ(before.dominates, 2);
  EXPECT_EQ(standing_of(answer, row(1, 20, 20)).is, Standing::Is::not_dominated);
  EXPECT_EQ(advice(answer, {row(1, 15, 9)}), "");  // a front does not say that there is nothing else
  // What a finer survey says of a point counts.
  again = JudgedAgain{16, {row(2, 22, 22)}};
  EXPECT_EQ(standing_of(answer, row(1, 21, 21)).is, Standing::Is::not_dominated);
  EXPECT_EQ(standing_of(answer, row(1, 21, 21)).dominates, 1);
}

/// A best that the points of its own survey flatter is compared with known machines over the finer survey: here it
/// breaks its hold there, and a known machine that keeps it is better, whatever the coarse survey says.
TEST(Compared, IsJudgedAsTheAnswerIs) {
  Study s = study_on_strut("resolution = 8\n[[vary]]\nkey = \"base.radius_mm\"\nmin = 30\nmax = 60\n" +
                           std::string("[[goal]]\nfigure = \"condition\"\nsense = \"min\"\n") +
                           known("50", "\"base.radius_mm=50\""));
  const Folder folder;
  auto store = Store::open(folder / "a", s, "", "1.0");
  ASSERT_TRUE(store);
  Outcome found;
  found.best = 0;
  Row& best = found.rows.emplace_back();
  best.row = 7;
  best.varied = {44};
  best.evaluation = *evaluate(s, best.varied, {}, {});
  const std::vector<Row>& rows = found.rows;
  auto judged = judge_finer(s, *store, found, *thread_crew(s, 2, {}));
  ASSERT_TRUE(judged && judged->again);
  const Known* known = &judged->known;
  std::optional<JudgedAgain>& again = judged->again;
  EXPECT_EQ(again->rows[0].row, 7);
  EXPECT_EQ(known->resolution, 16);
  Study finer = s;
  finer.resolution = 16;
  EXPECT_EQ(known->rows[0].evaluation.figures[0].value, evaluate(finer, {50}, {}, {})->figures[0].value);
  EXPECT_NE(known->rows[0].evaluation.figures[0].value, evaluate(s, {50}, {}, {})->figures[0].value);
  Value& objective = again->rows[0].evaluation.objective;
  const double is = known->rows[0].evaluation.objective.value;
  objective = {2 * is, 2 * is, 2 * is};
  EXPECT_EQ(standing_of({s, rows, again}, known->rows[0]).is, Standing::Is::worse);
  again->rows[0].evaluation.state = State::violates;
  EXPECT_EQ(standing_of({s, rows, again}, known->rows[0]).is, Standing::Is::better);
  // Judged with another survey: computed anew.
  EXPECT_EQ(judge_finer(s, *store, {}, *thread_crew(s, 2, {}))->known.resolution, 8);
}

/// What a study compares with may change; the search goes on from its rows, and a reader sees the new list.
TEST(Compared, ANewListKeepsTheSearch) {
  const std::string text = std::string(kVary) + kFootprint;
  const Folder folder;
  const std::string more = text + known("small", "\"base.radius_mm=20\"");
  {
    auto store = Store::open(folder / "a", study_on_strut(text), "machine = \"strut\"\n" + text, "1.0");
    ASSERT_TRUE(store);
    ASSERT_TRUE(store->close());
  }
  {
    const Study s = study_on_strut(more);
    auto store = Store::open(folder / "a", s, "machine = \"strut\"\n" + more, "1.0");
    ASSERT_TRUE(store) << to_string(store.error());
    ASSERT_TRUE(judge_finer(s, *store, {}, *thread_crew(s, 2, {})));
    ASSERT_TRUE(store->close());
  }
  {
    // As an analysis opens it: without the text.
    auto store = Store::open(folder / "a", study_on_strut(more), "", "1.0");
    ASSERT_TRUE(store);
    ASSERT_TRUE(store->close());
  }
  const auto read = Store::read(folder / "a");
  ASSERT_TRUE(read) << to_string(read.error());
  ASSERT_EQ(read->study().compared.size(), 1U);
  EXPECT_EQ(kept_compared(*read)->rows.size(), 1U);
}

}  // namespace
}  // namespace polypod::design
