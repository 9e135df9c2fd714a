// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/measured_map.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

#include "polypod/core/golden_section.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"

namespace polypod::statics {
namespace {

constexpr std::size_t kFewest = 6;
constexpr double kSamePlace = 1e-6;  // m
constexpr double kFlat = 0.01;       // of the span: less spread in a direction is none

/// The x in [low, high] of the least f: the best of `steps` + 1 equal steps, then a golden section round it.
template <class F>
double least_of(F&& f, double low, double high, int steps) {
  const double step = (high - low) / steps;
  double best = low, least = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= steps; ++i) {
    const double value = f(low + i * step);
    if (value < least) {
      least = value;
      best = low + i * step;
    }
  }
  return golden_section(f, std::max(low, best - step), std::min(high, best + step), 1e-3 * step);
}

/// What the restricted likelihood of one entry needs for any ratio of noise to field: with Q an orthonormal basis of
/// all that the linear function cannot say, Q^T R Q = U diag(eigenvalues) U^T and z = U^T Q^T y.
struct Restricted {
  Eigen::VectorXd eigenvalues;
  Eigen::VectorXd z;

  [[nodiscard]] double variance(double ratio) const {
    return (z.array().square() / (eigenvalues.array() + ratio)).sum() / double(z.size());
  }
  /// -2 log likelihood, less constants.
  [[nodiscard]] double badness(double ratio) const {
    return double(z.size()) * std::log(std::max(variance(ratio), 1e-300)) + (eigenvalues.array() + ratio).log().sum();
  }
  [[nodiscard]] double best_ratio() const {
    constexpr double kLeast = -8, kMost = 3;  // decades
    return std::pow(10, least_of([&](double e) { return badness(std::pow(10, e)); }, kLeast, kMost, 33));
  }
};

Eigen::MatrixXd distances(const std::vector<Vec3>& places) {
  const auto n = static_cast<Eigen::Index>(places.size());
  Eigen::MatrixXd out(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index j = 0; j < n; ++j) out(i, j) = (places[std::size_t(i)] - places[std::size_t(j)]).norm();
  return out;
}

/// Half of the median distance to the nearest neighbour; points at the same place count as one.
double half_spacing(const Eigen::MatrixXd& distance) {
  std::vector<double> nearest;
  for (Eigen::Index i = 0; i < distance.rows(); ++i) {
    double least = std::numeric_limits<double>::infinity();
    for (Eigen::Index j = 0; j < distance.cols(); ++j)
      if (distance(i, j) > kSamePlace) least = std::min(least, distance(i, j));
    nearest.push_back(least);
  }
  std::nth_element(nearest.begin(), nearest.begin() + std::ptrdiff_t(nearest.size() / 2), nearest.end());
  return 0.5 * nearest[nearest.size() / 2];
}

double matern(double r) {
  return (1 + r + r * r / 3) * std::exp(-r);
}

}  // namespace

Mat3 measured_compliance(const MeasuredPoint& point) {
  const Vec3 forces = point.forces();
  Mat3 C = Mat3::Zero();
  for (const auto& [row, column] : kEntryPlaces) {
    double sum = 0, count = 0;
    for (const auto& [d, f] : {std::pair{row, column}, {column, row}}) {
      if (!point.given(d, f)) continue;
      sum += point.displacement(d, f) / forces[f];
      ++count;
    }
    C(row, column) = C(column, row) = count > 0 ? sum / count : 0.0;
  }
  return C;
}

bool tells_all_entries(const MeasuredPoint& point) {
  return std::all_of(kEntryPlaces.begin(), kEntryPlaces.end(), [&](const std::pair<int, int>& e) {
    return point.given(e.first, e.second) || point.given(e.second, e.first);
  });
}

double MeasuredMap::correlation(double distance) const {
  return matern(std::sqrt(5.0) * distance / length_);
}

Eigen::VectorXd MeasuredMap::basis(const Vec3& p) const {
  Eigen::VectorXd out(1 + directions_.cols());
  out[0] = 1;
  out.tail(directions_.cols()) = directions_.transpose() * (p - middle_) / span_;
  return out;
}

Result<MeasuredMap> MeasuredMap::of(const std::vector<MeasuredPoint>& measured) {
  std::vector<MeasuredPoint> points;
  std::copy_if(measured.begin(), measured.end(), std::back_inserter(points), tells_all_entries);
  if (points.size() < kFewest) {
    const std::string partial =
        points.size() < measured.size()
            ? fmt::format(", those of {} in which all six compliances were measured", measured.size())
            : "";
    return fail("ID130", fmt::format("{} points make no map{}", points.size(), partial), {},
                fmt::format("measure at least {}, spread over the region of the work", kFewest));
  }
  MeasuredMap map;
  Vec3 axis = Vec3::Zero();
  for (const MeasuredPoint& point : points) axis += point.X_MT.R.col(2);
  map.axis_ = axis.normalized();
  for (const MeasuredPoint& point : points) {
    if (angle_between(point.X_MT.R.col(2), map.axis_) > kOneDirection) {
      return fail("ID131", "the tool axis differs from that of the other points", point.place,
                  "a map without a model of the joints holds for one direction of the tool: give points of one only");
    }
    map.places_.push_back(point.X_MT.p);
  }
  const auto n = static_cast<Eigen::Index>(points.size());
  const Eigen::MatrixXd distance = distances(map.places_);
  map.span_ = distance.maxCoeff();
  if (!(map.span_ > kSamePlace)) return fail("ID130", "all points are at one place", points.front().place);
  map.low_ = map.high_ = map.places_.front();
  map.middle_.setZero();
  for (const Vec3& p : map.places_) {
    map.low_ = map.low_.cwiseMin(p);
    map.high_ = map.high_.cwiseMax(p);
    map.middle_ += p / double(n);
  }
  const double margin = half_spacing(distance);
  map.low_.array() -= margin;
  map.high_.array() += margin;

  Eigen::MatrixXd centred(3, n);
  for (Eigen::Index i = 0; i < n; ++i) centred.col(i) = map.places_[std::size_t(i)] - map.middle_;
  const Eigen::JacobiSVD<Eigen::MatrixXd> spread(centred, Eigen::ComputeThinU);
  Eigen::Index directions = 0;
  while (directions < 3 && spread.singularValues()[directions] > kFlat * spread.singularValues()[0]) ++directions;
  map.directions_ = spread.matrixU().leftCols(directions);
  const Eigen::Index known = 1 + directions;

  Eigen::MatrixXd B(n, known), y(n, kEntries);
  for (Eigen::Index i = 0; i < n; ++i) {
    const MeasuredPoint& point = points[std::size_t(i)];
    B.row(i) = map.basis(point.X_MT.p);
    const Mat3 C = measured_compliance(point);
    for (int e = 0; e < kEntries; ++e)
      y(i, e) = C(kEntryPlaces[std::size_t(e)].first, kEntryPlaces[std::size_t(e)].second);
  }
  const Eigen::MatrixXd Q =
      (Eigen::MatrixXd(B.householderQr().householderQ() * Eigen::MatrixXd::Identity(n, n))).rightCols(n - known);
  const auto correlations = [&](double length) {
    return Eigen::MatrixXd((std::sqrt(5.0) / length * distance).unaryExpr([](double r) { return matern(r); }));
  };
  const auto restricted = [&](double length) {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(Q.transpose() * correlations(length) * Q);
    std::array<Restricted, kEntries> out;
    for (int e = 0; e < kEntries; ++e) {
      out[std::size_t(e)] = {eigen.eigenvalues().cwiseMax(0.0),
                             eigen.eigenvectors().transpose() * (Q.transpose() * y.col(e))};
    }
    return out;
  };
  const auto badness = [&](double log_length) {
    double sum = 0;
    for (const Restricted& entry : restricted(std::exp(log_length))) sum += entry.badness(entry.best_ratio());
    return sum;
  };
  // From a third of the spacing to three times the whole: beyond, the field is noise or part of the linear function.
  map.length_ = std::exp(least_of(badness, std::log(margin * 2 / 3), std::log(3 * map.span_), 16));

  const std::array<Restricted, kEntries> last = restricted(map.length_);
  const Eigen::MatrixXd R = correlations(map.length_);
  for (int e = 0; e < kEntries; ++e) {
    Entry& entry = map.entries_[std::size_t(e)];
    entry.ratio = last[std::size_t(e)].best_ratio();
    entry.variance = last[std::size_t(e)].variance(entry.ratio);
    entry.factor.compute(R + entry.ratio * Eigen::MatrixXd::Identity(n, n));
    entry.solved = entry.factor.solve(B);
    entry.trend_factor.compute(B.transpose() * entry.solved);
    entry.trend = entry.trend_factor.solve(entry.solved.transpose() * y.col(e));
    entry.weights = entry.factor.solve(y.col(e) - B * entry.trend);
  }
  return map;
}

Mat3 MeasuredMap::at(const Vec3& p) const {
  const Eigen::VectorXd b = basis(p);
  std::array<double, kEntries> value{};
  for (std::size_t e = 0; e < value.size(); ++e) value[e] = b.dot(entries_[e].trend);
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const double k = correlation((p - places_[i]).norm());
    for (std::size_t e = 0; e < value.size(); ++e) value[e] += k * entries_[e].weights[Eigen::Index(i)];
  }
  Mat3 C;
  for (std::size_t e = 0; e < value.size(); ++e) {
    const auto [row, column] = kEntryPlaces[e];
    C(row, column) = C(column, row) = value[e];
  }
  if (C.llt().info() == Eigen::Success) return C;
  const Eigen::SelfAdjointEigenSolver<Mat3> eigen(C);
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * eigen.eigenvectors().transpose();
}

Mat3 MeasuredMap::deviation(const Vec3& p) const {
  const Eigen::VectorXd b = basis(p);
  Eigen::VectorXd k(static_cast<Eigen::Index>(places_.size()));
  for (std::size_t i = 0; i < places_.size(); ++i) k[Eigen::Index(i)] = correlation((p - places_[i]).norm());
  Mat3 out;
  for (std::size_t e = 0; e < entries_.size(); ++e) {
    const Entry& entry = entries_[e];
    const Eigen::VectorXd rest = b - entry.solved.transpose() * k;
    const double share = 1 - k.dot(entry.factor.solve(k)) + rest.dot(entry.trend_factor.solve(rest));
    const auto [row, column] = kEntryPlaces[e];
    out(row, column) = out(column, row) = std::sqrt(entry.variance * std::max(0.0, share));
  }
  return out;
}

bool MeasuredMap::covers(const Vec3& p) const {
  return (p.array() >= low_.array()).all() && (p.array() <= high_.array()).all();
}

std::string MeasuredMap::why_not(const Vec3& p) const {
  std::string out;
  for (int i = 0; i < 3; ++i) {
    if (p[i] >= low_[i] && p[i] <= high_[i]) continue;
    out += fmt::format("{}{} = {:.1f} mm lies outside {:.1f} .. {:.1f} mm, where displacements were measured",
                       out.empty() ? "" : ", ", "xyz"[i], units::to_mm(p[i]), units::to_mm(low_[i]),
                       units::to_mm(high_[i]));
  }
  return out;
}

std::array<double, kEntries> MeasuredMap::noise() const {
  std::array<double, kEntries> out{};
  for (std::size_t e = 0; e < out.size(); ++e) out[e] = std::sqrt(entries_[e].variance * entries_[e].ratio);
  return out;
}

Result<Compared> compare(const AnyMachine& machine, const MeasuredMap& map, const std::vector<MeasuredPoint>& points) {
  Compared out;
  Mat3 square = Mat3::Zero();
  const auto whole = double(std::count_if(points.begin(), points.end(), tells_all_entries));
  for (const MeasuredPoint& point : points) {
    POLYPOD_ASSIGN(C, computed_compliance(machine, point));
    out.difference.emplace_back(Mat3::Zero());
    if (!tells_all_entries(point)) continue;
    out.difference.back() = measured_compliance(point) - C;
    out.deviation += map.deviation(point.X_MT.p) / whole;
    square += out.difference.back().cwiseAbs2() / whole;
  }
  out.rms = square.cwiseSqrt();
  const std::array<double, kEntries> noise = map.noise();
  for (std::size_t e = 0; e < noise.size(); ++e) {
    const auto [row, column] = kEntryPlaces[e];
    out.noise(row, column) = out.noise(column, row) = noise[e];
    out.rms_of_all += square(row, column) / kEntries;
    out.noise_of_all += noise[e] * noise[e] / kEntries;
    std::size_t worst = 0;
    for (std::size_t i = 1; i < points.size(); ++i)
      if (std::abs(out.difference[i](row, column)) > std::abs(out.difference[worst](row, column))) worst = i;
    out.worst[std::size_t(row)][std::size_t(column)] = out.worst[std::size_t(column)][std::size_t(row)] = worst;
  }
  out.rms_of_all = std::sqrt(out.rms_of_all);
  out.noise_of_all = std::sqrt(out.noise_of_all);
  return out;
}

double prediction_rms(const MeasuredMap& map, const std::vector<MeasuredPoint>& points) {
  double sum = 0, count = 0;
  for (const MeasuredPoint& point : points) {
    sum += (point.displacement - point.computed(map.at(point.X_MT.p))).squaredNorm();
    count += double(point.equations());
  }
  return points.empty() ? 0.0 : std::sqrt(sum / count);
}

Result<std::vector<Foretold>> leave_one_out(const AnyMachine& machine,
                                            const std::vector<std::vector<MeasuredPoint>>& groups) {
  std::vector<Foretold> out;
  for (std::size_t i = 0; i < groups.size(); ++i) {
    std::vector<MeasuredPoint> others;
    for (std::size_t j = 0; j < groups.size(); ++j) {
      if (j != i) others.insert(others.end(), groups[j].begin(), groups[j].end());
    }
    Foretold one;
    POLYPOD_ASSIGN(fit, identify_compliance(machine, others));
    POLYPOD_ASSIGN(fitted, with_compliances(machine, fit.compliance));
    POLYPOD_ASSIGN(rms, prediction_rms(fitted, groups[i]));
    one.joints = rms;
    if (const auto map = MeasuredMap::of(others)) one.map = prediction_rms(*map, groups[i]);
    out.push_back(one);
  }
  return out;
}

Result<Foretold> hold_out(const AnyMachine& machine, const std::vector<MeasuredPoint>& points, int parts) {
  const auto count = static_cast<std::size_t>(std::max(parts, 2));
  if (points.size() < count) {
    return fail("ID132", fmt::format("{} points cannot be dealt out into {} parts", points.size(), count));
  }
  std::vector<std::vector<MeasuredPoint>> groups(count);
  // Shuffled first: every fifth point of a grid of five columns would be a column.
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), 0);
  Random random(1);
  for (std::size_t i = order.size(); i > 1; --i)
    std::swap(order[i - 1], order[std::min(i - 1, std::size_t(random.uniform() * double(i)))]);
  for (std::size_t i = 0; i < points.size(); ++i) groups[i % count].push_back(points[order[i]]);
  POLYPOD_ASSIGN(each, leave_one_out(machine, groups));
  double joints = 0, map = 0;
  bool mapped = true;
  for (std::size_t i = 0; i < count; ++i) {
    const auto share = double(groups[i].size()) / double(points.size());
    joints += share * each[i].joints * each[i].joints;
    mapped = mapped && each[i].map.has_value();
    if (each[i].map) map += share * *each[i].map * *each[i].map;
  }
  Foretold out{std::sqrt(joints), std::nullopt};
  if (mapped) out.map = std::sqrt(map);
  return out;
}

}  // namespace polypod::statics
