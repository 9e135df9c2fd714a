// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/stl.hpp"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace polypod::report {

static_assert(std::endian::native == std::endian::little, "STL is little-endian");

Result<std::string> to_stl(const std::vector<std::array<double, 3>>& points,
                           const std::vector<std::array<int, 3>>& triangles) {
  constexpr std::size_t kHeader = 80, kTriangle = 50;
  // The header may not begin with "solid": that would announce the text format.
  std::string out = "Polypod, lengths in mm";
  out.resize(kHeader, ' ');
  out.reserve(kHeader + 4 + kTriangle * triangles.size());
  const auto put = [&](const auto& value) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    out.append(bytes, sizeof value);
  };
  put(static_cast<std::uint32_t>(triangles.size()));
  for (const auto& t : triangles) {
    std::array<std::array<float, 3>, 3> corner{};
    for (std::size_t k = 0; k < 3; ++k) {
      if (t[k] < 0 || static_cast<std::size_t>(t[k]) >= points.size()) {
        return fail("RE103", fmt::format("a triangle uses point {}, but there are {} points", t[k], points.size()));
      }
      for (std::size_t i = 0; i < 3; ++i) {
        const double x = points[static_cast<std::size_t>(t[k])][i];
        if (!std::isfinite(x)) return fail("RE103", fmt::format("point {} is not finite", t[k]));
        corner[k][i] = static_cast<float>(x);
      }
    }
    // The normal of the rounded corners: readers compare it with them.
    std::array<double, 3> a{}, b{};
    for (std::size_t i = 0; i < 3; ++i) {
      a[i] = double(corner[1][i]) - double(corner[0][i]);
      b[i] = double(corner[2][i]) - double(corner[0][i]);
    }
    const std::array<double, 3> n{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (const double x : n) put(static_cast<float>(length > 0 ? x / length : 0));
    for (const auto& c : corner)
      for (const float x : c) put(x);
    put(std::uint16_t{0});
  }
  return out;
}

}  // namespace polypod::report
