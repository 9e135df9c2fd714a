// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "survey_options.hpp"

#include "busy_line.hpp"
#include "messages.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>

#include "polypod/core/figures.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/singularity.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::app {

void SurveyArguments::declare(Arguments& a) {
  a.option("--pose", pose, "x,y,z[,A,B[,C]] in mm and deg: at this pose instead of over the workspace");
  declare_region(a);
}

void SurveyArguments::declare_region(Arguments& a) {
  a.option("--box", box,
           "x0,y0,z0,x1,y1,z1: over this box instead of the workspace, mm (a task without x, y, z: its coordinates, mm "
           "and deg)");
  a.option("--resolution", resolution, "Points along the longest side, 8 to 512, of a --box 2 to 512 (default 24)");
  workspace.declare_directions(a);
  workspace.declare_limits(a);
  workspace.declare_threads(a);
}

Result<quality::SurveyOptions> SurveyArguments::options(const machine::AnyMachine& m, const Context& context) const {
  quality::SurveyOptions out;
  POLYPOD_ASSIGN(options, workspace.options(m, context));
  POLYPOD_TRY(in_range("WS130", "--resolution", resolution, {box.empty() ? 8.0 : 2.0, 512}, "points"));
  out.workspace = options;
  out.workspace.progress = nullptr;
  out.resolution = resolution;
  out.progress = [busy = std::make_shared<BusyLine>(context, "looking for what is reached"),
                  line = progress_line(context, "survey")](double share) {
    busy->end();
    line(share);
  };
  if (box.empty()) return out;
  POLYPOD_ASSIGN(n, numbers_of(box, "--box"));
  const machine::Task task = kinematics::task(m);
  const int sides = workspace::coordinates_of_points(task);
  if (static_cast<int>(n.size()) != 2 * sides) {
    return fail("AP161", fmt::format("--box {}: not {} numbers, two corners of {} coordinates", box, 2 * sides, sides));
  }
  out.box = {Vec3::Constant(-workspace::kAcross), Vec3::Constant(workspace::kAcross)};
  for (int i = 0; i < 2 * sides; ++i) {
    (*out.box)[static_cast<std::size_t>(i / sides)][i % sides] =
        units::from_user(n[static_cast<std::size_t>(i)], workspace::unit_of(task, i % sides));
  }
  if (!(((*out.box)[1] - (*out.box)[0]).minCoeff() >= 0)) {
    return fail("AP161", fmt::format("--box {}: the first corner must not lie above the second", box));
  }
  return out;
}

Status SurveyArguments::refuse_at_pose(const Context& context) const {
  if (pose.empty()) return {};
  return refuse(context,
                {"--box", "--resolution", "--tilt", "--a-range", "--b-range", "--interference", "--without",
                 "--singularity-distance", "--threads"},
                "with --pose one pose is judged: leave out --pose for a box or the workspace");
}

Json number_json(double value) {
  return std::isfinite(value) ? Json(value) : Json();
}

Region size_of(const quality::Survey& survey) {
  const bool proven = survey.volume_lower < survey.volume_upper;
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  return region_of(survey.task.places() ? machine::Task::point : survey.task, survey.volume,
                   proven ? survey.volume_lower : kNone, proven ? survey.volume_upper : kNone);
}

Json point_json(const machine::Task& task, const Vec3& p) {
  const Vec3 shown = workspace::for_user(task, p);
  Json out = Json::array();
  for (int k = 0; k < workspace::coordinates_of_points(task); ++k) out.push_back(shown[k]);
  return out;
}

Json statistics_json(const quality::Survey& survey, const quality::Statistics& s, double scale) {
  const std::string unit = survey.task.places() ? "_mm" : "";
  return {{"min", number_json(s.min * scale)},
          {"mean", number_json(s.mean * scale)},
          {"max", number_json(s.max * scale)},
          {"stddev", number_json(s.stddev * scale)},
          {"min_at" + unit, point_json(survey.task, s.min_at)},
          {"max_at" + unit, point_json(survey.task, s.max_at)}};
}

Json size_json(const quality::Survey& survey) {
  const Region size = size_of(survey);
  if (!survey.task.places()) return measure_json(survey.task, size);
  return {{"volume_mm3", size.measure},
          {"volume_lower_mm3", number_json(size.lower)},
          {"volume_upper_mm3", number_json(size.upper)}};
}

Result<std::vector<std::pair<std::string, double>>> keyed_numbers(const std::vector<std::string>& texts,
                                                                  const char* option) {
  std::vector<std::pair<std::string, double>> out;
  for (const std::string& text : texts) {
    const std::size_t equals = text.rfind('=');
    double value = 0;
    const char* const end = text.data() + text.size();
    if (equals == std::string::npos || equals == 0 ||
        std::from_chars(text.data() + equals + 1, end, value).ptr != end || equals + 1 == text.size() ||
        !(std::abs(value) <= kAnyNumber.max)) {
      return fail("AP160", fmt::format("{} {}: not KEY=number, of at most {:g} in size", option, text, kAnyNumber.max),
                  {}, "write base.joint=0.01");
    }
    out.emplace_back(text.substr(0, equals), value);
  }
  return out;
}

Json constant_json(double value) {
  return {{"min", number_json(value)}, {"mean", number_json(value)}, {"max", number_json(value)}, {"stddev", 0.0}};
}

Result<std::vector<quality::Sized>> sizes_argument(const machine::AnyMachine& m, const std::vector<std::string>& errors,
                                                   const std::vector<std::string>& tolerances) {
  if (errors.empty() == tolerances.empty()) {
    return fail("AP163", "errors or tolerances must be given, and only one of them", {},
                "give --tolerance all=0.01 or --error leg.length[1]=0.01");
  }
  const bool tolerance = errors.empty();
  POLYPOD_ASSIGN(keyed, tolerance ? keyed_numbers(tolerances, "--tolerance") : keyed_numbers(errors, "--error"));
  return quality::sized(m, keyed, tolerance);
}

Result<quality::Region> region_argument(const std::string& text) {
  if (text == "box") return quality::Region::box;
  if (text == "sphere") return quality::Region::sphere;
  return fail("AP164", fmt::format("--region {}: unknown", text), {}, "box or sphere");
}

Json beyond_json(const workspace::BeyondSingular& beyond) {
  return {{"points", beyond.points}, {"beyond", beyond.beyond}};
}

std::string beyond_text(const machine::AnyMachine& m, const workspace::BeyondSingular& beyond, const char* looked_at,
                        const char* include) {
  if (beyond.beyond == 0) return "";
  const machine::Task task = kinematics::task(m);
  const double percent = 100.0 * static_cast<double>(beyond.beyond) / static_cast<double>(beyond.points);
  return fmt::format(
      "note: {} % of {} {} lie beyond a singular pose from home (type 2): the machine gets there only through a "
      "pose at which the drives do not constrain it. {} them; {}\n",
      percent < 10 ? fmt::format("{:.2g}", percent) : fmt::format("{:.0f}", percent), beyond.points, looked_at, include,
      task.holds(machine::Coordinate::z) ? "limits leave them out, as `--set limits.z_min_mm=...`"
      : kinematics::joint_kind(m, 0) == machine::JointKind::revolute
          ? "limits leave them out, as `--set leg[1].max_deg=...`"
          : "limits of the legs or a smaller box leave them out");
}

void print_where(const machine::AnyMachine& m, const quality::Survey& survey) {
  if (!survey.whole_box) {
    fmt::print("only {} of {} points of the box are in the workspace\n", survey.inside.size(), survey.grid.size());
  }
  fmt::print("{}", beyond_text(m, survey.beyond, "poses that were looked at", "These figures include"));
}

bool beside_singular(const quality::Statistics& s) {
  constexpr double kMany = 100;
  return std::isfinite(s.max) && s.max > kMany * std::abs(s.mean);
}

void print_statistics(const quality::Survey& survey, const std::vector<StatisticsRow>& rows) {
  if (!survey.task.places()) {
    std::string names;
    for (int k = 0; k < survey.task.size(); ++k)
      names += fmt::format("{}{}", k > 0 ? ", " : "", machine::name_of(survey.task[k]));
    fmt::print("{} points of the workspace in {}; min and max are the least and largest seen\n", survey.inside.size(),
               names);
  } else if (survey.orientations.size() == 1) {
    fmt::print("one tool direction at {} points of the workspace; min and max are the least and largest seen\n",
               survey.inside.size());
  } else {
    fmt::print(
        "means over {} directions at {} points of the workspace; min and max are the least and largest mean seen\n",
        survey.orientations.size(), survey.inside.size());
  }
  fmt::print("{:<12} {:>11}  {:>11}  {:>12}  {:>11}\n", "", "min", "mean", "max", "stddev");
  std::vector<std::string> large;
  for (const StatisticsRow& row : rows) {
    const Figures shown(row.scale * row.of.mean, row.decimals);
    const auto text = [&](double value) { return shown(row.scale * value); };
    const bool beside = beside_singular(row.of), wild = beside || !std::isfinite(row.of.max);
    if (wild) large.push_back(row.name);
    const auto of_grid = [&](double value) {
      return wild && std::isfinite(value) ? fmt::format("{:.2g}", row.scale * value) : text(value);
    };
    fmt::print("{:<12} {:>11}  {:>11}  {:>12}  {:>11}{}\n", row.name, text(row.of.min), of_grid(row.of.mean),
               beside ? fmt::format("{:.0e}", row.scale * row.of.max) : text(row.of.max), of_grid(row.of.stddev),
               row.unit.empty() ? "" : " " + row.unit);
  }
  if (!large.empty()) {
    fmt::print(
        "note: the largest {} {} more than a hundred times the mean, as beside a singular pose: other points see "
        "other maxima and means\n",
        listed(large), large.size() > 1 ? "are" : "is");
  }
}

std::string place_text(const Vec3& p, const machine::Task& task) {
  if (!task.places()) {
    const Vec3 shown = workspace::for_user(task, p);
    double longest = 0;
    for (int k = 0; k < task.size(); ++k)
      if (!task.is_angle(k)) longest = std::max(longest, std::abs(shown[k]));
    constexpr double kRounding = 1e-12;
    const double span = std::max(longest, 1.0);
    const Figures mm(span, 1);
    std::string out;
    for (int k = 0; k < task.size(); ++k) {
      out += fmt::format("{}{} {} {}", k > 0 ? ", " : "", machine::name_of(task[k]),
                         task.is_angle(k)                        ? fmt::format("{:.1f}", shown[k] + 0.0)
                         : std::abs(shown[k]) < kRounding * span ? mm(0)
                                                                 : mm(shown[k]),
                         workspace::unit_of(task, k));
    }
    return out;
  }
  const Figures shown(units::to_mm(p.norm()), 1);
  return fmt::format("{}, {}, {} mm", shown(units::to_mm(p.x())), shown(units::to_mm(p.y())),
                     shown(units::to_mm(p.z())));
}

Result<PoseJoints> pose_joints(const machine::AnyMachine& m, const std::string& text) {
  POLYPOD_ASSIGN(X, pose_argument(m, text));
  PoseJoints out{X, {}, false, {}};
  const kinematics::InverseResult result = kinematics::inverse(m, X);
  if (const kinematics::Solution* s = result.reachable()) {
    out.joints = s->joints;
    out.reachable = true;
    return out;
  }
  out.reason = kinematics::reason_of(m, result);
  return out;
}

std::optional<int> said_of_singular_pose(const machine::AnyMachine& m, const PoseJoints& here, const Context& context,
                                         Json& document, const std::vector<std::string>& figures) {
  const quality::Singularity s = quality::singularity(m, here.X_MT, here.joints);
  if (s.kind == 0) return {};
  const std::string words = quality::in_words(here.X_MT, s);
  document["singular"] = words;
  if (s.control >= quality::kRankLost) {
    if (context.json) return {};
    if (s.control < quality::kSingularThreshold) {
      fmt::print(
          "close to singular (the smallest singular value of A is below {:g}), so that figures to first order say "
          "little: it {}\n",
          quality::kSingularThreshold, words);
    } else {
      fmt::print("note: it {}; the figures hold all the same\n", words);
    }
    return {};
  }
  for (const std::string& key : figures) document[key] = Json();
  if (context.json) print_json(document);
  std::fflush(stdout);
  fmt::print(stderr, "polypod: there are no figures at this pose: the tool {}\n", words);
  return kAnswerIsNo;
}

}  // namespace polypod::app
