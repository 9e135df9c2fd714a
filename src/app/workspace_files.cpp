// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "workspace_files.hpp"
#include "messages.hpp"

#include <fmt/format.h>

#include "polypod/core/files.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/pages/workspace.hpp"

namespace polypod::app {

void WorkspaceFiles::declare(Arguments& a) {
  a.option("--report", report, "An HTML report: picture, sections, volume against tilt, limits");
  a.option("--stl", stl, "The boundary as a closed surface, binary STL in mm");
  a.option("--vtp", vtp, "The same for ParaView, with the limit that makes it");
  a.option("--vti", vti, "A field for ParaView: margin, largest tilt and the limit that stops it");
  a.option("--resolution", resolution, "Points along the longest side of pictures and files, 8 to 512");
}

Status WorkspaceFiles::refuse_unused(const Context& context) const {
  if (!(stl.empty() && vtp.empty() && vti.empty() && report.empty())) return {};
  return refuse(context, {"--resolution"}, "it serves --report, --stl, --vtp and --vti; give one");
}

Status WorkspaceFiles::check(const std::string& machine_file, const Context& context) const {
  if (context.given("--resolution")) POLYPOD_TRY(in_range("AP130", "--resolution", resolution, {8, 512}, "points"));
  return check_files({machine_file}, {stl, vtp, vti, report}, context.json);
}

Status WorkspaceFiles::write(const machine::AnyMachine& m, const workspace::Options& options,
                             const workspace::Volume& v, const std::string& machine_name,
                             const std::vector<std::string>& sets, const Context& context) const {
  const char* current = "";
  std::function<bool(double)> line;
  const auto progress = [&](const char* what, double share) {
    if (what != current) line = progress_line(context, what);
    current = what;
    line(share);
  };
  const auto stage = [&](const char* what) { return [&, what](double share) { progress(what, share); }; };
  std::vector<std::pair<std::string, std::string>> made;  // path and bytes
  if (!stl.empty() || !vtp.empty() || !vti.empty()) {
    POLYPOD_ASSIGN(box, workspace::extent(m, options, !vti.empty()));
    if (box.empty()) return fail("WS131", "no point is reachable: there is nothing to write", {}, "ask for less tilt");
    constexpr int kResolution = 64;
    POLYPOD_ASSIGN(grid, workspace::grid_over(box.low, box.high, resolution > 0 ? resolution : kResolution));
    workspace::FieldOptions field_options;
    field_options.tilt = !vti.empty();
    field_options.progress = stage("field");
    POLYPOD_ASSIGN(field, workspace::field(m, options, grid, field_options));
    if (!vti.empty()) {
      POLYPOD_ASSIGN(image, pages::field_image(field));
      POLYPOD_ASSIGN(bytes, report::to_vti(image));
      made.emplace_back(vti, std::move(bytes));
    }
    if (!stl.empty() || !vtp.empty()) {
      workspace::SurfaceOptions surface_options;
      surface_options.progress = stage("surface");
      POLYPOD_ASSIGN(surface, workspace::surface_of(m, options, field, surface_options));
      if (!stl.empty()) {
        POLYPOD_ASSIGN(bytes, pages::surface_stl(surface));
        made.emplace_back(stl, std::move(bytes));
      }
      if (!vtp.empty()) {
        POLYPOD_ASSIGN(bytes, report::to_vtp(pages::surface_data(surface)));
        made.emplace_back(vtp, std::move(bytes));
      }
    }
  }
  if (!report.empty()) {
    pages::WorkspacePageOptions page;
    page.version = POLYPOD_VERSION;
    page.machine = machine_name;
    page.sets = sets;
    page.command = command_line();
    if (resolution > 0) page.resolution = resolution;
    page.progress = progress;
    const auto make = kinematics::task(m).places() ? pages::workspace_page : pages::region_page;
    POLYPOD_ASSIGN(html, make(m, options, v, page));
    made.emplace_back(report, std::move(html));
  }
  files::Outputs together;
  for (auto& [path, bytes] : made) POLYPOD_TRY(together.add(path, std::move(bytes)));
  return together.commit();
}

}  // namespace polypod::app
