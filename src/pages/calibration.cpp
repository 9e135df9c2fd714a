// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/calibration.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>

#include "compliance_figures.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {
namespace {

using calibration::Calibration;
using calibration::Measurement;
using calibration::RowResidual;
using report::Colour;
using report::fixed;
using report::LineStyle;
using report::number;
using report::Verdict;
using units::to_deg;
using units::to_mm;
using units::to_um;
using Facts = std::vector<std::pair<std::string, std::string>>;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kDot = 2.6;       // px
constexpr double kBigDot = 4.2;    // px
constexpr std::size_t kLikes = 3;  // parameters that a held one acts like, in the table
constexpr int kMapPoints = 41;     // on the longer side of a measured plane
constexpr std::array<Colour, 3> kOfAxis{Colour::blue, Colour::vermillion, Colour::green};
constexpr const char* kAxes = "xyz";

/// `rows`: measurements or points, each with its place in a file.
template <class Rows>
Facts facts_of(const machine::AnyMachine& machine, const Rows& rows, const MeasuredPageOptions& how) {
  Facts out{{"machine", machine::name_of(machine)},
            {"family", machine::family_of(machine)},
            {"measurements", files_of(rows)}};
  if (!how.version.empty()) out.emplace_back("made with", "Polypod " + how.version);
  return out;
}

/// Dots over the number of their row.
struct Dots {
  report::LinePlot plot;
  std::size_t count;

  Dots(std::string title, std::string of, std::string y, std::string unit, std::size_t rows) : count(rows) {
    plot.title = std::move(title);
    plot.x = {std::move(of), "", 0, static_cast<double>(rows + 1), false};
    plot.y = {std::move(y), std::move(unit), {}, {}, true};
  }
  /// Dots of a kind at y_of(i) of row i, none where that is not a number. The same kind again goes on with it.
  template <class Y>
  void add(const std::string& name, Colour colour, double size, const Y& y_of) {
    report::Series dots{name, {}, {}, colour, LineStyle::points, size};
    if (!plot.series.empty() && plot.series.back().name == name) {
      dots = std::move(plot.series.back());
      plot.series.pop_back();
    }
    for (std::size_t i = 0; i < count; ++i) {
      const double y = y_of(i);
      if (!std::isfinite(y)) continue;
      dots.x.push_back(static_cast<double>(i + 1));
      dots.y.push_back(y);
    }
    if (!dots.x.empty()) plot.series.push_back(std::move(dots));
  }
};

// ---------------------------------------------------------------------------------------------------- calibration

double length_of(const Eigen::VectorXd& residual, int lengths) {
  return to_um(residual.head(lengths).norm());
}
double angle_of(const Eigen::VectorXd& residual, int lengths) {
  return to_deg(residual.tail(residual.size() - lengths).norm());
}

/// "acts like 1 base.joint[1].z, -1 base.joint[2].z": the change of other parameters that looks the same.
std::string likeness(const calibration::Estimate& p) {
  if (p.like.empty()) return "no effect on these measurements";
  std::string out = "linearly dependent on";
  for (std::size_t i = 0; i < std::min(p.like.size(), kLikes); ++i) {
    const calibration::Like& other = p.like[i];
    out += fmt::format("{} {} {}", i == 0 ? "" : ",",
                       number(other.factor * units::to_user(1, other.unit) / units::to_user(1, p.unit)), other.key);
  }
  return out + (p.like.size() > kLikes ? ", …" : "");
}

/// The colour of a verdict and its text without the "Yes" or "No" that the page itself puts before it. What could not
/// be judged is neither.
std::pair<Verdict, std::string> shown_verdict(const calibration::Verdict& v) {
  for (const auto& [word, colour] :
       {std::pair{"Yes, ", Verdict::good}, {"No, ", Verdict::bad}, {"No: ", Verdict::bad}}) {
    if (!v.text.starts_with(word)) continue;
    std::string rest = v.text.substr(std::string_view(word).size());
    rest.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(rest.front())));
    return {colour, rest};
  }
  return {Verdict::neutral, v.text};
}

void add_summary(report::Report& page, const std::vector<Measurement>& rows, const Calibration& c) {
  page.add_section("Summary");
  const calibration::Verdict& v = c.verdict;
  const auto [colour, sentence] = shown_verdict(v);
  page.add_verdict(colour, sentence);
  std::string proof = fmt::format("{} instead of {} µm rms on the fitted rows", fixed(to_um(c.fitted.rms_after), 1),
                                  fixed(to_um(c.fitted.rms_before), 1));
  if (c.held_back.rows > 0) {
    proof +=
        fmt::format(", {} instead of {} µm on {} rows in a fit of the others, before all were fitted",
                    fixed(to_um(c.held_back.rms_after), 1), fixed(to_um(c.held_back.rms_before), 1), c.held_back.rows);
  }
  page.add_text(proof +
                ". Rows prove what they measure, and no more; the next chapter says what is known of the whole pose.");
  page.add_text(
      "This answers for the geometry of the machine where it was measured: not for backlash, deflection under forces, "
      "temperature and motion, and not for collisions. Fitted rows: the poses that the parameters were fitted to. "
      "Prior: by how much a parameter is expected to be off its drawing before anything is measured.");
  page.add_key_figures({{fixed(to_um(c.fitted.rms_before), 1), "µm", "rms before, fitted rows", Verdict::neutral},
                        {fixed(to_um(c.fitted.rms_after), 1), "µm", "rms after, fitted rows", Verdict::neutral},
                        {fixed(to_um(c.fitted.max_after), 1), "µm", "largest after, outliers aside", Verdict::neutral},
                        {fmt::format("{} of {}", c.told, c.unknowns), "", "unknowns identifiable", Verdict::neutral},
                        {number(c.noise_factor), "×", "residuals over the given noise", Verdict::neutral}});
  const std::size_t outliers = c.fitted.outliers + c.held_back.outliers;
  std::string text = fmt::format(
      "{} rows, {} equations fitted in {} steps; condition {}. Chi-square against the given noise is {} with {} "
      "degrees "
      "of freedom; 95 % intervals are {} standard errors to each side.",
      rows.size(), c.equations, c.iterations, number(c.condition), fixed(c.chi_square, 1), fixed(c.free_equations, 1),
      fixed(c.student, 3));
  text += outliers == 0   ? " No outliers."
          : outliers == 1 ? " One row is an outlier, listed below with the weight it has in the fit."
                          : fmt::format(" {} rows are outliers, listed below with their weights in the fit.", outliers);
  page.add_text(text);
  std::vector<std::string> held;
  for (const calibration::Estimate& p : c.parameters) {
    if (!p.identifiable) held.push_back(fmt::format("{}: {}", p.key, likeness(p)));
  }
  for (const std::string& what : c.held_beside) held.push_back(what);
  if (held.empty()) {
    page.add_text("All estimated parameters are identifiable from the measurements.");
  } else {
    page.add_text(
        "These parameters are not identifiable: they are linearly dependent on others. Of all machines that explain "
        "the readings equally well, the one that is least off the drawing, in units of the priors, was taken:");
    page.add_list(held);
  }
}

/// Common errors in place of the machine's, parameters that moved far, drift and repeats: what the answer rests on.
void add_checks(report::Report& page, const Calibration& c) {
  page.add_section("What else could explain the readings");
  report::Table common;
  common.caption =
      "Errors that all readings have in common: what they explain alone of the drawing's squared residuals, and by how "
      "many priors the parameters change (rms) with and without them";
  common.columns = {
      {"", "", -1}, {"explains", "%", 1}, {"change with", "", 2}, {"change without", "", 2}, {"", "", -1}};
  for (const calibration::CommonChange& one : c.tried) {
    std::vector<report::Cell> row{one.what, 100 * one.alone};
    if (one.fitted) {
      row.insert(row.end(), {one.change, one.change_before, std::string(one.likely ? "likely" : "")});
    } else {
      row.insert(row.end(), {std::string(), std::string(), std::string("too little")});
    }
    common.rows.push_back(std::move(row));
  }
  if (!common.rows.empty()) page.add_table(common);
  std::vector<std::string> moved;
  moved.reserve(c.moved.size());
  for (const calibration::Moved& one : c.moved)
    moved.push_back(fmt::format("{}: {} times its prior", one.key, number(one.priors)));
  if (!moved.empty()) {
    page.add_text("Parameters that moved by ten times their prior and more:");
    page.add_list(moved);
  }
  if (c.repeats.poses > 0) {
    const calibration::Repeats& r = c.repeats;
    page.add_text(fmt::format(
        "{} rows are repeats at {} poses. Within a pose they scatter by {} times the given noise, between poses the "
        "residuals do by {} times; F = {} with {} and {} degrees of freedom. Repeats count as what they are worth.",
        r.rows, r.poses, number(r.within), number(r.between), number(r.F), fixed(r.between_degrees, 1),
        fixed(r.within_degrees, 0)));
  }
  if (!c.drift.looked) return;
  report::Table drift;
  drift.caption = "Drift of the residuals: trend from the first to the last, correlation of neighbours";
  drift.columns = {{"", "", -1}, {"over", "", -1},       {"trend", "", -1},
                   {"t", "", 1}, {"correlation", "", 2}, {"", "", -1}};
  for (const calibration::ComponentDrift& d : c.drift.components) {
    drift.rows.push_back({d.component, d.over,
                          d.is_angle ? number(to_deg(d.trend)) + " deg" : number(to_um(d.trend)) + " µm", d.t, d.lag1,
                          std::string(d.trend_found || d.lag1_found ? "more than chance" : "")});
  }
  page.add_table(drift);
}

// ------------------------------------------------------------------------------------------------- the tool's pose

/// A coordinate of the pose as the page shows it: its letter, unit, and by how much SI is to be multiplied.
struct ShownCoordinate {
  std::string letter, unit;
  double scale = 1;
};
ShownCoordinate shown_coordinate(const std::string& coordinate) {
  const bool angle = coordinate.ends_with("_deg");
  const char c = coordinate.front();
  return {std::string(1, angle ? static_cast<char>(c - 'a' + 'A') : c), angle ? "deg" : "µm",
          angle ? to_deg(1) : to_um(1)};
}

/// A level plane through the middle of the workspace, the tool turned as in its middle, and the poses there.
struct Plane {
  double z = 0;  ///< m
  Vec3 low, high;
  Mat3 R;
  int columns = 0, rows = 0;
};
std::optional<Plane> middle_plane(const machine::AnyMachine& machine) {
  if (!kinematics::task(machine).places()) return std::nullopt;
  constexpr std::size_t kStands = 100;
  const std::vector<calibration::Stand> stands = calibration::random_stands(machine, kStands, 1);
  if (stands.empty()) return std::nullopt;
  Plane out;
  out.low = out.high = stands.front().X_MT.p;
  for (const calibration::Stand& stand : stands) {
    out.low = out.low.cwiseMin(stand.X_MT.p);
    out.high = out.high.cwiseMax(stand.X_MT.p);
  }
  const Vec3 middle = (out.low + out.high) / 2;
  out.z = middle.z();
  const auto nearest = std::min_element(stands.begin(), stands.end(), [&](const auto& a, const auto& b) {
    return (a.X_MT.p - middle).norm() < (b.X_MT.p - middle).norm();
  });
  const bool upright = kinematics::inverse(machine, Pose{Mat3::Identity(), middle}).reachable() != nullptr;
  out.R = upright ? Mat3(Mat3::Identity()) : nearest->X_MT.R;
  const Vec3 size = out.high - out.low;
  const double step = std::max(size.x(), size.y()) / (kMapPoints - 1);
  if (!(step > 0)) return std::nullopt;
  out.columns = std::max(2, 1 + static_cast<int>(std::lround(size.x() / step)));
  out.rows = std::max(2, 1 + static_cast<int>(std::lround(size.y() / step)));
  return out;
}

/// Standard deviations of every coordinate at the points of the plane; NaN out of reach.
std::vector<std::vector<double>> deviations_over(const machine::AnyMachine& machine, const Plane& plane,
                                                 const Eigen::MatrixXd& covariance, std::size_t coordinates) {
  std::vector<std::vector<double>> out(coordinates);
  for (int j = 0; j < plane.rows; ++j) {
    for (int i = 0; i < plane.columns; ++i) {
      const Vec3 share(double(i) / (plane.columns - 1), double(j) / (plane.rows - 1), 0);
      Vec3 p = plane.low + (plane.high - plane.low).cwiseProduct(share);
      p.z() = plane.z;
      const kinematics::InverseResult inverse = kinematics::inverse(machine, Pose{plane.R, p});
      const kinematics::Solution* s = inverse.reachable();
      const Eigen::VectorXd one =
          s == nullptr ? Eigen::VectorXd(Eigen::VectorXd::Constant(static_cast<Eigen::Index>(coordinates), kNone))
                       : calibration::pose_deviation(machine, Pose{plane.R, p}, s->joints, covariance);
      for (std::size_t k = 0; k < coordinates; ++k) out[k].push_back(one[static_cast<Eigen::Index>(k)]);
    }
  }
  return out;
}

void add_pose(report::Report& page, const machine::AnyMachine& nominal, const Calibration& c) {
  const calibration::Verdict& v = c.verdict;
  const std::vector<std::string> all = calibration::pose_coordinates(nominal);
  page.add_section("Pose of the tool");
  page.add_text(fmt::format(
      "The uncertainty of the parameters, propagated to the tool: predicted standard deviations of the pose over {} "
      "poses "
      "of the workspace, before (from the priors alone) and after the calibration. A coordinate is determined where "
      "less than a fifth of its deviation is left.{}",
      v.poses, c.systematic.empty() ? "" : " The stated systematic parts of the measurement (type B) are in it."));
  report::Table table;
  table.caption = "Predicted standard deviation of the pose of the tool";
  // What a narrow screen shows first is the answer.
  table.columns = {{"", "", -1},
                   {"", "", -1},
                   {"after, mean", "", -1},
                   {"before, mean", "", -1},
                   {"after, largest", "", -1},
                   {"before, largest", "", -1}};
  for (std::size_t k = 0; k < all.size(); ++k) {
    const ShownCoordinate shown = shown_coordinate(all[k]);
    const auto i = static_cast<Eigen::Index>(k);
    const bool open = std::find(v.left_open.begin(), v.left_open.end(), all[k]) != v.left_open.end();
    table.rows.push_back({fmt::format("{}, {}", shown.letter, shown.unit),
                          std::string(open ? "undetermined" : "determined"), shown.scale * v.after.mean[i],
                          shown.scale * v.before.mean[i], shown.scale * v.after.max[i], shown.scale * v.before.max[i]});
  }
  page.add_table(table);
  const std::optional<Plane> plane = middle_plane(nominal);
  if (!plane) return;
  const auto after = deviations_over(c.machine, *plane, c.covariance, all.size());
  Panels panels;
  for (std::size_t k = 0; k < all.size(); ++k) {
    const ShownCoordinate shown = shown_coordinate(all[k]);
    report::HeatMap map;
    map.title = fmt::format("standard deviation of {}", shown.letter);
    map.x = {"x", "mm", to_mm(plane->low.x()), to_mm(plane->high.x()), false};
    map.y = {"y", "mm", to_mm(plane->low.y()), to_mm(plane->high.y()), false};
    map.columns = plane->columns;
    map.rows = plane->rows;
    map.label = "s";
    map.unit = shown.unit;
    map.contour_labels = false;
    for (const double value : after[k]) map.values.push_back(shown.scale * value);
    if (std::none_of(map.values.begin(), map.values.end(), [](double x) { return std::isfinite(x); })) return;
    panels.emplace_back(fmt::format("{}, {}", shown.letter, shown.unit), map);
  }
  page.add_figure_grid(3, panels,
                       fmt::format("Predicted standard deviation of each coordinate after the calibration, over the "
                                   "plane z = {} mm. Blank: out of reach.",
                                   fixed(to_mm(plane->z), 1)));
}

void add_residuals(report::Report& page, const std::vector<Measurement>& rows, const Calibration& c) {
  page.add_section("Residuals");
  page.add_text(
      "A residual is what the instrument would see of the computed pose less what it saw. Outliers are marked.");
  const auto kind_of_dot = [&](Dots& dots, const auto& value, const char* fitted, const char* held_back) {
    const auto where = [&](const auto& chosen) {
      return [&, chosen](std::size_t i) { return chosen(c.residuals[i]) ? value(c.residuals[i]) : kNone; };
    };
    dots.add(fitted, report::kAfter, kDot, where([](const RowResidual& r) { return !r.outlier && !r.held_back; }));
    dots.add(held_back, Colour::green, kDot, where([](const RowResidual& r) { return !r.outlier && r.held_back; }));
    dots.add("outliers", Colour::purple, kBigDot, where([](const RowResidual& r) { return r.outlier; }));
  };
  const auto before = [](const RowResidual& r) { return r.untaken ? kNone : length_of(r.before, r.lengths); };
  const auto after = [](const RowResidual& r) { return length_of(r.after, r.lengths); };
  Dots both("residual of each row before and after", "row", "residual", "µm", c.residuals.size());
  both.add("before", report::kBefore, kDot, [&](std::size_t i) { return before(c.residuals[i]); });
  kind_of_dot(both, after, "after", "after, validation set");
  page.add_figure(both.plot,
                  "Residual of each row (length of its vector) with the drawing and with the measured machine.");
  Dots alone("residual of each row after", "row", "residual", "µm", c.residuals.size());
  const auto usual = [&](const RowResidual& r) { return r.outlier ? kNone : after(r); };
  kind_of_dot(alone, usual, "after", "after, validation set");
  page.add_figure(alone.plot, "The residuals after alone, outliers aside.");

  std::array<report::Sample, 3> of_axis;
  for (std::size_t k = 0; k < 3; ++k) of_axis[k] = {std::string(1, kAxes[k]), {}, kOfAxis[k]};
  report::Sample readings{"readings", {}, Colour::purple};
  bool angles = false;
  for (const RowResidual& r : c.residuals) {
    angles = angles || r.after.size() > r.lengths;
    if (r.outlier) continue;
    for (int k = 0; k < r.lengths; ++k)
      (r.lengths == 3 ? of_axis[static_cast<std::size_t>(k)] : readings).values.push_back(to_um(r.after[k]));
  }
  report::Histogram spread;
  spread.title = "spread of the residuals after";
  spread.x = {"residual after", "µm", {}, {}, true};
  for (report::Sample& sample : of_axis)
    if (!sample.values.empty()) spread.samples.push_back(std::move(sample));
  if (!readings.values.empty()) spread.samples.push_back(std::move(readings));
  spread.levels = {{"", 0, Colour::muted}};
  if (!spread.samples.empty()) page.add_figure(spread, "Spread of the residuals after, by direction, outliers aside.");
  if (angles) {
    Dots turned("angles of each row before and after", "row", "residual", "deg", c.residuals.size());
    turned.add("before", report::kBefore, kDot,
               [&](std::size_t i) { return angle_of(c.residuals[i].before, c.residuals[i].lengths); });
    kind_of_dot(
        turned, [](const RowResidual& r) { return angle_of(r.after, r.lengths); }, "after", "after, validation set");
    page.add_figure(turned.plot, "Angles of each row (length of the vector of its angles).");
  }

  report::Table table;
  table.caption = "Rms over single readings, outliers aside but for the column \"all rows\"";
  table.columns = {{"", "", -1},
                   {"rows", "", 0},
                   {"outliers", "", 0},
                   {"before", "µm", 1},
                   {"after", "µm", 1},
                   {"largest", "µm", 1},
                   {"after, all rows", "µm", 1},
                   {"angles before", "deg", 5},
                   {"angles after", "deg", 5}};
  for (const auto& [name, s] : {std::pair{"fitted", c.fitted}, std::pair{"validation set", c.held_back}}) {
    if (s.rows == 0) continue;
    table.rows.push_back({std::string(name), static_cast<double>(s.rows), static_cast<double>(s.outliers),
                          to_um(s.rms_before), to_um(s.rms_after), to_um(s.max_after), to_um(s.all_after),
                          to_deg(s.angle_before), to_deg(s.angle_after)});
  }
  if (!angles) {
    table.columns.resize(table.columns.size() - 2);
  }
  page.add_table(table);
  report::Table outliers;
  outliers.caption = "Outliers";
  outliers.columns = {{"row", "", 0},        {"file", "", -1},   {"line", "", 0}, {"kind", "", -1},
                      {"residual", "µm", 1}, {"weight", "", -1}, {"", "", -1}};
  for (const RowResidual& r : c.residuals) {
    if (!r.outlier) continue;
    const Measurement& row = rows[r.row];
    outliers.rows.push_back({static_cast<double>(r.row + 1), row.place.file, static_cast<double>(row.place.line),
                             calibration::name_of(row.kind), length_of(r.after, r.lengths), r.weight,
                             std::string(r.untaken     ? "left out: the drawing cannot take these joints"
                                         : r.lost      ? "left out: near a singular pose"
                                         : r.held_back ? "validation set"
                                                       : "")});
  }
  if (!outliers.rows.empty()) page.add_table(outliers);
}

void add_parameters(report::Report& page, const Calibration& c) {
  page.add_section("Parameters");
  report::Table table;
  table.caption = fmt::format("In the unit of each; one standard error, from the residuals{} the priors.",
                              c.systematic.empty() ? " and" : ", the stated systematic parts and");
  table.columns = {{"parameter", "", -1}, {"unit", "", -1},          {"nominal", "", 5},         {"value", "", 5},
                   {"change", "", 5},     {"standard error", "", 5}, {"identifiability", "", -1}};
  for (const calibration::Estimate& p : c.parameters) {
    const double nominal = units::to_user(p.nominal, p.unit), value = units::to_user(p.value, p.unit);
    std::vector<report::Cell> row{p.key, p.unit, nominal};
    row.insert(row.end(), {value, value - nominal, units::to_user(p.standard_error, p.unit),
                           p.identifiable ? std::string() : likeness(p)});
    table.rows.push_back(std::move(row));
  }
  page.add_table(table);
  report::Table frames;
  frames.caption = "Frame of the machine in the instrument's, target on the tool";
  frames.columns = {{"", "", -1}, {"", "", -1}, {"unit", "", -1}, {"value", "", 5}, {"standard error", "", 5}};
  for (const auto& [name, X, error] :
       {std::tuple{"frame", c.X_SM, c.frame_error}, {"target", c.X_TR, c.target_error}}) {
    if (error.isZero(0)) continue;
    const Vec3 abc = angles_abc(X.R);
    for (int k = 0; k < 6; ++k) {
      const bool turns = k >= 3;
      const double value = turns ? to_deg(abc[k - 3]) : to_mm(X.p[k]);
      report::Cell sure = turns ? to_deg(error[k]) : to_mm(error[k]);
      if (error[k] == 0) sure = std::string("fixed");
      frames.rows.push_back(
          {std::string(name), std::string(1, "xyzABC"[k]), std::string(turns ? "deg" : "mm"), value, sure});
    }
  }
  if (!frames.rows.empty()) page.add_table(frames);
}

// --------------------------------------------------------------------------------------------------- compliances

/// How compliances are shown: of what slides or stretches in um/N, of turning joints in 1e-7 rad/Nm; and which.
struct Shown {
  std::string unit;
  double scale = 1;
  std::vector<std::size_t> rows;
};
std::vector<Shown> shown_of(const statics::Identification& r) {
  Shown turning{"1e-7 rad/Nm", units::to_tenth_urad(1), {}}, sliding{"µm/N", units::to_um_per_N(1), {}};
  for (std::size_t i = 0; i < r.turns.size(); ++i) (r.turns[i] ? turning : sliding).rows.push_back(i);
  std::vector<Shown> out;
  for (Shown& shown : {std::ref(turning), std::ref(sliding)})
    if (!shown.rows.empty()) out.push_back(std::move(shown));
  return out;
}

/// Each estimate as a dot with its 95 % interval as a whisker.
report::LinePlot whiskers(const statics::Identification& r, const Shown& shown) {
  report::LinePlot plot;
  plot.title = "compliances with their 95 % intervals";
  const auto joints = static_cast<double>(
      std::count_if(shown.rows.begin(), shown.rows.end(), [&](std::size_t i) { return r.told[i]; }));
  plot.x = {"row of the table", "", 0.5, joints + 0.5, false, true};
  plot.y = {"compliance", shown.unit, {}, {}, true};
  report::Series interval{"95 % interval", {}, {}, Colour::ink, LineStyle::solid, 1.5};
  report::Series value{"compliance", {}, {}, Colour::blue, LineStyle::points, kBigDot};
  constexpr double kCap = 0.06;
  for (const std::size_t i : shown.rows) {
    if (!r.told[i]) continue;
    const double x = static_cast<double>(value.x.size() + 1), y = shown.scale * r.compliance[i],
                 half = shown.scale * r.half_interval[i];
    value.x.push_back(x);
    value.y.push_back(y);
    plot.spans.push_back({r.joint[i], x - 0.5, x + 0.5});
    const std::array<report::Point, 9> pen{{{x - kCap, y - half},
                                            {x + kCap, y - half},
                                            {x, kNone},
                                            {x, y - half},
                                            {x, y + half},
                                            {x, kNone},
                                            {x - kCap, y + half},
                                            {x + kCap, y + half},
                                            {x + kCap, kNone}}};
    for (const report::Point& p : pen) {
      interval.x.push_back(p.x);
      interval.y.push_back(p.y);
    }
  }
  plot.series = {std::move(interval), std::move(value)};
  return plot;
}

void add_summary(report::Report& page, std::size_t points, const statics::Identification& r,
                 const ComplianceChecks& checks) {
  page.add_section("Summary");
  using Answer = statics::Verdict::Answer;
  const Verdict colour = checks.answer == Answer::yes  ? Verdict::good
                         : checks.answer == Answer::no ? Verdict::bad
                                                       : Verdict::neutral;
  if (!checks.verdict.empty()) page.add_verdict(colour, checks.verdict);
  page.add_text(
      fmt::format("The compliances found explain the measured displacements to {} µm rms; those of the given "
                  "machine to {} µm.",
                  fixed(to_um(r.residual_rms), 1), fixed(to_um(checks.given_rms), 1)));
  page.add_text(
      "This answers for the static compliance of the joints, as far as the measured places show it: not for the "
      "compliance of spindle, workpiece and clamping, not for vibration, and not for backlash.");
  page.add_key_figures({{fixed(to_um(checks.given_rms), 1), "µm", "rms, given compliances", Verdict::neutral},
                        {fixed(to_um(r.residual_rms), 1), "µm", "rms, found compliances", Verdict::neutral},
                        {std::to_string(points), "", "points", Verdict::neutral},
                        {std::to_string(r.equations), "", "equations", Verdict::neutral},
                        {number(r.condition), "", "condition", Verdict::neutral}});
  for (const auto& [a, b] : r.hardly_apart) {
    const auto i = static_cast<std::size_t>(a), j = static_cast<std::size_t>(b);
    page.add_text(fmt::format("{} and {} are highly correlated: their estimates correlate by {}.", r.joint[i],
                              r.joint[j], fixed(r.correlation[i][j], 3)));
  }
  page.add_text(r.pairs == 0
                    ? std::string("No two cross displacements of a pair were measured, so that symmetry is not judged.")
                    : fmt::format("Measured cross displacements differ from symmetry by {} µm rms: {}.",
                                  fixed(to_um(r.asymmetry_rms), 1),
                                  r.symmetric ? "no more than noise" : "more than noise"));
  for (std::size_t i = 0; i < r.compliance.size(); ++i) {
    if (!r.told[i])
      page.add_text(
          fmt::format("{}: not identifiable from these readings; it stays as the machine file has it.", r.joint[i]));
    if (!r.upper_bound[i]) continue;
    page.add_text(fmt::format(
        "{}: fixed at 0, because the best value would be negative; it is at most {} {} (95 %, "
        "one-sided), and not known to be rigid.",
        r.joint[i],
        number(r.turns[i] ? units::to_tenth_urad(*r.upper_bound[i]) : units::to_um_per_N(*r.upper_bound[i])),
        r.turns[i] ? "× 1e-7 rad/Nm" : "µm/N"));
  }
}

/// So many that the least standard error has two figures.
int decimals_of(const statics::Identification& r, const Shown& shown) {
  double least = std::numeric_limits<double>::infinity();
  for (const std::size_t i : shown.rows) {
    const double error = shown.scale * r.standard_error[i];
    if (r.told[i] && error > 0) least = std::min(least, error);
  }
  constexpr int kMost = 8;
  return std::isfinite(least) ? std::clamp(1 - static_cast<int>(std::floor(std::log10(least))), 0, kMost) : 2;
}

void add_compliances(report::Report& page, const statics::Identification& r) {
  page.add_section("Compliances");
  for (const Shown& shown : shown_of(r)) {
    page.add_figure(whiskers(r, shown), "Each joint's compliance; the whisker is its 95 % interval.");
    report::Table table;
    table.caption = "Compliances in " + shown.unit;
    const int decimals = decimals_of(r, shown);
    table.columns = {{"joint", "", -1},
                     {"compliance", "", decimals},
                     {"standard error", "", decimals},
                     {"± 95 %", "", decimals},
                     {"± 95 %", "% of it", 1}};
    table.rows.reserve(shown.rows.size());
    for (const std::size_t i : shown.rows) {
      std::vector<report::Cell> row{r.joint[i], shown.scale * r.compliance[i]};
      if (!r.told[i]) {
        row.insert(row.end(), {"not identifiable", "as given"});
        table.rows.push_back(std::move(row));
        continue;
      }
      row.insert(row.end(), {shown.scale * r.standard_error[i], shown.scale * r.half_interval[i]});
      if (r.compliance[i] > 0) row.emplace_back(100 * r.half_interval[i] / r.compliance[i]);
      table.rows.push_back(std::move(row));
    }
    page.add_table(table);
  }
}

void add_residuals(report::Report& page, const std::vector<statics::MeasuredPoint>& points,
                   const statics::Identification& r) {
  page.add_section("Residuals");
  page.add_text("A residual is the measured displacement less the computed one. Outliers stay in the fit.");
  const auto is_outlier = [&](std::size_t point, int direction, int force) {
    return std::any_of(r.outliers.begin(), r.outliers.end(), [&](const statics::Outlier& x) {
      return x.point == point && x.direction == direction && x.force_axis == force;
    });
  };
  std::vector<report::Sample> samples;
  samples.reserve(3);
  for (int d = 0; d < 3; ++d)
    samples.push_back({fmt::format("along {}", kAxes[d]), {}, kOfAxis[static_cast<std::size_t>(d)]});
  for (int f = 0; f < 3; ++f) {
    Dots dots(fmt::format("residuals under the force along {}", kAxes[f]), "point", "residual", "µm", points.size());
    for (int d = 0; d < 3; ++d) {
      dots.add(fmt::format("d{}", kAxes[d]), kOfAxis[static_cast<std::size_t>(d)], kDot,
               [&](std::size_t i) { return is_outlier(i, d, f) ? kNone : to_um(r.residuals[i](d, f)); });
      for (const Mat3& residual : r.residuals)
        samples[static_cast<std::size_t>(d)].values.push_back(to_um(residual(d, f)));
    }
    for (int d = 0; d < 3; ++d) {
      dots.add("outliers", Colour::purple, kBigDot,
               [&](std::size_t i) { return is_outlier(i, d, f) ? to_um(r.residuals[i](d, f)) : kNone; });
    }
    dots.plot.levels = {{"", 0, Colour::muted}};
    page.add_figure(dots.plot, fmt::format("Residuals of each point under the force along {}.", kAxes[f]));
  }
  report::Histogram spread;
  spread.title = "spread of the residuals by direction";
  spread.x = {"residual", "µm", {}, {}, true};
  spread.samples = std::move(samples);
  page.add_figure(spread, "Spread of the residuals, by the direction of the displacement.");
  report::Table by;
  by.caption = "Rms of the residuals by displacement (row) and force (column)";
  by.columns = {{"", "", -1}, {"force x", "µm", 1}, {"force y", "µm", 1}, {"force z", "µm", 1}};
  for (int d = 0; d < 3; ++d) {
    std::vector<report::Cell> row{fmt::format("d{}", kAxes[d])};
    for (int f = 0; f < 3; ++f) {
      double sum = 0;
      for (const Mat3& residual : r.residuals) sum += residual(d, f) * residual(d, f);
      row.emplace_back(to_um(std::sqrt(sum / static_cast<double>(std::max<std::size_t>(r.residuals.size(), 1)))));
    }
    by.rows.push_back(std::move(row));
  }
  page.add_table(by);
  report::Table outliers;
  outliers.caption = "Outliers";
  outliers.columns = {
      {"point", "", 0}, {"file", "", -1}, {"line", "", 0}, {"displacement", "", -1}, {"residual", "µm", 1}};
  for (const statics::Outlier& x : r.outliers) {
    const Place& place = points[x.point].place;
    outliers.rows.push_back({static_cast<double>(x.point + 1), place.file, static_cast<double>(place.line),
                             fmt::format("d{}_F{}", kAxes[x.direction], kAxes[x.force_axis]), to_um(x.residual)});
  }
  if (!outliers.rows.empty()) page.add_table(outliers);
}

/// The plane of each file beside what the found compliances say of it.
void add_planes(report::Report& page, const machine::AnyMachine& machine,
                const std::vector<statics::MeasuredPoint>& points, const statics::Identification& r) {
  const auto found = statics::with_compliances(machine, r.compliance);
  if (!found) return;
  bool first = true;
  for (auto begin = points.begin(); begin != points.end();) {
    const auto end =
        std::find_if(begin, points.end(), [&](const auto& p) { return p.place.file != begin->place.file; });
    const std::vector<statics::MeasuredPoint> file(begin, end);
    begin = end;
    const auto plane = measured_plane(file);
    if (!plane || plane->points.size() != file.size()) continue;
    ComplianceMap map{*found, plane->plane, plane->at, plane->rectangle, {}, {}, {}};
    const auto [columns, rows] = grid_counts(plane->rectangle, kMapPoints);
    map.map = statics::compliance_map(*found, statics::plane_grid(map.plane, map.at, map.rectangle, columns, rows),
                                      file.front().X_MT.R);
    // From all points, or where the tool turns from file to file from this one's.
    auto measured = measured_over(map, points);
    if (!measured) measured = measured_over(map, file);
    if (!measured) continue;
    map.measured = std::move(*measured);
    if (first) page.add_section("Measured and computed maps");
    first = false;
    page.add_heading(
        fmt::format("{}: {}", std::filesystem::path(file.front().place.file).filename().string(), shown_place(map)));
    page.add_verdict(explained(*map.measured) ? Verdict::good : Verdict::neutral, measured_verdict(map, false) + ".");
    add_measured(page, map, false);
  }
}

}  // namespace

std::string calibration_page(const machine::AnyMachine& nominal, const std::vector<Measurement>& rows,
                             const Calibration& c, const MeasuredPageOptions& how) {
  report::Report page("Calibration of a machine", machine::description_of(nominal), facts_of(nominal, rows, how));
  add_summary(page, rows, c);
  add_checks(page, c);
  add_pose(page, nominal, c);
  add_residuals(page, rows, c);
  add_parameters(page, c);
  if (!how.command.empty()) page.add_code("The command that made this page", how.command, false);
  return page.to_html();
}

std::string identification_page(const machine::AnyMachine& machine, const std::vector<statics::MeasuredPoint>& points,
                                const statics::Identification& r, const ComplianceChecks& checks,
                                const MeasuredPageOptions& how) {
  report::Report page("Compliances from measured displacements", machine::description_of(machine),
                      facts_of(machine, points, how));
  add_summary(page, points.size(), r, checks);
  add_compliances(page, r);
  add_residuals(page, points, r);
  if (!checks.left_out.empty()) {
    page.add_section("Predicted from the others");
    report::Table left;
    left.caption = "Each file, predicted with the compliances from all other files";
    left.columns = {{"file", "", -1}, {"rms", "µm", 1}};
    for (const auto& [file, rms] : checks.left_out) left.rows.push_back({file, to_um(rms)});
    page.add_table(left);
  }
  add_planes(page, machine, points, r);
  if (!how.command.empty()) page.add_code("The command that made this page", how.command, false);
  return page.to_html();
}

}  // namespace polypod::pages
