// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machine files of parallel machines of legs: reading, checking, writing.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "../../machine/machine_file.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/parallel/equations.hpp"
#include "settle.hpp"

namespace polypod::machine {
namespace {

/// Singular values below this share of the largest count as zero: of a geometry that is meant to be singular rounding
/// leaves 1e-16, and a good machine has 0.01 and more.
constexpr double kRankLost = 1e-8;

constexpr std::array<const char*, 4> kDrives{"strut", "rail", "crank", "none"};
constexpr std::array<const char*, 5> kConstraints{"plane", "platform-plane", "line", "square", "orientation"};

Result<Vec3> point(const config::Table& table, const char* key) {
  POLYPOD_ASSIGN(v, table.numbers(key, 3));
  return Vec3(units::from_mm(v[0]), units::from_mm(v[1]), units::from_mm(v[2]));
}

/// A direction, made a unit vector.
Result<Vec3> direction(const config::Table& table, const char* key) {
  POLYPOD_ASSIGN(v, table.numbers(key, 3));
  const Vec3 out(v[0], v[1], v[2]);
  const double length = out.stableNorm();
  if (!(length > 1e-12) || !(length < 1e12)) {
    return fail("MA150", fmt::format("{} = [{:g}, {:g}, {:g}] has no direction", key, v[0], v[1], v[2]),
                table.place_of(key), "give a vector that is not 0; its length does not matter");
  }
  constexpr double kUnit = 1e-11;  // what a file keeps of a unit vector: read back, it must not change again
  return std::abs(length - 1) < kUnit ? out : Vec3(out / length);
}

/// The index of the text under `key` among `names`.
template <std::size_t N>
Result<int> one_of(const config::Table& table, const char* key, const std::array<const char*, N>& names) {
  POLYPOD_ASSIGN(text, table.text(key));
  std::string all;
  for (std::size_t i = 0; i < N; ++i) {
    if (text == names[i]) return static_cast<int>(i);
    all += fmt::format("{}\"{}\"", i == 0 ? "" : ", ", names[i]);
  }
  return fail("MA151", fmt::format("{} = \"{}\" is not known", key, text), table.place_of(key), "known: " + all);
}

Status read_range(const config::Table& table, ParallelLeg& leg) {
  if (!leg.driven()) return {};
  const bool turns = leg.drive == LegDrive::crank;
  const char* low_key = turns ? "min_deg" : "min_mm";
  const char* high_key = turns ? "max_deg" : "max_mm";
  const config::Range allowed = turns                          ? config::Range{-720, 720}
                                : leg.drive == LegDrive::strut ? config::kNotNegative
                                                               : config::kAnyFinite;
  POLYPOD_ASSIGN(low, table.number(low_key, allowed));
  POLYPOD_ASSIGN(high, table.number(high_key, allowed));
  if (!(low < high)) {
    return fail("MA152", fmt::format("the range {:g} .. {:g} {} of a leg is empty", low, high, turns ? "deg" : "mm"),
                table.place_of(low_key), fmt::format("give {} below {}", low_key, high_key));
  }
  if (turns && high - low > 360) {
    return fail("MA152", fmt::format("the range {:g} .. {:g} deg of a crank is more than a turn", low, high),
                table.place_of(low_key),
                "give at most one turn, such as -180 to 180: a pose gives a crank's angle but for whole turns");
  }
  leg.range = turns ? JointRange{units::from_deg(low), units::from_deg(high)}
                    : JointRange{units::from_mm(low), units::from_mm(high)};
  POLYPOD_ASSIGN(speed, speed_of(table, turns));
  leg.speed = speed;
  return {};
}

Status read_drive(const config::Table& table, ParallelLeg& leg) {
  if (leg.drive == LegDrive::rail) {
    POLYPOD_ASSIGN(rail, direction(table, "rail"));
    leg.rail = rail;
  }
  if (leg.drive == LegDrive::crank) {
    POLYPOD_ASSIGN(axis, direction(table, "axis"));
    POLYPOD_ASSIGN(zero, direction(table, "zero"));
    POLYPOD_ASSIGN(arm, table.number("arm_mm", config::kPositive));
    if (std::abs(axis.dot(zero)) > 1e-6) {
      return fail(
          "MA150",
          fmt::format("zero is not square to axis: they stand at {:.4g} deg", units::to_deg(angle_between(axis, zero))),
          table.place_of("zero"), "zero is where the arm points at q = 0, across its axis");
    }
    leg.axis = axis;
    leg.zero = std::abs(axis.dot(zero)) < 1e-11 ? zero : (zero - axis * axis.dot(zero)).normalized();
    leg.arm = units::from_mm(arm);
  }
  if (leg.two_roots()) {
    const bool turns = leg.drive == LegDrive::crank;
    POLYPOD_ASSIGN(offset, table.optional_number(turns ? "offset_deg" : "offset_mm", 0));
    leg.zero_offset = turns ? units::from_deg(offset) : units::from_mm(offset);
  }
  if (leg.drive == LegDrive::strut) {
    POLYPOD_ASSIGN(offset, table.optional_number("offset_mm", 0));
    leg.rod = units::from_mm(offset);
  } else {
    POLYPOD_ASSIGN(rod, table.number("rod_mm", config::kPositive));
    leg.rod = units::from_mm(rod);
  }
  return {};
}

Result<ParallelLeg> read_leg(const config::Table& table) {
  ParallelLeg leg;
  POLYPOD_ASSIGN(drive, one_of(table, "drive", kDrives));
  leg.drive = static_cast<LegDrive>(drive);
  POLYPOD_ASSIGN(base, point(table, "base_mm"));
  leg.base = base;
  POLYPOD_TRY(read_drive(table, leg));
  POLYPOD_ASSIGN(ring, table.optional_table("ring"));
  if (ring) {
    if (leg.two_roots()) {
      return fail("MA151", fmt::format("a {} cannot end on a ring", kDrives[static_cast<std::size_t>(drive)]),
                  ring->place(), "rings are for struts and passive rods");
    }
    POLYPOD_ASSIGN(center, point(*ring, "center_mm"));
    POLYPOD_ASSIGN(axis, direction(*ring, "axis"));
    POLYPOD_ASSIGN(radius, ring->number("radius_mm", config::kNotNegative));
    POLYPOD_TRY(ring->finish());
    leg.ring = LegRing{center, axis, units::from_mm(radius)};
  } else {
    POLYPOD_ASSIGN(platform, point(table, "platform_mm"));
    leg.platform = platform;
    if (table.has("still_mm")) {
      POLYPOD_ASSIGN(still, point(table, "still_mm"));
      leg.still = still;
    }
  }
  POLYPOD_TRY(read_range(table, leg));
  POLYPOD_ASSIGN(compliance, table.optional_number("compliance_um_per_N", 0, {0, 1e6}));
  leg.compliance = units::from_um(compliance);
  POLYPOD_TRY(table.finish());
  return leg;
}

Result<PlatformConstraint> read_constraint(const config::Table& table) {
  PlatformConstraint c;
  POLYPOD_ASSIGN(kind, one_of(table, "kind", kConstraints));
  c.kind = static_cast<ConstraintKind>(kind);
  if (c.has_points()) {
    POLYPOD_ASSIGN(platform, point(table, "platform_mm"));
    POLYPOD_ASSIGN(base, point(table, "base_mm"));
    c.platform = platform;
    c.base = base;
  }
  if (c.kind == ConstraintKind::plane) {
    POLYPOD_ASSIGN(normal, direction(table, "normal"));
    c.base_axis = normal;
  }
  if (c.kind == ConstraintKind::line || c.kind == ConstraintKind::platform_plane) {
    POLYPOD_ASSIGN(axis, direction(table, "axis"));
    c.platform_axis = axis;
  }
  if (c.kind == ConstraintKind::square) {
    POLYPOD_ASSIGN(base_axis, direction(table, "base_axis"));
    POLYPOD_ASSIGN(platform_axis, direction(table, "platform_axis"));
    c.base_axis = base_axis;
    c.platform_axis = platform_axis;
  }
  POLYPOD_TRY(table.finish());
  return c;
}

int equations_of(const PlatformConstraint& c) {
  return c.kind == ConstraintKind::line ? 2 : c.kind == ConstraintKind::orientation ? 3 : 1;
}

Status read_home(const config::Table& table, Parallel& m) {
  POLYPOD_ASSIGN(given, table.optional_table("home"));
  if (!given) return {};
  const config::Table& home = *given;
  constexpr std::array<const char*, 6> kKeys{"x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"};
  std::array<double, 6> value{};
  for (std::size_t k = 0; k < 6; ++k) {
    POLYPOD_ASSIGN(number, home.optional_number(kKeys[k], 0));
    value[k] = k < 3 ? units::from_mm(number) : units::from_deg(number);
  }
  POLYPOD_TRY(home.finish());
  m.home_angles = Vec3(value[3], value[4], value[5]);
  m.home_given << value[0], value[1], value[2], m.home_angles;
  m.home = {rotation_abc(value[3], value[4], value[5]), {value[0], value[1], value[2]}};
  return {};
}

/// Whether all legs end on rings round one axis along z of P and no constraint sees the turn about it: nearly, so that
/// errors of single rings can be judged.
bool turns_idly(const Parallel& m) {
  if (m.task.holds(Coordinate::c) || m.legs.empty() || !m.legs.front().ring) return false;
  constexpr double kNear = 0.05;  // rad, and shares of the machine's size
  const auto level = [](const Vec3& v) { return std::hypot(v.x(), v.y()); };
  const auto along_z = [&](const Vec3& axis) { return level(axis) < kNear; };
  const Vec3 on_axis = m.legs.front().ring->center;
  const auto on = [&](const Vec3& p) { return level(p - on_axis) < kNear * m.size; };
  for (const ParallelLeg& leg : m.legs)
    if (!leg.ring || !along_z(leg.ring->axis) || !on(leg.ring->center)) return false;
  for (const PlatformConstraint& c : m.constraints) {
    if (c.kind == ConstraintKind::orientation) return false;
    if (c.kind == ConstraintKind::plane && !on(c.platform)) return false;
    if (c.kind == ConstraintKind::line && !on(c.platform)) return false;
    if (c.has_platform_axis() && !along_z(c.platform_axis)) return false;
  }
  return on(m.tool);
}

/// References, size and driven legs.
void measure(Parallel& m) {
  double sum = 0;
  for (const ParallelLeg& leg : m.legs) {
    sum +=
        leg.ring ? (leg.ring->center - m.tool).norm() + leg.ring->radius : (leg.platform - m.tool + leg.still).norm();
  }
  m.size = m.legs.empty() ? 0 : sum / static_cast<double>(m.legs.size());
  double longest = 0;
  for (const ParallelLeg& leg : m.legs) longest = std::max({longest, leg.rod, leg.range.max * (leg.arm > 0 ? 0 : 1)});
  if (!(m.size > 1e-6 * longest)) m.size = longest > 0 ? longest : 1;
  m.driven.clear();
  for (std::size_t i = 0; i < m.legs.size(); ++i)
    if (m.legs[i].driven()) m.driven.push_back(static_cast<int>(i));
}

std::string in_mm_and_deg(const Vec6& twist) {
  // What is rounding beside the rest is 0.
  const double least = 1e-9 * twist.cwiseAbs().maxCoeff();
  const auto at = [&](int i) { return std::abs(twist[i]) > least ? twist[i] : 0.0; };
  return fmt::format("({:.3g}, {:.3g}, {:.3g}) mm with a turn of ({:.3g}, {:.3g}, {:.3g}) deg", units::to_mm(at(0)),
                     units::to_mm(at(1)), units::to_mm(at(2)), units::to_deg(at(3)), units::to_deg(at(4)),
                     units::to_deg(at(5)));
}

/// "passive leg 4", "constraint 2 (square)": whose equation is met least, and where it stands in the file.
std::pair<std::string, Place> least_met(const Parallel& m, const ClosureVector& F,
                                        const std::vector<config::Table>& legs,
                                        const std::vector<config::Table>& constraints) {
  Eigen::Index worst = 0, row = 0;
  F.cwiseAbs().maxCoeff(&worst);
  for (std::size_t i = 0; i < m.legs.size(); ++i) {
    if (!m.legs[i].driven() && row++ == worst) return {fmt::format("passive leg {}", i + 1), legs[i].place()};
  }
  for (std::size_t i = 0; i < m.constraints.size(); ++i) {
    row += equations_of(m.constraints[i]);
    if (worst >= row) continue;
    const char* kind = kConstraints[static_cast<std::size_t>(m.constraints[i].kind)];
    return {fmt::format("constraint {} ({})", i + 1, kind), constraints[i].place()};
  }
  return {};
}

/// Rank of rows by twists [v; w] whose angular columns count `size` metres a radian, and the twist that they hold
/// least.
struct Rank {
  int rank = 0;
  Vec6 free = Vec6::Zero();
};
Rank rank_of(const Eigen::MatrixXd& rows, double size) {
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(std::max<Eigen::Index>(6, rows.rows()), 6);
  A.topRows(rows.rows()) = rows;
  A.rightCols(3) /= size;
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(A, Eigen::ComputeFullV);
  Rank out;
  const Eigen::VectorXd& s = svd.singularValues();
  for (int i = 0; i < 6; ++i) out.rank += s[i] > kRankLost * std::max(s[0], 1e-300) ? 1 : 0;
  out.free = svd.matrixV().col(5);
  out.free.head<3>() *= size;
  return out;
}

/// The constraints must leave exactly the coordinates of the task free.
Status check_constraints(const config::Table& table, const Parallel& m) {
  const EquationRows passive = passive_rows(m, m.home);
  const int held = passive.F.size() > 0 ? rank_of(passive.A, m.size).rank : 0;
  Eigen::MatrixXd both(passive.F.size() + m.task.size(), 6);
  both << passive.A, task_rows(m.task, m.home, m.size);
  const int together = rank_of(both, m.size).rank;
  const std::string counts =
      fmt::format("constraints and passive rods hold {} of 6 freedoms and the task prescribes {}", held, m.task.size());
  if (together < 6 && held + m.task.size() >= 6) {
    // As many as are needed, but some of the task's follow from the constraints already.
    const auto rank_with = [&](const Eigen::MatrixXd& rows, Coordinate c) {
      Eigen::MatrixXd more(rows.rows() + 1, 6);
      more << rows, task_rows(Task{c}, m.home, m.size);
      return rank_of(more, m.size).rank;
    };
    std::vector<std::string> follow, free;
    for (int k = 0; k < 6; ++k) {
      const auto c = static_cast<Coordinate>(k);
      if (m.task.holds(c) && rank_with(passive.A, c) == held) follow.emplace_back(name_of(c));
      if (!m.task.holds(c) && rank_with(both, c) > together) free.emplace_back(name_of(c));
    }
    return fail(
        "MA156",
        fmt::format("{}, but at home {} from the constraints already and {} left to nothing", counts,
                    follow.empty() ? "some of these follow"
                                   : fmt::format("{} follow{}", fmt::join(follow, ", "), follow.size() == 1 ? "s" : ""),
                    free.empty() ? "a motion is"
                                 : fmt::format("{} {}", fmt::join(free, ", "), free.size() == 1 ? "is" : "are")),
        table.place_of("task"), "put what is left to nothing into the task, in the place of what follows");
  }
  if (together < 6) {
    return fail("MA156",
                fmt::format("{}: {} left to nothing", counts,
                            6 - together == 1 ? "one is" : fmt::format("{} are", 6 - together)),
                table.place_of("task"),
                "add a coordinate to the task, or a constraint or passive rod that fixes what follows");
  }
  if (held + m.task.size() > 6) {
    return fail("MA156", fmt::format("{}: a pose cannot be chosen freely", counts), table.place_of("task"),
                "take a coordinate out of the task, or a constraint away");
  }
  return {};
}

/// More equations than freedoms close only where they agree: looked at near home.
Status check_agreement(const config::Table& table, const Parallel& m) {
  for (int k = 0; k < 2 * m.task.size(); ++k) {
    const auto c = static_cast<int>(m.task[k / 2]);
    const double way = (k % 2 == 0 ? 0.05 : -0.05);
    Pose target = m.home;
    if (c < 3) {
      target.p[c] += way * m.size;
    } else {
      Vec3 abc = m.home_angles;
      abc[c - 3] += way;
      target.R = rotation_abc(abc[0], abc[1], abc[2]);
    }
    if (settled(m, target)) continue;
    return fail(
        "MA157",
        fmt::format("the constraints close at home but not {:+.3g} {} from it in {}: they contradict each other",
                    c < 3 ? units::to_mm(way * m.size) : units::to_deg(way), c < 3 ? "mm" : "deg",
                    name_of(m.task[k / 2])),
        table.place_of("task"),
        "leave out what is constrained twice, or let the constraints agree (planes that are parallel, axes that meet)");
  }
  return {};
}

void find_references(Parallel& m) {
  for (ParallelLeg& leg : m.legs) {
    const double length = leg.drive == LegDrive::strut ? (leg_end(m, leg, m.home) - leg.base).norm() : leg.rod;
    leg.reference = length > 1e-9 * m.size ? length : m.size;
  }
}

/// Home: the following coordinates, the joints, the root of each leg.
Status find_home(const config::Table& table, const std::vector<config::Table>& legs,
                 const std::vector<config::Table>& constraints, Parallel& m) {
  const Place place = table.place_of("home");
  const Pose given = m.home;
  const auto home = closed_home(m);
  if (!home) {
    const auto [least, at] = least_met(m, passive_rows(m, given).F, legs, constraints);
    return fail("MA155",
                fmt::format("the machine does not close at home: no coordinates that follow meet all constraints and "
                            "passive rods; at those of `home` {} is the farthest off",
                            least.empty() ? "the turn of the platform" : least),
                least.empty() ? place : at,
                "check the lengths of passive rods, the points and the axes of constraints, or move home");
  }
  m.home = *home;
  m.home_angles = angles_abc(m.home.R);
  find_references(m);
  m.takes_high.assign(m.legs.size(), false);
  Vec3 middle = Vec3::Zero();
  for (const ParallelLeg& leg : m.legs) middle += leg.base / static_cast<double>(m.legs.size());
  for (std::size_t i = 0; i < m.legs.size(); ++i) {
    ParallelLeg& leg = m.legs[i];
    if (leg.drive == LegDrive::strut && (leg_end(m, leg, m.home) - leg.base).norm() < 1e-9 * m.size) {
      return fail("MA155", fmt::format("leg {} has no length at home: its joints on base and platform coincide", i + 1),
                  legs[i].place(), "check base_mm and platform_mm of this leg, or move home");
    }
    const LegRoots roots = leg_roots(m, leg, m.home);
    if (!leg.two_roots()) continue;
    if (!roots.real()) {
      return fail(
          "MA155",
          fmt::format("the machine does not close at home: leg {} with its rod of {:g} mm does not reach its {}", i + 1,
                      units::to_mm(leg.rod), leg.drive == LegDrive::rail ? "rail" : "arm's circle"),
          place, "check rod_mm, arm_mm and the points of this leg, or move home");
    }
    const auto in = [&](double q) { return q >= leg.range.min - 1e-12 && q <= leg.range.max + 1e-12; };
    // Of a crank whose rod leads to the tool tip itself both ends are equally far from it: then the outer one.
    constexpr double kAsFar = 1e-3;
    const auto away = [&](double q, const Vec3& from) { return (leg_anchor(leg, q) - from).norm(); };
    const auto further = [&](const Vec3& from) { return away(roots.high, from) - away(roots.low, from); };
    const double from_tip = further(m.home.p);
    const bool farther = leg.drive == LegDrive::crank &&
                         (std::abs(from_tip) > kAsFar * leg.arm ? from_tip : further(middle)) > 1e-9 * leg.arm;
    m.takes_high[i] = in(roots.low) == in(roots.high) ? farther : in(roots.high);
  }
  return {};
}

Status check_held(const config::Table& table, const Parallel& m) {
  JointVector q(static_cast<Eigen::Index>(m.driven.size()));
  for (std::size_t j = 0; j < m.driven.size(); ++j) {
    const auto i = static_cast<std::size_t>(m.driven[j]);
    const LegRoots roots = leg_roots(m, m.legs[i], m.home);
    q[static_cast<Eigen::Index>(j)] = m.takes_high[i] ? roots.high : roots.low;
  }
  const EquationRows all = closure_rows(m, m.home, q);
  const Rank rank = rank_of(all.A, m.size);
  if (rank.rank == 6) return {};
  return fail(
      "MA154",
      fmt::format("the platform is not constrained at home: legs and constraints take {} of 6 freedoms with all drives "
                  "locked. It can still move by {}",
                  rank.rank,
                  in_mm_and_deg(rank.free / std::max(rank.free.cwiseAbs().maxCoeff(), 1e-300) * units::from_mm(1))),
      table.place(),
      "add legs or constraints, or move home off a singular pose; with a platform similar or congruent to the base, or "
      "two legs that coincide, every pose is singular");
}

}  // namespace

Result<Parallel> Parallel::from(const config::Table& table) {
  Parallel m;
  POLYPOD_TRY(read_common(table, m.name, m.description, m.provenance));
  POLYPOD_ASSIGN(task, read_task(table, Task::pose));
  m.task = task;
  POLYPOD_TRY(read_home(table, m));
  POLYPOD_ASSIGN(hangs, table.optional_boolean("hangs", false));
  m.hangs = hangs;
  POLYPOD_ASSIGN(tool, table.optional_table("tool"));
  if (tool) {
    constexpr std::array<const char*, 3> kKeys{"x_mm", "y_mm", "z_mm"};
    for (std::size_t k = 0; k < 3; ++k) {
      POLYPOD_ASSIGN(value, tool->optional_number(kKeys[k], 0));
      m.tool[static_cast<Eigen::Index>(k)] = units::from_mm(value);
    }
    POLYPOD_TRY(tool->finish());
  }
  POLYPOD_TRY(read_tip_limits(table, m));
  POLYPOD_ASSIGN(legs, table.tables("leg"));
  for (const config::Table& entry : legs) {
    POLYPOD_ASSIGN(leg, read_leg(entry));
    m.legs.push_back(leg);
  }
  POLYPOD_ASSIGN(constraints, table.tables("constraint"));
  std::size_t equations = m.legs.size();
  for (const config::Table& entry : constraints) {
    POLYPOD_ASSIGN(constraint, read_constraint(entry));
    m.constraints.push_back(constraint);
    equations += static_cast<std::size_t>(equations_of(constraint));
  }
  POLYPOD_TRY(table.finish());
  measure(m);
  m.idle_turn = turns_idly(m);
  equations += m.idle_turn ? 1 : 0;
  if (equations > static_cast<std::size_t>(kMaxEquations) || m.driven.empty()) {
    return fail("MA153",
                m.driven.empty()
                    ? "no leg has a drive"
                    : fmt::format("{} legs and equations of constraints are more than {}", equations, kMaxEquations),
                legs.empty() ? table.place() : legs.back().place(),
                "give 1 to 12 legs, and the constraints of the platform");
  }
  find_references(m);
  POLYPOD_TRY(check_constraints(table, m));
  POLYPOD_TRY(find_home(table, legs, constraints, m));
  if (static_cast<int>(m.driven.size()) < m.task.size()) {
    return fail("MA156", fmt::format("{} drives cannot prescribe {} coordinates", m.driven.size(), m.task.size()),
                table.place_of("task"), "take a coordinate out of the task, or drive another leg");
  }
  POLYPOD_TRY(check_held(table, m));
  POLYPOD_TRY(check_agreement(table, m));
  return m;
}

namespace {
/// take(name, number, component, value, unit) for each parameter in order: "base.joint", 3, 'x' of base.joint[3].x; a
/// number or component 0 is none.
template <class Take>
void each_parameter(const Parallel& m, Take&& take) {
  const auto vector = [&](const char* name, std::size_t number, const Vec3& v, const char* unit) {
    for (int k = 0; k < 3; ++k) take(name, number, "xyz"[k], v[k], unit);
  };
  for (std::size_t i = 1; i <= m.legs.size(); ++i) {
    const ParallelLeg& leg = m.legs[i - 1];
    take("leg.length", i, '\0', leg.rod, "mm");
    vector("base.joint", i, leg.base, "mm");
    vector("platform.joint", i, leg.ring ? leg.ring->center : leg.platform, "mm");
    if (leg.ring) {
      vector("ring.axis", i, leg.ring->axis, "");
      take("ring.radius", i, '\0', leg.ring->radius, "mm");
    }
    if (leg.drive == LegDrive::rail) vector("rail.direction", i, leg.rail, "");
    if (leg.drive == LegDrive::crank) {
      vector("arm.axis", i, leg.axis, "");
      vector("arm.zero", i, leg.zero, "");
      take("arm.length", i, '\0', leg.arm, "mm");
    }
    if (leg.two_roots()) {
      take("drive.zero", i, '\0', leg.zero_offset, leg.drive == LegDrive::crank ? "deg" : "mm");
    }
  }
  for (std::size_t k = 1; k <= m.constraints.size(); ++k) {
    const PlatformConstraint& c = m.constraints[k - 1];
    if (c.has_points()) {
      vector("constraint.platform", k, c.platform, "mm");
      vector("constraint.base", k, c.base, "mm");
    }
    if (c.has_base_axis()) vector("constraint.normal", k, c.base_axis, "");
    if (c.has_platform_axis()) vector("constraint.axis", k, c.platform_axis, "");
  }
  vector("tool", 0, m.tool, "mm");
}
}  // namespace

std::vector<Parameter> parameters(const Parallel& m) {
  std::vector<Parameter> out;
  each_parameter(m, [&](const char* name, std::size_t number, char component, double value, const char* unit) {
    std::string key = number == 0 ? name : fmt::format("{}[{}]", name, number);
    if (component != '\0') key += {'.', component};
    out.push_back({std::move(key), value, unit});
  });
  return out;
}
std::vector<double> parameter_values(const Parallel& m) {
  std::vector<double> out;
  constexpr std::size_t kEach = 24;  // of a leg or a constraint, at most
  out.reserve(kEach * (m.legs.size() + m.constraints.size()));
  each_parameter(m, [&](const char*, std::size_t, char, double value, const char*) { out.push_back(value); });
  return out;
}

std::vector<Parameter> settings(const Parallel& m) {
  std::vector<Parameter> out;
  for (std::size_t i = 0; i < m.legs.size(); ++i) {
    const ParallelLeg& leg = m.legs[i];
    if (!leg.driven()) continue;
    const char* unit = leg.drive == LegDrive::crank ? "deg" : "mm";
    out.push_back({fmt::format("leg[{}].min", i + 1), leg.range.min, unit});
    out.push_back({fmt::format("leg[{}].max", i + 1), leg.range.max, unit});
  }
  for (int k = 0; k < 3; ++k) out.push_back({fmt::format("home.{}", "xyz"[k]), m.home_given[k], "mm"});
  for (int k = 0; k < 3; ++k) out.push_back({fmt::format("home.{}", "abc"[k]), m.home_given[3 + k], "deg"});
  push_tip_limits(out, m);
  return out;
}

namespace {

std::string mm(double value) {
  return number_toml(units::to_mm(value));
}
std::string list(const Vec3& v, bool lengths) {
  const auto text = [&](double x) { return lengths ? mm(x) : number_toml(x); };
  return fmt::format("[{}, {}, {}]", text(v.x()), text(v.y()), text(v.z()));
}

std::string leg_toml(const ParallelLeg& leg) {
  std::string out = fmt::format("\n[[leg]]\ndrive = \"{}\"\nbase_mm = {}\n",
                                kDrives[static_cast<std::size_t>(leg.drive)], list(leg.base, true));
  const bool turns = leg.drive == LegDrive::crank;
  if (leg.drive == LegDrive::rail) out += fmt::format("rail = {}\n", list(leg.rail, false));
  if (turns) {
    out +=
        fmt::format("axis = {}\nzero = {}\narm_mm = {}\n", list(leg.axis, false), list(leg.zero, false), mm(leg.arm));
  }
  if (leg.drive == LegDrive::strut) {
    if (leg.rod != 0) out += fmt::format("offset_mm = {}\n", mm(leg.rod));
  } else {
    out += fmt::format("rod_mm = {}\n", mm(leg.rod));
  }
  if (leg.zero_offset != 0) {
    out += turns ? fmt::format("offset_deg = {}\n", number_toml(units::to_deg(leg.zero_offset)))
                 : fmt::format("offset_mm = {}\n", mm(leg.zero_offset));
  }
  if (leg.ring) {
    out += fmt::format("ring = {{ center_mm = {}, axis = {}, radius_mm = {} }}\n", list(leg.ring->center, true),
                       list(leg.ring->axis, false), mm(leg.ring->radius));
  } else {
    out += fmt::format("platform_mm = {}\n", list(leg.platform, true));
    if (!leg.still.isZero(0)) out += fmt::format("still_mm = {}\n", list(leg.still, true));
  }
  if (leg.driven()) {
    const auto user = [&](double x) { return turns ? number_toml(units::to_deg(x)) : mm(x); };
    const char* unit = turns ? "deg" : "mm";
    out += fmt::format("min_{0} = {1}\nmax_{0} = {2}\n", unit, user(leg.range.min), user(leg.range.max));
    if (leg.speed > 0) out += fmt::format("speed_{}_per_s = {}\n", unit, user(leg.speed));
  }
  if (leg.compliance != 0) out += fmt::format("compliance_um_per_N = {}\n", number_toml(units::to_um(leg.compliance)));
  return out;
}

std::string constraint_toml(const PlatformConstraint& c) {
  std::string out = fmt::format("\n[[constraint]]\nkind = \"{}\"\n", kConstraints[static_cast<std::size_t>(c.kind)]);
  if (c.has_points()) {
    out += fmt::format("platform_mm = {}\nbase_mm = {}\n", list(c.platform, true), list(c.base, true));
  }
  if (c.kind == ConstraintKind::plane) out += fmt::format("normal = {}\n", list(c.base_axis, false));
  if (c.kind == ConstraintKind::line || c.kind == ConstraintKind::platform_plane)
    out += fmt::format("axis = {}\n", list(c.platform_axis, false));
  if (c.kind == ConstraintKind::square) {
    out += fmt::format("base_axis = {}\nplatform_axis = {}\n", list(c.base_axis, false), list(c.platform_axis, false));
  }
  return out;
}

}  // namespace

std::string to_toml(const Parallel& m) {
  std::string out = common_toml(m.name, std::string(Parallel::kFamily), m.description) + task_toml(m.task);
  const auto deg = [](double x) { return number_toml(units::to_deg(x)); };
  out += fmt::format("home = {{ x_mm = {}, y_mm = {}, z_mm = {}, a_deg = {}, b_deg = {}, c_deg = {} }}\n",
                     mm(m.home_given[0]), mm(m.home_given[1]), mm(m.home_given[2]), deg(m.home_given[3]),
                     deg(m.home_given[4]), deg(m.home_given[5]));
  if (m.hangs) out += "hangs = true\n";
  out += fmt::format("tool = {{ x_mm = {}, y_mm = {}, z_mm = {} }}\n", mm(m.tool.x()), mm(m.tool.y()), mm(m.tool.z()));
  out += tip_limits_toml(m);
  for (const ParallelLeg& leg : m.legs) out += leg_toml(leg);
  for (const PlatformConstraint& c : m.constraints) out += constraint_toml(c);
  return out + provenance_toml(m.provenance);
}

Result<Parallel> with_parameters(const Parallel& m, std::span<const double> p) {
  Parallel out = m;
  std::size_t at = 0;
  const auto number = [&](double& x) { x = p[at++]; };
  const auto vector = [&](Vec3& v) {
    for (double& x : v) number(x);
  };
  for (ParallelLeg& leg : out.legs) {
    number(leg.rod);
    vector(leg.base);
    vector(leg.ring ? leg.ring->center : leg.platform);
    if (leg.ring) {
      vector(leg.ring->axis);
      number(leg.ring->radius);
    }
    if (leg.drive == LegDrive::rail) vector(leg.rail);
    if (leg.drive == LegDrive::crank) {
      vector(leg.axis);
      vector(leg.zero);
      leg.axis.normalize();
      leg.zero -= leg.axis * leg.axis.dot(leg.zero);
      number(leg.arm);
    }
    if (leg.two_roots()) number(leg.zero_offset);
  }
  for (PlatformConstraint& c : out.constraints) {
    if (c.has_points()) {
      vector(c.platform);
      vector(c.base);
    }
    if (c.has_base_axis()) vector(c.base_axis);
    if (c.has_platform_axis()) vector(c.platform_axis);
  }
  vector(out.tool);
  POLYPOD_ASSIGN(table, config::parse(to_toml(out), m.name));
  return Parallel::from(table);
}

}  // namespace polypod::machine
