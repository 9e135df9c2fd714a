// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The pictures of a correction, and the common axis on which they are drawn.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/correct.hpp"
#include "polypod/report/plot.hpp"
#include "polypod/report/scene.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::pages {

/// A sample and where it lies on the axis of the pictures.
struct Dot {
  const machining::Sample* sample = nullptr;
  int move = 0;        ///< index of the programmed move
  double at = 0;       ///< mm along the moves that cut, one after the other
  double s = 0;        ///< m along its programmed move
  bool joint = false;  ///< on a transition of the corrected program
};

/// A programmed move on that axis.
struct Stretch {
  int move = 0;
  int line = 0;
  double from = 0, to = 0;  ///< mm
};

/// The moves that cut before or after the correction, laid end to end, with the samples on them.
struct Tracks {
  std::vector<Stretch> stretches;
  std::vector<Dot> before, after;
  double length = 0;  ///< mm

  Tracks(const gcode::Program& program, const machining::Correction& c);
};

struct Overview {
  report::PathPlot plot;
  double factor = 1;  ///< by which the bend is enlarged
};
Overview overview(const machining::Job& job, const machining::Correction& c, const Tracks& tracks);

/// The same in space: programmed moves, the tool tip before and after the correction coloured by its distance from
/// them, the corrected command; each line thinned out to about `points` points that hold the largest distances.
report::Scene path_scene(const machining::Correction& c, const Tracks& tracks, double factor, std::size_t points);

struct Corner {
  report::PathPlot plot;
  std::string title;
};
/// The sharpest corner between two long moves that cut, or else where the tool is farthest off before the correction,
/// at true proportions.
std::optional<Corner> corner(const machining::Correction& c, const Tracks& tracks);

/// Errors along the path: of what, by the member of Sample that holds it.
report::LinePlot error_plot(const machining::Correction& c, const Tracks& tracks, float machining::Sample::*error,
                            const std::string& label);
report::Histogram error_histogram(const machining::Correction& c, const Tracks& tracks);
/// `tool_axis` in W.
report::LinePlot force_plot(const machining::Correction& c, const Tracks& tracks, const Vec3& tool_axis);
report::LinePlot depth_plot(const Tracks& tracks);
report::LinePlot angle_plot(const Tracks& tracks);

/// The compliance round the part, in W, at the mean height of the cutting tip.
struct PartMap {
  statics::Map map;             ///< points in M
  double x_min = 0, x_max = 0;  ///< W, mm
  double y_min = 0, y_max = 0;  ///< W, mm
  double z = 0;                 ///< W, mm
  std::vector<report::Polyline> part;
};
PartMap part_map(const machining::Job& job, const machining::Correction& c, const Tracks& tracks);
std::vector<std::pair<std::string, report::Figure>> compliance_panels(const machining::Job& job, const PartMap& map);

/// What each joint adds to the bend across the path of the program as it is: means over points that cut, um. Nothing
/// where the compliance is a measured one: it knows no joints.
struct JointShares {
  std::vector<std::string> joints;
  std::vector<double> all;
  std::vector<std::pair<int, std::vector<double>>> by_stretch;  ///< index into Tracks::stretches; for few moves only
};
JointShares joint_shares(const machining::Job& job, const Tracks& tracks);

}  // namespace polypod::pages
