// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace polypod::cell {

void World::update_running(Belt& b) {
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

void World::update_belts() {
  for (auto& belt : belts_) update_running(*belt);
}

void World::put_on(Belt& b, double at, double across) {
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

OnBelt* World::find(Belt& b, int id) {
  for (OnBelt& item : b.items)
    if (item.id == id) return &item;
  return nullptr;
}

Process World::look(Belt& b, int id, double frame) {
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
  co_await sim_.wait(camera.delay);
  OnBelt* seen = find(b, id);
  if (seen == nullptr) co_return;
  seen->known = true;
  note(5, camera.name, "sees an item");
  changed_.notify();
}

Process World::run_belt(Belt& b) {
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

void World::pass_on(Belt& b, const OnBelt& item) {
  if (b.c->outfeed) {
    ++out_.left;
    went(b.c->name, "outside");
    note(0, b.c->name, "an item leaves the cell");
    changed_.notify();
    return;
  }
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

Process World::feed(std::size_t k) {
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
    held_since_[k] = working_time();
    while (!belt.running) co_await belt.changed.wait();
    out_.held[k] += working_time() - *held_since_[k];
    held_since_[k].reset();
    ++out_.fed;
    ++fed_[k];
    // What is on a list is late.
    if (source.arrival == Source::Arrival::list && out_.held[k] > 0 &&
        sim_.now() > source.times[static_cast<std::size_t>(n)] + 1e-9)
      ++out_.lost[k];
    note(0, source.name, "an item arrives");
    put_on(belt, source.at, random.uniform(source.across_low, source.across_high));
  }
}

}  // namespace polypod::cell
