// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "groups.hpp"
#include "model.hpp"
#include "polypod/core/distributions.hpp"

namespace polypod::calibration {
namespace {

constexpr double kFalseAlarms = 0.001;  // of a measurement: it lowers the answer
constexpr std::size_t kLeastPoints = 10;

std::vector<std::string> components_of(Kind kind) {
  switch (kind) {
    case Kind::point:
    case Kind::contact:
      return {"x", "y", "z"};
    case Kind::axis:
      return {"x", "y", "z", "across_1", "across_2"};
    case Kind::pose:
      return {"x", "y", "z", "a", "b", "c"};
    case Kind::distance:
      return {"distance"};
    case Kind::gauge:
      break;
  }
  return {"gauge"};
}

/// The residuals of one component one after another, and where each stands (row, time or temperature).
struct Series {
  bool is_angle = false;
  std::vector<double> at, value;
};

/// y over x: the line's rise from the first to the last x, over its standard error, and how likely that is chance.
void look_for_trend(const Series& s, ComponentDrift& out) {
  const auto n = static_cast<double>(s.at.size());
  const Eigen::Map<const Eigen::ArrayXd> x(s.at.data(), std::ssize(s.at)), y(s.value.data(), std::ssize(s.value));
  const Eigen::ArrayXd dx = x - x.mean(), dy = y - y.mean();
  const double sxx = dx.square().sum();
  if (!(sxx > 0)) return;
  const double slope = (dx * dy).sum() / sxx;
  const double rest = (dy - slope * dx).square().sum() / (n - 2);
  out.trend = slope * (x.maxCoeff() - x.minCoeff());
  out.t = slope / std::sqrt(std::max(rest / sxx, 1e-300));
  out.trend_p = student_both(out.t, n - 2);
}

/// The correlation of neighbours; of independent ones it is -1 / n with the variance 1 / n, nearly normal. Only alike
/// neighbours count: unlike ones are no drift.
void look_at_neighbours(const Series& s, ComponentDrift& out) {
  const Eigen::Map<const Eigen::ArrayXd> y(s.value.data(), std::ssize(s.value));
  const Eigen::Index n = y.size();
  const Eigen::ArrayXd dy = y - y.mean();
  const double squares = dy.square().sum();
  if (!(squares > 0)) return;
  out.lag1 = (dy.head(n - 1) * dy.tail(n - 1)).sum() / squares;
  out.lag1_p = normal_above((out.lag1 + 1 / static_cast<double>(n)) * std::sqrt(static_cast<double>(n)));
}

}  // namespace

Drift drift_in(const std::vector<Measurement>& rows, const std::vector<std::size_t>& poses,
               const std::vector<RowResidual>& residuals) {
  const auto all_have = [&](auto member) {
    return std::all_of(rows.begin(), rows.end(), [&](const Measurement& m) { return std::isfinite(m.*member); });
  };
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < residuals.size(); ++i)
    if (!residuals[i].outlier && !residuals[i].lost) order.push_back(i);
  const bool timed = all_have(&Measurement::time), warmed = all_have(&Measurement::temperature);
  const auto time = [&](std::size_t i) { return timed ? rows[i].time : static_cast<double>(i); };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return time(a) < time(b); });

  // Repeats of a pose one after another hang together by what the model lacks there: they are one point.
  std::map<std::string, Series> by_time, by_temperature;
  for (std::size_t first = 0, last = 0; first < order.size(); first = last) {
    for (last = first; last < order.size() && poses[order[last]] == poses[order[first]] &&
                       rows[order[last]].kind == rows[order[first]].kind;)
      ++last;
    const auto count = static_cast<double>(last - first);
    const std::vector<std::string> names = components_of(rows[order[first]].kind);
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(std::ssize(names));
    double at = 0, degrees = 0;
    for (std::size_t k = first; k < last; ++k) {
      mean += residuals[order[k]].after / count;
      at += time(order[k]) / count;
      degrees += warmed ? rows[order[k]].temperature / count : 0;
    }
    for (std::size_t k = 0; k < names.size(); ++k) {
      for (auto [into, x] : {std::pair{&by_time, at}, {&by_temperature, degrees}}) {
        if (into == &by_temperature && !warmed) continue;
        (*into)[names[k]].is_angle = static_cast<int>(k) >= residuals[order[first]].lengths;
        (*into)[names[k]].at.push_back(x);
        (*into)[names[k]].value.push_back(mean[static_cast<Eigen::Index>(k)]);
      }
    }
  }
  Drift out;
  double looks = 0;
  for (const auto& [series, over] : {std::pair{&by_time, timed ? "time" : "row"}, {&by_temperature, "temperature"}}) {
    for (const auto& [name, s] : *series) {
      if (s.at.size() < kLeastPoints) continue;
      ComponentDrift one;
      one.component = name;
      one.over = over;
      one.is_angle = s.is_angle;
      one.points = s.at.size();
      look_for_trend(s, one);
      ++looks;
      if (series == &by_time) {
        look_at_neighbours(s, one);
        ++looks;
      }
      out.components.push_back(std::move(one));
    }
  }
  out.looked = looks > 0;
  out.level = kFalseAlarms / std::max(looks, 1.0);
  for (ComponentDrift& one : out.components) {
    one.trend_found = one.trend_p < out.level;
    one.lag1_found = one.lag1_p < out.level;
    out.found = out.found || one.trend_found || one.lag1_found;
  }
  return out;
}

}  // namespace polypod::calibration
