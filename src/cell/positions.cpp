// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "positions.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>
#include <tuple>

#include "common.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::cell {
namespace {

using machine::JointVector;

/// What a machine carries: upright where it was taken.
struct Load {
  Vec3 axis_T = Vec3::Zero();               ///< from its bottom to its top, a unit vector in the tool frame
  double grip = 0, height = 0, radius = 0;  ///< m
};

void bound(Position& p) {
  Vec3 low = Vec3::Constant(kInfinity), high = -low;
  for (const Capsule& c : p.links) {
    for (const Vec3* v : {&c.from, &c.to}) {
      low = low.cwiseMin(*v - Vec3::Constant(c.radius));
      high = high.cwiseMax(*v + Vec3::Constant(c.radius));
    }
  }
  p.middle = (low + high) / 2;
  p.radius = (high - low).norm() / 2;
}

class Collector {
 public:
  Collector(const Cell& cell, const Motions& motions) : cell_(cell), motions_(motions) {
    out_.of.resize(cell.machines.size());
  }

  Positions run() {
    for (std::size_t t = 0; t < cell_.tasks.size(); ++t) {
      if (cell_.tasks[t].from_conveyor >= 0)
        collect_picks(t);
      else
        collect_moves(t);
      load_.reset();
      moved_ = {};
    }
    for (std::size_t m = 0; m < cell_.machines.size(); ++m)
      if (motions_.home[m].size() > 0) add_joints(m, cell_.tasks.size(), motions_.home[m], "");
    return std::move(out_);
  }

 private:
  void add(std::size_t m, std::size_t task, const Pose& X_MT, const JointVector& q, const std::string& zone) {
    if (out_.of[m].size() >= Positions::kMost) {
      out_.complete = false;
      return;
    }
    Position p;
    p.links = links(cell_.machines[m], X_MT, q);
    p.zone = zone;
    p.task = task;
    p.moved = moved_;
    p.near_spot = near_spot_;
    p.near_conveyor = near_conveyor_;
    if (load_) {
      Capsule c;
      const Pose X_CT = cell_.machines[m].X_CM * X_MT;
      c.from = X_CT * Vec3(-load_->grip * load_->axis_T);
      c.to = X_CT * Vec3((load_->height - load_->grip) * load_->axis_T);
      c.radius = load_->radius;
      c.tool = c.cargo = true;
      p.links.push_back(c);
    }
    bound(p);
    out_.of[m].push_back(std::move(p));
  }
  void add_joints(std::size_t m, std::size_t task, const JointVector& q, const std::string& zone) {
    const kinematics::ForwardResult f = kinematics::forward(cell_.machines[m].model, q);
    if (!f.poses.empty()) add(m, task, f.poses[0], q, zone);
  }

  /// A container in the tool of a machine that stands at a slot; an item that is taken from above.
  void carry_container(const Machine& machine, const Stand& s) {
    const Container& c = cell_.containers[0];
    load_ = Load{(machine.X_CM * s.X_at).R.transpose() * Vec3::UnitZ(), c.grip, c.height, c.diameter / 2};
  }
  void carry_item(const Machine& machine, const Mat3& R_MT) {
    const Item& i = cell_.items[0];
    load_ = Load{(machine.X_CM.R * R_MT).transpose() * Vec3::UnitZ(), i.height, i.height, i.diameter / 2};
  }

  /// How far the farthest link comes on a joint motion, m: the sum of chords.
  [[nodiscard]] double travel(const Machine& machine, const JointVector& from, const JointVector& to) const {
    constexpr int kChords = 6;
    std::vector<Capsule> last;
    double sum = 0;
    for (int k = 0; k <= kChords; ++k) {
      const JointVector q = from + (to - from) * (static_cast<double>(k) / kChords);
      const kinematics::ForwardResult f = kinematics::forward(machine.model, q);
      if (f.poses.empty()) continue;
      std::vector<Capsule> now = links(machine, f.poses[0], q);
      double most = 0;
      for (std::size_t i = 0; i < std::min(now.size(), last.size()); ++i)
        most = std::max({most, (now[i].from - last[i].from).norm(), (now[i].to - last[i].to).norm()});
      sum += most;
      last = std::move(now);
    }
    return sum;
  }

  /// The joint motions between two stands.
  void way(std::size_t m, std::size_t task, const JointVector& from, const JointVector& to, const std::string& zone) {
    const Machine& machine = cell_.machines[m];
    JointVector last = from;
    for (const JointVector& next : stops(machine, motions_.home[m], from, to)) {
      const int steps = std::clamp(static_cast<int>(std::ceil(travel(machine, last, next) / kStride)), 2, 200);
      for (int k = 1; k <= steps; ++k)
        add_joints(m, task, last + (next - last) * (static_cast<double>(k) / steps), zone);
      last = next;
    }
  }
  void down(std::size_t m, std::size_t task, int spot, const Stand& s, const std::string& zone) {
    const Spot& at = cell_.spots[static_cast<std::size_t>(spot)];
    const int steps = std::clamp(static_cast<int>(std::ceil(at.clearance / kStride)), 1, 20);
    near_spot_ = spot;
    for (int k = 0; k <= steps; ++k)
      add_joints(m, task, s.above + (s.joints - s.above) * (static_cast<double>(k) / steps), zone);
    near_spot_ = -1;
  }

  /// Slots that are judged: all of up to `most`, else as many evenly, with the first and the last.
  std::vector<std::size_t> some(std::size_t count, std::size_t most = 40) {
    std::vector<std::size_t> out;
    out_.complete = out_.complete && count <= most;
    for (std::size_t k = 0; k < std::min(count, most); ++k)
      out.push_back(count <= most ? k : k * (count - 1) / (most - 1));
    return out;
  }
  static constexpr std::size_t kMostOfAPair = 20;
  static constexpr double kStride = 0.030;  ///< m, between two positions

  void collect_moves(std::size_t t) {
    const Task& task = cell_.tasks[t];
    const auto m = static_cast<std::size_t>(task.machine);
    const Spot& target = cell_.spots[static_cast<std::size_t>(task.to)];
    const auto& stands = motions_.stands[m];
    const auto zone = [&](int spot) { return cell_.spots[static_cast<std::size_t>(spot)].zone; };
    const auto& from = stands[static_cast<std::size_t>(task.from)];
    const auto& to = stands[static_cast<std::size_t>(task.to)];
    const JointVector& home = motions_.home[m];
    const std::string held = zone(task.from);  // until it has arrived elsewhere
    std::set<std::size_t> left;                // slots from which it was followed further
    const std::vector<std::size_t> sources = some(from.size(), kMostOfAPair);
    for (const std::size_t k : sources) {
      if (!from[k].ok) continue;
      const Moved takes{Moved::How::takes, task.from, k, true}, taken{Moved::How::takes, task.from, k, false};
      load_.reset();
      moved_ = {takes};
      way(m, t, home, from[k].above, held);
      down(m, t, task.from, from[k], held);
      carry_container(cell_.machines[m], from[k]);
      moved_ = {taken};
      down(m, t, task.from, from[k], held);  // and up again
      JointVector at = from[k].above;
      bool poured = false;
      if (task.via >= 0) {
        const Stand& via = stands[static_cast<std::size_t>(task.via)][0];
        if (via.ok) {
          way(m, t, at, via.above, zone(task.via).empty() ? held : zone(task.via));
          down(m, t, task.via, via, zone(task.via));
          at = via.above;
          poured = true;
        }
      }
      for (const std::size_t j : some(to.size(), kMostOfAPair)) {
        if (!to[j].ok || (task.to == task.from && j != k)) continue;
        // From where it pours the way is the same whatever slot it came from.
        if (poured && task.to != task.from && k != sources.front() && k != sources.back()) continue;
        const Moved puts{Moved::How::puts, task.to, j, false}, put{Moved::How::puts, task.to, j, true};
        carry_container(cell_.machines[m], from[k]);
        moved_ = {taken, puts};
        way(m, t, at, to[j].above, !target.zone.empty() ? target.zone : task.via < 0 ? held : "");
        down(m, t, task.to, to[j], target.zone);
        if (!left.insert(j).second) continue;
        load_.reset();
        moved_ = {put};
        down(m, t, task.to, to[j], target.zone);
        go_on(t, j);
      }
    }
  }

  /// From a slot home, and to where a task begins that may follow.
  void go_on(std::size_t t, std::size_t j) {
    const Task& task = cell_.tasks[t];
    const auto m = static_cast<std::size_t>(task.machine);
    const auto& stands = motions_.stands[m];
    const Stand& at = stands[static_cast<std::size_t>(task.to)][j];
    const std::string& held = cell_.spots[static_cast<std::size_t>(task.to)].zone;
    const Moved put{Moved::How::puts, task.to, j, true};
    way(m, t, at.above, motions_.home[m], held);
    for (const Task& next : cell_.tasks) {
      if (next.machine != task.machine || next.from < 0) continue;
      if (!(next.working && task.working) && !(next.ending && task.ending)) continue;
      const std::vector<Stand>& begins = stands[static_cast<std::size_t>(next.from)];
      for (const std::size_t k : some(begins.size(), kMostOfAPair)) {
        if (!begins[k].ok || !followed_.insert({task.machine, task.to, j, next.from, k}).second) continue;
        moved_ = {put, Moved{Moved::How::takes, next.from, k, true}};
        way(m, t, at.above, begins[k].above,
            !held.empty() ? held : cell_.spots[static_cast<std::size_t>(next.from)].zone);
      }
    }
  }

  void collect_picks(std::size_t t) {
    const Task& task = cell_.tasks[t];
    const Machine& machine = cell_.machines[static_cast<std::size_t>(task.machine)];
    const Spot& target = cell_.spots[static_cast<std::size_t>(task.to)];
    const Conveyor& belt = cell_.conveyors[static_cast<std::size_t>(task.from_conveyor)];
    const PickTable& table = motions_.picks[t];
    for (const std::size_t slot : some(target.slots.size())) {
      const Vec3 put(target.slots[slot].x(), target.slots[slot].y(), task.release);
      moved_ = {Moved{Moved::How::fills, task.to, slot, true}};
      load_.reset();
      if (has_cycles(machine)) cycle(t, put, machine.home, true);
      for (const double along : {table.low, (table.low + table.high) / 2, table.high}) {
        for (const double across : {table.across_low, table.across_high}) {
          Vec3 pick = belt.point(along, across);
          pick.z() += cell_.items[0].height;
          if (has_cycles(machine)) {
            carry_item(machine, Mat3::Identity());
            cycle(t, pick, put, false);
          } else {
            pick_with_joints(t, pick, put);
          }
        }
      }
    }
  }

  /// A planned cycle of a delta: from the belt to a slot, or from a slot home.
  void cycle(std::size_t t, const Vec3& from, const Vec3& to, bool from_slot) {
    const Task& task = cell_.tasks[t];
    const auto m = static_cast<std::size_t>(task.machine);
    const Machine& machine = cell_.machines[m];
    const std::string& zone = cell_.spots[static_cast<std::size_t>(task.to)].zone;
    const Pose X_MC = machine.X_CM.inverse();
    constexpr int kSteps = 20;
    const motion::Cycle cycle{X_MC * from, X_MC * to, machine.lift, machine.blend};
    const Result<motion::Plan> plan = motion::plan(machine.model, cycle, limits_of(machine));
    if (!plan) {
      out_.complete = false;
      return;
    }
    for (int k = 0; k <= kSteps; ++k) {
      Pose X;
      X.p = plan->tool(cycle, plan->time * k / kSteps).p;
      const kinematics::InverseResult q = kinematics::inverse(machine.model, X);
      if (q.reachable() == nullptr) {
        out_.complete = false;
        continue;
      }
      const bool begin = 3 * k<kSteps, end = 3 * k> 2 * kSteps;
      near_conveyor_ = begin && !from_slot ? task.from_conveyor : -1;
      near_spot_ = (from_slot ? begin : end) ? task.to : -1;
      // Before it leaves the belt it holds no zone.
      add(m, t, X, q.reachable()->joints, k == 0 && !from_slot ? "" : zone);
    }
    near_conveyor_ = near_spot_ = -1;
  }

  void pick_with_joints(std::size_t t, const Vec3& pick, const Vec3& put) {
    const Task& task = cell_.tasks[t];
    const auto m = static_cast<std::size_t>(task.machine);
    const Machine& machine = cell_.machines[m];
    const Spot& target = cell_.spots[static_cast<std::size_t>(task.to)];
    constexpr double kAway = std::numeric_limits<double>::quiet_NaN(), kDown = std::numbers::pi / 2;
    const Stand at_belt = stand_at(machine, motions_.home[m], pick, kDown, kAway, 0, machine.lift),
                at_slot = stand_at(machine, motions_.home[m], put, kDown, target.heading, 0, machine.lift);
    if (!at_belt.ok || !at_slot.ok) {
      out_.complete = false;
      return;
    }
    const auto straight = [&](const Stand& s, const std::string& zone) {
      const int steps = std::clamp(static_cast<int>(std::ceil(machine.lift / kStride)), 1, 20);
      for (int k = 0; k <= steps; ++k)
        add_joints(m, t, s.above + (s.joints - s.above) * (static_cast<double>(k) / steps), zone);
    };
    load_.reset();
    way(m, t, motions_.home[m], at_belt.above, "");
    carry_item(machine, at_belt.X_at.R);
    near_conveyor_ = task.from_conveyor;
    straight(at_belt, "");
    near_conveyor_ = -1;
    way(m, t, at_belt.above, at_slot.above, target.zone);
    near_spot_ = task.to;
    straight(at_slot, target.zone);
    near_spot_ = -1;
    load_.reset();
    way(m, t, at_slot.above, motions_.home[m], target.zone);
  }

  const Cell& cell_;
  const Motions& motions_;
  // Of the positions that are added next.
  std::optional<Load> load_;
  std::array<Moved, 3> moved_;
  int near_spot_ = -1, near_conveyor_ = -1;
  std::set<std::tuple<int, int, std::size_t, int, std::size_t>> followed_;
  Positions out_;
};

}  // namespace

Positions positions(const Cell& cell, const Motions& motions) {
  return Collector(cell, motions).run();
}

}  // namespace polypod::cell
