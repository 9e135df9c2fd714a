// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machine files of machines in series: reading, checking, writing.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <sstream>

#include "../../machine/machine_file.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::machine {
namespace {

constexpr std::size_t kMountFigures = 6;  // x, y, z, A, B, C

int joints_of(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return joint_count(m); }, machine);
}
std::vector<Parameter> parameters_of(const AnyMachine& machine) {
  return std::visit([](const auto& m) { return parameters(m); }, machine);
}
const SerialArm* chain_of(const AnyMachine& machine) {
  return std::get_if<SerialArm>(&machine);
}
/// The rows of a chain that move.
std::vector<const DhRow*> moving(const SerialArm& chain) {
  std::vector<const DhRow*> out;
  for (const DhRow& row : chain.dh)
    if (!row.locked) out.push_back(&row);
  return out;
}
const char* unit_of(const DhRow& row) {
  return row.kind == JointKind::revolute ? "deg" : "mm";
}

/// Joints of a chain at home: what the file says, else the middle of each range.
Result<JointVector> read_home(const config::Table& table, const SerialArm& chain) {
  const std::vector<const DhRow*> rows = moving(chain);
  JointVector q(static_cast<Eigen::Index>(rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    q[static_cast<Eigen::Index>(i)] = 0.5 * (rows[i]->range.min + rows[i]->range.max);
  }
  if (!table.has("home")) return q;
  POLYPOD_ASSIGN(given, table.numbers("home", rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const DhRow& row = *rows[i];
    const double value = units::from_user(given[i], unit_of(row));
    q[static_cast<Eigen::Index>(i)] = value;
    if (value >= row.range.min && value <= row.range.max) continue;
    return fail(
        "MA162",
        fmt::format("home of joint {} is {:g} {}, outside of its range {:g} .. {:g}", i + 1, given[i], unit_of(row),
                    units::to_user(row.range.min, unit_of(row)), units::to_user(row.range.max, unit_of(row))),
        table.place_of("home"));
  }
  return q;
}

}  // namespace

Result<Stages> Stages::from(const config::Table& table) {
  Stages m;
  POLYPOD_TRY(read_common(table, m.name, m.description, m.provenance));
  POLYPOD_ASSIGN(task, read_task(table, Task::pose));
  m.task = task;
  POLYPOD_TRY(read_tip_limits(table, m));
  POLYPOD_ASSIGN(stages, table.tables("stage"));
  if (stages.size() < 2) {
    return fail("MA160", fmt::format("a machine of stages needs at least two, and has {}", stages.size()),
                table.place(), "write a [[stage]] with its `machine` for each");
  }
  int joints = 0;
  bool has_closed = false;
  m.closed = stages.size() - 1;
  for (const config::Table& stage : stages) {
    POLYPOD_ASSIGN(part, stage.table("machine"));
    POLYPOD_ASSIGN(family, part.text("family"));
    if (family == kFamily) {
      return fail("MA160", "a stage cannot itself be made of stages", part.place(), "list its stages here instead");
    }
    POLYPOD_ASSIGN(machine, machine_from(part));
    StageData data;
    POLYPOD_ASSIGN(mount, read_frame(stage, "mount"));
    data.mount = mount;
    if (const SerialArm* chain = chain_of(machine)) {
      POLYPOD_ASSIGN(home, read_home(stage, *chain));
      data.home = home;
    } else if (has_closed) {
      return fail("MA160", "two stages have closed loops", part.place(),
                  "at most one stage may be a parallel machine; the others are serial chains (family = \"serial\")");
    } else {
      has_closed = true;
      m.closed = m.machines.size();
    }
    POLYPOD_TRY(stage.finish());
    data.joints = joints_of(machine);
    data.parameters = static_cast<int>(parameters_of(machine).size());
    joints += data.joints;
    m.machines.push_back(std::move(machine));
    m.data.push_back(std::move(data));
  }
  POLYPOD_TRY(table.finish());
  if (joints != m.task.size() || joints > kMaxJoints) {
    return fail("MA161",
                fmt::format("the stages have {} drives and the task prescribes {} coordinates", joints, m.task.size()),
                table.place_of("task"),
                joints > m.task.size() ? "lock joints of a serial stage (`locked`; one of which all would be locked is "
                                         "left out), or add coordinates "
                                         "to the task"
                                       : "take coordinates out of the task, or add drives");
  }
  return m;
}

std::vector<Parameter> parameters(const Stages& m) {
  std::vector<Parameter> out;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    if (k > 0) {
      const Vec3 abc = angles_abc(m.data[k].mount.R);
      for (int i = 0; i < 3; ++i) {
        out.push_back({fmt::format("stage[{}].mount.{}", k + 1, "xyz"[i]), m.data[k].mount.p[i], "mm"});
      }
      for (int i = 0; i < 3; ++i) out.push_back({fmt::format("stage[{}].mount.{}", k + 1, "abc"[i]), abc[i], "deg"});
    }
    for (Parameter& p : parameters_of(m.machines[k])) {
      p.key = fmt::format("stage[{}].machine.{}", k + 1, p.key);
      out.push_back(std::move(p));
    }
  }
  return out;
}

std::vector<double> parameter_values(const Stages& m) {
  std::vector<double> out;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    if (k > 0) {
      const Pose& mount = m.data[k].mount;
      const Vec3 abc = angles_abc(mount.R);
      out.insert(out.end(), mount.p.begin(), mount.p.end());
      out.insert(out.end(), abc.begin(), abc.end());
    }
    const std::vector<double> own =
        std::visit([](const auto& stage) { return kinematics::nominal_parameters(stage); }, m.machines[k]);
    out.insert(out.end(), own.begin(), own.end());
  }
  return out;
}

std::vector<Parameter> settings(const Stages& m) {
  std::vector<Parameter> out;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    for (Parameter& p : settings(m.machines[k])) {
      p.key = fmt::format("stage[{}].machine.{}", k + 1, p.key);
      out.push_back(std::move(p));
    }
  }
  push_tip_limits(out, m);
  return out;
}

std::string to_toml(const Stages& m) {
  std::string out =
      common_toml(m.name, std::string(Stages::kFamily), m.description) + task_toml(m.task) + tip_limits_toml(m);
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    out += "\n[[stage]]\n" + frame_toml("mount", m.data[k].mount);
    if (const SerialArm* chain = chain_of(m.machines[k])) {
      const std::vector<const DhRow*> rows = moving(*chain);
      std::string values;
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const double value = m.data[k].home[static_cast<Eigen::Index>(i)];
        values += (i > 0 ? ", " : "") + number_toml(units::to_user(value, unit_of(*rows[i])));
      }
      out += fmt::format("home = [{}]\n", values);
    }
    // The machine's own file, its tables one level deeper.
    out += "[stage.machine]\n";
    std::istringstream lines(to_toml(m.machines[k]));
    for (std::string line; std::getline(lines, line);) {
      if (line.starts_with("[[")) {
        line.insert(2, "stage.machine.");
      } else if (line.starts_with('[')) {
        line.insert(1, "stage.machine.");
      }
      out += line + "\n";
    }
  }
  return out + provenance_toml(m.provenance);
}

Result<Stages> with_parameters(const Stages& m, std::span<const double> p) {
  Stages out = m;
  std::size_t at = 0;
  for (std::size_t k = 0; k < out.machines.size(); ++k) {
    if (k > 0) {
      out.data[k].mount.p = Vec3(p[at], p[at + 1], p[at + 2]);
      out.data[k].mount.R = rotation_abc(p[at + 3], p[at + 4], p[at + 5]);
      at += kMountFigures;
    }
    const auto n = static_cast<std::size_t>(out.data[k].parameters);
    POLYPOD_ASSIGN(changed, with_parameters(out.machines[k], p.subspan(at, n)));
    out.machines[k] = std::move(changed);
    at += n;
  }
  return out;
}

}  // namespace polypod::machine
