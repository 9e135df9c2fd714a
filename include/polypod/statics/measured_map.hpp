// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The tip's compliance interpolated from measured displacements alone, without any model of joints (SLAV conclusions).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/identify.hpp"

namespace polypod::statics {

/// The six numbers of a symmetric 3 x 3 matrix in the order xx, yy, zz, yz, xz, xy.
inline constexpr int kEntries = 6;
/// Row and column of each.
inline constexpr std::array<std::pair<int, int>, kEntries> kEntryPlaces{
    {{0, 0}, {1, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}}};

/// What one point says of the compliance: (C + C^T) / 2 with the columns d_j / F_j, m/N; of a cross compliance of
/// which only one displacement was measured, that one alone, and 0 where none was.
Mat3 measured_compliance(const MeasuredPoint& point);
/// Whether each of its six entries was measured: by one displacement at least.
bool tells_all_entries(const MeasuredPoint& point);

/// C(p) by universal kriging: each entry of C is a linear function of the place p plus a Gaussian field with the
/// correlation (1 + r + r^2/3) exp(-r), r = sqrt(5) |p - p'| / length (Matern 5/2), seen with independent noise. The
/// length is one for all entries; each entry has its own size of field and noise. All are those of greatest restricted
/// likelihood, the linear function of least squares under them. Between the measured points it goes through their
/// trend, and not through their noise; far from them it says nothing and `covers` is false.
///
/// Source: Rasmussen and Williams (2006), Gaussian Processes for Machine Learning, (2.41), (2.42), (4.17); restricted
/// likelihood after Patterson and Thompson (1971).
class MeasuredMap {
 public:
  /// Tool axes up to this angle apart count as one, rad.
  static constexpr double kOneDirection = units::from_deg(1);

  /// From the displacements under forces along x, y and z, see measured_compliance. Points that do not tell all entries
  /// are left out. Errors: ID130 fewer than 6 points or all at one place, ID131 tool axes that differ by more than
  /// 1 deg. Cost: n^3, 20 ms for 90 points.
  static Result<MeasuredMap> of(const std::vector<MeasuredPoint>& points);

  /// C at the tip position p in M, m/N: symmetric, and positive semidefinite (negative eigenvalues, which noise may
  /// give, become 0). Cost: n exponentials, about 1 us for 90 points.
  [[nodiscard]] Mat3 at(const Vec3& p_M) const;
  /// Standard deviation of every entry of the field there (not of a new reading), m/N. Cost: n^2.
  [[nodiscard]] Mat3 deviation(const Vec3& p_M) const;
  /// Whether p lies within the box of the measured points, grown by half of their typical spacing (the median distance
  /// to the nearest neighbour).
  [[nodiscard]] bool covers(const Vec3& p_M) const;
  /// Why not: "x = 812.0 mm lies outside -750.0 .. 750.0 mm".
  [[nodiscard]] std::string why_not(const Vec3& p_M) const;

  /// The unit tool axis in M that all points share.
  [[nodiscard]] const Vec3& axis() const { return axis_; }
  /// The box of `covers`, m.
  [[nodiscard]] const Vec3& low() const { return low_; }
  [[nodiscard]] const Vec3& high() const { return high_; }
  [[nodiscard]] double correlation_length() const { return length_; }  ///< m
  /// Standard deviation of a reading's noise by entry, m/N.
  [[nodiscard]] std::array<double, kEntries> noise() const;
  [[nodiscard]] std::size_t size() const { return places_.size(); }

 private:
  struct Entry {
    double variance = 0;                       ///< of the field, (m/N)^2
    double ratio = 0;                          ///< noise variance over field variance
    Eigen::VectorXd trend;                     ///< of the linear function
    Eigen::VectorXd weights;                   ///< of the correlations with the places
    Eigen::LLT<Eigen::MatrixXd> factor;        ///< of R + ratio I
    Eigen::MatrixXd solved;                    ///< (R + ratio I)^-1 B
    Eigen::LLT<Eigen::MatrixXd> trend_factor;  ///< of B^T (R + ratio I)^-1 B
  };
  [[nodiscard]] Eigen::VectorXd basis(const Vec3& p_M) const;
  [[nodiscard]] double correlation(double distance) const;

  std::vector<Vec3> places_;
  Vec3 axis_ = Vec3::UnitZ(), low_, high_, middle_;
  double span_ = 1;             ///< m, scale of the linear function
  Eigen::MatrixXd directions_;  ///< 3 x k: the directions in which the points spread
  double length_ = 0;
  std::array<Entry, kEntries> entries_;
};

/// How well two models foretell displacements that they were not made from, m rms: the joints' compliances
/// (identify_compliance) and the map that knows no joints.
struct Foretold {
  double joints = 0;
  std::optional<double> map;  ///< nothing where the others do not make a map
};
/// For each group of points, from all the others. Errors: those of identify_compliance.
Result<std::vector<Foretold>> leave_one_out(const AnyMachine& machine,
                                            const std::vector<std::vector<MeasuredPoint>>& groups);
/// The points shuffled (always the same way) and dealt out into `parts` groups, each predicted from the others; both
/// numbers over all points. Errors: as above; ID132 fewer points than parts.
Result<Foretold> hold_out(const AnyMachine& machine, const std::vector<MeasuredPoint>& points, int parts = 5);

/// Measured compliances less those of a machine at the same poses, and what noise there is in the readings, m/N.
struct Compared {
  std::vector<Mat3> difference;                       ///< measured_compliance less compliance_at, of each point
  Mat3 rms = Mat3::Zero();                            ///< of the differences, by entry
  Mat3 noise = Mat3::Zero();                          ///< MeasuredMap::noise: what the rms would be of a perfect model
  Mat3 deviation = Mat3::Zero();                      ///< mean of MeasuredMap::deviation at the points
  std::array<std::array<std::size_t, 3>, 3> worst{};  ///< the point of the largest difference, by entry
  double rms_of_all = 0, noise_of_all = 0;            ///< root of the mean of the squares of the six entries
};
/// Points that do not tell all entries have a difference of 0 and do not count. Errors: those of joints_of. Cost: that
/// of `deviation` a point.
Result<Compared> compare(const AnyMachine& machine, const MeasuredMap& map, const std::vector<MeasuredPoint>& points);

/// Measured against the map, m rms over all displacements.
double prediction_rms(const MeasuredMap& map, const std::vector<MeasuredPoint>& points);

}  // namespace polypod::statics
