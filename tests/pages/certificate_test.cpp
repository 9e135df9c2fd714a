// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The certificate holds the figures of its calibration, lines for what is not given, and nothing that a page on paper
// cannot have.
#include "polypod/pages/certificate.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "polypod/calibration/simulate.hpp"
#include "polypod/core/units.hpp"
#include "polypod/report/plot.hpp"

namespace polypod::pages {
namespace {

using calibration::Kind;
using ::testing::HasSubstr;
using ::testing::Not;

struct Certified {
  machine::AnyMachine nominal;
  std::vector<calibration::Measurement> rows;
  calibration::Calibration found;
  Certificate certificate;

  explicit Certified(const char* name, Kind kind = Kind::point, bool repeated = false) : nominal(*machine::load(name)) {
    const auto real = *calibration::perturbed(nominal, 0.1e-3, 1e-3, 7);
    calibration::SimulationOptions options;
    options.kind = kind;
    options.count = 60;
    if (kind == Kind::distance) options.anchors = {{0, 0, 0}, {0.3, 0, 0}, {0, 0.3, 0}};
    rows = *calibration::simulate(nominal, real, options);
    if (repeated) {
      for (int i = 1; i <= 5; ++i) {
        rows.push_back(rows.front());
        rows.back().X_SR.p.x() += 1e-6 * i;
      }
    }
    calibration::Systematic scale;
    scale.size = 5e-6;
    scale.divisor = std::sqrt(3.0);
    scale.distribution = calibration::Distribution::rectangular;
    scale.source = "data sheet <7>";
    certificate.options.systematic = {scale};
    auto c = calibration::calibrate(nominal, rows, certificate.options);
    EXPECT_TRUE(c) << (c ? "" : to_string(c.error()));
    if (!c) return;
    found = *c;
    certificate.region = calibration::region_of(nominal, rows);
    if (const auto stand = calibration::most_uncertain(nominal, found, certificate.region))
      certificate.budget = calibration::budget_at(nominal, found, certificate.options.systematic, *stand);
    certificate.poses = calibration::pose_accuracy(nominal, rows, found);
    certificate.lengths = calibration::length_errors(rows, found);
    certificate.lines = calibration::line_errors(nominal, rows, found);
    certificate.files = {{"readings", "data.csv", calibration::sha256("abc")}, {"readings", "standard input", ""}};
  }
  [[nodiscard]] std::string page() const { return certificate_page(nominal, rows, found, certificate); }
};

std::size_t count_of(const std::string& text, const std::string& word) {
  std::size_t out = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++out;
  return out;
}

TEST(CertificatePage, HoldsTheBudgetAndTheHashes) {
  const Certified one("hexapod-strut");
  const std::string page = one.page();
  ASSERT_TRUE(one.certificate.budget);
  const calibration::Budget& b = *one.certificate.budget;
  for (const calibration::BudgetRow& row : b.rows) EXPECT_THAT(page, HasSubstr(row.quantity));
  EXPECT_THAT(page, HasSubstr("5.00 µm/m"));
  EXPECT_THAT(page, HasSubstr("2.89 µm/m"));
  EXPECT_THAT(page, HasSubstr("<td class=\"r\">1.73</td>"));
  EXPECT_THAT(page, HasSubstr("data sheet &lt;7&gt;"));
  for (int k = 0; k < 3; ++k) EXPECT_THAT(page, HasSubstr(report::number(2 * units::to_um(b.combined[k]), 2)));
  EXPECT_THAT(page, HasSubstr("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"));
  EXPECT_THAT(page, HasSubstr("not known"));
  EXPECT_EQ(page, one.page());
}

TEST(CertificatePage, LeavesOpenWhatIsNotGiven) {
  Certified one("lola50");
  const std::size_t all = count_of(one.page(), "class=\"open\"");
  EXPECT_GT(all, 12U);
  one.certificate.statement.operator_name = "A <b>Person</b>";
  one.certificate.statement.instrument_serial = "391";
  one.certificate.statement.remarks = {"<script>no</script>"};
  const std::string page = one.page();
  EXPECT_EQ(count_of(page, "class=\"open\""), all - 4);  // remarks have two lines
  EXPECT_THAT(page, HasSubstr("A &lt;b&gt;Person"));
  EXPECT_THAT(page, Not(HasSubstr("<script")));
  EXPECT_THAT(page, Not(HasSubstr("prefers-color-scheme")));
  EXPECT_EQ(count_of(page, "http") - count_of(page, "http-equiv"), count_of(page, "http://www.w3.org/2000/svg"));
}

TEST(CertificatePage, CertifiesNothingWhereTheAnswerIsNo) {
  Certified one("delta-linear");
  EXPECT_THAT(one.page(), HasSubstr("<h1>Calibration certificate</h1>"));
  one.found.verdict.answer = calibration::Answer::no;
  const std::string page = one.page();
  EXPECT_THAT(page, HasSubstr("<h1>Measurement report, no certificate</h1>"));
  EXPECT_THAT(page, HasSubstr("What was measured"));
  EXPECT_THAT(page, Not(HasSubstr("Valid until")));
  EXPECT_THAT(page, Not(HasSubstr("Uncertainty budget")));
  EXPECT_THAT(page, Not(HasSubstr("<svg")));
}

TEST(CertificatePage, SaysWhichFiguresOfStandardsTheRowsGive) {
  const std::string none = Certified("delta-linear").page();
  EXPECT_EQ(count_of(none, "The readings do not have this form"), 2U);
  const Certified repeated("delta-linear", Kind::point, true);
  ASSERT_EQ(repeated.certificate.poses.size(), 1U);
  const std::string with = repeated.page();
  EXPECT_EQ(count_of(with, "The readings do not have this form"), 1U);
  EXPECT_THAT(with, HasSubstr(report::fixed(units::to_mm(repeated.certificate.poses[0].accuracy), 4)));
  EXPECT_THAT(with, HasSubstr("asks for 30 cycles"));
  const Certified bar("delta-linear", Kind::distance);
  ASSERT_TRUE(bar.certificate.lengths);
  EXPECT_THAT(bar.page(), HasSubstr(report::fixed(units::to_mm(bar.certificate.lengths->error_before), 4)));
}

}  // namespace
}  // namespace polypod::pages
