// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "corrector.hpp"

#include <cmath>
#include <thread>

#include "polypod/cutting/ball_stock.hpp"

namespace polypod::machining {
namespace {

// A tube is not worth narrowing further for a move below this share of the tolerance.
constexpr double kNarrowest = 0.02;
// A narrower tube that leaves more than this share of the distance did not help: something else is wrong there.
constexpr double kHelps = 0.98;
// How often moves that became worse are given back their text before the whole program is.
constexpr int kGiveBackRounds = 12;
// The step of the check is at most this, m.
constexpr double kCheckStep = 0.1e-3;
// Stocks up to this are cut by two passes at once, bytes.
constexpr std::size_t kLargestSecondStock = 200'000'000;
// A point of a ball or of a bull nose costs as much as so many of a flat cutter.
constexpr std::size_t kPointsOfABall = 60, kPointsOfABullNose = 10;

std::size_t bytes_of(const cutting::Stock& stock) {
  return stock.layers().size() * sizeof(float);
}

/// Distances become the larger of those of two passes over the same moves.
void take_larger(const Prediction& fine, Prediction& prediction) {
  for (std::size_t c = 0; c < fine.commanded_distance.size(); ++c) {
    prediction.commanded_distance[c] = std::max(prediction.commanded_distance[c], fine.commanded_distance[c]);
    prediction.commanded_ends[c].start |= fine.commanded_ends[c].start;
    prediction.commanded_ends[c].end |= fine.commanded_ends[c].end;
    Prediction::WithoutChips& known = prediction.commanded_without_chips[c];
    const Prediction::WithoutChips& seen = fine.commanded_without_chips[c];
    known = {std::max(known.start, seen.start), std::max(known.end, seen.end), std::max(known.at_rest, seen.at_rest)};
  }
  const std::size_t known = prediction.moves.size();
  std::size_t at = 0;  // both lists rise with the moves of the program
  for (const MovePrediction& m : fine.moves) {
    while (at < known && prediction.moves[at].move < m.move) ++at;
    if (at < known && prediction.moves[at].move == m.move) {
      MovePrediction& same = prediction.moves[at];
      same.largest_distance = std::max(same.largest_distance, m.largest_distance);
    } else {
      prediction.moves.push_back(m);
    }
  }
  if (prediction.moves.size() > known) {
    std::sort(prediction.moves.begin(), prediction.moves.end(),
              [](const auto& a, const auto& b) { return a.move < b.move; });
  }
  prediction.largest_distance = std::max(prediction.largest_distance, fine.largest_distance);
  prediction.not_judged.insert(prediction.not_judged.end(), fine.not_judged.begin(), fine.not_judged.end());
}

}  // namespace

/// The same pass in cells half as large at steps half as long, beside the coarse one where there is a processor for it.
class Corrector::FineLook {
 public:
  FineLook(Corrector& of, const gcode::Program& program, const Way& way)
      : of_(of), program_(program), way_(way), progress_(of.progress("looking again with finer cells")) {
    if (!of_.verifies()) return;
    of_.fine_job();  // made here: the work must not make it beside another
    if (std::thread::hardware_concurrency() < 2 || bytes_of(of_.fine_->stock) > kLargestSecondStock) return;
    aside_.emplace([this](const Aside::Progress& report) { return look(report); }, progress_);
  }
  /// Distances become the larger of the two.
  Status take_into(Prediction& coarse) {
    POLYPOD_TRY(aside_ ? aside_->result(progress_) : look(progress_));
    take_larger(fine_, coarse);
    return {};
  }

 private:
  Status look(const Aside::Progress& report) {
    PredictOptions options;
    options.step = 0.5 * of_.check_step();
    options.progress = report;
    POLYPOD_ASSIGN(seen, predict_way(*of_.fine_, program_, way_, options, of_.fine_scratch_));
    fine_ = std::move(seen);
    return {};
  }

  Corrector& of_;
  const gcode::Program& program_;
  const Way& way_;
  const std::function<bool(double)> progress_;
  Prediction fine_;
  std::optional<Aside> aside_;  // last: it ends before what it works on
};

bool has_balls(const Job& job) {
  return cutting::is_ball(job.cutter) ||
         std::any_of(job.cutters.begin(), job.cutters.end(), [](const auto& c) { return cutting::is_ball(c.second); });
}

std::size_t cost_of(const Job& job, const Correction& c) {
  const auto rounded = [](const cutting::Cutter& cutter) { return cutter.corner_radius > 0; };
  const bool any = rounded(job.cutter) || std::any_of(job.cutters.begin(), job.cutters.end(),
                                                      [&](const auto& tool) { return rounded(tool.second); });
  return c.after.pass.points * (has_balls(job) ? kPointsOfABall : any ? kPointsOfABullNose : 1);
}

void Corrector::scale_feeds(const std::vector<bool>& which, double factor) {
  feed_scale_.assign(moves_.size(), 1.0);
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    if (which[i]) feed_scale_[i] = factor;
  }
}

Vec3 Corrector::weight_at(const Vec3& p_W) const {
  return weight_ ? weight_->at(p_W).value_or(Vec3::Zero()) : Vec3::Zero();
}

double Corrector::check_step() const {
  return std::min(job_.step, kCheckStep);
}

Result<Correction> Corrector::run() {
  out_.tolerance = job_.tolerance;
  out_.lines_in = program_.blocks.size();
  out_.programmed = moves_;
  if (job_.weights) {
    POLYPOD_ASSIGN(weight, WeightDeflection::of(job_, job_.weights));
    weight_.emplace(std::move(weight));
  }
  POLYPOD_TRY(predict_and_find());
  fit_.assign(moves_.size(), options_.fit_share * job_.tolerance);
  choose_moves();
  POLYPOD_TRY(refine());
  if (options_.method == CorrectMethod::tube) {
    if (options_.all) POLYPOD_TRY(correct_the_rest());
    POLYPOD_TRY(give_back_what_got_worse());
    POLYPOD_TRY(share_corners_of_short_blocks());
    POLYPOD_TRY(chords_in_place_of_stops());
    POLYPOD_TRY(choose_modes());
  }
  POLYPOD_TRY(judge());
  if (options_.keep_stock) POLYPOD_TRY(leave_stock());
  return std::move(out_);
}

std::function<bool(double)> Corrector::progress(const char* what) const {
  if (!options_.progress) return {};
  return [this, what](double share) { return options_.progress(what, share); };
}

Way Corrector::as_programmed() const {
  Way way{&program_, &moves_, {}, {}};
  if (feed_scale_.empty()) return way;
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    way.moves.push_back({moves_[i], false, nullptr});
    way.moves.back().move.feed *= feed_scale_[i];
  }
  return way;
}

Status Corrector::predict_and_find() {
  if (bytes_of(job_.stock) > kLargestSecondStock) {
    const Status predicted = predict_as_it_is();
    POLYPOD_TRY(reached());
    POLYPOD_TRY(predicted);
    return find_deflections();
  }
  cutting::Stock scratch;
  const std::function<bool(double)> finding = progress("finding the ideal correction");
  Aside found([&](const Aside::Progress& report) { return find_deflections(scratch, report); }, finding);
  const Status predicted = predict_as_it_is();
  POLYPOD_TRY(reached());
  POLYPOD_TRY(predicted);
  return found.result(finding);
}

Status Corrector::reached() const {
  return reach_ != nullptr ? reach_->result(progress("checking the reach")) : Status{};
}

Status Corrector::predict_as_it_is() {
  if (known_before_ != nullptr) return keep_before(*known_before_);
  const Way way = as_programmed();
  PredictOptions options;
  options.step = check_step();
  options.keep_samples = options_.keep_samples;
  options.progress = progress("predicting the program as it is");
  if (reach_ != nullptr) options.progress = reach_->unless_failed(options.progress);
  FineLook fine(*this, program_, way);
  POLYPOD_ASSIGN(before, predict_way(job_, program_, way, options, scratch_));
  if (before.moves.empty()) return tl::unexpected(cuts_nothing(job_, program_, interpretation_));
  if (verifies()) POLYPOD_TRY(fine.take_into(before));
  return keep_before(std::move(before));
}

Status Corrector::keep_before(Prediction before) {
  out_.before = std::move(before);
  before_.assign(moves_.size(), 0);
  for (const MovePrediction& m : out_.before.moves) before_[static_cast<std::size_t>(m.move)] = m.largest_distance;
  return {};
}

Status Corrector::leave_stock() {
  PredictOptions options;
  options.step = check_step();
  options.progress = progress("cutting what is left");
  POLYPOD_ASSIGN(last, predict_way(job_, named_, way_, options, scratch_));
  (void)last;
  out_.stock_left = std::move(scratch_);
  return {};
}

const Job& Corrector::fine_job() {
  if (!fine_) {
    fine_.emplace(job_);
    fine_->stock = job_.stock.in_half_cells();
  }
  return *fine_;
}

Status Corrector::find_deflections() {
  return find_deflections(fit_finely_ ? fine_scratch_ : scratch_, progress("finding the ideal correction"));
}

Status Corrector::find_deflections(cutting::Stock& scratch, const std::function<bool(double)>& report) {
  const Job& job = fit_finely_ ? fine_job() : job_;
  const Way way = as_programmed();
  deflections_.clear(moves_.size());
  scratch = job.stock;
  PassOptions pass;
  pass.bend = options_.method == CorrectMethod::mirror ? Bend::at_rest : Bend::corrected;
  pass.step = sample_step_;
  pass.progress = report;
  int at = -1;
  bool beside = false;
  const auto visit = [&](const Sample& sample) {
    const auto i = static_cast<std::size_t>(sample.move);
    if (sample.move != std::exchange(at, sample.move)) beside = job.weights && meets_stock(job, moves_[i]);
    // The weight of the machine acts in the air as well, and would sink the tool into what was cut before.
    deflections_.add(i, sample.s,
                     sample.weight + to_correct(moves_[i], sample.deflection - sample.weight, job.tool_frame.axis()),
                     sample.cutting || beside);
  };
  POLYPOD_ASSIGN(result, run_pass(job, program_, way.commanded(), scratch, pass, visit));
  return no_rapid_cuts(job_, program_, result);
}

bool Corrector::meet(std::size_t i) const {
  return i + 1 < moves_.size() && deflections_.cuts(i) && deflections_.cuts(i + 1);
}

void Corrector::choose_moves() {
  rewritten_.assign(moves_.size(), false);
  frozen_.assign(moves_.size(), false);
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    if (!deflections_.cuts(i)) continue;
    rewritten_[i] = options_.method == CorrectMethod::mirror || before_[i] > inside() ||
                    (job_.weights && deflections_.largest(i) > inside());
  }
  spread_choice();
}

double Corrector::jump(std::size_t i) const {
  const double share = std::min(1.0, fit_[i] / (options_.fit_share * job_.tolerance));
  const double shortest = std::min(job_.controller.shortest_block(moves_[i].feed), 0.6 * job_.tolerance);
  return std::max(options_.merge_share * job_.tolerance * share, shortest);
}

void Corrector::spread_choice() {
  for (std::size_t i = 0; i + 1 < moves_.size(); ++i) {
    if (meet(i) && rewritten_[i] && deflections_.at_start(i + 1).norm() > jump(i)) take(i + 1);
  }
  for (std::size_t i = moves_.size(); i-- > 1;) {
    if (meet(i - 1) && rewritten_[i] && deflections_.at_end(i - 1).norm() > jump(i)) take(i - 1);
  }
}

double Corrector::shared(std::size_t corner, std::size_t of, double sides) const {
  if (!merges(corner)) return jump(of);
  constexpr double kASide = 0.8 * (1 + 1e-9);
  return std::max(jump(of), std::min(job_.controller.shortest_block(moves_[of].feed), sides * kASide * job_.tolerance));
}

Plan Corrector::pieces_of(std::size_t i, const Deflections& d, const Vec3& first, const Vec3& last) const {
  if (options_.method == CorrectMethod::mirror) return equal_pieces(moves_[i], d, last, options_.mirror_points);
  const double chord = options_.chord > 0 ? options_.chord : 0.1 * job_.tolerance;
  const double shortest = job_.controller.shortest_block(moves_[i].feed);
  return fit_pieces(moves_[i], d, first, last, {fit_[i], chord, shortest, !chords_.empty() && chords_[i]});
}

void Corrector::plan(std::size_t i, Vec3& stands, Deflections& d, Plan& plan) const {
  plan.clear();
  if (!rewritten_[i]) {
    stands = moves_[i].end;
    return;
  }
  const gcode::Move& move = moves_[i];
  deflections_.get(i, d);
  const double before = shared(i, i, 1);
  const Vec3 ideal = move.start - d.delta.front();
  Vec3 first = d.delta.front().norm() > before ? ideal : move.start;
  if ((first - stands).norm() <= before || (merges(i) && (ideal - stands).norm() <= before)) {
    first = stands;  // a corner that both moves share, or none
  } else {
    plan.push_back({first, true, {}});
  }
  Vec3 last = move.end;
  bool release = false;
  const bool waits = dwell_after(moves_, program_, i).possible > 0;  // without chips, so without what they deflect
  const bool next_too = meet(i) && rewritten_[i + 1];
  if (next_too && !waits && (d.delta.back() - deflections_.at_start(i + 1)).norm() <= shared(i + 1, i, 2)) {
    last = move.end - 0.5 * (d.delta.back() + deflections_.at_start(i + 1));
  } else if (d.delta.back().norm() > shared(i + 1, i, 1)) {
    last = move.end - d.delta.back();
    release = waits || !next_too;  // let the load go on the spot before the tool leaves
  }
  // Without the load of the cut the tool still yields to the weight of the machine.
  const Vec3 free = move.end - weight_at(move.end);
  if (release && job_.weights && (last - free).norm() <= shared(i + 1, i, 1)) release = false;
  stands = release ? free : last;
  for (Piece& piece : pieces_of(i, d, first, last)) plan.push_back(std::move(piece));
  if (release) plan.push_back({free, true, {}});
}

Status Corrector::check() {
  if (!verifies() && commands_the_same()) {
    rapids_ = no_rapid_cuts(job_, program_, out_.before.pass);
    after_notes_ = pass_notes(job_, program_, out_.before.pass);
    take_after(out_.before);
    return {};
  }
  PredictOptions options;
  options.step = check_step();
  options.keep_samples = options_.keep_samples;
  options.progress = progress("checking what was written");
  FineLook fine(*this, named_, way_);  // which counts where the coarse one finds nothing outside
  POLYPOD_ASSIGN(after, predict_way(job_, named_, way_, options, scratch_));
  rapids_ = no_rapid_cuts(job_, named_, after.pass);
  after_notes_ = pass_notes(job_, named_, after.pass);
  out_.verified = verifies() && (fit_finely_ || after.largest_distance <= inside());
  if (out_.verified) {
    POLYPOD_TRY(fine.take_into(after));
    fit_finely_ = fit_finely_ || after.largest_distance > inside();
  }
  take_after(std::move(after));
  return {};
}

void Corrector::take_after(Prediction after) {
  out_.after = std::move(after);
  out_.largest_distance = out_.after.largest_distance;
  after_.assign(moves_.size(), 0);
  for (const MovePrediction& m : out_.after.moves) after_[static_cast<std::size_t>(m.move)] = m.largest_distance;
}

bool Corrector::worse(std::size_t i) const {
  // A rewritten move is closer, or it stays as it was; others are what the stock that is left makes of them.
  return rewritten_[i] ? after_[i] > before_[i] + kNotCloser : outside(i) && after_[i] > before_[i] + kSameDistance;
}

std::size_t Corrector::count(bool (Corrector::*what)(std::size_t) const) const {
  std::size_t n = 0;
  for (std::size_t i = 0; i < moves_.size(); ++i) n += (this->*what)(i) ? 1 : 0;
  return n;
}

Corrector::Choice Corrector::choice() const {
  std::size_t bad = 0;
  for (std::size_t i = 0; i < moves_.size(); ++i) bad += outside(i) ? 1 : 0;
  return {rewritten_, fit_, sample_step_, fit_finely_, bad, out_.largest_distance};
}

Status Corrector::refine() {
  std::optional<Choice> best;
  for (out_.rounds = 1;; ++out_.rounds) {
    POLYPOD_TRY(write_and_check());
    const Choice now = choice();
    if (!best || now.better_than(*best)) best = now;
    if (now.bad == 0 || options_.method == CorrectMethod::mirror) return {};
    if (out_.rounds >= (fit_finely_ ? 2 : 1) * options_.rounds || !narrow()) break;
    // Knots are samples: a narrower tube in the ramps of corners needs closer ones.
    sample_step_ = std::max(0.5 * sample_step_, finest_);
    POLYPOD_TRY(find_deflections());
  }
  return restore(*best);
}

Status Corrector::restore(const Choice& best) {
  rewritten_ = best.rewritten;
  fit_ = best.fit;
  sample_step_ = best.sample_step;
  fit_finely_ = best.fit_finely;
  POLYPOD_TRY(find_deflections());
  return write_and_check();
}

bool Corrector::narrow() {
  bool changed = false;
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    if (!outside(i)) continue;
    if (!rewritten_[i]) {
      if (frozen_[i] || !deflections_.cuts(i)) continue;
      rewritten_[i] = true;
      changed = true;
    } else if (fit_[i] > kNarrowest * job_.tolerance && (last_.empty() || after_[i] < kHelps * last_[i])) {
      fit_[i] *= 0.5;
      changed = true;
    } else {
      changed = take_neighbours(i) || changed;
    }
  }
  last_ = after_;
  spread_choice();
  return changed;
}

bool Corrector::take_neighbours(std::size_t i) {
  bool changed = false;
  for (const std::size_t k : {i - 1, i + 1}) {
    if (k >= moves_.size() || rewritten_[k] || frozen_[k] || !deflections_.cuts(k)) continue;
    rewritten_[k] = changed = true;
  }
  return changed;
}

Status Corrector::correct_the_rest() {
  std::vector<bool> extra(moves_.size(), false);
  for (std::size_t i = 0; i < moves_.size(); ++i) {
    extra[i] = deflections_.cuts(i) && !rewritten_[i] && !frozen_[i];
    if (extra[i]) rewritten_[i] = true;
  }
  for (bool changed = true; changed;) {
    changed = false;
    Planner planner(*this);
    std::vector<bool> taken_back(moves_.size(), false);  // when all are planned: they count for their neighbours
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      const std::size_t blocks = planner.next().size();
      if (!extra[i] || blocks == 1) continue;
      taken_back[i] = changed = true;
    }
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (taken_back[i]) extra[i] = rewritten_[i] = false;
    }
  }
  return write_and_check();
}

Status Corrector::give_back_what_got_worse() {
  const auto give_back = [&](std::size_t i) {
    rewritten_[i] = false;
    frozen_[i] = true;
  };
  for (int round = 0; round < kGiveBackRounds && count(&Corrector::worse) > 0; ++round) {
    std::vector<std::size_t> which;
    for (std::size_t i = 0; i < moves_.size(); ++i) {
      if (!worse(i)) continue;
      if (rewritten_[i]) {
        which.push_back(i);
        continue;
      }
      // Of its own contour first: what lies beyond is given back only where nothing of it is left.
      const auto [first, end] = contour_of(i);
      std::size_t before = i, after = i + 1;
      while (before > first && !rewritten_[before]) --before;
      if (!rewritten_[before])
        while (before > 0 && !rewritten_[before]) --before;
      if (rewritten_[before]) which.push_back(before);
      if (after < end && rewritten_[after]) which.push_back(after);
    }
    std::for_each(which.begin(), which.end(), give_back);
    spread_choice();
    POLYPOD_TRY(write_and_check());
  }
  // What cannot be held takes its own contour with it before it takes the others.
  for (int round = 0; round < kGiveBackRounds && is_worse(); ++round) {
    for (const std::size_t i : what_came_farther()) {
      const auto [first, end] = contour_of(i);
      for (std::size_t k = first; k < end; ++k)
        if (rewritten_[k]) give_back(k);
    }
    POLYPOD_TRY(write_and_check());
  }
  if (!is_worse()) return {};
  for (std::size_t i = 0; i < moves_.size(); ++i)
    if (rewritten_[i]) give_back(i);
  return write_and_check();
}

std::pair<std::size_t, std::size_t> Corrector::contour_of(std::size_t i) const {
  std::size_t first = i, end = i + 1;
  while (first > 0 && meet(first - 1)) --first;
  while (end < moves_.size() && meet(end - 1)) ++end;
  return {first, end};
}

bool Corrector::is_worse() const {
  return count(&Corrector::worse) > 0 || out_.largest_distance > out_.before.largest_distance + kSameDistance;
}

std::vector<std::size_t> Corrector::what_came_farther() const {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < moves_.size(); ++i)
    if (worse(i)) out.push_back(i);
  if (out.empty())
    out.push_back(static_cast<std::size_t>(std::max_element(after_.begin(), after_.end()) - after_.begin()));
  return out;
}

}  // namespace polypod::machining
