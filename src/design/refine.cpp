// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "refine.hpp"

#include <nlopt.h>

#include <exception>
#include <memory>

namespace polypod::design {
namespace {

/// What the C function hands back to us.
struct Call {
  const std::function<double(const std::vector<double>&)>& f;
  const std::function<bool()>& stop;
  nlopt_opt opt;
  std::exception_ptr thrown;
};

double value(unsigned n, const double* u, double* /*gradient*/, void* data) {
  auto& call = *static_cast<Call*>(data);
  constexpr double kLowest = -1e30;
  if (call.stop()) {
    nlopt_force_stop(call.opt);
    return kLowest;
  }
  try {
    return call.f(std::vector<double>(u, u + n));
  } catch (...) {  // not through C
    call.thrown = std::current_exception();
    nlopt_force_stop(call.opt);
    return kLowest;
  }
}

}  // namespace

bool subplex(const std::vector<double>& u0, double step, int most,
             const std::function<double(const std::vector<double>&)>& f, const std::function<bool()>& stop) {
  constexpr double kSmallest = 1e-4;
  const std::unique_ptr<nlopt_opt_s, void (*)(nlopt_opt)> opt(
      nlopt_create(NLOPT_LN_SBPLX, static_cast<unsigned>(u0.size())), nlopt_destroy);
  if (!opt || most < 1) return false;
  Call call{f, stop, opt.get(), nullptr};
  nlopt_set_lower_bounds1(opt.get(), 0);
  nlopt_set_upper_bounds1(opt.get(), 1);
  nlopt_set_max_objective(opt.get(), value, &call);
  nlopt_set_initial_step1(opt.get(), step);
  nlopt_set_xtol_abs1(opt.get(), kSmallest);
  nlopt_set_maxeval(opt.get(), most);
  std::vector<double> u = u0;
  double best = 0;
  const nlopt_result ended = nlopt_optimize(opt.get(), u.data(), &best);
  if (call.thrown) std::rethrow_exception(call.thrown);
  return ended == NLOPT_XTOL_REACHED;
}

}  // namespace polypod::design
