// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/kinematics/forward_near.hpp"

#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::kinematics {

ForwardResult forward_near(const AnyMachine& machine, const JointVector& q, const Pose& near) {
  const bool finite = q.allFinite() && near.p.allFinite() && near.R.allFinite();
  if (finite && q.size() == joint_count(machine)) {
    const std::optional<NewtonResult> mode = std::visit(
        [&](const auto& m) -> std::optional<NewtonResult> {
          if constexpr (requires { six_legs(m, q); }) {
            return newton_on_legs(six_legs(m, q), near);
          } else if constexpr (requires { forward_from_home(m, q); }) {
            return forward_by_closure(m, std::span<const double>(q.data(), static_cast<std::size_t>(q.size())), near);
          }
          return {};
        },
        machine);
    if (mode && mode->converged) return {{mode->X_MT}, {mode->residual}, false, {}};
  }
  return forward(machine, q);
}

}  // namespace polypod::kinematics
