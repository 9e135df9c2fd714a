// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "commands.hpp"
#include "job_input.hpp"
#include "machining_output.hpp"
#include "messages.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/posture.hpp"
#include "polypod/machine/assumed.hpp"
#include "polypod/machining/place.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/pages/place.hpp"
#include "stages_line.hpp"
#include "weight_output.hpp"

namespace polypod::app {
namespace {

using machining::PlaceBy;
using machining::PlaceFit;
using machining::PlacePoint;
using machining::PlaceResult;
using machining::Placing;
using units::to_deg;
using units::to_mm;
using units::to_um;

constexpr double kFarthest_mm = 1e6, kMostTurn_deg = 360;

/// "lo,hi" or one number.
Result<machine::JointRange> range_of(const std::string& text, const std::string& option, double most) {
  POLYPOD_ASSIGN(values, numbers_of(text, option));
  const bool small = std::all_of(values.begin(), values.end(), [&](double v) { return std::abs(v) <= most; });
  if (values.empty() || values.size() > 2 || !small || values.back() < values.front()) {
    return fail("AP200", fmt::format("{} {}: not a range", option, text), {},
                fmt::format("give lo,hi, the smaller one first, or one number; at most {:g}", most));
  }
  return machine::JointRange{values.front(), values.back()};
}

machine::JointRange scaled(const machine::JointRange& r, double factor) {
  return {r.min * factor, r.max * factor};
}

double turn_for_user(double turn) {
  return to_a_millionth(to_deg(turn));
}

Json point_json(const PlacePoint& p) {
  const bool fits = p.fit == PlaceFit::fits;
  return {{"origin_mm", rounded_mm(p.at.origin)},
          {"turn_deg", turn_for_user(p.at.turn)},
          {"fits", fits},
          {"why_not", fits ? Json() : Json(machining::name_of(p.fit))},
          {"error_um", fits ? Json(to_um(p.error)) : Json()},
          {"distance_um", fits ? Json(to_um(p.distance)) : Json()},
          {"compliance_um_per_N", fits ? Json(units::to_um_per_N(p.compliance)) : Json()},
          {"margin_percent", fits ? Json(100 * p.margin) : Json()}};
}

Json range_json(const machine::JointRange& r, double (*user)(double)) {
  return Json::array({user(r.min), user(r.max)});
}

constexpr const char* kNotJudged =
    "collisions of machine, tool and part with table and fixture are not judged, nor how the part can be clamped";

/// What was not judged, and how a program was with blocks that begin with /.
std::vector<std::string> notes_of(const Input& in, const PlaceResult& result, const WeightQuestion& weight) {
  std::vector<std::string> out{kNotJudged};
  if (result.farther_there()) {
    out.push_back(
        fmt::format("the deflected tool is up to {:.1f} um from the programmed path there, and up to {:.1f} um at the "
                    "start: the normal error, by which places are compared, has no vertical part (--by distance)",
                    to_um(result.best->distance), to_um(*result.start_distance)));
  }
  if (result.held) {
    out.emplace_back(
        "the part is not turned: the program tilts the tool by A and B, which are axes of the machine and do not turn "
        "with it");
  }
  if (std::string joints = machining::without_speed(in.job.joint_speeds); !joints.empty())
    out.push_back(std::move(joints));
  if (const auto said = weight.note()) out.push_back(*said);
  if (machine::limits_are_assumed(in.job.machine))
    out.push_back(fmt::format("limits of the joints are not judged: {}", machine::kAssumedLimits));
  if (in.other) {
    out.push_back(fmt::format("places fit with block delete on and off; errors are those with it {}",
                              in.job.block_delete ? "on" : "off"));
  }
  return out;
}

Json answer_json(const PlaceResult& r, const std::string& posture, const std::vector<std::string>& notes) {
  Json judged = Json::array(), map = Json::array(), rotations = Json::array();
  for (const machining::JudgedPlace& j : r.judged) {
    judged.push_back({{"origin_mm", rounded_mm(j.at.origin)},
                      {"turn_deg", turn_for_user(j.at.turn)},
                      {"error_um", to_um(j.error)},
                      {"distance_um", to_um(j.distance)},
                      {"estimate_um", to_um(j.estimate)},
                      {"distance_estimate_um", to_um(j.distance_estimate)}});
  }
  for (const PlacePoint& p : r.map.points) map.push_back(point_json(p));
  for (const PlacePoint& p : r.rotations) rotations.push_back(point_json(p));
  Json best;
  if (r.best) {
    best = {{"origin_mm", rounded_mm(r.best->at.origin)},
            {"turn_deg", turn_for_user(r.best->at.turn)},
            {"error_um", to_um(r.best->error)},
            {"distance_um", to_um(r.best->distance)},
            {"gain_um", r.start_error ? Json(to_um(*r.start_figure() - figure_of(*r.best, r.by))) : Json()},
            {"at_boundary", r.at_border}};
    if (!posture.empty()) best["posture"] = posture;
  }
  return {
      {"by", r.by == PlaceBy::distance ? "distance" : "error"},
      {"start_error_um", r.start_error ? Json(to_um(*r.start_error)) : Json()},
      {"start_distance_um", r.start_distance ? Json(to_um(*r.start_distance)) : Json()},
      {"best", best},
      {"fits", r.best.has_value()},
      {"start",
       {{"origin_mm", rounded_mm(r.start.origin)},
        {"turn_deg", turn_for_user(r.start.turn)},
        {"fits", r.start_fit == PlaceFit::fits},
        {"why_not", r.start_fit == PlaceFit::fits ? Json() : Json(machining::name_of(r.start_fit))}}},
      {"box_mm",
       {{"x", range_json(r.box[0], to_mm)}, {"y", range_json(r.box[1], to_mm)}, {"z", range_json(r.box[2], to_mm)}}},
      {"turns_deg", range_json(r.turns, to_deg)},
      {"places", r.places},
      {"places_that_fit", r.fitting},
      {"points_looked_at", r.looked_at},
      {"judged", judged},
      {"map_columns", r.map.columns},
      {"map", map},
      {"rotations", rotations},
      {"notes", notes}};
}

std::string in_words(const Placing& at) {
  const auto mm = [](double x) { return unsigned_zero(fmt::format("{:.1f}", to_mm(x))); };
  return fmt::format("x {} y {} z {} mm, turned by {} deg", mm(at.origin.x()), mm(at.origin.y()), mm(at.origin.z()),
                     unsigned_zero(fmt::format("{:.1f}", to_deg(at.turn))));
}

std::string gain_in_words(double gain_um) {
  return gain_um < 0 ? fmt::format("; the start, which lies beside the box, is better by {:.1f} um", -gain_um)
                     : fmt::format("; the gain is {:.1f} um", gain_um);
}

void print_answer(const PlaceResult& r, const std::string& posture, const std::vector<std::string>& notes) {
  if (r.start_error) {
    fmt::print("start  {:.1f} um  {}\n", to_um(*r.start_figure()), in_words(r.start));
  } else {
    fmt::print("start  does not fit ({})  {}\n", machining::name_of(r.start_fit), in_words(r.start));
  }
  if (!r.best) {
    fmt::print("no place was found {}at which the program fits the machine\n", r.places > 0 ? "within the box " : "");
    if (r.failed > 0) {
      fmt::print("       {} of {} places are within reach and limits; of them {} were checked whole, and fail ({})\n",
                 r.fitting, r.places, r.failed, machining::name_of(r.failed_by));
    }
    for (const std::string& note : notes) fmt::print("note: {}\n", note);
    return;
  }
  fmt::print("best   {:.1f} um  {}{}\n", to_um(figure_of(*r.best, r.by)), in_words(r.best->at),
             posture.empty() ? "" : ", posture " + posture);
  fmt::print("       largest {}, as predict gives them there{}\n",
             r.by == PlaceBy::distance ? "distances from the programmed path" : "normal errors",
             r.start_error ? gain_in_words(to_um(*r.start_figure() - figure_of(*r.best, r.by))) : "");
  fmt::print(
      "searched x {:.1f} .. {:.1f}, y {:.1f} .. {:.1f}, z {:.1f} .. {:.1f} mm, rotations {:.1f} .. {:.1f} deg: "
      "{} of {} places are within reach and limits\n",
      to_mm(r.box[0].min), to_mm(r.box[0].max), to_mm(r.box[1].min), to_mm(r.box[1].max), to_mm(r.box[2].min),
      to_mm(r.box[2].max), to_deg(r.turns.min), to_deg(r.turns.max), r.fitting, r.places);
  if (r.at_border)
    fmt::print("note: the best place lies at the boundary of that box; a larger box may hold a better one\n");
  fmt::print("note: the best that a search found; that there is none better is not proven\n");
  for (const std::string& note : notes) fmt::print("note: {}\n", note);
}

}  // namespace

Command place_command() {
  struct Options {
    std::string program, job, branch, report, dynamics;
    WeightQuestion weight;
    std::vector<std::string> measured;
    std::array<std::string, 3> box;
    std::string turn, by = "error";
    int resolution = 13, rotations = 12, threads = 0;
    bool again = false;
  };
  auto o = std::make_shared<Options>();
  return {
      "place", "Where to put the part: the place with the smallest predicted error",
      "polypod place program.ngc --job job.toml --z 0 --report place.html",
      [o](Arguments& a) {
        a.positional("PROGRAM", o->program, "The G-code program");
        a.option("--job", o->job, "The job file; its workpiece is the start", true);
        a.options("--measured", o->measured, kMeasuredHelp);
        a.option("--branch", o->branch, kBranchHelp);
        a.option(
            "--x", o->box[0],
            "lo,hi or one value of x of the workpiece origin in M, mm (default: as far as the program fits from the "
            "start)");
        a.option("--y", o->box[1], "The same for y");
        a.option("--z", o->box[2], "The same for z, the height of the table");
        a.option("--turn", o->turn, "lo,hi or one value of the rotation about z, deg (default: -180,180)");
        a.option("--by", o->by,
                 "What places are compared by: error (default), the largest normal error, which has no vertical part, "
                 "or distance, the largest distance from the programmed path in space");
        a.option("--resolution", o->resolution, {2, 101},
                 "Positions along x and y in the first grid, half as many along z (default: 13)");
        a.option("--rotations", o->rotations, {2, 360}, "Rotations in the first grid (default: 12)");
        a.option("--threads", o->threads, {0, 1024}, "How many threads; the result is the same (default: all)");
        a.option("--report", o->report, "An HTML page with the maps");
        a.option("--dynamics", o->dynamics,
                 "A file with the table `dynamics`: masses (default: that of the machine file)");
        o->weight.declare(a);
        a.flag("--again", o->again, "Take a program that Polypod has corrected like any other");
      },
      [o](const Context& context) -> Result<int> {
        machining::PlaceOptions options;
        if (o->by != "error" && o->by != "distance") {
          return fail("AP284", fmt::format("--by {} is no figure of a place", one_line(o->by)), {},
                      "give error or distance");
        }
        options.by = o->by == "distance" ? PlaceBy::distance : PlaceBy::normal_error;
        const char* names[3] = {"--x", "--y", "--z"};
        for (std::size_t k = 0; k < 3; ++k) {
          if (!context.given(names[k])) continue;
          POLYPOD_ASSIGN(range, range_of(o->box[k], names[k], kFarthest_mm));
          options.box[k] = scaled(range, units::from_mm(1));
        }
        if (context.given("--turn")) {
          POLYPOD_ASSIGN(range, range_of(o->turn, "--turn", kMostTurn_deg));
          options.turns = scaled(range, units::from_deg(1));
        }
        std::vector<std::string> inputs = o->measured;
        inputs.insert(inputs.end(), {o->program, o->job});
        if (!o->dynamics.empty()) inputs.push_back(o->dynamics);
        POLYPOD_TRY(check_files(inputs, {o->report}, context.json));
        POLYPOD_ASSIGN(in, read_input(context, o->program, o->job, o->measured));
        if (!o->branch.empty()) in.job.posture = o->branch;
        // At the start it may be out of reach. Joints to start from have their posture already.
        if (const std::string& asked = in.job.posture;
            !asked.empty() && (in.job.start_joints.empty() || in.job.own_posture || !o->branch.empty())) {
          const std::vector<std::string> known = kinematics::all_postures(in.job.machine);
          if (std::find(known.begin(), known.end(), asked) == known.end()) {
            return fail("AP123",
                        fmt::format("{} {}: this machine has no such posture",
                                    o->branch.empty() ? "the posture of the job," : "--branch", one_line(asked)),
                        {o->branch.empty() ? o->job : ""},
                        known.empty() ? "it has one posture, or its postures have no names: leave it out"
                                      : fmt::format("there are {}", fmt::join(known, ", ")));
          }
        }
        POLYPOD_TRY(machining::set_up(in.job, in.program, in.interpretation));
        POLYPOD_TRY(o->weight.prepare(in.job, o->dynamics, context));
        options.resolution = o->resolution;
        options.rotations = o->rotations;
        options.threads = o->threads;
        options.again = o->again;
        POLYPOD_TRY(read_other_position(in));
        if (in.other) options.other = &*in.other;
        StagesLine line(context);
        options.progress = [&](double share, const char* what) { return line(what, share); };
        POLYPOD_ASSIGN(result, machining::best_place(in.job, in.program, in.interpretation, options));
        line.end();
        if (!o->report.empty() && result.best) {
          POLYPOD_TRY(files::write_whole(
              o->report, pages::place_page(in.job, result, {POLYPOD_VERSION, command_line(), o->program})));
        }
        const std::vector<std::string> notes = notes_of(in, result, o->weight);
        const std::string posture =
            result.best ? posture_at_start(machining::placed_at(in.job, result.best->at), in.interpretation) : "";
        if (context.json) {
          print_json(answer_json(result, posture, notes));
        } else {
          print_answer(result, posture, notes);
          if (!o->report.empty() && result.best) fmt::print("wrote {}\n", one_line(o->report));
        }
        return result.best ? kDone : kAnswerIsNo;
      }};
}

}  // namespace polypod::app
