// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "correction_figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>

#include "outline.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"
#include "program_film.hpp"

namespace polypod::pages {
namespace {

using machining::Correction;
using machining::Job;
using machining::Sample;
using report::Colour;
using report::LinePlot;
using report::LineStyle;
using report::Point;
using report::Polyline;
using report::Series;
using units::to_mm;
using units::to_um;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kNamedMoves = 14;  // moves that get an arrow and their line on the path
constexpr std::size_t kCrowded = 60;     // moves beyond which curves are thinner
constexpr std::size_t kShareRows = 12;   // moves whose shares get a bar of their own
constexpr Colour kCommand = Colour::purple;

std::size_t index(int i) {
  return static_cast<std::size_t>(i);
}

Point from_above(const Vec3& p) {
  return {to_mm(p.x()), to_mm(p.y())};
}

/// 1, 2 or 5 times a power of ten, at most x (at least 1).
double round_factor(double x) {
  if (!(x > 1)) return 1;
  const double power = std::pow(10.0, std::floor(std::log10(x)));
  for (const double digit : {5.0, 2.0}) {
    if (digit * power <= x) return digit * power;
  }
  return power;
}

/// One y a dot; where the tool does not cut the line is interrupted.
template <class F>
Series series_of(std::string name, const std::vector<Dot>& dots, Colour colour, bool with_joints, F&& value) {
  Series out{std::move(name), {}, {}, colour};
  for (const Dot& d : dots) {
    if (d.joint && !with_joints) continue;
    const bool cuts = d.sample->cutting;
    if (!cuts && !out.y.empty() && !std::isfinite(out.y.back())) continue;
    out.x.push_back(d.at);
    out.y.push_back(cuts ? value(d) : kNone);
  }
  return out;
}

std::vector<report::Span> spans_of(const Tracks& tracks) {
  std::vector<report::Span> out;
  if (tracks.stretches.size() > LinePlot::kMostSpans) return out;
  for (const Stretch& s : tracks.stretches) out.push_back({fmt::format("line {}", s.line), s.from, s.to});
  return out;
}

/// Adds a curve, if it has points; thinner where moves crowd.
void add(LinePlot& plot, const Tracks& tracks, Series series) {
  if (series.x.empty()) return;
  series.stroke = tracks.stretches.size() > kCrowded ? 1.0 : 1.5;
  plot.series.push_back(std::move(series));
}

LinePlot along_the_path(const Tracks& tracks, std::string title, std::string label, std::string unit) {
  LinePlot plot;
  plot.title = std::move(title);
  plot.x = {"along the moves that cut", "mm", 0.0, tracks.length, false};
  plot.y = {std::move(label), std::move(unit), {}, {}, true};
  plot.spans = spans_of(tracks);
  plot.aspect = 0.33;
  return plot;
}

/// Where dots lie, each off its place on the programmed path by `factor` times what `offset` says: one line for each
/// run of moves that meet.
template <class F>
std::vector<Polyline> enlarged(const Correction& c, const std::vector<Dot>& dots, double factor, const Polyline& style,
                               F&& position) {
  std::vector<Polyline> out;
  const Dot* last = nullptr;
  for (const Dot& d : dots) {
    const gcode::Move& move = c.programmed[index(d.move)];
    const bool apart =
        last == nullptr || (last->move != d.move && (move.start - c.programmed[index(last->move)].end).norm() > 1e-6);
    if (apart) out.push_back(style);
    const Vec3 x = position(d);
    const Vec3 p = move.point(move.nearest(x));
    out.back().points.push_back(from_above(p + factor * (x - p)));
    last = &d;
  }
  return out;
}

Vec3 bent_of(const Dot& d) {
  return d.sample->bent();
}
Vec3 command_of(const Dot& d) {
  return d.sample->command;
}

/// The programmed moves from above, arcs in steps.
std::vector<Polyline> programmed_lines(const Correction& c, const Tracks& tracks, const Polyline& style) {
  std::vector<Polyline> out;
  Vec3 end = Vec3::Constant(kNone);
  for (const Stretch& stretch : tracks.stretches) {
    const gcode::Move& move = c.programmed[index(stretch.move)];
    if (!((move.start - end).norm() < 1e-6)) {
      out.push_back(style);
      out.back().points.push_back(from_above(move.start));
    }
    const double length = move.length();
    const int steps = move.kind == gcode::MoveKind::arc ? std::clamp(int(std::ceil(move.sweep / 0.1)), 1, 256) : 1;
    for (int k = 1; k <= steps; ++k) out.back().points.push_back(from_above(move.point(length * k / steps)));
    end = move.end;
  }
  return out;
}

void append(std::vector<Polyline>& to, std::vector<Polyline> from) {
  to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
}

double largest(const std::vector<Polyline>& lines) {
  Point lo{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()}, hi{-lo.x, -lo.y};
  for (const Polyline& line : lines) {
    for (const Point& p : line.points) {
      lo = {std::min(lo.x, p.x), std::min(lo.y, p.y)};
      hi = {std::max(hi.x, p.x), std::max(hi.y, p.y)};
    }
  }
  return std::max({hi.x - lo.x, hi.y - lo.y, 0.0});
}

}  // namespace

Tracks::Tracks(const gcode::Program& program, const Correction& c) {
  std::vector<char> cuts(c.programmed.size(), 0);
  for (const Sample& s : c.before.samples) cuts[index(s.move)] |= s.cutting ? 1 : 0;
  for (const Sample& s : c.after.samples) cuts[index(c.source[index(s.move)])] |= s.cutting ? 1 : 0;
  std::vector<double> start(c.programmed.size(), 0.0);
  for (std::size_t i = 0; i < c.programmed.size(); ++i) {
    start[i] = length;
    if (cuts[i] == 0) continue;
    const gcode::Move& move = c.programmed[i];
    const double end = length + to_mm(move.length());
    stretches.push_back({static_cast<int>(i), program.blocks[index(move.block)].line, length, end});
    length = end;
  }
  for (const Sample& s : c.before.samples) {
    if (cuts[index(s.move)] == 0) continue;
    before.push_back({&s, s.move, start[index(s.move)] + to_mm(s.s), s.s, false});
  }
  // A commanded move lies on its programmed move by its share of the length of all that stand for it.
  std::vector<double> from(c.commanded.size(), 0.0), total(c.programmed.size(), 0.0);
  for (std::size_t k = 0; k < c.commanded.size(); ++k) {
    double& sum = total[index(c.source[k])];
    from[k] = sum;
    if (!c.commanded[k].transition) sum += c.commanded[k].move.length();
  }
  for (const Sample& s : c.after.samples) {
    const int i = c.source[index(s.move)];
    if (cuts[index(i)] == 0) continue;
    const bool joint = c.commanded[index(s.move)].transition;
    const double way = c.programmed[index(i)].length(), sum = total[index(i)];
    const double along = sum > 0 ? (from[index(s.move)] + (joint ? 0 : s.s)) / sum * way : 0;
    after.push_back({&s, i, start[index(i)] + to_mm(along), along, joint});
  }
}

Overview overview(const Job& job, const Correction& c, const Tracks& tracks) {
  Overview out;
  report::PathPlot& plot = out.plot;
  plot.title = "The paths from above";
  std::vector<Polyline> programmed =
      programmed_lines(c, tracks, {"programmed", {}, report::kProgrammed, LineStyle::solid, 1.2});
  double bend = 0;
  for (const Dot& d : tracks.before) bend = std::max(bend, d.sample->deflection.head<2>().norm());
  out.factor = bend > 0 ? round_factor(0.05 * largest(programmed) / to_mm(bend)) : 1;

  auto outlines = stock_outline(job.stock);
  if (job.tool_frame.tilted) {  // a block, whose heights are along the tool
    const Vec3 lo = job.tool_frame.stock_in_W.min() * units::kMmPerMetre,
               hi = job.tool_frame.stock_in_W.max() * units::kMmPerMetre;
    outlines = {{{lo.x(), lo.y()}, {hi.x(), lo.y()}, {hi.x(), hi.y()}, {lo.x(), hi.y()}}};
  }
  for (const auto& outline : outlines) plot.areas.push_back({"stock", outline, Colour::muted});
  const bool fine = tracks.stretches.size() > kCrowded;
  const double stroke = fine ? 0.9 : 1.6;
  append(plot.lines, std::move(programmed));
  append(plot.lines, enlarged(c, tracks.before, out.factor,
                              {"tool tip, program as it is", {}, report::kBefore, LineStyle::solid, stroke}, bent_of));
  append(plot.lines, enlarged(c, tracks.after, out.factor,
                              {"corrected command", {}, kCommand, LineStyle::dashed, stroke}, command_of));
  append(plot.lines, enlarged(c, tracks.after, out.factor,
                              {"tool tip, corrected", {}, report::kAfter, LineStyle::solid, stroke}, bent_of));
  if (!tracks.stretches.empty()) {
    const double reach = 0.05 * std::max(largest(plot.lines), 1.0);
    const bool named = tracks.stretches.size() <= kNamedMoves;
    for (std::size_t k = 0; k < (named ? tracks.stretches.size() : 1); ++k) {
      const gcode::Move& move = c.programmed[index(tracks.stretches[k].move)];
      const double length = move.length();
      const double s = k == 0 ? 0.25 * length : 0.5 * length;
      const Vec3 d = move.direction(s);
      const Point at = from_above(move.point(s));
      plot.arrows.push_back({"", {at.x - reach * d.x(), at.y - reach * d.y()}, at, Colour::ink});
      if (named && k > 0) plot.markers.push_back({fmt::format("line {}", tracks.stretches[k].line), at, Colour::ink});
    }
    plot.markers.push_back({fmt::format("start, line {}", tracks.stretches.front().line),
                            from_above(c.programmed[index(tracks.stretches.front().move)].start), Colour::ink});
  }
  plot.note =
      fmt::format("deflection{} drawn {:g} times larger", tracks.after.empty() ? "" : " and correction", out.factor);
  return out;
}

report::Scene path_scene(const Correction& c, const Tracks& tracks, double factor, std::size_t points) {
  report::Scene scene;
  scene.title = "The paths in space";
  const auto mm = [](const Vec3& p) { return report::Point3{to_mm(p.x()), to_mm(p.y()), to_mm(p.z())}; };
  const report::Point3 gap{kNone, kNone, kNone};
  report::Line3 programmed{"programmed", {}, report::kProgrammed, 1.4};
  Vec3 end = Vec3::Constant(kNone);
  for (const Stretch& stretch : tracks.stretches) {
    const gcode::Move& move = c.programmed[index(stretch.move)];
    const auto put = [&](const report::Point3& p) {
      programmed.points.push_back(p);
      programmed.tag.push_back(stretch.line);
    };
    if (!((move.start - end).norm() < 1e-6)) {
      if (!programmed.points.empty()) put(gap);
      put(mm(move.start));
    }
    const double length = move.length();
    const int steps = move.kind == gcode::MoveKind::arc ? std::clamp(int(std::ceil(move.sweep / 0.2)), 1, 64) : 1;
    for (int k = 1; k <= steps; ++k) put(mm(move.point(length * k / steps)));
    end = move.end;
  }
  std::vector<int> line_of(c.programmed.size(), 0);
  for (const Stretch& stretch : tracks.stretches) line_of[index(stretch.move)] = stretch.line;
  const auto add_track = [&](report::Line3 line, const std::vector<Dot>& dots, Vec3 (*position)(const Dot&),
                             bool coloured) {
    // Of each group the first and the one that is farthest off: peaks survive.
    const std::size_t group = std::max<std::size_t>(1, 2 * dots.size() / std::max<std::size_t>(points, 2));
    const Dot* last = nullptr;
    const auto put = [&](const Dot& d) {
      const gcode::Move& move = c.programmed[index(d.move)];
      const bool apart =
          last != nullptr && last->move != d.move && (move.start - c.programmed[index(last->move)].end).norm() > 1e-6;
      if (apart) {
        line.points.push_back(gap);
        line.offset.push_back({});
        line.tag.push_back(0);
        if (coloured) line.value.push_back(0);
      }
      const Vec3 x = position(d), p = move.point(move.nearest(x));
      line.points.push_back(mm(p));
      line.offset.push_back(mm(x - p));
      line.tag.push_back(line_of[index(d.move)]);
      if (coloured) line.value.push_back(to_um(double(d.sample->distance)));
      last = &d;
    };
    for (std::size_t from = 0; from < dots.size(); from += group) {
      const std::size_t to = std::min(dots.size(), from + group);
      std::size_t most = from;
      for (std::size_t i = from; i < to; ++i)
        if (dots[i].sample->distance > dots[most].sample->distance) most = i;
      put(dots[from]);
      if (most != from) put(dots[most]);
    }
    if (!line.points.empty()) scene.lines.push_back(std::move(line));
  };
  thin_out(programmed, 2 * points);
  scene.lines.push_back(std::move(programmed));
  add_track({"tool tip, program as it is", {}, report::kBefore, 2.4}, tracks.before, bent_of, true);
  add_track({"corrected command", {}, kCommand, 1.4}, tracks.after, command_of, false);
  add_track({"tool tip, corrected", {}, report::kAfter, 2.4}, tracks.after, bent_of, true);
  double largest_error = 0;
  for (const auto* dots : {&tracks.before, &tracks.after})
    for (const Dot& d : *dots) largest_error = std::max(largest_error, to_um(double(d.sample->distance)));
  scene.ramp = {"distance from the programmed path", "µm", 0, std::max(largest_error, 1e-3),
                report::ColourMap::sequential};
  scene.shift = {"deflection enlarged", factor, 4 * factor};
  scene.azimuth_deg = -70;
  scene.elevation_deg = 38;
  return scene;
}

std::optional<Corner> corner(const Correction& c, const Tracks& tracks) {
  // The corner: how sharp, and how much room the moves on both sides leave.
  constexpr double kRoom = 10;  // mm
  double best = 0;
  std::size_t at = 0;
  for (std::size_t k = 0; k + 1 < tracks.stretches.size(); ++k) {
    const Stretch &a = tracks.stretches[k], &b = tracks.stretches[k + 1];
    const gcode::Move &m = c.programmed[index(a.move)], &n = c.programmed[index(b.move)];
    if ((m.end - n.start).norm() > 1e-6) continue;
    const Eigen::Vector2d in = m.direction(m.length()).head<2>(), leave = n.direction(0).head<2>();
    if (in.norm() < 0.5 || leave.norm() < 0.5) continue;
    const double turn = 1 - in.normalized().dot(leave.normalized());
    const double score = turn * std::min({a.to - a.from, b.to - b.from, kRoom});
    if (turn < 0.1 || score <= best * (1 + 1e-6)) continue;
    best = score;
    at = k;
  }
  std::vector<int> moves;
  Vec3 centre = Vec3::Zero();
  Corner out;
  const auto farthest = [](const std::vector<Dot>& dots) {
    const Dot* worst = nullptr;
    for (const Dot& d : dots) {
      if (d.sample->cutting && (worst == nullptr || d.sample->distance > worst->sample->distance)) worst = &d;
    }
    return worst;
  };
  const auto look_at = [&](const Dot& worst, const char* when) {
    moves = {worst.move};
    centre = c.programmed[index(worst.move)].point(worst.s);
    const auto stretch = std::find_if(tracks.stretches.begin(), tracks.stretches.end(),
                                      [&](const Stretch& s) { return s.move == worst.move; });
    out.title = fmt::format("Where the tool is farthest off {}, line {}, at true proportions", when, stretch->line);
  };
  const Dot* remains = c.largest_distance > c.tolerance ? farthest(tracks.after) : nullptr;
  if (remains != nullptr) {
    look_at(*remains, "after the correction");
  } else if (best > 0) {
    moves = {tracks.stretches[at].move, tracks.stretches[at + 1].move};
    centre = c.programmed[index(moves[0])].end;
    out.title = fmt::format("The corner between lines {} and {}, at true proportions", tracks.stretches[at].line,
                            tracks.stretches[at + 1].line);
  } else {
    const Dot* worst = farthest(tracks.before);
    if (worst == nullptr) return std::nullopt;
    look_at(*worst, "as the program is");
  }
  const auto of_these = [&](const std::vector<Dot>& dots) {
    std::vector<Dot> chosen;
    for (const Dot& d : dots) {
      if (std::find(moves.begin(), moves.end(), d.move) != moves.end()) chosen.push_back(d);
    }
    return chosen;
  };
  const std::vector<Dot> before = of_these(tracks.before), after = of_these(tracks.after);
  double bend = 0;
  for (const Dot& d : before) {
    if (d.sample->cutting) bend = std::max(bend, to_mm(d.sample->deflection.head<2>().norm()));
  }
  const double tube_radius = to_mm(c.tolerance);
  const double half = std::max(6 * bend, 4 * tube_radius);
  const Point middle = from_above(centre), lo{middle.x - half, middle.y - half}, hi{middle.x + half, middle.y + half};

  report::PathPlot& plot = out.plot;
  plot.title = out.title;
  plot.max_aspect = 0.6;
  const auto add_inside = [&](std::vector<Polyline> lines) {
    for (const Polyline& line : lines) {
      for (auto& piece : clip(line.points, lo, hi)) {
        Polyline part = line;
        part.points = std::move(piece);
        plot.lines.push_back(std::move(part));
      }
    }
  };
  for (const int i : moves) {
    const gcode::Move& move = c.programmed[index(i)];
    const double length = move.length();
    Polyline line{"programmed", {}, report::kProgrammed, LineStyle::solid, 1.4};
    const int steps = move.kind == gcode::MoveKind::arc ? std::clamp(int(std::ceil(move.sweep / 0.02)), 1, 1000) : 1;
    for (int k = 0; k <= steps; ++k) line.points.push_back(from_above(move.point(length * k / steps)));
    for (const auto& piece : clip(line.points, lo, hi)) {
      plot.areas.push_back({"tolerance", tube(piece, tube_radius), report::kTolerance});
    }
    add_inside({line});
  }
  add_inside(
      enlarged(c, before, 1, {"tool tip, program as it is", {}, report::kBefore, LineStyle::solid, 1.8}, bent_of));
  add_inside(enlarged(c, after, 1, {"corrected command", {}, kCommand, LineStyle::dashed, 1.4}, command_of));
  add_inside(enlarged(c, after, 1, {"tool tip, corrected", {}, report::kAfter, LineStyle::solid, 1.8}, bent_of));
  Polyline ends{"ends of the new blocks", {}, kCommand, LineStyle::points, 2.6};
  for (std::size_t k = 0; k < c.commanded.size(); ++k) {
    if (std::find(moves.begin(), moves.end(), c.source[k]) == moves.end()) continue;
    const Point p = from_above(c.commanded[k].move.end);
    if (p.x >= lo.x && p.x <= hi.x && p.y >= lo.y && p.y <= hi.y) ends.points.push_back(p);
  }
  if (!ends.points.empty()) plot.lines.push_back(std::move(ends));
  return out;
}

LinePlot error_plot(const Correction& c, const Tracks& tracks, float Sample::*error, const std::string& label) {
  const bool distance = error == &Sample::distance;
  LinePlot plot = along_the_path(tracks, label + " along the path", label, "µm");
  const auto value = [&](const Dot& d) { return to_um(d.sample->*error); };
  add(plot, tracks, series_of("program as it is", tracks.before, report::kBefore, false, value));
  add(plot, tracks, series_of("corrected", tracks.after, report::kAfter, distance, value));
  const double tube = to_um(c.tolerance);
  plot.bands.push_back({fmt::format("tolerance {}{} µm", distance ? "" : "±", report::number(tube)),
                        distance ? 0 : -tube, tube, report::kTolerance});
  return plot;
}

report::Histogram error_histogram(const Correction& c, const Tracks& tracks) {
  report::Histogram out;
  out.title = "How often which normal error occurs";
  out.x = {"normal error", "µm", {}, {}, true};
  const auto values = [](const std::vector<Dot>& dots) {
    std::vector<double> v;
    for (const Dot& d : dots) {
      if (d.sample->cutting && !d.joint) v.push_back(to_um(d.sample->normal));
    }
    return v;
  };
  out.samples = {{"program as it is", values(tracks.before), report::kBefore},
                 {"corrected", values(tracks.after), report::kAfter}};
  const double tube = to_um(c.tolerance);
  out.levels = {{report::number(-tube), -tube, report::kTolerance}, {report::number(tube), tube, report::kTolerance}};
  return out;
}

LinePlot force_plot(const Correction& c, const Tracks& tracks, const Vec3& tool_axis) {
  LinePlot plot = along_the_path(tracks, "Forces along the path", "mean force on the tool", "N");
  const auto along = [&](const Dot& d) {
    const Vec3 t = c.programmed[index(d.move)].direction(d.s);
    const Vec3 across = t - t.dot(tool_axis) * tool_axis;
    const double level = across.norm();
    return level > 0 ? d.sample->force.dot(across) / level : 0.0;
  };
  const auto normal = [](const Dot& d) { return d.sample->force.dot(d.sample->away); };
  const auto axis = [&](const Dot& d) { return d.sample->force.dot(tool_axis); };
  add(plot, tracks, series_of("normal, program as it is", tracks.before, report::kBefore, false, normal));
  add(plot, tracks, series_of("normal, corrected", tracks.after, report::kAfter, false, normal));
  const bool both = !tracks.after.empty();
  const std::vector<Dot>& shown = both ? tracks.after : tracks.before;
  const char* which = both ? "corrected" : "program as it is";
  add(plot, tracks, series_of(fmt::format("along the feed, {}", which), shown, Colour::orange, false, along));
  add(plot, tracks, series_of(fmt::format("along the axis, {}", which), shown, Colour::purple, false, axis));
  return plot;
}

LinePlot depth_plot(const Tracks& tracks) {
  LinePlot plot = along_the_path(tracks, "Depth of cut along the path", "largest axial depth", "mm");
  plot.aspect = 0.24;
  plot.y.min = 0;
  const auto depth = [](const Dot& d) { return to_mm(d.sample->depth); };
  add(plot, tracks, series_of("program as it is", tracks.before, report::kBefore, false, depth));
  add(plot, tracks, series_of("corrected", tracks.after, report::kAfter, false, depth));
  return plot;
}

LinePlot angle_plot(const Tracks& tracks) {
  LinePlot plot = along_the_path(tracks, "Engagement along the path", "tooth angle, corrected program", "deg");
  plot.y = {plot.y.label, plot.y.unit, 0.0, 180.0, true};
  plot.aspect = 0.27;
  add(plot, tracks, series_of("entry", tracks.after, Colour::sky, false, [](const Dot& d) {
        return units::to_deg(d.sample->entry);
      }));
  add(plot, tracks, series_of("exit", tracks.after, Colour::orange, false, [](const Dot& d) {
        return units::to_deg(d.sample->exit);
      }));
  return plot;
}

PartMap part_map(const Job& job, const Correction& c, const Tracks& tracks) {
  PartMap out;
  out.part = programmed_lines(c, tracks, {"", {}, Colour::ink, LineStyle::solid, 0.8});
  Point lo{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()}, hi{-lo.x, -lo.y};
  double z = 0;
  for (const Polyline& line : out.part) {
    for (const Point& p : line.points) {
      lo = {std::min(lo.x, p.x), std::min(lo.y, p.y)};
      hi = {std::max(hi.x, p.x), std::max(hi.y, p.y)};
    }
  }
  for (const Stretch& s : tracks.stretches) {
    const double weight = (s.to - s.from) / tracks.length;
    z += weight * 0.5 * to_mm(c.programmed[index(s.move)].start.z() + c.programmed[index(s.move)].end.z());
  }
  const double air = 0.15 * std::max({hi.x - lo.x, hi.y - lo.y, 10.0});
  out.x_min = lo.x - air;
  out.x_max = hi.x + air;
  out.y_min = lo.y - air;
  out.y_max = hi.y + air;
  out.z = z;
  // Many moves would hide the map: only the rectangle that they fill.
  if (tracks.stretches.size() > 4 * kCrowded) {
    out.part = {{"", {lo, {hi.x, lo.y}, hi, {lo.x, hi.y}, lo}, Colour::ink, LineStyle::solid, 0.8}};
  }
  const double width = out.x_max - out.x_min, height = out.y_max - out.y_min, longer = std::max(width, height);
  const auto count = [&](double side) { return std::clamp(int(std::lround(21 * side / longer)), 7, 21); };
  const Vec3 corner_W = units::from_mm(1) * Vec3(out.x_min, out.y_min, out.z);
  statics::PlaneGrid grid{job.X_MW * corner_W, job.X_MW.R * Vec3(units::from_mm(width), 0, 0),
                          job.X_MW.R * Vec3(0, units::from_mm(height), 0), count(width), count(height)};
  out.map = statics::compliance_map(job.machine, grid, machining::cutting_orientation(job));
  if (job.measured) {
    for (statics::MapPoint& point : out.map.points) {
      statics::Compliance& there = point.compliance;
      there.reachable = there.reachable && job.measured->map.covers(point.p_M);
      there.C.setZero();
      there.C.topLeftCorner<3, 3>() = job.measured->map.at(point.p_M);
    }
  }
  return out;
}

std::vector<std::pair<std::string, report::Figure>> compliance_panels(const Job& job, const PartMap& map) {
  std::vector<std::pair<std::string, report::Figure>> out;
  const char* axis = "xyz";
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      report::HeatMap heat;
      heat.title = fmt::format("C_{}{} round the part", axis[i], axis[j]);
      heat.x = {"x", "mm", map.x_min, map.x_max};
      heat.y = {"y", "mm", map.y_min, map.y_max};
      heat.columns = map.map.grid.columns;
      heat.rows = map.map.grid.rows;
      heat.unit = "µm/N";
      heat.levels = 7;
      heat.lines = map.part;
      for (const statics::MapPoint& point : map.map.points) {
        const Mat3 C = job.X_MW.R.transpose() * point.compliance.linear() * job.X_MW.R;
        heat.values.push_back(point.compliance.reachable ? units::to_um_per_N(C(i, j)) : kNone);
      }
      // Two colours only where there are two signs.
      const auto below = [](double v) { return v < 0; };
      const auto above = [](double v) { return v > 0; };
      const bool both = std::any_of(heat.values.begin(), heat.values.end(), below) &&
                        std::any_of(heat.values.begin(), heat.values.end(), above);
      heat.map = both ? report::ColourMap::diverging : report::ColourMap::sequential;
      out.emplace_back(fmt::format("C{}{}", axis[i], axis[j]), heat);
    }
  }
  return out;
}

JointShares joint_shares(const Job& job, const Tracks& tracks) {
  constexpr std::size_t kPoints = 2000;
  JointShares out;
  if (job.measured) return out;
  std::vector<const Dot*> cutting;
  for (const Dot& d : tracks.before) {
    if (d.sample->cutting) cutting.push_back(&d);
  }
  const std::size_t step = cutting.size() / kPoints + 1;
  std::map<int, std::pair<std::vector<double>, int>> sums;  // by move
  const std::vector<double> compliances = statics::column_compliances(job.machine);
  for (std::size_t k = 0; k < cutting.size(); k += step) {
    const Sample& s = *cutting[k]->sample;
    const Pose X_MT{machining::cutting_orientation(job, s.axes), job.X_MW * s.command};
    const std::optional<machine::JointVector> q = machining::joints_at(job, X_MT);
    if (!q) continue;
    const std::vector<Mat3> unit = statics::unit_compliances(job.machine, X_MT, *q);
    auto& [sum, count] = sums[cutting[k]->move];
    sum.resize(unit.size(), 0.0);
    const Vec3 force = job.X_MW.R * s.force, away = job.X_MW.R * s.away;
    for (std::size_t j = 0; j < unit.size(); ++j) sum[j] += to_um(away.dot(compliances[j] * unit[j] * force));
    ++count;
  }
  if (sums.empty()) return out;
  out.joints = statics::column_names(job.machine);
  out.all.assign(out.joints.size(), 0.0);
  double points = 0;
  for (const auto& [move, entry] : sums) points += entry.second;
  for (const auto& [move, entry] : sums) {
    for (std::size_t j = 0; j < entry.first.size(); ++j) out.all[j] += entry.first[j] / points;
  }
  if (tracks.stretches.size() <= kShareRows) {
    for (std::size_t k = 0; k < tracks.stretches.size(); ++k) {
      const auto it = sums.find(tracks.stretches[k].move);
      if (it == sums.end()) continue;
      std::vector<double> mean = it->second.first;
      for (double& v : mean) v /= it->second.second;
      out.by_stretch.emplace_back(static_cast<int>(k), std::move(mean));
    }
  }
  return out;
}

}  // namespace polypod::pages
