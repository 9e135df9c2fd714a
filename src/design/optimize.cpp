// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/optimize.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <numbers>
#include <numeric>
#include <set>
#include <thread>
#include <unordered_map>

#include "polypod/core/random.hpp"
#include "refine.hpp"

namespace polypod::design {
namespace {

using Shares = std::vector<double>;  // of each varied parameter, 0 to 1

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr const char* kCancelled = "WS110";
constexpr const char* kStartKey = "start";

/// Twelve digits: what is tried can be written into a file and read back.
double rounded(double value) {
  return std::strtod(fmt::format("{:.12g}", value).c_str(), nullptr);
}

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

/// The number by which a search for one machine orders candidates: those that keep all holds by their objective, the
/// others below them by how much they break.
struct Rank {
  double violation = kInf, objective = -kInf;
  bool operator>(const Rank& other) const {
    if (violation != other.violation) return violation < other.violation;
    return objective > other.objective;
  }
};

Rank rank_of(const Evaluation& e) {
  return {e.violation, std::isnan(e.objective.value) ? -kInf : e.objective.value};
}

/// Computes evaluations side by side, each on one thread, and hands them over in the order in which they are done.
class Crew {
 public:
  Crew(const Study& study, const Incumbents& incumbents, const OptimizeOptions& options)
      : study_(study), incumbents_(incumbents), options_(options) {}

  /// `taken` gets number and evaluation on the calling thread; an error of it ends the work. False: cancelled.
  Result<bool> work(const std::vector<Row>& rows, const std::function<Status(std::size_t, Evaluation)>& taken) {
    const std::size_t most = options_.threads > 0 ? static_cast<std::size_t>(options_.threads)
                                                  : std::max(1U, std::thread::hardware_concurrency());
    const std::size_t count = std::min(most, rows.size());
    if (count <= 1) {
      for (std::size_t i = 0; i < rows.size(); ++i) {
        auto done = judge(rows[i], options_.threads);
        if (!done) return ended(done.error());
        POLYPOD_TRY(taken(i, std::move(*done)));
      }
      return true;
    }
    std::vector<std::thread> threads;
    const auto join = [&] {
      stop_ = true;
      for (std::thread& t : threads) t.join();
    };
    try {
      for (std::size_t k = 0; k < count; ++k) threads.emplace_back([&] { help(rows); });
    } catch (...) {
      if (threads.empty()) throw;  // else those that could be started do the work
    }
    std::optional<Error> failed;
    for (std::size_t got = 0; got < rows.size() && !failed; ++got) {
      Done done = next();
      if (done.thrown) {
        join();
        std::rethrow_exception(done.thrown);
      }
      if (!done.evaluation) {
        failed = done.evaluation.error();
      } else if (const Status status = taken(done.index, std::move(*done.evaluation)); !status) {
        failed = status.error();
      }
    }
    join();
    if (failed) {
      if (failed->id == kCancelled) POLYPOD_TRY(keep_what_is_done(taken));
      return ended(*failed);
    }
    return true;
  }

 private:
  struct Done {
    std::size_t index = 0;
    Result<Evaluation> evaluation;
    std::exception_ptr thrown;
  };

  /// What the others had done when one of them was cancelled.
  Status keep_what_is_done(const std::function<Status(std::size_t, Evaluation)>& taken) {
    for (Done& done : done_)
      if (!done.thrown && done.evaluation) POLYPOD_TRY(taken(done.index, std::move(*done.evaluation)));
    return {};
  }

  static Result<bool> ended(const Error& error) {
    if (error.id == kCancelled) return false;
    return tl::unexpected(error);
  }

  [[nodiscard]] Result<Evaluation> judge(const Row& row, int threads) const {
    const EvaluateOptions options{threads, [this] { return stop_ || (options_.cancelled && options_.cancelled()); }};
    if (options.cancelled()) return fail(kCancelled, "cancelled");
    if (row.phase == Phase::start) return evaluate_machine(study_, study_.start, {}, options);
    return evaluate(study_, row.varied, incumbents_, options);
  }

  void help(const std::vector<Row>& rows) {
    while (!stop_) {
      const std::size_t i = next_++;
      if (i >= rows.size()) return;
      Done done{i, {}, nullptr};
      try {
        done.evaluation = judge(rows[i], 1);
      } catch (...) {
        done.thrown = std::current_exception();
      }
      const std::lock_guard guard(mutex_);
      done_.push_back(std::move(done));
      ready_.notify_one();
    }
  }

  Done next() {
    std::unique_lock lock(mutex_);
    ready_.wait(lock, [this] { return !done_.empty(); });
    Done out = std::move(done_.front());
    done_.pop_front();
    return out;
  }

  const Study& study_;
  const Incumbents& incumbents_;
  const OptimizeOptions& options_;
  std::atomic<bool> stop_{false};
  std::atomic<std::size_t> next_{0};
  std::mutex mutex_;
  std::condition_variable ready_;
  std::deque<Done> done_;
};

/// One candidate as a search sees it.
struct Member {
  Shares u;
  std::size_t row = 0;  ///< of Outcome::rows
};

class Search {
 public:
  Search(const Study& study, Store& store, const OptimizeOptions& options)
      : study_(study), store_(store), options_(options), n_(study.vary.size()), random_(study.seed) {}

  Result<Outcome> run() {
    POLYPOD_ASSIGN(stored, store_.rows());
    for (Row& row : stored) {
      const std::string key = key_for(row);
      last_ = std::max(last_, row.row);
      numbers_.insert(row.row);
      known_.emplace(key, std::move(row));
    }
    is_candidate_ = start_is_candidate(study_);
    POLYPOD_TRY(store_.set_complete(false));
    POLYPOD_TRY(start());
    if (const auto all = combinations(); all && *all <= left()) {
      POLYPOD_TRY(grid());
    } else if (study_.wants_front()) {
      POLYPOD_TRY(genetic());
    } else {
      POLYPOD_TRY(single());
    }
    out_.best = best_of(study_, out_.rows);
    out_.front = front_of(study_, out_.rows);
    out_.complete = !stopped_;
    POLYPOD_TRY(store_.set_complete(out_.complete));
    return std::move(out_);
  }

 private:
  [[nodiscard]] std::string key_for(const Row& row) const {
    return row.phase == Phase::start && !is_candidate_now() ? kStartKey : key_of(row.varied);
  }
  [[nodiscard]] bool is_candidate_now() const {
    if (!is_candidate_) is_candidate_ = start_is_candidate(study_);
    return *is_candidate_;
  }

  [[nodiscard]] std::int64_t left() const { return study_.evaluations - static_cast<std::int64_t>(out_.rows.size()); }
  [[nodiscard]] bool over() const { return stopped_ || left() <= 0; }

  [[nodiscard]] std::optional<std::int64_t> combinations() const {
    double all = 1;
    for (const Vary& v : study_.vary) {
      const auto count = v.count();
      if (!count) return {};
      all *= static_cast<double>(*count);
    }
    constexpr double kMost = 1e12;
    return static_cast<std::int64_t>(std::min(all, kMost));
  }

  /// The machine as it is, for comparison; where only one evaluation is allowed, not.
  Status start() {
    if (study_.evaluations < 2) return {};
    Row row;
    row.phase = Phase::start;
    for (const double x : study_.values_of(study_.start)) row.varied.push_back(rounded(x));
    row.varied.resize(n_, std::numeric_limits<double>::quiet_NaN());
    const std::string key = is_candidate_now() ? key_of(row.varied) : kStartKey;
    return ask_rows({{key, row}});
  }

  /// Rows of these candidates, as far as evaluations are left; the members beyond get none and are dropped.
  Status ask(std::vector<Member>& members, Phase phase) {
    std::vector<std::pair<std::string, Row>> rows;
    for (const Member& m : members) {
      Row row;
      row.phase = phase;
      row.varied = varied_of(study_, m.u);
      rows.emplace_back(key_of(row.varied), std::move(row));
    }
    POLYPOD_TRY(ask_rows(rows));
    std::vector<Member> kept;
    for (std::size_t i = 0; i < members.size(); ++i) {
      const auto found = seen_.find(rows[i].first);
      if (found == seen_.end()) continue;
      members[i].row = found->second;
      kept.push_back(std::move(members[i]));
    }
    members = std::move(kept);
    return {};
  }

  Status ask_rows(const std::vector<std::pair<std::string, Row>>& asked) {
    std::vector<Row> missing;
    std::vector<std::size_t> places;  // of the missing in out_.rows
    std::vector<std::pair<std::string, std::size_t>> fresh;
    for (const auto& [key, row] : asked) {
      if (seen_.contains(key) || left() <= 0 || stopped_) continue;
      const std::size_t place = out_.rows.size();
      seen_.emplace(key, place);
      fresh.emplace_back(key, place);
      if (const auto known = known_.find(key); known != known_.end()) {
        out_.rows.push_back(known->second);
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
    const std::optional<std::size_t> before = incumbent_;
    for (const auto& [key, place] : fresh) learn(place);
    if (incumbent_ != before && incumbent_ && options_.better) POLYPOD_TRY(options_.better(out_.rows[*incumbent_]));
    return {};
  }

  Status compute(const std::vector<Row>& missing, const std::vector<std::size_t>& places,
                 std::vector<std::pair<std::string, std::size_t>>& fresh) {
    std::vector<bool> done(missing.size(), false);
    const auto begin = std::chrono::steady_clock::now();
    Crew crew(study_, incumbents_, options_);
    POLYPOD_ASSIGN(whole, crew.work(missing, [&](std::size_t i, Evaluation e) -> Status {
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
    // Cancelled: what is not there is as if it had not been asked for.
    stopped_ = true;
    std::set<std::size_t> absent;
    for (std::size_t i = 0; i < missing.size(); ++i)
      if (!done[i]) absent.insert(places[i]);
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
    return {};
  }

  /// The number that an uninterrupted search gives; the next free one where a longer search shares the store.
  std::int64_t number(std::int64_t wanted) {
    if (numbers_.contains(wanted)) wanted = last_ + 1;
    numbers_.insert(wanted);
    last_ = std::max(last_, wanted);
    return wanted;
  }

  [[nodiscard]] bool counts(std::size_t place) const {
    const Row& row = out_.rows[place];
    return row.evaluation.state == State::done && (row.phase != Phase::start || is_candidate_now());
  }

  /// From now on new candidates are compared with this one.
  void learn(std::size_t place) {
    if (!counts(place)) return;
    const Evaluation& e = out_.rows[place].evaluation;
    if (!study_.wants_front()) {
      incumbents_.objective = std::max(incumbents_.objective, e.objective.lower);
      if (!incumbent_ || e.objective.value > out_.rows[*incumbent_].evaluation.objective.value) incumbent_ = place;
      return;
    }
    const std::vector<double> goals = goals_of(study_, e, false);
    auto& front = incumbents_.front;
    if (std::any_of(front.begin(), front.end(), [&](const auto& p) { return p == goals || dominates(p, goals); }))
      return;
    std::erase_if(front, [&](const auto& p) { return dominates(goals, p); });
    front.push_back(goals);
  }

  void report(Phase phase, std::chrono::steady_clock::time_point begin) const {
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

  Status grid() {
    std::vector<std::int64_t> at(n_, 0);
    constexpr std::size_t kBatch = 64;
    for (bool more = true; more && !over();) {
      std::vector<Member> batch;
      while (more && batch.size() < kBatch) {
        Member m;
        for (std::size_t i = 0; i < n_; ++i) m.u.push_back(share_at(i, at[i]));
        batch.push_back(std::move(m));
        std::size_t i = 0;
        while (i < n_ && ++at[i] == *study_.vary[i].count()) at[i++] = 0;
        more = i < n_;
      }
      POLYPOD_TRY(ask(batch, Phase::grid));
    }
    return {};
  }

  /// The share of the k-th value of a parameter with steps or a list.
  [[nodiscard]] double share_at(std::size_t i, std::int64_t k) const {
    const Vary& v = study_.vary[i];
    const auto count = static_cast<double>(*v.count());
    if (!v.values.empty()) return (static_cast<double>(k) + 0.5) / count;
    return count > 1 ? static_cast<double>(k) / (count - 1) : 0;
  }

  /// One candidate in each of `count` slices of every range; the first is the start, as far as it has a place there.
  std::vector<Member> latin(std::size_t count, bool with_start) {
    std::vector<Member> out(count, Member{Shares(n_), 0});
    for (std::size_t i = 0; i < n_; ++i) {
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

  std::size_t below(std::size_t n) {
    return std::min(n - 1, static_cast<std::size_t>(random_.uniform() * static_cast<double>(n)));
  }

  [[nodiscard]] Rank rank(const Member& m) const { return rank_of(out_.rows[m.row].evaluation); }

  // One objective -----------------------------------------------------------------------------------------------------

  Status single() {
    constexpr int kMostRounds = 20;
    constexpr double kGlobal = 0.65;
    for (int round = 0; round < kMostRounds && !over(); ++round) {
      const std::int64_t before = left();
      POLYPOD_TRY(evolve(static_cast<std::int64_t>(kGlobal * static_cast<double>(left())), round == 0));
      POLYPOD_TRY(refine(round == 0 ? kFirstStep : kLaterStep));
      if (left() == before) break;  // nothing new is left to try
    }
    return {};
  }

  static constexpr double kFirstStep = 0.08, kLaterStep = 0.03;

  Status evolve(std::int64_t budget, bool first) {
    const std::int64_t end = left() - budget;  // evaluations that stay
    const auto most = static_cast<std::int64_t>(8 * n_ + 8);
    const auto start_size = static_cast<std::size_t>(std::clamp(budget / 6, std::int64_t{6}, most));
    std::vector<Member> population = latin(start_size, first);
    if (!first && incumbent_) {  // the best so far takes part
      const Row& best = out_.rows[*incumbent_];
      for (std::size_t i = 0; i < n_; ++i) population[0].u[i] = study_.vary[i].share_of(best.varied[i]);
    }
    POLYPOD_TRY(ask(population, Phase::sample));
    constexpr std::size_t kMemory = 5, kLeast = 5;
    std::vector<double> memory_F(kMemory, 0.5), memory_CR(kMemory, 0.8);
    std::vector<Shares> archive;
    std::size_t slot = 0;
    int idle = 0;
    constexpr int kIdle = 30;  // generations without a new candidate
    while (!stopped_ && left() > end && population.size() >= 4 && idle < kIdle) {
      std::stable_sort(population.begin(), population.end(),
                       [&](const Member& a, const Member& b) { return rank(a) > rank(b); });
      const double done =
          1 - static_cast<double>(left() - end) / static_cast<double>(std::max<std::int64_t>(budget, 1));
      const auto size = static_cast<std::size_t>(std::lround(
          static_cast<double>(start_size) - done * static_cast<double>(start_size - std::min(start_size, kLeast))));
      if (population.size() > std::max(size, kLeast)) population.resize(std::max(size, kLeast));
      std::vector<Member> trials;
      std::vector<double> used_F, used_CR;
      for (std::size_t i = 0; i < population.size(); ++i) {
        const std::size_t r = below(kMemory);
        const double CR = std::clamp(memory_CR[r] + 0.1 * random_.normal(), 0.0, 1.0);
        double F = 0;
        while (F <= 0) F = memory_F[r] + 0.1 * std::tan(std::numbers::pi * (random_.uniform() - 0.5));
        F = std::min(F, 1.0);
        trials.push_back({trial(population, archive, i, F, CR), 0});
        used_F.push_back(F);
        used_CR.push_back(CR);
      }
      const std::size_t rows_before = out_.rows.size();
      std::vector<Member> asked = trials;
      POLYPOD_TRY(ask_in_place(asked, Phase::search));
      idle = out_.rows.size() == rows_before ? idle + 1 : 0;
      double sum = 0, sum_F = 0, sum_F2 = 0, sum_CR = 0, sum_CR2 = 0;
      for (std::size_t i = 0; i < asked.size(); ++i) {
        if (asked[i].u.empty()) continue;  // beyond the last evaluation
        if (rank(population[i]) > rank(asked[i])) continue;
        const Rank now = rank(asked[i]), was = rank(population[i]);
        if (now > was) {
          archive.push_back(population[i].u);
          const double gain = std::isfinite(now.objective - was.objective) && now.objective > was.objective
                                  ? now.objective - was.objective
                                  : 1e-6;
          sum += gain;
          sum_F += gain * used_F[i];
          sum_F2 += gain * used_F[i] * used_F[i];
          sum_CR += gain * used_CR[i];
          sum_CR2 += gain * used_CR[i] * used_CR[i];
        }
        population[i] = asked[i];
      }
      while (archive.size() > start_size)
        archive.erase(archive.begin() + static_cast<std::ptrdiff_t>(below(archive.size())));
      if (sum > 0) {
        memory_F[slot] = sum_F2 / sum_F;
        memory_CR[slot] = sum_CR > 0 ? sum_CR2 / sum_CR : 0;
        slot = (slot + 1) % kMemory;
      }
    }
    return {};
  }

  /// As ask(), but members stay where they are; those beyond the last evaluation lose their shares.
  Status ask_in_place(std::vector<Member>& members, Phase phase) {
    std::vector<Member> copy = members;
    POLYPOD_TRY(ask(copy, phase));
    for (Member& m : members) {
      const auto found = seen_.find(key_of(varied_of(study_, m.u)));
      if (found == seen_.end()) {
        m.u.clear();
      } else {
        m.row = found->second;
      }
    }
    return {};
  }

  Shares trial(const std::vector<Member>& population, const std::vector<Shares>& archive, std::size_t i, double F,
               double CR) {
    constexpr double kBestShare = 0.15;
    const std::size_t n = population.size();
    const auto best =
        std::max<std::size_t>(2, static_cast<std::size_t>(std::lround(kBestShare * static_cast<double>(n))));
    const Shares& p = population[below(best)].u;
    std::size_t a = i;
    while (a == i) a = below(n);
    std::size_t b = i;
    while (b == i || b == a) b = below(n + archive.size());
    const Shares& x = population[i].u;
    const Shares& x_b = b < n ? population[b].u : archive[b - n];
    Shares out = x;
    const std::size_t surely = below(n_);
    for (std::size_t k = 0; k < n_; ++k) {
      if (random_.uniform() >= CR && k != surely) continue;
      out[k] = std::clamp(x[k] + F * (p[k] - x[k]) + F * (population[a].u[k] - x_b[k]), 0.0, 1.0);
    }
    return out;
  }

  /// From the best: neighbouring steps of what has steps, then the subplex method on what has none.
  Status refine(double step) {
    if (!incumbent_) return {};
    Shares u;
    for (std::size_t i = 0; i < n_; ++i) u.push_back(study_.vary[i].share_of(out_.rows[*incumbent_].varied[i]));
    POLYPOD_TRY(climb(u));
    std::vector<std::size_t> free;
    for (std::size_t i = 0; i < n_; ++i)
      if (!study_.vary[i].count()) free.push_back(i);
    if (free.empty() || over()) return {};
    Shares from;
    for (const std::size_t i : free) from.push_back(u[i]);
    Status failed;
    constexpr int kCallsEach = 4;  // what is asked again costs no evaluation
    const double worst = kLowest;
    subplex(
        from, step, kCallsEach * static_cast<int>(left()),
        [&](const Shares& at) {
          std::vector<Member> one{{u, 0}};
          for (std::size_t k = 0; k < free.size(); ++k) one[0].u[free[k]] = at[k];
          failed = ask(one, Phase::refine);
          if (!failed || one.empty()) return worst;
          const Rank r = rank(one[0]);
          if (r.violation > 0) return -kBroken * (1 + std::min(r.violation, kBroken));
          return r.objective;
        },
        [&] { return !failed || over(); });
    return failed;
  }
  static constexpr double kLowest = -1e30, kBroken = 1e9;

  Status climb(Shares& u) {
    for (bool gained = true; gained && !over();) {
      gained = false;
      std::vector<Member> around;
      for (std::size_t i = 0; i < n_; ++i) {
        const auto count = study_.vary[i].count();
        if (!count || *count < 2) continue;
        const Vary& v = study_.vary[i];
        const double each =
            v.values.empty() ? 1.0 / static_cast<double>(*count - 1) : 1.0 / static_cast<double>(*count);
        for (const double sign : {-1.0, 1.0}) {
          Member m{u, 0};
          m.u[i] += sign * each;
          if (m.u[i] > -1e-9 && m.u[i] < 1 + 1e-9) around.push_back(std::move(m));
        }
      }
      if (around.empty()) return {};
      const std::size_t before = *incumbent_;
      POLYPOD_TRY(ask(around, Phase::refine));
      gained = *incumbent_ != before;
      for (std::size_t i = 0; gained && i < n_; ++i) u[i] = study_.vary[i].share_of(out_.rows[*incumbent_].varied[i]);
    }
    return {};
  }

  // A front -----------------------------------------------------------------------------------------------------------

  /// What NSGA-II sorts by: constrained domination, then the distance to the neighbours on the same front.
  struct Sorted {
    std::vector<int> front;
    std::vector<double> crowding;
  };

  [[nodiscard]] std::vector<double> goals(const Member& m) const {
    const Evaluation& e = out_.rows[m.row].evaluation;
    std::vector<double> out = goals_of(study_, e, false), hopeful = goals_of(study_, e, true);
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] = 0.5 * (out[i] + hopeful[i]);
      if (std::isnan(out[i])) out[i] = -kInf;
    }
    return out;
  }

  [[nodiscard]] Sorted sorted(const std::vector<Member>& members) const {
    const std::size_t n = members.size();
    std::vector<std::vector<double>> g;
    std::vector<double> violation;
    for (const Member& m : members) {
      g.push_back(goals(m));
      violation.push_back(out_.rows[m.row].evaluation.violation);
    }
    const auto beats = [&](std::size_t a, std::size_t b) {
      if (violation[a] != violation[b]) return violation[a] < violation[b];
      return violation[a] == 0 && dominates(g[a], g[b]);
    };
    Sorted out{std::vector<int>(n, -1), std::vector<double>(n, 0)};
    std::size_t placed = 0;
    for (int front = 0; placed < n; ++front) {
      std::vector<std::size_t> here;
      for (std::size_t i = 0; i < n; ++i) {
        if (out.front[i] >= 0) continue;
        bool beaten = false;
        for (std::size_t k = 0; k < n && !beaten; ++k) beaten = k != i && (out.front[k] < 0) && beats(k, i);
        if (!beaten) here.push_back(i);
      }
      for (const std::size_t i : here) out.front[i] = front;
      placed += here.size();
      for (std::size_t k = 0; !g.empty() && k < g[0].size(); ++k) {
        std::stable_sort(here.begin(), here.end(), [&](std::size_t a, std::size_t b) { return g[a][k] < g[b][k]; });
        const double span = g[here.back()][k] - g[here.front()][k];
        out.crowding[here.front()] = out.crowding[here.back()] = kInf;
        for (std::size_t i = 1; i + 1 < here.size() && span > 0 && std::isfinite(span); ++i)
          out.crowding[here[i]] += (g[here[i + 1]][k] - g[here[i - 1]][k]) / span;
      }
    }
    return out;
  }

  Status genetic() {
    const auto size = static_cast<std::size_t>(std::clamp<std::int64_t>(left() / 12, 8, 100));
    std::vector<Member> population = latin(size, true);
    POLYPOD_TRY(ask(population, Phase::sample));
    int idle = 0;
    constexpr int kIdle = 30;
    while (!over() && population.size() >= 2 && idle < kIdle) {
      const Sorted order = sorted(population);
      const auto chosen = [&]() -> const Shares& {
        const std::size_t a = below(population.size()), b = below(population.size());
        const bool first =
            order.front[a] != order.front[b] ? order.front[a] < order.front[b] : order.crowding[a] >= order.crowding[b];
        return population[first ? a : b].u;
      };
      std::vector<Member> children;
      while (children.size() < size) {
        Shares a = chosen(), b = chosen();
        cross(a, b);
        mutate(a);
        mutate(b);
        children.push_back({std::move(a), 0});
        if (children.size() < size) children.push_back({std::move(b), 0});
      }
      const std::size_t before = out_.rows.size();
      POLYPOD_TRY(ask(children, Phase::search));
      idle = out_.rows.size() == before ? idle + 1 : 0;
      std::set<std::size_t> rows;  // each candidate once
      std::vector<Member> all;
      for (auto* list : {&population, &children})
        for (Member& m : *list)
          if (rows.insert(m.row).second) all.push_back(std::move(m));
      const Sorted next = sorted(all);
      std::vector<std::size_t> by(all.size());
      std::iota(by.begin(), by.end(), std::size_t{0});
      std::stable_sort(by.begin(), by.end(), [&](std::size_t a, std::size_t b) {
        return next.front[a] != next.front[b] ? next.front[a] < next.front[b] : next.crowding[a] > next.crowding[b];
      });
      population.clear();
      for (std::size_t i = 0; i < std::min(size, by.size()); ++i) population.push_back(std::move(all[by[i]]));
    }
    return {};
  }

  /// Simulated binary crossover.
  void cross(Shares& a, Shares& b) {
    constexpr double kChance = 0.9, kIndex = 15;
    if (random_.uniform() >= kChance) return;
    for (std::size_t i = 0; i < n_; ++i) {
      if (random_.uniform() >= 0.5) continue;
      const double r = random_.uniform();
      const double beta = r < 0.5 ? std::pow(2 * r, 1 / (kIndex + 1)) : std::pow(0.5 / (1 - r), 1 / (kIndex + 1));
      const double x = a[i], y = b[i];
      a[i] = std::clamp(0.5 * ((1 + beta) * x + (1 - beta) * y), 0.0, 1.0);
      b[i] = std::clamp(0.5 * ((1 - beta) * x + (1 + beta) * y), 0.0, 1.0);
    }
  }

  /// Polynomial mutation.
  void mutate(Shares& u) {
    constexpr double kIndex = 20;
    for (double& x : u) {
      if (random_.uniform() >= 1.0 / static_cast<double>(n_)) continue;
      const double r = random_.uniform();
      const double delta =
          r < 0.5 ? std::pow(2 * r, 1 / (kIndex + 1)) - 1 : 1 - std::pow(2 * (1 - r), 1 / (kIndex + 1));
      x = std::clamp(x + delta, 0.0, 1.0);
    }
  }

  const Study& study_;
  Store& store_;
  const OptimizeOptions& options_;
  std::size_t n_;
  Random random_;
  mutable std::optional<bool> is_candidate_;
  std::unordered_map<std::string, Row> known_;         // of the store
  std::unordered_map<std::string, std::size_t> seen_;  // by this search, as places in out_.rows
  std::set<std::int64_t> numbers_;
  std::int64_t last_ = 0;
  Incumbents incumbents_;
  std::optional<std::size_t> incumbent_;
  double spent_ = 0;
  int finished_ = 0;  // rows whose evaluation is there
  bool stopped_ = false;
  Outcome out_;
};

}  // namespace

Result<Outcome> optimize(const Study& study, Store& store, const OptimizeOptions& options) {
  return Search(study, store, options).run();
}

bool start_is_candidate(const Study& study) {
  const std::vector<double> values = study.values_of(study.start);
  if (values.empty()) return false;
  std::vector<double> near;
  constexpr double kSame = 1e-9;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Vary& v = study.vary[i];
    near.push_back(rounded(v.at(v.share_of(values[i]))));
    if (std::abs(near.back() - values[i]) > kSame * (1 + std::abs(values[i]))) return false;
  }
  const auto machine = study.machine_at(near);
  return machine && machine::to_toml(*machine) == machine::to_toml(study.start);
}

namespace {

bool counts(const Row& row, bool start_counts) {
  return row.evaluation.state == State::done && (row.phase != Phase::start || start_counts);
}

}  // namespace

std::optional<std::size_t> best_of(const Study& study, const std::vector<Row>& rows) {
  std::optional<std::size_t> best;
  if (study.wants_front()) return best;
  const bool start_counts = start_is_candidate(study);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!counts(rows[i], start_counts)) continue;
    if (!best || rows[i].evaluation.objective.value > rows[*best].evaluation.objective.value) best = i;
  }
  return best;
}

std::vector<std::size_t> front_of(const Study& study, const std::vector<Row>& rows) {
  const bool start_counts = start_is_candidate(study);
  std::vector<std::pair<std::vector<double>, std::size_t>> all;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!counts(rows[i], start_counts)) continue;
    Evaluation e = rows[i].evaluation;
    for (Value& v : e.figures) v.lower = v.upper = v.value;
    all.emplace_back(goals_of(study, e, true), i);
  }
  // Best first: what dominates a point stands before it.
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<std::size_t> out;
  std::vector<const std::vector<double>*> kept;
  for (const auto& [goals, i] : all) {
    const bool beaten = std::any_of(kept.begin(), kept.end(),
                                    [&goals = goals](const auto* p) { return *p == goals || dominates(*p, goals); });
    if (beaten) continue;
    kept.push_back(&goals);
    out.push_back(i);
  }
  return out;
}

}  // namespace polypod::design
