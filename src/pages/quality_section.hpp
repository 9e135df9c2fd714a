// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A survey of errors and conditioning over a plane.
#pragma once

#include "polypod/pages/quality.hpp"

namespace polypod::pages {

/// A survey of a plane. Its points are those of the workspace and their neighbours, so that a map runs up to the
/// border.
struct QualitySection {
  int axis = 2;   ///< of the plane's normal
  double at = 0;  ///< m
  QualityFields fields;
  std::vector<char> within;  ///< of each point of `fields.survey.inside`: not only a neighbour
  std::vector<workspace::Loop> border;
  bool hangs = false;  ///< z of the picture points down, as in the pictures of the machine
};
/// As pages::quality_section.
Result<QualitySection> survey_section(const machine::AnyMachine& machine, const quality::SurveyOptions& options,
                                      const QualityQuestion& question, int axis, double at, int resolution);

/// What is asked of errors, at a survey's points.
Result<quality::ErrorField> errors_of(const machine::AnyMachine& machine, const quality::SurveyOptions& options,
                                      const QualityQuestion& question, const quality::Survey& survey);
/// Fills errors and conditioning of `fields` at its survey's points.
Status fill_fields(const machine::AnyMachine& machine, const quality::SurveyOptions& options,
                   const QualityQuestion& question, QualityFields& fields);

/// Adds the neighbours of the points of a survey, so that its fields go on a step beyond the border; says which points
/// of `inside` are no neighbours.
std::vector<char> add_neighbours(quality::Survey& survey);

/// A range that colours cover. Values above `high` have its colour.
struct Range {
  double low = 0, high = 1;
  bool cut = false;  ///< some values lie above
};
/// Of the finite values; where a few per cent are far above the rest, as near singular poses, the range ends before
/// them.
Range range_of(std::vector<double> values);

struct ValueName {
  const char* symbol;
  const char* words;
  const char* unit;
};
ValueName name_of(QualityValue value);

/// The means inside of a section, as shown_means.
std::vector<double> means_within(const QualitySection& section, QualityValue value);
report::HeatMap map_of(const QualitySection& section, QualityValue value, const Range& range);
/// "xz at y = 0.0 mm".
std::string plane_name(const QualitySection& section);

}  // namespace polypod::pages
