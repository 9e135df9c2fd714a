// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A front of three goals over eight parameters.
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "polypod/core/random.hpp"
#include "polypod/design/analyse.hpp"
#include "polypod/design/optimize.hpp"
#include "studies.hpp"

namespace polypod::design {
namespace {

using Points = std::vector<std::vector<double>>;

TEST(Hypervolume, OfBoxesInClosedForm) {
  EXPECT_DOUBLE_EQ(hypervolume({{3, 4}}, {1, 1}), 6);
  EXPECT_DOUBLE_EQ(hypervolume({{3, 2}, {2, 4}, {1, 9}, {2, 2}}, {1, 1}), 2 + 2);
  EXPECT_DOUBLE_EQ(hypervolume({{2, 3, 4}}, {0, 0, 0}), 24);
  EXPECT_DOUBLE_EQ(hypervolume({}, {0, 0, 0}), 0);
  EXPECT_DOUBLE_EQ(hypervolume({{0, 5, 5}}, {0, 0, 0}), 0);
  // Two boxes less what they share.
  EXPECT_DOUBLE_EQ(hypervolume({{2, 3, 4}, {4, 3, 2}}, {0, 0, 0}), 24 + 24 - 12);
  EXPECT_DOUBLE_EQ(hypervolume({{2, 2, 2}, {2, 2, 2}, {1, 1, 1}}, {0, 0, 0}), 8);
  EXPECT_DOUBLE_EQ(hypervolume({{1, 2, 3, 4}, {4, 3, 2, 1}}, {0, 0, 0, 0}), 24 + 24 - 4);
}

/// Against the share of random points that a front of three goals dominates.
TEST(Hypervolume, OfManyPointsBesideACount) {
  Random random(2);
  Points points;
  for (int i = 0; i < 40; ++i) {
    Vec3 p(std::abs(random.normal()), std::abs(random.normal()), std::abs(random.normal()));
    p.normalize();
    points.push_back({p.x(), p.y(), p.z()});
  }
  constexpr int kPoints = 200'000;
  int below = 0;
  for (int i = 0; i < kPoints; ++i) {
    const std::array<double, 3> x{random.uniform(), random.uniform(), random.uniform()};
    below += std::any_of(points.begin(), points.end(),
                         [&](const auto& p) { return x[0] <= p[0] && x[1] <= p[1] && x[2] <= p[2]; })
                 ? 1
                 : 0;
  }
  constexpr double kCounting = 0.004;  // 4 standard deviations of the count
  EXPECT_NEAR(hypervolume(points, {0, 0, 0}), static_cast<double>(below) / kPoints, kCounting);
}

Study three_goals(int evaluations, int seed) {
  std::string machine = kStrut;
  machine.replace(machine.find("diameter_mm = 3"), 15, "diameter_mm = 3, compliance_um_per_N = 0.02");
  std::string text = fmt::format("machine = \"strut\"\nevaluations = {}\nseed = {}\n", evaluations, seed);
  text += R"(poses = [[0, 0, 62, 0, 0, 0], [8, 0, 60, 0, 0, 0], [0, -8, 60, 0, 0, 0], [0, 0, 66, 0, 0, 8]]
load_N = [30, 0, -100]
)";
  for (const auto& [key, min, max] : std::vector<std::tuple<std::string, double, double>>{
           {"base.radius_mm", 10, 68},
           {"base.pair_angle_deg", 0, 60},
           {"platform.radius_mm", 5, 60},
           {"platform.pair_angle_deg", 0, 60},
           {"leg.length_min_mm", 40, 65},
           {"leg.length_max_mm", 70, 110},
           {"tool.length_mm", 0, 20},
           {"joint.cone_deg", 20, 80},
       }) {
    text += fmt::format("[[vary]]\nkey = \"{}\"\nmin = {}\nmax = {}\n", key, min, max);
  }
  for (const auto& [figure, sense] :
       {std::pair{"footprint_mm2", "min"}, std::pair{"stiffness_N_per_um", "max"}, std::pair{"drive_force_N", "min"}}) {
    text += fmt::format("[[goal]]\nfigure = \"{}\"\nsense = \"{}\"\n", figure, sense);
  }
  const auto study = study_from_text(text, "three.toml", machine);
  EXPECT_TRUE(study) << to_string(study.error());
  return study.value_or(Study{});
}

TEST(Front, OfThreeGoalsAndEightParametersIsDominatedByNothing) {
  const bool whole = std::getenv("POLYPOD_LONG") != nullptr;
  const int evaluations = whole ? 5000 : 300;
  for (const int seed : {1, 2}) {
    const Folder folder;
    const Study s = three_goals(evaluations, seed);
    ASSERT_EQ(s.vary.size(), 8U);
    auto store = Store::open(folder / "a", s, "", "1.0");
    ASSERT_TRUE(store) << to_string(store.error());
    OptimizeOptions options;
    options.version = "1.0";
    const auto o = optimize(s, *store, options);
    ASSERT_TRUE(o) << to_string(o.error());
    EXPECT_EQ(o->rows.size(), static_cast<std::size_t>(evaluations));
    Points all, front;
    for (const Row& row : o->rows) {
      if (row.evaluation.state != State::done) continue;
      if (row.phase != Phase::start || start_is_candidate(s)) all.push_back(goals_of(s, row.evaluation, true));
    }
    for (const std::size_t i : o->front) front.push_back(goals_of(s, o->rows[i].evaluation, true));
    ASSERT_GT(front.size(), 10U);
    for (const auto& p : front)
      for (const auto& q : all) ASSERT_FALSE(dominates(q, p));
    // And every candidate that nothing dominates is on it.
    for (const auto& p : all) {
      const bool beaten = std::any_of(all.begin(), all.end(), [&](const auto& q) { return dominates(q, p); });
      EXPECT_TRUE(beaten || std::find(front.begin(), front.end(), p) != front.end());
    }
  }
}

}  // namespace
}  // namespace polypod::design
