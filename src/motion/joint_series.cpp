// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/joint_series.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "../families/quick_series.hpp"
#include "polypod/kinematics/closure.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/motion/driven_series.hpp"

namespace polypod::motion {
namespace {

using kinematics::ClosureMatrix;
using kinematics::Dual;
using machine::Coordinate;
using machine::Task;

constexpr int kMost = machine::kMaxEquations + 6;
using System = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMost, kMost>;
using Unknowns = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost, 1>;

/// Parameters are plain numbers beside the number type T of pose and joints where a family takes them so.
template <class M, class T>
constexpr bool kPlainParameters = requires(const M& m, const PoseT<T>& X, std::span<const T> q,
                                           std::span<const double> p) {
  closure(m, X, q, p);
};
template <class M, class T>
using Parameters = std::vector<std::conditional_t<kPlainParameters<M, T>, double, T>>;

template <class M, class T>
machine::ClosureVectorT<T> closure_at(const M& m, const PoseT<T>& X, const std::vector<T>& q,
                                      const Parameters<M, T>& p) {
  return closure(m, X, std::span<const T>(q), std::span(p));
}

/// Equations have units of their own (m, m^2, rad): each row is scaled to the largest entry 1, so that pivots compare,
/// but for rows of nothing but rounding, which a singular pose has. Returns the factors.
template <class Rows>
Unknowns scale_rows(Rows& rows) {
  constexpr double kRounding = 1e-13;
  Unknowns scale(rows.rows());
  for (int i = 0; i < rows.rows(); ++i) scale[i] = rows.row(i).cwiseAbs().maxCoeff();
  const double nothing = scale.size() == 0 ? 0 : kRounding * scale.maxCoeff();
  for (int i = 0; i < rows.rows(); ++i) {
    scale[i] = scale[i] > nothing ? 1 / scale[i] : 1;
    rows.row(i) *= scale[i];
  }
  return scale;
}

/// What the task prescribes of X against the target, 0 where it is kept, from its coordinate `first` on.
template <class T>
Eigen::Matrix<T, Eigen::Dynamic, 1, 0, 6, 1> task_equations(Task task, const PoseT<T>& X, const PoseT<T>& target,
                                                            const Pose& at, int first) {
  Eigen::Matrix<T, Eigen::Dynamic, 1, 0, 6, 1> out(task.size() - first);
  int row = 0;
  for (int k = first; k < 3; ++k)
    if (task.holds(static_cast<Coordinate>(k))) out[row++] = X.p[k] - target.p[k];
  const auto turns = out.size() - row;
  if (turns == 0) return out;
  const Matrix3<T>&R = X.R, &W = target.R;
  if (task.names_axis()) {
    for (int side = 0; side < 2; ++side) {
      T e(0.0);
      for (int i = 0; i < 3; ++i) e += T(at.R(i, side)) * (R(i, 2) - W(i, 2));
      out[row++] = e;
    }
    return out;
  }
  if (turns == 3) {
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;  // of E = R R_target^T, half of E(j, i) - E(i, j)
      T e(0.0);
      for (int c = 0; c < 3; ++c) e += R(j, c) * W(i, c) - R(i, c) * W(j, c);
      out[row++] = T(0.5) * e;
    }
    return out;
  }
  if (task.holds(Coordinate::a)) out[row++] = R(2, 1) * W(2, 2) - R(2, 2) * W(2, 1);
  if (task.holds(Coordinate::b)) out[row++] = W(2, 0) - R(2, 0);
  if (task.holds(Coordinate::c)) out[row++] = R(1, 0) * W(0, 0) - R(0, 0) * W(1, 0);
  return out;
}

/// Coefficients of exp([w]x): of W = A s + B s^2 + C s^3 those of 1 + W + W^2 / 2 + W^3 / 6 to the third order.
std::array<Mat3, Series::kOrder + 1> turn_coefficients(const Vector3<Series>& w) {
  const auto part = [&](int order) { return skew(Vec3(w[0][order], w[1][order], w[2][order])); };
  const Mat3 A = part(1), B = part(2), C = part(3), A2 = A * A;
  return {Mat3::Identity(), A, B + 0.5 * A2, C + 0.5 * (A * B + B * A) + A2 * A / 6};
}

/// A matrix by its coefficients.
Matrix3<Series> series_from(const std::array<Mat3, Series::kOrder + 1>& coefficients) {
  Matrix3<Series> out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k <= Series::kOrder; ++k) out(i, j)[k] = coefficients[static_cast<std::size_t>(k)](i, j);
  return out;
}

/// The pose moved by series of its twist, which begin with 0.
PoseSeries moved(const Pose& at, const Vector3<Series>& v, const Vector3<Series>& w) {
  std::array<Mat3, Series::kOrder + 1> R = turn_coefficients(w);
  for (Mat3& coefficient : R) coefficient *= at.R;
  PoseSeries out;
  out.R = series_from(R);
  for (int k = 0; k < 3; ++k) out.p[k] = Series(at.p[k]) + v[k];
  return out;
}

/// What of the twist no pose prescribes alone: where x, y and z are prescribed, the target is the tool's place at every
/// order, and where the whole pose is, the tool's pose. The twist from this component on is unknown.
int first_unknown(Task task) {
  for (const Coordinate k : {Coordinate::x, Coordinate::y, Coordinate::z})
    if (!task.holds(k)) return 0;
  return task.size() == 6 ? 6 : 3;
}

/// X moved by a unit of each part of the twist from the first on, in order.
PoseT<Dual> moved_from(int first, const Pose& at) {
  PoseT<Dual> X = at.cast<Dual>();
  for (int k = first; k < 6; ++k) {
    if (k < 3) {
      X.p[k].v[k - first] = 1;
      continue;
    }
    const Mat3 rate = skew(Vec3(Vec3::Unit(k - 3))) * at.R;
    for (int i = 0; i < 3; ++i)
      for (int c = 0; c < 3; ++c) X.R(i, c).v[k - first] = rate(i, c);
  }
  return X;
}

/// [F_X F_q] from the first unknown of the twist on, at a solution: six columns a pass on dual numbers.
template <class M>
System closure_columns(const M& m, int first, const Pose& at, const JointVector& joints, const Parameters<M, Dual>& p) {
  const int twist = 6 - first, columns = twist + static_cast<int>(joints.size());
  System K;
  std::vector<Dual> q(joints.data(), joints.data() + joints.size());
  PoseT<Dual> X = moved_from(first, at);
  for (int pass = 0; pass < columns; pass += 6) {
    const int count = std::min(6, columns - pass);
    if (pass > 0) X = at.cast<Dual>();
    const auto seed = [&](double unit) {
      for (int column = std::max(pass, twist); column < pass + count; ++column)
        q[static_cast<std::size_t>(column - twist)].v[column - pass] = unit;
    };
    seed(1);
    const machine::ClosureVectorT<Dual> F = closure_at(m, X, q, p);
    seed(0);
    if (pass == 0) K.resize(F.size(), columns);
    for (int i = 0; i < F.size(); ++i) K.block(i, pass, 1, count) = F[i].v.head(count).transpose();
  }
  return K;
}

/// [F_X F_q; T_X 0] from the first unknown of the twist on.
template <class M>
System unknowns_matrix(const M& m, Task task, int first, const Pose& target, const Pose& at, const JointVector& joints,
                       const Parameters<M, Dual>& p) {
  System F = closure_columns(m, first, at, joints, p);
  const int twist = 6 - first, seen = task.size() - first;
  if (seen == 0) return F;
  System K = System::Zero(F.rows() + seen, F.cols());
  K.topRows(F.rows()) = F;
  const auto T = task_equations(task, moved_from(first, at), target.cast<Dual>(), at, first);
  for (int i = 0; i < seen; ++i) K.block(F.rows() + i, 0, 1, twist) = T[i].v.head(twist).transpose();
  return K;
}

/// Of no machine of these families the closure is evaluated on series.
template <class M>
constexpr bool kNeverOnSeries = requires(const M& m) {
  requires decltype(closure_takes_no_series(m))::value;
};
template <class M>
bool on_series(const M& m) {
  if constexpr (requires { closure_takes_no_series(m); }) return !closure_takes_no_series(m);
  return true;
}

/// The coefficient of this order of the closure along a curve.
template <class M>
Unknowns coefficients_by_series(const M& m, const PoseSeries& X, const std::vector<Series>& q,
                                const Parameters<M, Series>& p, int order) {
  const machine::ClosureVectorT<Series> F = closure_at(m, X, q, p);
  Unknowns out(F.size());
  for (int i = 0; i < F.size(); ++i) out[i] = F[i][order];
  return out;
}

/// The derivative of the closure along a curve at s = h.
template <class M>
Unknowns rate_at(const M& m, const PoseSeries& X, const std::vector<Series>& q, const Parameters<M, Dual>& p,
                 double h) {
  const auto at = [&](const Series& s) {
    Dual out(s[0] + h * (s[1] + h * (s[2] + h * s[3])));
    out.v[0] = s[1] + h * (2 * s[2] + 3 * h * s[3]);
    return out;
  };
  PoseT<Dual> pose;
  for (int i = 0; i < 3; ++i) {
    pose.p[i] = at(X.p[i]);
    for (int j = 0; j < 3; ++j) pose.R(i, j) = at(X.R(i, j));
  }
  std::vector<Dual> joints;
  for (const Series& s : q) joints.push_back(at(s));
  const machine::ClosureVectorT<Dual> F = closure_at(m, pose, joints, p);
  Unknowns out(F.size());
  for (int i = 0; i < F.size(); ++i) out[i] = F[i].v[0];
  return out;
}

/// Central differences of eighth order: of the first derivative's own first and second derivative.
template <class M>
Unknowns coefficients_by_differences(const M& m, const PoseSeries& X, const std::vector<Series>& q,
                                     const Parameters<M, Dual>& p, int order) {
  if (order == 1) return rate_at(m, X, q, p, 0);
  constexpr double kSmall = 0.02;  // of lengths and rad, that the curve moves by
  constexpr std::array<double, 4> kFirst{4.0 / 5, -1.0 / 5, 4.0 / 105, -1.0 / 280};
  constexpr std::array<double, 5> kSecond{-205.0 / 72, 8.0 / 5, -1.0 / 5, 8.0 / 315, -1.0 / 560};
  double length = 0;
  for (int i = 0; i < 3; ++i) length = std::max(length, std::abs(X.p[i][0]));
  for (const Series& s : q) length = std::max(length, std::abs(s[0]));
  double h = 1;
  const auto bound = [&](const Series& s, double size) {
    for (int k = 1; k <= Series::kOrder; ++k)
      if (s[k] != 0) h = std::min(h, std::pow(kSmall * size / std::abs(s[k]), 1.0 / k));
  };
  for (int i = 0; i < 3; ++i) {
    bound(X.p[i], std::max(length, 1e-3));
    for (int j = 0; j < 3; ++j) bound(X.R(i, j), 1);
  }
  for (const Series& s : q) bound(s, std::max(length, 1e-3));
  Unknowns sum = order == 2 ? Unknowns() : Unknowns(kSecond[0] * rate_at(m, X, q, p, 0));
  for (int k = 1; k <= 4; ++k) {
    const Unknowns plus = rate_at(m, X, q, p, k * h), minus = rate_at(m, X, q, p, -k * h);
    const auto at = static_cast<std::size_t>(k);
    const Unknowns term =
        order == 2 ? Unknowns(kFirst[at - 1] * (plus - minus)) : Unknowns(kSecond[at] * (plus + minus));
    sum = sum.size() == 0 ? term : Unknowns(sum + term);
  }
  return order == 2 ? Unknowns(sum / (2 * h)) : Unknowns(sum / (6 * h * h));
}

/// By series where the closure takes them.
template <class M>
Unknowns coefficients_of(const M& m, const PoseSeries& X, const std::vector<Series>& q, const Parameters<M, Series>& p,
                         const Parameters<M, Dual>& p_dual, int order) {
  if constexpr (!kNeverOnSeries<M>) {
    if (on_series(m)) return coefficients_by_series(m, X, q, p, order);
  }
  return coefficients_by_differences(m, X, q, p_dual, order);
}

constexpr double kSingular = 1e-12;

void take_derivatives(const Eigen::Ref<const machine::JointVectorT<Series>>& q, JointSeries& out) {
  const Eigen::Index n = q.size();
  out.first = out.second = out.third = JointVector::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    out.first[i] = q[i].derivative(1);
    out.second[i] = q[i].derivative(2);
    out.third[i] = q[i].derivative(3);
  }
}

/// K y = r, by least squares or the shortest y where K is not square.
class Solver {
 public:
  explicit Solver(System K) : scale_(scale_rows(K)), is_square_(K.rows() == K.cols()) {
    if (is_square_) {
      square_.compute(K);
      const auto pivots = square_.matrixLU().diagonal().cwiseAbs();
      pivot_ = pivots.minCoeff() / pivots.maxCoeff();
    } else {
      any_.compute(K);
      const Eigen::Index full = std::min(K.rows(), K.cols());
      const auto pivots = any_.matrixT().diagonal().head(full).cwiseAbs();
      pivot_ = any_.rank() < full ? 0 : pivots.minCoeff() / pivots.maxCoeff();
    }
  }
  [[nodiscard]] Unknowns solve(const Unknowns& r) const {
    const Unknowns right = scale_.cwiseProduct(r);
    return is_square_ ? Unknowns(square_.solve(right)) : Unknowns(any_.solve(right));
  }
  /// The smallest against the largest.
  [[nodiscard]] double pivot() const { return pivot_; }

 private:
  Unknowns scale_;
  bool is_square_;
  Eigen::FullPivLU<System> square_;
  Eigen::CompleteOrthogonalDecomposition<System> any_;
  double pivot_ = 0;
};

/// K y = r of a chain, through its singular poses too. Along a left singular vector u whose singular value is below
/// kNearly of the largest, a path that asks for no more than rounding gets nothing: the shortest y, with which joints
/// that the pose leaves free stand still (a head that swings its tool through the axis of its other joint). A path that
/// asks for more has no y at the pose itself.
class ChainSolver {
 public:
  explicit ChainSolver(const System& K) : plain_(K) {
    constexpr double kNearly = 1e-6;
    if (!(plain_.pivot() < kNearly)) return;
    System scaled = K;
    scale_ = scale_rows(scaled);
    values_.emplace(scaled, Eigen::ComputeFullU | Eigen::ComputeFullV);
    nearly_ = (values_->singularValues().array() < kNearly * values_->singularValues()[0]).count();
  }
  /// `size`: what r is made of, so that its rounding is known.
  [[nodiscard]] std::optional<Unknowns> solve(const Unknowns& r, double size) {
    constexpr double kRounding = 1e-12, kRest = 1e-20;  // of a path that begins or ends at rest nothing is left
    if (nearly_ == 0) return plain_.pivot() > kSingular ? std::optional(plain_.solve(r)) : std::nullopt;
    const Unknowns right = values_->matrixU().transpose() * scale_.cwiseProduct(r);
    const auto& sigma = values_->singularValues();
    Unknowns along = Unknowns::Zero(values_->cols());
    for (Eigen::Index i = 0; i < sigma.size(); ++i) {
      if (i >= sigma.size() - nearly_) {
        if (std::abs(right[i]) <= kRounding * std::max({right.norm(), size, kRest})) continue;
        if (!(sigma[i] > kSingular * sigma[0])) return {};
        passes_ = false;
      }
      along[i] = right[i] / sigma[i];
    }
    return Unknowns(values_->matrixV() * along);
  }
  /// The smallest against the largest; of what it was solved with.
  [[nodiscard]] double pivot() const {
    if (nearly_ == 0 || !passes_) return plain_.pivot();
    const auto& sigma = values_->singularValues();
    return nearly_ < sigma.size() ? sigma[sigma.size() - 1 - nearly_] / sigma[0] : 0;
  }

 private:
  Solver plain_;
  Unknowns scale_;
  std::optional<Eigen::JacobiSVD<System>> values_;
  Eigen::Index nearly_ = 0;
  bool passes_ = true;
};

/// Of a chain, whose pose X(q) its joints say: T_X J y_k = -(coefficient k of T(X(q), target) by the lower orders).
template <class M>
JointSeries chain_series_of(const M& m, const PoseSeries& target, const Pose& at, const JointVector& q) {
  const Task what = task(m);
  const std::vector<double> p = kinematics::nominal_parameters(m);
  const machine::JacobianMatrix J = jacobian(m, at, q);
  const auto rates = task_equations(what, moved_from(0, at), value_of(target).cast<Dual>(), at, 0);
  System K(rates.size(), q.size());
  for (int i = 0; i < rates.size(); ++i) K.row(i) = rates[i].v.transpose() * J;
  ChainSolver solver(K);
  JointSeries out;
  out.q = q;
  out.X = at.cast<Series>();
  out.regular = true;
  double rate = 0, size = 0;  // of the joints, and to the power of the order
  machine::JointVectorT<Series> joints = q.cast<Series>();
  for (int order = 1; order <= Series::kOrder && out.regular; ++order) {
    if (order > 1) out.X = chain(m, std::span<const Series>(joints.data(), joints.size()), std::span(p));
    const auto T = task_equations(what, out.X, target, at, 0);
    Unknowns r(T.size());
    for (int i = 0; i < T.size(); ++i) r[i] = -T[i][order];
    const std::optional<Unknowns> solved = solver.solve(r, size);
    out.regular = solved && solved->allFinite();
    const Unknowns y = out.regular ? *solved : Unknowns(Unknowns::Zero(q.size()));
    if (order == 1) rate = size = y.norm();
    size *= rate;
    for (Eigen::Index i = 0; i < q.size(); ++i) joints[i][order] = y[i];
    const Vec6 twist = J * y;
    const Mat3 turn = skew(Vec3(twist.tail<3>())) * at.R;
    for (int i = 0; i < 3; ++i) {
      out.X.p[i][order] += twist[i];
      for (int j = 0; j < 3; ++j) out.X.R(i, j)[order] += turn(i, j);
    }
  }
  for (int k = 0; k < 3; ++k)
    if (what.holds(static_cast<Coordinate>(k))) out.X.p[k] = target.p[k];  // without the rounding of the system
  out.pivot = solver.pivot();
  take_derivatives(joints, out);
  return out;
}

/// By the family's closed form.
template <class M>
JointSeries quick_series_of(const M& m, const PoseSeries& target, const Pose& at, const JointVector& q) {
  machine::QuickSeries quick = quick_series(m, target, at, q);
  JointSeries out;
  out.q = q;
  out.X = quick.X;
  out.pivot = quick.pivot;
  out.regular = out.pivot > kSingular;
  if (!out.regular) quick.q.setConstant(Series(0.0));
  take_derivatives(quick.q, out);
  return out;
}

template <class M>
JointSeries series_of(const M& m, const PoseSeries& target, const Pose& at, const JointVector& q, bool differences) {
  if constexpr (requires { quick_series(m, target, at, q); }) {
    if (!differences) return quick_series_of(m, target, at, q);
  } else if constexpr (requires { closure_is_pose_error(m); }) {
    if (!differences) return chain_series_of(m, target, at, q);
  }
  const Task what = task(m);
  const std::vector<double> p = kinematics::nominal_parameters(m);
  const Parameters<M, Dual> p_dual(p.begin(), p.end());
  const Parameters<M, Series> p_series(p.begin(), p.end());
  const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
  const auto n = static_cast<int>(q.size());
  const int first = first_unknown(what), twist = 6 - first;
  const System K = unknowns_matrix(m, what, first, value_of(target), at, q, p_dual);
  const int seen = what.size() - first, equations = static_cast<int>(K.rows()) - seen;
  const Solver solver(K);
  JointSeries out;
  out.q = q;
  out.pivot = solver.pivot();
  out.regular = out.pivot > kSingular;
  Vector3<Series> v = Vector3<Series>::Zero(), w = v;
  std::vector<Series> q_series(joints.begin(), joints.end());
  // The pose to the order that is known; what is prescribed alone to every order.
  const auto pose = [&] {
    if (first == 6) return target;
    PoseSeries X = moved(at, v, w);
    if (first == 3) X.p = target.p;
    return X;
  };
  for (int order = 1; order <= Series::kOrder && out.regular; ++order) {
    const PoseSeries X = pose();
    Unknowns r(K.rows());
    r.head(equations) = differences ? coefficients_by_differences(m, X, q_series, p_dual, order)
                                    : coefficients_of(m, X, q_series, p_series, p_dual, order);
    const auto T = task_equations(what, X, target, at, first);
    for (int i = 0; i < seen; ++i) r[equations + i] = T[i][order];
    const Unknowns y = solver.solve(-r);
    out.regular = y.allFinite();
    for (int k = first; k < 6; ++k) (k < 3 ? v[k] : w[k - 3])[order] = y[k - first];
    for (int i = 0; i < n; ++i) q_series[static_cast<std::size_t>(i)][order] = y[twist + i];
  }
  out.X = pose();
  for (int k = 0; k < 3; ++k)
    if (what.holds(static_cast<Coordinate>(k))) out.X.p[k] = target.p[k];  // without the rounding of the system
  take_derivatives(Eigen::Map<const machine::JointVectorT<Series>>(q_series.data(), n), out);
  return out;
}

template <class M>
JointSeries driven_series_of(const M& m, const Pose& at, const JointVector& q, const JointVector& speed,
                             const JointVector& acceleration) {
  const std::vector<double> p = kinematics::nominal_parameters(m);
  const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
  ClosureMatrix A = kinematics::closure_by_pose(m, at, joints, p);
  const Unknowns scale = scale_rows(A);
  JointSeries out;
  out.q = q;
  out.first = speed;
  out.second = acceleration;
  out.third = JointVector::Zero(q.size());
  const Eigen::ColPivHouseholderQR<System> solver{System(A)};
  const auto pivots = solver.matrixR().diagonal().cwiseAbs();
  out.pivot = pivots.minCoeff() / pivots.maxCoeff();
  out.regular = A.rows() >= 6 && out.pivot > kSingular;
  Vector3<Series> v = Vector3<Series>::Zero(), w = v;
  std::vector<Series> q_series;
  for (int i = 0; i < q.size(); ++i) q_series.emplace_back(q[i], speed[i], acceleration[i], 0);
  const Parameters<M, Series> p_series(p.begin(), p.end());
  const Parameters<M, Dual> p_dual(p.begin(), p.end());
  for (int order = 1; order <= Series::kOrder && out.regular; ++order) {
    const PoseSeries X = moved(at, v, w);
    const Unknowns r = coefficients_of(m, X, q_series, p_series, p_dual, order);
    const Vec6 y = solver.solve(-scale.cwiseProduct(r));
    out.regular = y.allFinite();
    for (int k = 0; k < 3; ++k) {
      v[k][order] = y[k];
      w[k][order] = y[3 + k];
    }
  }
  out.X = moved(at, v, w);
  return out;
}

/// Next to a singular pose rounding moves the joints themselves by its size over a pivot, and their derivative of order
/// k by that over the pivot to the power of k: what is not above that is 0. Drives that stand still while the path
/// leads through the pose would move by rounding alone.
void clear_rounding(const PoseSeries& target, JointSeries& out) {
  constexpr double kFar = 1e-2, kRounding = 1e-13;
  if (!out.regular || out.pivot > kFar) return;
  double rate = 0;  // of the target, by its own parameter
  for (int order = 1; order <= Series::kOrder; ++order) {
    double largest = 0;
    for (int i = 0; i < 3; ++i) {
      largest = std::max(largest, std::abs(target.p[i].derivative(order)));
      for (int j = 0; j < 3; ++j) largest = std::max(largest, std::abs(target.R(i, j).derivative(order)));
    }
    rate = std::max(rate, std::pow(largest, 1.0 / order));
  }
  double least = kRounding * std::max(1.0, out.q.cwiseAbs().maxCoeff()) / out.pivot;
  for (JointVector* derivative : {&out.first, &out.second, &out.third}) {
    least *= rate / out.pivot;
    for (double& x : *derivative)
      if (std::abs(x) < least) x = 0;
  }
}

}  // namespace

Pose value_of(const PoseSeries& X) {
  Pose out;
  for (int i = 0; i < 3; ++i) {
    out.p[i] = X.p[i].value();
    for (int j = 0; j < 3; ++j) out.R(i, j) = X.R(i, j).value();
  }
  return out;
}

JointSeries driven_series(const AnyMachine& machine, const Pose& at, const JointVector& q, const JointVector& v,
                          const JointVector& a) {
  return std::visit([&](const auto& m) { return driven_series_of(m, at, q, v, a); }, machine);
}

Matrix3<Series> rotation_series(const Vector3<Series>& w) {
  return series_from(turn_coefficients(w));
}

JointSeries joint_series(const AnyMachine& machine, const PoseSeries& target, const Pose& settled,
                         const JointVector& q) {
  JointSeries out = std::visit([&](const auto& m) { return series_of(m, target, settled, q, false); }, machine);
  clear_rounding(target, out);
  return out;
}

JointSeries joint_series_by_differences(const AnyMachine& machine, const PoseSeries& target, const Pose& settled,
                                        const JointVector& q) {
  return std::visit([&](const auto& m) { return series_of(m, target, settled, q, true); }, machine);
}

Pose pose_near(const AnyMachine& machine, const JointVector& q, const Pose& near) {
  return std::visit(
      [&]<class M>(const M& m) -> Pose {
        if constexpr (requires {
                        { forward(m, q) } -> std::same_as<Pose>;
                      }) {
          return forward(m, q);
        } else {
          const kinematics::NewtonResult r = kinematics::forward_by_closure(
              m, std::span<const double>(q.data(), static_cast<std::size_t>(q.size())), near);
          // Of a machine with more equations than unknowns the joints need not fit together: least squares then.
          return r.X_MT.p.allFinite() && r.X_MT.R.allFinite() ? r.X_MT : near;
        }
      },
      machine);
}

}  // namespace polypod::motion
