// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Pages of cells: their figures are those of the result.
#include "polypod/pages/cell.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>

#include "paths.hpp"
#include "polypod/cell/sweep.hpp"
#include "polypod/core/units.hpp"
#include "polypod/report/html.hpp"
#include "report/markup.hpp"

namespace polypod::pages {
namespace {

using ::testing::HasSubstr;

/// The numbers of a heat map, as a page holds them: float32, little-endian, in base64.
std::vector<float> floats_in(const std::string& html) {
  const std::string kLetters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const std::size_t from = html.find("data-f=\"", html.find("data-plot=\"map\"")) + 8;
  std::vector<std::uint8_t> bytes;
  std::uint32_t bits = 0;
  int held = 0;
  for (const char c : html.substr(from, html.find('"', from) - from)) {
    if (c == '=') break;
    bits = bits << 6 | static_cast<std::uint32_t>(kLetters.find(c));
    held += 6;
    if (held < 8) continue;
    held -= 8;
    bytes.push_back(static_cast<std::uint8_t>(bits >> held));
  }
  std::vector<float> out;
  for (std::size_t i = 0; i + 3 < bytes.size(); i += 4) {
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 4; ++k) word |= static_cast<std::uint32_t>(bytes[i + k]) << (8 * k);
    out.push_back(std::bit_cast<float>(word));
  }
  return out;
}

// The first key of a sweep is the axis upwards, the second the one to the right.
TEST(CellPages, AMapOfASweepHoldsItsRows) {
  cell::Sweep s;
  s.name = "made up";
  s.axes = {{"up", {1, 2, 3, 4}}, {"right", {10, 20, 30, 40, 50}}};
  for (const double up : s.axes[0].values) {
    for (const double right : s.axes[1].values) {
      cell::SweepRow row;
      row.values = {up, right};
      row.simulated = true;
      row.throughput.mean = 100 * up + right;
      s.rows.push_back(row);
    }
  }
  s.best = s.rows.size() - 1;
  const std::string html = cell_sweep_page(s, "1");
  EXPECT_EQ(report::what_is_wrong(html), "");
  EXPECT_THAT(html, HasSubstr("data-grid=\"5 4 10 50 1 4\""));
  const std::vector<float> values = floats_in(html);
  ASSERT_EQ(values.size(), 20U);
  for (int up = 1; up <= 4; ++up)
    for (int right = 1; right <= 5; ++right)
      EXPECT_EQ(values[static_cast<std::size_t>(5 * (up - 1) + right - 1)], 100 * up + 10 * right);
}

TEST(CellPages, SafetyAndCostAreThoseOfTheResult) {
  auto read = cell::read(test::source("examples/picking_line/cell.toml"));
  ASSERT_TRUE(read);
  read->cost.running_price = 30;
  read->cost.hours = 4;
  read->cost.hour_price = 50;
  if (read->cost.rows.empty()) read->cost.rows.push_back({"screw", "", "", "make", 2, 10});
  cell::CellQuestion question = cell::question_of(*read);
  question.settings.seconds = 60;
  const cell::CellResult result = cell::judge_cell(std::move(*read), question);
  const std::string html = cell_page(result, "1");
  EXPECT_EQ(report::what_is_wrong(html), "");
  for (const cell::GuardFigure& g : result.safety.guards) {
    const std::size_t from = html.find("<td>" + g.name + "</td>", html.find("Guards."));
    ASSERT_NE(from, std::string::npos) << g.name;
    const std::string row = html.substr(from, html.find("</tr>", from) - from);
    for (const double value : {units::to_mm(g.needed), units::to_mm(g.actual), g.stopping / units::from_ms(1)}) {
      if (!std::isfinite(value) || !(value > 0)) continue;
      EXPECT_THAT(row, HasSubstr(">" + report::fixed(value, 0) + "<"));
    }
  }
  EXPECT_THAT(html, HasSubstr(report::fixed(units::to_mm(result.safety.guard_needed), 0)));
  // 30 an hour over the items of an hour.
  const double each = 30 / (60 * result.study.throughput.mean);
  EXPECT_THAT(html, HasSubstr("Running costs " + report::number(each)));
  EXPECT_THAT(html, HasSubstr(" an hour costs 200 "));
  EXPECT_THAT(html, HasSubstr(fmt::format("{} places were asked for", result.motions.judged)));
  EXPECT_THAT(html, HasSubstr(fmt::format("; {} are out of reach.", result.motions.out_of_reach)));
}

}  // namespace
}  // namespace polypod::pages
