// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a calibration is looked at for beside its residuals' size: whether something common was taken for an error of
// the machine, whether rows are repeats, and whether the readings drift.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "polypod/geometry/pose.hpp"

namespace polypod::calibration {

/// One common error (of the instrument's frame, of the target, of the instrument's scale) tried in place of and beside
/// changes of the machine.
struct CommonChange {
  std::string what;          ///< "frame", "target" or "scale", as the option --estimate calls it
  Vec3 shift{0, 0, 0};       ///< m: by which the measured places are moved, in the middle of them, in S; target: in T
  Vec3 turn{0, 0, 0};        ///< rad, a rotation vector
  double scale = 1;          ///< what the instrument shows of a length, over it
  double alone = 0;          ///< share of the drawing's squared residuals that it explains, the machine as drawn
  bool fitted = false;       ///< it was fitted beside the machine too, because it explains half of them and more
  double change = 0;         ///< then: root mean square of the parameters' changes over their priors
  double change_before = 0;  ///< and that without it
  /// By how much -2 ln of the posterior falls with it, a freedom that it has, with the sizes of the machine's errors
  /// as they show beside it: about 1 where there is no such error.
  double evidence = 0;
  bool likely = false;  ///< the change found is this one rather than the machine's
};

/// A parameter that was moved by ten of its priors (stated, or else the default ones) and more.
struct Moved {
  std::string key;  ///< without unit
  double priors = 0;
};

/// Rows of one kind at the same joints (to 0.001 mm and 0.001 deg), their scatter against that of the poses.
struct Repeats {
  std::size_t rows = 0, poses = 0;  ///< that are repeats of others, and the poses where they stand; 0: there are none
  double within = 0;                ///< standard deviation within a pose over the noise given (pure error)
  double between = 0;               ///< of what a pose's rows have in common beyond the model (lack of fit)
  double F = 0;                     ///< mean squares of lack of fit over pure error ...
  double between_degrees = 0, within_degrees = 0;
  double p_value = 1;      ///< ... and how likely chance makes it as large
  double correlation = 0;  ///< of two rows of a pose, between^2 / (between^2 + within^2)
};

/// One component of the residuals over the rows in their order, or over their times.
struct ComponentDrift {
  std::string component;  ///< "x", "y", "z", "a", "b", "c", "distance", "gauge"
  std::string over;       ///< "row", "time" or "temperature"
  bool is_angle = false;
  std::size_t points = 0;
  double trend = 0;  ///< m or rad from the first to the last
  double t = 0;      ///< trend over its standard error
  double trend_p = 1;
  double lag1 = 0;  ///< correlation of neighbours
  double lag1_p = 1;
  bool trend_found = false, lag1_found = false;  ///< beyond chance, the number of looks counted
};
struct Drift {
  bool looked = false;  ///< there are ten poses and more
  bool found = false;
  double level = 0;  ///< of each single test, so that all together raise a false alarm in 1 % of the cases
  std::vector<ComponentDrift> components;
};

}  // namespace polypod::calibration
