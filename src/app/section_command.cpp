// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>

#include "busy_line.hpp"
#include "commands.hpp"
#include "messages.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/pages/workspace.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "survey_options.hpp"
#include "workspace_options.hpp"

namespace polypod::app {
namespace {

struct Options {
  std::string machine, plane, at, point, normal, csv, svg;
  std::vector<std::string> sets;
  int resolution = 80;
  WorkspaceOptions workspace;
};

Result<Vec3> three_of(const std::string& text, const char* option) {
  POLYPOD_ASSIGN(n, numbers_of(text, option));
  if (n.size() != 3) return fail("AP131", fmt::format("{} {}: not three numbers", option, text));
  return Vec3(n[0], n[1], n[2]);
}

Result<workspace::Plane> plane_of(const Options& o, const machine::Task& task) {
  workspace::Plane plane;
  const int coordinates = workspace::coordinates_of_points(task);
  if (coordinates < 2)
    return fail("AP131", "a workspace of one coordinate has no section", {}, "`workspace` gives its ends");
  const bool whole = coordinates == 2;  // the only plane there is
  const std::string names = plane_names(task);
  if (o.plane.empty() == o.normal.empty() || (o.point.empty() != o.normal.empty())) {
    return fail("AP131", "the plane must be given once", {},
                task.places() ? "give --plane xy --at MM, or --point x,y,z --normal x,y,z"
                : whole       ? fmt::format("give --plane {}", names)
                              : fmt::format("give --plane {} --at {}", names, "VALUE of the third coordinate"));
  }
  if (!o.normal.empty()) {
    if (!o.at.empty()) return fail("AP131", "--at goes with --plane, not with --normal");
    POLYPOD_ASSIGN(point, three_of(o.point, "--point"));
    POLYPOD_ASSIGN(normal, three_of(o.normal, "--normal"));
    plane.point = units::from_mm(1) * point;
    plane.normal = normal;
    return plane;
  }
  int axis = 2;
  if (whole && !o.at.empty()) return fail("AP131", "--at does nothing: the workspace has two coordinates");
  if (const auto found = normal_of(task, o.plane)) {
    axis = *found;
  } else {
    return fail("AP131", fmt::format("--plane {}: not {}", o.plane, names));
  }
  POLYPOD_ASSIGN(at, numbers_of(o.at.empty() ? "0" : o.at, "--at"));
  if (at.size() != 1) return fail("AP131", fmt::format("--at {}: not one number", o.at));
  plane.normal = Vec3::Unit(axis);
  plane.point = units::from_user(at[0], workspace::unit_of(task, axis)) * plane.normal;
  return plane;
}

}  // namespace

Command section_command() {
  auto o = std::make_shared<Options>();
  return {"section", "Largest tilt over a plane, and the limit that stops it; the workspace's boundary in that plane",
          "polypod section hexapod-strut --plane xz --at 0 --tilt 20 --svg section.svg",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--plane", o->plane, "xy, xz or yz; of a task without x, y, z two of its coordinates, as zA");
            a.option("--at", o->at, "Coordinate of that plane on the third axis, mm, or deg of an angle (default 0)");
            a.option("--point", o->point, "x,y,z: a point of any other plane, mm");
            a.option("--normal", o->normal, "x,y,z: and its normal");
            a.option("--csv", o->csv, "A row a point: margin, largest tilt, limits");
            a.option("--svg", o->svg, "The picture");
            a.option("--resolution", o->resolution, "Points along the longer side, 8 to 512 (default 80)");
            o->workspace.declare_directions(a);
            o->workspace.declare_limits(a);
            o->workspace.declare_threads(a);
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_ASSIGN(options, o->workspace.options(m, context));
            const machine::Task task = kinematics::task(m);
            POLYPOD_ASSIGN(plane, plane_of(*o, task));
            POLYPOD_TRY(in_range("WS130", "--resolution", o->resolution, {8, 512}, "points"));
            POLYPOD_TRY(check_files({o->machine}, {o->csv, o->svg}, context.json));
            const SingularNote singular(m, context);
            options.progress = nullptr;
            workspace::FieldOptions field_options;
            field_options.tilt = workspace::tilts(task);
            BusyLine busy(context, "looking for what is reached");
            field_options.progress = [&busy, line = progress_line(context, "section")](double share) {
              busy.end();
              line(share);
            };
            POLYPOD_ASSIGN(s, workspace::section(m, options, plane, o->resolution, field_options));
            busy.end();
            const workspace::BeyondSingular beyond = workspace::beyond_singular(m, options, s.field);
            const std::string csv = o->csv.empty() ? "" : pages::section_csv(m, s);
            const std::string svg =
                o->svg.empty() ? "" : report::standalone_svg(pages::section_picture(m, options, s), 760);
            files::Outputs together;
            if (!o->csv.empty()) POLYPOD_TRY(together.add(o->csv, csv));
            if (!o->svg.empty()) POLYPOD_TRY(together.add(o->svg, svg));
            POLYPOD_TRY(together.commit());

            double most = -1;
            Vec3 at = Vec3::Zero();
            std::map<std::string, int> stopped;
            int reached = 0, not_stopped = 0;
            const workspace::Field& f = s.field;
            for (std::size_t i = 0; i < f.grid.size(); ++i) {
              if (f.tilt.empty()) {
                if (f.margin[i] < 0) continue;
                ++reached;
                if (f.margin[i] <= most) continue;
                most = f.margin[i];
                at = f.grid.at(i);
                continue;
              }
              if (f.tilt[i] < 0) continue;
              ++reached;
              f.tilt_limit[i] >= 0 ? ++stopped[workspace::limit_kind(m, f.tilt_limit[i])] : ++not_stopped;
              if (f.tilt[i] > most) {
                most = f.tilt[i];
                at = f.grid.at(i);
              }
            }
            std::vector<std::pair<std::string, int>> limits(stopped.begin(), stopped.end());
            std::stable_sort(limits.begin(), limits.end(),
                             [](const auto& a, const auto& b) { return a.second > b.second; });
            const auto share = [&](int count) { return 100.0 * count / std::max(1, reached); };
            const char *of_u = workspace::unit_along(task, f.grid.step[0]),
                       *of_v = workspace::unit_along(task, f.grid.step[1]);
            const double area = s.area * units::to_user(1, of_u) * units::to_user(1, of_v);
            const std::string area_unit = unit_of_product({of_u, of_v});
            if (context.json) {
              Json list = Json::array();
              for (const auto& [name, count] : limits)
                list.push_back({{"limit", name}, {"area_percent", share(count)}});
              Json document{{"area_mm2", area_unit == "mm2" ? Json(area) : Json()},
                            {"points", f.grid.size()},
                            {"reached_points", reached}};
              if (!task.places()) {
                document["area"] = area;
                document["area_unit"] = area_unit;
              }
              const bool tilts = !f.tilt.empty();
              const std::string unit = task.places() ? "_mm" : "";
              const auto shown = [&](const Vec3& p) { return point_json(task, p); };
              document[tilts ? "largest_tilt_deg" : "largest_margin_mm"] =
                  reached > 0 ? Json(tilts ? units::to_deg(most) : units::to_mm(most)) : Json();
              document[(tilts ? "largest_tilt_at" : "largest_margin_at") + unit] = reached > 0 ? shown(at) : Json();
              document["stopped_by"] = list;
              if (tilts) document["not_stopped_percent"] = share(not_stopped);
              document["beyond_singular"] = beyond_json(beyond);
              Json loops = Json::array();
              for (const workspace::Loop& loop : s.border) {
                Json points = Json::array();
                for (const Vec3& p : loop) points.push_back(shown(p));
                loops.push_back(points);
              }
              document["boundary" + unit] = loops;
              print_json(singular.in(document));
            } else {
              // The border is found on the edges of the grid: four digits hold with the usual 80 points.
              constexpr int kHold = 4;
              const double unit = area > 0 ? std::pow(10.0, std::floor(std::log10(area)) + 1 - kHold) : 1.0;
              fmt::print("area     about {} {} reached{}, from {} points\n",
                         figure(unit * std::round(area / unit), unit >= 1 ? 0 : 1), area_unit,
                         task.places() ? " from every required direction" : "", f.grid.size());
              if (reached > 0 && f.tilt.empty()) {
                fmt::print("inside   by up to {} mm, at {}\n", figure(units::to_mm(most), 1), place_text(at, task));
              } else if (reached > 0) {
                fmt::print("tilt     up to {:.1f} deg at every azimuth, at {}\n", units::to_deg(most), place_text(at));
              }
              if (not_stopped > 0)
                fmt::print("stopped  {:4.1f} %  by nothing: no tilt above {:.1f} deg is looked at\n",
                           share(not_stopped), units::to_deg(most));
              for (const auto& [name, count] : limits) fmt::print("stopped  {:4.1f} %  {}\n", share(count), name);
              fmt::print("{}", beyond_text(m, beyond, "points of the section that were looked at",
                                           "Area and best place include"));
              for (const std::string* path : {&o->csv, &o->svg})
                if (!path->empty()) fmt::print("wrote {}\n", *path);
            }
            return s.border.empty() ? kAnswerIsNo : kDone;
          }};
}

}  // namespace polypod::app
