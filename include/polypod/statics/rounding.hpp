// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "polypod/statics/compliance.hpp"

namespace polypod::statics {

/// What rounding leaves of the tip's compliance where the machine has none there, m/N: (1e-9)^2 times the larger of the
/// tip's own and L^2 times that of the rotation, L the characteristic length of kinematics::dexterity. A load that
/// turns the tool moves the tip by less than 1e-9 of what that turn moves a point at the distance L, and its lever is
/// as short. Source: our own.
double rounding_of_tip(const machine::AnyMachine& machine, const Compliance& compliance);

}  // namespace polypod::statics
