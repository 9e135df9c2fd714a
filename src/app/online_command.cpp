// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "online_command.hpp"

#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "job_input.hpp"
#include "messages.hpp"
#include "online_options.hpp"
#include "polypod/control/online.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/accept.hpp"
#include "stages_line.hpp"

namespace polypod::app {
namespace {

using control::OnlineMethod;
using control::OnlineOutcome;
using control::OnlineResult;
using units::to_um;

struct Options {
  std::string program, job;
  OnlineSettings loop;
  double lost_at_s = 0;
};

constexpr config::Range kLost_s{0, 1e6};

std::string um(double metres) {
  return unsigned_zero(fmt::format("{:.1f}", to_um(metres)));
}

/// The answer, and whether it is yes.
std::pair<bool, std::string> answer_of(const machining::Job& job, const Options& o, const OnlineResult& r) {
  if (!r.stable_enough) {
    return {false,
            fmt::format("no: on-line correction is refused: the gain margin of the loop is {:.2g}, less than {:g}{}",
                        r.margin.gain, o.loop.least_margin, r.margin.gain > 1 ? "" : ", so it is unstable")};
  }
  for (const OnlineOutcome& one : r.outcomes) {
    if (one.stopped)
      return {false, fmt::format("no: {} was stopped at line {}: {}", control::name_of(one.method), one.stopped_line,
                                 *one.stopped)};
  }
  const OnlineOutcome *best = nullptr, *none = &r.outcomes.front();
  for (const OnlineOutcome& one : r.outcomes)
    if (best == nullptr || one.rms < best->rms) best = &one;
  const std::string rest = r.not_judged.empty() ? "" : ", apart from what was not judged";
  if (best == none) return {false, "no: no correction leaves less than none"};
  if (best->distance > job.tolerance) {
    return {false, fmt::format("no: {} leaves {} um rms of the {} um without correction, but is {} um from the path at "
                               "line {} (tube {:g} um)",
                               control::name_of(best->method), um(best->rms), um(none->rms), um(best->distance),
                               best->distance_line, to_um(job.tolerance))};
  }
  return {true, fmt::format("yes{}: {} leaves {} um rms of the {} um without correction (tube {:g} um)", rest,
                            control::name_of(best->method), um(best->rms), um(none->rms), to_um(job.tolerance))};
}

Json answer_json(const machining::Job& job, const Options& o, const OnlineResult& r) {
  Json methods = Json::array();
  for (const OnlineOutcome& one : r.outcomes) {
    const bool ran = !one.refused;
    const auto figure = [&](double metres) { return ran ? Json(to_um(metres)) : Json(); };
    methods.push_back(
        {{"name", control::name_of(one.method)},
         {"refused", one.refused},
         {"normal_error_um",
          {{"min", figure(one.normal.min)}, {"mean", figure(one.normal.mean)}, {"max", figure(one.normal.max)}}},
         {"rms_um", figure(one.rms)},
         {"distance_um", figure(one.distance)},
         {"distance_line", ran ? Json(one.distance_line) : Json()},
         {"largest_shift_um", figure(one.largest_shift)},
         {"cycles", one.cycles},
         {"stopped", one.stopped ? Json(*one.stopped) : Json()},
         {"stopped_line", one.stopped ? Json(one.stopped_line) : Json()}});
  }
  const auto [ok, answer] = answer_of(job, o, r);
  Json loop = loop_json(r.loop, r.margin);
  loop["stable_enough"] = r.stable_enough;
  return {{"loop", loop}, {"methods", methods}, {"tolerance_um", to_um(job.tolerance)}, {"not_judged", r.not_judged},
          {"ok", ok},     {"answer", answer}};
}

void print_answer(const machining::Job& job, const Options& o, const OnlineResult& r) {
  fmt::print("loop      C {:.3g} um/N, cut {:.3g} N/mm and {:.3g} N s/mm along the normal (the worst that was met)\n",
             units::to_um_per_N(r.loop.compliance), units::to_N_per_mm(r.loop.cut_stiffness) + 0.0,
             units::to_N_per_mm(r.loop.cut_damping) + 0.0);  // + 0.0: no negative zero
  fmt::print("margin    {}, with a delay of {:g} ms and a low-pass of {:g} Hz; {}\n",
             std::isfinite(r.margin.gain) ? fmt::format("the gain may grow {:.2g} times until it swings at {:.2g} Hz",
                                                        r.margin.gain, r.margin.frequency)
                                          : std::string("no gain makes it swing"),
             o.loop.delay_ms, o.loop.cutoff_hz,
             std::isfinite(r.margin.delay)
                 ? fmt::format("unstable from a delay of {:g} ms on", r.margin.delay / units::from_ms(1))
             : r.margin.largest < 1 ? std::string("stable with any delay")
                                    : std::string("stable with any delay up to 1 s"));
  fmt::print("\n            normal error um                       distance um   shift um\n");
  fmt::print("               min     mean      max      rms\n");
  for (const OnlineOutcome& one : r.outcomes) {
    if (one.refused) {
      fmt::print("{:<9}  refused: the margin is less than {:g}\n", control::name_of(one.method), o.loop.least_margin);
      continue;
    }
    fmt::print("{:<9} {:>8} {:>8} {:>8} {:>8}  {:>12}   {:>8}{}\n", control::name_of(one.method), um(one.normal.min),
               um(one.normal.mean), um(one.normal.max), um(one.rms), um(one.distance), um(one.largest_shift),
               one.stopped ? fmt::format("  stopped at line {}: {}", one.stopped_line, *one.stopped) : "");
  }
  fmt::print("\n");
  for (const std::string& n : r.not_judged) fmt::print("not judged: {}\n", n);
  fmt::print(
      "not in this loop: acceleration of the command, masses and modes of the machine, drives that lag, tooth "
      "passing\n{}\n",
      answer_of(job, o, r).second);
}

}  // namespace

Command online_command() {
  auto o = std::make_shared<Options>();
  return {"online", "On-line correction by a force sensor beside the off-line one, in a simulated loop",
          "polypod online program.ngc --job job.toml --delay-ms 10",
          [o](Arguments& a) {
            a.positional("PROGRAM", o->program, "The G-code program");
            a.option("--job", o->job, "The job file: machine, origin, cutter, material, stock, tolerance", true);
            o->loop.declare(a);
            a.option("--lost-at-s", o->lost_at_s, kLost_s, "From then on the sensor gives nothing (default: never)");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_TRY(check_files({o->program, o->job}, {}, context.json));
            POLYPOD_ASSIGN(in, read_input(context, o->program, o->job));
            POLYPOD_TRY(begin_in({}, in.interpretation, in.job));
            control::OnlineOptions options = o->loop.options(context);
            if (context.given("--lost-at-s")) options.lost_at = o->lost_at_s;
            StagesLine line(context);
            options.progress = [&](const char* what, double share) { return line(what, share); };
            POLYPOD_ASSIGN(result, control::simulate_online(in.job, in.program, in.interpretation, options));
            line.end();
            if (in.other || machining::has_optional_blocks(in.program))
              result.not_judged.push_back(fmt::format("the other position of block delete: simulated with it {}",
                                                      in.job.block_delete ? "on" : "off"));
            if (context.json) {
              print_json(answer_json(in.job, *o, result));
            } else {
              print_answer(in.job, *o, result);
            }
            return answer_of(in.job, *o, result).first ? kDone : kAnswerIsNo;
          }};
}

}  // namespace polypod::app
