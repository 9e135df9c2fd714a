// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "covariance_files.hpp"
#include "polypod/calibration/certificate.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"

namespace polypod::app {
namespace {

using calibration::kCoverageFactor;

struct Options {
  std::string machine, covariance, pose, out;
  std::vector<std::string> sets;
  int points = 25;
};

double for_user(const std::string& coordinate, double value) {
  return coordinate.ends_with("_mm") ? units::to_mm(value) : units::to_deg(value);
}

/// U of every coordinate, and of the tip in the direction in which it is largest (last, m).
Eigen::VectorXd expanded_at(const machine::AnyMachine& m, const Pose& X_MT, const machine::JointVector& q,
                            const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd each = calibration::pose_deviation(m, X_MT, q, covariance);
  Eigen::VectorXd out(each.size() + 1);
  out << each, calibration::largest_deviation(calibration::tip_covariance(m, X_MT, q, covariance));
  return kCoverageFactor * out;
}

Json named(const std::vector<std::string>& names, const Eigen::VectorXd& U) {
  Json out = Json::object();
  for (std::size_t i = 0; i < names.size(); ++i) out[names[i]] = for_user(names[i], U[static_cast<Eigen::Index>(i)]);
  return out;
}

/// U over three levels of the box of these stands, the tool turned as in `R`.
std::string map_csv(const machine::AnyMachine& m, const std::vector<calibration::Stand>& stands, const Mat3& R,
                    const std::vector<std::string>& names, const Eigen::MatrixXd& covariance, int points,
                    std::size_t& reached) {
  Eigen::AlignedBox3d box;
  for (const calibration::Stand& stand : stands) box.extend(stand.X_MT.p);
  std::string out = "x_mm,y_mm,z_mm";
  for (const std::string& name : names) out += ",U_" + name;
  out += '\n';
  for (const double level : {0.25, 0.5, 0.75}) {
    for (int j = 0; j < points; ++j) {
      for (int i = 0; i < points; ++i) {
        const Vec3 share(double(i) / (points - 1), double(j) / (points - 1), level);
        const Vec3 p = box.min() + box.sizes().cwiseProduct(share);
        const kinematics::InverseResult inverse = kinematics::inverse(m, Pose{R, p});
        const kinematics::Solution* s = inverse.reachable();
        if (s == nullptr) continue;
        ++reached;
        const Eigen::VectorXd U = expanded_at(m, Pose{R, p}, s->joints, covariance);
        out += fmt::format("{:.4f},{:.4f},{:.4f}", units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z()));
        for (std::size_t k = 0; k < names.size(); ++k)
          out += fmt::format(",{:.3g}", for_user(names[k], U[static_cast<Eigen::Index>(k)]));
        out += '\n';
      }
    }
  }
  return out;
}

}  // namespace

Command uncertainty_command() {
  auto o = std::make_shared<Options>();
  return {"uncertainty", "U (k = 2) of the tool of a calibrated machine, from the covariance of its parameters",
          "polypod uncertainty measured.toml --covariance covariance.csv --pose 10,0,70",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--covariance", o->covariance, "What `polypod calibrate --covariance` wrote", true);
            a.option("--pose", o->pose, "x,y,z[,A,B[,C]] in mm and deg (default: over the workspace)");
            a.option("-o,--output", o->out, "U over three levels of the workspace, CSV");
            a.option("--points", o->points, {2, 200}, "Of the map, along x and y (default 25)");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            if (!o->pose.empty()) POLYPOD_TRY(refuse(context, {"-o", "--output"}, "a map is of the whole workspace"));
            if (o->out.empty()) POLYPOD_TRY(refuse(context, {"--points"}, "it serves -o"));
            POLYPOD_TRY(check_files({o->machine, o->covariance}, {o->out}, context.json));
            POLYPOD_ASSIGN(covariance, parameter_covariance(m, o->sets, o->covariance));
            if (const auto no = refused_as_singular(m, context, {"mean", "max"})) return *no;
            std::vector<std::string> names = calibration::pose_coordinates(m);
            names.emplace_back("tip_mm");
            const auto print = [&](const char* what, const Eigen::VectorXd& U) {
              fmt::print("{:<24}", what);
              for (std::size_t i = 0; i < names.size(); ++i)
                fmt::print(" {} {:.2g}", names[i], for_user(names[i], U[static_cast<Eigen::Index>(i)]));
              fmt::print("\n");
            };
            if (!o->pose.empty()) {
              POLYPOD_ASSIGN(X, pose_argument(m, o->pose));
              const kinematics::InverseResult inverse = kinematics::inverse(m, X);
              const kinematics::Solution* s = inverse.reachable();
              if (s == nullptr) return cannot_take(context, kinematics::reason_of(m, inverse));
              const Pose at = kinematics::settled(m, X, s->joints);
              const Eigen::VectorXd U = expanded_at(m, at, s->joints, covariance);
              if (context.json) {
                print_json({{"pose", whole_pose_for_user(at)}, {"k", kCoverageFactor}, {"U", named(names, U)}});
              } else {
                print("U (k = 2) at this pose", U);
              }
              return kDone;
            }
            const std::vector<calibration::Stand> stands =
                calibration::random_stands(m, calibration::kJudgedPoses, calibration::kJudgedSeed);
            if (stands.empty()) return cannot_take(context, "no pose was found within the limits", "any pose");
            Eigen::VectorXd mean = Eigen::VectorXd::Zero(std::ssize(names)), max = mean;
            for (const calibration::Stand& stand : stands) {
              const Eigen::VectorXd U = expanded_at(m, stand.X_MT, stand.q, covariance);
              mean += U / double(stands.size());
              max = max.cwiseMax(U);
            }
            std::size_t reached = 0;
            if (!o->out.empty()) {
              Vec3 middle = Vec3::Zero();
              for (const calibration::Stand& stand : stands) middle += stand.X_MT.p / double(stands.size());
              const bool upright = kinematics::inverse(m, Pose{Mat3::Identity(), middle}).reachable() != nullptr;
              const Mat3 R = upright ? Mat3(Mat3::Identity()) : stands.front().X_MT.R;
              POLYPOD_TRY(files::write_whole(o->out, map_csv(m, stands, R, names, covariance, o->points, reached)));
            }
            if (context.json) {
              print_json({{"poses", stands.size()},
                          {"k", kCoverageFactor},
                          {"mean", named(names, mean)},
                          {"max", named(names, max)},
                          {"map_points", reached},
                          {"file", o->out}});
              return kDone;
            }
            fmt::print("{} poses of the workspace; tip: in the direction in which it is least certain\n",
                       stands.size());
            print("U (k = 2), mean", mean);
            print("U (k = 2), largest", max);
            if (!o->out.empty()) fmt::print("wrote {} ({} points within reach)\n", o->out, reached);
            return kDone;
          }};
}

}  // namespace polypod::app
