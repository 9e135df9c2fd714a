// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/serial/kinematics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "../turns.hpp"
#include "coupled.hpp"
#include "polypod/families/serial/frames.hpp"
#include "polypod/geometry/trigonometry.hpp"
#include "polypod/kinematics/closure.hpp"
#include "redundant.hpp"
#include "scara.hpp"
#include "six_joints.hpp"

namespace polypod::machine {
namespace {

constexpr double kPi = std::numbers::pi;
// Two lengths or directions of a table count as equal below this (m, rad): far above the rounding of degrees in files,
// far below any workshop.
constexpr double kSame = 1e-12;
// A solution that misses a limit by less than this keeps it (rad): rounding of the inverse.
constexpr double kLimitSlack = 1e-9;

const DhRow& free_row(const SerialArm& arm, int joint) {
  int seen = 0;
  for (const DhRow& row : arm.dh)
    if (!row.locked && seen++ == joint) return row;
  return arm.dh.back();
}

/// The turn of an angle that lies in its range if there is one, else the one in (-pi, pi].
double in_range(double angle, double min, double max) {
  double q = angle;  // sums of a few angles: a turn or two away at most, where std::remainder would cost more
  while (q > kPi) q -= 2 * kPi;
  while (q < -kPi) q += 2 * kPi;
  if (q > max + kLimitSlack && q - 2 * kPi >= min - kLimitSlack) q -= 2 * kPi;
  if (q < min - kLimitSlack && q + 2 * kPi <= max + kLimitSlack) q += 2 * kPi;
  if (min > kPi || max < -kPi) q = six::in_some_turn(q, min - kLimitSlack, max + kLimitSlack);
  return q;
}

/// A sine and a cosine of one angle.
struct Turn {
  double c, s;
};
/// Of a twist: no row of most tables has another than 0 and a quarter of a turn.
Turn turn_of_twist(double alpha) {
  constexpr double kCosineOfQuarter = 6.123233995736766e-17;  // of pi / 2 as a double
  if (alpha == 0) return {1, 0};
  if (std::abs(alpha) == kPi / 2) return {kCosineOfQuarter, alpha > 0 ? 1.0 : -1.0};
  return {std::cos(alpha), std::sin(alpha)};
}

/// Of the direction from the origin to (x, y); of none the angle is 0.
Turn turn_to(double x, double y) {
  const double n = std::sqrt(square(x) + square(y));
  return n > 0 ? Turn{x / n, y / n} : Turn{1, 0};
}
Turn operator+(const Turn& a, const Turn& b) {
  return {a.c * b.c - a.s * b.s, a.s * b.c + a.c * b.s};
}

/// What a joint makes of its row: the turn theta and the shift d.
struct RowAt {
  Turn turn;
  double d;
};

/// theta and d of a row at its joint's value.
double theta_of(const DhRow& row, double value) {
  return row.theta_offset + (row.kind == JointKind::revolute ? row.sign * value : 0.0);
}
double d_of(const DhRow& row, double value) {
  return row.d + (row.kind == JointKind::revolute ? 0.0 : row.sign * value);
}

/// X times a row's matrix: Rz(theta) and Rx(alpha) one after the other, with half the products of the matrix.
void pass_row(Pose& X, const DhRow& row, DhConvention convention, const RowAt& at) {
  const double ct = at.turn.c, st = at.turn.s, d = at.d, a = row.a;
  const auto [ca, sa] = turn_of_twist(row.alpha);
  const bool standard = convention == DhConvention::standard;
  for (int i = 0; i < 3; ++i) {
    double x = X.R(i, 0), y = X.R(i, 1), z = X.R(i, 2), y_turned = 0;
    if (standard) {
      y_turned = ct * y - st * x;
      x = ct * x + st * y;
      X.p[i] += a * x + d * z;
      y = ca * y_turned + sa * z;
      z = ca * z - sa * y_turned;
    } else {
      y_turned = ca * y + sa * z;
      z = ca * z - sa * y;
      X.p[i] += a * x + d * z;
      y = ct * y_turned - st * x;
      x = ct * x + st * y_turned;
    }
    X.R(i, 0) = x;
    X.R(i, 1) = y;
    X.R(i, 2) = z;
  }
}

/// All rows of an arm at its joints.
class Rows {
 public:
  Rows(const SerialArm& arm, const JointVector& q) : arm_(arm) {
    static_assert(kMaxJoints % 2 == 0);
    double theta[kMaxJoints], joint[kMaxJoints];
    int next = 0;
    const std::size_t count = arm.dh.size();
    for (std::size_t i = 0; i < count; ++i) {
      const DhRow& row = arm.dh[i];
      const double value = row.locked ? *row.locked : q[next++];
      theta[i] = theta_of(row, value);
      d_[i] = d_of(row, value);
      joint[i] = value;
      if (row.coupled_back > 0) theta[i] += row.coupling * joint[i - static_cast<std::size_t>(row.coupled_back)];
    }
    if (count % 2 != 0) theta[count] = 0;
    cosines_and_sines(theta, static_cast<int>(count + count % 2), c_, s_);
  }
  /// X times the matrix of row number i.
  void pass(Pose& X, std::size_t i) const { pass_row(X, arm_.dh[i], arm_.convention, {{c_[i], s_[i]}, d_[i]}); }

 private:
  const SerialArm& arm_;
  double c_[kMaxJoints], s_[kMaxJoints], d_[kMaxJoints];  // as many as there are rows
};

constexpr int kMostStarts = 96;  // of arms whose task leaves a joint free
bool leaves_free(const SerialArm& arm) {
  return arm.free_joints() > arm.task.size();
}

/// The search puts each joint into a turn within its range by itself. Where that turns another row by a part of a turn,
/// the pose is another: back by whole turns until it is that of the target, or the solution is none.
void put_back_turns(const SerialArm& arm, const Pose& X_MT, InverseResult& found) {
  constexpr double kThere = 1e-6;  // m and rad
  constexpr int kMostTurns = 3;
  std::vector<int> leaders;
  for (int i = 0; i < arm.free_joints(); ++i)
    if (!turns_alone(arm, i)) leaders.push_back(i);
  if (leaders.empty()) return;
  const auto is_there = [&](const JointVector& q) {
    return kinematics::closure_detail::pose_error(arm.task, X_MT, forward(arm, q)).norm() < kThere;
  };
  const auto put_back = [&](JointVector& q) {
    if (is_there(q)) return true;
    for (const int i : leaders) {
      for (int turns = 1; turns <= kMostTurns; ++turns) {
        for (const double way : {1.0, -1.0}) {
          JointVector there = q;
          there[i] += way * turns * 2 * kPi;
          if (!is_there(there)) continue;
          q = there;
          return true;
        }
      }
    }
    return false;
  };
  std::erase_if(found.solutions, [&](kinematics::Solution& s) {
    if (!put_back(s.joints)) return true;
    s.violations = kinematics::violations_of_limits(arm, X_MT, s.joints);
    return false;
  });
  if (!found.converged || !found.solutions.empty()) return;
  found.converged = false;
  found.reason = "the numeric search found the pose in no turn of the joints that turn others";
}

InverseResult inverse_numerically(const SerialArm& arm, const Pose& X_MT, const kinematics::DampedOptions& options) {
  InverseResult out = kinematics::inverse_damped(
      arm, X_MT, [&](const JointVector& q) { return forward(arm, q); },
      [&](const Pose& X, const JointVector& q) { return jacobian(arm, X, q); }, options);
  put_back_turns(arm, X_MT, out);
  return out;
}

}  // namespace

JointKind joint_kind(const SerialArm& arm, int joint) {
  return free_row(arm, joint).kind;
}
JointRange joint_range(const SerialArm& arm, int joint) {
  return free_row(arm, joint).range;
}

double joint_speed_limit(const SerialArm& arm, int joint) {
  return free_row(arm, joint).speed;
}

LimitTable limit_table(const SerialArm& arm) {
  double size = arm.X_FT.p.norm();
  for (const DhRow& row : arm.dh) size += std::abs(row.a) + std::abs(row.d);
  LimitTable out;
  int joint = 0;
  for (const DhRow& row : arm.dh) {
    if (row.locked) continue;
    const LimitInfo info{fmt::format("{}", ++joint), row.kind == JointKind::revolute && size > 0 ? size : 1.0, true,
                         false, true};
    out.insert(out.end(), 2, info);
  }
  return out;
}

std::string limit_name(const SerialArm&, int limit) {  // joints that are locked have no number
  return fmt::format("joint {} {}", limit / 2 + 1, limit % 2 == 0 ? "below its minimum" : "above its maximum");
}

std::vector<Pose> frames_of_table(const SerialArm& arm, const JointVector& q) {
  std::vector<Pose> out{arm.X_MB};
  out.reserve(arm.dh.size() + 1);
  const Rows rows(arm, q);
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    out.push_back(out.back());
    rows.pass(out.back(), i);
  }
  return out;
}

Pose forward(const SerialArm& arm, const JointVector& q) {
  Pose X = arm.X_MB;
  const Rows rows(arm, q);
  for (std::size_t i = 0; i < arm.dh.size(); ++i) rows.pass(X, i);
  return X * arm.X_FT;
}

ForwardJacobian forward_jacobian(const SerialArm& arm, const JointVector& q, bool locked_too) {
  ForwardJacobian out;
  Vec3 axis[kMaxJoints], origin[kMaxJoints];
  JointKind kind[kMaxJoints];
  int columns = 0;
  // Rows that a joint turns besides its own: its column, and the screw.
  struct Further {
    int column;
    Vec3 axis, origin;
  };
  int column_of[kMaxJoints], further = 0;
  Further more[kMaxJoints];
  Pose X = arm.X_MB;
  const Rows rows(arm, q);
  const bool standard = arm.convention == DhConvention::standard;
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    const Pose before = X;
    rows.pass(X, i);
    const Pose& frame = standard ? before : X;
    column_of[i] = row.locked && !locked_too ? -1 : columns;
    if (row.coupled_back > 0) {
      const int column = column_of[i - static_cast<std::size_t>(row.coupled_back)];
      if (column >= 0) more[further++] = {column, row.coupling * frame.R.col(2), frame.p};
    }
    if (column_of[i] < 0) continue;
    axis[columns] = row.sign * frame.R.col(2);
    origin[columns] = frame.p;
    kind[columns] = row.kind;
    ++columns;
  }
  out.X_MT = X * arm.X_FT;
  out.J.resize(6, columns);
  for (int i = 0; i < columns; ++i) {
    if (kind[i] == JointKind::revolute) {
      out.J.col(i).head<3>() = axis[i].cross(out.X_MT.p - origin[i]);
      out.J.col(i).tail<3>() = axis[i];
    } else {
      out.J.col(i).head<3>() = axis[i];
      out.J.col(i).tail<3>().setZero();
    }
  }
  for (int k = 0; k < further; ++k) {
    out.J.col(more[k].column).head<3>() += more[k].axis.cross(out.X_MT.p - more[k].origin);
    out.J.col(more[k].column).tail<3>() += more[k].axis;
  }
  return out;
}

Eigen::Matrix<double, 6, Eigen::Dynamic> parameter_columns(const SerialArm& arm, const JointVector& q) {
  const auto count = static_cast<Eigen::Index>(arm.dh.size());
  Eigen::Matrix<double, 6, Eigen::Dynamic> out(6, 4 * count);
  // First the axes with their points, then, the tip known, what they do to it.
  Pose X = arm.X_MB;
  const Rows rows(arm, q);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Pose before = X;
    rows.pass(X, static_cast<std::size_t>(i));
    // Standard: turn and shift along z of the frame before, then along x of the frame after; modified: the other way.
    const bool standard = arm.convention == DhConvention::standard;
    const Pose &x_frame = standard ? X : before, &z_frame = standard ? before : X;
    out.col(4 * i) << x_frame.R.col(0), Vec3::Zero();
    out.col(4 * i + 1) << x_frame.p, x_frame.R.col(0);
    out.col(4 * i + 2) << z_frame.R.col(2), Vec3::Zero();
    out.col(4 * i + 3) << z_frame.p, z_frame.R.col(2);
  }
  const Vec3 tip = (X * arm.X_FT).p;
  for (Eigen::Index i = 0; i < count; ++i) {
    for (const Eigen::Index c : {4 * i + 1, 4 * i + 3}) {
      const Vec3 point = out.col(c).head<3>(), axis = out.col(c).tail<3>();
      out.col(c).head<3>() = axis.cross(tip - point);
    }
  }
  return out;
}

JacobianMatrix jacobian(const SerialArm& arm, const Pose&, const JointVector& q) {
  return forward_jacobian(arm, q).J;
}

Result<WristInverse> WristInverse::of(const SerialArm& arm) {
  const auto no = [](const char* why) { return fail("KI100", why); };
  if (arm.convention != DhConvention::standard || arm.task != Task::axis || arm.dh.size() < 5 || arm.is_coupled()) {
    return no("not a standard table of a 5-axis machine");
  }
  for (std::size_t i = 0; i < arm.dh.size(); ++i) {
    const DhRow& row = arm.dh[i];
    if (row.kind != JointKind::revolute || (i < 5) == row.locked.has_value()) return no("needs five free joints first");
  }
  const auto is = [](double x, double y) { return x == y || std::abs(std::remainder(x - y, 2 * kPi)) < kSame; };
  const auto& r = arm.dh;
  if (!is(r[0].alpha, kPi / 2) || !is(r[1].alpha, 0) || !is(r[2].alpha, kPi / 2) || !is(r[3].alpha, -kPi / 2)) {
    return no("the twists of joints 1 to 4 are not 90, 0, 90, -90 deg");
  }
  if (std::abs(r[1].d) > kSame || std::abs(r[2].a) > kSame || std::abs(r[2].d) > kSame || std::abs(r[3].a) > kSame) {
    return no("joints 2 to 4 have offsets");
  }
  // The tool in the frame that turns with joint 5: its axis must lie across joint 5 and run through the wrist centre.
  Pose E;
  pass_row(E, r[4], arm.convention, {{1, 0}, r[4].d});
  for (std::size_t i = 5; i < r.size(); ++i) {
    const double theta = theta_of(r[i], *r[i].locked);
    pass_row(E, r[i], arm.convention, {{std::cos(theta), std::sin(theta)}, r[i].d});
  }
  E = E * arm.X_FT;
  const Vec3 k = E.R.col(2);
  if (std::abs(k.z()) > kSame || (E.p + E.p.norm() * k).norm() > kSame * (1 + E.p.norm())) {
    return no("the tool axis does not run through the wrist centre across joint 5");
  }
  if (!(r[1].a > 0) || !(std::abs(r[3].d) > 0)) return no("a link has no length");
  WristInverse out;
  out.X_BM_ = arm.X_MB.inverse();
  out.a1_ = r[0].a;
  out.d1_ = r[0].d;
  out.a2_ = r[1].a;
  out.d4_ = r[3].d;
  out.reach_ = E.p.norm();
  out.axis_angle_ = std::atan2(k.y(), k.x());
  for (int i = 0; i < 5; ++i) {
    out.sign_[i] = r[i].sign;
    out.offset_[i] = r[i].theta_offset;
    out.min_[i] = r[i].range.min;
    out.max_[i] = r[i].range.max;
  }
  return out;
}

void WristInverse::solve(const Vec3& p_M, const Vec3& k_M, Branches& out) const {
  // The directions of all angles, those of both shoulders, and of both elbows of each.
  enum : int { kFirst = 0, kThird = 1, kBetween = 3, kToWrist = 5, kFourth = 8, kFifth = 12, kAngles = 16 };
  double y[kAngles] = {}, x[kAngles] = {}, angle[kAngles];
  const Vec3 k = X_BM_.R * k_M;
  const Vec3 c = X_BM_ * p_M + reach_ * k;  // wrist centre (2.18)
  const double r = std::sqrt(square(c.x()) + square(c.y()));
  const double height = c.z() - d1_;
  const bool over_axis = r < kSame;
  const double c1_front = over_axis ? 1.0 : c.x() / r, s1_front = over_axis ? 0.0 : c.y() / r;
  x[kFirst] = c1_front;
  y[kFirst] = s1_front;
  bool reached[2] = {}, wrist_free[2][2] = {};
  for (int shoulder = 0; shoulder < 2; ++shoulder) {
    const double side = shoulder == 0 ? 1.0 : -1.0;
    const double c1 = side * c1_front, s1 = side * s1_front, rho = side * r - a1_;
    // s3 by the law of cosines (2.20); the elbow's two sides are the two signs of its cosine (2.21).
    const double s3_raw = (rho * rho + height * height - a2_ * a2_ - d4_ * d4_) / (2 * a2_ * d4_);
    const double s3 = std::clamp(s3_raw, -1.0, 1.0), c3_up = std::sqrt((1 - s3) * (1 + s3));
    const double along = a2_ + d4_ * s3, across = d4_ * c3_up;  // the wrist centre against the upper arm
    reached[shoulder] = std::abs(s3_raw) <= 1 + 1e-14;
    if (!reached[shoulder]) continue;
    x[kThird + shoulder] = c3_up;
    y[kThird + shoulder] = s3;
    x[kBetween + shoulder] = along;
    y[kBetween + shoulder] = across;
    x[kToWrist + shoulder] = rho;
    y[kToWrist + shoulder] = height;
    const Turn to_wrist = turn_to(rho, height), between = turn_to(along, across);
    // k in frame 3, whose axes in the base are (c23 x1 + s23 z), (normal n), (s23 x1 - c23 z) (2.24), (2.28).
    const double k_out = c1 * k.x() + s1 * k.y(), k3y = s1 * k.x() - c1 * k.y();
    for (int elbow = 0; elbow < 2; ++elbow) {
      const Turn turn_2 = to_wrist + Turn{between.c, elbow == 0 ? between.s : -between.s};
      const auto [c23, s23] = turn_2 + Turn{elbow == 0 ? c3_up : -c3_up, s3};
      const double k3x = c23 * k_out + s23 * k.z(), k3z = s23 * k_out - c23 * k.z();
      // k_3 = (c4 c5, s4 c5, -s5), s5 the sine of the axis angle of joint 5 (2.25).
      const double s5 = std::clamp(-k3z, -1.0, 1.0), c5 = std::sqrt(square(k3x) + square(k3y));
      wrist_free[shoulder][elbow] = c5 < 1e-12;
      const int at = 2 * shoulder + elbow;
      if (!wrist_free[shoulder][elbow]) {
        x[kFourth + at] = k3x;
        y[kFourth + at] = k3y;
      }
      x[kFifth + at] = c5;
      y[kFifth + at] = s5;
    }
  }
  angles_of(y, x, angle);
  for (int shoulder = 0; shoulder < 2; ++shoulder) {
    const double t1 = shoulder == 0 ? angle[kFirst] : angle[kFirst] + kPi;
    const double t3_up = angle[kThird + shoulder], between = angle[kBetween + shoulder];
    for (int elbow = 0; elbow < 2; ++elbow) {
      const int base = 4 * elbow + 2 * shoulder, at = 2 * shoulder + elbow;
      out.exists[base] = out.exists[base + 1] = reached[shoulder];
      if (!reached[shoulder]) continue;
      const double t3 = elbow == 0 ? t3_up : kPi - t3_up;
      const double t2 = angle[kToWrist + shoulder] + (elbow == 0 ? between : -between);  // (2.22)
      const double t4 = angle[kFourth + at], t5 = angle[kFifth + at];
      const double angles[2][5] = {{t1, t2, t3, t4, t5 - axis_angle_}, {t1, t2, t3, t4 + kPi, kPi - t5 - axis_angle_}};
      for (int wrist = 0; wrist < 2; ++wrist) {
        JointVector& q = out.joints[base + wrist];
        q.resize(5);
        for (int i = 0; i < 5; ++i) q[i] = in_range(sign_[i] * (angles[wrist][i] - offset_[i]), min_[i], max_[i]);
        if (wrist_free[shoulder][elbow]) q[3] = 0;
        out.singular[base + wrist] = wrist_free[shoulder][elbow] || over_axis;
      }
    }
  }
}

LimitBits WristInverse::violations(const JointVector& q) const {
  LimitBits bits = 0;
  for (int i = 0; i < 5; ++i) {
    bits |= LimitBits{q[i] < min_[i] - kLimitSlack} << (2 * i);
    bits |= LimitBits{q[i] > max_[i] + kLimitSlack} << (2 * i + 1);
  }
  return bits;
}

int WristInverse::first_within_limits(const Branches& branches) const {
  for (int b = 0; b < kBranches; ++b)
    if (branches.exists[b] && violations(branches.joints[b]) == 0) return b;
  return -1;
}

namespace {

bool same_row(const DhRow& a, const DhRow& b) {
  return a.a == b.a && a.alpha == b.alpha && a.d == b.d && a.theta_offset == b.theta_offset && a.sign == b.sign &&
         a.kind == b.kind && a.locked == b.locked && a.range.min == b.range.min && a.range.max == b.range.max &&
         a.coupled_back == b.coupled_back && a.coupling == b.coupling;
}

/// What the closed inverses of an arm follow from.
struct Geometry {
  DhConvention convention;
  Task task;
  std::vector<DhRow> dh;
  Pose X_MB, X_FT;

  explicit Geometry(const SerialArm& arm)
      : convention(arm.convention), task(arm.task), dh(arm.dh), X_MB(arm.X_MB), X_FT(arm.X_FT) {}
  [[nodiscard]] bool is_of(const SerialArm& arm) const {
    return convention == arm.convention && task == arm.task && std::ranges::equal(dh, arm.dh, same_row) &&
           X_MB.R == arm.X_MB.R && X_MB.p == arm.X_MB.p && X_FT.R == arm.X_FT.R && X_FT.p == arm.X_FT.p;
  }
};

struct Inverses {
  ClosedInverse closed;
  std::optional<RedundantInverse> redundant;
};
/// Those of the arm which this thread asked for last are at hand: comparing its figures takes a tenth of finding its
/// form. Good until the next call.
const Inverses& inverses_of(const SerialArm& arm) {
  thread_local std::optional<Geometry> known;
  thread_local Inverses found;
  if (known && known->is_of(arm)) return found;
  known.reset();
  found.closed = ClosedInverse::of(arm);
  found.redundant = found.closed.exists() ? std::nullopt : RedundantInverse::of(arm);
  known.emplace(arm);
  return found;
}
const ClosedInverse& closed_inverse(const SerialArm& arm) {
  return inverses_of(arm).closed;
}
const std::optional<RedundantInverse>& redundant_inverse(const SerialArm& arm) {
  return inverses_of(arm).redundant;
}

InverseResult all_of(const WristInverse& five, const Pose& X_MT) {
  InverseResult out;
  out.solutions.reserve(WristInverse::kBranches);
  WristInverse::Branches branches;
  five.solve(X_MT.p, X_MT.R.col(2), branches);
  for (int b = 0; b < WristInverse::kBranches; ++b) {
    if (!branches.exists[b]) continue;
    const JointVector& q = branches.joints[b];
    out.solutions.push_back({q, unsigned(b), five.violations(q), branches.singular[b]});
  }
  if (out.solutions.empty()) out.reason = "the wrist centre is out of reach of the two links";
  return out;
}

}  // namespace

ClosedInverse ClosedInverse::of(const SerialArm& arm) {
  ClosedInverse out;
  if (const auto spherical = SphericalWristInverse::of(arm)) {
    out.six = *spherical;
  } else if (const auto parallel = ThreeParallelInverse::of(arm)) {
    out.six = *parallel;
  } else if (const auto pieper = PieperInverse::of(arm)) {
    out.six = *pieper;
  } else if (const auto five = WristInverse::of(arm)) {
    out.five = *five;
  } else if (const auto cartesian = CartesianInverse::of(arm)) {
    out.cartesian = *cartesian;
  } else if (const auto scara = ScaraInverse::of(arm)) {
    out.scara = std::make_shared<const ScaraInverse>(*scara);
  } else if (auto coupled = CoupledInverse::of(arm)) {
    out.coupled = std::make_shared<const CoupledInverse>(std::move(*coupled));
  }
  return out;
}

InverseResult ClosedInverse::solve(const Pose& X_MT, const double* reference) const {
  if (coupled) return coupled->solve(X_MT, reference);
  if (scara) return scara->solve(X_MT, reference);
  if (six) return std::visit([&](const auto& form) { return form.solve(X_MT, reference); }, *six);
  if (cartesian) return cartesian->solve(X_MT, reference);
  return all_of(*five, X_MT);
}

std::optional<SixJointInverse> six_joint_inverse(const SerialArm& arm) {
  return closed_inverse(arm).six;
}

bool has_six_joint_branches(const SerialArm& arm) {
  const ClosedInverse& closed = closed_inverse(arm);
  return closed.six || (closed.coupled && closed.coupled->without().six);
}

bool reaches(const SerialArm& arm, const Pose& X_MT, LimitBits heeded) {
  if (has_closed_inverse(arm)) return inverse(arm, X_MT).keeps(heeded);
  const std::optional<RedundantInverse>& redundant = redundant_inverse(arm);
  if (redundant && (redundant->own_limits() & ~heeded) == 0) return redundant->reaches(X_MT, heeded);
  kinematics::DampedOptions options;
  options.max_iterations = 60;
  constexpr int kMostInVain = 8;  // starts from which nothing was found, and nothing by any other
  bool found = false;
  const int starts = leaves_free(arm) ? kMostStarts : options.seeds;
  for (int start = 0; start < starts && (found || start < kMostInVain); ++start) {
    options.start = kinematics::closure_detail::start_joints(arm, start);
    const InverseResult there = inverse_numerically(arm, X_MT, options);
    if (there.keeps(heeded)) return true;
    found = found || there.converged;
  }
  return false;
}

bool has_closed_inverse(const SerialArm& arm) {
  return closed_inverse(arm).exists();
}

bool names_branches(const SerialArm& arm) {
  const Inverses& found = inverses_of(arm);
  return found.closed.exists() || found.redundant;
}

std::string branch_name(const SerialArm& arm, unsigned branch) {
  static constexpr const char* kNames[WristInverse::kBranches] = {
      "front elbow-up",   "front elbow-up wrist-flipped",   "back elbow-up",   "back elbow-up wrist-flipped",
      "front elbow-down", "front elbow-down wrist-flipped", "back elbow-down", "back elbow-down wrist-flipped"};
  if (branch >= WristInverse::kBranches) return fmt::format("numeric-{}", branch - kinematics::kNumericBranch + 1);
  const ClosedInverse& own = closed_inverse(arm);
  const std::optional<RedundantInverse>& redundant = redundant_inverse(arm);
  const ClosedInverse& named = own.exists() || !redundant ? own : redundant->closed();
  const ClosedInverse& closed = named.coupled ? named.coupled->without() : named;
  if (closed.cartesian) return CartesianInverse::branch_name(branch);
  if (closed.scara) return ScaraInverse::branch_name(branch);
  const std::optional<SixJointInverse>& six = closed.six;
  const bool numbered = six && std::holds_alternative<PieperInverse>(*six);
  return numbered ? fmt::format("arm-{}{}", branch / 2 + 1, branch % 2 == 0 ? "" : " wrist-flipped") : kNames[branch];
}

namespace {
/// Solutions of a search in the branch of the closed inverse that they have, where there is one.
void name_branches(const SerialArm& arm, const Pose& X_MT, InverseResult& found) {
  const std::optional<RedundantInverse>& redundant = redundant_inverse(arm);
  if (!redundant) return;
  for (kinematics::Solution& s : found.solutions)
    if (const auto branch = redundant->branch_of(X_MT, s.joints)) s.branch = *branch;
}
}  // namespace

InverseResult inverse_from(const SerialArm& arm, const Pose& X_MT, const JointVector& start) {
  kinematics::DampedOptions options;
  options.start = start;
  InverseResult out = inverse_numerically(arm, X_MT, options);
  name_branches(arm, X_MT, out);
  return out;
}

namespace {

/// Where joints are left free and none of the usual starts ends within the limits, further starts until one does.
InverseResult found_numerically(const SerialArm& arm, const Pose& X_MT) {
  InverseResult out = inverse_numerically(arm, X_MT, {});
  if (!out.converged || !leaves_free(arm)) return out;
  kinematics::DampedOptions options;
  for (int start = options.seeds; start < kMostStarts && out.reachable() == nullptr; ++start) {
    options.start = kinematics::closure_detail::start_joints(arm, start);
    InverseResult there = inverse_numerically(arm, X_MT, options);
    if (there.reachable() == nullptr) continue;
    for (kinematics::Solution& s : out.solutions) ++s.branch;  // numbers of a search, in the order of the list
    out.solutions.insert(out.solutions.begin(), there.solutions.front());
  }
  return out;
}

/// Over the closed inverse of an arm with one joint more; where that keeps no limits, by search, too.
InverseResult found_over(const RedundantInverse& redundant, const SerialArm& arm, const Pose& X_MT) {
  InverseResult out = redundant.solve(X_MT);
  if (out.reachable() != nullptr) return out;
  InverseResult searched = found_numerically(arm, X_MT);
  if (searched.reachable() == nullptr && !out.solutions.empty()) return out;
  name_branches(arm, X_MT, searched);
  return searched;
}
}  // namespace

InverseResult inverse_near(const SerialArm& arm, const Pose& X_MT, const JointVector& last) {
  const ClosedInverse& closed = closed_inverse(arm);
  return closed.exists() ? closed.solve(X_MT, last.data()) : inverse_from(arm, X_MT, last);
}

std::function<std::optional<JointVector>(const Pose&)> joint_finder(const SerialArm& arm) {
  using Found = std::optional<JointVector>;
  const ClosedInverse& closed = closed_inverse(arm);
  if (closed.six) {
    return std::visit(
        [](const auto& form) -> std::function<Found(const Pose&)> {
          return [form](const Pose& X_MT) -> Found {
            SixJointBranches branches;
            form.solve(X_MT, branches);
            for (int b = 0; b < SixJointBranches::kCount; ++b) {
              if (!branches.exists[b] || form.violations(branches.joints[b]) != 0) continue;
              return JointVector(Eigen::Map<const Eigen::Matrix<double, 6, 1>>(branches.joints[b]));
            }
            return {};
          };
        },
        *closed.six);
  }
  if (closed.five) {
    return [form = *closed.five](const Pose& X_MT) -> Found {
      WristInverse::Branches branches;
      form.solve(X_MT.p, X_MT.R.col(2), branches);
      const int first = form.first_within_limits(branches);
      return first < 0 ? Found() : branches.joints[first];
    };
  }
  const auto first_of = [](const InverseResult& found) {
    const kinematics::Solution* first = found.reachable();
    return first == nullptr ? Found() : first->joints;
  };
  if (closed.cartesian) {
    return [form = *closed.cartesian, first_of](const Pose& X_MT) { return first_of(form.solve(X_MT)); };
  }
  if (closed.scara) {
    return [form = closed.scara, first_of](const Pose& X_MT) { return first_of(form->solve(X_MT)); };
  }
  if (closed.coupled) {
    return [form = closed.coupled, first_of](const Pose& X_MT) { return first_of(form->solve(X_MT)); };
  }
  if (const auto& redundant = redundant_inverse(arm)) {
    return [form = *redundant, first_of](const Pose& X_MT) { return first_of(form.solve(X_MT)); };
  }
  return {};
}

InverseResult inverse(const SerialArm& arm, const Pose& X_MT) {
  const Inverses& found = inverses_of(arm);
  if (found.closed.exists()) return found.closed.solve(X_MT);
  return found.redundant ? found_over(*found.redundant, arm, X_MT) : found_numerically(arm, X_MT);
}

}  // namespace polypod::machine
