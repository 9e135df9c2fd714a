// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/cell.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "cell_film.hpp"
#include "cell_views.hpp"
#include "polypod/core/excerpt.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/report/csv.hpp"
#include "polypod/report/html.hpp"

namespace polypod::pages {
namespace {

using report::Colour;
using report::Verdict;
using units::to_mm;

constexpr double kGram = 1e-3;  // kg

/// A given number as it was given.
std::string plain(double value) {
  return fmt::format("{:.6g}", value);
}

// Views ---------------------------------------------------------------------------------------------------------------

Colour colour_of(const std::string& kind) {
  if (kind == "conveyor") return Colour::sky;
  if (kind == "pallet" || kind == "holder") return Colour::orange;
  if (kind == "table" || kind == "stand") return Colour::muted;
  if (kind == "cabinet") return Colour::purple;
  return Colour::muted;
}

// More containers than this are drawn as the points where the gripper takes them.
constexpr std::size_t kDrawnContainers = 200;

/// Solids, containers, machines at home, guards and dimensions as seen from one side.
report::PathPlot picture(const CellResult& r, const View& view, bool dimensions) {
  report::PathPlot out;
  out.title = fmt::format("{}, seen from the {}", r.cell.name, view.name);
  if (std::string(view.name) == "isometric") out.title = fmt::format("{}, isometric", r.cell.name);
  out.x_label = view.right_label;
  out.y_label = view.up_label;
  out.max_aspect = 0.75;
  const bool numbered = dimensions && view.eye.z() > 0.5;  // with numbers instead of names
  struct Shape {
    double near;  // m, towards the eye
    std::string kind;
    std::vector<report::Point> outline;
    Colour colour;
  };
  std::vector<Shape> shapes;
  for (const cell::Solid& s : cell::solids(r.cell)) {
    std::vector<report::Point> outline;
    for (const Vec3& p : s.corners()) outline.push_back(seen(view, p));
    shapes.push_back({view.eye.dot(s.middle), s.kind, hull(outline), colour_of(s.kind)});
  }
  const std::vector<cell::StandingContainer> standing = cell::standing_containers(r.cell);
  if (standing.size() <= kDrawnContainers) {
    const cell::Container* c = standing.empty() ? nullptr : &r.cell.containers[0];
    for (const cell::StandingContainer& at : standing) {
      shapes.push_back({view.eye.dot(at.bottom + Vec3(0, 0, c->height)), c->name,
                        upright(view, at.bottom, c->diameter, c->height), Colour::green});
    }
  }
  for (std::size_t m = 0; m < r.cell.machines.size(); ++m) {
    for (const cell::BaseBody& base : cell::bases(r.cell.machines[m], r.motions.home[m])) {
      shapes.push_back({view.eye.dot(0.5 * (base.from + base.to)), "bases of machines",
                        cylinder(view, base.from, base.to, base.radius), Colour::blue});
    }
  }
  std::stable_sort(shapes.begin(), shapes.end(), [](const Shape& a, const Shape& b) { return a.near < b.near; });
  std::set<std::string> named;
  for (Shape& s : shapes) {
    const std::string name = named.insert(s.kind).second ? s.kind : "";
    out.areas.push_back({name, std::move(s.outline), s.colour, true});
  }
  for (const cell::Guard& g : r.cell.guards) {
    const Vec3 up(0, 0, g.height);
    const Vec3 a(g.from.x(), g.from.y(), 0), b(g.to.x(), g.to.y(), 0);
    report::Polyline line{std::string(name_of(g.kind)),
                          {},
                          g.kind == cell::Guard::Kind::fence ? Colour::green : Colour::vermillion,
                          report::LineStyle::dashed,
                          1.5};
    for (const Vec3& p : {a, b, Vec3(b + up), Vec3(a + up), a}) line.points.push_back(seen(view, p));
    out.lines.push_back(std::move(line));
  }
  for (std::size_t m = 0; m < r.cell.machines.size(); ++m) {
    const cell::Machine& machine = r.cell.machines[m];
    const kinematics::ForwardResult f = kinematics::forward(machine.model, r.motions.home[m]);
    if (f.poses.empty()) continue;
    for (const machine::OutlinePart& part : kinematics::outline_at(machine.model, f.poses[0], r.motions.home[m])) {
      if (part.role == machine::OutlinePart::Role::joints) continue;
      report::Polyline line{"machines at home", {}, Colour::blue, report::LineStyle::solid, part.thick ? 2.6 : 1.5};
      for (const Vec3& p : part.points) line.points.push_back(seen(view, machine.X_CM * p));
      out.lines.push_back(std::move(line));
    }
    if (!numbered) out.markers.push_back({machine.name, seen(view, machine.X_CM.p), Colour::blue});
  }
  for (const cell::Conveyor& c : r.cell.conveyors) {
    out.arrows.push_back(
        {"belts", seen(view, c.point(0.1 * c.length, 0)), seen(view, c.point(0.9 * c.length, 0)), Colour::ink});
    if (!numbered) out.markers.push_back({c.name, seen(view, c.point(0.5 * c.length, 0)), Colour::ink});
  }
  for (const cell::Spot& s : r.cell.spots) {
    report::Polyline slots{"places of the gripper", {}, Colour::vermillion, report::LineStyle::points, 2};
    for (const Vec3& p : s.slots) slots.points.push_back(seen(view, p));
    out.lines.push_back(std::move(slots));
  }
  if (!dimensions) return out;
  if (numbered) {
    const std::vector<Standing> all = all_standing(r.cell);
    for (std::size_t k = 0; k < all.size(); ++k)
      out.markers.push_back({std::to_string(k + 1), seen(view, all[k].at), Colour::vermillion});
  }
  // Overall dimensions, below and at the left; those of the machines above and at the right.
  const report::Point low = seen(view, r.layout.low), high = seen(view, r.layout.high);
  const double x0 = std::min(low.x, high.x), x1 = std::max(low.x, high.x), y0 = std::min(low.y, high.y),
               y1 = std::max(low.y, high.y);
  const double step = 0.09 * std::max(x1 - x0, y1 - y0);
  const auto dimension = [&](report::Point a, report::Point b, const std::string& text) {
    const report::Point middle{(a.x + b.x) / 2, (a.y + b.y) / 2};
    out.arrows.push_back({"dimensions, mm", middle, a, Colour::muted});
    out.arrows.push_back({"", middle, b, Colour::muted});
    out.markers.push_back({text, middle, Colour::muted});
  };
  dimension({x0, y0 - step}, {x1, y0 - step}, fmt::format("{:.0f}", x1 - x0));
  dimension({x0 - step, y0}, {x0 - step, y1}, fmt::format("{:.0f}", y1 - y0));
  // Heights of belts, or distances from the corner.
  int level = 0;
  for (const cell::Machine& m : r.cell.machines) {
    const report::Point at = seen(view, m.X_CM.p);
    ++level;
    dimension({x0, y1 + level * 0.7 * step}, {at.x, y1 + level * 0.7 * step},
              fmt::format("{} {:.0f}", m.name, std::abs(at.x - x0)));
    dimension({x1 + level * 0.7 * step, y0}, {x1 + level * 0.7 * step, at.y},
              fmt::format("{} {:.0f}", m.name, std::abs(at.y - y0)));
  }
  return out;
}

/// The table of coordinates as a picture, for the drawing.
struct TablePicture {
  std::vector<std::vector<std::string>> rows;

  std::string operator()(const report::Canvas& canvas) const {
    constexpr double kRow = 17, kTop = 16;
    constexpr std::array<double, 10> kAt{0.035, 0.05, 0.32, 0.55, 0.62, 0.69, 0.77, 0.84, 0.91, 0.99};
    std::string body;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const double y = kTop + kRow * static_cast<double>(i);
      for (std::size_t k = 0; k < rows[i].size(); ++k) {
        const bool words = k == 1 || k == 2;
        body +=
            fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" class=\"{}{}\" font-size=\"11\">{}</text>\n",
                        kAt[k] * canvas.width, y, i == 0 ? "q" : "t", words ? "" : " e", report::escape(rows[i][k]));
      }
    }
    return fmt::format(
        "<svg class=\"pp\" viewBox=\"0 0 {0:.0f} {1:.0f}\" width=\"{0:.0f}\" height=\"{1:.0f}\" role=\"img\" "
        "aria-label=\"Coordinates and sizes\">\n{2}</svg>\n",
        canvas.width, kTop + kRow * static_cast<double>(rows.size()), body);
  }
};

// The Gantt chart -----------------------------------------------------------------------------------------------------

/// A text of at most so many characters of UTF-8.
std::string beginning(const std::string& text, std::size_t most) {
  return character_at(text, text.size()) <= most ? text : text.substr(0, byte_at(text, most - 1)) + "…";
}

struct Gantt {
  std::string title;
  std::vector<std::string> names;
  std::vector<const std::vector<cell::Interval>*> rows;
  double from = 0, to = 60;

  std::string operator()(const report::Canvas& canvas) const {
    constexpr double kLetter = 7;  // px, about
    constexpr std::size_t kLongest = 22;
    std::size_t longest = 0;
    for (const std::string& name : names) longest = std::max(longest, character_at(name, name.size()));
    const double left = std::max(64.0, 8 + kLetter * static_cast<double>(std::min(longest, kLongest)));
    const double right = canvas.width - 24, bar = 26, row = 46;
    const auto x = [&](double t) { return left + (t - from) / (to - from) * (right - left); };
    std::map<std::string, Colour> colours;
    constexpr std::array<Colour, 6> kOrder{Colour::blue,   Colour::orange,     Colour::green,
                                           Colour::purple, Colour::vermillion, Colour::sky};
    std::string body;
    double top = 6;
    for (std::size_t k = 0; k < rows.size(); ++k) {
      body += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" class=\"t\">{}</text>\n", 2.0, top + bar / 2 + 4,
                          report::escape(beginning(names[k], kLongest)));
      for (const cell::Interval& i : *rows[k]) {
        if (!i.busy || i.to <= from || i.from >= to) continue;
        const auto colour = colours.emplace(i.what, kOrder[colours.size() % kOrder.size()]).first->second;
        const double a = x(std::max(i.from, from)), b = x(std::min(i.to, to));
        body += fmt::format(
            "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" class=\"{} f\"><title>{}: {:.2f} to "
            "{:.2f} s</title></rect>\n",
            a, top, std::max(0.5, b - a), bar, class_name(colour), report::escape(i.what), i.from, i.to);
      }
      top += row;
    }
    for (const double t : report::nice_ticks(from, to, canvas.width < 500 ? 4 : 8)) {
      body += fmt::format(
          "<path d=\"M{0:.1f} {1:.1f}v5\" class=\"axis\"/><text x=\"{0:.1f}\" y=\"{2:.1f}\" class=\"t m\">{3}</text>\n",
          x(t), top - 12, top + 8, plain(t));
    }
    body += fmt::format(
        "<path d=\"M{:.1f} {:.1f}H{:.1f}\" class=\"axis\"/><text x=\"{:.1f}\" y=\"{:.1f}\" class=\"t e\">time, "
        "s</text>\n",
        left, top - 12, right, right, top + 26);
    double at = left, line = top + 44;
    for (const auto& [what, colour] : colours) {
      const double width = 26 + 7.0 * static_cast<double>(what.size());
      if (at + width > right && at > left) {
        at = left;
        line += 20;
      }
      body += fmt::format(
          "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"14\" height=\"10\" class=\"{} f\"/><text x=\"{:.1f}\" y=\"{:.1f}\" "
          "class=\"t\">{}</text>\n",
          at, line - 9, class_name(colour), at + 19, line, report::escape(what));
      at += width + 14;
    }
    return fmt::format(
        "<svg class=\"pp\" viewBox=\"0 0 {0:.1f} {1:.1f}\" width=\"{0:.1f}\" height=\"{1:.1f}\" role=\"img\" "
        "aria-label=\"{2}\">\n{3}</svg>\n",
        canvas.width, line + 12, report::escape(title), body);
  }
  static const char* class_name(Colour colour) {
    switch (colour) {
      case Colour::orange:
        return "c-orange";
      case Colour::green:
        return "c-green";
      case Colour::purple:
        return "c-purple";
      case Colour::vermillion:
        return "c-vermillion";
      case Colour::sky:
        return "c-sky";
      default:
        return "c-blue";
    }
  }
};

// The chart of states -------------------------------------------------------------------------------------------------

/// The five states of a cell in two rows, transitions as arrows with their conditions.
struct ChartPicture {
  cell::StateChart chart;

  std::string operator()(const report::Canvas& canvas) const {
    constexpr double kLeast = 620;  // below it the whole picture shrinks, so that words do not meet
    const double width = std::max(canvas.width, kLeast);
    const double w = 108, h = 34, top = 30, low = 130, gap = (width - 20 - 3 * w) / 2;
    const std::map<std::string, report::Point> at{{"Stopped", {10, top}},
                                                  {"Working", {10 + w + gap, top}},
                                                  {"Ending", {10 + 2 * (w + gap), top}},
                                                  {"Refill", {10 + w + gap, low}},
                                                  {"Waiting", {10 + 2 * (w + gap), low}}};
    std::string body;
    const auto text = [&](double x, double y, const char* classes, const std::string& what) {
      body +=
          fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" class=\"{}\">{}</text>\n", x, y, classes, report::escape(what));
    };
    for (const std::string& state : chart.states) {
      const report::Point p = at.at(state);
      body += fmt::format(
          "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" rx=\"6\" fill=\"none\" "
          "class=\"axis\"/>\n",
          p.x, p.y, w, h);
      text(p.x + w / 2, p.y + h / 2 + 5, "t m", state);
    }
    const auto arrow = [&](double x0, double y0, double x1, double y1) {
      const double length = std::hypot(x1 - x0, y1 - y0), dx = (x1 - x0) / length, dy = (y1 - y0) / length;
      body += fmt::format(
          "<path d=\"M{:.1f} {:.1f}L{:.1f} {:.1f}M{:.1f} {:.1f}L{:.1f} {:.1f}L{:.1f} {:.1f}\" fill=\"none\" "
          "class=\"axis\"/>\n",
          x0, y0, x1, y1, x1 - 8 * dx + 4 * dy, y1 - 8 * dy - 4 * dx, x1, y1, x1 - 8 * dx - 4 * dy,
          y1 - 8 * dy + 4 * dx);
    };
    for (const cell::Transition& t : chart.transitions) {
      const report::Point a = at.at(t.from), b = at.at(t.to);
      if (a.y == b.y) {
        arrow(a.x + w, a.y + h / 2, b.x, b.y + h / 2);
        text((a.x + w + b.x) / 2, a.y + h / 2 - 6, "t m", t.words);
      } else if (a.x == b.x) {
        const bool down = a.y < b.y;
        const double x = a.x + w / 2 + (down ? -16 : 16);
        arrow(x, down ? a.y + h : a.y, x, down ? b.y : b.y + h);
        // Beside the arrow; over the way back from Waiting near the top.
        const double y = t.from == "Ending" ? top + h + 16 : (top + h + low) / 2 + 4;
        text(down ? x - 6 : x + 6, y, down ? "t e" : "t", t.words);
      } else {
        arrow(a.x, a.y + h / 2, b.x + w, b.y + h - 6);
        text(a.x - 8, a.y + h / 2 + 16, "t e", t.words);
      }
    }
    return fmt::format(
        "<svg class=\"pp\" viewBox=\"0 0 {0:.1f} {1:.1f}\" width=\"{3:.1f}\" height=\"{4:.1f}\" role=\"img\" "
        "aria-label=\"States of the cell\">\n{2}</svg>\n",
        width, low + h + 10, body, canvas.width, (low + h + 10) * canvas.width / width);
  }
};

// The page ------------------------------------------------------------------------------------------------------------

std::string with_interval(const cell::Estimate& e, int decimals) {
  return std::isfinite(e.half_width)
             ? fmt::format("{} ± {}", report::fixed(e.mean, decimals), report::fixed(e.half_width, decimals))
             : report::fixed(e.mean, decimals);
}

void verdicts(report::Report& page, const CellResult& r) {
  if (r.problems.empty()) {
    page.add_verdict(
        Verdict::good,
        fmt::format("{} that the tasks ask for is in reach, no collision was found in {} "
                    "positions, and in {} s of simulated time no item was missed and no deadlock occurred.",
                    r.not_judged.empty() ? "Everything" : "Apart from what was not judged: everything",
                    r.layout.positions, plain(r.outcome().seconds)));
  }
  for (const cell::Problem& p : r.problems) page.add_verdict(Verdict::bad, p.kind + ": " + p.detail + ".");
}

void task_section(report::Report& page, const CellResult& r) {
  page.add_section("Task");
  if (!r.cell.description.empty()) page.add_text(r.cell.description + ".");
  std::vector<std::pair<std::string, std::string>> facts;
  for (const cell::Item& i : r.cell.items)
    facts.emplace_back(i.name, fmt::format("diameter {} mm, height {} mm, {} g", plain(to_mm(i.diameter)),
                                           plain(to_mm(i.height)), plain(i.mass / kGram)));
  for (const cell::Container& c : r.cell.containers)
    facts.emplace_back(c.name, fmt::format("holds {}, diameter {} mm, height {} mm", c.capacity,
                                           plain(to_mm(c.diameter)), plain(to_mm(c.height))));
  page.add_definitions(facts);
  report::Table table;
  table.caption = "Tasks in the order of their priority.";
  table.columns = {{"task", "", -1}, {"machine", "", -1}, {"from", "", -1}, {"to", "", -1}, {"when", "", -1}};
  for (const cell::Task& t : r.cell.tasks) {
    const auto spot = [&](int k) { return r.cell.spots[static_cast<std::size_t>(k)].name; };
    const std::string from = t.from_conveyor >= 0
                                 ? "conveyor " + r.cell.conveyors[static_cast<std::size_t>(t.from_conveyor)].name
                                 : spot(t.from);
    table.rows.push_back({t.name, r.cell.machines[static_cast<std::size_t>(t.machine)].name, from,
                          (t.via >= 0 ? spot(t.via) + ", " : "") + spot(t.to),
                          std::string(t.on_serve              ? "SERVE"
                                      : t.working && t.ending ? "work, end"
                                      : t.working             ? "work"
                                                              : "end")});
  }
  page.add_table(table);
  if (!r.assumed.empty()) {
    page.add_heading("Assumed");
    page.add_list(r.assumed);
  }
}

void layout_section(report::Report& page, const CellResult& r) {
  page.add_section("Layout");
  page.add_text(
      fmt::format("The cell takes {} × {} mm of floor, {} m². Bodies and containers were judged at rest, machines and "
                  "what they carry in {} positions "
                  "along their ways: a sample, not a proof.",
                  report::fixed(to_mm(r.layout.high.x() - r.layout.low.x()), 0),
                  report::fixed(to_mm(r.layout.high.y() - r.layout.low.y()), 0), report::fixed(r.layout.floor_area, 2),
                  r.layout.positions));
  page.add_figure(picture(r, isometric(), false), "The cell from the front left, machines at home.");
  for (const View& view : plane_views())
    page.add_figure(picture(r, view, true), fmt::format("Seen from the {}{}.", view.name,
                                                        std::string(view.name) == "top" ? ", the front below" : ""));
  const std::vector<std::vector<std::string>> places = coordinate_table(r.cell);
  report::Table where;
  where.caption =
      "Coordinates and sizes, mm and deg; the numbers are those in the view from the top. Of bodies and guards the "
      "middle, of machines where their base is; z of a guard is the floor. The origin is that of the cell.";
  for (const std::string& head : places.front()) where.columns.push_back({head, "", -1});
  for (std::size_t k = 1; k < places.size(); ++k) where.rows.emplace_back(places[k].begin(), places[k].end());
  page.add_table(where);
  if (!r.layout.conflicts.empty()) {
    report::Table table;
    table.caption = "Where machines share space. An interlock lets one in at a time.";
    table.columns = {{"machine", "", -1}, {"machine", "", -1}, {"nearest", "mm", 0}, {"interlock", "", -1}};
    for (const cell::Conflict& c : r.layout.conflicts)
      table.rows.push_back({c.first, c.second, to_mm(c.distance), c.zone.empty() ? std::string("none") : c.zone});
    page.add_table(table);
  }
  page.add_heading("Planning methods");
  page.add_text(
      fmt::format("What stations send each other ({}) scored by the methods of layout planning; machines count as "
                  "stations that everything passes.",
                  r.planning.flows_given ? "given" : "counted in the simulation, an hour"));
  report::Table table;
  table.columns = {{"method", "", -1}, {"measure", "", -1}, {"score", "", -1}, {"best", "", -1}, {"best of", "", -1}};
  for (const cell::Plan& p : r.planning.plans) {
    table.rows.push_back({p.method, p.measure, report::number(p.score, 4),
                          !p.best   ? std::string("not enumerated")
                          : p.bound ? fmt::format("{:.6g}, proven not below {}", *p.best, cell::rounded_down(*p.bound))
                                    : report::number(*p.best, 4),
                          p.best_is});
  }
  page.add_table(table);
  std::vector<std::pair<std::string, report::Figure>> panels;
  for (const cell::Plan& p : r.planning.plans) {
    report::PathPlot plot;
    plot.title = p.method;
    plot.unit = p.method == "coordinate method" ? "m" : "";
    const double most = r.planning.flows.size() > 0 ? r.planning.flows.maxCoeff() : 0;
    for (std::size_t i = 0; i < p.places.size(); ++i) {
      for (std::size_t k = i + 1; k < p.places.size(); ++k) {
        const double f = r.planning.flows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
        if (f > 0)
          plot.lines.push_back({"",
                                {{p.places[i].x(), p.places[i].y()}, {p.places[k].x(), p.places[k].y()}},
                                Colour::sky,
                                report::LineStyle::solid,
                                1 + 5 * f / most});
      }
      plot.markers.push_back({r.planning.stations[i], {p.places[i].x(), p.places[i].y()}, Colour::ink});
    }
    if (!p.places.empty()) panels.emplace_back(p.method, plot);
  }
  page.add_figure_grid(2, panels, "Layouts of the methods; the width of a line is the flow.");
  if (r.planning.chart_given) {
    report::Table chart;
    chart.caption =
        "Relationship chart: A absolutely necessary, E especially important, I important, O ordinary, U unimportant, X "
        "undesirable.";
    chart.columns = {{"station", "", -1}, {"station", "", -1}, {"closeness", "", -1}, {"reason", "", -1}};
    for (const cell::Relation& rel : r.planning.relations)
      chart.rows.push_back({r.planning.stations[static_cast<std::size_t>(rel.a)],
                            r.planning.stations[static_cast<std::size_t>(rel.b)], std::string(1, rel.closeness),
                            rel.reason});
    page.add_table(chart);
  }
}

/// Where the tool of a machine comes to at the height of one of its places, seen from above: a grid of samples.
report::PathPlot reachable(const CellResult& r, std::size_t m, std::string& caption) {
  constexpr double kStep = 0.04;  // m
  constexpr int kSteps = 24;      // either way
  const cell::Machine& machine = r.cell.machines[m];
  report::PathPlot out;
  out.title = fmt::format("Places that {} reaches", machine.name);
  report::Polyline inside{"in reach", {}, Colour::sky, report::LineStyle::points, 1.6};
  report::Polyline places{"places of its tasks", {}, Colour::vermillion, report::LineStyle::points, 2.4};
  double height = machine.home.z();
  const cell::Spot* like = nullptr;
  for (const cell::Task& t : r.cell.tasks) {
    if (t.machine != static_cast<int>(m)) continue;
    for (const int k : {t.from, t.to}) {
      if (k < 0) continue;
      const cell::Spot& s = r.cell.spots[static_cast<std::size_t>(k)];
      if (like == nullptr && t.from_conveyor < 0) like = &s;
      for (const Vec3& slot : s.slots) places.points.push_back(seen(plane_views()[1], slot));
    }
    if (t.from_conveyor < 0) continue;
    const cell::Conveyor& belt = r.cell.conveyors[static_cast<std::size_t>(t.from_conveyor)];
    const auto across = cell::across_range(r.cell, t.from_conveyor);
    height = belt.at.z() + r.cell.items[0].height;
    for (const double along : {t.window_low, t.window_high})
      for (const double side : {across ? across->first : 0.0, across ? across->second : 0.0})
        places.points.push_back(seen(plane_views()[1], belt.point(along, side)));
  }
  if (like != nullptr) height = like->slots[0].z();
  const bool turns = kinematics::task(machine.model).turns();
  for (int i = -kSteps; i <= kSteps; ++i) {
    for (int k = -kSteps; k <= kSteps; ++k) {
      const Vec3 at(machine.X_CM.p.x() + i * kStep, machine.X_CM.p.y() + k * kStep, height);
      const double heading = like != nullptr && std::isfinite(like->heading) ? like->heading : std::atan2(k, i);
      Pose X = cell::in_machine(machine, cell::tool_pose(at, like != nullptr ? like->pitch : 1.5707963267948966,
                                                         heading, like != nullptr ? like->roll : 0));
      if (!turns) X.R.setIdentity();
      if (kinematics::inverse(machine.model, X).reachable() != nullptr)
        inside.points.push_back(seen(plane_views()[1], at));
    }
  }
  caption = fmt::format(
      "{}: where the tool comes to at a height of {:.0f} mm{}, in steps of {:.0f} mm (a sample), and the places of its "
      "tasks from above.",
      machine.name, to_mm(height), like != nullptr ? fmt::format(", held as at {}", like->name) : std::string(),
      to_mm(kStep));
  out.lines = {inside, places};
  out.markers.push_back({machine.name, seen(plane_views()[1], machine.X_CM.p), Colour::blue});
  return out;
}

void machine_section(report::Report& page, const CellResult& r) {
  page.add_section("Machines");
  report::Table table;
  table.columns = {{"machine", "", -1}, {"model", "", -1}, {"family", "", -1},
                   {"x", "mm", 0},      {"y", "mm", 0},    {"z", "mm", 0}};
  for (const cell::Machine& m : r.cell.machines)
    table.rows.push_back({m.name, machine::name_of(m.model), machine::family_of(m.model), to_mm(m.X_CM.p.x()),
                          to_mm(m.X_CM.p.y()), to_mm(m.X_CM.p.z())});
  page.add_table(table);
  for (std::size_t m = 0; m < r.cell.machines.size(); ++m) {
    std::string caption;
    const report::PathPlot plot = reachable(r, m, caption);
    page.add_figure(plot, caption);
  }
  page.add_text(
      fmt::format("{} places were asked for, by the machines' own inverse kinematics and limits; {} are out of reach.",
                  r.motions.judged, r.motions.out_of_reach));
}

void cycle_section(report::Report& page, const CellResult& r) {
  page.add_section("Cycle and throughput");
  if (!r.simulated()) {
    page.add_text("The cycle was not simulated, because something is out of reach.");
    return;
  }
  const cell::Outcome& o = r.outcome();
  page.add_key_figures({{with_interval(r.study.throughput, r.study.outcomes.size() > 1 ? 2 : 1), "/min",
                         "items into containers", Verdict::neutral},
                        {fmt::format("{}", o.missed), "", "items missed", o.missed > 0 ? Verdict::bad : Verdict::good},
                        {fmt::format("{}", o.filled), "", "containers filled", Verdict::neutral},
                        {fmt::format("{}", o.served), "", "containers served", Verdict::neutral}});
  page.add_text(fmt::format(
      "Simulated: {} s, policy \"{}\", {} run{}. The figures below are of the first one; means over several runs stand "
      "with their 95 % confidence interval.",
      plain(o.seconds), r.policy, r.study.outcomes.size(), r.study.outcomes.size() == 1 ? "" : "s"));
  if (const std::optional<report::Scene> film = cell_film(r)) {
    page.add_scene(*film, fmt::format("The first run from {} to {} s of its time. When a tool is where is that of the "
                                      "simulation; its way between is a picture.",
                                      plain(o.pictures.front().time), plain(o.pictures.back().time)));
  }
  Gantt gantt;
  gantt.title = "What the machines do";
  gantt.to = std::min(o.seconds, 90.0);
  report::BarChart bars;
  bars.title = "Use of the machines";
  bars.unit = "%";
  bars.parts = {"busy"};
  std::vector<std::string> reasons;
  for (const cell::MachineUse& m : o.machines)
    for (const auto& [what, seconds] : m.waiting)
      if (std::find(reasons.begin(), reasons.end(), what) == reasons.end()) reasons.push_back(what);
  for (const std::string& what : reasons) bars.parts.push_back("waits: " + what);
  const bool stopped = std::any_of(o.machines.begin(), o.machines.end(), [](const auto& m) { return m.stopped > 0; });
  if (stopped) bars.parts.emplace_back("stopped by STOP");
  for (std::size_t m = 0; m < o.machines.size(); ++m) {
    report::BarChart::Row row{r.cell.machines[m].name, {100 * o.machines[m].busy / o.seconds}};
    for (const std::string& what : reasons) {
      double seconds = 0;
      for (const auto& [key, value] : o.machines[m].waiting)
        if (key == what) seconds = value;
      row.parts.push_back(100 * seconds / o.seconds);
    }
    if (stopped) row.parts.push_back(100 * o.machines[m].stopped / o.seconds);
    bars.rows.push_back(row);
    if (!o.machines[m].intervals.empty()) {
      gantt.names.push_back(r.cell.machines[m].name);
      gantt.rows.push_back(&o.machines[m].intervals);
    }
  }
  page.add_figure(bars, "Shares of the simulated time.");
  if (!gantt.rows.empty())
    page.add_figure(gantt,
                    fmt::format("Gantt chart of the first {} s: what each machine does; gaps are waiting or a STOP.",
                                plain(gantt.to)));
  report::Table belts;
  belts.columns = {{"conveyor", "", -1}, {"speed", "mm/s", 0}, {"runs", "%", 1}, {"most items at once", "", 0}};
  for (std::size_t b = 0; b < o.belts.size(); ++b)
    belts.rows.push_back({r.cell.conveyors[b].name, to_mm(r.cell.conveyors[b].speed),
                          100 * o.belts[b].running / o.seconds, static_cast<double>(o.belts[b].most)});
  page.add_table(belts);
  if (r.study.policies.empty()) return;
  page.add_heading("Policies of assignment");
  report::Table policies;
  policies.columns = {{"policy", "", -1}, {"items a minute", "", -1}, {"missed", "", -1}};
  for (std::size_t k = 0; k < r.study.policies.size(); ++k)
    policies.rows.push_back({r.study.policies[k].first, with_interval(r.study.policies[k].second, 2),
                             with_interval(r.study.missed_by_policy[k].second, 1)});
  page.add_table(policies);
  page.add_heading("What limits the cell");
  report::Table gains;
  gains.caption =
      "Gain of throughput where one thing is 10 % faster, with the same random numbers; the second figure holds where "
      "the first of the list is twice as fast.";
  gains.columns = {{"what", "", -1}, {"gain", "items/min", -1}, {"then", "items/min", -1}};
  for (const cell::Gain& g : r.study.gains) {
    std::string then = "";
    for (const cell::Gain& n : r.study.next_gains)
      if (n.what == g.what) then = with_interval(n.change, 2);
    gains.rows.push_back({g.what, with_interval(g.change, 2), then});
  }
  page.add_table(gains);
}

void cost_section(report::Report& page, const CellResult& r) {
  const cell::Cost& cost = r.cell.cost;
  if (cost.rows.empty()) return;
  page.add_section("Cost and parts");
  page.add_key_figures(
      {{report::fixed(cost.total(), 0), cost.currency, "parts to buy and make", Verdict::neutral},
       {report::fixed(cost.total() + cost.reserve(), 0), cost.currency, "with reserve", Verdict::neutral},
       {report::fixed(cost.hours, 0), "h", "assembly, not in the sum", Verdict::neutral}});
  report::Table table;
  table.caption = "Parts.";
  table.columns = {
      {"part", "", -1}, {"quantity", "", -1}, {"price", cost.currency, -1}, {"sum", cost.currency, -1}, {"", "", -1}};
  for (const cell::CostRow& row : cost.rows) {
    table.rows.push_back({row.name, fmt::format("{} {}", plain(row.quantity), row.unit),
                          row.stock ? std::string("") : plain(row.price),
                          row.stock ? std::string("at hand") : plain(row.sum()), row.note});
  }
  table.rows.push_back({std::string("total"), std::string(""), std::string(""), plain(cost.total()), std::string("")});
  page.add_table(table);
  if (const auto each = cell::cost_per_item(cost, r.simulated() ? r.study.throughput.mean : 0))
    page.add_text(fmt::format("Running costs {} {} an item.", report::number(*each), cost.currency));
  if (cost.hours > 0 && cost.hour_price > 0)
    page.add_text(fmt::format("Assembly at {} {} an hour costs {} {}, not in the sum.", plain(cost.hour_price),
                              cost.currency, report::fixed(cost.hours * cost.hour_price, 0), cost.currency));
}

/// Without a number where the standard has none.
std::string distance_text(const cell::Safety& safety) {
  return std::isfinite(safety.guard_needed) ? report::fixed(to_mm(safety.guard_needed), 0) : "no";
}

void safety_section(report::Report& page, const CellResult& r) {
  page.add_section("Safety");
  page.add_verdict(Verdict::neutral,
                   "This is an aid for whoever assesses the risk of the cell (ISO 12100). It is no assessment and no "
                   "proof of conformity. Check each figure against your copy of the standard.");
  page.add_key_figures(
      {{distance_text(r.safety), "mm", "largest distance that light curtain or scanner needs", Verdict::neutral},
       {report::fixed(r.safety.stopping / units::from_ms(1), 0), "ms", "until the slowest machine stands",
        Verdict::neutral}});
  page.add_text(
      "ISO 13855: S = K T + C, with the speed of approach K, the time T from the interruption to the standstill, and C "
      "for what reaches through before it is seen.");
  report::Table guards;
  guards.caption = "Guards.";
  guards.columns = {{"guard", "", -1}, {"kind", "", -1}, {"T", "ms", -1}, {"needed", "mm", 0},
                    {"is", "mm", 0},   {"rule", "", -1}, {"note", "", -1}};
  for (const cell::GuardFigure& g : r.safety.guards)
    guards.rows.push_back(
        {g.name, g.kind, g.stopping > 0 ? report::fixed(g.stopping / units::from_ms(1), 0) : std::string("–"),
         to_mm(g.needed), to_mm(g.actual), g.rule,
         (g.enough ? "far enough" : "not far enough by itself") + (g.note.empty() ? std::string("") : "; " + g.note)});
  page.add_table(guards);
  report::Table hazards;
  hazards.caption =
      "Hazards by zone, to be completed: severity S, frequency F and avoidance A are proposals of 1 or 2 (risk graph). "
      "Gaps of what moves are the least at the samples of the ways, but for the tool where it takes and puts; between "
      "the samples they may be narrower.";
  hazards.columns = {{"zone", "", -1},  {"hazard", "", -1},  {"cause", "", -1},        {"gap", "mm", -1},
                     {"S F A", "", -1}, {"measure", "", -1}, {"residual risk", "", -1}};
  for (const cell::Hazard& h : r.safety.hazards)
    hazards.rows.push_back(
        {h.zone, h.kind, h.cause,
         h.gap < 0 ? std::string("") : report::number(to_mm(h.gap)) + (h.sampled ? " (samples)" : ""),
         fmt::format("{} {} {}", h.severity, h.frequency, h.avoidance),
         h.measure.empty() ? std::string("to be given") : h.measure, std::string("to be judged")});
  page.add_table(hazards);
  std::vector<std::string> gaps;
  for (const auto& [part, gap] : cell::crushing_gaps())
    gaps.push_back(fmt::format("{} {} mm", part, plain(to_mm(gap))));
  page.add_text(fmt::format("Gaps that do not crush (ISO 13854): {}.", fmt::join(gaps, ", ")));
  page.add_text(fmt::format("Stop category {} (IEC 60204-1).", r.cell.stop_category));
  page.add_heading("Assumed");
  page.add_list(r.safety.assumed);
}

}  // namespace

std::vector<std::vector<std::string>> coordinate_table(const cell::Cell& cell) {
  std::vector<std::vector<std::string>> out{
      {"no.", "name", "kind", "x", "y", "z", "length", "width", "height", "turned"}};
  const std::vector<Standing> all = all_standing(cell);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const Standing& s = all[k];
    std::vector<std::string> row{std::to_string(k + 1), s.name, s.kind};
    for (const double x : s.at) row.push_back(plain(to_mm(x)));
    for (const double x : s.size) row.push_back(x > 0 ? plain(to_mm(x)) : "");
    row.push_back(plain(units::to_deg(s.turn)));
    out.push_back(std::move(row));
  }
  return out;
}

std::string cell_events_csv(const CellResult& result) {
  report::Csv csv({"time_s", "step", "who", "what", "detail"});
  if (result.simulated()) {
    for (const cell::Event& e : result.outcome().events) {
      constexpr double kMicroseconds = 1e6;  // more digits say nothing of a drive
      csv.add({std::round(e.time * kMicroseconds) / kMicroseconds,
               e.step > 0 ? report::Csv::Field(static_cast<double>(e.step)) : report::Csv::Field(std::string()), e.who,
               e.what, e.detail});
    }
  }
  return csv.text();
}

std::string cell_drawing(const CellResult& result) {
  report::PanelGrid grid;
  grid.title = fmt::format("{}: views with dimensions in mm", result.cell.name);
  grid.columns = 2;
  for (const View& view : plane_views()) grid.panels.emplace_back(view.name, picture(result, view, true));
  grid.panels.emplace_back("isometric", picture(result, isometric(), false));
  grid.panels.emplace_back("coordinates and sizes, mm and deg (numbers: view from the top)",
                           TablePicture{coordinate_table(result.cell)});
  return report::standalone_svg(grid, 1600);
}

std::string cell_page(const CellResult& r, const std::string& version, const std::string& command) {
  std::vector<std::pair<std::string, std::string>> facts;
  for (const cell::Machine& m : r.cell.machines) facts.emplace_back(m.name, machine::name_of(m.model));
  if (!version.empty()) facts.emplace_back("made with", "Polypod " + version);
  report::Report page("Robot cell: " + r.cell.name, r.cell.description, facts);
  page.add_section("Answer");
  verdicts(page, r);
  if (r.simulated()) {
    page.add_key_figures({{with_interval(r.study.throughput, r.study.outcomes.size() > 1 ? 2 : 1), "/min",
                           "items into containers", Verdict::neutral},
                          {report::fixed(r.cell.cost.total(), 0), r.cell.cost.currency, "parts", Verdict::neutral},
                          {distance_text(r.safety), "mm", "guard distance (ISO 13855)", Verdict::neutral}});
  }
  page.add_text(
      "Judged: reach and limits of the machines at each place, bodies and links at sampled positions, the load of arms "
      "where it is given, widths of modules, the cycle in the simulation, distances of guards. "
      "Not judged of any cell: forces and torques of drives, vibration, what a vacuum holds, items that overlap, "
      "electrics, noise, "
      "hygiene.");
  page.add_heading("Not judged of this cell");
  page.add_list(r.not_judged);
  task_section(page, r);
  layout_section(page, r);
  machine_section(page, r);
  cycle_section(page, r);
  cost_section(page, r);
  safety_section(page, r);
  page.add_section("Sequence");
  report::Table sequence;
  sequence.caption = "States and steps for the PLC; numbers are those of KOZ 5.2.2.";
  sequence.columns = {{"state", "", -1}, {"step", "", -1}, {"condition", "", -1}, {"action", "", -1}, {"next", "", -1}};
  for (const cell::SequenceRow& row : cell::sequence(r.cell))
    sequence.rows.push_back({row.state, row.step, row.condition, row.action, row.next});
  page.add_table(sequence);
  page.add_figure(ChartPicture{cell::state_chart(r.cell)},
                  "The states of the cell. STOP halts machines and belts in any of them, and START goes on. "
                  "`--sequence FILE.xml` writes this chart as PLCopen XML.");
  page.add_code("Structured Text (IEC 61131-3)", cell::structured_text(r.cell));
  if (!command.empty()) {
    page.add_section("Inputs");
    page.add_code("The command that made this page", command, false);
  }
  return page.to_html();
}

}  // namespace polypod::pages
