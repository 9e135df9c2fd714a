// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/html.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "report/markup.hpp"
#include "report/sample.hpp"

namespace polypod::report {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(Report, IsOneFileThatAsksNothingFromOutside) {
  const std::string html = sample_report().to_html();
  for (const char* outside : {"http:", "https:", "src=", "@import", "url(\"", "url('", "<link", "fetch(", "XMLHttp"}) {
    EXPECT_THAT(html, Not(HasSubstr(outside)));
  }
  EXPECT_LT(html.size(), 400'000u) << "curves of 20 000 points are thinned out";
}

/// A page with a scene of one triangle, a line and a name that would end a script.
Report with_scene() {
  Scene scene;
  scene.title = "</script><script>alert(1)</script>";
  scene.kinds = {scene.title};
  scene.meshes = {{{{0, 0, 0}, {2, 0, 0}, {0, 2, 1}}, {{0, 1, 2}}, {}, 1}};
  scene.lines = {{scene.title, {{0, 0, 0}, {1, 1, 1}}}};
  Report report("t", "");
  report.add_scene(scene, "c");
  return report;
}

TEST(Report, APolicyLetsNothingInButTheScriptsOfThePage) {
  const std::string plain = sample_report().to_html(), turns = with_scene().to_html();
  for (const std::string& html : {plain, turns}) {
    const std::size_t at = html.find("http-equiv=\"Content-Security-Policy\"");
    ASSERT_NE(at, std::string::npos);
    EXPECT_LT(at, html.find("<style>")) << "it holds from where it stands";
    const std::string policy = html.substr(at, html.find('>', at) - at);
    EXPECT_THAT(policy, HasSubstr("default-src 'none'"));
    EXPECT_THAT(policy, HasSubstr("script-src 'sha256-"));
    for (const char* open : {"'unsafe-eval'", "script-src 'unsafe-inline'", "http", "*"}) {
      EXPECT_THAT(policy.substr(12), Not(HasSubstr(open)));
    }
  }
  EXPECT_THAT(plain, Not(HasSubstr("id=\"polypod-viewer"))) << "a page without a scene carries no viewer";
}

TEST(Report, AScenesNamesEndNoScript) {
  const std::string html = with_scene().to_html();
  EXPECT_EQ(what_is_wrong(html), "");
  EXPECT_THAT(html, Not(HasSubstr("<script>alert")));
  EXPECT_THAT(html, HasSubstr("<canvas data-scene="));
  EXPECT_THAT(html, HasSubstr("three.js authors")) << "the licence of what is bundled";
  EXPECT_LT(html.size(), 320'000u) << "300 kB of script at most";
}

TEST(Report, IsWellFormed) {
  EXPECT_EQ(what_is_wrong(sample_report().to_html()), "");
}

TEST(Report, TheCheckSeesWhatIsWrong) {
  EXPECT_EQ(what_is_wrong("<p>a<b>c</b></p>"), "");
  EXPECT_EQ(what_is_wrong("<p>a<b>c</p></b>"), "closes what is not open: /p");
  EXPECT_EQ(what_is_wrong("<p>"), "not closed: p");
  EXPECT_EQ(what_is_wrong("<p id=\"a\"></p><p id=\"a\"></p>"), "id twice: a");
  EXPECT_EQ(what_is_wrong("<a href=\"#b\"></a>"), "leads nowhere: #b");
}

TEST(Report, TheSameCallsGiveTheSameBytes) {
  EXPECT_EQ(sample_report().to_html(), sample_report().to_html());
}

TEST(Report, EverythingFromOutsideIsEscaped) {
  const std::string evil = "<script>alert('x')</script>\"&";
  Report report(evil, evil, {{evil, evil}});
  report.add_section(evil);
  report.add_section(evil);
  report.add_heading(evil);
  report.add_text(evil);
  report.add_verdict(Verdict::bad, evil);
  report.add_list({evil});
  report.add_key_figures({{evil, evil, evil}});
  report.add_definitions({{evil, evil}});
  report.add_table({evil, {{evil, evil}}, {{evil}}});
  report.add_table({evil, {{evil, evil}}, {{evil}}, true});
  report.add_code(evil, evil, true);
  report.add_code(evil, evil, false);
  LinePlot line;
  line.title = evil;
  line.x = line.y = {evil, evil, {}, {}};
  line.series = {{evil, {0, 1}, {0, 1}}};
  line.bands = {{evil, 0, 1}};
  line.levels = line.x_levels = {{evil, 0.5}};
  line.spans = {{evil, 0, 1}};
  PathPlot path;
  path.title = path.x_label = path.y_label = path.unit = path.note = evil;
  path.areas = {{evil, {{0, 0}, {1, 0}, {1, 1}}}};
  path.lines = {{evil, {{0, 0}, {1, 1}}}};
  path.arrows = {{evil, {0, 0}, {1, 0}}};
  path.markers = {{evil, {0, 0}}};
  HeatMap map;
  map.title = map.label = map.unit = evil;
  map.x = map.y = {evil, evil, {}, {}};
  map.columns = map.rows = 2;
  map.values = {1, 2, 3, 4};
  map.markers = {{evil, {0, 0}}};
  Histogram histogram;
  histogram.title = evil;
  histogram.x = {evil, evil, {}, {}};
  histogram.samples = {{evil, {1, 2}}};
  histogram.levels = {{evil, 1.5}};
  BarChart bars{evil, evil, {evil}, {{evil, {1}}}};
  PanelGrid grid{evil, 2, {{evil, map}, {evil, line}, {evil, path}}};
  for (const Figure& figure :
       {Figure(line), Figure(path), Figure(map), Figure(histogram), Figure(bars), Figure(grid)}) {
    report.add_figure(figure, evil);
    report.add_figure_grid(2, {{evil, figure}}, evil);
  }
  const std::string html = report.to_html();
  EXPECT_THAT(html, Not(HasSubstr("<script>alert")));
  EXPECT_THAT(html, Not(HasSubstr("\"<script")));
  EXPECT_EQ(what_is_wrong(html), "");
}

TEST(Report, AnEmptyReportIsAPage) {
  const std::string html = Report("t", "").to_html();
  EXPECT_EQ(what_is_wrong(html), "");
  EXPECT_THAT(html, HasSubstr("<title>t</title>"));
}

TEST(Report, NumbersInTablesAreSetToTheRightWithTheirDecimals) {
  Report report("t", "");
  report.add_table({"", {{"name", ""}, {"error", "um", 1}, {"any", ""}}, {{"a", -1.25, 1234567.0}, {"b", 2.0}}});
  const std::string html = report.to_html();
  EXPECT_THAT(html, HasSubstr("<th class=\"r\">error<small>um</small></th>"));
  EXPECT_THAT(html, HasSubstr("<td>a</td><td class=\"r\">\xE2\x88\x92"
                              "1.2</td><td class=\"r\">1.23e6</td>"));
  EXPECT_THAT(html, HasSubstr("<td>b</td><td class=\"r\">2.0</td><td class=\"r\"></td>")) << "a short row";
}

TEST(Report, PaperNarrowScreensAndDarkGroundHaveRules) {
  const std::string html = sample_report().to_html();
  EXPECT_THAT(html, HasSubstr("@media print"));
  EXPECT_THAT(html, HasSubstr("@media (max-width:640px)"));
  EXPECT_THAT(html, HasSubstr("prefers-color-scheme:dark"));
  EXPECT_THAT(html, HasSubstr("name=\"viewport\""));
}

}  // namespace
}  // namespace polypod::report
