// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/calibration/site.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "polypod/geometry/segments.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::calibration {
namespace {

using machine::OutlinePart;
using Role = OutlinePart::Role;

bool is_line(const OutlinePart& part) {
  return part.role != Role::joints;
}

/// Whether the segment meets the box, which is `wider` on all sides.
bool meets(const Box& box, double wider, const Vec3& from, const Vec3& to) {
  double enter = 0, leave = 1;
  for (int i = 0; i < 3; ++i) {
    const double low = box.low[i] - wider, high = box.high[i] + wider, way = to[i] - from[i];
    if (way == 0) {
      if (from[i] < low || from[i] > high) return false;
      continue;
    }
    const double a = (low - from[i]) / way, b = (high - from[i]) / way;
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave;
}

/// Nearest neighbour from `first`, then 2-opt and Or-opt of single ones on the open path.
class Tour {
 public:
  Tour(std::size_t count, const Eigen::MatrixXd& cost) : cost_(cost), order_(count) {}

  void start(std::size_t first) {
    std::iota(order_.begin(), order_.end(), 0);
    std::swap(order_[0], order_[first]);
    for (std::size_t k = 0; k + 2 < order_.size(); ++k) {
      const auto next = std::min_element(order_.begin() + static_cast<std::ptrdiff_t>(k) + 1, order_.end(),
                                         [&](auto a, auto b) { return way(order_[k], a) < way(order_[k], b); });
      std::iter_swap(order_.begin() + static_cast<std::ptrdiff_t>(k) + 1, next);
    }
  }
  void improve() {
    constexpr int kPasses = 100;
    for (int pass = 0; pass < kPasses && (turn_round() || move_one()); ++pass) {
    }
  }
  [[nodiscard]] double length() const {
    double sum = 0;
    for (std::size_t k = 0; k + 1 < order_.size(); ++k) sum += way(order_[k], order_[k + 1]);
    return sum;
  }
  [[nodiscard]] const std::vector<std::size_t>& order() const { return order_; }

 private:
  static constexpr double kGain = 1e-12;  // least gain, so that rounding does not go round in circles

  [[nodiscard]] double way(std::size_t a, std::size_t b) const {
    return cost_(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b));
  }
  /// To the one at place k + 1 of the path from that at k; 0 beyond its ends.
  [[nodiscard]] double link(std::ptrdiff_t k) const {
    if (k < 0 || k + 1 >= static_cast<std::ptrdiff_t>(order_.size())) return 0;
    return way(order_[static_cast<std::size_t>(k)], order_[static_cast<std::size_t>(k) + 1]);
  }
  bool turn_round() {
    bool better = false;
    const std::size_t n = order_.size();
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = i + 1; j < n; ++j) {
        double gain = 0;
        if (i > 0) gain += way(order_[i - 1], order_[i]) - way(order_[i - 1], order_[j]);
        if (j + 1 < n) gain += way(order_[j], order_[j + 1]) - way(order_[i], order_[j + 1]);
        if (!(gain > kGain)) continue;
        std::reverse(order_.begin() + static_cast<std::ptrdiff_t>(i),
                     order_.begin() + static_cast<std::ptrdiff_t>(j) + 1);
        better = true;
      }
    return better;
  }
  bool move_one() {
    const auto n = static_cast<std::ptrdiff_t>(order_.size());
    for (std::ptrdiff_t i = 0; i < n; ++i) {
      const std::size_t one = order_[static_cast<std::size_t>(i)];
      double out = link(i - 1) + link(i);
      if (i > 0 && i + 1 < n) {
        out -= way(order_[static_cast<std::size_t>(i) - 1], order_[static_cast<std::size_t>(i) + 1]);
      }
      std::vector<std::size_t> rest = order_;
      rest.erase(rest.begin() + i);
      for (std::size_t at = 0; at <= rest.size(); ++at) {
        double in = 0;
        if (at > 0) in += way(rest[at - 1], one);
        if (at < rest.size()) in += way(one, rest[at]);
        if (at > 0 && at < rest.size()) in -= way(rest[at - 1], rest[at]);
        if (!(in < out - kGain)) continue;
        rest.insert(rest.begin() + static_cast<std::ptrdiff_t>(at), one);
        order_ = std::move(rest);
        return true;
      }
    }
    return false;
  }

  const Eigen::MatrixXd& cost_;
  std::vector<std::size_t> order_;
};

}  // namespace

std::optional<std::size_t> box_round_instrument(const Site& site) {
  for (std::size_t i = 0; site.instrument && i < site.keep_out.size(); ++i)
    if (meets(site.keep_out[i], 0, *site.instrument, *site.instrument)) return i;
  return {};
}

SiteCheck::SiteCheck(const AnyMachine& machine, const Site& site, const Pose& X_TR, const std::vector<Stand>& stands)
    : machine_(&machine), site_(site), X_TR_(X_TR) {
  constexpr double kSame = 1e-9;     // m
  constexpr std::size_t kSeen = 50;  // stands that show what moves
  if (stands.empty()) return;
  const machine::Outline first = kinematics::outline_at(machine, stands.front().X_MT, stands.front().q);
  for (const OutlinePart& part : first) still_.emplace_back(part.points.size(), true);
  for (std::size_t k = 1; k < std::min(kSeen, stands.size()); ++k) {
    const machine::Outline other = kinematics::outline_at(machine, stands[k].X_MT, stands[k].q);
    for (std::size_t i = 0; i < std::min(first.size(), other.size()); ++i)
      for (std::size_t j = 0; j < std::min(first[i].points.size(), other[i].points.size()); ++j)
        if ((first[i].points[j] - other[i].points[j]).norm() > kSame) still_[i][j] = false;
  }
  if (stands.size() < 2) return;
  for (const Line& line : lines(stands.front()))
    for (const Box& box : site.keep_out)
      if (!line.moves && meets(box, 0, line.from, line.to)) foundation_in_a_box_ = true;
}

std::vector<SiteCheck::Line> SiteCheck::lines(const Stand& stand) const {
  const machine::Outline outline = kinematics::outline_at(*machine_, stand.X_MT, stand.q);
  const double foot = 2 * site_.clearance;
  std::vector<Line> out;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const OutlinePart& part = outline[i];
    if (!is_line(part)) continue;
    for (std::size_t j = 0; j + 1 < part.points.size(); ++j) {
      const auto stands_still = [&](std::size_t point) {
        return part.role == Role::fixed || (i < still_.size() && point < still_[i].size() && still_[i][point]);
      };
      Line line{part.points[j], part.points[j + 1], true, part.role == Role::tool};
      line.moves = !(stands_still(j) && stands_still(j + 1));
      const double length = (line.to - line.from).norm();
      if (line.moves && (stands_still(j) || stands_still(j + 1))) {
        // A foot counts from two clearances on; a shorter line is all foot.
        const double share = length > foot ? foot / length : 1.0;
        Vec3& end = stands_still(j) ? line.from : line.to;
        const Vec3& other = stands_still(j) ? line.to : line.from;
        end += share * (other - end);
      }
      out.push_back(line);
    }
  }
  return out;
}

Hindrance SiteCheck::of_body(const std::vector<Line>& lines) const {
  for (const Line& line : lines) {
    if (line.moves && site_.floor && std::min(line.from.z(), line.to.z()) < *site_.floor + site_.clearance)
      return Hindrance::floor;
  }
  for (const Line& line : lines)
    for (const Box& box : site_.keep_out)
      if (line.moves && meets(box, site_.clearance, line.from, line.to)) return Hindrance::box;
  return Hindrance::none;
}

bool SiteCheck::hidden(const std::vector<Line>& lines, const Vec3& target) const {
  const Vec3 eye = *site_.instrument;
  for (const Box& box : site_.keep_out)
    if (meets(box, 0, eye, target)) return true;
  const double distance = (target - eye).norm(), near = 2 * site_.clearance;
  if (!(distance > near)) return false;
  const Vec3 end = target + near / distance * (eye - target);
  return std::any_of(lines.begin(), lines.end(), [&](const Line& line) {
    return !line.tool && segment_distance(eye, end, line.from, line.to) < site_.clearance;
  });
}

Hindrance SiteCheck::of(const Stand& stand) const {
  const std::vector<Line> all = lines(stand);
  if (const Hindrance body = of_body(all); body != Hindrance::none || !site_.instrument) return body;
  const Pose X_MR = stand.X_MT * X_TR_;
  const Vec3 to_eye = *site_.instrument - X_MR.p;
  if (site_.acceptance < std::numbers::pi && X_MR.R.col(2).dot(to_eye) < std::cos(site_.acceptance) * to_eye.norm()) {
    return Hindrance::turned_away;
  }
  return hidden(all, X_MR.p) ? Hindrance::hidden : Hindrance::none;
}

std::optional<bool> SiteCheck::free_between(const Stand& from, const Stand& to) const {
  constexpr double kStep = 0.02;
  const int steps = std::max(1, static_cast<int>(std::ceil(way_between(*machine_, from.q, to.q) / kStep)));
  for (int k = 1; k < steps; ++k) {
    Stand between;
    between.q = from.q + (to.q - from.q) * (static_cast<double>(k) / steps);
    const kinematics::ForwardResult at = kinematics::forward(*machine_, between.q);
    if (at.poses.empty()) return {};
    between.X_MT = at.poses.front();
    if (of_body(lines(between)) != Hindrance::none) return false;
  }
  return true;
}

double way_between(const AnyMachine& machine, const JointVector& from, const JointVector& to) {
  double most = 0;
  for (int i = 0; i < from.size(); ++i) {
    const machine::JointRange range = kinematics::joint_range(machine, i);
    const double width = range.max - range.min;
    if (width > 0) most = std::max(most, std::abs(to[i] - from[i]) / width);
  }
  return most;
}

Way shortest_way(const AnyMachine& machine, const std::vector<Stand>& stands, const SiteCheck* check) {
  constexpr std::size_t kStarts = 16;
  constexpr double kNotFree = 20;
  constexpr int kRounds = 40;  // in which moves that turn out not to be free are avoided
  const std::size_t n = stands.size();
  const auto size = static_cast<Eigen::Index>(n);
  Way out;
  if (n == 0) return out;
  Eigen::MatrixXd way(size, size);
  for (Eigen::Index i = 0; i < size; ++i)
    for (Eigen::Index j = 0; j < size; ++j)
      way(i, j) = way_between(machine, stands[static_cast<std::size_t>(i)].q, stands[static_cast<std::size_t>(j)].q);
  Eigen::MatrixXd cost = way;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < std::min(n, kStarts); ++k) {
    Tour other(n, cost);
    other.start(k * n / std::min(n, kStarts));
    other.improve();
    if (!(other.length() < least)) continue;
    least = other.length();
    out.order = other.order();
  }
  std::map<std::pair<std::size_t, std::size_t>, std::optional<bool>> known;
  for (int round = 0; check != nullptr && round < kRounds; ++round) {
    out.not_free.clear();
    out.not_judged.clear();
    bool learned = false;
    for (std::size_t k = 0; k + 1 < n; ++k) {
      const std::pair<std::size_t, std::size_t> pair = std::minmax(out.order[k], out.order[k + 1]);
      auto found = known.find(pair);
      if (found == known.end()) {
        found = known.emplace(pair, check->free_between(stands[pair.first], stands[pair.second])).first;
        if (found->second == false) {
          const auto i = static_cast<Eigen::Index>(pair.first), j = static_cast<Eigen::Index>(pair.second);
          cost(i, j) = cost(j, i) = way(i, j) + kNotFree;
          learned = true;
        }
      }
      if (!found->second) out.not_judged.push_back(k);
      if (found->second == false) out.not_free.push_back(k);
    }
    if (!learned || round + 1 == kRounds) break;
    Tour again(n, cost);
    again.start(out.order.front());
    again.improve();
    out.order = again.order();
  }
  for (std::size_t k = 0; k + 1 < n; ++k)
    out.length += way(static_cast<Eigen::Index>(out.order[k]), static_cast<Eigen::Index>(out.order[k + 1]));
  return out;
}

}  // namespace polypod::calibration
