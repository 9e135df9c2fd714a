// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A robot cell as plain data, and the reader of cell files (docs/cell.md).
//
// Frame C of the cell: origin on the floor, x to the right as seen from the front, y to the back, z up. SI inside.
#pragma once

#include <array>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::cell {

/// What is picked: round, lying flat.
struct Item {
  std::string name;
  double diameter = 0, height = 0;  ///< m
  double mass = 0;                  ///< kg
};

/// What items are put into: round, upright.
struct Container {
  std::string name;
  int capacity = 1;                 ///< items
  double diameter = 0, height = 0;  ///< m
  double mass = 0;                  ///< kg, empty
  double grip = 0;                  ///< m above its bottom, where the tool takes it
  bool grip_given = true;           ///< false: half of its height, by default
};

/// A straight belt. Items keep their place on it until they are taken or reach its end.
struct Conveyor {
  std::string name;
  Place place;
  Vec3 at = Vec3::Zero();             ///< m, in C: middle of the belt's surface where it begins
  double heading = 0;                 ///< rad, direction in which it runs, about z from x
  double length = 0, width = 0;       ///< m; the width is that of the belt
  double frame_width = 0, depth = 0;  ///< m, of its body: across, and below the surface of the belt
  double speed = 0;                   ///< m/s, > 0
  double power = 0;                   ///< W
  std::string motor;
  std::string onto;      ///< conveyor onto which its items go at the end; empty: they fall off and count as missed
  bool outfeed = false;  ///< they leave the cell at the end, as they should
  double drop = 0, drop_spread = 0;  ///< m, how far beyond the end items land on it, and how much that differs
  bool drop_given = false;           ///< false: how far they fly
  std::string chute;                 ///< the body that leads them from the end to where they land; empty: they fall
  double acceleration = 0;           ///< m/s2, with which it starts and stops; 0: not given, at once
  double sensor = -1;                ///< m along the belt: it stands while an item is there or beyond; below 0: none

  /// How far beyond its end an item flies that falls by `height`, m: v sqrt(2 h / g).
  [[nodiscard]] double flight(double height) const {
    return speed * std::sqrt(2 * std::max(height, 0.0) / units::kStandardGravity);
  }

  /// A point of the belt's surface, m in C: `along` from where it begins, `across` to the left of its direction.
  [[nodiscard]] Vec3 point(double along, double across) const {
    return at + Vec3(std::cos(heading) * along - std::sin(heading) * across,
                     std::sin(heading) * along + std::cos(heading) * across, 0);
  }
};

/// Looks at a part of a belt, at equal intervals; an item is known when it lay wholly in the field of one picture and
/// `delay` has passed.
struct Camera {
  std::string name;
  int conveyor = 0;
  double at = 0, across = 0;                 ///< m on the belt, middle of the field
  double field_along = 0, field_across = 0;  ///< m
  std::array<double, 2> pixels{};            ///< along, across; 0: not given
  double interval = 0, delay = 0;            ///< s
};

/// Brings items from outside.
struct Source {
  enum class Arrival { even, poisson, list };
  std::string name;
  int conveyor = 0;
  Arrival arrival = Arrival::even;
  double rate = 0;                              ///< per s
  std::vector<double> times;                    ///< s, of a list
  double at = 0;                                ///< m along the belt
  double across_low = 0, across_high = 0;       ///< m; uniform between
  int limit = std::numeric_limits<int>::max();  ///< items in all
};

/// Where containers stand, or are emptied.
struct Spot {
  enum class Kind { pallet, holder, opening, pour };
  std::string name;
  Place place;
  Kind kind = Kind::holder;
  std::vector<Vec3> slots;  ///< m, in C: where the tool takes the container, one a slot
  /// How the tool stands there: its axis `pitch` below the horizontal, towards `heading` (not finite: away from the
  /// machine's base), turned by `roll` about itself; rad.
  double pitch = 0, roll = 0, heading = std::numeric_limits<double>::quiet_NaN();
  double clearance = 0;  ///< m, the tool comes from so far above
  int containers = 0;    ///< that stand there at the beginning, in the first slots
  int filled = 0;        ///< items in each of them
  std::string zone;
  // of a place where containers are emptied
  int conveyor = -1;                                                      ///< onto which the items fall
  double along_low = 0, along_high = 0, across_low = 0, across_high = 0;  ///< m, uniform between
  double time = 0;  ///< s: pouring; of an opening: until a person has taken the container
  // its body
  Vec3 size = Vec3::Zero();  ///< m; 0: none
  Vec3 middle = Vec3::Zero();
  double turn = 0;  ///< rad about z
};

/// A Polypod machine in its place.
struct Machine {
  std::string name, file;
  Place place;
  machine::AnyMachine model;
  Pose X_CM;
  Vec3 home = Vec3::Zero();                             ///< of the tool tip in C, m; arms with the joints below instead
  machine::JointVector home_joints;                     ///< rad or m; empty: from `home`
  std::vector<double> joint_speed, joint_acceleration;  ///< rad or m, s; one a joint
  double tool_speed = 5, tool_acceleration = 100, tool_jerk = 5000;       ///< of deltas, m, s
  double drive_speed = 12, drive_acceleration = 250, drive_jerk = 20000;  ///< of deltas, rad or m, s
  double straight_speed = 0.25;         ///< m/s, on the last stretch to a place and back
  double lift = 0.04, blend = 0.03;     ///< m, of deltas: motion::Cycle
  double grip = 0, release = 0;         ///< s: closing and opening, vacuum on and off
  double failure = 0;                   ///< share of grips of items that fail, 0 to 1
  double body = 0.1;                    ///< m, diameter that its links are given for collisions
  std::vector<std::string> mounted_on;  ///< bodies, places and conveyors that its base may touch
  bool folds = false;    ///< between two places it draws in, turns about its first joint, and reaches out
  double payload = 0;    ///< kg, 0: not given
  double hand_mass = 0;  ///< kg, of gripper or sucker
  double stopping = -1;  ///< s, after the stop was asked for; below 0: from its dynamics
  std::vector<std::pair<std::string, double>> defaults;  ///< keys that the file does not give, with what they became
};

/// A machine moves items from a belt into containers, or containers from place to place.
struct Task {
  std::string name;
  Place place;
  int machine = 0;
  int from_conveyor = -1;                  ///< items; else a container
  int from = -1, to = -1, via = -1;        ///< spots
  double window_low = 0, window_high = 0;  ///< m along the belt, within which items are taken
  double release = 0;                      ///< m in C, height of the tool where it lets an item go
  enum class Which { any, full, empty } which = Which::any;
  bool working = true, ending = false;  ///< the states of the cell in which it is done
  bool on_serve = false;                ///< once for each SERVE
  bool keeps_zone = false;  ///< stays in the zone of the place that it comes from until it may enter the next
  int step = 0;             ///< of KOZ 5.2.2, for the records; 0: none
};

/// What an operator does, or when.
enum class Order { start, stop, serve, end };
struct Command {
  double time = 0;  ///< s
  Order order = Order::start;
};

/// A box that stands there, turned about z.
struct Body {
  std::string name;
  std::string kind;                                 ///< "table", "cabinet", "guard", "rail", ...
  Vec3 middle = Vec3::Zero(), size = Vec3::Zero();  ///< m
  double turn = 0;                                  ///< rad
  bool module = false;                              ///< must pass the door as one piece
};

/// What keeps people away.
struct Guard {
  enum class Kind { fence, curtain, scanner };
  std::string name;
  Place place;
  Kind kind = Kind::fence;
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();  ///< m, its foot
  double height = 0;                            ///< m, of the upper edge (of a scanner: of the plane)
  double resolution = 0.030;                    ///< m, of curtains and scanners
  double response = 0;                          ///< s, of the device
  bool resolution_given = false, response_given = false;
  double opening = 0;                                   ///< m, the largest opening in it
  std::string opening_shape = "round";                  ///< slot, square, round
  std::optional<double> opening_height = std::nullopt;  ///< m, of its axis; none: at any height
  std::string measure;                                  ///< what else protects there, in words
};

struct CostRow {
  std::string name, unit, note, kind;
  double quantity = 0, price = 0;  ///< the price of one
  bool stock = false;              ///< at hand: costs nothing
  [[nodiscard]] double sum() const { return stock ? 0 : quantity * price; }
};
struct Cost {
  std::string currency = "EUR";
  std::vector<CostRow> rows;
  double budget = 0;                 ///< the total with its reserve; 0: not given
  double hours = 0, hour_price = 0;  ///< of assembly, not in the total
  double running_price = 0;          ///< of an hour in which the cell runs; 0: not given
  [[nodiscard]] double total() const;
  [[nodiscard]] double reserve() const { return budget > 0 ? budget - total() : 0; }
};

/// For planning: what the stations of the layout send each other.
struct Station {
  std::string name;
  Vec3 at = Vec3::Zero();  ///< m
  bool fixed = true;       ///< of the coordinate method: it stays where it is
};
struct Flow {
  int from = 0, to = 0;
  double amount = 0;  ///< an hour
};
struct Relation {
  int a = 0, b = 0;
  char closeness = 'U';  ///< A E I O U X
  std::string reason;
};

struct Cell {
  std::string name, description, file;
  std::vector<Item> items;            ///< one kind
  std::vector<Container> containers;  ///< at most one kind
  std::vector<Conveyor> conveyors;
  std::vector<Camera> cameras;
  std::vector<Source> sources;
  std::vector<Spot> spots;
  std::vector<Machine> machines;
  std::vector<Task> tasks;
  std::vector<Command> commands;
  std::vector<Body> bodies;
  std::vector<Guard> guards;
  Cost cost;
  std::vector<Station> stations;
  std::vector<Flow> flows;
  std::vector<Relation> relations;
  std::vector<std::pair<std::string, std::string>> assumptions;  ///< what and why, in words
  std::string policy = "first";
  double minutes = 10;
  int seed = 1;
  double refill = -1;           ///< s, until a person has refilled the pallet and pressed START; below 0: never
  double door = 0;              ///< m, width of the door that modules pass; 0: none
  double control_response = 0;  ///< s, of safety controller and relays
  bool control_response_given = false;
  double clearance = 0.01;  ///< m, least distance of bodies that is no collision
  std::string stop_category = "1";
  std::string open_sides;  ///< what protects where no guard stands, in words
};

struct Override {
  std::string key, value;
};

/// Reads a cell file; `overrides` change numbers of it: `conveyor[1].speed_mm_per_s`. Paths of machines are relative to
/// the cell file. Errors: CE100 (no cell: nothing to simulate), CE101 (a name twice), CE102 (a name that nothing has),
/// CE103 (an item or container wider than where it goes), CE104 (a belt that runs backward), CE105 (a window, camera or
/// sensor that is not on its belt, or lies before what it needs), CE106 (a task without what it needs), CE107 (a
/// conveyor does not end over the one that its items go onto), CE108 (an override), those of config, of files and of
/// machine::load.
Result<Cell> read(const std::string& path, const std::vector<Override>& overrides = {});
Result<Cell> from_text(std::string_view toml, const std::string& file, const std::vector<Override>& overrides = {});

const char* name_of(Order order);
const char* name_of(Spot::Kind kind);
const char* name_of(Guard::Kind kind);

/// Fences, bodies and floor of the cell: the box that holds all of it, m.
std::pair<Vec3, Vec3> extent(const Cell& cell);

}  // namespace polypod::cell
