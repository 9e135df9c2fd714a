// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Files appear whole or not at all, and several of them together or not at all.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "polypod/core/error.hpp"

namespace polypod::files {

/// The bytes of a file; `-` is standard input. Errors: FI100 (not there, a directory, unreadable, more than 1 GiB).
Result<std::string> read(const std::string& path);

/// Files that appear together or not at all.
///
/// `add` writes a temporary file with a random name into the folder of each file; `commit` renames them all. If one
/// cannot be written or renamed, none appears: what was renamed before it is put back from a kept copy. What is not
/// committed is removed with the object. A file that exists keeps its mode (and its owner, where the system allows it);
/// a symbolic link stays and the file that it points to is replaced; another hard link to a replaced file keeps the old
/// bytes. Standard output, devices and pipes cannot be renamed: they are written to in `commit` before anything is
/// renamed. SIGINT, SIGTERM and SIGHUP wait for the renames of `commit`; a power cut between two renames does not.
class Outputs {
 public:
  Outputs();
  ~Outputs();
  Outputs(Outputs&&) noexcept;
  Outputs& operator=(Outputs&&) noexcept;
  Outputs(const Outputs&) = delete;
  Outputs& operator=(const Outputs&) = delete;

  /// `path` will hold `bytes`; `-` is standard output. Errors: FI101 (a directory, no such folder, no permission, disk
  /// full), FI102 (the same file as another one of these outputs, under this or another name).
  Status add(const std::string& path, std::string bytes);

  /// Lets all of them appear; empty afterwards. Errors: FI101, and FI103 where SIGINT, SIGTERM or SIGHUP is pending or
  /// close_outputs was called before the first rename; then no file has changed.
  Status commit();

 private:
  struct Pending;
  std::vector<Pending> pending_;
};

/// One file by itself: `Outputs` with one entry. Errors: FI101.
Status write_whole(const std::string& path, std::string_view bytes);

/// Whether a file could be written here, as far as can be told beforehand: the folder is there, and `path` is none.
/// Long work asks first. Errors: FI101.
Status may_write(const std::string& path);

/// Whether two names lead to one file: by name once links are followed, or by device and inode where both exist (hard
/// links, a folder mounted twice). Both may be new files.
bool same_file(const std::string& a, const std::string& b);

/// Whether `path` names standard output: `-`, /dev/stdout, /dev/fd/1, /proc/self/fd/1.
bool is_standard_output(const std::string& path);
/// Whether `path` names standard input: `-`, /dev/stdin, /dev/fd/0, /proc/self/fd/0.
bool is_standard_input(const std::string& path);

/// From now on standard output is kept for a file that is written there, and what is printed to stdout goes to stderr.
/// For programs, once. Errors: FI101 (standard output is closed).
Status keep_standard_output_for_files();

/// Opens what is closed of standard input, output and error, so that no file gets their numbers: input and output in
/// the wrong direction, so that using them stays an error; error as a sink. For programs, first thing in `main`.
void open_standard_streams() noexcept;

/// No commit of Outputs renames anything from now on; one that has begun ends. Safe in a signal handler.
void close_outputs() noexcept;
/// Whether a commit of this process has ended well.
bool outputs_appeared() noexcept;

/// Removes the temporary files that are open now; safe in a signal handler (waits up to a second for a `commit` on
/// another thread, so that outputs appear together). For handlers of signals that end the program.
void remove_temporaries() noexcept;

}  // namespace polypod::files
