// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "closure_bounds.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <mutex>
#include <numbers>
#include <unordered_map>

namespace polypod::workspace {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTurn = 2 * std::numbers::pi;
constexpr std::size_t kPrescribed = 5;  ///< three of the box, two of the patch
constexpr int kMostUnknowns = BoxDomain::kMost - kPrescribed;
constexpr int kTurnAboutAxis = 6;

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostUnknowns, kMostUnknowns>;
using Column = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostUnknowns, 1>;
using Slopes = Eigen::Matrix<double, Eigen::Dynamic, 5, 0, kMostUnknowns, 5>;

/// Unknowns u = middle + slope v + du, |du| <= radius.
struct Piece {
  Column middle, radius;
  Slopes slope;
};

struct Place {
  Vec3 center, half;
  const Patch* patch = nullptr;
};

/// value + slope v + [-rest, rest].
struct Form {
  double value = 0, rest = 0;
  std::array<double, kPrescribed> slope{};
};

/// What one look at F over a piece says of its core and of its leaves.
struct Look {
  bool none = false;     ///< no solution of the core
  bool regular = false;  ///< the core's equations can be solved for its unknowns in first order
  bool exists = false;   ///< a solution of the core in `follows` for each v
  std::vector<bool> leaf_none, leaf_regular, leaf_exists;
  Piece narrowed;  ///< holds all solutions of the piece
  Piece follows;   ///< the same in first order, of what is regular
  BoxDomain domain;
  Matrix B, Y;  ///< of all equations and unknowns; of the core
  Slopes A;
  Column c, rest;
};

/// A part of the unknowns: a piece of the core, and for each leaf the ranges that are left.
struct Span {
  double middle = 0, radius = 0;
};
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

struct Node {
  std::vector<Branches> branches;
  std::vector<Column> seeds;
};

struct Key {
  int level = 0;
  std::array<std::int64_t, 3> index{};
  friend bool operator==(const Key&, const Key&) = default;
};
struct KeyHash {
  std::size_t operator()(const Key& k) const {
    auto h = static_cast<std::size_t>(k.level);
    for (const std::int64_t i : k.index) h = h * 0x9E3779B97F4A7C15ULL + static_cast<std::size_t>(i) + (h >> 29U);
    return h;
  }
};

}  // namespace

class ClosureLimits::State {
 public:
  State(std::shared_ptr<const ClosureQuestions> questions, const Options& options)
      : machine_(std::move(questions)), options_(options), whole_(whole_patch(options.directions)) {
    const machine::Task task = machine_->prescribes;
    for (int k = 0; k < 6; ++k) {
      if (!task.holds(static_cast<machine::Coordinate>(k))) free_.push_back(k);
    }
    if (task.names_axis()) free_ = {kTurnAboutAxis};
    if (!task.places()) {
      for (int i = 0; i < 3; ++i) box_coordinate_[static_cast<std::size_t>(i)] = static_cast<int>(task[i]);
    }
    unknowns_ = static_cast<int>(free_.size() + machine_->ranges.size());
    for (std::size_t i = 0; i < std::min<std::size_t>(machine_->table.size(), 64); ++i) {
      if (machine_->table[i].between_bodies && !options.interference) mask_ &= ~(LimitBits{1} << i);
    }
    mask_ &= options.limits;
  }

  /// False where nothing is proven.
  bool begin() {
    if (unknowns_ > kMostUnknowns) return false;
    root_.middle = root_.radius = Column::Zero(unknowns_);
    root_.slope = Slopes::Zero(unknowns_, 5);
    if (!hold_joints() || !hold_tip()) return false;
    const Vec3 home_angles = angles_abc(machine_->home.R);
    for (std::size_t i = 0; i < free_.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(i);
      const int k = free_[i];
      if (k < 3) {
        root_.middle[at] = 0.5 * (tip_low_[k] + tip_high_[k]);
        root_.radius[at] = 0.5 * (tip_high_[k] - tip_low_[k]);
      } else {
        root_.middle[at] = k == kTurnAboutAxis ? 0.0 : home_angles[k - 3];
        root_.radius[at] = k == kTurnAboutAxis ? 0.5 * kTurn : 0.25 * kTurn;
      }
    }
    for (int i = 0; i < 3; ++i) {
      const int k = box_coordinate_[static_cast<std::size_t>(i)];
      low_[i] = k < 3 ? tip_low_[k] : home_angles[k - 3] - 0.25 * kTurn;
      high_[i] = k < 3 ? tip_high_[k] : home_angles[k - 3] + 0.25 * kTurn;
    }
    // As many equations as unknowns: only then a zero of Y F is one of F.
    Piece home = root_;
    home.radius.setZero();
    const Place at{0.5 * (low_ + high_), Vec3::Zero(), &whole_};
    BoxDomain domain;
    PoseT<BoxNumber> X;
    std::vector<BoxNumber> q;
    pose(at, home, domain, X, q);
    if (machine_->equations(X, q).size() != unknowns_) return false;
    find_structure();
    find_lever();
    return true;
  }

  [[nodiscard]] double lever() const { return lever_; }
  [[nodiscard]] const Vec3& low() const { return low_; }
  [[nodiscard]] const Vec3& high() const { return high_; }

  Verdict judge(const Place& at, BoundList& out) const {
    const Node& node = node_over(at);
    Possible possible(limits_);
    std::optional<std::vector<Form>> chosen;
    double least = -kInfinity;
    bool any = false;
    for (const Branches& branches : node.branches) {
      std::vector<Form> forms;
      bool exists = false;
      if (!judge_branches(at, branches, possible, forms, exists)) continue;
      any = true;
      if (!exists) continue;
      const double value = least_of(forms, at);
      if (chosen && value <= least) continue;
      chosen = std::move(forms);
      least = value;
    }
    if (!any) return Verdict::dead;
    if (!chosen || least == -kInfinity) {
      for (const Column& seed : node.seeds) {
        std::vector<Form> forms;
        if (!judge_seed(at, seed, forms)) continue;
        const double value = least_of(forms, at);
        if (chosen && value <= least) continue;
        chosen = std::move(forms);
        least = value;
      }
    }
    return weighed(at, possible, chosen, least, out);
  }

 private:
  /// Of each limit the forms of all branches that are left.
  using Possible = std::vector<std::vector<Form>>;

  [[nodiscard]] bool heeds(std::size_t limit) const { return limit >= 64 || (mask_ >> limit & 1U) != 0; }

  // The ends of everything -------------------------------------------------------------------------------------------

  static PoseT<Interval> any_pose() {
    PoseT<Interval> X;
    for (int i = 0; i < 9; ++i) X.R(i / 3, i % 3) = Interval(-1, 1);
    for (int i = 0; i < 3; ++i) X.p[i] = Interval::whole();
    return X;
  }

  /// The joints' ranges, as far as the limits that are heeded say them; of turning joints else one turn.
  bool hold_joints() {
    const std::size_t n = machine_->ranges.size();
    for (std::size_t j = 0; j < n; ++j) {
      const machine::JointRange range = machine_->ranges[j];
      constexpr double kBeyond = 1e-9;
      const double beyond = kBeyond * (1 + std::abs(range.min) + std::abs(range.max));
      double low = range.min - beyond, high = range.max + beyond;
      if (!limits_break(j, {high, kInfinity}) || !limits_break(j, {-kInfinity, low})) {
        if (!machine_->turns[j]) return false;
        const double middle = 0.5 * (low + high);
        low = middle - 0.5 * kTurn;
        high = middle + 0.5 * kTurn;
      }
      const auto at = static_cast<Eigen::Index>(free_.size() + j);
      root_.middle[at] = 0.5 * (low + high);
      root_.radius[at] = 0.5 * (high - low);
    }
    return true;
  }
  [[nodiscard]] bool limits_break(std::size_t joint, const Interval& where) const {
    std::vector<Interval> q(machine_->ranges.size(), Interval::whole());
    q[joint] = where;
    const std::vector<Interval> g = machine_->kept(any_pose(), q);
    for (std::size_t i = 0; i < g.size(); ++i) {
      if (heeds(i) && g[i].hi() < 0) return true;
    }
    return false;
  }

  /// A box that certainly holds the tool tip: beyond it some equation has no zero or some limit is broken.
  bool hold_tip() {
    tip_low_ = Vec3::Constant(-kInfinity);
    tip_high_ = Vec3::Constant(kInfinity);
    constexpr int kRounds = 3;
    for (int round = 0; round < kRounds; ++round) {
      for (int k = 0; k < 6; ++k) narrow_tip(k % 3, k < 3 ? 1 : -1);
    }
    return tip_low_.allFinite() && tip_high_.allFinite();
  }
  void narrow_tip(int axis, double sign) {
    constexpr double kLeast = 1e-3, kMost = 1e4;
    const double from = machine_->home.p[axis];
    const double known = sign > 0 ? tip_high_[axis] - from : from - tip_low_[axis];
    double in = 0, out = kLeast;
    while (!tip_is_out(axis, sign, from + sign * out)) {
      in = out;
      out *= 2;
      if (out > kMost || out > known) break;
    }
    if (out > kMost || out > known) out = known;
    if (!std::isfinite(out)) return;
    for (int k = 0; k < 20; ++k) {
      const double middle = 0.5 * (in + out);
      (tip_is_out(axis, sign, from + sign * middle) ? out : in) = middle;
    }
    (sign > 0 ? tip_high_ : tip_low_)[axis] = from + sign * out;
  }
  [[nodiscard]] bool tip_is_out(int axis, double sign, double beyond) const {
    PoseT<Interval> X = any_pose();
    for (int k = 0; k < 3; ++k) X.p[k] = Interval(tip_low_[k], tip_high_[k]);
    X.p[axis] = sign > 0 ? Interval(beyond, std::max(beyond, tip_high_[axis]))
                         : Interval(std::min(beyond, tip_low_[axis]), beyond);
    if (machine_->prescribes.size() == 6) {
      for (int i = 0; i < 9; ++i) {
        const double r = whole_.R(i / 3, i % 3);
        X.R(i / 3, i % 3) = Interval(r - whole_.turn, r + whole_.turn);
      }
    }
    std::vector<Interval> q;
    for (std::size_t j = 0; j < machine_->ranges.size(); ++j) {
      const auto at = static_cast<Eigen::Index>(free_.size() + j);
      q.emplace_back(root_.middle[at] - root_.radius[at], root_.middle[at] + root_.radius[at]);
    }
    const auto F = machine_->equations(X, q);
    for (int i = 0; i < F.size(); ++i) {
      if (!F[i].contains(0)) return true;
    }
    const std::vector<Interval> g = machine_->kept(X, q);
    for (std::size_t i = 0; i < g.size(); ++i) {
      if (heeds(i) && g[i].hi() < 0) return true;
    }
    return false;
  }

  // F and the limits over a place and a piece ------------------------------------------------------------------------

  /// The held angles of a patch of ranges: A = s, B = t, C = 0.
  static double angle_of(const Patch& patch, int k) {
    return k == 3 ? 0.5 * (patch.low[0] + patch.high[0]) : k == 4 ? 0.5 * (patch.low[1] + patch.high[1]) : 0.0;
  }

  void pose(const Place& at, const Piece& piece, BoxDomain& d, PoseT<BoxNumber>& X, std::vector<BoxNumber>& q) const {
    using N = BoxNumber;
    const Patch& patch = *at.patch;
    d = BoxDomain();
    d.count = kPrescribed + static_cast<std::size_t>(unknowns_);
    for (int k = 0; k < 3; ++k) d.reach[static_cast<std::size_t>(k)] = at.half[k];
    if (patch.sector) {
      d.disc = 3;
      d.radius = patch.turn;
    } else {
      d.reach[3] = std::abs(patch.corner[3][0]);
      d.reach[4] = std::abs(patch.corner[3][1]);
    }
    for (int j = 0; j < unknowns_; ++j) d.reach[kPrescribed + static_cast<std::size_t>(j)] = piece.radius[j];
    const auto variable = [&](double value, std::size_t k) {
      N out(value, &d);
      out.set_gradient(k, 1);
      return out;
    };
    const auto unknown = [&](std::size_t j) {
      const auto row = static_cast<Eigen::Index>(j);
      N out = variable(piece.middle[row], kPrescribed + j);
      for (int k = 0; k < 5; ++k) out.set_gradient(static_cast<std::size_t>(k), piece.slope(row, k));
      return out;
    };
    std::array<N, 6> c;
    std::array<bool, 6> given{};
    N about_axis(0.0);
    for (std::size_t i = 0; i < free_.size(); ++i) {
      if (free_[i] == kTurnAboutAxis) {
        about_axis = unknown(i);
      } else {
        c[static_cast<std::size_t>(free_[i])] = unknown(i);
        given[static_cast<std::size_t>(free_[i])] = true;
      }
    }
    const machine::Task task = machine_->prescribes;
    for (int k = 0; k < 6; ++k) {
      const auto coordinate = static_cast<std::size_t>(k);
      if (given[coordinate]) continue;
      int box = -1;
      for (int i = 0; i < 3; ++i) box = box_coordinate_[static_cast<std::size_t>(i)] == k ? i : box;
      c[coordinate] = box >= 0                 ? variable(at.center[box], static_cast<std::size_t>(box))
                      : k == 5 || patch.sector ? N(angle_of(patch, 5))
                                               : variable(angle_of(patch, k), coordinate);
    }
    X.p = Vector3<N>(c[0], c[1], c[2]);
    if (task.names_axis() || task.size() == 6) {
      const Mat3 by1 = skew(patch.omega1) * patch.R, by2 = skew(patch.omega2) * patch.R;
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) {
          X.R(i, k) = N(patch.R(i, k), &d, patch.bend);
          X.R(i, k).set_gradient(3, by1(i, k));
          X.R(i, k).set_gradient(4, by2(i, k));
        }
      if (task.names_axis()) {
        const N cosine = cos(about_axis), sine = sin(about_axis);
        for (int i = 0; i < 3; ++i) {
          const N x = X.R(i, 0), y = X.R(i, 1);
          X.R(i, 0) = x * cosine + y * sine;
          X.R(i, 1) = y * cosine - x * sine;
        }
      }
    } else {
      X.R = rotation_by_angles<N>(c[3], c[4], c[5]);
    }
    q.clear();
    for (std::size_t j = free_.size(); j < static_cast<std::size_t>(unknowns_); ++j) q.push_back(unknown(j));
  }

  /// The most that slope v is in a place.
  static double spread(const BoxDomain& d, const double* slope, Eigen::Index stride = 1) {
    double sum = 0;
    for (Eigen::Index k = 0; k < 5; ++k) sum += std::abs(slope[k * stride]) * d.reach[static_cast<std::size_t>(k)];
    if (d.radius > 0) sum += d.radius * std::hypot(slope[3 * stride], slope[4 * stride]);
    return sum;
  }
  static double spread(const BoxDomain& d, const Slopes& slopes, Eigen::Index row) {
    const std::array<double, 5> s{slopes(row, 0), slopes(row, 1), slopes(row, 2), slopes(row, 3), slopes(row, 4)};
    return spread(d, s.data());
  }

  /// F over the place and the piece. `forms`, where asked for, are those of the limits there.
  void look(const Place& at, const Piece& piece, Look& out, std::vector<Form>* forms) const {
    PoseT<BoxNumber> X;
    std::vector<BoxNumber> q;
    pose(at, piece, out.domain, X, q);
    const BoxDomain& d = out.domain;
    const auto F = machine_->equations(X, q);
    const Eigen::Index n = unknowns_;
    const std::size_t leaves = leaves_.size();
    out.none = out.regular = out.exists = false;
    out.leaf_none.assign(leaves, false);
    out.leaf_regular.assign(leaves, false);
    out.leaf_exists.assign(leaves, false);
    out.B.resize(n, n);
    out.A.resize(n, 5);
    out.c.resize(n);
    out.rest.resize(n);
    Column moved(n);  // by v
    std::array<bool, BoxDomain::kMost> closes{};
    for (Eigen::Index i = 0; i < n; ++i) {
      const BoxNumber& f = F[i];
      out.c[i] = f.value();
      out.rest[i] = f.rest();
      for (int k = 0; k < 5; ++k) out.A(i, k) = f.gradient(static_cast<std::size_t>(k));
      for (Eigen::Index j = 0; j < n; ++j) out.B(i, j) = f.gradient(kPrescribed + static_cast<std::size_t>(j));
      moved[i] = spread(d, out.A, i);
      closes[static_cast<std::size_t>(i)] = std::abs(f.value()) <= f.radius() * (1 + 1e-12) + 1e-15;
    }
    for (const int i : core_rows_) out.none = out.none || !closes[static_cast<std::size_t>(i)];
    if (out.none) return;
    Column low = -piece.radius, high = piece.radius;
    // Each equation for each of its unknowns: of the core by those of the core alone, each leaf by its own.
    const auto solve_one = [&](int i, int j) {
      if (!std::isfinite(out.rest[i])) return;
      const double all = moved[i] + out.rest[i] + out.B.row(i).cwiseAbs().dot(piece.radius);
      const double slope = std::abs(out.B(i, j)), share = slope * piece.radius[j];
      if (!(share > 0.25 * all)) return;
      const double within = ((all - share) * (1 + 1e-12) + 1e-15) / slope, middle = -out.c[i] / out.B(i, j);
      low[j] = std::max(low[j], middle - within);
      high[j] = std::min(high[j], middle + within);
    };
    for (const int i : core_rows_)
      for (const int j : core_) solve_one(i, j);
    out.follows = piece;
    const auto size = static_cast<Eigen::Index>(core_.size());
    Column core_radius(size), e(size), r(size);
    Slopes S(size, 5);
    Matrix B(size, size);
    Column c(size), rest(size);
    Slopes A(size, 5);
    for (Eigen::Index a = 0; a < size; ++a) {
      const int i = core_rows_[static_cast<std::size_t>(a)];
      core_radius[a] = piece.radius[core_[static_cast<std::size_t>(a)]];
      c[a] = out.c[i];
      rest[a] = out.rest[i];
      A.row(a) = out.A.row(i);
      for (Eigen::Index b = 0; b < size; ++b) B(a, b) = out.B(i, core_[static_cast<std::size_t>(b)]);
    }
    bool tight = size == 0;  // the core in first order says more than the piece
    if (size == 0) {
      out.regular = out.exists = true;
      out.Y.resize(0, 0);
    } else if (rest.allFinite()) {
      const Column scale = core_radius.cwiseMax(1e-9);
      out.Y = scale.asDiagonal() * Eigen::PartialPivLU<Matrix>(B * scale.asDiagonal()).inverse();
      out.regular = out.Y.allFinite() && out.Y.cwiseAbs().maxCoeff() < 1e12;
    }
    if (out.regular && size > 0) {
      e = -(out.Y * c);
      S = -(out.Y * A);
      const Matrix away = (Matrix::Identity(size, size) - out.Y * B).cwiseAbs();
      r = (away * core_radius + out.Y.cwiseAbs() * rest) * (1 + 1e-12) + Column::Constant(size, 1e-15);
      out.exists = tight = true;
      for (Eigen::Index a = 0; a < size; ++a) {
        const int j = core_[static_cast<std::size_t>(a)];
        const double reach = spread(d, S, a) + r[a];
        out.exists = out.exists && std::abs(e[a]) + reach <= piece.radius[j];
        tight = tight && r[a] <= piece.radius[j] + 1e-14;
        low[j] = std::max(low[j], e[a] - reach);
        high[j] = std::min(high[j], e[a] + reach);
      }
      if (tight) {
        for (Eigen::Index a = 0; a < size; ++a) {
          const int j = core_[static_cast<std::size_t>(a)];
          out.follows.middle[j] += e[a];
          out.follows.slope.row(j) += S.row(a);
          out.follows.radius[j] = r[a];
        }
      } else {
        out.regular = false;
      }
    }
    for (const int j : core_) out.none = out.none || low[j] > high[j];
    if (out.none) return;
    for (std::size_t l = 0; l < leaves; ++l) {
      const auto [j, i] = leaves_[l];
      out.leaf_none[l] = !closes[static_cast<std::size_t>(i)];
      if (out.leaf_none[l]) continue;
      solve_one(i, j);
      const double slope = out.B(i, j);
      if (std::abs(slope) > 1e-9 && std::isfinite(out.rest[i])) {
        double value = out.c[i], off = out.rest[i];
        Eigen::Matrix<double, 1, 5> by = out.A.row(i);
        for (Eigen::Index a = 0; a < size; ++a) {
          const double b = out.B(i, core_[static_cast<std::size_t>(a)]);
          if (tight) {
            value += b * e[a];
            by += b * S.row(a);
            off += std::abs(b) * r[a];
          } else {
            off += std::abs(b) * core_radius[a];
          }
        }
        by /= -slope;
        const double middle = -value / slope, beyond = off / std::abs(slope) * (1 + 1e-12) + 1e-15;
        const std::array<double, 5> slopes{by[0], by[1], by[2], by[3], by[4]};
        const double reach = spread(d, slopes.data()) + beyond;
        out.leaf_exists[l] = std::abs(middle) + reach <= piece.radius[j];
        low[j] = std::max(low[j], middle - reach);
        high[j] = std::min(high[j], middle + reach);
        if (beyond <= piece.radius[j] + 1e-14) {
          out.leaf_regular[l] = true;
          out.follows.middle[j] += middle;
          out.follows.slope.row(j) += by;
          out.follows.radius[j] = beyond;
        }
      }
      out.leaf_none[l] = low[j] > high[j];
    }
    out.narrowed.middle = piece.middle + 0.5 * (low + high);
    out.narrowed.radius = (0.5 * (high - low) * (1 + 1e-12) + Column::Constant(n, 1e-16)).cwiseMax(0);
    out.narrowed.slope = piece.slope;
    if (forms != nullptr) limits_over(X, q, piece, out, *forms);
  }

  /// The limits on the solutions in the piece: g - l . F, where l takes the unknowns out of the first order.
  void limits_over(const PoseT<BoxNumber>& X, const std::vector<BoxNumber>& q, const Piece& piece, const Look& look,
                   std::vector<Form>& forms) const {
    const std::vector<BoxNumber> g = machine_->kept(X, q);
    forms.assign(g.size(), Form{});
    const Eigen::Index n = unknowns_;
    using Row = Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, kMostUnknowns>;
    std::optional<Eigen::LDLT<Matrix>> damped;
    Matrix weighted;
    Row by_u(n), left(n);
    Column l(n);
    for (std::size_t i = 0; i < g.size(); ++i) {
      Form& form = forms[i];
      form.value = g[i].value();
      form.rest = kInfinity;
      if (!heeds(i) || !std::isfinite(g[i].rest())) continue;
      for (Eigen::Index j = 0; j < n; ++j) by_u[j] = g[i].gradient(kPrescribed + static_cast<std::size_t>(j));
      double best = kInfinity;
      const auto take = [&] {
        double rest = g[i].rest();
        for (Eigen::Index k = 0; k < n; ++k) rest += l[k] == 0 ? 0.0 : std::abs(l[k]) * look.rest[k];
        rest += (by_u - l.transpose() * look.B).cwiseAbs().dot(piece.radius);
        if (!(rest < best)) return;
        std::array<double, kPrescribed> slope{};
        for (std::size_t k = 0; k < kPrescribed; ++k) {
          slope[k] = g[i].gradient(k) - l.dot(look.A.col(static_cast<Eigen::Index>(k)));
        }
        best = rest;
        const double value = g[i].value() - l.dot(look.c);
        const double total = rest + spread(look.domain, slope.data());
        form = {value, rest + 1e-13 * (std::abs(value) + total), slope};
      };
      l.setZero(n);
      take();
      if (by_u.isZero(0)) continue;
      left = by_u;
      for (std::size_t k = 0; k < leaves_.size(); ++k) {
        const auto [j, row] = leaves_[k];
        if (by_u[j] == 0 || !look.leaf_regular[k]) continue;
        l[row] = by_u[j] / look.B(row, j);
        left -= l[row] * look.B.row(row);
      }
      if (look.regular && !core_.empty()) {
        for (std::size_t a = 0; a < core_.size(); ++a)
          for (std::size_t b = 0; b < core_.size(); ++b) {
            l[core_rows_[b]] += left[core_[a]] * look.Y(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b));
          }
      }
      take();
      // Where that leaves much: least squares, with what the equations themselves do not know as damping.
      if (best > 0.1 * by_u.cwiseAbs().dot(piece.radius) + g[i].rest() && look.rest.allFinite()) {
        if (!damped) {
          weighted = look.B * piece.radius.cwiseAbs2().asDiagonal();
          Matrix H = weighted * look.B.transpose();
          H.diagonal() += look.rest.cwiseAbs2() + Column::Constant(n, 1e-14 * H.diagonal().maxCoeff() + 1e-300);
          damped.emplace(H);
        }
        l = damped->solve(weighted * by_u.transpose());
        if (l.allFinite()) take();
      }
    }
  }

  /// The lowest value of a limit over place and patch.
  static double lowest(const Form& f, const Place& at) {
    return f.value + at.patch->least(f.slope[3], f.slope[4]) - f.rest - by_position(f, at);
  }
  static double highest(const Form& f, const Place& at) {
    return f.value - at.patch->least(-f.slope[3], -f.slope[4]) + f.rest + by_position(f, at);
  }
  static double by_position(const Form& f, const Place& at) {
    return std::abs(f.slope[0]) * at.half[0] + std::abs(f.slope[1]) * at.half[1] + std::abs(f.slope[2]) * at.half[2];
  }
  [[nodiscard]] double least_of(const std::vector<Form>& forms, const Place& at) const {
    double least = kInfinity;
    for (std::size_t i = 0; i < forms.size(); ++i) {
      if (heeds(i)) least = std::min(least, lowest(forms[i], at));
    }
    return least;
  }

  /// One piece: a core and one span of each leaf.
  static Piece select(const Branches& from, std::size_t round, const std::vector<std::pair<int, int>>& leaves) {
    Piece out = from.core;
    for (std::size_t l = 0; l < leaves.size(); ++l) {
      const Span& span = from.leaves[l][std::min(round, from.leaves[l].size() - 1)];
      out.middle[leaves[l].first] = span.middle;
      out.radius[leaves[l].first] = span.radius;
    }
    return out;
  }
  [[nodiscard]] bool broken_by(int owner, const std::vector<Form>& forms, const Place& at) const {
    for (std::size_t i = 0; i < forms.size(); ++i) {
      if (heeds(i) && owner_[i] == owner && highest(forms[i], at) < 0) return true;
    }
    return false;
  }

  /// Adds what the limits are on the branches; false where they hold nothing that is reached. `forms` and `exists`: of
  /// the core and of each leaf the branch that is certain and best.
  bool judge_branches(const Place& at, const Branches& from, Possible& possible, std::vector<Form>& forms,
                      bool& exists) const {
    const std::size_t leaves = leaves_.size();
    std::vector<bool> alive(leaves, false), certain(leaves, false);
    std::vector<double> best(leaves, -kInfinity);
    Possible added(limits_);
    Look first, second;
    std::vector<Form> here;
    bool core_exists = false;
    for (std::size_t round = 0; round < from.rounds(); ++round) {
      const Piece piece = select(from, round, leaves_);
      look(at, piece, first, nullptr);
      if (first.none) return false;
      Piece tube = first.narrowed;
      const bool core_follows = first.regular;
      bool wide = !core_follows;
      for (std::size_t l = 0; l < leaves; ++l) wide = wide || (!first.leaf_none[l] && !first.leaf_regular[l]);
      if (wide) {  // once more on what is left
        Look again;
        std::vector<bool> gone = first.leaf_none;
        for (std::size_t l = 0; l < leaves; ++l) {
          if (!gone[l]) continue;
          const int j = leaves_[l].first;
          tube.radius[j] = piece.radius[j];
          tube.middle[j] = piece.middle[j];
        }
        look(at, tube, again, nullptr);
        if (again.none) return false;
        for (std::size_t l = 0; l < leaves; ++l) {
          again.leaf_none[l] = again.leaf_none[l] || gone[l];
          again.leaf_exists[l] = again.leaf_exists[l] || first.leaf_exists[l];
        }
        again.exists = again.exists || first.exists;
        std::swap(first, again);
        tube = first.narrowed;
      }
      core_exists = core_exists || first.exists;
      if (first.regular) {
        for (const int j : core_) {
          tube.middle[j] = first.follows.middle[j];
          tube.slope.row(j) = first.follows.slope.row(j);
          tube.radius[j] = 1.2 * first.follows.radius[j];
        }
      }
      for (std::size_t l = 0; l < leaves; ++l) {
        const int j = leaves_[l].first;
        if (first.leaf_none[l]) {  // whatever: it is not looked at
          tube.middle[j] = piece.middle[j];
          tube.radius[j] = 0;
        } else if (first.leaf_regular[l]) {
          tube.middle[j] = first.follows.middle[j];
          tube.slope.row(j) = first.follows.slope.row(j);
          tube.radius[j] = 1.2 * first.follows.radius[j];
        }
      }
      look(at, tube, second, &here);
      if (second.none) return false;
      core_exists = core_exists || second.exists;
      if (broken_by(-1, here, at)) return false;
      if (round == 0) {
        forms = here;
        for (std::size_t i = 0; i < limits_; ++i) {
          if (owner_[i] < 0) added[i].push_back(here[i]);
        }
      }
      for (std::size_t l = 0; l < leaves; ++l) {
        if (round >= from.leaves[l].size() || first.leaf_none[l] || second.leaf_none[l]) continue;
        const int owner = static_cast<int>(l);
        if (broken_by(owner, here, at)) continue;
        alive[l] = true;
        double least = kInfinity;
        for (std::size_t i = 0; i < limits_; ++i) {
          if (owner_[i] != owner) continue;
          added[i].push_back(here[i]);
          if (heeds(i)) least = std::min(least, lowest(here[i], at));
        }
        if (!(first.leaf_exists[l] || second.leaf_exists[l]) || (certain[l] && least <= best[l])) continue;
        certain[l] = true;
        best[l] = least;
        for (std::size_t i = 0; i < limits_; ++i) {
          if (owner_[i] == owner) forms[i] = here[i];
        }
      }
    }
    if (std::find(alive.begin(), alive.end(), false) != alive.end()) return false;
    for (std::size_t i = 0; i < limits_; ++i) {
      possible[i].insert(possible[i].end(), added[i].begin(), added[i].end());
    }
    exists = core_exists && std::find(certain.begin(), certain.end(), false) == certain.end();
    return true;
  }

  // Solutions --------------------------------------------------------------------------------------------------------

  /// Newton's method at the middle of a place.
  bool solve(const Place& at, Column& u, Look& last) const {
    const Place middle{at.center, Vec3::Zero(), at.patch};
    Piece point{u, Column::Zero(unknowns_), Slopes::Zero(unknowns_, 5)};
    for (int k = 0; k < 12; ++k) {
      point.middle = u;
      if (!look_at_point(middle, point, last)) return false;
      const Column step = last.Y * last.c;
      if (!step.allFinite() || step.cwiseAbs().maxCoeff() > 10) return false;
      u -= step;
      if (step.cwiseAbs().maxCoeff() < 1e-10) return true;
    }
    return false;
  }
  bool look_at_point(const Place& at, const Piece& point, Look& out) const {
    PoseT<BoxNumber> X;
    std::vector<BoxNumber> q;
    pose(at, point, out.domain, X, q);
    const auto F = machine_->equations(X, q);
    const Eigen::Index n = unknowns_;
    out.B.resize(n, n);
    out.A.resize(n, 5);
    out.c.resize(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      out.c[i] = F[i].value();
      for (int k = 0; k < 5; ++k) out.A(i, k) = F[i].gradient(static_cast<std::size_t>(k));
      for (Eigen::Index j = 0; j < n; ++j) out.B(i, j) = F[i].gradient(kPrescribed + static_cast<std::size_t>(j));
    }
    out.Y = Eigen::PartialPivLU<Matrix>(out.B).inverse();
    return out.Y.allFinite() && out.Y.cwiseAbs().maxCoeff() < 1e9;
  }

  /// The branch next to a seed over the place; false where it is not certain everywhere.
  bool judge_seed(const Place& at, const Column& seed, std::vector<Form>& forms) const {
    Column u = seed;
    Look point;
    if (!solve(at, u, point)) return false;
    Piece tube{u, Column::Zero(unknowns_), -(point.Y * point.A)};
    Look line;
    look(at, tube, line, nullptr);
    // By all equations at once: |Y| (what they are off along the line).
    const Column off = line.c.cwiseAbs() + line.rest;
    if (!off.allFinite()) return false;
    tube.radius = 1.5 * (point.Y.cwiseAbs() * off) + Column::Constant(unknowns_, 1e-13);
    for (int attempt = 0; attempt < 3; ++attempt) {
      Look around;
      look(at, tube, around, &forms);
      if (around.none) return false;
      if (around.exists &&
          std::find(around.leaf_exists.begin(), around.leaf_exists.end(), false) == around.leaf_exists.end()) {
        return true;
      }
      tube.radius *= 2;
    }
    return false;
  }

  // The pieces of a box ----------------------------------------------------------------------------------------------

  static constexpr int kDeepest = 7;  ///< boxes below share the pieces of the one above

  [[nodiscard]] Place place_of(const Key& key) const {
    const double share = std::ldexp(1.0, -key.level);
    Place out;
    out.half = 0.5 * share * (high_ - low_);
    for (int k = 0; k < 3; ++k) {
      out.center[k] =
          low_[k] + (static_cast<double>(key.index[static_cast<std::size_t>(k)]) + 0.5) * share * (high_[k] - low_[k]);
    }
    // A little wider, so that a box's own octants lie within whatever the rounding.
    out.half *= 1 + 1e-9;
    out.patch = &whole_;
    return out;
  }

  /// The smallest box of the tree that holds the place.
  [[nodiscard]] const Node& node_over(const Place& at) const {
    const Vec3 size = high_ - low_;
    int level = kDeepest;
    for (int k = 0; k < 3; ++k) {
      level = std::min(level, static_cast<int>(std::floor(std::log2(size[k] / (2 * at.half[k])) + 1e-6)));
    }
    Key key;
    for (key.level = std::max(0, level); key.level > 0; --key.level) {
      const Place box = [&] {
        for (int k = 0; k < 3; ++k) {
          key.index[static_cast<std::size_t>(k)] =
              static_cast<std::int64_t>(std::floor(std::ldexp((at.center[k] - low_[k]) / size[k], key.level)));
        }
        return place_of(key);
      }();
      if (((at.center - box.center).cwiseAbs() + at.half).cwiseQuotient(box.half).maxCoeff() <= 1 + 1e-12) break;
    }
    if (key.level <= 0) key = Key();
    return node(key);
  }

  const Node& node(const Key& key) const {
    {
      const std::lock_guard lock(mutex_);
      if (const auto known = nodes_.find(key); known != nodes_.end()) return *known->second;
    }
    auto made = std::make_unique<Node>(make(key));
    const std::lock_guard lock(mutex_);
    return *nodes_.try_emplace(key, std::move(made)).first->second;
  }

  [[nodiscard]] Node make(const Key& key) const {
    const Place at = place_of(key);
    Node from;
    if (key.level > 0) {
      Key above = key;
      --above.level;
      for (std::int64_t& i : above.index) i >>= 1;
      from = node(above);
    } else {
      Branches all;
      all.core = root_;
      for (const auto& [j, row] : leaves_) all.leaves.push_back({{root_.middle[j], root_.radius[j]}});
      from.branches = {all};
    }
    Node out;
    constexpr int kAtFirst = 400, kLater = 12;
    out.branches = cover(at, from.branches, key.level == 0 ? kAtFirst : kLater);
    const auto add_seed = [&](Column u) {
      Look last;
      if (!solve(at, u, last)) return;
      const bool known = std::any_of(out.seeds.begin(), out.seeds.end(),
                                     [&](const Column& other) { return (other - u).cwiseAbs().maxCoeff() < 1e-6; });
      if (!known && out.seeds.size() < 8) out.seeds.push_back(u);
    };
    if (out.branches.empty()) return out;
    out.seeds = from.seeds;
    constexpr std::size_t kTries = 6;
    for (std::size_t k = 0; k < std::min(kTries, out.branches.size()) && out.seeds.empty(); ++k) {
      add_seed(
          select(out.branches[k * out.branches.size() / std::min(kTries, out.branches.size())], k, leaves_).middle);
    }
    constexpr int kCoarse = 4;
    if (key.level <= kCoarse && (out.seeds.empty() || key.level <= 2)) {
      for (const ClosureQuestions::Solved& s : machine_->solutions(target(at))) add_seed(unknowns_of(at, s));
    }
    return out;
  }

  [[nodiscard]] Pose target(const Place& at) const {
    const machine::Task task = machine_->prescribes;
    if (!task.places()) return kinematics::pose_of(task, {at.center[0], at.center[1], at.center[2]});
    const bool whole = task.names_axis() || task.size() == 6;
    return {whole ? at.patch->R : rotation_abc(angle_of(*at.patch, 3), angle_of(*at.patch, 4), 0), at.center};
  }
  [[nodiscard]] Column unknowns_of(const Place& at, const ClosureQuestions::Solved& solved) const {
    Column u(unknowns_);
    const Vec3 abc = angles_abc(solved.X.R);
    for (std::size_t i = 0; i < free_.size(); ++i) {
      const int k = free_[i];
      const auto row = static_cast<Eigen::Index>(i);
      if (k == kTurnAboutAxis) {
        const Mat3 turn = at.patch->R.transpose() * solved.X.R;
        u[row] = std::atan2(turn(1, 0), turn(0, 0));
      } else {
        u[row] = k < 3 ? solved.X.p[k] : abc[k - 3];
      }
    }
    u.tail(solved.q.size()) = solved.q;
    return u;
  }

  /// The parts of the branches that may hold a solution within the limits, halved where that says more.
  [[nodiscard]] std::vector<Branches> cover(const Place& at, const std::vector<Branches>& from, int halvings) const {
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

  /// Neighbours that touch become one where the core of both together is known in first order.
  void merge(const Place& at, std::vector<Branches>& all) const {
    Look both;
    for (std::size_t a = 0; a < all.size(); ++a) {
      for (std::size_t b = a + 1; b < all.size();) {
        const Piece &one = all[a].core, &other = all[b].core;
        Branches hull = all[a];
        bool touch = true;
        for (const int j : core_) {
          const double low = std::min(one.middle[j] - one.radius[j], other.middle[j] - other.radius[j]),
                       high = std::max(one.middle[j] + one.radius[j], other.middle[j] + other.radius[j]);
          touch = touch && std::abs(one.middle[j] - other.middle[j]) <= one.radius[j] + other.radius[j] + 1e-12;
          hull.core.middle[j] = 0.5 * (low + high);
          hull.core.radius[j] = 0.5 * (high - low) * (1 + 1e-12);
        }
        if (touch) {
          for (std::size_t l = 0; l < leaves_.size(); ++l) {
            hull.leaves[l].insert(hull.leaves[l].end(), all[b].leaves[l].begin(), all[b].leaves[l].end());
            join(hull.leaves[l]);
          }
          look(at, select(hull, 0, leaves_), both, nullptr);
          touch = !both.none && both.regular;
        }
        if (!touch) {
          ++b;
          continue;
        }
        for (const int j : core_) {
          hull.core.middle[j] = both.narrowed.middle[j];
          hull.core.radius[j] = both.narrowed.radius[j];
        }
        all[a] = std::move(hull);
        all.erase(all.begin() + static_cast<std::ptrdiff_t>(b));
        b = a + 1;
      }
    }
  }

  /// Drops what holds no solution, halves leaves that are loose; `split` is the unknown of the core in which halves
  /// would say more, or -1. False where nothing is left.
  bool narrow(const Place& at, Branches& now, int& split) const {
    const std::size_t leaves = leaves_.size();
    Look look_now;
    std::vector<Form> forms;
    // The core by itself, with the first spans of the leaves.
    for (int k = 0; k < 4 && !core_.empty(); ++k) {
      look(at, select(now, 0, leaves_), look_now, nullptr);
      if (look_now.none) return false;
      double kept = 1;
      for (const int j : core_) {
        if (now.core.radius[j] > 0) kept = std::min(kept, look_now.narrowed.radius[j] / now.core.radius[j]);
        now.core.middle[j] = look_now.narrowed.middle[j];
        now.core.radius[j] = look_now.narrowed.radius[j];
      }
      if (kept > 0.7) break;
    }
    split = -1;
    double widest = 0;
    const auto core_may = [&] {
      for (const int j : core_) {
        const double share = now.core.radius[j] / root_.radius[j];
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
        const Piece piece = select(now, round, leaves_);
        look(at, piece, look_now, &forms);
        if (look_now.none || broken_by(-1, forms, at)) return false;
        if (round == 0 && pass == 0) {
          core_may();
          for (std::size_t i = 0; i < limits_; ++i)
            core_is_loose = core_is_loose || (owner_[i] < 0 && loose(forms[i], i, at, look_now));
        }
        for (std::size_t l = 0; l < leaves; ++l) {
          if (round >= now.leaves[l].size() || look_now.leaf_none[l]) continue;
          if (broken_by(static_cast<int>(l), forms, at)) continue;
          const int j = leaves_[l].first;
          const Span span{look_now.narrowed.middle[j], look_now.narrowed.radius[j]};
          bool wide = false;
          for (std::size_t i = 0; i < limits_; ++i) {
            wide = wide || (owner_[i] == static_cast<int>(l) && loose(forms[i], i, at, look_now));
          }
          const bool driven =
              look_now.leaf_regular[l] && span.radius <= 2 * spread(look_now.domain, look_now.follows.slope, j);
          if (wide) core_is_loose = true;
          if (!wide || driven || split >= 0 || next[l].size() + 2 > kMostSpans ||
              !(span.radius > 1e-6 * root_.radius[j])) {
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
  [[nodiscard]] bool loose(const Form& f, std::size_t limit, const Place& at, const Look& now) const {
    if (!heeds(limit) || lowest(f, at) >= 0) return false;
    return !(f.rest <= 0.5 * spread(now.domain, f.slope.data()));
  }
  /// Spans that overlap or touch become one.
  static void join(std::vector<Span>& spans) {
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

  // The answer -------------------------------------------------------------------------------------------------------

  [[nodiscard]] Verdict weighed(const Place& at, const Possible& possible,
                                const std::optional<std::vector<Form>>& chosen, double least, BoundList& out) const {
    constexpr double kNothing = -1e300;
    if (chosen && least >= 0) return Verdict::inside;
    for (std::size_t i = 0; i < limits_; ++i) {
      if (!heeds(i)) continue;
      const Form& f = chosen ? (*chosen)[i] : possible[i].front();
      if (chosen && lowest(f, at) >= 0) continue;
      // At the direction that is worst for that form.
      double M = -kInfinity;
      for (const Form& other : possible[i]) {
        Form apart = other;
        for (std::size_t k = 0; k < kPrescribed; ++k) apart.slope[k] -= f.slope[k];
        const double turned = at.patch->sector ? at.patch->turn * std::hypot(apart.slope[3], apart.slope[4])
                                               : std::abs(apart.slope[3]) * std::abs(at.patch->corner[3][0]) +
                                                     std::abs(apart.slope[4]) * std::abs(at.patch->corner[3][1]);
        M = std::max(M, other.value + other.rest + by_position(apart, at) + turned);
      }
      const double worst = at.patch->least(f.slope[3], f.slope[4]);
      Bound b;
      b.limit = static_cast<int>(i);
      b.M = std::isfinite(M) ? M + worst : kInfinity;
      b.G = Vec3(f.slope[0], f.slope[1], f.slope[2]);
      b.m = chosen ? f.value + worst - f.rest : kNothing;
      if (!std::isfinite(b.m)) b.m = kNothing;
      if (b.M + by_position(f, at) < 0) {
        out.clear();
        return Verdict::outside;
      }
      if (!chosen && !(b.M - by_position(f, at) < 0)) continue;
      if (!out.push_back(b)) {
        out.clear();
        return Verdict::open;
      }
    }
    return out.empty() ? Verdict::open : Verdict::undecided;
  }

  /// Leaves are joints that one equation alone holds, one to an equation; each limit holds at most one of them.
  void find_structure() {
    const Place at{low_ + 0.45 * (high_ - low_), 0.01 * (high_ - low_), &whole_};
    Piece piece = root_;
    piece.middle += 0.07 * root_.radius;
    piece.radius *= 0.01;
    BoxDomain domain;
    PoseT<BoxNumber> X;
    std::vector<BoxNumber> q;
    pose(at, piece, domain, X, q);
    const auto F = machine_->equations(X, q);
    const auto g = machine_->kept(X, q);
    limits_ = g.size();
    const auto n = static_cast<std::size_t>(unknowns_);
    std::vector<std::vector<bool>> in_F(n, std::vector<bool>(n)), in_g(g.size(), std::vector<bool>(n));
    for (std::size_t j = 0; j < n; ++j) {
      Piece still = piece;
      still.radius[static_cast<Eigen::Index>(j)] = 0;
      BoxDomain d;
      PoseT<BoxNumber> Y;
      std::vector<BoxNumber> r;
      pose(at, still, d, Y, r);
      const auto F_still = machine_->equations(Y, r);
      const auto g_still = machine_->kept(Y, r);
      const auto holds = [&](const BoxNumber& a, const BoxNumber& b) {
        return a.gradient(kPrescribed + j) != 0 || a.rest() != b.rest() || a.value() != b.value();
      };
      for (std::size_t i = 0; i < n; ++i) {
        in_F[i][j] = holds(F[static_cast<Eigen::Index>(i)], F_still[static_cast<Eigen::Index>(i)]);
      }
      for (std::size_t i = 0; i < g.size(); ++i) in_g[i][j] = holds(g[i], g_still[i]);
    }
    std::vector<int> row_of(n, -1);
    std::vector<bool> taken(n, false);
    for (std::size_t j = free_.size(); j < n; ++j) {
      int row = -1, count = 0;
      for (std::size_t i = 0; i < n; ++i) {
        if (!in_F[i][j]) continue;
        ++count;
        row = static_cast<int>(i);
      }
      if (count != 1 || taken[static_cast<std::size_t>(row)]) continue;
      const bool alone = std::none_of(in_g.begin(), in_g.end(), [&](const std::vector<bool>& limit) {
        bool other = false;
        for (std::size_t k = 0; k < n; ++k) other = other || (k != j && row_of[k] >= 0 && limit[k]);
        return limit[j] && other;
      });
      if (!alone) continue;
      row_of[j] = row;
      taken[static_cast<std::size_t>(row)] = true;
    }
    for (std::size_t j = 0; j < n; ++j) {
      if (row_of[j] >= 0) {
        leaves_.emplace_back(static_cast<int>(j), row_of[j]);
      } else {
        core_.push_back(static_cast<int>(j));
      }
      if (!taken[j]) core_rows_.push_back(static_cast<int>(j));
    }
    owner_.assign(g.size(), -1);
    for (std::size_t i = 0; i < g.size(); ++i)
      for (std::size_t l = 0; l < leaves_.size(); ++l) {
        if (in_g[i][static_cast<std::size_t>(leaves_[l].first)]) owner_[i] = static_cast<int>(l);
      }
  }

  /// How far a turn of 1 rad moves the unknowns, measured by what moves them as far, at home.
  void find_lever() {
    lever_ = 1;
    const Place at{0.5 * (low_ + high_), Vec3::Zero(), &whole_};
    for (const ClosureQuestions::Solved& s : machine_->solutions(target(at))) {
      Column u = unknowns_of(at, s);
      Look last;
      if (!solve(at, u, last)) continue;
      const Slopes by_v = last.Y * last.A;
      const double moved = by_v.leftCols<3>().bottomRows(s.q.size()).cwiseAbs().maxCoeff();
      const double turned = by_v.rightCols<2>().bottomRows(s.q.size()).cwiseAbs().maxCoeff();
      if (moved > 0 && turned > 0) lever_ = turned / moved;
      return;
    }
  }

  std::shared_ptr<const ClosureQuestions> machine_;
  Options options_;
  Patch whole_;
  LimitBits mask_ = ~LimitBits{0};
  std::vector<int> free_;                       ///< coordinates that follow
  std::array<int, 3> box_coordinate_{0, 1, 2};  ///< which coordinates the box is of
  int unknowns_ = 0;
  std::size_t limits_ = 0;
  std::vector<int> core_, core_rows_;        ///< unknowns and equations of the core
  std::vector<std::pair<int, int>> leaves_;  ///< an unknown and the one equation that holds it
  std::vector<int> owner_;                   ///< of each limit the leaf that it holds, or -1
  Piece root_;
  Vec3 tip_low_, tip_high_;
  Vec3 low_ = Vec3::Zero(), high_ = Vec3::Zero();
  double lever_ = 1;
  mutable std::mutex mutex_;
  mutable std::unordered_map<Key, std::unique_ptr<Node>, KeyHash> nodes_;
};

Result<std::optional<ClosureLimits>> ClosureLimits::of(std::shared_ptr<const ClosureQuestions> questions,
                                                       const Options& options) {
  const machine::Task task = questions->prescribes;
  if (!task.places() && task.size() != 3) {
    return fail("WS106",
                fmt::format("{}: a task of {} coordinates without x, y, z has no volume", questions->name, task.size()),
                {}, "workspaces are for tasks that hold x, y, z, or three coordinates in all");
  }
  const Directions& d = options.directions;
  const auto asks = [](const std::optional<std::array<double, 2>>& range) {
    return range && *range != std::array<double, 2>{0, 0};
  };
  const bool whole = task.size() == 6 || task.names_axis();
  if ((d.tilt != 0 && !whole) || (asks(d.a_range) && !(task.places() && task.holds(machine::Coordinate::a))) ||
      (asks(d.b_range) && !(task.places() && task.holds(machine::Coordinate::b)))) {
    return fail(
        "WS104",
        fmt::format("{} cannot tilt its tool as it is told: the task does not hold the angles", questions->name), {},
        "leave out the tilt and the ranges of A and B");
  }
  auto state = std::make_shared<State>(std::move(questions), options);
  if (!state->begin()) return std::optional<ClosureLimits>{};
  return std::optional(ClosureLimits(std::move(state)));
}

double ClosureLimits::lever() const {
  return state_->lever();
}
void ClosureLimits::box(Vec3& low, Vec3& high, const Directions&) const {
  low = state_->low();
  high = state_->high();
}
Verdict ClosureLimits::judge(int, const Vec3& center, const Vec3& half, double, const Patch& patch, const Data&,
                             BoundList& out) const {
  return state_->judge({center, half, &patch}, out);
}

template Result<Volume> subdivided_volume(const ClosureLimits&, const Options&);
template Result<bool> subdivided_holds(const ClosureLimits&, const Options&, const Shape&, std::int64_t);

}  // namespace polypod::workspace
