// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/volume.hpp"

#include <fmt/format.h>
#include <tbb/task_arena.h>

#include "arm_limits.hpp"
#include "hexapod_limits.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {
namespace {

Status check(const Options& options) {
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

}  // namespace

LimitBits interference_bits(const AnyMachine& machine) {
  if (std::holds_alternative<machine::SerialArm>(machine)) return 0;
  LimitBits bits = 0;
  for (int i = machine::HexapodLimits::kLegPair; i < machine::HexapodLimits::kBasePlane; ++i) bits |= LimitBits{1} << i;
  return bits;
}

Result<LimitBits> limit_bits(const AnyMachine& machine, const std::string& names) {
  const bool serial = std::holds_alternative<machine::SerialArm>(machine);
  using machine::HexapodLimits;
  const auto range = [](int first, int end) { return ((LimitBits{1} << (end - first)) - 1) << first; };
  LimitBits bits = 0;
  for (std::size_t start = 0; start < names.size();) {
    const std::size_t comma = std::min(names.find(',', start), names.size());
    const std::string name = names.substr(start, comma - start);
    start = comma + 1;
    if (serial) {
      int joint = 0;
      for (const char c : name) joint = c >= '0' && c <= '9' && joint < 100 ? 10 * joint + (c - '0') : 1000;
      if (joint < 1 || joint > kinematics::joint_count(machine)) {
        return fail("WS103", fmt::format("there is no joint \"{}\" to switch off", name), {},
                    fmt::format("free joints are 1 to {}", kinematics::joint_count(machine)));
      }
      bits |= range(2 * joint - 2, 2 * joint);
    } else if (name == "length") {
      bits |= range(0, HexapodLimits::kBaseJoint);
    } else if (name == "base-joint") {
      bits |= range(HexapodLimits::kBaseJoint, HexapodLimits::kPlatformJoint);
    } else if (name == "platform-joint") {
      bits |= range(HexapodLimits::kPlatformJoint, HexapodLimits::kLegPair);
    } else if (name == "joint") {
      bits |= range(HexapodLimits::kBaseJoint, HexapodLimits::kLegPair);
    } else if (name == "legs") {
      bits |= range(HexapodLimits::kLegPair, HexapodLimits::kBasePlane);
    } else if (name == "base") {
      bits |= range(HexapodLimits::kBasePlane, HexapodLimits::kCountSlider);
    } else {
      return fail("WS103", fmt::format("there is no limit \"{}\" to switch off", name), {},
                  "limits: length, base-joint, platform-joint, joint, legs, base");
    }
  }
  return bits;
}

Result<Volume> volume(const AnyMachine& machine, const Options& options) {
  POLYPOD_TRY(check(options));
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
  POLYPOD_TRY(check(options));
  return std::visit(
      [&](const auto& m) {
        return with_limits(m, options, [&]<class Limits>(const Limits& limits) -> Result<bool> {
          return Subdivision<Limits>(limits, options).holds(shape, max_cells);
        });
      },
      machine);
}

double scan_volume(const AnyMachine& machine, const Options& options, const Vec3& min, const Vec3& max, int steps) {
  std::vector<Mat3> orientations;
  const Directions& d = options.directions;
  if (d.is_ranges()) {
    const std::array<double, 2> none{0, 0};
    const auto a = d.a_range.value_or(none), b = d.b_range.value_or(none);
    for (int i = 0; i <= 4; ++i)
      for (int j = 0; j <= 4; ++j)
        orientations.push_back(rotation_y(b[0] + 0.25 * j * (b[1] - b[0])) *
                               rotation_x(a[0] + 0.25 * i * (a[1] - a[0])));
  } else {
    orientations.push_back(Mat3::Identity());
    for (int i = 4; i >= 1 && d.tilt > 0; --i)
      for (int j = 0; j < 12; ++j) {
        const double azimuth = 2 * std::numbers::pi * j / 12;
        orientations.push_back(rotation_of(0.25 * i * d.tilt * Vec3(-std::sin(azimuth), std::cos(azimuth), 0)));
      }
  }
  const LimitBits heeded = options.interference ? options.limits : options.limits & ~interference_bits(machine);
  std::int64_t inside = 0;
  for (int i = 0; i < steps; ++i)
    for (int j = 0; j < steps; ++j)
      for (int k = 0; k < steps; ++k) {
        Pose X;
        X.p = min + Vec3(i + 0.5, j + 0.5, k + 0.5).cwiseProduct(max - min) / steps;
        const bool all = std::all_of(orientations.begin(), orientations.end(), [&](const Mat3& R) {
          X.R = R;
          const auto result = kinematics::inverse(machine, X);
          // Only the first choice of a slider counts, as the source takes it; any branch of an arm.
          if (std::holds_alternative<machine::SerialArm>(machine)) {
            return std::any_of(result.solutions.begin(), result.solutions.end(),
                               [&](const kinematics::Solution& s) { return (s.violations & heeded) == 0; });
          }
          return !result.solutions.empty() && (result.solutions.front().violations & heeded) == 0;
        });
        inside += all ? 1 : 0;
      }
  return static_cast<double>(inside) * (max - min).prod() / (static_cast<double>(steps) * steps * steps);
}

}  // namespace polypod::workspace
