// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "commands.hpp"

#include "linuxcnc_commands.hpp"
#include "online_command.hpp"
#include "release_command.hpp"
#include "report_command.hpp"
#include "testcut_command.hpp"
#include "watch_command.hpp"

namespace polypod::app {

// clang-format off
std::vector<Command> all_commands() {
  return {
      machines_command(), info_command(),                       // the catalogue
      ik_command(), fk_command(), jacobian_command(),           // a pose
      workspace_command(), section_command(), sweep_command(),  // all poses
      dexterity_command(), singularities_command(),             // quality
      errors_command(), tolerances_command(), budget_command(),
      delta_command(), move_command(), pick_command(), fit_command(),  // deltas
      release_command(),                                        // forward dynamics
      optimize_command(), study_command(),                      // studies
      compliance_command(), map_command(),                      // statics
      identify_compliance_command(), identify_cutting_command(),
      simulate_measurement_command(), calibrate_command(), uncertainty_command(), poses_command(),  // measured machines
      controller_command(), export_linuxcnc_command(), record_command(), watch_command(),
      force_command(),                                          // cutting
      predict_command(), correct_command(), check_command(),    // programs
      place_command(), compare_command(), testcut_command(), online_command(),
      canon_command(), post_command(),
      cell_command(),                                           // cells
      report_command(), view_command(),                         // in a browser
  };
}
// clang-format on

}  // namespace polypod::app
