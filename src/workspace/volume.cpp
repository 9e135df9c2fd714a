// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/volume.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "../families/parallel/bounds.hpp"
#include "arm_limits.hpp"
#include "delta_limits.hpp"
#include "hexapod_limits.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {

extern template Result<Volume> subdivided_volume(const ParallelLimits&, const Options&);
extern template Result<bool> subdivided_holds(const ParallelLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const StrutLimits&, const Options&);
extern template Result<bool> subdivided_holds(const StrutLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const SliderLimits&, const Options&);
extern template Result<bool> subdivided_holds(const SliderLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const DeltaBounds<machine::RotaryDelta>&, const Options&);
extern template Result<bool> subdivided_holds(const DeltaBounds<machine::RotaryDelta>&, const Options&, const Shape&,
                                              std::int64_t);
extern template Result<Volume> subdivided_volume(const DeltaBounds<machine::LinearDelta>&, const Options&);
extern template Result<bool> subdivided_holds(const DeltaBounds<machine::LinearDelta>&, const Options&, const Shape&,
                                              std::int64_t);

namespace {

bool is_delta(const AnyMachine& machine) {
  return std::holds_alternative<machine::RotaryDelta>(machine) || std::holds_alternative<machine::LinearDelta>(machine);
}

Status check(const AnyMachine& machine, const Options& options) {
  if (options.singular_distance != 0 && !(is_delta(machine) && options.singular_distance > 0)) {
    return fail("WS105", is_delta(machine) ? "the distance from singular poses is negative"
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
  if (!(options.relative_tolerance >= 1e-6 && options.relative_tolerance <= 1)) {
    return fail("WS101", fmt::format("the relative tolerance {:g} must be 1e-6 to 1", options.relative_tolerance));
  }
  return {};
}

tl::unexpected<Error> no_bounds(const std::string& name) {
  return fail("WS102",
              fmt::format("{}: no bounds are known for its inverse, so nothing can be proven of its workspace", name),
              {}, "`polypod workspace` without --contains and --largest takes a sample");
}

/// Calls ask(limits) with what the family knows of its limits.
template <class Ask>
auto with_limits(const machine::StrutHexapod& m, const Options& options, Ask&& ask) {
  return ask(StrutLimits(m, options));
}
template <class Ask>
auto with_limits(const machine::SliderHexapod& m, const Options& options, Ask&& ask) {
  return ask(SliderLimits(m, options));
}
template <class Ask>
auto with_limits(const machine::SerialArm& arm, const Options& options, Ask&& ask)
    -> decltype(ask(ArmLimits({}, LimitBits{}))) {
  const auto closed = machine::WristInverse::of(arm);
  if (!closed) return no_bounds(arm.name);
  return ask(ArmLimits(closed->form(), options.limits));
}
template <class Ask>
auto with_limits(const machine::Stages& m, const Options&, Ask&& ask) -> decltype(ask(ArmLimits({}, LimitBits{}))) {
  return no_bounds(m.name);
}
template <class Ask>
auto with_limits(const machine::Parallel& m, const Options& options, Ask&& ask)
    -> decltype(ask(ParallelLimits(m, options))) {
  const machine::Task task = m.task;
  if (!task.places() && task.size() != 3) {
    return fail("WS106", fmt::format("{}: a task of {} coordinates without x, y, z has no volume", m.name, task.size()),
                {}, "workspaces are for tasks that hold x, y, z, or three coordinates in all");
  }
  const Directions& d = options.directions;
  const auto asks = [](const std::optional<std::array<double, 2>>& range) {
    return range && *range != std::array<double, 2>{0, 0};
  };
  const bool whole = task.size() == 6 || task.names_axis();
  if ((d.tilt != 0 && !whole) || (asks(d.a_range) && !(task.places() && task.holds(machine::Coordinate::a))) ||
      (asks(d.b_range) && !(task.places() && task.holds(machine::Coordinate::b)))) {
    return fail("WS104",
                fmt::format("{} cannot tilt its tool as it is told: the task does not hold the angles", m.name), {},
                "leave out the tilt and the ranges of A and B");
  }
  return ask(ParallelLimits(m, options));
}
template <machine::DeltaFamily M, class Ask>
auto with_limits(const M& m, const Options& options, Ask&& ask) -> decltype(ask(DeltaBounds<M>(m, options))) {
  const Directions& d = options.directions;
  constexpr std::array<double, 2> kNone{0, 0};
  if (d.tilt != 0 || d.a_range.value_or(kNone) != kNone || d.b_range.value_or(kNone) != kNone) {
    return fail("WS104", fmt::format("{} is a delta and cannot tilt its tool", m.name), {},
                "leave out the tilt and the ranges of A and B");
  }
  return ask(DeltaBounds<M>(m, options));
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
      [](const auto& m) {
        if constexpr (requires { machine::WristInverse::of(m); }) return machine::WristInverse::of(m).has_value();
        return !requires {
          m.kAnyPosture;
        };
      },
      machine);
}

Result<Volume> volume(const AnyMachine& machine, const Options& options) {
  POLYPOD_TRY(check(machine, options));
  if (!has_bounds(machine)) return sampled_volume(machine, options);
  return std::visit(
      [&](const auto& m) {
        return with_limits(m, options, [&]<class Limits>(const Limits& limits) -> Result<Volume> {
          return subdivided_volume(limits, options);
        });
      },
      machine);
}

Result<bool> certainly_holds(const AnyMachine& machine, const Options& options, const Shape& shape,
                             std::int64_t max_cells) {
  POLYPOD_TRY(check(machine, options));
  return std::visit(
      [&](const auto& m) {
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

bool reaches_samples(const AnyMachine& machine, const Options& options, const std::vector<Mat3>& orientations,
                     const Vec3& p) {
  const LimitBits heeded = options.interference ? options.limits : options.limits & ~interference_bits(machine);
  return std::all_of(orientations.begin(), orientations.end(), [&](const Mat3& R) {
    const auto result = kinematics::inverse(machine, Pose{R, p});
    // Only the first choice of a slider counts, as the source takes it; any posture of a chain.
    if (kinematics::takes_any_posture(machine)) {
      return std::any_of(result.solutions.begin(), result.solutions.end(),
                         [&](const kinematics::Solution& s) { return (s.violations & heeded) == 0; });
    }
    return !result.solutions.empty() && (result.solutions.front().violations & heeded) == 0;
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
