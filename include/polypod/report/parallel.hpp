// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Parallel coordinates: many numbers of many things side by side.
#pragma once

#include <string>
#include <vector>

#include "polypod/report/plot.hpp"

namespace polypod::report {

/// A line a thing across vertical axes, each with a scale of its own. Things of a later group are drawn over those of
/// an earlier one. A value that is not finite interrupts its line.
struct ParallelPlot {
  struct Axis {
    std::string label;
    double min = 0, max = 1;
    bool downwards = false;  ///< grows from the top to the bottom
    bool log = false;        ///< by the logarithm, where both ends are above 0
  };
  struct Group {
    std::string name;  ///< in the legend
    Colour colour = Colour::muted;
    double stroke = 1;
    std::vector<std::vector<double>> lines;  ///< a value an axis
  };
  std::string title;
  std::vector<Axis> axes;
  std::vector<Group> groups;

  /// On narrow canvases the axes lie across and the lines run down.
  std::string operator()(const Canvas& canvas) const;
};

}  // namespace polypod::report
