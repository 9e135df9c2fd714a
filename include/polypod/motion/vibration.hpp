// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How a machine that stands with its drives locked vibrates under a periodic force on its tool.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <optional>
#include <vector>

#include "polypod/motion/dynamics.hpp"

namespace polypod::motion {

/// A complex amplitude: what it stands for is the real part of it times exp(i w t).
using Phasor = Eigen::Vector3cd;

/// A mode of the machine on the compliances of its elements, its drives locked.
struct Mode {
  double frequency = 0;       ///< Hz, of the undamped machine
  Vec6 shape = Vec6::Zero();  ///< what the tool does, [m; rad] in M, for one unit of the mass-normalised coordinate
                              ///< (phi^T M phi = 1): m / (m sqrt(kg)), rad / (m sqrt(kg))
};

/// Modes of the machine at one pose.
struct ModalModel {
  Pose X_MT;
  std::vector<Mode> modes;  ///< by rising frequency
  /// Compliance of the tool [m; rad] / [N; Nm] in M by what moves no mass: it follows the force at any frequency.
  Mat6 rest = Mat6::Zero();

  /// Of all modes and of the rest, at frequency 0: the static compliance J C J^T.
  [[nodiscard]] Mat6 compliance() const;
};

/// The damping ratio of every mode that the table `dynamics` of the file at this path gives (`damping_ratio`, 0 .. 1),
/// if it does. Errors: those of config.
Result<std::optional<double>> read_damping(const std::string& path);

/// The modes: (K - w^2 M) phi = 0 with K the inverse of the compliances of the elements (kinematics::elements) and M by
/// what the elements move, both in the coordinates by which the elements deflect; M = 0 for those that move no mass,
/// and for locked joints of an arm. What turns with a drive takes no part, and what is rigid in the model (links, base,
/// spindle and tool) is rigid here. No modes where the machine has no compliances or no masses. Cost: 0.1 ms.
ModalModel modal_model(const AnyMachine& machine, const Dynamics& dynamics, const Pose& X, const JointVector& q);

/// A resonance: a force of this harmonic acts on an undamped mode at its own frequency, and there is no steady state.
struct Resonance {
  int mode = 0;      ///< its number in ModalModel::modes
  int harmonic = 1;  ///< of the force
};

/// The displacement of the tool tip by a force on it at this frequency (Hz), m/N, in M:
///   H(w) = R + sum over modes r of phi_r phi_r^T / (w_r^2 - w^2 + 2 i zeta w_r w),
/// phi the linear part of the shapes, R of `rest`, zeta the damping ratio of every mode (0 <= zeta < 1). Textbook
/// formula of modal analysis (as in Altintas, Manufacturing Automation; Schmitz and Smith, Machining Dynamics). Nothing
/// where zeta is 0 and the frequency is within a millionth of one at which a mode moves the tip: no steady state.
std::optional<Eigen::Matrix3cd> receptance(const ModalModel& model, double damping, double frequency);

/// A force of period T: F(t) = mean + sum over k = 1 .. of the real part of harmonics[k - 1] exp(2 pi i k t / T), N.
struct PeriodicForce {
  Vec3 mean = Vec3::Zero();
  std::vector<Phasor> harmonics;
};

/// The harmonics 1 .. `count` of a force that is sampled at equal distances over one period: F_k = 2 / N sum over j of
/// F_j exp(-2 pi i k j / N), 2 count < N.
PeriodicForce harmonics_of(const std::vector<Vec3>& one_period, int count);
/// The same force in a frame turned by R.
PeriodicForce turned(const Mat3& R, const PeriodicForce& force);

/// The steady state: u(t) = sum over k of the real part of H(2 pi k f) F_k exp(2 pi i k f t), without the static
/// deflection under the mean force.
struct Vibration {
  double amplitude = 0;                ///< m, the largest |u(t)|
  Vec3 peak = Vec3::Zero();            ///< m, the largest absolute value of each coordinate
  std::vector<Vec3> path;              ///< m, u at equal distances over one period
  std::optional<Resonance> unbounded;  ///< then the figures above are 0 and the path is empty: there is no steady state
};

/// Of a force whose first harmonic has this frequency (Hz), at `instants` of the period. Linear: what the vibration
/// changes of the chips, and so of the force, is not in it (no regeneration, no chatter). `axes`: the coordinates in
/// which path and peak are given, as columns in M. Cost: harmonics x (modes + instants).
Vibration steady_state(const ModalModel& model, double damping, const PeriodicForce& force, double frequency,
                       const Mat3& axes = Mat3::Identity(), int instants = 120);

}  // namespace polypod::motion
