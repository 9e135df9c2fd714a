// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Ends of plunges, where the thrust along the axis may leave material.
#pragma once

#include <cstdint>
#include <map>
#include <unordered_map>
#include <vector>

#include "polypod/machining/predict.hpp"
#include "way.hpp"

namespace polypod::machining {

/// What the thrust holds back at the ends of plunges: see Plunge.
class HeldBack {
 public:
  /// `step`: the longest between evaluated points, m.
  HeldBack(const Job& job, const Way& way, double step)
      : job_(job), axis_(job.tool_frame.axis()), moves_(*way.programmed), lines_(*way.lines), step_(step) {}

  /// A point that cuts, of the programmed move i.
  void see(std::size_t i, const Sample& sample);

  /// Between which places the tip comes to rest in a dwell after the programmed move i: its command, and where the
  /// edges alone hold it.
  void rest(std::size_t i, const Vec3& command, const Vec3& by_edges);

  /// Those that the tube holds go to `most_within`, the others are returned.
  [[nodiscard]] std::vector<Plunge> take(Plunge& most_within);

 private:
  struct End {
    double held_back = 0, aside = 0;  ///< m
    double at_rest = 0;               ///< m, aside at most, when the chips are gone
  };

  [[nodiscard]] Plunge judge(std::size_t i, const End& end, double tube) const;

  /// Whether the tool goes on down from there, or comes back to the same place and goes deeper.
  [[nodiscard]] bool goes_deeper(std::size_t i) const;

  /// The plunges of the program by where they are in the plane.
  void find_plunges();
  static std::uint64_t cell_of(double x, double y);

  static constexpr double kSamePlace = 1e-6;  // m
  static constexpr double kCell = 1e-3;       // m
  const Job& job_;
  const Vec3 axis_;  // of the tool, in W
  const LongVector<gcode::Move>& moves_;
  const gcode::Program& lines_;
  const double step_;
  std::map<std::size_t, End> ends_;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> near_;  // plunges by cell, in their order
  std::vector<std::size_t> long_;                                     // those that lean over many
};

}  // namespace polypod::machining
