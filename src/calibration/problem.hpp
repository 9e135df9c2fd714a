// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// A calibration as a problem of least squares: every unknown, which of them are searched for, and the equations.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "common.hpp"
#include "model.hpp"
#include "polypod/calibration/calibrate.hpp"
#include "polypod/core/parallel.hpp"

namespace polypod::calibration {

/// The whole problem; `x` is every unknown, `wanted` says which of them are searched for.
struct Problem {
  const AnyMachine& machine;
  const std::vector<Measurement>& rows;
  const CalibrationOptions& options;
  std::vector<machine::Parameter> nominal{};
  Layout layout{};
  Noise noise{};
  std::vector<Pose> seed{};        ///< the nominal pose of every row
  std::vector<bool> not_fitted{};  ///< held back, or lost
  std::vector<double> share{};     ///< for how many independent rows each counts
  Eigen::VectorXd start{}, scale{};
  std::vector<bool> chosen{};    ///< of the parameters
  std::vector<int> unfitted{};   ///< columns of the parameters that are neither searched for nor held: uncertain still
  std::vector<int> wanted{};     ///< columns of the unknowns that are searched for
  Eigen::VectorXd prior{};       ///< standard deviation of each unknown round its start
  Eigen::VectorXd dilatation{};  ///< ln of what contacts' joints are denser by, derived by each unknown
  double noise_scale = 1;        ///< what the residuals show of the noise, over the one that was given

  [[nodiscard]] int column(std::size_t parameter) const { return layout.parameters + static_cast<int>(parameter); }
  [[nodiscard]] bool is_length(std::size_t parameter) const { return nominal[parameter].unit == "mm"; }
  bool equations(std::size_t row, const Eigen::VectorXd& x, bool by_unknowns, Equations& out,
                 Lost lost = Lost::first_order) const {
    return equations_of(machine, rows[row], seed[row], layout, x, noise, by_unknowns, out, lost);
  }

  /// The rules that the parameters keep as further equations: r(x) and J (over all unknowns).
  void rules(const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd& J) const {
    constexpr double kRuleNoise = 1e-7;  // rules hold to this: a length error of 0.1 um on a metre
    rules_at(machine, layout, x, r, J);
    r /= kRuleNoise;
    J /= kRuleNoise;
  }

  /// Rules and priors. A prior counts as much as the noise that the residuals show, not the one that was given. With
  /// contacts, the determinant that belongs to their likelihood moves it: |d|^2 / (2 P^2) - g^T d has its least value
  /// at d = P^2 g (dilatation.hpp, in first order).
  void extra(const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd& J) const {
    rules(x, r, J);
    Eigen::Index row = r.size();
    const auto priors = static_cast<Eigen::Index>(wanted.size());
    r.conservativeResize(row + priors);
    J.conservativeResize(row + priors, layout.count);
    J.bottomRows(priors).setZero();
    for (const int j : wanted) {
      J(row, j) = noise_scale / prior[j];
      r[row++] = ((x[j] - start[j]) / prior[j] - prior[j] * dilatation[j]) * noise_scale;
    }
  }
};

/// All rows of a problem at the unknowns where a search looked last, many of them on all threads. It comes back to the
/// same place (round after round, and for the covariance), and to others near by.
class RowsAt {
 public:
  explicit RowsAt(const Problem& problem) : problem_(problem) {}

  void look(const Eigen::VectorXd& x, bool by_unknowns) {
    const std::size_t n = problem_.rows.size();
    equations_.resize(n);
    followed_.resize(n);
    assembles_.resize(n);
    if (x.size() == x_.size() && x == x_ && (by_unknowns_ || !by_unknowns)) return;
    const auto look_at = [&](std::size_t i) {
      Equations& e = equations_[i];
      e.followed = &followed_[i];
      assembles_[i] = problem_.equations(i, x, by_unknowns, e) ? 1 : 0;
    };
    constexpr std::size_t kWorthThreads = 1000;  // 10 us a row: below that threads cost more than they bring
    if (n < kWorthThreads) {
      for (std::size_t i = 0; i < n; ++i) look_at(i);
    } else {
      for_each_in_rounds(n, {}, look_at);
    }
    x_ = x;
    by_unknowns_ = by_unknowns;
  }
  [[nodiscard]] const Equations& of(std::size_t row) const { return equations_[row]; }
  [[nodiscard]] bool assembles(std::size_t row) const { return assembles_[row] != 0; }

 private:
  const Problem& problem_;
  Eigen::VectorXd x_;
  bool by_unknowns_ = false;
  std::vector<Equations> equations_;
  std::vector<Followed> followed_;
  std::vector<char> assembles_;  // not bool: threads write neighbours
};

}  // namespace polypod::calibration
