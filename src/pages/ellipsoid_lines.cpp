// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "ellipsoid_lines.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/ellipsoids.hpp"

namespace polypod::pages {
namespace {

struct Placed {
  Vec3 at;
  quality::Ellipsoid of;
};

/// The points of the survey on a grid so much coarser that at most `most` are left, and the distance between them.
std::vector<Vec3> spread(const quality::Survey& survey, std::size_t most, double& apart) {
  const auto [columns, rows, layers] = survey.grid.points;
  for (int step = 1; step <= std::max({columns, rows, layers}); ++step) {
    std::vector<Vec3> out;
    for (const std::size_t index : survey.inside) {
      const auto n = static_cast<int>(index);
      const std::array<int, 3> at{n % columns, n / columns % rows, n / columns / rows};
      const bool kept = std::all_of(at.begin(), at.end(), [&](int k) { return k % step == step / 2; });
      if (kept) out.push_back(survey.grid.at(index));
    }
    if (out.size() > most) continue;
    apart = 0;
    for (const Vec3& side : survey.grid.step) apart = apart == 0 ? side.norm() : std::min(apart, side.norm());
    apart *= step;
    return out;
  }
  return {};
}

}  // namespace

std::vector<report::Line3> velocity_ellipsoids(const machine::AnyMachine& machine, const quality::Survey& survey,
                                               std::size_t most) {
  std::vector<Placed> found;
  double apart = 0, longest = 0;
  for (const Vec3& p : spread(survey, most, apart)) {
    const kinematics::InverseResult result = kinematics::inverse(machine, Pose{survey.orientations.front(), p});
    const kinematics::Solution* within = result.reachable();
    if (within == nullptr) continue;
    const Pose X = kinematics::settled(machine, Pose{survey.orientations.front(), p}, within->joints);
    const auto at = quality::ellipsoids(machine, X, within->joints);
    if (!at || !at->velocity.half_axes.allFinite()) continue;
    longest = std::max(longest, at->velocity.half_axes[0]);
    found.push_back({p, at->velocity});
  }
  std::vector<report::Line3> out;
  if (!(longest > 0)) return out;
  constexpr int kCorners = 24;
  for (const Placed& e : found) {
    const Mat3 axes = e.of.directions * (0.5 * apart / longest * e.of.half_axes).asDiagonal();
    for (int k = 0; k < 3; ++k) {
      report::Line3 circle{"ellipsoids of velocity", {}, report::Colour::purple, 1.2};
      for (int i = 0; i <= kCorners; ++i) {
        const double angle = 2 * std::numbers::pi * i / kCorners;
        const Vec3 p =
            (e.at + std::cos(angle) * axes.col(k) + std::sin(angle) * axes.col((k + 1) % 3)) * units::kMmPerMetre;
        circle.points.push_back({p.x(), p.y(), p.z()});
      }
      out.push_back(std::move(circle));
    }
  }
  return out;
}

}  // namespace polypod::pages
