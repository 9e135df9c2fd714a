// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/range_text.hpp"

#include <gtest/gtest.h>

namespace polypod::config {
namespace {

TEST(RangeText, SaysWhichEndsAreAllowed) {
  EXPECT_EQ(in_words({0, 100000, true, false}, "um"), "greater than 0 and at most 100000 um");
  EXPECT_EQ(in_words({0, 90, false, true}, "deg"), "at least 0 and less than 90 deg");
  EXPECT_EQ(in_words({-60, 100}), "at least -60 and at most 100");
  EXPECT_EQ(in_words({0, 1, true, true}), "greater than 0 and less than 1");
  EXPECT_EQ(in_words(kPositive, "mm"), "greater than 0 mm");
  EXPECT_EQ(in_words(kNotNegative), "at least 0");
  Range below;
  below.max = 5;
  EXPECT_EQ(in_words(below), "at most 5");
  below.open_max = true;
  EXPECT_EQ(in_words(below, "N"), "less than 5 N");
  EXPECT_EQ(in_words(kAnyFinite, "mm"), "finite");
}

TEST(RangeText, UnitsOfKeys) {
  EXPECT_EQ(unit_of("tolerance_um"), "um");
  EXPECT_EQ(unit_of("base.joints_mm[2][1]"), "mm");
  EXPECT_EQ(unit_of("joint[3].x_mm"), "mm");
  EXPECT_EQ(unit_of("material.Ktc_N_per_mm2"), "N/mm2");
  EXPECT_EQ(unit_of("compliance_rad_per_Nm"), "rad/Nm");
  EXPECT_EQ(unit_of("systematic[1].expansion_um_per_m_K"), "um/(m K)");
  EXPECT_EQ(unit_of("rad_per_Nm"), "rad/Nm");
  EXPECT_EQ(unit_of("max_acceleration_mm_per_s2"), "mm/s2");
  EXPECT_EQ(unit_of("feed_per_tooth_mm"), "mm");
  EXPECT_EQ(unit_of("feed_mm_per_tooth"), "");
  EXPECT_EQ(unit_of("temperature.mean_C"), "deg C");
  EXPECT_EQ(unit_of("rapid_volume_mm3"), "mm3");
  EXPECT_EQ(unit_of("teeth"), "");
  EXPECT_EQ(unit_of("m"), "");
  EXPECT_EQ(unit_of("arm.count"), "");
  EXPECT_EQ(unit_of(""), "");
  EXPECT_EQ(unit_of("]"), "");
  EXPECT_EQ(unit_of("_per_mm"), "mm");
}

}  // namespace
}  // namespace polypod::config
