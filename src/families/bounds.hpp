// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the families know of their limits over boxes: bounds_of(m, options) of each that knows something.
#pragma once

#include "../workspace/subdivide.hpp"
#include "delta/bounds.hpp"
#include "hexapod/bounds.hpp"
#include "parallel/bounds.hpp"
#include "polypod/workspace/shape.hpp"
#include "serial/bounds.hpp"
#include "stages/bounds.hpp"

namespace polypod::workspace {

// Each compiles for half a minute: src/families/<family>/subdivide.cpp.
extern template Result<Volume> subdivided_volume(const ParallelLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const ParallelLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const WristLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const WristLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const StrutLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const StrutLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const SliderLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const SliderLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const DeltaBounds<machine::RotaryDelta>&, const Options&, bool);
extern template Result<bool> subdivided_holds(const DeltaBounds<machine::RotaryDelta>&, const Options&, const Shape&,
                                              std::int64_t);
extern template Result<Volume> subdivided_volume(const DeltaBounds<machine::LinearDelta>&, const Options&, bool);
extern template Result<bool> subdivided_holds(const DeltaBounds<machine::LinearDelta>&, const Options&, const Shape&,
                                              std::int64_t);
extern template Result<Volume> subdivided_volume(const ArmLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const ArmLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const SixJointLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const SixJointLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const ThreeParallelLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const ThreeParallelLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const CartesianLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const CartesianLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const ScaraLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const ScaraLimits&, const Options&, const Shape&, std::int64_t);
extern template Result<Volume> subdivided_volume(const OneMoreLimits<ArmLimits>&, const Options&, bool);
extern template Result<bool> subdivided_holds(const OneMoreLimits<ArmLimits>&, const Options&, const Shape&,
                                              std::int64_t);
extern template Result<Volume> subdivided_volume(const OneMoreLimits<SixJointLimits>&, const Options&, bool);
extern template Result<bool> subdivided_holds(const OneMoreLimits<SixJointLimits>&, const Options&, const Shape&,
                                              std::int64_t);
extern template Result<Volume> subdivided_volume(const OneMoreLimits<ThreeParallelLimits>&, const Options&, bool);
extern template Result<bool> subdivided_holds(const OneMoreLimits<ThreeParallelLimits>&, const Options&, const Shape&,
                                              std::int64_t);

}  // namespace polypod::workspace
