// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <limits>
#include <memory>

#include "commands.hpp"
#include "messages.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/quality/tolerance_design.hpp"
#include "survey_options.hpp"

namespace polypod::app {
namespace {

/// "mm", or "mm or deg" where one number serves lengths in mm and angles in deg.
std::string unit_in_words(const std::vector<std::string>& units) {
  std::vector<std::string> out;
  for (const std::string& unit : units) out.push_back(unit.empty() ? "without unit" : unit);
  return units == std::vector<std::string>{""} ? "" : fmt::format("{}", fmt::join(out, " or "));
}

/// A tolerance with four figures, rounded down: what is promised must hold for the printed one.
std::string rounded_down(double tolerance) {
  const Figures shown(tolerance, 5, 4);
  constexpr double kRounding = 1 + 1e-9;
  const double step = std::pow(10.0, -shown.decimals());
  return shown(std::floor(kRounding * tolerance / step) * step);
}

}  // namespace

Command tolerances_command() {
  struct Options {
    std::string machine, region = "box", rule = "weighted";
    std::vector<std::string> sets, groups;
    double wanted_mm = 0, wanted_rad = 0;
    SurveyArguments where;
  };
  auto o = std::make_shared<Options>();
  return {
      "tolerances", "The loosest tolerances that keep the tool's error below a required value, wherever it was judged",
      "polypod tolerances hexapod-strut --required 0.05 --group leg.length=1 --group base.joint=2 --box "
      "-10,-10,60,10,10,70 --tilt 10",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--required", o->wanted_mm, "Largest error of the tip at the poses that are judged, mm");
        a.option("--required-angle", o->wanted_rad,
                 "Largest error of the orientation, rad (alone, or beside the other)");
        a.option("--group", o->groups, "KEY=weight: elements with one tolerance (repeatable; default: all alike)");
        a.option("--rule", o->rule,
                 "weighted (default): tolerances in the ratio of the weights; cost: least sum of weight / tolerance");
        a.option("--region", o->region, "Where a joint's tolerance lets it be: box (default) or sphere");
        o->where.declare_region(a);
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        if (o->rule != "weighted" && o->rule != "cost") {
          return fail("AP168", fmt::format("--rule {}: unknown", o->rule), {}, "weighted or cost");
        }
        const bool of_tip = context.given("--required"), of_angle = context.given("--required-angle");
        if (!of_tip && !of_angle) {
          return fail("AP122", "nothing is required", {}, "give --required (mm), --required-angle (rad) or both");
        }
        if (of_tip) POLYPOD_TRY(in_range("AP122", "--required", o->wanted_mm, {1e-9, 1e6}, "mm"));
        if (of_angle) POLYPOD_TRY(in_range("AP122", "--required-angle", o->wanted_rad, {1e-12, 10}, "rad"));
        quality::DesignOptions design;
        design.position = of_tip ? units::from_mm(o->wanted_mm) : std::numeric_limits<double>::infinity();
        if (of_angle) design.orientation = o->wanted_rad;
        if (o->rule == "cost") design.rule = quality::DesignRule::cost;
        POLYPOD_ASSIGN(region, region_argument(o->region));
        design.region = region;
        if (o->groups.empty()) o->groups = {"all=1"};
        POLYPOD_ASSIGN(keyed, keyed_numbers(o->groups, "--group"));
        std::vector<quality::ToleranceGroup> groups;
        for (const auto& [key, weight] : keyed) groups.push_back({key, weight});
        POLYPOD_ASSIGN(options, o->where.options(m, context));
        options.progress = nullptr;
        const SingularNote singular(m, context);
        if (const auto no = singular.refusal({"tolerances", "position_mm", "orientation_rad"})) return *no;
        POLYPOD_ASSIGN(survey, quality::survey(m, options));
        POLYPOD_ASSIGN(d, quality::design_tolerances(m, survey, options, groups, design));
        if (context.json) {
          Json parts = Json::array();
          for (const auto& p : d.parts) {
            parts.push_back({{"key", p.key},
                             {"tolerance", p.tolerance},
                             {"unit", unit_in_words(p.units)},
                             {"elements", p.elements},
                             {"contribution_percent", 100 * p.share}});
          }
          print_json(singular.in({{"tolerances", parts},
                                  {"position_mm", units::to_mm(d.position)},
                                  {"orientation_rad", d.orientation},
                                  {"worst_pose", pose_for_user(m, d.worst)},
                                  {"extremes", kSeen},
                                  {"cost", d.cost},
                                  {"points", survey.inside.size()},
                                  {"directions", survey.orientations.size()},
                                  {"whole_box", survey.whole_box},
                                  {"beyond_singular", beyond_json(survey.beyond)}}));
        } else {
          for (const auto& p : d.parts) {
            fmt::print("{:<24} {:>10} {:<9} {:>3} elements, {:>5.1f} % of the error\n", p.key,
                       rounded_down(p.tolerance), unit_in_words(p.units), p.elements, 100 * p.share);
          }
          fmt::print("largest error seen {} mm, {} rad, at {}\n", figure(units::to_mm(d.position), 6),
                     figure(d.orientation, 7), pose_text(m, d.worst, 2));
          fmt::print(
              "judged at {} points (tool directions at each: {}) and between the worst of them: exact at every "
              "pose, but not a bound on the poses between\n",
              survey.inside.size(), survey.orientations.size());
          print_where(m, survey);
        }
        return survey.whole_box ? kDone : kAnswerIsNo;
      }};
}

}  // namespace polypod::app
