// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Coordinate limits and joint seats of hexapods: named where they are broken, and known to the proven bounds. The
// oracle evaluates angles and coordinates on its own at random poses.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/hexapod/slider_kinematics.hpp"
#include "polypod/families/hexapod/strut_kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/field.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {
namespace {

using machine::HexapodLimits;
using machine::kLegs;

constexpr const char* kStrut = R"(
family = "strut-hexapod"
base = { radius_mm = 50, pair_angle_deg = 30 }
platform = { radius_mm = 25, pair_angle_deg = 30 }
leg = { length_min_mm = 50, length_max_mm = 90 }
tool = { length_mm = 10 }
home = { height_mm = 65 }
)";
constexpr const char* kRail = R"(
family = "slider-hexapod"
rail = { outer_radius_mm = 100, inner_radius_mm = 20, inner_height_mm = 30, spacing_mm = 20 }
leg = { length_mm = 90 }
platform = { radius_mm = 20, pair_angle_deg = 30 }
tool = { length_mm = 10 }
)";

AnyMachine made(const std::string& text) {
  const auto m = machine::from_text(text, "test.toml");
  if (!m) throw std::runtime_error(to_string(m.error()));
  return *m;
}
std::string refused(const std::string& text) {
  const auto m = machine::from_text(text, "test.toml");
  return m ? "accepted" : m.error().id;
}

struct Seat {
  Vec3 axis;     ///< from the joint along its leg: in M at the base, in P at the platform
  double angle;  ///< rad
};
/// Inwards, as the legs stand, and all a little aside.
std::array<double, 2> leaning(int i) {
  const double azimuth = units::from_deg(120) * ((i + 1) / 2);
  return {0.1 - 0.3 * std::cos(azimuth), -0.3 * std::sin(azimuth)};
}
/// Both seats of leg i as the file below gives them, written down a second time.
Seat base_seat(int i) {
  return {Vec3(leaning(i)[0], leaning(i)[1], 1).normalized(), units::from_deg(30 + 3 * i)};
}
Seat platform_seat(int) {
  return {Vec3(0, 0, -1), units::from_deg(42)};
}
std::string with_seats(const std::string& machine) {
  std::string axes, cones;
  for (int i = 0; i < kLegs; ++i) {
    axes += fmt::format("{}[{}, {}, 1]", i > 0 ? ", " : "", leaning(i)[0], leaning(i)[1]);
    cones += fmt::format("{}{}", i > 0 ? ", " : "", 30 + 3 * i);
  }
  return machine +
         fmt::format(
             "joint = {{ limit = \"cone\", base = {{ axis = [{}], cone_deg = [{}] }}, platform = {{ axis = [0, "
             "0, -1], cone_deg = 42 }} }}\n",
             axes, cones);
}

/// The angles of the seats at a pose with these joints, from the legs' ends alone.
LimitBits broken_seats(const AnyMachine& machine, const Pose& X, const machine::JointVector& q) {
  LimitBits out = 0;
  std::visit(
      [&]<class M>(const M& m) {
        if constexpr (requires { six_legs(m, q); }) {
          const machine::SixLegs legs = six_legs(m, q);
          for (int i = 0; i < kLegs; ++i) {
            const Vec3 up = (X * legs.end[i] - legs.anchor[i]).normalized();
            const Seat base = base_seat(i), platform = platform_seat(i);
            const auto angle = [](const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); };
            if (angle(up, base.axis) > base.angle) out |= LimitBits{1} << (HexapodLimits::kBaseJoint + i);
            if (angle(X.R.transpose() * -up, platform.axis) > platform.angle) {
              out |= LimitBits{1} << (HexapodLimits::kPlatformJoint + i);
            }
          }
        }
      },
      machine);
  return out;
}

struct Random {
  std::mt19937 engine{20261122};
  double operator()(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
  Vec3 in(const Vec3& low, const Vec3& high) {
    return {(*this)(low.x(), high.x()), (*this)(low.y(), high.y()), (*this)(low.z(), high.z())};
  }
  Mat3 tilted(double most) {
    const double tilt = (*this)(0, most), azimuth = (*this)(0, 2 * std::numbers::pi);
    return rotation_of(tilt * Vec3(-std::sin(azimuth), std::cos(azimuth), 0));
  }
};

TEST(JointSeats, AreNamedWhereTheyAreBroken) {
  constexpr LimitBits kJoints = ((LimitBits{1} << 12) - 1) << HexapodLimits::kBaseJoint;
  Random random;
  for (const char* text : {kStrut, kRail}) {
    const AnyMachine m = made(with_seats(text));
    int broken = 0, kept = 0;
    for (int k = 0; k < 2000; ++k) {
      const Pose X{random.tilted(0.5), random.in({-0.04, -0.04, 0.05}, {0.04, 0.04, 0.1})};
      const auto solved = kinematics::inverse(m, X);
      if (solved.solutions.empty()) continue;
      const auto& q = solved.solutions.front().joints;
      const LimitBits bits = broken_seats(m, X, q);
      EXPECT_EQ(solved.solutions.front().violations & kJoints, bits);
      (bits != 0 ? broken : kept) += 1;
    }
    EXPECT_GT(broken, 100);
    EXPECT_GT(kept, 20);
  }
}

/// Cells that are proven inside hold no pose that breaks a limit of the oracle; the bounds enclose a count of points.
void bounds_know(const AnyMachine& m, double tilt, const std::function<bool(const Pose&)>& kept) {
  Options options;
  options.directions.tilt = tilt;
  options.relative_tolerance = 0.02;
  options.keep_cells = true;
  const auto v = volume(m, options);
  ASSERT_TRUE(v) << to_string(v.error());
  ASSERT_GT(v->lower, 0);
  Random random;
  int looked = 0;
  for (const Cell& cell : v->cells) {
    if (cell.state != CellState::inside || ++looked > 3000) continue;
    const Pose X{random.tilted(tilt), random.in(cell.center - cell.half, cell.center + cell.half)};
    EXPECT_TRUE(kept(X)) << X.p.transpose();
  }
  ASSERT_GT(looked, 20);
  constexpr int kPoints = 20'000;
  const std::vector<Mat3> orientations = sampled_orientations(options.directions);
  const Vec3 low = v->min - Vec3::Constant(0.002), high = v->max + Vec3::Constant(0.002);
  int inside = 0;
  for (int k = 0; k < kPoints; ++k) {
    const Vec3 p = random.in(low, high);
    inside += std::all_of(orientations.begin(), orientations.end(),
                          [&](const Mat3& R) {
                            return kept({R, p});
                          })
                  ? 1
                  : 0;
  }
  const double share = double(inside) / kPoints, box = (high - low).prod();
  const double spread = 5 * std::sqrt(share * (1 - share) / kPoints) * box;
  EXPECT_GE(share * box + spread, v->lower);
  // Sampled directions demand less than all: above by the thin layer between 12 azimuths, at most 3 % here.
  EXPECT_LE(share * box - spread, (tilt > 0 ? 1.03 : 1.0) * v->upper);
}

TEST(JointSeats, AreKnownToTheProvenBounds) {
  for (const char* text : {kStrut, kRail}) {
    const AnyMachine m = made(with_seats(text));
    const AnyMachine plain = made(text);  // no joint limits: those of the oracle alone
    for (const double tilt : {0.0, units::from_deg(5)}) {
      SCOPED_TRACE(tilt);
      bounds_know(m, tilt, [&](const Pose& X) {
        const auto solved = kinematics::inverse(plain, X);
        return !solved.solutions.empty() && solved.solutions.front().violations == 0 &&
               broken_seats(m, X, solved.solutions.front().joints) == 0;
      });
    }
  }
}

TEST(JointSeats, AnEndWithoutAnAngleIsFreeAndTheCommonOneServesTheOther) {
  const auto volume_of = [](const std::string& joint) { return volume(made(std::string(kStrut) + joint), {})->volume; };
  const double none = volume_of(""), common = volume_of("joint = { cone_deg = 20 }\n");
  const double base = volume_of("joint = { base = { cone_deg = 20 } }\n");
  const double both = volume_of("joint = { base = { cone_deg = 20 }, platform = { cone_deg = 20 } }\n");
  const double one = volume_of("joint = { cone_deg = 20, platform = { cone_deg = 60 } }\n");
  EXPECT_LT(common, base * (1 + 1e-9));
  EXPECT_LT(base, none);
  EXPECT_EQ(both, common);
  EXPECT_LE(one, base * 1.02);
  EXPECT_GE(one, common * 0.98);
}

TEST(JointSeats, ReadBackAndAreRefused) {
  for (const char* text : {kStrut, kRail}) {
    const AnyMachine m = made(with_seats(text));
    EXPECT_EQ(machine::to_toml(made(machine::to_toml(m))), machine::to_toml(m));
    EXPECT_NEAR(volume(m, {})->volume, volume(made(machine::to_toml(m)), {})->volume, 1e-12);
  }
  const std::string s = kStrut;
  EXPECT_EQ(refused(s + "joint = { limit = \"elevation\", cone_deg = 20, base = { cone_deg = 20 } }\n"), "MA126");
  EXPECT_EQ(refused(s + "joint = { base = { axis = [0, 0, 0], cone_deg = 20 } }\n"), "MA126");
  EXPECT_EQ(refused(s + "joint = { base = { axis = [[0, 0, 1]], cone_deg = 20 } }\n"), "MA120");
  EXPECT_EQ(refused(s + "joint = { base = { cone_deg = [20, 20] } }\n"), "CF107");
  EXPECT_EQ(refused(s + "joint = { base = { cone_deg = 180 } }\n"), "CF105");
  EXPECT_EQ(refused(s + "joint = { base = { cone = 20 } }\n"), "CF103");
  EXPECT_EQ(refused(s + "joint = { limit = \"cone\" }\n"), "CF106");
}

TEST(TipLimits, OfHexapodsAreNamedAndKnownToTheProvenBounds) {
  for (const char* text : {kStrut, kRail}) {
    const AnyMachine plain = made(text);
    const double free = volume(plain, {})->volume;
    const AnyMachine m = made(std::string(text) + "limits = { x_min_mm = -8, y_max_mm = 6.5, z_max_mm = 78 }\n");
    const auto within = [](const Vec3& p) { return p.x() >= -0.008 && p.y() <= 0.0065 && p.z() <= 0.078; };
    for (const double tilt : {0.0, units::from_deg(8)}) {
      bounds_know(m, tilt,
                  [&](const Pose& X) { return within(X.p) && kinematics::inverse(plain, X).reachable() != nullptr; });
    }
    EXPECT_LT(volume(m, {})->upper, free);
    const auto v = volume(m, {});
    EXPECT_GE(v->min.x(), -0.008 - 1e-12);
    EXPECT_LE(v->max.y(), 0.0065 + 1e-12);
    EXPECT_LE(v->max.z(), 0.078 + 1e-12);
    Options without;
    without.limits &= ~*limit_bits(m, "coordinates");
    EXPECT_EQ(volume(m, without)->volume, free);
    const auto names = [&](const Vec3& p) {
      const auto solved = kinematics::inverse(m, {Mat3::Identity(), p});
      return kinematics::limit_names(m, solved.solutions.at(0).violations & ((LimitBits{63} << HexapodLimits::kLow)));
    };
    using Names = std::vector<std::string>;
    EXPECT_EQ(names({-0.009, 0.007, 0.079}),
              (Names{"x below its smallest value", "y above its largest value", "z above its largest value"}));
    EXPECT_EQ(names({-0.007, 0.006, 0.077}), Names{});
    EXPECT_EQ(machine::to_toml(made(machine::to_toml(m))), machine::to_toml(m));
  }
  EXPECT_EQ(refused(std::string(kStrut) + "limits = { x_min_mm = 5, x_max_mm = 4 }\n"), "MA142");
}

TEST(TipLimits, OfHexapodsStopTheFieldsOfPictures) {
  const AnyMachine m = made(std::string(kStrut) + "limits = { z_max_mm = 78 }\n");
  Grid line;
  line.origin = Vec3(0, 0, 0.070);
  line.step[2] = Vec3(0, 0, 0.001);
  line.points = {1, 1, 12};
  FieldOptions options;
  options.tilt = false;
  const auto f = field(m, {}, line, options);
  ASSERT_TRUE(f);
  for (std::size_t i = 0; i < line.size(); ++i) {
    const double inside = 0.078 - line.at(i).z();
    if (inside > 0.004) continue;  // farther from it other limits are nearer
    EXPECT_NEAR(f->margin[i], inside, 1e-12);
    EXPECT_EQ(limit_label(m, f->limit[i]), "z above its largest value");
  }
}

}  // namespace
}  // namespace polypod::workspace
