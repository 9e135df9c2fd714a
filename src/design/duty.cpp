// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/duty.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "polypod/core/toml.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/motion/machine_motion.hpp"
#include "polypod/motion/tables.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::design {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr std::size_t kMostPoses = 100'000;

Result<Vec3> vector_of(const config::Table& t, const char* key) {
  POLYPOD_ASSIGN(n, t.numbers(key, 3, {-1e9, 1e9}));
  return Vec3(n[0], n[1], n[2]);
}

Result<std::vector<Pose>> poses_of(const config::Table& t, const AnyMachine& machine) {
  const machine::Task task = kinematics::task(machine);
  POLYPOD_ASSIGN(rows, t.points("poses", static_cast<std::size_t>(task.size())));
  if (rows.empty() || rows.size() > kMostPoses) {
    return fail("OP140", fmt::format("poses holds {} poses", rows.size()), t.place_of("poses"),
                fmt::format("give 1 to {}, each with the coordinates of --pose; without `poses` the points of the "
                            "workspace count",
                            kMostPoses));
  }
  std::vector<Pose> out;
  for (std::vector<double>& row : rows) {
    for (int i = 0; i < task.size(); ++i) {
      double& x = row[static_cast<std::size_t>(i)];
      const bool length = static_cast<int>(task[i]) < 3;
      constexpr double kFarthest_mm = 1e7;  // 10 km: beyond it lies a wrong unit
      if (length && std::abs(x) > kFarthest_mm) {
        return fail("OP140", fmt::format("poses: {:g} mm is farther than any machine reaches", x), t.place_of("poses"),
                    "give mm, and deg for angles");
      }
      x = length ? units::from_mm(x) : units::from_deg(x);
    }
    out.push_back(kinematics::pose_of(task, row));
  }
  return out;
}

/// A limit in the unit of its key; 0: none.
Status read_limit(const config::Table& t, const std::string& key, double unit, double& limit) {
  POLYPOD_ASSIGN(value, t.optional_number(key, limit / unit, config::kNotNegative));
  limit = value == 0 ? kInf : value * unit;
  return {};
}

Status read_limits(const config::Table& t, Duty& out) {
  const double mm = units::from_mm(1), deg = units::from_deg(1);
  for (const auto& [whose, unit_name, unit, peaks] :
       {std::tuple{"tool", "mm", mm, &out.tool}, std::tuple{"drive", "mm", mm, &out.sliding},
        std::tuple{"drive", "deg", deg, &out.turning}}) {
    POLYPOD_TRY(read_limit(t, fmt::format("{}_speed_{}_per_s", whose, unit_name), unit, peaks->speed));
    POLYPOD_TRY(read_limit(t, fmt::format("{}_acceleration_{}_per_s2", whose, unit_name), unit, peaks->acceleration));
    POLYPOD_TRY(read_limit(t, fmt::format("{}_jerk_{}_per_s3", whose, unit_name), unit, peaks->jerk));
  }
  return {};
}

Result<motion::PosePath> read_move(const config::Table& t, Duty& out) {
  POLYPOD_TRY(read_limits(t, out));
  POLYPOD_ASSIGN(blend, t.optional_number("blend_mm", 0, config::kNotNegative));
  POLYPOD_ASSIGN(read, motion::pose_path_from(t));
  if (read.timed) {
    return fail("OP140", "[move] has times, and a study takes the least", t.place(),
                "leave time_s out, but for waits; the cycle time is a figure that can be held or wanted");
  }
  const bool jerk = std::min({out.tool.jerk, out.sliding.jerk, out.turning.jerk}) < kInf;
  read.path = motion::with_speed(std::move(read.path), read.speed);
  if (blend > 0) read.path = motion::blended(read.path, units::from_mm(blend), jerk);
  return read.path;
}

Result<motion::Cycle> read_pick(const config::Table& t, Duty& out) {
  POLYPOD_TRY(read_limits(t, out));
  motion::Cycle cycle;
  POLYPOD_ASSIGN(from, vector_of(t, "from_mm"));
  POLYPOD_ASSIGN(to, vector_of(t, "to_mm"));
  POLYPOD_ASSIGN(lift, t.optional_number("clearance_height_mm", units::to_mm(cycle.lift), config::kPositive));
  POLYPOD_ASSIGN(rounding, t.optional_number("corner_blend_mm", units::to_mm(cycle.rounding), {0, lift}));
  POLYPOD_TRY(t.finish());
  if (from == to) {
    return fail("OP140", "[pick] begins and ends at one place", t.place(), "give from_mm and to_mm");
  }
  cycle.from = units::from_mm(1) * from;
  cycle.to = units::from_mm(1) * to;
  cycle.lift = units::from_mm(lift);
  cycle.rounding = units::from_mm(rounding);
  return cycle;
}

bool is_moving(const machine::OutlinePart& part, std::string_view name) {
  // "legs", and "legs at home"
  return part.role == machine::OutlinePart::Role::moving && part.name.starts_with(name) && part.points.size() > 1;
}
bool is_leg(const machine::OutlinePart& part) {
  return is_moving(part, "legs") || is_moving(part, "rods");
}

/// The longest way along the members of a leg: an arm stands before its rods in an outline.
double longest_leg(const machine::Outline& outline) {
  double out = 0, arm = 0;
  for (const machine::OutlinePart& part : outline) {
    if (!is_leg(part) && !is_moving(part, "arms")) continue;
    const double length = (part.points.back() - part.points.front()).norm();
    if (is_leg(part)) out = std::max(out, arm + length);
    if (is_moving(part, "arms")) arm = length;
    if (is_moving(part, "legs")) arm = 0;
  }
  return out;
}

motion::PlanLimits plan_limits(const AnyMachine& machine, const Duty& duty) {
  motion::PlanLimits out;
  out.tool_speed = duty.tool.speed;
  out.tool_acceleration = duty.tool.acceleration;
  out.tool_jerk = duty.tool.jerk;
  const int n = kinematics::joint_count(machine);
  out.drive_speed.resize(n);
  out.drive_acceleration.resize(n);
  out.drive_jerk.resize(n);
  for (int i = 0; i < n; ++i) {
    const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
    const motion::Peaks& of = turns ? duty.turning : duty.sliding;
    out.drive_speed[i] = of.speed;
    out.drive_acceleration[i] = of.acceleration;
    out.drive_jerk[i] = of.jerk;
  }
  return out;
}

}  // namespace

std::string canonical(const config::Table& table) {
  std::string out = "{";
  for (const std::string& key : table.keys()) {
    out += key + "=";
    if (const auto number = table.number(key)) {
      out += fmt::format("{}", *number);
    } else if (table.holds_text(key)) {
      out += quoted_toml(*table.text(key));
    } else if (const auto yes = table.optional_boolean(key, false)) {
      out += *yes ? "true" : "false";
    } else if (const auto numbers = table.numbers(key)) {
      out += fmt::format("[{}]", fmt::join(*numbers, ","));
    } else if (const auto texts = table.optional_texts(key)) {
      for (const std::string& text : *texts) out += quoted_toml(text);
    } else if (const auto inner = table.table(key)) {
      out += canonical(*inner);
    } else if (const auto list = table.tables(key)) {
      for (const config::Table& t : *list) out += canonical(t);
    }
    out += ";";
  }
  return out + "}";
}

Result<Duty> read_duty(const config::Table& study, const AnyMachine& machine) {
  Duty out;
  if (study.has("poses")) {
    POLYPOD_ASSIGN(poses, poses_of(study, machine));
    out.poses = std::move(poses);
    for (const Pose& X : out.poses) {
      std::vector<double> c = kinematics::coordinates_of(kinematics::task(machine), X);
      out.identity += fmt::format("pose {}\n", fmt::join(c, " "));
    }
  }
  if (study.has("load_N") || study.has("load_moment_Nm")) {
    Vec6 load = Vec6::Zero();
    for (const auto& [key, at] : {std::pair{"load_N", 0}, std::pair{"load_moment_Nm", 3}}) {
      if (!study.has(key)) continue;
      POLYPOD_ASSIGN(v, vector_of(study, key));
      load.segment<3>(at) = v;
    }
    if (load.isZero()) return fail("OP140", "the load is 0", study.place_of("load_N"), "leave it out, or give a force");
    out.load = load;
    out.identity += fmt::format("load {}\n", fmt::join(load.data(), load.data() + load.size(), " "));
  }
  if (study.has("direction")) {
    POLYPOD_ASSIGN(d, vector_of(study, "direction"));
    if (!(d.norm() > 0)) return fail("OP140", "direction has no length", study.place_of("direction"));
    out.direction = d.normalized();
    out.identity += fmt::format("direction {} {} {}\n", (*out.direction)[0], (*out.direction)[1], (*out.direction)[2]);
  }
  POLYPOD_ASSIGN(masses, study.optional_table("dynamics"));
  if (masses) {
    const std::string why_not = motion::no_dynamics(machine);
    if (!why_not.empty()) return fail("OP107", "[dynamics]: " + why_not, masses->place(), "leave the table out");
    out.identity += "dynamics " + canonical(*masses) + "\n";
    POLYPOD_ASSIGN(read, motion::dynamics_from(*masses, machine));
    out.masses = std::move(read);
  }
  POLYPOD_ASSIGN(move, study.optional_table("move"));
  POLYPOD_ASSIGN(pick, study.optional_table("pick"));
  if (move && pick) {
    return fail("OP140", "[move] and [pick] at once: which motion?", pick->place(), "give one of them");
  }
  if (move) {
    POLYPOD_ASSIGN(path, read_move(*move, out));
    out.path = std::move(path);
    out.identity += "move " + canonical(*move) + "\n";
  }
  if (pick) {
    POLYPOD_ASSIGN(cycle, read_pick(*pick, out));
    out.pick = cycle;
    out.identity += "pick " + canonical(*pick) + "\n";
  }
  return out;
}

Result<AtPose> at_pose(const AnyMachine& machine, const Duty& duty, const AtPoseWanted& wanted, const Pose& X_MT) {
  const statics::Compliance c = statics::compliance_at(machine, X_MT);
  if (!c.reachable) return fail("OP142", c.reason);
  const Pose X = kinematics::settled(machine, X_MT, c.joints);
  AtPose out;
  if (wanted.frequency) {
    const std::vector<double> f = motion::natural_frequencies(machine, *duty.masses, X, c.joints);
    out.frequency = f.empty() ? kInf : f.front();
  }
  if (wanted.force) {
    const machine::JacobianMatrix J = kinematics::jacobian(machine, X, c.joints);
    JointVector tau = JointVector::Zero(c.joints.size());
    if (duty.load) tau -= J.transpose() * *duty.load;
    if (duty.masses) {
      motion::JointSeries rest;
      rest.q = c.joints;
      rest.first = rest.second = rest.third = JointVector::Zero(c.joints.size());
      rest.X = X.cast<Series>();
      rest.regular = true;
      tau += motion::drive_forces(machine, *duty.masses, rest);
    }
    for (int i = 0; i < tau.size(); ++i) {
      const bool turns = kinematics::joint_kind(machine, i) == machine::JointKind::revolute;
      double& most = turns ? out.torque : out.force;
      most = std::max(most, std::isfinite(tau[i]) ? std::abs(tau[i]) : kInf);
    }
  }
  if (wanted.stiffness) {
    const Mat3 C = c.linear();
    const double soft = duty.direction
                            ? duty.direction->dot(C * *duty.direction)
                            : Eigen::SelfAdjointEigenSolver<Mat3>(C, Eigen::EigenvaluesOnly).eigenvalues().maxCoeff();
    out.stiffness = soft > 0 ? 1 / soft : kInf;
  }
  if (wanted.deflection) out.deflection = (c.C.topRows<3>() * *duty.load).norm();
  if (wanted.leg) out.leg = longest_leg(kinematics::outline_at(machine, X, c.joints));
  return out;
}

std::string no_frequency(const AnyMachine& machine, const Duty& duty) {
  if (!statics::has_compliance(machine)) return "it needs compliances, and the machine has none";
  if (const std::string why = motion::no_dynamics(machine); !why.empty()) return why;
  return duty.masses ? "" : "it needs masses: give the table [dynamics] in the study";
}

std::string no_drive_force(const AnyMachine& machine, const Duty& duty, machine::JointKind kind) {
  if (!duty.load && !duty.masses) return "it needs load_N (or [dynamics], for the weight alone)";
  bool any = false;
  for (int i = 0; i < kinematics::joint_count(machine); ++i) any = any || kinematics::joint_kind(machine, i) == kind;
  if (!any) {
    return kind == machine::JointKind::revolute ? "no drive turns: take drive_force_N"
                                                : "no drive slides: take drive_torque_Nm";
  }
  // In one chain the drives carry the load whatever their number; beside each other they share it as they are driven.
  const bool shared =
      !kinematics::is_serial(machine) && kinematics::joint_count(machine) != kinematics::task(machine).size();
  return shared ? motion::no_dynamics(machine) : "";
}

std::string no_leg(const AnyMachine& machine) {
  const machine::Outline outline = kinematics::outline(machine, kinematics::middle_of_work(machine));
  return std::any_of(outline.begin(), outline.end(), is_leg) ? "" : "the machine has no legs";
}

std::string no_cycle_time(const AnyMachine& machine, const Duty& duty) {
  if (!duty.path && !duty.pick) return "it needs a motion: give the table [move], or [pick] of a delta";
  return duty.pick && !motion::has_cycles(machine) ? "[pick] serves deltas: give the path of the tool in [move]" : "";
}

Result<CycleTime> cycle_time(const AnyMachine& machine, const Duty& duty) {
  CycleTime out;
  if (duty.pick) {
    const bool turns = kinematics::joint_kind(machine, 0) == machine::JointKind::revolute;
    const auto plan = motion::plan(machine, *duty.pick, {duty.tool, turns ? duty.turning : duty.sliding});
    if (plan) {
      out.seconds = plan->time;
      return out;
    }
    if (plan.error().id != "MO106") return tl::unexpected(plan.error());
    out.broken = plan.error().message;
    out.passed = 0;
    return out;
  }
  motion::MoveOptions options;
  options.law = motion::Law::fastest;
  options.limits = plan_limits(machine, duty);
  constexpr int kSamples = 200;
  options.samples = kSamples;
  const auto moved = motion::move(machine, *duty.path, options);
  if (!moved) {
    if (moved.error().id != "MO116") return tl::unexpected(moved.error());
    out.broken = moved.error().message;
    out.passed = 0;
    return out;
  }
  out.seconds = moved->time;
  if (moved->ok()) return out;
  out.broken = moved->violations.front().detail;
  out.passed = moved->length > 0 ? std::clamp(moved->violations.front().length / moved->length, 0.0, 1.0) : 0;
  return out;
}

}  // namespace polypod::design
