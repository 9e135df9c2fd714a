// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The cutter and the material of SLAV, and small helpers for properties.
#pragma once

#include <rapidcheck.h>

#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/cutting/stock.hpp"

namespace polypod::cutting::samples {

inline constexpr double kPi = std::numbers::pi;

inline Cutter end_mill(int teeth = 4) {
  return {"8 mm", units::from_mm(8), teeth, units::from_deg(30), units::from_mm(20)};
}

inline Material aluminium() {  // SLAV (5.8)
  Material m;
  m.ktc = units::from_N_per_mm2(1027.78);
  m.krc = units::from_N_per_mm2(182.03);
  m.kac = units::from_N_per_mm2(64.5);
  m.kte = units::from_N_per_mm(13.65);
  m.kre = units::from_N_per_mm(27.95);
  m.kae = units::from_N_per_mm(2.21);
  return m;
}

/// A number between lo and hi, in a million steps, all alike (rapidcheck's own ranges begin near their lower end).
inline double between(double lo, double hi) {
  constexpr int kSteps = 1'000'000;
  return lo + (hi - lo) * *rc::gen::resize(rc::kNominalSize, rc::gen::inRange(0, kSteps + 1)) / kSteps;
}

/// A whole number from lo up to hi - 1, all alike.
inline rc::Gen<int> whole(int lo, int hi) {
  return rc::gen::resize(rc::kNominalSize, rc::gen::inRange(lo, hi));
}

}  // namespace polypod::cutting::samples
