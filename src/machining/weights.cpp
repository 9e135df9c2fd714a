// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/weights.hpp"

#include <fmt/format.h>

#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/machining/tilted.hpp"

namespace polypod::machining {
namespace {

constexpr double kCell = 5e-3;  // m

}  // namespace

WeightDeflection::WeightDeflection(const Job& job, std::shared_ptr<const motion::Dynamics> weights)
    : machine_(&job.machine),
      weights_(std::move(weights)),
      X_MW_(job.X_MW),
      R_MT_(cutting_orientation(job)),
      probe_(std::make_unique<statics::Probe>(job.machine, R_MT_, job.posture, job.start_joints)) {}

Result<WeightDeflection> WeightDeflection::of(const Job& job, std::shared_ptr<const motion::Dynamics> weights) {
  POLYPOD_TRY(statics::needs_compliance(job.machine));
  WeightDeflection out(job, std::move(weights));
  const std::optional<Vec3> at_origin = out.whole(Vec3::Zero());
  if (!at_origin) {
    return fail("MC212",
                fmt::format("the machine cannot reach the origin of the workpiece, where its weight would be taken as "
                            "known: {}",
                            out.probe_->why()),
                {job.path}, "leave --gravity out, or give the workpiece an origin that the tool reaches");
  }
  out.origin_ = *at_origin;
  return out;
}

std::optional<Vec3> WeightDeflection::whole(const Vec3& p_W) {
  const Vec3 p = X_MW_ * p_W;
  Mat3 C;
  if (!probe_->at(p, C)) return std::nullopt;
  const machine::JointVector& q = probe_->joints();
  const Pose X = kinematics::settled(*machine_, Pose{R_MT_, p}, q);
  return Vec3(X_MW_.R.transpose() * motion::weight_twist(*machine_, *weights_, X, q).head<3>());
}

const std::optional<Vec3>& WeightDeflection::at_corner(const std::array<int, 3>& corner) {
  const auto known = corners_.find(corner);
  if (known != corners_.end()) return known->second;
  return corners_.emplace(corner, whole(kCell * Vec3(corner[0], corner[1], corner[2]))).first->second;
}

std::optional<Vec3> WeightDeflection::at(const Vec3& p_W) {
  std::array<int, 3> low;
  Vec3 share;
  for (int i = 0; i < 3; ++i) {
    const double cell = std::floor(p_W[i] / kCell);
    low[static_cast<std::size_t>(i)] = static_cast<int>(cell);
    share[i] = p_W[i] / kCell - cell;
  }
  Vec3 sum = Vec3::Zero();
  for (int k = 0; k < 8; ++k) {
    std::array<int, 3> corner = low;
    double weight = 1;
    for (int i = 0; i < 3; ++i) {
      const bool up = (k >> i & 1) != 0;
      corner[static_cast<std::size_t>(i)] += up ? 1 : 0;
      weight *= up ? share[i] : 1 - share[i];
    }
    const std::optional<Vec3>& there = at_corner(corner);
    if (!there) {  // beside a boundary of the workspace
      const std::optional<Vec3> here = whole(p_W);
      if (!here) return std::nullopt;
      return Vec3(*here - origin_);
    }
    sum += weight * *there;
  }
  return Vec3(sum - origin_);
}

Result<WeightOnCuts> weight_on_cuts(const Job& job, const Prediction& prediction,
                                    const std::shared_ptr<const motion::Dynamics>& weights) {
  POLYPOD_ASSIGN(deflection, WeightDeflection::of(job, weights));
  WeightOnCuts out;
  out.at_origin = deflection.at_origin().norm();
  for (const Sample& sample : prediction.few) {
    const std::optional<Vec3> there = deflection.at(sample.command);
    if (!there || there->norm() < out.largest) continue;
    out.largest = there->norm();
    out.place = sample.command;
  }
  return out;
}

}  // namespace polypod::machining
