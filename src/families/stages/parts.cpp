// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/stages/parts.hpp"

#include <fmt/format.h>

#include "polypod/families/serial/parts.hpp"
#include "polypod/kinematics/parts.hpp"

namespace polypod::machine {

std::vector<Element> elements(const Stages& m) {
  std::vector<Element> out;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    for (Element& own : kinematics::elements(m.machines[k])) {
      own.name = fmt::format("stage {} {}", k + 1, own.name);
      out.push_back(std::move(own));
    }
  }
  return out;
}

ElementColumns element_columns(const Stages& m, const JointVector& q, const Pose* X_MT) {
  const std::vector<StagePose> stages = stage_poses(m, X_MT != nullptr ? *X_MT : forward(m, q), q);
  ElementColumns out;
  out.X_MT = stages.back().X_MB * stages.back().X;
  for (std::size_t k = 0; k < stages.size(); ++k) {
    const ElementColumns own = kinematics::element_columns(m.machines[k], stages[k].q, &stages[k].X);
    const Eigen::Index at = out.J.cols();
    out.J.conservativeResize(6, at + own.J.cols());
    for (Eigen::Index i = 0; i < own.J.cols(); ++i) out.J.col(at + i) = carried(stages[k], own.J.col(i), out.X_MT.p);
  }
  return out;
}

void set_compliance(Stages& m, int element, double compliance) {
  std::size_t k = 0;
  const auto count = [&] { return static_cast<int>(kinematics::elements(m.machines[k]).size()); };
  for (; k + 1 < m.machines.size() && element >= count(); ++k) element -= count();
  kinematics::set_compliance(m.machines[k], element, compliance);
}

Reach reach(const Stages& m) {
  double farthest = 0;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    const Reach own = kinematics::reach(m.machines[k]);
    farthest += m.data[k].mount.p.norm() + own.low.cwiseAbs().cwiseMax(own.high.cwiseAbs()).norm();
  }
  return {Vec3::Constant(-farthest), Vec3::Constant(farthest)};
}
Vec3 middle_of_work(const Stages& m) {
  return home_pose(m).p;
}

Outline outline(const Stages& m, const Vec3&) {
  Outline out;
  Pose X;
  for (std::size_t k = 0; k < m.machines.size(); ++k) {
    X = X * m.data[k].mount;
    const Pose home = kinematics::home_pose(m.machines[k]).value_or(Pose{});
    const auto* chain = std::get_if<SerialArm>(&m.machines[k]);
    for (OutlinePart& part :
         chain != nullptr ? called(outline_at(*chain, forward(*chain, m.data[k].home), m.data[k].home), " at home")
                          : kinematics::outline(m.machines[k], home.p)) {
      for (Vec3& p : part.points) p = X * p;
      out.push_back(std::move(part));
    }
    X = X * (chain != nullptr ? forward(*chain, m.data[k].home) : home);
  }
  return out;
}

Outline outline_at(const Stages& m, const Pose& X_MT, const JointVector& q) {
  Outline out;
  const std::vector<StagePose> stages = stage_poses(m, X_MT, q);
  for (std::size_t k = 0; k < stages.size(); ++k) {
    for (OutlinePart& part : kinematics::outline_at(m.machines[k], stages[k].X, stages[k].q)) {
      for (Vec3& p : part.points) p = stages[k].X_MB * p;
      out.push_back(std::move(part));
    }
  }
  return out;
}

bool hangs_down(const Stages& m) {
  if (!kinematics::hangs_down(m.machines[m.closed])) return false;
  // z of its own M points down; that of the whole does where what carries it leaves it nearly so.
  constexpr double kNearly = 0.7071;  // 45 deg
  Pose X;
  for (std::size_t k = 0; k < m.closed; ++k)
    X = X * m.data[k].mount * forward(std::get<SerialArm>(m.machines[k]), m.data[k].home);
  return (X * m.data[m.closed].mount).R(2, 2) > kNearly;
}

}  // namespace polypod::machine
