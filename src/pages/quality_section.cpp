// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "quality_section.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "polypod/core/range_text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using quality::Survey;
using quality::SurveyOptions;
using units::to_mm;

/// The box that is looked at: the given one, or one round the workspace.
Result<std::array<Vec3, 2>> box_of(const AnyMachine& machine, const SurveyOptions& options) {
  if (options.box) return *options.box;
  POLYPOD_ASSIGN(box, workspace::extent(machine, options.workspace, false));
  if (box.empty()) return fail("QP100", "no point is reachable from all required directions", {}, "ask for less tilt");
  return std::array{box.low, box.high};
}

/// i, j and k of a point of a grid.
std::array<int, 3> numbers_of(const workspace::Grid& grid, std::size_t at) {
  const auto nx = static_cast<std::size_t>(grid.points[0]), ny = static_cast<std::size_t>(grid.points[1]);
  return {static_cast<int>(at % nx), static_cast<int>(at / nx % ny), static_cast<int>(at / (nx * ny))};
}

/// The two axes of a plane.
std::array<int, 2> axes_of(int normal) {
  return normal == 0 ? std::array{1, 2} : normal == 1 ? std::array{0, 2} : std::array{0, 1};
}

/// Points without a value get the mean of their neighbours': beyond its reach an arm has no joints and so no errors,
/// but a map should run up to the border.
std::vector<double> with_neighbours(const workspace::Grid& grid, const std::vector<double>& values) {
  std::vector<double> out = values;
  for (std::size_t at = 0; at < values.size(); ++at) {
    if (!std::isnan(values[at])) continue;
    const std::array<int, 3> n = numbers_of(grid, at);
    double sum = 0;
    int count = 0;
    for (int k = std::max(0, n[2] - 1); k <= std::min(grid.points[2] - 1, n[2] + 1); ++k)
      for (int j = std::max(0, n[1] - 1); j <= std::min(grid.points[1] - 1, n[1] + 1); ++j)
        for (int i = std::max(0, n[0] - 1); i <= std::min(grid.points[0] - 1, n[0] + 1); ++i) {
          const double v = values[grid.index(i, j, k)];
          if (std::isnan(v)) continue;
          sum += v;
          ++count;
        }
    if (count > 0) out[at] = sum / count;
  }
  return out;
}

/// The numbers of the first and last column and row of a section that are worth showing: those of its points and one
/// beyond.
std::pair<std::array<int, 2>, std::array<int, 2>> shown_part(const QualitySection& s, std::size_t u, std::size_t v) {
  const auto& points = s.fields.survey.grid.points;
  std::array<int, 2> low{points[u], points[v]}, high{0, 0};
  for (const std::size_t at : s.fields.survey.inside) {
    const std::array<int, 3> n = numbers_of(s.fields.survey.grid, at);
    low = {std::min(low[0], n[u]), std::min(low[1], n[v])};
    high = {std::max(high[0], n[u]), std::max(high[1], n[v])};
  }
  low = {std::max(low[0] - 1, 0), std::max(low[1] - 1, 0)};
  high = {std::min(high[0] + 1, points[u] - 1), std::min(high[1] + 1, points[v] - 1)};
  return {low, high};
}

}  // namespace

std::vector<char> add_neighbours(Survey& survey) {
  const workspace::Grid& grid = survey.grid;
  std::vector<char> mark(grid.size(), 0);  // 1: a neighbour, 2: inside
  const auto [nx, ny, nz] = grid.points;
  for (const std::size_t at : survey.inside) {
    const std::array<int, 3> n = numbers_of(grid, at);
    for (int k = std::max(0, n[2] - 1); k <= std::min(nz - 1, n[2] + 1); ++k)
      for (int j = std::max(0, n[1] - 1); j <= std::min(ny - 1, n[1] + 1); ++j)
        for (int i = std::max(0, n[0] - 1); i <= std::min(nx - 1, n[0] + 1); ++i)
          mark[grid.index(i, j, k)] = std::max(mark[grid.index(i, j, k)], char{1});
    mark[at] = 2;
  }
  survey.inside.clear();
  std::vector<char> within;
  for (std::size_t at = 0; at < mark.size(); ++at) {
    if (mark[at] == 0) continue;
    survey.inside.push_back(at);
    within.push_back(mark[at] == 2 ? 1 : 0);
  }
  return within;
}

ValueName name_of(QualityValue value) {
  switch (value) {
    case QualityValue::position:
      return {"error", "error of the tip", "mm"};
    case QualityValue::orientation:
      return {"error", "error of the orientation", "mrad"};
    case QualityValue::condition:
      return {"κ", "condition number κ", ""};
    case QualityValue::sigma_min:
      return {"σ", "smallest singular value", ""};
    case QualityValue::determinant:
      break;
  }
  return {"|det|", "determinant", ""};
}

std::string plane_name(const QualitySection& s) {
  const auto [u, v] = axes_of(s.axis);
  const machine::Task& task = s.fields.survey.task;
  const std::string plane = workspace::coordinate_name(task, u) + workspace::coordinate_name(task, v);
  if (workspace::coordinates_of_points(task) < 3) return plane;
  const char* unit = workspace::unit_of(task, s.axis);
  return fmt::format("{} at {} = {} {}", plane, workspace::coordinate_name(task, s.axis),
                     report::fixed(units::to_user(s.at, unit), 1), unit);
}

Result<QualitySection> survey_section(const AnyMachine& machine, const SurveyOptions& options,
                                      const QualityQuestion& question, int axis, double at, int resolution) {
  if (resolution < 8 || resolution > 512) {
    return fail("WS130",
                fmt::format("a resolution of {} points: must be {}", resolution, config::in_words({8, 512}, "points")));
  }
  POLYPOD_ASSIGN(box, box_of(machine, options));
  const machine::Task task = kinematics::task(machine);
  const bool whole = workspace::coordinates_of_points(task) < 3;  // the only plane there is
  const auto place = [&](double x) { return units::to_user(x, whole ? "mm" : workspace::unit_of(task, axis)); };
  const char* unit = whole ? "mm" : workspace::unit_of(task, axis);
  if (!whole && !(at >= box[0][axis] && at <= box[1][axis])) {
    return fail("QP100",
                fmt::format("the plane {} = {:.6g} {} misses what is looked at, which lies from {:.6g} to {:.6g} {}",
                            workspace::coordinate_name(task, axis), place(at), unit, place(box[0][axis]),
                            place(box[1][axis]), unit));
  }
  SurveyOptions flat = options;
  flat.progress = nullptr;
  flat.resolution = resolution;
  if (!whole) box[0][axis] = box[1][axis] = at;
  flat.box = box;
  QualitySection out{axis, at, {}, {}, {}, false};
  auto survey = quality::survey(machine, flat);
  if (!survey && survey.error().id == "QU110") {
    return fail(
        "QP100",
        fmt::format("the plane {} misses the workspace",
                    whole ? "of the task's coordinates"
                          : fmt::format("{} = {:.6g} {}", workspace::coordinate_name(task, axis), place(at), unit)),
        {}, "move the plane, ask for less tilt, or raise the resolution");
  }
  if (!survey) return tl::unexpected(survey.error());
  out.fields.survey = std::move(*survey);
  out.within = add_neighbours(out.fields.survey);
  POLYPOD_TRY(fill_fields(machine, flat, question, out.fields));
  workspace::FieldOptions field_options;
  field_options.tilt = false;
  POLYPOD_ASSIGN(section, workspace::section(machine, options.workspace, {at * Vec3::Unit(axis), Vec3::Unit(axis)},
                                             resolution, field_options));
  out.border = std::move(section.border);
  out.hangs = kinematics::hangs_down(machine);
  return out;
}

Range range_of(std::vector<double> values) {
  std::erase_if(values, [](double v) { return !std::isfinite(v); });
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  constexpr double kNearlyAll = 0.97, kFar = 1.6;
  const double most = values[static_cast<std::size_t>(kNearlyAll * static_cast<double>(values.size() - 1))];
  const double span = std::max(most - values.front(), 1e-9 * std::abs(most));
  if (values.back() - values.front() > kFar * span) return {values.front(), values.front() + span, true};
  return {values.front(), values.back(), false};
}

std::vector<double> means_within(const QualitySection& s, QualityValue value) {
  const std::vector<double> all = shown_means(s.fields, value);
  std::vector<double> out;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (s.within[i] != 0) out.push_back(all[i]);
  return out;
}

report::HeatMap map_of(const QualitySection& s, QualityValue value, const Range& range) {
  const workspace::Grid& grid = s.fields.survey.grid;
  const auto [u, v] = axes_of(s.axis);
  const machine::Task& task = s.fields.survey.task;
  const char *of_u = workspace::unit_of(task, u), *of_v = workspace::unit_of(task, v);
  const auto at = [u = u, v = v, of_u, of_v](const Vec3& p) {
    return report::Point{units::to_user(p[u], of_u), units::to_user(p[v], of_v)};
  };
  const std::size_t iu = static_cast<std::size_t>(u), iv = static_cast<std::size_t>(v);
  const ValueName name = name_of(value);
  const auto [low, high] = shown_part(s, iu, iv);
  const auto corner = [&](const std::array<int, 2>& c) {
    std::array<int, 3> out{0, 0, 0};
    out[iu] = c[0];
    out[iv] = c[1];
    return out;
  };
  const auto a = corner(low), b = corner(high);
  const report::Point first = at(grid.at(a[0], a[1], a[2])), last = at(grid.at(b[0], b[1], b[2]));
  report::HeatMap map;
  map.title = fmt::format("Mean {} over {}", name.words, plane_name(s));
  map.x = {workspace::coordinate_name(task, u), of_u, first.x, last.x, false};
  map.y = {workspace::coordinate_name(task, v), of_v, first.y, last.y, false};
  map.equal_scales = std::string_view(of_u) == of_v;
  map.y.downwards = s.hangs && task.places() && v == 2;
  map.columns = high[0] - low[0] + 1;
  map.rows = high[1] - low[1] + 1;
  std::vector<double> over(grid.size(), std::numeric_limits<double>::quiet_NaN());
  const std::vector<double> values = shown_means(s.fields, value);
  for (std::size_t i = 0; i < values.size(); ++i) {
    // A singular pose has no finite value, but its colour.
    over[s.fields.survey.inside[i]] = std::isinf(values[i]) ? 2 * range.high : values[i];
  }
  over = with_neighbours(grid, over);
  for (int j = low[1]; j <= high[1]; ++j)
    for (int i = low[0]; i <= high[0]; ++i) {
      const auto c = corner({i, j});
      map.values.push_back(over[grid.index(c[0], c[1], c[2])]);
    }
  map.label = name.symbol;
  map.unit = name.unit;
  map.min = range.low;
  map.max = range.high;
  map.levels = 9;
  for (const workspace::Loop& loop : s.border) {
    report::Polyline line;
    for (const Vec3& p : loop) line.points.push_back(at(p));
    if (line.points.empty()) continue;
    map.clip.push_back(line.points);
    line.points.push_back(line.points.front());
    line.colour = report::Colour::ink;
    line.stroke = 1.6;
    map.lines.push_back(std::move(line));
  }
  return map;
}

Result<report::Figure> quality_section(const AnyMachine& machine, const SurveyOptions& options,
                                       const QualityQuestion& question, int axis, double at, int resolution,
                                       QualityValue value) {
  POLYPOD_ASSIGN(section, survey_section(machine, options, question, axis, at, resolution));
  return report::Figure(map_of(section, value, range_of(means_within(section, value))));
}

}  // namespace polypod::pages
