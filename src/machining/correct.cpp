// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/machining/correct.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "polypod/core/units.hpp"
#include "polypod/gcode/writer.hpp"

namespace polypod::machining {
namespace {

/// The bend along one move as the ideal correction sees it.
struct Bends {
  std::vector<double> s;
  std::vector<Vec3> delta;
  bool cuts = false;
};

/// The points of one rewritten move; `transition` marks those whose piece is a joint.
struct Plan {
  std::vector<Vec3> points;
  std::vector<bool> transition;
  int pieces = 0;
};

class Corrector {
 public:
  Corrector(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
            const CorrectOptions& options)
      : job_(job),
        program_(program),
        interpretation_(interpretation),
        options_(options),
        moves_(interpretation.moves) {}

  Result<Correction> run() {
    out_.tolerance = job_.tolerance;
    out_.lines_in = program_.blocks.size();
    out_.programmed = moves_;
    PredictOptions predict_options;
    predict_options.keep_samples = options_.keep_samples;
    predict_options.progress = progress("predicting the program as it is");
    POLYPOD_ASSIGN(before, predict(job_, program_, interpretation_, predict_options));
    out_.before = std::move(before);
    POLYPOD_TRY(find_bends());
    fit_.assign(moves_.size(), options_.fit_share * job_.tolerance);
    choose_moves();
    for (out_.rounds = 1;; ++out_.rounds) {
      const std::vector<Plan> plans = plan_all();
      POLYPOD_TRY(write(plans));
      POLYPOD_TRY(check());
      if (out_.within_tolerance || out_.rounds >= options_.rounds || options_.method == CorrectMethod::mirror) break;
      if (!narrow()) break;
      // Knots are samples: a narrower tube in the ramps of corners needs closer ones.
      bends_step_ = std::max(0.5 * bends_step_, job_.stock.cell());
      POLYPOD_TRY(find_bends());
    }
    summarise();
    return std::move(out_);
  }

 private:
  std::function<bool(double)> progress(const char* what) const {
    if (!options_.progress) return {};
    return [this, what](double share) { return options_.progress(what, share); };
  }

  Status find_bends() {
    std::vector<PassMove> path;
    path.reserve(moves_.size());
    for (const gcode::Move& move : moves_) path.push_back({move});
    bends_.assign(moves_.size(), Bends{});
    cutting::Stock stock = job_.stock;
    PassOptions pass;
    pass.bend = options_.method == CorrectMethod::mirror ? Bend::at_rest : Bend::corrected;
    pass.step = bends_step_;
    pass.progress = progress("finding the ideal correction");
    const auto visit = [&](const Sample& sample) {
      Bends& b = bends_[static_cast<std::size_t>(sample.move)];
      b.s.push_back(sample.s);
      b.delta.push_back(sample.deflection);
      b.cuts = b.cuts || sample.cutting;
    };
    POLYPOD_ASSIGN(result, run_pass(job_, program_, path, stock, pass, visit));
    (void)result;
    return {};
  }

  /// Distance of p + delta from the move: across it between its ends, in full at the ends.
  double distance(std::size_t i, std::size_t k, const Vec3& off) const {
    const Bends& b = bends_[i];
    if (k == 0 || k + 1 == b.s.size()) return off.norm();
    const Vec3 along = moves_[i].direction(b.s[k]);
    return (off - along * along.dot(off)).norm();
  }

  /// Whether moves i and i + 1 both cut and meet: nothing lies between them.
  [[nodiscard]] bool meet(std::size_t i) const { return i + 1 < moves_.size() && bends_[i].cuts && bends_[i + 1].cuts; }

  void choose_moves() {
    rewritten_.assign(moves_.size(), false);
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (!bends_[i].cuts) continue;
      if (options_.method == CorrectMethod::mirror) rewritten_[i] = true;
      for (std::size_t k = 0; k < bends_[i].s.size() && !rewritten_[i]; ++k) {
        rewritten_[i] = distance(i, k, bends_[i].delta[k]) > fit_[i];
      }
    }
    spread_choice();
  }

  /// A move that may stay is still rewritten if it meets a rewritten one in a corner where it bends by more than the
  /// corner may jump: a step back to the programmed path would leave a mark.
  void spread_choice() {
    const double jump = options_.merge_share * job_.tolerance;
    for (std::size_t i = 0; i + 1 < moves_.size(); ++i) {
      if (meet(i) && rewritten_[i] && bends_[i + 1].delta.front().norm() > jump) rewritten_[i + 1] = true;
    }
    for (std::size_t i = moves_.size(); i-- > 1;) {
      if (meet(i - 1) && rewritten_[i] && bends_[i - 1].delta.back().norm() > jump) rewritten_[i - 1] = true;
    }
  }

  [[nodiscard]] Vec3 ideal(std::size_t i, std::size_t k) const {
    return moves_[i].point(bends_[i].s[k]) - bends_[i].delta[k];
  }

  struct PieceError {
    double largest = 0;  ///< m
    double squares = 0;  ///< m^2, summed over the samples after the first
  };

  /// Error of the straight piece from sample a (command A) to sample b (command B); gives up above `give_up`.
  PieceError piece_error(std::size_t i, std::size_t a, std::size_t b, const Vec3& A, const Vec3& B,
                         double give_up) const {
    const Bends& bend = bends_[i];
    PieceError error;
    for (std::size_t k = a; k <= b && error.largest <= give_up; ++k) {
      const double u = bend.s[b] > bend.s[a] ? (bend.s[k] - bend.s[a]) / (bend.s[b] - bend.s[a]) : 1.0;
      const Vec3 bent = A + (B - A) * u + bend.delta[k];
      const double d = distance(i, k, bent - moves_[i].point(bend.s[k]));
      error.largest = std::max(error.largest, d);
      if (k > a) error.squares += d * d;
    }
    return error;
  }

  /// The fewest pieces, each reaching as far as it can, from command `first` to command `last`; knots are samples.
  std::vector<std::size_t> greedy(std::size_t i, const Vec3& first, const Vec3& last, double allowed) const {
    const std::size_t end = bends_[i].s.size() - 1;
    std::vector<std::size_t> knots;
    std::size_t at = 0;
    Vec3 A = first;
    while (at < end) {
      const auto fits = [&](std::size_t to) {
        return piece_error(i, at, to, A, to == end ? last : ideal(i, to), allowed).largest <= allowed;
      };
      std::size_t good = at + 1;  // one step between neighbouring samples is always taken
      if (fits(end)) {
        good = end;
      } else {
        std::size_t reach = 2;
        while (at + reach < end && fits(at + reach)) {
          good = at + reach;
          reach *= 2;
        }
        std::size_t bad = std::min(at + reach, end);
        while (bad - good > 1) {
          const std::size_t mid = good + (bad - good) / 2;
          (fits(mid) ? good : bad) = mid;
        }
      }
      knots.push_back(good);
      at = good;
      A = ideal(i, at);
    }
    return knots;
  }

  std::vector<std::size_t> knots_of(std::size_t i, const Vec3& first, const Vec3& last) const {
    const std::size_t samples = bends_[i].s.size();
    if (options_.method == CorrectMethod::mirror) {
      std::vector<std::size_t> knots;
      const int n = options_.mirror_points;
      for (int j = 1; j <= n; ++j) {
        const std::size_t k = static_cast<std::size_t>(std::lround(double(samples - 1) * j / n));
        if (k > 0 && (knots.empty() || k > knots.back())) knots.push_back(k);
      }
      return knots;
    }
    std::vector<std::size_t> best = greedy(i, first, last, fit_[i]);
    // The same number of pieces with the smallest largest error.
    double low = 0, high = fit_[i];
    for (int j = 0; best.size() > 1 && j < 7; ++j) {
      const double mid = 0.5 * (low + high);
      std::vector<std::size_t> tighter = greedy(i, first, last, mid);
      if (tighter.size() <= best.size()) {
        best = std::move(tighter);
        high = mid;
      } else {
        low = mid;
      }
    }
    smooth(i, first, last, best);
    return best;
  }

  /// Moves the knots, whose number stays, to where the squared error is smallest and the largest error still allowed:
  /// a long piece that reaches into a ramp would else be off along its whole length. Descent knot by knot, steps of
  /// powers of two.
  void smooth(std::size_t i, const Vec3& first, const Vec3& last, std::vector<std::size_t>& knots) const {
    const std::size_t end = bends_[i].s.size() - 1;
    const double allowed = fit_[i];
    const auto command = [&](std::size_t k) { return k == 0 ? first : k == end ? last : ideal(i, k); };
    constexpr int kSweeps = 12;
    bool moved = knots.size() > 1;
    for (int sweep = 0; moved && sweep < kSweeps; ++sweep) {
      moved = false;
      for (std::size_t j = 0; j + 1 < knots.size(); ++j) {
        const std::size_t a = j == 0 ? 0 : knots[j - 1], b = knots[j + 1];
        const auto cost = [&](std::size_t k) -> std::optional<double> {
          const PieceError left = piece_error(i, a, k, command(a), command(k), allowed);
          if (left.largest > allowed) return std::nullopt;
          const PieceError right = piece_error(i, k, b, command(k), command(b), allowed);
          if (right.largest > allowed) return std::nullopt;
          return left.squares + right.squares;
        };
        std::optional<double> here = cost(knots[j]);
        const std::size_t from = knots[j];
        for (std::size_t step = 1; step < b - a; step *= 2) {
          for (const std::size_t k : {from + step, from - std::min(from, step)}) {
            if (k <= a || k >= b) continue;
            const std::optional<double> there = cost(k);
            if (!there || (here && *there >= *here)) continue;
            here = there;
            knots[j] = k;
            moved = true;
          }
        }
      }
    }
  }

  std::vector<Plan> plan_all() const {
    std::vector<Plan> plans(moves_.size());
    const double jump = options_.merge_share * job_.tolerance;
    std::optional<Vec3> shared;  // the corner that the last rewritten move agreed on with this one
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (!rewritten_[i]) {
        shared.reset();
        continue;
      }
      const gcode::Move& move = moves_[i];
      const Bends& bend = bends_[i];
      Plan& plan = plans[i];
      Vec3 first = move.start;
      if (shared) {
        first = *shared;
      } else if (bend.delta.front().norm() > jump) {
        first = move.start - bend.delta.front();
        plan.points.push_back(first);
        plan.transition.push_back(true);
      }
      shared.reset();
      Vec3 last = move.end;
      bool release = false;
      const bool next_too = meet(i) && rewritten_[i + 1];
      if (next_too && (bend.delta.back() - bends_[i + 1].delta.front()).norm() <= jump) {
        last = move.end - 0.5 * (bend.delta.back() + bends_[i + 1].delta.front());
        shared = last;
      } else if (bend.delta.back().norm() > jump) {
        last = move.end - bend.delta.back();
        release = !next_too;  // let the load go on the spot before the tool leaves
      } else if (next_too) {
        last = move.end;
      }
      for (const std::size_t k : knots_of(i, first, last)) {
        plan.points.push_back(k + 1 == bend.s.size() ? last : ideal(i, k));
        plan.transition.push_back(false);
        ++plan.pieces;
      }
      if (release) {
        plan.points.push_back(move.end);
        plan.transition.push_back(true);
      }
    }
    return plans;
  }

  Status write(const std::vector<Plan>& plans) {
    gcode::RewriteOptions rewrite_options;
    rewrite_options.interpret = job_.interpret_options();
    const gcode::Decimals decimals = gcode::decimals_of(program_, rewrite_options);
    std::vector<gcode::Replacement> replacements;
    // A point that rounds onto the one before it gets no block: drop it here, so that blocks and points stay in step.
    std::vector<std::vector<bool>> written(moves_.size());
    out_.pieces = out_.transitions = out_.rewritten_moves = 0;
    Vec3 stands = Vec3::Zero();
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (!rewritten_[i]) {
        stands = moves_[i].end;
        continue;
      }
      gcode::Replacement r;
      r.move = static_cast<int>(i);
      const double grain = moves_[i].inches ? units::from_inch(std::pow(10.0, -decimals.inch))
                                            : units::from_mm(std::pow(10.0, -decimals.mm));
      const auto rounded = [&](const Vec3& p) { return Vec3((p / grain).array().round() * grain); };
      for (std::size_t j = 0; j < plans[i].points.size(); ++j) {
        const bool last = j + 1 == plans[i].points.size();
        if ((rounded(plans[i].points[j]) - rounded(stands)).cwiseAbs().maxCoeff() < 0.5 * grain &&
            !(last && r.points.empty())) {
          continue;
        }
        r.points.push_back({plans[i].points[j], moves_[i].axes_end});
        written[i].push_back(plans[i].transition[j]);
        stands = plans[i].points[j];
      }
      ++out_.rewritten_moves;
      replacements.push_back(std::move(r));
    }
    POLYPOD_ASSIGN(rewritten, gcode::rewrite(program_, interpretation_, replacements, rewrite_options));
    std::vector<std::string> header{
        fmt::format("Polypod: corrected for the static compliance of {}", machine::name_of(job_.machine)),
        fmt::format("Polypod: tube radius {:g} um, cutter {:g} mm with {} teeth, origin X{:g} Y{:g} Z{:g} mm",
                    units::to_um(job_.tolerance), units::to_mm(job_.cutter.diameter), job_.cutter.teeth,
                    units::to_mm(job_.X_MW.p.x()), units::to_mm(job_.X_MW.p.y()), units::to_mm(job_.X_MW.p.z())),
        fmt::format("Polypod: {} of {} moves rewritten, do not correct again", out_.rewritten_moves, moves_.size())};
    if (job_.measured) {
      header.insert(header.begin() + 1,
                    fmt::format("Polypod: compliance interpolated from {} measured points", job_.measured->map.size()));
    }
    const gcode::Program with_header = gcode::with_header(rewritten.program, header);
    out_.text = gcode::to_text(with_header);
    // From here on only what was written counts.
    POLYPOD_ASSIGN(back, gcode::parse(out_.text, program_.path + " (corrected)"));
    out_.program = std::move(back);
    out_.lines_out = out_.program.blocks.size();
    POLYPOD_ASSIGN(run, gcode::interpret(out_.program, job_.interpret_options()));
    return match(run, rewritten, with_header.blocks.size() - rewritten.program.blocks.size(), written);
  }

  /// Finds for every move that was read back the programmed move it stands for, and whether it is a transition.
  Status match(const gcode::Interpretation& run, const gcode::Rewritten& rewritten, std::size_t added,
               const std::vector<std::vector<bool>>& written) {
    std::size_t header_at = 0;
    while (header_at < rewritten.program.blocks.size() &&
           rewritten.program.blocks[header_at].text == out_.program.blocks[header_at].text) {
      ++header_at;
    }
    std::vector<int> move_of_block(program_.blocks.size(), -1);
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      move_of_block[static_cast<std::size_t>(moves_[i].block)] = static_cast<int>(i);
    }
    std::vector<std::size_t> next_point(moves_.size(), 0);
    out_.commanded.clear();
    out_.source.clear();
    for (const gcode::Move& move : run.moves) {
      std::size_t block = static_cast<std::size_t>(move.block);
      if (block >= header_at) block -= added;
      const int source = move_of_block[static_cast<std::size_t>(rewritten.source[block])];
      if (source < 0) return mismatch(move);
      bool transition = false;
      const std::size_t i = static_cast<std::size_t>(source);
      if (rewritten_[i]) {
        if (next_point[i] >= written[i].size()) return mismatch(move);
        transition = written[i][next_point[i]++];
        ++(transition ? out_.transitions : out_.pieces);
      }
      out_.commanded.push_back({move, transition, rewritten_[i] && !transition ? &moves_[i] : nullptr});
      out_.source.push_back(source);
    }
    return {};
  }

  Status mismatch(const gcode::Move& move) const {
    return fail("MC220", "a block that was written does not read back as the move that was planned",
                Place{out_.program.path, out_.program.blocks[static_cast<std::size_t>(move.block)].line, 1},
                "please report this program");
  }

  Status check() {
    Prediction& after = out_.after;
    after = Prediction{};
    outcome_.assign(moves_.size(), MoveOutcome{});
    cutting::Stock stock = job_.stock;
    PassOptions pass;
    pass.bend = Bend::equilibrium;
    pass.step = std::min(job_.step, 0.5e-3);
    pass.progress = progress("checking what was written");
    const auto visit = [&](const Sample& sample) {
      if (!sample.cutting) {
        if (options_.keep_samples) after.samples.push_back(sample);
        return;
      }
      const std::size_t c = static_cast<std::size_t>(sample.move);
      const std::size_t i = static_cast<std::size_t>(out_.source[c]);
      const gcode::Move& programmed = moves_[i];
      const Vec3 bent = sample.bent();
      PathError e = path_error(programmed, bent, sample.away);
      MoveOutcome& outcome = outcome_[i];
      if (out_.commanded[c].transition) {
        // A joint belongs to the moves that it joins.
        if (i > 0 && bends_[i - 1].cuts)
          e.distance = std::min(e.distance, path_error(moves_[i - 1], bent, sample.away).distance);
        if (i + 1 < moves_.size() && bends_[i + 1].cuts) {
          e.distance = std::min(e.distance, path_error(moves_[i + 1], bent, sample.away).distance);
        }
        outcome.distance_after = std::max(outcome.distance_after, e.distance);
        if (options_.keep_samples) after.samples.push_back(judged(sample, e));
        return;
      }
      const bool first =
          sample.s == 0 && (c == 0 || out_.source[c - 1] != out_.source[c] || out_.commanded[c - 1].transition);
      const bool last =
          sample.s >= out_.commanded[c].move.length() &&
          (c + 1 == out_.source.size() || out_.source[c + 1] != out_.source[c] || out_.commanded[c + 1].transition);
      if (first) e.distance = std::max(e.distance, (bent - programmed.start).norm());
      if (last) e.distance = std::max(e.distance, (bent - programmed.end).norm());
      if (options_.keep_samples) after.samples.push_back(judged(sample, e));
      outcome.normal_after.add(e.normal);
      outcome.distance_after = std::max(outcome.distance_after, e.distance);
      after.deflection.add(sample.deflection.norm());
      after.normal.add(e.normal);
      after.vertical.add(e.vertical);
    };
    POLYPOD_ASSIGN(result, run_pass(job_, out_.program, out_.commanded, stock, pass, visit));
    after.pass = std::move(result);
    out_.largest_distance = 0;
    std::size_t worst = 0;
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (outcome_[i].distance_after <= out_.largest_distance) continue;
      out_.largest_distance = outcome_[i].distance_after;
      worst = i;
    }
    after.largest_distance = out_.largest_distance;
    out_.within_tolerance = out_.largest_distance <= job_.tolerance;
    out_.reason.clear();
    if (!out_.within_tolerance) {
      out_.reason =
          fmt::format("line {}: the bent tool is up to {:.1f} um from the programmed move, the tolerance is {:g} um",
                      line_of(worst), units::to_um(out_.largest_distance), units::to_um(job_.tolerance));
    }
    return {};
  }

  /// Narrower tubes for the moves that the check found outside; false if there is nothing left to try.
  bool narrow() {
    bool changed = false;
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (outcome_[i].distance_after <= job_.tolerance) continue;
      if (!rewritten_[i]) {
        rewritten_[i] = true;
        changed = true;
      } else if (fit_[i] > 0.02 * job_.tolerance) {
        fit_[i] *= 0.5;
        changed = true;
      }
    }
    spread_choice();
    return changed;
  }

  [[nodiscard]] int line_of(std::size_t i) const {
    return program_.blocks[static_cast<std::size_t>(moves_[i].block)].line;
  }

  void summarise() {
    std::vector<const MovePrediction*> before(program_.blocks.size(), nullptr);
    for (const MovePrediction& m : out_.before.moves) before[static_cast<std::size_t>(m.block)] = &m;
    for (std::size_t c = 0; c < out_.source.size(); ++c) {
      const std::size_t i = static_cast<std::size_t>(out_.source[c]);
      if (!rewritten_[i]) continue;
      ++(out_.commanded[c].transition ? outcome_[i].transitions : outcome_[i].pieces);
    }
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (!bends_[i].cuts) continue;
      MoveOutcome outcome = outcome_[i];
      outcome.line = line_of(i);
      outcome.rewritten = rewritten_[i];
      outcome.length = moves_[i].length();
      if (const MovePrediction* b = before[static_cast<std::size_t>(moves_[i].block)]) {
        outcome.normal_before = b->normal;
        outcome.distance_before = b->largest_distance;
      }
      out_.moves.push_back(outcome);
    }
    out_.after.notes = pass_notes(out_.program, out_.after.pass);
  }

  const Job& job_;
  const gcode::Program& program_;
  const gcode::Interpretation& interpretation_;
  const CorrectOptions& options_;
  const std::vector<gcode::Move>& moves_;
  std::vector<Bends> bends_;
  double bends_step_ = job_.step;
  std::vector<double> fit_;
  std::vector<bool> rewritten_;
  std::vector<MoveOutcome> outcome_;
  Correction out_;
};

}  // namespace

Result<Correction> correct(const Job& job, const gcode::Program& program, const gcode::Interpretation& interpretation,
                           const CorrectOptions& options) {
  return Corrector(job, program, interpretation, options).run();
}

}  // namespace polypod::machining
