// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <memory>

#include "commands.hpp"
#include "polypod/control/settings.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"

namespace polypod::app {
namespace {

struct Options {
  std::string machine, controller, out, weight = "even";
  std::vector<std::string> sets;
  int points = 400, seed = 1;
};

Json json_of(const control::Settings& s) {
  Json settings = Json::array();
  for (const control::Setting& setting : s.settings) {
    settings.push_back({{"section", setting.section},
                        {"key", setting.key},
                        {"value", setting.text.empty() ? Json(setting.value) : Json(setting.text)}});
  }
  const auto mm = [](bool known, double si) { return known ? Json(units::to_mm(si)) : Json(); };
  return {{"module", s.module},
          {"exact", s.exact},
          {"settings", settings},
          {"points", s.points},
          {"rms_before_mm", mm(s.fitted, s.before.rms)},
          {"max_before_mm", mm(s.fitted, s.before.max)},
          {"median_before_mm", mm(s.fitted, s.before.median)},
          {"rms_after_mm", units::to_mm(s.after.rms)},
          {"max_after_mm", units::to_mm(s.after.max)},
          {"median_after_mm", units::to_mm(s.after.median)},
          {"angle_after_deg", units::to_deg(s.angle_after)},
          {"work_offset_mm", vector_json(s.work_offset * units::kMmPerMetre)},
          {"work_rotation_deg", units::to_deg(s.work_rotation)},
          {"notes", s.notes}};
}

}  // namespace

Command controller_command() {
  auto o = std::make_shared<Options>();
  return {"controller", "The settings with which LinuxCNC's or Klipper's own kinematics represent a machine",
          "polypod controller measured.toml --for linuxcnc -o settings.txt",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            a.option("--for", o->controller, "linuxcnc or klipper", true);
            a.option("--points", o->points, {30, 100000}, "Poses to fit to, and as many to judge by (default 400)");
            a.option("--seed", o->seed, {0, kAnyCount.max}, "Of the poses (default 1)");
            a.option("--weight", o->weight,
                     "Fits of deltas: even (default) or condition: poses count the less, the nearer they are to a "
                     "singular one; better in the middle, worse at the boundary");
            a.option("-o,--output", o->out, "The settings, text to paste");
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_TRY(check_files({o->machine}, {o->out}, context.json));
            if (const auto no = refused_as_singular(m, context, {"settings"})) return *no;
            const bool klipper = o->controller == "klipper";
            if (!klipper && o->controller != "linuxcnc") {
              return fail("AP185", fmt::format("--for {}: not linuxcnc or klipper", o->controller));
            }
            control::SettingsOptions options;
            options.points = static_cast<std::size_t>(o->points);
            options.seed = static_cast<std::uint64_t>(o->seed);
            if (o->weight != "even" && o->weight != "condition") {
              return fail("AP185", fmt::format("--weight {}: not even or condition", o->weight));
            }
            options.weight_by_condition = o->weight == "condition";
            POLYPOD_ASSIGN(
                found, control::settings_for(m, klipper ? control::Controller::klipper : control::Controller::linuxcnc,
                                             options));
            const std::string text = control::text_of(found);
            if (!o->out.empty()) POLYPOD_TRY(files::write_whole(o->out, text));
            if (context.json) {
              print_json(json_of(found));
            } else if (o->out.empty()) {
              fmt::print("{}", text);
            } else {
              fmt::print("{}{}: wrote {}\n", found.module,
                         found.exact ? ", exact"
                                     : fmt::format(", misses median {:.4f} mm, rms {:.4f} mm, max {:.4f} mm",
                                                   units::to_mm(found.after.median), units::to_mm(found.after.rms),
                                                   units::to_mm(found.after.max)),
                         o->out);
            }
            return kDone;
          }};
}

}  // namespace polypod::app
