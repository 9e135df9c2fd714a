// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Contacts at unknown places: what a smaller machine does to their noise is no reason to believe in one.
#include "dilatation.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "polypod/calibration/simulate.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::calibration {
namespace {

/// The volume that the target spans where the joints change by `step` about q, to the parameter's value: by the
/// triple product of three differences of the forward kinematics of the machine with that parameter.
double volume_about(const AnyMachine& m, const JointVector& q, const Eigen::MatrixXd& directions, double step) {
  Mat3 spanned;
  for (int k = 0; k < 3; ++k) {
    const auto up = kinematics::forward(m, q + step * directions.col(k)),
               down = kinematics::forward(m, q - step * directions.col(k));
    spanned.col(k) = (up.poses.at(0).p - down.poses.at(0).p) / (2 * step);
  }
  return spanned.determinant();
}

// The derivative of ln |det| by differences of the determinant itself, at joints that move the tip along x, y and z.
TEST(Dilatation, IsTheGrowthOfTheVolumeThatTheTargetSpans) {
  for (const char* name : {"delta-linear", "delta-brno", "puma560", "hexapod-strut", "lola50"}) {
    SCOPED_TRACE(name);
    const AnyMachine m = *machine::load(name);
    const std::vector<machine::Parameter> all = kinematics::parameters(m);
    for (const Stand& stand : random_stands(m, 3, 5)) {
      const Eigen::VectorXd found = dilatation_by_parameters(m, stand.X_MT, stand.q, Vec3::Zero());
      // The joints' ways that translate the tool at this machine.
      const machine::Task task = kinematics::task(m);
      const Eigen::MatrixXd J =
          kinematics::task_jacobian(task, kinematics::jacobian(m, stand.X_MT, stand.q), stand.X_MT);
      Eigen::MatrixXd along(task.size(), 3);
      for (int k = 0; k < 3; ++k) {
        machine::JacobianMatrix unit = machine::JacobianMatrix::Zero(6, 1);
        unit(k, 0) = 1;
        along.col(k) = kinematics::task_jacobian(task, unit, stand.X_MT);
      }
      const Eigen::MatrixXd directions = J.partialPivLu().solve(along);
      for (std::size_t i = 0; i < all.size(); i += 3) {
        if (all[i].unit.empty()) continue;  // of a direction only the turn counts, whose rule changes other parts, too
        constexpr double kStep = 1e-6;      // of the parameter, and of the joints' ways
        std::vector<double> p;
        for (const machine::Parameter& one : all) p.push_back(one.value);
        std::array<double, 2> ln{};
        for (const int side : {0, 1}) {
          p[i] = all[i].value + (side == 0 ? -kStep : kStep);
          const auto changed = machine::with_parameters(m, p);
          if (!changed) continue;  // a rule between parameters
          ln[std::size_t(side)] = std::log(std::abs(volume_about(*changed, stand.q, directions, kStep)));
        }
        if (ln[0] == 0 || ln[1] == 0) continue;
        // Both differences leave terms of the second order of their steps.
        EXPECT_NEAR(found[Eigen::Index(i)], (ln[1] - ln[0]) / (2 * kStep), 2e-3 * (1 + found.cwiseAbs().maxCoeff()))
            << all[i].key;
      }
    }
  }
}

/// By how much the tools of `found` stand farther apart than those of `drawn` at the same joints: the least squares
/// factor of size, less 1.
double growth(const AnyMachine& drawn, const AnyMachine& found, const std::vector<Stand>& stands) {
  Eigen::MatrixXd a(3, 0), b(3, 0);
  for (const Stand& s : stands) {
    const auto before = kinematics::forward(drawn, s.q).poses, after = kinematics::forward(found, s.q).poses;
    if (before.empty() || after.empty()) continue;
    a.conservativeResize(3, a.cols() + 1);
    b.conservativeResize(3, b.cols() + 1);
    a.rightCols<1>() = before[0].p;
    b.rightCols<1>() = after[0].p;
  }
  a.colwise() -= a.rowwise().mean().eval();
  b.colwise() -= b.rowwise().mean().eval();
  return a.cwiseProduct(b).sum() / a.squaredNorm() - 1;
}

// The machine is its drawing, but may be 3 mm off as far as is known, and the probe scatters by 0.1 mm: least squares
// alone make it smaller, by 5 to 20 of the standard deviations of this mean.
TEST(Dilatation, ContactsDoNotShrinkTheMachine) {
  for (const char* name : {"delta-brno", "delta-linear", "delta-picker"}) {
    SCOPED_TRACE(name);
    const AnyMachine m = *machine::load(name);
    const std::vector<Stand> stands = random_stands(m, 60, 77);
    constexpr int kSeeds = 8;
    Eigen::ArrayXd grown(kSeeds);
    for (int seed = 0; seed < kSeeds; ++seed) {
      SimulationOptions how;
      how.kind = Kind::contact;
      how.count = 160;
      how.noise_position = 100e-6;
      how.seed = static_cast<std::uint64_t>(seed + 1);
      const auto rows = simulate(m, m, how);
      ASSERT_TRUE(rows) << to_string(rows.error());
      CalibrationOptions options;
      options.noise_position = how.noise_position;
      options.prior_length = 3e-3;
      options.prior_angle = units::from_deg(0.05);
      const auto c = calibrate(m, *rows, options);
      ASSERT_TRUE(c) << to_string(c.error());
      grown[seed] = growth(m, c->machine, stands);
    }
    const double mean = grown.mean(), deviation = std::sqrt((grown - mean).square().sum() / (kSeeds * (kSeeds - 1)));
    if (std::getenv("POLYPOD_PRINT") != nullptr) fmt::print("{}: {:.2e} +- {:.2e}\n", name, mean, deviation);
    EXPECT_LT(std::abs(mean), 3 * deviation);
  }
}

}  // namespace
}  // namespace polypod::calibration
