// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "vibration_output.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "machining_output.hpp"
#include "masses_options.hpp"
#include "messages.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"

namespace polypod::app {
namespace {

using machining::NearMode;
using machining::ProgramVibration;
using machining::SpeedVibration;
using units::to_per_min;
using units::to_um;

// Two figures: damping is hardly ever known to more.
std::string um(double m) {
  return figure(to_um(m), 0, 2);
}
std::string hz(double f) {
  return figure(f, 0, 3);
}

Json near_json(const std::optional<NearMode>& n) {
  if (!n) return {};
  return {{"harmonic", n->harmonic},
          {"mode", n->mode + 1},
          {"natural_frequency_Hz", n->natural},
          {"apart_percent", 100 * n->apart},
          {"line", n->line}};
}

Json speed_json(const SpeedVibration& s) {
  const auto figure_of = [&](double m) { return s.unbounded ? Json() : Json(to_um(m)); };
  Json advice;
  if (s.advice) {
    advice = {{"spindle_rev_per_min", to_a_millionth(to_per_min(s.advice->spindle_speed))},
              {"feed_factor", s.advice->feed_factor},
              {"vibration_um", to_um(s.advice->amplitude)}};
  }
  return {{"tool", s.tool},
          {"spindle_rev_per_min", to_a_millionth(to_per_min(s.spindle_speed))},
          {"tooth_passing_Hz", s.tooth_passing},
          {"points", s.points},
          {"max_um", figure_of(s.amplitude)},
          {"mean_um", figure_of(s.mean)},
          {"across_path_um", figure_of(s.across)},
          {"along_axis_um", figure_of(s.along_axis)},
          {"line", s.line > 0 ? Json(s.line) : Json()},
          {"undamped_resonance", near_json(s.unbounded)},
          {"nearest", near_json(s.nearest)},
          {"advice", advice}};
}

std::string near_text(const SpeedVibration& s) {
  if (s.unbounded) {
    return fmt::format("its harmonic {} is natural frequency {} ({} Hz, line {}): undamped, there is no steady state",
                       s.unbounded->harmonic, s.unbounded->mode + 1, hz(s.unbounded->natural), s.unbounded->line);
  }
  if (!s.nearest) return "no force that changes";
  const double apart = 100 * std::abs(s.nearest->apart);
  constexpr double kSame = 0.5, kFar = 100;  // %
  const std::string how = apart < kSame   ? std::string("at")
                          : apart >= kFar ? fmt::format("{} times the", figure(1 + s.nearest->apart, 1, 2))
                                          : fmt::format("{:.0f} % {}", apart, s.nearest->apart > 0 ? "above" : "below");
  return fmt::format("harmonic {} is {} natural frequency {} ({} Hz, line {})", s.nearest->harmonic, how,
                     s.nearest->mode + 1, hz(s.nearest->natural), s.nearest->line);
}

}  // namespace

void VibrationQuestion::declare(Arguments& a) {
  a.option("--dynamics", dynamics, "A file with the table `dynamics`: masses (default: that of the machine file)");
  a.flag("--vibration", counts,
         "Count the vibration at tooth passing against the tolerance (default: it stands beside the answer)");
}

Status VibrationQuestion::prepare(const machining::Job& job, const gcode::Interpretation& interpretation,
                                  const Context& context) {
  POLYPOD_ASSIGN(masses, masses_of_job(job, dynamics, context));
  why_not_ = masses.why_not;
  if (masses.dynamics && why_not_.empty()) why_not_ = machining::no_vibration(job, interpretation);
  if (!why_not_.empty()) {
    if (!counts) return {};
    return fail("AP280", "--vibration cannot be counted: " + why_not_, {},
                masses.dynamics ? "leave --vibration out"
                                : "give masses in the machine file or by --dynamics (docs/motion.md), or leave "
                                  "--vibration out");
  }
  masses_ = std::move(masses.dynamics);
  POLYPOD_ASSIGN(damping, motion::read_damping(dynamics.empty() ? machine_file_of(job) : dynamics));
  damping_ = damping;
  return {};
}

Status VibrationQuestion::answer(const machining::Job& job, const gcode::Program& program,
                                 const gcode::Interpretation& interpretation, const machining::Prediction& prediction,
                                 machining::PredictOptions options, const Context& context) {
  if (!masses_) return {};
  options.progress = progress_line(context, "looking at the teeth");
  POLYPOD_ASSIGN(points, machining::cut_points(job, program, interpretation, options));
  options.progress(1);
  const auto progress = progress_line(context, "vibration");
  POLYPOD_ASSIGN(found, machining::vibration_of(job, program, points, prediction, *masses_, damping_, progress));
  progress(1);
  found_ = std::move(found);
  return {};
}

bool VibrationQuestion::within(const machining::Job& job, const machining::Prediction& prediction) const {
  return counts && found_ ? found_->within(job, prediction) : prediction.within(job);
}

std::string VibrationQuestion::against(const machining::Job& job, const machining::Prediction& prediction) const {
  if (within(job, prediction) || !prediction.within(job)) return "";
  if (!found_->bounded()) return "The vibration is without bound: an undamped machine in resonance.";
  const double sum = found_->largest_with(prediction);
  if (sum <= job.tolerance - machining::resolution(job)) return "Not all of the cut is judged for its vibration.";
  return fmt::format("With the vibration at tooth passing the tool is up to {:.1f} um from the programmed path.",
                     to_um(sum));
}

void VibrationQuestion::add_to(Json& document, const machining::Prediction& prediction) const {
  if (!found_) {
    document["vibration_um"] = Json();
    document["vibration"] = {{"judged", false}, {"counted", false}, {"why_not", why_not_}};
    return;
  }
  const ProgramVibration& v = *found_;
  const bool bounded = v.bounded();
  document["vibration_um"] = bounded ? Json{{"max", to_um(v.amplitude)}, {"mean", to_um(v.mean)}} : Json();
  Json natural = Json::array(), speeds = Json::array();
  for (const ProgramVibration::Range& r : v.natural) natural.push_back({{"min", r.low}, {"max", r.high}});
  for (const SpeedVibration& s : v.speeds) speeds.push_back(speed_json(s));
  document["vibration"] = {{"judged", true},
                           {"counted", counts},
                           {"across_path_um", bounded ? Json(to_um(v.across)) : Json()},
                           {"along_axis_um", bounded ? Json(to_um(v.along_axis)) : Json()},
                           {"distance_with_vibration_um", bounded ? Json(to_um(v.largest_with(prediction))) : Json()},
                           {"line", v.line > 0 ? Json(v.line) : Json()},
                           {"points", v.points},
                           {"of", v.of},
                           {"damping_ratio", v.damping},
                           {"damping_assumed", v.damping_assumed},
                           {"natural_frequencies_Hz", natural},
                           {"speeds", speeds},
                           {"not_judged", v.not_judged()},
                           {"notes", v.notes}};
}

void VibrationQuestion::print(const machining::Job& job, const machining::Prediction& prediction) const {
  if (!found_) {
    fmt::print("vibration      not judged, and not in the answer: {}\n", why_not_);
    return;
  }
  const ProgramVibration& v = *found_;
  const char* counted = counts ? "counted" : "not counted in the answer (--vibration counts it)";
  if (v.bounded()) {
    fmt::print("vibration      at tooth passing up to {} um (line {}), across the path up to {} um, {}\n",
               um(v.amplitude), v.line, um(v.across), counted);
  } else {
    fmt::print("vibration      without bound: an undamped machine in resonance, {}\n", counted);
  }
  std::vector<std::string> ranges;
  for (const ProgramVibration::Range& r : v.natural) {
    ranges.push_back(hz(r.low) == hz(r.high) ? hz(r.low) : fmt::format("{}..{}", hz(r.low), hz(r.high)));
  }
  fmt::print("               natural frequencies {} Hz, drives locked; damping ratio {:g}{}; at {} of {} points\n",
             fmt::join(ranges, ", "), v.damping, v.damping_assumed ? ", assumed" : "", v.points, v.of);
  constexpr std::size_t kMostShown = 8;
  for (std::size_t i = 0; i < std::min(kMostShown, v.speeds.size()); ++i) {
    const SpeedVibration& s = v.speeds[i];
    fmt::print("               T{} at {} rev/min: teeth pass at {} Hz, {}{}\n", s.tool,
               figure(to_per_min(s.spindle_speed), 0, 2), hz(s.tooth_passing),
               s.unbounded || v.speeds.size() == 1 ? "" : fmt::format("up to {} um, ", um(s.amplitude)), near_text(s));
    if (s.advice) {
      fmt::print(
          "               better: {} rev/min and all its feeds times {:.3f} (the same feed per tooth): up to {} um\n",
          figure(to_per_min(s.advice->spindle_speed), 0, 2), s.advice->feed_factor, um(s.advice->amplitude));
    }
  }
  if (v.speeds.size() > kMostShown)
    fmt::print("               {} speeds more, see --json\n", v.speeds.size() - kMostShown);
  for (const std::string& what : v.not_judged()) fmt::print("               not judged: {}\n", what);
  for (const std::string& note : v.notes) fmt::print("               {}\n", note);
  if (!counts || !v.bounded()) return;
  const double sum = v.largest_with(prediction);
  fmt::print("               with it up to {:.1f} um from the programmed path, {} the tolerance{}\n", to_um(sum),
             sum <= job.tolerance - machining::resolution(job) ? "within" : "beyond",
             sum <= job.tolerance - machining::resolution(job) && !v.within(job, prediction)
                 ? ", but not all of the cut is judged"
                 : "");
}

}  // namespace polypod::app
