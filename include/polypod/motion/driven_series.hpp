// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How the tool of any machine moves when its drives do: joint_series the other way round.
#pragma once

#include "polypod/motion/joint_series.hpp"

namespace polypod::motion {

/// How the pose moves where the joints do with the speeds v and accelerations a (and no jerk). `at` is the pose of the
/// joints q. With A = F_X, the coefficient of order k of the twist is -A^-1 times that of the closure which the lower
/// orders and the joints leave. Not `regular` at a singularity of type 2, where the joints do not hold the tool;
/// `pivot` is the smallest pivot of A against the largest, its rows scaled. Cost: 10 us.
JointSeries driven_series(const AnyMachine& machine, const Pose& at, const JointVector& q, const JointVector& v,
                          const JointVector& a);

}  // namespace polypod::motion
