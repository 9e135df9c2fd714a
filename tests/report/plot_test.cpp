// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/report/plot.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <regex>
#include <set>

#include "report/markup.hpp"

namespace polypod::report {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
const Canvas kCanvas{960, "t"};

/// The points of the first curve of this name, in the units of the axes: what a reader of the picture reads off.
std::vector<Point> read_off(const std::string& svg, const std::string& name) {
  const auto four = [&](const char* key) {
    std::vector<double> out;
    const std::size_t at = svg.find(key);
    const char* p = svg.c_str() + at + std::string(key).size();
    for (int i = 0; i < 4; ++i) {
      char* end = nullptr;
      out.push_back(std::strtod(p, &end));
      p = end;
    }
    return out;
  };
  const auto X = four(" data-x=\""), Y = four(" data-y=\"");
  const std::regex wanted("<path d=\"([^\"]*)\"[^>]*data-name=\"" + name + "\"");
  std::smatch match;
  std::vector<Point> points;
  if (!std::regex_search(svg, match, wanted)) return points;
  const std::string d = match[1];
  const std::regex pair("[ML](-?[0-9.]+) (-?[0-9.]+)");
  for (auto it = std::sregex_iterator(d.begin(), d.end(), pair); it != std::sregex_iterator(); ++it) {
    const double x = std::stod((*it)[1]), y = std::stod((*it)[2]);
    points.push_back(
        {X[0] + (x - X[2]) / (X[3] - X[2]) * (X[1] - X[0]), Y[0] + (y - Y[2]) / (Y[3] - Y[2]) * (Y[1] - Y[0])});
  }
  return points;
}

/// The bytes of the first attribute of this name, from base64.
std::vector<std::uint8_t> bytes_in(const std::string& svg, const std::string& key) {
  const std::string start = " " + key + "=\"";
  const std::size_t from = svg.find(start);
  if (from == std::string::npos) return {};
  const std::size_t begin = from + start.size();
  return bytes_of(svg.substr(begin, svg.find('"', begin) - begin));
}
std::vector<float> floats_in(const std::string& svg, const std::string& key) {
  return numbers_of<float>(bytes_in(svg, key));
}

TEST(Number, SensibleDigits) {
  EXPECT_EQ(number(0), "0");
  EXPECT_EQ(number(273.4), "273");
  EXPECT_EQ(number(0.25712), "0.257");
  EXPECT_EQ(number(-4.2),
            "\xE2\x88\x92"
            "4.20");
  EXPECT_EQ(number(999.96), "1000");
  EXPECT_EQ(number(0.00123), "0.00123");
  EXPECT_EQ(number(9.03e-7),
            "9.03e\xE2\x88\x92"
            "7");
  EXPECT_EQ(number(12345.6, 6),
            "12\xE2\x80\x89"
            "345.6");
  EXPECT_EQ(number(123456),
            "123\xE2\x80\x89"
            "456");
  EXPECT_EQ(number(1e6), "1.00e6");
  EXPECT_EQ(number(999999.9), "1.00e6") << "rounding may change the exponent";
  EXPECT_EQ(number(kNaN), "n/a");
  EXPECT_EQ(number(kInf), "n/a");
}

TEST(Number, FixedDecimals) {
  EXPECT_EQ(fixed(1.005, 1), "1.0");
  EXPECT_EQ(fixed(-0.04, 1), "0.0") << "no minus before zero";
  EXPECT_EQ(fixed(1234, 0), "1234") << "four digits need no space";
  EXPECT_EQ(fixed(kNaN, 1), "n/a");
}

TEST(Escape, MarkupAndControlCharacters) {
  EXPECT_EQ(escape("<a href='x'>\"&\n"), "&lt;a href=&#39;x&#39;&gt;&quot;&amp;\n");
  EXPECT_EQ(escape(std::string("a\0b\x1b", 4)),
            "a\xEF\xBF\xBD"
            "b\xEF\xBF\xBD");
  EXPECT_EQ(escape("\xC2\xB5m"), "\xC2\xB5m");
}

TEST(Ticks, RoundStepsInsideTheRange) {
  EXPECT_THAT(nice_ticks(0, 10, 5), ElementsAre(0, 2, 4, 6, 8, 10));
  EXPECT_THAT(nice_ticks(-130, 310, 5), ElementsAre(-100, 0, 100, 200, 300));
  EXPECT_THAT(nice_ticks(0.1, 0.35, 5),
              ElementsAre(0.1, 0.15000000000000002, 0.2, 0.25, 0.30000000000000004, 0.35000000000000003));
  EXPECT_THAT(nice_ticks(1, 1, 5), IsEmpty());
  EXPECT_THAT(nice_ticks(2, 1, 5), IsEmpty());
  EXPECT_THAT(nice_ticks(kNaN, 1, 5), IsEmpty());
  EXPECT_THAT(nice_ticks(0, kInf, 5), IsEmpty());
  for (double scale = 1e-9; scale < 1e9; scale *= 7) {
    const auto ticks = nice_ticks(-scale, 1.7 * scale, 6);
    EXPECT_GE(ticks.size(), 3u);
    EXPECT_LE(ticks.size(), 14u);
    EXPECT_GE(ticks.front(), -scale * (1 + 1e-9));
    EXPECT_LE(ticks.back(), 1.7 * scale * (1 + 1e-9));
  }
}

TEST(LinePlot, PointsCanBeReadOffThePicture) {
  LinePlot plot;
  plot.series = {{"s", {0, 1, 2, 3}, {10, -20, 30, 5}}};
  const auto points = read_off(plot(kCanvas), "s");
  constexpr double kTenthOfAPixel = 0.02;  // of 3 over 900 px, and of 56 over 300 px
  ASSERT_EQ(points.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(points[i].x, plot.series[0].x[i], kTenthOfAPixel);
    EXPECT_NEAR(points[i].y, plot.series[0].y[i], kTenthOfAPixel);
  }
}

// A factor is a distance on a logarithmic axis; its ticks are 1, 2, 5 times powers of ten, or fewer.
TEST(LinePlot, LogarithmicAxes) {
  LinePlot plot;
  plot.y = {"y", "", {}, {}};
  plot.y.log = true;
  plot.series = {{"s", {0, 1, 2, 3, 4}, {1, 10, 100, 1000, kNaN}}};
  const std::string svg = plot(kCanvas);
  std::smatch match;
  ASSERT_TRUE(std::regex_search(svg, match, std::regex("data-y=\"([^ ]*) ([^ ]*) ([^ ]*) ([^ ]*) log\"")));
  std::smatch at;
  // One straight line: simplified, its ends stay.
  const std::regex ends("<path d=\"M[^ ]* ([^L\"]*)L[^ ]* ([^L\"]*)\"[^>]*data-name=\"s\"");
  ASSERT_TRUE(std::regex_search(svg, at, ends)) << svg;
  const double lo = std::stod(match[1]), hi = std::stod(match[2]), a = std::stod(match[3]), b = std::stod(match[4]);
  for (const auto& [pixel, value] : {std::pair{std::stod(at[1]), 1.0}, std::pair{std::stod(at[2]), 1000.0}})
    EXPECT_NEAR(pixel, a + (b - a) * std::log(value / lo) / std::log(hi / lo), 0.06) << value;
  for (const char* label : {">1<", ">10<", ">100<", ">1000<"}) EXPECT_NE(svg.find(label), std::string::npos) << label;
  EXPECT_EQ(svg.find(">-"), std::string::npos);
  // A value that is not above 0: linear.
  plot.series[0].y[2] = 0;
  EXPECT_EQ(plot(kCanvas).find(" log\""), std::string::npos);
}

TEST(LinePlot, ThinningKeepsPeaksAndEnds) {
  LinePlot plot;
  Series s{"s", {}, {}};
  constexpr int kMany = 200'000;
  for (int i = 0; i < kMany; ++i) {
    s.x.push_back(i);
    s.y.push_back(std::sin(i * 1e-4));
  }
  s.y[123'456] = 9;  // one point in 200 000
  s.y[54'321] = -7;
  plot.series = {s};
  const std::string svg = plot(kCanvas);
  EXPECT_LT(svg.size(), 120'000u) << "a line of 800 columns, and the values of its points";
  const std::vector<float> values = floats_in(svg, "data-f");
  ASSERT_GT(values.size(), 1000u);
  bool most = false, least_of_all = false;
  for (std::size_t i = 0; i + 1 < values.size(); i += 2) {
    most = most || (values[i] == 123'456.0F && values[i + 1] == 9.0F);
    least_of_all = least_of_all || (values[i] == 54'321.0F && values[i + 1] == -7.0F);
  }
  EXPECT_TRUE(most && least_of_all) << "what is read under the pointer are values of the series, not of the drawing";
  const auto points = read_off(svg, "s");
  ASSERT_FALSE(points.empty());
  double least = 0, greatest = 0, at = 0;
  for (const Point& p : points) {
    least = std::min(least, p.y);
    if (p.y > greatest) {
      greatest = p.y;
      at = p.x;
    }
  }
  constexpr double kPixel = 0.06;  // 16 over 300 px
  EXPECT_NEAR(greatest, 9, kPixel);
  EXPECT_NEAR(least, -7, kPixel);
  EXPECT_NEAR(at, 123'456, 300) << "a pixel column is 215 points";
  EXPECT_NEAR(points.front().x, 0, 30);
  EXPECT_NEAR(points.back().x, kMany - 1, 30);
}

TEST(LinePlot, GapsInterruptTheLine) {
  LinePlot plot;
  plot.series = {{"s", {0, 1, 2, 3, 4}, {1, 2, kNaN, 2, 1}}};
  const std::string svg = plot(kCanvas);
  const std::regex path("<path d=\"(M[^\"]*)\"[^>]*data-name=\"s\"");
  std::smatch match;
  ASSERT_TRUE(std::regex_search(svg, match, path));
  EXPECT_EQ(count_of(match[1], "M"), 2);
  EXPECT_EQ(read_off(svg, "s").size(), 4u);
}

TEST(LinePlot, ReadsNothingBadFromBadData) {
  for (const auto& y : std::vector<std::vector<double>>{{}, {1}, {kNaN, kNaN}, {kInf, 1}, {5, 5, 5}, {1e300, -1e300}}) {
    LinePlot plot;
    plot.series = {{"s", {0, 1, 2}, y}};
    plot.bands = {{"b", kNaN, 1}};
    plot.levels = {{"l", kInf}};
    const std::string svg = plot(kCanvas);
    EXPECT_THAT(svg, Not(HasSubstr("nan")));
    EXPECT_THAT(svg, Not(HasSubstr("inf")));
    EXPECT_THAT(svg, HasSubstr("</svg>"));
  }
}

TEST(LinePlot, BandsLevelsAndSpansAreNamed) {
  LinePlot plot;
  plot.x = {"s", "mm", {}, {}};
  plot.y = {"error", "um", {}, {}};
  plot.series = {{"after", {0, 100}, {1, 2}}};
  plot.bands = {{"tube", -100, 100}};
  plot.levels = {{"mean", 1.5}};
  plot.x_levels = {{"corner", 50}};
  plot.spans = {{"side 1", 0, 50}, {"side 2", 50, 100}};
  const std::string svg = plot(kCanvas);
  for (const char* text :
       {">after<", ">tube<", ">mean<", ">corner<", ">side 1<", ">side 2<", ">error, um<", ">s, mm<"}) {
    EXPECT_THAT(svg, HasSubstr(text));
  }
}

TEST(LinePlot, ManySpansArePickedButNeitherShadedNorNamed) {
  LinePlot plot;
  plot.series = {{"s", {0, 100}, {0, 1}}};
  for (int i = 0; i < 100; ++i) plot.spans.push_back({"line " + std::to_string(i + 1), double(i), double(i + 1)});
  const std::string svg = plot(kCanvas);
  EXPECT_THAT(svg, HasSubstr(";line 100:99:100\""));
  EXPECT_THAT(svg, Not(HasSubstr("class=\"shade\"")));
  EXPECT_THAT(svg, Not(HasSubstr(">line 1<")));
  EXPECT_THAT(plot(Canvas{300, "t", true}), Not(HasSubstr("data-spans")));
  plot.spans.resize(20);
  EXPECT_THAT(plot(kCanvas), HasSubstr("class=\"shade\""));
  plot.spans.assign(LinePlot::kMostSpans + 1, {"line 1", 0, 1});
  EXPECT_THAT(plot(kCanvas), Not(HasSubstr("data-spans")));
}

TEST(PathPlot, ScalesAreEqual) {
  PathPlot plot;
  plot.lines = {{"circle", {}, Colour::blue}};
  for (int i = 0; i <= 360; ++i) {
    plot.lines[0].points.push_back({100 + 50 * std::cos(i * 0.0174532925), 50 * std::sin(i * 0.0174532925)});
  }
  for (double width : {360.0, 960.0}) {
    const std::string svg = plot(Canvas{width, "t"});
    const std::regex curve(
        "<path d=\"(M[^\"]*)\" class=\"c-blue l\" style=\"stroke-width:1.5\" data-name=\"circle\"/>\n</g>");
    std::smatch match;
    ASSERT_TRUE(std::regex_search(svg, match, curve));
    const std::string d = match[1];
    const std::regex pair("[ML](-?[0-9.]+) (-?[0-9.]+)");
    double x0 = 1e9, x1 = -1e9, y0 = 1e9, y1 = -1e9;
    for (auto it = std::sregex_iterator(d.begin(), d.end(), pair); it != std::sregex_iterator(); ++it) {
      const double x = std::stod((*it)[1]), y = std::stod((*it)[2]);
      x0 = std::min(x0, x), x1 = std::max(x1, x), y0 = std::min(y0, y), y1 = std::max(y1, y);
    }
    EXPECT_NEAR(x1 - x0, y1 - y0, 0.5) << "a circle is a circle";
    EXPECT_GT(x1 - x0, 150);
    EXPECT_THAT(svg, HasSubstr("mm</text>")) << "the scale bar";
  }
}

TEST(PathPlot, LongPathsAreSimplifiedWithinAQuarterOfAPixel) {
  PathPlot plot;
  plot.lines = {{"", {}, Colour::blue}};
  for (int i = 0; i <= 100'000; ++i) plot.lines[0].points.push_back({i * 1e-3, std::sin(i * 1e-4)});
  EXPECT_LT(plot(kCanvas).size(), 20'000u);
}

TEST(PathPlot, AnEmptyPlotAndBadPointsDraw) {
  PathPlot plot;
  EXPECT_THAT(plot(kCanvas), HasSubstr("</svg>"));
  plot.lines = {{"", {{kNaN, 0}, {0, kInf}}}};
  plot.areas = {{"", {}}};
  EXPECT_THAT(plot(kCanvas), Not(HasSubstr("nan")));
}

TEST(ColourMap, LightnessGrowsEvenlyFromDarkToLight) {
  // Relative luminance of the WCAG, whose cube root is close to lightness as it is seen.
  const auto lightness = [](const std::string& hex) {
    double sum = 0;
    const double weight[] = {0.2126, 0.7152, 0.0722};
    for (std::size_t k = 0; k < 3; ++k) {
      const double v = std::stoi(hex.substr(1 + 2 * k, 2), nullptr, 16) / 255.0;
      sum += weight[k] * (v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
    }
    return std::cbrt(sum);
  };
  constexpr int kSteps = 20;
  double before = lightness(colour_at(ColourMap::sequential, 0));
  const double whole = lightness(colour_at(ColourMap::sequential, 1)) - before;
  EXPECT_GT(whole, 0.5);
  for (int i = 1; i <= kSteps; ++i) {
    const double now = lightness(colour_at(ColourMap::sequential, i / double(kSteps)));
    EXPECT_GT(now - before, 0.4 * whole / kSteps) << i;
    EXPECT_LT(now - before, 1.8 * whole / kSteps) << i;
    before = now;
  }
}

TEST(ColourMap, DivergingIsLightestInTheMiddleAndBoundsHold) {
  EXPECT_EQ(colour_at(ColourMap::diverging, -1), colour_at(ColourMap::diverging, 0));
  EXPECT_EQ(colour_at(ColourMap::diverging, 2), colour_at(ColourMap::diverging, 1));
  EXPECT_EQ(colour_at(ColourMap::sequential, kNaN), colour_at(ColourMap::sequential, 0));
  const std::string grey = colour_at(ColourMap::diverging, 0.5);
  EXPECT_EQ(grey.substr(1, 2), grey.substr(3, 2));
  EXPECT_EQ(grey.substr(3, 2), grey.substr(5, 2));
  const std::string cold = colour_at(ColourMap::diverging, 0), warm = colour_at(ColourMap::diverging, 1);
  EXPECT_GT(cold.substr(5, 2), cold.substr(1, 2)) << "blue";
  EXPECT_LT(warm.substr(5, 2), warm.substr(1, 2)) << "red";
}

TEST(LinePlot, DotsHoldTheirValues) {
  LinePlot plot;
  plot.series = {{"before", {1, 2, 3}, {0.123456789, kNaN, -7}, Colour::blue, LineStyle::points, 2}};
  const std::string svg = plot(kCanvas);
  EXPECT_THAT(svg, HasSubstr("data-dots=\"before\" data-v=\"1,0.123456789;-;3,-7\""));
  EXPECT_THAT(plot(Canvas{300, "t", true}), Not(HasSubstr("data-v"))) << "the wide drawing beside it holds them";
}

HeatMap ramp() {
  HeatMap map;
  map.columns = 11;
  map.rows = 6;
  map.x = {"x", "mm", 0, 100};
  map.y = {"y", "mm", 0, 50};
  map.label = "C";
  map.unit = "um/N";
  for (int j = 0; j < 6; ++j)
    for (int i = 0; i < 11; ++i) map.values.push_back(i);
  return map;
}

TEST(HeatMap, HoldsTheValuesThatAreReadUnderThePointer) {
  HeatMap map = ramp();
  map.values[13] = kNaN;
  map.min = 1;
  map.blank_below = true;
  map.clip = {{{0, 0}, {100, 0}, {100, 25}, {0, 25}}};
  map.kinds = {"legs", "joints"};
  map.kind.assign(map.values.size(), 1);
  const std::string svg = map(kCanvas);
  EXPECT_THAT(svg, HasSubstr(" data-plot=\"map\""));
  EXPECT_THAT(svg, HasSubstr(" data-grid=\"11 6 0 100 0 50\" data-value=\"C\""));
  EXPECT_THAT(svg, HasSubstr(" data-kinds=\";joints\""));
  const std::vector<float> values = floats_in(svg, "data-f");
  const std::vector<std::uint8_t> kinds = bytes_in(svg, "data-k");
  ASSERT_EQ(values.size(), map.values.size());
  ASSERT_EQ(kinds.size(), map.values.size());
  for (std::size_t n = 0; n < values.size(); ++n) {
    const double x = 10.0 * static_cast<double>(n % 11), y = 10.0 * static_cast<double>(n / 11);
    if (x == 0 || x == 100 || y == 0) continue;  // on the clip itself
    const bool drawn = n != 13 && x >= 10 && y < 25;
    EXPECT_EQ(std::isfinite(values[n]), drawn) << "at " << x << ", " << y;
    if (drawn) {
      EXPECT_FLOAT_EQ(values[n], static_cast<float>(map.values[n]));
    }
    EXPECT_EQ(kinds[n], drawn ? 1 : 255);
  }
  const std::string again = map(Canvas{300, "t", true});
  EXPECT_THAT(again, Not(HasSubstr("data-f"))) << "the wide drawing beside it holds them";
}

TEST(HeatMap, ContoursLieWhereTheValueIs) {
  const std::string svg = ramp()(kCanvas);
  // Values are x / 10 mm, contours at whole numbers: vertical lines at even tenths of the box.
  const std::regex box("<clipPath id=\"t-box\"><rect x=\"([0-9.]+)\" y=\"[0-9.]+\" width=\"([0-9.]+)\"");
  std::smatch match;
  ASSERT_TRUE(std::regex_search(svg, match, box));
  const double left = std::stod(match[1]), width = std::stod(match[2]);
  const std::regex contour("<path d=\"([^\"]*)\" class=\"contour\"/>");
  ASSERT_TRUE(std::regex_search(svg, match, contour));
  const std::string d = match[1];
  const std::regex segment("M([0-9.]+) [0-9.]+L([0-9.]+) [0-9.]+");
  std::set<int> tenths;
  for (auto it = std::sregex_iterator(d.begin(), d.end(), segment); it != std::sregex_iterator(); ++it) {
    EXPECT_EQ((*it)[1], (*it)[2]);
    const double tenth = (std::stod((*it)[1]) - left) / width * 10;
    EXPECT_NEAR(tenth, std::round(tenth), 0.01);
    tenths.insert(static_cast<int>(std::lround(tenth)));
  }
  EXPECT_GE(tenths.size(), 9u);
  EXPECT_THAT(svg, HasSubstr(">C, um/N<"));
}

/// A ramp whose values are no levels: its contours lie between the points of its grid.
struct Ramp {
  const char* name;
  double value_at_start, per_cell;
  bool along_y;
};
class Contours : public testing::TestWithParam<Ramp> {};

TEST_P(Contours, LieBetweenThePointsWhereEachLevelIsReached) {
  const Ramp& r = GetParam();
  HeatMap map = ramp();
  map.values.clear();
  for (int j = 0; j < map.rows; ++j)
    for (int i = 0; i < map.columns; ++i) map.values.push_back(r.value_at_start + r.per_cell * (r.along_y ? j : i));
  const std::string svg = map(kCanvas);
  std::smatch match;
  const std::regex box(
      "<clipPath id=\"t-box\"><rect x=\"([0-9.]+)\" y=\"([0-9.]+)\" width=\"([0-9.]+)\" height=\"([0-9.]+)\"");
  ASSERT_TRUE(std::regex_search(svg, match, box));
  // Along the ramp, from its first point: to the right, or upwards.
  const double start = r.along_y ? std::stod(match[2]) + std::stod(match[4]) : std::stod(match[1]);
  const double length = r.along_y ? -std::stod(match[4]) : std::stod(match[3]);
  const int cells = r.along_y ? map.rows - 1 : map.columns - 1;
  const auto value_at = [&](double px) { return r.value_at_start + r.per_cell * cells * (px - start) / length; };
  const double kPixel = 0.11 * std::abs(r.per_cell * cells / length);  // coordinates have one decimal

  ASSERT_TRUE(std::regex_search(svg, match, std::regex("<path d=\"([^\"]*)\" class=\"contour\"/>")));
  const std::string d = match[1];
  const std::regex point("[ML]([0-9.]+) ([0-9.]+)");
  std::set<int> levels;
  for (auto it = std::sregex_iterator(d.begin(), d.end(), point); it != std::sregex_iterator(); ++it) {
    const double value = value_at(std::stod((*it)[r.along_y ? 2 : 1]));
    EXPECT_NEAR(value, std::round(value), kPixel) << (*it)[0];
    levels.insert(static_cast<int>(std::lround(value)));
  }
  EXPECT_EQ(levels.size(), 10U);
  // The number at a contour is the value there; it stands 4 px below the middle of the contour.
  const std::regex label("<text x=\"([0-9.]+)\" y=\"([0-9.]+)\" class=\"on\"[^>]*>([0-9]+)<");
  int labels = 0;
  for (auto it = std::sregex_iterator(svg.begin(), svg.end(), label); it != std::sregex_iterator(); ++it, ++labels) {
    EXPECT_NEAR(value_at(r.along_y ? std::stod((*it)[2]) - 4 : std::stod((*it)[1])), std::stod((*it)[3]), kPixel);
  }
  EXPECT_GE(labels, 3);
}

INSTANTIATE_TEST_SUITE_P(HeatMap, Contours,
                         testing::Values(Ramp{"Rising", 0.3, 1, false}, Ramp{"Falling", 10.7, -1, false},
                                         Ramp{"Upwards", 0.2, 2, true}, Ramp{"Downwards", 10.9, -2, true}),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST(HeatMap, ValuesThatAreNotThereAreLeftBlank) {
  HeatMap map = ramp();
  const auto area = [](const std::string& svg) { return count_of(svg, "fill=\"#"); };
  const std::string whole = map(kCanvas);
  for (double& v : map.values) v = kNaN;
  const std::string blank = map(kCanvas);
  EXPECT_THAT(blank, Not(HasSubstr("nan")));
  EXPECT_LT(area(blank), area(whole)) << "only the colour bar is left";
  EXPECT_EQ(count_of(blank, "class=\"contour\""), 0);
  map.values.clear();
  EXPECT_THAT(map(kCanvas), HasSubstr("</svg>")) << "fewer values than the grid has";
  map.columns = map.rows = 0;
  EXPECT_THAT(map(kCanvas), HasSubstr("</svg>"));
}

TEST(HeatMap, ACellWithOneCornerMissingIsHalfACell) {
  HeatMap map = ramp();
  map.columns = map.rows = 2;
  map.values = {1, 1, 1, kNaN};
  const std::string svg = map(kCanvas);
  // One part of three corners, in the middle of the scale.
  const std::regex part("<path d=\"(M[^\"]*z)\" fill=");
  std::smatch found;
  ASSERT_TRUE(std::regex_search(svg, found, part)) << svg;
  EXPECT_EQ(corners_of(found[1]).size(), 3U) << found[1];
  map.values = {1, kNaN, 1, kNaN};
  const std::string half = map(kCanvas);
  EXPECT_FALSE(std::regex_search(half, part)) << "half the cell is not known";
}

TEST(HeatMap, WholeCellsOfABandAreJoinedAndCoverTheSame) {
  HeatMap map = ramp();
  map.columns = 6;
  map.rows = 5;
  map.values.assign(30, 5.5);
  map.min = 0;
  map.max = 10;
  const auto rectangles = [](const std::string& svg) {
    static const std::regex kRectangle("M([0-9.]+) ([0-9.]+)H([0-9.]+)V([0-9.]+)H[0-9.]+z");
    std::vector<double> areas;
    for (std::sregex_iterator it(svg.begin(), svg.end(), kRectangle); it != std::sregex_iterator(); ++it) {
      const auto at = [&](std::size_t k) { return std::stod((*it)[k]); };
      areas.push_back(std::abs((at(3) - at(1)) * (at(4) - at(2))));
    }
    return areas;
  };
  // The bands are painted one over the other: six of them are wholly below 5.5.
  const std::vector<double> whole = rectangles(map(kCanvas));
  ASSERT_EQ(whole.size(), 6U);
  map.values[2 * 6 + 3] = kNaN;  // leaves four of the twenty cells, as triangles
  const std::vector<double> rest = rectangles(map(kCanvas));
  double sum = 0;
  for (const double area : rest) sum += area;
  EXPECT_NEAR(sum / 6, whole[0] * 16 / 20, 0.01 * whole[0]) << "sixteen of twenty cells";
}

TEST(HeatMap, DotsHaveTheColourOfTheirBand) {
  HeatMap map = ramp();
  map.dots = {{{50, 25}, 5.4}, {{20, 10}, kNaN}, {{0, 0}, 99}};
  const std::string svg = map(kCanvas);
  // Bands of one unit from 0 to 10: 5.4 lies in that of 5 to 6, what is above all in the last.
  EXPECT_EQ(count_of(svg, "fill=\"" + colour_at(ColourMap::sequential, 0.55) + "\" stroke=\"#fff\""), 1) << svg;
  EXPECT_EQ(count_of(svg, "fill=\"" + colour_at(ColourMap::sequential, 0.95) + "\" stroke=\"#fff\""), 1);
  EXPECT_EQ(count_of(svg, "r=\"2\" fill=\"#fff\""), 1) << "no value: a small dot";
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
}

TEST(HeatMap, IsDrawnOnlyInsideItsClip) {
  HeatMap map;
  map.columns = map.rows = 11;
  for (int j = 0; j < 11; ++j)
    for (int i = 0; i < 11; ++i) map.values.push_back(i);
  map.clip = {{{0, 0}, {3.5, 0}, {3.5, 10}, {0, 10}}};
  const std::string svg = map(kCanvas);
  EXPECT_EQ(count_of(svg, "clip-rule=\"evenodd\""), 1);
  EXPECT_EQ(count_of(svg, "url(#t-area)"), 1);
  // Of the contour lines only those inside are numbered: x = 1, 2, 3 of 1 .. 9.
  EXPECT_EQ(count_of(svg, "class=\"on\""), 3);
  map.clip.clear();
  EXPECT_GT(count_of(map(kCanvas), "class=\"on\""), 5);
}

TEST(HeatMap, DivergingMapsAreSymmetric) {
  HeatMap map = ramp();
  map.map = ColourMap::diverging;  // 0 to 10 gives a range of -10 to 10
  EXPECT_THAT(map(kCanvas), HasSubstr("\xE2\x88\x92"
                                      "10<"));
}

TEST(HeatMap, AConstantFieldDraws) {
  HeatMap map = ramp();
  for (double& v : map.values) v = 3;
  const std::string svg = map(kCanvas);
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
}

TEST(Histogram, SharesAddUpToAHundredPerCent) {
  Histogram histogram;
  histogram.x = {"e", "um", 0, 4};
  histogram.bins = 4;
  histogram.samples = {{"s", {0.5, 1.5, 1.6, 1.7, 4.0, kNaN}}};  // shares 20, 60, 0, 20 per cent
  const std::string svg = histogram(kCanvas);
  const std::regex outline("<path d=\"(M[^\"]*)\" class=\"l\" data-name");
  std::smatch match;
  ASSERT_TRUE(std::regex_search(svg, match, outline));
  std::vector<double> heights;
  const std::string d = match[1];
  const std::regex step("V([0-9.]+)H");
  double bottom = 0;
  const std::regex start("M[0-9.]+ ([0-9.]+)V");
  std::smatch base;
  ASSERT_TRUE(std::regex_search(d, base, start));
  bottom = std::stod(base[1]);
  for (auto it = std::sregex_iterator(d.begin(), d.end(), step); it != std::sregex_iterator(); ++it) {
    heights.push_back(bottom - std::stod((*it)[1]));
  }
  ASSERT_EQ(heights.size(), 3u);
  EXPECT_NEAR(heights[1] / heights[0], 3, 0.02);
  EXPECT_NEAR(heights[2] / heights[0], 1, 0.02) << "the largest value belongs to the last bin";
  EXPECT_THAT(svg, HasSubstr("0.5,20;1.5,60;2.5,0;3.5,20")) << "middle and share of each bin";
}

TEST(Histogram, WithoutValuesDraws) {
  Histogram histogram;
  EXPECT_THAT(histogram(kCanvas), HasSubstr("</svg>"));
  histogram.samples = {{"s", {kNaN}}, {"t", {2, 2}}};
  EXPECT_THAT(histogram(kCanvas), Not(HasSubstr("nan")));
}

TEST(BarChart, PartsAreAsLongAsTheirValues) {
  const BarChart bars{"", "um", {"a", "b"}, {{"row", {10, 30}}, {"half", {20, 0}}, {"bad", {kNaN, -1}}}};
  const std::string svg = bars(kCanvas);
  const std::regex rect("<rect x=\"[0-9.]+\" y=\"[0-9.]+\" width=\"([0-9.]+)\" height=\"20\"");
  std::vector<double> widths;
  for (auto it = std::sregex_iterator(svg.begin(), svg.end(), rect); it != std::sregex_iterator(); ++it) {
    widths.push_back(std::stod((*it)[1]));
  }
  ASSERT_EQ(widths.size(), 3u);
  EXPECT_NEAR(widths[1] / widths[0], 3, 0.01);
  EXPECT_NEAR(widths[2] / widths[0], 2, 0.01);
  EXPECT_THAT(svg, HasSubstr(">40.0 um<"));
  EXPECT_THAT(svg, HasSubstr("data-tip=\"row, b: 30.000 um\""));
}

TEST(BarChart, LongLabelsStandAboveTheirBars) {
  const std::string label = "platform.joint[1], platform.attachment[1] (together)";
  const std::string svg = BarChart{"", "mm", {""}, {{label, {1}}, {"short", {2}}}}(Canvas{340, "t"});
  // Every text that ends at its place begins within the picture, a character being 5 px wide at least.
  const std::regex text("<text x=\"([-0-9.]+)\"[^>]*class=\"([^\"]*)\"[^>]*>([^<]*)<");
  int labels = 0;
  for (auto it = std::sregex_iterator(svg.begin(), svg.end(), text); it != std::sregex_iterator(); ++it) {
    const bool ends_there = (" " + (*it)[2].str() + " ").find(" e ") != std::string::npos;
    const double from = std::stod((*it)[1]) - (ends_there ? 5.0 * static_cast<double>((*it)[3].length()) : 0);
    EXPECT_GE(from, 0) << (*it)[3];
    labels += (*it)[3] == label ? 1 : 0;
  }
  EXPECT_EQ(labels, 1);
}

TEST(PanelGrid, SetsPanelsBesideEachOther) {
  const Figure square = [](const Canvas& canvas) {
    return "<svg class=\"pp\" viewBox=\"0 0 " + std::to_string(int(canvas.width)) + " 50\"><g id=\"" + canvas.id +
           "\"/></svg>";
  };
  const std::string svg = PanelGrid{"three", 2, {{"one", square}, {"two", square}, {"three", square}}}(kCanvas);
  EXPECT_EQ(count_of(svg, "<svg"), 1);
  EXPECT_THAT(svg, HasSubstr("translate(0 20)\"><g id=\"t-1\"/>"));
  EXPECT_THAT(svg, HasSubstr("translate(0 108)\"><g id=\"t-3\"/>"));  // 20 title + 50 + 18 gap + 20 title
}

TEST(StandaloneSvg, IsAFileOfItsOwn) {
  LinePlot plot;
  plot.series = {{"s", {0, 1}, {0, 1}}};
  const std::string svg = standalone_svg(plot);
  EXPECT_TRUE(svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"pp\""));
  EXPECT_THAT(svg, HasSubstr("<style>"));
}

}  // namespace
}  // namespace polypod::report
