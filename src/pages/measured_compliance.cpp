// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/measured_compliance.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compliance_figures.hpp"
#include "polypod/core/units.hpp"

namespace polypod::pages {
namespace {

using report::number;
using statics::MeasuredPoint;
using statics::Plane;
using units::to_um_per_N;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kInPlane = 0.5e-3;     // m
constexpr double kFewestSpan = 1e-3;    // m: points that spread less lie on a line
constexpr double kMoreThanNoise = 1.5;  // as Identification::symmetric judges
constexpr double kStandsOut = 0.25;     // of the map: more of it beyond two deviations is said in words
constexpr double kByChance = 0.1;       // of the map: twice what is beyond two deviations where the model is right
constexpr double kNoNoise = 0.01;       // of the difference: a ratio to less noise says nothing

double spread(const std::array<double, 2>& range) {
  return range[1] - range[0];
}

}  // namespace

MeasuredPlane measured_in(const std::vector<MeasuredPoint>& points, Plane plane, double at) {
  const statics::PlaneAxes axes = statics::axes_of(plane);
  MeasuredPlane out{plane, at, {}, {}};
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3& p = points[i].X_MT.p;
    if (std::abs(p[axes.normal] - at) > kInPlane) continue;
    for (const auto& [range, value] : {std::pair{&out.rectangle.u, p[axes.u]}, {&out.rectangle.v, p[axes.v]}}) {
      (*range)[0] = out.points.empty() ? value : std::min((*range)[0], value);
      (*range)[1] = out.points.empty() ? value : std::max((*range)[1], value);
    }
    out.points.push_back(i);
  }
  return out;
}

std::optional<MeasuredPlane> measured_plane(const std::vector<MeasuredPoint>& points) {
  if (points.empty()) return std::nullopt;
  for (const Plane plane : {Plane::xy, Plane::xz, Plane::yz}) {
    MeasuredPlane in = measured_in(points, plane, points.front().X_MT.p[statics::axes_of(plane).normal]);
    const statics::Rectangle& r = in.rectangle;
    if (spread(r.u) >= kFewestSpan && spread(r.v) >= kFewestSpan) return in;
  }
  return std::nullopt;
}

Result<MeasuredCompliance> measured_over(const ComplianceMap& map, const std::vector<MeasuredPoint>& points) {
  POLYPOD_ASSIGN(measured, statics::MeasuredMap::of(points));
  MeasuredCompliance out{std::move(measured), points.size(), files_of(points), true, {}, {}, {}, {}};
  const MeasuredPlane in = measured_in(points, map.plane, map.at);
  for (const std::size_t i : in.points) out.judged.push_back(points[i]);
  out.in_plane = !out.judged.empty();
  if (!out.in_plane) out.judged = points;
  POLYPOD_ASSIGN(compared, statics::compare(map.machine, out.map, out.judged));
  out.compared = std::move(compared);

  Mat3 apart = Mat3::Zero();
  int covered = 0, both = 0;
  for (const statics::MapPoint& point : map.map.points) {
    const bool covers = out.map.covers(point.p_M);
    out.values.push_back(covers ? out.map.at(point.p_M) : Mat3::Constant(kNone));
    out.deviations.push_back(covers ? out.map.deviation(point.p_M) : Mat3::Constant(kNone));
    covered += covers ? 1 : 0;
    if (!covers || !point.compliance.reachable) continue;
    ++both;
    const Mat3 difference = out.values.back() - point.compliance.linear();
    apart.array() += (difference.array().abs() > 2 * out.deviations.back().array()).cast<double>();
  }
  if (covered == 0) {
    const statics::PlaneGrid& grid = map.map.grid;
    return fail("AP148",
                fmt::format("the map lies beside the measured points: {}",
                            out.map.why_not(grid.origin + (grid.u + grid.v) / 2)),
                {}, "choose another --plane, --at or range, or leave them out");
  }
  if (both > 0) out.beyond = apart / both;
  return out;
}

bool explained(const MeasuredCompliance& m) {
  const statics::Compared& c = m.compared;
  const auto off = [&](const std::pair<int, int>& e) {
    return c.rms(e.first, e.second) > kMoreThanNoise * c.noise(e.first, e.second) &&
           m.beyond(e.first, e.second) > kByChance;
  };
  return m.doubts.empty() && c.rms_of_all <= kMoreThanNoise * c.noise_of_all &&
         std::none_of(statics::kEntryPlaces.begin(), statics::kEntryPlaces.end(), off);
}

std::string measured_verdict(const ComplianceMap& map, bool plain) {
  const statics::Compared& c = map.measured->compared;
  const std::string joints = statics::column_names(map.machine).front();
  std::string out =
      fmt::format("The {}s explain the measured compliances to {} {} rms, ", joints.substr(0, joints.find(' ')),
                  number(to_um_per_N(c.rms_of_all), 2), plain ? "um/N" : "µm/N");
  out += c.noise_of_all > kNoNoise * c.rms_of_all
             ? fmt::format("{} times the noise of the readings", number(c.rms_of_all / c.noise_of_all, 2))
             : std::string("far above the noise of the readings");
  const bool all = c.rms_of_all <= kMoreThanNoise * c.noise_of_all;
  if (!map.measured->doubts.empty()) {
    out += fmt::format(", but the readings are doubtful, so that nothing is judged: {}", map.measured->doubts.front());
  } else if (explained(*map.measured)) {
    out += ": no more than noise explains";
  } else if (!all) {
    out += ": more than noise; the differences show where something else deflects";
  } else {
    std::string which;
    for (const auto& [row, column] : statics::kEntryPlaces) {
      const double noise = c.noise(row, column);
      if (!(c.rms(row, column) > kMoreThanNoise * noise && map.measured->beyond(row, column) > kByChance)) continue;
      which += fmt::format("{}C{}{}{}, which is off by {}", which.empty() ? "" : ", ", plain ? "_" : "", "xyz"[row],
                           "xyz"[column],
                           noise > kNoNoise * c.rms(row, column)
                               ? fmt::format("{} times its noise", number(c.rms(row, column) / noise, 2))
                               : std::string("far more than its noise"));
    }
    out += fmt::format(
        "; all but {}, undecided: something else deflects there, or its noise is stated too small; more points would "
        "decide",
        which);
  }
  std::string apart;
  for (const auto& [row, column] : statics::kEntryPlaces) {
    const double share = map.measured->beyond(row, column);
    if (share < kStandsOut) continue;
    apart += fmt::format("{}C{}{}{} on {:.0f} % of it", apart.empty() ? "" : ", ", plain ? "_" : "", "xyz"[row],
                         "xyz"[column], 100 * share);
  }
  return apart.empty() ? out : out + "; beyond two deviations of the measured map: " + apart;
}

Panels measured_panels(const ComplianceMap& map, Field::Kind kind) {
  const MeasuredCompliance& m = *map.measured;
  const statics::PlaneAxes axes = statics::axes_of(map.plane);
  const std::vector<Field> fields = fields_of(map);
  struct Row {
    Field measured, computed, difference;
    std::vector<double> readings, off;  // at the judged points
  };
  std::vector<Row> rows;
  ColourScale differences;
  for (const Field& f : fields) {
    if (f.kind != kind) continue;
    Row row{f, f, f, {}, {}};
    for (const Field& g : fields)
      if (g.kind == Field::Kind::measured && g.row == f.row && g.column == f.column) row.measured = g;
    row.difference.name = "difference of " + f.name;
    for (std::size_t i = 0; i < f.values.size(); ++i)
      row.difference.values[i] = row.measured.values[i] - row.computed.values[i];
    for (std::size_t i = 0; m.in_plane && i < m.judged.size(); ++i) {
      row.readings.push_back(to_um_per_N(statics::measured_compliance(m.judged[i])(f.row, f.column)));
      row.off.push_back(to_um_per_N(m.compared.difference[i](f.row, f.column)));
    }
    differences.add(row.difference.values);
    differences.add(row.off);
    rows.push_back(std::move(row));
  }
  const auto dots = [&](report::HeatMap& heat, const std::vector<double>& values) {
    if (!m.in_plane) return;
    for (std::size_t i = 0; i < m.judged.size(); ++i) {
      const Vec3& p = m.judged[i].X_MT.p;
      heat.dots.push_back({{tidy_mm(p[axes.u]), tidy_mm(p[axes.v])}, values.empty() ? kNone : values[i]});
    }
  };
  Panels out;
  for (const Row& row : rows) {
    ColourScale scale;
    for (const auto* values : {&row.measured.values, &row.computed.values, &row.readings}) scale.add(*values);
    const bool signs = scale.low < 0 && scale.high > 0;
    const auto add = [&](const Field& f, const ColourScale& colours, bool round_zero, const std::vector<double>& at,
                         const char* what) {
      report::HeatMap heat = heat_of(map, f);
      colours.set(heat, round_zero);
      heat.contour_labels = false;  // the dots would stand on them
      heat.levels = 8;
      dots(heat, at);
      out.emplace_back(fmt::format("{} {}", symbol(f), what), heat);
    };
    add(row.measured, scale, signs, row.readings, "measured");
    add(row.computed, scale, signs, {}, "computed");
    add(row.difference, differences, true, row.off, "measured − computed");
  }
  return out;
}

void add_measured(report::Report& page, const ComplianceMap& map, bool with_cross) {
  const MeasuredCompliance& m = *map.measured;
  const statics::Compared& c = m.compared;
  const statics::PlaneAxes axes = statics::axes_of(map.plane);
  report::Table table;
  table.caption = fmt::format(
      "Measured less computed at the {} measured points{}, µm/N. Noise: of one reading, as estimated from the scatter "
      "of the readings. Deviation: how sure the interpolated map is (one standard deviation); by chance alone "
      "measured and computed map are apart by two of them on about 5 % of the map.",
      m.judged.size(), m.in_plane ? " of the plane" : ", none of which lies in the plane");
  table.columns = {
      {"", ""},          {"rms", ""},
      {"largest", ""},   {m.in_plane ? fmt::format("at {}, {}", "xyz"[axes.u], "xyz"[axes.v]) : "at x, y, z", "mm"},
      {"noise", ""},     {"rms over noise", "×", 1},
      {"deviation", ""}, {"apart by 2 deviations", "% of the map", 0}};
  for (const Field& f : fields_of(map)) {
    if (f.kind != Field::Kind::direct && f.kind != Field::Kind::cross) continue;
    const std::size_t worst = c.worst[static_cast<std::size_t>(f.row)][static_cast<std::size_t>(f.column)];
    const Vec3& p = m.judged[worst].X_MT.p;
    std::string place;
    for (int axis = 0; axis < 3; ++axis) {
      if (m.in_plane && axis == axes.normal) continue;
      place += (place.empty() ? "" : ",\u00a0") + given(tidy_mm(p[axis]));
    }
    const auto um = [&](const Mat3& C) { return to_um_per_N(C(f.row, f.column)); };
    const double rms = um(c.rms), noise = um(c.noise);
    table.rows.push_back({symbol(f), rms, um(c.difference[worst]), place, noise,
                          noise > kNoNoise * rms ? report::Cell(rms / noise) : report::Cell(std::string("–")),
                          um(c.deviation), 100 * m.beyond(f.row, f.column)});
  }
  page.add_table(table);
  const std::string dots =
      m.in_plane ? " Dots: the measured points, on the left with the colour of the reading itself, on the right with "
                   "that of the reading less the computed value: where a dot stands out, the reading is off the field."
                 : "";
  page.add_figure_grid(
      3, measured_panels(map, Field::Kind::direct),
      "Direct compliances: interpolated from the readings alone, computed from the joints, and the first less the "
      "second. Measured and computed share one scale of colours; the differences have theirs, blue where the machine "
      "is stiffer than computed, red where it deflects more." +
          dots);
  if (!with_cross) return;
  page.add_figure_grid(
      3, measured_panels(map, Field::Kind::cross),
      "Cross compliances, likewise. Entries of both signs are blue where the tip moves against the axis, red "
      "where it moves along it.");
}

}  // namespace polypod::pages
