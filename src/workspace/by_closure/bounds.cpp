// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "bounds.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "branches.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "system.hpp"

namespace polypod::workspace {
namespace by_closure {

class Judge {
 public:
  Judge(std::shared_ptr<const Questions> questions, const Options& options)
      : system_(std::move(questions), options), tree_(system_) {}

  /// False where nothing is proven.
  bool begin() { return system_.begin(); }
  [[nodiscard]] const System& system() const { return system_; }
  Verdict judge(const Place& at, BoundList& out) const;

 private:
  /// Of each limit the forms of all branches that are left.
  using Possible = std::vector<std::vector<Form>>;

  /// Adds what the limits are on the branches; false where they hold nothing that is reached. `forms` and `exists`: of
  /// the core and of each leaf the branch that is certain and best.
  bool judge_branches(const Place& at, const Branches& from, Possible& possible, std::vector<Form>& forms,
                      bool& exists) const;
  /// The branch next to a seed over the place; false where it is not certain everywhere.
  bool judge_seed(const Place& at, const Column& seed, std::vector<Form>& forms) const;
  [[nodiscard]] Verdict weighed(const Place& at, const Possible& possible,
                                const std::optional<std::vector<Form>>& chosen, double least, BoundList& out) const;

  System system_;
  BranchTree tree_;
};

Verdict Judge::judge(const Place& at, BoundList& out) const {
  const Node& node = tree_.node_over(at);
  Possible possible(system_.limit_count());
  std::optional<std::vector<Form>> chosen;
  double least = -kInfinity;
  bool any = false;
  for (const Branches& branches : node.branches) {
    std::vector<Form> forms;
    bool exists = false;
    if (!judge_branches(at, branches, possible, forms, exists)) continue;
    any = true;
    if (!exists) continue;
    const double value = system_.least_of(forms, at);
    if (chosen && value <= least) continue;
    chosen = std::move(forms);
    least = value;
  }
  if (!any) return Verdict::dead;
  if (!chosen || least == -kInfinity) {
    for (const Column& seed : node.seeds) {
      std::vector<Form> forms;
      if (!judge_seed(at, seed, forms)) continue;
      const double value = system_.least_of(forms, at);
      if (chosen && value <= least) continue;
      chosen = std::move(forms);
      least = value;
    }
  }
  return weighed(at, possible, chosen, least, out);
}

bool Judge::judge_branches(const Place& at, const Branches& from, Possible& possible, std::vector<Form>& forms,
                           bool& exists) const {
  const std::size_t leaves = system_.leaves().size();
  std::vector<bool> alive(leaves, false), certain(leaves, false);
  std::vector<double> best(leaves, -kInfinity);
  Possible added(system_.limit_count());
  Look first, second;
  std::vector<Form> here;
  bool core_exists = false;
  for (std::size_t round = 0; round < from.rounds(); ++round) {
    const Piece piece = tree_.select(from, round);
    system_.look(at, piece, first, nullptr);
    if (first.none) return false;
    Piece tube = first.narrowed;
    const bool core_follows = first.regular;
    bool wide = !core_follows;
    for (std::size_t l = 0; l < leaves; ++l) wide = wide || (!first.leaf_none[l] && !first.leaf_regular[l]);
    if (wide) {  // once more on what is left
      Look again;
      std::vector<bool> gone = first.leaf_none;
      for (std::size_t l = 0; l < leaves; ++l) {
        if (!gone[l]) continue;
        const int j = system_.leaves()[l].first;
        tube.radius[j] = piece.radius[j];
        tube.middle[j] = piece.middle[j];
      }
      system_.look(at, tube, again, nullptr);
      if (again.none) return false;
      for (std::size_t l = 0; l < leaves; ++l) {
        again.leaf_none[l] = again.leaf_none[l] || gone[l];
        again.leaf_exists[l] = again.leaf_exists[l] || first.leaf_exists[l];
      }
      again.exists = again.exists || first.exists;
      std::swap(first, again);
      tube = first.narrowed;
    }
    core_exists = core_exists || first.exists;
    if (first.regular) {
      for (const int j : system_.core()) {
        tube.middle[j] = first.follows.middle[j];
        tube.slope.row(j) = first.follows.slope.row(j);
        tube.radius[j] = 1.2 * first.follows.radius[j];
      }
    }
    for (std::size_t l = 0; l < leaves; ++l) {
      const int j = system_.leaves()[l].first;
      if (first.leaf_none[l]) {  // whatever: it is not looked at
        tube.middle[j] = piece.middle[j];
        tube.radius[j] = 0;
      } else if (first.leaf_regular[l]) {
        tube.middle[j] = first.follows.middle[j];
        tube.slope.row(j) = first.follows.slope.row(j);
        tube.radius[j] = 1.2 * first.follows.radius[j];
      }
    }
    system_.look(at, tube, second, &here);
    if (second.none) return false;
    core_exists = core_exists || second.exists;
    if (tree_.broken_by(-1, here, at)) return false;
    if (round == 0) {
      forms = here;
      for (std::size_t i = 0; i < system_.limit_count(); ++i) {
        if (system_.owner()[i] < 0) added[i].push_back(here[i]);
      }
    }
    for (std::size_t l = 0; l < leaves; ++l) {
      if (round >= from.leaves[l].size() || first.leaf_none[l] || second.leaf_none[l]) continue;
      const int owner = static_cast<int>(l);
      if (tree_.broken_by(owner, here, at)) continue;
      alive[l] = true;
      double least = kInfinity;
      for (std::size_t i = 0; i < system_.limit_count(); ++i) {
        if (system_.owner()[i] != owner) continue;
        added[i].push_back(here[i]);
        if (system_.heeds(i)) least = std::min(least, lowest(here[i], at));
      }
      if (!(first.leaf_exists[l] || second.leaf_exists[l]) || (certain[l] && least <= best[l])) continue;
      certain[l] = true;
      best[l] = least;
      for (std::size_t i = 0; i < system_.limit_count(); ++i) {
        if (system_.owner()[i] == owner) forms[i] = here[i];
      }
    }
  }
  if (std::find(alive.begin(), alive.end(), false) != alive.end()) return false;
  for (std::size_t i = 0; i < system_.limit_count(); ++i) {
    possible[i].insert(possible[i].end(), added[i].begin(), added[i].end());
  }
  exists = core_exists && std::find(certain.begin(), certain.end(), false) == certain.end();
  return true;
}

bool Judge::judge_seed(const Place& at, const Column& seed, std::vector<Form>& forms) const {
  Column u = seed;
  Look point;
  if (!system_.solve(at, u, point)) return false;
  Piece tube{u, Column::Zero(system_.unknowns()), -(point.Y * point.A)};
  Look line;
  system_.look(at, tube, line, nullptr);
  // By all equations at once: |Y| (what they are off along the line).
  const Column off = line.c.cwiseAbs() + line.rest;
  if (!off.allFinite()) return false;
  tube.radius = 1.5 * (point.Y.cwiseAbs() * off) + Column::Constant(system_.unknowns(), 1e-13);
  for (int attempt = 0; attempt < 3; ++attempt) {
    Look around;
    system_.look(at, tube, around, &forms);
    if (around.none) return false;
    if (around.exists &&
        std::find(around.leaf_exists.begin(), around.leaf_exists.end(), false) == around.leaf_exists.end()) {
      return true;
    }
    tube.radius *= 2;
  }
  return false;
}

Verdict Judge::weighed(const Place& at, const Possible& possible, const std::optional<std::vector<Form>>& chosen,
                       double least, BoundList& out) const {
  constexpr double kNothing = -1e300;
  if (chosen && least >= 0) return Verdict::inside;
  for (std::size_t i = 0; i < system_.limit_count(); ++i) {
    if (!system_.heeds(i)) continue;
    const Form& f = chosen ? (*chosen)[i] : possible[i].front();
    if (chosen && lowest(f, at) >= 0) continue;
    // At the direction that is worst for that form.
    double M = -kInfinity;
    for (const Form& other : possible[i]) {
      Form apart = other;
      for (std::size_t k = 0; k < kPrescribed; ++k) apart.slope[k] -= f.slope[k];
      const double turned = at.patch->sector ? at.patch->turn * std::hypot(apart.slope[3], apart.slope[4])
                                             : std::abs(apart.slope[3]) * std::abs(at.patch->corner[3][0]) +
                                                   std::abs(apart.slope[4]) * std::abs(at.patch->corner[3][1]);
      M = std::max(M, other.value + other.rest + by_position(apart, at) + turned);
    }
    const double worst = at.patch->least(f.slope[3], f.slope[4]);
    Bound b;
    b.limit = static_cast<int>(i);
    b.M = std::isfinite(M) ? M + worst : kInfinity;
    b.G = Vec3(f.slope[0], f.slope[1], f.slope[2]);
    b.m = chosen ? f.value + worst - f.rest : kNothing;
    if (!std::isfinite(b.m)) b.m = kNothing;
    if (b.M + by_position(f, at) < 0) {
      out.clear();
      return Verdict::outside;
    }
    if (!chosen && !(b.M - by_position(f, at) < 0)) continue;
    if (!out.push_back(b)) {
      out.clear();
      return Verdict::open;
    }
  }
  return out.empty() ? Verdict::open : Verdict::undecided;
}

}  // namespace by_closure

Result<std::optional<ClosureLimits>> ClosureLimits::of(std::shared_ptr<const by_closure::Questions> questions,
                                                       const Options& options) {
  POLYPOD_TRY(held_by(questions->prescribes, questions->name, options.directions));
  auto judge = std::make_shared<by_closure::Judge>(std::move(questions), options);
  if (!judge->begin()) return std::optional<ClosureLimits>{};
  return std::optional(ClosureLimits(std::move(judge)));
}

double ClosureLimits::lever() const {
  return judge_->system().lever();
}
void ClosureLimits::box(Vec3& low, Vec3& high, const Directions&) const {
  low = judge_->system().low();
  high = judge_->system().high();
}
Verdict ClosureLimits::judge(int, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data&,
                             BoundList& out) const {
  return judge_->judge({center, half, &patch}, out);
}

template Result<Volume> subdivided_volume(const ClosureLimits&, const Options&, bool);
template Result<bool> subdivided_holds(const ClosureLimits&, const Options&, const Shape&, std::int64_t);

}  // namespace polypod::workspace
