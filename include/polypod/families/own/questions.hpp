// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The questions of the concept behind virtual functions, with what follows where a family does not answer them.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "polypod/core/box_number.hpp"
#include "polypod/families/own/machine.hpp"
#include "polypod/kinematics/concept.hpp"
#include "polypod/machine/parts.hpp"

namespace polypod::machine {

/// What machine::Own asks the user's struct. Those with a body have a default that follows from the others.
class OwnQuestions {
 public:
  virtual ~OwnQuestions() = default;

  [[nodiscard]] virtual int joints() const = 0;
  [[nodiscard]] virtual JointKind kind(int joint) const = 0;
  [[nodiscard]] virtual JointRange range(int joint) const = 0;
  [[nodiscard]] virtual Task prescribes() const = 0;
  [[nodiscard]] virtual std::vector<Parameter> figures() const = 0;
  [[nodiscard]] virtual std::string limit_called(int limit) const = 0;
  [[nodiscard]] virtual std::string written() const = 0;

  using Dual = kinematics::Dual;
  template <class T>
  using Numbers = std::span<const T>;
  [[nodiscard]] virtual ClosureVectorT<double> equations(const PoseT<double>&, Numbers<double>,
                                                         Numbers<double>) const = 0;
  [[nodiscard]] virtual ClosureVectorT<Dual> equations(const PoseT<Dual>&, Numbers<Dual>, Numbers<Dual>) const = 0;
  [[nodiscard]] virtual ClosureVectorT<Interval> equations(const PoseT<Interval>&, Numbers<Interval>,
                                                           Numbers<Interval>) const = 0;
  [[nodiscard]] virtual std::vector<double> kept(const PoseT<double>&, Numbers<double>, Numbers<double>) const = 0;
  [[nodiscard]] virtual std::vector<Interval> kept(const PoseT<Interval>&, Numbers<Interval>,
                                                   Numbers<Interval>) const = 0;
  /// Over boxes, for certain workspaces.
  [[nodiscard]] virtual ClosureVectorT<BoxNumber> equations(const PoseT<BoxNumber>&, Numbers<BoxNumber>,
                                                            Numbers<BoxNumber>) const = 0;
  [[nodiscard]] virtual std::vector<BoxNumber> kept(const PoseT<BoxNumber>&, Numbers<BoxNumber>,
                                                    Numbers<BoxNumber>) const = 0;

  /// Closed forms, where the family has them.
  [[nodiscard]] virtual std::optional<Pose> home() const { return {}; }
  [[nodiscard]] virtual std::optional<Pose> pose_of_joints(const JointVector&) const { return {}; }
  [[nodiscard]] virtual std::optional<kinematics::InverseResult> joints_of_pose(const Pose&) const { return {}; }
  [[nodiscard]] virtual std::optional<JacobianMatrix> speeds(const Pose&, const JointVector&) const { return {}; }
  [[nodiscard]] virtual std::optional<std::string> branch_called(unsigned) const { return {}; }

  [[nodiscard]] virtual std::optional<LimitTable> table_of_limits() const { return {}; }
  [[nodiscard]] virtual std::optional<Reach> reached() const { return {}; }
  [[nodiscard]] virtual std::optional<Outline> drawn(const Vec3&) const { return {}; }
  [[nodiscard]] virtual std::optional<Outline> drawn_at(const Pose&, const JointVector&) const { return {}; }
  [[nodiscard]] virtual std::vector<Parameter> designed() const { return {}; }
  /// The same machine with other figures; null where the family does not take them one by one.
  [[nodiscard]] virtual Result<std::shared_ptr<const OwnQuestions>> with(std::span<const double>) const {
    return std::shared_ptr<const OwnQuestions>{};
  }
};

}  // namespace polypod::machine
