// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines of legs from files: against the built-in families, LinuxCNC's modules, closed forms of the literature, and
// what must hold for every machine of the catalogue.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <random>

#include "machines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/hold.hpp"

namespace polypod {
namespace {

using kinematics::JointVector;
using machine::AnyMachine;
using machine::Coordinate;
using machine::Parallel;

constexpr double kSame = 1e-9;  // m and rad: rounding of files (12 digits of lengths of 1 m) and of Newton's method

AnyMachine read(const std::string& text) {
  const auto m = machine::from_text(text, "test.toml");
  if (!m) throw std::runtime_error(to_string(m.error()));
  return *m;
}
const Parallel& legs_of(const AnyMachine& m) {
  return std::get<Parallel>(m);
}
std::string id_of(const std::string& text) {
  const auto m = machine::from_text(text, "test.toml");
  return m ? "none" : m.error().id;
}
std::string list(const Vec3& v, double scale = units::kMmPerMetre) {
  return fmt::format("[{:.17g}, {:.17g}, {:.17g}]", scale * v.x(), scale * v.y(), scale * v.z());
}

/// Poses about a machine's home, moved in the coordinates of its task by up to `share` of what a leg of it measures.
class Poses {
 public:
  Poses(const AnyMachine& m, double length, double angle, std::uint32_t seed)
      : machine_(m), length_(length), angle_(angle), random_(seed) {}
  Pose next() {
    const machine::Task task = kinematics::task(machine_);
    const Pose home = kinematics::home_pose(machine_).value();
    std::vector<double> c = kinematics::coordinates_of(task, home);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int i = 0; i < task.size(); ++i) {
      c[static_cast<std::size_t>(i)] += (task.is_angle(i) ? angle_ : length_) * unit(random_);
    }
    return kinematics::pose_of(task, c);
  }

 private:
  const AnyMachine& machine_;
  double length_, angle_;
  std::mt19937 random_;
};

double largest_difference(const Pose& a, const Pose& b) {
  return std::max((a.p - b.p).norm(), (a.R - b.R).norm());
}

/// What must hold where a machine of legs takes a pose.
void check_at(const AnyMachine& any, const Pose& target, double step = 1e-6) {
  const Parallel& m = legs_of(any);
  const machine::Task task = kinematics::task(any);
  const kinematics::InverseResult inverse = kinematics::inverse(any, target);
  ASSERT_FALSE(inverse.solutions.empty()) << inverse.reason;
  const auto settled = kinematics::settled(any, target);
  ASSERT_TRUE(settled.has_value());
  const Pose X = *settled;
  const std::vector<double> asked = kinematics::coordinates_of(task, target), has = kinematics::coordinates_of(task, X);
  for (std::size_t i = 0; i < asked.size(); ++i) EXPECT_NEAR(asked[i], has[i], kSame) << "coordinate " << i;
  EXPECT_LT(largest_difference(*kinematics::settled(any, X), X), kSame);

  const std::vector<double> p = kinematics::nominal_parameters(m);
  for (const kinematics::Solution& s : inverse.solutions) {
    const std::span<const double> q(s.joints.data(), static_cast<std::size_t>(s.joints.size()));
    EXPECT_LT(closure(m, X, q, std::span<const double>(p)).cwiseAbs().maxCoeff(), kSame) << s.branch;
    EXPECT_EQ(s.violations, kinematics::violations(any, X, s.joints)) << s.branch;
  }
  const JointVector q = inverse.solutions.front().joints;
  const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));

  // The rows in closed form against dual numbers.
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, machine::kMaxEquations, machine::kMaxJoints> B;
  const machine::EquationRows rows = closure_rows(m, X, q, &B);
  EXPECT_LT((rows.A - kinematics::closure_by_pose(m, X, joints, p)).norm(), 1e-10 * (1 + rows.A.norm()));
  EXPECT_LT((B - kinematics::closure_by_joints(m, X, joints, p)).norm(), 1e-10 * (1 + B.norm()));

  // Newton comes back from a neighbouring pose.
  Pose near = X;
  near.p += 1e-3 * m.size * Vec3(1, -1, 0.5);
  near.R = rotation_of(Vec3(1e-3, -1e-3, 5e-4)) * near.R;
  const kinematics::NewtonResult back = forward_from(m, q, near);
  ASSERT_TRUE(back.converged);
  EXPECT_LT(largest_difference(back.X_MT, X), 1e-8);

  // Jacobian and power balance by differences along motions of the task, which the drives can follow.
  const kinematics::JacobianMatrix J = kinematics::jacobian(any, X, q);
  const Vec6 wrench = (Vec6() << 3, -2, 5, 0.4, -0.3, 0.2).finished();
  for (int i = 0; i < task.size(); ++i) {
    std::vector<double> plus = asked, minus = asked;
    plus[static_cast<std::size_t>(i)] += step;
    minus[static_cast<std::size_t>(i)] -= step;
    const Pose a = *kinematics::settled(any, kinematics::pose_of(task, plus)),
               b = *kinematics::settled(any, kinematics::pose_of(task, minus));
    const auto qa = joints_of(m, a), qb = joints_of(m, b);
    ASSERT_TRUE(qa && qb);
    Vec6 twist;
    twist << (a.p - b.p) / (2 * step), rotation_vector(a.R * b.R.transpose()) / (2 * step);
    const JointVector speed = (*qa - *qb) / (2 * step);
    EXPECT_LT((J * speed - twist).norm(), 1e-6 * (1 + twist.norm())) << "coordinate " << i;
    EXPECT_NEAR((J.transpose() * wrench).dot(speed), wrench.dot(twist), 1e-5 * (1 + wrench.norm() * twist.norm()));
  }

  // Intervals round pose, joints and parameters hold the numbers of closure and limits.
  std::vector<Interval> q_box(q.data(), q.data() + q.size()), p_box(p.begin(), p.end());
  for (Interval& v : q_box) v = Interval(v.lo() - 1e-4, v.hi() + 1e-4);
  const auto F = closure(m, X, joints, std::span<const double>(p));
  const auto F_box = closure(m, X.cast<Interval>(), std::span<const Interval>(q_box), std::span<const Interval>(p_box));
  ASSERT_EQ(F.size(), F_box.size());
  for (int i = 0; i < F.size(); ++i) EXPECT_TRUE(F_box[i].contains(F[i])) << "equation " << i;
  const auto g = limits(m, X, joints, std::span<const double>(p));
  const auto g_box = limits(m, X.cast<Interval>(), std::span<const Interval>(q_box), std::span<const Interval>(p_box));
  ASSERT_EQ(g.size(), g_box.size());
  ASSERT_LE(g.size(), 64U);
  for (std::size_t i = 0; i < g.size(); ++i) {
    EXPECT_TRUE(g_box[i].contains(g[i])) << "limit " << i;
    EXPECT_FALSE(kinematics::limit_name(any, static_cast<int>(i)).empty());
  }
}

class MachinesOfLegs : public ::testing::TestWithParam<const char*> {};

TEST_P(MachinesOfLegs, KeepsTheInvariantsAtHomeAndAtRandom) {
  const AnyMachine m = test::load(GetParam());
  check_at(m, *kinematics::home_pose(m));
  Poses poses(m, 0.2 * legs_of(m).size, 0.25, 20261122);
  for (int k = 0; k < 40; ++k) {
    SCOPED_TRACE(k);
    check_at(m, poses.next());
  }
}

TEST_P(MachinesOfLegs, IsWrittenAndReadBackTheSame) {
  const AnyMachine m = test::load(GetParam());
  const std::string text = machine::to_toml(m);
  const AnyMachine again = read(text);
  EXPECT_EQ(machine::to_toml(again), text);
  Poses poses(m, 0.2 * legs_of(m).size, 0.2, 7);
  for (int k = 0; k < 10; ++k) {
    const Pose X = poses.next();
    const auto a = kinematics::inverse(m, X), b = kinematics::inverse(again, X);
    ASSERT_EQ(a.solutions.size(), b.solutions.size());
    for (std::size_t s = 0; s < a.solutions.size(); ++s) {
      EXPECT_EQ(a.solutions[s].branch, b.solutions[s].branch);
      EXPECT_LT((a.solutions[s].joints - b.solutions[s].joints).cwiseAbs().maxCoeff(), kSame);
    }
  }
}

TEST_P(MachinesOfLegs, TakesEveryParameterThatItShows) {
  const AnyMachine m = test::load(GetParam());
  std::vector<double> p;
  for (const machine::Parameter& parameter : kinematics::parameters(m)) p.push_back(parameter.value);
  for (std::size_t k = 0; k < p.size(); ++k) {
    std::vector<double> changed = p;
    if (kinematics::parameters(m)[k].unit.empty()) continue;  // a coordinate of a direction, which stays a unit vector
    changed[k] += 1e-5;
    const auto other = machine::with_parameters(m, changed);
    ASSERT_TRUE(other.has_value()) << kinematics::parameters(m)[k].key << ": " << to_string(other.error());
    const auto after = kinematics::parameters(*other);
    for (std::size_t i = 0; i < p.size(); ++i) {
      EXPECT_NEAR(after[i].value, changed[i], 1e-11) << after[i].key << " with a change of " << after[k].key;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Catalogue, MachinesOfLegs,
                         ::testing::Values("tricept", "exechon", "pentapod", "tripod-z3", "hexa", "planar-3rrr"),
                         [](const auto& machine_name) {
                           std::string name = machine_name.param;
                           for (char& c : name)
                             if (c == '-') c = '_';
                           return name;
                         });

TEST(TaskSubsets, KeepTheirOrderAndFindTheirCoordinates) {
  const machine::Task task{Coordinate::b, Coordinate::z, Coordinate::a};
  const std::vector<double> c{0.3, 0.7, -0.2};
  const Pose X = kinematics::pose_of(task, c);
  EXPECT_LT((X.R - rotation_abc(-0.2, 0.3, 0)).norm(), 1e-15);
  EXPECT_EQ(X.p, Vec3(0, 0, 0.7));
  const std::vector<double> back = kinematics::coordinates_of(task, X);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(back[i], c[i], 1e-15);
  EXPECT_TRUE(task.turns());
  EXPECT_FALSE(task.places());
  EXPECT_TRUE(machine::Task::axis.names_axis());
  EXPECT_FALSE((machine::Task{Coordinate::x, Coordinate::y, Coordinate::a, Coordinate::b, Coordinate::c}).names_axis());
}

TEST(TaskSubsets, AnErrorOfAPoseIsWhatBringsThePrescribedCoordinatesIntoPlace) {
  const machine::Task task{Coordinate::z, Coordinate::a, Coordinate::b};
  const Pose target{rotation_abc(0.2, -0.1, 2.0), {5, 6, 0.4}}, actual{rotation_abc(-0.1, 0.3, 0.7), {1, 2, 0.1}};
  const Vec6 e = machine::pose_error(task, target, actual);
  const Pose moved{rotation_of(e.tail<3>()) * actual.R, actual.p + e.head<3>()};
  EXPECT_NEAR(moved.p.z(), 0.4, 1e-15);
  EXPECT_EQ(moved.p.head<2>(), actual.p.head<2>());
  const Vec3 abc = angles_abc(moved.R);
  EXPECT_NEAR(abc.x(), 0.2, 1e-14);
  EXPECT_NEAR(abc.y(), -0.1, 1e-14);
  EXPECT_NEAR(abc.z(), 0.7, 1e-14);
  // The rows give the rates of what is held: z, A, B.
  const double h = 1e-7;
  for (int k = 0; k < 6; ++k) {
    Pose plus = actual;
    if (k < 3) {
      plus.p[k] += h;
    } else {
      plus.R = rotation_of(h * Vec3::Unit(k - 3)) * plus.R;
    }
    const auto a = kinematics::coordinates_of(task, plus), b = kinematics::coordinates_of(task, actual);
    const auto rows = machine::task_rows(task, actual, 1.0);
    for (int i = 0; i < 3; ++i) {
      EXPECT_NEAR(rows(i, k), (a[static_cast<std::size_t>(i)] - b[static_cast<std::size_t>(i)]) / h, 1e-6);
    }
  }
}

/// A built-in machine written as a machine of legs.
std::string as_legs(const machine::StrutHexapod& m) {
  std::string out = fmt::format("family = \"parallel\"\nhome = {{ z_mm = {:.17g} }}\ntool = {{ z_mm = {:.17g} }}\n",
                                units::to_mm(home_pose(m).p.z()), units::to_mm(m.tool_length));
  for (std::size_t i = 0; i < 6; ++i) {
    out += fmt::format(
        "[[leg]]\ndrive = \"strut\"\nbase_mm = {}\nplatform_mm = {}\nmin_mm = {:.17g}\nmax_mm = {:.17g}\n"
        "compliance_um_per_N = 0.0{}\n",
        list(m.base_joint[i]), list(m.platform_joint[i]), units::to_mm(m.length_min), units::to_mm(m.length_max),
        i + 1);
  }
  return out;
}
std::string as_legs(const machine::SliderHexapod& m) {
  std::string out = fmt::format("family = \"parallel\"\nhome = {{ z_mm = {:.17g} }}\ntool = {{ z_mm = {:.17g} }}\n",
                                units::to_mm(home_pose(m).p.z()), units::to_mm(m.tool_length));
  for (std::size_t i = 0; i < 6; ++i) {
    out += fmt::format(
        "[[leg]]\ndrive = \"rail\"\nbase_mm = {}\nrail = {}\nrod_mm = {:.17g}\nplatform_mm = {}\nmin_mm = 0\nmax_mm = "
        "{:.17g}\n",
        list(m.rail_outer[i]), list(m.rail_direction[i], 1), units::to_mm(m.leg_length), list(m.platform_joint[i]),
        units::to_mm(m.rail_length[i]));
  }
  return out;
}
/// theta counts from straight up (-z) to outward.
std::string as_legs(const machine::RotaryDelta& m) {
  std::string out = fmt::format(
      "family = \"parallel\"\ntask = [\"x\", \"y\", \"z\"]\nhome = {{ x_mm = {:.17g}, y_mm = {:.17g}, z_mm = {:.17g} "
      "}}\ntool = {{ x_mm = {:.17g}, y_mm = {:.17g}, z_mm = {:.17g} }}\n",
      units::to_mm(m.home.x()), units::to_mm(m.home.y()), units::to_mm(m.home.z()), units::to_mm(m.tool.x()),
      units::to_mm(m.tool.y()), units::to_mm(m.tool.z()));
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.arms); ++i) {
    const Vec3 zero = -Vec3::UnitZ(), axis = zero.cross(m.outward[i]);
    out += fmt::format(
        "[[leg]]\ndrive = \"crank\"\nbase_mm = {}\naxis = {}\nzero = {}\narm_mm = {:.17g}\nrod_mm = {:.17g}\n"
        "platform_mm = {}\nmin_deg = {:.17g}\nmax_deg = {:.17g}\n",
        list(m.base_joint[i]), list(axis, 1), list(zero, 1), units::to_mm(m.arm_length[i]),
        units::to_mm(m.rod_length[i]), list(m.platform_joint[i]), units::to_deg(m.range.min),
        units::to_deg(m.range.max));
  }
  return out + "[[constraint]]\nkind = \"orientation\"\n";
}

/// Both machines at random poses: joints, Jacobian, dexterity, smallest singular values.
void compare(const AnyMachine& built_in, const AnyMachine& legs, double length, double angle) {
  Poses poses(built_in, length, angle, 11);
  int judged = 0;
  for (int k = 0; k < 60; ++k) {
    const Pose X = poses.next();
    const auto a = kinematics::inverse(built_in, X), b = kinematics::inverse(legs, X);
    ASSERT_EQ(a.solutions.empty(), b.solutions.empty());
    if (a.solutions.empty()) continue;
    ++judged;
    const JointVector q = a.solutions.front().joints;
    ASSERT_LT((q - b.solutions.front().joints).cwiseAbs().maxCoeff(), kSame);
    const auto forward = kinematics::forward(legs, q);
    ASSERT_FALSE(forward.poses.empty());
    const auto expected = kinematics::forward(built_in, q);
    ASSERT_FALSE(expected.poses.empty());
    EXPECT_LT(largest_difference(forward.poses.front(), expected.poses.front()), 1e-8);
    const auto J = kinematics::jacobian(built_in, X, q), K = kinematics::jacobian(legs, X, q);
    EXPECT_LT((J - K).norm(), 1e-9 * (1 + J.norm()));
    const auto d = kinematics::dexterity(built_in, X, q, 0.1), e = kinematics::dexterity(legs, X, q, 0.1);
    EXPECT_NEAR(d.condition, e.condition, 1e-8 * d.condition);
    EXPECT_NEAR(d.sigma_min, e.sigma_min, 1e-9 * (1 + d.sigma_min));
  }
  EXPECT_GT(judged, 30);
}

TEST(AsLegs, AHexapodOnStrutsGivesItsFigures) {
  const AnyMachine m = test::load("hexapod-strut");
  const AnyMachine legs = read(as_legs(std::get<machine::StrutHexapod>(m)));
  compare(m, legs, 0.01, 0.2);
}
TEST(AsLegs, AHexapodOnRailsGivesItsFigures) {
  const AnyMachine m = test::load("hexapod-slider");
  compare(m, read(as_legs(std::get<machine::SliderHexapod>(m))), 0.008, 0.15);
}
TEST(AsLegs, ADeltaGivesItsFigures) {
  const AnyMachine m = test::load("delta-brno");
  compare(m, read(as_legs(std::get<machine::RotaryDelta>(m))), 0.08, 0);
}

TEST(AsLegs, AllModesOfSixStrutsAreProven) {
  const AnyMachine m = test::load("hexapod-hexam");
  (void)m;
  const AnyMachine strut = test::load("hexapod-octahedral");
  const AnyMachine legs = read(as_legs(std::get<machine::StrutHexapod>(strut)));
  const JointVector q = kinematics::inverse(strut, *kinematics::home_pose(strut)).solutions.front().joints;
  const auto a = kinematics::assembly_modes(strut, q), b = kinematics::assembly_modes(legs, q);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->poses.size(), b->poses.size());
  EXPECT_EQ(a->complete(), b->complete());
}

/// Joints of LinuxCNC 2.9 pentakins with the pentapod's dimensions (effector radius 80, heights less the tool).
TEST(LinuxCnc, PentakinsHasTheStrutsOfThePentapod) {
  struct Case {
    std::vector<double> pose, struts;
  };
  const AnyMachine m = test::load("pentapod");
  for (const Case& c : {
           Case{{0, 0, 900, 0, 0},
                {973.08786859152656, 973.08786878514411, 973.08786878514411, 866.48716056464048, 866.48716056464048}},
           Case{{120, -80, 950, 10, 0},
                {1065.1268941786161, 1063.0057538754197, 932.82273355590939, 804.59263172651413, 993.68166769514573}},
           Case{{120, -80, 950, 0, 10},
                {1068.7628945442002, 1055.995660034542, 934.70169127299641, 879.74639727664885, 973.98909786363606}},
           Case{{-60, 150, 820, -12, 17},
                {833.94130803180315, 936.15201411630585, 1019.2874622733921, 962.73530926311173, 681.81987030099435}},
           Case{{30, 20, 1000, 25, -20},
                {1041.1963096218763, 1113.1817654820145, 1049.4251755562154, 775.6319902672052, 978.90426314982994}},
       }) {
    std::vector<double> pose = c.pose;
    for (std::size_t i = 0; i < 5; ++i) pose[i] = i < 3 ? units::from_mm(pose[i]) : units::from_deg(pose[i]);
    const auto inverse = kinematics::inverse(m, kinematics::pose_of(kinematics::task(m), pose));
    ASSERT_EQ(inverse.solutions.size(), 1U) << inverse.reason;
    for (int i = 0; i < 5; ++i) {
      EXPECT_NEAR(units::to_mm(inverse.solutions[0].joints[i]), c.struts[static_cast<std::size_t>(i)], 1e-9);
    }
  }
}

/// Joints of LinuxCNC 2.9 tripodkins with Bx = 500, Cx = 200, Cy = 400 mm.
TEST(LinuxCnc, TripodkinsHoldsAPointByThreeStruts) {
  const AnyMachine m = read(R"(family = "parallel"
task = "point"
home = { x_mm = 200, y_mm = 100, z_mm = -400 }
leg = [
  { drive = "strut", base_mm = [0, 0, 0], platform_mm = [0, 0, 0], min_mm = 1, max_mm = 900 },
  { drive = "strut", base_mm = [500, 0, 0], platform_mm = [0, 0, 0], min_mm = 1, max_mm = 900 },
  { drive = "strut", base_mm = [200, 400, 0], platform_mm = [0, 0, 0], min_mm = 1, max_mm = 900 },
]
constraint = [{ kind = "orientation" }]
)");
  const std::array<std::array<double, 6>, 3> table{
      {{100, 50, -300, 320.15621187164243, 502.4937810560445, 471.69905660283018},
       {250, 150, -420, 511.27292124656867, 511.27292124656867, 491.32473986152985},
       {180, 220, -700, 755.51307070096414, 800.49984384758, 723.04909930100871}}};
  for (const auto& row : table) {
    const auto inverse =
        kinematics::inverse(m, Pose{Mat3::Identity(), units::from_mm(1) * Vec3(row[0], row[1], row[2])});
    ASSERT_EQ(inverse.solutions.size(), 1U);
    const JointVector q = inverse.solutions[0].joints;
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(units::to_mm(q[i]), row[static_cast<std::size_t>(3 + i)], 1e-9);
    const auto forward = kinematics::forward(m, q);
    ASSERT_EQ(forward.poses.size(), 1U);
    EXPECT_LT((units::kMmPerMetre * forward.poses[0].p - Vec3(row[0], row[1], row[2])).norm(), 1e-8);
    const auto all = kinematics::forward_all(m, q);  // above and below the base
    EXPECT_EQ(all.poses.size(), 2U);
    EXPECT_FALSE(all.complete);
  }
}

/// Carretero et al. 2000: platform joints on a circle of radius r at 0, 120, 240 deg, each in the plane of its leg
/// through the z axis, give R_xy = R_yx, x = r (R_xx - R_yy) / 2 and y = -r R_yx of the circle's middle.
TEST(Tripod, HasTheParasiticMotionsOfTheClosedForms) {
  const AnyMachine m = test::load("tripod-z3");
  const double r = 0.150, tool = 0.100;
  for (const double a : {-0.35, -0.1, 0.0, 0.2, 0.4}) {
    // Past 90 deg too, where A and B of a rotation jump: the way from home is continuous.
    for (const double b : {-0.4, 0.0, 0.15, 0.3, 1.4, 1.6, 1.9, 2.2}) {
      const auto X = kinematics::settled(m, kinematics::pose_of(kinematics::task(m), {0.9, a, b}));
      ASSERT_TRUE(X.has_value());
      const double c = std::atan2(std::sin(a) * std::sin(b), std::cos(a) + std::cos(b));
      EXPECT_LT((X->R - rotation_abc(a, b, c)).norm(), 1e-10);
      const Vec3 middle = X->p - tool * X->R.col(2);
      EXPECT_NEAR(middle.x(), 0.5 * r * (X->R(0, 0) - X->R(1, 1)), 1e-10);
      EXPECT_NEAR(middle.y(), -r * X->R(1, 0), 1e-10);
      EXPECT_NEAR(X->p.z(), 0.9, 1e-12);
    }
  }
}

/// Three struts whose joints stay in vertical planes, the first in x = 0 and the others in those through the z axis
/// that rise by 25 deg from the x axis (3-RPS). With A = 0 the platform turns about y and C = 0; its joints are at (0,
/// y1), (-x2, y2) and (x2, y2). A turn dC is free where tan 25 deg (y1 - y2) + x2 cos B = 0: no constraint holds it,
/// and beyond lies another assembly mode.
TEST(Tripod, EndsWhereItsConstraintsAreSingular) {
  const double y1 = 170, x2 = 163.135402, y2 = -76.071287;
  std::string text =
      "name = \"rps\"\nfamily = \"parallel\"\ntask = [\"z\", \"A\", \"B\"]\nhome = { z_mm = 700 }\nhangs = true\n";
  const std::array<std::array<double, 6>, 3> legs{{{0, 260, 0, y1, -1, 0},
                                                   {-271.892336, -126.785479, -x2, y2, 0.422618261741, -0.906307787037},
                                                   {271.892336, -126.785479, x2, y2, 0.422618261741, 0.906307787037}}};
  for (const auto& [bx, by, px, py, nx, ny] : legs) {
    text += fmt::format(
        "[[leg]]\ndrive = \"strut\"\nbase_mm = [{0}, {1}, 0]\nplatform_mm = [{2}, {3}, 0]\nmin_mm = 1\nmax_mm = 2000\n"
        "[[constraint]]\nkind = \"plane\"\nplatform_mm = [{2}, {3}, 0]\nbase_mm = [{0}, {1}, 0]\nnormal = [{4}, {5}, "
        "0]\n",
        bx, by, px, py, nx, ny);
  }
  const auto m = machine::from_text(text, "rps.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  const double end = std::acos(-std::tan(units::from_deg(25)) * (y1 - y2) / x2);
  EXPECT_NEAR(units::to_deg(end), 134.69, 0.01);
  const auto at = [&](double b) { return kinematics::settled(*m, Pose{rotation_abc(0, b, 0), {0, 0, 0.9}}); };
  for (const double sign : {1.0, -1.0}) {
    for (const double share : {0.1, 0.5, 0.9, 0.95, 0.97, 0.99, 0.999}) {
      const double b = sign * share * end;
      const auto X = at(b);
      ASSERT_TRUE(X.has_value()) << b;
      EXPECT_LT((X->R - rotation_abc(0, b, 0)).norm(), 1e-9);
      EXPECT_NEAR(X->p.x(), 0, 1e-9);
      EXPECT_NEAR(X->p.y(), 1e-3 * (-y2 - std::tan(units::from_deg(25)) * x2 * std::cos(b)), 1e-9);
    }
    for (const double beyond : {1.001, 1.01, 1.1}) EXPECT_FALSE(at(sign * beyond * end).has_value()) << beyond;
  }
}

/// The tube runs through the joint at the origin: the tool's axis is the direction of its tip, and the universal joint
/// keeps x of the base square to y of the platform.
TEST(Tricept, TiltsWithThePositionOfItsTip) {
  const AnyMachine m = test::load("tricept");
  for (const Vec3& p : {Vec3(0, 0, 1.2), Vec3(0.3, 0, 1.1), Vec3(-0.2, 0.35, 1.3), Vec3(0.1, -0.4, 1.0)}) {
    const auto X = kinematics::settled(m, Pose{Mat3::Identity(), p});
    ASSERT_TRUE(X.has_value());
    const Vec3 k = p.normalized();
    EXPECT_LT((X->R.col(2) - k).norm(), 1e-10);
    EXPECT_LT((X->R.col(1) - k.cross(Vec3::UnitX()).normalized()).norm(), 1e-10);
    EXPECT_LT((X->p - p).norm(), 1e-15);
    const JointVector q = kinematics::inverse(m, Pose{Mat3::Identity(), p}).solutions.at(0).joints;
    for (int i = 0; i < 3; ++i) {
      const double angle = units::from_deg(90 + 120 * i);
      const Vec3 u(std::cos(angle), std::sin(angle), 0);
      EXPECT_NEAR(q[i], (p + X->R * (0.12 * u - Vec3(0, 0, 0.3)) - 0.27 * u).norm(), 1e-9);
    }
  }
}

/// Struts 1 and 2 lie in a plane through x of the base, turned by a, in which the platform turns by b: R = Rx(a) Ry(b),
/// its middle Rx(a) (s, 0, h). Strut 3 lies in the plane of y and z of the platform: s = (h + B sin a) tan b, with its
/// base joint at y = B.
TEST(Exechon, HasThePlatformOfItsClosedForm) {
  const AnyMachine m = test::load("exechon");
  const double B = 0.280, tool = 0.250;
  for (const double a : {-0.3, -0.1, 0.0, 0.2}) {
    for (const double b : {-0.25, 0.0, 0.1, 0.3}) {
      const double h = 0.97, s = (h + B * std::sin(a)) * std::tan(b);
      const Mat3 R = rotation_x(a) * rotation_y(b);
      const Vec3 middle = rotation_x(a) * Vec3(s, 0, h);
      const Pose tip{Mat3::Identity(), middle + tool * R.col(2)};
      const auto X = kinematics::settled(m, tip);
      ASSERT_TRUE(X.has_value());
      EXPECT_LT((X->R - R).norm(), 1e-10);
      const JointVector q = kinematics::inverse(m, tip).solutions.at(0).joints;
      const std::array<Vec3, 3> base{Vec3(0.3, 0, 0), Vec3(-0.3, 0, 0), Vec3(0, B, 0)};
      const std::array<Vec3, 3> joint{Vec3(0.11, 0, 0), Vec3(-0.11, 0, 0), Vec3(0, 0.1, 0)};
      for (std::size_t i = 0; i < 3; ++i)
        EXPECT_NEAR(q[static_cast<Eigen::Index>(i)], (middle + R * joint[i] - base[i]).norm(), 1e-10);
    }
  }
}

// A column that turns in a ball and slides, held by four struts that cross: the straight way of the joints from home
// leads over singular poses where that of the pose does not. Forward ended in another assembly mode for one pose in
// eighty.
TEST(FourStruts, StayInTheModeOfHomeWhereNoSingularPoseLiesBetween) {
  const AnyMachine m = read(R"(
family = "parallel"
task = ["x", "y", "z", "C"]
home = { z_mm = 800 }
tool = { z_mm = 120 }
limits = { z_min_mm = 650, z_max_mm = 950 }
leg = [
 { drive="strut", base_mm=[400,100,0], platform_mm=[150,-60,0], min_mm=500, max_mm=900 },
 { drive="strut", base_mm=[-120,420,0], platform_mm=[70,150,0], min_mm=500, max_mm=900 },
 { drive="strut", base_mm=[-410,-90,0], platform_mm=[-150,80,-20], min_mm=500, max_mm=900 },
 { drive="strut", base_mm=[130,-400,0], platform_mm=[-60,-150,0], min_mm=500, max_mm=900 } ]
constraint = [ { kind="line", platform_mm=[0,0,0], axis=[0,0,1], base_mm=[0,0,0] } ]
)");
  const Pose home = *kinematics::home_pose(m);
  std::mt19937 random(4);
  std::uniform_real_distribution<double> unit(-1, 1);
  int judged = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    const Vec3 p(0.25 * unit(random), 0.25 * unit(random), 0.8 + 0.14 * unit(random));
    const double c = units::from_deg(60) * unit(random);
    const auto between = [&](double s) { return Pose{rotation_z(s * c), home.p + s * (p - home.p)}; };
    bool regular = true;
    JointVector q;
    for (int k = 0; k <= 40 && regular; ++k) {
      const auto inverse = kinematics::inverse(m, between(k / 40.0));
      regular = inverse.reachable() != nullptr;
      if (!regular) break;
      q = inverse.reachable()->joints;
      const double at_home = kinematics::hold(m, home, kinematics::inverse(m, home).reachable()->joints).determinant;
      const Pose X = kinematics::settled(m, between(k / 40.0), q);
      regular = kinematics::hold(m, X, q).determinant / at_home > 0.02;
    }
    if (!regular) continue;
    ++judged;
    const auto forward = kinematics::forward(m, q);
    ASSERT_EQ(forward.poses.size(), 1u);
    EXPECT_LT((forward.poses[0].p - p).norm(), 1e-7) << 1e3 * p.transpose() << ", C " << units::to_deg(c);
  }
  EXPECT_GT(judged, 200);
}

TEST(Redundant, FourStrutsOnAPointCloseOnlyWhereTheyAgree) {
  const AnyMachine m = read(R"(family = "parallel"
task = "point"
home = { z_mm = 400 }
leg = [
  { drive = "strut", base_mm = [300, 0, 0], platform_mm = [0, 0, 0], min_mm = 100, max_mm = 900 },
  { drive = "strut", base_mm = [0, 300, 0], platform_mm = [0, 0, 0], min_mm = 100, max_mm = 900 },
  { drive = "strut", base_mm = [-300, 0, 0], platform_mm = [0, 0, 0], min_mm = 100, max_mm = 900 },
  { drive = "strut", base_mm = [0, -300, 0], platform_mm = [0, 0, 0], min_mm = 100, max_mm = 900 },
]
constraint = [{ kind = "orientation" }]
)");
  check_at(m, Pose{Mat3::Identity(), {0.05, -0.02, 0.45}});
  JointVector q = kinematics::inverse(m, Pose{Mat3::Identity(), {0.05, -0.02, 0.45}}).solutions.at(0).joints;
  EXPECT_EQ(kinematics::forward(m, q).poses.size(), 1U);
  q[3] += 1e-4;
  EXPECT_TRUE(kinematics::forward(m, q).poses.empty());
}

/// Readings of four decimals of a millimetre, as `polypod ik` prints them, close seven legs; a tenth of one does not.
TEST(Redundant, ReadingsCloseAsFarAsTheyHaveDigits) {
  std::string text = "family = \"parallel\"\nhome = { z_mm = 420 }\ntool = { z_mm = 60 }\n";
  for (int i = 0; i < 7; ++i) {
    const double base = units::from_deg(60 * (i / 2 * 2) + (i % 2 == 0 ? -10 : 10)),
                 platform = units::from_deg(60 * (i / 2 * 2) + (i % 2 == 0 ? -50 : 50));
    const Vec3 B = i < 6 ? Vec3(0.25 * std::cos(base), 0.25 * std::sin(base), 0) : Vec3(Vec3::Zero());
    const Vec3 P = i < 6 ? Vec3(0.11 * std::cos(platform), 0.11 * std::sin(platform), 0) : Vec3(Vec3::Zero());
    text += fmt::format("[[leg]]\ndrive = \"strut\"\nbase_mm = {}\nplatform_mm = {}\nmin_mm = 200\nmax_mm = 600\n",
                        list(B), list(P));
  }
  const AnyMachine m = read(text);
  Poses poses(m, 0.03, 0.1, 5);
  for (int k = 0; k < 10; ++k) {
    const Pose X = poses.next();
    JointVector q = kinematics::inverse(m, X).solutions.at(0).joints;
    for (double& length : q) length = 1e-7 * std::round(1e7 * length);
    const auto found = kinematics::forward(m, q);
    ASSERT_EQ(found.poses.size(), 1U) << found.reason;
    EXPECT_LT((found.poses[0].p - X.p).norm(), 1e-6);
    q[6] += 1e-4;
    EXPECT_TRUE(kinematics::forward(m, q).poses.empty());
  }
}

/// Four struts and a kept orientation: least squares are those of the legs, each by its length over that at home, in
/// the translations alone; the platform does not turn.
TEST(Redundant, AConstraintDoesNotGiveWay) {
  std::string text =
      "family = \"parallel\"\ntask = [\"x\", \"y\", \"z\"]\nhome = { z_mm = 500 }\n[[constraint]]\nkind = "
      "\"orientation\"\n";
  std::vector<Vec3> along;  // from the platform's joint less the tool tip to that of the base
  for (int i = 0; i < 4; ++i) {
    const double at = units::from_deg(90 * i + 7 * i * i);
    const Vec3 B(0.3 * std::cos(at), 0.3 * std::sin(at), 0.01 * i), P(0.1 * std::cos(at), 0.1 * std::sin(at), 0);
    along.push_back(P - B);
    text += fmt::format("[[leg]]\ndrive = \"strut\"\nbase_mm = {}\nplatform_mm = {}\nmin_mm = 300\nmax_mm = 800\n",
                        list(B), list(P));
  }
  const AnyMachine m = read(text);
  const Pose X{Mat3::Identity(), {0.02, 0.03, 0.52}};
  const JointVector q = kinematics::inverse(m, X).solutions.at(0).joints;
  Eigen::Matrix<double, 4, 3> A;
  Eigen::Matrix4d B = Eigen::Matrix4d::Zero();
  for (int i = 0; i < 4; ++i) {
    const Vec3 y = X.p + along[static_cast<std::size_t>(i)];
    const double reference = (Vec3(0, 0, 0.5) + along[static_cast<std::size_t>(i)]).norm();
    A.row(i) = y.transpose() / reference;
    B(i, i) = y.norm() / reference;
  }
  const Eigen::Matrix<double, 3, 4> expected = (A.transpose() * A).inverse() * A.transpose() * B;
  const machine::JacobianMatrix J = kinematics::jacobian(m, X, q);
  EXPECT_LT((J.topRows<3>() - expected).norm(), 1e-8);
  EXPECT_LT(J.bottomRows<3>().norm(), 1e-8);
}

const std::string kThreeStruts = R"(
leg = [
  { drive = "strut", base_mm = [300, 0, 0], platform_mm = [100, 0, 0], min_mm = 100, max_mm = 900 },
  { drive = "strut", base_mm = [-150, 260, 0], platform_mm = [-50, 87, 0], min_mm = 100, max_mm = 900 },
  { drive = "strut", base_mm = [-150, -260, 0], platform_mm = [-50, -87, 0], min_mm = 100, max_mm = 900 },
]
)";

/// A five-bar of 90 mm links on axes 118 mm apart, as the DexTAR: its rods lead to the tool tip itself, so that both
/// ends of an arm are equally far from it.
std::string five_bar(double rod_mm, double tool_mm, double home_z_mm = 0) {
  const auto leg = [&](double x, double least) {
    return fmt::format(
        "[[leg]]\ndrive = \"crank\"\nbase_mm = [{}, 0, 0]\naxis = [0, 0, 1]\nzero = [1, 0, 0]\narm_mm = 90\n"
        "rod_mm = {}\nplatform_mm = [0, 0, 0]\nmin_deg = {}\nmax_deg = {}\n",
        x, rod_mm, least, least + 180);
  };
  return fmt::format(
             "family = \"parallel\"\ntask = [\"x\", \"y\"]\nhome = {{ y_mm = 118, z_mm = {} }}\ntool = {{ z_mm = {} "
             "}}\n",
             home_z_mm, tool_mm) +
         leg(-59, 20) + leg(59, -20) +
         "[[constraint]]\nkind = \"orientation\"\n[[constraint]]\nkind = \"plane\"\nplatform_mm = [0, 0, 0]\nbase_mm = "
         "[0, 0, "
         "0]\nnormal = [0, 0, 1]\n";
}

TEST(FiveBar, StandsWithItsElbowsOutwardsWhateverRoundingSays) {
  for (const double rod : {89.9, 89.99, 90.0, 90.01, 90.1}) {
    SCOPED_TRACE(rod);
    const AnyMachine m = read(five_bar(rod, 0));
    for (const double x : {-0.03, 0.0, 0.01}) {
      const auto found = kinematics::inverse(m, Pose{Mat3::Identity(), Vec3(x, 0.12, 0)});
      ASSERT_FALSE(found.solutions.empty());
      const JointVector& q = found.solutions.front().joints;
      EXPECT_GT(q[0], units::from_deg(80)) << "the left arm points outwards";
      EXPECT_LT(q[1], units::from_deg(100));
    }
  }
}

// Coordinates that follow are found from those that home gives, however far the tool tip is from the platform.
TEST(FiveBar, ClosesAtHomeWithAToolOfAnyLength) {
  for (const double tool : {0.1, 50.0, 200.0}) {
    for (const double given : {0.0, 50.0}) {
      SCOPED_TRACE(fmt::format("tool {} home {}", tool, given));
      const auto m = machine::from_text(five_bar(90, tool, given), "test.toml");
      ASSERT_TRUE(m) << to_string(m.error());
      EXPECT_NEAR(kinematics::home_pose(*m)->p.z(), units::from_mm(tool), kSame);
    }
  }
}

TEST(Files, ThatDoNotCloseAreRefusedWithTheReason) {
  const std::string head = "family = \"parallel\"\ntask = \"point\"\nhome = { z_mm = 400 }\n";
  EXPECT_EQ(id_of(head + kThreeStruts), "MA156");  // nothing fixes the orientation
  EXPECT_EQ(id_of(head + kThreeStruts + "constraint = [{ kind = \"orientation\" }]"), "none");
  // The task holds an angle that the constraint holds, too.
  EXPECT_EQ(id_of("family = \"parallel\"\ntask = [\"x\", \"y\", \"z\", \"A\"]\nhome = { z_mm = 400 }\n" + kThreeStruts +
                  "constraint = [{ kind = \"orientation\" }]"),
            "MA156");
  // A tripod whose C follows from its hinges already, while nothing says B.
  const auto swapped = machine::load("tripod-z3", {});
  ASSERT_TRUE(swapped);
  std::string text = machine::to_toml(*swapped);
  const std::size_t task = text.find("\"B\"");
  ASSERT_NE(task, std::string::npos) << text;
  const auto refused = machine::from_text(text.replace(task, 3, "\"C\""), "swapped.toml");
  ASSERT_FALSE(refused);
  EXPECT_NE(to_string(refused.error()).find("C follows from the constraints already and x, B are left"),
            std::string::npos)
      << to_string(refused.error());
  // Parallel struts with equal triangles: mobile at home.
  EXPECT_EQ(id_of(head + R"(leg = [
  { drive = "strut", base_mm = [100, 0, 0], platform_mm = [100, 0, 0], min_mm = 100, max_mm = 900 },
  { drive = "strut", base_mm = [-50, 87, 0], platform_mm = [-50, 87, 0], min_mm = 100, max_mm = 900 },
  { drive = "strut", base_mm = [-50, -87, 0], platform_mm = [-50, -87, 0], min_mm = 100, max_mm = 900 },
]
constraint = [{ kind = "orientation" }])"),
            "MA154");
  // A rod that does not reach its rail, and a passive rod that is too short.
  EXPECT_EQ(id_of(R"(family = "parallel"
task = ["z"]
home = { z_mm = 400 }
leg = [{ drive = "rail", base_mm = [500, 0, 0], rail = [0, 0, 1], rod_mm = 100, platform_mm = [0, 0, 0], min_mm = 0, max_mm = 900 }]
constraint = [{ kind = "orientation" }, { kind = "line", platform_mm = [0, 0, 0], axis = [0, 0, 1], base_mm = [0, 0, 0] }])"),
            "MA155");
  EXPECT_EQ(id_of(R"(family = "parallel"
task = ["x", "y"]
home = { z_mm = 400 }
leg = [
  { drive = "strut", base_mm = [300, 0, 0], platform_mm = [0, 0, 0], min_mm = 100, max_mm = 900 },
  { drive = "strut", base_mm = [0, 300, 0], platform_mm = [0, 0, 0], min_mm = 100, max_mm = 900 },
  { drive = "none", base_mm = [900, 900, 0], platform_mm = [0, 0, 0], rod_mm = 600 },
]
constraint = [{ kind = "orientation" }])"),
            "MA155");
  // Constraints that agree at home alone: three planes and a fixed orientation hold more than they leave.
  EXPECT_EQ(
      id_of(head +
            "leg = [{ drive = \"strut\", base_mm = [0, 0, 0], platform_mm = [0, 0, 0], min_mm = 1, max_mm = 900 }]"),
      "MA156");
  EXPECT_EQ(id_of(head + "leg = [{ drive = \"screw\" }]"), "MA151");
  EXPECT_EQ(
      id_of(head +
            "leg = [{ drive = \"strut\", base_mm = [0, 0, 0], platform_mm = [0, 0, 0], min_mm = 9, max_mm = 1 }]"),
      "MA152");
  EXPECT_EQ(id_of(head + "leg = [{ drive = \"rail\", base_mm = [0, 0, 0], rail = [0, 0, 0], rod_mm = 1, platform_mm = "
                         "[0, 0, 0], min_mm = 0, max_mm = 1 }]"),
            "MA150");
  EXPECT_EQ(id_of(head + "leg = []"), "MA153");
  EXPECT_EQ(id_of("family = \"parallel\"\ntask = [\"x\", \"q\"]\n" + kThreeStruts), "MA119");
  EXPECT_EQ(id_of("family = \"parallel\"\ntask = [\"x\", \"x\"]\n" + kThreeStruts), "MA119");
}

TEST(Files, NameThePlaceOfAnError) {
  const auto m =
      machine::from_text("family = \"parallel\"\n[[leg]]\ndrive = \"strut\"\nbase_mm = [1, 2]\n", "bad.toml");
  ASSERT_FALSE(m.has_value());
  EXPECT_NE(to_string(m.error()).find("bad.toml:4:"), std::string::npos) << to_string(m.error());
}

}  // namespace
}  // namespace polypod
