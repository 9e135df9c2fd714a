// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Adaptive subdivision of a box of positions against all directions at once, for any machine whose limits give bounds.
#pragma once

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "clip.hpp"
#include "half_space.hpp"
#include "patches.hpp"
#include "polypod/core/memory.hpp"
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
///   std::size_t bytes(const Data&); that a patch's data holds outside of itself
///   int axes();                     of a box that count: the first so many (3 without)
///   std::int64_t boxes_of_sides();  at most, for the extents (without: as many as the volume took, 100 000 at least)
///   LimitBits ends();               the limits without which nothing ends the workspace
///   void box(Vec3& min, Vec3& max, const Directions&); a box that holds every reachable point where these are heeded
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

    [[nodiscard]] std::size_t bytes() const { return sizeof(Box) + kHeapBlock + entries.capacity() * sizeof(Entry); }
    /// A half in each of the first `axes` directions.
    [[nodiscard]] Box octant(int which, int axes) const {
      Box child;
      child.half = half;
      child.center = center;
      for (int k = 0; k < axes; ++k) {
        child.half[k] = 0.5 * half[k];
        child.center[k] = center[k] + ((which >> k & 1) != 0 ? child.half[k] : -child.half[k]);
      }
      return child;
    }
  };
  /// Gives the data of a patch and counts the patches that are kept.
  struct Maker {
    const Limits* limits;
    std::atomic<std::int64_t>* patches;
    auto operator()(const Patch& patch) const { return limits->prepare(patch); }
    void kept(int count) const { patches->fetch_add(count, std::memory_order_relaxed); }
  };
  /// Points that are certainly inside: none where min > max.
  struct Hull {
    Vec3 min = Vec3::Constant(kInfinity), max = Vec3::Constant(-kInfinity);
    void add(const Vec3& low, const Vec3& high) {
      min = min.cwiseMin(low);
      max = max.cwiseMax(high);
    }
    [[nodiscard]] bool empty() const { return !(min.array() <= max.array()).all(); }
  };
  struct Chunk {
    std::vector<Box> border;
    std::vector<Cell> inside;
    double inside_volume = 0;
    Hull reached;
    std::int64_t examined = 0;
  };
  /// All that a run knows.
  struct State {
    std::deque<Box> border;
    double inside_volume = 0, whole = 0;
    Hull reached;
    std::size_t bytes = 0;  ///< of the border
  };

 public:
  Subdivision(const Limits& limits, const Options& options)
      : limits_(limits), options_(options), axes_(axes_of(limits)), resident_(resident_memory()) {}

  /// Whether every point of the shape is certainly inside: true is a proof; false where a point is certainly outside or
  /// the question is not settled within `max_cells` boxes.
  bool holds(const Shape& shape, std::int64_t max_cells) {
    plant();
    Worker worker;
    std::vector<Box> stack(1);
    stack[0].center = shape.center;
    stack[0].half = shape.half;
    stack[0].entries.push_back({root_.get(), all_groups()});
    const std::size_t patch = sizeof(Node) + kHeapBlock + limits_.bytes(root_->data());
    while (!stack.empty()) {
      if (--max_cells < 0 || !fits(static_cast<std::size_t>(patches_.load()) * patch)) return false;
      const Box parent = std::move(stack.back());
      stack.pop_back();
      Box cell;
      cell.center = parent.center;
      cell.half = parent.half;
      const Verdict verdict = examine(parent, cell, worker);
      if (verdict == Verdict::inside) continue;
      const bool within = shape.holds_box(cell.center, cell.half);
      if (within && (verdict == Verdict::outside || cell.upper < 8 * cell.half.prod() * (1 - 1e-6))) return false;
      // An outside cell may reach out of the shape: its pieces are asked again with all that the parent knew.
      const Box& known = verdict == Verdict::outside ? parent : cell;
      for (int octant = 0; octant < 1 << axes_; ++octant) {
        Box child = cell.octant(octant, axes_);
        if (!shape.meets_box(child.center, child.half)) continue;
        child.entries = known.entries;
        stack.push_back(std::move(child));
      }
    }
    return true;
  }

  Result<Volume> run(bool unfinished_sides) {
    const auto start = std::chrono::steady_clock::now();
    plant();
    Volume out;
    State state = first_box();
    POLYPOD_TRY(subdivide(state, out));
    for (const Box& b : state.border) {
      if (options_.keep_cells) out.cells.push_back({b.center, b.half, b.lower, b.upper, CellState::border});
    }
    out.empty = state.border.empty() && state.inside_volume == 0;
    if (!out.empty && (unfinished_sides || out.stopped != Stopped::cells)) POLYPOD_TRY(bound(state, out));
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
    std::vector<Entry> pending, next, settled;
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

  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  static constexpr std::size_t kHeapBlock = 16;  // what an allocation costs beside its bytes
  static constexpr std::size_t kChunk = 32;      // fixed, so that sums do not depend on the number of threads

  static int axes_of(const Limits& limits) {
    if constexpr (requires { limits.axes(); }) return limits.axes();
    return 3;
  }

  void plant() {
    if (!root_) root_ = std::make_unique<Node>(whole_patch(options_.directions), Maker{&limits_, &patches_});
  }

  [[nodiscard]] State first_box() const {
    State state;
    Vec3 low, high;
    limits_.box(low, high, options_.directions);
    if (!((high - low).minCoeff() > 0)) return state;
    Box first;
    first.center = 0.5 * (low + high);
    first.half = 0.5 * (high - low);
    first.upper = state.whole = 8 * first.half.prod();
    first.min = low;
    first.max = high;
    first.entries.push_back({root_.get(), all_groups()});
    state.bytes = first.bytes();
    state.border.push_back(std::move(first));
    return state;
  }

  /// What the boxes hold, and where it is a lot, what the process has grown by: it comes in pieces of many sizes.
  [[nodiscard]] std::size_t memory(const State& state, const Volume& out) const {
    constexpr std::size_t kLot = 200'000'000;
    const std::size_t patch = sizeof(Node) + kHeapBlock + limits_.bytes(root_->data());
    const std::size_t held =
        state.bytes + out.cells.capacity() * sizeof(Cell) + static_cast<std::size_t>(patches_.load()) * patch;
    const std::size_t now = held > kLot / 4 ? resident_memory() : 0, grown = now > resident_ ? now - resident_ : 0;
    return grown > kLot ? std::max(held, grown) : held;
  }
  [[nodiscard]] bool fits(std::size_t bytes) const { return options_.max_memory == 0 || bytes <= options_.max_memory; }

  /// What the boxes say of the volume, and the gap that is asked for.
  [[nodiscard]] double sum(const State& state, Volume& out) const {
    out.lower = out.upper = state.inside_volume;
    for (const Box& b : state.border) {
      out.lower += b.lower;
      out.upper += b.upper;
    }
    out.volume = 0.5 * (out.lower + out.upper);
    return options_.relative_tolerance * out.volume;
  }
  [[nodiscard]] Status report(const State& state, const Volume& out) const {
    if (options_.progress) {
      const double gap = out.upper - out.lower, target = options_.relative_tolerance * out.volume;
      const auto bytes = static_cast<double>(memory(state, out));
      // The gap falls with the square of the box, and so as the number of boxes of a surface rises.
      options_.progress(
          {out.lower, out.upper, out.points, bytes, target > 0 ? bytes * std::max(1.0, gap / target) : 0});
    }
    if (options_.cancelled && options_.cancelled()) return fail("WS110", "the workspace run was cancelled");
    return {};
  }

  /// Splits the boxes with the largest gaps until the volume is known to the tolerance.
  Status subdivide(State& state, Volume& out) {
    for (;;) {
      const double target = sum(state, out);
      POLYPOD_TRY(report(state, out));
      // A set that stays below 1e-9 of the search box though it is cut finely is as good as a surface, and one below
      // 1e-18 as good as a point: no tolerance ever fits them.
      const bool a_surface =
          out.upper <= 1e-9 * state.whole && (state.border.size() > 10000 || out.upper <= 1e-18 * state.whole);
      if (state.border.empty() || out.upper - out.lower <= target || a_surface) return {};
      if (out.points > options_.max_cells) out.stopped = Stopped::cells;
      if (out.stopped == Stopped::no) POLYPOD_TRY(split_largest(state, out, target));
      if (out.stopped == Stopped::no) continue;
      (void)sum(state, out);
      out.converged = false;
      out.memory_estimate = static_cast<double>(memory(state, out)) * (out.upper - out.lower) / target;
      return {};
    }
  }

  /// Boxes that hold more than half their share of the gap are split, the largest first, until the others leave no more
  /// than the gap that is asked for; in waves, so that the memory is watched, progress is told and a cancelled run ends
  /// soon. Coarse runs, which look for the extents of a workspace, finish their rounds: they take little time, and the
  /// extents come out closer.
  Status split_largest(State& state, Volume& out, double target) {
    const double share = 0.5 * target / static_cast<double>(state.border.size());
    std::vector<std::size_t> split;
    for (std::size_t k = 0; k < state.border.size(); ++k) {
      if (state.border[k].upper - state.border[k].lower > share) split.push_back(k);
    }
    const auto gap_of = [&](std::size_t k) { return state.border[k].upper - state.border[k].lower; };
    std::stable_sort(split.begin(), split.end(), [&](std::size_t a, std::size_t b) { return gap_of(a) > gap_of(b); });
    constexpr std::size_t kWave = 1024, kLeastWave = 64, kWaves = 16;  // a round has about as many
    const std::size_t usual = std::clamp(split.size() / kWaves, kLeastWave, kWave);
    constexpr double kCoarse = 0.1;
    const double enough = options_.relative_tolerance < kCoarse ? target : 0;
    double gap = out.upper - out.lower;
    std::size_t done = 0;
    bool close = false;
    while (done < split.size() && !close) {
      std::size_t wave = std::min(usual, split.size() - done);
      if (options_.max_memory > 0) {  // as many as fit if every octant stays, with twice the patches
        const std::size_t used = memory(state, out), room = std::max(options_.max_memory, used) - used;
        std::size_t fit = 0;
        for (std::size_t taken = 0; fit < wave; ++fit) {
          taken += 16 * state.border[split[done + fit]].bytes();
          if (taken > room) break;
        }
        wave = fit;
      }
      if (wave == 0) break;
      const std::size_t known = state.border.size();
      for (std::size_t n = done; n < done + wave; ++n) gap -= gap_of(split[n]);
      refine_all(std::span(split).subspan(done, wave), state, out);
      for (std::size_t k = known; k < state.border.size(); ++k) gap += gap_of(k);
      done += wave;
      close = gap <= enough;
      POLYPOD_TRY(report(state, out));
    }
    if (done < split.size() && !close) out.stopped = Stopped::memory;
    split.resize(done);
    std::sort(split.begin(), split.end());
    drop(split, state.border);
    return {};
  }

  /// Takes out the boxes of rising indices; the others keep their order.
  static void drop(const std::vector<std::size_t>& which, std::deque<Box>& boxes) {
    std::size_t kept = 0, next = 0;
    for (std::size_t k = 0; k < boxes.size(); ++k) {
      if (next < which.size() && which[next] == k) {
        ++next;
      } else if (kept++ != k) {
        boxes[kept - 1] = std::move(boxes[k]);
      }
    }
    boxes.resize(kept);
  }

  /// Puts what is left of the boxes at the end; they themselves give up their memory but keep their places.
  void refine_all(std::span<const std::size_t> which, State& state, Volume& out) {
    std::vector<Chunk> results((which.size() + kChunk - 1) / kChunk);
    tbb::parallel_for(std::size_t{0}, results.size(), [&](std::size_t c) {
      Worker worker;
      for (std::size_t k = c * kChunk; k < std::min(which.size(), (c + 1) * kChunk); ++k) {
        refine(state.border[which[k]], worker, results[c]);
      }
    });
    for (const std::size_t k : which) {
      state.bytes -= state.border[k].bytes();
      state.border[k] = Box();
    }
    for (Chunk& chunk : results) {
      state.inside_volume += chunk.inside_volume;
      state.reached.add(chunk.reached.min, chunk.reached.max);
      out.points += chunk.examined;
      for (Box& b : chunk.border) {
        state.bytes += b.bytes();
        state.border.push_back(std::move(b));
      }
      if (options_.keep_cells) out.cells.insert(out.cells.end(), chunk.inside.begin(), chunk.inside.end());
    }
  }

  void refine(const Box& parent, Worker& worker, Chunk& chunk) {
    for (int octant = 0; octant < 1 << axes_; ++octant) {
      Box child = parent.octant(octant, axes_);
      ++chunk.examined;
      const Verdict verdict = examine(parent, child, worker);
      if (verdict == Verdict::outside) continue;
      if (verdict == Verdict::inside) {
        const double volume = 8 * child.half.prod();
        chunk.inside_volume += volume;
        chunk.reached.add(child.center - child.half, child.center + child.half);
        if (options_.keep_cells) {
          chunk.inside.push_back({child.center, child.half, volume, volume, CellState::inside});
        }
      } else {
        chunk.border.push_back(std::move(child));
      }
    }
  }

  // The six sides ----------------------------------------------------------------------------------------------------

  /// One side of the set: the largest value of sign * p[axis], between `reached` and that of the box that may hold the
  /// farthest point. Best first: the box that may reach farthest is split.
  struct Side {
    struct Candidate {
      double far;
      std::int64_t order;  ///< makes the choice among equals the same every time
      const Box* box;
      std::unique_ptr<Box> own;
      bool operator<(const Candidate& other) const { return far != other.far ? far < other.far : order > other.order; }
    };
    int axis = 0;
    double sign = 1;
    std::vector<Candidate> heap;
    Hull found;  ///< points that this side's search saw to be inside
    std::int64_t examined = 0, order = 0;
    std::size_t bytes = 0;

    [[nodiscard]] double far(const Vec3& min, const Vec3& max) const { return sign > 0 ? max[axis] : -min[axis]; }
    [[nodiscard]] double reached() const { return far(found.min, found.max); }
    [[nodiscard]] double outer() const { return heap.empty() ? reached() : std::max(reached(), heap.front().far); }
    void push(const Box* box, std::unique_ptr<Box> own) {
      const double value = far(box->min, box->max);
      if (!(value > reached())) return;
      bytes += sizeof(Candidate) + (own ? own->bytes() : 0);
      heap.push_back({value, order++, box, std::move(own)});
      std::push_heap(heap.begin(), heap.end());
    }
    Candidate pop() {
      std::pop_heap(heap.begin(), heap.end());
      Candidate top = std::move(heap.back());
      heap.pop_back();
      bytes -= sizeof(Candidate) + (top.own ? top.own->bytes() : 0);
      return top;
    }
  };

  /// Lets go of boxes that reach no farther than what is certainly inside: they say nothing of the sides, and their
  /// memory is needed.
  static void let_go(State& state) {
    const Hull& reached = state.reached;
    std::vector<std::size_t> within;
    for (std::size_t k = 0; k < state.border.size(); ++k) {
      const Box& b = state.border[k];
      if (!((b.min.array() >= reached.min.array()).all() && (b.max.array() <= reached.max.array()).all())) continue;
      within.push_back(k);
      state.bytes -= b.bytes();
    }
    drop(within, state.border);
  }

  /// The box that holds the set, and the points of it that are farthest out, until both are the same to the tolerance
  /// or as many boxes again as the volume took (at least 100 000) were looked at.
  Status bound(State& state, Volume& out) {
    let_go(state);
    std::array<Side, 6> sides;
    // Each side keeps a list of the boxes; where there is no room for them, the boxes bound the set as they are.
    if (!fits(memory(state, out) + 2 * sides.size() * state.border.size() * sizeof(typename Side::Candidate))) {
      Hull all = state.reached;
      for (const Box& b : state.border) all.add(b.min, b.max);
      if (all.empty()) return nothing(out);
      out.min = all.min;
      out.max = all.max;
      if (!state.reached.empty()) out.reached = Reached{state.reached.min, state.reached.max};
      return {};
    }
    for (std::size_t s = 0; s < sides.size(); ++s) {
      Side& side = sides[s];
      side.axis = static_cast<int>(s / 2);
      side.sign = s % 2 == 0 ? -1 : 1;
      side.found = state.reached;
      for (const Box& b : state.border) side.push(&b, nullptr);
    }
    constexpr std::int64_t kLeastBudget = 100'000;
    std::int64_t budget = std::max(kLeastBudget, out.points);
    if constexpr (requires { limits_.boxes_of_sides(); }) budget = limits_.boxes_of_sides();
    for (std::int64_t examined = 0;;) {
      Hull reached;
      for (const Side& side : sides) reached.add(side.found.min, side.found.max);
      std::size_t bytes = memory(state, out);
      for (Side& side : sides) {
        side.found = reached;
        if (!std::isfinite(side.outer())) return nothing(out);
        (side.sign > 0 ? out.max : out.min)[side.axis] = side.sign * side.outer();
        bytes += side.bytes;
      }
      if (!reached.empty()) out.reached = Reached{reached.min, reached.max};
      const double near = options_.bounds_tolerance * (out.max - out.min).maxCoeff();
      const bool more = std::any_of(sides.begin(), sides.end(), [&](const Side& side) { return open(side, near); });
      if (!more || !(options_.bounds_tolerance > 0) || examined > budget || !fits(bytes)) return {};
      POLYPOD_TRY(report(state, out));
      tbb::parallel_for(std::size_t{0}, sides.size(), [&](std::size_t s) { advance(sides[s], near); });
      examined = 0;
      for (const Side& side : sides) examined += side.examined;
    }
  }

  /// No box is left: the finer look proved that there is no point at all.
  static Status nothing(Volume& out) {
    out.empty = true;
    out.converged = true;
    out.stopped = Stopped::no;
    out.volume = out.lower = out.upper = 0;
    out.min = out.max = Vec3::Zero();
    return {};
  }

  static bool open(const Side& side, double near) {
    return !side.heap.empty() && !(side.heap.front().far - side.reached() <= near);
  }

  /// Splits some boxes of a side.
  void advance(Side& side, double near) {
    constexpr int kAtOnce = 32;
    Worker worker;
    for (int k = 0; k < kAtOnce && open(side, near); ++k) {
      const typename Side::Candidate top = side.pop();
      for (int octant = 0; octant < 1 << axes_; ++octant) {
        auto child = std::make_unique<Box>(top.box->octant(octant, axes_));
        ++side.examined;
        const Verdict verdict = examine(*top.box, *child, worker);
        if (verdict == Verdict::outside) continue;
        if (verdict == Verdict::inside) {
          side.found.add(child->center - child->half, child->center + child->half);
        } else if (narrow(*top.box, *child, worker, side.found)) {
          const Box* box = child.get();
          side.push(box, std::move(child));
        }
      }
    }
  }

  /// Narrows the hull of an undecided cell to the corners of what its planes leave, and adds the corners of the part
  /// that is certainly inside to `found`. False where nothing is left.
  static bool narrow(const Box& parent, Box& cell, Worker& worker, Hull& found) {
    constexpr double kRound = 1e-10;  // rounding of the corners, of the cell
    const double slack = kRound * cell.half.norm();
    const auto cut = [&](const std::vector<Plane>& planes) {
      worker.body.start(cell.half);
      for (const Plane& p : planes) worker.body.cut(p.m, p.G);
      return !worker.body.empty();
    };
    Vec3 low, high;
    if (!cut(worker.above)) return false;
    worker.body.hull(low, high);
    cell.min = cell.min.cwiseMax(cell.center + low - Vec3::Constant(slack)).cwiseMax(parent.min);
    cell.max = cell.max.cwiseMin(cell.center + high + Vec3::Constant(slack)).cwiseMin(parent.max);
    if (cell.lower > 0 && cut(worker.below)) {
      worker.body.hull(low, high);
      found.add(cell.center + low + Vec3::Constant(slack), cell.center + high - Vec3::Constant(slack));
    }
    return true;
  }

  /// All entries of the parent on the cell, patches split as far as they matter. What stays in `cell.entries` are the
  /// patches and groups that may cut the cell; they imply all others.
  Verdict examine(const Box& parent, Box& cell, Worker& worker) {
    const double radius = cell.half.norm();
    const Maker maker{&limits_, &patches_};
    std::vector<Entry>& pending = worker.pending;
    pending = parent.entries;
    worker.settled.clear();
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
          worker.next.push_back({&entry.patch->half(0, maker), entry.groups});
          worker.next.push_back({&entry.patch->half(1, maker), entry.groups});
        } else {
          worker.settled.push_back(entry);
        }
      }
      pending.swap(worker.next);
    }
    if (worker.settled.empty()) return Verdict::inside;
    cell.entries.assign(worker.settled.begin(), worker.settled.end());  // no room to spare: there are many cells
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
  int axes_;
  std::size_t resident_;                          // bytes, when the run began
  mutable std::atomic<std::int64_t> patches_{0};  ///< that were kept
  std::unique_ptr<Node> root_;
};

/// Subdivision::run and ::holds of one family's limits. `unfinished_sides`: the sides are looked for though so many
/// boxes did not reach the tolerance; else `min` to `max` say nothing then. They take long to compile: those of most
/// families are in source files of their own.
template <class Limits>
Result<Volume> subdivided_volume(const Limits& limits, const Options& options, bool unfinished_sides) {
  tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
  return arena.execute([&] { return Subdivision<Limits>(limits, options).run(unfinished_sides); });
}
template <class Limits>
Result<bool> subdivided_holds(const Limits& limits, const Options& options, const Shape& shape,
                              std::int64_t max_cells) {
  return Subdivision<Limits>(limits, options).holds(shape, max_cells);
}

}  // namespace polypod::workspace
