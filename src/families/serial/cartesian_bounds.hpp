// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The reach of three linear axes with a head of rotary axes, over boxes of tool positions and patches of orientations.
#pragma once

#include "limit_terms.hpp"
#include "polypod/families/serial/cartesian.hpp"

namespace polypod::workspace {

/// Follows CartesianInverse::solve in first order. With w = R_v(q5) k_0, which the second rotary axis turns to the same
/// angle with u as the direction k that is asked for,
///   u . w = (u . v)(v . k_0) + A cos(q5 - middle),
/// the first rotary axis turns w into k, and what the head carries beside its axes by
///   R_u(q4) b = u (u . b) + ((w_ . b) k_ + (u . (w x b)) (u x k)) / (1 - (u . k)^2),
/// the parts square to u marked with a line. A head whose axes meet on the line of the tool carries nothing beside it,
/// so that its tip is the meeting point and a length of k: nothing is divided there, and the vertical tool is like any
/// other. Heads with offsets stay open next to the vertical tool until patches are small.
class CartesianLimits {
 public:
  using Form = machine::CartesianInverse::Form;
  using Vector = std::array<FirstOrder, 3>;
  struct Branch {
    FirstOrder cosine;  ///< of q5 - middle
    FirstOrder x, y;    ///< a vector with the direction of q4
    Vector tip;         ///< where it is with the linear axes at 0
  };
  struct Data {
    std::array<Branch, 2> branch;
  };

  /// Whether a third rotary axis, if there is one, goes through a whole turn.
  [[nodiscard]] static bool serves(const Form& form, LimitBits mask) {
    return form.joints == 5 || arm::turns_freely(form.range[5].min, form.range[5].max, mask, 5);
  }
  CartesianLimits(const Form& form, LimitBits mask)
      : f_(form),
        mask_(mask),
        first_(f_.range[3].min, f_.range[3].max, arm::turns_freely(f_.range[3].min, f_.range[3].max, mask, 3)) {
    for (std::size_t side = 0; side < 2; ++side)
      second_[side] = arm::half_turn_of(f_.range[4], arm::turns_freely(f_.range[4].min, f_.range[4].max, mask, 4),
                                        f_.middle, side == 0 ? 1 : -1);
    const auto at_middle = [&](const Vec3& x) { return Vec3(Eigen::AngleAxisd(f_.middle, f_.v) * across(x)); };
    along_ = f_.v.dot(f_.k);
    e1_ = at_middle(f_.k);
    e2_ = f_.v.cross(e1_);
    A_ = f_.u.dot(e1_);
    const Vec3 arm = f_.carried - f_.point_v;
    length_ = arm.dot(f_.k);
    const Vec3 beside = arm - length_ * f_.k;
    fixed_ = f_.point_v - f_.point_u + f_.v.dot(beside) * f_.v;
    f1_ = at_middle(beside);
    f2_ = f_.v.cross(f1_);
    constexpr double kNone = 1e-9;  // m
    carries_ = fixed_.norm() > kNone || f1_.norm() > kNone;
    const double fixed_part = f_.u.dot(f_.v) * along_;
    parallel_ = std::abs(fixed_part + A_ - 1) < kNone;
    opposite_ = std::abs(fixed_part - A_ + 1) < kNone;
  }

  [[nodiscard]] static int groups() { return 1; }
  /// Where the branches carry the tip to different places there are no bounds from above, and the gap falls with the
  /// first order of the box.
  [[nodiscard]] std::int64_t few_boxes() const { return carries_ ? 200'000 : 10'000'000; }
  [[nodiscard]] std::int64_t few_boxes_of_a_cone() const { return carries_ ? 10'000 : 1'000'000; }
  [[nodiscard]] double lever() const { return std::abs(length_) + f1_.norm() + fixed_.norm() + f_.from_tip_T.norm(); }
  /// The linear axes.
  [[nodiscard]] static LimitBits ends() { return (LimitBits{1} << (2 * kFirst)) - 1; }
  void box(Vec3& low, Vec3& high, const Directions&) const {
    const Mat3 D = f_.to_linear.inverse();
    low = high = f_.point_u;
    for (int i = 0; i < 3; ++i) {
      const machine::JointRange& r = f_.range[static_cast<std::size_t>(i)];
      low += (D.col(i) * r.min).cwiseMin(D.col(i) * r.max);
      high += (D.col(i) * r.min).cwiseMax(D.col(i) * r.max);
    }
    low -= Vec3::Constant(lever());
    high += Vec3::Constant(lever());
  }

  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] Data prepare(const Patch& patch) const {
    const Domain d{Vec3::Zero(), &patch};
    const Vector k = arm::turned(Mat3::Identity(), patch, f_.k_T);
    const Vector to_tip = arm::turned(Mat3::Identity(), patch, -f_.from_tip_T);
    const FirstOrder up = arm::at_most(dot(f_.u, k), 1, d);
    Data out;
    for (std::size_t side = 0; side < 2; ++side) {
      Branch& b = out.branch[side];
      b.cosine = (1 / A_) * (up - f_.u.dot(f_.v) * along_);
      const FirstOrder sine =
          (side == 0 ? 1.0 : -1.0) * arm::at_most(root(FirstOrder(1) - square(b.cosine, d), d), 1, d);
      const Vector w = at(along_ * f_.v, e1_, e2_, b.cosine, sine);
      b.x = dot(w, k, d) - square(up, d);
      b.y = dot(f_.u, cross(w, k, d));
      for (std::size_t i = 0; i < 3; ++i) b.tip[i] = length_ * k[i] + to_tip[i] + f_.point_u[Eigen::Index(i)];
      if (!carries_) continue;
      const Vector beside = at(fixed_, f1_, f2_, b.cosine, sine);
      const FirstOrder over = inverse_of_positive(FirstOrder(1) - square(up, d), d), lifted = dot(f_.u, beside);
      const double most = fixed_.norm() + f1_.norm();
      const FirstOrder out_k = times(dot(w, beside, d) - times(up, lifted, d), over, d),
                       across_k = times(dot(f_.u, cross(w, beside, d)), over, d);
      for (std::size_t i = 0; i < 3; ++i) {
        const auto [j, l] = std::pair{(i + 1) % 3, (i + 2) % 3};
        const double u = f_.u[Eigen::Index(i)];
        const FirstOrder k_out = k[i] - u * up;
        const FirstOrder k_across = f_.u[Eigen::Index(j)] * k[l] - f_.u[Eigen::Index(l)] * k[j];
        b.tip[i] = b.tip[i] + arm::at_most(u * lifted + times(out_k, k_out, d) + times(across_k, k_across, d), most, d);
      }
    }
    return out;
  }

  Verdict judge(int, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data& data,
                BoundList& out) const {
    const Domain d{half, &patch};
    Terms all;
    if (carries_) {
      all.verdict = Verdict::dead;
      for (std::size_t side = 0; side < 2 && all.verdict != Verdict::inside; ++side) {
        Terms branch;
        add_head(side, data.branch[side], d, branch);
        if (branch.verdict != Verdict::dead) add_linear(data.branch[side], center, d, branch);
        arm::or_else(branch, all);
      }
    } else {  // the linear axes stand alike in both branches
      Terms heads;
      heads.verdict = Verdict::dead;
      for (std::size_t side = 0; side < 2 && heads.verdict != Verdict::inside; ++side) {
        Terms branch;
        add_head(side, data.branch[side], d, branch);
        arm::or_else(branch, heads);
      }
      if (heads.verdict != Verdict::dead) add_linear(data.branch[0], center, d, all);
      all.append(heads);
    }
    if (all.verdict == Verdict::undecided) out.append(all.bounds);
    return all.verdict;
  }

 private:
  using Terms = arm::Terms;
  static constexpr int kFirst = 3, kSecond = 4;  // rotary axes behind the linear ones, as joints from 0
  static constexpr int kReach = 12;              // beyond the labels of the joints' limits

  /// The head's own limits.
  void add_head(std::size_t side, const Branch& b, const Domain& d, Terms& all) const {
    if (!opposite_) arm::add(b.cosine + 1.0, kReach, d, all);
    if (!parallel_) arm::add(FirstOrder(1) - b.cosine, kReach + 1, d, all);
    if (all.verdict != Verdict::dead) arm::keep_within(second_[side], 2 * kSecond, b.cosine, d, all);
    if (all.verdict != Verdict::dead) arm::keep_turn(first_, 2 * kFirst, b.x, b.y, d, all);
  }
  void add_linear(const Branch& b, const Vec3& center, const Domain& d, Terms& all) const {
    for (int i = 0; i < 3 && all.verdict != Verdict::dead; ++i) {
      const Vec3 row = f_.to_linear.row(i);
      FirstOrder s(row.dot(center));
      for (std::size_t k = 0; k < 3; ++k) s.gradient[k] = row[Eigen::Index(k)];
      s = s - dot(row, b.tip);
      const machine::JointRange& r = f_.range[static_cast<std::size_t>(i)];
      if ((mask_ >> (2 * i) & 1U) != 0) arm::add(s - r.min, 2 * i, d, all);
      if ((mask_ >> (2 * i + 1) & 1U) != 0) arm::add(FirstOrder(r.max) - s, 2 * i + 1, d, all);
    }
  }

  [[nodiscard]] Vec3 across(const Vec3& x) const { return x - f_.v.dot(x) * f_.v; }
  static FirstOrder dot(const Vec3& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  static FirstOrder dot(const Vector& a, const Vector& b, const Domain& d) {
    return times(a[0], b[0], d) + times(a[1], b[1], d) + times(a[2], b[2], d);
  }
  static Vector cross(const Vector& a, const Vector& b, const Domain& d) {
    Vector out;
    for (std::size_t i = 0; i < 3; ++i)
      out[i] = times(a[(i + 1) % 3], b[(i + 2) % 3], d) - times(a[(i + 2) % 3], b[(i + 1) % 3], d);
    return out;
  }
  /// fixed + cosine first + sine second.
  static Vector at(const Vec3& fixed, const Vec3& first, const Vec3& second, const FirstOrder& cosine,
                   const FirstOrder& sine) {
    Vector out;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      out[i] = first[k] * cosine + second[k] * sine + fixed[k];
    }
    return out;
  }

  Form f_;
  LimitBits mask_;
  arm::Turn first_;
  std::array<arm::HalfTurn, 2> second_;
  double along_ = 0, A_ = 1;  ///< v . k_0, and the factor of the cosine in u . w
  Vec3 e1_, e2_;              ///< w = along v + cos e1 + sin e2
  double length_ = 0;         ///< m, of what is carried along k
  Vec3 fixed_, f1_, f2_;      ///< m, what is carried beside it: fixed + cos f1 + sin f2
  bool carries_ = false;
  bool parallel_ = false, opposite_ = false;  ///< the head can point the tool along u, or against it
};

}  // namespace polypod::workspace
