// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `predict` and `correct` say of the machine's own weight: option, JSON and text.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "command.hpp"
#include "polypod/machining/weights.hpp"

namespace polypod::app {

class WeightQuestion {
 public:
  bool counts = false;  ///< --gravity

  void declare(Arguments& a);
  /// The masses of the job's machine, of the file `dynamics` if it is named; where the weight counts, the job gets
  /// them. Errors: AP214 and those of the table; AP283 where --gravity asks to count what is not known.
  Status prepare(machining::Job& job, const std::string& dynamics, const Context& context);
  /// After the prediction, where there are masses. Errors: those of machining::weight_on_cuts where the weight counts.
  Status answer(const machining::Job& job, const machining::Prediction& prediction);

  /// For commands that predict at many places: a line of whether it counts; nothing where there are no masses.
  [[nodiscard]] std::optional<std::string> note() const;
  /// A sentence for a page; empty where there are no masses.
  [[nodiscard]] std::string in_words() const;
  void add_to(Json& document) const;
  /// Nothing where there are no masses.
  void print() const;

 private:
  [[nodiscard]] std::string said() const;

  std::shared_ptr<const motion::Dynamics> masses_;
  std::optional<machining::WeightOnCuts> found_;
  std::string why_not_;
  bool tilted_ = false;
};

}  // namespace polypod::app
