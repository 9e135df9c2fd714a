// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// No calibration makes a coordinate of the tool's pose worse than the drawing, or its verdict says no. The oracle is
// the machine that was measured: its pose at places of the workspace that no measurement used, against those of the
// drawing and of the calibrated machine.
//
// The daily list is short; POLYPOD_LONG=1 takes every machine of the catalogue and of the trials, every kind of
// measurement and ten seeds.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cstdlib>

#include "paths.hpp"
#include "polypod/calibration/calibrate.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::calibration {
namespace {

constexpr double kNoise = 20e-6;
constexpr double kNoiseAngle = 35e-6;

/// How many independent places those of one machine are worth: of the coordinates that are told, the mean square over
/// them, over what was foretold, has the median 0.82 and is above 4 in 1.5 % of the machines; chi-square of two
/// freedoms over two has 0.69 and 1.8 %, of three 0.79 and 0.7 %.
constexpr double kPlaces = 2;

struct Case {
  std::string machine;  ///< of the catalogue, or a file of the trials
  Kind kind;
  std::vector<std::uint64_t> seeds;
  double size = 1;  ///< of the machine's errors, over a workshop's; 0.01: it agrees with its drawing to 1 um
};
std::string name(const Case& c) {
  std::string out = c.machine.substr(0, c.machine.find('.')) + "_" + name_of(c.kind);
  if (c.size != 1) out += fmt::format("_{}", c.size);
  for (char& x : out) x = std::isalnum(static_cast<unsigned char>(x)) ? x : '_';
  return out;
}

const std::vector<std::uint64_t> kTen{1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
std::vector<Case> daily_cases() {
  return {{"pi850.toml", Kind::gauge, {9}},
          {"kossel.toml", Kind::gauge, {1, 2}},
          {"hexaglide.toml", Kind::pose, {1, 2, 3}},
          {"hexapod-strut", Kind::point, {1, 2}},
          {"lola50", Kind::gauge, {1}},
          {"lola50", Kind::axis, {1}},
          {"delta-brno", Kind::distance, kTen},
          {"delta-brno", Kind::contact, kTen},
          {"pi850.toml", Kind::distance, kTen},
          {"dynapod", Kind::axis, kTen},
          {"dynapod", Kind::pose, kTen},
          {"hexaglide.toml", Kind::point, {7}},
          {"delta-linear", Kind::contact, {1}},
          {"hexapod-octahedral", Kind::pose, {1}},
          {"hexapod-strut", Kind::contact, {1}},
          {"hexa", Kind::contact, {5}},
          {"hexapod-strut", Kind::point, {1, 2, 3}, 0.01},
          {"delta-linear", Kind::point, {1, 2, 3}, 0.1},
          {"lola50", Kind::pose, {1, 2, 3}, 0.01}};
}
/// None where POLYPOD_LONG is not set.
std::vector<Case> long_cases() {
  if (std::getenv("POLYPOD_LONG") == nullptr) return {};
  std::vector<std::string> machines{"pi850.toml", "kossel.toml", "hexaglide.toml"};
  for (const machine::CatalogueEntry& entry : machine::catalogue()) machines.emplace_back(entry.name);
  std::vector<Case> out;
  for (const std::string& one : machines)
    for (const Kind kind : {Kind::point, Kind::axis, Kind::pose, Kind::distance, Kind::gauge, Kind::contact})
      for (const double size : {1.0, 0.1, 0.01}) out.push_back({one, kind, kTen, size});
  return out;
}

AnyMachine nominal_of(const Case& c) {
  const bool file = c.machine.find('.') != std::string::npos;
  auto m = machine::load(file ? test::source("tests/trials/" + c.machine) : c.machine);
  EXPECT_TRUE(m) << (m ? "" : to_string(m.error()));
  return *m;
}

/// Rows a kind, so that there are well more equations than unknowns.
std::size_t rows_of(Kind kind) {
  switch (kind) {
    case Kind::point:
      return 70;
    case Kind::axis:
    case Kind::pose:
      return 50;
    case Kind::distance:
    case Kind::gauge:
      return 120;
    case Kind::contact:
      break;
  }
  return 160;
}

/// Odd seeds: a workshop's errors; even ones: lengths that are further off, and better angles, so that what the
/// calibration takes for usual is wrong.
AnyMachine truth_of(const AnyMachine& nominal, std::uint64_t seed, double size) {
  const bool usual = seed % 2 == 1;
  auto out = perturbed(nominal, size * (usual ? 0.1e-3 : 0.3e-3), size * units::from_deg(usual ? 0.05 : 0.02), seed);
  EXPECT_TRUE(out) << (out ? "" : to_string(out.error()));
  return *out;
}

/// Places that no measurement used. Where the Jacobian's condition is above 40 the first order does not hold.
std::vector<Stand> places(const AnyMachine& nominal) {
  std::vector<Stand> out = random_stands(nominal, 60, 991);
  std::erase_if(out, [&](const Stand& s) { return kinematics::dexterity(nominal, s.X_MT, s.q).condition > 40; });
  return out;
}

/// Mean square error of each coordinate of the pose that `m` computes, against the true machine; stands where one of
/// them does not assemble, or in another mode, are left out.
struct Errors {
  Eigen::VectorXd before, after, stated;  ///< mean squares: of the drawing, of the calibrated machine, foretold for it
  Eigen::VectorXd ratio;  ///< mean square of error over what was foretold: no nearly singular place outweighs the rest
};
Errors errors(const AnyMachine& nominal, const AnyMachine& truth, const Calibration& c) {
  constexpr double kOtherMode = 20e-3;
  const auto task = kinematics::task(nominal);
  const auto n = static_cast<Eigen::Index>(pose_coordinates(nominal).size());
  Errors out{Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n)};
  int count = 0;
  for (const Stand& s : places(nominal)) {
    const auto real = kinematics::forward(truth, s.q).poses, found = kinematics::forward(c.machine, s.q).poses;
    if (real.empty() || found.empty() || (real[0].p - s.X_MT.p).norm() > kOtherMode) continue;
    const auto S = kinematics::closure_detail::task_rows(task, real[0], 1.0);
    out.before += (S * kinematics::closure_detail::pose_error(task, real[0], s.X_MT)).cwiseAbs2();
    const Eigen::VectorXd after = (S * kinematics::closure_detail::pose_error(task, real[0], found[0])).cwiseAbs2();
    const Eigen::VectorXd stated = pose_deviation(c.machine, found[0], s.q, c.covariance).cwiseAbs2();
    out.after += after;
    out.stated += stated;
    out.ratio += after.cwiseQuotient(stated);
    ++count;
  }
  EXPECT_GT(count, 10);
  for (Eigen::VectorXd* sum : {&out.before, &out.after, &out.stated, &out.ratio}) *sum /= std::max(count, 1);
  return out;
}

class NeverWorse : public testing::TestWithParam<Case> {};
const auto named = [](const auto& one) { return name(one.param); };
INSTANTIATE_TEST_SUITE_P(Daily, NeverWorse, testing::ValuesIn(daily_cases()), named);
INSTANTIATE_TEST_SUITE_P(Long, NeverWorse, testing::ValuesIn(long_cases()), named);
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(NeverWorse);

TEST_P(NeverWorse, NoCoordinateOrTheVerdictSaysNo) {
  const Case& one = GetParam();
  const AnyMachine nominal = nominal_of(one);
  const auto n = static_cast<Eigen::Index>(pose_coordinates(nominal).size());
  Errors all{Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n)};
  int judged = 0, beyond = 0, told = 0, told_worse = 0, opened = 0;
  Eigen::VectorXd known = Eigen::VectorXd::Zero(n), spread = Eigen::VectorXd::Zero(n);
  std::vector<bool> left_open(static_cast<std::size_t>(n), false);
  for (const std::uint64_t seed : one.seeds) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    const AnyMachine truth = truth_of(nominal, seed, one.size);
    SimulationOptions how;
    how.kind = one.kind;
    how.count = rows_of(one.kind);
    how.seed = seed;
    how.noise_position = kNoise;
    how.noise_angle = kNoiseAngle;
    const auto rows = simulate(nominal, truth, how);
    if (!rows && one.kind == Kind::contact && one.machine == "tripod-z3") {
      EXPECT_EQ(rows.error().id, "CA121") << "the tip of a tripod of z, A and B moves with the tilt";
      return;
    }
    ASSERT_TRUE(rows) << to_string(rows.error());
    auto c = calibrate(nominal, *rows);
    if (!c && one.kind == Kind::contact && c.error().id == "CA115") {
      // Contacts at unknown places are missed the less the smaller the machine is: a search that runs after that is
      // refused, and the remedy that the message names works.
      CalibrationOptions stated;
      stated.prior_length = 0.3e-3;
      stated.prior_angle = units::from_deg(0.05);
      c = calibrate(nominal, *rows, stated);
    }
    ASSERT_TRUE(c) << to_string(c.error());
    const Errors e = errors(nominal, truth, *c);
    if (std::getenv("POLYPOD_PRINT") != nullptr) {
      fmt::print("{} seed {}: {} noise {:.2f} rank {} iterations {}\n", name(one), seed, c->verdict.text,
                 c->noise_factor, c->rank, c->iterations);
      for (Eigen::Index k = 0; k < n; ++k)
        fmt::print("   {:8} before {:.5f} after {:.5f} stated {:.5f} | known before {:.5f} after {:.5f}\n",
                   pose_coordinates(nominal)[std::size_t(k)], 1e3 * std::sqrt(e.before[k]), 1e3 * std::sqrt(e.after[k]),
                   1e3 * std::sqrt(e.stated[k]), 1e3 * c->verdict.before.mean[k], 1e3 * c->verdict.after.mean[k]);
    }
    if (c->verdict.answer == Answer::no) continue;
    // A search that ended beside the minimum, say: the answer names it, and what is stated does not hold.
    constexpr double kExplained = 1.5;
    if (c->noise_factor > kExplained) {
      EXPECT_EQ(c->verdict.answer, Answer::partly) << c->noise_factor;
      EXPECT_THAT(c->verdict.text, ::testing::HasSubstr("times the noise"));
      for (Eigen::Index k = 0; k < n; ++k) EXPECT_LT(e.after[k], e.before[k] + 9 * e.stated[k]);
      continue;
    }
    ++judged;
    for (Eigen::Index k = 0; k < n; ++k) {
      const std::string coordinate = pose_coordinates(nominal)[static_cast<std::size_t>(k)];
      const auto& open = c->verdict.left_open;
      const bool is_told = std::find(open.begin(), open.end(), coordinate) == open.end();
      // Three standard deviations, of a mean over places whose errors hang together; five where it is left open (see
      // `beyond`, which counts those above three).
      EXPECT_LT(e.after[k], e.before[k] + (is_told ? 9 : 25) * e.stated[k]) << coordinate;
      EXPECT_LT(e.after[k], 25 * e.stated[k]) << coordinate;
      if (!is_told) left_open[static_cast<std::size_t>(k)] = true;
      told += is_told ? 1 : 0;
      opened += is_told ? 0 : 1;
      told_worse += is_told && e.after[k] > e.before[k] ? 1 : 0;
      beyond += e.after[k] > 9 * e.stated[k] ? 1 : 0;
    }
    const Eigen::ArrayXd drawing = e.before.cwiseMax(c->verdict.before.mean.cwiseAbs2());
    known.array() += (drawing - e.stated.array()).max(0.0);
    spread.array() += 2 / kPlaces * (drawing.square() - e.stated.array().square()).max(0.0);
    all.before += e.before;
    all.after += e.after;
    all.ratio += e.ratio;
  }
  // Normal errors leave three deviations in 0.3 % of the cases. What is left open rests on the size of all errors,
  // known as from four parameters: Student's t with four degrees of freedom leaves them in 4 %, and the coordinates of
  // one machine leave them together.
  EXPECT_LE(beyond, 1 + told / 30 + opened / 10);
  // What is called better is: where a fifth of the deviation is left the drawing is nearer in 12 % of the cases.
  EXPECT_LE(told_worse, 1 + told / 8);
  if (one.size < 1) return;  // too little to tell, or to foretell its size
  if (one.kind == Kind::point || one.kind == Kind::pose || one.kind == Kind::axis) {
    EXPECT_GT(judged, 0);
  }
  // Over the seeds, deviations are as stated. A machine's mean square over the places, over what was foretold, has the
  // mean 1 and spreads as chi-square of kPlaces freedoms, the sum over ten machines as one of twenty, which reaches 2.5
  // times its mean in 0.02 % of the cases: 0.2 of the 900 coordinates of the long list. What is left open rests on the
  // size of all errors, which half of these machines do not have: there twice as much is allowed.
  // A coordinate that is told is nearer than the drawing. One that is left open is off by e after, and by e + m before,
  // with the variances s^2 and b^2 - s^2: the difference of their squares has the mean s^2 - b^2 and the variance
  // 2 (b^4 - s^4) / kPlaces a machine. Four deviations of the sum: again 0.02 %.
  for (Eigen::Index k = 0; k < n && judged >= 6; ++k) {
    const std::string coordinate = pose_coordinates(nominal)[static_cast<std::size_t>(k)];
    const bool open = left_open[static_cast<std::size_t>(k)];
    const double chance = open ? std::max(0.0, 4 * std::sqrt(spread[k]) - known[k]) : 0.1 * all.before[k];
    constexpr double kRounding = 1 + 1e-9;  // a coordinate that no parameter moves is as far as it was
    EXPECT_LE(all.after[k], (all.before[k] + chance) * kRounding) << coordinate;
    EXPECT_LT(all.ratio[k], (open ? 5 : 2.5) * judged) << coordinate;
  }
}

}  // namespace
}  // namespace polypod::calibration
