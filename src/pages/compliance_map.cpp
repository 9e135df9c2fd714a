// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/compliance_map.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/report/csv.hpp"
#include "polypod/report/vtk.hpp"

namespace polypod::pages {
namespace {

using units::to_mm;
using units::to_um;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::pair<int, int> kEntries[] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}};

/// "joint 1" as part of a key.
std::string key_of(std::string joint) {
  std::replace(joint.begin(), joint.end(), ' ', '_');
  return joint;
}

/// The determinant has the unit m for each of its rows of v (x, y, z as far as the task holds them) and 1/m for each
/// prismatic column.
int metres_of_determinant(const machine::AnyMachine& machine) {
  const machine::Task task = kinematics::task(machine);
  int power = 0;
  for (int i = 0; i < task.size(); ++i) power += task.is_angle(i) ? 0 : 1;
  for (int i = 0; i < kinematics::joint_count(machine); ++i)
    power -= kinematics::joint_kind(machine, i) == machine::JointKind::prismatic ? 1 : 0;
  return power;
}

bool has_determinant(const machine::AnyMachine& machine) {
  return kinematics::joint_count(machine) == kinematics::coordinate_count(kinematics::task(machine));
}

template <class Value>
Field field(const statics::Map& map, Field out, Value&& value_of) {
  out.values.reserve(map.points.size());
  for (const statics::MapPoint& point : map.points) {
    out.values.push_back(point.compliance.reachable ? value_of(point) : kNone);
  }
  return out;
}

}  // namespace

std::vector<Field> fields_of(const ComplianceMap& map) {
  std::vector<Field> out;
  if (statics::has_compliance(map.machine)) {
    double largest = 0;
    for (const statics::MapPoint& point : map.map.points)
      largest = std::max(largest, point.compliance.linear().cwiseAbs().maxCoeff());
    const auto um_per_N = [noise = 1e-10 * largest](double c) {
      return std::abs(c) <= noise ? 0.0 : units::to_um_per_N(c);
    };
    const auto entry = [](int i, int j) {
      Field f;
      f.kind = i == j ? Field::Kind::direct : Field::Kind::cross;
      f.name = fmt::format("C_{}{}", "xyz"[i], "xyz"[j]);
      f.unit = "um/N";
      f.key = f.name + "_um_per_N";
      f.row = i;
      f.column = j;
      return f;
    };
    for (const auto& [i, j] : kEntries) {
      out.push_back(field(map.map, entry(i, j), [&, i = i, j = j](const statics::MapPoint& point) {
        return um_per_N(point.compliance.C(i, j));
      }));
    }
    const std::vector<std::string> joints = statics::column_names(map.machine);
    for (std::size_t k = 0; k < joints.size(); ++k) {
      for (const auto& [i, j] : kEntries) {
        Field f = entry(i, j);
        f.kind = Field::Kind::share;
        f.joint = joints[k];
        f.key = key_of(f.joint) + "_" + f.key;
        out.push_back(field(map.map, std::move(f), [&, k, i = i, j = j](const statics::MapPoint& point) {
          return um_per_N(point.compliance.by_joint[k](i, j));
        }));
      }
    }
  }
  if (has_determinant(map.machine)) {
    Field f;
    const int power = metres_of_determinant(map.machine);
    f.kind = Field::Kind::determinant;
    f.name = "det J";
    f.unit = power == 0 ? "" : power == 1 ? "m" : fmt::format("m^{}", power);
    f.key = "det_J";
    if (power != 0) f.key += fmt::format("_{}m{}", power < 0 ? "per_" : "", std::abs(power));
    f = field(map.map, std::move(f), [](const statics::MapPoint& point) { return point.determinant; });
    const auto first_share =
        std::find_if(out.begin(), out.end(), [](const Field& g) { return g.kind == Field::Kind::share; });
    out.insert(first_share, std::move(f));
  }
  if (!map.measured) return out;
  for (const bool deviation : {false, true}) {
    for (const auto& [i, j] : kEntries) {
      const std::string name = fmt::format("C_{}{}", "xyz"[i], "xyz"[j]);
      Field f;
      f.kind = deviation ? Field::Kind::deviation : Field::Kind::measured;
      f.name = (deviation ? "deviation of measured " : "measured ") + name;
      f.unit = "um/N";
      f.key = fmt::format("measured_{}{}_um_per_N", name, deviation ? "_deviation" : "");
      f.row = i;
      f.column = j;
      for (const Mat3& C : deviation ? map.measured->deviations : map.measured->values)
        f.values.push_back(units::to_um_per_N(C(i, j)));
      out.push_back(std::move(f));
    }
  }
  return out;
}

Extremes extremes_of(const std::vector<double>& values) {
  double low = std::numeric_limits<double>::infinity(), high = -low, sum = 0;
  int count = 0;
  for (const double v : values) {
    if (!std::isfinite(v)) continue;
    low = std::min(low, v);
    high = std::max(high, v);
    sum += v;
    ++count;
  }
  Extremes out;
  if (count == 0) return out;
  out.min = low;
  out.max = high;
  const double largest = std::max(std::abs(low), std::abs(high)), same = 1e-9 * largest;
  out.mean = std::abs(sum) <= 1e-12 * largest * count ? 0 : sum / count;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (out.min_at < 0 && values[i] <= low + same) out.min_at = static_cast<int>(i);
    if (out.max_at < 0 && values[i] >= high - same) out.max_at = static_cast<int>(i);
  }
  return out;
}

int reached(const statics::Map& map) {
  return static_cast<int>(std::count_if(map.points.begin(), map.points.end(),
                                        [](const statics::MapPoint& p) { return p.compliance.reachable; }));
}
int reached(const LoadedPath& path) {
  return static_cast<int>(
      std::count_if(path.points.begin(), path.points.end(), [](const statics::PathError& e) { return e.reachable; }));
}

double tidy_mm(double metres) {
  return std::round(to_mm(metres) * 1e9) / 1e9 + 0.0;
}

bool both_signs(const ComplianceMap& map) {
  bool positive = false, negative = false;
  double largest = 0;
  for (const statics::MapPoint& p : map.map.points)
    if (p.compliance.reachable) largest = std::max(largest, std::abs(p.determinant));
  // What is rounding of 0 has no sign.
  for (const statics::MapPoint& p : map.map.points) {
    if (!p.compliance.reachable) continue;
    positive = positive || p.determinant > 1e-12 * largest;
    negative = negative || p.determinant < -1e-12 * largest;
  }
  return positive && negative;
}

double tidy(machine::Coordinate coordinate, double value) {
  return statics::is_angle(coordinate) ? std::round(units::to_deg(value) * 1e9) / 1e9 + 0.0 : tidy_mm(value);
}

const char* unit_of(machine::Coordinate coordinate) {
  return statics::is_angle(coordinate) ? "deg" : "mm";
}

std::array<double, 2> coordinates_at(const ComplianceMap& map, int point) {
  const int columns = map.map.grid.columns;
  return {tidy(map.plane.u, statics::coordinate_of(map.rectangle.u, point % columns, columns)),
          tidy(map.plane.v, statics::coordinate_of(map.rectangle.v, point / columns, map.map.grid.rows))};
}

std::string domain_of(const ComplianceMap& map) {
  if (map.plane.of_positions()) return "the plane " + place_of(map);
  const std::string place = place_of(map);
  return fmt::format("{} and {}{}{}", machine::name_of(map.plane.u), machine::name_of(map.plane.v),
                     place.empty() ? "" : " at ", place);
}

std::string place_of(const ComplianceMap& map) {
  if (map.plane.of_positions())
    return fmt::format("{} = {:g} mm", "xyz"[statics::axes_of(map.plane).normal], tidy_mm(map.at));
  const machine::Task task = kinematics::task(map.machine);
  std::string out;
  const char* unit = nullptr;  // of what stands there
  for (int i = 0; i < task.size(); ++i) {
    if (task[i] == map.plane.u || task[i] == map.plane.v) continue;
    const char* own = unit_of(task[i]);
    if (unit != nullptr && unit != own) out += fmt::format(" {}", unit);
    out += fmt::format("{}{} = {:g}", out.empty() ? "" : ", ", machine::name_of(task[i]),
                       tidy(task[i], map.coordinates[static_cast<std::size_t>(i)]));
    unit = own;
  }
  return unit == nullptr ? out : fmt::format("{} {}", out, unit);
}

std::string orientation_of(const ComplianceMap& map) {
  std::string out;
  const machine::Task task = kinematics::task(map.machine);
  std::size_t k = 0;
  for (int i = 0; i < task.size() && k < map.angles_deg.size(); ++i) {
    if (!task.is_angle(i)) continue;
    out += fmt::format("{}{} = {:g}", out.empty() ? "" : ", ", machine::name_of(task[i]), map.angles_deg[k++]);
  }
  return out.empty() ? out : out + " deg";
}

std::array<int, 2> grid_counts(const statics::Rectangle& r, int longer_side) {
  const double width = r.u[1] - r.u[0], height = r.v[1] - r.v[0], longer = std::max(width, height);
  const int fewest = std::min(11, longer_side);  // a narrow map still shows how it changes across
  const auto count = [&](double side) {
    return longer > 0 ? std::max(fewest, static_cast<int>(std::lround((longer_side - 1) * side / longer)) + 1) : fewest;
  };
  return {count(width), count(height)};
}

std::string map_csv(const ComplianceMap& map) {
  const std::vector<Field> fields = fields_of(map);
  const bool over_task = !map.plane.of_positions();
  std::vector<std::string> columns;
  if (over_task) {
    for (const machine::Coordinate c : {map.plane.u, map.plane.v})
      columns.push_back(fmt::format("{}_{}", machine::name_of(c), unit_of(c)));
  }
  // Not again where it is one of the two.
  std::vector<int> positions;
  for (const machine::Coordinate c : {machine::Coordinate::x, machine::Coordinate::y, machine::Coordinate::z}) {
    if (over_task && (c == map.plane.u || c == map.plane.v)) continue;
    columns.push_back(fmt::format("{}_mm", machine::name_of(c)));
    positions.push_back(static_cast<int>(c));
  }
  columns.emplace_back("reachable");
  for (const Field& f : fields) columns.push_back(f.key);
  const machine::Task task = kinematics::task(map.machine);
  report::Csv csv(columns);
  for (std::size_t i = 0; i < map.map.points.size(); ++i) {
    const statics::MapPoint& point = map.map.points[i];
    std::vector<report::Csv::Field> row;
    if (over_task) {
      for (const double c : coordinates_at(map, static_cast<int>(i))) row.emplace_back(c);
    }
    for (const int axis : positions) {
      // What follows from the machine is not known where it does not stand.
      if (over_task && !point.compliance.reachable && !task.holds(static_cast<machine::Coordinate>(axis))) {
        row.emplace_back(kNone);
      } else {
        row.emplace_back(tidy_mm(point.p_M[axis]));
      }
    }
    row.emplace_back(point.compliance.reachable ? 1.0 : 0.0);
    for (const Field& f : fields) row.emplace_back(f.values[i]);
    csv.add(row);
  }
  return csv.text();
}

std::string path_csv(const ComplianceMap& map) {
  const std::vector<std::string> joints = statics::column_names(map.machine);
  std::vector<std::string> columns{"path", "s_mm", "x_mm", "y_mm", "z_mm", "dx_um", "dy_um", "dz_um"};
  for (const std::string& joint : joints)
    for (const char axis : {'x', 'y', 'z'}) columns.push_back(fmt::format("{}_d{}_um", key_of(joint), axis));
  report::Csv csv(columns);
  for (std::size_t k = 0; k < map.paths.size(); ++k) {
    const LoadedPath& path = map.paths[k];
    for (const statics::PathError& e : path.points) {
      std::vector<report::Csv::Field> row{static_cast<double>(k + 1), tidy_mm((e.p_M - path.from_M).norm()),
                                          tidy_mm(e.p_M.x()), tidy_mm(e.p_M.y()), tidy_mm(e.p_M.z())};
      if (e.reachable) {
        const double noise = 1e-12 * e.total.norm();
        const auto add = [&](const Vec3& d) {
          for (int i = 0; i < 3; ++i) row.emplace_back(std::abs(d[i]) <= noise ? 0.0 : to_um(d[i]));
        };
        add(e.total);
        for (const Vec3& share : e.by_joint) add(share);
      }
      csv.add(row);
    }
  }
  return csv.text();
}

Result<std::string> map_vti(const ComplianceMap& map) {
  const statics::PlaneGrid& grid = map.map.grid;
  report::VtkImage image;
  const auto side = [&](std::size_t axis, machine::Coordinate c, const std::array<double, 2>& range, int count) {
    image.origin[axis] = tidy(c, range[0]);
    image.points[axis] = count;
    image.spacing[axis] = tidy(c, (range[1] - range[0]) / (count - 1));
  };
  if (map.plane.of_positions()) {
    const statics::PlaneAxes axes = statics::axes_of(map.plane);
    image.origin[static_cast<std::size_t>(axes.normal)] = tidy_mm(map.at);
    side(static_cast<std::size_t>(axes.u), map.plane.u, map.rectangle.u, grid.columns);
    side(static_cast<std::size_t>(axes.v), map.plane.v, map.rectangle.v, grid.rows);
  } else {
    side(0, map.plane.u, map.rectangle.u, grid.columns);
    side(1, map.plane.v, map.rectangle.v, grid.rows);
  }
  for (Field& f : fields_of(map)) image.arrays.push_back({std::move(f.key), 1, std::move(f.values)});
  if (statics::has_compliance(map.machine)) {
    report::VtkArray tensor{"compliance_um_per_N", 9, {}};
    for (const statics::MapPoint& point : map.map.points) {
      const Mat3 C = point.compliance.linear() * units::to_um_per_N(1);
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) tensor.values.push_back(point.compliance.reachable ? C(i, j) : kNone);
    }
    image.arrays.push_back(std::move(tensor));
  }
  return report::to_vti(image);
}

}  // namespace polypod::pages
