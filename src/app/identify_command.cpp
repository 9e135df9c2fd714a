// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/identify.hpp"

namespace polypod::app {

Command identify_compliance_command() {
  struct Options {
    std::string machine;
    std::vector<std::string> sets, files;
  };
  auto o = std::make_shared<Options>();
  return {"identify compliance", "Joint compliances from measured displacements of the tip",
          "polypod identify compliance lola50 displacements.csv",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.positional("DATA", o->files, "CSV files: x_mm,y_mm,z_mm,force_N,dx_Fx_um,dy_Fx_um,...,dz_Fz_um");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            std::vector<statics::MeasuredPoint> points;
            for (const std::string& file : o->files) {
              POLYPOD_ASSIGN(more, statics::read_displacements(file));
              points.insert(points.end(), more.begin(), more.end());
            }
            POLYPOD_ASSIGN(r, statics::identify_compliance(m, points));
            static constexpr const char* kAxes = "xyz";
            Json outliers = Json::array();
            for (const statics::Outlier& x : r.outliers) {
              const statics::MeasuredPoint& p = points[x.point];
              outliers.push_back({{"file", p.place.file},
                                  {"line", p.place.line},
                                  {"displacement", fmt::format("d{}_F{}", kAxes[x.direction], kAxes[x.force_axis])},
                                  {"residual_um", units::to_um(x.residual)}});
            }
            if (context.json) {
              print_json({{"joint", r.joint},
                          {"compliance_rad_per_Nm", r.compliance},
                          {"standard_error", r.standard_error},
                          {"half_interval_95", r.half_interval},
                          {"residual_rms_um", units::to_um(r.residual_rms)},
                          {"equations", r.equations},
                          {"points", points.size()},
                          {"condition", r.condition},
                          {"correlation", r.correlation},
                          {"asymmetry_rms_um", units::to_um(r.asymmetry_rms)},
                          {"outliers", outliers}});
              return kDone;
            }
            fmt::print("{} points, {} equations, residual rms {:.1f} um, condition {:.2f}\n\n", points.size(),
                       r.equations, units::to_um(r.residual_rms), r.condition);
            fmt::print("           1e-7 rad/Nm   95 % interval\n");
            for (std::size_t i = 0; i < r.compliance.size(); ++i) {
              fmt::print("{:<10} {:>11.2f}   +- {:.2f}\n", r.joint[i], r.compliance[i] * 1e7, r.half_interval[i] * 1e7);
            }
            fmt::print("\nmeasured cross displacements differ from symmetry by {:.1f} um rms\n",
                       units::to_um(r.asymmetry_rms));
            for (const Json& x : outliers) {
              fmt::print("outlier, kept in the fit: {}:{} {} is off by {:.0f} um\n", x["file"].get<std::string>(),
                         x["line"].get<int>(), x["displacement"].get<std::string>(), x["residual_um"].get<double>());
            }
            return kDone;
          }};
}

}  // namespace polypod::app
