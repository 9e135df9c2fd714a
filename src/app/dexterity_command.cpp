// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "survey_options.hpp"

namespace polypod::app {

Command dexterity_command() {
  struct Options {
    std::string machine;
    std::vector<std::string> sets;
    double length_mm = 0;
    SurveyArguments where;
  };
  auto o = std::make_shared<Options>();
  return {
      "dexterity", "Condition number, smallest singular value and |det J| over the workspace",
      "polypod dexterity hexapod-strut --tilt 20",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--length", o->length_mm,
                 "Characteristic length, mm (default: mean distance of platform joints or joint axes from the tip)");
        o->where.declare(a);
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        if (!(o->length_mm >= 0)) return fail("AP165", fmt::format("--length {}: must be above 0", o->length_mm));
        const double length = units::from_mm(o->length_mm);
        if (!o->where.pose.empty()) {
          POLYPOD_ASSIGN(here, pose_joints(m, o->where.pose));
          if (!here.reachable) {
            fmt::print(stderr, "polypod: the machine cannot take this pose: {}\n", here.reason);
            return kAnswerIsNo;
          }
          const kinematics::Dexterity d = kinematics::dexterity(m, here.X_MT, here.joints, length);
          if (context.json) {
            const auto fixed = [](double v) {
              return Json{{"min", number_json(v)}, {"mean", number_json(v)}, {"max", number_json(v)}, {"stddev", 0.0}};
            };
            print_json({{"condition", fixed(d.condition)},
                        {"sigma_min", fixed(d.sigma_min)},
                        {"determinant", fixed(d.determinant)},
                        {"characteristic_length_mm", units::to_mm(d.characteristic_length)}});
          } else {
            fmt::print("condition    {:.6g}\nsigma_min    {:.6g}\n|det|        {:.6g}\nangles on    {:.2f} mm\n",
                       d.condition, d.sigma_min, d.determinant, units::to_mm(d.characteristic_length));
          }
          return kDone;
        }
        POLYPOD_ASSIGN(options, o->where.options(m, context));
        POLYPOD_ASSIGN(survey, quality::survey(m, options));
        POLYPOD_ASSIGN(field, quality::dexterity_field(m, survey, options, length));
        const quality::Statistics condition = quality::statistics(survey, field.condition.mean);
        const quality::Statistics sigma = quality::statistics(survey, field.sigma_min.mean);
        const quality::Statistics determinant = quality::statistics(survey, field.determinant.mean);
        if (context.json) {
          print_json({{"condition", statistics_json(condition)},
                      {"sigma_min", statistics_json(sigma)},
                      {"determinant", statistics_json(determinant)},
                      {"volume_mm3", units::to_mm3(survey.volume)},
                      {"points", survey.inside.size()},
                      {"directions", survey.orientations.size()},
                      {"characteristic_length_mm", field.length > 0 ? Json(units::to_mm(field.length)) : Json()}});
          return kDone;
        }
        fmt::print("means over {} directions at {} points of the workspace\n", survey.orientations.size(),
                   survey.inside.size());
        fmt::print("                  min        mean         max      stddev\n");
        for (const auto& [name, s] :
             {std::pair{"condition", condition}, {"sigma_min", sigma}, {"|det|", determinant}}) {
          fmt::print("{:<10} {:>10.4f}  {:>10.4f}  {:>10.4f}  {:>10.4f}\n", name, s.min, s.mean, s.max, s.stddev);
        }
        const Vec3 best = condition.min_at * units::kMmPerMetre, worst = condition.max_at * units::kMmPerMetre;
        fmt::print("best conditioned at {:.1f}, {:.1f}, {:.1f} mm, worst at {:.1f}, {:.1f}, {:.1f} mm\n", best.x(),
                   best.y(), best.z(), worst.x(), worst.y(), worst.z());
        return kDone;
      }};
}

}  // namespace polypod::app
