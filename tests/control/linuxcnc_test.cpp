// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Exported kinematics modules, compiled and called as LinuxCNC calls them: against Polypod's own kinematics on every
// machine of the catalogue, and against LinuxCNC's genuine modules where they are of the same kind.
#include "polypod/control/linuxcnc.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <numbers>

#include "machines.hpp"
#include "module_host.hpp"
#include "paths.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/control/settings.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::control {
namespace {

using machine::JointKind;
using machine::Task;
using test::ModuleHost;

// mm and deg: some tens of roundings of lengths of a few metres and angles, carried to the pose near singular poses.
constexpr double kRoundTrip = 1e-9;
// mm and deg: Polypod's own inverse of stages is a search that ends at 1e-10 m.
constexpr double kInverse = 1e-7;

/// Every coordinate x, y, z, a, b, c in mm and deg; 0 where the task does not prescribe it.
std::vector<double> world_of(const AnyMachine& m, const Pose& X) {
  const Task task = kinematics::task(m);
  const std::vector<double> c = kinematics::coordinates_of(task, X);
  std::vector<double> out(6, 0.0);
  for (int i = 0; i < task.size(); ++i) {
    const double value = c[static_cast<std::size_t>(i)];
    out[static_cast<std::size_t>(task[i])] = task.is_angle(i) ? units::to_deg(value) : units::to_mm(value);
  }
  return out;
}
bool turns(const AnyMachine& m, int joint) {
  return kinematics::joint_kind(m, joint) == JointKind::revolute;
}
std::vector<double> user(const AnyMachine& m, const JointVector& q) {
  std::vector<double> out;
  for (int i = 0; i < static_cast<int>(q.size()); ++i)
    out.push_back(turns(m, i) ? units::to_deg(q[i]) : units::to_mm(q[i]));
  return out;
}
double farthest(const std::vector<double>& a, const std::vector<double>& b) {
  double out = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) out = std::max(out, std::abs(a[i] - b[i]));
  return out;
}
/// Turns apart from each other count as one.
double apart(const AnyMachine& m, const std::vector<double>& a, const std::vector<double>& b) {
  double out = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = a[i] - b[i];
    out = std::max(out, std::abs(turns(m, static_cast<int>(i)) ? std::remainder(d, 360.0) : d));
  }
  return out;
}

std::filesystem::path written(const test::Folder& folder, const Module& module) {
  const auto file = folder.path() / (module.name + ".c");
  std::ofstream(file) << module.source;
  return file;
}

LinuxcncConfiguration exported(const AnyMachine& m, std::size_t stands = 60) {
  LinuxcncOptions options;
  options.stands = stands;
  const auto out = linuxcnc_configuration(m, options);
  if (!out) throw std::runtime_error(to_string(out.error()));
  return *out;
}
std::vector<double> homes(const std::vector<ControllerAxis>& joints) {
  std::vector<double> out;
  for (const ControllerAxis& joint : joints) out.push_back(joint.home);
  return out;
}
std::vector<double> home_of(const LinuxcncConfiguration& c) {
  std::vector<double> out(6, 0.0);
  for (const ControllerAxis& axis : c.axes) out[std::string_view("XYZABC").find(axis.letter)] = axis.home;
  return out;
}

/// What has no answer is -1, changes nothing, and sets the error until something has one.
void expect_refusals(const AnyMachine& m, const LinuxcncConfiguration& c, ModuleHost& host) {
  const std::vector<double> home = homes(c.joints), at_home = home_of(c);
  const auto recovers = [&] {
    std::vector<double> q = home;
    EXPECT_EQ(host.pin("kinematics-error"), 1);
    ASSERT_EQ(host.inverse(at_home, q), 0);
    EXPECT_LT(apart(m, q, home), 1e-6);
    EXPECT_EQ(host.pin("kinematics-error"), 0);
  };
  // Out of reach in every coordinate that is a length; struts reach anywhere, so theirs are limits of LinuxCNC.
  bool struts = std::holds_alternative<machine::StrutHexapod>(m);
  if (const auto* legs = std::get_if<machine::Parallel>(&m)) {
    for (const machine::ParallelLeg& leg : legs->legs) struts = struts || leg.drive == machine::LegDrive::strut;
  }
  const bool slides = std::holds_alternative<machine::Stages>(m);  // its slides reach anywhere, too
  const bool has_y = std::any_of(c.axes.begin(), c.axes.end(), [](const ControllerAxis& a) { return a.letter == 'Y'; });
  if (!struts && !slides && has_y) {  // no rail of the catalogue leads along y
    std::vector<double> far = at_home, q = home;
    far[1] += 1e5;
    EXPECT_EQ(host.inverse(far, q), -1);
    EXPECT_EQ(q, home);
    EXPECT_EQ(host.pin("inverse-failures"), 1);
    recovers();
  }
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinite = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, infinite}) {
    std::vector<double> pose = at_home, q = home;
    pose[std::string_view("XYZABC").find(c.axes.back().letter)] = bad;
    EXPECT_EQ(host.inverse(pose, q), -1);
    EXPECT_EQ(q, home);
    recovers();
    q[0] = bad;
    pose = at_home;
    EXPECT_EQ(host.forward(q, pose), -1);
    EXPECT_EQ(pose, at_home);
    recovers();
  }
  // A parameter that is no number fails, and mends when it is one again.
  const std::string pin = c.module.pins.front().name;
  const double value = host.pin(pin);
  host.set(pin, nan);
  std::vector<double> pose = at_home, q = home;
  EXPECT_EQ(host.forward(q, pose), -1);
  host.set(pin, value);
  recovers();
  // While the machine is off there is no error.
  host.set("armed", 0);
  q[0] = nan;
  EXPECT_EQ(host.forward(q, pose), -1);
  EXPECT_EQ(host.pin("kinematics-error"), 0);
}

class Catalogue : public testing::TestWithParam<std::string> {};

TEST_P(Catalogue, ModuleAgreesWithPolypodAndWithItself) {
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers";
  const AnyMachine m = test::load(GetParam());
  const LinuxcncConfiguration c = exported(m);
  const test::Folder folder;
  const auto so = test::compiled(written(folder, c.module));
  ASSERT_FALSE(so.empty());
  ModuleHost host(so.string());
  ASSERT_EQ(host.loaded, 0);
  for (const ModulePin& pin : c.module.pins) EXPECT_EQ(host.pin(pin.name), pin.value) << pin.name;

  // [TRAJ]HOME is the forward of the joints' homes.
  const std::vector<double> home = homes(c.joints);
  std::vector<double> pose = home_of(c);
  ASSERT_EQ(host.forward(home, pose), 0);
  EXPECT_LT(farthest(pose, home_of(c)), kRoundTrip);

  int taken = 0, tried = 0, found_from_home = 0;
  for (const calibration::Stand& stand : calibration::random_stands(m, 40, 7)) {
    const std::vector<double> asked = world_of(m, stand.X_MT);
    ++tried;
    std::vector<double> q = home;
    if (host.inverse(asked, q) != 0) {
      EXPECT_EQ(q, home) << "a failure changes no joint";
      continue;
    }
    ++taken;
    // Among the solutions of Polypod.
    const auto found = kinematics::inverse(m, stand.X_MT);
    double nearest = std::numeric_limits<double>::infinity();
    for (const kinematics::Solution& s : found.solutions) nearest = std::min(nearest, apart(m, user(m, s.joints), q));
    if (!std::holds_alternative<machine::Stages>(m)) {  // which list some
      EXPECT_LT(nearest, kInverse);
    }
    // And back, from a pose that is a little off, and from home.
    for (const bool from_home : {false, true}) {
      std::vector<double> back = from_home ? home_of(c) : asked;
      if (!from_home) back[2] += 0.2;
      const int answer = host.forward(q, back);
      // From home the joints between may lead over singular poses: then there is no answer, but never a wrong one.
      if (from_home && answer != 0) continue;
      ASSERT_EQ(answer, 0);
      found_from_home += from_home ? 1 : 0;
      for (const ControllerAxis& axis : c.axes) {
        const std::size_t k = std::string_view("XYZABC").find(axis.letter);
        const double off = back[k] - asked[k];
        EXPECT_LT(std::abs(k < 3 ? off : std::remainder(off, 360.0)), kRoundTrip) << axis.letter;
      }
    }
    // The same joints from themselves: nothing drifts.
    std::vector<double> again = q;
    ASSERT_EQ(host.inverse(asked, again), 0);
    EXPECT_LT(farthest(again, q), kRoundTrip);
  }
  EXPECT_EQ(tried, 40);
  EXPECT_GE(taken, 10) << "of " << tried;
  // The stands come from Polypod's forward, which also finds poses that the straight way of the tool alone leads to: of
  // hexa 11 of 40, to which the module's way of the joints does not.
  EXPECT_GE(found_from_home, (GetParam() == std::string_view("hexa") ? 0.7 : 0.8) * taken);
  ModuleHost other(so.string());
  expect_refusals(m, c, other);
}

/// A head with C and A cannot leave the upright tool in A and B: home tilts it, and joints that do not are refused.
TEST(Export, HomeLeavesNoJointFree) {
  const AnyMachine m = test::load("gantry-fork");
  const LinuxcncConfiguration c = exported(m);
  EXPECT_NEAR(std::abs(c.joints[4].home), 10, 1e-6);
  LinuxcncOptions options;
  options.stands = 60;
  options.home = machine::JointVector::Zero(5);
  const auto upright = linuxcnc_configuration(m, options);
  ASSERT_FALSE(upright);
  EXPECT_EQ(upright.error().id, "LC105");
}

std::vector<std::string> names() {
  std::vector<std::string> out;
  for (const auto& entry : machine::catalogue()) out.emplace_back(entry.name);
  return out;
}
INSTANTIATE_TEST_SUITE_P(Machines, Catalogue, testing::ValuesIn(names()), [](const auto& machine) {
  std::string out = machine.param;
  std::replace(out.begin(), out.end(), '-', '_');
  return out;
});

/// The name stands in a comment of the source, whatever it is.
TEST(LinuxcncModule, ANameCannotEndItsComment) {
  auto m = test::load("delta-brno");
  std::visit([](auto& one) { one.name = "x*/ int evil(void) { return 1; } /**//*"; }, m);
  const std::string source = exported(m).module.source;
  const std::size_t begin = source.find("/*"), end = source.find("*/");
  ASSERT_NE(begin, std::string::npos);
  EXPECT_NE(source.substr(begin, end - begin).find("Lengths in mm"), std::string::npos);
}

TEST(LinuxcncModule, RefusesOtherUnits) {
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers";
  const LinuxcncConfiguration c = exported(test::load("delta-brno"));
  const test::Folder folder;
  const auto so = test::compiled(written(folder, c.module));
  ASSERT_FALSE(so.empty());
  EXPECT_EQ(ModuleHost(so.string(), {{"linear_units", "mm"}, {"angular_units", "deg"}}).loaded, 0);
  EXPECT_LT(ModuleHost(so.string(), {{"linear_units", "inch"}}).loaded, 0);
  EXPECT_LT(ModuleHost(so.string(), {{"angular_units", "rad"}}).loaded, 0);
}

// The box of the axes holds what the machine reaches along each axis from home, not what some random poses happened to.
TEST(LinuxcncModule, AxesGoAsFarAsTheMachineFromHome) {
  for (const char* name : {"hexapod-strut", "hexapod-m850", "delta-linear", "tripod-z3", "pentapod", "kuka-kr210"}) {
    SCOPED_TRACE(name);
    const AnyMachine m = test::load(name);
    const auto c = linuxcnc_configuration(m);
    ASSERT_TRUE(c);
    const Task task = kinematics::task(m);
    std::vector<double> home;
    for (const ControllerAxis& a : c->axes) home.push_back(a.turns ? units::from_deg(a.home) : units::from_mm(a.home));
    // Or up to a singular pose, behind which the module has no answer; 1 of arms.
    const auto determinant = [&](const std::vector<double>& at, const kinematics::Solution* s) {
      const Pose X = kinematics::pose_of(task, at);
      return s == nullptr ? 0.0 : kinematics::hold(m, kinematics::settled(m, X, s->joints), s->joints).determinant;
    };
    const double at_home = determinant(home, kinematics::inverse(m, kinematics::pose_of(task, home)).reachable());
    for (int i = 0; i < task.size(); ++i) {
      const ControllerAxis& axis = c->axes[static_cast<std::size_t>(i)];
      for (const double side : {-1.0, 1.0}) {
        // Home itself, in steps of 1 mm and 1 deg.
        std::vector<double> at = home;
        double end = axis.home;
        for (int k = 1; k < 180; ++k) {
          at[static_cast<std::size_t>(i)] += side * (axis.turns ? units::from_deg(1) : units::from_mm(1));
          const auto found = kinematics::inverse(m, kinematics::pose_of(task, at));
          if (determinant(at, found.reachable()) * at_home <= 0) break;
          end += side;
        }
        // The search ends at a thousandth of the range.
        const double slack = 0.01 * (axis.max - axis.min);
        EXPECT_TRUE(side < 0 ? axis.min <= end + slack : axis.max >= end - slack)
            << axis.letter << " " << axis.min << " .. " << axis.max << " and " << end;
      }
    }
  }
}

// Nor does it hold what lies behind singular poses, where the module has no answer.
TEST(LinuxcncModule, AxesEndBeforeSingularPoses) {
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers";
  const LinuxcncConfiguration c = exported(test::load("planar-3rrr"), 1000);
  const test::Folder folder;
  ModuleHost host(test::compiled(written(folder, c.module)).string());
  const ControllerAxis& turn = c.axes.back();
  ASSERT_EQ(turn.letter, 'C');
  // The cranks stand to one side, so the two ends differ; the inverse alone goes as far to both.
  EXPECT_LT(turn.max, 60);
  EXPECT_LT(turn.min, -90);
  for (const double side : {-1.0, 1.0}) {
    const double end = side < 0 ? turn.min : turn.max;
    for (const double by : {-2.0, 2.0}) {  // deg, from the end
      std::vector<double> pose = home_of(c), q = homes(c.joints);
      pose[5] = end + side * by;
      EXPECT_EQ(host.inverse(pose, q), by < 0 ? 0 : -1) << pose[5];
    }
  }
  // Half a turn of these is behind one, or two.
  for (const char* name : {"delta-par4", "tripod-z3", "hexapod-slider", "dynapod"}) {
    for (const ControllerAxis& axis : exported(test::load(name), 1000).axes) {
      if (!axis.turns) continue;
      EXPECT_GT(axis.min, -170) << name << " " << axis.letter;
      EXPECT_LT(axis.max, 170) << name << " " << axis.letter;
    }
  }
}

/// The mirrored assembly of a hexapod has the same strut lengths: forward never ends there.
TEST(LinuxcncModule, KeepsTheAssemblyModeOfHome) {
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers";
  const LinuxcncConfiguration c = exported(test::load("hexapod-strut"));
  const test::Folder folder;
  ModuleHost host(test::compiled(written(folder, c.module)).string());
  const std::vector<double> home = homes(c.joints), at_home = home_of(c);
  std::vector<double> mirrored = at_home;
  mirrored[2] = -mirrored[2];
  std::vector<double> pose = mirrored;
  ASSERT_EQ(host.forward(home, pose), 0);
  EXPECT_LT(farthest(pose, at_home), kRoundTrip);
  // And the inverse refuses the mirrored pose, whose struts would do.
  std::vector<double> q = home;
  EXPECT_EQ(host.inverse(mirrored, q), -1);
}

/// A pose of a tripod behind its singular poses, with joints within their ranges: the inverse refuses it, and the
/// forward does not stay there even if LinuxCNC believes the machine there.
TEST(LinuxcncModule, StaysOnHomesSideOfSingularPoses) {
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers";
  const AnyMachine m = test::load("tripod-z3");
  const auto& legs = std::get<machine::Parallel>(m);
  const LinuxcncConfiguration c = exported(m);
  const test::Folder folder;
  ModuleHost host(test::compiled(written(folder, c.module)).string());
  const std::vector<double> beyond{0, 0, 866.8057, 71.8867, -17.6784, 0};
  const auto found = kinematics::inverse(
      m, kinematics::pose_of(legs.task,
                             {units::from_mm(beyond[2]), units::from_deg(beyond[3]), units::from_deg(beyond[4])}));
  ASSERT_FALSE(found.solutions.empty());
  std::vector<double> q = homes(c.joints), pose = beyond;
  EXPECT_EQ(host.inverse(beyond, q), -1);
  if (host.forward(user(m, found.solutions.front().joints), pose) == 0) {
    EXPECT_GT(farthest(pose, beyond), 1);
  }
}

/// Sliders on their other roots are another working mode: forward says no, since the inverse would jump.
TEST(LinuxcncModule, KeepsTheWorkingModeOfThePins) {
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers";
  const AnyMachine m = test::load("delta-brno");
  const LinuxcncConfiguration c = exported(m);
  const test::Folder folder;
  ModuleHost host(test::compiled(written(folder, c.module)).string());
  const auto X = *kinematics::home_pose(m);
  const kinematics::InverseResult all = kinematics::inverse(m, X);
  ASSERT_EQ(all.solutions.size(), 8U);
  const std::vector<double> home = homes(c.joints);
  for (const kinematics::Solution& s : all.solutions) {
    const std::vector<double> q = user(m, s.joints);
    const bool own = apart(m, q, home) < 1e-6;
    std::vector<double> pose = home_of(c);
    EXPECT_EQ(host.forward(q, pose), own ? 0 : -1);
  }
  // With the pin of arm 1 turned round its other position is the right one.
  host.set("high-0", 1 - host.pin("high-0"));
  std::vector<double> q = home;
  ASSERT_EQ(host.inverse(home_of(c), q), 0);
  EXPECT_GT(std::abs(q[0] - home[0]), 1);
  EXPECT_LT(std::abs(q[1] - home[1]), kRoundTrip);
  std::vector<double> pose = home_of(c);
  ASSERT_EQ(host.forward(q, pose), 0);
  EXPECT_LT(farthest(pose, home_of(c)), kRoundTrip);
}

/// Under a force the joints are those of the pose that the force deflects to the commanded one, by Polypod's own
/// compliance of the tip; forward is the inverse of that.
TEST(LinuxcncModule, ShiftsByTheComplianceOfTheTip) {
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers";
  // mm: C is that of the commanded pose to rounding; the inverse and forward of both are at 1e-10.
  constexpr double kShift = 2e-9;
  constexpr double kCompliance = 1e-8;  // um/N: the same, for 1 N
  for (const std::string name : {"lola50", "hexapod-f100i", "hexapod-slider", "pentapod", "tricept", "tripod-z3",
                                 "delta-par4", "planar-3rrr", "tricept-wrist", "scissors"}) {
    SCOPED_TRACE(name);
    std::vector<machine::Override> sets;
    if (name == "hexapod-slider") sets.push_back({"leg.compliance_um_per_N", "0.02"});
    const AnyMachine m = test::load(name, sets);
    if (!statics::has_compliance(m)) {
      ADD_FAILURE() << "no compliances";
      continue;
    }
    const LinuxcncConfiguration c = exported(m);
    ASSERT_FALSE(c.module.compliances.empty());
    const test::Folder folder;
    ModuleHost host(test::compiled(written(folder, c.module)).string());
    const Task task = kinematics::task(m);
    const Vec3 force(300, -200, 450);
    const auto push = [&host](const Vec3& f) {
      for (int k = 0; k < 3; ++k) host.set(fmt::format("force-{}", "xyz"[k]), f[k]);
      host.run("force", 1000000);
    };
    host.set("force-rate", 1e12);
    int compared = 0;
    for (const calibration::Stand& stand : calibration::random_stands(m, 20, 11)) {
      const std::vector<double> asked = world_of(m, stand.X_MT);
      std::vector<double> stiff = homes(c.joints);
      push(Vec3::Zero());
      if (host.inverse(asked, stiff) != 0) continue;
      JointVector q(static_cast<Eigen::Index>(stiff.size()));
      for (int i = 0; i < static_cast<int>(stiff.size()); ++i) {
        const double value = stiff[static_cast<std::size_t>(i)];
        q[i] = turns(m, i) ? units::from_deg(value) : units::from_mm(value);
      }
      const statics::Compliance at = statics::compliance_at_joints(m, q);
      const Vec3 shift = at.displacement(force) * units::kMmPerMetre;
      push(force);
      // The function shows the compliance of the tip where the kinematics had it last.
      for (int row = 0, pin = 0; row < 3; ++row) {
        for (int column = row; column < 3; ++column, ++pin) {
          const std::string pair{"xyz"[row], "xyz"[column]};
          const double expected = units::to_um_per_N(at.displacement(Vec3::Unit(column))[row]);
          EXPECT_NEAR(host.pin("tip-compliance-" + pair), expected, kCompliance) << pair;
        }
      }
      std::vector<double> shifted = stiff;
      if (host.inverse(asked, shifted) != 0) continue;
      std::vector<double> back = asked;
      ASSERT_EQ(host.forward(shifted, back), 0);
      EXPECT_LT(farthest(back, asked), kShift);
      // Without the force these joints are at the shifted pose.
      push(Vec3::Zero());
      std::vector<double> where = asked;
      ASSERT_EQ(host.forward(shifted, where), 0);
      double largest = 0;
      for (int i = 0; i < task.size(); ++i) {
        const auto k = static_cast<std::size_t>(task[i]);
        const double expected = k < 3 ? -shift[static_cast<Eigen::Index>(k)] : 0;
        EXPECT_NEAR(where[k] - asked[k], expected, kShift) << k;
        largest = std::max(largest, std::abs(expected));
      }
      EXPECT_GT(largest, 1e-6);
      ++compared;
    }
    EXPECT_GT(compared, 5);
  }
}

/// A sensor that fails: what the kinematics use stays, fades at the rate, and comes back at it; never a jump, never no
/// number.
TEST(LinuxcncModule, AForceThatIsNoNumberFades) {
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers";
  const LinuxcncConfiguration c = exported(test::load("lola50"));
  const test::Folder folder;
  ModuleHost host(test::compiled(written(folder, c.module)).string());
  constexpr long kPeriod = 1000000;  // ns
  constexpr double kRounding = 1e-9;
  host.set("force-rate", 1000);  // 1 N a cycle
  host.set("force-hold", 0.02);
  host.set("force-x", 30);
  host.set("force-z", -10.5);
  const auto after = [&](int cycles) {
    for (int i = 0; i < cycles; ++i) host.run("force", kPeriod);
    return Vec3(host.pin("force-used-x"), host.pin("force-used-y"), host.pin("force-used-z"));
  };
  EXPECT_LT((after(7) - Vec3(7, 0, -7)).norm(), kRounding);
  EXPECT_LT((after(40) - Vec3(30, 0, -10.5)).norm(), kRounding);
  EXPECT_EQ(host.pin("force-error"), 0);
  for (const double broken : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    SCOPED_TRACE(broken);
    host.set("force-y", broken);
    EXPECT_LT((after(20) - Vec3(30, 0, -10.5)).norm(), kRounding);  // held
    EXPECT_EQ(host.pin("force-error"), 1);
    EXPECT_LT((after(5) - Vec3(25, 0, -5.5)).norm(), kRounding);
    std::vector<double> q = homes(c.joints);
    EXPECT_EQ(host.inverse(home_of(c), q), 0);
    EXPECT_LT(after(30).norm(), kRounding);
    EXPECT_EQ(host.pin("force-error"), 1);
    host.set("force-y", 0);
    EXPECT_LT((after(3) - Vec3(3, 0, -3)).norm(), kRounding);
    EXPECT_EQ(host.pin("force-error"), 0);
    after(40);
  }
  // A rate that is no rate changes nothing.
  host.set("force-rate", std::nan(""));
  host.set("force-x", 100);
  EXPECT_LT((after(10) - Vec3(30, 0, -10.5)).norm(), kRounding);
}

// ---- against LinuxCNC's genuine modules -----------------------------------------------------------------------------

struct Pair {
  test::Folder folder;
  AnyMachine machine;
  std::unique_ptr<ModuleHost> own, genuine;
  std::vector<calibration::Stand> stands;
  Pair(const AnyMachine& m, const std::string& name, std::size_t count = 60)
      : machine(m), stands(calibration::random_stands(m, count, 3)) {
    const auto home = kinematics::home_pose(m);
    const auto module =
        linuxcnc_module(m, home ? kinematics::inverse(m, *home).solutions.front().joints : stands.front().q);
    if (!module) throw std::runtime_error(to_string(module.error()));
    own = std::make_unique<ModuleHost>(test::compiled(written(folder, *module)).string());
    genuine = std::make_unique<ModuleHost>(name);
  }
  /// Inverse of both at random stands, forward of both from their joints; their largest differences, mm and deg.
  void compare(double most_inverse, double most_forward) {
    std::size_t compared = 0;
    for (const calibration::Stand& stand : stands) {
      const std::vector<double> asked = world_of(machine, stand.X_MT);
      std::vector<double> q = user(machine, stand.q), q_genuine = q;
      if (own->inverse(asked, q) != 0) continue;
      ASSERT_EQ(genuine->inverse(asked, q_genuine), 0);
      EXPECT_LT(apart(machine, q, q_genuine), most_inverse);
      std::vector<double> pose = asked, pose_genuine = asked;
      pose[0] += 0.01;
      pose_genuine[0] += 0.01;
      ASSERT_EQ(own->forward(q, pose), 0);
      if (compared == 0) {  // genhexkins' first call ignores the pose it is given
        std::vector<double> ignored = pose_genuine;
        genuine->forward(q, ignored);
      }
      ASSERT_EQ(genuine->forward(q, pose_genuine), 0);
      EXPECT_LT(farthest(pose, pose_genuine), most_forward);
      ++compared;
    }
    EXPECT_GT(compared, stands.size() / 2);
  }
};

#define POLYPOD_NEEDS_LINUXCNC \
  ASSERT_TRUE(test::has_linuxcnc()) << "scripts/install-packages test brings LinuxCNC and its headers"

TEST(GenuineModules, Genhexkins) {
  POLYPOD_NEEDS_LINUXCNC;
  const AnyMachine m = test::load("hexapod-strut");
  Pair pair(m, "genhexkins");
  const auto settings = settings_for(m, Controller::linuxcnc);
  ASSERT_TRUE(settings);
  for (const Setting& s : settings->settings)
    if (s.section == "HAL") pair.genuine->set(s.key.substr(s.key.find('.') + 1), s.value);
  pair.genuine->set("convergence-criterion", 1e-12);
  pair.compare(1e-9, 1e-9);
}

/// Towers at R on 90, 210 and 330 deg, carriages above the platform.
TEST(GenuineModules, Lineardeltakins) {
  POLYPOD_NEEDS_LINUXCNC;
  std::string text = R"(
family = "parallel"
task = ["x", "y", "z"]
home = { z_mm = 0 }
)";
  constexpr double kR = 131.636, kL = 269.0;
  for (const double deg : {90.0, 210.0, 330.0}) {
    const double a = units::from_deg(deg);
    text += fmt::format(
        "[[leg]]\ndrive = \"rail\"\nbase_mm = [{:.15g}, {:.15g}, 0]\nrail = [0, 0, 1]\nrod_mm = {}\nplatform_mm = [0, "
        "0, 0]\n"
        "min_mm = 100\nmax_mm = 400\n",
        kR * std::cos(a), kR * std::sin(a), kL);
  }
  text += "[[constraint]]\nkind = \"orientation\"\n";
  const auto m = machine::from_text(text, "linear.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  Pair pair(*m, "lineardeltakins");
  pair.genuine->set("R", kR);
  pair.genuine->set("L", kL);
  pair.compare(1e-9, 1e-9);
}

/// Arms that swing down from level, at -90, 30 and 150 deg.
TEST(GenuineModules, Rotarydeltakins) {
  POLYPOD_NEEDS_LINUXCNC;
  std::string text = R"(
family = "parallel"
task = ["x", "y", "z"]
home = { z_mm = -300 }
)";
  constexpr double kPlatform = 150, kThigh = 120, kShin = 320, kFoot = 50;
  for (const double deg : {-90.0, 30.0, 150.0}) {
    const double c = std::cos(units::from_deg(deg)), s = std::sin(units::from_deg(deg));
    text += fmt::format(
        "[[leg]]\ndrive = \"crank\"\nbase_mm = [{:.15g}, {:.15g}, 0]\nzero = [{:.15g}, {:.15g}, 0]\naxis = [{:.15g}, "
        "{:.15g}, 0]\n"
        "arm_mm = {}\nrod_mm = {}\nplatform_mm = [{:.15g}, {:.15g}, 0]\nmin_deg = -30\nmax_deg = 80\n",
        kPlatform * c, kPlatform * s, c, s, -s, c, kThigh, kShin, kFoot * c, kFoot * s);
  }
  text += "[[constraint]]\nkind = \"orientation\"\n";
  const auto m = machine::from_text(text, "rotary.toml");
  ASSERT_TRUE(m) << to_string(m.error());
  Pair pair(*m, "rotarydeltakins");
  pair.genuine->set("platformradius", kPlatform);
  pair.genuine->set("thighlength", kThigh);
  pair.genuine->set("shinlength", kShin);
  pair.genuine->set("footradius", kFoot);
  pair.compare(1e-9, 1e-9);
}

TEST(GenuineModules, Genserkins) {
  POLYPOD_NEEDS_LINUXCNC;
  const AnyMachine m = test::load(test::source("tests/kinematics/data/genserkins.toml"));
  const auto& arm = std::get<machine::SerialArm>(m);
  Pair pair(m, "genserkins");
  for (std::size_t i = 0; i < 6; ++i) {
    ASSERT_EQ(arm.convention, machine::DhConvention::modified);
    pair.genuine->set(fmt::format("A-{}", i), units::to_mm(arm.dh[i].a));
    pair.genuine->set(fmt::format("ALPHA-{}", i), arm.dh[i].alpha);
    pair.genuine->set(fmt::format("D-{}", i), units::to_mm(arm.dh[i].d));
  }
  // genserkins' inverse ends at steps of 1e-6, seeded at the solution it stays there.
  pair.compare(1e-6, 1e-9);
}

TEST(GenuineModules, Pentakins) {
  POLYPOD_NEEDS_LINUXCNC;
  Pair pair(test::load(test::source("tests/kinematics/data/pentakins_defaults.toml")), "pentakins", 24);
  pair.compare(1e-9, 2e-8);  // its forward ends at changes of 1e-9
}

}  // namespace
}  // namespace polypod::control
