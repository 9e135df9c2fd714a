// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The stock that a job file describes: a block, an allowance along a contour, or the result of an earlier program.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "polypod/core/units.hpp"
#include "polypod/cutting/stock.hpp"

namespace polypod::cutting {
namespace {

using Point = Eigen::Vector2d;

constexpr double kMitreLimit = 4;           // longest mitre in allowances, as for lines in drawings
constexpr std::size_t kMostCorners = 5000;  // each is compared with each: a quarter of a second
constexpr config::Range kAllowanceRange_mm{0, 1000};
constexpr double kFitSlack = 0.1;    // cells may be this much smaller so that whole numbers of them fill the stock
constexpr double kFitEnough = 1e-3;  // of a cell: a better fit is not worth smaller cells

// The largest cell up to `cell` (and not much below it) of which whole numbers fill `width` and `height`, as nearly as
// there is one: then the borders of the stock lie on borders of cells.
double fitted_cell(double width, double height, double cell) {
  const double first = std::ceil(width / cell - 1e-9), last = first * (1 + kFitSlack) + 1;
  constexpr double kMostTrials = 1e5;
  double best = cell, best_misfit = std::numeric_limits<double>::infinity();
  for (double n = first; n <= last && n < first + kMostTrials; n += 1) {
    const double trial = width / n, rows = height / trial, misfit = std::abs(rows - std::round(rows));
    if (std::round(rows) < 1) continue;
    if (misfit < best_misfit - kFitEnough) {
      best = trial;
      best_misfit = misfit;
    }
    if (best_misfit <= kFitEnough) break;
  }
  return best;
}

Result<double> cell_from(const config::Table& table, const Cutter& cutter, double width, double height) {
  const double largest = kLargestCell * cutter.diameter;
  if (!table.has("cell_mm")) return fitted_cell(width, height, kUsualCell * cutter.diameter);
  POLYPOD_ASSIGN(cell_mm, table.number("cell_mm", config::kPositive));
  const double cell = units::from_mm(cell_mm);
  if (cell > largest * (1 + 1e-9)) {
    return fail("CT112",
                fmt::format("{}.cell_mm = {:g} is coarser than the cutter allows: {:g} mm, {:g} of its diameter",
                            table.name(), cell_mm, units::to_mm(largest), kLargestCell),
                table.place_of("cell_mm"), "leave cell_mm out to get 0.02 of the diameter");
  }
  return cell;
}

// Gives the error of a stock that has no place the place of the table.
Result<Stock> placed(Result<Stock> stock, const config::Table& table) {
  if (!stock && stock.error().place.file.empty()) stock.error().place = table.place();
  return stock;
}

Result<Stock> block_from(const config::Table& table, const Cutter& cutter) {
  POLYPOD_ASSIGN(min_mm, table.numbers("min_mm", 3));
  POLYPOD_ASSIGN(max_mm, table.numbers("max_mm", 3));
  Vec3 min, max;
  for (int i = 0; i < 3; ++i) {
    min[i] = units::from_mm(min_mm[i]);
    max[i] = units::from_mm(max_mm[i]);
    if (!(min[i] < max[i])) {
      return fail("CT110",
                  fmt::format("{}.max_mm[{}] = {:g} is not above {}.min_mm[{}] = {:g}: the block is empty",
                              table.name(), i, max_mm[i], table.name(), i, min_mm[i]),
                  table.place_of("max_mm"), "give two opposite corners of the block, the lower one as min_mm");
    }
  }
  POLYPOD_ASSIGN(cell, cell_from(table, cutter, max.x() - min.x(), max.y() - min.y()));
  POLYPOD_TRY(table.finish());
  return placed(Stock::block(min, max, cell), table);
}

double cross(const Point& a, const Point& b) {
  return a.x() * b.y() - a.y() * b.x();
}

// Whether the segments a-b and c-d share a point (touching counts).
bool segments_meet(const Point& a, const Point& b, const Point& c, const Point& d) {
  if (std::max(a.x(), b.x()) < std::min(c.x(), d.x()) || std::max(c.x(), d.x()) < std::min(a.x(), b.x()) ||
      std::max(a.y(), b.y()) < std::min(c.y(), d.y()) || std::max(c.y(), d.y()) < std::min(a.y(), b.y())) {
    return false;
  }
  const double s1 = cross(b - a, c - a), s2 = cross(b - a, d - a), s3 = cross(d - c, a - c), s4 = cross(d - c, b - c);
  return ((s1 <= 0 && s2 >= 0) || (s1 >= 0 && s2 <= 0)) && ((s3 <= 0 && s4 >= 0) || (s3 >= 0 && s4 <= 0));
}

// Whether edges meet elsewhere than at their common corner. Edges are taken in the order of their left ends: each meets
// only those that begin before it ends.
bool crosses_itself(const std::vector<Point>& p, bool closed) {
  const std::size_t n = p.size(), edges = closed ? n : n - 1;
  for (std::size_t e = 0; e < (closed ? n : n - 2); ++e) {  // neighbours meet where one turns back on the other
    const Point a = p[(e + 1) % n] - p[e], b = p[(e + 2) % n] - p[(e + 1) % n];
    constexpr double kParallel = 1e-12;
    if (a.dot(b) < 0 && std::abs(cross(a, b)) <= kParallel * a.norm() * b.norm()) return true;
  }
  std::vector<std::size_t> order(edges);
  for (std::size_t i = 0; i < edges; ++i) order[i] = i;
  const auto left = [&](std::size_t e) { return std::min(p[e].x(), p[(e + 1) % n].x()); };
  const auto right = [&](std::size_t e) { return std::max(p[e].x(), p[(e + 1) % n].x()); };
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return left(a) < left(b); });
  for (std::size_t i = 0; i < edges; ++i) {
    for (std::size_t k = i + 1; k < edges && left(order[k]) <= right(order[i]); ++k) {
      const std::size_t a = std::min(order[i], order[k]), b = std::max(order[i], order[k]);
      if (b == a + 1 || (closed && a == 0 && b == n - 1)) continue;
      if (segments_meet(p[a], p[a + 1], p[b], p[(b + 1) % n])) return true;
    }
  }
  return false;
}

// Distances of cells from a contour on one of its sides, mitred or round at the corners; infinite where far.
class Band {
 public:
  Band(const std::vector<Point>& contour, bool closed, double side, bool square, double width)
      : contour_(contour), closed_(closed), side_(side), square_(square), width_(width) {}

  [[nodiscard]] std::size_t edges() const { return closed_ ? contour_.size() : contour_.size() - 1; }
  [[nodiscard]] const Point& start(std::size_t e) const { return contour_[e]; }
  [[nodiscard]] const Point& end(std::size_t e) const { return contour_[(e + 1) % contour_.size()]; }
  [[nodiscard]] Point along(std::size_t e) const { return (end(e) - start(e)).normalized(); }
  // The unit normal to the side of the band; side is 1 for left.
  [[nodiscard]] Point normal(std::size_t e) const {
    const Point t = along(e);
    return side_ * Point(-t.y(), t.x());
  }
  // Whether the band has a corner to fill after edge e: it turns away from the band's side there.
  [[nodiscard]] bool has_corner(std::size_t e) const { return closed_ || e + 1 < edges(); }
  [[nodiscard]] std::size_t next(std::size_t e) const { return (e + 1) % edges(); }
  [[nodiscard]] bool opens(std::size_t e) const { return side_ * cross(along(e), along(next(e))) < 0; }

  // Points that bound the band of its width.
  void bound(Point& min, Point& max) const {
    const auto hold = [&](const Point& p) {
      min = min.cwiseMin(p);
      max = max.cwiseMax(p);
    };
    for (std::size_t e = 0; e < edges(); ++e) {
      const Point n = normal(e);
      for (const Point& p : {start(e), end(e)}) {
        hold(p);
        hold(p + width_ * n);
      }
      if (!has_corner(e) || !opens(e)) continue;
      const Point m = normal(next(e)), bisector = (n + m).stableNormalized();
      const double cosine = bisector.dot(n);
      if (square_) {
        hold(end(e) + bisector * std::min(kMitreLimit * width_, width_ / std::max(cosine, 1e-9)));
      } else {
        hold(end(e) + Point(width_, width_));
        hold(end(e) - Point(width_, width_));
      }
    }
  }

  // Calls put(i, j, distance) for the cells of `grid` in the band widened by `margin`.
  template <class F>
  void visit(const Stock& grid, double margin, F&& put) const {
    const double reach = width_ + margin;
    for (std::size_t e = 0; e < edges(); ++e) {
      const Point a = start(e), t = along(e), n = normal(e);
      const double length = (end(e) - a).norm();
      for_cells(grid, {a, end(e), a + reach * n, end(e) + reach * n}, [&](int i, int j, const Point& p) {
        const double s = t.dot(p - a), q = n.dot(p - a);
        if (s >= 0 && s <= length && q >= 0 && q <= reach) put(i, j, q);
      });
      if (!has_corner(e) || !opens(e)) continue;
      const Point v = end(e), m = normal(next(e)), u = along(next(e)), bisector = (n + m).stableNormalized();
      const double far = square_ ? kMitreLimit * reach : reach;
      for_cells(grid, {v - Point(far, far), v + Point(far, far)}, [&](int i, int j, const Point& p) {
        const Point d = p - v;
        if (t.dot(d) < 0 || u.dot(d) > 0) return;
        if (!square_) {
          put(i, j, d.norm());
        } else {
          put(i, j, std::max({n.dot(d), m.dot(d), bisector.dot(d) / kMitreLimit}));
        }
      });
    }
  }

 private:
  template <class F>
  static void for_cells(const Stock& grid, const std::vector<Point>& corners, F&& visit_cell) {
    Point min = corners[0], max = corners[0];
    for (const Point& p : corners) {
      min = min.cwiseMin(p);
      max = max.cwiseMax(p);
    }
    const double c = grid.cell(), x0 = grid.x_min() + 0.5 * c, y0 = grid.y_min() + 0.5 * c;
    const auto index = [](double x, int count) { return static_cast<int>(std::clamp(x, 0.0, double(count))); };
    const int i0 = index(std::ceil((min.x() - x0) / c), grid.columns());
    const int i1 = index(std::floor((max.x() - x0) / c) + 1, grid.columns());
    const int j0 = index(std::ceil((min.y() - y0) / c), grid.rows());
    const int j1 = index(std::floor((max.y() - y0) / c) + 1, grid.rows());
    for (int j = j0; j < j1; ++j) {
      for (int i = i0; i < i1; ++i) visit_cell(i, j, Point(x0 + i * c, y0 + j * c));
    }
  }

  const std::vector<Point>& contour_;
  bool closed_;
  double side_;
  bool square_;
  double width_;
};

// Calls put(i, j) for the cells of `grid` with their centre in the closed contour (even-odd).
template <class F>
void visit_inside(const Stock& grid, const std::vector<Point>& contour, F&& put) {
  const double c = grid.cell(), x0 = grid.x_min() + 0.5 * c, y0 = grid.y_min() + 0.5 * c;
  std::vector<std::vector<double>> crossings(grid.rows());
  for (std::size_t e = 0; e < contour.size(); ++e) {
    const Point& a = contour[e];
    const Point& b = contour[(e + 1) % contour.size()];
    const double low = std::min(a.y(), b.y()), high = std::max(a.y(), b.y());
    const double j0 = std::clamp(std::ceil((low - y0) / c), 0.0, double(grid.rows()));
    for (int j = static_cast<int>(j0); j < grid.rows() && y0 + j * c < high; ++j) {
      crossings[j].push_back(a.x() + (y0 + j * c - a.y()) / (b.y() - a.y()) * (b.x() - a.x()));
    }
  }
  for (int j = 0; j < grid.rows(); ++j) {
    std::sort(crossings[j].begin(), crossings[j].end());
    for (std::size_t k = 0; k + 1 < crossings[j].size(); k += 2) {
      const int i0 = static_cast<int>(std::clamp(std::ceil((crossings[j][k] - x0) / c), 0.0, double(grid.columns())));
      for (int i = i0; i < grid.columns() && x0 + i * c <= crossings[j][k + 1]; ++i) put(i, j);
    }
  }
}

Result<std::vector<Point>> contour_from(const config::Table& table, bool closed) {
  POLYPOD_ASSIGN(rows, table.points("contour_mm", 2));
  std::vector<Point> contour;
  for (const std::vector<double>& row : rows) {
    const Point p(units::from_mm(row[0]), units::from_mm(row[1]));
    if (contour.empty() || p != contour.back()) contour.push_back(p);
  }
  if (closed && contour.size() > 1 && contour.front() == contour.back()) contour.pop_back();
  if (contour.size() > kMostCorners) {
    return fail("CT118",
                fmt::format("{}.contour_mm has {} points; at most {}", table.name(), contour.size(), kMostCorners),
                table.place_of("contour_mm"), "list the corners of the outline, not samples of its curves");
  }
  const std::size_t least = closed ? 3 : 2;
  if (contour.size() < least) {
    return fail("CT113",
                fmt::format("{}.contour_mm has {} different points; {} contour needs {}", table.name(), contour.size(),
                            closed ? "a closed" : "an open", least),
                table.place_of("contour_mm"), "list the corners of the finished outline in order");
  }
  if (crosses_itself(contour, closed)) {
    return fail("CT114", fmt::format("{}.contour_mm crosses or touches itself", table.name()),
                table.place_of("contour_mm"), "list the corners in the order in which the outline passes them");
  }
  return contour;
}

Result<Stock> allowance_from(const config::Table& table, const Cutter& cutter) {
  POLYPOD_ASSIGN(closed, table.optional_boolean("closed", true));
  POLYPOD_ASSIGN(contour, contour_from(table, closed));
  POLYPOD_ASSIGN(allowance_mm, table.number("allowance_mm", kAllowanceRange_mm));
  POLYPOD_ASSIGN(side, table.text("side"));
  POLYPOD_ASSIGN(corners, table.optional_text("corners", "square"));
  POLYPOD_ASSIGN(top_mm, table.number("z_top_mm"));
  POLYPOD_ASSIGN(bottom_mm, table.number("z_bottom_mm"));
  const std::string first = closed ? "outside" : "left", second = closed ? "inside" : "right";
  if (side != first && side != second) {
    return fail("CT115",
                fmt::format("{}.side = \"{}\" must be \"{}\" or \"{}\" for {} contour", table.name(), side, first,
                            second, closed ? "a closed" : "an open"),
                table.place_of("side"));
  }
  if (corners != "square" && corners != "round") {
    return fail("CT116", fmt::format("{}.corners = \"{}\" must be \"square\" or \"round\"", table.name(), corners),
                table.place_of("corners"));
  }
  if (!(bottom_mm < top_mm)) {
    return fail("CT110",
                fmt::format("{}.z_top_mm = {:g} is not above {}.z_bottom_mm = {:g}: the stock is empty", table.name(),
                            top_mm, table.name(), bottom_mm),
                table.place_of("z_top_mm"), "the top is where the material begins, seen from the spindle");
  }

  // The band lies to the left (1) or right (-1) of the contour as listed.
  double band_side = side == "left" ? 1 : -1;
  if (closed) {
    double area = 0;
    for (std::size_t i = 0; i < contour.size(); ++i) area += cross(contour[i], contour[(i + 1) % contour.size()]);
    band_side = (area > 0) == (side == "inside") ? 1 : -1;
  }
  const double allowance = units::from_mm(allowance_mm);
  const bool square = corners == "square";
  const Band band(contour, closed, band_side, square, allowance);
  // What is behind the contour of a pocket or an open contour: a cutter's diameter of it.
  const Band behind(contour, closed, -band_side, true, cutter.diameter);
  const bool part_inside = closed && side == "outside";

  Point min = contour[0], max = contour[0];
  band.bound(min, max);
  if (!part_inside) behind.bound(min, max);
  POLYPOD_ASSIGN(cell, cell_from(table, cutter, max.x() - min.x(), max.y() - min.y()));
  POLYPOD_TRY(table.finish());
  const double top = units::from_mm(top_mm), bottom = units::from_mm(bottom_mm);
  POLYPOD_ASSIGN(stock, placed(Stock::block({min.x(), min.y(), bottom}, {max.x(), max.y(), top}, cell), table));

  std::vector<float> distance(static_cast<std::size_t>(stock.columns()) * stock.rows(),
                              std::numeric_limits<float>::infinity());
  const auto put = [&](int i, int j, double d) {
    float& least = distance[static_cast<std::size_t>(j) * stock.columns() + i];
    least = std::min(least, static_cast<float>(d));
  };
  band.visit(stock, cell, put);
  if (part_inside) {
    visit_inside(stock, contour, [&](int i, int j) { put(i, j, 0); });
  } else {
    behind.visit(stock, 0, [&](int i, int j, double) { put(i, j, 0); });
  }
  // The border of the allowance is blended over one cell, as walls are (Stock::cut_disc).
  for (int j = 0; j < stock.rows(); ++j) {
    for (int i = 0; i < stock.columns(); ++i) {
      const double d = distance[static_cast<std::size_t>(j) * stock.columns() + i];
      if (d > 0) stock.keep_share(i, j, 0.5 + (allowance - d) / cell);
    }
  }
  return stock;
}

Result<Stock> file_from(const config::Table& table, const Cutter& cutter) {
  POLYPOD_ASSIGN(file, table.text("file"));
  POLYPOD_ASSIGN(turned, table.optional_text("turned", ""));
  Vec3 shift = Vec3::Zero();
  const Result<std::vector<double>> shift_mm = table.numbers("shift_mm", 3);  // asked for, so that it is a known key
  if (table.has("shift_mm")) {
    if (!shift_mm) return tl::unexpected(shift_mm.error());
    for (int i = 0; i < 3; ++i) shift[i] = units::from_mm((*shift_mm)[static_cast<std::size_t>(i)]);
  }
  POLYPOD_TRY(table.finish());
  if (table.has("turned") && turned != "x" && turned != "y") {
    return fail("CT124", fmt::format("{}.turned = \"{}\" must be \"x\" or \"y\"", table.name(), turned),
                table.place_of("turned"), "the axis of the earlier W about which the part was turned over by 180 deg");
  }
  POLYPOD_ASSIGN(stock, read_stock(config::beside(table.place().file, file)));
  if (stock.cell() > kLargestCell * cutter.diameter * (1 + 1e-9)) {
    return fail(
        "CT112",
        fmt::format("the cells of {} are {:g} mm wide, coarser than the cutter allows: {:g} mm, {:g} of its "
                    "diameter",
                    file, units::to_mm(stock.cell()), units::to_mm(kLargestCell * cutter.diameter), kLargestCell),
        table.place_of("file"),
        fmt::format("write cell_mm = {:g} or less under [stock] of the earlier job, and its stock again",
                    units::to_mm(kLargestCell * cutter.diameter)));
  }
  if (!turned.empty()) stock = stock.turned(turned == "x" ? Stock::Axis::x : Stock::Axis::y);
  return shift.isZero(0) ? stock : stock.shifted(shift);
}

}  // namespace

Result<Stock> stock_from(const config::Table& table, const Cutter& cutter) {
  POLYPOD_ASSIGN(kind, table.text("kind"));
  if (kind == "block") return block_from(table, cutter);
  if (kind == "allowance") return allowance_from(table, cutter);
  if (kind == "file") return file_from(table, cutter);
  return fail("CT117", fmt::format("{}.kind = \"{}\" must be \"block\", \"allowance\" or \"file\"", table.name(), kind),
              table.place_of("kind"));
}

}  // namespace polypod::cutting
