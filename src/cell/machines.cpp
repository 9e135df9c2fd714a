// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace polypod::cell {

void World::act(std::size_t m, const std::string& what, bool busy) {
  Arm& arm = arms_[m];
  if (arm.activity == what && arm.active == busy) return;
  close(arm);
  arm.activity = what;
  arm.active = busy;
  arm.begun = sim_.now();
}

void World::close(Arm& arm) {
  const double passed = sim_.now() - arm.since;
  if (halted_)
    arm.stopped += passed;
  else if (arm.active)
    arm.busy_time += passed;
  else if (passed > 0)
    arm.waiting[arm.activity.starts_with("waits: ") ? arm.activity.substr(7) : arm.activity] += passed;
  if (settings_.record && passed > 0)
    arm.intervals.push_back({arm.since, sim_.now(), halted_ ? "stopped" : arm.activity, arm.active && !halted_});
  arm.since = sim_.now();
}

Process World::work(std::size_t m, double dt) {
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

Process World::take_zone(std::size_t m, std::string zone) {
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

void World::leave_zone(std::size_t m) {
  Arm& arm = arms_[m];
  if (arm.zone.empty()) return;
  zones_.at(arm.zone)->give(cell_.machines[m].name);
  arm.zone.clear();
}

Process World::run_machine(std::size_t m) {
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

Process World::go_home(std::size_t m) {
  Arm& arm = arms_[m];
  arm.busy = true;
  act(m, "to its place of waiting", true);
  double time = 0;
  if (arm.where.kind == Where::Kind::slot && last_pick_.contains(m)) {
    time = motions_.picks[last_pick_.at(m)].home_times[arm.where.slot];
  } else if (arm.where.kind == Where::Kind::belt && last_pick_.contains(m)) {
    const PickTable& table = motions_.picks[last_pick_.at(m)];
    time = table.time(table.times.size() - 1, arm.where.along, arm.where.across);
  }
  if (arm.where.kind == Where::Kind::home) {
    for (const machine::JointVector& stop : stops(cell_.machines[m], motions_.home[m], arm.joints, motions_.home[m])) {
      const double part = joint_time(cell_.machines[m], arm.joints, stop);
      leg(m, part, stop);
      co_await work(m, part);
      arm.joints = stop;
    }
  } else {
    leg(m, time, motions_.home[m]);
    co_await work(m, time);
  }
  arm.where = {};
  arm.joints = motions_.home[m];
  arm.at_home = true;
  leave_zone(m);
}

Process World::pick(std::size_t m, std::size_t t, Choice choice) {
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
  leg(m, choice.travel / machine_factor(m), on_top(b, expected, across), machine.lift);
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
  leg(m, machine.grip, on_top(b, along(b, *item) + (b.running ? b.speed * machine.grip : 0), across), 0);
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
  arm.hand = Picture::Hand::item;
  co_await take_zone(m, spot.zone);
  const Vec3& there = spot.slots[*slot];
  leg(m, motions_.picks[t].time(*slot, at, across), {there.x(), there.y(), task.release}, machine.lift);
  co_await work(m, motions_.picks[t].time(*slot, at, across) + machine.release);
  arm.hand = Picture::Hand::empty;
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

Process World::go(std::size_t m, std::string zone, machine::JointVector to, bool keeps_zone) {
  Arm& arm = arms_[m];
  const Machine& machine = cell_.machines[m];
  if (!zone.empty() && !arm.zone.empty() && zone != arm.zone && !keeps_zone) {
    for (const machine::JointVector& stop : stops(machine, motions_.home[m], arm.joints, motions_.home[m])) {
      const double time = joint_time(machine, arm.joints, stop);
      leg(m, time, stop);
      co_await work(m, time);
      arm.joints = stop;
    }
    leave_zone(m);
  }
  if (!zone.empty()) co_await take_zone(m, zone);
  for (const machine::JointVector& stop : stops(machine, motions_.home[m], arm.joints, to)) {
    const double time = joint_time(machine, arm.joints, stop);
    leg(m, time, stop);
    co_await work(m, time);
    arm.joints = stop;
  }
  if (zone.empty()) leave_zone(m);
}

const Stand& World::stand(std::size_t m, int spot, std::size_t slot) const {
  const std::vector<Stand>& all = motions_.stands[m][static_cast<std::size_t>(spot)];
  return all[std::min(slot, all.size() - 1)];
}

Process World::carry(std::size_t m, std::size_t t, Choice choice) {
  Arm& arm = arms_[m];
  const Task& task = cell_.tasks[t];
  const Machine& machine = cell_.machines[m];
  const Spot &source = cell_.spots[static_cast<std::size_t>(task.from)],
             &target = cell_.spots[static_cast<std::size_t>(task.to)];
  std::vector<Slot>&from = spots_[static_cast<std::size_t>(task.from)], &to = spots_[static_cast<std::size_t>(task.to)];
  from[choice.from_slot].tin->reserved = true;
  if (task.to != task.from) to[choice.to_slot].reserved = true;
  if (task.on_serve) --serve_;
  act(m, task.name, true);
  note(task.step, machine.name, task.name + ": begins", fmt::format("{} slot {}", source.name, choice.from_slot + 1));
  had_containers_ = true;
  const Stand& take = stand(m, task.from, choice.from_slot);
  co_await go(m, source.zone, take.above, task.keeps_zone);
  leg(m, take.straight, take.joints);
  co_await work(m, take.straight + machine.grip);
  arm.hand = Picture::Hand::container;
  Tin tin = *from[choice.from_slot].tin;
  from[choice.from_slot].tin.reset();
  if (task.to == task.from) from[choice.from_slot].reserved = true;
  leg(m, take.straight, take.above);
  co_await work(m, take.straight);
  changed_.notify();
  went(source.name, machine.name);
  if (task.via >= 0) {
    const Spot& pour = cell_.spots[static_cast<std::size_t>(task.via)];
    const Stand& there = stand(m, task.via, 0);
    co_await go(m, pour.zone, there.above, task.keeps_zone);
    leg(m, there.straight, there.joints);
    co_await work(m, there.straight);
    Belt& belt = *belts_[static_cast<std::size_t>(pour.conveyor)];
    const int count = tin.count;
    for (int k = 0; k < count; ++k) {
      co_await work(m, pour.time / count);
      put_on(belt, pours_.uniform(pour.along_low, pour.along_high), pours_.uniform(pour.across_low, pour.across_high));
    }
    if (count == 0) co_await work(m, pour.time);
    tin.count = 0;
    ++out_.emptied;
    went(machine.name, pour.name);
    went(pour.name, belt.c->name, count);
    note(task.step, machine.name, "a container is emptied", fmt::format("{} items on {}", count, belt.c->name));
    leg(m, there.straight, there.above);
    co_await work(m, there.straight);
  }
  const Stand& put = stand(m, task.to, choice.to_slot);
  co_await go(m, target.zone, put.above, task.keeps_zone);
  leg(m, put.straight, put.joints);
  co_await work(m, put.straight + machine.release);
  arm.hand = Picture::Hand::empty;
  tin.reserved = false;
  to[choice.to_slot].tin = tin;
  to[choice.to_slot].reserved = false;
  leg(m, put.straight, put.above);
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

Process World::taken(std::size_t spot, std::size_t slot) {
  co_await sim_.wait(cell_.spots[spot].time);
  spots_[spot][slot].tin.reset();
  note(8, "visitor", "takes a container", cell_.spots[spot].name);
  changed_.notify();
}

}  // namespace polypod::cell
