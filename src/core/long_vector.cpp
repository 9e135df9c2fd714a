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
#include <string>
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

/// Parts that the process holds, of all rows.
std::atomic<std::size_t> parts_held{0};

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

LongBytes::~LongBytes() {
  if (file_ >= 0) {
    give_up_file();
  } else {
    std::free(data_);
  }
}

void LongBytes::swap(LongBytes& other) noexcept {
  std::swap(data_, other.data_);
  std::swap(capacity_, other.capacity_);
  std::swap(file_, other.file_);
  std::swap(no_file_, other.no_file_);
  std::swap(last_come_to_, other.last_come_to_);
  std::swap(clock_, other.clock_);
  std::swap(held_, other.held_);
  here_ = other.here_.exchange(here_);
}

void LongBytes::make_room(std::size_t bytes) {
  if (bytes <= capacity_) return;
  if (file_ >= 0 && lengthen_file(bytes)) return;
  if (file_ < 0 && bytes > kInMemory && !no_file_ && move_to_file(bytes)) return;
  constexpr std::size_t kLeast = 64;
  move_to_heap(std::max({bytes, 2 * capacity_, kLeast}));
}

void LongBytes::hold(std::size_t part) const {
  while (busy_.test_and_set(std::memory_order_acquire)) {
  }
  here_.store(part, std::memory_order_relaxed);
  if (part >= last_come_to_.size()) last_come_to_.resize(capacity_ / kPart);
  if (last_come_to_[part] == 0) {
    if (held_ >= kParts && parts_held.load(std::memory_order_relaxed) >= kHeld / kPart) give_back_longest_left();
    ++held_;
    parts_held.fetch_add(1, std::memory_order_relaxed);
  }
  last_come_to_[part] = ++clock_;
  busy_.clear(std::memory_order_release);
}

void LongBytes::give_back_longest_left() const {
  std::size_t oldest = kNone;
  for (std::size_t k = 0; k < last_come_to_.size(); ++k)
    if (last_come_to_[k] != 0 && (oldest == kNone || last_come_to_[k] < last_come_to_[oldest])) oldest = k;
  ::madvise(data_ + oldest * kPart, kPart, MADV_DONTNEED);  // it stays in the file
  last_come_to_[oldest] = 0;
  --held_;
  parts_held.fetch_sub(1, std::memory_order_relaxed);
}

void LongBytes::hold_none() {
  parts_held.fetch_sub(held_, std::memory_order_relaxed);
  held_ = 0;
  last_come_to_.clear();
  here_ = kNone;
}

bool LongBytes::move_to_file(std::size_t bytes) {
  no_file_ = true;
  const int file = open_nameless();
  if (file < 0) return false;
  const std::size_t size = whole_parts(std::max(bytes, 2 * capacity_));
  void* mapped = fill(file, 0, size) ? ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0) : MAP_FAILED;
  if (mapped == MAP_FAILED) {
    ::close(file);
    return false;
  }
  no_file_ = false;
  for (std::size_t at = 0; at < capacity_; at += kPart) {
    const std::size_t n = std::min(kPart, capacity_ - at);
    std::memcpy(static_cast<char*>(mapped) + at, data_ + at, n);
    ::madvise(static_cast<char*>(mapped) + at, kPart, MADV_DONTNEED);
  }
  std::free(data_);
  data_ = static_cast<char*>(mapped);
  capacity_ = size;
  file_ = file;
  hold_none();
  return true;
}

bool LongBytes::lengthen_file(std::size_t bytes) {
  constexpr std::size_t kShare = 8;  // longer by an eighth, at least by four parts
  const std::size_t size = whole_parts(std::max(bytes, capacity_ + std::max(4 * kPart, capacity_ / kShare)));
  if (!fill(file_, capacity_, size)) return false;
  void* mapped = ::mremap(data_, capacity_, size, MREMAP_MAYMOVE);
  if (mapped == MAP_FAILED) return false;
  data_ = static_cast<char*>(mapped);
  capacity_ = size;
  return true;
}

void LongBytes::move_to_heap(std::size_t bytes) {
  if (file_ < 0) {
    void* grown = std::realloc(data_, bytes);
    if (grown == nullptr) throw std::bad_alloc();
    data_ = static_cast<char*>(grown);
  } else {
    auto* heap = static_cast<char*>(std::malloc(bytes));
    if (heap == nullptr) throw std::bad_alloc();
    std::memcpy(heap, data_, capacity_);
    give_up_file();
    data_ = heap;
    no_file_ = true;
  }
  capacity_ = bytes;
}

void LongBytes::give_up_file() {
  hold_none();
  ::munmap(data_, capacity_);
  ::close(file_);
  file_ = -1;
}

}  // namespace polypod
