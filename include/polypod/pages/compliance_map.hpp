// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A map of the static compliance over a plane or over two coordinates of the task, as page, picture, table and VTK file
// (SLAV 2.4.3, 4.5, 4.6).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/pages/measured_compliance.hpp"
#include "polypod/report/plot.hpp"
#include "polypod/statics/plane.hpp"

namespace polypod::pages {

/// A straight path of the tool tip under a constant force.
struct LoadedPath {
  Vec3 from_M = Vec3::Zero(), to_M = Vec3::Zero();  ///< m
  Vec3 force_M = Vec3::Zero();                      ///< N
  std::vector<statics::PathError> points;           ///< what statics::path_error says
};

/// A map and what it was computed for.
struct ComplianceMap {
  machine::AnyMachine machine;
  statics::Plane plane = statics::Plane::xy;
  double at = 0;                   ///< m, the third coordinate of a plane of positions
  statics::Rectangle rectangle;    ///< m or rad
  std::vector<double> angles_deg;  ///< of a plane of positions: the angles of the machine's task, in its order
  statics::Map map;
  std::vector<LoadedPath> paths;
  std::optional<MeasuredCompliance> measured = {};  ///< to be shown beside the computed one
  std::vector<double> coordinates = {};  ///< of another plane: those of the task (statics::TaskPlane), m and rad
};

/// Points on the sides of a grid of about square cells: `longer` on the longer side, 11 at least on the other.
std::array<int, 2> grid_counts(const statics::Rectangle& rectangle, int longer);

/// One quantity over the plane, in the units of a person.
struct Field {
  enum class Kind {
    direct,       ///< C_xx, C_yy, C_zz, um/N
    cross,        ///< C_xy, C_xz, C_yz, um/N: displacement along the first letter under a force along the second
    determinant,  ///< of the task Jacobian, SI
    share,        ///< of one joint (leg) in a direct or cross compliance, um/N (SLAV (4.27))
    measured,     ///< C_xx to C_yz interpolated from readings, um/N
    deviation     ///< one standard deviation of that, um/N
  };
  Kind kind = Kind::direct;
  std::string name;            ///< "C_xx", "det J"
  std::string joint;           ///< of a share: "joint 1", "leg 1"
  std::string unit;            ///< "um/N", "m^3" (of det J: m^3 less the number of prismatic joints)
  std::string key;             ///< with the unit, for tables: "C_xx_um_per_N", "joint_1_C_xx_um_per_N", "det_J_m3",
                               ///< "measured_C_xx_um_per_N", "measured_C_xx_deviation_um_per_N"
  int row = 0, column = 0;     ///< of the compliance matrix
  std::vector<double> values;  ///< in the order of the map's points; NaN out of reach (measured: beside the
                               ///< measured points)
};

/// Every quantity of the map: three direct and three cross compliances, det J, each joint's shares, then what was
/// measured; without the compliances where the machine has none. What is below 1e-10 of the largest compliance of the
/// map is rounding noise of a zero and becomes 0.
std::vector<Field> fields_of(const ComplianceMap& map);

/// Least, mean and greatest of the values that are there. Of values that agree to 1e-9 the first counts, so that
/// symmetric maps name the same place everywhere; a mean below 1e-12 of the largest value is 0.
struct Extremes {
  double min = 0, mean = 0, max = 0;
  int min_at = -1, max_at = -1;  ///< index of the point; -1 where no value is there
};
Extremes extremes_of(const std::vector<double>& values);

/// Points of the map or of a path that the machine reaches.
int reached(const statics::Map& map);
int reached(const LoadedPath& path);

/// A coordinate as a person reads it, mm: without the last digits that the grid's division leaves.
double tidy_mm(double metres);

/// Whether det J has both signs over the points: it does not pass from one to the other but through a singular pose.
bool both_signs(const ComplianceMap& map);
inline constexpr const char* kBothSigns =
    "det J has both signs: points of this map lie on both sides of singular poses, near which the figures hold at the "
    "points alone";

/// A coordinate as a person reads it: mm, or deg of an angle, likewise tidied.
double tidy(machine::Coordinate coordinate, double value);
/// "mm" or "deg".
const char* unit_of(machine::Coordinate coordinate);
/// The two coordinates at a point of the map, by its number, tidied.
std::array<double, 2> coordinates_at(const ComplianceMap& map, int point);

/// "the plane z = 0 mm", "A and B at z = 800 mm": over what the map goes.
std::string domain_of(const ComplianceMap& map);
/// Where it lies, "z = 0 mm", and of a plane of positions how the tool is turned, "A = 0, B = 0 deg".
std::string place_of(const ComplianceMap& map);
std::string orientation_of(const ComplianceMap& map);

/// One row a point: x_mm, y_mm, z_mm, reachable (1 or 0), then every field by its key; empty where out of reach. Where
/// the map is not over positions, its coordinates stand before them, A_deg, B_deg, and x, y, z are those of the tool
/// tip as the machine settles.
std::string map_csv(const ComplianceMap& map);

/// One row a point of each path: path (from 1), s_mm along it, x_mm, y_mm, z_mm, dx_um, dy_um, dz_um, then the same of
/// each joint, joint_1_dx_um ...
std::string path_csv(const ComplianceMap& map);

/// The map as VTK image data, lengths in mm, angles in deg: every field by its key, and compliance_um_per_N as a 3 x 3
/// tensor. NaN out of reach.
Result<std::string> map_vti(const ComplianceMap& map);

/// All pictures of the map in one: direct compliances in one scale of colours, cross compliances in another, |det J|.
/// Where there are measured ones, each compliance is a row: measured, computed and the difference.
report::Figure map_picture(const ComplianceMap& map);

struct ComplianceMapPageOptions {
  std::string version;  ///< of Polypod; default: not named
  std::string command;  ///< the command line that makes this page again; default: left out
};

/// One self-contained HTML file: measured compliances beside computed ones (where there are any), direct and cross
/// compliances, |det J|, each joint's share (joints below 1 % of a
/// compliance everywhere are named, not drawn), errors along the paths. The same input gives the same bytes. Cost:
/// about 20 ms for 1000 points; a megabyte for 1000 points of a machine of six joints.
std::string compliance_map_page(const ComplianceMap& map, const ComplianceMapPageOptions& options = {});

}  // namespace polypod::pages
