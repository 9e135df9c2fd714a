// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/joint_series.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

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

/// Equations have units of their own (m, m^2, rad): each row is scaled to the largest entry 1, so that pivots compare.
/// Returns the factors.
template <class Rows>
Unknowns scale_rows(Rows& rows) {
  Unknowns scale(rows.rows());
  for (int i = 0; i < rows.rows(); ++i) {
    const double largest = rows.row(i).cwiseAbs().maxCoeff();
    scale[i] = largest > 0 ? 1 / largest : 1;
    rows.row(i) *= scale[i];
  }
  return scale;
}
using TaskSeries = Eigen::Matrix<Series, Eigen::Dynamic, 1, 0, 6, 1>;

/// The coefficients of one order.
Mat3 coefficient(const Matrix3<Series>& a, int order) {
  return Mat3::NullaryExpr([&](Eigen::Index i, Eigen::Index j) { return a(i, j)[order]; });
}

/// What the task prescribes of X against the target, 0 where it is kept, and its derivatives by X's twist.
TaskSeries task_equations(Task task, const PoseSeries& X, const PoseSeries& target, const Pose& at) {
  TaskSeries out(task.size());
  int row = 0;
  for (int k = 0; k < 3; ++k)
    if (task.holds(static_cast<Coordinate>(k))) out[row++] = X.p[k] - target.p[k];
  if (row == task.size()) return out;
  if (task.names_axis()) {
    for (int side = 0; side < 2; ++side) {
      Series e;
      for (int i = 0; i < 3; ++i) e += Series(at.R(i, side)) * (X.R(i, 2) - target.R(i, 2));
      out[row++] = e;
    }
    return out;
  }
  if (task.size() - row == 3) {
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;  // of E = R R_target^T, half of E(j, i) - E(i, j)
      Series e;
      for (int c = 0; c < 3; ++c) e += X.R(j, c) * target.R(i, c) - X.R(i, c) * target.R(j, c);
      out[row++] = Series(0.5) * e;
    }
    return out;
  }
  const Matrix3<Series>&R = X.R, &T = target.R;
  if (task.holds(Coordinate::a)) out[row++] = R(2, 1) * T(2, 2) - R(2, 2) * T(2, 1);
  if (task.holds(Coordinate::b)) out[row++] = T(2, 0) - R(2, 0);
  if (task.holds(Coordinate::c)) out[row++] = R(1, 0) * T(0, 0) - R(0, 0) * T(1, 0);
  return out;
}

/// The pose moved by series of its twist, which begin with 0.
PoseSeries moved(const Pose& at, const Vector3<Series>& v, const Vector3<Series>& w) {
  PoseSeries out;
  const Matrix3<Series> turn = rotation_series(w);
  for (int order = 0; order <= Series::kOrder; ++order) {
    const Mat3 R = coefficient(turn, order) * at.R;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) out.R(i, j)[order] = R(i, j);
  }
  for (int k = 0; k < 3; ++k) out.p[k] = Series(at.p[k]) + v[k];
  return out;
}

/// Rows by the twist, from the equations themselves: the first coefficient for a unit of each part of the twist.
System task_matrix(Task task, const PoseSeries& target, const Pose& at) {
  System out(task.size(), 6);
  PoseSeries still = target;  // alone at s = 0
  for (int i = 0; i < 3; ++i) {
    still.p[i] = Series(target.p[i].value());
    for (int j = 0; j < 3; ++j) still.R(i, j) = Series(target.R(i, j).value());
  }
  for (int k = 0; k < 6; ++k) {
    PoseSeries X = at.cast<Series>();
    if (k < 3) {
      X.p[k][1] = 1;
    } else {
      const Mat3 rate = skew(Vec3(Vec3::Unit(k - 3))) * at.R;
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) X.R(i, j)[1] = rate(i, j);
    }
    const TaskSeries T = task_equations(task, X, still, at);
    for (int i = 0; i < T.size(); ++i) out(i, k) = T[i][1];
  }
  return out;
}

template <class M>
constexpr bool kOnSeries = !requires(const M& m) {
  closure_takes_no_series(m);
};

/// The coefficient of this order of the closure along a curve.
template <class M>
Unknowns coefficients_by_series(const M& m, const PoseSeries& X, const std::vector<Series>& q,
                                const std::vector<Series>& p, int order) {
  const machine::ClosureVectorT<Series> F = closure(m, X, std::span<const Series>(q), std::span<const Series>(p));
  Unknowns out(F.size());
  for (int i = 0; i < F.size(); ++i) out[i] = F[i][order];
  return out;
}

/// The derivative of the closure along a curve at s = h.
template <class M>
Unknowns rate_at(const M& m, const PoseSeries& X, const std::vector<Series>& q, const std::vector<Dual>& p, double h) {
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
  const machine::ClosureVectorT<Dual> F = closure(m, pose, std::span<const Dual>(joints), std::span<const Dual>(p));
  Unknowns out(F.size());
  for (int i = 0; i < F.size(); ++i) out[i] = F[i].v[0];
  return out;
}

/// Central differences of eighth order: of the first derivative's own first and second derivative.
template <class M>
Unknowns coefficients_by_differences(const M& m, const PoseSeries& X, const std::vector<Series>& q,
                                     const std::vector<Dual>& p, int order) {
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

template <class M>
JointSeries series_of(const M& m, const PoseSeries& target, const Pose& at, const JointVector& q, bool differences) {
  const Task what = task(m);
  const std::vector<double> p = kinematics::nominal_parameters(m);
  const std::span<const double> joints(q.data(), static_cast<std::size_t>(q.size()));
  const auto n = static_cast<int>(q.size());
  const ClosureMatrix A = kinematics::closure_by_pose(m, at, joints, p),
                      B = kinematics::closure_by_joints(m, at, joints, p);
  const auto equations = static_cast<int>(A.rows()), seen = what.size();
  System K = System::Zero(equations + seen, 6 + n);
  K.topLeftCorner(equations, 6) = A;
  K.topRightCorner(equations, n) = B;
  K.bottomLeftCorner(seen, 6) = task_matrix(what, target, at);
  const Unknowns scale = scale_rows(K);
  JointSeries out;
  out.q = q;
  Eigen::FullPivLU<System> square;
  Eigen::CompleteOrthogonalDecomposition<System> any;
  const bool is_square = K.rows() == K.cols();
  if (is_square) {
    square.compute(K);
    const auto pivots = square.matrixLU().diagonal().cwiseAbs();
    out.pivot = pivots.minCoeff() / pivots.maxCoeff();
  } else {
    any.compute(K);
    const auto pivots = any.matrixT().diagonal().head(std::min(K.rows(), K.cols())).cwiseAbs();
    out.pivot = any.rank() < std::min(K.rows(), K.cols()) ? 0 : pivots.minCoeff() / pivots.maxCoeff();
  }
  constexpr double kSingular = 1e-12;
  out.regular = out.pivot > kSingular;
  Vector3<Series> v = Vector3<Series>::Zero(), w = v;
  std::vector<Series> q_series(joints.begin(), joints.end());
  const std::vector<Series> p_series(p.begin(), p.end());
  const std::vector<Dual> p_dual(p.begin(), p.end());
  for (int order = 1; order <= Series::kOrder && out.regular; ++order) {
    const PoseSeries X = moved(at, v, w);
    Unknowns r(K.rows());
    if constexpr (kOnSeries<M>) {
      r.head(equations) = differences ? coefficients_by_differences(m, X, q_series, p_dual, order)
                                      : coefficients_by_series(m, X, q_series, p_series, order);
    } else {
      r.head(equations) = coefficients_by_differences(m, X, q_series, p_dual, order);
    }
    const TaskSeries T = task_equations(what, X, target, at);
    for (int i = 0; i < seen; ++i) r[equations + i] = T[i][order];
    const Unknowns right = -scale.cwiseProduct(r);
    const Unknowns y = is_square ? Unknowns(square.solve(right)) : Unknowns(any.solve(right));
    out.regular = y.allFinite();
    for (int k = 0; k < 3; ++k) {
      v[k][order] = y[k];
      w[k][order] = y[3 + k];
    }
    for (int i = 0; i < n; ++i) q_series[static_cast<std::size_t>(i)][order] = y[6 + i];
  }
  out.X = moved(at, v, w);
  for (int k = 0; k < 3; ++k)
    if (what.holds(static_cast<Coordinate>(k))) out.X.p[k] = target.p[k];  // without the rounding of the system
  out.first = out.second = out.third = JointVector::Zero(n);
  for (int i = 0; i < n; ++i) {
    const Series& s = q_series[static_cast<std::size_t>(i)];
    out.first[i] = s.derivative(1);
    out.second[i] = s.derivative(2);
    out.third[i] = s.derivative(3);
  }
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
  constexpr double kSingular = 1e-12;
  out.regular = A.rows() >= 6 && out.pivot > kSingular;
  Vector3<Series> v = Vector3<Series>::Zero(), w = v;
  std::vector<Series> q_series;
  for (int i = 0; i < q.size(); ++i) q_series.emplace_back(q[i], speed[i], acceleration[i], 0);
  const std::vector<Series> p_series(p.begin(), p.end());
  const std::vector<Dual> p_dual(p.begin(), p.end());
  for (int order = 1; order <= Series::kOrder && out.regular; ++order) {
    const PoseSeries X = moved(at, v, w);
    Unknowns r;
    if constexpr (kOnSeries<M>) {
      r = coefficients_by_series(m, X, q_series, p_series, order);
    } else {
      r = coefficients_by_differences(m, X, q_series, p_dual, order);
    }
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

}  // namespace

JointSeries driven_series(const AnyMachine& machine, const Pose& at, const JointVector& q, const JointVector& v,
                          const JointVector& a) {
  return std::visit([&](const auto& m) { return driven_series_of(m, at, q, v, a); }, machine);
}

Matrix3<Series> rotation_series(const Vector3<Series>& w) {
  // W = A s + B s^2 + C s^3: 1 + W + W^2 / 2 + W^3 / 6 to the third order.
  const auto part = [&](int order) { return skew(Vec3(w[0][order], w[1][order], w[2][order])); };
  const Mat3 A = part(1), B = part(2), C = part(3), A2 = A * A;
  const Mat3 second = B + 0.5 * A2, third = C + 0.5 * (A * B + B * A) + A2 * A / 6;
  Matrix3<Series> out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      out(i, j)[0] = i == j ? 1 : 0;
      out(i, j)[1] = A(i, j);
      out(i, j)[2] = second(i, j);
      out(i, j)[3] = third(i, j);
    }
  return out;
}

JointSeries joint_series(const AnyMachine& machine, const PoseSeries& target, const Pose& settled,
                         const JointVector& q) {
  return std::visit([&](const auto& m) { return series_of(m, target, settled, q, false); }, machine);
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
