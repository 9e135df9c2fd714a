// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The joint limits of a SCARA robot over boxes of tool positions.
#pragma once

#include <array>
#include <cmath>

#include "limit_terms.hpp"
#include "scara.hpp"

namespace polypod::workspace {

/// Follows ScaraInverse::solve in first order, at one C. With r the way from axis 1 to axis 3 in the plane, d the
/// direction of the first link where the joints are 0 and gamma the angle from it to the second one,
///   |r|^2 = l_1^2 + l_2^2 + 2 l_1 l_2 cos(beta),
///   e^(i theta_1) = r (l_1 + l_2 e^(-i beta)) e^(-i d) / |r|^2,
///   e^(i theta_3) = e^(i (phi + d + gamma)) r^* (l_1 e^(-i beta) + l_2) / |r|^2:
/// limits of joints 1 and 3 are half planes of these, that of joint 2 is one of cos(beta), the slide's is one of z.
/// Where the links are in line the sine has a root: cells next to that stay open until they are small.
class ScaraLimits {
 public:
  using Form = machine::ScaraInverse::Form;
  struct Data {
    double phi = 0;  ///< C less that where the joints are 0
  };

  ScaraLimits(const Form& form, LimitBits mask) : f_(form), mask_(mask) {
    for (std::size_t i = 0; i < 3; ++i) {
      const machine::JointRange& range = range_of(i);
      turn_[i] = arm::Turn(range.min, range.max, free_turn(i));
    }
    for (std::size_t side = 0; side < 2; ++side)
      elbow_[side] =
          arm::half_turn_of(range_of(1), free_turn(1), -f_.sense[1] * f_.gamma, (side == 0 ? 1 : -1) * f_.sense[1]);
  }

  [[nodiscard]] static int groups() { return 1; }
  [[nodiscard]] double lever() const { return f_.tip.norm(); }
  /// As ThreeParallelLimits, at 1 us each.
  [[nodiscard]] static std::int64_t few_boxes() { return 10'000'000; }
  /// The slide.
  [[nodiscard]] LimitBits ends() const { return LimitBits{3} << (2 * f_.slide); }
  void box(Vec3& low, Vec3& high, const Directions&) const {
    const double reach = f_.first + f_.second + std::hypot(f_.tip.x(), f_.tip.y());
    const machine::JointRange& slide = f_.range[static_cast<std::size_t>(f_.slide)];
    const double at_min = f_.z_0 + f_.slide_sense * slide.min, at_max = f_.z_0 + f_.slide_sense * slide.max;
    low = {f_.origin.x() - reach, f_.origin.y() - reach, std::min(at_min, at_max)};
    high = {f_.origin.x() + reach, f_.origin.y() + reach, std::max(at_min, at_max)};
  }

  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] Data prepare(const Patch& patch) const { return {angles_abc(patch.R).z() - f_.c_0}; }

  Verdict judge(int, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data& data,
                BoundList& out) const {
    const Domain d{half, &patch};
    const Vec3 carried = rotation_z(data.phi) * f_.tip;
    std::array<FirstOrder, 2> r;
    for (std::size_t i = 0; i < 2; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      r[i].value = center[k] - carried[k] - f_.origin[k];
      r[i].gradient[i] = 1;
    }
    const double l_1 = f_.first, l_2 = f_.second;
    const FirstOrder cosine = (0.5 / (l_1 * l_2)) * (square(r[0], d) + square(r[1], d) - (l_1 * l_1 + l_2 * l_2));
    Terms common;
    arm::add(cosine + 1.0, kReach, d, common);
    arm::add(FirstOrder(1) - cosine, kReach + 1, d, common);
    if (common.verdict != Verdict::dead) keep_slide(center, d, common);
    if (common.verdict == Verdict::dead) return Verdict::dead;
    const FirstOrder c = arm::at_most(cosine, 1, d);
    const FirstOrder sine = arm::at_most(root(FirstOrder(1) - square(c, d), d), 1, d);
    Terms any;
    any.verdict = Verdict::dead;
    for (std::size_t side = 0; side < 2 && any.verdict != Verdict::inside; ++side) {
      const FirstOrder s = side == 0 ? sine : -1.0 * sine;
      Terms all;
      arm::keep_within(elbow_[side], 2 * f_.turning[1], c, d, all);
      if (all.verdict != Verdict::dead) keep(0, times(r, {l_2 * c + l_1, -l_2 * s}, d), -f_.direction, d, all);
      if (all.verdict != Verdict::dead) {
        const std::array<FirstOrder, 2> conjugate{r[0], -1.0 * r[1]};
        keep(2, times(conjugate, {l_1 * c + l_2, -l_1 * s}, d), data.phi + f_.direction + f_.gamma, d, all);
      }
      arm::or_else(all, any);
    }
    common.append(any);
    if (common.verdict == Verdict::undecided) out.append(common.bounds);
    return common.verdict;
  }

 private:
  using Terms = arm::Terms;
  using Plane = std::array<FirstOrder, 2>;
  static constexpr int kReach = 12;  // beyond the labels of the joints' limits

  [[nodiscard]] const machine::JointRange& range_of(std::size_t turning) const {
    return f_.range[static_cast<std::size_t>(f_.turning[turning])];
  }
  [[nodiscard]] bool free_turn(std::size_t turning) const {
    return arm::turns_freely(range_of(turning).min, range_of(turning).max, mask_,
                             static_cast<std::size_t>(f_.turning[turning]));
  }
  /// The product of two complex numbers.
  static Plane times(const Plane& a, const Plane& b, const Domain& d) {
    return {workspace::times(a[0], b[0], d) - workspace::times(a[1], b[1], d),
            workspace::times(a[0], b[1], d) + workspace::times(a[1], b[0], d)};
  }
  /// A turning joint whose angle is that of v, turned by `by`.
  void keep(std::size_t turning, const Plane& v, double by, const Domain& d, Terms& terms) const {
    const double cos = std::cos(by), sin = std::sin(by);
    const FirstOrder x = cos * v[0] - sin * v[1], y = sin * v[0] + cos * v[1];
    arm::keep_turn(turn_[turning], 2 * f_.turning[turning], x, f_.sense[turning] * y, d, terms);
  }
  void keep_slide(const Vec3& center, const Domain& d, Terms& terms) const {
    FirstOrder q;
    q.value = f_.slide_sense * (center.z() - f_.z_0);
    q.gradient[2] = f_.slide_sense;
    const machine::JointRange& range = f_.range[static_cast<std::size_t>(f_.slide)];
    const int limit = 2 * f_.slide;
    if ((mask_ >> limit & 1U) != 0) arm::add(q - range.min, limit, d, terms);
    if ((mask_ >> (limit + 1) & 1U) != 0) arm::add(FirstOrder(range.max) - q, limit + 1, d, terms);
  }

  Form f_;
  LimitBits mask_;
  std::array<arm::Turn, 3> turn_;
  std::array<arm::HalfTurn, 2> elbow_;
};

}  // namespace polypod::workspace
