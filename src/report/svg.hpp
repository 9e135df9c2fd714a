// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What all pictures share: an SVG under construction, scales, axes and legends.
#pragma once

#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/report/plot.hpp"

namespace polypod::report::svg {

inline constexpr double kFont = 12;       // px, of all text in pictures
inline constexpr double kSmallFont = 11;  // px, of numbers at axes

/// Style of all pictures; colours are variables, so that a page may set them for dark ground and paper.
std::string_view css();
/// The variables of css() for light and dark ground (a rule's body each).
std::string_view light_colours();
std::string_view dark_colours();

const char* class_of(Colour colour);
const char* class_of(LineStyle style);

/// A coordinate: a tenth of a pixel, without trailing zeros.
std::string px(double x);

/// A guess of the width of a text, px.
double text_width(std::string_view text, double font = kFont);

/// Values to pixels, linear or by their logarithms (values above 0).
struct Scale {
  double from = 0, to = 1;  ///< values
  double a = 0, b = 1;      ///< pixels
  bool log = false;
  double operator()(double v) const {
    const double share = log ? std::log(v / from) / std::log(to / from) : (v - from) / (to - from);
    return a + share * (b - a);
  }
};

/// A range that holds lo..hi and has a width.
void widen(double& lo, double& hi);

/// The decimals that the step of ticks needs.
int decimals_of(const std::vector<double>& ticks);

struct LegendEntry {
  std::string name;
  Colour colour = Colour::ink;
  LineStyle style = LineStyle::solid;
  bool area = false;
  double stroke = 1.5;
  bool filled = false;    ///< areas: the full colour
  std::string fill = {};  ///< areas: this colour instead, `#rrggbb`
};

/// An SVG picture that grows from the top.
class Picture {
 public:
  Picture(const Canvas& canvas, std::string title);

  std::string body;
  double width;
  const std::string& id() const { return id_; }

  void text(double x, double y, std::string_view content, const char* classes, double font = kFont);
  void line(double x1, double y1, double x2, double y2, const char* classes);
  /// Rows of entries from x to the right edge; returns the height used.
  double legend(const std::vector<LegendEntry>& entries, double x, double y);
  /// Grid, numbers and label of an x axis below the box, and of a y axis left of it.
  void x_axis(const Scale& scale, double top, double bottom, const std::string& label, bool grid = true,
              bool counts = false);  ///< counts: ticks at whole numbers alone
  void y_axis(const Scale& scale, double left, double right, bool grid = true, bool mark_zero = false);
  /// A clip path of the box under the id `<id>-<name>`; returns its reference `url(#...)`.
  std::string clip(const char* name, double left, double top, double width, double height);

  [[nodiscard]] std::string finish(double height, const std::string& attributes = {}) const;

 private:
  std::string id_, title_;
};

/// "label, unit" (or the one that is not empty).
std::string with_unit(const std::string& label, const std::string& unit);

/// What the page's script (viewer/src/plots.ts) needs to read values off under the pointer, as attributes of the
/// picture: the kind of plot ("curves", "bins", "plane", "map"), its scales, the titles of its axes, and the unit of
/// what is read.
std::string scales_of(const char* kind, const Scale& X, const Scale& Y, const std::string& x_label,
                      const std::string& y_label, const std::string& unit);

/// The `d` of a path through points in pixels, simplified to a quarter of a pixel. A point that is not finite
/// interrupts it.
std::string path(const std::vector<Point>& points, bool closed = false);

/// The `d` of a closed outline, to a tenth of a pixel, as short as it can be written: corners that fall together are
/// one, and each is relative to the one before. Empty for less than three corners.
std::string outline(const std::vector<Point>& corners);

/// Round values in lo..hi, about `count` and at least two if any step gives two.
std::vector<double> ticks_in(double lo, double hi, int count);

/// The same for a scale: of a logarithmic one 1, 2, 5 or 1, 3 times powers of ten, or every so many of these.
std::vector<double> ticks_of(const Scale& scale, int count);

/// Numbers at the ticks of a scale.
std::vector<std::string> tick_labels(const Scale& scale, const std::vector<double>& ticks);

/// How many ticks fit.
int tick_count(double pixels, double per_tick);

/// Tick positions whose labels do not touch at this scale.
std::vector<double> x_ticks(const Scale& scale);

}  // namespace polypod::report::svg
