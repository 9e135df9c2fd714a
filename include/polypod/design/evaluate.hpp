// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What one candidate of a study is worth: its figures, the objective and the holds, cheap ones first.
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "polypod/design/study.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::design {

/// A figure of a candidate. `lower` and `upper` are proven bounds of a volume; of every other figure they are its
/// value, which is exact or the mean, the most or the least of a sample. NaN where it was not computed.
struct Value {
  double value = std::numeric_limits<double>::quiet_NaN();
  double lower = value, upper = value;
};

enum class State : std::uint8_t {
  done,      ///< every figure is as exact as the study asks, and all holds are kept (of a volume: proven)
  violates,  ///< a hold is broken, or not proven to be kept; figures that cost more may be missing
  dropped,   ///< what is known proves that it is worse than what was found before; its volume is coarse
  refused,   ///< no machine, or nothing to judge it by; `reason` says why
};
const char* name_of(State state);

struct Evaluation {
  State state = State::refused;
  std::string reason;
  std::vector<Value> figures;  ///< in the order of Study::figures()
  /// Sum of weight * (value / best) for max, weight * (best / value) for min: JEL (8.2), (8.3). Nothing (NaN) of a
  /// front and of what has no figures. The bounds follow from those of the figures.
  Value objective;
  double violation = std::numeric_limits<double>::infinity();  ///< of all holds, as shares of their bounds; 0: kept
  double seconds = 0;
};

/// What a new candidate is compared with before its dear figures are computed.
struct Incumbents {
  /// The best proven lower bound of an objective so far.
  double objective = -std::numeric_limits<double>::infinity();
  /// Of a front: the goals of its points at their worse bounds, each turned so that more is better.
  std::vector<std::vector<double>> front;
};

/// The goals of an evaluation so that more is better, at their better (`hopeful`) or their worse bounds.
std::vector<double> goals_of(const Study& study, const Evaluation& e, bool hopeful);
/// Whether a is at least as good in every goal and better in one.
bool dominates(const std::vector<double>& a, const std::vector<double>& b);

struct EvaluateOptions {
  int threads = 1;                  ///< inside one evaluation; 0: all. The result does not depend on it.
  std::function<bool()> cancelled;  ///< asked between rounds
};

/// Judges one candidate. The order is that of cost: the machine itself, a coarse volume (whose bounds prove emptiness
/// and bound every goal on volumes), figures at home, figures over the points of the survey, boxes that must be inside,
/// the fine volume, the largest box. It ends early where a hold is certainly broken, or where the goals' better bounds
/// are proven to be worse than an incumbent: below its objective, or dominated by a point of the front. So nothing is
/// dropped that could have been better. Poses and a motion of the study (Duty) are holds: a pose that is not reached
/// counts as a share of all. Where the study has tolerances of parameters (Study::robust), the machine itself and all
/// corners of their box are judged, and each figure and the objective are the worst of them, which is no bound on what
/// lies between the corners. The figures are those of the commands `workspace`, `dexterity` and `errors` for
/// the same machine and options. Errors: WS110 (cancelled); everything that is wrong with a candidate is part of the
/// result.
Result<Evaluation> evaluate(const Study& study, const std::vector<double>& varied, const Incumbents& incumbents,
                            const EvaluateOptions& options);

/// Whether figures or holds of the study are those of a survey's points, which a search may have found to be
/// flattering.
bool may_flatter(const Study& study);
/// Whether there is an answer that is still to be judged by a finer survey: that of a search which was ended while it
/// judged. `best`: one machine, else the points of a front, whose holds alone are judged again.
bool to_be_judged_again(const Study& study, bool complete, bool best, bool front);

/// evaluate() for the machine as it is in its file, whole.
Result<Evaluation> evaluate_machine(const Study& study, const AnyMachine& machine, const Incumbents& incumbents,
                                    const EvaluateOptions& options);

/// Directions, limits and tolerance with which the study looks at workspaces.
workspace::Options workspace_options(const Study& study);

/// The objective from the figures (bounds as described), NaN where one is missing.
Value objective_of(const Study& study, const std::vector<Value>& figures);

}  // namespace polypod::design
