// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Files and the page of a survey against the poses themselves.
#include "polypod/pages/quality.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <regex>
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
  [[nodiscard]] std::string page(int resolution_of_pictures = 0) const {
    QualityPageOptions how;
    if (resolution_of_pictures > 0) how.resolution = how.resolution_in_space = resolution_of_pictures;
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

/// Over the directions of a point, pose by pose: what a row of the files stands for. In their units, in their order.
struct AtAPoint {
  std::array<double, 5> mean{}, worst{};
};
AtAPoint pose_by_pose(const Case& c, std::size_t point) {
  AtAPoint out;
  const auto count = static_cast<int>(c.fields.survey.orientations.size());
  for (int d = 0; d < count; ++d) {
    const Pose X = quality::pose_at(c.fields.survey, point, d);
    const auto q = quality::joints_at(c.machine, X);
    if (!q) {
      ADD_FAILURE() << "a point inside has joints for every direction";
      return out;
    }
    const auto error = *quality::worst_case(c.machine, X, *q, c.question.sizes);
    const auto dexterity = kinematics::dexterity(c.machine, X, *q);
    const std::array<double, 5> values{units::to_mm(error.position), error.orientation, dexterity.condition,
                                       dexterity.sigma_min, std::abs(dexterity.determinant)};
    for (std::size_t k = 0; k < values.size(); ++k) {
      const bool large_is_bad = k < 3;
      out.mean[k] += values[k] / count;
      out.worst[k] = d == 0         ? values[k]
                     : large_is_bad ? std::max(out.worst[k], values[k])
                                    : std::min(out.worst[k], values[k]);
    }
  }
  return out;
}

TEST(QualityFiles, MeanAndWorstAreThoseOfTheDirections) {
  const Case c(*machine::load("hexapod-strut"), 15);
  ASSERT_GT(c.fields.survey.orientations.size(), 1U);
  const auto rows = cells(quality_csv(c.fields));
  ASSERT_EQ(rows.size(), c.fields.survey.inside.size() + 1);
  const std::vector<std::string> names{
      "position_mm",       "orientation_rad",       "condition",       "sigma_min",       "determinant",
      "position_worst_mm", "orientation_worst_rad", "condition_worst", "sigma_min_worst", "determinant_worst"};
  ASSERT_EQ(std::vector<std::string>(rows[0].begin() + 3, rows[0].end()), names);
  const report::VtkImage image = *quality_image(c.fields);
  const auto in_image = [&](const std::string& name, std::size_t point) {
    for (const report::VtkArray& array : image.arrays)
      if (array.name == name) return array.values[c.fields.survey.inside[point]];
    ADD_FAILURE() << "no array " << name;
    return 0.0;
  };
  constexpr double kRounding = 1e-8;  // relative; another order of sums
  for (const std::size_t point : {std::size_t{0}, rows.size() / 2, rows.size() - 2}) {
    const AtAPoint own = pose_by_pose(c, point);
    for (std::size_t k = 0; k < 5; ++k) {
      EXPECT_GT(std::abs(own.worst[k] - own.mean[k]), 1e-3 * own.mean[k]) << names[k] << ": the two must be told apart";
      EXPECT_NEAR(std::stod(rows[point + 1][3 + k]), own.mean[k], kRounding * own.mean[k]) << names[k];
      EXPECT_NEAR(std::stod(rows[point + 1][8 + k]), own.worst[k], kRounding * own.mean[k]) << names[5 + k];
      EXPECT_NEAR(in_image(names[k], point), own.mean[k], kRounding * own.mean[k]) << names[k];
      EXPECT_NEAR(in_image(names[5 + k], point), own.worst[k], kRounding * own.mean[k]) << names[5 + k];
    }
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

/// The numbers that stand in a page where `pattern` has its groups.
std::vector<double> read_off(const std::string& html, const std::string& pattern) {
  std::smatch match;
  if (!std::regex_search(html, match, std::regex(pattern))) return {};
  std::vector<double> out;
  for (std::size_t k = 1; k < match.size(); ++k) out.push_back(std::stod(match[k]));
  return out;
}

TEST(QualityPage, SaysWhatTheSurveyHas) {
  constexpr double kShown = 6e-3;   // three digits are printed
  constexpr double kBetween = 1.5;  // how much more is seen between so few points than at them
  const auto greatest = [](const std::vector<double>& v) { return *std::max_element(v.begin(), v.end()); };
  for (const bool tolerances : {true, false}) {
    const Case c(*machine::load("hexapod-strut"), 10, 8, tolerances);
    const quality::ErrorField& errors = c.fields.errors;
    const quality::DexterityField& dexterity = c.fields.dexterity;
    const std::string html = c.page(8);
    const auto said =
        read_off(html, tolerances ? "whatever the parts do within all=0.01, is ([0-9.]+) mm, and the largest "
                                    "of the orientation ([0-9.]+) mrad: [^<]* the worst case is ([0-9.]+) mm "
                                    "and ([0-9.]+) mrad on average"
                                  : "the largest error of the tip that was seen is ([0-9.]+) mm and that of "
                                    "the orientation ([0-9.]+) mrad; on average over the workspace ([0-9.]+) "
                                    "mm and ([0-9.]+) mrad");
    ASSERT_EQ(said.size(), 4U);
    struct Value {
      const char* words;
      const quality::Quantity& of;
      double scale;
    };
    const std::array<Value, 5> values{{{"error of the tip, mm", errors.position, units::kMmPerMetre},
                                       {"error of the orientation, mrad", errors.orientation, units::kMradPerRad},
                                       {"condition number κ", dexterity.condition, 1},
                                       {"smallest singular value", dexterity.sigma_min, 1},
                                       {"determinant", dexterity.determinant, 1}}};
    for (std::size_t k = 0; k < values.size(); ++k) {
      const Value& v = values[k];
      const quality::Statistics own = quality::statistics(c.fields.survey, v.of.mean);
      const double mean = v.scale * own.mean;
      if (k < 2) {
        EXPECT_NEAR(said[2 + k], mean, kShown * mean) << v.words;
        const double worst = v.scale * greatest(v.of.worst);
        EXPECT_GT(said[k], (1 - kShown) * worst) << v.words;
        EXPECT_LT(said[k], kBetween * worst) << v.words;
      }
      // Least seen, mean, largest seen, standard deviation.
      const auto row =
          read_off(html, std::string("<td>") + v.words +
                             "</td><td>([0-9.]+)</td><td>([0-9.]+)</td><td>([0-9.]+)</td><td>([0-9.]+)</td>");
      ASSERT_EQ(row.size(), 4U) << v.words;
      EXPECT_LT(row[0], (1 + kShown) * v.scale * own.min) << v.words;
      EXPECT_GT(row[0], v.scale * own.min / kBetween) << v.words;
      EXPECT_NEAR(row[1], mean, kShown * mean) << v.words;
      EXPECT_GT(row[2], (1 - kShown) * v.scale * own.max) << v.words;
      EXPECT_LT(row[2], kBetween * v.scale * own.max) << v.words;
      EXPECT_NEAR(row[3], v.scale * own.stddev, kShown * v.scale * own.stddev) << v.words;
    }
  }
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
