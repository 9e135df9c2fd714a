// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/correct.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "aside.hpp"
#include "corrector.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/unroll.hpp"
#include "remedies.hpp"

namespace polypod::machining {
namespace {

/// Whether one correction is better than another of the same program: inside the tube, else with fewer moves outside,
/// else with the smaller distance.
bool closer(const Correction& a, const Correction& b) {
  if (a.within_tolerance != b.within_tolerance) return a.within_tolerance;
  const auto outside = [](const Correction& c) {
    return std::count_if(c.moves.begin(), c.moves.end(), [](const MoveOutcome& m) { return !m.within; });
  };
  const auto of_a = outside(a), of_b = outside(b);
  return of_a != of_b ? of_a < of_b : a.largest_after < b.largest_after - kSameDistance;
}

}  // namespace

std::string Correction::answer(const std::string& proviso) const {
  if (!within_tolerance)
    return (joint_too_fast    ? "no: "
            : only_not_judged ? "no, not all of the cut is judged: "
                              : "not within the tolerance: ") +
           reason;
  return fmt::format(
      "yes{}{}: the deflected tool stays within {:.1f} um of the programmed path{} (tube {:g} um)", proviso,
      all_judged() ? "" : ", apart from what was not judged",
      units::to_um(std::max({largest_after, after.plunge_within.distance,
                             other_switch && !other_switch->fixed ? other_switch->distance_after : 0.0})),
      modes.corner_after > 0 ? ", the corners that the controller rounds counted" : "", units::to_um(tolerance));
}

Result<Correction> correct(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                           const CorrectOptions& options) {
  std::function<bool(double)> progress;
  if (options.progress) progress = [&](double share) { return options.progress("checking the reach", share); };
  POLYPOD_ASSIGN(accepted, accept_but_reach(job, program, interpretation, options.again));
  FollowedAnyway of_reach;
  Aside reach(
      [&](const Aside::Progress& report) {
        return accept_reach(job, program, accepted.interpretation(), report, &of_reach);
      },
      progress);
  const Result<std::optional<OtherSwitch>> other_found = other_unrolled(job, options);
  if (!other_found) POLYPOD_TRY(reach.result(progress));
  POLYPOD_ASSIGN(fixed_other, other_found);
  const auto corrected = [&](const CorrectOptions& how, const Prediction* before) {
    Corrector corrector(job, program, accepted, how);
    if (before != nullptr) corrector.take_before(*before);
    corrector.take_other(fixed_other);
    corrector.take_reach(&reach, &of_reach);
    return corrector.run();
  };
  POLYPOD_ASSIGN(out, corrected(options, nullptr));
  // Where the pieces end decides what the cells make of a corner: other pieces may do. The best of them stays.
  // What is not judged of the program as it is no correction answers.
  const bool small = is_quick(job, out) && options.method == CorrectMethod::tube && out.before.not_judged.empty();
  constexpr std::array kOthers{0.9, 0.65, 1.4, 2.0};
  for (std::size_t k = 0; k < kOthers.size(); ++k) {
    if (out.within_tolerance || !small) break;
    CorrectOptions other = options;
    other.fit_share = kOthers[k];
    if (options.progress) {
      other.progress = [&](const char*, double) {
        return options.progress("fitting it in other pieces", double(k) / kOthers.size());
      };
    }
    POLYPOD_ASSIGN(again, corrected(other, &out.before));
    if (closer(again, out)) out = std::move(again);
  }
  if (options.remedies && !out.within_tolerance && options.method == CorrectMethod::tube && out.remedies.empty()) {
    out.remedies = remedies_for(job, program, accepted, options, out);
  }
  POLYPOD_TRY(reach.result(progress));
  std::vector<std::string> notes = std::move(accepted.notes);
  notes.insert(notes.end(), of_reach.notes.begin(), of_reach.notes.end());
  if (out.other_switch) gcode::drop_block_delete_note(notes);
  if (fixed_other) {
    notes.push_back(
        fmt::format("blocks that begin with / are {} in what is written, whatever the switch says; a program for the "
                    "other position "
                    "comes from a job with block_delete = {}",
                    job.block_delete ? "left out" : "carried out like all others", !job.block_delete));
  }
  for (std::string& note : condition_notes(job, out.programmed, out.before)) notes.push_back(std::move(note));
  for (std::string& note : pass_notes(job, program, out.before.pass)) notes.push_back(std::move(note));
  out.before.notes = std::move(notes);
  return out;
}

}  // namespace polypod::machining
