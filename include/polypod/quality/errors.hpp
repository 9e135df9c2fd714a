// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What errors and tolerances of a machine's elements do to its tool (JEL chapter 5).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "polypod/kinematics/concept.hpp"
#include "polypod/quality/elements.hpp"

namespace polypod::quality {

using kinematics::JointVector;

/// The tool's error to first order, dX = -A^-1 (F_p dp + F_q dq), from the closure F(X, q, p) = 0 of any family (JEL
/// (5.13), (5.18) for hexapods): [translation of the tip; rotation vector] in M, m and rad, where the joints stand at q
/// and the elements are off by `errors`. Cost: a pass of the closure for each six parameters, 3 to 10 us.
Vec6 known_error(const AnyMachine& machine, const Pose& X_MT, const JointVector& q, const std::vector<Sized>& errors);

/// The size of its angular part: of a machine of Task::axis without the turn about the tool axis. rad.
double orientation_error(const AnyMachine& machine, const Pose& X_MT, const Vec6& error);

/// The same exactly: the erroneous machine's closure is solved by Newton from X. Empty where Newton does not converge
/// (the erroneous machine has no pose near X: singular). The gap to known_error falls with the square of the errors.
std::optional<Vec6> known_error_exact(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                                      const std::vector<Sized>& errors);

enum class Method {
  exact,   ///< the farthest vertex of the zonotope (zonotope.hpp)
  search,  ///< the coordinate search of JEL 5.3: never above exact
};
/// Which points around its nominal place a joint with a tolerance d may take.
enum class Region {
  box,     ///< each coordinate within +-d
  sphere,  ///< within d of it
};

struct ToleranceOptions {
  Method method = Method::exact;
  Region region = Region::box;
};

struct WorstCase {
  double position = 0;     ///< largest error of the tip, m
  double orientation = 0;  ///< largest error of the orientation, rad (length of the rotation vector); not at once
  Vec6 position_error = Vec6::Zero();     ///< the tool's error where `position` is largest
  Vec6 orientation_error = Vec6::Zero();  ///< and where `orientation` is largest
  /// Each element's part in both; the parts add up to them exactly.
  struct Share {
    int element = 0;
    double position = 0, orientation = 0;
  };
  std::vector<Share> shares;
};

/// The largest error that the tolerances allow, to first order. The image of the tolerance box under dp -> dX is a
/// zonotope in each of the two spaces; its farthest vertex is found exactly. For a machine of Task::axis the turn about
/// the tool axis does not count as an error of orientation. Spheres: points whose three coordinates act along one
/// direction, as all joints of hexapods do; QU102 for others. Cost: that of known_error plus that of farthest_vertex.
Result<WorstCase> worst_case(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                             const std::vector<Sized>& tolerances, const ToleranceOptions& options = {});

struct Plan;
/// worst_case at many poses: what does not depend on the pose is worked out once. The machine must outlive it. Cost: an
/// arm's 24 Denavit-Hartenberg tolerances 12 us a pose.
class WorstCaseAt {
 public:
  WorstCaseAt(const AnyMachine& machine, const std::vector<Sized>& tolerances, const ToleranceOptions& options = {});
  Result<WorstCase> operator()(const Pose& X_MT, const JointVector& q) const;

 private:
  const AnyMachine* machine_;
  ToleranceOptions options_;
  std::shared_ptr<const Plan> plan_;
};

enum class Distribution {
  uniform,     ///< over +-d
  normal,      ///< d is three standard deviations
  triangular,  ///< over +-d with its peak at 0
};

struct SpreadOptions {
  Distribution distribution = Distribution::uniform;
  int samples = 20'000;        ///< 100 to 10^7
  double confidence = 0.9973;  ///< the share of machines whose error is below the quantile, 0.5 to 0.9999
  std::uint64_t seed = 1;
};

struct Spread {
  /// Root sum square: the standard deviation along the worst direction, tolerances taken as three of theirs, times
  /// three. m and rad.
  double rss_position = 0, rss_orientation = 0;
  /// Monte Carlo: the mean, and the quantile at `confidence` with the bounds that hold it with 95 % (order statistics).
  struct Sampled {
    double mean = 0, quantile = 0, quantile_low = 0, quantile_high = 0;
  };
  Sampled position, orientation;
};

/// How the error is spread when the elements scatter independently. Coordinates of a point scatter each for itself.
/// The same seed gives the same numbers. Errors: QU103 (options out of range). Cost: 50 ns a sample and element.
Result<Spread> spread(const AnyMachine& machine, const Pose& X_MT, const JointVector& q,
                      const std::vector<Sized>& tolerances, const SpreadOptions& options = {});

}  // namespace polypod::quality
