// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "commands.hpp"
#include "measured_problems.hpp"
#include "messages.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/range_text.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/compliance_map.hpp"
#include "polypod/statics/judge.hpp"

namespace polypod::app {
namespace {

using pages::tidy_mm;

constexpr int kMostPerSide = 301;
constexpr double kFarthest_mm = 1e6;  // 1 km: beyond it lies a wrong unit
constexpr double kFarthest_deg = 180;
constexpr int kMostPathPoints = 10'001;

struct MapOptions {
  std::string machine, plane, at, angles, resolution = "41", force, path_csv;
  std::array<std::string, 6> range;  // of x, y, z, A, B, C
  std::vector<std::string> sets, measured, paths, outputs;
  int points = 61;
};

using machine::Coordinate;

using statics::is_angle;

/// "--x", "--a".
std::string option_of(Coordinate c) {
  return fmt::format("--{}", "xyzabc"[static_cast<std::size_t>(c)]);
}

/// "lo,hi" in mm or deg. Errors: AP100, AP141.
Result<std::array<double, 2>> range_of(const std::string& text, Coordinate c) {
  POLYPOD_ASSIGN(n, numbers_of(text, option_of(c)));
  const double farthest = is_angle(c) ? kFarthest_deg : kFarthest_mm;
  if (n.size() != 2 || !(n[0] < n[1]) || std::abs(n[0]) > farthest || std::abs(n[1]) > farthest) {
    return fail("AP141",
                fmt::format("{} {}: not a range lo,hi with lo below hi, in {}", option_of(c), text, pages::unit_of(c)),
                {}, fmt::format("write {} {}", option_of(c), is_angle(c) ? "-30,30" : "-600,600"));
  }
  if (is_angle(c)) return std::array{units::from_deg(n[0]), units::from_deg(n[1])};
  return std::array{units::from_mm(n[0]), units::from_mm(n[1])};
}

using Measured = std::vector<statics::MeasuredPoint>;

/// The rectangle of the measured points of the plane; of all of them, with the margin of a map, where none lies in it
/// or they lie on a line.
statics::Rectangle measured_rectangle(const pages::ComplianceMap& map, const Measured& measured) {
  const statics::PlaneAxes axes = statics::axes_of(map.plane);
  statics::Rectangle out = pages::measured_in(measured, map.plane, map.at).rectangle;
  const auto field = statics::MeasuredMap::of(measured);
  if (!field) return out;  // said later
  for (const auto& [axis, range] : {std::pair{axes.u, &out.u}, std::pair{axes.v, &out.v}}) {
    if ((*range)[1] - (*range)[0] < units::from_mm(1)) *range = {field->low()[axis], field->high()[axis]};
  }
  return out;
}

/// The plane over which the map goes: as --plane says, else that of the measured points, else the usual one.
Result<statics::Plane> plane_of(const MapOptions& o, const machine::Task& task, const Measured& measured) {
  const std::vector<statics::Plane> planes = statics::planes_of(task);
  if (planes.empty()) {
    return fail("WS107", "the machine's task holds one coordinate alone: a map goes over two", {},
                "`polypod compliance --pose` answers for one pose");
  }
  if (!o.plane.empty()) {
    const auto plane = statics::plane_named(o.plane);
    if (!plane) {
      return fail("AP140", fmt::format("--plane {}: not two of x, y, z, A, B, C in this order", o.plane), {},
                  fmt::format("write --plane {}", statics::name_of(planes.front())));
    }
    if (std::find(planes.begin(), planes.end(), *plane) == planes.end()) {
      std::string names;
      for (const statics::Plane& p : planes) names += (names.empty() ? "" : ", ") + statics::name_of(p);
      return fail("AP140", fmt::format("--plane {}: this machine's task goes over {} alone", o.plane, names));
    }
    if (!measured.empty() && !plane->of_positions()) {
      return fail("AP140", fmt::format("--plane {}: measured points are shown over positions", o.plane), {},
                  "choose xy, xz or yz, or leave --measured out");
    }
    return *plane;
  }
  if (const auto first = pages::measured_plane(measured)) return first->plane;
  if (!measured.empty() && o.at.empty()) {
    return fail("AP148", "no plane parallel to two axes holds the first measured point and others round it",
                measured.front().place, "say over which plane with --plane and --at");
  }
  return planes.front();
}

/// Refuses a range of a coordinate over which the map does not go. Error: AP141.
Status ranges_fit(const MapOptions& o, const statics::Plane& plane) {
  for (std::size_t i = 0; i < o.range.size(); ++i) {
    const auto c = static_cast<Coordinate>(i);
    if (o.range[i].empty() || c == plane.u || c == plane.v) continue;
    return fail("AP141",
                fmt::format("{} {}: a map over {} has no range of {}", option_of(c), o.range[i],
                            statics::name_of(plane), machine::name_of(c)),
                {}, "say where the others stand with --at and --angles, or choose another --plane");
  }
  return {};
}

/// The angles across the plane, in the order of the task. Error: AP147.
Status turn(const MapOptions& o, const machine::Task& task, const statics::Plane& plane,
            std::vector<double>& coordinates) {
  if (o.angles.empty()) return {};
  std::vector<std::size_t> turned;
  for (int i = 0; i < task.size(); ++i)
    if (task.is_angle(i) && task[i] != plane.u && task[i] != plane.v) turned.push_back(static_cast<std::size_t>(i));
  POLYPOD_ASSIGN(angles, numbers_of(o.angles, "--angles"));
  if (angles.size() > turned.size()) {
    return fail("AP147",
                fmt::format("--angles {}: {} numbers, but {} {}", o.angles, angles.size(),
                            plane.of_positions() ? "this machine turns its tool by" : "angles beside the map's own are",
                            turned.size()));
  }
  for (std::size_t i = 0; i < turned.size(); ++i)
    coordinates[turned[i]] = i < angles.size() ? units::from_deg(angles[i]) : 0.0;
  return {};
}

/// Where a plane of positions lies. Error: AP141.
Result<double> at_of(const MapOptions& o, const machine::AnyMachine& m, const statics::Plane& plane,
                     const Measured& measured) {
  const int normal = statics::axes_of(plane).normal;
  if (o.at.empty()) return measured.empty() ? kinematics::middle_of_work(m)[normal] : measured.front().X_MT.p[normal];
  if (!kinematics::task(m).holds(static_cast<Coordinate>(normal))) {
    return fail("AP141", fmt::format("--at {}: this machine does not move along {}", o.at, "xyz"[normal]), {},
                "leave --at out");
  }
  POLYPOD_ASSIGN(at, numbers_of(o.at, "--at"));
  if (at.size() != 1 || std::abs(at[0]) > kFarthest_mm) {
    return fail("AP141", fmt::format("--at {}: not one coordinate, in mm", o.at));
  }
  return units::from_mm(at[0]);
}

/// Where the positions across two coordinates of the task stand: as they are, or as --at says. Error: AP141.
Status stand(const MapOptions& o, const machine::Task& task, const statics::Plane& plane,
             std::vector<double>& coordinates) {
  if (o.at.empty()) return {};
  std::string names;
  std::vector<std::size_t> positions;
  for (int i = 0; i < task.size(); ++i) {
    if (task.is_angle(i) || task[i] == plane.u || task[i] == plane.v) continue;
    positions.push_back(static_cast<std::size_t>(i));
    names += fmt::format("{}{}", names.empty() ? "" : ",", machine::name_of(task[i]));
  }
  POLYPOD_ASSIGN(at, numbers_of(o.at, "--at"));
  const bool far = std::any_of(at.begin(), at.end(), [](double x) { return std::abs(x) > kFarthest_mm; });
  if (at.size() != positions.size() || far) {
    return fail("AP141", names.empty() ? fmt::format("--at {}: no position stands beside a map over {}", o.at,
                                                     statics::name_of(plane))
                                       : fmt::format("--at {}: not {}, in mm", o.at, names));
  }
  for (std::size_t i = 0; i < at.size(); ++i) coordinates[positions[i]] = units::from_mm(at[i]);
  return {};
}

/// Where the plane lies and how far the map goes: those of the measured points, if there are any. `found` is false
/// where the machine reaches nothing of it.
Status lay_plane(const MapOptions& o, const Mat3& R_MT, const Measured& measured, pages::ComplianceMap& map,
                 bool& found) {
  if (map.plane.of_positions()) {
    POLYPOD_ASSIGN(at, at_of(o, map.machine, map.plane, measured));
    map.at = at;
  } else {
    POLYPOD_TRY(stand(o, kinematics::task(map.machine), map.plane, map.coordinates));
  }
  const auto text = [&](Coordinate c) { return o.range[static_cast<std::size_t>(c)]; };
  found = true;
  if (!measured.empty()) {
    map.rectangle = measured_rectangle(map, measured);
  } else if (text(map.plane.u).empty() || text(map.plane.v).empty()) {
    const auto reached = map.plane.of_positions()
                             ? statics::reached_rectangle(map.machine, map.plane, map.at, R_MT)
                             : statics::reached_rectangle(map.machine, {map.plane, map.coordinates});
    found = reached.has_value();
    if (found) map.rectangle = *reached;
  }
  for (const auto& [c, range] : {std::pair{map.plane.u, &map.rectangle.u}, std::pair{map.plane.v, &map.rectangle.v}}) {
    if (text(c).empty()) continue;
    POLYPOD_ASSIGN(given, range_of(text(c), c));
    *range = given;
  }
  return {};
}

/// "N" (points on the longer side, square cells as far as whole numbers allow; on both where one is a length and one an
/// angle) or "columns,rows". Error: AP142.
Result<std::array<int, 2>> resolution_of(const std::string& text, const statics::Plane& plane,
                                         const statics::Rectangle& r) {
  POLYPOD_ASSIGN(n, numbers_of(text, "--resolution"));
  const auto bad = [](double x) { return !(x >= 2 && x <= kMostPerSide && x == std::floor(x)); };
  if (n.size() > 2 || std::any_of(n.begin(), n.end(), bad)) {
    return fail("AP142", fmt::format("--resolution {}: not one or two whole numbers of 2 to {}", text, kMostPerSide),
                {}, "points on the longer side, or columns,rows");
  }
  if (n.size() == 2) return std::array{static_cast<int>(n[0]), static_cast<int>(n[1])};
  if (is_angle(plane.u) != is_angle(plane.v)) return std::array{static_cast<int>(n[0]), static_cast<int>(n[0])};
  return pages::grid_counts(r, static_cast<int>(n[0]));
}

/// "x,y,z:x,y,z" in mm. Error: AP144.
Result<pages::LoadedPath> path_of(const std::string& text) {
  const std::size_t colon = text.find(':');
  const auto bad = [&](const char* why) {
    return fail("AP144", fmt::format("--path {}: {}", text, why), {}, "write --path -600,-1300,0:600,-1300,0 (mm)");
  };
  if (colon == std::string::npos) return bad("no two points x,y,z:x,y,z");
  POLYPOD_ASSIGN(from, numbers_of(text.substr(0, colon), "--path"));
  POLYPOD_ASSIGN(to, numbers_of(text.substr(colon + 1), "--path"));
  if (from.size() != 3 || to.size() != 3) return bad("no two points x,y,z:x,y,z");
  pages::LoadedPath path;
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (std::abs(from[k]) > kFarthest_mm || std::abs(to[k]) > kFarthest_mm) return bad("a point is farther than 1 km");
    path.from_M[i] = units::from_mm(from[k]);
    path.to_M[i] = units::from_mm(to[k]);
  }
  if (path.from_M == path.to_M) return bad("the two points are one");
  return path;
}

/// The paths with their force. Errors: AP104, AP144 to AP146.
Result<std::vector<pages::LoadedPath>> paths_of(const MapOptions& o) {
  POLYPOD_TRY(in_range("AP146", "--points", o.points, {2, kMostPathPoints}, "points"));
  std::vector<pages::LoadedPath> out;
  for (const std::string& text : o.paths) {
    POLYPOD_ASSIGN(path, path_of(text));
    out.push_back(std::move(path));
  }
  if (out.empty()) {
    if (!o.force.empty() || !o.path_csv.empty()) {
      return fail("AP145", fmt::format("{} needs a --path", o.force.empty() ? "--path-csv" : "--force"));
    }
    return out;
  }
  if (o.force.empty()) return fail("AP145", "--path needs a --force Fx,Fy,Fz, in N");
  POLYPOD_ASSIGN(f, numbers_of(o.force, "--force"));
  if (f.size() != 3) return fail("AP104", fmt::format("--force {}: not three numbers", o.force));
  const Vec3 force(f[0], f[1], f[2]);
  constexpr config::Range kSize_N{0, 1e9, true};
  if (!(force.norm() > kSize_N.min && force.norm() <= kSize_N.max)) {
    return fail("AP145", fmt::format("--force {}: its size must be {}", o.force, config::in_words(kSize_N, "N")));
  }
  for (pages::LoadedPath& path : out) path.force_M = force;
  return out;
}

std::string suffix_of(const std::string& path) {
  const std::size_t dot = path.find_last_of("./");
  return dot == std::string::npos || path[dot] == '/' ? "" : path.substr(dot);
}

/// Whether every output is of a known kind and can be written. Errors: AP143, those of check_files.
Status check_outputs(const MapOptions& o, bool json) {
  for (const std::string& path : o.outputs) {
    const std::string suffix = suffix_of(path);
    if (suffix != ".csv" && suffix != ".vti" && suffix != ".svg" && suffix != ".html") {
      return fail("AP143", fmt::format("-o {}: not a .csv, .vti, .svg or .html", path));
    }
  }
  std::vector<std::string> inputs = o.measured, outputs = o.outputs;
  inputs.push_back(o.machine);
  outputs.push_back(o.path_csv);
  return check_files(inputs, outputs, json);
}

Status write_outputs(const MapOptions& o, const pages::ComplianceMap& map) {
  files::Outputs together;
  for (const std::string& path : o.outputs) {
    const std::string suffix = suffix_of(path);
    std::string bytes;
    if (suffix == ".csv") {
      bytes = pages::map_csv(map);
    } else if (suffix == ".vti") {
      POLYPOD_ASSIGN(vti, pages::map_vti(map));
      bytes = std::move(vti);
    } else if (suffix == ".svg") {
      bytes = report::standalone_svg(pages::map_picture(map), 1200);
    } else {
      bytes = pages::compliance_map_page(map, {POLYPOD_VERSION, command_line()});
    }
    POLYPOD_TRY(together.add(path, std::move(bytes)));
  }
  if (!o.path_csv.empty()) POLYPOD_TRY(together.add(o.path_csv, pages::path_csv(map)));
  return together.commit();
}

Json mm_json(const Vec3& p) {
  return Json::array({tidy_mm(p.x()), tidy_mm(p.y()), tidy_mm(p.z())});
}

/// Displacements along `direction`, um.
std::vector<double> along(const pages::LoadedPath& path, const Vec3& direction, int joint) {
  std::vector<double> out;
  for (const statics::PathError& e : path.points) {
    if (!e.reachable) continue;
    const double d = units::to_um(direction.dot(joint < 0 ? e.total : e.by_joint[static_cast<std::size_t>(joint)]));
    out.push_back(std::abs(d) <= 1e-12 * units::to_um(e.total.norm()) ? 0.0 : d);
  }
  return out;
}

Json spread_json(const std::vector<double>& values) {
  const pages::Extremes e = pages::extremes_of(values);
  return {{"min", e.min}, {"mean", e.mean}, {"max", e.max}};
}

Json path_json(const pages::ComplianceMap& map, const pages::LoadedPath& path) {
  const Vec3 direction = path.force_M.normalized();
  const std::vector<std::string> names = statics::column_names(map.machine);
  Json by_joint = Json::array();
  for (std::size_t k = 0; k < names.size(); ++k) {
    Json entry = {{"joint", names[k]}};
    entry.update(spread_json(along(path, direction, static_cast<int>(k))));
    by_joint.push_back(entry);
  }
  Json force = spread_json(along(path, direction, -1));
  force["by_joint"] = by_joint;
  return {{"from_mm", mm_json(path.from_M)},
          {"to_mm", mm_json(path.to_M)},
          {"force_N", vector_json(path.force_M)},
          {"points", path.points.size()},
          {"out_of_reach", path.points.size() - static_cast<std::size_t>(pages::reached(path))},
          {"displacement_um",
           {{"x", spread_json(along(path, Vec3::UnitX(), -1))},
            {"y", spread_json(along(path, Vec3::UnitY(), -1))},
            {"z", spread_json(along(path, Vec3::UnitZ(), -1))}}},
          {"along_force_um", force}};
}

std::string entry_name(int row, int column) {
  return fmt::format("C_{}{}", "xyz"[row], "xyz"[column]);
}

/// The largest difference of an entry, at that reading.
std::size_t worst_at(const statics::Compared& c, int row, int column) {
  return c.worst[static_cast<std::size_t>(row)][static_cast<std::size_t>(column)];
}

Json measured_json(const pages::MeasuredCompliance& m) {
  const statics::Compared& c = m.compared;
  Json fields = Json::object();
  for (const auto& [row, column] : statics::kEntryPlaces) {
    const auto um = [&, i = row, j = column](const Mat3& C) { return units::to_um_per_N(C(i, j)); };
    const std::size_t worst = worst_at(c, row, column);
    fields[entry_name(row, column) + "_um_per_N"] = {{"difference_rms_um_per_N", um(c.rms)},
                                                     {"difference_max_um_per_N", std::abs(um(c.difference[worst]))},
                                                     {"difference_max_at_mm", mm_json(m.judged[worst].X_MT.p)},
                                                     {"noise_um_per_N", um(c.noise)},
                                                     {"deviation_mean_um_per_N", um(c.deviation)},
                                                     {"apart_percent", 100 * m.beyond(row, column)}};
  }
  return {{"points", m.points},
          {"judged", m.judged.size()},
          {"in_plane", m.in_plane},
          {"correlation_length_mm", units::to_mm(m.map.correlation_length())},
          {"difference_rms_um_per_N", units::to_um_per_N(c.rms_of_all)},
          {"noise_um_per_N", units::to_um_per_N(c.noise_of_all)},
          {"explained", pages::explained(m)},
          {"fields", fields}};
}

Json map_json(const pages::ComplianceMap& map, const std::vector<std::string>& written) {
  const bool over_positions = map.plane.of_positions();
  const auto key_of = [](Coordinate c) {
    return fmt::format("{}_{}", "xyzabc"[static_cast<std::size_t>(c)], pages::unit_of(c));
  };
  const auto range = [](Coordinate c, const std::array<double, 2>& r) {
    return Json::array({pages::tidy(c, r[0]), pages::tidy(c, r[1])});
  };
  Json fields = Json::object();
  for (const pages::Field& f : pages::fields_of(map)) {
    const pages::Extremes e = pages::extremes_of(f.values);
    if (e.min_at < 0) continue;
    const auto place = [&](int point) -> Json {
      if (over_positions) return mm_json(map.map.points[static_cast<std::size_t>(point)].p_M);
      return pages::coordinates_at(map, point);
    };
    const std::string at = over_positions ? "_at_mm" : "_at";
    fields[f.key] = {
        {"min", e.min}, {"min" + at, place(e.min_at)}, {"mean", e.mean}, {"max", e.max}, {"max" + at, place(e.max_at)}};
  }
  // Of other planes where every coordinate beside the two stands.
  Json at = Json::object();
  const machine::Task task = kinematics::task(map.machine);
  for (int i = 0; !over_positions && i < task.size(); ++i) {
    if (task[i] != map.plane.u && task[i] != map.plane.v)
      at[key_of(task[i])] = pages::tidy(task[i], map.coordinates[static_cast<std::size_t>(i)]);
  }
  Json paths = Json::array();
  for (const pages::LoadedPath& path : map.paths) paths.push_back(path_json(map, path));
  Json document{{"machine", machine::name_of(map.machine)}, {"plane", statics::name_of(map.plane)}};
  if (over_positions) {
    document["at_mm"] = tidy_mm(map.at);
    document["angles_deg"] = map.angles_deg;
  } else {
    document["at"] = at;
  }
  document.update({{"grid",
                    {{key_of(map.plane.u), range(map.plane.u, map.rectangle.u)},
                     {key_of(map.plane.v), range(map.plane.v, map.rectangle.v)},
                     {"columns", map.map.grid.columns},
                     {"rows", map.map.grid.rows}}},
                   {"points", map.map.points.size()},
                   {"out_of_reach", map.map.points.size() - static_cast<std::size_t>(pages::reached(map.map))},
                   {"both_signs_of_det_J", pages::both_signs(map)},
                   {"fields", fields},
                   {"paths", paths},
                   {"files", written}});
  if (map.measured) document["measured"] = measured_json(*map.measured);
  return document;
}

/// "C_xx" to "C_yz" against the readings.
void print_measured(const pages::ComplianceMap& map) {
  const pages::MeasuredCompliance& m = *map.measured;
  const statics::Compared& c = m.compared;
  fmt::print("\n{}\n", pages::measured_verdict(map, true));
  fmt::print("measured less computed at {} points{}, um/N; readings correlated over {:.0f} mm\n", m.judged.size(),
             m.in_plane ? " of the plane" : ", none in the plane", units::to_mm(m.map.correlation_length()));
  fmt::print("{:<20}{:>10}{:>10}{:>10}{:>12}  {}\n", "", "rms", "max", "noise", "deviation", "apart by 2 deviations");
  for (const auto& [row, column] : statics::kEntryPlaces) {
    const auto um = [&, i = row, j = column](const Mat3& C) { return units::to_um_per_N(C(i, j)); };
    fmt::print("{:<20}{:>#10.3g}{:>#10.3g}{:>#10.3g}{:>#12.3g}  {:.0f} % of the map\n", entry_name(row, column),
               um(c.rms), std::abs(um(c.difference[worst_at(c, row, column)])), um(c.noise), um(c.deviation),
               100 * m.beyond(row, column));
  }
}

void print_table(const pages::ComplianceMap& map) {
  const auto place = [&](int point) {
    const auto [u, v] = pages::coordinates_at(map, point);
    const auto hundredths = [](double value) { return std::round(value * 100) / 100; };
    return fmt::format("{:g}, {:g}", hundredths(u), hundredths(v));
  };
  const char *u_unit = pages::unit_of(map.plane.u), *v_unit = pages::unit_of(map.plane.v);
  const std::string at =
      fmt::format("at {}{}, {} {}", machine::name_of(map.plane.u), u_unit == v_unit ? "" : fmt::format(" {}", u_unit),
                  machine::name_of(map.plane.v), v_unit);
  fmt::print("{:<20}{:>10}  {:<16}{:>10}{:>10}  {}\n", "", "min", at, "mean", "max", at);
  for (const pages::Field& f : pages::fields_of(map)) {
    const pages::Extremes e = pages::extremes_of(f.values);
    // Of the joints' shares those in the direct compliances, if there are any: the files hold them all.
    if (f.kind == pages::Field::Kind::share && (f.row != f.column || (e.min == 0 && e.max == 0))) continue;
    if (f.kind == pages::Field::Kind::deviation) continue;  // its mean stands below
    std::string name = f.joint.empty() ? f.name : fmt::format("  {} {}", f.joint, f.name);
    if (!f.unit.empty()) name += ", " + f.unit;
    // A quantity that is the same everywhere has no place.
    const bool flat = e.max == e.min;
    fmt::print("{:<20}{:>10.4g}  {:<16}{:>10.4g}{:>10.4g}  {}\n", name, e.min, flat ? "" : place(e.min_at), e.mean,
               e.max, flat ? "" : place(e.max_at));
  }
}

void print_path(const pages::ComplianceMap& map, const pages::LoadedPath& path) {
  const auto point = [](const Vec3& p) {
    return fmt::format("{:g},{:g},{:g}", tidy_mm(p.x()), tidy_mm(p.y()), tidy_mm(p.z()));
  };
  fmt::print("\nfrom {} to {} mm under {:g},{:g},{:g} N: {} points", point(path.from_M), point(path.to_M),
             path.force_M.x(), path.force_M.y(), path.force_M.z(), path.points.size());
  const std::size_t out = path.points.size() - static_cast<std::size_t>(pages::reached(path));
  fmt::print("{}\n", out == 0 ? "" : fmt::format(", {} out of reach", out));
  fmt::print("{:<20}{:>10}{:>10}{:>10}\n", "displacement, um", "min", "mean", "max");
  const auto line = [](const std::string& name, const std::vector<double>& values) {
    const pages::Extremes e = pages::extremes_of(values);
    fmt::print("{:<20}{:>10.1f}{:>10.1f}{:>10.1f}\n", name, e.min, e.mean, e.max);
  };
  for (int i = 0; i < 3; ++i) line(fmt::format("along {}", "xyz"[i]), along(path, Vec3::Unit(i), -1));
  const Vec3 direction = path.force_M.normalized();
  line("along the force", along(path, direction, -1));
  const std::vector<std::string> names = statics::column_names(map.machine);
  for (std::size_t k = 0; k < names.size(); ++k) {
    line("  " + names[k], along(path, direction, static_cast<int>(k)));
  }
}

void print_map(const MapOptions& o, const pages::ComplianceMap& map) {
  const std::string orientation = pages::orientation_of(map);
  fmt::print("{} over {}{}\n", one_line(machine::name_of(map.machine)), pages::domain_of(map),
             orientation.empty() ? "" : ", " + orientation);
  const statics::Plane& plane = map.plane;
  const auto range = [](Coordinate c, const std::array<double, 2>& r) {
    return fmt::format("{} {:g} .. {:g}", machine::name_of(c), pages::tidy(c, r[0]), pages::tidy(c, r[1]));
  };
  const std::string u = range(plane.u, map.rectangle.u), v = range(plane.v, map.rectangle.v);
  const std::string ranges = is_angle(plane.u) == is_angle(plane.v)
                                 ? fmt::format("{}, {} {}", u, v, pages::unit_of(plane.v))
                                 : fmt::format("{} {}, {} {}", u, pages::unit_of(plane.u), v, pages::unit_of(plane.v));
  const std::size_t out = map.map.points.size() - static_cast<std::size_t>(pages::reached(map.map));
  fmt::print("{}: {} x {} points, {} out of reach\n\n", ranges, map.map.grid.columns, map.map.grid.rows,
             out == 0 ? std::string("none") : std::to_string(out));
  print_table(map);
  if (pages::both_signs(map)) fmt::print("\n{}\n", pages::kBothSigns);
  if (map.measured) print_measured(map);
  for (const pages::LoadedPath& path : map.paths) print_path(map, path);
  for (const std::string& path : o.outputs) fmt::print("wrote {}\n", path);
  if (!o.path_csv.empty()) fmt::print("wrote {}\n", o.path_csv);
}

/// Error: AP149.
Status same_axis(const Mat3& R_MT, const statics::MeasuredPoint& point, const pages::ComplianceMap& map) {
  const double apart = angle_between(R_MT.col(2), point.X_MT.R.col(2));
  if (apart <= statics::MeasuredMap::kOneDirection) return {};
  const std::string turned = pages::orientation_of(map);
  return fail("AP149",
              fmt::format("the displacements were measured with the tool {:.1f} deg away from {}", units::to_deg(apart),
                          turned.empty() ? "the axis of this machine's tool" : turned),
              point.place, "a map holds for one direction of the tool: leave --angles out, or give those of the file");
}

Result<int> run_map(const MapOptions& o, const Context& context) {
  if (o.paths.empty()) POLYPOD_TRY(refuse(context, {"--points"}, "it serves --path; give a path"));
  POLYPOD_TRY(check_outputs(o, context.json));
  POLYPOD_ASSIGN(m, machine_of(o.machine, o.sets));
  pages::ComplianceMap map{m, {}, {}, {}, {}, {}, {}, {}};
  POLYPOD_ASSIGN(read, statics::read_displacements(o.measured));
  const Measured& measured = read.points;
  if (!measured.empty()) POLYPOD_TRY(needs_compliance(m));
  const statics::Judgement judgement = statics::judge(m, measured);
  if (!judgement.errors.empty()) return tl::unexpected(judgement.errors.front());
  const SingularNote singular(m, context);
  if (const auto no = singular.refusal({"fields"})) return *no;
  const machine::Task task = kinematics::task(m);
  POLYPOD_ASSIGN(plane, plane_of(o, task, measured));
  map.plane = plane;
  POLYPOD_TRY(ranges_fit(o, plane));
  std::vector<double> coordinates = statics::middle_coordinates(m);
  if (!measured.empty()) coordinates = kinematics::coordinates_of(task, measured.front().X_MT);
  POLYPOD_TRY(turn(o, task, plane, coordinates));
  if (plane.of_positions()) {
    for (int i = 0; i < task.size(); ++i)
      if (task.is_angle(i)) map.angles_deg.push_back(pages::tidy(task[i], coordinates[static_cast<std::size_t>(i)]));
  }
  map.coordinates = coordinates;
  const Mat3 R_MT = kinematics::pose_of(task, coordinates).R;
  if (!measured.empty()) POLYPOD_TRY(same_axis(R_MT, measured.front(), map));

  POLYPOD_ASSIGN(paths, paths_of(o));
  if (!paths.empty() && !plane.of_positions()) {
    return fail("AP144",
                fmt::format("--path: a map over {} has no paths; they go through positions", statics::name_of(plane)),
                {}, "choose --plane xy, xz or yz");
  }
  if (!paths.empty()) POLYPOD_TRY(needs_compliance(m));
  bool found = false;
  POLYPOD_TRY(lay_plane(o, R_MT, measured, map, found));
  POLYPOD_ASSIGN(count, resolution_of(o.resolution, plane, map.rectangle));
  if (found) {
    map.map =
        plane.of_positions()
            ? statics::compliance_map(m, statics::plane_grid(plane, map.at, map.rectangle, count[0], count[1]), R_MT)
            : statics::compliance_map(m, {plane, map.coordinates}, map.rectangle, count[0], count[1]);
    found = pages::reached(map.map) > 0;
  }
  const auto out_of_reach = [&](const std::string& what) {
    fmt::print(stderr, "polypod: {} reaches no point of {}; {}\n", one_line(machine::name_of(m)), what,
               "try another --at, range or --angles (`polypod workspace` says what is reached)");
    if (context.json) print_json(singular.in(map_json(map, {})));
    return kAnswerIsNo;
  };
  if (!found) return out_of_reach(pages::domain_of(map));
  for (std::size_t k = 0; k < paths.size(); ++k) {
    pages::LoadedPath& path = paths[k];
    path.points = statics::path_error(m, path.from_M, path.to_M, o.points, R_MT, path.force_M);
    if (pages::reached(path) == 0) return out_of_reach("the path " + o.paths[k]);
  }
  map.paths = std::move(paths);
  if (!measured.empty()) {
    POLYPOD_ASSIGN(beside, pages::measured_over(map, measured));
    for (const Error& doubt : judgement.doubts) beside.doubts.push_back(doubt.message);
    map.measured = std::move(beside);
  }
  if (const Status compliant = statics::needs_compliance(m); !compliant) {
    fmt::print(stderr, "polypod: {} has no compliances, only det J is mapped; {}\n", one_line(machine::name_of(m)),
               compliant.error().hint);
  }
  POLYPOD_TRY(write_outputs(o, map));
  if (context.json) {
    std::vector<std::string> written = o.outputs;
    if (!o.path_csv.empty()) written.push_back(o.path_csv);
    Json document = map_json(map, written);
    if (map.measured) {
      document["measured"]["doubts"] = problems_json(judgement.doubts);
      document["measured"]["unused_columns"] = read.unused_columns;
    }
    print_json(singular.in(document));
  } else {
    print_map(o, map);
    print_doubts(judgement.doubts);
    print_unused(read.unused_columns);
  }
  return kDone;
}

}  // namespace

Command map_command() {
  auto o = std::make_shared<MapOptions>();
  return {
      "map",
      "Maps over a plane or over tilts: compliances, det J, each joint's contribution, errors along straight paths",
      "polypod map lola50 --at 0 --x -600,600 --y -1600,-1000 -o map.html",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.options(
            "--measured", o->measured,
            "Displacements measured under known forces (CSV files as for identify compliance), to be shown beside "
            "the computed compliances; plane, range and orientation are theirs if not given");
        a.option("--plane", o->plane,
                 "Two coordinates of the task: xy (default), xz or yz of M, AB for the tilts (default where the task "
                 "does not hold two of x, y, z), or one of each, such as zA");
        a.option("--at", o->at,
                 "The plane's third coordinate, mm; of a map over angles where the tool tip stands, x,y,z as far as "
                 "the task holds them (default: a hexapod's tool at home, the origin of M of an arm)");
        a.option("--x", o->range[0], "lo,hi: range of x, mm (default: what is reached of the plane)");
        a.option("--y", o->range[1], "lo,hi: range of y, mm");
        a.option("--z", o->range[2], "lo,hi: range of z, mm");
        a.option("--a", o->range[3], "lo,hi: range of A, deg (default: what is reached within -45 .. 45)");
        a.option("--b", o->range[4], "lo,hi: range of B, deg");
        a.option("--c", o->range[5], "lo,hi: range of C, deg (default: what is reached within -180 .. 180)");
        a.option("--angles", o->angles,
                 "A,B[,C]: orientation of the tool, deg (default 0); of a map over angles those that it does not go "
                 "over");
        a.option("--resolution", o->resolution, "Points on the longer side, 2 to 301 (default 41), or columns,rows");
        a.option("--path", o->paths, "x,y,z:x,y,z: a straight path, mm, for the error under --force (repeatable)");
        a.option("--force", o->force, "Fx,Fy,Fz: constant force on the tool along the paths, in M, N");
        a.option("--points", o->points, "Points of a path, 2 to 10001 (default 61)");
        a.option("-o,--output", o->outputs,
                 "Write a page (.html), a picture (.svg), a table (.csv) or a file for ParaView (.vti) (repeatable)");
        a.option("--path-csv", o->path_csv, "Write the errors along the paths as a table");
      },
      [o](const Context& context) { return run_map(*o, context); }};
}

}  // namespace polypod::app
