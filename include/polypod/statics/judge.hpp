// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Whether measured displacements can be what their columns say: signs, units, exchanged columns, rows that do not fit.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/statics/identify.hpp"

namespace polypod::statics {

/// What a set of measured displacements is worth before anybody builds on it.
struct Judgement {
  /// What cannot be: ID140 displacements against the forces, or a compliance that is not positive; ID141 exchanged or
  /// reversed columns, or rows shifted against the poses; ID142 another unit or size. Each names the likely mistake in
  /// its hint, and the first row that shows it.
  std::vector<Error> errors;
  /// What may be, but is doubtful: ID143 a size far from the machine's own, ID144 readings that stand out from the
  /// others, ID148 compliances that no joints of machines have, where the machine has none. A command that builds on
  /// such data never answers yes.
  std::vector<Error> doubts;

  [[nodiscard]] bool good() const { return errors.empty() && doubts.empty(); }
};

/// Judges each point, each file and each group of columns against physics (the compliance of a passive machine is
/// symmetric and positive), against compliances c >= 0 of the joints fitted to the points, and against those that the
/// machine has, if it has any:
/// - size: |C_i| of a point over that of the model; more than 5 times off the median of all points under every model at
///   hand is an error, as is a median 100 times off the machine's own; 5 times off that is a doubt.
/// - arrangement of each file: forces, displacements or both exchanged or reversed (signed permutations), one column
///   reversed, rows shifted by one; what leaves less than half of the residual is an error, where the residual is more
///   than a tenth of the signal.
/// - each point: the same, where its residual is 4 times the median of all points (over its sigma, where each row
/// states one); what no mistake explains is a doubt.
/// - each 3 x 3 matrix: an eigenvalue of (C + C^T) / 2 below 0 by more than noise and a tenth of the largest is an
/// error.
/// Points that the machine cannot take, and partial ones as far as they go, are judged without the model. Cost: 200
/// small fits, 5 ms for 90 points.
Judgement judge(const AnyMachine& machine, const std::vector<MeasuredPoint>& points);

/// "yes", "in part" or "no", and why, in whole sentences.
struct Verdict {
  enum class Answer { yes, in_part, no } answer = Answer::yes;
  std::string why;
};
/// Of a fit: no where the judgement has errors, or where the fit explains less than 80 % of the signal and leaves more
/// than noise; in part where there are doubts, where more than noise is left (Identification::more_than_noise), where
/// nothing tells the noise, or where the cross displacements are not symmetric; else yes. A yes on few readings says
/// how little they test.
Verdict verdict_of(const Identification& fit, const Judgement& judgement);
std::string_view name_of(Verdict::Answer answer);

}  // namespace polypod::statics
