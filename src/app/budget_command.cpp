// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "covariance_files.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/budget.hpp"
#include "polypod/statics/compliance.hpp"
#include "polypod/statics/rigid.hpp"
#include "polypod/statics/rounding.hpp"
#include "survey_options.hpp"

namespace polypod::app {

namespace {
constexpr config::Range kJointError{0, 100};  // mm or deg: the budget adds to first order
}

Command budget_command() {
  struct Options {
    std::string machine, pose, force, covariance;
    std::vector<std::string> sets, tolerances;
    double resolution = 0, repeatability = 0, backlash = 0, warming = 0, expansion = 12;
  };
  auto o = std::make_shared<Options>();
  return {"budget", "Error budget at a pose: resolution, repeatability, geometric and non-geometric errors",
          "polypod budget lola50 --pose 0,-1300,0 --resolution 0.001 --repeatability 0.002 --tolerance dh.a=0.05 "
          "--tolerance dh.alpha=0.005 --force 0,100,0 --temperature-rise 5",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--pose", o->pose, "x,y,z[,A,B[,C]] in mm and deg", true);
            a.option("--tolerance", o->tolerances, "KEY=mm (angles deg): of elements, as in `errors` (repeatable)");
            a.option("--resolution", o->resolution, kJointError, "Of every joint, mm or deg");
            a.option("--repeatability", o->repeatability, kJointError,
                     "Of every joint, three standard deviations, mm or deg");
            a.option("--backlash", o->backlash, kJointError, "Of every joint, mm or deg");
            a.option("--force", o->force, "Fx,Fy,Fz on the tool tip in M, N");
            a.option("--temperature-rise", o->warming, {-300, 3000}, "Above the temperature of the nominal lengths, K");
            a.option("--covariance", o->covariance,
                     "What `polypod calibrate --covariance` wrote with this machine file: U (k = 2) of its parameters, "
                     "um and mrad of the tool");
            a.option("--expansion", o->expansion, {0, 1000}, "um per m and K (default 12, steel)");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_TRY(check_files({o->machine, o->covariance}, {}, context.json));
            const std::vector<std::string> figures{"rows", "accuracy_um", "repeatability_um"};
            const SingularNote singular(m, context);
            if (const auto no = singular.refusal(figures)) return *no;
            if (o->warming == 0)
              POLYPOD_TRY(refuse(context, {"--expansion"}, "it serves --temperature-rise; give the rise in K"));
            POLYPOD_ASSIGN(here, pose_joints(m, o->pose));
            if (!here.reachable) return cannot_take(context, here.reason);
            Json document = Json::object();
            if (const auto no = said_of_singular_pose(m, here, context, document, figures)) return *no;
            const auto of_joint = [](double v) { return quality::JointError{units::from_mm(v), units::from_deg(v)}; };
            quality::Imperfections known;
            if (!o->covariance.empty()) {
              POLYPOD_ASSIGN(covariance, parameter_covariance(m, o->sets, o->covariance));
              known.covariance = std::move(covariance);
            }
            POLYPOD_ASSIGN(keyed, keyed_numbers(o->tolerances, "--tolerance"));
            POLYPOD_ASSIGN(sizes, quality::sized(m, keyed, true));
            known.tolerances = sizes;
            known.resolution = of_joint(o->resolution);
            known.repeatability = of_joint(o->repeatability);
            known.backlash = of_joint(o->backlash);
            known.warming = o->warming;
            std::vector<std::string> notes;
            known.expansion = units::from_um(o->expansion);
            if (!o->force.empty()) {
              POLYPOD_ASSIGN(f, numbers_of(o->force, "--force"));
              if (f.size() != 3) return fail("AP104", fmt::format("--force {}: not three numbers", o->force));
              POLYPOD_TRY(needs_compliance(m));
              Vec6 wrench = Vec6::Zero();
              wrench.head<3>() = Vec3(f[0], f[1], f[2]);
              const statics::Compliance c = statics::compliance_at(m, here.X_MT);
              known.deflection = c.C * wrench;
              for (std::string note : {statics::rigid_parts_in_words(m),
                                       statics::held_directions_in_words(c.C, statics::rounding_of_tip(m, c))})
                if (!note.empty()) notes.push_back(std::move(note));
            }
            POLYPOD_ASSIGN(b, quality::budget(m, here.X_MT, here.joints, known));
            if (context.json) {
              Json rows = Json::array();
              for (const auto& row : b.rows) {
                rows.push_back({{"source", row.source},
                                {"kind", row.kind},
                                {"position_um", units::to_um(row.position)},
                                {"orientation_rad", row.orientation},
                                {"how", row.how}});
              }
              document.update({{"rows", rows},
                               {"accuracy_um", units::to_um(b.accuracy)},
                               {"accuracy_orientation_rad", b.accuracy_orientation},
                               {"accuracy_rss_um", units::to_um(b.accuracy_rss)},
                               {"accuracy_rss_orientation_rad", b.accuracy_rss_orientation},
                               {"repeatability_um", units::to_um(b.repeatability)},
                               {"repeatability_orientation_rad", b.repeatability_orientation}});
              if (!notes.empty()) document["notes"] = notes;
              print_json(singular.in(document));
              return kDone;
            }
            fmt::print("{:<16} {:<14} {:>12} {:>16}\n", "source", "kind", "position um", "orientation mrad");
            const auto um = [shown = Figures(units::to_um(std::max(b.accuracy, b.repeatability)), 2)](double m_) {
              return shown(units::to_um(m_));
            };
            const auto mrad =
                [shown = Figures(units::to_mrad(std::max(b.accuracy_orientation, b.repeatability_orientation)), 4)](
                    double rad) { return shown(units::to_mrad(rad)); };
            for (const auto& row : b.rows) {
              fmt::print("{:<16} {:<14} {:>12} {:>16}  {}\n", row.source, row.kind, um(row.position),
                         mrad(row.orientation), row.how);
            }
            fmt::print("\naccuracy, all at their worst     {:>10} um {:>10} mrad\n", um(b.accuracy),
                       mrad(b.accuracy_orientation));
            fmt::print("accuracy, independent (squares)  {:>10} um {:>10} mrad\n", um(b.accuracy_rss),
                       mrad(b.accuracy_rss_orientation));
            fmt::print("repeatability (3 sigma)          {:>10} um {:>10} mrad\n", um(b.repeatability),
                       mrad(b.repeatability_orientation));
            for (const std::string& note : notes) fmt::print("note: {}\n", note);
            return kDone;
          }};
}

}  // namespace polypod::app
