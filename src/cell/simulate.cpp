// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/simulate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>

#include "polypod/cell/events.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/units.hpp"

namespace polypod::cell {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kSamePlace = 1e-9;  // m on a belt
constexpr std::size_t kMostOnBelt = 5000;

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
const char* name_of(State state) {
  switch (state) {
    case State::stopped:
      return "stopped";
    case State::working:
      return "working";
    case State::ending:
      return "ending";
    case State::waiting:
      return "waiting";
    case State::refill:
      break;
  }
  return "refill";
}

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
  double since = 0;
  double busy_time = 0;
  std::map<std::string, double> waiting;
  std::vector<Interval> intervals;
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

constexpr const char* kOtherState = "another state";

/// Something that is missing for a task, and who could bring it.
struct Need {
  std::string what;
  std::vector<std::string> who;
};

class World {
 public:
  World(const Cell& cell, const Motions& motions, const RunSettings& settings)
      : cell_(cell),
        motions_(motions),
        settings_(settings),
        changed_(sim_),
        halt_(sim_),
        resumed_(sim_),
        pours_(settings.seed, 1),
        failures_(settings.seed, 2),
        drops_(settings.seed, 3) {
    for (std::size_t k = 0; k < cell.conveyors.size(); ++k) {
      auto belt = std::make_unique<Belt>(sim_);
      belt->c = &cell.conveyors[k];
      belt->index = static_cast<int>(k);
      belt->speed = belt->c->speed * (k < settings.belt_speed.size() ? settings.belt_speed[k] : 1);
      for (const Camera& camera : cell.cameras)
        if (camera.conveyor == belt->index) belt->camera = &camera;
      for (std::size_t o = 0; o < cell.conveyors.size(); ++o)
        if (!belt->c->onto.empty() && cell.conveyors[o].name == belt->c->onto) belt->onto = static_cast<int>(o);
      for (const Task& t : cell.tasks) belt->picked_from |= t.from_conveyor == belt->index;
      belts_.push_back(std::move(belt));
    }
    for (const Spot& spot : cell.spots) {
      spots_.emplace_back(spot.slots.size());
      for (int i = 0; i < spot.containers; ++i) spots_.back()[static_cast<std::size_t>(i)].tin = Tin{spot.filled};
      if (!spot.zone.empty() && !zones_.contains(spot.zone))
        zones_[spot.zone] = std::make_unique<Resource>(sim_, spot.zone);
    }
    for (std::size_t m = 0; m < cell.machines.size(); ++m) {
      arms_.emplace_back();
      arms_.back().joints = motions.home[m];
    }
    out_.done.assign(cell.tasks.size(), 0);
  }

  Outcome run() {
    for (auto& belt : belts_) sim_.start(run_belt(*belt));
    for (std::size_t k = 0; k < cell_.sources.size(); ++k) sim_.start(feed(k));
    for (std::size_t m = 0; m < arms_.size(); ++m) sim_.start(run_machine(m));
    sim_.start(operate());
    // In pieces, so that a run can be stopped; time passes the same way in one piece.
    constexpr int kPieces = 50;
    for (int piece = 1; piece <= kPieces; ++piece) {
      sim_.run(settings_.seconds * piece / kPieces);
      if (settings_.progress && !settings_.progress(static_cast<double>(piece) / kPieces)) break;
      if (!out_.crowded.empty()) break;
      if (sim_.idle()) {
        sim_.run(settings_.seconds);
        break;
      }
    }
    return finish();
  }

 private:
  // Time and records ------------------------------------------------------------------------------------------------

  double machine_factor(std::size_t m) const {
    return m < settings_.machine_time.size() ? settings_.machine_time[m] : 1;
  }

  void note(int step, const std::string& who, const std::string& what, const std::string& detail = {}) {
    last_progress_ = sim_.now();
    if (settings_.record) out_.events.push_back({sim_.now(), step, who, what, detail});
  }
  void went(const std::string& from, const std::string& to, int count = 1) { traffic_[{from, to}] += count; }

  void act(std::size_t m, const std::string& what, bool busy) {
    Arm& arm = arms_[m];
    if (arm.activity == what && arm.active == busy) return;
    close(arm);
    arm.activity = what;
    arm.active = busy;
  }
  void close(Arm& arm) {
    const double passed = sim_.now() - arm.since;
    if (arm.active)
      arm.busy_time += passed;
    else if (passed > 0)
      arm.waiting[arm.activity.starts_with("waits: ") ? arm.activity.substr(7) : arm.activity] += passed;
    if (settings_.record && passed > 0) arm.intervals.push_back({arm.since, sim_.now(), arm.activity, arm.active});
    arm.since = sim_.now();
  }

  /// Work of `dt` seconds that stands still while the cell is stopped.
  Process work(std::size_t m, double dt) {
    dt *= machine_factor(m);
    while (dt > 0) {
      if (halted_) {
        co_await resumed_.wait();
        continue;
      }
      const double start = sim_.now();
      const bool stopped = co_await halt_.wait(dt);
      if (!stopped) break;
      dt -= sim_.now() - start;
    }
  }

  Process take_zone(std::size_t m, std::string zone) {
    Arm& arm = arms_[m];
    if (zone == arm.zone) co_return;
    if (zone.empty()) co_return;
    Resource& resource = *zones_.at(zone);
    if (!resource.is_free()) {
      const std::string before = arm.activity;
      act(m, "waits: zone " + zone, false);
      arm.waits_for_zone = true;
      arm.wanted_zone = zone;
      co_await resource.take(cell_.machines[m].name);
      arm.waits_for_zone = false;
      act(m, before, true);
    } else {
      co_await resource.take(cell_.machines[m].name);
    }
    if (!arm.zone.empty()) zones_.at(arm.zone)->give(cell_.machines[m].name);
    arm.zone = zone;
  }
  void leave_zone(std::size_t m) {
    Arm& arm = arms_[m];
    if (arm.zone.empty()) return;
    zones_.at(arm.zone)->give(cell_.machines[m].name);
    arm.zone.clear();
  }

  // Belts -----------------------------------------------------------------------------------------------------------

  double odometer(const Belt& b) const { return b.odometer + (b.running ? (sim_.now() - b.since) * b.speed : 0); }
  double along(const Belt& b, const OnBelt& item) const { return item.at + odometer(b) - item.odometer; }

  void update_running(Belt& b) {
    bool blocked = false;
    if (b.c->sensor >= 0)
      for (const OnBelt& item : b.items) blocked |= along(b, item) >= b.c->sensor - kSamePlace;
    const bool runs = (state_ == State::working || state_ == State::ending) && !halted_ && !blocked;
    if (runs == b.running) return;
    b.odometer = odometer(b);
    if (b.running) b.run_time += sim_.now() - b.since;
    b.since = sim_.now();
    b.running = runs;
    b.changed.notify();
  }
  void update_belts() {
    for (auto& belt : belts_) update_running(*belt);
  }

  void put_on(Belt& b, double at, double across) {
    if (b.items.size() >= kMostOnBelt) {
      out_.crowded = b.c->name;
      return;
    }
    OnBelt item;
    item.id = next_item_++;
    item.at = at;
    item.odometer = odometer(b);
    item.across = across;
    item.known = b.camera == nullptr;
    b.items.push_back(item);
    b.most = std::max(b.most, static_cast<int>(b.items.size()));
    update_running(b);
    b.changed.notify();
    if (item.known && b.picked_from) changed_.notify();
  }

  OnBelt* find(Belt& b, int id) {
    for (OnBelt& item : b.items)
      if (item.id == id) return &item;
    return nullptr;
  }

  Process look(Belt& b, int id, double frame) {
    co_await sim_.wait(frame - sim_.now());
    const double r = cell_.items[0].diameter / 2;
    const Camera& camera = *b.camera;
    const OnBelt* item = find(b, id);
    if (item == nullptr) co_return;
    const bool inside = along(b, *item) <= camera.at + camera.field_along / 2 - r + kSamePlace &&
                        std::abs(item->across - camera.across) <= camera.field_across / 2 - r + kSamePlace;
    if (!inside) {
      ++out_.unseen;
      note(0, camera.name, "does not see an item");
      co_return;
    }
    co_await sim_.wait(camera.delay * settings_.camera_delay);
    OnBelt* seen = find(b, id);
    if (seen == nullptr) co_return;
    seen->known = true;
    note(5, camera.name, "sees an item");
    changed_.notify();
  }

  Process run_belt(Belt& b) {
    const double r = cell_.items.empty() ? 0 : cell_.items[0].diameter / 2;
    for (;;) {
      double next = kInfinity;
      if (b.running) {
        for (const OnBelt& item : b.items) {
          const double s = along(b, item);
          double mark = b.c->length;
          if (b.camera != nullptr && !item.looked) mark = std::min(mark, b.camera->at - b.camera->field_along / 2 + r);
          if (b.c->sensor >= 0 && !item.at_sensor) mark = std::min(mark, b.c->sensor);
          next = std::min(next, std::max(0.0, (mark - s) / b.speed));
        }
      }
      co_await b.changed.wait(next);
      std::vector<OnBelt> over;
      for (std::size_t k = 0; k < b.items.size();) {
        OnBelt& item = b.items[k];
        const double s = along(b, item);
        if (b.camera != nullptr && !item.looked && s >= b.camera->at - b.camera->field_along / 2 + r - kSamePlace) {
          item.looked = true;
          const double interval = b.camera->interval;
          sim_.start(look(b, item.id, std::ceil(sim_.now() / interval - 1e-9) * interval));
        }
        if (b.c->sensor >= 0 && s >= b.c->sensor - kSamePlace) item.at_sensor = true;
        if (s >= b.c->length - kSamePlace) {
          over.push_back(item);
          b.items.erase(b.items.begin() + static_cast<std::ptrdiff_t>(k));
          continue;
        }
        ++k;
      }
      update_running(b);
      for (const OnBelt& item : over) pass_on(b, item);
    }
  }

  void pass_on(Belt& b, const OnBelt& item) {
    if (b.onto < 0) {
      ++out_.missed;
      note(0, b.c->name, "an item falls off");
      changed_.notify();
      return;
    }
    Belt& next = *belts_[static_cast<std::size_t>(b.onto)];
    const double drop = b.c->drop + drops_.uniform(-1, 1) * b.c->drop_spread;
    const Vec3 d = b.c->point(b.c->length + drop, item.across) - next.c->at;
    const double cs = std::cos(next.c->heading), sn = std::sin(next.c->heading);
    went(b.c->name, next.c->name);
    put_on(next, cs * d.x() + sn * d.y(), -sn * d.x() + cs * d.y());
  }

  Process feed(std::size_t k) {
    const Source& source = cell_.sources[k];
    Belt& belt = *belts_[static_cast<std::size_t>(source.conveyor)];
    Random random(settings_.seed, 16 + k);
    for (int n = 0; n < source.limit; ++n) {
      double dt = 0;
      if (source.arrival == Source::Arrival::even)
        dt = n == 0 ? 0 : 1 / source.rate;
      else if (source.arrival == Source::Arrival::poisson)
        dt = -std::log(1 - random.uniform()) / source.rate;
      else if (n < static_cast<int>(source.times.size()))
        dt = source.times[static_cast<std::size_t>(n)] - sim_.now();
      else
        co_return;
      co_await sim_.wait(dt);
      // A source waits while its belt stands.
      while (!belt.running) co_await belt.changed.wait();
      ++out_.fed;
      note(0, source.name, "an item arrives");
      put_on(belt, source.at, random.uniform(source.across_low, source.across_high));
    }
  }

  // The operator ----------------------------------------------------------------------------------------------------

  void set_state(State state) {
    if (is_on(state_) && !halted_) out_.working += sim_.now() - state_since_;
    state_since_ = sim_.now();
    state_ = state;
    update_belts();
    changed_.notify();
  }
  static bool is_on(State state) { return state == State::working || state == State::ending; }

  Process operate() {
    for (const Command& command : cell_.commands) {
      const double wait = command.time - sim_.now();
      if (wait > 0) co_await sim_.wait(wait);
      const double progress = last_progress_;
      switch (command.order) {
        case Order::start:
          note(halted_ ? 0 : 2, "operator", "START");
          if (halted_) {
            halted_ = false;
            state_since_ = sim_.now();
            update_belts();
            resumed_.notify();
            changed_.notify();
          } else if (!is_on(state_)) {
            if (state_ == State::refill) refill();
            note(3, "cell", "belts start, machines are made ready");
            set_state(State::working);
          }
          break;
        case Order::stop:
          note(0, "operator", "STOP");
          if (!halted_ && is_on(state_)) {
            out_.working += sim_.now() - state_since_;
            halted_ = true;
            update_belts();
            halt_.notify();
          }
          break;
        case Order::serve:
          note(0, "operator", "SERVE");
          ++serve_;
          changed_.notify();
          break;
        case Order::end:
          note(0, "operator", "END");
          if (state_ == State::working) set_state(State::ending);
          break;
      }
      // What the operator presses is no progress of the cell, but for a start.
      if (command.order != Order::start) last_progress_ = progress;
    }
  }

  void refill() {
    for (std::size_t k = 0; k < cell_.spots.size(); ++k) {
      for (int i = 0; i < cell_.spots[k].containers; ++i)
        spots_[k][static_cast<std::size_t>(i)].tin = Tin{cell_.spots[k].filled};
    }
    note(14, "operator", "the pallet is full again");
  }
  Process refill_later() {
    co_await sim_.wait(cell_.refill);
    if (state_ != State::refill) co_return;
    refill();
    note(2, "operator", "START");
    set_state(State::working);
  }

  [[nodiscard]] bool any_container(bool pallets) const {
    for (std::size_t k = 0; k < cell_.spots.size(); ++k) {
      const Spot::Kind kind = cell_.spots[k].kind;
      if (kind != Spot::Kind::holder && !(pallets && kind == Spot::Kind::pallet)) continue;
      for (const Slot& slot : spots_[k])
        if (slot.tin || slot.reserved) return true;
    }
    return false;
  }

  /// Whether the work has come to an end (KOZ's points 9, 10 and 13), asked when a machine has nothing to do.
  void maybe_end() {
    for (const Arm& arm : arms_)
      if (arm.busy) return;
    if (state_ == State::ending && !any_container(false)) {
      note(10, "cell", "belts stop, machines go home");
      note(11, "cell", "waits for START");
      set_state(State::waiting);
    } else if (state_ == State::working && had_containers_ && !any_container(true)) {
      note(13, "cell", "all containers are served; the operator is asked to refill the pallet");
      set_state(State::refill);
      if (cell_.refill >= 0) sim_.start(refill_later());
    }
  }

  // Machines --------------------------------------------------------------------------------------------------------

  [[nodiscard]] bool matches(const Task& task, const Tin& tin) const {
    const int capacity = cell_.containers[0].capacity;
    if (tin.reserved || tin.pending > 0) return false;
    if (task.which == Task::Which::full) return tin.count >= capacity;
    if (task.which == Task::Which::empty) return tin.count == 0;
    return true;
  }
  /// The slot of the container that an item goes into: the fullest that has room.
  [[nodiscard]] std::optional<std::size_t> room_in(int spot) const {
    std::optional<std::size_t> best;
    const std::vector<Slot>& slots = spots_[static_cast<std::size_t>(spot)];
    for (std::size_t k = 0; k < slots.size(); ++k) {
      if (!slots[k].tin || slots[k].tin->reserved) continue;
      if (slots[k].tin->count + slots[k].tin->pending >= cell_.containers[0].capacity) continue;
      if (!best || slots[k].tin->count > slots[*best].tin->count) best = k;
    }
    return best;
  }

  double way_to_belt(std::size_t task, const Where& where, double at, double across) const {
    const PickTable& table = motions_.picks[task];
    if (where.kind == Where::Kind::belt) {  // after a grip that failed: as long as by the first slot
      return std::max(table.time(0, at, across), table.time(0, where.along, where.across));
    }
    const std::size_t row = where.kind == Where::Kind::home ? table.times.size() - 1 : where.slot;
    return table.time(std::min(row, table.times.size() - 1), at, across);
  }

  /// How far a belt with a sensor still goes: until its first item is there.
  double room_of(const Belt& b) const {
    double room = kInfinity;
    if (b.c->sensor >= 0)
      for (const OnBelt& other : b.items) room = std::min(room, std::max(0.0, b.c->sensor - along(b, other)));
    return room;
  }

  struct Meeting {
    double travel = kInfinity, at = 0, wait = 0;
  };
  /// When and where a machine can meet an item that moves with its belt, from `start` seconds from now on.
  Meeting meet(std::size_t t, std::size_t m, const Where& where, const Belt& b, const OnBelt& item, double start,
               double factor, double room) const {
    const Task& task = cell_.tasks[t];
    const Machine& machine = cell_.machines[m];
    Meeting out;
    const double s0 = along(b, item), v = b.running ? b.speed : 0;
    const auto at = [&](double time) { return s0 + std::min(v * time, std::max(room, 0.0)); };
    const double last = task.window_high - v * machine.grip * factor;
    if (s0 > task.window_high + kSamePlace) return out;
    double earliest = start;
    if (at(start) < task.window_low) {
      if (!(v > 0) || s0 + room < task.window_low - kSamePlace) return out;
      earliest = std::max(start, (task.window_low - s0) / v);
    }
    const double matching = v > 0 ? v / machine.tool_acceleration : 0;
    double time = earliest;
    constexpr int kRounds = 8;
    for (int k = 0; k < kRounds; ++k) {
      const double travel = factor * way_to_belt(t, where, at(time), item.across) + matching;
      const double next = std::max(earliest, start + travel);
      const bool same = std::abs(next - time) < 1e-6;
      time = next;
      if (same) break;
    }
    if (at(time) > std::max(last, b.c->sensor >= 0 ? b.c->sensor : last) + kSamePlace) return out;
    out.at = at(time);
    out.travel = factor * way_to_belt(t, where, out.at, item.across) + matching;
    out.wait = std::max(0.0, time - start - out.travel);
    return out;
  }

  /// How many of the items can still be taken in the order of their leaving, after `start`, and when the last is in.
  std::pair<int, double> greedy(std::size_t t, std::size_t m, const Belt& b, const std::vector<const OnBelt*>& items,
                                int without, double start, Where where, double factor, double room) const {
    const Machine& machine = cell_.machines[m];
    int count = 0;
    for (const OnBelt* item : items) {
      if (item->id == without) continue;
      const Meeting meeting = meet(t, m, where, b, *item, start, factor, room);
      if (!std::isfinite(meeting.travel)) continue;
      start += meeting.wait + meeting.travel +
               factor * (machine.grip + motions_.picks[t].time(0, meeting.at, item->across) + machine.release);
      where = {Where::Kind::slot, 0, 0, 0};
      ++count;
    }
    return {count, start};
  }

  /// The item that a machine takes next.
  bool choose_item(std::size_t m, std::size_t t, Choice& out) {
    const Task& task = cell_.tasks[t];
    Belt& b = *belts_[static_cast<std::size_t>(task.from_conveyor)];
    const Where where = arms_[m].where;
    const double factor = machine_factor(m), room = room_of(b);
    struct Candidate {
      const OnBelt* item;
      Meeting meeting;
    };
    std::vector<Candidate> now;
    std::vector<const OnBelt*> known;
    double again = kInfinity;
    for (const OnBelt& item : b.items) {
      if (!item.known || item.reserved) continue;
      const Meeting meeting = meet(t, m, where, b, item, 0, factor, room);
      if (!std::isfinite(meeting.travel)) continue;
      known.push_back(&item);
      if (meeting.wait > 1e-6)
        again = std::min(again, meeting.wait);
      else
        now.push_back({&item, meeting});
    }
    if (now.empty()) {
      out.again = std::min(out.again, again);
      return false;
    }
    const auto leaves_first = [&](const OnBelt* x, const OnBelt* y) {
      const double ax = along(b, *x), ay = along(b, *y);
      return ax != ay ? ax > ay : x->id < y->id;
    };
    const Candidate* best = &now.front();
    if (settings_.policy == "nearest") {
      for (const Candidate& c : now)
        if (c.meeting.travel < best->meeting.travel) best = &c;
    } else if (settings_.policy == "look-ahead" && now.size() > 1) {
      constexpr std::size_t kMostKnown = 12, kMostFirst = 8;
      std::sort(known.begin(), known.end(), leaves_first);
      if (known.size() > kMostKnown) known.resize(kMostKnown);
      std::sort(now.begin(), now.end(),
                [&](const Candidate& x, const Candidate& y) { return leaves_first(x.item, y.item); });
      if (now.size() > kMostFirst) now.resize(kMostFirst);
      best = &now.front();
      std::pair<int, double> best_value{-1, 0};
      const Machine& machine = cell_.machines[m];
      for (const Candidate& c : now) {
        const double after =
            c.meeting.travel +
            factor * (machine.grip + motions_.picks[t].time(0, c.meeting.at, c.item->across) + machine.release);
        const auto [count, end] = greedy(t, m, b, known, c.item->id, after, {Where::Kind::slot, 0, 0, 0}, factor, room);
        if (count > best_value.first || (count == best_value.first && end < best_value.second - 1e-9)) {
          best_value = {count, end};
          best = &c;
        }
      }
    } else {
      for (const Candidate& c : now)
        if (leaves_first(c.item, best->item)) best = &c;
    }
    out.item = best->item->id;
    out.travel = best->meeting.travel;
    out.task = static_cast<int>(t);
    return true;
  }

  Choice choose(std::size_t m) {
    Choice out;
    out.reason = is_on(state_) ? "work" : std::string(name_of(state_)) == "refill" ? "refill" : "START";
    if (!is_on(state_) || halted_) return out;
    std::string first_reason;
    const auto lacks = [&](const char* what) {
      if (first_reason.empty()) first_reason = what;
    };
    for (std::size_t t = 0; t < cell_.tasks.size(); ++t) {
      const Task& task = cell_.tasks[t];
      if (task.machine != static_cast<int>(m)) continue;
      if (state_ == State::working ? !task.working : !task.ending) continue;
      if (task.on_serve && serve_ == 0) continue;
      if (task.from_conveyor >= 0) {
        if (!room_in(task.to)) {
          lacks("room in a container");
          continue;
        }
        if (choose_item(m, t, out)) return out;
        lacks("items");
        continue;
      }
      std::optional<std::size_t> from, to;
      const std::vector<Slot>& source = spots_[static_cast<std::size_t>(task.from)];
      for (std::size_t k = 0; k < source.size() && !from; ++k)
        if (source[k].tin && matches(task, *source[k].tin)) from = k;
      if (!from) {
        lacks("a container");
        continue;
      }
      if (task.to == task.from) to = from;
      const std::vector<Slot>& target = spots_[static_cast<std::size_t>(task.to)];
      for (std::size_t k = 0; k < target.size() && !to; ++k)
        if (!target[k].tin && !target[k].reserved) to = k;
      if (!to) {
        lacks("a free place");
        continue;
      }
      out.task = static_cast<int>(t);
      out.from_slot = *from;
      out.to_slot = *to;
      return out;
    }
    if (!first_reason.empty()) out.reason = first_reason;
    return out;
  }

  Process run_machine(std::size_t m) {
    Arm& arm = arms_[m];
    for (;;) {
      const Choice choice = choose(m);
      if (choice.task < 0) {
        // In nobody's way, and ready for the next.
        const bool to_home = !halted_ && !arm.at_home && (!arm.zone.empty() || !is_on(state_));
        if (to_home) {
          co_await go_home(m);
          continue;
        }
        arm.busy = false;
        act(m, "waits: " + choice.reason, false);
        maybe_end();
        co_await changed_.wait(choice.again);
        continue;
      }
      arm.busy = true;
      arm.at_home = false;
      const auto t = static_cast<std::size_t>(choice.task);
      if (cell_.tasks[t].from_conveyor >= 0)
        co_await pick(m, t, choice);
      else
        co_await carry(m, t, choice);
    }
  }

  Process go_home(std::size_t m) {
    Arm& arm = arms_[m];
    arm.busy = true;
    act(m, "to its place of waiting", true);
    double time = joint_time(cell_.machines[m], arm.joints, motions_.home[m]);
    if (arm.where.kind == Where::Kind::slot && last_pick_.contains(m)) {
      time = motions_.picks[last_pick_.at(m)].home_times[arm.where.slot];
    } else if (arm.where.kind == Where::Kind::belt && last_pick_.contains(m)) {
      const PickTable& table = motions_.picks[last_pick_.at(m)];
      time = table.time(table.times.size() - 1, arm.where.along, arm.where.across);
    }
    co_await work(m, time);
    arm.where = {};
    arm.joints = motions_.home[m];
    arm.at_home = true;
    leave_zone(m);
  }

  Process pick(std::size_t m, std::size_t t, Choice choice) {
    const Task& task = cell_.tasks[t];
    const Machine& machine = cell_.machines[m];
    const Spot& spot = cell_.spots[static_cast<std::size_t>(task.to)];
    Arm& arm = arms_[m];
    Belt& b = *belts_[static_cast<std::size_t>(task.from_conveyor)];
    last_pick_[m] = t;
    act(m, task.name, true);
    OnBelt* item = find(b, choice.item);
    item->reserved = true;
    std::optional<std::size_t> slot = room_in(task.to);
    spots_[static_cast<std::size_t>(task.to)][*slot].tin->pending++;
    const double across = item->across;
    double expected = along(b, *item) + (b.running ? b.speed * choice.travel : 0);
    co_await work(m, choice.travel / machine_factor(m));
    leave_zone(m);
    item = find(b, choice.item);
    const auto give_up = [&] {
      spots_[static_cast<std::size_t>(task.to)][*slot].tin->pending--;
      arm.where = {Where::Kind::belt, std::clamp(expected, task.window_low, task.window_high), across, 0};
    };
    if (item == nullptr) {
      give_up();
      co_return;
    }
    // The belt may have stopped on the way: the tool goes on to where the item is.
    const double off = std::abs(along(b, *item) - expected);
    if (off > 1e-4) co_await work(m, trapezoid_time(off, machine.tool_speed, machine.tool_acceleration));
    co_await work(m, machine.grip);
    item = find(b, choice.item);
    if (item == nullptr) {
      give_up();
      co_return;
    }
    const double at = along(b, *item);
    expected = at;
    if (at > task.window_high + 1e-6 || (machine.failure > 0 && failures_.uniform() < machine.failure)) {
      item->reserved = false;
      give_up();
      ++out_.failed;
      note(0, machine.name, "the grip fails");
      changed_.notify();
      co_return;
    }
    std::erase_if(b.items, [&](const OnBelt& x) { return x.id == choice.item; });
    update_running(b);
    b.changed.notify();
    arm.where = {Where::Kind::belt, at, across, 0};
    co_await take_zone(m, spot.zone);
    co_await work(m, motions_.picks[t].time(*slot, at, across) + machine.release);
    Tin& tin = *spots_[static_cast<std::size_t>(task.to)][*slot].tin;
    tin.pending--;
    tin.count++;
    ++out_.placed;
    ++out_.done[t];
    arm.where = {Where::Kind::slot, 0, 0, *slot};
    went(b.c->name, machine.name);
    went(machine.name, spot.name);
    note(task.step, machine.name, task.name, fmt::format("{} slot {}: {}", spot.name, *slot + 1, tin.count));
    if (tin.count >= cell_.containers[0].capacity) {
      ++out_.filled;
      note(task.step, spot.name, "a container is full", fmt::format("slot {}", *slot + 1));
    }
    changed_.notify();
  }

  /// A joint motion to a place, with its zone. The zone of where it comes from is kept until it is there; to go on to
  /// another zone it first leaves that by way of its place of waiting, unless the task keeps zones.
  Process go(std::size_t m, std::string zone, machine::JointVector to, bool keeps_zone) {
    Arm& arm = arms_[m];
    const Machine& machine = cell_.machines[m];
    if (!zone.empty() && !arm.zone.empty() && zone != arm.zone && !keeps_zone) {
      co_await work(m, joint_time(machine, arm.joints, motions_.home[m]));
      arm.joints = motions_.home[m];
      leave_zone(m);
    }
    if (!zone.empty()) co_await take_zone(m, zone);
    co_await work(m, joint_time(machine, arm.joints, to));
    arm.joints = to;
    if (zone.empty()) leave_zone(m);
  }

  const Stand& stand(std::size_t m, int spot, std::size_t slot) const {
    const std::vector<Stand>& all = motions_.stands[m][static_cast<std::size_t>(spot)];
    return all[std::min(slot, all.size() - 1)];
  }

  Process carry(std::size_t m, std::size_t t, Choice choice) {
    const Task& task = cell_.tasks[t];
    const Machine& machine = cell_.machines[m];
    const Spot &source = cell_.spots[static_cast<std::size_t>(task.from)],
               &target = cell_.spots[static_cast<std::size_t>(task.to)];
    std::vector<Slot>&from = spots_[static_cast<std::size_t>(task.from)],
    &to = spots_[static_cast<std::size_t>(task.to)];
    from[choice.from_slot].tin->reserved = true;
    if (task.to != task.from) to[choice.to_slot].reserved = true;
    if (task.on_serve) --serve_;
    act(m, task.name, true);
    note(task.step, machine.name, task.name + ": begins", fmt::format("{} slot {}", source.name, choice.from_slot + 1));
    had_containers_ = true;
    const Stand& take = stand(m, task.from, choice.from_slot);
    co_await go(m, source.zone, take.above, task.keeps_zone);
    co_await work(m, take.straight + machine.grip);
    Tin tin = *from[choice.from_slot].tin;
    from[choice.from_slot].tin.reset();
    if (task.to == task.from) from[choice.from_slot].reserved = true;
    co_await work(m, take.straight);
    changed_.notify();
    went(source.name, machine.name);
    if (task.via >= 0) {
      const Spot& pour = cell_.spots[static_cast<std::size_t>(task.via)];
      const Stand& there = stand(m, task.via, 0);
      co_await go(m, pour.zone, there.above, task.keeps_zone);
      co_await work(m, there.straight);
      Belt& belt = *belts_[static_cast<std::size_t>(pour.conveyor)];
      const int count = tin.count;
      for (int k = 0; k < count; ++k) {
        co_await work(m, pour.time / count);
        put_on(belt, pours_.uniform(pour.along_low, pour.along_high),
               pours_.uniform(pour.across_low, pour.across_high));
      }
      if (count == 0) co_await work(m, pour.time);
      tin.count = 0;
      ++out_.emptied;
      went(machine.name, pour.name);
      went(pour.name, belt.c->name, count);
      note(task.step, machine.name, "a container is emptied", fmt::format("{} items on {}", count, belt.c->name));
      co_await work(m, there.straight);
    }
    const Stand& put = stand(m, task.to, choice.to_slot);
    co_await go(m, target.zone, put.above, task.keeps_zone);
    co_await work(m, put.straight + machine.release);
    tin.reserved = false;
    to[choice.to_slot].tin = tin;
    to[choice.to_slot].reserved = false;
    co_await work(m, put.straight);
    went(machine.name, target.name);
    ++out_.done[t];
    note(task.step, machine.name, task.name + ": done", fmt::format("{} slot {}", target.name, choice.to_slot + 1));
    if (target.kind == Spot::Kind::opening) {
      ++out_.served;
      sim_.start(taken(static_cast<std::size_t>(task.to), choice.to_slot));
    }
    changed_.notify();
  }

  /// A person takes what stands in an opening.
  Process taken(std::size_t spot, std::size_t slot) {
    co_await sim_.wait(cell_.spots[spot].time);
    spots_[spot][slot].tin.reset();
    note(8, "visitor", "takes a container", cell_.spots[spot].name);
    changed_.notify();
  }

  // The end ---------------------------------------------------------------------------------------------------------

  /// What task t lacks, with the machines that could bring it; "" stands for what comes by itself.
  std::vector<Need> needs(std::size_t t) const {
    std::vector<Need> out;
    const Task& task = cell_.tasks[t];
    const auto name = [&](std::size_t other) {
      return cell_.machines[static_cast<std::size_t>(cell_.tasks[other].machine)].name;
    };
    const auto add = [](Need& need, const std::string& who) {
      if (std::find(need.who.begin(), need.who.end(), who) == need.who.end()) need.who.push_back(who);
    };
    if (task.on_serve && serve_ == 0) out.push_back({"SERVE", {""}});
    if (state_ == State::working ? !task.working : !task.ending) out.push_back({kOtherState, {""}});
    const auto fillers = [&](int spot, Need& need) {
      for (std::size_t o = 0; o < cell_.tasks.size(); ++o) {
        const Task& other = cell_.tasks[o];
        if (other.to == spot && o != t && !(task.which == Task::Which::full && other.via >= 0)) add(need, name(o));
      }
    };
    if (task.from_conveyor >= 0) {
      if (!room_in(task.to)) {
        Need need{"a container with room in " + cell_.spots[static_cast<std::size_t>(task.to)].name, {}};
        for (std::size_t o = 0; o < cell_.tasks.size(); ++o)
          if (o != t && cell_.tasks[o].from_conveyor < 0 &&
              (cell_.tasks[o].to == task.to || cell_.tasks[o].from == task.to))
            add(need, name(o));
        out.push_back(need);
      }
      Need need{"items on " + cell_.conveyors[static_cast<std::size_t>(task.from_conveyor)].name, {}};
      bool there = false;
      // Belts that lead there.
      std::set<int> leading{task.from_conveyor};
      for (std::size_t round = 0; round < belts_.size(); ++round)
        for (const auto& belt : belts_)
          if (belt->onto >= 0 && leading.contains(belt->onto)) leading.insert(belt->index);
      for (const auto& belt : belts_) {
        if (!leading.contains(belt->index)) continue;
        for (const OnBelt& item : belt->items) {
          const bool before = belt->index != task.from_conveyor || along(*belt, item) <= task.window_high;
          // An item that is known and within reach is no lack.
          if (before && item.known && belt->index == task.from_conveyor && along(*belt, item) >= task.window_low)
            there = true;
          else if (before && belt->running)
            add(need, "");
        }
      }
      for (const Source& source : cell_.sources)
        if (leading.contains(source.conveyor)) add(need, "");
      for (std::size_t o = 0; o < cell_.tasks.size(); ++o)
        if (cell_.tasks[o].via >= 0 &&
            leading.contains(cell_.spots[static_cast<std::size_t>(cell_.tasks[o].via)].conveyor))
          add(need, name(o));
      if (!there) out.push_back(need);
      return out;
    }
    bool from = false;
    for (const Slot& slot : spots_[static_cast<std::size_t>(task.from)]) from |= slot.tin && matches(task, *slot.tin);
    const Spot &source = cell_.spots[static_cast<std::size_t>(task.from)],
               &target = cell_.spots[static_cast<std::size_t>(task.to)];
    if (!from) {
      Need need{fmt::format("a {}container in {}",
                            task.which == Task::Which::full    ? "full "
                            : task.which == Task::Which::empty ? "empty "
                                                               : "",
                            source.name),
                {}};
      fillers(task.from, need);
      out.push_back(need);
    }
    if (task.to != task.from) {
      bool free = false;
      for (const Slot& slot : spots_[static_cast<std::size_t>(task.to)]) free |= !slot.tin && !slot.reserved;
      if (!free) {
        Need need{"a free place in " + target.name, {}};
        if (target.kind == Spot::Kind::opening) add(need, "");
        for (std::size_t o = 0; o < cell_.tasks.size(); ++o)
          if (cell_.tasks[o].from == task.to && o != t) add(need, name(o));
        out.push_back(need);
      }
    }
    return out;
  }

  /// Machines none of which can go on, whatever the others do. A machine goes on where one of its tasks can; a task
  /// where all that it lacks can come.
  void find_standstill() {
    if (!is_on(state_) || halted_) return;
    std::set<std::string> stuck;
    std::map<std::string, std::vector<std::vector<Need>>> lacks;  // machine -> its tasks -> what each lacks
    for (std::size_t m = 0; m < arms_.size(); ++m) {
      const Arm& arm = arms_[m];
      const std::string& name = cell_.machines[m].name;
      if (arm.waits_for_zone) {
        lacks[name] = {{{"zone " + arm.wanted_zone, zones_.at(arm.wanted_zone)->holders()}}};
        stuck.insert(name);
      } else if (!arm.busy) {
        for (std::size_t t = 0; t < cell_.tasks.size(); ++t)
          if (cell_.tasks[t].machine == static_cast<int>(m)) lacks[name].push_back(needs(t));
        if (!lacks[name].empty()) stuck.insert(name);
      }
    }
    const auto comes = [&](const Need& need) {
      return std::any_of(need.who.begin(), need.who.end(),
                         [&](const std::string& who) { return !stuck.contains(who); });
    };
    for (bool again = true; again;) {
      again = false;
      for (const auto& [name, tasks] : lacks) {
        if (!stuck.contains(name)) continue;
        const bool goes_on = std::any_of(tasks.begin(), tasks.end(), [&](const std::vector<Need>& task) {
          return std::all_of(task.begin(), task.end(), comes);
        });
        if (!goes_on) continue;
        stuck.erase(name);
        again = true;
      }
    }
    if (stuck.empty()) return;
    std::vector<Wait> waits;
    for (const Machine& m : cell_.machines) {
      if (!stuck.contains(m.name)) continue;
      Wait wait{m.name, "", {}};
      for (const std::vector<Need>& task : lacks[m.name]) {
        for (const Need& need : task) {
          // What only another state of the cell would begin is left out.
          if (std::any_of(task.begin(), task.end(), [](const Need& n) { return n.what == kOtherState; })) continue;
          if (comes(need) || wait.what.find(need.what) != std::string::npos) continue;
          wait.what += (wait.what.empty() ? "" : " or ") + need.what;
          wait.whom.insert(wait.whom.end(), need.who.begin(), need.who.end());
        }
      }
      waits.push_back(wait);
    }
    std::vector<std::size_t> cycle = waiting_cycle(waits);
    std::string text;
    const bool circle = !cycle.empty();
    if (!circle)
      for (std::size_t k = 0; k < waits.size(); ++k) cycle.push_back(k);
    for (std::size_t k = 0; k < cycle.size(); ++k) {
      const Wait& wait = waits[cycle[k]];
      text += fmt::format("{}{} waits for {}", text.empty() ? "" : ", ", wait.who, wait.what);
      if (circle)
        text += fmt::format(", which {} would bring", waits[cycle[(k + 1) % cycle.size()]].who);
      else
        text += ", which nobody brings";
    }
    out_.standstill = text;
    double since = 0;
    for (std::size_t m = 0; m < arms_.size(); ++m)
      if (stuck.contains(cell_.machines[m].name)) since = std::max(since, arms_[m].since);
    out_.stands_since = sim_.idle() ? std::min(since, last_progress_) : since;
  }

  Outcome finish() {
    out_.seconds = sim_.now();
    if (is_on(state_) && !halted_) out_.working += sim_.now() - state_since_;
    find_standstill();
    for (Arm& arm : arms_) {
      close(arm);
      MachineUse use;
      use.busy = arm.busy_time;
      use.waiting.assign(arm.waiting.begin(), arm.waiting.end());
      use.intervals = std::move(arm.intervals);
      out_.machines.push_back(std::move(use));
    }
    for (auto& belt : belts_) {
      out_.belts.push_back({belt->run_time + (belt->running ? sim_.now() - belt->since : 0), belt->most});
      out_.remaining += static_cast<int>(belt->items.size());
    }
    for (const auto& [way, count] : traffic_) out_.traffic.push_back({way.first, way.second, count});
    out_.state = halted_ ? "stopped" : name_of(state_);
    out_.calendar = sim_.events();
    return std::move(out_);
  }

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
  bool halted_ = false, had_containers_ = false;
  int serve_ = 0, next_item_ = 0;
  Simulation sim_;  // before the signals; its processes end before what they use
  Signal changed_, halt_, resumed_;
  Random pours_, failures_, drops_;
};

}  // namespace

Outcome run(const Cell& cell, const Motions& motions, const RunSettings& settings) {
  return World(cell, motions, settings).run();
}

Estimate estimate(const std::vector<double>& values) {
  Estimate out;
  const auto n = static_cast<double>(values.size());
  for (const double v : values) out.mean += v / n;
  if (values.size() < 2) {
    out.half_width = kInfinity;
    return out;
  }
  double squares = 0;
  for (const double v : values) squares += (v - out.mean) * (v - out.mean);
  // The series of student_95 holds from 3 degrees of freedom on.
  const double t = n < 2.5 ? 12.706 : n < 3.5 ? 4.303 : student_95(n - 1);
  out.half_width = t * std::sqrt(squares / (n - 1) / n);
  return out;
}

Study study(const Cell& cell, const Motions& motions, const RunSettings& settings, int seeds, bool deep) {
  Study out;
  const auto runs = [&](RunSettings with) {
    std::vector<Outcome> outcomes;
    for (int k = 0; k < seeds && out.complete; ++k) {
      with.seed = settings.seed + static_cast<std::uint64_t>(k);
      with.record = with.record && k == 0;
      outcomes.push_back(run(cell, motions, with));
      if (settings.progress && !settings.progress(0)) out.complete = false;
    }
    return outcomes;
  };
  const auto throughputs = [](const std::vector<Outcome>& outcomes) {
    std::vector<double> v;
    for (const Outcome& o : outcomes) v.push_back(o.throughput_per_min());
    return v;
  };
  RunSettings plain = settings;
  out.outcomes = runs(plain);
  const std::vector<double> base = throughputs(out.outcomes);
  out.throughput = estimate(base);
  for (std::size_t m = 0; m < cell.machines.size(); ++m) {
    std::vector<double> v;
    for (const Outcome& o : out.outcomes) v.push_back(o.seconds > 0 ? o.machines[m].busy / o.seconds : 0);
    out.utilisation.push_back(estimate(v));
  }
  if (!deep) return out;
  plain.record = false;
  for (const char* policy : {"first", "nearest", "look-ahead"}) {
    RunSettings with = plain;
    with.policy = policy;
    const std::vector<Outcome> outcomes = runs(with);
    std::vector<double> missed;
    for (const Outcome& o : outcomes) missed.push_back(o.missed);
    out.policies.emplace_back(policy, estimate(throughputs(outcomes)));
    out.missed_by_policy.emplace_back(policy, estimate(missed));
  }
  // What is better by a tenth: each machine, each belt, the camera.
  const auto improvements = [&](const RunSettings& from, double factor, const char* text) {
    std::vector<std::pair<std::string, RunSettings>> list;
    for (std::size_t m = 0; m < cell.machines.size(); ++m) {
      RunSettings with = from;
      with.machine_time.resize(cell.machines.size(), 1);
      with.machine_time[m] /= factor;
      list.emplace_back(fmt::format("{} {}", cell.machines[m].name, text), with);
    }
    for (std::size_t c = 0; c < cell.conveyors.size(); ++c) {
      RunSettings with = from;
      with.belt_speed.resize(cell.conveyors.size(), 1);
      with.belt_speed[c] *= factor;
      list.emplace_back(fmt::format("conveyor {} {}", cell.conveyors[c].name, text), with);
    }
    return list;
  };
  const auto gains = [&](const RunSettings& from, const std::vector<double>& before) {
    std::vector<Gain> list;
    for (const auto& [what, with] : improvements(from, 1.1, "10 % faster")) {
      std::vector<double> after = throughputs(runs(with));
      for (std::size_t k = 0; k < after.size() && k < before.size(); ++k) after[k] -= before[k];
      list.push_back({what, estimate(after)});
    }
    std::stable_sort(list.begin(), list.end(),
                     [](const Gain& a, const Gain& b) { return a.change.mean > b.change.mean; });
    return list;
  };
  out.gains = gains(plain, base);
  // The same where what gains most is twice as fast.
  if (!out.gains.empty() && out.gains.front().change.mean > 0) {
    const auto twice = improvements(plain, 2.0, "10 % faster");
    for (const auto& [what, with] : twice) {
      if (what != out.gains.front().what) continue;
      out.next_gains = gains(with, throughputs(runs(with)));
      std::erase_if(out.next_gains, [&](const Gain& g) { return g.what == out.gains.front().what; });
    }
  }
  return out;
}

}  // namespace polypod::cell
