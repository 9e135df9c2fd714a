// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "margin.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "polypod/core/parallel.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"

namespace polypod::workspace {
namespace {

using machine::kLegs;

/// What a branch that does not exist here says of its other limits.
constexpr double kUnknown = 1e3;

/// A limit that is looked at: its index and what its value is multiplied with to give m.
struct Slot {
  int limit = 0;
  double scale = 1;
};

/// The limits that are heeded and given.
template <class M>
std::vector<Slot> slots_of(const M& m, const Options& options) {
  std::vector<Slot> out;
  const machine::LimitTable table = limit_table(m);
  for (std::size_t i = 0; i < table.size(); ++i) {
    if ((options.limits >> i & 1U) == 0 || !table[i].given || (table[i].between_bodies && !options.interference))
      continue;
    out.push_back({static_cast<int>(i), table[i].scale});
  }
  return out;
}

/// The limits of a family at one pose, branch by branch. Each has `slots`, `kBranches`, and
/// `values(X, out)`, out[branch * slots.size() + slot].
template <class Hexapod>
class HexapodJudge {
 public:
  static constexpr int kBranches = 1;
  std::vector<Slot> slots;

  HexapodJudge(const Hexapod& m, const Options& options)
      : slots(slots_of(m, options)), m_(m), p_(kinematics::nominal_parameters(m)) {
    if constexpr (requires { m.rail_length; }) slots.push_back({kOutOfReach, 1});
  }

  /// Limits of hexapods have no holes between the samples.
  [[nodiscard]] static std::vector<Vec3> critical(const Vec3&) { return {}; }

  void values(const Pose& X, double* out) const {
    machine::JointVector q(kLegs);
    double reach = kUnknown;
    if constexpr (requires { m_.rail_length; }) {
      const Vec3 origin = X.p - m_.tool_length * X.R.col(2);
      for (int i = 0; i < kLegs; ++i) {
        const Vec3& u = m_.rail_direction[i];
        const Vec3 y = origin + X.R * m_.platform_joint[i] - m_.rail_outer[i];
        const double along = u.dot(y), across = (y - along * u).norm();
        reach = std::min(reach, m_.length_of_leg(i) - across);
        const double half = std::sqrt(std::max(0.0, m_.length_of_leg(i) * m_.length_of_leg(i) - across * across));
        // The root nearer the outer end where both are on the rail, else the one nearer the rail.
        const auto off = [&](double at) { return std::max({-at, at - m_.rail_length[i], 0.0}); };
        q[i] = off(along + half) < off(along - half) ? along + half : along - half;
      }
    } else {
      machine::lengths(m_, X, q.data());
    }
    const std::vector<double> g = limits(m_, X, std::span<const double>(q.data(), kLegs), std::span<const double>(p_));
    for (const Slot& slot : slots)
      *out++ = slot.limit == kOutOfReach ? reach : slot.scale * g[static_cast<std::size_t>(slot.limit)];
  }

 private:
  const Hexapod& m_;
  std::vector<double> p_;
};

/// Arms with the closed wrist inverse: any of its branches may keep the limits.
class ArmJudge {
 public:
  static constexpr int kBranches = machine::WristInverse::kBranches;
  std::vector<Slot> slots;

  ArmJudge(const machine::WristInverse& inverse, LimitBits heeded) : inverse_(inverse), f_(inverse.form()) {
    const double size = std::abs(f_.a1) + f_.a2 + std::abs(f_.d4) + f_.reach;
    for (int i = 0; i < 10; ++i) {
      const auto joint = static_cast<std::size_t>(i / 2);
      const bool whole_turn = f_.max[joint] - f_.min[joint] >= 2 * std::numbers::pi - 1e-9;
      if ((heeded >> i & 1U) != 0 && !whole_turn) slots.push_back({i, size});
    }
    slots.push_back({kOutOfReach, 1});
  }

  /// The tool axes that lie along the forearm. A limit of joint 5 just short of that forbids a thin cone round them,
  /// which samples miss. In the plane of the arm, elbow = p + L k with L = reach +- d4, at the distance a2 from
  /// joint 2.
  [[nodiscard]] std::vector<Vec3> critical(const Vec3& p_M) const {
    std::vector<Vec3> out;
    const Vec3 p = f_.X_BM * p_M;
    const double r = std::hypot(p.x(), p.y());
    if (!(r > 0)) return out;
    const Vec3 along(p.x() / r, p.y() / r, 0);
    const Eigen::Vector2d to_tip(r, p.z() - f_.d1);
    for (const double side : {1.0, -1.0})
      for (const double L : {f_.reach + f_.d4, f_.reach - f_.d4}) {
        const Eigen::Vector2d from_joint = to_tip - Eigen::Vector2d(side * f_.a1, 0);
        const double distance = from_joint.norm();
        const double cosine = (f_.a2 * f_.a2 - distance * distance - L * L) / (2 * L * distance);
        if (!(std::abs(cosine) <= 1)) continue;
        const double middle = std::atan2(from_joint.y(), from_joint.x()), turn = std::acos(cosine);
        for (const double angle : {middle + turn, middle - turn}) {
          const Vec3 k = std::cos(angle) * along + std::sin(angle) * Vec3::UnitZ();
          out.push_back(f_.X_BM.R.transpose() * k);
        }
      }
    return out;
  }

  void values(const Pose& X, double* out) const {
    machine::WristInverse::Branches branches;
    const Vec3 k = X.R.col(2);
    inverse_.solve(X.p, k, branches);
    const Vec3 c = f_.X_BM * X.p + f_.reach * (f_.X_BM.R * k);
    const double r = std::hypot(c.x(), c.y()), height = c.z() - f_.d1;
    for (int b = 0; b < kBranches; ++b) {
      const double rho = ((b & 2) == 0 ? r : -r) - f_.a1, distance = std::hypot(rho, height);
      const double reach = std::min(f_.a2 + std::abs(f_.d4) - distance, distance - std::abs(f_.a2 - std::abs(f_.d4)));
      for (const Slot& slot : slots) {
        if (slot.limit == kOutOfReach) {
          *out++ = reach;
        } else if (!branches.exists[b]) {
          *out++ = kUnknown;
        } else {
          const auto joint = static_cast<std::size_t>(slot.limit / 2);
          const double q = branches.joints[b][slot.limit / 2];
          *out++ = slot.scale * (slot.limit % 2 == 0 ? q - f_.min[joint] : f_.max[joint] - q);
        }
      }
    }
  }

 private:
  machine::WristInverse inverse_;
  machine::WristInverse::Form f_;
};

/// Deltas, on the first roots of their drives. A turned tool is out of reach.
template <machine::DeltaFamily M>
class DeltaJudge {
 public:
  static constexpr int kBranches = 1;
  std::vector<Slot> slots;

  DeltaJudge(const M& m, const Options& options)
      : slots(slots_of(m, options)),
        m_(m),
        singular_(options.singular_distance),
        p_(kinematics::nominal_parameters(m)) {
    slots.push_back({kOutOfReach, 1});
    if (singular_ > 0) slots.push_back({kNearSingular, 1});
  }
  [[nodiscard]] static std::vector<Vec3> critical(const Vec3&) { return {}; }

  void values(const Pose& X, double* out) const {
    if (!X.R.isIdentity(1e-9)) {
      std::fill_n(out, slots.size(), -kUnknown);
      return;
    }
    machine::JointVector q(m_.arms);
    double reach = kUnknown;
    for (int i = 0; i < m_.arms; ++i) {
      const machine::DriveRoots roots = drive_roots(m_, i, X.p);
      q[i] = roots.first;
      reach = std::min(reach, machine::reach_of(m_, i, X.p));
    }
    const std::vector<double> g =
        limits(m_, X, std::span<const double>(q.data(), q.size()), std::span<const double>(p_));
    for (const Slot& slot : slots) {
      if (slot.limit == kOutOfReach) {
        *out++ = reach;
      } else if (slot.limit == kNearSingular) {
        const machine::Closeness close = closeness(m_, X.p);
        *out++ = close.reached ? close.least() - singular_ : reach;
      } else {
        *out++ = slot.scale * g[static_cast<std::size_t>(slot.limit)];
      }
    }
  }

 private:
  const M& m_;
  double singular_;
  std::vector<double> p_;
};

/// Machines of legs, on the roots that they take.
class ParallelJudge {
 public:
  static constexpr int kBranches = 1;
  std::vector<Slot> slots;

  ParallelJudge(const machine::Parallel& m, const Options& options)
      : slots(slots_of(m, options)), m_(m), p_(kinematics::nominal_parameters(m)) {
    slots.push_back({kOutOfReach, 1});
  }
  [[nodiscard]] static std::vector<Vec3> critical(const Vec3&) { return {}; }

  void values(const Pose& target, double* out) const {
    const std::optional<Pose> X = settled(m_, target);
    double reach = X ? kUnknown : -kUnknown;
    machine::JointVector q(joint_count(m_));
    for (int j = 0; X && j < q.size(); ++j) {
      const machine::LegRoots roots = leg_roots(m_, driven_leg(m_, j), *X);
      if (driven_leg(m_, j).two_roots()) reach = std::min(reach, roots.under / driven_leg(m_, j).rod);
      q[j] = roots.low;
    }
    std::vector<double> g;
    if (X) {
      if (const auto taken = joints_of(m_, *X)) q = *taken;
      g = limits(m_, *X, std::span<const double>(q.data(), static_cast<std::size_t>(q.size())),
                 std::span<const double>(p_));
    }
    for (const Slot& slot : slots) {
      *out++ = slot.limit == kOutOfReach ? reach : X ? slot.scale * g[static_cast<std::size_t>(slot.limit)] : kUnknown;
    }
  }

 private:
  const machine::Parallel& m_;
  std::vector<double> p_;
};

/// Machines whose inverse is a search: the best of the solutions that it finds.
template <class M>
class SearchJudge {
 public:
  static constexpr int kBranches = 1;
  std::vector<Slot> slots;

  SearchJudge(const M& m, const Options& options)
      : slots(slots_of(m, options)), m_(m), p_(kinematics::nominal_parameters(m)) {
    slots.push_back({kOutOfReach, 1});
  }
  [[nodiscard]] static std::vector<Vec3> critical(const Vec3&) { return {}; }

  void values(const Pose& target, double* out) const {
    std::vector<double> best;
    double least = -std::numeric_limits<double>::infinity();
    for (const kinematics::Solution& s : inverse(m_, target).solutions) {
      Pose X;
      if constexpr (requires { settled(m_, target, s.joints); }) {
        X = settled(m_, target, s.joints);
      } else {
        X = forward(m_, s.joints);
      }
      std::vector<double> g = limits(m_, X, joints(s.joints), std::span<const double>(p_));
      double here = std::numeric_limits<double>::infinity();
      for (const Slot& slot : slots)
        if (slot.limit != kOutOfReach) here = std::min(here, slot.scale * g[static_cast<std::size_t>(slot.limit)]);
      if (here <= least) continue;
      least = here;
      best = std::move(g);
    }
    for (const Slot& slot : slots) {
      const double reach = best.empty() ? -kUnknown : kUnknown;
      *out++ = slot.limit == kOutOfReach ? reach
               : best.empty()            ? kUnknown
                                         : slot.scale * best[static_cast<std::size_t>(slot.limit)];
    }
  }

 private:
  static std::span<const double> joints(const machine::JointVector& q) {
    return {q.data(), static_cast<std::size_t>(q.size())};
  }

  const M& m_;
  std::vector<double> p_;
};

/// Samples on a line of directions: indices first, first + stride, ...; closed: the last is next to the first.
struct Line {
  int first = 0, count = 1, stride = 1;
  bool closed = false;
};

/// The least value on the line, between the samples too: on both sides of the least sample the parabola with the mean
/// second difference of the neighbours, or the lesser of the two where they differ much: jumps and kinks do not bend.
template <class Value>
double least_on(const Line& line, const Value& value) {
  int at = 0;
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < line.count; ++k) {
    if (const double v = value(line.first + k * line.stride); v < least) {
      least = v;
      at = k;
    }
  }
  if (line.count < 4) return least;
  const auto has = [&](int k) { return line.closed || (k >= 0 && k < line.count); };
  const auto sample = [&](int k) { return value(line.first + (k + line.count) % line.count * line.stride); };
  const auto bend = [&](int k, double otherwise) {
    return has(k - 1) && has(k + 1) ? sample(k - 1) - 2 * sample(k) + sample(k + 1) : otherwise;
  };
  for (const int side : {-1, 1}) {
    if (!has(at + side)) continue;
    const double here = bend(at, bend(at + side, 0)), there = bend(at + side, here);
    const bool smooth = here < 2 * there && there < 2 * here;
    const double c = smooth ? 0.5 * (here + there) : std::min(here, there);
    const double rise = sample(at + side) - sample(at);
    if (c > 0 && rise < 0.5 * c) least = std::min(least, sample(at) - (0.5 * c - rise) * (0.5 * c - rise) / (2 * c));
  }
  return least;
}

/// Orientations and how they neighbour each other.
struct Directed {
  std::vector<Mat3> R;
  std::vector<Line> lines;
  std::function<Mat3(const Vec3&)> nearest;  ///< that of the whole set whose tool axis is nearest to a vector; or empty
};

Mat3 tilted(double tilt, double azimuth) {
  return rotation_of(tilt * Vec3(-std::sin(azimuth), std::cos(azimuth), 0));
}

void add_circle(Directed& out, double tilt, int azimuths) {
  out.lines.push_back({static_cast<int>(out.R.size()), azimuths, 1, true});
  for (int k = 0; k < azimuths; ++k) out.R.push_back(tilted(tilt, 2 * std::numbers::pi * k / azimuths));
}

/// The tilt of a tool axis cut to a range, at its own azimuth.
Mat3 tilted_within(const Vec3& k, double low, double high) {
  return tilted(std::clamp(std::atan2(std::hypot(k.x(), k.y()), k.z()), low, high), std::atan2(k.y(), k.x()));
}

Directed circle_of(double tilt, int azimuths) {
  Directed out;
  add_circle(out, tilt, azimuths);
  out.nearest = [tilt](const Vec3& k) { return tilted_within(k, tilt, tilt); };
  return out;
}

Directed required(const Directions& directions, int azimuths) {
  Directed out;
  if (!directions.is_ranges()) {
    out.R.push_back(Mat3::Identity());
    out.lines.push_back({});
    if (directions.tilt > 0) {
      out.nearest = [tilt = directions.tilt](const Vec3& k) { return tilted_within(k, 0, tilt); };
      add_circle(out, 0.5 * directions.tilt, azimuths);
      add_circle(out, directions.tilt, azimuths);
    }
    return out;
  }
  constexpr std::array<double, 2> kNone{0, 0};
  const auto a = directions.a_range.value_or(kNone), b = directions.b_range.value_or(kNone);
  const auto count = [](const std::array<double, 2>& range) {  // at most 15 deg apart
    return range[1] > range[0] ? std::max(5, 1 + static_cast<int>(std::ceil((range[1] - range[0]) / 0.262))) : 1;
  };
  out.nearest = [a, b](const Vec3& k) {
    const double A = std::atan2(-k.y(), std::hypot(k.x(), k.z())), B = std::atan2(k.x(), k.z());
    return Mat3(rotation_y(std::clamp(B, b[0], b[1])) * rotation_x(std::clamp(A, a[0], a[1])));
  };
  const int rows = count(b), columns = count(a);
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i)
      out.R.push_back(rotation_y(b[0] + (b[1] - b[0]) * j / std::max(1, rows - 1)) *
                      rotation_x(a[0] + (a[1] - a[0]) * i / std::max(1, columns - 1)));
  for (int j = 0; j < rows; ++j) out.lines.push_back({j * columns, columns, 1, false});
  for (int i = 0; i < columns && rows > 1; ++i) out.lines.push_back({i, rows, columns, false});
  return out;
}

template <class Family>
class JudgeOf final : public PointJudge {
 public:
  JudgeOf(Family family, const Options& options, const FieldOptions& field_options)
      : family_(std::move(family)),
        required_(required(options.directions, field_options.azimuths)),
        tilt_max_(field_options.tilt_max) {
    upright_.R.push_back(Mat3::Identity());
    upright_.lines.push_back({});
    const int steps = static_cast<int>(std::ceil(tilt_max_ / kTiltStep - 1e-9));
    for (int k = 1; k <= steps; ++k) {
      circles_.push_back(circle_of(std::min(k * kTiltStep, tilt_max_), field_options.azimuths));
    }
  }

  [[nodiscard]] Margin margin(const Vec3& p) const override { return over(required_, p); }

  [[nodiscard]] Margin upright(const Vec3& p) const override { return over(upright_, p); }

  [[nodiscard]] Margin tilt(const Vec3& p) const override {
    Margin below = over(upright_, p);
    if (below.value < 0) return {-1, below.limit};
    for (std::size_t k = 0; k < circles_.size(); ++k) {
      const Margin here = over(circles_[k], p);
      if (here.value >= 0) {
        below = here;
        continue;
      }
      const double from = static_cast<double>(k) * kTiltStep;
      const double to = std::min(from + kTiltStep, tilt_max_);
      Margin stopped = here;
      Directed circle;
      const double share = border_between(
          [&](double t) {
            circle = circle_of(from + t * (to - from), static_cast<int>(circles_[k].R.size()));
            const Margin m = over(circle, p);
            if (m.value < 0) stopped = m;
            return m.value;
          },
          below.value, here.value, kTiltShare);
      return {from + share * (to - from), stopped.limit};
    }
    return {tilt_max_, -1};
  }

 private:
  static constexpr double kTiltStep = units::from_deg(5);
  static constexpr double kTiltShare = 1e-3;  // 0.005 deg: far below what a picture shows

  /// The best branch of which every limit is kept in all directions; or, if that is more, each direction on its own
  /// best branch.
  [[nodiscard]] Margin over(const Directed& sampled, const Vec3& p) const {
    if (!sampled.nearest) return over_these(sampled, p);
    const std::vector<Vec3> critical = family_.critical(p);
    if (critical.empty()) return over_these(sampled, p);
    Directed more{sampled.R, sampled.lines, {}};
    for (const Vec3& k : critical) {
      more.lines.push_back({static_cast<int>(more.R.size()), 1, 1, false});
      more.R.push_back(sampled.nearest(k));
    }
    return over_these(more, p);
  }
  [[nodiscard]] Margin over_these(const Directed& directed, const Vec3& p) const {
    const std::size_t n = family_.slots.size(), row = n * Family::kBranches;
    std::vector<double> values(directed.R.size() * row);
    for (std::size_t d = 0; d < directed.R.size(); ++d) family_.values(Pose{directed.R[d], p}, &values[d * row]);
    Margin best{-std::numeric_limits<double>::infinity(), -1};
    double best_sampled = best.value;
    for (std::size_t b = 0; b < Family::kBranches; ++b) {
      Margin least{std::numeric_limits<double>::infinity(), -1};
      double sampled = least.value;
      for (std::size_t s = 0; s < n; ++s) {
        const auto value = [&](int d) { return values[static_cast<std::size_t>(d) * row + b * n + s]; };
        double g = std::numeric_limits<double>::infinity();
        for (const Line& line : directed.lines) g = std::min(g, least_on(line, value));
        if (g < least.value) least = {g, family_.slots[s].limit};
        if (Family::kBranches > 1)
          for (std::size_t d = 0; d < directed.R.size(); ++d) sampled = std::min(sampled, value(static_cast<int>(d)));
      }
      if (least.value > best.value) best = least;
      best_sampled = std::max(best_sampled, sampled);
    }
    if (Family::kBranches == 1 || directed.R.size() == 1) return best;
    Margin mixed{std::numeric_limits<double>::infinity(), -1};
    for (std::size_t d = 0; d < directed.R.size(); ++d) {
      Margin here{-std::numeric_limits<double>::infinity(), -1};
      for (std::size_t b = 0; b < Family::kBranches; ++b) {
        Margin of_branch{std::numeric_limits<double>::infinity(), -1};
        for (std::size_t s = 0; s < n; ++s) {
          const double v = values[d * row + b * n + s];
          if (v < of_branch.value) of_branch = {v, family_.slots[s].limit};
        }
        if (of_branch.value > here.value) here = of_branch;
      }
      if (here.value < mixed.value) mixed = here;
    }
    return mixed.value > best_sampled ? mixed : best;
  }

  Family family_;
  Directed required_, upright_;
  std::vector<Directed> circles_;
  double tilt_max_;
};

Result<std::unique_ptr<PointJudge>> judge_for(const machine::SerialArm& arm, const Options& options,
                                              const FieldOptions& field_options) {
  const auto closed = machine::WristInverse::of(arm);
  if (!closed) {
    return std::make_unique<JudgeOf<SearchJudge<machine::SerialArm>>>(SearchJudge<machine::SerialArm>(arm, options),
                                                                      options, field_options);
  }
  return std::make_unique<JudgeOf<ArmJudge>>(ArmJudge(*closed, options.limits), options, field_options);
}
Result<std::unique_ptr<PointJudge>> judge_for(const machine::Stages& m, const Options& options,
                                              const FieldOptions& field_options) {
  return std::make_unique<JudgeOf<SearchJudge<machine::Stages>>>(SearchJudge<machine::Stages>(m, options), options,
                                                                 field_options);
}
Result<std::unique_ptr<PointJudge>> judge_for(const machine::Parallel& m, const Options& options,
                                              const FieldOptions& field_options) {
  return std::make_unique<JudgeOf<ParallelJudge>>(ParallelJudge(m, options), options, field_options);
}
template <class Hexapod>
Result<std::unique_ptr<PointJudge>> judge_for(const Hexapod& m, const Options& options,
                                              const FieldOptions& field_options) {
  return std::make_unique<JudgeOf<HexapodJudge<Hexapod>>>(HexapodJudge<Hexapod>(m, options), options, field_options);
}

}  // namespace

Result<std::unique_ptr<PointJudge>> judge_of(const AnyMachine& machine, const Options& options,
                                             const FieldOptions& field_options) {
  if (field_options.azimuths < 6 || field_options.azimuths > 360) {
    return fail("WS130", fmt::format("{} azimuths must be 6 to 360", field_options.azimuths));
  }
  if (!(field_options.tilt_max > 0 && field_options.tilt_max < std::numbers::pi / 2)) {
    return fail("WS130", fmt::format("the largest tilt to look for, {:g} deg, must be above 0 and below 90",
                                     units::to_deg(field_options.tilt_max)));
  }
  if (!kinematics::task(machine).places()) {
    return fail("WS107",
                fmt::format("{} does not hold x, y, z in its task: there is no field over positions",
                            machine::name_of(machine)),
                {}, "`polypod workspace` measures machines of legs in the coordinates of their task");
  }
  // What is wrong with directions or machine, volume() says before its first box.
  Options probe = options;
  probe.relative_tolerance = 1;
  probe.max_cells = 1;
  probe.keep_cells = false;
  probe.bounds_tolerance = 0;
  probe.progress = nullptr;
  if (has_bounds(machine)) POLYPOD_TRY(volume(machine, probe));
  if (auto delta = judge_of_delta(machine, options, field_options)) return delta;
  return std::visit(
      [&]<class M>(const M& m) -> Result<std::unique_ptr<PointJudge>> {
        if constexpr (machine::DeltaFamily<M>) {
          return nullptr;
        } else {
          return judge_for(m, options, field_options);
        }
      },
      machine);
}

std::unique_ptr<PointJudge> judge_of_delta(const AnyMachine& machine, const Options& options,
                                           const FieldOptions& field_options) {
  return std::visit(
      [&]<class M>(const M& m) -> std::unique_ptr<PointJudge> {
        if constexpr (machine::DeltaFamily<M>) {
          return std::make_unique<JudgeOf<DeltaJudge<M>>>(DeltaJudge<M>(m, options), options, field_options);
        }
        return nullptr;
      },
      machine);
}

Status in_rounds(const Options& options, std::size_t count, const std::function<void(std::size_t)>& task,
                 const std::function<void(double)>& progress) {
  const ParallelOptions parallel{options.threads, options.cancelled, progress};
  if (!for_each_in_rounds(count, parallel, task)) return fail("WS110", "cancelled");
  return {};
}

}  // namespace polypod::workspace
