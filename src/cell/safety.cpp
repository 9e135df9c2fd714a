// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/safety.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "common.hpp"
#include "polypod/bodies/shape.hpp"
#include "polypod/cell/layout.hpp"
#include "polypod/core/units.hpp"
#include "polypod/geometry/segments.hpp"

namespace polypod::cell {
namespace {

constexpr double mm = units::kMetrePerMm;

/// Distance of what is moved from the wall over the line from a to b, seen from above.
double from_wall(const Swept& s, const Vec3& a, const Vec3& b) {
  const auto flat = [](const Vec3& p) { return Vec3(p.x(), p.y(), 0); };
  return segment_distance(flat(s.at), flat(s.to.value_or(s.at)), flat(a), flat(b)) - s.radius;
}
double bottom_of(const Swept& s) {
  return std::min(s.at.z(), s.to.value_or(s.at).z()) - s.radius;
}
double top_of(const Swept& s) {
  return std::max(s.at.z(), s.to.value_or(s.at).z()) + s.radius;
}

template <std::size_t N>
struct TableRow {
  double height;
  std::array<double, N> distance;
};

/// The largest entry of a table of distances over all heights of the hazard from `low` to `high` (rows, falling) for a
/// guard (columns, rising): between two rows the larger counts, between columns the lower; all in mm. None below the
/// first column.
template <std::size_t N, std::size_t Rows>
std::optional<double> of_table(const std::array<TableRow<N>, Rows>& rows, const std::array<double, N>& columns,
                               double low, double high, double guard) {
  if (guard < columns.front() - 1e-9) return std::nullopt;
  std::size_t column = 0;
  while (column + 1 < N && columns[column + 1] <= guard + 1e-9) ++column;
  double out = 0;
  for (std::size_t k = 0; k < Rows; ++k) {
    // Rows within, the next one above where `high` lies between two, and the next one below `low`.
    const bool under_top = rows[k].height <= high + 1e-9 || k + 1 == Rows || rows[k + 1].height < high - 1e-9;
    const bool over_bottom = rows[k].height >= low - 1e-9 || k == 0 || rows[k - 1].height > low + 1e-9;
    if (under_top && over_bottom) out = std::max(out, rows[k].distance[column]);
  }
  return out;
}

}  // namespace

std::optional<double> curtain_distance(double stopping, double resolution) {
  const double d = std::max(resolution, 14 * mm);
  if (resolution > 70 * mm) return std::nullopt;
  if (resolution > 40 * mm) return 1.6 * stopping + 850 * mm;
  const double c = 8 * (d - 14 * mm), near = 2.0 * stopping + c;
  if (near <= 500 * mm) return std::max(near, 100 * mm);
  return std::max(1.6 * stopping + c, 500 * mm);
}

std::optional<double> curtain_over_distance(double stopping, double hazard_height, double curtain_height) {
  return curtain_over_distance(stopping, hazard_height, hazard_height, curtain_height);
}

std::optional<double> curtain_over_distance(double stopping, double low, double high, double curtain_height) {
  static constexpr std::array<double, 12> kEdge{900, 1000, 1100, 1200, 1300, 1400, 1600, 1800, 2000, 2200, 2400, 2600};
  static constexpr std::array<TableRow<12>, 15> kRows{
      {{2600, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {2500, {400, 400, 350, 300, 300, 300, 300, 300, 250, 150, 100, 0}},
       {2400, {550, 550, 550, 500, 450, 450, 400, 400, 300, 250, 100, 0}},
       {2200, {800, 750, 750, 700, 650, 650, 600, 550, 400, 250, 0, 0}},
       {2000, {950, 950, 850, 850, 800, 750, 700, 550, 400, 0, 0, 0}},
       {1800, {1100, 1100, 950, 950, 850, 800, 750, 550, 0, 0, 0, 0}},
       {1600, {1150, 1150, 1100, 1000, 900, 850, 750, 450, 0, 0, 0, 0}},
       {1400, {1200, 1200, 1100, 1000, 900, 850, 650, 0, 0, 0, 0, 0}},
       {1200, {1200, 1200, 1100, 1000, 850, 800, 0, 0, 0, 0, 0, 0}},
       {1000, {1200, 1150, 1050, 950, 750, 700, 0, 0, 0, 0, 0, 0}},
       {800, {1150, 1050, 950, 800, 500, 450, 0, 0, 0, 0, 0, 0}},
       {600, {1050, 950, 750, 550, 0, 0, 0, 0, 0, 0, 0, 0}},
       {400, {900, 700, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {200, {600, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
       {0, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}}}};
  const std::optional<double> over = of_table(kRows, kEdge, low / mm, high / mm, curtain_height / mm);
  if (!over) return std::nullopt;
  if (!(*over > 0)) return 0;
  const double c = *over * mm, near = 2.0 * stopping + c;
  return near <= 500 * mm ? near : std::max(1.6 * stopping + c, 500 * mm);
}

std::optional<double> scanner_distance(double stopping, double height, double resolution) {
  if (height > 1.0 || height < 15 * (resolution - 50 * mm) - 1e-12) return std::nullopt;
  return 1.6 * stopping + std::max(1200 * mm - 0.4 * height, 850 * mm);
}

std::optional<double> reach_over_distance(double hazard_height, double fence_height) {
  return reach_over_distance(hazard_height, hazard_height, fence_height);
}

std::optional<double> reach_over_distance(double low, double high, double fence_height) {
  static constexpr std::array<double, 10> kFence{1000, 1200, 1400, 1600, 1800, 2000, 2200, 2400, 2500, 2700};
  static constexpr std::array<TableRow<10>, 15> kRows{{{2700, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0}},
                                                       {2600, {900, 800, 700, 600, 600, 500, 400, 300, 100, 0}},
                                                       {2400, {1100, 1000, 900, 800, 700, 600, 400, 300, 100, 0}},
                                                       {2200, {1300, 1200, 1000, 900, 800, 600, 400, 300, 0, 0}},
                                                       {2000, {1400, 1300, 1100, 900, 800, 600, 400, 0, 0, 0}},
                                                       {1800, {1500, 1400, 1100, 900, 800, 600, 0, 0, 0, 0}},
                                                       {1600, {1500, 1400, 1100, 900, 800, 500, 0, 0, 0, 0}},
                                                       {1400, {1500, 1400, 1100, 900, 800, 0, 0, 0, 0, 0}},
                                                       {1200, {1500, 1400, 1100, 900, 700, 0, 0, 0, 0, 0}},
                                                       {1000, {1500, 1400, 1000, 800, 0, 0, 0, 0, 0, 0}},
                                                       {800, {1500, 1300, 900, 600, 0, 0, 0, 0, 0, 0}},
                                                       {600, {1400, 1300, 800, 0, 0, 0, 0, 0, 0, 0}},
                                                       {400, {1400, 1200, 400, 0, 0, 0, 0, 0, 0, 0}},
                                                       {200, {1200, 900, 0, 0, 0, 0, 0, 0, 0, 0}},
                                                       {0, {1100, 500, 0, 0, 0, 0, 0, 0, 0, 0}}}};
  const std::optional<double> out = of_table(kRows, kFence, low / mm, high / mm, fence_height / mm);
  return out ? std::optional(*out * mm) : std::nullopt;
}

std::optional<double> reach_through_distance(const std::string& shape, double e) {
  struct Row {
    double upto, slot, square, round;
  };
  static constexpr std::array<Row, 9> kRows{{{4, 2, 2, 2},
                                             {6, 10, 5, 5},
                                             {8, 20, 15, 5},
                                             {10, 80, 25, 20},
                                             {12, 100, 80, 80},
                                             {20, 120, 120, 120},
                                             {30, 850, 120, 120},
                                             {40, 850, 200, 120},
                                             {120, 850, 850, 850}}};
  for (const Row& row : kRows) {
    if (e / mm > row.upto + 1e-9) continue;
    return (shape == "slot" ? row.slot : shape == "square" ? row.square : row.round) * mm;
  }
  return std::nullopt;
}

const std::vector<std::pair<std::string, double>>& crushing_gaps() {
  static const std::vector<std::pair<std::string, double>> kGaps{{"body", 0.500},
                                                                 {"head", 0.300},
                                                                 {"leg", 0.180},
                                                                 {"foot", 0.120},
                                                                 {"toes", 0.050},
                                                                 {"arm", 0.120},
                                                                 {"hand, wrist, fist", 0.100},
                                                                 {"finger", 0.025}};
  return kGaps;
}

std::vector<std::string> crushed_in(double gap) {
  std::vector<std::pair<std::string, double>> parts = crushing_gaps();
  std::stable_sort(parts.begin(), parts.end(), [](const auto& x, const auto& y) { return x.second > y.second; });
  std::vector<std::string> out;
  for (const auto& [part, least] : parts)
    if (gap < least - 1e-9) out.push_back(part);
  return out;
}

Stopping stopping_of(const Machine& machine) {
  if (machine.stopping >= 0) return {machine.stopping, true};
  double time = 0;
  if (has_cycles(machine)) {
    time = std::max(machine.tool_speed / machine.tool_acceleration, machine.drive_speed / machine.drive_acceleration);
  } else {
    for (std::size_t j = 0; j < machine.joint_speed.size(); ++j)
      time = std::max(time, machine.joint_speed[j] / machine.joint_acceleration[j]);
  }
  return {time, false};
}

namespace {

/// What the values of ISO 13854 say of a gap.
std::string crushing_text(double gap) {
  const std::vector<std::string> parts = crushed_in(gap);
  return parts.empty() ? "wide enough for a body (ISO 13854)"
                       : fmt::format("too narrow for {} (ISO 13854)", fmt::join(parts, ", "));
}

/// Distance of the boxes of two belts, m; 0 where they touch.
double between(const Solid& a, const Solid& b) {
  const auto pose = [](const Solid& s) {
    Pose X;
    X.R = Eigen::AngleAxisd(s.turn, Vec3::UnitZ()).toRotationMatrix();
    X.p = s.middle;
    return X;
  };
  return bodies::distance(bodies::box(-a.size / 2, a.size / 2), pose(a), bodies::box(-b.size / 2, b.size / 2), pose(b),
                          kInfinity)
      .high;
}

/// Gaps that are narrower than a body: between what moves and what stands, and between belts.
void add_gaps(const Cell& cell, const std::vector<Gap>& gaps, Safety& out) {
  const double body = crushing_gaps().front().second;
  for (const Gap& g : gaps) {
    if (g.distance >= body) break;
    out.hazards.push_back({fmt::format("{} and {}", g.machine, g.what), "crushing",
                           fmt::format("{} passes the {} {} near {}: {}", g.mover, g.kind, g.what, place_text(g.at),
                                       crushing_text(g.distance)),
                           "", g.distance, 2, 1, 1, true});
  }
  const std::vector<Solid> all = solids(cell);
  const auto belt = [&](const std::string& name) {
    return std::find_if(all.begin(), all.end(), [&](const Solid& s) { return s.name == name; });
  };
  for (const Conveyor& c : cell.conveyors) {
    if (c.onto.empty()) continue;
    const double gap = between(*belt(c.name), *belt(c.onto));
    if (gap >= body) continue;
    out.hazards.push_back({c.name + " and " + c.onto, "crushing",
                           fmt::format("between the bodies of the belts: {}", crushing_text(gap)), "", gap, 1, 1, 1});
  }
}

}  // namespace

Safety safety(const Cell& cell, const std::vector<Swept>& space, const std::vector<Gap>& gaps) {
  Safety out;
  for (const Machine& m : cell.machines) {
    const Stopping s = stopping_of(m);
    out.stopping = std::max(out.stopping, s.time);
    if (!s.stated) {
      out.assumed.push_back(
          fmt::format("{} stops within {:.0f} ms: its largest speed over a deceleration as large as its acceleration; "
                      "measure it",
                      m.name, s.time / units::from_ms(1)));
    }
  }
  constexpr double kWalk = 1.6;
  bool device = false;
  for (const Guard& g : cell.guards) {
    GuardFigure f;
    f.name = g.name;
    f.kind = name_of(g.kind);
    f.actual = std::numeric_limits<double>::infinity();
    const bool known = !space.empty();
    if (!known)
      out.not_judged.push_back(fmt::format("the distance of {} {}: no place of a machine is known", f.kind, g.name));
    std::string lacking;
    // What each place of a machine needs, for all of its heights: that which lacks most counts.
    const auto against = [&](const auto& needs) {
      std::optional<double> needed = 0;
      double most = -std::numeric_limits<double>::infinity();
      for (const Swept& s : space) {
        const std::optional<double> here = needs(std::max(0.0, bottom_of(s)), std::max(0.0, top_of(s)));
        if (!here) return here;
        const double is = from_wall(s, g.from, g.to);
        if (*here - is <= most) continue;
        most = *here - is;
        needed = here;
        f.actual = is;
        lacking = s.machine;
      }
      f.enough = most <= 0;
      return needed;
    };
    std::optional<double> needed;
    if (g.kind == Guard::Kind::fence) {
      needed = against([&](double low, double high) { return reach_over_distance(low, high, g.height); });
      f.rule = "ISO 13857, Table 2 (reaching over, high risk)";
      if (!needed) {
        f.enough = false;
        f.note = "fences below 1 m do not hold anybody back";
      } else if (g.height < 1.4 - 1e-12) {
        f.enough = false;
        f.note = "fences below 1.4 m need another measure (ISO 13857, Table 2)";
      }
      if (g.opening > 0) {
        const auto through = reach_through_distance(g.opening_shape, g.opening);
        double near = std::numeric_limits<double>::infinity();
        constexpr double kArm = 0.85;  // m, of an arm through the opening
        for (const Swept& s : space)
          if (!g.opening_height || (bottom_of(s) < *g.opening_height + kArm && top_of(s) > *g.opening_height - kArm))
            near = std::min(near, from_wall(s, g.from, g.to));
        if (!g.opening_height)
          out.assumed.push_back(fmt::format("the openings of {} are at any height (opening_height_mm)", g.name));
        if (!through) {
          f.enough = false;
          f.note =
              fmt::format("whole bodies pass the opening of {:.0f} mm: a smaller one is needed (ISO 13857, Table 4)",
                          g.opening / mm);
        } else if (near < *through) {
          f.enough = false;
          f.note = fmt::format(
              "through the opening of {:.0f} mm the nearest place is {:.0f} mm away, {:.0f} mm are needed (ISO 13857, "
              "Table 4)",
              g.opening / mm, near / mm, *through / mm);
        }
        if (!through || near < *through) {
          out.hazards.push_back({fmt::format("opening in {}", g.name), "shearing",
                                 "between what is moved and the edge of the opening", g.measure, 0, 2, 1, 1});
        }
      }
    } else {
      device = true;
      std::vector<std::string> missing;
      if (!g.response_given) missing.emplace_back("its response_ms (0 is taken)");
      if (!cell.control_response_given) missing.emplace_back("the control_response_ms of the cell (0 is taken)");
      if (!g.resolution_given) missing.push_back(fmt::format("its resolution_mm ({:g} is taken)", g.resolution / mm));
      if (!missing.empty())
        out.not_judged.push_back(
            fmt::format("the distance of {} {}: not stated is {}", f.kind, g.name, fmt::join(missing, ", and ")));
      f.stopping = g.response + cell.control_response + out.stopping;
      const bool curtain = g.kind == Guard::Kind::curtain;
      const std::optional<double> first =
          curtain ? curtain_distance(f.stopping, g.resolution) : scanner_distance(f.stopping, g.height, g.resolution);
      f.rule = curtain ? "ISO 13855, S = K T + C, approach across the curtain"
                       : "ISO 13855, S = K T + C, approach along the field";
      needed = against([&](double low, double high) -> std::optional<double> {
        if (!first || !curtain) return first;
        const std::optional<double> over = curtain_over_distance(f.stopping, low, high, g.height);
        return over ? std::optional(std::max(*first, *over)) : std::nullopt;
      });
      // NaN stays.
      const auto raise = [](double& to, const std::optional<double>& by) {
        to = by ? (to < *by ? *by : to) : std::numeric_limits<double>::quiet_NaN();
      };
      raise(out.guard_distance, first);
      raise(out.guard_needed, first ? needed : first);
      if (!first) {
        f.enough = false;
        f.note = "no value: its resolution or height is out of the standard's range";
      } else if (!needed) {
        f.enough = false;
        f.note = "its upper edge is below 900 mm: people reach and step over it (ISO 13855, 6.5)";
      } else if (*needed > *first) {
        f.rule = "ISO 13855, S = K T + C, reaching over the curtain (Table 1)";
      }
    }
    f.needed = needed.value_or(std::numeric_limits<double>::quiet_NaN());
    if (!known) {
      f.enough = false;
      f.note = "not judged: no place of a machine is known";
    } else if (!f.enough) {
      const std::string text = f.note.empty() ? fmt::format("guard {}: {:.0f} mm from {}, {:.0f} mm are needed ({})",
                                                            g.name, f.actual / mm, lacking, *needed / mm, f.rule)
                                              : fmt::format("guard {}: {}", g.name, f.note);
      f.measured = !g.measure.empty();
      if (!f.measured)
        out.problems.push_back({"guard", text});
      else
        f.note += fmt::format("{}stated measure, to be judged: {}", f.note.empty() ? "" : "; ", g.measure);
    }
    out.guards.push_back(f);
  }
  if (!cell.guards.empty())
    out.not_judged.emplace_back("what reaches beneath the guards: the file has no lower edges of them");
  const std::string open = way_in(cell, space);
  if (!open.empty() && cell.open_sides.empty()) {
    out.problems.push_back(
        {"guard", fmt::format("people can walk to the machines {}: no guard stands there; add a [[guard]], or say in "
                              "open_sides what else protects",
                              open)});
  }
  if (!device) {
    constexpr double kResponse = 0.020, kResolution = 0.030;
    out.guard_distance = *curtain_distance(kResponse + cell.control_response + out.stopping, kResolution);
    out.guard_needed = out.guard_distance;
    out.assumed.push_back(
        fmt::format("the cell has no light curtain or scanner: the guard distance is that of a curtain of 30 mm with a "
                    "response of 20 ms{}",
                    cell.control_response_given ? "" : ", and 0 ms of its control (control_response_ms)"));
  }
  // What the layout itself tells; the rest is for the person who assesses.
  for (const Machine& m : cell.machines) {
    out.hazards.push_back({m.name, "crushing",
                           has_cycles(m) ? "between arm and platform, and between tool and belt"
                                         : "between tool and frame, while it is programmed",
                           "", -1, 2, 1, 1});
    out.hazards.push_back({m.name, "electrical", "live parts, also after a fault",
                           "to be checked: insulation, labels, locked cabinets", -1, 2, 1, 2});
  }
  for (const Conveyor& c : cell.conveyors) {
    out.hazards.push_back({c.name, "drawing in", "between belt and drum", "", -1, 1, 1, 1});
    if (c.power > 0)
      out.hazards.push_back({c.name, "electrical", fmt::format("motor of {:.0f} W", c.power),
                             "to be checked: insulation, labels", -1, 2, 1, 2});
  }
  add_gaps(cell, gaps, out);
  out.hazards.push_back({"all parts", "cutting", "edges and burrs", "to be checked: deburred", -1, 1, 1, 1});
  out.assumed.push_back(fmt::format("people walk at {:.1f} m/s and reach at 2.0 m/s (ISO 13855)", kWalk));
  return out;
}

}  // namespace polypod::cell
