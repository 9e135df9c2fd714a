// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a machine with certain parameters lets an instrument see, and how that changes with each unknown. Shared by
// calibration and the choice of poses.
#pragma once

#include <Eigen/Dense>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "polypod/calibration/calibrate.hpp"
#include "polypod/kinematics/by_parameters.hpp"
#include "polypod/kinematics/closure_slots.hpp"

namespace polypod::calibration {

/// The unknowns beside the machine's parameters, in one vector with them:
///   [ places of contacts, 3 each | X_SM: translation, rotation vector | X_TR: the same | k | parameters p ],
/// the instrument showing 1 + k times the true lengths, about the origin of its frame S.
struct Layout {
  std::map<std::string, int> contact;  ///< text of the column -> index of its first unknown
  int frame = 0, target = 0, scale = 0, parameters = 0, count = 0;
  /// Which parameters can share a derivative; without it each has one of its own.
  std::optional<kinematics::ParameterSlots> slots{};
};
Layout layout_of(const std::vector<Measurement>& rows, std::size_t parameter_count);

/// Which parameters the options ask for. Errors: CA114.
Result<std::vector<bool>> chosen_parameters(const std::vector<machine::Parameter>& all,
                                            const CalibrationOptions& options);
/// The columns of the unknowns that the options ask for, in the order in which they are told; `turns`: angles were
/// measured, so that the target's own orientation shows.
std::vector<int> wanted_unknowns(const Layout& layout, const std::vector<bool>& chosen,
                                 const CalibrationOptions& options, bool turns);
/// The name and unit of one column.
machine::Parameter unknown_of(const AnyMachine& machine, const Layout& layout, int column);

/// How exactly the instrument measures.
struct Noise {
  double position = 0;  ///< m, of each coordinate, distance or reading
  double angle = 0;     ///< rad, of each angle
};

inline int equation_count(Kind kind) {
  switch (kind) {
    case Kind::axis:
      return 5;
    case Kind::pose:
      return 6;
    case Kind::point:
    case Kind::contact:
      return 3;
    case Kind::distance:
    case Kind::gauge:
      break;
  }
  return 1;
}

/// What a search knows of one row from the place where it looked before: it comes back with parameters that hardly
/// changed.
struct Followed {
  Pose X_MT;
  std::optional<kinematics::ClosureSolver> by_pose;  ///< F_X there, or near
};

/// Equations of one row, divided by their noise: (computed - measured) / sigma, and their derivatives by all unknowns.
struct Equations {
  Eigen::VectorXd r;
  Eigen::MatrixXd J;             ///< equations x unknowns
  Eigen::VectorXd sigma;         ///< m or rad
  int lengths = 0;               ///< the first equations are lengths, the rest angles
  bool by_parameters = true;     ///< else their columns of J stay 0
  Followed* followed = nullptr;  ///< of this row, if a search follows it
};

/// A pose from its translation and rotation vector.
Pose pose_from(const double* six);

/// What to do where the machine does not assemble with the parameters of a trial step.
enum class Lost {
  fail,        ///< say so
  first_order  ///< one step of Newton from the seed: finite and smooth, so that a search can go on and come back
};

/// The equations of a row at the unknowns x, with the pose of the machine found by Newton from `seed_MT` (the nominal
/// one). With `by_unknowns` also J, from dX = -A^-1 F_p dp. False where the machine does not assemble and that counts.
bool equations_of(const AnyMachine& machine, const Measurement& row, const Pose& seed_MT, const Layout& layout,
                  const Eigen::VectorXd& x, const Noise& noise, bool by_unknowns, Equations& out,
                  Lost lost = Lost::fail);

/// The values of the parameters' rules at the unknowns x, and the derivatives by all unknowns (rules x unknowns).
void rules_at(const AnyMachine& machine, const Layout& layout, const Eigen::VectorXd& x, Eigen::VectorXd& r,
              Eigen::MatrixXd& J);

/// The machine's own pose of a row's joints as the drawing has it; nothing where it does not assemble.
std::optional<Pose> pose_of_row(const AnyMachine& machine, const Measurement& row);
kinematics::ParameterSlots parameter_slots_of(const AnyMachine& machine, const Pose& X_MT, const JointVector& q);

/// What the equations ask of a machine of any family, at the parameters p (closures.cpp; each a visit).
using Numbers = std::span<const double>;
kinematics::ClosureVector closure_of(const AnyMachine& machine, const Pose& X_MT, Numbers q, Numbers p);
kinematics::ClosureMatrix closure_by_pose_of(const AnyMachine& machine, const Pose& X_MT, Numbers q, Numbers p);
kinematics::NewtonResult forward_of(const AnyMachine& machine, Numbers q, Numbers p, const Pose& seed_MT);
/// F_p, the parameters that can share a derivative taken together where `slots` are given.
Eigen::MatrixXd closure_by_parameters_of(const AnyMachine& machine, const Pose& X_MT, Numbers q, Numbers p,
                                         const std::optional<kinematics::ParameterSlots>& slots);
using kinematics::twist_by_parameters;

/// Trends and neighbours that are alike among the residuals, in the order of the rows or of their times; repeats at one
/// pose one after another are one point. `poses`: the pose of each row.
Drift drift_in(const std::vector<Measurement>& rows, const std::vector<std::size_t>& poses,
               const std::vector<RowResidual>& residuals);

/// What a calibration whose scores, noise and covariance are known is worth.
Verdict judged(const AnyMachine& nominal, const std::vector<Measurement>& rows, const Calibration& c,
               const CalibrationOptions& options);

/// A size of the machine, m: the largest of its lengths.
double size_of(const AnyMachine& machine);

/// Where the unknowns begin (the nominal parameters, the first guesses of frame and target, contacts at 0) and how far
/// each must be told: 1 % of the machine's size, or 0.01 rad.
struct Start {
  Eigen::VectorXd x, scale;
};
Start start_of(const AnyMachine& machine, const Layout& layout, const Pose& X_SM, const Pose& X_TR);

/// Which unknowns the equations can tell from those before them, in the order of the columns of J: unknown j is held
/// where a change by `scale[j]`, less the best that the others before it can do to look alike, stays below the noise
/// (one standard deviation over all equations) or below 1e-8 of its own effect. `ties[j]` of a held unknown are the
/// factors with which the others before it act like it: J_j = sum ties_k J_k.
struct Identifiability {
  std::vector<int> kept;                ///< columns, rising
  std::map<int, Eigen::VectorXd> ties;  ///< of every held column, over all columns
  double condition = 0;                 ///< of the kept columns, each scaled to unit length
};
Identifiability identifiable(const Eigen::MatrixXd& J, const std::vector<int>& order, const Eigen::VectorXd& scale);

}  // namespace polypod::calibration
