// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/job.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>

#include "polypod/core/config.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/ball_stock.hpp"
#include "polypod/gcode/writer.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "polypod/kinematics/posture.hpp"
#include "polypod/machine/urdf.hpp"
#include "polypod/statics/compliance.hpp"
#include "polypod/statics/judge.hpp"

namespace polypod::machining {
namespace {

/// A table under `key`, or the file that `key` names.
Result<config::Table> table_or_file(const config::Table& table, const std::string& key, const std::string& job_path) {
  if (table.holds_text(key)) {
    POLYPOD_ASSIGN(file, table.text(key));
    return config::read_file(config::beside(job_path, file));
  }
  return table.table(key);
}

Status read_measured_key(const config::Table& table, Job& job) {
  POLYPOD_ASSIGN(files, table.optional_texts("measured_compliance"));
  for (std::string& file : files) file = config::beside(job.path, file);
  if (files.empty()) return {};
  POLYPOD_ASSIGN(measured, read_measured(files, table.place_of("measured_compliance"), &job.machine));
  job.measured = std::move(measured);
  return {};
}

Status read_workpiece(const config::Table& table, Job& job) {
  POLYPOD_ASSIGN(workpiece, table.table("workpiece"));
  POLYPOD_ASSIGN(origin, workpiece.numbers("origin_mm", 3));
  POLYPOD_ASSIGN(turn, workpiece.optional_number("rotation_deg", 0, {-360, 360}));
  job.X_MW.p = units::from_mm(1) * Vec3(origin[0], origin[1], origin[2]);
  job.X_MW.R = rotation_z(units::from_deg(turn));
  POLYPOD_ASSIGN(offsets, workpiece.optional_table("work_offsets_mm"));
  if (offsets) {
    for (int i = 0; i < 6; ++i) {
      const std::string key = fmt::format("G{}", 54 + i);
      if (!offsets->has(key)) continue;
      POLYPOD_ASSIGN(p, offsets->numbers(key, 3));
      job.work_offsets[static_cast<std::size_t>(i)] = units::from_mm(1) * Vec3(p[0], p[1], p[2]);
      job.offset_given[static_cast<std::size_t>(i)] = true;
    }
    POLYPOD_TRY(offsets->finish());
  }
  return workpiece.finish();
}

constexpr double kLeastTolerance = 1e-3;  // um, far below what any cell of the stock tells

Status read_tools(const config::Table& table, Job& job) {
  POLYPOD_ASSIGN(cutter_table, table_or_file(table, "cutter", job.path));
  POLYPOD_ASSIGN(cutter, cutting::cutter_from(cutter_table));
  job.cutter = std::move(cutter);
  POLYPOD_ASSIGN(tools, table.tables("tool"));
  for (const config::Table& tool : tools) {
    POLYPOD_ASSIGN(number, tool.integer("number", 0, 100000));
    POLYPOD_ASSIGN(its_table, table_or_file(tool, "cutter", job.path));
    POLYPOD_ASSIGN(its_cutter, cutting::cutter_from(its_table));
    if (!job.cutters.emplace(number, std::move(its_cutter)).second) {
      return fail("MC101", fmt::format("tool number {} stands twice", number), tool.place_of("number"));
    }
    POLYPOD_TRY(tool.finish());
  }
  return {};
}

/// Tolerance, cutters, material and stock.
Status read_cut(const config::Table& table, Job& job) {
  POLYPOD_ASSIGN(tolerance, table.number("tolerance_um", {kLeastTolerance, 1e5}));
  job.tolerance = units::from_um(tolerance);
  POLYPOD_TRY(read_tools(table, job));
  POLYPOD_ASSIGN(material_table, table_or_file(table, "material", job.path));
  POLYPOD_ASSIGN(material, cutting::material_from(material_table));
  job.material = std::move(material);
  const cutting::Cutter* smallest = &job.cutter;
  for (const auto& [number, cutter] : job.cutters)
    if (cutter.diameter < smallest->diameter) smallest = &cutter;
  POLYPOD_ASSIGN(stock_table, table.table("stock"));
  POLYPOD_ASSIGN(stock, cutting::stock_from(stock_table, *smallest));
  job.stock = std::move(stock);
  return {};
}

/// [controller.m_codes]: what M codes do that LinuxCNC does not have or that switch its kinematics.
Status read_m_codes(const config::Table& controller, Job& job) {
  POLYPOD_ASSIGN(codes, controller.optional_table("m_codes"));
  if (!codes) return {};
  for (const std::string& key : codes->keys()) {
    const std::optional<int> number = gcode::m_code_named(key);
    if (!number) {
      return fail("MC101", fmt::format("\"{}\" is no M code that a controller's builder can add", key),
                  codes->place_of(key),
                  "write M and an integer up to 999 that is not one of LinuxCNC's own, as in M10 = \"nothing\"");
    }
    POLYPOD_ASSIGN(does, codes->text(key));
    static const std::map<std::string_view, gcode::MCode> kMeanings = {
        {"nothing", gcode::MCode::nothing}, {"tip", gcode::MCode::tip}, {"joints", gcode::MCode::joints}};
    const auto meaning = kMeanings.find(does);
    if (meaning == kMeanings.end()) {
      return fail("MC101", fmt::format("{} = \"{}\" says nothing known", key, does), codes->place_of(key),
                  "\"nothing\": it moves nothing; \"tip\", \"joints\": what the coordinates are from there on");
    }
    job.controller.m_codes[*number] = meaning->second;
  }
  return codes->finish();
}

/// [controller]: the planner's limits, the shortest block, and the M codes.
Status read_controller(const config::Table& table, Job& job) {
  POLYPOD_ASSIGN(controller, table.optional_table("controller"));
  if (!controller) return {};
  PlannerLimits& planner = job.controller.planner;
  POLYPOD_ASSIGN(velocity, controller->optional_number("max_velocity_mm_per_s", 200, {0.1, 1e5}));
  POLYPOD_ASSIGN(acceleration, controller->optional_number("max_acceleration_mm_per_s2", 1000, {1, 1e6}));
  POLYPOD_ASSIGN(feed_override, controller->optional_number("feed_override", 1, {0.1, 10}));
  POLYPOD_ASSIGN(servo, controller->optional_number("servo_period_ms", 1, {0.01, 100}));
  POLYPOD_ASSIGN(length, controller->optional_number("shortest_block_mm", 0, {0, 100}));
  POLYPOD_ASSIGN(time, controller->optional_number("shortest_block_ms", 0, {0, 1e4}));
  planner.velocity = units::from_mm(velocity);
  planner.acceleration = units::from_mm(acceleration);
  planner.feed_override = feed_override;
  planner.servo_period = units::from_ms(servo);
  job.controller.shortest_length = units::from_mm(length);
  job.controller.shortest_time = units::from_ms(time);
  POLYPOD_TRY(read_m_codes(*controller, job));
  return controller->finish();
}

/// [factors]: what a test cut told.
Status read_factors(const config::Table& table, Job& job) {
  constexpr config::Range kFactor{0.01, 100};
  POLYPOD_ASSIGN(factors, table.optional_table("factors"));
  if (!factors) return {};
  POLYPOD_ASSIGN(force, factors->optional_number("force", 1, kFactor));
  POLYPOD_ASSIGN(uncertainty, factors->optional_number("force_uncertainty", 0, {0, 100}));
  POLYPOD_ASSIGN(compliance, factors->optional_number("compliance", 1, kFactor));
  POLYPOD_TRY(factors->finish());
  job.factors = {force, compliance, uncertainty};
  job.material = scaled_forces(std::move(job.material), force);
  if (uncertainty > 0) {
    constexpr double kHalf95 = 1.96;  // half of a 95 % interval in standard deviations
    const double half_95 = kHalf95 * uncertainty / force;
    const cutting::Material& m = job.material;
    job.material.spread.push_back(
        {half_95 * m.ktc, half_95 * m.krc, half_95 * m.kac, half_95 * m.kte, half_95 * m.kre, half_95 * m.kae});
  }
  if (compliance == 1) return {};
  if (job.measured) {
    return fail("MC413", "a factor of the machine's compliances, and a measured compliance in their place",
                factors->place_of("compliance"), "leave out one of both");
  }
  std::vector<double> compliances = statics::column_compliances(job.machine);
  for (double& c : compliances) c *= compliance;
  POLYPOD_ASSIGN(machine, statics::with_compliances(job.machine, compliances));
  job.machine = std::move(machine);
  return {};
}

/// One number a joint that moves, in deg or mm (a second).
Result<std::vector<double>> by_joint(const config::Table& table, const std::string& key,
                                     const machine::AnyMachine& machine, bool positive) {
  std::vector<double> out;
  if (!table.has(key)) return out;
  POLYPOD_ASSIGN(values, table.numbers(key, static_cast<std::size_t>(kinematics::joint_count(machine))));
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (positive && !(values[i] > 0)) {
      return fail("MC401", fmt::format("{}: {:g} is no limit", key, values[i]), table.place_of(key),
                  "give a number above 0 for each joint that moves");
    }
    const bool turns = kinematics::joint_kind(machine, static_cast<int>(i)) == machine::JointKind::revolute;
    out.push_back(turns ? units::from_deg(values[i]) : units::from_mm(values[i]));
  }
  return out;
}

constexpr config::Range kRobotError{0, 1e5};  // deg or mm, Nm or N

/// [robot_errors]: for `compare`.
Status read_robot_errors(const config::Table& table, Job& job) {
  POLYPOD_ASSIGN(errors, table.optional_table("robot_errors"));
  if (!errors) return {};
  for (const char* key : {"backlash", "friction_Nm"}) {
    if (!errors->has(key)) continue;
    POLYPOD_TRY(errors->numbers(key, static_cast<std::size_t>(kinematics::joint_count(job.machine)), kRobotError));
  }
  POLYPOD_ASSIGN(backlash, by_joint(*errors, "backlash", job.machine, false));
  job.robot_errors.backlash = std::move(backlash);
  if (errors->has("friction_Nm")) {
    POLYPOD_ASSIGN(friction, errors->numbers("friction_Nm"));
    job.robot_errors.friction = std::move(friction);
  }
  POLYPOD_ASSIGN(name, errors->optional_text("signature", ""));
  POLYPOD_TRY(errors->finish());
  if (name.empty() && !job.robot_errors.any()) {
    return fail("MC401", "[robot_errors] says nothing", errors->place(),
                "give backlash, friction_Nm or signature, or leave the table out");
  }
  if (name.empty()) return {};
  POLYPOD_ASSIGN(signature, machine::load(config::beside(job.path, name)));
  if (kinematics::joint_count(signature) != kinematics::joint_count(job.machine)) {
    return fail("MC415",
                fmt::format("{} has {} joints that move, and the machine of the job {}", name,
                            kinematics::joint_count(signature), kinematics::joint_count(job.machine)),
                errors->place_of("signature"), "give what `polypod calibrate -o` writes of the machine of the job");
  }
  job.robot_errors.signature_name = name;
  job.robot_errors.signature = std::make_shared<const machine::AnyMachine>(std::move(signature));
  return {};
}

}  // namespace

Result<std::shared_ptr<const MeasuredCompliance>> read_measured(const std::vector<std::string>& files,
                                                                const Place& place,
                                                                const machine::AnyMachine* machine) {
  if (files.empty()) return nullptr;
  // What has no line of its own, a file that is not there, is wrong where it is asked for.
  const auto placed = [&](Error error) {
    if (error.place.line == 0 && !place.file.empty()) {
      if (!error.place.file.empty()) error.message = error.place.file + ": " + error.message;
      error.place = place;
    }
    return tl::unexpected<Error>(std::move(error));
  };
  auto read = statics::read_displacements(files);
  if (!read) return placed(std::move(read.error()));
  const std::vector<statics::MeasuredPoint>& points = read->points;
  statics::Judgement judgement;
  if (machine != nullptr) judgement = statics::judge(*machine, points);
  if (!judgement.errors.empty()) return placed(std::move(judgement.errors.front()));
  auto map = statics::MeasuredMap::of(points);
  if (!map) return placed(std::move(map.error()));
  const double off = angle_between(map->axis(), Vec3::UnitZ());
  if (off > statics::MeasuredMap::kOneDirection) {
    return fail("MC102",
                fmt::format("the tool axis of the measured displacements is {:.1f} deg off that of the job, z of M",
                            units::to_deg(off)),
                place.file.empty() ? points.front().place : place,
                "the measured compliance holds for one direction of the tool: measure with the tool axis along z of M");
  }
  return std::make_shared<const MeasuredCompliance>(MeasuredCompliance{
      files, std::move(*map), std::move(judgement.doubts), std::move(read->unused_columns),
      static_cast<std::size_t>(
          std::count_if(points.begin(), points.end(), [](const auto& p) { return !statics::tells_all_entries(p); }))});
}

cutting::Material scaled_forces(cutting::Material material, double factor) {
  for (double* k : {&material.ktc, &material.krc, &material.kac, &material.kte, &material.kre, &material.kae})
    *k *= factor;
  for (auto& variation : material.spread)
    for (double& k : variation) k *= factor;
  if (material.end) {
    cutting::EndCoefficients& end = *material.end;
    for (double* k : {&end.ktc, &end.krc, &end.kac, &end.kte, &end.kre, &end.kae}) *k *= factor;
  }
  return material;
}

double rotation_of(const Pose& X_MW) {
  return std::atan2(X_MW.R(1, 0), X_MW.R(0, 0));
}

std::string cutter_in_words(const cutting::Cutter& c) {
  const char* kind = cutting::is_ball(c) ? "ball" : c.corner_radius > 0 ? "bull nose" : "cutter";
  const std::string corner = c.corner_radius > 0 && !cutting::is_ball(c)
                                 ? fmt::format(", corner radius {:g} mm,", units::to_mm(c.corner_radius))
                                 : "";
  return fmt::format("{} {:g} mm{} with {} teeth", kind, units::to_mm(c.diameter), corner, c.teeth);
}

std::string material_in_words(const cutting::Material& m) {
  const auto six = [](const auto& k) {
    const auto mm2 = [](double x) { return gcode::number(units::to_N_per_mm2(x), 2); };
    const auto mm = [](double x) { return gcode::number(units::to_N_per_mm(x), 3); };
    return fmt::format("Ktc {} Krc {} Kac {} N/mm2, Kte {} Kre {} Kae {} N/mm", mm2(k.ktc), mm2(k.krc), mm2(k.kac),
                       mm(k.kte), mm(k.kre), mm(k.kae));
  };
  std::string out = six(m);
  if (m.exponent != 1) out += fmt::format(", exponent {:g}", m.exponent);
  if (m.end) out += ", of the end " + six(*m.end);
  return out;
}

std::string stock_in_words(const cutting::Stock& stock) {
  const auto corner = [](const Vec3& p) {
    const auto mm = [](double x) { return gcode::number(units::to_mm(x), 3); };
    return fmt::format("X{} Y{} Z{}", mm(p.x()), mm(p.y()), mm(p.z()));
  };
  return fmt::format("{} to {} mm, {:.4g} cm3", corner(stock.min()), corner(stock.max()),
                     1e-3 * units::to_mm3(stock.volume()));
}

std::string place_in_words(const Pose& X_MW) {
  constexpr int kDecimals = 4;
  const auto mm = [](double x) { return gcode::number(units::to_mm(x), kDecimals); };
  std::string out = fmt::format("X{} Y{} Z{} mm", mm(X_MW.p.x()), mm(X_MW.p.y()), mm(X_MW.p.z()));
  const std::string turned = gcode::number(units::to_deg(rotation_of(X_MW)), kDecimals);
  if (turned != "0") out += fmt::format(", turned by {} deg about z", turned);
  return out;
}

Status follows_programs(const machine::AnyMachine& machine) {
  if (kinematics::task(machine).places()) return {};
  return fail("MC309",
              fmt::format("{} does not hold x, y, z in its task: it cannot follow a program on its own",
                          machine::name_of(machine)),
              {}, "take a machine whose task holds x, y and z");
}

Result<Job> read_job(const std::string& path, JobFor purpose) {
  POLYPOD_ASSIGN(table, config::read_file(path));
  Job job;
  job.path = path;
  POLYPOD_ASSIGN(machine_name, table.text("machine"));
  // A file beside the job, else a name of the catalogue.
  const std::string beside = config::beside(path, machine_name);
  std::error_code ec;
  POLYPOD_ASSIGN(machine,
                 machine::load(std::filesystem::exists(machine::file_of_machine(beside), ec) ? beside : machine_name));
  POLYPOD_TRY(follows_programs(machine));
  job.machine = std::move(machine);
  job.machine_name = machine_name;
  POLYPOD_TRY(read_workpiece(table, job));
  constexpr std::array kOfTheCut{"tolerance_um", "cutter", "tool", "material", "stock"};
  job.cuts = purpose == JobFor::cutting ||
             std::any_of(kOfTheCut.begin(), kOfTheCut.end(), [&](const char* key) { return table.has(key); });
  if (job.cuts) POLYPOD_TRY(read_cut(table, job));
  POLYPOD_ASSIGN(step, table.optional_number("step_mm", 0.5, {0.01, 10}));
  job.step = units::from_mm(step);
  POLYPOD_ASSIGN(block_delete, table.optional_boolean("block_delete", false));
  job.block_delete = block_delete;
  POLYPOD_ASSIGN(rapid_volume, table.optional_number("rapid_volume_mm3", 1, {0, 1e9}));
  job.rapid_volume = units::from_mm3(rapid_volume);
  POLYPOD_TRY(read_controller(table, job));
  POLYPOD_ASSIGN(speeds, by_joint(table, "joint_speeds", job.machine, true));
  job.own_speeds = !speeds.empty();
  job.joint_speeds = job.own_speeds ? std::move(speeds) : kinematics::speed_limits(job.machine);
  POLYPOD_ASSIGN(accelerations, by_joint(table, "joint_accelerations", job.machine, true));
  job.joint_accelerations = std::move(accelerations);
  POLYPOD_ASSIGN(start, by_joint(table, "start_joints", job.machine, false));
  if (const std::string fault = kinematics::cannot_start(
          job.machine, Eigen::Map<const Eigen::VectorXd>(start.data(), static_cast<Eigen::Index>(start.size())));
      !fault.empty()) {
    return fail("MC401", "start_joints: " + fault, table.place_of("start_joints"),
                "give the joints where the machine stands before the program");
  }
  job.start_joints = std::move(start);
  POLYPOD_ASSIGN(branch, table.optional_text("branch", ""));
  job.posture = std::move(branch);
  job.own_posture = !job.posture.empty();
  if (job.posture.empty() && !job.start_joints.empty()) {
    job.posture = kinematics::posture_of(
        job.machine, machine::JointVector(Eigen::Map<const Eigen::VectorXd>(
                         job.start_joints.data(), static_cast<Eigen::Index>(job.start_joints.size()))));
  }
  POLYPOD_TRY(read_measured_key(table, job));
  POLYPOD_TRY(read_factors(table, job));
  POLYPOD_TRY(read_robot_errors(table, job));
  POLYPOD_TRY(table.finish());
  return job;
}

}  // namespace polypod::machining
