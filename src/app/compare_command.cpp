// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "job_input.hpp"
#include "machining_output.hpp"
#include "messages.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/compare.hpp"
#include "polypod/machining/tilted.hpp"
#include "stages_line.hpp"

namespace polypod::app {
namespace {

using units::to_um;

constexpr config::Range kPoints{1, 10000};
constexpr config::Range kStep_mm{0.01, 10};
constexpr config::Range kRounds{1, 50};

/// What the comparison leaves out of a program with blocks that begin with /; empty: nothing.
std::string left_out(const Input& in) {
  if (!in.other && !machining::has_optional_blocks(in.program)) return {};
  return fmt::format("compared with block delete {} alone; `predict` and `correct` judge both positions",
                     in.job.block_delete ? "on" : "off");
}

Json answer_json(const machining::Job& job, const std::vector<machining::MethodOutcome>& outcomes,
                 const std::string& open) {
  Json methods = Json::array();
  for (const machining::MethodOutcome& m : outcomes) {
    methods.push_back(
        {{"name", machining::name_of(m.method)},
         {"after_um", spread_json(m.normal, units::kUmPerMetre)},
         {"lines_out", m.lines},
         {"seconds", m.seconds},
         {"distance_um", to_um(m.distance)},
         {"distance_with_robot_errors_um", m.with_robot_errors ? Json(to_um(*m.with_robot_errors)) : Json()},
         {"within_tolerance", m.inside},
         {"worse_than_none", m.worse},
         {"all_judged", m.judged},
         {"rounds", m.rounds},
         {"what", machining::description_of(m.method, job)},
         {"notes", m.notes}});
  }
  Json notes = Json::array();
  if (!open.empty()) notes.push_back(open);
  return {{"methods", methods}, {"tolerance_um", rounded_um(job.tolerance)}, {"notes", notes}};
}

void print_answer(const machining::Job& job, const std::vector<machining::MethodOutcome>& outcomes,
                  const std::string& open) {
  const bool errors = job.robot_errors.any();
  fmt::print("          normal error um            distance um {}  lines   seconds\n", errors ? "  with errors " : "");
  fmt::print("             min     mean      max\n");
  for (const machining::MethodOutcome& m : outcomes) {
    const auto um = [](double x) { return unsigned_zero(fmt::format("{:.1f}", to_um(x))); };
    const double off = std::max(m.distance, m.with_robot_errors.value_or(0));
    const std::string with = m.with_robot_errors ? fmt::format("  {:>12}", um(*m.with_robot_errors)) : std::string();
    fmt::print("{:<8} {:>7}  {:>7}  {:>7}  {:>12}{}  {:>7}  {:>8.2f}  {}{}\n", machining::name_of(m.method),
               um(m.normal.min), um(m.normal.mean), um(m.normal.max), um(m.distance), with, m.lines, m.seconds,
               m.inside                                           ? m.judged ? std::string("within the tolerance")
                                                                             : "within the tolerance, apart from what was not judged"
               : off > job.tolerance - machining::resolution(job) ? "beyond the tolerance" + kept_free(job, off)
                                                                  : "not all of it is judged",
               m.worse ? ", worse than no correction" : "");
  }
  fmt::print("\ntolerance {:g} um; distances without the corners that the controller rounds{}\n", to_um(job.tolerance),
             errors ? "; \"with errors\": with what backlash, friction and signature file of the job do besides" : "");
  for (const machining::MethodOutcome& m : outcomes) {
    fmt::print("{:<8} {}\n", machining::name_of(m.method), machining::description_of(m.method, job));
    for (const std::string& note : m.notes) fmt::print("         note: {}\n", note);
  }
  if (!open.empty()) fmt::print("note: {}\n", open);
}

}  // namespace

Command compare_command() {
  struct Options {
    std::string program, job, branch;
    std::vector<std::string> measured;
    int points = 10, rounds = 6;
    double step_mm = 0;
    bool again = false;
  };
  auto o = std::make_shared<Options>();
  return {"compare", "The methods of correction side by side on one program",
          "polypod compare program.ngc --job job.toml",
          [o](Arguments& a) {
            a.positional("PROGRAM", o->program, "The G-code program");
            a.option("--job", o->job, "The job file: machine, origin, cutter, material, stock, tolerance", true);
            a.option("--branch", o->branch, kBranchHelp);
            a.options("--measured", o->measured, kMeasuredHelp);
            a.option("--points", o->points, kPoints, "Points a move of `mirror` (default: 10)");
            a.option("--point-step", o->step_mm, kStep_mm,
                     "Distance between the points of `comet` and `abele`, mm (default: the job's step_mm)");
            a.option("--rounds", o->rounds, kRounds, "At most so many rounds of `abele` (default: 6)");
            a.flag("--again", o->again, "Take a program that Polypod has corrected like any other");
          },
          [o](const Context& context) -> Result<int> {
            std::vector<std::string> inputs = o->measured;
            inputs.insert(inputs.end(), {o->program, o->job});
            POLYPOD_TRY(check_files(inputs, {}, context.json));
            POLYPOD_ASSIGN(in, read_input(context, o->program, o->job, o->measured));
            POLYPOD_TRY(begin_in(o->branch, in.interpretation, in.job));
            POLYPOD_TRY(machining::set_up(in.job, in.program, in.interpretation));
            machining::CompareOptions options;
            options.mirror_points = o->points;
            options.abele_rounds = o->rounds;
            options.point_step = units::from_mm(o->step_mm);
            options.again = o->again;
            StagesLine line(context);
            options.progress = [&](const char* what, double share) { return line(what, share); };
            POLYPOD_ASSIGN(outcomes, machining::compare_methods(in.job, in.program, in.interpretation, options));
            line.end();
            if (context.json) {
              print_json(answer_json(in.job, outcomes, left_out(in)));
            } else {
              print_answer(in.job, outcomes, left_out(in));
            }
            return kDone;
          }};
}

}  // namespace polypod::app
