// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The questions of every family of machine::Families: what dispatch over AnyMachine needs to see.
#pragma once

#include "polypod/families/parallel/kinematics.hpp"
#include "polypod/families/stages/kinematics.hpp"
#include "polypod/kinematics/delta.hpp"
#include "polypod/kinematics/serial_arm.hpp"
#include "polypod/kinematics/slider_hexapod.hpp"
#include "polypod/kinematics/strut_hexapod.hpp"
