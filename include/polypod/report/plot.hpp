// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pictures for reports, as SVG text. A picture is plain data; calling it with a canvas draws it.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace polypod::report {

/// Where a picture is drawn: its width in CSS pixels (200 to 2000; the height follows) and a prefix for the ids in it
/// that is unique in the document. Pictures are drawn anew for narrow screens instead of being scaled, so that text
/// stays readable.
struct Canvas {
  double width = 960;
  std::string id = "p";
  bool again = false;  ///< the same picture stands wide beside this one, with the values that are read under a pointer
};

/// Anything that draws itself on a canvas: each of the structs below, or a function of one's own that returns `<svg
/// ...>`.
using Figure = std::function<std::string(const Canvas&)>;

/// Colours that stay apart for every kind of colour vision (after Okabe and Ito), on white and on dark ground. Use them
/// with one meaning through a report; the names below are those of the correction report.
enum class Colour { ink, muted, blue, vermillion, green, purple, orange, sky };
inline constexpr Colour kProgrammed = Colour::ink;
inline constexpr Colour kBefore = Colour::vermillion;  ///< deflected, uncorrected
inline constexpr Colour kAfter = Colour::blue;         ///< corrected
inline constexpr Colour kTolerance = Colour::green;

enum class LineStyle { solid, dashed, dotted, points };

struct Axis {
  std::string label;
  std::string unit;
  std::optional<double> min, max;  ///< taken from the data if not given
  bool with_zero = false;          ///< stretch a range taken from the data to hold 0
  bool counts = false;             ///< of an x axis: numbers that count things, ticks at whole ones alone
  bool downwards = false;          ///< of the y axis of a colour map: grows from the top to the bottom
  bool log = false;                ///< of curves and points: by the logarithm, where all values are above 0
};

struct Series {
  std::string name;
  std::vector<double> x, y;  ///< as many y as x; a y that is not finite interrupts the line
  Colour colour = Colour::blue;
  LineStyle style = LineStyle::solid;
  double stroke = 1.5;  ///< px; also the radius of points
};

/// A horizontal band, e.g. a tolerance: lo <= y <= hi.
struct Band {
  std::string name;
  double lo = 0, hi = 0;
  Colour colour = kTolerance;
};

/// A line across the plot at one value, with its name beside it.
struct Level {
  std::string name;
  double value = 0;
  Colour colour = Colour::muted;
};

/// A part of the x axis with a name, e.g. one move: every second one is shaded and each has its name above the plot
/// where they are few; more (up to LinePlot::kMostSpans) are picked and read under the pointer alone.
struct Span {
  std::string name;
  double from = 0, to = 0;
};

/// Curves over a common x axis. Series of more points than pixels keep the first, last, least and greatest value of
/// each pixel column (where x never decreases), so that peaks survive. Cost: linear in the points.
struct LinePlot {
  std::string title;  ///< for screen readers and as the picture's tooltip
  Axis x, y;
  std::vector<Series> series;
  std::vector<Band> bands;
  std::vector<Level> levels;    ///< at values of y
  std::vector<Level> x_levels;  ///< at values of x
  std::vector<Span> spans;
  double aspect = 0.36;  ///< height over width, of the wide drawing; narrow ones are a little taller
  static constexpr std::size_t kMostSpans = 2000;

  std::string operator()(const Canvas& canvas) const;
};

struct Point {
  double x = 0, y = 0;
};

struct Polyline {
  std::string name;  ///< in the legend once for all polylines of the same name; empty: not in the legend
  std::vector<Point> points;
  Colour colour = Colour::blue;
  LineStyle style = LineStyle::solid;
  double stroke = 1.5;  ///< px
};

struct Area {
  std::string name;
  std::vector<Point> outline;
  Colour colour = Colour::muted;
  bool solid = false;  ///< its edge: that of a body, or dashed
};

struct Arrow {
  std::string name;
  Point from, to;
  Colour colour = Colour::ink;
};

struct Marker {
  std::string label;
  Point at;
  Colour colour = Colour::ink;
};

/// Lines in a plane with equal scales on both axes and a scale bar. Lines are simplified to a quarter of a pixel.
struct PathPlot {
  std::string title;
  std::string x_label = "x", y_label = "y", unit = "mm";
  std::vector<Area> areas;
  std::vector<Polyline> lines;
  std::vector<Arrow> arrows;
  std::vector<Marker> markers;
  std::string note;          ///< under the picture, e.g. "the deflection is drawn 100 times larger"
  double max_aspect = 0.66;  ///< height over width is at most this

  std::string operator()(const Canvas& canvas) const;
};

/// A reading at a place of a map.
struct Dot {
  Point at;
  double value = 0;  ///< filled with its colour in the map's scale; not finite: a small dot without colour
};

enum class ColourMap {
  sequential,  ///< dark blue to yellow, lightness grows evenly
  diverging    ///< blue, light grey at zero, red; the range is made symmetric round 0
};

/// Values over a grid as bands of colour with contour lines. Values that are not finite are left blank: a cell with one
/// such corner is drawn as the triangle of the others, with more it is left out.
struct HeatMap {
  std::string title;
  Axis x, y;  ///< min and max are the coordinates of the first and last column and row (default: 0 .. count - 1)
  int columns = 0, rows = 0;
  std::vector<double> values;      ///< row by row, columns fastest, the first row at y.min
  std::string label, unit;         ///< of the values
  std::optional<double> min, max;  ///< of the colours
  ColourMap map = ColourMap::sequential;
  /// What each value is of, e.g. which limit stops a motion: an index into `kinds` a point, negative for none (grey).
  /// The colour then says the kind and its depth the value, light to dark. Empty: `map` alone colours.
  std::vector<int> kind;
  std::vector<std::string> kinds;  ///< at most kKindColours names, for the legend (those that occur)
  bool blank_below = false;        ///< leave blank what is below `min`, along a smooth line
  int levels = 10;                 ///< about so many bands
  bool contour_labels = true;
  bool equal_scales = true;     ///< x and y are lengths of one unit
  std::vector<Polyline> lines;  ///< drawn over the map
  /// Closed lines: the map is drawn only inside them (where they cross or nest, by the even-odd rule). Values a step
  /// beyond then make the map run up to the line. Empty: everywhere.
  std::vector<std::vector<Point>> clip;
  std::vector<Marker> markers;
  std::vector<Dot> dots;

  std::string operator()(const Canvas& canvas) const;
};

struct Sample {
  std::string name;
  std::vector<double> values;
  Colour colour = Colour::blue;
};

/// Share of the values (per cent) in bins of equal, round width; samples are drawn as outlines over each other.
struct Histogram {
  std::string title;
  Axis x;
  std::vector<Sample> samples;
  int bins = 30;  ///< about
  std::vector<Level> levels;

  std::string operator()(const Canvas& canvas) const;
};

/// One horizontal bar a row, made of parts, e.g. each joint's share of a deflection.
struct BarChart {
  struct Row {
    std::string label;
    std::vector<double> parts;  ///< one a name of `parts`, >= 0
  };
  std::string title;
  std::string unit;
  std::vector<std::string> parts;  ///< an empty name is not in the legend
  std::vector<Row> rows;

  std::string operator()(const Canvas& canvas) const;
};

/// Pictures side by side as one, each under its title, row by row.
struct PanelGrid {
  std::string title;
  int columns = 3;
  std::vector<std::pair<std::string, Figure>> panels;

  std::string operator()(const Canvas& canvas) const;
};

/// A picture as an SVG file of its own, with its style.
std::string standalone_svg(const Figure& figure, double width = 960);

/// `&`, `<`, `>`, `"` and `'` as character references; control characters that XML forbids become U+FFFD.
std::string escape(std::string_view text);

/// A number for a person: `digits` significant digits, no exponent between 1e-3 and 1e6, a true minus sign, thin spaces
/// between thousands; "n/a" where it is not finite.
std::string number(double value, int digits = 3);
/// The same with a fixed number of decimals.
std::string fixed(double value, int decimals);

/// Round values that cover lo..hi with about `count` steps of 1, 2 or 5 times a power of ten; ends outside are left
/// out.
std::vector<double> nice_ticks(double lo, double hi, int count);

/// Colour of t in 0..1 as `#rrggbb`.
std::string colour_at(ColourMap map, double t);

/// Hues that stay apart when they are lightened or darkened, for kinds 0 .. kKindColours - 1 (later ones repeat,
/// negative ones are grey), at a lightness of 0 (black) to 1 (white), as `#rrggbb`.
inline constexpr int kKindColours = 8;
std::string kind_colour(int kind, double lightness);

}  // namespace polypod::report
