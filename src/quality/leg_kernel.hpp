// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Machines on six legs, many directions at once: the inner loop of surveys.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "lanes.hpp"
#include "polypod/kinematics/families.hpp"
#include "polypod/quality/survey.hpp"

namespace polypod::quality {

/// The legs of machines whose family says them (leg_layout); nothing of others.
std::optional<machine::LegLayout> six_legs_of(const AnyMachine& machine);

/// How far each leg may be off, or is: dl_i = length + base . w - platform . R^T w + joint (w . u on rails) + direction
/// . w q_i. As tolerances the absolute values add up; of a ball the radius counts.
struct LegSizes {
  double length = 0, base_ball = 0, platform_ball = 0, joint = 0;
  Vec3 base = Vec3::Zero(), platform = Vec3::Zero(), direction = Vec3::Zero();
};

/// What the kernel works out at each pose: three numbers.
enum class LegQuestion {
  dexterity,  ///< condition, sigma_min, |det| of S (kinematics::dexterity)
  known,      ///< lengths of the tool's error: position, orientation, 0
  tolerance,  ///< the farthest of the 64 vertices: position, orientation, 0
};

class LegKernel {
 public:
  LegKernel(const machine::LegLayout& machine, const std::vector<Mat3>& orientations);

  /// The elements as sizes of legs; false if one acts on more than a leg (the tool's length).
  bool set_sizes(const AnyMachine& machine, const std::vector<Sized>& sizes, Region region);
  /// The characteristic length, m; 0: mean distance of the platform joints from the tip.
  void set_length(double length);
  [[nodiscard]] double length() const { return length_; }

  /// Means over the directions and the worst of each of the three numbers (`largest[k]`: the largest is the worst, else
  /// the least) and where.
  using Answer = PointValues;
  [[nodiscard]] Answer ask(LegQuestion question, const Vec3& p) const;

  /// Four directions.
  struct alignas(sizeof(Lanes)) Group {
    Lanes R[3][3];    ///< orientations
    Lanes arm[6][3];  ///< R e_i
  };

 private:
  friend struct LegKernelBody;
  machine::LegLayout machine_;
  std::array<LegSizes, 6> sizes_{};
  std::vector<Group> groups_;
  std::size_t directions_ = 0;
  double length_ = 0;
};

}  // namespace polypod::quality
