// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "../masses.hpp"
#include "polypod/families/stages/kinematics.hpp"

namespace polypod::machine {

/// The machines that have the masses, one a stage.
inline std::span<const AnyMachine> mass_stages(const Stages& m) {
  return m.machines;
}

/// take(k, X_MB, X, q) for each stage: its own M in that of the whole, and the pose of its tool and its joints.
template <class T, class Take>
void each_mass_stage(const Stages& m, const PoseT<T>& X_MT, std::span<const T> q, Take&& take) {
  const std::vector<double> values = parameter_values(m);
  const std::vector<T> all(values.begin(), values.end());
  const std::span<const T> p(all);
  const PoseT<T> closed = stages_detail::pose_of_closed(m, X_MT, q, p);
  PoseT<T> tool = Pose{}.cast<T>();
  stages_detail::each_stage<T>(
      m, q, p, [&](std::size_t k, const PoseT<T>& mount, std::span<const T> joints, std::span<const T> own) {
        const PoseT<T> base = tool * mount;
        const PoseT<T> X = k == m.closed ? closed : chain<T>(std::get<SerialArm>(m.machines[k]), joints, own);
        take(k, base, X, joints);
        tool = base * X;
      });
}

}  // namespace polypod::machine
