// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/slider_kinematics.hpp"

#include <fmt/format.h>

#include <cmath>

#include "forward.hpp"
#include "leg_inverse.hpp"

namespace polypod::machine {
namespace {

using Roots = std::array<SliderRoots, kLegs>;

/// The root (0 outer, 1 inner) that the source takes: on the rail, the outer one if both are; else the one nearer it.
int first_choice(const SliderHexapod& m, const SliderRoots& r, int leg) {
  const double length = m.rail_length[leg];
  constexpr double kSlack = kinematics::kLimitSlack;
  const auto off = [&](double q) { return std::max({-q - kSlack, q - length - kSlack, 0.0}); };
  return off(r.inner) < off(r.outer) ? 1 : 0;
}
bool on_rail(const SliderHexapod& m, double q, int leg) {
  return q >= -kinematics::kLimitSlack && q <= m.rail_length[leg] + kinematics::kLimitSlack;
}
double root(const SliderRoots& r, int which) {
  return which == 0 ? r.outer : r.inner;
}

/// The limits that concern leg i alone.
LimitBits bits_of_leg(int i) {
  LimitBits bits = 0;
  for (const int first : {HexapodLimits::kMin, HexapodLimits::kMax, HexapodLimits::kBaseJoint,
                          HexapodLimits::kPlatformJoint, HexapodLimits::kBasePlane})
    bits |= LimitBits{1} << (first + i);
  return bits;
}

}  // namespace

LimitTable limit_table(const SliderHexapod& m) {
  return hexapod_limit_table(m, m.leg_length, m.joint.kind != JointLimitKind::none, m.leg_diameter > 0, m.base_check);
}
std::string limit_name(const SliderHexapod&, int limit) {
  if (limit < HexapodLimits::kMax) return fmt::format("slider {} beyond the outer end of its rail", limit + 1);
  if (limit < HexapodLimits::kBaseJoint) return fmt::format("slider {} beyond the inner end of its rail", limit - 5);
  return hexapod_limit_name(limit);
}

Pose home_pose(const SliderHexapod& m) {
  return Pose{Mat3::Identity(), Vec3(0, 0, m.home.height + m.tool_length)};
}

void slider_roots(const SliderHexapod& m, const Pose& X, SliderRoots* out) {
  const Vec3 origin = X.p - m.tool_length * X.R.col(2);
  for (int i = 0; i < kLegs; ++i) {
    const Vec3 y = origin + X.R * m.platform_joint[i] - m.rail_outer[i];
    const double along = m.rail_direction[i].dot(y);
    const double under = m.length_of_leg(i) * m.length_of_leg(i) - (y - along * m.rail_direction[i]).squaredNorm();
    out[i].real = under >= 0;
    const double half = std::sqrt(std::max(0.0, under));
    out[i].outer = along - half;
    out[i].inner = along + half;
  }
}

SixLegs six_legs(const SliderHexapod& m, const JointVector& q) {
  SixLegs legs;
  for (int i = 0; i < kLegs; ++i) {
    legs.anchor[i] = m.rail_outer[i] + q[i] * m.rail_direction[i];
    legs.end[i] = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
    legs.length[i] = m.length_of_leg(i);
  }
  return legs;
}

InverseResult inverse(const SliderHexapod& m, const Pose& X) {
  InverseResult out;
  Roots roots;
  slider_roots(m, X, roots.data());
  unsigned both = 0, first = 0;
  for (unsigned i = 0; i < kLegs; ++i) {
    const int leg = static_cast<int>(i);
    if (!roots[i].real) {
      out.reason += fmt::format("{}leg {} does not reach its rail", out.reason.empty() ? "" : ", ", i + 1);
      continue;
    }
    if (first_choice(m, roots[i], leg) == 1) first |= 1U << i;
    if (on_rail(m, roots[i].outer, leg) && on_rail(m, roots[i].inner, leg) && roots[i].outer < roots[i].inner) {
      both |= 1U << i;
    }
  }
  if (!out.reason.empty()) return out;
  // Subsets of the legs with two roots on the rail, in the order of binary numbers, so that the first choice is first.
  for (unsigned subset = 0;; subset = (subset - both) & both) {
    kinematics::Solution s;
    s.joints.resize(kLegs);
    const unsigned choice = first ^ subset;
    for (int i = 0; i < kLegs; ++i) s.joints[i] = root(roots[i], static_cast<int>(choice >> i & 1U));
    s.branch = choice;
    s.violations = kinematics::violations_of_limits(m, X, s.joints);
    for (int i = 0; i < kLegs; ++i) {
      s.singular = s.singular || roots[i].inner - roots[i].outer < 1e-6 * m.length_of_leg(i);
    }
    out.solutions.push_back(std::move(s));
    if (subset == both) break;
  }
  return out;
}

std::string branch_name(const SliderHexapod&, unsigned branch) {
  std::string legs;
  for (unsigned i = 0; i < kLegs; ++i)
    if ((branch >> i & 1U) != 0) legs += fmt::format("{}{}", legs.empty() ? "" : ", ", i + 1);
  return legs.empty() ? "outer" : "inner at " + legs;
}

SliderPath follow(const SliderHexapod& m, std::span<const Pose> path, const JointVector* start, LimitBits mask) {
  SliderPath out;
  const std::size_t n = path.size();
  if (n == 0) return out;
  std::vector<Roots> roots(n);
  std::vector<std::array<LimitBits, 2>> violated(n);
  for (std::size_t k = 0; k < n; ++k) {
    slider_roots(m, path[k], roots[k].data());
    for (int which = 0; which < 2; ++which) {
      JointVector q(kLegs);
      for (int i = 0; i < kLegs; ++i) q[i] = root(roots[k][i], which);
      violated[k][which] = kinematics::violations_of_limits(m, path[k], q) & mask;
    }
  }
  const auto possible = [&](std::size_t k, int i, int which) {
    return roots[k][i].real && (violated[k][which] & bits_of_leg(i)) == 0;
  };
  // How many further poses each root of each slider can serve, from the end backwards. A slider may change its root
  // where the two are not farther apart than its platform joint moves in a step.
  std::vector<std::array<std::array<std::size_t, 2>, kLegs>> further(n);
  const auto way = [&](std::size_t k, int i) {
    const Vec3 e = m.platform_joint[i] - Vec3(0, 0, m.tool_length);
    return (path[k] * e - path[k - 1] * e).norm();
  };
  const auto may_change = [&](std::size_t k, int i) {  // between poses k - 1 and k
    const auto gap = [&](std::size_t at) { return roots[at][i].inner - roots[at][i].outer; };
    return std::min(gap(k - 1), gap(k)) <= way(k, i);
  };
  for (std::size_t k = n; k-- > 0;) {
    for (int i = 0; i < kLegs; ++i) {
      for (int which = 0; which < 2; ++which) {
        std::size_t count = 0;
        if (possible(k, i, which)) {
          count = 1;
          if (k + 1 < n) {
            count += further[k + 1][i][which];
            if (may_change(k + 1, i)) count = std::max(count, 1 + further[k + 1][i][1 - which]);
          }
        }
        further[k][i][which] = count;
      }
    }
  }
  std::array<int, kLegs> current{};
  for (int i = 0; i < kLegs; ++i) {
    if (start != nullptr) {
      current[i] = std::abs((*start)[i] - roots[0][i].inner) < std::abs((*start)[i] - roots[0][i].outer) ? 1 : 0;
    } else {
      current[i] = further[0][i][1] > further[0][i][0] ? 1 : 0;
    }
  }
  for (std::size_t k = 0; k < n; ++k) {
    JointVector q(kLegs);
    LimitBits broken = 0;
    for (int i = 0; i < kLegs; ++i) {
      if (k > 0 && may_change(k, i) && further[k][i][1 - current[i]] > further[k][i][current[i]]) {
        current[i] = 1 - current[i];
      }
      q[i] = root(roots[k][i], current[i]);
      if (!roots[k][i].real) {
        out.reason = fmt::format("pose {}: leg {} does not reach its rail", k + 1, i + 1);
        return out;
      }
      broken |= violated[k][current[i]] & bits_of_leg(i);
    }
    if (broken == 0) broken = kinematics::violations_of_limits(m, path[k], q) & mask;
    if (broken != 0) {
      out.reason = fmt::format("pose {}: {}", k + 1, limit_name(m, std::countr_zero(broken)));
      return out;
    }
    out.joints.push_back(q);
    out.complete = k + 1;
  }
  return out;
}

kinematics::NewtonResult forward_from(const SliderHexapod& m, const JointVector& q, const Pose& seed,
                                      const LegNewtonOptions& options) {
  return newton_on_legs(six_legs(m, q), seed, options);
}

Pose forward(const SliderHexapod& m, const JointVector& q) {
  const Pose home = home_pose(m);
  Roots roots;
  slider_roots(m, home, roots.data());
  JointVector q_home(kLegs);
  for (int i = 0; i < kLegs; ++i) q_home[i] = root(roots[i], first_choice(m, roots[i], i));
  return hexapod_detail::forward_from_home(m, q, q_home);
}

JacobianMatrix jacobian(const SliderHexapod& m, const Pose& X, const JointVector& q) {
  const SixLegs legs = six_legs(m, q);
  const Mat6 K = leg_rows(X, legs.anchor, legs.end);
  JacobianMatrix J = inverse_of_legs(K);
  for (int i = 0; i < kLegs; ++i) J.col(i) *= K.row(i).head<3>().dot(m.rail_direction[i]);
  return J;
}

}  // namespace polypod::machine
