// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/fit.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "../../workspace/margin.hpp"
#include "polypod/families/delta/kinematics.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {
namespace {

/// The least margin of the points as a base stands `shift` from where it is: they move the other way.
double least_margin(const PointJudge& judge, const std::vector<Vec3>& points, const Vec3& shift) {
  double least = std::numeric_limits<double>::infinity();
  for (const Vec3& X : points) least = std::min(least, judge.margin(X - shift).value);
  return least;
}

/// The boundary of what is reached, seen from a point: where its margin changes the sign that it has at the point.
class Boundary {
 public:
  Boundary(const PointJudge& judge, const Vec3& X, double reach)
      : judge_(judge), X_(X), inside_(judge.margin(X).value >= 0), best_(2 * reach) {}

  /// Searches all round, then turns the shortest ray until it gets no shorter.
  void search() {
    constexpr int kRays = 200;
    const double golden_angle = std::numbers::pi * (3 - std::sqrt(5.0));
    for (int k = 0; k < kRays; ++k) {
      const double z = 1 - (2 * k + 1.0) / kRays, r = std::sqrt(1 - z * z);
      shorten({r * std::cos(golden_angle * k), r * std::sin(golden_angle * k), z});
    }
    for (const double sign : {-1.0, 1.0})
      for (int axis = 0; axis < 3; ++axis) shorten(sign * Vec3::Unit(axis));
    for (double turn = 0.1; found_ && turn > 1e-5;) {
      const Vec3 n = direction_, u = n.unitOrthogonal(), v = n.cross(u);
      bool better = false;
      for (const Vec3& step : {u, v, Vec3(-u), Vec3(-v)}) {
        if (!shorten((n + turn * step).normalized())) continue;
        better = true;
        break;
      }
      if (!better) turn *= 0.5;
    }
  }
  [[nodiscard]] bool found() const { return found_; }
  [[nodiscard]] double distance() const { return best_; }
  [[nodiscard]] Vec3 point() const { return X_ + best_ * direction_; }
  /// The limit that is broken just beyond the boundary (or, from outside, just before it).
  [[nodiscard]] int limit() const {
    const double way = inside_ ? beyond_ : before_;
    return judge_.margin(X_ + way * direction_).limit;
  }

 private:
  [[nodiscard]] bool crossed(const Vec3& n, double way) const {
    return (judge_.margin(X_ + way * n).value >= 0) != inside_;
  }
  /// Whether the boundary is met along n nearer than so far.
  bool shorten(const Vec3& n) {
    constexpr int kSteps = 48, kHalvings = 40;
    for (int k = 1; k <= kSteps; ++k) {
      double out = best_ * k / kSteps * (1 - 1e-9), in = best_ * (k - 1) / kSteps;
      if (!crossed(n, out)) continue;
      for (int h = 0; h < kHalvings; ++h) {
        const double middle = 0.5 * (in + out);
        (crossed(n, middle) ? out : in) = middle;
      }
      found_ = true;
      direction_ = n;
      before_ = in;
      best_ = beyond_ = out;
      return true;
    }
    return false;
  }

  const PointJudge& judge_;
  Vec3 X_, direction_ = Vec3::UnitZ();
  bool inside_, found_ = false;
  double best_, before_ = 0, beyond_ = 0;
};

/// A ball round X of nearly `distance` that certainly fits, or of less, or none.
Result<double> certain_distance(const AnyMachine& machine, const Options& options, const Vec3& X, double distance) {
  for (const double share : {0.995, 0.95, 0.8, 0.5, 0.2}) {
    const Shape ball{ShapeKind::ellipsoid, X, Vec3::Constant(share * distance)};
    POLYPOD_ASSIGN(held, certainly_holds(machine, options, ball));
    if (held) return share * distance;
  }
  return 0.0;
}

Result<PointFit> fit_of(const AnyMachine& machine, const Options& options, const PointJudge& judge, const Vec3& X,
                        double reach) {
  const Margin margin = judge.margin(X);
  Boundary boundary(judge, X, reach);
  boundary.search();
  PointFit out{X, margin.value >= 0, std::numeric_limits<double>::infinity(), X, 0, margin.limit};
  if (!boundary.found()) return out;
  out.distance = boundary.distance();
  out.boundary = boundary.point();
  if (!out.fits) return out;
  out.limit = boundary.limit();
  POLYPOD_ASSIGN(certain, certain_distance(machine, options, X, out.distance));
  out.certain = certain;
  return out;
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
  return std::visit(
      [&]<class M>(const M& m) -> Result<Fit> {
        if constexpr (!machine::DeltaFamily<M>) {
          return fail("WS140", "tasks are fitted to deltas", {},
                      "name a machine of family rotary-delta or linear-delta");
        } else {
          const double nominal = m.rod_length[0];
          double reach = nominal;
          if constexpr (std::is_same_v<M, machine::RotaryDelta>) reach += m.arm_length[0];
          for (const Vec3& X : points) {
            POLYPOD_ASSIGN(point, fit_of(machine, options, *judge, X, reach));
            out.fits = out.fits && point.fits;
            out.points.push_back(point);
          }
          out.rod_length = scan(0.4 * nominal, 2.5 * nominal, nominal, [&](double length) {
            M changed = m;
            for (int i = 0; i < m.arms; ++i) changed.rod_length[i] += length - nominal;
            const AnyMachine any(changed);
            // Not judge_of, which would look at the whole machine each time.
            const auto other = judge_unchecked(any, options, field_options);
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
