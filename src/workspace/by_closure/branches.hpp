// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The parts of a machine's unknowns that may hold a solution, from box to box.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "system.hpp"

namespace polypod::workspace::by_closure {

/// A part of one unknown.
struct Span {
  double middle = 0, radius = 0;
};

/// A part of the unknowns: a piece of the core, and for each leaf the ranges that are left.
struct Branches {
  Piece core;  ///< leaves: not looked at
  std::vector<std::vector<Span>> leaves;
  [[nodiscard]] std::size_t rounds() const {
    std::size_t most = 1;
    for (const auto& leaf : leaves) most = std::max(most, leaf.size());
    return most;
  }
  [[nodiscard]] bool empty() const {
    return std::any_of(leaves.begin(), leaves.end(), [](const auto& leaf) { return leaf.empty(); });
  }
};

/// Of one box: parts that together hold every solution within the limits, and solutions to begin Newton's method at.
struct Node {
  std::vector<Branches> branches;
  std::vector<Column> seeds;
};

/// Boxes of an octree over the whole workspace, made when first asked for; boxes below the deepest share its parts.
/// They do not depend on who asks first, nor on the thread.
class BranchTree {
 public:
  explicit BranchTree(const System& system) : system_(system) {}

  /// Of the smallest box of the tree that holds the place.
  [[nodiscard]] const Node& node_over(const Place& at) const;

  /// One piece: a core and one span of each leaf.
  [[nodiscard]] Piece select(const Branches& from, std::size_t round) const;
  /// Whether a limit of that leaf, or of the core for -1, is broken all over the place.
  [[nodiscard]] bool broken_by(int owner, const std::vector<Form>& forms, const Place& at) const;

 private:
  struct Key {
    int level = 0;
    std::array<std::int64_t, 3> index{};
    friend bool operator==(const Key&, const Key&) = default;
  };
  struct KeyHash {
    std::size_t operator()(const Key& k) const;
  };
  static constexpr int kDeepest = 7;

  [[nodiscard]] Place place_of(const Key& key) const;
  const Node& node(const Key& key) const;
  [[nodiscard]] Node make(const Key& key) const;
  /// The parts of the branches that may hold a solution within the limits, halved where that says more.
  [[nodiscard]] std::vector<Branches> cover(const Place& at, const std::vector<Branches>& from, int halvings) const;
  /// Drops what holds no solution, halves leaves that are loose; `split` is the unknown of the core in which halves
  /// would say more, or -1. False where nothing is left.
  bool narrow(const Place& at, Branches& now, int& split) const;
  /// Whether a limit is decided neither way, and that for what it does not know of the unknowns.
  [[nodiscard]] bool loose(const Form& f, std::size_t limit, const Place& at, const Look& now) const;
  /// Neighbours that touch become one where the core of both together is known in first order.
  void merge(const Place& at, std::vector<Branches>& all) const;

  const System& system_;
  mutable std::mutex mutex_;
  mutable std::unordered_map<Key, std::unique_ptr<Node>, KeyHash> nodes_;
};

}  // namespace polypod::workspace::by_closure
