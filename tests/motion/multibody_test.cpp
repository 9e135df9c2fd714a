// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Forces of the drives against Simbody, an independent multibody code: bodies with masses and inertias at joints, legs
// that close by ball joints. Of Polypod it takes the geometry of the machine, where the joints are at one instant, and
// how the platform (of an arm the joints) moves; speeds and accelerations of all other bodies, loads in the joints and
// forces of the drives follow from Simbody's constraints: M u' + bias - gravity = S tau + G^T lambda.
#include <gtest/gtest.h>

#include "machines.hpp"
#include "motion/masses.hpp"
#include "motion/multibody_host.hpp"

#include "polypod/families/serial/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/motion/dynamics.hpp"
#include "polypod/motion/pose_path.hpp"

namespace polypod::motion {
namespace {

using machine::AnyMachine;
using machine::JointVector;

// Of the largest force of the motion: both codes solve for some dozen loads in double precision.
constexpr double kAgrees = 1e-9;

using test::Mass;
using test::Multibody;

Mass mass_of(const Body& body) {
  return {body.mass, body.center, body.inertia};
}
Mass moved(const Mass& m, const Pose& X) {
  return {m.mass, X * m.center, X.R * m.inertia * X.R.transpose()};
}
Mass together(const Mass& a, const Mass& b) {
  Mass out{a.mass + b.mass, (a.mass * a.center + b.mass * b.center) / (a.mass + b.mass), a.inertia + b.inertia};
  for (const Mass* m : {&a, &b}) {
    const Vec3 off = m->center - out.center;
    out.inertia += m->mass * (off.squaredNorm() * Mat3::Identity() - off * off.transpose());
  }
  return out;
}
/// On the z axis, with its inertia across it.
Mass on_z(double mass, double center, double across) {
  return {mass, Vec3(0, 0, center), Vec3(across, across, 0).asDiagonal()};
}
Mass uniform_rod(double mass, double length) {
  return on_z(mass, 0.5 * length, mass * length * length / 12);
}
test::Place place_of(const Pose& X) {
  return {X.R, X.p};
}
Body brick(double mass, const Vec3& center, const Vec3& moments) {
  Body out;
  out.mass = mass;
  out.center = center;
  out.inertia = moments.asDiagonal();
  out.inertia(0, 1) = out.inertia(1, 0) = 0.1 * moments[0];
  out.inertia(1, 2) = out.inertia(2, 1) = -0.07 * moments[0];
  return out;
}

Dynamics masses() {
  Dynamics out = legs_with_masses();
  out.platform = brick(2.5, Vec3(0.01, -0.02, 0.03), Vec3(0.02, 0.03, 0.04));
  out.payload = brick(0.7, Vec3(0, 0.01, -0.02), Vec3(0.003, 0.002, 0.004));
  return out;
}

/// Some instants of a motion of the platform about a pose.
std::vector<PoseSeries> motions(const Pose& home, double size, bool turns) {
  std::vector<PoseSeries> out;
  for (int k = 0; k < 4; ++k) {
    Stretch way;
    way.from = home.p + size * Vec3(0.2 * k, -0.1, 0.1);
    way.to = way.from + size * Vec3(1, 0.7 - 0.5 * k, 0.3 * k - 0.4);
    way.size = way.length = (way.to - way.from).norm();
    if (turns) {
      way.angles_from = Vec3(0.05, -0.04 * k, 0.06);
      way.angles_to = Vec3(-0.1 + 0.1 * k, 0.15, -0.2);
    }
    out.push_back(way.at(Series(0.3 * way.size, 3 * way.size, (20 - 15.0 * k) * way.size, 0)));
  }
  return out;
}

/// Polypod's motion of the whole machine for one of the platform.
JointSeries follow(const AnyMachine& m, const PoseSeries& target) {
  const Pose X = value_of(target);
  const JointVector q = kinematics::inverse(m, X).solutions.front().joints;
  return joint_series(m, target, kinematics::settled(m, X, q), q);
}

/// The platform and what it carries, from the tool tip.
Mass carried(const Dynamics& d) {
  return together(mass_of(*d.platform), mass_of(*d.payload));
}

test::PlatformMotion motion_of(const PoseSeries& X) {
  test::PlatformMotion out;
  Mat3 R1, R2;
  for (int i = 0; i < 3; ++i) {
    out.speed[i] = X.p[i].derivative(1);
    out.acceleration[i] = X.p[i].derivative(2);
    for (int k = 0; k < 3; ++k) {
      R1(i, k) = X.R(i, k).derivative(1);
      R2(i, k) = X.R(i, k).derivative(2);
    }
  }
  out.at = place_of(value_of(X));
  // Of R' R^T and R'' R^T the skew parts: omega and its rate.
  const auto skew = [](const Mat3& W) {
    return Vec3(0.5 * (W(2, 1) - W(1, 2)), 0.5 * (W(0, 2) - W(2, 0)), 0.5 * (W(1, 0) - W(0, 1)));
  };
  out.turning = skew(R1 * out.at.R.transpose());
  out.turning_rate = skew(R2 * out.at.R.transpose());
  return out;
}

void compare(Multibody& bodies, const JointVector& ours) {
  const Eigen::VectorXd theirs = bodies.forces();
  ASSERT_EQ(theirs.size(), ours.size());
  // Simbody's own machine hangs together: places, speeds and accelerations of its loops.
  EXPECT_LT(bodies.places_open, 1e-12);
  EXPECT_LT(bodies.speeds_open, 1e-12);
  EXPECT_LT(bodies.accelerations_open, 1e-11);
  const double largest = ours.cwiseAbs().maxCoeff();
  EXPECT_GT(largest, 1);
  for (Eigen::Index i = 0; i < ours.size(); ++i) EXPECT_NEAR(ours[i], theirs[i], kAgrees * largest) << i + 1;
}

TEST(AgainstSimbody, StrutHexapod) {
  const AnyMachine any = test::load("hexapod-strut");
  const auto& m = std::get<machine::StrutHexapod>(any);
  const Dynamics d = masses();
  for (const PoseSeries& target : motions(*kinematics::home_pose(any), 0.006, true)) {
    const JointSeries moves = follow(any, target);
    ASSERT_TRUE(moves.regular);
    Multibody bodies(d.gravity);
    bodies.platform(motion_of(target), true, carried(d));
    const Pose X = value_of(target);
    for (std::size_t i = 0; i < 6; ++i) {
      const Vec3 in_tool = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
      const Vec3 way = X * in_tool - m.base_joint[i];
      const int lower = bodies.turning(0, Mat3::Identity(), m.base_joint[i], way,
                                       on_z(d.strut_fixed, d.strut_fixed_center, d.strut_fixed_inertia));
      const int upper = bodies.sliding(lower, Vec3::UnitZ(), Vec3::Zero(), way.norm(),
                                       on_z(d.strut_moving, -d.strut_moving_center, d.strut_moving_inertia));
      bodies.close(upper, Vec3::Zero(), in_tool);
    }
    compare(bodies, drive_forces(any, d, moves));
  }
}

TEST(AgainstSimbody, RailHexapod) {
  const AnyMachine any = test::load("hexapod-slider");
  const auto& m = std::get<machine::SliderHexapod>(any);
  const Dynamics d = masses();
  for (const PoseSeries& target : motions(*kinematics::home_pose(any), 0.006, true)) {
    const JointSeries moves = follow(any, target);
    ASSERT_TRUE(moves.regular);
    Multibody bodies(d.gravity);
    bodies.platform(motion_of(target), true, carried(d));
    const Pose X = value_of(target);
    for (std::size_t i = 0; i < 6; ++i) {
      const Vec3 in_tool = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
      const Vec3 along = (m.rail_inner[i] - m.rail_outer[i]).normalized();
      const double q = moves.q[static_cast<Eigen::Index>(i)], length = m.length_of_leg(static_cast<int>(i));
      const int slider = bodies.sliding(0, along, m.rail_outer[i], q, Mass{d.slider, Vec3::Zero(), Mat3::Zero()});
      const int rod = bodies.turning(slider, Mat3::Identity(), Vec3::Zero(), X * in_tool - m.rail_outer[i] - q * along,
                                     uniform_rod(d.rod, length));
      bodies.close(rod, Vec3(0, 0, length), in_tool);
    }
    compare(bodies, drive_forces(any, d, moves));
  }
}

TEST(AgainstSimbody, Delta) {
  const AnyMachine any = test::load("delta-brno");
  const auto& m = std::get<machine::RotaryDelta>(any);
  const Dynamics d = masses();
  for (const PoseSeries& target : motions(*kinematics::home_pose(any), 0.08, false)) {
    const JointSeries moves = follow(any, target);
    ASSERT_TRUE(moves.regular);
    Multibody bodies(d.gravity);
    bodies.platform(motion_of(target), false, carried(d));
    const Pose X = value_of(target);
    for (int i = 0; i < 3; ++i) {
      const double angle = moves.q[i] + m.zero[i];
      // At 0 deg an arm points along -z, at 90 deg outward: it turns about (-z) x outward.
      const Vec3 up(0, 0, -1), axis = up.cross(m.outward[i]);
      Mat3 R_MF;
      R_MF << up, m.outward[i], axis;
      // The table gives the inertia about the axis; what is not across the arm does not count.
      const double across = d.arm_inertia - d.arm * d.arm_center * d.arm_center;
      const int arm = bodies.pinned(0, {R_MF, m.base_joint[i]}, angle, 1,
                                    {d.arm, Vec3(d.arm_center, 0, 0), Vec3(0, across, across).asDiagonal()});
      const Vec3 along = std::cos(angle) * up + std::sin(angle) * m.outward[i];
      const Mat3 R_MA = R_MF * Eigen::AngleAxisd(angle, Vec3::UnitZ()).toRotationMatrix();
      const double length = m.rod_length[i];
      const Vec3 in_tool = m.platform_joint[i] - m.tool;
      const int rod =
          bodies.turning(arm, R_MA, Vec3(m.arm_length[i], 0, 0),
                         X * in_tool - m.base_joint[i] - m.arm_length[i] * along, uniform_rod(d.rod, length));
      bodies.close(rod, Vec3(0, 0, length), in_tool);
    }
    compare(bodies, drive_forces(any, d, moves));
  }
}

/// Six joints in a standard and in a modified table, with signs; links with their own frames, a tool and what it
/// carries.
class Arm : public testing::TestWithParam<const char*> {};
TEST_P(Arm, InSimbody) {
  const AnyMachine any = test::load(GetParam());
  const auto& m = std::get<machine::SerialArm>(any);
  Dynamics d = masses();
  for (std::size_t k = 0; k < m.dh.size(); ++k) {
    const auto x = static_cast<double>(k);
    d.links.emplace_back(brick(20 - 3 * x, Vec3(-0.1, 0.02 * x, 0.05), Vec3(0.5 - 0.05 * x, 0.6 - 0.05 * x, 0.4)));
  }
  for (int instant = 0; instant < 4; ++instant) {
    JointSeries moves;
    moves.q = moves.first = moves.second = moves.third = JointVector::Zero(6);
    for (int i = 0; i < 6; ++i) {
      moves.q[i] = 0.4 + 0.3 * std::sin(1.7 * i + instant);
      moves.first[i] = std::cos(0.9 * i + 2.0 * instant);
      moves.second[i] = 5 * std::sin(2.1 * i - instant);
    }
    // The tip's motion from the chain on power series.
    std::vector<Series> q;
    for (int i = 0; i < 6; ++i) q.emplace_back(moves.q[i], moves.first[i], moves.second[i], 0.0);
    const std::vector<double> values = machine::parameter_values(m);
    const std::vector<Series> p(values.begin(), values.end());
    moves.X = machine::chain(m, std::span<const Series>(q), std::span<const Series>(p));
    moves.regular = true;
    Multibody bodies(d.gravity);
    int link = 0;
    Pose before = m.X_MB;  // the frame of the row before, on its body
    for (std::size_t k = 0; k < m.dh.size(); ++k) {
      const machine::DhRow& row = m.dh[k];
      const double angle = row.sign * moves.q[static_cast<Eigen::Index>(k)] + row.theta_offset;
      Pose turn, rest;
      turn.R = Eigen::AngleAxisd(row.alpha, Vec3::UnitX()).toRotationMatrix();
      const bool standard = m.convention == machine::DhConvention::standard;
      if (standard) {
        rest.R = turn.R;
        rest.p = Vec3(row.a, 0, row.d);
      } else {
        turn.p = Vec3(row.a, 0, 0);
        before = before * turn;
        rest.p = Vec3(0, 0, row.d);
      }
      Mass mass = moved(mass_of(*d.links[k]), rest);
      if (k + 1 == m.dh.size()) mass = together(mass, moved(carried(d), rest * m.X_FT));
      link = bodies.pinned(link, place_of(before), angle, row.sign, mass);
      before = rest;
    }
    bodies.drives_move(moves.first, moves.second);
    compare(bodies, drive_forces(any, d, moves));
  }
}
INSTANTIATE_TEST_SUITE_P(AgainstSimbody, Arm, testing::Values("ur10e", "puma560", "kuka-kr210"), [](const auto& which) {
  std::string name = which.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

}  // namespace
}  // namespace polypod::motion
