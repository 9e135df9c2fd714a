// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// On-line correction by a force sensor (Pan; SLAV 3.3), in a simulated loop: what it gains beside the off-line one.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/correct.hpp"

namespace polypod::control {

/// A sensor between machine and spindle.
struct ForceSensor {
  double delay = 5e-3;         ///< s, from the force to the value that the controller has
  double noise = 1;            ///< N, standard deviation of each component
  double weight = 60;          ///< N, of spindle and tool that hang on it, along -z of M
  double weight_removed = 60;  ///< N, what the controller takes off for it
};

/// What the controller does with it, once a cycle.
struct OnlineLimits {
  double cutoff = 10;    ///< Hz, of the low-pass of first order
  double size = 0.5e-3;  ///< m, of the shift
  double rate = 10e-3;   ///< m/s, of the shift
  double hold = 0.1;     ///< s, for which a lost sensor leaves the shift as it is, and the size may be exceeded
};

/// From forces to the shift of the command: low-pass, weight off, u = -C f, cut to size and rate. A force that is lost
/// (empty or not finite) leaves the shift as it is for `hold`; then the watchdog trips: the shift fades at `rate`. It
/// trips, too, where the shift asked for is larger than `size` for as long. Once tripped it stays so.
class OnlineCorrector {
 public:
  OnlineCorrector(const OnlineLimits& limits, double weight_removed, double period);
  /// One cycle: the force that came, the force for which the program is corrected already (0 where it is not), and the
  /// compliance of the tip by the model. All in one frame whose z is that of M. The shift for the next cycle, m.
  Vec3 step(const std::optional<Vec3>& force, const Vec3& expected, const Mat3& C);
  [[nodiscard]] bool tripped() const { return tripped_; }
  [[nodiscard]] const char* why() const { return why_; }
  [[nodiscard]] const Vec3& shift() const { return shift_; }

 private:
  OnlineLimits limits_;
  double weight_, period_, share_;
  Vec3 filtered_ = Vec3::Zero(), shift_ = Vec3::Zero();
  double lost_ = 0, beyond_ = 0;
  bool tripped_ = false;
  const char* why_ = "";
};

/// The loop along the normal of the path, linear about a cut: x = c + u + C F, F = F0 - K x - B dx/dt.
struct OnlineLoop {
  double compliance = 0;        ///< m/N, C of the machine
  double model_compliance = 0;  ///< m/N, C_m by which the controller shifts
  double cut_stiffness = 0;     ///< N/m, K: what the force loses where the tool moves away from the wall
  double cut_damping = 0;       ///< N s/m, B: the same for its speed, since the chip follows the way of the tool
};
struct OnlineMargin {
  double gain = 0;  ///< by this factor the loop's gain may grow before it is unstable at the delay of the sensor or
                    ///< at a shorter one; infinite where no factor makes it so
  double frequency = 0;  ///< Hz, at which it would then swing
  double largest = 0;    ///< the largest |L|; below 1 the loop is stable with any delay
  double delay = 0;      ///< s, the shortest delay, in whole cycles, with which it is unstable; infinite: none up to a
                         ///< second
};
/// u = -C_m G F closes a loop with positive feedback: the shift against the deflection raises the force. In steps of
/// the period T, with the low-pass H and the delay of d cycles and one more to compute,
///   L(z) = C_m H(z) z^-(d+1) P(z) / (1 + C P(z)),  P(z) = K + B (1 - z^-1) / T,  H(z) = (1 - a) / (1 - a z^-1).
/// L is stable where 1 + C K + 2 C min(B, 0) / T > 0 (else the gain is 0), so by Nyquist's criterion the closed loop is
/// stable if and only if no k in 0 .. 1 gives k L(e^(j w T)) = 1: gain = 1 / the largest real L on the circle. Cost:
/// some ms, up to some seconds where a delay can make it unstable.
OnlineMargin online_margin(const OnlineLoop& loop, const ForceSensor& sensor, const OnlineLimits& limits,
                           double period);

enum class OnlineMethod { none, offline, online, both };
const char* name_of(OnlineMethod method);

struct OnlineOptions {
  ForceSensor sensor;
  OnlineLimits limits;
  double real_force = 1;          ///< the real forces over those of the job
  double real_compliance = 1;     ///< the real compliance over that of the job
  double least_margin = 2;        ///< gain margin below which on-line correction is refused
  double time_limit = 600;        ///< s, of the program's feed moves
  double period = 1e-3;           ///< s
  std::optional<double> lost_at;  ///< s, from when on the sensor gives nothing
  std::uint64_t seed = 1;
  std::function<bool(const char* what, double share)> progress;
};

struct OnlineOutcome {
  OnlineMethod method = OnlineMethod::none;
  bool refused = false;      ///< the margin is too small: it was not run
  machining::Spread normal;  ///< m, over the cycles that cut
  double rms = 0;            ///< m, of the normal error
  double distance = 0;       ///< m, the largest from the programmed path, corners included
  int distance_line = 0;
  double largest_shift = 0;            ///< m, of the on-line part
  std::optional<std::string> stopped;  ///< the watchdog tripped: why, and where; what comes after was not cut
  int stopped_line = 0;
  std::size_t cycles = 0;  ///< that cut
};

struct OnlineResult {
  OnlineLoop loop;  ///< the worst that the cut without correction showed
  OnlineMargin margin;
  bool stable_enough = false;
  std::vector<OnlineOutcome> outcomes;  ///< none, offline, online, both
  std::vector<std::string> not_judged;
};

/// What the cut without correction shows of the loop.
struct OnlineLook {
  std::vector<OnlineLoop> loops;  ///< of the extremes of stiffness and damping
  OnlineLoop loop;                ///< that of these with the least margin
  OnlineMargin margin;
  bool stable_enough = false;  ///< the margin is at least OnlineOptions::least_margin
  OnlineOutcome outcome;
  std::vector<std::string> not_judged;
};
/// Runs the moves that `correction` found in the program without any correction; see simulate_online for the loop, the
/// errors and the cost. Where nothing is cut: the error of machining::cuts_nothing.
Result<OnlineLook> look_online(const machining::Job& job, const gcode::Program& program,
                               const gcode::Interpretation& interpretation, const machining::Correction& correction,
                               const OnlineOptions& options);

/// The loop in steps of `period`: the command goes along the program at its feeds, without acceleration; the tool
/// follows it by the balance of machining::yield_step (C F under the mean force of the cut that it really meets, chips
/// by its real way), cuts the stock, and the sensor and the controller see its force. `online` shifts by all of the
/// force, `both` by what the force differs from that which `machining::correct` expects at the place; the expected
/// force goes through the same delay and low-pass.
///
/// Left out: the force of plunges, tooth passing, masses and drives that lag. Errors: those of machining::correct;
/// LC130 a program that takes longer than `time_limit`, MC299 cancelled. Cost: some 0.2 ms a cycle.
Result<OnlineResult> simulate_online(const machining::Job& job, const gcode::Program& program,
                                     const gcode::Interpretation& interpretation, const OnlineOptions& options = {});

}  // namespace polypod::control
