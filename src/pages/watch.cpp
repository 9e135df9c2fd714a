// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <regex>

#include "machine_lines.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/report/html.hpp"
#include "program_film.hpp"

namespace polypod::pages {
namespace {

/// What the command says, with the symbol of micrometres that pages have.
std::string with_symbols(const std::string& text) {
  return std::regex_replace(text, std::regex(" um\\b"), " µm");
}

using control::Watch;
using control::WatchPart;
using control::WatchPoint;
using machining::RecordedCut;
using report::Colour;
using report::fixed;
using report::Report;
using report::Verdict;
using units::to_mm;
using units::to_um;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr const char* kUm = "µm";
constexpr std::size_t kTable = 200;   // rows of a table
constexpr std::size_t kPath = 20000;  // points of the way from above

report::LinePlot over_time(const Watch& watch, std::string title, std::string label) {
  report::LinePlot plot;
  plot.title = std::move(title);
  plot.x = {"time", "s", {}, {}, false};
  plot.y = {std::move(label), kUm, {}, {}, true};
  for (std::size_t k = 0; k < watch.points.size();) {
    std::size_t end = k;
    while (end < watch.points.size() && watch.points[end].line == watch.points[k].line) ++end;
    if (plot.spans.size() >= report::LinePlot::kMostSpans) {
      plot.spans.clear();
      return plot;
    }
    plot.spans.push_back({fmt::format("line {}", watch.points[k].line), watch.points[k].time,
                          watch.points[std::min(end, watch.points.size() - 1)].time});
    k = end;
  }
  return plot;
}

template <class F>
report::Series series_of(const Watch& watch, std::string name, Colour colour, F&& value,
                         report::LineStyle style = report::LineStyle::solid) {
  report::Series out{std::move(name), {}, {}, colour, style, 1.4};
  for (const WatchPoint& p : watch.points) {
    out.x.push_back(p.time);
    out.y.push_back(p.known ? to_um(value(p)) : kNone);
  }
  return out;
}

double round_factor(double wanted) {
  double factor = 1;
  while (factor * 10 <= wanted) factor *= 10;
  for (const double f : {5.0, 2.0})
    if (factor * f <= wanted) return factor * f;
  return factor;
}

class Page {
 public:
  Page(const Watch& w, const machining::Job* job, const RecordedCut* cut, const WatchPageOptions& o)
      : w_(w), job_(job), cut_(cut), o_(o), report_("What the record says", subtitle(), facts()) {
    for (const WatchPoint& p : w.points) measured_ = measured_ || p.measured;
  }

  std::string html() {
    answer();
    film();
    deviation();
    explained();
    lines();
    if (cut_ != nullptr) tube();
    limits();
    return report_.to_html();
  }

 private:
  [[nodiscard]] std::string subtitle() const {
    return std::string("The tip by the joints of a record beside its command, and what explains the difference") +
           (cut_ != nullptr
                ? ". The tolerance zone round the programmed path, a cylinder with a sphere at each end, is "
                  "called tube here"
                : "");
  }
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> facts() const {
    std::vector<std::pair<std::string, std::string>> out{{"record", o_.record}, {"machine", o_.machine}};
    if (job_ != nullptr) out.emplace_back("job", job_->path);
    if (!o_.version.empty()) out.emplace_back("Polypod", o_.version);
    return out;
  }

  void answer() {
    report_.add_section("Answer");
    std::string text = with_symbols(o_.answer);
    if (!text.empty()) text.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(text.front())));
    const Verdict good = !o_.judged ? Verdict::neutral
                         : !o_.ok   ? Verdict::bad
                                    : (o_.not_judged.empty() ? Verdict::good : Verdict::neutral);
    report_.add_verdict(good, text + ".");
    if (!o_.live.empty()) report_.add_links({{o_.live, "Follow the record as it grows"}});
    for (const std::string& n : o_.not_judged)
      report_.add_verdict(Verdict::neutral, "Not judged: " + with_symbols(n) + ".");
    std::vector<report::KeyFigure> figures;
    figures.push_back({fixed(to_um(w_.largest), 1), kUm,
                       fmt::format("largest deviation of the tip from its command (line {})", w_.largest_line)});
    figures.push_back({fixed(to_um(w_.rms), 1), kUm, "its rms"});
    if (measured_) figures.push_back({fixed(to_um(w_.left_rms), 1), kUm, "rms that remains unexplained"});
    if (cut_ != nullptr) {
      figures.push_back({fixed(100 * cut_->gain.removed_mean(), 1), "%",
                         "of the mean deflection along the normal removed by the commands"});
      figures.push_back({fixed(to_um(cut_->cut.largest_distance), 1), kUm,
                         fmt::format("largest distance of the deflected tool from the programmed path (tube {:g} {})",
                                     to_um(job_->tolerance), kUm),
                         cut_->cut.within(*job_) ? Verdict::good : Verdict::bad});
    }
    report_.add_key_figures(figures);
  }

  /// The machine by the joints of the record, and the way of its command and of its tip.
  void film() {
    if (o_.moving == nullptr || o_.rows == nullptr || o_.rows->empty() || o_.rows->size() != w_.points.size()) return;
    const machine::AnyMachine& m = *o_.moving;
    const std::vector<control::RecordRow>& rows = *o_.rows;
    const std::size_t most = pictures_for(m);
    const double begin = rows.front().time, time = rows.back().time - begin;
    std::vector<ProgramInstant> instants;
    double next = begin;
    for (std::size_t k = 0; k < rows.size(); ++k) {
      if (rows[k].time < next && k + 1 < rows.size() && rows[k].time != w_.largest_time) continue;
      next = std::max(next, begin + time * std::floor((rows[k].time - begin) / time * double(most) + 1) / double(most));
      ProgramInstant p{rows[k].time, static_cast<int>(k), 0, rows[k].line, w_.points[k].known, rows[k].command, {}, {}};
      p.q = rows[k].joints;
      const kinematics::ForwardResult f = kinematics::forward(m, p.q);
      if (f.poses.empty()) {
        p.q.resize(0);
        p.why = "the joints of the record are no pose of the machine";
      } else {
        p.X = f.poses.front();
      }
      instants.push_back(std::move(p));
    }
    const double factor = enlarged();
    const auto deviation = [this](const ProgramInstant& p) {
      const WatchPoint& at = w_.points[static_cast<std::size_t>(p.move)];
      return at.known ? to_um(at.deviation().norm()) : kNone;
    };
    const auto scene_of = [&](std::size_t points) {
      report::Scene scene;
      scene.title = "The machine on its way along the record";
      way(scene, points);
      scene.shift = {"deviation enlarged", factor, 4 * factor};
      scene.ramp = {"deviation", kUm, 0, std::max(to_um(w_.largest), 1e-3), report::ColourMap::sequential};
      add_film(scene, m, instants, {{"deviation", kUm, deviation}}, {});
      if (kinematics::hangs_down(m)) hang(scene);
      return scene;
    };
    constexpr std::size_t kDrawn = 400, kTurns = 4000;
    const report::Scene turns = scene_of(kTurns);
    if (turns.frames.empty()) return;
    report::Scene drawn = scene_of(kDrawn);
    drawn.frames.clear();
    report_.add_section("The machine on its way");
    report_.add_scene(
        drawn,
        fmt::format("{}The machine by the joints of the record, {} pictures of {} rows. The tip has the colour of its "
                    "deviation from the command, which is drawn {:g} times larger here. The curves below have a cursor "
                    "that goes along; a click into one moves the machine there.",
                    kinematics::hangs_down(m) ? "The base is above: z of the machine points down. " : "",
                    fixed(double(instants.size()), 0), fixed(double(rows.size()), 0), factor),
        &turns);
  }

  /// By how much the deviation is enlarged so that it shows.
  [[nodiscard]] double enlarged() const {
    Eigen::AlignedBox3d box;
    double most = 0;
    for (const WatchPoint& p : w_.points) {
      box.extend(p.command);
      if (p.known) most = std::max(most, p.deviation().norm());
    }
    constexpr double kShare = 0.05;
    return most > 0 && !box.isEmpty() ? std::max(1.0, round_factor(kShare * box.diagonal().norm() / most)) : 1;
  }

  /// Command and tip in M; of each group of rows the first and the one that is farthest off.
  void way(report::Scene& scene, std::size_t points) const {
    report::Line3 command{"command", {}, Colour::muted, 1.4}, tip{"tip", {}, Colour::blue, 2.4};
    const auto mm = [](const Vec3& p) { return report::Point3{to_mm(p.x()), to_mm(p.y()), to_mm(p.z())}; };
    const std::size_t group = std::max<std::size_t>(1, 2 * w_.points.size() / points);
    const auto put = [&](const WatchPoint& p) {
      command.points.push_back(mm(p.command));
      command.tag.push_back(p.line);
      tip.points.push_back(p.known ? mm(p.command) : report::Point3{kNone, kNone, kNone});
      tip.offset.push_back(p.known ? mm(p.deviation()) : report::Point3{});
      tip.value.push_back(p.known ? to_um(p.deviation().norm()) : 0);
      tip.tag.push_back(p.line);
    };
    for (std::size_t from = 0; from < w_.points.size(); from += group) {
      const std::size_t to = std::min(w_.points.size(), from + group);
      std::size_t worst = from;
      for (std::size_t k = from; k < to; ++k)
        if (w_.points[k].known && w_.points[k].deviation().norm() > w_.points[worst].deviation().norm()) worst = k;
      put(w_.points[from]);
      if (worst != from) put(w_.points[worst]);
    }
    scene.lines.push_back(std::move(command));
    scene.lines.push_back(std::move(tip));
  }

  void deviation() {
    report_.add_section("The deviation over time");
    report::LinePlot plot = over_time(w_, "Deviation of the tip from its command", "deviation");
    if (measured_) {
      report::Series s = series_of(w_, "measured", Colour::ink,
                                   [](const WatchPoint& p) { return p.measured ? p.measured->norm() : kNone; });
      plot.series.push_back(std::move(s));
    }
    plot.series.push_back(
        series_of(w_, "modelled", Colour::blue, [](const WatchPoint& p) { return p.modelled().norm(); }));
    if (o_.warn > 0) plot.levels.push_back({"limit", to_um(o_.warn), Colour::vermillion});
    report_.add_figure(plot,
                       "The size of the deviation. Modelled: the sum of what the joints, the calibrated machine and "
                       "the expected deflection say, as far as they were given.");
    report::LinePlot split = over_time(w_, "Across and along the motion", "deviation");
    split.series.push_back(series_of(w_, "along the motion", Colour::green, [](const WatchPoint& p) {
      return p.along.isZero(0) ? kNone : p.deviation().dot(p.along);
    }));
    split.series.push_back(series_of(w_, "across it", Colour::vermillion, [](const WatchPoint& p) {
      const Vec3 d = p.deviation();
      return Vec3(d - p.along * d.dot(p.along)).norm();
    }));
    report_.add_figure(split,
                       "Along the motion a lag counts below zero; it is an error of time alone where the path is "
                       "straight. Across it the deviation is one of the path.");
    path();
  }

  void path() {
    report::PathPlot plot;
    plot.title = "The way from above";
    plot.x_label = "x in M";
    plot.y_label = "y in M";
    report::Point low{kNone, kNone}, high = low;
    double most = 0;
    for (const WatchPoint& p : w_.points) {
      low = {std::fmin(low.x, to_mm(p.command.x())), std::fmin(low.y, to_mm(p.command.y()))};
      high = {std::fmax(high.x, to_mm(p.command.x())), std::fmax(high.y, to_mm(p.command.y()))};
      if (p.known) most = std::max(most, p.deviation().head<2>().norm());
    }
    const double size = std::max(high.x - low.x, high.y - low.y);
    const double factor = most > 0 && size > 0 ? std::max(1.0, round_factor(0.05 * size / to_mm(most))) : 1;
    report::Polyline command{"command", {}, Colour::muted, report::LineStyle::solid, 1.2};
    report::Polyline tip{"tip", {}, Colour::blue, report::LineStyle::solid, 1.4};
    const std::size_t stride = std::max<std::size_t>(1, w_.points.size() / kPath);
    for (std::size_t k = 0; k < w_.points.size(); k += stride) {
      const WatchPoint& p = w_.points[k];
      command.points.push_back({to_mm(p.command.x()), to_mm(p.command.y())});
      if (!p.known) {
        if (!tip.points.empty()) plot.lines.push_back(tip);
        tip.points.clear();
        continue;
      }
      const Vec3 q = p.command + factor * p.deviation();
      tip.points.push_back({to_mm(q.x()), to_mm(q.y())});
    }
    if (!tip.points.empty()) plot.lines.push_back(std::move(tip));
    plot.lines.insert(plot.lines.begin(), std::move(command));
    for (const auto& warning : w_.warnings) {
      if (plot.markers.size() == 12) break;
      const auto at = std::lower_bound(w_.points.begin(), w_.points.end(), warning.from,
                                       [](const WatchPoint& p, double t) { return p.time < t; });
      if (at != w_.points.end()) {
        plot.markers.push_back({fmt::format("line {}", warning.line),
                                {to_mm(at->command.x()), to_mm(at->command.y())},
                                Colour::vermillion});
      }
    }
    plot.note = fmt::format("the deviation is drawn {:g} times larger", factor);
    report_.add_figure(plot, w_.warnings.empty()
                                 ? "Command and tip from above."
                                 : "Command and tip from above; named: where the deviation grows beyond "
                                   "the limit (the first twelve).");
  }

  void explained() {
    report_.add_section(measured_ ? "What explains the measured deviation" : "What the deviation is made of");
    report::Table table;
    table.columns = {{"part", "", -1}, {"rms", kUm, 1}, {"largest", kUm, 1}};
    if (measured_) table.columns.push_back({"left of the measured, rms", kUm, 1});
    for (const WatchPart& p : w_.parts) {
      std::vector<report::Cell> row{p.name};
      if (p.given) {
        row.insert(row.end(), {to_um(p.rms), to_um(p.largest)});
        if (measured_) row.emplace_back(to_um(*p.rms_left));
      } else {
        row.insert(row.end(), {std::string("not given"), std::string("")});
        if (measured_) row.emplace_back(std::string(""));
      }
      table.rows.push_back(std::move(row));
    }
    if (measured_)
      table.rows.push_back({std::string("remains"), to_um(w_.left_rms), to_um(w_.left_largest), to_um(w_.left_rms)});
    report_.add_table(table);
    report_.add_text(
        "Drives: the tip by the joints of the record less the command, what the joints do not follow. Geometry: the "
        "tip of "
        "the calibrated machine less that of the controller's, at the same joints. Compliance: the deflection that the "
        "cut of the job makes on the recorded way.");
    if (!measured_) return;
    report_.add_text(fmt::format(
        "The clock of the record is that of the instrument and {} ms{}. The mean of what remains is x {}, y {}, z {} "
        "{}: "
        "an offset of the instrument's frame shows there.",
        fixed(w_.shift / units::from_ms(1), 3),
        w_.shift_estimated
            ? fmt::format(" (estimated from the motion; standard uncertainty {} ms. A constant lag of the "
                          "machine behind its joints cannot be separated from it)",
                          report::number(w_.shift_uncertainty / units::from_ms(1), 2))
            : std::string(" (given)"),
        fixed(to_um(w_.left_mean.x()), 1), fixed(to_um(w_.left_mean.y()), 1), fixed(to_um(w_.left_mean.z()), 1), kUm));
    report::LinePlot plot = over_time(w_, "What remains of the measured deviation", "deviation");
    plot.series.push_back(series_of(w_, "remains", Colour::purple, [](const WatchPoint& p) {
      return p.measured ? Vec3(*p.measured - p.modelled()).norm() : kNone;
    }));
    report_.add_figure(plot, "The measured deviation less all parts that were given.");
  }

  void lines() {
    report_.add_section("Each line of the program");
    report::Table table;
    table.columns = {{"line", "", 0}, {"from", "s", 3},   {"for", "s", 3},   {"largest", kUm, 1},
                     {"rms", kUm, 1}, {"across", kUm, 1}, {"along", kUm, 1}, {"rows not judged", "", 0}};
    for (const control::WatchLine& l : w_.lines) {
      if (table.rows.size() == kTable) break;
      if (l.points == 0) {
        table.rows.push_back({double(l.line), l.from, l.seconds, std::string("not judged"), std::string(""),
                              std::string(""), std::string(""), double(l.not_judged)});
        continue;
      }
      table.rows.push_back({double(l.line), l.from, l.seconds, to_um(l.largest), to_um(l.rms), to_um(l.across),
                            to_um(l.along), double(l.not_judged)});
    }
    if (table.rows.size() < w_.lines.size())
      table.caption = fmt::format("The first {} of {} lines", table.rows.size(), w_.lines.size());
    report_.add_table(table);
  }

  void tube() {
    const RecordedCut& c = *cut_;
    report_.add_section("The deflected tool against the tube");
    report_.add_text(fmt::format(
        "The recorded way was cut anew in the stock of the job: {} straight pieces with the feed that the controller "
        "really had, {} points in equilibrium with their force. The tube of {:g} {} is the tolerance zone round the "
        "programmed path.",
        c.pieces, c.points.size(), to_um(job_->tolerance), kUm));
    report::LinePlot plot = over_time(w_, "Deflection and normal error", "across the path");
    report::Series deflection{"deflection along the normal", {}, {}, report::kBefore, {}, 1.4};
    report::Series left{"normal error that is left", {}, {}, report::kAfter, {}, 1.4};
    report::Series away{"distance from the path", {}, {}, Colour::muted, report::LineStyle::dotted, 1.2};
    for (const machining::RecordedPoint& p : c.points) {
      const bool shown = p.cutting && !p.turning;
      for (report::Series* s : {&deflection, &left, &away}) s->x.push_back(p.time);
      deflection.y.push_back(shown ? to_um(p.deflection_normal) : kNone);
      left.y.push_back(shown ? to_um(p.normal) : kNone);
      away.y.push_back(p.cutting ? to_um(p.distance) : kNone);
    }
    plot.series = {std::move(deflection), std::move(left), std::move(away)};
    plot.bands.push_back({"tube", -to_um(job_->tolerance), to_um(job_->tolerance), report::kTolerance});
    report_.add_figure(plot,
                       "Above zero the cutter leaves material. Gaps: nothing is cut, or the command turns away from "
                       "its move (a corner), where the tool yields and only the distance counts.");
    report::Table gain;
    gain.caption = "What the commands take back";
    gain.columns = {{"line", "", -1}, {"cut", "mm", 1},    {"mean deflection", kUm, 1},
                    {"left", kUm, 1}, {"removed", "%", 1}, {"rms deflection", kUm, 1},
                    {"left", kUm, 1}, {"removed", "%", 1}};
    const auto row = [&](const std::string& name, const machining::Gain& g) {
      gain.rows.push_back({name, to_mm(g.length), to_um(g.mean_deflection), to_um(g.mean_left), 100 * g.removed_mean(),
                           to_um(g.rms_deflection), to_um(g.rms_left), 100 * g.removed_rms()});
    };
    for (const auto& [line, g] : c.gain_by_line) {
      if (gain.rows.size() == kTable) break;
      row(std::to_string(line), g);
    }
    row("all", c.gain);
    report_.add_table(gain);
    if (c.corners.empty()) return;
    report::Table corners;
    corners.caption = "Corners: what the path mode says and what the controller did";
    corners.columns = {
        {"after line", "", 0}, {"turn", "deg", 1}, {"predicted", kUm, 1}, {"recorded", kUm, 1}, {"", "", -1}};
    for (const machining::RecordedCorner& k : c.corners) {
      if (corners.rows.size() == kTable) break;
      corners.rows.push_back({double(k.line), units::to_deg(k.turn), to_um(k.predicted), to_um(k.recorded),
                              std::string(k.bound ? "a bound" : "") + (k.cutting ? "" : " rapids")});
    }
    report_.add_table(corners);
  }

  void limits() {
    report_.add_section("What this page does not answer");
    std::vector<std::string> items;
    if (!measured_)
      items.emplace_back("What the machine really did: nothing measured the tip, all is by its joints and its models.");
    for (const WatchPart& p : w_.parts)
      if (!p.given) items.push_back(fmt::format("What the {} explains: its input was not given.", p.name));
    items.emplace_back("Heat, backlash and vibration, but as part of what remains of a measurement.");
    if (cut_ != nullptr)
      items.emplace_back("Forces other than the mean cutting force of the job's model; tool and workpiece are rigid.");
    report_.add_list(items);
    if (!o_.command.empty()) report_.add_code("The command that made this page", o_.command, false);
  }

  const Watch& w_;
  const machining::Job* job_;
  const RecordedCut* cut_;
  const WatchPageOptions& o_;
  Report report_;
  bool measured_ = false;
};

}  // namespace

std::string watch_page(const Watch& watch, const machining::Job* job, const RecordedCut* cut,
                       const WatchPageOptions& options) {
  return Page(watch, job, cut, options).html();
}

}  // namespace polypod::pages
