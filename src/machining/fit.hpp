// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The fewest blocks that stand for a corrected move: lines for a line, arcs for an arc.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "polypod/core/long_vector.hpp"
#include "polypod/gcode/interpreter.hpp"

namespace polypod::machining {

/// The deflection along one move when the deflected tool is on the programmed path: the ideal command is p(s) - delta.
struct Deflections {
  std::vector<double> s;    ///< arc lengths of the samples, m, rising, both ends included
  std::vector<Vec3> delta;  ///< m, in W
  bool cuts = false;
};

/// The deflections of all moves of a program, found in their order.
class DeflectionsOfMoves {
 public:
  void clear(std::size_t moves) {
    of_.assign(moves, Of{});
    s_.clear();
    delta_.clear();
  }
  /// A sample of a move; those of one move follow each other.
  void add(std::size_t move, double s, const Vec3& delta, bool cuts) {
    Of& of = of_[move];
    if (of.count++ == 0) of.first = s_.size();
    of.cuts = of.cuts || cuts;
    s_.push_back(s);
    delta_.push_back(delta);
  }
  [[nodiscard]] bool cuts(std::size_t move) const { return of_[move].cuts; }
  /// The largest deflection on a move, m; 0 where there is no sample.
  [[nodiscard]] double largest(std::size_t move) const {
    double out = 0;
    for (std::size_t k = 0; k < of_[move].count; ++k) out = std::max(out, delta_[of_[move].first + k].norm());
    return out;
  }
  [[nodiscard]] Vec3 at_start(std::size_t move) const { return delta_[of_[move].first]; }
  [[nodiscard]] Vec3 at_end(std::size_t move) const { return delta_[of_[move].first + of_[move].count - 1]; }
  void get(std::size_t move, Deflections& out) const {
    const Of of = of_[move];
    out.cuts = of.cuts;
    out.s.clear();
    out.delta.clear();
    for (std::size_t k = of.first; k < of.first + of.count; ++k) {
      out.s.push_back(s_[k]);
      out.delta.push_back(delta_[k]);
    }
  }

 private:
  struct Of {
    std::size_t first = 0;
    std::uint32_t count = 0;
    bool cuts = false;
  };
  LongVector<Of> of_;
  LongVector<double> s_;
  LongVector<Vec3> delta_;
};

/// A block of the corrected path.
struct Piece {
  Vec3 end = Vec3::Zero();                    ///< p_W, m
  bool transition = false;                    ///< takes the load on or off between two moves
  std::optional<Vec3> centre = std::nullopt;  ///< of an arc in the plane and the sense of the programmed one
};

struct FitOptions {
  double allowed = 0;   ///< m, largest distance of the deflected tool from the programmed move at a sample
  double chord = 0;     ///< m, largest distance of an arc from the ideal command
  double shortest = 0;  ///< m, no block is shorter where the move is not
  bool chords = false;  ///< lines for an arc too
};

/// Distance of p(s_k) + off from the move: across it between its ends, in full at the ends.
double distance_from(const gcode::Move& move, const Deflections& d, std::size_t k, const Vec3& off);

/// Pieces from `first` to `last` that keep to the options at every sample; their knots are samples. Found greedily,
/// each piece reaching as far as it can, farthest first; with that number fixed the largest error is made as small as
/// it goes, then the knots move to where the squared error is smallest (a long piece that reaches into a ramp of the
/// deflection would else be off along its whole length).
///
/// A programmed arc or helix is replaced by arcs through three points of the ideal command each, in the arc's plane and
/// with an even feed along its axis; between neighbouring samples, and where no such arc keeps within `chord`, by a
/// straight line. A piece between neighbouring samples is always taken.
///
/// With `chords` an arc is replaced by lines whose knots lie chord / 2 outside of the ideal command and whose middles
/// at most as far inside, so that what is cut has the right size on average; at an arc of radius r they are about
/// sqrt(8 r chord) long. Cost: O(n log n) for n samples.
std::vector<Piece> fit_pieces(const gcode::Move& move, const Deflections& deflections, const Vec3& first,
                              const Vec3& last, const FitOptions& options);

/// Straight pieces at `count` equal parts of the move, for the mirror of SLAV (5.2).
std::vector<Piece> equal_pieces(const gcode::Move& move, const Deflections& deflections, const Vec3& last, int count);

}  // namespace polypod::machining
