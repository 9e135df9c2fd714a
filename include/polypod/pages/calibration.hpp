// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pages about measured machines: what a calibration or an identification of compliances found, and how sure it is.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "polypod/calibration/calibrate.hpp"
#include "polypod/statics/identify.hpp"
#include "polypod/statics/judge.hpp"

namespace polypod::pages {

struct MeasuredPageOptions {
  std::string version;  ///< of Polypod; default: not named
  std::string command;  ///< the command line that makes this page again; default: left out
};

/// One self-contained HTML file about `c` = calibration::calibrate(nominal, rows): rms before and after, fitted and
/// held back; the verdict; what is known of the tool's pose, as a table and a map of each coordinate over a level plane
/// through the middle of the workspace; how many parameters are identifiable; the residual of every row before and
/// after in um (angles in deg where they were measured), the spread of the residuals by direction; the parameters in mm
/// and deg with their standard errors; outliers with file and line. The same input gives the same bytes. Cost: linear
/// in the rows.
std::string calibration_page(const machine::AnyMachine& nominal, const std::vector<calibration::Measurement>& rows,
                             const calibration::Calibration& c, const MeasuredPageOptions& how = {});

/// What an identification of compliances is judged by beside itself.
struct ComplianceChecks {
  double given_rms = 0;  ///< m: statics::prediction_rms with the compliances that the machine had
  /// File and m: statics::leave_one_out, one entry a file; empty where there was one file only.
  std::vector<std::pair<std::string, double>> left_out;
  std::string verdict = {};  ///< in words, statics::verdict_of; empty: none is shown
  statics::Verdict::Answer answer = statics::Verdict::Answer::yes;
};

/// One self-contained HTML file about `r` = statics::identify_compliance(machine, points): residual rms against that of
/// the given compliances, each joint's (leg's) compliance with its 95 % interval, the residual of every point and
/// direction in um, how well each file is predicted from the others, estimates that are highly correlated, outliers;
/// for each file whose points lie in a plane parallel to two axes, the direct compliances measured and computed with
/// those found (see measured_over), as far as displacements make a map. The same input gives the same bytes. Cost: a
/// map of 41 points a side for each plane, 50 ms.
std::string identification_page(const machine::AnyMachine& machine, const std::vector<statics::MeasuredPoint>& points,
                                const statics::Identification& r, const ComplianceChecks& checks,
                                const MeasuredPageOptions& how = {});

}  // namespace polypod::pages
