// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Curves, paths, histograms and bars.
#include "polypod/report/plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <set>

#include "packed.hpp"
#include "svg.hpp"

namespace polypod::report {
namespace {

using svg::LegendEntry;
using svg::Picture;
using svg::px;
using svg::Scale;

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNarrow = 520;           // px: below this pictures are drawn taller
constexpr double kRight = 14;             // px, margin
constexpr std::size_t kNamedSpans = 24;   // parts of an axis that get their names above the plot
constexpr std::size_t kShadedSpans = 60;  // parts that are told apart at all

/// Grows over the finite numbers that it is given.
struct Range {
  double lo = kInf, hi = -kInf;
  void add(double v) {
    if (!std::isfinite(v)) return;
    lo = std::min(lo, v);
    hi = std::max(hi, v);
  }
};

/// The range of an axis: its own ends where given, else the data's with some air.
void settle(Range& range, const Axis& axis, double air) {
  if (axis.with_zero) range.add(0);
  if (axis.log && range.lo > 0 && std::isfinite(range.hi)) {
    const double by = std::pow(std::max(range.hi / range.lo, 1.05), air);
    range.lo = axis.min && *axis.min > 0 ? *axis.min : range.lo / by;
    range.hi = axis.max && *axis.max > range.lo ? *axis.max : range.hi * by;
    return;
  }
  svg::widen(range.lo, range.hi);
  const double pad = air * (range.hi - range.lo);
  range.lo = axis.min && std::isfinite(*axis.min) ? *axis.min : range.lo - pad;
  range.hi = axis.max && std::isfinite(*axis.max) ? *axis.max : range.hi + pad;
  if (!(range.lo < range.hi)) svg::widen(range.lo, range.hi);
}

double label_margin(const Range& y, double pixels, bool log = false) {
  double widest = 0;
  const Scale scale{y.lo, y.hi, 0, pixels, log};
  for (const std::string& label : svg::tick_labels(scale, svg::ticks_of(scale, svg::tick_count(pixels, 36))))
    widest = std::max(widest, svg::text_width(label, svg::kSmallFont));
  return std::clamp(widest, 16.0, 90.0) + 12;
}

bool never_decreases(const std::vector<double>& x) {
  for (std::size_t i = 1; i < x.size(); ++i) {
    if (!(x[i] >= x[i - 1])) return false;
  }
  return true;
}

/// The points of a series that are drawn. Where it has many more points than pixel columns, each column keeps the
/// first, the last, the least and the greatest.
std::vector<std::size_t> thinned(const Series& series, const Scale& X) {
  const std::size_t n = std::min(series.x.size(), series.y.size());
  std::vector<std::size_t> out;
  const double columns = std::abs(X.b - X.a) + 1;
  const bool thin = static_cast<double>(n) > 4 * columns && never_decreases(series.x);
  if (!thin) {
    for (std::size_t i = 0; i < n; ++i) out.push_back(i);
    return out;
  }
  std::size_t i = 0;
  while (i < n) {
    if (!std::isfinite(series.y[i])) {
      out.push_back(i++);
      continue;
    }
    const double column = std::floor(X(series.x[i]));
    const std::size_t first = i;
    std::size_t least = i, greatest = i;
    for (; i < n && std::isfinite(series.y[i]) && std::floor(X(series.x[i])) == column; ++i) {
      if (series.y[i] < series.y[least]) least = i;
      if (series.y[i] > series.y[greatest]) greatest = i;
    }
    std::set<std::size_t> kept{first, least, greatest, i - 1};
    out.insert(out.end(), kept.begin(), kept.end());
  }
  return out;
}

/// `values`: what the page's script reads, as attributes.
void draw_points(Picture& picture, const std::vector<Point>& points, const std::string& name, Colour colour,
                 double radius, const std::string& values = "") {
  std::set<std::pair<long, long>> drawn;  // one dot a pixel
  std::string d;
  for (const Point& p : points) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y)) continue;
    if (!drawn.emplace(std::lround(p.x), std::lround(p.y)).second) continue;
    d += fmt::format("M{} {}h0", px(p.x), px(p.y));
  }
  picture.body += fmt::format("<path d=\"{}\" class=\"{} l\" style=\"stroke-width:{}\" data-dots=\"{}\"{}/>\n", d,
                              svg::class_of(colour), px(2 * radius), escape(name), values);
}

LegendEntry entry_of(const Series& s) {
  return {s.name, s.colour, s.style, false, s.stroke};
}

}  // namespace

namespace {
/// The values of a curve or of dots, for the page's script to read them off and to save them: of a short one all, of a
/// longer one those that are drawn, as float32; of what cannot be thinned none.
std::string values_of(const Series& s, const std::vector<std::size_t>& drawn) {
  constexpr std::size_t kMost = 1500, kMostPacked = 10000;
  if (drawn.empty() || drawn.size() > kMostPacked) return "";
  if (drawn.size() > kMost) {
    Packed packed;
    for (const std::size_t i : drawn) {
      packed.add(static_cast<float>(s.x[i]));
      packed.add(static_cast<float>(s.y[i]));
    }
    return fmt::format(" data-f=\"{}\"", packed.text());
  }
  std::string out = " data-v=\"";
  for (const std::size_t i : drawn) {
    out += out.back() == '"' ? "" : ";";
    out += std::isfinite(s.x[i]) && std::isfinite(s.y[i]) ? fmt::format("{:.9g},{:.9g}", s.x[i], s.y[i]) : "-";
  }
  return out + '"';
}
}  // namespace

std::string LinePlot::operator()(const Canvas& canvas) const {
  Picture picture(canvas, title);
  Range xr, yr;
  for (const Series& s : series) {
    const std::size_t n = std::min(s.x.size(), s.y.size());
    for (std::size_t i = 0; i < n; ++i) {
      xr.add(s.x[i]);
      yr.add(s.y[i]);
    }
  }
  for (const Band& b : bands) {
    yr.add(b.lo);
    yr.add(b.hi);
  }
  for (const Level& l : levels) yr.add(l.value);
  for (const Level& l : x_levels) xr.add(l.value);
  for (const Span& s : spans) {
    xr.add(s.from);
    xr.add(s.to);
  }
  const bool log_x = x.log && xr.lo > 0, log_y = y.log && yr.lo > 0;
  settle(xr, x, 0);
  settle(yr, y, 0.06);

  std::vector<LegendEntry> entries;
  for (const Series& s : series) {
    if (!s.name.empty()) entries.push_back(entry_of(s));
  }
  for (const Band& b : bands) {
    if (!b.name.empty()) entries.push_back({b.name, b.colour, LineStyle::solid, true, 1});
  }

  const double plot_height =
      std::max(120.0, picture.width * (picture.width < kNarrow ? std::max(aspect, 0.55) : aspect) - 40);
  const double left = label_margin(yr, plot_height, log_y);
  const std::string y_label = svg::with_unit(y.label, y.unit), x_label = svg::with_unit(x.label, x.unit);
  double top = picture.legend(entries, left, 2);
  if (!y_label.empty()) {
    picture.text(2, top + 13, y_label, "q");
    top += 20;
  }
  const bool spans_named = spans.size() <= kNamedSpans &&
                           std::any_of(spans.begin(), spans.end(), [](const Span& s) { return !s.name.empty(); });
  top += spans_named ? 20 : 6;
  const double bottom = top + plot_height, right = picture.width - kRight;
  const Scale X{xr.lo, xr.hi, left, right, log_x}, Y{yr.lo, yr.hi, bottom, top, log_y};

  for (std::size_t i = 0; i < spans.size(); ++i) {
    const double a = std::clamp(X(std::min(spans[i].from, spans[i].to)), left, right);
    const double b = std::clamp(X(std::max(spans[i].from, spans[i].to)), left, right);
    if (i % 2 == 0 && spans.size() <= kShadedSpans) {
      picture.body += fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" class=\"shade\"/>\n", px(a),
                                  px(top), px(b - a), px(plot_height));
    }
  }
  picture.x_axis(X, top, bottom, x_label, true, x.counts);
  picture.y_axis(Y, left, right, true, true);
  const std::string clip = picture.clip("box", left, top - 1, right - left, plot_height + 2);
  picture.body += fmt::format("<g clip-path=\"{}\">\n", clip);
  for (const Band& b : bands) {
    const double a = Y(std::max(b.lo, b.hi)), c = Y(std::min(b.lo, b.hi));
    const char* colour = svg::class_of(b.colour);
    picture.body += fmt::format(
        "<g class=\"{0}\"><rect x=\"{1}\" y=\"{2}\" width=\"{3}\" height=\"{4}\" class=\"a\"/>"
        "<path d=\"M{1} {2}H{5}M{1} {6}H{5}\" class=\"edge\"/></g>\n",
        colour, px(left), px(a), px(right - left), px(c - a), px(right), px(c));
  }
  for (const Series& s : series) {
    const std::vector<std::size_t> drawn = thinned(s, X);
    std::vector<Point> points;
    points.reserve(drawn.size());
    for (const std::size_t i : drawn) points.push_back({X(s.x[i]), Y(s.y[i])});
    const std::string values = canvas.again ? "" : values_of(s, drawn);
    if (s.style == LineStyle::points) {
      draw_points(picture, points, s.name, s.colour, s.stroke, values);
      continue;
    }
    picture.body += fmt::format("<path d=\"{}\" class=\"{} l{}\" style=\"stroke-width:{}\" data-name=\"{}\"{}/>\n",
                                svg::path(points), svg::class_of(s.colour), svg::class_of(s.style), px(s.stroke),
                                escape(s.name), values);
  }
  for (const Level& l : levels) {
    picture.body += fmt::format("<path d=\"M{} {}H{}\" class=\"{} l dash\" style=\"stroke-width:1.2\"/>\n", px(left),
                                px(Y(l.value)), px(right), svg::class_of(l.colour));
  }
  for (const Level& l : x_levels) {
    picture.body += fmt::format("<path d=\"M{} {}V{}\" class=\"{} l dash\" style=\"stroke-width:1.2\"/>\n",
                                px(X(l.value)), px(top), px(bottom), svg::class_of(l.colour));
  }
  picture.body += "</g>\n";
  for (const Level& l : levels) {
    const double at = Y(l.value);
    if (!(at >= top && at <= bottom)) continue;
    const std::string classes = fmt::format("{} c e h", svg::class_of(l.colour));
    picture.text(right - 4, at < top + 16 ? at + 13 : at - 5, l.name, classes.c_str(), svg::kSmallFont);
  }
  for (const Level& l : x_levels) {
    const double at = X(l.value);
    if (!(at >= left && at <= right)) continue;
    const bool before = at + svg::text_width(l.name) > right - 8;
    const std::string classes = fmt::format("{} c h{}", svg::class_of(l.colour), before ? " e" : "");
    picture.text(before ? at - 5 : at + 5, top + 12, l.name, classes.c_str(), svg::kSmallFont);
  }
  for (const Span& s : spans) {
    const double a = std::max(left, X(std::min(s.from, s.to))), b = std::min(right, X(std::max(s.from, s.to)));
    if (spans_named && b - a > svg::text_width(s.name, svg::kSmallFont) + 8) {
      picture.text((a + b) / 2, top - 5, s.name, "q m", svg::kSmallFont);
    }
  }
  // Parts of the x axis with a name: the script shows a part in all curves when it is picked in one.
  std::string parts;
  for (const Span& s : spans)
    if (!s.name.empty() && !canvas.again && spans.size() <= LinePlot::kMostSpans)
      parts += fmt::format("{}{}:{:.7g}:{:.7g}", parts.empty() ? "" : ";", escape(s.name), s.from, s.to);
  return picture.finish(bottom + (x_label.empty() ? 24 : 42),
                        svg::scales_of("curves", X, Y, x_label, y_label, y.unit) +
                            (parts.empty() ? "" : fmt::format(" data-spans=\"{}\"", parts)));
}

std::string PathPlot::operator()(const Canvas& canvas) const {
  Picture picture(canvas, title);
  Range xr, yr;
  const auto add = [&](const Point& p) {
    xr.add(p.x);
    yr.add(p.y);
  };
  for (const Area& a : areas) std::for_each(a.outline.begin(), a.outline.end(), add);
  for (const Polyline& l : lines) std::for_each(l.points.begin(), l.points.end(), add);
  for (const Arrow& a : arrows) {
    add(a.from);
    add(a.to);
  }
  for (const Marker& m : markers) add(m.at);
  svg::widen(xr.lo, xr.hi);
  svg::widen(yr.lo, yr.hi);
  const double air = 0.04 * std::max(xr.hi - xr.lo, yr.hi - yr.lo);
  xr = {xr.lo - air, xr.hi + air};
  yr = {yr.lo - air, yr.hi + air};

  std::vector<LegendEntry> entries;
  std::set<std::string> named;
  const auto enter = [&](LegendEntry entry) {
    if (!entry.name.empty() && named.insert(entry.name).second) entries.push_back(std::move(entry));
  };
  for (const Polyline& l : lines) enter({l.name, l.colour, l.style, false, l.stroke});
  for (const Arrow& a : arrows) enter({a.name, a.colour, LineStyle::solid, false, 1.5});
  for (const Area& a : areas) enter({a.name, a.colour, LineStyle::solid, true, 1});

  const double left = label_margin(yr, 300);
  double top = picture.legend(entries, left, 2);
  picture.text(2, top + 13, svg::with_unit(y_label, unit), "q");
  top += 26;
  // Equal scales: whichever of width and height is scarce decides.
  const double room_x = picture.width - left - kRight;
  const double room_y = picture.width * (picture.width < kNarrow ? std::max(1.0, max_aspect) : max_aspect) - 60;
  const double per_unit = std::min(room_x / (xr.hi - xr.lo), room_y / (yr.hi - yr.lo));
  double plot_height = std::max(60.0, per_unit * (yr.hi - yr.lo));
  const double grow_x = (room_x / per_unit - (xr.hi - xr.lo)) / 2;
  const double grow_y = (plot_height / per_unit - (yr.hi - yr.lo)) / 2;
  const double bottom = top + plot_height, right = left + room_x;
  const Scale X{xr.lo - grow_x, xr.hi + grow_x, left, right};
  const Scale Y{yr.lo - grow_y, yr.hi + grow_y, bottom, top};

  picture.x_axis(X, top, bottom, svg::with_unit(x_label, unit));
  picture.y_axis(Y, left, right);
  picture.line(left, top, left, bottom, "axis");
  picture.body += fmt::format("<g clip-path=\"{}\">\n", picture.clip("box", left, top, room_x, plot_height));
  const auto to_pixels = [&](const std::vector<Point>& points) {
    std::vector<Point> out;
    out.reserve(points.size());
    for (const Point& p : points) out.push_back({X(p.x), Y(p.y)});
    return out;
  };
  for (const Area& a : areas) {
    picture.body +=
        fmt::format("<path d=\"{}\" class=\"{} a edge{}\" data-area=\"{}\"/>\n", svg::path(to_pixels(a.outline), true),
                    svg::class_of(a.colour), a.solid ? "" : " dash", escape(a.name));
  }
  for (const Polyline& l : lines) {
    const std::vector<Point> points = to_pixels(l.points);
    if (l.style == LineStyle::points) {
      draw_points(picture, points, l.name, l.colour, l.stroke);
      continue;
    }
    picture.body +=
        fmt::format("<path d=\"{}\" class=\"{} l{}\" style=\"stroke-width:{}\" data-name=\"{}\"/>\n", svg::path(points),
                    svg::class_of(l.colour), svg::class_of(l.style), px(l.stroke), escape(l.name));
  }
  for (const Arrow& a : arrows) {
    const Point from{X(a.from.x), Y(a.from.y)}, to{X(a.to.x), Y(a.to.y)};
    const double dx = to.x - from.x, dy = to.y - from.y, length = std::hypot(dx, dy);
    if (!(length > 0.5)) continue;
    const double head = std::min(7.0, length), ux = dx / length, uy = dy / length;
    const Point base{to.x - head * ux, to.y - head * uy};
    picture.body += fmt::format(
        "<g class=\"{}\"><path d=\"M{} {}L{} {}\" class=\"l\" style=\"stroke-width:1.3\"/>"
        "<path d=\"M{} {}L{} {}L{} {}Z\" class=\"f\"/></g>\n",
        svg::class_of(a.colour), px(from.x), px(from.y), px(base.x), px(base.y), px(to.x), px(to.y),
        px(base.x - 0.4 * head * uy), px(base.y + 0.4 * head * ux), px(base.x + 0.4 * head * uy),
        px(base.y - 0.4 * head * ux));
  }
  picture.body += "</g>\n";
  for (const Marker& m : markers) {
    const double mx = X(m.at.x), my = Y(m.at.y);
    picture.body += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"3.5\" class=\"{} f\"/>\n", px(mx), px(my),
                                svg::class_of(m.colour));
    const bool before = mx + svg::text_width(m.label) + 10 > right;
    picture.text(before ? mx - 7 : mx + 7, my - 6, m.label, before ? "t h e" : "t h");
  }

  // The scale bar: the largest round length that takes at most a quarter of the width.
  const std::vector<double> lengths = nice_ticks(0, 0.25 * room_x / per_unit, 1);
  if (lengths.size() > 1) {
    const double length = lengths[1], x0 = right - 12 - length * per_unit, y0 = bottom - 10;
    picture.body +=
        fmt::format("<path d=\"M{0} {1}v-6m0 3H{2}m0 -3v6\" class=\"c-ink l\"/>\n", px(x0), px(y0), px(right - 12));
    picture.text((x0 + right - 12) / 2, y0 - 8, fmt::format("{} {}", number(length, 3), unit), "t m h",
                 svg::kSmallFont);
  }
  double height = bottom + 40;
  if (!note.empty()) {
    picture.text(left, height + 10, note, "q");
    height += 20;
  }
  return picture.finish(
      height, svg::scales_of("plane", X, Y, svg::with_unit(x_label, unit), svg::with_unit(y_label, unit), unit));
}

std::string Histogram::operator()(const Canvas& canvas) const {
  Picture picture(canvas, title);
  Range xr;
  for (const Sample& s : samples) std::for_each(s.values.begin(), s.values.end(), [&](double v) { xr.add(v); });
  for (const Level& l : levels) xr.add(l.value);
  settle(xr, x, 0);
  const std::vector<double> ticks = nice_ticks(xr.lo, xr.hi, std::clamp(bins, 2, 500));
  const double step = ticks.size() > 1 ? ticks[1] - ticks[0] : xr.hi - xr.lo;
  const double air = x.min || x.max ? 0 : step;  // an empty bin at each end, so that the bars do not touch the frame
  const double first = std::floor(xr.lo / step + 1e-9) * step - air;
  const int count = std::max(1, static_cast<int>(std::ceil((xr.hi + air - first) / step - 1e-9)));
  xr = {first, first + count * step};

  std::vector<std::vector<double>> shares;
  double tallest = 0;
  for (const Sample& s : samples) {
    std::vector<double> share(static_cast<std::size_t>(count), 0.0);
    double total = 0;
    for (const double v : s.values) {
      if (!std::isfinite(v)) continue;
      total += 1;
      const double bin = std::floor((v - first) / step);
      if (bin < -0.5 || bin > count) continue;  // outside an axis with ends of its own
      share[static_cast<std::size_t>(std::min(bin, count - 1.0))] += 1;
    }
    for (double& v : share) {
      v *= total > 0 ? 100 / total : 0;
      tallest = std::max(tallest, v);
    }
    shares.push_back(std::move(share));
  }

  std::vector<LegendEntry> entries;
  entries.reserve(samples.size());
  for (const Sample& s : samples) entries.push_back({s.name, s.colour, LineStyle::solid, true, 1});
  const Range yr{0, tallest > 0 ? 1.08 * tallest : 1};
  const double left = label_margin(yr, 200);
  double top = picture.legend(entries, left, 2);
  picture.text(2, top + 13, "fraction, %", "q");
  top += 26;
  const double plot_height = std::max(120.0, picture.width * (picture.width < kNarrow ? 0.5 : 0.3) - 40);
  const double bottom = top + plot_height, right = picture.width - kRight;
  const Scale X{xr.lo, xr.hi, left, right}, Y{yr.lo, yr.hi, bottom, top};
  const std::string x_label = svg::with_unit(x.label, x.unit);
  picture.x_axis(X, top, bottom, x_label, false);
  picture.y_axis(Y, left, right);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    std::string d;
    for (int i = 0; i < count; ++i) {
      const double share = shares[k][static_cast<std::size_t>(i)];
      const bool first_of_run = i == 0 || !(shares[k][static_cast<std::size_t>(i) - 1] > 0);
      const bool last_of_run = i + 1 == count || !(shares[k][static_cast<std::size_t>(i) + 1] > 0);
      if (!(share > 0)) continue;
      if (first_of_run) d += fmt::format("M{} {}", px(X(first + i * step)), px(bottom));
      d += fmt::format("V{}H{}", px(Y(share)), px(X(first + (i + 1) * step)));
      if (last_of_run) d += fmt::format("V{}", px(bottom));
    }
    std::string values;
    for (int i = 0; i < count && !canvas.again; ++i) {
      values += fmt::format("{}{:.9g},{:.6g}", i > 0 ? ";" : "", first + (i + 0.5) * step,
                            shares[k][static_cast<std::size_t>(i)]);
    }
    picture.body += fmt::format(
        "<g class=\"{0}\"><path d=\"{1}\" class=\"a\"/><path d=\"{1}\" class=\"l\" data-name=\"{2}\" "
        "data-v=\"{3}\"/></g>\n",
        svg::class_of(samples[k].colour), d, escape(samples[k].name), values);
  }
  for (const Level& l : levels) {
    const double at = X(l.value);
    if (!(at >= left && at <= right)) continue;
    picture.body += fmt::format("<path d=\"M{} {}V{}\" class=\"{} l dash\" style=\"stroke-width:1.2\"/>\n", px(at),
                                px(top), px(bottom), svg::class_of(l.colour));
    const bool before = at + svg::text_width(l.name) > right - 8;
    const std::string classes = fmt::format("{} c h{}", svg::class_of(l.colour), before ? " e" : "");
    picture.text(before ? at - 5 : at + 5, top + 12, l.name, classes.c_str(), svg::kSmallFont);
  }
  return picture.finish(bottom + (x_label.empty() ? 24 : 42),
                        svg::scales_of("bins", X, Y, x_label, "fraction, %", "%"));
}

std::string BarChart::operator()(const Canvas& canvas) const {
  constexpr Colour kOrder[] = {Colour::blue, Colour::orange,     Colour::green, Colour::purple,
                               Colour::sky,  Colour::vermillion, Colour::muted, Colour::ink};
  Picture picture(canvas, title);
  std::vector<LegendEntry> entries;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    if (parts[k].empty()) continue;
    entries.push_back({parts[k], kOrder[k % std::size(kOrder)], LineStyle::solid, true, 1, true});
  }
  double widest_label = 0, largest = 0;
  std::vector<double> totals;
  for (const Row& row : rows) {
    widest_label = std::max(widest_label, svg::text_width(row.label));
    double total = 0;
    for (const double v : row.parts) total += std::isfinite(v) && v > 0 ? v : 0;
    totals.push_back(total);
    largest = std::max(largest, total);
  }
  // Labels that would take more than two fifths of the width stand above their bars.
  constexpr double kRow = 30, kBar = 20, kBesideLabel = 12, kLine = 18, kShare = 0.4;
  const bool above = widest_label + kBesideLabel > kShare * picture.width;
  const double left = above ? 0 : widest_label + kBesideLabel;
  double top = picture.legend(entries, left, 2) + 4;
  double widest_total = 60;  // room for the total behind the longest bar
  for (const double total : totals) {
    widest_total = std::max(widest_total, svg::text_width(number(total) + " " + unit));
  }
  const double right = picture.width - widest_total - 14;
  const Scale X{0, largest > 0 ? largest : 1, left, right};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (above) {
      picture.text(left, top + kBar / 2 + 4, rows[i].label, "t");
      top += kLine;
    } else {
      picture.text(left - 8, top + kBar / 2 + 4, rows[i].label, "t e");
    }
    double at = 0;
    for (std::size_t k = 0; k < rows[i].parts.size(); ++k) {
      const double part = rows[i].parts[k];
      if (!(part > 0) || !std::isfinite(part)) continue;
      std::string told = rows[i].label;
      if (k < parts.size() && !parts[k].empty()) told += ", " + parts[k];
      picture.body +=
          fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" class=\"{} f\" data-tip=\"{}: {} {}\"/>\n",
                      px(X(at)), px(top), px(X(at + part) - X(at)), px(kBar),
                      svg::class_of(kOrder[k % std::size(kOrder)]), escape(told), number(part, 5), escape(unit));
      at += part;
    }
    picture.text(X(at) + 7, top + kBar / 2 + 4, fmt::format("{} {}", number(totals[i], 3), unit), "t");
    top += kRow;
  }
  return picture.finish(top);
}

std::string PanelGrid::operator()(const Canvas& canvas) const {
  constexpr double kGap = 18, kTitle = 20;
  Picture picture(canvas, title);
  const int across = std::max(1, columns);
  const double panel_width = (picture.width - kGap * (across - 1)) / across;
  double top = 0, tallest = 0;
  for (std::size_t k = 0; k < panels.size(); ++k) {
    const int column = static_cast<int>(k) % across;
    if (column == 0 && k > 0) {
      top += tallest + kGap;
      tallest = 0;
    }
    const double left = column * (panel_width + kGap);
    const std::string drawn = panels[k].second(Canvas{panel_width, fmt::format("{}-{}", picture.id(), k + 1)});
    // The panel becomes a group: an SVG inside an SVG would take its width from the page's style.
    const std::size_t box = drawn.find("viewBox=\"0 0 "), open = drawn.find('>'), close = drawn.rfind("</svg>");
    if (box == std::string::npos || open == std::string::npos || close == std::string::npos) continue;
    const double height = std::strtod(drawn.c_str() + drawn.find(' ', box + 13) + 1, nullptr);
    if (!panels[k].first.empty()) picture.text(left + 2, top + 13, panels[k].first, "t");
    picture.body += fmt::format("<g transform=\"translate({} {})\">{}</g>\n", px(left), px(top + kTitle),
                                drawn.substr(open + 1, close - open - 1));
    tallest = std::max(tallest, kTitle + height);
  }
  return picture.finish(top + tallest);
}

}  // namespace polypod::report
