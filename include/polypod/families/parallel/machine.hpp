// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Parallel machines of legs: any number of struts, rails, cranks and passive rods, and of constraints, from a file.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/machine/common.hpp"

namespace polypod::machine {

/// What drives a leg.
enum class LegDrive : std::uint8_t {
  strut,  ///< its length: q
  rail,   ///< a slider at base + q rail, with a rod to the platform
  crank,  ///< an arm whose end is base + arm (cos q zero + sin q axis x zero), with a rod to the platform
  none,   ///< nothing: a rod of constant length
};

/// The circle on which a leg ends, in P: its joint glides to the point nearest to the base joint's half plane, so that
/// the leg's length is sqrt((rho - radius)^2 + h^2), rho the distance of the base joint from the axis and h its height
/// over the plane of the circle.
struct LegRing {
  Vec3 center = Vec3::Zero();  ///< m
  Vec3 axis = Vec3::UnitZ();   ///< unit
  double radius = 0;           ///< m
};

struct ParallelLeg {
  LegDrive drive = LegDrive::strut;
  Vec3 base = Vec3::Zero();      ///< in M, m
  Vec3 platform = Vec3::Zero();  ///< in P, m; with a ring unused
  /// From the joint to the end of the leg in M, m: a part of the platform that does not turn with it, as the two bars
  /// of a Par4 platform that its arms hold parallel.
  Vec3 still = Vec3::Zero();
  std::optional<LegRing> ring;  ///< struts and passive rods only
  Vec3 rail = Vec3::UnitX();    ///< unit
  Vec3 axis = Vec3::UnitY();    ///< unit, of the crank
  Vec3 zero = Vec3::UnitZ();    ///< unit, square to the axis: where the arm points at q = 0
  double arm = 0;               ///< m
  double rod = 0;               ///< m; of struts the length less the reading, which a calibration finds
  double zero_offset = 0;       ///< rad or m, rails and cranks: where the drive is less its reading
  JointRange range;             ///< rad or m; of struts the range of the length
  double speed = 0;             ///< the fastest that the drive goes, rad/s or m/s; 0: not said
  double compliance = 0;        ///< m/N along the line of the leg
  double reference = 1;         ///< m, the length at home: what the leg's equation is divided by

  [[nodiscard]] bool driven() const { return drive != LegDrive::none; }
  /// Whether a pose leaves the drive two positions.
  [[nodiscard]] bool two_roots() const { return drive == LegDrive::rail || drive == LegDrive::crank; }
};

enum class ConstraintKind : std::uint8_t {
  plane,           ///< 1 equation: the point `platform` of P stays in the plane of M through `base` across `base_axis`
  platform_plane,  ///< 1: the point `base` of M stays in the plane of P through `platform` across `platform_axis`
  line,            ///< 2: the line of P through `platform` along `platform_axis` passes through the point `base` of M
  square,          ///< 1: `base_axis` of M stays square to `platform_axis` of P
  orientation,     ///< 3: as at home
};
struct PlatformConstraint {
  ConstraintKind kind = ConstraintKind::orientation;
  Vec3 base = Vec3::Zero(), platform = Vec3::Zero();              ///< m
  Vec3 base_axis = Vec3::UnitZ(), platform_axis = Vec3::UnitZ();  ///< unit

  /// What of these the kind has.
  [[nodiscard]] bool has_points() const { return kind < ConstraintKind::square; }
  [[nodiscard]] bool has_base_axis() const { return kind == ConstraintKind::plane || kind == ConstraintKind::square; }
  [[nodiscard]] bool has_platform_axis() const {
    return kind != ConstraintKind::plane && kind != ConstraintKind::orientation;
  }
};

/// A machine of legs. The joints are the drives in the order of their legs. The task says which coordinates a pose
/// prescribes; the others follow from the constraints and passive rods, in the assembly mode that is reached from home
/// without a jump. X_MT is the tool tip, with the axes of P.
struct Parallel : TipLimits {
  static constexpr std::string_view kFamily = "parallel";
  /// Each end of a leg has an error of its joint and one of what the joint is fixed to.
  static constexpr bool kAttachments = true;

  std::string name;
  std::string description;
  Task task;
  Vec3 tool = Vec3::Zero();  ///< tool tip in P, m
  std::vector<ParallelLeg> legs;
  std::vector<PlatformConstraint> constraints;
  bool hangs = false;              ///< the base is above the work, z of M points down
  Vec6 home_given = Vec6::Zero();  ///< x, y, z, A, B, C as the file has them, m and rad
  Provenance provenance;

  // What the reader finds.
  Pose home;                        ///< X_MT
  Vec3 home_angles = Vec3::Zero();  ///< A, B, C there, rad
  bool idle_turn = false;           ///< all legs end on rings round one axis along z of P: C is kept as at home
  double size = 1;                  ///< m, the mean distance of the platform joints from the tool tip
  std::vector<int> driven;          ///< legs with a drive
  /// Of each leg with two roots whether the machine takes the higher one where both are in its range: that at home
  /// which is in the range, of two such the smaller travel of a slider, the end of a crank that is farther from the
  /// tool tip.
  std::vector<bool> takes_high;

  static Result<Parallel> from(const config::Table& table);
};

/// The parameters of the kinematics, leg by leg: leg.length[i] (struts: the zero offset; else the rod),
/// base.joint[i].x, .y, .z, platform.joint[i].x, .y, .z (on a ring: its centre), and for rings ring.axis[i].x ...,
/// ring.radius[i], for rails rail.direction[i].x ..., drive.zero[i], for cranks arm.axis[i].x ..., arm.zero[i].x ...,
/// arm.length[i], drive.zero[i]; then constraint by constraint constraint.platform[k], constraint.base[k],
/// constraint.normal[k], constraint.axis[k] as far as it has them; then tool.x, .y, .z.
std::vector<Parameter> parameters(const Parallel& m);
/// What a designer changes beside the parameters: ranges of the drives, limits of the tool tip, home.
std::vector<Parameter> settings(const Parallel& m);
std::string to_toml(const Parallel& m);
/// The machine with other values of `parameters`. Errors: those of the reader.
Result<Parallel> with_parameters(const Parallel& m, std::span<const double> p);

}  // namespace polypod::machine
