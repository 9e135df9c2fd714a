// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The loosest tolerances that keep the tool's error below a wanted value wherever it is judged.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "polypod/quality/survey.hpp"

namespace polypod::quality {

/// Elements that get one tolerance: a key as `sized` takes it.
struct ToleranceGroup {
  std::string key;
  double weight = 1;  ///< how loose against the others, or what a tolerance costs: weight / tolerance. > 0
};

enum class DesignRule {
  weighted,  ///< tolerances in the ratio of the weights, all scaled as far as they go (equal weights: equal tolerances)
  cost,      ///< the least sum of weight / tolerance over all elements
};

struct DesignOptions {
  DesignRule rule = DesignRule::weighted;
  Region region = Region::box;
  /// Wanted: the tip's error at most so much, m, and the orientation's, rad. One of them may be infinite.
  double position = 0;
  double orientation = std::numeric_limits<double>::infinity();
};

struct ToleranceDesign {
  struct Part {
    std::string key;
    double tolerance = 0;            ///< the one number for all its elements, each in its own of the units: mm, deg, 1
    std::vector<std::string> units;  ///< "mm", "deg", "" (no unit), each once
    int elements = 0;
    double share = 0;  ///< of the error at the worst pose, 0 to 1
  };
  std::vector<Part> parts;
  double position = 0, orientation = 0;  ///< the largest worst cases seen with them, m and rad
  Pose worst;                            ///< where the tighter of the two wishes is met exactly
  double cost = 0;                       ///< sum of weight / tolerance (mm, deg) over the elements
  int rounds = 0;
};

/// Worst cases are exact at each pose (worst_case) and are looked for at the survey's poses and, from the worst of
/// them, between: coordinates and tilt by steps down to 1/50 of the grid's. The worst case is linear in a common factor
/// of all tolerances, so the weighted rule needs no search; the cost rule is a convex problem, solved by cutting
/// planes: each worst case found gives one linear limit sum a_k t_k <= wanted that no better tolerances may break.
/// Errors: those of sized, QU120 (a wish or a weight that is not above 0), QU121 (an element named by two groups),
/// QU122 (the error does not depend on the elements, or is infinite: a singular pose).
Result<ToleranceDesign> design_tolerances(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                                          const std::vector<ToleranceGroup>& groups, const DesignOptions& design);

}  // namespace polypod::quality
