// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A family of machines that Polypod does not know: a gantry of three slides, one on the other, whose y slide may be out
// of square. A struct, the functions of kinematics::Machine, and how a file says it.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <string>
#include <vector>

#include "polypod/core/units.hpp"
#include "polypod/families/own/family.hpp"

namespace gantry {

namespace machine = polypod::machine;
namespace units = polypod::units;
using machine::JointKind;
using machine::JointRange;
using machine::Parameter;
using machine::Task;

struct Gantry {
  static constexpr std::string_view kFamily = "gantry";  // family = "gantry"
  double travel = 0.5;                                   // m, of each slide to both sides
  double out_of_square = 0;                              // rad, of the y slide towards -x

  // Ranges, unknown keys and places in messages come with config::Table.
  static polypod::Result<Gantry> from(const polypod::config::Table& table) {
    POLYPOD_ASSIGN(travel, table.number("travel_mm", polypod::config::kPositive));
    POLYPOD_ASSIGN(angle, table.optional_number("out_of_square_deg", 0, {-45, 45}));
    POLYPOD_TRY(table.finish());
    return Gantry{units::from_mm(travel), units::from_deg(angle)};
  }
};
inline std::string to_toml(const Gantry& g) {
  return fmt::format("travel_mm = {}\nout_of_square_deg = {}\n", units::to_mm(g.travel),
                     units::to_deg(g.out_of_square));
}

inline int joint_count(const Gantry&) {
  return 3;
}
inline JointKind joint_kind(const Gantry&, int) {
  return JointKind::prismatic;
}
inline JointRange joint_range(const Gantry& g, int) {
  return {-g.travel, g.travel};
}
inline Task task(const Gantry&) {
  return Task::point;  // a pose prescribes x, y, z
}

// What may be wrong on the real machine: errors, tolerances and calibrations vary it.
inline std::vector<Parameter> parameters(const Gantry& g) {
  return {{"out_of_square", g.out_of_square, "deg"}};
}
inline polypod::Result<Gantry> with_parameters(const Gantry& g, std::span<const double> p) {
  return Gantry{g.travel, p[0]};
}

// F(X, q, p) = 0, on numbers, dual numbers and intervals; all equations in m or all without unit.
template <class T>
machine::ClosureVectorT<T> closure(const Gantry&, const polypod::PoseT<T>& X, std::span<const T> q,
                                   std::span<const T> p) {
  using std::cos, std::sin;
  machine::ClosureVectorT<T> F(6);
  F[0] = X.p[0] - q[0] + q[1] * sin(p[0]);
  F[1] = X.p[1] - q[1] * cos(p[0]);
  F[2] = X.p[2] - q[2];
  // The carriage does not turn. Divided by 1 + the trace of R this is the axis times the tangent of half the angle;
  // alone it were the sine of the angle, which is 0 at half a turn too.
  const T share = T(1.0) / (T(1.0) + X.R(0, 0) + X.R(1, 1) + X.R(2, 2));
  F[3] = share * (X.R(2, 1) - X.R(1, 2));
  F[4] = share * (X.R(0, 2) - X.R(2, 0));
  F[5] = share * (X.R(1, 0) - X.R(0, 1));
  return F;
}

// g >= 0 where a limit is kept, m.
template <class T>
std::vector<T> limits(const Gantry& g, const polypod::PoseT<T>&, std::span<const T> q, std::span<const T>) {
  std::vector<T> out;
  for (const T& x : q) {
    out.push_back(x + T(g.travel));
    out.push_back(T(g.travel) - x);
  }
  return out;
}
inline std::string limit_name(const Gantry&, int i) {
  return "slide " + std::to_string(i / 2 + 1) + (i % 2 == 0 ? " below its minimum" : " above its maximum");
}

// Forward and inverse kinematics, Jacobian, elasticity of the drives, reach and a picture follow from these. A family
// may have its own: forward(m, q), inverse(m, X), jacobian(m, X, q), home_pose(m), limit_table(m), reach(m), ...

}  // namespace gantry
