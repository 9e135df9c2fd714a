// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "svg.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace polypod::report {

std::string escape(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        if (static_cast<unsigned char>(c) < 0x20 && c != '\n' && c != '\t' && c != '\r') {
          out += "\xEF\xBF\xBD";
        } else {
          out += c;
        }
    }
  }
  return out;
}

namespace {

constexpr const char* kMinus = "\xE2\x88\x92";
constexpr const char* kThinSpace = "\xE2\x80\x89";

/// Plain digits (as printf gives them) with a true minus sign and thin spaces between thousands.
std::string dressed(std::string plain) {
  const bool negative = plain.starts_with('-');
  if (negative) plain.erase(0, 1);
  const bool zero = plain.find_first_of("123456789") == std::string::npos;
  const std::size_t end = std::min(plain.find_first_of(".e"), plain.size());
  std::string out = negative && !zero ? kMinus : "";
  for (std::size_t i = 0; i < plain.size(); ++i) {
    if (i > 0 && i < end && end > 4 && (end - i) % 3 == 0) out += kThinSpace;
    out += plain[i];
  }
  return out;
}

}  // namespace

std::string fixed(double value, int decimals) {
  if (!std::isfinite(value)) return "n/a";
  return dressed(fmt::format("{:.{}f}", value, std::clamp(decimals, 0, 15)));
}

std::string number(double value, int digits) {
  if (!std::isfinite(value)) return "n/a";
  if (value == 0) return "0";
  digits = std::clamp(digits, 1, 15);
  // The exponent after rounding: 999.9 with three digits is 1.00e3.
  const std::string scientific = fmt::format("{:.{}e}", value, digits - 1);
  const int exponent = std::stoi(scientific.substr(scientific.find('e') + 1));
  if (exponent < -3 || exponent >= 6) {
    const std::string mantissa = scientific.substr(0, scientific.find('e'));
    return dressed(mantissa) + "e" + (exponent < 0 ? kMinus : "") + std::to_string(std::abs(exponent));
  }
  return fixed(value, std::max(0, digits - 1 - exponent));
}

std::vector<double> nice_ticks(double lo, double hi, int count) {
  std::vector<double> ticks;
  if (!(hi > lo) || !std::isfinite(hi - lo)) return ticks;
  const double rough = (hi - lo) / std::max(1, count);
  const double power = std::pow(10, std::floor(std::log10(rough)));
  const double ratio = rough / power;
  // The step that is nearest on a logarithmic scale: the bounds are sqrt 2, sqrt 10, sqrt 50.
  const double step = power * (ratio < 1.4142 ? 1 : ratio < 3.1623 ? 2 : ratio < 7.0711 ? 5 : 10);
  constexpr double kSlack = 1e-9;  // a bound that is a tick up to rounding is one
  const double first = std::ceil(lo / step - kSlack), last = std::floor(hi / step + kSlack);
  if (!(step > 0) || last - first > 1000) return ticks;
  for (double i = first; i <= last; ++i) ticks.push_back(i == 0 ? 0 : i * step);
  return ticks;
}

namespace svg {

std::string_view light_colours() {
  return "--ground:#ffffff;--panel:#f5f7f9;--rule:#d5dae0;--ink:#1a1f26;--muted:#5d6875;--grid:#e4e8ec;"
         "--blue:#0072b2;--vermillion:#d05400;--green:#008a63;--purple:#a8508a;--orange:#b97f00;--sky:#3a96cc;";
}
std::string_view dark_colours() {
  return "--ground:#15181c;--panel:#1e2328;--rule:#3a424b;--ink:#e8ebee;--muted:#a2acb7;--grid:#2c333a;"
         "--blue:#57aeea;--vermillion:#ff8649;--green:#3cc79d;--purple:#e096c3;--orange:#f0b541;--sky:#93d4f7;";
}

std::string_view css() {
  return R"(svg.pp{display:block;width:100%;height:auto;font-family:inherit;font-size:12px}
svg.pp text{fill:var(--ink)}
svg.pp .c-ink{--c:var(--ink)} svg.pp .c-muted{--c:var(--muted)} svg.pp .c-blue{--c:var(--blue)}
svg.pp .c-vermillion{--c:var(--vermillion)} svg.pp .c-green{--c:var(--green)} svg.pp .c-purple{--c:var(--purple)}
svg.pp .c-orange{--c:var(--orange)} svg.pp .c-sky{--c:var(--sky)}
svg.pp .l{fill:none;stroke:var(--c);stroke-width:1.5;stroke-linejoin:round;stroke-linecap:round}
svg.pp .dash{stroke-dasharray:6 4;stroke-linecap:butt} svg.pp .dot{stroke-dasharray:1 4}
svg.pp .f{fill:var(--c);stroke:none} svg.pp .a{fill:var(--c);fill-opacity:.14;stroke:none}
svg.pp .edge{stroke:var(--c);stroke-width:1}svg.pp .edge.dash{stroke-dasharray:4 3}
svg.pp .grid{stroke:var(--grid);stroke-width:1} svg.pp .axis{stroke:var(--muted);stroke-width:1}
svg.pp .shade{fill:var(--muted);fill-opacity:.07}
svg.pp text.n{fill:var(--muted);font-variant-numeric:tabular-nums} svg.pp text.q{fill:var(--muted)}
svg.pp text.e{text-anchor:end} svg.pp text.m{text-anchor:middle}
svg.pp text.h{paint-order:stroke;stroke:var(--ground);stroke-width:3px;stroke-linejoin:round}
svg.pp text.c{fill:var(--c)} svg.pp .contour{fill:none;stroke:#000;stroke-opacity:.45;stroke-width:.7}
svg.pp text.on{fill:#000;fill-opacity:.8;text-anchor:middle;paint-order:stroke;stroke:#fff;stroke-opacity:.55;stroke-width:2.5px}
)";
}

const char* class_of(Colour colour) {
  switch (colour) {
    case Colour::ink:
      return "c-ink";
    case Colour::muted:
      return "c-muted";
    case Colour::blue:
      return "c-blue";
    case Colour::vermillion:
      return "c-vermillion";
    case Colour::green:
      return "c-green";
    case Colour::purple:
      return "c-purple";
    case Colour::orange:
      return "c-orange";
    case Colour::sky:
      return "c-sky";
  }
  return "c-ink";
}

const char* class_of(LineStyle style) {
  switch (style) {
    case LineStyle::dashed:
      return " dash";
    case LineStyle::dotted:
      return " dot";
    case LineStyle::solid:
    case LineStyle::points:
      break;
  }
  return "";
}

std::string px(double x) {
  if (!std::isfinite(x)) return "0";
  constexpr double kFar = 1e6;  // far beyond any picture; keeps what is off the canvas short
  const double rounded = std::round(std::clamp(x, -kFar, kFar) * 10) / 10;
  return rounded == 0 ? "0" : fmt::format("{:.6g}", rounded);
}

double text_width(std::string_view text, double font) {
  double width = 0;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xC0) == 0x80) continue;  // one width a character of UTF-8
    width += c == 'i' || c == 'l' || c == '.' || c == ',' || c == ' ' || c == '\'' ? 0.32
             : c == 'm' || c == 'w' || c == 'M' || c == 'W'                        ? 0.86
             : byte >= 'A' && byte <= 'Z'                                          ? 0.67
                                                                                   : 0.56;
  }
  return width * font;
}

void widen(double& lo, double& hi) {
  if (!(lo <= hi)) {  // no data at all
    lo = 0;
    hi = 1;
  }
  const double size = std::max(std::abs(lo), std::abs(hi));
  if (hi - lo > 1e-12 * size && hi > lo) return;
  const double by = size > 0 ? 0.05 * size : 0.5;
  lo -= by;
  hi += by;
}

int decimals_of(const std::vector<double>& ticks) {
  if (ticks.size() < 2) return 2;
  const double step = ticks[1] - ticks[0];
  return std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 12);
}

int tick_count(double pixels, double per_tick) {
  return std::max(2, static_cast<int>(pixels / per_tick));
}

std::string with_unit(const std::string& label, const std::string& unit) {
  if (unit.empty()) return label;
  return label.empty() ? unit : label + ", " + unit;
}

/// All with the same decimals, or all with an exponent where they are long; on a logarithmic scale each as it is short.
std::vector<std::string> tick_labels(const Scale& scale, const std::vector<double>& ticks) {
  std::vector<std::string> labels;
  labels.reserve(ticks.size());
  if (scale.log) {
    for (const double t : ticks)
      labels.push_back(t >= 1e-3 && t < 1e6 ? fixed(t, std::max(0, static_cast<int>(std::ceil(-std::log10(t) - 1e-9))))
                                            : number(t, 1));
    return labels;
  }
  const int decimals = decimals_of(ticks);
  double largest = 0;
  for (const double t : ticks) largest = std::max(largest, std::abs(t));
  const bool exponent = largest >= 1e6 || (largest > 0 && largest < 1e-3);
  for (const double t : ticks) labels.push_back(exponent ? number(t, 3) : fixed(t, decimals));
  return labels;
}

std::vector<double> ticks_of(const Scale& scale, int count) {
  const double lo = std::min(scale.from, scale.to), hi = std::max(scale.from, scale.to);
  if (!scale.log) return ticks_in(lo, hi, count);
  const int first = static_cast<int>(std::floor(std::log10(lo))), last = static_cast<int>(std::floor(std::log10(hi)));
  std::vector<double> ticks;
  const auto take = [&](const std::vector<double>& of_decade, int each) {
    ticks.clear();
    for (int k = first; k <= last; ++k) {
      if (k % each != 0) continue;
      for (const double m : of_decade) {
        const double t = m * std::pow(10, k);
        if (t >= lo * (1 - 1e-9) && t <= hi * (1 + 1e-9)) ticks.push_back(t);
      }
    }
    return static_cast<int>(ticks.size()) <= std::max(2, count);
  };
  for (const auto& of_decade : {std::vector<double>{1, 2, 5}, {1, 3}, {1}})
    if (take(of_decade, 1)) return ticks.size() < 2 ? ticks_in(lo, hi, count) : ticks;
  for (int each = 2; each < 20; ++each)
    if (take({1}, each)) return ticks;
  return ticks;
}

std::vector<double> ticks_in(double lo, double hi, int count) {
  std::vector<double> ticks;
  for (int n = std::max(1, count); n <= count + 8; ++n) {
    ticks = nice_ticks(lo, hi, n);
    if (ticks.size() > 1) break;
  }
  return ticks;
}

std::vector<double> x_ticks(const Scale& scale) {
  constexpr double kWished = 70, kGap = 12;  // px between ticks, and between their labels
  for (int count = tick_count(std::abs(scale.b - scale.a), kWished); count >= 1; --count) {
    std::vector<double> ticks = ticks_of(scale, count);
    if (ticks.size() < 2) break;
    double widest = 0, least = std::abs(scale(ticks[1]) - scale(ticks[0]));
    for (std::size_t i = 2; i < ticks.size(); ++i)
      least = std::min(least, std::abs(scale(ticks[i]) - scale(ticks[i - 1])));
    for (const std::string& label : tick_labels(scale, ticks)) widest = std::max(widest, text_width(label, kSmallFont));
    if (least > widest + kGap) return ticks;
  }
  // A narrow picture: the outermost two of them, which leave each other room.
  const std::vector<double> ticks = ticks_of(scale, 1);
  if (ticks.size() < 2) return ticks;
  return {ticks.front(), ticks.back()};
}

Picture::Picture(const Canvas& canvas, std::string title)
    : width(std::clamp(canvas.width, 200.0, 2000.0)), id_(canvas.id), title_(std::move(title)) {}

void Picture::text(double x, double y, std::string_view content, const char* classes, double font) {
  body += fmt::format("<text x=\"{}\" y=\"{}\" class=\"{}\"{}>{}</text>\n", px(x), px(y), classes,
                      font == kFont ? "" : fmt::format(" font-size=\"{}\"", px(font)), escape(content));
}

void Picture::line(double x1, double y1, double x2, double y2, const char* classes) {
  body += fmt::format("<path d=\"M{} {}L{} {}\" class=\"{}\"/>\n", px(x1), px(y1), px(x2), px(y2), classes);
}

double Picture::legend(const std::vector<LegendEntry>& entries, double x, double y) {
  constexpr double kSwatch = 22, kGap = 18, kRow = 18;
  if (entries.empty()) return 0;
  double at = x, row = y;
  for (const LegendEntry& entry : entries) {
    const double wide = kSwatch + 6 + text_width(entry.name);
    if (at > x && at + wide > width - 4) {
      at = x;
      row += kRow;
    }
    const double middle = row + 8;
    if (entry.area && !entry.fill.empty()) {
      body += fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"11\" rx=\"2\" fill=\"{}\"/>\n", px(at),
                          px(middle - 5.5), px(kSwatch), entry.fill);
    } else if (entry.area) {
      body += fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"10\" class=\"{} {}\"/>\n", px(at),
                          px(middle - 5), px(kSwatch), class_of(entry.colour), entry.filled ? "f" : "a edge");
    } else if (entry.style == LineStyle::points) {
      body += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\" class=\"{} f\"/>\n", px(at + kSwatch / 2), px(middle),
                          px(std::max(2.5, entry.stroke)), class_of(entry.colour));
    } else {
      body += fmt::format("<path d=\"M{} {}h{}\" class=\"{} l{}\" style=\"stroke-width:{}\"/>\n", px(at), px(middle),
                          px(kSwatch), class_of(entry.colour), class_of(entry.style), px(std::max(1.5, entry.stroke)));
    }
    text(at + kSwatch + 6, middle + 4, entry.name, "t");
    at += wide + kGap;
  }
  return row - y + kRow + 4;
}

void Picture::x_axis(const Scale& scale, double top, double bottom, const std::string& label, bool grid, bool counts) {
  std::vector<double> ticks = x_ticks(scale);
  if (counts) {
    std::erase_if(ticks, [](double t) { return std::abs(t - std::round(t)) > 1e-9; });
    for (double& t : ticks) t = std::round(t);
  }
  const std::vector<std::string> labels = tick_labels(scale, ticks);
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    const double x = scale(ticks[i]);
    if (grid) line(x, top, x, bottom, "grid");
    line(x, bottom, x, bottom + 4, "axis");
    const bool cut = x + text_width(labels[i], kSmallFont) / 2 > width;
    text(cut ? width : x, bottom + 17, labels[i], cut ? "n e" : "n m", kSmallFont);
  }
  line(std::min(scale.a, scale.b), bottom, std::max(scale.a, scale.b), bottom, "axis");
  if (!label.empty()) text(std::max(scale.a, scale.b), bottom + 34, label, "q e");
}

void Picture::y_axis(const Scale& scale, double left, double right, bool grid, bool mark_zero) {
  const std::vector<double> ticks = ticks_of(scale, tick_count(std::abs(scale.b - scale.a), 36));
  const std::vector<std::string> labels = tick_labels(scale, ticks);
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    const double y = scale(ticks[i]);
    if (grid) line(left, y, right, y, mark_zero && ticks[i] == 0 ? "axis" : "grid");
    text(left - 6, y + 4, labels[i], "n e", kSmallFont);
  }
}

std::string Picture::clip(const char* name, double left, double top, double box_width, double height) {
  body += fmt::format("<clipPath id=\"{}-{}\"><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath>\n", id_,
                      name, px(left), px(top), px(box_width), px(height));
  return fmt::format("url(#{}-{})", id_, name);
}

std::string scales_of(const char* kind, const Scale& X, const Scale& Y, const std::string& x_label,
                      const std::string& y_label, const std::string& unit) {
  const auto text = [](const Scale& s) {
    return fmt::format("{} {} {} {}{}", s.from, s.to, px(s.a), px(s.b), s.log ? " log" : "");
  };
  return fmt::format(
      " data-plot=\"{}\" data-x=\"{}\" data-y=\"{}\" data-label=\"{}\" data-yname=\"{}\" data-unit=\"{}\"", kind,
      text(X), text(Y), escape(x_label), escape(y_label), escape(unit));
}

std::string Picture::finish(double height, const std::string& attributes) const {
  return fmt::format(
      "<svg class=\"pp\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" "
      "role=\"img\" aria-label=\"{2}\"{3}>\n{4}</svg>\n",
      px(width), px(height), escape(title_), attributes, body);
}

namespace {

/// Ramer, Douglas and Peucker with a stack: marks the points to keep so that no dropped one is farther than
/// `tolerance`.
void simplify(const std::vector<Point>& points, std::size_t first, std::size_t last, double tolerance,
              std::vector<char>& keep) {
  std::vector<std::pair<std::size_t, std::size_t>> stack{{first, last}};
  while (!stack.empty()) {
    const auto [a, b] = stack.back();
    stack.pop_back();
    const double dx = points[b].x - points[a].x, dy = points[b].y - points[a].y;
    const double length2 = dx * dx + dy * dy;
    double worst = tolerance * tolerance;
    std::size_t at = a;
    for (std::size_t i = a + 1; i < b; ++i) {
      double ex = points[i].x - points[a].x, ey = points[i].y - points[a].y;
      const double share = length2 > 0 ? std::clamp((ex * dx + ey * dy) / length2, 0.0, 1.0) : 0.0;
      ex -= share * dx;
      ey -= share * dy;
      if (ex * ex + ey * ey > worst) {
        worst = ex * ex + ey * ey;
        at = i;
      }
    }
    if (at == a) continue;
    keep[at] = 1;
    stack.emplace_back(a, at);
    stack.emplace_back(at, b);
  }
}

}  // namespace

std::string outline(const std::vector<Point>& corners) {
  constexpr double kFar = 1e6;  // px, as in px()
  struct Tenths {
    std::int64_t x, y;
  };
  std::vector<Tenths> at;
  for (const Point& p : corners) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y)) return {};
    const Tenths t{std::llround(10 * std::clamp(p.x, -kFar, kFar)), std::llround(10 * std::clamp(p.y, -kFar, kFar))};
    if (at.empty() || t.x != at.back().x || t.y != at.back().y) at.push_back(t);
  }
  while (at.size() > 1 && at.front().x == at.back().x && at.front().y == at.back().y) at.pop_back();
  if (at.size() < 3) return {};
  const auto text = [](std::int64_t tenths) {  // "-.3", "12", "4.5"
    const std::int64_t size = std::abs(tenths), whole = size / 10, rest = size % 10;
    std::string out = tenths < 0 ? "-" : "";
    if (whole != 0 || rest == 0) out += fmt::format("{}", whole);
    if (rest != 0) out += fmt::format(".{}", rest);
    return out;
  };
  std::string d = fmt::format("M{} {}", text(at[0].x), text(at[0].y));
  char last = 'M';
  for (std::size_t k = 1; k < at.size(); ++k) {
    const std::int64_t dx = at[k].x - at[k - 1].x, dy = at[k].y - at[k - 1].y;
    const char command = dy == 0 ? 'h' : dx == 0 ? 'v' : 'l';
    const std::string first = text(dy == 0 ? dx : dx == 0 ? dy : dx);
    // A command stands for the ones like it that follow; a sign divides two numbers.
    if (command != last) {
      d += command;
    } else if (first[0] != '-') {
      d += ' ';
    }
    d += first;
    if (command == 'l') {
      const std::string second = text(dy);
      if (second[0] != '-') d += ' ';
      d += second;
    }
    last = command;
  }
  return d + 'z';
}

std::string path(const std::vector<Point>& points, bool closed) {
  constexpr double kTolerance = 0.25;  // px: a quarter of a pixel cannot be seen
  std::string d;
  std::size_t begin = 0;
  const auto finite = [&](std::size_t i) { return std::isfinite(points[i].x) && std::isfinite(points[i].y); };
  while (begin < points.size()) {
    if (!finite(begin)) {
      ++begin;
      continue;
    }
    std::vector<Point> piece;  // neighbours closer than a tenth of a pixel are one: long paths get short first
    for (; begin < points.size() && finite(begin); ++begin) {
      const Point& p = points[begin];
      const bool last = begin + 1 == points.size() || !finite(begin + 1);
      if (!piece.empty() && !last && std::hypot(p.x - piece.back().x, p.y - piece.back().y) < 0.1) continue;
      piece.push_back(p);
    }
    std::vector<char> keep(piece.size(), 0);
    keep.front() = keep.back() = 1;
    simplify(piece, 0, piece.size() - 1, kTolerance, keep);
    char command = 'M';
    for (std::size_t i = 0; i < piece.size(); ++i) {
      if (keep[i] == 0) continue;
      d += fmt::format("{}{} {}", command, px(piece[i].x), px(piece[i].y));
      command = 'L';
    }
    if (piece.size() == 1) d += "h0";  // a dot, by its round caps
    if (closed) d += 'Z';
  }
  return d;
}

}  // namespace svg

std::string standalone_svg(const Figure& figure, double width) {
  std::string drawn = figure(Canvas{width, "p"});
  const std::size_t name = drawn.find("<svg"), end = drawn.find('>');
  if (name == std::string::npos || end == std::string::npos) return drawn;
  return "<svg xmlns=\"http://www.w3.org/2000/svg\"" + drawn.substr(name + 4, end - name - 3) +
         fmt::format(
             "\n<style>svg.pp{{{}font-family:system-ui,sans-serif;background:var(--ground)}}\n"
             "@media (prefers-color-scheme:dark){{svg.pp{{{}}}}}\n{}</style>",
             svg::light_colours(), svg::dark_colours(), svg::css()) +
         drawn.substr(end + 1);
}

}  // namespace polypod::report
