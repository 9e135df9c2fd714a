// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/certificate.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "polypod/core/units.hpp"
#include "polypod/report/plot.hpp"

namespace polypod::pages {
namespace {

using calibration::Calibration;
using calibration::kCoverageFactor;
using calibration::Kind;
using calibration::Measurement;
using report::escape;
using report::fixed;
using report::number;
using units::to_deg;
using units::to_mm;
using units::to_um;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

constexpr std::string_view kCss = R"(*{box-sizing:border-box}
html{background:#e9e9e6;-webkit-text-size-adjust:100%}
body{margin:0;color:#16181b;font:9.8pt/1.38 "Liberation Serif","Times New Roman",Georgia,serif}
main{background:#fff;max-width:210mm;margin:8mm auto;padding:16mm 16mm 14mm;box-shadow:0 1px 6px rgba(0,0,0,.25)}
header{border-bottom:2.5pt double #16181b;padding-bottom:4mm;margin-bottom:5mm;display:flex;justify-content:space-between;gap:8mm;align-items:flex-end}
h1{font-size:22pt;line-height:1.1;margin:0;font-weight:600;letter-spacing:.01em}
header p{margin:.6mm 0 0;color:#4b5058;font-size:10.5pt}
.no{text-align:right;white-space:nowrap;font-size:10pt;line-height:1.6}
h2{font-size:12pt;margin:5.2mm 0 1.6mm;padding-bottom:.8mm;border-bottom:.6pt solid #16181b;break-after:avoid}
h3{font-size:10.5pt;margin:3.5mm 0 1mm;break-after:avoid}
p{margin:1.6mm 0;orphans:3;widows:3} ul{margin:1.4mm 0;padding-left:5mm} li{margin:.5mm 0}
.pair{display:grid;grid-template-columns:1fr 1fr;gap:1mm 9mm}
dl{margin:0} dl>div{display:grid;grid-template-columns:34mm 1fr;gap:3mm;padding:.7mm 0;border-bottom:.4pt solid #d6d6d2;break-inside:avoid}
dt{color:#4b5058} dd{margin:0;overflow-wrap:anywhere;min-height:1.42em}
.open{display:block;width:100%;min-height:1.42em;border-bottom:.6pt dotted #16181b}
span.open{display:inline-block;width:34mm;vertical-align:baseline}
.result{border:.8pt solid #16181b;padding:2.4mm 3.4mm;margin:2mm 0;break-inside:avoid}
table{border-collapse:collapse;width:100%;font-size:8.6pt;font-variant-numeric:tabular-nums;margin:2mm 0}
caption{text-align:left;color:#4b5058;font-size:9pt;padding-bottom:1mm}
th{font-weight:600;text-align:left;vertical-align:bottom;padding:.7mm 1.4mm;border-bottom:.8pt solid #16181b}
th.g{text-align:center;border-bottom:.4pt solid #8a8f96} th small{font-weight:400;color:#4b5058}
td{padding:.6mm 1.4mm;border-bottom:.4pt solid #d6d6d2;vertical-align:top}
.r{text-align:right;white-space:nowrap} th:first-child,td:first-child{padding-left:0}
tr.sum td{border-top:.8pt solid #16181b;border-bottom:0;font-weight:600} tr{break-inside:avoid} thead{display:table-header-group}
.scroll{overflow-x:auto;break-inside:avoid} .gum table{font-size:8.2pt} .gum th,.gum td{padding-left:.9mm;padding-right:.9mm}
td.hash{width:104mm} td.role{width:30mm} .hash{font:7pt/1.5 "Liberation Mono","DejaVu Sans Mono",monospace;overflow-wrap:anywhere}
figure{margin:2.5mm 0;break-inside:avoid} figcaption,.note{color:#4b5058;font-size:9pt}
figure svg{max-width:100%;height:auto;display:block}
.sign{display:grid;grid-template-columns:1fr 1fr 1fr;gap:10mm;margin-top:13mm;break-inside:avoid}
.sign div{border-top:.6pt solid #16181b;padding-top:1mm;color:#4b5058;font-size:9pt}
footer{margin-top:7mm;padding-top:2mm;border-top:.6pt solid #16181b;color:#4b5058;font-size:8.6pt;break-inside:avoid}
@media (max-width:700px){main{margin:0;padding:6mm 5mm;box-shadow:none} .pair,.sign{grid-template-columns:1fr} .sign{gap:14mm} header{display:block} .no{text-align:left;margin-top:3mm}}
@media print{
@page{size:A4;margin:15mm 15mm 17mm}
html{background:#fff} main{max-width:none;margin:0;padding:0;box-shadow:none} .scroll{overflow:visible}
*{-webkit-print-color-adjust:exact;print-color-adjust:exact}
}
)";

/// HTML under construction; all text is escaped where it enters.
class Sheet {
 public:
  void section(const std::string& title) { body_ += fmt::format("<h2>{}&ensp;{}</h2>\n", ++sections_, escape(title)); }
  void heading(const std::string& title) { body_ += fmt::format("<h3>{}</h3>\n", escape(title)); }
  void text(const std::string& words) { body_ += fmt::format("<p>{}</p>\n", escape(words)); }
  void note(const std::string& words) { body_ += fmt::format("<p class=\"note\">{}</p>\n", escape(words)); }
  void list(const std::vector<std::string>& items) {
    body_ += "<ul>\n";
    for (const std::string& item : items) body_ += fmt::format("<li>{}</li>\n", escape(item));
    body_ += "</ul>\n";
  }
  void raw(const std::string& html) { body_ += html; }
  [[nodiscard]] const std::string& body() const { return body_; }

 private:
  std::string body_;
  int sections_ = 0;
};

/// The value, or a line to write on.
std::string field(const std::string& value) {
  return value.empty() ? "<span class=\"open\"></span>" : escape(value);
}

using Fields = std::vector<std::pair<std::string, std::string>>;
/// One name and value a line; an empty value is a line to write on.
std::string fields_html(const Fields& fields) {
  std::string out = "<dl>\n";
  for (const auto& [name, value] : fields)
    out +=
        fmt::format("<div><dt>{}</dt><dd>{}</dd></div>\n", escape(name),
                    value.empty() ? std::string("<span class=\"open\" style=\"width:100%\"></span>") : escape(value));
  return out + "</dl>\n";
}

struct Head {
  std::string title, unit;
  bool right = true;
};
/// Cells are text already; `sums`: so many rows at the end are sums.
std::string table_html(const std::string& caption, const std::vector<Head>& heads,
                       const std::vector<std::vector<std::string>>& rows, std::size_t sums = 0,
                       const std::string& groups = {}) {
  std::string out = "<div class=\"scroll\"><table>\n";
  if (!caption.empty()) out += fmt::format("<caption>{}</caption>\n", escape(caption));
  out += "<thead>" + groups + "<tr>";
  for (const Head& head : heads)
    out += fmt::format("<th{}>{}{}</th>", head.right ? " class=\"r\"" : "", escape(head.title),
                       head.unit.empty() ? "" : fmt::format("<br><small>{}</small>", escape(head.unit)));
  out += "</tr></thead>\n<tbody>\n";
  for (std::size_t i = 0; i < rows.size(); ++i) {
    out += i + sums >= rows.size() ? "<tr class=\"sum\">" : "<tr>";
    // A shorter row begins with a cell over several columns.
    const std::size_t wide = rows[i].empty() || rows[i].size() > heads.size() ? 1 : heads.size() - rows[i].size() + 1;
    for (std::size_t k = 0; k < rows[i].size(); ++k) {
      const std::size_t column = k == 0 ? 0 : k + wide - 1;
      out += fmt::format("<td{}{}>{}</td>", column < heads.size() && heads[column].right ? " class=\"r\"" : "",
                         k == 0 && wide > 1 ? fmt::format(" colspan=\"{}\"", wide) : "", escape(rows[i][k]));
    }
    out += "</tr>\n";
  }
  return out + "</tbody></table></div>\n";
}

/// A coordinate of the pose as the certificate shows it; its uncertainty in µm or thousandths of a degree.
struct Shown {
  std::string letter, unit, place_unit;
  double scale = 1, place_scale = 1;
  bool angle = false;
};
Shown shown(const std::string& coordinate) {
  const bool angle = coordinate.ends_with("_deg");
  const char c = coordinate.front();
  return {std::string(1, angle ? static_cast<char>(c - 'a' + 'A') : c),
          angle ? "0.001°" : "µm",
          angle ? "deg" : "mm",
          angle ? 1000 * to_deg(1) : to_um(1),
          angle ? to_deg(1) : to_mm(1),
          angle};
}

/// Decimals that show a tenth of the two digits of this value that hold, three at most.
int decimals_of(double combined) {
  return combined > 0 ? std::clamp(2 - static_cast<int>(std::floor(std::log10(combined))), 0, 3) : 3;
}

/// "um/m" as a printed page writes it.
std::string printed(const std::string& unit) {
  return unit.starts_with("um") ? "µ" + unit.substr(1) : unit;
}

/// "x 12.3 mm, y -45.6 mm, A 1.20 deg".
std::string pose_in_words(const machine::AnyMachine& machine, const Pose& X) {
  const std::vector<double> c = kinematics::coordinates_of(kinematics::task(machine), X);
  const std::vector<std::string> names = calibration::pose_coordinates(machine);
  std::string out;
  for (std::size_t i = 0; i < names.size() && i < c.size(); ++i) {
    const Shown s = shown(names[i]);
    out += fmt::format("{}{} {} {}", i == 0 ? "" : ", ", s.letter, fixed(s.place_scale * c[i], s.angle ? 2 : 1),
                       s.place_unit);
  }
  return out;
}

std::string temperature_in_words(const calibration::Statement& s, const std::vector<Measurement>& rows) {
  if (s.temperature_mean || s.temperature_min || s.temperature_max) {
    std::string out = s.temperature_mean ? fmt::format("{} °C", fixed(*s.temperature_mean, 1)) : "";
    if (s.temperature_min && s.temperature_max)
      out += fmt::format("{}{} to {} °C", out.empty() ? "" : ", from ", fixed(*s.temperature_min, 1),
                         fixed(*s.temperature_max, 1));
    return out;
  }
  double low = 1e300, high = -1e300;
  for (const Measurement& row : rows) {
    if (!std::isfinite(row.temperature)) continue;
    low = std::min(low, row.temperature);
    high = std::max(high, row.temperature);
  }
  return low > high ? "" : fmt::format("{} to {} °C (column temperature_C)", fixed(low, 1), fixed(high, 1));
}

void add_who(Sheet& sheet, const machine::AnyMachine& machine, const std::vector<Measurement>& rows,
             const Certificate& c) {
  const calibration::Statement& s = c.statement;
  sheet.section("Object, instrument and conditions");
  sheet.raw("<div class=\"pair\"><div>");
  sheet.raw(fields_html({{"Machine", machine::name_of(machine)},
                         {"Kind", machine::family_of(machine)},
                         {"Manufacturer", s.machine_manufacturer},
                         {"Type", s.machine_type},
                         {"Serial number", s.machine_serial},
                         {"Controller", s.controller},
                         {"Customer", s.customer}}));
  sheet.raw("</div><div>");
  sheet.raw(fields_html({{"Instrument", s.instrument_name},
                         {"Serial number", s.instrument_serial},
                         {"Traceability", s.traceability},
                         {"Temperature", temperature_in_words(s, rows)},
                         {"Place", s.place},
                         {"Operator", s.operator_name},
                         {"Date", s.date}}));
  sheet.raw("</div></div>\n");
}

void add_method(Sheet& sheet, const std::vector<Measurement>& rows, const Calibration& r, const Certificate& c) {
  sheet.section("Method");
  std::map<std::string, std::size_t> kinds;
  for (const Measurement& row : rows) ++kinds[calibration::name_of(row.kind)];
  std::vector<std::string> what;
  for (const auto& [kind, count] : kinds) what.push_back(fmt::format("{} {}", count, kind));
  const auto given = [](bool estimated) { return estimated ? "found with the parameters" : "as given"; };
  sheet.text(fmt::format(
      "The geometric parameters of the machine were found from {} by least squares with a robust loss ({}), each "
      "with its stated or usual deviation from the drawing as prior knowledge; {} of {} unknowns are identifiable from "
      "the readings. "
      "Frame of the instrument: {}. Place of the target on the tool: {}. Scale of the instrument: {}.",
      fmt::join(what, " and "),
      c.options.loss == calibration::Loss::cauchy || r.pulled_aside ? "Cauchy"
      : c.options.loss == calibration::Loss::none                   ? "none: plain squares"
                                                                    : "Huber",
      r.told, r.unknowns, given(c.options.estimate_frame), given(c.options.estimate_target),
      given(c.options.estimate_scale)));
  const std::size_t outliers = r.fitted.outliers;
  sheet.text(fmt::format(
      "Standard uncertainty of a single reading of a coordinate: {} µm {}; the residuals show {} times that. {} "
      "equations, {} degrees of freedom, chi-square {}. {}",
      number(to_um(c.options.noise_position)), c.noise_stated ? "as stated" : "(taken, none was stated)",
      fixed(r.noise_factor, 2), r.equations, fixed(r.free_equations, 1), fixed(r.chi_square, 1),
      outliers == 0 ? std::string("No row is an outlier.")
                    : fmt::format("{} {} marked as {} and weighted down, not dropped.", outliers,
                                  outliers == 1 ? "row is" : "rows are", outliers == 1 ? "an outlier" : "outliers")));
}

void add_result(Sheet& sheet, const Calibration& r, const Certificate& c) {
  sheet.section("Result");
  sheet.raw(fmt::format("<div class=\"result\">{}</div>\n", escape(r.verdict.text)));
  std::vector<std::vector<std::string>> rows;
  for (const auto& [name, s] :
       {std::pair{"all fitted rows", r.fitted}, {"validation set, in a fit of the other rows", r.held_back}}) {
    if (s.rows == 0) continue;
    rows.push_back({name, std::to_string(s.rows), fixed(to_um(s.rms_before), 1), fixed(to_um(s.rms_after), 1),
                    fixed(to_um(s.max_after), 1)});
  }
  sheet.raw(table_html(
      "Residuals, root mean square of single readings; outliers aside",
      {{"", "", false}, {"rows", ""}, {"drawing", "µm"}, {"calibrated", "µm"}, {"largest after", "µm"}}, rows));
  const std::vector<std::string>& names = c.region.coordinates;
  const calibration::Verdict& v = r.verdict;
  if (v.answer == calibration::Answer::no) {
    sheet.text(
        "The machine stays as in its drawing: no machine file was written, and no uncertainty of a calibrated machine "
        "is "
        "stated.");
    return;
  }
  rows.clear();
  for (std::size_t i = 0; i < names.size(); ++i) {
    const Shown s = shown(names[i]);
    const auto k = static_cast<Eigen::Index>(i);
    const auto U = [&](const Eigen::VectorXd& u) { return number(kCoverageFactor * s.scale * u[k], 2); };
    const bool open = std::find(v.left_open.begin(), v.left_open.end(), names[i]) != v.left_open.end();
    rows.push_back({fmt::format("{}, {}", s.letter, s.unit), U(v.before.mean), U(v.after.mean), U(v.after.max),
                    U(v.after_readings.mean),
                    c.budget && c.budget->degrees[k] > 0 && c.budget->degrees[k] < 1e4 ? fixed(c.budget->degrees[k], 0)
                                                                                       : std::string("> 10 000"),
                    open ? "hardly" : "yes"});
  }
  sheet.raw(table_html(
      fmt::format("Expanded uncertainty U (k = 2) of the pose of the tool, over {} poses of the workspace", v.poses),
      {{"", "", false},
       {"drawing", "mean"},
       {"calibrated", "mean"},
       {"calibrated", "largest"},
       {"readings alone", "mean"},
       {"ν", "effective"},
       {"determined", "", false}},
      rows));
  sheet.note(
      "The expanded uncertainty is the standard uncertainty times the coverage factor k = 2, which for a normal "
      "distribution corresponds to a coverage probability of about 95 %. Readings alone: without the systematic parts "
      "of "
      "section 4. ν: degrees of freedom of Welch and Satterthwaite at the pose of section 4. Hardly determined: more "
      "than a fifth of the standard deviation of the drawing is left.");
  constexpr double kFar = 2.2;  // from 12 degrees of freedom on k = 2 covers 93 % and more
  if (c.budget && c.budget->k95.maxCoeff() > kFar) {
    sheet.note(
        fmt::format("With so few degrees of freedom k = 2 covers less than 95 %: for that a factor of up to {:.1f} "
                    "belongs to the smallest ν (Student's t, GUM G.4).",
                    c.budget->k95.maxCoeff()));
  }
}

void add_budget(Sheet& sheet, const machine::AnyMachine& machine, const Certificate& c) {
  sheet.section("Uncertainty budget");
  if (!c.budget) {
    sheet.text("No pose of the workspace was found at which a budget could stand.");
    return;
  }
  const calibration::Budget& b = *c.budget;
  sheet.text(
      fmt::format("At the pose where the uncertainty of the place of the tool is largest among the poses judged within "
                  "the region of "
                  "validity: {}. Contributions add in squares (GUM 5.1.2).",
                  pose_in_words(machine, b.stand.X_MT)));
  for (const bool angles : {false, true}) {
    std::vector<Eigen::Index> columns;
    for (std::size_t i = 0; i < b.coordinates.size(); ++i)
      if (shown(b.coordinates[i]).angle == angles) columns.push_back(static_cast<Eigen::Index>(i));
    if (columns.empty()) continue;
    std::vector<Head> heads{{"quantity", "", false},
                            {"type", "", false},
                            {"distribution", "", false},
                            {"size", ""},
                            {"divisor", ""},
                            {"u", ""}};
    const auto of = [&](Eigen::Index k) { return shown(b.coordinates[static_cast<std::size_t>(k)]); };
    for (int twice = 0; twice < 2; ++twice)
      for (const Eigen::Index k : columns) heads.push_back({of(k).letter, ""});
    std::vector<std::vector<std::string>> rows;
    for (const calibration::BudgetRow& row : b.rows) {
      const bool single = row.sensitivity.size() > 0;
      std::vector<std::string> cells{row.quantity, std::string(1, row.type), row.distribution};
      if (single) {
        cells.insert(cells.end(), {number(row.size) + " " + printed(row.unit), fixed(row.divisor, 2),
                                   number(row.size / row.divisor) + " " + printed(row.unit)});
      } else {
        cells.insert(cells.end(), {"", "", ""});
      }
      for (const Eigen::Index k : columns) {
        constexpr double kNothing = 5e-4;  // of the combined uncertainty
        const bool felt = single && row.contribution[k] > kNothing * b.combined[k];
        cells.push_back(!single ? "" : felt ? number(of(k).scale * row.sensitivity[k], 2) : "≈ 0");
      }
      for (const Eigen::Index k : columns)
        cells.push_back(fixed(of(k).scale * row.contribution[k], decimals_of(of(k).scale * b.combined[k])));
      rows.push_back(std::move(cells));
    }
    const auto sum = [&](const std::string& name, const auto& value) {
      std::vector<std::string> cells{name};
      for (const Eigen::Index k : columns) cells.push_back(value(k));
      rows.push_back(std::move(cells));
    };
    sum("combined standard uncertainty",
        [&](Eigen::Index k) { return fixed(of(k).scale * b.combined[k], decimals_of(of(k).scale * b.combined[k])); });
    sum("expanded uncertainty U (k = 2)",
        [&](Eigen::Index k) { return number(kCoverageFactor * of(k).scale * b.combined[k], 2); });
    const std::string unit = of(columns.front()).unit;
    const std::string groups = fmt::format(
        "<tr><th colspan=\"6\"></th><th class=\"g\" colspan=\"{0}\">sensitivity, {1} per unit</th><th class=\"g\" "
        "colspan=\"{0}\">contribution, {1}</th></tr>",
        columns.size(), unit);
    sheet.raw(
        "<div class=\"gum\">" +
        table_html(angles ? "Angles of the tool (small turns)" : "Place of the tool tip", heads, rows, 2, groups) +
        "</div>\n");
  }
  std::vector<std::string> sources;
  for (const calibration::Systematic& part : c.options.systematic)
    if (!part.source.empty())
      sources.push_back(fmt::format("{}: {}", calibration::name_of(part.quantity), part.source));
  if (!sources.empty()) {
    sheet.heading("Where the sizes of the systematic parts are from");
    sheet.list(sources);
  }
  if (c.options.systematic.empty())
    sheet.note(
        "No systematic part of the instrument (scale, offset, target, temperature) was stated: the budget holds the "
        "scatter of the readings and the uncertainty that the drawing leaves, and no type B of the instrument.");
}

/// U (k = 2) of the tip in the direction in which it is largest, µm, over a level plane of the box; NaN out of reach.
report::HeatMap map_at(const machine::AnyMachine& machine, const Calibration& r, const Eigen::AlignedBox3d& box,
                       const Mat3& R, double z) {
  constexpr int kPoints = 41;
  const Vec3 size = box.sizes();
  const double step = std::max(size.x(), size.y()) / (kPoints - 1);
  report::HeatMap map;
  map.columns = std::max(2, 1 + static_cast<int>(std::lround(size.x() / step)));
  map.rows = std::max(2, 1 + static_cast<int>(std::lround(size.y() / step)));
  map.x = {"x", "mm", to_mm(box.min().x()), to_mm(box.max().x()), false};
  map.y = {"y", "mm", to_mm(box.min().y()), to_mm(box.max().y()), false};
  map.label = "U";
  map.unit = "µm";
  map.contour_labels = false;
  for (int j = 0; j < map.rows; ++j) {
    for (int i = 0; i < map.columns; ++i) {
      const Vec3 p(box.min().x() + size.x() * i / (map.columns - 1), box.min().y() + size.y() * j / (map.rows - 1), z);
      const kinematics::InverseResult inverse = kinematics::inverse(machine, Pose{R, p});
      const kinematics::Solution* s = inverse.reachable();
      map.values.push_back(s == nullptr
                               ? kNone
                               : to_um(kCoverageFactor * calibration::largest_deviation(calibration::tip_covariance(
                                                             machine, Pose{R, p}, s->joints, r.covariance))));
    }
  }
  return map;
}

void add_map(Sheet& sheet, const machine::AnyMachine& machine, const Calibration& r, const Certificate& c) {
  sheet.section("Uncertainty of the tool tip over the workspace");
  const std::vector<calibration::Stand> stands =
      calibration::random_stands(machine, calibration::kJudgedPoses, calibration::kJudgedSeed);
  Eigen::AlignedBox3d box;
  for (const calibration::Stand& stand : stands) box.extend(stand.X_MT.p);
  if (stands.empty() || !kinematics::task(machine).places() || !(box.sizes().head<2>().minCoeff() > 0)) {
    sheet.text("This machine has no level plane of places over which a map could be drawn.");
    return;
  }
  const auto near_middle = std::min_element(stands.begin(), stands.end(), [&](const auto& a, const auto& b) {
    return (a.X_MT.p - box.center()).norm() < (b.X_MT.p - box.center()).norm();
  });
  const bool upright = kinematics::inverse(machine, Pose{Mat3::Identity(), box.center()}).reachable() != nullptr;
  const Mat3 R = upright ? Mat3(Mat3::Identity()) : near_middle->X_MT.R;
  std::vector<report::HeatMap> maps;
  std::vector<double> levels;
  double least = 1e300, most = 0;
  for (const double share : {0.25, 0.5, 0.75}) {
    const double z = box.min().z() + share * box.sizes().z();
    if (!levels.empty() && z == levels.back()) continue;
    report::HeatMap map = map_at(r.machine, r, box, R, z);
    bool any = false;
    for (const double value : map.values) {
      if (!std::isfinite(value)) continue;
      any = true;
      least = std::min(least, value);
      most = std::max(most, value);
    }
    if (!any) continue;
    const Eigen::AlignedBox3d& seen = c.region.box;
    if (!seen.isEmpty() && z >= seen.min().z() && z <= seen.max().z()) {
      const double x0 = to_mm(seen.min().x()), x1 = to_mm(seen.max().x()), y0 = to_mm(seen.min().y()),
                   y1 = to_mm(seen.max().y());
      map.lines.push_back({"",
                           {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}, {x0, y0}},
                           report::Colour::ink,
                           report::LineStyle::dashed,
                           1.2});
    }
    maps.push_back(std::move(map));
    levels.push_back(z);
  }
  if (maps.empty()) {
    sheet.text("No pose of the levels looked at is within reach.");
    return;
  }
  report::PanelGrid grid;
  grid.title = "U (k = 2) of the tool tip over three levels";
  grid.columns = static_cast<int>(maps.size());
  for (std::size_t i = 0; i < maps.size(); ++i) {
    maps[i].min = least;
    maps[i].max = most;
    grid.panels.emplace_back(fmt::format("z = {} mm", fixed(to_mm(levels[i]), 0)), maps[i]);
  }
  std::string svg = report::standalone_svg(grid, 690);
  // The sheet is white by day and night.
  const std::size_t dark = svg.find("@media (prefers-color-scheme:dark)");
  const std::size_t end = dark == std::string::npos ? dark : svg.find("}}", dark);
  if (end != std::string::npos) svg.erase(dark, end + 2 - dark);
  sheet.raw("<figure>" + svg);
  sheet.raw(fmt::format(
      "<figcaption>{}</figcaption></figure>\n",
      escape(fmt::format(
          "U (k = 2) of the place of the tool tip in µm, in the direction in which it is largest, the tool "
          "{}. Blank: out of reach. Dashed: box of the measured poses, beyond which the figure rests on the "
          "model alone.",
          upright ? "at zero tilt" : "turned as near the middle of the workspace"))));
}

/// `good`: there are figures that can be valid.
void add_region(Sheet& sheet, const std::vector<Measurement>& rows, const Certificate& c, bool good) {
  sheet.section(good ? "Region of validity" : "What was measured");
  std::vector<std::vector<std::string>> cells;
  for (std::size_t i = 0; i < c.region.coordinates.size(); ++i) {
    if (c.region.low.size() == 0) break;
    const Shown s = shown(c.region.coordinates[i]);
    const auto k = static_cast<Eigen::Index>(i);
    cells.push_back({fmt::format("{}, {}", s.letter, s.place_unit),
                     fixed(s.place_scale * c.region.low[k], s.angle ? 2 : 1),
                     fixed(s.place_scale * c.region.high[k], s.angle ? 2 : 1)});
  }
  sheet.raw(table_html("Poses that were measured", {{"coordinate", "", false}, {"from", ""}, {"to", ""}}, cells));
  const std::string temperature = temperature_in_words(c.statement, rows);
  sheet.raw("<div class=\"pair\"><div>" + fields_html({{"Temperature", temperature}, {"Load on the tool", ""}}) +
            "</div><div>" +
            (good ? fields_html({{"Speed of approach", ""}, {"Valid until", ""}})
                  : fields_html({{"Speed of approach", ""}})) +
            "</div></div>\n");
  if (!good) return;
  sheet.text(
      "The figures hold for the machine as it was on the day of the measurement, in this region. A collision, "
      "a repair, a changed tool or another temperature end their validity.");
}

void add_standards(Sheet& sheet, const Certificate& c) {
  sheet.section("Figures as ISO 9283, ISO 230-2 and ISO 10360-2 define them");
  sheet.text(
      "No conformity with these standards is claimed: the figures below are computed by their definitions from "
      "the readings that are there.");
  sheet.heading("Pose accuracy AP and pose repeatability RP (ISO 9283)");
  if (c.poses.empty()) {
    sheet.text(
        fmt::format("The readings do not have this form: no pose was attained {} times and more with its place "
                    "measured.",
                    calibration::kLeastCycles));
  } else {
    const bool angles = std::any_of(c.poses.begin(), c.poses.end(), [](const auto& p) { return p.angles; });
    std::vector<Head> heads{{"pose", ""},          {"cycles", ""},           {"x", "mm"}, {"y", "mm"}, {"z", "mm"},
                            {"AP", "drawing, mm"}, {"AP", "calibrated, mm"}, {"RP", "mm"}};
    if (angles) heads.insert(heads.end(), {{"AP angle", "drawing, deg"}, {"RP angle", "deg"}});
    std::vector<std::vector<std::string>> rows;
    std::size_t least = c.poses.front().cycles;
    constexpr std::size_t kShown = 30;
    for (std::size_t i = 0; i < c.poses.size(); ++i) {
      const calibration::PoseAccuracy& p = c.poses[i];
      least = std::min(least, p.cycles);
      if (i >= kShown) continue;
      rows.push_back({std::to_string(i + 1), std::to_string(p.cycles), fixed(to_mm(p.command.x()), 1),
                      fixed(to_mm(p.command.y()), 1), fixed(to_mm(p.command.z()), 1), fixed(to_mm(p.accuracy), 4),
                      fixed(to_mm(p.accuracy_after), 4), fixed(to_mm(p.repeatability), 4)});
      if (angles)
        rows.back().insert(rows.back().end(), {p.angles ? fixed(to_deg(p.angle_accuracy), 5) : "",
                                               p.angles ? fixed(to_deg(p.angle_repeatability), 5) : ""});
    }
    sheet.raw(table_html(c.poses.size() > kShown
                             ? fmt::format("The first {} of {} poses", kShown, c.poses.size())
                             : "Poses attained again and again; the command is that of the drawing at the joints read",
                         heads, rows));
    sheet.note(fmt::format(
        "{} ISO 9283 asks for {} cycles, full load and full speed, and five poses of its test cube; load, speed and "
        "direction of approach were not judged here.",
        least < calibration::kCyclesOfIso9283 ? fmt::format("From {} cycles and more.", least) : std::string(),
        calibration::kCyclesOfIso9283));
  }
  sheet.heading("Deviation of lengths (ISO 10360-2) and of positions along lines (ISO 230-2)");
  if (!c.lengths && c.lines.empty()) {
    sheet.text(
        "The readings do not have this form: there are neither distances nor runs of five points along a straight "
        "line.");
    return;
  }
  if (c.lengths) {
    const calibration::LengthErrors& l = *c.lengths;
    sheet.text(fmt::format(
        "{} distances from {} to {} mm (ball-bar). Largest deviation of a length E: {} mm with the drawing, {} mm "
        "calibrated. ISO 10360-2 asks for five calibrated lengths in seven directions, each three times.",
        l.lengths, fixed(to_mm(l.shortest), 1), fixed(to_mm(l.longest), 1), fixed(to_mm(l.error_before), 4),
        fixed(to_mm(l.error_after), 4)));
  }
  std::vector<std::vector<std::string>> rows;
  for (std::size_t i = 0; i < c.lines.size(); ++i) {
    const calibration::LineErrors& l = c.lines[i];
    const auto at = [](const Vec3& p) {
      return fmt::format("({}, {}, {})", fixed(to_mm(p.x()), 1), fixed(to_mm(p.y()), 1), fixed(to_mm(p.z()), 1));
    };
    rows.push_back({std::to_string(i + 1), std::to_string(l.points), at(l.from), at(l.to),
                    fixed(to_mm(l.error_before), 4), fixed(to_mm(l.error_after), 4)});
  }
  if (!rows.empty()) {
    sheet.raw(table_html("Range E of the mean positional deviations along a line, one direction of approach",
                         {{"line", ""},
                          {"points", ""},
                          {"from", "mm", false},
                          {"to", "mm", false},
                          {"E", "drawing, mm"},
                          {"E", "calibrated, mm"}},
                         rows));
    sheet.note("ISO 230-2 asks for five runs from each side; the direction of approach was not judged here.");
  }
}

void add_data(Sheet& sheet, const Calibration& r, const Certificate& c) {
  sheet.section("Data, model and assumptions");
  std::string out = "<div class=\"scroll\"><table><caption>Files, with the SHA-256 of their bytes</caption>\n<tbody>\n";
  for (const HashedFile& file : c.files)
    out += fmt::format("<tr><td class=\"role\">{}</td><td>{}</td><td class=\"hash\">{}</td></tr>\n", escape(file.role),
                       escape(file.name), file.sha256.empty() ? "not known" : escape(file.sha256));
  sheet.raw(out + "</tbody></table></div>\n");
  std::vector<std::string> assumptions{
      "The closure of the machine with the parameters listed in its file is all that is wrong with its geometry: "
      "deflection under load, wear and backlash are no parameters.",
      "Readings scatter independently and normally; repeats at one pose share what the model does not know of it.",
      "Parameters were off the drawing by the prior standard deviations, normally and independently.",
      "Systematic parts are independent of each other and constant through the measurement. They are propagated, not "
      "fitted."};
  if (r.drift.looked)
    assumptions.push_back(r.drift.found ? "The residuals drift, which the uncertainties do not contain."
                                        : "No drift of the residuals was found.");
  if (!r.tried.empty())
    assumptions.push_back(
        r.tried.front().likely
            ? fmt::format("A common error ({}) explains the readings better than the machine does.",
                          r.tried.front().what)
            : "Common errors of frame, target or scale that were not looked for were tried in place of "
              "the machine's; none explains the readings better.");
  sheet.list(assumptions);
  if (!c.command.empty()) sheet.raw(fmt::format("<p class=\"hash\">{}</p>\n", escape(c.command)));
}

}  // namespace

std::string certificate_page(const machine::AnyMachine& nominal, const std::vector<Measurement>& rows,
                             const Calibration& r, const Certificate& c) {
  Sheet sheet;
  add_who(sheet, nominal, rows, c);
  add_method(sheet, rows, r, c);
  add_result(sheet, r, c);
  const bool good = r.verdict.answer != calibration::Answer::no;
  if (good) {
    add_budget(sheet, nominal, c);
    add_map(sheet, nominal, r, c);
  }
  add_region(sheet, rows, c, good);
  add_standards(sheet, c);
  add_data(sheet, r, c);
  sheet.section("Remarks and signatures");
  if (c.statement.remarks.empty()) {
    sheet.raw(
        "<p><span class=\"open\" style=\"width:100%\"></span></p>\n<p><span class=\"open\" "
        "style=\"width:100%\"></span></p>\n");
  } else {
    sheet.list(c.statement.remarks);
  }
  sheet.raw(
      "<div class=\"sign\"><div>Place, date</div><div>Operator</div><div>Responsible for the "
      "calibration</div></div>\n");

  const std::string name = good ? "Calibration certificate" : "Measurement report, no certificate";
  const std::string title = c.statement.number.empty() ? name : name + " " + c.statement.number;
  std::string page = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n";
  page += "<meta name=\"generator\" content=\"Polypod\">\n";
  page +=
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; base-uri "
      "'none'; form-action 'none'\">\n";
  page += "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n";
  page += fmt::format("<title>{}</title>\n<style>\n{}</style>\n</head>\n<body>\n<main>\n", escape(title), kCss);
  page += fmt::format(
      "<header><div><h1>{}</h1><p>Geometric calibration of {}</p></div><div class=\"no\">No. "
      "{}<br>Date {}</div></header>\n",
      name, escape(machine::name_of(nominal)), field(c.statement.number), field(c.statement.date));
  page += sheet.body();
  page += fmt::format(
      "<footer>{}This sheet may be passed on as a whole only. It states results of one measurement and claims no "
      "conformity with a standard and no accreditation.</footer>\n",
      c.version.empty() ? "" : fmt::format("Computed with Polypod {}. ", escape(c.version)));
  return page + "</main>\n</body>\n</html>\n";
}

}  // namespace polypod::pages
