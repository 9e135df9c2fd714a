// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/predict.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "polypod/core/units.hpp"
#include "polypod/statics/compliance.hpp"

namespace polypod::machining {
namespace {

// Half of a 95 % interval in standard deviations.
constexpr double kHalf95 = 1.96;

/// Of any number of points in a row at most 200, at equal distances: where they are too many, every other goes.
class Few {
 public:
  void add(const Sample& sample) {
    if (seen_++ % stride_ != 0) return;
    if (kept_.size() == kMost) {
      for (std::size_t i = 0; 2 * i < kMost; ++i) kept_[i] = kept_[2 * i];
      kept_.resize(kMost / 2);
      stride_ *= 2;  // kMost is even, so this sample is the next in the wider row
    }
    kept_.push_back(sample);
  }
  std::vector<Sample> take() { return std::move(kept_); }

 private:
  static constexpr std::size_t kMost = 200;
  std::vector<Sample> kept_;
  std::size_t seen_ = 0, stride_ = 1;
};

}  // namespace

PathError path_error(const gcode::Move& programmed, const Vec3& bent, const Vec3& away) {
  const Vec3 off = bent - programmed.point(programmed.nearest(bent));
  return {off.dot(away), off.z(), off.norm()};
}

Sample judged(const Sample& sample, const PathError& error) {
  Sample out = sample;
  out.normal = static_cast<float>(error.normal);
  out.vertical = static_cast<float>(error.vertical);
  out.distance = static_cast<float>(error.distance);
  return out;
}

std::vector<std::string> pass_notes(const gcode::Program& program, const PassResult& pass) {
  std::vector<std::string> notes;
  int plunges = 0, first_plunge = 0;
  double plunged = 0;
  for (const Incident& incident : pass.incidents) {
    const int line = program.blocks[static_cast<std::size_t>(incident.block)].line;
    if (incident.kind == Incident::Kind::rapid_through_stock) {
      notes.push_back(fmt::format("{}:{}: G0 goes through {:.1f} mm3 of material", program.path, line,
                                  units::to_mm3(incident.volume)));
    } else {
      if (plunges++ == 0) first_plunge = line;
      plunged += incident.volume;
    }
  }
  if (plunges > 0) {
    notes.push_back(
        fmt::format("{} plunging moves (first in line {}) take {:.1f} mm3 with the end of the cutter: the "
                    "force model knows only its sides, so they are predicted without bend",
                    plunges, first_plunge, units::to_mm3(plunged)));
  }
  if (pass.not_converged > 0) {
    notes.push_back(fmt::format("the equilibrium of {} of {} points still moved by up to {:.2f} um", pass.not_converged,
                                pass.points, units::to_um(pass.largest_rest)));
  }
  return notes;
}

Result<Prediction> predict(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                           const PredictOptions& options) {
  std::vector<PassMove> moves;
  moves.reserve(interpretation.moves.size());
  for (const gcode::Move& move : interpretation.moves) moves.push_back({move});
  Prediction out;
  cutting::Stock stock = job.stock;
  PassOptions pass_options;
  pass_options.bend = options.bend;
  pass_options.step = options.step > 0 ? options.step : job.step;
  pass_options.progress = options.progress;
  Few few;
  int current = -1;
  const auto visit = [&](const Sample& sample) {
    if (!sample.cutting) {
      if (options.keep_samples) out.samples.push_back(sample);
      return;
    }
    const gcode::Move& move = moves[static_cast<std::size_t>(sample.move)].move;
    if (sample.move != current) {
      current = sample.move;
      MovePrediction m;
      m.block = move.block;
      m.line = program.blocks[static_cast<std::size_t>(move.block)].line;
      m.length = move.length();
      out.moves.push_back(m);
    }
    MovePrediction& m = out.moves.back();
    const PathError e = path_error(move, sample.bent(), sample.away);
    if (options.keep_samples) out.samples.push_back(judged(sample, e));
    few.add(sample);
    ++m.points;
    m.deflection.add(sample.deflection.norm());
    m.normal.add(e.normal);
    m.vertical.add(e.vertical);
    m.largest_distance = std::max(m.largest_distance, e.distance);
    m.mean_force += (sample.force - m.mean_force) / static_cast<double>(m.points);
    m.largest_depth = std::max<double>(m.largest_depth, sample.depth);
    out.deflection.add(sample.deflection.norm());
    out.normal.add(e.normal);
    out.vertical.add(e.vertical);
    out.largest_distance = std::max(out.largest_distance, e.distance);
  };
  POLYPOD_ASSIGN(pass, run_pass(job, program, moves, stock, pass_options, visit));
  out.pass = std::move(pass);
  out.few = few.take();
  out.notes = interpretation.notes;
  for (std::string& note : pass_notes(program, out.pass)) out.notes.push_back(std::move(note));
  return out;
}

Result<ForceBand> force_band(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                             const Prediction& prediction, const PredictOptions& options) {
  ForceBand out;
  out.normal_by_move.assign(prediction.moves.size(), 0);
  PredictOptions quiet = options;
  quiet.keep_samples = false;
  for (const std::array<double, 6>& variation : job.material.spread) {
    Job varied = job;
    cutting::Material& m = varied.material;
    m.ktc += variation[0];
    m.krc += variation[1];
    m.kac += variation[2];
    m.kte += variation[3];
    m.kre += variation[4];
    m.kae += variation[5];
    POLYPOD_ASSIGN(p, predict(varied, program, interpretation, quiet));
    const auto add = [](double& sum, double change) { sum = std::hypot(sum, change); };
    add(out.deflection_mean, p.deflection.mean - prediction.deflection.mean);
    add(out.deflection_max, p.deflection.max - prediction.deflection.max);
    add(out.normal_mean, p.normal.mean - prediction.normal.mean);
    for (std::size_t i = 0; i < std::min(p.moves.size(), out.normal_by_move.size()); ++i) {
      add(out.normal_by_move[i], p.moves[i].normal.mean - prediction.moves[i].normal.mean);
    }
  }
  return out;
}

MapBand map_band(const Job& job, const Prediction& prediction) {
  MapBand out;
  if (!job.measured) return out;
  const statics::MeasuredMap& map = job.measured->map;
  const bool joints = statics::has_compliance(job.machine);
  statics::Probe probe(job.machine, Mat3::Identity());
  for (const Sample& sample : prediction.few) {
    const Vec3 p = job.X_MW * sample.command, F = job.X_MW.R * sample.force, n = job.X_MW.R * sample.away;
    const Mat3 sd = map.deviation(p);
    double square = 0;
    for (int i = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) {
        const double lever = i == j ? n[i] * F[i] : n[i] * F[j] + n[j] * F[i];
        square += lever * lever * sd(i, j) * sd(i, j);
      }
    }
    out.normal.add(kHalf95 * std::sqrt(square));
    Mat3 C;
    if (joints && probe.at(p, C)) out.joints.add(((map.at(p) - C) * F).norm());
  }
  return out;
}

}  // namespace polypod::machining
