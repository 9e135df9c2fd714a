// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Files and the page of a survey against the poses themselves.
#include "polypod/pages/quality.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <sstream>

#include "machines.hpp"

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::pages {
namespace {

using test::congruent;

using machine::AnyMachine;
using ::testing::HasSubstr;
using ::testing::Not;

struct Case {
  AnyMachine machine;
  quality::SurveyOptions options;
  QualityQuestion question;
  QualityFields fields;

  explicit Case(const AnyMachine& m, double tilt_deg = 0, int resolution = 12, bool tolerances = true) : machine(m) {
    options.resolution = resolution;
    options.workspace.directions.tilt = units::from_deg(tilt_deg);
    question.tolerances = tolerances;
    question.sizes = *quality::sized(
        machine, {{tolerances || kinematics::is_serial(m) ? "all" : "leg.length[1]", 0.01}}, tolerances);
    const auto found = quality_fields(machine, options, question);
    EXPECT_TRUE(found) << (found ? "" : to_string(found.error()));
    if (found) fields = *found;
  }
  [[nodiscard]] std::string page() const {
    QualityPageOptions how;
    how.command = "polypod dexterity <x>";
    how.given = {"all=0.01"};
    const auto html = quality_page(machine, options, question, fields, how);
    EXPECT_TRUE(html) << (html ? "" : to_string(html.error()));
    return html ? *html : "";
  }
};

std::vector<std::vector<std::string>> cells(const std::string& csv) {
  std::vector<std::vector<std::string>> out;
  std::istringstream lines(csv);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream fields(line);
    out.emplace_back();
    for (std::string cell; std::getline(fields, cell, ',');) out.back().push_back(cell);
  }
  return out;
}

TEST(QualityFiles, RowsAreThePosesThemselves) {
  const Case c(*machine::load("hexapod-strut"));
  const auto rows = cells(quality_csv(c.fields));
  ASSERT_EQ(rows.size(), c.fields.survey.inside.size() + 1);
  ASSERT_EQ(rows[0].size(), 13U);
  EXPECT_EQ(rows[0][3], "position_mm");
  EXPECT_EQ(rows[0][12], "determinant_worst");
  constexpr double kRounding = 1e-9;  // of the numbers; another order of sums
  for (const std::size_t row : {std::size_t{1}, rows.size() / 2, rows.size() - 1}) {
    std::vector<double> n;
    for (const std::string& cell : rows[row]) n.push_back(std::stod(cell));
    const Pose X{Mat3::Identity(), units::from_mm(1) * Vec3(n[0], n[1], n[2])};
    const auto q = quality::joints_at(c.machine, X);
    ASSERT_TRUE(q);
    const auto worst = *quality::worst_case(c.machine, X, *q, c.question.sizes);
    const auto d = kinematics::dexterity(c.machine, X, *q);
    EXPECT_NEAR(n[3], units::to_mm(worst.position), kRounding);
    EXPECT_NEAR(n[4], worst.orientation, kRounding);
    EXPECT_NEAR(n[5], d.condition, kRounding * d.condition);
    EXPECT_NEAR(n[6], d.sigma_min, kRounding);
    EXPECT_NEAR(n[7], d.determinant, kRounding);
    EXPECT_DOUBLE_EQ(n[3], n[8]);  // one direction: the mean is the worst
  }
}

TEST(QualityFiles, FieldIsBlankBeyond) {
  const Case c(*machine::load("hexapod-strut"), 10);
  const report::VtkImage image = *quality_image(c.fields);
  ASSERT_EQ(image.arrays.size(), 11U);
  ASSERT_EQ(image.arrays[0].name, "inside");
  double inside = 0;
  for (std::size_t i = 0; i < image.arrays[0].values.size(); ++i) {
    inside += image.arrays[0].values[i];
    EXPECT_EQ(image.arrays[0].values[i] == 0, std::isnan(image.arrays[1].values[i]));
  }
  EXPECT_EQ(inside, static_cast<double>(c.fields.survey.inside.size()));
  EXPECT_TRUE(report::to_vti(image));
}

TEST(QualityFiles, RegionsNest) {
  const Case c(*machine::load("hexapod-strut"), 0, 20);
  const auto volume = [&](double below) {
    return quality_surface(c.machine, c.options, c.fields, QualityValue::condition, below)->volume();
  };
  const double whole = volume(1e9);
  EXPECT_LT(volume(4), volume(5));
  EXPECT_LT(volume(5), whole);
  constexpr double kCells = 0.1;  // points counted as cells against a smooth border
  EXPECT_NEAR(whole / c.fields.survey.volume, 1, kCells);
  const auto none = quality_surface(c.machine, c.options, c.fields, QualityValue::condition, 1);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().id, "QP101");
  EXPECT_THAT(none.error().hint, HasSubstr("the least is"));
}

TEST(QualityFiles, SectionIsCutAtTheBorder) {
  const Case c(*machine::load("hexapod-strut"));
  const auto figure =
      quality_section(c.machine, c.options, c.question, 2, units::from_mm(75), 32, QualityValue::position);
  ASSERT_TRUE(figure);
  EXPECT_THAT((*figure)({}), HasSubstr("clip-rule=\"evenodd\""));
  const auto beyond = quality_section(c.machine, c.options, c.question, 2, 1.0, 32, QualityValue::position);
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().id, "QP100");
}

TEST(QualityPage, LeadsWithErrors) {
  const Case c(*machine::load("hexapod-strut"), 15);
  const std::string html = c.page();
  EXPECT_LT(html.find("mrad"), html.find("κ"));
  EXPECT_THAT(html, HasSubstr("polypod dexterity &lt;x&gt;"));
  EXPECT_THAT(html, HasSubstr("No pose that was looked at has a κ above 1000"));
  for (const char* never : {"nan ", "nan<", "http://", "https://", "<script src"})
    EXPECT_THAT(html, Not(HasSubstr(never)));
}

TEST(QualityPage, SameBytesForAnyNumberOfThreads) {
  Case one(*machine::load("hexapod-slider"), 0, 8), three = one;
  one.options.workspace.threads = 1;
  three.options.workspace.threads = 3;
  EXPECT_EQ(one.page(), three.page());
}

TEST(QualityPage, NamesSingularPoses) {
  const Case c(congruent());
  const std::string html = c.page();
  const auto count = c.fields.survey.inside.size();
  EXPECT_THAT(html, HasSubstr(fmt::format("{} of {} points have a tool direction", count, count)));
  EXPECT_THAT(html, HasSubstr("cannot be constrained (type 2"));
  EXPECT_THAT(html, Not(HasSubstr("nan ")));
}

TEST(QualityPage, SectionsMeetASplitWorkspace) {
  // Reachable above and below the base, not between: the mean of all points lies where nothing is reached.
  const AnyMachine split = *machine::from_text(R"(
family = "strut-hexapod"
base = { radius_mm = 50, pair_angle_deg = 40 }
platform = { radius_mm = 49, pair_angle_deg = 58 }
leg = { length_min_mm = 50, length_max_mm = 90 }
)",
                                               "split.toml", {});
  EXPECT_THAT(Case(split, 5).page(), HasSubstr("aria-label=\"Mean error of the tip over xy"));
}

TEST(QualityPage, KnownErrorsAndArms) {
  EXPECT_THAT(Case(*machine::load("hexapod-strut"), 0, 12, false).page(), HasSubstr("what each error would do alone"));
  EXPECT_THAT(Case(*machine::load("lola50"), 0, 10).page(), HasSubstr("dh.alpha"));
}

}  // namespace
}  // namespace polypod::pages
