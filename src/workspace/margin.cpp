// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "margin.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "../families/judges.hpp"
#include "polypod/core/parallel.hpp"
#include "polypod/core/units.hpp"
#include "polypod/workspace/task_directions.hpp"

namespace polypod::workspace {
namespace {

/// The limits of a family at one pose, branch by branch. Each has `slots`, `kBranches`, and
/// `values(X, out)`, out[branch * slots.size() + slot]. The families' own are pose_judge(m, options), where they have
/// one, or redundant_judge(m, options) where joints are free; this is that of all others: the best of the solutions
/// that the inverse finds.
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
    std::vector<double> best, rooms;
    for (const kinematics::Solution& s : inverse(m_, target).solutions) {
      Pose X;
      if constexpr (requires { settled(m_, target, s.joints); }) {
        X = settled(m_, target, s.joints);
      } else {
        X = forward(m_, s.joints);
      }
      std::vector<double> g = limits(m_, X, joints(s.joints), std::span<const double>(p_));
      std::vector<double> here;
      for (const Slot& slot : slots)
        if (slot.limit != kOutOfReach) here.push_back(slot.scale * g[static_cast<std::size_t>(slot.limit)]);
      std::sort(here.begin(), here.end());
      if (!best.empty() && !has_more_room(here, rooms)) continue;
      rooms = std::move(here);
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
  /// By the least room, and where that is the same by the next: solutions that one limit stops alike, as both of a head
  /// whose slide comes to its end, would else take turns, and their other limits jump between the samples.
  static bool has_more_room(const std::vector<double>& a, const std::vector<double>& b) {
    constexpr double kSame = 1e-7;  // m
    for (std::size_t k = 0; k < a.size(); ++k)
      if (std::abs(a[k] - b[k]) > kSame) return a[k] > b[k];
    return false;
  }
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
  JudgeOf(Family family, const AnyMachine& machine, const Options& options, const FieldOptions& field_options)
      : family_(std::move(family)),
        task_(kinematics::task(machine)),
        required_(required(options.directions, field_options.azimuths)),
        tilt_max_(field_options.tilt_max) {
    if (!task_.places()) home_ = point_of(task_, kinematics::home_pose(machine).value_or(Pose{}));
    upright_.R.push_back(Mat3::Identity());
    upright_.lines.push_back({});
    const int steps = static_cast<int>(std::ceil(tilt_max_ / kTiltStep - 1e-9));
    for (int k = 1; k <= steps; ++k) {
      circles_.push_back(circle_of(std::min(k * kTiltStep, tilt_max_), field_options.azimuths));
    }
  }

  [[nodiscard]] Margin margin(const Vec3& p) const override { return near_home(over(required_, p), p); }

  [[nodiscard]] Margin upright(const Vec3& p) const override { return near_home(over(upright_, p), p); }

  [[nodiscard]] Margin tilt(const Vec3& p) const override {
    Margin below = over(upright_, p);
    if (below.value < 0) return {-1, below.limit};
    const std::vector<Vec3> critical = family_.critical(p);
    double from = 0;
    for (std::size_t k = 0; k < circles_.size(); ++k) {
      const int azimuths = static_cast<int>(circles_[k].R.size());
      const double end = std::min(from_circle(k) + kTiltStep, tilt_max_);
      // A hole may lie between two circles: one through each critical direction that is tilted by as much.
      std::vector<double> stops;
      for (const Vec3& axis : critical) {
        const double tilt = std::atan2(axis.head<2>().norm(), axis.z());
        if (tilt > from && tilt < end) stops.push_back(tilt);
      }
      std::sort(stops.begin(), stops.end());
      stops.push_back(end);
      for (const double to : stops) {
        const Margin here = to == end ? over(circles_[k], p) : over(circle_of(to, azimuths), p);
        if (here.value >= 0) {
          below = here;
          from = to;
          continue;
        }
        Margin stopped = here;
        const double share = border_between(
            [&](double t) {
              const Margin m = over(circle_of(from + t * (to - from), azimuths), p);
              if (m.value < 0) stopped = m;
              return m.value;
            },
            below.value, here.value, kTiltShare);
        return {from + share * (to - from), stopped.limit};
      }
    }
    return {tilt_max_, -1};
  }

 private:
  /// Angles that are coordinates end at kFromHome, a rad counting as a metre.
  [[nodiscard]] Margin near_home(Margin out, const Vec3& p) const {
    for (int k = 0; k < 3 && !task_.places(); ++k) {
      const double room = kFromHome - std::abs(p[k] - home_[k]);
      if (task_.is_angle(k) && room < out.value) out = {room, kFarFromHome};
    }
    return out;
  }

  static constexpr double kTiltStep = units::from_deg(5);
  static double from_circle(std::size_t k) { return static_cast<double>(k) * kTiltStep; }
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
    for (std::size_t d = 0; d < directed.R.size(); ++d)
      family_.values(pose_at(task_, directed.R[d], p), &values[d * row]);
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
  machine::Task task_;
  Vec3 home_ = Vec3::Zero();  ///< of a task without x, y, z
  Directed required_, upright_;
  std::vector<Directed> circles_;
  double tilt_max_;
};

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
  POLYPOD_TRY(held_by(kinematics::task(machine), machine::name_of(machine), options.directions));
  // What is wrong with directions or machine, volume() says before its first box.
  Options probe = options;
  probe.relative_tolerance = 1;
  probe.max_cells = 1;
  probe.keep_cells = false;
  probe.bounds_tolerance = 0;
  probe.progress = nullptr;
  if (has_bounds(machine)) POLYPOD_TRY(volume(machine, probe));
  return judge_unchecked(machine, options, field_options);
}

std::unique_ptr<PointJudge> judge_unchecked(const AnyMachine& machine, const Options& options,
                                            const FieldOptions& field_options) {
  return std::visit(
      [&]<class M>(const M& m) -> std::unique_ptr<PointJudge> {
        const auto with = [&]<class Own>(Own own) -> std::unique_ptr<PointJudge> {
          return std::make_unique<JudgeOf<Own>>(std::move(own), machine, options, field_options);
        };
        if constexpr (requires { pose_judge(m, options); })
          if (auto own = pose_judge(m, options)) return with(*std::move(own));
        if constexpr (requires { redundant_judge(m, options); })
          if (auto own = redundant_judge(m, options)) return with(*std::move(own));
        return with(SearchJudge<M>(m, options));
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
