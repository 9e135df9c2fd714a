// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/quality.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <limits>

#include "polypod/core/units.hpp"
#include "polypod/quality/survey_surface.hpp"
#include "polypod/report/csv.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "quality_section.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using quality::Quantity;
using quality::SurveyOptions;
using units::to_mm;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// A column of the files: its name, its scale and its quantity.
struct Column {
  const char* quantity;
  const char* unit;
  double scale;
  const Quantity& values;

  [[nodiscard]] std::string mean_name() const { return fmt::format("{}{}", quantity, unit); }
  [[nodiscard]] std::string worst_name() const { return fmt::format("{}_worst{}", quantity, unit); }
};

std::array<Column, 5> columns_of(const QualityFields& f) {
  return {{{"position", "_mm", units::kMmPerMetre, f.errors.position},
           {"orientation", "_rad", 1, f.errors.orientation},
           {"condition", "", 1, f.dexterity.condition},
           {"sigma_min", "", 1, f.dexterity.sigma_min},
           {"determinant", "", 1, f.dexterity.determinant}}};
}

}  // namespace

Result<quality::ErrorField> errors_of(const AnyMachine& machine, const SurveyOptions& options,
                                      const QualityQuestion& question, const quality::Survey& survey) {
  return question.tolerances ? quality::tolerance_field(machine, survey, options, question.sizes, question.tolerance)
                             : quality::known_error_field(machine, survey, options, question.sizes);
}

Status fill_fields(const AnyMachine& machine, const SurveyOptions& options, const QualityQuestion& question,
                   QualityFields& fields) {
  POLYPOD_ASSIGN(errors, errors_of(machine, options, question, fields.survey));
  fields.errors = std::move(errors);
  POLYPOD_ASSIGN(dexterity, quality::dexterity_field(machine, fields.survey, options, question.length));
  fields.dexterity = std::move(dexterity);
  return {};
}

Result<QualityFields> quality_fields(const AnyMachine& machine, const SurveyOptions& options,
                                     const QualityQuestion& question) {
  QualityFields out;
  POLYPOD_ASSIGN(survey, quality::survey(machine, options));
  out.survey = std::move(survey);
  POLYPOD_TRY(fill_fields(machine, options, question, out));
  return out;
}

std::vector<double> shown_means(const QualityFields& f, QualityValue value) {
  const Column column = columns_of(f)[static_cast<std::size_t>(value)];
  const double scale = value == QualityValue::orientation ? units::kMradPerRad : column.scale;
  std::vector<double> out;
  out.reserve(column.values.mean.size());
  for (std::size_t i = 0; i < column.values.mean.size(); ++i) out.push_back(scale * column.values.mean[i]);
  return out;
}

std::string quality_csv(const QualityFields& f) {
  const auto columns = columns_of(f);
  std::vector<std::string> names;
  const int coordinates = workspace::coordinates_of_points(f.survey.task);
  for (int k = 0; k < coordinates; ++k) names.push_back(workspace::column_name(f.survey.task, k));
  for (const Column& c : columns) names.push_back(c.mean_name());
  for (const Column& c : columns) names.push_back(c.worst_name());
  report::Csv csv(names);
  for (std::size_t i = 0; i < f.survey.inside.size(); ++i) {
    const Vec3 p = workspace::for_user(f.survey.task, f.survey.grid.at(f.survey.inside[i]));
    std::vector<report::Csv::Field> row(p.begin(), p.begin() + coordinates);
    for (const Column& c : columns) row.emplace_back(c.scale * c.values.mean[i]);
    for (const Column& c : columns) row.emplace_back(c.scale * c.values.worst[i]);
    csv.add(row);
  }
  return csv.text();
}

Result<report::VtkImage> quality_image(const QualityFields& f) {
  const workspace::Grid& grid = f.survey.grid;
  report::VtkImage image;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto axis = static_cast<Eigen::Index>(k);
    if (!(grid.step[k][axis] > 0)) return fail("RE101", "the grid of the survey is not parallel to M's axes");
    image.points[k] = grid.points[k];
    image.origin[k] = to_mm(grid.origin[axis]);
    image.spacing[k] = to_mm(grid.step[k][axis]);
  }
  const auto array = [&](const std::string& name, double elsewhere, const auto& value) {
    report::VtkArray out{name, 1, std::vector<double>(grid.size(), elsewhere)};
    for (std::size_t i = 0; i < f.survey.inside.size(); ++i) out.values[f.survey.inside[i]] = value(i);
    image.arrays.push_back(std::move(out));
  };
  array("inside", 0, [](std::size_t) { return 1.0; });
  for (const Column& c : columns_of(f)) {
    array(c.mean_name(), kNone, [&](std::size_t i) { return c.scale * c.values.mean[i]; });
    array(c.worst_name(), kNone, [&](std::size_t i) { return c.scale * c.values.worst[i]; });
  }
  return image;
}

Result<workspace::Surface> quality_surface(const AnyMachine& machine, const SurveyOptions& options,
                                           const QualityFields& fields, QualityValue value, double below) {
  POLYPOD_ASSIGN(border, quality::survey_border(machine, fields.survey, options));
  auto surface = quality::surface_below(machine, options, border, shown_means(fields, value), below);
  if (!surface && surface.error().id == "WS131") {
    const quality::Statistics s = quality::statistics(fields.survey, shown_means(fields, value));
    return fail(
        "QP101",
        fmt::format("no point has a mean {} of at most {:.6g} {}", name_of(value).words, below, name_of(value).unit),
        {}, fmt::format("the least is {:.4g}", s.min));
  }
  return surface;
}

}  // namespace polypod::pages
