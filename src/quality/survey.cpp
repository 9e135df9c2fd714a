// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/survey.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>

#include "compass.hpp"
#include "four_dexterities.hpp"
#include "joint_finder.hpp"
#include "leg_kernel.hpp"
#include "plan.hpp"
#include "polypod/core/parallel.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "singular_inside.hpp"

namespace polypod::quality {
namespace {

ParallelOptions parallel_options(const SurveyOptions& options) {
  return {options.workspace.threads, options.workspace.cancelled, options.progress};
}

Quantity quantity_of(std::size_t points) {
  return {std::vector<double>(points), std::vector<double>(points), std::vector<int>(points)};
}

/// Fills some quantities from what is asked at each point.
Status fill(const Survey& survey, const SurveyOptions& options, const std::vector<Quantity*>& quantities,
            const Anywhere& anywhere) {
  for (Quantity* q : quantities) *q = quantity_of(survey.inside.size());
  const bool whole = for_each_in_rounds(survey.inside.size(), parallel_options(options), [&](std::size_t i) {
    const PointValues answer = anywhere.at_point(survey.grid.at(survey.inside[i]));
    for (std::size_t k = 0; k < quantities.size(); ++k) {
      quantities[k]->mean[i] = answer.mean[k];
      quantities[k]->worst[i] = answer.worst[k];
      quantities[k]->worst_direction[i] = answer.worst_direction[k];
    }
  });
  if (!whole) return fail("WS110", "cancelled");
  return {};
}

/// The means and the worst of what is put in, direction by direction.
class Directions {
 public:
  explicit Directions(bool dexterity) : dexterity_(dexterity) {
    answer_.worst.fill(std::numeric_limits<double>::quiet_NaN());
  }
  void put(std::size_t direction, const std::array<double, 3>& values) {
    ++count_;
    for (std::size_t v = 0; v < 3; ++v) {
      answer_.mean[v] += values[v];
      const bool large = !dexterity_ || v == 0;
      if (count_ > 1 && (large ? values[v] <= answer_.worst[v] : !(values[v] < answer_.worst[v]))) continue;
      answer_.worst[v] = values[v];
      answer_.worst_direction[v] = static_cast<int>(direction);
    }
  }
  /// No numbers where nothing was put in.
  [[nodiscard]] PointValues answer() const {
    PointValues out = answer_;
    for (double& mean : out.mean) mean = count_ > 0 ? mean / count_ : std::numeric_limits<double>::quiet_NaN();
    return out;
  }

 private:
  PointValues answer_;
  int count_ = 0;
  bool dexterity_;
};

/// Asks pose by pose; one whose joints are not found does not count.
std::function<PointValues(const Vec3&)> pose_by_pose(const AnyMachine& machine, const Survey& survey,
                                                     const Anywhere& anywhere) {
  return [joints = joint_finder(machine), task = survey.task, orientations = survey.orientations,
          at_pose = anywhere.at_pose](const Vec3& p) {
    Directions all(false);
    for (std::size_t d = 0; d < orientations.size(); ++d) {
      const Pose X = workspace::pose_at(task, orientations[d], p);
      if (const auto q = joints(X)) all.put(d, at_pose(X, *q));
    }
    return all.answer();
  };
}

/// Condition, sigma_min and |det| of some poses at a time.
std::function<PointValues(const Vec3&)> dexterity_by_poses(const AnyMachine& machine, const Survey& survey,
                                                           double length) {
  return [&machine, length, joints = joint_finder(machine), task = survey.task,
          orientations = survey.orientations](const Vec3& p) {
    Directions all(true);
    std::array<kinematics::RateMatrix, kLanes> rates;
    std::array<std::size_t, kLanes> direction{};
    std::array<std::array<double, 3>, kLanes> values{};
    std::size_t waiting = 0;
    for (std::size_t d = 0; d < orientations.size(); ++d) {
      const Pose X = workspace::pose_at(task, orientations[d], p);
      if (const auto q = joints(X)) {
        rates[waiting] = kinematics::rate_matrix(machine, X, *q, length);
        direction[waiting++] = d;
      }
      if (waiting == 0 || (waiting < kLanes && d + 1 < orientations.size())) continue;
      dexterities({rates.data(), waiting}, values.data());
      for (std::size_t i = 0; i < waiting; ++i) all.put(direction[i], values[i]);
      waiting = 0;
    }
    return all.answer();
  };
}

/// What `kernel` says.
std::function<PointValues(const Vec3&)> by_kernel(LegKernel kernel, LegQuestion question) {
  return [kernel = std::make_shared<const LegKernel>(std::move(kernel)), question](const Vec3& p) {
    return kernel->ask(question, p);
  };
}

/// Errors that only rounding at a singular pose makes are infinite: the sizes over kNoHold and more.
class Limits {
 public:
  Limits(const AnyMachine& machine, const Survey& survey, const std::vector<Sized>& sizes) {
    const double length = size_of(machine, survey);
    const std::vector<Element> all = elements(machine);
    double total = 0;
    for (const Sized& s : sizes)
      total += std::abs(s.size) * (all[static_cast<std::size_t>(s.element)].unit == "mm" ? 1.0 : length);
    most_ = {total / kinematics::kNoHold, total / length / kinematics::kNoHold};
  }
  /// Position and orientation; with `mean` of the same.
  void apply(std::array<double, 3>& values, std::array<double, 3>* mean = nullptr) const {
    for (std::size_t k = 0; k < 2; ++k) {
      if (!(values[k] > most_[k])) continue;
      values[k] = std::numeric_limits<double>::infinity();
      if (mean != nullptr) (*mean)[k] = values[k];
    }
  }
  /// To what is asked anywhere.
  void apply(Anywhere& anywhere) const {
    anywhere.at_pose = [limits = *this, ask = std::move(anywhere.at_pose)](const Pose& X, const JointVector& q) {
      std::array<double, 3> values = ask(X, q);
      limits.apply(values);
      return values;
    };
    anywhere.at_point = [limits = *this, ask = std::move(anywhere.at_point)](const Vec3& p) {
      PointValues values = ask(p);
      limits.apply(values.worst, &values.mean);
      return values;
    };
  }

 private:
  /// How far the machine reaches, about, m.
  static double size_of(const AnyMachine& machine, const Survey& survey) {
    const workspace::Grid& grid = survey.grid;
    if (survey.task.places()) return (grid.at(grid.size() - 1) - grid.at(0)).norm() + grid.at(0).norm();
    const machine::Reach reach = kinematics::reach(machine);
    return (reach.high - reach.low).norm() + reach.low.norm();
  }

  std::array<double, 2> most_{};
};

/// The kernel for errors of these sizes, if the machine has one.
std::optional<LegKernel> kernel_for(const AnyMachine& machine, const Survey& survey, const std::vector<Sized>& sizes,
                                    Region region) {
  const auto legs = six_legs_of(machine);
  if (!legs) return {};
  LegKernel kernel(*legs, survey.orientations);
  if (!kernel.set_sizes(machine, sizes, region)) return {};
  return kernel;
}

}  // namespace

JointFinder joint_finder(const AnyMachine& machine) {
  JointFinder own = std::visit(
      [](const auto& m) -> JointFinder {
        const Pose X;
        if constexpr (requires { joint_finder(m); }) return joint_finder(m);
        if constexpr (requires { joints_of_legs(m, X); }) return [&m](const Pose& at) { return joints_of_legs(m, at); };
        if constexpr (requires { reachable_joints(m, X); })
          return [&m](const Pose& at) { return reachable_joints(m, at); };
        return {};
      },
      machine);
  if (own) return own;
  return [&machine](const Pose& at) -> std::optional<JointVector> {
    const kinematics::InverseResult result = kinematics::inverse(machine, at);
    if (const kinematics::Solution* s = result.reachable()) return s->joints;
    return {};
  };
}
std::optional<JointVector> joints_at(const AnyMachine& machine, const Pose& X) {
  return joint_finder(machine)(X);
}

Pose pose_at(const Survey& survey, std::size_t point, int direction) {
  return workspace::pose_at(survey.task, survey.orientations[static_cast<std::size_t>(direction)],
                            survey.grid.at(survey.inside[point]));
}

Result<Survey> survey(const AnyMachine& machine, const SurveyOptions& options) {
  Survey out;
  out.orientations = workspace::sampled_orientations(options.workspace.directions);
  const machine::Task task = out.task = kinematics::task(machine);
  POLYPOD_TRY(workspace::held_by(task, machine::name_of(machine), options.workspace.directions));
  if (!task.turns()) out.orientations = {Mat3::Identity()};
  out.box = options.box;
  if (options.box) {
    const auto& [low, high] = *options.box;
    if (options.resolution < 2 || options.resolution > 512) {
      return fail("WS130", fmt::format("a resolution of {} points must be 2 to 512", options.resolution));
    }
    POLYPOD_TRY(workspace::near_home(machine, low, high));
    const Vec3 spacing = workspace::spacing_of(high - low, options.resolution, task);
    const int sides = workspace::coordinates_of_points(task);
    if (!((high - low).minCoeff() >= 0 && spacing.head(sides).maxCoeff() > 0)) return fail("WS130", "the box is empty");
    out.grid.origin.head(sides) = low.head(sides);
    for (int k = 0; k < sides; ++k) {
      const int steps = spacing[k] > 0 ? static_cast<int>(std::ceil((high[k] - low[k]) / spacing[k] - 1e-9)) : 0;
      const double step = steps > 0 ? (high[k] - low[k]) / steps : spacing.head(sides).maxCoeff();
      out.grid.points[static_cast<std::size_t>(k)] = steps + 1;
      out.grid.step[static_cast<std::size_t>(k)] = step * Vec3::Unit(k);
    }
  } else {
    POLYPOD_ASSIGN(box, workspace::extent(machine, options.workspace, false));
    if (box.empty()) {
      return fail("QU110", "no point is reachable from all required directions", {}, "ask for less tilt");
    }
    POLYPOD_ASSIGN(grid, workspace::grid_over(box.low, box.high, options.resolution, task));
    out.grid = grid;
    if (!task.places()) out.box = {box.low, box.high};
  }
  POLYPOD_ASSIGN(inside, workspace::points_inside(machine, options.workspace, out.grid, options.box.has_value()));
  out.inside = std::move(inside.points);
  out.whole_box = !options.box || out.inside.size() == out.grid.size();
  if (out.inside.empty()) {
    return fail(
        "QU110", "no point of the grid is reachable from all required directions", {},
        task.places() ? "ask for less tilt, or raise the resolution" : "ask for another box, or raise the resolution");
  }
  // Of the workspace the middle of proven bounds, where they are close; else what the grid sees.
  constexpr double kClose = 0.05;
  const double cell = std::abs(out.grid.step[0].dot(out.grid.step[1].cross(out.grid.step[2])));
  const double share = static_cast<double>(out.inside.size()) / static_cast<double>(out.grid.size());
  if (options.box) {
    out.volume = share * ((*options.box)[1] - (*options.box)[0]).prod();
  } else if (inside.upper - inside.lower <= kClose * inside.volume) {
    out.volume = inside.volume;
  } else {
    out.volume = cell * static_cast<double>(out.inside.size());
  }
  out.volume_lower = out.volume_upper = out.volume;
  if (!options.box && out.volume == inside.volume) {
    out.volume_lower = inside.lower;
    out.volume_upper = inside.upper;
  }
  const auto& points = out.grid.points;
  const bool flat = *std::min_element(points.begin(), points.begin() + workspace::coordinates_of_points(task)) ==
                    1;                                    // a section: nobody looks for extremes there
  const bool no_boundary = options.box && out.whole_box;  // the box's own ends are points of the grid
  if (!flat && !no_boundary) out.tips = tips_of(machine, out, options);
  const SingularInside singular = singular_inside(machine, out, options);
  out.singular = singular.pose;
  out.beyond = singular.beyond;
  return out;
}

Extreme worst_of(const Survey& survey, const Quantity& q) {
  std::size_t at = 0;
  for (std::size_t i = 1; i < q.worst.size(); ++i)
    if (std::isnan(q.worst[at]) || q.worst[i] > q.worst[at]) at = i;
  return {pose_at(survey, at, q.worst_direction[at]), q.worst[at]};
}

Statistics statistics(const Survey& survey, const std::vector<double>& values) {
  Statistics s{std::numeric_limits<double>::infinity(), 0, -std::numeric_limits<double>::infinity(), 0, {}, {}};
  double count = 0, square = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double x = values[i];
    if (std::isnan(x)) continue;
    if (x < s.min) {
      s.min = x;
      s.min_at = survey.grid.at(survey.inside[i]);
    }
    if (x > s.max) {
      s.max = x;
      s.max_at = survey.grid.at(survey.inside[i]);
    }
    if (!std::isfinite(x)) continue;
    // Welford's sums: no cancellation.
    ++count;
    const double off = x - s.mean;
    s.mean += off / count;
    square += off * (x - s.mean);
  }
  s.stddev = count > 0 ? std::sqrt(square / count) : std::numeric_limits<double>::quiet_NaN();
  if (count == 0) s.mean = s.stddev;
  return s;
}

Result<DexterityField> dexterity_field(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                                       double length) {
  DexterityField out;
  out.length = length;
  std::optional<LegKernel> kernel;
  if (const auto legs = six_legs_of(machine)) {
    kernel.emplace(*legs, survey.orientations);
    kernel->set_length(length);
    out.length = kernel->length();
  }
  out.anywhere.at_pose = [&machine, length](const Pose& X, const JointVector& q) {
    const kinematics::Dexterity d = kinematics::dexterity(machine, X, q, length);
    return std::array<double, 3>{d.condition, d.sigma_min, std::abs(d.determinant)};
  };
  out.anywhere.at_point =
      kernel ? by_kernel(std::move(*kernel), LegQuestion::dexterity) : dexterity_by_poses(machine, survey, length);
  POLYPOD_TRY(fill(survey, options, {&out.condition, &out.sigma_min, &out.determinant}, out.anywhere));
  return out;
}

Result<ErrorField> known_error_field(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                                     const std::vector<Sized>& errors) {
  ErrorField out;
  out.anywhere.at_pose = [&machine, plan = Plan::for_many_poses(machine, errors)](const Pose& X, const JointVector& q) {
    const Vec6 error = linear_error(machine, X, q, *plan);
    return std::array<double, 3>{error.head<3>().norm(), heeded(plan->task, X, error.tail<3>()).norm(), 0};
  };
  auto kernel = kernel_for(machine, survey, errors, Region::box);
  out.anywhere.at_point =
      kernel ? by_kernel(std::move(*kernel), LegQuestion::known) : pose_by_pose(machine, survey, out.anywhere);
  Limits(machine, survey, errors).apply(out.anywhere);
  POLYPOD_TRY(fill(survey, options, {&out.position, &out.orientation}, out.anywhere));
  return out;
}

Result<ErrorField> tolerance_field(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                                   const std::vector<Sized>& tolerances, const ToleranceOptions& tolerance) {
  ErrorField out;
  /// The first error of any pose.
  struct Failure {
    std::atomic<bool> any = false;
    Error error;
  };
  const auto failure = std::make_shared<Failure>();
  out.anywhere.at_pose = [&machine, tolerance, failure, plan = Plan::for_many_poses(machine, tolerances)](
                             const Pose& X, const JointVector& q) {
    const auto list = generators(X, error_columns(machine, X, q, *plan), *plan, tolerance.region);
    if (!list) {
      if (!failure->any.exchange(true)) failure->error = list.error();
      return std::array<double, 3>{};
    }
    return std::array<double, 3>{farthest(*list, *plan, &Generator::position, tolerance.method).distance,
                                 farthest(*list, *plan, &Generator::orientation, tolerance.method).distance, 0};
  };
  auto kernel = tolerance.method == Method::exact ? kernel_for(machine, survey, tolerances, tolerance.region)
                                                  : std::optional<LegKernel>();
  out.anywhere.at_point =
      kernel ? by_kernel(std::move(*kernel), LegQuestion::tolerance) : pose_by_pose(machine, survey, out.anywhere);
  Limits(machine, survey, tolerances).apply(out.anywhere);
  POLYPOD_TRY(fill(survey, options, {&out.position, &out.orientation}, out.anywhere));
  if (failure->any) return tl::unexpected(failure->error);
  return out;
}

}  // namespace polypod::quality
