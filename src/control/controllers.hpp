// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the families share on their way to settings.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "polypod/control/settings.hpp"
#include "polypod/core/units.hpp"

namespace polypod::control {

Result<Settings> hexapod_settings(const machine::StrutHexapod& m);
Result<Settings> arm_settings(const machine::SerialArm& arm, const SettingsOptions& options);
Result<Settings> delta_settings(const machine::RotaryDelta& m, Controller controller, const SettingsOptions& options);
Result<Settings> delta_settings(const machine::LinearDelta& m, Controller controller, const SettingsOptions& options);

/// One of many misses.
class MissCount {
 public:
  void add(double miss) {
    square_ += miss * miss;
    all_.push_back(miss);
  }
  [[nodiscard]] Misses misses() const {
    if (all_.empty()) return {};
    std::vector<double> sorted = all_;
    std::sort(sorted.begin(), sorted.end());
    return {std::sqrt(square_ / static_cast<double>(sorted.size())), sorted.back(), sorted[sorted.size() / 2]};
  }

 private:
  double square_ = 0;
  std::vector<double> all_;
};

inline void put(Settings& s, std::string section, std::string key, double value) {
  s.settings.push_back({std::move(section), std::move(key), value, ""});
}
inline void put(Settings& s, std::string section, std::string key, std::string text) {
  s.settings.push_back({std::move(section), std::move(key), 0, std::move(text)});
}

/// A joint's home and limits in LinuxCNC, mm or deg. `offset` is the joint where the drive reads 0, `home` where it
/// goes after homing.
inline void put_joint(Settings& s, int joint, bool turns, double offset, double home, double low, double high) {
  const std::string section = fmt::format("JOINT_{}", joint);
  put(s, section, "TYPE", turns ? "ANGULAR" : "LINEAR");
  put(s, section, "HOME_OFFSET", offset);
  put(s, section, "HOME", std::clamp(home, low, high));
  put(s, section, "MIN_LIMIT", low);
  put(s, section, "MAX_LIMIT", high);
}

inline constexpr const char* kTargetsHint =
    "polypod calibrate --targets corrects points for a controller that knows only the nominal machine";

}  // namespace polypod::control
