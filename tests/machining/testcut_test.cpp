// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The test cut against the stock that it leaves and against deflections by hand; its fit against machines that are
// softer and materials that are harder than the job says.
#include "polypod/machining/testcut.hpp"

#include <gmock/gmock.h>

#include <random>

#include "examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod {
namespace {

using machining::Job;
using machining::TestCut;
using machining::TestCutFit;
using machining::TestCutPlan;
using machining::TestCutReading;
using machining::TestCutStep;
using ::testing::HasSubstr;
using testing::unwrap;
using units::from_mm;
using units::from_um;

Job square_job() {
  return unwrap(machining::read_job(testing::example_path("slavkovic_square", "job.toml")));
}
TestCutPlan usual() {
  TestCutPlan plan;
  plan.feed = units::from_mm_per_min(1600);
  plan.spindle_speed = units::from_per_min(8000);
  plan.depth = from_mm(2);
  return plan;
}

/// The job on a machine whose compliances, and in a material whose coefficients, are other than it says.
Job in_truth(Job job, double compliance, double force) {
  std::vector<double> c = statics::column_compliances(job.machine);
  for (double& x : c) x *= compliance;
  job.machine = unwrap(statics::with_compliances(job.machine, c));
  cutting::Material& m = job.material;
  for (double* k : {&m.ktc, &m.krc, &m.kac, &m.kte, &m.kre, &m.kae}) *k *= force;
  return job;
}

std::vector<TestCutReading> readings(const std::vector<double>& sizes, double diameter_error, double sigma,
                                     std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0, sigma);
  std::vector<TestCutReading> out;
  for (std::size_t i = 0; i < sizes.size(); ++i) out.push_back({i, sizes[i] - diameter_error + noise(random), sigma});
  return out;
}

TEST(TestCut, LeavesEachStretchItsWidthAndASquareBoss) {
  Job job = square_job();
  const TestCut cut = unwrap(machining::test_cut(job, usual()));
  ASSERT_EQ(cut.steps.size(), 6u);
  const gcode::Program program = unwrap(gcode::parse(cut.text, "cut.ngc"));
  const gcode::Interpretation moves = unwrap(gcode::interpret(program));
  const double R = 0.5 * job.cutter.diameter;
  cutting::Stock stock = unwrap(cutting::Stock::block(cut.block_min, cut.block_max, from_mm(0.1)));
  // Where the wall stands on both sides of the boss, seen from its middle along the line that is measured.
  const auto size = [&](const TestCutStep& step) {
    const int a = step.axis == 'x' ? 0 : 1;
    const auto solid = [&](double v) {
      Vec3 p = step.at;
      p[a] = v;
      const int i = static_cast<int>((p.x() - stock.x_min()) / stock.cell());
      const int j = static_cast<int>((p.y() - stock.y_min()) / stock.cell());
      return stock.height(i, j) > -0.5e-3;
    };
    double low = step.at[a], high = step.at[a];
    while (solid(high)) high += 0.01e-3;
    while (solid(low)) low -= 0.01e-3;
    return high - low;
  };
  bool finishing = false;
  const int first = cut.steps[0].lines[0];
  for (const gcode::Move& move : moves.moves) {
    const int line = program.blocks[static_cast<std::size_t>(move.block)].line;
    if (move.kind == gcode::MoveKind::rapid) continue;
    if (!finishing && line >= first - 1) {
      finishing = true;
      for (const TestCutStep& step : cut.steps) {
        EXPECT_NEAR(size(step), step.nominal + 2 * step.width, from_mm(0.21)) << step.axis << step.width;
      }
    }
    stock.cut_line(move.start, move.end, R);
    for (const TestCutStep& step : cut.steps) {
      for (const int k : {0, 1}) {
        if (step.lines[k] != line) continue;
        // The centre stands half of the boss and the radius from its middle, and passes where it is measured.
        const int a = step.axis == 'x' ? 0 : 1;
        EXPECT_NEAR(std::abs(move.start[a] - cut.plan.x), 0.5 * step.nominal + R, 1e-9);
        EXPECT_NEAR(0.5 * (move.start + move.end)[1 - a], step.at[1 - a], 1e-9);
        EXPECT_NEAR(move.length(), job.cutter.diameter, 1e-9);
      }
    }
  }
  for (const TestCutStep& step : cut.steps) EXPECT_NEAR(size(step), step.nominal, from_mm(0.21));
}

TEST(TestCut, SizesAreThoseOfAHandComputedDeflection) {
  Job job = in_truth(square_job(), 1, 0.3);  // a third of the force: engagement changes little
  const TestCut cut = unwrap(machining::test_cut(job, usual()));
  const std::vector<double> sizes = unwrap(machining::predicted_sizes(job, cut, 1));
  const double per_tooth = usual().feed / (usual().spindle_speed * job.cutter.teeth);
  for (std::size_t i = 0; i < cut.steps.size(); ++i) {
    const TestCutStep& step = cut.steps[i];
    const int a = step.axis == 'x' ? 0 : 1;
    double expected = step.nominal;
    for (const double side : {1.0, -1.0}) {
      Vec3 tip = step.at, out = Vec3::Zero();
      out[a] = side;
      tip[a] = side * (0.5 * step.nominal + 0.5 * job.cutter.diameter);
      tip.z() = -cut.plan.depth;
      const Mat3 C = statics::compliance_at(job.machine, {Mat3::Identity(), job.X_MW * tip}).C.topLeftCorner<3, 3>();
      // Clockwise round the boss: it is on the right of the feed, and the wall is cut down-milling.
      const Vec3 feed = out.cross(Vec3::UnitZ()), left = Vec3::UnitZ().cross(feed);
      Mat3 R;
      R << feed, left, Vec3::UnitZ();
      const auto off = [&](cutting::CutSide kind, double ae) {
        const auto engagement = cutting::straight_engagement(job.cutter, kind, ae, cut.plan.depth);
        return out.dot(C * (R * cutting::mean_force(job.cutter, job.material, engagement, per_tooth)));
      };
      const double rough = off(cutting::CutSide::slot, job.cutter.diameter);
      double bend = 0;
      for (int k = 0; k < 30; ++k) bend = off(cutting::CutSide::down, step.width + rough - bend);
      expected += bend;
    }
    const double deflection = std::abs(expected - step.nominal);
    EXPECT_GT(deflection, from_um(10));
    EXPECT_NEAR(sizes[i], expected, 0.04 * deflection + from_um(1)) << step.axis << step.width;
  }
}

TEST(TestCut, FindsTheProductWithinItsUncertainty) {
  const Job job = square_job();
  const TestCut cut = unwrap(machining::test_cut(job, usual()));
  int within = 0, cases = 0;
  double squares = 0;
  for (const auto& [compliance, force] : {std::pair{1.2, 0.9}, {0.8, 0.9}, {1.0, 1.0}, {1.3, 1.2}}) {
    const std::vector<double> sizes = unwrap(machining::predicted_sizes(in_truth(job, compliance, force), cut, 1));
    for (std::uint64_t seed : {1, 2}) {
      const TestCutFit fit = unwrap(machining::fit_test_cut(job, cut, readings(sizes, from_um(25), from_um(4), seed)));
      ASSERT_FALSE(fit.no) << *fit.no << ' ' << compliance * force << ' ' << seed << ' ' << fit.product.value;
      const double off = (fit.product.value - compliance * force) / fit.product.uncertainty;
      squares += off * off;
      within += std::abs(off) < 2 ? 1 : 0;
      ++cases;
      EXPECT_LT(fit.product.uncertainty, 0.06 * fit.product.value);
      EXPECT_NEAR(fit.diameter.value, from_um(25), 3 * fit.diameter.uncertainty);
      EXPECT_LT(fit.diameter.uncertainty, from_um(10));
      EXPECT_LE(fit.rms_after, fit.rms_before + from_um(0.1));  // sizes scatter by as much with the stock's cells
    }
  }
  EXPECT_GE(within, cases - 2);
  EXPECT_LT(squares, 20);  // chi-squared of 8: 1 %
}

TEST(TestCut, ProductIsExactWithoutNoise) {
  const Job job = square_job();
  const TestCut cut = unwrap(machining::test_cut(job, usual()));
  const std::vector<double> sizes = unwrap(machining::predicted_sizes(in_truth(job, 1.25, 0.96), cut, 1));
  std::vector<TestCutReading> exact;
  for (std::size_t i = 0; i < sizes.size(); ++i) exact.push_back({i, sizes[i], from_um(3)});
  const TestCutFit fit = unwrap(machining::fit_test_cut(job, cut, exact));
  EXPECT_NEAR(fit.product.value, 1.2, 2e-3);
  EXPECT_LT(fit.rms_after, from_um(0.5));
  ASSERT_EQ(fit.freedom, 4);
  // Uncertainties: the inverse of the normal matrix of both unknowns, with slopes by wide differences.
  const std::vector<double> less = unwrap(machining::predicted_sizes(job, cut, 1.1));
  const std::vector<double> more = unwrap(machining::predicted_sizes(job, cut, 1.3));
  Eigen::MatrixXd A(static_cast<Eigen::Index>(sizes.size()), 2);
  for (Eigen::Index i = 0; i < A.rows(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    A.row(i) << (more[k] - less[k]) / 0.2 / from_um(3), -1 / from_um(3);
  }
  const Eigen::Matrix2d covariance = (A.transpose() * A).inverse();
  EXPECT_NEAR(fit.product.uncertainty, std::sqrt(covariance(0, 0)), 0.05 * fit.product.uncertainty);
  EXPECT_NEAR(fit.diameter.uncertainty, std::sqrt(covariance(1, 1)), 0.05 * fit.diameter.uncertainty);
  EXPECT_NEAR(fit.chi_squared_99, 13.277, 0.01 * 13.277);  // tables of chi-squared
}

TEST(TestCut, SaysNoWhereOneFactorDoesNotExplainTheSizes) {
  const Job job = square_job();
  const TestCut cut = unwrap(machining::test_cut(job, usual()));
  const std::vector<double> soft = unwrap(machining::predicted_sizes(in_truth(job, 1.5, 1), cut, 1));
  const std::vector<double> hard = unwrap(machining::predicted_sizes(in_truth(job, 0.7, 1), cut, 1));
  std::vector<TestCutReading> mixed;
  for (std::size_t i = 0; i < soft.size(); ++i)
    mixed.push_back({i, cut.steps[i].axis == 'x' ? soft[i] : hard[i], from_um(3)});
  const TestCutFit fit = unwrap(machining::fit_test_cut(job, cut, mixed));
  ASSERT_TRUE(fit.no);
  EXPECT_THAT(*fit.no, HasSubstr("one factor does not explain"));
  // Readings that are all alike within 0.2 mm tell nothing.
  const TestCutFit blunt =
      unwrap(machining::fit_test_cut(job, cut, readings(std::vector<double>(6, from_mm(72)), 0, from_mm(0.2), 1)));
  ASSERT_TRUE(blunt.no);
  // Nor do sizes that another cutter left, whatever the factor that fits them.
  std::vector<TestCutReading> other;
  for (std::size_t i = 0; i < soft.size(); ++i) other.push_back({i, soft[i] - from_mm(1), from_um(3)});
  const TestCutFit larger = unwrap(machining::fit_test_cut(job, cut, other));
  ASSERT_TRUE(larger.no);
  EXPECT_THAT(*larger.no, HasSubstr("larger than the"));
  EXPECT_NEAR(larger.diameter.value, from_mm(1), from_um(5));
}

TEST(TestCut, RefusesWhatTellsNothing) {
  const Job job = square_job();
  TestCutPlan plan = usual();
  plan.widths = {from_mm(2), from_mm(1)};
  EXPECT_EQ(machining::test_cut(job, plan).error().id, "MC410");
  plan.widths = {from_mm(1), from_mm(9)};
  EXPECT_EQ(machining::test_cut(job, plan).error().id, "MC410");
  plan = usual();
  plan.depth = from_mm(21);
  EXPECT_EQ(machining::test_cut(job, plan).error().id, "MC411");
  plan = usual();
  plan.feed = 0;
  EXPECT_EQ(machining::test_cut(job, plan).error().id, "MC411");
  plan.feed = units::from_mm_per_min(1e5);
  plan.spindle_speed = units::from_per_min(100);
  EXPECT_EQ(machining::predicted_sizes(job, unwrap(machining::test_cut(job, plan)), 1).error().id, "MC414");
  const TestCut cut = unwrap(machining::test_cut(job, usual()));
  std::vector<std::string> notes;
  unwrap(machining::predicted_sizes(job, cut, 1, &notes));
  EXPECT_TRUE(notes.empty());
  plan.feed = units::from_mm_per_min(200);
  plan.spindle_speed = units::from_per_min(4e5);
  unwrap(machining::predicted_sizes(job, unwrap(machining::test_cut(job, plan)), 1, &notes));
  EXPECT_FALSE(notes.empty());  // 10 km/min at the edge
  EXPECT_EQ(machining::fit_test_cut(job, cut, {{0, 0.072, 1e-6}, {1, 0.072, 1e-6}}).error().id, "MC412");
  ASSERT_EQ(cut.steps[0].width, cut.steps[5].width);
  EXPECT_EQ(machining::fit_test_cut(job, cut, {{0, 0.072, 1e-6}, {5, 0.072, 1e-6}, {0, 0.072, 1e-6}}).error().id,
            "MC412");
}

TEST(TestCut, KnownForcesTellTheCompliance) {
  const Job job = square_job(), truth = in_truth(job, 1.17, 1);
  std::vector<statics::MeasuredPoint> points;
  for (const double x : {-200.0, 0.0, 200.0}) {
    statics::MeasuredPoint point;
    point.X_MT = {Mat3::Identity(), from_mm(1) * Vec3(x, -1300, 0)};
    point.force = 250;
    point.displacement = point.computed(unwrap(statics::computed_compliance(truth.machine, point)));
    points.push_back(point);
  }
  const machining::Factor exact = unwrap(machining::compliance_factor(job, points));
  EXPECT_NEAR(exact.value, 1.17, 1e-9);
  EXPECT_LT(exact.uncertainty, 1e-6);
  points[0].displacement(0, 0) += from_um(30);
  EXPECT_GT(unwrap(machining::compliance_factor(job, points)).uncertainty, 1e-3);
}

TEST(TestCut, ForceIsTheProductOverTheCompliance) {
  // 1.2 +- 5 % over 0.8 +- 12 %: 1.5 +- 13 %.
  const machining::Separated both = machining::separated({1.2, 0.06}, machining::Factor{0.8, 0.096}, {2, 3, 0});
  EXPECT_NEAR(both.force.value, 1.5, 1e-12);
  EXPECT_NEAR(both.force.uncertainty, 0.13 * 1.5, 1e-12);
  EXPECT_NEAR(both.factors.force, 3, 1e-12);
  EXPECT_NEAR(both.factors.compliance, 2.4, 1e-12);
  EXPECT_NEAR(both.factors.force_uncertainty, 0.39, 1e-12);
  const machining::Separated product = machining::separated({1.2, 0.06}, {}, {});
  EXPECT_EQ(product.factors.force, 1.2);
  EXPECT_EQ(product.factors.compliance, 1);
}

TEST(TestCut, AJobWithFactorsForetellsWhatWasFound) {
  const Job job = square_job(), truth = in_truth(job, 1.25, 0.9);
  const std::string text = unwrap(files::read(testing::example_path("slavkovic_square", "job.toml")));
  testing::Scratch scratch;
  const std::string once = machining::with_factors(text, {0.9, 1.25, 0.02}, "from a test cut\nof two lines");
  EXPECT_THAT(once, HasSubstr("# of two lines\n"));
  // A second table takes the place of the first one.
  const std::string twice = machining::with_factors(machining::with_factors(text, {2, 3, 1}, "old"), {0.9, 1.25, 0.02},
                                                    "from a test cut\nof two lines");
  EXPECT_EQ(once, twice);
  unwrap(files::write_whole(scratch.file("job.toml"), once).map([] { return true; }));
  const Job read = unwrap(machining::read_job(scratch.file("job.toml")));
  EXPECT_DOUBLE_EQ(read.factors.compliance, 1.25);
  EXPECT_DOUBLE_EQ(read.material.krc, truth.material.krc);
  const std::size_t known = job.material.spread.size();
  ASSERT_EQ(read.material.spread.size(), known + 1);
  EXPECT_NEAR(read.material.spread.back()[0], 1.96 * 0.02 / 0.9 * truth.material.ktc, 1e-3);
  const TestCut cut = unwrap(machining::test_cut(job, usual()));
  const std::vector<double> a = unwrap(machining::predicted_sizes(read, cut, 1));
  const std::vector<double> b = unwrap(machining::predicted_sizes(truth, cut, 1));
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-12);
}

}  // namespace
}  // namespace polypod
