// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "command.hpp"

namespace polypod::app {

Command machines_command();
Command info_command();
Command ik_command();
Command fk_command();
Command jacobian_command();
Command workspace_command();
Command section_command();
Command sweep_command();
Command dexterity_command();
Command errors_command();
Command singularities_command();
Command tolerances_command();
Command budget_command();
Command delta_command();
Command move_command();
Command pick_command();
Command fit_command();
Command optimize_command();
Command study_command();
Command compliance_command();
Command map_command();
Command identify_compliance_command();
Command simulate_measurement_command();
Command calibrate_command();
Command poses_command();
Command controller_command();
Command uncertainty_command();
Command identify_cutting_command();
Command force_command();
Command predict_command();
Command correct_command();
Command check_command();
Command place_command();
Command compare_command();
Command canon_command();
Command post_command();
Command cell_command();
Command view_command();

}  // namespace polypod::app
