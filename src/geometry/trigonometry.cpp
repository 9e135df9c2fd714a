// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/geometry/trigonometry.hpp"

#include <cmath>
#include <cstring>

namespace polypod {
namespace {

// Two at a time, which every processor of 64 bits can.
constexpr int kLanes = 2;
using Lanes = double __attribute__((vector_size(kLanes * sizeof(double))));
using Bits = long long __attribute__((vector_size(kLanes * sizeof(double))));

Lanes lanes_at(const double* x) {
  return Lanes{x[0], x[1]};  // each by itself: both were stored by themselves a moment ago
}
void put(const Lanes& lanes, double* out) {
  std::memcpy(out, &lanes, sizeof lanes);
}
Bits bits(const Lanes& x) {
  return reinterpret_cast<Bits>(x);
}
Lanes lanes(const Bits& x) {
  return reinterpret_cast<Lanes>(x);
}
/// a where the mask is set, else b.
Lanes pick(const Bits& mask, const Lanes& a, const Lanes& b) {
  return lanes((mask & bits(a)) | (~mask & bits(b)));
}

// A sum with it keeps no bits behind the point: its last bits are those of the nearest whole number.
constexpr double kRound = 0x1.8p52;
constexpr double kFarthest = 1e5;
constexpr double kQuartersPerRadian = 0x1.45f306dc9c883p-1;
// The first 33 bits of pi / 2, whose products with 20 bits are exact, and the 53 after them.
constexpr double kQuarterHigh = 0x1.921fb544p0, kQuarterLow = 0x1.0b4611a626331p-34;

/// sin y = y + y^3 (S0 + y^2 S1 ...), cos y = 1 - y^2 / 2 + y^4 (C0 + y^2 C1 ...) for |y| <= pi / 4.
struct Turn {
  Lanes cosine, sine;
  explicit Turn(const Lanes& angle) {
    const Lanes shifted = angle * kQuartersPerRadian + kRound, quarters = shifted - kRound;
    const Bits quarter = bits(shifted);
    const Lanes first = angle - quarters * kQuarterHigh, second = quarters * kQuarterLow;
    const Lanes y = first - second, rest = (first - y) - second, z = y * y;
    const Lanes s = -1.66666666666666324348e-01 +
                    z * (8.33333333332248946124e-03 +
                         z * (-1.98412698298579493134e-04 +
                              z * (2.75573137070700676789e-06 +
                                   z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))));
    const Lanes c = 4.16666666666666019037e-02 +
                    z * (-1.38888888888741095749e-03 +
                         z * (2.48015872894767294178e-05 +
                              z * (-2.75573143513906633035e-07 +
                                   z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11))));
    const Lanes half = 0.5 * z, near_one = 1 - half;
    const Lanes sine_of_rest = y + (y * (z * s) + rest * near_one);
    const Lanes cosine_of_rest = near_one + (((1 - near_one) - half) + (z * z * c - y * rest));
    // An odd quarter changes the two over; each has its sign changed in two of the four quarters.
    const Bits odd = -(quarter & 1);
    sine = lanes(bits(pick(odd, cosine_of_rest, sine_of_rest)) ^ ((quarter & 2) << 62));
    cosine = lanes(bits(pick(odd, sine_of_rest, cosine_of_rest)) ^ (((quarter + 1) & 2) << 62));
  }
};

}  // namespace

void cosines_and_sines(const double* angles, int count, double* cosines, double* sines) {
  bool far = false;
  for (int i = 0; i < count; i += kLanes) {
    const Lanes here = lanes_at(angles + i);
    const Turn turn(here);
    put(turn.cosine, cosines + i);
    put(turn.sine, sines + i);
    for (int lane = 0; lane < kLanes; ++lane) far |= !(std::abs(here[lane]) < kFarthest);
  }
  if (!far) return;
  for (int i = 0; i < count; ++i) {
    cosines[i] = std::cos(angles[i]);
    sines[i] = std::sin(angles[i]);
  }
}

#ifdef __x86_64__
namespace {
[[gnu::target("avx2")]] void four_at_a_time(const double* y, const double* x, double* out, int count) {
  using Four = double __attribute__((vector_size(32)));
  using FourBits = long long __attribute__((vector_size(32)));
  for (int i = 0; i < count; i += 4) {
    angles_at<Four, FourBits>(Four{x[i], x[i + 1], x[i + 2], x[i + 3]}, Four{y[i], y[i + 1], y[i + 2], y[i + 3]},
                              out + i);
  }
}
}  // namespace
#endif

bool angles_of_four(const double* y, const double* x, double* out, int count) {
#ifdef __x86_64__
  static const bool wide = __builtin_cpu_supports("avx2") != 0;
  if (wide) four_at_a_time(y, x, out, count);
  return wide;
#else
  (void)y, (void)x, (void)out, (void)count;
  return false;
#endif
}

}  // namespace polypod
