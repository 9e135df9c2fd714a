// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// JEL 8.2 and 8.3: errors, tolerances and kinematic quality of both hexapods against the printed tables. All numbers
// are means over 49 directions within 20 deg at each point of a grid. Lengths are mm.
#include "jelenkovic.hpp"

#include <functional>

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/survey.hpp"

namespace polypod::quality {
namespace {

using jelenkovic::Overrides;

constexpr const char* kStrut = "hexapod-strut";
constexpr const char* kSlider = "hexapod-slider";
const Overrides kRails15{{"platform.radius_mm", "15"}};  // what the source's rail tables start from

struct Surveyed {
  AnyMachine machine;
  SurveyOptions options;
  Survey survey;
};
Surveyed surveyed(const AnyMachine& machine, int resolution) {
  SurveyOptions options;
  options.workspace.directions.tilt = units::from_deg(20);
  options.resolution = resolution;
  auto found = survey(machine, options);
  EXPECT_TRUE(found) << to_string(found.error());
  return {machine, options, *found};
}

Overrides joined(Overrides a, const Overrides& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}
AnyMachine strut(const Overrides& overrides, bool moved) {
  return jelenkovic::machine_of(kStrut, joined(overrides, jelenkovic::strut_home(overrides, moved)));
}

/// "20-60" as the range of the struts.
Overrides keyed(const std::vector<std::string>& keys, const jelenkovic::Row& row) {
  Overrides out;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const std::size_t dash = row.keys[i].find('-');
    if (dash == std::string::npos || dash == 0) {
      out.push_back({keys[i], row.keys[i]});
    } else {
      out.push_back({"leg.length_min_mm", row.keys[i].substr(0, dash)});
      out.push_back({"leg.length_max_mm", row.keys[i].substr(dash + 1)});
    }
  }
  return out;
}

// Kinematic quality ---------------------------------------------------------------------------------------------------

/// A mean is the source's to 4 % for struts and 8 % for rails; an extreme of the grid to 10 %, because the source's
/// grid is finer (100 points) and meets the rim elsewhere. `largest` of |det| lies at the rim, where a grid sees it
/// last.
struct Within {
  double mean, extreme;
};
constexpr Within kStruts{0.04, 0.10}, kRails{0.08, 0.10};

DexterityField dexterity_of(const AnyMachine& m, Surveyed& s, int resolution = 22) {
  s = surveyed(m, resolution);
  auto field = dexterity_field(m, s.survey, s.options);
  EXPECT_TRUE(field);
  return *field;
}

struct Rows {
  std::string number;
  std::string machine;
  Overrides fixed;
  std::vector<std::string> keys;
  bool moved = false;
  Within within;
  int resolution = 22;
  /// Rows whose means are made of a few poses near singular ones, in the source or here.
  std::function<bool(const jelenkovic::Row&)> singular = [](const jelenkovic::Row&) { return false; };
};

void check_dexterity(const Rows& rows) {
  for (const jelenkovic::Row& row : jelenkovic::table("quality", rows.number, rows.keys.size())) {
    SCOPED_TRACE("table " + rows.number + " row " + row.keys[0] + " " + row.keys.back());
    const Overrides overrides = joined(rows.fixed, keyed(rows.keys, row));
    Surveyed s;
    const DexterityField f =
        dexterity_of(rows.machine == kStrut ? strut(overrides, rows.moved) : jelenkovic::machine_of(kSlider, overrides),
                     s, rows.resolution);
    const Statistics kappa = statistics(s.survey, f.condition.mean), sigma = statistics(s.survey, f.sigma_min.mean),
                     det = statistics(s.survey, f.determinant.mean);
    const auto& p = row.printed;  // kappa_min, kappa_avg, sigma_min_avg, sigma_min_max, det_avg, det_max
    EXPECT_NEAR(kappa.min / p[0], 1, rows.within.extreme);
    EXPECT_NEAR(sigma.max / p[3], 1, rows.within.extreme);
    if (rows.singular(row)) {
      // Named: from some direction the machine is close to singular here.
      EXPECT_GT(*std::max_element(f.condition.worst.begin(), f.condition.worst.end()), 50);
      continue;
    }
    EXPECT_NEAR(kappa.mean / p[1], 1, rows.within.mean);
    EXPECT_NEAR(sigma.mean / p[2], 1, rows.within.mean);
    EXPECT_NEAR(det.mean / p[4], 1, rows.within.mean);
  }
}

TEST(JelenkovicDexterity, Table8_35) {
  Surveyed s;
  const DexterityField f = dexterity_of(jelenkovic::machine_of(kStrut, {}), s, 60);
  const Statistics kappa = statistics(s.survey, f.condition.mean), sigma = statistics(s.survey, f.sigma_min.mean),
                   det = statistics(s.survey, f.determinant.mean);
  constexpr double kMeans = 0.005, kSpread = 0.01;
  EXPECT_NEAR(kappa.mean / 3.934, 1, kMeans);
  EXPECT_NEAR(sigma.mean / 0.578, 1, kMeans);
  EXPECT_NEAR(det.mean / 1.230, 1, kMeans);
  EXPECT_NEAR(kappa.stddev / 0.287, 1, kSpread);
  EXPECT_NEAR(sigma.stddev / 0.034, 1, kSpread);
  EXPECT_NEAR(det.stddev / 0.202, 1, kSpread);
  EXPECT_NEAR(kappa.min / 3.026, 1, kStruts.extreme);
  EXPECT_NEAR(kappa.max / 4.524, 1, kStruts.extreme);
  EXPECT_NEAR(sigma.min / 0.518, 1, kStruts.extreme);
  EXPECT_NEAR(det.min / 0.911, 1, kStruts.extreme);
}

TEST(JelenkovicDexterity, Tables8_36And8_41To8_44) {
  const Overrides optimal{{"base.pair_angle_deg", "0"}, {"platform.pair_angle_deg", "0"}, {"tool.length_mm", "0"}};
  struct Machine {
    const char* what;
    Overrides overrides;
    double kappa_min, kappa, sigma, det;
  };
  for (const Machine& machine :
       {Machine{"8.36",
                {{"joint.cone_deg", "60"}, {"leg.length_min_mm", "30"}, {"leg.length_max_mm", "80"}},
                2.785,
                3.619,
                0.615,
                1.675},
        Machine{"8.42", joined(optimal, {{"leg.length_min_mm", "45"}, {"leg.length_max_mm", "85"}}), 1.593, 1.835,
                1.022, 5.842},
        Machine{"8.44 first", joined(optimal, {{"leg.length_min_mm", "51"}, {"leg.length_max_mm", "71.5"}}), 1.593,
                1.641, 1.085, 6.331}}) {
    SCOPED_TRACE(machine.what);
    Surveyed s;
    const DexterityField f = dexterity_of(strut(machine.overrides, true), s);
    const Statistics kappa = statistics(s.survey, f.condition.mean);
    EXPECT_NEAR(kappa.min / machine.kappa_min, 1, kStruts.extreme);
    EXPECT_NEAR(kappa.mean / machine.kappa, 1, kStruts.mean);
    EXPECT_NEAR(statistics(s.survey, f.sigma_min.mean).mean / machine.sigma, 1, kStruts.mean);
    EXPECT_NEAR(statistics(s.survey, f.determinant.mean).mean / machine.det, 1, kStruts.mean);
  }
}

TEST(JelenkovicDexterity, Table8_43TheIsotropicPose) {
  // Double joints, the tip in their plane, and struts at 45 deg: half the base's radius, at sqrt(3)/2 of it.
  const AnyMachine m = jelenkovic::machine_of(
      kStrut, {{"base.pair_angle_deg", "0"}, {"platform.pair_angle_deg", "0"}, {"tool.length_mm", "0"}});
  const Pose X{Mat3::Identity(), Vec3(0, 0, 0.05 * std::sqrt(3) / 2)};
  const auto q = joints_at(m, X);
  const kinematics::Dexterity d = kinematics::dexterity(m, X, *q);
  constexpr double kExact = 1e-9;
  EXPECT_NEAR(d.condition, std::sqrt(2.0), kExact);
  EXPECT_NEAR(d.sigma_min, std::sqrt(1.5), kExact);
  EXPECT_NEAR(d.determinant, 27.0 / 4, kExact);
}

TEST(JelenkovicDexterity, Table8_37_Struts) {
  // The widest range reaches near-singular poses (the source: kappa up to 398): 3.9 % on grids of 40 and of 60.
  check_dexterity({"8_37", kStrut, {{"joint.cone_deg", "60"}}, {"range"}, true, kStruts, 40});
}
TEST(JelenkovicDexterity, Table8_38_Tool) {
  check_dexterity({"8_38", kStrut, {}, {"tool.length_mm"}, false, kStruts});
}
TEST(JelenkovicDexterity, Table8_39_Radii) {
  for (const jelenkovic::Row& row : jelenkovic::table("quality", "8_39", 2)) {
    if (row.keys[0] == "90") continue;  // its region lies at the base plane, its home is not stated
    SCOPED_TRACE(row.keys[0] + "/" + row.keys[1]);
    const Overrides overrides{{"base.radius_mm", row.keys[0]}, {"platform.radius_mm", row.keys[1]}};
    Surveyed s;
    const DexterityField f = dexterity_of(strut(overrides, true), s);
    const auto& p = row.printed;
    const double kappa = statistics(s.survey, f.condition.mean).mean / p[1];
    // 100/50 reaches singular poses near the base: kappa's mean is made of them. 70/25: the source's row of the same
    // machine in Table 8.24 has errors 15 times those of its neighbours: its region reaches them too.
    if (row.keys[0] == "100") {
      EXPECT_GT(*std::max_element(f.condition.worst.begin(), f.condition.worst.end()), 50);
    } else {
      EXPECT_NEAR(kappa, 1, row.keys[0] == "70" ? 0.065 : kStruts.mean);
    }
    EXPECT_NEAR(statistics(s.survey, f.sigma_min.mean).mean / p[2], 1, kStruts.mean);
    EXPECT_NEAR(statistics(s.survey, f.determinant.mean).mean / p[4], 1, kStruts.mean);
    EXPECT_NEAR(statistics(s.survey, f.condition.mean).min / p[0], 1, kStruts.extreme);
    EXPECT_NEAR(statistics(s.survey, f.sigma_min.mean).max / p[3], 1, kStruts.extreme);
  }
}
TEST(JelenkovicDexterity, Table8_45And8_46_Legs) {
  check_dexterity({"8_46", kSlider, kRails15, {"leg.length_mm"}, false, kRails});
}
TEST(JelenkovicDexterity, Table8_47_Tool) {
  check_dexterity({"8_47", kSlider, kRails15, {"tool.length_mm"}, false, kRails});
}
TEST(JelenkovicDexterity, Table8_49_PairAngle) {
  check_dexterity(
      {"8_49", kSlider, kRails15, {"platform.pair_angle_deg"}, false, kRails, 22, [](const jelenkovic::Row& r) {
         return std::stod(r.keys[0]) >= 60;
       }});
}
TEST(JelenkovicDexterity, Table8_50_Slope) {
  check_dexterity({"8_50", kSlider, kRails15, {"rail.inner_height_mm"}, false, kRails});
}
TEST(JelenkovicDexterity, Table8_51_Spacing) {
  check_dexterity({"8_51", kSlider, kRails15, {"rail.spacing_mm"}, false, kRails, 22, [](const jelenkovic::Row& r) {
                     return std::stod(r.keys[0]) >= 15;
                   }});
}
TEST(JelenkovicDexterity, Table8_53_BestRails) {
  Surveyed s;
  const DexterityField f = dexterity_of(jelenkovic::machine_of(kSlider, {{"rail.inner_height_mm", "20"},
                                                                         {"rail.spacing_mm", "3.5"},
                                                                         {"platform.radius_mm", "30"},
                                                                         {"platform.pair_angle_deg", "0"},
                                                                         {"tool.length_mm", "0"}}),
                                        s);
  EXPECT_NEAR(statistics(s.survey, f.condition.mean).mean / 2.655, 1, kRails.mean);
  EXPECT_NEAR(statistics(s.survey, f.sigma_min.mean).mean / 1.225, 1, kRails.mean);
  EXPECT_NEAR(statistics(s.survey, f.determinant.mean).mean / 51.177, 1, kRails.mean);
}

// Errors and tolerances -----------------------------------------------------------------------------------------------

struct Printed {
  const char* key;
  double position, position_max, orientation;  // mm, mm, rad
};

/// The machine turned by `angle` about z: where the source's first joint stands.
AnyMachine turned(const AnyMachine& strut_hexapod, double angle) {
  auto m = std::get<machine::StrutHexapod>(strut_hexapod);
  const Mat3 R = rotation_z(angle);
  for (Vec3& p : m.base_joint) p = R * p;
  for (Vec3& p : m.platform_joint) p = R * p;
  for (Vec3& w : m.home.direction) w = R * w;
  return AnyMachine(m);
}

constexpr double kKnown = 0.03;
/// Known errors within 3 %; where the printed number has few digits, half of its last one besides.
void check_known(Surveyed& s, const Printed& row, double last_digit, double orientation_within = kKnown) {
  SCOPED_TRACE(row.key);
  const auto f = known_error_field(s.machine, s.survey, s.options, *sized(s.machine, {{row.key, 0.01}}, false));
  ASSERT_TRUE(f);
  const Statistics position = statistics(s.survey, f->position.mean);
  EXPECT_NEAR(units::to_mm(position.mean), row.position, kKnown * row.position + 0.5 * last_digit);
  EXPECT_NEAR(statistics(s.survey, f->orientation.mean).mean, row.orientation,
              orientation_within * row.orientation + 0.5e-5);
}

TEST(JelenkovicErrors, Table8_21_Known) {
  Surveyed s = surveyed(jelenkovic::machine_of(kStrut, {}), 32);
  for (const Printed& row : {Printed{"leg.length[1]", 0.0089, 0.0111, 0.00028},
                             {"leg.length", 0.0112, 0.0122, 0.000009},
                             {"base.joint", 0.0173, 0.0173, 0},
                             {"platform.joint", 0.0173, 0.0173, 0},
                             {"all", 0.0130, 0.0140, 0.000009}}) {
    check_known(s, row, 1e-4);
  }
  // One joint off by (0.01, 0.01, 0.01): it matters where it stands. The source's first joint is on the x axis, ours at
  // 15 deg. The tool's frame turns with the machine.
  const AnyMachine at_0 = turned(jelenkovic::machine_of(kStrut, {}), units::from_deg(-15));
  Surveyed t = surveyed(at_0, 32);
  check_known(t, {"base.joint[1]", 0.0055, 0.0093, 0.00018}, 1e-4);
  check_known(t, {"platform.joint[1]", 0.0055, 0.0091, 0.00018}, 1e-4);
  const auto f = known_error_field(at_0, t.survey, t.options, *sized(at_0, {{"base.joint[1]", 0.01}}, false));
  EXPECT_NEAR(units::to_mm(statistics(t.survey, f->position.mean).max), 0.0093, 0.05 * 0.0093);
}

TEST(JelenkovicErrors, Table8_27_Known) {
  // The source's "l" is the slider, its "b" the leg: the numbers of our leg.length stand in its rows of b.
  Surveyed s = surveyed(jelenkovic::machine_of(kSlider, kRails15), 32);
  for (const Printed& row : {Printed{"joint[1]", 0.00867, 0.02404, 0.00041},
                             {"leg.length[1]", 0.01127, 0.03599, 0.00054},
                             {"leg.length", 0.01112, 0.01498, 0.00002},
                             {"platform.joint", 0.01732, 0.01732, 0}}) {
    check_known(s, row, 1e-5);
  }
  // All sliders off alike: upright over the middle nothing turns; the mean of the turn is made at the rim, where the
  // source's workspace on rails differs by up to a fifth.
  check_known(s, {"joint", 0.00966, 0.01480, 0.00009}, 1e-5, 0.2);
}

void check_tolerance(const AnyMachine& m, const std::string& key, double printed) {
  Surveyed s = surveyed(m, 16);
  const auto sizes = *sized(m, {{key, 0.01}}, true);
  const auto search = tolerance_field(m, s.survey, s.options, sizes, {Method::search, Region::box});
  const auto exact = tolerance_field(m, s.survey, s.options, sizes);
  ASSERT_TRUE(search && exact);
  constexpr double kSearch = 0.05;
  EXPECT_NEAR(units::to_mm(statistics(s.survey, search->position.mean).mean) / printed, 1, kSearch) << key;
  for (std::size_t i = 0; i < s.survey.inside.size(); ++i) {
    EXPECT_LE(search->position.mean[i], exact->position.mean[i] * (1 + 1e-12));
    EXPECT_LE(search->orientation.mean[i], exact->orientation.mean[i] * (1 + 1e-12));
  }
}

TEST(JelenkovicErrors, Table8_21_Tolerances) {
  const AnyMachine m = jelenkovic::machine_of(kStrut, {});
  check_tolerance(m, "base.joint[1]", 0.0131);
  check_tolerance(m, "platform.joint[1]", 0.0131);
  check_tolerance(m, "leg.length", 0.0366);
  check_tolerance(m, "base.joint", 0.0517);
  check_tolerance(m, "platform.joint", 0.0517);
  check_tolerance(m, "all", 0.2381);
  // Exact: what the source's search stops short of.
  Surveyed s = surveyed(m, 32);
  const auto mean = [&](const char* key) {
    const auto f = tolerance_field(m, s.survey, s.options, *sized(m, {{key, 0.01}}, true));
    return units::to_mm(statistics(s.survey, f->position.mean).mean);
  };
  constexpr double kGrid = 0.003;  // another grid
  EXPECT_NEAR(mean("leg.length") / 0.0366, 1, kGrid);
  EXPECT_NEAR(mean("base.joint") / 0.0536, 1, kGrid);
  EXPECT_NEAR(mean("all") / 0.2514, 1, kGrid);
}

TEST(JelenkovicErrors, Table8_27_Tolerances) {
  const AnyMachine m = jelenkovic::machine_of(kSlider, kRails15);
  check_tolerance(m, "platform.joint[1]", 0.01651);
  check_tolerance(m, "joint", 0.03729);
  check_tolerance(m, "leg.length", 0.04871);
  check_tolerance(m, "platform.joint", 0.06943);
  check_tolerance(m, "all", 0.29980);
}

struct Sweep {
  std::string number, machine;
  Overrides fixed;
  std::vector<std::string> keys;
  bool moved = false;
  std::function<double(const std::string&)> within = [](const std::string&) { return 0.05; };  ///< 0: not compared
};

void check_sweep(const Sweep& sweep) {
  for (const jelenkovic::Row& row : jelenkovic::table("quality", sweep.number, sweep.keys.size())) {
    const double within = sweep.within(row.keys[0]);
    if (within == 0) continue;
    SCOPED_TRACE("table " + sweep.number + " row " + row.keys[0] + " " + row.keys.back());
    const Overrides overrides = joined(sweep.fixed, keyed(sweep.keys, row));
    const AnyMachine m =
        sweep.machine == kStrut ? strut(overrides, sweep.moved) : jelenkovic::machine_of(kSlider, overrides);
    const Surveyed s = surveyed(m, sweep.machine == kStrut ? 16 : 20);
    const auto f =
        tolerance_field(m, s.survey, s.options, *sized(m, {{"all", 0.01}}, true), {Method::search, Region::box});
    ASSERT_TRUE(f);
    EXPECT_NEAR(units::to_mm(statistics(s.survey, f->position.mean).mean) / row.printed[0], 1, within);
  }
}

TEST(JelenkovicErrors, Table8_22_Struts) {
  check_sweep({"8_22", kStrut, {}, {"range"}, true});
}
TEST(JelenkovicErrors, Table8_23_Tool) {
  check_sweep({"8_23", kStrut, {}, {"tool.length_mm"}});
}
TEST(JelenkovicErrors, Table8_24_Radii) {
  // 70: 3.3 is its printed largest among neighbours of 0.27; 100: 143. Means of a few poses near singular ones.
  check_sweep({"8_24", kStrut, {}, {"base.radius_mm", "platform.radius_mm"}, true, [](const std::string& r1) {
                 return r1 == "70" || r1 == "100" ? 0.0 : 0.05;
               }});
}
TEST(JelenkovicErrors, Table8_26_BestStruts) {
  const Overrides best{{"leg.length_min_mm", "40"},
                       {"leg.length_max_mm", "80"},
                       {"base.pair_angle_deg", "0"},
                       {"platform.pair_angle_deg", "0"},
                       {"tool.length_mm", "0"}};
  check_tolerance(strut(best, true), "all", 0.1431);
}
TEST(JelenkovicErrors, Table8_28_Legs) {
  check_sweep({"8_28", kSlider, kRails15, {"leg.length_mm"}});
}
TEST(JelenkovicErrors, Table8_29_Tool) {
  check_sweep({"8_29", kSlider, kRails15, {"tool.length_mm"}});
}
TEST(JelenkovicErrors, Table8_30_Platform) {
  // From 30 on the source's own workspace is not that of its parameters (its volumes neither). At 7 its mean lies above
  // the exact worst case over our workspace (0.372, 0.367): its own reaches poses that ours does not.
  check_sweep({"8_30", kSlider, {}, {"platform.radius_mm"}, false, [](const std::string& r) {
                 return std::stod(r) >= 30 ? 0.0 : r == "7" ? 0.06 : 0.05;
               }});
}
TEST(JelenkovicErrors, Table8_31_PairAngle) {
  check_sweep({"8_31", kSlider, kRails15, {"platform.pair_angle_deg"}, false, [](const std::string& beta) {
                 return std::stod(beta) >= 60 ? 0.0 : 0.06;
               }});
}
TEST(JelenkovicErrors, Table8_33_Spacing) {
  // Close rails: the other way round; ours reaches further (kappa's mean is 3.6 % above the source's in Table 8.51
  // too).
  check_sweep({"8_33", kSlider, kRails15, {"rail.spacing_mm"}, false, [](const std::string& d) {
                 return std::stod(d) >= 15 ? 0.0 : std::stod(d) < 10 ? 0.1 : 0.05;
               }});
}

}  // namespace
}  // namespace polypod::quality
