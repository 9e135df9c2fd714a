// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits over boxes of any machine, from its closure and its limits alone.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "linear.hpp"
#include "polypod/core/box_number.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {

/// What the bounds ask a machine: its closure and limits with the nominal parameters, and where to begin.
class ClosureQuestions {
 public:
  template <class T>
  using Numbers = std::span<const T>;

  virtual ~ClosureQuestions() = default;
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
class ClosureOf final : public ClosureQuestions {
 public:
  explicit ClosureOf(const M& m) : m_(m) {
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

/// The default of every family. The unknowns u of a pose are the coordinates that follow and the joints, F(v, u) = 0
/// for the prescribed ones v. Over a box of v and a piece of u both F and the limits are taken in first order with a
/// bound on the rest, F = c + A v + B du + [-e, e]. With an inverse Y of B at the middle every solution in the piece
/// has
///   du = -Y c - Y A v + [-r, r],  r = |1 - Y B| |du| + |Y| e
/// and there is one for each v where that lies within the piece for all v (Brouwer). A limit on the solutions is
/// g - l . F for any l, and l is taken so that the unknowns fall out of its first order. So that nothing is left out,
/// the pieces together hold all unknowns that the joints' ranges and the angles allow, but for those where some
/// equation has no zero or some limit is broken for all v. They are halved where that helps, and pass from a box to its
/// octants.
class ClosureLimits {
 public:
  struct Data {};
  class State;

  /// Empty where nothing is proven: a joint without limits that slides, a tool tip without end, or other than as many
  /// equations as unknowns. Errors: WS104, WS106, as for machines of legs.
  static Result<std::optional<ClosureLimits>> of(std::shared_ptr<const ClosureQuestions> questions,
                                                 const Options& options);

  [[nodiscard]] static int groups() { return 1; }
  [[nodiscard]] double lever() const;
  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] static Data prepare(const Patch&) { return {}; }
  void box(Vec3& low, Vec3& high, const Directions&) const;
  Verdict judge(int group, const Vec3& center, const Vec3& half, double radius, const Patch& patch, const Data&,
                BoundList& out) const;

 private:
  explicit ClosureLimits(std::shared_ptr<const State> state) : state_(std::move(state)) {}
  std::shared_ptr<const State> state_;
};

extern template Result<Volume> subdivided_volume(const ClosureLimits&, const Options&);
extern template Result<bool> subdivided_holds(const ClosureLimits&, const Options&, const Shape&, std::int64_t);

}  // namespace polypod::workspace
