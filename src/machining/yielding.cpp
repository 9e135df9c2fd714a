// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/yielding.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace polypod::machining {
namespace {

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// What a direction makes of the balance.
struct Line {
  Eigen::Vector2d way;   ///< d - C chip / passes
  Eigen::Vector2d pull;  ///< r + C edge
  [[nodiscard]] double across() const { return cross(way, pull); }
  [[nodiscard]] double length() const { return pull.dot(way) / way.squaredNorm(); }
};

ForceAlong between(const ForceAlong& a, const ForceAlong& b, double share) {
  ForceAlong out{a.d + share * (b.d - a.d), a.edge + share * (b.edge - a.edge), a.chip + share * (b.chip - a.chip)};
  out.d.normalize();
  return out;
}

}  // namespace

Yielded yield_step(const Vec3& before, const Vec3& command, const Mat3& C, std::span<const ForceAlong> around,
                   double passes) {
  const Eigen::Vector2d r = (command - before).head<2>();
  const auto bent = [&](const Vec3& force) { return Eigen::Vector2d((C * force).head<2>()); };
  const auto line = [&](const ForceAlong& f) -> Line { return {f.d - bent(f.chip) / passes, r + bent(f.edge)}; };
  const auto moved = [&](const ForceAlong& f, double h) {
    Yielded out;
    out.force = f.edge + f.chip * (h / passes);
    out.tip.head<2>() = before.head<2>() + h * f.d;
    out.tip.z() = command.z() + (C * out.force).z();
    return out;
  };

  std::optional<Yielded> best;
  double shortest = std::numeric_limits<double>::infinity();
  for (std::size_t j = 0; j < around.size(); ++j) {
    const ForceAlong &a = around[j], &b = around[(j + 1) % around.size()];
    // The edges hold it: r + share C edge = 0.
    const Eigen::Vector2d hold_a = bent(a.edge), hold_b = bent(b.edge);
    const double past_a = cross(r, hold_a), past_b = cross(r, hold_b);
    if (past_a * past_b <= 0 && past_a != past_b) {
      const ForceAlong f = between(a, b, past_a / (past_a - past_b));
      const Eigen::Vector2d hold = bent(f.edge);
      if (hold.dot(r) < 0 && hold.squaredNorm() >= r.squaredNorm()) {
        Yielded out;
        out.force = f.edge * std::sqrt(r.squaredNorm() / hold.squaredNorm());
        out.tip = before;
        out.tip.z() = command.z() + (C * out.force).z();
        return out;
      }
    }
    const Line at_a = line(a), at_b = line(b);
    const double off_a = at_a.across(), off_b = at_b.across();
    if (off_a * off_b > 0 || off_a == off_b) continue;
    const ForceAlong f = between(a, b, off_a / (off_a - off_b));
    const double h = line(f).length();
    if (h < 0 || h >= shortest) continue;
    shortest = h;
    best = moved(f, h);
  }
  if (best) return *best;
  double least = std::numeric_limits<double>::infinity();
  for (const ForceAlong& f : around) {
    const Line l = line(f);
    const double h = std::max(0.0, l.length()), rest = (h * l.way - l.pull).squaredNorm();
    if (rest >= least) continue;
    least = rest;
    best = moved(f, h);
  }
  return *best;
}

Yielded yield_step(const Vec3& before, const Vec3& command, const Mat3& C,
                   std::span<const cutting::BallContact> contacts, double passes, const Vec3& guess) {
  constexpr double kEdgeWay = 0.5e-6, kBalanced = 0.1e-6;  // m
  constexpr int kSteps = 40, kHalvings = 8;
  const Vec3 r = command - before;
  struct At {
    Vec3 u, force, rest;
    Mat3 slope;  // of the force, N/m
  };
  const auto look = [&](const Vec3& u) {
    At at{u, Vec3::Zero(), Vec3::Zero(), Mat3::Zero()};
    for (const cutting::BallContact& k : contacts) {
      const double way = k.n.dot(u) - k.gap;
      if (!(way > 0)) continue;
      Vec3 per_way = k.chip / passes;
      at.force += per_way * way;
      if (way < kEdgeWay) {
        at.force += k.edge * (way / kEdgeWay);
        per_way += k.edge / kEdgeWay;
      } else {
        at.force += k.edge;
      }
      at.slope.noalias() += per_way * k.n.transpose();
    }
    at.rest = r + C * at.force - u;
    return at;
  };
  At best = look(guess);
  const auto descend = [&](const Vec3& start, bool halved) {
    At at = look(start);
    for (int i = 0; i < kSteps && best.rest.norm() > kBalanced; ++i) {
      const Vec3 step = Mat3(Mat3::Identity() - C * at.slope).partialPivLu().solve(at.rest);
      if (!step.allFinite()) return;
      double share = 1;
      At next = look(at.u + step);
      for (int h = 0; halved && h < kHalvings && !(next.rest.norm() < at.rest.norm()); ++h) {
        share *= 0.5;
        next = look(at.u + share * step);
      }
      if (halved && !(next.rest.norm() < at.rest.norm())) return;
      at = next;
      if (at.rest.norm() < best.rest.norm()) best = at;
    }
  };
  descend(guess, true);
  descend(Vec3::Zero(), true);
  descend(best.u, false);
  return {before + best.u, best.force, best.rest.norm()};
}

}  // namespace polypod::machining
