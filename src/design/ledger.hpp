// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a search has asked for and what came back: the rows, those that the store has, and the evaluations that are
// left.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "polypod/core/random.hpp"
#include "polypod/design/optimize.hpp"

namespace polypod::design {

using Shares = std::vector<double>;  // of each varied parameter, 0 to 1

/// One candidate as a search sees it.
struct Member {
  Shares u;
  std::size_t row = 0;  ///< of Ledger::rows()
};

class Ledger {
 public:
  Ledger(const Study& study, Store& store, const OptimizeOptions& options);

  /// Takes the rows of the store, and judges the start.
  Status begin();
  /// Rows of these candidates, as far as evaluations are left; the members beyond get none and are dropped.
  Status ask(std::vector<Member>& members, Phase phase);
  /// The same, but members stay where they are; those beyond the last evaluation lose their shares.
  Status ask_in_place(std::vector<Member>& members, Phase phase);
  /// Candidates one after another: `next` is asked for the k-th as soon as the (k - `window`)-th is known, whatever has
  /// been done of those between, which it gets as `in_work`; so the rows do not depend on who computes them. `known`
  /// gets each in its order, and whether it had not been asked for before. Ends with the evaluations, or when `next`
  /// says nothing and all are known.
  struct Stream {
    std::size_t window = 1;
    Phase phase = Phase::search;
    std::function<std::optional<Shares>(const std::vector<Member>& in_work)> next;
    std::function<void(const Member&, bool fresh)> known;
  };
  Status ask_in_turn(const Stream& stream);
  /// Everything, with the rows of the store that this search did not ask for behind its own.
  Result<Outcome> end();

  [[nodiscard]] const Study& study() const { return study_; }
  [[nodiscard]] std::size_t n() const { return study_.vary.size(); }
  [[nodiscard]] const std::vector<Row>& rows() const { return out_.rows; }
  [[nodiscard]] const Evaluation& of(const Member& m) const { return out_.rows[m.row].evaluation; }
  /// Less what is being computed.
  [[nodiscard]] std::int64_t left() const {
    return study_.evaluations - static_cast<std::int64_t>(out_.rows.size() + in_work_);
  }
  [[nodiscard]] bool over() const { return stopped_ || left() <= 0; }

  /// Where a row stands in the ranges.
  [[nodiscard]] Shares shares_of(const Row& row) const;
  /// All but the machine of the study, where that is none.
  [[nodiscard]] bool is_candidate(const Row& row) const { return row.phase != Phase::start || is_candidate_; }
  /// One candidate in each of `count` slices of every range; the first is the start, as far as it has a place there.
  std::vector<Member> latin(std::size_t count, bool with_start);
  /// Remembers how one of several starts ended. One that was broken off is not remembered.
  void add_start(const Start& start) {
    if (!stopped_) out_.starts.push_back(start);
  }
  Random& random() { return random_; }
  /// 0 to n - 1.
  std::size_t below(std::size_t n);

 private:
  class Work;
  [[nodiscard]] std::string key_for(const Row& row) const;
  Status start();
  Status ask_rows(const std::vector<std::pair<std::string, Row>>& asked);
  Status compute(Work& work);
  std::int64_t number(std::int64_t wanted);
  [[nodiscard]] bool counts(const Row& row) const;
  void learn(std::size_t place);
  Status tell_of_better();
  void report(Phase phase, std::chrono::steady_clock::time_point begin) const;

  const Study& study_;
  Store& store_;
  const OptimizeOptions& options_;
  Random random_;
  bool is_candidate_;
  std::vector<Row> stored_;
  std::unordered_map<std::string, std::size_t> known_;  // of the store, as places in stored_
  std::vector<bool> taken_;                             // of stored_: this search asked for it
  std::unordered_map<std::string, std::size_t> seen_;   // by this search, as places in out_.rows
  std::set<std::int64_t> numbers_;
  std::int64_t last_ = 0;
  Incumbents incumbents_;
  std::optional<std::size_t> incumbent_;
  double told_;  // objective of the best row that was told of, or that the store had
  double spent_ = 0;
  std::size_t in_work_ = 0;  // rows that are not among those of out_ yet
  int finished_ = 0;         // rows whose evaluation is there
  bool stopped_ = false;
  Outcome out_;
};

/// All combinations of steps and lists, in batches.
Status try_all(Ledger& ledger);
/// The search for one machine, and that for a front.
Status find_best(Ledger& ledger);
Status find_front(Ledger& ledger);

}  // namespace polypod::design
