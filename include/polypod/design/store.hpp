// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Every evaluation of a study, in one SQLite file.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "polypod/design/evaluate.hpp"

namespace polypod::design {

/// How a candidate came to be.
enum class Phase : std::uint8_t {
  start,   ///< the machine of the study as it is, for comparison; it is no candidate
  sample,  ///< of the first sample over all ranges
  grid,    ///< one of all combinations
  search,  ///< of the global search
  refine,  ///< of the local refinement
};
const char* name_of(Phase phase);

/// One evaluation.
struct Row {
  std::int64_t row = 0;        ///< from 1, in the order in which the search asks
  std::vector<double> varied;  ///< of Study::vary, in the units of their keys
  Evaluation evaluation;
  Phase phase = Phase::search;
  std::string version;  ///< of Polypod that computed it
  std::string at;       ///< when it was done, UTC: "2026-01-31T12:00:00Z"
};

/// The file `study.sqlite` of a folder. Its tables: `meta` (key, value) and `evaluation`, a row each: `row, state,
/// reason, phase, objective, objective_lower, objective_upper, violation, seconds, seed, version, at`, then the varied
/// parameters under `vary:KEY` and the figures under `figure:NAME`, `figure:NAME:lower` and `figure:NAME:upper`. Each
/// row is committed by itself: what was stored survives any end of the process.
class Store {
 public:
  /// Opens the folder of a study for writing and makes it where it is not there. `version` of Polypod; `text` of the
  /// study file, empty: that which is kept. Errors: OP110 (the folder or the file cannot be made or opened), OP111 (not
  /// a database of studies), OP112 (another study), OP113 (another version), OP114 (another process works on it), OP115
  /// (disk full).
  static Result<Store> open(const std::string& folder, const Study& study, const std::string& text,
                            const std::string& version);
  /// Opens it for reading; another process may write meanwhile. Errors: OP110, OP111, OP116 (no study there).
  static Result<Store> read(const std::string& folder);

  Store(Store&&) noexcept;
  Store& operator=(Store&&) noexcept;
  ~Store();

  /// The study as it was stored; of read() alone.
  [[nodiscard]] const Study& study() const;
  [[nodiscard]] const std::string& version() const;  ///< that made the database
  /// All rows, by number. Cost: 1 us each.
  [[nodiscard]] Result<std::vector<Row>> rows() const;
  /// Errors: OP115.
  Status add(const Row& row);
  /// The evaluations of sensitivity analyses (study_sensitivity), in a table `sensitivity` of the same columns. They
  /// are no rows of the search. Empty where there are none. Errors: OP115.
  [[nodiscard]] Result<std::vector<Row>> samples() const;
  Status add_sample(const Row& row);
  /// What a survey of this resolution said of some of the rows, in a table `judged_again` of the same columns, instead
  /// of what was there; no rows: nothing is there. Errors: OP115.
  Status set_judged_again(int resolution, const std::vector<Row>& rows);
  [[nodiscard]] Result<std::pair<int, std::vector<Row>>> judged_again() const;
  /// The machines that the study compares with, in a table `compared` of the same columns, numbered from 1 in its
  /// order. Errors: OP115.
  Status set_compared(const std::vector<Row>& rows);
  [[nodiscard]] Result<std::vector<Row>> compared() const;
  /// A text under a key of `meta`; empty where the key is not there.
  [[nodiscard]] Result<std::string> note(const std::string& key) const;
  Status set_note(const std::string& key, const std::string& text);
  /// Remembers that the search ended by itself, or that it did not.
  Status set_complete(bool complete);
  [[nodiscard]] Result<bool> complete() const;
  /// All in one file again, without those that SQLite keeps beside it while it writes.
  Status close();

 private:
  struct Impl;
  explicit Store(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// `folder`/study.sqlite.
std::string database_of(const std::string& folder);
/// Every file that a store keeps in its folder: the database, what SQLite puts beside it, and the lock.
std::vector<std::string> files_of(const std::string& folder);

}  // namespace polypod::design
