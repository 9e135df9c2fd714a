// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/calibrate.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <filesystem>

#include "model.hpp"
#include "polypod/calibration/poses.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::calibration {
namespace {

using testing::HasSubstr;
using testing::Values;

constexpr double kNoise = 20e-6;         // a laser tracker, m a coordinate
constexpr double kLengthError = 0.1e-3;  // a workshop's, m
constexpr double kAngleError = 1e-3;     // rad

AnyMachine named(const std::string& name) {
  return *machine::load(name);
}
AnyMachine off(const AnyMachine& m, std::uint64_t seed = 7) {
  auto out = perturbed(m, kLengthError, kAngleError, seed);
  EXPECT_TRUE(out) << (out ? "" : to_string(out.error()));
  return *out;
}
std::vector<Measurement> measured(const AnyMachine& nominal, const AnyMachine& truth, Kind kind, std::size_t count,
                                  double noise, std::uint64_t seed = 3,
                                  const std::function<void(SimulationOptions&)>& change = {}) {
  SimulationOptions o;
  o.kind = kind;
  o.count = count;
  o.seed = seed;
  o.noise_position = noise;
  o.noise_angle = noise;  // of a target one metre across
  if (change) change(o);
  auto rows = simulate(nominal, truth, o);
  EXPECT_TRUE(rows) << (rows ? "" : to_string(rows.error()));
  return *rows;
}

/// Stands that no measurement used. Those where the Jacobian's condition is above 20 are left out: there the rails'
/// machine amplifies whatever noise is left.
std::vector<Stand> good_places(const AnyMachine& m) {
  std::vector<Stand> stands = random_stands(m, 200, 991);
  std::erase_if(stands, [&](const Stand& s) { return kinematics::dexterity(m, s.X_MT, s.q).condition > 20; });
  EXPECT_GT(stands.size(), 100u);
  return stands;
}

/// By how much two machines put their tools apart at good_places: root of the mean square of a coordinate, m; `aligned`
/// after the best common motion of all places.
double apart(const AnyMachine& a, const AnyMachine& b, bool aligned = false) {
  const std::vector<Stand> stands = good_places(a);
  Eigen::Matrix3Xd from(3, stands.size()), to(3, stands.size());
  for (std::size_t i = 0; i < stands.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = kinematics::forward(a, stands[i].q).poses.at(0).p;
    to.col(static_cast<Eigen::Index>(i)) = kinematics::forward(b, stands[i].q).poses.at(0).p;
  }
  if (aligned) {
    const Eigen::Matrix4d T = Eigen::umeyama(from, to, false);
    from = (T.topLeftCorner<3, 3>() * from).colwise() + T.topRightCorner<3, 1>().eval();
  }
  return (from - to).norm() / std::sqrt(double(from.size()));
}

Calibration calibrated(const AnyMachine& nominal, const std::vector<Measurement>& rows,
                       const CalibrationOptions& options = {}) {
  auto out = calibrate(nominal, rows, options);
  EXPECT_TRUE(out) << (out ? "" : to_string(out.error()));
  return out ? *out : Calibration{};
}

class EveryFamily : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Catalogue, EveryFamily,
                         Values("hexapod-strut", "hexapod-slider", "lola50", "hexapod-octahedral", "hexapod-hexam",
                                "delta-brno", "delta-linear"));

TEST_P(EveryFamily, ParametersGoInAndComeOut) {
  const AnyMachine m = named(GetParam());
  std::vector<double> p;
  for (const auto& parameter : kinematics::parameters(m)) p.push_back(parameter.value);
  const auto same = machine::with_parameters(m, p);
  ASSERT_TRUE(same) << to_string(same.error());
  EXPECT_EQ(machine::to_toml(*same), machine::to_toml(m));

  const AnyMachine moved = off(m);
  const auto read = machine::from_text(machine::to_toml(moved), "moved.toml");
  ASSERT_TRUE(read) << to_string(read.error());
  const auto a = kinematics::parameters(moved), b = kinematics::parameters(*read);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i].value, b[i].value, 1e-11) << a[i].key;
  EXPECT_EQ(machine::with_parameters(m, std::vector<double>(3)).error().id, "MA105");
}

// What the fit computed of the last row is what the machine that it gives back does: no direction of a rail has another
// length in the one than in the other, in stages neither.
class GivenBack : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Catalogue, GivenBack,
                         Values("hexapod-slider", "delta-linear", "tripod-z3", "tricept", "tricept-wrist", "dynapod"));

TEST_P(GivenBack, TheMachineHasTheResidualsOfTheFit) {
  const AnyMachine nominal = named(GetParam()), truth = off(nominal, 3);
  const auto rows = measured(nominal, truth, Kind::point, 60, kNoise);
  const auto c = calibrate(nominal, rows);
  ASSERT_TRUE(c) << to_string(c.error());
  constexpr double kSame = 1e-6;  // m; rules hold to 1e-7 of a rail's length
  for (const RowResidual& r : c->residuals) {
    if (r.lost) continue;
    const auto at = kinematics::forward(c->machine, rows[r.row].q).poses;
    ASSERT_FALSE(at.empty());
    const Vec3 residual = (c->X_SM * at[0] * c->X_TR).p - rows[r.row].X_SR.p;
    EXPECT_LT((residual - r.after.head<3>()).norm(), kSame) << "row " << r.row;
  }
}

TEST_P(EveryFamily, ChangedMachinesKeepTheirInvariants) {
  const AnyMachine m = off(named(GetParam()), 21);
  for (const Stand& stand : random_stands(m, 20, 5)) {
    std::visit(
        [&](const auto& family) {
          const auto p = kinematics::nominal_parameters(family);
          const auto F =
              closure(family, stand.X_MT, std::span<const double>(stand.q.data(), std::size_t(stand.q.size())),
                      std::span<const double>(p));
          EXPECT_LT(F.cwiseAbs().maxCoeff(), 1e-11);
        },
        m);
    const auto inverse = kinematics::inverse(m, stand.X_MT);
    const bool found = std::any_of(inverse.solutions.begin(), inverse.solutions.end(),
                                   [&](const auto& s) { return (s.joints - stand.q).norm() < 1e-7; });
    EXPECT_TRUE(found) << GetParam();
  }
}

// Every kind of measurement, every unknown, against central differences.
TEST_P(EveryFamily, DerivativesAgainstDifferences) {
  const AnyMachine machine = off(named(GetParam()));
  const std::vector<Stand> stands = random_stands(machine, 3, 11);
  Random random(5);
  std::vector<Measurement> rows;
  for (const Kind kind : {Kind::point, Kind::axis, Kind::pose, Kind::distance, Kind::gauge, Kind::contact}) {
    for (const Stand& stand : stands) {
      Measurement row;
      row.kind = kind;
      row.q = stand.q;
      row.X_SR = stand.X_MT;
      row.X_SR.p += Vec3(1e-3, -2e-3, 3e-3);
      row.X_SR.R = rotation_of(Vec3(0.1, -0.2, 0.3)) * row.X_SR.R;
      row.anchor_S = Vec3(0.1, -0.3, 0.05);
      row.normal_S = Vec3(1, 2, 3).normalized();
      row.reading = 0.3;
      row.contact = "a";
      rows.push_back(row);
    }
  }
  const Noise noise{1, 1};
  const auto nominal = kinematics::parameters(machine);
  const Layout layout = layout_of(rows, nominal.size());
  Eigen::VectorXd x(layout.count);
  for (double& value : x) value = 0.05 * random.normal();
  for (std::size_t i = 0; i < nominal.size(); ++i) x[layout.parameters + int(i)] = nominal[i].value;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Pose seed = stands[i % stands.size()].X_MT;
    Equations e, low, high;
    ASSERT_TRUE(equations_of(machine, rows[i], seed, layout, x, noise, true, e));
    constexpr double kStep = 1e-6;
    for (int j = 0; j < layout.count; ++j) {
      Eigen::VectorXd y = x;
      y[j] = x[j] + kStep;
      ASSERT_TRUE(equations_of(machine, rows[i], seed, layout, y, noise, false, high));
      y[j] = x[j] - kStep;
      ASSERT_TRUE(equations_of(machine, rows[i], seed, layout, y, noise, false, low));
      const Eigen::VectorXd difference = (high.r - low.r) / (2 * kStep);
      EXPECT_LT((difference - e.J.col(j)).norm(), 2e-6 * (1 + e.J.col(j).norm()))
          << name_of(rows[i].kind) << ", unknown " << j << " of " << layout.count;
    }
  }
}

// Without noise the parameters that points tell give the very machine back, wherever its tool goes.
TEST_P(EveryFamily, ExactPointsGiveTheExactMachine) {
  const AnyMachine nominal = named(GetParam()), truth = off(nominal);
  CalibrationOptions exact;
  exact.noise_position = 1e-9;  // or what hides in 20 um would be held
  const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::point, 120, 0), exact);
  EXPECT_GT(apart(nominal, truth), 50e-6);
  EXPECT_LT(apart(c.machine, truth), 1e-8);
  EXPECT_LT(c.held_back.rms_after, 1e-8);
  EXPECT_GT(c.held_back.rows, 0u);
}

/// What normal noise of the rows leaves of the model's error over `places`, m a coordinate, rms: from the equations
/// alone, sigma^2 trace(J_i (J^T J)^-1 J_i^T).
double predicted(const AnyMachine& m, const Calibration& c, const std::vector<Measurement>& rows,
                 const std::vector<Stand>& places) {
  CalibrationOptions options;
  options.noise_position = kNoise;
  Candidates told;
  for (const Estimate& p : c.parameters)
    if (p.identifiable) told.unknowns.push_back(p.key);
  std::vector<Stand> stands;
  for (const Measurement& row : rows) stands.push_back({row.q, kinematics::forward(m, row.q).poses.at(0)});
  return kNoise * uncertainty(geometry_equations(m, stands, Kind::point, {}, options, told),
                              geometry_equations(m, places, Kind::point, {}, options, told))
                      .reading;
}

// A laser tracker's 70 points: what is left at places that were not measured is what the tracker's noise leaves there,
// and below it. The size of an error with n parts spreads by 1 / sqrt(2 n) if all parts count alike; here a few
// count more, so half of it is allowed.
TEST_P(EveryFamily, SeventyPointsBringTheErrorDownToTheNoise) {
  const AnyMachine nominal = named(GetParam()), truth = off(nominal);
  CalibrationOptions all;
  all.hold_back = 0;
  const auto rows = measured(nominal, truth, Kind::point, 70, kNoise);
  const Calibration c = calibrated(nominal, rows, all);
  const double expected = predicted(nominal, c, rows, good_places(nominal));
  EXPECT_LT(apart(c.machine, truth), 1.5 * expected);
  EXPECT_GT(apart(c.machine, truth), 0.5 * expected);
  EXPECT_LT(expected, kNoise);
  EXPECT_NEAR(c.noise_factor, 1, 0.2);  // 140 to 190 free equations: three standard deviations
  const Calibration held = calibrated(nominal, measured(nominal, truth, Kind::point, 70, kNoise));
  EXPECT_EQ(held.held_back.rows, 14u);
  EXPECT_LT(held.held_back.rms_after, 2 * kNoise);
  EXPECT_GT(held.held_back.rms_before, 4 * held.held_back.rms_after);
}

// The closures say how many there must be: a strut machine has 43, the tool's length only moves the platform's joints
// along z; points at the tip do not see the platform's frame turn about it. Rails: 61 less the same.
TEST(Calibrate, RankIsWhatTheGeometrySays) {
  const AnyMachine strut = named("hexapod-strut"), slider = named("hexapod-slider"), lola = named("lola50");
  EXPECT_EQ(calibrated(strut, measured(strut, off(strut), Kind::pose, 70, kNoise)).rank, 42u);
  EXPECT_EQ(calibrated(strut, measured(strut, off(strut), Kind::point, 70, kNoise)).rank, 39u);
  EXPECT_EQ(calibrated(slider, measured(slider, off(slider), Kind::pose, 70, kNoise)).rank, 60u);
  const Calibration arm = calibrated(lola, measured(lola, off(lola), Kind::point, 70, kNoise));
  // Axes 2 and 3 are parallel: d_3 acts like d_2. The turn of the last frame about the tool does not move its tip.
  EXPECT_EQ(arm.rank, 18u);
  for (const Estimate& p : arm.parameters) {
    EXPECT_EQ(p.identifiable, p.key != "dh[3].d" && p.key != "dh[5].alpha") << p.key;
    if (p.key != "dh[3].d") continue;
    ASSERT_EQ(p.like.size(), 1u);
    EXPECT_EQ(p.like[0].key, "dh[2].d");
    EXPECT_NEAR(p.like[0].factor, 1, 1e-6);
  }
}

TEST(Calibrate, FrameTakesSixFreedomsOfTheMachine) {
  const AnyMachine nominal = named("hexapod-strut"), truth = off(nominal);
  const Pose X_SM{rotation_abc(0.3, -0.7, 2.1), Vec3(1.5, -0.4, 0.8)};
  CalibrationOptions o;
  o.estimate_frame = true;
  const Calibration c = calibrated(
      nominal, measured(nominal, truth, Kind::pose, 70, kNoise, 3, [&](SimulationOptions& s) { s.X_SM = X_SM; }), o);
  EXPECT_EQ(c.rank, 36u);
  EXPECT_LT(apart(c.machine, truth, true), kNoise);
  EXPECT_LT(c.held_back.rms_after, 2 * kNoise);
  EXPECT_GT(c.frame_error.minCoeff(), 0);
}

TEST(Calibrate, TheTargetOnTheToolIsFound) {
  const AnyMachine nominal = named("lola50");
  const Vec3 p_TR(12e-3, -7e-3, 30e-3);
  CalibrationOptions o;
  o.estimate_target = true;
  o.hold = {"dh"};
  const Calibration c = calibrated(
      nominal, measured(nominal, nominal, Kind::point, 30, kNoise, 3, [&](SimulationOptions& s) { s.X_TR.p = p_TR; }),
      o);
  EXPECT_LT((c.X_TR.p - p_TR).norm(), 4 * c.target_error.head<3>().norm());
  EXPECT_LT(c.target_error.head<3>().norm(), kNoise);
  EXPECT_EQ(c.rank, 0u);
}

// A ball-bar from three balls, 210 readings.
TEST(Calibrate, BallBarAlone) {
  const AnyMachine nominal = named("hexapod-strut"), truth = off(nominal);
  const auto balls = [](SimulationOptions& s) {
    s.anchors = {Vec3(0.2, 0, 0), Vec3(-0.1, 0.17, 0), Vec3(-0.1, -0.17, 0.05)};
  };
  const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::distance, 210, kNoise, 3, balls));
  EXPECT_LT(apart(c.machine, truth), 3 * kNoise);
  EXPECT_LT(c.held_back.rms_after, 3 * kNoise);
  EXPECT_EQ(c.rank, 39u);
}

// The same for other families, their balls within their own reach, over several workshops and days.
TEST(Calibrate, BallBarAloneForOtherFamilies) {
  struct Case {
    const char* machine;
    std::vector<Vec3> balls;
    std::size_t rank;
  };
  const std::vector<Case> cases{{"delta-brno", {{0.3, 0, 0.5}, {-0.15, 0.26, 0.5}, {-0.15, -0.26, 0.55}}, 21},
                                {"delta-linear", {{0.3, 0, 0.5}, {-0.15, 0.26, 0.5}, {-0.15, -0.26, 0.55}}, 21},
                                {"lola50", {{0.6, -0.8, -0.5}, {-0.6, -0.8, -0.5}, {0, -2, -0.45}}, 18},
                                {"hexapod-slider", {{0.2, 0, 0}, {-0.1, 0.17, 0}, {-0.1, -0.17, 0.05}}, 57}};
  for (const Case& one : cases) {
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      SCOPED_TRACE(fmt::format("{} {}", one.machine, seed));
      const AnyMachine nominal = named(one.machine), truth = off(nominal, seed);
      const auto balls = [&](SimulationOptions& s) { s.anchors = one.balls; };
      const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::distance, 210, kNoise, seed, balls));
      EXPECT_LT(c.held_back.rms_after, 2 * kNoise);
      EXPECT_LT(apart(c.machine, truth), 3 * kNoise);
      EXPECT_EQ(c.rank, one.rank);
    }
  }
}

/// The change that was found, along the change that nothing shows: the untold parameter by 1 and those that it acts
/// like by what takes it back, both in units of the priors; as a share of the whole change. 0: the least change among
/// equal machines.
double along(const Calibration& c, const Estimate& untold) {
  double product = 0, change = 0, direction = 0;
  for (std::size_t i = 0; i < c.parameters.size(); ++i) {
    const Estimate& p = c.parameters[i];
    double unseen = p.key == untold.key ? 1 : 0;
    for (const Like& like : untold.like) unseen -= like.key == p.key ? like.factor : 0;
    const double prior = c.prior[static_cast<Eigen::Index>(i)];
    product += unseen / prior * (p.value - p.nominal) / prior;
    change += std::pow((p.value - p.nominal) / prior, 2);
    direction += std::pow(unseen / prior, 2);
  }
  return std::abs(product) / std::sqrt(change * direction);
}

// From one ball alone nobody sees the machine turn about it: three directions fewer, and they are named. (Motion
// across the bar shows only through the machine's stiffness of form: places stay less certain than distances.)
TEST(Calibrate, OneBallCannotSeeTheMachineTurnAboutIt) {
  const AnyMachine nominal = named("hexapod-strut"), truth = off(nominal);
  const auto ball = [](SimulationOptions& s) { s.anchors = {Vec3(0.06, 0, 0)}; };
  const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::distance, 210, kNoise, 3, ball));
  EXPECT_EQ(c.rank, 36u);
  int untold = 0;
  for (const Estimate& p : c.parameters) {
    if (p.identifiable) continue;
    ++untold;
    EXPECT_FALSE(p.like.empty()) << p.key;
    EXPECT_LT(along(c, p), 0.02) << p.key;
  }
  EXPECT_EQ(untold, 7);
  EXPECT_LT(c.held_back.rms_after, 3 * kNoise);
}

TEST(Calibrate, GaugesOnThreePlanesAndContacts) {
  const AnyMachine nominal = named("lola50"), truth = off(nominal);
  std::vector<Measurement> rows = measured(nominal, truth, Kind::gauge, 150, kNoise);
  for (std::size_t i = 0; i < rows.size(); ++i) {  // the same readings of three planes
    const Vec3 tip = kinematics::forward(truth, rows[i].q).poses.at(0).p;
    const double noise = rows[i].reading - tip.z();
    rows[i].normal_S = Vec3::Unit(static_cast<int>(i % 3));
    rows[i].reading = tip[static_cast<int>(i % 3)] + noise;
  }
  EXPECT_LT(apart(calibrated(nominal, rows).machine, truth), 2 * kNoise);

  // A socket that is touched again and again tells shapes, but no unit of length and no place: what it hardly tells
  // needs a prior.
  CalibrationOptions o;
  o.prior_length = kLengthError;
  o.prior_angle = kAngleError;
  o.hold_back = 0;
  const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::contact, 200, kNoise), o);
  EXPECT_LT(c.fitted.rms_after, 1.2 * kNoise);
  EXPECT_LT(apart(c.machine, truth, true), 0.5 * apart(nominal, truth, true));
}

// Some rows of these stand where an error of a tenth of a millimetre moves the tool by two, to the other side of a fold
// or where the machine does not close: they are marked, and the rest gives the machine.
TEST(Calibrate, RowsNearSingularPosesAreLeftOutAndNamed) {
  const AnyMachine nominal = named("hexapod-slider");
  std::size_t lost = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const AnyMachine truth = *perturbed(nominal, kLengthError, units::from_deg(0.05), seed);
    const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::point, 70, kNoise, seed));
    EXPECT_LT(c.held_back.rms_after, 2 * kNoise) << seed;
    EXPECT_NEAR(c.noise_factor, 1, 0.25) << seed;
    for (const RowResidual& r : c.residuals) {
      lost += r.lost ? 1 : 0;
      EXPECT_TRUE(!r.lost || (r.outlier && r.weight == 0)) << seed;
    }
  }
  EXPECT_GT(lost, 0u);
  EXPECT_LT(lost, 6u);
}

// Points leave the tilt of the platform open, poses do not; of a delta there is nothing to tell. What is left open is
// not worse than in the drawing (before, the parameters that were held left all of it to the others).
TEST(Calibrate, SaysWhetherTheOrientationIsTold) {
  const AnyMachine strut = named("hexapod-strut"), delta = named("delta-brno");
  EXPECT_TRUE(calibrated(strut, measured(strut, off(strut), Kind::pose, 70, kNoise)).orientation_told);
  EXPECT_TRUE(calibrated(delta, measured(delta, off(delta), Kind::point, 70, kNoise)).orientation_told);
  const AnyMachine truth = off(strut);
  const Calibration points = calibrated(strut, measured(strut, truth, Kind::point, 70, kNoise));
  EXPECT_FALSE(points.orientation_told);
  EXPECT_EQ(points.verdict.answer, Answer::partly);
  EXPECT_THAT(points.verdict.text, HasSubstr("measure poses"));
  const auto tilt = [&](const AnyMachine& m) {
    double sum = 0;
    for (const Stand& stand : good_places(strut)) {
      const Mat3 a = kinematics::forward(m, stand.q).poses.at(0).R;
      const Mat3 b = kinematics::forward(truth, stand.q).poses.at(0).R;
      sum += rotation_vector(a * b.transpose()).squaredNorm();
    }
    return std::sqrt(sum);
  };
  EXPECT_LT(tilt(points.machine), tilt(strut));
}

// The covariance of the pose is that of the machines which the noise gives: against 60 calibrations of one machine's
// readings with other noise, whose spread about the truth it foretells where the data tell the coordinate.
TEST(Verdict, TheDeviationOfThePoseIsTheSpreadOfCalibrations) {
  const AnyMachine nominal = named("lola50"), truth = off(nominal);
  CalibrationOptions o;
  o.hold_back = 0;
  const std::vector<Stand> stands = random_stands(nominal, 10, 77);
  double seen = 0, stated = 0;
  for (std::uint64_t trial = 0; trial < 60; ++trial) {
    const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::point, 40, kNoise, 300 + trial), o);
    for (const Stand& s : stands) {
      const Vec3 p = kinematics::forward(truth, s.q).poses.at(0).p;
      seen += (kinematics::forward(c.machine, s.q).poses.at(0).p - p).squaredNorm();
      stated += pose_deviation(nominal, s.X_MT, s.q, c.covariance).head<3>().squaredNorm();
    }
  }
  EXPECT_NEAR(std::sqrt(seen / stated), 1, 0.15);  // 60 trials of about ten free numbers spread by 4 %
}

// Readings that are not of this machine: the answer is no, though the residuals grow smaller.
TEST(Verdict, ResidualsFarAboveTheNoiseAreANo) {
  const AnyMachine nominal = named("lola50");
  auto bent = measured(nominal, off(nominal), Kind::point, 70, kNoise, 3);  // what no rigid machine does
  for (Measurement& row : bent) row.X_SR.p.z() += 1e-3 * std::pow(row.X_SR.p.x(), 3);
  const auto c = calibrate(nominal, bent);
  ASSERT_TRUE(c) << to_string(c.error());
  EXPECT_EQ(c->verdict.answer, Answer::no);
  EXPECT_THAT(c->verdict.text, HasSubstr("times the noise"));
}

// Nothing is wrong with the machine: nothing can be made better.
TEST(Verdict, AMachineThatIsAsDrawnIsNotMadeBetter) {
  const AnyMachine nominal = named("hexapod-strut");
  int better = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const Calibration c = calibrated(nominal, measured(nominal, nominal, Kind::point, 70, kNoise, seed));
    better += c.verdict.answer == Answer::better ? 1 : 0;
    EXPECT_LT(apart(c.machine, nominal), 0.5 * kNoise) << seed;
  }
  EXPECT_EQ(better, 0);
}

// What no machine like this one can have moved is refused: coordinates swapped, a frame that is not the given one.
TEST(Calibrate, HopelessResidualsAreRefused) {
  const AnyMachine lola = named("lola50");
  auto rows = measured(lola, off(lola), Kind::point, 70, kNoise);
  for (Measurement& row : rows) std::swap(row.X_SR.p.x(), row.X_SR.p.y());
  const auto swapped = calibrate(lola, rows);
  ASSERT_FALSE(swapped);
  EXPECT_EQ(swapped.error().id, "CA119");
  EXPECT_THAT(swapped.error().hint, HasSubstr("x_mm and y_mm exchanged"));
  const auto elsewhere = measured(lola, off(lola), Kind::point, 70, kNoise, 3, [](SimulationOptions& s) {
    s.X_SM = {rotation_z(0.5), Vec3(1, -0.5, 0.3)};
  });
  EXPECT_EQ(calibrate(lola, elsewhere).error().id, "CA118");
}

TEST(Calibrate, OutliersAreFlaggedAndPullLittle) {
  const AnyMachine nominal = named("lola50"), truth = off(nominal);
  const auto bad = [](SimulationOptions& s) { s.outliers = 0.05; };
  const std::vector<Measurement> clean = measured(nominal, truth, Kind::point, 100, kNoise);
  const std::vector<Measurement> rows = measured(nominal, truth, Kind::point, 100, kNoise, 3, bad);
  double with_loss = 0;
  for (const Loss loss : {Loss::huber, Loss::cauchy}) {
    CalibrationOptions o;
    o.loss = loss;
    const Calibration c = calibrated(nominal, rows, o);
    EXPECT_EQ(c.residuals.size(), rows.size());
    std::size_t spoilt = 0;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const bool is_off = (rows[i].X_SR.p - clean[i].X_SR.p).norm() > 0.5e-3;
      spoilt += is_off ? 1 : 0;
      EXPECT_EQ(c.residuals[i].outlier, is_off) << i;
    }
    EXPECT_GT(spoilt, 1u);
    with_loss = std::max(with_loss, apart(c.machine, truth));
    EXPECT_LT(with_loss, kNoise);
  }
  CalibrationOptions plain;
  plain.loss = Loss::none;
  EXPECT_GT(apart(calibrated(nominal, rows, plain).machine, truth), 1.5 * with_loss);
}

// Standard errors mean what they say: of 200 x 18 intervals of two of them, 95 % hold the truth (2.5 % is far more than
// the count's own spread of 0.4 %; the errors of one trial hang together).
TEST(Calibrate, StandardErrorsCoverTheTruth) {
  const AnyMachine nominal = named("lola50"), truth = off(nominal);
  const auto p = kinematics::parameters(truth), n = kinematics::parameters(nominal);
  CalibrationOptions o;
  o.hold_back = 0;
  int covered = 0, count = 0;
  for (std::uint64_t trial = 0; trial < 200; ++trial) {
    const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::point, 40, kNoise, 100 + trial), o);
    for (std::size_t i = 0; i < p.size(); ++i) {
      if (!c.parameters[i].identifiable) continue;
      double wanted = p[i].value;
      if (p[i].key == "dh[2].d") wanted += p[10].value - n[10].value;  // it takes on the error of dh[3].d, nearly
      if (p[i].key == "dh[2].d") continue;
      covered += std::abs(c.parameters[i].value - wanted) < 1.984 * c.parameters[i].standard_error ? 1 : 0;
      ++count;
    }
  }
  EXPECT_NEAR(double(covered) / count, 0.95, 0.025);
}

TEST(Calibrate, PriorsAndBoundsHold) {
  const AnyMachine nominal = named("hexapod-strut"), truth = off(nominal);
  const auto rows = measured(nominal, truth, Kind::point, 10, kNoise);  // 30 equations for 43 unknowns
  CalibrationOptions o;
  o.prior_length = kLengthError;
  o.prior_angle = kAngleError;
  const Calibration with_priors = calibrated(nominal, rows, o);
  EXPECT_LE(with_priors.rank, 30u);  // what the measurements tell; priors tell nothing
  EXPECT_LT(apart(with_priors.machine, truth), 0.7 * apart(nominal, truth));

  CalibrationOptions bounded;
  bounded.bound_length = 0.05e-3;
  int at_bound = 0;
  for (const Estimate& p : calibrated(nominal, measured(nominal, truth, Kind::point, 70, kNoise), bounded).parameters) {
    EXPECT_LE(std::abs(p.value - p.nominal), 0.05e-3 + 1e-12) << p.key;
    EXPECT_EQ(p.at_bound, std::abs(p.value - p.nominal) > 0.0499999e-3) << p.key;
    at_bound += p.at_bound ? 1 : 0;
  }
  EXPECT_GT(at_bound, 5);  // errors of 0.1 mm, twice the bound
  for (const Estimate& p : with_priors.parameters) EXPECT_FALSE(p.at_bound) << p.key;
}

TEST(Calibrate, ChosenParametersOnly) {
  const AnyMachine nominal = named("hexapod-strut"), truth = off(nominal);
  CalibrationOptions o;
  o.only = {"leg.length", "base"};
  o.hold = {"base.joint[2]"};
  const Calibration c = calibrated(nominal, measured(nominal, truth, Kind::point, 70, kNoise), o);
  EXPECT_EQ(c.parameters.size(), 21u);
  const auto before = kinematics::parameters(nominal), after = kinematics::parameters(c.machine);
  for (std::size_t i = 0; i < before.size(); ++i) {
    const bool mine = before[i].key.rfind("leg.length", 0) == 0 ||
                      (before[i].key.rfind("base.joint", 0) == 0 && before[i].key.rfind("base.joint[2]", 0) != 0);
    if (!mine) {
      EXPECT_NEAR(after[i].value, before[i].value, 1e-12) << before[i].key;
    }
  }
  CalibrationOptions wrong;
  wrong.only = {"elbow"};
  EXPECT_EQ(calibrate(nominal, measured(nominal, truth, Kind::point, 70, kNoise), wrong).error().id, "CA114");
}

TEST(Calibrate, ACommandForTheNominalControllerBringsTheRealToolThere) {
  for (const char* name : {"hexapod-strut", "hexapod-slider", "lola50"}) {
    const AnyMachine nominal = named(name), real = off(nominal);
    int reached = 0;
    for (const Stand& stand : random_stands(nominal, 20, 17)) {
      const Pose wanted = kinematics::pose_of(kinematics::task(nominal),
                                              kinematics::coordinates_of(kinematics::task(nominal), stand.X_MT));
      const CorrectedTarget c = corrected_target(nominal, real, wanted);
      if (!c.reached) continue;
      ++reached;
      const Pose got =
          kinematics::forward(real, kinematics::inverse(nominal, c.command).reachable()->joints).poses.at(0);
      EXPECT_LT((got.p - wanted.p).norm(), 1e-9) << name;
      EXPECT_LT((got.R.col(2) - wanted.R.col(2)).norm(), 1e-9) << name;
      EXPECT_GT((c.command.p - wanted.p).norm(), 1e-6) << name;
    }
    EXPECT_GT(reached, 15) << name;
  }
}

TEST(Calibrate, WhatCannotBeIsNamed) {
  const AnyMachine m = named("hexapod-strut"), truth = off(m);
  const auto rows = measured(m, truth, Kind::point, 70, kNoise);
  EXPECT_EQ(calibrate(m, {}).error().id, "CA110");
  auto um = rows;
  for (Measurement& row : um) row.X_SR.p *= 1000;
  const auto wrong_unit = calibrate(m, um);
  ASSERT_FALSE(wrong_unit);
  EXPECT_EQ(wrong_unit.error().id, "CA113");
  EXPECT_THAT(wrong_unit.error().message, HasSubstr("1e+03"));
  std::vector<Measurement> line(60, rows[0]);  // all legs alike: straight up and down
  for (std::size_t i = 0; i < line.size(); ++i) {
    line[i].q = kinematics::inverse(m, Pose{Mat3::Identity(), Vec3(0, 0, 0.07 + 1e-4 * double(i))}).solutions[0].joints;
    line[i].X_SR.p = Vec3(0, 0, 0.07 + 1e-4 * double(i));
  }
  EXPECT_EQ(calibrate(m, line).error().id, "CA112");
  auto torn = rows;
  torn[3].q[0] = 0.2;
  const auto without = calibrate(m, torn);  // left out and named
  ASSERT_TRUE(without) << to_string(without.error());
  ASSERT_EQ(without->residuals.size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(without->residuals[i].row, i);
    EXPECT_EQ(without->residuals[i].untaken, i == 3);
  }
  EXPECT_LT(without->held_back.rms_after, 2 * kNoise);
  for (std::size_t i = 0; i < 10; ++i) torn[i].q[0] = 0.2;
  EXPECT_EQ(calibrate(m, torn).error().id, "CA111");
  CalibrationOptions o;
  o.noise_position = 0;
  EXPECT_EQ(calibrate(m, rows, o).error().id, "CA116");
  o = {};
  o.estimate_frame = true;  // and the place: nine unknowns without a prior
  EXPECT_EQ(calibrate(m, measured(m, truth, Kind::contact, 2, kNoise), o).error().id, "CA110");
  auto once = measured(m, truth, Kind::contact, 80, kNoise);
  once[0].contact = "alone";
  EXPECT_EQ(calibrate(m, once).error().id, "CA117");
}

// Every touch of a place has the tip of the true machine there; two rows of a tripod were 37 mm apart.
TEST(Measurements, ContactsTouchOnePlace) {
  for (const char* name : {"hexapod-strut", "lola50", "delta-linear", "tricept"}) {
    const AnyMachine m = named(name), truth = off(m);
    std::map<std::string, Vec3> place;
    for (const Measurement& row : measured(m, truth, Kind::contact, 24, kNoise)) {
      const auto at = kinematics::forward(truth, row.q);
      ASSERT_FALSE(at.poses.empty()) << name;
      const auto [seen, first] = place.emplace(row.contact, at.poses.front().p);
      if (!first) {
        EXPECT_LT((at.poses.front().p - seen->second).norm(), 8 * kNoise) << name;
      }
    }
    EXPECT_GT(place.size(), 1u);
  }
  SimulationOptions how;
  how.kind = Kind::contact;
  const auto tilting = simulate(named("tripod-z3"), named("tripod-z3"), how);
  ASSERT_FALSE(tilting) << "its tip moves with the tilt";
  EXPECT_EQ(tilting.error().id, "CA121");
}

TEST(Measurements, FilesGoOutAndComeBack) {
  const AnyMachine m = named("lola50");
  const std::string path = std::filesystem::temp_directory_path() / ("polypod-measured-" + std::to_string(::getpid()));
  for (const Kind kind : {Kind::point, Kind::axis, Kind::pose, Kind::distance, Kind::gauge, Kind::contact}) {
    const auto rows = measured(m, m, kind, 12, kNoise);
    ASSERT_TRUE(files::write_whole(path, measurements_csv(m, rows)));
    const auto back = read_measurements(m, path);
    ASSERT_TRUE(back) << to_string(back.error());
    ASSERT_EQ(back->size(), rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Measurement &a = rows[i], &b = (*back)[i];
      EXPECT_EQ(a.kind, b.kind);
      EXPECT_LT((a.q - b.q).norm(), 1e-9);
      EXPECT_NEAR(a.reading, b.reading, 1e-9);
      EXPECT_EQ(a.contact, b.contact);
      if (kind < Kind::distance) {
        EXPECT_LT((a.X_SR.p - b.X_SR.p).norm(), 1e-9);
      }
      if (kind == Kind::pose) {
        EXPECT_LT((a.X_SR.R - b.X_SR.R).norm(), 1e-8);
      }
      if (kind == Kind::axis) {
        EXPECT_LT((a.X_SR.R.col(2) - b.X_SR.R.col(2)).norm(), 1e-8);
      }
    }
  }
  std::filesystem::remove(path);
}

TEST(Measurements, AByteOrderMarkIsNoPartOfTheFirstColumn) {
  const std::string path = std::filesystem::temp_directory_path() / ("polypod-bom-" + std::to_string(::getpid()));
  ASSERT_TRUE(files::write_whole(path, "\xEF\xBB\xBFq1,q2,q3,q4,q5,q6,x_mm,y_mm,z_mm\r\n70,70,70,70,70,70,1,2,3\r\n"));
  const auto r = read_measurements(named("hexapod-strut"), path);
  ASSERT_TRUE(r) << to_string(r.error());
  EXPECT_NEAR(r->at(0).X_SR.p.z(), 3e-3, 1e-15);
  std::filesystem::remove(path);
}

TEST(Measurements, BadFilesAreNamedWithTheirLine) {
  const AnyMachine m = named("hexapod-strut");
  const std::string q = "q1,q2,q3,q4,q5,q6,", values = "70,70,70,70,70,70,";
  const struct {
    std::string text;
    const char* id;
    int line;
  } cases[] = {
      {"", "ID102", 0},
      {q + "w\n" + values + "1\n", "CA101", 1},
      {q + "X_mm,Y_mm,Z_mm\n" + values + "1,2,3\n", "ID108", 1},
      {"q1,q2,x_mm,y_mm,z_mm\n1,2,3,4,5\n", "ID100", 1},
      {q + "x_mm,y_mm\n", "ID100", 1},
      {q + "x_mm,y_mm,z_mm\n", "ID102", 0},
      {q + "x_mm,y_mm,z_mm\n" + values + "1,2,three\n", "ID101", 2},
      {q + "x_mm,y_mm,z_mm\n" + values + "1,2,1e10\n", "ID101", 2},
      {q + "x_mm,y_mm,z_mm\n" + values + "1,2\n", "ID101", 2},
      {q + "x_mm,y_mm,z_mm\n# remark\n" + values + "1,2,3\n" + values + "1,2,3\n", "ID103", 4},
      {q + "x_mm,y_mm,z_mm,x_mm\n", "ID106", 1},
      {q + "x_mm,y_mm,z_mm\n70000,70,70,70,70,70,1,2,3\n", "CA103", 2},
      {q + "distance_mm,anchor_x_mm,anchor_y_mm,anchor_z_mm\n" + values + "-5,1,2,3\n", "CA102", 2},
      {q + "gauge_mm,plane_x_mm,plane_y_mm,plane_z_mm,normal_x,normal_y,normal_z\n" + values + "5,1,2,3,0,0,0\n",
       "CA102", 2},
      {q + "x_mm,y_mm,z_mm,sigma_um\n" + values + "1,2,3,0\n", "CA102", 2},
      {q + "x_mm,y_mm,z_mm\n" + values + "12,5,2,3\n", "ID107", 2},  // a decimal comma
  };
  const std::string path = std::filesystem::temp_directory_path() / ("polypod-bad-" + std::to_string(::getpid()));
  for (const auto& c : cases) {
    ASSERT_TRUE(files::write_whole(path, c.text));
    const auto r = read_measurements(m, path);
    ASSERT_FALSE(r) << c.id << c.text;
    EXPECT_EQ(r.error().id, c.id) << c.text;
    EXPECT_EQ(r.error().place.line, c.line) << c.text;
  }
  std::filesystem::remove(path);
}

TEST(Calibrate, ARowFarOutsideIsLeftOutAndNamed) {
  const AnyMachine m = named("hexapod-m850"), truth = off(m);
  auto rows = measured(m, truth, Kind::pose, 40, kNoise);
  const std::string path = std::filesystem::temp_directory_path() / ("polypod-far-" + std::to_string(::getpid()));
  rows[9].q[0] += 10;  // a decimal point lost
  ASSERT_TRUE(files::write_whole(path, measurements_csv(m, rows)));
  const auto read = read_measurements(m, path);
  ASSERT_TRUE(read) << to_string(read.error());
  const auto c = calibrate(m, *read, {});
  ASSERT_TRUE(c) << to_string(c.error());
  for (std::size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(c->residuals[i].untaken, i == 9) << i;
  // One row in ten and more is another unit.
  for (const std::size_t i : {1U, 2U, 3U, 4U}) rows[i].q[0] += 10;
  ASSERT_TRUE(files::write_whole(path, measurements_csv(m, rows)));
  EXPECT_EQ(read_measurements(m, path).error().id, "CA103");
  std::filesystem::remove(path);
}

TEST(Simulate, IsTheSameForTheSameSeed) {
  const AnyMachine m = named("hexapod-slider");
  const auto text = [&](std::uint64_t seed) {
    return measurements_csv(m, measured(m, off(m, seed), Kind::pose, 20, kNoise, seed));
  };
  EXPECT_EQ(text(4), text(4));
  EXPECT_NE(text(4), text(5));
}

}  // namespace
}  // namespace polypod::calibration
