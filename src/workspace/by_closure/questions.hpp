// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What certain workspaces ask of any machine: its closure and its limits on the number types of proofs.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "polypod/core/box_number.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::workspace::by_closure {

/// What the bounds ask a machine: its closure and limits with the nominal parameters, and where to begin.
class Questions {
 public:
  template <class T>
  using Numbers = std::span<const T>;

  virtual ~Questions() = default;
  [[nodiscard]] virtual machine::ClosureVectorT<BoxNumber> equations(const PoseT<BoxNumber>&,
                                                                     Numbers<BoxNumber>) const = 0;
  [[nodiscard]] virtual std::vector<BoxNumber> kept(const PoseT<BoxNumber>&, Numbers<BoxNumber>) const = 0;
  [[nodiscard]] virtual machine::ClosureVectorT<Interval> equations(const PoseT<Interval>&,
                                                                    Numbers<Interval>) const = 0;
  [[nodiscard]] virtual std::vector<Interval> kept(const PoseT<Interval>&, Numbers<Interval>) const = 0;
  /// Whole poses and joints that the inverse finds for what the task prescribes of X.
  struct Solved {
    Pose X;
    machine::JointVector q;
  };
  [[nodiscard]] virtual std::vector<Solved> solutions(const Pose& X) const = 0;

  std::string name;
  machine::Task prescribes;
  std::vector<machine::JointRange> ranges;
  std::vector<bool> turns;
  machine::LimitTable table;
  Pose home;
};

template <class M>
class QuestionsTo final : public Questions {
 public:
  explicit QuestionsTo(const M& m) : m_(m) {
    name = m.name;
    prescribes = task(m);
    for (int i = 0; i < joint_count(m); ++i) {
      ranges.push_back(joint_range(m, i));
      turns.push_back(joint_kind(m, i) == machine::JointKind::revolute);
    }
    table = limit_table(m);
    home = home_pose(m);
    for (const double value : kinematics::nominal_parameters(m)) {
      p_box_.emplace_back(value);
      p_interval_.emplace_back(value);
    }
  }
  [[nodiscard]] machine::ClosureVectorT<BoxNumber> equations(const PoseT<BoxNumber>& X,
                                                             Numbers<BoxNumber> q) const override {
    return closure(m_, X, q, Numbers<BoxNumber>(p_box_));
  }
  [[nodiscard]] std::vector<BoxNumber> kept(const PoseT<BoxNumber>& X, Numbers<BoxNumber> q) const override {
    return limits(m_, X, q, Numbers<BoxNumber>(p_box_));
  }
  [[nodiscard]] machine::ClosureVectorT<Interval> equations(const PoseT<Interval>& X,
                                                            Numbers<Interval> q) const override {
    return closure(m_, X, q, Numbers<Interval>(p_interval_));
  }
  [[nodiscard]] std::vector<Interval> kept(const PoseT<Interval>& X, Numbers<Interval> q) const override {
    return limits(m_, X, q, Numbers<Interval>(p_interval_));
  }
  [[nodiscard]] std::vector<Solved> solutions(const Pose& X) const override {
    std::vector<Solved> out;
    for (const kinematics::Solution& s : inverse(m_, X).solutions) out.push_back({settled(m_, X, s.joints), s.joints});
    return out;
  }

 private:
  const M& m_;
  std::vector<BoxNumber> p_box_;
  std::vector<Interval> p_interval_;
};

}  // namespace polypod::workspace::by_closure
