// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <memory>

#include "commands.hpp"
#include "messages.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/ellipsoids.hpp"
#include "polypod/quality/singularity.hpp"
#include "quality_files.hpp"

namespace polypod::app {
namespace {

struct Options {
  std::string machine;
  std::vector<std::string> sets, tolerances;
  double length_mm = 0;
  bool ellipsoids = false;
  SurveyArguments where;
  QualityFiles files;
};

/// An ellipsoid in the units that a person reads.
struct Shown {
  const char* key;
  const char* title;
  std::string unit;
  double scale;
  const quality::Ellipsoid& of;
};

/// Joints of one kind have one unit of speed: mm/s or rad/s; joints of both kinds m/s and rad/s.
std::array<Shown, 4> shown(const machine::AnyMachine& m, const quality::Ellipsoids& e, int joints) {
  int turning = 0;
  for (int i = 0; i < joints; ++i) turning += kinematics::joint_kind(m, i) == machine::JointKind::revolute ? 1 : 0;
  const bool sliding = turning == 0, mixed = turning > 0 && turning < joints;
  const std::string speed = sliding ? "mm/s" : mixed ? "m/s or rad/s" : "rad/s";
  const std::string force = sliding ? "N" : mixed ? "N or Nm" : "Nm";
  return {{{"velocity", "speed of the tip", "mm/s per " + speed, sliding ? 1 : units::kMmPerMetre, e.velocity},
           {"rotation", "speed of turning", "rad/s per " + speed, sliding ? units::from_mm(1) : 1, e.rotation},
           {"force", "force at the tip", "N per " + force, 1, e.force},
           {"moment", "moment at the tip", "Nm per " + force, 1, e.moment}}};
}

Json ellipsoids_json(const std::array<Shown, 4>& list) {
  Json out;
  for (const Shown& s : list) {
    Json axes = Json::array(), directions = Json::array();
    for (int k = 0; k < 3; ++k) {
      axes.push_back(number_json(s.of.half_axes[k] * s.scale));
      directions.push_back(vector_json(s.of.directions.col(k)));
    }
    out[s.key] = {{"unit", s.unit}, {"half_axes", axes}, {"directions", directions}};
  }
  return out;
}

void print_ellipsoids(const std::array<Shown, 4>& list) {
  fmt::print("\nhalf axes, and their directions in M\n");
  for (const Shown& s : list) {
    for (int k = 0; k < 3; ++k) {
      const double a = s.of.half_axes[k] * s.scale;
      const Vec3 d = s.of.directions.col(k);
      fmt::print("{:<17} {:>11} {:<20} {:>8.4f} {:>8.4f} {:>8.4f}\n", k == 0 ? s.title : "",
                 std::isfinite(a) ? fmt::format("{:.5g}", a) : "unlimited", k == 0 ? s.unit : "", d.x(), d.y(), d.z());
    }
  }
}

/// A condition number beyond what rounding leaves is that of a singular pose.
double infinite_if_singular(double condition) {
  return condition < 1 / quality::kRankLost ? condition : std::numeric_limits<double>::infinity();
}

Result<int> at_pose(const Options& o, const machine::AnyMachine& m, double length, const SingularNote& singular,
                    const Context& context) {
  POLYPOD_ASSIGN(here, pose_joints(m, o.where.pose));
  if (!here.reachable) return cannot_take(context, here.reason);
  kinematics::Dexterity d = kinematics::dexterity(m, here.X_MT, here.joints, length);
  d.condition = infinite_if_singular(d.condition);
  const quality::Singularity near = quality::singularity(m, here.X_MT, here.joints, length);
  const std::string words = near.kind == 0 ? "" : quality::in_words(here.X_MT, near);
  std::optional<quality::Ellipsoids> ellipsoids;
  if (o.ellipsoids) ellipsoids = quality::ellipsoids(m, here.X_MT, here.joints);
  const int joints = static_cast<int>(here.joints.size());
  if (context.json) {
    Json document{{"condition", constant_json(d.condition)},
                  {"sigma_min", constant_json(d.sigma_min)},
                  {"determinant", constant_json(d.determinant)},
                  {"characteristic_length_mm", units::to_mm(d.characteristic_length)}};
    if (o.ellipsoids) document["ellipsoids"] = ellipsoids ? ellipsoids_json(shown(m, *ellipsoids, joints)) : Json();
    if (!words.empty()) document["singular"] = words;
    print_json(singular.in(document));
    return kDone;
  }
  if (!words.empty()) fmt::print("singular, or close to it: it {}\n", words);
  const bool redundant = kinematics::is_serial(m) && joints > kinematics::task(m).size();
  fmt::print("condition    {}\nsigma_min    {:.6g}\n{:<12} {:.6g}\nangles on    {} mm\n",
             std::isfinite(d.condition) ? fmt::format("{:.6g}", d.condition) : "infinite", d.sigma_min,
             redundant ? "sqrt(det(J J^T))" : "|det|", d.determinant, figure(units::to_mm(d.characteristic_length), 2));
  if (ellipsoids) print_ellipsoids(shown(m, *ellipsoids, joints));
  if (o.ellipsoids && !ellipsoids)
    fmt::print("\nno ellipsoids: at a singular pose the tool moves with all drives locked\n");
  return kDone;
}

/// The page's errors: those of the tolerances that were given, or of 0.01 mm (deg) on every element.
Status write_files(const Options& o, const machine::AnyMachine& m, const quality::SurveyOptions& options,
                   const std::vector<quality::Sized>& sizes, double length, const quality::Survey& survey,
                   const quality::DexterityField& field, const std::vector<std::string>& given,
                   const Context& context) {
  POLYPOD_ASSIGN(errors, quality::tolerance_field(m, survey, options, sizes));
  pages::QualityPageOptions page;
  page.command = command_line();
  page.machine = o.machine;
  page.sets = o.sets;
  page.given = given;
  set_resolution(page, o.where, context);
  page.assumed = o.tolerances.empty();
  return o.files.write({m, options, {true, sizes, {}, length}, {survey, std::move(errors), field}, page});
}

}  // namespace

Command dexterity_command() {
  auto o = std::make_shared<Options>();
  return {
      "dexterity", "Condition number, smallest singular value and determinant of the Jacobian over the workspace",
      "polypod dexterity hexapod-strut --tilt 20",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--length", o->length_mm,
                 "Characteristic length, mm (default: mean distance of platform joints or joint axes from the tip; of "
                 "machines in series 1000)");
        a.flag("--ellipsoids", o->ellipsoids, "With --pose: ellipsoids of velocity and force of the tool");
        a.option("--tolerance", o->tolerances,
                 "KEY=mm (angles deg): for the errors in the files (repeatable, default all=0.01)");
        o->where.declare(a);
        o->files.declare(a);
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        if (context.given("--length")) POLYPOD_TRY(in_range("AP165", "--length", o->length_mm, kLength_mm, "mm"));
        if (!kinematics::task(m).turns()) {
          POLYPOD_TRY(refuse(context, {"--length"}, "it serves machines that can turn their tool"));
        }
        const double length = units::from_mm(o->length_mm);
        const bool at_one = !o->where.pose.empty();
        POLYPOD_TRY(o->where.refuse_at_pose(context));
        POLYPOD_TRY(o->files.check(m, at_one, o->machine, context.json));
        if (o->ellipsoids && !at_one) return fail("AP175", "--ellipsoids are those of one pose", {}, "give --pose");
        if (!o->tolerances.empty() && !o->files.any()) {
          return fail("AP176", "--tolerance is for the files alone", {}, "give --report, or take `polypod errors`");
        }
        const SingularNote singular(m, context);
        if (const auto no = singular.refusal({"condition", "sigma_min", "determinant"})) return *no;
        if (at_one) return at_pose(*o, m, length, singular, context);
        const std::vector<std::string> given =
            o->tolerances.empty() ? std::vector<std::string>{"all=0.01"} : o->tolerances;
        std::vector<quality::Sized> sizes;
        if (o->files.any()) {
          POLYPOD_ASSIGN(keyed, keyed_numbers(given, "--tolerance"));
          POLYPOD_ASSIGN(found, quality::sized(m, keyed, true));
          sizes = std::move(found);
        }
        POLYPOD_ASSIGN(options, o->where.options(m, context));
        POLYPOD_ASSIGN(survey, quality::survey(m, options));
        POLYPOD_ASSIGN(field, quality::dexterity_field(m, survey, options, length));
        if (o->files.any()) POLYPOD_TRY(write_files(*o, m, options, sizes, length, survey, field, given, context));
        const auto seen = [&](const quality::Quantity& quantity, std::size_t number) {
          return quality::statistics_seen(m, survey, options, quantity, field.anywhere, number);
        };
        quality::Statistics condition = seen(field.condition, 0);
        for (double* value : {&condition.min, &condition.mean, &condition.max}) *value = infinite_if_singular(*value);
        const quality::Statistics sigma = seen(field.sigma_min, 1), determinant = seen(field.determinant, 2);
        const quality::Extreme worst = quality::worst_seen(m, survey, options, field.condition, field.anywhere, 0);
        const quality::Extreme least = quality::worst_seen(m, survey, options, field.sigma_min, field.anywhere, 1, -1);
        const double largest_condition = infinite_if_singular(worst.value);
        if (context.json) {
          Json document{{"condition", statistics_json(survey, condition)},
                        {"sigma_min", statistics_json(survey, sigma)},
                        {"determinant", statistics_json(survey, determinant)},
                        {"worst",
                         {{"condition", number_json(largest_condition)},
                          {"pose", pose_for_user(m, worst.X_MT)},
                          {"sigma_min", number_json(least.value)},
                          {"sigma_min_pose", pose_for_user(m, least.X_MT)}}},
                        {"extremes", kSeen},
                        {"points", survey.inside.size()},
                        {"directions", survey.orientations.size()},
                        {"whole_box", survey.whole_box},
                        {"beyond_singular", beyond_json(survey.beyond)},
                        {"characteristic_length_mm", field.length > 0 ? Json(units::to_mm(field.length)) : Json()}};
          document.update(size_json(survey));
          print_json(singular.in(document));
          return kDone;
        }
        print_statistics(
            survey,
            {{"condition", condition, 1, 4, ""}, {"sigma_min", sigma, 1, 4, ""}, {"|det|", determinant, 1, 4, ""}});
        print_where(m, survey);
        if (std::isfinite(condition.min)) {
          fmt::print("best conditioned at {}, worst at {}\n", place_text(condition.min_at, survey.task),
                     place_text(condition.max_at, survey.task));
        } else {
          fmt::print("every point of the grid has a singular pose\n");
        }
        fmt::print("worst pose seen: condition {} at {}; least sigma_min seen: {} at {}\n",
                   beside_singular(condition) ? fmt::format("{:.0e}", largest_condition) : figure(largest_condition, 4),
                   pose_text(m, worst.X_MT, 2), figure(least.value, 4), pose_text(m, least.X_MT, 2));
        o->files.print();
        return kDone;
      }};
}

}  // namespace polypod::app
