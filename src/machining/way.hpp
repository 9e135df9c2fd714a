// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Judging what was commanded against what was programmed: the same for the program as it is and for the corrected one.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include "polypod/machining/accept.hpp"
#include "polypod/machining/predict.hpp"

namespace polypod::machining {

/// What is commanded, and which programmed move each of it stands for.
struct Way {
  const gcode::Program* lines = nullptr;                ///< whose lines the answer names
  const LongVector<gcode::Move>* programmed = nullptr;  ///< of that program
  LongVector<PassMove> moves;                           ///< commanded; empty: all moves as they are programmed
  LongVector<int> source;                               ///< the programmed move of each; empty: its own number

  [[nodiscard]] std::size_t source_of(std::size_t c) const {
    return source.empty() ? c : static_cast<std::size_t>(source[c]);
  }
  [[nodiscard]] PassMoves commanded() const { return moves.empty() ? PassMoves(*programmed) : PassMoves(moves); }
};

/// Whether a move goes down along the tool more steeply than 60 deg. What the thrust along the axis holds back on its
/// way is no error of the part, and a command beyond the end would gouge the floor as soon as the thrust goes: the part
/// along the way is not corrected, and counts only at the end (see Plunge). `axis`: of the tool, in W
/// (ToolFrame::axis).
bool is_plunge(const gcode::Move& move, const Vec3& axis);

/// The dwells (G4) between a move and the next one that goes anywhere, while the spindle turns, s.
struct Dwell {
  double certain = 0;
  double possible = 0;  ///< with those of blocks that a switch may skip
};
Dwell dwell_after(const LongVector<gcode::Move>& moves, const gcode::Program& lines, std::size_t i);

/// What is to be corrected of a deflection on a move: on a plunge not what is held back along it.
Vec3 to_correct(const gcode::Move& move, const Vec3& deflection, const Vec3& axis);

/// Every move commanded as it is programmed.
Way way_as_programmed(const gcode::Program& program, const LongVector<gcode::Move>& moves);

/// Sends the deflected cutter along `way.moves`, which are those of `program`, and judges it against the programmed
/// moves: every point against its move, the first and the last point of a move against its ends. The stock of the job
/// is cut in `scratch`, whose memory serves again in the next pass. `besides` is added to the deflection of each
/// sample, asked for in their order, before it is judged. Errors: those of run_pass.
Result<Prediction> predict_way(const Job& job, const gcode::Program& program, const Way& way,
                               const PredictOptions& options, cutting::Stock& scratch,
                               const std::function<Vec3(const Sample&)>& besides = {});
Result<Prediction> predict_way(const Job& job, const gcode::Program& program, const Way& way,
                               const PredictOptions& options);

/// `predict`, whose pass cuts the stock of the job in `scratch`: of many predictions one after the other the memory
/// serves again.
Result<Prediction> predict_in(const Job& job, const gcode::Program& program,
                              const gcode::Interpretation& interpretation, const PredictOptions& options,
                              cutting::Stock& scratch);

/// `predict` for a program that `accept` has taken.
Result<Prediction> predict_accepted(const Job& job, const gcode::Program& program,
                                    const gcode::Interpretation& interpretation, const PredictOptions& options);

/// The material with its coefficients changed by one of its variations (Material::spread).
cutting::Material varied(const cutting::Material& material, const std::array<double, 6>& by);

/// A program in a position of block delete that is not the job's, as `accept` takes it; one that cuts nothing in this
/// position is taken as it is where the machine can follow it. Errors: those of accept but MC301 and MC302, each with
/// the position.
class OtherPosition {
 public:
  static Result<OtherPosition> of(const Job& job, const gcode::Program& program,
                                  const gcode::Interpretation& interpretation,
                                  const std::function<bool(double)>& progress);
  [[nodiscard]] const LongVector<gcode::Move>& moves() const {
    return accepted_ ? accepted_->interpretation().moves : given_->moves;
  }

 private:
  const gcode::Interpretation* given_ = nullptr;
  std::optional<Accepted> accepted_;
};

/// Whether an error says that nothing is cut.
bool says_that_nothing_is_cut(const Error& error);

}  // namespace polypod::machining
