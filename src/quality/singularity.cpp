// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/singularity.hpp"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "plan.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/golden_section.hpp"
#include "polypod/core/random.hpp"
#include "polypod/core/units.hpp"
#include "polypod/quality/survey.hpp"

namespace polypod::quality {
namespace {

/// Both sides of A dX + B dq = 0 without units; dX as [v / L; w].
struct Sides {
  Eigen::MatrixXd A, B;
  double length = 1;
  std::optional<double> constraints;  ///< see Singularity
  /// Where constraints without drives hold the tool exactly: the motions [v; L w] that they allow, as columns square to
  /// each other, each of length 1.
  Eigen::MatrixXd allowed;
  /// Where a chain behind closed loops turns the tool about its own axis, which the task leaves free: the speed that
  /// the task sees by the joints'. The equations do not show what that turn takes away.
  Eigen::MatrixXd seen;
  /// Of serial arms: the twists [v / L; w] in M, as rows, whose speeds the equations are about.
  Eigen::MatrixXd motions;
};

/// What a task sees of a twist [v / L; w] in M as rows square to each other, each of length 1: one that sees an angle
/// alone counts the turn that changes it and leaves the other two as they are, whatever speed that angle has.
Eigen::MatrixXd motions_of_task(machine::Task task, const Pose& X) {
  Eigen::MatrixXd out = machine::task_rows(task, X, 1.0);
  for (Eigen::Index i = 0; i < out.rows(); ++i) {
    const double before = out.row(i).norm();
    for (Eigen::Index k = 0; k < i; ++k) out.row(i) -= out.row(i).dot(out.row(k)) * out.row(k);
    const double left = out.row(i).norm();
    if (left > kRankLost * before)
      out.row(i) /= left;  // else two angles turn about one axis: no motion of its own
    else
      out.row(i).setZero();
  }
  return out;
}

/// The task's speed [v / L; w] by the joints', prismatic ones on L.
Eigen::MatrixXd speed_of_task(const AnyMachine& machine, const Pose& X, const JointVector& q, double L) {
  const machine::Task task = kinematics::task(machine);
  Eigen::MatrixXd out = kinematics::task_jacobian(task, kinematics::jacobian(machine, X, q), X);
  for (int i = 0; i < out.rows(); ++i)
    if (!task.is_angle(i)) out.row(i) /= L;
  for (int i = 0; i < out.cols(); ++i)
    if (kinematics::joint_kind(machine, i) == machine::JointKind::prismatic) out.col(i) *= L;
  return out;
}

Sides sides_of(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, double length) {
  const Pose X = kinematics::settled(machine, X_MT, q);
  Sides out;
  out.length = kinematics::dexterity(machine, X, q, length).characteristic_length;
  const double L = out.length;
  std::visit(
      [&](const auto& m) {
        if constexpr (requires { forward_jacobian(m, q); }) {
          auto fj = forward_jacobian(m, q);
          fj.J.topRows(3) /= L;
          for (int i = 0; i < fj.J.cols(); ++i)
            if (joint_kind(m, i) == machine::JointKind::prismatic) fj.J.col(i) *= L;
          out.motions = motions_of_task(task(m), fj.X_MT);
          out.A = Eigen::MatrixXd::Identity(out.motions.rows(), out.motions.rows());
          out.B = -out.motions * fj.J;
          return;
        }
        const std::vector<double> p = kinematics::nominal_parameters(m);
        const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
        out.A = kinematics::closure_by_pose(m, X, joints, p);
        out.B = kinematics::closure_by_joints(m, X, joints, p);
        if constexpr (requires { passive_rows(m, X); }) {
          Eigen::MatrixXd C = passive_rows(m, X).A;
          const int held = 6 - task(m).size();
          if (held < 1 || C.rows() < held) return;
          C.rightCols(3) /= L;
          kinematics::divide_rows(C);
          const Eigen::JacobiSVD<Eigen::MatrixXd> of_C(C, Eigen::ComputeFullV);
          out.constraints = of_C.singularValues()[held - 1];
          if (*out.constraints > kRankLost) out.allowed = of_C.matrixV().rightCols(6 - held);
        }
      },
      machine);
  if (kinematics::is_serial(machine)) return out;
  const machine::Task task = kinematics::task(machine);
  if (!out.constraints && task.names_axis() && q.size() == task.size()) out.seen = speed_of_task(machine, X, q, L);
  out.A.rightCols(3) /= L;
  kinematics::divide_rows(out.A, &out.B);
  for (int i = 0; i < out.B.cols(); ++i)
    if (kinematics::joint_kind(machine, i) == machine::JointKind::revolute) out.B.col(i) /= L;
  return out;
}

/// The twist [v; w] in M of one that the equations are about: of serial arms the speeds along `motions`, else [v; L w].
Vec6 twist_of(const Sides& sides, const Eigen::VectorXd& scaled) {
  Vec6 out;
  if (sides.motions.size() > 0) {
    out = sides.motions.transpose() * scaled;
    out.head<3>() *= sides.length;
  } else {
    out = scaled;
    out.tail<3>() /= sides.length;
  }
  return out;
}

/// The determinant whose zeros are the singular poses, or nothing.
std::optional<double> determinant_of(const AnyMachine& machine, const Pose& X, const JointVector& q, double length) {
  const Sides s = sides_of(machine, X, q, length);
  const Eigen::MatrixXd& M = kinematics::is_serial(machine) ? s.B : s.A;
  if (M.rows() != M.cols()) return {};
  return M.determinant();
}

double regularity(const Singularity& s) {
  return std::min(s.mobility, s.control);
}

Pose between(const Pose& from, const Pose& to, double share) {
  const Vec3 turn = rotation_vector(to.R * from.R.transpose());
  return {rotation_of(share * turn) * from.R, from.p + share * (to.p - from.p)};
}

/// The joints of X nearest to `last`, of those that keep the limits.
std::optional<JointVector> follow(const AnyMachine& machine, const Pose& X, const JointVector* last,
                                  std::string& reason) {
  const kinematics::InverseResult result = kinematics::inverse(machine, X);
  const kinematics::Solution* best = nullptr;
  double nearest_by = 0;
  for (const kinematics::Solution& s : result.solutions) {
    if (s.violations != 0) continue;
    const double away = last != nullptr ? (s.joints - *last).norm() : 0;
    if (best == nullptr || away < nearest_by) {
      best = &s;
      nearest_by = away;
    }
  }
  if (best != nullptr) return best->joints;
  reason = kinematics::reason_of(machine, result);
  return {};
}

/// Without the sign of a zero that is left after rounding to `digits`.
double plain(double x, double digits) {
  return std::abs(x) < 0.5 * std::pow(10, -digits) ? 0.0 : x;
}

std::string direction_in_words(const Pose& X, const Vec3& d) {
  constexpr double kParallel = 0.9995;  // 1.8 deg
  if (std::abs(d.dot(X.R.col(2))) > kParallel) return "its own axis";
  for (int k = 0; k < 3; ++k)
    if (std::abs(d[k]) > kParallel) return std::string(1, "xyz"[k]);
  return fmt::format("{:.2f}, {:.2f}, {:.2f}", plain(d.x(), 2), plain(d.y(), 2), plain(d.z(), 2));
}

}  // namespace

bool task_prescribes(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, const Singularity& s) {
  constexpr double kLost = 1e12;
  return s.kind != 0 || kinematics::dexterity(machine, X_MT, q, s.length).condition < kLost;
}

Singularity singularity(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, double length,
                        double threshold) {
  const Sides sides = sides_of(machine, X_MT, q, length);
  Singularity out;
  out.length = sides.length;
  out.constraints = sides.constraints;
  const Pose X = kinematics::settled(machine, X_MT, q);

  const Eigen::JacobiSVD<Eigen::MatrixXd> A(sides.A, Eigen::ComputeFullV);
  out.control = A.singularValues().tail<1>()[0];
  out.free_motion = twist_of(sides, A.matrixV().rightCols<1>());
  if (sides.allowed.size() > 0) {  // exact constraints are not weighed against the legs
    const Eigen::JacobiSVD<Eigen::MatrixXd> of_legs(sides.A * sides.allowed, Eigen::ComputeFullV);
    const double least = of_legs.singularValues().tail<1>()[0];
    if (least <= *sides.constraints)
      out.free_motion = twist_of(sides, sides.allowed * of_legs.matrixV().rightCols<1>());
    out.control = std::min(least, *sides.constraints);
  }

  const Eigen::JacobiSVD<Eigen::MatrixXd> B(sides.B, Eigen::ComputeFullU | Eigen::ComputeFullV);
  // Fewer drives than equations of a serial task: the tool has lost motions everywhere.
  const bool few = kinematics::is_serial(machine) && sides.B.rows() > sides.B.cols();
  out.mobility = few ? 0 : B.singularValues().tail<1>()[0];
  // The equations y^T A dX = -y^T B dq with y^T B = 0 hold the tool along A^T y.
  const Eigen::Index weakest = few ? sides.B.rows() - 1 : B.singularValues().size() - 1;
  Eigen::VectorXd held = sides.A.transpose() * B.matrixU().col(weakest);
  // Of that, what the equations without drives allow: they hold the tool whatever the drives do.
  if (!few && sides.B.rows() > sides.B.cols()) {
    const Eigen::MatrixXd passive = B.matrixU().rightCols(sides.B.rows() - sides.B.cols()).transpose() * sides.A;
    held -= passive.completeOrthogonalDecomposition().solve(passive * held);
  }
  if (held.norm() > 0) held.normalize();
  out.lost_motion = twist_of(sides, held);
  const Eigen::VectorXd idle = B.matrixV().rightCols<1>();
  out.idle_joints = idle / idle.cwiseAbs().maxCoeff();

  if (sides.seen.size() > 0 && out.control > kRankLost) {
    const Eigen::JacobiSVD<Eigen::MatrixXd> speed(sides.seen, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const double least = speed.singularValues().tail<1>()[0];
    if (least < out.mobility) {
      out.mobility = least;
      const Eigen::VectorXd lost = speed.matrixU().rightCols<1>();  // v in M, w in the tool's frame
      out.lost_motion << sides.length * lost.head<3>(), X.R * Vec3(lost[3], lost[4], 0);
      const Eigen::VectorXd still = speed.matrixV().rightCols<1>();
      out.idle_joints = still / still.cwiseAbs().maxCoeff();
    }
  }
  out.kind = (out.mobility < threshold ? 1 : 0) + (out.control < threshold ? 2 : 0);
  return out;
}

std::string motion_in_words(const Pose& X, const Vec6& twist, double length) {
  const Vec3 v = twist.head<3>(), w = twist.tail<3>();
  constexpr double kLittle = 0.03;
  if (w.norm() * length <= kLittle * v.norm()) return "moves along " + direction_in_words(X, v.normalized());
  const double pitch = v.dot(w) / w.squaredNorm();  // m per rad
  const Vec3 point = w.cross(v) / w.squaredNorm();  // of the axis, from the tip
  const Vec3 axis = w.normalized();
  std::string out = "rotates about ";
  const std::string direction = direction_in_words(X, axis);
  if (point.norm() <= kLittle * length) {
    out += direction == "its own axis" ? direction : "the axis through its tip along " + direction;
  } else {
    const Vec3 at = units::kMmPerMetre * (X.p + point);
    const int digits = Figures(std::max(at.norm(), units::to_mm(length)), 1).decimals();
    out += fmt::format("the axis through {:.{}f}, {:.{}f}, {:.{}f} mm along {}", plain(at.x(), digits), digits,
                       plain(at.y(), digits), digits, plain(at.z(), digits), digits, direction);
  }
  if (std::abs(pitch) > kLittle * length) {
    out += fmt::format(" and moves along it by {} mm per rad", figure(units::to_mm(pitch), 1));
  }
  return out;
}

std::string in_words(const Pose& X, const Singularity& s) {
  std::string out;
  if (s.kind == 0) {
    const bool by_mobility = s.mobility <= s.control;
    return fmt::format("regular: smallest singular values {:.3g} (B) and {:.3g} (A); in the {} the tool {}", s.mobility,
                       s.control, by_mobility ? "motion that is nearest to lost" : "least constrained motion",
                       motion_in_words(X, by_mobility ? s.lost_motion : s.free_motion, s.length));
  }
  if (s.kind & 1)
    out +=
        "loses a motion (type 1, serial singularity): drives can move while the tool is at rest, and no motion of the "
        "drives has the effect that it " +
        motion_in_words(X, s.lost_motion, s.length);
  if (s.kind == 3) out += "; and ";
  if (s.kind & 2)
    out += "cannot be constrained (type 2, parallel singularity): with all drives locked the tool " +
           motion_in_words(X, s.free_motion, s.length);
  if ((s.kind & 2) != 0 && s.constraints && *s.constraints < kSingularThreshold) {
    out += "; its passive constraints allow this motion, whatever the drives do";
  }
  return out;
}

PathSingularity along_path(const AnyMachine& machine, const Pose& from, const Pose& to, int samples) {
  PathSingularity out;
  samples = std::max(samples, 1);
  std::optional<JointVector> last;
  std::optional<double> sign;
  std::vector<JointVector> joints;
  double least = 1e300;
  int least_at = 0;
  for (int k = 0; k <= samples; ++k) {
    const Pose X = between(from, to, static_cast<double>(k) / samples);
    std::string reason;
    const auto q = follow(machine, X, last ? &*last : nullptr, reason);
    if (!q) {
      out.reached = static_cast<double>(std::max(0, k - 1)) / samples;
      out.stopped_by = reason;
      break;
    }
    last = q;
    joints.push_back(*q);
    const double here = regularity(singularity(machine, X, *q));
    if (here < least) {
      least = here;
      least_at = k;
    }
    const auto d = determinant_of(machine, X, *q, 0);
    if (d && sign && *d * *sign < 0) out.crossed = true;
    if (d) sign = d;
  }
  if (joints.empty()) {
    out.reached = 0;
    out.X_MT = from;
    return out;
  }
  // Golden section between the neighbours of the least sample.
  const double low = std::max(0, least_at - 1),
               high = std::min<double>(least_at + 1, static_cast<double>(joints.size()) - 1);
  const auto value = [&](double k) {
    const Pose X = between(from, to, k / samples);
    std::string reason;
    const auto q = follow(machine, X, &joints[static_cast<std::size_t>(least_at)], reason);
    return q ? regularity(singularity(machine, X, *q)) : 1e300;
  };
  double k = golden_section(value, low, high, 1e-6 * samples);
  if (value(k) > least) k = least_at;
  out.share = k / samples;
  out.X_MT = between(from, to, out.share);
  std::string reason;
  if (const auto q = follow(machine, out.X_MT, &joints[static_cast<std::size_t>(least_at)], reason))
    out.at = singularity(machine, out.X_MT, *q);
  return out;
}

namespace {

constexpr std::size_t kJudged = 33;  // home and 32 more

struct JudgedPose {
  Pose X_MT;
  JointVector q;
  bool within_limits = true;
};

/// Joints of a chain drawn from their ranges; turning joints without an end over one turn.
template <class Chain>
std::vector<JudgedPose> poses_of_chain(const Chain& arm) {
  Random random(1);
  std::vector<JudgedPose> out;
  while (out.size() < kJudged) {
    JointVector q(joint_count(arm));
    for (int i = 0; i < q.size(); ++i) {
      const machine::JointRange range = joint_range(arm, i);
      q[i] = random.uniform(std::max(range.min, -std::numbers::pi), std::min(range.max, std::numbers::pi));
    }
    out.push_back({forward(arm, q), q, true});
  }
  return out;
}

/// Home, then poses round it at distances from half of home's height down to a thousandth of it, so that machines of
/// long and of short travel both give some within their limits.
std::vector<JudgedPose> poses_round_home(const AnyMachine& machine, const Pose& home) {
  constexpr int kTrials = 800, kScales = 10;
  Random random(1);
  std::vector<JudgedPose> within, beyond;
  const bool turns = kinematics::task(machine).turns();
  const double reach = home.p.norm() > 0 ? home.p.norm() : 1;
  for (int trial = 0; trial < kTrials && within.size() < kJudged; ++trial) {
    const double scale = trial == 0 ? 0 : std::ldexp(1.0, -1 - trial % kScales);
    const auto any = [&]() -> Vec3 {
      Vec3 out;
      for (double& x : out) x = scale * random.uniform(-1, 1);
      return out;
    };
    const Vec3 moved = reach * any(), turned = turns ? any() : Vec3(Vec3::Zero());
    const Pose X{rotation_of(turned) * home.R, home.p + moved};
    const kinematics::InverseResult result = kinematics::inverse(machine, X);
    if (result.solutions.empty()) continue;
    const kinematics::Solution* reached = result.reachable();
    const bool keeps = reached != nullptr;
    (keeps || trial == 0 ? within : beyond).push_back({X, keeps ? reached->joints : result.solutions[0].joints, keeps});
  }
  for (std::size_t i = 0; i < beyond.size() && within.size() < kJudged; ++i) within.push_back(beyond[i]);
  return within;
}

std::vector<JudgedPose> judged_poses(const AnyMachine& machine) {
  return std::visit(
      [&](const auto& m) {
        if constexpr (requires { home_pose(m); })
          return poses_round_home(machine, home_pose(m));
        else
          return poses_of_chain(m);
      },
      machine);
}

}  // namespace

PoseIndependentSingularity pose_independent_singularity(const AnyMachine& machine) {
  const bool few = kinematics::is_serial(machine) &&
                   kinematics::joint_count(machine) < kinematics::coordinate_count(kinematics::task(machine));
  PoseIndependentSingularity out;
  for (const JudgedPose& at : judged_poses(machine)) {
    const Singularity s = singularity(machine, at.X_MT, at.q);
    ++out.poses;
    out.within_limits += at.within_limits ? 1 : 0;
    out.type1 += !few && s.mobility < kRankLost ? 1 : 0;
    out.type2 += s.control < kRankLost ? 1 : 0;
    out.largest_mobility = std::max(out.largest_mobility, few ? 1.0 : s.mobility);
    out.largest_control = std::max(out.largest_control, s.control);
  }
  return out;
}

std::string in_words(const PoseIndependentSingularity& s) {
  if (!s.everywhere() && !s.nearly()) return "";
  const bool held_least = s.largest_control <= s.largest_mobility;
  const std::string judged =
      fmt::format("at {0} of {0} poses that were judged, {1} of them within the limits", s.poses, s.within_limits);
  if (!s.everywhere()) {
    return fmt::format(
        "close to singular {}: the smallest singular value of {} is at most {:.2g} (regular poses of good machines "
        "have "
        "0.1 and more). Small errors of the parts are large errors of the tool, which first order does not describe",
        judged, held_least ? "A" : "B", std::min(s.largest_control, s.largest_mobility));
  }
  if (s.never_held()) {
    return fmt::format(
        "singular {}: type 2, architecturally singular. The drives cannot constrain the platform anywhere: it moves "
        "with all of them locked. Base and platform need another geometry, for instance other angles between their "
        "joints",
        judged);
  }
  return fmt::format("singular {}: type 1. At every pose the tool lacks a motion that its task asks for", judged);
}

std::optional<NearSingularity> nearest(const AnyMachine& machine, const Pose& X_MT, const JointVector& q_start,
                                       double length) {
  const double L = kinematics::dexterity(machine, X_MT, q_start, length).characteristic_length;
  const bool chain = kinematics::is_serial(machine);
  const auto at_joints = [&](const JointVector& joints) { return kinematics::forward(machine, joints).poses.front(); };
  Pose X = chain ? at_joints(q_start) : X_MT;
  const Pose start = X;
  JointVector q = q_start;
  const auto value = [&](const Pose& at, const JointVector& joints) { return determinant_of(machine, at, joints, L); };
  const auto first = value(X, q);
  if (!first) return {};
  constexpr double kStep = 1e-6, kDone = 1e-9;
  for (int k = 0; k < 50; ++k) {
    const auto here = value(X, q);
    if (!here) return {};
    if (std::abs(*here) < kDone * std::max(1.0, std::abs(*first))) {
      return NearSingularity{X, (X.p - start.p).norm(), rotation_vector(X.R * start.R.transpose()).norm()};
    }
    if (chain) {
      Eigen::VectorXd gradient(q.size());
      for (int i = 0; i < q.size(); ++i) {
        JointVector plus = q, minus = q;
        plus[i] += kStep;
        minus[i] -= kStep;
        gradient[i] = (*value(X, plus) - *value(X, minus)) / (2 * kStep);
      }
      if (!(gradient.norm() > 1e-12)) return {};
      Eigen::VectorXd step = -*here / gradient.squaredNorm() * gradient;
      if (step.norm() > 0.2) step *= 0.2 / step.norm();
      q += step;
      X = at_joints(q);
      continue;
    }
    Vec6 gradient;
    for (int i = 0; i < 6; ++i) {
      const auto moved = [&](double h) -> std::optional<double> {
        Pose Y = X;
        if (i < 3)
          Y.p[i] += h * L;
        else
          Y.R = rotation_of(h * Vec3::Unit(i - 3)) * X.R;
        const auto joints = joints_at(machine, Y);
        return joints ? value(Y, *joints) : std::nullopt;
      };
      const auto plus = moved(kStep), minus = moved(-kStep);
      if (!plus || !minus) return {};
      gradient[i] = (*plus - *minus) / (2 * kStep);
    }
    if (!(gradient.norm() > 1e-12)) return {};
    Vec6 step = -*here / gradient.squaredNorm() * gradient;
    if (step.norm() > 0.2) step *= 0.2 / step.norm();
    X.p += L * step.head<3>();
    X.R = rotation_of(step.tail<3>()) * X.R;
    const auto joints = joints_at(machine, X);
    if (!joints) return {};
    q = *joints;
  }
  return {};
}

}  // namespace polypod::quality
