// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/workspace/field.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "margin.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::workspace {
namespace {

Status check_resolution(int resolution) {
  if (resolution >= 8 && resolution <= 512) return {};
  return fail("WS130", fmt::format("a resolution of {} points must be 8 to 512", resolution));
}

constexpr double kBeyond = 1.5;  // spacings of the grid beyond each side of the box

}  // namespace

Vec3 Grid::at(std::size_t index) const {
  const auto nx = static_cast<std::size_t>(points[0]), ny = static_cast<std::size_t>(points[1]);
  return at(static_cast<int>(index % nx), static_cast<int>(index / nx % ny), static_cast<int>(index / (nx * ny)));
}

namespace {
constexpr const char* kAskWorkspace =
    "`polypod workspace` says what is reached in these directions; `polypod fk` at the home joints where the tool "
    "points";
}  // namespace

Vec3 spacing_of(const Vec3& size, int resolution, const machine::Task& task) {
  if (task.places()) return Vec3::Constant(size.maxCoeff() / (resolution - 1));
  Vec3 out = Vec3::Ones();
  const int n = coordinates_of_points(task);
  out.head(n) = size.head(n) / (resolution - 1);
  return out;
}

Result<Grid> grid_over(const Vec3& low, const Vec3& high, int resolution, const machine::Task& task) {
  POLYPOD_TRY(check_resolution(resolution));
  const Vec3 spacing = spacing_of(high - low, resolution, task);
  if (!(spacing.minCoeff() > 0)) return fail("WS130", "the box of the grid is empty", {}, kAskWorkspace);
  Grid grid;
  for (int k = 0; k < coordinates_of_points(task); ++k) {
    const int steps = static_cast<int>(std::ceil((high[k] - low[k]) / spacing[k] + 2 * kBeyond - 1e-9));
    grid.points[static_cast<std::size_t>(k)] = steps + 1;
    grid.step[static_cast<std::size_t>(k)] = spacing[k] * Vec3::Unit(k);
    grid.origin[k] = 0.5 * (low[k] + high[k] - steps * spacing[k]);
  }
  return grid;
}

Result<Grid> grid_on(const Plane& plane, const Vec3& low, const Vec3& high, int resolution, const machine::Task& task) {
  POLYPOD_TRY(check_resolution(resolution));
  const double length = plane.normal.norm();
  if (!(length > 1e-12) || !std::isfinite(length) || !plane.point.allFinite()) {
    return fail("WS132", "the plane has no normal", {}, "give a normal that is not 0");
  }
  const bool slanting = plane.normal.cwiseAbs().maxCoeff() < (1 - 1e-12) * length;
  if (slanting && !task.places()) {
    return fail("WS132", "lengths and angles have no slanting plane", {}, "give a plane of two of the coordinates");
  }
  const Vec3 n = plane.normal / length;
  // Axes of M where the plane holds two of them, else a horizontal axis and the one that rises.
  Vec3 u, v;
  Eigen::Index along = 0;
  n.cwiseAbs().maxCoeff(&along);
  if (!slanting) {
    u = Vec3::Unit(along == 0 ? 1 : 0);
    v = Vec3::Unit(along == 2 ? 1 : 2);
  } else {
    u = Vec3::UnitZ().cross(n).normalized();
    v = n.cross(u);
    if (v.z() < 0) v = -v;
  }
  // The polygon in which the plane cuts the box, by its corners on the edges of the box.
  double u_low = 1e300, u_high = -1e300, v_low = 1e300, v_high = -1e300;
  for (int axis = 0; axis < 3; ++axis) {
    for (int corner = 0; corner < 4; ++corner) {
      Vec3 a = low;
      if ((corner & 1) != 0) a[(axis + 1) % 3] = high[(axis + 1) % 3];
      if ((corner & 2) != 0) a[(axis + 2) % 3] = high[(axis + 2) % 3];
      Vec3 b = a;
      b[axis] = high[axis];
      const double fa = n.dot(a - plane.point), fb = n.dot(b - plane.point);
      const auto add = [&](const Vec3& p) {
        u_low = std::min(u_low, u.dot(p - plane.point));
        u_high = std::max(u_high, u.dot(p - plane.point));
        v_low = std::min(v_low, v.dot(p - plane.point));
        v_high = std::max(v_high, v.dot(p - plane.point));
      };
      if (fa == 0) add(a);
      if (fb == 0) add(b);
      if (fa * fb < 0) add(a + (b - a) * (fa / (fa - fb)));
    }
  }
  const double longest = std::max(u_high - u_low, v_high - v_low);
  if (!(longest > 1e-9) && (high - low).isZero(0))
    return fail("WS132", "nothing is reached in every direction that is asked for", {}, kAskWorkspace);
  if (!(longest > 1e-9)) {
    std::string at, box;
    const Vec3 point = for_user(task, plane.point), from = for_user(task, low), to = for_user(task, high);
    for (int k = 0; k < coordinates_of_points(task); ++k) {
      const char* between = k == 0 ? "" : ", ";
      // Lengths have one unit in all.
      const std::string unit = !task.places() || k == 2 ? fmt::format(" {}", unit_of(task, k)) : "";
      at += fmt::format("{}{:g}{}", between, point[k] + 0.0, unit);
      box += fmt::format("{}{} {:.1f} .. {:.1f}{}", between, machine::name_of(task[k]), from[k], to[k], unit);
    }
    return fail("WS132", fmt::format("the plane through {} misses the workspace, which lies in {}", at, box), {},
                "move the plane");
  }
  Grid grid;
  const Vec3 spacing = spacing_of(Vec3(u_high - u_low, v_high - v_low, 0), resolution, task);
  const auto steps = [&](double extent, double of) {
    return static_cast<int>(std::ceil(extent / of + 2 * kBeyond - 1e-9));
  };
  const int nu = steps(u_high - u_low, spacing[0]), nv = steps(v_high - v_low, spacing[1]);
  grid.points = {nu + 1, nv + 1, 1};
  grid.step = {spacing[0] * u, spacing[1] * v, longest / (resolution - 1) * n};
  grid.origin =
      plane.point + 0.5 * (u_low + u_high - nu * spacing[0]) * u + 0.5 * (v_low + v_high - nv * spacing[1]) * v;
  return grid;
}

Status near_home(const AnyMachine& machine, const Vec3& low, const Vec3& high) {
  const machine::Task task = kinematics::task(machine);
  if (task.places()) return {};
  const Vec3 home = point_of(task, kinematics::home_pose(machine).value_or(Pose{}));
  constexpr double kRounding = 1e-9;
  for (int k = 0; k < coordinates_of_points(task); ++k) {
    const double least = home[k] - kFromHome, most = home[k] + kFromHome;
    if (!task.is_angle(k) || (low[k] >= least - kRounding && high[k] <= most + kRounding)) continue;
    return fail("WS130",
                fmt::format("{} {:g}{} deg: angles are looked at within 90 deg of home, {:g} to {:g} deg",
                            machine::name_of(task[k]), units::to_deg(low[k]),
                            high[k] > low[k] ? fmt::format(" to {:g}", units::to_deg(high[k])) : "",
                            units::to_deg(least), units::to_deg(most)),
                {}, "stay within them, or give the machine file another home");
  }
  return {};
}

std::string limit_label(const AnyMachine& machine, int limit) {
  if (limit == kNearSingular) return "near a singular pose";
  if (limit == kFarFromHome) return "more than a quarter turn from home";
  return limit == kOutOfReach ? "out of reach" : kinematics::limit_name(machine, limit);
}

std::string limit_kind(const AnyMachine& machine, int limit) {
  std::string name = limit_label(machine, limit);
  if (kinematics::takes_any_posture(machine)) return name;
  // The legs are equal but for their numbers: " 3" and " 3 and 4" go.
  std::string out;
  for (std::size_t i = 0; i < name.size();) {
    std::size_t end = i + 1;
    if (name[i] == ' ') {
      while (end < name.size() && name[end] >= '0' && name[end] <= '9') ++end;
      if (end > i + 1 && name.compare(end, 5, " and ") == 0) {
        i = end + 4;
        continue;
      }
      if (end > i + 1) {
        i = end;
        continue;
      }
    }
    out += name[i++];
  }
  return out;
}

Result<Field> field(const AnyMachine& machine, const Options& options, const Grid& grid,
                    const FieldOptions& field_options) {
  constexpr std::size_t kMostPoints = 200'000'000;
  for (const int n : grid.points) {
    if (n < 1) return fail("WS130", "the grid has no points");
  }
  if (grid.size() > kMostPoints) return fail("WS130", fmt::format("{} points are more than 2e8", grid.size()));
  constexpr std::size_t kMargin = sizeof(double) + sizeof(int), kTilt = 2 * sizeof(double) + sizeof(int);
  const bool tilt = field_options.tilt && tilts(kinematics::task(machine));
  const std::size_t bytes = grid.size() * (kMargin + (tilt ? kTilt : 0));
  if (options.max_memory > 0 && bytes > options.max_memory) {
    return fail("WS133",
                fmt::format("a grid of {} x {} x {} points takes {:.0f} MB, more than the {:.0f} MB of --max-memory",
                            grid.points[0], grid.points[1], grid.points[2], 1e-6 * static_cast<double>(bytes),
                            1e-6 * static_cast<double>(options.max_memory)),
                {}, "lower the resolution or allow more memory");
  }
  POLYPOD_ASSIGN(judge, judge_of(machine, options, field_options));
  Field out;
  out.grid = grid;
  out.margin.resize(grid.size());
  out.limit.resize(grid.size());
  if (tilt) {
    out.tilt.resize(grid.size());
    out.tilt_limit.resize(grid.size());
    out.upright.resize(grid.size());
  }
  POLYPOD_TRY(in_rounds(
      options, grid.size(),
      [&](std::size_t i) {
        const Vec3 p = grid.at(i);
        const Margin margin = judge->margin(p);
        out.margin[i] = margin.value;
        out.limit[i] = margin.limit;
        if (!tilt) return;
        const Margin most = judge->tilt(p);
        out.tilt[i] = most.value;
        out.tilt_limit[i] = most.limit;
        out.upright[i] = judge->upright(p).value;
      },
      field_options.progress));
  return out;
}

Result<Extent> extent(const AnyMachine& machine, const Options& options, bool upright_too) {
  Options coarse = options;
  coarse.keep_cells = false;
  coarse.bounds_tolerance = 0;
  coarse.progress = nullptr;
  const bool slow = bounds_are_slow(machine);
  const double tolerance = slow ? 1.0 : 0.1;
  const auto box_of = [&](const Directions& directions, std::int64_t cells) -> Result<Extent> {
    coarse.directions = directions;
    coarse.relative_tolerance = tolerance;
    coarse.max_cells = cells;
    POLYPOD_ASSIGN(v, volume(machine, coarse));
    return v.empty ? Extent{} : Extent{v.min, v.max};
  };
  // What all directions reach lies within what one of them does, which is quick to bound closely; a short run over all
  // of them tightens the box.
  const auto middle = [](const std::optional<std::array<double, 2>>& range) {
    const double at = range ? 0.5 * ((*range)[0] + (*range)[1]) : 0.0;
    return std::array<double, 2>{at, at};
  };
  const std::int64_t most_cells = slow ? 5'000 : 100'000, few_cells = 3000;
  const Directions& all = options.directions;
  POLYPOD_ASSIGN(one, box_of({0, middle(all.a_range), middle(all.b_range)}, most_cells));
  if (!kinematics::task(machine).places()) return one;  // its directions are coordinates
  Extent out;
  if (!one.empty()) {
    POLYPOD_ASSIGN(rough, box_of(all, few_cells));
    if (!rough.empty()) out = {one.low.cwiseMax(rough.low), one.high.cwiseMin(rough.high)};
  }
  if (!upright_too) return out;
  POLYPOD_ASSIGN(upright, box_of({}, most_cells));
  if (upright.empty()) return out;
  return out.empty() ? upright : Extent{out.low.cwiseMin(upright.low), out.high.cwiseMax(upright.high)};
}

Result<InsidePoints> points_inside(const AnyMachine& machine, const Options& options, const Grid& grid,
                                   bool points_alone) {
  // So few are sooner judged one by one than by the bounds of the whole workspace; what is proven of a cone of
  // directions no sample of it says.
  constexpr std::size_t kFew = 2000;
  const bool one_by_one = points_alone && grid.size() <= kFew && sampled_orientations(options.directions).size() == 1;
  POLYPOD_ASSIGN(judge, judge_of(machine, options, {}));
  Options coarse = options;
  coarse.keep_cells = true;
  coarse.bounds_tolerance = 0;
  coarse.progress = nullptr;
  const bool slow = bounds_are_slow(machine);
  coarse.relative_tolerance = slow ? 1 : 0.02;
  coarse.max_cells = slow ? 2000 : 100'000;
  Volume v;
  v.upper = std::numeric_limits<double>::infinity();
  enum : std::uint8_t { kOut, kIn, kOpen };
  std::vector<std::uint8_t> state(grid.size(), kOpen);
  if (has_bounds(machine) && !one_by_one) {
    POLYPOD_ASSIGN(proven, volume(machine, coarse));
    v = std::move(proven);
    std::fill(state.begin(), state.end(), kOut);
  }
  for (const Cell& cell : v.cells) {
    std::array<int, 3> first{}, last{};
    for (int k = 0; k < 3; ++k) {
      const auto axis = static_cast<std::size_t>(k);
      const double spacing = grid.step[axis][k], from = (cell.center[k] - cell.half[k] - grid.origin[k]) / spacing,
                   to = (cell.center[k] + cell.half[k] - grid.origin[k]) / spacing;
      first[axis] = std::max(0, static_cast<int>(std::ceil(from - 1e-9)));
      last[axis] = std::min(grid.points[axis] - 1, static_cast<int>(std::floor(to + 1e-9)));
    }
    for (int k = first[2]; k <= last[2]; ++k)
      for (int j = first[1]; j <= last[1]; ++j)
        for (int i = first[0]; i <= last[0]; ++i) {
          std::uint8_t& s = state[grid.index(i, j, k)];
          if (s != kIn) s = cell.state == CellState::inside ? kIn : kOpen;
        }
  }
  POLYPOD_TRY(in_rounds(
      options, grid.size(),
      [&](std::size_t i) {
        if (state[i] == kOpen) state[i] = judge->margin(grid.at(i)).value >= 0 ? kIn : kOut;
      },
      nullptr));
  InsidePoints out{{}, v.volume, v.lower, v.upper};
  for (std::size_t i = 0; i < grid.size(); ++i)
    if (state[i] == kIn) out.points.push_back(i);
  return out;
}

namespace {

/// Marching triangles: each square of the grid is cut along one diagonal, so that every point of the border lies on one
/// edge and belongs to two triangles, and the border is closed without doubtful cases.
std::vector<Loop> border_of(const Field& f, const PointJudge& judge) {
  const int nu = f.grid.points[0], nv = f.grid.points[1];
  using Edge = std::pair<std::size_t, std::size_t>;  // from the lower index
  std::map<Edge, Edge> next;                         // along the border, inside to the left
  std::map<Edge, Vec3> at;
  const auto inside = [&](int i, int j) {
    return i > 0 && j > 0 && i + 1 < nu && j + 1 < nv && f.margin[f.grid.index(i, j, 0)] >= 0;
  };
  struct Corner {
    std::size_t index;
    bool in;
  };
  const auto corner = [&](int i, int j) { return Corner{f.grid.index(i, j, 0), inside(i, j)}; };
  const auto edge = [](const Corner& a, const Corner& b) {
    return Edge{std::min(a.index, b.index), std::max(a.index, b.index)};
  };
  const auto triangle = [&](const std::array<Corner, 3>& c) {  // counterclockwise
    for (std::size_t k = 0; k < 3; ++k) {
      const Corner &a = c[k], &b = c[(k + 1) % 3], &d = c[(k + 2) % 3];
      if (a.in == b.in || a.in == d.in) continue;  // a alone on its side
      const Edge ab = edge(a, b), ad = edge(a, d);
      (a.in ? next[ab] : next[ad]) = a.in ? ad : ab;
    }
  };
  for (int j = 0; j + 1 < nv; ++j)
    for (int i = 0; i + 1 < nu; ++i) {
      const Corner p = corner(i, j), q = corner(i + 1, j), r = corner(i + 1, j + 1), s = corner(i, j + 1);
      triangle({p, q, r});
      triangle({p, r, s});
    }
  for (const auto& [from, to] : next) {
    const Vec3 a = f.grid.at(from.first), b = f.grid.at(from.second);
    const bool first_in = f.margin[from.first] >= 0;
    const Vec3 &in = first_in ? a : b, &out = first_in ? b : a;
    const double fa = f.margin[first_in ? from.first : from.second], fb = f.margin[first_in ? from.second : from.first];
    const double t =
        fb < 0 ? border_between([&](double share) { return judge.margin(in + share * (out - in)).value; }, fa, fb) : 1;
    at[from] = in + t * (out - in);
  }
  std::vector<Loop> loops;
  while (!next.empty()) {
    Loop loop;
    Edge here = next.begin()->first;
    for (auto it = next.find(here); it != next.end(); it = next.find(here)) {
      loop.push_back(at[here]);
      here = it->second;
      next.erase(it);
    }
    loops.push_back(std::move(loop));
  }
  return loops;
}

}  // namespace

Result<Section> section(const AnyMachine& machine, const Options& options, const Plane& plane, int resolution,
                        const FieldOptions& field_options) {
  POLYPOD_TRY(judge_of(machine, options, field_options));
  const machine::Task task = kinematics::task(machine);
  if (!task.places()) {
    Eigen::Index along = 0;
    plane.normal.cwiseAbs().maxCoeff(&along);
    Vec3 at = point_of(task, kinematics::home_pose(machine).value_or(Pose{}));
    at[along] = plane.point[along];
    POLYPOD_TRY(near_home(machine, at, at));
  }
  POLYPOD_ASSIGN(box, extent(machine, options, true));
  return section(machine, options, plane, box, resolution, field_options);
}

Result<Section> section(const AnyMachine& machine, const Options& options, const Plane& plane, const Extent& box,
                        int resolution, const FieldOptions& field_options) {
  POLYPOD_ASSIGN(judge, judge_of(machine, options, field_options));
  const machine::Task task = kinematics::task(machine);
  if (box.empty()) {
    return fail("WS131", "nothing is reachable with R = 1, nor from all required directions: there is nothing to show");
  }
  Section out;
  out.task = task;
  out.plane = plane;
  POLYPOD_ASSIGN(grid, grid_on(plane, box.low, box.high, resolution, task));
  POLYPOD_ASSIGN(values, field(machine, options, grid, field_options));
  out.field = std::move(values);
  out.border = border_of(out.field, *judge);
  const Vec3 n = grid.step[0].cross(grid.step[1]).normalized();
  for (const Loop& loop : out.border)
    for (std::size_t k = 0; k < loop.size(); ++k)
      out.area += 0.5 * n.dot((loop[k] - grid.origin).cross(loop[(k + 1) % loop.size()] - grid.origin));
  return out;
}

}  // namespace polypod::workspace
