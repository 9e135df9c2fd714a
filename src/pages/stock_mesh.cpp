// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "stock_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "polypod/core/units.hpp"
#include "polypod/cutting/rounded.hpp"

namespace polypod::pages {

namespace {

/// The squares of a coarse picture of a stock: the cells whose heights they show.
class Squares {
 public:
  Squares(const cutting::Stock& stock, int cells)
      : stock_(stock), step_(std::max(1, (std::max(stock.columns(), stock.rows()) + cells - 1) / cells)) {}
  [[nodiscard]] int columns() const { return (stock_.columns() + step_ - 1) / step_; }
  [[nodiscard]] int rows() const { return (stock_.rows() + step_ - 1) / step_; }
  [[nodiscard]] int column(int i) const { return middle(i, stock_.columns()); }
  [[nodiscard]] int row(int j) const { return middle(j, stock_.rows()); }
  [[nodiscard]] double x(int i) const { return stock_.x_min() + (column(i) + 0.5) * stock_.cell(); }
  [[nodiscard]] double y(int j) const { return stock_.y_min() + (row(j) + 0.5) * stock_.cell(); }
  [[nodiscard]] double side() const { return step_ * stock_.cell(); }
  /// The height of a square, the bottom where it is empty.
  [[nodiscard]] double height(const cutting::Stock& of, int i, int j) const {
    const double h = of.height(column(i), row(j));
    return std::isfinite(h) ? h : stock_.bottom();
  }
  /// Of the mesh, which has a ring of points round the squares.
  [[nodiscard]] int point(int i, int j) const { return (j + 1) * (columns() + 2) + i + 1; }

 private:
  [[nodiscard]] int middle(int k, int count) const { return std::min(k * step_ + step_ / 2, count - 1); }
  const cutting::Stock& stock_;
  int step_;
};

}  // namespace

report::Mesh stock_mesh(const cutting::Stock& stock, const Pose& X_MW, int cells, const std::string& name) {
  report::Mesh out;
  out.name = name;
  if (stock.columns() <= 0 || stock.rows() <= 0) return out;
  const Squares squares(stock, cells);
  const double bottom = stock.bottom();
  const Vec3 low = stock.min(), high = stock.max();
  // A ring of points at the bottom goes round, so that the sides are walls.
  const int wide = squares.columns() + 2, tall = squares.rows() + 2;
  std::vector<double> z(static_cast<std::size_t>(wide) * static_cast<std::size_t>(tall), bottom);
  const auto at = [&](int i, int j) {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(wide) + static_cast<std::size_t>(i);
  };
  for (int j = 0; j < tall; ++j) {
    for (int i = 0; i < wide; ++i) {
      const bool ring = i == 0 || j == 0 || i + 1 == wide || j + 1 == tall;
      const double x = i == 0 ? low.x() : i + 1 == wide ? high.x() : squares.x(i - 1);
      const double y = j == 0 ? low.y() : j + 1 == tall ? high.y() : squares.y(j - 1);
      if (!ring) z[at(i, j)] = squares.height(stock, i - 1, j - 1);
      const Vec3 p = X_MW * Vec3(x, y, z[at(i, j)]) * units::kMmPerMetre;
      out.points.push_back({p.x(), p.y(), p.z()});
    }
  }
  for (int j = 0; j + 1 < tall; ++j) {
    for (int i = 0; i + 1 < wide; ++i) {
      const std::size_t a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
      if (std::max({z[a], z[b], z[c], z[d]}) <= bottom) continue;
      out.triangles.push_back({static_cast<int>(a), static_cast<int>(b), static_cast<int>(c)});
      out.triangles.push_back({static_cast<int>(a), static_cast<int>(c), static_cast<int>(d)});
    }
  }
  out.kind.assign(out.points.size(), 0);
  return out;
}

report::Mesh growing_cut(const cutting::Stock& before, const cutting::Stock& after, const Pose& X_MW, int cells,
                         const std::string& name, const std::vector<OnTheWay>& way, std::size_t most) {
  report::Mesh out = stock_mesh(before, X_MW, cells, name);
  if (out.points.empty() || after.columns() != before.columns() || after.rows() != before.rows() || way.empty())
    return out;
  const Squares squares(before, cells);
  const int columns = squares.columns(), rows = squares.rows();
  struct Lowered {
    double at, z;
  };
  std::vector<std::vector<Lowered>> lowered(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  const auto of = [&](int i, int j) {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(i);
  };
  std::vector<double> z(lowered.size());
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) z[of(i, j)] = squares.height(before, i, j);
  const auto under = [&](const Vec3& tip, const OnTheWay& place) {
    const double R = place.cutter->radius();
    const auto range = [&](double low, double first, int count) {
      const auto index = [&](double v) { return std::clamp((v - first) / squares.side(), 0.0, count - 1.0); };
      return std::pair{static_cast<int>(index(low - R)), static_cast<int>(std::ceil(index(low + R)))};
    };
    const auto [i0, i1] = range(tip.x(), squares.x(0), columns);
    const auto [j0, j1] = range(tip.y(), squares.y(0), rows);
    for (int j = j0; j <= j1; ++j) {
      for (int i = i0; i <= i1; ++i) {
        const double edge =
            tip.z() + cutting::edge_height(*place.cutter, std::hypot(squares.x(i) - tip.x(), squares.y(j) - tip.y()));
        double& height = z[of(i, j)];
        if (!(edge < height)) continue;
        height = std::max(edge, before.bottom());
        std::vector<Lowered>& all = lowered[of(i, j)];
        if (all.empty() || all.back().at < place.at) all.push_back({place.at, height});
        all.back().z = height;
      }
    }
  };
  for (std::size_t k = 0; k < way.size(); ++k) {
    const Vec3& to = way[k].tip_W;
    const Vec3 from = way[k].joined && k > 0 ? way[k - 1].tip_W : to;
    const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / squares.side())));
    for (int s = 1; s <= steps; ++s) under(from + (to - from) * s / steps, way[k]);
  }
  struct Entry {
    double at;
    int point;
    double by;
  };
  std::vector<Entry> entries;
  std::size_t count = 0;
  for (const auto& all : lowered) count += all.size();
  const std::size_t every = 1 + count / std::max<std::size_t>(1, most);  // of neighbouring places the last is kept
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      std::vector<Lowered>& all = lowered[of(i, j)];
      const double start = squares.height(before, i, j), end = squares.height(after, i, j);
      if (all.empty() && end != start) all.push_back({way.back().at, end});
      for (std::size_t k = 0; k < all.size(); ++k) {
        const bool last = k + 1 == all.size();
        if (!last && (all.size() - 1 - k) % every != 0) continue;
        entries.push_back({all[k].at, squares.point(i, j), units::to_mm((last ? end : all[k].z) - start)});
      }
    }
  }
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.at < b.at; });
  const Vec3 up = X_MW.R.col(2);
  out.shifts.along = {up.x(), up.y(), up.z()};
  for (const Entry& e : entries) {
    out.shifts.at.push_back(e.at);
    out.shifts.point.push_back(e.point);
    out.shifts.by.push_back(e.by);
  }
  return out;
}

}  // namespace polypod::pages
