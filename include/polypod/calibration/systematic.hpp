// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Systematic parts of a measurement (GUM type B): what all readings share, as certificates and experience state it.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/config.hpp"
#include "polypod/core/error.hpp"

namespace polypod::calibration {

/// What one unknown error b of a whole measurement is.
enum class Quantity {
  scale,        ///< the instrument shows 1 + b times the true lengths, about the origin of its frame
  offset,       ///< b is added to each coordinate of the target (three unknowns), or to each distance and reading, m
  target,       ///< the target sits beside its stated place on the tool (three unknowns), m
  temperature,  ///< machine (or instrument) is b kelvin away from the temperature that the readings were reduced to
  force_gain,   ///< the force is 1 + b times the stated one (identification of compliances)
};
/// "scale", "force_gain", ...: as files call it.
std::string_view name_of(Quantity quantity);

/// How b is distributed, and what its half width is divided by (GUM 4.3.7, 4.3.9; the arcsine distribution of what
/// oscillates).
enum class Distribution { normal, rectangular, triangular, u_shaped };
std::string_view name_of(Distribution distribution);
/// sqrt 3, sqrt 6, sqrt 2; 1 for normal, whose size is a standard deviation.
double divisor_of(Distribution distribution);

struct Systematic {
  Quantity quantity = Quantity::scale;
  Distribution distribution = Distribution::normal;
  double size = 0;         ///< as stated: half width, standard deviation or U; 1, m or K
  double divisor = 1;      ///< standard uncertainty = size / divisor
  double expansion = 0;    ///< temperature: 1/K
  bool of_machine = true;  ///< temperature: of the machine about the origin of M; else of the instrument, as a scale
  int axis = -1;           ///< offset, target: 0 to 2 for this coordinate alone; -1: all three
  std::string source;      ///< where the size is from; may be empty
  Place place{};

  /// Of b: 1, m or K.
  [[nodiscard]] double standard_uncertainty() const { return size / divisor; }
};
/// The unit in which a person states b of this quantity, and its value there: "um/m", "um", "K", "%".
std::string unit_of(Quantity quantity);
double for_user(Quantity quantity, double b);

/// Reads the tables [[systematic]]:
///   quantity = "scale"            # offset, target, temperature, force_gain
///   half_width_um_per_m = 5       # or standard_..., or expanded_... with k (2 where it is not given)
///   distribution = "rectangular"  # of a half width: rectangular (default), triangular, u-shaped
///   source = "certificate 123"
/// The unit stands in the key: um_per_m or percent for scale, um for offset and target, K for temperature, percent for
/// force_gain. Temperature has expansion_um_per_m_K and of = "machine" or "instrument"; offset and target may have
/// axis = "x". Errors: CA150 (unknown quantity, distribution or axis, no size or two of them, a half width said to be
/// normal), CF102 to CF104.
Result<std::vector<Systematic>> read_systematic(const config::Table& table);

/// One unknown of a systematic part, and what it does to the result.
struct SystematicEffect {
  std::size_t part = 0;             ///< index into CalibrationOptions::systematic
  std::string component;            ///< "x", "y", "z", "reading"; empty where the part has one unknown alone
  double standard_uncertainty = 0;  ///< of b
  Eigen::VectorXd by_parameter{};   ///< change of all parameters of the machine by b, SI
};

}  // namespace polypod::calibration
