// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/fit.hpp"

#include <algorithm>
#include <cmath>
#include <functional>

#include "margin.hpp"
#include "polypod/kinematics/delta.hpp"

namespace polypod::workspace {
namespace {

/// The least margin of the points as a base stands `shift` from where it is: they move the other way.
double least_margin(const PointJudge& judge, const std::vector<Vec3>& points, const Vec3& shift) {
  double least = std::numeric_limits<double>::infinity();
  for (const Vec3& X : points) least = std::min(least, judge.margin(X - shift).value);
  return least;
}

/// The values round `nominal` for which margin(value) >= 0: of all ranges that a scan finds the one nearest to it.
std::optional<FitRange> scan(double from, double to, double nominal, const std::function<double(double)>& margin) {
  constexpr int kSteps = 400, kHalvings = 30;
  const auto value = [&](int k) { return from + (to - from) * k / kSteps; };
  const auto edge = [&](double in, double out) {
    for (int k = 0; k < kHalvings; ++k) {
      const double middle = 0.5 * (in + out);
      (margin(middle) >= 0 ? in : out) = middle;
    }
    return in;
  };
  std::optional<FitRange> best;
  for (int k = 0; k <= kSteps; ++k) {
    if (margin(value(k)) < 0) continue;
    int end = k;
    while (end < kSteps && margin(value(end + 1)) >= 0) ++end;
    FitRange range{k > 0 ? edge(value(k), value(k - 1)) : value(k),
                   end < kSteps ? edge(value(end), value(end + 1)) : value(end), 0};
    range.nearest = std::clamp(nominal, range.low, range.high);
    if (!best || std::abs(range.nearest - nominal) < std::abs(best->nearest - nominal)) best = range;
    k = end;
  }
  return best;
}

std::optional<Vec3> placed(const PointJudge& judge, const std::vector<Vec3>& points, double reach) {
  Vec3 shift = Vec3::Zero();
  double best = least_margin(judge, points, shift);
  for (double step = 0.25 * reach; step > 1e-4 * reach && best < 0;) {
    bool better = false;
    for (int k = 0; k < 27; ++k) {
      const Vec3 direction(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
      if (direction.isZero()) continue;
      const Vec3 next = shift + step * direction.normalized();
      const double margin = least_margin(judge, points, next);
      if (!(margin > best)) continue;
      best = margin;
      shift = next;
      better = true;
    }
    if (!better) step *= 0.5;
  }
  if (best < 0) return {};
  double in = 1, out = 0;  // shares of the way
  for (int k = 0; k < 30; ++k) {
    const double middle = 0.5 * (in + out);
    (least_margin(judge, points, middle * shift) >= 0 ? in : out) = middle;
  }
  shift *= in;
  for (int axis = 0; axis < 3; ++axis) {  // and along each axis on its own
    Vec3 none = shift;
    none[axis] = 0;
    double keep = 1, drop = 0;
    const Vec3 all = shift;
    const auto at = [&](double share) { return Vec3(none + share * (all - none)); };
    if (least_margin(judge, points, none) >= 0) keep = 0;
    for (int k = 0; k < 30 && keep > 0; ++k) {
      const double middle = 0.5 * (keep + drop);
      (least_margin(judge, points, at(middle)) >= 0 ? keep : drop) = middle;
    }
    shift = at(keep);
  }
  return shift;
}

}  // namespace

Result<Fit> fit_points(const AnyMachine& machine, const Options& options, const std::vector<Vec3>& points) {
  if (points.empty()) return fail("WS142", "a task without points", {}, "give at least one point");
  FieldOptions field_options;
  POLYPOD_ASSIGN(judge, judge_of(machine, options, field_options));
  Fit out;
  out.fits = true;
  for (const Vec3& X : points) {
    const Margin margin = judge->margin(X);
    out.points.push_back({X, margin.value, margin.limit});
    out.fits = out.fits && margin.value >= 0;
  }
  return std::visit(
      [&]<class M>(const M& m) -> Result<Fit> {
        if constexpr (!machine::DeltaFamily<M>) {
          return fail("WS140", "tasks are fitted to deltas", {},
                      "name a machine of family rotary-delta or linear-delta");
        } else {
          const double nominal = m.rod_length[0];
          double reach = nominal;
          if constexpr (std::is_same_v<M, machine::RotaryDelta>) reach += m.arm_length[0];
          out.rod_length = scan(0.4 * nominal, 2.5 * nominal, nominal, [&](double length) {
            M changed = m;
            for (int i = 0; i < m.arms; ++i) changed.rod_length[i] += length - nominal;
            const AnyMachine any(changed);
            // Not judge_of, which would look at the whole machine each time.
            const auto other = judge_of_delta(any, options, field_options);
            return least_margin(*other, points, Vec3::Zero());
          });
          out.base_height = scan(-2 * reach, 2 * reach, 0,
                                 [&](double height) { return least_margin(*judge, points, Vec3(0, 0, height)); });
          out.placement = out.fits ? Vec3(Vec3::Zero()) : placed(*judge, points, reach);
          return out;
        }
      },
      machine);
}

}  // namespace polypod::workspace
