// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/surface.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "margin.hpp"

namespace polypod::workspace {
namespace {

using Triangle = std::array<int, 3>;

/// The edges of the six tetrahedra of a cube go from its corner a (bits x, y, z) to a + d with more bits set; an edge
/// of the grid is therefore named by its lower point and d = 1 .. 7.
struct Lattice {
  const Grid& grid;
  std::vector<char> inside;

  template <class Inside>
  Lattice(const Grid& over, const Inside& is_inside) : grid(over), inside(over.size(), 0) {
    const auto [nx, ny, nz] = grid.points;
    for (int k = 1; k + 1 < nz; ++k)
      for (int j = 1; j + 1 < ny; ++j)
        for (int i = 1; i + 1 < nx; ++i) {
          const std::size_t at = grid.index(i, j, k);
          inside[at] = is_inside(at) ? 1 : 0;
        }
  }
  [[nodiscard]] std::size_t shift(unsigned bits) const {
    return grid.index(static_cast<int>(bits & 1U), static_cast<int>(bits >> 1 & 1U), static_cast<int>(bits >> 2 & 1U));
  }
};

constexpr unsigned kTetrahedra[6][4] = {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7},
                                        {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}};

Vec3 corner_of(unsigned bits) {
  return {double(bits & 1U), double(bits >> 1 & 1U), double(bits >> 2 & 1U)};
}

/// The triangles that separate the corners of a tetrahedron, as pairs (inside, outside) of cube corners, outward.
using Crossing = std::pair<unsigned, unsigned>;
std::vector<std::array<Crossing, 3>> separate(const unsigned (&tetrahedron)[4], unsigned cube_inside) {
  std::vector<unsigned> in, out;
  for (const unsigned c : tetrahedron) ((cube_inside >> c & 1U) != 0 ? in : out).push_back(c);
  std::vector<std::array<Crossing, 3>> triangles;
  if (in.empty() || out.empty()) return triangles;
  if (in.size() == 1) {
    triangles.push_back({Crossing{in[0], out[0]}, Crossing{in[0], out[1]}, Crossing{in[0], out[2]}});
  } else if (in.size() == 3) {
    triangles.push_back({Crossing{in[0], out[0]}, Crossing{in[1], out[0]}, Crossing{in[2], out[0]}});
  } else {
    const Crossing a{in[0], out[0]}, b{in[0], out[1]}, c{in[1], out[1]}, d{in[1], out[0]};
    triangles.push_back({a, b, c});
    triangles.push_back({a, c, d});
  }
  Vec3 outward = Vec3::Zero();
  for (const unsigned c : out) outward += corner_of(c) / static_cast<double>(out.size());
  for (const unsigned c : in) outward -= corner_of(c) / static_cast<double>(in.size());
  for (auto& t : triangles) {
    const auto middle = [](const Crossing& x) { return Vec3(0.5 * (corner_of(x.first) + corner_of(x.second))); };
    const Vec3 a = middle(t[0]);
    if ((middle(t[1]) - a).cross(middle(t[2]) - a).dot(outward) < 0) std::swap(t[1], t[2]);
  }
  return triangles;
}

/// The edges of the grid that the border crosses, one point each.
struct Edges {
  std::vector<std::array<std::size_t, 2>> list;  ///< the end inside, the end beyond
  std::vector<int> point_of;                     ///< of edge d = 1 .. 7 from a point: 7 point + d - 1; -1: not crossed

  explicit Edges(const Lattice& lattice) : point_of(7 * lattice.grid.size(), -1) {
    const auto [nx, ny, nz] = lattice.grid.points;
    for (int k = 0; k + 1 < nz; ++k)
      for (int j = 0; j + 1 < ny; ++j)
        for (int i = 0; i + 1 < nx; ++i) {
          const std::size_t a = lattice.grid.index(i, j, k);
          for (unsigned d = 1; d < 8; ++d) {
            const std::size_t b = a + lattice.shift(d);
            if (lattice.inside[a] == lattice.inside[b]) continue;
            point_of[7 * a + d - 1] = static_cast<int>(list.size());
            list.push_back(lattice.inside[a] != 0 ? std::array{a, b} : std::array{b, a});
          }
        }
  }
};

/// The point at share t of an edge, off its ends, so that the points of different edges never coincide.
Vec3 between(const Vec3& p, const Vec3& q, double t) {
  constexpr double kOffEnd = 1e-3;
  return p + std::clamp(t, kOffEnd, 1 - kOffEnd) * (q - p);
}

Vec3 normal_of(const std::vector<Vec3>& points, const Triangle& t) {
  return (points[static_cast<std::size_t>(t[1])] - points[static_cast<std::size_t>(t[0])])
      .cross(points[static_cast<std::size_t>(t[2])] - points[static_cast<std::size_t>(t[0])]);
}

/// Takes short edges out of a closed surface by moving one end onto the other, where that keeps the surface a closed
/// manifold (the two ends have no common neighbours but the two opposite corners) and turns no triangle away from the
/// normals of its corners.
class Collapse {
 public:
  Collapse(Surface& s, double shortest) : s_(s), shortest_(shortest) {
    of_.resize(s.points.size());
    normal_.assign(s.points.size(), Vec3::Zero());
    for (std::size_t t = 0; t < s.triangles.size(); ++t) {
      const Vec3 n = normal_of(s.points, s.triangles[t]);
      for (const int v : s.triangles[t]) {
        of_[index(v)].push_back(static_cast<int>(t));
        normal_[index(v)] += n;
      }
    }
    for (Vec3& n : normal_) n.normalize();
  }

  void run() {
    constexpr int kPasses = 8;
    for (int pass = 1; pass <= kPasses; ++pass) {
      // The shortest first, by passes with a growing bound: what is nearly one point goes before what is merely short.
      const double bound = shortest_ * pass / kPasses;
      for (int u = 0; u < static_cast<int>(s_.points.size()); ++u) {
        if (of_[index(u)].empty()) continue;
        const std::vector<int> around = neighbours(u);
        for (const int v : around) {
          if ((s_.points[index(u)] - s_.points[index(v)]).norm() < bound && merge(u, v)) break;
        }
      }
    }
    compact();
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  [[nodiscard]] std::vector<int> neighbours(int v) const {
    std::vector<int> out;
    for (const int t : of_[index(v)])
      for (const int w : s_.triangles[index(t)])
        if (w != v) out.push_back(w);
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
  }

  /// Moves u onto v.
  bool merge(int u, int v) {
    const std::vector<int> at_u = neighbours(u), at_v = neighbours(v);
    std::vector<int> common;
    std::set_intersection(at_u.begin(), at_u.end(), at_v.begin(), at_v.end(), std::back_inserter(common));
    if (common.size() != 2) return false;
    for (const int w : common)
      if (of_[index(w)].size() <= 3) return false;  // its two last triangles would fall together
    constexpr double kSameWay = 0.6;                // cosine: 53 deg
    constexpr double kThin = 0.02;                  // of the square of the longest side: no new slivers
    for (const int t : of_[index(u)]) {
      Triangle moved = s_.triangles[index(t)];
      if (std::find(moved.begin(), moved.end(), v) != moved.end()) continue;
      const Vec3 before = normal_of(s_.points, moved);
      std::replace(moved.begin(), moved.end(), u, v);
      const Vec3 n = normal_of(s_.points, moved);
      double longest = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        longest = std::max(longest, (s_.points[index(moved[k])] - s_.points[index(moved[(k + 1) % 3])]).squaredNorm());
      }
      const double size = n.norm();
      if (size < kThin * longest && size < before.norm()) return false;
      for (const int w : moved)
        if (n.dot(normal_[index(w)]) < kSameWay * size) return false;
      if (n.dot(normal_[index(u)]) < kSameWay * size) return false;
    }
    const std::vector<int> moved_along = std::move(of_[index(u)]);
    of_[index(u)].clear();
    for (const int t : moved_along) {
      Triangle& triangle = s_.triangles[index(t)];
      if (std::find(triangle.begin(), triangle.end(), v) != triangle.end()) {
        for (const int w : triangle)
          if (w != u) std::erase(of_[index(w)], t);
        triangle = {-1, -1, -1};
      } else {
        std::replace(triangle.begin(), triangle.end(), u, v);
        of_[index(v)].push_back(t);
      }
    }
    return true;
  }

  void compact() {
    std::vector<int> renamed(s_.points.size(), -1);
    Surface out;
    for (std::size_t v = 0; v < s_.points.size(); ++v) {
      if (of_[v].empty()) continue;
      renamed[v] = static_cast<int>(out.points.size());
      out.points.push_back(s_.points[v]);
      out.limit.push_back(s_.limit[v]);
    }
    for (const Triangle& t : s_.triangles)
      if (t[0] >= 0) out.triangles.push_back({renamed[index(t[0])], renamed[index(t[1])], renamed[index(t[2])]});
    s_ = std::move(out);
  }

  Surface& s_;
  double shortest_;
  std::vector<std::vector<int>> of_;  ///< triangles of a point
  std::vector<Vec3> normal_;
};

/// The triangles over the points of `edges`, which `out` has, without short sides.
void close(Surface& out, const Lattice& lattice, const Edges& edges) {
  const auto [nx, ny, nz] = lattice.grid.points;
  for (int k = 0; k + 1 < nz; ++k)
    for (int j = 0; j + 1 < ny; ++j)
      for (int i = 0; i + 1 < nx; ++i) {
        const std::size_t at = lattice.grid.index(i, j, k);
        unsigned cube = 0;
        for (unsigned c = 0; c < 8; ++c) cube |= static_cast<unsigned>(lattice.inside[at + lattice.shift(c)]) << c;
        if (cube == 0 || cube == 255) continue;
        for (const auto& tetrahedron : kTetrahedra)
          for (const auto& t : separate(tetrahedron, cube)) {
            Triangle triangle{};
            for (std::size_t v = 0; v < 3; ++v) {
              const unsigned low = std::min(t[v].first, t[v].second), high = std::max(t[v].first, t[v].second);
              triangle[v] = edges.point_of[7 * (at + lattice.shift(low)) + (high - low) - 1];
            }
            out.triangles.push_back(triangle);
          }
      }
  constexpr double kShortest = 0.6;  // of the spacing: leaves about a third of the triangles, and none that is a needle
  Collapse(out, kShortest * lattice.grid.step[0].norm()).run();
}

}  // namespace

double Surface::volume() const {
  if (points.empty()) return 0;
  double six = 0;
  const Vec3 o = points.front();
  for (const Triangle& t : triangles) {
    const auto p = [&](std::size_t k) { return Vec3(points[static_cast<std::size_t>(t[k])] - o); };
    six += p(0).dot(p(1).cross(p(2)));
  }
  return six / 6;
}

double Surface::area() const {
  double twice = 0;
  for (const Triangle& t : triangles) twice += normal_of(points, t).norm();
  return 0.5 * twice;
}

Result<Surface> surface_of(const AnyMachine& machine, const Options& options, const Field& f,
                           const SurfaceOptions& surface_options, const Part* part) {
  FieldOptions field_options;
  field_options.azimuths = surface_options.azimuths;
  POLYPOD_ASSIGN(judge, judge_of(machine, options, field_options));
  const auto [nx, ny, nz] = f.grid.points;
  if (nx < 3 || ny < 3 || nz < 3 || f.margin.size() != f.grid.size()) {
    return fail("WS130", "a surface needs a field over a grid of at least 3 points in each direction");
  }
  const Lattice lattice(
      f.grid, [&](std::size_t at) { return f.margin[at] >= 0 && (part == nullptr || part->inside[at] != 0); });
  const Edges edges(lattice);
  if (edges.list.empty()) {
    return fail("WS131", "no point of the grid is reachable from all required directions: there is no surface", {},
                "raise the resolution, or ask for less tilt");
  }
  Surface out;
  out.points.resize(edges.list.size());
  out.limit.resize(edges.list.size());
  POLYPOD_TRY(in_rounds(
      options, edges.list.size(),
      [&](std::size_t e) {
        const auto [in, beyond] = edges.list[e];
        const Vec3 p = f.grid.at(in), q = f.grid.at(beyond);
        Margin last{f.margin[beyond], f.limit[beyond]};
        double t = 1;  // beyond lies on the grid's own border
        if (f.margin[beyond] >= 0 && part != nullptr) {
          t = part->share(in, beyond);
        } else if (f.margin[beyond] < 0) {
          t = border_between(
              [&](double share) {
                const Margin m = judge->margin(p + share * (q - p));
                if (m.value < 0) last = m;
                return m.value;
              },
              f.margin[in], f.margin[beyond]);
        }
        out.points[e] = between(p, q, t);
        out.limit[e] = last.limit;
      },
      surface_options.progress));
  close(out, lattice, edges);
  return out;
}

Result<Surface> surface(const AnyMachine& machine, const Options& options, const SurfaceOptions& surface_options) {
  POLYPOD_ASSIGN(box, extent(machine, options, false));
  if (box.empty()) {
    return fail("WS131", "no point is reachable from all required directions: there is no surface", {},
                "ask for less tilt");
  }
  POLYPOD_ASSIGN(grid, grid_over(box.low, box.high, surface_options.resolution));
  FieldOptions field_options;
  field_options.azimuths = surface_options.azimuths;
  field_options.tilt = false;
  const auto share = [&](double from, double to) {
    return [&, from, to](double done) {
      if (surface_options.progress) surface_options.progress(from + done * (to - from));
    };
  };
  field_options.progress = share(0, 0.6);
  POLYPOD_ASSIGN(values, field(machine, options, grid, field_options));
  SurfaceOptions of_field = surface_options;
  of_field.progress = share(0.6, 1);
  return surface_of(machine, options, values, of_field);
}

}  // namespace polypod::workspace
