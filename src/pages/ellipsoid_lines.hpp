// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Ellipsoids of velocity in a workspace, as lines in space.
#pragma once

#include <cstddef>
#include <vector>

#include "polypod/machine/any_machine.hpp"
#include "polypod/quality/survey.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::pages {

/// { J_v u : |u| <= 1 } (quality::ellipsoids) at evenly spread points of a survey, at most `most`, with its first
/// orientation: three circles each, in the planes of the half axes. All at one scale: the longest half axis takes half
/// of the distance between the points. Points that no joints reach within the limits are left out.
std::vector<report::Line3> velocity_ellipsoids(const machine::AnyMachine& machine, const quality::Survey& survey,
                                               std::size_t most);

}  // namespace polypod::pages
