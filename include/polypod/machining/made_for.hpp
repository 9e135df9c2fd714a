// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Whether a corrected program was corrected for this job.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "polypod/gcode/header.hpp"
#include "polypod/machining/job.hpp"

namespace polypod::machining {

struct MadeFor {
  enum class Other : std::uint8_t { none, machine, unknown_place, place, cutter, material, stock, offsets, compliance };
  Other other = Other::none;
  std::string message;     ///< what is other; empty where nothing is
  std::string not_judged;  ///< why that is not known of the compliances; else empty
  bool unreached = false;  ///< the machine does not hold its tool so where the first cut begins: nothing was compared
};

/// What the header says beside the job: the name of the machine, the place of the workpiece, the cutters, the
/// coefficients and the stock (within 0.2 mm and 1 % of its volume) where the job has them, and what 100 N do to the
/// tool where the first cut begins (ComplianceMark::same, in the header's posture and with its joints). Of a program
/// that was looked at for another machine or place nothing is other: what it cuts is as the CAM system wrote it.
/// `comes_to(p, within)`: whether a move of the written program begins or ends so near, m, to a place in W, with this
/// job's work offsets; one must where the header says that the first cut begins.
MadeFor made_for(const gcode::CorrectionHeader& header, const Job& job,
                 const std::function<bool(const Vec3& p, double within)>& comes_to);

/// Whether it speaks of this machine and this place of the workpiece.
bool speaks_of(const gcode::CorrectionHeader& header, const Job& job);

}  // namespace polypod::machining
