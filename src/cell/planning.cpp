// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cell/planning.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <set>

#include "sum_of_ways.hpp"

namespace polypod::cell {
namespace {

constexpr double kSame = 1e-9;

using Node = std::pair<int, int>;

/// Puts stations one by one onto the nodes of a grid.
template <class Neighbours, class Point, class Gain>
std::vector<Node> grow(const std::vector<std::size_t>& first, const std::vector<Node>& at, std::size_t count,
                       const Neighbours& neighbours, const Point& point,
                       const std::function<std::size_t(const std::vector<bool>&)>& next, const Gain& gain) {
  std::vector<Node> nodes(count);
  std::vector<bool> placed(count, false);
  std::set<Node> taken;
  for (std::size_t k = 0; k < first.size(); ++k) {
    nodes[first[k]] = at[k];
    placed[first[k]] = true;
    taken.insert(at[k]);
  }
  for (std::size_t k = first.size(); k < count; ++k) {
    const std::size_t station = next(placed);
    Vec2 middle = Vec2::Zero();
    for (const Node& n : taken) middle += point(n) / static_cast<double>(taken.size());
    std::set<Node> free;
    for (const Node& n : taken)
      for (const Node& other : neighbours(n))
        if (!taken.contains(other)) free.insert(other);
    const Node* best = nullptr;
    double best_gain = 0, best_distance = 0;
    for (const Node& n : free) {
      const double g = gain(station, n, placed, nodes), d = (point(n) - middle).norm();
      if (best == nullptr || g > best_gain + kSame || (g > best_gain - kSame && d < best_distance - kSame)) {
        best = &n;
        best_gain = g;
        best_distance = d;
      }
    }
    nodes[station] = *best;
    placed[station] = true;
    taken.insert(*best);
  }
  return nodes;
}

Vec2 triangle_point(const Node& n) {
  return {n.first + 0.5 * n.second, std::numbers::sqrt3 / 2 * n.second};
}
std::vector<Node> triangle_neighbours(const Node& n) {
  std::vector<Node> out;
  for (const auto& [q, r] : {Node{1, 0}, {0, 1}, {-1, 1}, {-1, 0}, {0, -1}, {1, -1}})
    out.emplace_back(n.first + q, n.second + r);
  return out;
}

double adjacency(const Node& a, const Node& b) {
  const int dx = std::abs(a.first - b.first), dy = std::abs(a.second - b.second);
  if (dx + dy == 1) return 1;
  return dx == 1 && dy == 1 ? 0.5 : 0;
}

}  // namespace

FlowMatrix flow_matrix(std::size_t stations, const std::vector<Flow>& flows) {
  const auto n = static_cast<Eigen::Index>(stations);
  FlowMatrix out = FlowMatrix::Zero(n, n);
  for (const Flow& f : flows) {
    out(f.from, f.to) += f.amount;
    out(f.to, f.from) += f.amount;
  }
  return out;
}

double transport(const FlowMatrix& flows, const std::vector<Vec2>& places) {
  double sum = 0;
  for (Eigen::Index i = 0; i < flows.rows(); ++i)
    for (Eigen::Index k = i + 1; k < flows.cols(); ++k)
      if (flows(i, k) != 0)
        sum += flows(i, k) * (places[static_cast<std::size_t>(i)] - places[static_cast<std::size_t>(k)]).norm();
  return sum;
}

std::vector<Vec2> best_assignment(const FlowMatrix& flows, const std::vector<Vec2>& places, bool fix_first) {
  const std::size_t n = places.size();
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), 0);
  // Distances once: the enumeration only looks them up.
  Eigen::MatrixXd distance(n, n);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = 0; k < n; ++k)
      distance(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = (places[i] - places[k]).norm();
  double best = std::numeric_limits<double>::infinity();
  std::vector<std::size_t> best_order = order;
  do {
    double sum = 0;
    for (std::size_t i = 0; i < n && sum < best; ++i)
      for (std::size_t k = i + 1; k < n; ++k)
        sum += flows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) *
               distance(static_cast<Eigen::Index>(order[i]), static_cast<Eigen::Index>(order[k]));
    if (sum < best - kSame) {
      best = sum;
      best_order = order;
    }
  } while (std::next_permutation(order.begin() + (fix_first && n > 0 ? 1 : 0), order.end()));
  std::vector<Vec2> out;
  for (const std::size_t k : best_order) out.push_back(places[k]);
  return out;
}

namespace {

void add_best(Plan& plan, const FlowMatrix& flows, bool fix_first, const char* from) {
  if (plan.places.size() > kMostEnumerated) return;
  plan.best_places = best_assignment(flows, plan.places, fix_first);
  plan.best = transport(flows, plan.best_places);
  plan.best_is = from;
}

}  // namespace

Plan triangular(const FlowMatrix& flows) {
  Plan out;
  out.method = "triangular method";
  out.measure = "flow times distance on a grid of triangles of side 1";
  const auto n = static_cast<std::size_t>(flows.rows());
  if (n == 0) return out;
  const auto flow = [&](std::size_t i, std::size_t k) {
    return flows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
  };
  std::vector<std::size_t> first{0};
  double largest = -1;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = i + 1; k < n; ++k) {
      if (!(flow(i, k) > largest)) continue;
      largest = flow(i, k);
      first = {i, k};
    }
  }
  const auto next = [&](const std::vector<bool>& placed) {
    std::size_t best = n;
    double best_flow = 0, best_total = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (placed[i]) continue;
      double sum = 0;
      for (std::size_t k = 0; k < n; ++k)
        if (placed[k]) sum += flow(i, k);
      const double total = flows.row(static_cast<Eigen::Index>(i)).sum();
      if (best == n || sum > best_flow + kSame || (sum > best_flow - kSame && total > best_total + kSame)) {
        best = i;
        best_flow = sum;
        best_total = total;
      }
    }
    return best;
  };
  const auto gain = [&](std::size_t station, const Node& node, const std::vector<bool>& placed,
                        const std::vector<Node>& nodes) {
    double sum = 0;
    for (std::size_t k = 0; k < n; ++k)
      if (placed[k]) sum -= flow(station, k) * (triangle_point(node) - triangle_point(nodes[k])).norm();
    return sum;
  };
  const std::vector<Node> nodes = grow(first, {{0, 0}, {1, 0}}, n, triangle_neighbours, triangle_point, next, gain);
  for (const Node& node : nodes) out.places.push_back(triangle_point(node));
  out.score = transport(flows, out.places);
  add_best(out, flows, false, "all assignments to the same nodes");
  return out;
}

Plan circle(const FlowMatrix& flows) {
  Plan out;
  out.method = "circle method";
  out.measure = "flow times chord of a circle on which neighbours are 1 apart";
  const auto n = static_cast<std::size_t>(flows.rows());
  const double radius = n > 1 ? 0.5 / std::sin(std::numbers::pi / static_cast<double>(n)) : 0;
  for (std::size_t k = 0; k < n; ++k) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(n);
    out.places.emplace_back(radius * std::sin(angle), radius * std::cos(angle));
  }
  out.score = transport(flows, out.places);
  for (;;) {
    double best = out.score - 1e-9 * std::max(1.0, out.score);
    std::pair<std::size_t, std::size_t> swap{0, 0};
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t k = i + 1; k < n; ++k) {
        std::swap(out.places[i], out.places[k]);
        const double score = transport(flows, out.places);
        std::swap(out.places[i], out.places[k]);
        if (score < best) {
          best = score;
          swap = {i, k};
        }
      }
    }
    if (swap.first == swap.second) break;
    std::swap(out.places[swap.first], out.places[swap.second]);
    out.score = transport(flows, out.places);
  }
  add_best(out, flows, true, "all orders on the circle");
  return out;
}

Plan coordinates(const FlowMatrix& flows, const std::vector<Station>& stations) {
  Plan out;
  out.method = "coordinate method";
  out.measure = "flow times distance, m an hour";
  const auto n = stations.size();
  for (const Station& s : stations) out.places.emplace_back(s.at.x(), s.at.y());
  const auto flow = [&](std::size_t i, std::size_t k) {
    return flows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
  };
  constexpr int kMost = 20000;
  constexpr double kWithin = 1e-10;  // m
  for (int round = 0; round < kMost; ++round) {
    double moved = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (stations[i].fixed) continue;
      Vec2 sum = Vec2::Zero();
      double weight = 0;
      for (std::size_t k = 0; k < n; ++k) {
        if (k == i || !(flow(i, k) > 0)) continue;
        sum += flow(i, k) * out.places[k];
        weight += flow(i, k);
      }
      if (!(weight > 0)) continue;
      const Vec2 to = sum / weight;
      moved = std::max(moved, (to - out.places[i]).norm());
      out.places[i] = to;
    }
    if (moved < kWithin) break;
  }
  out.score = transport(flows, out.places);
  if (std::all_of(stations.begin(), stations.end(), [](const Station& s) { return s.fixed; })) {
    out.best = out.score;
    out.best_places = out.places;
    out.best_is = "the present places: no station is free (fixed = false)";
    return out;
  }
  LeastWays least = least_ways(flows, stations);
  out.best = least.sum;
  out.best_places = std::move(least.places);
  out.bound = least.bound;
  out.best_is = "all places of the free stations";
  return out;
}

double closeness_value(char closeness) {
  switch (closeness) {
    case 'A':
      return 4;
    case 'E':
      return 3;
    case 'I':
      return 2;
    case 'O':
      return 1;
    case 'X':
      return -1;
    default:
      return 0;
  }
}

std::vector<Relation> relations_of(const FlowMatrix& flows) {
  std::vector<Relation> out;
  const double largest = flows.size() > 0 ? flows.maxCoeff() : 0;
  if (!(largest > 0)) return out;
  for (Eigen::Index i = 0; i < flows.rows(); ++i) {
    for (Eigen::Index k = i + 1; k < flows.cols(); ++k) {
      const double share = flows(i, k) / largest;
      const char letter = share >= 0.8 ? 'A' : share >= 0.6 ? 'E' : share >= 0.4 ? 'I' : share >= 0.2 ? 'O' : 'U';
      if (letter != 'U') out.push_back({static_cast<int>(i), static_cast<int>(k), letter, "flow"});
    }
  }
  return out;
}

Plan systematic(std::size_t n, const std::vector<Relation>& relations) {
  Plan out;
  out.method = "Systematic Layout Planning";
  out.measure = "closeness times adjacency";
  out.larger_is_better = true;
  if (n == 0) return out;
  const auto size = static_cast<Eigen::Index>(n);
  Eigen::MatrixXd value = Eigen::MatrixXd::Zero(size, size);
  for (const Relation& r : relations) value(r.a, r.b) = value(r.b, r.a) = closeness_value(r.closeness);
  const auto of = [&](std::size_t i, std::size_t k) {
    return value(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
  };
  const auto total = [&](std::size_t i) { return value.row(static_cast<Eigen::Index>(i)).sum(); };
  std::size_t first = 0;
  for (std::size_t i = 1; i < n; ++i)
    if (total(i) > total(first) + kSame) first = i;
  const auto next = [&](const std::vector<bool>& placed) {
    std::size_t best = n;
    std::array<double, 3> best_key{};
    for (std::size_t i = 0; i < n; ++i) {
      if (placed[i]) continue;
      double closest = -std::numeric_limits<double>::infinity(), sum = 0;
      for (std::size_t k = 0; k < n; ++k) {
        if (!placed[k]) continue;
        closest = std::max(closest, of(i, k));
        sum += of(i, k);
      }
      const std::array key{closest, sum, total(i)};
      if (best == n || key > best_key) {
        best = i;
        best_key = key;
      }
    }
    return best;
  };
  const auto neighbours = [](const Node& at) {
    std::vector<Node> list;
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy)
        if (dx != 0 || dy != 0) list.emplace_back(at.first + dx, at.second + dy);
    return list;
  };
  const auto point = [](const Node& at) { return Vec2(at.first, at.second); };
  const auto gain = [&](std::size_t station, const Node& node, const std::vector<bool>& placed,
                        const std::vector<Node>& nodes) {
    double sum = 0;
    for (std::size_t k = 0; k < n; ++k)
      if (placed[k]) sum += of(station, k) * adjacency(node, nodes[k]);
    return sum;
  };
  const std::vector<Node> nodes = grow({first}, {{0, 0}}, n, neighbours, point, next, gain);
  const auto score = [&](const std::vector<Node>& at) {
    double sum = 0;
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t k = i + 1; k < n; ++k) sum += of(i, k) * adjacency(at[i], at[k]);
    return sum;
  };
  out.score = score(nodes);
  for (const Node& node : nodes) out.places.push_back(point(node));
  if (n <= kMostEnumerated) {
    std::vector<std::size_t> order(n);
    std::iota(order.begin(), order.end(), 0);
    std::vector<Node> at(n), best_at = nodes;
    double best = out.score;
    do {
      for (std::size_t k = 0; k < n; ++k) at[k] = nodes[order[k]];
      const double s = score(at);
      if (s <= best + kSame) continue;
      best = s;
      best_at = at;
    } while (std::next_permutation(order.begin(), order.end()));
    out.best = best;
    for (const Node& node : best_at) out.best_places.push_back(point(node));
    out.best_is = "all assignments to the same cells";
  }
  return out;
}

std::string rounded_down(double bound) {
  constexpr int kDigits = 6;
  if (!(bound > 0)) return "0";
  const double unit = std::pow(10.0, std::floor(std::log10(bound)) + 1 - kDigits);
  return fmt::format("{:.{}g}", std::floor(bound / unit) * unit, kDigits);
}

Planning planning(const Cell& cell, const std::vector<Flow>& flows) {
  Planning out;
  for (const Station& s : cell.stations) out.stations.push_back(s.name);
  constexpr std::size_t kMostPlanned = 50;
  if (cell.stations.size() > kMostPlanned) return out;
  out.flows_given = !cell.flows.empty();
  out.flows = flow_matrix(cell.stations.size(), out.flows_given ? cell.flows : flows);
  out.chart_given = !cell.relations.empty();
  out.relations = out.chart_given ? cell.relations : relations_of(out.flows);
  std::vector<Vec2> present;
  for (const Station& s : cell.stations) present.emplace_back(s.at.x(), s.at.y());
  out.present = transport(out.flows, present);
  out.plans = {triangular(out.flows), circle(out.flows), coordinates(out.flows, cell.stations),
               systematic(cell.stations.size(), out.relations)};
  return out;
}

}  // namespace polypod::cell
