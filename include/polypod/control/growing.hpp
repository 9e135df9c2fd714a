// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Rows that a growing record got since somebody looked last. Nothing is kept between two looks.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "polypod/control/watch.hpp"

namespace polypod::control {

/// How far a reader has come.
struct RecordPlace {
  std::uint64_t from = 0;                                  ///< bytes of the file; 0: nothing was read
  std::string file;                                        ///< which file it was, as RecordNews says
  double time = -std::numeric_limits<double>::infinity();  ///< s, of the last row
};

struct RecordNews {
  bool there = true;       ///< the file is there, and its first line is whole
  bool anew = false;       ///< it is another file than before, or one that was begun anew: forget what was read
  RecordPlace next;        ///< where to go on
  std::uint64_t size = 0;  ///< bytes of the file
  /// Bytes before the rows that are left out, because the file has grown by more than `most`.
  std::uint64_t skipped = 0;
  std::uint64_t unfinished = 0;  ///< bytes of a last line that has no end yet
  std::vector<RecordRow> rows;
  std::size_t refused = 0;  ///< rows that cannot be read; they are left out
  std::string why;          ///< of the first of them
};

/// The rows behind `place`, of at most the last `most` bytes. A file is begun anew where it is shorter than before, has
/// another identity (it was replaced), or goes on with a time that does not rise. A file that is not there yet, or has
/// no whole first line, has no rows. Errors: FI100 (it cannot be read, or is no regular file), LC120. Cost: linear in
/// the bytes that are read.
Result<RecordNews> news_of(const machine::AnyMachine& machine, const std::string& path, const RecordPlace& place,
                           std::size_t most = std::size_t{1} << 20U);

}  // namespace polypod::control
