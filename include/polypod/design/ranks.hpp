// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The processes of one `mpirun`, on one or many hosts: the first searches and keeps the database, the others compute.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "polypod/design/crew.hpp"

namespace polypod::design {

class Ranks {
 public:
  /// Whether mpirun has started this process beside others, as its environment says.
  static bool started();
  /// Joins the others. Errors: OP130 (this build has no MPI, or MPI does not start).
  static Result<std::unique_ptr<Ranks>> join();

  Ranks() = default;
  Ranks(const Ranks&) = delete;
  Ranks& operator=(const Ranks&) = delete;
  /// The first tells the others to end.
  virtual ~Ranks() = default;
  [[nodiscard]] virtual int rank() const = 0;
  [[nodiscard]] virtual int size() const = 0;
  /// Of rank 0: sends the study to the others; `text` is that of its file. The crew has `threads` threads in every
  /// rank, that of rank 0 as well. A rank that has not been heard of for 20 s is lost: what it was computing is given
  /// to others, so that it costs its evaluations alone. What rows evaluate to does not depend on the ranks.
  virtual std::unique_ptr<Crew> crew(const Study& study, const std::string& text, int threads,
                                     std::function<bool()> cancelled) = 0;
  /// How many were lost.
  [[nodiscard]] virtual int lost() const = 0;
  /// Of the other ranks: computes what rank 0 sends until it says that it is over, or until `cancelled`.
  virtual Status serve(int threads, const std::function<bool()>& cancelled) = 0;
};

}  // namespace polypod::design
