// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "busy_line.hpp"
#include "commands.hpp"
#include "messages.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/surplus.hpp"
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

Json twist_json(const Vec6& twist) {
  const Vec3 p = twist.head<3>() * units::kMmPerMetre;
  return {{"position_mm", vector_json(p)}, {"rotation_rad", vector_json(twist.tail<3>())}};
}

/// Each element's part in the largest position error, the largest first; those that differ by rounding alone stay in
/// their order.
std::vector<quality::WorstCase::Share> ranked(const quality::WorstCase& worst) {
  constexpr double kSame = 1e-9;
  auto shares = worst.shares;
  double largest = 0;
  for (const auto& s : shares) largest = std::max(largest, s.position);
  const auto rounded = [&](const auto& s) { return largest > 0 ? std::round(s.position / (kSame * largest)) : 0; };
  std::stable_sort(shares.begin(), shares.end(), [&](const auto& a, const auto& b) { return rounded(a) > rounded(b); });
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
  std::vector<std::pair<int, double>> values;
  for (const auto& s : worst.shares) values.emplace_back(s.element, s.position);
  const std::vector<quality::Bar> bars = quality::bars_of(m, values);
  if (bars.empty()) return;
  fmt::print("\ncontributions to the largest position error; elements with the same contribution are one line\n");
  constexpr std::size_t kShown = 15;
  constexpr double kWidth = 20;
  const Figures mm(units::to_mm(bars[0].total()), 5);
  double rest = 0;
  for (std::size_t i = 0; i < bars.size(); ++i) {
    const quality::Bar& bar = bars[i];
    if (i >= kShown) {
      rest += bar.total();
      continue;
    }
    const double share = worst.position > 0 ? bar.total() / worst.position : 0;
    const std::string length(static_cast<std::size_t>(kWidth * bar.total() / bars[0].total() + 0.5), '#');
    const std::string each =
        bar.elements > 1 ? fmt::format(" ({} x {} mm)", bar.elements, mm(units::to_mm(bar.each))) : "";
    fmt::print("  {:>10} mm {:>5.1f} %  {:<20}  {}{}\n", mm(units::to_mm(bar.total())), 100 * share, length, bar.name,
               each);
  }
  if (bars.size() > kShown) fmt::print("  {:>10} mm {:>29}  the others\n", mm(units::to_mm(rest)), "");
}

constexpr const char* kTwoElements =
    "A joint and its attachment count as two elements here, and their tolerances add up";

/// Known errors or tolerances over the workspace, and where they are largest.
struct Surveyed {
  quality::ErrorField field;
  quality::Statistics position, orientation;
  quality::Extreme worst, worst_turned;
};

Result<Surveyed> surveyed(const machine::AnyMachine& m, const quality::Survey& survey,
                          const quality::SurveyOptions& options, const std::vector<quality::Sized>& sizes,
                          bool tolerances, const quality::ToleranceOptions& tolerance) {
  POLYPOD_ASSIGN(f, tolerances ? quality::tolerance_field(m, survey, options, sizes, tolerance)
                               : quality::known_error_field(m, survey, options, sizes));
  Surveyed out;
  out.position = quality::statistics_seen(m, survey, options, f.position, f.anywhere, 0);
  out.orientation = quality::statistics_seen(m, survey, options, f.orientation, f.anywhere, 1);
  out.worst = quality::worst_seen(m, survey, options, f.position, f.anywhere, 0);
  out.worst_turned = quality::worst_seen(m, survey, options, f.orientation, f.anywhere, 1);
  out.field = std::move(f);
  return out;
}

/// position_mm, orientation_rad and worst of a document.
Json surveyed_json(const machine::AnyMachine& m, const quality::Survey& survey, const Surveyed& s) {
  return {{"position_mm", statistics_json(survey, s.position, units::kMmPerMetre)},
          {"orientation_rad", statistics_json(survey, s.orientation)},
          {"worst",
           {{"position_mm", number_json(units::to_mm(s.worst.value))},
            {"orientation_rad", number_json(s.worst_turned.value)},
            {"pose", pose_for_user(m, s.worst.X_MT)}}},
          {"extremes", kSeen}};
}

Result<int> at_pose(const Options& o, const machine::AnyMachine& m, const std::vector<quality::Sized>& sizes,
                    const quality::ToleranceOptions& tolerance, const SingularNote& singular, const Context& context) {
  POLYPOD_ASSIGN(here, pose_joints(m, o.where.pose));
  if (!here.reachable) return cannot_take(context, here.reason);
  Json document{{"pose", pose_for_user(m, here.X_MT)}, {"joints", joints_for_user(m, here.joints)}};
  if (const auto no = said_of_singular_pose(m, here, context, document, {"position_mm", "orientation_rad"})) return *no;
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
    const double turned_apart = exact ? quality::orientation_error(m, here.X_MT, linear - *exact) : 0;
    document["linear_minus_exact_rad"] = exact ? Json(turned_apart) : Json();
    if (context.json) {
      print_json(singular.in(document));
      return kDone;
    }
    // What rounding leaves of no turn and no shift is none.
    constexpr double kRounding = 1e-14;  // rad, and of the position in mm
    const auto clean = [](double x) { return std::abs(x) < kRounding ? 0.0 : x; };
    const Vec3 p = (linear.head<3>() * units::kMmPerMetre).unaryExpr(clean), w = linear.tail<3>().unaryExpr(clean);
    const Figures mm(position, 6), rad(clean(orientation), 8);
    fmt::print("position     {} mm  ({}, {}, {})\n", mm(position), mm(p.x()), mm(p.y()), mm(p.z()));
    const bool of_axis = kinematics::task(m).names_axis() && std::abs(orientation - w.norm()) > 1e-6 * w.norm();
    fmt::print("orientation  {} rad{} ({}, {}, {})\n", rad(clean(orientation)), of_axis ? " of the tool axis" : "",
               rad(w.x()), rad(w.y()), rad(w.z()));
    if (exact) {
      const double turned = clean(quality::orientation_error(m, here.X_MT, *exact));
      fmt::print("exactly      {} mm, {:.3g} mm from the linear error\n", mm(units::to_mm(exact->head<3>().norm())),
                 clean(units::to_mm((linear - *exact).head<3>().norm())));
      if (kinematics::task(m).turns() || clean(orientation) != 0 || turned != 0) {
        fmt::print("             {} rad, {:.3g} rad from the linear error\n", rad(turned), clean(turned_apart));
      }
    } else {
      fmt::print("exactly      the erroneous machine has no pose near this one: {}\n",
                 kinematics::has_more_legs_than_freedoms(m)
                     ? "it has more legs than freedoms, and with this error they do not agree without strain"
                     : "it is close to singular");
    }
    return kDone;
  }
  POLYPOD_ASSIGN(worst, quality::worst_case(m, here.X_MT, here.joints, sizes, tolerance));
  document["method"] = o.method;
  document["region"] = o.region;
  document["position_mm"] = constant_json(units::to_mm(worst.position));
  document["orientation_rad"] = constant_json(worst.orientation);
  document["extremes"] = tolerance.method == quality::Method::exact ? kBound : kSeen;
  std::optional<quality::WorstCase> once;  // each joint
  if (const auto fewer = quality::one_element_a_joint(m, sizes)) {
    POLYPOD_ASSIGN(found, quality::worst_case(m, here.X_MT, here.joints, *fewer, tolerance));
    once = found;
    document["one_element_a_joint"] = {{"position_mm", constant_json(units::to_mm(found.position))},
                                       {"orientation_rad", constant_json(found.orientation)}};
  }
  document["worst_position_error"] = twist_json(worst.position_error);
  document["worst_orientation_error"] = twist_json(worst.orientation_error);
  document["contributions"] = shares_json(m, worst);
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
    POLYPOD_TRY(in_range("QU103", "--samples", o.samples, {100, 10'000'000}, "machines"));
    POLYPOD_TRY(in_range("QU103", "--confidence", o.confidence, {50, 99.99}, "%"));
    BusyLine busy(context, "drawing machines");
    POLYPOD_ASSIGN(found, quality::spread(m, here.X_MT, here.joints, sizes, options));
    busy.end();
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
    print_json(singular.in(document));
    return kDone;
  }
  const Figures mm(units::to_mm(worst.position), 6), rad(worst.orientation, 8);
  fmt::print("largest position error     {} mm ({})\n", mm(units::to_mm(worst.position)), o.method);
  fmt::print("largest orientation error  {} rad\n", rad(worst.orientation));
  if (once) {
    fmt::print("{}.\nWith one element a joint:  {} mm, {} rad\n", kTwoElements, mm(units::to_mm(once->position)),
               rad(once->orientation));
  }
  if (sampled) {
    fmt::print("root sum square            {} mm, {} rad\n", mm(units::to_mm(spread.rss_position)),
               rad(spread.rss_orientation));
    fmt::print("{:g} % of {} machines, {}: below {} mm ({} to {}), {} rad\n", o.confidence, o.samples, o.distribution,
               mm(units::to_mm(spread.position.quantile)), mm(units::to_mm(spread.position.quantile_low)),
               mm(units::to_mm(spread.position.quantile_high)), rad(spread.orientation.quantile));
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
            a.option(
                "--tolerance", o->tolerances,
                "KEY=mm (angles deg): at most so much in either direction; a joint and its attachment are two elements "
                "(repeatable)");
            a.option("--method", o->method, "Of tolerances: exact (default), or search (JEL 5.3, never above exact)");
            a.option("--region", o->region, "Where a joint's tolerance lets it be: box (default) or sphere");
            a.option("--distribution", o->distribution,
                     "With --pose: uniform, normal or triangular; statistics by sampling");
            a.option("--samples", o->samples, "How many machines are sampled (default 20000)");
            a.option("--confidence", o->confidence, "Fraction of them that the quantile covers, % (default 99.73)");
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
            POLYPOD_TRY(o->files.check(m, !o->where.pose.empty(), o->machine, context.json));
            const SingularNote singular(m, context);
            if (const auto no = singular.refusal({"position_mm", "orientation_rad"})) return *no;
            if (!o->where.pose.empty()) return at_pose(*o, m, sizes, tolerance, singular, context);

            POLYPOD_ASSIGN(options, o->where.options(m, context));
            POLYPOD_ASSIGN(survey, quality::survey(m, options));
            POLYPOD_ASSIGN(found, surveyed(m, survey, options, sizes, tolerances, tolerance));
            std::optional<Surveyed> once;  // each joint
            if (const auto fewer = quality::one_element_a_joint(m, sizes); tolerances && fewer) {
              POLYPOD_ASSIGN(f, surveyed(m, survey, options, *fewer, true, tolerance));
              once = std::move(f);
            }
            if (o->files.any()) {
              POLYPOD_ASSIGN(dexterity, quality::dexterity_field(m, survey, options));
              pages::QualityPageOptions page;
              page.command = command_line();
              page.machine = o->machine;
              page.sets = o->sets;
              set_resolution(page, o->where, context);
              page.given = tolerances ? o->tolerances : o->errors;
              POLYPOD_TRY(o->files.write(
                  {m, options, {tolerances, sizes, tolerance, 0}, {survey, found.field, std::move(dexterity)}, page}));
            }
            const quality::Extreme& worst = found.worst;
            quality::WorstCase case_there;
            std::string singular_there;
            if (const auto q = quality::joints_at(m, worst.X_MT)) {
              const quality::Singularity near = quality::singularity(m, worst.X_MT, *q);
              if ((near.kind & 2) != 0) singular_there = quality::in_words(worst.X_MT, near);
              if (tolerances) {
                POLYPOD_ASSIGN(there, quality::worst_case(m, worst.X_MT, *q, sizes, tolerance));
                case_there = there;
              }
            }
            if (context.json) {
              Json document = surveyed_json(m, survey, found);
              document["points"] = survey.inside.size();
              document["directions"] = survey.orientations.size();
              document["whole_box"] = survey.whole_box;
              document["beyond_singular"] = beyond_json(survey.beyond);
              document.update(size_json(survey));
              if (!singular_there.empty()) document["worst"]["singular"] = singular_there;
              document["method"] = tolerances ? o->method : "linear";
              if (tolerances) {
                document["region"] = o->region;
                document["contributions"] = std::isfinite(worst.value) ? shares_json(m, case_there) : Json::array();
              }
              if (once) document["one_element_a_joint"] = surveyed_json(m, survey, *once);
              print_json(singular.in(document));
              return kDone;
            }
            print_statistics(survey, {{"position", found.position, units::kMmPerMetre, 6, "mm"},
                                      {"orientation", found.orientation, 1, 7, "rad"}});
            print_where(m, survey);
            if (survey.orientations.size() > 1)
              fmt::print("largest mean seen at {}\n", place_text(found.position.max_at, survey.task));
            fmt::print("worst pose seen: {} mm at {}\n", figure(units::to_mm(worst.value), 6),
                       pose_text(m, worst.X_MT, 2));
            if (!singular_there.empty()) {
              fmt::print(
                  "There it {}. First order says little so close to a singular pose, and larger errors lie "
                  "beside it.\n",
                  singular_there);
            }
            if (once) {
              fmt::print("{}.\nWith one element a joint: mean {} mm, worst pose seen {} mm\n", kTwoElements,
                         figure(units::to_mm(once->position.mean), 6), figure(units::to_mm(once->worst.value), 6));
            }
            if (tolerances && std::isfinite(worst.value)) print_shares(m, case_there);  // else the shares are rounding
            o->files.print();
            return kDone;
          }};
}

}  // namespace polypod::app
