// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "commands.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/force.hpp"

namespace polypod::app {
namespace {

struct Options {
  double diameter = 0, helix = 0, ae = 0, ap = 0, feed_per_tooth = 0, exponent = 1;
  int teeth = 0;
  std::string coefficients, direction, cutter, material;
};

Result<cutting::Cutter> cutter_of(const Options& o) {
  if (!o.cutter.empty()) return cutting::read_cutter(o.cutter);
  cutting::Cutter cutter;
  constexpr config::Range range = cutting::kCutterSize_mm;
  if (!(o.diameter >= range.min && o.diameter <= range.max)) {
    return fail("AP110", fmt::format("--diameter must be {:g} to {:g} mm", range.min, range.max), {},
                "give --diameter or --cutter FILE");
  }
  if (o.teeth < 1 || o.teeth > 100)
    return fail("AP110", "--teeth must be 1 to 100", {}, "give --teeth or --cutter FILE");
  if (!(o.helix >= 0 && o.helix < 90)) return fail("AP110", "--helix must be at least 0 and below 90 deg");
  cutter.diameter = units::from_mm(o.diameter);
  cutter.teeth = o.teeth;
  cutter.helix = units::from_deg(o.helix);
  cutter.length = units::from_mm(std::max(o.ap, 4 * o.diameter));
  return cutter;
}

Result<cutting::Material> material_of(const Options& o) {
  if (!o.material.empty()) return cutting::read_material(o.material);
  if (o.coefficients.empty()) {
    return fail("AP111", "no cutting coefficients", {},
                "give --coefficients Ktc,Krc,Kac,Kte,Kre,Kae or --material FILE");
  }
  POLYPOD_ASSIGN(k, numbers_of(o.coefficients, "--coefficients"));
  if (k.size() != 6) {
    return fail("AP111", fmt::format("--coefficients {}: {} numbers, but six are needed", o.coefficients, k.size()), {},
                "Ktc,Krc,Kac in N/mm^2 and Kte,Kre,Kae in N/mm");
  }
  cutting::Material m;
  m.ktc = units::from_N_per_mm2(k[0]);
  m.krc = units::from_N_per_mm2(k[1]);
  m.kac = units::from_N_per_mm2(k[2]);
  m.kte = units::from_N_per_mm(k[3]);
  m.kre = units::from_N_per_mm(k[4]);
  m.kae = units::from_N_per_mm(k[5]);
  return m;
}

}  // namespace

Command force_command() {
  auto o = std::make_shared<Options>();
  return {"force", "Mean and peak cutting force of a straight cut, and the angle of engagement",
          "polypod force --diameter 8 --teeth 4 --helix 30 --coefficients 1027.78,182.03,64.5,13.65,27.95,2.21 "
          "--ae 4 --ap 2 --feed-per-tooth 0.05 --direction down",
          [o](Arguments& a) {
            a.option("--diameter", o->diameter, "Cutter diameter, mm");
            a.option("--teeth", o->teeth, "Number of teeth");
            a.option("--helix", o->helix, "Helix angle, deg");
            a.option("--coefficients", o->coefficients, "Ktc,Krc,Kac (N/mm^2), Kte,Kre,Kae (N/mm)");
            a.option("--cutter", o->cutter, "Cutter file instead of --diameter, --teeth, --helix");
            a.option("--material", o->material, "Material file instead of --coefficients");
            a.option("--ae", o->ae, "Radial depth of cut, mm (a slot needs none)");
            a.option("--ap", o->ap, "Axial depth of cut, mm", true);
            a.option("--feed-per-tooth", o->feed_per_tooth, "Feed per tooth, mm", true);
            a.option("--direction", o->direction, "up, down or slot", true);
          },
          [o](const Context& context) -> Result<int> {
            if (!o->cutter.empty()) {
              POLYPOD_TRY(refuse(context, {"--diameter", "--teeth", "--helix"}, "the cutter's file says it"));
            }
            if (!o->material.empty()) POLYPOD_TRY(refuse(context, {"--coefficients"}, "the material's file says them"));
            POLYPOD_ASSIGN(cutter, cutter_of(*o));
            POLYPOD_ASSIGN(material, material_of(*o));
            cutting::CutSide side;
            if (o->direction == "up") {
              side = cutting::CutSide::up;
            } else if (o->direction == "down") {
              side = cutting::CutSide::down;
            } else if (o->direction == "slot") {
              side = cutting::CutSide::slot;
            } else {
              return fail("AP112", fmt::format("--direction {}: not up, down or slot", o->direction));
            }
            const double diameter_mm = units::to_mm(cutter.diameter);
            if (side == cutting::CutSide::slot && std::abs(o->ae - diameter_mm) > 1e-9 * diameter_mm) {
              POLYPOD_TRY(refuse(context, {"--ae"}, "a slot is as wide as the cutter; --ae serves up and down"));
            }
            const double ae = side == cutting::CutSide::slot && o->ae == 0 ? diameter_mm : o->ae;
            if (!(ae > 0 && ae <= diameter_mm * (1 + 1e-12))) {
              return fail("AP113",
                          fmt::format("--ae {:g} must be above 0 and at most the diameter, {:g} mm", ae, diameter_mm));
            }
            if (!(o->ap > 0)) return fail("AP113", fmt::format("--ap {:g} must be above 0 mm", o->ap));
            if (!(o->feed_per_tooth > 0)) {
              return fail("AP113", fmt::format("--feed-per-tooth {:g} must be above 0 mm", o->feed_per_tooth));
            }
            const cutting::Engagement e =
                cutting::straight_engagement(cutter, side, units::from_mm(ae), units::from_mm(o->ap));
            const double feed = units::from_mm(o->feed_per_tooth);
            const Vec3 mean = cutting::mean_force(cutter, material, e, feed);
            const cutting::ForceHistory history = cutting::force_history(cutter, material, {e}, feed);
            if (context.json) {
              print_json({{"mean_N", vector_json(mean)},
                          {"peak_N", vector_json(history.peak)},
                          {"mean_by_rotation_N", vector_json(history.mean)},
                          {"engagement_deg", {units::to_deg(e.entry), units::to_deg(e.exit)}}});
              return kDone;
            }
            fmt::print("engagement {:.2f} .. {:.2f} deg (from the left of the feed over its front)\n",
                       units::to_deg(e.entry), units::to_deg(e.exit));
            fmt::print("             along feed      normal        axis\n");
            fmt::print("mean, N     {:>11.2f} {:>11.2f} {:>11.2f}\n", mean.x(), mean.y(), mean.z());
            fmt::print("peak, N     {:>11.2f} {:>11.2f} {:>11.2f}\n", history.peak.x(), history.peak.y(),
                       history.peak.z());
            return kDone;
          }};
}

}  // namespace polypod::app
