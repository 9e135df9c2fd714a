// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `predict` says of the vibration at tooth passing: options, JSON and text.
#pragma once

#include <optional>
#include <string>

#include "command.hpp"
#include "polypod/machining/vibration.hpp"

namespace polypod::app {

/// Of one prediction.
class VibrationQuestion {
 public:
  std::string dynamics;  ///< --dynamics
  bool counts = false;   ///< --vibration

  void declare(Arguments& a);
  /// The masses of the job's machine. Errors: AP214 and those of the table; AP280 where --vibration asks to count what
  /// is not judged.
  Status prepare(const machining::Job& job, const gcode::Interpretation& interpretation, const Context& context);
  /// After the prediction, where there are masses. Errors: those of machining::cut_points and vibration_of.
  Status answer(const machining::Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                const machining::Prediction& prediction, machining::PredictOptions options, const Context& context);

  /// Whether the prediction is within the tolerance as far as the vibration is asked to count.
  [[nodiscard]] bool within(const machining::Job& job, const machining::Prediction& prediction) const;
  /// Why the vibration alone makes it a no, as a sentence; empty where it does not.
  [[nodiscard]] std::string against(const machining::Job& job, const machining::Prediction& prediction) const;
  void add_to(Json& document, const machining::Prediction& prediction) const;
  void print(const machining::Job& job, const machining::Prediction& prediction) const;

 private:
  std::optional<motion::Dynamics> masses_;
  std::optional<double> damping_;
  std::optional<machining::ProgramVibration> found_;
  std::string why_not_;
};

}  // namespace polypod::app
