// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A local search without derivatives.
#pragma once

#include <functional>
#include <vector>

namespace polypod::design {

/// Maximises f over [0, 1]^n from u0 by the subplex method of NLopt (LN_SBPLX), whose first steps are `step`, until the
/// steps fall below 1e-4, `most` calls, or `stop`. `f` may say the lowest number where there is nothing.
/// Whether it ended because the steps are that small.
bool subplex(const std::vector<double>& u0, double step, int most,
             const std::function<double(const std::vector<double>&)>& f, const std::function<bool()>& stop);

}  // namespace polypod::design
