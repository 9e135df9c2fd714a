// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A machine as lines in space.
#pragma once

#include <vector>

#include "polypod/machine/any_machine.hpp"
#include "polypod/machine/parts.hpp"
#include "polypod/report/scene.hpp"

namespace polypod::pages {

/// Base, rails, legs or links, platform, joints and tool in M, mm: hexapods at home, arms with the tool tip at `tip`
/// and R = 1 (nothing but the axes of the base if that is out of reach).
std::vector<report::Line3> machine_lines(const machine::AnyMachine& machine, const Vec3& tip);

/// The same of an outline.
std::vector<report::Line3> lines_of(const machine::Outline& outline);

/// Turns a scene by 180 deg about x, so that machines whose z points down hang from their base.
void hang(report::Scene& scene);

}  // namespace polypod::pages
