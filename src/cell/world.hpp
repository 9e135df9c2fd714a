// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The cell as it runs: what `run` of simulate.hpp simulates. Belts and sources are in belts.cpp, what a machine does
// next in choices.cpp, its work in machines.cpp, the search for standstills in standstill.cpp, operator and outcome in
// simulate.cpp.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common.hpp"
#include "polypod/cell/events.hpp"
#include "polypod/cell/simulate.hpp"
#include "polypod/core/random.hpp"

namespace polypod::cell {

inline constexpr double kSamePlace = 1e-9;  // m on a belt
inline constexpr std::size_t kMostOnBelt = 5000;

struct OnBelt {
  int id = 0;
  double at = 0, odometer = 0;  ///< m along when the belt's odometer showed that
  double across = 0;
  bool looked = false, known = false, reserved = false, at_sensor = false;
};

struct Belt {
  explicit Belt(Simulation& sim) : changed(sim) {}
  const Conveyor* c = nullptr;
  const Camera* camera = nullptr;
  int index = 0, onto = -1;
  bool picked_from = false;
  double speed = 0;
  double odometer = 0, since = 0, run_time = 0;
  bool running = false;
  std::vector<OnBelt> items;
  Signal changed;
  int most = 0;
};

struct Tin {
  int count = 0;
  int pending = 0;        ///< items on their way to it
  bool reserved = false;  ///< a machine comes for it
};
struct Slot {
  std::optional<Tin> tin;
  bool reserved = false;  ///< a machine brings one
};

enum class State { stopped, working, ending, waiting, refill };
const char* name_of(State state);

/// Where a machine's tool is.
struct Where {
  enum class Kind { home, belt, slot } kind = Kind::home;
  double along = 0, across = 0;
  std::size_t slot = 0;
};

struct Arm {
  Where where;
  machine::JointVector joints;
  bool at_home = true, busy = false;
  std::string zone;  ///< that it holds
  std::string activity = "waits: START";
  bool active = false;
  double begun = 0;  ///< the activity
  double since = 0;  ///< its time is booked
  double busy_time = 0, stopped = 0;
  std::map<std::string, double> waiting;
  std::vector<Interval> intervals;
  std::vector<Leg> legs;
  Picture::Hand hand = Picture::Hand::empty;
  bool waits_for_zone = false;
  std::string wanted_zone;
};

/// What a machine does next.
struct Choice {
  int task = -1;
  std::size_t from_slot = 0, to_slot = 0;
  int item = -1;
  double travel = 0, again = kInfinity;  ///< s; when to ask again where nothing can be done now
  std::string reason;
};

inline constexpr const char* kOtherState = "another state";

/// Something that is missing for a task, and who could bring it.
struct Need {
  std::string what;
  std::vector<std::string> who;
};

class World {
 public:
  World(const Cell& cell, const Motions& motions, const RunSettings& settings);

  Outcome run();

 private:
  // Time and records ------------------------------------------------------------------------------------------------

  double machine_factor(std::size_t m) const;

  void note(int step, const std::string& who, const std::string& what, const std::string& detail = {});
  void went(const std::string& from, const std::string& to, int count = 1) { traffic_[{from, to}] += count; }

  void act(std::size_t m, const std::string& what, bool busy);
  /// Books the time since the last booking: to what the machine does, or to the STOP that holds it.
  void close(Arm& arm);
  /// Everything stands, or goes on.
  void halt(bool stop);

  /// Takes pictures of a recorded run.
  void film();
  [[nodiscard]] Picture picture() const;
  /// The tool begins a way of `dt` seconds, for the film.
  void leg(std::size_t m, double dt, const machine::JointVector& joints) {
    if (filming_) arms_[m].legs.push_back({sim_.now(), sim_.now() + dt * machine_factor(m), joints, Vec3::Zero(), 0});
  }
  void leg(std::size_t m, double dt, const Vec3& point, double lift) {
    if (filming_) arms_[m].legs.push_back({sim_.now(), sim_.now() + dt * machine_factor(m), {}, point, lift});
  }
  [[nodiscard]] Vec3 on_top(const Belt& b, double at, double across) const {
    return b.c->point(at, across) + Vec3(0, 0, cell_.items[0].height);
  }

  /// Work of `dt` seconds that stands still while the cell is stopped.
  Process work(std::size_t m, double dt);

  Process take_zone(std::size_t m, std::string zone);
  void leave_zone(std::size_t m);

  // Belts -----------------------------------------------------------------------------------------------------------

  double odometer(const Belt& b) const { return b.odometer + (b.running ? (sim_.now() - b.since) * b.speed : 0); }
  double along(const Belt& b, const OnBelt& item) const { return item.at + odometer(b) - item.odometer; }

  void update_running(Belt& b);
  void update_belts();

  void put_on(Belt& b, double at, double across);

  OnBelt* find(Belt& b, int id);

  Process look(Belt& b, int id, double frame);

  Process run_belt(Belt& b);

  void pass_on(Belt& b, const OnBelt& item);

  Process feed(std::size_t k);

  // The operator ----------------------------------------------------------------------------------------------------

  void set_state(State state);
  static bool is_on(State state) { return state == State::working || state == State::ending; }

  /// Seconds between START and now in which the cell was on and not halted.
  [[nodiscard]] double working_time() const {
    return out_.working + (is_on(state_) && !halted_ ? sim_.now() - state_since_ : 0);
  }

  Process operate();

  void refill();
  Process refill_later();

  [[nodiscard]] bool any_container(bool pallets) const;

  /// Whether the work has come to an end (KOZ's points 9, 10 and 13), asked when a machine has nothing to do.
  void maybe_end();

  // Machines --------------------------------------------------------------------------------------------------------

  [[nodiscard]] bool matches(const Task& task, const Tin& tin) const;
  /// The slot of the container that an item goes into: the fullest that has room.
  [[nodiscard]] std::optional<std::size_t> room_in(int spot) const;

  double way_to_belt(std::size_t task, const Where& where, double at, double across) const;

  /// How far a belt with a sensor still goes: until its first item is there.
  double room_of(const Belt& b) const;

  struct Meeting {
    double travel = kInfinity, at = 0, wait = 0;
  };
  /// When and where a machine can meet an item that moves with its belt, from `start` seconds from now on.
  Meeting meet(std::size_t t, std::size_t m, const Where& where, const Belt& b, const OnBelt& item, double start,
               double factor, double room) const;

  /// How many of the items can still be taken in the order of their leaving, after `start`, and when the last is in.
  std::pair<int, double> greedy(std::size_t t, std::size_t m, const Belt& b, const std::vector<const OnBelt*>& items,
                                int without, double start, Where where, double factor, double room) const;

  /// The item that a machine takes next.
  bool choose_item(std::size_t m, std::size_t t, Choice& out);

  Choice choose(std::size_t m);

  Process run_machine(std::size_t m);

  Process go_home(std::size_t m);

  Process pick(std::size_t m, std::size_t t, Choice choice);

  /// A joint motion to a place, with its zone. The zone of where it comes from is kept until it is there; to go on to
  /// another zone it first leaves that by way of its place of waiting, unless the task keeps zones.
  Process go(std::size_t m, std::string zone, machine::JointVector to, bool keeps_zone);

  const Stand& stand(std::size_t m, int spot, std::size_t slot) const;

  Process carry(std::size_t m, std::size_t t, Choice choice);

  /// A person takes what stands in an opening.
  Process taken(std::size_t spot, std::size_t slot);

  // The end ---------------------------------------------------------------------------------------------------------

  /// What task t lacks, with the machines that could bring it; "" stands for what comes by itself.
  std::vector<Need> needs(std::size_t t) const;

  /// Machines none of which can go on, whatever the others do. A machine goes on where one of its tasks can; a task
  /// where all that it lacks can come.
  void find_standstill();

  Outcome finish();

  const Cell& cell_;
  const Motions& motions_;
  const RunSettings& settings_;
  Outcome out_;
  std::map<std::string, std::unique_ptr<Resource>> zones_;
  std::vector<std::unique_ptr<Belt>> belts_;
  std::vector<std::vector<Slot>> spots_;
  std::vector<Arm> arms_;
  std::map<std::size_t, std::size_t> last_pick_;
  std::map<std::pair<std::string, std::string>, int> traffic_;
  State state_ = State::stopped;
  double state_since_ = 0, last_progress_ = 0;
  bool halted_ = false, had_containers_ = false, filming_ = false;
  int serve_ = 0, next_item_ = 0;
  std::vector<std::optional<double>> held_since_;  // of each source that waits: the working time when it began
  std::vector<int> fed_;                           // items of each source
  Simulation sim_;                                 // before the signals; its processes end before what they use
  Signal changed_, halt_, resumed_;
  Random pours_, failures_, drops_;
};

}  // namespace polypod::cell
