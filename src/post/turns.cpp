// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "turns.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/families/serial/kinematics.hpp"
#include "polypod/families/serial/six_joint_inverse.hpp"
#include "polypod/post/ladder.hpp"

namespace polypod::post {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kPole = 1e-9;  // of a unit vector across the axis about which the tool turns: none

double near(double angle, double last) {
  return angle + kTurn * std::round((last - angle) / kTurn);
}

constexpr int kChoices = 72;                  // values of C
constexpr double kChoice = kTurn / kChoices;  // 5 deg
constexpr int kFarthest = 6;                  // by which C changes in a step, in values
constexpr double kNone = std::numeric_limits<double>::infinity();
// What a state costs: a joint this share of its range from a limit, and a pose this near to a singular one, cost their
// weight; so does the compliance across the path where it is as large as the least at the first point.
constexpr double kNearLimit = 0.05, kLimitWeight = 0.02;
constexpr double kNearSingular = 0.02, kSingularWeight = 0.05;
constexpr double kComplianceWeight = 0.02;
// What a step costs besides the squares of the joints' changes: a joint at its speed limit, and a joint that moves by
// more than `kJump` rad in a cut.
constexpr double kSpeedWeight = 0.1, kJump = 1.0, kJumpCost = 100, kRungWeight = 1e-4;
constexpr double kStartWeight = 0.5;

/// A row of poses with their joints on every rung, for the two points that a step joins.
struct Rung {
  bool exists = false;
  std::array<double, 6> q{};
};

/// One point of the path as the ladder sees it.
struct LadderPoint {
  Vec3 p = Vec3::Zero();       // in M
  Vec3 axis = Vec3::UnitZ();   // of the tool
  Vec3 across = Vec3::Zero();  // of the path and the tool; 0: none
  std::optional<Vec3> angles;  // given by the source
  double seconds = 0;          // of the step that leads there; 0: not judged, as in rapids
  bool rapid = false;
};

/// The states of one arm along a path, in one posture.
class Turns {
 public:
  Turns(const machine::SerialArm& arm, const std::vector<LadderPoint>& points, const PlanOptions& options,
        unsigned branch, double first_c, int rungs)
      : arm_(arm),
        inverse_(*machine::six_joint_inverse(arm)),
        points_(points),
        options_(options),
        branch_(static_cast<int>(branch)),
        first_c_(first_c),
        rungs_(rungs),
        row_(static_cast<std::size_t>(rungs)),
        next_(static_cast<std::size_t>(rungs)) {
    for (int i = 0; i < 6; ++i) {
      ranges_[static_cast<std::size_t>(i)] = machine::joint_range(arm, i);
      whole_turns_[static_cast<std::size_t>(i)] = machine::joint_kind(arm, i) == machine::JointKind::revolute;
    }
    std::size_t k = 0;
    for (const machine::DhRow& row : arm.dh) {
      if (!row.locked && k < 6) compliance_[k++] = row.compliance;
      length_ += std::abs(row.a) + std::abs(row.d);
    }
    length_ = std::max(length_, 1e-3);
    weighs_compliance_ = std::any_of(compliance_.begin(), compliance_.end(), [](double c) { return c > 0; });
  }

  [[nodiscard]] double value(int rung) const { return first_c_ + kTurn / rungs_ * (rung - rungs_ / 2); }

  double state(std::size_t n, int j) {
    if (j == 0) {
      std::swap(row_, next_);
      at_ = n;
    }
    const LadderPoint& point = points_[n];
    Rung& rung = next_[static_cast<std::size_t>(j)];
    rung.exists = false;
    const double c = point.angles ? point.angles->z() : value(j);
    const Vec3 angles = point.angles ? *point.angles : both_turns(Rotary::abc, point.axis, c, Vec3::Zero())[0];
    const Pose X{R_MW_ * rotation_abc(angles.x(), angles.y(), angles.z()) * R_MW_.transpose(), point.p};
    machine::SixJointBranches out;
    std::visit([&](const auto& inverse) { inverse.solve(X, out); }, inverse_);
    if (!out.exists[branch_] || out.singular[branch_]) return kNone;
    const double* q = out.joints[branch_];
    for (std::size_t i = 0; i < 6; ++i) {
      if (q[i] < ranges_[i].min - 1e-10 || q[i] > ranges_[i].max + 1e-10) return kNone;
      rung.q[i] = q[i];
    }
    rung.exists = true;
    double cost = cost_of_limits(rung) + cost_of_pose(rung, point);
    if (n == 0) cost += cost_of_start(rung) + 1e-6 * (j - rungs_ / 2) * (j - rungs_ / 2);
    return cost;
  }

  double step(std::size_t n, int i, int j) const {
    const Rung &a = row_[static_cast<std::size_t>(i)], &b = next_[static_cast<std::size_t>(j)];
    const LadderPoint& point = points_[n];
    const int way = std::abs(i - j), d = std::min(way, rungs_ - way);
    double cost = kRungWeight * d;
    for (std::size_t k = 0; k < 6; ++k) {
      const double change = change_of(k, a.q[k], b.q[k]);
      if (!std::isfinite(change)) return kNone;
      cost += change * change;
      if (std::abs(change) > kJump && !point.rapid) cost += kJumpCost;
      if (options_.joint_speeds.empty() || !(point.seconds > 0)) continue;
      const double share = std::abs(change) / (point.seconds * options_.joint_speeds[k]);
      if (share > 1) return kNone;
      cost += kSpeedWeight * share * share;
    }
    return cost;
  }

  /// Joints that may turn more than once go on in the turn of the way that leads there.
  void chosen(std::size_t, int j, int i) {
    Rung& b = next_[static_cast<std::size_t>(j)];
    const Rung& a = row_[static_cast<std::size_t>(i)];
    for (std::size_t k = 0; k < 6; ++k) b.q[k] = a.q[k] + change_of(k, a.q[k], b.q[k]);
  }

 private:
  /// By how much joint k moves; by whole turns less where its range has them. Not finite: beyond its range.
  [[nodiscard]] double change_of(std::size_t k, double from, double to) const {
    double change = to - from;
    const double span = ranges_[k].max - ranges_[k].min;
    if (!whole_turns_[k] || span <= kTurn || std::abs(change) <= std::numbers::pi) return change;
    change -= kTurn * std::round(change / kTurn);
    const double arrives = from + change;
    return arrives < ranges_[k].min - 1e-10 || arrives > ranges_[k].max + 1e-10 ? kNone : change;
  }

  [[nodiscard]] double cost_of_limits(const Rung& rung) const {
    double cost = 0;
    for (std::size_t i = 0; i < 6; ++i) {
      const machine::JointRange& r = ranges_[i];
      const double share = std::min(rung.q[i] - r.min, r.max - rung.q[i]) / (r.max - r.min);
      const double near = kNearLimit / (std::max(share, 0.0) + kNearLimit);
      cost += kLimitWeight * near * near;
    }
    return cost;
  }

  /// How near to a singular pose, and how soft across the path: both from the Jacobian.
  double cost_of_pose(const Rung& rung, const LadderPoint& point) {
    machine::JointVector q(6);
    for (int i = 0; i < 6; ++i) q[i] = rung.q[static_cast<std::size_t>(i)];
    const machine::JacobianMatrix J = machine::forward_jacobian(arm_, q).J;
    Eigen::Matrix<double, 6, 6> S = J.leftCols<6>();
    S.topRows<3>() /= length_;
    const double near = kNearSingular / (std::abs(S.determinant()) * kDeterminantScale + kNearSingular);
    double cost = kSingularWeight * near * near;
    if (!weighs_compliance_ || point.across.isZero(0)) return cost;
    double compliance = 0;
    for (int i = 0; i < 6; ++i) {
      const double lever = point.across.dot(J.col(i).head<3>());
      compliance += compliance_[static_cast<std::size_t>(i)] * lever * lever;
    }
    if (reference_ == 0) reference_ = compliance;
    return reference_ > 0 ? cost + kComplianceWeight * compliance / reference_ : cost;
  }

  [[nodiscard]] double cost_of_start(const Rung& rung) const {
    if (!options_.start_joints) return 0;
    double cost = 0;
    for (int i = 0; i < 6; ++i) {
      const double off = rung.q[static_cast<std::size_t>(i)] - (*options_.start_joints)[i];
      cost += kStartWeight * off * off;
    }
    return cost;
  }

  // |det S| of an arm in a good pose is some hundredths: links of a third of the sum of lengths each.
  static constexpr double kDeterminantScale = 20;

  const machine::SerialArm& arm_;
  const machine::SixJointInverse inverse_;
  const std::vector<LadderPoint>& points_;
  const PlanOptions& options_;
  const int branch_;
  const double first_c_;
  const int rungs_;
  Mat3 R_MW_ = rotation_z(options_.rotation);
  std::array<machine::JointRange, 6> ranges_{};
  std::array<bool, 6> whole_turns_{};
  std::array<double, 6> compliance_{};
  double length_ = 0, reference_ = 0;
  bool weighs_compliance_ = false;
  std::size_t at_ = 0;
  std::vector<Rung> row_, next_;
};

/// The placed steps of a path as points of a ladder, and which steps they are.
std::vector<LadderPoint> points_of(const Path& path, const PlanOptions& options, std::vector<std::size_t>& moving) {
  const Mat3 R_MW = rotation_z(options.rotation);
  std::vector<LadderPoint> out;
  const Step* before = nullptr;
  for (std::size_t i = 0; i < path.steps.size(); ++i) {
    const Step& step = path.steps[i];
    if (!step.placed()) continue;
    moving.push_back(i);
    LadderPoint point;
    point.p = options.origin + R_MW * step.tip;
    point.axis = step.axis;
    if (step.turned && !path.leaves_c()) point.angles = step.angles;  // a program without C leaves C free
    point.rapid = step.kind == StepKind::rapid;
    if (before != nullptr) {
      Vec3 along = step.tip - before->tip;
      double length = along.norm();
      if (step.kind == StepKind::arc) {
        const Vec3 r = step.tip - step.centre;
        length = std::hypot((r - r.dot(step.normal) * step.normal).norm() * step.sweep, along.dot(step.normal));
        along = step.normal.cross(r);
      }
      const Vec3 across = R_MW * step.axis.cross(along);
      if (across.norm() > kPole) point.across = across.normalized();
      if (!point.rapid && step.feed > 0) point.seconds = length / step.feed;
    }
    before = &step;
    out.push_back(point);
  }
  return out;
}

}  // namespace

std::array<Vec3, 2> both_turns(Rotary rotary, const Vec3& k, double c, const Vec3& last) {
  constexpr double pi = std::numbers::pi;
  const auto nearest = [&](double a, double b, double w) {
    return Vec3(near(a, last.x()), near(b, last.y()), near(w, last.z()));
  };
  if (rotary == Rotary::none) return {Vec3::Zero(), Vec3::Zero()};
  if (rotary == Rotary::ac) {
    const double across = std::hypot(k.x(), k.y()), a = std::atan2(across, k.z());
    if (across < kPole) return {nearest(a, 0, last.z()), nearest(-a, 0, last.z())};
    const double w = std::atan2(k.x(), -k.y());
    return {nearest(a, 0, w), nearest(-a, 0, w + pi)};
  }
  const Vec3 turned = rotary == Rotary::abc ? Vec3(rotation_z(-c) * k) : k;
  const double across = std::hypot(turned.x(), turned.z()), a = std::atan2(-turned.y(), across);
  const double w = rotary == Rotary::abc ? c : 0;
  std::array<Vec3, 2> out;
  if (across < kPole) {
    out = {nearest(a, last.y(), 0), nearest(pi - a, last.y(), 0)};
  } else {
    const double b = std::atan2(turned.x(), turned.z());
    out = {nearest(a, b, 0), nearest(pi - a, b + pi, 0)};
  }
  for (Vec3& angles : out) angles.z() = w;
  return out;
}

Vec3 nearest_turn(Rotary rotary, const Vec3& k, double c, const Vec3& last) {
  const std::array<Vec3, 2> both = both_turns(rotary, k, c, last);
  const auto change = [&](const Vec3& a) { return (a - last).cwiseAbs().maxCoeff(); };
  return change(both[1]) < change(both[0]) - 1e-12 ? both[1] : both[0];
}

Vec3 between_axes(const Vec3& k_0, const Vec3& k_1, double s) {
  const Vec3 n = k_0.cross(k_1);
  const double sine = n.norm(), angle = std::atan2(sine, k_0.dot(k_1));
  if (sine < 1e-12) return s < 1 ? k_0 : k_1;
  return Vec3(Eigen::AngleAxisd(s * angle, Vec3(n / sine)) * k_0).normalized();
}

ChosenTurns choose_c(const Configuration& configuration, const Path& path, const PlanOptions& options, unsigned branch,
                     double first_c) {
  ChosenTurns out;
  const auto& arm = std::get<machine::SerialArm>(configuration.machine);
  std::vector<std::size_t> moving;
  const std::vector<LadderPoint> points = points_of(path, options, moving);
  Turns turns(arm, points, options, branch, first_c, kChoices);
  bool stopped = false;
  const auto state = [&](std::size_t n, int j) {
    if (j == 0 && n % 256 == 0 && !options.progress(double(n) / double(points.size()))) stopped = true;
    return stopped ? kNone : turns.state(n, j);
  };
  const LadderWay way = cheapest_way(
      {points.size(), kChoices, kFarthest, true}, state,
      [&](std::size_t n, int i, int j) { return turns.step(n, i, j); },
      [&](std::size_t n, int j, int i) { turns.chosen(n, j, i); });
  out.cost = way.cost;
  if (way.rungs.empty()) {
    out.blocked = points.empty() ? 0 : moving[way.blocked];
    return out;
  }
  std::vector<double> at(points.size());
  for (std::size_t n = 0; n < points.size(); ++n) at[n] = turns.value(way.rungs[n]);
  out.c.assign(path.steps.size(), at.empty() ? first_c : at.front());
  for (std::size_t n = 0; n < moving.size(); ++n) {
    const std::size_t end = n + 1 < moving.size() ? moving[n + 1] : path.steps.size();
    for (std::size_t i = moving[n]; i < end; ++i) out.c[i] = at[n];
  }
  return out;
}

double first_look(const Configuration& configuration, const Path& path, const PlanOptions& options, unsigned branch) {
  const auto& arm = std::get<machine::SerialArm>(configuration.machine);
  std::vector<std::size_t> moving;
  const std::vector<LadderPoint> all = points_of(path, options, moving);
  constexpr std::size_t kLooked = 64;
  std::vector<LadderPoint> points;
  for (std::size_t i = 0; i < std::min(kLooked, all.size()); ++i) {
    points.push_back(all[i * all.size() / std::min(kLooked, all.size())]);
  }
  constexpr int kRungs = 24;
  Turns turns(arm, points, options, branch, 0, kRungs);
  double sum = 0;
  for (std::size_t n = 0; n < points.size(); ++n) {
    double least = kNone;
    for (int j = 0; j < kRungs; ++j) least = std::min(least, turns.state(n, j));
    sum += least;
  }
  return sum;
}

}  // namespace polypod::post
