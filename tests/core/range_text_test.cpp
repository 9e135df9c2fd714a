// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/range_text.hpp"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

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
  const std::vector<std::pair<std::string_view, std::string_view>> units{
      {"tolerance_um", "um"},
      {"base.joints_mm[2][1]", "mm"},
      {"joint[3].x_mm", "mm"},
      {"material.Ktc_N_per_mm2", "N/mm2"},
      {"compliance_rad_per_Nm", "rad/Nm"},
      {"systematic[1].expansion_um_per_m_K", "um/(m K)"},
      {"rad_per_Nm", "rad/Nm"},
      {"max_acceleration_mm_per_s2", "mm/s2"},
      {"feed_per_tooth_mm", "mm"},
      {"feed_mm_per_tooth", ""},
      {"temperature.mean_C", "deg C"},
      {"rapid_volume_mm3", "mm3"},
      {"teeth", ""},
      {"m", ""},
      {"arm.count", ""},
      {"", ""},
      {"]", ""},
      {"_per_mm", "mm"},
  };
  for (const auto& [key, unit] : units) EXPECT_EQ(unit_of(key), unit) << key;
}

}  // namespace
}  // namespace polypod::config
