// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/optimize.hpp"

#include <atomic>

#include "studies.hpp"

namespace polypod::design {
namespace {

constexpr double kRad = 3.14159265358979323846 / 180;

struct Run {
  Outcome outcome;
  int better = 0;  ///< how often it told of a better row
  Status status;
};

/// `most`: cancelled once so many evaluations were computed; negative: never. What is read back is kQuick.
Run run(const Study& study, const std::string& folder, int threads = 0, int most = -1) {
  Run out;
  auto store = Store::open(folder, study, std::string("machine = \"strut\"\n") + kQuick, "1.0");
  EXPECT_TRUE(store) << to_string(store.error());
  if (!store) return out;
  std::atomic<int> computed{0};
  OptimizeOptions options;
  options.threads = threads;
  options.version = "1.0";
  options.progress = [&](const SearchProgress&) { ++computed; };
  options.better = [&](const Row&) {
    ++out.better;
    return Status();
  };
  if (most >= 0) options.cancelled = [&] { return computed >= most; };
  auto found = optimize(study, *store, options);
  EXPECT_TRUE(found) << to_string(found.error());
  if (found) out.outcome = std::move(*found);
  return out;
}

/// Everything of a row that must not depend on how it came to be computed.
std::vector<std::string> lines_of(const std::vector<Row>& rows) {
  std::vector<std::string> out;
  for (const Row& row : rows) {
    std::string line = fmt::format("{} {} {} {}", row.row, name_of(row.phase), name_of(row.evaluation.state),
                                   row.evaluation.objective.value);
    for (const double x : row.varied) line += fmt::format(" {}", x);
    for (const Value& v : row.evaluation.figures) line += fmt::format(" {} {} {}", v.value, v.lower, v.upper);
    out.push_back(line);
  }
  return out;
}

TEST(Optimize, FindsTheOptimumOnAHoldInClosedForm) {
  const Folder folder;
  const Study s = study_on_strut(kQuick);
  const Outcome o = run(s, folder / "a").outcome;
  ASSERT_TRUE(o.best);
  EXPECT_TRUE(o.complete);
  EXPECT_LE(o.rows.size(), 120U);
  const Evaluation& e = o.rows[*o.best].evaluation;
  EXPECT_GE(e.figures[0].value, 2500);  // the hold, exactly
  constexpr double kNear = 2500 * 1e-3;
  EXPECT_NEAR(e.figures[0].value, 2500, kNear);
  EXPECT_DOUBLE_EQ(e.objective.value, 1 / e.figures[0].value);
  EXPECT_EQ(o.rows[0].phase, Phase::start);
}

TEST(Optimize, SameRowsForOneAndManyThreadsAndAnotherSeedOthers) {
  const Folder folder;
  const Study s = study_on_strut(kQuick);
  const auto one = lines_of(run(s, folder / "a", 1).outcome.rows);
  EXPECT_EQ(one, lines_of(run(s, folder / "b", 5).outcome.rows));
  EXPECT_NE(one, lines_of(run(study_on_strut(std::string("seed = 2\n") + kQuick), folder / "c").outcome.rows));
}

TEST(Optimize, BrokenOffAndGoneOnWithIsTheSameAsAtOnce) {
  const Folder folder;
  const Study s = study_on_strut(kQuick);
  const Outcome whole = run(s, folder / "whole").outcome;
  const std::string parts = folder / "parts";
  std::int64_t computed = 0;
  for (const int most : {0, 1, 7, 40, 3, 11}) {
    const Outcome part = run(s, parts, 3, most).outcome;
    EXPECT_FALSE(part.complete);
    computed += part.computed;
    const auto read = Store::read(parts);
    ASSERT_TRUE(read) << to_string(read.error());
    const auto stored = read->rows();
    ASSERT_TRUE(stored);
    EXPECT_EQ(static_cast<std::int64_t>(stored->size()), computed);  // nothing lost
    EXPECT_FALSE(*read->complete());
  }
  EXPECT_GT(computed, 40);
  const Outcome end = run(s, parts).outcome;
  EXPECT_EQ(lines_of(end.rows), lines_of(whole.rows));
  EXPECT_EQ(end.computed + computed, static_cast<std::int64_t>(whole.rows.size()));  // nothing twice
  EXPECT_EQ(run(s, parts).outcome.computed, 0);
}

TEST(Optimize, ALargerBudgetTakesWhatThereIs) {
  const Folder folder;
  const Outcome first = run(study_on_strut(kQuick), folder / "a").outcome;
  std::string more = kQuick;
  more.replace(more.find("120"), 3, "200");
  const Outcome second = run(study_on_strut(more), folder / "a").outcome;
  EXPECT_LT(second.computed, static_cast<std::int64_t>(second.rows.size()));
  std::set<std::int64_t> numbers;
  const auto rows = Store::read(folder / "a").value().rows();
  ASSERT_TRUE(rows);
  for (const Row& row : *rows) EXPECT_TRUE(numbers.insert(row.row).second);
  EXPECT_LE(second.rows[*second.best].evaluation.figures[0].value, 2500 * 1.001);
}

TEST(Optimize, AnotherBudgetDoesNotForgetTheBestOfTheStore) {
  const Folder folder;
  const Outcome first = run(study_on_strut(kQuick), folder / "a").outcome;
  std::string less = kQuick;
  less.replace(less.find("120"), 3, "12");
  const auto again = run(study_on_strut(less), folder / "a");
  const Outcome& second = again.outcome;
  EXPECT_EQ(second.asked, 12U);
  EXPECT_GT(second.rows.size(), 120U);
  ASSERT_TRUE(first.best && second.best);
  EXPECT_EQ(second.rows[*second.best].row, first.rows[*first.best].row);
  EXPECT_EQ(again.better, 0);  // what it found itself is worse
}

/// Three hills over five parameters: the highest, of 0.695, at the ends of four ranges, one of 0.64 inside, and one of
/// 0.6 that is broad.
double hills(const std::vector<double>& u) {
  const auto to = [&](std::size_t i, double x) { return (u[i] - x) * (u[i] - x); };
  const double inside = 0.64 - 0.3 * (to(0, 0.2) + to(1, 0.6) + to(2, 0.9) + to(3, 0.3) + to(4, 0.1));
  const double ends = 0.695 - 0.3 * to(0, 0.5) - 0.15 * u[1] - 0.2 * u[2] - 0.1 * u[3] - 0.15 * u[4];
  const double broad = 0.6 - 0.2 * (to(0, 0.8) + to(1, 0.8) + to(2, 0.8) + to(3, 0.8) + to(4, 0.8));
  return std::max({inside, ends, broad, 1e-3});
}

Study five_parameters(int evaluations, int seed, const char* search, const char* other_goal = nullptr) {
  std::string text = fmt::format("evaluations = {}\nseed = {}\nsearch = \"{}\"\n", evaluations, seed, search);
  for (const char* key :
       {"base.radius_mm", "platform.radius_mm", "platform.pair_angle_deg", "tool.length_mm", "base.pair_angle_deg"})
    text += fmt::format("[[vary]]\nkey = \"{}\"\nmin = 5\nmax = 60\n", key);
  for (const char* goal : {"height_mm", other_goal})
    if (goal != nullptr) text += fmt::format("[[goal]]\nfigure = \"{}\"\nsense = \"min\"\n", goal);
  return study_on_strut(text);
}

/// The rows follow from those before them, not from how many are computed at a time and which of them is done first.
TEST(Optimize, SameRowsInWhateverOrderTheyAreDone) {
  const Folder folder;
  int number = 0;
  const auto rows = [&](const Study& s, std::size_t at_a_time) {
    auto store = Store::open(folder / std::to_string(++number), s, "", "1.0");
    EXPECT_TRUE(store);
    const auto goals = s.goals.size();
    KnownCrew crew(
        s,
        [&](const std::vector<double>& u) {
          return goals == 1 ? std::vector<double>{1 / hills(u)} : std::vector<double>{1 / hills(u), 1 + u[0] * u[1]};
        },
        -1, at_a_time);
    OptimizeOptions options;
    options.crew = &crew;
    const auto o = optimize(s, *store, options);
    EXPECT_TRUE(o);
    EXPECT_EQ(o->asked, 80U);
    return lines_of(o->rows);
  };
  for (const char* search : {"evolution", "models"}) {
    for (const bool front : {false, true}) {
      const Study s = five_parameters(80, 3, search, front ? "footprint_mm2" : nullptr);
      const auto one = rows(s, 1);
      for (const std::size_t at_a_time : {2, 3, 9, 100}) EXPECT_EQ(rows(s, at_a_time), one) << search << front;
    }
  }
}

TEST(Optimize, SeveralStartsSayHowTheyEnded) {
  const Folder folder;
  int on_top = 0;
  constexpr int kSeeds = 30;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    const Study s = five_parameters(200, seed, "evolution");
    const std::string at = folder / std::to_string(seed);
    const auto search = [&](int most) {
      auto store = Store::open(at, s, "", "1.0");
      EXPECT_TRUE(store) << to_string(store.error());
      KnownCrew crew(
          s, [](const std::vector<double>& u) { return std::vector<double>{1 / hills(u)}; }, most);
      OptimizeOptions options;
      options.crew = &crew;
      auto o = optimize(s, *store, options);
      EXPECT_TRUE(o) << to_string(o.error());
      EXPECT_EQ(kept_starts(*store)->size(), o->starts.size());
      return std::move(*o);
    };
    // Broken off in the second start: the rows that are there are taken, and nothing is said of starts.
    const Outcome part = search(90);
    EXPECT_EQ(part.computed, 90);
    const Outcome o = search(-1);
    EXPECT_EQ(o.computed, 110);
    EXPECT_GE(o.starts.size(), 3U);
    int asked = 0;
    for (const Start& start : o.starts) {
      asked += start.evaluations;
      EXPECT_TRUE(std::any_of(o.rows.begin(), o.rows.end(), [&](const Row& row) { return row.row == start.row; }));
    }
    EXPECT_LE(asked, 200);
    ASSERT_TRUE(o.best);
    on_top += o.rows[*o.best].evaluation.objective.value > 0.69 ? 1 : 0;
    const std::string words = in_words(o.starts, o.rows);
    EXPECT_TRUE(words.starts_with(fmt::format("{} starts ended at 0.", o.starts.size()))) << words;
  }
  // One start finds the highest with 3 of 30 seeds.
  EXPECT_GE(on_top, kSeeds / 2);
}

TEST(Optimize, ModelsFindTheHighestOfThreeHills) {
  const Folder folder;
  int on_top = 0;
  constexpr int kSeeds = 30;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    const Study s = five_parameters(200, seed, "models");
    auto store = Store::open(folder / std::to_string(seed), s, "", "1.0");
    ASSERT_TRUE(store) << to_string(store.error());
    KnownCrew crew(s, [](const std::vector<double>& u) { return std::vector<double>{1 / hills(u)}; });
    OptimizeOptions options;
    options.crew = &crew;
    const auto o = optimize(s, *store, options);
    ASSERT_TRUE(o && o->best);
    EXPECT_TRUE(o->starts.empty());
    on_top += o->rows[*o->best].evaluation.objective.value > 0.69 ? 1 : 0;
  }
  EXPECT_GE(on_top, 2 * kSeeds / 3);
}

/// Footprint and height of the strut hexapod of studies.hpp with these radii, in mm2 and mm.
std::array<double, 2> size_of_strut(double r1, double r2) {
  const double c15 = std::cos(15 * kRad), c45 = std::cos(45 * kRad);
  const double area = (std::max(r1 * c15, r2 * c45) + std::max(r1 * c45, r2 * c15)) * 2 * c15 * std::max(r1, r2);
  return {area, std::sqrt(4900 - (r1 * r1 + r2 * r2 - 2 * r1 * r2 * std::cos(30 * kRad)))};
}

TEST(Optimize, StepsAndListsAreTriedWholeWhereTheyFit) {
  const Folder folder;
  const Study s = study_on_strut(R"(evaluations = 60
[[vary]]
key = "base.radius_mm"
min = 10
max = 60
step = 5
[[vary]]
key = "platform.radius_mm"
values = [25, 12, 40]
[[goal]]
figure = "height_mm"
sense = "max"
[[hold]]
figure = "footprint_mm2"
min = 3000
)");
  const Outcome o = run(s, folder / "a").outcome;
  EXPECT_EQ(o.rows.size(), 33U);  // 11 x 3; the start is one of them
  double best = 0;
  for (int i = 0; i < 11; ++i) {
    for (const double r2 : {25.0, 12.0, 40.0}) {
      const auto [area, height] = size_of_strut(10 + 5 * i, r2);
      if (area >= 3000) best = std::max(best, height);
    }
  }
  ASSERT_TRUE(o.best);
  EXPECT_NEAR(o.rows[*o.best].evaluation.figures[0].value, best, 1e-6);
}

TEST(Optimize, MixedParametersKeepTheirSteps) {
  const Folder folder;
  const Study s = study_on_strut(R"(evaluations = 150
[[vary]]
key = "base.radius_mm"
min = 10
max = 60
[[vary]]
key = "platform.radius_mm"
min = 10
max = 40
step = 0.5
[[goal]]
figure = "height_mm"
sense = "max"
[[hold]]
figure = "footprint_mm2"
min = 3000
)");
  const Outcome o = run(s, folder / "a").outcome;
  ASSERT_TRUE(o.best);
  for (const Row& row : o.rows) {
    if (row.phase == Phase::start) continue;
    const double steps = (row.varied[1] - 10) / 0.5;
    EXPECT_NEAR(steps, std::round(steps), 1e-9);
  }
  // For any base the platform nearest to it, over r2 = r1 cos 30, is the highest: a scan says how high.
  double best = 0;
  for (double r1 = 10; r1 <= 60; r1 += 0.01) {
    for (double r2 = 10; r2 <= 40; r2 += 0.5) {
      const auto [area, height] = size_of_strut(r1, r2);
      if (area >= 3000) best = std::max(best, height);
    }
  }
  EXPECT_GT(o.rows[*o.best].evaluation.figures[0].value, best * (1 - 1e-3));
}

/// Area between the front and a corner that is worse than all of it, both goals to be small.
double hypervolume(std::vector<std::array<double, 2>> points, double x1, double y1) {
  std::sort(points.begin(), points.end());
  double area = 0, y = y1;
  for (const auto& p : points) {
    if (p[0] >= x1 || p[1] >= y) continue;
    area += (x1 - p[0]) * (y - p[1]);
    y = p[1];
  }
  return area;
}

/// The share of the hypervolume of a scan in closed form, 7 171 points, that a front of 600 evaluations has.
double share_of_scan(const std::string& search) {
  const Folder folder;
  const Study s = study_on_strut("search = \"" + search + "\"\n" + R"(evaluations = 600
[[vary]]
key = "base.radius_mm"
min = 10
max = 60
[[vary]]
key = "platform.radius_mm"
min = 5
max = 40
[[goal]]
figure = "footprint_mm2"
sense = "min"
[[goal]]
figure = "height_mm"
sense = "min"
)");
  const Outcome o = run(s, folder / "a").outcome;
  EXPECT_FALSE(o.best);
  EXPECT_GT(o.front.size(), 20U);
  std::vector<std::array<double, 2>> found, scan;
  for (const std::size_t i : o.front) {
    const auto& f = o.rows[i].evaluation.figures;
    found.push_back({f[0].value, f[1].value});
    for (const Row& row : o.rows) {
      const auto& g = row.evaluation.figures;
      if (row.evaluation.state != State::done || row.phase == Phase::start) continue;
      EXPECT_FALSE(g[0].value <= f[0].value && g[1].value <= f[1].value &&
                   (g[0].value < f[0].value || g[1].value < f[1].value));
    }
  }
  for (int i = 0; i <= 100; ++i) {
    for (int k = 0; k <= 70; ++k) {
      const AnyMachine m = *s.machine_at({10 + 0.5 * i, 5 + 0.5 * k});
      if (kinematics::inverse(m, *kinematics::home_pose(m)).reachable() == nullptr) continue;  // it cannot stand
      scan.push_back(size_of_strut(10 + 0.5 * i, 5 + 0.5 * k));
    }
  }
  const double corner_x = 13000, corner_y = 71;
  return hypervolume(found, corner_x, corner_y) / hypervolume(scan, corner_x, corner_y);
}

// Models go by ratios: more of their points are at small footprints, where the area under the front is small.
TEST(Optimize, FrontOfTwoGoalsBesideAScanInClosedForm) {
  EXPECT_GT(share_of_scan("evolution"), 0.97);
  EXPECT_GT(share_of_scan("models"), 0.96);
}

TEST(Optimize, NothingThatKeepsTheHoldsIsNoBest) {
  const Folder folder;
  std::string text = kQuick;
  text.replace(text.find("min = 2500"), 10, "min = 9e9");
  text.replace(text.find("120"), 3, "30");
  const Outcome o = run(study_on_strut(text), folder / "a").outcome;
  EXPECT_FALSE(o.best);
  EXPECT_TRUE(o.front.empty());
  EXPECT_TRUE(o.complete);
  for (const Row& row : o.rows) EXPECT_NE(row.evaluation.state, State::done);
}

TEST(Optimize, TheStartCountsWhereItIsOneOfTheCandidates) {
  EXPECT_TRUE(start_is_candidate(study_on_strut(kQuick)));
  std::string text = kQuick;
  text.replace(text.find("max = 60"), 8, "max = 40");  // the start has 50
  EXPECT_FALSE(start_is_candidate(study_on_strut(text)));
  EXPECT_FALSE(start_is_candidate(
      study_on_strut(std::string(kQuick) + "[[tie]]\nkey = \"tool.length_mm\"\nequals = \"base.radius_mm\"\n")));
  // Of joints from radius and angle one is set, with more digits than are tried.
  EXPECT_TRUE(
      start_is_candidate(study_on_strut("[[vary]]\nkey = \"base.joint[1].x_mm\"\nmin = 40\nmax = 60\n[[goal]]\nfigure "
                                        "= \"height_mm\"\nsense = \"min\"\n")));
}

/// JEL 8.4, Table 8.56, third column: with the radii 50 and 25, no tool and most weight on conditioning the best angles
/// between the joints are 0 and 0, at the end of both ranges.
TEST(Optimize, AnglesOfJelenkovicsThirdOptimum) {
  const Folder folder;
  const Study s = study_on_strut(R"(tilt_deg = 20
resolution = 8
rel_tol = 0.02
evaluations = 24
[[vary]]
key = "base.pair_angle_deg"
min = 0
max = 90
[[vary]]
key = "platform.pair_angle_deg"
min = 0
max = 90
[[goal]]
figure = "volume_mm3"
sense = "max"
weight = 0.2
best = 233574
[[goal]]
figure = "tolerance_mm"
sense = "min"
weight = 0.2
best = 0.1431
[[goal]]
figure = "condition"
sense = "min"
weight = 0.6
best = 1.835
)");
  const Outcome o = run(s, folder / "a").outcome;
  ASSERT_TRUE(o.best);
  const Row& best = o.rows[*o.best];
  for (const double angle : best.varied) EXPECT_NEAR(angle, 0, 0.5);  // deg
  const auto printed = evaluate(s, {0, 0}, {}, {});
  ASSERT_TRUE(printed);
  EXPECT_GE(best.evaluation.objective.value, printed->objective.value);
  // The source has V 17082, 0.160 and 1.985; its volumes come out some per cent below ours.
  EXPECT_NEAR(printed->figures[1].value, 0.160, 0.003);
  EXPECT_NEAR(printed->figures[2].value, 1.985, 0.05);
  EXPECT_NEAR(printed->figures[0].value, 17082, 0.08 * 17082);
}

/// JEL Table 8.43 (Huang 1998; Pittens and Podhorodeski 1993): the condition number of a hexapod on struts is at least
/// sqrt 2, and this is reached where the struts stand at 45 deg on radii in the ratio 2 to 1 with joints in pairs.
/// The struts may move by a thousandth, so that the means over the workspace are those of one pose.
TEST(Optimize, IsotropicHexapod) {
  const Folder folder;
  const bool whole = std::getenv("POLYPOD_LONG") != nullptr;
  const Study s =
      study_from_text(std::string("machine = \"strut\"\nresolution = 8\nevaluations = ") + (whole ? "500" : "110") + R"(
[[vary]]
key = "base.radius_mm"
min = 20
max = 68
[[vary]]
key = "platform.radius_mm"
min = 10
max = 68
)" +
                          (whole ? R"([[vary]]
key = "base.pair_angle_deg"
min = 0
max = 50
[[vary]]
key = "platform.pair_angle_deg"
min = 0
max = 50
)"
                                 : "") +
                          R"([[goal]]
figure = "condition"
sense = "min"
best = 1.4142135623731
)",
                      "iso.toml", R"(
name = "strut"
family = "strut-hexapod"
base = { radius_mm = 50, pair_angle_deg = 0 }
platform = { radius_mm = 40, pair_angle_deg = 0 }
leg = { length_min_mm = 69.95, length_max_mm = 70.05, diameter_mm = 3 }
tool = { length_mm = 0 }
joint = { limit = "cone", cone_deg = 60 }
)")
          .value();
  const Outcome o = run(s, folder / "a").outcome;
  ASSERT_TRUE(o.best);
  const Row& best = o.rows[*o.best];
  constexpr double kNear = 2e-3;  // the workspace is no point
  EXPECT_GT(best.evaluation.objective.value, 1 - kNear);
  EXPECT_LE(best.evaluation.objective.value, 1);
  const double r1 = 70 / std::sqrt(2.0) / std::sin(60 * kRad);
  EXPECT_NEAR(best.varied[0], r1, 0.02 * r1);
  EXPECT_NEAR(best.varied[1], r1 / 2, 0.02 * r1);
}

}  // namespace
}  // namespace polypod::design
