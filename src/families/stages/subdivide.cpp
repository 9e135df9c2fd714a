// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "../../workspace/subdivide.hpp"
#include "bounds.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {

template Result<Volume> subdivided_volume(const WristLimits&, const Options&, bool);
template Result<bool> subdivided_holds(const WristLimits&, const Options&, const Shape&, std::int64_t);

}  // namespace polypod::workspace
