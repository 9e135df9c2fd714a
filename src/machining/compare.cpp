// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/compare.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

#include "modes.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/units.hpp"
#include "polypod/gcode/writer.hpp"
#include "polypod/machining/accept.hpp"
#include "polypod/machining/tilted.hpp"
#include "robot_errors.hpp"
#include "way.hpp"

namespace polypod::machining {
namespace {

// The step of the judge is at most this, m, as that of `correct`'s check.
constexpr double kCheckStep = 0.1e-3;
// Two distances that differ by less than this are taken as equal, m: the stock's cells move them by as much.
constexpr double kSameDistance = 1e-6;

/// A point of the commanded path that stands for a point of the programmed one.
struct Target {
  Vec3 wanted = Vec3::Zero();   ///< p, where the deflected tool should be
  Vec3 command = Vec3::Zero();  ///< x
  Vec3 axes = Vec3::Zero();     ///< A, B, C there, rad
};

/// A dense path of points, written as blocks and read back.
class DensePath {
 public:
  DensePath(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation)
      : job_(job), program_(program), interpretation_(interpretation), moves_(interpretation.moves) {}

  /// One pass along the programmed path; every point of a cutting move is moved by its deflection, and by what
  /// `errors` say besides.
  Status find(RobotErrorsOnWay* errors, Bend bend, double step, const std::function<bool(double)>& progress) {
    targets_.assign(moves_.size(), {});
    std::vector<bool> cuts(moves_.size(), false);
    cutting::Stock stock = job_.stock;
    PassOptions options;
    options.bend = bend;
    options.step = step;
    options.progress = progress;
    const auto visit = [&](const Sample& sample) {
      const auto i = static_cast<std::size_t>(sample.move);
      cuts[i] = cuts[i] || sample.cutting;
      const Vec3 besides = errors != nullptr ? errors->at(sample) : Vec3(Vec3::Zero());
      if (sample.s <= 0) return;  // the point from which the move starts belongs to the one before
      const Vec3 p = moves_[i].point(sample.s);
      const Vec3 off = to_correct(moves_[i], sample.deflection, job_.tool_frame.axis()) + besides;
      targets_[i].push_back({p, p - off, axes_at(moves_[i], sample.s)});
    };
    POLYPOD_ASSIGN(pass, run_pass(job_, program_, PassMoves(moves_), stock, options, visit));
    POLYPOD_TRY(no_rapid_cuts(job_, program_, pass));
    for (std::size_t i = 0; i < moves_.size(); ++i)
      if (!cuts[i]) targets_[i].clear();
    return write();
  }

  /// One pass of what was written; every command goes by what its point is off. The largest change, m.
  Result<double> correct_again(const std::function<bool(double)>& progress) {
    cutting::Stock stock = job_.stock;
    PassOptions options;
    options.bend = Bend::equilibrium;
    options.step = job_.step;
    options.progress = progress;
    double largest = 0;
    const auto visit = [&](const Sample& sample) {
      const auto c = static_cast<std::size_t>(sample.move);
      if (target_of_[c] == nullptr || sample.s < way_.moves[c].move.length()) return;
      Target& target = *target_of_[c];
      const Vec3 change = to_correct(moves_[static_cast<std::size_t>(way_.source[c])], sample.bent() - target.wanted,
                                     job_.tool_frame.axis());
      target.command -= change;
      largest = std::max(largest, change.norm());
    };
    POLYPOD_ASSIGN(pass, run_pass(job_, program_named_, way_.commanded(), stock, options, visit));
    (void)pass;
    POLYPOD_TRY(write());
    return largest;
  }

  [[nodiscard]] const Way& way() const { return way_; }
  [[nodiscard]] const gcode::Program& written() const { return written_; }
  /// The blocks that were written, with the lines of the original.
  [[nodiscard]] const gcode::Program& named() const { return program_named_; }

 private:
  Status write() {
    gcode::RewriteOptions options;
    options.interpret = job_.interpret_options();
    const gcode::Decimals decimals = gcode::decimals_of(program_, options);
    std::vector<gcode::Replacement> replacements;
    std::vector<std::vector<Target*>> kept(moves_.size());
    Vec3 stands = Vec3::Zero();
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      const gcode::Move& move = moves_[i];
      if (targets_[i].empty()) {
        stands = move.end;
        continue;
      }
      const double grain =
          move.inches ? units::from_inch(std::pow(10.0, -decimals.inch)) : units::from_mm(std::pow(10.0, -decimals.mm));
      const auto same = [&](const Vec3& a, const Vec3& b) {
        const Vec3 d = (a / grain).array().round() - (b / grain).array().round();
        return d.cwiseAbs().maxCoeff() < 0.5;
      };
      gcode::Replacement r;
      r.move = static_cast<int>(i);
      for (std::size_t k = 0; k < targets_[i].size(); ++k) {
        Target& target = targets_[i][k];
        const bool needed = k + 1 == targets_[i].size() && r.points.empty();
        if (same(target.command, stands) && !needed) continue;
        r.points.push_back({target.command, target.axes, {}});
        kept[i].push_back(&target);
        stands = target.command;
      }
      replacements.push_back(std::move(r));
    }
    POLYPOD_ASSIGN(rewritten, gcode::rewrite(program_, interpretation_, replacements, options));
    written_ = std::move(rewritten.program);
    return read_back(rewritten.source, kept);
  }

  /// Whether the first block of a move takes the command from one deflection to another, as behind a corner: the tool
  /// then follows as it yields (yield_step), like on the transitions of `correct`.
  static bool leans(const gcode::Move& block, const gcode::Move& programmed) {
    constexpr double kLeans = 0.1;  // rad, as PassOptions::smooth_angle
    const Vec3 along = programmed.direction(programmed.nearest(block.end));
    return block.length() > 0 && angle_between(block.direction(0), along) > kLeans;
  }

  Status read_back(const LongVector<int>& source, const std::vector<std::vector<Target*>>& kept) {
    POLYPOD_ASSIGN(run, gcode::interpret(written_, job_.interpret_options()));
    std::vector<int> move_of_block(program_.blocks.size(), -1);
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      move_of_block[static_cast<std::size_t>(moves_[i].block)] = static_cast<int>(i);
    }
    way_ = Way{&program_, &moves_, {}, {}};
    target_of_.clear();
    program_named_ = {};
    program_named_.path = program_.path;
    for (std::size_t b = 0; b < written_.blocks.size(); ++b) {
      gcode::Block named;
      named.line = program_.blocks[static_cast<std::size_t>(source[b])].line;
      program_named_.blocks.push_back(named);
    }
    std::vector<std::size_t> next(moves_.size(), 0);
    for (const gcode::Move& move : run.moves) {
      const int s = move_of_block[static_cast<std::size_t>(source[static_cast<std::size_t>(move.block)])];
      const auto i = static_cast<std::size_t>(s);
      if (s < 0 || (!kept[i].empty() && next[i] >= kept[i].size())) {
        return fail("MC220", "a block that was written does not read back as the move that was planned",
                    {program_.path, program_named_.blocks[static_cast<std::size_t>(move.block)].line, 1},
                    "please report this program");
      }
      const bool steps_over = !kept[i].empty() && next[i] == 0 && leans(move, moves_[i]);
      PassMove pass{move, steps_over, kept[i].empty() || steps_over ? nullptr : &moves_[i]};
      if (!move.start_known && moves_[i].start_known) {
        pass.move.start = moves_[i].start;
        pass.move.start_known = true;
      }
      way_.moves.push_back(pass);
      way_.source.push_back(s);
      target_of_.push_back(kept[i].empty() ? nullptr : kept[i][next[i]++]);
    }
    return {};
  }

  const Job& job_;
  const gcode::Program& program_;
  const gcode::Interpretation& interpretation_;
  const LongVector<gcode::Move>& moves_;
  std::vector<std::vector<Target>> targets_;  // by move
  gcode::Program written_, program_named_;
  Way way_;
  std::vector<Target*> target_of_;  // by commanded move
};

class Comparison {
 public:
  Comparison(const Job& job, const gcode::Program& program, const Accepted& accepted, const CompareOptions& options)
      : job_(job), program_(program), interpretation_(accepted.interpretation()), options_(options) {}

  Result<std::vector<MethodOutcome>> run() {
    std::vector<MethodOutcome> out;
    for (const Method method : {Method::none, Method::tube, Method::mirror, Method::comet, Method::abele}) {
      POLYPOD_ASSIGN(outcome, of(method));
      if (!out.empty()) {
        const auto normal = [](const MethodOutcome& m) {
          return std::max(std::abs(m.normal.min), std::abs(m.normal.max));
        };
        const MethodOutcome& none = out.front();
        outcome.worse =
            outcome.distance > none.distance + kSameDistance || normal(outcome) > normal(none) + kSameDistance;
        if (outcome.with_robot_errors)
          outcome.worse = outcome.worse || *outcome.with_robot_errors > *none.with_robot_errors + kSameDistance;
      }
      out.push_back(std::move(outcome));
    }
    return out;
  }

 private:
  using Clock = std::chrono::steady_clock;

  std::function<bool(double)> progress(const char* what) const {
    if (!options_.progress) return {};
    return [this, what](double share) { return options_.progress(what, share); };
  }

  Result<MethodOutcome> of(Method method) {
    switch (method) {
      case Method::none:
        return as_it_is();
      case Method::tube:
      case Method::mirror:
        return corrected(method);
      case Method::comet:
      case Method::abele:
        break;
    }
    return dense(method);
  }

  Status judge(const gcode::Program& named, const Way& way, MethodOutcome& out) {
    PredictOptions options;
    options.step = std::min(job_.step, kCheckStep);
    options.progress = progress("judging");
    POLYPOD_ASSIGN(p, predict_way(job_, named, way, options, scratch_));
    if (p.moves.empty()) return tl::unexpected(cuts_nothing(job_, program_, interpretation_));
    p.slow = corners_of(job_, named, way, p, job_.tolerance - resolution(job_)).slow;
    take(p, out);
    return judge_with_errors(named, way, out);
  }

  /// The same with what the robot's own errors do to every point.
  Status judge_with_errors(const gcode::Program& named, const Way& way, MethodOutcome& out) {
    if (!job_.robot_errors.any()) return {};
    RobotErrorsOnWay errors(job_, RobotErrorsOnWay::Play::as_it_is);
    PredictOptions options;
    options.step = std::min(job_.step, kCheckStep);
    options.progress = progress("judging with the robot's errors");
    POLYPOD_ASSIGN(p, predict_way(job_, named, way, options, scratch_, [&](const Sample& s) { return errors.at(s); }));
    out.with_robot_errors = p.largest_distance;
    if (!errors.all_known()) {
      out.judged = false;
      out.notes.emplace_back(
          "the robot's errors are not known at every point: joints or signature file have no pose there");
    }
    out.inside = out.inside && p.largest_distance <= job_.tolerance - resolution(job_);
    return {};
  }

  void take(const Prediction& p, MethodOutcome& out) const {
    out.normal = p.normal;
    out.distance = p.largest_distance;
    out.judged = p.all_judged();
    out.inside = p.not_judged.empty() && out.distance <= job_.tolerance - resolution(job_);
  }

  Result<MethodOutcome> as_it_is() {
    MethodOutcome out;
    POLYPOD_TRY(judge(program_, way_as_programmed(program_, interpretation_.moves), out));
    out.lines = program_.blocks.size();
    out.text = gcode::to_text(program_);
    return out;
  }

  /// By `correct`, which judges what it writes as `judge` does.
  Result<MethodOutcome> corrected(Method method) {
    MethodOutcome out;
    out.method = method;
    CorrectOptions options;
    options.method = method == Method::mirror ? CorrectMethod::mirror : CorrectMethod::tube;
    options.mirror_points = options_.mirror_points;
    options.again = options_.again;
    options.remedies = false;
    options.progress = options_.progress;
    const auto begin = Clock::now();
    POLYPOD_ASSIGN(c, correct(job_, program_, interpretation_, options));
    out.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    take(c.after, out);
    if (const auto& other = c.other_switch; other && !other->fixed && !other->within_tolerance) {
      out.inside = false;
      out.notes.push_back(fmt::format("with block delete {} the tool is up to {:.1f} um from the path{}",
                                      other->block_delete ? "on" : "off", units::to_um(other->distance_after),
                                      other->reason.empty() ? "" : ": " + other->reason));
    }
    out.lines = c.lines_out;
    out.rounds = method == Method::mirror ? 1 : c.rounds;
    out.text = c.text();
    const Way way{&c.program, &c.programmed, std::move(c.commanded), std::move(c.source)};
    POLYPOD_TRY(judge_with_errors(c.program, way, out));
    if (method == Method::tube) {
      out.notes.emplace_back("its time holds its own checks of what it writes");
    }
    return out;
  }

  Result<MethodOutcome> dense(Method method) {
    MethodOutcome out;
    out.method = method;
    const double step = options_.point_step > 0 ? options_.point_step : job_.step;
    DensePath path(job_, program_, interpretation_);
    const auto begin = Clock::now();
    const Bend bend = method == Method::comet ? Bend::at_rest : Bend::equilibrium;
    RobotErrorsOnWay errors(job_, RobotErrorsOnWay::Play::taken_up);
    const bool besides = method == Method::comet && job_.robot_errors.any();
    POLYPOD_TRY(path.find(besides ? &errors : nullptr, bend, step, progress("finding points")));
    out.rounds = 1;
    if (method == Method::abele) {
      double change = 0, before = 0;
      while (out.rounds < options_.abele_rounds) {
        POLYPOD_ASSIGN(largest, path.correct_again(progress("correcting what remains")));
        ++out.rounds;
        before = change;
        change = largest;
        if (largest < options_.settled) break;
      }
      if (change >= options_.settled) {
        out.notes.push_back(fmt::format("after {} rounds some point still moves by {:.1f} um{}", out.rounds,
                                        units::to_um(change),
                                        before > 0 && change > 0.9 * before ? ", and no less than before" : ""));
      }
    }
    out.text = gcode::to_text(path.written());
    out.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    out.lines = path.written().blocks.size();
    POLYPOD_TRY(judge(path.named(), path.way(), out));
    return out;
  }

  const Job& job_;
  const gcode::Program& program_;
  const gcode::Interpretation& interpretation_;
  const CompareOptions& options_;
  cutting::Stock scratch_;
};

}  // namespace

const char* name_of(Method method) {
  switch (method) {
    case Method::none:
      return "none";
    case Method::tube:
      return "tube";
    case Method::mirror:
      return "mirror";
    case Method::comet:
      return "comet";
    case Method::abele:
      break;
  }
  return "abele";
}

std::string description_of(Method method, const Job& job) {
  switch (method) {
    case Method::none:
      return "no correction";
    case Method::tube:
      return "polypod correct: as few blocks as keep the deflected tool in the tube";
    case Method::mirror:
      return "Derince: N points a move, each mirrored at the programmed path; every point is moved, also those within "
             "the tolerance";
    case Method::comet: {
      const RobotErrors& errors = job.robot_errors;
      std::vector<std::string> given, missing;
      const auto sort = [&](bool there, const char* what) { (there ? given : missing).emplace_back(what); };
      sort(!errors.backlash.empty(), "backlash");
      sort(!errors.friction.empty(), "friction");
      sort(errors.signature != nullptr, "signature file");
      std::string out =
          "COMET's sequence: engagement, force and deflection at every point, each point moved by it once";
      if (given.empty()) out += "; only its step for compliance";
      if (!given.empty()) out += fmt::format(", and by what {} {}", listed(given), given.size() == 1 ? "does" : "do");
      if (!missing.empty()) out += fmt::format("; without {}, for which no data are given", listed(missing));
      return out;
    }
    case Method::abele:
      break;
  }
  return "Abele: force and deflection coupled, every point moved by what remains, again and again; static, without "
         "the masses of the arm";
}

Result<std::vector<MethodOutcome>> compare_methods(const Job& job, const gcode::Program& program,
                                                   const gcode::Interpretation& interpretation,
                                                   const CompareOptions& options) {
  std::function<bool(double)> progress;
  if (options.progress) progress = [&](double share) { return options.progress("checking the reach", share); };
  POLYPOD_ASSIGN(accepted, accept(job, program, interpretation, {options.again, progress}));
  POLYPOD_ASSIGN(out, Comparison(job, program, accepted, options).run());
  for (std::string& note : accepted.notes) out.front().notes.push_back(std::move(note));
  if (std::string friction = friction_without_effect(job); !friction.empty()) {
    for (MethodOutcome& m : out) m.judged = false;
    out.front().notes.push_back(std::move(friction));
  }
  return out;
}

}  // namespace polypod::machining
