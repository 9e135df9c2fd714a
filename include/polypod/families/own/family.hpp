// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How a user of the library brings a family of machines of her own: a struct M with the functions of
// kinematics::Machine, and every analysis and every command takes it.
//
//   polypod::machine::add_family<Gantry>();      // machine files may say family = "gantry"
//   return polypod::app::run(argc, argv);        // the program `polypod` that knows it
//
// or, without files, AnyMachine any = polypod::machine::own(Gantry{...});
#pragma once

#include <concepts>
#include <memory>
#include <string>
#include <utility>

#include "polypod/families/own/questions.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::machine {

/// Beside the concept: the family's name in files, and its keys as a file has them, name and description left out.
template <class M>
concept OwnFamily = kinematics::Machine<M> && std::copyable<M> && requires(const M& m) {
  { M::kFamily } -> std::convertible_to<std::string_view>;
  { to_toml(m) } -> std::convertible_to<std::string>;
};

namespace own_detail {

template <OwnFamily M>
class Answers final : public OwnQuestions {
 public:
  explicit Answers(M m) : m_(std::move(m)) {}

  [[nodiscard]] int joints() const override { return joint_count(m_); }
  [[nodiscard]] JointKind kind(int joint) const override { return joint_kind(m_, joint); }
  [[nodiscard]] JointRange range(int joint) const override { return joint_range(m_, joint); }
  [[nodiscard]] Task prescribes() const override { return task(m_); }
  [[nodiscard]] std::vector<Parameter> figures() const override { return parameters(m_); }
  [[nodiscard]] std::string limit_called(int limit) const override { return limit_name(m_, limit); }
  [[nodiscard]] std::string written() const override { return to_toml(m_); }

  [[nodiscard]] ClosureVectorT<double> equations(const PoseT<double>& X, Numbers<double> q,
                                                 Numbers<double> p) const override {
    return closure(m_, X, q, p);
  }
  [[nodiscard]] ClosureVectorT<Dual> equations(const PoseT<Dual>& X, Numbers<Dual> q, Numbers<Dual> p) const override {
    return closure(m_, X, q, p);
  }
  [[nodiscard]] ClosureVectorT<Interval> equations(const PoseT<Interval>& X, Numbers<Interval> q,
                                                   Numbers<Interval> p) const override {
    return closure(m_, X, q, p);
  }
  [[nodiscard]] std::vector<double> kept(const PoseT<double>& X, Numbers<double> q, Numbers<double> p) const override {
    return limits(m_, X, q, p);
  }
  [[nodiscard]] std::vector<Interval> kept(const PoseT<Interval>& X, Numbers<Interval> q,
                                           Numbers<Interval> p) const override {
    return limits(m_, X, q, p);
  }
  [[nodiscard]] ClosureVectorT<BoxNumber> equations(const PoseT<BoxNumber>& X, Numbers<BoxNumber> q,
                                                    Numbers<BoxNumber> p) const override {
    return closure(m_, X, q, p);
  }
  [[nodiscard]] std::vector<BoxNumber> kept(const PoseT<BoxNumber>& X, Numbers<BoxNumber> q,
                                            Numbers<BoxNumber> p) const override {
    return limits(m_, X, q, p);
  }

  [[nodiscard]] std::optional<Pose> home() const override {
    if constexpr (requires { home_pose(m_); }) return home_pose(m_);
    return {};
  }
  [[nodiscard]] std::optional<Pose> pose_of_joints(const JointVector& q) const override {
    if constexpr (requires { forward(m_, q); }) return forward(m_, q);
    return {};
  }
  [[nodiscard]] std::optional<kinematics::InverseResult> joints_of_pose(const Pose& X) const override {
    if constexpr (requires { inverse(m_, X); }) return inverse(m_, X);
    return {};
  }
  [[nodiscard]] std::optional<JacobianMatrix> speeds(const Pose& X, const JointVector& q) const override {
    if constexpr (requires { jacobian(m_, X, q); }) return jacobian(m_, X, q);
    return {};
  }
  [[nodiscard]] std::optional<std::string> branch_called(unsigned branch) const override {
    if constexpr (requires { branch_name(m_, branch); }) return branch_name(m_, branch);
    return {};
  }
  [[nodiscard]] std::optional<LimitTable> table_of_limits() const override {
    if constexpr (requires { limit_table(m_); }) return limit_table(m_);
    return {};
  }
  [[nodiscard]] std::optional<Reach> reached() const override {
    if constexpr (requires { reach(m_); }) return reach(m_);
    return {};
  }
  [[nodiscard]] std::optional<Outline> drawn(const Vec3& tip) const override {
    if constexpr (requires { outline(m_, tip); }) return outline(m_, tip);
    return {};
  }
  [[nodiscard]] std::optional<Outline> drawn_at(const Pose& X, const JointVector& q) const override {
    if constexpr (requires { outline_at(m_, X, q); }) return outline_at(m_, X, q);
    return {};
  }
  [[nodiscard]] std::vector<Parameter> designed() const override {
    if constexpr (requires { settings(m_); }) return settings(m_);
    return {};
  }
  [[nodiscard]] Result<std::shared_ptr<const OwnQuestions>> with(std::span<const double> p) const override {
    if constexpr (requires { with_parameters(m_, p); }) {
      POLYPOD_ASSIGN(changed, with_parameters(m_, p));
      return std::make_shared<const Answers>(std::move(changed));
    }
    return std::shared_ptr<const OwnQuestions>{};
  }

 private:
  M m_;
};

template <OwnFamily M>
Own wrapped(M m) {
  Own out;
  out.name = out.family = std::string(M::kFamily);
  const auto drives = static_cast<std::size_t>(joint_count(m));
  out.questions = std::make_shared<const Answers<M>>(std::move(m));
  out.compliance.assign(drives, 0.0);
  return out;
}

}  // namespace own_detail

/// The machine as every analysis takes it.
template <OwnFamily M>
AnyMachine own(M m) {
  return AnyMachine(own_detail::wrapped(std::move(m)));
}

/// Machine files may name the family from now on; to be called before the first file is read, by one thread. `M::from`
/// reads the keys of the family and ends in `table.finish()`; name, description, provenance and the compliances of the
/// drives are read for it. The last family of a name counts. Throws std::invalid_argument where the name is that of a
/// family of Polypod.
template <OwnFamily M>
requires requires(const config::Table& table) {
  { M::from(table) } -> std::same_as<Result<M>>;
}
void add_family() {
  own_detail::add_reader(std::string(M::kFamily), [](const config::Table& table) -> Result<Own> {
    return M::from(table).map([](M&& m) { return own_detail::wrapped(std::move(m)); });
  });
}

}  // namespace polypod::machine
