// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Where machines, and what they carry, come to on the ways of their tasks.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "polypod/cell/layout.hpp"

namespace polypod::cell {

/// A slot between which, or into whose container, a task works.
struct Moved {
  enum class How { takes, puts, fills } how = How::takes;
  int spot = -1;  ///< below 0: none
  std::size_t slot = 0;
  bool stands = false;  ///< the container is there, and the tool may touch it; else it is in the hand
};

/// One position of a machine on its way.
struct Position {
  std::vector<Capsule> links;
  Vec3 middle = Vec3::Zero();
  double radius = 0;  ///< of a ball about `middle` that holds all links
  std::string zone;   ///< that it holds there
  std::size_t task = 0;
  std::array<Moved, 3> moved;
  int near_spot = -1, near_conveyor = -1;  ///< where the tool takes and puts just now: it may touch their bodies
};

struct Positions {
  std::vector<std::vector<Position>> of;  ///< each machine
  bool complete = true;  ///< false: some were left out: beyond kMost, of many slots, or where no way was found
  static constexpr std::size_t kMost = 100'000;
};
Positions positions(const Cell& cell, const Motions& motions);

}  // namespace polypod::cell
