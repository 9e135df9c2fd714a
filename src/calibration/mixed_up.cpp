// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "mixed_up.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "model.hpp"

namespace polypod::calibration {
namespace {

using Points = Eigen::Matrix3Xd;

/// The root mean square distance of the readings from where the drawing has them.
double apart(const Points& drawing, const Points& measured, bool any_frame) {
  if (drawing.cols() < 4) return std::numeric_limits<double>::infinity();
  if (!any_frame) return std::sqrt((drawing - measured).colwise().squaredNorm().mean());
  const Eigen::Matrix4d X = Eigen::umeyama(drawing, measured, false);
  const Points moved = (X.topLeftCorner<3, 3>() * drawing).colwise() + Vec3(X.topRightCorner<3, 1>());
  return std::sqrt((moved - measured).colwise().squaredNorm().mean());
}

/// What was measured as coordinates, and the joints beside it.
struct Readings {
  std::vector<const Measurement*> rows;
  Points measured;
};

Readings coordinates_in(const std::vector<Measurement>& rows) {
  constexpr std::size_t kEnough = 200;
  Readings out;
  for (const Measurement& row : rows) {
    const bool coordinates = row.kind == Kind::point || row.kind == Kind::axis || row.kind == Kind::pose;
    if (coordinates && out.rows.size() < kEnough) out.rows.push_back(&row);
  }
  out.measured.resize(3, std::ssize(out.rows));
  for (Eigen::Index i = 0; i < out.measured.cols(); ++i)
    out.measured.col(i) = out.rows[static_cast<std::size_t>(i)]->X_SR.p;
  return out;
}

/// The best change so far.
struct Best {
  double least;
  std::string what{};

  void look(double distance, const std::string& change) {
    if (!(distance < least)) return;
    least = distance;
    what = change;
  }
};

void look_at_coordinates(const Points& drawing, const Points& measured, bool any_frame, Best& best) {
  static constexpr std::array<const char*, 3> kNames{"x_mm", "y_mm", "z_mm"};
  for (int i = 0; i < 3; ++i) {
    Points other = measured;
    other.row(i) *= -1;
    best.look(apart(drawing, other, any_frame), fmt::format("{} with the other sign", kNames[std::size_t(i)]));
    for (int j = i + 1; j < 3; ++j) {
      other = measured;
      other.row(i).swap(other.row(j));
      best.look(apart(drawing, other, any_frame),
                fmt::format("{} and {} exchanged", kNames[std::size_t(i)], kNames[std::size_t(j)]));
    }
  }
  for (const auto& [factor, unit] : {std::pair{1e3, "m"}, {1e-3, "um"}, {25.4, "inches"}, {10.0, "cm"}})
    best.look(apart(drawing, factor * measured, any_frame), fmt::format("x_mm, y_mm and z_mm given in {}", unit));
  const Eigen::Index n = measured.cols() - 1;
  best.look(apart(drawing.leftCols(n), measured.rightCols(n), any_frame),
            "each reading beside the joints of the row after");
  best.look(apart(drawing.rightCols(n), measured.leftCols(n), any_frame),
            "each reading beside the joints of the row before");
}

}  // namespace

std::string mixed_up(const AnyMachine& nominal, const std::vector<Measurement>& rows, const CalibrationOptions& options,
                     double closer) {
  const Readings readings = coordinates_in(rows);
  const auto n = readings.measured.cols();
  if (n < 4) return {};
  // The drawing's points with the joints changed; infinitely far where the drawing does not take some of them.
  const auto drawn = [&](auto change) -> std::optional<Points> {
    Points out(3, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      Measurement row = *readings.rows[static_cast<std::size_t>(i)];
      change(row.q);
      const auto X = pose_of_row(nominal, row);
      if (!X) return {};
      out.col(i) = (options.X_SM * *X * options.X_TR).p;
    }
    return out;
  };
  const bool any_frame = options.estimate_frame;
  const auto as_given = drawn([](JointVector&) {});
  const double before =
      as_given ? apart(*as_given, readings.measured, any_frame) : std::numeric_limits<double>::infinity();
  // A tool tip that only turns, on a wrist's centre, stands where it stands in every unit.
  constexpr double kPlace = 1e-6;  // m
  if (as_given && (as_given->colwise() - as_given->rowwise().mean()).cwiseAbs().maxCoeff() < kPlace) return {};
  Best best{std::numeric_limits<double>::infinity()};
  if (as_given) look_at_coordinates(*as_given, readings.measured, any_frame, best);
  const auto joints = readings.rows.front()->q.size();
  for (Eigen::Index i = 0; i < joints; ++i) {
    if (const auto points = drawn([&](JointVector& q) { q[i] = -q[i]; }))
      best.look(apart(*points, readings.measured, any_frame), fmt::format("q{} with the other sign", i + 1));
    for (Eigen::Index j = i + 1; j < joints; ++j)
      if (const auto points = drawn([&](JointVector& q) { std::swap(q[i], q[j]); }))
        best.look(apart(*points, readings.measured, any_frame), fmt::format("q{} and q{} exchanged", i + 1, j + 1));
  }
  if (!(closer * best.least < before)) return {};
  return std::isfinite(before)
             ? fmt::format("with {} the readings would be {:.2g} mm from the drawing; as they are, {:.2g} mm",
                           best.what, 1e3 * best.least, 1e3 * before)
             : fmt::format("with {} the machine as drawn would take all rows, {:.2g} mm from the readings", best.what,
                           1e3 * best.least);
}

}  // namespace polypod::calibration
