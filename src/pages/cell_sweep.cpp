// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The page of a sweep over cells.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "polypod/pages/cell.hpp"
#include "polypod/report/html.hpp"
#include "polypod/report/parallel.hpp"

namespace polypod::pages {
namespace {

using report::number;

std::string in_words(const cell::Sweep& s, const cell::SweepRow& row) {
  std::string out;
  for (std::size_t a = 0; a < s.axes.size(); ++a)
    out += fmt::format("{}{} = {:g}", out.empty() ? "" : ", ", s.axes[a].key, row.values[a]);
  return out;
}

std::string estimate_text(const cell::Estimate& e) {
  return std::isfinite(e.half_width) ? fmt::format("{} ± {}", report::fixed(e.mean, 2), report::fixed(e.half_width, 2))
                                     : report::fixed(e.mean, 1);
}

double rate_of(const cell::SweepRow& row) {
  return row.simulated ? row.throughput.mean : std::numeric_limits<double>::quiet_NaN();
}

/// Throughput over one number.
report::LinePlot along(const cell::Sweep& s) {
  report::LinePlot plot;
  plot.title = "Throughput over " + s.axes[0].key;
  plot.x = {s.axes[0].key, "", {}, {}};
  plot.y = {"items", "1/min", {}, {}};
  report::Series line{"throughput", {}, {}, report::Colour::muted, report::LineStyle::solid, 1.2};
  report::Series good{"no problem found", {}, {}, report::Colour::green, report::LineStyle::points, 3};
  report::Series bad{"a problem", {}, {}, report::Colour::vermillion, report::LineStyle::points, 3};
  for (const cell::SweepRow& row : s.rows) {
    if (!row.simulated) continue;
    for (report::Series* to : {&line, row.problems.empty() ? &good : &bad}) {
      to->x.push_back(row.values[0]);
      to->y.push_back(row.throughput.mean);
    }
  }
  for (const report::Series& series : {line, good, bad})
    if (!series.x.empty()) plot.series.push_back(series);
  return plot;
}

/// Throughput over two numbers, with a dot at each combination that has a problem.
report::HeatMap over(const cell::Sweep& s) {
  report::HeatMap map;
  map.title = "Throughput";
  const auto axis = [](const cell::SweepAxis& a) { return report::Axis{a.key, "", a.values.front(), a.values.back()}; };
  map.x = axis(s.axes[1]);
  map.y = axis(s.axes[0]);
  map.columns = static_cast<int>(s.axes[1].values.size());
  map.rows = static_cast<int>(s.axes[0].values.size());
  map.label = "items";
  map.unit = "1/min";
  map.equal_scales = false;
  for (const cell::SweepRow& row : s.rows) {
    map.values.push_back(rate_of(row));
    if (!row.problems.empty())
      map.dots.push_back({{row.values[1], row.values[0]}, std::numeric_limits<double>::quiet_NaN()});
  }
  if (s.best)
    map.markers.push_back({"best", {s.rows[*s.best].values[1], s.rows[*s.best].values[0]}, report::Colour::ink});
  return map;
}

/// Each combination as a line across its numbers and its throughput.
report::ParallelPlot across(const cell::Sweep& s) {
  report::ParallelPlot plot;
  plot.title = "Combinations and their throughput";
  for (const cell::SweepAxis& a : s.axes) plot.axes.push_back({a.key, a.values.front(), a.values.back(), false});
  double low = std::numeric_limits<double>::infinity(), high = -low;
  report::ParallelPlot::Group good{"no problem found", report::Colour::green, 1.0, {}};
  report::ParallelPlot::Group bad{"a problem", report::Colour::muted, 0.7, {}};
  report::ParallelPlot::Group best{"best", report::Colour::vermillion, 2.4, {}};
  for (std::size_t i = 0; i < s.rows.size(); ++i) {
    const cell::SweepRow& row = s.rows[i];
    if (!row.simulated) continue;
    low = std::min(low, row.throughput.mean);
    high = std::max(high, row.throughput.mean);
    std::vector<double> line = row.values;
    line.push_back(row.throughput.mean);
    (s.best == i ? best : row.problems.empty() ? good : bad).lines.push_back(std::move(line));
  }
  plot.axes.push_back({"items a minute", low, high, false});
  for (auto* group : {&bad, &good, &best})
    if (!group->lines.empty()) plot.groups.push_back(*group);
  return plot;
}

}  // namespace

std::string cell_sweep_page(const cell::Sweep& s, const std::string& version, const std::string& command) {
  std::vector<std::pair<std::string, std::string>> facts{{"cell", s.name},
                                                         {"combinations", fmt::format("{}", s.rows.size())}};
  if (!version.empty()) facts.emplace_back("made with", "Polypod " + version);
  report::Report page("Sweep of the cell: " + s.name, "The cell with each combination of numbers", facts);
  page.add_section("Answer");
  if (s.best) {
    const cell::SweepRow& row = s.rows[*s.best];
    page.add_verdict(report::Verdict::neutral,
                     fmt::format("Of the {} combinations that were run, the one with the largest throughput and no "
                                 "problem is {}: {} items a minute.",
                                 s.rows.size(), in_words(s, row), estimate_text(row.throughput)));
  } else {
    page.add_verdict(report::Verdict::bad, fmt::format("Each of the {} combinations has a problem.", s.rows.size()));
  }
  for (const cell::SweepAxis& a : s.axes)
    page.add_text(
        fmt::format("{}: {} values from {:g} to {:g}.", a.key, a.values.size(), a.values.front(), a.values.back()));
  page.add_text(fmt::format(
      "Each combination was judged as by the command polypod cell alone, in {} of simulated time and {} run{}, all "
      "with "
      "the same random numbers. Numbers between those of the sweep were not judged, nor what the page of a cell lists "
      "as not judged.",
      s.seconds > 0 ? fmt::format("{:g} s", s.seconds) : std::string("the time of each"), s.seeds,
      s.seeds == 1 ? "" : "s"));
  constexpr std::size_t kMapped = 4;  // from fewer values colours between them would say more than is known
  if (s.axes.size() > 0 && std::any_of(s.rows.begin(), s.rows.end(), [](const auto& r) { return r.simulated; })) {
    if (s.axes.size() == 1)
      page.add_figure(along(s), "Throughput by the number. Points in red have a problem.");
    else if (s.axes.size() == 2 && s.axes[0].values.size() >= kMapped && s.axes[1].values.size() >= kMapped)
      page.add_figure(over(s),
                      "Throughput over both numbers, between the combinations interpolated. A dot marks a combination "
                      "with a problem; what is blank was not simulated.");
    else
      page.add_figure(across(s), "Each line is a combination, across its numbers and its throughput.");
  }
  page.add_section("Combinations");
  report::Table table;
  for (const cell::SweepAxis& a : s.axes) table.columns.push_back({a.key, "", -1});
  const bool price = std::any_of(s.rows.begin(), s.rows.end(), [](const auto& r) { return r.cost_per_item; });
  table.columns.push_back({"throughput", "1/min", -1});
  table.columns.push_back({"missed a run", "", -1});
  if (price) table.columns.push_back({"cost an item", "", -1});
  table.columns.push_back({"floor", "m²", 2});
  table.columns.push_back({"problems", "", -1});
  for (const cell::SweepRow& row : s.rows) {
    std::vector<report::Cell> cells;
    for (const double v : row.values) cells.emplace_back(fmt::format("{:g}", v));
    cells.emplace_back(row.simulated ? estimate_text(row.throughput) : std::string("not simulated"));
    cells.emplace_back(row.simulated ? number(row.missed) : std::string(""));
    if (price) cells.emplace_back(row.cost_per_item ? number(*row.cost_per_item) : std::string(""));
    cells.emplace_back(row.floor_area);
    std::string problems;  // by their kinds: the command alone says what and where
    for (const cell::Problem& p : row.problems)
      if (problems.find(p.kind) == std::string::npos) problems += (problems.empty() ? "" : ", ") + p.kind;
    cells.emplace_back(problems);
    table.rows.push_back(std::move(cells));
  }
  page.add_table(table);
  if (!command.empty()) {
    page.add_section("Inputs");
    page.add_code("The command that made this page", command, false);
  }
  return page.to_html();
}

}  // namespace polypod::pages
