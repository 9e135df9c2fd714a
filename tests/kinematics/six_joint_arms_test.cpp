// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The closed inverses of arms with six joints: every branch against the forward, against a search that knows nothing
// of wrists, and on the way over singular poses.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>
#include <numbers>
#include <random>
#include <set>

#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/families/serial/six_joint_inverse.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod {
namespace {

using machine::JointVector;
using machine::SerialArm;
using machine::SixJointBranches;
using test::apart, test::arm_of, test::difference;

constexpr double kPi = std::numbers::pi;
// m and rad: six turns of an arm of 3 m, some ten roundings of 2e-16 each.
constexpr double kExact = 1e-12;

struct Named {
  const char* name;
  SerialArm arm;
};

SerialArm catalogue_arm(const char* name) {
  return std::get<SerialArm>(test::load(name));
}

// Every length of the ortho-parallel basis at once, turned base, tool aside, senses and zeros of all kinds.
constexpr const char* kAllOffsets = R"(
family = "serial"
dh = [ {a_mm=175, alpha_deg=90, d_mm=495, sign=-1, theta_offset_deg=25}, {a_mm=900, theta_offset_deg=90, d_mm=60},
       {a_mm=175, alpha_deg=90, sign=-1, d_mm=-145}, {alpha_deg=-90, d_mm=960, sign=-1, theta_offset_deg=-40},
       {alpha_deg=90, theta_offset_deg=15}, {d_mm=135, sign=-1, theta_offset_deg=70} ]
base = { x_mm = 300, y_mm = -200, z_mm = 50, a_deg = 160, b_deg = 10, c_deg = 40 }
tool = { x_mm = 250, z_mm = 180, b_deg = -90, c_deg = 12 }
)";
// A row that is locked between the arm and its wrist, and one behind.
constexpr const char* kLockedRows = R"(
family = "serial"
convention = "modified"
dh = [ {d_mm=350}, {a_mm=85, alpha_deg=-90, theta_offset_deg=-90}, {a_mm=380, theta_offset_deg=-90},
       {a_mm=40, alpha_deg=-90, d_mm=100}, {a_mm=30, alpha_deg=0, d_mm=325}, {alpha_deg=90}, {alpha_deg=-90, d_mm=85}, {a_mm=50, alpha_deg=30, d_mm=100} ]
locked = { 4 = 20, 8 = -35 }
)";
// A wrist of painting robots: axes 4 and 5, and 5 and 6, cross at 60 deg.
constexpr const char* kObliqueWrist = R"(
family = "serial"
dh = [ {a_mm=300, alpha_deg=90, d_mm=800}, {a_mm=1000, theta_offset_deg=90}, {a_mm=120, alpha_deg=90},
       {alpha_deg=-60, d_mm=1200}, {alpha_deg=60}, {d_mm=200} ]
tool = { x_mm = 20, z_mm = 150 }
)";
// Links of equal length: the wrist can stand on axis 2.
constexpr const char* kEqualLinks = R"(
family = "serial"
dh = [ {alpha_deg=90, d_mm=400}, {a_mm=500, theta_offset_deg=90}, {alpha_deg=90}, {alpha_deg=-90, d_mm=500},
       {alpha_deg=90}, {d_mm=90} ]
)";
// Three parallel axes with every length, axis 5 oblique to axis 4.
constexpr const char* kThreeParallel = R"(
family = "serial"
dh = [ {d_mm=180, a_mm=70, alpha_deg=90, theta_offset_deg=10}, {a_mm=-610, sign=-1}, {a_mm=-570, d_mm=30, theta_offset_deg=-20},
       {d_mm=150, a_mm=45, alpha_deg=70}, {d_mm=120, alpha_deg=-80, sign=-1, theta_offset_deg=35}, {d_mm=110} ]
base = { z_mm = 300, a_deg = 90 }
tool = { y_mm = 30, z_mm = 60, a_deg = 200 }
)";

// Any first three axes before a spherical wrist: skew, meeting, the first two parallel; and one with a shoulder like
// that of a human arm.
constexpr const char* kSkewShoulder = R"(
family = "serial"
dh = [ {a_mm=120, alpha_deg=75, d_mm=400, theta_offset_deg=20}, {a_mm=500, alpha_deg=25, d_mm=80}, {a_mm=90, alpha_deg=-70, d_mm=40},
       {alpha_deg=90, d_mm=450}, {alpha_deg=-90}, {d_mm=100} ]
base = { x_mm = 100, b_deg = 30 }
tool = { x_mm = 20, z_mm = 150, a_deg = 40 }
)";
constexpr const char* kMeetingShoulder = R"(
family = "serial"
dh = [ {alpha_deg=60, d_mm=400, sign=-1}, {a_mm=450, alpha_deg=90, d_mm=50}, {a_mm=60, alpha_deg=90},
       {alpha_deg=-80, d_mm=420}, {alpha_deg=80}, {d_mm=100} ]
)";
constexpr const char* kParallelShoulder = R"(
family = "serial"
dh = [ {a_mm=400, d_mm=300}, {a_mm=60, alpha_deg=-65, d_mm=70}, {a_mm=350, alpha_deg=80, d_mm=30},
       {alpha_deg=-90, d_mm=150}, {alpha_deg=90}, {d_mm=100} ]
)";

const std::vector<Named>& arms() {
  static const std::vector<Named> all = {
      {"kuka-kr210", catalogue_arm("kuka-kr210")},
      {"abb-irb6700", catalogue_arm("abb-irb6700")},
      {"staubli-tx200", catalogue_arm("staubli-tx200")},
      {"mitsubishi-rv6sdl", catalogue_arm("mitsubishi-rv6sdl")},
      {"puma560", catalogue_arm("puma560")},
      {"ur10e", catalogue_arm("ur10e")},
      {"all-offsets", arm_of(kAllOffsets)},
      {"locked-rows", arm_of(kLockedRows)},
      {"oblique-wrist", arm_of(kObliqueWrist)},
      {"equal-links", arm_of(kEqualLinks)},
      {"three-parallel", arm_of(kThreeParallel)},
      {"skew-shoulder", arm_of(kSkewShoulder)},
      {"meeting-shoulder", arm_of(kMeetingShoulder)},
      {"parallel-shoulder", arm_of(kParallelShoulder)},
  };
  return all;
}

void solve(const SerialArm& arm, const Pose& X, SixJointBranches& out, const double* reference = nullptr) {
  const auto inverse = machine::six_joint_inverse(arm);
  ASSERT_TRUE(inverse.has_value());
  std::visit([&](const auto& form) { form.solve(X, out, reference); }, *inverse);
}

JointVector random_joints(std::mt19937& random, double most = kPi) {
  std::uniform_real_distribution<double> angle(-most, most);
  return JointVector::NullaryExpr(6, [&] { return angle(random); });
}

JointVector joints_of(const SixJointBranches& branches, int k) {
  return Eigen::Map<const Eigen::Matrix<double, 6, 1>>(branches.joints[k]);
}

TEST(SixJointArms, EveryBranchGivesItsPoseAndOneTheJointsItCameFrom) {
  for (const auto& [name, arm] : arms()) {
    SCOPED_TRACE(name);
    std::mt19937 random(1);
    SixJointBranches branches;
    double worst = 0, farthest = 0;
    std::size_t count = 0;
    for (int k = 0; k < 100000; ++k) {
      const JointVector q = random_joints(random);
      const Pose X = machine::forward(arm, q);
      solve(arm, X, branches);
      double nearest = 10;
      for (int b = 0; b < SixJointBranches::kCount; ++b) {
        if (!branches.exists[b]) continue;
        ++count;
        worst = std::max(worst, difference(machine::forward(arm, joints_of(branches, b)), X));
        nearest = std::min(nearest, apart(joints_of(branches, b), q));
      }
      farthest = std::max(farthest, nearest);
    }
    EXPECT_LT(worst, kExact);
    // rad: next to singular poses joints are less certain than the pose, by one over the distance.
    EXPECT_LT(farthest, 1e-7);
    EXPECT_GE(count, 200000U);
    std::printf("%-18s pose %.1e, joints %.1e, %.2f branches a pose\n", name, worst, farthest,
                static_cast<double>(count) / 1e5);
  }
}

// Pieper's quartic, written for any first three axes, comes to the same on arms whose axes 2 and 3 are parallel.
TEST(SixJointArms, TheQuarticOfTheFirstThreeAxesFindsTheSameBranches) {
  // rad: next to a pose at which two roots meet, each is known to the root of the rounding, times what the pose asks.
  static constexpr double kNearDoubleRoots = 1e-5;
  int compared = 0;
  for (const auto& [name, arm] : arms()) {
    const auto spherical = machine::SphericalWristInverse::of(arm);
    const auto pieper = machine::PieperInverse::of(arm);
    if (!spherical || !pieper) continue;
    ++compared;
    SCOPED_TRACE(name);
    std::mt19937 random(5);
    SixJointBranches a, b;
    for (int k = 0; k < 2000; ++k) {
      const Pose X = machine::forward(arm, random_joints(random));
      spherical->solve(X, a);
      pieper->solve(X, b);
      const auto covers = [](const SixJointBranches& all, const SixJointBranches& some) {
        for (int i = 0; i < SixJointBranches::kCount; ++i) {
          if (!some.exists[i] || some.singular[i]) continue;
          double nearest = 10;
          for (int j = 0; j < SixJointBranches::kCount; ++j)
            if (all.exists[j]) nearest = std::min(nearest, apart(joints_of(all, j), joints_of(some, i)));
          EXPECT_LT(nearest, kNearDoubleRoots);
        }
      };
      covers(a, b);
      covers(b, a);
    }
  }
  EXPECT_GE(compared, 5) << "the catalogue alone has five arms with both";
}

/// Newton's method from random joints, which knows nothing of wrists: the joints modulo a turn that it ends at.
std::vector<JointVector> searched(const SerialArm& arm, const Pose& X, int starts, std::mt19937& random) {
  std::vector<JointVector> out;
  for (int k = 0; k < starts; ++k) {
    JointVector q = random_joints(random);
    for (int step = 0; step < 60; ++step) {
      const machine::ForwardJacobian at = machine::forward_jacobian(arm, q);
      Vec6 error;
      error << X.p - at.X_MT.p, rotation_vector(X.R * at.X_MT.R.transpose());
      if (error.norm() < 1e-13) break;
      const Mat6 J = at.J;
      Vec6 change = J.partialPivLu().solve(error);
      const double size = change.cwiseAbs().maxCoeff();
      if (!std::isfinite(size)) break;
      if (size > 0.5) change *= 0.5 / size;
      q += change;
    }
    if (!(difference(machine::forward(arm, q), X) < 1e-11)) continue;
    if (std::none_of(out.begin(), out.end(), [&](const JointVector& known) { return apart(known, q) < 1e-5; })) {
      out.push_back(q);
    }
  }
  return out;
}

/// `off`: how far the wrist (kind 0) or the elbow (kind 1) is from being singular, rad. An elbow that is not singular
/// anywhere, as those before some wrists, stays where it was drawn.
JointVector near_singular(const SerialArm& arm, std::mt19937& random, int kind, double off) {
  JointVector q = random_joints(random);
  // The straight wrist, or the stretched arm, from where the determinant changes its sign along one joint.
  const int joint = kind == 0 ? 4 : 2;
  const auto determinant = [&](double value) {
    JointVector at = q;
    at[joint] = value;
    return Mat6(machine::forward_jacobian(arm, at).J).determinant();
  };
  for (double a = -kPi; a < kPi; a += 0.1) {
    double low = a, high = a + 0.1;
    if ((determinant(low) > 0) == (determinant(high) > 0)) continue;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      ((determinant(middle) > 0) == (determinant(low) > 0) ? low : high) = middle;
    }
    q[joint] = low + off;
    return q;
  }
  EXPECT_NE(kind, 0) << "every wrist is straight somewhere";
  return q;
}

TEST(SixJointArms, BranchesAreThoseOfASearchAndNoneIsMissing) {
  constexpr int kPoses = 120, kStarts = 160;
  for (const auto& [name, arm] : arms()) {
    SCOPED_TRACE(name);
    std::mt19937 random(2);
    SixJointBranches branches;
    std::size_t found = 0, closed = 0, not_found = 0;
    for (int k = 0; k < kPoses; ++k) {
      SCOPED_TRACE(k);
      // A third of the poses is 1e-2 to 1e-3 rad from a straight wrist or a stretched arm.
      const JointVector q =
          k % 3 != 0 ? random_joints(random) : near_singular(arm, random, k % 2, k % 4 < 2 ? 1e-2 : 1e-3);
      const Pose X = machine::forward(arm, q);
      solve(arm, X, branches);
      const std::vector<JointVector> search = searched(arm, X, kStarts, random);
      for (const JointVector& s : search) {
        double nearest = 10;
        for (int b = 0; b < SixJointBranches::kCount; ++b)
          if (branches.exists[b]) nearest = std::min(nearest, apart(joints_of(branches, b), s));
        EXPECT_LT(nearest, 1e-5) << "the closed form misses " << s.transpose();
      }
      for (int b = 0; b < SixJointBranches::kCount; ++b) {
        if (!branches.exists[b]) continue;
        ++closed;
        // Different branches are different joints; each is one that the search ends at, or solves the pose exactly.
        for (int c = 0; c < b; ++c) {
          if (branches.exists[c]) {
            EXPECT_GT(apart(joints_of(branches, b), joints_of(branches, c)), 1e-6) << b << c;
          }
        }
        not_found += std::none_of(search.begin(), search.end(),
                                  [&](const JointVector& s) { return apart(s, joints_of(branches, b)) < 1e-5; });
      }
      found += search.size();
    }
    std::printf("%-18s closed %zu, search %zu (%zu not found by it)\n", name, closed, found, not_found);
    EXPECT_GE(found + closed / 50, closed) << "a search from 160 starts ends nearly everywhere";
  }
}

TEST(SixJointArms, AtAndNextToSingularPosesThePoseIsExact) {
  for (const auto& [name, arm] : arms()) {
    SCOPED_TRACE(name);
    std::mt19937 random(3);
    SixJointBranches branches;
    for (const double off : {0.0, 1e-15, 1e-13, 1e-12, 1e-11, 1e-9, 1e-7, 1e-5}) {
      SCOPED_TRACE(off);
      for (int k = 0; k < 40; ++k) {
        const JointVector q = near_singular(arm, random, k % 2, off);
        const Pose X = machine::forward(arm, q);
        const double* references[] = {nullptr, q.data()};
        for (const double* reference : references) {
          solve(arm, X, branches, reference);
          int count = 0;
          for (int b = 0; b < SixJointBranches::kCount; ++b) {
            if (!branches.exists[b]) continue;
            ++count;
            // Within kFree (1e-12) an angle counts as free, which moves the pose by that much.
            EXPECT_LT(difference(machine::forward(arm, joints_of(branches, b)), X), 3 * kExact) << b;
          }
          EXPECT_GE(count, 2);
        }
      }
    }
  }
}

// A straight wrist, W on axis 1, W on axis 2: with a reference the joint that is free keeps its value, and the branch.
TEST(SixJointArms, AtSingularPosesTheReferenceIsKept) {
  const auto nearest = [](const SixJointBranches& branches, const JointVector& q) {
    double best = 10;
    int which = -1;
    for (int b = 0; b < SixJointBranches::kCount; ++b) {
      if (!branches.exists[b]) continue;
      const double off = (joints_of(branches, b) - q).cwiseAbs().maxCoeff();
      if (off < best) {
        best = off;
        which = b;
      }
    }
    EXPECT_GE(which, 0);
    EXPECT_LT(best, 1e-6);
    EXPECT_TRUE(branches.singular[which]);
  };
  SixJointBranches branches;
  for (const char* name : {"kuka-kr210", "abb-irb6700", "staubli-tx200", "mitsubishi-rv6sdl", "puma560", "ur10e"}) {
    SCOPED_TRACE(name);
    const SerialArm arm = catalogue_arm(name);
    JointVector q(6);
    q << 0.4, -0.9, 0.6, 1.3, 0, -0.7;  // q5 = 0
    solve(arm, machine::forward(arm, q), branches, q.data());
    nearest(branches, q);
    solve(arm, machine::forward(arm, q), branches);
    for (int b = 0; b < SixJointBranches::kCount; ++b) {
      if (branches.exists[b]) {
        EXPECT_LT(difference(machine::forward(arm, joints_of(branches, b)), machine::forward(arm, q)), kExact);
      }
    }
  }
  const SerialArm equal = arm_of(kEqualLinks);
  JointVector q(6);
  // The wrist over axis 1: 500 mm up and 500 mm forward would stand off, so the elbow is bent back over it.
  q << 0.4, 0.3, 0, 1.3, 0.5, -0.7;
  int over_axis = 0;
  for (double third = -3; third < 3; third += 1e-3) {  // where W is nearest to axis 1
    JointVector a = q, b = q;
    a[2] = third;
    b[2] = third + 1e-3;
    const auto out = [&](const JointVector& at) {
      const Pose X = machine::forward(equal, at);
      const Vec3 w = X.p - 0.09 * X.R.col(2);
      return std::cos(at[0]) * w.x() + std::sin(at[0]) * w.y();
    };
    if ((out(a) > 0) == (out(b) > 0)) continue;
    for (int i = 0; i < 60; ++i) {
      JointVector m = a;
      m[2] = 0.5 * (a[2] + b[2]);
      ((out(m) > 0) == (out(a) > 0) ? a : b) = m;
    }
    solve(equal, machine::forward(equal, a), branches, a.data());
    nearest(branches, a);
    ++over_axis;
  }
  EXPECT_GE(over_axis, 1);
  // Folded: the forearm back along the upper arm.
  q << 0.4, 0.3, -kPi / 2, 1.3, 0.5, -0.7;
  solve(equal, machine::forward(equal, q), branches, q.data());
  nearest(branches, q);
}

// A path of the joints over a straight wrist, and back: the joints of its poses, each seen from the last ones, are it.
TEST(SixJointArms, JointsAreContinuousAlongAPathOverAStraightWrist) {
  for (const char* name : {"kuka-kr210", "abb-irb6700", "staubli-tx200", "mitsubishi-rv6sdl", "puma560", "ur10e"}) {
    SCOPED_TRACE(name);
    const machine::AnyMachine any = test::load(name);
    const auto& arm = std::get<SerialArm>(any);
    const auto at = [&](int k) {
      JointVector q(6);
      const double s = 0.02 * k;  // q5 is exactly 0 at k = 0
      for (int i = 0; i < 6; ++i) {
        const auto range = machine::joint_range(arm, i);
        const double middle = std::clamp(0.5 * (range.min + range.max), -2.0, 2.0);
        q[i] = i == 4 ? s : middle + 0.3 + 0.1 * i + 0.05 * s;
      }
      return q;
    };
    JointVector last = at(-40);
    double most = 0;
    for (int k = -39; k <= 40; ++k) {
      const JointVector q = at(k);
      const auto result = kinematics::inverse_near(any, machine::forward(arm, q), last);
      ASSERT_FALSE(result.solutions.empty()) << k;
      const JointVector& found = result.solutions.front().joints;
      EXPECT_LT(difference(machine::forward(arm, found), machine::forward(arm, q)), kExact);
      most = std::max(most, (found - last).cwiseAbs().maxCoeff());
      // At the straight wrist itself joint 4 stays where it was; joint 6 takes its share.
      EXPECT_LT((found - q).cwiseAbs().maxCoeff(), k == 0 ? 5e-3 : 1e-9) << k;
      last = found;
    }
    EXPECT_LT(most, 0.03);
  }
}

TEST(SixJointArms, WhatIsNotFiniteHasNoSolution) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const machine::AnyMachine arm = test::load("ur10e");
  const JointVector q = JointVector::LinSpaced(6, -0.9, 1.1);
  const Pose X = kinematics::forward(arm, q).poses.at(0);
  Pose nowhere = X;
  nowhere.p.x() = kNan;
  JointVector never = q;
  never[3] = kNan;
  for (const auto& result : {kinematics::inverse(arm, nowhere), kinematics::inverse_near(arm, nowhere, q),
                             kinematics::inverse_near(arm, X, never), kinematics::inverse_near(arm, X, q.head(5))}) {
    EXPECT_TRUE(result.solutions.empty());
    EXPECT_FALSE(result.reason.empty());
  }
}

// Names of the branches at known postures, as the makers say them.
TEST(SixJointArms, PosturesHaveTheirNames) {
  const auto name_of = [](const SerialArm& arm, const std::vector<double>& deg) {
    JointVector q(6);
    for (int i = 0; i < 6; ++i) q[i] = units::from_deg(deg[static_cast<std::size_t>(i)]);
    SixJointBranches branches;
    solve(arm, machine::forward(arm, q), branches);
    for (int b = 0; b < SixJointBranches::kCount; ++b)
      if (branches.exists[b] && apart(joints_of(branches, b), q) < 1e-9) {
        return machine::branch_name(arm, static_cast<unsigned>(b));
      }
    return std::string("none");
  };
  const SerialArm kuka = catalogue_arm("kuka-kr210");
  // The position in which KUKA draws the arm: upper arm upright, forearm level, and the wrist bent to either side.
  EXPECT_EQ(name_of(kuka, {0, -90, 90, 0, 30, 0}), "front elbow-up");
  EXPECT_EQ(name_of(kuka, {0, -90, 90, 0, -30, 0}), "front elbow-up wrist-flipped");
  EXPECT_EQ(name_of(kuka, {0, -20, -60, 0, 30, 0}), "front elbow-down");
  EXPECT_EQ(name_of(kuka, {0, -140, -30, 0, 30, 0}), "back elbow-up");
  const SerialArm abb = catalogue_arm("abb-irb6700");
  EXPECT_EQ(name_of(abb, {0, 0, 0, 0, 30, 0}), "front elbow-up");
  EXPECT_EQ(name_of(abb, {0, 0, 0, 0, -30, 0}), "front elbow-up wrist-flipped");
  EXPECT_EQ(name_of(abb, {0, -20, -150, 0, 30, 0}), "back elbow-up");
  const SerialArm staubli = catalogue_arm("staubli-tx200");
  EXPECT_EQ(name_of(staubli, {0, 0, 90, 0, 30, 0}), "front elbow-up");
  const SerialArm ur = catalogue_arm("ur10e");
  EXPECT_EQ(name_of(ur, {0, -90, 90, -90, 90, 0}), "front elbow-up");
  EXPECT_EQ(name_of(ur, {0, -90, 90, -90, -90, 0}), "front elbow-up wrist-flipped");
  EXPECT_EQ(name_of(ur, {0, -90, -90, -90, 90, 0}), "back elbow-up");
}

TEST(SixJointArms, TurnsWithinTheRangesAreTheNearestToTheReference) {
  const SerialArm arm = catalogue_arm("kuka-kr210");
  JointVector q(6);
  q << 0.4, -1.5, 1.2, 5.2, 0.7, -4.9;  // joints 4 and 6 beyond 180 deg, within +-350 deg
  const Pose X = machine::forward(arm, q);
  SixJointBranches branches;
  solve(arm, X, branches, q.data());
  EXPECT_LT((joints_of(branches, 0) - q).cwiseAbs().maxCoeff(), 1e-9);
  // Without a reference: the turn in -180 .. 180 deg.
  solve(arm, X, branches);
  EXPECT_NEAR(branches.joints[0][3], q[3] - 2 * kPi, 1e-9);
  EXPECT_NEAR(branches.joints[0][5], q[5] + 2 * kPi, 1e-9);
  // A reference beyond the range: the last turn that is within.
  JointVector far = q;
  far[3] = 9;
  solve(arm, X, branches, far.data());
  EXPECT_NEAR(branches.joints[0][3], q[3], 1e-9);
}

/// The form of the arm that was asked for last is kept: whatever figure of it is another, it is another arm.
TEST(SixJointArms, AnArmThatDiffersInAnyFigureIsNotTakenForTheLast) {
  for (const char* name : {"kuka-kr210", "ur10e", "lola50"}) {
    const SerialArm arm = catalogue_arm(name);
    std::vector<SerialArm> others;
    const auto with = [&](auto&& change) {
      others.push_back(arm);
      change(others.back());
    };
    for (std::size_t row = 0; row < 2; ++row) {
      with([&](SerialArm& a) { a.dh[row].a += 0.01; });
      with([&](SerialArm& a) { a.dh[row].theta_offset += 0.1; });
      with([&](SerialArm& a) { a.dh[row].sign = -a.dh[row].sign; });
    }
    with([](SerialArm& a) { a.dh[0].d += 0.02; });
    with([](SerialArm& a) { a.dh[1].alpha += 0.2; });  // no longer of the form
    with([](SerialArm& a) { a.X_MB.p.x() += 0.1; });
    with([](SerialArm& a) { a.X_MB.R = rotation_abc(0, 0, 0.3) * a.X_MB.R; });
    with([](SerialArm& a) { a.X_FT.p += 0.05 * a.X_FT.R.col(2); });
    JointVector q = JointVector::Zero(arm.free_joints());
    for (Eigen::Index i = 0; i < q.size(); ++i) {
      const auto range = machine::joint_range(arm, static_cast<int>(i));
      q[i] = range.min + (0.55 + 0.02 * static_cast<double>(i)) * (range.max - range.min);
    }
    for (const SerialArm& other : others) {
      ASSERT_FALSE(machine::inverse(arm, machine::forward(arm, q)).solutions.empty()) << name;  // the last arm
      const Pose X = machine::forward(other, q);
      const auto found = machine::inverse(other, X);
      ASSERT_FALSE(found.solutions.empty()) << name << ' ' << &other - others.data();
      for (const auto& s : found.solutions) {
        const Pose back = machine::forward(other, s.joints);
        EXPECT_LT((back.p - X.p).norm(), 1e-9) << name << ' ' << &other - others.data();
        EXPECT_LT((back.R.col(2) - X.R.col(2)).norm(), 1e-9) << name << ' ' << &other - others.data();
      }
    }
    // Limits alone: the same joints, and one that breaks them.
    SerialArm narrow = arm;
    narrow.dh[0].range = {q[0] + 0.1, q[0] + 0.2};
    const Pose X = machine::forward(arm, q);
    ASSERT_NE(machine::inverse(arm, X).reachable(), nullptr) << name;
    for (const auto& s : machine::inverse(narrow, X).solutions)
      EXPECT_TRUE(s.violations != 0 || std::abs(s.joints[0] - q[0]) > 0.05) << name;
  }
}

}  // namespace
}  // namespace polypod
