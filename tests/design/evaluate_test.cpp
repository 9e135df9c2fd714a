// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/evaluate.hpp"

#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/quality/survey.hpp"
#include "polypod/workspace/shape.hpp"
#include "studies.hpp"

namespace polypod::design {
namespace {

const std::string kRadius = "[[vary]]\nkey = \"base.radius_mm\"\nmin = 10\nmax = 90\n";

std::string goal(const std::string& figure, const std::string& rest) {
  return "[[goal]]\nfigure = \"" + figure + "\"\n" + rest + "\n";
}

Evaluation evaluated(const Study& s, const std::vector<double>& varied, const Incumbents& incumbents = {}) {
  const auto e = evaluate(s, varied, incumbents, {});
  EXPECT_TRUE(e) << to_string(e.error());
  return e.value_or(Evaluation{});
}

TEST(Evaluate, FiguresAreThoseOfTheLibraryAndTheObjectiveIsTheirWeightedSum) {
  const Study s = study_on_strut("resolution = 10\n" + kRadius +
                                 goal("volume_mm3", "sense = \"max\"\nweight = 0.5\nbest = 200000") +
                                 goal("tolerance_mm", "sense = \"min\"\nweight = 0.3\nbest = 0.15") +
                                 goal("condition", "sense = \"min\"\nweight = 0.2\nbest = 2"));
  const Evaluation e = evaluated(s, {40});
  ASSERT_EQ(e.state, State::done) << e.reason;
  const auto m = s.machine_at({40});
  ASSERT_TRUE(m);
  workspace::Options options;
  options.relative_tolerance = 0.01;
  const auto v = workspace::volume(*m, options);
  ASSERT_TRUE(v);
  EXPECT_DOUBLE_EQ(e.figures[0].value, units::to_mm3(v->volume));
  EXPECT_DOUBLE_EQ(e.figures[0].lower, units::to_mm3(v->lower));
  quality::SurveyOptions look;
  look.workspace = options;
  look.resolution = 10;
  const auto survey = quality::survey(*m, look);
  ASSERT_TRUE(survey);
  const auto sizes = quality::sized(*m, {{"all", 0.01}}, true);
  const auto tolerance = quality::tolerance_field(*m, *survey, look, *sizes);
  const auto dexterity = quality::dexterity_field(*m, *survey, look);
  ASSERT_TRUE(tolerance && dexterity);
  const double mean = quality::statistics_seen(*m, *survey, look, dexterity->condition, dexterity->anywhere, 0).mean;
  EXPECT_DOUBLE_EQ(e.figures[2].value, mean);  // as `dexterity` prints it
  EXPECT_DOUBLE_EQ(e.figures[1].value, units::to_mm(quality::statistics(*survey, tolerance->position.mean).mean));
  EXPECT_NEAR(e.objective.value,
              0.5 * e.figures[0].value / 200000 + 0.3 * 0.15 / e.figures[1].value + 0.2 * 2 / e.figures[2].value,
              1e-12);
  EXPECT_LT(e.objective.lower, e.objective.value);
  EXPECT_GT(e.objective.upper, e.objective.value);
}

TEST(Evaluate, DropsOnlyWhatIsProvenWorse) {
  const Study s = study_on_strut(kRadius + "[[vary]]\nkey = \"platform.radius_mm\"\nmin = 7\nmax = 60\n" +
                                 goal("volume_mm3", "sense = \"max\""));
  Random random(3);
  int dropped = 0, done = 0;
  for (int i = 0; i < 12; ++i) {
    const std::vector<double> at{random.uniform(10, 90), random.uniform(7, 60)};
    const Evaluation whole = evaluated(s, at);
    if (whole.state == State::refused) continue;
    ASSERT_EQ(whole.state, State::done) << whole.reason;
    Incumbents beside;
    beside.objective = whole.objective.value * random.uniform(0.8, 1.4);
    const Evaluation e = evaluated(s, at, beside);
    if (e.state == State::dropped) {
      ++dropped;
      EXPECT_LT(whole.objective.value, beside.objective);
      EXPECT_LE(e.objective.lower, whole.objective.value);
      EXPECT_GE(e.objective.upper, whole.objective.value);
    } else {
      ++done;
      EXPECT_EQ(e.objective.value, whole.objective.value);
    }
  }
  EXPECT_GT(dropped, 0);
  EXPECT_GT(done, 0);
}

TEST(Evaluate, DropsFromAFrontOnlyWhatIsDominated) {
  const Study s =
      study_on_strut(kRadius + goal("volume_mm3", "sense = \"max\"") + goal("footprint_mm2", "sense = \"min\""));
  ASSERT_TRUE(s.wants_front());
  const Evaluation whole = evaluated(s, {50});
  ASSERT_EQ(whole.state, State::done) << whole.reason;
  EXPECT_TRUE(std::isnan(whole.objective.value));
  const double volume = whole.figures[0].value, foot = whole.figures[1].value;
  EXPECT_EQ(evaluated(s, {50}, {0, {{2 * volume, -0.9 * foot}}}).state, State::dropped);
  EXPECT_EQ(evaluated(s, {50}, {0, {{2 * volume, -1.1 * foot}}}).state, State::done);
  EXPECT_EQ(evaluated(s, {50}, {0, {{0.5 * volume, -0.9 * foot}}}).state, State::done);
}

TEST(Evaluate, HoldsAreKeptOrTheirBreachIsMeasured) {
  const std::string wanted = goal("footprint_mm2", "sense = \"min\"");
  const Study volume = study_on_strut(kRadius + wanted + "[[hold]]\nfigure = \"volume_mm3\"\nmin = 1e6\n");
  const Evaluation e = evaluated(volume, {50});
  EXPECT_EQ(e.state, State::violates);
  EXPECT_GT(e.violation, 0.5);
  EXPECT_LT(e.violation, 1);
  EXPECT_NE(e.reason.find("volume_mm3 at least"), std::string::npos) << e.reason;
  EXPECT_EQ(evaluated(study_on_strut(kRadius + wanted + "[[hold]]\nfigure = \"volume_mm3\"\nmin = 1e5\n"), {50}).state,
            State::done);
  // Coarse bounds that hold the limit between them decide nothing: those of the fine volume do, and where the limit
  // lies between these as well it is not proven to be kept.
  const Study plain = study_on_strut(kRadius + goal("volume_mm3", "sense = \"max\""));
  const Value fine = evaluated(plain, {50}).figures[0];
  ASSERT_LT(fine.lower, fine.upper);
  const auto judged = [&](const char* bound, double limit) {
    return evaluated(study_on_strut(kRadius + wanted +
                                    fmt::format("[[hold]]\nfigure = \"volume_mm3\"\n{} = {:.17g}\n", bound, limit)),
                     {50});
  };
  const double low = 0.5 * (fine.lower + fine.value), high = 0.5 * (fine.value + fine.upper);
  for (const auto& [bound, limit, why] : {std::tuple{"min", fine.lower * (1 - 1e-6), ""},
                                          {"min", low, "not proven: volume_mm3 at least"},
                                          {"min", high, "not proven: volume_mm3 at least"},
                                          {"min", fine.upper * (1 + 1e-6), "not kept: volume_mm3 at least"},
                                          {"max", fine.upper * (1 + 1e-6), ""},
                                          {"max", high, "not proven: volume_mm3 at most"},
                                          {"max", low, "not proven: volume_mm3 at most"},
                                          {"max", fine.lower * (1 - 1e-6), "not kept: volume_mm3 at most"}}) {
    const Evaluation at = judged(bound, limit);
    const bool kept = *why == '\0';
    EXPECT_EQ(at.state, kept ? State::done : State::violates) << bound << " " << limit << ": " << at.reason;
    EXPECT_EQ(at.violation == 0, kept) << bound << " " << limit;
    EXPECT_TRUE(at.reason.starts_with(why)) << at.reason;
  }
  // A box that `workspace --contains` proves, one that reaches out of it, and one far away.
  const auto box = [&](const std::string& corners) {
    return evaluated(study_on_strut(kRadius + wanted + "[[hold]]\nbox_mm = [" + corners + "]\n"), {50});
  };
  EXPECT_EQ(box("-8, -8, 60, 8, 8, 70").state, State::done);
  const Evaluation partly = box("-8, -8, 30, 8, 8, 70"), far = box("200, 200, 30, 208, 208, 70");
  EXPECT_EQ(partly.state, State::violates);
  EXPECT_EQ(far.state, State::violates);
  EXPECT_LT(partly.violation, far.violation);
  EXPECT_NEAR(far.violation, 1.01, 1e-9);
}

TEST(Evaluate, LargestBoxIsTheOneOfTheLibrary) {
  const Study s = study_on_strut(kRadius + goal("largest_box_mm3", "sense = \"max\""));
  const Evaluation e = evaluated(s, {30});
  ASSERT_EQ(e.state, State::done) << e.reason;
  const auto m = s.machine_at({30});
  workspace::Options options = workspace_options(s);
  const auto shape = workspace::largest_inside(*m, options, workspace::ShapeKind::box);
  ASSERT_TRUE(shape);
  EXPECT_DOUBLE_EQ(e.figures[0].value, units::to_mm3(shape->volume()));
  Incumbents beside;
  beside.objective = 1e9;
  EXPECT_EQ(evaluated(s, {30}, beside).state, State::dropped);  // no box is larger than the workspace
}

TEST(Evaluate, WhatIsNoMachineOrHasNoWorkspaceIsRefusedWithTheReason) {
  const Study s = study_on_strut("tilt_deg = 80\n" + kRadius + goal("volume_mm3", "sense = \"max\""));
  const Evaluation empty = evaluated(s, {50});
  EXPECT_EQ(empty.state, State::refused);
  EXPECT_NE(empty.reason.find("no point is reachable"), std::string::npos) << empty.reason;
  const Study home = study_on_strut("[[vary]]\nkey = \"base.radius_mm\"\nmin = -5\nmax = 90\n" +
                                    goal("volume_mm3", "sense = \"max\""));
  const Evaluation none = evaluated(home, {-3});
  EXPECT_EQ(none.state, State::refused);
  EXPECT_FALSE(none.reason.empty());
  EXPECT_TRUE(std::isinf(none.violation));
}

TEST(Evaluate, FootprintAndHeightOfAStrutHexapodInClosedForm) {
  const Study s =
      study_on_strut(kRadius + goal("footprint_mm2", "sense = \"min\"") + goal("height_mm", "sense = \"min\""));
  const Evaluation e = evaluated(s, {40});
  ASSERT_EQ(e.state, State::done) << e.reason;
  // Base pairs at 0, 120 and 240 deg, each 30 deg wide: x from 40 cos 135 to 40 cos 15, y to 40 sin 105.
  const double rad = std::acos(-1.0) / 180;
  const double x = 40 * (std::cos(15 * rad) - std::cos(135 * rad)), y = 2 * 40 * std::sin(105 * rad);
  EXPECT_NEAR(e.figures[0].value, x * y, 1e-6 * x * y);
  // Struts of 70 mm between points 30 deg apart.
  const double across2 = 40 * 40 + 25 * 25 - 2 * 40 * 25 * std::cos(30 * rad);
  EXPECT_NEAR(e.figures[1].value, std::sqrt(70 * 70 - across2), 1e-6);
}

TEST(Evaluate, ThreadsDoNotMatter) {
  const Study s = study_on_strut("resolution = 8\ntilt_deg = 5\n" + kRadius + goal("condition", "sense = \"min\""));
  const auto one = evaluate(s, {45}, {}, {1, nullptr}), many = evaluate(s, {45}, {}, {0, nullptr});
  ASSERT_TRUE(one && many);
  EXPECT_EQ(one->objective.value, many->objective.value);
}

}  // namespace
}  // namespace polypod::design
