// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pictures, files and the page of a workspace.
#pragma once

#include <functional>
#include <string>

#include "polypod/report/plot.hpp"
#include "polypod/report/vtk.hpp"
#include "polypod/workspace/surface.hpp"

namespace polypod::pages {

/// The largest tilt at every azimuth as shade and the kind of limit that stops it as colour, with the boundary of the
/// workspace of the required directions as a line; mm and deg.
report::Figure section_picture(const machine::AnyMachine& machine, const workspace::Options& options,
                               const workspace::Section& section);
/// A row a point: x_mm, y_mm, z_mm, margin_mm, limit, tilt_deg (empty where R = 1 is not reachable), tilt_limit.
std::string section_csv(const machine::AnyMachine& machine, const workspace::Section& section);

/// Point arrays margin_mm and limit, and, where the field has them, tilt_deg (NaN where R = 1 is out of reach) and
/// tilt_limit; limits by their number, -1 for none, 64 for out of reach. Lengths in mm. Errors: RE101 for a grid that
/// is not parallel to M's axes.
Result<report::VtkImage> field_image(const workspace::Field& field);
/// Point array `limit`. Lengths in mm.
report::VtkPolyData surface_data(const workspace::Surface& surface);
/// Binary STL in mm. Errors: RE103.
Result<std::string> surface_stl(const workspace::Surface& surface);

struct WorkspacePageOptions {
  std::string version;            ///< of Polypod; default: not named
  std::string command;            ///< the command line that makes this page again; default: left out
  std::string machine;            ///< as the user named it; default: the machine's own name
  std::vector<std::string> sets;  ///< `key=value` that were overridden
  int resolution = 64;            ///< points along the longest side of a section, 8 to 512
  std::function<void(const char*, double)> progress;  ///< what is being done, and its share
};

/// The extent along an axis (0: x) as a person reads it: "-26.55 .. 26.55 mm" where what is certainly reached and what
/// is certainly not exceeded are the same to the printed digit, else both. Digits: as many as the tolerance of the
/// bounds means, about 1e-4 of the largest extent. `unit` ("mm", "deg"): of a coordinate of a task without x, y, z,
/// whose digits go by its own extent.
std::string extent_text(const workspace::Volume& volume, int axis, const char* unit = nullptr);

/// One self-contained HTML file about a workspace: the volume with its proven bounds, a picture in space with the
/// machine at home, three sections through its middle, the volume against the tilt (proven too, with few boxes), which
/// limit makes how much of the boundary and what is gained without it, all inputs. `volume` is what volume() gave for
/// the same options. The same input gives the same bytes. Errors: those of section() and surface(); WS110 if cancelled.
/// Cost: some seconds.
Result<std::string> workspace_page(const machine::AnyMachine& machine, const workspace::Options& options,
                                   const workspace::Volume& volume, const WorkspacePageOptions& page = {});

/// The same of a machine whose task does not hold x, y, z, over the coordinates of the task: the size of the region
/// with its proven bounds, the machine at home in a scene that turns, sections through the place that is the farthest
/// inside the limits, what is gained without each limit. Errors: those of section(); WS110 if cancelled; WS131 (nothing
/// is reached, or nothing was found).
Result<std::string> region_page(const machine::AnyMachine& machine, const workspace::Options& options,
                                const workspace::Volume& region, const WorkspacePageOptions& page = {});

}  // namespace polypod::pages
