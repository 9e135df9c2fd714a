// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "leg_homotopy.hpp"

#include <algorithm>
#include <cmath>

namespace polypod::machine::leg_homotopy {
namespace {

template <class T>
using Quaternion = std::array<ComplexT<T>, 4>;

/// a q - q b for pure quaternions a and b, of which d = a - b and s = a + b are given: an antisymmetric map of q.
template <class T>
[[gnu::always_inline]] inline Quaternion<T> turned(const std::array<ComplexT<T>, 3>& d,
                                                   const std::array<ComplexT<T>, 3>& s, const Quaternion<T>& q) {
  return {-(d[0] * q[1] + d[1] * q[2] + d[2] * q[3]), d[0] * q[0] + s[1] * q[3] - s[2] * q[2],
          d[1] * q[0] + s[2] * q[1] - s[0] * q[3], d[2] * q[0] + s[0] * q[2] - s[1] * q[1]};
}
/// The bilinear product of two quaternions: no conjugation, so that it is a polynomial.
template <class T>
[[gnu::always_inline]] inline ComplexT<T> dot(const Quaternion<T>& a, const Quaternion<T>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

template <class T>
Quaternion<T> rotation_part(const PointT<T>& z) {
  return {z[0], z[1], z[2], z[3]};
}
template <class T>
Quaternion<T> translation_part(const PointT<T>& z) {
  return {z[4], z[5], z[6], z[7]};
}

/// A square system with one right side, in planes of real and imaginary parts so that rows are worked in whole vectors.
struct System {
  double re[kUnknowns][kUnknowns + 1];
  double im[kUnknowns][kUnknowns + 1];

  /// Column `chart` of J is left out, because that coordinate stands still; the right side is `b`.
  System(const std::array<PointT<double>, kUnknowns>& J, const std::array<Complex, kUnknowns>& b, int chart) {
    for (int i = 0; i < kUnknowns; ++i) {
      for (int j = 0; j < kUnknowns; ++j) {
        const Complex& v = J[i][j < chart ? j : j + 1];
        re[i][j] = v.re;
        im[i][j] = v.im;
      }
      re[i][kUnknowns] = b[i].re;
      im[i][kUnknowns] = b[i].im;
    }
  }

  /// Gauss with row pivots; false where a pivot vanishes or is no number.
  bool solve(std::array<Complex, kUnknowns>& x) {
    constexpr int n = kUnknowns;
#pragma GCC unroll 7  // fixed bounds of the inner loops make vectors of them
    for (int k = 0; k < n; ++k) {
      int pivot = k;
      double largest = -1;
      for (int i = k; i < n; ++i) {
        const double size = re[i][k] * re[i][k] + im[i][k] * im[i][k];
        if (size > largest) {
          largest = size;
          pivot = i;
        }
      }
      if (!(largest > 0)) return false;
      const double r = re[pivot][k] / largest, m = -im[pivot][k] / largest;
      double top_re[n + 1], top_im[n + 1];
      for (int j = k + 1; j <= n; ++j) {
        const double vr = re[pivot][j], vm = im[pivot][j];
        re[pivot][j] = re[k][j];
        im[pivot][j] = im[k][j];
        re[k][j] = top_re[j] = r * vr - m * vm;
        im[k][j] = top_im[j] = r * vm + m * vr;
      }
      re[pivot][k] = re[k][k];
      im[pivot][k] = im[k][k];
      for (int i = k + 1; i < n; ++i) {
        const double fr = re[i][k], fm = im[i][k];
        for (int j = k + 1; j <= n; ++j) {
          re[i][j] -= fr * top_re[j] - fm * top_im[j];
          im[i][j] -= fr * top_im[j] + fm * top_re[j];
        }
      }
    }
    for (int k = n - 1; k >= 0; --k) {
      Complex v{re[k][n], im[k][n]};
      for (int j = k + 1; j < n; ++j) v -= Complex{re[k][j], im[k][j]} * x[j];
      x[k] = v;
    }
    return std::isfinite(x[0].re) && std::isfinite(x[0].im);
  }
};

using Step = std::array<Complex, kUnknowns>;

void add(PointT<double>& z, int chart, const Step& step, double factor = 1) {
  for (int j = 0; j < kUnknowns; ++j) z[j < chart ? j : j + 1] += factor * step[j];
}
/// The chart is one of e, so that three unknowns are of e and four of g.
double largest(const Step& step, double weight) {
  double e = 0, g = 0;
  for (int j = 0; j < kUnknowns; ++j) (j < 3 ? e : g) = std::max(j < 3 ? e : g, squared(step[j]));
  return std::sqrt(std::max(e, g / (weight * weight)));
}
double weight_of(const PointT<double>& z) {
  double g = 1;
  for (int k = 4; k <= kUnknowns; ++k) g = std::max(g, squared(z[k]));
  return std::sqrt(g);
}

/// One step of Newton in the chart.
bool newton(const Legs& legs, PointT<double>& z, int chart, double weight, double& moved) {
  std::array<Complex, kUnknowns> f;
  std::array<PointT<double>, kUnknowns> J;
  Step step;
  equations(legs, z, f, J);
  if (!System(J, f, chart).solve(step)) return false;
  add(z, chart, step, -1);
  moved = largest(step, weight);
  return true;
}

/// The way between two platforms: legs at r and their derivative by r.
struct Way {
  const Legs& from;
  const Legs& to;
  const Legs& bend;

  void at(double r, Legs& legs, Legs* derivative) const {
    const double c = r * (1 - r), dc = 1 - 2 * r;
    const auto one = [&](const Complex& u, const Complex& v, const Complex& w, Complex& p, Complex* dp) {
      const Complex d = u - v;
      p = v + r * d + c * w;
      if (dp != nullptr) *dp = d + dc * w;
    };
    for (int i = 0; i < kLegs; ++i) {
      for (int k = 0; k < 3; ++k) {
        one(from.difference[i][k], to.difference[i][k], bend.difference[i][k], legs.difference[i][k],
            derivative ? &derivative->difference[i][k] : nullptr);
        one(from.sum[i][k], to.sum[i][k], bend.sum[i][k], legs.sum[i][k],
            derivative ? &derivative->sum[i][k] : nullptr);
      }
      one(from.square[i], to.square[i], bend.square[i], legs.square[i], derivative ? &derivative->square[i] : nullptr);
    }
  }
};

/// dz/dr of the zero that passes through z.
bool tangent(const Way& way, double r, const PointT<double>& z, int chart, Step& out) {
  Legs legs, dp;
  way.at(r, legs, &dp);
  std::array<Complex, kUnknowns> f, df;
  std::array<PointT<double>, kUnknowns> J;
  equations(legs, z, f, J);
  const Quaternion<double> e = rotation_part(z);
  const Complex ee = dot(e, e);
  df[0] = {};
  // The right half of J is 2 y_1 and 2 (y_i - y_1).
  const Quaternion<double> first = turned(dp.difference[0], dp.sum[0], e);
  const Quaternion<double> y = translation_part(J[1]);
  df[1] = dp.square[0] * ee + dot(y, first);
  for (int i = 1; i < kLegs; ++i) {
    const Quaternion<double> moved = turned(dp.difference[i], dp.sum[i], e);
    const Quaternion<double> d = translation_part(J[i + 1]);
    df[i + 1] = dp.square[i] * ee + dot(d, first);
    for (int k = 0; k < 4; ++k) df[i + 1] += (y[k] + d[k]) * moved[k];
  }
  return System(J, df, chart).solve(out);
}

}  // namespace

Point point_of(const PointT<double>& z) {
  Point out;
  double size = 0;
  for (int k = 0; k < 4; ++k) {
    if (squared(z[k]) > size) {
      size = squared(z[k]);
      out.chart = k;
    }
  }
  const Complex scale = inverse_of(z[out.chart]);
  for (int k = 0; k <= kUnknowns; ++k) out.z[k] = scale * z[k];
  out.z[out.chart] = {1, 0};
  out.weight = weight_of(out.z);
  return out;
}

Point point_of(const Pose& X) {
  const Eigen::Quaterniond e(X.R);
  const Eigen::Quaterniond g = Eigen::Quaterniond(0, X.p.x(), X.p.y(), X.p.z()) * e;
  return point_of(
      PointT<double>{{{e.w(), 0}, {e.x(), 0}, {e.y(), 0}, {e.z(), 0}, {g.w(), 0}, {g.x(), 0}, {g.y(), 0}, {g.z(), 0}}});
}

Pose pose_of(const Point& point) {
  const auto& z = point.z;
  const Eigen::Quaterniond e(z[0].re, z[1].re, z[2].re, z[3].re), g(z[4].re, z[5].re, z[6].re, z[7].re);
  Pose X;
  X.R = e.normalized().toRotationMatrix();
  X.p = (g * e.conjugate()).vec() / e.squaredNorm();
  return X;
}

bool same(const Point& a, const Point& b, double tolerance) {
  // In b's chart, where a has that coordinate.
  const Complex& pivot = a.z[b.chart];
  for (int k = 0; k <= kUnknowns; ++k)
    if (modulus(a.z[k] - pivot * b.z[k]) > tolerance * (k < 4 ? 1 : b.weight)) return false;
  return true;
}

template <class T>
void equations(const LegsT<T>& legs, const PointT<T>& z, std::array<ComplexT<T>, kUnknowns>& f,
               std::array<PointT<T>, kUnknowns>& J) {
  const Quaternion<T> e = rotation_part(z), g = translation_part(z);
  const ComplexT<T> ee = dot(e, e);
  f[0] = dot(e, g);
  for (int k = 0; k < 4; ++k) {
    J[0][k] = g[k];
    J[0][4 + k] = e[k];
  }
  Quaternion<T> y = turned(legs.difference[0], legs.sum[0], e);
  for (int k = 0; k < 4; ++k) y[k] = g[k] - y[k];
  const Quaternion<T> back = turned(legs.difference[0], legs.sum[0], y);
  f[1] = dot(y, y) - legs.square[0] * ee;
  for (int k = 0; k < 4; ++k) {
    J[1][k] = 2.0 * (back[k] - legs.square[0] * e[k]);
    J[1][4 + k] = 2.0 * y[k];
  }
  for (int i = 1; i < kLegs; ++i) {
    Quaternion<T> d = turned(legs.difference[i], legs.sum[i], e), y_i;
    for (int k = 0; k < 4; ++k) {
      d[k] = -d[k];
      y_i[k] = y[k] + d[k];
    }
    f[i + 1] = 2.0 * dot(d, y) + dot(d, d) - legs.square[i] * ee;
    std::array<ComplexT<T>, 3> difference, sum;
    for (int k = 0; k < 3; ++k) {
      difference[k] = legs.difference[0][k] + legs.difference[i][k];
      sum[k] = legs.sum[0][k] + legs.sum[i][k];
    }
    const Quaternion<T> own = turned(difference, sum, y_i);
    for (int k = 0; k < 4; ++k) {
      J[i + 1][k] = 2.0 * (own[k] - back[k] - legs.square[i] * e[k]);
      J[i + 1][4 + k] = 2.0 * d[k];
    }
  }
}
template void equations(const LegsT<double>&, const PointT<double>&, std::array<ComplexT<double>, kUnknowns>&,
                        std::array<PointT<double>, kUnknowns>&);
template void equations(const LegsT<Interval>&, const PointT<Interval>&, std::array<ComplexT<Interval>, kUnknowns>&,
                        std::array<PointT<Interval>, kUnknowns>&);

bool polish(const Legs& legs, Point& point) {
  double before = 1e-2;
  for (int k = 0; k < 8; ++k) {
    Point next = point;
    double moved = 0;
    if (!newton(legs, next.z, next.chart, next.weight, moved) || !(moved <= before)) return k > 0 && before < 1e-10;
    point = next;
    if (moved < 1e-15) return true;
    before = 0.5 * moved;
  }
  return true;
}

PathEnd track(const Legs& from, const Legs& to, const Legs& bend, const Point& start, const TrackOptions& options) {
  const Way way{from, to, bend};
  PathEnd out;
  out.point = start;
  double r = 1, h = 0.05;
  while (out.steps < options.max_steps) {
    ++out.steps;
    h = std::min(h, r);
    const double to_r = h < r ? r - h : 0;
    const int chart = out.point.chart;
    Step k1, k2, k3, k4;
    PointT<double> z = out.point.z;
    const auto stage = [&](const Step& k, double share) {
      PointT<double> at = out.point.z;
      add(at, chart, k, -share * h);
      return at;
    };
    double first = 0, second = 0;
    bool good = tangent(way, r, z, chart, k1) && tangent(way, r - 0.5 * h, stage(k1, 0.5), chart, k2) &&
                tangent(way, r - 0.5 * h, stage(k2, 0.5), chart, k3) && tangent(way, to_r, stage(k3, 1), chart, k4);
    if (good) {
      for (int j = 0; j < kUnknowns; ++j) k1[j] += 2.0 * (k2[j] + k3[j]) + k4[j];
      add(z, chart, k1, -h / 6);
      Legs legs;
      way.at(to_r, legs, nullptr);
      good = newton(legs, z, chart, out.point.weight, first) && first <= options.accuracy &&
             newton(legs, z, chart, out.point.weight, second) && second <= 0.01 * (first + options.accuracy);
    }
    if (good) {
      out.point.z = z;
      r = to_r;
      double size = 0;
      for (int k = 0; k < 4; ++k) size = std::max(size, squared(z[k]));
      if (size > 4) out.point = point_of(z);
      out.point.weight = weight_of(out.point.z);
      if (r == 0) break;
      const double growth = 0.8 * std::pow(options.accuracy / std::max(first, 1e-12), 0.2);
      h *= std::clamp(growth, 0.5, 2.0);
    } else {
      h *= 0.4;
      if (h < options.smallest * std::max(r, 1e-3)) break;
      if (r < 1e-8) break;
    }
  }
  out.left = r;
  out.point = point_of(out.point.z);
  return out;
}

std::optional<double> certify(const LegsT<Interval>& legs, const Point& point) {
  constexpr int n = kUnknowns;
  const auto bound = [](const ComplexT<Interval>& c) { return c.re.magnitude() + c.im.magnitude(); };  // >= modulus
  const auto exact = [](const Complex& c) { return ComplexT<Interval>{Interval(c.re), Interval(c.im)}; };
  PointT<Interval> z;
  for (int k = 0; k <= n; ++k) z[k] = exact(point.z[k]);
  std::array<ComplexT<Interval>, n> f;
  std::array<PointT<Interval>, n> J;
  equations(legs, z, f, J);

  // X ~ J^-1, column by column from the middles.
  std::array<PointT<double>, n> J_mid;
  for (int i = 0; i < n; ++i)
    for (int k = 0; k <= n; ++k) J_mid[i][k] = {J[i][k].re.mid(), J[i][k].im.mid()};
  std::array<std::array<ComplexT<Interval>, n>, n> X;
  for (int j = 0; j < n; ++j) {
    std::array<Complex, n> unit{}, column;
    unit[j] = {1, 0};
    if (!System(J_mid, unit, point.chart).solve(column)) return {};
    for (int i = 0; i < n; ++i) X[i][j] = exact(column[i]);
  }

  // |f_i''(h, k)| where the components of e in h and k are at most 1, those of g at most the weight w.
  const auto row_sum = [&](int i) {
    Interval sum = 0.0;
    for (int k = 0; k < 3; ++k) sum += Interval(bound(legs.difference[i][k])) + Interval(bound(legs.sum[i][k]));
    return sum;
  };
  const Interval w = point.weight, y = w + row_sum(0);
  std::array<Interval, n> curvature;
  curvature[0] = Interval(8.0) * w;
  curvature[1] = Interval(8.0) * (square(y) + Interval(bound(legs.square[0])));
  for (int i = 1; i < kLegs; ++i) {
    const Interval d = row_sum(i);
    curvature[i + 1] = Interval(8.0) * (Interval(2.0) * d * y + square(d) + Interval(bound(legs.square[i])));
  }

  // T(z) - z, how far T' is from 0 at z, and how fast it changes.
  Interval step = 0.0, slope = 0.0, change = 0.0;
  const auto raise = [](Interval& a, const Interval& b) { a = Interval(std::max(a.hi(), b.hi())); };
  for (int i = 0; i < n; ++i) {
    ComplexT<Interval> shift;
    Interval row_slope = 0.0, row_change = 0.0;
    for (int j = 0; j < n; ++j) {
      shift += X[i][j] * f[j];
      row_change += Interval(bound(X[i][j])) * curvature[j];
    }
    for (int k = 0; k < n; ++k) {
      ComplexT<Interval> entry{i == k ? -1.0 : 0.0, 0.0};
      for (int j = 0; j < n; ++j) entry += X[i][j] * J[j][k < point.chart ? k : k + 1];
      row_slope += Interval(bound(entry)) * (k < 3 ? Interval(1.0) : w);
    }
    const Interval own = Interval(1.0) / (i < 3 ? Interval(1.0) : w);
    raise(step, own * Interval(bound(shift)));
    raise(slope, own * row_slope);
    raise(change, own * row_change);
  }
  // T maps the ball of this radius into itself and contracts it.
  const Interval radius = Interval(2.0) * step + Interval(std::numeric_limits<double>::min());
  const bool into = step + radius * (slope + Interval(0.5) * change * radius) <= radius;
  const bool contracts = slope + change * radius < Interval(1.0);
  if (!into || !contracts) return {};
  return radius.hi();
}

bool surely_different(const Point& a, double radius_a, const Point& b, double radius_b) {
  // Equal points have z_a[k] z_b[c] = z_a[c] z_b[k]; with c the chart of b, z_b[c] = 1 exactly.
  const double radii = radius_a + radius_b;
  if (!(radii < 0.1)) return false;
  const double slack = 4 * radii + 1e-14;
  const Complex& pivot = a.z[b.chart];
  for (int k = 0; k <= kUnknowns; ++k)
    if (modulus(a.z[k] - pivot * b.z[k]) > slack * (k < 4 ? 1 : a.weight + b.weight)) return true;
  return false;
}

namespace {
// clang-format off
#include "start_platform.inc"  // NOLINT(bugprone-suspicious-include): a table
// clang-format on
}  // namespace

const Legs& start_legs() {
  return kStartLegs;
}

std::span<const Point> start_points() {
  static const std::vector<Point> points = [] {
    std::vector<Point> out;
    for (const PointT<double>& z : kStartZeros) {
      out.push_back(point_of(z));
      polish(kStartLegs, out.back());
    }
    return out;
  }();
  return points;
}

}  // namespace polypod::machine::leg_homotopy
