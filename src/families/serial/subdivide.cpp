// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "../../workspace/subdivide.hpp"
#include "bounds.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {

template Result<Volume> subdivided_volume(const ArmLimits&, const Options&, bool);
template Result<bool> subdivided_holds(const ArmLimits&, const Options&, const Shape&, std::int64_t);
template Result<Volume> subdivided_volume(const SixJointLimits&, const Options&, bool);
template Result<bool> subdivided_holds(const SixJointLimits&, const Options&, const Shape&, std::int64_t);
template Result<Volume> subdivided_volume(const ThreeParallelLimits&, const Options&, bool);
template Result<bool> subdivided_holds(const ThreeParallelLimits&, const Options&, const Shape&, std::int64_t);
template Result<Volume> subdivided_volume(const CartesianLimits&, const Options&, bool);
template Result<bool> subdivided_holds(const CartesianLimits&, const Options&, const Shape&, std::int64_t);

}  // namespace polypod::workspace
