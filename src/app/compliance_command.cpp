// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/compliance.hpp"
#include "survey_options.hpp"

namespace polypod::app {

Command compliance_command() {
  struct Options {
    std::string machine, pose, force;
    std::vector<std::string> sets;
  };
  auto o = std::make_shared<Options>();
  return {"compliance",
          "Static compliance (inverse of stiffness) of the tool centre point (TCP, tool tip) at a pose, each joint's "
          "contribution, deflection under a force",
          "polypod compliance lola50 --pose 0,-1300,0 --force 0,100,0",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--pose", o->pose, "x,y,z[,A,B[,C]] in mm and deg", true);
            a.option("--force", o->force, "Fx,Fy,Fz on the tool tip in M, N");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_ASSIGN(X, pose_argument(m, o->pose));
            Vec3 force = Vec3::Zero();
            if (!o->force.empty()) {
              POLYPOD_ASSIGN(f, numbers_of(o->force, "--force"));
              if (f.size() != 3) return fail("AP104", fmt::format("--force {}: not three numbers", o->force));
              force = Vec3(f[0], f[1], f[2]);
              constexpr double kMost = 1e6;  // N: beyond, no machine of this kind is elastic
              if (!(force.cwiseAbs().maxCoeff() <= kMost))
                return fail("AP104", fmt::format("--force {}: at most {:g} N along each axis", o->force, kMost));
            }
            POLYPOD_TRY(needs_compliance(m));
            if (const auto no = refused_as_singular(m, context, {"compliance_um_per_N", "displacement_um"})) return *no;
            const statics::Compliance c = statics::compliance_at(m, X);
            Json document = Json::object();
            if (c.joints.size() > 0) {
              const PoseJoints here{X, c.joints, true, {}};
              if (const auto no =
                      said_of_singular_pose(m, here, context, document, {"compliance_um_per_N", "displacement_um"}))
                return *no;
            }
            if (!c.reachable) return cannot_take(context, c.reason);
            const Mat3 C = c.linear() * units::kUmPerMetre;  // m/N to um/N
            const Vec3 moved = c.displacement(force) * units::kUmPerMetre;
            if (context.json) {
              Json shares = Json::array();
              for (std::size_t i = 0; i < c.by_joint.size(); ++i) {
                const Mat3 share = c.by_joint[i].topLeftCorner<3, 3>();
                shares.push_back({{"joint", c.joint[i]},
                                  {"compliance_um_per_N", matrix_json(share * units::kUmPerMetre)},
                                  {"displacement_um", vector_json(share * force * units::kUmPerMetre)}});
              }
              document.update({{"pose", pose_for_user(m, X)},
                               {"joints", joints_for_user(m, c.joints)},
                               {"compliance_um_per_N", matrix_json(C)},
                               {"compliance_6x6_SI", matrix_json(c.C)},
                               {"by_joint", shares},
                               {"force_N", vector_json(force)},
                               {"displacement_um", vector_json(moved)}});
              print_json(document);
              return kDone;
            }
            fmt::print("compliance of the tip in M, um/N\n");
            for (int i = 0; i < 3; ++i) fmt::print(" {:>9.4f} {:>9.4f} {:>9.4f}\n", C(i, 0), C(i, 1), C(i, 2));
            fmt::print("\ncontributions to C_xx, C_yy, C_zz\n");
            for (std::size_t i = 0; i < c.by_joint.size(); ++i) {
              fmt::print("  {:<9}", c.joint[i]);
              for (int k = 0; k < 3; ++k) {
                fmt::print(" {:>9.4f} ({:4.1f} %)", c.by_joint[i](k, k) * units::kUmPerMetre,
                           100 * c.by_joint[i](k, k) / c.C(k, k));
              }
              fmt::print("\n");
            }
            if (!o->force.empty()) {
              fmt::print("\ndisplacement under {:g}, {:g}, {:g} N: {:.1f}, {:.1f}, {:.1f} um\n", force.x(), force.y(),
                         force.z(), moved.x(), moved.y(), moved.z());
            }
            return kDone;
          }};
}

}  // namespace polypod::app
