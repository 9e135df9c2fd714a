// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "commands.hpp"
#include "polypod/core/units.hpp"
#include "polypod/cutting/force.hpp"
#include "polypod/cutting/plausibility.hpp"
#include "polypod/cutting/rounded.hpp"

namespace polypod::app {
namespace {

constexpr double kLongestEdges = 50;  // diameters: no cutter without a file has longer ones
constexpr config::Range kCut_mm{0, 1000, true}, kFeed_mm{0, 100, true};

struct Options {
  double diameter = 0, helix = 0, corner_radius = 0, ae = 0, ap = 0, feed_per_tooth = 0, exponent = 1;
  int teeth = 0;
  std::string coefficients, direction, cutter, material;
};

Result<cutting::Cutter> cutter_of(const Options& o) {
  if (!o.cutter.empty()) return cutting::read_cutter(o.cutter);
  cutting::Cutter cutter;
  if (o.diameter == 0 || o.teeth == 0) {
    return fail("AP110", "no cutter", {}, "give --diameter and --teeth, or --cutter FILE");
  }
  cutter.diameter = units::from_mm(o.diameter);
  cutter.teeth = o.teeth;
  cutter.helix = units::from_deg(o.helix);
  cutter.length = units::from_mm(kLongestEdges * o.diameter);
  cutter.corner_radius = units::from_mm(o.corner_radius);
  if (cutter.corner_radius > cutter.radius() * (1 + 1e-12)) {
    return fail("AP113", fmt::format("--corner-radius {:g}: at most half of the diameter, {:g} mm, which is a ball",
                                     o.corner_radius, 0.5 * o.diameter));
  }
  cutter.corner_radius = std::min(cutter.corner_radius, cutter.radius());
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
  return {
      "force", "Mean and peak cutting force of a straight cut, and the angle of engagement",
      "polypod force --diameter 8 --teeth 4 --helix 30 --coefficients 1027.78,182.03,64.5,13.65,27.95,2.21 "
      "--ae 4 --ap 2 --feed-per-tooth 0.05 --direction down",
      [o](Arguments& a) {
        a.option("--diameter", o->diameter, cutting::kCutterSize_mm, "Cutter diameter, mm");
        a.option("--teeth", o->teeth, {1, 100}, "Number of teeth");
        a.option("--helix", o->helix, {0, 90, false, true}, "Helix angle, deg");
        a.option("--corner-radius", o->corner_radius, {0, 500},
                 "Corner radius, mm: of a bull nose, or half of the diameter for a ball (default 0, flat)");
        a.option("--coefficients", o->coefficients, "Ktc,Krc,Kac (N/mm^2), Kte,Kre,Kae (N/mm)");
        a.option("--cutter", o->cutter, "Cutter file instead of --diameter, --teeth, --helix");
        a.option("--material", o->material, "Material file instead of --coefficients");
        a.option("--ae", o->ae, kCut_mm, "Radial depth of cut, mm (a slot needs none)");
        a.option("--ap", o->ap, kCut_mm, "Axial depth of cut, mm", true);
        a.option("--feed-per-tooth", o->feed_per_tooth, kFeed_mm, "Feed per tooth, mm", true);
        a.option("--direction", o->direction, "up, down or slot", true);
      },
      [o](const Context& context) -> Result<int> {
        if (!o->cutter.empty()) {
          POLYPOD_TRY(
              refuse(context, {"--diameter", "--teeth", "--helix", "--corner-radius"}, "the cutter's file says it"));
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
          return fail("AP113", fmt::format("--ae {:g}: must be greater than 0 and at most the diameter, {:g} mm", ae,
                                           diameter_mm));
        }
        if (units::from_mm(o->ap) > cutter.length * (1 + 1e-12)) {
          return fail(
              "AP113",
              fmt::format("--ap {:g}: the flute length of the cutter is {:g} mm", o->ap, units::to_mm(cutter.length)),
              {},
              o->cutter.empty() ? fmt::format("without --cutter they count as {:g} diameters", kLongestEdges)
                                : "length_mm of the cutter's file says it");
        }
        cutting::Engagement e = cutting::straight_engagement(cutter, side, units::from_mm(ae), units::from_mm(o->ap));
        const double feed = units::from_mm(o->feed_per_tooth);
        Vec3 mean;
        cutting::ForceHistory history;
        if (cutter.corner_radius > 0) {
          const auto slices = cutting::straight_slices(cutter, side, units::from_mm(ae), units::from_mm(o->ap));
          const cutting::EdgeSlice& widest = slices.back();  // where the material ends above
          if (!(widest.exit > widest.entry)) {
            return fail("AP113",
                        fmt::format("--ae {:g}: below the depth of {:g} mm the cutter is only {:.4g} mm wide, and does "
                                    "not meet a wall that stands {:g} mm inside of its full diameter",
                                    ae, o->ap, units::to_mm(2 * cutting::radius_at(cutter, units::from_mm(o->ap))), ae),
                        {}, "give a larger --ae, which counts from the side of the cutter at its full diameter");
          }
          e.entry = widest.entry;
          e.exit = widest.exit;
          mean = cutting::mean_force(cutter, material, slices, feed);
          history = cutting::force_history(cutter, material, slices, feed);
        } else {
          mean = cutting::mean_force(cutter, material, e, feed);
          history = cutting::force_history(cutter, material, {e}, feed);
        }
        const std::vector<std::string> notes = cutting::plausibility(cutter, material, feed, 0);
        if (context.json) {
          print_json({{"mean_N", vector_json(mean)},
                      {"peak_N", vector_json(history.peak)},
                      {"mean_by_rotation_N", vector_json(history.mean)},
                      {"engagement_deg", {units::to_deg(e.entry), units::to_deg(e.exit)}},
                      {"notes", notes}});
          return kDone;
        }
        fmt::print("engagement {:.2f} .. {:.2f} deg (from the left of the feed over its front)\n",
                   units::to_deg(e.entry), units::to_deg(e.exit));
        fmt::print("             along feed      normal        axis\n");
        fmt::print("mean, N     {:>11.2f} {:>11.2f} {:>11.2f}\n", mean.x(), mean.y(), mean.z());
        fmt::print("peak, N     {:>11.2f} {:>11.2f} {:>11.2f}\n", history.peak.x(), history.peak.y(), history.peak.z());
        for (const std::string& note : notes) fmt::print("note: {}\n", note);
        return kDone;
      }};
}

}  // namespace polypod::app
