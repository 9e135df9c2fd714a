// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/pieper.hpp"

#include <complex>

#include "six_joints.hpp"

namespace polypod::machine {
namespace {

using six::Complex, six::angle_of, six::conjugate;
using six::kFree, six::kSame;

constexpr double kPi = std::numbers::pi;
// Of the size of an equation's terms: what their rounding leaves of a zero.
constexpr double kRounding = 1e-13;
// Roots are one below this (rad, or slope over the size of the terms): rounding moves a double root by its own root.
constexpr double kDouble = 1e-6;

/// c + a cos x + b sin x.
struct Wave {
  double c = 0, a = 0, b = 0;
  [[nodiscard]] double at(double x) const { return c + a * std::cos(x) + b * std::sin(x); }
};

/// Up to four angles, rising; `met`: the next one is the same root.
struct Roots {
  int count = 0;
  double angle[4];
  bool met[4];

  void add(double x, bool double_root) {
    if (count == 4) return;
    int at = count++;
    for (; at > 0 && angle[at - 1] > x; --at) {
      angle[at] = angle[at - 1];
      met[at] = met[at - 1];
    }
    angle[at] = x;
    met[at] = double_root;
  }
};

/// Both angles at which a wave is 0.
Roots zeros(const Wave& wave) {
  Roots out;
  const double size = std::hypot(wave.a, wave.b);
  if (!(size > kSame) || std::abs(wave.c) > size * (1 + kRounding)) return out;
  const double cosine = std::clamp(-wave.c / size, -1.0, 1.0);
  const double middle = std::atan2(wave.b, wave.a), half = std::acos(cosine);
  for (const double x : {middle - half, middle + half})
    out.add(std::remainder(x, 2 * kPi), half < kDouble || kPi - half < kDouble);
  return out;
}

using C = std::complex<double>;

/// The four roots of z^4 + p3 z^3 + p2 z^2 + p1 z + p0, by the iteration of Durand (1960) and Kerner (1966).
std::array<C, 4> roots_of_quartic(const C& p3, const C& p2, const C& p1, const C& p0) {
  constexpr int kSteps = 200;
  constexpr double kStill = 1e-15;    // of a root's size
  constexpr double kNever0 = 1e-300;  // two roots at one place: the step is large instead of infinite
  const auto p = [&](const C& z) { return (((z + p3) * z + p2) * z + p1) * z + p0; };
  std::array<C, 4> z{C{0.9, 0.3}, C{-0.4, 0.8}, C{-0.7, -0.6}, C{0.5, -0.9}};  // near the unit circle, apart
  for (int k = 0; k < kSteps; ++k) {
    double most = 0;
    for (std::size_t i = 0; i < z.size(); ++i) {
      C others = 1;
      for (std::size_t j = 0; j < z.size(); ++j)
        if (j != i) others *= z[i] - z[j];
      if (std::abs(others) < kNever0) others = kNever0;
      const C step = p(z[i]) / others;
      z[i] -= step;
      most = std::max(most, std::abs(step) / (1 + std::abs(z[i])));
    }
    if (most < kStill) break;
  }
  return z;
}

/// Takes out what two simple roots became that Newton's method brought to one.
void drop_twins(Roots& roots) {
  constexpr double kTwin = 1e-12;  // rad
  int kept = 0;
  for (int i = 0; i < roots.count; ++i) {
    if (kept > 0 && !roots.met[i] && roots.angle[i] - roots.angle[kept - 1] <= kTwin) continue;
    roots.angle[kept] = roots.angle[i];
    roots.met[kept++] = roots.met[i];
  }
  roots.count = kept;
}

/// The zeros of f = sum of w_i^2 s_i over waves, a trigonometric polynomial of degree two: in z = e^(i x) a quartic
/// whose roots on the unit circle count, then Newton's method on f.
Roots zeros_of_squares(const std::array<Wave, 3>& waves, const std::array<double, 3>& sign, const Wave& linear) {
  Wave first = linear;
  double cos2 = 0, sin2 = 0, scale = std::abs(linear.c) + std::hypot(linear.a, linear.b);
  for (std::size_t i = 0; i < waves.size(); ++i) {
    const Wave& w = waves[i];
    const double s = sign[i];
    first.c += s * (w.c * w.c + 0.5 * (w.a * w.a + w.b * w.b));
    first.a += s * 2 * w.c * w.a;
    first.b += s * 2 * w.c * w.b;
    cos2 += s * 0.5 * (w.a * w.a - w.b * w.b);
    sin2 += s * w.a * w.b;
    scale += std::abs(s) * square(std::abs(w.c) + std::hypot(w.a, w.b));
  }
  const double lead = std::hypot(cos2, sin2);
  if (lead < kRounding * scale) return zeros(first);
  const auto f = [&](double x) { return first.at(x) + cos2 * std::cos(2 * x) + sin2 * std::sin(2 * x); };
  const auto slope = [&](double x) {
    return first.b * std::cos(x) - first.a * std::sin(x) + 2 * (sin2 * std::cos(2 * x) - cos2 * std::sin(2 * x));
  };
  const C top = 0.5 * C(cos2, -sin2);
  const C p3 = 0.5 * C(first.a, -first.b) / top, p2 = first.c / top, p1 = 0.5 * C(first.a, first.b) / top,
          p0 = 0.5 * C(cos2, sin2) / top;
  constexpr double kOffCircle = 1e-3;  // a double root lies off the circle by the root of the rounding, and more
  constexpr int kNewtonSteps = 8;
  constexpr double kFlat = 1e-12;  // of the size of the terms: no slope to follow
  constexpr double kFar = 0.1;     // rad: a step that leads to another root
  Roots out;
  for (const C& root : roots_of_quartic(p3, p2, p1, p0)) {
    if (!(std::abs(std::abs(root) - 1) < kOffCircle)) continue;
    double x = std::arg(root);
    for (int k = 0; k < kNewtonSteps; ++k) {
      const double d = slope(x);
      if (std::abs(d) < kFlat * scale) break;
      const double step = f(x) / d;
      if (std::abs(step) > kFar) break;
      x -= step;
    }
    if (std::abs(f(x)) > kRounding * scale) continue;
    out.add(std::remainder(x, 2 * kPi), std::abs(slope(x)) < kDouble * scale);
  }
  drop_twins(out);
  return out;
}

}  // namespace

std::optional<PieperInverse> PieperInverse::of(const SerialArm& arm) {
  const std::optional<six::Axes> axes = six::axes_of(arm);
  if (!axes) return std::nullopt;
  const auto& [w, o, range, X_0] = *axes;
  const auto wrist = six::common_point(o[4], w[4], o[5], w[5]);
  if (!wrist || (*wrist - o[3]).cross(w[3]).norm() > kSame || w[3].cross(w[4]).norm() < kSame) return std::nullopt;
  PieperInverse out;
  out.range_ = range;
  out.u_ = w;
  out.X_0_inverse_ = X_0.inverse();
  out.W_ = *wrist;
  // The common normal of axes 1 and 2.
  const Vec3 across = w[0].cross(w[1]);
  Vec3 o2 = o[1];
  if (across.norm() < kSame) {
    out.o1_ = o[0] + w[0] * w[0].dot(o2 - o[0]);
  } else {
    const Vec3 between = o[1] - o[0];
    out.o1_ = o[0] + w[0] * (between.cross(w[1]).dot(across) / across.squaredNorm());
    o2 = o[1] + w[1] * (between.cross(w[0]).dot(across) / across.squaredNorm());
  }
  const Vec3 d = o2 - out.o1_;
  out.a_ = d.norm();
  if (out.a_ < kSame && across.norm() < kSame) return std::nullopt;  // one axis twice
  out.n_ = out.a_ < kSame ? Vec3(across.normalized()) : Vec3(d / out.a_);
  if (out.a_ < kSame) out.a_ = 0;
  out.e_ = w[1].cross(out.n_);
  out.cos_ = w[0].dot(w[1]);
  out.sin_ = across.norm() < kSame ? 0 : w[0].dot(out.e_);
  const Vec3 m = *wrist - o[2];
  out.k0_ = o[2] - o2 + w[2] * w[2].dot(m);
  out.kc_ = m - w[2] * w[2].dot(m);
  out.ks_ = w[2].cross(m);
  // What joint 3 must move: the height over axis 2 (parallel axes 1 and 2), the distance from o_2 (axes that meet).
  if (out.sin_ == 0 && std::hypot(w[1].dot(out.kc_), w[1].dot(out.ks_)) < kSame) return std::nullopt;
  if (out.a_ == 0 && std::hypot(out.k0_.dot(out.kc_), out.k0_.dot(out.ks_)) < kSame) return std::nullopt;
  if (out.kc_.norm() < kSame) return std::nullopt;
  return out;
}

void PieperInverse::solve(const Pose& X_MT, Branches& out, const double* reference) const {
  for (int k = 0; k < Branches::kCount; ++k) out.exists[k] = out.singular[k] = false;
  const Pose T = X_MT * X_0_inverse_;
  const Vec3 p = T * W_ - o1_;
  const double Z = u_[0].dot(p), K = p.squaredNorm();
  // With v = k0 + kc cos + ks sin: a Re = (K - a^2 - |v|^2) / 2, sin Im = Z - cos (u_2 . v).
  const Wave v2{k0_.squaredNorm() + kc_.squaredNorm(), 2 * k0_.dot(kc_), 2 * k0_.dot(ks_)};
  const Wave along{u_[1].dot(k0_), u_[1].dot(kc_), u_[1].dot(ks_)};
  const Wave real{0.5 * (K - a_ * a_ - v2.c), -0.5 * v2.a, -0.5 * v2.b};
  const Wave imaginary{Z - cos_ * along.c, -cos_ * along.a, -cos_ * along.b};
  Roots roots;
  const bool parallel = sin_ == 0, meeting = a_ == 0;
  if (parallel) {
    roots = zeros(imaginary);
  } else if (meeting) {
    roots = zeros(real);
  } else {
    roots = zeros_of_squares({real, imaginary, along}, {1 / (a_ * a_), 1 / (sin_ * sin_), 1}, {-v2.c, -v2.a, -v2.b});
  }
  const six::Turns turns(u_[3], u_[4], u_[5]);
  int arm = 0;
  for (int r = 0; r < roots.count; ++r) {
    const double q3 = roots.angle[r];
    const Vec3 v = k0_ + kc_ * std::cos(q3) + ks_ * std::sin(q3);
    const Complex flat{v.dot(n_), v.dot(e_)};
    const double size2 = square(flat.re) + square(flat.im), rounding = kRounding * (K + size2 + a_ * a_);
    // R_2 v in the plane square to axis 2: one of its parts, or both.
    Complex turned[2];
    int sides = 1;
    bool met = roots.met[r];
    if (parallel || meeting) {
      const double known = parallel ? real.at(q3) / a_ : imaginary.at(q3) / sin_, rest2 = size2 - known * known;
      if (rest2 < -rounding) continue;
      const double rest = std::sqrt(std::max(0.0, rest2));
      sides = 2;
      met = met || rest2 < rounding;
      turned[0] = parallel ? Complex{known, rest} : Complex{rest, known};
      turned[1] = parallel ? Complex{known, -rest} : Complex{-rest, known};
    } else {
      turned[0] = {real.at(q3) / a_, imaginary.at(q3) / sin_};
    }
    for (int side = 0; side < sides && arm < 4; ++side, ++arm) {
      const bool on_second = size2 < kFree * kFree;
      const double q2 = !on_second             ? angle_of(turned[side] * conjugate(flat))
                        : reference != nullptr ? reference[1]
                                               : 0.0;
      const Mat3 R2 = six::turn(u_[1], q2);
      const Vec3 reached = a_ * n_ + R2 * v;
      const bool over_axis = reached.cross(u_[0]).norm() < kFree;
      const double q1 = !over_axis ? six::angle_between(u_[0], reached, p) : reference != nullptr ? reference[0] : 0.0;
      const Mat3 R = (six::turn(u_[0], q1) * R2 * six::turn(u_[2], q3)).transpose() * T.R;
      const auto wrist = turns.solve(R, reference != nullptr ? reference[3] : 0.0);
      if (!wrist) continue;
      for (int f = 0; f < 2; ++f) {
        const int k = 2 * arm + f;
        const double angles[6] = {q1, q2, q3, wrist->q4[f], wrist->q5[f], wrist->q6[f]};
        for (int i = 0; i < 6; ++i) {
          const double angle = std::remainder(angles[i], 2 * kPi);
          out.joints[k][i] = six::in_range(angle, range_[static_cast<std::size_t>(i)], reference, i);
        }
        out.exists[k] = true;
        out.singular[k] = on_second || over_axis || met || wrist->in_line;
      }
    }
  }
}

kinematics::LimitBits PieperInverse::violations(const double* joints) const {
  return six::violations(range_, joints);
}

kinematics::InverseResult PieperInverse::solve(const Pose& X_MT, const double* reference) const {
  Branches branches;
  solve(X_MT, branches, reference);
  return six::result(branches, range_,
                     "the wrist centre is out of reach of joints 1 to 3, or the wrist cannot turn so far");
}

}  // namespace polypod::machine
