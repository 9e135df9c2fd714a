// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/volume.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <bit>

#include "../families/bounds.hpp"
#include "by_closure/bounds.hpp"
#include "margin.hpp"
#include "no_bounds.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/workspace/shape.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::workspace {
namespace {

/// Whether the family can say how near a point is to a singular pose.
bool measures_closeness(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        return requires {
          closeness(m, Vec3());
        };
      },
      machine);
}

Status check(const AnyMachine& machine, const Options& options) {
  if (options.singular_distance != 0 && !(measures_closeness(machine) && options.singular_distance > 0)) {
    return fail("WS105", measures_closeness(machine) ? "the distance from singular poses is negative"
                                                     : "a distance from singular poses is known for deltas only");
  }
  const Directions& d = options.directions;
  constexpr double kRight = std::numbers::pi / 2;
  if (!(d.tilt >= 0 && d.tilt < kRight)) {
    return fail("WS100", fmt::format("tilt = {:g} deg must be at least 0 and below 90", units::to_deg(d.tilt)));
  }
  if (d.is_ranges() && d.tilt != 0) {
    return fail("WS100", "directions are given both as a tilt and as ranges of A and B", {}, "give one of them");
  }
  for (const auto& [range, name] : {std::pair{d.a_range, "A"}, std::pair{d.b_range, "B"}}) {
    if (!range) continue;
    const auto [low, high] = *range;
    if (!(low <= high && low >= -2 * kRight && high <= 2 * kRight)) {
      return fail("WS100", fmt::format("the range of {} is {:g} to {:g} deg; it must rise and lie in -180 to 180", name,
                                       units::to_deg(low), units::to_deg(high)));
    }
  }
  POLYPOD_TRY(held_by(kinematics::task(machine), machine::name_of(machine), d));
  if (!(options.relative_tolerance >= 1e-6 && options.relative_tolerance <= 1)) {
    return fail("WS101", fmt::format("the relative tolerance {:g} must be 1e-6 to 1", options.relative_tolerance));
  }
  return {};
}

/// A region of coordinates that bounds do not enclose in so many boxes keeps those that it has: without x, y and z the
/// coordinates that follow may be enclosed so loosely that no number of boxes would do.
constexpr std::int64_t kMostBoxesOfCoordinates = 500'000;

/// Families without bounds of their own whose closure proves them.
template <class M>
constexpr bool kByClosure = requires(const M& m) {
  bounds_follow_from_closure(m);
};

/// Calls ask(limits) with what the family knows of its limits over boxes (bounds_of), if it knows something.
template <class M, class Ask>
auto with_limits(const M& m, const Options& options, Ask&& ask) {
  if constexpr (requires { bounds_of(m, options); }) {
    auto limits = bounds_of(m, options);
    using Answer = decltype(ask(*limits));
    if (!limits) return Answer(tl::unexpected(limits.error()));
    if constexpr (requires { std::visit(ask, *limits); }) {  // different ones for the inverses of one family
      return std::visit(ask, *limits);
    } else {
      return ask(*limits);
    }
  } else if constexpr (kByClosure<M>) {
    auto limits = ClosureLimits::of(std::make_shared<const by_closure::QuestionsTo<M>>(m), options);
    using Answer = decltype(ask(**limits));
    if (!limits) return Answer(tl::unexpected(limits.error()));
    if (!*limits) return Answer(no_bounds(m.name));
    return ask(**limits);
  } else {
    return no_bounds(m.name);
  }
}

/// What the bounds prove, or a sample where that does not come within the tolerance by so many boxes: a loose bound
/// takes too long to be of use. Who asks for the boxes themselves gets those that there are. `loose_sides`: the sides
/// are as loose as the volume, for finer ones would take longer than it.
template <class Limits>
Result<Volume> proven_or_sampled(const AnyMachine& machine, const Limits& limits, const Options& options,
                                 std::int64_t most_boxes, bool loose_sides) {
  Options some = options;
  constexpr double kSides = 1e-3;
  if (loose_sides && options.bounds_tolerance > 0) some.bounds_tolerance = std::max(options.bounds_tolerance, kSides);
  // A region of coordinates keeps its bounds, however loose.
  if (kinematics::task(machine).places()) some.max_cells = std::min(options.max_cells, most_boxes);
  const bool all = options.keep_cells || some.max_cells == options.max_cells;
  POLYPOD_ASSIGN(proven, subdivided_volume(limits, some, all));
  if (proven.converged || all || proven.stopped == Stopped::memory) return proven;
  POLYPOD_ASSIGN(sampled, sampled_volume(machine, options));
  sampled.seconds += proven.seconds;
  return sampled;
}
constexpr std::int64_t kFewBoxes = 150'000;
/// Of a cone a box takes up to a hundred times as long as of one direction: so many times fewer are taken.
constexpr std::int64_t kConeCosts = 8;
bool one_direction(const Directions& directions) {
  const auto one = [](const std::optional<std::array<double, 2>>& range) {
    return !range || (*range)[0] == (*range)[1];
  };
  return directions.tilt == 0 && one(directions.a_range) && one(directions.b_range);
}

/// Refuses what has no end where these limits are off.
Status ended(const AnyMachine& machine, LimitBits off) {
  if (off == 0) return {};
  const std::vector<std::string> names = kinematics::limit_names(machine, off);
  const machine::LimitTable table = kinematics::limit_table(machine);
  return fail(
      "WS108",
      fmt::format("without the limit \"{}\" no drive ends this workspace, and its size is not finite, or not "
                  "known; limits of the tool tip do not take its place",
                  names.front()),
      {},
      fmt::format("leave `{}` on{}", table[static_cast<std::size_t>(std::countr_zero(off))].group,
                  kinematics::task(machine).places() ? "; a box can still be judged without it: --contains" : ""));
}

}  // namespace

LimitBits interference_bits(const AnyMachine& machine) {
  LimitBits bits = 0;
  const machine::LimitTable table = kinematics::limit_table(machine);
  for (std::size_t i = 0; i < table.size(); ++i)
    if (table[i].between_bodies) bits |= LimitBits{1} << i;
  return bits;
}

Result<LimitBits> limit_bits(const AnyMachine& machine, const std::string& names) {
  const machine::LimitTable table = kinematics::limit_table(machine);
  // "joint" is base-joint and platform-joint; "length" the drives of legs that it ends.
  const auto is_called = [](const machine::LimitInfo& limit, const std::string& name) {
    return limit.group == name || limit.group.ends_with("-" + name) ||
           (limit.group == "drive" && limit.holds_reach && name == "length");
  };
  LimitBits bits = 0;
  for (std::size_t start = 0; start < names.size();) {
    const std::size_t comma = std::min(names.find(',', start), names.size());
    const std::string name = names.substr(start, comma - start);
    start = comma + 1;
    LimitBits named = 0;
    for (std::size_t i = 0; i < table.size(); ++i)
      if (is_called(table[i], name)) named |= LimitBits{1} << i;
    if (named == 0) {
      std::vector<std::string> groups;
      for (const machine::LimitInfo& limit : table)
        if (std::find(groups.begin(), groups.end(), limit.group) == groups.end()) groups.push_back(limit.group);
      return fail("WS103", fmt::format("there is no limit \"{}\" to switch off", name), {},
                  fmt::format("limits: {}", fmt::join(groups, ", ")));
    }
    bits |= named;
  }
  return bits;
}

bool has_bounds(const AnyMachine& machine) {
  return std::visit(
      []<class M>(const M& m) {
        if constexpr (requires { bounded(m); }) return bounded(m);
        if constexpr (kByClosure<M>) {
          const auto limits = ClosureLimits::of(std::make_shared<const by_closure::QuestionsTo<M>>(m), Options{});
          return limits && limits->has_value();
        }
        return requires(const Options& options) {
          bounds_of(m, options);
        };
      },
      machine);
}

bool bounds_are_slow(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        if constexpr (requires { bounds_are_slow(m); }) return bounds_are_slow(m);
        return false;
      },
      machine);
}

Result<Volume> volume(const AnyMachine& machine, const Options& options) {
  POLYPOD_TRY(check(machine, options));
  return std::visit(
      [&]<class M>(const M& m) -> Result<Volume> {
        if constexpr (kByClosure<M>) {  // with the limits that are heeded here
          POLYPOD_ASSIGN(limits, ClosureLimits::of(std::make_shared<const by_closure::QuestionsTo<M>>(m), options));
          return limits ? proven_or_sampled(machine, *limits, options, kFewBoxes, true)
                        : sampled_volume(machine, options);
        }
        if (!has_bounds(machine)) return sampled_volume(machine, options);
        return with_limits(m, options, [&]<class Limits>(const Limits& limits) -> Result<Volume> {
          POLYPOD_TRY(ended(machine, limits.ends() & ~options.limits));
          if constexpr (requires { limits.few_boxes(); }) {
            std::int64_t few = limits.few_boxes();
            if (few < options.max_cells && kinematics::task(machine).places()) {
              if (!one_direction(options.directions)) {
                if constexpr (requires { limits.few_boxes_of_a_cone(); }) {
                  few = limits.few_boxes_of_a_cone();
                } else {
                  few /= kConeCosts;
                }
              }
              return proven_or_sampled(machine, limits, options, few, kinematics::is_serial(machine));
            }
          }
          Options some = options;
          if (!kinematics::task(machine).places()) {
            some.max_cells = std::min(options.max_cells, kMostBoxesOfCoordinates);
          }
          return subdivided_volume(limits, some, true);
        });
      },
      machine);
}

Result<bool> certainly_holds(const AnyMachine& machine, const Options& options, const Shape& shape,
                             std::int64_t max_cells) {
  POLYPOD_TRY(check(machine, options));
  return std::visit(
      [&](const auto& m) -> Result<bool> {
        return with_limits(m, options, [&]<class Limits>(const Limits& limits) -> Result<bool> {
          return subdivided_holds(limits, options, shape, max_cells);
        });
      },
      machine);
}

std::vector<Mat3> sampled_orientations(const Directions& d) {
  std::vector<Mat3> orientations;
  if (d.is_ranges()) {
    const std::array<double, 2> none{0, 0};
    const auto a = d.a_range.value_or(none), b = d.b_range.value_or(none);
    for (int i = 0; i <= 4; ++i)
      for (int j = 0; j <= 4; ++j)
        orientations.push_back(rotation_y(b[0] + 0.25 * j * (b[1] - b[0])) *
                               rotation_x(a[0] + 0.25 * i * (a[1] - a[0])));
    return orientations;
  }
  orientations.push_back(Mat3::Identity());
  for (int i = 4; i >= 1 && d.tilt > 0; --i)
    for (int j = 0; j < 12; ++j) {
      const double azimuth = 2 * std::numbers::pi * j / 12;
      orientations.push_back(rotation_of(0.25 * i * d.tilt * Vec3(-std::sin(azimuth), std::cos(azimuth), 0)));
    }
  return orientations;
}

LimitBits checked_limits(const AnyMachine& machine, const Options& options) {
  return options.interference ? options.limits : options.limits & ~interference_bits(machine);
}

bool reaches_samples(const AnyMachine& machine, const Options& options, const std::vector<Mat3>& orientations,
                     const Vec3& p) {
  const LimitBits heeded = checked_limits(machine, options);
  const machine::Task task = kinematics::task(machine);
  if (!near_home(machine, p, p)) return false;
  return std::all_of(orientations.begin(), orientations.end(), [&](const Mat3& R) {
    const Pose X = pose_at(task, R, p);
    return std::visit(
        [&](const auto& m) {
          if constexpr (requires { reaches(m, X, heeded); }) return reaches(m, X, heeded);
          const auto result = inverse(m, X);
          // Only the first choice of a slider counts, as the source takes it; any posture of a chain.
          if (kinematics::takes_any_posture(machine)) return result.keeps(heeded);
          return !result.solutions.empty() && (result.solutions.front().violations & heeded) == 0;
        },
        machine);
  });
}

double scan_volume(const AnyMachine& machine, const Options& options, const Vec3& min, const Vec3& max, int steps) {
  const std::vector<Mat3> orientations = sampled_orientations(options.directions);
  std::int64_t inside = 0;
  for (int i = 0; i < steps; ++i)
    for (int j = 0; j < steps; ++j)
      for (int k = 0; k < steps; ++k) {
        const Vec3 p = min + Vec3(i + 0.5, j + 0.5, k + 0.5).cwiseProduct(max - min) / steps;
        inside += reaches_samples(machine, options, orientations, p) ? 1 : 0;
      }
  return static_cast<double>(inside) * (max - min).prod() / (static_cast<double>(steps) * steps * steps);
}

}  // namespace polypod::workspace
