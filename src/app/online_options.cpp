// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "online_options.hpp"

#include <cmath>

#include "polypod/core/units.hpp"

namespace polypod::app {
namespace {

constexpr config::Range kDelay_ms{0, 1000};
constexpr config::Range kCutoff_Hz{0.01, 499};
constexpr config::Range kNoise_N{0, 1000};
constexpr config::Range kWeight_N{0, 1e5};
constexpr config::Range kShift_um{1, 1e5};
constexpr config::Range kRate_um_per_s{1, 1e7};
constexpr config::Range kHold_ms{1, 10000};
constexpr config::Range kFactor{0.1, 10};
constexpr config::Range kMargin{1, 100};
constexpr config::Range kTime_s{1, 86400};
constexpr config::Range kSeed{0, 2147483647.0};

Json finite(double value) {
  return std::isfinite(value) ? Json(value) : Json();
}

}  // namespace

void OnlineSettings::declare(Arguments& a) {
  a.option("--delay-ms", delay_ms, kDelay_ms, "From the force to the value that the controller has (default: 5)");
  a.option("--cutoff-hz", cutoff_hz, kCutoff_Hz, "Low-pass of the force, first order (default: 10)");
  a.option("--noise-n", noise_n, kNoise_N, "Standard deviation of each component of the force (default: 1)");
  a.option("--weight-n", weight_n, kWeight_N, "Weight of spindle and tool on the sensor (default: 60)");
  a.option("--weight-removed-n", weight_removed_n, kWeight_N,
           "What the controller takes off for it (default: the weight)");
  a.option("--shift-limit-um", shift_limit_um, kShift_um, "Largest shift (default: 500)");
  a.option("--shift-rate-um-per-s", shift_rate_um_per_s, kRate_um_per_s, "Largest rate of the shift (default: 10000)");
  a.option("--hold-ms", hold_ms, kHold_ms,
           "How long a lost force or a shift at its limit is borne before the watchdog trips (default: 100)");
  a.option("--force-factor", force_factor, kFactor, "The real forces over those of the job (default: 1)");
  a.option("--compliance-factor", compliance_factor, kFactor, "The real compliance over that of the job (default: 1)");
  a.option("--least-margin", least_margin, kMargin,
           "Gain margin below which on-line correction is refused (default: 2)");
  a.option("--time-limit-s", time_limit_s, kTime_s, "Longest program, s of its feed moves (default: 600)");
  a.option("--seed", seed, kSeed, "Of the noise (default: 1)");
}

control::OnlineOptions OnlineSettings::options(const Context& context) const {
  control::OnlineOptions out;
  out.sensor.delay = units::from_ms(delay_ms);
  out.sensor.noise = noise_n;
  out.sensor.weight = weight_n;
  out.sensor.weight_removed = context.given("--weight-removed-n") ? weight_removed_n : weight_n;
  out.limits.cutoff = cutoff_hz;
  out.limits.size = units::from_um(shift_limit_um);
  out.limits.rate = units::from_um(shift_rate_um_per_s);
  out.limits.hold = units::from_ms(hold_ms);
  out.real_force = force_factor;
  out.real_compliance = compliance_factor;
  out.least_margin = least_margin;
  out.time_limit = time_limit_s;
  out.seed = static_cast<std::uint64_t>(seed);
  return out;
}

const char* OnlineSettings::given(const Context& context) {
  for (const char* name : {"--delay-ms", "--cutoff-hz", "--noise-n", "--weight-n", "--weight-removed-n",
                           "--shift-limit-um", "--shift-rate-um-per-s", "--hold-ms", "--force-factor",
                           "--compliance-factor", "--least-margin", "--time-limit-s", "--seed"})
    if (context.given(name)) return name;
  return nullptr;
}

Json loop_json(const control::OnlineLoop& loop, const control::OnlineMargin& margin) {
  return {{"compliance_um_per_N", units::to_um_per_N(loop.compliance)},
          {"model_compliance_um_per_N", units::to_um_per_N(loop.model_compliance)},
          {"cut_stiffness_N_per_mm", units::to_N_per_mm(loop.cut_stiffness)},
          {"cut_damping_Ns_per_mm", units::to_N_per_mm(loop.cut_damping)},
          {"gain_margin", finite(margin.gain)},
          {"frequency_Hz", margin.frequency},
          {"largest_gain", finite(margin.largest)},
          {"unstable_from_delay_ms", finite(margin.delay / units::from_ms(1))}};
}

}  // namespace polypod::app
