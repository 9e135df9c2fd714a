// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "leg_subdivision.hpp"

#include <algorithm>
#include <cmath>

namespace polypod::machine::leg_subdivision {
namespace {

constexpr int kN = leg_homotopy::kUnknowns;  ///< variables of a chart: three of e, then four of g
constexpr int kE = 3;
constexpr int kMean = 1;       ///< the one equation that is not linear in g
constexpr int kProducts = 18;  ///< e_0^2 e_1^2 e_2^2, e_0 e_1, e_0 e_2, e_1 e_2, then g_j e_k
constexpr double kRounding = 1e-13;
constexpr double kReachOfE =
    2.5;  ///< bound of the components of e, also in the boxes of uniqueness, which reach beyond the chart

constexpr double kShareOfG =
    0.1;  ///< g is mostly narrowed by the equations; it is split where it weighs 10 times as much
constexpr double kTryNewton = 0.3;    ///< from a box whose half sides of e are smaller
constexpr double kNoticeable = 0.01;  ///< a variable is narrowed only if by this share of its width

using Row = std::array<double, kN>;

/// A quadratic about a point: its value, slopes, the factors of the products of deviations, and of |g|^2. In one array,
/// because what is done most is to add up such arrays.
constexpr int kSlope = 1, kProduct = kSlope + kN, kSquare = kProduct + kProducts, kTerms = kSquare + 2;  // even
using Terms = std::array<double, kTerms>;

constexpr int product_of_g_e(int j, int k) {
  return 6 + 3 * j + k;
}

/// A box that holds no more than one zero.
struct Unique {
  Row centre, side;
};

struct Chart {
  int one = 0;                     ///< the component of e that is 1
  std::array<Terms, kN> equation;  ///< about 0
  Row moduli{};                    ///< bound of the sums of the terms' moduli over the chart, for the rounding
  Row slopes{};                    ///< the same of the derivatives
  std::vector<Unique> unique;
};

/// 2 g' D e + e' H e + gamma |g|^2
struct Quadric {
  std::array<std::array<Interval, 4>, 4> D, H;
  double gamma = 0;
};

Quadric quadric_of(const leg_homotopy::LegsT<Interval>& legs, int i) {
  std::array<Interval, 3> a, b, d, s;
  Interval lengths = -legs.square[i].re;
  for (int k = 0; k < 3; ++k) {
    d[k] = legs.difference[i][k].re;
    s[k] = legs.sum[i][k].re;
    a[k] = Interval(0.5) * (s[k] + d[k]);
    b[k] = Interval(0.5) * (s[k] - d[k]);
    lengths += Interval(0.5) * (square(s[k]) + square(d[k]));  // |a|^2 + |b|^2
  }
  Quadric f;
  f.gamma = 1;
  // D e = e b - a e.
  f.D[0] = {Interval(0.0), d[0], d[1], d[2]};
  f.D[1] = {-d[0], Interval(0.0), s[2], -s[1]};
  f.D[2] = {-d[1], -s[2], Interval(0.0), s[0]};
  f.D[3] = {-d[2], s[1], -s[0], Interval(0.0)};
  // H = (|a|^2 + |b|^2 - l^2) 1 - 2 K, e' K e = <a, e b e*> (Horn 1987).
  const auto c = [&](int j, int k) { return a[j] * b[k]; };
  std::array<std::array<Interval, 4>, 4> K;
  K[0][0] = c(0, 0) + c(1, 1) + c(2, 2);
  K[1][1] = c(0, 0) - c(1, 1) - c(2, 2);
  K[2][2] = c(1, 1) - c(0, 0) - c(2, 2);
  K[3][3] = c(2, 2) - c(0, 0) - c(1, 1);
  K[0][1] = c(2, 1) - c(1, 2);
  K[0][2] = c(0, 2) - c(2, 0);
  K[0][3] = c(1, 0) - c(0, 1);
  K[1][2] = c(0, 1) + c(1, 0);
  K[1][3] = c(0, 2) + c(2, 0);
  K[2][3] = c(1, 2) + c(2, 1);
  for (int j = 0; j < 4; ++j)
    for (int k = 0; k < 4; ++k) {
      f.H[j][k] = Interval(-2.0) * (j <= k ? K[j][k] : K[k][j]);
      if (j == k) f.H[j][k] += lengths;
    }
  return f;
}

/// <e,g>, the mean of the legs and five differences, multiplied by whole numbers so that |g|^2 vanishes exactly.
std::array<Quadric, kN> equations_of(const leg_homotopy::LegsT<Interval>& legs) {
  constexpr std::array<std::array<double, kLegs>, kN> kShare{{{0, 0, 0, 0, 0, 0},
                                                              {1, 1, 1, 1, 1, 1},
                                                              {1, -1, 0, 0, 0, 0},
                                                              {0, 0, 1, -1, 0, 0},
                                                              {0, 0, 0, 0, 1, -1},
                                                              {1, 1, -1, -1, 0, 0},
                                                              {1, 1, 1, 1, -2, -2}}};
  std::array<Quadric, kN> out;
  for (int j = 0; j < 4; ++j) out[0].D[j][j] = 1.0;
  for (int i = 0; i < kLegs; ++i) {
    const Quadric f = quadric_of(legs, i);
    for (int r = kMean; r < kN; ++r) {
      const double share = kShare[r][i];
      out[r].gamma += share;
      for (int j = 0; j < 4; ++j)
        for (int k = 0; k < 4; ++k) {
          out[r].D[j][k] += Interval(share) * f.D[j][k];
          out[r].H[j][k] += Interval(share) * f.H[j][k];
        }
    }
  }
  return out;
}

std::array<double, kProducts> products_of(const Row& x) {
  std::array<double, kProducts> m{x[0] * x[0], x[1] * x[1], x[2] * x[2], x[0] * x[1], x[0] * x[2], x[1] * x[2]};
  for (int j = 0; j < 4; ++j)
    for (int k = 0; k < kE; ++k) m[product_of_g_e(j, k)] = x[kE + j] * x[k];
  return m;
}

/// `reach` bounds |g|.
Chart chart_of(const std::array<Quadric, kN>& quadrics, int one, double reach) {
  Chart out;
  out.one = one;
  Row x;
  for (int v = 0; v < kN; ++v) x[v] = v < kE ? kReachOfE : reach;
  const std::array<double, kProducts> m = products_of(x);
  std::array<int, kE> at;
  for (int k = 0, v = 0; k < 4; ++k)
    if (k != one) at[v++] = k;
  for (int r = 0; r < kN; ++r) {
    const Quadric& f = quadrics[r];
    Terms& form = out.equation[r];
    form.fill(0);
    // The middle of each factor; its modulus, and what it may be off, counted so that kRounding covers it.
    const auto put = [&](int term, const Interval& value, double monomial) {
      form[term] = value.mid();
      const double counted = value.magnitude() + value.width() / kRounding;
      out.moduli[r] += counted * monomial;
      out.slopes[r] += 2 * counted * (kReachOfE + reach);
    };
    const auto twice = [&](const Interval& value) { return Interval(2.0) * value; };
    put(0, f.H[one][one], 1);
    for (int k = 0; k < kE; ++k) {
      put(kSlope + k, twice(f.H[at[k]][one]), x[k]);
      put(kProduct + k, f.H[at[k]][at[k]], m[k]);
    }
    put(kProduct + 3, twice(f.H[at[0]][at[1]]), m[3]);
    put(kProduct + 4, twice(f.H[at[0]][at[2]]), m[4]);
    put(kProduct + 5, twice(f.H[at[1]][at[2]]), m[5]);
    for (int j = 0; j < 4; ++j) {
      put(kSlope + kE + j, twice(f.D[j][one]), x[kE + j]);
      for (int k = 0; k < kE; ++k) {
        const int product = product_of_g_e(j, k);
        put(kProduct + product, twice(f.D[j][at[k]]), m[product]);
      }
    }
    put(kSquare, f.gamma, 4 * reach * reach);
  }
  return out;
}

using Expansion = std::array<Terms, kN>;

/// The equations about x.
void expand(const Chart& chart, const Row& x, Expansion& at) {
  const std::array<double, kProducts> m = products_of(x);
  double gg = 0;
  for (int j = kE; j < kN; ++j) gg += x[j] * x[j];
  for (int r = 0; r < kN; ++r) {
    Terms& f = at[r];
    f = chart.equation[r];
    const double* c = f.data() + kProduct;
    double value = f[0] + f[kSquare] * gg;
    for (int v = 0; v < kN; ++v) value += f[kSlope + v] * x[v];
    for (int k = 0; k < kProducts; ++k) value += c[k] * m[k];
    f[0] = value;
    double* slope = f.data() + kSlope;
    slope[0] += 2 * c[0] * x[0] + c[3] * x[1] + c[4] * x[2];
    slope[1] += 2 * c[1] * x[1] + c[3] * x[0] + c[5] * x[2];
    slope[2] += 2 * c[2] * x[2] + c[4] * x[0] + c[5] * x[1];
    for (int j = 0; j < 4; ++j) {
      const double* d = c + product_of_g_e(j, 0);
      for (int k = 0; k < kE; ++k) {
        slope[k] += d[k] * x[kE + j];
        slope[kE + j] += d[k] * x[k];
      }
      slope[kE + j] += 2 * f[kSquare] * x[kE + j];
    }
  }
}

/// A combination of the equations about a point.
struct Combination {
  Terms terms;
  double rounding = 0;

  Combination(const Chart& chart, const Expansion& at, const double* multiplier) {
    terms.fill(0);
    for (int r = 0; r < kN; ++r) {
      const double m = multiplier[r];
      if (m == 0) continue;
      for (int k = 0; k < kTerms; ++k) terms[k] += m * at[r][k];
      rounding += std::abs(m) * chart.moduli[r];
    }
    rounding *= kRounding;
  }
  [[nodiscard]] double value() const { return terms[0]; }
  [[nodiscard]] double slope(int v) const { return terms[kSlope + v]; }
  [[nodiscard]] double product(int k) const { return terms[kProduct + k]; }
  [[nodiscard]] double square() const { return terms[kSquare]; }
};

/// Gauss and Jordan's elimination of the slopes, as far as pivots allow.
struct Elimination {
  /// Slopes times the box's sides, rows combined; then the multipliers of the equations of which the row consists,
  /// which are what counts (the slopes themselves are computed anew from them).
  std::array<std::array<double, 2 * kN>, kN> row;
  std::array<int, kN> pivot_of;  ///< the variable for which the row is solved, or -1

  Elimination(const Expansion& at, const Row& side) {
    pivot_of.fill(-1);
    for (int r = 0; r < kN; ++r) {
      row[r].fill(0);
      double largest = 0;
      for (int v = 0; v < kN; ++v) {
        row[r][v] = at[r][kSlope + v] * side[v];
        largest = std::max(largest, std::abs(row[r][v]));
      }
      const double scale = largest > 0 ? 1 / largest : 1;
      for (int v = 0; v < kN; ++v) row[r][v] *= scale;
      row[r][kN + r] = scale;
    }
  }

  [[nodiscard]] const double* multiplier(int r) const { return row[r].data() + kN; }

  /// One more pivot among these variables; `mean`: also of the equation of |g|^2. False where all are below `least`.
  bool step(int first, int last, bool mean, double least) {
    int pivot = -1, column = -1;
    double largest = least;
    for (int r = 0; r < kN; ++r) {
      if (pivot_of[r] >= 0 || (r == kMean && !mean)) continue;
      for (int v = first; v < last; ++v) {
        if (std::abs(row[r][v]) > largest) {
          largest = std::abs(row[r][v]);
          pivot = r;
          column = v;
        }
      }
    }
    if (pivot < 0) return false;
    pivot_of[pivot] = column;
    auto& top = row[pivot];
    const double inverse = 1 / top[column];
    for (double& t : top) t *= inverse;
    for (int r = 0; r < kN; ++r) {
      const double factor = row[r][column];
      if (r == pivot || factor == 0) continue;
      for (int v = 0; v < 2 * kN; ++v) row[r][v] -= factor * top[v];
      row[r][column] = 0;
    }
    return true;
  }
};

/// Deviations from a box's centre, narrowed as rows are read.
struct Deviations {
  Row lo, hi, most;  ///< most: of the modulus
  std::array<double, kProducts> product;
  double gg = 0;

  explicit Deviations(const Row& side) : hi(side) {
    for (int v = 0; v < kN; ++v) lo[v] = -side[v];
    measure();
  }

  void measure() {
    gg = 0;
    for (int v = 0; v < kN; ++v) {
      most[v] = std::max(-lo[v], hi[v]);
      if (v >= kE) gg += most[v] * most[v];
    }
    product = products_of(most);
  }

  /// Narrows by `row` = 0; false where that has no solution here.
  bool read(const Combination& row) {
    double rest = 0;
    for (int k = 0; k < kProducts; ++k) rest += std::abs(row.product(k)) * product[k];
    // Squares lie between 0 and their greatest value.
    double value = row.value() + 0.5 * row.square() * gg;
    rest += row.rounding + 0.5 * std::abs(row.square()) * gg;
    for (int k = 0; k < kE; ++k) {
      value += 0.5 * row.product(k) * product[k];
      rest -= 0.5 * std::abs(row.product(k)) * product[k];
    }
    Row low, high;
    double sum_low = value - rest, sum_high = value + rest;
    for (int v = 0; v < kN; ++v) {
      const double p = row.slope(v) * lo[v], q = row.slope(v) * hi[v];
      low[v] = std::min(p, q);
      high[v] = std::max(p, q);
      sum_low += low[v];
      sum_high += high[v];
    }
    if (sum_low > 0 || sum_high < 0) return false;
    bool changed = false;
    for (int v = 0; v < kN; ++v) {
      // slope x = - all others, if that says noticeably more.
      const double from = high[v] - sum_high, to = low[v] - sum_low;
      const double least = kNoticeable * (high[v] - low[v]);
      if (!(from > low[v] + least || to < high[v] - least)) continue;
      const double p = from / row.slope(v), q = to / row.slope(v);
      const double slack = 1e-15 * (most[v] + std::abs(p) + std::abs(q));
      lo[v] = std::max(lo[v], std::min(p, q) - slack);
      hi[v] = std::min(hi[v], std::max(p, q) + slack);
      if (lo[v] > hi[v]) return false;
      changed = true;
    }
    if (changed) measure();
    return true;
  }
};

class Search {
 public:
  Search(const Problem& problem, const Options& options) : problem_(problem), options_(options) {
    const std::array<Quadric, kN> quadrics = equations_of(problem.absolute);
    Interval reach = 0.0;
    for (int i = 0; i < kLegs; ++i) {
      reach += sqrt(problem.absolute.square[i].re);
      for (int k = 0; k < 3; ++k) {
        middle_a_[k] += 0.5 * (problem.absolute.sum[i][k].re + problem.absolute.difference[i][k].re);
        middle_b_[k] += 0.5 * (problem.absolute.sum[i][k].re - problem.absolute.difference[i][k].re);
      }
    }
    // 6 t = sum y_i + sum a_i - R sum b_i; the last two are rounding only.
    for (int k = 0; k < 3; ++k) reach += abs(middle_a_[k]) + abs(middle_b_[k]);
    reach_ = reach.hi() / kLegs * (1 + 1e-12);
    for (int c = 0; c < 4; ++c) charts_[c] = chart_of(quadrics, c, 2 * reach_);
  }

  /// A real point close to a zero: where that is proven and new, it is listed, with its mirror image.
  void propose(Point point) {
    if (!leg_homotopy::polish(problem_.legs, point)) return;
    point = leg_homotopy::point_of(point.z);
    const std::optional<double> radius = leg_homotopy::certify(problem_.proof, point);
    if (!radius || std::any_of(point.z.begin(), point.z.end(), [](const auto& c) { return c.im != 0; })) return;
    const auto is_new = [&](const Point& p, double r) {
      return std::all_of(result_.zeros.begin(), result_.zeros.end(),
                         [&](const RealZero& z) { return leg_homotopy::surely_different(z.point, z.radius, p, r); });
    };
    if (!is_new(point, *radius)) return;
    add({point, *radius});
    if (!problem_.level) return;
    leg_homotopy::PointT<double> mirrored = point.z;
    for (const int k : {1, 2, 4, 7}) mirrored[k] = -mirrored[k];
    const Point other = leg_homotopy::point_of(mirrored);
    const std::optional<double> other_radius = leg_homotopy::certify(problem_.proof, other);
    if (other_radius && is_new(other, *other_radius)) {
      add({other, *other_radius});
    } else {
      twins_ = false;
    }
  }

  std::optional<Box> narrowed(Box box) {
    if (!narrow(box)) return {};
    return box;
  }

  [[nodiscard]] std::optional<Box> alone_in(const RealZero& zero, int one) const {
    Chart chart = charts_[one];
    add_unique(chart, zero);
    if (chart.unique.empty()) return {};
    Box out;
    out.one = one;
    for (int v = 0; v < kN; ++v) {
      out.lo[v] = chart.unique.back().centre[v] - chart.unique.back().side[v];
      out.hi[v] = chart.unique.back().centre[v] + chart.unique.back().side[v];
    }
    return out;
  }

  Result run() {
    for (const Chart& chart : charts_)
      for (int r = 0; r < kN; ++r)
        if (!std::isfinite(chart.moduli[r] + chart.slopes[r])) return result_;
    for (int c = 3; c >= 0; --c) {
      Box box;
      box.one = c;
      for (int v = 0; v < kN; ++v) {
        box.hi[v] = v < kE ? 1 : 2 * reach_;
        box.lo[v] = -box.hi[v];
      }
      // The mirrored pose has (w, -x, -y, z), which is (-w, x, y, -z) too: of one of the two, x is not negative in the
      // charts of w and z, and w in the others.
      if (problem_.level) box.lo[c == 3 ? 1 : 0] = 0;
      open_.push_back(box);
    }
    bool stopped = false;
    while (!open_.empty() && !stopped) {
      Box box = open_.back();
      open_.pop_back();
      stopped = result_.boxes >= options_.boxes;
      if (stopped) break;
      ++result_.boxes;
      work(box);
      stopped = result_.singular;
    }
    result_.complete = !stopped && twins_;
    return result_;
  }

 private:
  void work(Box& box) {
    const Chart& chart = charts_[box.one];
    for (int pass = 0; pass < 4; ++pass) {
      if (done(chart, box)) return;
      const Row before = width_of(box);
      if (!narrow(box)) return;
      const Row after = width_of(box);
      bool better = false;
      for (int v = 0; v < kN; ++v) better = better || after[v] < 0.5 * before[v];
      if (!better) break;
    }
    if (done(chart, box)) return;
    split(box);
  }

  static Row width_of(const Box& box) {
    Row out;
    for (int v = 0; v < kN; ++v) out[v] = box.hi[v] - box.lo[v];
    return out;
  }

  static bool done(const Chart& chart, const Box& box) {
    return std::any_of(chart.unique.begin(), chart.unique.end(), [&](const Unique& u) {
      for (int v = 0; v < kN; ++v)
        if (!(box.lo[v] >= u.centre[v] - u.side[v] && box.hi[v] <= u.centre[v] + u.side[v])) return false;
      return true;
    });
  }

  /// By |g|^2 = -e' H e alone.
  bool narrow_by_mean(const Chart& chart, Box& box) const {
    const Terms& form = chart.equation[kMean];
    Row x, h;
    for (int v = 0; v < kN; ++v) {
      x[v] = 0.5 * (box.lo[v] + box.hi[v]);
      h[v] = 0.5 * (box.hi[v] - box.lo[v]) * (1 + 1e-15) + 4e-16 * std::abs(x[v]);
    }
    const double *slope = form.data() + kSlope, *c = form.data() + kProduct;
    double value = form[0], off = kRounding * chart.moduli[kMean];
    for (int k = 0; k < kE; ++k) {
      value += (slope[k] + c[k] * x[k]) * x[k];
      value += 0.5 * c[k] * h[k] * h[k];
      off += 0.5 * std::abs(c[k]) * h[k] * h[k];
    }
    value += c[3] * x[0] * x[1] + c[4] * x[0] * x[2] + c[5] * x[1] * x[2];
    off += std::abs(c[3]) * h[0] * h[1] + std::abs(c[4]) * h[0] * h[2] + std::abs(c[5]) * h[1] * h[2];
    off += std::abs(slope[0] + 2 * c[0] * x[0] + c[3] * x[1] + c[4] * x[2]) * h[0];
    off += std::abs(slope[1] + 2 * c[1] * x[1] + c[3] * x[0] + c[5] * x[2]) * h[1];
    off += std::abs(slope[2] + 2 * c[2] * x[2] + c[4] * x[0] + c[5] * x[1]) * h[2];
    // The mean of the joints is not exactly 0.
    for (int j = 0; j < 4; ++j) {
      const double g = std::abs(x[kE + j]) + h[kE + j];
      off += std::abs(slope[kE + j]) * g;
      for (int k = 0; k < kE; ++k) off += std::abs(c[product_of_g_e(j, k)]) * g;
    }
    const double gg_low = (-value - off) / form[kSquare], gg_high = (-value + off) / form[kSquare];
    if (gg_high < 0) return false;
    double least = 0, most = 0;
    std::array<double, 4> low, high;
    for (int j = 0; j < 4; ++j) {
      const double a = box.lo[kE + j], b = box.hi[kE + j];
      high[j] = std::max(a * a, b * b);
      low[j] = a > 0 || b < 0 ? std::min(a * a, b * b) : 0;
      least += low[j];
      most += high[j];
    }
    constexpr double kUp = 1 + 1e-14, kDown = 1 - 1e-14;
    if (least * kDown > gg_high || most * kUp < gg_low) return false;
    for (int j = 0; j < 4; ++j) {
      double &a = box.lo[kE + j], &b = box.hi[kE + j];
      const double tiny = 1e-14 * (most + gg_high);
      const double outer = std::sqrt(std::max(0.0, gg_high - (least - low[j]) + tiny)) * kUp;
      a = std::max(a, -outer);
      b = std::min(b, outer);
      const double inner = std::sqrt(std::max(0.0, gg_low - (most - high[j]) - tiny)) * kDown;
      if (a > -inner) a = std::max(a, inner);
      if (b < inner) b = std::min(b, -inner);
      if (a > b) return false;
    }
    return true;
  }

  bool narrow(Box& box) {
    const int chart_index = box.one;
    if (!narrow_by_mean(charts_[chart_index], box)) return false;
    const Chart& chart = charts_[chart_index];
    Row x, side;
    for (int v = 0; v < kN; ++v) {
      x[v] = 0.5 * (box.lo[v] + box.hi[v]);
      side[v] = 0.5 * (box.hi[v] - box.lo[v]) * (1 + 1e-15) + 4e-16 * std::abs(x[v]);
    }
    Deviations d(side);
    Expansion at;
    expand(chart, x, at);
    Elimination system(at, side);
    int pivots = 0;
    while (pivots < 4 && system.step(kE, kN, false, 1e-3)) ++pivots;
    // Rows without g first.
    for (const bool mean : {false, true}) {
      for (int r = 0; r < kN; ++r) {
        if (system.pivot_of[r] >= 0 || (r == kMean) != mean) continue;
        if (!d.read({chart, at, system.multiplier(r)})) return false;
      }
    }
    for (int r = 0; r < kN; ++r) {
      if (system.pivot_of[r] >= 0 && !d.read({chart, at, system.multiplier(r)})) return false;
    }
    while (pivots < kN && system.step(0, kN, true, 1e-9)) ++pivots;
    Row step;
    bool near = pivots == kN;
    for (int r = 0; r < kN; ++r) {
      if (system.pivot_of[r] < 0) continue;
      const Combination row(chart, at, system.multiplier(r));
      if (!d.read(row)) return false;
      const int v = system.pivot_of[r];
      step[v] = -row.value() / row.slope(v);
      near = near && (v >= kE || (side[v] < kTryNewton && std::abs(step[v]) < 2 * side[v]));
    }
    for (int v = 0; v < kN; ++v) {
      const double slack = 4e-16 * (std::abs(x[v]) + side[v]);
      box.lo[v] = std::max(box.lo[v], x[v] + d.lo[v] - slack);
      box.hi[v] = std::min(box.hi[v], x[v] + d.hi[v] + slack);
      if (box.lo[v] > box.hi[v]) return false;
      step[v] += x[v];
    }
    if (near) look_from(chart_index, step);
    return true;
  }

  /// Newton; a zero that is new is proven and added.
  void look_from(int chart_index, Row x) {
    const Chart& chart = charts_[chart_index];
    const Box at_x{x, x, chart_index};
    if (done(chart, at_x)) return;
    double last = 1e300;
    for (int k = 0; k < 12; ++k) {
      Expansion at;
      expand(chart, x, at);
      Row unit;
      unit.fill(1);
      Elimination system(at, unit);
      while (system.step(0, kN, true, 1e-12)) continue;
      double moved = 0;
      for (int r = 0; r < kN; ++r) {
        if (system.pivot_of[r] < 0) return;
        double s = 0;
        for (int i = 0; i < kN; ++i) s -= system.multiplier(r)[i] * at[i][0];
        x[system.pivot_of[r]] += s;
        moved = std::max(moved, std::abs(s));
      }
      if (!(moved < 1e3)) return;
      if (k > 3 && moved > 0.5 * last) break;
      last = moved;
      if (moved < 1e-9) break;
    }
    if (!(last < 1e-6) || done(chart, Box{x, x, chart_index})) return;
    propose(point_in(chart, x));
  }

  static Point point_in(const Chart& chart, const Row& x) {
    leg_homotopy::PointT<double> z;
    for (int k = 0, v = 0; k < 4; ++k) z[k] = {k == chart.one ? 1.0 : x[v++], 0};
    for (int j = 0; j < 4; ++j) z[4 + j] = {x[kE + j], 0};
    return leg_homotopy::point_of(z);
  }

  void add(const RealZero& zero) {
    result_.zeros.push_back(zero);
    for (Chart& chart : charts_) add_unique(chart, zero);
  }

  /// The largest box about the zero with sides in a fixed ratio in which two zeros x, y cannot be:
  /// |x - y| = |Y (Q(x) - Q(y))| <= 2 |Y Q|(side, |x - y|).
  void add_unique(Chart& chart, const RealZero& zero) const {
    const leg_homotopy::Complex& one = zero.point.z[chart.one];
    if (std::abs(one.re) < 0.75) return;
    Unique out;
    for (int k = 0, v = 0; k < 8; ++k)
      if (k != chart.one) out.centre[v++] = zero.point.z[k].re / one.re;
    Expansion at;
    expand(chart, out.centre, at);
    Row unit;
    unit.fill(1);
    Elimination system(at, unit);
    while (system.step(0, kN, true, 1e-13)) continue;
    std::array<Terms, kN> row;
    Row rounding;
    for (int r = 0; r < kN; ++r) {
      const int v = system.pivot_of[r];
      if (v < 0) return;
      row[v] = Combination(chart, at, system.multiplier(r)).terms;
      rounding[v] = 0;
      for (int i = 0; i < kN; ++i) rounding[v] += kRounding * std::abs(system.multiplier(r)[i]) * chart.slopes[i];
      row[v][kSlope + v] -= 1;
    }
    // |Y Q|(side, side), without the squares' signs.
    const auto image = [&](const Row& side) {
      const std::array<double, kProducts> m = products_of(side);
      double gg = 0;
      for (int j = kE; j < kN; ++j) gg += side[j] * side[j];
      Row to;
      for (int v = 0; v < kN; ++v) {
        to[v] = std::abs(row[v][kSquare]) * gg;
        for (int k = 0; k < kProducts; ++k) to[v] += std::abs(row[v][kProduct + k]) * m[k];
      }
      return to;
    };
    Row side;
    side.fill(1);
    for (int k = 0; k < 6; ++k) {
      const Row to = image(side);
      const double largest = *std::max_element(to.begin(), to.end());
      if (!(largest > 0)) return;
      for (int v = 0; v < kN; ++v) side[v] = std::sqrt(side[v] * std::max(to[v] / largest, 1e-3));
    }
    const Row to = image(side);
    double scale = 0;
    for (int v = 0; v < kN; ++v) {
      double defect = 0;
      for (int w = 0; w < kN; ++w) defect += (std::abs(row[v][kSlope + w]) + rounding[v]) * side[w];
      if (defect > 0.05 * side[v]) return;
      scale = std::max(scale, 2 * to[v] / side[v]);
    }
    // 2 |Y Q| / side <= 0.94 and the defect 0.05.
    for (int v = 0; v < kN; ++v)
      out.side[v] = std::min(0.94 / scale, 1 / *std::max_element(side.begin(), side.end())) * side[v];
    // The zero itself lies in it.
    for (int v = 0; v < kN; ++v)
      if (!(out.side[v] > (100 * zero.radius + 1e-13) * (1 + zero.point.weight))) return;
    for (int v = 0; v < kE; ++v)
      if (!(std::abs(out.centre[v]) + out.side[v] < kReachOfE)) return;
    chart.unique.push_back(out);
  }

  void split(const Box& box) {
    Row x;
    const Row w = width_of(box);
    double widest = 0;
    for (int v = 0; v < kN; ++v) {
      x[v] = 0.5 * (box.lo[v] + box.hi[v]);
      widest = std::max(widest, w[v]);
    }
    if (widest < options_.smallest) {
      result_.singular = true;
      return;
    }
    Expansion at;
    expand(charts_[box.one], x, at);
    int best = 0;
    double largest = -1;
    for (int v = 0; v < kN; ++v) {
      double norm = 0;
      for (int r = 0; r < kN; ++r) norm += at[r][kSlope + v] * at[r][kSlope + v];
      const double smear = std::sqrt(norm) * w[v] * (v < kE ? 1 : kShareOfG);
      if (smear > largest) {
        largest = smear;
        best = v;
      }
    }
    Box a = box, b = box;
    a.hi[best] = x[best];
    b.lo[best] = x[best];
    open_.push_back(a);
    open_.push_back(b);
  }

  const Problem& problem_;
  Options options_;
  std::array<Interval, 3> middle_a_{}, middle_b_{};
  double reach_ = 0;
  std::array<Chart, 4> charts_;
  std::vector<Box> open_;
  Result result_;
  bool twins_ = true;  ///< the mirror image of every zero is listed
};

}  // namespace

Result real_zeros(const Problem& problem, const std::vector<Point>& known, const Options& options) {
  Search search(problem, options);
  for (const Point& p : known) search.propose(p);
  return search.run();
}

std::optional<Box> narrowed(const Problem& problem, const Box& box) {
  return Search(problem, {}).narrowed(box);
}

std::optional<Box> alone_in(const Problem& problem, const RealZero& zero, int one) {
  return Search(problem, {}).alone_in(zero, one);
}

}  // namespace polypod::machine::leg_subdivision
