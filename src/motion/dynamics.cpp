// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/dynamics.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <span>
#include <tuple>

#include "../families/all_masses.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/machine/whole_table.hpp"
#include "polypod/motion/tables.hpp"
#include "polypod/motion/vibration.hpp"

namespace polypod::motion {
namespace {

using kinematics::Dual;
/// Twists, one a column.
using Columns = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// A body by its origin and its three axes, v_0 to v_3:
///   kinetic energy sum_ij G_ij v_i' . v_j' / 2,  weight m g at the center,  G = [m, m c^T; m c, S + m c c^T]
/// with the second moments S = tr(I) / 2 - I about its center c (the body's pseudo-inertia: Wensing, Kim and Slotine
/// 2018). Bodies on one frame add up.
using BodyMasses = Eigen::Matrix4d;
BodyMasses masses_of(const Body& body) {
  BodyMasses G;
  const Vec3 mc = body.mass * body.center;
  G << body.mass, mc.transpose(), mc,
      0.5 * body.inertia.trace() * Mat3::Identity() - body.inertia + mc * body.center.transpose();
  return G;
}

/// What lies on a line from a to b, by the vectors v = a, b and the direction e = (b - a) / |b - a|: G as of a body.
struct LineMasses {
  Mat3 G = Mat3::Zero();

  /// A mass at an end (0: a, 1: b) and a distance from there along e.
  void add(int end, double mass, double along = 0) {
    G(end, end) += mass;
    G(end, 2) += mass * along;
    G(2, end) += mass * along;
    G(2, 2) += mass * square(along);
  }
  /// A uniform rod.
  void add_rod(double mass) { G.topLeftCorner<2, 2>() += mass / 6 * Eigen::Matrix2d{{2, 1}, {1, 2}}; }
  [[nodiscard]] bool turns() const { return !G.col(2).isZero(0); }
  /// What weighs at each vector: the line moved as a whole moves a and b, not e.
  [[nodiscard]] Vec3 weight() const { return G.col(0) + G.col(1); }
};

template <class T>
using Vectors = Eigen::Matrix<T, 3, Eigen::Dynamic, Eigen::ColMajor, 3, 4>;

/// Origin and axes.
template <class T>
Vectors<T> vectors_of(const PoseT<T>& X) {
  Vectors<T> out(3, 4);
  out << X.p, X.R;
  return out;
}
/// a, b and, where masses hang on it, e.
template <class T>
Vectors<T> vectors_of(const Vector3<T>& a, const Vector3<T>& b, const LineMasses& masses) {
  Vectors<T> out(3, 3);
  out.col(0) = a;
  out.col(1) = b;
  out.col(2).setConstant(T(0.0));
  if (!masses.turns()) return out;
  const Vector3<T> y = b - a;
  const T scale = T(1.0) / sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
  for (int k = 0; k < 3; ++k) out(k, 2) = y[k] * scale;
  return out;
}

/// Every part with mass at a pose and joints: take.body(X, masses), take.line(a, b, masses). What stands on a base that
/// moves is given with it (null: M).
template <class M, class T, class Take>
void each_part(const M& m, const Dynamics& d, const PoseT<T>& X, std::span<const T> q, const PoseT<T>* base,
               Take& take) {
  if constexpr (requires { mass_stages(m); }) {
    each_mass_stage(m, X, q,
                    [&](std::size_t k, const PoseT<T>& own_base, const PoseT<T>& tool, std::span<const T> joints) {
                      if (k >= d.stages.size()) return;
                      const PoseT<T> moved = base != nullptr ? *base * own_base : own_base;
                      std::visit([&](const auto& stage) { each_part(stage, d.stages[k], tool, joints, &moved, take); },
                                 mass_stages(m)[k]);
                    });
  }
  const auto body = [&](const PoseT<T>& frame, const BodyMasses& masses) {
    take.body(base != nullptr ? *base * frame : frame, masses);
  };
  const auto line = [&](const Vector3<T>& a, const Vector3<T>& b, const LineMasses& masses) {
    if (masses.G.isZero(0)) return;
    if (base != nullptr) return take.line(*base * a, *base * b, masses);
    take.line(a, b, masses);
  };
  if (d.platform || d.payload) {
    body(X, masses_of(d.platform.value_or(Body{})) + masses_of(d.payload.value_or(Body{})));
  }
  if constexpr (requires { mass_links(m, q); }) {
    if (!d.links.empty()) {
      const std::vector<PoseT<T>> frames = mass_links(m, q);
      for (std::size_t row = 0; row < d.links.size(); ++row)
        if (d.links[row]) body(frames[row], masses_of(*d.links[row]));
    }
  }
  LineMasses strut, rod, arm;
  strut.add(0, d.strut_fixed, d.strut_fixed_center);
  strut.add(1, d.strut_moving, -d.strut_moving_center);
  strut.G(2, 2) += d.strut_fixed_inertia + d.strut_moving_inertia;
  rod.add_rod(d.rod);
  arm.add(0, d.arm, d.arm_center);
  arm.G(2, 2) = d.arm_inertia;  // about the pivot
  LineMasses rail = rod;
  rail.add(0, d.slider);
  if (strut.G.isZero(0) && arm.G.isZero(0) && rail.G.isZero(0)) return;
  for (const machine::MassLeg<T>& leg : legs_with_mass(m, X, q)) {
    if (leg.strut) {
      line(leg.fixed, leg.platform, strut);
      continue;
    }
    line(leg.driven, leg.platform, leg.rail ? rail : rod);
    if (leg.crank) line(leg.fixed, leg.driven, arm);
  }
}
template <class M, class T, class Take>
void each_part(const M& m, const Dynamics& d, const PoseT<T>& X, std::span<const T> q, Take&& take) {
  each_part(m, d, X, q, static_cast<const PoseT<T>*>(nullptr), take);
}

double of_drive(const std::vector<double>& values, Eigen::Index i) {
  if (values.empty()) return 0;
  return values[values.size() == 1 ? 0 : static_cast<std::size_t>(i)];
}

/// visit(first, count, X, q) for the columns of J, six a pass: pose and joints on dual numbers, whose part j is the
/// derivative by column first + j. A column is a twist of the tool at which the joint of that number moves with it (-1:
/// none).
template <class Visit>
void each_rate(const Pose& X, const JointVector& q, const Eigen::Ref<const Columns>& J, std::span<const int> joint,
               Visit&& visit) {
  std::vector<Dual> joints(q.data(), q.data() + q.size());
  for (Eigen::Index first = 0; first < J.cols(); first += 6) {
    const Eigen::Index count = std::min<Eigen::Index>(6, J.cols() - first);
    PoseT<Dual> moved = X.cast<Dual>();
    for (Eigen::Index j = 0; j < count; ++j) {
      const auto column = J.col(first + j);
      const Mat3 rate = skew(Vec3(column.tail<3>())) * X.R;
      for (int i = 0; i < 3; ++i) {
        moved.p[i].v[j] = column[i];
        for (int c = 0; c < 3; ++c) moved.R(i, c).v[j] = rate(i, c);
      }
      const int moves = joint[static_cast<std::size_t>(first + j)];
      if (moves >= 0) joints[static_cast<std::size_t>(moves)].v[j] = 1;
    }
    visit(first, count, moved, std::span<const Dual>(joints));
    for (Dual& value : joints) value.v.setZero();
  }
}

/// 0, 1, ...: each column of a Jacobian is that of its joint.
std::span<const int> all_joints(Eigen::Index n) {
  static constexpr std::array<int, machine::kMaxJoints> kEach{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
  return std::span<const int>(kEach).first(static_cast<std::size_t>(n));
}

std::vector<Series> joints_of(const JointSeries& s) {
  std::vector<Series> out;
  out.reserve(static_cast<std::size_t>(s.q.size()));
  for (Eigen::Index i = 0; i < s.q.size(); ++i) out.emplace_back(s.q[i], s.first[i], s.second[i], s.third[i]);
  return out;
}

/// The derivative of this order, of numbers on series.
template <int Rows, int Columns>
Eigen::Matrix<double, Rows, Columns> derivative(const Eigen::Matrix<Series, Rows, Columns>& of, int order) {
  Eigen::Matrix<double, Rows, Columns> out;
  for (Eigen::Index k = 0; k < out.size(); ++k) out(k) = of(k).derivative(order);
  return out;
}

/// The forces that move each part as it moves, against its weight: of bodies on their origin and axes, of lines on
/// their ends, part after part.
class Forces {
 public:
  explicit Forces(const Vec3& gravity) : gravity_(gravity) { forces_.reserve(kMost); }

  void body(const PoseT<Series>& X, const BodyMasses& masses) {
    Eigen::Matrix<double, 3, 4> a;
    a << derivative(X.p, 2), derivative(X.R, 2);
    const Eigen::Matrix<double, 3, 4> f = a * masses - gravity_ * masses.row(0);
    for (int i = 0; i < 4; ++i) forces_.emplace_back(f.col(i));
  }
  /// A force on e turns the line by its part across e.
  void line(const Vector3<Series>& a, const Vector3<Series>& b, const LineMasses& masses) {
    Mat3 acceleration;
    acceleration << derivative(a, 2), derivative(b, 2), Vec3::Zero();
    Vec3 e = Vec3::Zero();
    double length = 1;
    if (masses.turns()) {
      // y = l e: y'' = l e'' + 2 l' e' + l'' e, and e . e = 1
      const Vector3<Series> y = b - a;
      const Vec3 v = derivative(y, 1), w = acceleration.col(1) - acceleration.col(0);
      e = derivative(y, 0);
      length = e.norm();
      e /= length;
      const double along = e.dot(v);
      const Vec3 rate = (v - along * e) / length;
      acceleration.col(2) = (w - e.dot(w) * e - 2 * along * rate) / length - rate.squaredNorm() * e;
    }
    const Mat3 f = acceleration * masses.G - gravity_ * masses.weight().transpose();
    const Vec3 couple = (f.col(2) - e.dot(f.col(2)) * e) / length;
    forces_.emplace_back(f.col(0) - couple);
    forces_.emplace_back(f.col(1) + couple);
  }
  [[nodiscard]] const std::vector<Vec3>& all() const { return forces_; }

 private:
  static constexpr std::size_t kMost = 64;
  Vec3 gravity_;
  std::vector<Vec3> forces_;
};

/// Their work for a unit of each of six motions.
class Work {
 public:
  explicit Work(const std::vector<Vec3>& forces) : next_(forces.begin()) {}

  void body(const PoseT<Dual>& X, const BodyMasses&) {
    add(X.p);
    for (int i = 0; i < 3; ++i) add(X.R.col(i));
  }
  void line(const Vector3<Dual>& a, const Vector3<Dual>& b, const LineMasses&) {
    add(a);
    add(b);
  }
  [[nodiscard]] const Vec6& sum() const { return sum_; }

 private:
  template <class Moved>
  void add(const Moved& moved) {
    const Vec3& f = *next_++;
    sum_ += f[0] * moved[0].v + f[1] * moved[1].v + f[2] * moved[2].v;
  }
  std::vector<Vec3>::const_iterator next_;
  Vec6 sum_ = Vec6::Zero();
};

/// take(vectors, G, weight) for each part, lines with their direction.
template <class T, class Take>
struct OfVectors {
  Take take;
  void body(const PoseT<T>& X, const BodyMasses& masses) { take(vectors_of(X), masses, masses.col(0)); }
  void line(const Vector3<T>& a, const Vector3<T>& b, const LineMasses& masses) {
    take(vectors_of(a, b, masses), masses.G, masses.weight());
  }
};
template <class T, class M, class Take>
void each_mass(const M& m, const Dynamics& d, const PoseT<T>& X, std::span<const T> q, Take&& take) {
  each_part(m, d, X, q, OfVectors<T, Take&>{take});
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

tl::unexpected<Error> no_part(const config::Table& table, const char* key, const char* part, bool in_series) {
  return fail("MO121", fmt::format("dynamics.{}: this machine has no {}", key, part), table.place_of(key),
              in_series ? "write the parts of each stage in its [[dynamics.stage]]" : "leave it out");
}

Result<std::optional<double>> damping_of(const config::Table& table) {
  if (!table.has("damping_ratio")) return std::optional<double>{};
  POLYPOD_ASSIGN(ratio, table.number("damping_ratio", {0, 1}));
  return std::optional<double>(ratio);
}

}  // namespace

namespace {
/// What moves, of a machine or of one of its stages.
Status read_parts(const config::Table& table, const AnyMachine& machine, Dynamics& out) {
  const machine::MassParts parts = std::visit([](const auto& m) { return parts_with_mass(m); }, machine);
  const std::span<const AnyMachine> stages = std::visit([](const auto& m) { return stages_with_mass(m); }, machine);
  const bool in_series = !stages.empty();
  POLYPOD_ASSIGN(platform, body_from(table, "platform"));
  out.platform = platform;
  POLYPOD_ASSIGN(payload, body_from(table, "payload"));
  out.payload = payload;
  POLYPOD_ASSIGN(strut, table.optional_table("strut"));
  if (strut) {
    if (!parts.struts) return no_part(table, "strut", "struts", in_series);
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
  if (rod > 0 && !parts.rods) return no_part(table, "rod_kg", "rods", in_series);
  out.rod = rod;
  POLYPOD_ASSIGN(slider, table.optional_number("slider_kg", 0, {0, 1e6}));
  if (slider > 0 && !parts.sliders) return no_part(table, "slider_kg", "sliders", in_series);
  out.slider = slider;
  POLYPOD_ASSIGN(arm, table.optional_table("arm"));
  if (arm) {
    if (!parts.arms) return no_part(table, "arm", "arms", in_series);
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
    if (parts.links == 0) return no_part(table, "link", "links", in_series);
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
  if (!in_series) return {};
  POLYPOD_ASSIGN(given, table.tables("stage"));
  if (!given.empty() && given.size() != stages.size()) {
    return fail("MO122", fmt::format("dynamics has {} stages, the machine {}", given.size(), stages.size()),
                table.place_of("stage"),
                "give one a stage, from the base to the tool, an empty one for those without masses");
  }
  for (std::size_t k = 0; k < given.size(); ++k) {
    Dynamics stage;
    if (const Status read = read_parts(given[k], stages[k], stage); !read) {
      Error error = read.error();
      error.message = fmt::format("stage {}: {}", k + 1, error.message);
      return tl::unexpected(std::move(error));
    }
    POLYPOD_TRY(given[k].finish());
    out.stages.push_back(std::move(stage));
  }
  return {};
}
}  // namespace

Result<Dynamics> dynamics_from(const config::Table& table, const AnyMachine& machine) {
  Dynamics out;
  if (kinematics::hangs_down(machine)) out.gravity = -out.gravity;
  if (table.has("gravity_m_per_s2")) {
    POLYPOD_ASSIGN(g, table.numbers("gravity_m_per_s2", 3, {-1000, 1000}));
    out.gravity = Vec3(g[0], g[1], g[2]);
    out.gravity_given = true;
  }
  POLYPOD_TRY(read_parts(table, machine, out));
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

namespace {
/// What the files of the stages say of their own masses, one a stage; empty where none has any, or where the file is no
/// machine file.
Result<std::vector<Dynamics>> own_masses(const std::string& path, std::span<const AnyMachine> stages) {
  std::vector<Dynamics> out(stages.size());
  std::error_code ec;
  if (stages.empty() || !std::filesystem::is_regular_file(path, ec)) return std::vector<Dynamics>{};
  POLYPOD_ASSIGN(file, config::read_file(path));
  if (!file.has("family")) return std::vector<Dynamics>{};
  POLYPOD_ASSIGN(whole, machine::whole_table(path));
  POLYPOD_ASSIGN(tables, whole.tables("stage"));
  bool any = false;
  for (std::size_t k = 0; k < std::min(tables.size(), stages.size()); ++k) {
    POLYPOD_ASSIGN(own, tables[k].table("machine"));
    POLYPOD_ASSIGN(table, own.optional_table("dynamics"));
    if (!table) continue;
    POLYPOD_ASSIGN(read, dynamics_from(*table, stages[k]));
    out[k] = std::move(read);
    any = true;
  }
  return any ? out : std::vector<Dynamics>{};
}

/// The numbers of the drives of all stages in one list, 0 where a stage has none; empty where none has any.
std::vector<double> of_all_drives(const std::vector<Dynamics>& own, std::span<const AnyMachine> stages,
                                  std::vector<double> Dynamics::*numbers) {
  std::vector<double> out;
  bool any = false;
  for (std::size_t k = 0; k < own.size(); ++k) {
    const std::vector<double>& given = own[k].*numbers;
    const auto n = static_cast<std::size_t>(kinematics::joint_count(stages[k]));
    any = any || !given.empty();
    for (std::size_t i = 0; i < n; ++i) out.push_back(given.empty() ? 0 : given[given.size() == 1 ? 0 : i]);
  }
  return any ? out : std::vector<double>{};
}

/// Takes the masses of the stages' own files where the table of the whole has none of stages.
void take(std::vector<Dynamics> own, std::span<const AnyMachine> stages, Dynamics& out) {
  if (own.empty()) return;
  if (!out.stages.empty()) {
    for (std::size_t k = 0; k < own.size(); ++k)
      if (!own[k].parts_with_mass().empty()) out.not_read.push_back(static_cast<int>(k + 1));
    return;
  }
  for (const auto numbers : {&Dynamics::drive, &Dynamics::friction, &Dynamics::viscous})
    if ((out.*numbers).empty()) out.*numbers = of_all_drives(own, stages, numbers);
  for (std::size_t k = 0; k < own.size(); ++k) {
    Dynamics& stage = own[k];
    stage.drive.clear();
    stage.friction.clear();
    stage.viscous.clear();
    const auto leave_out = [&](const char* what) { out.left_out.push_back(fmt::format("stage {} {}", k + 1, what)); };
    if (stage.gravity_given && stage.gravity != out.gravity) leave_out("gravity");
    // What a stage carries is the next one, or what the whole carries.
    const bool last = k + 1 == own.size();
    for (const auto& [body, of_whole, name] : {std::tuple{&stage.payload, !last || out.payload, "payload"},
                                               std::tuple{&stage.platform, last && out.platform, "platform"}}) {
      if (!of_whole || !*body) continue;
      leave_out(name);
      body->reset();
    }
  }
  out.stages = std::move(own);
  out.of_stages = true;
}
}  // namespace

Result<std::optional<Dynamics>> read_dynamics(const std::string& path, const AnyMachine& machine) {
  const std::span<const AnyMachine> stages = std::visit([](const auto& m) { return stages_with_mass(m); }, machine);
  POLYPOD_ASSIGN(open, dynamics_table(path));
  POLYPOD_ASSIGN(own, own_masses(path, stages));
  if (!open && own.empty()) return std::optional<Dynamics>{};
  Dynamics out;
  if (open) {
    POLYPOD_ASSIGN(read, dynamics_from(open->table, machine));
    out = std::move(read);
  } else if (kinematics::hangs_down(machine)) {
    out.gravity = -out.gravity;
  }
  take(std::move(own), stages, out);
  return std::optional<Dynamics>(std::move(out));
}

namespace {
std::string list(const std::vector<double>& values) {
  return fmt::format("[{}]", fmt::join(values, ", "));
}
std::string body_text(const Body& body) {
  std::string out = fmt::format("{{ mass_kg = {}", body.mass);
  if (!body.center.isZero(0)) {
    const Vec3 c = units::kMmPerMetre * body.center;
    out += fmt::format(", center_mm = {}", list({c.x(), c.y(), c.z()}));
  }
  const Mat3& I = body.inertia;
  if (!I.isZero(0))
    out += fmt::format(", inertia_kg_m2 = {}", list({I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2)}));
  return out + " }";
}
/// What moves, of a machine or of one of its stages.
std::string parts_text(const Dynamics& d) {
  std::string out;
  const auto line = [&](const char* key, const std::string& value) { out += fmt::format("{} = {}\n", key, value); };
  if (d.platform) line("platform", body_text(*d.platform));
  if (d.payload) line("payload", body_text(*d.payload));
  if (d.strut_fixed > 0 || d.strut_moving > 0 || d.strut_fixed_inertia > 0 || d.strut_moving_inertia > 0) {
    line("strut",
         fmt::format("{{ fixed_mass_kg = {}, fixed_center_mm = {}, fixed_inertia_kg_m2 = {}, moving_mass_kg = {}, "
                     "moving_center_mm = {}, moving_inertia_kg_m2 = {} }}",
                     d.strut_fixed, units::to_mm(d.strut_fixed_center), d.strut_fixed_inertia, d.strut_moving,
                     units::to_mm(d.strut_moving_center), d.strut_moving_inertia));
  }
  if (d.rod > 0) line("rod_kg", fmt::format("{}", d.rod));
  if (d.slider > 0) line("slider_kg", fmt::format("{}", d.slider));
  if (d.arm > 0 || d.arm_inertia > 0) {
    line("arm", fmt::format("{{ mass_kg = {}, center_mm = {}, inertia_kg_m2 = {} }}", d.arm, units::to_mm(d.arm_center),
                            d.arm_inertia));
  }
  if (!d.links.empty()) {
    std::vector<std::string> links;
    for (const std::optional<Body>& link : d.links) links.push_back(body_text(link.value_or(Body{})));
    line("link", fmt::format("[ {} ]", fmt::join(links, ", ")));
  }
  return out;
}
}  // namespace

std::string to_toml(const Dynamics& d, std::optional<double> damping_ratio) {
  std::string out = "[dynamics]\n" + parts_text(d);
  if (d.gravity_given)
    out += fmt::format("gravity_m_per_s2 = {}\n", list({d.gravity.x(), d.gravity.y(), d.gravity.z()}));
  for (const auto& [key, values] :
       {std::pair{"drive_inertia", &d.drive}, std::pair{"friction", &d.friction}, std::pair{"viscous", &d.viscous}})
    if (!values->empty()) out += fmt::format("{} = {}\n", key, list(*values));
  if (damping_ratio) out += fmt::format("damping_ratio = {}\n", *damping_ratio);
  for (const Dynamics& stage : d.stages) out += "\n[[dynamics.stage]]\n" + parts_text(stage);
  return out;
}

Result<std::optional<double>> read_damping(const std::string& path) {
  POLYPOD_ASSIGN(open, dynamics_table(path));
  if (!open) return std::optional<double>{};
  return damping_of(open->table);
}

std::vector<std::string> Dynamics::parts_with_mass() const {
  std::vector<std::string> out;
  for (std::size_t k = 0; k < stages.size(); ++k)
    for (const std::string& part : stages[k].parts_with_mass()) out.push_back(fmt::format("stage {} {}", k + 1, part));
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
  for (std::size_t k = 0; k < stages.size(); ++k)
    for (const std::string& body : stages[k].not_rigid()) out.push_back(fmt::format("stage {} {}", k + 1, body));
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
        const std::vector<Series> joints = joints_of(motion);
        Forces forces(d.gravity);
        each_part(m, d, motion.X, std::span<const Series>(joints), forces);
        each_rate(X, motion.q, J, all_joints(motion.q.size()),
                  [&](Eigen::Index first, Eigen::Index count, const PoseT<Dual>& moved, std::span<const Dual> q) {
                    Work work(forces.all());
                    each_part(m, d, moved, q, work);
                    tau.segment(first, count) = work.sum().head(count);
                  });
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
/// Sum of G_ij (dv_i/dx)^T dv_j/dx over the parts.
Eigen::MatrixXd mass_by(const AnyMachine& machine, const Dynamics& d, const Pose& X, const JointVector& q,
                        const Eigen::Ref<const Columns>& J, std::span<const int> joint) {
  using Rates = Eigen::Matrix<double, 3, 6>;
  const Eigen::Index columns = J.cols();
  std::vector<Rates> rates;     // dv_i/dx of all parts, pass after pass
  std::vector<Rates> momentum;  // sum_j G_ij dv_j/dx
  std::size_t passes = 0;
  std::visit(
      [&](const auto& m) {
        each_rate(X, q, J, joint,
                  [&](Eigen::Index, Eigen::Index, const PoseT<Dual>& moved, std::span<const Dual> joints) {
                    ++passes;
                    each_mass(m, d, moved, joints, [&](const auto& vectors, const auto& G, const auto&) {
                      const std::size_t own = rates.size();
                      for (Eigen::Index i = 0; i < vectors.cols(); ++i) {
                        Rates& rate = rates.emplace_back();
                        for (int k = 0; k < 3; ++k) rate.row(k) = vectors(k, i).v.transpose();
                      }
                      for (Eigen::Index i = 0; i < vectors.cols(); ++i) {
                        Rates& sum = momentum.emplace_back(Rates::Zero());
                        for (Eigen::Index j = 0; j < vectors.cols(); ++j)
                          sum += G(i, j) * rates[own + static_cast<std::size_t>(j)];
                      }
                    });
                  });
      },
      machine);
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(columns, columns);
  const std::size_t vectors = passes == 0 ? 0 : rates.size() / passes;
  for (std::size_t a = 0; a < passes; ++a) {
    for (std::size_t b = 0; b < passes; ++b) {
      Mat6 sum = Mat6::Zero();
      for (std::size_t k = 0; k < vectors; ++k) sum += rates[a * vectors + k].transpose() * momentum[b * vectors + k];
      const auto row = static_cast<Eigen::Index>(6 * a), column = static_cast<Eigen::Index>(6 * b);
      const Eigen::Index rows = std::min<Eigen::Index>(6, columns - row),
                         count = std::min<Eigen::Index>(6, columns - column);
      out.block(row, column, rows, count) = sum.topLeftCorner(rows, count);
    }
  }
  return out;
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
        const std::vector<Series> joints = joints_of(motion);
        each_mass(m, d, motion.X, std::span<const Series>(joints),
                  [&](const auto& vectors, const auto& G, const auto& weight) {
                    for (Eigen::Index i = 0; i < vectors.cols(); ++i) {
                      const Vec3 v = derivative<3, 1>(vectors.col(i), 1);
                      for (Eigen::Index j = 0; j < vectors.cols(); ++j)
                        out.kinetic += 0.5 * G(i, j) * v.dot(derivative<3, 1>(vectors.col(j), 1));
                      out.potential -= weight[i] * d.gravity.dot(derivative<3, 1>(vectors.col(i), 0));
                    }
                  });
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
  Columns J;                 ///< twist of the tool by x, [m; rad] in M
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
  std::visit(
      [&](const auto& m) {
        each_rate(soft.X_MT, q, soft.J, soft.joint,
                  [&](Eigen::Index first, Eigen::Index count, const PoseT<Dual>& moved, std::span<const Dual> joints) {
                    each_mass(m, d, moved, joints, [&](const auto& vectors, const auto&, const auto& own) {
                      for (Eigen::Index i = 0; i < vectors.cols(); ++i)
                        for (int k = 0; k < 3; ++k)
                          weight.segment(first, count) += own[i] * d.gravity[k] * vectors(k, i).v.head(count);
                    });
                  });
      },
      machine);
  return soft.J * soft.root.cwiseAbs2().cwiseProduct(weight);
}

}  // namespace polypod::motion
