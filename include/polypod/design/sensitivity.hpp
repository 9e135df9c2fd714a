// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How much each parameter matters over its whole range: elementary effects (Morris) and variance shares (Sobol).
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "polypod/design/store.hpp"

namespace polypod::design {

enum class SensitivityMethod : std::uint8_t { morris, sobol };
/// "morris", "sobol".
const char* name_of(SensitivityMethod method);

/// Where a function of n parameters, each from 0 to 1, must be evaluated: `groups` times a fixed number of points, one
/// group after the other. More groups of the same seed begin with the same ones.
struct SampleDesign {
  SensitivityMethod method = SensitivityMethod::morris;
  int parameters = 0;
  int groups = 0;
  std::uint64_t seed = 1;
  std::vector<std::vector<double>> points;
  std::vector<std::vector<int>> order;  ///< of Morris: which parameter steps where, a group

  [[nodiscard]] int each() const { return parameters + (method == SensitivityMethod::morris ? 1 : 2); }
};

/// The largest design of at most `evaluations` points.
/// morris: trajectories on 4 levels, each parameter once by 2/3 of its range in a random order (Morris 1991); a group
/// has n + 1 points. sobol: two independent samples A and B and those that have A's parameters but one of B (Saltelli
/// 2010); a group has n + 2 points. Errors: OP150 (fewer than 4 trajectories, or 16 samples).
Result<SampleDesign> sample_design(SensitivityMethod method, int parameters, int evaluations, std::uint64_t seed);

/// A number with its 95 % interval by bootstrap (1000 resamples of the groups, percentiles).
struct Estimate {
  double value = std::numeric_limits<double>::quiet_NaN();
  double lower = value, upper = value;
};

/// One quantity's dependence on each parameter.
struct GlobalSensitivity {
  std::string of;  ///< "objective" or the name of a figure
  /// morris: the mean effect mu* of |dy/du|: what a parameter changes over its whole range, in the unit of the quantity
  /// (Campolongo 2007). sobol: the total share S_T of the variance that goes if all but this parameter were known
  /// (Jansen 1999).
  std::vector<Estimate> total;
  /// morris: mu, the mean of dy/du with its sign. sobol: the first share S of the variance that this parameter makes by
  /// itself (Saltelli 2010).
  std::vector<Estimate> first;
  /// morris: the standard deviation of dy/du, beside mu* large where the effect depends on the other parameters or is
  /// not linear. sobol: empty.
  std::vector<double> spread;
  /// Groups that say something: of Morris those with two neighbours that have values, of Sobol those whose values are
  /// all there. The others are left out.
  int used = 0;
};

/// From the values at the points of a design, in its order; NaN where there is none. Estimates are NaN where fewer than
/// two groups are left, a parameter has fewer than 4 effects (morris), or nothing changes (sobol). Cost: 1000 times the
/// points.
GlobalSensitivity global_sensitivity(const SampleDesign& design, const std::vector<double>& values);

struct StudySensitivity {
  SampleDesign design;
  std::vector<GlobalSensitivity> of;  ///< the objective of a study that has one, then each figure
  int computed = 0;                   ///< evaluations of this run; the others were in the store
  int without = 0;                    ///< candidates without figures: no machine, or none of its kind
  std::string reason;                 ///< why the first of them has none
  bool complete = false;              ///< false: cancelled; what was computed is kept
};

struct SensitivityOptions {
  int threads = 0;
  std::string version;
  std::function<bool()> cancelled;
  std::function<void(int done, int all)> progress;
};

/// Evaluates the design over the ranges of the study and says what it shows. Holds are not asked for (a hold would cut
/// the ranges), and nothing is dropped. Every evaluation is kept in the store, and what it has is taken. Errors: those
/// of the store.
Result<StudySensitivity> study_sensitivity(const Study& study, Store& store, SensitivityMethod method, int evaluations,
                                           std::uint64_t seed, const SensitivityOptions& options);

/// What the store has of the last whole analysis; nothing (no groups) where there was none. Errors: those of the store.
Result<StudySensitivity> kept_sensitivity(const Study& study, const Store& store);

}  // namespace polypod::design
