// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/motion/pose_path.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/LU>
#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
#include <span>

#include "polypod/core/config.hpp"
#include "polypod/core/csv.hpp"
#include "polypod/core/units.hpp"
#include "polypod/motion/tables.hpp"

namespace polypod::motion {
namespace {

/// Points nearer than this are one, m; turns below it are none, rad.
constexpr double kSame = 1e-9;
/// Directions that differ by less go on, rad; curvatures, of the larger one.
constexpr double kTangent = 1e-3, kSameCurvature = 1e-3;

Vec3 values(const Vector3<Series>& v, int order) {
  return {v[0].derivative(order), v[1].derivative(order), v[2].derivative(order)};
}
Series power_sum(const Eigen::Matrix<double, 1, 6>& c, const Series& u) {
  Series out(c[5]);
  for (int k = 4; k >= 0; --k) out = out * u + Series(c[k]);
  return out;
}
Matrix3<Series> left_times(const Mat3& a, const Matrix3<Series>& b) {
  Matrix3<Series> out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      out(i, j) = Series(a(i, 0)) * b(0, j) + Series(a(i, 1)) * b(1, j) + Series(a(i, 2)) * b(2, j);
  return out;
}
/// Derivatives of the pose against its parameter: the tip's, and the rows of R's.
struct Rates {
  Vec3 p1, p2;
  Mat3 R, R1, R2;
};
Rates rates_of(const Stretch& s, double at) {
  const PoseSeries X = s.at(Series(at, 1, 0, 0));
  Rates out;
  out.p1 = values(X.p, 1);
  out.p2 = values(X.p, 2);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      out.R(i, j) = X.R(i, j).value();
      out.R1(i, j) = X.R(i, j).derivative(1);
      out.R2(i, j) = X.R(i, j).derivative(2);
    }
  }
  return out;
}
/// The angles A, B, C on the way and their two derivatives against the parameter (Turning::angles).
struct Angles {
  Vec3 at, first, second;
};
Angles angles_on(const Stretch& s, double at) {
  Angles out{s.angles_from, Vec3::Zero(), Vec3::Zero()};
  if (s.curve == Stretch::Curve::blend) {
    for (int k = 0; k < 3; ++k) {
      const Series a = power_sum(s.polynomial.row(3 + k), Series(at, 1, 0, 0));
      out.at[k] = a.value();
      out.first[k] = a.derivative(1);
      out.second[k] = a.derivative(2);
    }
    return out;
  }
  out.first = (s.angles_to - s.angles_from) / s.size;
  out.at += at * out.first;
  return out;
}

/// R R_z(spin).
void spin(const Stretch& s, const Series& share, Matrix3<Series>& R) {
  if (s.spin_from == 0 && s.spin_to == 0) return;
  const Series angle = Series(s.spin_from) + share * Series(s.spin_to - s.spin_from), c = cos(angle), n = sin(angle);
  for (int i = 0; i < 3; ++i) {
    const Series x = R(i, 0), y = R(i, 1);
    R(i, 0) = c * x + n * y;
    R(i, 1) = c * y - n * x;
  }
}

}  // namespace

PoseSeries Stretch::at(const Series& parameter) const {
  const Series share = parameter / Series(size);
  PoseSeries X;
  if (curve == Curve::line) {
    for (int k = 0; k < 3; ++k) X.p[k] = Series(from[k]) + share * Series(to[k] - from[k]);
  } else if (curve == Curve::arc) {
    const Series a = share * Series(sweep), r = Series(radius) + share * Series(radius_end - radius);
    const Series c = r * cos(a), s = r * sin(a);
    for (int k = 0; k < 3; ++k)
      X.p[k] = Series(center[k]) + c * Series(u[k]) + s * Series(v[k]) + share * Series(rise[k]);
  } else {
    for (int k = 0; k < 3; ++k) X.p[k] = power_sum(polynomial.row(k), parameter);
  }
  if (turning == Turning::turn && curve != Curve::blend) {
    // R = exp(share axis) R_from: what is turned at s = 0 as a number, the rest as a series.
    const Mat3 now =
        rotation_of(share.value() * axis) * before * rotation_abc(angles_from.x(), angles_from.y(), angles_from.z());
    const Series rest = share - Series(share.value());
    Vector3<Series> w;
    for (int k = 0; k < 3; ++k) w[k] = rest * Series(axis[k]);
    const Matrix3<Series> T = rotation_series(w);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        X.R(i, j) = T(i, 0) * Series(now(0, j)) + T(i, 1) * Series(now(1, j)) + T(i, 2) * Series(now(2, j));
    spin(*this, share, X.R);
    return X;
  }
  Vector3<Series> angle;
  for (int k = 0; k < 3; ++k) {
    angle[k] = curve == Curve::blend ? power_sum(polynomial.row(3 + k), parameter)
                                     : Series(angles_from[k]) + share * Series(angles_to[k] - angles_from[k]);
  }
  X.R = left_times(before, rotation_by_angles(angle[0], angle[1], angle[2]));
  spin(*this, share, X.R);
  return X;
}

Pose Stretch::pose(double parameter) const {
  const PoseSeries X = at(Series(parameter));
  Pose out;
  for (int i = 0; i < 3; ++i) {
    out.p[i] = X.p[i].value();
    for (int j = 0; j < 3; ++j) out.R(i, j) = X.R(i, j).value();
  }
  return out;
}

bool Stretch::turns() const {
  if (curve == Curve::blend) return polynomial.bottomRightCorner<3, 5>().cwiseAbs().maxCoeff() > 0;
  if (std::abs(spin_to - spin_from) > kSame) return true;
  return turning == Turning::turn ? axis.norm() > kSame : (angles_to - angles_from).norm() > kSame;
}

Junction PosePath::junction(std::size_t before) const {
  const Stretch &a = stretches[before], &b = stretches[before + 1];
  const Rates in = rates_of(a, a.size), onward = rates_of(b, 0);
  Junction out;
  if (!(a.length > 0) || !(b.length > 0)) {  // a turn on the spot begins or ends here
    out.corner = a.length > 0 || b.length > 0 ? 0 : angle_between(Vec3(1, 0, 0), Vec3(1, 0, 0));
    const bool both = !(a.length > 0) && !(b.length > 0);
    out.tangent = both && (in.R1 - onward.R1).norm() < kTangent;
    out.smooth = out.tangent && (in.R2 - onward.R2).norm() < kSameCurvature;
    return out;
  }
  out.corner = angle_between(in.p1, onward.p1);
  // Rates of turning are compared over the length of the shorter stretch.
  const double over = std::min(a.length, b.length);
  out.tangent = out.corner <= kTangent && over * (in.R1 - onward.R1).norm() <= kTangent;
  const double bent = std::max(in.p2.norm(), onward.p2.norm());
  out.smooth = out.tangent && (in.p2 - onward.p2).norm() <= kSameCurvature * std::max(bent, 1e-3 / over) &&
               over * over * (in.R2 - onward.R2).norm() <= kSameCurvature;
  return out;
}

Result<Stretch> straight(const TargetPose& from, const TargetPose& to, Turning turning) {
  Stretch out;
  out.from = from.p;
  out.to = to.p;
  out.turning = turning;
  out.angles_from = from.angles;
  out.angles_to = to.angles;
  const Mat3 first = rotation_abc(from.angles.x(), from.angles.y(), from.angles.z());
  out.axis = rotation_vector(rotation_abc(to.angles.x(), to.angles.y(), to.angles.z()) * first.transpose());
  out.length = (to.p - from.p).norm();
  if (!std::isfinite(out.length) || !out.axis.allFinite()) return fail("MO100", "a point of the path is not finite");
  if (!(out.length > kSame)) out.length = 0;
  const double turned = turning == Turning::turn ? out.axis.norm() : (to.angles - from.angles).norm();
  out.size = out.length > 0 ? out.length : turned;
  if (!(out.size > kSame)) {
    return fail("MO100",
                fmt::format("from {:g}, {:g}, {:g} mm by less than 1e-6 mm is neither a way nor a turn",
                            units::to_mm(from.p.x()), units::to_mm(from.p.y()), units::to_mm(from.p.z())),
                {}, "leave out points that are the same as the one before");
  }
  return out;
}

Result<Stretch> curved(const TargetPose& from, const Vec3& via, const TargetPose& to, Turning turning) {
  POLYPOD_ASSIGN(bow, arc(from.p, via, to.p));
  Stretch out;
  out.curve = Stretch::Curve::arc;
  out.from = from.p;
  out.to = to.p;
  out.center = bow.center;
  out.u = bow.u;
  out.v = bow.v;
  out.radius = out.radius_end = bow.radius;
  out.sweep = bow.length / bow.radius;
  out.length = out.size = bow.length;
  out.turning = turning;
  out.angles_from = from.angles;
  out.angles_to = to.angles;
  out.axis = rotation_vector(rotation_abc(to.angles.x(), to.angles.y(), to.angles.z()) *
                             rotation_abc(from.angles.x(), from.angles.y(), from.angles.z()).transpose());
  return out;
}

namespace {

/// m, along a polynomial.
double length_of(const Stretch& s) {
  constexpr int kPieces = 32;
  double out = 0;
  Vec3 last = s.pose(0).p;
  for (int k = 1; k <= kPieces; ++k) {
    const Vec3 next = s.pose(s.size * k / kPieces).p;
    out += (next - last).norm();
    last = next;
  }
  return out;
}

/// Lines with durations as one spline from rest to rest. Unknown are the rates v and the second derivatives a at the
/// inner points; third and fourth derivatives go on there. Of a stretch of duration h from p_0 to p_1 with d = p_1 -
/// p_0
///   x'''(0)  =   60 d / h^3 - (36 v_0 + 24 v_1) / h^2 + (3 a_1 - 9 a_0) / h,
///   x''''(0) = -360 d / h^4 + (192 v_0 + 168 v_1) / h^3 + (36 a_0 - 24 a_1) / h^2,
/// and at its end the same backwards in time. False where the durations differ so much that rounding leaves no spline.
bool spline_through(std::span<const Stretch> lines, std::span<Stretch> out) {
  using Value = Eigen::Matrix<double, 1, 6>;
  using Values = Eigen::Matrix<double, Eigen::Dynamic, 6>;
  const auto n = static_cast<Eigen::Index>(lines.size());
  double length = 0, time = 0;
  for (const Stretch& s : lines) {
    length += s.size;
    time += s.duration;
  }
  const double unit = time / static_cast<double>(n);  // of time
  const auto line = [&](Eigen::Index k) -> const Stretch& { return lines[static_cast<std::size_t>(k)]; };
  const auto way = [&](Eigen::Index k) {
    Value d;
    d << (line(k).to - line(k).from).transpose(), (line(k).angles_to - line(k).angles_from).transpose();
    return d;
  };
  // Unknowns 2 (k - 1) and 2 (k - 1) + 1: v and a of point k; the equations of that point stand in the same rows.
  Values known = Values::Zero(2 * (n - 1), 6);
  std::vector<Eigen::Triplet<double>> entries;
  for (Eigen::Index k = 1; k < n; ++k) {
    const auto row = 2 * (k - 1);
    const auto put = [&](Eigen::Index down, Eigen::Index point, double v, double a) {
      if (point == 0 || point == n) return;  // at rest
      entries.emplace_back(row + down, 2 * (point - 1), v);
      entries.emplace_back(row + down, 2 * (point - 1) + 1, a);
    };
    const double h = line(k - 1).duration / unit, g = line(k).duration / unit;
    const Value before = way(k - 1), behind = way(k);
    put(0, k - 1, -24 / (h * h), -3 / h);
    put(0, k, 36 / (g * g) - 36 / (h * h), 9 / h + 9 / g);
    put(0, k + 1, 24 / (g * g), -3 / g);
    known.row(row) = 60 * behind / (g * g * g) - 60 * before / (h * h * h);
    put(1, k - 1, 168 / (h * h * h), 24 / (h * h));
    put(1, k, 192 / (h * h * h) + 192 / (g * g * g), 36 / (g * g) - 36 / (h * h));
    put(1, k + 1, 168 / (g * g * g), -24 / (g * g));
    known.row(row + 1) = 360 * before / (h * h * h * h) + 360 * behind / (g * g * g * g);
  }
  Values rates = Values::Zero(2 * (n + 1), 6);  // v and a of every point
  if (n > 1) {
    Eigen::SparseMatrix<double> A(2 * (n - 1), 2 * (n - 1));
    A.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SparseLU<Eigen::SparseMatrix<double>> solver(A);
    if (solver.info() != Eigen::Success) return false;
    const Values inner = solver.solve(known);  // no block: it must be a whole
    rates.middleRows(2, 2 * (n - 1)) = inner;
  }
  if (!rates.allFinite()) return false;
  // One rate of the parameter for all, so that it goes on from stretch to stretch.
  const double scale = length / static_cast<double>(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    Stretch& s = out[static_cast<std::size_t>(k)];
    const double h = s.duration / unit;
    const Value d = way(k), v0 = rates.row(2 * k), a0 = rates.row(2 * k + 1), v1 = rates.row(2 * k + 2),
                a1 = rates.row(2 * k + 3);
    s.curve = Stretch::Curve::blend;
    s.size = h * scale;
    s.polynomial.col(0) << s.from, s.angles_from;
    s.polynomial.col(1) = v0.transpose();
    s.polynomial.col(2) = 0.5 * a0.transpose();
    s.polynomial.col(3) = ((10 * d / h - 6 * v0 - 4 * v1) / (h * h) - (1.5 * a0 - 0.5 * a1) / h).transpose();
    s.polynomial.col(4) = ((-15 * d / h + 8 * v0 + 7 * v1) / (h * h * h) + (1.5 * a0 - a1) / (h * h)).transpose();
    s.polynomial.col(5) = ((6 * d / h - 3 * v0 - 3 * v1) / (h * h * h * h) - 0.5 * (a0 - a1) / (h * h * h)).transpose();
    double power = 1;  // from time to the parameter
    for (Eigen::Index i = 0; i < 6; ++i, power *= scale) s.polynomial.col(i) /= power;
    s.length = s.length > 0 ? length_of(s) : 0;
  }
  return true;
}

}  // namespace

namespace {
/// The largest of a function of 0 .. 1: of 16 places, and between the neighbours of the best.
template <class F>
double largest_of(const F& f) {
  constexpr int kPlaces = 16, kThirds = 40;
  int best = 0;
  double most = f(0.0);
  for (int k = 1; k <= kPlaces; ++k) {
    if (const double value = f(static_cast<double>(k) / kPlaces); value > most) {
      most = value;
      best = k;
    }
  }
  double low = std::max(0.0, (best - 1.0) / kPlaces), high = std::min(1.0, (best + 1.0) / kPlaces);
  for (int k = 0; k < kThirds; ++k) {
    const double a = low + (high - low) / 3, b = high - (high - low) / 3;
    (f(a) < f(b) ? low : high) = f(a) < f(b) ? a : b;
  }
  return std::max(most, f(0.5 * (low + high)));
}
}  // namespace

ChordError farthest_from_chords(const PosePath& path) {
  ChordError out;
  for (const Stretch& s : path.stretches) {
    const Vec3 way = s.to - s.from;
    out.length = std::max(out.length, largest_of([&](double share) {
                            const Vec3 p = s.pose(s.size * share).p - s.from;
                            const double along =
                                way.squaredNorm() > 0 ? std::clamp(p.dot(way) / way.squaredNorm(), 0.0, 1.0) : 0;
                            return (p - along * way).norm();
                          }));
    out.angle = std::max(out.angle, largest_of([&](double share) {
                           const Vec3 straight = s.angles_from + share * (s.angles_to - s.angles_from);
                           return (angles_on(s, s.size * share).at - straight).cwiseAbs().maxCoeff();
                         }));
  }
  return out;
}

Result<PosePath> pose_path_of(std::vector<Stretch> stretches) {
  if (stretches.empty()) {
    return fail("MO100", "a path needs at least two different points; waits alone are none", {},
                "give where it starts and where it ends");
  }
  PosePath out;
  out.stretches = std::move(stretches);
  for (const Stretch& s : out.stretches) {
    out.length += s.length;
    out.size += s.size;
  }
  return out;
}

Stretch part_of(const Stretch& s, double a, double b) {
  Stretch out = s;
  const double from = a / s.size, to = b / s.size;
  out.size = b - a;
  out.length = s.length * (to - from);
  out.from = s.pose(a).p;
  out.to = s.pose(b).p;
  out.angles_from = s.angles_from + from * (s.angles_to - s.angles_from);
  out.angles_to = s.angles_from + to * (s.angles_to - s.angles_from);
  out.spin_from = s.spin_from + from * (s.spin_to - s.spin_from);
  out.spin_to = s.spin_from + to * (s.spin_to - s.spin_from);
  if (s.turning == Turning::turn) {
    // One axis turns the rest of the way: its start is the orientation there, as angles.
    out.angles_from = angles_abc(s.before.transpose() * rotation_of(from * s.axis) * s.before *
                                 rotation_abc(s.angles_from.x(), s.angles_from.y(), s.angles_from.z()));
    out.angles_to = angles_abc(s.before.transpose() * rotation_of(to * s.axis) * s.before *
                               rotation_abc(s.angles_from.x(), s.angles_from.y(), s.angles_from.z()));
    out.axis = (to - from) * s.axis;
  }
  if (s.curve == Stretch::Curve::arc) {
    const double begin = from * s.sweep, c = std::cos(begin), n = std::sin(begin);
    out.u = c * s.u + n * s.v;
    out.v = c * s.v - n * s.u;
    out.radius = s.radius + from * (s.radius_end - s.radius);
    out.radius_end = s.radius + to * (s.radius_end - s.radius);
    out.sweep = s.sweep * (to - from);
    out.center = s.center + from * s.rise;
    out.rise = (to - from) * s.rise;
  }
  if (s.duration > 0) out.duration = s.duration * (to - from);
  if (a > 0) out.wait_before = 0;
  if (b < s.size) out.wait = 0;
  return out;
}

Result<PosePath> splined(const PosePath& path) {
  for (const Stretch& s : path.stretches) {
    if (s.curve == Stretch::Curve::line && s.turning == Turning::angles && s.spin_from == 0 && s.spin_to == 0) continue;
    return fail("MO112", "a spline goes through points, with angles A, B and C: no arcs, no turns about one axis",
                {{}, s.line}, "leave out via_mm and turning, or take another profile");
  }
  PosePath out = path;
  const auto& all = path.stretches;
  for (std::size_t first = 0, last = 0; first < all.size(); first = last) {
    while (last < all.size() && (last == first || !(all[last - 1].wait > 0))) ++last;
    if (!spline_through({all.data() + first, last - first}, {out.stretches.data() + first, last - first})) {
      return fail("MO112", "a spline in these times is lost in rounding: their sizes differ too much",
                  {{}, all[first].line}, "give times that are nearer to each other, or take another profile");
    }
  }
  out.length = out.size = 0;
  for (const Stretch& s : out.stretches) {
    out.length += s.length;
    out.size += s.size;
  }
  constexpr double kDetour = 1e4;  // of the straight ways
  if (!(out.length <= kDetour * std::max(path.length, kSame))) {
    return fail("MO112", "a spline in these times is no way through the points: it is more than 1e4 times as long", {},
                "give times that are nearer to each other, or take another profile");
  }
  return out;
}

namespace {

/// From `cut` before the end of a to `cut` behind the start of b, with value, first and second derivative of both.
Stretch blend_of(const Stretch& a, const Stretch& b, double cut) {
  Stretch out;
  out.curve = Stretch::Curve::blend;
  out.before = a.before;
  out.line = b.line;
  out.rapid = a.rapid && b.rapid;
  out.speed = a.speed > 0 && b.speed > 0 ? std::min(a.speed, b.speed) : std::max(a.speed, b.speed);
  out.size = 2 * cut;
  Eigen::Matrix<double, 6, 6> left, right;  // rows: conditions, columns: coefficients
  Eigen::Matrix<double, 6, 6> conditions, wanted;
  const double T = out.size;
  conditions << 1, 0, 0, 0, 0, 0,                                //
      0, 1, 0, 0, 0, 0,                                          //
      0, 0, 2, 0, 0, 0,                                          //
      1, T, T * T, T * T * T, T * T * T * T, T * T * T * T * T,  //
      0, 1, 2 * T, 3 * T * T, 4 * T * T * T, 5 * T * T * T * T,  //
      0, 0, 2, 6 * T, 12 * T * T, 20 * T * T * T;
  const auto fill = [&](const Stretch& s, double at, int row) {
    const Rates r = rates_of(s, at);
    const Angles angles = angles_on(s, at);
    wanted.row(row) << s.pose(at).p.transpose(), angles.at.transpose();
    wanted.row(row + 1) << r.p1.transpose(), angles.first.transpose();
    wanted.row(row + 2) << r.p2.transpose(), angles.second.transpose();
  };
  fill(a, a.size - cut, 0);
  fill(b, cut, 3);
  out.polynomial = conditions.fullPivLu().solve(wanted).transpose();
  if (!a.turns() && !b.turns()) {
    out.polynomial.bottomRows<3>().setZero();
    out.polynomial.block<3, 1>(3, 0) = a.angles_to;
  }
  out.from = a.pose(a.size - cut).p;
  out.to = b.pose(cut).p;
  out.length = length_of(out);
  return out;
}

/// How far a blend is from the corner that it replaces: from the nearer of both stretches, at most.
double deviation_of(const Stretch& blend, const Stretch& a, const Stretch& b, double cut) {
  constexpr int kPlaces = 16;
  double out = 0;
  for (int k = 1; k < kPlaces; ++k) {
    const Vec3 p = blend.pose(blend.size * k / kPlaces).p;
    double nearest = 1e300;
    for (int i = 0; i <= kPlaces; ++i) {
      nearest = std::min(
          {nearest, (p - a.pose(a.size - cut * i / kPlaces).p).norm(), (p - b.pose(cut * i / kPlaces).p).norm()});
    }
    out = std::max(out, nearest);
  }
  return out;
}

}  // namespace

PosePath with_speed(PosePath path, double speed) {
  for (Stretch& s : path.stretches)
    if (!(s.speed > 0)) s.speed = speed;
  return path;
}

PosePath blended(const PosePath& path, double deviation, bool curvature) {
  const std::size_t n = path.stretches.size();
  std::vector<double> cut_start(n, 0), cut_end(n, 0);
  std::vector<std::optional<Stretch>> blends(n);
  for (std::size_t k = 0; k + 1 < n && deviation > 0; ++k) {
    const Stretch &a = path.stretches[k], &b = path.stretches[k + 1];
    if (a.stop || a.wait > 0 || !(a.length > 0) || !(b.length > 0) || (a.before - b.before).norm() > 1e-12) continue;
    if ((a.turning == Turning::turn && a.turns()) || (b.turning == Turning::turn && b.turns())) continue;
    if (a.spin_from != 0 || a.spin_to != 0 || b.spin_from != 0 || b.spin_to != 0) continue;
    const Junction j = path.junction(k);
    if (j.tangent && (j.smooth || !curvature)) continue;
    constexpr double kHalfTurn = 3.0;  // rad: a way back on itself has no blend
    if (j.corner > kHalfTurn) continue;
    double low = 0, high = 0.5 * std::min(a.size, b.size);
    constexpr int kHalvings = 30;
    Stretch best;
    for (int step = 0; step < kHalvings; ++step) {
      const double cut = step == 0 ? high : 0.5 * (low + high);
      const Stretch blend = blend_of(a, b, cut);
      if (deviation_of(blend, a, b, cut) <= deviation) {
        best = blend;
        low = cut;
        if (step == 0) break;
      } else {
        high = cut;
      }
      if (low > 0 && high - low < 1e-3 * low) break;
    }
    if (!(low > 0)) continue;
    cut_end[k] = cut_start[k + 1] = low;
    blends[k] = best;
  }
  PosePath out;
  for (std::size_t k = 0; k < n; ++k) {
    const Stretch& s = path.stretches[k];
    const double end = s.size - cut_end[k];
    if (end - cut_start[k] > kSame)
      out.stretches.push_back(cut_start[k] > 0 || cut_end[k] > 0 ? part_of(s, cut_start[k], end) : s);
    if (blends[k]) out.stretches.push_back(*blends[k]);
  }
  for (const Stretch& s : out.stretches) {
    out.length += s.length;
    out.size += s.size;
  }
  return out;
}

namespace {

Vec3 angles_from_deg(const std::vector<double>& deg) {
  return {units::from_deg(deg[0]), units::from_deg(deg[1]), units::from_deg(deg[2])};
}

/// The stretches of a file, with waits where a pose stays for a time.
class Stretches {
 public:
  /// False where that is none.
  bool waits(const TargetPose& from, const TargetPose& to, double time) {
    if (!(time > 0) || (to.p - from.p).norm() > kSame || (to.angles - from.angles).norm() > kSame) return false;
    (all_.empty() ? before_ : all_.back().wait) += time;
    return true;
  }
  void add(Stretch stretch) {
    if (all_.empty()) stretch.wait_before = before_;
    all_.push_back(std::move(stretch));
  }
  [[nodiscard]] const std::vector<Stretch>& all() const { return all_; }
  [[nodiscard]] Result<PosePath> path() && { return pose_path_of(std::move(all_)); }

 private:
  std::vector<Stretch> all_;
  double before_ = 0;
};

/// Whether all stretches have their times, or none.
Result<bool> timed(const std::vector<Stretch>& stretches, const Place& place) {
  const auto with = std::count_if(stretches.begin(), stretches.end(), [](const Stretch& s) { return s.duration > 0; });
  if (with != 0 && with != static_cast<long>(stretches.size())) {
    return fail("MO111", fmt::format("{} of {} stretches have a duration", with, stretches.size()), place,
                "give time_s to every stretch, or to none");
  }
  return with != 0;
}

// Beyond them lies a wrong unit, and numbers that no longer add up.
constexpr config::Range kTimes_s{1e-6, 1e9}, kSpeeds_mm_per_s{1e-6, 1e9};

}  // namespace

Result<PosePathFile> pose_path_from(const config::Table& table) {
  const auto point = [](const config::Table& in, const char* key) -> Result<Vec3> {
    POLYPOD_ASSIGN(n, in.numbers(key, 3));
    return Vec3(units::from_mm(n[0]), units::from_mm(n[1]), units::from_mm(n[2]));
  };
  const auto angles = [](const config::Table& in, const char* key) -> Result<Vec3> {
    POLYPOD_ASSIGN(n, in.numbers(key, 3, {-3600, 3600}));
    return angles_from_deg(n);
  };
  const auto choice = [](const config::Table& in, const char* key,
                         const std::vector<std::string>& words) -> Result<std::size_t> {
    POLYPOD_ASSIGN(text, in.optional_text(key, words.front()));
    const auto found = std::find(words.begin(), words.end(), text);
    if (found == words.end()) {
      return fail("MO112", fmt::format("{} = \"{}\" is none of {}", key, text, fmt::join(words, ", ")),
                  in.place_of(key));
    }
    return static_cast<std::size_t>(found - words.begin());
  };
  PosePathFile out;
  TargetPose at;
  POLYPOD_ASSIGN(rows, table.tables("segments"));
  // Of a task without places: nothing of the path names one.
  const bool turns_alone = table.has("start_deg") &&
                           std::none_of(rows.begin(), rows.end(),
                                        [](const config::Table& row) { return row.has("to_mm") || row.has("via_mm"); });
  if (table.has("start_mm") || !turns_alone) {
    POLYPOD_ASSIGN(start, point(table, "start_mm"));
    at.p = start;
  }
  if (table.has("start_deg")) {
    POLYPOD_ASSIGN(first, angles(table, "start_deg"));
    at.angles = first;
    out.angles = true;
  }
  POLYPOD_ASSIGN(speed, table.optional_number("speed_mm_per_s", 0, kSpeeds_mm_per_s));
  out.speed = units::from_mm(speed);
  POLYPOD_ASSIGN(one_axis, choice(table, "turning", {"angles", "turn"}));
  POLYPOD_ASSIGN(profile, choice(table, "profile", {"linear", "smooth", "spline"}));
  out.profile = static_cast<Profile>(profile);
  POLYPOD_TRY(table.finish());
  Stretches stretches;
  for (const config::Table& row : rows) {
    TargetPose to = at;
    if (row.has("to_mm")) {
      POLYPOD_ASSIGN(p, point(row, "to_mm"));
      to.p = p;
    }
    if (row.has("to_deg")) {
      POLYPOD_ASSIGN(a, angles(row, "to_deg"));
      to.angles = a;
      out.angles = true;
    }
    const Turning turning = one_axis == 1 ? Turning::turn : Turning::angles;
    Result<Stretch> stretch = straight(at, to, turning);
    const bool bow = row.has("via_mm");
    if (bow) {
      POLYPOD_ASSIGN(via, point(row, "via_mm"));
      stretch = curved(at, via, to, turning);
    }
    POLYPOD_ASSIGN(time, row.optional_number("time_s", 0, kTimes_s));
    POLYPOD_ASSIGN(own_speed, row.optional_number("speed_mm_per_s", 0, kSpeeds_mm_per_s));
    POLYPOD_ASSIGN(stop, row.optional_boolean("stop", false));
    POLYPOD_TRY(row.finish());
    if (!bow && stretches.waits(at, to, time)) continue;
    if (!stretch) return fail(stretch.error().id, stretch.error().message, row.place(), stretch.error().hint);
    stretch->duration = time;
    stretch->speed = units::from_mm(own_speed);
    stretch->stop = stop;
    stretch->line = row.place().line;
    stretches.add(*stretch);
    at = to;
  }
  POLYPOD_ASSIGN(has_times, timed(stretches.all(), table.place()));
  out.timed = has_times;
  POLYPOD_ASSIGN(path, std::move(stretches).path());
  out.path = std::move(path);
  return out;
}

namespace {

Result<PosePathFile> read_csv(const std::string& file, const std::vector<std::string>& needed) {
  POLYPOD_ASSIGN(table, csv::read(file));
  POLYPOD_TRY(table.needs(needed));
  PosePathFile out;
  const bool has_time = table.has("time_s");
  out.angles = table.has("a_deg") || table.has("b_deg") || table.has("c_deg");
  Stretches stretches;
  TargetPose last;
  double last_time = 0;
  bool first = true;
  for (const csv::Table::Row& row : table.rows) {
    TargetPose to;
    const std::array<const char*, 3> of_point{"x_mm", "y_mm", "z_mm"}, of_angle{"a_deg", "b_deg", "c_deg"};
    for (int k = 0; k < 3; ++k) {
      const char* column = of_point[static_cast<std::size_t>(k)];
      if (table.has(column)) {
        POLYPOD_ASSIGN(x, table.number(row, column));
        to.p[k] = units::from_mm(x);
      }
      POLYPOD_ASSIGN(a, table.number(row, of_angle[static_cast<std::size_t>(k)], 0));
      to.angles[k] = units::from_deg(a);
    }
    double time = 0;
    if (has_time) {
      POLYPOD_ASSIGN(t, table.number(row, "time_s"));
      time = t;
    }
    if (!first) {
      if (has_time && !(time > last_time)) {
        return fail("MO113", fmt::format("time_s {:g} after {:g}: times must rise", time, last_time),
                    table.place_of(row));
      }
      const double duration = has_time ? time - last_time : 0;
      if (has_time && !(duration >= kTimes_s.min && duration <= kTimes_s.max)) {
        return fail("MO113",
                    fmt::format("time_s {:g} after {:g}: a stretch takes {:g} s at least, {:g} s at most", time,
                                last_time, kTimes_s.min, kTimes_s.max),
                    table.place_of(row));
      }
      if (!stretches.waits(last, to, duration)) {
        Result<Stretch> stretch = straight(last, to);
        if (!stretch)
          return fail(stretch.error().id, stretch.error().message, table.place_of(row), stretch.error().hint);
        stretch->duration = duration;
        stretch->line = row.line;
        stretches.add(*stretch);
      }
    }
    first = false;
    last = to;
    last_time = time;
  }
  POLYPOD_ASSIGN(unused, table.unused());
  out.timed = has_time;
  POLYPOD_ASSIGN(path, std::move(stretches).path());
  out.path = std::move(path);
  return out;
}

}  // namespace

Result<PosePathFile> read_pose_path(const std::string& file, const std::vector<std::string>& needed) {
  if (file.ends_with(".csv")) return read_csv(file, needed);
  POLYPOD_ASSIGN(table, config::read_file(file));
  return pose_path_from(table);
}

}  // namespace polypod::motion
