// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The parameters of a running program: numbered, named and those that tell the state.
#include <cmath>

#include "engine.hpp"

namespace polypod::gcode {
namespace {

/// Which axis #<_abs_x> to #<_abs_c> tell of; empty of other names.
std::optional<std::size_t> axis_of_absolute(std::string_view name) {
  constexpr std::string_view kStart = "_abs_", kAxes = "xyzabc";
  if (name.size() != kStart.size() + 1 || !name.starts_with(kStart)) return {};
  const std::size_t at = kAxes.find(name.back());
  return at == std::string_view::npos ? std::nullopt : std::optional(at);
}

/// Whether a name of one letter tells the state: #<_x> to #<_w>.
bool is_axis(std::string_view name) {
  return name.size() == 2 && std::string_view("abcuvwxyz").find(name[1]) != std::string_view::npos;
}

}  // namespace

tl::expected<double, std::string> Engine::numbered(int index) const {
  switch (index) {
    case 5400:
      return loaded_.number;
    case 5410:
      return loaded_.diameter;
    case 5411:
      return loaded_.front_angle;
    case 5412:
      return loaded_.back_angle;
    case 5413:
      return loaded_.orientation;
    default:
      break;
  }
  if (index >= 5401 && index <= 5409) return loaded_.offset[static_cast<std::size_t>(index - 5401)];
  if (index >= 5420 && index <= 5428 && side_ != 0 && !in_message_) {
    return tl::unexpected(
        fmt::format("#{} is a position, which LinuxCNC does not tell while cutter radius compensation is on", index));
  }
  if (index >= 5420 && index <= 5425) {
    const auto k = static_cast<std::size_t>(index - 5420);
    if (!known_[k]) return tl::unexpected(fmt::format("#{}: the position of {} is not known here", index, "XYZABC"[k]));
    return current_[k] + 0.0;  // no negative zero
  }
  if (index >= 5426 && index <= 5428) return 0.0;
  if (!options_.machine_known && ((index >= 5161 && index <= 5189) || (index >= 5221 && index <= 5390))) {
    return tl::unexpected(fmt::format("#{} holds a position of the machine that the job does not tell", index));
  }
  if (!options_.machine_known && index == 5399) {
    return tl::unexpected(
        fmt::format("#{} holds what M66 has read at the machine: what follows from it cannot be judged", index));
  }
  if (!options_.machine_known && index <= kLastOwnParameter && !told(index)) {
    return tl::unexpected(
        fmt::format("#{} is read, but the program has not set it: the controller holds what was left in it", index));
  }
  return parameter(index);
}

tl::expected<std::optional<double>, std::string> Engine::named(const std::string& name) const {
  if (name.starts_with('_')) {
    if (name.size() == 2 && name[1] >= 'a' && name[1] <= 'c')
      return current_[3 + static_cast<std::size_t>(name[1] - 'a')] + 0.0;
    if (name.size() == 2 && name[1] >= 'x' && name[1] <= 'z') {
      const auto k = static_cast<std::size_t>(name[1] - 'x');
      if (!known_[k]) return tl::unexpected(fmt::format("#<{}>: the position of {} is not known here", name, "XYZ"[k]));
      return current_[k] + 0.0;
    }
    if (const auto k = axis_of_absolute(name)) {
      if (!options_.machine_known) {
        return tl::unexpected(fmt::format("#<{}> is a position of the machine that the job does not tell", name));
      }
      if (*k < 3 && !(known_[0] && known_[1] && known_[2]))
        return tl::unexpected(fmt::format("#<{}>: the position is not known here", name));
      return to_machine(current_)[*k] + length_offset_[*k];
    }
    if (!returned_is_told_ && (name == "_value" || name == "_value_returned")) {
      return tl::unexpected(fmt::format(
          "#<{}> is what the 'endsub' that was passed by gives, which reads what the program has not set", name));
    }
    if (options_.any_tool && (name == "_current_pocket" || name == "_selected_pocket")) {
      return tl::unexpected(fmt::format("#<{}> is known to the controller's tool table alone", name));
    }
    if (const auto value = predefined(std::string_view(name).substr(1))) return value;
    const auto global = globals_.find(name);
    return global != globals_.end() ? std::optional(global->second) : std::nullopt;
  }
  const auto& locals = frames_.back().locals;
  const auto local = locals.find(name);
  return local != locals.end() ? std::optional(local->second) : std::nullopt;
}

std::optional<double> Engine::predefined(std::string_view name) const {
  const auto flag = [](bool on) { return std::optional(on ? 1.0 : 0.0); };
  if (name == "vmajor") return 2.9;
  if (name == "vminor" || name == "task" || name == "remap_level") return 0;
  if (name == "line") return written_block_ != nullptr ? written_block_->line : 0;
  if (name == "motion_mode") return motion_ == kNurbsEnded ? -1 : motion_ < 0 ? 800 : motion_;
  if (name == "plane") return plane_ == Plane::xy ? 170 : plane_ == Plane::zx ? 180 : 190;
  if (name == "ccomp") return 400;
  if (name == "metric") return flag(!inches_);
  if (name == "imperial") return flag(inches_);
  if (name == "absolute") return flag(!incremental_);
  if (name == "incremental") return flag(incremental_);
  if (name == "inverse_time") return flag(inverse_);
  if (name == "units_per_minute") return flag(!inverse_);
  if (name == "units_per_rev" || name == "spindle_css_mode" || name == "lathe_diameter_mode") return 0;
  if (name == "coord_system") return active_ <= 6 ? 530 + 10 * active_ : 584 + active_;
  if (name == "tool_offset") return flag(tool_offset_);
  if (name == "retract_r_plane") return flag(!old_level_);
  if (name == "retract_old_z") return flag(old_level_);
  if (name == "spindle_rpm_mode" || name == "lathe_radius_mode") return 1;
  if (name == "ijk_absolute_mode") return flag(arc_absolute_);
  if (name == "spindle_on") return flag(turning_ != 0);
  if (name == "spindle_cw") return flag(turning_ > 0);
  if (name == "mist") return flag(mist_);
  if (name == "flood") return flag(flood_);
  if (name == "speed_override") return flag(speed_override_);
  if (name == "feed_override") return flag(feed_override_);
  if (name == "adaptive_feed") return flag(adaptive_feed_);
  if (name == "feed_hold") return flag(feed_hold_);
  if (name == "feed") return feed_;
  if (name == "rpm") return speed_;
  if (name == "u" || name == "v" || name == "w") return 0;
  if (name == "current_tool") return loaded_.number;
  if (name == "current_pocket") return told_pocket_;
  if (name == "selected_tool") return std::max(selected_number_, 0);
  if (name == "selected_pocket") return told_selected_;
  if (name == "value") return returned_value_;
  if (name == "value_returned") return flag(returned_);
  if (name == "call_level") return static_cast<double>(frames_.size() - 1);
  return std::nullopt;
}

Status Engine::assign(const Line& line, const Block& block) {
  block_ = &block;
  for (const Line::Assignment& a : line.assignments) {
    if (a.name.empty()) {
      if (a.index >= 5400 && a.index <= 5428) {
        return error(a.column, "GC162", fmt::format("#{} tells the state and cannot be set", a.index),
                     "use a parameter from 31 to 5000");
      }
      if (!options_.machine_known && a.index >= 5161 && a.index <= 5390) {
        return error(a.column, "GC125",
                     a.index == 5220
                         ? std::string("#5220 is the number of the work offset in force; G54 to G59.3 select one")
                         : fmt::format("#{} is a position of the machine that the job does not tell", a.index),
                     "use G10 L20 or G92, or G54 to G59 with the offsets of the job");
      }
      parameter(a.index) = a.value;
      told_[static_cast<std::size_t>(a.index)] = true;
      continue;
    }
    if (!a.name.starts_with('_')) {
      frame().locals[a.name] = a.value;
      continue;
    }
    if (is_axis(a.name) || axis_of_absolute(a.name) || predefined(std::string_view(a.name).substr(1))) {
      return error(a.column, "GC162", fmt::format("#<{}> tells the state and cannot be set", a.name),
                   "use another name");
    }
    globals_[a.name] = a.value;
  }
  return {};
}

}  // namespace polypod::gcode
