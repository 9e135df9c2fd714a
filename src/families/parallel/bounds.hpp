// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits of a machine of legs over boxes of its task's coordinates and patches of orientations: the coordinates
// that follow are enclosed by an interval Newton step on the constraints.
#pragma once

#include <fmt/format.h>

#include <Eigen/QR>

#include "../../workspace/domain_number.hpp"
#include "../../workspace/linear.hpp"
#include "polypod/families/parallel/kinematics.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::workspace {

/// For tasks with x, y, z (boxes of the tip's position; patches prescribe the orientation as far as the task does), and
/// tasks of three other coordinates (boxes of these, angles as rad; no patches).
class ParallelLimits {
 public:
  struct Data {};

  /// Where a machine that carries a wrist is asked about the wrist's tip: its own tool tip, the wrist's centre, is at
  /// X_BM (p + R `centre`) for the position p of the box and the orientation R of the patch.
  struct Carrying {
    Pose X_BM;
    Vec3 centre = Vec3::Zero();
  };

  ParallelLimits(const machine::Parallel& m, const Options& options, const std::optional<Carrying>& carrying = {})
      : m_(m),
        mask_(options.limits),
        carrying_(carrying),
        p_(kinematics::nominal_parameters(m)),
        p_interval_(p_.begin(), p_.end()) {
    for (const double value : p_) {
      p_domain_.emplace_back(value);
      p_tangent_.emplace_back(value);
    }
    double reach = 0;
    for (const machine::ParallelLeg& leg : m.legs) reach = std::max(reach, leg.base.norm() + reach_of(leg));
    if (reach > 0 && std::isfinite(reach)) reach_ = reach;
    const machine::Task task = m.task;
    for (int k = 0; k < 6; ++k) {
      const auto c = static_cast<machine::Coordinate>(k);
      if (!task.holds(c)) free_.push_back(k);
    }
    if (task.names_axis()) free_ = {kTurnAboutAxis};
    if (turn_is_unseen()) free_.clear();
    turns_freely_ = std::count_if(free_.begin(), free_.end(), [](int k) { return k >= 3 && k < 6; }) == 3;
    if (!task.places())
      for (int i = 0; i < 3; ++i) {
        box_coordinate_[static_cast<std::size_t>(i)] = i < task.size() ? static_cast<int>(task[i]) : kNone;
      }
  }

  /// Where nothing follows, each drive is a group and the limits of the tip another, so that patches are dropped drive
  /// by drive; else one group, since what follows is worked out for all of them.
  [[nodiscard]] int groups() const { return free_.empty() ? joint_count(m_) + 1 : 1; }
  /// Where coordinates follow, boxes in which they cannot be enclosed (beyond where the machine closes at all, or about
  /// singular poses of the constraints) stay undecided however small: a sample then serves.
  [[nodiscard]] std::int64_t few_boxes() const { return free_.empty() ? kAnyNumber : 400'000; }
  [[nodiscard]] int axes() const { return m_.task.places() ? 3 : m_.task.size(); }
  [[nodiscard]] double lever() const { return m_.size; }
  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] static Data prepare(const Patch&) { return {}; }

  /// The ends of struts and rails.
  [[nodiscard]] LimitBits ends() const {
    LimitBits bits = 0;
    for (std::size_t j = 0; j < m_.driven.size(); ++j) {
      const machine::LegDrive drive = m_.legs[static_cast<std::size_t>(m_.driven[j])].drive;
      if (drive == machine::LegDrive::strut) bits |= LimitBits{2} << (2 * j);
      if (drive == machine::LegDrive::rail) bits |= LimitBits{3} << (2 * j);
    }
    return bits;
  }
  void box(Vec3& low, Vec3& high, const Directions&) const {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    Vec3 least = Vec3::Constant(-kFar), most = Vec3::Constant(kFar);
    for (int k = 0; k < 3; ++k) {
      const int limit = 2 * joint_count(m_) + k;
      if ((mask_ >> limit & 1U) != 0) least[k] = m_.low[k];
      if ((mask_ >> (limit + 3) & 1U) != 0) most[k] = m_.high[k];
    }
    for (const machine::ParallelLeg& leg : m_.legs) {
      const double reach = reach_of(leg);
      Vec3 a = leg.base, b = leg.base;
      if (leg.drive == machine::LegDrive::rail) {
        a += leg.range.min * leg.rail;
        b += leg.range.max * leg.rail;
      }
      least = least.cwiseMax(a.cwiseMin(b) - Vec3::Constant(reach));
      most = most.cwiseMin(a.cwiseMax(b) + Vec3::Constant(reach));
    }
    for (int i = 0; i < 3; ++i) {
      const int k = box_coordinate_[static_cast<std::size_t>(i)];
      if (k == kNone) {
        low[i] = -kAcross;
        high[i] = kAcross;
        continue;
      }
      low[i] = k < 3 ? least[k] : m_.home_angles[k - 3] - kFromHome;
      high[i] = k < 3 ? most[k] : m_.home_angles[k - 3] + kFromHome;
    }
  }

  Verdict judge(int group, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data&,
                BoundList& out) const {
    const Domain d{half, &patch};
    const int n = joint_count(m_);
    std::array<DomainNumber, 5> u;
    if (free_.empty()) {
      if (group == n) return tip(position(center, d), d, out);
      if (driven_leg(m_, group).ring) return ring_leg(group, pose(center, d, u, Mat3::Identity()), d, out);
      Vector3<DomainNumber> y = position(center, d);
      const auto arm = turned(patch, driven_leg(m_, group).platform - m_.tool);
      for (int k = 0; k < 3; ++k) y[k] += DomainNumber(arm[static_cast<std::size_t>(k)], &d);
      return straight_leg(group, y, d, out);
    }
    const std::optional<PoseT<DomainNumber>> X = pose_over(center, d);
    if (!X) return too_far(center, d) ? Verdict::dead : Verdict::open;
    const Verdict verdict = legs_and_tip(*X, d, out);
    if (verdict != Verdict::undecided) out.clear();
    return verdict;
  }

 protected:
  /// All poses of the domain in first order, where coordinates follow; empty where they are not enclosed.
  [[nodiscard]] std::optional<PoseT<DomainNumber>> pose_over(const Vec3& center, const Domain& d) const {
    const std::optional<Pose> X0 = settled(m_, target_at(center, *d.patch));
    std::array<DomainNumber, 5> u;
    if (!X0 || !enclose(*X0, center, d, u)) return std::nullopt;
    return pose(center, d, u, middle_of(*X0));
  }
  Verdict legs_and_tip(const PoseT<DomainNumber>& X, const Domain& d, BoundList& out) const {
    Verdict verdict = tip(X.p, d, out);
    for (int j = 0; j < joint_count(m_) && verdict != Verdict::dead; ++j) verdict = both(verdict, leg(j, X, d, out));
    return verdict;
  }

  static constexpr int kTurnAboutAxis = 6;
  static constexpr int kNone = -1;  // a side of the box that is no coordinate
  static constexpr std::int64_t kAnyNumber = std::numeric_limits<std::int64_t>::max();
  static constexpr double kScale = 10;  // no term of a limit is larger, in units of it

  /// Whether no leg sees the turn about the tool axis at all: then it need not be known.
  [[nodiscard]] bool turn_is_unseen() const {
    return m_.idle_turn && m_.task.names_axis() && m_.constraints.empty() &&
           std::all_of(m_.legs.begin(), m_.legs.end(), [&](const machine::ParallelLeg& leg) {
             return leg.ring && leg.ring->axis.head<2>().isZero(0) && (leg.ring->center - m_.tool).head<2>().isZero(0);
           });
  }

  /// How far the tip can be from where a leg begins, m.
  [[nodiscard]] double reach_of(const machine::ParallelLeg& leg) const {
    const double lever = leg.ring ? (leg.ring->center - m_.tool).norm() + leg.ring->radius
                                  : (leg.platform - m_.tool).norm() + leg.still.norm();
    return lever + (leg.drive == machine::LegDrive::strut ? leg.range.max : leg.rod + leg.arm);
  }

  /// Whether no orientation brings the tip into the box with all struts and rods within their lengths.
  [[nodiscard]] bool too_far(const Vec3& middle, const Domain& d) const {
    if (!m_.task.places()) return false;
    const Vec3 center = placed_at(middle, *d.patch);
    const double radius = d.half.norm() + (carrying_ ? d.patch->turn * carrying_->centre.norm() : 0.0);
    for (std::size_t i = 0; i < m_.legs.size(); ++i) {
      const machine::ParallelLeg& leg = m_.legs[i];
      const int drive = static_cast<int>(i);
      if (leg.drive == machine::LegDrive::strut && !mask_of_leg(drive, 1)) continue;
      if (leg.drive == machine::LegDrive::rail && !(mask_of_leg(drive, 0) && mask_of_leg(drive, 1))) continue;
      Vec3 nearest = leg.base;
      if (leg.drive == machine::LegDrive::rail) {
        nearest += std::clamp(leg.rail.dot(center - leg.base), leg.range.min, leg.range.max) * leg.rail;
      }
      if ((center - nearest).norm() - radius > reach_of(leg) * (1 + kRounding)) return true;
    }
    return false;
  }
  [[nodiscard]] bool mask_of_leg(int leg, int side) const {
    for (std::size_t j = 0; j < m_.driven.size(); ++j)
      if (m_.driven[j] == leg) return (mask_ >> (2 * j + static_cast<std::size_t>(side)) & 1U) != 0;
    return true;
  }

  /// A number of the box or of a direction: 0 to 2 the box, 3 and 4 the patch.
  static FirstOrder variable(double value, std::size_t which) {
    FirstOrder out(value);
    out.gradient[which] = 1;
    return out;
  }

  /// The orientation from which angles that all three follow are counted: that at the middle, for A, B and C are no
  /// coordinates of orientations near B = 90 deg.
  [[nodiscard]] Mat3 middle_of(const Pose& X0) const { return turns_freely_ ? X0.R : Mat3::Identity(); }

  /// The pose where the following coordinates have the values u (in the order of `free_`), angles from `middle`
  /// (middle_of). `prescribed(k)` gives the coordinate k of the box or patch, `patched()` the rotation of the patch.
  template <class T, class Prescribed, class Patched>
  PoseT<T> pose_from(const std::array<T, 5>& u, const Mat3& middle, Prescribed&& prescribed, Patched&& patched) const {
    std::array<T, 6> c;
    std::array<bool, 6> given{};
    T about_axis(0.0);
    for (std::size_t i = 0; i < free_.size(); ++i) {
      if (free_[i] == kTurnAboutAxis) {
        about_axis = u[i];
      } else {
        c[static_cast<std::size_t>(free_[i])] = u[i];
        given[static_cast<std::size_t>(free_[i])] = true;
      }
    }
    for (int k = 0; k < 6; ++k)
      if (!given[static_cast<std::size_t>(k)]) c[static_cast<std::size_t>(k)] = prescribed(k);
    PoseT<T> X;
    X.p = Vector3<T>(c[0], c[1], c[2]);
    if (m_.task.names_axis()) {
      X.R = patched();
      if (!free_.empty()) X.R = X.R * rotation_by_angles<T>(T(0.0), T(0.0), about_axis);
    } else if (m_.task.size() == 6) {
      X.R = patched();
    } else {
      X.R = rotation_by_angles<T>(c[3], c[4], c[5]);
      if (turns_freely_) X.R = middle.cast<T>() * X.R;
    }
    return X;
  }

  /// What a pose prescribes at the middle of a box and a patch.
  [[nodiscard]] Pose target_at(const Vec3& center, const Patch& patch) const {
    if (m_.task.places()) {
      const bool whole = m_.task.names_axis() || m_.task.size() == 6;
      return {whole ? patch.R : rotation_abc(angle_of(patch, 3), angle_of(patch, 4), 0), placed_at(center, patch)};
    }
    return kinematics::pose_of(m_.task, {center[0], center[1], center[2]});
  }

  /// Where the tool tip is at a point of the box, in the middle of the patch.
  [[nodiscard]] Vec3 placed_at(const Vec3& p, const Patch& patch) const {
    return carrying_ ? carrying_->X_BM * Vec3(p + patch.R * carrying_->centre) : p;
  }
  /// The coordinate i of the box over the domain.
  [[nodiscard]] DomainNumber placed(int i, const Vec3& center, const Domain& d) const {
    const auto at = [&](int k) { return DomainNumber(variable(center[k], static_cast<std::size_t>(k)), &d); };
    if (!carrying_) return at(i);
    const Matrix3<DomainNumber> R = patched(d);
    DomainNumber out(carrying_->X_BM.p[i]);
    for (int k = 0; k < 3; ++k) {
      DomainNumber p = at(k);
      for (int l = 0; l < 3; ++l) p += R(k, l) * DomainNumber(carrying_->centre[l]);
      out += DomainNumber(carrying_->X_BM.R(i, k)) * p;
    }
    return out;
  }
  /// The orientations of the patch.
  [[nodiscard]] static Matrix3<DomainNumber> patched(const Domain& d) {
    const Patch& patch = *d.patch;
    const Mat3 by1 = skew(patch.omega1) * patch.R, by2 = skew(patch.omega2) * patch.R;
    Matrix3<DomainNumber> R;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        FirstOrder f(patch.R(i, k));
        f.gradient = {0, 0, 0, by1(i, k), by2(i, k)};
        f.rest = patch.bend;
        R(i, k) = DomainNumber(f, &d);
      }
    return R;
  }

  [[nodiscard]] int box_index(int coordinate) const {
    for (int i = 0; i < 3; ++i)
      if (box_coordinate_[static_cast<std::size_t>(i)] == coordinate) return i;
    return -1;
  }
  /// The held angles of a patch of ranges: A = s, B = t, C = 0.
  static double angle_of(const Patch& patch, int k) {
    return k == 3 ? 0.5 * (patch.low[0] + patch.high[0]) : k == 4 ? 0.5 * (patch.low[1] + patch.high[1]) : 0.0;
  }

  /// First order of the following coordinates over the domain: u0 + g . v + [-r, r]. The tube is certain where
  ///   |Y F(v, u0 + g v)| + |1 - Y F_u(v, u)| r <= r
  /// for all v and all u in the tube (Krawczyk), Y an inverse of F_u at the middle.
  bool enclose(const Pose& X0, const Vec3& center, const Domain& d, std::array<DomainNumber, 5>& u) const {
    const std::size_t n = free_.size();
    if (n == 0) return true;
    const Mat3 middle = middle_of(X0);
    const Vec3 abc = turns_freely_ ? Vec3::Zero().eval() : angles_abc(X0.R);
    std::array<double, 5> u0{};
    for (std::size_t i = 0; i < n; ++i) {
      if (free_[i] == kTurnAboutAxis) {
        const Mat3 turn = d.patch->R.transpose() * X0.R;
        u0[i] = std::atan2(turn(1, 0), turn(0, 0));
      } else {
        u0[i] = free_[i] < 3 ? X0.p[free_[i]] : abc[free_[i] - 3];
      }
    }
    // At the middle: F_u by tangents on numbers, F_v from first order.
    std::array<Tangent<double>, 5> u_tangent;
    for (std::size_t i = 0; i < n; ++i) {
      u_tangent[i] = Tangent<double>(u0[i]);
      u_tangent[i].by[i] = 1;
      u[i] = DomainNumber(u0[i]);
    }
    const auto F_u = passive<Tangent<double>>(pose_at_middle(center, d, u_tangent, middle), p_real_tangent());
    const auto rows = static_cast<int>(F_u.size());
    const auto columns = static_cast<int>(n);
    Eigen::MatrixXd by_u(rows, columns);
    for (int i = 0; i < rows; ++i)
      for (int k = 0; k < columns; ++k) by_u(i, k) = F_u[i].by[static_cast<std::size_t>(k)];
    const Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposed(by_u);
    if (decomposed.rank() < columns) return false;
    const Eigen::MatrixXd Y = decomposed.pseudoInverse();
    const auto F_0 = passive<DomainNumber>(pose(center, d, u, middle), p_domain_);
    for (int k = 0; k < columns; ++k) {
      FirstOrder f(u0[static_cast<std::size_t>(k)]);
      for (int i = 0; i < rows; ++i)
        for (std::size_t g = 0; g < 5; ++g) f.gradient[g] -= Y(k, i) * F_0[i].first_order().gradient[g];
      u[static_cast<std::size_t>(k)] = DomainNumber(f, &d);
    }
    const auto F_line = passive<DomainNumber>(pose(center, d, u, middle), p_domain_);
    Eigen::VectorXd e(columns), r(columns);
    for (int k = 0; k < columns; ++k) {
      DomainNumber sum(0.0);
      for (int i = 0; i < rows; ++i) sum += DomainNumber(Y(k, i)) * F_line[i];
      e[k] = std::abs(sum.first_order().value) + sum.radius();
    }
    if (!e.allFinite()) return false;
    r = 1.5 * e.array() + 1e-13;
    for (int attempt = 0; attempt < 4; ++attempt) {
      std::array<Tangent<Interval>, 5> tube;
      for (std::size_t k = 0; k < n; ++k) {
        const double reach = u[k].radius() + r[static_cast<Eigen::Index>(k)];
        tube[k] = Tangent<Interval>(Interval(u0[k] - reach, u0[k] + reach));
        tube[k].by[k] = Interval(1.0);
      }
      const auto F_tube = passive<Tangent<Interval>>(pose_within(center, d, tube, middle), p_tangent_);
      const Eigen::MatrixXd away = distance_from_one(Y, F_tube, columns);
      if (!away.allFinite()) return false;
      const Eigen::VectorXd needed = e + away * r;
      if ((needed.array() <= r.array()).all()) {
        for (std::size_t k = 0; k < n; ++k) {
          FirstOrder f = u[k].first_order();
          f.rest = needed[static_cast<Eigen::Index>(k)];
          u[k] = DomainNumber(f, &d);
        }
        return true;
      }
      r = 1.5 * needed.array() + 1e-13;
    }
    return false;
  }

  /// |1 - Y F_u| over the tube, each element the largest.
  static Eigen::MatrixXd distance_from_one(const Eigen::MatrixXd& Y,
                                           const machine::ClosureVectorT<Tangent<Interval>>& F, int columns) {
    Eigen::MatrixXd out(columns, columns);
    for (int k = 0; k < columns; ++k)
      for (int l = 0; l < columns; ++l) {
        Interval sum(k == l ? 1.0 : 0.0);
        for (int i = 0; i < F.size(); ++i) sum -= Interval(Y(k, i)) * F[i].by[static_cast<std::size_t>(l)];
        out(k, l) = sum.magnitude();
      }
    return out;
  }

  template <class T, class P>
  machine::ClosureVectorT<T> passive(const PoseT<T>& X, const P& p) const {
    return machine::parallel_detail::equations<T>(m_, X, std::span<const T>(), std::span<const T>(p), true);
  }

  /// All positions of the tip in the box, where it prescribes all of x, y, z.
  [[nodiscard]] static Vector3<DomainNumber> position(const Vec3& center, const Domain& d) {
    Vector3<DomainNumber> p;
    for (int k = 0; k < 3; ++k) p[k] = {variable(center[k], static_cast<std::size_t>(k)), &d};
    return p;
  }

  /// All poses of the domain in first order.
  [[nodiscard]] PoseT<DomainNumber> pose(const Vec3& center, const Domain& d, const std::array<DomainNumber, 5>& u,
                                         const Mat3& middle) const {
    using T = DomainNumber;
    const Patch& patch = *d.patch;
    return pose_from<T>(
        u, middle,
        [&](int k) -> T {
          if (const int i = box_index(k); i >= 0) return placed(i, center, d);
          if (k == 5 || patch.sector) return {angle_of(patch, 5)};
          return {variable(angle_of(patch, k), static_cast<std::size_t>(k)), &d};
        },
        [&] { return patched(d); });
  }

  /// The pose at the middle of the domain.
  template <class T>
  PoseT<T> pose_at_middle(const Vec3& center, const Domain& d, const std::array<T, 5>& u, const Mat3& middle) const {
    return pose_from<T>(
        u, middle,
        [&](int k) {
          const int i = box_index(k);
          return T(i < 0 ? angle_of(*d.patch, k) : carrying_ ? placed_at(center, *d.patch)[i] : center[i]);
        },
        [&] {
          Matrix3<T> R;
          for (int i = 0; i < 9; ++i) R(i / 3, i % 3) = T(d.patch->R(i / 3, i % 3));
          return R;
        });
  }
  /// All poses of the domain, as intervals.
  PoseT<Tangent<Interval>> pose_within(const Vec3& center, const Domain& d, const std::array<Tangent<Interval>, 5>& u,
                                       const Mat3& middle) const {
    using T = Tangent<Interval>;
    const auto within = [](double value, double half) { return T(Interval(value - half, value + half)); };
    return pose_from<T>(
        u, middle,
        [&](int k) {
          const int i = box_index(k);
          if (i >= 0 && carrying_) {
            const DomainNumber all = placed(i, center, d);
            return within(all.first_order().value, all.radius());
          }
          if (i >= 0) return within(center[i], d.half[i]);
          const Patch& patch = *d.patch;
          return within(angle_of(patch, k), k < 5 ? 0.5 * (patch.high[k - 3] - patch.low[k - 3]) : 0.0);
        },
        [&] {
          Matrix3<T> R;
          for (int i = 0; i < 9; ++i) R(i / 3, i % 3) = within(d.patch->R(i / 3, i % 3), d.patch->turn);
          return R;
        });
  }

  /// `unit`: a power of the machine's reach, as g's terms are, for machines of any size.
  [[nodiscard]] Verdict judged(const DomainNumber& g, int limit, double unit, const Domain& d,
                               BoundList& bounds) const {
    if (limit < 64 && (mask_ >> limit & 1U) == 0) return Verdict::inside;
    const FirstOrder& f = g.first_order();
    if (!std::isfinite(g.radius())) return Verdict::open;
    return weigh(
        {f.value, Vec3(f.gradient[0], f.gradient[1], f.gradient[2]), f.gradient[3], f.gradient[4], f.rest, f.rest},
        limit, kScale * unit, d.half, *d.patch, bounds);
  }

  /// The limits of the tool tip.
  Verdict tip(const Vector3<DomainNumber>& p, const Domain& d, BoundList& out) const {
    const int first = 2 * joint_count(m_);
    Verdict verdict = Verdict::inside;
    for (int k = 0; k < 3; ++k) {
      if (std::isfinite(m_.low[k])) {
        verdict =
            both(verdict, judged(p[k] - DomainNumber(m_.low[k]), first + k, reach_ + std::abs(m_.low[k]), d, out));
      }
      if (std::isfinite(m_.high[k])) {
        verdict = both(verdict,
                       judged(DomainNumber(m_.high[k]) - p[k], first + 3 + k, reach_ + std::abs(m_.high[k]), d, out));
      }
    }
    return verdict;
  }

  static Vector3<DomainNumber> constant(const Vec3& v) { return {v[0], v[1], v[2]}; }

  /// The limits of drive j.
  Verdict leg(int j, const PoseT<DomainNumber>& X, const Domain& d, BoundList& out) const {
    const machine::ParallelLeg& leg = driven_leg(m_, j);
    if (leg.ring) return ring_leg(j, X, d, out);
    return straight_leg(j, X.R * constant(leg.platform - m_.tool) + X.p, d, out);
  }

  Verdict ring_leg(int j, const PoseT<DomainNumber>& X, const Domain& d, BoundList& out) const {
    using N = DomainNumber;
    const machine::ParallelLeg& leg = driven_leg(m_, j);
    const Vector3<N> w =
        Vector3<N>(X.R.transpose() * Vector3<N>(constant(leg.base) - X.p)) - constant(leg.ring->center - m_.tool);
    const N h = machine::parallel_detail::dot(constant(leg.ring->axis), w);
    Vector3<N> across;
    for (int k = 0; k < 3; ++k) across[k] = w[k] - h * N(leg.ring->axis[k]);
    const N off = norm(across) - N(leg.ring->radius);
    return length_within(j, sqrt(square(off) + square(h)), leg, d, out);
  }

  /// `joint`: where the leg meets the platform.
  Verdict straight_leg(int j, const Vector3<DomainNumber>& joint, const Domain& d, BoundList& out) const {
    const machine::ParallelLeg& leg = driven_leg(m_, j);
    const Vector3<DomainNumber> y = joint + constant(leg.still - leg.base);
    if (leg.drive == machine::LegDrive::strut) return length_within(j, norm(y), leg, d, out);
    const DomainNumber length2 = square(y[0]) + square(y[1]) + square(y[2]);
    return leg.drive == machine::LegDrive::rail ? on_rail(j, leg, y, length2, d, out)
                                                : in_turn(j, leg, y, length2, d, out);
  }

  Verdict length_within(int j, const DomainNumber& length, const machine::ParallelLeg& leg, const Domain& d,
                        BoundList& out) const {
    const Verdict low = judged(length - DomainNumber(leg.range.min), 2 * j, reach_, d, out);
    return low == Verdict::dead ? low
                                : both(low, judged(DomainNumber(leg.range.max) - length, 2 * j + 1, reach_, d, out));
  }

  struct Terms {
    Verdict verdict = Verdict::inside;
    BoundList bounds;
  };
  /// One of two roots must keep its limits, and the leg must reach.
  static Verdict either(Verdict reach, const BoundList& reach_bounds, const Terms& a, const Terms& b, BoundList& out) {
    if (reach == Verdict::dead || (a.verdict == Verdict::dead && b.verdict == Verdict::dead)) return Verdict::dead;
    out.append(reach_bounds);
    if (a.verdict == Verdict::inside || b.verdict == Verdict::inside) return reach;
    if (a.verdict != Verdict::dead && b.verdict != Verdict::dead) return both(reach, Verdict::open);
    const Terms& only = a.verdict == Verdict::dead ? b : a;
    out.append(only.bounds);
    return both(reach, only.verdict);
  }

  /// Whether the direction (x, y) of a plane lies between the angles `low` and `high`, less than a turn apart: limits
  /// `limit` and the next.
  Terms between(const DomainNumber& x, const DomainNumber& y, double low, double high, int limit, double unit,
                const Domain& d) const {
    using N = DomainNumber;
    Terms terms;
    const N from_low = N(std::cos(low)) * y - N(std::sin(low)) * x,
            to_high = N(std::sin(high)) * x - N(std::cos(high)) * y;
    BoundList above, below;
    const Verdict keeps_low = judged(from_low, limit, unit, d, above),
                  keeps_high = judged(to_high, limit + 1, unit, d, below);
    if (high - low <= std::numbers::pi) {
      terms.verdict = both(keeps_low, keeps_high);
      terms.bounds.append(above);
      terms.bounds.append(below);
    } else if (keeps_low != Verdict::inside && keeps_high != Verdict::inside) {
      if (keeps_low == Verdict::dead) {
        terms = {keeps_high, below};
      } else if (keeps_high == Verdict::dead) {
        terms = {keeps_low, above};
      } else {
        terms.verdict = Verdict::open;
      }
    }
    return terms;
  }

  Verdict on_rail(int j, const machine::ParallelLeg& leg, const Vector3<DomainNumber>& y, const DomainNumber& length2,
                  const Domain& d, BoundList& out) const {
    using N = DomainNumber;
    const N along = N(leg.rail[0]) * y[0] + N(leg.rail[1]) * y[1] + N(leg.rail[2]) * y[2];
    const N under = N(leg.rod * leg.rod) - (length2 - square(along)), half = sqrt(under);
    BoundList reach_bounds;
    const Verdict reach = judged(under, 64 + j, reach_ * reach_, d, reach_bounds);
    const auto root = [&](double side) {
      Terms terms;
      const N q = along + N(side) * half - N(leg.zero_offset);
      terms.verdict = both(judged(q - N(leg.range.min), 2 * j, reach_, d, terms.bounds),
                           judged(N(leg.range.max) - q, 2 * j + 1, reach_, d, terms.bounds));
      return terms;
    };
    return either(reach, reach_bounds, root(-1), root(1), out);
  }

  /// The arm's direction is along (alpha r + side s, alpha s - side r), side = +-sqrt(arm^2 D^2 - alpha^2).
  Verdict in_turn(int j, const machine::ParallelLeg& leg, const Vector3<DomainNumber>& y, const DomainNumber& length2,
                  const Domain& d, BoundList& out) const {
    using N = DomainNumber;
    const Vec3 across = leg.axis.cross(leg.zero);
    const N r = N(leg.zero[0]) * y[0] + N(leg.zero[1]) * y[1] + N(leg.zero[2]) * y[2];
    const N s = N(across[0]) * y[0] + N(across[1]) * y[1] + N(across[2]) * y[2];
    const N D2 = square(r) + square(s);
    const N alpha = N(0.5) * (length2 + N(leg.arm * leg.arm - leg.rod * leg.rod));
    const N under = N(leg.arm * leg.arm) * D2 - square(alpha), beta = sqrt(under);
    BoundList reach_bounds;
    const Verdict reach = judged(under, 64 + j, reach_ * reach_ * reach_ * reach_, d, reach_bounds);
    const double low = leg.range.min + leg.zero_offset, high = leg.range.max + leg.zero_offset;
    const double scale = 1 / (leg.arm * leg.rod), unit = scale * reach_ * reach_ * reach_;
    const auto root = [&](double side) {
      const bool free = high - low >= 2 * std::numbers::pi - 1e-9 || (mask_ >> (2 * j) & 3U) != 3;
      if (free) return Terms{};
      const N x = N(scale) * (alpha * r + N(side) * beta * s), z = N(scale) * (alpha * s - N(side) * beta * r);
      return between(x, z, low, high, 2 * j, unit, d);
    };
    return either(reach, reach_bounds, root(1), root(-1), out);
  }

  [[nodiscard]] std::vector<Tangent<double>> p_real_tangent() const {
    return std::vector<Tangent<double>>(p_.begin(), p_.end());
  }

  const machine::Parallel& m_;
  LimitBits mask_;
  std::optional<Carrying> carrying_;
  std::vector<double> p_;
  std::vector<Interval> p_interval_;
  std::vector<DomainNumber> p_domain_;
  std::vector<Tangent<Interval>> p_tangent_;
  double reach_ = 1;                            ///< m: no distance in a limit is longer
  std::vector<int> free_;                       ///< coordinates that follow
  bool turns_freely_ = false;                   ///< A, B and C all follow
  std::array<int, 3> box_coordinate_{0, 1, 2};  ///< which coordinates the box is of
};

/// What volume() asks over boxes. Errors: WS104 (directions that the task does not hold), WS106 (a task that has no
/// volume).
inline Result<ParallelLimits> bounds_of(const machine::Parallel& m, const Options& options) {
  POLYPOD_TRY(held_by(m.task, m.name, options.directions));
  return ParallelLimits(m, options);
}

}  // namespace polypod::workspace
