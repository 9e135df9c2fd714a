// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "arm_table.hpp"

#include <fmt/format.h>

#include <cmath>
#include <map>

#include "polypod/core/units.hpp"

namespace polypod::machine {
namespace {

/// A number as a person would write it, where it is that but for rounding (1e-13 mm or deg, or a few of the last
/// digits).
double tidy(double value) {
  constexpr double kSteps = 1e9, kNoise = 1e-13, kDigits = 1e-15;
  const double near = std::round(value * kSteps) / kSteps + 0.0;  // no negative zero
  return std::abs(near - value) <= kNoise + kDigits * std::abs(value) ? near : value;
}

/// Builds tables as the reader of files does.
class Writer {
 public:
  explicit Writer(Place place) : place_(std::move(place)) {}

  template <class T>
  [[nodiscard]] config::Value value(T data) const {
    config::Value out;
    out.data = std::move(data);
    out.place = place_;
    return out;
  }
  [[nodiscard]] config::Value mm(double m) const { return value(tidy(units::to_mm(m))); }
  [[nodiscard]] config::Value deg(double rad) const { return value(tidy(units::to_deg(rad))); }
  [[nodiscard]] config::Table table(std::map<std::string, config::Value> values, const std::string& name) const {
    return {std::move(values), place_, name};
  }
  [[nodiscard]] config::Value frame(const Pose& X, const std::string& name) const {
    const Vec3 abc = angles_abc(X.R);
    return value(table({{"x_mm", mm(X.p.x())},
                        {"y_mm", mm(X.p.y())},
                        {"z_mm", mm(X.p.z())},
                        {"a_deg", deg(abc.x())},
                        {"b_deg", deg(abc.y())},
                        {"c_deg", deg(abc.z())}},
                       name));
  }

 private:
  Place place_;
};

}  // namespace

config::Table table_of(const SerialArm& arm, const Place& place) {
  const Writer w(place);
  config::Array rows, limits, compliance, task;
  std::map<std::string, config::Value> locked, sources;
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    const bool turns = row.kind == JointKind::revolute;
    const auto joint = [&](double q) { return turns ? w.deg(q) : w.mm(q); };
    std::map<std::string, config::Value> columns{
        {"a_mm", w.mm(row.a)},       {"alpha_deg", w.deg(row.alpha)},
        {"d_mm", w.mm(row.d)},       {"theta_offset_deg", w.deg(row.theta_offset)},
        {"sign", w.value(row.sign)}, {"joint", w.value(std::string(turns ? "revolute" : "prismatic"))}};
    if (row.coupled_back > 0) {
      columns.emplace("coupled_to", w.value(static_cast<double>(i + 1) - row.coupled_back));
      columns.emplace("coupling", w.value(row.coupling));
    }
    rows.push_back(w.value(w.table(std::move(columns), fmt::format("dh[{}]", i + 1))));
    std::map<std::string, config::Value> range{{turns ? "min_deg" : "min_mm", joint(row.range.min)},
                                               {turns ? "max_deg" : "max_mm", joint(row.range.max)}};
    if (row.speed > 0) range.emplace(turns ? "speed_deg_per_s" : "speed_mm_per_s", joint(row.speed));
    limits.push_back(w.value(w.table(std::move(range), fmt::format("limits[{}]", i + 1))));
    compliance.push_back(w.value(row.compliance));
    if (row.locked) locked.emplace(fmt::format("{}", i + 1), joint(*row.locked));
  }
  for (int i = 0; i < arm.task.size(); ++i) task.push_back(w.value(std::string(name_of(arm.task[i]))));
  for (const auto& [key, text] : arm.provenance) sources.emplace(key, w.value(text));
  std::map<std::string, config::Value> values{
      {"family", w.value(std::string(SerialArm::kFamily))},
      {"name", w.value(arm.name)},
      {"description", w.value(arm.description)},
      {"convention", w.value(std::string(arm.convention == DhConvention::standard ? "standard" : "modified"))},
      {"task", w.value(std::move(task))},
      {"dh", w.value(std::move(rows))},
      {"limits", w.value(std::move(limits))},
      {"compliance_rad_per_Nm", w.value(std::move(compliance))},
      {"base", w.frame(arm.X_MB, "base")},
      {"tool", w.frame(arm.X_FT, "tool")},
      {"provenance", w.value(w.table(std::move(sources), "provenance"))}};
  if (!locked.empty()) values.emplace("locked", w.value(w.table(std::move(locked), "locked")));
  return w.table(std::move(values), "");
}

}  // namespace polypod::machine
