// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "weight_output.hpp"

#include <fmt/format.h>

#include "machining_output.hpp"
#include "masses_options.hpp"
#include "messages.hpp"
#include "polypod/motion/masses.hpp"

namespace polypod::app {

using units::to_mm, units::to_um;

void WeightQuestion::declare(Arguments& a) {
  a.flag("--gravity", counts,
         "Count the deflection by the machine's own weight, against that at the origin of the workpiece (default: "
         "it is named beside the answer)");
}

Status WeightQuestion::prepare(machining::Job& job, const std::string& dynamics, const Context& context) {
  POLYPOD_ASSIGN(masses, masses_of_job(job, dynamics, context));
  why_not_ = masses.why_not;
  std::string hint = "give masses in the machine file or by --dynamics (docs/motion.md)";
  if (masses.dynamics && !statics::has_compliance(job.machine)) {
    why_not_ = "the parts of the machine have no compliances";
    hint = "give the machine its compliances (docs/machine-files.md)";
  } else if (masses.dynamics && motion::part_masses(*masses.dynamics).empty()) {
    why_not_ = "all masses are 0";
  }
  if (!why_not_.empty()) {
    if (!counts) return {};
    return fail("AP283", "--gravity cannot be counted: " + why_not_, {}, hint + ", or leave --gravity out");
  }
  tilted_ = job.tool_frame.tilted;
  masses_ = std::make_shared<motion::Dynamics>(std::move(*masses.dynamics));
  if (counts) job.weights = masses_;
  return {};
}

Status WeightQuestion::answer(const machining::Job& job, const machining::Prediction& prediction) {
  if (!masses_) return {};
  Result<machining::WeightOnCuts> found = machining::weight_on_cuts(job, prediction, masses_);
  if (found) {
    found_ = *found;
    return {};
  }
  if (counts) return tl::unexpected(found.error());
  why_not_ = found.error().message;
  return {};
}

std::optional<std::string> WeightQuestion::note() const {
  if (!masses_) return std::nullopt;
  return counts ? "the weight of the machine counts, against that at the origin of the workpiece, in the normal "
                  "errors: what it "
                  "does along the tool is not in them (`predict --gravity` at the place has it)"
                : "the weight of the machine is not counted (--gravity counts it)";
}

void WeightQuestion::add_to(Json& document) const {
  if (!found_) {
    document["weight"] = {{"judged", false}, {"counted", false}, {"why_not", why_not_}};
    return;
  }
  document["weight"] = {{"judged", true},
                        {"counted", counts},
                        {"largest_um", to_um(found_->largest)},
                        {"at_mm", vector_json(found_->place * units::kMmPerMetre)},
                        {"at_origin_um", to_um(found_->at_origin)}};
}

std::string WeightQuestion::said() const {
  const Vec3 place = found_->place * units::kMmPerMetre;
  return fmt::format(
      "of the machine deflects the tip by {:.0f} um at the origin of the workpiece{}; on the cuts this differs by up "
      "to "
      "{:.1f} um (x {:.1f} y {:.1f} z {:.1f} mm), {}",
      to_um(found_->at_origin), tilted_ ? ", touched off with the tool as in the cuts" : "", to_um(found_->largest),
      place.x(), place.y(), place.z(), counts ? "counted" : "not counted in the answer (--gravity counts it)");
}

std::string WeightQuestion::in_words() const {
  if (!masses_) return "";
  return found_ ? "The weight " + said() + "." : "What the weight of the machine does is not judged: " + why_not_ + ".";
}

void WeightQuestion::print() const {
  if (masses_) fmt::print("weight         {}\n", found_ ? said() : "not judged: " + why_not_);
}

}  // namespace polypod::app
