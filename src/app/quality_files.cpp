// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "quality_files.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/pages/workspace.hpp"
#include "workspace_options.hpp"

namespace polypod::app {

using pages::QualityValue;

void QualityFiles::declare(Arguments& a) {
  const bool errors = value == QualityValue::position;
  a.option("--report", report,
           "An HTML report: errors, conditioning, sections, near-singular poses, pictures in space");
  a.option("--csv", csv, "A row a point: errors and conditioning, means and worst over the directions");
  a.option("--vti", vti, "The same as a field for ParaView");
  a.option("--below", below,
           errors ? "A mean error of the tip, mm: the region of --stl and of the report"
                  : "A mean condition number: the region of --stl and of the report");
  a.option("--stl", stl, "Where the mean is at most --below, as a closed surface, binary STL in mm");
  a.option("--svg", svg,
           errors ? "The mean error over the plane --plane" : "The mean condition over the plane --plane");
  a.option("--plane", plane, "xy, xz or yz, for --svg; of a task without x, y, z two of its coordinates, as zA");
  a.option("--at", at, "Coordinate of that plane on the third axis, mm, or deg of an angle (default 0)");
}

std::vector<const std::string*> QualityFiles::paths() const {
  std::vector<const std::string*> out;
  for (const std::string* path : {&report, &csv, &vti, &stl, &svg})
    if (!path->empty()) out.push_back(path);
  return out;
}

bool QualityFiles::any() const {
  return !paths().empty();
}

Result<std::pair<int, double>> QualityFiles::section(const machine::AnyMachine& machine) const {
  const machine::Task task = kinematics::task(machine);
  if (workspace::coordinates_of_points(task) < 2) {
    return fail("AP170", "a workspace of one coordinate has no section", {}, "--csv gives its points");
  }
  const auto axis = normal_of(task, plane);
  if (!axis) {
    return fail("AP170", fmt::format("--plane {}: not {}", plane, plane_names(task)), {}, "--svg needs a --plane");
  }
  const bool whole = workspace::coordinates_of_points(task) < 3;
  if (whole && !at.empty()) return fail("AP170", "--at does nothing: the workspace has two coordinates");
  POLYPOD_ASSIGN(numbers, numbers_of(at.empty() ? "0" : at, "--at"));
  if (numbers.size() != 1) return fail("AP171", fmt::format("--at {}: not one number", at));
  return std::pair{*axis, units::from_user(numbers[0], whole ? "mm" : workspace::unit_of(task, *axis))};
}

Result<std::optional<double>> QualityFiles::threshold() const {
  if (below.empty()) {
    if (stl.empty()) return std::optional<double>();
    return fail("AP172", "--stl needs --below", {}, "the surface encloses where the mean is at most --below");
  }
  POLYPOD_ASSIGN(numbers, numbers_of(below, "--below"));
  if (numbers.size() != 1 || !(numbers[0] > 0))
    return fail("AP172", fmt::format("--below {}: not one number above 0", below));
  if (stl.empty() && report.empty()) return fail("AP172", "--below says nothing without --stl or --report");
  return std::optional(numbers[0]);
}

Status QualityFiles::check(const machine::AnyMachine& machine, bool at_pose, const std::string& machine_file,
                           bool json) const {
  if (at_pose && any()) {
    return fail("AP173", "files are of the whole workspace, not of one pose", {}, "leave out --pose, or the files");
  }
  if (!kinematics::task(machine).places() && !(stl.empty() && vti.empty())) {
    return fail(
        "WS107",
        fmt::format("{} does not hold x, y, z in its task: surfaces and fields of its quality are over positions",
                    machine::name_of(machine)),
        {}, "--report and --svg have sections over the coordinates of its task, --csv its points");
  }
  POLYPOD_TRY(threshold());
  if (svg.empty() && !(plane.empty() && at.empty())) return fail("AP170", "--plane and --at go with --svg");
  if (!svg.empty()) POLYPOD_TRY(section(machine));
  std::vector<std::string> seen;
  for (const std::string* path : paths()) {
    if (std::find(seen.begin(), seen.end(), *path) != seen.end()) {
      return fail("AP174", fmt::format("{}: named for two files", *path));
    }
    seen.push_back(*path);
  }
  return check_files({machine_file}, seen, json);
}

Status QualityFiles::write(const QualityWork& w) const {
  std::vector<std::pair<std::string, std::string>> made;  // path and bytes
  POLYPOD_ASSIGN(limit, threshold());
  if (!csv.empty()) made.emplace_back(csv, pages::quality_csv(w.fields));
  if (!vti.empty()) {
    POLYPOD_ASSIGN(image, pages::quality_image(w.fields));
    POLYPOD_ASSIGN(bytes, report::to_vti(image));
    made.emplace_back(vti, std::move(bytes));
  }
  if (!stl.empty()) {
    POLYPOD_ASSIGN(surface, pages::quality_surface(w.machine, w.options, w.fields, value, *limit));
    POLYPOD_ASSIGN(bytes, pages::surface_stl(surface));
    made.emplace_back(stl, std::move(bytes));
  }
  if (!svg.empty()) {
    POLYPOD_ASSIGN(where, section(w.machine));
    constexpr int kResolution = 96;
    POLYPOD_ASSIGN(figure, pages::quality_section(w.machine, w.options, w.question, where.first, where.second,
                                                  kResolution, value));
    constexpr double kWidth = 760;
    made.emplace_back(svg, report::standalone_svg(figure, kWidth));
  }
  if (!report.empty()) {
    pages::QualityPageOptions page = w.page;
    page.version = POLYPOD_VERSION;
    page.region = value;
    page.below = limit;
    POLYPOD_ASSIGN(html, pages::quality_page(w.machine, w.options, w.question, w.fields, page));
    made.emplace_back(report, std::move(html));
  }
  files::Outputs together;
  for (auto& [path, bytes] : made) POLYPOD_TRY(together.add(path, std::move(bytes)));
  return together.commit();
}

void QualityFiles::print() const {
  for (const std::string* path : paths()) fmt::print("wrote {}\n", *path);
}

void set_resolution(pages::QualityPageOptions& page, const SurveyArguments& where, const Context& context) {
  constexpr int kLeast = 8;  // of a section
  if (context.given("--resolution")) page.resolution = page.resolution_in_space = std::max(kLeast, where.resolution);
}

}  // namespace polypod::app
