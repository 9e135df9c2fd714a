// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Compiled without errno and without contraction of a * b + c, so that roots become one instruction and every processor
// gives the same numbers.
#include "leg_kernel.hpp"

#include <cmath>
#include <limits>

#include "lane_algebra.hpp"
#include "plan.hpp"

static_assert(alignof(polypod::quality::LegKernel::Group) == 32);

namespace polypod::quality {

std::optional<machine::LegLayout> six_legs_of(const AnyMachine& machine) {
  return std::visit(
      [](const auto& m) -> std::optional<machine::LegLayout> {
        if constexpr (requires { leg_layout(m); }) return leg_layout(m);
        return {};
      },
      machine);
}

LegKernel::LegKernel(const machine::LegLayout& machine, const std::vector<Mat3>& orientations)
    : machine_(machine), directions_(orientations.size()) {
  groups_.resize((directions_ + kLanes - 1) / kLanes);
  for (std::size_t d = 0; d < groups_.size() * kLanes; ++d) {
    const Mat3& R = orientations[std::min(d, directions_ - 1)];
    Group& g = groups_[d / kLanes];
    const std::size_t lane = d % kLanes;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) g.R[r][c][lane] = R(r, c);
      for (std::size_t i = 0; i < 6; ++i) g.arm[i][r][lane] = R.row(r).dot(machine.end[i]);
    }
  }
  set_length(0);
}

void LegKernel::set_length(double length) {
  length_ = length;
  if (length > 0) return;
  length_ = 0;
  for (const Vec3& e : machine_.end) length_ += e.norm() / 6;
  if (!(length_ > 0)) length_ = 1;
}

bool LegKernel::set_sizes(const AnyMachine& machine, const std::vector<Sized>& sizes, Region region) {
  sizes_ = {};
  const std::vector<Element> all = elements(machine);
  for (const auto& [number, size] : sizes) {
    const Element& e = all[static_cast<std::size_t>(number)];
    const std::size_t open = e.key.find('[');
    if (open == std::string::npos) return false;
    LegSizes& leg = sizes_[static_cast<std::size_t>(e.key[open + 1] - '1')];
    const bool ball = region == Region::sphere;
    if (e.group == "leg.length") {
      leg.length += size;
    } else if (e.group == "joint") {
      leg.joint += size;
    } else if (e.group == "base.joint" || e.group == "base.attachment") {
      if (ball)
        leg.base_ball += size;
      else
        leg.base += Vec3::Constant(size);
    } else if (e.group == "platform.joint" || e.group == "platform.attachment") {
      if (ball)
        leg.platform_ball += size;
      else
        leg.platform += Vec3::Constant(size);
    } else if (e.group == "rail.direction" && !ball) {
      leg.direction += Vec3::Constant(size);
    } else {
      return false;
    }
  }
  return true;
}

namespace {

/// Row of one leg and what its sizes weigh.
struct Leg {
  Lanes w[3], moment[3], along_rail, slider;
};

/// The farthest of the vertices sum +-g_i; G[c][i] is coordinate c of g_i. The last sign stands: the rest is a mirror.
POLYPOD_INLINE Lanes farthest_of(const Lanes (&G)[6][6], int first) {
  Lanes sum[3];
  for (int c = 0; c < 3; ++c) {
    sum[c] = G[first + c][0];
    for (int i = 1; i < 6; ++i) sum[c] += G[first + c][i];
  }
  Lanes best = sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2];
#pragma GCC unroll 32
  for (unsigned k = 1; k < 32; ++k) {
    const int i = __builtin_ctz(k);
    const bool negative = ((k ^ (k >> 1)) >> i & 1U) != 0;
    for (int c = 0; c < 3; ++c) sum[c] += (negative ? -2.0 : 2.0) * G[first + c][i];
    best = larger(best, sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
  }
  return root(best);
}

}  // namespace

struct LegKernelBody {
  template <LegQuestion Question>
  POLYPOD_INLINE static void run(const LegKernel& k, const Vec3& p, LegKernel::Answer& answer) {
    std::array<double, 3> sum{};
    const machine::LegLayout& m = k.machine_;
    for (std::size_t g = 0; g < k.groups_.size(); ++g) {
      const LegKernel::Group& group = k.groups_[g];
      Lanes K[6][6], along_rail[6], slider[6];
      for (std::size_t i = 0; i < 6; ++i) {
        Lanes y[3];
        for (int c = 0; c < 3; ++c) y[c] = group.arm[i][c] + (p[c] - m.anchor[i][c]);
        Lanes inverse;
        along_rail[i] = all_of(1);
        slider[i] = all_of(0);
        if (m.rails) {
          const Vec3& u = m.rail[i];
          const Lanes s = y[0] * u[0] + y[1] * u[1] + y[2] * u[2];
          const Lanes square = y[0] * y[0] + y[1] * y[1] + y[2] * y[2];
          const Lanes half = root(larger(m.leg_length[i] * m.leg_length[i] - (square - s * s), all_of(0)));
          const Lanes outer = s - half, inner = s + half;
          // The outer root where it is on the rail or the inner one is not.
          const Mask use_inner =
              ((outer < 0) | (outer > m.rail_length[i])) & (inner >= 0) & (inner <= m.rail_length[i]);
          slider[i] = use_inner ? inner : outer;
          for (int c = 0; c < 3; ++c) y[c] -= slider[i] * u[c];
          inverse = all_of(1 / m.leg_length[i]);
          along_rail[i] = (s - slider[i]) * inverse;
        } else {
          inverse = 1 / root(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]);
        }
        for (int c = 0; c < 3; ++c) K[i][c] = y[c] * inverse;
        const Lanes* e = group.arm[i];
        K[i][3] = e[1] * K[i][2] - e[2] * K[i][1];
        K[i][4] = e[2] * K[i][0] - e[0] * K[i][2];
        K[i][5] = e[0] * K[i][1] - e[1] * K[i][0];
      }
      Lanes value[3] = {all_of(0), all_of(0), all_of(0)};
      if constexpr (Question == LegQuestion::dexterity) {
        for (int i = 0; i < 6; ++i) {
          const Lanes row = 1 / along_rail[i], turn = row * (1 / k.length_);
          for (int c = 0; c < 3; ++c) {
            K[i][c] *= row;
            K[i][3 + c] *= turn;
          }
        }
        dexterity(K, value);
      } else {
        constexpr bool kKnown = Question == LegQuestion::known;
        Lanes size[6];
        for (std::size_t i = 0; i < 6; ++i) {
          const LegSizes& d = k.sizes_[i];
          Lanes sum_i = all_of(d.length + d.base_ball + d.platform_ball);
          const auto add = [&](const Lanes& part, double factor) __attribute__((always_inline)) {
            sum_i += factor * (kKnown ? part : magnitude(part));
          };
          add(along_rail[i], d.joint);
          for (int c = 0; c < 3; ++c) {
            add(K[i][c], d.base[c]);
            add(K[i][c] * slider[i], d.direction[c]);
            const Lanes local = K[i][0] * group.R[0][c] + K[i][1] * group.R[1][c] + K[i][2] * group.R[2][c];
            add(local, kKnown ? -d.platform[c] : d.platform[c]);
          }
          size[i] = sum_i;
        }
        if constexpr (kKnown) {
          Lanes B[6][1];
          for (int i = 0; i < 6; ++i) B[i][0] = size[i];
          solve(K, B);
          value[0] = root(B[0][0] * B[0][0] + B[1][0] * B[1][0] + B[2][0] * B[2][0]);
          value[1] = root(B[3][0] * B[3][0] + B[4][0] * B[4][0] + B[5][0] * B[5][0]);
        } else {
          Lanes B[6][6];
          for (int i = 0; i < 6; ++i)
            for (int j = 0; j < 6; ++j) B[i][j] = i == j ? size[i] : all_of(0);
          solve(K, B);
          value[0] = farthest_of(B, 0);
          value[1] = farthest_of(B, 3);
        }
      }
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const std::size_t d = g * kLanes + lane;
        if (d >= k.directions_) break;
        for (std::size_t v = 0; v < 3; ++v) {
          const double x = value[v][lane];
          sum[v] += x;
          const bool large = Question != LegQuestion::dexterity || v == 0;
          if (d == 0 || (large ? !(x <= answer.worst[v]) : x < answer.worst[v])) {
            answer.worst[v] = x;
            answer.worst_direction[v] = static_cast<int>(d);
          }
        }
      }
    }
    for (std::size_t v = 0; v < 3; ++v) answer.mean[v] = sum[v] / static_cast<double>(k.directions_);
  }
};

namespace {

POLYPOD_INLINE void run_any(const LegKernel& k, LegQuestion question, const Vec3& p, LegKernel::Answer& answer) {
  switch (question) {
    case LegQuestion::dexterity:
      return LegKernelBody::run<LegQuestion::dexterity>(k, p, answer);
    case LegQuestion::known:
      return LegKernelBody::run<LegQuestion::known>(k, p, answer);
    case LegQuestion::tolerance:
      return LegKernelBody::run<LegQuestion::tolerance>(k, p, answer);
  }
}

#ifdef __x86_64__
[[gnu::target("avx2")]] void run_wide(const LegKernel& k, LegQuestion question, const Vec3& p,
                                      LegKernel::Answer& answer) {
  run_any(k, question, p, answer);
}
#endif
void run_plain(const LegKernel& k, LegQuestion question, const Vec3& p, LegKernel::Answer& answer) {
  run_any(k, question, p, answer);
}

}  // namespace

LegKernel::Answer LegKernel::ask(LegQuestion question, const Vec3& p) const {
  Answer answer;
#ifdef __x86_64__
  static const bool wide = __builtin_cpu_supports("avx2") != 0;
  if (wide) {
    run_wide(*this, question, p, answer);
    return answer;
  }
#endif
  run_plain(*this, question, p, answer);
  return answer;
}

}  // namespace polypod::quality
