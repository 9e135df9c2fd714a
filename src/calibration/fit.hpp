// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One calibration: the search, and what it says of what it found.
#pragma once

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "problem.hpp"

namespace polypod::calibration {

constexpr double kLeastNoise = 1e-9;  // of the noise given: below it residuals are rounding
/// With fewer equations beyond what the parameters take up, the residuals' own spread (30 % at 5) says little of the
/// noise.
constexpr double kLeastFree = 5;
constexpr double kHopeless = 100;  ///< times the noise: no fit

/// More than a tenth of the rows is no row near a singular pose, but a wrong machine.
inline bool too_many_lost(std::size_t lost, std::size_t rows) {
  constexpr double kMostLost = 0.1;
  return double(lost) > std::max(1.0, kMostLost * double(rows));
}

/// Where a search ended, and another one of the same machine may begin: one of more rows or with more unknowns, which
/// explains the readings in the same way and gets there in a round or two.
struct Ended {
  Eigen::VectorXd x, prior;  ///< of all unknowns
  double noise_scale = 1;
  Loss loss = Loss::automatic;
  bool pulled_aside = false;  ///< as Calibration
};

/// What the rows are, beside what was read.
struct Setting {
  std::vector<Pose> seed;         ///< the nominal machine's pose of every row, where Newton begins
  std::vector<std::size_t> pose;  ///< which rows stand at one pose
  std::vector<double> share;      ///< for how many independent rows each counts
  std::optional<Ended> from{};    ///< where the search begins; without it at the drawing
};

/// One calibration: prepare, then search and judge until every fitted row assembles, then what was found.
class Fit {
 public:
  /// The search begins with the noise as it was given, or with what the drawing leaves of the readings.
  Fit(const AnyMachine& machine, const std::vector<Measurement>& rows, const Setting& setting,
      const CalibrationOptions& options, bool noise_as_given);

  [[nodiscard]] Result<Calibration> run();
  [[nodiscard]] Ended ended() const { return {x_, problem_.prior, problem_.noise_scale, options_.loss}; }

 private:
  enum class Learns { nothing, lengths, angles };

  // The search (fit.cpp)
  /// The frames, and whether what was measured can be of this machine.
  void place_rows();
  /// The unknowns, where they begin, and which of them are asked for.
  Status start();
  /// What is known before anything is measured: of parameters the priors that were stated, else the default ones, whose
  /// size the measurements may correct; of frame, target and contacts next to nothing.
  void set_priors();
  /// Rows to hold back where enough are left, and the residuals before.
  Status choose_rows();
  /// What the fitted contacts add to Problem::dilatation: each place that k rows touch takes one of them for itself.
  void see_dilatation();
  /// Which unknowns the fitted rows tell.
  Status tell_unknowns();
  /// All equations of the fitted rows at x, one under another, rows weighted by `weights` if given; then the rules,
  /// which hold as they do whatever the noise of the rows.
  [[nodiscard]] Eigen::MatrixXd stacked(const Eigen::VectorXd& x, const std::vector<double>* weights) const;
  void whiten();
  /// Levenberg-Marquardt. The loss bends at what the residuals themselves show of the noise: first those of the nominal
  /// machine, where nearly everything is within the bend, then those that were found. The priors follow likewise.
  Status search();
  /// The weight that the loss gives each row, and its share.
  [[nodiscard]] std::vector<double> weights() const;
  /// The fitted rows and rules as a triangle R of these unknowns, R^T R = J^T W J, in units of the noise given.
  [[nodiscard]] Eigen::MatrixXd triangle(const std::vector<double>& weights, const std::vector<int>& unknowns) const;
  [[nodiscard]] static Eigen::MatrixXd triangle_of(const Eigen::MatrixXd& rows);
  /// A root C of the covariance of the wanted unknowns over their priors P: C C^T = (P R^T R P / s^2 + 1)^-1.
  [[nodiscard]] Eigen::MatrixXd root_of_covariance(const Eigen::MatrixXd& R, const Eigen::VectorXd& prior,
                                                   double noise) const;
  /// Noise and the size of the machine's errors, as the residuals and the changes found show them. Of each kind of
  /// parameter (lengths, angles) the default prior is scaled by t where the likelihood of the measurements (MacKay,
  /// Bayesian Interpolation, 1992) times what is thought of t beforehand is greatest:
  ///   sum (change / prior)^2 - sum (1 - variance / prior^2) + rules = pull_of(ln t).
  /// What a rule tells (of a unit vector its length) is nothing that was measured.
  /// Changes follow a new prior in first order. t stays below 30: what is off by more is no usual error of a machine,
  /// and who expects it gives --prior-mm and --prior-deg. Without `sizes` of the noise alone.
  void learn_noise_and_priors(bool sizes);
  /// By how much the priors fall short where their sizes are learnt: what is known of a size from k parameters is off
  /// by 1 / sqrt(2 k) of itself, and the largest likelihood takes it as known. The root of the mean of t^2 over what is
  /// known of both sizes (the likelihood times what is thought of t beforehand, on a grid round its maximum), over t;
  /// at least 1. Cost: at most 169 Cholesky decompositions of the wanted unknowns.
  [[nodiscard]] std::array<double, 2> spread_of_sizes(const Eigen::MatrixXd& R) const;
  /// ln of that likelihood where the sizes are e^u times those that were learnt; `squares` = R^T R.
  [[nodiscard]] double likelihood_of_sizes(const Eigen::MatrixXd& squares, const std::array<double, 2>& u) const;
  /// Columns of the unknowns whose size is learnt with the others of this kind.
  [[nodiscard]] std::vector<int> wanted_of(Learns kind) const;
  /// How strongly the default size of the errors draws t, e^u times of it, back: the derivative of -ln p(u), and a
  /// bound of its own derivative. p is Student's t of u: near t = 1 it counts as four parameters that are off as usual,
  /// so that few readings cannot turn it over, and nowhere as more than three, so that machines that agree with their
  /// drawing, a hundred times better than usual, are seen to.
  [[nodiscard]] static std::pair<double, double> pull_of(double u);
  /// ln p(u), but for a constant.
  [[nodiscard]] static double log_thought_of(double u);
  /// The parts of the searched unknowns.
  [[nodiscard]] Eigen::VectorXd of_wanted(const Eigen::VectorXd& all) const;
  /// One search from `block` with the bend where it is now.
  Status solve(std::vector<double>& block);
  Status search_without_lost();
  /// Rows that were lost only because others had drawn the search aside. True if there are any.
  [[nodiscard]] bool put_back();
  /// Marks the rows where the machine does not assemble with what was found: near a singular pose an error of a tenth
  /// of a millimetre moves the tool by many, and beyond it there is no pose. True where a fitted row is among them,
  /// which has drawn the search aside; it begins again without.
  [[nodiscard]] bool leave_out_lost();

  // What was found (fit_found.cpp)
  /// Weights, outliers, and the covariance that the residuals and the priors show: (J^T W J / s^2 + P^-2)^-1 with
  /// s^2 = sum w^2 |r|^2 / (sum w n - told unknowns) (Huber 1973 in its simplest form).
  Status judge();
  /// `sum`: of the weighted squares, `count`: of the weighted equations.
  void set_covariance(const std::vector<double>& weight, double sum, double count);
  /// What systematic parts do to the unknowns that were searched for, whose covariance has the root `own`: K J_b, K =
  /// -C J^T W / s^2.
  void set_systematic(const std::vector<double>& weight, const Eigen::MatrixXd& own, double s);
  /// By how many standard deviations the squared residuals of the fitted rows have become smaller, beyond what the fit
  /// takes out of mere noise. Where the drawing is exact, r = (1 - H) n with the noise n and H = J (J^T W J + s^2
  /// P^-2)^-1 J^T W, so that the difference has the mean s^2 tr(2 H - H^2) and the variance 2 s^4 tr((2 H - H^2)^2);
  /// the eigenvalues of H are 1 - those of the covariance over the priors.
  [[nodiscard]] double gain_in_deviations(const std::vector<double>& weight) const;
  /// Root mean square of the parameters' changes over the priors before their size was learnt.
  [[nodiscard]] double change_over_priors() const;
  /// Too few rows cannot contradict the noise that was given.
  [[nodiscard]] double noise_that_counts() const;
  /// What the drawing says of the parameters: the priors, as far as the rules that parameters keep leave them.
  void set_covariance_before(const std::vector<int>& uncertain);
  /// Every unknown with its standard error, or with what it acts like.
  void say_unknowns();
  /// Of the interval of one unknown: degrees of freedom as Welch and Satterthwaite, systematic parts having no end of
  /// them.
  [[nodiscard]] double student_of(int column) const;
  /// How many rules hold unknowns among these.
  [[nodiscard]] std::size_t rules_among(const std::vector<int>& columns) const;
  Status make_machine();

  const AnyMachine& any_;
  const std::vector<Measurement>& rows_;
  const CalibrationOptions& options_;
  const Setting& setting_;
  Problem problem_;
  mutable RowsAt seen_{problem_};
  Identifiability known_;
  Eigen::VectorXd x_;                      ///< what was found so far
  std::vector<Eigen::VectorXd> whitened_;  ///< residuals there, over their noise
  bool converged_ = false;
  bool noise_as_given_;
  std::array<std::size_t, 2> rules_of_{};  ///< that hold lengths and angles among the wanted unknowns
  std::vector<Learns> learns_;         ///< of each wanted unknown: with which others the size of its prior is learnt
  Eigen::VectorXd usual_;              ///< the priors before that
  Eigen::VectorXd pull_;               ///< J^T W (measured - computed at the start), in first order, of the wanted
  Eigen::VectorXd wide_;               ///< the priors with what is not known of their size
  Eigen::VectorXd error_;              ///< standard errors of all unknowns
  Eigen::VectorXd error_of_readings_;  ///< without systematic parts
  Eigen::MatrixXd shift_;              ///< of the wanted unknowns by one standard uncertainty of each systematic part
  double gain_ = 0;                    ///< weighted squares of the fitted rows, before less after
  Calibration out_;
};

}  // namespace polypod::calibration
