// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "stock_mesh.hpp"

#include <algorithm>
#include <cmath>

#include "polypod/core/units.hpp"

namespace polypod::pages {

report::Mesh stock_mesh(const cutting::Stock& stock, const Pose& X_MW, int cells, const std::string& name) {
  report::Mesh out;
  out.name = name;
  if (stock.columns() <= 0 || stock.rows() <= 0) return out;
  const int step = std::max(1, (std::max(stock.columns(), stock.rows()) + cells - 1) / cells);
  const int columns = (stock.columns() + step - 1) / step, rows = (stock.rows() + step - 1) / step;
  const double bottom = stock.bottom();
  const Vec3 low = stock.min(), high = stock.max();
  // A ring of points at the bottom goes round, so that the sides are walls.
  const int wide = columns + 2, tall = rows + 2;
  std::vector<double> z(static_cast<std::size_t>(wide) * static_cast<std::size_t>(tall), bottom);
  const auto at = [&](int i, int j) {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(wide) + static_cast<std::size_t>(i);
  };
  const auto middle = [&](int k, int count) { return std::min(k * step + step / 2, count - 1); };
  for (int j = 0; j < tall; ++j) {
    for (int i = 0; i < wide; ++i) {
      const bool ring = i == 0 || j == 0 || i + 1 == wide || j + 1 == tall;
      const double x = i == 0          ? low.x()
                       : i + 1 == wide ? high.x()
                                       : low.x() + (middle(i - 1, stock.columns()) + 0.5) * stock.cell();
      const double y = j == 0          ? low.y()
                       : j + 1 == tall ? high.y()
                                       : low.y() + (middle(j - 1, stock.rows()) + 0.5) * stock.cell();
      if (!ring) {
        const double h = stock.height(middle(i - 1, stock.columns()), middle(j - 1, stock.rows()));
        if (std::isfinite(h)) z[at(i, j)] = h;
      }
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

}  // namespace polypod::pages
