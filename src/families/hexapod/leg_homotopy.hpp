// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The legs of a platform as polynomials in dual quaternions, their zeros followed from one platform to another, and the
// proof that a point is close to exactly one zero.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "polypod/core/interval.hpp"
#include "polypod/families/hexapod/kinematics.hpp"

namespace polypod::machine::leg_homotopy {

/// A complex number on doubles or intervals (std::complex is specified for neither NaN-free speed nor intervals).
template <class T>
struct ComplexT {
  T re = 0.0, im = 0.0;

  friend ComplexT operator+(const ComplexT& a, const ComplexT& b) { return {a.re + b.re, a.im + b.im}; }
  friend ComplexT operator-(const ComplexT& a, const ComplexT& b) { return {a.re - b.re, a.im - b.im}; }
  friend ComplexT operator-(const ComplexT& a) { return {-a.re, -a.im}; }
  friend ComplexT operator*(const ComplexT& a, const ComplexT& b) {
    return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
  }
  friend ComplexT operator*(double s, const ComplexT& a) { return {T(s) * a.re, T(s) * a.im}; }
  ComplexT& operator+=(const ComplexT& b) { return *this = *this + b; }
  ComplexT& operator-=(const ComplexT& b) { return *this = *this - b; }
};
using Complex = ComplexT<double>;

inline double squared(const Complex& a) {
  return a.re * a.re + a.im * a.im;
}
inline double modulus(const Complex& a) {
  return std::sqrt(squared(a));
}
inline Complex inverse_of(const Complex& a) {
  const double s = 1 / squared(a);
  return {s * a.re, -s * a.im};
}

/// Homogeneous coordinates (e, g) of a pose, scalar parts first: R x = e x e* / <e,e>, t = g e* / <e,e>, <e,g> = 0
/// (Study 1891, with g = t e). They are scaled so that the component of e of the largest modulus, `chart`, is 1. Then g
/// is large at complex modes far away, which symmetric machines have many of; so its errors count by its own size,
/// `weight` = max(1, |g|).
inline constexpr int kUnknowns = 7;
template <class T>
using PointT = std::array<ComplexT<T>, kUnknowns + 1>;
struct Point {
  PointT<double> z{};
  int chart = 0;
  double weight = 1;
};
/// Scales z as above.
Point point_of(const PointT<double>& z);
Point point_of(const Pose& X);
/// The pose of a point whose coordinates are real (imaginary parts are left out) and whose <e,e> is not 0.
Pose pose_of(const Point& point);
/// Whether the two are the same to `tolerance` in all coordinates, those of g by their weight.
bool same(const Point& a, const Point& b, double tolerance);

/// Six legs with joints a_i, b_i and squared lengths s_i on complex numbers, given by a_i - b_i, a_i + b_i and s_i; of
/// legs 2 to 6 less those of leg 1, because that is what keeps its digits where g is large.
template <class T>
struct LegsT {
  std::array<std::array<ComplexT<T>, 3>, kLegs> difference{}, sum{};
  std::array<ComplexT<T>, kLegs> square{};
};
using Legs = LegsT<double>;

/// The equations, homogeneous of degree 2, with y_i = g - a_i e + e b_i (so that y_i e* / <e,e> is the leg):
///   f_0 = <e,g>,  f_1 = <y_1,y_1> - s_1 <e,e>,
///   f_i = <y_i - y_1, y_i + y_1> - (s_i - s_1) <e,e>, i = 2..6,
/// and their derivatives J by the eight coordinates. For general legs 40 zeros have e != 0 (Ronga and Vust 1995, Lazard
/// 1993, Raghavan 1993), each twice (e, g), (-e, -g) and one point here.
template <class T>
void equations(const LegsT<T>& legs, const PointT<T>& z, std::array<ComplexT<T>, kUnknowns>& f,
               std::array<PointT<T>, kUnknowns>& J);

struct TrackOptions {
  double accuracy = 1e-3;  ///< greatest distance of the predictor from the corrected point; smaller is safer and slower
  double smallest =
      1e-9;  ///< a path whose step falls below this share of the way left is given up: its end is singular
  int max_steps = 1000;
};
struct PathEnd {
  Point point;
  double left = 1;  ///< share of the way that was not gone: 0 at a nonsingular end
  int steps = 0;
};
/// Follows one zero of `from` along p(r) = to + r (from - to) + r (1 - r) bend, r from 1 to 0 (squares of lengths,
/// joint by joint): classical Runge-Kutta as predictor, Newton as corrector, step by the corrector's first move. A path
/// through general complex platforms meets no singular one before its end (Morgan and Sommese 1989).
/// Cost: about 2 us a step, 20 to 60 steps.
PathEnd track(const Legs& from, const Legs& to, const Legs& bend, const Point& start, const TrackOptions& options = {});

/// Newton in the chart until it no longer improves; false where it leaves the point or a pivot vanishes.
bool polish(const Legs& legs, Point& point);

/// A proof that the legs, whatever they are within their intervals, have exactly one zero whose coordinates in the
/// point's chart differ from it by at most `radius`
/// (those of g: `radius` times the weight) in modulus: T(z) = z - X f(z), X ~ J^-1, contracts that ball into
/// itself (Krawczyk 1969, with the second derivative, which is constant, bounded by its entries). All bounds are taken
/// with intervals. Where the point is real, the zero is. Empty where the test fails: near a singular zero.
std::optional<double> certify(const LegsT<Interval>& legs, const Point& point);

/// Whether two certified points surely stand for different zeros.
bool surely_different(const Point& a, double radius_a, const Point& b, double radius_b);

/// The platform with complex coordinates and its 40 zeros from which every other one is reached.
const Legs& start_legs();
std::span<const Point> start_points();

}  // namespace polypod::machine::leg_homotopy
