// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "workspace_section.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/report/html.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::pages {

using report::number;
using report::Polyline;
using units::to_deg;
using units::to_mm;
using workspace::Field;
using workspace::Options;
using workspace::Section;

bool without_tilt(const Section& s) {
  return s.field.tilt.empty();
}

void collect(std::set<int>& limits, const Section& s) {
  for (std::size_t i = 0; without_tilt(s) && i < s.field.margin.size(); ++i)
    if (s.field.margin[i] >= 0) limits.insert(s.field.limit[i]);
  for (std::size_t i = 0; i < s.field.tilt.size(); ++i)
    if (s.field.tilt[i] >= 0) limits.insert(s.field.tilt_limit[i]);
}

/// The axis of M along which a unit vector points, or -1.
int axis_of(const Vec3& u) {
  for (int k = 0; k < 3; ++k)
    if (u.normalized()[k] > 1 - 1e-9) return k;
  return -1;
}

namespace {

/// The tilt in deg, continued below 0 where R = 1 is out of reach, in proportion to the margin there, so that lines of
/// equal tilt run smoothly into the border.
std::vector<double> continued_tilt(const Field& f) {
  std::vector<double> out(f.tilt.size());
  if (out.empty()) return out;
  const auto [nu, nv, one] = f.grid.points;
  (void)one;
  double steepest = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = to_deg(f.tilt[i]);
    if (f.tilt[i] > 0 && f.upright[i] > 0) steepest = std::max(steepest, out[i] / f.upright[i]);
  }
  if (steepest == 0) steepest = 1;
  for (int j = 0; j < nv; ++j) {
    for (int i = 0; i < nu; ++i) {
      const std::size_t at = f.grid.index(i, j, 0);
      if (f.tilt[at] >= 0) continue;
      double sum = 0;
      int count = 0;
      for (int dj = -1; dj <= 1; ++dj)
        for (int di = -1; di <= 1; ++di) {
          if (i + di < 0 || j + dj < 0 || i + di >= nu || j + dj >= nv) continue;
          const std::size_t near = f.grid.index(i + di, j + dj, 0);
          if (f.tilt[near] <= 0 || !(f.upright[near] > 0)) continue;
          sum += to_deg(f.tilt[near]) / f.upright[near];
          ++count;
        }
      const double slope = count > 0 ? sum / count : steepest;
      out[at] = std::min(-1e-6, std::max(-90.0, slope * f.upright[at]));
    }
  }
  return out;
}

std::string axis_name(const machine::Task& task, const Vec3& u) {
  const int axis = axis_of(u);
  if (axis >= 0) return machine::name_of(task[axis]);
  const Vec3 n = u.normalized();
  return fmt::format("along ({}, {}, {})", number(n.x(), 2), number(n.y(), 2), number(n.z(), 2));
}

}  // namespace

report::HeatMap section_map(const Options& options, const Section& s, const Kinds& kinds, bool hangs) {
  const Field& f = s.field;
  report::HeatMap map;
  const Vec3 u = f.grid.step[0].normalized(), v = f.grid.step[1].normalized();
  const char *of_u = workspace::unit_along(s.task, u), *of_v = workspace::unit_along(s.task, v);
  const auto at = [&](const Vec3& p) {
    return report::Point{units::to_user(u.dot(p), of_u), units::to_user(v.dot(p), of_v)};
  };
  // Only what is reached, and two points beyond it.
  int low[2] = {f.grid.points[0], f.grid.points[1]}, high[2] = {0, 0};
  for (int j = 0; j < f.grid.points[1]; ++j) {
    for (int i = 0; i < f.grid.points[0]; ++i) {
      const std::size_t k = f.grid.index(i, j, 0);
      if ((without_tilt(s) || f.tilt[k] < 0) && f.margin[k] < 0) continue;
      low[0] = std::min(low[0], i);
      low[1] = std::min(low[1], j);
      high[0] = std::max(high[0], i);
      high[1] = std::max(high[1], j);
    }
  }
  constexpr int kAround = 2;
  for (std::size_t k = 0; k < 2; ++k) {
    const int most = f.grid.points[k] - 1;
    if (low[k] > high[k]) {  // nothing at all: the whole grid
      low[k] = 0;
      high[k] = most;
    }
    low[k] = std::max(0, low[k] - kAround);
    high[k] = std::min(most, high[k] + kAround);
  }
  const report::Point first = at(f.grid.at(low[0], low[1], 0)), last = at(f.grid.at(high[0], high[1], 0));
  map.title =
      without_tilt(s) ? "Distance inside the limits over a section" : "Largest tilt at every azimuth over a section";
  map.x = {axis_name(s.task, u), of_u, first.x, last.x, false};
  map.y = {axis_name(s.task, v), of_v, first.y, last.y, false};
  map.equal_scales = std::string_view(of_u) == of_v;
  // The machine hangs, as in its picture.
  map.y.downwards = hangs && s.task.places() && v.isApprox(Vec3::UnitZ());
  map.columns = high[0] - low[0] + 1;
  map.rows = high[1] - low[1] + 1;
  const std::vector<double> tilt = continued_tilt(f);
  for (int j = low[1]; j <= high[1]; ++j) {
    for (int i = low[0]; i <= high[0]; ++i) {
      const std::size_t k = f.grid.index(i, j, 0);
      map.values.push_back(without_tilt(s) ? to_mm(f.margin[k]) : tilt[k]);
      map.kind.push_back(kinds.of(without_tilt(s) ? f.limit[k] : f.tilt_limit[k]));
    }
  }
  map.kinds = kinds.names();
  map.label = without_tilt(s) ? "inside by" : "tilt";
  map.unit = without_tilt(s) ? "mm" : "deg";
  map.min = 0;
  map.blank_below = true;
  map.levels = 9;
  const bool upright_only = !options.directions.is_ranges() && options.directions.tilt == 0;
  for (const workspace::Loop& loop : s.border) {
    Polyline line;
    for (const Vec3& p : loop) line.points.push_back(at(p));
    if (!line.points.empty()) line.points.push_back(line.points.front());
    line.colour = report::Colour::ink;
    line.stroke = upright_only ? 1.2 : 2.4;
    map.lines.push_back(std::move(line));
  }
  return map;
}

std::vector<std::pair<std::string, std::string>> facts_of(const machine::AnyMachine& machine,
                                                          const WorkspacePageOptions& page,
                                                          const std::pair<std::string, std::string>& own) {
  std::vector<std::pair<std::string, std::string>> out{
      {"machine", page.machine.empty() ? machine::name_of(machine) : page.machine},
      {"family", machine::family_of(machine)},
      own};
  for (const std::string& set : page.sets) out.emplace_back("changed", set);
  if (!page.version.empty()) out.emplace_back("made with", "Polypod " + page.version);
  return out;
}

std::string what_is_answered() {
  return "This answers for the limits of the machine named on this page, for a machine at rest that is built as its "
         "file "
         "says: not for collisions with tool holder, workpiece and surroundings, not for stiffness and forces, and not "
         "for "
         "the accuracy of what is reached.";
}

std::string missed_in_words(const workspace::Volume& volume) {
  return volume.converged ? ""
         : volume.proven  ? " The bounds did not come within the tolerance that was asked for."
                          : " The sample did not come within the tolerance that was asked for.";
}

std::string beyond_in_words(const workspace::BeyondSingular& b, const char* looked_at) {
  if (b.beyond == 0) return "";
  return fmt::format(
      "{} % of {} {} lie beyond a singular pose from home (type 2): the machine gets there only through a pose at "
      "which "
      "the drives do not constrain it. The figures include them; limits leave them out.",
      number(100.0 * static_cast<double>(b.beyond) / static_cast<double>(b.points), 2), b.points, looked_at);
}

}  // namespace polypod::pages
