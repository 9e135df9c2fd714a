// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "surface_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <mutex>
#include <optional>
#include <set>
#include <unordered_map>

#include "polypod/bodies/stl.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/report/html.hpp"
#include "polypod/report/vtk_reader.hpp"

namespace polypod::viewer {
namespace {

using Triangle = std::array<int, 3>;
using report::fixed;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Surface {
  std::vector<Vec3> points;  ///< mm
  std::vector<Triangle> triangles;
  std::vector<std::vector<int>> lines;
  std::vector<double> value;  ///< of each point, or empty
  std::string value_name;
  std::size_t degenerate = 0;  ///< triangles of the file without an area
};

std::size_t at(int i) {
  return static_cast<std::size_t>(i);
}

Vec3 area_vector(const Surface& s, const Triangle& t) {
  return 0.5 * (s.points[at(t[1])] - s.points[at(t[0])]).cross(s.points[at(t[2])] - s.points[at(t[0])]);
}

/// Polygons become fans of triangles.
Surface surface_of(report::VtkPolyData data) {
  Surface out;
  for (const auto& p : data.points) out.points.emplace_back(p[0], p[1], p[2]);
  const auto index = [](std::int64_t i) { return static_cast<int>(i); };
  for (const auto& polygon : data.polygons) {
    for (std::size_t k = 2; k < polygon.size(); ++k) {
      const Triangle t{index(polygon[0]), index(polygon[k - 1]), index(polygon[k])};
      const bool flat = t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
      if (flat || !(out.points[at(t[0])] + out.points[at(t[1])] + out.points[at(t[2])]).allFinite()) {
        ++out.degenerate;
      } else {
        out.triangles.push_back(t);
      }
    }
  }
  for (const auto& line : data.lines) {
    std::vector<int>& to = out.lines.emplace_back();
    for (const std::int64_t i : line) to.push_back(index(i));
  }
  for (report::VtkArray& a : data.arrays) {
    const auto known = [](double v) { return std::isfinite(v); };
    if (a.components != 1 || std::none_of(a.values.begin(), a.values.end(), known)) continue;
    out.value = std::move(a.values);
    out.value_name = one_line(a.name);
    break;
  }
  return out;
}

/// Points in one cell of a grid become one, their mean (vertex clustering, Rossignac and Borrel 1993).
Surface clustered(const Surface& s, double cell) {
  Surface out;
  out.value_name = s.value_name;
  std::unordered_map<std::uint64_t, int> cells;
  std::vector<int> to(s.points.size());
  std::vector<int> count;
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity());
  for (const Vec3& p : s.points) low = low.cwiseMin(p);
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    std::uint64_t key = 0;
    constexpr double kMostCells = 2e6;
    for (int k = 0; k < 3; ++k)
      key = key << 21U | static_cast<std::uint64_t>(std::clamp((s.points[i][k] - low[k]) / cell, 0.0, kMostCells));
    const auto [found, fresh] = cells.try_emplace(key, static_cast<int>(out.points.size()));
    to[i] = found->second;
    if (fresh) {
      out.points.emplace_back(Vec3::Zero());
      count.push_back(0);
      if (!s.value.empty()) out.value.push_back(s.value[i]);
    }
    ++count[at(to[i])];
    out.points[at(to[i])] += (s.points[i] - out.points[at(to[i])]) / count[at(to[i])];
  }
  for (const Triangle& t : s.triangles) {
    Triangle moved{to[at(t[0])], to[at(t[1])], to[at(t[2])]};
    if (moved[0] == moved[1] || moved[1] == moved[2] || moved[2] == moved[0]) continue;
    std::rotate(moved.begin(), std::min_element(moved.begin(), moved.end()), moved.end());
    out.triangles.push_back(moved);
  }
  std::sort(out.triangles.begin(), out.triangles.end());
  out.triangles.erase(std::unique(out.triangles.begin(), out.triangles.end()), out.triangles.end());
  return out;
}

/// At most so many triangles; `cell`: points that are nearer to each other than this, mm, may be one (0: all are kept).
Surface thinned(const Surface& s, std::size_t most, double& cell) {
  cell = 0;
  if (s.triangles.size() <= most) return s;
  double area = 0;
  for (const Triangle& t : s.triangles) area += area_vector(s, t).norm();
  constexpr double kPerCell = 2;  // triangles of a surface through a grid
  cell = std::sqrt(kPerCell * area / static_cast<double>(most));
  Surface out = clustered(s, cell);
  while (out.triangles.size() > most) {
    constexpr double kMore = 1.05;
    cell *= kMore * std::sqrt(static_cast<double>(out.triangles.size()) / static_cast<double>(most));
    out = clustered(s, cell);
  }
  return out;
}

/// Points at sharp edges stand once for each side, so that the sides are shaded by themselves.
Surface creased(const Surface& s) {
  const double sharp = std::cos(units::from_deg(35));
  struct Side {
    int point;
    Vec3 normal;
  };
  std::vector<std::vector<Side>> sides(s.points.size());
  Surface out = s;
  for (Triangle& t : out.triangles) {
    const Vec3 normal = area_vector(s, t).normalized();
    for (int& corner : t) {
      std::vector<Side>& known = sides[at(corner)];
      const auto side =
          std::find_if(known.begin(), known.end(), [&](const Side& k) { return k.normal.dot(normal) > sharp; });
      if (side != known.end()) {
        corner = side->point;
        continue;
      }
      int point = corner;
      if (!known.empty()) {
        point = static_cast<int>(out.points.size());
        out.points.push_back(s.points[at(corner)]);
        if (!s.value.empty()) out.value.push_back(s.value[at(corner)]);
      }
      known.push_back({point, normal});
      corner = point;
    }
  }
  return out;
}

/// Values that are few whole numbers are kinds.
std::vector<double> whole_values(const Surface& s) {
  constexpr std::size_t kMost = 20;
  std::set<double> seen;
  for (const double v : s.value) {
    if (std::isnan(v)) continue;
    if (v != std::round(v)) return {};
    seen.insert(v);
    if (seen.size() > kMost) return {};
  }
  return {seen.begin(), seen.end()};
}

std::string value_text(double value) {
  return fmt::format("{:.4g}", value);
}

report::Point3 point_of(const Vec3& p) {
  return {p.x(), p.y(), p.z()};
}

struct Values {
  std::vector<double> whole;  ///< kinds; empty: bands
  double low = 0, high = 0;
};

Values values_of(const Surface& s) {
  Values out{whole_values(s), std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const double v : s.value) {
    if (!std::isfinite(v)) continue;
    out.low = std::min(out.low, v);
    out.high = std::max(out.high, v);
  }
  if (out.low == out.high) out.whole = {out.low};
  return out;
}

report::Scene scene_of(const Surface& all, const Values& values, const std::string& name, std::size_t most,
                       double& cell) {
  report::Scene scene;
  scene.title = fmt::format("{} in space", name);
  const Surface s = creased(thinned(all, most, cell));
  if (!s.triangles.empty()) {
    report::Mesh mesh, without;
    for (const Vec3& p : s.points) mesh.points.push_back(point_of(p));
    without.points = mesh.points;
    without.kind.assign(mesh.points.size(), -1);
    if (all.value.empty()) {
      scene.kinds = {"surface"};
      mesh.triangles = s.triangles;
    } else {
      for (const Triangle& t : s.triangles) {
        const bool known = std::isfinite(s.value[at(t[0])] + s.value[at(t[1])] + s.value[at(t[2])]);
        (known ? mesh : without).triangles.push_back(t);
      }
      if (!values.whole.empty()) {
        for (const double v : values.whole) scene.kinds.push_back(fmt::format("{} {:g}", all.value_name, v));
        for (const double v : s.value) {
          const auto kind = std::lower_bound(values.whole.begin(), values.whole.end(), v) - values.whole.begin();
          mesh.kind.push_back(std::isnan(v) ? -1 : static_cast<int>(kind));
        }
      } else {
        constexpr int kBands = 8;
        std::string from = value_text(values.low);
        for (int k = 1; k < kBands; ++k) scene.levels.push_back(values.low + (values.high - values.low) * k / kBands);
        for (int k = 0; k < kBands; ++k) {
          const std::string to = value_text(k + 1 < kBands ? scene.levels[at(k)] : values.high);
          scene.kinds.push_back(fmt::format("{} {} to {}", all.value_name, from, to));
          from = to;
        }
        mesh.value = s.value;
      }
    }
    scene.meshes.push_back(std::move(mesh));
    if (!without.triangles.empty()) {
      without.name = "without a value";
      scene.meshes.push_back(std::move(without));
    }
  }
  report::Line3 lines{"lines", {}, report::Colour::blue, 1.8};
  std::size_t count = 0;
  for (const auto& line : all.lines) count += line.size();
  constexpr std::size_t kMostPoints = 100'000;
  const std::size_t stride = std::max<std::size_t>(1, count / kMostPoints);
  for (const auto& line : all.lines) {
    for (std::size_t k = 0; k < line.size(); ++k) {
      if (k % stride != 0 && k + 1 < line.size()) continue;
      lines.points.push_back(point_of(all.points[at(line[k])]));
      if (!all.value.empty()) lines.value.push_back(all.value[at(line[k])]);
    }
    lines.points.push_back({kNone, kNone, kNone});
    if (!all.value.empty()) lines.value.push_back(kNone);
  }
  if (count > 0) {
    if (!all.value.empty()) scene.ramp = {all.value_name, "", values.low, values.high};
    scene.lines.push_back(std::move(lines));
  }
  return scene;
}

Result<Surface> read(const std::string& path, bool stl) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  const std::uintmax_t most = stl ? kLargestStl : kLargestVtp;
  if (!error && size > most) {
    return fail("VW105", fmt::format("{} has {} MiB; up to {} are read", path, size >> 20U, most >> 20U), {},
                "make the mesh coarser: a picture needs some ten thousand triangles");
  }
  POLYPOD_ASSIGN(bytes, files::read(path));
  if (stl) {
    POLYPOD_ASSIGN(read, bodies::triangles_of_stl(bytes, path));
    Surface out;
    out.points = std::move(read.points);
    out.triangles = std::move(read.triangles);
    out.degenerate = read.degenerate;
    return out;
  }
  POLYPOD_ASSIGN(data, report::read_vtp(bytes, path));
  return surface_of(std::move(data));
}

}  // namespace

Result<std::string> surface_page(const std::string& path, const std::string& version) {
  // Large files one after the other: together they might not fit into the memory.
  static std::mutex one_at_a_time;
  const std::lock_guard lock(one_at_a_time);
  const std::string name = std::filesystem::path(path).filename().string();
  const bool stl = !path.empty() && (path.back() == 'l' || path.back() == 'L');
  POLYPOD_ASSIGN(s, read(path, stl));
  Eigen::AlignedBox3d box;
  for (const Triangle& t : s.triangles)
    for (const int i : t) box.extend(s.points[at(i)]);
  for (const auto& line : s.lines)
    for (const int i : line)
      if (s.points[at(i)].allFinite()) box.extend(s.points[at(i)]);
  if (box.isEmpty()) {
    return fail("VW106", fmt::format("{} holds no triangles and no lines", path), {},
                "export the surface again; single points are not shown");
  }
  constexpr double kLargest = 1e9;  // mm
  if (!(box.min().cwiseAbs().maxCoeff() <= kLargest && box.max().cwiseAbs().maxCoeff() <= kLargest)) {
    return fail("VW106", fmt::format("{} has points beyond {:g} mm", path, kLargest), {},
                "points that are not set are usually left out; export the surface again");
  }
  std::vector<std::pair<std::string, std::string>> facts{{"file", path}, {"format", stl ? "STL" : "VTK PolyData"}};
  if (!version.empty()) facts.emplace_back("made with", "Polypod " + version);
  report::Report page(name, s.triangles.empty() ? "Lines of a file" : "A surface of triangles", facts);
  page.add_section("What the file holds");
  const auto count = [](std::size_t n) { return fixed(static_cast<double>(n), 0); };
  const Vec3 size = box.sizes();
  const double longest = size.maxCoeff();
  const int digits = std::clamp(3 - static_cast<int>(std::floor(std::log10(std::max(longest, 1e-6)))), 0, 6);
  std::vector<report::KeyFigure> figures;
  for (int k = 0; k < 3; ++k) {
    figures.push_back(
        {fixed(size[k], digits), "mm",
         fmt::format("along {}, from {} to {}", "xyz"[k], fixed(box.min()[k], digits), fixed(box.max()[k], digits))});
  }
  if (!s.triangles.empty()) {
    const std::size_t open = bodies::open_edges(s.triangles);
    double area = 0, volume = 0;
    for (const Triangle& t : s.triangles) {
      const Vec3 a = area_vector(s, t);
      area += a.norm();
      volume += a.dot(s.points[at(t[0])] - box.center()) / 3;
    }
    page.add_verdict(
        report::Verdict::neutral,
        open == 0
            ? fmt::format("The surface is closed: each edge is passed by its triangles as often in one direction as in "
                          "the other. It encloses {} mm³{}. Whether it cuts itself is not judged.",
                          report::number(std::abs(volume), 5),
                          volume < 0 ? ", with the corners of its triangles clockwise seen from outside (STL asks for "
                                       "the other way)"
                                     : "")
            : fmt::format("The surface is not closed: {} of its edges lack a triangle on the other side, or one that "
                          "passes them the other way. It has no inside, and no volume.",
                          count(open)));
    figures.push_back({count(s.triangles.size()), "", "triangles"});
    figures.push_back({report::number(area, 5), "mm²", "area"});
  }
  if (!s.lines.empty()) figures.push_back({count(s.lines.size()), "", "lines"});
  page.add_key_figures(figures);
  page.add_text(stl ? "An STL file has no unit: its numbers are taken as mm."
                    : "A VTK file has no unit: its numbers are taken as mm, as Polypod writes them.");
  if (s.degenerate > 0) {
    page.add_text(fmt::format(
        "{} more triangles of the file have no area, because two of their corners are equal{}; they are left out.",
        count(s.degenerate), stl ? "" : " or not finite"));
  }
  const Values values = values_of(s);
  constexpr std::size_t kDrawn = 3000;
  double cell = 0, drawn_cell = 0;
  const report::Scene turns = scene_of(s, values, name, kMostTriangles, cell);
  const report::Scene drawn = scene_of(s, values, name, kDrawn, drawn_cell);
  std::string caption = s.triangles.empty() ? "The lines of the file." : "The surface of the file.";
  if (cell > 0) {
    caption += fmt::format(
        " The picture is coarser than the file: of {} triangles it shows {}; points less than {} mm apart may be one. "
        "The "
        "figures above are of all.",
        count(s.triangles.size()), count(turns.meshes.front().triangles.size()), report::number(cell, 2));
  }
  if (!s.value.empty())
    caption += fmt::format(" Coloured by {}, the first scalar at the points of the file, from {} to {}.", s.value_name,
                           value_text(values.low), value_text(values.high));
  constexpr std::size_t kColours = 8;
  if (values.whole.size() > kColours) caption += " Colours come again after eight; the pointer names the value.";
  page.add_scene(drawn, caption, &turns);
  page.add_section("What this page does not answer");
  page.add_list({"Whether the surface is that of the part: nothing is compared.",
                 "Whether a machine or a tool touches it: `polypod check --bodies` judges that."});
  return page.to_html();
}

}  // namespace polypod::viewer
