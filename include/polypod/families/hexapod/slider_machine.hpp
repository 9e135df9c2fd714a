// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Hexapods whose six legs of constant length stand on sliders on straight rails (JEL 3.2).
#pragma once

#include <algorithm>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/families/hexapod/machine.hpp"

namespace polypod::machine {

/// Three pairs of parallel rails at 120 deg (JEL Figure 8.14).
struct PairedRails {
  double outer_radius = 0;  ///< m, of the outer ends, which lie at z = 0
  double inner_radius = 0;  ///< m, of the inner ends
  double inner_height = 0;  ///< m, of the inner ends; negative: rails that fall inwards
  double spacing = 0;       ///< m, between the two rails of a pair
};

/// A slider hexapod (hexaglide): |t + R b_i - (a_i + q_i u_i)| = l + offset_i, 0 <= q_i <= rail length (JEL (3.11) to
/// (3.13)). Joint coordinates: q_i, the travel of slider i from the outer end of its rail, m. T as for StrutHexapod.
struct SliderHexapod : TipLimits {
  static constexpr std::string_view kFamily = "slider-hexapod";
  /// Each end of a leg has an error of its joint and one of what the joint is fixed to.
  static constexpr bool kAttachments = true;

  std::string name;
  std::string description;
  SixPoints rail_outer{};                       ///< a_i, outer ends in M, m
  SixPoints rail_inner{};                       ///< inner ends in M, m
  SixPoints platform_joint{};                   ///< b_i in P, m
  std::optional<PairedRails> rail_pairs;        ///< how the rails were given, if not point by point
  std::optional<PairedCircle> platform_circle;  ///< the same for the platform
  double leg_length = 0;                        ///< l, m
  SixNumbers leg_offset{};                      ///< m, by how much each leg is longer than l
  double leg_diameter = 0;                      ///< m, 0: thin legs that may cross
  bool base_check = false;                ///< legs may not go behind the planes of neighbouring rails (JEL (4.17))
  double tool_length = 0;                 ///< m, along z_P
  JointLimit joint;                       ///< of every joint at base and platform
  JointSeats base_seats, platform_seats;  ///< with JointLimitKind::cone only
  /// Without a given height: where the sliders stand at `home_slider` of the rail from its outer end.
  HexapodHome home;
  double home_slider = kHomeSlider;
  double compliance = 0;        ///< m/N of a slider along its rail, the mean of the six
  SixNumbers leg_compliance{};  ///< m/N of each
  Provenance provenance;

  /// The home of JEL's tables (found from them; the source does not print it).
  static constexpr double kHomeSlider = 0.58;

  /// m, of leg i
  [[nodiscard]] double length_of_leg(int i) const { return leg_length + leg_offset[static_cast<std::size_t>(i)]; }
  [[nodiscard]] double longest_leg() const {
    return leg_length + *std::max_element(leg_offset.begin(), leg_offset.end());
  }

  SixPoints rail_direction{};                      ///< u_i, unit, from the outer to the inner end
  std::array<double, kLegs> rail_length{};         ///< m
  std::array<std::array<Vec3, 2>, kLegs> guard{};  ///< unit normals of the two planes of each rail (4.17), or zero

  /// Reads the keys of a slider hexapod (docs/machine-files.md). Errors: MA120 to MA139 and those of config.
  static Result<SliderHexapod> from(const config::Table& table);
};

/// The parameters of the kinematics: leg.length[i], base.joint[i].x, .y, .z (the outer end; moves the whole rail),
/// rail.direction[i].x, .y, .z (of the unit vector u_i), platform.joint[i].x, .y, .z and tool.length: 61, leg by leg.
std::vector<Parameter> parameters(const SliderHexapod& m);
/// Their values alone.
std::vector<double> parameter_values(const SliderHexapod& m);

/// The machine with other values of its parameters, in the order of `parameters`; directions are made unit vectors, and
/// rails keep their lengths. Lists take the place of rail pairs and circles where they moved; a home that is not given
/// is found anew. Errors: those of slider_hexapod_from.
Result<SliderHexapod> with_parameters(const SliderHexapod& m, std::span<const double> p);

/// What a designer changes: the keys of the machine file with their values.
std::vector<Parameter> settings(const SliderHexapod& m);

std::string to_toml(const SliderHexapod& m);

}  // namespace polypod::machine
