// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Vibration along a program: three slides against one closed form an axis, an arm against an integration over time of
// its equations of motion under teeth that are written out here.
#include "polypod/machining/vibration.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <complex>
#include <fstream>
#include <numbers>

#include "examples.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/compliance.hpp"
#include "slides.hpp"

namespace polypod::machining {
namespace {

using testing::Scratch;
using testing::unwrap;
constexpr double kTurn = 2 * std::numbers::pi;

/// A wall that stands along x from 0 to 40 mm, 2 mm thick and 1.5 mm deep, cut by a straight-edged cutter of 10 mm.
std::string job_text(const std::string& machine, double helix) {
  return fmt::format(R"(
machine = "{}"
tolerance_um = 100
[workpiece]
origin_mm = [0, 0, 0]
[cutter]
diameter_mm = 10
teeth = 2
helix_deg = {}
length_mm = 20
[material]
Ktc_N_per_mm2 = 900
Krc_N_per_mm2 = 250
Kac_N_per_mm2 = 100
Kte_N_per_mm = 12
Kre_N_per_mm = 20
Kae_N_per_mm = 2
[stock]
kind = "block"
min_mm = [0, 0, -20]
max_mm = [40, 2, 0]
)",
                     machine, helix);
}
std::string program_text(double speed) {
  return fmt::format("G17 G21 G40 G49 G80 G90 G94\nT1 M6\nS{} M3\nG0 X-20 Y-3 Z10\nG0 Z-1.5\nG1 X60 F{}\nG0 Z10\nM2\n",
                     speed, speed * 2 * 0.05);
}

struct Cut {
  Job job;
  gcode::Program program;
  Prediction prediction;
  CutPoints points;
};
/// `middle`: only where the whole width of the wall is met.
Cut cut_of(const Job& job, const std::string& text, bool middle = true) {
  Cut out{job, unwrap(gcode::parse(text, "test.ngc")), {}, {}};
  const gcode::Interpretation run = unwrap(gcode::interpret(out.program, job.interpret_options()));
  PredictOptions options;
  options.bend = Bend::at_rest;
  cutting::Stock stock = job.stock;
  PassOptions pass;
  pass.bend = Bend::at_rest;
  unwrap(run_pass_of_teeth(out.job, out.program, run.moves, stock, pass, [&](const Sample& s, const TeethView& teeth) {
    if (!middle || (s.command.x() > 8e-3 && s.command.x() < 32e-3)) out.points.add(s, teeth);
  }));
  out.prediction = unwrap(predict(out.job, out.program, run, options));
  return out;
}
class Slides : public ::testing::Test {
 protected:
  Job job_of(double helix) {
    std::ofstream(scratch_.file("slides.toml")) << kSlides;
    std::ofstream(scratch_.file("job.toml")) << job_text("slides.toml", helix);
    return unwrap(read_job(scratch_.file("job.toml")));
  }
  ProgramVibration vibration(const Cut& cut, const motion::Dynamics& d, std::optional<double> damping = {}) {
    return unwrap(vibration_of(cut.job, cut.program, cut.points, cut.prediction, d, damping));
  }
  Scratch scratch_;
};

/// The forces of two straight edges at an angle, up to `depth`; up-milling of a width `ae`: the wall stands at the left
/// of a cutter that goes along +x, so the engagement is 0 .. acos(1 - 2 ae / D).
Vec3 teeth_at(double turned, double exit) {
  const double depth = 1.5, feed = 0.05;  // mm
  Vec3 out = Vec3::Zero();
  for (int i = 0; i < 2; ++i) {
    double phi = std::fmod(turned + i * std::numbers::pi, kTurn);
    if (phi < 0 || phi > exit) continue;
    const double h = feed * std::sin(phi);
    const double ft = depth * (900 * h + 12), fr = depth * (250 * h + 20), fa = depth * (100 * h + 2);
    out += Vec3(-ft * std::cos(phi) - fr * std::sin(phi), ft * std::sin(phi) - fr * std::cos(phi), fa);
  }
  return out;
}

/// One degree of freedom an axis, in closed form: harmonics of the force through 1 / (k - m w^2 + 2 i zeta sqrt(k m)
/// w).
TEST_F(Slides, EachAxisAnswersByItsClosedForm) {
  const Job job = job_of(0);
  const motion::Dynamics d = masses_of_slides();
  const double exit = std::acos(1 - 2 * 2.0 / 10);
  // Tooth passing at 0.6 of the natural frequency of y, and above all.
  const Vec3 mass(kMassX + kMassY + kMassZ, kMassY + kMassZ, kMassZ), k(kStiffnessX, kStiffnessY, kStiffnessZ);
  const Vec3 own = k.cwiseQuotient(mass).cwiseSqrt();
  for (const double passing : {0.6 * own.y() / kTurn, 1.02 * own.x() / kTurn, 2000.0}) {
    const double speed = std::round(passing / 2 * 60), f = speed / 60 * 2;  // rev/min, two teeth
    const Cut cut = cut_of(job, program_text(speed));
    const ProgramVibration got = vibration(cut, d, 0.04);
    ASSERT_EQ(got.natural.size(), 3U);
    Vec3 sorted = own / kTurn;
    std::sort(sorted.data(), sorted.data() + 3);
    for (int r = 0; r < 3; ++r) {
      EXPECT_NEAR(got.natural[static_cast<std::size_t>(r)].low, sorted[r], 1e-6 * sorted[r]);
      EXPECT_NEAR(got.natural[static_cast<std::size_t>(r)].high, sorted[r], 1e-6 * sorted[r]);
    }
    ASSERT_EQ(got.speeds.size(), 1U);
    EXPECT_NEAR(got.speeds[0].tooth_passing, f, 1e-9 * f);
    EXPECT_FALSE(got.damping_assumed);
    EXPECT_TRUE(got.not_judged().empty());
    // The same in closed form.
    const int n = 7200, harmonics = 60;
    std::vector<Vec3> u(720, Vec3::Zero());
    for (int h = 1; h <= harmonics; ++h) {
      Eigen::Vector3cd F = Eigen::Vector3cd::Zero();
      for (int j = 0; j < n; ++j) {
        const double share = (j + 0.5) / n;
        F += teeth_at(std::numbers::pi * share, exit).cast<std::complex<double>>() *
             std::polar(2.0 / n, -kTurn * h * share);
      }
      const double w = kTurn * f * h;
      for (int a = 0; a < 3; ++a) {
        F[a] /= std::complex<double>(k[a] - mass[a] * w * w, 2 * 0.04 * std::sqrt(k[a] * mass[a]) * w);
      }
      for (std::size_t j = 0; j < u.size(); ++j) u[j] += (F * std::polar(1.0, kTurn * h * double(j) / 720.0)).real();
    }
    double amplitude = 0, across = 0, axial = 0;
    for (const Vec3& x : u) {
      amplitude = std::max(amplitude, x.norm());
      across = std::max(across, std::abs(x.y()));
      axial = std::max(axial, std::abs(x.z()));
    }
    // The engagement is known to the strips of the profile, 64 across the cutter: 2 mm are 12.8 of them.
    constexpr double kStrips = 0.03;
    EXPECT_GT(amplitude, 1e-9);
    EXPECT_NEAR(got.amplitude, amplitude, kStrips * amplitude) << f;
    EXPECT_NEAR(got.across, across, kStrips * amplitude) << f;
    EXPECT_NEAR(got.along_axis, axial, kStrips * amplitude) << f;
    EXPECT_EQ(got.line, 6);
    EXPECT_LE(got.mean, got.amplitude);
  }
}

/// The mean of the teeth's force is the force of the pass, which a closed form gives.
TEST_F(Slides, TheMeanIsTheForceOfThePass) {
  const Cut cut = cut_of(job_of(30), program_text(6000));
  std::size_t seen = 0;
  for (const auto& [key, group] : cut.points.groups()) {
    EXPECT_EQ(key.first, 1);  // T1 M6
    EXPECT_DOUBLE_EQ(key.second, 100);
    for (const CutPoint& p : group.points) {
      ++seen;
      const motion::PeriodicForce f = tooth_force(cut.job, p, 1);
      EXPECT_LT((f.mean - p.sample.force).norm(), 0.01 * p.sample.force.norm());
      EXPECT_EQ(f.harmonics.size(), 40U);
      EXPECT_FALSE(p.end_cuts);
    }
  }
  EXPECT_GT(seen, 20U);
  EXPECT_EQ(cut.points.left_out(), 0U);
}

/// An undamped machine whose second harmonic of tooth passing is a natural frequency has no steady state: this is
/// named, no figure is given, and nothing within.
TEST_F(Slides, AnUndampedResonanceIsNamed) {
  Job job = job_of(0);
  motion::Dynamics d = masses_of_slides();
  // 2 harmonics x 2 teeth x 3000 rev/min: 200 Hz, made the natural frequency of z by its mass.
  const double mass = kStiffnessZ / std::pow(kTurn * 200, 2);
  d.links[2]->mass = mass;
  const Cut cut = cut_of(job, program_text(3000));
  const ProgramVibration got = vibration(cut, d, 0.0);
  ASSERT_EQ(got.speeds.size(), 1U);
  ASSERT_TRUE(got.speeds[0].unbounded);
  EXPECT_EQ(got.speeds[0].unbounded->harmonic, 2);
  EXPECT_NEAR(got.speeds[0].unbounded->natural, 200, 1e-6);
  EXPECT_FALSE(got.bounded());
  EXPECT_EQ(got.amplitude, 0);
  EXPECT_FALSE(got.not_judged().empty());
  EXPECT_TRUE(cut.prediction.within(cut.job));
  EXPECT_FALSE(got.within(cut.job, cut.prediction));
  // Another speed has a steady state, and is the advice.
  ASSERT_TRUE(got.speeds[0].advice);
  EXPECT_GT(got.speeds[0].advice->amplitude, 0);
  // With damping all of it is judged.
  const ProgramVibration damped = vibration(cut, d, 0.02);
  EXPECT_TRUE(damped.bounded());
  EXPECT_TRUE(damped.not_judged().empty());
  EXPECT_GT(damped.amplitude, 0);
}

/// Near a resonance another speed is advised; the program written for it has that vibration, and the same feed per
/// tooth.
TEST_F(Slides, TheAdvisedSpeedHasTheVibrationThatIsSaid) {
  const Job job = job_of(0);
  motion::Dynamics d = masses_of_slides();
  const double own_y = std::sqrt(kStiffnessY / (kMassY + kMassZ)) / kTurn;
  const double speed = std::round(own_y / 2 * 60);
  const Cut cut = cut_of(job, program_text(speed));
  const ProgramVibration now = vibration(cut, d);
  EXPECT_TRUE(now.damping_assumed);
  EXPECT_EQ(now.damping, kAssumedDamping);
  ASSERT_TRUE(now.speeds[0].nearest);
  EXPECT_EQ(now.speeds[0].nearest->harmonic, 1);
  EXPECT_LT(std::abs(now.speeds[0].nearest->apart), 1e-3);
  ASSERT_TRUE(now.speeds[0].advice);
  const SpeedAdvice& advice = *now.speeds[0].advice;
  EXPECT_LT(advice.amplitude, 0.7 * now.amplitude);
  EXPECT_NEAR(advice.feed_factor, advice.spindle_speed / now.speeds[0].spindle_speed, 1e-12);
  EXPECT_LE(std::abs(advice.feed_factor - 1), 0.26);
  const Cut other = cut_of(job, program_text(units::to_per_min(advice.spindle_speed)));
  const ProgramVibration then = vibration(other, d);
  EXPECT_NEAR(then.amplitude, advice.amplitude, 0.01 * advice.amplitude);
  for (const auto& [key, group] : other.points.groups())
    for (const CutPoint& p : group.points) EXPECT_NEAR(p.feed_per_tooth, 0.05e-3, 1e-9);
  // Far from every natural frequency there is no advice.
  const ProgramVibration far = vibration(cut_of(job, program_text(90000)), d);
  EXPECT_FALSE(far.speeds[0].advice);
  EXPECT_GT(far.speeds[0].nearest->apart, 1);
}

/// The points of a whole program are those of its prediction.
TEST_F(Slides, PointsOfAProgramAreThoseOfItsPass) {
  Cut cut = cut_of(job_of(30), program_text(6000), false);
  const gcode::Interpretation run = unwrap(gcode::interpret(cut.program, cut.job.interpret_options()));
  PredictOptions options;
  options.bend = Bend::at_rest;
  options.step = cut.job.step;
  const CutPoints got = unwrap(cut_points(cut.job, cut.program, run, options));
  EXPECT_EQ(got.seen(), cut.prediction.deflection.count);
  EXPECT_EQ(got.groups().size(), 1U);
}

/// What is counted: the largest distance and the largest vibration, added.
TEST_F(Slides, CountedItAddsToTheDistance) {
  Job job = job_of(0);
  const motion::Dynamics d = masses_of_slides();
  const double own_y = std::sqrt(kStiffnessY / (kMassY + kMassZ)) / kTurn;
  Cut cut = cut_of(job, program_text(std::round(own_y / 2 * 60)));
  const ProgramVibration v = vibration(cut, d);
  const double sum = cut.prediction.largest_with_corners + v.amplitude;
  EXPECT_NEAR(v.largest_with(cut.prediction), sum, 1e-15);
  cut.job.tolerance = sum / 0.98 * 1.001;  // 2 % are kept free
  EXPECT_TRUE(v.within(cut.job, cut.prediction));
  cut.job.tolerance = sum / 0.98 * 0.999;
  EXPECT_TRUE(cut.prediction.within(cut.job));
  EXPECT_FALSE(v.within(cut.job, cut.prediction));
}

/// Where the end of the cutter cuts, its force is taken as steady: not all is judged.
TEST_F(Slides, APlungeIsNotAllJudged) {
  const Job job = job_of(0);
  const Cut cut = cut_of(
      job, "G17 G21 G40 G49 G80 G90 G94\nT1 M6\nS6000 M3\nG0 X20 Y1 Z5\nG1 Z-1 F60\nG4 P1\nG1 X60 F600\nG0 Z10\nM2\n",
      false);
  const ProgramVibration got = vibration(cut, masses_of_slides());
  EXPECT_GT(got.end_points, 0U);
  EXPECT_FALSE(got.not_judged().empty());
  EXPECT_FALSE(got.within(cut.job, cut.prediction));
}

TEST(CutPoints, StayFewAndEven) {
  CutPoints points;
  const cutting::EngagementProfile profile{};
  gcode::Move move;
  move.tool = 3;
  move.spindle_speed = 50;
  for (int i = 0; i < 1234; ++i) {
    Sample s;
    s.s = i;
    points.add(s, {move, profile, Eigen::Vector2d::UnitX(), 1e-5, false});
  }
  EXPECT_EQ(points.seen(), 1234U);
  const CutPoints::Group& group = points.groups().at({3, 50.0});
  EXPECT_LE(group.points.size(), CutPoints::kMost);
  EXPECT_GE(group.points.size(), CutPoints::kMost / 2);
  for (std::size_t i = 0; i < group.points.size(); ++i) {
    EXPECT_EQ(group.points[i].sample.s, static_cast<double>(i * group.stride));
  }
  for (int k = 0; k < 60; ++k) {
    move.spindle_speed = 100 + k;
    points.add({}, {move, profile, Eigen::Vector2d::UnitX(), 1e-5, false});
  }
  EXPECT_EQ(points.groups().size(), CutPoints::kMostSpeeds);
  EXPECT_EQ(points.left_out(), 21U);
}

/// LOLA 50 along one side of the square of SLAV 6, with invented masses: M q'' + D q' + K q = J^T F(t) with the helical
/// teeth written out here (SLAV (5.3) to (5.10), 40 discs), integrated over time until it is steady. M is the mass
/// matrix of the joints (tested against Simbody), J the Jacobian, K the inverse of the compliances.
TEST(VibrationOfAnArm, AnIntegrationOverTimeSettlesAtTheSameAmplitude) {
  const testing::Example e = testing::load_example("slavkovic_square");
  motion::Dynamics d;
  // Light for an arm of that size, so that tooth passing at 533 Hz is near its modes and not far above.
  for (int k = 0; k < 5; ++k) {
    motion::Body b;
    b.mass = 0.05;
    b.inertia = Vec3(2e-4, 3e-4, 4e-4).asDiagonal();
    d.links.emplace_back(b);
  }
  d.platform = motion::Body{0.08, Vec3(0.01, 0.02, 0.1), Vec3(1e-3, 2e-3, 1e-3).asDiagonal()};
  const double zeta = 0.05;
  CutPoints points;
  cutting::Stock stock = e.job.stock;
  PassOptions pass;
  pass.bend = Bend::at_rest;
  unwrap(run_pass_of_teeth(e.job, e.program, e.interpretation.moves, stock, pass,
                           [&](const Sample& s, const TeethView& teeth) {
                             // One point in the middle of each side.
                             if (std::abs(s.command.x()) < 0.2e-3 || std::abs(s.command.y()) < 0.2e-3)
                               points.add(s, teeth);
                           }));
  const ProgramVibration got = unwrap(vibration_of(e.job, e.program, points, {}, d, zeta));
  ASSERT_EQ(got.speeds.size(), 1U);
  const auto& group = points.groups().begin()->second;

  double want = 0, want_across = 0;
  for (const CutPoint& point : group.points) {
    const Pose target{Mat3::Identity(), e.job.X_MW * point.sample.command};
    const machine::JointVector q = kinematics::inverse(e.job.machine, target).reachable()->joints;
    const Pose X = kinematics::settled(e.job.machine, target, q);
    using V5 = Eigen::Matrix<double, 5, 1>;
    using M5 = Eigen::Matrix<double, 5, 5>;
    const M5 M = motion::mass_matrix(e.job.machine, d, X, q);
    const std::vector<double> c = statics::column_compliances(e.job.machine);
    M5 K = M5::Zero();
    for (int i = 0; i < 5; ++i) K(i, i) = 1 / c[static_cast<std::size_t>(i)];
    const Eigen::GeneralizedSelfAdjointEigenSolver<M5> modes(K, M);
    const V5 own = modes.eigenvalues().cwiseSqrt();
    const M5 D = M * modes.eigenvectors() * (2 * zeta * own).asDiagonal() * modes.eigenvectors().transpose() * M;
    const Eigen::Matrix<double, 3, 5> J = kinematics::jacobian(e.job.machine, X, q).topRows<3>();
    // The side is cut to the right of a cutter that goes along the feed: pi/2 .. pi (b = 4 mm of 8), down-milling.
    const Vec3 along(point.feed.x(), point.feed.y(), 0), left(-point.feed.y(), point.feed.x(), 0);
    const int per_period = 720, discs = 40;
    std::vector<V5> force;
    Vec3 mean_force = Vec3::Zero();
    for (int j = 0; j < per_period; ++j) {
      const double turned = kTurn / 4 * (j + 0.5) / per_period;
      Vec3 f = Vec3::Zero();
      for (int disc = 0; disc < discs; ++disc) {
        const double dz = 2.0 / discs, z = (disc + 0.5) * dz;  // mm
        for (int i = 0; i < 4; ++i) {
          double phi = std::fmod(turned + i * kTurn / 4 - 2 * z * std::tan(std::numbers::pi / 6) / 8 + kTurn, kTurn);
          if (phi < std::numbers::pi / 2 || phi > std::numbers::pi) continue;
          const double h = 0.05 * std::sin(phi);
          const double ft = dz * (1027.78 * h + 13.65), fr = dz * (182.03 * h + 27.95), fa = dz * (64.5 * h + 2.21);
          f += (-ft * std::cos(phi) - fr * std::sin(phi)) * along + (ft * std::sin(phi) - fr * std::cos(phi)) * left +
               fa * Vec3::UnitZ();
        }
      }
      mean_force += f / per_period;
      force.emplace_back(J.transpose() * (e.job.X_MW.R * f));
    }
    EXPECT_LT((mean_force - point.sample.force).norm(), 0.02 * mean_force.norm());
    const double period = 1 / (8000 / 60.0 * 4), h = period / per_period;
    const M5 inverse = M.inverse();
    V5 x = V5::Zero(), v = V5::Zero();
    const int periods = static_cast<int>(std::ceil(12 / (zeta * own[0]) / period));
    std::vector<Vec3> last;
    Vec3 mean = Vec3::Zero();
    for (int k = 0; k <= periods; ++k) {
      for (int j = 0; j < per_period; ++j) {
        if (k == periods) {
          last.emplace_back(J * x);
          mean += J * x / per_period;
        }
        const V5& F = force[static_cast<std::size_t>(j)];
        const auto rate = [&](const V5& at, const V5& speed) { return V5(inverse * (F - D * speed - K * at)); };
        const V5 v1 = v, a1 = rate(x, v1);
        const V5 v2 = v + h / 2 * a1, a2 = rate(x + h / 2 * v1, v2);
        const V5 v3 = v + h / 2 * a2, a3 = rate(x + h / 2 * v2, v3);
        const V5 v4 = v + h * a3, a4 = rate(x + h * v3, v4);
        x += h / 6 * (v1 + 2 * v2 + 2 * v3 + v4);
        v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
      }
    }
    for (const Vec3& u : last) {
      want = std::max(want, (u - mean).norm());
      want_across = std::max(want_across, std::abs((u - mean).dot(e.job.X_MW.R * left)));
    }
  }
  ASSERT_GE(group.points.size(), 2U);
  EXPECT_GT(want, 1e-6);
  // The engagement is known to a strip of 64, and the discs are 0.2 mm thick.
  constexpr double kStrips = 0.03;
  EXPECT_NEAR(got.amplitude, want, kStrips * want);
  EXPECT_NEAR(got.across, want_across, kStrips * want);
}

}  // namespace
}  // namespace polypod::machining
