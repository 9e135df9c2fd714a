// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/layout.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include <Eigen/Eigenvalues>

#include "common.hpp"
#include "polypod/bodies/shape.hpp"
#include "polypod/core/golden_section.hpp"
#include "polypod/core/units.hpp"
#include "polypod/geometry/segments.hpp"
#include "polypod/kinematics/parts.hpp"
#include "positions.hpp"

namespace polypod::cell {
namespace {

using machine::JointVector;

Vec3 into(const Solid& s, const Vec3& p) {
  const Vec3 d = p - s.middle;
  const double c = std::cos(s.turn), n = std::sin(s.turn);
  return {c * d.x() + n * d.y(), -n * d.x() + c * d.y(), d.z()};
}

bodies::Shape shape_of(const Capsule& c) {
  return c.cargo ? bodies::cylinder(c.from, c.to, c.radius) : bodies::capsule(c.from, c.to, c.radius);
}
/// Whether two bodies touch: no plane was found between them, and points of both that are less than a micrometre apart.
bool touch(const bodies::Shape& a, const Pose& X_CA, const bodies::Shape& b, const Pose& X_CB) {
  constexpr double kSame = 1e-6;
  const bodies::Bracket d = bodies::distance(a, X_CA, b, X_CB, kSame);
  return d.high < kSame;
}

/// What is shrunk by so much all round no longer touches what it stands on or beside, m.
constexpr double kTouch = 1e-5;

/// A container where it stands.
struct Standing {
  std::size_t slot = 0;
  Vec3 bottom = Vec3::Zero(), top = Vec3::Zero();  ///< m
};
/// All containers that can stand in a place.
struct Crowd {
  std::vector<Standing> all;
  Vec3 middle = Vec3::Zero();
  double radius = 0;  ///< of a ball that holds all of them
  /// Nothing is ever put there, or taken: the containers go, or come, in the order of their slots.
  bool only_source = false, only_sink = false;
};

bodies::Shape shape_of(const Solid& s) {
  return bodies::box(-s.size / 2, s.size / 2);
}
Pose pose_of(const Solid& s) {
  Pose X;
  X.R = Eigen::AngleAxisd(s.turn, Vec3::UnitZ()).toRotationMatrix();
  X.p = s.middle;
  return X;
}
bodies::Shape shrunk(const Vec3& bottom, const Vec3& top, double radius) {
  const Vec3 by = (top - bottom).normalized() * std::min(kTouch, (top - bottom).norm() / 4);
  return bodies::cylinder(bottom + by, top - by, std::max(radius - kTouch, radius / 2));
}

class Judge {
 public:
  Judge(const Cell& cell, const Motions& motions) : cell_(cell), solids_(solids(cell)) {
    Positions found = positions(cell, motions);
    positions_ = std::move(found.of);
    out_.complete = found.complete;
    for (const Guard& g : cell.guards) fence(g);
    crowds();
  }

  Layout run(const Motions& motions) {
    out_.least_distance = out_.least_distance_containers = kInfinity;
    at_rest();
    containers_at_rest();
    doors();
    against_bodies();
    against_fences();
    collect_gaps();
    against_containers();
    bases_stand_free(motions);
    items_on_belts();
    report();
    against_each_other();
    sweep();
    const auto [low, high] = extent(cell_);
    out_.low = low;
    out_.high = high;
    out_.floor_area = (high.x() - low.x()) * (high.y() - low.y());
    return std::move(out_);
  }

 private:
  /// What machines and what they carry come to, in pieces.
  void sweep() {
    for (std::size_t m = 0; m < positions_.size(); ++m) {
      out_.positions += static_cast<int>(positions_[m].size());
      for (const Position& p : positions_[m]) {
        for (const Capsule& c : p.links) {
          if (c.mount) continue;
          constexpr double kPiece = 0.1;  // m: what lies at one height of the tables of distances
          const int pieces = std::max(1, static_cast<int>(std::ceil((c.to - c.from).norm() / kPiece)));
          for (int k = 0; k < pieces; ++k) {
            const auto at = [&](int i) { return Vec3(c.from + (c.to - c.from) * (static_cast<double>(i) / pieces)); };
            out_.swept.push_back({at(k), c.radius, cell_.machines[m].name, at(k + 1)});
          }
        }
      }
    }
  }

  /// A fence as a sheet that stands there.
  void fence(const Guard& g) {
    if (g.kind != Guard::Kind::fence || !(g.height > 0)) return;
    constexpr double kSheet = 0.005;  // m
    const Vec3 d = g.to - g.from;
    Solid s;
    s.name = g.name;
    s.kind = "fence";
    s.middle = (g.from + g.to) / 2;
    s.middle.z() = g.height / 2;
    s.size = {std::hypot(d.x(), d.y()), kSheet, g.height};
    s.turn = std::atan2(d.y(), d.x());
    fences_.emplace_back(s, g.opening > 0);
  }

  void crowds() {
    crowds_.resize(cell_.spots.size());
    if (cell_.containers.empty()) return;
    const Container& container = cell_.containers[0];
    std::vector<bool> put(cell_.spots.size(), false), taken(cell_.spots.size(), false);
    for (const Task& t : cell_.tasks) {
      if (t.to >= 0) put[static_cast<std::size_t>(t.to)] = true;
      if (t.from >= 0) taken[static_cast<std::size_t>(t.from)] = true;
    }
    for (std::size_t s = 0; s < crowds_.size(); ++s) {
      crowds_[s].only_source = !put[s];
      crowds_[s].only_sink = !taken[s] && cell_.spots[s].kind != Spot::Kind::opening;
    }
    for (const StandingContainer& c : standing_containers(cell_)) {
      const auto s = static_cast<std::size_t>(c.spot);
      if (!put[s] && c.slot >= cell_.spots[s].containers) continue;  // nothing ever stands there
      crowds_[s].all.push_back({static_cast<std::size_t>(c.slot), c.bottom, c.bottom + Vec3(0, 0, container.height)});
    }
    for (Crowd& crowd : crowds_) {
      Vec3 low = Vec3::Constant(kInfinity), high = -low;
      for (const Standing& c : crowd.all) {
        low = low.cwiseMin(c.bottom);
        high = high.cwiseMax(c.top);
      }
      if (crowd.all.empty()) continue;
      crowd.middle = (low + high) / 2;
      crowd.radius = (high - low).norm() / 2 + container.diameter / 2;
    }
  }

  /// Whether a container can stand in a slot while a machine is at a position; `own`: the tool may touch it.
  [[nodiscard]] bool stands(const Position& p, std::size_t spot, const Standing& c, bool& own) const {
    own = false;
    for (const Moved& moved : p.moved) {
      if (moved.spot != static_cast<int>(spot)) continue;
      if (moved.slot == c.slot) {
        own = moved.stands;
        return moved.stands;
      }
      if (moved.how == Moved::How::takes && crowds_[spot].only_source && c.slot < moved.slot) return false;
      if (moved.how == Moved::How::puts && crowds_[spot].only_sink && c.slot > moved.slot) return false;
    }
    return true;
  }
  [[nodiscard]] std::string called(const Standing& c, std::size_t spot) const {
    const std::string& name = cell_.containers[0].name;
    return cell_.spots[spot].slots.size() > 1
               ? fmt::format("the {} in slot {} of {}", name, c.slot + 1, cell_.spots[spot].name)
               : fmt::format("the {} in {}", name, cell_.spots[spot].name);
  }

  void at_rest() {
    constexpr double kSame = 1e-6;  // m: what stands on something touches it
    std::vector<std::string> rest;
    for (std::size_t i = 0; i < solids_.size(); ++i) {
      for (std::size_t k = i + 1; k < solids_.size(); ++k) {
        const double depth = overlap(solids_[i], solids_[k]);
        if (depth <= kSame) continue;
        // A base belongs to its machine's place, a holder may stand in its stand: only what is not one body is judged.
        rest.push_back(fmt::format("{} and {} reach {:.1f} mm into each other", solids_[i].name, solids_[k].name,
                                   units::to_mm(depth)));
      }
      const double below = solids_[i].size.z() / 2 - solids_[i].middle.z();
      if (below > kSame)
        rest.push_back(fmt::format("{} reaches {:.1f} mm below the floor", solids_[i].name, units::to_mm(below)));
      // What stands beside the sheet of a fence touches half of it; an opening lets belts and places through.
      for (const auto& [sheet, open] : fences_)
        if (!open && overlap(solids_[i], sheet) > sheet.size.y())
          rest.push_back(fmt::format("{} stands in the fence {}, which has no opening", solids_[i].name, sheet.name));
    }
    constexpr std::size_t kListed = 100;
    for (std::size_t k = 0; k < std::min(rest.size(), kListed); ++k) out_.problems.push_back({"collision", rest[k]});
    if (rest.size() > kListed)
      out_.problems.push_back({"collision", fmt::format("{} more of bodies at rest", rest.size() - kListed)});
  }

  /// Containers in their slots against bodies, items on belts, fences and containers of other places.
  void containers_at_rest() {
    if (cell_.containers.empty()) return;
    const Container& k = cell_.containers[0];
    std::vector<Solid> around = solids_;
    for (Solid& layer : layers()) {
      layer.name = "items on " + layer.name;
      around.push_back(layer);
    }
    for (const auto& [solid, open] : fences_) around.push_back(solid);
    for (std::size_t s = 0; s < crowds_.size(); ++s) {
      for (const Standing& c : crowds_[s].all) {
        const bodies::Shape shape = shrunk(c.bottom, c.top, k.diameter / 2);
        for (const Solid& solid : around) {
          if (solid.name == cell_.spots[s].name) continue;  // it stands in it
          if (((c.bottom + c.top) / 2 - solid.middle).norm() > (k.height + k.diameter + solid.size.norm()) / 2)
            continue;
          if (touch(shape, Pose{}, shape_of(solid), pose_of(solid)))
            find(fmt::format("{}s in {}", k.name, cell_.spots[s].name), solid.name, called(c, s), solid.name, -1,
                 (c.bottom + c.top) / 2);
        }
        for (std::size_t o = s + 1; o < crowds_.size(); ++o) {
          if ((crowds_[s].middle - crowds_[o].middle).norm() > crowds_[s].radius + crowds_[o].radius) continue;
          for (const Standing& other : crowds_[o].all) {
            const Vec3 d = c.bottom - other.bottom;
            if (std::hypot(d.x(), d.y()) < k.diameter - kTouch && std::abs(d.z()) < k.height - kTouch)
              find(cell_.spots[s].name, cell_.spots[o].name, called(c, s), called(other, o), -1,
                   (c.bottom + c.top) / 2);
          }
        }
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
  /// A link of a machine, or what it carries.
  [[nodiscard]] std::string called(std::size_t m, std::size_t task, const Capsule& c) const {
    if (!c.cargo) return called(m, task);
    const bool item = task < cell_.tasks.size() && cell_.tasks[task].from_conveyor >= 0;
    return fmt::format("the {} in {}", item ? cell_.items[0].name : cell_.containers[0].name, called(m, task));
  }

  /// Keeps the deepest of what is found of a pair; `depth` below 0: they meet, how deep is not known.
  void find(const std::string& mover, const std::string& group, const std::string& first, const std::string& what,
            double depth, const Vec3& at) {
    const auto [it, fresh] = found_.try_emplace({mover, group});
    if (fresh || depth > it->second.depth) it->second = {depth, first, what, at};
  }
  void report() {
    for (const auto& [key, f] : found_) {
      const std::string how = f.depth >= 0 ? fmt::format("comes {:.1f} mm into", units::to_mm(f.depth)) : "runs into";
      out_.problems.push_back({"collision", fmt::format("{} {} {} near {}", f.first, how, f.what, place_text(f.at))});
    }
  }

  /// Whether a position takes or puts at a body just now.
  [[nodiscard]] bool near(const Position& p, const Solid& s) const {
    return (p.near_spot >= 0 && cell_.spots[static_cast<std::size_t>(p.near_spot)].name == s.name) ||
           (p.near_conveyor >= 0 && cell_.conveyors[static_cast<std::size_t>(p.near_conveyor)].name == s.name);
  }

  /// A link or what is carried against a box: below 0 where they meet, as deep as the axis is; what is carried is a
  /// cylinder, and -1 where it meets the box.
  [[nodiscard]] static double gap(const Capsule& c, const Solid& s) {
    const double d = distance(c.from, c.to, s) - c.radius;
    if (!c.cargo || d >= 0) return d;
    const double exact =
        bodies::distance(shrunk(c.from, c.to, c.radius), Pose{}, shape_of(s), pose_of(s), kInfinity).high;
    return exact < 1e-6 ? -1 : exact;
  }
  /// The least gap of a machine and a body that was found so far.
  Gap& gap_of(std::size_t m, const Solid& s) {
    const auto [it, fresh] = gaps_.try_emplace({m, s.name});
    if (fresh) it->second = {cell_.machines[m].name, s.name, s.kind, "", kInfinity, Vec3::Zero()};
    return it->second;
  }
  /// Beyond it no gap counts, m.
  static constexpr double kWide = 1.0;
  void judge(std::size_t m, const Position& p, const Capsule& c, const Solid& s, Gap& least) {
    // The middle of a link is at most half of its length nearer than any other point of it.
    const Vec3 beyond = (into(s, (c.from + c.to) / 2).cwiseAbs() - s.size / 2).cwiseMax(0.0);
    if (beyond.norm() - (c.to - c.from).norm() / 2 - c.radius > std::clamp(least.distance, 0.0, kWide)) return;
    const double d = gap(c, s);
    // Where the tool takes and puts, it and what it holds come to what stands there: no narrow place of the way.
    const bool works = (c.cargo || c.tool) && s.kind != "fence" && (p.near_spot >= 0 || p.near_conveyor >= 0);
    if (!works && d < least.distance) {
      least.distance = std::max(d, c.cargo ? 0.0 : d);
      least.mover = called(m, p.task, c);
      least.at = (c.from + c.to) / 2;
    }
    if (d < 0) find(called(m, p.task, c), s.name, called(m, p.task, c), s.name, c.cargo ? -1 : -d, (c.from + c.to) / 2);
  }
  void collect_gaps() {
    for (auto& [key, g] : gaps_) {
      if (!(g.distance <= kWide)) continue;
      out_.least_distance = std::min(out_.least_distance, g.distance);
      g.distance = std::max(g.distance, 0.0);
      out_.gaps.push_back(std::move(g));
    }
    std::stable_sort(out_.gaps.begin(), out_.gaps.end(),
                     [](const Gap& x, const Gap& y) { return x.distance < y.distance; });
  }

  void against_bodies() {
    for (std::size_t m = 0; m < positions_.size(); ++m) {
      for (const Position& p : positions_[m]) {
        for (const Solid& s : solids_) {
          Gap& least = gap_of(m, s);
          const double far = (p.middle - s.middle).norm() - p.radius - s.size.norm() / 2;
          if (far > std::clamp(least.distance, 0.0, kWide)) continue;
          const bool mine = near(p, s);
          for (const Capsule& c : p.links) {
            // An item lies on its belt; a container stands in its place.
            if (c.mount || (c.tool && mine && !(c.cargo && p.near_conveyor >= 0))) continue;
            judge(m, p, c, s, least);
          }
        }
      }
    }
  }

  /// What reaches through the opening of a fence, as a task asks, may.
  void against_fences() {
    for (std::size_t m = 0; m < positions_.size(); ++m) {
      for (const Position& p : positions_[m]) {
        const bool through =
            p.near_spot >= 0 && cell_.spots[static_cast<std::size_t>(p.near_spot)].kind == Spot::Kind::opening;
        for (const auto& [s, open] : fences_) {
          Gap& least = gap_of(m, s);
          const double far = (p.middle - s.middle).norm() - p.radius - s.size.norm() / 2;
          if (far > std::clamp(least.distance, 0.0, kWide)) continue;
          for (const Capsule& c : p.links)
            if (!c.mount && !(c.tool && through && open)) judge(m, p, c, s, least);
        }
      }
    }
  }

  void against_containers() {
    if (cell_.containers.empty()) return;
    const Container& k = cell_.containers[0];
    const double reach = std::hypot(k.height, k.diameter) / 2;
    for (std::size_t m = 0; m < positions_.size(); ++m) {
      for (const Position& p : positions_[m]) {
        for (std::size_t s = 0; s < crowds_.size(); ++s) {
          const Crowd& crowd = crowds_[s];
          if (crowd.all.empty() || (p.middle - crowd.middle).norm() > p.radius + crowd.radius) continue;
          for (const Standing& c : crowd.all) {
            bool own = false;
            if ((p.middle - (c.bottom + c.top) / 2).norm() > p.radius + reach || !stands(p, s, c, own)) continue;
            for (const Capsule& link : p.links) {
              if (link.tool && own) continue;
              const double limit = std::max(out_.least_distance_containers, 0.0);
              if (!nearer_than(link.from, link.to, c.bottom, c.top,
                               std::min(limit, 1.0) + link.radius + k.diameter / 2))
                continue;
              double d = 0;
              if (link.cargo) {
                const bodies::Bracket b = bodies::distance(shrunk(link.from, link.to, link.radius), Pose{},
                                                           shrunk(c.bottom, c.top, k.diameter / 2), Pose{}, limit);
                d = b.high < 1e-6 ? -1 : b.high;
              } else {
                const bodies::Shape axis = bodies::capsule(link.from, link.to, 0);
                d = bodies::distance(axis, Pose{}, bodies::cylinder(c.bottom, c.top, k.diameter / 2), Pose{},
                                     limit + link.radius)
                        .high -
                    link.radius;
              }
              out_.least_distance_containers =
                  std::min(out_.least_distance_containers, std::max(d, link.cargo ? 0 : d));
              if (d < 0)
                find(called(m, p.task, link), cell_.spots[s].name + " container", called(m, p.task, link), called(c, s),
                     link.cargo ? -1 : -d, (link.from + link.to) / 2);
            }
          }
        }
      }
    }
  }

  /// Bases against everything but what carries them.
  void bases_stand_free(const Motions& motions) {
    constexpr double kFoot = 1e-3;  // m
    for (std::size_t m = 0; m < cell_.machines.size(); ++m) {
      const Machine& machine = cell_.machines[m];
      const bool serial = kinematics::is_serial(machine.model);
      const std::string name = fmt::format("the base of {}", machine.name);
      for (const BaseBody& base : bases(machine, motions.home[m])) {
        const bodies::Shape shape = base.disc ? bodies::cylinder(base.from, base.to, base.radius)
                                              : bodies::capsule(base.from, base.to, base.radius);
        const Vec3 middle = (base.from + base.to) / 2;
        const double reach = (base.to - base.from).norm() / 2 + base.radius;
        const auto against = [&](const Solid& s) {
          if ((middle - s.middle).norm() > reach + s.size.norm() / 2) return;
          if (std::find(machine.mounted_on.begin(), machine.mounted_on.end(), s.name) != machine.mounted_on.end())
            return;
          if (serial && distance(base.from, base.from, s) < kFoot) return;
          if (touch(shape, Pose{}, shape_of(s), pose_of(s))) find(name, s.name, name, s.name, -1, middle);
        };
        for (const Solid& s : solids_) against(s);
        for (const auto& [s, open] : fences_) against(s);
        for (std::size_t s = 0; s < crowds_.size(); ++s) {
          const Crowd& crowd = crowds_[s];
          if (crowd.all.empty() || (middle - crowd.middle).norm() > reach + crowd.radius) continue;
          for (const Standing& c : crowd.all)
            if (touch(shape, Pose{}, shrunk(c.bottom, c.top, cell_.containers[0].diameter / 2), Pose{}))
              find(name, cell_.spots[s].name + " container", name, called(c, s), -1, (c.bottom + c.top) / 2);
        }
        for (std::size_t o = 0; o < positions_.size(); ++o) {
          if (o == m) continue;
          for (const Position& p : positions_[o]) {
            if ((middle - p.middle).norm() > reach + p.radius) continue;
            for (const Capsule& c : p.links)
              if (touch(shape, Pose{}, shape_of(c), Pose{}))
                find(called(o, p.task), name, called(o, p.task, c), name, -1, (c.from + c.to) / 2);
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
    for (std::size_t m = 0; m < positions_.size(); ++m) {
      for (const Position& p : positions_[m]) {
        for (const Solid& s : solid) {
          if (works_at(p.task, s.name) || (p.middle - s.middle).norm() > p.radius + s.size.norm() / 2) continue;
          for (const Capsule& c : p.links) {
            if (c.mount) continue;
            const std::string what = fmt::format("items on {}", s.name);
            if (touch(shape_of(c), Pose{}, shape_of(s), pose_of(s)))
              find(called(m, p.task, c), what, called(m, p.task, c), what, -1, (c.from + c.to) / 2);
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
              const double from_ball = ((a.from + a.to) / 2 - q.middle).norm() - q.radius;
              if (from_ball - (a.to - a.from).norm() / 2 - a.radius > cell_.clearance) continue;
              for (const Capsule& b : q.links) {
                if (!nearer_than(a.from, a.to, b.from, b.to, limit + a.radius + b.radius)) continue;
                const double d = a.cargo || b.cargo
                                     ? bodies::distance(shape_of(a), Pose{}, shape_of(b), Pose{}, limit).high
                                     : segment_distance(a.from, a.to, b.from, b.to) - a.radius - b.radius;
                if (d >= limit) continue;
                limit = d;
                const ClosestParameters c = closest_parameters(a.from, a.to - a.from, b.from, b.to - b.from);
                const Vec3 at =
                    (a.from + c.s * (a.to - a.from) + b.from + c.t * (b.to - b.from)) / 2;  // between their axes
                worst[key] = {called(m, p.task, a), called(o, q.task, b), d, at, together ? p.zone : ""};
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

  struct Finding {
    double depth = 0;  ///< m, the deepest
    std::string first, what;
    Vec3 at = Vec3::Zero();
  };

  const Cell& cell_;
  std::vector<Solid> solids_;
  std::vector<std::pair<Solid, bool>> fences_;  ///< and whether they have an opening
  std::vector<Crowd> crowds_;                   ///< of each spot
  std::vector<std::vector<Position>> positions_;
  std::map<std::pair<std::string, std::string>, Finding> found_;
  std::map<std::pair<std::size_t, std::string>, Gap> gaps_;  ///< of a machine and a body or fence
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

std::vector<BaseBody> bases(const Machine& machine, const JointVector& home) {
  using Role = machine::OutlinePart::Role;
  std::vector<BaseBody> out;
  const kinematics::ForwardResult f = kinematics::forward(machine.model, home);
  if (f.poses.empty()) return out;
  if (kinematics::is_serial(machine.model)) {
    for (const Capsule& c : links(machine, f.poses[0], home)) {
      if (!c.mount || c.tool) continue;
      // The last of what is mounted is the column; before it the lines of the base are a picture.
      out.assign(1, {c.from, c.to, c.radius, false});
    }
    return out;
  }
  std::vector<Vec3> joints;
  for (const machine::OutlinePart& part : kinematics::outline_at(machine.model, f.poses[0], home)) {
    if (part.role != Role::fixed) continue;
    std::vector<Vec3> points;
    for (const Vec3& p : part.points) points.push_back(machine.X_CM * p);
    if (part.plate) {
      joints.insert(joints.end(), points.begin(), points.end());
      continue;
    }
    for (std::size_t k = 0; k + 1 < points.size(); ++k) {
      out.push_back({points[k], points[k + 1], machine.body / 2, false});
    }
  }
  if (joints.size() < 3) return out;
  // The outline comes back to its first joint.
  if ((joints.front() - joints.back()).norm() < 1e-9) joints.pop_back();
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : joints) middle += p / static_cast<double>(joints.size());
  Mat3 spread = Mat3::Zero();
  for (const Vec3& p : joints) spread += (p - middle) * (p - middle).transpose();
  const Eigen::SelfAdjointEigenSolver<Mat3> axes(spread);
  const Vec3 normal = axes.eigenvectors().col(0);  // of the least spread
  double radius = 0, thick = 0;
  for (const Vec3& p : joints) {
    const double up = (p - middle).dot(normal);
    radius = std::max(radius, (p - middle - up * normal).norm());
    thick = std::max(thick, std::abs(up));
  }
  if (!(radius > 0)) return out;
  thick += machine.body / 2;
  out.push_back({middle - thick * normal, middle + thick * normal, radius + machine.body / 2, true});
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
  return Judge(cell, motions).run(motions);
}

}  // namespace polypod::cell
