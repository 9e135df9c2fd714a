// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/motion.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "machine_lines.hpp"
#include "moving_machine.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/delta/kinematics.hpp"
#include "polypod/report/csv.hpp"
#include "polypod/report/html.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::pages {
namespace {

using motion::DriveMotion;
using motion::Run;
using motion::Sample;
using units::to_mm;

struct Unit {
  const char* name;
  double (*to)(double);
};
Unit unit_of(const machine::AnyMachine& machine) {
  const bool turns = kinematics::joint_kind(machine, 0) == machine::JointKind::revolute;
  return turns ? Unit{"deg", units::to_deg} : Unit{"mm", units::to_mm};
}

constexpr std::array<report::Colour, machine::kMaxArms> kColours{report::Colour::blue, report::Colour::vermillion,
                                                                 report::Colour::green, report::Colour::purple};

/// One quantity of all drives over time.
report::LinePlot drive_plot(const Run& run, const char* name, const std::string& unit, double (*to)(double),
                            double DriveMotion::*what) {
  report::LinePlot plot;
  plot.title = fmt::format("{} of the drives", name);
  plot.x = {"time", "s", {}, {}, false};
  plot.y = {name, unit, {}, {}, false};
  for (int i = 0; i < run.arms; ++i) {
    report::Series series{fmt::format("drive {}", i + 1), {}, {}, kColours[static_cast<std::size_t>(i)], {}, 1.5};
    for (const Sample& s : run.samples) {
      series.x.push_back(s.t);
      series.y.push_back(s.reached ? to(s.drive[i].*what) : std::numeric_limits<double>::quiet_NaN());
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

/// The size of one derivative of the tool, or its coordinates.
report::LinePlot tool_plot(const Run& run, const char* name, const std::string& unit, Vec3 motion::Motion::*what,
                           bool coordinates) {
  report::LinePlot plot;
  plot.title = fmt::format("{} of the tool", name);
  plot.x = {"time", "s", {}, {}, false};
  plot.y = {name, unit, {}, {}, !coordinates};
  for (int k = 0; k < (coordinates ? 3 : 1); ++k) {
    report::Series series{coordinates ? std::string(1, "xyz"[k]) : std::string("tool"),
                          {},
                          {},
                          kColours[static_cast<std::size_t>(k)],
                          {},
                          1.5};
    for (const Sample& s : run.samples) {
      series.x.push_back(s.t);
      series.y.push_back(to_mm(coordinates ? (s.tool.*what)[k] : (s.tool.*what).norm()));
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

}  // namespace

std::vector<std::string> limits_of_poses(const machine::AnyMachine& machine) {
  std::vector<std::string> out{"ranges of the drives", "ball joints", "assembly mode"};
  std::visit(
      [&]<class M>(const M& m) {
        if constexpr (machine::DeltaFamily<M>) {
          if (m.low.array().isFinite().any() || m.high.array().isFinite().any()) out.emplace_back("coordinates");
          if (m.bodies.table_z) out.emplace_back("table");
          if (m.bodies.rod_diameter > 0) out.emplace_back("collisions of rods");
        }
      },
      machine);
  return out;
}

std::string motion_csv(const machine::AnyMachine& machine, const Run& run) {
  const Unit unit = unit_of(machine);
  std::vector<std::string> columns{"t_s"};
  const std::array<const char*, 4> of_tool{"", "v", "a", "j"}, of_drive{"", "_per_s", "_per_s2", "_per_s3"};
  for (std::size_t order = 0; order < 4; ++order)
    for (const char axis : {'x', 'y', 'z'})
      columns.push_back(fmt::format("{}{}_mm{}", of_tool[order], axis, of_drive[order]));
  for (int i = 0; i < run.arms; ++i)
    for (const char* suffix : of_drive) columns.push_back(fmt::format("q{}_{}{}", i + 1, unit.name, suffix));
  report::Csv csv(columns);
  for (const Sample& s : run.samples) {
    std::vector<report::Csv::Field> row{s.t};
    for (const Vec3* v : {&s.tool.p, &s.tool.v, &s.tool.a, &s.tool.j})
      for (int k = 0; k < 3; ++k) row.emplace_back(to_mm((*v)[k]));
    for (int i = 0; i < run.arms && s.reached; ++i)
      for (const double value : {s.drive[i].q, s.drive[i].speed, s.drive[i].acceleration, s.drive[i].jerk}) {
        row.emplace_back(unit.to(value));
      }
    csv.add(row);
  }
  return csv.text();
}

namespace {

/// The machine on its way, in place of the machine at the start.
void animate(report::Scene& scene, const machine::AnyMachine& machine, const Run& run) {
  constexpr std::size_t kFrames = 400;
  const Sample& first = run.samples.front();
  const auto joints = [&](const Sample& s) {
    machine::JointVector q(run.arms);
    for (int i = 0; i < run.arms; ++i) q[i] = s.drive[i].q;
    return q;
  };
  const auto pose = [](const Sample& s) { return Pose{Mat3::Identity(), s.tool.p}; };
  if (!first.reached) return;
  const MovingMachine moving(machine, pose(first), joints(first));
  report::Frames frames;
  const Unit unit = unit_of(machine);
  std::vector<report::Frames::Column> speeds{{"speed of the tool", "mm/s", {}}};
  for (int i = 0; i < run.arms; ++i)
    speeds.push_back({fmt::format("speed of q{}", i + 1), fmt::format("{}/s", unit.name), {}});
  const std::size_t step = (run.samples.size() + kFrames - 1) / kFrames;
  std::vector<std::size_t> shown;
  for (std::size_t k = 0; k < run.samples.size(); k += step) shown.push_back(k);
  if (shown.back() + 1 < run.samples.size()) shown.push_back(run.samples.size() - 1);
  double before = -std::numeric_limits<double>::infinity();
  for (const std::size_t k : shown) {
    const Sample& s = run.samples[k];
    if (!s.reached) continue;
    std::string note;
    for (const motion::Problem& p : run.problems)
      if (p.t > before && p.t <= s.t) note += (note.empty() ? "" : "; ") + p.detail;
    if (!moving.add(frames, s.t, pose(s), joints(s), note)) return;
    before = s.t;
    speeds[0].values.push_back(to_mm(s.tool.v.norm()));
    for (int i = 0; i < run.arms; ++i)
      speeds[static_cast<std::size_t>(i) + 1].values.push_back(unit.to(s.drive[i].speed));
  }
  frames.columns.insert(frames.columns.end(), speeds.begin(), speeds.end());
  const std::size_t outline = machine_lines(machine, first.tool.p).size();
  scene.lines.erase(scene.lines.begin(), scene.lines.begin() + static_cast<std::ptrdiff_t>(outline));
  scene.lines.insert(scene.lines.begin(), moving.lines().begin(), moving.lines().end());
  scene.frames.push_back(std::move(frames));
}

/// The limits beside what was met, and what was judged at all.
void add_limits(report::Report& page, const MotionQuestion& question) {
  page.add_section("Limits");
  report::Table table;
  table.caption = "What the motion was judged by.";
  table.columns = {{"limit", "", -1}, {"value", "", 1}, {"met", "", 1}, {"unit", "", -1}, {"where from", "", -1}};
  for (const MotionLimit& l : question.limits) {
    table.rows.push_back({l.name, l.limit, l.met, l.unit, std::string(l.given ? "given" : "assumed")});
  }
  if (!table.rows.empty()) page.add_table(table);
  const auto list = [](const std::vector<std::string>& items) { return fmt::format("{}", fmt::join(items, ", ")); };
  std::vector<std::string> judged{fmt::format("Judged along the whole path: {}.", list(question.judged))};
  if (!question.not_judged.empty()) judged.push_back(fmt::format("Not judged: {}.", list(question.not_judged)));
  page.add_list(judged);
}

}  // namespace

std::string motion_page(const machine::AnyMachine& machine, const Run& run, const MotionQuestion& question,
                        const std::string& version, const std::string& command) {
  const Unit unit = unit_of(machine);
  std::vector<std::pair<std::string, std::string>> facts{{"machine", machine::name_of(machine)},
                                                         {"family", machine::family_of(machine)}};
  if (!version.empty()) facts.emplace_back("made with", "Polypod " + version);
  report::Report page(question.what, machine::description_of(machine), facts);
  page.add_section("The motion");
  if (run.ok()) {
    page.add_verdict(report::Verdict::good, question.not_judged.empty()
                                                ? std::string("The motion keeps every limit below.")
                                                : fmt::format("The motion keeps every limit below. Not judged: {}.",
                                                              fmt::join(question.not_judged, ", ")));
  }
  for (const motion::Problem& p : run.problems) {
    page.add_verdict(
        report::Verdict::bad,
        fmt::format("After {} s at {}, {}, {} mm: {}.", report::fixed(p.t, 3), report::fixed(to_mm(p.X.x()), 2),
                    report::fixed(to_mm(p.X.y()), 2), report::fixed(to_mm(p.X.z()), 2), p.detail));
  }
  page.add_text(
      "This answers for the limits in the table below along this path: not for the forces and torques of the drives, "
      "not for vibration, deflection and the load that is carried, and not for collisions with workpiece and "
      "surroundings.");
  page.add_key_figures({{figure(to_mm(run.length), 1), "mm", "path length of the tool", report::Verdict::neutral},
                        {report::fixed(run.time, 4), "s", "time", report::Verdict::neutral}});
  report::Scene scene;
  scene.title = "The path of the tool and the machine at home";
  scene.lines = machine_lines(machine, run.samples.front().tool.p);
  report::Line3 way{"path of the tool", {}, report::Colour::blue, 2.2, false};
  for (const Sample& s : run.samples)
    way.points.push_back({to_mm(s.tool.p.x()), to_mm(s.tool.p.y()), to_mm(s.tool.p.z())});
  scene.lines.push_back(std::move(way));
  report::Line3 problems{"problems", {}, report::Colour::vermillion, 4, true};
  for (const motion::Problem& p : run.problems)
    problems.points.push_back({to_mm(p.X.x()), to_mm(p.X.y()), to_mm(p.X.z())});
  if (!problems.points.empty()) scene.lines.push_back(std::move(problems));
  report::Scene turns = scene;
  animate(turns, machine, run);
  hang(scene);
  hang(turns);
  page.add_scene(scene, "The base is above: z of the machine points down.", &turns);

  add_limits(page, question);
  page.add_section("Drives");
  const std::string u = unit.name;
  page.add_figure(drive_plot(run, "position", u, unit.to, &DriveMotion::q), "Position of the drives.");
  page.add_figure(drive_plot(run, "speed", u + "/s", unit.to, &DriveMotion::speed), "Speed of the drives.");
  page.add_figure(drive_plot(run, "acceleration", u + "/s²", unit.to, &DriveMotion::acceleration),
                  "Acceleration of the drives.");
  page.add_figure(drive_plot(run, "jerk", u + "/s³", unit.to, &DriveMotion::jerk), "Jerk of the drives.");
  page.add_section("Tool");
  page.add_figure(tool_plot(run, "position", "mm", &motion::Motion::p, true), "Coordinates of the tool.");
  page.add_figure(tool_plot(run, "speed", "mm/s", &motion::Motion::v, false), "Speed of the tool.");
  page.add_figure(tool_plot(run, "acceleration", "mm/s²", &motion::Motion::a, false), "Acceleration of the tool.");
  page.add_figure(tool_plot(run, "jerk", "mm/s³", &motion::Motion::j, false), "Jerk of the tool.");

  page.add_section("Peaks");
  report::Table table;
  table.caption = "Largest absolute values over the samples.";
  table.columns = {{"", "", -1}, {"speed", "/s", 1}, {"acceleration", "/s²", 0}, {"jerk", "/s³", 0}, {"unit", "", -1}};
  table.rows.push_back({std::string("tool"), to_mm(run.tool.speed), to_mm(run.tool.acceleration), to_mm(run.tool.jerk),
                        std::string("mm")});
  for (int i = 0; i < run.arms; ++i) {
    const motion::Peaks& p = run.drive[i];
    table.rows.push_back(
        {fmt::format("drive {}", i + 1), unit.to(p.speed), unit.to(p.acceleration), unit.to(p.jerk), u});
  }
  page.add_table(table);
  if (!command.empty()) {
    page.add_section("Inputs");
    page.add_code("The command that made this page", command, false);
  }
  return page.to_html();
}

}  // namespace polypod::pages
