// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A report with one of everything, on made-up data: for the tests and for looking at.
#pragma once

#include <cmath>
#include <limits>

#include "polypod/report/html.hpp"

namespace polypod::report {

inline Report sample_report() {
  constexpr double kPi = 3.14159265358979;
  Report report("Correction of square.ngc", "LOLA 50 milling a square of 242 mm: made-up data for looking at the page",
                {{"Machine", "lola50"},
                 {"Program", "square.ngc"},
                 {"Tolerance", "100 um"},
                 {"Origin of W in M", "0, -1300, 0 mm"}});
  report.add_verdict(Verdict::good, "Every point of the corrected program ends inside the tube of 100 um.");
  report.add_verdict(Verdict::bad, "Line 12 cannot be corrected: joint 3 reaches its limit <89 deg>.");
  report.add_key_figures({{"255", "um", "mean normal error before", Verdict::bad},
                          {"4.2", "um", "mean normal error after", Verdict::good},
                          {"28", "", "segments for 4 sides"},
                          {"103", "N", "mean normal force"}});

  report.add_section("Error along the path");
  report.add_text(
      "The tool is pushed away from the part; the corrected program leads it back. \"Quotes\" & <tags> are text.");
  LinePlot error;
  error.title = "Normal error along the path before and after correction";
  error.x = {"distance along the path", "mm", {}, {}, false};
  error.y = {"normal error", "um", {}, {}, true};
  Series before{"before", {}, {}, kBefore, LineStyle::solid, 1.5},
      after{"after", {}, {}, kAfter, LineStyle::solid, 1.5};
  for (int i = 0; i <= 20000; ++i) {
    const double s = 968.0 * i / 20000;
    const int side = static_cast<int>(s / 242);
    const double t = std::fmod(s, 242) / 242;
    before.x.push_back(s);
    before.y.push_back(side % 2 == 0 ? 273 + 6 * std::sin(kPi * t) : 190 + 50 * t);
    after.x.push_back(s);
    after.y.push_back(i == 7777 ? 61 : 40 * (std::abs(std::fmod(8 * t, 1) - 0.5) - 0.25));
    if (i > 14800 && i < 15200) before.y.back() = after.y.back() = std::numeric_limits<double>::quiet_NaN();
  }
  error.series = {before, after};
  error.bands = {{"tube of 100 um", -100, 100, kTolerance}};
  error.levels = {{"measured mean without correction", 255, Colour::muted}};
  error.spans = {{"side 1", 0, 242}, {"side 2", 242, 484}, {"side 3", 484, 726}, {"side 4", 726, 968}};
  report.add_figure(error,
                    "Error normal to the programmed path, positive towards the left of the feed. Where the cutter "
                    "meets no material the line is interrupted.");

  Histogram histogram;
  histogram.title = "Share of the path by error";
  histogram.x = {"normal error", "um", {}, {}, false};
  histogram.samples = {{"before", before.y, kBefore}, {"after", after.y, kAfter}};
  histogram.levels = {{"tube", 100, kTolerance}, {"tube", -100, kTolerance}};
  report.add_figure(histogram, "How much of the path has which error.");

  report.add_section("Paths");
  PathPlot paths;
  paths.title = "Programmed, bent and corrected path";
  const std::vector<Point> square{{-121, -121}, {121, -121}, {121, 121}, {-121, 121}, {-121, -121}};
  std::vector<Point> bent, corrected;
  for (int side = 0; side < 4; ++side) {
    for (int i = 0; i <= 200; ++i) {
      const double t = i / 200.0;
      const Point a = square[static_cast<std::size_t>(side)], b = square[static_cast<std::size_t>(side) + 1];
      const double nx = (b.y - a.y) / 242, ny = -(b.x - a.x) / 242;
      const double d = 27 + 3 * std::sin(kPi * t);
      bent.push_back({a.x + t * (b.x - a.x) + d * nx, a.y + t * (b.y - a.y) + d * ny});
      corrected.push_back({a.x + t * (b.x - a.x) - d * nx, a.y + t * (b.y - a.y) - d * ny});
    }
  }
  paths.areas = {{"finished part", {{-117, -117}, {117, -117}, {117, 117}, {-117, 117}}, Colour::muted}};
  paths.lines = {{"programmed", square, kProgrammed, LineStyle::solid, 1.5},
                 {"deflected", bent, kBefore, LineStyle::solid, 1.8},
                 {"corrected", corrected, kAfter, LineStyle::dashed, 1.8}};
  paths.arrows = {{"feed", {-40, -100}, {20, -100}, Colour::muted}};
  paths.markers = {{"start", {-121, -121}, Colour::ink}};
  paths.note = "The deflection is drawn 100 times larger than it is.";
  report.add_figure(paths, "The path in the workpiece frame.");

  report.add_section("Forces and compliance");
  LinePlot force;
  force.title = "Forces along the path";
  force.x = {"distance along the path", "mm", {}, {}, false};
  force.y = {"force on the tool", "N", {}, {}, true};
  Series fn{"normal", {}, {}, Colour::blue, LineStyle::solid, 1.5},
      ff{"along the feed", {}, {}, Colour::orange, LineStyle::solid, 1.5},
      fa{"along the axis", {}, {}, Colour::purple, LineStyle::dashed, 1.5};
  for (int i = 0; i <= 400; ++i) {
    const double s = 968.0 * i / 400;
    const double on = s < 5 ? s / 5 : 1;
    fn.x.push_back(s);
    ff.x.push_back(s);
    fa.x.push_back(s);
    fn.y.push_back(110 * on);
    ff.y.push_back(5.4 * on);
    fa.y.push_back(8.5 * on);
  }
  force.series = {fn, ff, fa};
  report.add_figure(force, "Mean cutting forces per revolution.");

  HeatMap map;
  map.title = "Direct compliance C_yy";
  map.columns = 13;
  map.rows = 9;
  map.x = {"x_M", "mm", -600, 600, false};
  map.y = {"y_M", "mm", -1600, -1000, false};
  map.label = "C_yy";
  map.unit = "um/N";
  for (int j = 0; j < map.rows; ++j) {
    for (int i = 0; i < map.columns; ++i) {
      const double x = -600 + 100.0 * i, y = -1600 + 75.0 * j;
      map.values.push_back(i == 12 && j == 8 ? std::numeric_limits<double>::quiet_NaN()
                                             : 1.2 + 1e-6 * (y * y + 0.6 * x * x) -
                                                   0.4 * std::exp(-(x * x + (y + 1200) * (y + 1200)) / 4e4));
    }
  }
  map.lines = {{"",
                {{-121, -1421}, {121, -1421}, {121, -1179}, {-121, -1179}, {-121, -1421}},
                Colour::ink,
                LineStyle::solid,
                2}};
  report.add_figure(map, "Direct compliance in the plane of the part; the square is the part.");

  std::vector<std::pair<std::string, Figure>> panels;
  const char* names[] = {"x", "y", "z"};
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      HeatMap panel = map;
      panel.label = "";
      panel.levels = 6;
      panel.lines.clear();
      panel.x.label = panel.y.label = "";
      if (r != c) {
        panel.map = ColourMap::diverging;
        for (int j = 0; j < map.rows; ++j)
          for (int i = 0; i < map.columns; ++i)
            panel.values[static_cast<std::size_t>(j * map.columns + i)] = 1e-3 * (i - 6) * (r + c) * (j + 1);
      }
      panels.emplace_back(std::string("C_") + names[r] + names[c], panel);
    }
  }
  report.add_figure_grid(
      3, panels,
      "The nine compliances in um/N over x and y in mm. Direct ones on the diagonal, cross compliances beside it.");

  BarChart shares;
  shares.title = "Each joint's share of the deflection";
  shares.unit = "um";
  shares.parts = {"joint 1", "joint 2", "joint 3", "joint 4", "joint 5"};
  shares.rows = {{"force along x", {150, 12, 5, 20, 60}},
                 {"force along y", {0, 120, 80, 0, 70}},
                 {"force along z", {0, 180, 150, 0, 10}}};
  report.add_figure(shares, "Deflection under 100 N, by joint.");

  report.add_section("Tables");
  Table table;
  table.caption = "Moves";
  table.columns = {{"line", "", 0},          {"move", "", -1},        {"length", "mm", 1},
                   {"mean before", "um", 1}, {"mean after", "um", 1}, {"segments", "", 0}};
  for (int i = 0; i < 4; ++i)
    table.rows.push_back({10.0 + i, std::string("G1 <side ") + std::to_string(i + 1) + ">", 242.0, 273.4 - 40 * (i % 2),
                          -1.25 * i, 7.0});
  report.add_table(table);
  table.folded = true;
  table.caption = "The same, folded";
  report.add_table(table);
  report.add_heading("Inputs");
  report.add_definitions({{"Cutter diameter", "8 mm"},
                          {"Teeth", "4"},
                          {"Helix", "30 deg"},
                          {"Feed per tooth", "0.05 mm"},
                          {"Ktc", "1027.78 N/mm²"},
                          {"Axial depth", "2 mm"}});
  report.add_list({"One thing that was assumed.", "Another one."});
  report.add_code("The corrected program", "N10 G1 X-121.000 Y-121.000 F1600\nN20 G1 X121.020 (a < b & c)\n", false);
  return report;
}

}  // namespace polypod::report
