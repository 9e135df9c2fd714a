// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/place.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "polypod/core/units.hpp"
#include "polypod/machine/assumed.hpp"
#include "polypod/machining/check.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {
namespace {

using machining::PlaceBy;
using machining::PlaceFit;
using machining::PlacePoint;
using machining::PlaceResult;
using machining::Placing;
using units::to_deg;
using units::to_mm;
using units::to_um;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

std::string in_words(const Placing& at) {
  return fmt::format("x {}, y {}, z {} mm, turned by {} deg", report::fixed(to_mm(at.origin.x()), 1),
                     report::fixed(to_mm(at.origin.y()), 1), report::fixed(to_mm(at.origin.z()), 1),
                     report::fixed(to_deg(at.turn), 1));
}

std::string range(const machine::JointRange& r, double (*user)(double)) {
  return fmt::format("{} .. {}", report::fixed(user(r.min), 1), report::fixed(user(r.max), 1));
}

report::HeatMap map_of(const PlaceResult& result, const std::string& title, const std::string& label,
                       const std::string& unit, double (*value)(const PlacePoint&)) {
  const machining::PlaceMap& map = result.map;
  report::HeatMap out;
  out.title = title;
  out.x = {"x of the origin", "mm", to_mm(map.x.min), to_mm(map.x.max)};
  out.y = {"y of the origin", "mm", to_mm(map.y.min), to_mm(map.y.max)};
  out.columns = map.columns;
  out.rows = map.rows;
  for (const PlacePoint& p : map.points) out.values.push_back(p.fit == PlaceFit::fits ? value(p) : kNone);
  out.label = label;
  out.unit = unit;
  out.markers.push_back(
      {"best", {to_mm(result.best->at.origin.x()), to_mm(result.best->at.origin.y())}, report::Colour::ink});
  out.markers.push_back(
      {"start", {to_mm(result.start.origin.x()), to_mm(result.start.origin.y())}, report::Colour::ink});
  return out;
}

/// Whether a picture over x and y can be drawn.
bool drawn(const machining::PlaceMap& map) {
  return map.columns > 1 && map.rows > 1;
}

report::HeatMap stops_of(const PlaceResult& result) {
  report::HeatMap out = map_of(result, "What stops the program", "", "", [](const PlacePoint&) { return 0.0; });
  out.kinds = {"fits", "out of reach", "a joint limit", "singular", "outside of the measured compliance"};
  out.values.clear();
  for (const PlacePoint& p : result.map.points) {
    int kind = 0;
    if (p.fit == PlaceFit::reach) kind = 1;
    if (p.fit == PlaceFit::limit || p.fit == PlaceFit::branch || p.fit == PlaceFit::speed) kind = 2;
    if (p.fit == PlaceFit::singular) kind = 3;
    if (p.fit == PlaceFit::measured) kind = 4;
    out.kind.push_back(kind);
    out.values.push_back(0.5);
  }
  out.min = 0;
  out.max = 1;
  out.contour_labels = false;
  return out;
}

}  // namespace

std::string place_page(const machining::Job& job, const PlaceResult& result, const PlacePageOptions& options) {
  const machining::JudgedPlace& best = *result.best;
  std::vector<std::pair<std::string, std::string>> facts{{"machine", job.machine_name}};
  if (!options.program.empty()) facts.emplace_back("program", options.program);
  if (!options.version.empty()) facts.emplace_back("Polypod", options.version);
  const bool by_distance = result.by == PlaceBy::distance;
  const char* figure = by_distance ? "largest distance of the tool from its path" : "largest normal error";
  const double best_figure = figure_of(best, result.by);
  report::Report page("Where to put the part", fmt::format("The {} over places of the workpiece", figure), facts);
  page.add_section("Answer");
  if (result.start_error) {
    const double gain = *result.start_figure() - best_figure;
    page.add_verdict(result.farther_there() ? report::Verdict::neutral : report::Verdict::good,
                     gain > 0   ? fmt::format("The best place that was found is {}: the {} there is "
                                                "{:.1f} µm, {:.1f} µm less than at the start.",
                                              in_words(best.at), figure, to_um(best_figure), to_um(gain))
                     : gain < 0 ? fmt::format("No place within the box is as good as the start: the best of it is {}, "
                                              "{:.1f} µm, {:.1f} µm more.",
                                              in_words(best.at), to_um(best_figure), to_um(-gain))
                                : std::string("No place that was looked at is better than the start."));
  } else {
    page.add_verdict(
        report::Verdict::bad,
        fmt::format("Where the part is, the program does not fit the machine ({}). The best place that was "
                    "found is {}: the {} there is {:.1f} µm.",
                    machining::name_of(result.start_fit), in_words(best.at), figure, to_um(best_figure)));
  }
  std::vector<report::KeyFigure> figures;
  if (result.start_error)
    figures.push_back({report::fixed(to_um(*result.start_figure()), 1), "µm", fmt::format("{} at the start", figure)});
  figures.push_back({report::fixed(to_um(best_figure), 1), "µm", "at the best place", report::Verdict::good});
  figures.push_back(
      {std::to_string(result.fitting), "", fmt::format("of {} places are within reach and limits", result.places)});
  page.add_key_figures(figures);
  if (result.at_border)
    page.add_text(
        "The best place lies at the boundary of the box that was searched: a larger box may hold a better one.");
  if (result.farther_there())
    page.add_text(
        fmt::format("But the deflected tool is up to {:.1f} µm from the programmed path there, and up to {:.1f} µm at "
                    "the start: the "
                    "normal error, by which places are compared, has no vertical part.",
                    to_um(best.distance), to_um(*result.start_distance)));
  if (result.held)
    page.add_text(
        "The part is not turned: the program tilts the tool by A and B, which are axes of the machine and do not turn "
        "with it.");
  page.add_text(
      "Both figures are what polypod predict gives with the job moved there. The place is the best that a search "
      "found; that there is none better is not proven.");

  page.add_section("Maps");
  if (drawn(result.map)) {
    const std::string where = fmt::format("z = {} mm, turned by {} deg", report::fixed(to_mm(result.map.z), 1),
                                          report::fixed(to_deg(result.map.turn), 1));
    page.add_figure(by_distance ? map_of(result, "Largest distance", "distance", "µm",
                                         [](const PlacePoint& p) { return to_um(p.distance); })
                                : map_of(result, "Largest normal error", "error", "µm",
                                         [](const PlacePoint& p) { return to_um(p.error); }),
                    fmt::format("Estimated {} with the origin of the workpiece at each place, ", figure) + where +
                        ". Blank: the program does not fit there.");
    page.add_figure_grid(
        2,
        {{"Compliance across the path", map_of(result, "Compliance across the path", "compliance", "µm/N",
                                               [](const PlacePoint& p) { return units::to_um_per_N(p.compliance); })},
         {"Joints' margin", map_of(result, "Joints' margin", "margin", "% of the range",
                                   [](const PlacePoint& p) { return 100 * p.margin; })},
         {"What stops the program", stops_of(result)}},
        "The largest compliance across the path of the cuts (small is stiff); the smallest distance of a joint from "
        "the ends of its range on the way, in per cent of the range (50 is the middle); and what stops the program, "
        "at " +
            where + ".");
  } else {
    page.add_text("No map over x and y: one of them does not change in the box that was searched.");
  }
  if (result.rotations.size() > 1) {
    report::LinePlot plot;
    plot.title = by_distance ? "Distance over the rotation of the part" : "Error over the rotation of the part";
    plot.x.label = "rotation of the workpiece";
    plot.x.unit = "deg";
    plot.y.label = figure;
    plot.y.unit = "µm";
    plot.y.with_zero = true;
    report::Series series{"estimated", {}, {}};
    for (const PlacePoint& p : result.rotations) {
      series.x.push_back(to_deg(p.at.turn));
      series.y.push_back(p.fit == PlaceFit::fits ? to_um(figure_of(p, result.by)) : kNone);
    }
    plot.series.push_back(series);
    plot.x_levels.push_back({"best", to_deg(best.at.turn), report::Colour::muted});
    page.add_figure(plot, "At the position of the best place. Gaps: the program does not fit.");
  }

  page.add_section("Places that were judged");
  report::Table table;
  table.columns = {{"x", "mm", 1},
                   {"y", "mm", 1},
                   {"z", "mm", 1},
                   {"rotation", "deg", 1},
                   {"largest normal error", "µm", 1},
                   {"largest distance", "µm", 1},
                   {by_distance ? "distance, estimated" : "error, estimated", "µm", 1}};
  double off = 0;
  for (const machining::JudgedPlace& j : result.judged) {
    table.rows.push_back({to_mm(j.at.origin.x()), to_mm(j.at.origin.y()), to_mm(j.at.origin.z()), to_deg(j.at.turn),
                          to_um(j.error), to_um(j.distance), to_um(by_distance ? j.distance_estimate : j.estimate)});
    off = std::max(off, std::abs(by_distance ? j.distance - j.distance_estimate : j.error - j.estimate));
  }
  page.add_table(table);
  page.add_text(fmt::format(
      "Maps are estimates: the forces are those of the cut at {}, put to the compliance at each place, at the most "
      "loaded points of the program. Where polypod predict was asked, the estimate was off by up to {:.1f} µm.",
      in_words(result.reference), to_um(off)));

  page.add_section("What this page does not answer");
  std::vector<std::string> open{
      "Whether machine, tool and part collide with a table, a fixture or each other.",
      "Whether the part can be clamped there, and how exactly.",
      job.weights
          ? "How the part deflects under its own weight; that of the machine counts, against the deflection at the "
            "origin of the workpiece, in the normal errors and not along the tool."
          : "What the weights of machine and part do.",
      fmt::format("Places outside of the box x {}, y {}, z {} mm, rotations {} deg.", range(result.box[0], to_mm),
                  range(result.box[1], to_mm), range(result.box[2], to_mm), range(result.turns, to_deg)),
      fmt::format("Points of the program between the {} that an estimate looks at; the whole program was "
                  "checked at the places of the table.",
                  result.looked_at)};
  if (const std::string joints = machining::without_speed(job.joint_speeds); !joints.empty())
    open.push_back(fmt::format("Whether the joints are fast enough: {}.", joints));
  if (machine::limits_are_assumed(job.machine))
    open.push_back(fmt::format("Limits of the joints: {}.", machine::kAssumedLimits));
  page.add_list(open);
  if (!options.command.empty()) page.add_code("The command that made this page", options.command, false);
  return page.to_html();
}

}  // namespace polypod::pages
