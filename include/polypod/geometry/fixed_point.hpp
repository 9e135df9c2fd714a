// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Points of a body that moves, given by plain numbers in its frame.
#pragma once

#include <type_traits>

#include "polypod/geometry/pose.hpp"

namespace polypod {

/// X_AB p_B on the number type T of the pose, with the point on the same or plain numbers: a dual number or a series
/// times a plain number takes half the time of the product of two, or less.
template <class T, class P>
Vector3<T> fixed_point(const PoseT<T>& X_AB, const Vector3<P>& p_B) {
  if constexpr (std::is_same_v<T, P>) {
    return X_AB * p_B;
  } else {
    Vector3<T> out = X_AB.p;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) out[i] += X_AB.R(i, k) * p_B[k];
    return out;
  }
}

}  // namespace polypod
