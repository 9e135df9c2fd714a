// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "../leg_series.hpp"
#include "polypod/families/hexapod/slider_machine.hpp"
#include "polypod/families/hexapod/strut_machine.hpp"

namespace polypod::machine {

namespace hexapod_detail {
/// The platform joint of leg i from a point.
template <class M>
Vector3<Series> to_platform(const M& m, const PoseT<Series>& X, int i, const Vec3& from) {
  const Vec3 in_tool = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
  Vector3<Series> y = fixed_point(X, in_tool);
  for (int k = 0; k < 3; ++k) y[k][0] -= from[k];
  return y;
}
}  // namespace hexapod_detail

inline QuickSeries quick_series(const StrutHexapod& m, const PoseT<Series>& target, const Pose&, const JointVector& q) {
  QuickSeries out{target, JointVectorT<Series>(q.size())};
  for (int i = 0; i < kLegs; ++i) {
    const Series length = sqrt(squared_length(hexapod_detail::to_platform(m, target, i, m.base_joint[i])));
    out.add(i, length - Series(m.leg_offset[i]), 1);
  }
  return out;
}

inline QuickSeries quick_series(const SliderHexapod& m, const PoseT<Series>& target, const Pose&,
                                const JointVector& q) {
  QuickSeries out{target, JointVectorT<Series>(q.size())};
  for (int i = 0; i < kLegs; ++i) {
    const Vector3<Series> y = hexapod_detail::to_platform(m, target, i, m.rail_outer[i]);
    add_rail(i, y, m.rail_direction[i], m.length_of_leg(i), q[i], out);
  }
  return out;
}

}  // namespace polypod::machine
