// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/motion.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <map>

#include "machine_lines.hpp"
#include "moving_machine.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/report/csv.hpp"
#include "polypod/report/html.hpp"
#include "polypod/report/scene.hpp"
#include "program_film.hpp"

namespace polypod::pages {
namespace {

using machine::JointVector;
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
  static const std::map<std::string, std::string> kWords{{"length", "lengths of the legs"},
                                                         {"drive", "ranges of the drives"},
                                                         {"base-joint", "joints at the base"},
                                                         {"platform-joint", "joints at the platform"},
                                                         {"joint", "ball joints"},
                                                         {"mode", "assembly mode"},
                                                         {"legs", "collisions of legs"},
                                                         {"rods", "collisions of rods"},
                                                         {"base", "collisions with the base"}};
  std::vector<std::string> out;
  for (const machine::LimitInfo& limit : kinematics::limit_table(machine)) {
    if (!limit.given) continue;
    const bool number = !limit.group.empty() && limit.group.find_first_not_of("0123456789") == std::string::npos;
    const auto words = kWords.find(limit.group);
    std::string name = number ? "ranges of the joints" : words != kWords.end() ? words->second : limit.group;
    if (std::find(out.begin(), out.end(), name) == out.end()) out.push_back(std::move(name));
  }
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
  table.columns = {{"limit", "", -1}, {"value", "", 1}, {"reached", "", 1}, {"unit", "", -1}, {"where from", "", -1}};
  for (const MotionLimit& l : question.limits) {
    table.rows.push_back({l.name, l.limit, l.met, l.unit, std::string(l.given ? "given" : "assumed")});
  }
  if (!table.rows.empty()) page.add_table(table);
  const auto list = [](const std::vector<std::string>& items) { return fmt::format("{}", fmt::join(items, ", ")); };
  std::vector<std::string> judged{fmt::format("Judged along the whole path: {}.", list(question.judged))};
  if (!question.not_judged.empty()) judged.push_back(fmt::format("Not judged: {}.", list(question.not_judged)));
  page.add_list(judged);
}

/// A page with its head and, where there are no problems, the answer.
report::Report begun(const machine::AnyMachine& machine, const MotionQuestion& question, bool ok,
                     const std::string& version) {
  std::vector<std::pair<std::string, std::string>> facts{{"machine", machine::name_of(machine)},
                                                         {"family", machine::family_of(machine)}};
  if (!version.empty()) facts.emplace_back("made with", "Polypod " + version);
  report::Report page(question.what, machine::description_of(machine), facts);
  page.add_section("The motion");
  if (ok) {
    page.add_verdict(report::Verdict::good, question.not_judged.empty()
                                                ? std::string("The motion keeps every limit below.")
                                                : fmt::format("The motion keeps every limit below. Not judged: {}.",
                                                              fmt::join(question.not_judged, ", ")));
  }
  return page;
}

}  // namespace

std::string motion_page(const machine::AnyMachine& machine, const Run& run, const MotionQuestion& question,
                        const std::string& version, const std::string& command) {
  const Unit unit = unit_of(machine);
  report::Report page = begun(machine, question, run.ok(), version);
  for (const motion::Problem& p : run.problems) {
    page.add_verdict(
        report::Verdict::bad,
        fmt::format("After {} s at {}, {}, {} mm: {}.", report::fixed(p.t, 3), report::fixed(to_mm(p.X.x()), 2),
                    report::fixed(to_mm(p.X.y()), 2), report::fixed(to_mm(p.X.z()), 2), p.detail));
  }
  page.add_text("This answers for the limits in the table below along this path, and for what is named as judged.");
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

namespace {

using motion::MoveDrive;
using motion::MoveResult;
using motion::MoveSample;

double shown(const MoveDrive& d, double x) {
  return (d.turns ? units::to_deg(x) : to_mm(x)) + 0.0;  // no -0
}
const char* unit_of(const MoveDrive& d) {
  return d.turns ? "deg" : "mm";
}

report::Point3 point_of(const Vec3& p) {
  return {to_mm(p.x()), to_mm(p.y()), to_mm(p.z())};
}

report::Colour colour_of(std::size_t k) {
  constexpr std::array<report::Colour, 7> kAll{report::Colour::blue,   report::Colour::orange, report::Colour::green,
                                               report::Colour::purple, report::Colour::sky,    report::Colour::ink,
                                               report::Colour::muted};
  return kAll[k % kAll.size()];
}

/// One quantity of all drives of a unit over time.
report::LinePlot drives_plot(const MoveResult& run, const char* name, bool turns, const char* per,
                             JointVector MoveSample::*what) {
  report::LinePlot plot;
  plot.title = fmt::format("{} of the drives", name);
  plot.x = {"time", "s", {}, {}, false};
  plot.y = {name, fmt::format("{}{}", turns ? "deg" : "mm", per), {}, {}, false};
  for (std::size_t i = 0; i < run.drives.size(); ++i) {
    if (run.drives[i].turns != turns) continue;
    report::Series series{fmt::format("drive {}", i + 1), {}, {}, colour_of(i), {}, 1.5};
    for (const MoveSample& s : run.samples) {
      const bool known = what == &MoveSample::q ? s.reached : s.regular;
      series.x.push_back(s.t);
      series.y.push_back(known ? shown(run.drives[i], (s.*what)[static_cast<Eigen::Index>(i)])
                               : std::numeric_limits<double>::quiet_NaN());
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

report::LinePlot force_plot(const MoveResult& run, bool turns) {
  report::LinePlot plot;
  plot.title = turns ? "Torques of the drives" : "Forces of the drives";
  plot.x = {"time", "s", {}, {}, false};
  plot.y = {turns ? "torque" : "force", turns ? "Nm" : "N", {}, {}, true};
  for (std::size_t i = 0; i < run.drives.size(); ++i) {
    if (run.drives[i].turns != turns) continue;
    report::Series series{fmt::format("drive {}", i + 1), {}, {}, colour_of(i), {}, 1.5};
    for (const MoveSample& s : run.samples) {
      series.x.push_back(s.t);
      series.y.push_back(s.force.size() > 0 ? s.force[static_cast<Eigen::Index>(i)]
                                            : std::numeric_limits<double>::quiet_NaN());
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

report::LinePlot size_plot(const MoveResult& run, const char* name, const char* unit, Vec3 MoveSample::*what) {
  report::LinePlot plot;
  plot.title = fmt::format("{} of the tool", name);
  plot.x = {"time", "s", {}, {}, false};
  plot.y = {name, unit, {}, {}, true};
  report::Series series{"tool", {}, {}, report::Colour::blue, {}, 1.5};
  for (const MoveSample& s : run.samples) {
    series.x.push_back(s.t);
    series.y.push_back(to_mm((s.*what).norm()));
  }
  plot.series.push_back(std::move(series));
  return plot;
}

report::LinePlot pose_plot(const MoveResult& run, bool angles) {
  report::LinePlot plot;
  plot.title = angles ? "Angles of the tool" : "Position of the tool";
  plot.x = {"time", "s", {}, {}, false};
  plot.y = {angles ? "angle" : "position", angles ? "deg" : "mm", {}, {}, false};
  for (int k = 0; k < 3; ++k) {
    report::Series series{std::string(1, (angles ? "ABC" : "xyz")[k]), {}, {},
                          colour_of(static_cast<std::size_t>(k)),      {}, 1.5};
    for (const MoveSample& s : run.samples) {
      series.x.push_back(s.t);
      series.y.push_back(angles ? units::to_deg(angles_abc(s.X.R)[k]) : to_mm(s.X.p[k]));
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

/// The numbers in the name of a limit: "legs 1 and 2 collide" names 1 and 2.
std::vector<std::size_t> numbers_in(const std::string& text) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < text.size();) {
    if (text[i] < '0' || text[i] > '9') {
      ++i;
      continue;
    }
    std::size_t value = 0;
    while (i < text.size() && text[i] >= '0' && text[i] <= '9')
      value = 10 * value + static_cast<std::size_t>(text[i++] - '0');
    out.push_back(value);
  }
  return out;
}

/// The machine at a sample; what breaks a limit is red.
void add_machine(report::Scene& scene, const machine::AnyMachine& machine, const MoveSample& sample,
                 report::Colour colour, const std::string& name) {
  if (!sample.reached) return;
  using Role = machine::OutlinePart::Role;
  std::vector<std::size_t> broken;
  for (const std::string& limit : kinematics::limit_names(machine, sample.violations))
    for (const std::size_t n : numbers_in(limit)) broken.push_back(n);
  const auto is_broken = [&](std::size_t n) { return std::find(broken.begin(), broken.end(), n) != broken.end(); };
  const machine::Outline outline = kinematics::outline_at(machine, sample.X, sample.q);
  std::map<std::string, std::size_t> total, count;
  for (const machine::OutlinePart& part : outline) ++total[part.name];
  for (const machine::OutlinePart& part : outline) {
    const std::size_t number = ++count[part.name];
    report::Line3 line{name, {}, colour, part.thick ? 2.0 : 1.2, part.role == Role::joints};
    if (part.role == Role::fixed) line = {"base", {}, report::Colour::muted, 1.5, false};
    const bool red = part.role == Role::moving && total[part.name] > 1 ? is_broken(number)
                     : part.role == Role::moving                       ? sample.violations != 0
                     : part.role == Role::platform                     ? sample.violations != 0 && broken.empty()
                                                                       : false;
    if (red) {
      line.name = "breaks a limit";
      line.colour = report::Colour::vermillion;
      line.stroke = 3.4;
    }
    for (const Vec3& p : part.points) line.points.push_back(point_of(p));
    scene.lines.push_back(std::move(line));
  }
}

/// Whether a sample keeps everything.
bool keeps(const MoveSample& s) {
  constexpr double kRounding = 1e-6;
  return s.reached && s.violations == 0 && !(s.share > 1 + kRounding);
}

report::Scene scene_of(const machine::AnyMachine& machine, const MoveResult& run) {
  report::Scene scene;
  scene.title = "The path of the tool and the machine on it";
  if (run.samples.empty()) return scene;
  add_machine(scene, machine, run.samples.front(), report::Colour::ink, "machine at the start");
  // The first of those that break the most limits.
  const auto broken = [](const MoveSample& x) { return x.reached ? std::popcount(x.violations) : 0; };
  const auto worst = std::max_element(run.samples.begin(), run.samples.end(),
                                      [&](const auto& a, const auto& b) { return broken(a) < broken(b); });
  if (broken(*worst) > 0) {
    add_machine(scene, machine, *worst, report::Colour::sky, "machine where most limits are broken");
  } else {
    add_machine(scene, machine, run.samples.back(), report::Colour::sky, "machine at the end");
  }
  for (std::size_t k = 0; k < run.samples.size();) {
    const bool good = keeps(run.samples[k]);
    report::Line3 way{good ? "path of the tool" : "path where a limit is broken",
                      {},
                      good ? report::Colour::blue : report::Colour::vermillion,
                      good ? 2.2 : 3.4,
                      false};
    if (k > 0) way.points.push_back(point_of(run.samples[k - 1].X.p));
    while (k < run.samples.size() && keeps(run.samples[k]) == good)
      way.points.push_back(point_of(run.samples[k++].X.p));
    scene.lines.push_back(std::move(way));
  }
  report::Line3 problems{"problems", {}, report::Colour::vermillion, 4, true};
  for (const motion::MoveViolation& v : run.violations) problems.points.push_back(point_of(v.p));
  if (!problems.points.empty()) scene.lines.push_back(std::move(problems));
  return scene;
}

/// The path and the machine that moves along it.
report::Scene film_of(const machine::AnyMachine& machine, const MoveResult& run, const report::Scene& still) {
  report::Scene scene;
  scene.title = "The machine on the path of the tool";
  for (const report::Line3& line : still.lines)
    if (line.name.starts_with("path") || line.name == "problems") scene.lines.push_back(line);
  const std::size_t count = run.samples.size(), most = pictures_for(machine);
  const std::size_t step = std::max<std::size_t>(1, (count + most - 1) / most);
  std::vector<ProgramInstant> instants;
  for (std::size_t k = 0; k < count; ++k) {
    // What breaks a limit for the first time is shown whenever it is.
    const bool breaks = k > 0 && keeps(run.samples[k - 1]) && !keeps(run.samples[k]);
    if (k % step != 0 && k + 1 != count && !breaks) continue;
    const MoveSample& s = run.samples[k];
    ProgramInstant p{s.t, static_cast<int>(k), 0, s.line, keeps(s), s.X, {}, {}};
    if (s.reached) p.q = s.q;
    if (!p.reached) p.why = s.reached && s.share > 1 ? s.nearest + " is beyond its limit" : "no solution";
    instants.push_back(std::move(p));
  }
  const auto sample = [&run](const ProgramInstant& p) -> const MoveSample& {
    return run.samples[static_cast<std::size_t>(p.move)];
  };
  add_film(scene, machine, instants,
           {{"speed of the tool", "mm/s", [sample](const auto& p) { return to_mm(sample(p).v.norm()); }},
            {"nearest limit is met to", "%",
             [sample](const auto& p) {
               constexpr double kAll = 100;
               return sample(p).nearest.empty() ? std::numeric_limits<double>::quiet_NaN() : kAll * sample(p).share;
             }}},
           {});
  return scene.frames.empty() ? still : scene;
}

}  // namespace

std::string move_csv(const machine::AnyMachine& machine, const MoveResult& run) {
  std::vector<std::string> columns{"t_s", "line", "x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"};
  const std::array<const char*, 4> of_tool{"", "v", "a", "j"}, of_drive{"", "_per_s", "_per_s2", "_per_s3"};
  for (std::size_t order = 1; order < 4; ++order)
    for (const char axis : {'x', 'y', 'z'})
      columns.push_back(fmt::format("{}{}_mm{}", of_tool[order], axis, of_drive[order]));
  for (std::size_t i = 0; i < run.drives.size(); ++i)
    for (const char* suffix : of_drive)
      columns.push_back(fmt::format("q{}_{}{}", i + 1, unit_of(run.drives[i]), suffix));
  const bool forces =
      std::any_of(run.samples.begin(), run.samples.end(), [](const MoveSample& s) { return s.force.size() > 0; });
  for (std::size_t i = 0; i < run.drives.size() && forces; ++i) {
    columns.push_back(fmt::format("f{}_{}", i + 1, run.drives[i].turns ? "Nm" : "N"));
  }
  for (const char* name : {"condition", "nearest_limit", "share_of_limit", "broken"}) columns.emplace_back(name);
  report::Csv csv(columns);
  for (const MoveSample& s : run.samples) {
    std::vector<report::Csv::Field> row{s.t};
    row.emplace_back(static_cast<double>(s.line));
    for (int k = 0; k < 3; ++k) row.emplace_back(to_mm(s.X.p[k]));
    const Vec3 angles = angles_abc(s.X.R);
    for (int k = 0; k < 3; ++k) row.emplace_back(units::to_deg(angles[k]) + 0.0);  // no -0
    for (const Vec3* v : {&s.v, &s.a, &s.j})
      for (int k = 0; k < 3; ++k) row.emplace_back(to_mm((*v)[k]));
    for (std::size_t i = 0; i < run.drives.size(); ++i) {
      const auto joint = static_cast<Eigen::Index>(i);
      if (s.reached) {
        row.emplace_back(shown(run.drives[i], s.q[joint]));
      } else {
        row.emplace_back(std::string());
      }
      for (const JointVector* v : {&s.speed, &s.acceleration, &s.jerk}) {
        if (s.regular) {
          row.emplace_back(shown(run.drives[i], (*v)[joint]));
        } else {
          row.emplace_back(std::string());
        }
      }
    }
    for (std::size_t i = 0; i < run.drives.size() && forces; ++i) {
      if (s.force.size() > 0) {
        row.emplace_back(s.force[static_cast<Eigen::Index>(i)]);
      } else {
        row.emplace_back(std::string());
      }
    }
    if (std::isfinite(s.condition)) {
      row.emplace_back(s.condition);
    } else {
      row.emplace_back(std::string());
    }
    row.emplace_back(s.nearest);
    if (s.nearest.empty()) {
      row.emplace_back(std::string());
    } else {
      row.emplace_back(s.share);
    }
    const std::vector<std::string> broken = kinematics::limit_names(machine, s.violations);
    row.emplace_back(s.reached ? fmt::format("{}", fmt::join(broken, "; ")) : std::string("out of reach"));
    csv.add(row);
  }
  return csv.text();
}

std::string move_page(const machine::AnyMachine& machine, const motion::PosePath& path, const MoveResult& run,
                      const MotionQuestion& question, const std::string& version, const std::string& command) {
  report::Report page = begun(machine, question, run.ok(), version);
  constexpr std::size_t kShown = 8;
  for (std::size_t k = 0; k < std::min(kShown, run.violations.size()); ++k) {
    const motion::MoveViolation& v = run.violations[k];
    const std::string when =
        std::isfinite(v.t) ? fmt::format("After {} s at", report::fixed(v.t, 3)) : std::string("At");
    const std::string line = v.line > 0 ? fmt::format(" (line {})", v.line) : std::string();
    page.add_verdict(report::Verdict::bad,
                     fmt::format("{} {}, {}, {} mm{}: {}.", when, report::fixed(to_mm(v.p.x()), 2),
                                 report::fixed(to_mm(v.p.y()), 2), report::fixed(to_mm(v.p.z()), 2), line, v.detail));
  }
  if (run.violations.size() > kShown) {
    page.add_text(
        fmt::format("{} further limits are broken; the table below has them all.", run.violations.size() - kShown));
  }
  page.add_text("This answers for the limits in the table below along this path, and for what is named as judged.");
  std::vector<report::KeyFigure> figures{
      {figure(to_mm(run.length), 1), "mm", "path length of the tool", report::Verdict::neutral}};
  if (std::isfinite(run.time)) figures.push_back({report::fixed(run.time, 4), "s", "time", report::Verdict::neutral});
  figures.push_back({figure(to_mm(run.tool_speed), 1), "mm/s", "largest speed of the tip", report::Verdict::neutral});
  page.add_key_figures(figures);
  if (!run.binding.empty()) {
    std::vector<std::string> items;
    items.reserve(run.binding.size());
    for (const auto& [name, share] : run.binding)
      items.push_back(fmt::format("{}: {} % of the time", name, report::fixed(100 * share, 0)));
    page.add_text("What limits the motion (met to 1 %):");
    page.add_list(items);
  }
  report::Scene scene = scene_of(machine, run), film = film_of(machine, run, scene);
  const bool hangs = kinematics::hangs_down(machine);
  if (hangs) {
    hang(scene);
    hang(film);
  }
  page.add_scene(scene,
                 hangs ? "The base is above: z of the machine points down. What breaks a limit is red."
                       : "What breaks a limit is red.",
                 &film);

  if (!run.violations.empty()) {
    report::Table broken;
    broken.caption = "What is broken, where it begins.";
    broken.columns = {
        {"time", "s", 3}, {"path length", "mm", 1}, {"line", "", 0}, {"limit", "", -1}, {"figures", "", -1}};
    for (const motion::MoveViolation& v : run.violations) {
      broken.rows.push_back(
          {v.t, to_mm(v.length), static_cast<double>(v.line), v.limit, v.detail == v.limit ? std::string() : v.detail});
    }
    page.add_table(broken);
  }
  add_limits(page, question);
  if (!run.samples.empty()) {
    page.add_section("Drives");
    for (const bool turns : {false, true}) {
      const bool any =
          std::any_of(run.drives.begin(), run.drives.end(), [&](const MoveDrive& d) { return d.turns == turns; });
      if (!any) continue;
      page.add_figure(drives_plot(run, "position", turns, "", &MoveSample::q), "Position of the drives.");
      page.add_figure(drives_plot(run, "speed", turns, "/s", &MoveSample::speed), "Speed of the drives.");
      page.add_figure(drives_plot(run, "acceleration", turns, "/s²", &MoveSample::acceleration),
                      "Acceleration of the drives.");
      page.add_figure(drives_plot(run, "jerk", turns, "/s³", &MoveSample::jerk), "Jerk of the drives.");
    }
    if (run.drives.front().force) {
      for (const bool turns : {false, true}) {
        const bool any =
            std::any_of(run.drives.begin(), run.drives.end(), [&](const MoveDrive& d) { return d.turns == turns; });
        if (any) page.add_figure(force_plot(run, turns), turns ? "Torques of the drives." : "Forces of the drives.");
      }
    }
    page.add_section("Tool");
    page.add_figure(pose_plot(run, false), "Coordinates of the tool.");
    if (std::any_of(path.stretches.begin(), path.stretches.end(), [](const motion::Stretch& s) { return s.turns(); })) {
      page.add_figure(pose_plot(run, true), "Angles of the tool, R = R_z(C) R_y(B) R_x(A).");
    }
    page.add_figure(size_plot(run, "speed", "mm/s", &MoveSample::v), "Speed of the tool.");
    page.add_figure(size_plot(run, "acceleration", "mm/s²", &MoveSample::a), "Acceleration of the tool.");
    page.add_figure(size_plot(run, "jerk", "mm/s³", &MoveSample::j), "Jerk of the tool.");
  }
  page.add_section("Peaks");
  report::Table table;
  table.caption = "Largest absolute values.";
  table.columns = {{"", "", -1},       {"least", "", 3},           {"largest", "", 3},
                   {"speed", "/s", 1}, {"acceleration", "/s²", 0}, {"jerk", "/s³", 0},
                   {"unit", "", -1}};
  const double none = std::numeric_limits<double>::quiet_NaN();
  table.rows.push_back({std::string("tool"), none, none, to_mm(run.tool_speed), to_mm(run.tool_acceleration),
                        to_mm(run.tool_jerk), std::string("mm")});
  for (std::size_t i = 0; i < run.drives.size(); ++i) {
    const MoveDrive& d = run.drives[i];
    table.rows.push_back({fmt::format("drive {}", i + 1), shown(d, d.low), shown(d, d.high), shown(d, d.speed),
                          shown(d, d.acceleration), shown(d, d.jerk), std::string(unit_of(d))});
  }
  page.add_table(table);
  if (!command.empty()) {
    page.add_section("Inputs");
    page.add_code("The command that made this page", command, false);
  }
  return page.to_html();
}

}  // namespace polypod::pages
