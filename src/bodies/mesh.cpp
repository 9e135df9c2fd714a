// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <map>
#include <numeric>
#include <set>
#include <sstream>

#include "polypod/bodies/shape.hpp"
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
struct Corners {
  std::vector<Vec3> points;
  std::vector<std::array<int, 3>> triangles;
  std::map<std::array<double, 3>, int> known;
  std::vector<int> pending;

  void add(const Vec3& p) {
    // + 0.0: -0 and 0 are one corner.
    const auto [it, is_new] =
        known.emplace(std::array<double, 3>{p.x() + 0.0, p.y() + 0.0, p.z() + 0.0}, static_cast<int>(points.size()));
    if (is_new) points.push_back(p);
    pending.push_back(it->second);
    if (pending.size() < 3) return;
    const std::array<int, 3> t{pending[0], pending[1], pending[2]};
    pending.clear();
    if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) triangles.push_back(t);
  }
};

}  // namespace

Result<std::shared_ptr<const Mesh>> mesh_of(std::vector<Vec3> points, std::vector<std::array<int, 3>> triangles,
                                            const std::string& name) {
  if (triangles.empty()) return fail("BO110", fmt::format("{}: the mesh has no triangles", name));
  std::map<std::pair<int, int>, int> edges;
  for (const auto& t : triangles) {
    for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  }
  const auto open = std::count_if(edges.begin(), edges.end(), [&](const auto& e) {
    const auto back = edges.find({e.first.second, e.first.first});
    return back == edges.end() || back->second != e.second;
  });
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

Result<std::shared_ptr<const Mesh>> read_stl(const std::string& path, double unit) {
  POLYPOD_ASSIGN(bytes, files::read(path));
  const auto bad = [&](const std::string& why) {
    return fail("BO112", fmt::format("{}: no STL file that can be read: {}", path, why), {},
                "export the solid as binary STL");
  };
  Corners corners;
  std::uint32_t count = 0;
  if (bytes.size() >= kHead) std::memcpy(&count, bytes.data() + 80, sizeof count);
  if (bytes.size() >= kHead && bytes.size() == kHead + kTriangle * std::size_t{count}) {
    for (std::size_t t = 0; t < count; ++t) {
      std::array<float, 9> f{};
      std::memcpy(f.data(), bytes.data() + kHead + t * kTriangle + 12, sizeof f);
      for (std::size_t k = 0; k < 9; k += 3) {
        const Vec3 p(f[k], f[k + 1], f[k + 2]);
        if (!p.allFinite()) return bad(fmt::format("triangle {} has a corner that is not finite", t + 1));
        corners.add(unit * p);
      }
    }
  } else if (bytes.starts_with("solid")) {
    std::istringstream in(bytes);
    std::string word;
    bool ended = false;
    while (in >> word) {
      ended = ended || word == "endsolid";
      if (word != "vertex") continue;
      Vec3 p;
      if (!(in >> p.x() >> p.y() >> p.z()) || !p.allFinite()) return bad("a vertex without three numbers");
      corners.add(unit * p);
    }
    if (!ended || !corners.pending.empty()) return bad("it is cut short");
  } else {
    return bad(bytes.size() >= kHead ? fmt::format("{} triangles do not fit into {} bytes", count, bytes.size())
                                     : "neither text nor binary");
  }
  return mesh_of(std::move(corners.points), std::move(corners.triangles), path);
}

}  // namespace polypod::bodies
