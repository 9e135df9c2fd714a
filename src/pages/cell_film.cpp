// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "cell_film.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "moving_machine.hpp"
#include "polypod/cell/layout.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::pages {
namespace {

using machine::JointVector;
using report::Point3;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

Point3 in_mm(const Vec3& p) {
  return {units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z())};
}

/// From rest to rest: 3 s^2 - 2 s^3.
double eased(double s) {
  s = std::clamp(s, 0.0, 1.0);
  return s * s * (3 - 2 * s);
}

report::Mesh mesh_of(const cell::Solid& solid, int kind) {
  report::Mesh out;
  for (const Vec3& p : solid.corners()) out.points.push_back(in_mm(p));
  out.triangles = {{0, 2, 1}, {0, 3, 2}, {4, 5, 6}, {4, 6, 7}, {0, 1, 5}, {0, 5, 4},
                   {1, 2, 6}, {1, 6, 5}, {2, 3, 7}, {2, 7, 6}, {3, 0, 4}, {3, 4, 7}};
  out.kind.assign(out.points.size(), kind);
  out.opacity = 0.55;
  return out;
}

/// Where a machine is at rising times.
class Track {
 public:
  Track(const cell::Machine& machine, const JointVector& home, const std::vector<cell::Leg>& legs)
      : machine_(machine), legs_(legs), joints_(home), from_(home) {
    const kinematics::ForwardResult f = kinematics::forward(machine.model, home);
    if (!f.poses.empty()) pose_ = f.poses[0];
    start_ = machine.X_CM * pose_.p;
  }
  void go_to(double time) {
    while (next_ < legs_.size() && legs_[next_].from <= time) {
      if (next_ > 0) at(legs_[next_].from);
      from_ = joints_;
      start_ = machine_.X_CM * pose_.p;
      ++next_;
    }
    at(time);
  }
  [[nodiscard]] const Pose& pose() const { return pose_; }
  [[nodiscard]] const JointVector& joints() const { return joints_; }

 private:
  void at(double time) {
    if (next_ == 0) return;
    const cell::Leg& leg = legs_[next_ - 1];
    const double s = leg.to > leg.from ? eased((time - leg.from) / (leg.to - leg.from)) : 1;
    if (leg.joints.size() > 0) {
      const JointVector q = from_ + s * (leg.joints - from_);
      const kinematics::ForwardResult f = kinematics::forward(machine_.model, q);
      if (f.poses.empty()) return;
      joints_ = q;
      pose_ = f.poses[0];
      return;
    }
    Vec3 p = start_ + s * (leg.point - start_);
    constexpr double kHalf = 4;  // 4 s (1 - s) is 1 in the middle
    p.z() += leg.lift * kHalf * s * (1 - s);
    Pose X = pose_;
    X.p = machine_.X_CM.inverse() * p;
    const kinematics::InverseResult found = kinematics::inverse_near(machine_.model, X, joints_);
    const kinematics::Solution* best = found.reachable();
    if (best == nullptr) return;
    joints_ = best->joints;
    pose_ = X;
  }

  const cell::Machine& machine_;
  const std::vector<cell::Leg>& legs_;
  JointVector joints_, from_;
  Pose pose_;
  Vec3 start_;
  std::size_t next_ = 0;
};

/// As many dots as there ever are at once.
report::Line3 dots(const std::string& name, std::size_t count, report::Colour colour, double stroke) {
  report::Line3 out;
  out.name = name;
  out.points.assign(count, {kNaN, kNaN, kNaN});
  out.colour = colour;
  out.stroke = stroke;
  out.dots = true;
  out.moves = true;
  return out;
}

}  // namespace

std::optional<report::Scene> cell_film(const CellResult& r) {
  if (!r.simulated() || r.outcome().pictures.empty()) return std::nullopt;
  const cell::Outcome& o = r.outcome();
  report::Scene scene;
  scene.title = "The cell in motion";
  scene.azimuth_deg = -125;
  for (const cell::Solid& solid : cell::solids(r.cell)) {
    auto kind = std::find(scene.kinds.begin(), scene.kinds.end(), solid.kind);
    if (kind == scene.kinds.end()) kind = scene.kinds.insert(kind, solid.kind);
    scene.meshes.push_back(mesh_of(solid, static_cast<int>(kind - scene.kinds.begin())));
  }
  for (const cell::Conveyor& c : r.cell.conveyors) {
    constexpr double kAbove = 0.002;  // m, to be seen over the belt
    report::Line3 line{"belts run that way", {}, report::Colour::ink, 1.2};
    const Vec3 up(0, 0, kAbove);
    const double tip = std::min(0.1, c.length / 4), wing = std::min(0.05, c.width / 4);
    for (const Vec3& p : {c.point(0.1 * c.length, 0), c.point(0.9 * c.length, 0), c.point(0.9 * c.length - tip, wing),
                          c.point(0.9 * c.length, 0), c.point(0.9 * c.length - tip, -wing)})
      line.points.push_back(in_mm(p + up));
    scene.lines.push_back(std::move(line));
  }
  std::vector<report::Frames> parts;  // of each machine
  for (std::size_t m = 0; m < r.cell.machines.size(); ++m) {
    const cell::Machine& machine = r.cell.machines[m];
    Track track(machine, r.motions.home[m], o.machines[m].legs);
    const MovingMachine moving(machine.model, track.pose(), track.joints());
    const auto placed = [&](Point3& p) {
      p = in_mm(machine.X_CM * Vec3(units::from_mm(p.x), units::from_mm(p.y), units::from_mm(p.z)));
    };
    for (report::Line3 line : moving.lines()) {
      std::for_each(line.points.begin(), line.points.end(), placed);
      scene.lines.push_back(std::move(line));
    }
    report::Frames frames;
    for (const cell::Picture& picture : o.pictures) {
      track.go_to(picture.time);
      if (!moving.add(frames, picture.time, track.pose(), track.joints())) {
        if (frames.points.empty()) return std::nullopt;
        frames.points.push_back(frames.points.back());
      }
      frames.columns.clear();
    }
    for (auto& points : frames.points) std::for_each(points.begin(), points.end(), placed);
    parts.push_back(std::move(frames));
  }
  // What lies, stands and is carried.
  std::vector<std::vector<Point3>> items, containers;
  std::vector<Track> tracks;
  for (std::size_t m = 0; m < r.cell.machines.size(); ++m)
    tracks.emplace_back(r.cell.machines[m], r.motions.home[m], o.machines[m].legs);
  std::size_t most_items = 0, most_containers = 0;
  for (const cell::Picture& picture : o.pictures) {
    std::vector<Point3> lie, stand;
    for (const Vec3& p : picture.items) lie.push_back(in_mm(p));
    for (const Vec3& p : picture.containers) stand.push_back(in_mm(p));
    for (std::size_t m = 0; m < tracks.size(); ++m) {
      tracks[m].go_to(picture.time);
      const Point3 tip = in_mm(r.cell.machines[m].X_CM * tracks[m].pose().p);
      if (picture.hands[m] == cell::Picture::Hand::item) lie.push_back(tip);
      if (picture.hands[m] == cell::Picture::Hand::container) stand.push_back(tip);
    }
    most_items = std::max(most_items, lie.size());
    most_containers = std::max(most_containers, stand.size());
    items.push_back(std::move(lie));
    containers.push_back(std::move(stand));
  }
  constexpr double kItem = 4, kContainer = 7;  // px
  if (most_items > 0) scene.lines.push_back(dots(r.cell.items[0].name, most_items, report::Colour::orange, kItem));
  if (most_containers > 0)
    scene.lines.push_back(dots(r.cell.containers[0].name, most_containers, report::Colour::purple, kContainer));
  report::Frames frames;
  frames.columns = {{"placed", "", {}}, {"full", "", {}}, {"emptied", "", {}}, {"served", "", {}}, {"missed", "", {}}};
  for (std::size_t k = 0; k < o.pictures.size(); ++k) {
    const cell::Picture& picture = o.pictures[k];
    frames.at.push_back(picture.time);
    std::vector<Point3> points;
    for (const report::Frames& part : parts) points.insert(points.end(), part.points[k].begin(), part.points[k].end());
    items[k].resize(most_items, {kNaN, kNaN, kNaN});
    containers[k].resize(most_containers, {kNaN, kNaN, kNaN});
    points.insert(points.end(), items[k].begin(), items[k].end());
    points.insert(points.end(), containers[k].begin(), containers[k].end());
    frames.points.push_back(std::move(points));
    frames.notes.emplace_back();
    const std::array<int, 5> counts{picture.placed, picture.filled, picture.emptied, picture.served, picture.missed};
    for (std::size_t c = 0; c < counts.size(); ++c) frames.columns[c].values.push_back(counts[c]);
  }
  scene.frames.push_back(std::move(frames));
  return scene;
}

}  // namespace polypod::pages
