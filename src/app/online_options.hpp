// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The settings of an on-line correction, as `online` and `export linuxcnc` take them.
#pragma once

#include "command.hpp"
#include "polypod/control/online.hpp"

namespace polypod::app {

struct OnlineSettings {
  double delay_ms = 5, cutoff_hz = 10, noise_n = 1, weight_n = 60, weight_removed_n = 60, shift_limit_um = 500,
         shift_rate_um_per_s = 10000, hold_ms = 100, force_factor = 1, compliance_factor = 1, least_margin = 2,
         time_limit_s = 600;
  int seed = 1;

  void declare(Arguments& a);
  [[nodiscard]] control::OnlineOptions options(const Context& context) const;
  /// The first of these options that was given; null: none.
  [[nodiscard]] static const char* given(const Context& context);
};

Json loop_json(const control::OnlineLoop& loop, const control::OnlineMargin& margin);

}  // namespace polypod::app
