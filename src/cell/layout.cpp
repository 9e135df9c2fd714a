// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/layout.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "common.hpp"
#include "polypod/bodies/shape.hpp"
#include "polypod/core/golden_section.hpp"
#include "polypod/core/units.hpp"
#include "polypod/geometry/segments.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::cell {
namespace {

using machine::JointVector;

Vec3 into(const Solid& s, const Vec3& p) {
  const Vec3 d = p - s.middle;
  const double c = std::cos(s.turn), n = std::sin(s.turn);
  return {c * d.x() + n * d.y(), -n * d.x() + c * d.y(), d.z()};
}

/// One position of a machine on its way.
struct Position {
  std::vector<Capsule> links;
  Vec3 middle = Vec3::Zero();
  double radius = 0;  ///< of a ball about `middle` that holds all links
  std::string zone;   ///< that it holds there
  std::size_t task = 0;
};

/// What a machine carries: upright where it was taken.
struct Load {
  Vec3 axis_T = Vec3::Zero();               ///< from its bottom to its top, a unit vector in the tool frame
  double grip = 0, height = 0, radius = 0;  ///< m
};

bodies::Shape shape_of(const Capsule& c) {
  return c.cargo ? bodies::cylinder(c.from, c.to, c.radius) : bodies::capsule(c.from, c.to, c.radius);
}
/// Whether two bodies touch: no plane was found between them, and points of both that are less than a micrometre apart.
bool touch(const bodies::Shape& a, const Pose& X_CA, const bodies::Shape& b, const Pose& X_CB) {
  constexpr double kSame = 1e-6;
  const bodies::Bracket d = bodies::distance(a, X_CA, b, X_CB, kSame);
  return d.high < kSame;
}

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

class Judge {
 public:
  Judge(const Cell& cell, const Motions& motions) : cell_(cell), motions_(motions), solids_(solids(cell)) {}

  Layout run() {
    out_.least_distance = kInfinity;
    at_rest();
    doors();
    for (std::size_t t = 0; t < cell_.tasks.size(); ++t) collect(t);
    homes();
    against_bodies();
    items_on_belts();
    against_each_other();
    for (const auto& list : positions_) {
      out_.positions += static_cast<int>(list.size());
      for (const Position& p : list) {
        for (const Capsule& c : p.links) {
          if (c.mount || c.cargo) continue;
          const std::string& name = cell_.machines[static_cast<std::size_t>(&list - positions_.data())].name;
          constexpr double kPiece = 0.1;  // m: what lies at one height of the tables of distances
          const int pieces = std::max(1, static_cast<int>(std::ceil((c.to - c.from).norm() / kPiece)));
          for (int k = 0; k < pieces; ++k) {
            const auto at = [&](int i) { return Vec3(c.from + (c.to - c.from) * (static_cast<double>(i) / pieces)); };
            out_.swept.push_back({at(k), c.radius, name, at(k + 1)});
          }
        }
      }
    }
    const auto [low, high] = extent(cell_);
    out_.low = low;
    out_.high = high;
    out_.floor_area = (high.x() - low.x()) * (high.y() - low.y());
    return std::move(out_);
  }

 private:
  void at_rest() {
    constexpr double kTouch = 1e-6;  // m: what stands on something touches it
    for (std::size_t i = 0; i < solids_.size(); ++i) {
      for (std::size_t k = i + 1; k < solids_.size(); ++k) {
        const double depth = overlap(solids_[i], solids_[k]);
        if (depth <= kTouch) continue;
        // A base belongs to its machine's place, a holder may stand in its stand: only what is not one body is judged.
        out_.problems.push_back({"collision", fmt::format("{} and {} reach {:.1f} mm into each other", solids_[i].name,
                                                          solids_[k].name, units::to_mm(depth))});
      }
    }
  }

  void doors() {
    if (!(cell_.door > 0)) return;
    for (const Solid& s : solids_) {
      if (!s.module) continue;
      const double least = std::min(s.size.x(), s.size.y());
      if (least <= cell_.door + 1e-9) continue;
      out_.problems.push_back({"door", fmt::format("{} is {:.0f} mm wide and does not pass a door of {:.0f} mm", s.name,
                                                   units::to_mm(least), units::to_mm(cell_.door))});
    }
  }

  void add(std::size_t m, std::size_t task, const Pose& X_MT, const JointVector& q, const std::string& zone) {
    Position p;
    p.links = links(cell_.machines[m], X_MT, q);
    p.zone = zone;
    p.task = task;
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
    positions_[m].push_back(std::move(p));
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

  /// A joint motion between two stands.
  void way(std::size_t m, std::size_t task, const JointVector& from, const JointVector& to, const std::string& zone) {
    constexpr int kSteps = 12;
    for (int k = 1; k <= kSteps; ++k) add_joints(m, task, from + (to - from) * (static_cast<double>(k) / kSteps), zone);
  }
  void down(std::size_t m, std::size_t task, const Stand& s, const std::string& zone) {
    constexpr int kSteps = 3;
    for (int k = 0; k <= kSteps; ++k)
      add_joints(m, task, s.above + (s.joints - s.above) * (static_cast<double>(k) / kSteps), zone);
  }

  /// Slots that are judged: all of up to 40, else as many evenly, with the first and the last.
  static std::vector<std::size_t> some(std::size_t count) {
    constexpr std::size_t kMost = 40;
    std::vector<std::size_t> out;
    for (std::size_t k = 0; k < std::min(count, kMost); ++k)
      out.push_back(count <= kMost ? k : k * (count - 1) / (kMost - 1));
    return out;
  }

  void collect(std::size_t t) {
    const Task& task = cell_.tasks[t];
    const auto m = static_cast<std::size_t>(task.machine);
    const Spot& target = cell_.spots[static_cast<std::size_t>(task.to)];
    if (task.from_conveyor >= 0) {
      collect_picks(t);
      return;
    }
    const auto& stands = motions_.stands[m];
    const auto zone = [&](int spot) { return cell_.spots[static_cast<std::size_t>(spot)].zone; };
    const auto& from = stands[static_cast<std::size_t>(task.from)];
    const auto& to = stands[static_cast<std::size_t>(task.to)];
    const JointVector& home = motions_.home[m];
    for (const std::size_t k : some(from.size())) {
      if (!from[k].ok) continue;
      load_.reset();
      way(m, t, home, from[k].above, zone(task.from));
      down(m, t, from[k], zone(task.from));
      carry_container(cell_.machines[m], from[k]);
      down(m, t, from[k], zone(task.from));  // and up again
      std::vector<const Stand*> next;
      if (task.via >= 0) next.push_back(&stands[static_cast<std::size_t>(task.via)][0]);
      JointVector at = from[k].above;
      const std::string held = zone(task.from);  // until it has arrived elsewhere
      for (const Stand* via : next) {
        if (!via->ok) continue;
        way(m, t, at, via->above, zone(task.via).empty() ? held : zone(task.via));
        down(m, t, *via, zone(task.via));
        at = via->above;
      }
      for (const std::size_t j : some(to.size())) {
        if (!to[j].ok || (task.to == task.from && j != k)) continue;
        carry_container(cell_.machines[m], from[k]);
        way(m, t, at, to[j].above, !target.zone.empty() ? target.zone : task.via < 0 ? held : "");
        if (k > 0) continue;
        down(m, t, to[j], target.zone);
        // On to where another task begins.
        load_.reset();
        for (const Task& next_task : cell_.tasks) {
          if (next_task.machine != task.machine || next_task.from < 0) continue;
          const std::vector<Stand>& begins = stands[static_cast<std::size_t>(next_task.from)];
          for (const Stand* s : {&begins.front(), &begins.back()})
            if (s->ok) way(m, t, to[j].above, s->above, !target.zone.empty() ? target.zone : zone(next_task.from));
        }
      }
    }
    leave();
  }

  void leave() { load_.reset(); }

  void collect_picks(std::size_t t) {
    const Task& task = cell_.tasks[t];
    const auto m = static_cast<std::size_t>(task.machine);
    const Machine& machine = cell_.machines[m];
    const Spot& target = cell_.spots[static_cast<std::size_t>(task.to)];
    const Conveyor& belt = cell_.conveyors[static_cast<std::size_t>(task.from_conveyor)];
    const PickTable& table = motions_.picks[t];
    const Pose X_MC = machine.X_CM.inverse();
    constexpr int kSteps = 14;
    for (const double along : {table.low, (table.low + table.high) / 2, table.high}) {
      for (const double across : {table.across_low, table.across_high}) {
        Vec3 pick = belt.point(along, across);
        pick.z() += cell_.items[0].height;
        for (const std::size_t k_slot : some(target.slots.size())) {
          const Vec3& slot = target.slots[k_slot];
          const Vec3 put(slot.x(), slot.y(), task.release);
          if (is_delta(machine)) {
            const motion::Cycle cycle{X_MC * pick, X_MC * put, machine.lift, machine.blend};
            const Result<motion::Plan> plan = motion::plan(machine.model, cycle, limits_of(machine));
            if (!plan) continue;
            carry_item(machine, Mat3::Identity());
            for (int k = 0; k <= kSteps; ++k) {
              Pose X;
              X.p = plan->tool(cycle, plan->time * k / kSteps).p;
              const kinematics::InverseResult q = kinematics::inverse(machine.model, X);
              if (q.reachable() == nullptr) continue;
              // Before it leaves the belt it holds no zone.
              add(m, t, X, q.reachable()->joints, k == 0 ? "" : target.zone);
            }
          } else {
            for (const Vec3& p : {pick, put}) {
              const Vec3 d = p - machine.X_CM.p;
              const Pose X = in_machine(machine, tool_pose(p, 1.5707963267948966, std::atan2(d.y(), d.x()), 0));
              const kinematics::InverseResult q = kinematics::inverse_near(machine.model, X, motions_.home[m]);
              if (q.reachable() == nullptr) continue;
              const bool at_belt = &p == &pick;
              carry_item(machine, X.R);
              add(m, t, X, q.reachable()->joints, at_belt ? "" : target.zone);
              way(m, t, motions_.home[m], q.reachable()->joints, target.zone);
            }
          }
        }
      }
    }
    leave();
  }

  void homes() {
    for (std::size_t m = 0; m < cell_.machines.size(); ++m) {
      if (motions_.home[m].size() > 0) add_joints(m, cell_.tasks.size(), motions_.home[m], "");
    }
  }

  /// Whether the tool of a task may come near to a solid.
  [[nodiscard]] bool works_at(std::size_t task, const std::string& solid) const {
    if (task >= cell_.tasks.size()) return false;
    const Task& t = cell_.tasks[task];
    if (t.from_conveyor >= 0 && cell_.conveyors[static_cast<std::size_t>(t.from_conveyor)].name == solid) return true;
    for (const int spot : {t.from, t.via, t.to}) {
      if (spot < 0) continue;
      const Spot& s = cell_.spots[static_cast<std::size_t>(spot)];
      if (s.name == solid || (s.conveyor >= 0 && cell_.conveyors[static_cast<std::size_t>(s.conveyor)].name == solid))
        return true;
    }
    return false;
  }
  [[nodiscard]] std::string called(std::size_t m, std::size_t task) const {
    return task < cell_.tasks.size() ? fmt::format("{} ({})", cell_.machines[m].name, cell_.tasks[task].name)
                                     : fmt::format("{} (home)", cell_.machines[m].name);
  }

  void against_bodies() {
    std::set<std::pair<std::string, std::string>> said;
    for (std::size_t m = 0; m < positions_.size(); ++m) {
      for (const Position& p : positions_[m]) {
        for (const Solid& s : solids_) {
          const double far = (p.middle - s.middle).norm() - p.radius - s.size.norm() / 2;
          if (far > std::min(out_.least_distance, 1.0)) continue;
          const bool mine = works_at(p.task, s.name);
          for (const Capsule& c : p.links) {
            if (c.mount || c.cargo || (c.tool && mine)) continue;
            const double d = distance(c.from, c.to, s) - c.radius;
            out_.least_distance = std::min(out_.least_distance, d);
            if (d >= 0 || !said.insert({called(m, p.task), s.name}).second) continue;
            out_.problems.push_back(
                {"collision", fmt::format("{} comes {:.0f} mm into {} near {}", called(m, p.task), -units::to_mm(d),
                                          s.name, place_text((c.from + c.to) / 2))});
          }
        }
      }
    }
  }

  /// The layer of items on a belt, over all of its width: thin, and where a task takes items no obstacle.
  [[nodiscard]] std::vector<Solid> layers() const {
    std::vector<Solid> out;
    for (std::size_t c = 0; c < cell_.conveyors.size(); ++c) {
      const Conveyor& belt = cell_.conveyors[c];
      if (cell_.items.empty() || !across_range(cell_, static_cast<int>(c))) continue;
      Vec3 middle = belt.point(belt.length / 2, 0);
      middle.z() += cell_.items[0].height / 2;
      out.push_back(
          {belt.name, "items", middle, {belt.length, belt.width, cell_.items[0].height}, belt.heading, false});
    }
    return out;
  }

  void items_on_belts() {
    const std::vector<Solid> solid = layers();
    std::vector<bodies::Shape> shapes;
    std::vector<Pose> poses;
    for (const Solid& s : solid) {
      shapes.push_back(bodies::box(-s.size / 2, s.size / 2));
      Pose X;
      X.R = Eigen::AngleAxisd(s.turn, Vec3::UnitZ()).toRotationMatrix();
      X.p = s.middle;
      poses.push_back(X);
    }
    std::set<std::array<std::string, 3>> said;
    for (std::size_t m = 0; m < positions_.size(); ++m) {
      for (const Position& p : positions_[m]) {
        const auto report = [&](const Capsule& c, const std::string& what) {
          const std::string mover = called(m, p.task);
          if (!said.insert({mover, what, ""}).second) return;
          out_.problems.push_back(
              {"collision", fmt::format("{} reaches into {} near {}", mover, what, place_text((c.from + c.to) / 2))});
        };
        for (std::size_t k = 0; k < solid.size(); ++k) {
          if (works_at(p.task, solid[k].name)) continue;
          if ((p.middle - solid[k].middle).norm() > p.radius + solid[k].size.norm() / 2) continue;
          for (const Capsule& c : p.links) {
            if (c.mount || c.cargo) continue;
            if (touch(shape_of(c), Pose{}, shapes[k], poses[k])) report(c, fmt::format("items on {}", solid[k].name));
          }
        }
      }
    }
  }

  void against_each_other() {
    for (std::size_t m = 0; m < positions_.size(); ++m) {
      for (std::size_t o = m + 1; o < positions_.size(); ++o) {
        std::map<std::tuple<std::size_t, std::size_t, std::string>, Conflict> worst;
        for (const Position& p : positions_[m]) {
          for (const Position& q : positions_[o]) {
            if ((p.middle - q.middle).norm() > p.radius + q.radius + cell_.clearance) continue;
            const bool together = !p.zone.empty() && p.zone == q.zone;
            const auto key = std::tuple{p.task, q.task, together ? p.zone : std::string()};
            auto found = worst.find(key);
            double limit = found == worst.end() ? cell_.clearance : found->second.distance;
            for (const Capsule& a : p.links) {
              for (const Capsule& b : q.links) {
                if (!nearer_than(a.from, a.to, b.from, b.to, limit + a.radius + b.radius)) continue;
                const double d = a.cargo || b.cargo
                                     ? bodies::distance(shape_of(a), Pose{}, shape_of(b), Pose{}, limit).high
                                     : segment_distance(a.from, a.to, b.from, b.to) - a.radius - b.radius;
                if (d >= limit) continue;
                limit = d;
                worst[key] = {called(m, p.task), called(o, q.task), d, (a.from + a.to + b.from + b.to) / 4,
                              together ? p.zone : ""};
              }
            }
          }
        }
        for (const auto& [key, conflict] : worst) {
          out_.conflicts.push_back(conflict);
          if (!conflict.zone.empty()) continue;
          out_.problems.push_back({"collision", fmt::format("{} and {} come to {:.0f} mm of each other near {}, and no "
                                                            "interlock keeps them apart: give the places a zone",
                                                            conflict.first, conflict.second,
                                                            units::to_mm(conflict.distance), place_text(conflict.at))});
        }
      }
    }
  }

  const Cell& cell_;
  const Motions& motions_;
  std::vector<Solid> solids_;
  std::optional<Load> load_;  ///< of the positions that are added next
  std::vector<std::vector<Position>> positions_{cell_.machines.size()};
  Layout out_;
};

}  // namespace

std::vector<Vec3> Solid::corners() const {
  std::vector<Vec3> out;
  const double c = std::cos(turn), n = std::sin(turn);
  for (const int z : {-1, 1}) {
    for (const auto& [x, y] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
      const double dx = x * size.x() / 2, dy = y * size.y() / 2;
      out.push_back(middle + Vec3(c * dx - n * dy, n * dx + c * dy, z * size.z() / 2));
    }
  }
  return out;
}

std::vector<Solid> solids(const Cell& cell) {
  std::vector<Solid> out;
  for (const Conveyor& c : cell.conveyors) {
    Vec3 middle = c.point(c.length / 2, 0);
    middle.z() -= c.depth / 2;
    out.push_back({c.name, "conveyor", middle, {c.length, c.frame_width, c.depth}, c.heading, false});
  }
  for (const Spot& s : cell.spots)
    if ((s.size.array() > 0).all()) out.push_back({s.name, name_of(s.kind), s.middle, s.size, s.turn, false});
  for (const Body& b : cell.bodies) out.push_back({b.name, b.kind, b.middle, b.size, b.turn, b.module});
  return out;
}

std::vector<StandingContainer> standing_containers(const Cell& cell) {
  std::vector<StandingContainer> out;
  if (cell.containers.empty()) return out;
  for (std::size_t s = 0; s < cell.spots.size(); ++s) {
    if (cell.spots[s].kind == Spot::Kind::pour) continue;
    for (std::size_t k = 0; k < cell.spots[s].slots.size(); ++k) {
      out.push_back(
          {static_cast<int>(s), static_cast<int>(k), cell.spots[s].slots[k] - Vec3(0, 0, cell.containers[0].grip)});
    }
  }
  return out;
}

std::vector<Capsule> links(const Machine& machine, const Pose& X_MT, const JointVector& q) {
  using Role = machine::OutlinePart::Role;
  std::vector<Capsule> out;
  const bool serial = kinematics::is_serial(machine.model);
  for (const machine::OutlinePart& part : kinematics::outline_at(machine.model, X_MT, q)) {
    if (part.role == Role::joints) continue;
    for (std::size_t k = 0; k + 1 < part.points.size(); ++k) {
      Capsule c;
      c.from = machine.X_CM * part.points[k];
      c.to = machine.X_CM * part.points[k + 1];
      c.tool = part.role == Role::tool || part.role == Role::platform;
      c.radius = part.role == Role::tool ? machine.body / 4 : machine.body / 2;
      c.mount = part.role == Role::fixed || (serial && part.role == Role::moving && k == 0);
      if ((c.to - c.from).norm() > 1e-9) out.push_back(c);
    }
  }
  return out;
}

double distance(const Vec3& from, const Vec3& to, const Solid& solid) {
  const Vec3 a = into(solid, from), d = into(solid, to) - a, half = solid.size / 2;
  const auto at = [&](double t) { return ((a + t * d).cwiseAbs() - half).cwiseMax(0.0).norm(); };
  const double t = golden_section(at, 0, 1, 1e-6);  // convex
  return std::min({at(t), at(0), at(1)});
}

double overlap(const Solid& a, const Solid& b) {
  double out = (a.size.z() + b.size.z()) / 2 - std::abs(a.middle.z() - b.middle.z());
  const Eigen::Vector2d d = (b.middle - a.middle).head<2>();
  const auto axes = [](const Solid& s) {
    const double c = std::cos(s.turn), n = std::sin(s.turn);
    return std::array{Eigen::Vector2d(c, n), Eigen::Vector2d(-n, c)};
  };
  for (const Solid* of : {&a, &b}) {
    for (const Eigen::Vector2d& axis : axes(*of)) {
      double reach = 0;
      for (const Solid* s : {&a, &b}) {
        const auto own = axes(*s);
        reach += std::abs(axis.dot(own[0])) * s->size.x() / 2 + std::abs(axis.dot(own[1])) * s->size.y() / 2;
      }
      out = std::min(out, reach - std::abs(axis.dot(d)));
    }
  }
  return out;
}

std::pair<Vec3, Vec3> extent(const Cell& cell) {
  Vec3 low = Vec3::Constant(kInfinity), high = -low;
  const auto hold = [&](const Vec3& p) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  };
  for (const Solid& s : solids(cell))
    for (const Vec3& p : s.corners()) hold(p);
  for (const Guard& g : cell.guards) {
    for (const Vec3* p : {&g.from, &g.to}) {
      hold({p->x(), p->y(), 0});
      hold({p->x(), p->y(), g.height});
    }
  }
  for (const Machine& m : cell.machines) hold(m.X_CM.p);
  return {low, high};
}

Layout layout(const Cell& cell, const Motions& motions) {
  return Judge(cell, motions).run();
}

}  // namespace polypod::cell
