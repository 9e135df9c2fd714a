// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/dynamics.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "../families/all_masses.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/motion/tables.hpp"
#include "polypod/motion/vibration.hpp"

namespace polypod::motion {
namespace {

using SeriesVec = Vector3<Series>;

struct MassPoint {
  double mass = 0;
  SeriesVec p;
};

SeriesVec scaled(const SeriesVec& v, const Series& by) {
  return {v[0] * by, v[1] * by, v[2] * by};
}
Series length_of(const SeriesVec& v) {
  return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}
/// Seven points that have the mass, the center and the inertia of a body: two at a metre on each principal axis of its
/// second moments, the rest (which may be negative) in the center.
template <class Push>
void add_body(const PoseSeries& X, const Body& body, Push&& push) {
  const Mat3 second = 0.5 * body.inertia.trace() * Mat3::Identity() - body.inertia;
  const Eigen::SelfAdjointEigenSolver<Mat3> axes(second);
  double rest = body.mass;
  for (int k = 0; k < 3; ++k) {
    const double mass = 0.5 * axes.eigenvalues()[k];
    if (mass == 0) continue;
    for (const double side : {-1.0, 1.0})
      push(mass, machine::moved_point(X, body.center + side * axes.eigenvectors().col(k)));
    rest -= 2 * mass;
  }
  if (rest != 0) push(rest, machine::moved_point(X, body.center));
}

/// Points on a line that goes from `foot` through `head`: mass and inertia across it, at a distance from the foot.
template <class Push>
void add_on_line(const SeriesVec& foot, const SeriesVec& head, double mass, double center, double inertia,
                 Push&& push) {
  if (mass == 0 && inertia == 0) return;
  const SeriesVec y = head - foot;
  const SeriesVec e = scaled(y, Series(1.0) / length_of(y));
  const auto point = [&](double d) { return SeriesVec(foot + scaled(e, Series(d))); };
  // Two points at a metre from the center have 2 m 1^2.
  const double side = 0.5 * inertia;
  if (side != 0) {
    push(side, point(center - 1));
    push(side, point(center + 1));
  }
  if (mass - 2 * side != 0) push(mass - 2 * side, point(center));
}

/// A uniform rod: Simpson's rule has its mass, center and inertia.
template <class Push>
void add_rod(const SeriesVec& a, const SeriesVec& b, double mass, Push&& push) {
  if (mass == 0) return;
  push(mass / 6, a);
  push(mass / 6, b);
  push(2 * mass / 3, SeriesVec(scaled(a + b, Series(0.5))));
}

/// Every mass point at a pose and joints that move.
template <class M>
std::vector<MassPoint> points_of(const M& m, const Dynamics& d, const PoseSeries& X, std::span<const Series> q) {
  std::vector<MassPoint> out;
  const auto push = [&](double mass, const SeriesVec& p) { out.push_back({mass, p}); };
  if (d.platform) add_body(X, *d.platform, push);
  if (d.payload) add_body(X, *d.payload, push);
  const std::vector<double> nominal = kinematics::nominal_parameters(m);
  const std::vector<Series> p(nominal.begin(), nominal.end());
  if constexpr (requires { mass_link(m, std::size_t{}, q, std::span<const Series>(p)); }) {
    for (std::size_t row = 0; row < d.links.size(); ++row) {
      if (d.links[row]) add_body(mass_link(m, row, q, std::span<const Series>(p)), *d.links[row], push);
    }
  }
  const bool legs = d.strut_fixed != 0 || d.strut_moving != 0 || d.strut_fixed_inertia != 0 ||
                    d.strut_moving_inertia != 0 || d.rod != 0 || d.slider != 0 || d.arm != 0 || d.arm_inertia != 0;
  if (!legs) return out;
  for (const machine::MassLeg& leg : legs_with_mass(m, X, q, std::span<const Series>(p))) {
    if (leg.strut) {
      add_on_line(leg.fixed, leg.platform, d.strut_fixed, d.strut_fixed_center, d.strut_fixed_inertia, push);
      add_on_line(leg.platform, leg.fixed, d.strut_moving, d.strut_moving_center, d.strut_moving_inertia, push);
      continue;
    }
    add_rod(leg.driven, leg.platform, d.rod, push);
    if (leg.rail && d.slider != 0) push(d.slider, leg.driven);
    // About its axis an arm has the inertia of points along it.
    if (leg.crank) {
      add_on_line(leg.fixed, leg.driven, d.arm, d.arm_center, d.arm_inertia - d.arm * d.arm_center * d.arm_center,
                  push);
    }
  }
  return out;
}

double of_drive(const std::vector<double>& values, Eigen::Index i) {
  if (values.empty()) return 0;
  return values[values.size() == 1 ? 0 : static_cast<std::size_t>(i)];
}

/// Derivatives of every mass point by each column of J, a twist of the tool at which the joint of that number moves
/// with it (-1: none does): one matrix 3 x columns a point.
template <class M>
std::vector<Eigen::Matrix<double, 3, Eigen::Dynamic>> rates_of(const M& m, const Dynamics& d, const Pose& X,
                                                               const JointVector& q, const Eigen::MatrixXd& J,
                                                               const std::vector<int>& joint) {
  std::vector<Eigen::Matrix<double, 3, Eigen::Dynamic>> out;
  for (Eigen::Index j = 0; j < J.cols(); ++j) {
    PoseSeries moved = X.cast<Series>();  // in first order
    const Mat3 rate = skew(Vec3(J(3, j), J(4, j), J(5, j))) * X.R;
    for (int i = 0; i < 3; ++i) {
      moved.p[i][1] = J(i, j);
      for (int c = 0; c < 3; ++c) moved.R(i, c)[1] = rate(i, c);
    }
    std::vector<Series> joints(q.data(), q.data() + q.size());
    const int moves = joint[static_cast<std::size_t>(j)];
    if (moves >= 0) joints[static_cast<std::size_t>(moves)][1] = 1;
    const std::vector<MassPoint> points = points_of(m, d, moved, std::span<const Series>(joints));
    if (out.empty()) out.assign(points.size(), Eigen::Matrix<double, 3, Eigen::Dynamic>::Zero(3, J.cols()));
    for (std::size_t k = 0; k < points.size(); ++k)
      for (int i = 0; i < 3; ++i) out[k](i, j) = points[k].p[i][1];
  }
  return out;
}

std::vector<int> all_joints(Eigen::Index n) {
  std::vector<int> out;
  for (int j = 0; j < n; ++j) out.push_back(j);
  return out;
}

template <class M>
std::vector<MassPoint> moving_points(const M& m, const Dynamics& d, const JointSeries& s) {
  std::vector<Series> q;
  for (Eigen::Index i = 0; i < s.q.size(); ++i) q.emplace_back(s.q[i], s.first[i], s.second[i], s.third[i]);
  return points_of(m, d, s.X, std::span<const Series>(q));
}

Pose value_of(const PoseSeries& X) {
  Pose out;
  for (int i = 0; i < 3; ++i) {
    out.p[i] = X.p[i].value();
    for (int j = 0; j < 3; ++j) out.R(i, j) = X.R(i, j).value();
  }
  return out;
}

Result<Body> body_of(const config::Table& given) {
  const config::Table* table = &given;
  Body out;
  POLYPOD_ASSIGN(mass, table->number("mass_kg", {0, 1e6}));
  out.mass = mass;
  if (table->has("center_mm")) {
    POLYPOD_ASSIGN(c, table->numbers("center_mm", 3));
    out.center = units::from_mm(1) * Vec3(c[0], c[1], c[2]);
  }
  if (table->has("inertia_kg_m2")) {
    POLYPOD_ASSIGN(I, table->numbers("inertia_kg_m2"));
    if (I.size() != 3 && I.size() != 6) {
      return fail("MO120", "an inertia has the three numbers xx, yy, zz, or six with xy, xz, yz",
                  table->place_of("inertia_kg_m2"));
    }
    I.resize(6, 0);
    out.inertia << I[0], I[3], I[4], I[3], I[1], I[5], I[4], I[5], I[2];
    const Vec3 principal = Eigen::SelfAdjointEigenSolver<Mat3>(out.inertia).eigenvalues();
    constexpr double kRounding = 1e-9, kMeasured = 1.25;
    out.rigid = principal[0] + principal[1] >= principal[2] * (1 - kRounding);
    if (principal[0] < 0 || kMeasured * (principal[0] + principal[1]) < principal[2]) {
      return fail(
          "MO120",
          fmt::format("no body has the principal moments {:g}, {:g}, {:g} kg m2: none is larger than the sum of "
                      "the others",
                      principal[0], principal[1], principal[2]),
          table->place_of("inertia_kg_m2"), "give it about the center of mass");
    }
  }
  POLYPOD_TRY(table->finish());
  return out;
}
Result<std::optional<Body>> body_from(const config::Table& parent, const char* key) {
  POLYPOD_ASSIGN(table, parent.optional_table(key));
  if (!table) return std::optional<Body>{};
  POLYPOD_ASSIGN(body, body_of(*table));
  return std::optional<Body>(body);
}

tl::unexpected<Error> no_part(const config::Table& table, const char* key, const char* part) {
  return fail("MO121", fmt::format("dynamics.{}: this machine has no {}", key, part), table.place_of(key),
              "leave it out");
}

Result<std::optional<double>> damping_of(const config::Table& table) {
  if (!table.has("damping_ratio")) return std::optional<double>{};
  POLYPOD_ASSIGN(ratio, table.number("damping_ratio", {0, 1}));
  return std::optional<double>(ratio);
}

}  // namespace

Result<Dynamics> dynamics_from(const config::Table& table, const AnyMachine& machine) {
  Dynamics out;
  const machine::MassParts parts = std::visit([](const auto& m) { return parts_with_mass(m); }, machine);
  if (kinematics::hangs_down(machine)) out.gravity = -out.gravity;
  if (table.has("gravity_m_per_s2")) {
    POLYPOD_ASSIGN(g, table.numbers("gravity_m_per_s2", 3, {-1000, 1000}));
    out.gravity = Vec3(g[0], g[1], g[2]);
    out.gravity_given = true;
  }
  POLYPOD_ASSIGN(platform, body_from(table, "platform"));
  out.platform = platform;
  POLYPOD_ASSIGN(payload, body_from(table, "payload"));
  out.payload = payload;
  POLYPOD_ASSIGN(strut, table.optional_table("strut"));
  if (strut) {
    if (!parts.struts) return no_part(table, "strut", "struts");
    const auto take = [&](const char* mass_key, const char* center_key, const char* inertia_key, double& mass,
                          double& center, double& inertia) -> Status {
      POLYPOD_ASSIGN(m, strut->optional_number(mass_key, 0, {0, 1e6}));
      POLYPOD_ASSIGN(c, strut->optional_number(center_key, 0, {-1e5, 1e5}));
      POLYPOD_ASSIGN(I, strut->optional_number(inertia_key, 0, {0, 1e6}));
      mass = m;
      center = units::from_mm(c);
      inertia = I;
      return {};
    };
    POLYPOD_TRY(take("fixed_mass_kg", "fixed_center_mm", "fixed_inertia_kg_m2", out.strut_fixed, out.strut_fixed_center,
                     out.strut_fixed_inertia));
    POLYPOD_TRY(take("moving_mass_kg", "moving_center_mm", "moving_inertia_kg_m2", out.strut_moving,
                     out.strut_moving_center, out.strut_moving_inertia));
    POLYPOD_TRY(strut->finish());
  }
  POLYPOD_ASSIGN(rod, table.optional_number("rod_kg", 0, {0, 1e6}));
  if (rod > 0 && !parts.rods) return no_part(table, "rod_kg", "rods");
  out.rod = rod;
  POLYPOD_ASSIGN(slider, table.optional_number("slider_kg", 0, {0, 1e6}));
  if (slider > 0 && !parts.sliders) return no_part(table, "slider_kg", "sliders");
  out.slider = slider;
  POLYPOD_ASSIGN(arm, table.optional_table("arm"));
  if (arm) {
    if (!parts.arms) return no_part(table, "arm", "arms");
    POLYPOD_ASSIGN(mass, arm->number("mass_kg", {0, 1e6}));
    POLYPOD_ASSIGN(center, arm->optional_number("center_mm", 0, {-1e5, 1e5}));
    POLYPOD_ASSIGN(inertia, arm->optional_number("inertia_kg_m2", mass * square(units::from_mm(center)), {0, 1e6}));
    POLYPOD_TRY(arm->finish());
    out.arm = mass;
    out.arm_center = units::from_mm(center);
    out.arm_inertia = inertia;
    constexpr double kRounding = 1e-9;
    if (inertia < mass * square(out.arm_center) * (1 - kRounding)) {
      return fail("MO120",
                  fmt::format("dynamics.arm: {:g} kg at {:g} mm have more than {:g} kg m2 about the drive's axis", mass,
                              center, inertia),
                  arm->place_of("inertia_kg_m2"), "give it about the drive's axis");
    }
  }
  POLYPOD_ASSIGN(links, table.tables("link"));
  if (!links.empty()) {
    if (parts.links == 0) return no_part(table, "link", "links");
    if (static_cast<int>(links.size()) != parts.links) {
      return fail("MO122",
                  fmt::format("dynamics has {} links, the table of the arm {} rows", links.size(), parts.links),
                  table.place_of("link"), "give one a row, with mass_kg = 0 for those without mass");
    }
    for (const config::Table& link : links) {
      POLYPOD_ASSIGN(body, body_of(link));
      out.links.emplace_back(body);
    }
  }
  const int n = kinematics::joint_count(machine);
  const auto per_drive = [&](const char* key, std::vector<double>& to) -> Status {
    if (!table.has(key)) return {};
    if (const auto one = table.number(key, {0, 1e9})) {
      to = {*one};
      return {};
    }
    POLYPOD_ASSIGN(values, table.numbers(key, 0, {0, 1e9}));
    if (values.size() != 1 && static_cast<int>(values.size()) != n) {
      return fail("MO122", fmt::format("dynamics.{} has {} numbers, the machine {} drives", key, values.size(), n),
                  table.place_of(key), "give one number for all drives, or one a drive");
    }
    to = values;
    return {};
  };
  POLYPOD_TRY(per_drive("drive_inertia", out.drive));
  POLYPOD_TRY(per_drive("friction", out.friction));
  POLYPOD_TRY(per_drive("viscous", out.viscous));
  POLYPOD_TRY(damping_of(table));  // of vibration alone: read_damping
  POLYPOD_TRY(table.finish());
  return out;
}

namespace {
/// The table `dynamics` of the TOML file at this path, and what it lies in; nothing where there is none.
struct OpenTable {
  config::Table file;
  config::Table table;
};
Result<std::optional<OpenTable>> dynamics_table(const std::string& path) {
  std::error_code ec;
  if (!std::filesystem::is_regular_file(path, ec)) return std::optional<OpenTable>{};
  Result<config::Table> read = config::read_file(path);
  if (!read && !path.ends_with(".toml")) return std::optional<OpenTable>{};  // a URDF file
  POLYPOD_ASSIGN(file, std::move(read));
  POLYPOD_ASSIGN(table, file.optional_table("dynamics"));
  if (!table) return std::optional<OpenTable>{};
  return std::optional<OpenTable>(OpenTable{std::move(file), std::move(*table)});
}
}  // namespace

Result<std::optional<Dynamics>> read_dynamics(const std::string& path, const AnyMachine& machine) {
  POLYPOD_ASSIGN(open, dynamics_table(path));
  if (!open) return std::optional<Dynamics>{};
  POLYPOD_ASSIGN(out, dynamics_from(open->table, machine));
  return std::optional<Dynamics>(std::move(out));
}

Result<std::optional<double>> read_damping(const std::string& path) {
  POLYPOD_ASSIGN(open, dynamics_table(path));
  if (!open) return std::optional<double>{};
  return damping_of(open->table);
}

std::vector<std::string> Dynamics::parts_with_mass() const {
  std::vector<std::string> out;
  const auto weighs = [](const std::optional<Body>& body) {
    return body && (body->mass > 0 || !body->inertia.isZero(0));
  };
  if (weighs(platform)) out.emplace_back("platform");
  if (weighs(payload)) out.emplace_back("payload");
  if (std::any_of(links.begin(), links.end(), weighs)) out.emplace_back("links");
  if (strut_fixed > 0 || strut_moving > 0 || strut_fixed_inertia > 0 || strut_moving_inertia > 0)
    out.emplace_back("struts");
  if (rod > 0) out.emplace_back("rods");
  if (slider > 0) out.emplace_back("sliders");
  if (arm > 0 || arm_inertia > 0) out.emplace_back("arms");
  if (std::any_of(drive.begin(), drive.end(), [](double x) { return x > 0; })) out.emplace_back("drives");
  return out;
}

std::vector<std::string> Dynamics::not_rigid() const {
  std::vector<std::string> out;
  if (platform && !platform->rigid) out.emplace_back("platform");
  if (payload && !payload->rigid) out.emplace_back("payload");
  for (std::size_t i = 0; i < links.size(); ++i) {
    if (links[i] && !links[i]->rigid) out.push_back(fmt::format("link {}", i + 1));
  }
  return out;
}

std::string no_dynamics(const AnyMachine& machine) {
  std::string why = std::visit([](const auto& m) { return why_no_masses(m); }, machine);
  if (!why.empty()) return why;
  if (kinematics::joint_count(machine) != kinematics::task(machine).size()) {
    return "the machine has more drives than its task has coordinates: how they share the load is not determined";
  }
  return {};
}

JointVector drive_forces(const AnyMachine& machine, const Dynamics& d, const JointSeries& motion) {
  const Pose X = value_of(motion.X);
  const machine::JacobianMatrix J = kinematics::jacobian(machine, X, motion.q);
  JointVector tau = JointVector::Zero(motion.q.size());
  std::visit(
      [&](const auto& m) {
        const std::vector<MassPoint> points = moving_points(m, d, motion);
        const auto rates = rates_of(m, d, X, motion.q, J, all_joints(motion.q.size()));
        for (std::size_t k = 0; k < points.size(); ++k) {
          Vec3 a;
          for (int i = 0; i < 3; ++i) a[i] = points[k].p[i].derivative(2);
          tau += points[k].mass * rates[k].transpose() * (a - d.gravity);
        }
      },
      machine);
  for (Eigen::Index j = 0; j < tau.size(); ++j) {
    const double v = motion.first[j];
    tau[j] += of_drive(d.drive, j) * motion.second[j] + of_drive(d.viscous, j) * v;
    if (v != 0) tau[j] += std::copysign(of_drive(d.friction, j), v);
  }
  return tau;
}

namespace {
/// visit(m, dP/dx) for each mass point.
template <class Visit>
void mass_points(const AnyMachine& machine, const Dynamics& d, const Pose& X, const JointVector& q,
                 const Eigen::MatrixXd& J, const std::vector<int>& joint, Visit&& visit) {
  std::visit(
      [&](const auto& m) {
        std::vector<Series> joints(q.data(), q.data() + q.size());
        const std::vector<MassPoint> points = points_of(m, d, X.cast<Series>(), std::span<const Series>(joints));
        const auto rates = rates_of(m, d, X, q, J, joint);
        for (std::size_t k = 0; k < points.size(); ++k) visit(points[k].mass, rates[k]);
      },
      machine);
}
/// Sum of m (dP/dx)^T dP/dx over the mass points.
Eigen::MatrixXd mass_by(const AnyMachine& machine, const Dynamics& d, const Pose& X, const JointVector& q,
                        const Eigen::MatrixXd& J, const std::vector<int>& joint) {
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(J.cols(), J.cols());
  mass_points(machine, d, X, q, J, joint,
              [&](double mass, const auto& rates) { M += mass * rates.transpose() * rates; });
  return M;
}
}  // namespace

Eigen::MatrixXd mass_matrix(const AnyMachine& machine, const Dynamics& d, const Pose& X, const JointVector& q) {
  Eigen::MatrixXd M = mass_by(machine, d, X, q, kinematics::jacobian(machine, X, q), all_joints(q.size()));
  for (Eigen::Index j = 0; j < q.size(); ++j) M(j, j) += of_drive(d.drive, j);
  return M;
}

Energy energy_of(const AnyMachine& machine, const Dynamics& d, const JointSeries& motion) {
  Energy out;
  std::visit(
      [&](const auto& m) {
        for (const MassPoint& point : moving_points(m, d, motion)) {
          Vec3 p, v;
          for (int i = 0; i < 3; ++i) {
            p[i] = point.p[i].value();
            v[i] = point.p[i].derivative(1);
          }
          out.kinetic += 0.5 * point.mass * v.squaredNorm();
          out.potential -= point.mass * d.gravity.dot(p);
        }
      },
      machine);
  for (Eigen::Index j = 0; j < motion.q.size(); ++j) {
    out.kinetic += 0.5 * of_drive(d.drive, j) * motion.first[j] * motion.first[j];
  }
  return out;
}

namespace {
/// The machine on the compliances of its elements, its drives locked: x = C^(1/2) y, (1 - w^2 S) y = 0 with
/// S = C^(1/2) M C^(1/2), which is scaled_mass.
struct Yielding {
  Pose X_MT;
  Eigen::MatrixXd J;         ///< twist of the tool by x, [m; rad] in M
  Eigen::VectorXd root;      ///< of the compliances
  std::vector<int> joint;    ///< that moves with each
  Mat6 held = Mat6::Zero();  ///< compliance of the tool by locked joints, which move no mass here
};
Yielding yielding_of(const AnyMachine& machine, const Pose& X, const JointVector& q) {
  const std::vector<machine::Element> elements = kinematics::elements(machine);
  const machine::ElementColumns columns = kinematics::element_columns(machine, q, &X);
  std::vector<int> used;
  std::vector<double> root;  // of the compliances
  Yielding out;
  out.X_MT = columns.X_MT;
  for (int k = 0; k < static_cast<int>(elements.size()); ++k) {
    const double c = elements[static_cast<std::size_t>(k)].compliance;
    const int moves = std::visit([k](const auto& m) { return joint_moved_by(m, k); }, machine);
    if (moves == machine::kHeldJoint) {
      out.held += c * columns.J.col(k) * columns.J.col(k).transpose();
      continue;
    }
    if (!(c > 0)) continue;
    used.push_back(k);
    out.joint.push_back(moves);
    root.push_back(std::sqrt(c));
  }
  if (used.empty()) return out;
  out.J.resize(6, static_cast<Eigen::Index>(used.size()));
  for (std::size_t k = 0; k < used.size(); ++k) out.J.col(static_cast<Eigen::Index>(k)) = columns.J.col(used[k]);
  out.root = Eigen::Map<const Eigen::VectorXd>(root.data(), static_cast<Eigen::Index>(root.size()));
  return out;
}
Eigen::MatrixXd scaled_mass(const AnyMachine& machine, const Dynamics& d, const JointVector& q, const Yielding& soft) {
  return soft.root.asDiagonal() * mass_by(machine, d, soft.X_MT, q, soft.J, soft.joint) * soft.root.asDiagonal();
}
// Of the largest 1 / w^2: what moves less mass than that moves none, and has no frequency.
constexpr double kNone = 1e-12;
}  // namespace

std::vector<double> natural_frequencies(const AnyMachine& machine, const Dynamics& d, const Pose& X,
                                        const JointVector& q) {
  const Yielding soft = yielding_of(machine, X, q);
  std::vector<double> out;
  if (soft.root.size() == 0) return out;
  const Eigen::VectorXd values =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(scaled_mass(machine, d, q, soft)).eigenvalues();
  for (Eigen::Index k = values.size(); k-- > 0;) {
    if (values[k] > kNone * values[values.size() - 1]) out.push_back(1 / (2 * std::numbers::pi * std::sqrt(values[k])));
  }
  return out;
}

ModalModel modal_model(const AnyMachine& machine, const Dynamics& d, const Pose& X, const JointVector& q) {
  const Yielding soft = yielding_of(machine, X, q);
  ModalModel out;
  out.X_MT = soft.X_MT;
  out.rest = soft.held;
  if (soft.root.size() == 0) return out;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled_mass(machine, d, q, soft));
  const Eigen::VectorXd& values = solver.eigenvalues();
  const Eigen::MatrixXd shapes = soft.J * soft.root.asDiagonal() * solver.eigenvectors();  // of unit y
  const double largest = values[values.size() - 1];
  for (Eigen::Index k = values.size(); k-- > 0;) {
    const Vec6 shape = shapes.col(k);
    if (largest > 0 && values[k] > kNone * largest) {
      // y^T S y = 1 / w^2, so w y has the modal mass 1.
      const double own = 1 / std::sqrt(values[k]);
      out.modes.push_back({own / (2 * std::numbers::pi), own * shape});
    } else {
      out.rest += shape * shape.transpose();
    }
  }
  return out;
}

Vec6 weight_twist(const AnyMachine& machine, const Dynamics& d, const Pose& X, const JointVector& q) {
  const Yielding soft = yielding_of(machine, X, q);
  if (soft.root.size() == 0) return Vec6::Zero();
  Eigen::VectorXd weight = Eigen::VectorXd::Zero(soft.root.size());
  mass_points(machine, d, soft.X_MT, q, soft.J, soft.joint,
              [&](double mass, const auto& rates) { weight += mass * rates.transpose() * d.gravity; });
  return soft.J * soft.root.cwiseAbs2().cwiseProduct(weight);
}

}  // namespace polypod::motion
