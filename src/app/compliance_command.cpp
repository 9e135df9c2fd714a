// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "masses_options.hpp"
#include "messages.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/compliance.hpp"
#include "polypod/statics/rigid.hpp"
#include "polypod/statics/rounding.hpp"
#include "survey_options.hpp"

namespace polypod::app {
namespace {

/// "x,y,z" of a load in M, each at most `most`; 0 where nothing is given. Errors: AP104.
Result<Vec3> load_argument(const char* option, const std::string& text, double most, const char* unit) {
  if (text.empty()) return Vec3(Vec3::Zero());
  POLYPOD_ASSIGN(n, numbers_of(text, option));
  if (n.size() != 3) return fail("AP104", fmt::format("{} {}: not three numbers", option, text));
  const Vec3 out(n[0], n[1], n[2]);
  if (!(out.cwiseAbs().maxCoeff() <= most))
    return fail("AP104", fmt::format("{} {}: at most {:g} {} along each axis", option, text, most, unit));
  return out;
}

}  // namespace

Command compliance_command() {
  struct Options {
    std::string machine, pose, force, moment, dynamics;
    std::vector<std::string> sets;
  };
  auto o = std::make_shared<Options>();
  return {
      "compliance",
      "Static compliance (inverse of stiffness) of the tool centre point (TCP, tool tip) at a pose, each joint's "
      "contribution, deflection under a force",
      "polypod compliance lola50 --pose 0,-1300,0 --force 0,100,0",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--pose", o->pose, "x,y,z[,A,B[,C]] in mm and deg", true);
        a.option("--force", o->force, "Fx,Fy,Fz on the tool tip in M, N");
        a.option("--moment", o->moment, "Mx,My,Mz on the tool in M, Nm");
        a.option(
            "--dynamics", o->dynamics,
            "A file with the table `dynamics`: masses, whose weight deflects the tip as well (default: that of the "
            "machine file)");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_ASSIGN(X, pose_argument(m, o->pose));
        constexpr double kMost = 1e6;  // N, Nm: beyond, no machine of this kind is elastic
        POLYPOD_ASSIGN(force, load_argument("--force", o->force, kMost, "N"));
        POLYPOD_ASSIGN(moment, load_argument("--moment", o->moment, kMost, "Nm"));
        POLYPOD_TRY(check_files({o->machine, o->dynamics == o->machine ? "" : o->dynamics}, {}, context.json));
        POLYPOD_TRY(needs_compliance(m));
        MassesOptions file;
        file.dynamics = o->dynamics;
        POLYPOD_ASSIGN(masses, file.read(m, o->machine, context));
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
        Vec6 load;
        load << force, moment;
        const double noise = statics::rounding_of_tip(m, c);
        std::vector<std::string> notes;
        for (std::string note : {statics::rigid_parts_in_words(m), statics::held_directions_in_words(c.C, noise)})
          if (!note.empty()) notes.push_back(std::move(note));
        Vec6 by_weight = Vec6::Zero();
        if (masses.dynamics)
          by_weight = motion::weight_twist(m, *masses.dynamics, kinematics::settled(m, X, c.joints), c.joints);
        const auto moved_by = [&](const Mat6& part) -> Vec3 { return part.topRows<3>() * load * units::kUmPerMetre; };
        const auto turned_by = [&](const Mat6& part) -> Vec3 {
          return part.bottomRows<3>() * load * units::kMradPerRad;
        };
        if (context.json) {
          Json shares = Json::array();
          for (std::size_t i = 0; i < c.by_joint.size(); ++i) {
            const Mat3 share = c.by_joint[i].topLeftCorner<3, 3>();
            shares.push_back({{"joint", c.joint[i]},
                              {"compliance_um_per_N", matrix_json(share * units::kUmPerMetre)},
                              {"displacement_um", vector_json(moved_by(c.by_joint[i]))},
                              {"rotation_mrad", vector_json(turned_by(c.by_joint[i]))}});
          }
          document.update({{"pose", pose_for_user(m, X)},
                           {"joints", joints_for_user(m, c.joints)},
                           {"compliance_um_per_N", matrix_json(C)},
                           {"compliance_6x6_SI", matrix_json(c.C)},
                           {"by_joint", shares},
                           {"force_N", vector_json(force)},
                           {"moment_Nm", vector_json(moment)},
                           {"displacement_um", vector_json(moved_by(c.C))},
                           {"rotation_mrad", vector_json(turned_by(c.C))}});
          if (!notes.empty()) document["notes"] = notes;
          if (masses.dynamics) {
            document["weight"] = {{"displacement_um", vector_json(by_weight.head<3>() * units::kUmPerMetre)},
                                  {"rotation_mrad", vector_json(by_weight.tail<3>() * units::kMradPerRad)},
                                  {"gravity_m_per_s2", vector_json(masses.dynamics->gravity)}};
          }
          print_json(document);
          return kDone;
        }
        const auto shown = [](double x, int digits) { return unsigned_zero(fmt::format("{:.{}f}", x, digits)); };
        const auto vector = [&](const Vec3& v, int digits) {
          return fmt::format("{}, {}, {}", shown(v.x(), digits), shown(v.y(), digits), shown(v.z(), digits));
        };
        fmt::print("compliance of the tip in M, um/N\n");
        for (int i = 0; i < 3; ++i) {
          fmt::print(" {:>9} {:>9} {:>9}\n", shown(C(i, 0), 4), shown(C(i, 1), 4), shown(C(i, 2), 4));
        }
        if (c.C.diagonal().head<3>().maxCoeff() <= noise) {
          fmt::print("\nThe tool tip does not move at this pose, whatever the load: the tool only turns about it.\n");
        } else {
          fmt::print("\ncontributions to C_xx, C_yy, C_zz\n");
          for (std::size_t i = 0; i < c.by_joint.size(); ++i) {
            fmt::print("  {:<9}", c.joint[i]);
            for (int k = 0; k < 3; ++k) {
              const double part = c.by_joint[i](k, k), whole = c.C(k, k);
              fmt::print(" {:>9} ({:>4} %)", shown(part * units::kUmPerMetre, 4),
                         whole > noise ? shown(100 * part / whole, 1) : "-");
            }
            fmt::print("\n");
          }
        }
        if (!o->force.empty() || !o->moment.empty()) {
          std::vector<std::string> loads;
          if (!o->force.empty()) loads.push_back(fmt::format("{:g}, {:g}, {:g} N", force.x(), force.y(), force.z()));
          if (!o->moment.empty())
            loads.push_back(fmt::format("{:g}, {:g}, {:g} Nm", moment.x(), moment.y(), moment.z()));
          const std::string under = fmt::format("{}", fmt::join(loads, " and "));
          fmt::print("\ndisplacement under {}: {} um\n", under, vector(moved_by(c.C), 1));
          if (!o->moment.empty()) fmt::print("rotation under {}: {} mrad\n", under, vector(turned_by(c.C), 4));
        }
        for (const std::string& note : notes) fmt::print("\nnote: {}\n", note);
        if (masses.dynamics) {
          fmt::print("\n{}\ndisplacement by the weight of the machine, which is there without a load: {} um\n",
                     in_words(*masses.dynamics), vector(by_weight.head<3>() * units::kUmPerMetre, 1));
        }
        return kDone;
      }};
}

}  // namespace polypod::app
