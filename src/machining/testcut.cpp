// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/testcut.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>

#include "polypod/core/units.hpp"

namespace polypod::machining {
namespace {

using units::to_mm;

constexpr double kClear = 2e-3;       // m, above the stock and beside it
constexpr double kStretch = 3;        // diameters long is a stretch ...
constexpr double kMeasured = 1;       // ... and so much of it, in its middle, is measured
constexpr double kMostOff = 0.25;     // of the diameter, a wall
constexpr double kFloor = 10e-3;      // m of the block below the boss
constexpr double kDerivative = 0.02;  // of the product, for the derivative of predicted sizes
constexpr int kIterations = 12;
constexpr double kSettled = 1e-4, kSettledShare = 0.1;  // of the product, of its standard uncertainty
// Cutters are reground by less than this share of their diameter.
constexpr double kOtherCutter = 0.05;
constexpr double kLeast = 0.2, kMost = 5, kTold = 0.5;

/// The square path round the boss, clockwise from its upper left corner: offsets of the tool's centre by stretch.
class Writer {
 public:
  Writer(const TestCutPlan& plan, const cutting::Cutter& cutter)
      : plan_(plan), radius_(0.5 * cutter.diameter), stretch_(kStretch * cutter.diameter) {
    half_ = 0.5 * stretch_ * static_cast<double>(plan.widths.size());
    block_ = half_ + 2 * cutter.diameter + plan.widths.back();
    out_.plan = plan;
    out_.block_min = {plan.x - block_, plan.y - block_, -plan.depth - kFloor};
    out_.block_max = {plan.x + block_, plan.y + block_, 0};
    head(cutter);
  }

  TestCut write() {
    for (const bool finish : {false, true}) {
      line(finish ? "(FINISHING: WHAT EACH STRETCH HAS LEFT)" : "(ROUGHING IN A SLOT ROUND THE BOSS)");
      round(finish);
    }
    line("M5");
    line("M30");
    out_.text += "%\n";
    return std::move(out_);
  }

 private:
  void line(const std::string& text) {
    out_.text += text + '\n';
    ++line_;
  }
  void head(const cutting::Cutter& cutter) {
    line("%");
    line(fmt::format("(TEST CUT: A BOSS OF {:g} BY {:g} MM, {:g} MM DEEP, CUTTER {:g} MM)", to_mm(2 * half_),
                     to_mm(2 * half_), to_mm(plan_.depth), to_mm(cutter.diameter)));
    line(fmt::format("(BLOCK FROM X{:.3f} Y{:.3f} Z{:.3f} TO X{:.3f} Y{:.3f} Z0)", to_mm(out_.block_min.x()),
                     to_mm(out_.block_min.y()), to_mm(out_.block_min.z()), to_mm(out_.block_max.x()),
                     to_mm(out_.block_max.y())));
    line("G17 G21 G40 G49 G54 G64 P0.01 G80 G90 G94");
    if (plan_.tool >= 0) line(fmt::format("T{} M6", plan_.tool));
    line(fmt::format("S{:.0f} M3", units::to_per_min(plan_.spindle_speed)));
  }

  /// Along side 0 (top, +x), 1 (right, -y), 2 (bottom, -x), 3 (left, +y): the point at `along` in the direction of the
  /// tool from the middle of the side, `off` from the middle of the boss.
  [[nodiscard]] Vec3 point(int side, double along, double off) const {
    const Vec3 local[4] = {{along, off, 0}, {off, -along, 0}, {-along, -off, 0}, {-off, along, 0}};
    return Vec3(plan_.x, plan_.y, 0) + local[side];
  }
  void go(const char* word, const Vec3& p, const std::string& more = {}) {
    line(fmt::format("{} X{:.4f} Y{:.4f}{}", word, to_mm(p.x()), to_mm(p.y()), more));
  }

  void round(bool finish) {
    const int n = static_cast<int>(plan_.widths.size());
    // Opposite sides have their widths at the same place: the tool meets them from the first to the last along the top
    // and up the left, the other way round down the right and along the bottom.
    const auto stretch_of = [&](int side, int k) { return side == 0 || side == 3 ? k : n - 1 - k; };
    const auto offset = [&](int side, int k) {
      const double width = plan_.widths[static_cast<std::size_t>(stretch_of(side, k))];
      return half_ + radius_ + (finish ? 0 : width);
    };
    const double outside = block_ + radius_ + kClear;
    line("G0 Z10");
    go("G0", point(0, -outside, offset(0, 0)));
    line(fmt::format("G0 Z{:g}", to_mm(kClear)));
    line(fmt::format("G1 Z{:.4f} F{:.0f}", -to_mm(plan_.depth), units::to_mm_per_min(plan_.feed)));
    for (int side = 0; side < 4; ++side) {
      for (int k = 0; k < n; ++k) {
        const double middle = -half_ + (k + 0.5) * stretch_, off = offset(side, k);
        if (finish) {
          go("G1", point(side, middle - 0.5 * kMeasured * 2 * radius_, off));
          go("G1", point(side, middle + 0.5 * kMeasured * 2 * radius_, off));
          remember(side, stretch_of(side, k));
        }
        const bool last = k == n - 1;
        if (last && side == 3) {
          go("G1", point(side, outside, off));
        } else if (last) {
          go("G1", point(side, offset(side + 1, 0), off));
        } else {
          const double end = middle + 0.5 * stretch_;
          go("G1", point(side, end, off));
          if (!finish) go("G1", point(side, end, offset(side, k + 1)));
        }
      }
    }
    line("G0 Z10");
  }

  /// The block that was just written finishes this stretch of this side.
  void remember(int side, int stretch) {
    const char axis = side % 2 == 0 ? 'y' : 'x';  // across the top and the bottom, across the right and the left
    for (TestCutStep& step : out_.steps) {
      if (step.axis != axis || step.width != plan_.widths[static_cast<std::size_t>(stretch)]) continue;
      step.lines[1] = line_;
      return;
    }
    const double place = -half_ + (stretch + 0.5) * stretch_;
    Vec3 at(plan_.x, plan_.y, -0.5 * plan_.depth);
    at[axis == 'y' ? 0 : 1] += place;
    out_.steps.push_back({axis, plan_.widths[static_cast<std::size_t>(stretch)], at, 2 * half_, {line_, 0}});
  }

  TestCutPlan plan_;
  double radius_, stretch_, half_ = 0, block_ = 0;
  int line_ = 0;
  TestCut out_;
};

/// Upper 99 % of chi-squared (Wilson and Hilferty 1931: within 1 % from one degree of freedom on).
double chi_squared_99(int freedom) {
  constexpr double kZ = 2.3263;
  const double v = 2.0 / (9 * freedom);
  return freedom * std::pow(1 - v + kZ * std::sqrt(v), 3);
}

/// Residuals of the sizes for one product with the diameter that fits best.
struct Residuals {
  Eigen::VectorXd r;
  double diameter = 0;
};
Residuals residuals(const std::vector<TestCutReading>& readings, const std::vector<double>& sizes) {
  const auto n = static_cast<Eigen::Index>(readings.size());
  Eigen::VectorXd off(n), weight(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const TestCutReading& reading = readings[static_cast<std::size_t>(i)];
    off[i] = reading.size - sizes[reading.step];
    weight[i] = 1 / (reading.sigma * reading.sigma);
  }
  const double mean = weight.dot(off) / weight.sum();
  return {off.array() - mean, -mean};
}
double rms(const Eigen::VectorXd& r) {
  return r.norm() / std::sqrt(static_cast<double>(r.size()));
}

Status enough(const TestCut& cut, const std::vector<TestCutReading>& readings) {
  bool differ = false;
  for (const TestCutReading& r : readings)
    differ = differ || cut.steps[r.step].width != cut.steps[readings.front().step].width;
  if (readings.size() >= 3 && differ) return {};
  return fail("MC412",
              fmt::format("{} measured {}{}: a factor and the diameter of the cutter do not follow", readings.size(),
                          readings.size() == 1 ? "size" : "sizes", differ ? "" : " of one width of cut"),
              {}, "measure at least three sizes, of two widths of cut");
}

}  // namespace

Result<TestCut> test_cut(const Job& job, const TestCutPlan& wanted) {
  TestCutPlan plan = wanted;
  const cutting::Cutter& cutter = job.cutter_of(plan.tool);
  POLYPOD_TRY(cutting::is_flat(cutter, {}, "take a flat cutter: a test cut has walls whose sizes are measured"));
  const double D = cutter.diameter;
  if (plan.widths.empty()) plan.widths = {0.05 * D, 0.2 * D, 0.5 * D};
  if (plan.depth == 0) plan.depth = std::min(0.25 * D, cutter.length);
  const bool rise =
      std::adjacent_find(plan.widths.begin(), plan.widths.end(), std::greater_equal<>()) == plan.widths.end();
  if (plan.widths.size() < 2 || !rise || !(plan.widths.front() > 0) || !(plan.widths.back() < D)) {
    return fail(
        "MC410", "the widths of cut of a test cut", {},
        fmt::format("give two or more that rise, above 0 and below the diameter of the cutter, {:g} mm", to_mm(D)));
  }
  if (!(plan.feed > 0) || !(plan.spindle_speed > 0) || !(plan.depth > 0) || !(plan.depth <= cutter.length)) {
    return fail("MC411",
                fmt::format("a test cut with a feed of {:g} mm/min at {:g} rev/min, {:g} mm deep",
                            units::to_mm_per_min(plan.feed), units::to_per_min(plan.spindle_speed), to_mm(plan.depth)),
                {},
                fmt::format("give a feed and a speed above 0 and a depth within the cutter's edges, {:g} mm",
                            to_mm(cutter.length)));
  }
  return Writer(plan, cutter).write();
}

Result<std::vector<double>> predicted_sizes(const Job& job, const TestCut& cut, double force,
                                            std::vector<std::string>* notes) {
  Job test = job;
  test.material = scaled_forces(test.material, force);
  const Vec3& g54 = job.work_offsets[0];  // in which the program runs, and the block is clamped
  POLYPOD_ASSIGN(stock, cutting::Stock::block(cut.block_min + g54, cut.block_max + g54,
                                              cutting::kUsualCell * job.cutter_of(cut.plan.tool).diameter));
  test.stock = std::move(stock);
  POLYPOD_ASSIGN(program, gcode::parse(cut.text, "test cut"));
  POLYPOD_ASSIGN(moves, gcode::interpret(program, test.interpret_options()));
  POLYPOD_ASSIGN(prediction, predict(test, program, moves));
  std::map<int, double> normal;  // by line
  for (const MovePrediction& m : prediction.moves) normal[m.line] = m.normal.mean;
  std::vector<double> out;
  out.reserve(cut.steps.size());
  const double most = kMostOff * job.cutter_of(cut.plan.tool).diameter;
  for (const TestCutStep& step : cut.steps) {
    for (const int line : step.lines) {
      if (std::abs(normal[line]) <= most) continue;
      return fail("MC414",
                  fmt::format("the tool would be off by {:.1f} mm at the width of {:g} mm: no test cut",
                              to_mm(std::abs(normal[line])), to_mm(step.width)),
                  {}, "take a smaller feed per tooth or depth; check the unit of feed and speed and the compliances");
    }
    out.push_back(step.nominal + normal[step.lines[0]] + normal[step.lines[1]]);
  }
  if (notes != nullptr) *notes = condition_notes(test, moves.moves, prediction);
  return out;
}

Result<TestCutFit> fit_test_cut(const Job& job, const TestCut& cut, const std::vector<TestCutReading>& readings,
                                const std::function<bool(double)>& progress) {
  POLYPOD_TRY(enough(cut, readings));
  const auto n = static_cast<Eigen::Index>(readings.size());
  Eigen::VectorXd weight(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double sigma = readings[static_cast<std::size_t>(i)].sigma;
    weight[i] = 1 / (sigma * sigma);
  }
  TestCutFit fit;
  fit.freedom = static_cast<int>(n) - 2;
  fit.chi_squared_99 = chi_squared_99(fit.freedom);
  double product = 1, information = 0, mean_slope = 0;
  bool settled = false;
  Residuals now;
  for (int round = 0; round < kIterations; ++round) {
    if (progress && !progress(static_cast<double>(round) / kIterations)) return fail("MC299", "cancelled");
    POLYPOD_ASSIGN(here, predicted_sizes(job, cut, product));
    POLYPOD_ASSIGN(there, predicted_sizes(job, cut, product * (1 + kDerivative)));
    now = residuals(readings, here);
    if (round == 0) {
      fit.before.assign(now.r.begin(), now.r.end());
      fit.rms_before = rms(now.r);
    }
    // d size / d product, free of what a diameter does to all of them alike.
    Eigen::VectorXd slope(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const std::size_t step = readings[static_cast<std::size_t>(i)].step;
      slope[i] = (there[step] - here[step]) / (kDerivative * product);
    }
    mean_slope = weight.dot(slope) / weight.sum();
    slope.array() -= mean_slope;
    information = slope.cwiseAbs2().dot(weight);
    if (!(information > 0)) break;
    const double change = slope.cwiseProduct(weight).dot(now.r) / information;
    // The cells of the stock move the predicted sizes by some tenths of a micrometre.
    settled = std::abs(change) < std::max(kSettled * product, kSettledShare / std::sqrt(information));
    if (settled) break;
    // No further than half of the way to 0 at once, nor to more than twice.
    product = std::clamp(product + change, 0.5 * product, 2 * product);
    if (product < 0.5 * kLeast || product > 2 * kMost) break;
  }
  fit.after.assign(now.r.begin(), now.r.end());
  fit.rms_after = rms(now.r);
  fit.chi_squared = now.r.cwiseAbs2().dot(weight);
  const double wider = std::max(1.0, fit.chi_squared / fit.freedom);
  fit.product = {product, information > 0 ? std::sqrt(wider / information) : 0};
  fit.diameter = {now.diameter, std::hypot(std::sqrt(wider / weight.sum()), mean_slope * fit.product.uncertainty)};
  if (fit.chi_squared > fit.chi_squared_99) {
    const auto worst = std::max_element(fit.after.begin(), fit.after.end(),
                                        [](double a, double b) { return std::abs(a) < std::abs(b); });
    const TestCutStep& step = cut.steps[readings[static_cast<std::size_t>(worst - fit.after.begin())].step];
    fit.no = fmt::format(
        "one factor does not explain the sizes: {:.1f} um rms remain, most along {} at the width of {:g} mm ({:+.1f} "
        "um); directions or widths differ by more than their uncertainty",
        units::to_um(fit.rms_after), step.axis, to_mm(step.width), units::to_um(*worst));
  } else if (!(information > 0) || fit.product.uncertainty > kTold * product) {
    fit.no = information > 0 ? fmt::format("the product of force and compliance is known to {:.0f} % only",
                                           100 * fit.product.uncertainty / product)
                             : std::string("the sizes do not depend on the force");
  } else if (product < kLeast || product > kMost) {
    fit.no = fmt::format(
        "the product of force and compliance would be {:.2g} times that of the job: something else is wrong, as the "
        "unit of the sizes or the machine's compliances",
        product);
  } else if (!settled) {
    fit.no = fmt::format("the search for the product did not settle, last at {:.3g}", product);
  } else if (std::abs(fit.diameter.value) > kOtherCutter * job.cutter.diameter) {
    fit.no = fmt::format(
        "the sizes tell of a cutter {:.3f} mm {} than the {:.3f} mm of the job: was it another one, or were the sizes "
        "measured otherwise?",
        units::to_mm(std::abs(fit.diameter.value)), fit.diameter.value > 0 ? "larger" : "smaller",
        units::to_mm(job.cutter.diameter));
  }
  return fit;
}

Result<Factor> compliance_factor(const Job& job, const std::vector<statics::MeasuredPoint>& points) {
  POLYPOD_TRY(statics::needs_compliance(job.machine));
  double along = 0, square = 0, measured = 0, count = 0;
  for (const statics::MeasuredPoint& point : points) {
    POLYPOD_ASSIGN(C, statics::computed_compliance(job.machine, point));
    const Mat3 computed = point.computed(C), seen = point.given.select(point.displacement.array(), 0.0).matrix();
    along += computed.cwiseProduct(seen).sum();
    square += computed.squaredNorm();
    measured += seen.squaredNorm();
    count += static_cast<double>(point.equations());
  }
  const double c = along / square;
  const double rest = std::max(0.0, measured - c * along);
  return Factor{c, count > 1 ? std::sqrt(rest / (count - 1) / square) : std::abs(c)};
}

Separated separated(const Factor& product, const std::optional<Factor>& compliance, const Factors& old) {
  Separated out;
  out.force = product;
  if (compliance) {
    out.force.value = product.value / compliance->value;
    out.force.uncertainty =
        out.force.value * std::hypot(product.uncertainty / product.value, compliance->uncertainty / compliance->value);
  }
  out.factors = {old.force * out.force.value, old.compliance * (compliance ? compliance->value : 1),
                 old.force * out.force.uncertainty};
  return out;
}

std::string with_factors(const std::string& job_text, const Factors& factors, const std::string& remark) {
  std::istringstream in(job_text);
  std::string out, row;
  bool old = false;
  while (std::getline(in, row)) {
    const std::size_t first = row.find_first_not_of(" \t");
    if (first != std::string::npos && row[first] == '[') old = row.compare(first, 9, "[factors]") == 0;
    if (!old) out += row + '\n';
  }
  while (out.size() > 1 && out.compare(out.size() - 2, 2, "\n\n") == 0) out.pop_back();
  out += "\n[factors]\n";
  std::istringstream remarks(remark);
  while (std::getline(remarks, row)) out += "# " + row + '\n';
  out += fmt::format("force = {:.6g}\nforce_uncertainty = {:.3g}\ncompliance = {:.6g}\n", factors.force,
                     factors.force_uncertainty, factors.compliance);
  return out;
}

}  // namespace polypod::machining
