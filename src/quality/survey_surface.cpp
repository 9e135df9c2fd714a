// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/survey_surface.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace polypod::quality {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

/// The number of a point of the survey's grid in the grid with a row more on every side.
std::size_t widened(const workspace::Grid& from, const workspace::Grid& to, std::size_t at) {
  const std::size_t nx = index(from.points[0]), ny = index(from.points[1]);
  return to.index(static_cast<int>(at % nx) + 1, static_cast<int>(at / nx % ny) + 1,
                  static_cast<int>(at / (nx * ny)) + 1);
}

}  // namespace

Result<SurveyBorder> survey_border(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options) {
  const workspace::Grid& inner = survey.grid;
  if (*std::min_element(inner.points.begin(), inner.points.end()) < 2) {
    return fail("WS130", "a surface needs a survey of at least 2 points in each direction");
  }
  SurveyBorder out;
  workspace::Grid& grid = out.field.grid;
  grid = inner;
  grid.origin -= inner.step[0] + inner.step[1] + inner.step[2];
  for (int& n : grid.points) n += 2;
  out.number.assign(grid.size(), -1);
  out.field.margin.assign(grid.size(), 0.0);
  out.field.limit.assign(grid.size(), -1);
  workspace::FieldOptions field_options;
  field_options.tilt = false;
  POLYPOD_ASSIGN(field, workspace::field(machine, options.workspace, inner, field_options));
  for (std::size_t at = 0; at < inner.size(); ++at) {
    const std::size_t to = widened(inner, grid, at);
    out.field.margin[to] = field.margin[at];
    out.field.limit[to] = field.limit[at];
  }
  for (std::size_t i = 0; i < survey.inside.size(); ++i)
    out.number[widened(inner, grid, survey.inside[i])] = static_cast<int>(i);
  return out;
}

Result<workspace::Surface> surface_below(const AnyMachine& machine, const SurveyOptions& options,
                                         const SurveyBorder& border, const std::vector<double>& values, double below) {
  const auto value = [&](std::size_t at) { return border.number[at] < 0 ? kNone : values[index(border.number[at])]; };
  workspace::Part part;
  for (std::size_t at = 0; at < border.number.size(); ++at) part.inside.push_back(value(at) <= below ? 1 : 0);
  part.share = [&](std::size_t in, std::size_t beyond) {
    if (border.number[beyond] < 0) return 0.0;  // beyond the box
    const double a = below - value(in), b = value(beyond) - below;
    return std::isfinite(b) && a + b > 0 ? a / (a + b) : 0.5;
  };
  return workspace::surface_of(machine, options.workspace, border.field, {}, &part);
}

std::vector<double> values_at(const SurveyBorder& border, const std::vector<double>& values,
                              const std::vector<Vec3>& points) {
  const workspace::Grid& grid = border.field.grid;
  Mat3 axes;
  for (int k = 0; k < 3; ++k) axes.col(k) = grid.step[index(k)];
  const Mat3 to_cells = axes.inverse();
  std::vector<double> out;
  out.reserve(points.size());
  for (const Vec3& p : points) {
    const Vec3 c = to_cells * (p - grid.origin);
    int low[3];
    double part[3];
    for (int k = 0; k < 3; ++k) {
      low[k] = std::clamp(static_cast<int>(std::floor(c[k])), 0, grid.points[index(k)] - 2);
      part[k] = std::clamp(c[k] - low[k], 0.0, 1.0);
    }
    double sum = 0, weight = 0;
    for (int corner = 0; corner < 8; ++corner) {
      double w = 1;
      int at[3];
      for (int k = 0; k < 3; ++k) {
        const bool upper = (corner >> k & 1) != 0;
        at[k] = low[k] + (upper ? 1 : 0);
        w *= upper ? part[k] : 1 - part[k];
      }
      const int number = border.number[grid.index(at[0], at[1], at[2])];
      if (number < 0 || w <= 0 || !std::isfinite(values[index(number)])) continue;
      sum += w * values[index(number)];
      weight += w;
    }
    out.push_back(weight > 0 ? sum / weight : kNone);
  }
  return out;
}

}  // namespace polypod::quality
