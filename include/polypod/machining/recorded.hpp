// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a program really cuts on the soft machine, on the way that a controller recorded.
#pragma once

#include <functional>
#include <vector>

#include "polypod/machining/path_mode.hpp"
#include "polypod/machining/predict.hpp"

namespace polypod::machining {

/// Where the controller had the tip at an instant.
struct RecordedTip {
  double time = 0;          ///< s
  int line = 0;             ///< of the program that ran
  Vec3 p_W = Vec3::Zero();  ///< m
};

/// A point of the deflected tool on the recorded way.
struct RecordedPoint {
  double time = 0;  ///< s
  int move = 0;     ///< the programmed move that it is judged against
  int line = 0;     ///< of that, in the program that was meant
  bool cutting = false;
  bool turning = false;            ///< the command turns away from the move: see RecordedCut
  Vec3 deflection = Vec3::Zero();  ///< C F, in W, m
  Vec3 force = Vec3::Zero();       ///< on the tool, in W, N
  double deflection_normal = 0;    ///< m, of the deflection: across the path in the plane, > 0 away from the wall
  double normal = 0, vertical = 0, distance = 0;  ///< m, of the deflected tip: PathError
};

/// How much of the deflection across the path the commands take back. Means over the length of the cut, places where
/// the command turns away from the move left out.
struct Gain {
  double length = 0;           ///< m, that was counted
  double mean_deflection = 0;  ///< m, of the deflection along the normal
  double mean_left = 0;        ///< m, of the normal error
  double rms_deflection = 0;   ///< m, across the path: along the normal and the tool axis
  double rms_left = 0;         ///< m, of normal and vertical error

  void add(double weight, double deflection_normal, double deflection_vertical, double normal, double vertical);
  /// 1 - |mean_left| / |mean_deflection| and 1 - rms_left / rms_deflection; 0 where nothing is deflected.
  [[nodiscard]] double removed_mean() const;
  [[nodiscard]] double removed_rms() const;
};

/// A corner of the program that ran.
struct RecordedCorner {
  int line = 0;          ///< that of the move which ends there
  double turn = 0;       ///< rad
  double predicted = 0;  ///< m, Corner::deviation
  bool bound = false;    ///< `predicted` is only not exceeded
  double recorded = 0;   ///< m, from the corner to the nearest point of the recorded way
  bool cutting = false;  ///< feed moves on both sides
};

struct RecordedCut {
  Prediction cut;                     ///< of the recorded way against the programmed moves
  std::vector<RecordedPoint> points;  ///< every evaluated point, in order of time
  Gain gain;                          ///< over all of the cut
  std::vector<std::pair<int, Gain>> gain_by_line;
  std::vector<RecordedCorner> corners;
  std::size_t pieces = 0;   ///< straight pieces that stand for the record
  bool to_the_end = false;  ///< the record reaches the end of the program
  int last_line = 0;        ///< the line that it reaches
  std::vector<std::string> notes;
};

struct RecordedOptions {
  double step = 1e-4;     ///< m, longest distance between evaluated points
  PlannerLimits planner;  ///< for the predicted corners
  std::function<bool(double)> progress;
};

/// Sends the deflected cutter along the recorded way, in equilibrium (Bend::equilibrium), and judges it against the
/// moves of `program`, the one that was meant. `ran` are the moves of the program that the controller ran: the same, or
/// a correction of it; only its corners are looked at.
///
/// The record becomes the fewest straight pieces (farthest point first) that keep within 0.2 um of it across, and
/// within 20 um along at constant speed, so that each piece has the feed that the controller really had there. Each
/// belongs to a programmed move: the record is followed along the moves in their order, and goes on to the next where
/// it comes nearer to that. Where the command turns away from its move by more than 0.1 rad (a rounded corner, a
/// transition of a correction) the tool does not follow the command at once: the balance of yield_step is used there.
///
/// Errors: MC330 the record does not follow the program (more than 10 mm off a feed move), MC331 fewer than two places
/// in the record; those of accept and run_pass; MC304 a rapid through material. Cost: some 10 us a point.
Result<RecordedCut> judge_recorded(const Job& job, const gcode::Program& program,
                                   const gcode::Interpretation& interpretation, const gcode::Program& ran_program,
                                   const gcode::Interpretation& ran, const std::vector<RecordedTip>& record,
                                   const RecordedOptions& options = {});

}  // namespace polypod::machining
