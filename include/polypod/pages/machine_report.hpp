// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One page of all that is known of a machine.
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "polypod/pages/quality.hpp"
#include "polypod/pages/workspace.hpp"

namespace polypod::pages {

struct MachineReportOptions {
  std::string version;             ///< of Polypod; default: not named
  std::string command;             ///< how the page was made; default: not named
  std::string machine;             ///< as the user named it; default: the machine's own name
  std::vector<std::string> sets;   ///< `key=value` that were overridden
  quality::SurveyOptions survey;   ///< directions and limits of the workspace and of what is surveyed in it
  QualityQuestion question;        ///< tolerances or errors
  std::vector<std::string> given;  ///< these as the user wrote them
  bool assumed = false;            ///< nobody gave them
  int resolution = 48;             ///< points along the longer side of a section, 8 to 512
  int resolution_in_space = 28;    ///< points along the longest side for pictures of errors in space, 8 to 512
  double noise_position = 20e-6;   ///< m, standard deviation of a coordinate that is measured for a calibration
  std::function<void(const char*, double)> progress;  ///< what is being done, and its share
};

/// A question of the page.
struct ReportPart {
  std::string name;    ///< "workspace", "errors", "statics", "calibration"
  std::string reason;  ///< why it has no answer here, and what would give one; empty where it has
};

/// What stands at the head of the page; NaN where it is not judged, infinite where there is no bound.
struct ReportFigures {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  /// The volume and its bounds, m^3, or in the coordinates of a task without x, y, z (m and rad).
  std::array<double, 3> volume{kNone, kNone, kNone};
  double error = kNone;       ///< of the tip, the largest that was seen, m
  double condition = kNone;   ///< the largest that was seen
  double compliance = kNone;  ///< the largest direct one on the grid of the map, um/N
  double calibrated = kNone;  ///< standard deviation of a position after a calibration, m
};

struct MachineReport {
  std::string html;
  std::vector<ReportPart> parts;
  ReportFigures figures;
};

/// What workspace_page (or region_page), quality_page and compliance_map_page say, and how well measured positions
/// could calibrate the machine, in one self-contained HTML file with one list of inputs. A question that has no answer
/// for this machine is named with the reason; the page holds the others. The same input gives the same bytes. Errors:
/// WS110 and those of other interrupted work. Cost: the sum of the pages'; seconds to a minute.
Result<MachineReport> machine_report(const machine::AnyMachine& machine, const MachineReportOptions& options);

}  // namespace polypod::pages
