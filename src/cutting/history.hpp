// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Building a force history disc by disc.
#pragma once

#include "polypod/cutting/force.hpp"

namespace polypod::cutting {

inline constexpr double kDiscShare = 0.025;  ///< thickest disc in parts of D (SLAV 5.2.1)
inline constexpr int kMinHistorySteps = 8;   ///< below, one step would stand for more than the half turn of a cut

ForceHistory start_history(int steps);

/// Adds the forces of all teeth on one disc with its middle at `z` (m above the tip) and thickness `dz`. Every step
/// stands for the angles half a step to both sides: a tooth that enters or leaves within them counts with its share, so
/// that the mean does not depend on where the steps fall.
void add_disc(const Cutter& cutter, const Material& material, double entry, double exit, double z, double dz,
              double feed_per_tooth, ForceHistory& history);

void finish_history(ForceHistory& history);

}  // namespace polypod::cutting
