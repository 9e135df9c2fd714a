// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace polypod::cell {

double World::machine_factor(std::size_t m) const {
  return m < settings_.machine_time.size() ? settings_.machine_time[m] : 1;
}

bool World::matches(const Task& task, const Tin& tin) const {
  const int capacity = cell_.containers[0].capacity;
  if (tin.reserved || tin.pending > 0) return false;
  if (task.which == Task::Which::full) return tin.count >= capacity;
  if (task.which == Task::Which::empty) return tin.count == 0;
  return true;
}

std::optional<std::size_t> World::room_in(int spot) const {
  std::optional<std::size_t> best;
  const std::vector<Slot>& slots = spots_[static_cast<std::size_t>(spot)];
  for (std::size_t k = 0; k < slots.size(); ++k) {
    if (!slots[k].tin || slots[k].tin->reserved) continue;
    if (slots[k].tin->count + slots[k].tin->pending >= cell_.containers[0].capacity) continue;
    if (!best || slots[k].tin->count > slots[*best].tin->count) best = k;
  }
  return best;
}

double World::way_to_belt(std::size_t task, const Where& where, double at, double across) const {
  const PickTable& table = motions_.picks[task];
  if (where.kind == Where::Kind::belt) {  // after a grip that failed: as long as by the first slot
    return std::max(table.time(0, at, across), table.time(0, where.along, where.across));
  }
  const std::size_t row = where.kind == Where::Kind::home ? table.times.size() - 1 : where.slot;
  return table.time(std::min(row, table.times.size() - 1), at, across);
}

double World::room_of(const Belt& b) const {
  double room = kInfinity;
  if (b.c->sensor >= 0)
    for (const OnBelt& other : b.items) room = std::min(room, std::max(0.0, b.c->sensor - along(b, other)));
  return room;
}

World::Meeting World::meet(std::size_t t, std::size_t m, const Where& where, const Belt& b, const OnBelt& item,
                           double start, double factor, double room) const {
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

std::pair<int, double> World::greedy(std::size_t t, std::size_t m, const Belt& b,
                                     const std::vector<const OnBelt*>& items, int without, double start, Where where,
                                     double factor, double room) const {
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

bool World::choose_item(std::size_t m, std::size_t t, Choice& out) {
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

Choice World::choose(std::size_t m) {
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

}  // namespace polypod::cell
