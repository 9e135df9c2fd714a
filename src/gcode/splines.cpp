// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Splines: G5, G5.1, and NURBS between G5.2 and G5.3.
#include <algorithm>
#include <cmath>

#include "engine.hpp"
#include "words.hpp"

namespace polypod::gcode {
namespace {

/// How far the lines of the plain program may leave a curve, mm.
constexpr double kChord = 5e-4;
/// Of G5 and G5.1: a curve that needs more lines than this is as large as no machine.
constexpr double kMostLines = 5000;
/// An order beyond this is a slip.
constexpr std::size_t kLargestOrder = 30;
/// Beyond these weights a curve is no curve any more.
constexpr double kLeastWeight = 1e-6;
constexpr double kLargestWeight = 1e6;
/// How often a knot span may be halved.
constexpr int kDeepest = 12;
/// Of kChord, for three points of a line: between them the curve may leave it a little more.
constexpr double kSampled = 0.8;

using Point = std::array<double, 2>;

double distance(const Point& p, const Point& a, const Point& b) {  // from the line between a and b
  const double x = b[0] - a[0];
  const double y = b[1] - a[1];
  const double square = x * x + y * y;
  const double t = square > 0 ? std::clamp(((p[0] - a[0]) * x + (p[1] - a[1]) * y) / square, 0.0, 1.0) : 0.0;
  return std::hypot(p[0] - a[0] - t * x, p[1] - a[1] - t * y);
}

/// A rational B-spline of order k over the control points P_0 to P_n with weights w_i,
/// C(u) = sum N_i,k(u) w_i P_i / sum N_i,k(u) w_i, on uniform knots that are clamped at both ends, 0 <= u <= n - k + 2.
/// Source: L. Piegl, W. Tiller, The NURBS Book, 1997, (4.1).
class Nurbs {
 public:
  Nurbs(const std::vector<ControlPoint>& points, std::size_t order) : points_(points), order_(order) {}

  [[nodiscard]] std::size_t spans() const { return points_.size() - order_ + 1; }

  /// The point at u of a span, by de Boor's algorithm on w P and w.
  [[nodiscard]] Point at(double u, std::size_t span) const {
    std::array<std::array<double, 3>, kLargestOrder> d{};
    for (std::size_t j = 0; j < order_; ++j) {
      const ControlPoint& c = points_[span + j];
      d[j] = {c.x * c.weight, c.y * c.weight, c.weight};
    }
    for (std::size_t r = 1; r < order_; ++r) {
      for (std::size_t j = order_ - 1; j >= r; --j) {
        const std::size_t i = span + j;
        const double a = (u - knot(i)) / (knot(i + order_ - r) - knot(i));
        for (std::size_t c = 0; c < 3; ++c) d[j][c] = (1 - a) * d[j - 1][c] + a * d[j][c];
      }
    }
    const auto& h = d[order_ - 1];
    return {h[0] / h[2], h[1] / h[2]};
  }

  /// Appends the ends of lines that follow the span from u0 at p0 to u1 at p1, off it by less than `chord`. False where
  /// kDeepest halvings do not come so near.
  bool divide(std::size_t span, double u0, const Point& p0, double u1, const Point& p1, double chord,
              std::vector<Point>& ends, int depth = 0) const {
    bool fits = depth > 1;  // two halves at least: a curve may cross its chord
    for (const double t : {0.25, 0.5, 0.75}) {
      fits = fits && distance(at(u0 + t * (u1 - u0), span), p0, p1) < kSampled * chord;
    }
    if (fits || depth > kDeepest) {
      ends.push_back(p1);
      return fits;
    }
    const double u = (u0 + u1) / 2;
    const Point middle = at(u, span);
    return divide(span, u0, p0, u, middle, chord, ends, depth + 1) &&
           divide(span, u, middle, u1, p1, chord, ends, depth + 1);
  }

 private:
  [[nodiscard]] double knot(std::size_t i) const {
    return i < order_ ? 0.0 : static_cast<double>(std::min(i - order_ + 1, spans()));
  }

  const std::vector<ControlPoint>& points_;
  std::size_t order_;
};

}  // namespace

/// G5 and G5.1. The plain program gets lines, closer to the curve than 0.5 um.
Status Engine::spline(int motion) {
  const int column = g_word(motion) != nullptr ? g_word(motion)->column : 1;
  const auto bad = [&](std::string_view what) {
    return error(column, "GC127", fmt::format("G{}: {}", motion == 50 ? "5" : "5.1", what), "check the block");
  };
  if (plane_ != Plane::xy) return bad("a spline outside of G17");
  if (left_ && options_.plain) {
    return error(column, "GC176", "a spline is the first move after G40", "leave the contour with a line");
  }
  if (inverse_) return bad("a spline under G93");
  if (find('Z') != nullptr || find('A') != nullptr || find('B') != nullptr || find('C') != nullptr) {
    return bad("a spline with an axis other than X and Y");
  }
  const Axes end = target();
  const bool cubic = motion == 50;
  const bool centre = find('I') != nullptr || find('J') != nullptr;
  std::array<double, 2> tangent{value('I'), value('J')};
  if (cubic) {
    if (find('P') == nullptr || find('Q') == nullptr) return bad("P and Q are missing");
    if (!centre) {
      if (!after_spline_) return bad("I and J of the first spline are missing");
      tangent = spline_tangent_;
    } else if (find('I') == nullptr || find('J') == nullptr) {
      return bad("I without J, or J without I");
    }
    spline_tangent_ = {-value('P'), -value('Q')};
  } else if (find('I') == nullptr || find('J') == nullptr || (tangent[0] == 0 && tangent[1] == 0)) {
    return bad("I and J are missing or 0");
  }
  spline_now_ = cubic;
  put("NURBS_FEED({}, ...)", cubic ? 4 : 3);
  const Axes start = current_;
  const auto point = [&](double t) {
    Axes p = start;
    const std::array<double, 2> ends{value('P'), value('Q')};
    for (std::size_t k = 0; k < 2; ++k) {
      const double a = start[k] + tangent[k];
      const double u = 1 - t;
      p[k] = cubic ? u * u * u * start[k] + 3 * u * u * t * a + 3 * u * t * t * (end[k] + ends[k]) + t * t * t * end[k]
                   : u * u * start[k] + 2 * u * t * a + t * t * end[k];
    }
    return p;
  };
  if (options_.plain) {
    // A chord of a step h is off by at most h^2 / 8 of the second derivative.
    const auto second = [&](double t) {
      const double h = 1e-3;
      const Axes a = point(t - h);
      const Axes b = point(t);
      const Axes c = point(t + h);
      return std::hypot(a[0] - 2 * b[0] + c[0], a[1] - 2 * b[1] + c[1]) / (h * h);
    };
    const double bend = std::max(second(1e-3), second(1 - 1e-3));
    const double needed = std::ceil(std::sqrt(bend / (8 * inches_tolerance(kChord))));
    if (!(needed <= kMostLines)) return bad("a curve of more than 5000 lines");
    const int count = std::max(1, static_cast<int>(needed));
    for (int i = 1; i <= count; ++i) {
      curve_to(i == count ? end : point(static_cast<double>(i) / count));
    }
  }
  plain_motion_ = 1;
  move_to(end);
  return {};
}

/// A line of the plain program along a curve.
void Engine::curve_to(const Axes& p) {
  plain("G1" + plain_words(p, true));
  current_ = p;
  ++lines_;
}

/// A control point: X, Y and its weight P. The block with G5.2 opens the curve, which begins where the tool is; L is
/// its order.
Status Engine::control_point(bool first) {
  const int column = first ? g_word(52)->column : block_->words.front().column;
  const auto bad = [&](int at, std::string_view what, std::string_view hint) {
    return error(at, "GC127", fmt::format("G5.2: {}", what), hint);
  };
  if (first) {
    if (plane_ != Plane::xy) return bad(column, "a curve outside of G17", "write G17 before it");
    if (inverse_) return bad(column, "a curve under G93", "use G94");
    if (options_.plain && (!known_[0] || !known_[1])) {
      return error(column, "GC169", "G5.2 where the position of X or Y is not known",
                   "give X, Y and Z before, in absolute coordinates");
    }
    if (left_ && options_.plain) {
      return error(column, "GC176", "a spline is the first move after G40", "leave the contour with a line");
    }
    control_points_ = {{current_[0], current_[1], 1}};
    nurbs_order_ = 3;
    if (const Word* l = find('L'); l != nullptr) {
      if (!(l->value >= 3) || l->value > static_cast<double>(kLargestOrder) || l->value != std::floor(l->value)) {
        return bad(l->column, "L is no order of a curve", "write an integer from 3 to 30");
      }
      nurbs_order_ = static_cast<std::size_t>(l->value);
    }
  }
  for (const Word& word : block_->words) {
    const bool opens = first && (word.letter == 'L' || word.letter == 'F' || word.letter == 'G');
    if (std::string_view("XYPN").find(word.letter) != std::string_view::npos || opens) continue;
    return bad(word.column, fmt::format("{} beside a control point", word.letter), "give X, Y and P alone");
  }
  if (incremental_) return bad(column, "control points under G91", "use G90");
  const Word* x = find('X');
  const Word* y = find('Y');
  const Word* p = find('P');
  if (p == nullptr || !(p->value >= kLeastWeight && p->value <= kLargestWeight)) {
    return bad(p != nullptr ? p->column : column, "a control point without a weight", "write P from 1e-6 to 1e6");
  }
  if (first && x == nullptr && y == nullptr) return {};
  if (x == nullptr || y == nullptr) return bad(column, "a control point without X or Y", "give both");
  control_points_.push_back({x->value, y->value, p->value});
  return {};
}

/// Between G5.2 and G5.3 nothing may change what the control points mean.
Status Engine::judge_within_nurbs() const {
  for (const Word& word : block_->words) {
    const bool idle = word.letter == 'M' && word.value >= 3 && word.value <= 9 && word.value != 6;
    if (idle || (word.letter != 'G' && word.letter != 'M' && word.letter != 'T')) continue;
    if (word.letter == 'G' && code_of(word) == 53) continue;
    return error(word.column, "GC127", fmt::format("{}{} between G5.2 and G5.3", word.letter, number(word.value, 1)),
                 "end the curve with G5.3 before it");
  }
  return {};
}

/// G5.3 runs the curve. The plain program gets lines, closer to it than 0.5 um.
Status Engine::end_nurbs() {
  const int column = g_word(53)->column;
  const auto bad = [&](std::string_view what, std::string_view hint) {
    return error(column, "GC127", fmt::format("G5.3: {}", what), hint);
  };
  if (motion_ != 52) return bad("no G5.2 before it", "a curve begins with G5.2");
  for (const Word& word : block_->words) {
    if (word.letter == 'N' || &word == g_word(53)) continue;
    return error(word.column, "GC127", fmt::format("G5.3: {} beside it", word.letter), "move it to another line");
  }
  const std::size_t count = control_points_.size();
  if (count < nurbs_order_) {
    return bad(
        fmt::format("{} control points, the start of the curve included, for a curve of order {}", count, nurbs_order_),
        "give more of them, or a smaller L");
  }
  put("NURBS_FEED({}, ...)", count);
  Axes end = current_;
  end[0] = control_points_.back().x;
  end[1] = control_points_.back().y;
  if (options_.plain) {
    const Nurbs curve(control_points_, nurbs_order_);
    Axes place = current_;
    std::vector<Point> ends;
    for (std::size_t span = 0; span < curve.spans(); ++span) {
      const double u = static_cast<double>(span);
      const Point to = span + 1 == curve.spans() ? Point{end[0], end[1]} : curve.at(u + 1, span);
      ends.clear();
      if (!curve.divide(span, u, {current_[0], current_[1]}, u + 1, to, inches_tolerance(kChord), ends) ||
          lines_ > options_.most_lines) {
        return bad("the curve is too large for lines that leave it by at most 0.5 um", "divide it into several curves");
      }
      for (const Point& p : ends) {
        place[0] = p[0];
        place[1] = p[1];
        curve_to(place);
      }
    }
  }
  control_points_.clear();
  plain_motion_ = 1;
  motion_ = kNurbsEnded;
  known_[0] = known_[1] = true;
  move_to(end);
  return {};
}

}  // namespace polypod::gcode
