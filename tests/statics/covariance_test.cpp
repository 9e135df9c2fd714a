// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The covariance of identified compliances: what it is of, and its file.
#include "polypod/statics/covariance.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <filesystem>
#include <sstream>

#include "polypod/core/files.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/gain.hpp"
#include "polypod/statics/identify.hpp"

namespace polypod::statics {
namespace {

using ::testing::HasSubstr;

const machine::AnyMachine& lola() {
  static const machine::AnyMachine m = *machine::load("lola50");
  return m;
}

/// 90 readings under 250 N of the machine with these compliances, with normal noise in m.
std::vector<MeasuredPoint> readings(const std::vector<double>& c, double noise, std::uint64_t seed) {
  Random random(seed);
  std::vector<MeasuredPoint> out;
  for (int plane = 0; plane < 6; ++plane)
    for (int i = 0; i < 15; ++i) {
      MeasuredPoint p;
      p.X_MT.p = Vec3(-0.6 + 0.3 * (i % 5), -1.6 + 0.3 * (i / 5), -0.4 + 0.1 * plane);
      p.force = 250;
      const std::vector<Mat3> unit =
          unit_compliances(lola(), p.X_MT, kinematics::inverse(lola(), p.X_MT).reachable()->joints);
      for (std::size_t k = 0; k < unit.size(); ++k) p.displacement += c[k] * 250 * unit[k];
      for (double& x : p.displacement.reshaped()) x += noise * random.normal();
      out.push_back(p);
    }
  return out;
}

// 400 measurements of one machine: the estimates scatter as the covariance says, the correlations, too. A standard
// deviation of 400 is known to 3.5 %, a correlation to 0.05; three of these.
TEST(Covariance, IsThatOfTheEstimates) {
  constexpr int kTrials = 400;
  constexpr double kDeviation = 0.105, kCorrelation = 0.15;
  const std::vector<double> truth = column_compliances(lola());
  const auto n = std::ssize(truth);
  Eigen::MatrixXd found(n, kTrials), stated = Eigen::MatrixXd::Zero(n, n);
  for (int i = 0; i < kTrials; ++i) {
    const auto r = identify_compliance(lola(), readings(truth, 20e-6, 1 + std::uint64_t(i)));
    ASSERT_TRUE(r) << to_string(r.error());
    found.col(i) = Eigen::Map<const Eigen::VectorXd>(r->compliance.data(), n);
    stated += r->covariance / kTrials;
    for (Eigen::Index k = 0; k < n; ++k)
      ASSERT_NEAR(std::sqrt(r->covariance(k, k)) / r->standard_error[std::size_t(k)], 1, 1e-9);
  }
  const Eigen::MatrixXd off = found.colwise() - found.rowwise().mean();
  const Eigen::MatrixXd sample = off * off.transpose() / (kTrials - 1);
  for (Eigen::Index k = 0; k < n; ++k) {
    EXPECT_NEAR(std::sqrt(sample(k, k) / stated(k, k)), 1, kDeviation) << "joint " << k + 1;
    for (Eigen::Index j = 0; j < k; ++j) {
      const double scale = std::sqrt(stated(k, k) * stated(j, j));
      EXPECT_NEAR(sample(k, j) / scale, stated(k, j) / scale, kCorrelation) << k + 1 << ", " << j + 1;
    }
  }
}

TEST(Covariance, TheGainActsOnAllAlike) {
  constexpr double kGain = 0.03;
  auto r = *identify_compliance(lola(), readings(column_compliances(lola()), 20e-6, 1));
  const Eigen::MatrixXd before = r.covariance;
  const double free = double(r.equations) - double(r.compliance.size());
  const GainEffect effect = add_gain(r, kGain);
  const Eigen::Map<const Eigen::VectorXd> c(r.compliance.data(), std::ssize(r.compliance));
  EXPECT_LT((r.covariance - before - kGain * kGain * c * c.transpose()).norm(), 1e-12 * before.norm());
  for (std::size_t k = 0; k < r.compliance.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    EXPECT_NEAR(std::sqrt(r.covariance(i, i)) / r.standard_error[k], 1, 1e-9);
    // GUM (G.2b) with one part of `free` degrees of freedom and one, the gain's, of infinitely many:
    // nu = u^4 / (u_r^4 / free).
    const double u = r.standard_error[k], of_readings = effect.standard_error_readings[k];
    EXPECT_NEAR(u * u, of_readings * of_readings + std::pow(kGain * r.compliance[k], 2), 1e-9 * u * u);
    const double degrees = u * u * u * u * free / std::pow(of_readings, 4);
    EXPECT_NEAR(effect.degrees[k], degrees, 1e-9 * degrees);
    EXPECT_NEAR(r.half_interval[k], student_95(degrees) * u, 1e-9 * u);
  }
}

// What is held at 0 is not known to be rigid: its covariance is no smaller than what the upper bound leaves open.
TEST(Covariance, WhatIsHeldAtZeroIsNotCertain) {
  std::vector<double> truth = column_compliances(lola());
  truth[1] = 0;
  int held = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto r = *identify_compliance(lola(), readings(truth, 20e-6, seed));
    if (!r.upper_bound[1]) continue;
    ++held;
    EXPECT_EQ(r.standard_error[1], 0);
    EXPECT_GE(2 * std::sqrt(r.covariance(1, 1)), *r.upper_bound[1]);
  }
  EXPECT_GE(held, 3);
}

// What bands along a program rest on: the tip's compliance changes by J_k J_k^T for a unit of compliance k. Differences
// of the whole compliance; where arms share their load it is not linear, and a step of 1e-4 leaves 1e-4.
TEST(Covariance, UnitCompliancesAreDerivatives) {
  for (const char* name : {"lola50", "hexapod-strut", "hexapod-slider", "delta-brno", "delta-linear", "delta-par4"}) {
    SCOPED_TRACE(name);
    const machine::AnyMachine m = *machine::load(name);
    const std::vector<double> c(column_compliances(m).size(), 1e-6);
    const machine::AnyMachine soft = *with_compliances(m, c);
    const Pose X = kinematics::home_pose(m).value_or(Pose{Mat3::Identity(), Vec3(0.1, -1.3, -0.1)});
    const Compliance at = compliance_at(soft, X);
    ASSERT_TRUE(at.reachable);
    const std::vector<Mat3> unit = unit_compliances(soft, X, at.joints);
    ASSERT_EQ(unit.size(), c.size());
    for (std::size_t k = 0; k < c.size(); ++k) {
      std::vector<double> more = c;
      const double step = 1e-4 * c[k];
      more[k] += step;
      const Mat3 change = (compliance_at(*with_compliances(soft, more), X).linear() - at.linear()) / step;
      EXPECT_LT((change - unit[k]).norm(), 3e-4 * unit[k].norm() + 1e-9 * at.linear().norm() / c[k]) << at.joint[k];
    }
  }
}

class CovarianceFile : public ::testing::Test {
 protected:
  CovarianceFile() {
    std::string name = std::filesystem::temp_directory_path() / "polypod-XXXXXX";
    folder_ = ::mkdtemp(name.data());
  }
  ~CovarianceFile() override { std::filesystem::remove_all(folder_); }
  std::string write(const std::string& text) {
    const std::string path = folder_ / "c.csv";
    EXPECT_TRUE(files::write_whole(path, text));
    return path;
  }
  std::filesystem::path folder_;
};

TEST_F(CovarianceFile, ComesBackAsItWas) {
  for (const char* name : {"lola50", "hexapod-strut", "delta-brno", "delta-linear"}) {
    SCOPED_TRACE(name);
    const machine::AnyMachine m = *machine::load(name);
    const Keyed of = keyed_compliances(m);
    const std::vector<bool> turns = column_turns(m);
    const Eigen::Index n = std::ssize(of.keys);
    Eigen::MatrixXd L(n, n);
    Random random(1);
    for (double& x : L.reshaped()) x = random.normal();
    for (Eigen::Index k = 0; k < n; ++k) {
      const bool turn = turns[std::size_t(k)];
      EXPECT_THAT(of.keys[std::size_t(k)], HasSubstr(turn ? "].compliance_rad_per_Nm" : "].compliance_um_per_N"));
      L.row(k) *= turn ? 1e-8 : 1e-9;
    }
    const Eigen::MatrixXd C = L * L.transpose();
    const std::string text = covariance_csv(of, C);
    EXPECT_TRUE(names_compliances(text));
    // The last column is the compliance in the unit that its key names.
    std::vector<double> values(turns.size());
    for (std::size_t k = 0; k < values.size(); ++k) values[k] = (turns[k] ? 1e-7 : 2e-8) * double(k + 1);
    std::istringstream lines(covariance_csv(keyed_compliances(*with_compliances(m, values)), C));
    std::string line;
    std::getline(lines, line);
    EXPECT_THAT(line, ::testing::EndsWith(",value"));
    for (std::size_t k = 0; k < values.size(); ++k) {
      std::getline(lines, line);
      const double said = values[k] * (turns[k] ? 1 : 1e6);  // rad/(N m), or um/N
      EXPECT_NEAR(std::stod(line.substr(line.rfind(',') + 1)), said, 1e-9 * said) << line;
    }
    const auto back = read_covariance(m, write(text));
    ASSERT_TRUE(back) << to_string(back.error());
    const Eigen::VectorXd scale = C.diagonal().cwiseSqrt();
    EXPECT_LT(((*back - C).array() / (scale * scale.transpose()).array()).abs().maxCoeff(), 1e-5);  // six digits
  }
  EXPECT_THAT(covariance_csv(keyed_compliances(lola()), Eigen::MatrixXd::Identity(5, 5)),
              ::testing::StartsWith("parameter,joint[1].compliance_rad_per_Nm,joint[2].compliance_rad_per_Nm,"));
  EXPECT_FALSE(names_compliances("parameter,dh.a[1]_mm,dh.a[2]_mm\n"));
  EXPECT_FALSE(names_compliances(""));
}

TEST_F(CovarianceFile, EveryErrorHasItsLine) {
  const Keyed of = keyed_compliances(lola());
  const std::string good = covariance_csv(of, 1e-16 * Eigen::MatrixXd::Identity(5, 5));
  ASSERT_TRUE(read_covariance(lola(), write(good)));
  const auto replaced = [&](const std::string& from, const std::string& to) {
    std::string out = good;
    out.replace(out.find(from), from.size(), to);
    return out;
  };
  struct Bad {
    std::string text;
    int line;
    const char* says;
  };
  const std::string last = good.substr(0, good.rfind("joint[5]"));
  const Bad cases[] = {
      {"", 1, "ends here"},
      {last, 6, "the covariance of 5 parameters ends here"},
      {replaced(",joint[2]", ",joint[3]"), 1, "joint[3].compliance_rad_per_Nm where joint[2]"},
      {replaced("\njoint[2]", "\njoint[4]"), 3, "joint[4].compliance_rad_per_Nm where joint[2]"},
      {replaced("1e-16", "stiff"), 2, "\"stiff\" is not a finite number"},
      {replaced("1e-16", "nan"), 2, "not a finite number"},
      {replaced("1e-16,", "1e-16,0,"), 2, "more than 5 numbers"},
      {replaced("1e-16,0", "1e-16"), 2, "5 columns for 5 parameters and a value"},
      {replaced("1e-16", "-1e-16"), 2, "no covariance"},
      {replaced("1e-16,0", "1e-16,1e-17"), 2, "no covariance"},
  };
  for (const Bad& bad : cases) {
    SCOPED_TRACE(bad.text);
    const auto r = read_covariance(lola(), write(bad.text));
    ASSERT_FALSE(r);
    EXPECT_EQ(r.error().id, "CA153");
    EXPECT_EQ(r.error().place.line, bad.line);
    EXPECT_THAT(r.error().message, HasSubstr(bad.says));
    EXPECT_THAT(r.error().hint, HasSubstr("identify compliance"));
  }
  EXPECT_EQ(read_covariance(*machine::load("hexapod-strut"), write(good)).error().id, "CA153");
  EXPECT_EQ(read_covariance(lola(), "nowhere.csv").error().id, "FI100");
  // Another machine of the same form: somebody has changed one of its figures since.
  std::vector<double> softer = column_compliances(lola());
  softer[2] *= 1.001;
  const auto other = read_covariance(*with_compliances(lola(), softer), write(good));
  ASSERT_FALSE(other);
  EXPECT_EQ(other.error().id, "CA154");
  EXPECT_EQ(other.error().place.line, 4);
  EXPECT_THAT(other.error().message, HasSubstr("joint[3].compliance_rad_per_Nm is"));
}

}  // namespace
}  // namespace polypod::statics
