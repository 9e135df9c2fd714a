// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What the weight of a machine does to the path of its tool.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "polypod/machining/predict.hpp"
#include "polypod/motion/dynamics.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {

/// Deflection of the tool tip by the weight of the machine (motion::weight_twist) against that at the origin of the
/// workpiece, where the part was touched off with the same deflected machine: what does not change over the part is in
/// the offset already. The tool stands as in the cuts of the job. Between the corners of cells of 5 mm it is
/// interpolated: off by (5 mm / reach)^2 / 8 of it, some 1e-5. Not for several threads at once.
class WeightDeflection {
 public:
  /// Errors: MC212 the machine does not reach the origin of the workpiece with the tool as in the cuts; AP105 no
  /// compliances.
  static Result<WeightDeflection> of(const Job& job, std::shared_ptr<const motion::Dynamics> weights);

  /// m, in W, at a point of W; nothing where the machine does not reach it.
  std::optional<Vec3> at(const Vec3& p_W);
  /// All of it at the origin, m, in W: how far the weight deflects the tip there.
  [[nodiscard]] const Vec3& at_origin() const { return origin_; }

 private:
  explicit WeightDeflection(const Job& job, std::shared_ptr<const motion::Dynamics> weights);
  std::optional<Vec3> whole(const Vec3& p_W);
  const std::optional<Vec3>& at_corner(const std::array<int, 3>& corner);

  const machine::AnyMachine* machine_;
  std::shared_ptr<const motion::Dynamics> weights_;
  Pose X_MW_;
  Mat3 R_MT_;
  std::unique_ptr<statics::Probe> probe_;
  Vec3 origin_ = Vec3::Zero();
  std::map<std::array<int, 3>, std::optional<Vec3>> corners_;
};

/// The size of it on the cuts of a program, at Prediction::few.
struct WeightOnCuts {
  double largest = 0;         ///< m, against that at the origin of the workpiece
  Vec3 place = Vec3::Zero();  ///< where, in W
  double at_origin = 0;       ///< m, all of it there
};
Result<WeightOnCuts> weight_on_cuts(const Job& job, const Prediction& prediction,
                                    const std::shared_ptr<const motion::Dynamics>& weights);

}  // namespace polypod::machining
