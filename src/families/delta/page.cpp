// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/delta/page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>

#include "../../pages/machine_lines.hpp"
#include "../../pages/moving_machine.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/report/html.hpp"
#include "polypod/report/scene.hpp"
#include "polypod/workspace/surface.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using report::fixed;
using units::to_mm;

constexpr int kAcross = 70;  // points along the longer side of a section

report::Point3 mm(const Vec3& p) {
  return {to_mm(p.x()), to_mm(p.y()), to_mm(p.z())};
}

/// The part of a grid's plane whose margin is not negative, and two points beyond it; all of it where there is none.
workspace::Grid reached_part(const workspace::Field& field) {
  const workspace::Grid& grid = field.grid;
  std::array<int, 2> low{grid.points[0], grid.points[1]}, high{-1, -1};
  for (int j = 0; j < grid.points[1]; ++j) {
    for (int i = 0; i < grid.points[0]; ++i) {
      if (field.margin[grid.index(i, j, 0)] < 0) continue;
      low = {std::min(low[0], i), std::min(low[1], j)};
      high = {std::max(high[0], i), std::max(high[1], j)};
    }
  }
  if (high[0] < 0) return grid;
  constexpr int kAround = 2;
  workspace::Grid out = grid;
  for (std::size_t k = 0; k < 2; ++k) {
    const int from = std::max(0, low[k] - kAround), to = std::min(grid.points[k] - 1, high[k] + kAround);
    out.origin += from * grid.step[k];
    out.points[k] = to - from + 1;
  }
  return out;
}

report::HeatMap map_on(const workspace::Grid& grid, const char* x, const char* y) {
  report::HeatMap map;
  map.columns = grid.points[0];
  map.rows = grid.points[1];
  const auto axis = [&](const char* name, int k) {
    const int at = name[0] - 'x';
    const Vec3 last =
        grid.origin + (grid.points[static_cast<std::size_t>(k)] - 1) * grid.step[static_cast<std::size_t>(k)];
    return report::Axis{name, "mm", to_mm(grid.origin[at]), to_mm(last[at]), false};
  };
  map.x = axis(x, 0);
  map.y = axis(y, 1);
  map.y.downwards = y[0] == 'z';  // the machine hangs, as in its picture
  return map;
}

/// The distance from singular poses over a plane, cut to what is reached, the near-singular zone in red.
template <class M>
Result<report::HeatMap> distance_map(const M& m, const AnyMachine& machine, const Vec3& through, int normal,
                                     double d_min) {
  const char* names[] = {"x", "y", "z"};
  const int u = normal == 0 ? 1 : 0, v = normal == 2 ? 1 : 2;
  const workspace::Plane plane{through, Vec3::Unit(normal)};
  workspace::FieldOptions field_options;
  field_options.tilt = false;
  POLYPOD_ASSIGN(section, workspace::section(machine, {}, plane, kAcross, field_options));
  const workspace::Grid grid = reached_part(section.field);
  report::HeatMap map = map_on(grid, names[u], names[v]);
  map.title =
      fmt::format("distance from singular poses, {} = {} mm", names[normal], fixed(to_mm(plane.point[normal]), 0));
  map.label = "distance";
  map.unit = "mm";
  std::vector<report::Polyline> near;
  const double half = 0.3 * to_mm(grid.step[0].norm());
  const auto within = [&](const Vec3& X) {
    machine::JointVector q(m.arms);
    if (!machine::drive_positions(m, X, q.data())) return false;
    const auto bits = kinematics::violations(machine, Pose{Mat3::Identity(), X}, q);
    return (bits & ~workspace::interference_bits(machine)) == 0;
  };
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const Vec3 X = grid.at(i);
    const machine::Closeness close = closeness(m, X);
    // Beyond reach two elbows have met, and the rods hang no more: the distance went to 0 there.
    map.values.push_back(close.reached ? std::max(0.0, to_mm(close.least())) : 0.0);
    if (!within(X) || !close.reached || close.least() >= d_min) continue;
    const report::Point at{to_mm(X[u]), to_mm(X[v])};  // maps have lines, no points: a short one
    near.push_back({"near-singular", {{at.x - half, at.y}, {at.x + half, at.y}}, report::Colour::vermillion});
  }
  for (const workspace::Loop& loop : section.border) {
    report::Polyline line{"", {}, report::Colour::ink, report::LineStyle::solid, 1.2};
    for (const Vec3& X : loop) line.points.push_back({to_mm(X[u]), to_mm(X[v])});
    if (line.points.empty()) continue;
    map.clip.push_back(line.points);
    line.points.push_back(line.points.front());
    map.lines.push_back(std::move(line));
  }
  map.lines.insert(map.lines.end(), near.begin(), near.end());
  return map;
}

/// How many chains reach each point of a level, each alone (KOZ Figures 4-18, 4-19).
template <class M>
Result<report::HeatMap> chains_map(const M& m, const workspace::Extent& box, double z) {
  Vec3 low = box.low, high = box.high;
  low.z() = z - 1e-3;
  high.z() = z + 1e-3;
  const Vec3 spread = 0.35 * (box.high - box.low);
  low.head<2>() -= spread.head<2>();
  high.head<2>() += spread.head<2>();
  POLYPOD_ASSIGN(grid, workspace::grid_on({Vec3(0, 0, z), Vec3::UnitZ()}, low, high, kAcross));
  report::HeatMap map = map_on(grid, "x", "y");
  map.title = fmt::format("chains that reach at z = {} mm", fixed(to_mm(z), 0));
  map.label = "chains";
  for (std::size_t i = 0; i < grid.size(); ++i) {
    int count = 0;
    for (int chain = 0; chain < m.arms; ++chain) {
      const Vec3 X = grid.at(i);
      if (!(reach_of(m, chain, X) >= 0)) continue;
      const double q = drive_roots(m, chain, X).first;
      count += q >= m.range.min && q <= m.range.max ? 1 : 0;
    }
    map.values.push_back(count);
  }
  map.contour_labels = false;
  map.levels = m.arms;
  return map;
}

template <class M>
Result<std::string> page_of(const M& m, const AnyMachine& machine, const workspace::DeltaStudy& study,
                            const workspace::DeltaStudyOptions& options, const std::string& version,
                            const std::string& command) {
  std::vector<std::pair<std::string, std::string>> facts{
      {"machine", machine::name_of(machine)},
      {"family", machine::family_of(machine)},
      {"near-singular",
       fmt::format("a distance below {} mm; a determinant below {:g}", fixed(to_mm(options.d_min), 1), options.h_min)},
      {"grid", fmt::format("{} mm", fixed(to_mm(options.step), 1))}};
  if (!version.empty()) facts.emplace_back("made with", "Polypod " + version);
  report::Report page("Workspace and singular poses of a delta", machine::description_of(machine), facts);

  page.add_section("Two methods");
  page.add_verdict(study.deep.geometry + study.deep.determinant == 0 ? report::Verdict::good : report::Verdict::bad,
                   study.deep.geometry + study.deep.determinant == 0
                       ? fmt::format("No point farther than {} mm inside the limits is near-singular by either method.",
                                     fixed(to_mm(options.border), 0))
                       : fmt::format("Of the {} points farther than {} mm inside the limits {} are near-singular by "
                                     "geometry, {} by determinants.",
                                     study.deep.points, fixed(to_mm(options.border), 0), study.deep.geometry,
                                     study.deep.determinant));
  page.add_text(
      "This answers for the points of the grid and for the limits of the machine: not for the points between them, not "
      "for collisions with workpiece and surroundings, and not for stiffness, speed and load. Near-singular: the "
      "drives "
      "lose a motion of the tool there, or hardly constrain it.");
  report::Table table;
  table.caption = "Points of the grid within all limits, and those deep inside.";
  table.columns = {{"", "", -1},         {"points", "", 0},    {"by geometry", "", 0}, {"by determinants", "", 0},
                   {"by both", "", 0},   {"agree", "%", 2},    {"stretched", "", 0},   {"folded", "", 0},
                   {"rod level", "", 0}, {"poses meet", "", 0}};
  for (const auto& [name, c] : {std::pair{"all", study.all}, std::pair{"deep", study.deep}}) {
    const auto n = [](std::int64_t k) { return static_cast<double>(k); };
    table.rows.push_back({std::string(name), n(c.points), n(c.geometry), n(c.determinant), n(c.both), c.agree_percent(),
                          n(c.stretched), n(c.folded), n(c.level), n(c.flat)});
  }
  page.add_table(table);

  page.add_section("In space");
  workspace::SurfaceOptions surface_options;
  constexpr int kInSpace = 34;
  surface_options.resolution = kInSpace;
  POLYPOD_ASSIGN(surface, workspace::surface(machine, {}, surface_options));
  report::Scene scene;
  scene.title = "The boundary of the workspace, near-singular points and the machine at home";
  report::Mesh mesh;
  std::map<std::string, int> kind_of;
  for (const Vec3& p : surface.points) mesh.points.push_back(mm(p));
  mesh.triangles = surface.triangles;
  for (const int limit : surface.limit) {
    const std::string name = workspace::limit_kind(machine, limit);
    const auto [it, fresh] = kind_of.try_emplace(name, static_cast<int>(scene.kinds.size()));
    if (fresh) scene.kinds.push_back(name);
    mesh.kind.push_back(it->second);
  }
  mesh.opacity = 0.55;
  scene.meshes.push_back(std::move(mesh));
  scene.lines = machine_lines(machine, m.home);
  const std::size_t outline = scene.lines.size();
  report::Line3 near{"near-singular", {}, report::Colour::vermillion, 2.5, true};
  for (const workspace::DeltaPoint& p : study.points)
    if (p.by_geometry || p.by_determinant) near.points.push_back(mm(p.X));
  report::Line3 border{"singular boundary", {}, report::Colour::vermillion, 1.2, true};
  for (const Vec3& X : surface.points)
    if (closeness(m, X).least() < options.d_min) border.points.push_back(mm(X));
  if (!border.points.empty()) scene.lines.push_back(std::move(border));
  if (!near.points.empty()) scene.lines.push_back(std::move(near));
  report::Scene turns = scene;
  add_poses(turns, outline, machine, machine_at(machine, Pose{Mat3::Identity(), m.home}), 0);
  hang(scene);
  hang(turns);
  page.add_scene(scene,
                 "The boundary, coloured by the limit that makes it, with red dots where it is near-singular itself: "
                 "where it is out of reach, two positions of an elbow meet (type 1 singularity). The base is above: z "
                 "of the machine points "
                 "down.",
                 &turns);

  page.add_section("Sections");
  POLYPOD_ASSIGN(box, workspace::extent(machine, {}, false));
  Vec3 clearest = 0.5 * (box.low + box.high);
  double most = 0;
  for (const workspace::DeltaPoint& p : study.points) {
    if (!p.deep || p.close.least() <= most) continue;
    most = p.close.least();
    clearest = p.X;
  }
  std::vector<std::pair<std::string, report::Figure>> panels;
  for (const int normal : {1, 0, 2}) {
    POLYPOD_ASSIGN(map, distance_map(m, machine, clearest, normal, options.d_min));
    panels.emplace_back(map.title, map);
  }
  page.add_figure_grid(
      2, panels,
      "Through the point of the grid that is farthest from singular poses, cut to what is reached. The least of the "
      "three distances of KOZ 4.5.2.2; near-singular points are red. As in the picture above, z points down.");
  page.add_section("Each chain alone");
  std::vector<std::pair<std::string, report::Figure>> levels;
  for (const double share : {0.3, 0.5, 0.7, 0.95}) {
    POLYPOD_ASSIGN(map, chains_map(m, box, box.low.z() + share * (box.high.z() - box.low.z())));
    levels.emplace_back(map.title, map);
  }
  page.add_figure_grid(2, levels,
                       "How many chains reach, within the ranges of their drives; where all do, the tool does.");

  page.add_section("Inputs");
  std::vector<std::pair<std::string, std::string>> inputs;
  for (const machine::Parameter& p : machine::settings(machine)) {
    inputs.emplace_back(p.key, fmt::format("{:.6g} {}", units::to_user(p.value, p.unit), p.unit));
  }
  for (const auto& [key, text] : machine::provenance_of(machine)) inputs.emplace_back("source of " + key, text);
  page.add_definitions(inputs);
  if (!command.empty()) page.add_code("The command that made this page", command, false);
  return page.to_html();
}

}  // namespace

Result<std::string> delta_page(const AnyMachine& machine, const workspace::DeltaStudy& study,
                               const workspace::DeltaStudyOptions& options, const std::string& version,
                               const std::string& command) {
  return std::visit(
      [&]<class M>(const M& m) -> Result<std::string> {
        if constexpr (machine::DeltaFamily<M>) {
          return page_of(m, machine, study, options, version, command);
        } else {
          return fail("WS140", "this page is about deltas", {},
                      "name a machine of family rotary-delta or linear-delta");
        }
      },
      machine);
}

}  // namespace polypod::pages
