// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "compliance_figures.hpp"
#include "parts.hpp"
#include "polypod/core/units.hpp"
#include "polypod/pages/compliance_map.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {

using report::Colour;
using report::ColourMap;
using report::HeatMap;

std::string shown_unit(const Field& f) {
  if (f.kind != Field::Kind::determinant) return "µm/N";
  const std::size_t power = f.unit.find('^');
  if (power == std::string::npos) return f.unit;
  constexpr const char* kRaised[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string out = f.unit.substr(0, power);
  for (const char c : f.unit.substr(power + 1)) out += c == '-' ? "⁻" : kRaised[c - '0'];
  return out;
}

std::string symbol(const Field& f) {
  return fmt::format("C{}{}", "xyz"[f.row], "xyz"[f.column]);
}

std::string given(double value) {
  const std::string text = fmt::format("{:.6g}", value == 0 ? 0.0 : value);
  return text[0] == '-' ? "−" + text.substr(1) : text;
}

namespace {

std::string with_minus(std::string text) {
  for (std::size_t i = text.find('-'); i != std::string::npos; i = text.find('-', i)) text.replace(i, 1, "−");
  return text;
}

}  // namespace

std::string shown_place(const ComplianceMap& map) {
  return with_minus(place_of(map));
}

std::string shown_domain(const ComplianceMap& map) {
  return with_minus(domain_of(map));
}

void ColourScale::add(const std::vector<double>& values) {
  const Extremes e = extremes_of(values);
  if (e.min_at < 0) return;
  low = std::min(low, e.min);
  high = std::max(high, e.max);
}
double ColourScale::largest() const {
  return std::max(std::abs(low), std::abs(high));
}
void ColourScale::set(HeatMap& map, bool round_zero) const {
  if (round_zero) map.map = ColourMap::diverging;
  map.min = round_zero ? -largest() : low;
  map.max = round_zero ? largest() : high;
}

HeatMap heat_of(const ComplianceMap& map, const Field& f) {
  HeatMap out;
  out.title = fmt::format("{}{}{}", f.joint, f.joint.empty() ? "" : ": ", f.name);
  const auto side = [](machine::Coordinate c, const std::array<double, 2>& range) {
    return report::Axis{machine::name_of(c), unit_of(c), tidy(c, range[0]), tidy(c, range[1])};
  };
  out.x = side(map.plane.u, map.rectangle.u);
  out.y = side(map.plane.v, map.rectangle.v);
  out.columns = map.map.grid.columns;
  out.rows = map.map.grid.rows;
  out.values = f.values;
  out.unit = shown_unit(f);
  out.levels = 14;
  for (const LoadedPath& path : map.paths) {
    const statics::PlaneAxes axes = statics::axes_of(map.plane);
    out.lines.push_back({"",
                         {{tidy_mm(path.from_M[axes.u]), tidy_mm(path.from_M[axes.v])},
                          {tidy_mm(path.to_M[axes.u]), tidy_mm(path.to_M[axes.v])}},
                         Colour::ink,
                         report::LineStyle::dashed,
                         1.5});
  }
  return out;
}

namespace {

using report::Cell;
using report::Figure;
using report::number;
using report::Report;
using report::Table;
using report::Verdict;
using units::to_um;

using Kind = Field::Kind;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr const char* kUm = "µm";
constexpr const char* kUmPerN = "µm/N";
constexpr double kDrawnShare = 0.01;  // joints whose part stays below this of the whole are named, not drawn
// In the order of report::BarChart, so that a joint keeps its colour through the page.
constexpr Colour kJointColours[] = {Colour::blue,   Colour::orange, Colour::green,
                                    Colour::purple, Colour::sky,    Colour::vermillion};

constexpr Colour kPathColours[] = {Colour::sky,   Colour::vermillion, Colour::ink,
                                   Colour::green, Colour::purple,     Colour::orange};

std::string range_of(machine::Coordinate c, const std::array<double, 2>& range) {
  return fmt::format("{} … {} {}", given(tidy(c, range[0])), given(tidy(c, range[1])), unit_of(c));
}
/// Three numbers that stay on one line.
std::string triple(const Vec3& v) {
  return fmt::format("{},\u00a0{},\u00a0{}", given(v.x()), given(v.y()), given(v.z()));
}
std::string triple_mm(const Vec3& p_M) {
  return triple(Vec3(tidy_mm(p_M.x()), tidy_mm(p_M.y()), tidy_mm(p_M.z())));
}

/// "joint 1", "joints 1 and 3", "legs 1, 2 and 4".
std::string joined(const std::vector<std::string>& joints) {
  std::string out;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const std::size_t space = joints[i].find(' ');
    if (i == 0) {
      out = joints[i].substr(0, space) + (joints.size() > 1 ? "s" : "") + joints[i].substr(space);
    } else {
      out += (i + 1 == joints.size() ? " and" : ",") + joints[i].substr(space);
    }
  }
  return out;
}

/// The fields of a map, and the pictures of them.
class Figures {
 public:
  explicit Figures(const ComplianceMap& map) : map_(map), fields_(fields_of(map)) {}

  [[nodiscard]] const std::vector<Field>& fields() const { return fields_; }
  [[nodiscard]] std::vector<const Field*> of(Kind kind) const {
    std::vector<const Field*> out;
    for (const Field& f : fields_)
      if (f.kind == kind) out.push_back(&f);
    return out;
  }
  [[nodiscard]] const Field* determinant() const {
    const auto found = of(Kind::determinant);
    return found.empty() ? nullptr : found.front();
  }
  /// The shares of every joint in the same entry of the matrix as `whole`.
  [[nodiscard]] std::vector<const Field*> shares_of(const Field& whole) const {
    std::vector<const Field*> out;
    for (const Field* f : of(Kind::share))
      if (f->row == whole.row && f->column == whole.column) out.push_back(f);
    return out;
  }

  /// Maps in one scale of colours: from the least to the greatest of all of them, or round zero where they differ in
  /// sign.
  [[nodiscard]] Panels in_one_scale(const std::vector<const Field*>& fields, bool signs, bool by_joint) const {
    ColourScale scale;
    for (const Field* f : fields) scale.add(f->values);
    Panels out;
    for (const Field* f : fields) {
      HeatMap h = heat_of(map_, *f);
      scale.set(h, signs);
      out.emplace_back(by_joint ? f->joint : symbol(*f), h);
    }
    return out;
  }
  [[nodiscard]] Panels direct() const { return in_one_scale(of(Kind::direct), false, false); }
  [[nodiscard]] Panels cross() const { return in_one_scale(of(Kind::cross), true, false); }
  [[nodiscard]] HeatMap determinant_heat() const {
    HeatMap h = heat_of(map_, *determinant());
    h.title = "|det J|";
    for (double& v : h.values) v = std::abs(v);
    h.levels = 14;
    return h;
  }

 private:
  const ComplianceMap& map_;
  std::vector<Field> fields_;
};

/// Of a path: the displacement along an axis of M or along the force, of the whole or of one joint.
std::vector<double> along(const LoadedPath& path, const Vec3& direction, int joint) {
  std::vector<double> out;
  for (const statics::PathError& e : path.points) {
    if (!e.reachable) {
      out.push_back(kNone);
      continue;
    }
    const Vec3& d = joint < 0 ? e.total : e.by_joint[static_cast<std::size_t>(joint)];
    out.push_back(to_um(direction.dot(d)));
  }
  return out;
}

/// "joint" or "leg".
std::string column_word(const ComplianceMap& map) {
  const std::string name = statics::column_names(map.machine).front();
  return name.substr(0, name.find(' '));
}

Entries facts_of(const ComplianceMap& map, const std::string& version) {
  Entries out;
  if (map.plane.of_positions()) {
    out.emplace_back("plane", shown_place(map) + ", in the machine's frame M");
  } else {
    out.emplace_back("over", shown_domain(map) + ", in the machine's frame M");
  }
  out.emplace_back(machine::name_of(map.plane.u), range_of(map.plane.u, map.rectangle.u));
  out.emplace_back(machine::name_of(map.plane.v), range_of(map.plane.v, map.rectangle.v));
  if (!map.angles_deg.empty()) out.emplace_back("orientation", orientation_of(map));
  out.emplace_back("grid", fmt::format("{} × {} points", map.map.grid.columns, map.map.grid.rows));
  if (map.measured) out.emplace_back("measurements", map.measured->files);
  if (!version.empty()) out.emplace_back("made with", "Polypod " + version);
  return out;
}

class CompliancePart {
 public:
  CompliancePart(Report& report, const ComplianceMap& map)
      : map_(map), figures_(map), compliant_(statics::has_compliance(map.machine)), report_(report) {}

  /// `brief`: without a map of each joint's share.
  void add(bool brief = false) {
    glance();
    if (map_.measured) measured();
    if (compliant_) compliances();
    determinant();
    if (compliant_) joints(brief);
    paths();
    reading();
  }

 private:
  [[nodiscard]] std::string word() const { return column_word(map_); }
  [[nodiscard]] std::string where(int point) const {
    const auto [u, v] = coordinates_at(map_, point);
    const auto hundredths = [](double value) { return given(std::round(value * 100) / 100); };
    return fmt::format("{},\u00a0{}", hundredths(u), hundredths(v));
  }

  void glance() {
    report_.add_section("Deflection per newton");
    if (map_.measured) {
      report_.add_verdict(explained(*map_.measured) ? Verdict::good : Verdict::neutral,
                          measured_verdict(map_, false) + ".");
    }
    const int points = static_cast<int>(map_.map.points.size()), out_of_reach = points - reached(map_.map);
    std::vector<report::KeyFigure> figures;
    for (const Field* f : figures_.of(Kind::direct)) {
      const Extremes e = extremes_of(f->values);
      figures.push_back({number(e.max), kUmPerN,
                         fmt::format("largest {}, along {} under a force along {}; least {}", symbol(*f), "xyz"[f->row],
                                     "xyz"[f->row], number(e.min)),
                         Verdict::neutral});
    }
    figures.push_back({number(100.0 * out_of_reach / points, out_of_reach == 0 ? 1 : 3), "%",
                       out_of_reach == 0 ? "of the points are out of reach"
                                         : "of the points are out of reach: the maps are blank there",
                       Verdict::neutral});
    report_.add_key_figures(figures);
    report_.add_text(
        "This answers for the static deflection of the tool centre point by the compliances of the machine that are "
        "known: not for the compliance of tool, workpiece and clamping, not for vibration, and not for collisions.");
    if (const Status compliant = statics::needs_compliance(map_.machine); !compliant) {
      report_.add_verdict(Verdict::neutral,
                          "The machine's file has no compliances, so this map shows the determinant of the Jacobian "
                          "alone. For the rest " +
                              compliant.error().hint + ".");
    }
    if (both_signs(map_)) report_.add_verdict(Verdict::neutral, std::string(kBothSigns) + ".");
    Table table;
    const machine::Coordinate u = map_.plane.u, v = map_.plane.v;
    const std::string at = fmt::format("at {}, {}", machine::name_of(u), machine::name_of(v));
    std::string unit = unit_of(u);
    if (unit != unit_of(v)) unit += fmt::format(", {}", unit_of(v));
    table.columns = {{"", ""}, {"least", ""}, {at, unit}, {"mean", ""}, {"greatest", ""}, {at, unit}, {"unit", ""}};
    for (const Field& f : figures_.fields()) {
      if (f.kind != Kind::direct && f.kind != Kind::cross && f.kind != Kind::determinant) continue;
      const Extremes e = extremes_of(f.values);
      if (e.min_at < 0) continue;
      table.rows.push_back({f.kind == Kind::determinant ? f.name : symbol(f), e.min, where(e.min_at), e.mean, e.max,
                            where(e.max_at), shown_unit(f)});
    }
    report_.add_table(table);
  }

  void measured() {
    const MeasuredCompliance& m = *map_.measured;
    report_.add_section("Measured against computed");
    report_.add_text(fmt::format(
        "Measured: displacements under known forces at {} points, interpolated without any model of the {}s "
        "(correlated over {} mm). The maps are blank beside the measured points.",
        m.points, word(), number(units::to_mm(m.map.correlation_length()))));
    add_measured(report_, map_, true);
  }

  void compliances() {
    const std::string lines = map_.paths.empty() ? "" : " Dashed: the paths of the errors below.";
    report_.add_section("Direct compliances");
    report_.add_figure_grid(3, figures_.direct(),
                            "Displacement of the tool tip along an axis under 1 N along the same axis. One scale of "
                            "colours for the three: dark is stiff, yellow is compliant." +
                                lines);
    report_.add_section("Cross compliances");
    report_.add_figure_grid(
        3, figures_.cross(),
        "Displacement along one axis under 1 N along another: Cxy is along x under a force along y, and equally along "
        "y under a force along x. One scale of colours for the three: blue is against the "
        "axis, red along it, grey is none." +
            lines);
  }

  void determinant() {
    if (figures_.determinant() == nullptr) return;
    report_.add_section("The determinant of the Jacobian");
    const std::string caption =
        "|det J|, the determinant of the Jacobian from joint speeds to the speeds of the tool. It is 0 where a "
        "direction "
        "of motion is lost (type 1 singular pose), and grows beyond all bounds towards a pose at which the drives do "
        "not "
        "constrain the tool (type 2, of machines with several legs).";
    // A square plane at full width would fill the screen.
    const auto side = [](machine::Coordinate c, const std::array<double, 2>& r) { return tidy(c, r[1] - r[0]); };
    if (side(map_.plane.v, map_.rectangle.v) > 0.6 * side(map_.plane.u, map_.rectangle.u)) {
      report_.add_figure_grid(2, {{"", figures_.determinant_heat()}}, caption);
    } else {
      report_.add_figure(figures_.determinant_heat(), caption);
    }
  }

  void joints(bool brief) {
    const std::string one = word();
    report_.add_section(fmt::format("Contribution of each {}", one));
    report::BarChart bars;
    bars.title = fmt::format("Mean direct compliance by {}", one);
    bars.unit = kUmPerN;
    bars.parts = statics::column_names(map_.machine);
    Table table;
    table.columns = {{one, ""}};
    for (std::string name : bars.parts) {
      if (const std::size_t space = name.find(' '); space != std::string::npos) name.replace(space, 1, "\u00a0");
      table.rows.push_back({name});
    }
    for (const Field* whole : figures_.of(Kind::direct)) {
      report::BarChart::Row row{symbol(*whole), {}};
      const double total = extremes_of(whole->values).mean;
      table.columns.push_back({symbol(*whole), "mean, µm/N", 3});
      table.columns.push_back({"contribution", "%", 1});
      const auto shares = figures_.shares_of(*whole);
      for (std::size_t k = 0; k < shares.size(); ++k) {
        const double mean = extremes_of(shares[k]->values).mean;
        row.parts.push_back(mean);
        table.rows[k].emplace_back(mean);
        table.rows[k].emplace_back(total > 0 ? 100 * mean / total : 0.0);
      }
      bars.rows.push_back(std::move(row));
    }
    report_.add_figure(bars, fmt::format("Mean over the map. A stiffer {} helps most where its bar is longest.", one));
    report_.add_table(table);
    if (brief) return;
    for (const Kind kind : {Kind::direct, Kind::cross}) {
      for (const Field* whole : figures_.of(kind)) shares(*whole);
    }
  }

  void shares(const Field& whole) {
    const Extremes all = extremes_of(whole.values);
    // Shares of cross compliances may cancel: they are judged by the largest of them.
    double largest = std::max(std::abs(all.min), std::abs(all.max));
    const std::vector<const Field*> every = figures_.shares_of(whole);
    const auto peak = [](const Field& f) {
      const Extremes e = extremes_of(f.values);
      return std::max(std::abs(e.min), std::abs(e.max));
    };
    for (const Field* f : every) largest = std::max(largest, peak(*f));
    std::vector<const Field*> drawn;
    std::vector<std::string> small;
    for (const Field* f : every) {
      if (peak(*f) > kDrawnShare * largest) {
        drawn.push_back(f);
      } else {
        small.push_back(f->joint);
      }
    }
    if (drawn.empty()) return;
    if (drawn.size() == 1) {
      report_.add_heading(fmt::format("{} by {}", symbol(whole), word()));
      report_.add_text(fmt::format("{} comes from {} alone; all others stay below {:g} % everywhere.", symbol(whole),
                                   drawn.front()->joint, 100 * kDrawnShare));
      return;
    }
    const bool direct = whole.kind == Kind::direct;
    report_.add_heading(fmt::format("{} by {}", symbol(whole), word()));
    std::string caption = direct ? "Parts of the direct compliance, µm/N, in one scale of colours; they add up to it."
                                 : "Parts of the cross compliance, µm/N, in one scale of colours; they add up to it, "
                                   "and those of opposite signs cancel.";
    if (!small.empty()) {
      caption += fmt::format(" Not drawn, because below {:g} % everywhere: {}.", 100 * kDrawnShare, joined(small));
    }
    const int columns = drawn.size() == 2 || drawn.size() == 4 ? 2 : 3;
    report_.add_figure_grid(columns, figures_.in_one_scale(drawn, !direct, true), caption);
  }

  void paths() {
    if (map_.paths.empty()) return;
    report_.add_section(map_.paths.size() == 1 ? "Error along a straight path" : "Errors along straight paths");
    Table table;
    std::vector<std::string> blank;
    table.caption = "Displacement of the tool tip under a constant force";
    table.columns = {{"path", ""},      {"from", "x, y, z, mm"}, {"to", "x, y, z, mm"}, {"force", "x, y, z, N"},
                     {"along x", "µm"}, {"along y", "µm"},       {"along z", "µm"},     {"largest", "µm", 1}};
    for (std::size_t k = 0; k < map_.paths.size(); ++k) {
      const LoadedPath& path = map_.paths[k];
      std::vector<Cell> row{fmt::format("{}", k + 1), triple_mm(path.from_M), triple_mm(path.to_M),
                            triple(path.force_M)};
      for (int i = 0; i < 3; ++i) {
        const Extremes e = extremes_of(along(path, Vec3::Unit(i), -1));
        row.emplace_back(e.min_at < 0
                             ? std::string("–")
                             : fmt::format("{}\u00a0…\u00a0{}", report::fixed(e.min, 1), report::fixed(e.max, 1)));
      }
      double largest = 0;
      for (const statics::PathError& e : path.points) largest = std::max(largest, e.total.norm());
      row.emplace_back(to_um(largest));
      const std::size_t out = path.points.size() - static_cast<std::size_t>(reached(path));
      if (out > 0) {
        blank.push_back(fmt::format("Path {}: {} of {} points are out of reach.", k + 1, out, path.points.size()));
      }
      table.rows.push_back(std::move(row));
    }
    report_.add_table(table);
    report_.add_list(blank);
    if (map_.paths.size() > 1) together();
    for (std::size_t k = 0; k < map_.paths.size(); ++k) path(k);
  }

  /// The axis of M to which the path is parallel, or -1.
  [[nodiscard]] static int parallel_axis(const LoadedPath& path) {
    const Vec3 way = path.to_M - path.from_M;
    for (int i = 0; i < 3; ++i)
      if (std::abs(way[i]) > (1 - 1e-12) * way.norm()) return i;
    return -1;
  }
  /// Where the points stand: their coordinate on that axis, or the way from the start, mm. Widens `axis` to hold them.
  [[nodiscard]] static std::vector<double> abscissa(const LoadedPath& path, int parallel, report::Axis& axis) {
    std::vector<double> out;
    out.reserve(path.points.size());
    for (const statics::PathError& e : path.points)
      out.push_back(parallel < 0 ? tidy_mm((e.p_M - path.from_M).norm()) : tidy_mm(e.p_M[parallel]));
    const auto [low, high] = std::minmax_element(out.begin(), out.end());
    axis.label = parallel < 0 ? "distance from the start" : std::string(1, "xyz"[parallel]);
    axis.unit = "mm";
    axis.min = axis.min ? std::min(*axis.min, *low) : *low;
    axis.max = axis.max ? std::max(*axis.max, *high) : *high;
    return out;
  }

  /// All paths in one plot.
  void together() {
    int parallel = parallel_axis(map_.paths.front());
    for (const LoadedPath& path : map_.paths)
      if (parallel_axis(path) != parallel) parallel = -1;
    report::LinePlot plot;
    plot.title = "Displacement along the force";
    plot.y = {"along the force", kUm, {}, {}};
    for (std::size_t k = 0; k < map_.paths.size(); ++k) {
      const LoadedPath& path = map_.paths[k];
      const std::vector<double> s = abscissa(path, parallel, plot.x);
      // By symmetry paths may coincide: each is thinner than the one below it.
      plot.series.push_back({fmt::format("path {}", k + 1), s, along(path, path.force_M.normalized(), -1),
                             kPathColours[k % std::size(kPathColours)], report::LineStyle::solid,
                             std::max(1.4, 5 - 1.6 * static_cast<double>(k))});
    }
    report_.add_figure(plot, "The paths beside each other: displacement along the force.");
  }

  void path(std::size_t k) {
    const LoadedPath& path = map_.paths[k];
    report_.add_heading(fmt::format("Path {}: from {} to {} mm", k + 1, triple_mm(path.from_M), triple_mm(path.to_M)));
    report::LinePlot plot;
    const std::vector<double> s = abscissa(path, parallel_axis(path), plot.x);
    plot.y = {"displacement", kUm, {}, {}};
    plot.y.with_zero = true;
    report::LinePlot by_joint = plot;
    plot.title = fmt::format("Displacement along path {}", k + 1);
    constexpr Colour kAxes[] = {Colour::vermillion, Colour::blue, Colour::green};
    for (int i = 0; i < 3; ++i) {
      plot.series.push_back({fmt::format("along {}", "xyz"[i]), s, along(path, Vec3::Unit(i), -1), kAxes[i],
                             report::LineStyle::solid, 1.8});
    }
    report_.add_figure(plot, "Displacement of the tool tip along the three axes.");

    const Vec3 direction = path.force_M.normalized();
    by_joint.title = fmt::format("Displacement along the force by {}, path {}", word(), k + 1);
    by_joint.y.label = "along the force";
    const std::vector<double> whole = along(path, direction, -1);
    const auto peak = [](const std::vector<double>& values) {
      const Extremes e = extremes_of(values);
      return std::max(std::abs(e.min), std::abs(e.max));
    };
    by_joint.series.push_back({"whole", s, whole, Colour::ink, report::LineStyle::solid, 2.4});
    const std::vector<std::string> names = statics::column_names(map_.machine);
    std::vector<std::string> small;
    for (std::size_t j = 0; j < names.size(); ++j) {
      const std::vector<double> part = along(path, direction, static_cast<int>(j));
      if (peak(part) > kDrawnShare * peak(whole)) {
        by_joint.series.push_back({names[j], s, part, kJointColours[j % std::size(kJointColours)],
                                   j < std::size(kJointColours) ? report::LineStyle::solid : report::LineStyle::dashed,
                                   1.8});
      } else {
        small.push_back(names[j]);
      }
    }
    report_.add_figure(
        by_joint,
        fmt::format("The part along the force, and the contribution of each {}.{}", word(),
                    small.empty() ? "" : fmt::format(" Below {:g} %: {}.", 100 * kDrawnShare, joined(small))));
  }

  void reading() {
    report_.add_section("What the compliances rest on");
    std::vector<std::string> items;
    const std::string description = machine::description_of(map_.machine);
    if (!description.empty()) items.push_back(description + ".");
    if (compliant_) {
      items.push_back(
          fmt::format("C = J Cq Jᵀ: each {0} deflects in proportion to its load, everything else is rigid (links, "
                      "tool, workpiece, foundation).",
                      word()));
      items.emplace_back("Static and linear: no play, no friction, no vibration, no weight of the spindle.");
      const auto& provenance = machine::provenance_of(map_.machine);
      const auto source = provenance.find("compliance_rad_per_Nm");
      if (source != provenance.end())
        items.push_back(fmt::format("Compliances of the {}s: {}.", word(), source->second));
    }
    if (!map_.plane.of_positions()) {
      std::string follow;
      const machine::Task task = kinematics::task(map_.machine);
      for (int i = 0; i < 6; ++i) {
        const auto c = static_cast<machine::Coordinate>(i);
        if (!task.holds(c)) follow += fmt::format("{}{}", follow.empty() ? "" : ", ", machine::name_of(c));
      }
      if (!follow.empty()) {
        items.push_back(fmt::format("{} {} as the machine settles; the table of points (CSV) has the position.", follow,
                                    follow.size() == 1 ? "is" : "are"));
      }
    }
    items.emplace_back(
        "Each point is the first solution of the inverse kinematics that keeps all limits; points without one are "
        "blank.");
    items.emplace_back(
        "Colours are interpolated between the points of the grid; the table and the files hold the "
        "points themselves.");
    report_.add_list(items);
  }

  const ComplianceMap& map_;
  Figures figures_;
  bool compliant_;
  Report& report_;
};

}  // namespace

report::Figure map_picture(const ComplianceMap& map) {
  const Figures figures(map);
  report::PanelGrid grid;
  grid.title = fmt::format("Compliance of {} over {}", machine::name_of(map.machine), domain_of(map));
  const auto add = [&](const Panels& panels, const char* what) {
    for (const auto& [name, figure] : panels) grid.panels.emplace_back(fmt::format("{}, {}", name, what), figure);
  };
  if (map.measured) {
    for (const Kind kind : {Kind::direct, Kind::cross})
      for (auto& panel : measured_panels(map, kind)) grid.panels.push_back(std::move(panel));
  } else {
    add(figures.direct(), "direct compliance");
    add(figures.cross(), "cross compliance");
  }
  if (figures.determinant() != nullptr) grid.panels.emplace_back("|det J|", figures.determinant_heat());
  grid.columns = std::min<int>(3, static_cast<int>(grid.panels.size()));
  return grid;
}

std::string compliance_map_page(const ComplianceMap& map, const ComplianceMapPageOptions& options) {
  Report report("Compliance map of " + machine::name_of(map.machine),
                fmt::format("Deflection of the tool centre point (TCP, tool tip) per newton over {}, and "
                            "which {} contributes most",
                            shown_domain(map), statics::has_compliance(map.machine) ? column_word(map) : "joint"),
                facts_of(map, options.version));
  CompliancePart(report, map).add();
  if (!options.command.empty()) report.add_code("The command that made this page", options.command, false);
  return report.to_html();
}

Entries add_compliance_map(Report& report, const ComplianceMap& map) {
  CompliancePart(report, map).add(true);
  return facts_of(map, "");
}

}  // namespace polypod::pages
