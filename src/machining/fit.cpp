// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "fit.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace polypod::machining {
namespace {

// An arc that turns by more than this is no better than two, and near a full turn rounding could close it, rad.
constexpr double kMostTurn = 5.0;
// An arc whose sagitta is below this is written as a line, m: the grain of written coordinates.
constexpr double kFlat = 0.2e-6;

/// An arc of the command in the plane of the programmed one.
struct Arc {
  Vec3 centre = Vec3::Zero();
  double radius = 0;
  double turn = 0;  ///< rad, > 0
};

/// Unit vectors of the plane, u cross v being the axis about which the move turns in the positive sense, and the axis.
struct Frame {
  explicit Frame(const gcode::Move& move) {
    const int normal = move.plane == gcode::Plane::xy ? 2 : move.plane == gcode::Plane::zx ? 1 : 0;
    w = Vec3::Unit(normal) * (move.clockwise ? -1.0 : 1.0);
    u = Vec3::Unit((normal + 1) % 3);
    v = w.cross(u);
  }
  [[nodiscard]] Eigen::Vector2d flat(const Vec3& p) const { return {u.dot(p), v.dot(p)}; }
  Vec3 u, v, w;
};

double angle_of(const Eigen::Vector2d& p) {
  return std::atan2(p.y(), p.x());
}

/// From angle a on to angle b in the positive sense, 0 .. 2 pi.
double turned(double a, double b) {
  const double turn = std::fmod(b - a, 2 * std::numbers::pi);
  return turn < 0 ? turn + 2 * std::numbers::pi : turn;
}

class Fit {
 public:
  Fit(const gcode::Move& move, const Deflections& d, const Vec3& first, const Vec3& last, const FitOptions& options)
      : move_(move),
        d_(d),
        first_(first),
        last_(last),
        options_(options),
        frame_(move),
        end_(d.s.size() - 1),
        arcs_(move.kind == gcode::MoveKind::arc && !options.chords),
        outside_(move.kind == gcode::MoveKind::arc && options.chords ? 0.5 * options.chord : 0) {}

  std::vector<Piece> run() const {
    std::vector<std::size_t> best = greedy(options_.allowed);
    double low = 0, high = options_.allowed;
    for (int j = 0; best.size() > 1 && j < 7; ++j) {
      const double mid = 0.5 * (low + high);
      std::vector<std::size_t> tighter = greedy(mid);
      if (tighter.size() <= best.size()) {
        best = std::move(tighter);
        high = mid;
      } else {
        low = mid;
      }
    }
    lengthen_last(best);
    smooth(best);
    std::vector<Piece> pieces;
    std::size_t a = 0;
    for (const std::size_t b : best) {
      Piece piece{command(b), false, {}};
      if (const auto arc = arc_between(a, b)) piece.centre = arc->centre;
      pieces.push_back(piece);
      a = b;
    }
    return pieces;
  }

 private:
  struct Error {
    double largest = 0;  ///< m
    double squares = 0;  ///< m^2, summed over the samples after the first
  };

  [[nodiscard]] Vec3 ideal(std::size_t k) const { return move_.point(d_.s[k]) - d_.delta[k]; }
  [[nodiscard]] Vec3 command(std::size_t k) const {
    if (k == 0) return first_;
    if (k == end_) return last_;
    return outside_ > 0 ? Vec3(ideal(k) + outside_ * outwards(k)) : ideal(k);
  }
  /// The direction away from the centre of the programmed arc at a sample.
  [[nodiscard]] Vec3 outwards(std::size_t k) const {
    const Vec3 r = move_.point(d_.s[k]) - move_.centre;
    return (r - frame_.w * frame_.w.dot(r)).normalized();
  }

  /// The arc from command a to command b through the ideal command half way, if it is one that can be written.
  [[nodiscard]] std::optional<Arc> arc_between(std::size_t a, std::size_t b) const {
    if (!arcs_ || b - a < 2) return std::nullopt;
    const Vec3 A = command(a), M = ideal(a + (b - a) / 2), B = command(b);
    const Eigen::Vector2d p = frame_.flat(A), m = frame_.flat(M) - p, q = frame_.flat(B) - p;
    const double cross = m.x() * q.y() - m.y() * q.x();
    const double sagitta = q.norm() > 0 ? std::abs(cross) / q.norm() : 0;
    if (!(cross > 0) || sagitta < kFlat) return std::nullopt;  // it turns the other way, or not at all
    const Eigen::Vector2d from_a = Eigen::Vector2d(q.y() * m.squaredNorm() - m.y() * q.squaredNorm(),
                                                   m.x() * q.squaredNorm() - q.x() * m.squaredNorm()) /
                                   (2 * cross);
    Arc arc;
    arc.centre = A + frame_.u * from_a.x() + frame_.v * from_a.y();
    arc.radius = from_a.norm();
    arc.turn = turned(angle_of(-from_a), angle_of(q - from_a));
    if (!(arc.turn < kMostTurn)) return std::nullopt;
    return arc;
  }

  /// Error of the piece from sample a to sample b; gives up above `give_up`. An arc off the ideal command by more than
  /// the chord tolerance has an infinite one.
  [[nodiscard]] Error error(std::size_t a, std::size_t b, double give_up) const {
    const Vec3 A = command(a), B = command(b);
    const std::optional<Arc> arc = arc_between(a, b);
    Error out;
    if (arcs_ && !arc && b - a > 1) return {INFINITY, INFINITY};
    const double start = arc ? angle_of(frame_.flat(A - arc->centre)) : 0;
    for (std::size_t k = a; k <= b && out.largest <= give_up; ++k) {
      Vec3 commanded;
      if (arc) {
        const Eigen::Vector2d out_of_centre = frame_.flat(ideal(k) - arc->centre);
        double share = turned(start, angle_of(out_of_centre)) / arc->turn;
        if (share > 1) share = 2 * (k - a) > b - a ? 1 : 0;  // just beyond one of the ends
        const double angle = start + share * arc->turn;
        commanded = arc->centre + arc->radius * (frame_.u * std::cos(angle) + frame_.v * std::sin(angle)) +
                    frame_.w * (frame_.w.dot(B - A) * share);
        if (k > a && k < b && (commanded - ideal(k)).norm() > options_.chord) return {INFINITY, INFINITY};
      } else {
        const double u = d_.s[b] > d_.s[a] ? (d_.s[k] - d_.s[a]) / (d_.s[b] - d_.s[a]) : 1.0;
        commanded = A + (B - A) * u;
        constexpr double kRounding = 1 + 1e-9;
        if (outside_ > 0 && b - a > 1 && (commanded - ideal(k)).norm() > outside_ * kRounding) {
          return {INFINITY, INFINITY};
        }
      }
      const double off = distance_from(move_, d_, k, commanded + d_.delta[k] - move_.point(d_.s[k]));
      out.largest = std::max(out.largest, off);
      if (k > a) out.squares += off * off;
    }
    return out;
  }

  /// Whether a block from sample a to sample b is long enough: by its chord, as it will be written.
  [[nodiscard]] bool long_enough(std::size_t a, std::size_t b) const {
    return (command(b) - command(a)).norm() >= options_.shortest * (1 - 1e-9);
  }

  /// The first sample that is a shortest block beyond sample a.
  [[nodiscard]] std::size_t next(std::size_t a) const {
    std::size_t b = std::min(a + 1, end_);
    while (b < end_ && !long_enough(a, b)) ++b;
    return b;
  }

  [[nodiscard]] std::vector<std::size_t> greedy(double allowed) const {
    std::vector<std::size_t> knots;
    std::size_t at = 0;
    while (at < end_) {
      const auto fits = [&](std::size_t to) { return error(at, to, allowed).largest <= allowed; };
      std::size_t good = next(at);
      if (fits(end_)) {
        good = end_;
      } else {
        std::size_t reach = 2 * (good - at);
        while (at + reach < end_ && fits(at + reach)) {
          good = at + reach;
          reach *= 2;
        }
        std::size_t bad = std::min(at + reach, end_);
        while (bad > good + 1) {
          const std::size_t mid = good + (bad - good) / 2;
          (fits(mid) ? good : bad) = mid;
        }
      }
      knots.push_back(good);
      at = good;
    }
    return knots;
  }

  /// Moves the last knot but one back where the last block would be too short.
  void lengthen_last(std::vector<std::size_t>& knots) const {
    if (knots.size() < 2 || long_enough(knots[knots.size() - 2], end_)) return;
    const std::size_t before = knots.size() > 2 ? knots[knots.size() - 3] : 0;
    std::size_t k = knots[knots.size() - 2];
    while (k > before + 1 && !long_enough(k, end_)) --k;
    if (long_enough(before, k) && long_enough(k, end_)) {
      knots[knots.size() - 2] = k;
    } else {
      knots.erase(knots.end() - 2);  // the check of what was written says whether this is good enough
    }
  }

  /// Descent knot by knot, steps of powers of two.
  void smooth(std::vector<std::size_t>& knots) const {
    constexpr int kSweeps = 12;
    const double allowed = options_.allowed;
    bool moved = knots.size() > 1;
    for (int sweep = 0; moved && sweep < kSweeps; ++sweep) {
      moved = false;
      for (std::size_t j = 0; j + 1 < knots.size(); ++j) {
        const std::size_t a = j == 0 ? 0 : knots[j - 1], b = knots[j + 1];
        const auto cost = [&](std::size_t k) -> std::optional<double> {
          const Error left = error(a, k, allowed);
          if (left.largest > allowed) return std::nullopt;
          const Error right = error(k, b, allowed);
          if (right.largest > allowed) return std::nullopt;
          return left.squares + right.squares;
        };
        std::optional<double> here = cost(knots[j]);
        const std::size_t from = knots[j];
        for (std::size_t step = 1; step < b - a; step *= 2) {
          for (const std::size_t k : {from + step, from - std::min(from, step)}) {
            if (k <= a || k >= b || !long_enough(a, k) || !long_enough(k, b)) continue;
            const std::optional<double> there = cost(k);
            if (!there || (here && *there >= *here)) continue;
            here = there;
            knots[j] = k;
            moved = true;
          }
        }
      }
    }
  }

  const gcode::Move& move_;
  const Deflections& d_;
  const Vec3 first_, last_;
  const FitOptions& options_;
  const Frame frame_;
  const std::size_t end_;
  const bool arcs_;
  const double outside_;  ///< m, by which the knots of chords lie outside of the ideal command; 0 for none
};

/// With samples at most `spacing` apart, those between the given ones by linear interpolation.
Deflections refined(const Deflections& d, double spacing) {
  Deflections out;
  out.cuts = d.cuts;
  for (std::size_t k = 0; k + 1 < d.s.size(); ++k) {
    const int parts = std::max(1, static_cast<int>(std::ceil((d.s[k + 1] - d.s[k]) / spacing)));
    for (int j = 0; j < parts; ++j) {
      const double u = static_cast<double>(j) / parts;
      out.s.push_back((1 - u) * d.s[k] + u * d.s[k + 1]);
      out.delta.push_back((1 - u) * d.delta[k] + u * d.delta[k + 1]);
    }
  }
  out.s.push_back(d.s.back());
  out.delta.push_back(d.delta.back());
  return out;
}

/// Knots of chords are samples, so that these must be closer than a chord is long.
double spacing_for_chords(const gcode::Move& move, double chord) {
  constexpr double kShare = 0.125;
  const double radius = Frame(move).flat(move.start - move.centre).norm();
  return kShare * std::sqrt(8 * radius * chord);
}

}  // namespace

double distance_from(const gcode::Move& move, const Deflections& d, std::size_t k, const Vec3& off) {
  if (k == 0 || k + 1 == d.s.size()) return off.norm();
  const Vec3 along = move.direction(d.s[k]);
  return (off - along * along.dot(off)).norm();
}

std::vector<Piece> fit_pieces(const gcode::Move& move, const Deflections& deflections, const Vec3& first,
                              const Vec3& last, const FitOptions& options) {
  if (options.chords && move.kind == gcode::MoveKind::arc) {
    const Deflections closer = refined(deflections, spacing_for_chords(move, options.chord));
    return Fit(move, closer, first, last, options).run();
  }
  return Fit(move, deflections, first, last, options).run();
}

std::vector<Piece> equal_pieces(const gcode::Move& move, const Deflections& d, const Vec3& last, int count) {
  std::vector<Piece> pieces;
  std::size_t before = 0;
  for (int j = 1; j <= count; ++j) {
    const auto k = static_cast<std::size_t>(std::lround(double(d.s.size() - 1) * j / count));
    if (k <= before) continue;
    pieces.push_back({k + 1 == d.s.size() ? last : Vec3(move.point(d.s[k]) - d.delta[k]), false, {}});
    before = k;
  }
  return pieces;
}

}  // namespace polypod::machining
