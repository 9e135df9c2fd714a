// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/optimize.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "ledger.hpp"
#include "polypod/design/cell_study.hpp"
#include "rounded.hpp"

namespace polypod::design {
namespace {

/// How many candidates there are; nothing where a parameter is a continuum.
std::optional<std::int64_t> combinations(const Study& study) {
  double all = 1;
  for (const Vary& v : study.vary) {
    const auto count = v.count();
    if (!count) return {};
    all *= static_cast<double>(*count);
  }
  constexpr double kMost = 1e12;
  return static_cast<std::int64_t>(std::min(all, kMost));
}

/// The share of the k-th value of a parameter with steps or a list.
double share_at(const Vary& v, std::int64_t k) {
  const auto count = static_cast<double>(*v.count());
  if (!v.values.empty()) return (static_cast<double>(k) + 0.5) / count;
  return count > 1 ? static_cast<double>(k) / (count - 1) : 0;
}

/// But for the rounding of what is varied.
bool same(double a, double b) {
  constexpr double kRounded = 1e-9;
  return std::abs(a - b) <= kRounded * (1 + std::abs(b));
}

bool counts(const Row& row, bool start_counts) {
  return row.evaluation.state == State::done && (row.phase != Phase::start || start_counts);
}

}  // namespace

Status try_all(Ledger& ledger) {
  const std::vector<Vary>& vary = ledger.study().vary;
  std::vector<std::int64_t> at(vary.size(), 0);
  constexpr std::size_t kBatch = 64;
  for (bool more = true; more && !ledger.over();) {
    std::vector<Member> batch;
    while (more && batch.size() < kBatch) {
      Member m;
      for (std::size_t i = 0; i < vary.size(); ++i) m.u.push_back(share_at(vary[i], at[i]));
      batch.push_back(std::move(m));
      std::size_t i = 0;
      while (i < vary.size() && ++at[i] == *vary[i].count()) at[i++] = 0;
      more = i < vary.size();
    }
    POLYPOD_TRY(ledger.ask(batch, Phase::grid));
  }
  return {};
}

Result<Outcome> optimize(const Study& study, Store& store, const OptimizeOptions& options) {
  OptimizeOptions with_crew = options;
  std::unique_ptr<Crew> own;
  if (with_crew.crew == nullptr) {
    own = thread_crew(study, options.threads, options.cancelled);
    with_crew.crew = own.get();
  }
  Ledger ledger(study, store, with_crew);
  POLYPOD_TRY(ledger.begin());
  if (const auto all = combinations(study); all && *all <= ledger.left()) {
    POLYPOD_TRY(try_all(ledger));
  } else if (study.wants_front()) {
    POLYPOD_TRY(find_front(ledger));
  } else {
    POLYPOD_TRY(find_best(ledger));
  }
  return ledger.end();
}

std::string in_words(const std::vector<Start>& starts, const std::vector<Row>& rows) {
  std::string out;
  for (const Start& s : starts) {
    const auto row = std::find_if(rows.begin(), rows.end(), [&](const Row& r) { return r.row == s.row; });
    if (row == rows.end()) continue;
    const Evaluation& e = row->evaluation;
    out += out.empty() ? "" : "; ";
    if (e.state == State::done) {
      out += fmt::format("{:.6g} (row {})", e.objective.value, s.row);
    } else if (e.state == State::dropped) {
      out += fmt::format("at most {:.6g} (row {}, proven worse)", e.objective.upper, s.row);
    } else {
      out += fmt::format("no candidate that keeps the holds (row {})", s.row);
    }
    if (!s.by_itself) out += fmt::format(" after its {} evaluations", s.evaluations);
  }
  return fmt::format("{} {} ended at {}", starts.size(), starts.size() == 1 ? "start" : "starts", out);
}

bool JudgedAgain::holds_kept() const {
  return std::all_of(rows.begin(), rows.end(), [](const Row& row) { return row.evaluation.state == State::done; });
}

Result<std::optional<JudgedAgain>> kept_again(const Store& store) {
  POLYPOD_ASSIGN(kept, store.judged_again());
  if (kept.second.empty()) return std::optional<JudgedAgain>{};
  return std::optional<JudgedAgain>(JudgedAgain{kept.first, std::move(kept.second)});
}

std::optional<std::vector<double>> as_candidate(const Study& study, const std::vector<double>& values) {
  std::vector<double> near;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const Vary& v = study.vary[i];
    near.push_back(rounded(v.at(v.share_of(values[i]))));
    if (!same(near.back(), values[i])) return std::nullopt;
  }
  return near;
}

bool start_is_candidate(const Study& study) {
  const std::vector<double> values = study.values_of(study.start);
  if (values.empty()) return false;
  const auto candidate = as_candidate(study, values);
  if (!candidate) return false;
  const std::vector<double>& near = *candidate;
  if (study.of_cell) {
    const auto cell = cell_at(study, near);
    return cell && *cell == study.machine_toml;
  }
  // Not whether the texts are alike: one joint that is set turns radius and angle into a list of joints.
  const auto set = study.parameters(near);
  return std::all_of(set.begin(), set.end(), [&](const auto& s) {
    const std::optional<double> own = Study::value_of(study.start, s.first);
    return own && same(*own, s.second);
  });
}
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
    std::vector<double> goals;
    for (std::size_t k = 0; k < study.goals.size(); ++k) {  // goals come first among the figures
      const double value = rows[i].evaluation.figures[k].value;
      goals.push_back(study.goals[k].maximise ? value : -value);
    }
    all.emplace_back(std::move(goals), i);
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
