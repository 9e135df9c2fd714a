// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "ledger.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
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

/// What is asked for, in its order: in work, then known.
class Ledger::Work final : public Tasks {
 public:
  struct Asked {
    std::string key;
    Row row;
    Shares u;  // of a stream
  };
  using Next = std::function<std::optional<Asked>(const std::vector<Member>& in_work)>;
  using Known = std::function<void(const Asked&, bool fresh)>;

  Work(Ledger& ledger, std::size_t window, Next next, Known known)
      : ledger_(ledger), window_(window), next_(std::move(next)), known_(std::move(known)) {}

  std::optional<Task> next() override {
    while (!failed_) {
      if (queue_.size() >= window_ || over_) {
        if (queue_.empty() || !queue_.front().done) return std::nullopt;
        settle();
        continue;
      }
      std::optional<Asked> asked = ledger_.over() ? std::nullopt : next_(in_work());
      over_ = !asked;
      if (asked && put(std::move(*asked))) return Task{last_, queue_.back().asked.row, ledger_.incumbents_, 0};
    }
    return std::nullopt;
  }

  Status taken(std::size_t index, Evaluation evaluation) override {
    Place& place = *std::find_if(queue_.begin(), queue_.end(), [&](const Place& p) { return p.index == index; });
    Row& row = place.asked.row;
    row.evaluation = std::move(evaluation);
    POLYPOD_TRY(ledger_.store_.add(row));
    place.done = true;
    ++ledger_.out_.computed;
    ++ledger_.finished_;
    ledger_.report(row.phase, begin_);
    return failed_ ? Status(tl::unexpected(*failed_)) : Status();
  }

  /// What is done; after a cancellation the rest is as if it had not been asked for.
  Status end() {
    while (!queue_.empty() && !failed_) {
      if (queue_.front().done) {
        settle();
      } else {
        --ledger_.in_work_;
        queue_.pop_front();
      }
    }
    return failed_ ? Status(tl::unexpected(*failed_)) : Status();
  }

 private:
  struct Place {
    std::size_t index = 0;
    Asked asked;
    bool fresh = true, done = false;
  };

  [[nodiscard]] std::vector<Member> in_work() const {
    std::vector<Member> out;
    for (const Place& p : queue_)
      if (p.fresh) out.push_back({p.asked.u, 0});
    return out;
  }

  /// Whether it has to be computed.
  bool put(Asked asked) {
    Place place{++last_, std::move(asked)};
    const std::string& key = place.asked.key;
    const bool again = ledger_.seen_.contains(key) ||
                       std::any_of(queue_.begin(), queue_.end(), [&](const Place& p) { return p.asked.key == key; });
    if (again) {
      place.fresh = false;
      place.done = true;
    } else if (const auto stored = ledger_.known_.find(key); stored != ledger_.known_.end()) {
      ledger_.taken_[stored->second] = true;
      place.asked.row = ledger_.stored_[stored->second];
      place.done = true;
      ++ledger_.finished_;
    } else {
      place.asked.row.version = ledger_.options_.version;
      const std::size_t before = ledger_.out_.rows.size() + ledger_.in_work_;
      place.asked.row.row = ledger_.number(static_cast<std::int64_t>(before) + 1);
    }
    ledger_.in_work_ += place.fresh ? 1 : 0;
    queue_.push_back(std::move(place));
    return !queue_.back().done;
  }

  void settle() {
    Place place = std::move(queue_.front());
    queue_.pop_front();
    if (place.fresh) {
      --ledger_.in_work_;
      const std::size_t at = ledger_.out_.rows.size();
      ledger_.seen_.emplace(place.asked.key, at);
      ledger_.out_.rows.push_back(std::move(place.asked.row));
      ledger_.learn(at);
      if (const Status told = ledger_.tell_of_better(); !told) failed_ = told.error();
    }
    if (ledger_.seen_.contains(place.asked.key)) known_(place.asked, place.fresh);
  }

  Ledger& ledger_;
  std::size_t window_;
  Next next_;
  Known known_;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  std::deque<Place> queue_;
  std::size_t last_ = 0;
  bool over_ = false;
  std::optional<Error> failed_;
};

/// All of them at a time.
Status Ledger::ask_rows(const std::vector<std::pair<std::string, Row>>& asked) {
  std::size_t at = 0;
  Work work(
      *this, asked.size() + 1,
      [&](const std::vector<Member>&) -> std::optional<Work::Asked> {
        if (at == asked.size()) return std::nullopt;
        const auto& [key, row] = asked[at++];
        return Work::Asked{key, row, {}};
      },
      [](const Work::Asked&, bool) {});
  return compute(work);
}

Status Ledger::ask_in_turn(const Stream& stream) {
  Work work(
      *this, stream.window,
      [&](const std::vector<Member>& in_work) -> std::optional<Work::Asked> {
        std::optional<Shares> u = stream.next(in_work);
        if (!u) return std::nullopt;
        Work::Asked out;
        out.row.phase = stream.phase;
        out.row.varied = varied_of(study_, *u);
        out.key = key_of(out.row.varied);
        out.u = std::move(*u);
        return out;
      },
      [&](const Work::Asked& asked, bool fresh) {
        stream.known({asked.u, seen_.at(asked.key)}, fresh);
      });
  return compute(work);
}

Status Ledger::compute(Work& work) {
  const auto begin = std::chrono::steady_clock::now();
  const Result<bool> whole = options_.crew->work(work);
  spent_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  if (!whole) return tl::unexpected(whole.error());
  stopped_ = stopped_ || !*whole;
  return work.end();
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
