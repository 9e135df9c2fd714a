// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `polypod view` shows: pages of given files, and what those pages ask. Knows no sockets.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "polypod/core/error.hpp"
#include "polypod/machine/any_machine.hpp"

namespace polypod::viewer {

struct Request {
  std::string method = "GET";
  std::string path = "/";  ///< without the query
  std::string host, origin;
  std::string body;
};
struct Response {
  int status = 200;
  std::string type = "text/html; charset=utf-8";
  std::string body;
};

/// The given files, and nothing else: addresses are numbers, so no request names a path.
class Site {
 public:
  /// Machine files and names of the catalogue, reports (.html) that Polypod has written, programs (with the job that is
  /// given beside them, or alone), records (.csv) with the one machine that is given beside them, cells (their
  /// documentation with the cell in motion; judged anew for each page, a second or two), surfaces (.stl, .vtp). Errors:
  /// VW100 (no file), VW101 (a kind of file that is not shown), VW102 (a job without a program, two jobs), VW103 (an
  /// .html file that is no report of Polypod), VW104 (a record without its machine, or with two), and those of the
  /// readers.
  static Result<Site> of(const std::vector<std::string>& files, const std::string& version);

  /// The answer to a request. `port` is the server's own: Host must be 127.0.0.1 or localhost with it, Origin (if there
  /// is one) the same as an address: 403 otherwise. Files are read anew. Called from several threads. Cost: a pose
  /// below 10 ms; a workspace until its bounds are within 1 % or 30 000 boxes were examined; a program with its job as
  /// long as `correct`, a record as `watch`; rows of a growing record some ms, of a megabyte of it at most.
  [[nodiscard]] Response answer(const Request& request, int port) const;

  /// Long answers end early.
  void stop() const { *stopped_ = true; }

 private:
  struct Item {
    enum class Kind { machine, report, program, record, cell, surface } kind = Kind::machine;
    std::string path, beside;  ///< the job of a program (empty: none), the machine of a record
  };
  /// What each page of a browser asked for last: what it asked for before has no reader any more.
  class Runs {
   public:
    struct Run {
      std::string client;  ///< empty: nothing ends it
      std::uint64_t number = 0;
    };
    Run next(const std::string& client);
    [[nodiscard]] bool is_over(const Run& run) const;

   private:
    mutable std::mutex mutex_;
    std::map<std::string, std::uint64_t> newest_;
  };
  [[nodiscard]] Response page(std::size_t item) const;
  [[nodiscard]] Response list() const;
  /// The page that follows a record.
  [[nodiscard]] Response live_page(std::size_t item) const;
  [[nodiscard]] Result<std::string> ask(const Item& item, const std::string& what, const std::string& body) const;

  std::vector<Item> items_;
  std::string version_;
  std::shared_ptr<Runs> runs_ = std::make_shared<Runs>();
  std::shared_ptr<std::atomic<bool>> stopped_ = std::make_shared<std::atomic<bool>>(false);
};

}  // namespace polypod::viewer
