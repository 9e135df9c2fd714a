// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "controllers.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/families/serial/kinematics.hpp"

namespace polypod::control {
namespace {

using machine::DhConvention;
using machine::DhRow;
using machine::JointKind;
using machine::JointVector;
using machine::SerialArm;

constexpr int kJoints = 6;
// Axes that are parallel to this have no common normal worth the name: the tip would be off by this times the reach.
constexpr double kParallel = 1e-11;
// A tool beside axis 6 by more than this is another machine, not an error of this one.
constexpr double kMostTilt = 0.02;   // rad
constexpr double kRounding = 1e-10;  // m or rad

/// K = R_z(gamma) T_z(delta) T_x(a) R_x(alpha) R_z(theta) T_z(d).
struct CommonNormal {
  double gamma = 0, delta = 0, a = 0, alpha = 0, theta = 0, d = 0;
};

Pose screw_x(double a, double alpha) {
  return {rotation_x(alpha), Vec3(a, 0, 0)};
}
Pose screw_z(double theta, double d) {
  return {rotation_z(theta), Vec3(0, 0, d)};
}

/// One of the two common normals, that with the smaller |gamma|. Axes that are parallel have many: through K's origin,
/// so that d = 0.
CommonNormal common_normal(const Pose& K) {
  CommonNormal n;
  const Vec3 z = K.R.col(2);  // R_z(gamma) (0, -sin alpha, cos alpha)
  const bool parallel = std::hypot(z.x(), z.y()) < kParallel;
  if (!parallel) {
    n.gamma = std::atan2(z.x(), -z.y());
  } else if (std::hypot(K.p.x(), K.p.y()) > kRounding) {
    n.gamma = std::atan2(K.p.y(), K.p.x());
  }
  if (n.gamma > std::numbers::pi / 2) n.gamma -= std::numbers::pi;
  if (n.gamma <= -std::numbers::pi / 2) n.gamma += std::numbers::pi;
  const Pose rest = Pose{rotation_z(-n.gamma), Vec3::Zero()} * K;
  n.alpha = std::atan2(-rest.R(1, 2), rest.R(2, 2));
  n.a = rest.p.x();
  const double s = std::sin(n.alpha), c = std::cos(n.alpha);
  n.d = parallel ? 0 : -rest.p.y() / s;
  n.delta = rest.p.z() - c * n.d;
  const Mat3 turn = rotation_x(-n.alpha) * rest.R;
  n.theta = std::atan2(turn(1, 0), turn(0, 0));
  return n;
}

/// A row in front of its joint's turn about z and behind it.
struct Row {
  Pose before, after;
};
Row fixed_parts(const SerialArm& arm, const DhRow& row) {
  const Pose x = screw_x(row.a, row.alpha), z = screw_z(0, row.d);
  return arm.convention == DhConvention::standard ? Row{{}, z * x} : Row{x, z};
}
Pose held(const DhRow& row, double value) {
  return row.kind == JointKind::revolute ? screw_z(row.theta_offset + row.sign * value, 0)
                                         : screw_z(row.theta_offset, row.sign * value);
}

/// A joint that moves: theta = sense q + its row's theta_offset.
struct Turn {
  const DhRow* row = nullptr;
  double sense = 1;
};

/// What genserkins computes: the product of R_x(ALPHA) T_x(A) R_z(joint) T_z(D).
struct Craig {
  std::array<double, kJoints> a{}, alpha{}, d{}, offset{};
  [[nodiscard]] Pose forward(const std::array<double, kJoints>& joint) const {
    Pose X;
    for (std::size_t i = 0; i < kJoints; ++i) X = X * screw_x(a[i], alpha[i]) * screw_z(joint[i], d[i]);
    return X;
  }
};

double within_half_turn(double angle) {
  return std::remainder(angle, 2 * std::numbers::pi);
}

}  // namespace

Result<Settings> arm_settings(const SerialArm& arm, const SettingsOptions& options) {
  Settings s;
  s.machine = arm.name;
  s.module = "genserkins";
  // The constant motions between the joints' axes: K[0] in front of the first, K[n] behind the last.
  std::vector<Pose> K(1);
  std::vector<Turn> joints;
  if (arm.is_coupled()) return fail("CN102", "the arm has coupled joints, and genserkins has none", {}, kTargetsHint);
  for (const DhRow& row : arm.dh) {
    const Row part = fixed_parts(arm, row);
    K.back() = K.back() * part.before;
    if (row.locked) {
      K.back() = K.back() * held(row, *row.locked) * part.after;
      continue;
    }
    if (row.kind != JointKind::revolute) {
      return fail("CN102", fmt::format("joint {} slides; genserkins has turning joints only", joints.size() + 1), {},
                  kTargetsHint);
    }
    joints.push_back({&row, row.sign});
    K.push_back(part.after);
  }
  K.back() = K.back() * arm.X_FT;
  const std::size_t n = joints.size();
  if (n != kJoints && n != kJoints - 1) {
    return fail("CN102",
                fmt::format("the arm has {} joints that move; genserkins has six (five get a sixth about the tool)", n),
                {}, kTargetsHint);
  }
  const bool idle = n < kJoints;  // joint 6 is the tool axis, without a motor
  if (idle) K.emplace_back();
  const double half_turn = std::numbers::pi;
  const bool flip = K.back().R(2, 2) < 0;  // axis 6 points from spindle to tip: take it the other way round
  if (flip) {
    K[kJoints - 1] = K[kJoints - 1] * screw_x(0, half_turn);
    K[kJoints] = screw_x(0, half_turn) * K[kJoints];
    joints.back().sense = -joints.back().sense;
  }

  Craig craig;
  std::array<double, kJoints> turned{};  // joint of genserkins where ours reads 0
  for (std::size_t i = 0; i < n; ++i) turned[i] = joints[i].row->theta_offset;
  if (flip) turned[kJoints - 1] = -turned[kJoints - 1];
  // The base: its place is a work offset unless it lies along z, its turn goes to ALPHA-0 and joint 1.
  const Pose base{arm.X_MB.R * K[0].R, Vec3::Zero()};
  const CommonNormal first = common_normal(base);
  const Vec3 place = arm.X_MB * K[0].p;
  Vec3 place_C = rotation_z(-first.gamma) * place;
  {
    const Vec3 along = rotation_x(first.alpha).col(2);
    craig.alpha[0] = first.alpha;
    turned[0] += first.theta;
    // Whatever of it A-0 and D-0 can hold, {C} need not.
    craig.a[0] = std::abs(std::sin(first.alpha)) > kParallel ? place_C.x() : 0;
    place_C.x() -= craig.a[0];
    const double flat = std::abs(std::sin(first.alpha));
    if (flat < kParallel) {
      craig.d[0] = place_C.z() * along.z();
    } else if (flat > 0.1) {
      craig.d[0] = place_C.y() / along.y();
    }
    place_C -= craig.d[0] * along;
  }
  s.work_rotation = first.gamma == 0 ? 0 : -first.gamma;
  for (int k = 0; k < 3; ++k) s.work_offset[k] = std::abs(place_C[k]) < kRounding ? 0 : -place_C[k];
  for (std::size_t i = 1; i < kJoints; ++i) {
    const CommonNormal normal = common_normal(K[i]);
    turned[i - 1] += normal.gamma;
    craig.d[i - 1] += normal.delta;
    craig.a[i] = normal.a;
    craig.alpha[i] = normal.alpha;
    turned[i] += normal.theta;
    craig.d[i] += normal.d;
  }
  turned[kJoints - 1] += std::atan2(K[kJoints].R(1, 0) - K[kJoints].R(0, 1), K[kJoints].R(0, 0) + K[kJoints].R(1, 1));
  craig.d[kJoints - 1] += K[kJoints].p.z();
  const double aside = K[kJoints].p.head<2>().norm();
  const double tilt = std::atan2(K[kJoints].R.col(2).head<2>().norm(), K[kJoints].R(2, 2));
  if (tilt > kMostTilt) {
    return fail("CN102",
                fmt::format("the tool axis is {:.4g} deg off axis 6 (and its tip lies {:.4g} mm beside it); "
                            "genserkins has no tool frame",
                            units::to_deg(tilt), units::to_mm(aside)),
                {}, kTargetsHint);
  }

  const std::vector<calibration::Stand> stands =
      calibration::random_stands(machine::AnyMachine(arm), options.points, options.seed);
  if (stands.empty()) return fail("CN104", "no pose within the limits was found");
  MissCount count;
  for (const calibration::Stand& stand : stands) {
    std::array<double, kJoints> joint = turned;
    for (std::size_t i = 0; i < n; ++i) joint[i] += joints[i].sense * stand.q[Eigen::Index(i)];
    const Pose asked{rotation_z(s.work_rotation) * stand.X_MT.R,
                     rotation_z(s.work_rotation) * stand.X_MT.p + s.work_offset};
    const Pose got = craig.forward(joint);
    count.add((got.p - asked.p).norm());
    s.angle_after = std::max(s.angle_after, rotation_vector(got.R * asked.R.transpose()).norm());
  }
  s.after = count.misses();
  s.points = stands.size();
  s.exact = s.after.max < kRounding && s.angle_after < 10 * kRounding;

  put(s, "KINS", "KINEMATICS", "genserkins");
  put(s, "KINS", "JOINTS", "6");
  put(s, "TRAJ", "COORDINATES", "XYZABC");
  for (std::size_t i = 0; i < kJoints; ++i) {
    put(s, "HAL", fmt::format("genserkins.A-{}", i), units::to_mm(craig.a[i]));
    put(s, "HAL", fmt::format("genserkins.ALPHA-{}", i), craig.alpha[i]);
    put(s, "HAL", fmt::format("genserkins.D-{}", i), units::to_mm(craig.d[i]));
  }
  std::string backwards;
  for (std::size_t i = 0; i < kJoints; ++i) {
    if (i >= n) {
      constexpr double kManyTurns = 36000;  // deg
      put_joint(s, int(i), true, 0, 0, -kManyTurns, kManyTurns);
      continue;
    }
    const Turn& turn = joints[i];
    const double offset = units::to_deg(within_half_turn(turned[i]));
    double low = offset + turn.sense * units::to_deg(turn.row->range.min);
    double high = offset + turn.sense * units::to_deg(turn.row->range.max);
    if (low > high) std::swap(low, high);
    put_joint(s, int(i), true, offset, offset, low, high);
    if (turn.sense < 0) backwards += fmt::format("{}{}", backwards.empty() ? "" : ", ", i);
  }
  s.notes.emplace_back(
      "The joints of genserkins are the angles of its own table. HOME_OFFSET holds theta_offset and is the angle where "
      "the joint reads 0; for a switch at a reading q write this value + q.");
  if (!backwards.empty()) {
    s.notes.push_back(
        fmt::format("Counting against the drive's reading: joint {}. Change the sign of SCALE there, and write "
                    "HOME_OFFSET - q for a switch at a reading q.",
                    backwards));
  }
  if (idle) {
    s.notes.emplace_back(
        "Joint 5 has no motor: it is the tool axis and takes the C of the program. Connect its motor-pos-cmd to its "
        "motor-pos-fb.");
  }
  s.notes.emplace_back(
      "The tool's tip is in the table: genserkins does not turn a tool offset (G43) with the tool. For another tool "
      "make the settings anew.");
  if (!s.exact) {
    s.notes.push_back(
        fmt::format("genserkins has no tool frame: the tip lies {:.4g} mm beside axis 6 and the tool axis is {:.4g} "
                    "deg off it, which is left out. {}.",
                    units::to_mm(aside), units::to_deg(tilt), kTargetsHint));
  }
  return s;
}

}  // namespace polypod::control
