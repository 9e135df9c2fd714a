// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The page of a machine: the same figures as the pages of its questions, and what has no answer is named.
#include "polypod/pages/machine_report.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/machine/any_machine.hpp"
#include "report/markup.hpp"

namespace polypod::pages {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

machine::AnyMachine loaded(const std::string& name) {
  auto found = machine::load(name, {});
  EXPECT_TRUE(found) << name;
  return *found;
}

MachineReportOptions small(const machine::AnyMachine& machine) {
  MachineReportOptions out;
  auto sizes = quality::sized(machine, {{"all", 0.01}}, true);
  EXPECT_TRUE(sizes);
  out.question.sizes = *sizes;
  out.given = {"all=0.01"};
  out.assumed = true;
  out.survey.resolution = 9;
  out.survey.workspace.relative_tolerance = 0.05;
  out.resolution = 12;
  return out;
}

/// The words of a section, without its pictures: their names count through the page.
std::string section(const std::string& html, const std::string& title) {
  const std::size_t from = html.find("<h2>" + title + "</h2>");
  EXPECT_NE(from, std::string::npos) << title;
  const std::string part = html.substr(from, html.find("</section>", from) - from);
  std::string out;
  for (std::size_t at = 0; at < part.size();) {
    if (part[at] != '<') {
      out += part[at++];
      continue;
    }
    const std::size_t end = part.compare(at, 4, "<svg") == 0 ? part.find("</svg>", at) + 5 : part.find('>', at);
    at = end + 1;
    out += ' ';
  }
  return out;
}

TEST(MachineReport, JoinsThePagesOfTheQuestions) {
  const machine::AnyMachine machine = loaded("hexapod-strut");
  const MachineReportOptions options = small(machine);
  const auto made = machine_report(machine, options);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(report::what_is_wrong(made->html), "");

  const auto volume = workspace::volume(machine, options.survey.workspace);
  WorkspacePageOptions of_workspace;
  of_workspace.resolution = options.resolution;
  const auto workspace = workspace_page(machine, options.survey.workspace, *volume, of_workspace);
  const auto fields = quality_fields(machine, options.survey, options.question);
  QualityPageOptions of_quality;
  of_quality.given = options.given;
  of_quality.assumed = true;
  const auto quality = quality_page(machine, options.survey, options.question, *fields, of_quality);
  for (const char* title : {"What is reached", "Which limit cuts how much"})
    EXPECT_EQ(section(made->html, title), section(*workspace, title)) << title;
  for (const char* title : {"Which parts make it", "Near singular"})
    EXPECT_EQ(section(made->html, title), section(*quality, title)) << title;
  // The inputs of all of them stand once.
  EXPECT_EQ(report::count_of(made->html, ">Inputs</h2>"), 1);
  EXPECT_EQ(report::count_of(made->html, "The machine&#39;s file") + report::count_of(made->html, "The machine's file"),
            1);
  // Each section is in the list of contents once.
  for (const char* title : {"The workspace in space", "Errors in space", "How well it could be calibrated"})
    EXPECT_EQ(report::count_of(made->html, std::string(">") + title + "</a>"), 1) << title;
}

TEST(MachineReport, NamesWhatIsNotJudgedAndWhatWouldHelp) {
  // No compliances.
  const machine::AnyMachine delta = loaded("delta-brno");
  const auto made = machine_report(delta, small(delta));
  ASSERT_TRUE(made) << made.error().message;
  ASSERT_EQ(made->parts.size(), 4);
  for (const ReportPart& part : made->parts) {
    if (part.name == "statics") {
      EXPECT_THAT(part.reason, HasSubstr("compliance"));
    } else {
      EXPECT_EQ(part.reason, "") << part.name;
    }
  }
  EXPECT_THAT(made->html, HasSubstr("Not judged, statics: "));
  EXPECT_THAT(made->html, Not(HasSubstr("Deflection per newton</h2>")));
}

TEST(MachineReport, OfAMachineThatIsSingularEverywhere) {
  // Platform and base alike: the drives never hold the platform (JEL 5.2).
  auto found = machine::load("hexapod-strut", {{"platform.radius_mm", "60"}, {"base.radius_mm", "60"}});
  ASSERT_TRUE(found);
  const auto made = machine_report(*found, small(*found));
  ASSERT_TRUE(made) << made.error().message;
  std::size_t named = 0;
  for (const ReportPart& part : made->parts) named += part.reason.empty() ? 0 : 1;
  EXPECT_EQ(report::count_of(made->html, "Not judged, "), static_cast<int>(named));
}

TEST(MachineReport, OfATaskWithoutPlaces) {
  const machine::AnyMachine planar = loaded("planar-3rrr");
  const auto made = machine_report(planar, small(planar));
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_THAT(made->html, HasSubstr("Of the coordinates x, y and C, a region of"));
  EXPECT_THAT(made->html, HasSubstr("How far the tool is off</h2>"));
}

// What the head of the page says is what the parts compute.
TEST(MachineReport, FiguresAreThoseOfTheParts) {
  const machine::AnyMachine machine = loaded("hexapod-strut");
  const MachineReportOptions options = small(machine);
  const auto made = machine_report(machine, options);
  ASSERT_TRUE(made) << made.error().message;
  const auto volume = workspace::volume(machine, options.survey.workspace);
  EXPECT_EQ(made->figures.volume, (std::array{volume->volume, volume->lower, volume->upper}));
  const auto fields = quality_fields(machine, options.survey, options.question);
  EXPECT_EQ(made->figures.error, quality::worst_seen(machine, fields->survey, options.survey, fields->errors.position,
                                                     fields->errors.anywhere, 0)
                                     .value);
  EXPECT_EQ(made->figures.condition, quality::worst_seen(machine, fields->survey, options.survey,
                                                         fields->dexterity.condition, fields->dexterity.anywhere, 0)
                                         .value);
  EXPECT_TRUE(std::isnan(made->figures.compliance)) << "it has none";
  EXPECT_GT(made->figures.calibrated, 1e-6);
  EXPECT_LT(made->figures.calibrated, options.noise_position);
}

// Options that no machine of this kind takes are refused, as `workspace` does, and a region that is not reached is
// said.
TEST(MachineReport, OptionsThatDoNotFitAndRegionsOutOfReach) {
  const machine::AnyMachine delta = loaded("delta-linear");
  MachineReportOptions options = small(delta);
  options.survey.workspace.directions.tilt = 0.1;
  EXPECT_EQ(machine_report(delta, options).error().id, "WS104");
  const machine::AnyMachine hexapod = loaded("hexapod-strut");
  options = small(hexapod);
  options.survey.workspace.directions.tilt = 1.2;
  const auto none = machine_report(hexapod, options);
  ASSERT_TRUE(none) << none.error().message;
  EXPECT_THAT(none->html, HasSubstr("workspace, proven: no point is reached as was asked"));
  EXPECT_EQ(none->figures.volume, (std::array{0.0, 0.0, 0.0})) << "proven, not unknown";
  EXPECT_TRUE(std::isnan(none->figures.error));
}

TEST(MachineReport, EndsWhenItIsInterrupted) {
  const machine::AnyMachine machine = loaded("hexapod-strut");
  MachineReportOptions options = small(machine);
  options.survey.workspace.cancelled = [] { return true; };
  const auto made = machine_report(machine, options);
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().id, "WS110");
}

TEST(MachineReport, TheSameInputGivesTheSameBytes) {
  const machine::AnyMachine machine = loaded("delta-linear");
  const auto a = machine_report(machine, small(machine)), b = machine_report(machine, small(machine));
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->html, b->html);
}

}  // namespace
}  // namespace polypod::pages
