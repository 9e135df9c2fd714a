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
  int limit;
  double m, M;
  Vec3 G;
};

/// The bounds of one group: few, so they live on the stack.
class BoundList {
 public:
  BoundList() = default;
  BoundList(const BoundList& other) { append(other); }
  BoundList& operator=(const BoundList& other) {
    if (this == &other) return *this;
    clear();
    append(other);
    return *this;
  }
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
      // A set that stays below 1e-9 of the search box though it is cut finely is as good as a surface, and one below
      // 1e-18 as good as a point: no tolerance ever fits them.
      const bool a_surface = upper <= 1e-9 * whole && (border.size() > 10000 || upper <= 1e-18 * whole);
      if (border.empty() || upper - lower <= target || a_surface) break;
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
    std::size_t entry;  ///< of those pending
    int group;
    bool open;  ///< no bound
    Bound bound;
  };
  struct Plane {
    double m;
    Vec3 G;
    double share;  ///< of the cell on the kept side
  };
  struct Worker {
    std::vector<Entry> pending, next;
    BoundList bounds;
    std::vector<Judged> judged, worst, kept;
    std::vector<Plane> below, above;
    Polyhedron body;
  };

  /// A patch is split until it moves the limits by no more than this share of the cell's radius: then its second-order
  /// rest is no larger than the cell's.
  static constexpr double kPatchShare = 1.5;
  /// So many planes are cut from a cell one by one.
  static constexpr std::size_t kPlanes = 8;

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

  /// All entries of the parent on the cell, patches split as far as they matter. What stays in `cell.entries` are the
  /// patches and groups that may cut the cell; they imply all others.
  template <class Prepare>
  Verdict examine(const Box& parent, Box& cell, Worker& worker, const Prepare& prepare) {
    const double radius = cell.half.norm();
    std::vector<Entry>& pending = worker.pending;
    pending = parent.entries;
    worker.worst.clear();
    worker.kept.clear();
    bool open = false;
    while (!pending.empty()) {
      worker.judged.clear();
      for (std::size_t k = 0; k < pending.size(); ++k) {
        Entry& entry = pending[k];
        std::uint32_t left = 0;
        for (std::uint32_t groups = entry.groups; groups != 0; groups &= groups - 1) {
          const int group = std::countr_zero(groups);
          worker.bounds.clear();
          const Verdict verdict = limits_.judge(group, cell.center, cell.half, radius, entry.patch->patch(),
                                                entry.patch->data(), worker.bounds);
          if (verdict == Verdict::outside || verdict == Verdict::dead) return Verdict::outside;
          if (verdict == Verdict::inside) continue;
          left |= 1U << group;
          if (verdict == Verdict::open) {
            worker.judged.push_back({k, group, true, {}});
            continue;
          }
          for (const Bound& bound : worker.bounds) {
            worker.judged.push_back({k, group, false, bound});
            note_worst(group, bound, worker);
          }
        }
        entry.groups = left;
      }
      keep_what_matters(cell, radius, open, worker);
      worker.next.clear();
      for (const Entry& entry : pending) {
        if (entry.groups == 0) continue;
        if (entry.patch->patch().turn * limits_.lever() > kPatchShare * radius) {
          worker.next.push_back({&entry.patch->half(0, prepare), entry.groups});
          worker.next.push_back({&entry.patch->half(1, prepare), entry.groups});
        } else {
          cell.entries.push_back(entry);
        }
      }
      pending.swap(worker.next);
    }
    if (cell.entries.empty()) return Verdict::inside;
    return enclose(cell, open, worker);
  }

  /// The plane M + G . x of a limit that is lowest at the middle of the cell. Every plane of this kind holds the
  /// reachable part of the cell, whichever patch it came from.
  static void note_worst(int group, const Bound& bound, Worker& worker) {
    if (!std::isfinite(bound.M)) return;
    for (Judged& known : worker.worst) {
      if (known.group == group && known.bound.limit == bound.limit) {
        if (bound.M < known.bound.M) known.bound = bound;
        return;
      }
    }
    worker.worst.push_back({0, group, false, bound});
  }

  /// True if M + G . x >= 0 for the other implies m + G . x >= 0 for this, everywhere in the cell. As m < M for one and
  /// the same bound, by the slack for rounding, no two bounds can imply each other.
  static bool implied(const Bound& bound, const Bound& other, const Vec3& half) {
    const double size = other.G.squaredNorm();
    if (!(size > 0)) return false;
    const double scale = bound.limit == other.limit ? 1.0 : std::sqrt(bound.G.squaredNorm() / size);
    return bound.m - scale * other.M - (bound.G - scale * other.G).cwiseAbs().dot(half) >= 0;
  }

  /// Drops the groups of pending patches that the worst planes imply; of the others, those of patches that will not be
  /// split go to `worker.kept`.
  void keep_what_matters(const Box& cell, double radius, bool& open, Worker& worker) const {
    for (std::size_t first = 0; first < worker.judged.size();) {
      const std::size_t entry = worker.judged[first].entry;
      const int group = worker.judged[first].group;
      std::size_t end = first;
      bool needed = false, unknown = false;
      for (; end < worker.judged.size() && worker.judged[end].entry == entry && worker.judged[end].group == group;
           ++end) {
        const Judged& judged = worker.judged[end];
        unknown = unknown || judged.open;
        needed = needed || judged.open || std::none_of(worker.worst.begin(), worker.worst.end(), [&](const Judged& w) {
                   return implied(judged.bound, w.bound, cell.half);
                 });
      }
      Entry& owner = worker.pending[entry];
      if (!needed) {
        owner.groups &= ~(1U << group);
      } else if (!(owner.patch->patch().turn * limits_.lever() > kPatchShare * radius)) {
        open = open || unknown;
        if (!unknown)
          worker.kept.insert(worker.kept.end(), worker.judged.begin() + static_cast<std::ptrdiff_t>(first),
                             worker.judged.begin() + static_cast<std::ptrdiff_t>(end));
      }
      first = end;
    }
  }

  /// The cell's share between what all kept bounds leave certainly and what the worst planes leave at most.
  Verdict enclose(Box& cell, bool open, Worker& worker) {
    const double volume = 8 * cell.half.prod();
    worker.below.clear();
    worker.above.clear();
    cell.min = cell.center - cell.half;
    cell.max = cell.center + cell.half;
    for (const Judged& worst : worker.worst) {
      const Bound& b = worst.bound;
      const double share = share_in_half_space(b.M, b.G, cell.half, false);
      if (share < 1) worker.above.push_back({b.M, b.G, share});
      shrink(cell, b.M, b.G);
    }
    const double upper = share_of_all(cell, worker.above, worker.body, false);
    if (upper <= 0) return Verdict::outside;
    cell.upper = upper * volume;
    cell.lower = 0;
    if (!open) {
      lower_planes(cell, worker);
      cell.lower = std::min(share_of_all(cell, worker.below, worker.body, true) * volume, cell.upper);
    }
    return cell.lower >= volume ? Verdict::inside : Verdict::undecided;
  }

  /// The half spaces whose common part is certainly reachable: all kept bounds, or where they are many one a limit,
  /// with the gradient of the worst patch and lowered by what the others' gradients differ.
  static void lower_planes(const Box& cell, Worker& worker) {
    const auto add = [&](double m, const Vec3& G) {
      const double share = share_in_half_space(m, G, cell.half, true);
      if (share < 1) worker.below.push_back({m, G, share});
    };
    if (worker.kept.size() <= kPlanes) {
      for (const Judged& k : worker.kept) add(k.bound.m, k.bound.G);
      return;
    }
    std::stable_sort(worker.kept.begin(), worker.kept.end(), [](const Judged& a, const Judged& b) {
      return a.group != b.group ? a.group < b.group : a.bound.limit < b.bound.limit;
    });
    for (std::size_t first = 0; first < worker.kept.size();) {
      const Judged& head = worker.kept[first];
      std::size_t end = first, least = first;
      for (; end < worker.kept.size() && worker.kept[end].group == head.group &&
             worker.kept[end].bound.limit == head.bound.limit;
           ++end) {
        if (worker.kept[end].bound.m < worker.kept[least].bound.m) least = end;
      }
      const Vec3 G = worker.kept[least].bound.G;
      double m = worker.kept[least].bound.m;
      for (std::size_t k = first; k < end; ++k) {
        const Bound& b = worker.kept[k].bound;
        m = std::min(m, b.m - (b.G - G).cwiseAbs().dot(cell.half));
      }
      add(m, G);
      first = end;
    }
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

  [[nodiscard]] std::uint32_t all_groups() const { return limits_.groups() < 32 ? (1U << limits_.groups()) - 1 : ~0U; }

  const Limits& limits_;
  const Options& options_;
  std::unique_ptr<Node> root_;
};

}  // namespace polypod::workspace
