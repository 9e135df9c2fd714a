// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Constraints hold exactly where more legs than freedoms share a closure in least squares.
#pragma once

namespace polypod::kinematics {

/// What a constraint counts for beside a leg: it gives way by 1e-10 of what it would with the weight of a leg.
inline constexpr double kHeld = 1e5;

/// Weighs the rows of a closure (equations x anything, each) that are no legs, so that least squares over more than six
/// equations are those of the legs alone. The first such row is `first_constraint_row(m)`, a question that a family
/// with constraints answers; of others, and of six equations, which need no least squares, nothing changes.
template <class M, class... Rows>
void hold_constraints(const M& m, Rows&... rows) {
  if constexpr (requires { first_constraint_row(m); }) {
    const auto first = first_constraint_row(m);
    const auto hold = [first](auto& of) {
      if (of.rows() > 6 && first < of.rows()) of.bottomRows(of.rows() - first) *= kHeld;
    };
    (hold(rows), ...);
  }
}

}  // namespace polypod::kinematics
