// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Errors and tolerances at a pose: closed forms, exact solutions, all combinations of signs.
#include "polypod/quality/errors.hpp"

#include <gtest/gtest.h>

#include <random>

#include "machines.hpp"

#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::quality {
namespace {

using test::load;

using kinematics::AnyMachine;

struct At {
  Pose X;
  JointVector q;
};
At at(const AnyMachine& m, const std::vector<double>& coordinates) {
  const Pose X = kinematics::pose_of(kinematics::task(m), coordinates);
  const auto result = kinematics::inverse(m, X);
  const kinematics::Solution* s = result.reachable();
  if (s == nullptr) throw std::runtime_error("out of reach");
  return {X, s->joints};
}

std::vector<Sized> one(const AnyMachine& m, const std::string& key, double size) {
  return *sized(m, {{key, size}}, false);
}

struct Case {
  const char* machine;
  std::vector<double> pose;
};
const std::vector<Case>& cases() {
  static const std::vector<Case> all{{"hexapod-strut", {0.004, -0.006, 0.075, 0.1, -0.15, 0.02}},
                                     {"hexapod-slider", {0.004, 0.006, 0.095, 0.1, -0.05, 0.02}},
                                     {"lola50", {0.1, -1.25, 0.05, 0.2, -0.1}},
                                     {"delta-brno", {0.05, -0.03, 0.5}},
                                     {"delta-linear", {0.05, -0.03, 0.5}}};
  return all;
}

TEST(Elements, OfCatalogueMachines) {
  const auto count = [](const char* name, const std::string& group) {
    int n = 0;
    for (const Element& e : elements(load(name))) n += e.group == group ? 1 : 0;
    return n;
  };
  for (const char* name : {"hexapod-strut", "hexapod-slider"})
    for (const char* group :
         {"leg.length", "base.joint", "base.attachment", "platform.joint", "platform.attachment", "joint"})
      EXPECT_EQ(count(name, group), 6) << name << " " << group;
  EXPECT_EQ(count("hexapod-slider", "rail.direction"), 6);
  for (const char* group : {"dh.a", "dh.alpha", "dh.d", "dh.theta_offset", "joint"})
    EXPECT_EQ(count("lola50", group), 5) << group;
  // The row "all" of JEL 8.21 has 6 lengths and 72 coordinates.
  int numbers = 0;
  const AnyMachine strut = load("hexapod-strut");
  const auto all = elements(strut);
  for (const Sized& s : one(strut, "all", 0.01))
    numbers += static_cast<int>(all[static_cast<std::size_t>(s.element)].columns.size());
  EXPECT_EQ(numbers, 78);
}

TEST(Elements, BadInput) {
  const AnyMachine m = load("hexapod-strut");
  EXPECT_EQ(sized(m, {{"leg.lenght", 0.01}}, true).error().id, "QU100");
  EXPECT_EQ(sized(m, {{"leg.length[7]", 0.01}}, true).error().id, "QU100");
  EXPECT_EQ(sized(m, {{"leg.length", -0.01}}, true).error().id, "QU101");
  EXPECT_EQ(sized(m, {{"leg.length", std::nan("")}}, false).error().id, "QU101");
  EXPECT_EQ(sized(m, {{"leg.length", 1e18}}, true).error().id, "QU105");
  EXPECT_EQ(sized(m, {{"all", -1e308}}, false).error().id, "QU105");
  EXPECT_TRUE(sized(m, {{"leg.length", 10}}, true));
  EXPECT_TRUE(sized(m, {{"leg.length", -0.01}}, false).has_value());
  EXPECT_EQ(sized(m, {{"leg.length[2]", 1}, {"leg.length", 1}}, true)->at(1).size, 0.002);  // sizes add up
}

TEST(KnownErrors, AllJointsShiftedShiftTheTool) {
  for (const char* name : {"hexapod-strut", "hexapod-slider"}) {
    const AnyMachine m = load(name);
    const At here = at(m, cases()[name == std::string("hexapod-strut") ? 0 : 1].pose);
    const Vec6 base = known_error(m, here.X, here.q, one(m, "base.joint", 0.01));
    const Vec6 platform = known_error(m, here.X, here.q, one(m, "platform.joint", 0.01));
    constexpr double kRounding = 1e-17;
    EXPECT_NEAR((base.head<3>() - Vec3::Constant(1e-5)).norm(), 0, kRounding) << name;
    EXPECT_NEAR((platform.head<3>() + here.X.R * Vec3::Constant(1e-5)).norm(), 0, kRounding) << name;
    EXPECT_NEAR(base.tail<3>().norm() + platform.tail<3>().norm(), 0, 1e-15) << name;
  }
}

TEST(KnownErrors, OfAnArmAreThoseOfItsJoints) {
  const AnyMachine m = load("lola50");
  const At here = at(m, cases()[2].pose);
  for (int i = 1; i <= 5; ++i) {
    const auto J = kinematics::jacobian(m, here.X, here.q);
    for (const char* key : {"joint", "dh.theta_offset"}) {
      const Vec6 moved = known_error(m, here.X, here.q, one(m, std::string(key) + "[" + std::to_string(i) + "]", 0.01));
      const double rad = 0.01 * std::numbers::pi / 180;
      const double sign = key == std::string("joint") ? 1 : std::get<machine::SerialArm>(m).dh[i - 1].sign;
      EXPECT_NEAR((moved - sign * rad * J.col(i - 1)).norm(), 0, 1e-16) << key << i;
    }
  }
}

TEST(KnownErrors, ColumnsOfAnArmAreThoseOfItsClosure) {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> any(-1.5, 1.5);
  for (const auto convention : {machine::DhConvention::standard, machine::DhConvention::modified}) {
    auto arm = std::get<machine::SerialArm>(load("lola50"));
    arm.convention = convention;
    arm.dh[2].kind = machine::JointKind::prismatic;
    arm.dh[3].locked = 0.4;
    for (machine::DhRow& row : arm.dh) {
      row.alpha = any(random);
      row.a = any(random);
      row.d = any(random);
    }
    for (int k = 0; k < 20; ++k) {
      JointVector q(4);
      for (int i = 0; i < 4; ++i) q[i] = any(random);
      const Pose X = machine::forward(arm, q);
      const std::vector<double> p = kinematics::nominal_parameters(arm);
      const std::span<const double> joints(q.data(), 4);
      const Eigen::MatrixXd by_closure = -Mat6(kinematics::closure_by_pose(arm, X, joints, p))
                                              .partialPivLu()
                                              .solve(kinematics::closure_by_parameters(arm, X, joints, p));
      EXPECT_LT((machine::parameter_columns(arm, q) - by_closure).cwiseAbs().maxCoeff(), 1e-13);
    }
  }
}

TEST(KnownErrors, LinearAgainstExactToSecondOrder) {
  std::mt19937 random(5);
  for (const Case& c : cases()) {
    const AnyMachine m = load(c.machine);
    const At here = at(m, c.pose);
    const auto all = elements(m);
    for (std::size_t e = 0; e < all.size(); ++e) {
      if (all[e].columns.empty()) continue;  // figures that others follow from: figures_test
      // 0.2 mm on hexapods of 50 mm, 2 mm on the arm; angles 0.5 deg.
      const double size = all[e].unit == "mm"    ? (c.machine == std::string("lola50") ? 2e-3 : 2e-4)
                          : all[e].unit == "deg" ? 0.009
                                                 : 0.004;
      const auto gap = [&](double share) {
        const std::vector<Sized> errors{{static_cast<int>(e), share * size}};
        const auto exact = known_error_exact(m, here.X, here.q, errors);
        EXPECT_TRUE(exact.has_value()) << all[e].key;
        return (*exact - known_error(m, here.X, here.q, errors)).norm();
      };
      const double whole = gap(1), half = gap(0.5);
      if (whole < 1e-12) continue;  // linear: shifts
      EXPECT_NEAR(whole / half, 4, 0.1) << c.machine << " " << all[e].key;
    }
  }
}

TEST(WorstCase, IsThatOfAllSigns) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> size(0.001, 0.02);
  for (const Case& c : cases()) {
    const AnyMachine m = load(c.machine);
    const At here = at(m, c.pose);
    const auto all = elements(m);
    for (int trial = 0; trial < 4; ++trial) {
      // Up to 16 numbers from anywhere.
      std::vector<Sized> tolerances;
      int numbers = 0;
      while (true) {
        const int e = static_cast<int>(random() % all.size());
        numbers += std::max(1, static_cast<int>(all[static_cast<std::size_t>(e)].columns.size()));
        if (numbers > 16) break;
        tolerances.push_back({e, 1e-3 * size(random)});
      }
      // Each number alone, by its effect as a known error: a machine of Task::axis does not mind the turn of its tool.
      std::vector<Vec6> effects;
      for (const Sized& t : tolerances) {
        const Element& e = all[static_cast<std::size_t>(t.element)];
        const Vec6 whole = known_error(m, here.X, here.q, {t});
        if (e.columns.size() <= 1) {
          effects.push_back(whole);
          continue;
        }
        // The coordinates of a point, by differences of the exact solution.
        const auto nominal = kinematics::parameters(m);
        std::visit(
            [&](const auto& mm) {
              for (const int column : e.columns) {
                const double h = 1e-7;
                std::vector<double> p, joints(here.q.data(), here.q.data() + here.q.size());
                for (const auto& parameter : nominal) p.push_back(parameter.value);
                const auto solve = [&](double step) {
                  auto changed = p;
                  changed[static_cast<std::size_t>(column)] += step;
                  return kinematics::forward_by_closure(mm, std::span<const double>(joints), changed, here.X).X_MT;
                };
                const Pose plus = solve(h), minus = solve(-h);
                Vec6 d;
                d << (plus.p - minus.p) / (2 * h), rotation_vector(plus.R * minus.R.transpose()) / (2 * h);
                effects.push_back(t.size * d);
              }
            },
            m);
      }
      double position = 0, orientation = 0;
      for (std::size_t signs = 0; signs < std::size_t{1} << effects.size(); ++signs) {
        Vec6 sum = Vec6::Zero();
        for (std::size_t i = 0; i < effects.size(); ++i) sum += (signs >> i & 1 ? 1.0 : -1.0) * effects[i];
        position = std::max(position, sum.head<3>().norm());
        Vec3 w = sum.tail<3>();
        if (kinematics::task(m) == machine::Task::axis) w -= here.X.R.col(2) * here.X.R.col(2).dot(w);
        orientation = std::max(orientation, w.norm());
      }
      const auto exact = worst_case(m, here.X, here.q, tolerances);
      const auto search = worst_case(m, here.X, here.q, tolerances, {Method::search, Region::box});
      ASSERT_TRUE(exact.has_value());
      constexpr double kDifferences = 1e-6;  // of the differences that brute force is made of
      EXPECT_NEAR(exact->position / position, 1, kDifferences) << c.machine;
      EXPECT_NEAR(exact->orientation, orientation, kDifferences * (1e-9 + orientation)) << c.machine;
      EXPECT_LE(search->position, exact->position * (1 + 1e-12));
      EXPECT_LE(search->orientation, exact->orientation * (1 + 1e-12));
      // The signs give the error, and the shares add up to it.
      EXPECT_NEAR(exact->position_error.head<3>().norm(), exact->position, 1e-15);
      EXPECT_NEAR(exact->orientation_error.tail<3>().norm(), exact->orientation, 1e-15);
      double sum = 0, sum_w = 0;
      for (const auto& share : exact->shares) {
        sum += share.position;
        sum_w += share.orientation;
      }
      EXPECT_NEAR(sum, exact->position, 1e-15);
      EXPECT_NEAR(sum_w, exact->orientation, 1e-15);
    }
  }
}

TEST(WorstCase, BallsLieBetweenTheBoxesWithinAndAroundThem) {
  for (const char* name : {"hexapod-strut", "hexapod-slider"}) {
    const AnyMachine m = load(name);
    const At here = at(m, cases()[name == std::string("hexapod-strut") ? 0 : 1].pose);
    const auto tolerances = one(m, "all", 0.01);
    const auto box = worst_case(m, here.X, here.q, tolerances);
    const auto ball = worst_case(m, here.X, here.q, tolerances, {Method::exact, Region::sphere});
    ASSERT_TRUE(ball.has_value());
    EXPECT_LT(ball->position, box->position);
    EXPECT_GT(ball->position, box->position / std::sqrt(3.0));
    // One joint: the ball moves its leg by exactly its radius, like an error of the leg's length.
    const auto joint = worst_case(m, here.X, here.q, one(m, "base.joint[3]", 0.01), {Method::exact, Region::sphere});
    const auto length = worst_case(m, here.X, here.q, one(m, "leg.length[3]", 0.01));
    EXPECT_NEAR(joint->position, length->position, 1e-15) << name;
  }
  const AnyMachine arm = load("lola50");
  const At here = at(arm, cases()[2].pose);
  const auto numbers = worst_case(arm, here.X, here.q, one(arm, "all", 0.01), {Method::exact, Region::sphere});
  EXPECT_TRUE(numbers.has_value());  // an arm's elements are single numbers: a sphere is a box
}

TEST(Spread, AgreesWithItsOwnSquares) {
  for (const Case& c : cases()) {
    const AnyMachine m = load(c.machine);
    const At here = at(m, c.pose);
    const auto tolerances = one(m, "all", 0.01);
    const auto exact = worst_case(m, here.X, here.q, tolerances);
    SpreadOptions options;
    options.distribution = Distribution::normal;
    const auto s = spread(m, here.X, here.q, tolerances, options);
    ASSERT_TRUE(s.has_value());
    EXPECT_LT(s->rss_position, exact->position);
    // 99.73 % of normal errors in space lie within 3 to 3.76 standard deviations of their widest direction.
    EXPECT_GT(s->position.quantile, 0.97 * s->rss_position) << c.machine;
    EXPECT_LT(s->position.quantile, 3.9 / 3 * s->rss_position) << c.machine;
    EXPECT_LE(s->position.quantile_low, s->position.quantile);
    EXPECT_GE(s->position.quantile_high, s->position.quantile);
    const auto again = spread(m, here.X, here.q, tolerances, options);
    EXPECT_EQ(again->position.quantile, s->position.quantile);
    options.distribution = Distribution::uniform;
    const auto uniform = spread(m, here.X, here.q, tolerances, options);
    EXPECT_NEAR(uniform->position.mean / s->position.mean, std::sqrt(3.0), 0.05);  // d/sqrt 3 against d/3
    options.distribution = Distribution::triangular;
    const auto triangular = spread(m, here.X, here.q, tolerances, options);
    EXPECT_NEAR(triangular->position.mean / s->position.mean, std::sqrt(1.5), 0.05);  // d/sqrt 6 against d/3
    options.samples = 10;
    EXPECT_EQ(spread(m, here.X, here.q, tolerances, options).error().id, "QU103");
  }
}

}  // namespace
}  // namespace polypod::quality
