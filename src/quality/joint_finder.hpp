// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>

#include "polypod/quality/survey.hpp"

namespace polypod::quality {

/// joints_at for pose after pose: what does not change between them is worked out once. The machine must outlive it.
using JointFinder = std::function<std::optional<JointVector>(const Pose& X_MT)>;
JointFinder joint_finder(const AnyMachine& machine);

}  // namespace polypod::quality
