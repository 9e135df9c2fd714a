// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/sensitivity.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "polypod/core/random.hpp"

namespace polypod::design {
namespace {

constexpr int kLevels = 4;
constexpr double kStep = 2.0 / 3;
constexpr int kResamples = 1000;
constexpr int kLeastEffects = 4;         // of a parameter; fewer say nothing, and their bootstrap still less
constexpr std::uint64_t kBootstrap = 1;  // stream of random numbers

std::size_t below(Random& random, std::size_t n) {
  return std::min(n - 1, static_cast<std::size_t>(random.uniform() * static_cast<double>(n)));
}

void add_trajectory(Random& random, SampleDesign& out) {
  const auto n = static_cast<std::size_t>(out.parameters);
  std::vector<int> order(n);
  std::iota(order.begin(), order.end(), 0);
  for (std::size_t k = n; k > 1; --k) std::swap(order[k - 1], order[below(random, k)]);
  std::vector<double> at(n);
  for (double& u : at) u = static_cast<double>(below(random, kLevels)) / (kLevels - 1);
  out.points.push_back(at);
  for (const int i : order) {
    double& u = at[static_cast<std::size_t>(i)];
    u = std::clamp(u + (u < 0.5 ? kStep : -kStep), 0.0, 1.0);
    out.points.push_back(at);
  }
  out.order.push_back(std::move(order));
}

void add_sample(Random& random, SampleDesign& out) {
  const auto n = static_cast<std::size_t>(out.parameters);
  std::vector<double> a(n), b(n);
  for (double& u : a) u = random.uniform();
  for (double& u : b) u = random.uniform();
  out.points.push_back(a);
  out.points.push_back(b);
  for (std::size_t i = 0; i < n; ++i) {
    std::vector<double> mixed = a;
    mixed[i] = b[i];
    out.points.push_back(std::move(mixed));
  }
}

/// Of one parameter: the estimates from some of the groups.
struct Shares {
  double first = std::numeric_limits<double>::quiet_NaN(), total = first, spread = first;
};

/// The values of one group, and what is said of them.
class Groups {
 public:
  Groups(const SampleDesign& design, const std::vector<double>& values) : design_(design) {
    const auto each = static_cast<std::size_t>(design.each());
    for (std::size_t g = 0; g < static_cast<std::size_t>(design.groups); ++g) {
      const auto* begin = values.data() + g * each;
      const auto known = [](double x) { return std::isfinite(x); };
      // A trajectory that leaves the machines on its way has effects before and behind; a sample counts whole.
      bool any = std::all_of(begin, begin + each, known);
      for (std::size_t k = 1; design.method == SensitivityMethod::morris && k < each; ++k)
        any = any || (known(begin[k - 1]) && known(begin[k]));
      if (!any) continue;
      values_.emplace_back(begin, begin + each);
      which_.push_back(g);
    }
  }

  [[nodiscard]] std::size_t size() const { return values_.size(); }

  /// Of the groups in `picked`, which may hold one more than once.
  [[nodiscard]] Shares shares(std::size_t parameter, const std::vector<std::size_t>& picked) const {
    return design_.method == SensitivityMethod::morris ? effects(parameter, picked) : variances(parameter, picked);
  }

 private:
  [[nodiscard]] Shares effects(std::size_t parameter, const std::vector<std::size_t>& picked) const {
    double sum = 0, sizes = 0, squares = 0, n = 0;
    for (const std::size_t g : picked) {
      const double e = effect(g, parameter);
      if (!std::isfinite(e)) continue;
      ++n;
      sum += e;
      sizes += std::abs(e);
      squares += e * e;
    }
    if (n < kLeastEffects) return {};
    const double mean = sum / n;
    return {mean, sizes / n, std::sqrt(std::max(0.0, (squares - n * mean * mean) / (n - 1)))};
  }

  [[nodiscard]] double effect(std::size_t g, std::size_t parameter) const {
    const std::vector<int>& order = design_.order[which_[g]];
    const auto at =
        static_cast<std::size_t>(std::find(order.begin(), order.end(), static_cast<int>(parameter)) - order.begin());
    const std::size_t row = which_[g] * static_cast<std::size_t>(design_.each()) + at;
    const double step = design_.points[row + 1][parameter] - design_.points[row][parameter];
    return (values_[g][at + 1] - values_[g][at]) / step;
  }

  [[nodiscard]] Shares variances(std::size_t parameter, const std::vector<std::size_t>& picked) const {
    const double n = 2 * static_cast<double>(picked.size());
    double mean = 0, square = 0;
    for (const std::size_t g : picked) mean += (values_[g][0] + values_[g][1]) / n;
    for (const std::size_t g : picked)
      for (const double y : {values_[g][0], values_[g][1]}) square += (y - mean) * (y - mean);
    const double variance = square / (n - 1);
    constexpr double kRounding = 1e-24;  // of the square of the mean
    if (!(variance > kRounding * mean * mean)) return {};
    double first = 0, total = 0;
    for (const std::size_t g : picked) {
      const double a = values_[g][0], b = values_[g][1], mixed = values_[g][2 + parameter];
      first += (b - mean) * (mixed - a);
      total += (a - mixed) * (a - mixed);
    }
    return {2 * first / n / variance, total / n / variance, 0};
  }

  const SampleDesign& design_;
  std::vector<std::vector<double>> values_;
  std::vector<std::size_t> which_;  ///< of the design
};

/// The value at a share of sorted numbers, linear between them.
double quantile(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto k = static_cast<std::size_t>(at);
  const std::size_t next = std::min(k + 1, sorted.size() - 1);
  return sorted[k] + (at - static_cast<double>(k)) * (sorted[next] - sorted[k]);
}

Estimate estimate(double value, std::vector<double> resampled) {
  std::erase_if(resampled, [](double x) { return std::isnan(x); });
  std::sort(resampled.begin(), resampled.end());
  constexpr double kTail = 0.025;
  Estimate out;
  out.value = value;
  out.lower = quantile(resampled, kTail);
  out.upper = quantile(resampled, 1 - kTail);
  return out;
}

}  // namespace

const char* name_of(SensitivityMethod method) {
  return method == SensitivityMethod::morris ? "morris" : "sobol";
}

Result<SampleDesign> sample_design(SensitivityMethod method, int parameters, int evaluations, std::uint64_t seed) {
  SampleDesign out;
  out.method = method;
  out.parameters = parameters;
  out.seed = seed;
  out.groups = evaluations / out.each();
  const int least = method == SensitivityMethod::morris ? 4 : 16;
  if (out.groups < least) {
    return fail(
        "OP150",
        fmt::format("{} evaluations are too few for {} of {} parameters", evaluations, name_of(method), parameters), {},
        fmt::format("give at least {}: {} times {}", least * out.each(), least, out.each()));
  }
  Random random(seed);
  for (int g = 0; g < out.groups; ++g) {
    if (method == SensitivityMethod::morris) {
      add_trajectory(random, out);
    } else {
      add_sample(random, out);
    }
  }
  return out;
}

GlobalSensitivity global_sensitivity(const SampleDesign& design, const std::vector<double>& values) {
  GlobalSensitivity out;
  const auto n = static_cast<std::size_t>(design.parameters);
  out.total.resize(n);
  out.first.resize(n);
  const bool morris = design.method == SensitivityMethod::morris;
  if (morris) out.spread.assign(n, std::numeric_limits<double>::quiet_NaN());
  const Groups groups(design, values);
  out.used = static_cast<int>(groups.size());
  if (groups.size() < 2) return out;
  std::vector<std::size_t> all(groups.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  Random random(design.seed, kBootstrap);
  std::vector<std::vector<double>> first(n), total(n);
  for (int k = 0; k < kResamples; ++k) {
    std::vector<std::size_t> picked(groups.size());
    for (std::size_t& g : picked) g = below(random, groups.size());
    for (std::size_t i = 0; i < n; ++i) {
      const Shares s = groups.shares(i, picked);
      first[i].push_back(s.first);
      total[i].push_back(s.total);
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    const Shares s = groups.shares(i, all);
    out.first[i] = estimate(s.first, std::move(first[i]));
    out.total[i] = estimate(s.total, std::move(total[i]));
    if (morris) out.spread[i] = s.spread;
  }
  return out;
}

}  // namespace polypod::design
