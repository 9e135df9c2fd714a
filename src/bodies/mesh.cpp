// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <set>
#include <string_view>

#include "polypod/bodies/shape.hpp"
#include "polypod/bodies/stl.hpp"
#include "polypod/core/files.hpp"

namespace polypod::bodies {
namespace {

constexpr int kLeaf = 4;
constexpr std::size_t kHead = 84, kTriangle = 50;

int build(Mesh& mesh, int first, int count) {
  const int index = static_cast<int>(mesh.nodes.size());
  mesh.nodes.emplace_back();
  Vec3 low = Vec3::Constant(1e300), high = -low;
  const auto corners = [&](int i, auto&& each) {
    for (const int c : mesh.triangles[static_cast<std::size_t>(mesh.order[static_cast<std::size_t>(i)])]) {
      each(mesh.points[static_cast<std::size_t>(c)]);
    }
  };
  for (int i = first; i < first + count; ++i) {
    corners(i, [&](const Vec3& p) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    });
  }
  Mesh::Node node;
  node.centre = 0.5 * (low + high);
  for (int i = first; i < first + count; ++i) {
    corners(i, [&](const Vec3& p) { node.radius = std::max(node.radius, (p - node.centre).norm()); });
  }
  node.radius *= 1 + 1e-12;
  node.first = first;
  node.count = count;
  if (count > kLeaf) {
    int axis = 0;
    (high - low).maxCoeff(&axis);
    const auto middle = [&](int t) {
      double sum = 0;
      for (const int c : mesh.triangles[static_cast<std::size_t>(t)]) {
        sum += mesh.points[static_cast<std::size_t>(c)][axis];
      }
      return sum;
    };
    const auto begin = mesh.order.begin() + first;
    std::nth_element(begin, begin + count / 2, begin + count, [&](int a, int b) { return middle(a) < middle(b); });
    node.left = build(mesh, first, count / 2);
    node.right = build(mesh, first + count / 2, count - count / 2);
  }
  mesh.nodes[static_cast<std::size_t>(index)] = node;
  return index;
}

/// A point of each part of the surface whose triangles hang together.
std::vector<int> parts_of(const Mesh& mesh) {
  std::vector<int> root(mesh.points.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](int i) {
    while (root[static_cast<std::size_t>(i)] != i) {
      int& up = root[static_cast<std::size_t>(i)];
      up = root[static_cast<std::size_t>(up)];
      i = up;
    }
    return i;
  };
  for (const auto& t : mesh.triangles) {
    root[static_cast<std::size_t>(find(t[1]))] = find(t[0]);
    root[static_cast<std::size_t>(find(t[2]))] = find(t[0]);
  }
  std::set<int> out;
  for (const auto& t : mesh.triangles) out.insert(find(t[0]));
  return {out.begin(), out.end()};
}

/// Corners three by three, joined where they are equal.
class Corners {
 public:
  void add(const Vec3& p) {
    corner_[count_++] = index_of(p + Vec3::Zero());  // -0 and 0 are one corner
    if (count_ < 3) return;
    count_ = 0;
    const auto& [a, b, c] = corner_;
    if (a != b && b != c && c != a) {
      out.triangles.push_back(corner_);
    } else {
      ++out.degenerate;
    }
  }
  [[nodiscard]] bool whole() const { return count_ == 0; }
  Triangles out;

 private:
  int index_of(const Vec3& p) {
    if (2 * out.points.size() >= slots_.size()) grow();
    std::int32_t& slot = slots_[slot_of(p)];
    if (slot < 0) {
      slot = static_cast<std::int32_t>(out.points.size());
      out.points.push_back(p);
    }
    return slot;
  }
  /// Where the point is, or a free slot for it.
  [[nodiscard]] std::size_t slot_of(const Vec3& p) const {
    std::uint64_t hash = 0;
    for (int k = 0; k < 3; ++k) {
      constexpr std::uint64_t kOdd = 0x9E3779B97F4A7C15U;
      hash = (hash ^ std::bit_cast<std::uint64_t>(p[k])) * kOdd;
      hash ^= hash >> 29U;
    }
    std::size_t at = hash & (slots_.size() - 1);
    while (slots_[at] >= 0 && out.points[static_cast<std::size_t>(slots_[at])] != p)
      at = (at + 1) & (slots_.size() - 1);
    return at;
  }
  void grow() {
    slots_.assign(std::max<std::size_t>(64, 4 * out.points.size()), -1);
    slots_.resize(std::bit_ceil(slots_.size()), -1);
    for (std::size_t i = 0; i < out.points.size(); ++i) slots_[slot_of(out.points[i])] = static_cast<std::int32_t>(i);
  }
  std::array<int, 3> corner_{};
  std::size_t count_ = 0;
  std::vector<std::int32_t> slots_;  // of a table of hashes: the index of a point, -1 free
};

/// The words of a text, one by one; empty at its end.
class Words {
 public:
  explicit Words(std::string_view text) : rest_(text) {}
  std::string_view next() {
    constexpr std::string_view kSpace = " \t\r\n\v\f";
    rest_.remove_prefix(std::min(rest_.find_first_not_of(kSpace), rest_.size()));
    const std::string_view word = rest_.substr(0, rest_.find_first_of(kSpace));
    rest_.remove_prefix(word.size());
    return word;
  }
  bool next(double& value) {
    std::string_view word = next();
    if (word.starts_with('+')) word.remove_prefix(1);
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    return error == std::errc() && end == word.data() + word.size() && std::isfinite(value);
  }

 private:
  std::string_view rest_;
};

}  // namespace

std::size_t open_edges(const std::vector<std::array<int, 3>>& triangles) {
  std::vector<std::uint64_t> edges;
  edges.reserve(3 * triangles.size());
  const auto edge = [](int a, int b) {
    return std::uint64_t(static_cast<std::uint32_t>(a)) << 32U | static_cast<std::uint32_t>(b);
  };
  for (const auto& t : triangles)
    for (std::size_t k = 0; k < 3; ++k) edges.push_back(edge(t[k], t[(k + 1) % 3]));
  std::sort(edges.begin(), edges.end());
  const auto count = [&](std::uint64_t wanted) {
    const auto [first, last] = std::equal_range(edges.begin(), edges.end(), wanted);
    return last - first;
  };
  std::size_t open = 0;
  for (auto at = edges.begin(); at != edges.end();) {
    const auto end = std::upper_bound(at, edges.end(), *at);
    if (count(*at << 32U | *at >> 32U) != end - at) ++open;
    at = end;
  }
  return open;
}

Result<std::shared_ptr<const Mesh>> mesh_of(std::vector<Vec3> points, std::vector<std::array<int, 3>> triangles,
                                            const std::string& name) {
  if (triangles.empty()) return fail("BO110", fmt::format("{}: the mesh has no triangles", name));
  const std::size_t open = open_edges(triangles);
  if (open > 0) {
    return fail(
        "BO111",
        fmt::format("{}: the mesh is not closed: {} of its edges have no triangle on the other side", name, open), {},
        "mend it in the CAD system (export a solid): what is inside of an open surface is not known");
  }
  Mesh mesh;
  mesh.points = std::move(points);
  mesh.triangles = std::move(triangles);
  mesh.order.resize(mesh.triangles.size());
  std::iota(mesh.order.begin(), mesh.order.end(), 0);
  build(mesh, 0, static_cast<int>(mesh.order.size()));
  mesh.parts = parts_of(mesh);
  return std::make_shared<const Mesh>(std::move(mesh));
}

Result<Triangles> triangles_of_stl(std::string_view bytes, const std::string& path) {
  const auto bad = [&](const std::string& why) {
    return fail("BO112", fmt::format("{}: no STL file that can be read: {}", path, why), {},
                "export the solid as binary STL");
  };
  Corners corners;
  std::uint32_t count = 0;
  if (bytes.size() >= kHead) std::memcpy(&count, bytes.data() + 80, sizeof count);
  if (bytes.size() >= kHead && bytes.size() == kHead + kTriangle * std::size_t{count}) {
    corners.out.triangles.reserve(count);
    for (std::size_t t = 0; t < count; ++t) {
      std::array<float, 9> f{};
      std::memcpy(f.data(), bytes.data() + kHead + t * kTriangle + 12, sizeof f);
      for (std::size_t k = 0; k < 9; k += 3) {
        const Vec3 p(f[k], f[k + 1], f[k + 2]);
        if (!p.allFinite()) return bad(fmt::format("triangle {} has a corner that is not finite", t + 1));
        corners.add(p);
      }
    }
  } else if (bytes.starts_with("solid")) {
    // A name may hold any word.
    Words words(bytes.substr(std::min({bytes.find("facet"), bytes.find("endsolid"), bytes.size()})));
    bool ended = false;
    for (std::string_view word = words.next(); !word.empty(); word = words.next()) {
      ended = ended || word == "endsolid";
      if (word != "vertex") continue;
      Vec3 p;
      if (!words.next(p.x()) || !words.next(p.y()) || !words.next(p.z())) return bad("a vertex without three numbers");
      corners.add(p);
    }
    if (!ended || !corners.whole()) return bad("it is cut short");
  } else {
    return bad(bytes.size() >= kHead ? fmt::format("{} triangles do not fit into {} bytes", count, bytes.size())
                                     : "neither text nor binary");
  }
  return std::move(corners.out);
}

Result<std::shared_ptr<const Mesh>> read_stl(const std::string& path, double unit) {
  POLYPOD_ASSIGN(bytes, files::read(path));
  POLYPOD_ASSIGN(read, triangles_of_stl(bytes, path));
  for (Vec3& p : read.points) p *= unit;
  return mesh_of(std::move(read.points), std::move(read.triangles), path);
}

}  // namespace polypod::bodies
