// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "controllers.hpp"
#include "polypod/calibration/simulate.hpp"
#include "polypod/families/delta/kinematics.hpp"

namespace polypod::control {
namespace {

using machine::LinearDelta;
using machine::RotaryDelta;

constexpr std::size_t kArms = 3;
constexpr double kThird = 2 * std::numbers::pi / 3;
constexpr double kMostLean = std::numbers::pi / 6;  // of rails, rad

/// What the controllers' models of a delta are made of, SI, z upwards, the arms counterclockwise from above. A model
/// that has fewer numbers has some of them equal.
enum Number : std::size_t {
  kRadius = 0,  ///< of the circle of towers or shoulders less that of the platform
  kRod = 1,     ///< three
  kAngle = 4,   ///< three, azimuths
  kZero = 7,    ///< three: height of the carriage, or angle of the arm below level, where the drive reads 0
  kShift = 10,  ///< three: p_C = R_z(turn) p_F + shift
  kTurnAngle = 13,
  kArm = 14,  ///< three, rotary: shoulder to elbow
  kNumbers = 17
};
template <class T>
using Numbers = std::array<T, kNumbers>;

/// Which of the numbers are looked for: index into the unknowns, or -1 where the number stays.
struct Choice {
  std::array<int, kNumbers> unknown;
  int count = 0;
  Choice() { unknown.fill(-1); }
  void each(std::initializer_list<std::size_t> numbers) {
    for (const std::size_t k : numbers) unknown[k] = count++;
  }
  void together(std::initializer_list<std::size_t> numbers) {
    for (const std::size_t k : numbers) unknown[k] = count;
    ++count;
  }
};

/// The lower of the two points at the rods' lengths from the three driven ends; false where there is none.
template <class T>
bool lower_point(const std::array<Vector3<T>, kArms>& end, const std::array<T, kArms>& rod, Vector3<T>& out) {
  using std::sqrt;
  const Vector3<T> e = end[1] - end[0], f = end[2] - end[0], n = e.cross(f);
  const T nn = n.squaredNorm();
  if (!(nn > T(1e-24))) return false;
  const T k_e = T(0.5) * (e.squaredNorm() + rod[0] * rod[0] - rod[1] * rod[1]);
  const T k_f = T(0.5) * (f.squaredNorm() + rod[0] * rod[0] - rod[2] * rod[2]);
  const Vector3<T> foot = (f.cross(n) * k_e + n.cross(e) * k_f) / nn;
  const T height2 = rod[0] * rod[0] - foot.squaredNorm();
  if (!(height2 > T(0.0))) return false;
  const T height = sqrt(height2 / nn);
  out = end[0] + foot - n * (n.z() > T(0.0) ? height : T(-height));
  return true;
}

/// Where the controller believes its tool to be, in its own frame. `sense`: of a carriage, height per reading.
template <class T>
bool model(const Numbers<T>& x, bool rotary, const std::array<double, kArms>& sense,
           const std::array<double, kArms>& reading, Vector3<T>& out) {
  using std::cos, std::sin;
  std::array<Vector3<T>, kArms> end;
  std::array<T, kArms> rod;
  for (std::size_t i = 0; i < kArms; ++i) {
    const T drive = x[kZero + i] + T(sense[i] * reading[i]);
    const T r = rotary ? T(x[kRadius] + x[kArm + i] * cos(drive)) : x[kRadius];
    end[i] = {r * cos(x[kAngle + i]), r * sin(x[kAngle + i]), rotary ? T(-x[kArm + i] * sin(drive)) : drive};
    rod[i] = x[kRod + i];
  }
  return lower_point(end, rod, out);
}

/// A point of {F} and the drives that really put the tool there, in the controller's order.
struct Sample {
  Vec3 p_F;
  std::array<double, kArms> reading;
  double weight = 1;  ///< in the fit
};

struct Study {
  bool rotary = false;
  std::array<double, kArms> sense{1, 1, 1};
  Numbers<double> start{};
  Choice choice;
  std::vector<Sample> fit, judge;

  template <class T>
  bool miss(const Numbers<T>& x, const Sample& sample, Vector3<T>& out) const {
    using std::cos, std::sin;
    if (!model(x, rotary, sense, sample.reading, out)) return false;
    const T c = cos(x[kTurnAngle]), s = sin(x[kTurnAngle]);
    const Vec3& p = sample.p_F;
    out -= Vector3<T>(c * p.x() - s * p.y() + x[kShift], s * p.x() + c * p.y() + x[kShift + 1], x[kShift + 2] + p.z());
    return true;
  }
  template <class T>
  [[nodiscard]] Numbers<T> numbers(const T* unknowns) const {
    Numbers<T> x;
    for (std::size_t k = 0; k < kNumbers; ++k) x[k] = choice.unknown[k] < 0 ? T(start[k]) : unknowns[choice.unknown[k]];
    return x;
  }
  [[nodiscard]] std::optional<Misses> judged(const Numbers<double>& x) const {
    MissCount count;
    for (const Sample& sample : judge) {
      Vec3 e;
      if (!miss(x, sample, e)) return std::nullopt;
      count.add(e.norm());
    }
    return count.misses();
  }
};

struct Residuals {
  const Study* study;
  template <class T>
  bool operator()(T const* const* unknowns, T* out) const {
    const Numbers<T> x = study->numbers(unknowns[0]);
    for (const Sample& sample : study->fit) {
      Vector3<T> e;
      if (!study->miss(x, sample, e)) return false;
      for (int k = 0; k < 3; ++k) *out++ = T(sample.weight) * e[k];
    }
    return true;
  }
};

Result<Numbers<double>> fitted(const Study& study) {
  std::vector<double> y(std::size_t(study.choice.count));
  for (std::size_t k = 0; k < kNumbers; ++k)
    if (study.choice.unknown[k] >= 0) y[std::size_t(study.choice.unknown[k])] = study.start[k];
  auto* cost = new ceres::DynamicAutoDiffCostFunction<Residuals, 6>(new Residuals{&study});  // the problem owns both
  cost->AddParameterBlock(study.choice.count);
  cost->SetNumResiduals(3 * int(study.fit.size()));
  ceres::Problem problem;
  problem.AddResidualBlock(cost, nullptr, y.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-16;
  options.gradient_tolerance = 1e-18;
  options.parameter_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) {
    return fail("CN105", "the controller's model cannot be fitted to this machine", {}, kTargetsHint);
  }
  return study.numbers(y.data());
}

Vec3 of_frame(const Vec3& p_M, double table) {
  return {p_M.x(), -p_M.y(), table - p_M.z()};
}

/// The chains in the controller's order: counterclockwise in {F}, the first being that which needs the least turn. Also
/// that turn.
struct Order {
  std::array<int, kArms> chain{0, 1, 2};
  double turn = 0;
};
Order order_of(const std::array<double, kArms>& azimuth_F, const std::array<double, kArms>& azimuth_C) {
  std::array<int, kArms> round{0, 1, 2};
  std::sort(round.begin(), round.end(), [&](int a, int b) {
    const auto from_first = [&](int i) {
      const double angle = std::remainder(azimuth_F[std::size_t(i)] - azimuth_F[0], 2 * std::numbers::pi);
      return angle < 0 ? angle + 2 * std::numbers::pi : angle;
    };
    return from_first(a) < from_first(b);
  });
  Order best;
  best.turn = 1e9;
  for (std::size_t first = 0; first < kArms; ++first) {
    Order order;
    Vec3 sum = Vec3::Zero();
    for (std::size_t i = 0; i < kArms; ++i) {
      order.chain[i] = round[(first + i) % kArms];
      const double turn = azimuth_C[i] - azimuth_F[std::size_t(order.chain[i])];
      sum += Vec3(std::cos(turn), std::sin(turn), 0);
    }
    order.turn = std::atan2(sum.y(), sum.x());
    if (std::abs(order.turn) < std::abs(best.turn) - 1e-9) best = order;
  }
  return best;
}

Result<std::vector<Sample>> samples_of(const std::vector<calibration::Stand>& stands, const Order& order,
                                       double table) {
  constexpr std::size_t kFewest = 20;
  if (stands.size() < kFewest) {
    return fail("CN104", fmt::format("only {} poses within the limits were found", stands.size()));
  }
  std::vector<Sample> out;
  for (const calibration::Stand& stand : stands) {
    Sample sample{of_frame(stand.X_MT.p, table), {}};
    for (std::size_t i = 0; i < kArms; ++i) sample.reading[i] = stand.q[order.chain[i]];
    out.push_back(sample);
  }
  return out;
}

/// Which chains of the machine file, by its own count.
std::string chains_in_words(const Order& order) {
  return fmt::format("{}, {}, {}", order.chain[0] + 1, order.chain[1] + 1, order.chain[2] + 1);
}

template <class M>
Result<Settings> delta_settings_of(const M& m, Controller controller, const SettingsOptions& options) {
  constexpr bool kRotary = std::same_as<M, RotaryDelta>;
  const bool klipper = controller == Controller::klipper;
  Settings s;
  s.controller = controller;
  s.machine = m.name;
  s.fitted = true;
  s.module = klipper ? (kRotary ? "rotary_delta" : "delta") : (kRotary ? "rotarydeltakins" : "lineardeltakins");
  if (m.arms != int(kArms)) {
    return fail("CN101", fmt::format("{} has three chains, the machine has {}", s.module, m.arms), {}, kTargetsHint);
  }
  const machine::AnyMachine any(m);
  const std::vector<calibration::Stand> fit = calibration::random_stands(any, options.points, options.seed);
  const std::vector<calibration::Stand> judge = calibration::random_stands(any, options.points, options.seed + 1);
  double table = 0;
  if (klipper) {
    for (const auto* stands : {&fit, &judge})
      for (const calibration::Stand& stand : *stands) table = std::max(table, stand.X_MT.p.z());
    table = units::from_mm(std::ceil(units::to_mm(table)));
    if (std::isfinite(m.high.z())) table = m.high.z();
    if (m.bodies.table_z) table = *m.bodies.table_z;
  }

  // Azimuths in the controllers' frames, from their manuals and, for LinuxCNC, from what its modules compute.
  const double right = std::numbers::pi / 2;
  const double first_C = klipper ? (kRotary ? right / 3 : 7 * right / 3) : (kRotary ? 3 * right : right);
  std::array<double, kArms> azimuth_F{}, azimuth_C{};
  std::array<Vec3, kArms> center;
  Study study;
  study.rotary = kRotary;
  const double middle = 0.5 * (m.range.min + m.range.max);
  for (std::size_t i = 0; i < kArms; ++i) {
    azimuth_C[i] = first_C + double(i) * kThird;
    center[i] = machine::driven_end(m, int(i), middle) - m.platform_joint[i];
    azimuth_F[i] = -std::atan2(center[i].y(), center[i].x());
  }
  const Order order = order_of(azimuth_F, azimuth_C);
  POLYPOD_ASSIGN(fit_samples, samples_of(fit, order, table));
  POLYPOD_ASSIGN(judge_samples, samples_of(judge, order, table));
  study.fit = std::move(fit_samples);
  study.judge = std::move(judge_samples);
  for (std::size_t i = 0; i < fit.size() && options.weight_by_condition; ++i)
    study.fit[i].weight = 1 / kinematics::dexterity(any, fit[i].X_MT, fit[i].q).condition;

  // Mean values to start from.
  Numbers<double>& x = study.start;
  double zero = 0, rod = 0, arm = 0, level = 0, base_radius = 0, foot_radius = 0;
  for (std::size_t i = 0; i < kArms; ++i) {
    const std::size_t k = std::size_t(order.chain[i]);
    rod += m.rod_length[k] / 3;
    foot_radius += m.platform_joint[k].template head<2>().norm() / 3;
    if constexpr (kRotary) {
      base_radius += m.base_joint[k].template head<2>().norm() / 3;
      arm += m.arm_length[k] / 3;
      zero += (m.zero[k] - right) / 3;
      level += (table - (m.base_joint[k].z() - m.platform_joint[k].z())) / 3;
    } else {
      const Vec3& u = m.rail_direction[k];
      if (!(std::abs(u.z()) > std::cos(kMostLean))) {
        return fail("CN103",
                    fmt::format("rail {} is inclined by more than 30 deg; {} takes vertical rails", k + 1, s.module),
                    {}, kTargetsHint);
      }
      study.sense[i] = u.z() > 0 ? -1 : 1;
      x[kRadius] += center[k].template head<2>().norm() / 3;
      zero += (table - center[k].z() - study.sense[i] * middle) / 3;
    }
  }
  if (kRotary) x[kRadius] = base_radius - foot_radius;
  for (std::size_t i = 0; i < kArms; ++i) {
    x[kRod + i] = rod;
    x[kArm + i] = arm;
    x[kZero + i] = zero;
    x[kAngle + i] = klipper ? azimuth_C[i] - order.turn : azimuth_C[i];
  }
  x[kTurnAngle] = klipper ? 0 : order.turn;
  const Vec3 tool_C = rotation_z(x[kTurnAngle]) * Vec3(m.tool.x(), -m.tool.y(), 0);
  // The model's point is where the platform's joints meet; the program's is the tool.
  x[kShift] = -tool_C.x();
  x[kShift + 1] = -tool_C.y();
  if (kRotary) {
    x[kShift + 2] = m.tool.z() - level;
  } else {
    for (std::size_t i = 0; i < kArms; ++i) x[kZero + i] -= m.tool.z();
  }

  Choice& choice = study.choice;
  choice.each({kRadius, kZero, kZero + 1, kZero + 2, kShift, kShift + 1});
  if (kRotary) choice.each({kShift + 2});
  if (klipper) {
    choice.each({kRod, kRod + 1, kRod + 2, kAngle, kAngle + 1, kAngle + 2});
    if (kRotary) choice.each({kArm, kArm + 1, kArm + 2});
  } else {
    choice.together({kRod, kRod + 1, kRod + 2});
    choice.each({kTurnAngle});
    if (kRotary) choice.together({kArm, kArm + 1, kArm + 2});
  }
  const std::optional<Misses> before = study.judged(x);
  if (!before) {
    return fail("CN103", fmt::format("{} with this machine's mean values does not reach its poses", s.module), {},
                kTargetsHint);
  }
  POLYPOD_ASSIGN(found, fitted(study));
  const std::optional<Misses> after = study.judged(found);
  if (!after) return fail("CN105", "the fitted model does not reach the machine's poses", {}, kTargetsHint);
  s.before = *before;
  s.after = *after;
  s.points = study.judge.size();
  constexpr double kExact = 1e-9;  // m
  s.exact = s.after.max < kExact;
  s.work_offset = {found[kShift], found[kShift + 1], klipper ? 0 : found[kShift + 2]};
  s.work_rotation = found[kTurnAngle];

  const auto mm = [](double si) { return units::to_mm(si); };
  s.notes.push_back(fmt::format(
      "Program coordinates: the machine file's x, y and z turned by half a turn about x, so that z points up{}.",
      klipper ? fmt::format(", with z = 0 at the file's z = {:.6g} mm", mm(table)) : std::string()));
  if (klipper) {
    put(s, "printer", "kinematics", s.module);
    if (kRotary) {
      put(s, "printer", "shoulder_radius", mm(found[kRadius]));
      put(s, "printer", "shoulder_height", mm(-found[kShift + 2]));
    } else {
      put(s, "printer", "delta_radius", mm(found[kRadius]));
    }
    for (std::size_t i = 0; i < kArms; ++i) {
      const std::string section = fmt::format("stepper_{}", "abc"[i]);
      const double L = found[kRod + i], drive = found[kZero + i] + study.sense[i] * m.range.min;
      const double r = found[kRadius] + (kRotary ? found[kArm + i] * std::cos(drive) : 0.0);
      const double end = kRotary ? -found[kShift + 2] - found[kArm + i] * std::sin(drive) : drive;
      if (!(L > std::abs(r))) {
        return fail("CN103",
                    fmt::format("with the tool at the centre {} cannot be at its endstop ({:g} {})", section,
                                kRotary ? units::to_deg(m.range.min) : mm(m.range.min), kRotary ? "deg" : "mm"),
                    {}, kTargetsHint);
      }
      put(s, section, "position_endstop", mm(end - std::sqrt(L * L - r * r)));
      if (kRotary) {
        put(s, section, "upper_arm_length", mm(found[kArm + i]));
        put(s, section, "lower_arm_length", mm(L));
      } else {
        put(s, section, "arm_length", mm(L));
      }
      double angle = units::to_deg(std::remainder(found[kAngle + i], 2 * std::numbers::pi));
      if (angle < 0) angle += 360;
      put(s, section, "angle", angle);
    }
    s.notes.push_back(
        fmt::format("stepper_a, b and c drive {} {} of the machine file; their endstops trigger where the "
                    "drives read {:g} {}.",
                    kRotary ? "arms" : "rails", chains_in_words(order),
                    kRotary ? units::to_deg(m.range.min) : mm(m.range.min), kRotary ? "deg" : "mm"));
    return s;
  }
  put(s, "KINS", "KINEMATICS", s.module);
  put(s, "KINS", "JOINTS", "3");
  put(s, "TRAJ", "COORDINATES", "XYZ");
  if (kRotary) {
    put(s, "HAL", "rotarydeltakins.platformradius", mm(found[kRadius] + foot_radius));
    put(s, "HAL", "rotarydeltakins.thighlength", mm(found[kArm]));
    put(s, "HAL", "rotarydeltakins.shinlength", mm(found[kRod]));
    put(s, "HAL", "rotarydeltakins.footradius", mm(foot_radius));
  } else {
    put(s, "HAL", "lineardeltakins.R", mm(found[kRadius]));
    put(s, "HAL", "lineardeltakins.L", mm(found[kRod]));
  }
  std::string backwards;
  for (std::size_t i = 0; i < kArms; ++i) {
    const auto user = [&](double value) { return kRotary ? units::to_deg(value) : mm(value); };
    const double at_min = found[kZero + i] + study.sense[i] * m.range.min;
    const double at_max = found[kZero + i] + study.sense[i] * m.range.max;
    put_joint(s, int(i), kRotary, user(found[kZero + i]), user(at_min), user(std::min(at_min, at_max)),
              user(std::max(at_min, at_max)));
    if (study.sense[i] < 0) backwards += fmt::format("{}{}", backwards.empty() ? "" : ", ", i);
  }
  s.notes.push_back(fmt::format(
      "Joints 0, 1 and 2 are {} {} of the machine file. HOME_OFFSET is the joint where the drive reads 0; for a switch "
      "at a reading q write this value {} q.",
      kRotary ? "arms" : "rails", chains_in_words(order), backwards.empty() ? "+" : "- (+ where it counts up)"));
  if (!backwards.empty()) {
    s.notes.push_back(fmt::format(
        "Joints are the carriages' heights. Counting against the drive's reading: joint {}. Change the sign of SCALE "
        "there.",
        backwards));
  }
  return s;
}

}  // namespace

Result<Settings> delta_settings(const RotaryDelta& m, Controller controller, const SettingsOptions& options) {
  return delta_settings_of(m, controller, options);
}
Result<Settings> delta_settings(const LinearDelta& m, Controller controller, const SettingsOptions& options) {
  return delta_settings_of(m, controller, options);
}

}  // namespace polypod::control
