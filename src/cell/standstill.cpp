// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace polypod::cell {

std::vector<Need> World::needs(std::size_t t) const {
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

void World::find_standstill() {
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
    return std::any_of(need.who.begin(), need.who.end(), [&](const std::string& who) { return !stuck.contains(who); });
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
  // Work that has come to its end is no deadlock: what was to be filled is full, and nothing takes anything away there.
  for (std::size_t t = 0; t < cell_.tasks.size() && !circle; ++t) {
    const Task& task = cell_.tasks[t];
    if (task.from_conveyor >= 0 || task.to == task.from) continue;
    if (!stuck.contains(cell_.machines[static_cast<std::size_t>(task.machine)].name)) continue;
    const std::vector<Slot>& slots = spots_[static_cast<std::size_t>(task.to)];
    const bool full = std::all_of(slots.begin(), slots.end(), [](const Slot& s) { return s.tin.has_value(); });
    const Spot& spot = cell_.spots[static_cast<std::size_t>(task.to)];
    const bool taken =
        spot.kind == Spot::Kind::opening ||
        std::any_of(cell_.tasks.begin(), cell_.tasks.end(), [&](const Task& o) { return o.from == task.to; });
    // Something waits to be brought there.
    bool brought = false;
    for (const Slot& slot : spots_[static_cast<std::size_t>(task.from)])
      brought |= slot.tin && matches(task, *slot.tin);
    if (full && !taken && brought) out_.full = spot.name;
  }
  double since = 0;
  for (std::size_t m = 0; m < arms_.size(); ++m)
    if (stuck.contains(cell_.machines[m].name)) since = std::max(since, arms_[m].begun);
  out_.stands_since = sim_.idle() ? std::min(since, last_progress_) : since;
}

}  // namespace polypod::cell
