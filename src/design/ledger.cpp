// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "ledger.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>

#include "rounded.hpp"

namespace polypod::design {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr const char* kStartKey = "start";
constexpr const char* kStarts = "starts";

std::vector<double> varied_of(const Study& study, const Shares& u) {
  std::vector<double> out;
  for (std::size_t i = 0; i < study.vary.size(); ++i) out.push_back(rounded(study.vary[i].at(u[i])));
  return out;
}

std::string key_of(const std::vector<double>& varied) {
  std::string out;
  for (const double x : varied) out += fmt::format("{:.12g} ", x);
  return out;
}

/// One a line: evaluations, row, and whether it ended by itself.
std::string note_of(const std::vector<Start>& starts) {
  std::string out;
  for (const Start& s : starts) out += fmt::format("{} {} {:d}\n", s.evaluations, s.row, s.by_itself);
  return out;
}

}  // namespace

Result<std::vector<Start>> kept_starts(const Store& store) {
  POLYPOD_ASSIGN(note, store.note(kStarts));
  std::istringstream lines(note);
  std::vector<Start> out;
  for (Start s; lines >> s.evaluations >> s.row >> s.by_itself;) out.push_back(s);
  return out;
}

Ledger::Ledger(const Study& study, Store& store, const OptimizeOptions& options)
    : study_(study),
      store_(store),
      options_(options),
      random_(study.seed),
      is_candidate_(start_is_candidate(study)),
      told_(-kInf) {}

Status Ledger::begin() {
  POLYPOD_ASSIGN(stored, store_.rows());
  stored_ = std::move(stored);
  taken_.assign(stored_.size(), false);
  for (std::size_t i = 0; i < stored_.size(); ++i) {
    const Row& row = stored_[i];
    last_ = std::max(last_, row.row);
    numbers_.insert(row.row);
    known_.emplace(key_for(row), i);
    if (counts(row) && !study_.wants_front()) told_ = std::max(told_, row.evaluation.objective.value);
  }
  POLYPOD_TRY(store_.set_complete(false));
  POLYPOD_TRY(store_.set_note(kStarts, ""));
  POLYPOD_TRY(store_.set_judged_again(0, {}));
  return start();
}

std::string Ledger::key_for(const Row& row) const {
  return row.phase == Phase::start && !is_candidate_ ? kStartKey : key_of(row.varied);
}

/// The machine as it is, for comparison; where only one evaluation is allowed, not.
Status Ledger::start() {
  if (study_.evaluations < 2) return {};
  Row row;
  row.phase = Phase::start;
  for (const double x : study_.values_of(study_.start)) row.varied.push_back(rounded(x));
  row.varied.resize(n(), std::numeric_limits<double>::quiet_NaN());
  return ask_rows({{key_for(row), row}});
}

Status Ledger::ask(std::vector<Member>& members, Phase phase) {
  POLYPOD_TRY(ask_in_place(members, phase));
  std::erase_if(members, [](const Member& m) { return m.u.empty(); });
  return {};
}

Status Ledger::ask_in_place(std::vector<Member>& members, Phase phase) {
  std::vector<std::pair<std::string, Row>> rows;
  for (const Member& m : members) {
    Row row;
    row.phase = phase;
    row.varied = varied_of(study_, m.u);
    rows.emplace_back(key_of(row.varied), std::move(row));
  }
  POLYPOD_TRY(ask_rows(rows));
  for (std::size_t i = 0; i < members.size(); ++i) {
    const auto found = seen_.find(rows[i].first);
    if (found == seen_.end()) {
      members[i].u.clear();
    } else {
      members[i].row = found->second;
    }
  }
  return {};
}

Status Ledger::ask_rows(const std::vector<std::pair<std::string, Row>>& asked) {
  std::vector<Row> missing;
  std::vector<std::size_t> places;  // of the missing in out_.rows
  std::vector<std::pair<std::string, std::size_t>> fresh;
  for (const auto& [key, row] : asked) {
    if (seen_.contains(key) || over()) continue;
    const std::size_t place = out_.rows.size();
    seen_.emplace(key, place);
    fresh.emplace_back(key, place);
    if (const auto known = known_.find(key); known != known_.end()) {
      taken_[known->second] = true;
      out_.rows.push_back(stored_[known->second]);
      ++finished_;
      continue;
    }
    Row next = row;
    next.version = options_.version;
    next.row = number(static_cast<std::int64_t>(place) + 1);
    out_.rows.push_back(next);
    missing.push_back(std::move(next));
    places.push_back(place);
  }
  if (!missing.empty()) POLYPOD_TRY(compute(missing, places, fresh));
  for (const auto& [key, place] : fresh) learn(place);
  return tell_of_better();
}

Status Ledger::compute(const std::vector<Row>& missing, const std::vector<std::size_t>& places,
                       std::vector<std::pair<std::string, std::size_t>>& fresh) {
  std::vector<bool> done(missing.size(), false);
  const auto begin = std::chrono::steady_clock::now();
  POLYPOD_ASSIGN(whole, options_.crew->work(missing, incumbents_, [&](std::size_t i, Evaluation e) -> Status {
    Row& row = out_.rows[places[i]];
    row.evaluation = std::move(e);
    POLYPOD_TRY(store_.add(row));
    done[i] = true;
    ++out_.computed;
    ++finished_;
    report(row.phase, begin);
    return {};
  }));
  spent_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  if (whole) return {};
  stopped_ = true;
  std::set<std::size_t> absent;
  for (std::size_t i = 0; i < missing.size(); ++i)
    if (!done[i]) absent.insert(places[i]);
  forget(absent, fresh);
  return {};
}

/// After a cancellation: what is not there is as if it had not been asked for.
void Ledger::forget(const std::set<std::size_t>& absent, std::vector<std::pair<std::string, std::size_t>>& fresh) {
  std::vector<Row> rows;
  std::vector<std::size_t> moved(out_.rows.size());
  for (std::size_t i = 0; i < out_.rows.size(); ++i) {
    moved[i] = rows.size();
    if (!absent.contains(i)) rows.push_back(std::move(out_.rows[i]));
  }
  out_.rows = std::move(rows);
  std::erase_if(seen_, [&](const auto& entry) { return absent.contains(entry.second); });
  std::erase_if(fresh, [&](const auto& entry) { return absent.contains(entry.second); });
  for (auto& [key, place] : seen_) place = moved[place];
  for (auto& [key, place] : fresh) place = moved[place];
}

/// The number that an uninterrupted search gives; the next free one where a longer search shares the store.
std::int64_t Ledger::number(std::int64_t wanted) {
  if (numbers_.contains(wanted)) wanted = last_ + 1;
  numbers_.insert(wanted);
  last_ = std::max(last_, wanted);
  return wanted;
}

bool Ledger::counts(const Row& row) const {
  return row.evaluation.state == State::done && is_candidate(row);
}

/// From now on new candidates are compared with this one.
void Ledger::learn(std::size_t place) {
  if (!counts(out_.rows[place])) return;
  const Evaluation& e = out_.rows[place].evaluation;
  if (!study_.wants_front()) {
    incumbents_.objective = std::max(incumbents_.objective, e.objective.lower);
    if (!incumbent_ || e.objective.value > out_.rows[*incumbent_].evaluation.objective.value) incumbent_ = place;
    return;
  }
  const std::vector<double> goals = goals_of(study_, e, false);
  auto& front = incumbents_.front;
  if (std::any_of(front.begin(), front.end(), [&](const auto& p) { return p == goals || dominates(p, goals); })) return;
  std::erase_if(front, [&](const auto& p) { return dominates(goals, p); });
  front.push_back(goals);
}

Status Ledger::tell_of_better() {
  if (!incumbent_ || !options_.better) return {};
  const Row& row = out_.rows[*incumbent_];
  if (!(row.evaluation.objective.value > told_)) return {};
  told_ = row.evaluation.objective.value;
  return options_.better(row);
}

void Ledger::report(Phase phase, std::chrono::steady_clock::time_point begin) const {
  if (!options_.progress) return;
  SearchProgress p;
  p.most = study_.evaluations;
  p.evaluations = finished_;
  p.phase = phase;
  p.objective =
      incumbent_ ? out_.rows[*incumbent_].evaluation.objective.value : std::numeric_limits<double>::quiet_NaN();
  p.front = static_cast<int>(incumbents_.front.size());
  const double spent = spent_ + std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  p.seconds_left = spent / static_cast<double>(out_.computed) * (p.most - p.evaluations);
  options_.progress(p);
}

Result<Outcome> Ledger::end() {
  out_.asked = out_.rows.size();
  for (std::size_t i = 0; i < stored_.size(); ++i)
    if (!taken_[i]) out_.rows.push_back(std::move(stored_[i]));
  out_.best = best_of(study_, out_.rows);
  out_.front = front_of(study_, out_.rows);
  out_.complete = !stopped_;
  POLYPOD_TRY(store_.set_note(kStarts, note_of(out_.starts)));
  POLYPOD_TRY(store_.set_complete(out_.complete));
  return std::move(out_);
}

std::vector<Member> Ledger::latin(std::size_t count, bool with_start) {
  std::vector<Member> out(count, Member{Shares(n()), 0});
  for (std::size_t i = 0; i < n(); ++i) {
    std::vector<std::size_t> order(count);
    std::iota(order.begin(), order.end(), std::size_t{0});
    for (std::size_t k = count; k > 1; --k) std::swap(order[k - 1], order[below(k)]);
    for (std::size_t k = 0; k < count; ++k) {
      out[k].u[i] = (static_cast<double>(order[k]) + random_.uniform()) / static_cast<double>(count);
    }
  }
  const std::vector<double> start = study_.values_of(study_.start);
  for (std::size_t i = 0; with_start && i < start.size() && count > 0; ++i)
    out[0].u[i] = study_.vary[i].share_of(start[i]);
  return out;
}

Shares Ledger::shares_of(const Row& row) const {
  Shares out;
  for (std::size_t i = 0; i < row.varied.size(); ++i) out.push_back(study_.vary[i].share_of(row.varied[i]));
  return out;
}

std::size_t Ledger::below(std::size_t n) {
  return std::min(n - 1, static_cast<std::size_t>(random_.uniform() * static_cast<double>(n)));
}

}  // namespace polypod::design
