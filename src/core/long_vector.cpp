// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/core/long_vector.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace polypod {
namespace {

/// A file that vanishes with its descriptor; -1 where there is none to be had.
int open_nameless() {
  const char* given = std::getenv("TMPDIR");
  const std::string folder = given != nullptr && *given != '\0' ? given : "/tmp";
  const int file = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file >= 0 || (errno != EOPNOTSUPP && errno != EISDIR && errno != ENOENT)) return file;
  std::string name = folder + "/.polypod-XXXXXX";  // a file system without nameless files
  const int named = ::mkostemp(name.data(), O_CLOEXEC);
  if (named >= 0) ::unlink(name.c_str());
  return named;
}

/// Zeros from `begin` to `end`, whose space is there when the mapping is.
bool fill(int file, std::size_t begin, std::size_t end) {
  if (::fallocate(file, 0, static_cast<off_t>(begin), static_cast<off_t>(end - begin)) == 0) return true;
  static constexpr std::array<char, LongBytes::kPart> kZeros{};
  while (begin < end) {
    const ssize_t n = ::pwrite(file, kZeros.data(), std::min(kZeros.size(), end - begin), static_cast<off_t>(begin));
    if (n <= 0 && !(n < 0 && errno == EINTR)) return false;
    if (n > 0) begin += static_cast<std::size_t>(n);
  }
  return true;
}

std::size_t whole_parts(std::size_t bytes) {
  return (bytes + LongBytes::kPart - 1) / LongBytes::kPart * LongBytes::kPart;
}

}  // namespace

/// The file of a row, and which parts of it the process holds.
class LongBytes::File {
 public:
  /// A file of whole parts, mapped; none where it cannot be had.
  static File* make(std::size_t size) {
    const int file = open_nameless();
    if (file < 0) return nullptr;
    void* mapped =
        fill(file, 0, size) ? ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0) : MAP_FAILED;
    if (mapped != MAP_FAILED) return new File(file, static_cast<char*>(mapped), size);
    ::close(file);
    return nullptr;
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  File(File&&) = delete;
  File& operator=(File&&) = delete;
  ~File() {
    {
      Rows& rows = Rows::all();
      const std::lock_guard lock(rows.busy);
      rows.files.erase(std::find(rows.files.begin(), rows.files.end(), this));
      for (const std::uint64_t come : last_come_to_) rows.parts_held -= come != 0 ? 1 : 0;
    }
    ::munmap(data_, size_);
    ::close(file_);
  }

  [[nodiscard]] char* data() const { return data_; }

  /// False where there is no room.
  bool lengthen(std::size_t size) {
    if (!fill(file_, size_, size)) return false;
    Rows& rows = Rows::all();
    const std::lock_guard lock(rows.busy);
    void* mapped = ::mremap(data_, size_, size, MREMAP_MAYMOVE);
    if (mapped == MAP_FAILED) return false;
    data_ = static_cast<char*>(mapped);
    size_ = size;
    last_come_to_.resize(size / kPart);
    return true;
  }

  void come_to(std::size_t part) {
    Rows& rows = Rows::all();
    const std::lock_guard lock(rows.busy);
    if (last_come_to_[part] == 0) {
      if (rows.parts_held >= kHeld / kPart) rows.give_back();
      ++rows.parts_held;
    }
    last_come_to_[part] = newest_ = ++rows.clock;
  }

  /// From `begin` to `end`, bytes at the bounds of parts: what was written there stays in the file.
  void give_back(std::size_t begin, std::size_t end) const { ::madvise(data_ + begin, end - begin, MADV_DONTNEED); }

 private:
  File(int file, char* data, std::size_t size) : file_(file), data_(data), size_(size), last_come_to_(size / kPart) {
    Rows& rows = Rows::all();
    const std::lock_guard lock(rows.busy);
    rows.files.push_back(this);
  }

  /// All files of the process.
  struct Rows {
    static Rows& all() {
      static Rows& rows = *new Rows;  // rows that are static are gone after it
      return rows;
    }

    /// Gives back three of four parts, those that were left longest ago, but of no row the one that it came to last.
    /// Many at once: to take a part away stops all threads for a moment.
    void give_back() {
      ages.clear();
      for (const File* f : files) {
        for (const std::uint64_t come : f->last_come_to_)
          if (come != 0) ages.push_back(come);
      }
      const auto kept = ages.begin() + static_cast<std::ptrdiff_t>(ages.size() * 3 / 4);
      std::nth_element(ages.begin(), kept, ages.end());
      for (File* f : files) parts_held -= f->give_back_older(*kept);
    }

    std::mutex busy;
    std::vector<File*> files;
    std::size_t parts_held = 0;
    std::uint64_t clock = 0;
    std::vector<std::uint64_t> ages;
  };

  /// Parts that are side by side go together; how many went.
  std::size_t give_back_older(std::uint64_t than) {
    std::size_t gone = 0;
    const std::size_t parts = last_come_to_.size();
    for (std::size_t k = 0; k < parts;) {
      const std::size_t first = k;
      for (; k < parts && last_come_to_[k] != 0 && last_come_to_[k] < than && last_come_to_[k] != newest_; ++k)
        last_come_to_[k] = 0;
      if (k > first) give_back(first * kPart, k * kPart);
      gone += k - first;
      if (k == first) ++k;
    }
    return gone;
  }

  int file_;
  char* data_;
  std::size_t size_;
  std::vector<std::uint64_t> last_come_to_;  // of each part, by the clock of all rows; 0: not held
  std::uint64_t newest_ = 0;
};

LongBytes::~LongBytes() {
  if (file_ == nullptr) std::free(data_);
  delete file_;
}

void LongBytes::swap(LongBytes& other) noexcept {
  std::swap(data_, other.data_);
  std::swap(capacity_, other.capacity_);
  std::swap(file_, other.file_);
  std::swap(no_file_, other.no_file_);
  here_ = other.here_.exchange(here_);
}

void LongBytes::make_room(std::size_t bytes) {
  if (bytes <= capacity_) return;
  constexpr std::size_t kShare = 8;  // a file gets longer by an eighth, at least by four parts
  const std::size_t longer = whole_parts(std::max(bytes, capacity_ + std::max(4 * kPart, capacity_ / kShare)));
  if (file_ != nullptr && file_->lengthen(longer)) {
    data_ = file_->data();
    capacity_ = longer;
    return;
  }
  if (file_ == nullptr && bytes > kInMemory && !no_file_ && move_to_file(bytes)) return;
  constexpr std::size_t kLeast = 64;
  move_to_heap(std::max({bytes, 2 * capacity_, kLeast}));
}

void LongBytes::hold(std::size_t part) const {
  here_.store(part, std::memory_order_relaxed);
  file_->come_to(part);
}

bool LongBytes::move_to_file(std::size_t bytes) {
  const std::size_t size = whole_parts(std::max(bytes, 2 * capacity_));
  file_ = File::make(size);
  no_file_ = file_ == nullptr;
  if (no_file_) return false;
  for (std::size_t at = 0; at < capacity_; at += kPart) {
    std::memcpy(file_->data() + at, data_ + at, std::min(kPart, capacity_ - at));
    file_->give_back(at, at + kPart);
  }
  std::free(data_);
  data_ = file_->data();
  capacity_ = size;
  here_ = kNone;
  return true;
}

void LongBytes::move_to_heap(std::size_t bytes) {
  if (file_ == nullptr) {
    void* grown = std::realloc(data_, bytes);
    if (grown == nullptr) throw std::bad_alloc();
    data_ = static_cast<char*>(grown);
  } else {
    auto* heap = static_cast<char*>(std::malloc(bytes));
    if (heap == nullptr) throw std::bad_alloc();
    std::memcpy(heap, data_, capacity_);
    delete std::exchange(file_, nullptr);
    data_ = heap;
    no_file_ = true;
  }
  capacity_ = bytes;
}

}  // namespace polypod
