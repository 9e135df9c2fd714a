// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Measured compliances beside computed ones, on SLAV's planes and on readings of machines whose truth is known.
#include "polypod/pages/measured_compliance.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <regex>
#include <sstream>

#include "paths.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/pages/calibration.hpp"
#include "polypod/pages/compliance_map.hpp"
#include "report/markup.hpp"

namespace polypod::pages {
namespace {

using statics::MeasuredPoint;
using statics::Plane;
using ::testing::HasSubstr;
using ::testing::Not;
using units::to_um_per_N;

constexpr double kSame = 1e-12;  // of numbers that are computed the same way twice

std::vector<MeasuredPoint> readings(const std::string& plane) {
  return *statics::read_displacements(test::source("tests/statics/data/displacements_plane_" + plane + ".csv"));
}
std::vector<MeasuredPoint> both() {
  std::vector<MeasuredPoint> out = readings("I");
  for (const MeasuredPoint& p : readings("V")) out.push_back(p);
  return out;
}
machine::AnyMachine lola() {
  return *machine::load("lola50");
}

/// Readings of the machine at the places of both planes, with normal noise (m).
std::vector<MeasuredPoint> readings_of(const machine::AnyMachine& m, double noise) {
  Random random(7);
  std::vector<MeasuredPoint> out = both();
  for (MeasuredPoint& p : out) {
    p.displacement = statics::compliance_at(m, p.X_MT).linear() * p.force;
    for (double& d : p.displacement.reshaped()) d += noise * random.normal();
  }
  return out;
}

/// SLAV's plane z_M = 0 at its 15 points, or a part of the plane at other ones.
ComplianceMap map_of(const std::vector<MeasuredPoint>& points, double at = 0,
                     const statics::Rectangle& rectangle = {{-0.6, 0.6}, {-1.6, -1}}, int columns = 5, int rows = 3) {
  ComplianceMap out{lola(), Plane::xy, at, rectangle, {0, 0}, {}, {}};
  out.map = statics::compliance_map(out.machine, statics::plane_grid(Plane::xy, at, rectangle, columns, rows),
                                    Mat3::Identity());
  auto measured = measured_over(out, points);
  EXPECT_TRUE(measured) << to_string(measured.error());
  out.measured = std::move(*measured);
  return out;
}

TEST(MeasuredPlane, IsTheFirstInWhichPointsSpanAnArea) {
  const auto points = both();
  const auto first = measured_plane(points);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->plane, Plane::xy);
  EXPECT_EQ(first->at, -0.4);
  EXPECT_EQ(first->points.size(), 15u);
  EXPECT_EQ(first->rectangle.u, (std::array{-0.6, 0.6}));
  EXPECT_EQ(first->rectangle.v, (std::array{-1.6, -1.0}));
  const MeasuredPlane other = measured_in(points, Plane::xy, 0);
  ASSERT_EQ(other.points.size(), 15u);
  EXPECT_EQ(other.points.front(), 15u);
  EXPECT_TRUE(measured_in(points, Plane::xy, -0.2).points.empty());

  auto upright = readings("V");
  for (MeasuredPoint& p : upright) p.X_MT.p = Vec3(p.X_MT.p.z() + 0.1, p.X_MT.p.x(), p.X_MT.p.y());
  const auto yz = measured_plane(upright);
  ASSERT_TRUE(yz);
  EXPECT_EQ(yz->plane, Plane::yz);
  EXPECT_EQ(yz->at, 0.1);
  EXPECT_EQ(yz->rectangle.v, (std::array{-1.6, -1.0}));
  EXPECT_FALSE(measured_plane({points[0], points[1], points[2]})) << "a line";
  EXPECT_FALSE(measured_plane({}));
}

TEST(MeasuredOver, HoldsTheNumbersOfMapAndMachine) {
  for (const auto& points : {readings("V"), both()}) {
    const ComplianceMap map = map_of(points);
    const MeasuredCompliance& m = *map.measured;
    const auto field = *statics::MeasuredMap::of(points);
    EXPECT_EQ(m.points, points.size());
    EXPECT_TRUE(m.in_plane);
    ASSERT_EQ(m.judged.size(), 15u) << "those of the plane";
    Mat3 square = Mat3::Zero();
    std::size_t index = 0;
    for (const MeasuredPoint& p : readings("V")) {
      const Mat3 difference = (p.displacement + p.displacement.transpose()) / (2 * p.force) -
                              statics::compliance_at(map.machine, p.X_MT).linear();
      EXPECT_LT((m.compared.difference[index++] - difference).norm(), kSame * difference.norm()) << "the sign, too";
      square += difference.cwiseAbs2() / 15;
    }
    EXPECT_LT((m.compared.rms - square.cwiseSqrt()).cwiseAbs().maxCoeff(), kSame * square.cwiseSqrt().maxCoeff());
    double all = 0, noise = 0;
    for (std::size_t e = 0; e < statics::kEntryPlaces.size(); ++e) {
      const auto [i, j] = statics::kEntryPlaces[e];
      EXPECT_EQ(m.compared.noise(i, j), field.noise()[e]);
      EXPECT_EQ(m.compared.noise(j, i), field.noise()[e]);
      all += square(i, j) / 6;
      noise += std::pow(field.noise()[e], 2) / 6;
      double most = 0;
      for (const Mat3& d : m.compared.difference) most = std::max(most, std::abs(d(i, j)));
      const std::size_t worst = m.compared.worst[std::size_t(j)][std::size_t(i)];
      EXPECT_EQ(std::abs(m.compared.difference[worst](i, j)), most);
    }
    EXPECT_NEAR(m.compared.rms_of_all, std::sqrt(all), kSame * std::sqrt(all));
    EXPECT_NEAR(m.compared.noise_of_all, std::sqrt(noise), kSame * std::sqrt(noise));
    Mat3 apart = Mat3::Zero(), deviation = Mat3::Zero();
    for (std::size_t k = 0; k < 15; ++k) {
      const Vec3& p = map.map.points[k].p_M;
      EXPECT_EQ(m.values[k], field.at(p));
      EXPECT_EQ(m.deviations[k], field.deviation(p));
      deviation += field.deviation(p) / 15;  // the grid's points are the measured ones
      for (int i = 0; i < 9; ++i) {
        const double d = field.at(p)(i) - map.map.points[k].compliance.linear()(i);
        apart(i) += std::abs(d) > 2 * field.deviation(p)(i) ? 1.0 / 15 : 0;
      }
    }
    EXPECT_LT((m.beyond - apart).cwiseAbs().maxCoeff(), kSame);
    EXPECT_LT((m.compared.deviation - deviation).cwiseAbs().maxCoeff(), kSame * deviation.maxCoeff());
  }
}

TEST(MeasuredOver, JudgesAllPointsBetweenPlanesAndIsBlankBesideThem) {
  const ComplianceMap between = map_of(both(), -0.2);
  EXPECT_FALSE(between.measured->in_plane);
  EXPECT_EQ(between.measured->judged.size(), 30u);
  EXPECT_TRUE(between.measured->values[7].allFinite());

  const ComplianceMap wide = map_of(readings("V"), 0, {{-1.2, 1.2}, {-1.6, -1}}, 5, 3);
  const auto fields = fields_of(wide);
  const auto field = [&](const std::string& key) {
    for (const Field& f : fields)
      if (f.key == key) return f;
    ADD_FAILURE() << key;
    return Field{};
  };
  EXPECT_TRUE(std::isnan(field("measured_C_zz_um_per_N").values[0]));
  EXPECT_TRUE(std::isnan(field("measured_C_zz_deviation_um_per_N").values[4]));
  EXPECT_TRUE(std::isfinite(field("measured_C_zz_um_per_N").values[1]));

  ComplianceMap beside = wide;
  beside.at = 0.3;
  beside.map = statics::compliance_map(beside.machine, statics::plane_grid(Plane::xy, 0.3, beside.rectangle, 3, 3),
                                       Mat3::Identity());
  const auto none = measured_over(beside, readings("V"));
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().id, "AP148");
  EXPECT_THAT(none.error().message, HasSubstr("z = 300.0 mm"));
}

TEST(MeasuredOver, APoseOutOfReachIsNamedByItsRow) {
  auto points = readings("V");
  ComplianceMap map = map_of(points);
  points[3].X_MT.p.x() = 5;
  const auto far = measured_over(map, points);
  ASSERT_FALSE(far);
  EXPECT_EQ(far.error().id, "ID111");
  EXPECT_EQ(far.error().place.line, points[3].place.line);
}

// Noise of 30 um under 250 N, as SLAV's: its own joints explain a machine's readings, those of one whose joint 1 gives
// way by half more do not.
TEST(MeasuredOver, TellsAWrongModelFromNoise) {
  const ComplianceMap right = map_of(readings_of(lola(), 30e-6));
  EXPECT_NEAR(right.measured->compared.rms_of_all / right.measured->compared.noise_of_all, 1, 0.3);
  // By chance the noise of C_xx is told too small by half: in all no more than noise, but no yes for that entry.
  EXPECT_FALSE(explained(*right.measured));
  EXPECT_THAT(measured_verdict(right, true), HasSubstr("all but C_xx, which is off by 2.0 times its noise, undecided"));
  EXPECT_THAT(measured_verdict(right, true), ::testing::Not(HasSubstr("more than noise")));
  std::vector<double> c = statics::column_compliances(lola());
  c[0] *= 1.5;
  const ComplianceMap wrong = map_of(readings_of(*statics::with_compliances(lola(), c), 30e-6));
  EXPECT_FALSE(explained(*wrong.measured));
  EXPECT_GT(wrong.measured->beyond(0, 0), 0.9) << "joint 1 moves the tip along x";
  EXPECT_THAT(measured_verdict(wrong, true), HasSubstr("more than noise; "));
  EXPECT_THAT(measured_verdict(wrong, true), HasSubstr("C_xx on 100 % of it"));
  EXPECT_THAT(measured_verdict(wrong, false), HasSubstr("Cxx on 100 % of it"));
}

TEST(MeasuredOver, ReadingsWithoutNoiseGiveNoRatio) {
  std::vector<double> c = statics::column_compliances(lola());
  c[0] *= 1.5;
  const ComplianceMap map = map_of(readings_of(*statics::with_compliances(lola(), c), 0));
  EXPECT_THAT(measured_verdict(map, true), HasSubstr("far above the noise of the readings: more than noise"));
}

TEST(MapCsv, HasMeasuredColumnsAtItsEnd) {
  const ComplianceMap map = map_of(readings("V"));
  std::istringstream lines(map_csv(map));
  std::string head, line;
  std::getline(lines, head);
  EXPECT_THAT(head, HasSubstr(",joint_5_C_yz_um_per_N,measured_C_xx_um_per_N,measured_C_yy_um_per_N,"));
  EXPECT_THAT(head, HasSubstr(",measured_C_yz_um_per_N,measured_C_xx_deviation_um_per_N,"));
  for (int i = 0; i < 8; ++i) std::getline(lines, line);  // the middle, (0, -1300, 0) mm
  std::vector<std::string> cells;
  std::istringstream row(line);
  for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
  ASSERT_EQ(cells.size(), 4u + 6 + 1 + 30 + 12);
  const auto field = *statics::MeasuredMap::of(readings("V"));
  const Vec3 p(0, -1.3, 0);
  constexpr std::pair<int, int> kOrder[] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};
  for (std::size_t e = 0; e < 6; ++e) {
    const auto [i, j] = kOrder[e];
    EXPECT_NEAR(std::stod(cells[41 + e]), to_um_per_N(field.at(p)(i, j)), 1e-9);
    EXPECT_NEAR(std::stod(cells[47 + e]), to_um_per_N(field.deviation(p)(i, j)), 1e-9);
  }
  const auto vti = map_vti(map);
  ASSERT_TRUE(vti);
  EXPECT_THAT(*vti, HasSubstr("\"measured_C_xx_um_per_N\""));
  EXPECT_THAT(*vti, HasSubstr("\"measured_C_yz_deviation_um_per_N\""));
}

/// The colours of the bar of each panel, in the order of the page.
std::vector<std::string> bars_of(const std::string& html) {
  std::vector<std::string> out;
  const std::regex bar("<rect [^>]*width=\"14\"[^>]*height=\"([^\"]*)\"[^>]*fill=\"(#[0-9a-f]{6})\"");
  for (std::size_t at = html.find("<svg class=\"pp\""); at != std::string::npos;) {
    const std::size_t next = html.find("<svg class=\"pp\"", at + 1);
    const std::string svg = html.substr(at, next == std::string::npos ? next : next - at);
    std::string colours;
    for (auto it = std::sregex_iterator(svg.begin(), svg.end(), bar); it != std::sregex_iterator(); ++it)
      colours += (*it)[1].str() + (*it)[2].str() + " ";
    out.push_back(colours);
    at = next;
  }
  return out;
}

TEST(MapPage, ShowsMeasuredComputedAndDifferenceSideBySide) {
  const ComplianceMap map = map_of(readings("V"));
  const std::string html = compliance_map_page(map);
  EXPECT_EQ(report::what_is_wrong(html), "");
  EXPECT_EQ(html, compliance_map_page(map));
  const std::string words = html.substr(0, html.find("<script>"));
  for (const char* bad : {" nan", ">nan", "n/a"}) EXPECT_THAT(words, Not(HasSubstr(bad)));
  EXPECT_THAT(html, HasSubstr(report::escape(measured_verdict(map, false))));
  EXPECT_THAT(html, HasSubstr("<dd>displacements_plane_V.csv</dd>"));
  std::size_t at = 0;
  for (const char* part :
       {"Deflection per newton</h2>", "The joints explain", "Measured against computed</h2>", ">Cxx measured<",
        ">Cxx computed<", ">Cxx measured − computed<", ">Cyz measured − computed<", "Direct compliances</h2>",
        "The determinant of the Jacobian</h2>", "Contribution of each joint"}) {
    const std::size_t found = html.find(part, at);
    ASSERT_NE(found, std::string::npos) << part;
    at = found;
  }
  const statics::Compared& c = map.measured->compared;
  for (const auto& [i, j] : statics::kEntryPlaces) {
    const double rms = to_um_per_N(c.rms(i, j)), noise = to_um_per_N(c.noise(i, j));
    EXPECT_THAT(html, HasSubstr(fmt::format("<td>C{}{}</td><td class=\"r\">{}</td>", "xyz"[std::min(i, j)],
                                            "xyz"[std::max(i, j)], report::number(rms))));
    EXPECT_THAT(html, HasSubstr(fmt::format("<td class=\"r\">{}</td><td class=\"r\">{}</td><td class=\"r\">{}</td>",
                                            report::number(noise), report::fixed(rms / noise, 1),
                                            report::number(to_um_per_N(c.deviation(i, j))))));
  }
  // Panels in threes: measured and computed in one scale, the difference in that of all differences.
  const auto bars = bars_of(html);
  ASSERT_GE(bars.size(), 18u);
  for (std::size_t row = 0; row < 6; ++row) {
    EXPECT_FALSE(bars[3 * row].empty());
    EXPECT_EQ(bars[3 * row], bars[3 * row + 1]) << row;
    EXPECT_NE(bars[3 * row], bars[3 * row + 2]) << row;
  }
  EXPECT_EQ(bars[2], bars[5]);
  EXPECT_NE(bars[0], bars[3]) << "Cxx and Cyy have scales of their own";
}

// Readings of a machine half as soft: the scale of both maps must reach the computed values, too.
TEST(MapPage, TheScaleHoldsMeasuredAndComputed) {
  std::vector<double> c = statics::column_compliances(lola());
  for (double& x : c) x /= 2;
  const std::string html = compliance_map_page(map_of(readings_of(*statics::with_compliances(lola(), c), 0)));
  const std::size_t from = html.find("<svg class=\"pp\"");
  const std::string panel = html.substr(from, html.find("</svg>", from) - from);
  const std::regex tick("class=\"n\" font-size=\"11\">([0-9.]+)<");
  double low = 1e9, high = 0;
  for (auto it = std::sregex_iterator(panel.begin(), panel.end(), tick); it != std::sregex_iterator(); ++it) {
    low = std::min(low, std::stod((*it)[1]));
    high = std::max(high, std::stod((*it)[1]));
  }
  EXPECT_LT(low, 1.2) << "least measured C_xx is 0.64";
  EXPECT_GT(high, 2.2) << "greatest computed C_xx is 2.96";
}

TEST(MapPicture, HasMeasuredPanels) {
  const std::string svg = report::standalone_svg(map_picture(map_of(both())), 1200);
  EXPECT_EQ(report::what_is_wrong(svg), "");
  for (const char* name : {">Cxx measured<", ">Cyz computed<", ">Czz measured − computed<", ">|det J|<"})
    EXPECT_THAT(svg, HasSubstr(name));
}

TEST(IdentificationPage, ShowsThePlaneOfEachFile) {
  const auto points = both();
  const auto r = statics::identify_compliance(lola(), points);
  ASSERT_TRUE(r);
  std::vector<double> doubled = statics::column_compliances(lola());
  for (double& x : doubled) x *= 2;
  const auto given = *statics::with_compliances(lola(), doubled);
  const std::string html = identification_page(given, points, *r, {});
  EXPECT_EQ(report::what_is_wrong(html), "");
  EXPECT_THAT(html, HasSubstr("displacements_plane_I.csv: z = −400 mm</h3>"));
  EXPECT_THAT(html, HasSubstr("displacements_plane_V.csv: z = 0 mm</h3>"));
  EXPECT_THAT(html, Not(HasSubstr(">Cxy measured<"))) << "direct ones only";
  // With the compliances that were found, not those of the given machine.
  const auto found = *statics::with_compliances(lola(), r->compliance);
  const auto compared = *statics::compare(found, *statics::MeasuredMap::of(points), readings("I"));
  EXPECT_THAT(html, HasSubstr("<td>Cxx</td><td class=\"r\">" + report::number(to_um_per_N(compared.rms(0, 0)))));

  auto scattered = points;
  for (MeasuredPoint& p : scattered) p.place.file = "all.csv";
  EXPECT_THAT(identification_page(lola(), scattered, *statics::identify_compliance(lola(), scattered), {}),
              Not(HasSubstr("Measured and computed maps")));
  // The tool turned in one file: each file is a map of its own.
  auto turned = points;
  for (std::size_t i = 0; i < 15; ++i) turned[i].X_MT.R = rotation_x(units::from_deg(-4));
  const auto of_turned = statics::identify_compliance(lola(), turned);
  ASSERT_TRUE(of_turned) << to_string(of_turned.error());
  const std::string apart = identification_page(lola(), turned, *of_turned, {});
  EXPECT_THAT(apart, HasSubstr("displacements_plane_I.csv: z = −400 mm</h3>"));
  EXPECT_THAT(apart, HasSubstr("displacements_plane_V.csv: z = 0 mm</h3>"));
}

}  // namespace
}  // namespace polypod::pages
