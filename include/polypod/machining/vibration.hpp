// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The dynamic part of the deflection: how the tool vibrates under the teeth that pass, along a program.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/machining/predict.hpp"
#include "polypod/motion/vibration.hpp"

namespace polypod::machining {

/// What the teeth meet at an evaluated point of a cut.
struct TeethView {
  const gcode::Move& move;                    ///< commanded
  const cutting::EngagementProfile& profile;  ///< of the sides, at the deflected tip
  Eigen::Vector2d feed;                       ///< unit direction, in W
  double feed_per_tooth = 0;                  ///< m, of the sides
  bool end_cuts = false;                      ///< the end of the cutter cuts, too
};

/// run_pass that shows what the teeth meet at every evaluated point that cuts (not at those that only repeat the end of
/// the move before).
Result<PassResult> run_pass_of_teeth(const Job& job, const gcode::Program& program, const PassMoves& moves,
                                     cutting::Stock& stock, const PassOptions& options,
                                     const std::function<void(const Sample&, const TeethView&)>& teeth);

/// A point of a cut, with what the teeth meet there.
struct CutPoint {
  Sample sample;
  cutting::EngagementProfile profile;
  Eigen::Vector2d feed = Eigen::Vector2d::UnitX();  ///< unit direction, in W
  double feed_per_tooth = 0;                        ///< m
  bool end_cuts = false;
  int block = 0;
};

/// Points of a cut, for each cutter and spindle speed at most kMost of them, spread evenly over its cut.
class CutPoints {
 public:
  static constexpr std::size_t kMost = 100;
  static constexpr std::size_t kMostSpeeds = 40;  ///< of cutters and speeds; what comes after is not looked at

  /// For run_pass_of_teeth.
  void add(const Sample& sample, const TeethView& teeth);

  struct Group {
    std::vector<CutPoint> points;
    std::size_t seen = 0, stride = 1;
  };
  /// By tool number and spindle speed, rev/s.
  [[nodiscard]] const std::map<std::pair<int, double>, Group>& groups() const { return groups_; }
  /// Points that cut, and those of them that no group holds.
  [[nodiscard]] std::size_t seen() const { return seen_; }
  [[nodiscard]] std::size_t left_out() const { return left_out_; }

 private:
  std::map<std::pair<int, double>, Group> groups_;
  std::size_t seen_ = 0, left_out_ = 0;
};

/// The force of the teeth at a point, in M: its first harmonic is that of tooth passing.
///
/// Discs and angles as force_history (SLAV (5.4) to (5.10)), with the engagement that the pass met; all teeth alike, so
/// that the force has the period of one tooth. Sides only: what the end of the cutter adds is taken as steady. At most
/// 40 harmonics. Cost: 1 ms.
motion::PeriodicForce tooth_force(const Job& job, const CutPoint& point, int tool);

/// The damping ratio of every mode where the masses give none: a usual figure for machine tools (0.01 to 0.05),
/// assumed.
inline constexpr double kAssumedDamping = 0.03;

/// A harmonic of tooth passing beside a natural frequency.
struct NearMode {
  int harmonic = 1;
  int mode = 0;        ///< by rising frequency, from 0
  double natural = 0;  ///< Hz
  double apart = 0;    ///< share of the natural frequency, signed: > 0 where the harmonic is above it
  int line = 0;
};

/// Another spindle speed with the same feed per tooth.
struct SpeedAdvice {
  double spindle_speed = 0;  ///< rev/s
  double feed_factor = 1;    ///< of all feeds of this cutter at this speed
  double amplitude = 0;      ///< m
};

/// One cutter at one spindle speed.
struct SpeedVibration {
  int tool = 0;
  double spindle_speed = 0;           ///< rev/s
  double tooth_passing = 0;           ///< Hz: spindle speed times teeth
  std::size_t points = 0;             ///< judged
  double amplitude = 0;               ///< m, the largest distance of the tip from its mean place
  double mean = 0;                    ///< m, the mean of the points' largest distances
  double across = 0;                  ///< m, the largest across the path in the plane
  double along_axis = 0;              ///< m, the largest along the tool axis
  int line = 0;                       ///< of the largest amplitude
  std::optional<NearMode> unbounded;  ///< an undamped resonance: there is no steady state, and no figure
  /// The harmonic that comes nearest to a natural frequency, of those with 5 % of the largest harmonic's force or more.
  std::optional<NearMode> nearest;
  std::optional<SpeedAdvice> advice;  ///< where a resonance is near and another speed has less
};

struct ProgramVibration {
  double damping = kAssumedDamping;
  bool damping_assumed = true;
  struct Range {
    double low = 0, high = 0;
  };
  std::vector<Range> natural;  ///< Hz, along the program, by rising frequency
  std::vector<SpeedVibration> speeds;
  double amplitude = 0, mean = 0, across = 0, along_axis = 0;  ///< m, of all speeds
  int line = 0;
  std::size_t points = 0, of = 0;  ///< judged; and that cut
  std::size_t end_points = 0;      ///< judged, where the end of the cutter cuts: its part is taken as steady
  std::size_t left_out = 0;        ///< points of cutters and speeds beyond the first 40
  bool other_position = false;     ///< the program cuts with the other position of block delete too, not looked at
  std::vector<std::string> notes;

  [[nodiscard]] bool bounded() const;
  /// Why not all of the vibration is judged; empty where it is.
  [[nodiscard]] std::vector<std::string> not_judged() const;
  /// The largest distance from the programmed path with the vibration on top, corners counted, m: the two largest are
  /// added wherever they are, so that it is no less than what will be.
  [[nodiscard]] double largest_with(const Prediction& prediction) const;
  /// Prediction::within with the vibration counted.
  [[nodiscard]] bool within(const Job& job, const Prediction& prediction) const;
};

/// Why the vibration of this job's machine is not judged, with what would help; empty where it can be: no compliances.
std::string no_vibration(const Job& job, const gcode::Interpretation& interpretation);

/// The points of a program, by one more pass through the stock with the options of its prediction. Errors: those of
/// accept and run_pass.
Result<CutPoints> cut_points(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                             const PredictOptions& options = {});

/// The steady vibration of the tool tip under the periodic force of the teeth at the points of a prediction: modes of
/// the machine there (motion::modal_model, drives locked) and their steady state under tooth_force. Linear and forced:
/// what the vibration changes of the chips is not in it, so that nothing is said of chatter; nor of what swings beside
/// the modes of the joints (links, spindle, tool, workpiece), of starting and of run-out. Where a harmonic of tooth
/// passing is within 20 % of a natural frequency, speeds within 25 % in steps of 1 % with the same feed per tooth are
/// tried; the nearest with at most 1.25 times the least of them is the advice, if it has less than 0.7 times the
/// programmed. Errors: MC210 a pose that the machine does not reach; MC299 cancelled. Cost: 2 ms a point, at most 100 a
/// speed.
Result<ProgramVibration> vibration_of(const Job& job, const gcode::Program& program, const CutPoints& points,
                                      const Prediction& prediction, const motion::Dynamics& dynamics,
                                      std::optional<double> damping, const std::function<bool(double)>& progress = {});

}  // namespace polypod::machining
