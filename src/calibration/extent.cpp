// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "extent.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>

namespace polypod::calibration {

Status check_extent(const std::vector<Measurement>& rows, const std::vector<Pose>& seed, const Pose& X_SM,
                    const Pose& X_TR) {
  Eigen::Matrix3Xd measured(3, 0), model(3, 0);
  double read = 0, computed = 0;
  const Measurement* example = nullptr;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Vec3 at = (X_SM * seed[i] * X_TR).p;
    if (rows[i].kind == Kind::distance) {
      read += rows[i].reading;
      computed += (at - rows[i].anchor_S).norm();
      if (example == nullptr) example = &rows[i];
    }
    model.conservativeResize(3, model.cols() + 1);
    model.rightCols<1>() = at;
    if (rows[i].kind == Kind::distance || rows[i].kind == Kind::gauge || rows[i].kind == Kind::contact) continue;
    measured.conservativeResize(3, measured.cols() + 1);
    measured.rightCols<1>() = rows[i].X_SR.p;
    if (example == nullptr) example = &rows[i];
  }
  const auto spread = [](const Eigen::Matrix3Xd& points) -> Eigen::Vector3d {
    const Eigen::Matrix3Xd centred = points.colwise() - points.rowwise().mean();
    return centred.jacobiSvd().singularValues();
  };
  const auto off = [&](double ratio) -> Status {
    constexpr double kUnit = 3;  // less than an inch for a centimetre; a machine is not that far off
    if (ratio < kUnit && ratio > 1 / kUnit) return {};
    return fail("CA113", fmt::format("measured lengths are {:.3g} times those of the machine", ratio), example->place,
                "lengths are in mm and angles in deg; are these others, or of another machine?");
  };
  if (read > 0) POLYPOD_TRY(off(read / std::max(computed, 1e-12)));
  const Eigen::Vector3d of_model = spread(model);
  // Of a tool tip that only turns, on a wrist's centre, places tell errors alone, and no unit.
  constexpr double kPlace = 1e-6, kSmall = 1e-3;  // m
  const double of_measured = measured.cols() == model.cols() ? spread(measured)[0] : 0;
  const bool still = of_model[0] < kPlace || (of_model[0] < kSmall && of_measured < kSmall);
  if (measured.cols() == model.cols() && !still) POLYPOD_TRY(off(of_measured / of_model[0]));
  bool turned = false;  // full poses tell more than their places
  for (const Measurement& row : rows) turned = turned || row.kind == Kind::pose || row.kind == Kind::axis;
  constexpr double kLine = 1e-6;
  const bool contacts = std::all_of(rows.begin(), rows.end(), [](const auto& r) { return r.kind == Kind::contact; });
  if (!turned && !contacts && !(of_model[1] > kLine * of_model[0] && of_model[0] > kPlace)) {
    return fail("CA112", "the measured places lie on a line or in one point", rows.front().place,
                "spread the poses over the workspace");
  }
  return {};
}

std::optional<Pose> fitted_frame(const std::vector<Measurement>& rows, const std::vector<Pose>& seed,
                                 const Pose& X_TR) {
  std::vector<std::pair<Vec3, Vec3>> pairs;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].kind == Kind::point || rows[i].kind == Kind::axis || rows[i].kind == Kind::pose)
      pairs.emplace_back((seed[i] * X_TR).p, rows[i].X_SR.p);
  }
  if (pairs.size() < 3) return std::nullopt;
  Eigen::Matrix3Xd from(3, pairs.size()), to(3, pairs.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) = pairs[i].first;
    to.col(static_cast<Eigen::Index>(i)) = pairs[i].second;
  }
  const Eigen::Matrix4d T = Eigen::umeyama(from, to, false);
  return Pose{T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>()};
}

}  // namespace polypod::calibration
