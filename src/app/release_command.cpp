// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "release_command.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "masses_options.hpp"
#include "messages.hpp"
#include "polypod/core/csv.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/motion/simulation.hpp"
#include "polypod/report/csv.hpp"

namespace polypod::app {
namespace {

using machine::AnyMachine;
using machine::JointVector;
using motion::Simulation;
using motion::SimulationSample;

constexpr config::Range kTime_s{1e-6, 1e4}, kInterval_ms{1e-6, 1e6};

struct Options {
  std::string machine, pose, start, speeds, dynamics, forces, csv;
  std::vector<std::string> sets;
  double time = 1, interval_ms = 1;
};

bool turns(const AnyMachine& m, Eigen::Index joint) {
  return kinematics::joint_kind(m, static_cast<int>(joint)) == machine::JointKind::revolute;
}
double shown(const AnyMachine& m, Eigen::Index joint, double value) {
  return turns(m, joint) ? units::to_deg(value) : units::to_mm(value);
}
const char* unit_of(const AnyMachine& m, Eigen::Index joint) {
  return turns(m, joint) ? "deg" : "mm";
}
const char* force_unit(const AnyMachine& m, Eigen::Index joint) {
  return turns(m, joint) ? "Nm" : "N";
}

/// Forces of the drives at rising times.
struct ForceTable {
  std::vector<double> time;
  std::vector<JointVector> force;

  /// Linear between two rows; before the first and after the last as there.
  [[nodiscard]] JointVector at(double t) const {
    const auto next = std::upper_bound(time.begin(), time.end(), t);
    if (next == time.begin()) return force.front();
    if (next == time.end()) return force.back();
    const auto k = static_cast<std::size_t>(next - time.begin());
    const double share = (t - time[k - 1]) / (time[k] - time[k - 1]);
    return force[k - 1] + share * (force[k] - force[k - 1]);
  }
};
Result<ForceTable> read_forces(const AnyMachine& m, const std::string& file) {
  POLYPOD_ASSIGN(table, csv::read(file));
  const int n = kinematics::joint_count(m);
  std::vector<std::string> names{"time_s"};
  for (int i = 0; i < n; ++i) names.push_back(fmt::format("f{}_{}", i + 1, force_unit(m, i)));
  POLYPOD_TRY(table.needs(names));
  ForceTable out;
  for (const csv::Table::Row& row : table.rows) {
    POLYPOD_ASSIGN(t, table.number(row, "time_s"));
    if (!out.time.empty() && !(t > out.time.back())) {
      return fail("AP282", fmt::format("time_s {:g} does not come after {:g}", t, out.time.back()), table.place_of(row),
                  "sort the rows by time, each time once");
    }
    JointVector f(n);
    for (int i = 0; i < n; ++i) {
      POLYPOD_ASSIGN(value, table.number(row, names[static_cast<std::size_t>(i + 1)]));
      if (!(std::abs(value) <= 1e12)) {
        return fail("AP282", fmt::format("a force of {:g} is none that a drive has", value), table.place_of(row));
      }
      f[i] = value;
    }
    out.time.push_back(t);
    out.force.push_back(f);
  }
  POLYPOD_TRY(table.unused());
  return out;
}

/// deg/s or mm/s, one a drive.
Result<JointVector> speeds_of(const AnyMachine& m, const std::string& text) {
  const int n = kinematics::joint_count(m);
  JointVector out = JointVector::Zero(n);
  if (text.empty()) return out;
  POLYPOD_ASSIGN(numbers, numbers_of(text, "--speeds"));
  if (static_cast<int>(numbers.size()) != n) {
    return fail("AP210", fmt::format("--speeds {}: the machine has {} drives", text, n), {}, "give one a drive");
  }
  for (int i = 0; i < n; ++i) {
    const double v = numbers[static_cast<std::size_t>(i)];
    POLYPOD_TRY(in_range("AP210", "--speeds", v, {-1e9, 1e9}, "deg/s or mm/s"));
    out[i] = turns(m, i) ? units::from_deg(v) : units::from_mm(v);
  }
  return out;
}

/// All solutions at the pose, or the one that --start numbers alone.
Status choose(kinematics::InverseResult& inverse, const std::string& start) {
  if (start.empty() || inverse.solutions.empty()) return {};
  POLYPOD_ASSIGN(k, count_of(start, "--start", {1, 1000}, ""));
  const std::size_t known = inverse.solutions.size(), place = static_cast<std::size_t>(k) - 1;
  if (place >= known) {
    return fail("MO119", fmt::format("--start {}: the pose has {} solution{}", k, known, known == 1 ? "" : "s"), {},
                "take one of these; `polypod ik` lists them");
  }
  inverse.solutions = {kinematics::Solution(inverse.solutions[place])};
  return {};
}

std::string table_of(const AnyMachine& m, const Simulation& run) {
  const int n = kinematics::joint_count(m);
  std::vector<std::string> columns{"time_s", "x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"};
  for (int i = 0; i < n; ++i)
    for (const char* suffix : {"", "_per_s", "_per_s2"})
      columns.push_back(fmt::format("q{}_{}{}", i + 1, unit_of(m, i), suffix));
  for (int i = 0; i < n; ++i) columns.push_back(fmt::format("f{}_{}", i + 1, force_unit(m, i)));
  for (const char* name : {"kinetic_J", "potential_J", "work_J"}) columns.emplace_back(name);
  report::Csv csv(columns);
  for (const SimulationSample& s : run.samples) {
    std::vector<report::Csv::Field> row{s.t};
    for (const double x : whole_pose_for_user(s.X)) row.emplace_back(x);
    for (int i = 0; i < n; ++i)
      for (const JointVector* v : {&s.q, &s.speed, &s.acceleration}) row.emplace_back(shown(m, i, (*v)[i]));
    for (int i = 0; i < n; ++i) row.emplace_back(s.force[i]);
    for (const double e : {s.energy.kinetic, s.energy.potential, s.work}) row.emplace_back(e);
    csv.add(row);
  }
  return csv.text();
}

constexpr const char* kNotJudged =
    "dry friction, brakes, stops at the ends of the ranges, collisions, what the drives can give";

/// The solution of the inverse at which the machine begins.
struct Start {
  std::string branch;
  std::size_t of = 0;
};

Json document_of(const AnyMachine& m, const Simulation& run, const Start& start) {
  Json drives = Json::array(), passed = Json::array();
  for (std::size_t i = 0; i < run.drives.size(); ++i) {
    const auto joint = static_cast<Eigen::Index>(i);
    const motion::DriveExtent& r = run.drives[i];
    drives.push_back({{"unit", unit_of(m, joint)},
                      {"position", {{"min", shown(m, joint, r.low)}, {"max", shown(m, joint, r.high)}}},
                      {"speed_max", shown(m, joint, r.speed)},
                      {"acceleration_max", shown(m, joint, r.acceleration)}});
  }
  for (const motion::LimitPassed& p : run.passed) passed.push_back({{"time_s", p.t}, {"limit", p.limit}});
  const SimulationSample &first = run.samples.front(), &last = run.samples.back();
  const auto end = [&](const SimulationSample& s) {
    return Json{{"time_s", s.t},
                {"pose", whole_pose_for_user(s.X)},
                {"joints", joints_for_user(m, s.q)},
                {"kinetic_J", s.energy.kinetic},
                {"potential_J", s.energy.potential}};
  };
  return {{"time_s", last.t},
          {"stopped", run.stopped.empty() ? Json() : Json(run.stopped)},
          {"branch", start.branch},
          {"start", end(first)},
          {"end", end(last)},
          {"work_J", last.work},
          {"energy_drift_J", run.drift},
          {"steps", run.steps},
          {"steps_repeated", run.repeated},
          {"drives", drives},
          {"passed", passed},
          {"not_judged", kNotJudged}};
}

/// x, y, z in mm and A, B, C in deg; 0 has no sign.
std::string place_of(const Pose& X) {
  std::vector<std::string> out;
  for (const double x : whole_pose_for_user(X)) out.push_back(unsigned_zero(fmt::format("{:.2f}", x)));
  return fmt::format("{} mm, {} deg", fmt::join(out.begin(), out.begin() + 3, ", "),
                     fmt::join(out.begin() + 3, out.end(), ", "));
}

void print_release(const AnyMachine& m, const Simulation& run, const Start& start, const std::string& note) {
  const SimulationSample &first = run.samples.front(), &last = run.samples.back();
  fmt::print("time     {} s in {} steps\n", figure(last.t, 4), run.steps);
  if (start.of > 1) fmt::print("branch   {} (of {} solutions at the start)\n", start.branch, start.of);
  fmt::print("tip      from {}\n         to   {}\n", place_of(first.X), place_of(last.X));
  fmt::print("{:<8} {:>10} {:>10} {:>12} {:>14}\n", "", "min", "max", "speed /s", "acceler. /s2");
  for (std::size_t i = 0; i < run.drives.size(); ++i) {
    const auto joint = static_cast<Eigen::Index>(i);
    const motion::DriveExtent& r = run.drives[i];
    fmt::print("drive {:<2} {:>10} {:>10} {:>12} {:>14} {}\n", i + 1, figure(shown(m, joint, r.low), 3),
               figure(shown(m, joint, r.high), 3), figure(shown(m, joint, r.speed), 1),
               figure(shown(m, joint, r.acceleration), 0), unit_of(m, joint));
  }
  // What is below the error of the integration, or of rounding (J), is 0.
  const double height = first.energy.potential - last.energy.potential, least = std::max(run.drift, 1e-12);
  const auto joule = [&](double energy) { return figure(std::abs(energy) < least ? 0.0 : energy, 3); };
  fmt::print(
      "energy   kinetic {} J at the start, {} J at the end; height gave {} J, drives less viscous friction {} J\n",
      joule(first.energy.kinetic), joule(last.energy.kinetic), joule(height), joule(last.work));
  fmt::print("         they balance within {:.1g} J, the error of the integration\n", least);
  for (const motion::LimitPassed& p : run.passed) fmt::print("problem  after {:.4g} s: {}\n", p.t, p.limit);
  if (!run.stopped.empty()) fmt::print("stopped  {}\n", run.stopped);
  fmt::print("note     {}\n", note);
  fmt::print("not judged: {}\n", kNotJudged);
}

}  // namespace

Command release_command() {
  auto o = std::make_shared<Options>();
  return {
      "release", "How a machine moves whose drives are let go, or push with given forces",
      "polypod release hexapod-strut --pose 5,3,75 --dynamics examples/jel_path/masses.toml --time 0.05",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--pose", o->pose, "Where it begins: the coordinates of the machine's task, mm and deg", true);
        a.option("--start", o->start,
                 "Solution of the inverse there, by its number (default: the first within the limits)");
        a.option("--speeds", o->speeds, "Of the drives at the start, deg/s or mm/s, one a drive (default: at rest)");
        a.option("--dynamics", o->dynamics,
                 "A file with the table `dynamics`: masses (default: that of the machine file)");
        a.option("--forces", o->forces,
                 "A CSV file of what the drives push with: time_s, f1_N or f1_Nm, ... (default: nothing)");
        a.option("--time", o->time, kTime_s, "How long, s (default 1)");
        a.option("--interval", o->interval_ms, kInterval_ms, "Between samples, ms (default 1)");
        a.option("--csv", o->csv, "A row a sample: pose, drives, forces, energies");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_TRY(
            check_files({o->machine, o->dynamics == o->machine ? "" : o->dynamics, o->forces}, {o->csv}, context.json));
        MassesOptions file;
        file.dynamics = o->dynamics;
        POLYPOD_ASSIGN(masses, file.read(m, o->machine, context));
        if (!masses.dynamics) {
          return fail("AP281", "its motion is not computed: " + masses.why_not, {},
                      "give masses in the machine file or by --dynamics, docs/motion.md has the table");
        }
        POLYPOD_ASSIGN(X, pose_argument(m, o->pose));
        POLYPOD_ASSIGN(speeds, speeds_of(m, o->speeds));
        motion::SimulationOptions options;
        options.time = o->time;
        options.interval = units::from_ms(o->interval_ms);
        if (!o->forces.empty()) {
          POLYPOD_ASSIGN(table, read_forces(m, o->forces));
          options.forces = [table = std::move(table)](double t, const JointVector&, const JointVector&) {
            return table.at(t);
          };
        }
        kinematics::InverseResult inverse = kinematics::inverse(m, X);
        const std::size_t known = inverse.solutions.size();
        POLYPOD_TRY(choose(inverse, o->start));
        const kinematics::Solution* start = inverse.reachable();
        if (start == nullptr) return cannot_take(context, kinematics::reason_of(m, inverse));
        const Start named{kinematics::branch_name(m, start->branch), known};
        options.progress = progress_line(context, "moving");
        POLYPOD_ASSIGN(run, motion::simulate(m, *masses.dynamics, kinematics::settled(m, X, start->joints),
                                             start->joints, speeds, options));
        options.progress(1);
        if (context.json) {
          Json document = document_of(m, run, named);
          document["notes"] = Json::array({in_words(*masses.dynamics)});
          print_json(document);
        } else {
          print_release(m, run, named, in_words(*masses.dynamics));
        }
        if (!o->csv.empty()) {
          files::Outputs together;
          POLYPOD_TRY(together.add(o->csv, table_of(m, run)));
          POLYPOD_TRY(together.commit());
          if (!context.json) fmt::print("wrote {}\n", o->csv);
        }
        return run.stopped.empty() && run.passed.empty() ? kDone : kAnswerIsNo;
      }};
}

}  // namespace polypod::app
