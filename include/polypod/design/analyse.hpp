// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the evaluations of a study say of its parameters.
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/design/store.hpp"

namespace polypod::design {

/// How much one figure depends on each varied parameter.
struct Sensitivity {
  std::string of;  ///< "objective" or the name of a figure
  /// Standardised regression coefficients of the ranks, one a varied parameter, -1 to 1: the sign says whether the
  /// figure rises with the parameter. NaN where a parameter has one value.
  std::vector<double> coefficients;
  double share_explained = 0;  ///< R^2 of the ranks: below about 0.7 the dependence is not monotonic
  int rows = 0;                ///< that were used
};

/// For the objective (of one that there is) and each figure: least squares on ranks (mean ranks of equal values) of the
/// rows that are done or dropped (a volume of a dropped row is the middle of its coarse bounds). The rows are those
/// that a search has tried, so most lie near its best: the coefficients describe these, not the ranges evenly. Empty
/// where fewer rows than three for each parameter are left. Cost: n log n in the rows, a parameter and figure.
std::vector<Sensitivity> sensitivities(const Study& study, const std::vector<Row>& rows);

/// A condition on rows: a varied or tied key, a figure, `objective`, `row`, `seconds`; <, <=, >, >= or = a number.
struct Condition {
  std::string name;
  enum class Is { below, at_most, above, at_least, equal } is = Is::equal;
  double value = 0;
};
/// "volume_mm3>=20000". Errors: OP120 (no condition, or a name that the study does not have).
Result<Condition> condition_of(const Study& study, const std::string& text);
/// Whether a row meets the condition; not where it does not have the number. The study must outlive the test.
std::function<bool(const Row&)> test_of(const Study& study, const Condition& condition);

/// The goals whose figures are the same in all rows that are done, at least three: they decide nothing.
std::vector<std::string> unchanged_goals(const Study& study, const std::vector<Row>& rows);

/// How the rows stand to one hold of the study.
struct HoldSummary {
  std::string hold;  ///< in words
  int judged = 0;    ///< rows whose figure is known (of a box: that came as far as the box)
  int broken = 0;    ///< of them; of a volume also where the hold is not proven to be kept
  /// The figure that breaks it least, of a volume the bound that does.
  double nearest = std::numeric_limits<double>::quiet_NaN();
  /// The row that comes nearest and what ended it, where no figure says it: of poses, of the motion and of a box.
  std::string reason;

  /// As "39 of the 40 candidates whose figure is known do not keep: condition at most 3; the nearest has 3.2".
  [[nodiscard]] std::string in_words() const;
};
/// In the order of the study, then the poses and the motion of the study where any row breaks them. The start counts
/// where it is a candidate.
std::vector<HoldSummary> hold_summaries(const Study& study, const std::vector<Row>& rows);
/// The volume of all that is dominated by these points and dominates the corner, where more is better in every goal
/// (goals_of); points that are not above the corner in every goal count nothing. Exact, by a staircase that points are
/// added to, and by slices along each further goal (Beume et al. 2009 for three). Cost: n log n for two and three
/// goals, n more for each further one.
double hypervolume(std::vector<std::vector<double>> points, const std::vector<double>& corner);

/// How much of the space of the goals a front dominates: the hypervolume indicator (Zitzler and Thiele 1998), exact for
/// these points. Larger is better; two fronts compare by `volume` where their reference points are the same.
struct FrontVolume {
  double volume = 0;              ///< between the front and the reference point, in the units of the figures
  double share = 0;               ///< of the box between `best` and the reference point; 0 where that is empty
  std::vector<double> reference;  ///< a figure a goal, worse than the front
  std::vector<double> best;       ///< the best figure of each goal on the front
};
/// `reference`: the figures to compare with, one a goal; NaN or left out: the worst of the front and a tenth of its
/// span beyond. Nothing without a front, of a front without a span where no reference is given, and of a study with one
/// goal.
std::optional<FrontVolume> front_volume(const Study& study, const std::vector<Row>& rows,
                                        const std::vector<std::size_t>& front,
                                        const std::vector<double>& reference = {});
/// In one line, with the reference point.
std::string in_words(const Study& study, const FrontVolume& volume);
/// Why rows were refused, and how many for each reason, the most frequent first.
std::vector<std::pair<std::string, int>> refusals(const std::vector<Row>& rows);

/// The holds that bind a row, in words: its figure is within 1 % of the bound. A box is not among them: whether it just
/// fits is not known. Then the parameters that stand at an end of their range, which bind as well.
std::vector<std::string> binding(const Study& study, const Row& row);

/// Study::parameters of a row. What ties would give is NaN of a start that is none of the candidates: it has what its
/// file says.
std::vector<std::pair<std::string, double>> parameters_of(const Study& study, const Row& row);

/// A table of these rows, as indices of `rows`: row, state, phase, objective with its bounds, violation, the
/// parameters, the figures with the bounds of volumes, seconds, version, at, reason.
std::string rows_csv(const Study& study, const std::vector<Row>& rows, const std::vector<std::size_t>& which);

/// The machine of a row, with its provenance. Errors: OP121 (the row has no machine).
Result<AnyMachine> machine_of_row(const Study& study, const Row& row);

/// The same as the text of a file; of a study of a cell the cell file, which needs no other. Errors: OP121.
Result<std::string> file_of_row(const Study& study, const Row& row);

}  // namespace polypod::design
