// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/identify.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <string_view>

#include "not_negative.hpp"
#include "polypod/core/csv.hpp"
#include "polypod/core/distributions.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/units.hpp"
#include "stated_noise.hpp"

namespace polypod::statics {
namespace {

// A robot tip that gives way by more than this under a workshop's force is a unit that was mistaken, m.
constexpr double kUnbelievable = 0.05;
// Columns whose scaled equations are worse conditioned than this cannot be told apart.
constexpr double kNotApart = 1e8;
constexpr double kAlike = 0.9;    // correlation of two estimates from which on the sum is known better than the two
constexpr double kOutlier = 3.5;  // robust standard deviations
// Misfit and asymmetry that are named are of a size that matters, and such as chance makes in one of 200 perfect
// machines each: both together in one of 100.
constexpr double kMatters = 1.5;
constexpr double kChance = 0.005;

constexpr const char* kAxes = "xyz";
constexpr double kJointsOffPlace = 10e-3;               // m, between the pose and that of the file's joints ...
constexpr double kJointsOffAngle = units::from_deg(1);  // ... beyond which they are not of one row

/// "dx_Fy_um" for direction 0 under the force along axis 1.
std::string column_of(int direction, int force) {
  return fmt::format("d{}_F{}_um", kAxes[direction], kAxes[force]);
}
std::string force_column(int axis) {
  return fmt::format("F{}_N", kAxes[axis]);
}

/// The forces of a row: force_N, or one along each axis. Errors: ID101, ID104.
Status read_forces(const csv::Table& table, const csv::Table::Row& row, MeasuredPoint& p) {
  Vec3 forces = Vec3::Zero();
  if (table.has("force_N")) {
    POLYPOD_ASSIGN(force, table.number(row, "force_N"));
    forces.setConstant(force);
  }
  for (int f = 0; f < 3; ++f) {
    if (table.text(row, force_column(f)).empty()) continue;
    POLYPOD_ASSIGN(force, table.number(row, force_column(f)));
    forces[f] = force;
  }
  for (int f = 0; f < 3; ++f) {
    if (p.given.col(f).any() && forces[f] == 0) {
      return fail("ID104",
                  fmt::format("{} is 0 or missing, but there are displacements under it",
                              table.has("force_N") ? std::string("force_N") : force_column(f)),
                  p.place, "leave displacements blank that were not measured");
    }
    if (!p.given.col(f).any()) forces[f] = 0;
  }
  p.force = forces.cwiseAbs().maxCoeff();
  if (forces != Vec3::Constant(p.force)) p.own_forces = forces;
  return {};
}

Result<MeasuredPoint> point_of(const csv::Table& table, const csv::Table::Row& row, int joints) {
  MeasuredPoint p;
  p.place = table.place_of(row);
  if (row.cells.size() < table.width()) {
    return fail("ID101", fmt::format("{} cells for {} columns", row.cells.size(), table.width()), p.place,
                "a displacement that was not measured is a blank cell between its commas");
  }
  POLYPOD_ASSIGN(x, table.number(row, "x_mm"));
  POLYPOD_ASSIGN(y, table.number(row, "y_mm"));
  POLYPOD_ASSIGN(z, table.number(row, "z_mm"));
  POLYPOD_ASSIGN(a, table.number(row, "a_deg", 0));
  POLYPOD_ASSIGN(b, table.number(row, "b_deg", 0));
  POLYPOD_ASSIGN(c, table.number(row, "c_deg", 0));
  p.X_MT =
      Pose{rotation_abc(units::from_deg(a), units::from_deg(b), units::from_deg(c)), units::from_mm(1) * Vec3(x, y, z)};
  for (int q = 1; q <= joints; ++q) {
    POLYPOD_ASSIGN(joint, table.number(row, fmt::format("q{}", q)));
    p.joints_user.push_back(joint);
  }
  POLYPOD_ASSIGN(sigma, table.number(row, "sigma_um", 0));
  if (sigma < 0) return fail("ID101", fmt::format("sigma_um = {:g} is below 0", sigma), p.place);
  p.sigma = units::from_um(sigma);
  for (int f = 0; f < 3; ++f)
    for (int d = 0; d < 3; ++d) {
      p.given(d, f) = !table.text(row, column_of(d, f)).empty();
      if (!p.given(d, f)) continue;
      POLYPOD_ASSIGN(um, table.number(row, column_of(d, f)));
      p.displacement(d, f) = units::from_um(um);
    }
  if (!p.given.any()) return fail("ID101", "the row has no displacement", p.place);
  POLYPOD_TRY(read_forces(table, row, p));
  if (p.displacement.cwiseAbs().maxCoeff() > kUnbelievable) {
    return fail("ID105",
                fmt::format("a displacement of {:g} mm: no machine deflects that far",
                            units::to_mm(p.displacement.cwiseAbs().maxCoeff())),
                p.place, "displacements are in um; are these nm, or the force in another unit?");
  }
  return p;
}

/// All that a row says, to find it again in another file.
std::vector<double> contents_of(const MeasuredPoint& p) {
  std::vector<double> out = p.joints_user;
  const auto add = [&](const auto& values) { out.insert(out.end(), values.begin(), values.end()); };
  add(p.X_MT.p);
  add(p.X_MT.R.reshaped());
  add(p.forces());
  add(p.displacement.reshaped());
  for (const bool given : p.given.reshaped()) out.push_back(given ? 1 : 0);
  return out;
}

/// The 0.95 quantile of a normal distribution of this mean and deviation that is cut off below 0.
double bound_above(double mean, double deviation) {
  const auto above = [](double z) { return 0.5 * std::erfc(z / std::sqrt(2.0)); };
  // Far below 0 the tail is that of an exponential distribution.
  const double start = -mean / deviation;
  if (start > 8) return deviation / start * 2.995732273553991;  // ln 20
  const double tail = 0.05 * above(start);
  double low = std::max(start, -8.0), high = std::max(start, 0.0) + 8;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (above(middle) > tail ? low : high) = middle;
  }
  return std::max(0.0, mean + deviation * high);
}

/// Asymmetry of the cross displacements, by pair: half the difference, each displacement at the force of its column.
struct Asymmetry {
  std::array<std::vector<double>, 3> half;  // m; of dy_Fx and dx_Fy, dz_Fx and dx_Fz, dz_Fy and dy_Fz
  double squares = 0;                       // m^2, of all
  double weighted = 0;                      // m^2, each times the weight of its row
  [[nodiscard]] std::size_t count() const { return half[0].size() + half[1].size() + half[2].size(); }
};
Asymmetry asymmetry_of(const std::vector<MeasuredPoint>& points) {
  constexpr std::array<std::pair<int, int>, 3> kPairs{{{0, 1}, {0, 2}, {1, 2}}};
  const double rms = stated_noise(points);
  Asymmetry out;
  for (const MeasuredPoint& p : points) {
    const double weight = rms > 0 ? rms / p.sigma : 1.0;
    const Vec3 forces = p.forces();
    for (std::size_t k = 0; k < kPairs.size(); ++k) {
      const auto [i, j] = kPairs[k];
      if (!p.given(i, j) || !p.given(j, i)) continue;
      // C_ij is told by both, each with the noise of a displacement over its force.
      const double size = std::sqrt(2 / (1 / (forces[i] * forces[i]) + 1 / (forces[j] * forces[j])));
      const double half = 0.5 * size * (p.displacement(i, j) / forces[j] - p.displacement(j, i) / forces[i]);
      out.half[k].push_back(half);
      out.squares += half * half;
      out.weighted += weight * weight * half * half;
    }
  }
  return out;
}

/// What half the differences say of their scatter about the mean of their pair, and of these means.
struct Scatter {
  double within = 0, freedoms = 0;  // m^2: squares about the means
  double between = 0, means = 0;    // m^2: squares that the means make, and how many there are
  double largest = 0;               // m: of the means
};
Scatter scatter_of(const Asymmetry& asymmetry) {
  Scatter out;
  for (const std::vector<double>& half : asymmetry.half) {
    if (half.size() < 2) continue;
    const auto n = double(half.size());
    const double mean = std::accumulate(half.begin(), half.end(), 0.0) / n;
    for (const double a : half) out.within += (a - mean) * (a - mean);
    out.freedoms += n - 1;
    out.between += n * mean * mean;
    ++out.means;
    out.largest = std::max(out.largest, std::abs(mean));
  }
  return out;
}

/// Whether a pair of cross displacements is off by a constant that its scatter does not explain (F test).
bool leans(const Scatter& scatter) {
  constexpr double kDigits = 1e-12;  // m, what rounding leaves
  if (!(scatter.freedoms > 0) || scatter.largest < kDigits) return false;
  const double variance = scatter.within / scatter.freedoms;
  return scatter.largest > std::sqrt(variance) &&
         scatter.between / scatter.means > f_quantile(kChance, scatter.means, scatter.freedoms) * variance;
}

/// The columns among those that are told whose standard error is more than ten times the largest compliance of their
/// kind, that the machine has or that was found to more than its own standard error.
std::vector<int> untold(const Identification& fit, const std::vector<double>& given,
                        const std::vector<double>& deviation) {
  constexpr double kTimes = 10;
  std::vector<int> out;
  const std::size_t n = fit.compliance.size();
  for (std::size_t k = 0; k < n; ++k) {
    if (!fit.told[k]) continue;
    double largest = 0;
    for (std::size_t j = 0; j < n; ++j) {
      if (fit.turns[j] != fit.turns[k]) continue;
      if (j < given.size()) largest = std::max(largest, given[j]);
      // What was found of a column that shows less is no measure for this one.
      if (fit.told[j] && deviation[j] < std::min(deviation[k], fit.compliance[j]))
        largest = std::max(largest, fit.compliance[j]);
    }
    if (largest > 0 && deviation[k] > kTimes * largest) out.push_back(static_cast<int>(k));
  }
  return out;
}

/// Least squares of the columns `kept` with c >= 0; what it finds goes into `out`. Gives the standard deviation of each
/// compliance as the readings alone tell it, whether the bound holds it or not.
/// Errors: ID112, ID116.
Result<std::vector<double>> fit_columns(const Eigen::MatrixXd& A, const Eigen::VectorXd& b,
                                        const std::vector<int>& kept, Identification& out) {
  // Columns scaled to unit length: the condition then says which joints these poses tell apart, whatever their size.
  const auto n = std::ssize(kept);
  const Eigen::VectorXd scale = A(Eigen::all, kept).colwise().norm();
  const Eigen::MatrixXd S = A(Eigen::all, kept) * scale.cwiseInverse().asDiagonal();
  const auto svd = S.jacobiSvd(Eigen::ComputeThinV);
  const Eigen::VectorXd sigma = svd.singularValues();
  out.condition = sigma[0] / sigma[n - 1];
  if (!(out.condition < kNotApart)) {
    std::string who;  // the joints of the direction that shows least
    for (Eigen::Index k = 0; k < n; ++k)
      if (std::abs(svd.matrixV()(k, n - 1)) > 0.1)
        who += (who.empty() ? "" : ", ") + out.joint[static_cast<std::size_t>(kept[static_cast<std::size_t>(k)])];
    return fail("ID112", fmt::format("not identifiable one by one from these poses: {}", who), {},
                "measure at other poses");
  }
  std::vector<bool> free;
  const Eigen::MatrixXd H = S.transpose() * S;
  const Eigen::VectorXd c = not_negative(H, S.transpose() * b, free);
  if (!(c.maxCoeff() > 0)) {
    return fail(
        "ID116", "no joint deflects along its load: the tip moves against the forces", {},
        "displacements are those of the tip in the direction of the axes, under forces on the tip; is a sign wrong?");
  }
  const double freedoms = double(out.equations) - double(n);
  const double variance = (b - S * c).squaredNorm() / freedoms;
  std::vector<double> deviations(out.compliance.size(), 0);
  const Eigen::VectorXd unscale = scale.cwiseInverse();
  const Eigen::MatrixXd inverse = H.inverse();
  out.covariance(kept, kept) = variance * (unscale.asDiagonal() * inverse * unscale.asDiagonal());
  const double t = student_95(freedoms);
  for (Eigen::Index k = 0; k < n; ++k) {
    const auto at = static_cast<std::size_t>(kept[static_cast<std::size_t>(k)]);
    const bool is_free = free[static_cast<std::size_t>(k)];
    out.compliance[at] = c[k] / scale[k];
    out.standard_error[at] = is_free ? std::sqrt(variance * inverse(k, k)) / scale[k] : 0.0;
    out.half_interval[at] = t * out.standard_error[at];
    for (Eigen::Index j = 0; j < n; ++j)
      out.correlation[at][static_cast<std::size_t>(kept[static_cast<std::size_t>(j)])] =
          inverse(k, j) / std::sqrt(inverse(k, k) * inverse(j, j));
    deviations[at] = out.standard_error[at];
    if (is_free) continue;
    // What the readings alone say of it, the others free as they are: one step of the normal equations.
    Eigen::MatrixXd Hk = H;
    Eigen::VectorXd gk = S.transpose() * b;
    for (Eigen::Index j = 0; j < n; ++j) {
      if (j == k || free[static_cast<std::size_t>(j)]) continue;
      Hk.row(j).setZero();
      Hk.col(j).setZero();
      Hk(j, j) = 1;
      gk[j] = 0;
    }
    const double best = Hk.ldlt().solve(gk)[k];
    const double deviation = std::sqrt(variance * Hk.inverse()(k, k));
    if (deviation > 0) out.upper_bound[at] = bound_above(best, deviation) / scale[k];
    deviations[at] = deviation / scale[k];
  }
  return deviations;
}

/// Of the columns that the readings do not tell and that have no compliance so far nothing is known: their standard
/// uncertainty is the largest compliance of their kind (turning, sliding), far more than most of them have.
void doubt_unknown(const std::vector<double>& given, Identification& out) {
  for (std::size_t k = 0; k < given.size(); ++k) {
    if (out.told[k] || given[k] > 0) continue;
    double largest = 0;
    for (std::size_t j = 0; j < given.size(); ++j)
      if (out.turns[j] == out.turns[k]) largest = std::max(largest, out.compliance[j]);
    out.covariance(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(k)) = largest * largest;
  }
}

/// Fits what the readings tell; the rest stays as it is in `out.compliance`. Errors: ID112, ID116.
Status fit_told(const Eigen::MatrixXd& A, const Eigen::VectorXd& b, Identification& out) {
  const auto n = static_cast<std::size_t>(A.cols());
  const std::vector<double> given = out.compliance;
  out.told.assign(n, true);
  for (std::size_t k = 0; k < n; ++k) out.told[k] = A.col(static_cast<Eigen::Index>(k)).squaredNorm() > 0;
  while (true) {
    out.standard_error.assign(n, std::numeric_limits<double>::quiet_NaN());
    out.half_interval = out.standard_error;
    out.upper_bound.assign(n, std::nullopt);
    out.correlation.assign(n, std::vector<double>(n, 0));
    out.covariance.setZero(A.cols(), A.cols());
    std::vector<int> kept;
    Eigen::VectorXd rest = b;
    for (std::size_t k = 0; k < n; ++k) {
      if (out.told[k]) {
        kept.push_back(static_cast<int>(k));
      } else {
        out.compliance[k] = given[k];
        out.covariance(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(k)) = given[k] * given[k];
        rest -= given[k] * A.col(static_cast<Eigen::Index>(k));
      }
    }
    if (kept.empty()) return fail("ID112", "these poses load no joint", {}, "measure at other poses");
    POLYPOD_ASSIGN(deviation, fit_columns(A, rest, kept, out));
    const std::vector<int> more = untold(out, given, deviation);
    if (more.empty()) {
      doubt_unknown(given, out);
      return {};
    }
    for (const int k : more) out.told[static_cast<std::size_t>(k)] = false;
  }
}

/// Noise, what is left against it, and symmetry. `squares`: of the weighted residuals, m^2.
void judge_noise(double stated, double squares, const Asymmetry& asymmetry, Identification& out) {
  // Half the difference of two readings spreads by 1 / sqrt 2 of one reading's noise.
  constexpr double kOfSignal = 0.2;
  // What the bound holds at 0 is not fitted.
  double fitted = 0;
  for (std::size_t k = 0; k < out.told.size(); ++k) fitted += out.told[k] && out.compliance[k] > 0 ? 1 : 0;
  const Scatter scatter = scatter_of(asymmetry);
  const auto pairs = double(out.pairs);
  out.noise_stated = stated > 0;
  out.misfit_freedoms = double(out.equations) - fitted - (out.noise_stated ? 0 : pairs);
  if (!out.noise_stated) squares -= 2 * asymmetry.squares;
  out.misfit = out.misfit_freedoms > 0 ? std::sqrt(std::max(0.0, squares) / out.misfit_freedoms) : 0.0;
  if (out.noise_stated) {
    out.noise = stated;
    out.noise_freedoms = std::numeric_limits<double>::infinity();
    const double most =
        pairs > 0 ? std::max(kMatters, std::sqrt(f_quantile(kChance, pairs, out.noise_freedoms))) : kMatters;
    out.symmetric = std::sqrt(2 * asymmetry.weighted) <= most * stated * std::sqrt(pairs) + 1e-12;
  } else {
    out.noise = scatter.freedoms > 0 ? std::sqrt(2 * scatter.within / scatter.freedoms) : 0.0;
    out.noise_freedoms = scatter.freedoms;
    out.symmetric = !leans(scatter) && out.asymmetry_rms <= kOfSignal * out.signal_rms;
  }
  if (out.noise_known())
    out.misfit_limit = std::max(kMatters, std::sqrt(f_quantile(kChance, out.misfit_freedoms, out.noise_freedoms)));
}

/// Of each displacement over its standard deviation; all 1 where not every row states one.
Eigen::VectorXd weights_of(const std::vector<MeasuredPoint>& points) {
  const double rms = stated_noise(points);
  Eigen::VectorXd out = Eigen::VectorXd::Ones(9 * std::ssize(points));
  if (!(rms > 0)) return out;
  for (std::size_t i = 0; i < points.size(); ++i)
    out.segment<9>(9 * static_cast<Eigen::Index>(i)).setConstant(rms / points[i].sigma);
  return out;
}

}  // namespace

Result<Displacements> read_displacements(const std::vector<std::string>& files, const csv::Columns& columns) {
  Displacements out;
  std::map<std::vector<double>, Place> seen;
  for (const std::string& path : files) {
    POLYPOD_ASSIGN(table, csv::read(path, columns));
    std::vector<std::string> needed{"x_mm", "y_mm", "z_mm"};
    bool own = false, any = false;
    for (int f = 0; f < 3; ++f) own = own || table.has(force_column(f));
    for (int f = 0; f < 3; ++f) {
      bool under = false;
      for (int d = 0; d < 3; ++d) under = under || table.has(column_of(d, f));
      if (under && own) needed.push_back(force_column(f));
      any = any || under;
    }
    if (!own) needed.emplace_back("force_N");
    if (!any) needed.push_back(column_of(0, 0));
    POLYPOD_TRY(table.needs(needed));
    if (own && table.has("force_N")) {
      return fail("ID104", "the forces are given twice: in force_N, and along each axis",
                  Place{path, table.header_line, 1}, "give force_N, or Fx_N, Fy_N and Fz_N");
    }
    int joints = 0;
    while (table.has(fmt::format("q{}", joints + 1))) ++joints;
    POLYPOD_TRY(csv::no_row_twice(table));
    for (const csv::Table::Row& row : table.rows) {
      POLYPOD_ASSIGN(p, point_of(table, row, joints));
      const auto [it, fresh] = seen.try_emplace(contents_of(p), p.place);
      if (!fresh) {
        const bool same_file = it->second.file == path;
        return fail(
            "ID103",
            fmt::format("the row is already in {}line {}", same_file ? "" : it->second.file + ", ", it->second.line),
            p.place, "a row that occurs twice would count twice");
      }
      out.points.push_back(std::move(p));
    }
    out.of_file.push_back(table.rows.size());
    POLYPOD_ASSIGN(unused, table.unused());
    for (std::string& name : unused) {
      if (std::find(out.unused_columns.begin(), out.unused_columns.end(), name) == out.unused_columns.end())
        out.unused_columns.push_back(std::move(name));
    }
  }
  return out;
}

Result<std::vector<MeasuredPoint>> read_displacements(const std::string& path) {
  POLYPOD_ASSIGN(read, read_displacements(std::vector<std::string>{path}));
  return std::move(read.points);
}

Result<machine::JointVector> joints_of(const AnyMachine& machine, const MeasuredPoint& point) {
  const auto out_of_reach = [&] {
    return fail("ID111", "the machine cannot take this pose", point.place, "check the position and the machine");
  };
  if (point.joints_user.empty()) {
    const kinematics::InverseResult inverse = kinematics::inverse(machine, point.X_MT);
    const kinematics::Solution* s = inverse.reachable();
    if (s == nullptr) return out_of_reach();
    return s->joints;
  }
  const int n = kinematics::joint_count(machine);
  if (static_cast<int>(point.joints_user.size()) != n) {
    return fail("ID147", fmt::format("{} joints q1, q2, ... for a machine that has {}", point.joints_user.size(), n),
                point.place, "give all joints that move, or leave the columns out");
  }
  machine::JointVector q(n);
  for (int i = 0; i < n; ++i) {
    const double value = point.joints_user[static_cast<std::size_t>(i)];
    q[i] = kinematics::joint_kind(machine, i) == machine::JointKind::revolute ? units::from_deg(value)
                                                                              : units::from_mm(value);
  }
  // Of several poses of a parallel machine's joints the one that the row means.
  double place = -1, angle = 0;
  for (const Pose& X : kinematics::forward_all(machine, q).poses) {
    const Pose wanted = machine::prescribed(kinematics::task(machine), point.X_MT, X);
    const double off = (wanted.p - X.p).norm(), turned = rotation_vector(X.R.transpose() * wanted.R).norm();
    if (place >= 0 &&
        place / kJointsOffPlace + angle / kJointsOffAngle <= off / kJointsOffPlace + turned / kJointsOffAngle)
      continue;
    place = off;
    angle = turned;
  }
  if (place < 0) {
    return fail("ID146", "the machine has no pose at the joints of this row", point.place,
                "check the columns q1, q2, ... (deg or mm)");
  }
  if (place > kJointsOffPlace || angle > kJointsOffAngle) {
    return fail("ID146",
                fmt::format("the joints of this row give a pose that is {:.1f} mm and {:.2f} deg off that of the row",
                            units::to_mm(place), units::to_deg(angle)),
                point.place, "check the columns q1, q2, ... (deg or mm), the pose and the machine");
  }
  const kinematics::InverseResult near = kinematics::inverse_near(machine, point.X_MT, q);
  const kinematics::Solution* s = near.reachable();
  if (s == nullptr) return out_of_reach();
  return s->joints;
}

Result<Mat3> computed_compliance(const AnyMachine& machine, const MeasuredPoint& point) {
  POLYPOD_ASSIGN(q, joints_of(machine, point));
  const std::vector<Mat3> unit = unit_compliances(machine, point.X_MT, q);
  const std::vector<double> c = column_compliances(machine);
  Mat3 C = Mat3::Zero();
  for (std::size_t k = 0; k < unit.size(); ++k) C += c[k] * unit[k];
  return C;
}

Result<Identification> identify_compliance(const AnyMachine& machine, const std::vector<MeasuredPoint>& points,
                                           double noise) {
  Identification out;
  std::vector<std::vector<Mat3>> shapes;  // per point and joint: J_k J_k^T F, columns by force axis
  for (const MeasuredPoint& point : points) {
    POLYPOD_ASSIGN(q, joints_of(machine, point));
    shapes.emplace_back();
    for (const Mat3& share : unit_compliances(machine, point.X_MT, q)) shapes.back().push_back(point.computed(share));
    out.equations += point.equations();
  }
  const int n = shapes.empty() ? 0 : static_cast<int>(shapes[0].size());
  if (out.equations <= static_cast<std::size_t>(n)) {
    return fail("ID110", fmt::format("{} equations for {} compliances", out.equations, n), {}, "measure more points");
  }
  // Displacements that were not measured are rows of zeros.
  const auto rows = static_cast<Eigen::Index>(9 * points.size());
  Eigen::MatrixXd A(rows, n);
  Eigen::VectorXd b(rows);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int k = 0; k < n; ++k) A.block<9, 1>(9 * i, k) = shapes[i][k].reshaped();
    b.segment<9>(9 * i) = points[i].displacement.reshaped();
  }
  const Asymmetry asymmetry = asymmetry_of(points);
  out.pairs = asymmetry.count();
  if (out.pairs > 0) out.asymmetry_rms = std::sqrt(asymmetry.squares / double(out.pairs));
  out.turns = column_turns(machine);
  out.joint = column_names(machine);
  const std::vector<double> given = column_compliances(machine);
  out.compliance = given;
  out.compliance.resize(static_cast<std::size_t>(n), 0);
  const Eigen::VectorXd weight = weights_of(points);
  POLYPOD_TRY(fit_told(weight.asDiagonal() * A, weight.cwiseProduct(b), out));
  const Eigen::VectorXd r =
      b - A * Eigen::Map<const Eigen::VectorXd>(out.compliance.data(), std::ssize(out.compliance));
  double times = 0, counted = 0;
  for (std::size_t k = 0; k < given.size(); ++k) {
    if (!(given[k] > 0) || !out.told[k]) continue;
    times += out.compliance[k] / given[k];
    ++counted;
  }
  if (counted > 0) out.times_given = times / counted;
  out.residual_rms = std::sqrt(r.squaredNorm() / double(out.equations));
  out.signal_rms = std::sqrt(b.squaredNorm() / double(out.equations));
  out.explained = 1 - r.squaredNorm() / b.squaredNorm();
  judge_noise(noise > 0 ? noise : stated_noise(points), weight.cwiseProduct(r).squaredNorm(), asymmetry, out);
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < k; ++j)
      if (std::abs(out.correlation[std::size_t(k)][std::size_t(j)]) > kAlike) out.hardly_apart.push_back({j, k});
  Eigen::VectorXd measured(static_cast<Eigen::Index>(out.equations));
  Eigen::Index filled = 0;
  for (std::size_t i = 0; i < points.size(); ++i)
    for (int k = 0; k < 9; ++k)
      if (const auto at = 9 * static_cast<Eigen::Index>(i) + k; points[i].given(k % 3, k / 3))
        measured[filled++] = weight[at] * r[at];
  const double limit = kOutlier * robust_deviation(measured);
  for (std::size_t i = 0; i < points.size(); ++i) {
    out.residuals.push_back(r.segment<9>(9 * i).reshaped(3, 3));
    for (int f = 0; f < 3; ++f)
      for (int d = 0; d < 3; ++d)
        if (weight[9 * static_cast<Eigen::Index>(i)] * std::abs(out.residuals.back()(d, f)) > limit)
          out.outliers.push_back({i, d, f, out.residuals.back()(d, f)});
  }
  return out;
}

Result<double> prediction_rms(const AnyMachine& machine, const std::vector<MeasuredPoint>& points) {
  double sum = 0, count = 0;
  for (const MeasuredPoint& point : points) {
    POLYPOD_ASSIGN(C, computed_compliance(machine, point));
    sum += (point.displacement - point.computed(C)).squaredNorm();
    count += double(point.equations());
  }
  return points.empty() ? 0.0 : std::sqrt(sum / count);
}

}  // namespace polypod::statics
