// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace polypod::cell {

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

World::World(const Cell& cell, const Motions& motions, const RunSettings& settings)
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
  out_.held.assign(cell.sources.size(), 0);
  out_.lost.assign(cell.sources.size(), 0);
  held_since_.resize(cell.sources.size());
  fed_.resize(cell.sources.size());
}

Outcome World::run() {
  for (auto& belt : belts_) sim_.start(run_belt(*belt));
  for (std::size_t k = 0; k < cell_.sources.size(); ++k) sim_.start(feed(k));
  for (std::size_t m = 0; m < arms_.size(); ++m) sim_.start(run_machine(m));
  sim_.start(operate());
  note(1, "cell", "containers are in their places; waits for START");
  if (settings_.record) film();
  // In pieces, so that a run can be stopped; time passes the same way in one piece.
  constexpr int kPieces = 50;
  for (int piece = 1; piece <= kPieces; ++piece) {
    if (settings_.seconds * piece / kPieces < sim_.now()) continue;
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

void World::note(int step, const std::string& who, const std::string& what, const std::string& detail) {
  last_progress_ = sim_.now();
  if (settings_.record) out_.events.push_back({sim_.now(), step, who, what, detail});
}

void World::set_state(State state) {
  if (is_on(state_) && !halted_) out_.working += sim_.now() - state_since_;
  state_since_ = sim_.now();
  state_ = state;
  update_belts();
  changed_.notify();
}

void World::halt(bool stop) {
  for (Arm& arm : arms_) close(arm);
  halted_ = stop;
}

Process World::operate() {
  for (const Command& command : cell_.commands) {
    const double wait = command.time - sim_.now();
    if (wait > 0) co_await sim_.wait(wait);
    const double progress = last_progress_;
    switch (command.order) {
      case Order::start:
        note(halted_ ? 0 : state_ == State::waiting ? 12 : 2, "operator", "START");
        if (halted_) {
          halt(false);
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
          halt(true);
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
        note(state_ == State::working ? 7 : 0, "operator", "END");
        if (state_ == State::working) set_state(State::ending);
        break;
    }
    // What the operator presses is no progress of the cell, but for a start.
    if (command.order != Order::start) last_progress_ = progress;
  }
}

void World::refill() {
  for (std::size_t k = 0; k < cell_.spots.size(); ++k) {
    for (int i = 0; i < cell_.spots[k].containers; ++i)
      spots_[k][static_cast<std::size_t>(i)].tin = Tin{cell_.spots[k].filled};
  }
  note(14, "operator", "the pallet is full again");
}

Process World::refill_later() {
  co_await sim_.wait(cell_.refill);
  if (state_ != State::refill) co_return;
  refill();
  note(2, "operator", "START");
  set_state(State::working);
}

bool World::any_container(bool pallets) const {
  for (std::size_t k = 0; k < cell_.spots.size(); ++k) {
    const Spot::Kind kind = cell_.spots[k].kind;
    if (kind != Spot::Kind::holder && !(pallets && kind == Spot::Kind::pallet)) continue;
    for (const Slot& slot : spots_[k])
      if (slot.tin || slot.reserved) return true;
  }
  return false;
}

void World::maybe_end() {
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

Picture World::picture() const {
  Picture out;
  out.time = sim_.now();
  for (const auto& belt : belts_)
    for (const OnBelt& item : belt->items) out.items.push_back(on_top(*belt, along(*belt, item), item.across));
  for (std::size_t k = 0; k < spots_.size(); ++k)
    for (std::size_t i = 0; i < spots_[k].size(); ++i)
      if (spots_[k][i].tin) out.containers.push_back(cell_.spots[k].slots[i]);
  for (const Arm& arm : arms_) out.hands.push_back(arm.hand);
  out.placed = out_.placed;
  out.missed = out_.missed;
  out.filled = out_.filled;
  out.emptied = out_.emptied;
  out.served = out_.served;
  return out;
}

void World::film() {
  double start = kInfinity, end = kInfinity;
  for (const Command& c : cell_.commands) {
    if (c.order == Order::start && !std::isfinite(start)) start = c.time;
    if (c.order == Order::stop && std::isfinite(start)) end = std::min(end, c.time);
  }
  end = std::min({end, start + kFilm, settings_.seconds});
  if (!(start < end)) return;
  filming_ = true;
  for (int k = 0; start + k * kFilmStep <= end; ++k) {
    sim_.run(start + k * kFilmStep);
    out_.pictures.push_back(picture());
    if (!out_.crowded.empty()) break;
  }
  filming_ = false;
}

Outcome World::finish() {
  out_.seconds = sim_.now();
  const double worked = working_time();
  for (std::size_t k = 0; k < cell_.sources.size(); ++k) {
    const Source& source = cell_.sources[k];
    if (held_since_[k]) out_.held[k] += worked - *held_since_[k];
    if (source.arrival != Source::Arrival::list) {
      const double left = static_cast<double>(source.limit) - fed_[k];
      out_.lost[k] = static_cast<int>(std::clamp(std::floor(source.rate * out_.held[k] + 1e-9), 0.0, left));
      continue;
    }
    const auto due = std::upper_bound(source.times.begin(), source.times.end(), sim_.now()) - source.times.begin();
    if (out_.held[k] > 0) out_.lost[k] += static_cast<int>(std::min<std::ptrdiff_t>(due, source.limit)) - fed_[k];
  }
  out_.working = worked;
  find_standstill();
  for (Arm& arm : arms_) {
    close(arm);
    MachineUse use;
    use.busy = arm.busy_time;
    use.stopped = arm.stopped;
    use.waiting.assign(arm.waiting.begin(), arm.waiting.end());
    use.intervals = std::move(arm.intervals);
    use.legs = std::move(arm.legs);
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

Outcome run(const Cell& cell, const Motions& motions, const RunSettings& settings) {
  return World(cell, motions, settings).run();
}

}  // namespace polypod::cell
