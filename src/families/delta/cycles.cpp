// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/cycles.hpp"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <limits>

#include "polypod/core/units.hpp"
#include "polypod/families/delta/drives.hpp"
#include "polypod/kinematics/closure.hpp"

namespace polypod::motion {
namespace {

using kinematics::LimitBits;
using machine::DeltaFamily;
using machine::LinearDelta;
using machine::RotaryDelta;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// S and its derivatives against q: a circle's point, or a rail's.
struct End {
  Vec3 S, d1, d2, d3;
};
End end_of(const RotaryDelta& m, int i, double q) {
  const Vec3 S = driven_end(m, i, q), rate = driven_end_rate(m, i, q);
  return {S, rate, m.base_joint[i] - S, -rate};
}
End end_of(const LinearDelta& m, int i, double q) {
  return {driven_end(m, i, q), driven_end_rate(m, i, q), Vec3::Zero(), Vec3::Zero()};
}

template <class M>
Sample drives(const M& m, double t, const Motion& tool) {
  Sample out;
  out.t = t;
  out.tool = tool;
  for (int i = 0; i < m.arms; ++i) {
    const machine::DriveRoots roots = drive_roots(m, i, tool.p);
    if (!roots.real()) {
      out.drive = {};
      return out;
    }
    DriveMotion& drive = out.drive[i];
    drive.q = roots.first;
    const End end = end_of(m, i, drive.q);
    const Vec3 y = tool.p + m.platform_joint[i] - m.tool - end.S;
    const double lever = y.dot(end.d1);
    drive.speed = y.dot(tool.v) / lever;
    const double w = drive.speed;
    const Vec3 y1 = tool.v - w * end.d1;
    drive.acceleration = (y1.squaredNorm() + y.dot(tool.a - w * w * end.d2)) / lever;
    const double e = drive.acceleration;
    const Vec3 y2 = tool.a - e * end.d1 - w * w * end.d2;
    drive.jerk = (3 * y1.dot(y2) + y.dot(tool.j - 3 * w * e * end.d2 - w * w * w * end.d3)) / lever;
  }
  out.reached = true;
  return out;
}

void raise(Peaks& peaks, double speed, double acceleration, double jerk) {
  peaks.speed = std::max(peaks.speed, std::abs(speed));
  peaks.acceleration = std::max(peaks.acceleration, std::abs(acceleration));
  peaks.jerk = std::max(peaks.jerk, std::abs(jerk));
}
void raise(Peaks& tool, machine::PerArm<Peaks>& drive, int arms, const Sample& sample) {
  raise(tool, sample.tool.v.norm(), sample.tool.a.norm(), sample.tool.j.norm());
  for (int i = 0; i < arms; ++i) {
    const DriveMotion& d = sample.drive[i];
    raise(drive[i], d.speed, d.acceleration, d.jerk);
  }
}

/// Finds what a moving tool breaks, each thing once and where it begins.
template <DeltaFamily M>
class Watch {
 public:
  Watch(const M& m, const RunOptions& options) : m_(m), options_(options), p_(kinematics::nominal_parameters(m)) {}

  /// Looks at X(s); `at` gives the tool at any s, for bisecting back to the place of the last call.
  template <class At>
  void look(double s, const At& at, std::vector<Problem>& out) {
    const LimitBits fresh = broken(at(s)) & ~seen_;
    for (LimitBits bits = fresh; bits != 0; bits &= bits - 1) {
      const LimitBits bit = bits & ~(bits - 1);
      double good = last_, bad = s;
      for (int k = 0; k < kHalvings && s > last_; ++k) {
        const double middle = 0.5 * (good + bad);
        ((broken(at(middle)) & bit) != 0 ? bad : good) = middle;
      }
      out.push_back(problem(std::countr_zero(bit), bad, at(bad)));
    }
    seen_ |= fresh;
    last_ = s;
  }

 private:
  static constexpr int kHalvings = 20;
  static constexpr int kReach = 62, kSingular = 63;  // beside the limits' bits

  [[nodiscard]] LimitBits broken(const Vec3& X) const {
    machine::JointVector q(m_.arms);
    // Out of reach lies beyond a singular pose, however thin the layer before it is.
    const LimitBits singular = options_.singular > 0 ? LimitBits{1} << kSingular : 0;
    if (!drive_positions(m_, X, q.data())) return LimitBits{1} << kReach | singular;
    auto g =
        limits(m_, Pose{Mat3::Identity(), X}, std::span<const double>(q.data(), q.size()), std::span<const double>(p_));
    for (double& value : g) value += kinematics::kLimitSlack;
    LimitBits bits = kinematics::violated(g);
    if (singular != 0 && closeness(m_, X).least() < options_.singular) bits |= singular;
    return bits;
  }

  [[nodiscard]] Problem problem(int bit, double s, const Vec3& X) const {
    if (bit == kReach) return {0, s, X, "limit", inverse(m_, Pose{Mat3::Identity(), X}).reason};
    if (bit == kSingular) {
      const machine::Closeness c = closeness(m_, X);
      const char* kind = c.least() == c.elbow_gap ? "the two elbows of an arm are"
                         : c.least() == c.drop    ? "a rod is level to"
                                                  : "the two poses of the drives are";
      return {0, s, X, "singular",
              fmt::format("nearer to a singular pose than {:g} mm: {} {:.1f} mm{}", units::to_mm(options_.singular),
                          kind, units::to_mm(c.least()), c.least() == c.drop ? "" : " apart")};
    }
    return {0, s, X, "limit", limit_name(m_, bit)};
  }

  const M& m_;
  const RunOptions& options_;
  std::vector<double> p_;
  LimitBits seen_ = 0;
  double last_ = 0;
};

/// A displacement from 0 to 1 in the time 1: x, and its derivatives.
struct Step {
  double x = 0, v = 0, a = 0, j = 0;
};
Step step_at(double ramp, double smooth, double t) {
  if (t <= 0) return {};
  if (t >= 1) return {1, 0, 0, 0};
  if (t > 0.5) {
    const Step other = step_at(ramp, smooth, 1 - t);
    return {1 - other.x, other.v, -other.a, other.j};
  }
  const double rise = smooth * ramp;  // the acceleration rises, and falls, for so long
  const double V = 1 / (1 - ramp), A = V / (ramp - rise), J = A / rise;
  if (t < rise) return {J * t * t * t / 6, J * t * t / 2, J * t, J};
  const double v1 = J * rise * rise / 2, x1 = J * rise * rise * rise / 6;
  const double flat = ramp - 2 * rise;
  if (t < rise + flat) {
    const double u = t - rise;
    return {x1 + v1 * u + A * u * u / 2, v1 + A * u, A, 0};
  }
  const double v2 = v1 + A * flat, x2 = x1 + v1 * flat + A * flat * flat / 2;
  if (t < ramp) {
    const double u = t - rise - flat;
    return {x2 + v2 * u + A * u * u / 2 - J * u * u * u / 6, v2 + A * u - J * u * u / 2, A - J * u, -J};
  }
  const double x3 = x2 + v2 * rise + A * rise * rise / 2 - J * rise * rise * rise / 6;
  return {x3 + V * (t - ramp), V, 0, 0};
}
/// When the displacement is x.
double time_of(double ramp, double smooth, double x) {
  if (x >= 1) return 1;  // the end is flat: x comes close to 1 long before
  double low = 0, high = 1;
  for (int k = 0; k < 40; ++k) {
    const double middle = 0.5 * (low + high);
    (step_at(ramp, smooth, middle).x < x ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

/// Where a cycle goes: level and the lengths of its three parts.
struct Geometry {
  double lift = 0, descent = 0;
  Vec3 over;
};
Geometry geometry_of(const Cycle& cycle) {
  const double level = std::min(cycle.from.z(), cycle.to.z()) - cycle.lift;
  Vec3 over = cycle.to - cycle.from;
  over.z() = 0;
  return {cycle.from.z() - level, cycle.to.z() - level, over};
}

/// A plan of the given shape whose way over takes the time `over`.
Plan shaped(const Cycle& cycle, double ramp, double smooth, double share, double over) {
  const Geometry g = geometry_of(cycle);
  const double higher = std::max(g.lift, g.descent);
  Plan plan;
  plan.ramp = ramp;
  plan.smooth = smooth;
  plan.over = over;
  // Equal jerk in both: times with the cube root of the lengths.
  plan.up = over * share * std::cbrt(g.lift / higher);
  plan.down = over * share * std::cbrt(g.descent / higher);
  plan.over_start = plan.up * time_of(ramp, smooth, std::max(0.0, 1 - cycle.rounding / g.lift));
  plan.down_start =
      plan.over_start + over - plan.down * time_of(ramp, smooth, std::min(1.0, cycle.rounding / g.descent));
  plan.down_start = std::max(plan.down_start, plan.up);
  plan.time = std::max(plan.down_start + plan.down, plan.over_start + over);
  plan.height_at_over = std::max(0.0, g.lift - cycle.rounding);
  return plan;
}
void stretch(Plan& plan, double factor) {
  for (double* t : {&plan.time, &plan.up, &plan.over, &plan.down, &plan.over_start, &plan.down_start}) *t *= factor;
}

/// The ends of the pieces of constant jerk, in the order in which they are made; each a little before and after.
void add_changes(const Plan& plan, std::vector<double>& out) {
  const double rise = plan.ramp * plan.smooth;
  const std::array<double, 8> within{0,        rise, plan.ramp - rise, plan.ramp, 1 - plan.ramp, 1 - plan.ramp + rise,
                                     1 - rise, 1};
  constexpr double kAside = 1e-9;
  for (const auto& [start, length] :
       {std::pair{0.0, plan.up}, std::pair{plan.over_start, plan.over}, std::pair{plan.down_start, plan.down}})
    for (const double t : within)
      for (const double side : {-kAside, kAside}) out.push_back(start + length * t + side * plan.time);
}

struct Need {
  double factor = kInfinity;  ///< by which time must be stretched
  int drive = -2;             ///< of the limit that asks for it: a drive, or -1 the tool
  int order = 0;              ///< 1 speed, 2 acceleration, 3 jerk
};
/// `enough`: where more than this is needed, it does not matter how much.
template <class M>
Need need_of(const M& m, const Cycle& cycle, const Plan& plan, const MotionLimits& limits, int uniform,
             double enough = kInfinity) {
  thread_local std::vector<double> times;
  times.clear();
  add_changes(plan, times);
  for (int k = 0; k < uniform; ++k) times.push_back(plan.time * (k + 0.5) / uniform);
  Peaks tool;
  machine::PerArm<Peaks> drive{};
  for (const double t : times) {
    const Sample sample = drives(m, t, plan.tool(cycle, t));
    if (!sample.reached) return {};
    raise(tool, drive, m.arms, sample);
    const auto too_much = [&](const Peaks& peaks, const Peaks& most) {
      return peaks.speed > enough * most.speed || peaks.acceleration > enough * enough * most.acceleration ||
             peaks.jerk > enough * enough * enough * most.jerk;
    };
    if (too_much(tool, limits.tool)) return {};
    for (int i = 0; i < m.arms; ++i)
      if (too_much(drive[i], limits.drive)) return {};
  }
  Need out{0, -2, 0};
  const auto ask = [&](const Peaks& peaks, const Peaks& most, int who) {
    for (const auto& [factor, order] :
         {std::pair{peaks.speed / most.speed, 1}, std::pair{std::sqrt(peaks.acceleration / most.acceleration), 2},
          std::pair{std::cbrt(peaks.jerk / most.jerk), 3}}) {
      if (!(factor <= out.factor)) out = {factor, who, order};
    }
  };
  ask(tool, limits.tool, -1);
  for (int i = 0; i < m.arms; ++i) ask(drive[i], limits.drive, i);
  return out;
}

template <class M>
Result<Plan> plan_for(const M& m, const Cycle& cycle, const MotionLimits& limits, const RunOptions& options) {
  // Search: a pattern over the three numbers of the shape, each step accepted where the scaled time falls.
  constexpr int kRough = 8, kFine = 300, kMostTries = 120;
  std::array<double, 3> shape{0.45, 0.4, 0.5};  // ramp, smooth, share
  const std::array<double, 3> low{0.15, 0.15, 0.1}, high{0.5, 0.5, 2.0};
  int tries = 0;
  double best = kInfinity;
  const auto time_of_shape = [&](const std::array<double, 3>& s) {
    ++tries;
    const Plan plan = shaped(cycle, s[0], s[1], s[2], 1.0);
    return need_of(m, cycle, plan, limits, kRough, best / plan.time).factor * plan.time;
  };
  best = time_of_shape(shape);
  // Other starts: a cycle that speed limits, and one whose lift does.
  for (const std::array<double, 3>& start :
       {std::array{0.3, 0.4, 0.35}, std::array{0.45, 0.25, 0.35}, std::array{0.45, 0.4, 0.8}}) {
    const double time = time_of_shape(start);
    if (!(time < best)) continue;
    best = time;
    shape = start;
  }
  // Along each number, then along pairs, because the least time lies in a crease where two limits are met.
  constexpr std::array<std::array<int, 3>, 18> kDirections{{{1, 0, 0},
                                                            {-1, 0, 0},
                                                            {0, 1, 0},
                                                            {0, -1, 0},
                                                            {0, 0, 1},
                                                            {0, 0, -1},
                                                            {1, 1, 0},
                                                            {1, -1, 0},
                                                            {-1, 1, 0},
                                                            {-1, -1, 0},
                                                            {1, 0, 1},
                                                            {1, 0, -1},
                                                            {-1, 0, 1},
                                                            {-1, 0, -1},
                                                            {0, 1, 1},
                                                            {0, 1, -1},
                                                            {0, -1, 1},
                                                            {0, -1, -1}}};
  const std::array<double, 3> step{0.1, 0.1, 0.15};
  for (double scale = 2; scale > 0.1 && tries < kMostTries;) {
    bool better = false;
    for (const auto& direction : kDirections) {
      std::array<double, 3> next = shape;
      for (std::size_t k = 0; k < 3; ++k)
        next[k] = std::clamp(shape[k] + scale * direction[k] * step[k], low[k], high[k]);
      if (next == shape || tries >= kMostTries) continue;
      const double time = time_of_shape(next);
      if (!(time < best)) continue;
      best = time;
      shape = next;
      better = true;
      break;
    }
    if (!better) scale *= 0.5;
  }
  Plan out = shaped(cycle, shape[0], shape[1], shape[2], 1.0);
  Watch<M> watch(m, options);
  std::vector<Problem> problems;
  constexpr int kLooks = 100;
  for (int k = 0; k <= kLooks; ++k) {
    watch.look(
        out.time * k / kLooks, [&](double t) { return out.tool(cycle, t).p; }, problems);
  }
  if (!problems.empty()) {
    const Problem& p = problems.front();
    const Vec3 X = p.X * units::kMmPerMetre;
    return fail("MO106",
                fmt::format("the cycle cannot be run: at {:.1f}, {:.1f}, {:.1f} mm {}", X.x(), X.y(), X.z(), p.detail));
  }
  const Need need = need_of(m, cycle, out, limits, kFine);
  if (!std::isfinite(need.factor)) return fail("MO106", "the cycle passes a singular pose");
  stretch(out, need.factor);
  const char* order[] = {"", "speed", "acceleration", "jerk"};
  out.limited_by = need.drive < 0 ? fmt::format("tool {}", order[need.order])
                                  : fmt::format("drive {} {}", need.drive + 1, order[need.order]);
  return out;
}

tl::unexpected<Error> not_a_delta() {
  return fail("MO103", "motion is planned for deltas only", {},
              "name a machine of family rotary-delta or linear-delta");
}

/// Samples of tool(t) at 0 .. time, with peaks, ranges and problems.
template <class M, class Tool>
Run sampled(const M& m, double time, int count, double length, const RunOptions& options, const Tool& tool) {
  Run out;
  out.length = length;
  out.time = time;
  out.arms = m.arms;
  out.low.fill(kInfinity);
  out.high.fill(-kInfinity);
  out.clearance = kInfinity;
  Watch<M> watch(m, options);
  for (int k = 0; k < count; ++k) {
    const double t = time * k / (count - 1);
    Sample sample = drives(m, t, tool(t));
    out.clearance = std::min(out.clearance, closeness(m, sample.tool.p).least());
    const std::size_t before = out.problems.size();
    watch.look(
        t, [&](double at) { return tool(at).p; }, out.problems);
    for (std::size_t i = before; i < out.problems.size(); ++i) {
      out.problems[i].t = out.problems[i].s;
      out.problems[i].s = out.problems[i].t / time * length;
    }
    if (sample.reached) {
      raise(out.tool, out.drive, m.arms, sample);
      for (int i = 0; i < m.arms; ++i) {
        out.low[i] = std::min(out.low[i], sample.drive[i].q);
        out.high[i] = std::max(out.high[i], sample.drive[i].q);
      }
    }
    out.samples.push_back(std::move(sample));
  }
  return out;
}

Status positive(const Peaks& limits, const char* whose) {
  for (const auto& [value, what] : {std::pair{limits.speed, "speed"}, std::pair{limits.acceleration, "acceleration"},
                                    std::pair{limits.jerk, "jerk"}}) {
    if (!(value > 0) || !std::isfinite(value)) {
      return fail("MO101", fmt::format("the {} of the {} is {:g}; it must be above 0", what, whose, value));
    }
  }
  return {};
}

}  // namespace

bool has_cycles(const AnyMachine& machine) {
  return std::visit([]<class M>(const M&) { return DeltaFamily<M>; }, machine);
}

Sample drives_of(const RotaryDelta& m, double t, const Motion& tool) {
  return drives(m, t, tool);
}
Sample drives_of(const LinearDelta& m, double t, const Motion& tool) {
  return drives(m, t, tool);
}

Result<Run> run(const AnyMachine& machine, const Path& path, double speed, const RunOptions& options) {
  if (!(speed > 0) || !std::isfinite(speed)) {
    return fail("MO101", fmt::format("a speed of {:g} mm/s must be above 0", units::to_mm(speed)));
  }
  constexpr double kMostSamples = 1e6;
  const double steps = std::ceil(path.length / options.step);
  if (!(options.step > 0) || !(steps < kMostSamples)) {
    return fail("MO104", fmt::format("{:g} samples of the path are more than 1e6", steps), {}, "take a longer step");
  }
  return std::visit(
      [&](const auto& m) -> Result<Run> {
        if constexpr (!DeltaFamily<std::decay_t<decltype(m)>>) {
          return not_a_delta();
        } else {
          const auto tool = [&](double t) {
            Motion motion = path.at(speed * t);
            motion.v *= speed;
            motion.a *= speed * speed;
            motion.j *= speed * speed * speed;
            return motion;
          };
          Run out =
              sampled(m, path.length / speed, std::max(2, static_cast<int>(steps) + 1), path.length, options, tool);
          double s = 0;
          const std::vector<double> corners = path.corners();
          for (std::size_t k = 0; k < corners.size() && options.corners_are_problems; ++k) {
            s += path.segments[k].length;
            if (corners[k] <= options.corner) continue;
            out.problems.push_back(
                {s / speed, s, path.segments[k].to, "corner",
                 fmt::format("a corner of {:.1f} deg: the tool would have to stop", units::to_deg(corners[k]))});
          }
          std::stable_sort(out.problems.begin(), out.problems.end(),
                           [](const Problem& a, const Problem& b) { return a.s < b.s; });
          return out;
        }
      },
      machine);
}

Motion Plan::tool(const Cycle& cycle, double t) const {
  const Geometry g = geometry_of(cycle);
  Motion out;
  out.p = cycle.from;
  const auto add = [&](const Vec3& way, double start, double length) {
    if (!(length > 0)) return;
    const Step step = step_at(ramp, smooth, (t - start) / length);
    out.p += step.x * way;
    out.v += step.v / length * way;
    out.a += step.a / (length * length) * way;
    out.j += step.j / (length * length * length) * way;
  };
  add(Vec3(0, 0, -g.lift), 0, up);
  add(g.over, over_start, over);
  add(Vec3(0, 0, g.descent), down_start, down);
  return out;
}

Result<Plan> plan(const AnyMachine& machine, const Cycle& cycle, const MotionLimits& limits,
                  const RunOptions& options) {
  POLYPOD_TRY(positive(limits.tool, "tool"));
  POLYPOD_TRY(positive(limits.drive, "drives"));
  if (!(cycle.lift > 0) || !(cycle.rounding >= 0 && cycle.rounding <= cycle.lift)) {
    return fail("MO105", fmt::format("clearance height {:g} mm and corner blend {:g} mm: the clearance height must be "
                                     "above 0, the corner blend from 0 to the clearance height",
                                     units::to_mm(cycle.lift), units::to_mm(cycle.rounding)));
  }
  if (!((cycle.to - cycle.from).head<2>().norm() > 1e-6)) {
    return fail("MO105", "the cycle goes over from a place to itself", {}, "give two places that differ in x or y");
  }
  return std::visit(
      [&](const auto& m) -> Result<Plan> {
        if constexpr (!DeltaFamily<std::decay_t<decltype(m)>>) {
          return not_a_delta();
        } else {
          return plan_for(m, cycle, limits, options);
        }
      },
      machine);
}

Result<Run> run(const AnyMachine& machine, const Cycle& cycle, const Plan& plan, int count, const RunOptions& options) {
  if (count < 2 || count > 1'000'000) return fail("MO104", fmt::format("{} samples must be 2 to 1e6", count));
  return std::visit(
      [&](const auto& m) -> Result<Run> {
        if constexpr (!DeltaFamily<std::decay_t<decltype(m)>>) {
          return not_a_delta();
        } else {
          const auto tool = [&](double t) { return plan.tool(cycle, t); };
          double length = 0;
          for (int k = 1; k < count; ++k) {
            length += (tool(plan.time * k / (count - 1)).p - tool(plan.time * (k - 1) / (count - 1)).p).norm();
          }
          return sampled(m, plan.time, count, length, options, tool);
        }
      },
      machine);
}

LargestForces largest_forces(const AnyMachine& machine, const Dynamics& dynamics, const Cycle& cycle,
                             const Plan& plan) {
  constexpr int kInstants = 2000;
  LargestForces out;
  out.drives.resize(static_cast<std::size_t>(kinematics::joint_count(machine)));
  JointVector near;
  const auto forces_at = [&](double t) -> std::optional<JointVector> {
    const Motion tool = plan.tool(cycle, t);
    PoseSeries target;
    for (int i = 0; i < 3; ++i) {
      target.p[i] = Series(tool.p[i], tool.v[i], tool.a[i], tool.j[i]);
      for (int c = 0; c < 3; ++c) target.R(i, c) = Series(i == c ? 1.0 : 0.0);
    }
    Pose X;
    X.p = tool.p;
    const kinematics::InverseResult found =
        near.size() > 0 ? kinematics::inverse_near(machine, X, near) : kinematics::inverse(machine, X);
    const kinematics::Solution* at = near.size() > 0 || found.solutions.empty() ? nullptr : found.reachable();
    if (at == nullptr && !found.solutions.empty()) at = &found.solutions.front();
    if (at == nullptr) return std::nullopt;
    near = at->joints;
    const JointSeries motion = joint_series(machine, target, kinematics::settled(machine, X, near), near);
    if (!motion.regular) return std::nullopt;
    return drive_forces(machine, dynamics, motion);
  };
  for (int k = 0; k <= kInstants; ++k) {
    const double t = plan.time * k / kInstants;
    const std::optional<JointVector> forces = forces_at(t);
    if (!forces && !out.unknown) out.unknown = t;
    for (std::size_t i = 0; forces && i < out.drives.size(); ++i) {
      const double f = std::abs((*forces)[static_cast<Eigen::Index>(i)]);
      if (f > out.drives[i].force) out.drives[i] = {f, t};
    }
  }
  return out;
}

}  // namespace polypod::motion
