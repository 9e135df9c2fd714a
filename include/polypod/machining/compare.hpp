// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The methods of correction that SLAV 3.3 describes, side by side on one program, under one judge.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "polypod/machining/correct.hpp"

namespace polypod::machining {

enum class Method : std::uint8_t {
  none,    ///< the program as it is
  tube,    ///< that of `correct`
  mirror,  ///< Derince: N points a move, p - delta(p) with the force at the commanded points (SLAV (5.2))
  /// Every point of a dense path, p - delta(p) - e(p); one pass, force and deflection one after the other. e: what
  /// backlash, friction and the signature file do (Job::robot_errors), where the job has them.
  comet,
  abele  ///< force and deflection coupled, the path corrected by what remains, again and again
};
/// "none", "tube", "mirror", "comet", "abele".
const char* name_of(Method method);
/// What it does on this job, and what of the published method it leaves out, in one sentence.
std::string description_of(Method method, const Job& job);

struct CompareOptions {
  int mirror_points = 10;   ///< N of `mirror`
  double point_step = 0;    ///< m, between the points of `comet` and `abele`; 0: the job's step
  int abele_rounds = 6;     ///< at most
  double settled = 0.5e-6;  ///< m; rounds end where no point moves by more
  bool again = false;       ///< see AcceptOptions
  std::function<bool(const char* what, double share)> progress;
};

/// What a method makes of a program.
struct MethodOutcome {
  Method method = Method::none;
  Spread normal;        ///< m, normal error of the cutting points
  double distance = 0;  ///< m, the largest of a deflected point from its programmed move, without corners
  /// m, the same with what backlash, friction and the signature file do; nothing where the job has no robot_errors.
  std::optional<double> with_robot_errors;
  bool judged = true;     ///< every cut could be judged: no plunge without a dwell, no unsettled point, ...
  bool worse = false;     ///< one of the distances, or the largest normal error, is larger than without a correction
  bool inside = false;    ///< the distances keep within the tolerance; where not all is `judged`, apart from that
  std::size_t lines = 0;  ///< of the program that is written
  int rounds = 0;         ///< passes through the stock that found the correction
  double seconds = 0;     ///< by the clock, to find and write it, without the judge's pass
  std::string text;       ///< the program
  std::vector<std::string> notes;
};

/// All five methods, in the order of `Method`. The judge is the same for all: what was written is read back and sent
/// through the stock in equilibrium (Bend::equilibrium) at steps of at most 0.1 mm, as `correct` checks its own. Path
/// control modes are left as they are, and corners of the controller are not counted, so that the methods alone are
/// compared. Where the job has robot_errors, a second pass adds to every point what they do there. Errors: those of
/// accept and run_pass; MC304 a rapid through material. Cost: some ten passes.
Result<std::vector<MethodOutcome>> compare_methods(const Job& job, const gcode::Program& program,
                                                   const gcode::Interpretation& interpretation,
                                                   const CompareOptions& options = {});

}  // namespace polypod::machining
