// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "branches.hpp"

#include <cmath>
#include <deque>

namespace polypod::workspace::by_closure {
namespace {

/// Spans that overlap or touch become one.
void join(std::vector<Span>& spans) {
  std::sort(spans.begin(), spans.end(), [](const Span& a, const Span& b) { return a.middle < b.middle; });
  std::vector<Span> out;
  for (const Span& s : spans) {
    if (!out.empty()) {
      Span& last = out.back();
      const double low = std::min(last.middle - last.radius, s.middle - s.radius),
                   high = std::max(last.middle + last.radius, s.middle + s.radius);
      if (s.middle - s.radius <= last.middle + last.radius) {
        last = {0.5 * (low + high), 0.5 * (high - low) * (1 + 1e-12)};
        continue;
      }
    }
    out.push_back(s);
  }
  spans = std::move(out);
}

}  // namespace

std::size_t BranchTree::KeyHash::operator()(const Key& k) const {
  auto h = static_cast<std::size_t>(k.level);
  for (const std::int64_t i : k.index) h = h * 0x9E3779B97F4A7C15ULL + static_cast<std::size_t>(i) + (h >> 29U);
  return h;
}

Piece BranchTree::select(const Branches& from, std::size_t round) const {
  const auto& leaves = system_.leaves();
  Piece out = from.core;
  for (std::size_t l = 0; l < leaves.size(); ++l) {
    const Span& span = from.leaves[l][std::min(round, from.leaves[l].size() - 1)];
    out.middle[leaves[l].first] = span.middle;
    out.radius[leaves[l].first] = span.radius;
  }
  return out;
}

bool BranchTree::broken_by(int owner, const std::vector<Form>& forms, const Place& at) const {
  for (std::size_t i = 0; i < forms.size(); ++i) {
    if (system_.heeds(i) && system_.owner()[i] == owner && highest(forms[i], at) < 0) return true;
  }
  return false;
}

Place BranchTree::place_of(const Key& key) const {
  const double share = std::ldexp(1.0, -key.level);
  Place out;
  out.half = 0.5 * share * (system_.high() - system_.low());
  for (int k = 0; k < 3; ++k) {
    out.center[k] = system_.low()[k] + (static_cast<double>(key.index[static_cast<std::size_t>(k)]) + 0.5) * share *
                                           (system_.high()[k] - system_.low()[k]);
  }
  // A little wider, so that a box's own octants lie within whatever the rounding.
  out.half *= 1 + 1e-9;
  out.patch = &system_.whole();
  return out;
}

const Node& BranchTree::node_over(const Place& at) const {
  const Vec3 size = system_.high() - system_.low();
  int level = kDeepest;
  for (int k = 0; k < 3; ++k) {
    level = std::min(level, static_cast<int>(std::floor(std::log2(size[k] / (2 * at.half[k])) + 1e-6)));
  }
  Key key;
  for (key.level = std::max(0, level); key.level > 0; --key.level) {
    const Place box = [&] {
      for (int k = 0; k < 3; ++k) {
        key.index[static_cast<std::size_t>(k)] =
            static_cast<std::int64_t>(std::floor(std::ldexp((at.center[k] - system_.low()[k]) / size[k], key.level)));
      }
      return place_of(key);
    }();
    if (((at.center - box.center).cwiseAbs() + at.half).cwiseQuotient(box.half).maxCoeff() <= 1 + 1e-12) break;
  }
  if (key.level <= 0) key = Key();
  return node(key);
}

const Node& BranchTree::node(const Key& key) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto known = nodes_.find(key); known != nodes_.end()) return *known->second;
  }
  auto made = std::make_unique<Node>(make(key));
  const std::lock_guard lock(mutex_);
  return *nodes_.try_emplace(key, std::move(made)).first->second;
}

Node BranchTree::make(const Key& key) const {
  const Place at = place_of(key);
  Node from;
  if (key.level > 0) {
    Key above = key;
    --above.level;
    for (std::int64_t& i : above.index) i >>= 1;
    from = node(above);
  } else {
    Branches all;
    all.core = system_.root();
    for (const auto& [j, row] : system_.leaves())
      all.leaves.push_back({{system_.root().middle[j], system_.root().radius[j]}});
    from.branches = {all};
  }
  Node out;
  constexpr int kAtFirst = 400, kLater = 12;
  out.branches = cover(at, from.branches, key.level == 0 ? kAtFirst : kLater);
  const auto add_seed = [&](Column u) {
    Look last;
    if (!system_.solve(at, u, last)) return;
    const bool known = std::any_of(out.seeds.begin(), out.seeds.end(),
                                   [&](const Column& other) { return (other - u).cwiseAbs().maxCoeff() < 1e-6; });
    if (!known && out.seeds.size() < 8) out.seeds.push_back(u);
  };
  if (out.branches.empty()) return out;
  out.seeds = from.seeds;
  constexpr std::size_t kTries = 6;
  for (std::size_t k = 0; k < std::min(kTries, out.branches.size()) && out.seeds.empty(); ++k) {
    add_seed(select(out.branches[k * out.branches.size() / std::min(kTries, out.branches.size())], k).middle);
  }
  constexpr int kCoarse = 4;
  if (key.level <= kCoarse && (out.seeds.empty() || key.level <= 2)) {
    for (const Column& u : system_.solutions(at)) add_seed(u);
  }
  return out;
}

std::vector<Branches> BranchTree::cover(const Place& at, const std::vector<Branches>& from, int halvings) const {
  constexpr std::size_t kMostPieces = 200;
  std::deque<Branches> open(from.begin(), from.end());
  std::vector<Branches> out;
  while (!open.empty()) {
    Branches now = std::move(open.back());
    open.pop_back();
    int split = -1;
    if (!narrow(at, now, split)) continue;
    if (split < 0 || halvings <= 0 || out.size() + open.size() >= kMostPieces) {
      out.push_back(std::move(now));
      continue;
    }
    --halvings;
    // Not in the middle, where symmetric machines have their solutions.
    constexpr double kFirst = 0.46;
    for (const double share : {kFirst, 1 - kFirst}) {
      Branches part = now;
      part.core.middle[split] += (share == kFirst ? kFirst - 1 : kFirst) * now.core.radius[split];
      part.core.radius[split] *= share * (1 + 1e-12);
      open.push_front(std::move(part));
    }
  }
  merge(at, out);
  return out;
}

void BranchTree::merge(const Place& at, std::vector<Branches>& all) const {
  Look both;
  for (std::size_t a = 0; a < all.size(); ++a) {
    for (std::size_t b = a + 1; b < all.size();) {
      const Piece &one = all[a].core, &other = all[b].core;
      Branches hull = all[a];
      bool touch = true;
      for (const int j : system_.core()) {
        const double low = std::min(one.middle[j] - one.radius[j], other.middle[j] - other.radius[j]),
                     high = std::max(one.middle[j] + one.radius[j], other.middle[j] + other.radius[j]);
        touch = touch && std::abs(one.middle[j] - other.middle[j]) <= one.radius[j] + other.radius[j] + 1e-12;
        hull.core.middle[j] = 0.5 * (low + high);
        hull.core.radius[j] = 0.5 * (high - low) * (1 + 1e-12);
      }
      if (touch) {
        for (std::size_t l = 0; l < system_.leaves().size(); ++l) {
          hull.leaves[l].insert(hull.leaves[l].end(), all[b].leaves[l].begin(), all[b].leaves[l].end());
          join(hull.leaves[l]);
        }
        system_.look(at, select(hull, 0), both, nullptr);
        touch = !both.none && both.regular;
      }
      if (!touch) {
        ++b;
        continue;
      }
      for (const int j : system_.core()) {
        hull.core.middle[j] = both.narrowed.middle[j];
        hull.core.radius[j] = both.narrowed.radius[j];
      }
      all[a] = std::move(hull);
      all.erase(all.begin() + static_cast<std::ptrdiff_t>(b));
      b = a + 1;
    }
  }
}

bool BranchTree::narrow(const Place& at, Branches& now, int& split) const {
  const std::size_t leaves = system_.leaves().size();
  Look look_now;
  std::vector<Form> forms;
  // The core by itself, with the first spans of the leaves.
  for (int k = 0; k < 4 && !system_.core().empty(); ++k) {
    system_.look(at, select(now, 0), look_now, nullptr);
    if (look_now.none) return false;
    double kept = 1;
    for (const int j : system_.core()) {
      if (now.core.radius[j] > 0) kept = std::min(kept, look_now.narrowed.radius[j] / now.core.radius[j]);
      now.core.middle[j] = look_now.narrowed.middle[j];
      now.core.radius[j] = look_now.narrowed.radius[j];
    }
    if (kept > 0.7) break;
  }
  split = -1;
  double widest = 0;
  const auto core_may = [&] {
    for (const int j : system_.core()) {
      const double share = now.core.radius[j] / system_.root().radius[j];
      const bool driven =
          look_now.regular && now.core.radius[j] <= 2 * spread(look_now.domain, look_now.follows.slope, j);
      if (driven || !(share > 1e-6) || share <= widest) continue;
      widest = share;
      split = j;
    }
  };
  // Each leaf's spans: narrowed, dropped, halved where the core is as good as it gets.
  constexpr std::size_t kMostSpans = 4;
  constexpr int kPasses = 2;
  bool core_is_loose = false;
  for (int pass = 0; pass < kPasses; ++pass) {
    std::vector<std::vector<Span>> next(leaves);
    bool halved = false;
    for (std::size_t round = 0; round < now.rounds(); ++round) {
      const Piece piece = select(now, round);
      system_.look(at, piece, look_now, &forms);
      if (look_now.none || broken_by(-1, forms, at)) return false;
      if (round == 0 && pass == 0) {
        core_may();
        for (std::size_t i = 0; i < system_.limit_count(); ++i)
          core_is_loose = core_is_loose || (system_.owner()[i] < 0 && loose(forms[i], i, at, look_now));
      }
      for (std::size_t l = 0; l < leaves; ++l) {
        if (round >= now.leaves[l].size() || look_now.leaf_none[l]) continue;
        if (broken_by(static_cast<int>(l), forms, at)) continue;
        const int j = system_.leaves()[l].first;
        const Span span{look_now.narrowed.middle[j], look_now.narrowed.radius[j]};
        bool wide = false;
        for (std::size_t i = 0; i < system_.limit_count(); ++i) {
          wide = wide || (system_.owner()[i] == static_cast<int>(l) && loose(forms[i], i, at, look_now));
        }
        const bool driven =
            look_now.leaf_regular[l] && span.radius <= 2 * spread(look_now.domain, look_now.follows.slope, j);
        if (wide) core_is_loose = true;
        if (!wide || driven || split >= 0 || next[l].size() + 2 > kMostSpans ||
            !(span.radius > 1e-6 * system_.root().radius[j])) {
          next[l].push_back(span);
        } else {
          next[l].push_back({span.middle - 0.5 * span.radius, 0.5 * span.radius * (1 + 1e-12)});
          next[l].push_back({span.middle + 0.5 * span.radius, 0.5 * span.radius * (1 + 1e-12)});
          halved = true;
        }
      }
    }
    now.leaves = std::move(next);
    if (now.empty()) return false;
    if (!halved) break;
  }
  if (!core_is_loose) split = -1;
  // Neighbours that touch and are small are one again.
  for (auto& leaf : now.leaves) join(leaf);
  return true;
}

bool BranchTree::loose(const Form& f, std::size_t limit, const Place& at, const Look& now) const {
  if (!system_.heeds(limit) || lowest(f, at) >= 0) return false;
  return !(f.rest <= 0.5 * spread(now.domain, f.slope.data()));
}

}  // namespace polypod::workspace::by_closure
