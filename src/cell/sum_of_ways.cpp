// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "sum_of_ways.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <Eigen/Cholesky>

namespace polypod::cell {
namespace {

constexpr double kLeastEps = 1e-9;  // of the extent; below it differences of places lose their digits
constexpr double kStiffness =
    1e-8;  // of all flow over the extent: about what rounding leaves of curvatures beside 1 / eps
constexpr double kSamePlace = 1e-6;  // of the extent: far above what eps leaves between coinciding stations

/// A flow with a free station at one end at least. Unknowns are pairs of coordinates; -1: fixed.
struct Way {
  double weight = 0;
  int i = -1, k = -1;
  Vec2 offset = Vec2::Zero();  ///< of the fixed ends: r = x_i - x_k + offset
};

struct Ways {
  std::vector<Way> all;
  Eigen::Index unknowns = 0;

  [[nodiscard]] Vec2 between(const Way& e, const Eigen::VectorXd& x) const {
    Vec2 r = e.offset;
    if (e.i >= 0) r += x.segment<2>(2 * e.i);
    if (e.k >= 0) r -= x.segment<2>(2 * e.k);
    return r;
  }
  [[nodiscard]] double smooth(const Eigen::VectorXd& x, double eps) const {
    double sum = 0;
    for (const Way& e : all) sum += e.weight * std::hypot(between(e, x).norm(), eps);
    return sum;
  }
  /// Adds weight * v at the ends of a way.
  static void spread(const Way& e, const Vec2& v, Eigen::VectorXd& to) {
    if (e.i >= 0) to.segment<2>(2 * e.i) += v;
    if (e.k >= 0) to.segment<2>(2 * e.k) -= v;
  }
  static void spread(const Way& e, const Eigen::Matrix2d& m, Eigen::MatrixXd& to) {
    for (const auto& [a, b] : {std::pair{e.i, e.i}, {e.k, e.k}})
      if (a >= 0) to.block<2, 2>(2 * a, 2 * b) += m;
    if (e.i < 0 || e.k < 0) return;
    to.block<2, 2>(2 * e.i, 2 * e.k) -= m;
    to.block<2, 2>(2 * e.k, 2 * e.i) -= m;
  }

  [[nodiscard]] Eigen::VectorXd gradient(const Eigen::VectorXd& x, double eps) const {
    Eigen::VectorXd out = Eigen::VectorXd::Zero(unknowns);
    for (const Way& e : all) {
      const Vec2 r = between(e, x);
      spread(e, Vec2(e.weight / std::hypot(r.norm(), eps) * r), out);
    }
    return out;
  }
  [[nodiscard]] Eigen::MatrixXd hessian(const Eigen::VectorXd& x, double eps) const {
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(unknowns, unknowns);
    for (const Way& e : all) {
      const Vec2 r = between(e, x);
      const double length = r.norm(), s = std::hypot(length, eps), share = eps / s;
      // (I - r r^T / s^2) / s with its small eigenvalue eps^2 / s^3 exact, not as a difference of numbers near 1.
      const Vec2 along = length > 0 ? Vec2(r / length) : Vec2::UnitX(), across(-along.y(), along.x());
      spread(e,
             Eigen::Matrix2d(e.weight / s * (across * across.transpose() + share * share * along * along.transpose())),
             out);
    }
    return out;
  }

  /// Minimises the smoothed sum from x by Newton's method with steps that are halved until they gain. Where the gain is
  /// below the digits of the sum, a step must make the gradient smaller: the dual bound needs the gradient.
  /// `stiffness` (flow a metre) holds what has no curvature: a station between two equal flows may stand anywhere on
  /// their line.
  void settle(Eigen::VectorXd& x, double eps, double stiffness) const {
    constexpr int kMost = 100, kHalvings = 40;
    constexpr double kGain = 1e-4, kDigits = 1e-13;
    Eigen::VectorXd g = gradient(x, eps);
    for (int round = 0; round < kMost; ++round) {
      Eigen::MatrixXd h = hessian(x, eps);
      h.diagonal().array() += stiffness;
      const Eigen::VectorXd step = h.ldlt().solve(-g);
      const double slope = g.dot(step), before = smooth(x, eps);
      if (!step.allFinite() || !(slope < 0)) return;
      const bool fine = -slope < kDigits * before;
      double share = 1;
      for (int halved = 0;; ++halved, share /= 2) {
        const Eigen::VectorXd to = x + share * step, there = gradient(to, eps);
        if (fine ? there.norm() < g.norm() : smooth(to, eps) <= before + kGain * share * slope) {
          x = to;
          g = there;
          break;
        }
        if (halved == (fine ? 3 : kHalvings)) return;
      }
    }
  }

  /// The dual bound at x; `radius` holds the free stations of an optimum.
  [[nodiscard]] double bound(const Eigen::VectorXd& x, double eps, double radius) const {
    std::vector<Vec2> y;
    Eigen::VectorXd lack = Eigen::VectorXd::Zero(unknowns);
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(unknowns, unknowns);
    for (const Way& e : all) {
      const Vec2 r = between(e, x);
      y.emplace_back(r / std::hypot(r.norm(), eps));
      spread(e, Vec2(e.weight * y.back()), lack);
      spread(e, Eigen::Matrix2d(e.weight * e.weight * Eigen::Matrix2d::Identity()), normal);
    }
    const Eigen::VectorXd z = normal.ldlt().solve(lack);
    double longest = 1;
    for (std::size_t n = 0; n < all.size(); ++n) {
      const Way& e = all[n];
      Vec2 by = Vec2::Zero();
      if (e.i >= 0) by += z.segment<2>(2 * e.i);
      if (e.k >= 0) by -= z.segment<2>(2 * e.k);
      y[n] -= e.weight * by;
      longest = std::max(longest, y[n].norm());
    }
    double sum = 0;
    lack.setZero();
    for (std::size_t n = 0; n < all.size(); ++n) {
      const Vec2 v = all[n].weight / longest * y[n];
      sum += v.dot(all[n].offset);
      spread(all[n], v, lack);
    }
    for (Eigen::Index i = 0; i < unknowns; i += 2) sum -= lack.segment<2>(i).norm() * radius;
    return sum;
  }
};

/// Moves what lies within `same` of each other onto one place: that of a fixed station, or the mean.
std::vector<Vec2> together(const std::vector<Vec2>& places, const std::vector<Station>& stations, double same) {
  const std::size_t n = places.size();
  std::vector<std::size_t> of(n);
  std::iota(of.begin(), of.end(), 0);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = i + 1; k < n; ++k)
      if (of[i] != of[k] && (places[i] - places[k]).norm() < same) std::replace(of.begin(), of.end(), of[k], of[i]);
  std::vector<Vec2> out = places;
  for (std::size_t c = 0; c < n; ++c) {
    Vec2 mean = Vec2::Zero();
    double count = 0;
    const Vec2* held = nullptr;
    for (std::size_t i = 0; i < n; ++i) {
      if (of[i] != c) continue;
      mean += places[i];
      ++count;
      if (stations[i].fixed) held = &places[i];
    }
    for (std::size_t i = 0; i < n; ++i)
      if (of[i] == c && !stations[i].fixed) out[i] = held != nullptr ? *held : Vec2(mean / count);
  }
  return out;
}

}  // namespace

LeastWays least_ways(const FlowMatrix& flows, const std::vector<Station>& stations) {
  const std::size_t n = stations.size();
  LeastWays out;
  for (const Station& s : stations) out.places.emplace_back(s.at.x(), s.at.y());
  const auto flow = [&](std::size_t i, std::size_t k) {
    return flows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
  };
  // Which stations a chain of flows ties to a fixed one; the others gather where the mean of their own is.
  std::vector<bool> tied(n, false);
  for (std::size_t i = 0; i < n; ++i) tied[i] = stations[i].fixed;
  const auto spread = [&](std::vector<bool>& set) {
    for (bool again = true; again;) {
      again = false;
      for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = 0; k < n; ++k)
          if (set[i] && !set[k] && flow(i, k) > 0) again = set[k] = true;
    }
  };
  spread(tied);
  std::vector<bool> done = tied;
  for (std::size_t i = 0; i < n; ++i) {
    if (done[i]) continue;
    std::vector<bool> group(n, false);
    group[i] = true;
    spread(group);
    Vec2 mean = Vec2::Zero();
    for (std::size_t k = 0; k < n; ++k)
      if (group[k]) mean += out.places[k] / static_cast<double>(std::count(group.begin(), group.end(), true));
    for (std::size_t k = 0; k < n; ++k) {
      if (!group[k]) continue;
      out.places[k] = mean;
      done[k] = true;
    }
  }
  // Places from the middle of the fixed stations, so that they keep their digits.
  Vec2 middle = Vec2::Zero();
  double fixed = 0, held = 0;  // stations, and the sum of the ways between them
  for (std::size_t i = 0; i < n; ++i) {
    if (!stations[i].fixed) continue;
    middle += out.places[i];
    ++fixed;
    for (std::size_t k = i + 1; k < n; ++k)
      if (stations[k].fixed) held += flow(i, k) * (out.places[i] - out.places[k]).norm();
  }
  if (fixed > 0) middle /= fixed;
  double radius = 0;
  for (std::size_t i = 0; i < n; ++i)
    if (stations[i].fixed) radius = std::max(radius, (out.places[i] - middle).norm());
  std::vector<int> unknown(n, -1);
  Ways ways;
  for (std::size_t i = 0; i < n; ++i) {
    if (stations[i].fixed || !tied[i]) continue;
    unknown[i] = static_cast<int>(ways.unknowns / 2);
    ways.unknowns += 2;
    out.places[i] = middle;
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = i + 1; k < n; ++k) {
      if (!(flow(i, k) > 0) || (unknown[i] < 0 && unknown[k] < 0)) continue;
      Way e{flow(i, k), unknown[i], unknown[k], Vec2::Zero()};
      if (unknown[i] < 0) e.offset += out.places[i] - middle;
      if (unknown[k] < 0) e.offset -= out.places[k] - middle;
      ways.all.push_back(e);
    }
  }
  out.bound = held;
  if (ways.unknowns > 0 && radius > 0) {
    Eigen::VectorXd x = Eigen::VectorXd::Zero(ways.unknowns);
    constexpr double kShrink = 0.3;
    double eps = radius, weight = 0;
    for (const Way& e : ways.all) weight += e.weight;
    const double stiffness = kStiffness * weight / radius;
    for (; eps > kLeastEps * radius; eps *= kShrink) ways.settle(x, eps, stiffness);
    eps /= kShrink;
    out.bound += ways.bound(x, eps, radius);
    for (std::size_t i = 0; i < n; ++i)
      if (unknown[i] >= 0) out.places[i] = middle + x.segment<2>(2 * unknown[i]);
    const std::vector<Vec2> joined = together(out.places, stations, kSamePlace * radius);
    if (transport(flows, joined) <= transport(flows, out.places)) out.places = joined;
  }
  out.sum = transport(flows, out.places);
  out.bound = std::min(out.bound, out.sum);
  return out;
}

}  // namespace polypod::cell
