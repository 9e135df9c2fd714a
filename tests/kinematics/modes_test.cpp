// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/modes.hpp"

#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <cstring>
#include <limits>
#include <random>

#include "leg_homotopy.hpp"
#include "leg_subdivision.hpp"
#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::machine {
namespace {

using leg_homotopy::Legs;
using leg_homotopy::LegsT;
using leg_homotopy::Point;
using ::testing::HasSubstr;

// Platforms here are of size 1; Newton ends at rounding times the condition, which stays below 1e6.
constexpr double kCloses = 1e-9;
constexpr double kSamePose = 1e-7;

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double number() { return 2 * (static_cast<double>(engine_()) / 4294967295.0) - 1; }
  Vec3 vector(double flat = 1) {
    const double x = number(), y = number();
    return {x, y, flat * number()};
  }
  Pose pose() { return {rotation_of(2.0 * vector()), Vec3(0.4 * number(), 0.4 * number(), 0.7 + 0.4 * number())}; }

 private:
  std::mt19937 engine_;
};

SixLegs legs_at(const Pose& X, const SixPoints& anchor, const SixPoints& end) {
  SixLegs legs{anchor, end, {}};
  for (int i = 0; i < kLegs; ++i) legs.length[i] = (X * end[i] - anchor[i]).norm();
  return legs;
}

/// flat = 0: all joints of each platform in a plane.
SixLegs random_legs(Random& random, const Pose& X, double flat = 1) {
  SixPoints anchor, end;
  for (int i = 0; i < kLegs; ++i) {
    anchor[i] = random.vector(flat);
    end[i] = 0.6 * random.vector(flat);
  }
  return legs_at(X, anchor, end);
}

bool close(const Pose& a, const Pose& b, double tolerance = kSamePose) {
  return (a.p - b.p).norm() < tolerance && (a.R - b.R).norm() < tolerance;
}
bool holds(const std::vector<Pose>& poses, const Pose& X, double tolerance = kSamePose) {
  return std::any_of(poses.begin(), poses.end(), [&](const Pose& Y) { return close(X, Y, tolerance); });
}

void expect_closed(const SixLegs& legs, const AssemblyModes& modes) {
  ASSERT_EQ(modes.poses.size(), modes.residuals.size());
  for (std::size_t k = 0; k < modes.poses.size(); ++k) {
    const Pose& X = modes.poses[k];
    EXPECT_NEAR((X.R.transpose() * X.R - Mat3::Identity()).norm(), 0, 1e-14);
    EXPECT_GT(X.R.determinant(), 0);
    for (int i = 0; i < kLegs; ++i) EXPECT_NEAR((X * legs.end[i] - legs.anchor[i]).norm(), legs.length[i], kCloses);
    EXPECT_LT(modes.residuals[k], kCloses);
  }
}

/// Gauss-Newton on the nine entries of R and three of t as they are (legs and R^T R = 1): shares nothing with the
/// library, neither the unknowns nor the steps.
std::optional<Pose> newton_on_entries(const SixLegs& legs, const Pose& seed) {
  Eigen::Matrix<double, 12, 1> u, f;
  for (int k = 0; k < 9; ++k) u[k] = seed.R.data()[k];
  u.tail<3>() = seed.p;
  double moved = 1;
  for (int step = 0; step < 60 && moved > 1e-13; ++step) {
    Eigen::Matrix<double, 12, 12> J = Eigen::Matrix<double, 12, 12>::Zero();
    const Eigen::Map<const Mat3> R(u.data());
    for (int i = 0; i < kLegs; ++i) {
      const Vec3 y = R * legs.end[i] + u.tail<3>() - legs.anchor[i];
      f[i] = y.squaredNorm() - legs.length[i] * legs.length[i];
      for (int c = 0; c < 3; ++c) J.block<1, 3>(i, 3 * c) = 2 * legs.end[i][c] * y.transpose();
      J.block<1, 3>(i, 9) = 2 * y.transpose();
    }
    int row = 6;
    for (int a = 0; a < 3; ++a) {
      for (int b = a; b < 3; ++b, ++row) {
        f[row] = R.col(a).dot(R.col(b)) - (a == b ? 1 : 0);
        J.block<1, 3>(row, 3 * a) += R.col(b).transpose();
        J.block<1, 3>(row, 3 * b) += R.col(a).transpose();
      }
    }
    const Eigen::Matrix<double, 12, 1> d = J.partialPivLu().solve(f);
    if (!d.allFinite()) return {};
    moved = d.norm();
    u -= d * std::min(1.0, 2 / moved);
  }
  if (moved > 1e-13) return {};
  Pose X;
  X.R = Eigen::Map<const Mat3>(u.data());
  X.p = u.tail<3>();
  if (X.R.determinant() < 0) return {};
  return X;
}

std::vector<Pose> search(const SixLegs& legs, int starts, unsigned seed) {
  Random random(seed);
  std::vector<Pose> found;
  for (int k = 0; k < starts; ++k) {
    const Pose start{rotation_of(3.2 * random.vector()), 2 * random.vector()};
    const auto X = newton_on_entries(legs, start);
    if (X && !holds(found, *X, 1e-6)) found.push_back(*X);
  }
  return found;
}

LegsT<Interval> exactly(const Legs& legs) {
  LegsT<Interval> out;
  const auto one = [](const leg_homotopy::Complex& c) {
    return leg_homotopy::ComplexT<Interval>{Interval(c.re), Interval(c.im)};
  };
  for (int i = 0; i < kLegs; ++i) {
    for (int k = 0; k < 3; ++k) {
      out.difference[i][k] = one(legs.difference[i][k]);
      out.sum[i][k] = one(legs.sum[i][k]);
    }
    out.square[i] = one(legs.square[i]);
  }
  return out;
}

/// The homotopy alone.
AssemblyModes by_homotopy(const SixLegs& legs) {
  ModesOptions options;
  options.boxes = 0;
  return assembly_modes(legs, options);
}

/// The legs as the division wants them, about the middles of the joints.
leg_subdivision::Problem problem_of(SixLegs legs) {
  leg_subdivision::Problem out;
  Vec3 a = Vec3::Zero(), b = Vec3::Zero();
  for (int i = 0; i < kLegs; ++i) {
    a += legs.anchor[i] / kLegs;
    b += legs.end[i] / kLegs;
  }
  for (int i = 0; i < kLegs; ++i) {
    for (int k = 0; k < 3; ++k) {
      const Interval a_i = Interval(legs.anchor[i][k]) - Interval(a[k]),
                     b_i = Interval(legs.end[i][k]) - Interval(b[k]);
      out.absolute.difference[i][k].re = a_i - b_i;
      out.absolute.sum[i][k].re = a_i + b_i;
    }
    out.absolute.square[i].re = square(Interval(legs.length[i]));
  }
  const auto relative = [](int i, const auto& of, auto& proof, auto& middle) {
    proof.re = i == 0 ? of[0].re : of[i].re - of[0].re;
    middle.re = proof.re.mid();
  };
  for (int i = 0; i < kLegs; ++i) {
    for (int k = 0; k < 3; ++k) {
      std::array<leg_homotopy::ComplexT<Interval>, kLegs> difference, sum;
      for (int j = 0; j < kLegs; ++j) {
        difference[j] = out.absolute.difference[j][k];
        sum[j] = out.absolute.sum[j][k];
      }
      relative(i, difference, out.proof.difference[i][k], out.legs.difference[i][k]);
      relative(i, sum, out.proof.sum[i][k], out.legs.sum[i][k]);
    }
    relative(i, out.absolute.square, out.proof.square[i], out.legs.square[i]);
  }
  return out;
}

TEST(StartPlatform, HasFortyProvenZeros) {
  const LegsT<Interval> legs = exactly(leg_homotopy::start_legs());
  const auto points = leg_homotopy::start_points();
  ASSERT_EQ(points.size(), 40U);
  std::vector<double> radius;
  for (const Point& p : points) {
    const auto r = leg_homotopy::certify(legs, p);
    ASSERT_TRUE(r);
    EXPECT_LT(*r, 1e-10);
    radius.push_back(*r);
  }
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      EXPECT_TRUE(leg_homotopy::surely_different(points[i], radius[i], points[j], radius[j])) << i << ' ' << j;
}

// One zero and closed ways give the whole table back, and nothing beside it.
TEST(StartPlatform, IsOneOrbitOfClosedWays) {
  Random random(3);
  const auto way = [&] {
    Legs out;
    const auto number = [&](double size) {
      const double re = size * random.number();
      return leg_homotopy::Complex{re, size * random.number()};
    };
    for (int i = 0; i < kLegs; ++i) {
      for (int k = 0; k < 3; ++k) {
        out.difference[i][k] = number(1);
        out.sum[i][k] = number(1);
      }
      out.square[i] = number(2);
    }
    return out;
  };
  const Legs& start = leg_homotopy::start_legs();
  const auto table = leg_homotopy::start_points();
  std::vector<bool> seen(table.size(), false);
  seen[0] = true;
  for (int loop = 0; loop < 25; ++loop) {
    const Legs there = way(), bend = way(), back_bend = way();
    const std::vector<bool> known = seen;
    for (std::size_t i = 0; i < table.size(); ++i) {
      if (!known[i]) continue;
      const auto away = leg_homotopy::track(start, there, bend, table[i]);
      if (away.left > 0) continue;
      auto back = leg_homotopy::track(there, start, back_bend, away.point);
      if (back.left > 0 || !leg_homotopy::polish(start, back.point)) continue;
      int hits = 0;
      for (std::size_t j = 0; j < table.size(); ++j) {
        if (!leg_homotopy::same(table[j], back.point, 1e-9)) continue;
        seen[j] = true;
        ++hits;
      }
      EXPECT_EQ(hits, 1);
    }
  }
  EXPECT_EQ(std::count(seen.begin(), seen.end(), true), 40);
}

TEST(Certify, RefusesWhatIsNoZeroAndElseReachesTheZero) {
  const LegsT<Interval> legs = exactly(leg_homotopy::start_legs());
  int reached = 0;
  for (const Point& zero : leg_homotopy::start_points()) {
    const int moved = zero.chart == 0 ? 1 : 0;
    for (const double off : {1e-8, 1e-6, 1e-4, 1e-2, 0.1}) {
      Point p = zero;
      p.z[moved].re += off;
      const auto radius = leg_homotopy::certify(legs, p);
      EXPECT_FALSE(radius && off > 1e-3);
      if (!radius) continue;
      ++reached;
      EXPECT_GE(*radius, off);
    }
    EXPECT_FALSE(leg_homotopy::surely_different(zero, 1e-12, zero, 1e-12));
  }
  EXPECT_GE(reached, 40);
}

TEST(Certify, HoldsForEveryPlatformInItsIntervals) {
  LegsT<Interval> legs = exactly(leg_homotopy::start_legs());
  const Interval width(-1e-9, 1e-9);
  for (auto& s : legs.square) s.re += width;
  Legs other = leg_homotopy::start_legs();
  other.square[2].re += 1e-9;
  other.square[4].re -= 1e-9;
  for (const Point& p : leg_homotopy::start_points()) {
    const auto radius = leg_homotopy::certify(legs, p);
    ASSERT_TRUE(radius);
    Point moved = p;
    ASSERT_TRUE(leg_homotopy::polish(other, moved));
    double distance = 0;
    for (std::size_t k = 0; k < p.z.size(); ++k)
      distance = std::max(distance, leg_homotopy::modulus(moved.z[k] - p.z[k]) / (k < 4 ? 1 : p.weight));
    EXPECT_LE(distance, *radius);
    EXPECT_GT(distance, 0);
  }
}

TEST(Points, AreTurnedIntoPosesAndBack) {
  Random random(1);
  for (int k = 0; k < 20; ++k) {
    const Pose X = random.pose();
    EXPECT_TRUE(close(leg_homotopy::pose_of(leg_homotopy::point_of(X)), X, 1e-14));
  }
}

class RandomPlatforms : public ::testing::TestWithParam<double> {};

TEST_P(RandomPlatforms, AllModesAreProvenAndHoldTheGivenPose) {
  Random random(20);
  for (int k = 0; k < 30; ++k) {
    const Pose X = random.pose();
    const SixLegs legs = random_legs(random, X, GetParam());
    const AssemblyModes modes = by_homotopy(legs);
    EXPECT_EQ(modes.proof, ModesProof::general) << k;
    EXPECT_EQ(modes.zeros, 40);
    EXPECT_EQ(modes.starts, 0);
    EXPECT_EQ(modes.poses.size() % 2, 0U);  // zeros that are not real come in conjugate pairs, and 40 is even
    EXPECT_TRUE(holds(modes.poses, X)) << k;
    expect_closed(legs, modes);
    // Two proofs that share only the proof of a single zero count the same.
    const AssemblyModes divided = assembly_modes(legs);
    EXPECT_EQ(divided.proof, GetParam() == 0 ? ModesProof::subdivision : ModesProof::general) << k;
    expect_closed(legs, divided);
    const leg_subdivision::Result real = leg_subdivision::real_zeros(problem_of(legs), {});
    EXPECT_TRUE(real.complete) << k;
    EXPECT_EQ(divided.poses.size(), modes.poses.size()) << k;
    EXPECT_EQ(real.zeros.size(), modes.poses.size()) << k;
    for (const Pose& Y : modes.poses) EXPECT_TRUE(holds(divided.poses, Y)) << k;
  }
}

TEST_P(RandomPlatforms, SearchFindsTheSameModes) {
  Random random(21);
  for (int k = 0; k < 8; ++k) {
    const SixLegs legs = random_legs(random, random.pose(), GetParam());
    const AssemblyModes modes = assembly_modes(legs);
    ASSERT_TRUE(modes.complete());
    const std::vector<Pose> found = search(legs, 4000, 100 + k);
    for (const Pose& X : found) EXPECT_TRUE(holds(modes.poses, X, 1e-6)) << k;
    EXPECT_EQ(found.size(), modes.poses.size()) << k;
  }
}

TEST(AssemblyModes, FlatPlatformsHaveMirroredPairs) {
  Random random(22);
  const Mat3 mirror = Vec3(1, 1, -1).asDiagonal();
  for (int k = 0; k < 10; ++k) {
    const AssemblyModes modes = assembly_modes(random_legs(random, random.pose(), 0));
    ASSERT_TRUE(modes.complete());
    for (const Pose& X : modes.poses) EXPECT_TRUE(holds(modes.poses, {mirror * X.R * mirror, mirror * X.p}));
  }
}

// Three legs at one platform joint, two at another, one at the third: three spheres meet in two points, thrice. The
// poses are built here in closed form; 8 zeros are all, the other 32 are infinite.
TEST(AssemblyModes, MeetTheClosedFormOfThreeTwoOne) {
  const auto third_points = [](const Vec3& a, double ra, const Vec3& b, double rb, const Vec3& c, double rc) {
    const Vec3 ex = (b - a).normalized();
    const Vec3 ey = (c - a - ex * ex.dot(c - a)).normalized();
    const double d = (b - a).norm(), i = ex.dot(c - a), j = ey.dot(c - a);
    const double x = (ra * ra - rb * rb + d * d) / (2 * d);
    const double y = (ra * ra - rc * rc + i * i + j * j) / (2 * j) - i / j * x;
    const double zz = ra * ra - x * x - y * y;
    std::vector<Vec3> out;
    if (zz >= 0) {
      for (const double sign : {1.0, -1.0}) out.push_back(a + x * ex + y * ey + sign * std::sqrt(zz) * ex.cross(ey));
    }
    return out;
  };
  Random random(23);
  int most = 0;
  for (int k = 0; k < 16; ++k) {
    SixLegs legs = random_legs(random, random.pose(), 0.2);  // flat, so that more of the eight are real
    const Vec3 P = legs.end[0], Q = legs.end[3], S = legs.end[5];
    legs.end = {P, P, P, Q, Q, S};
    legs = legs_at(random.pose(), legs.anchor, legs.end);
    std::vector<Pose> expected;
    const auto& a = legs.anchor;
    const auto& l = legs.length;
    for (const Vec3& p : third_points(a[0], l[0], a[1], l[1], a[2], l[2])) {
      for (const Vec3& q : third_points(a[3], l[3], a[4], l[4], p, (Q - P).norm())) {
        for (const Vec3& s : third_points(a[5], l[5], p, (S - P).norm(), q, (S - Q).norm())) {
          const auto frame = [](const Vec3& u, const Vec3& v) {
            Mat3 F;
            F.col(0) = u.normalized();
            F.col(2) = u.cross(v).normalized();
            F.col(1) = F.col(2).cross(F.col(0));
            return F;
          };
          const Mat3 R = frame(q - p, s - p) * frame(Q - P, S - P).transpose();
          expected.push_back({R, p - R * P});
        }
      }
    }
    EXPECT_EQ(by_homotopy(legs).zeros, 8) << k;
    const AssemblyModes modes = assembly_modes(legs);
    EXPECT_EQ(modes.proof, ModesProof::subdivision) << k;
    ASSERT_EQ(modes.poses.size(), expected.size()) << k;
    for (const Pose& X : expected) EXPECT_TRUE(holds(modes.poses, X, 1e-6)) << k;
    most = std::max(most, static_cast<int>(expected.size()));
  }
  EXPECT_GE(most, 4);
}

TEST(AssemblyModes, OfThreeDoubleJointsAreSixteen) {
  Random random(24);
  for (int k = 0; k < 8; ++k) {
    SixLegs legs = random_legs(random, random.pose());
    for (int i = 0; i < kLegs; i += 2) legs.end[i + 1] = legs.end[i];
    if (k % 2 == 1)
      for (int i = 0; i < kLegs; i += 2) legs.anchor[i + 1] = legs.anchor[(i + 2) % kLegs];
    if (k >= 4) std::swap(legs.anchor, legs.end);
    const Pose X = random.pose();
    legs = legs_at(X, legs.anchor, legs.end);
    const AssemblyModes modes = assembly_modes(legs);
    EXPECT_EQ(modes.proof, ModesProof::double_joints) << k;
    EXPECT_EQ(modes.zeros - modes.zeros_at_infinity, 16);
    EXPECT_TRUE(holds(modes.poses, X));
    expect_closed(legs, modes);
    const std::vector<Pose> found = search(legs, 4000, 200 + k);
    EXPECT_EQ(found.size(), modes.poses.size()) << k;
    for (const Pose& Y : found) EXPECT_TRUE(holds(modes.poses, Y, 1e-6)) << k;
  }
}

TEST(AssemblyModes, OutOfReachThereAreNoneAndThatIsProven) {
  Random random(25);
  SixLegs legs = random_legs(random, random.pose());
  legs.length[2] = 9;  // the others hold the platform within 4
  const AssemblyModes modes = assembly_modes(legs);
  EXPECT_TRUE(modes.complete());
  EXPECT_EQ(modes.zeros, 40);
  EXPECT_TRUE(modes.poses.empty());
  EXPECT_THAT(description_of(modes), HasSubstr("no assembly modes: all there are"));
}

/// A pose where the rows of the legs are dependent, on the way between two poses with different signs.
/// `beyond`: a share of the way past it.
Pose singular_pose(const SixPoints& anchor, const SixPoints& end, Random& random, double beyond = 0) {
  const auto at = [](const Pose& A, const Pose& B, double s) {
    return Pose{rotation_of(s * rotation_vector(B.R * A.R.transpose())) * A.R, Vec3((1 - s) * A.p + s * B.p)};
  };
  const auto sign = [&](const Pose& X) { return leg_rows(X, anchor, end).determinant() > 0; };
  Pose A = random.pose(), B = random.pose();
  while (sign(A) == sign(B)) B = random.pose();
  double lo = 0, hi = 1;
  for (int k = 0; k < 60; ++k) {
    const double middle = 0.5 * (lo + hi);
    (sign(at(A, B, middle)) == sign(A) ? lo : hi) = middle;
  }
  return at(A, B, lo + beyond);
}

TEST(AssemblyModes, AtASingularPoseNothingIsClaimedButItIsFound) {
  Random random(26);
  for (int k = 0; k < 5; ++k) {
    const SixLegs some = random_legs(random, random.pose());
    const Pose X = singular_pose(some.anchor, some.end, random);
    const AssemblyModes modes = assembly_modes(legs_at(X, some.anchor, some.end));
    EXPECT_FALSE(modes.complete());
    EXPECT_EQ(modes.zeros, 38);
    EXPECT_TRUE(holds(modes.poses, X, 1e-5)) << k;  // a double zero is good to the square root of rounding
    EXPECT_THAT(description_of(modes), HasSubstr("there may be others"));
  }
}

// Beside the singular pose modes lie close together (two at a fold, up to three at a cusp), and all are proven.
TEST(AssemblyModes, NextToASingularPoseAllModesAreProven) {
  Random random(27);
  for (int k = 0; k < 5; ++k) {
    const SixLegs some = random_legs(random, random.pose());
    const Pose X = singular_pose(some.anchor, some.end, random, 1e-3);
    const SixLegs legs = legs_at(X, some.anchor, some.end);
    const AssemblyModes modes = assembly_modes(legs);
    EXPECT_TRUE(modes.complete()) << k;
    EXPECT_TRUE(holds(modes.poses, X));
    EXPECT_EQ(search(legs, 4000, 300 + k).size(), modes.poses.size()) << k;
  }
}

// All legs at one platform joint: it turns about that as it likes.
TEST(AssemblyModes, OfAPlatformOnOneJointMove) {
  Random random(31);
  SixLegs legs = random_legs(random, random.pose());
  legs.end.fill(legs.end[0]);
  const AssemblyModes modes = assembly_modes(legs_at(random.pose(), legs.anchor, legs.end));
  EXPECT_TRUE(modes.moves());
  EXPECT_FALSE(modes.complete());
  EXPECT_THAT(description_of(modes), HasSubstr("self-motion"));
}

// Equal parallel legs between congruent hexagons: the platform swings on a sphere, singular to second order, where
// Newton seldom ends. Nothing may be claimed.
TEST(AssemblyModes, OfAParallelogramAreNotComplete) {
  SixPoints anchor;
  for (int i = 0; i < kLegs; ++i) anchor[i] = Vec3(std::cos(i), std::sin(i), 0);
  EXPECT_FALSE(assembly_modes(legs_at({Mat3::Identity(), Vec3(0.2, 0, 1)}, anchor, anchor)).complete());
}

TEST(AssemblyModes, OfBadNumbersAreNone) {
  Random random(28);
  const SixLegs good = random_legs(random, random.pose());
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    SixLegs legs = good;
    legs.length[3] = bad;
    EXPECT_TRUE(assembly_modes(legs).poses.empty());
    EXPECT_FALSE(assembly_modes(legs).complete());
    legs = good;
    legs.anchor[1].y() = bad;
    EXPECT_TRUE(assembly_modes(legs).poses.empty());
    EXPECT_FALSE(assembly_modes(legs).complete());
  }
  SixLegs legs = good;
  legs.length[0] = -legs.length[0];  // its square would fit
  EXPECT_TRUE(assembly_modes(legs).complete());
  EXPECT_TRUE(assembly_modes(legs).poses.empty());
  const AssemblyModes nothing = assembly_modes(SixLegs{{}, {}, {}});
  EXPECT_FALSE(nothing.complete());
  for (const double size : {1e-12, 1e12}) {  // the result scales with the machine
    SixLegs scaled = good;
    for (int i = 0; i < kLegs; ++i) {
      scaled.anchor[i] *= size;
      scaled.end[i] *= size;
      scaled.length[i] *= size;
    }
    EXPECT_TRUE(assembly_modes(scaled).complete());
    EXPECT_EQ(assembly_modes(scaled).poses.size(), assembly_modes(good).poses.size());
  }
}

TEST(AssemblyModes, AreTheSameBytesWithAnyNumberOfThreads) {
  Random random(29);
  for (const double flat : {1.0, 0.0}) {
    const SixLegs legs = random_legs(random, random.pose(), flat);
    const AssemblyModes many = assembly_modes(legs);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const AssemblyModes few = assembly_modes(legs);
    ASSERT_EQ(many.poses.size(), few.poses.size());
    for (std::size_t k = 0; k < few.poses.size(); ++k)
      EXPECT_EQ(std::memcmp(&many.poses[k], &few.poses[k], sizeof(Pose)), 0);
  }
}

/// A box of random sides round a zero, anywhere in it.
leg_subdivision::Box box_round(const Point& zero, Random& random, double size, double reach) {
  leg_subdivision::Box box;
  box.one = zero.chart;
  for (int k = 0, v = 0; k < 8; ++k) {
    if (k == zero.chart) continue;
    const double limit = k < 4 ? 1 : reach;
    const auto part = [&] { return size * (v < 3 ? 1 : reach) * 0.5 * (1 + random.number()); };
    box.lo[v] = std::max(-limit, zero.z[k].re - part());
    box.hi[v] = std::min(limit, zero.z[k].re + part());
    ++v;
  }
  return box;
}

// A wrong bound would lose a zero here long before it does in the whole search, where others find it again.
TEST_P(RandomPlatforms, NoBoxWithAZeroIsThrownAway) {
  Random random(32);
  int narrower = 0, boxes = 0;
  for (int k = 0; k < 60; ++k) {
    SixLegs legs = random_legs(random, random.pose(), GetParam());
    const leg_subdivision::Problem problem = problem_of(legs);
    const leg_subdivision::Result all = leg_subdivision::real_zeros(problem, {});
    ASSERT_TRUE(all.complete);
    for (const leg_subdivision::RealZero& zero : all.zeros) {
      for (int j = 0; j < 40; ++j) {
        const double size = std::pow(10, -0.1 * j);
        const leg_subdivision::Box box = box_round(zero.point, random, size, 6);
        const auto to = leg_subdivision::narrowed(problem, box);
        ++boxes;
        ASSERT_TRUE(to) << k << ' ' << size;
        bool less = false;
        for (int i = 0, v = 0; i < 8; ++i) {
          if (i == zero.point.chart) continue;
          EXPECT_LE(to->lo[v], zero.point.z[i].re + 1e-11) << k << ' ' << size;
          EXPECT_GE(to->hi[v], zero.point.z[i].re - 1e-11) << k << ' ' << size;
          less = less || to->hi[v] - to->lo[v] < 0.9 * (box.hi[v] - box.lo[v]);
          ++v;
        }
        narrower += less ? 1 : 0;
      }
    }
  }
  EXPECT_GT(boxes, 5000);
  EXPECT_GT(narrower, boxes / 2);  // else the test would show nothing
}

// Beside singular poses another zero lies close by, and the box about each has to end before it.
TEST_P(RandomPlatforms, NoOtherZeroIsInTheBoxOfOne) {
  Random random(33);
  int proven = 0;
  for (int k = 0; k < 20; ++k) {
    const SixLegs some = random_legs(random, random.pose(), GetParam());
    const Pose X = singular_pose(some.anchor, some.end, random, std::pow(10, -1 - 0.1 * k));
    const leg_subdivision::Problem problem = problem_of(legs_at(X, some.anchor, some.end));
    const leg_subdivision::Result all = leg_subdivision::real_zeros(problem, {});
    for (const leg_subdivision::RealZero& zero : all.zeros) {
      for (int one = 0; one < 4; ++one) {
        const auto box = leg_subdivision::alone_in(problem, zero, one);
        if (!box) continue;
        ++proven;
        for (const leg_subdivision::RealZero& other : all.zeros) {
          const double scale = 1 / other.point.z[one].re;
          bool inside = std::isfinite(scale);
          for (int i = 0, v = 0; i < 8; ++i) {
            if (i == one) continue;
            inside = inside && box->lo[v] <= scale * other.point.z[i].re && scale * other.point.z[i].re <= box->hi[v];
            ++v;
          }
          EXPECT_EQ(inside, &other == &zero) << k;
        }
      }
    }
  }
  EXPECT_GT(proven, 100);
}

TEST_P(RandomPlatforms, DivisionProvesNothingAtASingularPose) {
  Random random(34);
  for (int k = 0; k < 10; ++k) {
    const SixLegs some = random_legs(random, random.pose(), GetParam());
    const Pose X = singular_pose(some.anchor, some.end, random);
    const leg_subdivision::Result real = leg_subdivision::real_zeros(problem_of(legs_at(X, some.anchor, some.end)), {});
    EXPECT_FALSE(real.complete) << k;
    EXPECT_TRUE(real.singular) << k;
  }
}

TEST(AssemblyModes, OfTooFewBoxesAreNotComplete) {
  Random random(35);
  const SixLegs legs = random_legs(random, random.pose());
  leg_subdivision::Options options;
  options.boxes = leg_subdivision::real_zeros(problem_of(legs), {}).boxes;
  EXPECT_TRUE(leg_subdivision::real_zeros(problem_of(legs), {}, options).complete);
  --options.boxes;
  EXPECT_FALSE(leg_subdivision::real_zeros(problem_of(legs), {}, options).complete);
}

// Both platforms three equal pairs on a circle: paths end at infinity, so that only the division proves anything.
// Newton from anywhere finds the same.
TEST(AssemblyModes, OfEqualLegsAreProven) {
  const AnyMachine m = *load("hexapod-strut");
  const auto& struts = std::get<StrutHexapod>(m);
  for (const double length : {0.042, 0.05, 0.06, 0.07, 0.08, 0.09}) {
    const SixLegs legs = six_legs(struts, JointVector::Constant(kLegs, length));
    EXPECT_FALSE(by_homotopy(legs).complete());
    const AssemblyModes modes = assembly_modes(legs);
    EXPECT_EQ(modes.proof, ModesProof::subdivision) << length;
    EXPECT_LT(modes.boxes, 2000) << length;
    EXPECT_THAT(description_of(modes), HasSubstr("all there are"));
    SixLegs large = legs;  // the search is in a box of size 2
    for (int i = 0; i < kLegs; ++i) {
      large.anchor[i] *= 20;
      large.end[i] *= 20;
      large.length[i] *= 20;
    }
    const std::vector<Pose> found = search(large, 6000, 400);
    EXPECT_EQ(found.size(), modes.poses.size()) << length;
    for (const Pose& X : found) EXPECT_TRUE(holds(modes.poses, {X.R, X.p / 20}, 1e-6)) << length;
    for (const double r : modes.residuals) EXPECT_LT(r, 1e-9);
  }
}

TEST(AssemblyModes, OfTheCatalogueHoldTheGivenPose) {
  int machines = 0;
  for (const CatalogueEntry& entry : catalogue()) {
    const AnyMachine m = *load(std::string(entry.name));
    if (!kinematics::assembly_modes(m, JointVector::Zero(kinematics::joint_count(m)))) continue;
    ++machines;
    const Pose home = kinematics::home_pose(m).value();
    Random random(30);
    for (int k = 0; k < 3; ++k) {
      Pose X{rotation_of(0.1 * random.vector()) * home.R, home.p};
      X.p += 0.02 * home.p.norm() * random.vector();
      const kinematics::InverseResult inverse = kinematics::inverse(m, X);
      ASSERT_FALSE(inverse.solutions.empty()) << entry.name;
      const JointVector q = inverse.solutions.front().joints;
      const auto modes = kinematics::assembly_modes(m, q);
      EXPECT_TRUE(modes->complete()) << entry.name;
      EXPECT_TRUE(holds(modes->poses, X)) << entry.name;
      for (const double r : modes->residuals) EXPECT_LT(r, 1e-9) << entry.name;
      EXPECT_TRUE(holds(modes->poses, kinematics::forward(m, q).poses.front())) << entry.name;
    }
  }
  EXPECT_GE(machines, 7);
}

INSTANTIATE_TEST_SUITE_P(InSpaceAndFlat, RandomPlatforms, ::testing::Values(1.0, 0.0));

}  // namespace
}  // namespace polypod::machine
