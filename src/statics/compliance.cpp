// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/compliance.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "../families/quick_compliance.hpp"
#include "polypod/kinematics/beginning.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/kinematics/hold.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/kinematics/posture.hpp"

namespace polypod::statics {

using machine::JointVector;

namespace {

constexpr const char* kNotHeld =
    "the pose is singular (type 2): with all drives locked the tool can still move, however stiff they are";

Compliance compliance_of(const AnyMachine& machine, const JointVector& q, const Pose* X_MT) {
  Compliance out;
  if (const Status given = needs_compliance(machine); !given) out.reason = given.error().message;
  const machine::ElementColumns columns = kinematics::element_columns(machine, q, X_MT);
  out.X_MT = columns.X_MT;
  const std::vector<machine::Element> elements = kinematics::elements(machine);
  for (int i = 0; i < columns.J.cols(); ++i) {
    const machine::Element& element = elements[static_cast<std::size_t>(i)];
    const Vec6 j = columns.J.col(i);
    out.by_joint.push_back(element.compliance * j * j.transpose());
    out.joint.push_back(element.name);
    out.C += out.by_joint.back();
  }
  out.joints = q;
  out.reachable = kinematics::hold(machine, out.X_MT, q).control >= kinematics::kNoHold;
  if (!out.reachable) out.reason = kNotHeld;
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
  const machine::ElementColumns columns = kinematics::element_columns(machine, q, &X_MT);
  std::vector<Mat3> out;
  for (int i = 0; i < columns.J.cols(); ++i) {
    const Vec3 v = columns.J.col(i).head<3>();
    out.push_back(v * v.transpose());
  }
  return out;
}

std::vector<double> column_compliances(const AnyMachine& machine) {
  std::vector<double> out;
  for (const machine::Element& element : kinematics::elements(machine)) out.push_back(element.compliance);
  return out;
}

Result<AnyMachine> with_compliances(const AnyMachine& machine, const std::vector<double>& compliances) {
  const std::size_t count = kinematics::elements(machine).size();
  if (compliances.size() != count) {
    return fail("MA105", fmt::format("{} compliances for {} joints", compliances.size(), count));
  }
  AnyMachine out = machine;
  for (std::size_t i = 0; i < count; ++i) kinematics::set_compliance(out, static_cast<int>(i), compliances[i]);
  return out;
}

std::vector<std::string> column_names(const AnyMachine& machine) {
  std::vector<std::string> out;
  for (const machine::Element& element : kinematics::elements(machine)) out.push_back(element.name);
  return out;
}

std::vector<bool> column_turns(const AnyMachine& machine) {
  std::vector<bool> out;
  for (const machine::Element& element : kinematics::elements(machine)) out.push_back(element.turns);
  return out;
}

bool has_compliance(const AnyMachine& machine) {
  const std::vector<machine::Element> elements = kinematics::elements(machine);
  return std::any_of(elements.begin(), elements.end(), [](const machine::Element& e) { return e.compliance > 0; });
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
  machine::QuickCompliance quick;
  Mat3 R_MT;
  std::string posture;
  JointVector joints, start;
  Vec3 last = Vec3::Zero();

  Impl(const AnyMachine& m, const Mat3& R, std::string in, const std::vector<double>& from)
      : machine(m),
        R_MT(R),
        posture(std::move(in)),
        start(Eigen::Map<const Eigen::VectorXd>(from.data(), std::ssize(from))) {
    quick = std::visit(
        [this]<class M>(const M& of) -> machine::QuickCompliance {
          if constexpr (requires { quick_compliance(of, posture); }) return quick_compliance(of, posture);
          return {};
        },
        machine);
  }

  /// On a way in the posture that the machine has had so far; nothing where no solution keeps the limits.
  [[nodiscard]] std::optional<JointVector> joints_of(const Pose& X_MT) const {
    const bool goes_on = joints.size() > 0;
    const JointVector& near = goes_on ? joints : start;
    const kinematics::InverseResult result =
        near.size() > 0 ? kinematics::inverse_near(machine, X_MT, near) : kinematics::inverse(machine, X_MT);
    const kinematics::Solution* best =
        goes_on ? result.reachable() : kinematics::first_solution(machine, X_MT, result, posture, start.size() > 0);
    return best == nullptr ? std::nullopt : std::optional(best->joints);
  }
};

Probe::Probe(const AnyMachine& machine, const Mat3& R_MT, std::string posture, const std::vector<double>& start)
    : impl_(std::make_unique<Impl>(machine, R_MT, std::move(posture), start)) {}
Probe::~Probe() = default;
Probe::Probe(Probe&&) noexcept = default;
Probe& Probe::operator=(Probe&&) noexcept = default;

bool Probe::follows() const {
  return !impl_->quick;
}

void Probe::follow(const Pose& X_MT) {
  if (const auto q = impl_->joints_of(X_MT)) impl_->joints = *q;
}

void Probe::stand_at(const machine::JointVector& q) {
  impl_->joints = q;
}

bool Probe::at(const Vec3& p_M, Mat3& C) {
  Impl& s = *impl_;
  s.last = p_M;
  if (s.quick) return s.quick(p_M, s.R_MT.col(2), s.joints, C);
  const Pose X_MT{s.R_MT, p_M};
  const auto q = s.joints_of(X_MT);
  if (!q) return false;
  const Compliance c = compliance_of(s.machine, *q, &X_MT);
  if (!c.reachable) return false;
  s.joints = c.joints;
  C = c.linear();
  return true;
}

void Probe::turn_to(const Mat3& R_MT) {
  impl_->R_MT = R_MT;
}

std::string Probe::why() const {
  const Pose X_MT{impl_->R_MT, impl_->last};
  if (std::string reason = compliance_at(impl_->machine, X_MT).reason; !reason.empty() || impl_->posture.empty())
    return reason;
  return kinematics::reason_of(impl_->machine, kinematics::inverse(impl_->machine, X_MT), impl_->posture);
}

const JointVector& Probe::joints() const {
  return impl_->joints;
}

MapPoint map_point(const AnyMachine& machine, const Pose& X_MT) {
  MapPoint point;
  point.compliance = compliance_at(machine, X_MT);
  point.p_M = point.compliance.reachable ? point.compliance.X_MT.p : X_MT.p;
  if (!point.compliance.reachable) return point;
  const Eigen::MatrixXd J = kinematics::task_jacobian(
      kinematics::task(machine), kinematics::jacobian(machine, point.compliance.X_MT, point.compliance.joints),
      point.compliance.X_MT);
  if (J.rows() == J.cols()) point.determinant = J.determinant();
  return point;
}

Map compliance_map(const AnyMachine& machine, const PlaneGrid& grid, const Mat3& R_MT) {
  Map map{grid, {}};
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const Vec3 p_M = grid.point(column, row);
      map.points.push_back(map_point(machine, Pose{R_MT, p_M}));
      map.points.back().p_M = p_M;  // to the last bit
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
