// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The options that `workspace` and `sweep` share.
#pragma once

#include "command.hpp"
#include "polypod/workspace/region.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::app {

struct WorkspaceOptions {
  double tilt_deg = 0;
  std::string a_range, b_range;
  double rel_tol = 0.01;
  bool interference = false;
  std::string without;
  double clearance = 0;    ///< mm
  std::string max_memory;  ///< MB, or with M or G; default: half of the machine's
  int threads = 0;

  void declare(Arguments& arguments);             ///< all of them
  void declare_directions(Arguments& arguments);  ///< --tilt, --a-range, --b-range
  void declare_limits(Arguments& arguments);      ///< --interference, --without, --clearance
  void declare_threads(Arguments& arguments);
  [[nodiscard]] Result<workspace::Options> options(const machine::AnyMachine& m, const Context& context) const;
};

/// The planes of --plane: "xy, xz or yz"; of a task without x, y, z of its coordinates: "zA, zB or AB".
std::string plane_names(const machine::Task& task);
/// The axis that one of them leaves out, in any order of its letters, small or large; none where it is none of them.
std::optional<int> normal_of(const machine::Task& task, const std::string& plane);

/// Bytes of --max-memory. Errors: AP153.
Result<std::size_t> memory_argument(const std::string& text);
/// Whether the volume came within its tolerance; if not, says on stderr why and what would help.
bool came_within(const workspace::Volume& v, const workspace::Options& options);

Json volume_json(const workspace::Volume& v);
using workspace::Region;
using workspace::region_of;
using workspace::unit_of_product;
/// The coordinates with their units, and the measure; a bound that is no number is null.
Json measure_json(const machine::Task& task, const Region& region);
/// volume_json of such a machine.
Json region_json(const machine::AnyMachine& machine, const workspace::Volume& v);

}  // namespace polypod::app
