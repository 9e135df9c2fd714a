// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>

#include "calibration_options.hpp"
#include "commands.hpp"
#include "machine_file.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"

namespace polypod::app {
namespace {

struct Options {
  std::string machine, kind = "points", out, truth, frame, target;
  std::vector<std::string> sets, anchors;
  int count = 70, seed = 1;
  double perturb_mm = 0.1, perturb_deg = 0.05, perturb_compliance = 10;
  double noise_um = 20, noise_deg = 0.002, outliers = 0, outlier_mm = 1, force = 250;
};

}  // namespace

Command simulate_measurement_command() {
  auto o = std::make_shared<Options>();
  return {
      "simulate measurement", "Measurement files from a machine that is a little off, with noise and outliers",
      "polypod simulate measurement hexapod-strut --kind points --count 70 --truth truth.toml -o data.csv",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("-o,--output", o->out, "The measurements, CSV", true);
        a.option("--truth", o->truth, "The machine that was measured, as a machine file");
        a.option("--kind", o->kind, "points, axes, poses, distances, gauge, contacts or compliance");
        a.option("--count", o->count, {1, 100000}, "Rows (default 70)");
        a.option("--seed", o->seed, {0, kAnyCount.max}, "Of all random numbers (default 1)");
        a.option("--perturb-mm", o->perturb_mm, {0, 1000}, "Standard deviation of the errors of lengths (default 0.1)");
        a.option("--perturb-deg", o->perturb_deg, {0, 180}, "... of angles and directions (default 0.05)");
        a.option("--perturb-compliance", o->perturb_compliance, {0, 1000},
                 "... of compliances, percent (--kind compliance; default 10)");
        a.option("--noise-um", o->noise_um, {0, 1e6}, "Of the instrument, each coordinate (default 20)");
        a.option("--noise-deg", o->noise_deg, {0, 180}, "Of the instrument, each angle (default 0.002)");
        a.option("--outliers", o->outliers, {0, 100}, "Percent of the rows that are off (default 0)");
        a.option("--outlier-mm", o->outlier_mm, {0, 1e6}, "By this much (default 1)");
        a.option("--anchor", o->anchors,
                 "x,y,z in mm: a ball-bar's fixed ball, or a point of a level plane (repeatable, in turn)");
        a.option("--frame", o->frame, kFrameHelp);
        a.option("--target", o->target, kTargetHelp);
        a.option("--force", o->force, kForce_N, "N, for --kind compliance (default 250)");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_TRY(check_files({o->machine}, {o->out, o->truth}, context.json));
        if (const auto no = refused_as_singular(m, context, {"rows"})) return *no;
        static constexpr std::array<const char*, 7> kKinds = {"points", "axes",     "poses",     "distances",
                                                              "gauge",  "contacts", "compliance"};
        const auto kind = std::find(kKinds.begin(), kKinds.end(), o->kind);
        if (kind == kKinds.end()) {
          return fail("AP181", fmt::format("--kind {}: not one of them", o->kind), {},
                      "points, axes, poses, distances, gauge, contacts or compliance");
        }
        if (o->kind == "compliance") {
          POLYPOD_TRY(refuse(context, {"--perturb-mm", "--perturb-deg", "--noise-deg", "--frame", "--target"},
                             "it serves every --kind but compliance"));
        } else {
          POLYPOD_TRY(refuse(context, {"--perturb-compliance", "--force"}, "it serves --kind compliance"));
        }
        if (o->kind != "axes" && o->kind != "poses") {
          POLYPOD_TRY(refuse(context, {"--noise-deg"}, "it serves --kind axes and poses"));
        }
        if (o->kind == "points" || o->kind == "axes" || o->kind == "poses" || o->kind == "compliance") {
          POLYPOD_TRY(refuse(context, {"--anchor"}, "it serves --kind distances, gauge and contacts"));
        }
        if (o->outliers == 0) POLYPOD_TRY(refuse(context, {"--outlier-mm"}, "it serves --outliers; give a percentage"));
        calibration::SimulationOptions how;
        how.count = static_cast<std::size_t>(o->count);
        how.seed = static_cast<std::uint64_t>(o->seed);
        how.noise_position = units::from_um(o->noise_um);
        how.noise_angle = units::from_deg(o->noise_deg);
        how.outliers = o->outliers / 100;
        how.outlier_size = units::from_mm(o->outlier_mm);
        POLYPOD_ASSIGN(anchors, points_of(o->anchors, "--anchor"));
        POLYPOD_ASSIGN(X_SM, frame_argument(o->frame, "--frame"));
        POLYPOD_ASSIGN(X_TR, frame_argument(o->target, "--target"));
        how.anchors = anchors;
        how.X_SM = X_SM;
        how.X_TR = X_TR;
        const bool compliance = o->kind == "compliance";
        std::string csv;
        std::size_t rows = 0;
        const auto off = [&]() -> Result<machine::AnyMachine> {
          if (compliance) return calibration::perturbed_compliance(m, o->perturb_compliance / 100, how.seed);
          if (o->perturb_mm == 0 && o->perturb_deg == 0) return m;
          return calibration::perturbed(m, units::from_mm(o->perturb_mm), units::from_deg(o->perturb_deg), how.seed);
        };
        POLYPOD_ASSIGN(truth, off());
        if (compliance) {
          POLYPOD_ASSIGN(points, calibration::simulate_displacements(truth, o->force, how));
          csv = calibration::displacements_csv(points);
          rows = points.size();
        } else {
          how.kind = static_cast<calibration::Kind>(kind - kKinds.begin());
          POLYPOD_ASSIGN(measured, calibration::simulate(m, truth, how));
          csv = calibration::measurements_csv(m, measured);
          rows = measured.size();
        }
        machine::note(truth, "simulation",
                      fmt::format("invented: {} with random errors, seed {}", machine::name_of(m), o->seed));
        files::Outputs together;
        POLYPOD_TRY(together.add(o->out, csv));
        if (!o->truth.empty()) {
          const std::string text = machine_file(truth, o->machine);
          POLYPOD_TRY(machine::from_text(text, o->truth));  // what could not be read again is not written
          POLYPOD_TRY(together.add(o->truth, text));
        }
        POLYPOD_TRY(together.commit());
        if (context.json) {
          print_json({{"rows", rows}, {"kind", o->kind}, {"file", o->out}, {"truth", o->truth}});
        } else {
          fmt::print("{} rows of {} of {}, seed {}\n", rows, o->kind, one_line(machine::name_of(m)), o->seed);
          for (const std::string* path : {&o->out, &o->truth})
            if (!path->empty()) fmt::print("wrote {}\n", *path);
        }
        return kDone;
      }};
}

}  // namespace polypod::app
