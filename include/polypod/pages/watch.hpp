// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a record says of a machine, as a page.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/control/watch.hpp"
#include "polypod/machining/job.hpp"
#include "polypod/machining/recorded.hpp"

namespace polypod::pages {

struct WatchPageOptions {
  std::string record, machine;  ///< names
  double warn = 0;              ///< m; 0: none
  bool ok = false, judged = false;
  std::string answer;  ///< the sentence of the command
  std::vector<std::string> not_judged;
  std::string version, command;
  std::string live;  ///< address, on the server of the page, that follows the record as it grows; empty: none
  /// The machine and the rows that the watch is of: then the machine moves along the record. Must outlive the call.
  const machine::AnyMachine* moving = nullptr;
  const std::vector<control::RecordRow>* rows = nullptr;
};

/// One self-contained HTML file: the answer, the machine on its way (command and tip), the deviation over time with its
/// parts, the way from above with the deviation enlarged, each line, what explains the deviation; with a cut, the
/// deflected tip against the tube, what the correction takes back, and the corners.
std::string watch_page(const control::Watch& watch, const machining::Job* job, const machining::RecordedCut* cut,
                       const WatchPageOptions& options);

}  // namespace polypod::pages
