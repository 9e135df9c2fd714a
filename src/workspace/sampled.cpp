// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Workspaces of machines without bounds, from a sample.
#include <fmt/format.h>

#include <array>
#include <chrono>
#include <cmath>

#include "margin.hpp"
#include "polypod/core/random.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "polypod/workspace/volume.hpp"

namespace polypod::workspace {
namespace {

constexpr std::int64_t kMostPoints = 60'000;

/// A grid of cells with two points in each.
class Sample {
 public:
  Sample(const Vec3& low, const Vec3& high, int along_longest) : low_(low) {
    const double side = (high - low).maxCoeff() / along_longest;
    for (int k = 0; k < 3; ++k) {
      cells_[static_cast<std::size_t>(k)] = std::max(1, static_cast<int>(std::ceil((high - low)[k] / side - 1e-9)));
      size_[k] = (high - low)[k] / cells_[static_cast<std::size_t>(k)];
    }
  }
  [[nodiscard]] std::size_t points() const {
    return 2 * static_cast<std::size_t>(cells_[0]) * static_cast<std::size_t>(cells_[1]) *
           static_cast<std::size_t>(cells_[2]);
  }
  [[nodiscard]] const Vec3& cell() const { return size_; }
  /// Its place is drawn by its number alone, so that threads do not matter.
  [[nodiscard]] Vec3 at(std::size_t point) const {
    const std::size_t cell = point / 2, across = static_cast<std::size_t>(cells_[0]), deep = cell / across;
    Random random(1, point);
    const Vec3 index(static_cast<double>(cell % across),
                     static_cast<double>(deep % static_cast<std::size_t>(cells_[1])),
                     static_cast<double>(deep / static_cast<std::size_t>(cells_[1])));
    const Vec3 within(random.uniform(0, 1), random.uniform(0, 1), random.uniform(0, 1));
    return low_ + (index + within).cwiseProduct(size_);
  }

 private:
  Vec3 low_, size_ = Vec3::Zero();
  std::array<int, 3> cells_{1, 1, 1};
};

/// Where points can be: the machine's reach, of a task without x, y, z that of its lengths, and its angles near home.
machine::Reach box_of_points(const AnyMachine& machine) {
  const machine::Reach whole = kinematics::reach(machine);
  const machine::Task task = kinematics::task(machine);
  if (task.places()) return whole;
  const Vec3 home = point_of(task, kinematics::home_pose(machine).value_or(Pose{}));
  machine::Reach out;
  for (int k = 0; k < 3; ++k) {
    if (k >= coordinates_of_points(task)) {
      out.low[k] = -kAcross;
      out.high[k] = kAcross;
      continue;
    }
    const auto coordinate = static_cast<Eigen::Index>(task[k]);
    out.low[k] = task.is_angle(k) ? home[k] - kFromHome : whole.low[coordinate];
    out.high[k] = task.is_angle(k) ? home[k] + kFromHome : whole.high[coordinate];
  }
  return out;
}

struct Hits {
  double sum = 0, differences = 0;  ///< of points; of cells with one point in and one out
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 high = Vec3::Constant(-std::numeric_limits<double>::infinity());
  [[nodiscard]] bool any() const { return sum > 0; }
};

}  // namespace

Result<Volume> sampled_volume(const AnyMachine& machine, const Options& options) {
  const auto begin = std::chrono::steady_clock::now();
  const std::vector<Mat3> orientations = sampled_orientations(options.directions);
  Volume out;
  out.proven = false;
  Reached seen{Vec3::Constant(std::numeric_limits<double>::infinity()),
               Vec3::Constant(-std::numeric_limits<double>::infinity())};
  const auto take = [&](const Sample& sample) -> Result<Hits> {
    std::vector<std::uint8_t> in(sample.points());
    const auto done = out.points;
    POLYPOD_TRY(in_rounds(
        options, in.size(),
        [&](std::size_t i) { in[i] = reaches_samples(machine, options, orientations, sample.at(i)); },
        [&](double share) {
          if (!options.progress) return;
          Progress p;
          p.cells = done + static_cast<std::int64_t>(share * static_cast<double>(in.size()));
          p.lower = out.lower;
          p.upper = out.upper;
          p.sampled = true;
          options.progress(p);
        }));
    out.points += static_cast<std::int64_t>(in.size());
    Hits hits;
    for (std::size_t i = 0; i < in.size(); ++i) {
      if (i % 2 == 1 && in[i] != in[i - 1]) ++hits.differences;
      if (in[i] == 0) continue;
      ++hits.sum;
      const Vec3 p = sample.at(i);
      hits.low = hits.low.cwiseMin(p);
      hits.high = hits.high.cwiseMax(p);
    }
    seen.min = seen.min.cwiseMin(hits.low);
    seen.max = seen.max.cwiseMax(hits.high);
    return hits;
  };
  // Where it is: the box of what is reached, one cell wider, looked at again where it is much smaller, or where what is
  // reached comes to a side of it: a few points of a large box say little of how far it goes.
  const machine::Reach reach = box_of_points(machine);
  Vec3 low = reach.low, high = reach.high;
  const auto fit = [&](const Hits& hits, const Vec3& cell) {
    const Vec3 size = high - low;
    Vec3 from = hits.low - cell, to = hits.high + cell;
    bool grows = false;
    for (int k = 0; k < 3; ++k) {
      if (hits.low[k] < low[k] + cell[k] && low[k] > reach.low[k]) {
        from[k] = low[k] - size[k] / 2;
        grows = true;
      }
      if (hits.high[k] > high[k] - cell[k] && high[k] < reach.high[k]) {
        to[k] = high[k] + size[k] / 2;
        grows = true;
      }
    }
    low = reach.low.cwiseMax(from);
    high = reach.high.cwiseMin(to);
    return grows;
  };
  for (int round = 0; round < 12; ++round) {
    constexpr int kScout = 12, kFiner = 20;
    Sample sample(low, high, kScout);
    POLYPOD_ASSIGN(hits, take(sample));
    if (!hits.any()) {
      sample = Sample(low, high, kFiner);
      POLYPOD_ASSIGN(finer, take(sample));
      hits = finer;
    }
    if (!hits.any()) {
      out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
      return out;
    }
    const double old = (high - low).prod();
    if (!fit(hits, sample.cell()) && (high - low).prod() > 0.5 * old) break;
  }
  out.converged = false;
  const std::int64_t most = std::min(kMostPoints, options.max_cells);
  constexpr double kGrows = 1.4, kSigmas = 1.96;
  constexpr double kFewest = 30;  // cells that differ: with fewer the interval is no normal one
  for (double along = 10; !out.converged; along *= kGrows) {
    const Sample sample(low, high, static_cast<int>(along));
    if (along > 10 && static_cast<std::int64_t>(sample.points()) > most) break;
    POLYPOD_ASSIGN(hits, take(sample));
    const double cell = sample.cell().prod();
    out.volume = 0.5 * cell * hits.sum;
    const double error = 0.5 * cell * std::sqrt(std::max(hits.differences, 1.0));
    out.lower = std::max(0.0, out.volume - kSigmas * error);
    out.upper = out.volume + kSigmas * error;
    out.min = reach.low.cwiseMax(seen.min - sample.cell());
    out.max = reach.high.cwiseMin(seen.max + sample.cell());
    out.converged = hits.differences >= kFewest && kSigmas * error <= 0.5 * options.relative_tolerance * out.volume;
  }
  if (!out.converged) out.stopped = Stopped::cells;
  out.reached = seen;
  out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return out;
}

}  // namespace polypod::workspace
