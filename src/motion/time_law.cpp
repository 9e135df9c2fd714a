// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/time_law.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace polypod::motion {
namespace {

/// A piece at the time x since it began.
Series piece_at(const TimeLaw::Piece& piece, double x) {
  if (piece.bend == 0) {
    const Series t(x, 1, 0, 0);
    Series out(piece.c[5]);
    for (int i = 4; i >= 0; --i) out = out * t + Series(piece.c[static_cast<std::size_t>(i)]);
    return out;
  }
  // S = sinh(k x) / k, C = (cosh(k x) - 1) / k^2.
  const double z = piece.bend * x * x, k = std::sqrt(std::abs(piece.bend));
  constexpr double kSmall = 1e-3;
  double S = x * (1 + z / 6 * (1 + z / 20 * (1 + z / 42))), C = x * x / 2 * (1 + z / 12 * (1 + z / 30 * (1 + z / 56)));
  if (std::abs(z) > kSmall) {
    S = (z > 0 ? std::sinh(k * x) : std::sin(k * x)) / k;
    C = ((z > 0 ? std::cosh(k * x) : std::cos(k * x)) - 1) / piece.bend;
  }
  const double v = piece.c[1], a = 2 * piece.c[2], c = 1 + piece.bend * C;
  const double rate = v * c + a * S;
  return {piece.c[0] + v * S + a * C, rate, a * c + piece.bend * v * S, piece.bend * rate};
}

}  // namespace

void TimeLaw::Block::rest(double before, double after) {
  if (before > 0) pieces.insert(pieces.begin(), Piece{before, {}, 0});
  if (after > 0) pieces.push_back({after, {eased ? 1 : size}, 0});
  rest_before = before;
  rest_after = after;
}

void TimeLaw::add(Block block) {
  std::vector<double> ends;
  double t = 0;
  for (const Piece& piece : block.pieces) ends.push_back(t += piece.duration);
  block.duration = t;
  begins_.push_back(duration() + t);
  pieces_.push_back(std::move(ends));
  blocks_.push_back(std::move(block));
}

void TimeLaw::replace(std::size_t block, Block by) {
  std::vector<double> ends;
  double t = 0;
  for (const Piece& piece : by.pieces) ends.push_back(t += piece.duration);
  by.duration = t;
  const double more = t - blocks_[block].duration;
  for (std::size_t k = block; k < begins_.size(); ++k) begins_[k] += more;
  pieces_[block] = std::move(ends);
  blocks_[block] = std::move(by);
}

void TimeLaw::stretch(std::size_t block, double factor) {
  Block& b = blocks_[block];
  const double before = b.duration;
  b.duration = 0;
  for (std::size_t k = 0; k < b.pieces.size(); ++k) {
    Piece& piece = b.pieces[k];
    const bool rests = (k == 0 && b.rest_before > 0) || (k + 1 == b.pieces.size() && b.rest_after > 0);
    piece.duration *= rests ? 1 : factor;
    pieces_[block][k] = b.duration += piece.duration;
    if (rests) continue;
    double scale = 1;
    for (double& c : piece.c) {
      c *= scale;
      scale /= factor;
    }
    piece.bend /= factor * factor;
  }
  for (std::size_t k = block; k < begins_.size(); ++k) begins_[k] += b.duration - before;
}

Series TimeLaw::in_block(std::size_t block, double x) const {
  const Block& b = blocks_[block];
  const std::vector<double>& ends = pieces_[block];
  const auto it = std::upper_bound(ends.begin(), ends.end(), x);
  const std::size_t k = std::min(static_cast<std::size_t>(it - ends.begin()), ends.size() - 1);
  const Piece& piece = b.pieces[k];
  const double since = std::clamp(x - (k == 0 ? 0 : ends[k - 1]), 0.0, piece.duration);
  Series out = piece_at(piece, since);
  if (b.eased) {
    const Series w3 = out * out * out;
    out = Series(b.size) * (w3 * (Series(10.0) - Series(15.0) * out + Series(6.0) * out * out));
  }
  // Rounding must not leave the block.
  out[0] = b.from + std::clamp(out[0], 0.0, b.size);
  return out;
}

Series TimeLaw::at(double t) const {
  const auto it = std::upper_bound(begins_.begin(), begins_.end(), t);
  const std::size_t k = std::min(static_cast<std::size_t>(it - begins_.begin()), begins_.size() - 1);
  return in_block(k, t - begin(k));
}

double TimeLaw::time_of(double s) const {
  std::size_t k = 0;
  while (k + 1 < blocks_.size() && blocks_[k].from + blocks_[k].size < s) ++k;
  double low = 0, high = blocks_[k].duration;
  constexpr int kHalvings = 60;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (in_block(k, middle).value() < s ? low : high) = middle;
  }
  return begin(k) + high;
}

TimeLaw::Block uniform_block(double from, double size, double duration) {
  TimeLaw::Block out{from, size, false, {}, 0};
  out.pieces.push_back({duration, {0, size / duration}});
  return out;
}

TimeLaw::Block smooth_block(double from, double size, double duration) {
  TimeLaw::Block out{from, size, false, {}, 0};
  const double d = duration, d3 = d * d * d;
  out.pieces.push_back({d, {0, 0, 0, 10 * size / d3, -15 * size / (d3 * d), 6 * size / (d3 * d * d)}});
  return out;
}

bool PlanLimits::limits_jerk() const {
  return std::isfinite(tool_jerk) || (drive_jerk.size() > 0 && drive_jerk.array().isFinite().any());
}

namespace {

tl::unexpected<Error> no_limit(const std::string& what) {
  return fail("MO115", what, {}, "give limits above 0 of the tool or of the drives");
}

Status usable(const PlanLimits& limits) {
  const auto positive = [](double x) { return x > 0; };
  bool all = positive(limits.tool_speed) && positive(limits.tool_acceleration) && positive(limits.tool_jerk) &&
             positive(limits.turn_speed);
  for (const machine::JointVector* v : {&limits.drive_speed, &limits.drive_acceleration, &limits.drive_jerk})
    for (const double x : *v) all = all && positive(x);
  if (!all) return no_limit("a limit of speed, acceleration or jerk is not above 0");
  return {};
}

struct Span {
  double low = -kNoLimit, high = kNoLimit;
  void cut(double a, double b) {
    low = std::max(low, std::min(a, b));
    high = std::min(high, std::max(a, b));
  }
  void none() {
    low = kNoLimit;
    high = -kNoLimit;
  }
};

/// |a u + b x| <= most.
void cut_by_row(Span& span, double a, double b, double x, double most) {
  if (!std::isfinite(most)) return;
  if (a == 0) {
    if (std::abs(b) * x > most) span.none();
    return;
  }
  span.cut((-most - b * x) / a, (most - b * x) / a);
}
void cut_by_tool(Span& span, const Vec3& a, const Vec3& b, double x, double most) {
  if (!std::isfinite(most)) return;
  const double aa = a.squaredNorm(), ab = a.dot(b) * x, c = b.squaredNorm() * x * x - most * most;
  if (aa == 0) {
    if (c > 0) span.none();
    return;
  }
  const double root = ab * ab - aa * c;
  if (root < 0) {
    span.none();
    return;
  }
  span.cut((-ab - std::sqrt(root)) / aa, (-ab + std::sqrt(root)) / aa);
}

/// Accelerations u that the limits allow at a node whose x is x + ahead u.
void cut_by_node(Span& span, const PlanNode& n, const PlanLimits& limits, double x, double ahead) {
  cut_by_tool(span, n.tip_1 + ahead * n.tip_2, n.tip_2, x, limits.tool_acceleration);
  for (Eigen::Index i = 0; i < n.drive_1.size(); ++i)
    cut_by_row(span, n.drive_1[i] + ahead * n.drive_2[i], n.drive_2[i], x, limits.drive_acceleration[i]);
}

/// The largest x that speeds allow.
double by_speed(const PlanNode& n, const PlanLimits& limits) {
  double out = kNoLimit;
  const auto cut = [&](double rate, double most) {
    if (rate > 0) out = std::min(out, most * most / (rate * rate));
  };
  cut(n.tip_1.norm(), std::min(limits.tool_speed, n.speed));
  cut(n.turn.norm(), limits.turn_speed);
  for (Eigen::Index i = 0; i < n.drive_1.size(); ++i) cut(std::abs(n.drive_1[i]), limits.drive_speed[i]);
  return out;
}

}  // namespace

Result<TimeLaw::Block> fastest(const std::vector<PlanNode>& nodes, const PlanLimits& limits) {
  POLYPOD_TRY(usable(limits));
  const std::size_t n = nodes.size();
  std::vector<double> most(n);
  for (std::size_t i = 0; i < n; ++i) most[i] = by_speed(nodes[i], limits);
  const auto step = [&](std::size_t i) { return nodes[i + 1].s - nodes[i].s; };
  const auto allowed = [&](std::size_t i, double x) {
    Span span;
    cut_by_node(span, nodes[i], limits, x, 0);
    if (step(i) > 0) cut_by_node(span, nodes[i + 1], limits, x, 2 * step(i));
    return span;
  };
  constexpr double kHuge = 1e18;  // x of a place where nothing limits the speed
  std::vector<double> reach(n, 0);
  for (std::size_t i = n - 1; i-- > 0;) {
    const double d = step(i), next = reach[i + 1];
    const auto can = [&](double x) {
      Span span = allowed(i, x);
      if (!(d > 0)) return span.low <= span.high && x <= next;
      span.high = std::min(span.high, (next - x) / (2 * d));
      span.low = std::max(span.low, -x / (2 * d));
      return span.low <= span.high;
    };
    double low = 0, high = std::min(most[i], kHuge);
    if (can(high)) {
      reach[i] = high;
      continue;
    }
    constexpr int kHalvings = 60;
    for (int k = 0; k < kHalvings; ++k) {
      // By factors while they differ in size, else by halves.
      const double middle = low > 0 ? std::sqrt(low * high) : high > 1e-12 ? high * 1e-3 : 0.5 * high;
      const double at = low > 0 && high < 4 * low ? 0.5 * (low + high) : middle;
      (can(at) ? low : high) = at;
    }
    reach[i] = low;
  }
  TimeLaw::Block out{nodes.front().s, nodes.back().s - nodes.front().s, false, {}, 0};
  double x = 0;
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double d = step(i);
    if (!(d > 0)) {
      x = std::min(x, reach[i + 1]);
      continue;
    }
    const Span span = allowed(i, x);
    const double u = std::min(span.high, (reach[i + 1] - x) / (2 * d));
    const double next = std::clamp(x + 2 * d * u, 0.0, reach[i + 1]);
    const double v = std::sqrt(x), mean = 0.5 * (v + std::sqrt(next));
    if (!(mean > 0) || !std::isfinite(mean) || next >= kHuge) {
      return no_limit("no limit of speed and acceleration holds somewhere on the path, or one leaves no motion");
    }
    const double t = d / mean;
    out.pieces.push_back({t, {nodes[i].s - nodes.front().s, v, (std::sqrt(next) - v) / t / 2}});
    x = next;
  }
  return out;
}

TimeLaw::Block s_profile(double from, double size, double speed, double acceleration, double jerk) {
  // The speed that is reached: the way up to a speed v and down again is v (v / a + a / j), a the acceleration reached.
  double v = std::cbrt(size * size * jerk / 4);  // no limit of the acceleration met
  double a = std::sqrt(v * jerk);
  if (a > acceleration) {
    a = acceleration;
    const double ramp = a / jerk;
    v = 0.5 * a * (std::sqrt(ramp * ramp + 4 * size / a) - ramp);
  }
  double cruise = 0;
  if (v > speed) {
    v = speed;
    a = std::min(acceleration, std::sqrt(v * jerk));
    cruise = size / v - (v / a + a / jerk);
  }
  const double ramp = a / jerk, hold = std::max(0.0, v / a - ramp);
  TimeLaw::Block out{from, size, false, {}, 0};
  double s = 0, rate = 0, rise = 0;
  const auto phase = [&](double time, double by) {
    if (!(time > 0)) return;
    out.pieces.push_back({time, {s, rate, rise / 2, by / 6}});
    s += time * (rate + time * (rise / 2 + time * by / 6));
    rate += time * (rise + time * by / 2);
    rise += time * by;
  };
  phase(ramp, jerk);
  phase(hold, 0);
  phase(ramp, -jerk);
  rise = 0;
  phase(cruise, 0);
  phase(ramp, -jerk);
  phase(hold, 0);
  phase(ramp, jerk);
  return out;
}

namespace {

double duration_of(const TimeLaw::Block& block) {
  double out = 0;
  for (const TimeLaw::Piece& piece : block.pieces) out += piece.duration;
  return out;
}
/// Largest speed and acceleration of an S profile.
std::pair<double, double> reached_by(const TimeLaw::Block& profile) {
  double speed = 0, acceleration = 0;
  for (const TimeLaw::Piece& piece : profile.pieces) {
    speed = std::max(speed, piece.c[1]);
    acceleration = std::max(acceleration, 2 * std::abs(piece.c[2]));
  }
  return {speed, acceleration};
}

/// Largest and least absolute derivatives at the nodes of what has limits.
struct Moved {
  double speed = kNoLimit, acceleration = kNoLimit, jerk = kNoLimit;
  double most_speed = speed;  ///< of places with limits of their own the largest, where `speed` is the least
  double most_1 = 0, least_1 = kNoLimit, most_2 = 0, most_3 = 0;
  void take(double d1, double d2, double d3) {
    most_1 = std::max(most_1, d1);
    least_1 = std::min(least_1, d1);
    most_2 = std::max(most_2, d2);
    most_3 = std::max(most_3, d3);
  }
};

/// The S profile that is certainly allowed, or as fast as is possible, where speed and acceleration are v and a at
/// most.
std::optional<TimeLaw::Block> bounding_profile(const std::vector<Moved>& all, double from, double size, double v,
                                               double a, bool possible) {
  double speed = kNoLimit, acceleration = kNoLimit, jerk = kNoLimit;
  for (const Moved& m : all) {
    const double by = possible ? m.least_1 : m.most_1, sign = possible ? 1 : -1;
    const double bend = m.most_2 > 0 ? m.most_2 * v * v : 0;
    const double twist = (m.most_2 > 0 ? 3 * m.most_2 * v * a : 0) + (m.most_3 > 0 ? m.most_3 * v * v * v : 0);
    if (!possible && (bend >= m.acceleration || twist >= m.jerk)) return {};
    if (!(by > 0)) continue;
    speed = std::min(speed, (possible ? m.most_speed : m.speed) / by);
    acceleration = std::min(acceleration, (m.acceleration + sign * bend) / by);
    jerk = std::min(jerk, (m.jerk + sign * twist) / by);
  }
  if (!std::isfinite(jerk) || !(jerk > 0)) return {};
  return s_profile(from, size, speed, acceleration, jerk);
}

}  // namespace

std::optional<TimeLaw::Block> nearly_fastest_s_profile(const std::vector<PlanNode>& nodes, const PlanLimits& limits,
                                                       double gap) {
  const Eigen::Index drives = nodes.front().drive_1.size();
  Moved tool{limits.tool_speed, limits.tool_acceleration, limits.tool_jerk}, turn{limits.turn_speed};
  std::vector<Moved> all;
  for (Eigen::Index i = 0; i < drives; ++i)
    all.push_back({limits.drive_speed[i], limits.drive_acceleration[i], limits.drive_jerk[i]});
  tool.most_speed = 0;
  for (const PlanNode& n : nodes) {
    if (n.drive_1.size() != drives) return {};
    tool.take(n.tip_1.norm(), n.tip_2.norm(), n.tip_3.norm());
    tool.speed = std::min(tool.speed, n.speed);
    tool.most_speed = std::max(tool.most_speed, std::min(limits.tool_speed, n.speed));
    turn.take(n.turn.norm(), 0, 0);
    for (Eigen::Index i = 0; i < drives; ++i)
      all[static_cast<std::size_t>(i)].take(std::abs(n.drive_1[i]), std::abs(n.drive_2[i]), std::abs(n.drive_3[i]));
  }
  all.push_back(tool);
  all.push_back(turn);
  const double from = nodes.front().s, size = nodes.back().s - from;
  // What no law exceeds: first by the limits alone, then by the profile that is made of that, which is again a bound.
  double v = kNoLimit, a = kNoLimit;
  for (const Moved& m : all)
    if (m.least_1 > 0) v = std::min(v, m.most_speed / m.least_1);
  for (const Moved& m : all)
    if (m.least_1 > 0) a = std::min(a, (m.acceleration + m.most_2 * v * v) / m.least_1);
  if (!std::isfinite(v) || !std::isfinite(a)) return {};
  double least_time = 0;
  constexpr int kTighter = 4;
  for (int k = 0; k < kTighter; ++k) {
    const auto fastest = bounding_profile(all, from, size, v, a, true);
    if (!fastest) return {};
    std::tie(v, a) = reached_by(*fastest);
    least_time = duration_of(*fastest);
  }
  std::optional<TimeLaw::Block> out = bounding_profile(all, from, size, v, a, false);
  if (!out || !(duration_of(*out) <= (1 + gap) * least_time)) return {};
  return out;
}

namespace {

/// The five diagonals of a symmetric matrix and its Cholesky factor.
class Banded {
 public:
  explicit Banded(std::size_t n) : a_(n, {0, 0, 0}) {}
  void clear() { std::fill(a_.begin(), a_.end(), std::array<double, 3>{0, 0, 0}); }
  /// Entry (i, j), j <= i <= j + 2.
  double& at(std::size_t i, std::size_t j) { return a_[i][i - j]; }
  /// A x = b in the place of b; false where A is not positive definite.
  bool solve(std::vector<double>& b) {
    const std::size_t n = a_.size();
    for (std::size_t i = 0; i < n; ++i) {
      if (i >= 2) a_[i][2] /= a_[i - 2][0];
      if (i >= 1) a_[i][1] = (a_[i][1] - (i >= 2 ? a_[i][2] * a_[i - 1][1] : 0)) / a_[i - 1][0];
      double d = a_[i][0];
      if (i >= 1) d -= a_[i][1] * a_[i][1];
      if (i >= 2) d -= a_[i][2] * a_[i][2];
      if (!(d > 0)) return false;
      a_[i][0] = std::sqrt(d);
    }
    for (std::size_t i = 0; i < n; ++i) {
      if (i >= 1) b[i] -= a_[i][1] * b[i - 1];
      if (i >= 2) b[i] -= a_[i][2] * b[i - 2];
      b[i] /= a_[i][0];
    }
    for (std::size_t i = n; i-- > 0;) {
      if (i + 1 < n) b[i] -= a_[i + 1][1] * b[i + 1];
      if (i + 2 < n) b[i] -= a_[i + 2][2] * b[i + 2];
      b[i] /= a_[i][0];
    }
    return true;
  }

 private:
  std::vector<std::array<double, 3>> a_;
};

double dot(double a, double b) {
  return a * b;
}
double dot(const Vec3& a, const Vec3& b) {
  return a.dot(b);
}

using Row = std::array<double, 3>;  // of y_{i-1}, y_i, y_{i+1}

/// One limit at one place: a row of a drive (V a number) or three of the tool (V a vector),
/// L = c . (y_{i-1}, y_i, y_{i+1}), divided by the limit, with |L|^2 <= 1, or 1 / Y of a jerk,
/// Y = share . (y_{i-1}, y_i, y_{i+1}) the y of the place.
template <class V>
struct Constraint {
  std::size_t node = 0;  ///< i
  bool jerk = false;
  std::array<V, 3> c;
  Row share{};

  /// How much of the limit is left, with its L and Y; the barrier is the sum of -log of that.
  [[nodiscard]] double left(const std::vector<double>& y, V& L, double& Y) const {
    const double before = y[node - 1], own = y[node], behind = y[node + 1];
    L = c[0] * before + c[1] * own + c[2] * behind;
    Y = share[0] * before + share[1] * own + share[2] * behind;
    return (jerk ? (Y > 0 ? 1 / Y : 0) : 1) - dot(L, L);
  }
};

/// All limits of a block.
struct Constraints {
  std::vector<Constraint<double>> drives;
  std::vector<Constraint<Vec3>> tool;

  [[nodiscard]] std::size_t size() const { return drives.size() + tool.size(); }
  template <class F>
  void each(F&& f) const {
    for (const auto& c : tool) f(c);
    for (const auto& c : drives) f(c);
  }
};

/// The sum of the logarithms of positive numbers: one logarithm for several of them.
class SumOfLogs {
 public:
  void add(double x) {
    product_ *= x;
    if (product_ > 1e-150 && product_ < 1e150) return;
    sum_ += std::log(product_);
    product_ = 1;
  }
  [[nodiscard]] double value() const { return sum_ + std::log(product_); }

 private:
  double sum_ = 0, product_ = 1;
};

double eased(double w) {
  return w * w * w * (10 - 15 * w + 6 * w * w);
}
/// w of a share of the way.
double uneased(double share) {
  double low = 0, high = 1;
  constexpr int kHalvings = 60;
  for (int k = 0; k < kHalvings; ++k) {
    const double middle = 0.5 * (low + high);
    (eased(middle) < share ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

/// An interval of the spline, and the part of the path that it lies on.
struct Cell {
  double begin = 0, end = 0;  ///< w
  std::size_t part = 0;
};
/// Equal steps of w; more where a part is short, and where `dense` places (rising) stand close to each other;
/// neighbours differ in length by little more than the factor two.
std::vector<Cell> cells_of(const std::vector<double>& ends, int count, const std::vector<double>& dense) {
  constexpr double kEach = 24, kRatio = 2.1;
  std::vector<Cell> out;
  double begin = 0;
  for (std::size_t k = 0; k < ends.size(); ++k) {
    const int pieces = static_cast<int>(std::ceil(std::max(kEach, count * (ends[k] - begin))));
    for (int i = 0; i < pieces; ++i) {
      out.push_back({begin + (ends[k] - begin) * i / pieces, begin + (ends[k] - begin) * (i + 1) / pieces, k});
    }
    begin = ends[k];
  }
  // The least distance of two places one of which lies within a cell.
  const auto gap_in = [&](const Cell& c) {
    double gap = 1;
    for (auto it = std::lower_bound(dense.begin(), dense.end(), c.begin); it != dense.end() && *it < c.end; ++it) {
      if (it != dense.begin()) gap = std::min(gap, *it - *(it - 1));
      if (it + 1 != dense.end()) gap = std::min(gap, *(it + 1) - *it);
    }
    return gap;
  };
  constexpr double kLeastCell = 1e-9;
  for (bool split = true; split;) {
    split = false;
    std::vector<Cell> finer;
    for (std::size_t i = 0; i < out.size(); ++i) {
      const double length = out[i].end - out[i].begin;
      const bool within_gap = dense.empty() || length <= std::max(0.5 * gap_in(out[i]), kLeastCell);
      const auto much_shorter = [&](const Cell& c) { return length > kRatio * (c.end - c.begin); };
      if (!within_gap || (i > 0 && much_shorter(out[i - 1])) || (i + 1 < out.size() && much_shorter(out[i + 1]))) {
        const double middle = 0.5 * (out[i].begin + out[i].end);
        finer.push_back({out[i].begin, middle, out[i].part});
        finer.push_back({middle, out[i].end, out[i].part});
        split = true;
      } else {
        finer.push_back(out[i]);
      }
    }
    out = std::move(finer);
  }
  return out;
}

}  // namespace

Result<TimeLaw::Block> fastest_within_jerk(const std::function<PlanNode(double s, std::size_t part)>& node, double from,
                                           double size, const std::vector<double>& parts, int count,
                                           const PlanLimits& limits, const std::vector<double>& dense) {
  POLYPOD_TRY(usable(limits));
  std::vector<double> ends;
  for (const double s : parts) ends.push_back(uneased((s - from) / size));
  ends.push_back(1);
  std::vector<double> dense_w;
  for (const double s : dense) dense_w.push_back(uneased((s - from) / size));
  const std::vector<Cell> cells = cells_of(ends, count, dense_w);
  // y_1 .. y_K belong to the intervals, y_0 and y_{K+1} to none.
  const std::size_t intervals = cells.size(), n = intervals + 2;
  const auto length = [&](std::size_t i) {
    const Cell& c = cells[std::clamp<std::size_t>(i, 1, intervals) - 1];
    return c.end - c.begin;
  };
  Constraints constraints;
  const auto ask = [&](std::size_t i, double share, const PlanNode& at) {
    const double w = cells[i - 1].begin + share * (cells[i - 1].end - cells[i - 1].begin);
    const double e = 1 - w;
    const double s1 = 30 * size * w * w * e * e, s2 = 60 * size * w * e * (1 - 2 * w),
                 s3 = 60 * size * (1 - 6 * w + 6 * w * w);
    const double before = length(i - 1), own = length(i), behind = length(i + 1);
    const double left_sum = before + own, right_sum = own + behind;
    const Row left_slope{-2 / left_sum, 2 / left_sum, 0}, right_slope{0, -2 / right_sum, 2 / right_sum};
    const Row left_value{own / left_sum, before / left_sum, 0};
    Row value, slope, second;
    const double on = share * own;
    for (std::size_t k = 0; k < 3; ++k) {
      second[k] = (right_slope[k] - left_slope[k]) / own;
      slope[k] = left_slope[k] + on * second[k];
      value[k] = left_value[k] + on * left_slope[k] + 0.5 * on * on * second[k];
    }
    const auto limit_speed = [&](double squared, double speed) {
      if (!std::isfinite(speed) || !(squared > 0)) return;
      Constraint<double> c{i, false, {}, value};
      for (std::size_t k = 0; k < 3; ++k) c.c[k] = squared / (speed * speed) * value[k];
      constraints.drives.push_back(c);
    };
    // Of the tool or of a drive, with the derivatives of its place by s.
    const auto add = [&]<class V>(std::vector<Constraint<V>>& to, const V& d1, const V& d2, const V& d3, double speed,
                                  double acceleration, double jerk) {
      const V a1 = d1 * s1, a2 = d2 * s1 * s1 + d1 * s2, a3 = d3 * s1 * s1 * s1 + 3 * s1 * s2 * d2 + d1 * s3;
      const auto push = [&](bool is_jerk, const V& of_value, const V& of_slope, const V& of_second) {
        Constraint<V> c{i, is_jerk, {}, value};
        for (std::size_t k = 0; k < 3; ++k) c.c[k] = of_value * value[k] + of_slope * slope[k] + of_second * second[k];
        to.push_back(c);
      };
      const V none = 0 * d1;
      limit_speed(dot(a1, a1), speed);
      if (std::isfinite(acceleration) && dot(a2, a2) + dot(a1, a1) > 0) {
        push(false, a2 / acceleration, a1 / (2 * acceleration), none);
      }
      if (std::isfinite(jerk)) push(true, a3 / jerk, 1.5 * a2 / jerk, 0.5 * a1 / jerk);
    };
    add(constraints.tool, at.tip_1, at.tip_2, at.tip_3, std::min(limits.tool_speed, at.speed), limits.tool_acceleration,
        limits.tool_jerk);
    limit_speed(at.turn.squaredNorm() * s1 * s1, limits.turn_speed);
    for (Eigen::Index k = 0; k < at.drive_1.size(); ++k) {
      add(constraints.drives, at.drive_1[k], at.drive_2[k], at.drive_3[k], limits.drive_speed[k],
          limits.drive_acceleration[k], limits.drive_jerk[k]);
    }
  };
  PlanNode at;
  for (std::size_t i = 1; i <= intervals; ++i) {
    const Cell& c = cells[i - 1];
    const auto node_at = [&](double w) { return node(from + size * eased(w), c.part); };
    if (i == 1 || cells[i - 2].part != c.part) at = node_at(c.begin);
    ask(i, 0, at);
    // Next to the ends, where the path itself comes to rest, jerks bulge within an interval.
    constexpr std::size_t kEnds = 4;
    if (i <= kEnds || i + kEnds > intervals) {
      for (const double share : {0.25, 0.5, 0.75}) ask(i, share, node_at(c.begin + share * (c.end - c.begin)));
    }
    at = node_at(c.end);
    ask(i, 1, at);
  }
  const auto weight = [&](std::size_t i) { return i == 0 || i + 1 == n ? 0.5 * length(i) : length(i); };
  const auto cost = [&](const std::vector<double>& y, double tau) {
    double out = 0;
    for (std::size_t i = 0; i < n; ++i) {
      if (!(y[i] > 0)) return kNoLimit;
      out += tau * weight(i) / std::sqrt(y[i]);
    }
    SumOfLogs logs;
    const auto all_hold = [&]<class V>(const std::vector<Constraint<V>>& of) {
      V L;
      double Y = 0;
      for (const Constraint<V>& c : of) {
        const double g = c.left(y, L, Y);
        if (!(g > 0)) return false;
        logs.add(c.jerk ? g * Y : g);  // without unit
      }
      return true;
    };
    return all_hold(constraints.tool) && all_hold(constraints.drives) ? out - logs.value() : kNoLimit;
  };
  const auto time_of = [&](const std::vector<double>& y) {
    double out = 0;
    for (std::size_t i = 0; i < n; ++i) out += weight(i) / std::sqrt(y[i]);
    return out;
  };
  // A constant y that keeps all limits with room.
  double start = 1;
  constexpr int kMostHalvings = 400;
  int halvings = 0;
  std::vector<double> y(n, start);
  while (!std::isfinite(cost(y, 0)) && halvings++ < kMostHalvings) std::fill(y.begin(), y.end(), start *= 0.25);
  for (int k = 0; k < kMostHalvings && halvings == 0; ++k) {
    std::vector<double> faster(n, start * 4);
    if (!std::isfinite(cost(faster, 0))) break;
    start *= 4;
    y = faster;
    if (k + 1 == kMostHalvings) return no_limit("nothing limits the speed on a part of the path");
  }
  if (halvings > kMostHalvings) return no_limit("the limits leave no motion on a part of the path");
  std::fill(y.begin(), y.end(), 0.5 * start);

  Banded H(n);
  std::vector<double> gradient(n), d(n), stepped(n);
  const auto barriers = static_cast<double>(constraints.size());
  constexpr double kGap = 2e-4;  // of the time
  constexpr int kNewton = 40;
  for (double tau = barriers / time_of(y);; tau *= 5) {
    double now = cost(y, tau);
    for (int step = 0; step < kNewton; ++step) {
      H.clear();
      std::fill(gradient.begin(), gradient.end(), 0.0);
      for (std::size_t i = 0; i < n; ++i) {
        const double r = 1 / std::sqrt(y[i]);
        gradient[i] += -0.5 * tau * weight(i) * r / y[i];
        H.at(i, i) += 0.75 * tau * weight(i) * r / (y[i] * y[i]);
      }
      constraints.each([&]<class V>(const Constraint<V>& c) {
        // -log(b - |L|^2) with b = 1, or 1 / Y for jerks, and that without unit: -log(1 - Y |L|^2). What is not convex
        // of it is left out of the second order.
        V L;
        double Y = 0;
        const double of_g = 1 / c.left(y, L, Y), of_Y = c.jerk ? 1 / Y : 0;
        Row dg;
        for (std::size_t k = 0; k < 3; ++k) dg[k] = -2 * dot(L, c.c[k]) - c.share[k] * of_Y * of_Y;
        for (std::size_t k = 0; k < 3; ++k) {
          const std::size_t row = c.node + k - 1;
          gradient[row] -= dg[k] * of_g + c.share[k] * of_Y;
          for (std::size_t j = 0; j <= k; ++j) {
            H.at(row, c.node + j - 1) += (dg[k] * dg[j] * of_g + 2 * dot(c.c[k], c.c[j])) * of_g;
          }
        }
      });
      for (std::size_t i = 0; i < n; ++i) d[i] = -gradient[i];
      if (!H.solve(d)) break;
      double slope = 0;
      for (std::size_t i = 0; i < n; ++i) slope += gradient[i] * d[i];
      if (!(slope < -1e-6)) break;
      double share = 1;
      bool moved = false;
      constexpr int kShorter = 40;
      for (int k = 0; k < kShorter; ++k, share *= 0.5) {
        for (std::size_t i = 0; i < n; ++i) stepped[i] = y[i] + share * d[i];
        if (const double there = cost(stepped, tau); there <= now + 0.1 * share * slope) {
          y.swap(stepped);
          now = there;
          moved = true;
          break;
        }
      }
      if (!moved) break;
    }
    if (barriers / tau < kGap * time_of(y)) break;
  }
  // In each interval y is a polynomial of second degree of w, so that w(t) is a sum of exponentials.
  TimeLaw::Block out{from, size, true, {}, 0};
  const auto slope_behind = [&](std::size_t i) { return 2 * (y[i + 1] - y[i]) / (length(i) + length(i + 1)); };
  for (std::size_t i = 1; i <= intervals; ++i) {
    const double w = cells[i - 1].begin, way = length(i), y1 = slope_behind(i - 1);
    const double y0 = (length(i) * y[i - 1] + length(i - 1) * y[i]) / (length(i - 1) + length(i));
    TimeLaw::Piece piece{0, {w, std::sqrt(y0), y1 / 4}, 0.5 * (slope_behind(i) - y1) / way};
    double low = 0, high = kNoLimit, T = way / std::sqrt(y0);
    constexpr int kSteps = 60;
    for (int k = 0; k < kSteps; ++k) {
      const Series reached = piece_at(piece, T);
      const double off = reached.value() - w - way;
      (off < 0 ? low : high) = T;
      if (std::abs(off) <= 1e-16 + 4e-16 * std::abs(w)) break;
      double next = T - off / reached.derivative(1);
      if (!(next > low && next < high)) next = std::isfinite(high) ? 0.5 * (low + high) : 2 * T;
      if (next == T) break;
      T = next;
    }
    piece.duration = T;
    out.pieces.push_back(piece);
  }
  return out;
}

}  // namespace polypod::motion
