// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/control/linuxcnc.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "module_name.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/control/force_loop.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/free_joints.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/kinematics/joint_speed.hpp"

namespace polypod::control {
namespace {

using calibration::Stand;
using machine::JointKind;
using machine::Task;

constexpr double kServoPeriod = 0.001;  // s

double user(bool turns, double si) {
  return turns ? units::to_deg(si) : units::to_mm(si);
}
/// What LinuxCNC reads back to the same double.
std::string exact(double value) {
  return fmt::format("{}", value == 0 ? 0.0 : value);
}

/// How far the joints stay from their limits, as a share of their ranges; 0.25 is enough.
double room(const AnyMachine& machine, const JointVector& q) {
  double out = 0.25;
  for (int i = 0; i < static_cast<int>(q.size()); ++i) {
    const machine::JointRange range = kinematics::joint_range(machine, i);
    out = std::min(out, std::min(q[i] - range.min, range.max - q[i]) / (range.max - range.min));
  }
  return out;
}

/// Home of an arm: of poses with the tool at zero tilt, at the places of random stands, that with the most room to the
/// limits of its joints and to singular poses. Where the vertical tool leaves a joint free, as of a head with C and A,
/// the tool tilts by 10 deg, for the module could not leave that pose; where none is within the limits, the best stand.
std::optional<JointVector> home_of_arm(const AnyMachine& machine, const std::vector<Stand>& stands) {
  struct Best {
    double value = 0;
    std::optional<JointVector> q;
    void take(double other, const JointVector& joints) {
      if (!(other > value)) return;
      value = other;
      q = joints;
    }
  };
  Best level, tilted, stand;
  const auto worth = [&](const Pose& X, const JointVector& q) {
    const double condition = kinematics::dexterity(machine, X, q).condition;
    return room(machine, q) / (std::isfinite(condition) ? condition : 1e12);
  };
  const auto look = [&](const Vec3& p, double tilt, Best& best) {
    const Pose X{rotation_abc(tilt, 0, 0), p};
    for (const kinematics::Solution& s : kinematics::inverse(machine, X).solutions) {
      if (s.violations != 0 || !kinematics::free_joints(machine, X, s.joints).empty()) continue;
      best.take(worth(kinematics::settled(machine, X, s.joints), s.joints), s.joints);
    }
  };
  constexpr std::size_t kTried = 300;
  constexpr double kTilt = units::from_deg(10);
  for (std::size_t i = 0; i < std::min(kTried, stands.size()); ++i) {
    stand.take(worth(stands[i].X_MT, stands[i].q), stands[i].q);
    look(stands[i].X_MT.p, 0, level);
    if (!level.q) look(stands[i].X_MT.p, kTilt, tilted);
  }
  return level.q ? level.q : tilted.q ? tilted.q : stand.q;
}

std::optional<JointVector> home_of(const AnyMachine& machine, const std::vector<Stand>& stands) {
  if (const auto X = kinematics::home_pose(machine)) {
    const kinematics::InverseResult found = kinematics::inverse(machine, *X);
    if (const kinematics::Solution* s = found.reachable()) return s->joints;
  }
  return home_of_arm(machine, stands);
}

/// Home's side of singular poses of type 2 (JEL 6.3), beyond which the module has no answer.
class HomesSide {
 public:
  HomesSide(const AnyMachine& machine, const Pose& home, const JointVector& q)
      : machine_(machine),
        task_(kinematics::task(machine)),
        hold_(machine),
        at_home_(kinematics::is_serial(machine) ? 0 : hold_.at(home, q).determinant) {}
  /// At a pose that is settled with the joints q.
  [[nodiscard]] bool holds(const Pose& X, const JointVector& q) const {
    return at_home_ == 0 || hold_.at(X, q).determinant * at_home_ > 0;
  }
  [[nodiscard]] bool reaches(const std::vector<double>& c) const {
    const Pose X = kinematics::pose_of(task_, c);
    const kinematics::InverseResult found = kinematics::inverse(machine_, X);
    const kinematics::Solution* s = found.reachable();
    return s != nullptr && holds(kinematics::settled(machine_, X, s->joints), s->joints);
  }
  /// No pose that is looked at on the straight line of the coordinates lies beyond; what is out of reach is passed
  /// over. Two singular poses in a row, whose signs cancel, show so.
  [[nodiscard]] bool leads(const std::vector<double>& from, const std::vector<double>& to, int parts) const {
    for (int part = 1; at_home_ != 0 && part < parts; ++part) {
      std::vector<double> c = from;
      for (std::size_t k = 0; k < c.size(); ++k) c[k] += (to[k] - from[k]) * part / parts;
      const Pose X = kinematics::pose_of(task_, c);
      const kinematics::InverseResult found = kinematics::inverse(machine_, X);
      if (found.solutions.empty()) continue;
      const JointVector& q = found.solutions.front().joints;
      if (!holds(kinematics::settled(machine_, X, q), q)) return false;
    }
    return true;
  }

 private:
  const AnyMachine& machine_;
  Task task_;
  kinematics::HoldAnywhere hold_;
  double at_home_;  ///< of the determinant; 0 where it tells nothing
};

/// The largest `sign` c[i] of a pose within all limits, on home's side of singular poses, that steps from c find:
/// outwards alone, or with one of the other coordinates, by ever smaller shares of `range`.
double farthest(const AnyMachine& machine, const HomesSide& side, std::vector<double> c, int i, double sign,
                const std::vector<double>& range) {
  constexpr double kFirst = 0.1, kLast = 1e-3;
  constexpr int kMostSteps = 200, kParts = 3;
  const Task task = kinematics::task(machine);
  const auto reaches = [&](const std::vector<double>& at) {
    for (int k = 0; k < task.size(); ++k)  // beyond half a turn the same poses come again
      if (task.is_angle(k) && std::abs(at[static_cast<std::size_t>(k)]) > std::numbers::pi) return false;
    return side.reaches(at) && side.leads(c, at, kParts);
  };
  const auto axis = static_cast<std::size_t>(i);
  double share = kFirst;
  for (int step = 0; share > kLast && step < kMostSteps; ++step) {
    std::vector<double> next = c;
    next[axis] += sign * share * range[axis];
    bool found = reaches(next);
    for (std::size_t k = 0; !found && k < c.size(); ++k) {
      for (const double way : {-1.0, 1.0}) {
        if (found || k == axis) continue;
        next[k] = c[k] + way * share * range[k];
        found = reaches(next);
        if (!found) next[k] = c[k];
      }
    }
    if (found) {
      c = next;
    } else {
      share /= 2;
    }
  }
  return c[axis];
}

/// Poses of the machine within its limits, as LinuxCNC reaches them: those that joints give from home.
std::vector<ControllerAxis> axes_of(const AnyMachine& machine, const std::vector<Stand>& stands,
                                    const JointVector& home, const std::vector<ControllerAxis>& joints,
                                    const LinuxcncOptions& options) {
  const Task task = kinematics::task(machine);
  const Pose home_pose = kinematics::settled(machine, kinematics::forward(machine, home).poses.front(), home);
  const std::vector<double> at_home = kinematics::coordinates_of(task, home_pose);
  const HomesSide side(machine, home_pose, home);
  constexpr double kRounding = 5e-10;  // mm and deg: where an inverse that is a search ends
  const int n = task.size();
  std::vector<ControllerAxis> out(static_cast<std::size_t>(n));
  for (int i = 0; i < n; ++i) {
    ControllerAxis& axis = out[static_cast<std::size_t>(i)];
    axis.letter = "XYZABC"[static_cast<int>(task[i])];
    axis.turns = task.is_angle(i);
    axis.home = user(axis.turns, at_home[static_cast<std::size_t>(i)]);
    if (std::abs(axis.home) < kRounding) axis.home = 0;
  }
  constexpr int kParts = 8;
  std::vector<double> linear, angular;  // speeds at which no drive is faster than it may be
  std::vector<double> low_end = at_home, high_end = at_home;
  std::vector<std::vector<double>> lowest(static_cast<std::size_t>(n), at_home), highest = lowest;
  for (const Stand& stand : stands) {
    const std::vector<double> c = kinematics::coordinates_of(task, stand.X_MT);
    if (!side.holds(stand.X_MT, stand.q)) continue;
    bool extreme = false;
    for (std::size_t k = 0; k < c.size(); ++k) extreme = extreme || c[k] < low_end[k] || c[k] > high_end[k];
    if (extreme && side.leads(at_home, c, kParts)) {
      for (std::size_t k = 0; k < c.size(); ++k) {
        if (c[k] < low_end[k]) {
          low_end[k] = c[k];
          lowest[k] = c;
        }
        if (c[k] > high_end[k]) {
          high_end[k] = c[k];
          highest[k] = c;
        }
      }
    }
    const Eigen::MatrixXd J =
        kinematics::task_jacobian(task, kinematics::jacobian(machine, stand.X_MT, stand.q), stand.X_MT);
    const Eigen::MatrixXd inverse = J.completeOrthogonalDecomposition().pseudoInverse();
    if (!inverse.allFinite()) continue;
    double slow_linear = 1e9, slow_angular = 1e9;
    for (Eigen::Index j = 0; j < inverse.rows(); ++j) {
      const bool turns = joints[static_cast<std::size_t>(j)].turns;
      const double most = std::min(turns ? options.turn_speed : options.slide_speed,
                                   kinematics::speed_limit(machine, static_cast<int>(j)));
      double by_linear = 0, by_angular = 0;
      for (int i = 0; i < n; ++i) (task.is_angle(i) ? by_angular : by_linear) += inverse(j, i) * inverse(j, i);
      slow_linear = std::min(slow_linear, most / std::max(std::sqrt(by_linear), 1e-9));
      slow_angular = std::min(slow_angular, most / std::max(std::sqrt(by_angular), 1e-9));
    }
    linear.push_back(slow_linear);
    angular.push_back(slow_angular);
  }
  std::vector<double> range(static_cast<std::size_t>(n));
  for (std::size_t k = 0; k < range.size(); ++k) range[k] = high_end[k] - low_end[k];
  for (int i = 0; i < n; ++i) {
    ControllerAxis& axis = out[static_cast<std::size_t>(i)];
    const auto k = static_cast<std::size_t>(i);
    const auto end = [&](const std::vector<double>& seen, double sign) {
      return sign * std::max(sign * farthest(machine, side, seen, i, sign, range),
                             sign * farthest(machine, side, at_home, i, sign, range));
    };
    axis.min = user(axis.turns, end(lowest[k], -1));
    axis.max = user(axis.turns, end(highest[k], 1));
  }
  constexpr double kShare = 0.25;  // of the stands, those nearest to singular poses, that may need slower drives
  const auto low = [&](std::vector<double>& values, double most) {
    if (values.empty()) return most;
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(kShare * static_cast<double>(values.size()));
    std::nth_element(values.begin(), at, values.end());
    return std::min(task.turns() ? 0.5 * *at : *at, most);  // half for the place and half for the turn
  };
  const double v = low(linear, 1.0), w = low(angular, 3.0);
  for (ControllerAxis& axis : out) {
    const double speed = user(axis.turns, axis.turns ? w : v);
    axis.speed = std::max(std::floor(speed * 10) / 10, 0.1);
    axis.acceleration = axis.speed / options.time_to_speed;
    axis.min = std::floor(axis.min * 100) / 100;
    axis.max = std::ceil(axis.max * 100) / 100;
  }
  return out;
}

std::vector<ControllerAxis> joints_of(const AnyMachine& machine, const JointVector& home,
                                      const LinuxcncOptions& options) {
  std::vector<ControllerAxis> out;
  for (int i = 0; i < static_cast<int>(home.size()); ++i) {
    const bool turns = kinematics::joint_kind(machine, i) == JointKind::revolute;
    const machine::JointRange range = kinematics::joint_range(machine, i);
    const double speed =
        user(turns, std::min(turns ? options.turn_speed : options.slide_speed, kinematics::speed_limit(machine, i)));
    out.push_back({'J', turns, user(turns, range.min), user(turns, range.max), speed, speed / options.time_to_speed,
                   user(turns, home[i])});
  }
  return out;
}

std::string ini_text(const LinuxcncConfiguration& c, const std::string& name) {
  std::string letters, home[6] = {"0", "0", "0", "0", "0", "0"};
  double v = 0, a = 0, w = 0, aw = 0;
  for (const ControllerAxis& axis : c.axes) {
    letters += fmt::format("{}{}", letters.empty() ? "" : " ", axis.letter);
    home[std::string_view("XYZABC").find(axis.letter)] = exact(axis.home);
    (axis.turns ? w : v) = axis.speed;
    (axis.turns ? aw : a) = axis.acceleration;
  }
  std::string out =
      fmt::format(R"([EMC]
VERSION = 1.1
MACHINE = {0}

[DISPLAY]
DISPLAY = axis
GEOMETRY = XYZ
POSITION_OFFSET = RELATIVE
POSITION_FEEDBACK = ACTUAL
MAX_FEED_OVERRIDE = 1.2
PROGRAM_PREFIX = .

[RS274NGC]
PARAMETER_FILE = {0}.var

[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 4.0
SERVO_PERIOD = 1000000

[TASK]
TASK = milltask
CYCLE_TIME = 0.001

[HAL]
HALFILE = {0}.hal

[EMCIO]
EMCIO = io
CYCLE_TIME = 0.1
TOOL_TABLE = {0}.tbl

# The module refuses other units.
[KINS]
KINEMATICS = {1}
JOINTS = {2}

# HOME: where the joints' homes put the tool.
[TRAJ]
COORDINATES = {3}
LINEAR_UNITS = mm
ANGULAR_UNITS = deg
HOME = {4} {5} {6} {7} {8} {9}
)",
                  name, c.module.name, c.joints.size(), letters, home[0], home[1], home[2], home[3], home[4], home[5]);
  const auto speeds = [&](const char* kind, double speed, double acceleration) {
    if (speed == 0) return;
    out += fmt::format("DEFAULT_{0}_VELOCITY = {1}\nMAX_{0}_VELOCITY = {2}\nMAX_{0}_ACCELERATION = {3}\n", kind,
                       exact(0.25 * speed), exact(speed), exact(acceleration));
  };
  speeds("LINEAR", v, a);
  speeds("ANGULAR", w, aw);
  out += fmt::format(
      R"(
# Ranges of the coordinates as a search from {} random poses within all limits found them, and speeds at which three in
# four of these need no drive faster than its MAX_VELOCITY: LinuxCNC looks at those of the joints only when they are jogged.
)",
      c.stands);
  for (const ControllerAxis& axis : c.axes) {
    out += fmt::format("[AXIS_{}]\nMIN_LIMIT = {}\nMAX_LIMIT = {}\nMAX_VELOCITY = {}\nMAX_ACCELERATION = {}\n\n",
                       axis.letter, exact(axis.min), exact(axis.max), exact(axis.speed), exact(axis.acceleration));
  }
  for (std::size_t i = 0; i < c.joints.size(); ++i) {
    const ControllerAxis& joint = c.joints[i];
    // The simulated drives are one cycle behind.
    const double error = std::max(1.0, 5 * kServoPeriod * joint.speed);
    out += fmt::format(
        "[JOINT_{}]\nTYPE = {}\nMIN_LIMIT = {}\nMAX_LIMIT = {}\nMAX_VELOCITY = {}\nMAX_ACCELERATION = {}\nFERROR = {}\n"
        "MIN_FERROR = {}\nHOME = {}\nHOME_OFFSET = {}\nHOME_SEQUENCE = 0\n\n",
        i, joint.turns ? "ANGULAR" : "LINEAR", exact(joint.min), exact(joint.max), exact(joint.speed),
        exact(joint.acceleration), exact(error), exact(0.5 * error), exact(joint.home), exact(joint.home));
  }
  return out;
}

/// What HAL calls a component of halcompile.
std::string hal_name(std::string component) {
  std::replace(component.begin(), component.end(), '_', '-');
  return component;
}

/// The components of the on-line correction, before the kinematics.
std::string force_functions(const std::string& name) {
  return fmt::format(R"(loadrt {0}_force
loadrt {0}_cut
addf {1}-cut.cut servo-thread
addf {1}-cut.expected servo-thread
addf {1}-force servo-thread
)",
                     name, hal_name(name));
}

std::string force_wires(const std::string& name, const std::string& module, const ForceLoop& loop) {
  const OnlineOptions& o = loop.options;
  const bool online = loop.method == OnlineMethod::online || loop.method == OnlineMethod::both;
  const bool corrected = loop.method == OnlineMethod::both;
  const std::string force = hal_name(name) + "-force", cut = hal_name(name) + "-cut";
  std::string out = fmt::format(R"(
# On-line correction (method: {}). The component {} limits the shift, and the module follows at once.
setp {}.force-rate 1e9
)",
                                name_of(loop.method), force, module);
  const auto line = [&]<class... T>(fmt::format_string<T...> form, T&&... values) {
    out += fmt::format(form, std::forward<T>(values)...) + "\n";
  };
  const auto set = [&](const std::string& component, const char* pin, double value) {
    line("setp {}.{} {}", component, pin, exact(value));
  };
  set(force, "on", online ? 1 : 0);
  set(force, "weight", o.sensor.weight_removed);
  set(force, "cutoff", o.limits.cutoff);
  set(force, "shift-limit", units::to_um(o.limits.size));
  set(force, "shift-rate", units::to_um(o.limits.rate));
  set(force, "hold", o.limits.hold);
  for (const char* axis : {"x", "y", "z"}) {
    line("net online-force-{0} {1}.force-{0} => {2}.force-{0} {3}.force-{0}", axis, force, module, cut);
    line("net online-sensor-{0} {1}.sensor-{0} => {2}.sensor-{0}", axis, cut, force);
    line("net online-expected-{0} {1}.expected-{0} => {2}.expected-{0}", axis, cut, force);
    line("net online-command-{0} axis.{0}.pos-cmd => {1}.command-{0}", axis, cut);
  }
  for (const char* pair : {"xx", "xy", "xz", "yy", "yz", "zz"})
    line("net online-compliance-{0} {1}.tip-compliance-{0} => {2}.compliance-{0} {3}.compliance-{0}", pair, module,
         force, cut);
  line("net online-heartbeat {}.heartbeat => {}.heartbeat", cut, force);
  line("net module-error {}.force-error => {}.module-error", module, force);
  line("net force-error {}.error => motion.feed-hold", force);
  line(
      "\n# The force that the corrected program is made for, late by the sensor and by what the tip is behind the "
      "planner,");
  line("# cycles: 2 of LinuxCNC's interpolators, and those of real drives more.");
  set(cut, "corrected", corrected ? 1 : 0);
  set(cut, "delay", std::round(o.sensor.delay / o.period));
  set(cut, "lag", std::round(kLinuxcncDelay / o.period));
  line(
      "\n# A machine that deflects under the cut, and its sensor. On a real one take out `addf {}.cut` above and what "
      "follows,",
      cut);
  line("# and link sensor and heartbeat of {} to what reads the sensor. M62 P0 makes the played sensor fail, M62 P1",
       force);
  line("# makes it stop, M63 takes that back.");
  set(cut, "noise", o.sensor.noise);
  set(cut, "weight", o.sensor.weight);
  set(cut, "force-factor", o.real_force);
  set(cut, "compliance-factor", o.real_compliance);
  set(cut, "seed", static_cast<double>(o.seed));
  line("net online-fault motion.digital-out-00 => {}.no-number", cut);
  line("net online-stop motion.digital-out-01 => {}.stopped", cut);
  return out;
}

std::string hal_text(const LinuxcncConfiguration& c, const std::string& name, const ForceLoop* loop) {
  std::string out =
      fmt::format(R"(# The kinematics module checks the units that the INI file counts in.
loadrt [KINS]KINEMATICS linear_units=[TRAJ]LINEAR_UNITS angular_units=[TRAJ]ANGULAR_UNITS
loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS
loadrt estop_latch
{1}{0}addf motion-command-handler servo-thread
addf motion-controller servo-thread
addf estop-latch.0 servo-thread

# The machine's figures, mm and deg. After a calibration export anew: homes and limits follow from them.
)",
                  c.module.compliances.empty() ? "" : fmt::format("addf {}.force servo-thread\n", c.module.name),
                  loop != nullptr ? force_functions(name) : "");
  for (const ModulePin& pin : c.module.pins)
    out += fmt::format("setp {}.{} {:.17g}\n", c.module.name, pin.name, pin.value);
  if (!c.module.compliances.empty()) {
    out += "\n# Compliances of what deflects: um/N along a line, rad/Nm about an axis.\n";
    for (const ModulePin& pin : c.module.compliances)
      out += fmt::format("setp {}.{} {:.17g}\n", c.module.name, pin.name, pin.value);
    out += fmt::format(R"(
# The force on the tool tip in the machine frame, N: link a sensor or a table to {0}.force-x and so on. The tip deflects by
# C F, and the joints are commanded so that it is where the program has it. force-rate, N/s, is how fast the force may change.
# A force that is no number stays as it was for force-hold, s, then fades at that rate, and the feed is held until it is one again.
setp {0}.force-rate 50
setp {0}.force-hold 0.1
)",
                       c.module.name);
    out += loop != nullptr ? force_wires(name, c.module.name, *loop)
                           : fmt::format("net force-error {}.force-error => motion.feed-hold\n", c.module.name);
  }
  out += fmt::format(R"(
# A forward or inverse that fails opens the e-stop; switching on again closes it. A machine that is off may stand anyhow.
net motion-enabled motion.motion-enabled => {0}.armed{1}
net estop-out iocontrol.0.user-enable-out => estop-latch.0.ok-in
net estop-reset iocontrol.0.user-request-enable => estop-latch.0.reset
net kinematics-error {0}.kinematics-error => estop-latch.0.fault-in
net estop-ok estop-latch.0.ok-out => iocontrol.0.emc-enable-in

# Tool changes by hand, without asking; a spindle that turns at once.
net tool-prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared
net tool-change iocontrol.0.tool-change => iocontrol.0.tool-changed
net spindle-on spindle.0.on => spindle.0.at-speed

# Simulated drives: they are at once where they are commanded to be.
)",
                     c.module.name, loop != nullptr ? " " + hal_name(name) + "-force.machine-is-on" : "");
  for (std::size_t i = 0; i < c.joints.size(); ++i)
    out += fmt::format("net drive-{0} joint.{0}.motor-pos-cmd => joint.{0}.motor-pos-fb\n", i);
  return out;
}

/// A short way from home and back, relative, well within the coordinates' ranges.
std::string example_text(const LinuxcncConfiguration& c) {
  std::string there, back, aside, aside_back;
  double least = 1e9, least_angle = 1e9;
  const auto way = [](const ControllerAxis& a) { return std::min(a.home - a.min, a.max - a.home); };
  for (const ControllerAxis& a : c.axes)
    (a.turns ? least_angle : least) = std::min(a.turns ? least_angle : least, way(a));
  bool first = true;
  for (const ControllerAxis& a : c.axes) {
    const double size = a.turns ? std::min(0.1 * least_angle, 5.0) : std::min(0.15 * least, 50.0);
    const double step = std::floor(size * 1000) / 1000;
    if (step == 0) continue;
    std::string& to = first ? there : aside;
    std::string& from = first ? back : aside_back;
    to += fmt::format(" {}{:.3f}", a.letter, step);
    from += fmt::format(" {}{:.3f}", a.letter, -step);
    first = false;
  }
  const double feed = std::floor(60 * 0.3 * c.axes.front().speed);
  std::string out =
      fmt::format("(A short path from home and back, for a first run.)\nG21 G17 G40 G49 G80 G54 G94\nG61\nG91\nF{}\n",
                  std::max(feed, 1.0));
  for (const std::string& words : {there, aside, back, aside_back})
    if (!words.empty()) out += "G1" + words + "\n";
  return out + "G90\nM2\n";
}

}  // namespace

Result<LinuxcncConfiguration> linuxcnc_configuration(const AnyMachine& machine, const LinuxcncOptions& options) {
  LinuxcncConfiguration out;
  const std::vector<Stand> stands = calibration::random_stands(machine, options.stands, 1);
  out.stands = stands.size();
  std::optional<JointVector> home = options.home;
  if (!home) home = home_of(machine, stands);
  if (!home || stands.empty()) {
    return fail("LC104", "no pose within all limits was found to take as home", {},
                "polypod workspace shows what the machine reaches; --home gives the joints");
  }
  if (kinematics::is_serial(machine) &&
      kinematics::joint_count(machine) == kinematics::coordinate_count(kinematics::task(machine))) {
    const Pose X = kinematics::forward(machine, *home).poses.front();
    if (const std::vector<int> free = kinematics::free_joints(machine, X, *home); !free.empty()) {
      return fail(
          "LC105",
          fmt::format("at the home joints {}: the module could not leave that pose", kinematics::in_words_free(free)),
          {}, "give --home joints with the tool tilted, or the wrist off its straight position");
    }
    const Pose level{Mat3::Identity(), X.p};
    const kinematics::InverseResult at_level = kinematics::inverse(machine, level);
    const bool open = std::any_of(at_level.solutions.begin(), at_level.solutions.end(), [&](const auto& s) {
      return !s.singular && !kinematics::free_joints(machine, level, s.joints).empty();
    });
    if (open) {
      out.notes.emplace_back(
          "At zero tilt a rotary joint is free, and the module has no answer: blocks that end there are refused. "
          "Programs of three axes need the joints themselves (trivkins).");
    }
  }
  POLYPOD_ASSIGN(module, linuxcnc_module(machine, *home));
  out.module = std::move(module);
  out.joints = joints_of(machine, *home, options);
  out.axes = axes_of(machine, stands, *home, out.joints, options);
  const std::string name = out.module.name.substr(0, out.module.name.size() - std::string_view("_kins").size());
  if (options.force != nullptr) {
    const auto has = [&](char letter) {
      return std::any_of(out.axes.begin(), out.axes.end(), [&](const ControllerAxis& a) { return a.letter == letter; });
    };
    if (out.module.compliances.empty() || !has('X') || !has('Y') || !has('Z')) {
      return fail("LC132", "on-line correction needs a machine with compliances whose poses have x, y and z", {},
                  "polypod compliance shows whether it has some");
    }
  }
  out.files = {{name + ".ini", ini_text(out, name)},
               {name + ".hal", hal_text(out, name, options.force)},
               {name + ".tbl", "T1 P1 Z0.0 D6.0 ;the tool tip of the machine file\n"},
               {out.module.name + ".c", out.module.source},
               {"machine.toml", machine::to_toml(machine)},
               {"example.ngc", example_text(out)}};
  if (options.force != nullptr) {
    out.files.push_back({name + "_force.comp", force_component(name)});
    out.files.push_back({name + "_cut.comp", cut_component(name, *options.force)});
    out.files.push_back({"corrected.ngc", options.force->corrected});
  }
  out.notes.push_back(fmt::format(
      "The axes' ranges are the extremes that a search from {} random poses within all limits found: a pose "
      "inside them may still be out of reach, and LinuxCNC then refuses the move, as it does one beyond them.",
      out.stands));
  out.notes.emplace_back(
      "The module keeps the joints' ranges to LinuxCNC and checks neither collisions nor the cones of joints: polypod "
      "check judges a program.");
  return out;
}

}  // namespace polypod::control
