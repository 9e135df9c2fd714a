// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/rounded.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "history.hpp"

namespace polypod::cutting {
namespace {

constexpr double kPi = std::numbers::pi;

void engage(const Cutter& cutter, CutSide side, double ae, double radius, EdgeSlice& slice) {
  if (side == CutSide::slot) {
    slice.entry = 0;
    slice.exit = kPi;
    return;
  }
  const double wall = cutter.radius() - std::clamp(ae, 0.0, cutter.diameter);  // r cos(phi) of its face
  const double span = radius > 0 ? std::acos(std::clamp(wall / radius, -1.0, 1.0)) : 0;
  slice.entry = side == CutSide::up ? 0 : kPi - span;
  slice.exit = side == CutSide::up ? span : kPi;
}

}  // namespace

double radius_at(const Cutter& cutter, double z) {
  const double r = cutter.corner_radius, below = r - z;
  if (!(below > 0)) return cutter.radius();
  return cutter.radius() - r + std::sqrt(std::max(0.0, r * r - below * below));
}

double edge_height(const Cutter& cutter, double radius) {
  const double r = cutter.corner_radius, in_corner = radius - (cutter.radius() - r);
  if (radius > cutter.radius()) return std::numeric_limits<double>::infinity();
  if (in_corner <= 0) return 0;
  return r - std::sqrt(std::max(0.0, r * r - in_corner * in_corner));
}

std::vector<EdgeSlice> straight_slices(const Cutter& cutter, CutSide side, double ae, double ap, int corner_slices) {
  std::vector<EdgeSlice> out;
  const double r = cutter.corner_radius;
  if (r > 0) {
    const double last = std::acos(std::clamp(1 - ap / r, 0.0, 1.0));  // kappa where the material ends
    const int n = std::max(1, corner_slices);
    for (int i = 0; i < n; ++i) {
      EdgeSlice slice;
      slice.kappa = (i + 0.5) * last / n;
      slice.z = r * (1 - std::cos(slice.kappa));
      slice.width = r * last / n;
      engage(cutter, side, ae, cutter.radius() - r + r * std::sin(slice.kappa), slice);
      out.push_back(slice);
    }
  }
  const double of_side = ap - r;
  if (!(of_side > 0)) return out;
  const int discs = std::max(1, static_cast<int>(std::ceil(of_side / (kDiscShare * cutter.diameter) - 1e-9)));
  for (int k = 0; k < discs; ++k) {
    EdgeSlice slice;
    slice.kappa = kPi / 2;
    slice.width = of_side / discs;
    slice.z = r + (k + 0.5) * slice.width;
    engage(cutter, side, ae, cutter.radius(), slice);
    out.push_back(slice);
  }
  return out;
}

Material along_edge(const Material& material, double kappa) {
  if (kappa == kPi / 2) return material;
  Material out = material;
  const double s = std::sin(kappa), c = std::cos(kappa), chip = std::pow(s, material.exponent);
  out.ktc = material.ktc * chip;
  out.krc = (material.krc * s - material.kac * c) * chip;
  out.kac = (material.krc * c + material.kac * s) * chip;
  out.kre = material.kre * s - material.kae * c;
  out.kae = material.kre * c + material.kae * s;
  return out;
}

Vec3 mean_force(const Cutter& cutter, const Material& material, const std::vector<EdgeSlice>& slices,
                double feed_per_tooth) {
  Vec3 sum = Vec3::Zero();
  for (const EdgeSlice& slice : slices) {
    sum += mean_force(cutter, along_edge(material, slice.kappa), Engagement{slice.entry, slice.exit, slice.width},
                      feed_per_tooth);
  }
  return sum;
}

ForceHistory force_history(const Cutter& cutter, const Material& material, const std::vector<EdgeSlice>& slices,
                           double feed_per_tooth, int steps) {
  ForceHistory history = start_history(steps);
  for (const EdgeSlice& slice : slices) {
    if (!(slice.exit > slice.entry)) continue;
    add_disc(cutter, along_edge(material, slice.kappa), slice.entry, slice.exit, slice.z, slice.width, feed_per_tooth,
             history);
  }
  finish_history(history);
  return history;
}

}  // namespace polypod::cutting
