// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "compass.hpp"
#include "polypod/core/parallel.hpp"
#include "polypod/core/random.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::quality {
namespace {

/// The two angles of a required direction: tilt and azimuth of a cone, A and B of ranges; and how they may change.
class Turned {
 public:
  explicit Turned(const workspace::Directions& d) : d_(d) {}

  [[nodiscard]] bool fixed() const { return !d_.is_ranges() && d_.tilt == 0; }
  [[nodiscard]] Eigen::Vector2d angles(const Mat3& R) const {
    if (d_.is_ranges()) return {std::atan2(-R(1, 2), R(1, 1)), std::atan2(-R(2, 0), R(0, 0))};
    const Vec3 turn = rotation_vector(R);
    return {turn.norm(), std::atan2(-turn.x(), turn.y())};
  }
  /// The direction with its angles changed by shares of a quarter of their ranges, or of 30 deg of azimuth.
  [[nodiscard]] Mat3 moved(const Mat3& R, const Eigen::Vector2d& shares) const {
    Eigen::Vector2d a = angles(R);
    if (d_.is_ranges()) {
      for (int k = 0; k < 2; ++k) {
        const auto& range = k == 0 ? d_.a_range : d_.b_range;
        const std::array<double, 2> ends = range.value_or(std::array<double, 2>{0, 0});
        a[k] = std::clamp(a[k] + shares[k] * (ends[1] - ends[0]) / 4, ends[0], ends[1]);
      }
      return rotation_abc(a[0], a[1], 0);
    }
    a += shares.cwiseProduct(Eigen::Vector2d(d_.tilt / 4, std::numbers::pi / 6));
    a[0] = std::clamp(a[0], 0.0, d_.tilt);
    return rotation_of(a[0] * Vec3(-std::sin(a[1]), std::cos(a[1]), 0));
  }

 private:
  const workspace::Directions& d_;
};

/// The point of the survey's box nearest to p.
Vec3 in_box(const Survey& survey, const Vec3& p) {
  if (!survey.box) return p;
  return p.cwiseMax((*survey.box)[0]).cwiseMin((*survey.box)[1]);
}

/// By more than rounding, so that of mirror images the first counts everywhere.
bool better(double value, double than) {
  constexpr double kGain = 1e-9;
  return value > than + kGain * std::abs(than);
}

/// Poses by how good they are, no two points within two spacings of the grid of each other, at most `most`; values that
/// are not finite do not count.
std::vector<Seen> best_apart(const Survey& survey, std::vector<Seen> poses, std::size_t most) {
  std::erase_if(poses, [](const Seen& e) { return !std::isfinite(e.value); });
  std::stable_sort(poses.begin(), poses.end(), [](const Seen& a, const Seen& b) { return a.value > b.value; });
  const Vec3 unit = units_of(survey);
  const double apart = 2 * survey.grid.step[0].cwiseQuotient(unit).norm();
  std::vector<Seen> out;
  for (const Seen& e : poses) {
    if (out.size() == most) break;
    if (std::none_of(out.begin(), out.end(),
                     [&](const Seen& taken) { return (taken.p - e.p).cwiseQuotient(unit).norm() < apart; }))
      out.push_back(e);
  }
  return out;
}

/// What is looked for over a survey: the largest `value`, from the best points of the grid and the best of its tips.
struct Search {
  std::vector<Seen> points, tips;
  bool turn = false;
  SeenValue value;
};

/// The best of all climbs, the same for any number of threads. Value -infinity where nothing is finite.
Seen best_of(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options, const Search& search) {
  const std::size_t most = survey.orientations.size() == 1 ? 4 : 2;  // of each kind: many directions cost as much
  std::vector<Seen> starts = best_apart(survey, search.points, most);
  for (const Seen& tip : best_apart(survey, search.tips, most)) starts.push_back(tip);
  std::vector<Seen> ends(starts.size());
  // Not to be stopped half way: a command asks for it between its longer works.
  for_each_in_rounds(
      starts.size(), {options.workspace.threads, {}, {}},
      [&](std::size_t i) { ends[i] = climb(machine, survey, options, starts[i], search.turn, search.value); }, 1);
  Seen best;
  best.value = -std::numeric_limits<double>::infinity();
  for (const Seen& end : ends)
    if (best.value == -std::numeric_limits<double>::infinity() || better(end.value, best.value)) best = end;
  return best;
}

/// The quantity at the singular pose of the survey, where it has one.
std::optional<double> at_singular(const AnyMachine& machine, const Survey& survey, const Anywhere& anywhere,
                                  std::size_t number) {
  if (!survey.singular) return {};
  const auto q = joints_at(machine, *survey.singular);
  if (!q) return {};
  return anywhere.at_pose(*survey.singular, *q)[number];
}

/// The largest (sign 1) or least mean over the directions.
Seen mean_seen(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options, const Quantity& quantity,
               const Anywhere& anywhere, std::size_t number, double sign) {
  Search search;
  search.value = [&](const Mat3&, const Vec3& p) { return sign * anywhere.at_point(p).mean[number]; };
  const Mat3& R = survey.orientations[0];
  for (std::size_t i = 0; i < quantity.mean.size(); ++i)
    search.points.push_back({R, survey.grid.at(survey.inside[i]), sign * quantity.mean[i]});
  for (const Vec3& p : survey.tips) search.tips.push_back({R, p, search.value(R, p)});
  Seen out = best_of(machine, survey, options, search);
  out.value *= sign;
  return out;
}

}  // namespace

Vec3 units_of(const Survey& survey) {
  if (survey.task.places()) return Vec3::Ones();
  return {survey.grid.step[0].norm(), survey.grid.step[1].norm(), survey.grid.step[2].norm()};
}

Seen climb(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options, const Seen& start, bool turn,
           const SeenValue& value) {
  constexpr double kFirst = 0.5, kLongest = 2, kFinest = 1e-3;
  // Each step of a mean asks all directions: fewer steps where there are many.
  const bool one = survey.orientations.size() == 1;
  const int most_steps = turn ? 800 : std::max(80, 1500 / static_cast<int>(survey.orientations.size()));
  const int slanting = one || turn ? 10 : 3;  // pairs of pseudo-random directions beside the coordinates
  using Step = Eigen::Matrix<double, 5, 1>;
  const Turned turned(options.workspace.directions);
  const int axes = turn && !turned.fixed() ? 5 : 3;
  Random random(1);
  const Vec3 unit = units_of(survey);
  Seen best = start;
  int asked = 0;
  const auto inside = [&](const Vec3& p) {
    return workspace::reaches_samples(machine, options.workspace, survey.orientations, p);
  };
  // A step that leaves the workspace is pulled back to its boundary towards the middle, by no more than its length.
  const Vec3 middle = survey.grid.at(survey.inside[survey.inside.size() / 2]);
  const auto pulled_back = [&](Vec3& p) {
    const int halvings = one || turn ? 12 : 3;
    const Vec3 pull =
        (p - best.p).cwiseQuotient(unit).norm() * (middle - p).cwiseQuotient(unit).normalized().cwiseProduct(unit);
    double out = 0, in = 1;
    if (!inside(p + pull)) return false;
    for (int k = 0; k < halvings; ++k) (inside(p + 0.5 * (out + in) * pull) ? in : out) = 0.5 * (out + in);
    p = in_box(survey, p + in * pull);
    return inside(p);
  };
  const auto gains = [&](const Step& step) {
    ++asked;
    Seen next = best;
    for (int k = 0; k < 3; ++k) next.p += step[k] * survey.grid.step[static_cast<std::size_t>(k)];
    next.p = in_box(survey, next.p);
    if (!inside(next.p) && !pulled_back(next.p)) return false;
    if (axes == 5) next.R = turned.moved(best.R, step.tail<2>());
    next.value = value(next.R, next.p);
    if (!better(next.value, best.value)) return false;
    best = next;
    return true;
  };
  const auto either_way = [&](Step& step) {
    if (gains(step)) return true;
    step = -step;
    return gains(step);
  };
  Step last = Step::Zero();
  for (double share = kFirst; share > kFinest && asked < most_steps;) {
    bool found = !last.isZero() && gains(share * last);
    for (int k = 0; k < axes + slanting && !found; ++k) {
      Step step = Step::Zero();
      if (k < axes) {
        step[k] = share;
      } else {
        for (int i = 0; i < axes; ++i) step[i] = random.normal();
        step *= share / step.norm();
      }
      found = either_way(step);
      if (found) last = step / share;
    }
    if (!found) last.setZero();
    share = found ? std::min(2 * share, kLongest) : share / 2;
  }
  return best;
}

std::vector<Vec3> tips_of(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options) {
  std::vector<Vec3> out;
  const int deep = workspace::coordinates_of_points(survey.task) < 3 ? 0 : 1;  // no direction is along no coordinate
  for (int i = -1; i <= 1; ++i)
    for (int j = -1; j <= 1; ++j)
      for (int k = -deep; k <= deep; ++k)
        if (survey.orientations.size() == 1 ? i != 0 || j != 0 || k != 0 : (i + j + k) % 2 != 0)
          out.push_back(Vec3(i, j, k).normalized());
  const Vec3 unit = units_of(survey);
  for_each_in_rounds(
      out.size(), {options.workspace.threads, {}, {}},
      [&](std::size_t n) {
        const Vec3 along = out[n].cwiseQuotient(unit);
        Seen start{survey.orientations[0], survey.grid.at(survey.inside[0]), 0};
        for (const std::size_t i : survey.inside)
          if (along.dot(survey.grid.at(i) - start.p) > 0) start.p = survey.grid.at(i);
        // Counted from the start: steps far from the origin of M must not drown in it.
        const Vec3 from = start.p;
        const SeenValue farther = [&](const Mat3&, const Vec3& p) { return along.dot(p - from); };
        out[n] = climb(machine, survey, options, start, false, farther).p;
      },
      1);
  return out;
}

Statistics statistics_seen(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                           const Quantity& quantity, const Anywhere& anywhere, std::size_t number) {
  Statistics out = statistics(survey, quantity.mean);
  for (const double sign : {1.0, -1.0}) {
    double& extreme = sign > 0 ? out.max : out.min;
    Vec3& at = sign > 0 ? out.max_at : out.min_at;
    if (!std::isfinite(extreme)) continue;
    if (const auto singular = at_singular(machine, survey, anywhere, number);
        singular && survey.orientations.size() == 1 && better(sign * *singular, sign * extreme)) {
      extreme = *singular;
      at = workspace::point_of(survey.task, *survey.singular);
      continue;
    }
    const Seen found = mean_seen(machine, survey, options, quantity, anywhere, number, sign);
    extreme = found.value;
    at = found.p;
  }
  return out;
}

Extreme worst_seen(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                   const Quantity& quantity, const Anywhere& anywhere, std::size_t number, double sign) {
  const auto beyond =
      std::find_if(quantity.worst.begin(), quantity.worst.end(), [](double v) { return std::isinf(v); });
  if (beyond != quantity.worst.end()) {
    const auto i = static_cast<std::size_t>(beyond - quantity.worst.begin());
    return {pose_at(survey, i, quantity.worst_direction[i]), *beyond};
  }
  const auto or_singular = [&](const Seen& found) {
    const auto value = at_singular(machine, survey, anywhere, number);
    return value && better(sign * *value, sign * found.value)
               ? Extreme{*survey.singular, *value}
               : Extreme{workspace::pose_at(survey.task, found.R, found.p), found.value};
  };
  // Of one direction the mean and the worst are the same quantity, and so the same search.
  if (survey.orientations.size() == 1)
    return or_singular(mean_seen(machine, survey, options, quantity, anywhere, number, sign));
  Search search;
  search.turn = true;
  search.value = [&](const Mat3& R, const Vec3& p) {
    const Pose X = workspace::pose_at(survey.task, R, p);
    const auto q = joints_at(machine, X);
    return q ? sign * anywhere.at_pose(X, *q)[number] : std::numeric_limits<double>::quiet_NaN();
  };
  for (std::size_t i = 0; i < quantity.worst.size(); ++i)
    search.points.push_back({survey.orientations[static_cast<std::size_t>(quantity.worst_direction[i])],
                             survey.grid.at(survey.inside[i]), sign * quantity.worst[i]});
  for (const Vec3& p : survey.tips) {
    const PointValues there = anywhere.at_point(p);
    const Mat3& R = survey.orientations[static_cast<std::size_t>(there.worst_direction[number])];
    search.tips.push_back({R, p, search.value(R, p)});
  }
  Seen best = best_of(machine, survey, options, search);
  best.value *= sign;
  return or_singular(best);
}

}  // namespace polypod::quality
