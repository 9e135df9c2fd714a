// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "commands.hpp"
#include "polypod/core/units.hpp"
#include "polypod/quality/singularity.hpp"
#include "quality_files.hpp"

namespace polypod::app {
namespace {

struct Options {
  std::string machine, method = "exact", region = "box", distribution;
  std::vector<std::string> sets, errors, tolerances;
  int samples = 20'000, seed = 1;
  double confidence = 99.73;
  SurveyArguments where;
  QualityFiles files;

  Options() { files.value = pages::QualityValue::position; }
};

std::string command_line(const Options& o) {
  std::string out = "polypod errors " + for_shell(o.machine);
  for (const std::string& set : o.sets) out += option_in_words("--set", set);
  for (const std::string& error : o.errors) out += option_in_words("--error", error);
  for (const std::string& tolerance : o.tolerances) out += option_in_words("--tolerance", tolerance);
  if (o.method != "exact") out += option_in_words("--method", o.method);
  if (o.region != "box") out += option_in_words("--region", o.region);
  return out + in_words(o.where) + o.files.in_words();
}

Json twist_json(const Vec6& twist) {
  const Vec3 p = twist.head<3>() * units::kMmPerMetre;
  return {{"position_mm", vector_json(p)}, {"rotation_rad", vector_json(twist.tail<3>())}};
}

/// Each element's part in the largest position error, the largest first.
std::vector<quality::WorstCase::Share> ranked(const quality::WorstCase& worst) {
  auto shares = worst.shares;
  std::stable_sort(shares.begin(), shares.end(), [](const auto& a, const auto& b) { return a.position > b.position; });
  return shares;
}

Json shares_json(const machine::AnyMachine& m, const quality::WorstCase& worst) {
  const auto all = quality::elements(m);
  Json out = Json::array();
  for (const auto& s : ranked(worst)) {
    out.push_back({{"element", all[static_cast<std::size_t>(s.element)].key},
                   {"position_mm", units::to_mm(s.position)},
                   {"orientation_rad", s.orientation}});
  }
  return out;
}

void print_shares(const machine::AnyMachine& m, const quality::WorstCase& worst) {
  const auto all = quality::elements(m);
  const auto shares = ranked(worst);
  fmt::print("\nshares of the largest position error\n");
  double rest = 0;
  constexpr std::size_t kShown = 15;
  for (std::size_t i = 0; i < shares.size(); ++i) {
    if (i >= kShown) {
      rest += shares[i].position;
      continue;
    }
    const double share = worst.position > 0 ? shares[i].position / worst.position : 0;
    fmt::print("  {:<24} {:>10.5f} mm {:>5.1f} %  {}\n", all[static_cast<std::size_t>(shares[i].element)].key,
               units::to_mm(shares[i].position), 100 * share, std::string(static_cast<std::size_t>(100 * share), '#'));
  }
  if (shares.size() > kShown) fmt::print("  {:<24} {:>10.5f} mm\n", "the others", units::to_mm(rest));
}

Result<int> at_pose(const Options& o, const machine::AnyMachine& m, const std::vector<quality::Sized>& sizes,
                    const quality::ToleranceOptions& tolerance, const Context& context) {
  POLYPOD_ASSIGN(here, pose_joints(m, o.where.pose));
  if (!here.reachable) {
    fmt::print(stderr, "polypod: the machine cannot take this pose: {}\n", here.reason);
    return kAnswerIsNo;
  }
  Json document{{"pose", pose_for_user(m, here.X_MT)}, {"joints", joints_for_user(m, here.joints)}};
  // Where standing drives do not hold the tool, the smallest error moves it any way.
  const quality::Singularity near = quality::singularity(m, here.X_MT, here.joints);
  constexpr double kUnbounded = 1e-9;
  if (near.kind != 0) document["singular"] = quality::in_words(here.X_MT, near);
  if (near.control < kUnbounded) {
    document["position_mm"] = document["orientation_rad"] = Json();
    if (context.json) print_json(document);
    fmt::print(stderr, "polypod: no error is bounded here: the tool {}\n", quality::in_words(here.X_MT, near));
    return kAnswerIsNo;
  }
  if (near.kind != 0 && !context.json) {
    fmt::print("close to singular, so that first order says little: it {}\n", quality::in_words(here.X_MT, near));
  }
  if (o.tolerances.empty()) {
    document["method"] = "linear";
    const Vec6 linear = quality::known_error(m, here.X_MT, here.joints, sizes);
    const auto exact = quality::known_error_exact(m, here.X_MT, here.joints, sizes);
    const double position = units::to_mm(linear.head<3>().norm());
    const double orientation = quality::orientation_error(m, here.X_MT, linear);
    document["position_mm"] = constant_json(position);
    document["orientation_rad"] = constant_json(orientation);
    document["error"] = twist_json(linear);
    document["error_exact"] = exact ? twist_json(*exact) : Json();
    document["linear_minus_exact_mm"] = exact ? Json(units::to_mm((linear - *exact).head<3>().norm())) : Json();
    if (context.json) {
      print_json(document);
      return kDone;
    }
    const Vec3 p = linear.head<3>() * units::kMmPerMetre, w = linear.tail<3>();
    fmt::print("position     {:.6f} mm  ({:.6f}, {:.6f}, {:.6f})\n", position, p.x(), p.y(), p.z());
    fmt::print("orientation  {:.8f} rad ({:.8f}, {:.8f}, {:.8f})\n", orientation, w.x(), w.y(), w.z());
    if (exact) {
      fmt::print("exactly      {:.6f} mm, {:.3g} mm from the linear error\n", units::to_mm(exact->head<3>().norm()),
                 units::to_mm((linear - *exact).head<3>().norm()));
    } else {
      fmt::print("exactly      the erroneous machine has no pose near this one: it is close to singular\n");
    }
    return kDone;
  }
  POLYPOD_ASSIGN(worst, quality::worst_case(m, here.X_MT, here.joints, sizes, tolerance));
  document["method"] = o.method;
  document["region"] = o.region;
  document["position_mm"] = constant_json(units::to_mm(worst.position));
  document["orientation_rad"] = constant_json(worst.orientation);
  document["worst_position_error"] = twist_json(worst.position_error);
  document["worst_orientation_error"] = twist_json(worst.orientation_error);
  document["shares"] = shares_json(m, worst);
  quality::Spread spread;
  const bool sampled = !o.distribution.empty();
  if (sampled) {
    quality::SpreadOptions options;
    options.samples = o.samples;
    options.confidence = o.confidence / 100;
    options.seed = static_cast<std::uint64_t>(o.seed);
    using quality::Distribution;
    if (o.distribution == "uniform")
      options.distribution = Distribution::uniform;
    else if (o.distribution == "normal")
      options.distribution = Distribution::normal;
    else if (o.distribution == "triangular")
      options.distribution = Distribution::triangular;
    else
      return fail("AP162", fmt::format("--distribution {}: unknown", o.distribution), {},
                  "uniform, normal or triangular");
    POLYPOD_ASSIGN(found, quality::spread(m, here.X_MT, here.joints, sizes, options));
    spread = found;
    const auto json = [](const quality::Spread::Sampled& s, double scale, double rss) {
      return Json{{"rss", rss * scale},
                  {"mean", s.mean * scale},
                  {"quantile", s.quantile * scale},
                  {"quantile_95_percent", {s.quantile_low * scale, s.quantile_high * scale}}};
    };
    document["statistics"] = {{"distribution", o.distribution},
                              {"samples", o.samples},
                              {"confidence_percent", o.confidence},
                              {"position_mm", json(spread.position, units::kMmPerMetre, spread.rss_position)},
                              {"orientation_rad", json(spread.orientation, 1, spread.rss_orientation)}};
  }
  if (context.json) {
    print_json(document);
    return kDone;
  }
  fmt::print("largest position error     {:.6f} mm ({})\n", units::to_mm(worst.position), o.method);
  fmt::print("largest orientation error  {:.8f} rad\n", worst.orientation);
  if (sampled) {
    fmt::print("root sum square            {:.6f} mm, {:.8f} rad\n", units::to_mm(spread.rss_position),
               spread.rss_orientation);
    fmt::print("{:g} % of {} machines, {}: below {:.6f} mm ({:.6f} to {:.6f}), {:.8f} rad\n", o.confidence, o.samples,
               o.distribution, units::to_mm(spread.position.quantile), units::to_mm(spread.position.quantile_low),
               units::to_mm(spread.position.quantile_high), spread.orientation.quantile);
  }
  print_shares(m, worst);
  return kDone;
}

/// Options that say how tolerances, statistics or surveys are worked out, where there are none.
Status refuse_unused(const Options& o, const Context& context) {
  if (o.tolerances.empty()) {
    POLYPOD_TRY(refuse(context, {"--method", "--region", "--distribution", "--samples", "--confidence", "--seed"},
                       "it serves --tolerance; a known error has one result"));
  }
  if (o.where.pose.empty()) POLYPOD_TRY(refuse(context, {"--distribution"}, "it serves --pose; give a pose"));
  if (o.distribution.empty()) {
    POLYPOD_TRY(refuse(context, {"--samples", "--confidence", "--seed"}, "it serves --distribution; give one"));
  }
  return o.where.refuse_at_pose(context);
}

}  // namespace

Command errors_command() {
  auto o = std::make_shared<Options>();
  return {"errors", "Error of the tool from known errors, or the largest that tolerances allow",
          "polypod errors hexapod-strut --tolerance all=0.01 --tilt 20",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--error", o->errors,
                     "KEY=mm (angles deg): a known error; KEY: leg.length, base.joint[2], all, ... (repeatable)");
            a.option("--tolerance", o->tolerances, "KEY=mm (angles deg): at most so much either way (repeatable)");
            a.option("--method", o->method, "Of tolerances: exact (default), or search (JEL 5.3, never above exact)");
            a.option("--region", o->region, "Where a joint's tolerance lets it be: box (default) or sphere");
            a.option("--distribution", o->distribution,
                     "With --pose: uniform, normal or triangular; statistics by sampling");
            a.option("--samples", o->samples, "How many machines are sampled (default 20000)");
            a.option("--confidence", o->confidence, "Share of them that the quantile covers, % (default 99.73)");
            a.option("--seed", o->seed, "Of the random numbers (default 1)");
            o->where.declare(a);
            o->files.declare(a);
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            const bool tolerances = !o->tolerances.empty();
            POLYPOD_ASSIGN(sizes, sizes_argument(m, o->errors, o->tolerances));
            quality::ToleranceOptions tolerance;
            if (o->method != "exact" && o->method != "search") {
              return fail("AP121", fmt::format("--method {}: unknown", o->method), {}, "exact or search");
            }
            if (o->method == "search") tolerance.method = quality::Method::search;
            POLYPOD_ASSIGN(region, region_argument(o->region));
            tolerance.region = region;
            POLYPOD_TRY(refuse_unused(*o, context));
            POLYPOD_TRY(o->files.check(!o->where.pose.empty()));
            if (!o->where.pose.empty()) return at_pose(*o, m, sizes, tolerance, context);

            POLYPOD_ASSIGN(options, o->where.options(m, context));
            POLYPOD_ASSIGN(survey, quality::survey(m, options));
            POLYPOD_ASSIGN(field, tolerances ? quality::tolerance_field(m, survey, options, sizes, tolerance)
                                             : quality::known_error_field(m, survey, options, sizes));
            if (o->files.any()) {
              POLYPOD_ASSIGN(dexterity, quality::dexterity_field(m, survey, options));
              pages::QualityPageOptions page;
              page.command = command_line(*o);
              page.machine = o->machine;
              page.sets = o->sets;
              page.given = tolerances ? o->tolerances : o->errors;
              POLYPOD_TRY(o->files.write(
                  {m, options, {tolerances, sizes, tolerance, 0}, {survey, field, std::move(dexterity)}, page}));
            }
            const quality::Statistics position = quality::statistics(survey, field.position.mean);
            const quality::Statistics orientation = quality::statistics(survey, field.orientation.mean);
            const quality::Extreme worst = quality::worst_of(survey, field.position);
            const quality::Extreme worst_turned = quality::worst_of(survey, field.orientation);
            quality::WorstCase case_there;
            if (const auto q = quality::joints_at(m, worst.X_MT); tolerances && q) {
              POLYPOD_ASSIGN(found, quality::worst_case(m, worst.X_MT, *q, sizes, tolerance));
              case_there = found;
            }
            if (context.json) {
              Json document{{"position_mm", statistics_json(position, units::kMmPerMetre)},
                            {"orientation_rad", statistics_json(orientation)},
                            {"worst",
                             {{"position_mm", number_json(units::to_mm(worst.value))},
                              {"orientation_rad", number_json(worst_turned.value)},
                              {"pose", pose_for_user(m, worst.X_MT)}}},
                            {"points", survey.inside.size()},
                            {"directions", survey.orientations.size()},
                            {"volume_mm3", units::to_mm3(survey.volume)}};
              document["method"] = tolerances ? o->method : "linear";
              if (tolerances) {
                document["region"] = o->region;
                document["shares"] = shares_json(m, case_there);
              }
              print_json(document);
              return kDone;
            }
            const Vec3 at = position.max_at * units::kMmPerMetre;
            fmt::print("means over {} directions at {} points of the workspace\n", survey.orientations.size(),
                       survey.inside.size());
            fmt::print("               min          mean           max        stddev\n");
            fmt::print("position    {:>10.6f}  {:>10.6f}  {:>12.6f}  {:>10.6f} mm\n", units::to_mm(position.min),
                       units::to_mm(position.mean), units::to_mm(position.max), units::to_mm(position.stddev));
            fmt::print("orientation {:>10.7f}  {:>10.7f}  {:>12.7f}  {:>10.7f} rad\n", orientation.min,
                       orientation.mean, orientation.max, orientation.stddev);
            fmt::print("largest mean at {:.1f}, {:.1f}, {:.1f} mm\n", at.x(), at.y(), at.z());
            fmt::print("worst pose: {:.6f} mm at {}\n", units::to_mm(worst.value), pose_text(m, worst.X_MT, 2));
            if (tolerances) print_shares(m, case_there);
            o->files.print();
            return kDone;
          }};
}

}  // namespace polypod::app
