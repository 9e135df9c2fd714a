// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/families/hexapod/modes.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <tuple>

#include "leg_homotopy.hpp"
#include "leg_subdivision.hpp"

namespace polypod::machine {
namespace {

using leg_homotopy::Point;

constexpr int kGeneralZeros = 40;
constexpr int kDoubleJointZeros = 16;
/// Imaginary parts below this are tried as 0; the proof decides.
constexpr double kNearlyReal = 1e-7;
/// Closer than this (times the size), two poses that Newton found are taken for one: it stops there at a double zero.
constexpr double kOnePose = 1e-5;

/// The platform about the middles of its joints and of size about 1, which no rotation or choice of origin changes.
struct Normalised : leg_subdivision::Problem {
  Vec3 a_middle = Vec3::Zero(), b_middle = Vec3::Zero();
  double scale = 1;  ///< a power of two, so that scaling is exact

  explicit Normalised(const SixLegs& six) {
    a_middle = middle_of(six.anchor);
    b_middle = middle_of(six.end);
    double size = 0;
    for (int i = 0; i < kLegs; ++i)
      size += (six.anchor[i] - a_middle).squaredNorm() + (six.end[i] - b_middle).squaredNorm() +
              six.length[i] * six.length[i];
    scale = std::exp2(-std::round(std::log2(std::sqrt(size / kLegs))));
    level = true;
    const auto less = [&](double x, double middle) {
      return x == middle ? Interval(0.0) : Interval(scale) * (Interval(x) - Interval(middle));
    };
    for (int i = 0; i < kLegs; ++i) {
      level = level && six.anchor[i].z() == a_middle.z() && six.end[i].z() == b_middle.z();
      for (int k = 0; k < 3; ++k) {
        const Interval a = less(six.anchor[i][k], a_middle[k]);
        const Interval b = less(six.end[i][k], b_middle[k]);
        absolute.difference[i][k].re = a - b;
        absolute.sum[i][k].re = a + b;
      }
      absolute.square[i].re = square(Interval(scale) * Interval(six.length[i]));
      // Relative to leg 1.
      const auto put = [&](const auto& of, leg_homotopy::ComplexT<Interval>& in_proof, leg_homotopy::Complex& in_legs) {
        in_proof.re = i == 0 ? of(i) : of(i) - of(0);
        in_legs.re = in_proof.re.mid();
      };
      for (int k = 0; k < 3; ++k) {
        put([&](int leg) { return absolute.difference[leg][k].re; }, proof.difference[i][k], legs.difference[i][k]);
        put([&](int leg) { return absolute.sum[leg][k].re; }, proof.sum[i][k], legs.sum[i][k]);
      }
      put([&](int leg) { return absolute.square[leg].re; }, proof.square[i], legs.square[i]);
    }
  }

  /// Of equal coordinates exactly theirs.
  static Vec3 middle_of(const SixPoints& points) {
    Vec3 middle = Vec3::Zero();
    for (const Vec3& p : points) middle += p / kLegs;
    for (int k = 0; k < 3; ++k)
      if (std::all_of(points.begin(), points.end(), [&](const Vec3& p) { return p[k] == points[0][k]; }))
        middle[k] = points[0][k];
    return middle;
  }

  [[nodiscard]] Pose outside(const Pose& X) const { return {X.R, Vec3(X.p / scale + a_middle - X.R * b_middle)}; }
  [[nodiscard]] Pose inside(const Pose& X) const { return {X.R, Vec3(scale * (X.p + X.R * b_middle - a_middle))}; }
};

/// A point with the radius round it that holds exactly one zero.
struct Zero {
  Point point;
  double radius = 0;
  bool real = false;
  bool finite = false;
};

/// The zero at the end of a path, if there is proof of one.
std::optional<Zero> proven(const Normalised& n, Point point) {
  if (!leg_homotopy::polish(n.legs, point)) return {};
  point = leg_homotopy::point_of(point.z);
  Zero out;
  const auto certified = [&](Point at) {
    const std::optional<double> radius = leg_homotopy::certify(n.proof, at);
    if (radius) {
      out.point = at;
      out.radius = *radius;
    }
    return radius.has_value();
  };
  double imaginary = 0;
  for (int k = 0; k < 8; ++k) imaginary = std::max(imaginary, std::abs(point.z[k].im) / (k < 4 ? 1 : point.weight));
  if (imaginary < kNearlyReal) {
    Point flat = point;
    for (auto& c : flat.z) c.im = 0;
    out.real = leg_homotopy::polish(n.legs, flat) && certified(flat);
  }
  // A zero that is not real has an imaginary part beyond the radius.
  if (!out.real && !(certified(point) && imaginary > out.radius)) return {};
  leg_homotopy::Complex ee;
  for (int k = 0; k < 4; ++k) ee += out.point.z[k] * out.point.z[k];
  // |d<e,e>| <= 8 |e| radius + 4 radius^2, and rounding.
  out.finite = leg_homotopy::modulus(ee) > 12 * out.radius + 1e-14;
  return out;
}

bool surely_different(const Zero& a, const Zero& b) {
  return leg_homotopy::surely_different(a.point, a.radius, b.point, b.radius);
}

/// Where a path ended.
struct PathResult {
  Point end;
  std::optional<Zero> zero;  ///< proven to lie there
  bool shared = false;       ///< another path ended at the same zero: one of them left its way
};

/// Whether the legs meet in three pairs at these joints.
bool in_pairs(const SixPoints& joint) {
  std::array<bool, kLegs> met{};
  for (int i = 0; i < kLegs; ++i)
    for (int j = i + 1; j < kLegs && !met[i]; ++j)
      if (!met[j] && joint[i] == joint[j]) met[i] = met[j] = true;
  return std::all_of(met.begin(), met.end(), [](bool m) { return m; });
}

/// Fixed numbers in -1..1 that follow no pattern.
double scatter(int index, int prime) {
  return 2 * kinematics::closure_detail::halton(index, prime) - 1;
}

/// The way of a pass: straight in the first, bent differently in each further one.
leg_homotopy::Legs bend_of(int pass) {
  leg_homotopy::Legs bend;
  if (pass == 0) return bend;
  int k = 100 * pass;
  const auto next = [&]() {
    ++k;
    return leg_homotopy::Complex{2 * scatter(k, 2), 2 * scatter(k, 3)};
  };
  for (int i = 0; i < kLegs; ++i) {
    for (int j = 0; j < 3; ++j) {
      bend.difference[i][j] = next();
      bend.sum[i][j] = next();
    }
    bend.square[i] = next();
  }
  return bend;
}

/// The k-th start of the search: any rotation (Shoemake 1992), the platform's middle anywhere within reach.
Pose start_pose(int k, double reach) {
  const auto u = [&](int prime) { return kinematics::closure_detail::halton(k + 1, prime); };
  const double r = u(2), alpha = 2 * std::numbers::pi * u(3), beta = 2 * std::numbers::pi * u(5);
  const Eigen::Quaterniond e(std::sqrt(1 - r) * std::sin(alpha), std::sqrt(1 - r) * std::cos(alpha),
                             std::sqrt(r) * std::sin(beta), std::sqrt(r) * std::cos(beta));
  return {e.normalized().toRotationMatrix(), reach * Vec3(2 * u(7) - 1, 2 * u(11) - 1, 2 * u(13) - 1)};
}

/// Newton by the least step (small singular values left out): it ends also where the modes are no points but curves.
kinematics::NewtonResult settle(const SixLegs& six, const Pose& seed, double size) {
  constexpr int kSteps = 30;
  constexpr double kSmallest = 1e-5;
  kinematics::NewtonResult out{seed, 0, 0, false};
  for (; out.iterations <= kSteps && !out.converged; ++out.iterations) {
    Vec6 missing;
    for (int i = 0; i < kLegs; ++i) missing[i] = six.length[i] - (out.X_MT * six.end[i] - six.anchor[i]).norm();
    out.residual = missing.cwiseAbs().maxCoeff();
    out.converged = out.residual <= 1e-12 * size;
    Mat6 K = leg_rows(out.X_MT, six.anchor, six.end);
    K.rightCols<3>() /= size;
    Eigen::CompleteOrthogonalDecomposition<Mat6> least;
    least.setThreshold(kSmallest);
    Vec6 step = least.compute(K).solve(missing);
    if (step.norm() > 0.5 * size) step *= 0.5 * size / step.norm();
    out.X_MT.p += step.head<3>();
    out.X_MT.R = rotation_of(step.tail<3>() / size) * out.X_MT.R;
  }
  return out;
}

bool new_among(const std::vector<Zero>& zeros, const Zero& z) {
  return std::all_of(zeros.begin(), zeros.end(), [&](const Zero& other) { return surely_different(other, z); });
}

void count(const std::vector<Zero>& zeros, AssemblyModes& out) {
  const auto finite = std::count_if(zeros.begin(), zeros.end(), [](const Zero& z) { return z.finite; });
  out.zeros = static_cast<int>(zeros.size());
  out.zeros_at_infinity = static_cast<int>(zeros.size() - finite);
}

/// The real zeros by division, beside those that are known.
void divide(const Normalised& n, const ModesOptions& options, AssemblyModes& out, std::vector<Zero>& zeros) {
  if (options.boxes <= 0) return;
  std::vector<Point> known;
  for (const Zero& z : zeros)
    if (z.real && z.finite) known.push_back(z.point);
  leg_subdivision::Options division;
  division.boxes = options.boxes;
  const leg_subdivision::Result found = leg_subdivision::real_zeros(n, known, division);
  out.boxes = found.boxes;
  out.singular_box = found.singular;
  if (found.complete) {
    out.proof = ModesProof::subdivision;
    std::erase_if(zeros, [](const Zero& z) { return z.real && z.finite; });
  }
  for (const leg_subdivision::RealZero& z : found.zeros) {
    const Zero zero{z.point, z.radius, true, true};
    if (found.complete || new_among(zeros, zero)) zeros.push_back(zero);
  }
  count(zeros, out);
}

/// All zeros by homotopy, beside those that are known, until there is a proof.
void follow(const Normalised& n, const SixLegs& six, const ModesOptions& options, AssemblyModes& out,
            std::vector<PathResult>& path, std::vector<Zero>& zeros) {
  const bool double_joints = in_pairs(six.anchor) || in_pairs(six.end);
  const auto starts = leg_homotopy::start_points();
  path.resize(starts.size());
  while (out.passes < options.passes && out.proof == ModesProof::none) {
    // The second pass repeats with smaller steps what the first may have lost; further ones go other ways.
    const bool again = out.passes == 1;
    std::vector<std::size_t> chosen;
    for (std::size_t i = 0; i < path.size(); ++i)
      if (!again || !path[i].zero || path[i].shared) chosen.push_back(i);
    const leg_homotopy::Legs bend = bend_of(again ? 0 : out.passes);
    leg_homotopy::TrackOptions track;
    if (out.passes > 0) track.accuracy *= 0.01;
    tbb::parallel_for(std::size_t{0}, chosen.size(), [&](std::size_t c) {
      PathResult& p = path[chosen[c]];
      const auto end = leg_homotopy::track(leg_homotopy::start_legs(), n.legs, bend, starts[chosen[c]], track);
      p.end = end.point;
      p.zero = end.left == 0 ? proven(n, end.point) : std::nullopt;
      p.shared = false;
    });
    for (std::size_t i = 0; i < path.size(); ++i) {
      for (std::size_t j = 0; j < i && path[i].zero; ++j) {
        if (!path[j].zero || surely_different(*path[j].zero, *path[i].zero)) continue;
        path[i].shared = path[j].shared = true;
      }
      if (path[i].zero && new_among(zeros, *path[i].zero)) zeros.push_back(*path[i].zero);
    }
    ++out.passes;
    count(zeros, out);
    out.singular_ends =
        static_cast<int>(std::count_if(path.begin(), path.end(), [](const PathResult& p) { return !p.zero; }));
    if (out.zeros == kGeneralZeros) {
      out.proof = ModesProof::general;
    } else if (double_joints && out.zeros - out.zeros_at_infinity == kDoubleJointZeros) {
      out.proof = ModesProof::double_joints;
    } else if (out.passes == 1 && !n.level) {
      divide(n, options, out, zeros);
    }
  }
}

bool same_pose(const Pose& a, const Pose& b, double size) {
  return (a.p - b.p).norm() < kOnePose * size && (a.R - b.R).norm() < kOnePose;
}

}  // namespace

AssemblyModes assembly_modes(const SixLegs& six, const ModesOptions& options) {
  AssemblyModes out;
  bool numbers = true;
  double size = 0;
  for (int i = 0; i < kLegs; ++i) {
    numbers = numbers && std::isfinite(six.length[i]) && six.anchor[i].allFinite() && six.end[i].allFinite();
    size = std::max({size, std::abs(six.length[i]), six.end[i].norm()});
  }
  if (!numbers) return out;
  if (std::any_of(six.length.begin(), six.length.end(), [](double l) { return l < 0; })) {
    out.proof = ModesProof::no_length;
    return out;
  }
  if (!(size > 0)) return out;

  const Normalised n(six);
  std::vector<Zero> zeros;
  if (n.level) divide(n, options, out, zeros);
  std::vector<PathResult> path;
  follow(n, six, options, out, path, zeros);

  const auto residual_of = [&](const Pose& X) {
    double largest = 0;
    for (int i = 0; i < kLegs; ++i)
      largest = std::max(largest, std::abs((X * six.end[i] - six.anchor[i]).norm() - six.length[i]));
    return largest;
  };
  const auto add = [&](const Pose& seed, bool is_proven) {
    kinematics::NewtonResult mode = newton_on_legs(six, seed);
    if (!mode.converged && !is_proven) mode = settle(six, seed, size);
    // Next to another mode Newton may slip to it: then the proven pose stays as it is.
    const bool keep = is_proven && !(mode.converged && same_pose(mode.X_MT, seed, size));
    if (!is_proven && (!mode.converged || std::any_of(out.poses.begin(), out.poses.end(),
                                                      [&](const Pose& X) { return same_pose(X, mode.X_MT, size); }))) {
      return;
    }
    out.poses.push_back(keep ? seed : mode.X_MT);
    out.residuals.push_back(residual_of(out.poses.back()));
  };
  for (const Zero& z : zeros)
    if (z.real && z.finite) add(n.outside(leg_homotopy::pose_of(z.point)), true);

  if (out.proof == ModesProof::none) {
    for (const PathResult& p : path) {
      double turn = 0;
      for (int k = 0; k < 4; ++k) turn += p.end.z[k].re * p.end.z[k].re;
      if (!p.zero && turn > 1e-6) add(n.outside(leg_homotopy::pose_of(p.end)), false);
    }
    double reach = 0;
    for (int i = 0; i < kLegs; ++i)
      reach = std::max(reach, n.scale * (six.length[i] + (six.anchor[i] - n.a_middle).norm()));
    // Of legs a thousand times as long as the machine is wide, rounding leaves the turn of the platform open: what
    // Newton's method then finds are not different modes.
    constexpr double kTooLong = 300;
    double width = 0;
    for (int i = 0; i < kLegs; ++i)
      width = std::max(width, (six.anchor[i] - six.anchor[0]).norm() + (six.end[i] - six.end[0]).norm());
    const int starts = size < kTooLong * width ? options.starts : 0;
    for (; out.starts < starts && static_cast<int>(out.poses.size()) <= kGeneralZeros; ++out.starts)
      add(n.outside(start_pose(out.starts, reach)), false);
  }

  // Equal heights of symmetric machines must not be ordered by their rounding.
  const double grid = 1e-9 * size;
  const auto key = [&](const Pose& X) {
    const auto cell = [&](double x) { return std::llround(x / grid); };
    const auto turn = [&](int i, int j) { return std::llround(X.R(i, j) * 1e9); };
    return std::tuple(-cell(X.p.z()), -cell(X.p.y()), -cell(X.p.x()), -turn(2, 2), -turn(0, 0), -turn(1, 0),
                      -turn(2, 0), -turn(2, 1));
  };
  std::vector<std::size_t> order(out.poses.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return key(out.poses[a]) < key(out.poses[b]); });
  AssemblyModes sorted = out;
  for (std::size_t i = 0; i < order.size(); ++i) {
    sorted.poses[i] = out.poses[order[i]];
    sorted.residuals[i] = out.residuals[order[i]];
  }
  return sorted;
}

std::string description_of(const AssemblyModes& m) {
  const std::size_t n = m.poses.size();
  const std::string count = fmt::format("{} assembly mode{}", n == 0 ? "no" : fmt::format("{}", n), n == 1 ? "" : "s");
  const std::string proven = fmt::format("{} complex solutions are proven to exist, {} of them real", m.zeros, n);
  switch (m.proof) {
    case ModesProof::general:
      return fmt::format("{}: all there are. {}, and no platform has more.", count, proven);
    case ModesProof::double_joints:
      return fmt::format("{}: all there are. {}, and no platform with three double joints has more.", count, proven);
    case ModesProof::no_length:
      return "no assembly mode: a length is negative";
    case ModesProof::subdivision:
      return fmt::format("{}: all there are. Bounds on boxes of all rotations prove that there is no other.", count);
    case ModesProof::none:
      break;
  }
  if (m.moves()) {
    return fmt::format(
        "more than {} poses: self-motion, the platform moves with all leg lengths locked; some of the poses are listed",
        kGeneralZeros);
  }
  return fmt::format(
      "{} found; there may be others. {} of the {} complex solutions are proven, the other paths end at singular or "
      "infinite ones; {}.{}",
      count, m.zeros, kGeneralZeros,
      m.starts > 0 ? fmt::format("Newton from {} starts was searched besides", m.starts)
                   : std::string("the legs are so long that a search could not distinguish poses"),
      m.boxes == 0     ? ""
      : m.singular_box ? " Bounds on boxes of rotations prove no more, because a mode is singular or nearly so."
                       : fmt::format(" Bounds on boxes of rotations prove no more: given up after {}.", m.boxes));
}

std::string method_of(const AssemblyModes& m) {
  std::string out;
  if (m.passes > 0) out = "parameter homotopy in dual quaternions, each end proven by interval arithmetic";
  if (m.boxes > 0)
    out += std::string(out.empty() ? "" : "; ") +
           "division of the rotations into boxes with bounds, each mode proven by interval arithmetic";
  return out;
}

bool AssemblyModes::moves() const {
  return proof == ModesProof::none && poses.size() > static_cast<std::size_t>(kGeneralZeros);
}

}  // namespace polypod::machine
