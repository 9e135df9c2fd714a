// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/stages/kinematics.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <limits>
#include <numbers>

#include "../parallel/settle.hpp"
#include "../turns.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/joint_speed.hpp"
#include "wrist_on_module.hpp"

namespace polypod::machine {
namespace {

using kinematics::InverseResult;
using kinematics::Solution;

constexpr double kCloses = 1e-9;  // m: a pose fits the joints

/// The stage and its own number of a joint of the whole.
struct Share {
  std::size_t stage = 0;
  int own = 0;
};
Share share_of(const Stages& m, int joint) {
  std::size_t k = 0;
  while (k + 1 < m.machines.size() && joint >= m.data[k].joints) joint -= m.data[k++].joints;
  return {k, joint};
}

bool is_chain(const Stages& m, std::size_t k) {
  return std::holds_alternative<SerialArm>(m.machines[k]);
}

double residual_of(const AnyMachine& machine, const Pose& X, const JointVector& q) {
  return std::visit([&](const auto& m) { return kinematics::closure_residual(m, X, q); }, machine);
}

/// The tool tip of stages that stand one behind the other.
Pose tip_of(const Stages& m, const std::vector<StagePose>& stages) {
  Pose X;
  for (std::size_t k = 0; k < stages.size(); ++k) X = X * m.data[k].mount * stages[k].X;
  return X;
}

/// Whether the tool tip is where the task prescribes it.
bool is_at(const Stages& m, const Pose& target, const std::vector<StagePose>& stages) {
  constexpr double kThere = 1e-7;  // m, and rad at 1 m
  return pose_error(m.task, target, tip_of(m, stages)).norm() < kThere;
}

void place(const Stages& m, std::vector<StagePose>& stages) {
  Pose X;
  for (std::size_t k = 0; k < stages.size(); ++k) {
    stages[k].X_MB = X * m.data[k].mount;
    X = stages[k].X_MB * stages[k].X;
  }
}

/// The stages on their way, with the Jacobian of each by itself.
struct Moving {
  std::vector<StagePose> stages;
  std::vector<JacobianMatrix> J;
};

JacobianMatrix columns_of(const Stages& m, const Moving& at, const Vec3& p_M) {
  JacobianMatrix J(6, joint_count(m));
  Eigen::Index column = 0;
  for (std::size_t k = 0; k < at.stages.size(); ++k) {
    for (Eigen::Index i = 0; i < at.J[k].cols(); ++i) J.col(column++) = carried(at.stages[k], at.J[k].col(i), p_M);
  }
  return J;
}

/// The least singular value of a Jacobian as a share of the largest, angles on 1 m.
double spread_of(const JacobianMatrix& J) {
  using Squares = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxJoints, kMaxJoints>;
  const Squares squares = J.transpose() * J;
  const auto lambda = Eigen::SelfAdjointEigenSolver<Squares>(squares, Eigen::EigenvaluesOnly).eigenvalues();
  const double most = lambda[lambda.size() - 1];
  return most > 0 ? std::sqrt(std::max(0.0, lambda[0]) / most) : 0.0;
}

/// The joints of a pose that the stage is settled at, in its own posture, where its family tells them without a search.
std::optional<JointVector> own_joints(const AnyMachine& machine, const Pose& X) {
  return std::visit(
      [&](const auto& stage) -> std::optional<JointVector> {
        if constexpr (requires { joints_of(stage, X); }) return joints_of(stage, X);
        return std::nullopt;
      },
      machine);
}

/// Joints of the stage at a pose at which its drives move it well, with the Jacobian there: of the solutions of its
/// inverse the first whose Jacobian is far from singular, else the best. The search goes from pose to pose, and which
/// solution carries it does not matter.
bool take_joints_that_move(const AnyMachine& machine, const Pose& X, JointVector& q, JacobianMatrix& J) {
  constexpr double kWell = 0.02;
  constexpr std::size_t kMost = 8;
  if (const auto own = own_joints(machine, X)) {
    J = kinematics::jacobian(machine, X, *own);
    q = *own;
    if (J.allFinite() && spread_of(J) > kWell) return true;
  }
  const InverseResult found = kinematics::inverse(machine, X);
  const std::size_t count = std::min(found.solutions.size(), kMost);
  double best = -1;
  for (std::size_t i = 0; i < count && best < kWell; ++i) {
    JacobianMatrix here = kinematics::jacobian(machine, X, found.solutions[i].joints);
    if (!here.allFinite()) continue;
    const double share = count > 1 ? spread_of(here) : 0.0;
    if (share <= best) continue;
    best = share;
    q = found.solutions[i].joints;
    J = std::move(here);
  }
  return best >= 0;
}

/// What the stages become by a step of all joints; empty where the closed stage does not reach.
std::optional<Moving> moved(const Stages& m, const Moving& from, const JointVector& step) {
  Moving out = from;
  Eigen::Index at = 0;
  for (std::size_t k = 0; k < out.stages.size(); ++k) {
    StagePose& stage = out.stages[k];
    const JointVector own = step.segment(at, m.data[k].joints);
    at += m.data[k].joints;
    if (is_chain(m, k)) {
      stage.q += own;
      stage.X = forward(std::get<SerialArm>(m.machines[k]), stage.q);
      out.J[k] = kinematics::jacobian(m.machines[k], stage.X, stage.q);
      continue;
    }
    const Vec6 twist = from.J[k] * own;
    Pose X = stage.X;
    X.p += twist.head<3>();
    X.R = rotation_of(twist.tail<3>()) * X.R;
    const std::optional<Pose> follows = std::visit(
        [&](const auto& machine) -> std::optional<Pose> {
          if constexpr (requires { settled_near(machine, X, stage.X); }) return settled_near(machine, X, X);
          return kinematics::settled(m.machines[k], X, stage.q + own);
        },
        m.machines[k]);
    if (!follows || !take_joints_that_move(m.machines[k], *follows, stage.q, out.J[k])) return std::nullopt;
    stage.X = *follows;
  }
  place(m, out.stages);
  return out;
}

/// A turning joint in the turn that lies in its range, where that turn moves nothing else.
void into_range(const AnyMachine& machine, JointVector& q) {
  constexpr double kTurn = 2 * std::numbers::pi;
  for (int i = 0; i < static_cast<int>(q.size()); ++i) {
    if (kinematics::joint_kind(machine, i) != JointKind::revolute) continue;
    if (const auto* arm = std::get_if<SerialArm>(&machine); arm != nullptr && !turns_alone(*arm, i)) continue;
    const JointRange range = kinematics::joint_range(machine, i);
    const double middle = 0.5 * (range.min + range.max);
    q[i] -= kTurn * std::round((q[i] - middle) / kTurn);
  }
}

struct Search {
  std::vector<StagePose> stages;
  double error = std::numeric_limits<double>::infinity();
  bool converged = false;
};

Moving with_jacobians(const Stages& m, std::vector<StagePose> stages) {
  Moving out{std::move(stages), {}};
  place(m, out.stages);
  for (std::size_t k = 0; k < out.stages.size(); ++k) {
    out.J.push_back(kinematics::jacobian(m.machines[k], out.stages[k].X, out.stages[k].q));
  }
  return out;
}

/// Levenberg and Marquardt's method from the given stages.
Search search(const Stages& m, const Pose& target, const std::vector<StagePose>& from) {
  constexpr int kSteps = 60;
  constexpr double kDone = 1e-12, kEnough = 1e-10, kMostDamping = 1e6;
  Moving at = with_jacobians(m, from);
  const auto S = task_rows(m.task, target, 1.0);
  const auto error = [&](const Moving& moving) {
    return (S * pose_error(m.task, target, tip_of(m, moving.stages))).eval();
  };
  constexpr int kMostSlow = 4;      // steps one after the other that leave ...
  constexpr double kSlowly = 0.98;  // ... more than this of the error: the target is out of reach, or the way to it is
  Search out;
  double damping = 1e-3;
  int slow = 0;
  auto e = error(at);
  for (int k = 0; k < kSteps && e.norm() > kDone; ++k) {
    const JacobianMatrix all = columns_of(m, at, tip_of(m, at.stages).p);
    const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, kMaxJoints> J = S * all;
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6> H = J * J.transpose();
    H.diagonal().array() += damping * damping;
    const JointVector step = J.transpose() * H.ldlt().solve(e);
    auto next = step.allFinite() ? moved(m, at, step) : std::nullopt;
    if (next) {
      const auto e_next = error(*next);
      if (e_next.norm() < e.norm()) {
        slow = e_next.norm() > kSlowly * e.norm() ? slow + 1 : 0;
        if (slow > kMostSlow && e.norm() > kEnough) break;
        at = std::move(*next);
        e = e_next;
        damping = std::max(1e-9, 0.1 * damping);
        continue;
      }
      if (e.norm() < kEnough) break;  // rounding
    }
    damping *= 4;
    if (damping > kMostDamping) break;
  }
  out.error = e.norm();
  out.converged = out.error < kEnough;
  out.stages = std::move(at.stages);
  return out;
}

std::vector<StagePose> at_home(const Stages& m) {
  std::vector<StagePose> out(m.machines.size());
  for (std::size_t k = 0; k < out.size(); ++k) {
    if (is_chain(m, k)) {
      out[k].q = m.data[k].home;
      out[k].X = forward(std::get<SerialArm>(m.machines[k]), out[k].q);
    } else {
      out[k].X = kinematics::home_pose(m.machines[k]).value_or(Pose{});
      out[k].q = JointVector::Zero(m.data[k].joints);
      JacobianMatrix J;
      take_joints_that_move(m.machines[k], out[k].X, out[k].q, J);
    }
  }
  return out;
}

/// All solutions of the closed stage where it stands; where there is none but chains, the joints of the last one.
std::vector<Solution> of_closed_stage(const Stages& m, const StagePose& closed) {
  if (!is_chain(m, m.closed)) return kinematics::inverse(m.machines[m.closed], closed.X).solutions;
  std::vector<Solution> out(1);
  out.front().joints = closed.q;
  return out;
}

/// Adds what a search found, with these solutions of the closed stage.
void add(const Stages& m, const Search& found, const std::vector<Solution>& of_closed, InverseResult& out) {
  constexpr double kSame = 1e-6;
  const Pose X = tip_of(m, found.stages);
  for (const Solution& one : of_closed) {
    Solution s;
    s.joints.resize(joint_count(m));
    Eigen::Index at = 0;
    for (std::size_t k = 0; k < found.stages.size(); ++k) {
      JointVector q = k == m.closed ? one.joints : found.stages[k].q;
      into_range(m.machines[k], q);
      s.joints.segment(at, m.data[k].joints) = q;
      at += m.data[k].joints;
    }
    // Half a turn forward and half a turn back are one posture.
    const bool known = std::any_of(out.solutions.begin(), out.solutions.end(), [&](const Solution& other) {
      for (int i = 0; i < s.joints.size(); ++i) {
        const double off = other.joints[i] - s.joints[i];
        const bool turns = joint_kind(m, i) == JointKind::revolute;
        if (std::abs(turns ? std::remainder(off, 2 * std::numbers::pi) : off) >= kSame) return false;
      }
      return true;
    });
    if (known) continue;
    s.branch = one.branch & (kinematics::kNumericBranch - 1);
    s.singular = one.singular;
    s.violations = kinematics::violations_of_limits(m, X, s.joints);
    out.solutions.push_back(std::move(s));
  }
}

/// Above this bit the posture's number, below the branch of the closed stage.
constexpr unsigned kPostureBit = 16;
static_assert(kinematics::kNumericBranch == 1U << kPostureBit);

void number_postures(InverseResult& result) {
  unsigned k = 0;
  for (Solution& s : result.solutions) s.branch |= k++ << kPostureBit;
}

}  // namespace

JointKind joint_kind(const Stages& m, int joint) {
  const Share share = share_of(m, joint);
  return kinematics::joint_kind(m.machines[share.stage], share.own);
}
JointRange joint_range(const Stages& m, int joint) {
  const Share share = share_of(m, joint);
  return kinematics::joint_range(m.machines[share.stage], share.own);
}

double joint_speed_limit(const Stages& m, int joint) {
  const Share share = share_of(m, joint);
  return kinematics::speed_limit(m.machines[share.stage], share.own);
}

LimitTable limit_table(const Stages& m) {
  LimitTable out;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    for (LimitInfo& limit : kinematics::limit_table(m.machines[k])) {
      limit.group = fmt::format("{}", k + 1);
      out.push_back(std::move(limit));
    }
  }
  push_tip_limits(out, m);
  return out;
}

std::string limit_name(const Stages& m, int limit) {
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    const auto count = static_cast<int>(kinematics::limit_table(m.machines[k]).size());
    if (limit < count) return fmt::format("stage {}: {}", k + 1, kinematics::limit_name(m.machines[k], limit));
    limit -= count;
  }
  return hexapod_limit_name(HexapodLimits::kLow + limit);
}

Pose home_pose(const Stages& m) {
  return tip_of(m, at_home(m));
}

kinematics::NewtonResult forward_from_home(const Stages& m, const JointVector& q) {
  kinematics::NewtonResult out;
  out.converged = true;
  Eigen::Index at = 0;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    const JointVector own = q.segment(at, m.data[k].joints);
    at += m.data[k].joints;
    const kinematics::ForwardResult pose = kinematics::forward(m.machines[k], own);
    if (pose.poses.empty()) {
      out.converged = false;
      out.residual = std::numeric_limits<double>::infinity();
      return out;
    }
    out.residual = std::max(out.residual, pose.residuals.front());
    out.X_MT = out.X_MT * m.data[k].mount * pose.poses.front();
  }
  return out;
}

Pose forward(const Stages& m, const JointVector& q) {
  return forward_from_home(m, q).X_MT;
}

std::vector<StagePose> stage_poses(const Stages& m, const Pose& X_MT, const JointVector& q) {
  std::vector<StagePose> out(m.machines.size());
  Pose before, behind;
  Eigen::Index at = 0;
  for (std::size_t k = 0; k < out.size(); ++k) {
    out[k].q = q.segment(at, m.data[k].joints);
    at += m.data[k].joints;
    if (k == m.closed) {
      before = before * m.data[k].mount;
      continue;
    }
    out[k].X = kinematics::forward(m.machines[k], out[k].q).poses.front();
    Pose& side = k < m.closed ? before : behind;
    side = side * m.data[k].mount * out[k].X;
  }
  const AnyMachine& closed = m.machines[m.closed];
  StagePose& stage = out[m.closed];
  stage.X = before.inverse() * X_MT * behind.inverse();
  if (residual_of(closed, stage.X, stage.q) > kCloses) {
    const Pose follows = kinematics::settled(closed, stage.X, stage.q);
    if (residual_of(closed, follows, stage.q) < kCloses) {
      stage.X = follows;
    } else if (const auto found = kinematics::forward(closed, stage.q); !found.poses.empty()) {
      stage.X = found.poses.front();
    }
  }
  place(m, out);
  if (is_at(m, X_MT, out)) return out;
  // The closed stage closes in another mode, or with another turn of what the task leaves free: Newton's method from
  // poses that the task prescribes, the nearest first.
  std::vector<std::pair<double, Pose>> starts;
  constexpr int kTurns = 24;
  constexpr std::size_t kMostStarts = 3;
  for (int turn = 0; turn < (m.task.names_axis() ? kTurns : 1); ++turn) {
    const Pose target{X_MT.R * rotation_of(units::from_deg(360.0 * turn / kTurns) * Vec3::UnitZ()), X_MT.p};
    const Pose start = before.inverse() * target * behind.inverse();
    starts.emplace_back(residual_of(closed, start, stage.q), start);
  }
  std::sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  const Pose as_before = stage.X;
  for (std::size_t i = 0; i < std::min(kMostStarts, starts.size()); ++i) {
    const kinematics::NewtonResult found = std::visit(
        [&](const auto& machine) {
          const std::span<const double> joints(stage.q.data(), static_cast<std::size_t>(stage.q.size()));
          return kinematics::forward_by_closure(machine, joints, starts[i].second);
        },
        closed);
    if (!found.converged) continue;
    // A closure that keeps an orientation may hold at half a turn, too, where the stage cannot be.
    const Pose follows = kinematics::settled(closed, found.X_MT, stage.q);
    stage.X = residual_of(closed, follows, stage.q) < kCloses ? follows : found.X_MT;
    place(m, out);
    if (is_at(m, X_MT, out)) return out;
  }
  stage.X = as_before;
  place(m, out);
  return out;
}

Pose settled(const Stages& m, const Pose& X_MT, const JointVector& q) {
  return tip_of(m, stage_poses(m, X_MT, q));
}

Vec6 carried(const StagePose& stage, const Vec6& twist, const Vec3& p_M) {
  const Mat3& R = stage.X_MB.R;
  const Vec3 w = R * twist.tail<3>(), arm = p_M - stage.X_MB * stage.X.p;
  Vec6 out;
  out << R * twist.head<3>() + w.cross(arm), w;
  return out;
}

JacobianMatrix jacobian(const Stages& m, const Pose& X_MT, const JointVector& q) {
  const Moving at = with_jacobians(m, stage_poses(m, X_MT, q));
  return columns_of(m, at, tip_of(m, at.stages).p);
}

namespace {

/// What keeps a search from a target that it nearly meets.
const char* why_so_near(double error) {
  constexpr double kNear = 1e-6;  // m
  return error < kNear ? ", a singular pose or one at the rim of what the machine reaches" : "";
}

/// By the distance of the joints from those of `stages`, and numbered so.
void order(InverseResult& found, const std::vector<StagePose>& stages) {
  JointVector at_start(0);
  for (const StagePose& stage : stages) {
    at_start.conservativeResize(at_start.size() + stage.q.size());
    at_start.tail(stage.q.size()) = stage.q;
  }
  std::stable_sort(found.solutions.begin(), found.solutions.end(), [&](const Solution& a, const Solution& b) {
    return (a.joints - at_start).norm() < (b.joints - at_start).norm();
  });
  number_postures(found);
}

/// The postures of a wrist on a module, with all solutions of the module, by their distance from those of `stages`.
InverseResult in_closed_form(const Stages& m, const WristOnModule& form, const Pose& X_MT,
                             const std::vector<StagePose>& stages) {
  InverseResult out;
  WristOnModule::Found found = form.solve(m, X_MT, stages[1].q[0]);
  std::vector<Solution> of_module;
  for (WristOnModule::Posture& posture : found.postures) {
    if (of_module.empty()) of_module = of_closed_stage(m, posture.stages[0]);
    const std::size_t known = out.solutions.size();
    add(m, {std::move(posture.stages), 0, true}, of_module, out);
    for (std::size_t i = known; i < out.solutions.size(); ++i)
      out.solutions[i].singular = out.solutions[i].singular || posture.singular;
  }
  order(out, stages);
  out.converged = !out.solutions.empty();
  out.reason = found.postures.empty() || out.converged ? std::move(found.reason)
                                                       : "the module that carries the wrist has no joints there";
  return out;
}

/// All that the searches find, or up to the first solution that keeps the limits `enough`.
InverseResult searched(const Stages& m, const Pose& X_MT, std::optional<LimitBits> enough) {
  static constexpr std::array<int, kMaxJoints> kPrimes{2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37};
  // Chains of slides alone have one posture.
  bool turns = false;
  for (int i = 0; i < joint_count(m); ++i) {
    turns = turns || (share_of(m, i).stage != m.closed && joint_kind(m, i) == JointKind::revolute) ||
            (is_chain(m, m.closed) && joint_kind(m, i) == JointKind::revolute);
  }
  const int starts = turns ? 24 : 2;
  InverseResult out;
  const std::vector<StagePose> home = at_home(m);
  double best = std::numeric_limits<double>::infinity();
  const int most_in_vain = enough ? 4 : 8;  // starts one after the other that find nothing new
  int in_vain = 0;
  for (int start = 0; start < starts && in_vain < most_in_vain; ++start) {
    std::vector<StagePose> stages = home;
    std::size_t joint = 0;
    for (std::size_t k = 0; start > 0 && k < stages.size(); ++k) {
      if (!is_chain(m, k)) continue;
      for (int i = 0; i < m.data[k].joints; ++i) {
        const JointRange range = kinematics::joint_range(m.machines[k], i);
        stages[k].q[i] =
            range.min + kinematics::closure_detail::halton(start, kPrimes[joint++]) * (range.max - range.min);
      }
      stages[k].X = forward(std::get<SerialArm>(m.machines[k]), stages[k].q);
    }
    const Search found = search(m, X_MT, stages);
    best = std::min(best, found.error);
    const std::size_t known = out.solutions.size();
    if (found.converged) add(m, found, of_closed_stage(m, found.stages[m.closed]), out);
    in_vain = out.solutions.size() > known ? 0 : in_vain + 1;
    const auto keeps = [&](const Solution& s) { return (s.violations & *enough) == 0; };
    if (enough && std::any_of(out.solutions.begin() + std::ptrdiff_t(known), out.solutions.end(), keeps)) break;
  }
  order(out, home);
  out.converged = !out.solutions.empty();
  if (!out.converged) {
    out.reason = fmt::format(
        "the numeric search did not converge from {} starts; the closest came within {:.3g} mm (angles at 1 m) of "
        "the target{}",
        std::min(starts, most_in_vain), units::to_mm(best), why_so_near(best));
  }
  return out;
}

}  // namespace

InverseResult inverse(const Stages& m, const Pose& X_MT) {
  if (const auto form = WristOnModule::of(m)) return in_closed_form(m, *form, X_MT, at_home(m));
  return searched(m, X_MT, {});
}

bool reaches(const Stages& m, const Pose& X_MT, LimitBits heeded) {
  if (const auto form = WristOnModule::of(m)) return in_closed_form(m, *form, X_MT, at_home(m)).keeps(heeded);
  return searched(m, X_MT, heeded).keeps(heeded);
}

std::string branch_name(const Stages& m, unsigned branch) {
  std::string out = fmt::format("posture {}", (branch >> kPostureBit) + 1);
  if (is_chain(m, m.closed) || kinematics::searches(m.machines[m.closed])) return out;
  const std::string closed = kinematics::branch_name(m.machines[m.closed], branch & ((1U << kPostureBit) - 1));
  return closed == "only" ? out : out + ", " + closed;
}

InverseResult inverse_from(const Stages& m, const Pose& X_MT, const JointVector& start) {
  InverseResult out;
  std::vector<StagePose> stages = at_home(m);
  Eigen::Index at = 0;
  for (std::size_t k = 0; k < stages.size(); ++k) {
    const JointVector own = start.segment(at, m.data[k].joints);
    at += m.data[k].joints;
    const kinematics::ForwardResult pose = kinematics::forward(m.machines[k], own);
    if (pose.poses.empty()) continue;
    stages[k].q = own;
    stages[k].X = pose.poses.front();
  }
  const Search found = search(m, X_MT, stages);
  out.converged = found.converged;
  if (!found.converged) {
    out.reason = fmt::format("the search from the last joints came within {:.3g} mm (angles at 1 m) of the target{}",
                             units::to_mm(found.error), why_so_near(found.error));
    return out;
  }
  add(m, found, of_closed_stage(m, found.stages[m.closed]), out);
  number_postures(out);
  return out;
}

}  // namespace polypod::machine
