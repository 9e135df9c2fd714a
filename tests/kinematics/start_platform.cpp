// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Prints src/families/hexapod/start_platform.inc: a general complex platform and its 40 zeros, found by monodromy
// alone: one zero is made by hand, and closed ways through other platforms turn it into the others.
//   start_platform [seed] > src/families/hexapod/start_platform.inc
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include "leg_homotopy.hpp"

namespace {

/// Of six tried, the one whose paths to random platforms were lost least often.
constexpr unsigned kSeed = 5;

using namespace polypod::machine;
using namespace polypod::machine::leg_homotopy;

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  /// Two decimals, so that the printed platform is the one that was used.
  Complex complex(double size) {
    const auto part = [&] {
      return std::round(200 * size * (static_cast<double>(engine_()) / 4294967295.0 - 0.5)) / 100;
    };
    const double re = part();
    return {re, part()};
  }
  Legs legs() {
    Legs out;
    for (int i = 0; i < kLegs; ++i) {
      for (int k = 0; k < 3; ++k) {
        out.difference[i][k] = complex(1);
        out.sum[i][k] = complex(1);
      }
      out.square[i] = complex(2);
    }
    return out;
  }

 private:
  std::mt19937 engine_;
};

/// A platform with one known zero: any pose fits some lengths.
Legs with_one_zero(Random& random, Point& zero) {
  PointT<double> z;
  for (Complex& c : z) c = random.complex(1);
  Complex rest;
  for (int k = 1; k < 4; ++k) rest += z[k] * z[4 + k];
  z[4] = -(rest * inverse_of(z[0]));
  zero = point_of(z);
  Legs legs = random.legs();
  for (Complex& s : legs.square) s = {};
  std::array<Complex, kUnknowns> f;
  std::array<PointT<double>, kUnknowns> J;
  equations(legs, zero.z, f, J);
  Complex ee;
  for (int k = 0; k < 4; ++k) ee += zero.z[k] * zero.z[k];
  for (int i = 0; i < kLegs; ++i) legs.square[i] = f[i + 1] * inverse_of(ee);
  return legs;
}

}  // namespace

int main(int argc, char** argv) {
  Random random(argc > 1 ? static_cast<unsigned>(std::atoi(argv[1])) : kSeed);
  std::vector<Point> zeros(1);
  const Legs first = with_one_zero(random, zeros[0]);
  constexpr int kLoops = 60;  // some ten find all 40; the others show that there are no more
  for (int loop = 0; loop < kLoops; ++loop) {
    const Legs there = random.legs(), bend = random.legs(), bend_back = random.legs();
    for (std::size_t i = 0, n = zeros.size(); i < n; ++i) {
      const PathEnd away = track(first, there, bend, zeros[i]);
      if (away.left > 0) continue;
      PathEnd back = track(there, first, bend_back, away.point);
      if (back.left > 0 || !polish(first, back.point)) continue;
      bool known = false;
      for (const Point& z : zeros) known = known || same(z, back.point, 1e-6);
      if (!known) zeros.push_back(back.point);
    }
  }
  std::fprintf(stderr, "%zu zeros\n", zeros.size());
  const Legs start = random.legs();
  const auto print = [](const Complex& c) { std::printf("{%.2f, %.2f}", c.re, c.im); };
  std::printf("// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause\n");
  std::printf(
      "// Made by tests/kinematics/start_platform.cpp. Differences and sums of joints, then squares of lengths;\n// "
      "those of legs 2 to 6 less those of leg 1.\n");
  std::printf("const Legs kStartLegs{{{");
  for (int which = 0; which < 2; ++which) {
    for (int i = 0; i < kLegs; ++i) {
      std::printf("\n    {{");
      for (int k = 0; k < 3; ++k) {
        print(which == 0 ? start.difference[i][k] : start.sum[i][k]);
        std::printf(k < 2 ? ", " : "}},");
      }
    }
    std::printf(which == 0 ? "\n}}, {{" : "\n}}, {{\n    ");
  }
  for (int i = 0; i < kLegs; ++i) {
    print(start.square[i]);
    std::printf(i < 5 ? ", " : "\n}}};\n");
  }
  std::printf("// Coordinates (e, g) of its zeros, to be polished.\nconst PointT<double> kStartZeros[]{\n");
  for (const Point& z : zeros) {
    PathEnd end = track(first, start, Legs{}, z);
    if (end.left > 0 || !polish(start, end.point)) {
      std::fprintf(stderr, "a path was lost: take another seed\n");
      return 1;
    }
    std::printf("    {{");
    for (int k = 0; k <= kUnknowns; ++k)
      std::printf("{%.8g, %.8g}%s", end.point.z[k].re, end.point.z[k].im, k < kUnknowns ? ", " : "}},\n");
  }
  std::printf("};\n");
  return 0;
}
