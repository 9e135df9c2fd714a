// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/volume.hpp"

#include <fmt/format.h>
#include <tbb/task_arena.h>

#include "../families/parallel/bounds.hpp"
#include "arm_limits.hpp"
#include "delta_limits.hpp"
#include "hexapod_limits.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {
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
  if (!closed) {
    return fail("WS102", fmt::format("{}: no bounds for an arm without a closed inverse ({})", arm.name,
                                     closed.error().message));
  }
  return ask(ArmLimits(closed->form(), options.limits));
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

/// `first` up to but without `end`.
LimitBits bits_between(int first, int end) {
  return ((LimitBits{1} << (end - first)) - 1) << first;
}

/// The limits of a delta by name; 0 for an unknown one.
LimitBits delta_bits(const std::string& name) {
  using L = machine::DeltaLimits;
  if (name == "drive") return bits_between(L::kMin, L::kSide);
  if (name == "joint") return bits_between(L::kSide, L::kLow);
  if (name == "coordinates") return bits_between(L::kLow, L::kMode);
  if (name == "mode") return bits_between(L::kMode, L::kTable);
  if (name == "table") return bits_between(L::kTable, L::kRods);
  if (name == "rods") return bits_between(L::kRods, L::kBase);
  if (name == "base") return bits_between(L::kBase, L::kCount);
  return 0;
}

}  // namespace

LimitBits interference_bits(const AnyMachine& machine) {
  if (std::holds_alternative<machine::Parallel>(machine)) return 0;
  if (std::holds_alternative<machine::SerialArm>(machine)) return 0;
  if (is_delta(machine)) return bits_between(machine::DeltaLimits::kFirstBody, machine::DeltaLimits::kCount);
  LimitBits bits = 0;
  for (int i = machine::HexapodLimits::kLegPair; i < machine::HexapodLimits::kBasePlane; ++i) bits |= LimitBits{1} << i;
  return bits;
}

Result<LimitBits> limit_bits(const AnyMachine& machine, const std::string& names) {
  const bool serial = std::holds_alternative<machine::SerialArm>(machine);
  using machine::HexapodLimits;
  LimitBits bits = 0;
  for (std::size_t start = 0; start < names.size();) {
    const std::size_t comma = std::min(names.find(',', start), names.size());
    const std::string name = names.substr(start, comma - start);
    start = comma + 1;
    if (const auto* parallel = std::get_if<machine::Parallel>(&machine)) {
      const int n = joint_count(*parallel);
      if (name == "length" || name == "drive") {
        bits |= bits_between(0, 2 * n);
      } else if (name == "coordinates") {
        bits |= bits_between(2 * n, 2 * n + 6);
      } else {
        return fail("WS103", fmt::format("there is no limit \"{}\" to switch off", name), {},
                    "limits: drive (or length), coordinates");
      }
    } else if (serial) {
      int joint = 0;
      for (const char c : name) joint = c >= '0' && c <= '9' && joint < 100 ? 10 * joint + (c - '0') : 1000;
      if (joint < 1 || joint > kinematics::joint_count(machine)) {
        return fail("WS103", fmt::format("there is no joint \"{}\" to switch off", name), {},
                    fmt::format("free joints are 1 to {}", kinematics::joint_count(machine)));
      }
      bits |= bits_between(2 * joint - 2, 2 * joint);
    } else if (is_delta(machine)) {
      const LimitBits named = delta_bits(name);
      if (named == 0) {
        return fail("WS103", fmt::format("there is no limit \"{}\" to switch off", name), {},
                    "limits: drive, joint, coordinates, mode, table, rods, base");
      }
      bits |= named;
    } else if (name == "length") {
      bits |= bits_between(0, HexapodLimits::kBaseJoint);
    } else if (name == "base-joint") {
      bits |= bits_between(HexapodLimits::kBaseJoint, HexapodLimits::kPlatformJoint);
    } else if (name == "platform-joint") {
      bits |= bits_between(HexapodLimits::kPlatformJoint, HexapodLimits::kLegPair);
    } else if (name == "joint") {
      bits |= bits_between(HexapodLimits::kBaseJoint, HexapodLimits::kLegPair);
    } else if (name == "legs") {
      bits |= bits_between(HexapodLimits::kLegPair, HexapodLimits::kBasePlane);
    } else if (name == "base") {
      bits |= bits_between(HexapodLimits::kBasePlane, HexapodLimits::kLow);
    } else if (name == "coordinates") {
      bits |= bits_between(HexapodLimits::kLow, HexapodLimits::kCount);
    } else {
      return fail("WS103", fmt::format("there is no limit \"{}\" to switch off", name), {},
                  "limits: length, base-joint, platform-joint, joint, legs, base, coordinates");
    }
  }
  return bits;
}

Result<Volume> volume(const AnyMachine& machine, const Options& options) {
  POLYPOD_TRY(check(machine, options));
  return std::visit(
      [&](const auto& m) {
        return with_limits(m, options, [&]<class Limits>(const Limits& limits) -> Result<Volume> {
          tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
          return arena.execute([&] { return Subdivision<Limits>(limits, options).run(); });
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
          return Subdivision<Limits>(limits, options).holds(shape, max_cells);
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
    // Only the first choice of a slider counts, as the source takes it; any branch of an arm.
    if (std::holds_alternative<machine::SerialArm>(machine)) {
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
