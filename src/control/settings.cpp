// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/control/settings.hpp"

#include <algorithm>
#include <type_traits>

#include "controllers.hpp"
#include "polypod/core/text.hpp"

namespace polypod::control {
namespace {

/// A number as both programs read it, without an exponent where it is of a usual size; -0 and rounding's dust are 0.
std::string number_text(double value, bool fitted) {
  if (std::abs(value) < 1e-12) return "0";
  if (!fitted) return fmt::format("{:.12g}", value);
  const std::string text = fmt::format("{:.6f}", value);
  return text == "-0.000000" ? "0.000000" : text;
}

/// Remarks of at most 100 characters a line; names from files are in them.
std::string remark(const std::string& raw) {
  const std::string text = one_line(raw);
  constexpr std::size_t kWidth = 98;
  std::string out, line;
  std::size_t from = 0;
  while (from < text.size()) {
    const std::size_t to = std::min(text.find(' ', from), text.size());
    const std::string word = text.substr(from, to - from);
    if (!line.empty() && line.size() + 1 + word.size() > kWidth) {
      out += "# " + line + "\n";
      line.clear();
    }
    line += (line.empty() ? "" : " ") + word;
    from = to + 1;
  }
  return line.empty() ? out : out + "# " + line + "\n";
}

std::string misses_text(const Misses& misses) {
  return fmt::format("median {:.4f} mm, rms {:.4f} mm, max {:.4f} mm", units::to_mm(misses.median),
                     units::to_mm(misses.rms), units::to_mm(misses.max));
}

std::string sections(const Settings& s, const char* line) {
  std::string out, section;
  for (const Setting& setting : s.settings) {
    if (setting.section == "HAL") continue;
    if (setting.section != section) {
      section = setting.section;
      out += fmt::format("\n[{}]\n", section);
    }
    out += fmt::format(fmt::runtime(line), setting.key,
                       setting.text.empty() ? number_text(setting.value, s.fitted) : setting.text);
  }
  return out;
}

}  // namespace

Result<Settings> settings_for(const AnyMachine& machine, Controller controller, const SettingsOptions& options) {
  const auto none = [&](const char* program) {
    return fail("CN101", fmt::format("{} has no kinematics for {}", program, machine::family_of(machine)), {},
                kTargetsHint);
  };
  return std::visit(
      [&](const auto& m) -> Result<Settings> {
        using M = std::decay_t<decltype(m)>;
        constexpr bool kDelta = std::is_base_of_v<machine::Delta, M>;
        if constexpr (kDelta) {
          return delta_settings(m, controller, options);
        } else if (controller == Controller::klipper) {
          return none("Klipper");
        } else if constexpr (std::same_as<M, machine::StrutHexapod>) {
          return hexapod_settings(m);
        } else if constexpr (std::same_as<M, machine::SerialArm>) {
          return arm_settings(m, options);
        } else {
          return none("LinuxCNC");
        }
      },
      machine);
}

std::string text_of(const Settings& s) {
  const bool klipper = s.controller == Controller::klipper;
  std::string out = remark(fmt::format("{} for {}: {}", s.machine, klipper ? "Klipper" : "LinuxCNC", s.module));
  if (s.fitted && !s.exact) {
    out += remark(fmt::format("The tool misses the asked points (at {} of the workspace) by", s.points));
    out += remark(fmt::format("  mean values:    {}", misses_text(s.before)));
    out += remark(fmt::format("  these settings: {}", misses_text(s.after)));
    out += remark("If that is too much: polypod calibrate --targets.");
  } else if (s.exact) {
    out += remark("These settings represent the machine exactly, up to rounding.");
  } else {
    out += remark(fmt::format("The tool misses the asked points (at {} of the workspace) by {}.", s.points,
                              misses_text(s.after)));
  }
  for (const std::string& note : s.notes) out += "#\n" + remark(note);
  const Vec3 p = s.work_offset * units::kMmPerMetre;
  const bool shifted = p.cwiseAbs().maxCoeff() > 5e-7, turned = std::abs(s.work_rotation) > 1e-10;
  const auto number = [&](double value) { return number_text(value, s.fitted); };
  if (klipper) {
    out += sections(s, "{}: {}\n");
    if (shifted) {
      out += "\n# Work offset, in the macro that starts a program:\n";
      out += fmt::format("# SET_GCODE_OFFSET X={} Y={}\n", number(p.x()), number(p.y()));
    }
    return out;
  }
  out += "\n# HAL file, after the line that loads the kinematics\n";
  for (const Setting& setting : s.settings) {
    if (setting.section == "HAL") out += fmt::format("setp {} {}\n", setting.key, number(setting.value));
  }
  out += "\n# INI file\n" + sections(s, "{} = {}\n").substr(1);
  if (shifted || turned) {
    out += "\n# Work offset, once by MDI\n# G10 L2 P1";
    if (shifted) out += fmt::format(" X{} Y{} Z{}", number(p.x()), number(p.y()), number(p.z()));
    if (turned) {
      const std::string angle = number(units::to_deg(s.work_rotation));
      if (s.module == "genserkins") out += " C" + angle;
      out += " R" + angle;
    }
    out += "\n";
  }
  return out;
}

}  // namespace polypod::control
