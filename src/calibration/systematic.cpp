// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/systematic.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "systematic_columns.hpp"

namespace polypod::calibration {
namespace {

constexpr std::array<std::pair<std::string_view, Quantity>, 5> kQuantities{{{"scale", Quantity::scale},
                                                                            {"offset", Quantity::offset},
                                                                            {"target", Quantity::target},
                                                                            {"temperature", Quantity::temperature},
                                                                            {"force_gain", Quantity::force_gain}}};
constexpr std::array<std::pair<std::string_view, Distribution>, 4> kDistributions{
    {{"normal", Distribution::normal},
     {"rectangular", Distribution::rectangular},
     {"triangular", Distribution::triangular},
     {"u-shaped", Distribution::u_shaped}}};

template <class List>
std::string words_of(const List& list) {
  std::string out;
  for (std::size_t i = 0; i < list.size(); ++i)
    out += (i == 0 ? "" : i + 1 == list.size() ? " or " : ", ") + std::string(list[i].first);
  return out;
}

/// A unit in which a size may be stated, and how large one of it is in SI.
struct Unit {
  std::string_view name;
  double size = 1;
};
std::vector<Unit> units_of(Quantity quantity) {
  switch (quantity) {
    case Quantity::scale:
      return {{"um_per_m", 1e-6}, {"percent", 1e-2}};
    case Quantity::offset:
    case Quantity::target:
      return {{"um", 1e-6}};
    case Quantity::temperature:
      return {{"K", 1}};
    case Quantity::force_gain:
      break;
  }
  return {{"percent", 1e-2}};
}

constexpr std::array<std::string_view, 3> kSizes{"half_width", "standard", "expanded"};

/// The one size that the table has. Errors: CA150.
Status read_size(const config::Table& table, Systematic& out, bool& half_width) {
  constexpr config::Range kSize{0, 1e6, true, false};
  std::string found, allowed;
  for (const std::string_view kind : kSizes) {
    for (const Unit& unit : units_of(out.quantity)) {
      const std::string key = fmt::format("{}_{}", kind, unit.name);
      allowed += (allowed.empty() ? "" : ", ") + key;
      if (!table.has(key)) continue;
      if (!found.empty())
        return fail("CA150", fmt::format("{} and {} both say the size", found, key), table.place_of(key),
                    "leave one of them out");
      found = key;
      POLYPOD_ASSIGN(value, table.number(key, kSize));
      out.size = value * unit.size;
      half_width = kind == "half_width";
      if (kind != "expanded") continue;
      POLYPOD_ASSIGN(k, table.optional_number("k", 2, {1, 10}));
      out.divisor = k;
    }
  }
  if (!found.empty()) return {};
  for (const std::string& key : table.keys()) {  // a size in another unit, or misspelt
    const bool size = std::any_of(kSizes.begin(), kSizes.end(), [&](auto& kind) { return key.starts_with(kind); });
    if (size)
      return fail("CA150", fmt::format("\"{}\" is no size of the systematic part \"{}\"", key, name_of(out.quantity)),
                  table.place_of(key), "give one of " + allowed);
  }
  return fail("CA150", fmt::format("the systematic part \"{}\" has no size", name_of(out.quantity)), table.place(),
              "give one of " + allowed);
}

/// Errors: CA150.
Status read_distribution(const config::Table& table, Systematic& out, bool half_width) {
  POLYPOD_ASSIGN(text, table.optional_text("distribution", half_width ? "rectangular" : "normal"));
  const auto* found =
      std::find_if(kDistributions.begin(), kDistributions.end(), [&](auto& d) { return d.first == text; });
  if (found == kDistributions.end())
    return fail("CA150", fmt::format("distribution \"{}\": not {}", text, words_of(kDistributions)),
                table.place_of("distribution"));
  out.distribution = found->second;
  if (!half_width) {
    if (out.distribution == Distribution::normal) return {};
    return fail(
        "CA150", fmt::format("a {} distribution belongs to a half width", text), table.place_of("distribution"),
        "give half_width_..., or leave the distribution out: standard_... and expanded_... are used as they stand");
  }
  if (out.distribution == Distribution::normal)
    return fail("CA150", "a normal distribution has no half width", table.place_of("distribution"),
                "give standard_... (one standard deviation), or expanded_... with its k");
  out.divisor = divisor_of(out.distribution);
  return {};
}

Result<Systematic> systematic_of(const config::Table& table) {
  Systematic out;
  out.place = table.place();
  POLYPOD_ASSIGN(quantity, table.text("quantity"));
  const auto* found =
      std::find_if(kQuantities.begin(), kQuantities.end(), [&](auto& q) { return q.first == quantity; });
  if (found == kQuantities.end())
    return fail("CA150", fmt::format("quantity \"{}\": not {}", quantity, words_of(kQuantities)),
                table.place_of("quantity"));
  out.quantity = found->second;
  bool half_width = false;
  POLYPOD_TRY(read_size(table, out, half_width));
  POLYPOD_TRY(read_distribution(table, out, half_width));
  POLYPOD_ASSIGN(source, table.optional_text("source", ""));
  out.source = source;
  if (out.quantity == Quantity::temperature) {
    POLYPOD_ASSIGN(expansion, table.number("expansion_um_per_m_K", {0.1, 300}));
    out.expansion = 1e-6 * expansion;
    POLYPOD_ASSIGN(of, table.optional_text("of", "machine"));
    if (of != "machine" && of != "instrument")
      return fail("CA150", fmt::format("of = \"{}\": not machine or instrument", of), table.place_of("of"));
    out.of_machine = of == "machine";
  }
  if (out.quantity == Quantity::offset || out.quantity == Quantity::target) {
    POLYPOD_ASSIGN(axis, table.optional_text("axis", ""));
    const std::size_t at = std::string_view("xyz").find(axis);
    if (axis.size() > 1 || (!axis.empty() && at == std::string_view::npos))
      return fail("CA150", fmt::format("axis = \"{}\": not x, y or z", axis), table.place_of("axis"));
    if (!axis.empty()) out.axis = static_cast<int>(at);
  }
  POLYPOD_TRY(table.finish());
  return out;
}

bool has_place(Kind kind) {
  return kind == Kind::point || kind == Kind::axis || kind == Kind::pose;
}
bool has_reading(Kind kind) {
  return kind == Kind::distance || kind == Kind::gauge;
}

}  // namespace

std::string_view name_of(Quantity quantity) {
  return std::find_if(kQuantities.begin(), kQuantities.end(), [&](auto& q) { return q.second == quantity; })->first;
}
std::string_view name_of(Distribution distribution) {
  return std::find_if(kDistributions.begin(), kDistributions.end(), [&](auto& d) { return d.second == distribution; })
      ->first;
}

double divisor_of(Distribution distribution) {
  switch (distribution) {
    case Distribution::rectangular:
      return std::numbers::sqrt3;
    case Distribution::triangular:
      return std::numbers::sqrt2 * std::numbers::sqrt3;
    case Distribution::u_shaped:
      return std::numbers::sqrt2;
    case Distribution::normal:
      break;
  }
  return 1;
}

std::string unit_of(Quantity quantity) {
  switch (quantity) {
    case Quantity::scale:
      return "um/m";
    case Quantity::offset:
    case Quantity::target:
      return "um";
    case Quantity::temperature:
      return "K";
    case Quantity::force_gain:
      break;
  }
  return "%";
}

double for_user(Quantity quantity, double b) {
  return b / units_of(quantity).front().size;
}

Result<std::vector<Systematic>> read_systematic(const config::Table& table) {
  POLYPOD_ASSIGN(tables, table.tables("systematic"));
  std::vector<Systematic> out;
  for (const config::Table& one : tables) {
    POLYPOD_ASSIGN(part, systematic_of(one));
    out.push_back(std::move(part));
  }
  return out;
}

std::vector<SystematicUnknown> unknowns_of(const std::vector<Systematic>& parts, const std::vector<Measurement>& rows) {
  const auto any = [&](auto&& says) {
    return std::any_of(rows.begin(), rows.end(), [&](const Measurement& row) { return says(row.kind); });
  };
  const bool places = any(has_place), readings = any(has_reading);
  std::vector<SystematicUnknown> out;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Systematic& part = parts[i];
    const bool offset = part.quantity == Quantity::offset;
    if (!offset && part.quantity != Quantity::target) {
      if (part.quantity != Quantity::force_gain) out.push_back({i, -1});
      continue;
    }
    for (int axis = 0; axis < 3; ++axis)
      if ((part.axis < 0 || part.axis == axis) && (!offset || places)) out.push_back({i, axis});
    if (offset && readings && part.axis < 0) out.push_back({i, -1});
  }
  return out;
}

Eigen::MatrixXd systematic_columns(const std::vector<Systematic>& parts, const std::vector<SystematicUnknown>& unknowns,
                                   const Measurement& row, const Pose& X_MT, const Layout& layout,
                                   const Eigen::VectorXd& x, const Equations& e) {
  const Pose X_SM = pose_from(x.data() + layout.frame), X_TR = pose_from(x.data() + layout.target);
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(e.r.size(), std::ssize(unknowns));
  for (std::size_t k = 0; k < unknowns.size(); ++k) {
    const Systematic& part = parts[unknowns[k].part];
    const int axis = unknowns[k].axis;
    auto column = out.col(static_cast<Eigen::Index>(k));
    // Residuals are computed less measured, and b is in what was measured.
    switch (part.quantity) {
      case Quantity::scale:
        column = -e.J.col(layout.scale);
        break;
      case Quantity::offset:
        if (axis >= 0 && has_place(row.kind)) column[axis] = -1 / e.sigma[axis];
        if (axis < 0 && has_reading(row.kind)) column[0] = -1 / e.sigma[0];
        break;
      case Quantity::target:
        column = -e.J.col(layout.target + axis);
        break;
      case Quantity::temperature:
        // The whole machine, its scales too, grows about the origin of M; or the instrument shows more.
        column = part.of_machine ? Eigen::VectorXd(e.J.middleCols<3>(layout.frame) * (X_SM.R * (X_MT * X_TR).p))
                                 : Eigen::VectorXd(e.J.col(layout.scale));
        column *= -part.expansion;
        break;
      case Quantity::force_gain:
        break;
    }
  }
  return out;
}

}  // namespace polypod::calibration
