// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/statics/judge.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>

#include "not_negative.hpp"
#include "polypod/core/statistics.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/statics/measured_map.hpp"
#include "stated_noise.hpp"

namespace polypod::statics {
namespace {

using units::to_um;

constexpr double kOtherSize = 5;           // times the median: no noise and no wrong model does that to one point
constexpr double kImpossibleSize = 100;    // times the machine's own compliances, of all points
constexpr double kHalf = 0.5;              // an arrangement that leaves less of the residual explains much better ...
constexpr double kOfSignal = 0.1;          // ... where the residual is more than this share of the signal,
constexpr double kMuchLess = 0.25;         // or leaves less than this ...
constexpr double kLittleOfSignal = 0.02;   // ... of a smaller one
constexpr double kStandsOut = 4;           // times the median residual of a point ...
constexpr double kOutOfSignal = 0.15;      // ... and more than this share of what the point should show
constexpr double kNotPositive = 0.1;       // of the largest eigenvalue
constexpr double kSureOfNoise = 4;         // standard deviations
constexpr std::size_t kFewestForFile = 4;  // points that a file must have to be judged by itself
constexpr std::size_t kNamedRows = 6;      // rows that a message lists
constexpr const char* kAxes = "xyz";

/// What the joints of machines have: from rotary tables of machine tools to light arms, from guideways to light rods.
/// The stiffest joint may be a tenth of what the softest has at the least, and the softest ten times what the stiffest
/// has at the most.
struct Usual {
  double stiffest_least, softest_least, stiffest_most, softest_most;
  const char* unit;
};
constexpr Usual kTurning{1e-9, 1e-8, 1e-4, 1e-3, "rad/Nm"};
constexpr Usual kSliding{1e-10, 1e-9, 1e-5, 1e-4, "m/N"};

/// One point as the judge sees it.
struct Row {
  const MeasuredPoint* point = nullptr;
  std::vector<Mat3> unit;  ///< J_k J_k^T; empty where the machine cannot take the pose
  std::size_t file = 0;
  bool flagged = false;
  double weight = 1;  ///< of its residual: the noise of all rows over its own, where each row states one
  [[nodiscard]] double equations() const { return double(point->equations()); }
};

/// How the readings would have to be read: D' = left D right, one displacement reversed, or those of another row.
struct Arrangement {
  std::string what, hint;
  Mat3 left = Mat3::Identity(), right = Mat3::Identity();
  int flip_direction = -1, flip_force = -1, shift = 0;
  int steps = 1;  ///< how many mistakes that would take
  bool all_reversed = false;

  [[nodiscard]] MeasuredPoint of(const MeasuredPoint& p) const {
    MeasuredPoint out = p;
    out.displacement = left * p.displacement * right;
    const Mat3 mask = left.cwiseAbs() * p.given.cast<double>().matrix() * right.cwiseAbs();
    out.given = mask.array() > 0.5;
    if (flip_force >= 0) out.displacement(flip_direction, flip_force) *= -1;
    return out;
  }
};

/// "x and y are exchanged", "x, y and z are permuted", "the sign of z is wrong", or several of these.
std::string in_words(const Mat3& P, const std::string& prefix) {
  std::vector<int> moved, reversed;
  for (int i = 0; i < 3; ++i) {
    int from = 0;
    P.row(i).cwiseAbs().maxCoeff(&from);
    if (from != i) moved.push_back(i);
    if (P.row(i).sum() < 0) reversed.push_back(i);
  }
  const auto names = [&](const std::vector<int>& axes) {
    std::vector<std::string> out;
    for (const int axis : axes) out.push_back(prefix + kAxes[axis]);
    return listed(out);
  };
  std::string out;
  if (moved.size() == 2) out = names(moved) + " are exchanged";
  if (moved.size() == 3) out = names(moved) + " are permuted";
  if (!reversed.empty()) {
    out += fmt::format("{}the sign of {} is wrong", out.empty() ? "" : ", and ", names(reversed));
  }
  return out;
}

/// The 48 signed permutations of three axes, and how many mistakes each is.
std::vector<std::pair<Mat3, int>> signed_permutations() {
  std::vector<std::pair<Mat3, int>> out;
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Mat3 P = Mat3::Zero();
      int steps = 0;
      for (int i = 0; i < 3; ++i) {
        const bool minus = ((signs >> i) & 1) != 0;
        P(i, order[std::size_t(i)]) = minus ? -1 : 1;
        steps += (minus ? 1 : 0) + (order[std::size_t(i)] != i ? 1 : 0);
      }
      out.emplace_back(P, steps);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return out;
}

/// All that a person may have mixed up, the simplest first; rows shifted only where a whole file is judged.
std::vector<Arrangement> arrangements(bool shifts) {
  std::vector<Arrangement> out;
  const auto add = [&](Arrangement a) { out.push_back(std::move(a)); };
  const char* check = "check the first line of the file, and the axes of force and displacement";
  for (const auto& [P, steps] : signed_permutations()) {
    if (steps == 0) continue;
    Arrangement of_forces, of_displacements, of_both;
    of_displacements.left = P;
    of_displacements.steps = steps;
    if (P == -Mat3::Identity()) {
      of_displacements.steps = 1;
      of_displacements.all_reversed = true;
      of_displacements.what = "every displacement has the wrong sign";
      of_displacements.hint =
          "displacements are those of the tip along the axes, under forces on the tip; a gauge shows the opposite sign "
          "where it is on the other side";
    } else {
      of_displacements.what = in_words(P, "d");
      of_displacements.hint = check;
      of_forces.right = P.transpose();
      of_forces.steps = steps;
      of_forces.what = in_words(P, "F");
      of_forces.hint = check;
      add(of_forces);
      if (P.determinant() > 0) {
        of_both.left = P;
        of_both.right = P.transpose();
        of_both.steps = steps + 1;
        of_both.what = "forces and displacements are measured along other axes than those of M: " + in_words(P, "");
        of_both.hint = "give forces and displacements along the axes of M";
        add(of_both);
      }
    }
    add(of_displacements);
  }
  for (int f = 0; f < 3; ++f)
    for (int d = 0; d < 3; ++d) {
      Arrangement a;
      a.flip_direction = d;
      a.flip_force = f;
      a.what = fmt::format("the sign of d{}_F{} is wrong", kAxes[d], kAxes[f]);
      a.hint = "check that gauge";
      add(a);
    }
  if (shifts) {
    for (const int by : {1, -1}) {
      Arrangement a;
      a.shift = by;
      a.what = fmt::format("the displacements are one row too {}", by > 0 ? "low" : "high");
      a.hint = "each row holds the displacements of its own pose";
      add(a);
    }
  }
  std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) { return a.steps < b.steps; });
  return out;
}

/// The compliances c >= 0 that fit points best, each with its weight.
struct Fitting {
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
  explicit Fitting(Eigen::Index n) : H(Eigen::MatrixXd::Zero(n, n)), g(Eigen::VectorXd::Zero(n)) {}
  void add(const MeasuredPoint& p, const std::vector<Mat3>& unit, double weight) {
    Eigen::MatrixXd A(9, g.size());
    for (Eigen::Index k = 0; k < g.size(); ++k) A.col(k) = p.computed(unit[std::size_t(k)]).reshaped();
    H += weight * A.transpose() * A;
    g += weight * A.transpose() * p.given.select(p.displacement.array(), 0.0).matrix().reshaped();
  }
  [[nodiscard]] Eigen::VectorXd solve() const {
    // Scaled, and with a trace of a ridge: poses that cannot tell two joints apart still fit.
    Eigen::VectorXd scale = H.diagonal().cwiseSqrt();
    for (double& s : scale) s = s > 0 ? s : 1.0;
    const Eigen::MatrixXd inverse = scale.cwiseInverse().asDiagonal();
    Eigen::MatrixXd Hs = inverse * H * inverse;
    Hs.diagonal().array() += 1e-9;
    std::vector<bool> free;
    return inverse * not_negative(Hs, inverse * g, free);
  }
};

Mat3 sum_of(const std::vector<Mat3>& unit, const Eigen::VectorXd& c) {
  Mat3 C = Mat3::Zero();
  for (Eigen::Index k = 0; k < c.size(); ++k) C += c[k] * unit[std::size_t(k)];
  return C;
}

double square(const Mat3& D, const MeasuredPoint& p) {
  return p.given.select(D.array(), 0.0).matrix().squaredNorm();
}
double residual_square(const MeasuredPoint& p, const Mat3& C) {
  return square(p.displacement - p.computed(C), p);
}

/// rms of what a compliance leaves of a row, by its weight.
double residual_of(const Row& row, const MeasuredPoint& read, const Mat3& C) {
  return row.weight * std::sqrt(residual_square(read, C) / std::max(1.0, double(read.equations())));
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// |C| of the measured columns over |C| of the model, by Frobenius norm.
double size_of(const MeasuredPoint& p, const Mat3& C) {
  const Vec3 forces = p.forces();
  double measured = 0, model = 0;
  for (int f = 0; f < 3; ++f)
    for (int d = 0; d < 3; ++d) {
      if (!p.given(d, f)) continue;
      measured += std::pow(p.displacement(d, f) / forces[f], 2);
      model += C(d, f) * C(d, f);
    }
  return model > 0 ? std::sqrt(measured / model) : 0;
}

/// What a factor of that size may come from.
std::string likely(double factor) {
  constexpr double kNear = 1.6;
  const auto near = [&](double x) { return factor > x / kNear && factor < x * kNear; };
  if (near(1e-3)) return "are displacements in mm? they are read in um";
  if (near(1 / 25.4)) return "are displacements in thousandths of an inch? they are read in um";
  if (near(1e3)) return "is the force in kN, or are displacements in nm? they are read in N and um";
  if (near(25.4)) return "is a length in inches? displacements are read in um";
  if (near(10)) return "is the force in kgf, or a decimal point in another place? forces are read in N";
  if (near(0.1)) return "is a force 10 times too large, or a decimal point in another place?";
  return "displacements are read in um, forces in N";
}

class Judge {
 public:
  Judge(const AnyMachine& machine, const std::vector<MeasuredPoint>& points) : machine_(&machine) {
    std::vector<std::string> files;
    stated_ = stated_noise(points);
    for (const MeasuredPoint& point : points) {
      Row row;
      row.point = &point;
      if (stated_ > 0) row.weight = stated_ / point.sigma;
      if (const auto q = joints_of(machine, point)) row.unit = unit_compliances(machine, point.X_MT, *q);
      const auto at = std::find(files.begin(), files.end(), point.place.file);
      row.file = std::size_t(at - files.begin());
      if (at == files.end()) files.push_back(point.place.file);
      rows_.push_back(std::move(row));
    }
    files_ = files.size();
    if (has_compliance(machine)) {
      const std::vector<double> c = column_compliances(machine);
      own_ = Eigen::Map<const Eigen::VectorXd>(c.data(), Eigen::Index(c.size()));
    }
    noise();
  }

  Judgement judge() {
    for (const Row& row : rows_) columns_ = std::max(columns_, row.unit.size());
    double equations = 0;
    for (const Row& row : rows_) equations += row.unit.empty() ? 0 : row.equations();
    if (columns_ > 0 && equations > 2 * double(columns_)) {
      sizes();
      if (!arrangement()) single_rows();
    }
    if (out_.errors.empty()) not_positive();
    if (out_.errors.empty() && own_.size() == 0) unusual();
    return std::move(out_);
  }

 private:
  /// Rows that a model speaks of, less those that have been named already.
  [[nodiscard]] std::vector<const Row*> usable() const {
    std::vector<const Row*> out;
    for (const Row& row : rows_)
      if (!row.unit.empty() && !row.flagged) out.push_back(&row);
    return out;
  }

  /// From the asymmetry, by its median: outliers do not make it.
  void noise() {
    std::vector<double> half;
    for (const Row& row : rows_) {
      const MeasuredPoint& p = *row.point;
      const Vec3 forces = p.forces();
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < i; ++j)
          if (p.given(i, j) && p.given(j, i))
            half.push_back(std::abs(p.displacement(i, j) / forces[j] - p.displacement(j, i) / forces[i]) / 2);
    }
    constexpr double kNormalPerMad = 1.4826;
    noise_compliance_ = kNormalPerMad * median(half);  // of the mean of two readings
  }

  /// Of a compliance of the point, m/N.
  [[nodiscard]] double noise_compliance(const MeasuredPoint& p) const {
    if (!(stated_ > 0)) return noise_compliance_;
    double least = p.force;
    for (const double force : p.forces().cwiseAbs())
      if (force > 0) least = std::min(least, force);
    return p.sigma / least;
  }

  /// c >= 0 of the points that agree: large ones weigh no more than the median one, and points that stay 3 times the
  /// median residual away are left out.
  [[nodiscard]] Eigen::VectorXd robust_fit(const std::vector<const Row*>& rows) const {
    std::vector<double> sizes, weights;
    for (const Row* row : rows)
      sizes.push_back(std::sqrt(square(row->point->displacement, *row->point) / row->equations()));
    const double middle = median(sizes);
    for (std::size_t i = 0; i < rows.size(); ++i)
      weights.push_back(std::pow(rows[i]->weight * std::min(1.0, middle / sizes[i]), 2));
    Eigen::VectorXd c;
    for (int round = 0; round < 6; ++round) {
      Fitting fitting{Eigen::Index(columns_)};
      for (std::size_t i = 0; i < rows.size(); ++i) fitting.add(*rows[i]->point, rows[i]->unit, weights[i]);
      c = fitting.solve();
      std::vector<double> residuals;
      for (const Row* row : rows) residuals.push_back(residual_of(*row, *row->point, sum_of(row->unit, c)));
      const double typical = std::max(median(residuals), stated_);
      for (std::size_t i = 0; i < rows.size(); ++i)
        weights[i] = residuals[i] <= 3 * typical ? rows[i]->weight * rows[i]->weight : 0;
    }
    return c;
  }

  void name(const char* id, const std::vector<const Row*>& rows, const std::string& what, const std::string& hint,
            bool doubt = false) {
    std::string lines;
    for (std::size_t i = 0; i < std::min(rows.size(), kNamedRows); ++i)
      lines += fmt::format("{}{}", i == 0 ? "" : ", ", rows[i]->point->place.line);
    if (rows.size() > kNamedRows) lines += fmt::format(" and {} more", rows.size() - kNamedRows);
    const std::string who = rows.size() == 1 ? "" : fmt::format(" (rows in lines {})", lines);
    (doubt ? out_.doubts : out_.errors).push_back(Error{id, what + who, rows.front()->point->place, hint});
  }

  /// Points whose compliance has another size than that of the others, and all of them against the machine's own.
  void sizes() {
    const std::vector<const Row*> rows = usable();
    std::vector<Eigen::VectorXd> models{robust_fit(rows)};
    if (own_.size() > 0) models.push_back(own_);
    // Of each row the factor that is nearest to 1 under any model.
    std::vector<double> factor(rows.size(), 0);
    for (std::size_t m = 0; m < models.size(); ++m) {
      std::vector<double> ratio;
      std::size_t believable = 0;
      for (const Row* row : rows) {
        ratio.push_back(size_of(*row->point, sum_of(row->unit, models[m])));
        believable += ratio.back() > 1 / kOtherSize && ratio.back() < kOtherSize ? 1 : 0;
      }
      // Where a quarter of the points agrees with the machine's own model, the others are those that are off.
      const bool own = m + 1 == models.size() && own_.size() > 0;
      const double middle = own && 4 * believable >= rows.size() ? 1.0 : median(ratio);
      if (!(middle > 0)) continue;
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const double x = std::max(ratio[i] / middle, 1e-12);
        if (factor[i] == 0 || std::abs(std::log(x)) < std::abs(std::log(factor[i]))) factor[i] = x;
      }
    }
    std::vector<std::pair<std::string, std::vector<const Row*>>> groups;
    std::vector<double> of_group;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (factor[i] == 0 || (factor[i] < kOtherSize && factor[i] > 1 / kOtherSize)) continue;
      const std::string hint = likely(factor[i]);
      auto at = std::find_if(groups.begin(), groups.end(), [&](const auto& g) { return g.first == hint; });
      if (at == groups.end()) {
        groups.push_back({hint, {}});
        of_group.push_back(factor[i]);
        at = groups.end() - 1;
      }
      at->second.push_back(rows[i]);
    }
    for (std::size_t k = 0; k < groups.size(); ++k) {
      name("ID142", groups[k].second,
           fmt::format("displacements over force are {:.2g} times those of the other rows", of_group[k]),
           groups[k].first);
      for (const Row* row : groups[k].second) rows_[std::size_t(row - rows_.data())].flagged = true;
    }
    if (own_.size() == 0) return;
    std::vector<double> ratio;
    const std::vector<const Row*> left = usable();
    for (const Row* row : left) ratio.push_back(size_of(*row->point, sum_of(row->unit, own_)));
    const double all = median(ratio);
    if (left.empty() || (all < kOtherSize && all > 1 / kOtherSize)) return;
    const bool impossible = all > kImpossibleSize || all < 1 / kImpossibleSize;
    out_.doubts.reserve(1);
    (impossible ? out_.errors : out_.doubts)
        .push_back(Error{
            impossible ? "ID142" : "ID143",
            fmt::format("displacements over force are {:.2g} times what the compliances of the machine give", all),
            left.front()->point->place, likely(all)});
  }

  /// rms of what the best compliances leave where the rows of the files that `of` picks are read in that arrangement.
  [[nodiscard]] double left_by(const std::vector<const Row*>& rows, const Arrangement& a, std::size_t file,
                               Eigen::VectorXd* found = nullptr) const {
    Fitting fitting{Eigen::Index(columns_)};
    std::vector<std::pair<MeasuredPoint, const Row*>> read;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const bool touched = file == files_ || rows[i]->file == file;
      MeasuredPoint p = touched ? a.of(*rows[i]->point) : *rows[i]->point;
      if (touched && a.shift != 0) {
        const auto other = std::ptrdiff_t(i) + a.shift;
        if (other < 0 || other >= std::ptrdiff_t(rows.size()) || rows[std::size_t(other)]->file != rows[i]->file)
          continue;
        const MeasuredPoint& from = *rows[std::size_t(other)]->point;
        p.displacement = from.displacement;
        p.given = from.given;
        p.force = from.force;
        p.own_forces = from.own_forces;
      }
      fitting.add(p, rows[i]->unit, 1);
      read.emplace_back(std::move(p), rows[i]);
    }
    const Eigen::VectorXd c = fitting.solve();
    double sum = 0, count = 0;
    for (const auto& [p, row] : read) {
      sum += residual_square(p, sum_of(row->unit, c));
      count += double(p.equations());
    }
    if (found != nullptr) *found = c;
    return std::sqrt(sum / std::max(count, 1.0));
  }

  /// Whether columns are exchanged or reversed, or rows shifted, in a file or in all.
  bool arrangement() {
    const std::vector<const Row*> rows = usable();
    if (rows.empty()) return false;
    double signal = 0, count = 0;
    for (const Row* row : rows) {
      signal += square(row->point->displacement, *row->point);
      count += row->equations();
    }
    signal = std::sqrt(signal / count);
    const double as_it_is = left_by(rows, {}, files_);
    if (!(as_it_is > kLittleOfSignal * signal)) return false;
    std::vector<std::size_t> which{files_};
    for (std::size_t f = 0; files_ > 1 && f < files_; ++f) {
      const auto in = std::count_if(rows.begin(), rows.end(), [&](const Row* row) { return row->file == f; });
      if (std::size_t(in) >= kFewestForFile) which.push_back(f);
    }
    const std::vector<Arrangement> all = arrangements(rows.size() >= kFewestForFile);
    struct Best {
      double left = std::numeric_limits<double>::infinity();
      const Arrangement* arrangement = nullptr;
      std::size_t file = 0;
    } best;
    for (const std::size_t file : which)
      for (const Arrangement& a : all) {
        const double left = left_by(rows, a, file);
        // The list begins with the simplest: a stranger one must be clearly better.
        if (left < 0.9 * best.left) best = {left, &a, file};
      }
    const bool better =
        (best.left < kHalf * as_it_is && as_it_is > kOfSignal * signal) || best.left < kMuchLess * as_it_is;
    if (!better) return false;
    const auto first = std::find_if(rows.begin(), rows.end(),
                                    [&](const Row* row) { return best.file == files_ || row->file == best.file; });
    const Place& place = (*first)->point->place;
    out_.errors.push_back(
        Error{best.arrangement->all_reversed ? "ID140" : "ID141",
              fmt::format("the readings of {} fit no joints: {:.0f} um of {:.0f} um are left; {:.0f} um where {}",
                          best.file == files_ && files_ > 1 ? "all files" : "this file", to_um(as_it_is), to_um(signal),
                          to_um(best.left), best.arrangement->what),
              place, best.arrangement->hint});
    return true;
  }

  /// Rows that stand out from the others, and what mistake would put them in line.
  void single_rows() {
    const std::vector<const Row*> rows = usable();
    if (rows.size() < kFewestForFile) return;
    std::vector<Eigen::VectorXd> models{robust_fit(rows)};
    if (own_.size() > 0) models.push_back(own_);
    std::vector<double> residual;
    double typical = std::numeric_limits<double>::infinity();
    Eigen::VectorXd model;
    for (const Eigen::VectorXd& c : models) {
      std::vector<double> its;
      for (const Row* row : rows) its.push_back(residual_of(*row, *row->point, sum_of(row->unit, c)));
      // Readings are no nearer to each other than their stated noise makes them.
      if (const double middle = std::max(median(its), stated_); middle < typical) {
        typical = middle;
        residual = its;
        model = c;
      }
    }
    const std::vector<Arrangement> all = arrangements(false);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const MeasuredPoint& p = *rows[i]->point;
      const Mat3 C = sum_of(rows[i]->unit, model), expected = p.computed(C);
      const double count = rows[i]->equations(), signal = std::sqrt(square(expected, p) / count);
      const double weight = rows[i]->weight, off_by = residual[i] / weight, others = typical / weight;
      if (!(residual[i] > kStandsOut * typical && off_by > kOutOfSignal * signal)) continue;
      rows_[std::size_t(rows[i] - rows_.data())].flagged = true;
      const Arrangement* best = nullptr;
      double least = std::numeric_limits<double>::infinity();
      for (const Arrangement& a : all) {
        const MeasuredPoint as = a.of(p);
        const double left = residual_of(*rows[i], as, C);
        if (left < 0.9 * least) {
          least = left;
          best = &a;
        }
      }
      if (best != nullptr && least < 0.35 * residual[i] && least / weight < std::max(2 * others, 0.05 * signal)) {
        name(best->all_reversed ? "ID140" : "ID141", {rows[i]},
             fmt::format("the readings of this row are {:.0f} um off what the other rows say, {:.0f} um where {}",
                         to_um(off_by), to_um(least / weight), best->what),
             best->hint);
        continue;
      }
      const Mat3 off = p.given.select((p.displacement - expected).array(), 0.0).matrix();
      int direction = 0, force = 0;
      const double worst = off.cwiseAbs().maxCoeff(&direction, &force);
      const double rest = std::sqrt(std::max(0.0, off.squaredNorm() - worst * worst) / std::max(1.0, count - 1));
      const std::string expected_noise =
          stated_ > 0
              ? fmt::format("where noise (its sigma_um and the misfit of the others) makes {:.0f} um", to_um(others))
              : fmt::format("which are off by {:.0f} um", to_um(others));
      if (rest < 2 * others) {
        name("ID144", {rows[i]},
             fmt::format("the reading d{}_F{} is {:.0f} um off what the other rows say, {}", kAxes[direction],
                         kAxes[force], to_um(off(direction, force)), expected_noise),
             "read that gauge again, or leave the cell blank", true);
        continue;
      }
      name("ID144", {rows[i]},
           fmt::format("this row is {:.0f} um off what the other rows say, {}; over force its displacements are {:.2g} "
                       "times what they say",
                       to_um(off_by), expected_noise, size_of(p, C)),
           "check pose, force and displacements of this row", true);
    }
  }

  /// Compliances that no passive machine has.
  void not_positive() {
    std::vector<const Row*> against;
    double worst = 0;
    for (const Row& row : rows_) {
      if (row.flagged && !out_.errors.empty()) continue;
      const MeasuredPoint& p = *row.point;
      const Mat3 C = measured_compliance(p);
      double least = 0, most = 0;
      if (tells_all_entries(p)) {
        const Vec3 values = Eigen::SelfAdjointEigenSolver<Mat3>(C).eigenvalues();
        least = values[0];
        most = values.cwiseAbs().maxCoeff();
      } else {
        for (int i = 0; i < 3; ++i) {
          if (!p.given(i, i)) continue;
          least = std::min(least, C(i, i));
          most = std::max(most, std::abs(C(i, i)));
        }
      }
      if (!(least < -std::max(kNotPositive * most, kSureOfNoise * noise_compliance(p)))) continue;
      against.push_back(&row);
      worst = std::min(worst, least);
    }
    if (against.empty()) return;
    name("ID140", against,
         fmt::format("the tip moves against the force: C has an eigenvalue of {:.2g} um/N", units::to_um_per_N(worst)),
         "no machine does that: is a sign wrong, a unit mixed, are columns exchanged, or is a reading off?");
  }

  /// Where the machine has no compliances to compare with: those that no joint of a machine has.
  void unusual() {
    std::vector<MeasuredPoint> points;
    for (const Row& row : rows_) points.push_back(*row.point);
    const auto fit = identify_compliance(*machine_, points);
    if (!fit) return;
    for (const bool turns : {true, false}) {
      const Usual& usual = turns ? kTurning : kSliding;
      // The bounds of what the readings say of them, two standard errors from the values.
      constexpr double kInfinity = std::numeric_limits<double>::infinity();
      double stiffest_at_most = kInfinity, stiffest_at_least = kInfinity, softest_at_most = 0, softest_at_least = 0;
      for (std::size_t k = 0; k < fit->compliance.size(); ++k) {
        if (!fit->told[k] || fit->turns[k] != turns || !(fit->compliance[k] > 0)) continue;
        const double c = fit->compliance[k], open = 2 * fit->standard_error[k];
        stiffest_at_most = std::min(stiffest_at_most, c + open);
        stiffest_at_least = std::min(stiffest_at_least, c - open);
        softest_at_most = std::max(softest_at_most, c + open);
        softest_at_least = std::max(softest_at_least, c - open);
      }
      if (!(softest_at_most > 0)) continue;
      const bool stiff = stiffest_at_most < usual.stiffest_least || softest_at_most < usual.softest_least;
      const bool soft = stiffest_at_least > usual.stiffest_most || softest_at_least > usual.softest_most;
      if (!stiff && !soft) continue;
      double least = kInfinity, most = 0;
      for (std::size_t k = 0; k < fit->compliance.size(); ++k) {
        if (!fit->told[k] || fit->turns[k] != turns || !(fit->compliance[k] > 0)) continue;
        least = std::min(least, fit->compliance[k]);
        most = std::max(most, fit->compliance[k]);
      }
      out_.doubts.push_back(
          Error{"ID148",
                fmt::format("the compliances come out between {:.2g} and {:.2g} {}: no joints of machines are so {}",
                            least, most, usual.unit, stiff ? "stiff" : "soft"),
                rows_.front().point->place,
                stiff ? "are displacements in mm? they are read in um; or are forces too large, as in another unit?"
                      : "is the force in kN, or are displacements in nm? they are read in N and um"});
    }
  }

  const AnyMachine* machine_;
  std::vector<Row> rows_;
  std::size_t files_ = 0, columns_ = 0;
  Eigen::VectorXd own_;  ///< the machine's compliances; empty where it has none
  double noise_compliance_ = 0;
  double stated_ = 0;  ///< m, noise of a displacement that the rows state; 0 where not all do
  Judgement out_;
};

}  // namespace

Judgement judge(const AnyMachine& machine, const std::vector<MeasuredPoint>& points) {
  return Judge(machine, points).judge();
}

std::string_view name_of(Verdict::Answer answer) {
  switch (answer) {
    case Verdict::Answer::yes:
      return "yes";
    case Verdict::Answer::in_part:
      return "in part";
    default:
      return "no";
  }
}

namespace {

/// Those of which the readings tell a bound alone, where it leaves open a tenth and more of the largest of their kind.
std::string bounded_only(const Identification& fit) {
  constexpr double kMatters = 0.1;
  std::string out;
  for (std::size_t k = 0; k < fit.joint.size(); ++k) {
    double largest = 0;
    for (std::size_t j = 0; j < fit.joint.size(); ++j)
      if (fit.turns[j] == fit.turns[k]) largest = std::max(largest, fit.compliance[j]);
    const double open = fit.upper_bound[k].value_or(2 * fit.standard_error[k]);
    if (fit.compliance[k] <= 2 * fit.standard_error[k] && open > kMatters * largest)
      out += (out.empty() ? "" : ", ") + fit.joint[k];
  }
  return out;
}

}  // namespace

Verdict verdict_of(const Identification& fit, const Judgement& judgement) {
  using Answer = Verdict::Answer;
  constexpr double kLeastExplained = 0.8;
  constexpr double kWeak = 2;  // times the noise: from there on the answer says how little was tested
  std::string fits =
      fmt::format("The compliances explain {:.1f} % of the signal (R^2) of {:.1f} um and leave {:.1f} um",
                  100 * fit.explained, to_um(fit.signal_rms), to_um(fit.residual_rms));
  const char* source = fit.noise_stated ? "as stated" : "from the asymmetry of the cross displacements";
  if (!fit.noise_known()) {
    fits += "; nothing says how much of that is noise.";
  } else if (fit.noise > 0) {
    fits += fmt::format(", {:.1f} times the noise of a displacement ({:.1f} um, {}).", fit.residual_rms / fit.noise,
                        to_um(fit.noise), source);
  } else {
    fits += "; the cross displacements show no noise.";
  }
  if (!judgement.errors.empty()) {
    const Error& e = judgement.errors.front();
    return {Answer::no, fmt::format("{} They cannot be: {}; {}", fits, e.message, e.hint)};
  }
  if (fit.explained < kLeastExplained && (fit.more_than_noise() || !fit.noise_known())) {
    return {Answer::no, fits + " That is no model of this machine: check units, signs, axes, and the machine."};
  }
  if (!judgement.doubts.empty()) {
    const Error& e = judgement.doubts.front();
    return {Answer::in_part, fmt::format("{} Doubtful: {}.", fits, e.message)};
  }
  if (fit.more_than_noise()) {
    return {Answer::in_part,
            fmt::format("{} More than noise is left: for each degree of freedom {:.1f} um, where noise explains up to "
                        "{:.1f} um. Something else than these joints deflects, too, or readings are off.",
                        fits, to_um(fit.misfit), to_um(fit.misfit_limit * fit.noise))};
  }
  std::string untold;
  for (std::size_t k = 0; k < fit.told.size(); ++k)
    if (!fit.told[k]) untold += (untold.empty() ? "" : ", ") + fit.joint[k];
  if (!untold.empty()) {
    return {Answer::in_part, fmt::format("{} The compliance of {} is not identifiable from these readings, because it "
                                         "hardly moves the tip under these forces: {} as the "
                                         "machine file has {}.",
                                         fits, untold, untold.find(',') == std::string::npos ? "it stays" : "they stay",
                                         untold.find(',') == std::string::npos ? "it" : "them")};
  }
  if (const std::string hardly = bounded_only(fit); !hardly.empty()) {
    return {Answer::in_part,
            fmt::format("{} Of the compliance of {} these readings say no more than a bound: it is less than two "
                        "standard errors. Measure at more poses, or with larger forces.",
                        fits, hardly)};
  }
  if (fit.pairs > 0 && !fit.symmetric) {
    return {Answer::in_part, fits + " The cross displacements are not symmetric, as those of an elastic machine are."};
  }
  if (!fit.noise_known()) {
    const char* more = fit.pairs == 0 ? "load in a second direction" : "measure at more poses";
    return {Answer::in_part, fmt::format("{} Whether something else than these joints deflects is therefore not "
                                         "judged: state the noise (--noise-um), or {}.",
                                         fits, more)};
  }
  if (fit.misfit_limit > kWeak) {
    fits += fmt::format(" So few readings show something else that deflects only from {:.1f} times the noise on.",
                        fit.misfit_limit);
  }
  if (fit.pairs == 0) fits += " Symmetry is not judged: no two cross displacements of a pair were measured.";
  return {Answer::yes, fits};
}

}  // namespace polypod::statics
