// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/control/growing.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "polypod/core/text.hpp"

namespace polypod::control {
namespace {

class File {
 public:
  /// A pipe without a writer does not keep it waiting.
  explicit File(const std::string& path) : number_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {}
  ~File() {
    if (number_ >= 0) ::close(number_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  [[nodiscard]] int number() const { return number_; }
  /// Fewer bytes at the end of the file.
  [[nodiscard]] std::string bytes(std::uint64_t from, std::size_t count) const {
    std::string out(count, '\0');
    std::size_t have = 0;
    while (have < count) {
      const ssize_t n = ::pread(number_, out.data() + have, count - have, static_cast<off_t>(from + have));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) break;
      have += static_cast<std::size_t>(n);
    }
    out.resize(have);
    return out;
  }

 private:
  int number_;
};

constexpr std::size_t kLongestHeader = 1 << 16;

}  // namespace

Result<RecordNews> news_of(const machine::AnyMachine& machine, const std::string& path, const RecordPlace& place,
                           std::size_t most) {
  RecordNews out;
  const auto nothing = [&] {
    out.there = false;
    out.anew = place.from > 0;
    out.next = {};
    return out;
  };
  const File file(path);
  if (file.number() < 0 && errno == ENOENT) return nothing();
  struct stat is {};
  if (file.number() < 0 || ::fstat(file.number(), &is) != 0 || !S_ISREG(is.st_mode)) {
    return fail("FI100",
                fmt::format("cannot read {}: {}", one_line(path),
                            file.number() < 0 ? std::strerror(errno) : "it is no file that could grow"),
                {}, "a record that is followed is a file to which a program appends rows");
  }
  out.size = static_cast<std::uint64_t>(is.st_size);
  const std::string head = file.bytes(0, std::min<std::uint64_t>(out.size, kLongestHeader));
  const std::size_t header = head.find('\n');
  if (header == std::string::npos && head.size() == kLongestHeader)
    return fail("LC120", fmt::format("the first line has no end within {} bytes", kLongestHeader), {path, 1, 1},
                "give a record");
  if (header == std::string::npos) {
    out.unfinished = head.size();
    return nothing();
  }
  POLYPOD_ASSIGN(reader, RecordReader::of(machine, head.substr(0, header), path));
  out.next.file = fmt::format("{}-{}", is.st_dev, is.st_ino);
  const std::uint64_t first = header + 1;
  std::uint64_t from = place.from;
  const auto begin_anew = [&] {
    out.anew = place.from > 0;
    from = first;
  };
  if (from < first || from > out.size || place.file != out.next.file || file.bytes(from - 1, 1) != "\n") begin_anew();
  for (;;) {
    out.rows.clear();
    out.refused = 0;
    out.why.clear();
    out.skipped = 0;
    std::uint64_t at = from;
    if (out.size - from > most) {
      at = out.size - most;
      out.skipped = at - from;
    }
    const std::string text = file.bytes(at, static_cast<std::size_t>(out.size - at));
    std::size_t begin = 0;
    if (out.skipped > 0) {  // the line into which it fell
      const std::size_t end = text.find('\n');
      begin = end == std::string::npos ? text.size() : end + 1;
      out.skipped += begin;
    }
    RecordReader rows = reader;
    for (std::size_t end = text.find('\n', begin); end != std::string::npos; end = text.find('\n', begin)) {
      const std::string line = text.substr(begin, end - begin);
      begin = end + 1;
      if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
      auto row = rows.row(line);
      if (row) {
        out.rows.push_back(std::move(*row));
      } else if (++out.refused == 1) {
        out.why = row.error().id + " " + row.error().message;
      }
    }
    out.next.from = at + begin;
    out.unfinished = text.size() - begin;
    // A file that was cut and has grown beyond where it was read to.
    if (!out.anew && !out.rows.empty() && from != first && !(out.rows.front().time > place.time)) {
      begin_anew();
      continue;
    }
    break;
  }
  out.next.time = !out.rows.empty() ? out.rows.back().time : out.anew ? RecordPlace{}.time : place.time;
  return out;
}

}  // namespace polypod::control
