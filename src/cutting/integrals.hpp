// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Integrals of the force components over a span of tooth angles.
#pragma once

#include "polypod/cutting/cutter.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::cutting {

/// Integrals over phi_a .. phi_b (0 <= phi_a <= phi_b <= pi) of one tooth's force per unit of depth, split into the
/// part of the edges and the part that grows with the chip: F = edge + s_z^x cut.
struct SpanIntegral {
  Vec3 edge = Vec3::Zero();  ///< N rad / m
  Vec3 cut = Vec3::Zero();   ///< N rad / m^(1 + x)
};

SpanIntegral integrate_span(const Material& material, double phi_a, double phi_b);

}  // namespace polypod::cutting
