// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/stock.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numbers>

#include "history.hpp"
#include "integrals.hpp"
#include "lanes.hpp"
#include "polypod/core/units.hpp"

namespace polypod::cutting {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

static_assert(Stock::kLayers == 8);  // two Quads

// kFirst.of[n] are the first n layers of a cell.
struct FirstLayers {
  Mask of[Stock::kLayers + 1][2];
};
constexpr FirstLayers first_layers() {
  FirstLayers out{};
  for (int n = 0; n <= Stock::kLayers; ++n) {
    for (int half = 0; half < 2; ++half) {
      const int k = 4 * half;
      out.of[n][half] = Mask{k < n ? -1 : 0, k + 1 < n ? -1 : 0, k + 2 < n ? -1 : 0, k + 3 < n ? -1 : 0};
    }
  }
  return out;
}
constexpr FirstLayers kFirst = first_layers();

// kBetween.of[m][n] are the layers from m up to n of a cell.
struct LayersBetween {
  Mask of[Stock::kLayers + 1][Stock::kLayers + 1][2];
};
constexpr LayersBetween layers_between() {
  LayersBetween out{};
  for (int m = 0; m <= Stock::kLayers; ++m) {
    for (int n = 0; n <= Stock::kLayers; ++n) {
      for (int half = 0; half < 2; ++half) {
        const int k = 4 * half;
        const auto in = [&](int layer) { return layer >= m && layer < n ? -1 : 0; };
        out.of[m][n][half] = Mask{in(k), in(k + 1), in(k + 2), in(k + 3)};
      }
    }
  }
  return out;
}
constexpr LayersBetween kBetween = layers_between();

// Cells on their way through a loop that handles several at once: runs of neighbours in a row, one run after the other.
struct Cells {
  static constexpr int kMost = 128;  // an even number: they are handled in pairs
  int count = 0;
  double x[kMost], y[kMost];  // of the centre
  std::size_t at[kMost];      // index of the first layer
  int run[kMost];             // which run it is of, where that counts

  /// Adds a run; `work` is called whenever the list is full, and empties it.
  template <class Work>
  void add(double x0, double cell, double row, int i0, int i1, std::size_t first, Work&& work) {
    for (int i = i0; i <= i1;) {
      const int n = std::min(i1 - i + 1, kMost - count);
      for (int k = 0; k < n; ++k) {
        x[count + k] = x0 + (i + k) * cell;
        y[count + k] = row;
        at[count + k] = first + static_cast<std::size_t>(i + k) * Stock::kLayers;
      }
      count += n;
      i += n;
      if (count == kMost) work();
    }
  }
};

// What is due is a little more than what was left standing; all of it lies well inside the disc.
constexpr double kDueSlack = 1e-9;

struct Span {
  double lo = kInfinity;
  double hi = -kInfinity;
  [[nodiscard]] bool empty() const { return !(lo <= hi); }
  void join(double a, double b) {
    lo = std::min(lo, a);
    hi = std::max(hi, b);
  }
  void meet(double a, double b) {
    lo = std::max(lo, a);
    hi = std::min(hi, b);
  }
};

// The points with f . (x, y) >= s, cut row by row.
class HalfPlane {
 public:
  explicit HalfPlane(const Eigen::Vector2d& f) : fx_(f.x()), fy_(f.y()), inverse_(fx_ != 0 ? 1 / fx_ : 0) {}
  void meet(Span& span, double y, double s) const {
    const double rest = s - fy_ * y;
    if (fx_ > 0) {
      span.lo = std::max(span.lo, rest * inverse_);
    } else if (fx_ < 0) {
      span.hi = std::min(span.hi, rest * inverse_);
    } else if (rest > 0) {
      span.hi = -kInfinity;
    }
  }

 private:
  double fx_, fy_, inverse_;
};

// The smallest index whose centre is not left of `x`, and the largest whose centre is not right of it; x counts in
// cells from the first centre.
int first_index(double x) {
  if (!(x > 0)) return 0;
  if (x > std::numeric_limits<int>::max() - 1) return std::numeric_limits<int>::max() - 1;
  const int i = static_cast<int>(x);
  return i + (i < x ? 1 : 0);
}
int last_index(double x, int count) {
  if (!(x >= 0)) return -1;
  return x >= count - 1 ? count - 1 : static_cast<int>(x);
}

// The whole number below and the one above, without a call.
int whole_below(double x) {
  const int i = static_cast<int>(x);
  return i - (i > x ? 1 : 0);
}
int whole_above(double x) {
  const int i = static_cast<int>(x);
  return i + (i < x ? 1 : 0);
}

// How many layers of a cell a disc cuts, by the square of the distance of the cell's centre from the disc's axis. The
// share of the cell that the disc covers is taken as
//   1/2 + (R^2 - d^2) / (2 R cell), kept within 0 .. 1:
// it is 1/2 on the edge and falls from 1 to 0 within one cell across it, without a square root. Layer k is cut where
// the share is above (k + 1/2) / kLayers, or a little less: kBias keeps cells of paths along the grid, whose shares are
// round numbers, away from the threshold, where rounding would decide.
class Cover {
 public:
  static constexpr int kLayers = Stock::kLayers;
  static constexpr double kBias = 0.0137;

  Cover(double radius, double cell)
      : at_axis_(kLayers * (0.5 + 0.5 * radius / cell) + 0.5 + kBias),
        fall_(kLayers * 0.5 / (radius * cell)),
        outer2_(radius * (radius + cell)),
        inner2_(radius * (radius - cell)) {}

  /// Rounded down this is the number of layers.
  [[nodiscard]] Pair layers(Pair d2, double slack = 0) const {
    return clamped(at_axis_ - fall_ * d2 + slack, two(0), two(kLayers));
  }
  /// The square of the distance within which layer k is cut (negative if never).
  [[nodiscard]] double reach2(int k) const { return (at_axis_ - (k + 1)) / fall_; }
  [[nodiscard]] double outer2() const { return outer2_; }  ///< beyond, no layer is cut
  [[nodiscard]] double inner2() const { return inner2_; }  ///< within, all are (negative if never)

 private:
  double at_axis_, fall_, outer2_, inner2_;
};

}  // namespace

float Stock::empty() {
  return -std::numeric_limits<float>::infinity();
}

Result<Stock> Stock::block(const Vec3& min, const Vec3& max, double cell, std::size_t max_cells) {
  const Vec3 size = max - min;
  const bool high = static_cast<double>(static_cast<float>(max.z())) > min.z();  // as the heights are kept
  if (!min.allFinite() || !max.allFinite() || !(size.minCoeff() > 0) || !high || !(cell > 0) || !std::isfinite(cell)) {
    return fail("CT110",
                fmt::format("the stock from ({:g}, {:g}, {:g}) to ({:g}, {:g}, {:g}) mm with cells of {:g} mm "
                            "holds nothing",
                            units::to_mm(min.x()), units::to_mm(min.y()), units::to_mm(min.z()), units::to_mm(max.x()),
                            units::to_mm(max.y()), units::to_mm(max.z()), units::to_mm(cell)),
                {}, "each size and the cell must be above 0");
  }
  const double columns = std::max(1.0, std::round(size.x() / cell)), rows = std::max(1.0, std::round(size.y() / cell));
  if (columns * rows > static_cast<double>(max_cells) || columns > 1e9 || rows > 1e9) {
    return fail(
        "CT111",
        fmt::format("a stock of {:g} mm by {:g} mm in cells of {:g} mm has {:.3g} cells; {} are allowed",
                    units::to_mm(size.x()), units::to_mm(size.y()), units::to_mm(cell), columns * rows, max_cells),
        {}, "make the stock smaller or the cells larger (0.025 of the cutter's diameter at most)");
  }
  Stock stock;
  stock.cell_ = cell;
  stock.columns_ = static_cast<int>(columns);
  stock.rows_ = static_cast<int>(rows);
  stock.x_min_ = 0.5 * (min.x() + max.x() - columns * cell);
  stock.y_min_ = 0.5 * (min.y() + max.y() - rows * cell);
  stock.bottom_ = min.z();
  stock.top_ = static_cast<float>(max.z());
  stock.layers_.assign(static_cast<std::size_t>(stock.columns_) * stock.rows_ * kLayers, stock.top_);
  return stock;
}

Result<Stock> Stock::from_layers(double x_min, double y_min, double cell, int columns, int rows, double bottom,
                                 double top, std::vector<float> layers, std::vector<float> hollow) {
  const auto bad = [](std::string what) { return fail("CT123", "the stock is damaged: " + std::move(what)); };
  constexpr double kLeast = 1e-6, kMost = 1, kFarthest = 1e6;  // m: a cell, and where the grid may lie
  if (!(std::abs(x_min) <= kFarthest) || !(std::abs(y_min) <= kFarthest) || !(cell >= kLeast && cell <= kMost) ||
      columns < 1 || rows < 1) {
    return bad(fmt::format("cells of {:g} mm from x {:g}, y {:g} mm on; 0.001 to 1000 mm, within 1000 km",
                           units::to_mm(cell), units::to_mm(x_min), units::to_mm(y_min)));
  }
  const float highest = static_cast<float>(top);  // as the heights are kept: must still be above the bottom
  if (!std::isfinite(bottom) || !std::isfinite(highest) || !(bottom < static_cast<double>(highest))) {
    return bad(fmt::format("its bottom is {:g} mm and its top {:g} mm", units::to_mm(bottom), units::to_mm(top)));
  }
  if (layers.size() != static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows) * kLayers) {
    return bad(fmt::format("{} heights for {} by {} cells of {} layers", layers.size(), columns, rows, kLayers));
  }
  if (!hollow.empty() && hollow.size() != layers.size()) {
    return bad(fmt::format("{} heights, but {} of what is hollow", layers.size(), hollow.size()));
  }
  for (const std::vector<float>* heights : {&layers, &hollow}) {
    for (const float h : *heights) {
      if (!(h <= highest) || (std::isinf(h) && h != empty())) return bad(fmt::format("a height of {:g} m", h));
    }
  }
  Stock stock;
  stock.cell_ = cell;
  stock.columns_ = columns;
  stock.rows_ = rows;
  stock.x_min_ = x_min;
  stock.y_min_ = y_min;
  stock.bottom_ = bottom;
  stock.top_ = highest;
  if (!hollow.empty()) {
    Stock inside = stock;
    inside.layers_ = std::move(hollow);
    stock.hollow_.push_back(std::move(inside));
  }
  stock.layers_ = std::move(layers);
  return stock;
}

float Stock::height(int column, int row) const {
  const float* layers = cell_layers(column, row);
  double sum = 0;
  bool any = false;
  for (int k = 0; k < kLayers; ++k) {
    any = any || layers[k] > bottom_;
    sum += std::max<double>(layers[k], bottom_);
  }
  return any ? static_cast<float>(sum / kLayers) : empty();
}

void Stock::set_height(int column, int row, float h) {
  std::fill_n(layers_.begin() + index(column, row), kLayers, h);
  if (h > top_) top_ = h;
}

double Stock::lower(int column, int row, double level) {
  const double kept = std::max(level, bottom_);
  const float height = level <= bottom_ + 1e-12 ? empty() : static_cast<float>(level);
  double removed = 0;
  float* layers = layers_.data() + index(column, row);
  for (int k = 0; k < kLayers; ++k) {
    removed += std::max(0.0, layers[k] - kept);
    layers[k] = std::min(layers[k], height);
  }
  removed *= cell_ * cell_ / kLayers;
  for (Stock& hollow : hollow_) removed -= hollow.lower(column, row, level);
  return removed;
}

void Stock::keep_share(int column, int row, double share) {
  const auto first = layers_.begin() + index(column, row);
  const int kept = static_cast<int>(std::lround(std::clamp(share, 0.0, 1.0) * kLayers));
  std::fill_n(first, kLayers - kept, empty());
}

double Stock::volume() const {
  double sum = 0;
  for (int j = 0; j < rows_; ++j) {
    double row = 0;
    const float* layers = cell_layers(0, j);
    for (std::size_t i = 0; i < static_cast<std::size_t>(columns_) * kLayers; ++i)
      row += std::max(0.0, layers[i] - bottom_);
    sum += row;
  }
  double volume = sum * cell_ * cell_ / kLayers;
  for (const Stock& hollow : hollow_) volume -= hollow.volume();
  return volume;
}

Stock Stock::in_half_cells() const {
  Stock out = *this;
  out.cell_ = 0.5 * cell_;
  out.columns_ = 2 * columns_;
  out.rows_ = 2 * rows_;
  out.layers_.resize(4 * layers_.size());
  for (int j = 0; j < out.rows_; ++j) {
    for (int i = 0; i < out.columns_; ++i) {
      std::copy_n(cell_layers(i / 2, j / 2), kLayers,
                  out.layers_.begin() + static_cast<std::ptrdiff_t>(out.index(i, j)));
    }
  }
  for (Stock& hollow : out.hollow_) hollow = hollow.in_half_cells();
  return out;
}

Stock Stock::turned(Axis about) const {
  Stock out = *this;
  if (about == Axis::x) out.y_min_ = -(y_min_ + rows_ * cell_);
  if (about == Axis::y) out.x_min_ = -(x_min_ + columns_ * cell_);
  out.bottom_ = -static_cast<double>(top_);
  out.top_ = static_cast<float>(-bottom_);
  Stock inside = out;
  inside.hollow_.clear();
  for (int j = 0; j < rows_; ++j) {
    for (int i = 0; i < columns_; ++i) {
      const std::size_t to = about == Axis::x ? out.index(i, rows_ - 1 - j) : out.index(columns_ - 1 - i, j);
      for (std::size_t k = 0; k < kLayers; ++k) {
        const float height = layers_[index(i, j) + k];
        const float begin = hollow_.empty() ? empty() : hollow_[0].layers_[index(i, j) + k];
        const bool open = begin > bottom_, solid = height > (open ? static_cast<double>(begin) : bottom_);
        out.layers_[to + k] = !solid ? empty() : open ? -begin : out.top_;
        inside.layers_[to + k] = solid && height < top_ ? -height : empty();
      }
    }
  }
  out.hollow_.clear();
  out.hollow_.push_back(std::move(inside));
  return out;
}

Stock Stock::shifted(const Vec3& by) const {
  Stock out = *this;
  out.x_min_ += by.x();
  out.y_min_ += by.y();
  out.bottom_ += by.z();
  out.top_ = static_cast<float>(top_ + by.z());
  for (float& height : out.layers_) height = static_cast<float>(height + by.z());
  for (Stock& hollow : out.hollow_) hollow = hollow.shifted(by);
  return out;
}

double Stock::cut_disc(const Vec3& tip, double radius) {
  double removed = sweep(tip, tip, radius, false, false);
  for (Stock& hollow : hollow_) removed -= hollow.cut_disc(tip, radius);
  return removed;
}

double Stock::cut_line(const Vec3& a, const Vec3& b, double radius, bool a_done) {
  double removed = cut_way(a, b, radius, a_done, false);
  for (Stock& hollow : hollow_) removed -= hollow.cut_line(a, b, radius, a_done);
  return removed;
}

double Stock::cut_step(const Vec3& a, const Vec3& b, double radius, bool a_done) {
  const bool down = b.z() < a.z();
  double removed = (down ? 0 : settle_heights()) + cut_way(a, b, radius, a_done, down);
  for (Stock& hollow : hollow_) removed -= hollow.cut_step(a, b, radius, a_done);
  return removed;
}

double Stock::settle() {
  double removed = settle_heights();
  for (Stock& hollow : hollow_) removed -= hollow.settle();
  return removed;
}

double Stock::settle_heights() {
  if (!due_.any) return 0;
  due_.any = false;
  const Quad level = all(std::max(due_.level, static_cast<float>(bottom_))), kept = all(due_.level);
  const double x0 = x_min_ + 0.5 * cell_ - due_.x, y0 = y_min_ + 0.5 * cell_ - due_.y, reach = std::sqrt(due_.inner2);
  double removed = 0;
  const int j1 = last_index((reach - y0) / cell_, rows_);
  for (int j = first_index((-reach - y0) / cell_); j <= j1; ++j) {
    const double y = y0 + j * cell_, w = std::sqrt(std::max(0.0, due_.inner2 - y * y));
    const int i1 = last_index((w - x0) / cell_, columns_);
    Quad in_row{};
    for (int i = first_index((-w - x0) / cell_); i <= i1; ++i) {
      float* h = layers_.data() + index(i, j);
      for (const int k : {0, 4}) {
        const Quad height = load(h + k);
        in_row += larger(height - level, all(0));
        store(h + k, smaller(height, kept));
      }
    }
    removed += sum(in_row);
  }
  return removed * cell_ * cell_ / kLayers;
}

double Stock::cut_way(const Vec3& a, const Vec3& b, double radius, bool a_done, bool later) {
  if (b.z() == a.z()) return sweep(a, b, radius, a_done, false);
  // The part above the material takes nothing, and the part below the bottom takes all there is: cut the way there.
  double removed = 0;
  const double rise = b.z() - a.z();
  double t[4] = {0, std::clamp((bottom_ - a.z()) / rise, 0.0, 1.0), std::clamp((top_ - a.z()) / rise, 0.0, 1.0), 1};
  std::sort(t, t + 4);
  for (int i = 0; i < 3; ++i) {
    if (!(t[i + 1] > t[i])) continue;
    Vec3 from = a + t[i] * (b - a), to = t[i + 1] == 1 ? b : Vec3(a + t[i + 1] * (b - a));
    from.z() = std::max(from.z(), bottom_);
    to.z() = std::max(to.z(), bottom_);
    removed += sweep(from, to, radius, a_done && t[i] == 0 && rise > 0, later);
  }
  return removed;
}

double Stock::sweep(const Vec3& a, const Vec3& b, double radius, bool a_done, bool later) {
  if (!a.allFinite() || !b.allFinite() || !(radius > 0) || columns_ == 0) return 0;
  if (std::min(a.z(), b.z()) >= top_) return 0;
  Eigen::Vector2d f = (b - a).head<2>();
  const double length = f.norm();
  f = length > 0 ? Eigen::Vector2d(f / length) : Eigen::Vector2d(1, 0);
  const bool sloped = a.z() != b.z() && length > 0;
  const double slope = sloped ? (b.z() - a.z()) / length : 0;

  // A level at the bottom leaves nothing: the cell is kept as empty, and what is removed ends at the bottom.
  const double bottom = bottom_, at_bottom = bottom + 1e-12;
  const auto kept_as = [at_bottom](double level) { return level <= at_bottom ? empty() : static_cast<float>(level); };
  const double level = std::max(bottom, std::min(a.z(), b.z()));  // of a level way, or of the lower end
  const float level_kept = kept_as(level), level_float = static_cast<float>(level);

  const Cover cover(radius, cell_);
  double reach2[kLayers];
  for (int k = 0; k < kLayers; ++k) reach2[k] = cover.reach2(k);
  const double outer = std::sqrt(cover.outer2());
  const double bx = f.x() * length, by = f.y() * length;
  // Cell centres in the frame of a.
  const double x0 = x_min_ + 0.5 * cell_ - a.x(), y0 = y_min_ + 0.5 * cell_ - a.y();
  const int j0 = first_index((std::min(0.0, by) - outer - y0) / cell_);
  const int j1 = last_index((std::max(0.0, by) + outer - y0) / cell_, rows_);
  double removed = 0, removed_before = 0;

  // Of a way down that goes on where the last one ended, what is due of that lies on this way or under its end.
  later = later && b.z() < a.z() && cover.inner2() > 0;
  if (later) {
    if (due_.x != a.x() || due_.y != a.y() || due_.radius != radius) removed_before = settle_heights();
    due_ = {true, b.x(), b.y(), radius, cover.inner2() * (1 + kDueSlack), level_kept};
  }

  const double inverse_cell = 1 / cell_;
  const double low_x = slope < 0 ? bx : 0, low_y = slope < 0 ? by : 0;  // the lower end of a sloped way
  // What is lower than every place of the tip stays as it is; on a slope their rounding is left some room.
  const bool to_bottom = level <= at_bottom;
  const float lowest = to_bottom ? -std::numeric_limits<float>::max() : level_float;
  const Quad untouched = all(sloped && !to_bottom ? std::nextafter(lowest, empty()) : lowest);
  const auto stands = [&](const float* h) { return any((load(h) > untouched) | (load(h + 4) > untouched)); };

  Cells cells;
  double covered[Cells::kMost], across[Cells::kMost], along[Cells::kMost];
  Quad removed_in_row{};
  int runs = 0, run_at_hand = 0;
  const auto cut_level = [&](float* h, int layers) {
    for (const int half : {0, 1}) {
      const Mask cut = kFirst.of[layers][half];
      const Quad height = load(h + 4 * half);
      removed_in_row += where(cut, larger(height - all(level_float), all(0)));
      store(h + 4 * half, cut ? smaller(height, all(level_kept)) : height);
    }
  };
  const auto cut_slope = [&](float* h, int layers, double s, double n) {
    // Layer k is cut while the axis is within sqrt(reach2 - n^2) of the foot of the cell: the lower end counts.
    const double n2 = n * n;
    for (const int half : {0, 1}) {
      Pair z[2];
      for (const int quarter : {0, 1}) {
        const Pair t = root(clamped(load(reach2 + 4 * half + 2 * quarter) - n2, two(0), two(reach2[0])));
        z[quarter] = a.z() + slope * clamped(slope < 0 ? s + t : s - t, two(0), two(length));
      }
      const Mask cut = kFirst.of[layers][half];
      const Quad height = load(h + 4 * half);
      const Quad low = narrow(z[0], z[1]);
      const Quad kept =
          to_bottom ? narrow(z[0] <= at_bottom ? -kInfinity : z[0], z[1] <= at_bottom ? -kInfinity : z[1]) : low;
      removed_in_row += where(cut, larger(height - low, all(0)));
      store(h + 4 * half, cut ? smaller(height, kept) : height);
    }
  };
  const auto cut_cells = [&] {
    for (int k = 0; k < cells.count; k += 2) {
      const Pair x = load(cells.x + k), y = load(cells.y + k);
      const Pair s = f.x() * x + f.y() * y, n = f.x() * y - f.y() * x;
      const Pair beyond = s - clamped(s, two(0), two(length));
      store(covered + k, cover.layers(beyond * beyond + n * n));
      store(along + k, s);
      store(across + k, n);
    }
    for (int k = 0; k < cells.count; ++k) {
      float* h = layers_.data() + cells.at[k];
      const int layers = static_cast<int>(covered[k]);
      if (cells.run[k] != run_at_hand) {
        removed += sum(removed_in_row);
        removed_in_row = Quad{};
        run_at_hand = cells.run[k];
      }
      if (!sloped) {
        cut_level(h, layers);
      } else {
        const double x = cells.x[k] - low_x, y = cells.y[k] - low_y;
        if (x * x + y * y <= cover.inner2()) {
          cut_level(h, kLayers);
        } else {
          cut_slope(h, layers, along[k], across[k]);
        }
      }
    }
    cells.count = 0;
  };
  const auto cut_row = [&](int j, double y, double lo, double hi) {
    const int i0 = first_index((lo - x0) * inverse_cell), i1 = last_index((hi - x0) * inverse_cell, columns_);
    const float* row = layers_.data() + index(0, j);
    ++runs;
    for (int i = i0; i <= i1; ++i) {
      const std::size_t at = static_cast<std::size_t>(i) * kLayers;
      if (!stands(row + at)) continue;
      cells.x[cells.count] = x0 + i * cell_;
      cells.y[cells.count] = y;
      cells.at[cells.count] = index(0, j) + at;
      cells.run[cells.count] = runs;
      if (++cells.count == Cells::kMost) cut_cells();
    }
  };
  const HalfPlane after_a(f), before_b(-f), right_of_left({-f.y(), f.x()}), left_of_right({f.y(), -f.x()});

  for (int j = j0; j <= j1; ++j) {
    const double y = y0 + j * cell_;
    Span span;
    if (const double w2 = cover.outer2() - y * y; w2 > 0) {
      const double w = std::sqrt(w2);
      span.join(-w, w);
    }
    if (length > 0) {
      if (const double w2 = cover.outer2() - (y - by) * (y - by); w2 > 0) {
        const double w = std::sqrt(w2);
        span.join(bx - w, bx + w);
      }
      Span middle{-kInfinity, kInfinity};  // the rectangle between the discs
      after_a.meet(middle, y, 0);
      before_b.meet(middle, y, -length);
      right_of_left.meet(middle, y, -outer);
      left_of_right.meet(middle, y, -outer);
      if (!middle.empty()) span.join(middle.lo, middle.hi);
    }
    if (a_done) after_a.meet(span, y, 0);
    if (span.empty()) continue;
    const double hole2 = later ? cover.inner2() - (y - by) * (y - by) : a_done ? cover.inner2() - y * y : -1;
    if (hole2 > 0) {
      const double w = std::sqrt(hole2), middle = later ? bx : 0;
      if (span.lo < middle - w) cut_row(j, y, span.lo, std::min(span.hi, middle - w));
      if (span.hi > middle + w) cut_row(j, y, std::max(span.lo, middle + w), span.hi);
    } else {
      cut_row(j, y, span.lo, span.hi);
    }
  }
  cut_cells();
  removed += sum(removed_in_row);
  return removed_before + removed * cell_ * cell_ / kLayers;
}

namespace {
/// look_ahead in the heights alone.
void look_at_heights(const Stock& stock, const Vec3& tip, double radius, const Eigen::Vector2d& feed, double ahead,
                     EngagementProfile& profile, double height) {
  constexpr int kBins = EngagementProfile::kBins;
  profile.max_depth = 0;
  profile.any = false;
  std::fill(profile.depth, profile.depth + kBins, 0.0f);
  const double cell = stock.cell(), z = std::max(tip.z(), stock.bottom());
  if (!tip.allFinite() || !(radius > 0) || !(stock.top() > z) || !(ahead > 0) || !(feed.squaredNorm() > 0.5)) return;

  // Heights are kept as floats: what differs by their rounding is no material. Likewise a layer counts as met only if
  // it is met by more than rounding, so that what was cut on the same way is never met again.
  constexpr double kNothing = 1e-9;
  constexpr double kFloatRounding = 4 * std::numeric_limits<float>::epsilon();
  constexpr double kSlack = 1e-6;  // layers
  const double nothing = kNothing + kFloatRounding * std::max(std::abs(stock.top()), std::abs(z));

  const Cover cover(radius, cell);
  const double outer = std::sqrt(cover.outer2());
  const Eigen::Vector2d& f = feed;
  const double ax = f.x() * ahead, ay = f.y() * ahead;
  const double x0 = stock.x_min() + 0.5 * cell - tip.x(), y0 = stock.y_min() + 0.5 * cell - tip.y();
  const int columns = stock.columns(), rows = stock.rows();
  // Indices of cells, also beyond the grid, where there is nothing; the disc is known to reach the grid.
  if (ax + outer < x0 - cell || ax - outer > x0 + columns * cell || ay + outer < y0 - cell ||
      ay - outer > y0 + rows * cell) {
    return;
  }

  // What one cell adds to strip j is its share times the part of its width in the strip, G_j(v1) - G_j(v0) with
  // G_j(v) = clamp(v - j, 0, 1) and v counted in strips from the left. A term G_j(v) is 1 for j < floor(v) and a
  // fraction at floor(v): kept as `whole` (summed from the right at the end) and `part`. Each holds what is taken and
  // what is offered, the number of layers that the step would cut.
  Pair whole[kBins + 1]{}, part[kBins + 1]{};
  const double per_width = kBins / (2 * radius), half_width = 0.5 * cell * per_width;
  const Quad tip_z = all(static_cast<float>(z)), least = all(static_cast<float>(nothing)),
             most = all(static_cast<float>(height));
  Quad deepest{};
  const double inverse_cell = 1 / cell;
  const float* layers = stock.layers().data();
  const Stock::Due& due = stock.due();
  const double due_x = due.any ? due.x - tip.x() : 0, due_y = due.any ? due.y - tip.y() : 0;
  const double due2 = due.any ? due.inner2 : -1;

  // The cells that the step may take, with their layers; those beyond the grid are empty. v rises or falls along a
  // row, so the outermost cells of each run that hold material say in which strips there is any.
  constexpr int kMost = 1024;
  double x_of[kMost], y_of[kMost];
  const float* layers_of[kMost];
  int count = 0;
  Span material;
  const auto strip_at = [&](double x, double y) { return (radius - (f.x() * y - f.y() * x)) * per_width; };
  const auto stands = [&](const float* h) { return any((load(h) - tip_z > least) | (load(h + 4) - tip_z > least)); };
  // Only strips with material can have a depth. A strip without a cell may take the value of one that is a cell beside
  // it: what is looked at reaches twice as far.
  const int reach = static_cast<int>(std::ceil(2 * half_width));  // one cell, in strips
  int from_strip = 0, to_strip = kBins - 1;
  const auto look_at_cells = [&] {
    // The layers that are cut now and then, and the strips of the left and the right side, as number and share.
    std::int32_t now[kMost], then[kMost], left[kMost], right[kMost];
    double into_left[kMost], into_right[kMost];
    int which[kMost];
    for (int k = 0; k < count; k += 2) {
      const Pair x = load(x_of + k), y = load(y_of + k);
      // The tip itself is taken to have cut already; only what the step adds counts.
      truncated(now + k, cover.layers(x * x + y * y, kSlack));
      truncated(then + k, cover.layers((x - ax) * (x - ax) + (y - ay) * (y - ay), -kSlack));
      const Pair v = (radius - (f.x() * y - f.y() * x)) * per_width;  // u is to the left of the tip
      const Pair to_left = clamped(v + half_width, two(0), two(kBins));
      const Pair to_right = clamped(v - half_width, two(0), two(kBins));
      store(into_left + k, to_left - truncated(left + k, to_left));
      store(into_right + k, to_right - truncated(right + k, to_right));
    }
    int met = 0;
    for (int k = 0; k < count; ++k) {
      which[met] = k;
      met += static_cast<int>(then[k] > now[k]) & static_cast<int>(left[k] >= from_strip) &
             static_cast<int>(right[k] <= to_strip);
    }
    for (int m = 0; m < met; ++m) {
      const int k = which[m];
      double amount = 0;
      if (const float* h = layers_of[k]; h != nullptr) {
        Quad low = load(h), high = load(h + 4);
        const double x = x_of[k] - due_x, y = y_of[k] - due_y;
        if (x * x + y * y <= due2) {
          low = smaller(low, all(due.level));
          high = smaller(high, all(due.level));
        }
        const Mask* layers_met = kBetween.of[now[k]][then[k]];
        low -= tip_z;
        high -= tip_z;
        low = where((low > least) & layers_met[0], smaller(low, most));
        high = where((high > least) & layers_met[1], smaller(high, most));
        deepest = larger(deepest, larger(low, high));
        amount = sum(low + high);
      }
      const Pair both{amount, static_cast<double>(then[k] - now[k])};
      const std::int32_t i = left[k], j = right[k];
      whole[i] += both;
      part[i] += both * into_left[k];
      whole[j] -= both;
      part[j] -= both * into_right[k];
    }
    count = 0;
  };
  bool all_strips = false;  // where there are too many cells to be kept until their strips are known
  const auto add = [&](double x, double y, const float* h) {
    if (count == kMost) {
      all_strips = true;
      look_at_cells();
    }
    x_of[count] = x;
    y_of[count] = y;
    layers_of[count] = h;
    ++count;
  };
  const auto look_row = [&](int j, double y, double lo, double hi) {
    const int i0 = whole_above((lo - x0) * inverse_cell), i1 = whole_below((hi - x0) * inverse_cell);
    if (j < 0 || j >= rows || i0 < 0 || i1 >= columns) {
      for (int i = i0; i <= i1; ++i) {
        const bool in = j >= 0 && j < rows && i >= 0 && i < columns;
        const float* h = in ? stock.cell_layers(i, j) : nullptr;
        const double x = x0 + i * cell;
        add(x, y, h);
        if (in && stands(h)) material.join(strip_at(x, y), strip_at(x, y));
      }
      return;
    }
    const float* h = layers + static_cast<std::ptrdiff_t>(j) * columns * Stock::kLayers;
    int first = i1 + 1, last = -1;
    for (int i = i0; i <= i1; ++i) {
      const float* here = h + static_cast<std::ptrdiff_t>(i) * Stock::kLayers;
      add(x0 + i * cell, y, here);
      if (!stands(here)) continue;
      first = std::min(first, i);
      last = i;
    }
    if (last < 0) return;
    const double a = strip_at(x0 + first * cell, y), b = strip_at(x0 + last * cell, y);
    material.join(std::min(a, b), std::max(a, b));
  };
  const HalfPlane ahead_of_tip(f);
  const int j1 = whole_below((ay + outer - y0) * inverse_cell);
  for (int j = whole_above((ay - outer - y0) * inverse_cell); j <= j1; ++j) {
    const double y = y0 + j * cell;
    const double w2 = cover.outer2() - (y - ay) * (y - ay);
    if (!(w2 > 0)) continue;
    const double w = std::sqrt(w2);
    Span span{ax - w, ax + w};
    ahead_of_tip.meet(span, y, 0.5 * ahead);  // only there the step covers more than the tip does
    if (span.empty()) continue;
    const double hole2 = cover.inner2() - y * y;
    if (hole2 > 0) {
      const double h = std::sqrt(hole2);
      if (span.lo < -h) look_row(j, y, span.lo, std::min(span.hi, -h));
      if (span.hi > h) look_row(j, y, std::max(span.lo, h), span.hi);
    } else {
      look_row(j, y, span.lo, span.hi);
    }
  }
  if (!all_strips) {
    if (material.empty()) return;
    const auto strip = [](double v) { return static_cast<int>(std::clamp(v, 0.0, double{kBins - 1})); };
    from_strip = strip(material.lo - half_width - 2 * reach - 1);
    to_strip = strip(material.hi + half_width + 2 * reach + 1);
  }
  look_at_cells();
  const double max_depth = std::max({deepest[0], deepest[1], deepest[2], deepest[3]});
  if (!(max_depth > 0)) return;
  profile.any = true;
  profile.max_depth = max_depth;

  constexpr double kCovered = 1e-6;  // offered weight below which no cell speaks for a strip; one layer counts 1
  bool covered[kBins];
  Pair to_the_right = whole[kBins];
  bool all_covered = true;
  for (int j = kBins - 1; j >= from_strip; --j) {
    if (j <= to_strip) {
      const Pair here = to_the_right + part[j];
      covered[j] = here[1] > kCovered;
      all_covered = all_covered && covered[j];
      const double depth = covered[j] ? here[0] / here[1] : 0;
      profile.depth[j] = depth > nothing ? static_cast<float>(std::min(depth, max_depth)) : 0.0f;
    }
    to_the_right += whole[j];
  }
  if (all_covered) return;
  for (int j = from_strip; j <= to_strip; ++j) {
    if (covered[j]) continue;
    for (int step = 1; step <= reach; ++step) {
      if (j - step >= from_strip && covered[j - step]) {
        profile.depth[j] = profile.depth[j - step];
        break;
      }
      if (j + step <= to_strip && covered[j + step]) {
        profile.depth[j] = profile.depth[j + step];
        break;
      }
    }
  }
}
}  // namespace

void look_ahead(const Stock& stock, const Vec3& tip, double radius, const Eigen::Vector2d& feed, double ahead,
                EngagementProfile& profile, double height) {
  look_at_heights(stock, tip, radius, feed, ahead, profile, height);
  if (stock.hollow() == nullptr || !profile.any) return;
  EngagementProfile hollow;
  look_at_heights(*stock.hollow(), tip, radius, feed, ahead, hollow, height);
  constexpr float kRounding = 1e-8F;  // m: heights of a metre are kept to 6e-8, those of a part to 4e-9
  profile.any = false;
  for (int j = 0; j < EngagementProfile::kBins; ++j) {
    const float depth = profile.depth[j] - hollow.depth[j];
    profile.depth[j] = depth > kRounding ? depth : 0;
    profile.any = profile.any || depth > kRounding;
  }
  if (!profile.any) profile.max_depth = 0;
}

std::vector<DiscEngagement> by_disc(const EngagementProfile& profile, double dz) {
  std::vector<DiscEngagement> discs;
  if (!profile.any || !(profile.max_depth > 0) || !(dz > 0)) return discs;
  constexpr int kBins = EngagementProfile::kBins;
  constexpr int kMaxDiscs = 100'000;
  const int count = static_cast<int>(std::clamp(std::round(profile.max_depth / dz), 1.0, double{kMaxDiscs}));  // (5.12)
  const double thickness = profile.max_depth / count;
  discs.resize(count);
  const auto angle = [](int strip) { return std::acos(1 - 2.0 * strip / kBins); };
  for (int k = 0; k < count; ++k) {
    discs[k].z = (k + 0.5) * thickness;
    for (int j = 0; j < kBins; ++j) {
      if (!(profile.depth[j] >= discs[k].z)) continue;
      const int first = j;
      while (j < kBins && profile.depth[j] >= discs[k].z) ++j;
      discs[k].spans.push_back({angle(first), angle(j), thickness});
    }
  }
  return discs;
}

ForceHistory force_history(const Cutter& cutter, const Material& material, const std::vector<DiscEngagement>& discs,
                           double feed_per_tooth, int steps) {
  ForceHistory history = start_history(steps);
  for (const DiscEngagement& disc : discs) {
    for (const Engagement& span : disc.spans) {
      add_disc(cutter, material, span.entry, span.exit, disc.z, span.depth, feed_per_tooth, history);
    }
  }
  finish_history(history);
  return history;
}

ProfileForce::ProfileForce(const Cutter& cutter, const Material& material) : exponent_(material.exponent) {
  constexpr int kBins = EngagementProfile::kBins;
  edge_.resize(kBins);
  cut_.resize(kBins);
  const double per_turn = cutter.teeth / (2 * std::numbers::pi);
  for (int j = 0; j < kBins; ++j) {
    const SpanIntegral span =
        integrate_span(material, std::acos(1 - 2.0 * j / kBins), std::acos(1 - 2.0 * (j + 1) / kBins));
    edge_[j] = per_turn * span.edge;
    cut_[j] = per_turn * span.cut;
  }
}

Vec3 ProfileForce::mean_force(const EngagementProfile& profile, double feed_per_tooth, Spindle spindle) const {
  constexpr int kBins = EngagementProfile::kBins;
  if (!profile.any) return Vec3::Zero();
  const double chip = exponent_ == 1 ? feed_per_tooth : std::pow(std::max(0.0, feed_per_tooth), exponent_);
  Vec3 edge = Vec3::Zero(), cut = Vec3::Zero();
  const bool mirrored = spindle == Spindle::counterclockwise;
  for (int j = 0; j < kBins; ++j) {
    const double depth = profile.depth[mirrored ? kBins - 1 - j : j];
    if (depth == 0) continue;
    edge += depth * edge_[j];
    cut += depth * cut_[j];
  }
  Vec3 force = edge + chip * cut;
  if (mirrored) force.y() = -force.y();
  return force;
}

}  // namespace polypod::cutting
