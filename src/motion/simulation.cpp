// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/simulation.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/motion/driven_series.hpp"
#include "runge_kutta.hpp"

namespace polypod::motion {
namespace {

constexpr double kMostSamples = 1e6;
// A step that must be shorter than this share of the time between two samples ends the motion: it runs into a singular
// pose, or out of what the machine can be.
constexpr double kShortest = 1e-9;
// Of the error of a coordinate: what is smaller than this counts as this large, m or rad.
constexpr double kFloor = 1e-3;

/// The pose of the joints q next to another one; nothing where Newton's method finds none.
std::optional<Pose> pose_of(const AnyMachine& machine, const JointVector& q, const Pose& near) {
  return std::visit(
      [&](const auto& m) -> std::optional<Pose> {
        const kinematics::NewtonResult r = kinematics::forward_by_closure(
            m, std::span<const double>(q.data(), static_cast<std::size_t>(q.size())), near);
        if (!r.converged) return std::nullopt;
        return r.X_MT;
      },
      machine);
}

/// y = (q, q', work), and what it says of the machine.
class Equations {
 public:
  Equations(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X, const SimulationOptions& options)
      : machine_(machine), dynamics_(dynamics), near_(X), options_(options) {}

  [[nodiscard]] JointVector force(double t, const JointVector& q, const JointVector& v) const {
    return options_.forces ? options_.forces(t, q, v) : JointVector(JointVector::Zero(q.size()));
  }
  std::optional<Eigen::VectorXd> operator()(double t, const Eigen::VectorXd& y) const {
    const Eigen::Index n = y.size() / 2;
    const JointVector q = y.head(n), v = y.segment(n, n);
    if (!y.allFinite()) return std::nullopt;
    const std::optional<Pose> X = pose_of(machine_, q, near_);
    if (!X) return std::nullopt;
    const JointVector tau = force(t, q, v);
    const std::optional<JointVector> a = accelerations(machine_, dynamics_, *X, q, v, tau);
    if (!a) return std::nullopt;
    Eigen::VectorXd out(y.size());
    out << v, *a, (tau - dissipated(v)).dot(v);
    return out;
  }
  /// The force of viscous friction.
  [[nodiscard]] JointVector dissipated(const JointVector& v) const {
    JointVector out = v;
    for (Eigen::Index j = 0; j < v.size(); ++j) {
      const auto& d = dynamics_.viscous;
      out[j] *= d.empty() ? 0 : d[d.size() == 1 ? 0 : static_cast<std::size_t>(j)];
    }
    return out;
  }
  [[nodiscard]] const Pose& near() const { return near_; }
  void come_to(const Pose& X) { near_ = X; }

 private:
  const AnyMachine& machine_;
  const Dynamics& dynamics_;
  Pose near_;
  const SimulationOptions& options_;
};

Status allowed(const AnyMachine& machine, const Dynamics& dynamics, const SimulationOptions& o) {
  if (const std::string why = no_dynamics(machine); !why.empty()) return fail("MO130", "no forward dynamics: " + why);
  if (std::any_of(dynamics.friction.begin(), dynamics.friction.end(), [](double f) { return f != 0; })) {
    return fail("MO131", "dry friction is not simulated: it holds a drive that stands still", {},
                "leave `friction` out of the table dynamics, or put `viscous` in its place");
  }
  const bool positive = o.time > 0 && o.interval > 0 && o.step >= 0 && o.tolerance > 0;
  if (!positive || !(o.time / o.interval <= kMostSamples)) {
    return fail("MO133",
                fmt::format("time {:g} s, samples every {:g} s, steps of {:g} s, tolerance {:g}: each must be above 0, "
                            "and there are at most {:.0e} samples",
                            o.time, o.interval, o.step, o.tolerance, kMostSamples));
  }
  return {};
}

void in_order(std::vector<LimitPassed>& passed) {
  std::stable_sort(passed.begin(), passed.end(), [](const LimitPassed& a, const LimitPassed& b) { return a.t < b.t; });
}

}  // namespace

std::optional<JointVector> accelerations(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X,
                                         const JointVector& q, const JointVector& v, const JointVector& tau) {
  const JointSeries coasting = driven_series(machine, X, q, v, JointVector::Zero(q.size()));
  if (!coasting.regular) return std::nullopt;
  const JointVector rest = tau - drive_forces(machine, dynamics, coasting);
  const Eigen::LDLT<Eigen::MatrixXd> M(mass_matrix(machine, dynamics, X, q));
  constexpr double kNoMass = 1e-12;  // of the largest
  const Eigen::VectorXd masses = M.vectorD();
  if (!(masses.minCoeff() > kNoMass * masses.maxCoeff())) return std::nullopt;
  JointVector a = M.solve(rest);
  if (!a.allFinite()) return std::nullopt;
  return a;
}

Result<Simulation> simulate(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X, const JointVector& q,
                            const JointVector& v, const SimulationOptions& options) {
  POLYPOD_TRY(allowed(machine, dynamics, options));
  const Eigen::Index n = q.size();
  Equations f(machine, dynamics, X, options);
  Eigen::VectorXd y(2 * n + 1);
  y << q, v, 0;
  std::optional<Eigen::VectorXd> slope = f(0, y);
  if (!slope) {
    return fail(
        "MO132", "no accelerations at the start: something moves without mass, or the pose is singular", {},
        "give the platform (or every link of an arm) a mass and an inertia, or the drives a drive_inertia, or begin "
        "elsewhere");
  }
  Simulation out;
  kinematics::LimitBits broken = 0;
  const auto add_sample = [&](double t) {
    SimulationSample s;
    s.t = t;
    s.q = y.head(n);
    s.speed = y.segment(n, n);
    s.acceleration = slope->segment(n, n);
    s.force = f.force(t, s.q, s.speed);
    s.work = y[2 * n];
    s.X = f.near();
    s.energy = energy_of(machine, dynamics, driven_series(machine, s.X, s.q, s.speed, s.acceleration));
    s.violations = kinematics::violations(machine, s.X, s.q);
    if (!out.samples.empty()) {
      const SimulationSample& first = out.samples.front();
      const double gained = s.energy.kinetic + s.energy.potential - first.energy.kinetic - first.energy.potential;
      out.drift = std::max(out.drift, std::abs(gained - s.work));
    }
    out.samples.push_back(std::move(s));
  };
  out.drives.resize(static_cast<std::size_t>(n));
  const auto extend = [&] {
    for (Eigen::Index i = 0; i < n; ++i) {
      DriveExtent& d = out.drives[static_cast<std::size_t>(i)];
      d.low = std::min(d.low, y[i]);
      d.high = std::max(d.high, y[i]);
      d.speed = std::max(d.speed, std::abs(y[n + i]));
      d.acceleration = std::max(d.acceleration, std::abs((*slope)[n + i]));
    }
  };
  const auto pass = [&](kinematics::LimitBits fresh, double t) {
    for (const std::string& limit : kinematics::limit_names(machine, fresh)) out.passed.push_back({t, limit});
    broken |= fresh;
  };
  // Of a step, between its ends by the cubic that has their values and rates.
  const auto judge_step = [&](double t, double step, const Eigen::VectorXd& y0, const Eigen::VectorXd& rate0,
                              const Pose& X0) {
    const auto broken_at = [&](double share) -> kinematics::LimitBits {
      const double w = share, e = 1 - w;
      const JointVector there = (e * e * (1 + 2 * w)) * y0.head(n) + (w * w * (3 - 2 * w)) * y.head(n) +
                                step * w * e * (e * rate0.head(n) - w * slope->head(n));
      const std::optional<Pose> at = pose_of(machine, there, w < 0.5 ? X0 : f.near());
      return at ? kinematics::violations(machine, *at, there) & ~broken : 0;
    };
    constexpr int kPlaces = 4, kHalvings = 10;
    for (int k = 1; k <= kPlaces; ++k) {
      for (kinematics::LimitBits fresh = broken_at(static_cast<double>(k) / kPlaces); fresh != 0; fresh &= fresh - 1) {
        const kinematics::LimitBits bit = fresh & ~(fresh - 1);
        double low = static_cast<double>(k - 1) / kPlaces, high = static_cast<double>(k) / kPlaces;
        for (int i = 0; i < kHalvings; ++i) {
          const double middle = 0.5 * (low + high);
          ((broken_at(middle) & bit) != 0 ? high : low) = middle;
        }
        pass(bit, t + high * step);
      }
    }
  };
  extend();
  add_sample(0);
  pass(out.samples.front().violations, 0);
  const auto intervals = static_cast<std::size_t>(std::max(1.0, std::ceil(options.time / options.interval - 1e-9)));
  const bool fixed = options.step > 0;
  double h = fixed ? options.step : options.interval / 10;
  for (std::size_t k = 0; k < intervals; ++k) {
    const double from = options.time * static_cast<double>(k) / static_cast<double>(intervals);
    const double to = options.time * static_cast<double>(k + 1) / static_cast<double>(intervals);
    if (options.progress && !options.progress(static_cast<double>(k) / static_cast<double>(intervals))) {
      return fail("MO199", "cancelled");
    }
    // Fixed steps divide the interval evenly.
    const double even = (to - from) / std::ceil((to - from) / (fixed ? h : to - from) - 1e-9);
    double t = from;
    while (t < to) {
      if (out.steps + out.repeated >= options.most_steps) {
        return fail("MO134", fmt::format("{} steps, and {:g} of {:g} s are done", options.most_steps, t, options.time),
                    {}, "a larger tolerance or step, or less time");
      }
      double step = std::min(fixed ? even : h, to - t);
      if (to - (t + step) < 1e-9 * (to - from)) step = to - t;
      const std::optional<RungeKuttaStep> next = dormand_prince(f, t, y, *slope, step);
      double error = next ? 0 : 2;  // against what is allowed
      if (next && !fixed) {
        for (Eigen::Index i = 0; i < 2 * n; ++i) {
          const double size = kFloor + std::max(std::abs(y[i]), std::abs(next->y[i]));
          error = std::max(error, std::abs(next->error[i]) / (options.tolerance * size));
        }
      }
      std::optional<Eigen::VectorXd> slope_there;
      std::optional<Pose> X_there;
      if (next && error <= 1) {
        X_there = pose_of(machine, next->y.head(n), f.near());
        if (X_there) slope_there = f(t + step, next->y);
        if (!slope_there) error = 2;
      }
      if (error > 1) {
        ++out.repeated;
        h = next ? step * std::max(0.2, 0.9 * std::pow(error, -0.2)) : 0.3 * step;
        if (fixed || h < kShortest * (to - from)) {
          out.stopped =
              fmt::format("after {:.4g} s the machine runs into a singular pose, or out of what its legs allow{}", t,
                          fixed ? " within a step" : "");
          add_sample(t);
          in_order(out.passed);
          return out;
        }
        continue;
      }
      ++out.steps;
      const Eigen::VectorXd y_before = std::exchange(y, next->y), rate_before = *std::exchange(slope, slope_there);
      const Pose X_before = f.near();
      f.come_to(*X_there);
      extend();
      judge_step(t, step, y_before, rate_before, X_before);
      t = to - (t + step) < 1e-9 * (to - from) ? to : t + step;
      if (!fixed) h = step * std::clamp(0.9 * std::pow(std::max(error, 1e-10), -0.2), 0.2, 5.0);
    }
    add_sample(to);
  }
  in_order(out.passed);
  return out;
}

}  // namespace polypod::motion
