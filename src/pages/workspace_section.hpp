// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pictures of a workspace's sections, and what its pages say alike.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "polypod/pages/workspace.hpp"
#include "polypod/report/plot.hpp"
#include "polypod/workspace/beyond.hpp"
#include "polypod/workspace/surface.hpp"

namespace polypod::pages {

/// The kinds of limit that occur, numbered once for all pictures of a page so that each keeps its colour.
class Kinds {
 public:
  Kinds(const machine::AnyMachine& machine, const std::set<int>& limits) {
    for (const int limit : limits) {
      if (limit < 0) continue;
      const std::string kind = workspace::limit_kind(machine, limit);
      const auto at = std::find(names_.begin(), names_.end(), kind);
      of_[limit] = static_cast<int>(at - names_.begin());
      if (at == names_.end()) names_.push_back(kind);
    }
  }
  [[nodiscard]] int of(int limit) const {
    const auto at = of_.find(limit);
    return at == of_.end() ? -1 : at->second;
  }
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }

 private:
  std::vector<std::string> names_;
  std::map<int, int> of_;
};

/// Machines that cannot tilt: their sections show how far inside the limits a point is.
bool without_tilt(const workspace::Section& section);
/// Adds the limits that stop the tool at the points of a section.
void collect(std::set<int>& limits, const workspace::Section& section);
/// The axis along which a unit vector points, or -1.
int axis_of(const Vec3& u);
/// As pages::section_picture, with the numbers of the kinds of limit. `hangs`: z points down in the picture.
report::HeatMap section_map(const workspace::Options& options, const workspace::Section& section, const Kinds& kinds,
                            bool hangs);

/// What the head of such a page names, with one line of its own.
std::vector<std::pair<std::string, std::string>> facts_of(const machine::AnyMachine& machine,
                                                          const WorkspacePageOptions& page,
                                                          const std::pair<std::string, std::string>& own);
/// Which questions the page of a workspace answers, and which it does not.
std::string what_is_answered();
/// That the tolerance which was asked for was missed; empty where it was not.
std::string missed_in_words(const workspace::Volume& volume);
/// What lies beyond singular poses, in a sentence; empty where nothing does. `looked_at`: "points drawn from it".
std::string beyond_in_words(const workspace::BeyondSingular& beyond, const char* looked_at);

}  // namespace polypod::pages
