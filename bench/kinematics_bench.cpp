// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Kinematics of LOLA 50 beside Orocos KDL: the same arm, the same joints, in the same run. Then the inverse of any
// machine, as programs ask for it.
#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdlib>
#include <kdl/chain.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <numbers>
#include <random>
#include <vector>

#include "opw.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/families/serial/pieper.hpp"
#include "polypod/families/serial/spherical_wrist.hpp"
#include "polypod/families/serial/three_parallel.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machine/any_machine.hpp"
#include "polypod/statics/compliance.hpp"

namespace {

using namespace polypod;

const machine::SerialArm& lola() {
  static const machine::AnyMachine m = *machine::load("lola50");
  return std::get<machine::SerialArm>(m);
}

std::vector<machine::JointVector> joints() {
  std::vector<machine::JointVector> out;
  for (int k = 0; k < 1024; ++k) {
    machine::JointVector q(5);
    for (int i = 0; i < 5; ++i) q[i] = 0.4 * std::sin(0.37 * k + 1.3 * i) + (i == 4 ? 0.3 : 0.0);
    out.push_back(q);
  }
  return out;
}

/// LOLA 50 as a KDL chain. KDL joints turn about the z axis before the link's transform, as the standard table does;
/// the sign of joint 4 goes into KDL's joint scale.
KDL::Chain kdl_chain() {
  KDL::Chain chain;
  const machine::SerialArm& arm = lola();
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const machine::DhRow& row = arm.dh[i];
    KDL::Frame tip = KDL::Frame::DH(row.a, row.alpha, row.d, row.theta_offset);
    if (i + 1 == arm.dh.size()) {
      const Mat3& R = arm.X_FT.R;
      tip = tip *
            KDL::Frame(KDL::Rotation(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)));
    }
    chain.addSegment(KDL::Segment(KDL::Joint(KDL::Joint::RotZ, row.sign), tip));
  }
  return chain;
}

KDL::JntArray kdl_joints(const machine::JointVector& q) {
  KDL::JntArray out(5);
  for (unsigned i = 0; i < 5; ++i) out(i) = q[i];
  return out;
}

/// A benchmark of two different machines would mean nothing: stop if the tips differ.
void must_agree() {
  const KDL::Chain chain = kdl_chain();
  KDL::ChainFkSolverPos_recursive fk(chain);
  for (const auto& q : joints()) {
    KDL::Frame frame;
    fk.JntToCart(kdl_joints(q), frame);
    const Pose X = machine::forward(lola(), q);
    const Vec3 p(frame.p.x(), frame.p.y(), frame.p.z());
    if ((p - X.p).norm() > 1e-9) std::abort();
  }
}

void polypod_forward(benchmark::State& state) {
  const auto q = joints();
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(machine::forward(lola(), q[i++ & 1023]));
}
BENCHMARK(polypod_forward);

void kdl_forward(benchmark::State& state) {
  must_agree();
  const KDL::Chain chain = kdl_chain();
  KDL::ChainFkSolverPos_recursive fk(chain);
  std::vector<KDL::JntArray> q;
  for (const auto& v : joints()) q.push_back(kdl_joints(v));
  std::size_t i = 0;
  for (auto _ : state) {
    KDL::Frame frame;
    fk.JntToCart(q[i++ & 1023], frame);
    benchmark::DoNotOptimize(frame);
  }
}
BENCHMARK(kdl_forward);

void polypod_forward_and_jacobian(benchmark::State& state) {
  const auto q = joints();
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(machine::forward_jacobian(lola(), q[i++ & 1023]));
}
BENCHMARK(polypod_forward_and_jacobian);

void kdl_jacobian(benchmark::State& state) {
  const KDL::Chain chain = kdl_chain();
  KDL::ChainJntToJacSolver solver(chain);
  std::vector<KDL::JntArray> q;
  for (const auto& v : joints()) q.push_back(kdl_joints(v));
  KDL::Jacobian J(5);
  std::size_t i = 0;
  for (auto _ : state) {
    solver.JntToJac(q[i++ & 1023], J);
    benchmark::DoNotOptimize(J.data.data());
  }
}
BENCHMARK(kdl_jacobian);

/// All eight branches.
void polypod_inverse(benchmark::State& state) {
  const auto inverse = *machine::WristInverse::of(lola());
  std::vector<Pose> poses;
  for (const auto& q : joints()) poses.push_back(machine::forward(lola(), q));
  machine::WristInverse::Branches branches;
  std::size_t i = 0;
  for (auto _ : state) {
    const Pose& X = poses[i++ & 1023];
    inverse.solve(X.p, X.R.col(2), branches);
    benchmark::DoNotOptimize(inverse.first_within_limits(branches));
  }
}
BENCHMARK(polypod_inverse);

/// Poses of an arm over the middle of its ranges.
std::vector<Pose> poses_of(const machine::SerialArm& arm) {
  std::vector<Pose> poses;
  for (int k = 0; k < 1024; ++k) {
    machine::JointVector q(6);
    for (int i = 0; i < 6; ++i) {
      const auto range = machine::joint_range(arm, i);
      q[i] = 0.5 * (range.min + range.max) + 0.3 * (range.max - range.min) * std::sin(0.37 * k + 1.3 * i);
    }
    poses.push_back(machine::forward(arm, q));
  }
  return poses;
}

/// All eight branches of an arm with six joints, in the closed form that it has.
template <class Inverse>
void six_joint_inverse(benchmark::State& state, const char* name) {
  const machine::AnyMachine m = *machine::load(name);
  const auto& arm = std::get<machine::SerialArm>(m);
  const auto inverse = Inverse::of(arm);
  if (!inverse) std::abort();
  const std::vector<Pose> poses = poses_of(arm);
  machine::SixJointBranches branches;
  std::size_t i = 0, count = 0;
  for (auto _ : state) {
    inverse->solve(poses[i++ & 1023], branches);
    for (std::size_t b = 0; b < 8; ++b) count += branches.exists[b] ? 1 : 0;
    benchmark::DoNotOptimize(branches);
  }
  state.counters["branches"] = benchmark::Counter(static_cast<double>(count), benchmark::Counter::kAvgIterations);
}
void spherical_wrist(benchmark::State& state, const char* name) {
  six_joint_inverse<machine::SphericalWristInverse>(state, name);
}
BENCHMARK_CAPTURE(spherical_wrist, kuka, "kuka-kr210");
BENCHMARK_CAPTURE(spherical_wrist, puma, "puma560");
/// The published closed form on the same arm at the same poses.
void opw_as_published(benchmark::State& state) {
  const bench::Opw arm{0.35, -0.041, 0, 0.675, 1.15, 1.2, 0.215};  // KR 210 R2700 extra
  std::vector<Pose> poses = poses_of(std::get<machine::SerialArm>(*machine::load("kuka-kr210")));
  const Mat3 out_of_flange = rotation_x(std::numbers::pi);  // z of the paper; z_T points into the flange
  for (Pose& X : poses) X.R = X.R * out_of_flange;
  std::array<bench::Opw::Joints, 8> solutions{};
  for (const Pose& X : poses) {  // a peer that is wrong would mean nothing
    arm.inverse(X, solutions);
    for (const bench::Opw::Joints& q : solutions) {
      if (!std::isfinite(q[1])) continue;
      const Pose there = arm.forward(q);
      if ((there.p - X.p).norm() > 1e-9 || (there.R - X.R).norm() > 1e-9) std::abort();
    }
  }
  std::size_t i = 0, count = 0;
  for (auto _ : state) {
    arm.inverse(poses[i++ & 1023], solutions);
    for (const bench::Opw::Joints& q : solutions) count += std::isfinite(q[1]) ? 1 : 0;
    benchmark::DoNotOptimize(solutions);
  }
  state.counters["branches"] = benchmark::Counter(static_cast<double>(count), benchmark::Counter::kAvgIterations);
}
BENCHMARK(opw_as_published);

void three_parallel(benchmark::State& state, const char* name) {
  six_joint_inverse<machine::ThreeParallelInverse>(state, name);
}
BENCHMARK_CAPTURE(three_parallel, ur10e, "ur10e");
/// The quartic of the first three axes, on an arm that does not need it.
void pieper(benchmark::State& state, const char* name) {
  six_joint_inverse<machine::PieperInverse>(state, name);
}
BENCHMARK_CAPTURE(pieper, kuka, "kuka-kr210");

/// KDL's numeric inverse finds one branch of the full pose; it starts from a neighbour.
void kdl_inverse(benchmark::State& state) {
  const KDL::Chain chain = kdl_chain();
  KDL::ChainFkSolverPos_recursive fk(chain);
  KDL::ChainIkSolverPos_LMA solver(chain);
  std::vector<KDL::JntArray> seeds;
  std::vector<KDL::Frame> frames;
  for (const auto& v : joints()) {
    seeds.push_back(kdl_joints(v));
    KDL::Frame frame;
    fk.JntToCart(seeds.back(), frame);
    frames.push_back(frame);
    for (unsigned j = 0; j < 5; ++j) seeds.back()(j) += 0.02;
  }
  KDL::JntArray q(5);
  std::size_t i = 0;
  for (auto _ : state) {
    solver.CartToJnt(seeds[i & 1023], frames[i & 1023], q);
    ++i;
    benchmark::DoNotOptimize(q.data.data());
  }
}
BENCHMARK(kdl_inverse);

/// What a point of a program asks of the machine: inverse, Jacobian and the 3 x 3 compliance.
void polypod_compliance_probe(benchmark::State& state) {
  const machine::AnyMachine m = *machine::load("lola50");
  statics::Probe probe(m, Mat3::Identity());
  Mat3 C;
  int i = 0;
  for (auto _ : state) {
    probe.at(Vec3(-0.5 + 0.001 * (i & 1023), -1.3, -0.1), C);
    ++i;
    benchmark::DoNotOptimize(C);
  }
}
BENCHMARK(polypod_compliance_probe);

/// All solutions with the limits that they break, for poses within a part of the workspace.
void any_inverse(benchmark::State& state, const char* name) {
  const machine::AnyMachine m = *machine::load(name);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> part(-1, 1);
  std::vector<Pose> poses;
  for (int k = 0; k < 1024; ++k) {
    const double a = part(random), b = part(random), c = part(random), d = part(random), e = part(random);
    if (std::holds_alternative<machine::SerialArm>(m)) {
      machine::JointVector q = machine::JointVector::Zero(kinematics::joint_count(m));
      q.head<5>() << 0.4 * a, 0.4 * b, 0.4 * c, 0.4 * d, 0.3 + 0.4 * e;
      poses.push_back(kinematics::forward(m, q).poses.front());
      continue;
    }
    const Pose home = *kinematics::home_pose(m);
    const bool turns = kinematics::task(m).turns();
    const double size = turns ? 0.005 : 0.1;
    poses.push_back({turns ? rotation_abc(0.2 * d, 0.2 * e, 0) : home.R, home.p + size * Vec3(a, b, c)});
  }
  std::size_t i = 0, solutions = 0;
  for (auto _ : state) {
    const kinematics::InverseResult result = kinematics::inverse(m, poses[i++ & 1023]);
    solutions += result.solutions.size();
    benchmark::DoNotOptimize(result.solutions.data());
  }
  state.counters["solutions"] = benchmark::Counter(static_cast<double>(solutions), benchmark::Counter::kAvgIterations);
}
BENCHMARK_CAPTURE(any_inverse, arm, "lola50");
BENCHMARK_CAPTURE(any_inverse, six_joints, "kuka-kr210");
BENCHMARK_CAPTURE(any_inverse, struts, "hexapod-strut");
BENCHMARK_CAPTURE(any_inverse, sliders, "hexapod-slider");
BENCHMARK_CAPTURE(any_inverse, rotary_delta, "delta-brno");
BENCHMARK_CAPTURE(any_inverse, linear_delta, "delta-linear");

}  // namespace
