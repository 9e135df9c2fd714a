// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The cycle of a cell as a simulation of discrete events (KOZ 5.2.2), and what can be learned from it.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/cell/cell.hpp"
#include "polypod/cell/reach.hpp"

namespace polypod::cell {

/// One line of the record.
struct Event {
  double time = 0;  ///< s
  int step = 0;     ///< of KOZ 5.2.2; 0: none
  std::string who, what, detail;
};

/// What a machine did, for the Gantt chart.
struct Interval {
  double from = 0, to = 0;  ///< s
  std::string what;
  bool busy = false;
};

/// A way of a machine's tool in a recorded run: to joints, or (where these are empty) to a point, past `lift` above
/// both ends.
struct Leg {
  double from = 0, to = 0;      ///< s
  machine::JointVector joints;  ///< rad or m
  Vec3 point = Vec3::Zero();    ///< m, in C
  double lift = 0;              ///< m
};

/// What lies and stands where at an instant of a recorded run.
struct Picture {
  double time = 0;                      ///< s
  std::vector<Vec3> items, containers;  ///< m, in C: on belts, and in places
  enum class Hand { empty, item, container };
  std::vector<Hand> hands;  ///< of each machine
  int placed = 0, missed = 0, filled = 0, emptied = 0, served = 0;
};

struct MachineUse {
  double busy = 0;                                      ///< s, moving or gripping
  double stopped = 0;                                   ///< s, held by a STOP, whatever it was doing
  std::vector<std::pair<std::string, double>> waiting;  ///< for what, s; in the order of their names
  std::vector<Interval> intervals;                      ///< of a recorded run
  std::vector<Leg> legs;                                ///< of a recorded run, while pictures are taken
};

struct BeltUse {
  double running = 0;  ///< s
  int most = 0;        ///< items at once
};

/// Amount that went from one station to another.
struct Traffic {
  std::string from, to;
  int count = 0;
};

struct Outcome {
  double seconds = 0;                       ///< simulated
  double working = 0;                       ///< s, between START and the end of the work, stops not counted
  int fed = 0;                              ///< items from sources
  int placed = 0;                           ///< items put into containers
  int missed = 0;                           ///< items that fell off the end of a belt
  int left = 0;                             ///< items that left the cell on a belt that leads out of it
  int unseen = 0;                           ///< items that lay wholly in no picture
  int failed = 0;                           ///< grips that failed
  int filled = 0, emptied = 0, served = 0;  ///< containers
  int remaining = 0;                        ///< items on belts at the end
  std::vector<int> done;                    ///< a task
  std::vector<double> held;                 ///< s, a source: it had an item, the cell worked, and its belt stood
  std::vector<int> lost;                    ///< items that did not come for that; of a list: that came late, too
  std::vector<MachineUse> machines;
  std::vector<BeltUse> belts;
  std::vector<Traffic> traffic;
  std::vector<Event> events;           ///< of a recorded run
  std::vector<Picture> pictures;       ///< of a recorded run: kFilm seconds from the first START, or until a STOP
  std::string state;                   ///< at the end: "waiting", "working", "ending", "refill", "stopped"
  std::optional<double> stands_since;  ///< s; nothing can ever move again without help
  std::string full;                    ///< a place that is full and from which no task takes: that is why
  std::string standstill;              ///< why, with the cycle of waiting where there is one
  std::string crowded;                 ///< a conveyor on which more than 5000 items gathered: the run ended there
  std::uint64_t calendar = 0;          ///< events of the calendar
  /// Items put into containers a minute of simulated time.
  [[nodiscard]] double throughput_per_min() const { return seconds > 0 ? 60 * placed / seconds : 0; }
};

inline constexpr double kFilm = 60, kFilmStep = 0.15;  // s

struct RunSettings {
  double seconds = 600;
  std::uint64_t seed = 1;
  std::string policy = "first";          ///< first, nearest, look-ahead
  bool record = false;                   ///< keep events and intervals
  std::vector<double> machine_time;      ///< factor of all times of each machine; empty: 1
  std::vector<double> belt_speed;        ///< factor of the speed of each belt; empty: 1
  std::function<bool(double)> progress;  ///< share done; false ends the run
};

/// Runs the cell. The machines must reach everything (`motions.problems` without kind "reach"). The same inputs give
/// the same outcome. Cost: 0.05 s for an hour of the seed's cell.
Outcome run(const Cell& cell, const Motions& motions, const RunSettings& settings);

/// Mean over seeds with the half width of its 95 % confidence interval (Student); infinite for one seed.
struct Estimate {
  double mean = 0, half_width = 0;
};
Estimate estimate(const std::vector<double>& values);

/// What limits the cell: the change of throughput where one thing is made better, with the same random numbers.
struct Gain {
  std::string what;  ///< "arm 10 % faster"
  Estimate change;   ///< items a minute
};
struct Study {
  std::vector<Outcome> outcomes;                           ///< one a seed
  Estimate throughput;                                     ///< a minute
  std::vector<Estimate> utilisation;                       ///< of each machine
  std::vector<std::pair<std::string, Estimate>> policies;  ///< throughput by policy
  std::vector<std::pair<std::string, Estimate>> missed_by_policy;
  std::vector<Gain> gains;       ///< largest first
  std::vector<Gain> next_gains;  ///< those of the others where what limits is twice as fast
  bool complete = true;          ///< it was not interrupted
};
/// Runs seeds settings.seed, settings.seed + 1, ... Cost: about 10 to 25 runs a seed with `deep`.
Study study(const Cell& cell, const Motions& motions, const RunSettings& settings, int seeds, bool deep);

}  // namespace polypod::cell
