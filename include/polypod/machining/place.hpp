// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where to put the part: the error of a program over the positions and rotations of the workpiece.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/check.hpp"
#include "polypod/machining/predict.hpp"

namespace polypod::machining {

/// A place of the workpiece frame W in M: its origin, and its rotation about z of M.
struct Placing {
  Vec3 origin = Vec3::Zero();  ///< m
  double turn = 0;             ///< rad

  [[nodiscard]] Pose pose() const { return {rotation_z(turn), origin}; }
};
Placing placing_of(const Job& job);
/// The job with its workpiece there.
Job placed_at(const Job& job, const Placing& at);

/// Why a program cannot be followed at a place, or that it can.
enum class PlaceFit : std::uint8_t {
  fits,
  reach,         ///< a point is out of reach
  limit,         ///< no posture keeps the limits at a point
  singular,      ///< a point is singular
  branch,        ///< the machine would have to change its posture on the way
  speed,         ///< a joint would be faster in a cut than the job allows
  acceleration,  ///< a joint would accelerate more in a cut than the job allows
  measured       ///< a cut lies outside of what the measured compliance covers
};
const char* name_of(PlaceFit fit);

/// The largest |normal error| of a prediction, m.
double largest_normal_error(const Prediction& prediction);

/// The figure that places are compared by.
enum class PlaceBy : std::uint8_t {
  normal_error,  ///< across the path in the plane
  distance       ///< of the deflected tool from the programmed path in space, the vertical part included
};

struct PlaceOptions {
  /// Of the origin of W in M, m, and of its rotation, rad; empty: as far as the program fits along each axis from where
  /// the part is, and all rotations.
  std::array<std::optional<machine::JointRange>, 3> box;
  std::optional<machine::JointRange> turns;
  PlaceBy by = PlaceBy::normal_error;
  int resolution = 13;           ///< positions along x and y in the first grid; half as many along z
  int rotations = 12;            ///< rotations in it
  int judged = 8;                ///< places of the grid that `predict` judges
  double finest = 0.1e-3;        ///< m, to which the best place is given
  double finest_turn = 0.00175;  ///< rad, likewise (0.1 deg)
  int threads = 0;               ///< 0: all; the result is the same
  bool again = false;            ///< see AcceptOptions
  /// The program with the other position of block delete: a place must fit both. Errors are those of the job's
  /// position.
  const gcode::Understood* other = nullptr;
  std::function<bool(double, const char*)> progress;
};

/// A place of the maps. The error and the compliance are estimates: the forces are those of the cut at the reference
/// place, and only some points of the program are looked at.
struct PlacePoint {
  Placing at;
  PlaceFit fit = PlaceFit::reach;
  double error = 0;       ///< m, largest |normal error|
  double distance = 0;    ///< m, largest distance of the deflected tool from the programmed path
  double compliance = 0;  ///< m/N, largest n^T C n of the cut, n the normal of the path
  /// The smallest distance of a joint from the ends of its range, as a share of the range: 0.5 is the middle.
  double margin = 0;
};

/// A place where `predict` was asked.
struct JudgedPlace {
  Placing at;
  double error = 0;     ///< m, largest |normal error| by predict
  double estimate = 0;  ///< m, by the forces of the reference place
  double distance = 0;  ///< m, largest distance of the deflected tool from the programmed path, by predict
  double distance_estimate = 0;
};

/// The figure of a place, an estimate or by predict, m.
double figure_of(const PlacePoint& place, PlaceBy by);
double figure_of(const JudgedPlace& place, PlaceBy by);

/// Positions over x and y at one height and rotation, x fastest.
struct PlaceMap {
  double z = 0, turn = 0;
  machine::JointRange x, y;
  int columns = 0, rows = 0;
  std::vector<PlacePoint> points;
};

struct PlaceResult {
  PlaceBy by = PlaceBy::normal_error;  ///< which figure is the smallest at `best`
  Placing start;
  PlaceFit start_fit = PlaceFit::fits;
  std::optional<double> start_error;     ///< m, by predict; none where the program does not fit there
  std::optional<double> start_distance;  ///< m, as JudgedPlace::distance
  std::optional<JudgedPlace> best;       ///< none where no place was found that fits
  Placing reference;                     ///< where the forces come from
  std::array<machine::JointRange, 3> box;
  machine::JointRange turns;
  bool held = false;  ///< not turned: the program tilts the tool by the machine's own A and B (may_turn_the_part)
  std::vector<JudgedPlace> judged;      ///< by predict, the best first
  std::size_t places = 0;               ///< estimated
  std::size_t fitting = 0;              ///< of them, places where the points that were looked at can be reached
  std::size_t failed = 0;               ///< of these, checked whole and found not to fit
  PlaceFit failed_by = PlaceFit::fits;  ///< the first of them
  std::size_t looked_at = 0;            ///< points of the program that are looked at for an estimate
  PlaceMap map;                         ///< round the best place
  std::vector<PlacePoint> rotations;    ///< at its position, over all rotations
  bool at_border = false;               ///< the best place lies at an end of the box

  /// Whether the tool is farther from the path at the best place than at the start: the normal error, by which places
  /// may be compared, has no vertical part.
  [[nodiscard]] bool farther_there() const;
  /// The figure of the start by which places are compared, m.
  [[nodiscard]] std::optional<double> start_figure() const {
    return by == PlaceBy::distance ? start_distance : start_error;
  }
};

/// Looks for the place at which the largest normal error of a program (or its largest distance, `by`) is smallest, over
/// a box of positions and rotations about z: a grid of estimates, the best of them judged by `check` and `predict`, a
/// search by ever smaller steps from the best five, and `predict` at the best three of what was found. Only a place
/// where `check` finds no problem counts. A search over a box has no proof: the place is the best that was found within
/// it, never worse than the start where that fits and lies within.
///
/// An estimate puts the forces F of one prediction to other compliances, delta = R^T C(X p) R F, at its 400 points at
/// most; what another deflection changes of the force is left out of it (some per cent). The same input gives the same
/// result with any number of threads.
/// The job is set up for the tool (tilted.hpp). Errors: those of accept and run_pass but MC210 and MC211, which are
/// places that do not fit; MC304 a rapid goes through material; MC400 an empty or reversed box; MC402 rotations that
/// the program does not allow; MC299 cancelled. Cost: about 0.5 ms an estimate for an arm, and some twenty predictions.
Result<PlaceResult> best_place(const Job& job, const gcode::Program& program,
                               const gcode::Interpretation& interpretation, const PlaceOptions& options = {});

/// The nearest places at which a program would fit.
struct NearestPlaces {
  std::optional<Placing> by_shift;  ///< the same rotation, the smallest shift that was found
  /// The same origin, the smallest rotation that was found; none where the program does not allow one
  /// (may_turn_the_part).
  std::optional<Placing> by_turn;
  double looked_to = 0;  ///< m, the largest shift that was looked at
};

struct NearestOptions {
  double finest = 0.1e-3;        ///< m
  double finest_turn = 0.00175;  ///< rad
  MotionLimits limits;
  std::string posture;                       ///< as CheckOptions::branch
  std::vector<double> start = {};            ///< as CheckOptions::start
  const gcode::Understood* other = nullptr;  ///< see PlaceOptions
  std::function<bool(double)> progress;
};

/// Looks in all directions (200 of them, then finer) for the smallest shift, and both ways for the smallest rotation
/// about z, after which `check` finds no problem in the program. What is returned was checked whole; that nothing
/// smaller would do is not proven. Both are empty where nothing was found within the reach of the machine. Errors:
/// MC309, MC299 cancelled.
Result<NearestPlaces> nearest_places(const machine::AnyMachine& machine, const Pose& X_MW,
                                     const gcode::Program& program, const gcode::Interpretation& interpretation,
                                     const NearestOptions& options = {});

}  // namespace polypod::machining
