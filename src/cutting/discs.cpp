// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/discs.hpp"

#include <algorithm>
#include <cmath>

#include "integrals.hpp"

namespace polypod::cutting {
namespace {

constexpr int kBins = EngagementProfile::kBins;
constexpr double kPi = std::numbers::pi;

/// The coefficients of a disc's edge for a unit of its height, which the edge crosses at an angle.
Material of_disc(const Material& material, const EdgeDisc& disc, double corner_radius) {
  if (disc.kappa == kPi / 2) return material;
  Material out = along_edge(material, disc.kappa);
  const double edge = corner_radius * (kPi / 2 / kCornerDiscs) / disc.height;  // length of it in an axial plane
  for (double* k : {&out.ktc, &out.krc, &out.kac, &out.kte, &out.kre, &out.kae}) *k *= edge;
  return out;
}

/// How much of the height of what a disc meets, on average over `ahead` before it, the disc above has taken on a way up
/// of this slope: at x before the disc, beyond which it reaches by `wider` along the way, it ended b = wider - x ago
/// and stood b slope lower.
double taken_above(double wider, double ahead, double slope) {
  return slope * (ahead < wider ? wider - 0.5 * ahead : 0.5 * wider * wider / ahead);
}

/// What is met of a disc of this height without that. A layer that ends within the height, where the material does, is
/// as high as it was; between the two it changes evenly.
double with_taken(double depth, double height, double taken) {
  constexpr double kWhole = 0.8;  // of what is left of a whole layer
  const double left = height - taken;
  if (!(left > 0)) return depth > 0 ? height : 0;
  return std::min(height, depth + taken * std::clamp((depth / left - kWhole) / (1 - kWhole), 0.0, 1.0));
}

double strip_angle(int strip) {
  return std::acos(1 - 2.0 * strip / kBins);
}

}  // namespace

std::vector<EdgeDisc> discs_of(const Cutter& cutter) {
  std::vector<EdgeDisc> out;
  const double r = cutter.corner_radius, flat = cutter.radius() - r, part = kPi / 2 / kCornerDiscs;
  double inner = flat;
  for (int i = 0; r > 0 && i < kCornerDiscs; ++i) {
    EdgeDisc disc;
    disc.kappa = (i + 0.5) * part;
    disc.z = r * (1 - std::cos(i * part));
    disc.height = 2 * r * std::sin(disc.kappa) * std::sin(part / 2);
    disc.radius = flat + r * std::sin(disc.kappa);
    disc.inner = inner;
    inner = disc.radius;
    out.push_back(disc);
  }
  EdgeDisc side;
  side.z = r;
  side.radius = cutter.radius();
  side.inner = r > 0 ? inner : cutter.radius();
  out.push_back(side);
  return out;
}

double cut_disc(Stock& stock, const Vec3& tip, std::span<const EdgeDisc> discs) {
  double removed = 0;
  for (const EdgeDisc& disc : discs) removed += stock.cut_disc(tip + disc.z * Vec3::UnitZ(), disc.radius);
  return removed;
}

double cut_line(Stock& stock, const Vec3& a, const Vec3& b, std::span<const EdgeDisc> discs, bool a_done) {
  double removed = 0;
  for (const EdgeDisc& disc : discs) {
    const Vec3 up = disc.z * Vec3::UnitZ();
    removed += stock.cut_line(a + up, b + up, disc.radius, a_done);
  }
  return removed;
}

double cut_step(Stock& stock, const Vec3& a, const Vec3& b, std::span<const EdgeDisc> discs, bool a_done) {
  if (discs.size() == 1) return stock.cut_step(a, b, discs[0].radius, a_done);
  return cut_line(stock, a, b, discs, a_done);  // a stock keeps what is due of one disc alone
}

void DiscsMet::clear() {
  for (EngagementProfile& profile : of) {
    profile.any = false;
    profile.max_depth = 0;
    std::fill(profile.depth, profile.depth + kBins, 0.0f);
  }
  highest = 0;
  max_depth = 0;
  any = false;
}

void look_ahead(const Stock& stock, const Vec3& tip, std::span<const EdgeDisc> discs, const Eigen::Vector2d& feed,
                double ahead, DiscsMet& met) {
  met.of.resize(discs.size());
  met.highest = 0;
  met.ahead = ahead;
  met.max_depth = 0;
  met.any = false;
  for (std::size_t i = 0; i < discs.size(); ++i) {
    EngagementProfile& profile = met.of[i];
    look_ahead(stock, tip + discs[i].z * Vec3::UnitZ(), discs[i].radius, feed, ahead, profile, discs[i].height);
    if (!profile.any) continue;
    met.any = true;
    met.highest = i;
    met.max_depth = std::max(met.max_depth, discs[i].z + profile.max_depth);
  }
}

void look_down(const Stock& stock, const Vec3& tip, std::span<const EdgeDisc> discs, double descent,
               const Eigen::Vector2d& feed, double down, EndFootprint& footprint) {
  footprint = {};
  if (discs.empty()) return;
  if (discs[0].inner > 0) look_down(stock, tip, discs[0].inner, feed, down, footprint);
  for (const EdgeDisc& disc : discs) {
    if (!(disc.kappa < descent) || disc.kappa == kPi / 2) break;
    EndFootprint ring;
    look_down(stock, tip + disc.z * Vec3::UnitZ(), disc.radius, feed, down, ring, disc.inner);
    footprint.any = footprint.any || ring.any;
    for (std::size_t j = 0; j < ring.length.size(); ++j) footprint.length[j] += ring.length[j];
  }
}

DiscsForce::DiscsForce(const Cutter& cutter, const Material& material)
    : discs_(discs_of(cutter)), exponent_(material.exponent) {
  const double per_turn = cutter.teeth / (2 * kPi);
  for (const EdgeDisc& disc : discs_) {
    const Material here = of_disc(material, disc, cutter.corner_radius);
    level_.emplace_back(cutter, here);
    Strips& strips = strips_.emplace_back();
    if (disc.kappa == kPi / 2) continue;
    for (int j = 0; j < kBins; ++j) {
      const SpanIntegral span = integrate_span(here, strip_angle(j), strip_angle(j + 1));
      strips.edge.emplace_back(per_turn * span.edge);
      strips.cut.emplace_back(per_turn * span.cut);
      // Behind the axis phi is 2 pi less that of the front.
      const double from = strip_angle(j), to = strip_angle(j + 1);
      const double cosines = std::sin(to) - std::sin(from), sines = std::cos(to) - std::cos(from);
      const auto behind = [&](double kt, double kr, double ka) {
        return Vec3(per_turn * Vec3(-kt * cosines - kr * sines, kt * sines - kr * cosines, ka * (to - from)));
      };
      strips.rear_edge.emplace_back(behind(here.kte, here.kre, here.kae));
      strips.rear_cut.emplace_back(behind(here.ktc, here.krc, here.kac));
    }
  }
}

Vec3 DiscsForce::mean_force(const DiscsMet& met, double level, double rise) const {
  if (discs_.size() == 1) return met.of.empty() ? Vec3(Vec3::Zero()) : level_[0].mean_force(met.of[0], level);
  Vec3 sum = Vec3::Zero();
  const double descent = rise < 0 ? std::atan2(-rise, level) : 0;
  for (std::size_t i = 0; i < met.of.size(); ++i) {
    if (!met.of[i].any) continue;
    const bool is_level = rise == 0 || !(level > 0) || discs_[i].kappa == kPi / 2 || discs_[i].kappa < descent;
    sum += is_level ? level_[i].mean_force(met.of[i], level) : of_sloped(i, met, level, rise);
  }
  return sum;
}

Vec3 DiscsForce::of_sloped(std::size_t disc, const DiscsMet& met, double level, double rise) const {
  const EdgeDisc& here = discs_[disc];
  const double chip = exponent_ == 1 ? level : std::pow(level, exponent_), slope = rise / level;
  const double above = discs_[disc + 1].radius, half = kPi / 4 / kCornerDiscs;
  const double low = here.kappa - half, high = here.kappa + half, of_level = std::sin(here.kappa);
  Vec3 sum = Vec3::Zero();
  for (int j = 0; j < kBins; ++j) {
    double depth = met.of[disc].depth[j];
    if (depth == 0) continue;
    const double cosine = 1 - 2 * (j + 0.5) / kBins, sine = std::sqrt(1 - cosine * cosine);
    if (rise > 0) {
      const double wider = std::sqrt(above * above - here.radius * here.radius * cosine * cosine) - here.radius * sine;
      depth = with_taken(depth, here.height, taken_above(wider, met.ahead, slope));
    }
    const auto at = static_cast<std::size_t>(j);
    // Of an edge at this sine of phi: which part of it cuts, and its mean chip over s_level sin(kappa), from those at
    // its lower and upper end.
    const auto add = [&](double of_sine, const Vec3& edge, const Vec3& cut, double per_chip) {
      const double at_low = (of_sine * std::sin(low) - slope * std::cos(low)) / of_level,
                   at_high = (of_sine * std::sin(high) - slope * std::cos(high)) / of_level;
      if (!(at_low > 0) && !(at_high > 0)) return;
      const double most = std::max(at_low, at_high), least = std::min(at_low, at_high);
      const double cuts = least < 0 ? most / (most - least) : 1;
      const double ratio = 0.5 * (std::max(0.0, least) + most) / per_chip;
      sum += depth * cuts * (edge + chip * (exponent_ == 1 ? ratio : std::pow(ratio, exponent_)) * cut);
    };
    add(sine, strips_[disc].edge[at], strips_[disc].cut[at], sine);  // whose table holds sin(phi)
    if (rise < 0) add(-sine, strips_[disc].rear_edge[at], strips_[disc].rear_cut[at], 1);
  }
  return sum;
}

}  // namespace polypod::cutting
