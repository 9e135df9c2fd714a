// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Compiled as leg_kernel.cpp is: without errno and without contraction of a * b + c.
#include "four_dexterities.hpp"

#include <algorithm>
#include <cmath>

#include "lane_algebra.hpp"

namespace polypod::quality {
namespace {

using kinematics::RateMatrix;

template <int N>
POLYPOD_INLINE void of_size(std::span<const RateMatrix> rates, std::array<double, 3>* out) {
  Lanes S[N][N], value[3];
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j)
      for (std::size_t lane = 0; lane < kLanes; ++lane) S[i][j][lane] = rates[std::min(lane, rates.size() - 1)].S(i, j);
  dexterity(S, value);
  for (std::size_t lane = 0; lane < rates.size(); ++lane)
    out[lane] = {value[0][lane], value[1][lane], value[2][lane] / rates[lane].scale};
}

POLYPOD_INLINE bool of_any_size(std::span<const RateMatrix> rates, std::array<double, 3>* out) {
  switch (rates[0].S.rows()) {
    case 3:
      of_size<3>(rates, out);
      return true;
    case 4:
      of_size<4>(rates, out);
      return true;
    case 5:
      of_size<5>(rates, out);
      return true;
    case 6:
      of_size<6>(rates, out);
      return true;
    default:
      return false;
  }
}

#ifdef __x86_64__
[[gnu::target("avx2")]] bool of_any_size_wide(std::span<const RateMatrix> rates, std::array<double, 3>* out) {
  return of_any_size(rates, out);
}
#endif
bool of_any_size_plain(std::span<const RateMatrix> rates, std::array<double, 3>* out) {
  return of_any_size(rates, out);
}

/// False where there is no form for matrices of this size.
bool at_once(std::span<const RateMatrix> rates, std::array<double, 3>* out) {
#ifdef __x86_64__
  static const bool wide = __builtin_cpu_supports("avx2") != 0;
  if (wide) return of_any_size_wide(rates, out);
#endif
  return of_any_size_plain(rates, out);
}

}  // namespace

void dexterities(std::span<const RateMatrix> rates, std::array<double, 3>* out) {
  constexpr double kBlurred = 1e4;
  const auto& first = rates.front().S;
  const bool alike = std::all_of(rates.begin(), rates.end(), [&](const RateMatrix& r) {
    return r.S.rows() == first.rows() && r.S.cols() == first.rows();
  });
  const bool known = alike && at_once(rates, out);
  for (std::size_t i = 0; i < rates.size(); ++i) {
    if (known && out[i][0] < kBlurred && std::isfinite(out[i][2])) continue;
    const kinematics::Dexterity d = kinematics::dexterity(rates[i]);
    out[i] = {d.condition, d.sigma_min, std::abs(d.determinant)};
  }
}

}  // namespace polypod::quality
