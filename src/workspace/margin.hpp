// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How far a tool point is inside the limits of a machine, over a set of directions.
#pragma once

#include <memory>

#include "polypod/workspace/field.hpp"

namespace polypod::workspace {

/// The least margin at a point, m, and whose it is.
struct Margin {
  double value = 0;
  int limit = -1;
};

/// Answers for one point at a time, from any thread.
class PointJudge {
 public:
  virtual ~PointJudge() = default;
  /// Over the required directions.
  [[nodiscard]] virtual Margin margin(const Vec3& p) const = 0;
  /// Over R = 1 alone.
  [[nodiscard]] virtual Margin upright(const Vec3& p) const = 0;
  /// The largest tilt in `value` (rad, -1 where R = 1 is out of limits) and what stops it.
  [[nodiscard]] virtual Margin tilt(const Vec3& p) const = 0;
};

/// Errors: WS100, WS102, WS130.
Result<std::unique_ptr<PointJudge>> judge_of(const AnyMachine& machine, const Options& options,
                                             const FieldOptions& field_options);

/// The same where machine and options are known to be good; `machine` must outlive it.
std::unique_ptr<PointJudge> judge_unchecked(const AnyMachine& machine, const Options& options,
                                            const FieldOptions& field_options);

/// The share t of the way from `inside` to `outside` at which the margin (f_inside >= 0 there, f_outside < 0) changes
/// its sign: false position with halving, so that jumps are found too.
template <class F>
double border_between(const F& f, double f_inside, double f_outside, double share = 1e-6) {
  double a = 0, b = 1, fa = f_inside, fb = f_outside;
  for (int k = 0; k < 60 && b - a > share; ++k) {
    // Every third step halves, and no step comes closer to an end than a hundredth of the way.
    double t = k % 3 == 2 ? 0.5 : fa / (fa - fb);
    t = a + (b - a) * std::min(std::max(t, 0.01), 0.99);
    const double ft = f(t);
    if (ft >= 0 && ft < 1e-12) return t;
    (ft >= 0 ? a : b) = t;
    (ft >= 0 ? fa : fb) = ft;
  }
  return 0.5 * (a + b);
}

/// Whether a box of volume() takes far longer than a pose of the judge: boxes that only narrow down what is judged pose
/// by pose are then left large.
bool bounds_are_slow(const AnyMachine& machine);

/// Runs task(i) for i = 0 .. count - 1 on the threads of the options, in rounds between which progress and cancelled
/// are asked. Errors: WS110.
Status in_rounds(const Options& options, std::size_t count, const std::function<void(std::size_t)>& task,
                 const std::function<void(double)>& progress);

}  // namespace polypod::workspace
