// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Whether stated intervals hold the truth as often as they say, over simulated calibrations of every family, few rows,
// heavy tails; and the estimates against a least-squares fit of our own that shares nothing with calibrate() but the
// machine's forward kinematics.
//
// The daily list draws 12 machines a case; POLYPOD_LONG=1 draws 300.
#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cstdlib>

#include "polypod/calibration/calibrate.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::calibration {
namespace {

constexpr double kNoise = 20e-6;

struct Case {
  const char* name;
  const char* machine;
  std::size_t rows;
  bool heavy;  ///< Student's t with three degrees of freedom, of the same standard deviation
};
std::ostream& operator<<(std::ostream& out, const Case& c) {
  return out << c.name;
}
constexpr Case kCases[] = {{"arm", "lola50", 60, false},
                           {"arm_few", "lola50", 12, false},
                           {"arm_heavy_tails", "lola50", 60, true},
                           {"struts", "hexapod-strut", 60, false},
                           {"struts_few", "hexapod-strut", 20, false},
                           {"struts_heavy_tails", "hexapod-strut", 60, true},
                           {"sliders", "hexapod-slider", 60, false},
                           {"rotary_delta", "delta-brno", 60, false},
                           {"linear_delta", "delta-linear", 60, false},
                           {"legs", "tricept", 60, false}};

double student_3(Random& random) {  // unit standard deviation
  double square = 0;
  for (int k = 0; k < 3; ++k) square += std::pow(random.normal(), 2);
  return random.normal() / std::sqrt(square / 3) / std::sqrt(3.0);
}

class Coverage : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Calibrate, Coverage, testing::ValuesIn(kCases),
                         [](const auto& one) { return std::string(one.param.name); });

// Machines drawn from the priors: the intervals of all parameters together hold the truth in 95 % of the cases. The
// errors of one machine hang together, as some ten independent ones: three standard deviations of 12 machines are 6
// %, of 300 machines 1.2 %.
TEST_P(Coverage, IntervalsHoldTheTruth) {
  const Case& at = GetParam();
  const bool all = std::getenv("POLYPOD_LONG") != nullptr;
  const std::uint64_t trials = all ? 300 : 12;
  const AnyMachine nominal = *machine::load(at.machine);
  const auto drawn = kinematics::parameters(nominal);
  double covered = 0, count = 0;
  for (std::uint64_t seed = 1; seed <= trials; ++seed) {
    const auto truth = perturbed(nominal, kUsualLengthError, kUsualAngleError, seed);
    ASSERT_TRUE(truth);
    SimulationOptions how;
    how.count = at.rows;
    how.seed = seed;
    how.noise_position = at.heavy ? 1e-12 : kNoise;
    auto rows = simulate(nominal, *truth, how);
    ASSERT_TRUE(rows) << to_string(rows.error());
    Random random(seed, 12);
    for (Measurement& row : *rows)
      for (double& x : row.X_SR.p) x += at.heavy ? kNoise * student_3(random) : 0.0;
    CalibrationOptions options;
    options.noise_position = kNoise;
    const auto c = calibrate(nominal, *rows, options);
    ASSERT_TRUE(c) << to_string(c.error());
    const auto p = kinematics::parameters(*truth);
    ASSERT_EQ(c->covariance.rows(), static_cast<Eigen::Index>(p.size()));
    const auto found = kinematics::parameters(c->machine);
    for (std::size_t i = 0; i < p.size(); ++i) {
      const double deviation = std::sqrt(c->covariance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)));
      if (!(deviation > 1e-9)) continue;  // held, or given by a rule
      covered += std::abs(found[i].value - p[i].value) <= c->student * deviation ? 1 : 0;
      ++count;
    }
  }
  ASSERT_GT(count, 5 * static_cast<double>(trials));
  RecordProperty("coverage", std::to_string(covered / count));
  EXPECT_NEAR(covered / count, 0.95, all ? 0.02 : 0.06) << covered << " of " << count;
}

/// Gauss-Newton by central differences of forward kinematics, priors as further rows.
Eigen::VectorXd own_fit(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                        const std::vector<std::size_t>& which, const std::vector<double>& prior, double noise) {
  const auto figures = kinematics::parameters(nominal);
  Eigen::VectorXd x = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(which.size()));
  const auto residuals = [&](const Eigen::VectorXd& change) {
    std::vector<double> p;
    for (const auto& figure : figures) p.push_back(figure.value);
    for (std::size_t k = 0; k < which.size(); ++k) p[which[k]] += change[static_cast<Eigen::Index>(k)];
    const auto m = machine::with_parameters(nominal, p);
    EXPECT_TRUE(m);
    Eigen::VectorXd r(static_cast<Eigen::Index>(3 * rows.size() + which.size()));
    for (std::size_t i = 0; i < rows.size(); ++i)
      r.segment<3>(static_cast<Eigen::Index>(3 * i)) =
          (kinematics::forward(*m, rows[i].q).poses.at(0).p - rows[i].X_SR.p) / noise;
    for (std::size_t k = 0; k < which.size(); ++k)
      r[static_cast<Eigen::Index>(3 * rows.size() + k)] = change[static_cast<Eigen::Index>(k)] / prior[k];
    return r;
  };
  for (int pass = 0; pass < 12; ++pass) {
    const Eigen::VectorXd r = residuals(x);
    Eigen::MatrixXd J(r.size(), x.size());
    for (Eigen::Index k = 0; k < x.size(); ++k) {
      const double step = 1e-6;
      Eigen::VectorXd up = x, down = x;
      up[k] += step;
      down[k] -= step;
      J.col(k) = (residuals(up) - residuals(down)) / (2 * step);
    }
    x -= J.colPivHouseholderQr().solve(r);
  }
  return x;
}

TEST(OwnFit, AnotherLeastSquaresFitAgrees) {
  const std::pair<const char*, std::vector<std::string>> machines[] = {
      {"lola50", {"dh[1].a", "dh[1].d", "dh[2].a", "dh[1].theta_offset", "dh[2].theta_offset", "dh[1].alpha"}},
      {"hexapod-strut", {"leg.length", "platform.joint[1]", "base.joint[3]"}},
      {"delta-brno", {"arm.length", "rod.length"}}};
  for (const auto& [name, only] : machines) {
    const AnyMachine nominal = *machine::load(name);
    // Only these parameters are off, so that the noise is what the fit sees.
    std::vector<double> p;
    const AnyMachine off = *perturbed(nominal, kUsualLengthError, kUsualAngleError, 5);
    const auto drawn = kinematics::parameters(nominal), moved = kinematics::parameters(off);
    for (std::size_t k = 0; k < drawn.size(); ++k) {
      const bool mine =
          std::any_of(only.begin(), only.end(), [&](const std::string& key) { return drawn[k].key.starts_with(key); });
      p.push_back(mine ? moved[k].value : drawn[k].value);
    }
    const AnyMachine truth = *machine::with_parameters(nominal, p);
    SimulationOptions how;
    how.count = 50;
    how.noise_position = kNoise;
    const auto rows = simulate(nominal, truth, how);
    ASSERT_TRUE(rows);
    CalibrationOptions options;
    options.only = only;
    options.loss = Loss::none;
    options.hold_back = 0;
    options.noise_position = kNoise;
    options.prior_length = 1;  // so wide that the noise by which priors count does not matter
    options.prior_angle = 1;
    const auto c = calibrate(nominal, *rows, options);
    ASSERT_TRUE(c) << to_string(c.error());
    std::vector<std::size_t> which;
    std::vector<double> prior;
    const auto figures = kinematics::parameters(nominal), found = kinematics::parameters(c->machine);
    for (const Estimate& e : c->parameters) {
      const auto at = std::find_if(figures.begin(), figures.end(), [&](const auto& f) { return f.key == e.key; });
      ASSERT_NE(at, figures.end());
      EXPECT_TRUE(e.identifiable) << name << " " << e.key;
      which.push_back(static_cast<std::size_t>(at - figures.begin()));
      prior.push_back(c->prior[static_cast<Eigen::Index>(which.back())]);
    }
    ASSERT_GE(which.size(), only.size());
    const Eigen::VectorXd x = own_fit(nominal, *rows, which, prior, kNoise);
    for (std::size_t k = 0; k < which.size(); ++k) {
      const auto at = static_cast<Eigen::Index>(k);
      const double change = found[which[k]].value - figures[which[k]].value;
      EXPECT_LT(std::abs(change - x[at]), 1e-6 * c->parameters[k].standard_error)
          << name << " " << c->parameters[k].key;
    }
  }
}

}  // namespace
}  // namespace polypod::calibration
