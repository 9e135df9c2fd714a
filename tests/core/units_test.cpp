// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/units.hpp"

#include <gtest/gtest.h>

namespace polypod::units {
namespace {

TEST(Units, KnownValues) {
  EXPECT_DOUBLE_EQ(from_mm(1300), 1.3);
  EXPECT_DOUBLE_EQ(to_mm(0.85), 850);
  EXPECT_DOUBLE_EQ(from_inch(1), 0.0254);
  EXPECT_DOUBLE_EQ(to_inch(0.0254), 1);
  EXPECT_DOUBLE_EQ(from_deg(180), std::numbers::pi);
  EXPECT_DOUBLE_EQ(to_deg(std::numbers::pi / 6), 30);
  EXPECT_DOUBLE_EQ(from_um(100), 1e-4);
  EXPECT_DOUBLE_EQ(to_um(2.73e-4), 273);
  EXPECT_DOUBLE_EQ(from_mm_per_min(1600), 1.6 / 60);
  EXPECT_DOUBLE_EQ(to_mm_per_min(0.03), 1800);
  EXPECT_DOUBLE_EQ(from_per_min(8000), 8000.0 / 60);
  EXPECT_DOUBLE_EQ(to_per_min(200), 12000);
  EXPECT_DOUBLE_EQ(from_N_per_mm2(700), 7e8);
  EXPECT_DOUBLE_EQ(to_N_per_mm2(7e8), 700);
  EXPECT_DOUBLE_EQ(from_N_per_mm(25), 25e3);
  EXPECT_DOUBLE_EQ(to_N_per_mm(25e3), 25);
  EXPECT_DOUBLE_EQ(to_um_per_N(2.5e-6), 2.5);
  EXPECT_DOUBLE_EQ(to_mm3(1e-6), 1000);
}

}  // namespace
}  // namespace polypod::units
