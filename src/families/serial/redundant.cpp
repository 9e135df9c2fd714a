// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "redundant.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "six_joints.hpp"

namespace polypod::machine {
namespace {

constexpr int kGrid = 64;         // pieces of the range of u
constexpr double kMisses = 1e3;   // costs of joints beyond their limits begin here ...
constexpr double kNowhere = 1e6;  // ... and that of no solution is this
constexpr double kNoLimit = 1e9;  // rad or m: a range as wide as this has no middle

/// The places of the grid whose costs are no worse than their neighbours', the best first, up to five.
std::vector<int> lowest_of(const std::array<double, kGrid + 1>& costs) {
  constexpr std::size_t kMost = 5;
  std::vector<int> out;
  const auto at = [&](int k) { return costs[static_cast<std::size_t>(k)]; };
  for (int k = 0; k <= kGrid; ++k) {
    if (at(k) < kNowhere && (k == 0 || at(k - 1) >= at(k)) && (k == kGrid || at(k + 1) >= at(k))) out.push_back(k);
  }
  std::stable_sort(out.begin(), out.end(), [&](int i, int k) { return at(i) < at(k); });
  if (out.size() > kMost) out.resize(kMost);
  return out;
}

/// Whether a cost beyond the limits may fall within them between the neighbours: that of a convex function by no more
/// than the steepest step beside it. Joints that hurry near a singular pose bend it the other way: of 15 000 poses
/// within the limits 6 times the step missed one, 20 times none.
bool may_end_within(const std::array<double, kGrid + 1>& costs, int k) {
  const double here = costs[static_cast<std::size_t>(k)];
  constexpr double kSteps = 20;
  if (here < kMisses) return true;
  double step = 0;
  for (const int side : {k - 1, k + 1}) {
    if (side < 0 || side > kGrid) continue;
    const double there = costs[static_cast<std::size_t>(side)];
    if (there >= kNowhere) return true;
    step = std::max(step, there - here);
  }
  return here - kMisses <= kSteps * step;
}

/// So many steps of the golden section (Kiefer 1953) towards a least f between a and b, which remembers what it was
/// asked; one value of f each, none behind `done()`.
template <class F, class Done>
void descend(const F& f, double a, double b, int sections, const Done& done) {
  constexpr double kGolden = 0.6180339887498949;
  double c = b - kGolden * (b - a), d = a + kGolden * (b - a);
  double at_c = f(c), at_d = f(d);
  for (int i = 0; i < sections && !done(); ++i) {
    if (at_c < at_d) {
      b = d;
      d = c;
      at_d = at_c;
      c = b - kGolden * (b - a);
      at_c = f(c);
    } else {
      a = c;
      c = d;
      at_c = at_d;
      d = a + kGolden * (b - a);
      at_d = f(d);
    }
  }
}

}  // namespace

std::optional<RedundantInverse> RedundantInverse::of(const SerialArm& arm) {
  RedundantInverse out;
  out.inner_ = arm;
  for (const DhRow& row : arm.dh) {
    if (!row.locked) out.range_.push_back(row.range);
    if (row.kind == JointKind::revolute) out.length_ += std::abs(row.a) + std::abs(row.d);
  }
  out.length_ = std::max(0.5 * out.length_, 1e-3);
  const int more = arm.free_joints() - arm.task.size();
  if (more != 1 || arm.free_joints() < 6) return std::nullopt;
  if (arm.task == Task::axis && arm.free_joints() == 6) {
    out.inner_.task = Task::pose;
    out.closed_ = ClosedInverse::of(out.inner_);
    out.low_ = -std::numbers::pi;
    out.high_ = std::numbers::pi;
    if (out.closed_.exists()) return out;
    out.inner_.task = arm.task;
  }
  if (arm.free_joints() > 7) return std::nullopt;
  const auto first = std::find_if(arm.dh.begin(), arm.dh.end(), [](const DhRow& r) { return !r.locked; });
  const JointRange range = first->range;
  if (!(range.max - range.min < kNoLimit)) return std::nullopt;
  out.carried_ = CarriedArm::of(arm, static_cast<std::size_t>(first - arm.dh.begin()));
  if (!out.carried_) return std::nullopt;
  out.inner_ = out.carried_->arm();
  out.closed_ = ClosedInverse::of(out.inner_);
  if (!out.closed_.exists()) return std::nullopt;
  out.low_ = range.min;
  out.high_ = range.max;
  return out;
}

Pose RedundantInverse::target(const Pose& X_MT, double u) const {
  return carried_ ? carried_->seen(X_MT, u) : Pose{X_MT.R * rotation_z(u), X_MT.p};
}

double RedundantInverse::at_grid(int k) const {
  return low_ + (high_ - low_) * k / kGrid;
}

std::pair<double, double> RedundantInverse::beside(int k, int pieces) const {
  const double a = at_grid(k - pieces), b = at_grid(k + pieces);
  return carried_ ? std::pair(std::max(a, low_), std::min(b, high_)) : std::pair(a, b);  // a turn goes round
}

double RedundantInverse::near_singular(const kinematics::JointVector& q) const {
  constexpr double kNear = 0.02;  // of |det S|, which is some hundredths to tenths far from singular poses
  const kinematics::JointVector behind = carried_ ? q.tail(q.size() - 1) : q;
  const JacobianMatrix J = forward_jacobian(inner_, behind).J;
  double determinant = 0;
  if (behind.size() == 6) {
    Eigen::Matrix<double, 6, 6> S = J;
    S.topRows<3>() /= length_;
    determinant = std::abs(S.determinant());
  } else {  // of the tip and the directions of the tool axis
    const Vec3 k = forward(inner_, behind).R.col(2);
    Eigen::Matrix<double, 5, 5> S;
    Vec3 across = k.unitOrthogonal();
    S.topRows<3>() = J.topRows<3>() / length_;
    S.row(3) = across.transpose() * J.bottomRows<3>();
    S.row(4) = k.cross(across).transpose() * J.bottomRows<3>();
    determinant = std::abs(S.determinant());
  }
  return square(kNear / (determinant + kNear));
}

void RedundantInverse::take(unsigned branch, double u, const double* q, bool singular, const Ask& ask, All& out) const {
  if (ask.branch && *ask.branch != branch) return;
  One& one = out[branch];
  one.exists = true;
  one.singular = singular;
  one.violations = 0;
  const int n = static_cast<int>(range_.size());
  one.joints.resize(n);
  if (carried_) one.joints[0] = u;
  for (int i = carried_ ? 1 : 0; i < n; ++i) one.joints[i] = *q++;
  double from_middle = 0, beyond = 0;
  for (int i = 0; i < n; ++i) {
    const JointRange& range = range_[static_cast<std::size_t>(i)];
    const double width = range.max - range.min, at = one.joints[i];
    const bool low = (at < range.min - six::kLimitSlack), high = (at > range.max + six::kLimitSlack);
    one.violations |= kinematics::LimitBits{low} << (2 * i) | kinematics::LimitBits{high} << (2 * i + 1);
    if (width > 0 && width < kNoLimit) from_middle += square((at - 0.5 * (range.min + range.max)) / width);
    const double scale = width > 0 && width < kNoLimit ? width : 1.0;
    if (low && (ask.heeded >> (2 * i) & 1) != 0) beyond += (range.min - at) / scale;
    if (high && (ask.heeded >> (2 * i + 1) & 1) != 0) beyond += (at - range.max) / scale;
  }
  one.cost = beyond > 0 ? kMisses + beyond : ask.any ? 0 : from_middle + near_singular(one.joints);
}

void RedundantInverse::look(const Pose& X_MT, double u, const Ask& ask, All& out) const {
  const Pose X = target(X_MT, u);
  for (One& one : out) {
    one.exists = false;
    one.cost = kNowhere;
  }
  if (closed_.six) {
    SixJointBranches found;
    std::visit([&](const auto& form) { form.solve(X, found); }, *closed_.six);
    for (unsigned b = 0; b < kBranches; ++b)
      if (found.exists[b]) take(b, u, found.joints[b], found.singular[b], ask, out);
  } else if (closed_.five) {
    WristInverse::Branches found;
    closed_.five->solve(X.p, X.R.col(2), found);
    for (unsigned b = 0; b < kBranches; ++b)
      if (found.exists[b]) take(b, u, found.joints[b].data(), found.singular[b], ask, out);
  } else {
    for (const kinematics::Solution& s : closed_.solve(X).solutions)
      take(s.branch, u, s.joints.data(), s.singular, ask, out);
  }
}

RedundantInverse::One RedundantInverse::refined(const Pose& X_MT, const Ask& ask, int k) const {
  constexpr int kSections = 36;
  const auto [a, b] = beside(k, 1);
  All all;
  One best;
  best.cost = kNowhere;
  const auto cost = [&](double u) {
    look(X_MT, u, ask, all);
    if (all[*ask.branch].cost < best.cost) best = all[*ask.branch];
    return all[*ask.branch].cost;
  };
  cost(std::clamp(at_grid(k), a, b));
  descend(cost, a, b, kSections, [&] { return ask.any && best.cost < kMisses; });
  return best;
}

kinematics::InverseResult RedundantInverse::solve(const Pose& X_MT) const {
  constexpr kinematics::LimitBits kAll = ~kinematics::LimitBits{0};
  std::array<std::array<double, kGrid + 1>, kBranches> costs;
  All all;
  for (int k = 0; k <= kGrid; ++k) {
    look(X_MT, at_grid(k), {kAll, {}, false}, all);
    for (std::size_t b = 0; b < kBranches; ++b) costs[b][static_cast<std::size_t>(k)] = all[b].cost;
  }
  std::vector<std::pair<double, kinematics::Solution>> found;
  for (unsigned b = 0; b < kBranches; ++b) {
    One best;
    best.cost = kNowhere;
    for (const int k : lowest_of(costs[b])) {
      if (best.cost < kNowhere && !may_end_within(costs[b], k)) continue;
      One one = refined(X_MT, {kAll, b, false}, k);
      if (one.cost < best.cost) best = std::move(one);
      if (best.cost < kMisses) break;
    }
    if (best.cost >= kNowhere) continue;
    found.emplace_back(best.cost, kinematics::Solution{best.joints, b, best.violations, best.singular});
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& x, const auto& y) { return x.first < y.first; });
  kinematics::InverseResult out;
  for (auto& [cost, solution] : found) out.solutions.push_back(std::move(solution));
  if (out.solutions.empty()) out.reason = "the arm does not reach it, wherever the joint that is free stands";
  return out;
}

bool RedundantInverse::reaches(const Pose& X_MT, kinematics::LimitBits heeded) const {
  std::array<std::array<double, kGrid + 1>, kBranches> costs;
  All all;
  for (int i = 0; i <= kGrid; ++i) {  // from the middle to either side
    const int k = kGrid / 2 + (i % 2 == 0 ? 1 : -1) * ((i + 1) / 2);
    look(X_MT, at_grid(k), {heeded, {}, true}, all);
    for (std::size_t b = 0; b < kBranches; ++b) {
      costs[b][static_cast<std::size_t>(k)] = all[b].cost;
      if (all[b].cost < kMisses) return true;
    }
  }
  for (unsigned b = 0; b < kBranches; ++b) {
    for (const int k : lowest_of(costs[b]))
      if (may_end_within(costs[b], k) && refined(X_MT, {heeded, b, true}, k).cost < kMisses) return true;
  }
  return false;
}

double RedundantInverse::room_at(const Pose& X_MT, double u, std::span<const double> scales, Roomiest& best) const {
  const Pose X = target(X_MT, u);
  const std::size_t n = range_.size(), first = carried_ ? 1 : 0;
  double most = -std::numeric_limits<double>::infinity();
  const auto room_of = [&](const double* behind) {
    double least = kNoLimit;
    for (std::size_t i = 0; i < n; ++i) {
      const double at = i < first ? u : behind[i - first];
      if (const double low = scales[2 * i]; low > 0) least = std::min(least, low * (at - range_[i].min));
      if (const double high = scales[2 * i + 1]; high > 0) least = std::min(least, high * (range_[i].max - at));
    }
    return least;
  };
  const auto offer = [&](const double* behind) {
    const double room = room_of(behind);
    most = std::max(most, room);
    if (room <= best.room) return;
    best.room = room;
    best.joints.resize(static_cast<Eigen::Index>(n));
    if (carried_) best.joints[0] = u;
    std::copy(behind, behind + (n - first), best.joints.data() + first);
  };
  if (closed_.six) {
    SixJointBranches found;
    std::visit([&](const auto& form) { form.solve(X, found); }, *closed_.six);
    for (unsigned b = 0; b < kBranches; ++b)
      if (found.exists[b]) offer(found.joints[b]);
  } else {
    for (const kinematics::Solution& s : closed_.solve(X).solutions) offer(s.joints.data());
  }
  return most;
}

std::optional<kinematics::JointVector> RedundantInverse::roomiest(const Pose& X_MT,
                                                                  std::span<const double> scales) const {
  Roomiest best;
  const auto room = [&](double u) { return room_at(X_MT, u, scales, best); };
  const auto climb = [&](int k, int pieces, int sections) {
    const auto [a, b] = beside(k, pieces);
    descend([&](double u) { return -room(u); }, a, b, sections, [] { return false; });
  };
  std::array<double, kGrid + 1> rooms;
  constexpr int kCoarse = 4;
  int at = 0;
  for (int k = 0; k <= kGrid; k += kCoarse) {
    rooms[static_cast<std::size_t>(k)] = room(at_grid(k));
    if (rooms[static_cast<std::size_t>(k)] > rooms[static_cast<std::size_t>(at)]) at = k;
  }
  if (best.room > -kNowhere) climb(at, kCoarse, 6);
  if (best.room >= 0) return best.joints;
  for (int k = 0; k <= kGrid; ++k)
    if (k % kCoarse != 0) rooms[static_cast<std::size_t>(k)] = room(at_grid(k));
  for (double& r : rooms) r = r > -kNowhere ? -r : kNowhere;  // as costs
  const std::vector<int> tops = lowest_of(rooms);
  for (std::size_t i = 0; i < std::min<std::size_t>(2, tops.size()); ++i) climb(tops[i], 1, 20);
  if (!(best.room > -kNowhere)) return {};
  return best.joints;
}

std::optional<unsigned> RedundantInverse::branch_of(const Pose& X_MT, const kinematics::JointVector& q) const {
  double u = 0;
  if (carried_) {
    u = q[0];
  } else {  // the turn of the tool that these joints make
    const Mat3 R = X_MT.R.transpose() * forward(inner_, q).R;
    u = std::atan2(R(1, 0), R(0, 0));
  }
  const kinematics::InverseResult inverse = closed_.solve(target(X_MT, u), q.data() + (carried_ ? 1 : 0));
  std::optional<unsigned> out;
  double nearest = 1e-3;  // rad or m: what a search leaves
  for (const kinematics::Solution& s : inverse.solutions) {
    double away = 0;
    for (Eigen::Index i = 0; i < s.joints.size(); ++i) {
      const double change = s.joints[i] - q[i + (carried_ ? 1 : 0)];
      away = std::max(away, std::min(std::abs(change), std::abs(std::remainder(change, 2 * std::numbers::pi))));
    }
    if (away >= nearest) continue;
    nearest = away;
    out = s.branch;
  }
  return out;
}

}  // namespace polypod::machine
