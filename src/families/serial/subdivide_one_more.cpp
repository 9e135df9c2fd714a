// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "../../workspace/subdivide.hpp"
#include "bounds.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {

template Result<Volume> subdivided_volume(const ScaraLimits&, const Options&, bool);
template Result<bool> subdivided_holds(const ScaraLimits&, const Options&, const Shape&, std::int64_t);
template Result<Volume> subdivided_volume(const OneMoreLimits<ArmLimits>&, const Options&, bool);
template Result<bool> subdivided_holds(const OneMoreLimits<ArmLimits>&, const Options&, const Shape&, std::int64_t);
template Result<Volume> subdivided_volume(const OneMoreLimits<SixJointLimits>&, const Options&, bool);
template Result<bool> subdivided_holds(const OneMoreLimits<SixJointLimits>&, const Options&, const Shape&,
                                       std::int64_t);
template Result<Volume> subdivided_volume(const OneMoreLimits<ThreeParallelLimits>&, const Options&, bool);
template Result<bool> subdivided_holds(const OneMoreLimits<ThreeParallelLimits>&, const Options&, const Shape&,
                                       std::int64_t);

}  // namespace polypod::workspace
