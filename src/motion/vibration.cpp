// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/vibration.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace polypod::motion {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
// A frequency is a mode's own within this share: an undamped mode there answers with more than 5e5 of its static
// deflection, which no machine lives to see.
constexpr double kSame = 1e-6;
// A mode that moves the tip by less than this share of the most that one does is not excited there.
constexpr double kStill = 1e-12;

double largest_shape(const ModalModel& model) {
  double out = 0;
  for (const Mode& mode : model.modes) out = std::max(out, mode.shape.head<3>().norm());
  return out;
}

/// The number of the undamped mode at whose own frequency the tip is moved; -1: none.
int resonant(const ModalModel& model, double damping, double frequency) {
  if (damping > 0) return -1;
  const double still = kStill * largest_shape(model);
  for (std::size_t r = 0; r < model.modes.size(); ++r) {
    const Mode& mode = model.modes[r];
    if (std::abs(frequency - mode.frequency) > kSame * mode.frequency) continue;
    if (mode.shape.head<3>().norm() > still) return static_cast<int>(r);
  }
  return -1;
}

/// H F without making H.
Phasor response(const ModalModel& model, double damping, double frequency, const Phasor& force) {
  const double w = kTurn * frequency;
  Phasor out = model.rest.topLeftCorner<3, 3>() * force;
  for (const Mode& mode : model.modes) {
    const double own = kTurn * mode.frequency;
    const std::complex<double> dynamic(own * own - w * w, 2 * damping * own * w);
    if (dynamic == std::complex<double>(0, 0)) continue;  // a mode that does not move the tip
    const Vec3 shape = mode.shape.head<3>();
    out += shape * ((shape.x() * force.x() + shape.y() * force.y() + shape.z() * force.z()) / dynamic);
  }
  return out;
}

}  // namespace

Mat6 ModalModel::compliance() const {
  Mat6 out = rest;
  for (const Mode& mode : modes) {
    const double own = kTurn * mode.frequency;
    out += mode.shape * mode.shape.transpose() / (own * own);
  }
  return out;
}

std::optional<Eigen::Matrix3cd> receptance(const ModalModel& model, double damping, double frequency) {
  if (resonant(model, damping, frequency) >= 0) return std::nullopt;
  Eigen::Matrix3cd out;
  for (int k = 0; k < 3; ++k) out.col(k) = response(model, damping, frequency, Phasor::Unit(k));
  return out;
}

PeriodicForce harmonics_of(const std::vector<Vec3>& one_period, int count) {
  const auto n = static_cast<int>(one_period.size());
  PeriodicForce out;
  for (const Vec3& f : one_period) out.mean += f / n;
  for (int k = 1; k <= count && 2 * k < n; ++k) {
    Phasor sum = Phasor::Zero();
    for (int j = 0; j < n; ++j) {
      // The whole turns of k j / n are left out first, for the digits.
      const double angle = kTurn * static_cast<double>((static_cast<long long>(k) * j) % n) / n;
      sum += one_period[static_cast<std::size_t>(j)].cast<std::complex<double>>() * std::polar(2.0 / n, -angle);
    }
    out.harmonics.push_back(sum);
  }
  return out;
}

PeriodicForce turned(const Mat3& R, const PeriodicForce& force) {
  PeriodicForce out{R * force.mean, force.harmonics};
  for (Phasor& f : out.harmonics) f = R.cast<std::complex<double>>() * f;
  return out;
}

Vibration steady_state(const ModalModel& model, double damping, const PeriodicForce& force, double frequency,
                       const Mat3& axes, int instants) {
  Vibration out;
  std::vector<Phasor> u;
  double largest = 0;
  for (const Phasor& f : force.harmonics) largest = std::max(largest, f.norm());
  for (std::size_t k = 0; k < force.harmonics.size(); ++k) {
    const double at = frequency * static_cast<double>(k + 1);
    const Phasor& f = force.harmonics[k];
    const int r = resonant(model, damping, at);
    if (r >= 0) {
      const Vec3 shape = model.modes[static_cast<std::size_t>(r)].shape.head<3>();
      if (std::abs(f.dot(shape.cast<std::complex<double>>())) > kStill * largest * shape.norm()) {
        out.unbounded = Resonance{r, static_cast<int>(k + 1)};
        return out;
      }
    }
    u.emplace_back(axes.transpose().cast<std::complex<double>>() * response(model, damping, at, f));
  }
  out.path.assign(static_cast<std::size_t>(instants), Vec3::Zero());
  std::vector<std::complex<double>> turn;  // exp(2 pi i j / instants)
  for (int j = 0; j < instants; ++j) turn.push_back(std::polar(1.0, kTurn * j / instants));
  for (int j = 0; j < instants; ++j) {
    Vec3& at = out.path[static_cast<std::size_t>(j)];
    for (std::size_t k = 0; k < u.size(); ++k) {
      const std::complex<double> phase =
          turn[(k + 1) * static_cast<std::size_t>(j) % static_cast<std::size_t>(instants)];
      at += (u[k] * phase).real();
    }
    out.amplitude = std::max(out.amplitude, at.norm());
    out.peak = out.peak.cwiseMax(at.cwiseAbs());
  }
  return out;
}

}  // namespace polypod::motion
