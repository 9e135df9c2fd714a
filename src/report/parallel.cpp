// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/parallel.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "packed.hpp"
#include "svg.hpp"

namespace polypod::report {
namespace {

using svg::Picture;
using svg::px;
using svg::Scale;

constexpr double kNarrow = 620;  // px: below this the axes lie across

Scale scale_of(const ParallelPlot::Axis& axis, double low, double high) {
  double lo = axis.min, hi = axis.max;
  svg::widen(lo, hi);
  const bool log = axis.log && lo > 0;
  return axis.downwards ? Scale{lo, hi, high, low, log} : Scale{lo, hi, low, high, log};
}

/// The end of an axis with as many digits as tell it from the other.
std::string end_text(const ParallelPlot::Axis& axis, double value) {
  const double span = std::abs(axis.max - axis.min), size = std::max(std::abs(axis.max), std::abs(axis.min));
  const int digits = span > 0 ? static_cast<int>(std::ceil(std::log10(std::max(1.0, size / span)))) + 3 : 4;
  return number(value, std::min(digits, 8));
}

}  // namespace

std::string ParallelPlot::operator()(const Canvas& canvas) const {
  Picture picture(canvas, title);
  std::vector<svg::LegendEntry> entries;
  for (const Group& g : groups)
    if (!g.name.empty()) entries.push_back({g.name, g.colour, LineStyle::solid, false, std::max(1.5, g.stroke)});
  const bool across = picture.width < kNarrow;
  const std::size_t n = axes.size();
  double top = picture.legend(entries, 2, 2) + 8;
  constexpr double kSide = 8, kRow = 46;
  const double height = across ? kRow * static_cast<double>(n) : std::max(220.0, 0.36 * picture.width);
  // Names of neighbouring axes stand at two heights.
  if (!across) top += 38;
  double widest = 40;
  for (const Axis& axis : axes) widest = std::max(widest, svg::text_width(axis.label));
  const double margin =
      across ? kSide : std::min(0.5 * widest, 0.5 * picture.width / static_cast<double>(n + 1)) + kSide;
  const double bottom = top + height;
  const auto place = [&](std::size_t i) {
    const double share = n > 1 ? static_cast<double>(i) / static_cast<double>(n - 1) : 0.5;
    return across ? top + 22 + kRow * static_cast<double>(i) : margin + share * (picture.width - 2 * margin);
  };
  std::vector<Scale> scales;
  for (const Axis& axis : axes)
    scales.push_back(across ? scale_of(axis, kSide, picture.width - kSide) : scale_of(axis, bottom, top));
  for (const Group& g : groups) {
    std::string d;
    Packed values;
    for (const std::vector<double>& line : g.lines) {
      for (std::size_t i = 0; i < n; ++i)
        values.add(i < line.size() ? static_cast<float>(line[i]) : std::numeric_limits<float>::quiet_NaN());
      std::vector<Point> points;
      for (std::size_t i = 0; i < std::min(n, line.size()); ++i) {
        const double at = scales[i](line[i]);
        points.push_back(across ? Point{at, place(i)} : Point{place(i), at});
      }
      d += svg::path(points);
    }
    picture.body +=
        fmt::format("<path d=\"{}\" class=\"{} l\" style=\"stroke-width:{};stroke-opacity:.75\"{}/>\n", d,
                    svg::class_of(g.colour), px(g.stroke),
                    canvas.again ? "" : fmt::format(" data-group=\"{}\" data-f=\"{}\"", escape(g.name), values.text()));
  }
  for (std::size_t i = 0; i < n; ++i) {
    const Axis& axis = axes[i];
    const double at = place(i);
    if (across) {
      picture.line(kSide, at, picture.width - kSide, at, "axis");
      picture.text(picture.width / 2, at - 6, axis.label, "q m");
      picture.text(kSide, at + 14, end_text(axis, axis.downwards ? axis.max : axis.min), "q h", svg::kSmallFont);
      picture.text(picture.width - kSide, at + 14, end_text(axis, axis.downwards ? axis.min : axis.max), "q e h",
                   svg::kSmallFont);
      continue;
    }
    picture.line(at, top, at, bottom, "axis");
    picture.text(at, top - (i % 2 == 0 ? 24 : 40), axis.label, "q m");
    picture.text(at, top - 6, end_text(axis, axis.downwards ? axis.min : axis.max), "q m h", svg::kSmallFont);
    picture.text(at, bottom + 15, end_text(axis, axis.downwards ? axis.max : axis.min), "q m h", svg::kSmallFont);
  }
  // What the pointer reads: the axes as x0 .. x1, what is on which pixel, and their names.
  std::string axes_text, names;
  for (std::size_t i = 0; i < n; ++i) {
    axes_text += fmt::format("{}{} {} {} {} {}{}", i > 0 ? ";" : "", px(place(i)), scales[i].from, scales[i].to,
                             px(scales[i].a), px(scales[i].b), scales[i].log ? " log" : "");
    names += (i > 0 ? "|" : "") + axes[i].label;
  }
  return picture.finish(bottom + (across ? 8 : 24),
                        fmt::format(" data-plot=\"parallel\" data-axes=\"{}\" data-names=\"{}\"{}", axes_text,
                                    escape(names), across ? " data-across=\"1\"" : ""));
}

}  // namespace polypod::report
