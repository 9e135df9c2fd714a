// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/force.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "history.hpp"
#include "integrals.hpp"

namespace polypod::cutting {
namespace {

constexpr double kPi = std::numbers::pi;

// Nodes in (0, 1) and weights of Gauss-Legendre quadrature on [-1, 1]; the rule is symmetric.
constexpr int kGaussPairs = 8;
constexpr std::array<double, kGaussPairs> kGaussNode{
    0.0950125098376374402, 0.2816035507792589132, 0.4580167776572273863, 0.6178762444026437484,
    0.7554044083550030339, 0.8656312023878317439, 0.9445750230732325761, 0.9894009349916499326};
constexpr std::array<double, kGaussPairs> kGaussWeight{
    0.1894506104550684963, 0.1826034150449235889, 0.1691565193950025382, 0.1495959888165767321,
    0.1246289712555338720, 0.0951585116824927848, 0.0622535239386478929, 0.0271524594117540949};

template <class F>
double gauss(F&& f, double a, double b) {
  const double mid = 0.5 * (a + b), half = 0.5 * (b - a);
  double sum = 0;
  for (int i = 0; i < kGaussPairs; ++i)
    sum += kGaussWeight[i] * (f(mid + half * kGaussNode[i]) + f(mid - half * kGaussNode[i]));
  return half * sum;
}

// Integral of sin^p over a .. b in 0 .. pi/2. With phi = v^4 the kink of sin^p at 0 (p is no whole number) becomes
// v^(4 p + 3), smooth enough for the 16-point rule.
double sine_power_quarter(double p, double a, double b) {
  if (!(b > a)) return 0;
  const auto f = [p](double v) {
    const double v3 = v * v * v;
    return std::pow(std::sin(v3 * v), p) * 4 * v3;
  };
  return gauss(f, std::sqrt(std::sqrt(a)), std::sqrt(std::sqrt(b)));
}

// Integral of sin^p over a .. b in 0 .. pi, folded at pi/2.
double sine_power(double p, double a, double b) {
  return sine_power_quarter(p, std::min(a, kPi / 2), std::min(b, kPi / 2)) +
         sine_power_quarter(p, std::max(0.0, kPi - std::max(b, kPi / 2)), kPi - std::max(a, kPi / 2));
}

}  // namespace

SpanIntegral integrate_span(const Material& m, double phi_a, double phi_b) {
  const double a = std::clamp(phi_a, 0.0, kPi), b = std::clamp(phi_b, a, kPi);
  const double sin_a = std::sin(a), sin_b = std::sin(b);
  const double cosine = sin_b - sin_a;            // of cos
  const double sine = std::cos(a) - std::cos(b);  // of sin
  double power = sine;                            // of sin^x
  double power_cosine = 0;                        // of sin^x cos
  double power_sine = 0;                          // of sin^(x + 1)
  if (m.exponent == 1) {
    power_cosine = 0.5 * (sin_b * sin_b - sin_a * sin_a);
    power_sine = 0.5 * (b - a) - 0.5 * (sin_b * std::cos(b) - sin_a * std::cos(a));
  } else {
    const double x = m.exponent;
    power = sine_power(x, a, b);
    power_cosine = (std::pow(std::max(0.0, sin_b), x + 1) - std::pow(std::max(0.0, sin_a), x + 1)) / (x + 1);
    power_sine = sine_power(x + 1, a, b);
  }
  return {{-m.kte * cosine - m.kre * sine, m.kte * sine - m.kre * cosine, m.kae * (b - a)},
          {-m.ktc * power_cosine - m.krc * power_sine, m.ktc * power_sine - m.krc * power_cosine, m.kac * power}};
}

Engagement straight_engagement(const Cutter& cutter, CutSide side, double ae, double ap) {
  if (side == CutSide::slot) return {0, kPi, ap};
  const double width = std::clamp(ae, 0.0, cutter.diameter);
  const double span = std::acos(1 - 2 * width / cutter.diameter);
  return side == CutSide::up ? Engagement{0, span, ap} : Engagement{kPi - span, kPi, ap};
}

Vec3 mean_force(const Cutter& cutter, const Material& material, const Engagement& engagement, double feed_per_tooth) {
  if (!(engagement.exit > engagement.entry) || !(engagement.depth > 0)) return Vec3::Zero();
  const SpanIntegral span = integrate_span(material, engagement.entry, engagement.exit);
  const double chip =
      material.exponent == 1 ? feed_per_tooth : std::pow(std::max(0.0, feed_per_tooth), material.exponent);
  return cutter.teeth * engagement.depth / (2 * kPi) * (span.edge + chip * span.cut);
}

Eigen::Matrix<double, 3, 6> unit_forces_with_runout(const Cutter& cutter, double exponent, const Engagement& engagement,
                                                    double feed_per_tooth, double eccentricity, double phase) {
  if (!(engagement.exit > engagement.entry) || !(engagement.depth > 0)) return Eigen::Matrix<double, 3, 6>::Zero();
  constexpr int kSteps = 360;
  const int teeth = cutter.teeth;
  const double step = (engagement.exit - engagement.entry) / kSteps;
  const auto radius = [&](int tooth) { return eccentricity * std::cos(phase + tooth * cutter.pitch_angle()); };
  // What tooth j stands out over the one m places before it: its chip is the least of m s_z sin(phi) and this.
  Eigen::MatrixXd ahead(teeth, teeth);
  for (int j = 0; j < teeth; ++j)
    for (int m = 1; m <= teeth; ++m) ahead(j, m - 1) = radius(j) - radius(j - m);
  Vec3 edge = Vec3::Zero(), cut = Vec3::Zero();  // sums of (cos, sin, 1), of the teeth that cut and times the chip
  for (int k = 0; k < kSteps; ++k) {
    const double phi = engagement.entry + (k + 0.5) * step, s = std::sin(phi), c = std::cos(phi);
    double count = 0, chips = 0;
    for (int j = 0; j < teeth; ++j) {
      double h = feed_per_tooth * s + ahead(j, 0);
      for (int m = 2; m <= teeth; ++m) h = std::min(h, m * feed_per_tooth * s + ahead(j, m - 1));
      if (!(h > 0)) continue;
      count += 1;
      chips += exponent == 1 ? h : std::pow(h, exponent);
    }
    edge += count * Vec3(c, s, 1);
    cut += chips * Vec3(c, s, 1);
  }
  Eigen::Matrix<double, 3, 6> out;
  int column = 0;
  for (const Vec3& sum : {cut, edge}) {  // (5.9), (5.10) with dFt, dFr, dFa of one coefficient each
    out.col(column++) = Vec3(-sum.x(), sum.y(), 0);
    out.col(column++) = Vec3(-sum.y(), -sum.x(), 0);
    out.col(column++) = Vec3(0, 0, sum.z());
  }
  return engagement.depth / (2 * kPi) * step * out;
}

Vec3 mean_force_with_runout(const Cutter& cutter, const Material& m, const Engagement& engagement,
                            double feed_per_tooth, double eccentricity, double phase) {
  Eigen::Matrix<double, 6, 1> coefficients;
  coefficients << m.ktc, m.krc, m.kac, m.kte, m.kre, m.kae;
  return unit_forces_with_runout(cutter, m.exponent, engagement, feed_per_tooth, eccentricity, phase) * coefficients;
}

void add_disc(const Cutter& cutter, const Material& material, double entry, double exit, double z, double dz,
              double feed_per_tooth, ForceHistory& history) {
  const int steps = static_cast<int>(history.angle.size());
  const double step = 2 * kPi / steps;
  const double lag = 2 * std::tan(cutter.helix) * z / cutter.diameter;
  for (int k = 0; k < steps; ++k) {
    for (int i = 0; i < cutter.teeth; ++i) {
      // (5.4), brought to -step/2 .. 2 pi - step/2, so that the part of a turn this step stands for meets 0 .. pi once.
      double phi = std::remainder(history.angle[k] + i * cutter.pitch_angle() - lag, 2 * kPi);
      if (phi < -0.5 * step) phi += 2 * kPi;
      const double from = std::max(entry, phi - 0.5 * step), to = std::min(exit, phi + 0.5 * step);
      if (!(to > from)) continue;
      const double middle = 0.5 * (from + to), s = std::sin(middle), c = std::cos(middle);
      const double share = (to - from) / step * dz;
      const double h = std::max(0.0, feed_per_tooth * s);  // (5.3)
      const double chip = material.exponent == 1 ? h : std::pow(h, material.exponent);
      const double ft = (material.kte + material.ktc * chip) * share;  // (5.7)
      const double fr = (material.kre + material.krc * chip) * share;
      const double fa = (material.kae + material.kac * chip) * share;
      history.force[k] += Vec3(-ft * c - fr * s, ft * s - fr * c, fa);  // (5.9), (5.10)
    }
  }
}

ForceHistory start_history(int steps) {
  ForceHistory history;
  const int n = std::max(steps, kMinHistorySteps);
  history.angle.resize(n);
  history.force.assign(n, Vec3::Zero());
  for (int k = 0; k < n; ++k) history.angle[k] = k * (2 * kPi / n);
  return history;
}

void finish_history(ForceHistory& history) {
  for (const Vec3& f : history.force) {
    history.mean += f;
    history.peak = history.peak.cwiseMax(f.cwiseAbs());
  }
  history.mean /= static_cast<double>(history.force.size());
}

ForceHistory force_history(const Cutter& cutter, const Material& material, const std::vector<Engagement>& engagements,
                           double feed_per_tooth, int steps) {
  ForceHistory history = start_history(steps);
  for (const Engagement& e : engagements) {
    if (!(e.depth > 0) || !(e.exit > e.entry)) continue;
    const int discs = std::max(1, static_cast<int>(std::ceil(e.depth / (kDiscShare * cutter.diameter) - 1e-9)));
    const double dz = e.depth / discs;
    for (int k = 0; k < discs; ++k) {
      add_disc(cutter, material, e.entry, e.exit, (k + 0.5) * dz, dz, feed_per_tooth, history);  // (5.6)
    }
  }
  finish_history(history);
  return history;
}

}  // namespace polypod::cutting
