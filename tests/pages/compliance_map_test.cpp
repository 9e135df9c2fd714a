// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/compliance_map.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <sstream>

#include "report/markup.hpp"

namespace polypod::pages {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

ComplianceMap map_of(const std::string& machine, const statics::Rectangle& rectangle, double at, int columns, int rows,
                     const std::vector<machine::Override>& overrides = {}, statics::Plane plane = statics::Plane::xy) {
  ComplianceMap out{*machine::load(machine, overrides), plane, at, rectangle, {0, 0}, {}, {}};
  out.map =
      statics::compliance_map(out.machine, statics::plane_grid(plane, at, rectangle, columns, rows), Mat3::Identity());
  return out;
}

/// SLAV's plane z_M = 0 at its 15 points.
ComplianceMap lola() {
  return map_of("lola50", {{-0.6, 0.6}, {-1.6, -1}}, 0, 5, 3);
}
/// The same wider: its corners are out of reach.
ComplianceMap wide() {
  return map_of("lola50", {{-2, 2}, {-2, 0}}, 0, 9, 5);
}
ComplianceMap with_path(ComplianceMap map) {
  LoadedPath path{Vec3(-0.6, -1.3, 0), Vec3(0.6, -1.3, 0), Vec3(0, 100, 0), {}};
  path.points = statics::path_error(map.machine, path.from_M, path.to_M, 5, Mat3::Identity(), path.force_M);
  map.paths = {path};
  return map;
}

std::vector<std::vector<std::string>> rows_of(const std::string& csv) {
  std::vector<std::vector<std::string>> rows;
  std::istringstream lines(csv);
  for (std::string line; std::getline(lines, line);) {
    std::vector<std::string> row;
    std::size_t start = 0;
    for (std::size_t comma; (comma = line.find(',', start)) != std::string::npos; start = comma + 1) {
      row.push_back(line.substr(start, comma - start));
    }
    row.push_back(line.substr(start));
    rows.push_back(row);
  }
  return rows;
}

const Field& field_named(const std::vector<Field>& fields, const std::string& key) {
  for (const Field& f : fields)
    if (f.key == key) return f;
  throw std::runtime_error("no field " + key);
}

TEST(ComplianceMap, FieldsAreSlavsEquation4_43InMicrometres) {
  const auto fields = fields_of(lola());
  constexpr std::size_t kMiddle = 7;
  constexpr double kPrinted = 6e-4;  // half a digit, and the lengths' third digit
  const std::map<std::string, double> printed{{"C_xx_um_per_N", 1.924}, {"C_yy_um_per_N", 2.570},
                                              {"C_zz_um_per_N", 3.438}, {"C_xy_um_per_N", 0},
                                              {"C_xz_um_per_N", 0},     {"C_yz_um_per_N", -1.216}};
  for (const auto& [key, value] : printed)
    EXPECT_NEAR(field_named(fields, key).values[kMiddle], value, kPrinted) << key;
  // A zero by symmetry is a zero, not rounding noise.
  EXPECT_EQ(field_named(fields, "C_xy_um_per_N").values[kMiddle], 0);
  for (const Field& whole : fields) {
    if (whole.kind != Field::Kind::direct && whole.kind != Field::Kind::cross) continue;
    for (std::size_t i = 0; i < whole.values.size(); ++i) {
      double sum = 0;
      for (int joint = 1; joint <= 5; ++joint) {
        sum += field_named(fields, "joint_" + std::to_string(joint) + "_" + whole.key).values[i];
      }
      EXPECT_NEAR(sum, whole.values[i], 1e-9) << whole.key << " is the sum of its joints";
    }
  }
}

TEST(ComplianceMap, TheDeterminantHasTheUnitOfItsJoints) {
  EXPECT_EQ(field_named(fields_of(lola()), "det_J_m3").unit, "m^3");
  const auto hexapod = map_of("hexapod-strut", {{-0.01, 0.01}, {-0.01, 0.01}}, 0.075, 3, 3);
  const auto fields = fields_of(hexapod);
  ASSERT_EQ(fields.size(), 1u) << "without compliances the determinant is all";
  EXPECT_EQ(fields[0].key, "det_J_per_m3");
  const auto soft =
      map_of("hexapod-strut", {{-0.01, 0.01}, {-0.01, 0.01}}, 0.075, 3, 3, {{"leg.compliance_um_per_N", "0.05"}});
  EXPECT_EQ(fields_of(soft).size(), 6 + 1 + 6 * 6);
  EXPECT_EQ(field_named(fields_of(soft), "leg_6_C_zz_um_per_N").joint, "leg 6");
}

TEST(Extremes, NameTheFirstOfEqualsAndSkipWhatIsNotThere) {
  const double none = std::numeric_limits<double>::quiet_NaN();
  const Extremes e = extremes_of({none, 3, 1, 2, 3 * (1 + 1e-12), 1 * (1 - 1e-12)});
  EXPECT_EQ(e.min_at, 2);
  EXPECT_EQ(e.max_at, 1);
  EXPECT_NEAR(e.mean, 2, 1e-9);
  EXPECT_EQ(extremes_of({none}).min_at, -1);
  EXPECT_EQ(extremes_of({}).min_at, -1);
  EXPECT_EQ(extremes_of({1, -1, 1e-17}).mean, 0);
}

TEST(MapCsv, HasUnitsInItsColumnsAndBlanksOutOfReach) {
  const auto rows = rows_of(map_csv(wide()));
  ASSERT_EQ(rows.size(), 1u + 9 * 5);
  ASSERT_EQ(rows[0].size(), 4u + 6 + 1 + 5 * 6);
  EXPECT_THAT(std::vector<std::string>(rows[0].begin(), rows[0].begin() + 12),
              ElementsAre("x_mm", "y_mm", "z_mm", "reachable", "C_xx_um_per_N", "C_yy_um_per_N", "C_zz_um_per_N",
                          "C_xy_um_per_N", "C_xz_um_per_N", "C_yz_um_per_N", "det_J_m3", "joint_1_C_xx_um_per_N"));
  EXPECT_EQ(rows[0].back(), "joint_5_C_yz_um_per_N");
  EXPECT_THAT(std::vector<std::string>(rows[2].begin(), rows[2].begin() + 4), ElementsAre("-1500", "-2000", "0", "0"));
  int blank = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    ASSERT_EQ(rows[i].size(), rows[0].size());
    const bool reachable = rows[i][3] == "1";
    for (std::size_t k = 4; k < rows[i].size(); ++k) EXPECT_EQ(rows[i][k].empty(), !reachable);
    blank += reachable ? 0 : 1;
  }
  EXPECT_EQ(blank, 45 - reached(wide().map));
  EXPECT_GT(blank, 9);
}

TEST(PathCsv, IsTheDisplacementOfEquation4_43) {
  const auto rows = rows_of(path_csv(with_path(lola())));
  ASSERT_EQ(rows.size(), 6u);
  EXPECT_THAT(std::vector<std::string>(rows[0].begin(), rows[0].begin() + 9),
              ElementsAre("path", "s_mm", "x_mm", "y_mm", "z_mm", "dx_um", "dy_um", "dz_um", "joint_1_dx_um"));
  ASSERT_EQ(rows[0].size(), 8u + 15);
  const auto& middle = rows[3];
  EXPECT_EQ(middle[1], "600");
  EXPECT_EQ(middle[2], "0");
  EXPECT_EQ(middle[5], "0");
  EXPECT_NEAR(std::stod(middle[6]), 257, 0.5);   // 0.000257 m
  EXPECT_NEAR(std::stod(middle[7]), -122, 0.5);  // -0.000122 m
}

/// The bytes of the base64 of a DataArray, as doubles.
std::vector<double> array_of(const std::string& vti, const std::string& name) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::size_t at = vti.find("Name=\"" + name + "\"");
  if (at == std::string::npos) return {};
  at = vti.find(">\n", at) + 2;
  std::string bytes;
  unsigned bits = 0;
  int count = 0;
  for (; vti[at] != '\n' && vti[at] != '='; ++at) {
    bits = bits << 6 | static_cast<unsigned>(digits.find(vti[at]));
    count += 6;
    if (count >= 8) bytes += static_cast<char>(bits >> (count -= 8) & 0xFF);
  }
  std::vector<double> out((bytes.size() - 8) / 8);
  std::memcpy(out.data(), bytes.data() + 8, 8 * out.size());
  return out;
}

TEST(MapVti, LiesInItsPlaneInMillimetres) {
  const auto vti = map_vti(lola());
  ASSERT_TRUE(vti);
  EXPECT_THAT(*vti, HasSubstr("WholeExtent=\"0 4 0 2 0 0\" Origin=\"-600 -1600 0\" Spacing=\"300 300 1\""));
  const auto C_yy = array_of(*vti, "C_yy_um_per_N");
  ASSERT_EQ(C_yy.size(), 15u);
  EXPECT_NEAR(C_yy[7], 2.570, 6e-4);
  const auto tensor = array_of(*vti, "compliance_um_per_N");
  ASSERT_EQ(tensor.size(), 15u * 9);
  EXPECT_NEAR(tensor[7 * 9 + 5], -1.216, 6e-4);
  const auto blank = map_vti(wide());
  ASSERT_TRUE(blank);
  EXPECT_TRUE(std::isnan(array_of(*blank, "det_J_m3")[0]));
  const auto upright = map_vti(map_of("lola50", {{-1.6, -1}, {-0.4, 0.1}}, 0.3, 4, 3, {}, statics::Plane::yz));
  ASSERT_TRUE(upright);
  EXPECT_THAT(*upright, HasSubstr("WholeExtent=\"0 0 0 3 0 2\" Origin=\"300 -1600 -400\" Spacing=\"1 200 250\""));
}

TEST(MapPicture, DirectCompliancesShareOneScale) {
  const std::string svg = report::standalone_svg(map_picture(lola()), 1200);
  EXPECT_EQ(report::what_is_wrong(svg), "");
  for (const char* name : {">Cxx, direct", ">Czz, direct", ">Cyz, cross", ">|det J|"})
    EXPECT_THAT(svg, HasSubstr(name));
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
}

TEST(MapPage, IsOnePageWithEveryPart) {
  const std::string html = compliance_map_page(with_path(wide()), {"1.2.3", "polypod map lola50 -o 'a<b>.html'"});
  EXPECT_EQ(report::what_is_wrong(html), "");
  for (const char* part : {"Direct compliances", "Cross compliances", "|det J|", "Cyy by joint", "joint 5",
                           "Error along a straight path", "Polypod 1.2.3", "a&lt;b&gt;.html", "are blank"}) {
    EXPECT_THAT(html, HasSubstr(part));
  }
  for (const char* bad : {" nan", ">nan", "http:", "https:", "src="}) EXPECT_THAT(html, Not(HasSubstr(bad)));
  EXPECT_THAT(html.substr(0, html.find("<script>")), Not(HasSubstr("n/a")));
  EXPECT_EQ(html, compliance_map_page(with_path(wide()), {"1.2.3", "polypod map lola50 -o 'a<b>.html'"}));
}

TEST(MapPage, AMachineWithoutCompliancesHasItsDeterminant) {
  const std::string html =
      compliance_map_page(map_of("hexapod-strut", {{-0.01, 0.01}, {-0.01, 0.01}}, 0.075, 3, 3), {});
  EXPECT_EQ(report::what_is_wrong(html), "");
  EXPECT_THAT(html, HasSubstr("leg.compliance_um_per_N"));
  EXPECT_THAT(html, HasSubstr("|det J|"));
  EXPECT_THAT(html, Not(HasSubstr("Direct compliances")));
}

/// A and B of the tripod at z = 900 mm; the last column is out of reach.
ComplianceMap tilts() {
  ComplianceMap out{*machine::load("tripod-z3"), *statics::plane_named("AB"), 0, {}, {}, {}, {}};
  out.coordinates = statics::middle_coordinates(out.machine);
  out.rectangle = {{0, units::from_deg(90)}, {0, units::from_deg(20)}};
  out.map = statics::compliance_map(out.machine, {out.plane, out.coordinates}, out.rectangle, 4, 3);
  return out;
}

TEST(TiltMap, SaysOverWhatItGoesInDegrees) {
  const ComplianceMap map = tilts();
  EXPECT_EQ(domain_of(map), "A and B at z = 900 mm");
  EXPECT_EQ(orientation_of(map), "");
  EXPECT_THAT(coordinates_at(map, 6), ElementsAre(60, 10));
  const auto rows = rows_of(map_csv(map));
  ASSERT_THAT(rows[0], ::testing::SizeIs(::testing::Gt(6u)));
  EXPECT_EQ(rows[0][0], "A_deg");
  EXPECT_EQ(rows[0][1], "B_deg");
  EXPECT_EQ(rows[0][2], "x_mm");
  EXPECT_EQ(rows[0][5], "reachable");
  EXPECT_EQ(rows[2][0], "30");
  EXPECT_EQ(rows[2][4], "900");
  EXPECT_NE(std::stod(rows[6][2]), 0) << "x follows";
  EXPECT_EQ(rows[4][5], "0");
  EXPECT_EQ(rows[4][2], "") << "x is not known where the machine does not stand";
  const auto vti = map_vti(map);
  ASSERT_TRUE(vti);
  EXPECT_THAT(*vti, HasSubstr("Spacing=\"30 10 1\""));
  const std::string page = compliance_map_page(map);
  EXPECT_THAT(page, HasSubstr("A and B at z = 900 mm"));
  EXPECT_THAT(page, HasSubstr("x, y, C are as the machine settles"));
  EXPECT_THAT(page, HasSubstr("m⁻²"));
}

TEST(TiltMap, BothSignsOfTheDeterminantAreSaid) {
  EXPECT_FALSE(both_signs(lola()));
  ComplianceMap map = tilts();
  map.rectangle = {{units::from_deg(-80), units::from_deg(80)}, {units::from_deg(-60), units::from_deg(80)}};
  map.map = statics::compliance_map(map.machine, {map.plane, map.coordinates}, map.rectangle, 9, 9);
  EXPECT_TRUE(both_signs(map));
  EXPECT_THAT(compliance_map_page(map), HasSubstr(kBothSigns));
}

}  // namespace
}  // namespace polypod::pages
