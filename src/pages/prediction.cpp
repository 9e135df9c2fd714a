// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/prediction.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "correction_figures.hpp"
#include "path_answers.hpp"
#include "path_film.hpp"
#include "polypod/core/units.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {
namespace {

using machining::Job;
using machining::MovePrediction;
using machining::Prediction;
using report::fixed;
using report::Verdict;
using units::to_mm;
using units::to_um;

constexpr const char* kUm = "µm";

void answer(report::Report& report, const Job& job, const Prediction& p, const PredictionPageOptions& options) {
  report.add_section("Does the deflected tool stay within the tolerance?");
  const double tube = to_um(job.tolerance);
  const std::string largest = fmt::format(
      "the largest distance from the programmed path is {} {} with the controller's corners, the tolerance "
      "{:g} {}",
      fixed(to_um(p.largest_with_corners), 1), kUm, tube, kUm);
  const bool outside = p.largest_with_corners > job.tolerance - machining::resolution(job);
  if (options.within) {
    report.add_verdict(p.all_judged() ? Verdict::good : Verdict::neutral,
                       fmt::format("Yes{}: {}.", p.all_judged() ? "" : ", apart from what was not judged", largest));
  } else {
    const bool open = !outside && options.against.empty() && !p.not_judged.empty();
    report.add_verdict(Verdict::bad,
                       fmt::format("No{}: {}.", open ? ", because not all of the cut is judged" : "", largest));
  }
  for (const std::string& why : options.against) report.add_verdict(Verdict::bad, with_sign(why));
  for (const machining::NotJudged& m : p.not_judged)
    report.add_verdict(Verdict::neutral, fmt::format("Not judged: line {}: {}.", m.line, with_sign(m.why)));
  add_not_judged(report, p.steep, "");
  add_not_judged(report, p.slow, "");
  add_not_judged(report, p.plunges, "");
  if (p.other_switch) add_other_position(report, *p.other_switch, false);
  report.add_key_figures({{fixed(to_um(p.largest_distance), 1), kUm, "largest distance from the programmed path",
                           outside          ? Verdict::bad
                           : options.within ? Verdict::good
                                            : Verdict::neutral},
                          {fixed(to_um(p.deflection.max), 1), kUm, "largest deflection", Verdict::neutral},
                          {fixed(to_um(p.normal.mean), 1), kUm, "mean normal error", Verdict::neutral},
                          {fixed(p.time, 1), "s", "with the planner's acceleration", Verdict::neutral},
                          {fixed(units::to_mm3(p.pass.removed), 0), "mm³", "removed", Verdict::neutral}});
  report.add_text(
      "The normal error lies across the path in the plane: above zero the cutter leaves material on the wall that it "
      "cuts, below zero it gouges. The distance is taken in space, to the programmed move with both its ends.");
  report.add_text(fmt::format(
      "This answers for static deflection under the mean cutting force{} and for the controller's corners alone: not "
      "for collisions of tool, holder and machine, {}{}and not for geometric errors of the machine.",
      options.with_vibration ? ", the vibration at tooth passing" : "",
      options.with_vibration ? "" : "not for vibration, ",
      options.weight.empty() ? "not for the machine's own weight, " : ""));
  if (!options.weight.empty()) report.add_text(with_sign(options.weight));
  if (options.at_rest)
    report.add_text("The force is that at the commanded point, without the feedback of the deflection on the cut.");
  if (!p.notes.empty()) report.add_list(p.notes);
}

void table_of_moves(report::Report& report, const Prediction& p) {
  if (p.moves.empty()) return;
  report.add_section("Moves");
  constexpr std::size_t kWhole = 60, kWorst = 30;
  std::vector<const MovePrediction*> chosen;
  for (const MovePrediction& m : p.moves) chosen.push_back(&m);
  report::Table table;
  if (chosen.size() > kWhole) {
    std::stable_sort(chosen.begin(), chosen.end(),
                     [](const auto* a, const auto* b) { return a->largest_distance > b->largest_distance; });
    table.caption = fmt::format("The {} of {} moves that cut which are farthest off, worst first", kWorst,
                                fixed(static_cast<double>(chosen.size()), 0));
    chosen.resize(kWorst);
  }
  table.columns = {
      {"line", "", -1},    {"length", "mm", 2},          {"normal error, least", kUm, 1}, {"mean", kUm, 1},
      {"largest", kUm, 1}, {"largest distance", kUm, 1}, {"largest deflection", kUm, 1},  {"mean force", "N", 1},
      {"depth", "mm", 2}};
  for (const MovePrediction* m : chosen)
    table.rows.push_back({std::to_string(m->line), to_mm(m->length), to_um(m->normal.min), to_um(m->normal.mean),
                          to_um(m->normal.max), to_um(m->largest_distance), to_um(m->deflection.max),
                          m->mean_force_size, to_mm(m->largest_depth)});
  report.add_table(table);
}

}  // namespace

std::string prediction_page(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                            const Prediction& prediction, LongVector<machining::Sample> samples,
                            const PredictionPageOptions& options) {
  std::vector<std::pair<std::string, std::string>> facts{
      {"program", program.path},
      {"job", job.path},
      {"machine", job.machine_name},
      {"tolerance", fmt::format("tube of {:g} {} radius", to_um(job.tolerance), kUm)}};
  if (!options.version.empty()) facts.emplace_back("made with", "Polypod " + options.version);
  report::Report report("The deflection along the program",
                        fmt::format("What {} will do when it runs this program as it is. The tolerance zone is a "
                                    "cylinder round the programmed path with a sphere at each end, called tube here",
                                    machine::name_of(job.machine)),
                        facts);
  // The pictures are those of a correction that has not been made.
  machining::Correction c;
  c.programmed = interpretation.moves;
  c.before.samples = std::move(samples);
  c.tolerance = job.tolerance;
  const Tracks tracks(program, c);
  answer(report, job, prediction, options);
  if (!tracks.stretches.empty()) {
    const Overview view = overview(job, c, tracks);
    add_path_film(report, job, program, c, tracks, view.factor, options.collides ? nullptr : &prediction.stock_left);
    report.add_section("Errors along the path");
    add_error_plots(report, c, tracks, "");
    report.add_figure(view.plot,
                      fmt::format("From above, in the workpiece frame. The deflection of the cutter is drawn "
                                  "{:g} times larger than it is.",
                                  view.factor));
    report.add_section("Forces and engagement");
    report.add_figure(force_plot(c, tracks, job.tool_frame.axis()),
                      "Mean force per revolution that the material puts on the tool.");
    report.add_figure(depth_plot(tracks), "Largest axial depth at which the cutter is engaged.");
  }
  table_of_moves(report, prediction);
  if (!options.command.empty()) {
    report.add_section("Inputs");
    report.add_text(machine::description_of(job.machine));
    report.add_code("The command that made this page", options.command, false);
  }
  return report.to_html();
}

}  // namespace polypod::pages
