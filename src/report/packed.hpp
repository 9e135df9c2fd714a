// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Numbers as bytes in base64 (RFC 4648), as pages and VTK files hold them.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

namespace polypod::report {

std::string base64(const std::vector<std::uint8_t>& bytes);

/// Numbers of one type, little-endian whatever the machine is.
class Packed {
 public:
  template <class Number>
  void add(Number value) {
    using Bits =
        std::conditional_t<sizeof(Number) == 8, std::uint64_t,
                           std::conditional_t<sizeof(Number) == 4, std::uint32_t,
                                              std::conditional_t<sizeof(Number) == 2, std::uint16_t, std::uint8_t>>>;
    const auto bits = std::bit_cast<Bits>(value);
    for (std::size_t k = 0; k < sizeof(Number); ++k) bytes_.push_back(static_cast<std::uint8_t>(bits >> (8 * k)));
  }
  [[nodiscard]] std::string text() const { return base64(bytes_); }

 private:
  std::vector<std::uint8_t> bytes_;
};

}  // namespace polypod::report
