// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What commands say of machines that are singular at every pose.
#include <fmt/format.h>

#include <cstdio>

#include "command.hpp"
#include "polypod/quality/singularity.hpp"

namespace polypod::app {

SingularNote::SingularNote(const machine::AnyMachine& machine, const Context& context) : json_(context.json) {
  const quality::PoseIndependentSingularity s = quality::pose_independent_singularity(machine);
  never_held_ = s.never_held();
  hardly_held_ = s.nearly();
  everywhere_ = s.everywhere();
  if (s.everywhere() || s.nearly()) text_ = "This machine is " + quality::in_words(s) + ".";
  if (text_.empty() || json_) return;
  fmt::print("note: {}\n\n", text_);
  std::fflush(stdout);  // it stands before what follows on stderr
}

Json SingularNote::in(const Json& document) const {
  if (text_.empty()) return document;
  Json out{{"singular_everywhere", everywhere_}, {"note", text_}};
  out.update(document);
  return out;
}

std::optional<int> SingularNote::refusal(const std::vector<std::string>& figures) const {
  if (!never_held_ && !hardly_held_) return {};
  Json document = Json::object();
  for (const std::string& key : figures) document[key] = Json();
  if (json_) print_json(in(document));
  std::fflush(stdout);
  fmt::print(stderr, "polypod: there are no figures, because {}\n",
             never_held_ ? "the drives do not constrain the platform at any pose"
                         : "the machine is close to singular at every pose");
  return kAnswerIsNo;
}

std::optional<int> refused_as_singular(const machine::AnyMachine& machine, const Context& context,
                                       const std::vector<std::string>& figures) {
  return SingularNote(machine, context).refusal(figures);
}

}  // namespace polypod::app
