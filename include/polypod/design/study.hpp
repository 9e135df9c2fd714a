// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A parameter study: what of a machine may change, what is wanted of it, and what must hold.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/design/duty.hpp"
#include "polypod/geometry/pose.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::design {

using machine::AnyMachine;

/// What of a machine may be wanted or held, as a study names it. Means are those over the workspace that `dexterity`
/// and `errors` print; what is seen is the most or the least of the poses that were looked at, not a bound.
enum class Figure : std::uint8_t {
  volume,           ///< volume_mm3: the middle of proven bounds
  largest_box,      ///< largest_box_mm3: a box that is certainly inside (workspace::largest_inside)
  condition,        ///< mean condition number
  sigma_min,        ///< mean least singular value
  determinant,      ///< mean |det J|
  condition_max,    ///< the worst condition number seen
  sigma_min_least,  ///< the least singular value seen
  tolerance,        ///< tolerance_mm: mean worst case of the position, tolerances of the study
  tolerance_max,    ///< the largest worst case seen, mm
  tolerance_angle,  ///< tolerance_rad: mean worst case of the orientation
  known_error,      ///< known_error_mm: mean error of the position, known errors of the study
  known_error_max,  ///< the largest seen, mm
  throughput,       ///< throughput_per_min: items put into containers; of a cell
  missed,           ///< items that fall off the end of a belt, the mean of the runs; of a cell
  cost_per_item,    ///< running price of an item in the cell's currency; of a cell
  compliance,       ///< compliance_um_per_N: largest displacement per force at the middle of the work
  footprint,        ///< footprint_mm2: the rectangle along x and y round the machine at home
  height,           ///< height_mm: of the machine at home
  // At the poses of the study (Duty), or where it names none at the points of the workspace:
  natural_frequency,  ///< natural_frequency_hz: the lowest at any pose
  drive_force,        ///< drive_force_N: the largest of a drive that slides, at rest under load and weight
  drive_torque,       ///< drive_torque_Nm: the same of drives that turn
  stiffness,          ///< stiffness_N_per_um: the smallest, along the study's direction or the softest one
  deflection,         ///< deflection_um: the largest of the tip under the load
  longest_leg,        ///< longest_leg_mm: of a leg between its joints
  cycle_time,         ///< cycle_time_s: of the study's motion in the least time
};
inline constexpr int kFigures = 25;
inline constexpr int kFinestResolution = 512;  ///< points along the longest side of a workspace

/// What a figure is called, what it means, and what it takes.
struct FigureInfo {
  Figure figure;
  const char* name;
  const char* meaning;
  bool of_survey;         ///< a sample over the points of the workspace
  bool of_poses = false;  ///< at the poses of the study; a sample over the workspace where there are none
};
const std::array<FigureInfo, kFigures>& figure_infos();
const FigureInfo& info_of(Figure figure);

/// A parameter that may change: a range, a range with a step, or a list.
struct Vary {
  std::string key;  ///< as `polypod info` lists it, with its unit
  double min = 0, max = 0;
  double step = 0;             ///< 0: any number of the range
  std::vector<double> values;  ///< of a list, as given
  Place place;

  /// How many values it may take; nothing where they are a continuum.
  [[nodiscard]] std::optional<std::int64_t> count() const;
  /// The value at u, 0 to 1: linear over a range, the nearest of the steps, equal shares of a list.
  [[nodiscard]] double at(double u) const;
  /// A u whose value is the nearest to `value`.
  [[nodiscard]] double share_of(double value) const;
};

/// key = factor * (the value of `equals`) + offset.
struct Tie {
  std::string key, equals;
  double factor = 1, offset = 0;
  Place place;
};

struct Goal {
  Figure figure = Figure::volume;
  bool maximise = true;
  double weight = 1;
  double best = 1;  ///< the normalising value of JEL (8.3)
  bool weighted = false;
  Place place;
};

/// A bound on a figure, or a box in M that must certainly be inside the workspace.
struct Hold {
  Figure figure = Figure::volume;
  std::optional<double> min, max;
  std::optional<std::array<Vec3, 2>> box;  ///< corners, m
  Place place;

  [[nodiscard]] std::string in_words() const;
};

/// How one machine is looked for.
enum class Search : std::uint8_t {
  automatic,  ///< models up to 600 evaluations of at most 20 parameters, else evolution
  models,     ///< Kriging models of the objective and of the holds say what to try next
  evolution,  ///< several starts of differential evolution, each refined
};

/// A machine that is known already and shall be seen beside what is found: judged as a candidate is, but none.
struct Compared {
  std::string name;
  std::vector<double> varied;  ///< of Study::vary, in the units of their keys; they may lie outside of the ranges
  Place place;
};

struct Study {
  std::string file;     ///< as it was read
  std::string machine;  ///< as the study names it
  /// The machine's file with everything that the study sets, as text: the study does not change when that file does.
  std::string machine_toml;
  AnyMachine start;                                       ///< that machine
  bool of_cell = false;                                   ///< `machine` and its text are a cell (cell_study.hpp)
  int runs = 1;                                           ///< of the cycle of a cell, with seeds that follow each other
  double tilt = 0;                                        ///< rad
  std::optional<std::array<double, 2>> a_range, b_range;  ///< rad
  std::uint64_t seed = 1;
  int evaluations = 400;  ///< at most
  Search search = Search::automatic;
  int resolution = 24;
  double relative_tolerance = 0.01;
  bool interference = false;
  std::vector<std::pair<std::string, double>> tolerances{{"all", 0.01}}, errors;  ///< mm and deg
  /// [robust]: parameters with half the width of their box, in the units of their keys. Every figure is then the worst
  /// at the middle and the corners of the box.
  std::vector<std::pair<std::string, double>> robust;
  Duty duty;
  std::vector<Vary> vary;
  std::vector<Tie> ties;
  std::vector<Goal> goals;
  std::vector<Hold> holds;
  std::vector<Compared> compared;  ///< no part of the identity

  /// Several goals without weights: what is looked for is a front.
  [[nodiscard]] bool wants_front() const { return goals.size() > 1 && !goals.front().weighted; }
  /// The figures of goals and holds, each once, goals first.
  [[nodiscard]] std::vector<Figure> figures() const;
  /// The keys that are varied, then those that are tied, each with its value, in the units of their keys.
  [[nodiscard]] std::vector<std::pair<std::string, double>> parameters(const std::vector<double>& varied) const;
  /// The machine with these values of the varied keys. Errors: those of the family's reader.
  [[nodiscard]] Result<AnyMachine> machine_at(const std::vector<double>& varied) const;
  /// Whether the figure is one over the points of the workspace in this study.
  [[nodiscard]] bool surveys(Figure figure) const;
  /// The values of the varied keys of a machine; empty where it does not have one of them.
  [[nodiscard]] std::vector<double> values_of(const AnyMachine& of) const;
  /// As `polypod info` lists it; nothing where it is not listed.
  [[nodiscard]] static std::optional<double> value_of(const AnyMachine& of, const std::string& key);
  /// Everything that decides the figures of a candidate, and the seed: two studies with the same text keep their rows
  /// together. The number of evaluations, `search` and `compared` are no part of it.
  [[nodiscard]] std::string identity() const;
};

/// Reads a study file (docs/optimize.md). Errors: those of TOML files and of machines; OP100 (an unknown figure), OP101
/// (an empty range, step or list), OP102 (a key that the machine does not have), OP103 (a key that is varied, tied or
/// set twice, or a tie that leads nowhere), OP104 (nothing to vary, no goal), OP105 (weights and best values), OP106
/// (holds that contradict each other or say nothing), OP107 (a figure that this machine does not have), OP108 (sense),
/// OP109 (a range of directions, or a cone as well), OP117 (a machine to compare with), OP118 (a search that is not
/// known, or models of too much), OP140 (poses, a load or a motion that say nothing), OP141 (a box of [robust] that is
/// none).
Result<Study> read_study(const std::string& path);
/// The same from text; `name` stands for the file, and a machine is looked for beside it. `machine_toml`: the machine's
/// file with what the study sets, as Study::machine_toml keeps it; where it is given no other file is read.
Result<Study> study_from_text(std::string_view text, const std::string& name, const std::string& machine_toml = {});

}  // namespace polypod::design
