// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/errors.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "plan.hpp"
#include "polypod/core/random.hpp"

namespace polypod::quality {

Farthest farthest(const std::vector<Generator>& list, const Plan& plan, Vec3 Generator::*part, Method method) {
  std::vector<Vec3> g;
  g.reserve(list.size());
  for (const Generator& generator : list) g.push_back(generator.*part);
  if (method == Method::exact) return farthest_vertex(g);
  // Where a local search ends depends on its start. The source's tables come out when an error of the platform counts
  // the other way: 0.238 of 0.2381 in the row "all" of Table 8.21, against 0.246.
  std::vector<double> sense(g.size(), 1.0);
  for (std::size_t i = 0, k = 0; i < g.size(); ++i) {
    while (plan.parts[k].element != list[i].element) ++k;
    if (plan.parts[k].key.rfind("platform.", 0) == 0) sense[i] = -1;
    g[i] *= sense[i];
  }
  Farthest out = flip_search(g);
  for (std::size_t i = 0; i < g.size(); ++i) out.signs[i] = static_cast<signed char>(sense[i] * out.signs[i]);
  return out;
}

Vec6 known_error(const AnyMachine& machine, const Pose& X, const JointVector& q, const std::vector<Sized>& errors) {
  return linear_error(machine, X, q, Plan(machine, errors));
}

double orientation_error(const AnyMachine& machine, const Pose& X, const Vec6& error) {
  return heeded(kinematics::task(machine), X, error.tail<3>()).norm();
}

std::optional<Vec6> known_error_exact(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                                      const std::vector<Sized>& errors) {
  const Pose X = kinematics::settled(machine, X_MT, q);
  const Plan plan(machine, errors);
  const std::vector<Element> all = elements(machine);
  return std::visit(
      [&](const auto& m) -> std::optional<Vec6> {
        std::vector<double> p = plan.nominal;
        std::vector<double> joints(q.data(), q.data() + q.size());
        for (const Plan::Part& part : plan.parts) {
          if (part.rate.size() > 0) {
            const auto shift = figure_shift(machine, all[static_cast<std::size_t>(part.element)], part.size);
            if (!shift) return {};
            for (std::size_t k = 0; k < p.size(); ++k) p[k] += (*shift)[static_cast<Eigen::Index>(k)];
          }
          for (const int c : part.columns) {
            const auto k = static_cast<std::size_t>(c);
            (k < p.size() ? p[k] : joints[k - p.size()]) += part.size;
          }
        }
        const kinematics::NewtonResult exact = kinematics::forward_by_closure(m, std::span<const double>(joints), p, X);
        if (!exact.converged) return {};
        Vec6 out;
        out << exact.X_MT.p - X.p, rotation_vector(exact.X_MT.R * X.R.transpose());
        return out;
      },
      machine);
}

WorstCaseAt::WorstCaseAt(const AnyMachine& machine, const std::vector<Sized>& tolerances,
                         const ToleranceOptions& options)
    : machine_(&machine), options_(options), plan_(std::make_shared<const Plan>(machine, tolerances)) {}

Result<WorstCase> WorstCaseAt::operator()(const Pose& X, const JointVector& q) const {
  const Plan& plan = *plan_;
  const AnyMachine& machine = *machine_;
  const ToleranceOptions& options = options_;
  POLYPOD_ASSIGN(list, generators(X, error_columns(machine, X, q, plan), plan, options.region));
  const Farthest position = farthest(list, plan, &Generator::position, options.method);
  const Farthest orientation = farthest(list, plan, &Generator::orientation, options.method);
  WorstCase out;
  out.position = position.distance;
  out.orientation = orientation.distance;
  for (const Plan::Part& part : plan.parts) out.shares.push_back({part.element, 0, 0});
  const Vec3 u = position.point.normalized(), v = orientation.point.normalized();
  for (std::size_t i = 0, share = 0; i < list.size(); ++i) {
    const Generator& g = list[i];
    const double s = position.signs[i], r = orientation.signs[i];
    out.position_error.head<3>() += s * g.position;
    out.position_error.tail<3>() += s * g.orientation;
    out.orientation_error.head<3>() += r * g.position;
    out.orientation_error.tail<3>() += r * g.orientation;
    while (out.shares[share].element != g.element) ++share;  // both lists are in the same order
    out.shares[share].position += s * u.dot(g.position);
    out.shares[share].orientation += r * v.dot(g.orientation);
  }
  return out;
}

Result<WorstCase> worst_case(const AnyMachine& machine, const Pose& X, const JointVector& q,
                             const std::vector<Sized>& tolerances, const ToleranceOptions& options) {
  return WorstCaseAt(machine, tolerances, options)(X, q);
}

Result<Spread> spread(const AnyMachine& machine, const Pose& X, const JointVector& q,
                      const std::vector<Sized>& tolerances, const SpreadOptions& options) {
  if (options.samples < 100 || options.samples > 10'000'000) {
    return fail("QU103", fmt::format("{} samples must be 100 to 10000000", options.samples));
  }
  if (!(options.confidence >= 0.5 && options.confidence <= 0.9999)) {
    return fail("QU103", fmt::format("the confidence {:g} must be 0.5 to 0.9999", options.confidence));
  }
  const Plan plan(machine, tolerances);
  POLYPOD_ASSIGN(list, generators(X, error_columns(machine, X, q, plan), plan, Region::box));
  Spread out;
  Mat3 position = Mat3::Zero(), orientation = Mat3::Zero();
  for (const Generator& g : list) {
    position += g.position * g.position.transpose();
    orientation += g.orientation * g.orientation.transpose();
  }
  const auto longest_axis = [](const Mat3& square) {
    return std::sqrt(
        std::max(0.0, Eigen::SelfAdjointEigenSolver<Mat3>(square, Eigen::EigenvaluesOnly).eigenvalues()[2]));
  };
  out.rss_position = longest_axis(position);
  out.rss_orientation = longest_axis(orientation);

  Random random(options.seed);
  const auto draw = [&] {
    switch (options.distribution) {
      case Distribution::uniform:
        return random.uniform(-1, 1);
      case Distribution::triangular:
        return random.uniform() - random.uniform();
      case Distribution::normal:
        break;
    }
    return random.normal() / 3;
  };
  const auto count = static_cast<std::size_t>(options.samples);
  std::vector<double> p(count), w(count);
  for (std::size_t i = 0; i < count; ++i) {
    Vec3 dp = Vec3::Zero(), dw = Vec3::Zero();
    for (const Generator& g : list) {
      const double x = draw();
      dp += x * g.position;
      dw += x * g.orientation;
    }
    p[i] = dp.norm();
    w[i] = dw.norm();
  }
  const auto summarised = [&](std::vector<double>& values) {
    std::sort(values.begin(), values.end());
    Spread::Sampled s;
    for (const double x : values) s.mean += x / static_cast<double>(count);
    // The rank of the quantile is binomial; 1.96 standard deviations of it to both sides.
    const double n = static_cast<double>(count), rank = options.confidence * n,
                 band = 1.96 * std::sqrt(n * options.confidence * (1 - options.confidence));
    const auto at = [&](double r) { return values[static_cast<std::size_t>(std::clamp(std::floor(r), 0.0, n - 1))]; };
    s.quantile = at(rank);
    s.quantile_low = at(rank - band);
    s.quantile_high = at(rank + band + 1);
    return s;
  };
  out.position = summarised(p);
  out.orientation = summarised(w);
  return out;
}

}  // namespace polypod::quality
