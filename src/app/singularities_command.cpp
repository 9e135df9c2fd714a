// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/singularity.hpp"
#include "survey_options.hpp"

namespace polypod::app {
namespace {

Json singularity_json(const machine::AnyMachine& m, const Pose& X, const quality::Singularity& s) {
  const auto twist = [](const Vec6& t) {
    return Json{{"v", vector_json(t.head<3>() * units::kMmPerMetre)}, {"w", vector_json(t.tail<3>())}};
  };
  Json idle = Json::array();
  for (int i = 0; i < s.idle_joints.size(); ++i) idle.push_back(s.idle_joints[i]);
  Json out{{"pose", pose_for_user(m, X)},
           {"type", s.kind},
           {"sigma_min_b", s.mobility},
           {"sigma_min_a", s.control},
           {"words", quality::in_words(X, s)},
           {"lost_motion", twist(s.lost_motion)},
           {"free_motion", twist(s.free_motion)},
           {"idle_joints", idle},
           {"characteristic_length_mm", units::to_mm(s.length)}};
  if (s.constraints) out["constraints"] = *s.constraints;
  return out;
}

}  // namespace

Command singularities_command() {
  struct Options {
    std::string machine, pose, to;
    std::vector<std::string> sets;
    double length_mm = 0;
    int samples = 200;
  };
  auto o = std::make_shared<Options>();
  return {"singularities",
          "How near a pose or a path is to a singularity, of which type (1 serial, 2 parallel, 3 both), and which "
          "motion is lost or free",
          "polypod singularities hexapod-strut --pose 0,0,75 --to 0,0,75,0,0,80",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--pose", o->pose, "x,y,z[,A,B[,C]] in mm and deg", true);
            a.option("--to", o->to, "The same: look along the straight path to this pose");
            a.option("--samples", o->samples, {2, 100000}, "Of the path, 2 to 100000 (default 200)");
            a.option("--length", o->length_mm, kLength_mm, "Characteristic length, mm");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            if (o->to.empty()) POLYPOD_TRY(refuse(context, {"--samples"}, "it serves --to; give where the path ends"));
            if (!o->to.empty()) POLYPOD_TRY(refuse(context, {"--length"}, "it serves a single pose; leave out --to"));
            const double length = units::from_mm(o->length_mm);
            POLYPOD_ASSIGN(X, pose_argument(m, o->pose));
            const SingularNote singular(m, context);
            if (!o->to.empty()) {
              POLYPOD_ASSIGN(Y, pose_argument(m, o->to));
              const quality::PathSingularity p = quality::along_path(m, X, Y, o->samples);
              if (p.reached == 0) return cannot_take(context, p.stopped_by, "the first pose");
              if (context.json) {
                print_json(singular.in({{"path_fraction", p.share},
                                        {"at", singularity_json(m, p.X_MT, p.at)},
                                        {"crossed", p.crossed},
                                        {"reached_fraction", p.reached},
                                        {"stopped_by", p.stopped_by}}));
              } else {
                fmt::print("nearest to singular at {:.2f} % of the path: {}\n", 100 * p.share, pose_text(m, p.X_MT, 2));
                fmt::print("there it {}{}\n", p.at.kind != 0 ? "" : "is ", quality::in_words(p.X_MT, p.at));
                if (p.crossed) fmt::print("the path passes through a singular pose\n");
                if (p.reached < 1) fmt::print("stopped at {:.1f} %: {}\n", 100 * p.reached, p.stopped_by);
              }
              return p.at.kind != 0 || p.crossed || p.reached < 1 ? kAnswerIsNo : kDone;
            }
            POLYPOD_ASSIGN(here, pose_joints(m, o->pose));
            if (here.joints.size() == 0) {
              // A singular pose may lie beyond the limits: look at it all the same.
              if (const auto q = quality::joints_at(m, X)) here.joints = *q;
            }
            if (here.joints.size() == 0) return cannot_take(context, here.reason);
            const quality::Singularity s = quality::singularity(m, X, here.joints, length);
            const auto near = quality::nearest(m, X, here.joints, length);
            const bool prescribed = quality::task_prescribes(m, X, here.joints, s);
            if (context.json) {
              Json document = singularity_json(m, X, s);
              document["within_limits"] = here.reachable;
              document["task_prescribes"] = prescribed;
              document["nearest"] = near ? Json{{"pose", pose_for_user(m, near->X_MT)},
                                                {"translation_mm", units::to_mm(near->translation)},
                                                {"rotation_deg", units::to_deg(near->rotation)}}
                                         : Json();
              print_json(singular.in(document));
            } else {
              fmt::print("the machine {}{}\n", s.kind != 0 ? "" : "is ", quality::in_words(X, s));
              if (!prescribed) {
                fmt::print("but {}\n", quality::kNotPrescribed);
              }
              if (!here.reachable) fmt::print("(beyond its limits: {})\n", here.reason);
              if (near && s.kind == 0) {
                fmt::print(
                    "a singular pose, found by a search from it and not proven the nearest: {} mm and {:.1f} deg away, "
                    "at {}\n",
                    figure(units::to_mm(near->translation), 1), units::to_deg(near->rotation),
                    pose_text(m, near->X_MT, 1));
              }
            }
            return s.kind != 0 || !prescribed ? kAnswerIsNo : kDone;
          }};
}

}  // namespace polypod::app
