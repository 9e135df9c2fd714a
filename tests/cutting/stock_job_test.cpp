// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "paths.hpp"
#include "polypod/core/files.hpp"
#include "samples.hpp"

namespace polypod::cutting {
namespace {

using samples::end_mill;
using samples::kPi;

config::Table table_of(const std::string& text) {
  auto table = config::parse(text, "job.toml");
  EXPECT_TRUE(table) << to_string(table.error());
  return *table;
}

Error error_of(const std::string& text) {
  auto stock = stock_from(table_of(text), end_mill());
  EXPECT_FALSE(stock);
  return stock ? Error{} : stock.error();
}

double volume_mm3(const std::string& text) {
  auto stock = stock_from(table_of(text), end_mill());
  EXPECT_TRUE(stock) << to_string(stock.error());
  return stock ? units::to_mm3(stock->volume()) : 0;
}

TEST(CutterFile, ReadsItsTable) {
  auto cutter = cutter_from(table_of("name='a'\ndiameter_mm=8\nteeth=4\nhelix_deg=30\nlength_mm=20\n"));
  ASSERT_TRUE(cutter) << to_string(cutter.error());
  EXPECT_EQ(cutter->name, "a");
  EXPECT_EQ(cutter->diameter, 8e-3);
  EXPECT_EQ(cutter->teeth, 4);
  EXPECT_NEAR(cutter->helix, kPi / 6, 1e-15);
  EXPECT_EQ(cutter->length, 20e-3);
  EXPECT_NEAR(cutter->pitch_angle(), kPi / 2, 1e-15);
}

TEST(CutterFile, Errors) {
  const auto bad = [](const std::string& text) {
    auto cutter = cutter_from(table_of(text));
    EXPECT_FALSE(cutter) << text;
    if (!cutter) {
      EXPECT_EQ(cutter.error().place.file, "job.toml");
    }
    return !cutter;
  };
  EXPECT_TRUE(bad("diameter_mm=0\nteeth=4\nhelix_deg=30\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=2147483648\nteeth=4\nhelix_deg=30\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=1000.5\nteeth=4\nhelix_deg=30\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=0.009\nteeth=4\nhelix_deg=30\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=8\nteeth=4\nhelix_deg=30\nlength_mm=1e6\n"));
  EXPECT_TRUE(bad("diameter_mm=8\nteeth=0\nhelix_deg=30\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=8\nteeth=2.5\nhelix_deg=30\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=8\nteeth=4\nhelix_deg=90\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=8\nteeth=4\nhelix_deg=-1\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=8\nteeth=4\nhelix_deg=30\n"));
  EXPECT_TRUE(bad("diameter_mm=nan\nteeth=4\nhelix_deg=30\nlength_mm=20\n"));
  EXPECT_TRUE(bad("diameter_mm=8\nteeth=4\nhelix_deg=30\nlength_mm=20\nflutes=4\n"));
}

const char* const kAluminium =
    "Ktc_N_per_mm2=1027.78\nKrc_N_per_mm2=182.03\nKac_N_per_mm2=64.5\n"
    "Kte_N_per_mm=13.65\nKre_N_per_mm=27.95\nKae_N_per_mm=2.21\n";

TEST(MaterialFile, ReadsItsTable) {
  auto m = material_from(table_of(kAluminium));
  ASSERT_TRUE(m) << to_string(m.error());
  const Material expected = samples::aluminium();
  EXPECT_NEAR(m->ktc, expected.ktc, 1e-3);
  EXPECT_NEAR(m->krc, expected.krc, 1e-3);
  EXPECT_NEAR(m->kac, expected.kac, 1e-3);
  EXPECT_NEAR(m->kte, expected.kte, 1e-9);
  EXPECT_NEAR(m->kre, expected.kre, 1e-9);
  EXPECT_NEAR(m->kae, expected.kae, 1e-9);
  EXPECT_EQ(m->exponent, 1);
}

TEST(MaterialFile, AnotherExponentKeepsItsMillimetres) {
  auto m = material_from(table_of(std::string(kAluminium) + "exponent=0.5\n"));
  ASSERT_TRUE(m);
  // K_tc h^0.5 dz with h = 0.04 mm and dz = 1 mm: 1027.78 * 0.2 N.
  EXPECT_NEAR(m->ktc * std::sqrt(4e-5) * 1e-3, 1027.78 * 0.2, 1e-9);
}

TEST(MaterialFile, EveryCoefficientIsNeeded) {
  for (const char* key :
       {"Ktc_N_per_mm2", "Krc_N_per_mm2", "Kac_N_per_mm2", "Kte_N_per_mm", "Kre_N_per_mm", "Kae_N_per_mm"}) {
    std::string text = kAluminium;
    const std::size_t begin = text.find(key);
    text.erase(begin, text.find('\n', begin) - begin);
    auto m = material_from(table_of(text));
    ASSERT_FALSE(m) << key;
    EXPECT_NE(m.error().message.find(key), std::string::npos) << to_string(m.error());
    EXPECT_EQ(m.error().place.file, "job.toml");
  }
  EXPECT_FALSE(material_from(table_of(std::string(kAluminium) + "exponent=1.5\n")));
  EXPECT_FALSE(material_from(table_of(std::string(kAluminium) + "exponent=0\n")));
  EXPECT_FALSE(material_from(table_of(std::string(kAluminium) + "Kt=1\n")));
}

TEST(Examples, CutterAndMaterialAreThoseOfTheSource) {
  const std::string folder = test::source("examples/slavkovic_common/");
  auto cutter = read_cutter(folder + "cutter_8mm_4_flute.toml");
  auto material = read_material(folder + "material_aluminium.toml");
  ASSERT_TRUE(cutter) << to_string(cutter.error());
  ASSERT_TRUE(material) << to_string(material.error());
  const Vec3 f = mean_force(*cutter, *material, straight_engagement(*cutter, CutSide::down, 4e-3, 2e-3), 5e-5);
  EXPECT_NEAR(f.y(), 110, 0.5);
  EXPECT_FALSE(read_cutter(folder + "no_such_file.toml"));
}

TEST(BlockStock, FillsTheBlockWithFineCells) {
  auto s = stock_from(table_of("kind='block'\nmin_mm=[-10,-7,-5]\nmax_mm=[27.3,41.9,0]\n"), end_mill());
  ASSERT_TRUE(s) << to_string(s.error());
  EXPECT_LE(s->cell(), 0.02 * 8e-3 + 1e-15);
  EXPECT_GE(s->cell(), 0.02 * 8e-3 / 1.11);
  constexpr double kMisfit = 1e-3;  // cells
  EXPECT_NEAR(s->x_min(), -10e-3, kMisfit * s->cell());
  EXPECT_NEAR(s->y_min(), -7e-3, 20 * kMisfit * s->cell());
  EXPECT_NEAR(units::to_mm3(s->volume()), 37.3 * 48.9 * 5, 2);
}

TEST(BlockStock, CellsOfTheJob) {
  auto s = stock_from(table_of("kind='block'\nmin_mm=[0,0,-5]\nmax_mm=[10,10,0]\ncell_mm=0.2\n"), end_mill());
  ASSERT_TRUE(s) << to_string(s.error());
  EXPECT_NEAR(s->cell(), 0.2e-3, 1e-15);
  const Error e = error_of("kind='block'\nmin_mm=[0,0,-5]\nmax_mm=[10,10,0]\ncell_mm=0.21\n");
  EXPECT_EQ(e.id, "CT112");
  EXPECT_EQ(e.place.line, 4);
}

TEST(BlockStock, Errors) {
  EXPECT_EQ(error_of("kind='cube'\n").id, "CT117");
  const Error e = error_of("kind='block'\nmin_mm=[0,0,-5]\nmax_mm=[10,10,-5]\n");
  EXPECT_EQ(e.id, "CT110");
  EXPECT_EQ(e.place.line, 3);
  EXPECT_EQ(error_of("kind='block'\nmin_mm=[0,0,-5]\nmax_mm=[10,10,0]\nspare=1\n").id, "CF103");
  const Error many = error_of("kind='block'\nmin_mm=[0,0,-5]\nmax_mm=[9000,9000,0]\n");
  EXPECT_EQ(many.id, "CT111");
  EXPECT_EQ(many.place.file, "job.toml");
}

std::string allowance(const std::string& contour, const std::string& rest) {
  return "kind='allowance'\ncontour_mm=" + contour + "\nz_top_mm=0\nz_bottom_mm=-2\n" + rest;
}
const char* const kSquare = "[[0,0],[30,0],[30,30],[0,30]]";
const char* const kSquareBackwards = "[[0,0],[0,30],[30,30],[30,0],[0,0]]";
constexpr double kVolumeShare = 1e-3;  // of a band blended over one cell

TEST(AllowanceStock, OutsideASquare) {
  for (const char* contour : {kSquare, kSquareBackwards}) {
    EXPECT_NEAR(volume_mm3(allowance(contour, "side='outside'\nallowance_mm=4\n")), 38 * 38 * 2,
                kVolumeShare * 38 * 38 * 2);
    const double round = (30 * 30 + 4 * 30 * 4 + kPi * 16) * 2;
    EXPECT_NEAR(volume_mm3(allowance(contour, "side='outside'\nallowance_mm=4\ncorners='round'\n")), round,
                kVolumeShare * round);
  }
}

TEST(AllowanceStock, EdgesOfASquareAreEdgesOfCells) {
  auto s = stock_from(table_of(allowance(kSquare, "side='outside'\nallowance_mm=4\n")), end_mill());
  ASSERT_TRUE(s);
  EXPECT_NEAR(s->x_min(), -4e-3, 1e-3 * s->cell());
  EXPECT_EQ(s->height(0, 0), 0.0f);  // full up to the border
  EXPECT_EQ(s->height(0, s->rows() / 2), 0.0f);
}

TEST(AllowanceStock, TurnedSquare) {
  const double c = std::cos(75 * kPi / 180), q = std::sin(75 * kPi / 180);
  std::string contour = "[";
  for (const auto& [x, y] : {std::pair{-20., -20.}, {20., -20.}, {20., 20.}, {-20., 20.}}) {
    contour += "[" + std::to_string(c * x - q * y) + "," + std::to_string(q * x + c * y) + "],";
  }
  contour += "]";
  const double square = 48 * 48 * 2, round = (1600 + 4 * 40 * 4 + kPi * 16) * 2;
  EXPECT_NEAR(volume_mm3(allowance(contour, "side='outside'\nallowance_mm=4\n")), square, kVolumeShare * square);
  EXPECT_NEAR(volume_mm3(allowance(contour, "side='outside'\nallowance_mm=4\ncorners='round'\n")), round,
              kVolumeShare * round);
}

TEST(AllowanceStock, InsideAPocket) {
  // The allowance of 4 mm within a pocket of 30 mm, and 8 mm (a diameter) behind its walls.
  for (const char* contour : {kSquare, kSquareBackwards}) {
    const double v = (46 * 46 - 22 * 22) * 2;
    EXPECT_NEAR(volume_mm3(allowance(contour, "side='inside'\nallowance_mm=4\n")), v, kVolumeShare * v);
  }
}

TEST(AllowanceStock, AConcaveCornerHasNoSpike) {
  // An L: the allowance fills the inner corner once.
  const double v = ((40 + 6) * (40 + 6) - 20 * 20) * 2;
  EXPECT_NEAR(
      volume_mm3(allowance("[[0,0],[40,0],[40,20],[20,20],[20,40],[0,40]]", "side='outside'\nallowance_mm=3\n")), v,
      kVolumeShare * v);
}

TEST(AllowanceStock, ASharpCornerIsCutOff) {
  // A thin wedge: the mitre would be 24 allowances long, it ends at four.
  auto s =
      stock_from(table_of(allowance("[[0,0],[60,-2.5],[60,2.5]]", "side='outside'\nallowance_mm=2\n")), end_mill());
  ASSERT_TRUE(s) << to_string(s.error());
  EXPECT_GE(s->x_min(), -8.2e-3);
  EXPECT_LE(s->x_min(), -7.8e-3);
}

using Point = Eigen::Vector2d;

double distance_to(const std::vector<Point>& contour, const Point& p) {
  double least = 1e9;
  for (std::size_t i = 0; i < contour.size(); ++i) {
    const Point a = contour[i], way = contour[(i + 1) % contour.size()] - a;
    const double t = std::clamp((p - a).dot(way) / way.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (p - a - t * way).norm());
  }
  return least;
}

bool holds(const std::vector<Point>& contour, const Point& p) {  // by the turns round p
  double angle = 0;
  for (std::size_t i = 0; i < contour.size(); ++i) {
    const Point a = contour[i] - p, b = contour[(i + 1) % contour.size()] - p;
    angle += std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
  }
  return std::abs(angle) > kPi;
}

TEST(AllowanceStock, RoundCornersAreADistance) {
  // Stars of any shape, cell by cell against the distance from the contour.
  EXPECT_TRUE(rc::check("stars", [] {
    const int n = *samples::whole(3, 10);
    const bool outside = *rc::gen::arbitrary<bool>();
    const double turn = samples::between(0, 2 * kPi);
    std::vector<Point> contour;
    std::string text = "[";
    for (int i = 0; i < n; ++i) {
      const double radius = samples::between(4, 20), angle = turn + 2 * kPi * i / n;
      contour.emplace_back(radius * std::cos(angle), radius * std::sin(angle));
      text += "[" + std::to_string(contour.back().x()) + "," + std::to_string(contour.back().y()) + "],";
    }
    const double allowance_mm = 2;
    const auto made =
        stock_from(table_of(allowance(text + "]", std::string("side='") + (outside ? "outside" : "inside") +
                                                      "'\nallowance_mm=2\ncorners='round'\n")),
                   end_mill());
    RC_ASSERT(made.has_value());
    const double cell_mm = units::to_mm(made->cell());
    for (int j = 0; j < made->rows(); j += 3) {
      for (int i = 0; i < made->columns(); i += 3) {
        const Point p(units::to_mm(made->x_min()) + (i + 0.5) * cell_mm,
                      units::to_mm(made->y_min()) + (j + 0.5) * cell_mm);
        const double d = distance_to(contour, p);
        const bool inside = holds(contour, p);
        double expected = 0;
        if (inside == outside) {
          expected = outside || d < 8 - 1e-3 ? 1 : -1;  // the part; for a pocket a diameter of it, then mitres
        } else {
          expected = std::clamp(0.5 + (allowance_mm - d) / cell_mm, 0.0, 1.0);
        }
        if (expected < 0) continue;
        const float* layers = made->cell_layers(i, j);
        const auto kept = std::count(layers, layers + Stock::kLayers, 0.0f);
        constexpr double kRounding = 0.51;  // layers
        RC_ASSERT(std::abs(static_cast<double>(kept) - expected * Stock::kLayers) <= kRounding);
      }
    }
  }));
}

TEST(AllowanceStock, OpenContour) {
  // 50 mm long, 3 mm to the left, a diameter of 8 mm behind it on the right.
  const double v = 50 * 11 * 2;
  EXPECT_NEAR(volume_mm3(allowance("[[0,0],[50,0]]", "closed=false\nside='left'\nallowance_mm=3\n")), v,
              kVolumeShare * v);
  auto left =
      stock_from(table_of(allowance("[[0,0],[50,0]]", "closed=false\nside='left'\nallowance_mm=3\n")), end_mill());
  auto right =
      stock_from(table_of(allowance("[[0,0],[50,0]]", "closed=false\nside='right'\nallowance_mm=3\n")), end_mill());
  ASSERT_TRUE(left && right);
  EXPECT_NEAR(left->y_min(), -8e-3, 1e-4);
  EXPECT_NEAR(right->y_min(), -3e-3, 1e-4);
}

TEST(AllowanceStock, Errors) {
  EXPECT_EQ(error_of(allowance("[[0,0],[1,0],[0,0]]", "side='outside'\nallowance_mm=4\n")).id, "CT113");
  std::string many;
  for (int i = 0; i <= 5000; ++i) many += "[" + std::to_string(i) + ",0],";
  EXPECT_EQ(error_of(allowance("[" + many + "[0,9]]", "side='outside'\nallowance_mm=4\n")).id, "CT118");
  EXPECT_EQ(error_of(allowance("[[0,0],[9,0],[0,9]]", "side='outside'\nallowance_mm=1001\n")).id, "CF105");
  EXPECT_EQ(error_of(allowance("[[0,0],[9,9],[9,0],[0,9]]", "side='outside'\nallowance_mm=4\n")).id, "CT114");
  EXPECT_EQ(error_of(allowance(kSquare, "side='left'\nallowance_mm=4\n")).id, "CT115");
  EXPECT_EQ(error_of(allowance(kSquare, "side='outside'\nallowance_mm=4\ncorners='sharp'\n")).id, "CT116");
  EXPECT_EQ(error_of("kind='allowance'\ncontour_mm=[[0,0],[9,0],[9,9]]\nz_top_mm=-3\nz_bottom_mm=-2\nside='inside'\n"
                     "allowance_mm=4\n")
                .id,
            "CT110");
  EXPECT_EQ(error_of(allowance(kSquare, "side='outside'\nallowance_mm=4\ncell_mm=0.5\n")).id, "CT112");
  const Error flat = error_of(allowance("[[0,0],[9,0],[5,0]]", "side='outside'\nallowance_mm=4\n"));
  EXPECT_EQ(flat.id, "CT114");
  EXPECT_EQ(flat.place.line, 2);
}

class StockFile : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("polypod_stock_" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) + "_" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::string path(const char* name) const { return (folder_ / name).string(); }
  static Stock small() {
    Stock s = *Stock::block({-2e-3, -1e-3, -2e-3}, {2e-3, 1e-3, 0}, 0.2e-3);
    s.cut_line({-1e-3, 0, -1e-3}, {1e-3, 0, -3e-3}, 0.6e-3);
    return s;
  }
  std::filesystem::path folder_;
};

TEST_F(StockFile, ComesBackAsItWas) {
  const Stock s = small();
  ASSERT_TRUE(write_stock(s, path("a.stock")));
  auto back = read_stock(path("a.stock"));
  ASSERT_TRUE(back) << to_string(back.error());
  EXPECT_EQ(back->layers(), s.layers());
  EXPECT_EQ(back->x_min(), s.x_min());
  EXPECT_EQ(back->y_min(), s.y_min());
  EXPECT_EQ(back->cell(), s.cell());
  EXPECT_EQ(back->bottom(), s.bottom());
  EXPECT_EQ(back->top(), s.top());
  EXPECT_EQ(back->columns(), s.columns());
  EXPECT_EQ(back->rows(), s.rows());
}

TEST_F(StockFile, OfATurnedPartComesBackAsItWas) {
  Stock s = small().turned(Stock::Axis::x);
  s.cut_line({-1e-3, 0.5e-3, 1e-3}, {1e-3, 0, 1e-3}, 0.4e-3);
  ASSERT_TRUE(write_stock(s, path("a.stock")));
  auto back = read_stock(path("a.stock"));
  ASSERT_TRUE(back) << to_string(back.error());
  EXPECT_EQ(back->layers(), s.layers());
  ASSERT_NE(back->hollow(), nullptr);
  EXPECT_EQ(back->hollow()->layers(), s.hollow()->layers());
  EXPECT_EQ(back->volume(), s.volume());
  std::string bytes = *files::read(path("a.stock"));
  bytes.resize(bytes.size() - 4);
  ASSERT_TRUE(files::write_whole(path("b.stock"), bytes));
  EXPECT_EQ(read_stock(path("b.stock")).error().id, "CT121");
}

TEST_F(StockFile, IsTurnedAndShiftedByTheJob) {
  ASSERT_TRUE(write_stock(small(), path("a.stock")));
  const auto stock_of = [&](const std::string& keys) {
    std::ofstream(path("job.toml")) << "kind = 'file'\nfile = 'a.stock'\n" + keys;
    return stock_from(*config::read_file(path("job.toml")), end_mill());
  };
  // small() is from x -2, y -1, z -2 to x 2, y 1, z 0 mm.
  const auto about_x = stock_of("turned = 'x'\nshift_mm = [10, 1, -2]\n");
  ASSERT_TRUE(about_x) << to_string(about_x.error());
  EXPECT_NEAR(about_x->x_min(), 8e-3, 1e-12);
  EXPECT_NEAR(about_x->y_min(), 0, 1e-12);
  EXPECT_NEAR(about_x->bottom(), -2e-3, 1e-9);
  EXPECT_NEAR(about_x->top(), 0, 1e-9);
  EXPECT_NEAR(about_x->volume(), small().volume(), 1e-6 * small().volume());
  const auto shifted = stock_of("shift_mm = [0, 0, 5]\n");
  ASSERT_TRUE(shifted);
  EXPECT_EQ(shifted->hollow(), nullptr);
  EXPECT_NEAR(shifted->top(), 5e-3, 1e-9);
  for (const char* wrong : {"turned = 'z'\n", "turned = ''\n"}) {
    const auto refused = stock_of(wrong);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().id, "CT124");
    EXPECT_EQ(refused.error().place.line, 3);
  }
  EXPECT_FALSE(stock_of("shift_mm = [0, 0]\n"));
  const auto misspelt = stock_of("shfit_mm = [0, 0, 1]\n");
  ASSERT_FALSE(misspelt);
  EXPECT_EQ(misspelt.error().hint.substr(0, 12), "did you mean");
  EXPECT_NE(misspelt.error().hint.find("shift_mm"), std::string::npos) << misspelt.error().hint;
}

TEST_F(StockFile, IsFoundBesideTheJob) {
  ASSERT_TRUE(write_stock(small(), path("a.stock")));
  std::ofstream(path("job.toml")) << "kind = 'file'\nfile = 'a.stock'\n";
  auto table = config::read_file(path("job.toml"));
  ASSERT_TRUE(table);
  EXPECT_TRUE(stock_from(*table, end_mill()));
  Cutter thin = end_mill();
  thin.diameter = 4e-3;
  auto table2 = config::read_file(path("job.toml"));
  auto refused = stock_from(*table2, thin);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().id, "CT112");
}

TEST_F(StockFile, EveryDamageIsFound) {
  ASSERT_TRUE(write_stock(small(), path("a.stock")));
  const std::string bytes = *files::read(path("a.stock"));
  const auto error_for = [&](std::string_view content) {
    EXPECT_TRUE(files::write_whole(path("b.stock"), content));
    auto stock = read_stock(path("b.stock"));
    EXPECT_FALSE(stock);
    if (!stock) {
      EXPECT_EQ(stock.error().place.file, path("b.stock"));
    }
    return stock ? std::string() : stock.error().id;
  };
  EXPECT_EQ(error_for(""), "CT120");
  EXPECT_EQ(error_for("G1 X10\n"), "CT120");
  EXPECT_EQ(error_for(bytes.substr(0, 30)), "CT121");
  EXPECT_EQ(error_for(bytes.substr(0, bytes.size() - 1)), "CT121");
  EXPECT_EQ(error_for(bytes + "x"), "CT121");
  std::string version = bytes;
  version[8] = 9;
  EXPECT_EQ(error_for(version), "CT122");
  for (std::size_t i = 25; i < bytes.size(); i += 997) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    EXPECT_EQ(error_for(damaged), "CT123") << "byte " << i;
  }
  EXPECT_EQ(read_stock(path("none.stock")).error().id, "FI100");
  EXPECT_EQ(write_stock(small(), folder_.string()).error().id, "FI101");
}

}  // namespace
}  // namespace polypod::cutting
