// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/compliance.hpp"

#include <fmt/format.h>

#include <concepts>
#include <optional>

#include "polypod/kinematics/families.hpp"

namespace polypod::statics {

using machine::JacobianMatrix;
using machine::JointVector;
using machine::SerialArm;

namespace {

/// The columns whose compliances add up: those of every row of the table, since a brake gives way too.
struct Columns {
  Pose X_MT;
  JacobianMatrix J;
};

/// `X_MT` is the pose of the joints where it is known; a parallel machine has several poses of the same joints.
Columns columns_of(const SerialArm& arm, const JointVector& q, const Pose*) {
  machine::ForwardJacobian fj = machine::forward_jacobian(arm, q, true);
  return {fj.X_MT, std::move(fj.J)};
}
double column_compliance(const SerialArm& arm, int i) {
  return arm.dh[static_cast<std::size_t>(i)].compliance;
}
void set_column_compliance(SerialArm& arm, int i, double c) {
  arm.dh[static_cast<std::size_t>(i)].compliance = c;
}
std::string column_name(const SerialArm&, int i) {
  return fmt::format("joint {}", i + 1);
}
int column_count(const SerialArm& arm) {
  return static_cast<int>(arm.dh.size());
}

template <class M>
concept SixLegged = requires(const M& m) {
  m.leg_compliance;
};

/// Hexapods: the forward Jacobian's columns, each with the compliance of its strut or slider.
template <SixLegged M>
Columns columns_of(const M& m, const JointVector& q, const Pose* X_MT) {
  const Pose X = X_MT != nullptr ? *X_MT : machine::forward(m, q);
  return {X, machine::jacobian(m, X, q)};
}
template <SixLegged M>
double column_compliance(const M& m, int i) {
  return m.leg_compliance[static_cast<std::size_t>(i)];
}
template <SixLegged M>
void set_column_compliance(M& m, int i, double c) {
  m.leg_compliance[static_cast<std::size_t>(i)] = c;
  m.compliance = 0;
  for (const double each : m.leg_compliance) m.compliance += each / machine::kLegs;
}
template <SixLegged M>
std::string column_name(const M&, int i) {
  return fmt::format("leg {}", i + 1);
}
template <SixLegged M>
int column_count(const M&) {
  return machine::kLegs;
}

/// Deltas: a column of each drive, then one of each parallelogram. Chain i gives way by B_i dq_i + dc_i along its rods,
/// A dX is what all chains give way. With four chains the loads share out as their stiffnesses K: dX is then
/// (A^T K A)^-1 A^T K times what the chains would give way alone, and sum c_i J_i J_i^T = (A^T K A)^-1.
template <std::derived_from<machine::Delta> M>
Columns columns_of(const M& m, const JointVector& q, const Pose* X_MT) {
  const Pose X = X_MT != nullptr ? *X_MT : machine::forward(m, q);
  const machine::DeltaJacobians pair = machine::jacobians(m, X.p, q);
  Eigen::VectorXd gives(m.arms);
  for (int i = 0; i < m.arms; ++i) {
    gives[i] = pair.B[i] * pair.B[i] * m.drive_compliance[std::size_t(i)] + m.rod_compliance[std::size_t(i)];
  }
  // A chain that gives way by a millionth of the softest one stands for a rigid one.
  const double least = 1e-6 * gives.maxCoeff();
  Eigen::VectorXd K = Eigen::VectorXd::Ones(m.arms);
  if (least > 0) K = gives.cwiseMax(least).cwiseInverse();
  const Eigen::VectorXd root = K.cwiseSqrt();
  const Eigen::MatrixXd held =
      (root.asDiagonal() * pair.A).completeOrthogonalDecomposition().pseudoInverse() * root.asDiagonal();
  Columns out{X, JacobianMatrix::Zero(6, 2 * m.arms)};
  out.J.template topRightCorner(3, m.arms) = held;
  out.J.template topLeftCorner(3, m.arms) = held * pair.B.asDiagonal();
  return out;
}
double column_compliance(const machine::Delta& m, int i) {
  return i < m.arms ? m.drive_compliance[std::size_t(i)] : m.rod_compliance[std::size_t(i - m.arms)];
}
void set_column_compliance(machine::Delta& m, int i, double c) {
  (i < m.arms ? m.drive_compliance[std::size_t(i)] : m.rod_compliance[std::size_t(i - m.arms)]) = c;
}
std::string column_name(const machine::Delta& m, int i) {
  return i < m.arms ? fmt::format("drive {}", i + 1) : fmt::format("rod {}", i - m.arms + 1);
}
int column_count(const machine::Delta& m) {
  return 2 * m.arms;
}

/// Machines of legs: a column of each leg, driven or not, by what it becomes longer.
Columns columns_of(const machine::Parallel& m, const JointVector& q, const Pose* X_MT) {
  const Pose X = X_MT != nullptr ? settled(m, *X_MT).value_or(*X_MT) : machine::forward(m, q);
  return {X, machine::leg_columns(m, X, q)};
}
double column_compliance(const machine::Parallel& m, int i) {
  return m.legs[static_cast<std::size_t>(i)].compliance;
}
void set_column_compliance(machine::Parallel& m, int i, double c) {
  m.legs[static_cast<std::size_t>(i)].compliance = c;
}
std::string column_name(const machine::Parallel&, int i) {
  return fmt::format("leg {}", i + 1);
}
int column_count(const machine::Parallel& m) {
  return static_cast<int>(m.legs.size());
}
bool column_turns(const machine::Parallel&, int) {
  return false;
}

/// Machines in series: the columns of every stage, carried to the tool tip.
Columns columns_of(const machine::Stages& m, const JointVector& q, const Pose* X_MT);
double column_compliance(const machine::Stages& m, int i);
void set_column_compliance(machine::Stages& m, int i, double c);
std::string column_name(const machine::Stages& m, int i);
int column_count(const machine::Stages& m);
bool column_turns(const machine::Stages& m, int i);

/// Whether the column turns (rad/Nm) or slides or stretches (m/N).
bool column_turns(const SerialArm& arm, int i) {
  return arm.dh[static_cast<std::size_t>(i)].kind == machine::JointKind::revolute;
}
template <SixLegged M>
bool column_turns(const M&, int) {
  return false;
}
bool column_turns(const machine::RotaryDelta& m, int i) {
  return i < m.arms;
}
bool column_turns(const machine::LinearDelta&, int) {
  return false;
}

Columns columns_of(const machine::Stages& m, const JointVector& q, const Pose* X_MT) {
  const std::vector<machine::StagePose> stages = stage_poses(m, X_MT != nullptr ? *X_MT : machine::forward(m, q), q);
  Columns out;
  out.X_MT = stages.back().X_MB * stages.back().X;
  out.J.resize(6, column_count(m));
  Eigen::Index at = 0;
  for (std::size_t k = 0; k < stages.size(); ++k) {
    const Columns own =
        std::visit([&](const auto& stage) { return columns_of(stage, stages[k].q, &stages[k].X); }, m.machines[k]);
    for (Eigen::Index i = 0; i < own.J.cols(); ++i) out.J.col(at++) = carried(stages[k], own.J.col(i), out.X_MT.p);
  }
  return out;
}
/// Calls ask(machine of the stage, number in it, number of the stage from 1) for a column of the whole.
template <class M, class Ask>
auto in_stage(M& m, int i, Ask&& ask) {
  std::size_t k = 0;
  const auto count = [&] { return std::visit([](const auto& stage) { return column_count(stage); }, m.machines[k]); };
  for (; k + 1 < m.machines.size() && i >= count(); ++k) i -= count();
  return std::visit([&](auto& stage) { return ask(stage, i, k + 1); }, m.machines[k]);
}
double column_compliance(const machine::Stages& m, int i) {
  return in_stage(m, i, [](const auto& stage, int own, std::size_t) { return column_compliance(stage, own); });
}
void set_column_compliance(machine::Stages& m, int i, double c) {
  in_stage(m, i, [&](auto& stage, int own, std::size_t) { set_column_compliance(stage, own, c); });
}
std::string column_name(const machine::Stages& m, int i) {
  return in_stage(m, i, [](const auto& stage, int own, std::size_t k) {
    return fmt::format("stage {} {}", k, column_name(stage, own));
  });
}
bool column_turns(const machine::Stages& m, int i) {
  return in_stage(m, i, [](const auto& stage, int own, std::size_t) { return column_turns(stage, own); });
}
int column_count(const machine::Stages& m) {
  int n = 0;
  for (const AnyMachine& machine : m.machines) {
    n += std::visit([](const auto& stage) { return column_count(stage); }, machine);
  }
  return n;
}

Compliance compliance_of(const AnyMachine& machine, const JointVector& q, const Pose* X_MT) {
  Compliance out;
  std::visit(
      [&](const auto& m) {
        const Columns columns = columns_of(m, q, X_MT);
        out.X_MT = columns.X_MT;
        for (int i = 0; i < columns.J.cols(); ++i) {
          const Vec6 j = columns.J.col(i);
          out.by_joint.push_back(column_compliance(m, i) * j * j.transpose());
          out.joint.push_back(column_name(m, i));
          out.C += out.by_joint.back();
        }
      },
      machine);
  out.joints = q;
  out.reachable = true;
  return out;
}

}  // namespace

Compliance compliance_at_joints(const AnyMachine& machine, const JointVector& q) {
  return compliance_of(machine, q, nullptr);
}

Compliance compliance_at(const AnyMachine& machine, const Pose& X_MT) {
  const kinematics::InverseResult result = kinematics::inverse(machine, X_MT);
  if (const kinematics::Solution* s = result.reachable()) return compliance_of(machine, s->joints, &X_MT);
  Compliance out;
  out.X_MT = X_MT;
  out.reason = kinematics::reason_of(machine, result);
  return out;
}

std::vector<Mat3> unit_compliances(const AnyMachine& machine, const Pose& X_MT, const JointVector& q) {
  return std::visit(
      [&](const auto& m) {
        const Columns columns = columns_of(m, q, &X_MT);
        std::vector<Mat3> out;
        for (int i = 0; i < columns.J.cols(); ++i) {
          const Vec3 v = columns.J.col(i).template head<3>();
          out.push_back(v * v.transpose());
        }
        return out;
      },
      machine);
}

std::vector<double> column_compliances(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        std::vector<double> out;
        for (int i = 0; i < column_count(m); ++i) out.push_back(column_compliance(m, i));
        return out;
      },
      machine);
}

Result<AnyMachine> with_compliances(const AnyMachine& machine, const std::vector<double>& compliances) {
  AnyMachine out = machine;
  return std::visit(
      [&](auto& m) -> Result<AnyMachine> {
        if (static_cast<int>(compliances.size()) != column_count(m)) {
          return fail("MA105", fmt::format("{} compliances for {} joints", compliances.size(), column_count(m)));
        }
        for (int i = 0; i < column_count(m); ++i) {
          set_column_compliance(m, i, compliances[static_cast<std::size_t>(i)]);
        }
        return AnyMachine(m);
      },
      out);
}

std::vector<std::string> column_names(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        std::vector<std::string> out;
        for (int i = 0; i < column_count(m); ++i) out.push_back(column_name(m, i));
        return out;
      },
      machine);
}

std::vector<bool> column_turns(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        std::vector<bool> out;
        for (int i = 0; i < column_count(m); ++i) out.push_back(column_turns(m, i));
        return out;
      },
      machine);
}

bool has_compliance(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) {
        for (int i = 0; i < column_count(m); ++i)
          if (column_compliance(m, i) > 0) return true;
        return false;
      },
      machine);
}

Status needs_compliance(const AnyMachine& machine) {
  if (has_compliance(machine)) return {};
  return fail(
      "AP105", fmt::format("{} has no compliances", machine::name_of(machine)), {},
      "give compliance_rad_per_Nm (arms), leg.compliance_um_per_N (hexapods), drive.compliance_rad_per_Nm, "
      "rail.compliance_um_per_N or rod.compliance_um_per_N (deltas), compliance_um_per_N of each [[leg]] (machines of "
      "legs) in the machine file");
}

struct Probe::Impl {
  const AnyMachine machine;
  const SerialArm* arm = nullptr;
  std::optional<machine::WristInverse> closed;
  Mat3 R_MT;
  JointVector joints;
  machine::WristInverse::Branches branches;
  Vec3 last = Vec3::Zero();

  Impl(const AnyMachine& m, const Mat3& R) : machine(m), arm(std::get_if<SerialArm>(&machine)), R_MT(R) {
    if (arm == nullptr) return;
    if (auto wrist = machine::WristInverse::of(*arm)) closed = std::move(*wrist);
  }
};

Probe::Probe(const AnyMachine& machine, const Mat3& R_MT) : impl_(std::make_unique<Impl>(machine, R_MT)) {}
Probe::~Probe() = default;
Probe::Probe(Probe&&) noexcept = default;
Probe& Probe::operator=(Probe&&) noexcept = default;

bool Probe::at(const Vec3& p_M, Mat3& C) {
  Impl& s = *impl_;
  s.last = p_M;
  if (s.closed) {
    s.closed->solve(p_M, s.R_MT.col(2), s.branches);
    const int b = s.closed->first_within_limits(s.branches);
    if (b < 0) return false;
    s.joints = s.branches.joints[b];
    const machine::ForwardJacobian fj = machine::forward_jacobian(*s.arm, s.joints, true);
    C.setZero();
    for (int i = 0; i < fj.J.cols(); ++i) {
      const Vec3 v = fj.J.col(i).head<3>();
      C.noalias() += (s.arm->dh[static_cast<std::size_t>(i)].compliance * v) * v.transpose();
    }
    return true;
  }
  const Pose X_MT{s.R_MT, p_M};
  // On a way the posture that the arm has had so far.
  const kinematics::InverseResult result =
      s.joints.size() > 0 ? kinematics::inverse_near(s.machine, X_MT, s.joints) : kinematics::inverse(s.machine, X_MT);
  const kinematics::Solution* solution = result.reachable();
  if (solution == nullptr) return false;
  const Compliance c = compliance_of(s.machine, solution->joints, &X_MT);
  s.joints = c.joints;
  C = c.linear();
  return true;
}

std::string Probe::why() const {
  return kinematics::reason_of(impl_->machine, kinematics::inverse(impl_->machine, Pose{impl_->R_MT, impl_->last}));
}

const JointVector& Probe::joints() const {
  return impl_->joints;
}

Map compliance_map(const AnyMachine& machine, const PlaneGrid& grid, const Mat3& R_MT) {
  Map map{grid, {}};
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      MapPoint point;
      point.p_M = grid.point(column, row);
      point.compliance = compliance_at(machine, Pose{R_MT, point.p_M});
      if (point.compliance.reachable) {
        const Eigen::MatrixXd J = kinematics::task_jacobian(
            kinematics::task(machine), kinematics::jacobian(machine, point.compliance.X_MT, point.compliance.joints));
        if (J.rows() == J.cols()) point.determinant = J.determinant();
      }
      map.points.push_back(std::move(point));
    }
  }
  return map;
}

std::vector<PathError> path_error(const AnyMachine& machine, const Vec3& from_M, const Vec3& to_M, int points,
                                  const Mat3& R_MT, const Vec3& force_M) {
  std::vector<PathError> out;
  for (int i = 0; i < points; ++i) {
    PathError e;
    e.p_M = from_M + (to_M - from_M) * (points > 1 ? double(i) / (points - 1) : 0.0);
    const Compliance c = compliance_at(machine, Pose{R_MT, e.p_M});
    e.reachable = c.reachable;
    if (c.reachable) e.total = c.displacement(force_M);
    for (const Mat6& share : c.by_joint) e.by_joint.push_back(share.topLeftCorner<3, 3>() * force_M);
    out.push_back(std::move(e));
  }
  return out;
}

}  // namespace polypod::statics
