// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pictures and the page of a parameter study.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "polypod/design/analyse.hpp"
#include "polypod/design/compared.hpp"
#include "polypod/design/optimize.hpp"
#include "polypod/design/sensitivity.hpp"
#include "polypod/report/plot.hpp"

namespace polypod::pages {

/// What a page is made of.
struct StudyPage {
  const design::Study& study;
  const std::vector<design::Row>& rows;
  const std::vector<design::Sensitivity>& sensitivities;
  const design::StudySensitivity& global;  ///< over the whole ranges; without groups: none
  bool complete = false;
  std::string version;                       ///< of Polypod
  std::string command;                       ///< how the page was made
  std::vector<design::Start> starts;         ///< of the search (design::kept_starts)
  std::vector<double> reference;             ///< of the hypervolume of the front, as design::front_volume takes it
  std::optional<design::JudgedAgain> again;  ///< the answer over a finer survey (design::kept_again)
  design::Known known;                       ///< machines to compare with (design::kept_compared)
};

/// Two goals, by their places in the study, of all rows that have both, those of the front, the start, and the machines
/// that are known. Errors: QP110 (fewer than two goals, or no row that has both).
Result<report::Figure> front_figure(const StudyPage& page, std::size_t x = 0, std::size_t y = 1);

/// A line a row across the varied parameters and the goals, each on an axis of its own, better goals up: at most 200
/// done rows, the best (of a front its points) in colour. Errors: QP110 (no row is done).
Result<report::Figure> parallel_figure(const StudyPage& page);

/// One self-contained HTML file: what was asked, what was tried, the best against the start with how sure its figures
/// are, the front, parallel coordinates, sensitivities (over the rows, and over the ranges where they were analysed),
/// the machine and its workspace, all inputs. The same rows give the same bytes. Errors: those of the workspace. Cost:
/// a few seconds for the workspace.
Result<std::string> study_page(const StudyPage& page);

}  // namespace polypod::pages
