// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The pages about measured machines hold the numbers of their results, whatever the machine.
#include "polypod/pages/calibration.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "polypod/calibration/simulate.hpp"
#include "polypod/core/units.hpp"
#include "polypod/report/plot.hpp"

namespace polypod::pages {
namespace {

using calibration::Calibration;
using calibration::Kind;
using calibration::Measurement;
using report::fixed;
using ::testing::HasSubstr;
using ::testing::Not;
using units::to_mm;
using units::to_um;

struct Measured {
  machine::AnyMachine nominal;
  std::vector<Measurement> rows;
  Calibration found;

  Measured(const char* name, Kind kind, double outliers) : nominal(*machine::load(name)) {
    const auto real = calibration::perturbed(nominal, 0.1e-3, 1e-3, 7);
    EXPECT_TRUE(real);
    calibration::SimulationOptions options;
    options.kind = kind;
    options.count = 60;
    options.outliers = outliers;
    auto simulated = calibration::simulate(nominal, *real, options);
    EXPECT_TRUE(simulated) << (simulated ? "" : to_string(simulated.error()));
    if (!simulated) return;
    rows = *simulated;
    int line = 2;
    for (Measurement& row : rows) row.place = {"tracker <1>.csv", line++, 0};
    auto c = calibration::calibrate(nominal, rows);
    EXPECT_TRUE(c) << (c ? "" : to_string(c.error()));
    if (c) found = *c;
  }
};

TEST(CalibrationPage, HoldsTheNumbersOfTheResult) {
  const Measured m("hexapod-strut", Kind::point, 0.05);
  ASSERT_GT(m.found.fitted.outliers + m.found.held_back.outliers, 0U);
  const std::string page = calibration_page(m.nominal, m.rows, m.found, {"1.2.3", "polypod calibrate <x>"});
  for (const calibration::Score& s : {m.found.fitted, m.found.held_back}) {
    EXPECT_THAT(page, HasSubstr(fixed(to_um(s.rms_before), 1)));
    EXPECT_THAT(page, HasSubstr(fixed(to_um(s.rms_after), 1)));
  }
  EXPECT_THAT(page, HasSubstr(fmt::format("{} of {}", m.found.rank, m.found.parameters.size())));
  std::size_t untold = 0;
  for (const calibration::Estimate& p : m.found.parameters) {
    ASSERT_TRUE(p.unit == "mm") << p.key;
    const std::string row =
        fmt::format("<td>{}</td><td>mm</td><td class=\"r\">{}</td><td class=\"r\">", p.key, fixed(to_mm(p.nominal), 5));
    const std::string told =
        fmt::format("{}</td><td class=\"r\">{}</td><td class=\"r\">{}</td>", fixed(to_mm(p.value), 5),
                    fixed(to_mm(p.value - p.nominal), 5), fixed(to_mm(p.standard_error), 5));
    EXPECT_THAT(page, HasSubstr(row + told));
    untold += p.identifiable ? 0 : 1;
  }
  EXPECT_EQ(untold, m.found.parameters.size() - m.found.rank);
  for (const calibration::RowResidual& r : m.found.residuals) {
    const std::string line = fmt::format("<td>tracker &lt;1&gt;.csv</td><td class=\"r\">{}</td>", r.row + 2);
    if (r.outlier) {
      EXPECT_THAT(page, HasSubstr(line));
      EXPECT_THAT(page, HasSubstr(fixed(to_um(r.after.norm()), 1)));
    } else {
      EXPECT_THAT(page, Not(HasSubstr(line)));
    }
  }
  // The verdict, and the pose's deviations with a map for each of six coordinates.
  EXPECT_EQ(m.found.verdict.answer, calibration::Answer::partly);
  EXPECT_THAT(page, HasSubstr("In part: x, y and z of the pose are better"));
  for (const Eigen::Index k : {0, 1, 2}) {
    EXPECT_THAT(page, HasSubstr(report::number(to_um(m.found.verdict.after.mean[k]))));
    EXPECT_THAT(page, HasSubstr(report::number(to_um(m.found.verdict.before.max[k]))));
  }
  for (const char* letter : {"x", "y", "z", "A", "B", "C"})
    EXPECT_THAT(page, HasSubstr(fmt::format("standard deviation of {}", letter)));
  EXPECT_THAT(page, HasSubstr("undetermined"));
  EXPECT_THAT(page, HasSubstr("polypod calibrate &lt;x&gt;"));
  EXPECT_THAT(page, HasSubstr("Polypod 1.2.3"));
  EXPECT_THAT(page, Not(HasSubstr("nan")));
  EXPECT_EQ(page, calibration_page(m.nominal, m.rows, m.found, {"1.2.3", "polypod calibrate <x>"}));
}

TEST(CalibrationPage, ShowsAnglesWhereTheyWereMeasured) {
  const Measured poses("lola50", Kind::pose, 0), points("lola50", Kind::point, 0);
  const std::string with = calibration_page(poses.nominal, poses.rows, poses.found);
  EXPECT_THAT(with, HasSubstr("Angles of each row"));
  EXPECT_THAT(with, HasSubstr("<strong>Yes.</strong>The calibrated machine is better"));
  EXPECT_THAT(with, HasSubstr(fixed(units::to_deg(poses.found.fitted.angle_after), 5)));
  const std::string without = calibration_page(points.nominal, points.rows, points.found);
  EXPECT_THAT(without, Not(HasSubstr("Angles of each row")));
  EXPECT_THAT(without, Not(HasSubstr("angles before")));
}

TEST(IdentificationPage, HoldsTheNumbersOfTheResult) {
  struct Case {
    machine::AnyMachine machine;
    double scale;
    const char* unit;
  };
  for (const auto& [machine, scale, unit] :
       {Case{*machine::load("lola50"), 1e7, "1e-7 rad/Nm"},
        Case{*machine::load("hexapod-strut", {{"leg.compliance_um_per_N", "0.05"}}), units::to_um_per_N(1), "µm/N"}}) {
    const auto real = calibration::perturbed_compliance(machine, 0.2, 3);
    ASSERT_TRUE(real) << to_string(real.error());
    calibration::SimulationOptions options;
    options.count = 30;
    auto points = calibration::simulate_displacements(*real, 250, options);
    ASSERT_TRUE(points) << to_string(points.error());
    const double shift = 1e-3;  // one reading far off
    (*points)[4].displacement(1, 2) += shift;
    const auto r = statics::identify_compliance(machine, *points);
    ASSERT_TRUE(r) << to_string(r.error());
    ASSERT_FALSE(r->outliers.empty());
    const double given = *statics::prediction_rms(machine, *points);
    const ComplianceChecks checks{given, {{"plane <I>.csv", 12.34e-6}}};
    const std::string page = identification_page(machine, *points, *r, checks, {"", "polypod identify <x>"});
    for (const double um : {to_um(given), to_um(r->residual_rms), to_um(r->asymmetry_rms)})
      EXPECT_THAT(page, HasSubstr(fixed(um, 1)));
    // No more digits than hold: two figures of the least standard error.
    double least = 1e300;
    for (const double error : r->standard_error)
      if (error > 0) least = std::min(least, scale * error);
    int digits = 0;
    for (double rest = least; rest < 10; rest *= 10) ++digits;
    for (std::size_t i = 0; i < r->compliance.size(); ++i) {
      EXPECT_THAT(page, HasSubstr(fmt::format("<td>{}</td><td class=\"r\">{}</td><td class=\"r\">{}</td>"
                                              "<td class=\"r\">{}</td>",
                                              r->joint[i], fixed(scale * r->compliance[i], digits),
                                              fixed(scale * r->standard_error[i], digits),
                                              fixed(scale * r->half_interval[i], digits))));
    }
    EXPECT_THAT(page, HasSubstr(unit));
    EXPECT_THAT(
        page, HasSubstr(fmt::format("<td>dy_Fz</td><td class=\"r\">{}</td>", fixed(to_um(r->residuals[4](1, 2)), 1))));
    EXPECT_THAT(page, HasSubstr("<td>plane &lt;I&gt;.csv</td><td class=\"r\">12.3</td>"));
    EXPECT_THAT(page, HasSubstr("polypod identify &lt;x&gt;"));
    EXPECT_THAT(page, Not(HasSubstr("nan")));
    EXPECT_EQ(page, identification_page(machine, *points, *r, checks, {"", "polypod identify <x>"}));
  }
}

}  // namespace
}  // namespace polypod::pages
