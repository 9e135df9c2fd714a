// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The page of a workspace over the coordinates of a task that does not hold x, y, z.
#include "polypod/workspace/region.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "machine_inputs.hpp"
#include "machine_lines.hpp"
#include "moving_machine.hpp"
#include "parts.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/pages/workspace.hpp"
#include "polypod/report/html.hpp"
#include "workspace_section.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using report::number;
using report::Verdict;
using workspace::Options;
using workspace::Section;
using workspace::Volume;

/// "z, A and B".
std::string names_of(const machine::Task& task) {
  std::string out;
  for (int i = 0; i < task.size(); ++i) {
    if (i > 0) out += i + 1 == task.size() ? " and " : ", ";
    out += machine::name_of(task[i]);
  }
  return out;
}

/// To four digits.
std::string measure(double value) {
  const double unit = value > 0 ? std::pow(10.0, std::floor(std::log10(value)) - 3) : 1;
  return report::fixed(unit * std::round(value / unit), std::max(0, -static_cast<int>(std::floor(std::log10(unit)))));
}
/// "mm² deg" of "mm2 deg".
std::string powers(std::string unit) {
  for (const auto& [digit, raised] : {std::pair{"2", "²"}, std::pair{"3", "³"}}) {
    if (const auto at = unit.find(digit); at != std::string::npos) unit.replace(at, 1, raised);
  }
  return unit;
}

std::string size_in_words(const machine::Task& task, const Volume& region) {
  const workspace::Region size = workspace::region_of(task, region.volume, region.lower, region.upper);
  return fmt::format(
      fmt::runtime(region.proven ? "Of the coordinates {}, a region of {} {} is reached: certainly between {} and {}."
                                 : "Of the coordinates {}, a sample finds a region of {} {} to be reached, with 95 % "
                                   "between {} and {}. Nothing is proven: no bounds are known for the inverse of this "
                                   "machine."),
      names_of(task), measure(size.measure), powers(size.unit), measure(size.lower), measure(size.upper));
}

class RegionPart {
 public:
  RegionPart(report::Report& report, const AnyMachine& machine, const Options& options, const Volume& region,
             const WorkspacePageOptions& page)
      : machine_(machine),
        options_(options),
        region_(region),
        page_(page),
        task_(kinematics::task(machine)),
        size_(workspace::region_of(task_, region.volume, region.lower, region.upper)),
        report_(report) {
    options_.progress = nullptr;
    options_.keep_cells = false;
  }

  Result<Entries> add() {
    if (!region_.reached && (region_.empty || !region_.proven)) {
      return fail("WS131", "nothing was found to be reached: there is nothing to show");
    }
    POLYPOD_TRY(cut());
    answer();
    machine_at_home();
    sections();
    POLYPOD_TRY(limits());
    return inputs();
  }

 private:
  [[nodiscard]] const char* unit(int coordinate) const { return workspace::unit_of(task_, coordinate); }
  [[nodiscard]] double shown(int coordinate, double value) const { return units::to_user(value, unit(coordinate)); }

  /// Sections through the place that is the farthest inside the limits of the first one.
  Status cut() {
    const int count = workspace::coordinates_of_points(task_);
    if (count < 2) return {};
    const Vec3 low = region_.reached ? region_.reached->min : region_.min,
               high = region_.reached ? region_.reached->max : region_.max;
    Vec3 middle = 0.5 * (low + high);
    workspace::FieldOptions field_options;
    field_options.tilt = false;
    field_options.progress = [this](double share) {
      if (page_.progress) page_.progress("sections", share);
    };
    std::set<int> seen;
    for (int normal = 2; normal >= (count == 2 ? 2 : 0); --normal) {
      POLYPOD_ASSIGN(
          s, workspace::section(machine_, options_, {middle, Vec3::Unit(normal)}, page_.resolution, field_options));
      if (sections_.empty()) {
        const auto best = std::max_element(s.field.margin.begin(), s.field.margin.end());
        if (*best >= 0) middle = s.field.grid.at(static_cast<std::size_t>(best - s.field.margin.begin()));
      }
      collect(seen, s);
      sections_.push_back(std::move(s));
    }
    kinds_ = Kinds(machine_, seen);
    return {};
  }

  void answer() {
    report_.add_section("What is reached");
    const std::string missed = missed_in_words(region_);
    report_.add_verdict(Verdict::neutral, size_in_words(task_, region_) + missed);
    report_.add_text(what_is_answered() + (task_.turns() ? " Angles within 90 deg of home were looked at." : ""));
    const std::string beyond =
        beyond_in_words(workspace::beyond_singular(machine_, options_, region_), "points drawn from it");
    if (!beyond.empty()) report_.add_text(beyond);
    report_.add_key_figures(
        {{measure(size_.measure), unit_,
          fmt::format(fmt::runtime(region_.proven ? "size, ± {} % proven" : "size, ± {} % (95 % of a sample)"),
                      number(50 * (size_.upper - size_.lower) / std::max(size_.measure, 1e-30), 2)),
          Verdict::neutral}});
    Entries extents;
    for (int i = 0; i < task_.size(); ++i)
      extents.emplace_back(machine::name_of(task_[i]), extent_text(region_, i, unit(i)));
    report_.add_definitions(extents);
  }

  void machine_at_home() {
    const MachineAt at = pages::machine_at(machine_, start_pose(machine_));
    if (at.lines.empty()) return;
    report::Scene scene = machine_scene(machine_, at);
    report::Scene turns = scene;
    const MovingMachine moving(machine_, at.X, at.q);
    turns.lines = moving.lines();
    report::Point3 low{0, 0, 0}, high{0, 0, 0};
    double tilt = 0;
    for (int i = 0; i < task_.size(); ++i) {
      const double from = shown(i, region_.min[i]), to = shown(i, region_.max[i]);
      if (task_.is_angle(i)) {
        tilt = std::max({tilt, std::abs(region_.min[i]), std::abs(region_.max[i])});
        continue;
      }
      const int axis = static_cast<int>(task_[i]);
      (axis == 0 ? low.x : axis == 1 ? low.y : low.z) = from;
      (axis == 0 ? high.x : axis == 1 ? high.y : high.z) = to;
    }
    constexpr int kPictures = 31;
    turns.frames = moving.sweeps(low, high, tilt, kPictures);
    if (kinematics::hangs_down(machine_)) hang(turns);
    report_.add_section("The machine in space");
    report_.add_scene(scene,
                      std::string("The machine at home; coordinates and joints turn it.") +
                          (kinematics::hangs_down(machine_) ? " The base is above: z of the machine points down." : ""),
                      &turns);
  }

  void sections() {
    if (sections_.empty()) return;
    report_.add_section("Sections of the workspace");
    report_.add_text(sections_.size() == 1
                         ? "The deeper the colour, the farther the machine is inside the limits; the colour says which "
                           "limit is the nearest."
                         : "Three sections, through the place of the first one that is the farthest inside the limits. "
                           "The deeper the colour, the farther the machine is inside the limits; the colour says which "
                           "limit is the nearest.");
    std::vector<std::pair<std::string, report::Figure>> panels;
    for (const Section& s : sections_) {
      const int normal = axis_of(s.plane.normal.normalized());
      const char *of_u = workspace::unit_along(task_, s.field.grid.step[0]),
                 *of_v = workspace::unit_along(task_, s.field.grid.step[1]);
      const double area = s.area * units::to_user(1, of_u) * units::to_user(1, of_v);
      const std::string place = sections_.size() == 1
                                    ? ""
                                    : fmt::format("{} = {} {}: ", machine::name_of(task_[normal]),
                                                  number(shown(normal, s.plane.point[normal]), 3), unit(normal));
      panels.emplace_back(
          fmt::format("{}{} {}", place, measure(area), powers(workspace::unit_of_product({of_u, of_v}))),
          section_map(options_, s, kinds_, false));
    }
    report_.add_figure_grid(sections_.size() == 1 ? 1 : 2, panels,
                            region_.proven ? "Areas are sampled inside the black line; the size above is proven."
                                           : "Areas are those inside the black line.");
  }

  Status limits() {
    if (!region_.proven || kinds_.names().empty()) return {};
    const machine::LimitTable table = kinematics::limit_table(machine_);
    const auto count = static_cast<int>(table.size());
    report::Table rows;
    rows.caption = "What is reached without a limit";
    rows.columns = {{"limit", ""}, {"region without it", unit_}, {"gain", "%"}};
    std::size_t done = 0;
    for (const std::string& kind : kinds_.names()) {
      workspace::LimitBits bits = 0;
      bool holds_reach = false;
      for (int i = 0; i < count; ++i) {
        if (workspace::limit_kind(machine_, i) != kind) continue;
        bits |= workspace::LimitBits{1} << i;
        holds_reach = holds_reach || table[static_cast<std::size_t>(i)].holds_reach;
      }
      if (page_.progress)
        page_.progress("limits", static_cast<double>(done++) / static_cast<double>(kinds_.names().size()));
      if (bits == 0 || (holds_reach && !kinematics::takes_any_posture(machine_))) {
        rows.rows.push_back({kind, "–", "–"});
        continue;
      }
      Options without = options_;
      without.limits &= ~bits;
      without.relative_tolerance = std::max(without.relative_tolerance, 0.02);
      constexpr std::int64_t kCells = 30'000;
      without.max_cells = kCells;
      without.bounds_tolerance = 0;
      POLYPOD_ASSIGN(v, workspace::volume(machine_, without));
      const workspace::Region size = workspace::region_of(task_, v.volume, v.lower, v.upper);
      const double low = 100 * (size.lower / std::max(size_.upper, 1e-30) - 1);
      const double high = 100 * (size.upper / std::max(size_.lower, 1e-30) - 1);
      rows.rows.push_back(
          {kind, fmt::format("{}\u00a0…\u00a0{}", measure(size.lower), measure(size.upper)),
           fmt::format("{}\u00a0…\u00a0{}", report::fixed(std::max(0.0, low), 1), report::fixed(high, 1))});
    }
    report_.add_section("Which limit cuts how much");
    report_.add_table(rows);
    report_.add_text(
        "The region without a limit is proven, with few boxes: the gain lies between the two numbers. Limits that make "
        "the "
        "machine's reach, such as the lengths of its legs, have none.");
    return {};
  }

  [[nodiscard]] Entries inputs() const {
    Entries entries{
        {"tolerance of the size", fmt::format("{:.6g} %", 100 * options_.relative_tolerance)},
        {region_.proven ? "boxes examined" : "points examined", report::fixed(static_cast<double>(region_.points), 0)},
        {"leg against leg", options_.interference ? "checked" : "not checked"},
        {"points a side of a section", report::fixed(page_.resolution, 0)}};
    std::set<std::string> off;
    for (int i = 0; i < static_cast<int>(kinematics::limit_table(machine_).size()); ++i)
      if ((~options_.limits >> i & 1U) != 0) off.insert(workspace::limit_kind(machine_, i));
    for (const std::string& kind : off) entries.emplace_back("switched off", kind);
    return entries;
  }

  const AnyMachine& machine_;
  Options options_;
  const Volume& region_;
  const WorkspacePageOptions& page_;
  machine::Task task_;
  workspace::Region size_;
  std::string unit_ = powers(size_.unit);
  report::Report& report_;
  std::vector<Section> sections_;
  Kinds kinds_{machine_, {}};
};

}  // namespace

std::string region_in_words(const AnyMachine& machine, const Options& options, const Volume& region) {
  if (region.empty) return "No coordinates of the task are reachable. This is proven.";
  if (!region.proven && !region.reached) return "A sample found no coordinates of the task that are reached.";
  const std::string beyond =
      beyond_in_words(workspace::beyond_singular(machine, options, region), "points drawn from it");
  const machine::Task task = kinematics::task(machine);
  return size_in_words(task, region) + (task.turns() ? " Angles within 90 deg of home were looked at." : "") +
         (beyond.empty() ? "" : " " + beyond);
}

Result<std::string> region_page(const AnyMachine& machine, const Options& options, const Volume& region,
                                const WorkspacePageOptions& page) {
  const std::string names = names_of(kinematics::task(machine));
  report::Report report(fmt::format("Workspace of {}", machine::name_of(machine)),
                        fmt::format("Which {} the tool reaches, and what stops it beyond", names),
                        facts_of(machine, page, {"coordinates of the task", names}));
  POLYPOD_ASSIGN(inputs, add_region(report, machine, options, region, page));
  add_inputs(report, machine, inputs, page.command);
  return report.to_html();
}

std::pair<std::string, std::string> region_figure(const machine::Task& task, const Volume& region) {
  const workspace::Region size = workspace::region_of(task, region.volume, region.lower, region.upper);
  return {measure(size.measure), powers(size.unit)};
}

Result<Entries> add_region(report::Report& report, const AnyMachine& machine, const Options& options,
                           const Volume& region, const WorkspacePageOptions& page) {
  return RegionPart(report, machine, options, region, page).add();
}

}  // namespace polypod::pages
