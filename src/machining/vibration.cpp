// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/vibration.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "polypod/core/units.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/tilted.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {
namespace {

constexpr int kMostHarmonics = 40;
// Angles a tooth at which the force is computed; fewer for cutters of many teeth, whose force changes the less.
constexpr int kSamples = 180, kMostSamples = 1440, kFewestSamples = 24;
constexpr double kDisc = 0.025;  // of the diameter, as SLAV 5.2.1
// Harmonics with less than this share of the largest one's force are no resonance worth a name.
constexpr double kHeard = 0.05;
// Within this share of a natural frequency another spindle speed is looked for, within kOtherSpeeds, in steps of
// kSpeedStep.
constexpr double kNearby = 0.2, kOtherSpeeds = 0.25, kSpeedStep = 0.01;
constexpr double kAlmostBest = 1.25, kWorthIt = 0.7;
// Below this spindle speeds are not rounded to whole rev/min, rev/s.
constexpr double kRoundFrom = 10;

struct Judged {
  const CutPoint* point;
  motion::ModalModel model;
  motion::PeriodicForce force;
  Mat3 axes;  ///< of the cut, in M: along the feed, across the path, along the tool axis
};

/// The frame of the cut in M.
Mat3 cut_frame(const Job& job, const CutPoint& point) {
  Mat3 R_WC;
  R_WC << point.feed.x(), -point.feed.y(), 0, point.feed.y(), point.feed.x(), 0, 0, 0, 1;
  return job.X_MW.R * R_WC;
}

/// The harmonic nearest to a natural frequency at this tooth-passing frequency.
std::optional<NearMode> nearest_mode(const std::vector<Judged>& points, double passing,
                                     const std::function<int(const CutPoint&)>& line_of) {
  std::optional<NearMode> out;
  for (const Judged& p : points) {
    double largest = 0;
    for (const motion::Phasor& f : p.force.harmonics) largest = std::max(largest, f.norm());
    for (std::size_t k = 0; k < p.force.harmonics.size(); ++k) {
      if (!(p.force.harmonics[k].norm() > kHeard * largest)) continue;
      for (std::size_t r = 0; r < p.model.modes.size(); ++r) {
        const double natural = p.model.modes[r].frequency;
        const double apart = passing * static_cast<double>(k + 1) / natural - 1;
        if (out && std::abs(apart) >= std::abs(out->apart)) continue;
        out = NearMode{static_cast<int>(k + 1), static_cast<int>(r), natural, apart, line_of(*p.point)};
      }
    }
  }
  return out;
}

/// The largest amplitude of the points at this tooth-passing frequency; nothing where one has no steady state.
std::optional<double> amplitude_at(const std::vector<Judged>& points, double damping, double passing) {
  constexpr int kInstants = 60;
  double out = 0;
  for (const Judged& p : points) {
    const motion::Vibration v = steady_state(p.model, damping, p.force, passing, p.axes, kInstants);
    if (v.unbounded) return std::nullopt;
    out = std::max(out, v.amplitude);
  }
  return out;
}

/// Whole rev/min.
double rounded_speed(double speed) {
  return speed < kRoundFrom ? speed : units::from_per_min(std::round(units::to_per_min(speed)));
}

std::optional<SpeedAdvice> advice_for(const std::vector<Judged>& points, double damping, int teeth,
                                      const SpeedVibration& now) {
  const bool near = now.unbounded || (now.nearest && std::abs(now.nearest->apart) < kNearby);
  if (!near) return {};
  std::vector<SpeedAdvice> tried;
  const int steps = static_cast<int>(std::lround(kOtherSpeeds / kSpeedStep));
  for (int k = -steps; k <= steps; ++k) {
    if (k == 0) continue;
    const double speed = rounded_speed(now.spindle_speed * (1 + k * kSpeedStep));
    const std::optional<double> amplitude = amplitude_at(points, damping, speed * teeth);
    if (amplitude) tried.push_back({speed, speed / now.spindle_speed, *amplitude});
  }
  if (tried.empty()) return {};
  const auto less = [](const SpeedAdvice& a, const SpeedAdvice& b) { return a.amplitude < b.amplitude; };
  const double best = std::min_element(tried.begin(), tried.end(), less)->amplitude;
  const auto off = [&](const SpeedAdvice& a) { return std::abs(a.spindle_speed - now.spindle_speed); };
  std::optional<SpeedAdvice> out;
  for (const SpeedAdvice& a : tried) {
    if (a.amplitude <= kAlmostBest * best && (!out || off(a) < off(*out))) out = a;
  }
  if (!now.unbounded && !(out->amplitude < kWorthIt * now.amplitude)) return {};
  return out;
}

}  // namespace

void CutPoints::add(const Sample& sample, const TeethView& teeth) {
  ++seen_;
  const std::pair<int, double> key(teeth.move.tool, teeth.move.spindle_speed);
  auto it = groups_.find(key);
  if (it == groups_.end()) {
    if (groups_.size() >= kMostSpeeds) {
      ++left_out_;
      return;
    }
    it = groups_.emplace(key, Group{}).first;
  }
  Group& group = it->second;
  if (group.seen++ % group.stride != 0) return;
  if (group.points.size() == kMost) {
    for (std::size_t i = 0; 2 * i < kMost; ++i) group.points[i] = group.points[2 * i];
    group.points.resize(kMost / 2);
    group.stride *= 2;  // kMost is even, so this point is the next in the wider row
  }
  group.points.push_back({sample, teeth.profile, teeth.feed, teeth.feed_per_tooth, teeth.end_cuts, teeth.move.block});
}

motion::PeriodicForce tooth_force(const Job& job, const CutPoint& point, int tool) {
  const cutting::Cutter& cutter = job.cutter_of(tool);
  if (!point.profile.any || !(point.profile.max_depth > 0)) return {};
  const int samples = std::clamp(kMostSamples / cutter.teeth, kFewestSamples, kSamples);
  const std::vector<cutting::DiscEngagement> discs = cutting::by_disc(point.profile, kDisc * cutter.diameter);
  const cutting::ForceHistory turn =
      cutting::force_history(cutter, job.material, discs, point.feed_per_tooth, samples * cutter.teeth);
  const std::vector<Vec3> tooth(turn.force.begin(), turn.force.begin() + samples);
  motion::PeriodicForce out = motion::harmonics_of(tooth, std::min(kMostHarmonics, samples / 3));
  // Each sample is the mean over its step, which holds back what changes within it by sin(x) / x.
  for (std::size_t k = 0; k < out.harmonics.size(); ++k) {
    const double x = std::numbers::pi * static_cast<double>(k + 1) / samples;
    out.harmonics[k] *= x / std::sin(x);
  }
  return motion::turned(cut_frame(job, point), out);
}

bool ProgramVibration::bounded() const {
  return std::none_of(speeds.begin(), speeds.end(), [](const SpeedVibration& s) { return s.unbounded.has_value(); });
}

std::vector<std::string> ProgramVibration::not_judged() const {
  std::vector<std::string> out;
  if (!bounded()) out.emplace_back("an undamped resonance has no steady state");
  if (end_points > 0) {
    out.push_back(fmt::format("at {} of {} points the end of the cutter cuts, and its force is taken as steady",
                              end_points, points));
  }
  if (left_out > 0) {
    out.push_back(fmt::format("{} points of cutters and spindle speeds after the first {} are left out", left_out,
                              CutPoints::kMostSpeeds));
  }
  if (other_position) out.emplace_back("the other position of block delete, which cuts too, is not looked at");
  return out;
}

double ProgramVibration::largest_with(const Prediction& prediction) const {
  return prediction.largest_with_corners + amplitude;
}

bool ProgramVibration::within(const Job& job, const Prediction& prediction) const {
  return prediction.within(job) && not_judged().empty() && largest_with(prediction) <= job.tolerance - resolution(job);
}

std::string no_vibration(const Job& job, const gcode::Interpretation& interpretation) {
  if (!statics::has_compliance(job.machine)) {
    return "the machine has no compliances of its own, from which its modes follow";
  }
  if (job.tool_frame.turns) return "the tool turns in cuts, and the modes are known for A = B = C = 0 alone";
  if (job.tool_frame.tilted) return "the tool is tilted, and the modes are known for A = B = C = 0 alone";
  const auto rounded = [&](const gcode::Move& move) {
    return move.kind != gcode::MoveKind::rapid && job.cutter_of(move.tool).corner_radius > 0;
  };
  if (std::any_of(interpretation.moves.begin(), interpretation.moves.end(), rounded))
    return "how the force of a cutter with a corner radius changes from tooth to tooth is not computed";
  return {};
}

Result<CutPoints> cut_points(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                             const PredictOptions& options) {
  POLYPOD_ASSIGN(accepted, accept(job, program, interpretation, {options.again, options.progress}));
  CutPoints out;
  cutting::Stock stock = job.stock;
  PassOptions pass;
  pass.bend = options.bend;
  pass.step = options.step > 0 ? options.step : job.step;
  pass.progress = options.progress;
  POLYPOD_TRY(run_pass_of_teeth(job, program, accepted.interpretation().moves, stock, pass,
                                [&](const Sample& sample, const TeethView& teeth) { out.add(sample, teeth); }));
  return out;
}

Result<ProgramVibration> vibration_of(const Job& job, const gcode::Program& program, const CutPoints& points,
                                      const Prediction& prediction, const motion::Dynamics& dynamics,
                                      std::optional<double> damping, const std::function<bool(double)>& progress) {
  ProgramVibration out;
  out.damping_assumed = !damping;
  out.damping = damping.value_or(kAssumedDamping);
  out.of = points.seen();
  out.left_out = points.left_out();
  out.other_position = prediction.other_switch && prediction.other_switch->cuts;
  if (job.measured) {
    out.notes.emplace_back(
        "the vibration follows from the compliances of the machine's parts, not from the measured ones");
  }
  const auto line_of = [&](const CutPoint& p) { return program.blocks[static_cast<std::size_t>(p.block)].line; };
  const Mat3 R_MT = cutting_orientation(job);
  statics::Probe probe(job.machine, R_MT, job.posture, job.start_joints);
  std::size_t done = 0, all = 0;
  for (const auto& [key, group] : points.groups()) all += group.points.size();
  double sum = 0;
  for (const auto& [key, group] : points.groups()) {
    const auto& [tool, speed] = key;
    const int teeth = job.cutter_of(tool).teeth;
    SpeedVibration now;
    now.tool = tool;
    now.spindle_speed = speed;
    now.tooth_passing = speed * teeth;
    std::vector<Judged> judged;
    double group_sum = 0;
    for (const CutPoint& point : group.points) {
      if (progress && !progress(static_cast<double>(done++) / static_cast<double>(all)))
        return fail("MC299", "cancelled");
      const Vec3 p = job.X_MW * point.sample.command;
      if (point.sample.joint_count > 0) probe.stand_at(point.sample.came_with());
      Mat3 C;
      if (!probe.at(p, C)) {
        return fail("MC210",
                    fmt::format("the machine cannot reach x {:.3f} y {:.3f} z {:.3f} mm in M: {}", units::to_mm(p.x()),
                                units::to_mm(p.y()), units::to_mm(p.z()), probe.why()),
                    {program.path, line_of(point), 1}, "move the workpiece origin");
      }
      const Pose X = kinematics::settled(job.machine, Pose{R_MT, p}, probe.joints());
      judged.push_back({&point, motion::modal_model(job.machine, dynamics, X, probe.joints()),
                        tooth_force(job, point, tool), cut_frame(job, point)});
      const Judged& at = judged.back();
      if (point.end_cuts) ++out.end_points;
      for (std::size_t r = 0; r < at.model.modes.size(); ++r) {
        const double f = at.model.modes[r].frequency;
        if (r >= out.natural.size()) out.natural.push_back({f, f});
        out.natural[r] = {std::min(out.natural[r].low, f), std::max(out.natural[r].high, f)};
      }
      ++now.points;
      if (now.unbounded) continue;
      const motion::Vibration v = steady_state(at.model, out.damping, at.force, now.tooth_passing, at.axes);
      if (v.unbounded) {
        const double natural = at.model.modes[static_cast<std::size_t>(v.unbounded->mode)].frequency;
        now.unbounded = NearMode{v.unbounded->harmonic, v.unbounded->mode, natural,
                                 now.tooth_passing * v.unbounded->harmonic / natural - 1, line_of(point)};
        continue;
      }
      if (v.amplitude > now.amplitude || now.line == 0) now.line = line_of(point);
      now.amplitude = std::max(now.amplitude, v.amplitude);
      now.across = std::max(now.across, v.peak.y());
      now.along_axis = std::max(now.along_axis, v.peak.z());
      group_sum += v.amplitude;
    }
    if (now.points == 0) continue;
    now.nearest = nearest_mode(judged, now.tooth_passing, line_of);
    if (now.unbounded) {
      now.amplitude = now.across = now.along_axis = 0;
      group_sum = 0;
    }
    now.mean = group_sum / static_cast<double>(now.points);
    now.advice = advice_for(judged, out.damping, teeth, now);
    out.points += now.points;
    sum += group_sum;
    if (now.amplitude > out.amplitude || out.line == 0) out.line = now.line;
    out.amplitude = std::max(out.amplitude, now.amplitude);
    out.across = std::max(out.across, now.across);
    out.along_axis = std::max(out.along_axis, now.along_axis);
    out.speeds.push_back(now);
  }
  if (out.points > 0) out.mean = sum / static_cast<double>(out.points);
  return out;
}

}  // namespace polypod::machining
