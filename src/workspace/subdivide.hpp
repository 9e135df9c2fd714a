// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Adaptive subdivision of a box of positions against all directions at once, for any machine whose limits give bounds.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "clip.hpp"
#include "half_space.hpp"
#include "patches.hpp"
#include "polypod/workspace/shape.hpp"

namespace polypod::workspace {

/// A limit over a cell and a patch: for all x in the cell (from its middle) and all directions in the patch
///   value >= m + G . x,
/// and for some direction of the patch, for all x, value <= M + G . x.
struct Bound {
  int limit = 0;
  double m = 0, M = 0;
  Vec3 G = Vec3::Zero();
};

/// The bounds of one group: few, so they live on the stack.
class BoundList {
 public:
  void clear() { size_ = 0; }
  void resize(int size) { size_ = std::min(size, size_); }
  [[nodiscard]] int size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  /// False where there is no room; the caller then calls the group open.
  bool push_back(const Bound& bound) {
    if (size_ == kCapacity) return false;
    items_[static_cast<std::size_t>(size_++)] = bound;
    return true;
  }
  void append(const BoundList& other) {
    for (const Bound& b : other) push_back(b);
  }
  [[nodiscard]] const Bound* begin() const { return items_.data(); }
  [[nodiscard]] const Bound* end() const { return items_.data() + size_; }

 private:
  static constexpr int kCapacity = 24;
  std::array<Bound, kCapacity> items_;
  int size_ = 0;
};

enum class Verdict : std::uint8_t {
  inside,     ///< kept everywhere in the cell for all directions of the patch
  outside,    ///< for some direction of the patch broken everywhere in the cell
  dead,       ///< for all directions of the patch broken everywhere in the cell
  undecided,  ///< the bounds that were handed out say how much
  open,       ///< undecided, and no single plane bounds it (two branches are possible): counts as fully unknown
};

/// What one family has to say. Groups are sets of limits that are judged together (a leg, a pair of legs, an arm).
///   using Data;                     what a patch needs, worked out once
///   Data prepare(const Patch&);
///   int groups();                   at most 32
///   double lever();                 m, how far a turn of 1 rad moves what the limits see
///   void box(Vec3& min, Vec3& max, const Directions&); a box that holds every reachable point
///   Verdict judge(int group, const Vec3& center, const Vec3& half, double radius, const Patch&, const Data&,
///                 BoundList& out);
template <class Limits>
class Subdivision {
  using Node = PatchNode<typename Limits::Data>;
  struct Entry {
    const Node* patch;
    std::uint32_t groups;
  };
  struct Box {
    Vec3 center, half;
    double lower = 0, upper = 0;
    Vec3 min = Vec3::Zero(), max = Vec3::Zero();  ///< holds the part of the box that may be inside
    std::vector<Entry> entries;
  };
  struct Chunk {
    std::vector<Box> border;
    std::vector<Cell> inside;
    double inside_volume = 0;
    Vec3 min, max;
    std::int64_t examined = 0;
  };

 public:
  Subdivision(const Limits& limits, const Options& options) : limits_(limits), options_(options) {}

  /// Whether every point of the shape is certainly inside: true is a proof; false where a point is certainly outside or
  /// the question is not settled within `max_cells` boxes.
  bool holds(const Shape& shape, std::int64_t max_cells) {
    const auto prepare = [this](const Patch& patch) { return limits_.prepare(patch); };
    if (!root_) root_ = std::make_unique<Node>(whole_patch(options_.directions), prepare);
    Worker worker;
    std::vector<Box> stack(1);
    stack[0].center = shape.center;
    stack[0].half = shape.half;
    stack[0].entries.push_back({root_.get(), all_groups()});
    while (!stack.empty()) {
      if (--max_cells < 0) return false;
      const Box parent = std::move(stack.back());
      stack.pop_back();
      Box cell;
      cell.center = parent.center;
      cell.half = parent.half;
      const Verdict verdict = examine(parent, cell, worker, prepare);
      if (verdict == Verdict::inside) continue;
      const bool within = shape.holds_box(cell.center, cell.half);
      if (within && (verdict == Verdict::outside || cell.upper < 8 * cell.half.prod() * (1 - 1e-6))) return false;
      // An outside cell may reach out of the shape: its pieces are asked again with all that the parent knew.
      const Box& known = verdict == Verdict::outside ? parent : cell;
      for (int octant = 0; octant < 8; ++octant) {
        Box child;
        child.half = 0.5 * cell.half;
        for (int k = 0; k < 3; ++k) {
          child.center[k] = cell.center[k] + ((octant >> k & 1) != 0 ? child.half[k] : -child.half[k]);
        }
        if (!shape.meets_box(child.center, child.half)) continue;
        child.entries = known.entries;
        stack.push_back(std::move(child));
      }
    }
    return true;
  }

  Result<Volume> run() {
    const auto start = std::chrono::steady_clock::now();
    const auto prepare = [this](const Patch& patch) { return limits_.prepare(patch); };
    const Node root(whole_patch(options_.directions), prepare);
    Volume out;
    Vec3 low, high;
    limits_.box(low, high, options_.directions);
    const double inf = std::numeric_limits<double>::infinity();
    Vec3 inside_min = Vec3::Constant(inf), inside_max = Vec3::Constant(-inf);
    std::vector<Box> border;
    if ((high - low).minCoeff() > 0) {
      Box first;
      first.center = 0.5 * (low + high);
      first.half = 0.5 * (high - low);
      first.upper = 8 * first.half.prod();
      first.min = low;
      first.max = high;
      first.entries.push_back({&root, all_groups()});
      border.push_back(std::move(first));
    }
    const double whole = border.empty() ? 0.0 : border.front().upper;
    double inside_volume = 0;
    for (;;) {
      double lower = inside_volume, upper = inside_volume;
      for (const Box& b : border) {
        lower += b.lower;
        upper += b.upper;
      }
      out.lower = lower;
      out.upper = upper;
      out.volume = 0.5 * (lower + upper);
      if (options_.progress) options_.progress({lower, upper, out.points});
      if (options_.cancelled && options_.cancelled()) {
        return fail("WS110", "the workspace run was cancelled");
      }
      const double target = options_.relative_tolerance * out.volume;
      // A set that stays below 1e-9 of the search box is as good as a surface: no tolerance ever fits it.
      if (border.empty() || upper - lower <= target || upper <= 1e-9 * whole) break;
      if (out.points > options_.max_cells) {
        out.converged = false;
        break;
      }
      // Boxes that hold more than half their share of the gap are split, the others may stay as they are.
      const double share = 0.5 * target / static_cast<double>(border.size());
      std::vector<Box> stay, split;
      for (Box& b : border) (b.upper - b.lower > share ? split : stay).push_back(std::move(b));
      border = std::move(stay);
      constexpr std::size_t kChunk = 32;  // fixed, so that sums do not depend on the number of threads
      const std::size_t chunks = (split.size() + kChunk - 1) / kChunk;
      std::vector<Chunk> results(chunks);
      tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t c) {
        Chunk& chunk = results[c];
        chunk.min = Vec3::Constant(inf);
        chunk.max = Vec3::Constant(-inf);
        Worker worker;
        for (std::size_t k = c * kChunk; k < std::min(split.size(), (c + 1) * kChunk); ++k) {
          refine(split[k], worker, chunk, prepare);
        }
      });
      for (Chunk& chunk : results) {
        inside_volume += chunk.inside_volume;
        inside_min = inside_min.cwiseMin(chunk.min);
        inside_max = inside_max.cwiseMax(chunk.max);
        out.points += chunk.examined;
        for (Box& b : chunk.border) border.push_back(std::move(b));
        if (options_.keep_cells) out.cells.insert(out.cells.end(), chunk.inside.begin(), chunk.inside.end());
      }
    }
    for (const Box& b : border) {
      inside_min = inside_min.cwiseMin(b.min);
      inside_max = inside_max.cwiseMax(b.max);
      if (options_.keep_cells) out.cells.push_back({b.center, b.half, b.lower, b.upper, CellState::border});
    }
    out.empty = border.empty() && inside_volume == 0;
    if (!out.empty) {
      out.min = inside_min;
      out.max = inside_max;
    }
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return out;
  }

 private:
  struct Judged {
    int group;
    Bound bound;
  };
  struct Plane {
    double m;
    Vec3 G;
    double share;  ///< of the cell on the kept side
  };
  struct Worker {
    std::vector<Entry> stack;
    BoundList bounds;
    std::vector<Judged> judged;
    std::vector<Plane> below, above;
    Polyhedron body;
  };

  /// A patch is split until it moves the limits by no more than this share of the cell's radius: then its second-order
  /// rest is no larger than the cell's.
  static constexpr double kPatchShare = 1.5;

  template <class Prepare>
  void refine(const Box& parent, Worker& worker, Chunk& chunk, const Prepare& prepare) {
    for (int octant = 0; octant < 8; ++octant) {
      Box child;
      child.half = 0.5 * parent.half;
      for (int k = 0; k < 3; ++k) {
        child.center[k] = parent.center[k] + ((octant >> k & 1) != 0 ? child.half[k] : -child.half[k]);
      }
      ++chunk.examined;
      const Verdict verdict = examine(parent, child, worker, prepare);
      if (verdict == Verdict::outside) continue;
      if (verdict == Verdict::inside) {
        const double volume = 8 * child.half.prod();
        chunk.inside_volume += volume;
        chunk.min = chunk.min.cwiseMin(child.center - child.half);
        chunk.max = chunk.max.cwiseMax(child.center + child.half);
        if (options_.keep_cells) {
          chunk.inside.push_back({child.center, child.half, volume, volume, CellState::inside});
        }
      } else {
        chunk.border.push_back(std::move(child));
      }
    }
  }

  template <class Prepare>
  Verdict examine(const Box& parent, Box& cell, Worker& worker, const Prepare& prepare) {
    const double radius = cell.half.norm();
    worker.stack.assign(parent.entries.rbegin(), parent.entries.rend());
    worker.judged.clear();
    std::uint32_t open = 0;
    while (!worker.stack.empty()) {
      Entry entry = worker.stack.back();
      worker.stack.pop_back();
      const Patch& patch = entry.patch->patch();
      const bool split = patch.turn * limits_.lever() > kPatchShare * radius;
      const std::size_t before = worker.judged.size();
      std::uint32_t left = 0, left_open = 0;
      for (std::uint32_t groups = entry.groups; groups != 0; groups &= groups - 1) {
        const int group = std::countr_zero(groups);
        worker.bounds.clear();
        const Verdict verdict =
            limits_.judge(group, cell.center, cell.half, radius, patch, entry.patch->data(), worker.bounds);
        if (verdict == Verdict::outside || verdict == Verdict::dead) return Verdict::outside;
        if (verdict == Verdict::inside) continue;
        left |= 1U << group;
        if (verdict == Verdict::open) left_open |= 1U << group;
        if (split) continue;
        for (const Bound& bound : worker.bounds) worker.judged.push_back({group, bound});
      }
      if (left == 0) continue;
      if (split) {
        worker.judged.resize(before);
        worker.stack.push_back({&entry.patch->half(1, prepare), left});
        worker.stack.push_back({&entry.patch->half(0, prepare), left});
        continue;
      }
      open |= left_open;
      entry.groups = left;
      cell.entries.push_back(entry);
    }
    if (cell.entries.empty()) return Verdict::inside;
    return enclose(cell, open, worker);
  }

  /// One pair of planes per limit from its bounds on all patches; the share of the cell between them.
  Verdict enclose(Box& cell, std::uint32_t open, Worker& worker) {
    const double volume = 8 * cell.half.prod();
    std::stable_sort(worker.judged.begin(), worker.judged.end(), [](const Judged& a, const Judged& b) {
      return a.group != b.group ? a.group < b.group : a.bound.limit < b.bound.limit;
    });
    worker.below.clear();
    worker.above.clear();
    cell.min = cell.center - cell.half;
    cell.max = cell.center + cell.half;
    for (std::size_t first = 0; first < worker.judged.size();) {
      std::size_t end = first, least_m = first, least_M = first;
      for (; end < worker.judged.size() && worker.judged[end].group == worker.judged[first].group &&
             worker.judged[end].bound.limit == worker.judged[first].bound.limit;
           ++end) {
        if (worker.judged[end].bound.m < worker.judged[least_m].bound.m) least_m = end;
        if (worker.judged[end].bound.M < worker.judged[least_M].bound.M) least_M = end;
      }
      // All directions together: value >= m + G . x with the G of the worst patch and m lowered by what the other
      // patches' gradients differ.
      const Vec3 G = worker.judged[least_m].bound.G;
      double m = worker.judged[least_m].bound.m;
      for (std::size_t k = first; k < end; ++k) {
        const Bound& b = worker.judged[k].bound;
        m = std::min(m, b.m - (b.G - G).cwiseAbs().dot(cell.half));
      }
      const double kept = share_in_half_space(m, G, cell.half, true);
      if (kept < 1) worker.below.push_back({m, G, kept});
      if ((open >> worker.judged[first].group & 1U) == 0) {
        const Bound& b = worker.judged[least_M].bound;
        const double share = share_in_half_space(b.M, b.G, cell.half, false);
        if (share < 1) worker.above.push_back({b.M, b.G, share});
        shrink(cell, b.M, b.G);
      }
      first = end;
    }
    const double upper = share_of_all(cell, worker.above, worker.body, false);
    if (upper <= 0) return Verdict::outside;
    const double lower = open != 0 ? 0.0 : share_of_all(cell, worker.below, worker.body, true);
    cell.upper = upper * volume;
    cell.lower = std::min(lower * volume, cell.upper);
    return cell.lower >= volume ? Verdict::inside : Verdict::undecided;
  }

  /// The share of the cell on the kept side of all planes, bounded on the asked side.
  static double share_of_all(const Box& cell, const std::vector<Plane>& planes, Polyhedron& body, bool below) {
    if (planes.empty()) return 1;
    double least = 1;
    for (const Plane& p : planes) least = std::min(least, p.share);
    if (planes.size() == 1 || least <= 0) return least;
    body.start(cell.half);
    for (const Plane& p : planes) {
      body.cut(p.m, p.G);
      if (body.empty()) return 0;
    }
    constexpr double kClip = 1e-9;  // rounding of the clipped body, with much to spare
    const double share = body.volume() / (8 * cell.half.prod());
    return below ? std::clamp(share - kClip, 0.0, least) : std::min(share + kClip, least);
  }

  /// Narrows cell.min..max to the part where M + G . x may be >= 0.
  static void shrink(Box& cell, double M, const Vec3& G) {
    const Vec3 a = G.cwiseAbs().cwiseProduct(cell.half);
    for (int k = 0; k < 3; ++k) {
      if (!(a[k] > 0)) continue;
      const double others = M + a.sum() - a[k];  // needs G_k x_k >= -others
      const double x = -others / G[k];
      if (G[k] > 0) cell.min[k] = std::max(cell.min[k], std::min(cell.center[k] + x, cell.center[k] + cell.half[k]));
      if (G[k] < 0) cell.max[k] = std::min(cell.max[k], std::max(cell.center[k] + x, cell.center[k] - cell.half[k]));
    }
  }

  [[nodiscard]] std::uint32_t all_groups() const {
    return limits_.groups() < 32 ? (1U << limits_.groups()) - 1 : ~0U;
  }

  const Limits& limits_;
  const Options& options_;
  std::unique_ptr<Node> root_;
};

}  // namespace polypod::workspace
