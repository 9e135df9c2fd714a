// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Certain workspaces of machines of legs: against the hand-made bounds of the built-in families, and against samples:
// 20 000 points a machine, with POLYPOD_LONG=1 ten millions and closer bounds.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <random>
#include <regex>

#include "machines.hpp"
#include "paths.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/parallel.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/quality/survey.hpp"
#include "polypod/workspace/beyond.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod {
namespace {

using machine::AnyMachine;

/// The share of a box of three coordinates of the task at which the machine keeps its limits, and whether all such
/// points lie within the bounds.
struct Sampled {
  double volume = 0, deviation = 0;
  bool within = true;
};
Sampled sampled(const AnyMachine& m, const Vec3& low, const Vec3& high, const workspace::Volume& v,
                const std::vector<Mat3>& orientations, int count) {
  const machine::Task task = kinematics::task(m);
  struct Part {
    int inside = 0;
    bool within = true;
  };
  std::vector<Part> parts(100);
  const int at_once = count / static_cast<int>(parts.size());
  for_each_in_rounds(parts.size(), {}, [&](std::size_t n) {
    Random random(3, n);
    Part& part = parts[n];
    for (int k = 0; k < at_once; ++k) {
      Vec3 c;
      for (int i = 0; i < 3; ++i) c[i] = random.uniform(low[i], high[i]);
      const bool in = std::all_of(orientations.begin(), orientations.end(), [&](const Mat3& R) {
        const Pose X = task.places() ? Pose{R, c} : kinematics::pose_of(task, {c[0], c[1], c[2]});
        return kinematics::inverse(m, X).reachable() != nullptr;
      });
      if (!in) continue;
      ++part.inside;
      part.within = part.within && (c.array() >= v.min.array()).all() && (c.array() <= v.max.array()).all();
    }
  });
  int inside = 0;
  Sampled out;
  for (const Part& part : parts) {
    inside += part.inside;
    out.within = out.within && part.within;
  }
  const double share = double(inside) / count;
  out.volume = share * (high - low).prod();
  out.deviation = (high - low).prod() * std::sqrt(share * (1 - share) / count);
  return out;
}

void expect_bounds_hold(const char* name, workspace::Options options, int count, double tolerance = 0.1) {
  const AnyMachine m = test::load(name);
  const bool whole = std::getenv("POLYPOD_LONG") != nullptr;
  if (whole) {
    constexpr int kMany = 10'000'000, kFew = 20'000;
    count = count == kFew ? kMany : count;
    tolerance = std::min(tolerance, 0.03);
  }
  options.relative_tolerance = tolerance;
  options.bounds_tolerance = 0;
  options.max_cells = whole ? 10'000'000 : 300'000;
  const auto v = workspace::volume(m, options);
  ASSERT_TRUE(v.has_value()) << to_string(v.error());
  ASSERT_FALSE(v->empty);
  EXPECT_TRUE(v->converged) << v->lower << " .. " << v->upper;
  EXPECT_GT(v->lower, 0.0);
  // Angles are looked at within 90 deg of home, so no farther samples count.
  Vec3 margin = 0.1 * (v->max - v->min);
  for (int i = 0; i < 3; ++i) {
    if (!kinematics::task(m).places() && kinematics::task(m).is_angle(i)) margin[i] = 0;
  }
  const Sampled s =
      sampled(m, v->min - margin, v->max + margin, *v, workspace::sampled_orientations(options.directions), count);
  constexpr double kSigmas = 5;  // one run in a million is farther off by chance
  EXPECT_TRUE(s.within) << "a reachable point lies out of the bounds";
  if (options.directions.tilt == 0 && !options.directions.is_ranges()) {
    EXPECT_GT(s.volume + kSigmas * s.deviation, v->lower);
  }
  EXPECT_LT(v->lower, s.volume + kSigmas * s.deviation);
  if (options.directions.tilt == 0) {
    EXPECT_GT(v->upper, s.volume - kSigmas * s.deviation);
  }
}

TEST(WorkspaceOfLegs, TriceptHoldsItsSamples) {
  expect_bounds_hold("tricept", {}, 20'000);
}
TEST(WorkspaceOfLegs, ExechonHoldsItsSamples) {
  expect_bounds_hold("exechon", {}, 20'000);
}
/// Far aside the platform tilts by 90 deg and more, where A, B and C are no coordinates of its orientation: boxes there
/// stayed undecided however small (785 832 of them to 10 %).
TEST(WorkspaceOfLegs, TiltsBeyondARightAngleTakeFewBoxes) {
  const auto m = machine::from_text(R"(family = "parallel"
name = "tilts"
task = ["x", "y", "z"]
home = { z_mm = 900 }
tool = { z_mm = 200 }
limits = { z_min_mm = 400 }
leg = [
  { drive = "strut", base_mm = [-300, 0, 0], platform_mm = [-120, 0, 0], min_mm = 500, max_mm = 1000 },
  { drive = "strut", base_mm = [300, 0, 0], platform_mm = [120, 0, 0], min_mm = 500, max_mm = 1000 },
  { drive = "strut", base_mm = [0, 350, 0], platform_mm = [0, 150, 0], min_mm = 500, max_mm = 1000 },
]
constraint = [
  { kind = "platform-plane", base_mm = [-300, 0, 0], platform_mm = [0, 0, 0], axis = [0, 1, 0] },
  { kind = "platform-plane", base_mm = [300, 0, 0], platform_mm = [0, 0, 0], axis = [0, 1, 0] },
  { kind = "platform-plane", base_mm = [0, 350, 0], platform_mm = [0, 150, 0], axis = [1, 0, 0] },
])",
                                    "tilts.toml", {});
  ASSERT_TRUE(m) << to_string(m.error());
  workspace::Options options;
  options.relative_tolerance = 0.1;
  const workspace::Volume v = *workspace::volume(*m, options);
  EXPECT_TRUE(v.proven && v.converged);
  EXPECT_LT(v.points, 150'000);
  // A sample of the inverse lies between the bounds.
  std::mt19937 random(1);
  const Vec3 size = v.max - v.min;
  constexpr int kPoints = 20'000;
  int inside = 0;
  for (int k = 0; k < kPoints; ++k) {
    std::uniform_real_distribution<double> part(0, 1);
    const Vec3 p = v.min + size.cwiseProduct(Vec3(part(random), part(random), part(random)));
    inside += kinematics::inverse(*m, Pose{Mat3::Identity(), p}).reachable() != nullptr ? 1 : 0;
  }
  const double share = double(inside) / kPoints, sampled = share * size.prod();
  const double four_sigma = 4 * std::sqrt(share * (1 - share) / kPoints) * size.prod();
  EXPECT_GT(sampled + four_sigma, v.lower);
  EXPECT_LT(sampled - four_sigma, v.upper);
}

TEST(WorkspaceOfLegs, PentapodHoldsItsSamples) {
  expect_bounds_hold("pentapod", {}, 20'000);
}
TEST(WorkspaceOfLegs, PentapodHoldsItsSamplesFromACone) {
  workspace::Options options;
  options.directions.tilt = units::from_deg(2);
  expect_bounds_hold("pentapod", options, 2'000, 0.3);
}
TEST(WorkspaceOfLegs, TripodHoldsItsSamplesInItsOwnCoordinates) {
  expect_bounds_hold("tripod-z3", {}, 20'000, 0.3);
}
TEST(WorkspaceOfLegs, HexaHoldsItsSamples) {
  expect_bounds_hold("hexa", {}, 20'000);
}
TEST(WorkspaceOfLegs, FourArmsHoldTheirSamples) {
  expect_bounds_hold("delta-par4", {}, 20'000);
}
TEST(WorkspaceOfLegs, PlanarMachineHoldsItsSamplesInItsOwnCoordinates) {
  expect_bounds_hold("planar-3rrr", {}, 20'000);
}

/// A point in a plane on two struts, 150 to 250 mm long, 200 mm apart: what two rings have in common, above and below.
TEST(WorkspaceOfLegs, TwoCoordinatesHaveAnArea) {
  const auto m = machine::from_text(R"(family = "parallel"
task = ["x", "y"]
home = { y_mm = 170 }
leg = [
  { drive = "strut", base_mm = [-100, 0, 0], platform_mm = [0, 0, 0], min_mm = 150, max_mm = 250 },
  { drive = "strut", base_mm = [100, 0, 0], platform_mm = [0, 0, 0], min_mm = 150, max_mm = 250 },
]
constraint = [
  { kind = "orientation" },
  { kind = "plane", platform_mm = [0, 0, 0], base_mm = [0, 0, 0], normal = [0, 0, 1] },
]
)",
                                    "test.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  int inside = 0;
  constexpr int kSteps = 4000;
  for (int i = 0; i < kSteps; ++i)
    for (int j = 0; j < kSteps; ++j) {
      const double x = -0.4 + 0.8 * (i + 0.5) / kSteps, y = -0.4 + 0.8 * (j + 0.5) / kSteps;
      const double one = std::hypot(x + 0.1, y), other = std::hypot(x - 0.1, y);
      inside += one >= 0.15 && one <= 0.25 && other >= 0.15 && other <= 0.25 ? 1 : 0;
    }
  const double area = inside * (0.8 / kSteps) * (0.8 / kSteps);
  workspace::Options options;
  options.relative_tolerance = 0.01;
  const auto v = workspace::volume(*m, options);
  ASSERT_TRUE(v) << to_string(v.error());
  EXPECT_TRUE(v->proven);
  EXPECT_TRUE(v->converged);
  constexpr double kGrid = 1e-3;  // of the area
  EXPECT_LT(v->lower, area * (1 + kGrid));
  EXPECT_GT(v->upper, area * (1 - kGrid));
  EXPECT_LE(v->upper - v->lower, 0.01 * v->volume * (1 + 1e-9));
  const workspace::BeyondSingular b = workspace::beyond_singular(*m, options, *v);
  EXPECT_EQ(b.points, 400U);
  EXPECT_NEAR(static_cast<double>(b.beyond), 200, 60);  // below the x axis
  // A survey counts each of its points once.
  quality::SurveyOptions where;
  where.box = {Vec3(-0.02, 0.15, -workspace::kAcross), Vec3(0.02, 0.19, workspace::kAcross)};
  where.resolution = 5;
  const auto s = quality::survey(*m, where);
  ASSERT_TRUE(s) << to_string(s.error());
  EXPECT_TRUE(s->whole_box);
  EXPECT_EQ(s->inside.size(), 25U);
  EXPECT_NEAR(s->volume, 0.04 * 0.04, 1e-12);
}

/// The catalogue's strut hexapod without joint limits, written as legs, with more lines before these.
Result<AnyMachine> as_legs(const AnyMachine& built_in, const std::string& more = {}) {
  const auto& m = std::get<machine::StrutHexapod>(built_in);
  std::string text = more + fmt::format("family = \"parallel\"\nhome = {{ z_mm = {} }}\ntool = {{ z_mm = {} }}\n",
                                        units::to_mm(home_pose(m).p.z()), units::to_mm(m.tool_length));
  const auto list = [](const Vec3& p) {
    return fmt::format("[{:.17g}, {:.17g}, {:.17g}]", units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z()));
  };
  for (std::size_t i = 0; i < 6; ++i) {
    text += fmt::format("[[leg]]\ndrive = \"strut\"\nbase_mm = {}\nplatform_mm = {}\nmin_mm = {}\nmax_mm = {}\n",
                        list(m.base_joint[i]), list(m.platform_joint[i]), units::to_mm(m.length_min),
                        units::to_mm(m.length_max));
  }
  return machine::from_text(text, "legs.toml");
}

/// A strut hexapod without joint limits as legs: the two proofs of one volume hold each other.
TEST(WorkspaceOfLegs, AgreesWithTheHandMadeBoundsOfStruts) {
  const AnyMachine built_in = test::load("hexapod-strut");
  const auto legs = as_legs(built_in);
  ASSERT_TRUE(legs.has_value());
  for (const double tilt : {0.0, 20.0}) {
    workspace::Options options;
    options.directions.tilt = units::from_deg(tilt);
    options.relative_tolerance = 0.05;
    options.bounds_tolerance = 0;
    const auto b = workspace::volume(*legs, options);
    const auto off = workspace::limit_bits(built_in, "joint");
    ASSERT_TRUE(off.has_value());
    options.limits &= ~*off;
    const auto a = workspace::volume(built_in, options);
    ASSERT_TRUE(a && b);
    EXPECT_LE(a->lower, b->upper);
    EXPECT_LE(b->lower, a->upper);
    EXPECT_TRUE(b->converged);
  }
}

/// The tip's limits end the box that is searched only where they are heeded.
TEST(WorkspaceOfLegs, LimitsOfTheTipThatAreOffDoNotEndIt) {
  const AnyMachine built_in = test::load("hexapod-strut");
  const auto free = as_legs(built_in), limited = as_legs(built_in, "limits = { z_max_mm = 70 }\n");
  ASSERT_TRUE(free && limited);
  workspace::Options options;
  options.relative_tolerance = 0.05;
  options.bounds_tolerance = 0;
  const auto whole = workspace::volume(*free, options), part = workspace::volume(*limited, options);
  options.limits &= ~*workspace::limit_bits(*limited, "coordinates");
  const auto without = workspace::volume(*limited, options);
  ASSERT_TRUE(whole && part && without);
  EXPECT_LT(part->upper, whole->lower);
  EXPECT_EQ(without->lower, whole->lower);
  EXPECT_EQ(without->upper, whole->upper);
}

TEST(WorkspaceOfLegs, SaysWhatItCannotAnswer) {
  workspace::Options tilted;
  tilted.directions.tilt = units::from_deg(10);
  const auto v = workspace::volume(test::load("tricept"), tilted);
  ASSERT_FALSE(v.has_value());
  EXPECT_EQ(v.error().id, "WS104");
  for (const auto& [name, off] :
       {std::pair{"tricept", "drive"}, {"hexapod-strut", "length"}, {"delta-linear", "drive"}}) {
    const AnyMachine m = test::load(name);
    workspace::Options endless;
    endless.limits &= ~*workspace::limit_bits(m, off);
    const auto none = workspace::volume(m, endless);
    ASSERT_FALSE(none.has_value()) << name;
    EXPECT_EQ(none.error().id, "WS108") << name;
  }
}

// The least digit of a limit's rounding was absolute: a machine with cranks of 0.2 mm never came to its bounds.
TEST(WorkspaceOfLegs, AreThoseOfAMachineAThousandTimesSmaller) {
  const auto volume = [](const AnyMachine& m) {
    workspace::Options options;
    options.relative_tolerance = 0.3;
    options.max_cells = 100'000;
    const auto v = workspace::volume(m, options);
    EXPECT_TRUE(v);
    return *v;
  };
  for (const char* name : {"hexa", "delta-par4"}) {
    const std::string text = *files::read(test::source(std::string("machines/") + name + ".toml"));
    const std::regex length(R"re(\b(\w*_mm) *= *(\[[^\]]*\]|-?[0-9.]+))re");
    std::string small;
    auto from = text.cbegin();
    for (std::sregex_iterator at(text.begin(), text.end(), length), end; at != end; ++at) {
      small += std::string(from, (*at)[2].first);
      const std::string values = (*at)[2];
      const std::regex number("-?[0-9.]+");
      auto value = values.cbegin();
      for (std::sregex_iterator n(values.begin(), values.end(), number); n != end; ++n) {
        small += std::string(value, (*n)[0].first) + fmt::format("{:.17g}", 1e-3 * std::stod(n->str()));
        value = (*n)[0].second;
      }
      small += std::string(value, values.cend());
      from = (*at)[2].second;
    }
    small += std::string(from, text.cend());
    const auto large = volume(*machine::load(name));
    const auto tiny = machine::from_text(small, "small.toml");
    ASSERT_TRUE(tiny) << to_string(tiny.error());
    const auto found = volume(*tiny);
    EXPECT_TRUE(found.converged) << name;
    EXPECT_NEAR(1e9 * found.lower, large.lower, 1e-6 * large.lower) << name;
    EXPECT_NEAR(1e9 * found.upper, large.upper, 1e-6 * large.upper) << name;
  }
}

}  // namespace
}  // namespace polypod
