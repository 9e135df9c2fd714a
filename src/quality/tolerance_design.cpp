// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/quality/tolerance_design.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/quality/singularity.hpp"

namespace polypod::quality {
namespace {

/// The worst case at one pose against the wishes: above 1 where one is missed.
struct Found {
  double ratio = 0;
  bool by_position = true;
  WorstCase worst;
  Pose X_MT;
};

class Designer {
 public:
  Designer(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options, const DesignOptions& design,
           std::vector<std::vector<Sized>> groups)
      : machine_(machine), survey_(survey), options_(options), design_(design), groups_(std::move(groups)) {}

  /// The worst pose for tolerances t of the groups.
  Result<Found> worst(const std::vector<double>& t) const {
    const std::vector<Sized> sizes = sizes_of(t);
    POLYPOD_ASSIGN(field, tolerance_field(machine_, survey_, options_, sizes, {Method::exact, design_.region}));
    const auto seen = [&](const Quantity& q, std::size_t number) {
      return worst_seen(machine_, survey_, options_, q, field.anywhere, number);
    };
    // The search of the errors themselves, so that what is promised is what they then show.
    if (std::isinf(design_.orientation)) return judged(sizes, seen(field.position, 0));
    POLYPOD_ASSIGN(turned, judged(sizes, seen(field.orientation, 1)));
    if (std::isinf(design_.position)) return turned;
    POLYPOD_ASSIGN(found, judged(sizes, seen(field.position, 0)));
    return turned.ratio > found.ratio ? std::move(turned) : std::move(found);
  }

  /// a_k of the limit sum a_k t_k <= 1 that the worst case found at t gives.
  std::vector<double> limit(const Found& found, const std::vector<double>& t) const {
    std::vector<double> a(groups_.size(), 0);
    for (std::size_t k = 0; k < groups_.size(); ++k) {
      for (const WorstCase::Share& share : found.worst.shares) {
        for (const Sized& s : groups_[k]) {
          if (s.element != share.element) continue;
          a[k] +=
              (found.by_position ? share.position / design_.position : share.orientation / design_.orientation) / t[k];
        }
      }
    }
    return a;
  }

 private:
  std::vector<Sized> sizes_of(const std::vector<double>& t) const {
    std::vector<Sized> out;
    for (std::size_t k = 0; k < groups_.size(); ++k)
      for (const Sized& s : groups_[k]) out.push_back({s.element, s.size * t[k]});
    std::sort(out.begin(), out.end(), [](const Sized& a, const Sized& b) { return a.element < b.element; });
    return out;
  }

  [[nodiscard]] double ratio_of(const WorstCase& worst) const {
    return std::max(worst.position / design_.position, worst.orientation / design_.orientation);
  }

  /// Errors: QU122.
  Result<Found> judged(const std::vector<Sized>& sizes, const Extreme& at) const {
    if (!std::isfinite(at.value)) return fail("QU122", "the error is infinite: the workspace holds a singular pose");
    const auto q = joints_at(machine_, at.X_MT);
    if (!q) return fail("QU122", "the worst pose has no joints");
    if (const Singularity near = singularity(machine_, at.X_MT, *q); (near.kind & 2) != 0) {
      return fail("QU122",
                  "the largest error lies close to a singular pose, where errors grow beyond all bounds: it " +
                      in_words(at.X_MT, near),
                  {}, "leave that out: a smaller --box, less tilt or tighter limits");
    }
    POLYPOD_ASSIGN(worst, worst_case(machine_, at.X_MT, *q, sizes, {Method::exact, design_.region}));
    Found found{ratio_of(worst), worst.position / design_.position >= worst.orientation / design_.orientation,
                std::move(worst), at.X_MT};
    return found;
  }

  const AnyMachine& machine_;
  const Survey& survey_;
  const SurveyOptions& options_;
  const DesignOptions& design_;
  std::vector<std::vector<Sized>> groups_;
};

/// The t >= 0 of least sum c_k / t_k with sum_k a_mk t_k <= 1 for all m: t_k = sqrt(c_k / sum_m lambda_m a_mk) with the
/// multipliers from the multiplicative ascent lambda_m <- lambda_m (sum_k a_mk t_k), which raises the dual at each
/// step.
std::vector<double> least_cost(const std::vector<double>& c, const std::vector<std::vector<double>>& a) {
  std::vector<double> lambda(a.size(), 1.0), t(c.size());
  for (int k = 0; k < 20'000; ++k) {
    double largest = 0;
    for (std::size_t j = 0; j < c.size(); ++j) {
      double weight = 0;
      for (std::size_t m = 0; m < a.size(); ++m) weight += lambda[m] * a[m][j];
      t[j] = std::sqrt(c[j] / std::max(weight, 1e-300));
    }
    double change = 0;
    for (std::size_t m = 0; m < a.size(); ++m) {
      double used = 0;
      for (std::size_t j = 0; j < c.size(); ++j) used += a[m][j] * t[j];
      largest = std::max(largest, used);
      change = std::max(change, std::abs(lambda[m] * (used - 1)) / (1e-12 + lambda[m]) * (lambda[m] > 1e-9 ? 1 : 0));
      lambda[m] *= used;
    }
    if (change < 1e-7 && largest < 1 + 1e-7) break;
  }
  return t;
}

}  // namespace

Result<ToleranceDesign> design_tolerances(const AnyMachine& machine, const Survey& survey, const SurveyOptions& options,
                                          const std::vector<ToleranceGroup>& groups, const DesignOptions& design) {
  if (!(design.position > 0) || !(design.orientation > 0) ||
      (std::isinf(design.position) && std::isinf(design.orientation))) {
    return fail("QU120", "the required errors must be above 0, and one of them finite");
  }
  if (groups.empty()) return fail("QU120", "there is no tolerance to choose");
  const std::vector<Element> all = elements(machine);
  std::vector<std::vector<Sized>> members;
  std::set<int> taken;
  std::vector<double> t, cost;
  for (const ToleranceGroup& g : groups) {
    if (!(g.weight > 0) || !std::isfinite(g.weight)) {
      return fail("QU120", fmt::format("{}: the weight {:g} must be above 0", g.key, g.weight));
    }
    POLYPOD_ASSIGN(unit_sizes, sized(machine, {{g.key, 0.0}}, true));
    for (Sized& s : unit_sizes) {
      s.size = units::from_user(1, all[static_cast<std::size_t>(s.element)].unit);  // 1 mm, 1 deg or 1
      if (!taken.insert(s.element).second) {
        return fail("QU121", fmt::format("{} is named by two groups", all[static_cast<std::size_t>(s.element)].key));
      }
    }
    t.push_back(design.rule == DesignRule::weighted ? g.weight : 1.0);
    cost.push_back(g.weight * static_cast<double>(unit_sizes.size()));
    members.push_back(std::move(unit_sizes));
  }
  const Designer designer(machine, survey, options, design, members);
  ToleranceDesign out;
  POLYPOD_ASSIGN(found, designer.worst(t));
  if (!(found.ratio > 0)) return fail("QU122", "the error does not depend on these elements");
  const auto scale = [&] {
    for (double& x : t) x /= found.ratio;
  };
  scale();
  out.rounds = 1;
  if (design.rule == DesignRule::cost && t.size() > 1) {
    std::vector<std::vector<double>> limits;
    for (; out.rounds < 40; ++out.rounds) {
      std::vector<double> at_limit = t;  // shares of `found` were worked out before the scaling
      for (double& x : at_limit) x *= found.ratio;
      limits.push_back(designer.limit(found, at_limit));
      for (double& a : limits.back()) a = std::max(a, 1e-9);  // no group is free of all cost
      t = least_cost(cost, limits);
      POLYPOD_ASSIGN(next, designer.worst(t));
      found = std::move(next);
      const bool done = found.ratio < 1 + 1e-3;
      scale();
      if (done) break;
    }
  }
  POLYPOD_ASSIGN(last, designer.worst(t));
  found = std::move(last);
  out.worst = found.X_MT;
  out.position = found.worst.position;
  out.orientation = found.worst.orientation;
  for (std::size_t k = 0; k < groups.size(); ++k) {
    ToleranceDesign::Part part{groups[k].key, t[k], {}, static_cast<int>(members[k].size()), 0};
    for (const Sized& s : members[k]) {
      const std::string& unit = all[static_cast<std::size_t>(s.element)].unit;
      if (std::find(part.units.begin(), part.units.end(), unit) == part.units.end()) part.units.push_back(unit);
    }
    for (const WorstCase::Share& share : found.worst.shares)
      for (const Sized& s : members[k])
        if (s.element == share.element)
          part.share += found.by_position ? share.position / out.position : share.orientation / out.orientation;
    out.cost += cost[k] / t[k];
    out.parts.push_back(std::move(part));
  }
  return out;
}

}  // namespace polypod::quality
