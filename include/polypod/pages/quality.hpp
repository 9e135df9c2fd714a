// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pictures, files and the page of a survey of errors and conditioning.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/quality/survey.hpp"
#include "polypod/report/plot.hpp"
#include "polypod/report/vtk.hpp"
#include "polypod/workspace/surface.hpp"

namespace polypod::pages {

/// What is asked at every pose.
struct QualityQuestion {
  bool tolerances = true;               ///< `sizes` are tolerances; or known errors
  std::vector<quality::Sized> sizes;    ///< of the machine's elements
  quality::ToleranceOptions tolerance;  ///< of tolerances
  double length = 0;                    ///< characteristic length, m; 0: as kinematics::dexterity
};

struct QualityFields {
  quality::Survey survey;
  quality::ErrorField errors;
  quality::DexterityField dexterity;
};
/// Errors and conditioning at the points of the workspace. Errors: those of quality::survey() and tolerance_field().
Result<QualityFields> quality_fields(const machine::AnyMachine& machine, const quality::SurveyOptions& options,
                                     const QualityQuestion& question);

enum class QualityValue { position, orientation, condition, sigma_min, determinant };
/// Its mean over the directions at each point inside, as a person reads it: mm, mrad or without unit. NaN where the
/// machine has no joints, infinite where singular.
std::vector<double> shown_means(const QualityFields& fields, QualityValue value);

/// A row a point of the workspace: x_mm, y_mm, z_mm, then the means and the worst over the directions of position_mm,
/// orientation_rad, condition, sigma_min, determinant. A number that is not finite is an empty field.
std::string quality_csv(const QualityFields& fields);

/// The same numbers as point arrays over the grid of the survey, NaN beyond the workspace, and `inside` (1 or 0).
/// Lengths in mm. Errors: RE101.
Result<report::VtkImage> quality_image(const QualityFields& fields);

/// The boundary of what lies in the workspace where `value` (as shown_means) is at most `below`. Errors: those of
/// quality::survey_border(), QP101 (it is so nowhere).
Result<workspace::Surface> quality_surface(const machine::AnyMachine& machine, const quality::SurveyOptions& options,
                                           const QualityFields& fields, QualityValue value, double below);

/// The means over the plane x, y or z = at (axis 0, 1, 2; m) as a map of colour, with the boundary of the workspace;
/// `resolution` points along the longer side, 8 to 512. Errors: those of quality_fields(), QP100 (the plane misses the
/// workspace).
Result<report::Figure> quality_section(const machine::AnyMachine& machine, const quality::SurveyOptions& options,
                                       const QualityQuestion& question, int axis, double at, int resolution,
                                       QualityValue value);

struct QualityPageOptions {
  std::string version;                            ///< of Polypod; default: not named
  std::string command;                            ///< how the page was made; default: not named
  std::string machine;                            ///< as the user named it; default: the machine's own name
  std::vector<std::string> sets;                  ///< `key=value` that were overridden
  std::vector<std::string> given;                 ///< the errors or tolerances as the user wrote them: "all=0.01"
  bool assumed = false;                           ///< nobody gave them: the page says so
  QualityValue region = QualityValue::condition;  ///< what the region of the picture in space is about
  std::optional<double> below;                    ///< and below which value, as shown_means; default: one that fits
  int resolution = 72;                            ///< points along the longer side of a section, 8 to 512
  int resolution_in_space = 34;                   ///< points along the longest side for pictures in space, 8 to 512
};

/// One self-contained HTML file about the quality of a machine: condition numbers mix lengths and angles, so errors in
/// mm and mrad come first (statistics, three sections through the middle of the workspace, histograms, each element's
/// share at the worst pose), conditioning second (the same, near-singular poses by name), then the workspace in space
/// and all inputs. The same input gives the same bytes. Errors: those of the functions above. Cost: some seconds.
Result<std::string> quality_page(const machine::AnyMachine& machine, const quality::SurveyOptions& options,
                                 const QualityQuestion& question, const QualityFields& fields,
                                 const QualityPageOptions& page = {});

}  // namespace polypod::pages
