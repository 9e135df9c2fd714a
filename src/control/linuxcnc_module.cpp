// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Writes the machine's own part of a module: sizes, pins, and the figures that follow from them. What works with these
// are the files of module/, which are the same for every machine.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "module_name.hpp"
#include "module_text.hpp"
#include "polypod/control/linuxcnc.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::control {
namespace {

using machine::ConstraintKind;
using machine::DhConvention;
using machine::JointKind;
using machine::LegDrive;
using machine::Task;

constexpr std::size_t kLongestName = 46;  // of a pin, HAL_NAME_LEN less the end

std::string number(double value) {
  const std::string text = fmt::format("{:.17g}", value == 0 ? 0.0 : value);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}
std::string mm(double value) {
  return number(units::to_mm(value));
}

/// The coordinates x, y, z, a, b, c of a whole pose as the module counts them, mm and rad.
std::array<double, 6> module_coordinates(const Task& task, const Pose& X) {
  std::array<double, 6> c{units::to_mm(X.p.x()), units::to_mm(X.p.y()), units::to_mm(X.p.z()), 0, 0, 0};
  if (task.names_axis()) {
    const auto ab = angles_ab(X.R.col(2));
    const Mat3 spin = rotation_abc(ab[0], ab[1], 0).transpose() * X.R;
    c[3] = ab[0];
    c[4] = ab[1];
    c[5] = std::atan2(spin(1, 0), spin(0, 0));
  } else {
    const Vec3 abc = angles_abc(X.R);
    for (std::size_t k = 0; k < 3; ++k) c[3 + k] = abc[static_cast<Eigen::Index>(k)];
  }
  return c;
}

template <class Numbers>
std::string list(const Numbers& numbers) {
  std::string out;
  for (const double x : numbers) out += (out.empty() ? "" : ", ") + number(x);
  return out;
}

/// The pins of the parameters: keys with points for brackets, shortened where HAL would cut them.
std::vector<ModulePin> pins_of(const std::string& module, const std::vector<machine::Parameter>& parameters) {
  std::vector<ModulePin> out;
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    std::string name;
    for (const char c : parameters[i].key) {
      if (c == '[') {
        name += '.';
      } else if (c != ']') {
        name += c == '_' ? '-' : c;
      }
    }
    if (const auto at = name.find(".machine."); at != std::string::npos) name.replace(at, 9, ".");
    if (module.size() + 1 + name.size() > kLongestName) name = fmt::format("parameter.{}", i + 1);
    out.push_back({name, units::to_user(parameters[i].value, parameters[i].unit)});
  }
  return out;
}

/// The statements of `figures()`, and the sizes that go with them. `at` counts the parameters.
class Writer {
 public:
  std::string figures;
  int legs = 0, constraints = 0, equations = 0, rows = 0, rows_before = -1, joint = 0, first_leg_joint = 0;
  int leg_joints = 0;
  bool idle_turn = false, legs_name_axis = false;
  std::vector<int> free;
  std::array<double, 6> home{};
  std::size_t at = 0;
  /// What deflects: the joint, row or leg `number`, with its compliance in m/N or rad/Nm.
  struct Element {
    const char* kind;
    int number;
    double compliance;
    bool turns;
  };
  std::vector<Element> elements;

  bool coupled = false;  // joints that turn further rows: the module has none

  void put(const machine::SerialArm& arm) {
    coupled = coupled || arm.is_coupled();
    pending(arm.X_MB);
    for (const machine::DhRow& row : arm.dh) {
      const std::string to = fmt::format("chain_rows[{}]", rows++);
      if (has_pending_) {
        line("{}.fixed = 1;", to);
        line("{}.before = at;", to);
        drop();
      }
      const bool slides = row.kind == JointKind::prismatic;
      const auto held = [&](double value) { return slides ? mm(value) : number(value); };
      if (row.compliance > 0) {
        elements.push_back(
            {row.locked ? "BY_ROW" : "BY_JOINT", row.locked ? rows - 1 : joint, row.compliance, !slides});
      }
      line("{}.joint = {};", to, row.locked ? -1 : joint++);
      line("{}.slides = {};", to, int(slides));
      line("{}.craig = {};", to, int(arm.convention == DhConvention::modified));
      line("{}.sense = {};", to, number(row.sign));
      if (row.locked) line("{}.held = {};", to, held(*row.locked));
      line("{}.a = parameter[{}];", to, at);
      line("{}.ca = cos(parameter[{}] * RAD);", to, at + 1);
      line("{}.sa = sin(parameter[{}] * RAD);", to, at + 1);
      line("{}.d = parameter[{}];", to, at + 2);
      line("{}.theta = parameter[{}] * RAD;", to, at + 3);
      at += 4;
    }
    pending(arm.X_FT);
  }

  void put(const machine::StrutHexapod& m) {
    begin_closed(Task::pose, machine::home_pose(m));
    const std::size_t tool = at + 42;
    for (std::size_t i = 0; i < machine::kLegs; ++i, at += 7) {
      const Vec3 y =
          machine::home_pose(m) * Vec3(m.platform_joint[i] - m.tool_length * Vec3::UnitZ()) - m.base_joint[i];
      const std::string to = leg("STRUT", y.norm());
      deflects("BY_LEG", legs - 1, m.leg_compliance[i]);
      line("{}.length = parameter[{}];", to, at);
      vector(to + ".base", at + 1);
      vector(to + ".end", at + 4);
      line("{}.end[2] -= parameter[{}];", to, tool);
    }
    ++at;
    end_closed();
  }

  void put(const machine::SliderHexapod& m) {
    begin_closed(Task::pose, machine::home_pose(m));
    const std::size_t tool = at + 60;
    for (int i = 0; i < machine::kLegs; ++i, at += 10) {
      deflects("BY_JOINT", joint + leg_joints, m.leg_compliance[static_cast<std::size_t>(i)]);
      const std::string to = leg("RAIL", m.length_of_leg(i));
      line("{}.length = parameter[{}];", to, at);
      vector(to + ".base", at + 1);
      vector(to + ".direction", at + 4);
      vector(to + ".end", at + 7);
      line("{}.end[2] -= parameter[{}];", to, tool);
    }
    ++at;
    end_closed();
  }

  template <class M>
  requires std::is_base_of_v<machine::Delta, M>
  void put(const M& m) {
    constexpr bool kRotary = std::same_as<M, machine::RotaryDelta>;
    begin_closed(Task::point, machine::home_pose(m));
    const std::size_t tool = at + 10 * static_cast<std::size_t>(m.arms);
    for (int i = 0; i < m.arms; ++i, at += 10) {
      deflects("BY_JOINT", joint + leg_joints, m.drive_compliance[static_cast<std::size_t>(i)], kRotary);
      const std::string to = leg(kRotary ? "CRANK" : "RAIL", m.rod_length[static_cast<std::size_t>(i)]);
      deflects("BY_LEG", legs - 1, m.rod_compliance[static_cast<std::size_t>(i)]);
      vector(to + ".base", at);
      if (kRotary) {
        line("{}.zero[2] = -1;", to);
        line("{}.side[0] = cos(parameter[{}] * RAD);", to, at + 3);
        line("{}.side[1] = sin(parameter[{}] * RAD);", to, at + 3);
        line("{}.arm = parameter[{}];", to, at + 4);
        line("{}.offset = parameter[{}] * RAD;", to, at + 5);
        line("{}.middle = {};", to, number(0.5 * (m.range.min + m.range.max)));
      } else {
        vector(to + ".direction", at + 3);
      }
      line("{}.length = parameter[{}];", to, at + 6);
      vector(to + ".end", at + 7);
      less(to + ".end", tool);
    }
    at += 3;
    constraint("ORIENTATION", 3);
    end_closed();
  }

  void put(const machine::Parallel& m) {
    begin_closed(m.task, m.home);
    std::size_t tool = at;
    for (const machine::Parameter& p : machine::parameters(m)) tool += p.key.starts_with("tool.") ? 0 : 1;
    for (const machine::ParallelLeg& l : m.legs) {
      static constexpr const char* kDrives[] = {"STRUT", "RAIL", "CRANK", "ROD"};
      const std::string to = leg(kDrives[static_cast<int>(l.drive)], l.reference);
      deflects("BY_LEG", legs - 1, l.compliance);
      line("{}.length = parameter[{}];", to, at);
      vector(to + ".base", at + 1);
      vector(to + ".end", at + 4);
      less(to + ".end", tool);
      at += 7;
      for (int k = 0; k < 3; ++k)
        if (l.still[k] != 0) line("{}.still[{}] = {};", to, k, mm(l.still[k]));
      if (l.ring) {
        line("{}.ring = 1;", to);
        vector(to + ".direction", at);
        line("{}.radius = parameter[{}];", to, at + 3);
        at += 4;
      }
      if (l.drive == LegDrive::rail) {
        vector(to + ".direction", at);
        at += 3;
      }
      if (l.drive == LegDrive::crank) {
        vector(to + ".direction", at);
        vector(to + ".zero", at + 3);
        line("cross({0}.direction, {0}.zero, {0}.side);", to);
        line("{}.arm = parameter[{}];", to, at + 6);
        line("{}.middle = {};", to, number(0.5 * (l.range.min + l.range.max)));
        at += 7;
      }
      if (l.two_roots()) {
        line("{}.offset = parameter[{}]{};", to, at, l.drive == LegDrive::crank ? " * RAD" : "");
        ++at;
      }
    }
    for (const machine::PlatformConstraint& c : m.constraints) {
      using enum ConstraintKind;
      const std::string to = c.kind == plane            ? constraint("PLANE", 1)
                             : c.kind == platform_plane ? constraint("PLATFORM_PLANE", 1)
                             : c.kind == line_k         ? constraint("LINE", 2)
                             : c.kind == square         ? constraint("SQUARE", 1)
                                                        : constraint("ORIENTATION", 3);
      if (c.has_points()) {
        vector(to + ".at", at);
        less(to + ".at", tool);
        vector(to + ".base", at + 3);
        at += 6;
      }
      if (c.has_base_axis()) {
        vector(to + ".base_axis", at);
        at += 3;
      }
      if (c.has_platform_axis()) {
        vector(to + ".platform_axis", at);
        at += 3;
      }
    }
    at += 3;
    idle_turn = m.idle_turn;
    if (m.idle_turn) ++equations;
    end_closed();
  }

  /// False where a stage has no module.
  bool put(const machine::Stages& m) {
    bool known = true;
    for (std::size_t k = 0; k < m.machines.size(); ++k) {
      if (k > 0) {
        line("turn_and_shift(&at, &parameter[{}]);", at);
        has_pending_ = true;
        at += 6;
      } else {
        pending(m.data[k].mount);
      }
      known = known && std::visit(
                           [&](const auto& stage) {
                             using S = std::decay_t<decltype(stage)>;
                             if constexpr (std::same_as<S, machine::Stages>) {
                               return false;
                             } else if constexpr (requires { put(stage); }) {
                               put(stage);
                               return true;
                             } else {
                               return false;
                             }
                           },
                           m.machines[k]);
    }
    return known;
  }

  /// Statements at the end: what stands behind everything.
  void finish() {
    if (rows > 0) line("behind = at;");
    if (rows_before < 0) rows_before = rows;
  }

 private:
  static constexpr ConstraintKind line_k = ConstraintKind::line;
  bool has_pending_ = false;

  template <class... T>
  void line(fmt::format_string<T...> form, T&&... values) {
    figures += "  ";
    fmt::format_to(std::back_inserter(figures), form, std::forward<T>(values)...);
    figures += "\n";
  }
  void vector(const std::string& to, std::size_t from) {
    for (std::size_t k = 0; k < 3; ++k) line("{}[{}] = parameter[{}];", to, k, from + k);
  }
  void less(const std::string& to, std::size_t from) {
    for (std::size_t k = 0; k < 3; ++k) line("{}[{}] -= parameter[{}];", to, k, from + k);
  }
  void pending(const Pose& X) {
    if (X.R.isIdentity(0) && X.p.isZero(0)) return;
    std::string rotation, place;
    for (int i = 0; i < 3; ++i) {
      rotation +=
          fmt::format("{}{{{}, {}, {}}}", i > 0 ? ", " : "", number(X.R(i, 0)), number(X.R(i, 1)), number(X.R(i, 2)));
      place += (i > 0 ? ", " : "") + mm(X.p[i]);
    }
    line("{{");
    line("  const Pose fixed = {{{{{}}}, {{{}}}}};", rotation, place);
    line("  compose(&at, &fixed, &at);");
    line("}}");
    has_pending_ = true;
  }
  void deflects(const char* kind, int number, double compliance, bool turns = false) {
    if (compliance > 0) elements.push_back({kind, number, compliance, turns});
  }
  void drop() {
    line("identity(&at);");
    has_pending_ = false;
  }
  std::string leg(const char* drive, double reference) {
    const std::string to = fmt::format("legs[{}]", legs++);
    line("{}.drive = {};", to, drive);
    line("{}.reference = {};", to, mm(reference));
    if (std::string_view(drive) != "ROD") line("{}.joint = {};", to, leg_joints++);
    ++equations;
    return to;
  }
  std::string constraint(const char* kind, int count) {
    const std::string to = fmt::format("constraints[{}]", constraints++);
    line("{}.kind = {};", to, kind);
    equations += count;
    return to;
  }
  void begin_closed(const Task& task, const Pose& X) {
    first_leg_joint = joint;
    rows_before = rows;
    legs_name_axis = task.names_axis();
    home = module_coordinates(task, X);
    for (int k = 0; k < 6; ++k)
      if (!task.holds(static_cast<machine::Coordinate>(k))) free.push_back(k);
    if (!chain_follows) return;
    line("front = at;");
    drop();
  }
  void end_closed() { joint += leg_joints; }

 public:
  bool chain_follows = false;  ///< the closed stage stands in a chain
};

/// Whether the drive at t of a leg whose platform joint is seen at y from its base is on its higher root.
bool is_higher_turn(const Vec3& y, const Vec3& zero, const Vec3& side, double t) {
  return std::sin(t - std::atan2(y.dot(side), y.dot(zero))) > 0;
}

std::vector<int> roots_of(const machine::SliderHexapod& m, const Pose& X, const JointVector& q) {
  std::vector<int> out;
  for (std::size_t i = 0; i < machine::kLegs; ++i) {
    const Vec3 y = X * Vec3(m.platform_joint[i] - m.tool_length * Vec3::UnitZ()) - m.rail_outer[i];
    out.push_back(q[static_cast<Eigen::Index>(i)] > y.dot(m.rail_direction[i]) ? 1 : 0);
  }
  return out;
}
template <class M>
requires std::is_base_of_v<machine::Delta, M> std::vector<int> roots_of(const M& m, const Pose& X,
                                                                        const JointVector& q) {
  std::vector<int> out;
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.arms); ++i) {
    const double at = q[static_cast<Eigen::Index>(i)];
    const Vec3 end = X * Vec3(m.platform_joint[i] - m.tool);
    if constexpr (std::same_as<M, machine::RotaryDelta>) {
      out.push_back(is_higher_turn(end - m.base_joint[i], -Vec3::UnitZ(), m.outward[i], at + m.zero[i]) ? 1 : 0);
    } else {
      out.push_back(at > (end - m.rail_start[i]).dot(m.rail_direction[i]) ? 1 : 0);
    }
  }
  return out;
}
std::vector<int> roots_of(const machine::Parallel& m, const Pose& X, const JointVector& q) {
  std::vector<int> out;
  for (int j = 0; j < machine::joint_count(m); ++j) {
    const machine::ParallelLeg& leg = machine::driven_leg(m, j);
    const Vec3 y = machine::leg_end(m, leg, X) - leg.base;
    if (!leg.two_roots()) {
      out.push_back(-1);
    } else if (leg.drive == LegDrive::rail) {
      out.push_back(q[j] + leg.zero_offset > y.dot(leg.rail) ? 1 : 0);
    } else {
      out.push_back(is_higher_turn(y, leg.zero, leg.axis.cross(leg.zero), q[j] + leg.zero_offset) ? 1 : 0);
    }
  }
  return out;
}

}  // namespace

std::vector<int> module_roots(const AnyMachine& machine, const Pose& X, const JointVector& q) {
  return std::visit(
      [&](const auto& m) -> std::vector<int> {
        if constexpr (requires { roots_of(m, X, q); }) {
          return roots_of(m, X, q);
        } else if constexpr (std::same_as<std::decay_t<decltype(m)>, machine::Stages>) {
          std::vector<int> out;
          const auto stages = machine::stage_poses(m, X, q);
          for (std::size_t k = 0; k < stages.size(); ++k) {
            const auto own = module_roots(m.machines[k], stages[k].X, stages[k].q);
            out.insert(out.end(), own.begin(), own.end());
          }
          return out;
        } else {
          return std::vector<int>(static_cast<std::size_t>(kinematics::joint_count(machine)), -1);
        }
      },
      machine);
}

std::string module_name_of(const std::string& machine) {
  constexpr std::size_t kLongest = 20;
  std::string out;
  for (const char c : machine) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
    const bool capital = c >= 'A' && c <= 'Z';
    if (letter) out += c;
    if (capital) out += static_cast<char>(c - 'A' + 'a');
    if (!letter && !capital && !out.empty() && out.back() != '_') out += '_';
  }
  out.resize(std::min(out.size(), kLongest));
  while (!out.empty() && out.back() == '_') out.pop_back();
  if (out.empty() || (out.front() >= '0' && out.front() <= '9'))
    out = "machine" + std::string(out.empty() ? "" : "_") + out;
  return out + "_kins";
}

Result<Module> linuxcnc_module(const AnyMachine& machine, const JointVector& home) {
  const Task task = kinematics::task(machine);
  const int joints = kinematics::joint_count(machine);
  Writer w;
  w.chain_follows = std::holds_alternative<machine::Stages>(machine);
  const bool known = std::visit(
      [&](const auto& m) {
        using M = std::decay_t<decltype(m)>;
        if constexpr (std::same_as<M, machine::Stages>) {
          return w.put(m);
        } else if constexpr (requires { w.put(m); }) {
          w.put(m);
          return true;
        } else {
          return false;
        }
      },
      machine);
  if (!known) {
    return fail("LC101", fmt::format("no kinematics module is written for {}", machine::family_of(machine)), {},
                "serial arms, hexapods, deltas, machines of legs, and stages of these have one");
  }
  if (w.coupled) {
    return fail("LC101", "no kinematics module is written for arms with coupled joints", {},
                "the robot's own controller knows them; `polypod post --to` writes its language");
  }
  w.finish();
  if (w.rows > 0 && joints != task.size()) {
    return fail(
        "LC102",
        fmt::format("the machine has {} joints for {} coordinates; a chain whose posture its pose leaves open has "
                    "no module",
                    joints, task.size()),
        {}, "lock joints, or prescribe as many coordinates as there are joints (task)");
  }
  const kinematics::ForwardResult at_home = kinematics::forward(machine, home);
  if (at_home.poses.empty()) {
    return fail("LC103", "the home joints are no pose of the machine: " + at_home.reason, {},
                "polypod fk shows which joints are one");
  }
  const Pose X = at_home.poses.front();

  Module out;
  out.name = module_name_of(machine::name_of(machine));
  const std::vector<machine::Parameter> parameters = kinematics::parameters(machine);
  out.pins = pins_of(out.name, parameters);

  std::vector<double> home_joints;
  std::string turns, two, high;
  // Which root a drive is on at home: the nearer of its two, by the module's own names of them.
  const std::vector<int> roots = module_roots(machine, X, home);
  for (int i = 0; i < joints; ++i) {
    const bool revolute = kinematics::joint_kind(machine, i) == JointKind::revolute;
    home_joints.push_back(revolute ? home[i] : units::to_mm(home[i]));
    const std::string comma = i > 0 ? ", " : "";
    turns += comma + (revolute ? "1" : "0");
    two += comma + (roots[static_cast<std::size_t>(i)] >= 0 ? "1" : "0");
    high += comma + (roots[static_cast<std::size_t>(i)] == 1 ? "1" : "0");
  }
  std::string coordinates;
  for (int i = 0; i < task.size(); ++i)
    coordinates += fmt::format("{}{}", i > 0 ? ", " : "", static_cast<int>(task[i]));
  const bool all_angles =
      task.holds(machine::Coordinate::a) && task.holds(machine::Coordinate::b) && task.holds(machine::Coordinate::c);
  double scale = 100;  // mm a radian, for chains
  for (std::size_t i = 0; i < parameters.size(); ++i)
    if (parameters[i].unit == "mm") scale = std::max(scale, std::abs(out.pins[i].value));

  if (w.legs > 0 && w.equations != 6) w.elements.clear();  // loads share out by stiffnesses that are not modelled here
  std::string kinds, numbers, compliances;
  for (std::size_t i = 0; i < w.elements.size(); ++i) {
    const Writer::Element& e = w.elements[i];
    const std::string comma = i > 0 ? ", " : "";
    const double value = e.turns ? e.compliance : units::to_um_per_N(e.compliance);
    kinds += comma + e.kind;
    numbers += fmt::format("{}{}", comma, e.number);
    compliances += comma + number(value);
    out.compliances.push_back({fmt::format("compliance.{}", i + 1), value});
  }

  std::string name = one_line(machine::name_of(machine));
  // It stands in a comment, which it must not end.
  for (std::size_t at = 0; (at = name.find("*/", at)) != std::string::npos; at += 3) name.insert(at + 1, 1, ' ');
  std::string& s = out.source;
  s = fmt::format(
      "// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause\n"
      "/* LinuxCNC kinematics of {}, family {}: made by `polypod export linuxcnc`.\n"
      " * Build it with `halcompile --install {}.c`. Lengths in mm, angles in deg. */\n\n",
      name, machine::family_of(machine), out.name);
  const auto flag = [](bool on) { return on ? 1 : 0; };
  s += fmt::format("#define MODULE_NAME \"{}\"\n", out.name);
  s += fmt::format("#define JOINTS {}\n#define COORDINATES {}\n#define PARAMETERS {}\n", joints, task.size(),
                   parameters.size());
  s += fmt::format("#define NAMES_AXIS {}\n#define ALL_ANGLES {}\n#define ANY_ANGLE {}\n", flag(task.names_axis()),
                   flag(all_angles), flag(task.turns()));
  s += fmt::format("#define LEGS {}\n#define LEG_JOINTS {}\n#define FIRST_LEG_JOINT {}\n#define CONSTRAINTS {}\n",
                   w.legs, w.leg_joints, w.first_leg_joint, w.constraints);
  s += fmt::format("#define EQUATIONS {}\n#define LEG_FREE {}\n#define IDLE_TURN {}\n#define LEGS_NAME_AXIS {}\n",
                   w.equations, w.free.size(), flag(w.idle_turn), flag(w.legs_name_axis));
  s += fmt::format("#define ELEMENTS {}\n", w.elements.size());
  s += fmt::format("#define ROWS {}\n#define ROWS_BEFORE {}\n#define SCALE {}\n\n", w.rows, w.rows_before,
                   number(scale));
  const auto part = [&](std::string_view text) {
    s += text.substr(text.find('\n') + 1);  // the copyright stands at the top
    s += "\n";
  };
  part(text_of_head_c);
  s += "/* ---- the machine "
       "------------------------------------------------------------------------------------------------ */"
       "\n\n";
  s += fmt::format(
      "/* Of x, y, z, a, b, c those that a pose prescribes. */\nstatic const int kCoordinate[COORDINATES] = "
      "{{{}}};\n",
      coordinates);
  s += fmt::format("static const int kTurns[JOINTS] = {{{}}};\n", turns);
  s += fmt::format("static const int kTwoRoots[JOINTS] = {{{}}};\nstatic const int kHigh[JOINTS] = {{{}}};\n", two,
                   high);
  s +=
      fmt::format("/* mm and rad */\nstatic const double kWorldHome[6] = {{{}}};\n", list(module_coordinates(task, X)));
  if (w.rows > 0) s += fmt::format("static const double kHomeJoints[JOINTS] = {{{}}};\n", list(home_joints));
  if (w.legs > 0) {
    s += fmt::format("static const double kHome[6] = {{{}}}; /* of the stage with closed loops */\n", list(w.home));
    s += fmt::format("static const int kFree[ARRAY_SIZE_OR_ONE(LEG_FREE)] = {{{}}};\n",
                     w.free.empty() ? "0" : fmt::format("{}", fmt::join(w.free, ", ")));
  }
  s += "static const char *const kName[PARAMETERS] = {\n";
  for (const ModulePin& pin : out.pins) s += fmt::format("    \"{}\",\n", pin.name);
  s += "};\nstatic const double kDefault[PARAMETERS] = {\n";
  for (const ModulePin& pin : out.pins) s += fmt::format("    {},\n", number(pin.value));
  s += "};\n";
  if (!w.elements.empty()) {
    s += fmt::format(
        "/* What deflects: a joint, a locked row, a leg; um/N along a line, rad/Nm about an axis. */\n"
        "enum {{ BY_JOINT, BY_ROW, BY_LEG }};\n"
        "static const int kElement[ELEMENTS] = {{{}}}, kNumber[ELEMENTS] = {{{}}};\n"
        "static const double kCompliance[ELEMENTS] = {{{}}};\n",
        kinds, numbers, compliances);
  }
  s += R"(
static struct {
  hal_float_t *parameter[PARAMETERS], *compliance[ARRAY_SIZE_OR_ONE(ELEMENTS)];
  hal_float_t *force[3], *force_used[3], *force_rate, *force_hold, *tip_compliance[6];
  hal_bit_t *high[JOINTS], *armed, *error, *force_error;
  hal_s32_t *iterations, *inverse_failures, *forward_failures;
} *hal;
static int component, iterations_last;
/* The pins as they were when figures() ran. */
static double parameter[PARAMETERS];
static int high[JOINTS];
)";
  if (w.legs > 0) {
    s += "static int is_high(int leg_joint) {\n  return high[FIRST_LEG_JOINT + leg_joint];\n}\n"
         "static int is_armed(void) {\n  return *hal->armed;\n}\n";
    part(text_of_legs_c);
  }
  if (w.rows > 0) part(text_of_chain_c);
  if (w.figures.find("turn_and_shift") != std::string::npos) {
    s += R"(static void turn_and_shift(Pose *at, const double *figures) {
  const double c[6] = {figures[0],       figures[1],       figures[2],
                       figures[3] * RAD, figures[4] * RAD, figures[5] * RAD};
  Pose mount;
  pose_of(0, c, &mount);
  compose(at, &mount, at);
}

)";
  }
  s += "/* What follows from the pins. */\nstatic void figures(void) {\n";
  if (w.rows > 0) s += "  Pose at;\n  identity(&at);\n";
  s += w.figures + "}\n";
  part(text_of_tail_c);
  return out;
}

}  // namespace polypod::control
