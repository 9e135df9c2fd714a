// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "system.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "polypod/workspace/task_directions.hpp"

namespace polypod::workspace::by_closure {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr int kTurnAboutAxis = 6;

PoseT<Interval> any_pose() {
  PoseT<Interval> X;
  for (int i = 0; i < 9; ++i) X.R(i / 3, i % 3) = Interval(-1, 1);
  for (int i = 0; i < 3; ++i) X.p[i] = Interval::whole();
  return X;
}

/// The held angles of a patch of ranges: A = s, B = t, C = 0.
double angle_of(const Patch& patch, int k) {
  return k == 3 ? 0.5 * (patch.low[0] + patch.high[0]) : k == 4 ? 0.5 * (patch.low[1] + patch.high[1]) : 0.0;
}

}  // namespace

System::System(std::shared_ptr<const Questions> questions, const Options& options)
    : machine_(std::move(questions)), options_(options), whole_(whole_patch(options.directions)) {
  const machine::Task task = machine_->prescribes;
  for (int k = 0; k < 6; ++k) {
    if (!task.holds(static_cast<machine::Coordinate>(k))) free_.push_back(k);
  }
  if (task.names_axis()) free_ = {kTurnAboutAxis};
  if (!task.places()) {
    for (int i = 0; i < 3; ++i) {
      box_coordinate_[static_cast<std::size_t>(i)] = i < task.size() ? static_cast<int>(task[i]) : kNone;
    }
  }
  unknowns_ = static_cast<int>(free_.size() + machine_->ranges.size());
  for (std::size_t i = 0; i < std::min<std::size_t>(machine_->table.size(), 64); ++i) {
    if (machine_->table[i].between_bodies && !options.interference) mask_ &= ~(LimitBits{1} << i);
  }
  mask_ &= options.limits;
}

bool System::begin() {
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
    if (k == kNone) {
      low_[i] = -kAcross;
      high_[i] = kAcross;
      continue;
    }
    low_[i] = k < 3 ? tip_low_[k] : home_angles[k - 3] - kFromHome;
    high_[i] = k < 3 ? tip_high_[k] : home_angles[k - 3] + kFromHome;
  }
  // As many equations as unknowns: only then a zero of Y F is one of F.
  Piece home = root_;
  home.radius.setZero();
  const Place at{0.5 * (low_ + high_), Vec3::Zero(), &whole_};
  const Expressed around(*this, at, home);
  if (machine_->equations(around.X, around.q).size() != unknowns_) return false;
  find_structure();
  find_lever();
  return true;
}

bool System::hold_joints() {
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

bool System::limits_break(std::size_t joint, const Interval& where) const {
  std::vector<Interval> q(machine_->ranges.size(), Interval::whole());
  q[joint] = where;
  const std::vector<Interval> g = machine_->kept(any_pose(), q);
  for (std::size_t i = 0; i < g.size(); ++i) {
    if (heeds(i) && g[i].hi() < 0) return true;
  }
  return false;
}

bool System::hold_tip() {
  tip_low_ = Vec3::Constant(-kInfinity);
  tip_high_ = Vec3::Constant(kInfinity);
  constexpr int kRounds = 3;
  for (int round = 0; round < kRounds; ++round) {
    for (int k = 0; k < 6; ++k) narrow_tip(k % 3, k < 3 ? 1 : -1);
  }
  return tip_low_.allFinite() && tip_high_.allFinite();
}

void System::narrow_tip(int axis, double sign) {
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

bool System::tip_is_out(int axis, double sign, double beyond) const {
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

System::Expressed::Expressed(const System& system, const Place& at, const Piece& piece) {
  using N = BoxNumber;
  const Patch& patch = *at.patch;
  BoxDomain& d = domain;
  d.count = kPrescribed + static_cast<std::size_t>(system.unknowns_);
  for (int k = 0; k < 3; ++k) d.reach[static_cast<std::size_t>(k)] = at.half[k];
  if (patch.sector) {
    d.disc = 3;
    d.radius = patch.turn;
  } else {
    d.reach[3] = std::abs(patch.corner[3][0]);
    d.reach[4] = std::abs(patch.corner[3][1]);
  }
  for (int j = 0; j < system.unknowns_; ++j) d.reach[kPrescribed + static_cast<std::size_t>(j)] = piece.radius[j];
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
  for (std::size_t i = 0; i < system.free_.size(); ++i) {
    if (system.free_[i] == kTurnAboutAxis) {
      about_axis = unknown(i);
    } else {
      c[static_cast<std::size_t>(system.free_[i])] = unknown(i);
      given[static_cast<std::size_t>(system.free_[i])] = true;
    }
  }
  const machine::Task task = system.machine_->prescribes;
  for (int k = 0; k < 6; ++k) {
    const auto coordinate = static_cast<std::size_t>(k);
    if (given[coordinate]) continue;
    int box = -1;
    for (int i = 0; i < 3; ++i) box = system.box_coordinate_[static_cast<std::size_t>(i)] == k ? i : box;
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
  for (std::size_t j = system.free_.size(); j < static_cast<std::size_t>(system.unknowns_); ++j)
    q.push_back(unknown(j));
}

double spread(const BoxDomain& d, const double* slope, Eigen::Index stride) {
  double sum = 0;
  for (Eigen::Index k = 0; k < 5; ++k) sum += std::abs(slope[k * stride]) * d.reach[static_cast<std::size_t>(k)];
  if (d.radius > 0) sum += d.radius * std::hypot(slope[3 * stride], slope[4 * stride]);
  return sum;
}

double spread(const BoxDomain& d, const Slopes& slopes, Eigen::Index row) {
  const std::array<double, 5> s{slopes(row, 0), slopes(row, 1), slopes(row, 2), slopes(row, 3), slopes(row, 4)};
  return spread(d, s.data());
}

void System::first_order(const machine::ClosureVectorT<BoxNumber>& F, FirstOrderClosure& out) const {
  const Eigen::Index n = unknowns_;
  out.B.resize(n, n);
  out.A.resize(n, 5);
  out.c.resize(n);
  out.rest.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const BoxNumber& f = F[i];
    out.c[i] = f.value();
    out.rest[i] = f.rest();
    for (int k = 0; k < 5; ++k) out.A(i, k) = f.gradient(static_cast<std::size_t>(k));
    for (Eigen::Index j = 0; j < n; ++j) out.B(i, j) = f.gradient(kPrescribed + static_cast<std::size_t>(j));
  }
}

void System::look(const Place& at, const Piece& piece, Look& out, std::vector<Form>* forms) const {
  const Expressed here(*this, at, piece);
  const BoxDomain& d = out.domain = here.domain;
  const auto F = machine_->equations(here.X, here.q);
  const Eigen::Index n = unknowns_;
  const std::size_t leaves = leaves_.size();
  out.none = out.regular = out.exists = false;
  out.leaf_none.assign(leaves, false);
  out.leaf_regular.assign(leaves, false);
  out.leaf_exists.assign(leaves, false);
  first_order(F, out);
  Column moved(n);  // by v
  std::array<bool, BoxDomain::kMost> closes{};
  for (Eigen::Index i = 0; i < n; ++i) {
    moved[i] = spread(d, out.A, i);
    closes[static_cast<std::size_t>(i)] = std::abs(F[i].value()) <= F[i].radius() * (1 + 1e-12) + 1e-15;
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
  if (forms != nullptr) limits_over(machine_->kept(here.X, here.q), piece, out, *forms);
}

void System::limits_over(const std::vector<BoxNumber>& g, const Piece& piece, const Look& look,
                         std::vector<Form>& forms) const {
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

double lowest(const Form& f, const Place& at) {
  return f.value + at.patch->least(f.slope[3], f.slope[4]) - f.rest - by_position(f, at);
}

double highest(const Form& f, const Place& at) {
  return f.value - at.patch->least(-f.slope[3], -f.slope[4]) + f.rest + by_position(f, at);
}

double by_position(const Form& f, const Place& at) {
  return std::abs(f.slope[0]) * at.half[0] + std::abs(f.slope[1]) * at.half[1] + std::abs(f.slope[2]) * at.half[2];
}

double System::least_of(const std::vector<Form>& forms, const Place& at) const {
  double least = kInfinity;
  for (std::size_t i = 0; i < forms.size(); ++i) {
    if (heeds(i)) least = std::min(least, lowest(forms[i], at));
  }
  return least;
}

bool System::solve(const Place& at, Column& u, Look& last) const {
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

bool System::look_at_point(const Place& at, const Piece& point, Look& out) const {
  const Expressed here(*this, at, point);
  first_order(machine_->equations(here.X, here.q), out);
  out.Y = Eigen::PartialPivLU<Matrix>(out.B).inverse();
  return out.Y.allFinite() && out.Y.cwiseAbs().maxCoeff() < 1e9;
}

Pose System::target(const Place& at) const {
  const machine::Task task = machine_->prescribes;
  if (!task.places()) return kinematics::pose_of(task, {at.center[0], at.center[1], at.center[2]});
  const bool whole = task.names_axis() || task.size() == 6;
  return {whole ? at.patch->R : rotation_abc(angle_of(*at.patch, 3), angle_of(*at.patch, 4), 0), at.center};
}

Column System::unknowns_of(const Place& at, const Questions::Solved& solved) const {
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

std::vector<Column> System::solutions(const Place& at) const {
  std::vector<Column> out;
  for (const Questions::Solved& s : machine_->solutions(target(at))) out.push_back(unknowns_of(at, s));
  return out;
}

void System::find_structure() {
  const Place at{low_ + 0.45 * (high_ - low_), 0.01 * (high_ - low_), &whole_};
  Piece piece = root_;
  piece.middle += 0.07 * root_.radius;
  piece.radius *= 0.01;
  const Expressed moving(*this, at, piece);
  const auto F = machine_->equations(moving.X, moving.q);
  const auto g = machine_->kept(moving.X, moving.q);
  limits_ = g.size();
  const auto n = static_cast<std::size_t>(unknowns_);
  std::vector<std::vector<bool>> in_F(n, std::vector<bool>(n)), in_g(g.size(), std::vector<bool>(n));
  for (std::size_t j = 0; j < n; ++j) {
    Piece still = piece;
    still.radius[static_cast<Eigen::Index>(j)] = 0;
    const Expressed held(*this, at, still);
    const auto F_still = machine_->equations(held.X, held.q);
    const auto g_still = machine_->kept(held.X, held.q);
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

void System::find_lever() {
  lever_ = 1;
  const Place at{0.5 * (low_ + high_), Vec3::Zero(), &whole_};
  const auto joints = static_cast<Eigen::Index>(machine_->ranges.size());
  for (Column u : solutions(at)) {
    Look last;
    if (!solve(at, u, last)) continue;
    const Slopes by_v = last.Y * last.A;
    const double moved = by_v.leftCols<3>().bottomRows(joints).cwiseAbs().maxCoeff();
    const double turned = by_v.rightCols<2>().bottomRows(joints).cwiseAbs().maxCoeff();
    if (moved > 0 && turned > 0) lever_ = turned / moved;
    return;
  }
}

}  // namespace polypod::workspace::by_closure
