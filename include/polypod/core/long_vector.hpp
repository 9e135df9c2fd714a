// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Vectors of any length in little memory: what is long lies in a temporary file.
#pragma once

#include <atomic>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <iterator>
#include <new>
#include <type_traits>
#include <utility>
#include <vector>

namespace polypod {

/// Bytes in a row. Up to kInMemory of them are on the heap; more are a mapped file without a name in the folder
/// TMPDIR (else /tmp), of which the process holds the parts that were last come to: of all rows together no more than
/// kHeld. Where the file cannot be written they stay on the heap.
class LongBytes {
 public:
  static constexpr std::size_t kInMemory = std::size_t{1} << 18;
  static constexpr std::size_t kPart = std::size_t{1} << 17;
  static constexpr std::size_t kHeld = std::size_t{40} << 20;  ///< bytes, of all that are alive

  LongBytes() = default;
  LongBytes(LongBytes&& other) noexcept { swap(other); }
  LongBytes& operator=(LongBytes&& other) noexcept {
    swap(other);
    return *this;
  }
  LongBytes(const LongBytes&) = delete;
  LongBytes& operator=(const LongBytes&) = delete;
  ~LongBytes();

  void swap(LongBytes& other) noexcept;
  [[nodiscard]] char* data() const { return data_; }
  [[nodiscard]] std::size_t capacity() const { return capacity_; }
  [[nodiscard]] bool in_file() const { return file_ != nullptr; }
  /// Room for so many bytes; what is there may move. Errors: std::bad_alloc.
  void make_room(std::size_t bytes);
  /// Whoever reads or writes at `offset` says so: parts that were left long ago are given back to the file. From
  /// several threads at once.
  void come_to(std::size_t offset) const {
    if (file_ == nullptr) return;
    const std::size_t part = offset / kPart;
    if (part != here_.load(std::memory_order_relaxed)) hold(part);
  }

 private:
  class File;
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  void hold(std::size_t part) const;
  bool move_to_file(std::size_t bytes);
  void move_to_heap(std::size_t bytes);

  char* data_ = nullptr;
  std::size_t capacity_ = 0;
  File* file_ = nullptr;
  bool no_file_ = false;  // there was no room for one
  mutable std::atomic<std::size_t> here_{kNone};
};

/// As std::vector, for elements without destructors: references stay valid until it grows, also beyond what is held in
/// memory. Elements may be read from several threads at once.
template <class T>
class LongVector {
  static_assert(std::is_trivially_destructible_v<T> && alignof(T) <= alignof(std::max_align_t));

  template <class Vector, class Value>
  class Iterator {
   public:
    using iterator_category = std::random_access_iterator_tag;
    using value_type = T;
    using difference_type = std::ptrdiff_t;
    using pointer = Value*;
    using reference = Value&;

    Iterator() = default;
    Iterator(Vector* vector, std::size_t at) : vector_(vector), at_(at) {}
    reference operator*() const { return (*vector_)[at_]; }
    pointer operator->() const { return &(*vector_)[at_]; }
    reference operator[](difference_type n) const { return (*vector_)[at_ + static_cast<std::size_t>(n)]; }
    Iterator& operator++() { return *this += 1; }
    Iterator& operator--() { return *this -= 1; }
    Iterator operator++(int) {
      Iterator before = *this;
      ++*this;
      return before;
    }
    Iterator operator--(int) {
      Iterator before = *this;
      --*this;
      return before;
    }
    Iterator& operator+=(difference_type n) {
      at_ += static_cast<std::size_t>(n);
      return *this;
    }
    Iterator& operator-=(difference_type n) { return *this += -n; }
    friend Iterator operator+(Iterator a, difference_type n) { return a += n; }
    friend Iterator operator+(difference_type n, Iterator a) { return a += n; }
    friend Iterator operator-(Iterator a, difference_type n) { return a -= n; }
    friend difference_type operator-(const Iterator& a, const Iterator& b) {
      return static_cast<difference_type>(a.at_) - static_cast<difference_type>(b.at_);
    }
    friend bool operator==(const Iterator& a, const Iterator& b) { return a.at_ == b.at_; }
    friend auto operator<=>(const Iterator& a, const Iterator& b) { return a.at_ <=> b.at_; }

   private:
    Vector* vector_ = nullptr;
    std::size_t at_ = 0;
  };

 public:
  using value_type = T;
  using iterator = Iterator<LongVector, T>;
  using const_iterator = Iterator<const LongVector, const T>;

  LongVector() = default;
  explicit LongVector(std::size_t count, const T& value = T()) { assign(count, value); }
  LongVector(std::initializer_list<T> values) { append(values.begin(), values.size()); }
  template <std::input_iterator In>
  LongVector(In first, In last) {
    for (; first != last; ++first) push_back(*first);
  }
  LongVector(LongVector&& other) noexcept { swap(other); }
  LongVector& operator=(LongVector&& other) noexcept {
    LongVector taken(std::move(other));
    swap(taken);
    return *this;
  }
  LongVector(const LongVector& other) { append(other); }
  LongVector& operator=(const LongVector& other) {
    if (this == &other) return *this;
    clear();
    append(other);
    return *this;
  }
  ~LongVector() = default;

  void swap(LongVector& other) noexcept {
    bytes_.swap(other.bytes_);
    std::swap(size_, other.size_);
  }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  void clear() { size_ = 0; }
  T& operator[](std::size_t i) {
    bytes_.come_to(i * sizeof(T));
    return at(i);
  }
  const T& operator[](std::size_t i) const {
    bytes_.come_to(i * sizeof(T));
    return at(i);
  }
  [[nodiscard]] const T& front() const { return (*this)[0]; }
  [[nodiscard]] const T& back() const { return (*this)[size_ - 1]; }
  T& front() { return (*this)[0]; }
  T& back() { return (*this)[size_ - 1]; }
  iterator begin() { return {this, 0}; }
  iterator end() { return {this, size_}; }
  [[nodiscard]] const_iterator begin() const { return {this, 0}; }
  [[nodiscard]] const_iterator end() const { return {this, size_}; }

  void push_back(const T& value) {
    if ((size_ + 1) * sizeof(T) > bytes_.capacity()) {
      const T copy = value;  // NOLINT(performance-unnecessary-copy-initialization): may be one of its own
      bytes_.make_room((size_ + 1) * sizeof(T));
      new (place(size_)) T(copy);
    } else {
      new (place(size_)) T(value);
    }
    ++size_;
  }
  void pop_back() { --size_; }
  void assign(std::size_t count, const T& value) {
    const T copy = value;
    clear();
    if (count * sizeof(T) > bytes_.capacity()) bytes_.make_room(count * sizeof(T));
    while (size_ < count) new (place(size_++)) T(copy);
  }
  /// Elements of [first, first + count), side by side, as long as nothing else is asked for.
  [[nodiscard]] const T* run(std::size_t first) const {
    bytes_.come_to(first * sizeof(T));
    return &at(first);
  }
  /// Adds `count` elements of a row; where the first of them stands.
  std::size_t append(const T* values, std::size_t count) {
    const std::size_t first = size_;
    if ((size_ + count) * sizeof(T) > bytes_.capacity()) bytes_.make_room((size_ + count) * sizeof(T));
    for (std::size_t i = 0; i < count; ++i) new (place(size_++)) T(values[i]);
    return first;
  }
  void append(const LongVector& other) {
    if ((size_ + other.size()) * sizeof(T) > bytes_.capacity()) bytes_.make_room((size_ + other.size()) * sizeof(T));
    for (std::size_t i = 0; i < other.size(); ++i) new (place(size_++)) T(other[i]);
  }

 private:
  [[nodiscard]] void* place(std::size_t i) {
    bytes_.come_to(i * sizeof(T));
    return bytes_.data() + i * sizeof(T);
  }
  [[nodiscard]] T& at(std::size_t i) const {
    return *std::launder(reinterpret_cast<T*>(bytes_.data() + i * sizeof(T)));
  }

  LongBytes bytes_;
  std::size_t size_ = 0;
};

}  // namespace polypod
