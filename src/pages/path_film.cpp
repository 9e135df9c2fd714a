// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "path_film.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "machine_lines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/machine.hpp"
#include "program_film.hpp"
#include "stock_mesh.hpp"

namespace polypod::pages {
namespace {

using units::to_mm;
using units::to_um;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kSamePlace = 1e-6;  // mm along the path

/// The dots of a track by their place along the path.
class Along {
 public:
  explicit Along(const std::vector<Dot>& dots) {
    for (const Dot& d : dots) dots_.push_back(&d);
    std::stable_sort(dots_.begin(), dots_.end(), [](const Dot* a, const Dot* b) { return a->at < b->at; });
  }
  [[nodiscard]] const Dot* farthest() const {
    const Dot* out = nullptr;
    for (const Dot* d : dots_)
      if (d->sample->cutting && (out == nullptr || d->sample->distance > out->sample->distance)) out = d;
    return out;
  }
  /// The dot that is nearest to a place of the path; of those at one place the one that is farthest off. Null where
  /// none is within two millimetres, or none cuts.
  [[nodiscard]] const Dot* near(double at) const {
    const auto before = [](const Dot* d, double x) { return d->at < x; };
    auto it = std::lower_bound(dots_.begin(), dots_.end(), at, before);
    if (it == dots_.end() || (it != dots_.begin() && at - (*std::prev(it))->at <= (*it)->at - at)) {
      if (it == dots_.begin()) return nullptr;
      --it;
    }
    const double place = (*it)->at;
    constexpr double kFar = 2;  // mm
    if (std::abs(place - at) > kFar) return nullptr;
    const Dot* out = nullptr;
    for (it = std::lower_bound(dots_.begin(), dots_.end(), place - kSamePlace, before);
         it != dots_.end() && (*it)->at <= place + kSamePlace; ++it)
      if ((*it)->sample->cutting && (out == nullptr || (*it)->sample->distance > out->sample->distance)) out = *it;
    return out;
  }

 private:
  std::vector<const Dot*> dots_;
};

/// From W to M, mm.
void to_machine(report::Scene& scene, const Pose& X_MW) {
  const auto turn = [&](report::Point3& p, bool shift) {
    Vec3 v = X_MW.R * Vec3(p.x, p.y, p.z);
    if (shift) v += X_MW.p * units::kMmPerMetre;
    p = {v.x(), v.y(), v.z()};
  };
  for (report::Line3& line : scene.lines) {
    for (report::Point3& p : line.points) turn(p, true);
    for (report::Point3& p : line.offset) turn(p, false);
  }
}

/// Where the tool is along the moves, each with the time of the first picture that is not before it.
std::vector<OnTheWay> way_of(const machining::Job& job, const LongVector<gcode::Move>& moves,
                             const std::vector<ProgramInstant>& pictures) {
  std::vector<OnTheWay> out;
  constexpr double kPoints = 40000, kLeast = 1e-4;  // m
  double length = 0;
  for (const gcode::Move& move : moves) length += move.start_known ? move.length() : 0;
  const double step = std::max(kLeast, length / kPoints);
  std::size_t picture = 0;
  bool known = false;
  for (std::size_t k = 0; k < moves.size() && !pictures.empty(); ++k) {
    const gcode::Move& move = moves[k];
    if (!move.start_known) {
      known = false;
      continue;
    }
    const int count = std::max(1, static_cast<int>(std::ceil(move.length() / step)));
    for (int i = known ? 1 : 0; i <= count; ++i) {
      const double s = move.length() * i / count;
      const auto before = [&](const ProgramInstant& p) {
        return std::pair(p.move, p.s) < std::pair(static_cast<int>(k), s);
      };
      while (picture + 1 < pictures.size() && before(pictures[picture])) ++picture;
      out.push_back({move.point(s), pictures[picture].time, &job.cutter_of(move.tool), known || i > 0});
    }
    known = true;
  }
  return out;
}

}  // namespace

bool add_path_film(report::Report& report, const machining::Job& job, const gcode::Program& program,
                   const machining::Correction& c, const Tracks& tracks, double factor, const cutting::Stock* left) {
  const Along before(tracks.before), after(tracks.after);
  ProgramWalkOptions how;
  constexpr double kPoints = 20000, kLeastStep = 1e-3;
  double length = 0;
  for (const gcode::Move& move : c.programmed) length += move.start_known ? move.length() : 0;
  how.step = std::max(kLeastStep, length / kPoints);
  how.posture = job.posture;
  how.pictures = pictures_for(job.machine) / 2;  // the page has the paths and the stock as well
  for (const Dot* d : {before.farthest(), after.farthest()})
    if (d != nullptr) how.wanted.emplace_back(d->move, d->s);
  std::sort(how.wanted.begin(), how.wanted.end());
  const ProgramWalk walk = walk_program(job.machine, job.X_MW, program, c.programmed, how);
  if (!walk.any()) return false;
  const auto place = [&](const ProgramInstant& p) {
    const auto it = std::lower_bound(tracks.stretches.begin(), tracks.stretches.end(), p.move,
                                     [](const Stretch& s, int move) { return s.move < move; });
    return it == tracks.stretches.end() || it->move != p.move ? kNone : it->from + to_mm(p.s);
  };
  const auto distance = [&](const Along& track) {
    return [&track, place](const ProgramInstant& p) {
      const double at = place(p);
      const Dot* d = std::isfinite(at) ? track.near(at) : nullptr;
      return d == nullptr ? kNone : to_um(double(d->sample->distance));
    };
  };
  std::vector<FilmColumn> columns{{"along the moves that cut", "mm", place}};
  const bool both = !tracks.after.empty();
  columns.push_back({both ? "distance, as it is" : "distance", "µm", distance(before)});
  if (both) columns.push_back({"distance, corrected", "µm", distance(after)});

  const std::vector<OnTheWay> way = way_of(job, c.programmed, walk.pictures);
  const auto scene_of = [&](std::size_t points) {
    report::Scene scene = path_scene(c, tracks, factor, points);
    scene.title = "The machine on its way along the program";
    to_machine(scene, job.X_MW);
    report::Scene usual;
    scene.azimuth_deg = usual.azimuth_deg;
    scene.elevation_deg = usual.elevation_deg;
    if (!job.tool_frame.tilted && job.stock.columns() > 0) {
      scene.lines.push_back(box_line("stock before", job.stock.min(), job.stock.max(), job.X_MW));
      if (left != nullptr && left->columns() > 0) {
        constexpr int kCells = 90;
        constexpr std::size_t kShifts = 40000;
        scene.meshes.push_back(growing_cut(job.stock, *left, job.X_MW, kCells, "stock", way, kShifts));
        scene.meshes.back().opacity = 0.6;
        scene.kinds = {"stock; at the end what the deflected tool leaves"};
      }
    }
    add_film(scene, job.machine, walk.pictures, columns, lines_of(program, c.programmed));
    if (kinematics::hangs_down(job.machine)) hang(scene);
    return scene;
  };
  report.add_section("The machine on its way");
  constexpr std::size_t kDrawn = 240, kTurns = 1200;
  const report::Scene turns = scene_of(kTurns);
  report::Scene drawn = scene_of(kDrawn);
  drawn.frames.clear();
  drawn.meshes.clear();
  report.add_scene(
      drawn,
      fmt::format("{}The machine in M along the program as it is programmed; the paths of the deflected tool have the "
                  "colour of their distance. {}. The time is that of the feeds and of rapids at {} mm/min, without "
                  "acceleration. The curves below have a cursor that goes along; a click into one moves the machine "
                  "there.",
                  kinematics::hangs_down(job.machine) ? "The base is above: z of the machine points down. " : "",
                  film_in_words(walk), report::fixed(units::to_mm_per_min(how.rapid_speed), 0)),
      &turns);
  return true;
}

}  // namespace polypod::pages
